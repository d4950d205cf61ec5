//! How fast a GPU is: kernels alone by events on their stream, copies between page-locked memory and the device.

use super::handle::CudaStream;
use super::pool::Pinned;
use super::{CudaError, Device};
use crate::geometry::{Frame, Rect};
use crate::psf::BandPsf;
use crate::psf::cuda::{PsfOnDevice, PsfTile};
use crate::remap::Remap;
use crate::remap::cuda::{RemapOnDevice, RemapTile};
use std::sync::Arc;

/// Seconds that what `launch` puts on `stream` takes there, round by round, after one that is not counted.
fn timed(
    device: &Device,
    stream: &Arc<CudaStream>,
    rounds: usize,
    mut launch: impl FnMut() -> Result<(), CudaError>,
) -> Result<Vec<f64>, CudaError> {
    let mark = || stream.record_event(0).map_err(device.failed("timing"));
    launch()?;
    let mut seconds = Vec::new();
    for _ in 0..rounds {
        let begun = mark()?;
        launch()?;
        let ended = mark()?;
        let ms = begun.elapsed_ms(&ended).map_err(device.failed("timing"))?;
        seconds.push(f64::from(ms) * 1e-3);
    }
    Ok(seconds)
}

/// Seconds of stages 1-2 for `tiles` in one launch.
///
/// # Errors
/// What the driver reports.
pub fn remap(
    device: &Arc<Device>,
    remap: &Remap,
    tiles: &[Rect],
    rounds: usize,
) -> Result<Vec<f64>, CudaError> {
    let stream = device.context.new_stream().map_err(device.failed("making a stream"))?;
    let (mut charts, mut remapped, mut all) = (0, 0, Vec::new());
    for &rect in tiles {
        let chart_rect = remap.upload_rect(rect);
        all.push(RemapTile { rect, chart_rect, chart_offset: charts, remapped_offset: remapped });
        charts += chart_rect.size().pixels();
        remapped += rect.size().pixels();
    }
    let failed = |e| CudaError::new(device.index(), "measuring", e);
    let chart = stream.clone_htod(&vec![0.5f32; charts]).map_err(failed)?;
    let mut out = stream.alloc_zeros::<f32>(remapped).map_err(failed)?;
    let stage = RemapOnDevice::new(device, remap)?;
    timed(device, &stream, rounds, || stage.launch(&stream, &all, &chart, &mut out))
}

/// Seconds of the PSF stage for `tiles` in one go, their spectra in memory, within `bytes` of the device's.
///
/// # Errors
/// What the driver reports.
pub fn psf(
    device: &Arc<Device>,
    frame: &Frame,
    psf: &BandPsf,
    tiles: &[Rect],
    bytes: usize,
    rounds: usize,
) -> Result<Vec<f64>, CudaError> {
    let stream = device.context.new_stream().map_err(device.failed("making a stream"))?;
    let (mut remapped, mut lights, mut all) = (0, 0, Vec::new());
    for &rect in tiles {
        let reach = psf.reaches(rect);
        all.push(PsfTile {
            rect,
            remapped_offset: remapped,
            light_offset: lights,
            light_stride: reach.width,
        });
        remapped += rect.size().pixels();
        lights += reach.size().pixels();
    }
    let failed = |e| CudaError::new(device.index(), "measuring", e);
    let remap = stream.clone_htod(&vec![0.5f32; remapped]).map_err(failed)?;
    let mut light = stream.alloc_zeros::<f32>(lights).map_err(failed)?;
    let mut stage = PsfOnDevice::new(device, frame, psf, bytes)?;
    timed(device, &stream, rounds, || stage.launch(&stream, &all, &remap, &mut light))
}

/// Seconds of a copy of `values` values up, and of one down.
///
/// # Errors
/// What the driver reports.
pub fn copies(device: &Arc<Device>, values: usize, rounds: usize) -> Result<(Vec<f64>, Vec<f64>), CudaError> {
    let stream = device.context.new_stream().map_err(device.failed("making a stream"))?;
    let mut host = Pinned::zeroed(device, values)?;
    let mut there = stream.alloc_zeros::<f32>(values).map_err(device.failed("measuring"))?;
    let up = timed(device, &stream, rounds, || {
        stream.memcpy_htod(&host[..], &mut there).map_err(device.failed("measuring"))
    })?;
    let down = timed(device, &stream, rounds, || {
        stream.memcpy_dtoh(&there, &mut host[..]).map_err(device.failed("measuring"))
    })?;
    // `host` ends here.
    stream.synchronize().map_err(device.failed("measuring"))?;
    Ok((up, down))
}
