//! Flags exactly as typed. What they mean together is decided in [`crate::job`].

mod bench;
mod chart;
mod demo;
mod device;
mod export;
mod import;
mod lens;
mod manual;
mod measure;
mod pyramid;
mod run;
mod status;
mod style;
mod validate;
mod values;
mod work;

pub use bench::BenchArgs;
pub use chart::{ChartArgs, ChartCommand, DrawnArgs, ImageArgs};
pub use demo::DemoArgs;
pub use device::{Device, EngineArg};
pub use export::{ExportArgs, FileArg, PackingArg};
pub use import::{EvenArg, FormatArg, ImportArgs, OutwardArg, RowsArg, SampleArg};
pub use lens::{AimingArg, DesignArgs, DiffArgs, ImagePlaneArg, LensArgs, LensCommand, ShowArgs, TraceArgs};
pub use manual::{CompletionsArgs, ManArgs};
pub use measure::MeasureArgs;
pub use pyramid::{PyramidArgs, ViewArgs};
pub use run::{DtypeArg, FilmUnits, InterpArg, NanArg, OutsideArg, RunArgs, Stage, SurroundArg};
pub use status::{StatusArgs, VerifyArgs};
pub use validate::{Quantity, ValidateArgs};
pub use values::bands;
pub use work::{PlanArgs, ProgressArg, RunCommand};

use crate::failure::usage;
use clap::{Parser, Subcommand, ValueEnum};
use formats::durable::{check_url, is_url};
use std::ffi::OsString;
use std::path::Path;

/// lenscube turns a multispectral chart into the image a given lens throws on the film.
#[derive(Debug, Parser)]
#[command(name = "lenscube", version, about, max_term_width = 110)]
#[command(
    after_help = "Start here:  lenscube demo\nExit codes: 0 complete, 1 failed, 2 usage, 3 the output belongs to \
another job, 4 checked and found wrong or incomplete, 75 worth a retry, 130 interrupted and resumable"
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Show what a real lens does to a chart: pictures in under a minute
    Demo(DemoArgs),
    /// Draw a test chart into a Zarr store, or make one of a picture
    Chart(Box<ChartArgs>),
    /// Make, show and compare lenses
    Lens(LensArgs),
    /// Make the film of a chart
    Run(Box<RunCommand>),
    /// Cut a film into units of work for many processes, on one machine or on a cluster
    Plan(Box<PlanArgs>),
    /// Tell what of a film is done
    Status(StatusArgs),
    /// Read all of a film and name what is wrong with it
    Verify(VerifyArgs),
    /// Write a film or a chart as a picture (PNG, TIFF) or as a file for other programs (EXR, TIFF, ENVI, NPY)
    Export(ExportArgs),
    /// Add smaller and smaller films to a film, for viewers: OME-Zarr levels
    Pyramid(PyramidArgs),
    /// Look at a film in the browser: zoom, bands, the chart beside it, spectra, the lens's data
    View(ViewArgs),
    /// Hold films of test charts against the lens's own data: illumination, distortion, edge spread; a report
    Validate(Box<ValidateArgs>),
    /// Measure edges, points and profiles of a film
    Measure(Box<MeasureArgs>),
    /// Measure this machine on the paper's film
    Bench(BenchArgs),
    /// Write the completions of a shell
    Completions(CompletionsArgs),
    /// Write the manual pages
    Man(ManArgs),
}

/// Codecs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
#[allow(missing_docs, reason = "they are what they say")]
pub enum CodecArg {
    None,
    Lz4,
    Zstd,
}

/// Fails for a URL on the command line that is malformed or holds credentials, also as the value of a flag (`--lens=URL`).
pub fn check_urls(words: impl IntoIterator<Item = OsString>) -> Result<(), anyhow::Error> {
    for word in words {
        let word = word.to_string_lossy();
        let value =
            word.strip_prefix("--").and_then(|flag| flag.split_once('=')).map_or(&*word, |(_, value)| value);
        check_url(value).map_err(|e| usage(e.to_string()))?;
    }
    Ok(())
}

/// Fails unless `path` can be a directory of this machine whose files are named on further command lines.
pub fn check_directory(path: &Path) -> Result<(), anyhow::Error> {
    if is_url(path) {
        return Err(usage(format!("{}: expected a directory of this machine", path.display())));
    }
    match path.to_str() {
        Some(_) => Ok(()),
        None => Err(usage(format!("{}: the name of this directory must be UTF-8", path.display()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clap_finds_no_fault_with_the_flags() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }
}
