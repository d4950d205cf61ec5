//! The GPUs of this machine, and one of them opened: its context, its memory, the program's kernels on it.

use super::driver::{self, DriverError};
use super::error::{CudaError, NO_DEVICE, OLDEST_CAPABILITY, OUT_OF_MEMORY, Version};
use super::handle::{CudaContext, CudaStream};
use super::launch::{CudaFunction, CudaModule, DeviceRepr};
use super::slice::{CudaSlice, PinnedHostSlice};
use std::collections::HashMap;
use std::ffi::{CStr, c_int};
use std::sync::{Arc, Mutex};

/// What is known of a GPU without opening it.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceInfo {
    /// As the driver counts them, from 0.
    pub index: usize,
    /// The driver's name for it.
    pub name: String,
    /// E.g. (9, 0).
    pub compute_capability: Version,
    /// All its memory.
    pub memory_bytes: u64,
    /// Its multiprocessors.
    pub multiprocessors: u32,
    /// Their highest clock.
    pub clock_mhz: u32,
    /// What its memory could move at most.
    pub memory_gb_per_s: f64,
    /// Shared memory that a thread block can have.
    pub shared_bytes: usize,
    /// The CUDA version that the driver supports.
    pub driver_version: Version,
}

/// The GPUs that this process may use.
///
/// # Errors
/// No driver, one too old, one that refuses, no GPU.
pub fn devices() -> Result<Vec<DeviceInfo>, CudaError> {
    let (count, driver) = start()?;
    (0..count).map(|index| DeviceInfo::read(index, driver)).collect()
}

/// Starts the driver: how many GPUs there are, and its version.
fn start() -> Result<(usize, Version), CudaError> {
    let version = driver::version()?;
    let refused = |e: DriverError| match e.0 {
        NO_DEVICE => CudaError::NoDevice,
        _ => CudaError::Start { code: e.to_string() },
    };
    let mut count = 0;
    // SAFETY: the first call of all but the version; the second writes one number.
    unsafe { driver::init(0).and_then(|()| driver::device_get_count(&mut count)) }.map_err(refused)?;
    match usize::try_from(count) {
        Ok(count) if count > 0 => Ok((count, (version / 1000, version % 1000 / 10))),
        _ => Err(CudaError::NoDevice),
    }
}

/// Numbers of `CUdevice_attribute`.
mod attribute {
    pub(super) const CLOCK_RATE: i32 = 13;
    pub(super) const MULTIPROCESSOR_COUNT: i32 = 16;
    pub(super) const MEMORY_CLOCK_RATE: i32 = 36;
    pub(super) const GLOBAL_MEMORY_BUS_WIDTH: i32 = 37;
    pub(super) const COMPUTE_CAPABILITY_MAJOR: i32 = 75;
    pub(super) const COMPUTE_CAPABILITY_MINOR: i32 = 76;
    pub(super) const MAX_SHARED_MEMORY_PER_BLOCK_OPTIN: i32 = 97;
}

impl DeviceInfo {
    fn read(index: usize, driver_version: Version) -> Result<Self, CudaError> {
        let read = || -> Result<Self, DriverError> {
            let (mut device, mut memory, mut name) = (0, 0, [0; 256]);
            // SAFETY: `device` is the driver's, and each writes one value, or the name no longer than its buffer.
            unsafe {
                driver::device_get(&mut device, index as c_int)?;
                driver::device_total_mem(&mut memory, device)?;
                driver::device_get_name(name.as_mut_ptr(), name.len() as c_int, device)?;
            }
            // SAFETY: the driver ends it with 0; the last byte was 0 before.
            let name = unsafe { CStr::from_ptr(name.as_ptr()) };
            let attribute = |attribute| {
                let mut value = 0;
                // SAFETY: `device` is the driver's; writes one number.
                unsafe { driver::device_get_attribute(&mut value, attribute, device) }.map(|()| value)
            };
            // Two transfers a clock.
            let bus = f64::from(attribute(attribute::GLOBAL_MEMORY_BUS_WIDTH)?) / 8.0;
            let khz = f64::from(attribute(attribute::MEMORY_CLOCK_RATE)?);
            Ok(Self {
                index,
                name: name.to_string_lossy().into_owned(),
                compute_capability: (
                    attribute(attribute::COMPUTE_CAPABILITY_MAJOR)?,
                    attribute(attribute::COMPUTE_CAPABILITY_MINOR)?,
                ),
                memory_bytes: memory as u64,
                multiprocessors: attribute(attribute::MULTIPROCESSOR_COUNT)? as u32,
                clock_mhz: attribute(attribute::CLOCK_RATE)? as u32 / 1000,
                memory_gb_per_s: 2.0 * khz * bus / 1e6,
                shared_bytes: attribute(attribute::MAX_SHARED_MEMORY_PER_BLOCK_OPTIN)? as usize,
                driver_version,
            })
        };
        read().map_err(CudaError::on(index, "asking what it is"))
    }
}

