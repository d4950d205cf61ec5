//! The engine of a film: the implementation of the arithmetic that computes its pixels.
//!
//! Engines differ by up to 2e-6 of the film's peak, by the order of their roundings, so a film keeps the engine that it was
//! begun with: its name stands beside the job in the film's attributes (`provenance.engine`), and in the plan. A later run or
//! worker uses that engine where the machine has it. Another one is refused (exit code 3) unless `--mixed-engines`; it is then
//! marked in the film ([`FilmStore::mark_engine`]) before its first shard, so that no kill can hide it.
//! On a GPU the kernels' PSFs are rotated by the portable engine: the name of a GPU engine needs no processor.

use crate::args::{Device, RunArgs};
use crate::device::Choice;
use crate::failure::{other_job, usage};
use crate::progress::say;
use anyhow::Result;
use formats::film::{FilmError, FilmStore};
use pipeline::cuda::error::Version;
use pipeline::simd::{Isa, Simd};
use std::fmt;
use std::path::Path;
use std::str::FromStr;

/// An implementation of the arithmetic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// The processor, with these instructions.
    Cpu(Isa),
    /// NVIDIA GPUs of this compute capability.
    Cuda(Version),
}

impl Engine {
    /// The processor with `simd`.
    pub const fn cpu(simd: Simd) -> Self {
        Self::Cpu(simd.isa())
    }

    /// Whether `--device` allows it.
    pub fn fits(self, device: &Device) -> bool {
        match (self, device) {
            (_, Device::Auto) | (Self::Cpu(_), Device::Cpu) | (Self::Cuda(_), Device::Cuda(_)) => true,
            (Self::Cpu(_), Device::Cuda(_)) | (Self::Cuda(_), Device::Cpu) => false,
        }
    }
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu(isa) => f.write_str(isa.name()),
            Self::Cuda((major, minor)) => write!(f, "cuda-sm_{major}{minor}"),
        }
    }
}

impl FromStr for Engine {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(digits) = text.strip_prefix("cuda-sm_") {
            let all = digits.bytes().all(|b| b.is_ascii_digit());
            let number = digits.parse::<i32>().ok().filter(|n| all && (10..=999).contains(n));
            return number.map(|n| Self::Cuda((n / 10, n % 10))).ok_or_else(|| {
                format!("`{text}`: expected a compute capability without its point, as in cuda-sm_90")
            });
        }
        let isa: Result<Isa, _> = text.parse();
        isa.map(Self::Cpu).map_err(|_| {
            "expected auto, avx512, avx2, portable or cuda-sm_90 (a GPU's compute capability)".into()
        })
    }
}

/// The engine on record of the film at `path`; none if there is no film, or one that `--overwrite` removes.
///
/// # Errors
/// The store does not answer.
pub fn of_film_at(path: &Path, overwrite: bool) -> Result<Option<Engine>> {
    if overwrite {
        return Ok(None);
    }
    match FilmStore::open(path, true) {
        Ok(store) => Ok(store.engine().and_then(|name| name.parse().ok())),
        // What is wrong with it is reported where the film is opened.
        Err(FilmError::NotFilm { .. } | FilmError::Damaged { .. } | FilmError::Spec { .. }) => Ok(None),
        Err(e) => Err(e.into()),
    }
}

/// The engine that a plan's workers use: as asked, else that of the film, else what `lenscube run` would take here.
///
/// # Errors
/// A GPU engine without a name, where there is no GPU to ask.
pub fn planned(args: &RunArgs) -> Result<Engine> {
    let film = of_film_at(&args.film, args.overwrite)?.filter(|engine| engine.fits(&args.device));
    match args.engine.named().or(film) {
        Some(engine) => {
            agree(engine, &args.device)?;
            Ok(engine)
        }
        None => Choice::new(&args.device, None, None).map(|choice| choice.engine).map_err(|e| {
            usage(format!("{e}; to plan for other machines name their engine, e.g. `--engine cuda-sm_90`"))
        }),
    }
}

/// Fails if `--engine` and `--device` contradict each other.
pub fn agree(engine: Engine, device: &Device) -> Result<()> {
    match engine.fits(device) {
        true => Ok(()),
        false => Err(usage(format!(
            "--engine {engine} and --device {device} contradict each other; leave one of them out"
        ))),
    }
}

/// Fails if `--engine` names another engine than the film's, whatever is left to do.
pub fn check_named(store: &FilmStore, args: &RunArgs) -> Result<()> {
    match args.engine.named() {
        Some(engine) => differs(store, engine, args.mixed_engines).map(|_| ()),
        None => Ok(()),
    }
}

/// Fails if the film of a plan that is made is another engine's, which `mixed` allows.
///
/// # Errors
/// Exit code 3.
pub fn check_planned(store: &FilmStore, own: Engine, mixed: bool) -> Result<()> {
    differs(store, own, mixed).map(|_| ())
}

/// Fails unless `own` may compute shards of the film; marks the film if that makes it one of several engines.
///
/// # Errors
/// Another engine's film without `--mixed-engines` (exit code 3); the store.
pub fn check(store: &FilmStore, own: Engine, args: &RunArgs) -> Result<()> {
    if differs(store, own, args.mixed_engines)? {
        store.mark_engine(&own.to_string())?;
        say(format!(
            "note: {} was begun with engine {}; this run computes with {own} (--mixed-engines)",
            store.path().display(),
            store.engine().unwrap_or("unknown")
        ));
    }
    Ok(())
}

/// Whether the film is another engine's, which `mixed` allows.
fn differs(store: &FilmStore, own: Engine, mixed: bool) -> Result<bool> {
    let theirs = store.engine();
    if theirs == Some(own.to_string().as_str()) {
        return Ok(false);
    }
    if mixed {
        return Ok(true);
    }
    let begun = match theirs {
        Some(theirs) => format!("was begun with engine {theirs}"),
        None => "does not say which engine it was begun with".into(),
    };
    Err(other_job(format!(
        "{} {begun}, and this run would go on with {own}, whose values differ by up to 2e-6 of the peak; use that engine, go on \
         with --mixed-engines, or start it anew with --overwrite",
        store.path().display()
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_parse_back_to_the_engine() {
        let gpus = [(8, 0), (9, 0), (12, 1)].map(Engine::Cuda);
        for engine in Isa::ALL.map(Engine::Cpu).into_iter().chain(gpus) {
            assert_eq!(engine.to_string().parse(), Ok(engine));
        }
        assert_eq!(Engine::Cuda((12, 0)).to_string(), "cuda-sm_120");
        for text in ["", "cuda", "cuda-sm_", "cuda-sm_9", "cuda-sm_9.0", "cuda-sm_+90", "AVX2", "sse", "auto"]
        {
            assert!(text.parse::<Engine>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_device_allows_its_own_engines() {
        let (cpu, gpu) = (Engine::Cpu(Isa::Portable), Engine::Cuda((8, 0)));
        for (device, of_cpu, of_gpu) in
            [(Device::Auto, true, true), (Device::Cpu, true, false), (Device::Cuda(vec![0]), false, true)]
        {
            assert_eq!((cpu.fits(&device), gpu.fits(&device)), (of_cpu, of_gpu), "{device}");
            assert_eq!((agree(cpu, &device).is_ok(), agree(gpu, &device).is_ok()), (of_cpu, of_gpu));
        }
    }
}
