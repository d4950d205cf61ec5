//! The GPUs of this machine, and one of them opened: its context, its memory, the program's kernels on it.

use super::error::{CudaError, OLDEST_CAPABILITY, OLDEST_DRIVER, Version, code};
use cudarc::driver::sys::{self, CUdevice_attribute as Attribute, CUresult};
use cudarc::driver::{
    CudaContext, CudaFunction, CudaModule, CudaSlice, CudaStream, DeviceRepr, DriverError, result,
};
use cudarc::nvrtc::Ptx;
use std::collections::HashMap;
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
    // SAFETY: loads libcuda and unloads it; asked before anything else, as the other calls panic without the library.
    if !unsafe { sys::is_culib_present() } {
        return Err(CudaError::NoDriver);
    }
    let mut version = 0;
    // SAFETY: needs no initialised driver and writes one integer.
    let asked = unsafe { sys::cuDriverGetVersion(&mut version) }.result();
    asked.map_err(|e| CudaError::Start { code: code(e) })?;
    let driver = (version / 1000, version % 1000 / 10);
    if driver < OLDEST_DRIVER {
        return Err(CudaError::DriverTooOld { found: driver });
    }
    let refused = |e: DriverError| match e.0 {
        CUresult::CUDA_ERROR_NO_DEVICE => CudaError::NoDevice,
        _ => CudaError::Start { code: code(e) },
    };
    result::init().map_err(refused)?;
    match result::device::get_count().map_err(refused)? {
        count if count > 0 => Ok((count as usize, driver)),
        _ => Err(CudaError::NoDevice),
    }
}

impl DeviceInfo {
    fn read(index: usize, driver_version: Version) -> Result<Self, CudaError> {
        let read = || -> Result<Self, DriverError> {
            let device = result::device::get(index as i32)?;
            // SAFETY: `device` is the driver's.
            let attribute = |a| unsafe { result::device::get_attribute(device, a) };
            // SAFETY: likewise.
            let memory = unsafe { result::device::total_mem(device)? };
            // Two transfers a clock.
            let bus = f64::from(attribute(Attribute::CU_DEVICE_ATTRIBUTE_GLOBAL_MEMORY_BUS_WIDTH)?) / 8.0;
            let khz = f64::from(attribute(Attribute::CU_DEVICE_ATTRIBUTE_MEMORY_CLOCK_RATE)?);
            Ok(Self {
                index,
                name: result::device::get_name(device)?,
                compute_capability: (
                    attribute(Attribute::CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MAJOR)?,
                    attribute(Attribute::CU_DEVICE_ATTRIBUTE_COMPUTE_CAPABILITY_MINOR)?,
                ),
                memory_bytes: memory as u64,
                multiprocessors: attribute(Attribute::CU_DEVICE_ATTRIBUTE_MULTIPROCESSOR_COUNT)? as u32,
                clock_mhz: attribute(Attribute::CU_DEVICE_ATTRIBUTE_CLOCK_RATE)? as u32 / 1000,
                memory_gb_per_s: 2.0 * khz * bus / 1e6,
                shared_bytes: attribute(Attribute::CU_DEVICE_ATTRIBUTE_MAX_SHARED_MEMORY_PER_BLOCK_OPTIN)?
                    as usize,
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
        // A thread that waits leaves its core to others.
        context.set_blocking_synchronize().map_err(failed)?;
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
                let loaded = self.context.load_module(Ptx::from_src(ptx));
                let loaded = loaded.map_err(self.failed("assembling the kernels"))?;
                modules.entry(ptx.as_ptr().addr()).or_insert(loaded)
            }
        };
        module.load_function(name).map_err(self.failed(&format!("looking for the kernel {name}")))
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
        // SAFETY: what T allows is up to the kernels; the host reads no unset value but as plain numbers.
        unsafe { stream.alloc(len) }.map_err(|e| self.refused(e, len * size_of::<T>(), what))
    }

    /// What an error means that came when `bytes` of memory for `what` were asked for.
    pub fn refused(&self, error: DriverError, bytes: usize, what: &str) -> CudaError {
        match error.0 {
            CUresult::CUDA_ERROR_OUT_OF_MEMORY => {
                let (free_bytes, total_bytes) = self.memory().unwrap_or((0, self.info.memory_bytes));
                let (device, what) = (self.index(), what.to_owned());
                CudaError::OutOfMemory { device, what, asked_bytes: bytes as u64, free_bytes, total_bytes }
            }
            _ => CudaError::new(self.index(), &format!("allocating {what}"), error),
        }
    }
}
