//! The launches of `psf.cu`: shapes, arguments, nothing else. All `unsafe` of the stage is here.
#![allow(unsafe_code)]

use super::cut::{Cut, THREADS};
use crate::cuda::handle::CudaStream;
use crate::cuda::launch::{CudaFunction, LaunchConfig};
use crate::cuda::slice::{CudaSlice, CudaView, CudaViewMut};
use crate::cuda::{CudaError, Device};
use bytemuck::Pod;
use std::ops::Range;
use std::sync::Arc;

/// The kernels, for the driver to assemble.
const PTX: &str = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/ptx/psf.ptx"));

/// `CU_FUNC_ATTRIBUTE_MAX_DYNAMIC_SHARED_SIZE_BYTES`.
const MAX_DYNAMIC_SHARED: i32 = 8;
/// Threads of the kernels without transforms.
const PLAIN: u32 = 256;

/// The entries of `psf.cu` that a cut needs.
#[derive(Debug)]
pub(super) struct Entries {
    copy: CudaFunction,
    pack: CudaFunction,
    spectra: CudaFunction,
    scatter: CudaFunction,
    unfold: CudaFunction,
    add: CudaFunction,
}

impl Entries {
    pub(super) fn load(device: &Device, cut: &Cut) -> Result<Self, CudaError> {
        let cut = Cut { side: cut.side.max(128), ..*cut }; // a window of 1 has none, and launches none
        let transform = |name| {
            let kernel = device.kernel(PTX, &format!("psf_{name}_{}", cut.side))?;
            let set = kernel.set_attribute(MAX_DYNAMIC_SHARED, cut.shared_bytes() as i32);
            set.map_err(device.failed("asking for shared memory"))?;
            Ok(kernel)
        };
        Ok(Self {
            copy: device.kernel(PTX, "psf_copy")?,
            pack: device.kernel(PTX, "psf_pack")?,
            spectra: transform("spectra")?,
            scatter: transform("scatter")?,
            unfold: device.kernel(PTX, "psf_unfold")?,
            add: device.kernel(PTX, "psf_add")?,
        })
    }
}

/// Lists of descriptors, one behind the other: they go up in one copy.
#[derive(Debug, Default)]
pub(super) struct Lists {
    pub(super) words: Vec<u32>,
}

impl Lists {
    /// Adds a list; where it lies.
    pub(super) fn push<T: Pod>(&mut self, list: &[T]) -> Range<usize> {
        let start = self.words.len();
        self.words.extend_from_slice(bytemuck::cast_slice(list));
        let end = self.words.len();
        self.words.resize(end.next_multiple_of(4), 0);
        start..end
    }
}

/// Room for `len` words in `buffer`, which loses what it holds if it grows.
pub(super) fn grow(
    device: &Device,
    stream: &Arc<CudaStream>,
    buffer: &mut CudaSlice<u32>,
    len: usize,
) -> Result<(), CudaError> {
    if buffer.len() < len {
        *buffer = device.allocate(stream, 1, "blocks")?; // the old one goes before the new one comes
        *buffer = device.allocate(stream, len, "blocks and their light")?;
    }
    Ok(())
}

/// Where and with what a round is launched.
#[derive(Clone, Copy, Debug)]
pub(super) struct Launcher<'a> {
    pub(super) device: &'a Device,
    pub(super) stream: &'a Arc<CudaStream>,
    pub(super) cut: &'a Cut,
    pub(super) entries: &'a Entries,
    pub(super) tables: &'a CudaSlice<f32>,
}

fn plain(grid_dim: (u32, u32, u32)) -> LaunchConfig {
    LaunchConfig { grid_dim, block_dim: (PLAIN, 1, 1), shared_mem_bytes: 0 }
}

