//! Layout and units of a job's film.

use super::arguments::Arguments;
use super::inputs::Inputs;
use crate::args::{FilmUnits, RunArgs};
use crate::failure::usage;
use crate::job::layers::JobLayer;
use crate::job::light_units::{self, Quantity};
use crate::open::Chart;
use anyhow::Result;
use clap::ValueEnum;
use formats::chart::MAX_VALUE;
use formats::film::{FilmSpec, SampleType};
use formats::group::Output;
use pipeline::band::BandPlan;
use pipeline::geometry::{Frame, Size};
use pipeline::sensor::HC_J_M;
use pipeline::tiling::FilmRegion;

/// Film value per chart value on the axis: 1; irradiance, τ·Ω (E = L·τ·Ω·R); or photons, τ·Ω·λ/(hc)·pixel area.
pub fn gain(units: FilmUnits, plan: &BandPlan, frame: &Frame) -> f64 {
    let irradiance = plan.lens.transmission * plan.lens.solid_angle_sr;
    match units {
        FilmUnits::Relative => 1.0,
        FilmUnits::Irradiance => irradiance,
        FilmUnits::Photons => {
            let per_joule = plan.lens.wavelength_nm * 1e-9 / HC_J_M;
            irradiance * per_joule * (frame.pitch_um * 1e-6).powi(2)
        }
    }
}

/// Largest chart value whose products with the bands' gains stay within f32.
pub fn max_chart_value(gains: &[f64]) -> f32 {
    (f64::from(MAX_VALUE) / gains.iter().fold(1.0, |m, g| f64::max(m, *g))) as f32
}

/// Layout of the film.
pub fn film_spec(
    arguments: &Arguments<'_>,
    frame: &Frame,
    wavelengths_nm: Vec<f64>,
    inputs: &Inputs,
    layers: &[Box<dyn JobLayer>],
) -> Result<FilmSpec> {
    let (args, chart) = (arguments.given, &inputs.chart);
    if args.chunk == 0 || args.shard == 0 || !args.shard.is_multiple_of(args.chunk) {
        return Err(usage(format!(
            "--shard {} is not a multiple of --chunk {}; e.g. `--shard 2048 --chunk 512`",
            args.shard, args.chunk
        )));
    }
    let mut outputs = Vec::new();
    for (i, rect) in args.roi.iter().enumerate() {
        if !frame.film.rect().contains(*rect) {
            return Err(usage(format!(
                "--roi {},{},{},{} is not inside the film of {}",
                rect.x, rect.y, rect.width, rect.height, frame.film
            )));
        }
        outputs.push(Output { name: format!("roi_{i}"), rect: *rect });
    }
    if outputs.is_empty() {
        outputs.push(Output { name: "film".into(), rect: frame.film.rect() });
    }
    check_radiance(args, chart)?;
    let units = match args.film_units {
        FilmUnits::Relative => chart_units(args, chart).unwrap_or("relative").to_owned(),
        FilmUnits::Irradiance => "W m-2 nm-1".into(),
        FilmUnits::Photons => "s-1 nm-1".into(),
    };
    let spec = FilmSpec {
        outputs,
        film: frame.film,
        wavelengths_nm,
        pitch_um: frame.pitch_um,
        axis_px: frame.axis_px,
        units,
        sample: args.dtype,
        shard: args.shard,
        chunk: args.chunk,
        codec: arguments.codec,
        keep_bits: keep_bits(args, args.dtype)?,
        has_invented: inputs.depth.as_ref().is_some_and(|depth| depth.surfaces.is_invented),
        layers: layers.iter().map(|layer| layer.stored().clone()).collect(),
    };
    spec.check().map_err(|e| usage(e.to_string()))?;
    Ok(spec)
}

/// Unit of the chart's values: `--chart-units`, else that of its metadata.
pub fn chart_units<'a>(args: &'a RunArgs, chart: &'a Chart) -> Option<&'a str> {
    args.chart_units.as_deref().or_else(|| chart.units())
}

/// Fails if a film in physical units is asked for of a chart in other known units.
///
/// # Errors
/// Usage: how its values are converted.
fn check_radiance(args: &RunArgs, chart: &Chart) -> Result<()> {
    let units = chart_units(args, chart);
    let way_out = match units.and_then(light_units::parse) {
        _ if args.film_units == FilmUnits::Relative => return Ok(()),
        None | Some((Quantity::Radiance, 1.0)) => return Ok(()),
        Some((Quantity::Radiance, factor)) => {
            format!("convert its values with `--chart-scale {factor} --chart-units 'W m-2 sr-1 nm-1'`")
        }
        Some(_) => "make a chart of radiance, or leave out --film-units".into(),
    };
    Err(usage(radiance_required(args, units, &way_out)))
}

/// What `--film-units` requires of a chart in `units`.
pub fn radiance_required(args: &RunArgs, units: Option<&str>, way_out: &str) -> String {
    format!(
        "--film-units {} requires a chart in spectral radiance, W m-2 sr-1 nm-1; the units of the chart are {}; {way_out}",
        args.film_units.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned()),
        units.unwrap_or("not given")
    )
}

/// `--keep-bits`; `None` if it keeps all bits.
fn keep_bits(args: &RunArgs, sample: SampleType) -> Result<Option<u32>> {
    let all = sample.mantissa_bits();
    match args.keep_bits {
        Some(bits) if bits > all => {
            let (dtype, all) = (format!("{:?}", args.dtype).to_lowercase(), all.to_string());
            Err(usage(format!(
                "--keep-bits {bits}: --dtype {dtype} has {all} bits of mantissa; use 1 to {all}"
            )))
        }
        bits => Ok(bits.filter(|&bits| bits < all)),
    }
}

/// Regions of the film to compute.
pub fn regions(film: &FilmSpec) -> Vec<FilmRegion> {
    let region = |i: usize| {
        let (height, width) = film.shard_shape(i);
        FilmRegion { rect: film.outputs[i].rect, shard: Size::new(height, width) }
    };
    (0..film.outputs.len()).map(region).collect()
}
