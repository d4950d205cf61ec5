//! Launches of the kernels of `psf.cu`. All `unsafe` of the stage is here.
#![allow(unsafe_code)]

use super::partition::{Partition, THREADS};
use crate::cuda::handle::CudaStream;
use crate::cuda::launch::{CudaFunction, LaunchConfig};
use crate::cuda::ptx;
use crate::cuda::slice::{CudaSlice, CudaView, CudaViewMut, DeviceMemory};
use crate::cuda::{CudaError, Device};
use std::sync::Arc;

/// `CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES`.
const MAX_DYNAMIC_SHARED: i32 = 8;
/// Threads per block of the kernels without transforms.
const PLAIN_THREADS: u32 = 256;

/// The kernels of `psf.cu` for one partition.
#[derive(Debug)]
pub(super) struct Functions {
    copy: CudaFunction,
    pack: CudaFunction,
    spectra: CudaFunction,
    scatter: CudaFunction,
    unfold: CudaFunction,
    add: CudaFunction,
}

impl Functions {
    pub(super) fn load(device: &Device, partition: &Partition) -> Result<Self, CudaError> {
        let partition = Partition { side: partition.side.max(128), ..*partition }; // a window of 1 launches no transform
        let transform = |name| {
            let kernel = device.kernel(&ptx::PSF, &format!("psf_{name}_{}", partition.side))?;
            let set = kernel.set_attribute(MAX_DYNAMIC_SHARED, partition.shared_bytes() as i32);
            set.map_err(device.failed("setting the limit of shared memory"))?;
            Ok(kernel)
        };
        Ok(Self {
            copy: device.kernel(&ptx::PSF, "psf_copy")?,
            pack: device.kernel(&ptx::PSF, "psf_pack")?,
            spectra: transform("spectra")?,
            scatter: transform("scatter")?,
            unfold: device.kernel(&ptx::PSF, "psf_unfold")?,
            add: device.kernel(&ptx::PSF, "psf_add")?,
        })
    }
}

/// Device, stream and tables of the launches of a round.
#[derive(Clone, Copy, Debug)]
pub(super) struct Launcher<'a> {
    pub(super) device: &'a Device,
    pub(super) stream: &'a Arc<CudaStream>,
    pub(super) partition: &'a Partition,
    pub(super) functions: &'a Functions,
    pub(super) tables: &'a CudaSlice<f32>,
}

/// Shape of a launch without transforms.
fn plain_shape(grid_dim: (u32, u32, u32)) -> LaunchConfig {
    LaunchConfig { grid_dim, block_dim: (PLAIN_THREADS, 1, 1), shared_mem_bytes: 0 }
}

