//! One band on a device: its stages, the plans of its batches, and the copies and launches of a batch.
//!
//! A thread plans batches ahead of their launch (`GpuBand::plan`): all that the CPU computes for the device. Another one enqueues them in
//! that order (`QueueBuffers::enqueue`). The buffers serve all bands, in the order of the compute stream, so a band follows the last
//! one without waiting for it.

use super::batches::AddedTiles;
use super::film_rows::FilmRows;
use crate::band::BandStages;
use crate::cuda::handle::{BLOCKING_EVENT, CudaEvent, CudaStream};
use crate::cuda::kernel_timer::{HostTimes, KernelTimer};
use crate::cuda::memory::{BandNeeds, QueueMemory};
use crate::cuda::pool::Pinned;
use crate::cuda::slice::CudaSlice;
use crate::cuda::{CudaError, Device};
use crate::geometry::{Frame, Rect};
use crate::psf::cuda::{PsfMemory, PsfOnDevice, PsfPlan, PsfPlanner, PsfTile};
use crate::remap::Remap;
use crate::remap::cuda::{RemapOnDevice, RemapTile};
use crate::tiling::Tiling;
use std::ops::Range;
use std::sync::Arc;

/// The streams of a queue: uploads, kernels and downloads overlap.
///
/// Events order the streams where one depends on another. A buffer is used again only after the host has waited for the event
/// behind its last copy or kernel. `GpuBand::new` and `QueueBuffers::new` wait for their allocations and uploads. No call waits for the
/// entire device, which other queues may use.
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

/// Events around the work of a batch in each stream.
pub(crate) struct BatchEvents {
    pub(crate) upload: [CudaEvent; 2],
    /// Around each sequence of kernels.
    pub(crate) kernels: Vec<[CudaEvent; 2]>,
    pub(crate) download: [CudaEvent; 2],
}

/// Memory needs of a band: the maximum over `tiles`. `psf_bytes`: minimum of its PSF stage and what has an effect, if it has one.
pub fn band_needs<'a>(
    remap: &Remap,
    tiling: &Tiling,
    tiles: impl Iterator<Item = &'a (usize, usize)>,
    film_columns: usize,
    psf_bytes: Option<(usize, usize)>,
) -> BandNeeds {
    let (rows, tile_columns) = tiling.count();
    let (min_psf_bytes, max_psf_bytes) = psf_bytes.unwrap_or_default();
    let mut needs = BandNeeds {
        tiles: rows * tile_columns,
        tile_columns,
        tile_rows: tiling.tile(),
        tail_rows: 2 * tiling.margin(),
        film_columns,
        min_psf_bytes,
        max_psf_bytes,
        ..BandNeeds::default()
    };
    for &tile in tiles {
        let rect = tiling.rect(tile);
        needs.chart_px = needs.chart_px.max(remap.upload_rect(rect).size().pixels());
        needs.remapped_px = needs.remapped_px.max(rect.size().pixels());
        if psf_bytes.is_some() {
            needs.contribution_px = needs.contribution_px.max(tiling.reach(tile).size().pixels());
        }
    }
    needs
}

/// Kernels and tables of a band on a device.
#[derive(Debug)]
struct StagesOnDevice {
    remap: RemapOnDevice,
    psf: Option<PsfOnDevice>,
}

/// A band on a device, whose batches are planned in order.
#[derive(Debug)]
pub struct GpuBand {
    stages: Arc<StagesOnDevice>,
    planner: Option<PsfPlanner>,
    tiling: Tiling,
}

/// A planned batch. It holds the band's tables: it must be kept until its kernels have run.
#[derive(Debug)]
pub struct BatchPlan {
    stages: Arc<StagesOnDevice>,
    tiling: Tiling,
    pub(crate) added: AddedTiles,
    pub(crate) tiles: Vec<RemapTile>,
    psf: Option<PsfPlan>,
    /// Values of the charts of its tiles, one after the other.
    chart_len: usize,
    /// Values from one tile that is added to the next.
    slot: usize,
}

impl BatchPlan {
    /// Time of the host in planning.
    pub(crate) fn host(&self) -> HostTimes {
        self.psf.as_ref().map(|plan| plan.host).unwrap_or_default()
    }

    /// Number of spectra of kernel parts that it builds.
    pub(crate) fn spectra(&self) -> u64 {
        self.psf.as_ref().map_or(0, PsfPlan::spectra)
    }
}

impl GpuBand {
    /// `stages` with tiles of `tiling` on `device`, for a queue of `memory`; its tables are uploaded when this returns.
    pub(crate) fn new(
        frame: &Frame,
        stages: &BandStages,
        tiling: &Tiling,
        device: &Arc<Device>,
        memory: &QueueMemory,
    ) -> Result<Self, CudaError> {
        let psf = stages.psf.as_deref();
        let planner = |psf| PsfPlanner::new(device.index(), frame, psf, tiling.tile(), memory.psf_bytes);
        let planner = psf.map(planner).transpose()?;
        let remap = RemapOnDevice::new(device, &stages.remap)?;
        let psf = psf.map(|psf| PsfOnDevice::new(device, psf)).transpose()?;
        Ok(Self { stages: Arc::new(StagesOnDevice { remap, psf }), planner, tiling: *tiling })
    }

