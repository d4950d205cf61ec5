//! One band on a device: its stages, the buffers of its batches, and the copies and launches of a batch.

use super::handle::{BLOCKING_EVENT, CudaEvent, CudaStream};
use super::kernel_timer::{HostTimes, KernelTimer};
use super::memory::{BandMemory, BandNeeds, DeviceQueue, Halvings};
use super::pool::{GpuTile, Pinned};
use super::slice::{CudaSlice, DeviceMemory, DeviceMemoryMut};
use super::{CudaError, Device};
use crate::band::BandStages;
use crate::geometry::{Frame, Rect};
use crate::plan::Tiling;
use crate::psf::cuda::{PsfOnDevice, PsfTile};
use crate::remap::Remap;
use crate::remap::cuda::{RemapOnDevice, RemapTile};
use std::sync::Arc;

/// The streams of a queue: uploads, kernels and downloads overlap.
///
/// Events order the streams where one depends on another. A buffer is used again only after the host has waited for the event
/// behind its last copy or kernel. `GpuBand::new` waits for its allocations and uploads. No call waits for the entire device, which other
/// queues may use.
#[derive(Debug)]
pub struct Streams {
    upload: Arc<CudaStream>,
    compute: Arc<CudaStream>,
    download: Arc<CudaStream>,
}

impl Streams {
    /// Three streams on `device`.
    pub(crate) fn new(device: &Device) -> Result<Self, CudaError> {
        let stream = || device.context.new_stream().map_err(device.failed("creating a stream"));
        Ok(Self { upload: stream()?, compute: stream()?, download: stream()? })
    }

    /// Waits until all enqueued work of the streams is done; `doing` is for the error.
    pub(crate) fn synchronize(&self, device: &Device, doing: &str) -> Result<(), CudaError> {
        for stream in [&self.upload, &self.compute, &self.download] {
            stream.synchronize().map_err(device.failed(doing))?;
        }
        Ok(())
    }
}

/// Device memory of one batch.
#[derive(Debug)]
pub struct BatchBuffers {
    charts: CudaSlice<f32>,
    remapped: CudaSlice<f32>,
    /// Output of the PSF stage, if the band has one.
    contributions: Option<CudaSlice<f32>>,
}

/// A tile of a batch, its chart in page-locked memory.
pub(crate) struct GpuBatchTile {
    pub(crate) sequence: usize,
    pub(crate) rect: Rect,
    pub(crate) chart_rect: Rect,
    pub(crate) chart: Pinned,
    /// Destination of the download.
    pub(crate) output: GpuTile,
}

/// Events around the work of a batch in each stream.
pub(crate) struct BatchEvents {
    pub(crate) upload: [CudaEvent; 2],
    /// Around each sequence of kernels.
    pub(crate) kernels: Vec<[CudaEvent; 2]>,
    pub(crate) download: [CudaEvent; 2],
    pub(crate) host: HostTimes,
}

