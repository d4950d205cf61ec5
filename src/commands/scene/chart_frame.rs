//! The chart of a scene: the pinhole whose picture it is, its size and directions.

use crate::args::{ProjectionArg, SceneArgs};
use crate::failure::usage;
use anyhow::{Context, Result};
use pipeline::design::pinhole::Pinhole;
use pipeline::design::system::System;
use pipeline::geometry::Size;
use pipeline::projection::{MAX_DEG, Projection};
use pipeline::scene::film_directions::FilmDirections;
use pipeline::scene::frame::Frame;
use std::sync::Arc;

/// Pixels of a chart over those of its film from which on it is refused.
const LARGER_THAN_FILM: f64 = 4.0;

/// The pinhole of `system`, in focus, for the film of `args` and surfaces of the vergences `range`, 1/m.
///
/// # Errors
/// The film is beyond the lens's field.
pub fn pinhole(args: &SceneArgs, system: &System, range: Option<(f64, f64)>) -> Result<Pinhole> {
    let camera = match args.view.projection {
        Some(ProjectionArg::Film) => Pinhole::on_film,
        None | Some(ProjectionArg::Planar) => Pinhole::new,
    };
    camera(system, args.film_size, args.film_pitch_um, range)
        .with_context(|| format!("camera of {}", args.lens))
}

/// A note on a margin that is narrower than the blur.
pub fn margin_note(pinhole: &Pinhole) -> Option<String> {
    (pinhole.overscan_px < pinhole.margin_px).then(|| {
        format!(
            "the chart reaches {} px beyond the film, its corners then see {MAX_DEG} deg from the axis; blur of {} px would reach farther: there the film shows the chart's border (--surround)",
            pinhole.overscan_px, pinhole.margin_px
        )
    })
}

/// The chart of `pinhole`, with pixels `step` times as large.
///
/// # Errors
/// Usage: its corners see 90° from the axis.
pub fn frame(args: &SceneArgs, pinhole: &Pinhole, step: f64) -> Result<Frame> {
    let side = |n: usize| ((n as f64 / step) as usize).max(1);
    let (height, width) = (side(pinhole.size.height), side(pinhole.size.width));
    let planar = Frame::centred(height, width, args.film_pitch_um * 1e-3 * step, pinhole.focal_mm);
    let Projection::Film(projection) = pinhole.projection else { return Ok(planar) };
    let reach_mm = pinhole.corner_mm();
    let film = FilmDirections::new(projection, reach_mm).ok_or_else(|| {
        usage(format!(
            "--projection film: the corners of the film see {:.1} deg from the axis, of at most {MAX_DEG}: a smaller --film-size",
            pinhole.corner_deg()
        ))
    })?;
    Ok(Frame { film: Some(Arc::new(film)), ..planar })
}

/// Fails for a chart that distortion makes much larger than the film, unless its projection was asked for.
///
/// # Errors
/// Usage.
pub fn check_size(args: &SceneArgs, pinhole: &Pinhole) -> Result<()> {
    let Size { height, width } = args.film_size;
    let distortion_px = 2 * pinhole.overscan_px.saturating_sub(pinhole.margin_px);
    let ratio = (height + distortion_px) as f64 * (width + distortion_px) as f64 / (height * width) as f64;
    match args.view.projection {
        None if ratio >= LARGER_THAN_FILM => Err(usage(format!(
            "{}: the ideal image plane of this film has {ratio:.0} times its pixels; give --projection film, or --projection planar for so large a chart",
            args.lens
        ))),
        _ => Ok(()),
    }
}
