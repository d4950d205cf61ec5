//! The GPUs of this machine; an open GPU with its context, memory and kernels.

use super::driver::{self, DriverError};
use super::error::{CudaError, NO_DEVICE, OLDEST_CAPABILITY, OUT_OF_MEMORY, Version};
use super::handle::{CudaContext, CudaStream};
use super::launch::{CudaFunction, CudaModule};
use super::ptx::Kernels;
use super::slice::{CudaSlice, DeviceRepr, PinnedHostSlice};
use std::collections::{BTreeMap, HashMap};
use std::ffi::{CStr, c_int};
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Properties of a GPU, read without opening it.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviceInfo {
    /// Index in the driver's order, from 0: the fastest GPU first, unless `CUDA_DEVICE_ORDER` is `PCI_BUS_ID`.
    pub index: usize,
    /// Name.
    pub name: String,
    /// UUID: unlike the index it is the same in any order of the GPUs; that of the instance where a GPU is divided (MIG).
    pub uuid: [u8; 16],
    /// Compute capability, e.g. (9, 0).
    pub compute_capability: Version,
    /// Total memory.
    pub memory_bytes: u64,
    /// Number of multiprocessors.
    pub multiprocessors: u32,
    /// Maximum clock of the multiprocessors.
    pub clock_mhz: u32,
    /// Peak memory bandwidth.
    pub memory_gb_per_s: f64,
    /// Maximum of shared memory of a thread block.
    pub shared_bytes: usize,
    /// CUDA version of the driver.
    pub driver_version: Version,
}

/// The GPUs that this process may use.
///
/// # Errors
/// No driver, a driver that is too old or fails, no GPU.
pub fn devices() -> Result<Vec<DeviceInfo>, CudaError> {
    let (count, driver) = start()?;
    (0..count).map(|index| DeviceInfo::read(index, driver)).collect()
}

/// The GPUs of these indices, which may repeat; no others are read.
///
/// # Errors
/// As [`devices`]; an index beyond the last GPU.
pub fn listed_devices(indices: &[usize]) -> Result<Vec<DeviceInfo>, CudaError> {
    let (count, driver) = start()?;
    let read = |&index: &usize| match index < count {
        true => DeviceInfo::read(index, driver),
        false => Err(CudaError::NoSuchDevice { index, count }),
    };
    indices.iter().map(read).collect()
}

/// Initialises the driver; the number of GPUs, and its version.
fn start() -> Result<(usize, Version), CudaError> {
    let version = driver::version().map_err(CudaError::load)?;
    let start_error = |e: DriverError| match e.0 {
        NO_DEVICE => CudaError::NoDevice,
        _ => CudaError::Start { code: e.to_string() },
    };
    let mut count = 0;
    // SAFETY: initialisation before all other calls; the second writes one number.
    unsafe { driver::init(0).and_then(|()| driver::device_get_count(&mut count)) }.map_err(start_error)?;
    match usize::try_from(count) {
        Ok(count) if count > 0 => Ok((count, version)),
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
            let (mut device, mut memory, mut name, mut uuid) = (0, 0, [0; 256], [0; 16]);
            // SAFETY: `device` comes from the driver; each writes one value, 16 bytes, or a name no longer than its buffer.
            unsafe {
                driver::device_get(&mut device, index as c_int)?;
                driver::device_total_mem(&mut memory, device)?;
                driver::device_get_name(name.as_mut_ptr(), name.len() as c_int, device)?;
                driver::device_get_uuid(uuid.as_mut_ptr(), device)?;
            }
            // SAFETY: NUL-terminated by the driver; the last byte was 0 before.
            let name = unsafe { CStr::from_ptr(name.as_ptr()) };
            let attribute = |attribute| {
                let mut value = 0;
                // SAFETY: `device` comes from the driver; writes one number.
                unsafe { driver::device_get_attribute(&mut value, attribute, device) }.map(|()| value)
            };
            // Two transfers a clock cycle.
            let bus = f64::from(attribute(attribute::GLOBAL_MEMORY_BUS_WIDTH)?) / 8.0;
            let khz = f64::from(attribute(attribute::MEMORY_CLOCK_RATE)?);
            Ok(Self {
                index,
                name: name.to_string_lossy().into_owned(),
                uuid,
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
        read().map_err(CudaError::during(index, "reading its properties"))
    }
}

/// How the kernels of a GPU came to it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KernelLoading {
    /// Cubins that were loaded.
    pub cubins: usize,
    /// PTX files that the driver assembled, because there is no cubin for the GPU, the driver refused it, or [`FORCE_ASSEMBLY`] is set.
    pub assembled: usize,
    /// Time of both, s; the driver keeps the result of assembly for later processes.
    pub seconds: f64,
}

/// What a thread of a kernel uses, as the driver reports it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ThreadResources {
    /// Registers.
    pub registers: i32,
    /// Bytes of local memory: stack and spilled registers.
    pub local_bytes: i32,
}

/// `CU_FUNC_ATTRIBUTE_NUM_REGS`.
const REGISTERS: i32 = 4;
/// `CU_FUNC_ATTRIBUTE_LOCAL_SIZE_BYTES`.
const LOCAL_BYTES: i32 = 3;

/// Environment variable of the driver: 1 has kernels assembled from PTX although there are cubins.
pub const FORCE_ASSEMBLY: &str = "CUDA_FORCE_PTX_JIT";

