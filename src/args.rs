//! Command-line arguments: a module per command or group of commands (`plan` in `work`, `verify` in `status`, `view` in `pyramid`), and parts that several have. The layout of help: `help`. [`crate::job`] resolves those of a job.

mod bands;
mod bench;
mod built;
mod cache;
mod camera;
mod chart;
mod choices;
mod compare;
mod dataset;
mod demo;
mod depth;
mod depth_report;
mod design;
mod develop;
mod device;
pub mod engine;
mod export;
mod ghosts;
pub mod help;
mod import;
mod lens;
mod lens_export;
mod light;
mod manual;
mod measure;
mod placement;
mod pyramid;
mod report;
mod restore;
mod run;
mod scene;
mod sensor;
mod shoot;
mod status;
mod tolerance;
mod tracing;
mod validate;
mod values;
mod veil;
pub mod version;
mod work;

pub use bands::bands;
pub use bench::BenchArgs;
pub use built::{BuiltArgs, LensSamples};
pub use cache::{CacheAction, CacheArgs};
pub use camera::{CameraArgs, Renderer};
pub use chart::{ChartArgs, ChartCommand, GeneratedArgs, ImageArgs, MotionArgs};
pub use compare::CompareArgs;
pub use dataset::{DatasetArgs, Part};
pub use demo::DemoArgs;
pub use depth::{
    CoverageLight, DEPTH_TOLERANCE, DepthArgs, DepthEdges, DepthKind, DepthMiss, DepthUnit, NO_HIDDEN,
};
pub use depth_report::DepthReportArgs;
pub use design::{CoatingsArg, DESIGN_FILES, DesignArgs, ImagePlaneArg};
pub use develop::{DevelopArgs, DevelopStyle, ToneArg};
pub use device::{Device, DeviceArgs, DeviceCommand, EngineArg};
pub use export::{ExportArgs, ExportFormatArg};
pub use ghosts::{GhostArgs, RINGS as GHOST_RINGS, ReflectanceArg};
pub use import::ImportArgs;
pub use lens::{
    ConvertArgs, DiffArgs, LensArgs, LensCommand, ListArgs, Normalise, PsfArgs, ShowArgs, Store, TableName,
    TraceArgs,
};
pub use lens_export::{Bands, ColmapModel, LensExportArgs, ModelArg, Terms};
pub use light::LightArgs;
pub use manual::{CompletionsArgs, HelpArgs, ManArgs};
pub use measure::MeasureArgs;
pub use placement::{FitArg, PlacementArgs};
pub use pyramid::{PyramidArgs, ViewArgs};
pub use report::{Corners, ReportArgs};
pub use restore::{RestoreArgs, RestoreMethod};
pub use run::{FilmUnits, ProcessArgs, RunArgs};
#[cfg(feature = "mesh")]
pub use scene::{
    BackgroundArg, LightsArg, MeshUnit, MissingTextures, ProjectionArg, ReachArg, SolidsArg, UpAxisArg,
};
pub use scene::{LookArgs, MeshArgs, SceneArgs};
pub use sensor::{ExposeArgs, SensorArgs, SensorCommand, SensorShowArgs, SensorValidateArgs, SizeArg};
pub use shoot::ShootArgs;
pub use status::{StatusArgs, VerifyArgs};
pub use tolerance::{KeptLens, ToleranceArgs};
pub use tracing::{BandSamplesArg, TracingArgs};
pub use validate::{Quantity, ValidateArgs};
pub use values::{band_indices, size_order_note};
pub use veil::{BinArg, MAX_SHARE, MAX_SUM, ScatterAmount, ScatterArg, VeilArgs};
pub use work::{PlanArgs, ProgressArg, RunCommand};

use crate::failure::usage;
use clap::{Parser, Subcommand};
use formats::durable::{check_url, is_url};
use std::ffi::OsString;
use std::path::Path;

