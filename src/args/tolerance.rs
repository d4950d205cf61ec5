//! `lenscube lens tolerance`.

use super::design::{DESIGN_FILES, DesignArgs};
use super::values::{bounded, number, pitch, size, threads};
use clap::Args;
use pipeline::bounds;
use pipeline::geometry::Size;
use std::path::PathBuf;
use std::str::FromStr;

/// Most lenses of a batch.
const MAX_SAMPLES: u64 = 1_000_000;

/// `lenscube lens tolerance`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube lens tolerance my.zmx tolerances.toml --samples 1000 --out built --pass 0.3\n  \
lenscube lens tolerance my.zmx tolerances.toml --samples 1000 --out built --sensitivity --keep worst,median\n  \
lenscube lens tolerance my.zmx --import-tol -o tolerances.toml\n\
Lens k of a seed is the same for any --samples. More than 10 % of lenses that fail: exit code 4."
)]
pub struct ToleranceArgs {
    /// Design file, or name of a built-in design
    #[arg(value_name = "DESIGN", help = format!("Design file ({DESIGN_FILES}), or name of a built-in design (`lens list`)"))]
    pub design: String,
    /// Description of the errors (TOML)
    #[arg(value_name = "TOL.toml", required_unless_present = "import_tol", conflicts_with = "import_tol")]
    pub tolerances: Option<PathBuf>,
    /// Write the description of the TOL lines of a .zmx file instead, to stdout or --output
    #[arg(long, conflicts_with_all = ["samples", "seed", "out", "keep", "sensitivity", "pass", "json"])]
    pub import_tol: bool,
    /// File for the description of --import-tol
    #[arg(short, long, value_name = "FILE.toml", requires = "import_tol")]
    pub output: Option<PathBuf>,
    /// Number of lenses
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..=MAX_SAMPLES))]
    pub samples: u64,
    /// Seed of the draws
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub seed: u64,
    /// Directory for lenses.csv, summary.json and figures (SVG)
    #[arg(long, value_name = "DIR", required_unless_present = "import_tol")]
    pub out: Option<PathBuf>,
    /// Lenses whose packs are written: worst, best, median, pN (the lens at percentile N of the criterion), or a sample; repeatable
    #[arg(long, value_name = "WHICH,…", value_delimiter = ',')]
    pub keep: Vec<KeptLens>,
    /// Wavelengths of the packs of --keep, nm: 400:700:10 (both ends included) or 450,550
    #[arg(long, value_name = "NM", default_value = "400:700:10", requires = "keep")]
    pub wavelengths: String,
    /// Also each error alone at its limits, sorted by what it does to the criterion
    #[arg(long)]
    pub sensitivity: bool,
    /// Criterion of a good lens, for the yield: at least this MTF, at most this RMS
    #[arg(long, value_name = "VALUE", value_parser = number)]
    pub pass: Option<f64>,
    /// Film size in pixels, N or WxH: fields reach its corner [default: the design's outermost field point]
    #[arg(long, value_name = "WxH", value_parser = size, requires = "film_pitch_um", conflicts_with = "max_height_mm", help_heading = "Film")]
    pub film_size: Option<Size>,
    /// Film pixel pitch, µm
    #[arg(long, value_name = "UM", value_parser = pitch, requires = "film_size", help_heading = "Film")]
    pub film_pitch_um: Option<f64>,
    /// REAL image height of the film's corner, mm
    #[arg(long, value_name = "MM", value_parser = bounded(bounds::REACH_MM), help_heading = "Film")]
    pub max_height_mm: Option<f64>,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Print the summary as JSON
    #[arg(long)]
    pub json: bool,
    /// Replace existing files
    #[arg(long)]
    pub overwrite: bool,
    /// Parameters of the design.
    #[command(flatten)]
    pub parameters: DesignArgs,
}

/// A lens of `--keep`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeptLens {
    /// That of the worst criterion.
    Worst,
    /// That of the best one.
    Best,
    /// At this percentile of the criterion, in ascending order.
    Percentile(u32),
    /// By its number.
    Sample(u64),
}

impl FromStr for KeptLens {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let percentile = text.strip_prefix('p').and_then(|n| n.parse().ok()).filter(|n| *n <= 100);
        match (text, percentile, text.parse()) {
            ("worst", ..) => Ok(Self::Worst),
            ("best", ..) => Ok(Self::Best),
            ("median", ..) => Ok(Self::Percentile(50)),
            (_, Some(percentile), _) => Ok(Self::Percentile(percentile)),
            (_, _, Ok(sample)) => Ok(Self::Sample(sample)),
            _ => Err("expected worst, best, median, p0 to p100 or the number of a lens".to_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::KeptLens;

    #[test]
    fn kept_lenses_are_words_percentiles_and_numbers() {
        let of = |text: &str| text.parse::<KeptLens>();
        assert_eq!(of("worst"), Ok(KeptLens::Worst));
        assert_eq!(of("median"), Ok(KeptLens::Percentile(50)));
        assert_eq!(of("p10"), Ok(KeptLens::Percentile(10)));
        assert_eq!(of("7"), Ok(KeptLens::Sample(7)));
        for text in ["", "p", "p101", "-1", "p-1", "bad", "1.5"] {
            assert!(of(text).is_err(), "{text}");
        }
    }
}
