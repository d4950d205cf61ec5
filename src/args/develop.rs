//! `lenscube develop`.

use super::choices::{DEMOSAIC, one_of};
use super::values::{bytes, number, roi, threads};
use clap::{Args, ValueEnum};
use pipeline::develop::Demosaic;
use pipeline::geometry::Rect;
use std::path::PathBuf;

/// `lenscube develop`. Other commands that write a picture of a raw request it by [`DevelopArgs::new`].
#[derive(Clone, Debug, PartialEq, Args)]
#[command(after_help = "Examples:\n  lenscube develop raw.zarr picture.png\n  \
lenscube develop bracket.zarr//roi_0 region.tif --frame 2 --depth 16 --white A\n  \
lenscube develop raw.zarr linear.exr --matrix none --demosaic bilinear\n  \
lenscube develop raw.zarr even.png --shading double-gauss-28 --exposure 0.5\n\
Formats by extension: .png and .tif (8 or 16 bits), .exr (linear light, 32-bit floats)")]
pub struct DevelopArgs {
    /// Raw of `lenscube sensor`, PATH or PATH//roi_0, here or at s3://BUCKET/PREFIX
    #[arg(value_name = "RAW")]
    pub raw: String,
    /// Picture to write: .png, .tif or .exr
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// How to develop
    #[command(flatten)]
    pub style: DevelopStyle,
    /// Frame of the raw, from 0
    #[arg(long, default_value_t = 0)]
    pub frame: usize,
    /// All frames of a raw of several exposure times as one of a wider range, of the brightness of --frame; .exr holds all of it, --exposure moves what .png and .tif show
    #[arg(long)]
    pub merge: bool,
    /// Replace pixels that differ from their neighbours of their colour by more than noise does: hot pixels, telegraph noise, and points of light of one pixel
    #[arg(long)]
    pub correct_defects: bool,
    /// Only this rectangle of the picture, in its pixels
    #[arg(long, value_name = "X,Y,W,H", value_parser = roi)]
    pub crop: Option<Rect>,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Maximum memory, e.g. 1GiB [default: half of what is available, at most 1 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Replace an existing file
    #[arg(long)]
    pub overwrite: bool,
}

/// What determines the pixels of a development.
#[derive(Clone, Debug, PartialEq, Args)]
pub struct DevelopStyle {
    /// Light that becomes neutral: D65, A, E, auto (the mean of the unclipped pixels), or gains R,G,B of the planes [default: the chart's light if
    /// the film records it, else D65]
    #[arg(long, value_name = "LIGHT")]
    pub white: Option<String>,
    /// Interpolation of the planes [default: malvar for Bayer patterns, else bilinear]
    #[arg(long, value_parser = one_of(DEMOSAIC))]
    pub demosaic: Option<Demosaic>,
    /// 2: mean of 2 x 2 pixels of one filter (quad patterns become Bayer patterns)
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    pub bin: u8,
    /// fitted (to the ColorChecker, from the sensor's curves), none, or a file of three rows of numbers
    #[arg(long, default_value = DEFAULT_MATRIX, value_name = "fitted|none|FILE")]
    pub matrix: String,
    /// none, or division by a lens's relative illumination or by a raw of a uniform chart, at most 8 times
    #[arg(long, default_value = NO_SHADING, value_name = "none|LENS|FLAT.zarr")]
    pub shading: String,
    /// Exposure correction, a factor of 2^EV
    #[arg(long, default_value_t = 0.0, value_name = "EV", value_parser = exposure_value, allow_hyphen_values = true)]
    pub exposure: f64,
    /// Transfer function of PNG and TIFF; OpenEXR is linear [default: srgb]
    #[arg(long, value_enum)]
    pub tone: Option<ToneArg>,
    /// Bits of a sample of PNG and TIFF: 8 or 16 [default: 8]
    #[arg(long, value_parser = depth)]
    pub depth: Option<u32>,
}

/// Default of `--matrix`.
const DEFAULT_MATRIX: &str = "fitted";
/// Default of `--shading`.
const NO_SHADING: &str = "none";

impl DevelopArgs {
    /// The request of `lenscube develop RAW OUT` without flags.
    pub fn new(raw: impl Into<String>, out: impl Into<PathBuf>) -> Self {
        Self {
            raw: raw.into(),
            out: out.into(),
            style: DevelopStyle::default(),
            frame: 0,
            merge: false,
            correct_defects: false,
            crop: None,
            threads: None,
            memory: None,
            overwrite: false,
        }
    }
}

impl Default for DevelopStyle {
    fn default() -> Self {
        Self {
            white: None,
            demosaic: None,
            bin: 1,
            matrix: DEFAULT_MATRIX.into(),
            shading: NO_SHADING.into(),
            exposure: 0.0,
            tone: None,
            depth: None,
        }
    }
}

/// `--tone`
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "the variants are the values of the flag")]
pub enum ToneArg {
    Srgb,
    Linear,
}

fn exposure_value(text: &str) -> Result<f64, String> {
    let ev = number(text)?;
    match (-20.0..=20.0).contains(&ev) {
        true => Ok(ev),
        false => Err(format!("expected -20 to 20 EV, found {ev}")),
    }
}

fn depth(text: &str) -> Result<u32, String> {
    match text {
        "8" => Ok(8),
        "16" => Ok(16),
        _ => Err("expected 8 or 16 bits".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{Command, FromArgMatches};

    #[test]
    fn request_has_the_defaults_of_the_flags() {
        let matches = DevelopArgs::augment_args(Command::new("develop"))
            .get_matches_from(["develop", "raw", "out.png"]);
        assert_eq!(DevelopArgs::from_arg_matches(&matches).unwrap(), DevelopArgs::new("raw", "out.png"));
    }
}