/// Simulate the sensor-plane image (film) that a lens forms of a multispectral chart.
#[derive(Debug, Parser)]
#[command(name = "lenscube", version, long_version = crate::args::version::long(), max_term_width = 110, disable_help_subcommand = true)]
#[command(
    after_help = "Start here:  lenscube demo\nExit codes: 0 complete, 1 failed, 2 usage, 3 the output belongs to \
another job, 4 a check found errors or missing parts, 75 temporary error (retry), 130 interrupted (the same command resumes)"
)]
pub struct Cli {
    /// Print errors and results only
    #[arg(short, long, global = true, conflicts_with = "verbose", help_heading = "Output")]
    pub quiet: bool,
    /// Print figures of memory, time and devices as well
    #[arg(short, long, global = true, help_heading = "Output")]
    pub verbose: bool,
    /// Command to run.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Simulate a chart through a built-in lens and write pictures, in less than a minute
    Demo(DemoArgs),
    /// Generate a test chart as a Zarr store, or convert a picture to a chart
    Chart(Box<ChartArgs>),
    /// Turn a mesh (glTF, OBJ, PLY) into a scene: chart, distances and hidden surfaces, as a lens's pinhole sees them
    Scene(Box<SceneArgs>),
    /// Trace, import, show and compare lenses
    Lens(LensArgs),
    /// Report what distances of a chart's pixels mean for a run: blur, depth nodes, cost, suspicious pixels
    Depth(Box<DepthReportArgs>),
    /// Simulate the film of a chart
    Run(Box<RunCommand>),
    /// Expose a camera's sensor to a film: the raw mosaic with noise
    Sensor(Box<SensorArgs>),
    /// Develop a raw of a sensor to a picture: white balance, demosaicing, colour matrix
    Develop(Box<DevelopArgs>),
    /// Chart to picture in one command: run, sensor, develop
    Shoot(Box<ShootArgs>),
    /// Compare two raws, e.g. of two lenses under the same noise: difference, SNR, MTF, colours; or two films
    Compare(Box<CompareArgs>),
    /// Make a data set of films, raws or pictures by a recipe: many pictures, lenses, places, exposures, with labels
    Dataset(Box<DatasetArgs>),
    /// Restore the chart of a film: PSFs of every place of the field, distortion and relative illumination undone
    Restore(Box<RestoreArgs>),
    /// Divide a job into units for many processes, on one machine or on a cluster
    Plan(Box<PlanArgs>),
    /// Report the progress of a film, raw or scene
    Status(StatusArgs),
    /// Read a complete film, raw or scene and list missing or damaged parts
    Verify(VerifyArgs),
    /// Export a film or a chart as a picture (PNG, TIFF) or as data (EXR, TIFF, ENVI, NPY)
    Export(ExportArgs),
    /// Add levels of lower resolution to a film, for viewers (OME-Zarr multiscales)
    Pyramid(PyramidArgs),
    /// View a film in the browser: zoom, bands, comparison with the chart, spectra, lens data
    View(ViewArgs),
    /// Validate simulated test charts against the lens data: illumination, distortion, edge spread; writes a report
    Validate(Box<ValidateArgs>),
    /// Measure edges, points and profiles in a film
    Measure(Box<MeasureArgs>),
    /// Measure a camera from pictures of charts: resolution, noise, distortion, shading, glare, colour; writes a report
    Report(Box<ReportArgs>),
    /// Measure the speed of each stage and of a job on this machine
    Bench(BenchArgs),
    /// List the devices of this machine, and compare a GPU's films with the CPU's
    Device(DeviceArgs),
    /// Show, trim or clear the cache of traced lenses
    Cache(CacheArgs),
    /// Print a page of the guide, or the help of a command
    Help(HelpArgs),
    /// Print the completion script of a shell
    Completions(CompletionsArgs),
    /// Write the manual pages
    Man(ManArgs),
}

/// Fails for a URL in the arguments that is malformed or contains credentials, also as the value of a flag (`--lens=URL`).
pub fn check_urls(arguments: impl IntoIterator<Item = OsString>) -> Result<(), anyhow::Error> {
    for argument in arguments {
        let argument = argument.to_string_lossy();
        let value = argument
            .strip_prefix("--")
            .and_then(|flag| flag.split_once('='))
            .map_or(&*argument, |(_, value)| value);
        check_url(value).map_err(|e| usage(e.to_string()))?;
    }
    Ok(())
}

/// Fails unless `path` can be a local directory whose files are passed to other processes.
pub fn check_directory(path: &Path) -> Result<(), anyhow::Error> {
    if is_url(path) {
        return Err(usage(format!("{}: expected a local directory", path.display())));
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
    fn argument_definitions_are_consistent() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }

    #[test]
    fn help_names_every_exit_code() {
        use clap::CommandFactory;
        let help = Cli::command().get_after_help().unwrap().to_string();
        for (code, meaning) in crate::failure::code::MEANINGS {
            assert!(help.contains(&format!("{code} {meaning}")), "{code} {meaning} in {help}");
        }
    }
}