impl Launcher<'_> {
    /// Shape of a launch with a thread block for each slice of `count` transforms.
    fn transform_shape(&self, count: usize) -> LaunchConfig {
        LaunchConfig {
            grid_dim: ((count * self.partition.slices()) as u32, 1, 1),
            block_dim: (THREADS, 1, 1),
            shared_mem_bytes: self.partition.shared_bytes(),
        }
    }

    pub(super) fn copy(
        &self,
        grid: (u32, u32, u32),
        tiles: &CudaView<'_, u32>,
        remapped: &CudaSlice<f32>,
        contributions: &mut CudaSlice<f32>,
    ) -> Result<(), CudaError> {
        let mut launch = self.stream.launch_builder(&self.functions.copy);
        launch.arg(tiles).arg(remapped).arg(contributions);
        // SAFETY: psf_copy(Tile *, float *, float *); PsfOnDevice::launch has checked that the tiles lie in both buffers.
        unsafe { launch.launch(plain_shape(grid)) }.map_err(self.device.failed("copying tiles"))?;
        Ok(())
    }

    pub(super) fn pack(
        &self,
        count: usize,
        blocks: &CudaView<'_, u32>,
        remapped: &CudaSlice<f32>,
        polynomials: &CudaSlice<f32>,
        packed: &mut CudaViewMut<'_, u32>,
    ) -> Result<(), CudaError> {
        let side = self.partition.side as i32;
        let mut launch = self.stream.launch_builder(&self.functions.pack);
        launch.arg(blocks).arg(&side).arg(remapped).arg(polynomials).arg(packed);
        // SAFETY: psf_pack(Block *, int, float *, float *, float4 *); blocks lie in their tiles, `packed` has the rows of all.
        unsafe { launch.launch(plain_shape((count as u32, 1, 1))) }
            .map_err(self.device.failed("packing blocks"))?;
        Ok(())
    }

    pub(super) fn spectra(
        &self,
        count: usize,
        parts: &CudaView<'_, u32>,
        base_kernels: &CudaViewMut<'_, u32>,
        spectra: &mut CudaViewMut<'_, u32>,
    ) -> Result<(), CudaError> {
        let window = self.partition.window as i32;
        let mut launch = self.stream.launch_builder(&self.functions.spectra);
        launch.arg(parts).arg(base_kernels).arg(&window).arg(self.tables).arg(spectra);
        // SAFETY: psf_spectra(KernelPart *, float *, int, float2 *, float4 *); base kernel and spectrum of a part are entries of the
        // two pools.
        unsafe { launch.launch(self.transform_shape(count)) }
            .map_err(self.device.failed("transforming kernels"))?;
        Ok(())
    }

    pub(super) fn scatter(
        &self,
        count: usize,
        (jobs, weights): (&CudaView<'_, u32>, &CudaView<'_, u32>),
        packed: &CudaViewMut<'_, u32>,
        spectra: &CudaViewMut<'_, u32>,
        images: &mut CudaViewMut<'_, u32>,
    ) -> Result<(), CudaError> {
        let mut launch = self.stream.launch_builder(&self.functions.scatter);
        let packed = &packed.slice(..);
        launch.arg(jobs).arg(weights).arg(packed).arg(spectra).arg(self.tables).arg(images);
        // SAFETY: psf_scatter(Job *, Weight *, float4 *, float4 *, float2 *, float *); jobs refer to rows of `packed`, weights to
        // entries of the pool of spectra, and there is an image for every job.
        unsafe { launch.launch(self.transform_shape(count)) }.map_err(self.device.failed("scattering"))?;
        Ok(())
    }

    /// No launch where a transform is one slice.
    pub(super) fn unfold(&self, count: usize, images: &mut CudaViewMut<'_, u32>) -> Result<(), CudaError> {
        if self.partition.slices() == 1 {
            return Ok(());
        }
        let threads = self.partition.image_len() / 8;
        let grid = ((count * threads) as u32 / PLAIN_THREADS, 1, 1);
        let mut launch = self.stream.launch_builder(&self.functions.unfold);
        launch.arg(images);
        // SAFETY: psf_unfold(float *) for `count` images of 256 × 256, 8 values a thread.
        unsafe { launch.launch(plain_shape(grid)) }.map_err(self.device.failed("unfolding transforms"))?;
        Ok(())
    }

    pub(super) fn add(
        &self,
        grid: (u32, u32, u32),
        (tiles, block_images): (&CudaView<'_, u32>, &CudaView<'_, u32>),
        images: &CudaViewMut<'_, u32>,
        contributions: &mut CudaSlice<f32>,
    ) -> Result<(), CudaError> {
        let [side, window, parts, part] =
            [self.partition.side, self.partition.window, self.partition.parts, self.partition.part]
                .map(|v| v as i32);
        let mut launch = self.stream.launch_builder(&self.functions.add);
        let images = &images.slice(..);
        launch.arg(tiles).arg(block_images).arg(images).arg(&side).arg(&window).arg(&parts).arg(&part);
        launch.arg(contributions);
        // SAFETY: psf_add(Tile *, BlockImages *, float *, int × 4, float *); block images refer to images that were computed, and
        // PsfOnDevice::launch has checked that the tiles lie in `contributions`.
        unsafe { launch.launch(plain_shape(grid)) }.map_err(self.device.failed("adding blocks"))?;
        Ok(())
    }
}
