//! Geometry of a job: film size and pitch, optical axis, scale and centre of the chart.

use super::field_height::filled_height_mm;
use crate::args::{FitArg, PlacementArgs};
use crate::failure::usage;
use crate::job::lens::UntracedLens;
use crate::open::Chart;
use anyhow::Result;
use clap::ValueEnum;
use pipeline::bounds;
use pipeline::geometry::{Frame, Size};
use pipeline::real;

/// A chart and a lens, and what they are called in messages.
#[derive(Clone, Copy)]
pub struct Named<'a> {
    /// As given.
    pub chart_name: &'a str,
    /// The chart.
    pub chart: &'a Chart,
    /// As given.
    pub lens_name: &'a str,
    /// The lens.
    pub lens: &'a UntracedLens,
}

/// Film pixel pitch.
fn pitch_um(args: &PlacementArgs, named: Named<'_>) -> Result<f64> {
    args.film_pitch_um.or_else(|| named.chart.pitch_um()).ok_or_else(|| {
        usage(format!(
            "chart `{}` has no attribute pitch_um; give the film's pixel pitch, e.g. `--film-pitch-um 2`",
            named.chart_name
        ))
    })
}

/// Film pixels per chart pixel, (y, x): `--scale`, or |magnification| · chart pitch / film pitch. The magnification's sign
/// rotates the image by 180° about the axis; the film is stored upright, so only the magnitude is used.
fn scale(args: &PlacementArgs, named: Named<'_>) -> Result<(f64, f64)> {
    if let Some(fit) = args.fit {
        let scale = fitted_scale(fit, args, named)?;
        return Ok((scale, scale));
    }
    let Some(chart_pitch_mm) = args.chart_pitch_mm else { return Ok((args.scale.1, args.scale.0)) };
    let flag = format!("--chart-pitch-mm {chart_pitch_mm}");
    let Some((magnification, distance_mm)) = named.lens.conjugate()? else {
        return Err(usage(format!(
            "{flag}: lens `{}` is for an object at infinity, which has no magnification; trace it for the chart's \
             distance D with `lenscube lens trace DESIGN OUT.lens.zarr --object-distance-mm D`, or give `--scale`",
            named.lens_name
        )));
    };
    let scale = magnification.abs() * chart_pitch_mm * 1e3 / pitch_um(args, named)?;
    if !bounds::SCALE.contains(scale) {
        return Err(usage(format!(
            "{flag}: magnification {magnification} (object at {distance_mm} mm) gives a scale of {scale:e} film pixels per chart \
             pixel; the limit is 0.001 to 1000"
        )));
    }
    Ok((scale, scale))
}

/// Film pixels per chart pixel with which the chart fits the film, or without its size the lens's field. Distortion is not considered.
fn fitted_scale(fit: FitArg, args: &PlacementArgs, named: Named<'_>) -> Result<f64> {
    let name = fit.to_possible_value().map_or_else(String::new, |v| v.get_name().to_owned());
    let size = named.chart.size();
    let (width, height) = (size.width as f64, size.height as f64);
    let diagonal = real::hypot(width, height);
    let scale = match (fit, args.film_size) {
        (FitArg::Width, Some(film)) => film.width as f64 / width,
        (FitArg::Height, Some(film)) => film.height as f64 / height,
        (FitArg::Contain, Some(film)) => (film.width as f64 / width).min(film.height as f64 / height),
        (FitArg::Diagonal, Some(film)) => real::hypot(film.width as f64, film.height as f64) / diagonal,
        (FitArg::Contain | FitArg::Diagonal, None) => {
            let field_mm = filled_height_mm(named.lens)?.ok_or_else(|| {
                usage(format!(
                    "--fit {name}: the design `{}` has no field points off the axis; add --film-size",
                    named.lens_name
                ))
            })?;
            2.0 * field_mm / (pitch_um(args, named)? * 1e-3 * diagonal)
        }
        (FitArg::Width | FitArg::Height, None) => {
            return Err(usage(format!(
                "--fit {name} scales the chart to the film: add --film-size; `--fit diagonal` without it fills the lens's field"
            )));
        }
    };
    if !bounds::SCALE.contains(scale) {
        return Err(usage(format!(
            "--fit {name} gives a scale of {scale:e} film pixels per chart pixel; the limit is 0.001 to 1000"
        )));
    }
    Ok(scale)
}

/// Film, optical axis and chart placement.
pub fn frame(args: &PlacementArgs, named: Named<'_>) -> Result<Frame> {
    let chart = named.chart;
    let scale = scale(args, named)?;
    let size = chart.size();
    let pitch_um = pitch_um(args, named)?;
    let scaled = |n: usize, s: f64| ((n as f64 * s).round() as usize).max(1);
    let declared = chart.film_size().filter(|_| scale == (1.0, 1.0));
    let film = args
        .film_size
        .or(declared)
        .unwrap_or(Size::new(scaled(size.height, scale.0), scaled(size.width, scale.1)));
    bounds::film_size(film)
        .map_err(|e| usage(format!("{e}; give its size, e.g. `--film-size 2000x3000`")))?;
    let projection = chart.projection();
    let mut frame = Frame { scale, projection, ..Frame::centred(film, size, pitch_um) };
    if let Some((x, y)) = args.axis {
        frame.axis_px = (y, x);
    }
    frame.center_mm = (args.center.1, args.center.0);
    Ok(frame)
}