/// Memory needs of a band: the maximum over `tiles`. `min_psf_bytes`: of its PSF stage, if it has one.
pub fn band_needs<'a>(
    remap: &Remap,
    tiling: &Tiling,
    tiles: impl Iterator<Item = &'a (usize, usize)>,
    min_psf_bytes: Option<usize>,
) -> BandNeeds {
    let mut needs = BandNeeds { min_psf_bytes: min_psf_bytes.unwrap_or(0), ..BandNeeds::default() };
    for &tile in tiles {
        let rect = tiling.rect(tile);
        needs.chart_px = needs.chart_px.max(remap.upload_rect(rect).size().pixels());
        needs.remapped_px = needs.remapped_px.max(rect.size().pixels());
        if min_psf_bytes.is_some() {
            needs.contribution_px = needs.contribution_px.max(tiling.reach(tile).size().pixels());
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
    /// `stages` for `tiles` of `tiling` within the bounds of `queue`, with its memory halved `halvings` times; and the buffers of the batches in flight.
    pub(crate) fn new(
        frame: &Frame,
        stages: &BandStages,
        tiling: &Tiling,
        tiles: &[(usize, usize)],
        queue: &DeviceQueue,
        halvings: Halvings,
        streams: &Streams,
    ) -> Result<(Self, Vec<BatchBuffers>), CudaError> {
        let device = &queue.device;
        let min_psf_bytes =
            stages.psf.as_ref().map(|psf| PsfOnDevice::min_bytes(psf.blocks(), psf.grid(), tiling.tile()));
        let needs = band_needs(&stages.remap, tiling, tiles.iter(), min_psf_bytes);
        let memory = queue.plan(&needs, halvings)?;
        let remap = RemapOnDevice::new(device, &stages.remap)?;
        let psf = stages.psf.as_ref().map(|psf| PsfOnDevice::new(device, frame, psf, memory.psf_bytes));
        let psf = psf.transpose()?;
        let buffers = || {
            let allocate =
                |px: usize, what| device.allocate::<f32>(&streams.compute, memory.tiles * px, what);
            let scatters = needs.contribution_px > 0;
            Ok(BatchBuffers {
                charts: allocate(needs.chart_px, "charts")?,
                remapped: allocate(needs.remapped_px, "remapped tiles")?,
                contributions: scatters
                    .then(|| allocate(needs.contribution_px, "contributions"))
                    .transpose()?,
            })
        };
        let buffers = (0..memory.batches).map(|_| buffers()).collect::<Result<_, _>>()?;
        // Tables and memory are then valid on every stream.
        streams.synchronize(device, "starting a band")?;
        Ok((Self { memory, needs, remap, psf }, buffers))
    }

    /// Enqueues upload, stages and download of `tiles`. `buffers` and `tiles` must not be touched before the last event.
    pub(crate) fn enqueue(
        &mut self,
        device: &Device,
        streams: &Streams,
        buffers: &mut BatchBuffers,
        tiles: &mut [GpuBatchTile],
    ) -> Result<BatchEvents, CudaError> {
        let record =
            |stream: &CudaStream, doing| stream.record_event(BLOCKING_EVENT).map_err(device.failed(doing));
        let wait = |stream: &CudaStream, event: &CudaEvent| {
            stream.wait(event).map_err(device.failed("ordering streams"))
        };
        let Streams { upload, compute, download } = streams;

        let upload_start = record(upload, "uploading charts")?;
        let mut offset = 0;
        for tile in &*tiles {
            let n = tile.chart_rect.size().pixels();
            let to = &mut buffers.charts.slice_mut(offset..offset + n);
            upload.memcpy_htod(&tile.chart[..n], to).map_err(device.failed("uploading charts"))?;
            offset += n;
        }
        let upload_end = record(upload, "uploading charts")?;

        wait(compute, &upload_end)?;
        let (kernels, host) = self.compute(device, compute, buffers, tiles)?;
        wait(download, &record(compute, "computing")?)?;
        let download_start = record(download, "downloading tiles")?;
        let (from, mut offset) = (buffers.contributions.as_ref().unwrap_or(&buffers.remapped), 0);
        for tile in tiles {
            let to = tile.output.data_mut();
            let n = to.len();
            let part = from.slice(offset..offset + n);
            download.memcpy_dtoh(&part, to).map_err(device.failed("downloading tiles"))?;
            offset += n;
        }
        let download_end = record(download, "downloading tiles")?;
        Ok(BatchEvents {
            upload: [upload_start, upload_end],
            kernels,
            download: [download_start, download_end],
            host,
        })
    }

    /// Remap and PSF stages; the events around their kernels, and the time of the host.
    fn compute(
        &mut self,
        device: &Device,
        stream: &Arc<CudaStream>,
        buffers: &mut BatchBuffers,
        tiles: &[GpuBatchTile],
    ) -> Result<(Vec<[CudaEvent; 2]>, HostTimes), CudaError> {
        let (mut chart_offset, mut remapped_offset, mut contribution_offset) = (0, 0, 0);
        let (mut remap_tiles, mut psf_tiles) = (Vec::new(), Vec::new());
        for GpuBatchTile { rect, chart_rect, output, .. } in tiles {
            let (rect, chart_rect, contribution_stride) = (*rect, *chart_rect, output.stride);
            remap_tiles.push(RemapTile { rect, chart_rect, chart_offset, remapped_offset });
            psf_tiles.push(PsfTile { rect, remapped_offset, contribution_offset, contribution_stride });
            chart_offset += chart_rect.size().pixels();
            remapped_offset += rect.size().pixels();
            contribution_offset += output.data().len();
        }
        let mut timer = KernelTimer::new(device, stream);
        timer.start()?;
        self.remap.launch(stream, &remap_tiles, &buffers.charts, &mut buffers.remapped)?;
        timer.stop()?;
        if let (Some(psf), Some(contributions)) = (&mut self.psf, &mut buffers.contributions) {
            psf.launch(stream, &psf_tiles, &buffers.remapped, contributions, &mut timer)?;
        }
        Ok((timer.spans, timer.host))
    }
}
