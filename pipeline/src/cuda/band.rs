//! One band on a device: its stages, the slots that batches of its tiles are computed in, and what is launched for a batch.

use super::handle::{CudaEvent, CudaStream};
use super::memory::{BandMemory, BandNeeds, DeviceQueue};
use super::pool::{GpuTile, Pinned};
use super::slice::CudaSlice;
use super::{CudaError, Device};
use crate::band::BandStages;
use crate::geometry::{Frame, Rect};
use crate::plan::Tiling;
use crate::psf::cuda::{PsfOnDevice, PsfTile};
use crate::remap::Remap;
use crate::remap::cuda::{RemapOnDevice, RemapTile};
use std::sync::Arc;

/// `CU_EVENT_BLOCKING_SYNC`.
const BLOCKING_EVENT: u32 = 1;

/// The streams of a queue: copies in either direction go on beside the kernels.
#[derive(Debug)]
pub struct Streams {
    upload: Arc<CudaStream>,
    compute: Arc<CudaStream>,
    download: Arc<CudaStream>,
}

impl Streams {
    /// What one stream needs of another is ordered here, by events; buffers are used again once the host has waited for the event
    /// behind their last copy or kernel, and [`GpuBand::new`] waits for all that it has begun.
    pub(crate) fn new(device: &Device) -> Result<Self, CudaError> {
        let stream = || device.context.new_stream().map_err(device.failed("making a stream"));
        Ok(Self { upload: stream()?, compute: stream()?, download: stream()? })
    }
}

/// Device memory for one batch on its way.
#[derive(Debug)]
pub struct Slot {
    chart: CudaSlice<f32>,
    remap: CudaSlice<f32>,
    light: Option<CudaSlice<f32>>,
}

/// A tile of a batch, its chart in page-locked memory.
pub(crate) struct GpuBatchTile {
    pub(crate) sequence: usize,
    pub(crate) rect: Rect,
    pub(crate) chart_rect: Rect,
    pub(crate) chart: Pinned,
    /// Where the computed tile is downloaded to.
    pub(crate) output: GpuTile,
}

/// Start and end of the batch's part in each stream.
pub(crate) struct BatchEvents {
    pub(crate) upload: [CudaEvent; 2],
    pub(crate) compute: [CudaEvent; 2],
    pub(crate) download: [CudaEvent; 2],
}

/// What the largest of `tiles` of a band needs. `least_psf`: of its PSF stage, if it has one.
pub fn needs<'a>(
    remap: &Remap,
    tiling: &Tiling,
    tiles: impl Iterator<Item = &'a (usize, usize)>,
    least_psf: Option<usize>,
) -> BandNeeds {
    let mut needs = BandNeeds { least_psf: least_psf.unwrap_or(0), ..BandNeeds::default() };
    for &tile in tiles {
        let rect = tiling.rect(tile);
        needs.chart_px = needs.chart_px.max(remap.upload_rect(rect).size().pixels());
        needs.remapped_px = needs.remapped_px.max(rect.size().pixels());
        if least_psf.is_some() {
            needs.light_px = needs.light_px.max(tiling.reach(tile).size().pixels());
        }
    }
    needs
}

/// A band's stages on a device.
#[derive(Debug)]
pub struct GpuBand {
    pub(crate) memory: BandMemory,
    pub(crate) needs: BandNeeds,
    remap: RemapOnDevice,
    psf: Option<PsfOnDevice>,
}

