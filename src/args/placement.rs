//! Size of a film and place of the chart on it: flags of a job.

use super::values::{bounded, pair, pair_mm, pitch, scale, size};
use clap::{Args, ValueEnum};
use pipeline::bounds;
use pipeline::geometry::Size;

/// Film and place of the chart.
#[derive(Clone, Copy, Debug, PartialEq, Args)]
pub struct PlacementArgs {
    /// Film size in pixels: N or WxH [default: the chart's film_size, else its size times the scale]
    #[arg(long, value_name = "WxH", value_parser = size, help_heading = "Film")]
    pub film_size: Option<Size>,
    /// Film pixel pitch in µm [default: the chart's pitch_um]
    #[arg(long, value_name = "UM", value_parser = pitch, help_heading = "Film")]
    pub film_pitch_um: Option<f64>,
    /// Optical axis in film pixels [default: centre of the film]
    #[arg(long, value_name = "X,Y", value_parser = pair, allow_hyphen_values = true, help_heading = "Placement")]
    pub axis: Option<(f64, f64)>,
    /// Film pixels per chart pixel
    #[arg(long, value_name = "SX[,SY]", value_parser = scale, default_value = "1", help_heading = "Placement")]
    pub scale: (f64, f64),
    /// Chart pixel pitch at the object, mm. The scale is then |magnification| x this / film pitch. Needs a lens with a finite object
    /// distance; replaces --scale
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::OBJECT_PITCH_MM), conflicts_with = "scale", help_heading = "Placement")]
    pub chart_pitch_mm: Option<f64>,
    /// Scale the chart to the film (--film-size), or without it to the lens's field: its width or height as the film's, the diagonal as the
    /// film's or field's, or the complete chart inside. Replaces --scale
    #[arg(long, value_enum, conflicts_with_all = ["scale", "chart_pitch_mm"], help_heading = "Placement")]
    pub fit: Option<FitArg>,
    /// Centre of the chart in mm from the optical axis
    #[arg(long, value_name = "X,Y", value_parser = pair_mm, default_value = "0,0", allow_hyphen_values = true, help_heading = "Placement")]
    pub center: (f64, f64),
}

impl Default for PlacementArgs {
    fn default() -> Self {
        Self {
            film_size: None,
            film_pitch_um: None,
            axis: None,
            scale: (1.0, 1.0),
            chart_pitch_mm: None,
            fit: None,
            center: (0.0, 0.0),
        }
    }
}

/// `--fit`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum FitArg {
    Width,
    Height,
    Diagonal,
    Contain,
}