    /// Plans the next batch, of the tiles `added`, from charts on `chart_rects`.
    pub(crate) fn plan(&mut self, added: AddedTiles, chart_rects: &[Rect]) -> Result<BatchPlan, CudaError> {
        let rects: Vec<Rect> = added.range.tiles().map(|tile| self.tiling.rect(tile)).collect();
        let margin = if self.planner.is_some() { self.tiling.margin() } else { 0 };
        let pixels = |rect: &Rect| rect.size().pixels();
        let remapped_slot = rects.iter().map(pixels).max().unwrap_or(0);
        let slot = rects.iter().map(|rect| pixels(&rect.grown(margin))).max().unwrap_or(0);
        let (mut chart_offset, mut tiles, mut psf_tiles) = (0, Vec::new(), Vec::new());
        for (i, (&rect, &chart_rect)) in rects.iter().zip(chart_rects).enumerate() {
            let remapped_offset = i * remapped_slot;
            tiles.push(RemapTile { rect, chart_rect, chart_offset, remapped_offset });
            chart_offset += pixels(&chart_rect);
            let (contribution_offset, contribution_stride) = (i * slot, rect.width + 2 * margin);
            psf_tiles.push(PsfTile { rect, remapped_offset, contribution_offset, contribution_stride });
        }
        let psf = self.planner.as_mut().map(|planner| planner.plan(&psf_tiles)).transpose()?;
        Ok(BatchPlan {
            stages: Arc::clone(&self.stages),
            tiling: self.tiling,
            added,
            tiles,
            psf,
            chart_len: chart_offset,
            slot,
        })
    }
}

/// Device memory of a queue for all its bands, but for the charts.
#[derive(Debug)]
pub(crate) struct QueueBuffers {
    device: Arc<Device>,
    remapped: CudaSlice<f32>,
    /// Output of the PSF stage, and its memory, if there is one.
    psf: Option<(CudaSlice<f32>, PsfMemory)>,
    film: FilmRows,
}

impl QueueBuffers {
    /// Buffers of `memory` for bands of `needs` on the film columns `columns`; and those of the charts of each batch in flight.
    pub(crate) fn new(
        device: &Arc<Device>,
        streams: &Streams,
        needs: &BandNeeds,
        memory: &QueueMemory,
        columns: Range<i64>,
    ) -> Result<(Self, Vec<CudaSlice<f32>>), CudaError> {
        let stream = &streams.compute;
        let allocate = |px: usize, what| device.allocate::<f32>(stream, memory.tiles * px, what);
        let psf = || {
            Ok((
                allocate(needs.contribution_px, "contributions")?,
                PsfMemory::new(device, stream, memory.psf_bytes)?,
            ))
        };
        let buffers = Self {
            remapped: allocate(needs.remapped_px, "remapped tiles")?,
            psf: (needs.contribution_px > 0).then(psf).transpose()?,
            film: FilmRows::new(device, stream, columns, memory.film_rows)?,
            device: Arc::clone(device),
        };
        let charts = (0..memory.batches).map(|_| allocate(needs.chart_px, "charts"));
        let charts = charts.collect::<Result<_, _>>()?;
        // The memory is then valid on every stream.
        streams.synchronize(device, "allocating buffers")?;
        Ok((buffers, charts))
    }

    /// Enqueues upload, stages, overlap-add and download of `plan`: its `charts` through `chart_buffer`, its finished film rows to `strips`.
    /// None of them must be touched before the last event.
    pub(crate) fn enqueue(
        &mut self,
        streams: &Streams,
        plan: &BatchPlan,
        charts: &Pinned,
        chart_buffer: &mut CudaSlice<f32>,
        strips: &mut [Pinned],
    ) -> Result<BatchEvents, CudaError> {
        let device = Arc::clone(&self.device);
        let record =
            |stream: &CudaStream, doing| stream.record_event(BLOCKING_EVENT).map_err(device.failed(doing));
        let wait = |stream: &CudaStream, event: &CudaEvent| {
            stream.wait(event).map_err(device.failed("ordering streams"))
        };
        let Streams { upload, compute, download } = streams;

        let upload_start = record(upload, "uploading charts")?;
        upload
            .memcpy_htod(&charts[..plan.chart_len], chart_buffer)
            .map_err(device.failed("uploading charts"))?;
        let upload_end = record(upload, "uploading charts")?;

        wait(compute, &upload_end)?;
        let mut timer = KernelTimer::new(&device, compute);
        timer.start()?;
        plan.stages.remap.launch(compute, &plan.tiles, chart_buffer, &mut self.remapped)?;
        timer.stop()?;
        let mut to_add = &self.remapped;
        if let (Some(stage), Some(psf), Some((contributions, memory))) =
            (&plan.stages.psf, &plan.psf, &mut self.psf)
        {
            stage.launch(compute, psf, memory, &self.remapped, contributions, &mut timer)?;
            to_add = contributions;
        }
        self.film.extend(compute, &plan.added)?;
        timer.start()?;
        self.film.add(compute, &plan.tiling, &plan.added, to_add, plan.slot)?;
        timer.stop()?;
        let kernels = timer.spans;

        wait(download, &record(compute, "computing")?)?;
        let download_start = record(download, "downloading film rows")?;
        self.film.download(download, &plan.added, strips.iter_mut().map(|strip| &mut strip[..]))?;
        let download_end = record(download, "downloading film rows")?;
        Ok(BatchEvents {
            upload: [upload_start, upload_end],
            kernels,
            download: [download_start, download_end],
        })
    }

    /// The film rectangle of `rows`.
    pub(crate) fn rect(&self, rows: &Range<i64>) -> Rect {
        self.film.rect(rows)
    }
}
