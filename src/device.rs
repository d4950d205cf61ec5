//! `--device` and `--engine` resolved: the GPUs that compute, opened; or the processor, and its instructions.
//!
//! A device or an engine that is named is used, or is an error. Otherwise the film's own engine is used where this machine has
//! it, else what is fastest; the log reports which and why.

use crate::args::Device;
use crate::engine::{self, Engine};
use crate::failure::usage;
use anyhow::Result;
use pipeline::cuda::error::Version;
use pipeline::cuda::memory::{BandNeeds, DeviceQueue};
use pipeline::cuda::{self, CudaError};
use pipeline::simd::{Isa, Simd};
use std::sync::Arc;

/// Share of a GPU's free memory that is used: the rest is for what the driver takes as it goes.
const SHARE: f64 = 0.9;

/// What computes.
pub struct Choice {
    /// GPUs, a queue each, all of one compute capability; none: the processor.
    pub devices: Vec<Arc<cuda::Device>>,
    /// Its name in the film.
    pub engine: Engine,
    /// What the processor's part is computed with: beside GPUs that is the rotation of kernels, whose bits must not depend on
    /// the host.
    pub simd: Simd,
    /// Whether no other engine will do: it was named, or is that of the film.
    fixed: bool,
    /// For the log, under `--device auto`.
    pub why: String,
    /// For the log: what this machine has and the run does not use.
    pub notes: Vec<String>,
}

/// Why GPUs are not opened.
#[derive(Debug, thiserror::Error)]
enum NotOpened {
    #[error(transparent)]
    Cuda(#[from] CudaError),
    /// None of the engine that is wanted, or several engines.
    #[error("{0}")]
    Kind(String),
}

/// GPUs, and what is to be logged of those left out.
type Opened = (Vec<Arc<cuda::Device>>, Vec<String>);

impl Choice {
    /// Opens what `asked` and `--engine` (`named`) name; `film` is the engine of the film that goes on.
    ///
    /// # Errors
    /// A device or an engine that was asked for cannot be used here.
    pub fn new(asked: &Device, named: Option<Engine>, film: Option<Engine>) -> Result<Self> {
        if let Some(engine) = named {
            engine::agree(engine, asked)?;
        }
        let film = film.filter(|engine| named.is_none() && engine.fits(asked));
        match named.or(film) {
            Some(Engine::Cpu(isa)) => match Simd::of(isa) {
                Ok(simd) => return Ok(Self::with_isa(simd, asked, film.is_some())),
                Err(e) if named.is_some() => return Err(usage(format!("--engine {}: {e}", isa.name()))),
                Err(_) => (),
            },
            Some(Engine::Cuda(kind)) => match (open(asked, Some(kind)), named) {
                (Ok(opened), _) => return Ok(Self { fixed: true, ..Self::gpus(opened) }),
                (Err(e), Some(engine)) => return Err(refused(&format!("--engine {engine}"), e)),
                (Err(e), None) if matches!(asked, Device::Cuda(_)) && !matches!(e, NotOpened::Kind(_)) => {
                    return Err(refused(&format!("--device {asked}"), e));
                }
                (Err(_), None) => (),
            },
            None => (),
        }
        match asked {
            Device::Cpu => Ok(Self::cpu("as asked")),
            Device::Cuda(_) => {
                open(asked, None).map(Self::gpus).map_err(|e| refused(&format!("--device {asked}"), e))
            }
            Device::Auto => Ok(open(asked, None).map_or_else(|e| Self::cpu(&e.to_string()), Self::gpus)),
        }
    }

    /// The processor with its fastest instructions.
    pub fn cpu(why: &str) -> Self {
        let simd = Simd::detect();
        let why = format!("device: cpu ({why})");
        Self { devices: Vec::new(), engine: Engine::cpu(simd), simd, fixed: false, why, notes: Vec::new() }
    }

    /// The processor with the instructions that were named, or that the film was begun with (`of_film`).
    fn with_isa(simd: Simd, asked: &Device, of_film: bool) -> Self {
        let (engine, fastest) = (Engine::cpu(simd), Simd::detect());
        let reason = if of_film { "the film was begun with it" } else { "as asked" };
        let mut notes = Vec::new();
        if of_film && simd != fastest {
            let has = fastest.isa().name();
            notes.push(format!("engine: {engine}, {reason}; this processor has {has} as well"));
        }
        let why = match of_film && *asked == Device::Auto && cuda::devices().is_ok() {
            true => format!("device: cpu (engine {engine}: {reason}; the GPUs are not used)"),
            false => format!("device: cpu (engine {engine}: {reason})"),
        };
        Self { devices: Vec::new(), engine, simd, fixed: true, why, notes }
    }