impl Launcher<'_> {
    /// A thread block for each slice of `count` transforms.
    fn transforms(&self, count: usize) -> LaunchConfig {
        LaunchConfig {
            grid_dim: ((count * self.cut.slices()) as u32, 1, 1),
            block_dim: (THREADS, 1, 1),
            shared_mem_bytes: self.cut.shared_bytes(),
        }
    }

    pub(super) fn copy(
        &self,
        grid: (u32, u32, u32),
        tiles: &CudaView<'_, u32>,
        remapped: &CudaSlice<f32>,
        light: &mut CudaSlice<f32>,
    ) -> Result<(), CudaError> {
        let mut launch = self.stream.launch_builder(&self.entries.copy);
        launch.arg(tiles).arg(remapped).arg(light);
        // SAFETY: psf_copy(Tile *, float *, float *); PsfOnDevice::launch has checked that the tiles lie in both.
        unsafe { launch.launch(plain(grid)) }.map_err(self.device.failed("copying tiles"))?;
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
        let side = self.cut.side as i32;
        let mut launch = self.stream.launch_builder(&self.entries.pack);
        launch.arg(blocks).arg(&side).arg(remapped).arg(polynomials).arg(packed);
        // SAFETY: psf_pack(Block *, int, float *, float *, float4 *); blocks lie in their tiles, `packed` holds the rows of all.
        unsafe { launch.launch(plain((count as u32, 1, 1))) }
            .map_err(self.device.failed("packing blocks"))?;
        Ok(())
    }

    pub(super) fn spectra(
        &self,
        count: usize,
        turns: &CudaView<'_, u32>,
        seeds: &CudaSlice<f32>,
        spectra: &mut CudaSlice<f32>,
    ) -> Result<(), CudaError> {
        let window = self.cut.window as i32;
        let mut launch = self.stream.launch_builder(&self.entries.spectra);
        launch.arg(turns).arg(seeds).arg(&window).arg(self.tables).arg(spectra);
        // SAFETY: psf_spectra(Turn *, float *, int, float2 *, float4 *); a turn's seed and spectrum are places of the two pools.
        unsafe { launch.launch(self.transforms(count)) }
            .map_err(self.device.failed("transforming kernels"))?;
        Ok(())
    }

    pub(super) fn scatter(
        &self,
        count: usize,
        (jobs, tents): (&CudaView<'_, u32>, &CudaView<'_, u32>),
        packed: &CudaViewMut<'_, u32>,
        spectra: &CudaSlice<f32>,
        images: &mut CudaViewMut<'_, u32>,
    ) -> Result<(), CudaError> {
        let mut launch = self.stream.launch_builder(&self.entries.scatter);
        let packed = &packed.as_view();
        launch.arg(jobs).arg(tents).arg(packed).arg(spectra).arg(self.tables).arg(images);
        // SAFETY: psf_scatter(Job *, Tent *, float4 *, float4 *, float2 *, float *); jobs name rows of `packed`, tents places of
        // the pool of spectra, and there is an image for every job.
        unsafe { launch.launch(self.transforms(count)) }.map_err(self.device.failed("scattering"))?;
        Ok(())
    }

    /// Nothing where a transform is one slice.
    pub(super) fn unfold(&self, count: usize, images: &mut CudaViewMut<'_, u32>) -> Result<(), CudaError> {
        if self.cut.slices() == 1 {
            return Ok(());
        }
        let threads = self.cut.image_len() / 8;
        let grid = ((count * threads) as u32 / PLAIN, 1, 1);
        let mut launch = self.stream.launch_builder(&self.entries.unfold);
        launch.arg(images);
        // SAFETY: psf_unfold(float *) for `count` images of 256 × 256, 8 values a thread.
        unsafe { launch.launch(plain(grid)) }.map_err(self.device.failed("unfolding transforms"))?;
        Ok(())
    }

    pub(super) fn add(
        &self,
        grid: (u32, u32, u32),
        (tiles, slots): (&CudaView<'_, u32>, &CudaView<'_, u32>),
        images: &CudaViewMut<'_, u32>,
        light: &mut CudaSlice<f32>,
    ) -> Result<(), CudaError> {
        let [side, window, parts, part] =
            [self.cut.side, self.cut.window, self.cut.parts, self.cut.part].map(|v| v as i32);
        let mut launch = self.stream.launch_builder(&self.entries.add);
        let images = &images.as_view();
        launch.arg(tiles).arg(slots).arg(images).arg(&side).arg(&window).arg(&parts).arg(&part).arg(light);
        // SAFETY: psf_add(Tile *, Slots *, float *, int × 4, float *); slots name images that were scattered, and
        // PsfOnDevice::launch has checked that the tiles of light lie in `light`.
        unsafe { launch.launch(plain(grid)) }.map_err(self.device.failed("adding blocks"))?;
        Ok(())
    }
}
