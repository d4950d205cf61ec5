//! Selection of the device and the engine: opens the GPUs, or chooses the CPU's instruction set.
//!
//! `--device cuda` and `--engine NAME` are used or are an error. Otherwise the film's engine is used where this machine has it, else
//! the fastest device; the log reports the choice and its reason.

pub mod driver;
pub mod verdict;

use crate::args::Device;
use crate::args::engine::Engine;
use crate::failure::usage;
use anyhow::Result;
use pipeline::cuda::error::Version;
use pipeline::cuda::memory::{BandNeeds, DeviceQueue, Halvings};
use pipeline::cuda::{self, CudaError};
use pipeline::simd::{Isa, Simd};
use std::sync::Arc;
use verdict::{Verdict, verdict};

/// Share of a GPU's free memory that is used; the driver allocates from the rest during the run.
const USED_SHARE: f64 = 0.9;

/// The selected device and engine.
pub struct DeviceSelection {
    /// GPUs of one compute capability, one queue each; empty: the CPU computes.
    pub devices: Vec<Arc<cuda::Device>>,
    /// The selected engine.
    pub engine: Engine,
    /// Instruction set of the CPU's part. Beside GPUs it rotates kernels and is the portable one, so that bits do not depend on the
    /// host.
    pub simd: Simd,
    /// No other engine is allowed: it was given by name, or is that of the film.
    fixed: bool,
    /// Log line under `--device auto`: the choice and its reason.
    pub reason: String,
    /// Whether the machine has no GPU, or no driver for it.
    pub no_gpu: bool,
    /// Log lines: what this machine has and the run does not use.
    pub notes: Vec<String>,
}

/// Why GPUs were not opened.
#[derive(Debug, thiserror::Error)]
enum OpenError {
    #[error(transparent)]
    Cuda(#[from] CudaError),
    /// No GPU of the required engine, or GPUs of several engines.
    #[error("{0}")]
    Engine(String),
}

/// Opened GPUs, and notes on those not used.
type Opened = (Vec<Arc<cuda::Device>>, Vec<String>);

impl DeviceSelection {
    /// Opens `requested` (`--device`) with `explicit` (`--engine`); `film` is the engine of the film to be resumed.
    ///
    /// # Errors
    /// The requested device or engine is not available here.
    pub fn new(requested: &Device, explicit: Option<Engine>, film: Option<Engine>) -> Result<Self> {
        if let Some(engine) = explicit {
            check_agreement(engine, requested)?;
        }
        let film = film.filter(|engine| explicit.is_none() && requested.allows(*engine));
        match explicit.or(film) {
            Some(Engine::Cpu(isa)) => match Simd::require(isa) {
                Ok(simd) => return Ok(Self::with_isa(simd, requested, film.is_some())),
                Err(e) if explicit.is_some() => return Err(usage(format!("--engine {}: {e}", isa.name()))),
                Err(_) => (),
            },
            Some(Engine::Cuda(capability)) => match (open(requested, Some(capability)), explicit) {
                (Ok(opened), _) => return Ok(Self { fixed: true, ..Self::gpus(opened) }),
                (Err(e), Some(engine)) => return Err(unavailable(&format!("--engine {engine}"), e)),
                (Err(e), None)
                    if matches!(requested, Device::Cuda(_)) && !matches!(e, OpenError::Engine(_)) =>
                {
                    return Err(unavailable(&format!("--device {requested}"), e));
                }
                (Err(_), None) => (),
            },
            None => (),
        }
        match requested {
            Device::Cpu => Ok(Self::cpu("as requested")),
            Device::Cuda(_) => open(requested, None)
                .map(Self::gpus)
                .map_err(|e| unavailable(&format!("--device {requested}"), e)),
            Device::Auto => Ok(open(requested, None).map_or_else(
                |e| {
                    let no_gpu = matches!(
                        e,
                        OpenError::Cuda(CudaError::NotBuilt | CudaError::NoDriver | CudaError::NoDevice)
                    );
                    Self { no_gpu, ..Self::cpu(&e.to_string()) }
                },
                Self::gpus,
            )),
        }
    }