    fn gpus((devices, notes): Opened) -> Self {
        let name = |d: &Arc<cuda::Device>| format!("GPU {} ({})", d.index(), d.info.name);
        let names: Vec<String> = devices.iter().map(name).collect();
        let engine = devices.first().map_or(Engine::Cpu(Isa::Portable), |d| kind(&d.info));
        let why = format!("device: {}", names.join(", "));
        Self { devices, engine, simd: Simd::PORTABLE, fixed: false, why, notes }
    }

    /// Whether the processor may compute where the GPUs' memory does not suffice.
    pub fn may_fall_back(&self, asked: &Device) -> bool {
        *asked == Device::Auto && !self.fixed
    }

    /// The queues, each with its part of its GPU's memory and `host_bytes` of page-locked memory, if all `bands` fit.
    ///
    /// # Errors
    /// A GPU is too small, or does not answer.
    pub fn queues(&self, asked: &Device, bands: &[BandNeeds], host_bytes: usize) -> Result<Vec<DeviceQueue>> {
        plan(&self.devices, bands, host_bytes)
            .map_err(|error| refused(&format!("--device {asked}"), error.into()))
    }
}

/// The engine of a GPU.
fn kind(info: &cuda::DeviceInfo) -> Engine {
    Engine::Cuda(info.compute_capability)
}

/// The GPUs of `asked`, all where it names none: those of compute capability `wanted`, else of the first one's.
fn open(asked: &Device, wanted: Option<Version>) -> Result<Opened, NotOpened> {
    let all = cuda::devices()?;
    let listed: &[usize] = match asked {
        Device::Cuda(indices) => indices,
        Device::Auto | Device::Cpu => &[],
    };
    let every: Vec<usize> = all.iter().map(|d| d.index).collect();
    let indices = if listed.is_empty() { &every } else { listed };
    let find = |index: usize| all.get(index).ok_or(CudaError::NoSuchDevice { index, count: all.len() });
    let infos = indices.iter().map(|&index| find(index)).collect::<Result<Vec<_>, _>>()?;
    let first = infos.first().ok_or(CudaError::NoDevice)?.compute_capability;
    let engine = Engine::Cuda(wanted.unwrap_or(first));
    let (own, other): (Vec<_>, Vec<_>) = infos.into_iter().partition(|info| kind(info) == engine);
    let named = |d: &&cuda::DeviceInfo| format!("GPU {} ({}, {})", d.index, d.name, kind(d));
    let others = other.iter().map(named).collect::<Vec<_>>().join(", ");
    if own.is_empty() || !(listed.is_empty() || other.is_empty()) {
        return Err(NotOpened::Kind(format!(
            "a run has GPUs of one engine, here {engine}; there is {others}"
        )));
    }
    let notes = match other.is_empty() {
        true => Vec::new(),
        false => vec![format!("not used, a run has GPUs of one engine, here {engine}: {others}")],
    };
    let devices = own.iter().map(|info| cuda::Device::open(info.index)).collect::<Result<_, _>>()?;
    Ok((devices, notes))
}

fn plan(
    devices: &[Arc<cuda::Device>],
    needs: &[BandNeeds],
    host_bytes: usize,
) -> Result<Vec<DeviceQueue>, CudaError> {
    let mut queues = Vec::new();
    for device in devices {
        let sharing = devices.iter().filter(|d| d.index() == device.index()).count();
        let (free, _) = device.memory()?;
        let device_bytes = (free as f64 * SHARE) as usize / sharing;
        let queue = DeviceQueue { device: Arc::clone(device), device_bytes, host_bytes };
        needs.iter().try_for_each(|needs| queue.plan(needs, 0).map(|_| ()))?;
        queues.push(queue);
    }
    Ok(queues)
}

/// What `flag` asks for cannot be: by the command line where that could have known, else by what the machine is like now.
fn refused(flag: &str, error: NotOpened) -> anyhow::Error {
    match error {
        NotOpened::Cuda(
            error @ (CudaError::NoDriver
            | CudaError::DriverTooOld { .. }
            | CudaError::NoDevice
            | CudaError::NoSuchDevice { .. }
            | CudaError::DeviceTooOld { .. }),
        ) => usage(format!("{flag}: {error}; `--device cpu` needs none")),
        NotOpened::Cuda(error) => anyhow::Error::from(error).context(flag.to_owned()),
        NotOpened::Kind(words) => {
            usage(format!("{flag}: {words}; name GPUs of one kind, e.g. `--device cuda:0`"))
        }
    }
}
