//! `lenscube lens camera`.

use super::choices::{Choices, one_of};
use super::design::{DESIGN_FILES, Depths, DesignArgs, depths, focus_m};
use super::values::{pitch, size};
use clap::Args;
use pipeline::geometry::Size;

/// `lenscube lens camera`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  lenscube lens camera phone --focus-m 0.5 --film-size 4000x3000 --film-pitch-um 1 --for blender\n\
The picture of this camera, with its depth, is the CHART of `lenscube run CHART FILM --lens DESIGN --focus-m M --film-size WxH`. A camera \
elsewhere, or of another focal length, is a different picture, which nothing detects."
)]
pub struct CameraArgs {
    /// Design file, or name of a built-in design
    #[arg(value_name = "DESIGN", help = format!("Design file ({DESIGN_FILES}), or name of a built-in design (`lens list`)"))]
    pub design: String,
    /// Object distance in focus, m from the entrance pupil, or inf [default: the film of the design]
    #[arg(long, value_name = "M", value_parser = focus_m, conflicts_with = "object_distance_mm")]
    pub focus_m: Option<f64>,
    /// Size of the film in pixels, N or WxH
    #[arg(long, alias = "film", value_name = "WxH", value_parser = size)]
    pub film_size: Size,
    /// Film pixel pitch in µm
    #[arg(long, alias = "pitch-um", value_name = "UM", value_parser = pitch, default_value = "2")]
    pub film_pitch_um: f64,
    /// Distances of the scene in m: the margin around the film then holds their blur [default: a margin of 64 pixels]
    #[arg(long, value_name = "NEAR:FAR", value_parser = depths)]
    pub depths_m: Option<Depths>,
    /// Print the camera in the words of a renderer
    #[arg(long = "for", value_name = "RENDERER", value_parser = one_of(RENDERER))]
    pub renderer: Option<Renderer>,
    /// Print JSON
    #[arg(long, conflicts_with = "renderer")]
    pub json: bool,
    /// Parameters of the design.
    #[command(flatten)]
    pub parameters: DesignArgs,
}

const RENDERER: Choices<Renderer> = &[
    ("blender", "Python for Blender", Renderer::Blender),
    ("mitsuba", "XML of Mitsuba 3", Renderer::Mitsuba),
    ("pbrt", "PBRT-v4", Renderer::Pbrt),
];

/// `--for`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum Renderer {
    Blender,
    Mitsuba,
    Pbrt,
}