    /// The CPU with its fastest instruction set.
    pub fn cpu(reason: &str) -> Self {
        let simd = Simd::detect();
        let reason = format!("device: cpu ({reason})");
        let (devices, notes, engine) = (Vec::new(), Vec::new(), Engine::cpu(simd));
        Self { devices, engine, simd, fixed: false, reason, no_gpu: false, notes }
    }

    /// The CPU with the instruction set given by name, or that of the film (`of_film`).
    fn with_isa(simd: Simd, requested: &Device, of_film: bool) -> Self {
        let (engine, fastest) = (Engine::cpu(simd), Simd::detect());
        let why = if of_film { "the film was created with it" } else { "as requested" };
        let mut notes = Vec::new();
        if of_film && simd != fastest {
            let has = fastest.isa().name();
            notes.push(format!("engine: {engine}, {why}; this processor has {has} as well"));
        }
        let reason = match of_film && *requested == Device::Auto && cuda::devices().is_ok() {
            true => format!("device: cpu (engine {engine}: {why}; the GPUs are not used)"),
            false => format!("device: cpu (engine {engine}: {why})"),
        };
        Self { devices: Vec::new(), engine, simd, fixed: true, reason, no_gpu: false, notes }
    }

    fn gpus((devices, notes): Opened) -> Self {
        let name = |d: &Arc<cuda::Device>| format!("GPU {} ({})", d.index(), d.info.name);
        let names: Vec<String> = devices.iter().map(name).collect();
        let engine = devices.first().map_or(Engine::Cpu(Isa::Portable), |d| engine_of(&d.info));
        let reason = format!("device: {}", names.join(", "));
        Self { devices, engine, simd: Simd::PORTABLE, fixed: false, reason, no_gpu: false, notes }
    }

    /// Whether the CPU may compute if the memory for GPUs does not suffice.
    pub fn may_fall_back(&self, requested: &Device) -> bool {
        *requested == Device::Auto && !self.fixed
    }

    /// The queues, each with its share of its GPU's memory and `host_bytes` of page-locked memory.
    ///
    /// # Errors
    /// A GPU is too small for a band, or fails.
    pub fn queues(
        &self,
        requested: &Device,
        bands: &[BandNeeds],
        host_bytes: usize,
    ) -> Result<Vec<DeviceQueue>> {
        plan_queues(&self.devices, bands, host_bytes)
            .map_err(|error| unavailable(&format!("--device {requested}"), error.into()))
    }
}

/// Fails if `--engine` and `--device` contradict each other.
pub fn check_agreement(engine: Engine, device: &Device) -> Result<()> {
    match device.allows(engine) {
        true => Ok(()),
        false => Err(usage(format!(
            "--engine {engine} and --device {device} contradict each other; leave one of them out"
        ))),
    }
}

/// The engine of a GPU.
fn engine_of(info: &cuda::DeviceInfo) -> Engine {
    Engine::Cuda(info.compute_capability)
}

/// The requested GPUs (all if none is listed) of compute capability `required`, else of that of the first one.
fn open(requested: &Device, required: Option<Version>) -> Result<Opened, OpenError> {
    let listed: &[usize] = match requested {
        Device::Cuda(indices) => indices,
        Device::Auto | Device::Cpu => &[],
    };
    // Only the listed GPUs are read: another may be broken, or in use.
    let infos = if listed.is_empty() { cuda::devices()? } else { cuda::listed_devices(listed)? };
    let mut notes = Vec::new();
    let infos = if *requested == Device::Auto { without_failed(infos, &mut notes)? } else { infos };
    let first = infos.first().ok_or(CudaError::NoDevice)?.compute_capability;
    let engine = Engine::Cuda(required.unwrap_or(first));
    let (used, other): (Vec<_>, Vec<_>) = infos.into_iter().partition(|info| engine_of(info) == engine);
    let others = names(&other);
    if used.is_empty() || !(listed.is_empty() || other.is_empty()) {
        return Err(OpenError::Engine(format!(
            "all GPUs of a run must have the same compute capability, here {engine}; found {others}"
        )));
    }
    if !other.is_empty() {
        notes.push(format!(
            "not used: {others}; all GPUs of a run must have the same compute capability, here {engine}"
        ));
    }
    if *requested == Device::Auto {
        let unknown: Vec<_> = used.iter().filter(|info| verdict(info) == Verdict::Unknown).collect();
        if !unknown.is_empty() {
            notes.push(format!(
                "films of {} have not been compared with the CPU's on this machine: `lenscube device check` does so in seconds",
                names(unknown)
            ));
        }
    }
    let devices = used.iter().map(|info| cuda::Device::open(info.index)).collect::<Result<_, _>>()?;
    Ok((devices, notes))
}

/// Names of GPUs for messages.
fn names<'a>(infos: impl IntoIterator<Item = &'a cuda::DeviceInfo>) -> String {
    let name = |d: &cuda::DeviceInfo| format!("GPU {} ({}, {})", d.index, d.name, engine_of(d));
    infos.into_iter().map(name).collect::<Vec<_>>().join(", ")
}