/// An open GPU. It may be opened several times; the instances share only its memory.
#[derive(Debug)]
pub struct Device {
    /// Properties.
    pub info: DeviceInfo,
    /// Context: streams, events, memory.
    pub context: Arc<CudaContext>,
    /// Loaded modules by the address of their PTX.
    modules: Mutex<HashMap<usize, Arc<CudaModule>>>,
    loading: Mutex<KernelLoading>,
    /// By kernel.
    resources: Mutex<BTreeMap<String, ThreadResources>>,
}

impl Device {
    /// Opens the GPU `index`.
    ///
    /// # Errors
    /// No such GPU, a compute capability that is too low, an error of the driver.
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
        let (modules, loading, resources) = Default::default();
        Ok(Arc::new(Self { info, context, modules, loading, resources }))
    }

    /// Index in the driver's order.
    pub fn index(&self) -> usize {
        self.info.index
    }

    /// Classifies an error of the driver that occurred while `doing`, for `map_err`.
    pub fn failed(&self, doing: &str) -> impl FnOnce(DriverError) -> CudaError {
        CudaError::during(self.index(), doing)
    }

    /// Waits until all enqueued work of the context is done; `doing` is for the error.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn synchronize(&self, doing: &str) -> Result<(), CudaError> {
        self.context.synchronize().map_err(self.failed(doing))
    }

    /// (free, total) bytes of device memory.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn memory(&self) -> Result<(u64, u64), CudaError> {
        let (free, total) = self.context.mem_get_info().map_err(self.failed("reading its free memory"))?;
        Ok((free as u64, total as u64))
    }

    /// The kernel `name` of `kernels`, which are loaded or assembled at first use.
    ///
    /// # Errors
    /// An error of the driver.
    pub fn kernel(&self, kernels: &'static Kernels, name: &str) -> Result<CudaFunction, CudaError> {
        let mut modules = self.modules.lock().expect("no thread panics while it holds the lock");
        let module = match modules.get(&kernels.ptx.as_ptr().addr()) {
            Some(module) => module,
            None => {
                let loaded = self.load(kernels)?;
                modules.entry(kernels.ptx.as_ptr().addr()).or_insert(loaded)
            }
        };
        let load = || {
            let kernel = module.function(name)?;
            let (registers, local_bytes) = (kernel.attribute(REGISTERS)?, kernel.attribute(LOCAL_BYTES)?);
            Ok((kernel, ThreadResources { registers, local_bytes }))
        };
        let (kernel, used) = load().map_err(self.failed(&format!("loading the kernel {name}")))?;
        self.resources
            .lock()
            .expect("no thread panics while it holds the lock")
            .insert(name.to_owned(), used);
        Ok(kernel)
    }

    /// What a thread of each kernel uses that was loaded so far.
    pub fn thread_resources(&self) -> BTreeMap<String, ThreadResources> {
        self.resources.lock().expect("no thread panics while it holds the lock").clone()
    }

    fn load(&self, kernels: &'static Kernels) -> Result<Arc<CudaModule>, CudaError> {
        let start = Instant::now();
        let forced = std::env::var_os(FORCE_ASSEMBLY).is_some_and(|v| v == "1");
        let cubin = kernels.cubin(self.info.compute_capability).filter(|_| !forced);
        let cubin = cubin.and_then(|cubin| CudaModule::load_cubin(&self.context, cubin).ok());
        let from_cubin = cubin.is_some();
        let loaded = cubin.map_or_else(|| CudaModule::assemble(&self.context, kernels.ptx), Ok);
        let mut loading = self.loading.lock().expect("no thread panics while it holds the lock");
        loading.seconds += start.elapsed().as_secs_f64();
        match from_cubin {
            true => loading.cubins += 1,
            false => loading.assembled += 1,
        }
        loaded.map_err(self.failed("assembling the kernels"))
    }

    /// How its kernels were loaded so far.
    pub fn kernel_loading(&self) -> KernelLoading {
        *self.loading.lock().expect("no thread panics while it holds the lock")
    }

    /// `len` uninitialised values of device memory for `what`, in the order of `stream`.
    ///
    /// # Errors
    /// Out of memory, or another error of the driver.
    pub fn allocate<T: DeviceRepr>(
        &self,
        stream: &Arc<CudaStream>,
        len: usize,
        what: &str,
    ) -> Result<CudaSlice<T>, CudaError> {
        stream.alloc(len).map_err(|e| self.allocation_error(e, len * size_of::<T>(), what))
    }

    /// `len` zeros in page-locked host memory.
    ///
    /// # Errors
    /// Out of host memory, or another error of the driver.
    pub fn allocate_pinned(&self, len: usize) -> Result<PinnedHostSlice<f32>, CudaError> {
        self.context.alloc_pinned(len).map_err(|e| match e.0 {
            OUT_OF_MEMORY => CudaError::OutOfHostMemory {
                device: self.index(),
                requested_bytes: (len * size_of::<f32>()) as u64,
            },
            _ => CudaError::new(self.index(), "allocating page-locked host memory", e),
        })
    }

    /// Classifies an error of the allocation of `bytes` for `what`.
    fn allocation_error(&self, error: DriverError, bytes: usize, what: &str) -> CudaError {
        match error.0 {
            OUT_OF_MEMORY => {
                let (free_bytes, total_bytes) = self.memory().unwrap_or((0, self.info.memory_bytes));
                let (device, what) = (self.index(), what.to_owned());
                CudaError::OutOfMemory {
                    device,
                    what,
                    requested_bytes: bytes as u64,
                    free_bytes,
                    total_bytes,
                }
            }
            _ => CudaError::new(self.index(), &format!("allocating {what}"), error),
        }
    }
}
