//! `lenscube validate`.

use super::choices::{STYLE, one_of};
use super::design::{CoatingsArg, DESIGN_FILES};
use super::device::{Device, EngineArg};
use super::values::{bytes, number, pitch, threads};
use clap::Args;
use formats::picture::style::Style;
use std::path::PathBuf;

/// `lenscube validate`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube validate --out report\n  \
lenscube validate --lens my.lens.zarr --against my.zmx --wavelengths 450,550,650 --out report\n  \
lenscube validate --out report --require ri=0.9999,distortion=0.01,esf=0.999\n\
The report is report/report.html; curves are in report/curves as CSV, figures in report/summary.json.")]
pub struct ValidateArgs {
    /// Lens of the simulation: pack, design or name of a built-in lens
    #[arg(long, value_name = "NAME|PACK|DESIGN", default_value = "double-gauss-28", help = format!("Lens of the simulation: pack, design ({DESIGN_FILES}) or name of a built-in lens"))]
    pub lens: String,
    /// Lens whose data the films are compared with [default: the same lens]
    #[arg(long, value_name = "NAME|PACK|DESIGN")]
    pub against: Option<String>,
    /// Coatings of the designs among these two, as for `lenscube run`; transmission and ghosts are checked with them, else with a quarter wave of MgF2
    #[arg(long, value_name = "COATINGS|FILE", value_parser = CoatingsArg::parse, default_value = "ideal")]
    pub coatings: CoatingsArg,
    /// Wavelengths of the films in nm: 400:700:10 (both ends included) or 450,550
    #[arg(long, value_name = "NM", default_value = "400:700:10")]
    pub wavelengths: String,
    /// Bands to validate: wavelengths in nm, 550 or 450:650 (both ends included), or indices, '#0:5' [default: all]
    #[arg(long)]
    pub bands: Option<String>,
    /// Side of the film in pixels, 4096 to 100000; measurement positions are proportional to it
    #[arg(long, alias = "size", value_name = "PX", default_value_t = 14141, value_parser = clap::value_parser!(u32).range(4096..=100_000))]
    pub film_size: u32,
    /// Film pixel pitch in µm
    #[arg(long, value_name = "UM", value_parser = pitch, default_value = "2")]
    pub film_pitch_um: f64,
    /// Simulate complete films, band by band, instead of the regions that are evaluated
    #[arg(long)]
    pub full: bool,
    /// Directory for the report; the films are written there too and removed at the end
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Exit with code 4 unless every band meets these limits: ri=IoU, distortion=MEAN_PX, esf=IoU (IoU: intersection
    /// over union of two curves, 1 = equal), light=N: largest difference of the section Light over its limit
    #[arg(long, value_name = "WHAT=LIMIT,…", value_delimiter = ',', value_parser = requirement)]
    pub require: Vec<(Quantity, f64)>,
    /// Film whose run record (runs/*.json) is shown in the table of times
    #[arg(long, value_name = "FILM")]
    pub timing: Option<PathBuf>,
    /// Colours of figures
    #[arg(long, value_parser = one_of(STYLE), default_value = "light")]
    pub style: Style,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Maximum memory, e.g. 1GiB [default: half of the available memory, at most 4 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Device: cpu; cuda (all GPUs) or cuda:0,2 (one queue per entry); auto (GPUs if usable, else cpu)
    #[arg(long, value_name = "DEVICE", default_value_t = Device::Auto)]
    pub device: Device,
    /// Implementation of the arithmetic: avx512, avx2 or portable (CPU), cuda-sm_90 (GPUs of that compute capability)
    /// [default: the fastest]
    #[arg(long, value_name = "ENGINE", default_value_t = EngineArg::Auto, hide_default_value = true)]
    pub engine: EngineArg,
}

/// Quantity of `--require`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Relative illumination: minimum IoU.
    Ri,
    /// Distortion: maximum mean error, px.
    Distortion,
    /// Edge spread function: minimum IoU.
    Esf,
    /// Light beside the image: maximum difference over its limit.
    Light,
}

fn requirement(text: &str) -> Result<(Quantity, f64), String> {
    let expected =
        "expected ri=IOU, distortion=PX, esf=IOU or light=N, such as ri=0.9999,distortion=0.01,esf=0.999";
    let (what, limit) = text.split_once('=').ok_or(expected)?;
    let what = match what.trim() {
        "ri" => Quantity::Ri,
        "distortion" => Quantity::Distortion,
        "esf" => Quantity::Esf,
        "light" => Quantity::Light,
        _ => return Err(expected.into()),
    };
    match number(limit)? {
        v if v >= 0.0 && (v <= 1.0 || matches!(what, Quantity::Distortion | Quantity::Light)) => {
            Ok((what, v))
        }
        v => Err(format!("{v} is out of range: {expected}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requirements_parse_and_values_out_of_range_are_errors() {
        assert_eq!(requirement("ri=0.9999"), Ok((Quantity::Ri, 0.9999)));
        assert_eq!(requirement("distortion=2"), Ok((Quantity::Distortion, 2.0)));
        assert!(
            requirement("esf=1.5").is_err() && requirement("psf=1").is_err() && requirement("ri").is_err()
        );
    }
}
