//! GPU kernels and copies, each compared with its bound.
//!
//! The bound of the PSF stage is the issue rate of warp instructions: four per clock on each multiprocessor, with the instructions of
//! its kernels counted in machine code ([`Partition::instructions`]). The bound of the remap stage is the memory bandwidth for the bytes of
//! chart and remapped image. Clock and bandwidth are those that the driver reports.

use super::stages::{benchmark, lens_stages};
use super::{Bench, FILM_MM, median};
use crate::machine::device::{DeviceSelection, driver};
use crate::progress::log_line;
use anyhow::{Context, Result};
use pipeline::cuda::Device;
use pipeline::cuda::memory::MAX_TILES;
use pipeline::geometry::{Frame, Rect, Size};
use pipeline::psf::BandPsf;
use pipeline::psf::cuda::{Partition, gpu_blocks};
use pipeline::stages::cuda::bench as measured;
use std::sync::Arc;

/// Number of values of a timed copy.
const COPY_VALUES: usize = 16 << 20;
/// Warp instructions per clock of one multiprocessor.
const INSTRUCTIONS_PER_CLOCK: f64 = 4.0;
/// Windows of the benchmark grid, px, and the keys of rate, share of the bound, and bound.
const WINDOWS: [(usize, [&str; 3]); 6] = [
    (51, ["gpu_svpsf_gpx_s", "gpu_svpsf_share", "gpu_svpsf_bound_gpx_s"]),
    (25, ["gpu_svpsf_25_gpx_s", "gpu_svpsf_25_share", "gpu_svpsf_25_bound_gpx_s"]),
    (101, ["gpu_svpsf_101_gpx_s", "gpu_svpsf_101_share", "gpu_svpsf_101_bound_gpx_s"]),
    (151, ["gpu_svpsf_151_gpx_s", "gpu_svpsf_151_share", "gpu_svpsf_151_bound_gpx_s"]),
    (201, ["gpu_svpsf_201_gpx_s", "gpu_svpsf_201_share", "gpu_svpsf_201_bound_gpx_s"]),
    (401, ["gpu_svpsf_401_gpx_s", "gpu_svpsf_401_share", "gpu_svpsf_401_bound_gpx_s"]),
];

pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let choice = DeviceSelection::new(&bench.args.device, bench.args.engine.explicit(), None)?;
    let device = choice.devices.first().context("no GPU to measure")?;
    let info = &device.info;
    log_line(format!("     GPU {} ({}), {}", info.index, info.name, driver::description(info)));
    bench.add_text("gpu", "gpu", &info.name);
    let film = Size::new(bench.args.film_size as usize, bench.args.film_size as usize);
    let frame = Frame::centred(film, film, FILM_MM * 1e3 / f64::from(bench.args.film_size));
    for (window, keys) in WINDOWS {
        let psf = benchmark(&frame, bench.simd, window);
        psf_stage(bench, device, &frame, &psf, keys, &format!("GPU: SVPSF, {window} px (21 x 36 nodes)"))?;
    }
    let (remap, psf) = lens_stages(bench, &frame)?;
    let label = format!("GPU: SVPSF, the lens at 550 nm ({} px)", psf.kernels().size());
    psf_stage(
        bench,
        device,
        &frame,
        &psf,
        ["gpu_svpsf_lens_gpx_s", "gpu_svpsf_lens_share", "gpu_svpsf_lens_bound_gpx_s"],
        &label,
    )?;
    let tiles = batch(&frame, gpu_blocks(psf.blocks()).tile);
    let rate = gpx(&tiles, measured::remap(device, &remap, &tiles, bench.rounds)?);
    bench.add_number("gpu_remap_gpx_s", rate, "Gpx/s", "GPU: RI + distortion remap, bicubic");
    bench.add_number(
        "gpu_remap_share",
        rate * 8.0 / info.memory_gb_per_s,
        "",
        "  share of its bound, 8 bytes per pixel",
    );
    let (up, down) = measured::copies(device, COPY_VALUES, bench.rounds)?;
    let gb = 4e-9 * COPY_VALUES as f64;
    bench.add_number("gpu_upload_gb_s", gb / median(up), "GB/s", "GPU: upload, page-locked memory");
    bench.add_number("gpu_download_gb_s", gb / median(down), "GB/s", "GPU: download, page-locked memory");
    Ok(())
}

fn psf_stage(
    bench: &mut Bench<'_>,
    device: &Arc<Device>,
    frame: &Frame,
    psf: &BandPsf,
    keys: [&'static str; 3],
    label: &str,
) -> Result<()> {
    let tiles = batch(frame, gpu_blocks(psf.blocks()).tile);
    let bytes = (device.memory()?.0 / 2) as usize;
    let rate = gpx(&tiles, measured::psf(device, frame, psf, &tiles, bytes, bench.rounds)?);
    let info = &device.info;
    let issue = f64::from(info.multiprocessors) * INSTRUCTIONS_PER_CLOCK * f64::from(info.clock_mhz) * 1e-3;
    // Gpx/s: 1e9 warp instructions per second over warp instructions per pixel.
    let bound = issue / Partition::for_window(psf.kernels().size()).instructions();
    bench.add_number(keys[0], rate, "Gpx/s", label);
    bench.add_number(keys[1], rate / bound, "", "  share of its bound, warp instruction issue");
    bench.add_number(keys[2], bound, "Gpx/s", "  bound");
    Ok(())
}

/// Tiles of one batch, as many as those of a run: complete rows from a third of the film's height on.
fn batch(frame: &Frame, side: usize) -> Vec<Rect> {
    let film = frame.film;
    let side = side.min(film.height).min(film.width);
    let top = (film.height - side) / 3;
    let columns = (film.width / side).min(MAX_TILES);
    let rows = (MAX_TILES / columns).min((film.height - top) / side);
    Rect::new(top as i64, 0, rows * side, columns * side).tiles(side, side).collect()
}

fn gpx(tiles: &[Rect], seconds: Vec<f64>) -> f64 {
    let pixels: usize = tiles.iter().map(|t| t.size().pixels()).sum();
    pixels as f64 * 1e-9 / median(seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batch_has_as_many_complete_rows_as_a_run() {
        for (side, film, expected) in [(426, 14_141, 3 * 33), (90, 14_141, 128), (426, 600, 1), (426, 300, 1)]
        {
            let film = Size::new(film, film);
            let tiles = batch(&Frame::centred(film, film, 1.0), side);
            assert_eq!(tiles.len(), expected, "{side} px on {film:?}");
            assert!(tiles.iter().all(|tile| film.rect().contains(*tile)));
        }
    }
}
