//! `lenscube lens trace --tolerances`: traces the lens as built into a pack without rotational symmetry.

use super::writer::write_beside;
use super::{band_line, create_pack, summary};
use crate::args::{Store, TraceArgs};
use crate::failure::usage;
use crate::job::lens::attributes::attributes;
use crate::job::lens::built::{map_range, recorded};
use crate::job::lens::drawn::DrawnLens;
use crate::progress::{TracingBar, log_line, number};
use anyhow::{Context, Result};
use formats::lens::LensPackWriter;
use pipeline::design::DesignError;
use pipeline::design::skew::error::SkewError;
use pipeline::design::skew::tables::{NominalNodes, SkewTrace};
use pipeline::design::trace::{BandReport, Progress, TraceOptions};
use pipeline::real;
use std::f64::consts::FRAC_1_SQRT_2;
use std::time::Instant;

/// Half the sides of the film of `args` (X, Y), mm; without one, of the square within the largest height.
fn half_film_mm(args: &TraceArgs, options: &TraceOptions) -> Result<[f64; 2]> {
    let Some(size) = args.film_size else { return Ok([options.max_height_mm * FRAC_1_SQRT_2; 2]) };
    let half = [size.width, size.height].map(|px| 0.5 * px as f64 * options.film_pitch_um * 1e-3);
    let corner_mm = real::hypot(half[0], half[1]);
    match corner_mm <= options.max_height_mm {
        true => Ok(half),
        false => Err(usage(format!(
            "--film-size {size}: its corner lies {corner_mm:.4} mm from the axis, expected at most --max-height-mm {:.4} mm",
            options.max_height_mm
        ))),
    }
}

/// Traces the pack.
///
/// # Errors
/// Flags that such packs do not have; a lens that cannot be traced over the film.
pub fn trace(args: &TraceArgs, drawn: &DrawnLens, options: &TraceOptions, start: Instant) -> Result<()> {
    if args.depths_m.is_some() {
        return Err(usage("--depths-m: expected a lens with rotational symmetry, not one with --tolerances"));
    }
    let half_mm = half_film_mm(args, options)?;
    let pack = create_pack(&args.out, |out| LensPackWriter::create_planar(out))?;
    let bar = TracingBar::new(options.wavelengths_nm.len());
    bar.step("focus of the lens as built".to_owned());
    let adjusted = drawn.compensated(real::hypot(half_mm[0], half_mm[1]))?;
    adjusted.notes.iter().for_each(|note| log_line(format!("note: {note}")));
    let range = map_range(half_mm, options.max_height_mm);
    let mut reports: Vec<BandReport> = Vec::new();
    let stored = args.store.unwrap_or(Store::Psfs);
    let result = write_beside(pack, stored, |write| {
        let trace = SkewTrace::new(&adjusted.lens, options, range)?;
        let (mut lens, mut nodes) = (trace.header()?, NominalNodes::default());
        for (index, nm) in options.wavelengths_nm.iter().enumerate() {
            let mut progress = |p: Progress| {
                bar.set_bands(p.band);
                bar.step(format!("{} nm: {} ({} PSFs)", number(*nm), p.step, p.psfs));
            };
            let band = trace.band(index, &mut nodes, &mut progress)?;
            bar.suspend(|| log_line(band_line(&band)));
            reports.push(band.report);
            lens.bands.push(band.tables.clone());
            let failed =
                |e: super::writer::Stopped| DesignError::Sink { wavelength_nm: *nm, problem: e.to_string() };
            write(index, band).map_err(failed)?;
        }
        Ok::<_, SkewError>(lens)
    });
    bar.finish();
    let context = || format!("tracing lens {} of {}", drawn.draw.1, args.design);
    let (traced, pack) = result.with_context(context)?;
    let lens = traced.with_context(context)?;
    let attributes = attributes(&args.design, &args.parameters, options, &reports);
    pack.finish(&lens, &recorded(attributes, drawn.record.clone(), &adjusted))?;
    for line in summary(&args.out, options, &reports, start.elapsed().as_secs_f64()) {
        log_line(line);
    }
    Ok(())
}