impl GpuBand {
    /// `stages` for `tiles` of `tiling` within the bounds of `queue`, halved `halved` times on the device, and slots for batches.
    pub(crate) fn new(
        frame: &Frame,
        stages: &BandStages,
        tiling: &Tiling,
        tiles: &[(usize, usize)],
        queue: &DeviceQueue,
        halved: u32,
        streams: &Streams,
    ) -> Result<(Self, Vec<Slot>), CudaError> {
        let device = &queue.device;
        let least =
            stages.psf.as_ref().map(|psf| PsfOnDevice::least_bytes(psf.blocks(), psf.grid(), tiling.tile()));
        let needs = needs(&stages.remap, tiling, tiles.iter(), least);
        let memory = queue.plan(&needs, halved)?;
        let remap = RemapOnDevice::new(device, &stages.remap)?;
        let psf = stages.psf.as_ref().map(|psf| PsfOnDevice::new(device, frame, psf, memory.psf_bytes));
        let psf = psf.transpose()?;
        let slot = || {
            let room = |px: usize, what| device.allocate::<f32>(&streams.compute, memory.tiles * px, what);
            let light = (needs.light_px > 0).then(|| room(needs.light_px, "light")).transpose()?;
            Ok(Slot {
                chart: room(needs.chart_px, "charts")?,
                remap: room(needs.remapped_px, "remapped")?,
                light,
            })
        };
        let slots = (0..memory.slots).map(|_| slot()).collect::<Result<_, _>>()?;
        // Tables and memory are there for every stream.
        device.synchronize("beginning a band")?;
        Ok((Self { memory, needs, remap, psf }, slots))
    }

    /// Sends `tiles` on their way: up, through the stages, down. Nothing of it may be touched before the last event.
    pub(crate) fn enqueue(
        &mut self,
        device: &Device,
        streams: &Streams,
        slot: &mut Slot,
        tiles: &mut [GpuBatchTile],
    ) -> Result<BatchEvents, CudaError> {
        let mark = |stream: &CudaStream, doing| {
            // Timed, and whoever waits for it sleeps.
            stream.record_event(BLOCKING_EVENT).map_err(device.failed(doing))
        };
        let after = |stream: &CudaStream, event: &CudaEvent| {
            stream.wait(event).map_err(device.failed("ordering streams"))
        };
        let Streams { upload, compute, download } = streams;

        let up = mark(upload, "uploading charts")?;
        let mut at = 0;
        for tile in &*tiles {
            let n = tile.chart_rect.size().pixels();
            let to = &mut slot.chart.slice_mut(at..at + n);
            upload.memcpy_htod(&tile.chart[..n], to).map_err(device.failed("uploading charts"))?;
            at += n;
        }
        let uploaded = mark(upload, "uploading charts")?;

        after(compute, &uploaded)?;
        let begun = mark(compute, "computing")?;
        self.compute(compute, slot, tiles)?;
        let computed = mark(compute, "computing")?;

        after(download, &computed)?;
        let down = mark(download, "downloading light")?;
        let (from, mut at) = (slot.light.as_ref().unwrap_or(&slot.remap), 0);
        for tile in tiles {
            let to = tile.output.data_mut();
            let n = to.len();
            download.memcpy_dtoh(&from.slice(at..at + n), to).map_err(device.failed("downloading light"))?;
            at += n;
        }
        let downloaded = mark(download, "downloading light")?;
        Ok(BatchEvents { upload: [up, uploaded], compute: [begun, computed], download: [down, downloaded] })
    }

    /// Stages 1-3.
    fn compute(
        &mut self,
        stream: &Arc<CudaStream>,
        slot: &mut Slot,
        tiles: &[GpuBatchTile],
    ) -> Result<(), CudaError> {
        let (mut chart_offset, mut remapped_offset, mut light_offset) = (0, 0, 0);
        let (mut remapped, mut lights) = (Vec::new(), Vec::new());
        for GpuBatchTile { rect, chart_rect, output, .. } in tiles {
            remapped.push(RemapTile { rect: *rect, chart_rect: *chart_rect, chart_offset, remapped_offset });
            lights.push(PsfTile { rect: *rect, remapped_offset, light_offset, light_stride: output.stride });
            chart_offset += chart_rect.size().pixels();
            remapped_offset += rect.size().pixels();
            light_offset += output.data().len();
        }
        self.remap.launch(stream, &remapped, &slot.chart, &mut slot.remap)?;
        if let (Some(psf), Some(light)) = (&mut self.psf, &mut slot.light) {
            psf.launch(stream, &lights, &slot.remap, light)?;
        }
        Ok(())
    }
}
