//! Surfaces at several distances: flags of a job, and their values.

use super::choices::{Choices, one_of};
use super::design::{Gap, focus_m, gap};
use super::values::bounded;
use crate::failure::usage;
use anyhow::Result;
use clap::Args;
use pipeline::bounds;

/// Surfaces at several distances, and the lens's focus.
#[derive(Clone, Debug, Default, PartialEq, Args)]
#[command(next_help_heading = "Depth")]
pub struct DepthArgs {
    /// Object distance in focus, m from the entrance pupil (`inf` allowed), of a design: its film moves there [default: the film of the
    /// design]. Without distances of pixels the chart lies there
    #[arg(long, value_name = "M", value_parser = focus_m)]
    pub focus_m: Option<f64>,
    /// Gap behind a surface of a design, counted from 1, set before focusing, e.g. 7=3.25; repeatable
    #[arg(long, value_name = "SURFACE=MM", value_parser = gap)]
    pub gap: Vec<Gap>,
    /// Distance of every chart pixel from the entrance pupil: array of the chart's size, PATH//depth of a Zarr store or HDF5 file, .npy,
    /// ENVI, TIFF, a channel of an OpenEXR file (scene.exr//Z), raw samples (--depth-dtype); or one distance;
    /// none: a flat chart [default: the array `depth` of the chart's group, with `coverage` and `hidden/1/…`; those of gen:depth-scene].
    /// Needs a design, or a lens pack with depth nodes. An array `coverage` beside `depth` is the share of each pixel that the surface covers
    #[arg(long, value_name = "PATH|DISTANCE|none")]
    pub depth: Option<String>,
    /// Unit of distances [default: the depth array's attribute unit, else m]
    #[arg(long, value_parser = one_of(DEPTH_UNIT))]
    pub depth_unit: Option<DepthUnit>,
    /// Distances along the optical axis (planar), or along the ray to each pixel [default: the depth array's attribute kind, else planar]
    #[arg(long, value_parser = one_of(DEPTH_KIND))]
    pub depth_kind: Option<DepthKind>,
    /// NaN, 0 and negative distances, which renderers write where a ray meets nothing: error, or infinity [default: error]
    #[arg(long, value_parser = one_of(DEPTH_MISS))]
    pub depth_miss: Option<DepthMiss>,
    /// Sample type of a raw --depth file, rows and columns of the chart: f16, f32, f64, u8, u16; prefix `>` for big-endian
    #[arg(long, value_name = "TYPE", requires = "depth")]
    pub depth_dtype: Option<String>,
    /// Pixels at a distance between those of two surfaces, as filtered depth has them at edges: keep (with a note), or snap to the nearer
    /// surface [default: keep]
    #[arg(long, value_parser = one_of(DEPTH_EDGES))]
    pub depth_edges: Option<DepthEdges>,
    /// Light of pixels that a surface covers in part, by its array coverage: that of the surface alone (straight), or multiplied by the coverage, as
    /// compositing programs and OpenEXR files have it (premultiplied), by which it is then divided [default: straight, with a note; an error for
    /// OpenEXR files with alpha]
    #[arg(long, value_parser = one_of(COVERAGE_LIGHT))]
    pub coverage_light: Option<CoverageLight>,
    /// Surface hidden behind the ones before it, the nearest first: Zarr group with arrays chart and depth, and coverage if it has holes, e.g.
    /// CHART//hidden/1, or a spectral OpenEXR file with a channel Z; repeatable. none: nothing is invented [default: what is hidden behind edges is
    /// invented from what is around, and its share of the light is stored in the film's array `invented`]
    #[arg(long, value_name = "GROUP|none")]
    pub hidden: Vec<String>,
    /// Maximum error of a kernel half-way between the depth nodes of a design, L1 at film pixels [default: 0.02]
    #[arg(long, value_name = "L1", value_parser = bounded(bounds::DEPTH_TOLERANCE))]
    pub depth_tolerance: Option<f64>,
}

/// Default of `--depth-tolerance`.
pub const DEPTH_TOLERANCE: f64 = 0.02;

const DEPTH_UNIT: Choices<DepthUnit> =
    &[("m", "", DepthUnit::Metre), ("cm", "", DepthUnit::Centimetre), ("mm", "", DepthUnit::Millimetre)];

/// `--depth-unit`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum DepthUnit {
    Metre,
    Centimetre,
    Millimetre,
}

impl DepthUnit {
    /// The unit with the symbol `text`.
    pub fn from_symbol(text: &str) -> Option<Self> {
        match text {
            "m" => Some(Self::Metre),
            "cm" => Some(Self::Centimetre),
            "mm" => Some(Self::Millimetre),
            _ => None,
        }
    }

    /// Metres per unit.
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 1e-2,
            Self::Millimetre => 1e-3,
        }
    }
}

const DEPTH_KIND: Choices<DepthKind> = &[
    ("planar", "Along the optical axis", DepthKind::Planar),
    ("ray", "Along the ray from the entrance pupil", DepthKind::Ray),
];

/// `--depth-kind`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthKind {
    /// Along the optical axis.
    Planar,
    /// Along the ray from the entrance pupil.
    Ray,
}

const DEPTH_EDGES: Choices<DepthEdges> = &[("keep", "", DepthEdges::Keep), ("snap", "", DepthEdges::Snap)];

/// `--depth-edges`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthEdges {
    /// As stored.
    Keep,
    /// The nearer neighbour's distance.
    Snap,
}

const DEPTH_MISS: Choices<DepthMiss> = &[("error", "", DepthMiss::Error), ("far", "", DepthMiss::Far)];

/// `--depth-miss`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthMiss {
    /// An error.
    Error,
    /// Infinity.
    Far,
}

const COVERAGE_LIGHT: Choices<CoverageLight> =
    &[("straight", "", CoverageLight::Straight), ("premultiplied", "", CoverageLight::Premultiplied)];

/// `--coverage-light`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CoverageLight {
    /// Of the surface alone.
    Straight,
    /// Multiplied by the coverage.
    Premultiplied,
}

/// `--hidden none`.
pub const NO_HIDDEN: &str = "none";

impl DepthArgs {
    /// The surfaces of `--hidden`.
    ///
    /// # Errors
    /// `none` beside others.
    pub fn given_hidden(&self) -> Result<&[String]> {
        match &self.hidden[..] {
            [only] if only == NO_HIDDEN => Ok(&[]),
            all if all.iter().any(|group| group == NO_HIDDEN) => {
                Err(usage(format!("--hidden {NO_HIDDEN} beside other surfaces: expected one or the other")))
            }
            all => Ok(all),
        }
    }
}