/// A GPU in use. Several may be opened on one; they share its memory and nothing else.
#[derive(Debug)]
pub struct Device {
    /// What it is.
    pub info: DeviceInfo,
    /// Its context: streams, events, memory.
    pub context: Arc<CudaContext>,
    /// By the PTX's address.
    modules: Mutex<HashMap<usize, Arc<CudaModule>>>,
}

impl Device {
    /// Opens the GPU `index`.
    ///
    /// # Errors
    /// No such GPU, one that the kernels do not run on, one that the driver refuses.
    pub fn open(index: usize) -> Result<Arc<Self>, CudaError> {
        let (count, driver) = start()?;
        if index >= count {
            return Err(CudaError::NoSuchDevice { index, count });
        }
        let info = DeviceInfo::read(index, driver)?;
        if info.compute_capability < OLDEST_CAPABILITY {
            return Err(CudaError::DeviceTooOld { index, name: info.name, found: info.compute_capability });
        }
        let failed = |e| CudaError::new(index, "opening it", e);
        let context = CudaContext::new(index).map_err(failed)?;
        Ok(Arc::new(Self { info, context, modules: Mutex::default() }))
    }

    /// Which GPU it is.
    pub fn index(&self) -> usize {
        self.info.index
    }

    /// For `map_err`: what an error of the driver means while `doing`.
    pub fn failed(&self, doing: &str) -> impl FnOnce(DriverError) -> CudaError {
        CudaError::on(self.index(), doing)
    }

    /// Waits for all that this context has launched, while `doing`.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn synchronize(&self, doing: &str) -> Result<(), CudaError> {
        self.context.synchronize().map_err(self.failed(doing))
    }

    /// (free, all) bytes of its memory.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn memory(&self) -> Result<(u64, u64), CudaError> {
        let (free, total) = self.context.mem_get_info().map_err(self.failed("asking for its memory"))?;
        Ok((free as u64, total as u64))
    }

    /// A kernel of `ptx`, which is assembled when first asked for.
    ///
    /// # Errors
    /// What the driver reports.
    pub fn kernel(&self, ptx: &'static str, name: &str) -> Result<CudaFunction, CudaError> {
        let mut modules = self.modules.lock().expect("nothing panics here");
        let module = match modules.get(&ptx.as_ptr().addr()) {
            Some(module) => module,
            None => {
                let loaded = self.context.load_module(ptx);
                let loaded = loaded.map_err(self.failed("assembling the kernels"))?;
                modules.entry(ptx.as_ptr().addr()).or_insert(loaded)
            }
        };
        module.function(name).map_err(self.failed(&format!("looking for the kernel {name}")))
    }

    /// `len` values of device memory for `what`, unset, in the order of `stream`.
    ///
    /// # Errors
    /// Out of memory, and what else the driver reports.
    pub fn allocate<T: DeviceRepr>(
        &self,
        stream: &Arc<CudaStream>,
        len: usize,
        what: &str,
    ) -> Result<CudaSlice<T>, CudaError> {
        stream.alloc(len).map_err(|e| self.refused(e, len * size_of::<T>(), what))
    }

    /// `len` values of page-locked host memory, zeros.
    ///
    /// # Errors
    /// Out of host memory, and what else the driver reports.
    pub fn allocate_pinned(&self, len: usize) -> Result<PinnedHostSlice<f32>, CudaError> {
        self.context.alloc_pinned(len).map_err(|e| match e.0 {
            OUT_OF_MEMORY => CudaError::OutOfHostMemory {
                device: self.index(),
                asked_bytes: (len * size_of::<f32>()) as u64,
            },
            _ => CudaError::new(self.index(), "allocating page-locked host memory", e),
        })
    }

    /// What an error means that came when `bytes` of its memory for `what` were asked for.
    fn refused(&self, error: DriverError, bytes: usize, what: &str) -> CudaError {
        match error.0 {
            OUT_OF_MEMORY => {
                let (free_bytes, total_bytes) = self.memory().unwrap_or((0, self.info.memory_bytes));
                let (device, what) = (self.index(), what.to_owned());
                CudaError::OutOfMemory { device, what, asked_bytes: bytes as u64, free_bytes, total_bytes }
            }
            _ => CudaError::new(self.index(), &format!("allocating {what}"), error),
        }
    }
}
