//! GPU benchmarks: kernels timed by events on their stream, and copies between page-locked memory and the device.

use crate::cuda::handle::{CudaEvent, CudaStream};
use crate::cuda::kernel_timer::KernelTimer;
use crate::cuda::pool::Pinned;
use crate::cuda::{CudaError, Device};
use crate::geometry::{Frame, Rect};
use crate::psf::BandPsf;
use crate::psf::cuda::{PsfStage, PsfTile};
use crate::remap::Remap;
use crate::remap::cuda::{RemapOnDevice, RemapTile};
use std::sync::Arc;

/// Seconds of the spans that `launch` times on `stream`, one value a round, after one round that is not counted.
fn time_rounds(
    device: &Device,
    stream: &Arc<CudaStream>,
    rounds: usize,
    mut launch: impl FnMut(&mut KernelTimer<'_>) -> Result<(), CudaError>,
) -> Result<Vec<f64>, CudaError> {
    launch(&mut KernelTimer::new(device, stream))?;
    let round = |_| {
        let mut timer = KernelTimer::new(device, stream);
        launch(&mut timer)?;
        let span = |[start, end]: &[_; 2]| CudaEvent::elapsed_ms(start, end).map_err(device.failed("timing"));
        timer.spans.iter().map(span).sum::<Result<f32, _>>().map(|ms| f64::from(ms) * 1e-3)
    };
    (0..rounds).map(round).collect()
}

/// Seconds of the remap stage for `tiles` in one launch.
///
/// # Errors
/// An error of the driver.
pub fn remap(
    device: &Arc<Device>,
    remap: &Remap,
    tiles: &[Rect],
    rounds: usize,
) -> Result<Vec<f64>, CudaError> {
    let stream = device.context.new_stream().map_err(device.failed("creating a stream"))?;
    let (mut chart_offset, mut remapped_offset, mut remap_tiles) = (0, 0, Vec::new());
    for &rect in tiles {
        let chart_rect = remap.upload_rect(rect);
        remap_tiles.push(RemapTile { rect, chart_rect, chart_offset, remapped_offset });
        chart_offset += chart_rect.size().pixels();
        remapped_offset += rect.size().pixels();
    }
    let failed = |e| CudaError::new(device.index(), "measuring", e);
    let charts = stream.clone_htod(&vec![0.5f32; chart_offset]).map_err(failed)?;
    let mut remapped = stream.alloc_zeros::<f32>(remapped_offset).map_err(failed)?;
    let stage = RemapOnDevice::new(device, remap)?;
    time_rounds(device, &stream, rounds, |timer| {
        timer.start()?;
        stage.launch(&stream, &remap_tiles, &charts, &mut remapped)?;
        timer.stop()
    })
}

/// Seconds of the PSF stage for `tiles` in one batch, their spectra resident, within `bytes` of device memory.
///
/// # Errors
/// An error of the driver.
pub fn psf(
    device: &Arc<Device>,
    frame: &Frame,
    psf: &BandPsf,
    tiles: &[Rect],
    bytes: usize,
    rounds: usize,
) -> Result<Vec<f64>, CudaError> {
    let stream = device.context.new_stream().map_err(device.failed("creating a stream"))?;
    let (mut remapped_offset, mut contribution_offset, mut psf_tiles) = (0, 0, Vec::new());
    for &rect in tiles {
        let reach = psf.reaches(rect);
        let contribution_stride = reach.width;
        psf_tiles.push(PsfTile { rect, remapped_offset, contribution_offset, contribution_stride });
        remapped_offset += rect.size().pixels();
        contribution_offset += reach.size().pixels();
    }
    let failed = |e| CudaError::new(device.index(), "measuring", e);
    let remapped = stream.clone_htod(&vec![0.5f32; remapped_offset]).map_err(failed)?;
    let mut contributions = stream.alloc_zeros::<f32>(contribution_offset).map_err(failed)?;
    let mut stage = PsfStage::new(device, frame, psf, bytes)?;
    time_rounds(device, &stream, rounds, |timer| {
        stage.launch(&stream, &psf_tiles, &remapped, &mut contributions, timer)
    })
}

/// Seconds of an upload and of a download of `values` f32 values.
///
/// # Errors
/// An error of the driver.
pub fn copies(device: &Arc<Device>, values: usize, rounds: usize) -> Result<(Vec<f64>, Vec<f64>), CudaError> {
    let stream = device.context.new_stream().map_err(device.failed("creating a stream"))?;
    let mut host = Pinned::zeroed(device, values)?;
    let mut on_device = stream.alloc_zeros::<f32>(values).map_err(device.failed("measuring"))?;
    let uploads = time_rounds(device, &stream, rounds, |timer| {
        timer.start()?;
        stream.memcpy_htod(&host[..], &mut on_device).map_err(device.failed("measuring"))?;
        timer.stop()
    })?;
    let downloads = time_rounds(device, &stream, rounds, |timer| {
        timer.start()?;
        stream.memcpy_dtoh(&on_device, &mut host[..]).map_err(device.failed("measuring"))?;
        timer.stop()
    })?;
    // Before `host` is freed.
    stream.synchronize().map_err(device.failed("measuring"))?;
    Ok((uploads, downloads))
}
