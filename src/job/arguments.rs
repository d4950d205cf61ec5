//! Step 2: arguments resolved: device, engine, options, threads.

use super::keys::{DIGEST, FileState, MTIMES, SAMPLE};
use super::own_layers::with_layers;
use crate::args::RunArgs;
use crate::failure::usage;
use crate::job::film_engine;
use crate::machine::device::DeviceSelection;
use crate::machine::threads;
use anyhow::Result;
use formats::chart::Codec;
use formats::film::FilmStore;
use pipeline::band::{Options, PsfBetween};
use pipeline::field::Outside;
use pipeline::remap::ChartInterpolation;
use pipeline::resample::{Interp, Surround};
use pipeline::simd::Simd;
use pipeline::stage::{Stage, Stages};
use pipeline::stages::{default_stages, described};

/// Arguments of a job, resolved.
pub struct Arguments<'a> {
    /// As given.
    pub given: &'a RunArgs,
    /// What GPUs do not compute of the job; it is then computed on the CPU.
    pub on_cpu: Option<String>,
    /// Selected device and engine.
    pub device: DeviceSelection,
    /// Stages, interpolation and accuracy.
    pub options: Options,
    /// Compression of the film.
    pub codec: Codec,
    /// Worker threads.
    pub threads: usize,
    /// By what the files of the chart are identified: `--check-input`, or as the film was created.
    pub files: FileState,
}

impl<'a> Arguments<'a> {
    /// Resolves `given`, for surfaces at several distances if `has_depth`; `on_cpu`: what of its inputs GPUs do not compute.
    ///
    /// # Errors
    /// Device or engine not available; the film cannot be read.
    pub fn resolve(given: &'a RunArgs, has_depth: bool, on_cpu: Option<&str>) -> Result<Self> {
        if has_depth && !given.stages.contains(&Stage::Svpsf) {
            return Err(usage(
                "--depth requires the stage svpsf; `--depth none` ignores the distances of the chart",
            ));
        }
        let stages = with_layers(Stages::of(&given.stages), given);
        let film = film_engine::existing(&given.film, given.process.overwrite)?;
        let film_engine = film.as_ref().and_then(film_engine::recorded);
        let files = match &film {
            _ if given.check_input => FileState::Digest,
            Some(film) if has_key(film, DIGEST) => FileState::Digest,
            Some(film) if has_key(film, MTIMES) && !has_key(film, SAMPLE) => FileState::Times,
            _ => FileState::TimesAndSample,
        };
        let not_on_gpus = described(stages).find(|stage| !stage.on_gpus);
        let on_cpu = match not_on_gpus {
            Some(stage) => Some(format!("the stage {}", stage.name)),
            None => on_cpu.map(str::to_owned),
        };
        let device = film_engine::device(given, on_cpu.as_deref())?;
        let device = DeviceSelection::new(device, given.engine.explicit(), film_engine)?;
        let codec = given.codec.or(film.map(|film| film.spec().codec)).unwrap_or_default();
        let options = options(given, stages, device.simd);
        Ok(Self { given, on_cpu, device, options, codec, threads: threads(given.threads), files })
    }
}

/// Whether the identity of a film's job has `key`.
fn has_key(film: &FilmStore, key: &str) -> bool {
    film.provenance().get("job").is_some_and(|job| job.get(key).is_some())
}

fn options(given: &RunArgs, stages: Stages, simd: Simd) -> Options {
    Options {
        stages,
        interpolation: ChartInterpolation {
            interp: given.interp,
            surround: given.surround,
            outside: given.outside,
        },
        azimuths: given.azimuths,
        psf_window: given.psf_window,
        between: if given.interpolate_psf { PsfBetween::Interpolate } else { PsfBetween::Error },
        simd,
    }
}

/// Options of a run without flags.
pub fn default_options() -> Options {
    Options {
        stages: default_stages(),
        interpolation: ChartInterpolation {
            interp: Interp::Bicubic,
            surround: Surround::Edge,
            outside: Outside::Error,
        },
        azimuths: None,
        psf_window: None,
        between: PsfBetween::Error,
        simd: Simd::detect(),
    }
}