/// The GPUs without those that `device check` has found wrong, with a note on these.
fn without_failed(
    infos: Vec<cuda::DeviceInfo>,
    notes: &mut Vec<String>,
) -> Result<Vec<cuda::DeviceInfo>, OpenError> {
    let (failed, others): (Vec<_>, Vec<_>) =
        infos.into_iter().partition(|info| verdict(info) == Verdict::Failed);
    let found = format!("`lenscube device check` has found other films than the CPU's on {}", names(&failed));
    if others.is_empty() {
        return Err(OpenError::Engine(found));
    }
    if !failed.is_empty() {
        notes.push(format!("not used: {found}"));
    }
    Ok(others)
}

fn plan_queues(
    devices: &[Arc<cuda::Device>],
    needs: &[BandNeeds],
    host_bytes: usize,
) -> Result<Vec<DeviceQueue>, CudaError> {
    let mut queues = Vec::new();
    for device in devices {
        let sharing = devices.iter().filter(|d| d.index() == device.index()).count();
        let (free, _) = device.memory()?;
        let device_bytes = (free as f64 * USED_SHARE) as usize / sharing;
        let needs = needs.iter().copied().fold(BandNeeds::default(), BandNeeds::max);
        let queue = DeviceQueue { device: Arc::clone(device), device_bytes, host_bytes, needs };
        queue.plan(&needs, Halvings::default())?;
        queues.push(queue);
    }
    Ok(queues)
}

/// The error of `flag`: a usage error if no such device exists, else the device's error.
fn unavailable(flag: &str, error: OpenError) -> anyhow::Error {
    match error {
        OpenError::Cuda(
            error @ (CudaError::NotBuilt
            | CudaError::NoDriver
            | CudaError::DriverTooOld { .. }
            | CudaError::NoDevice
            | CudaError::NoSuchDevice { .. }
            | CudaError::DeviceTooOld { .. }),
        ) => usage(format!("{flag}: {error}; `--device cpu` needs no GPU")),
        OpenError::Cuda(error) => anyhow::Error::from(error).context(flag.to_owned()),
        OpenError::Engine(reason) => {
            usage(format!("{flag}: {reason}; name GPUs of one kind, e.g. `--device cuda:0`"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn engine_of_another_device_kind_is_a_contradiction() {
        let (cpu, gpu) = (Engine::Cpu(Isa::Portable), Engine::Cuda((8, 0)));
        for (device, of_cpu, of_gpu) in
            [(Device::Auto, true, true), (Device::Cpu, true, false), (Device::Cuda(vec![0]), false, true)]
        {
            let agree = |engine| check_agreement(engine, &device).is_ok();
            assert_eq!((agree(cpu), agree(gpu)), (of_cpu, of_gpu), "{device}");
        }
    }
}
