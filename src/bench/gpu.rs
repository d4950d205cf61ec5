//! GPUs alone: kernels and copies, each against what bounds it.
//!
//! The PSF stage is bound by the warp instructions that its kernels issue, counted from machine code ([`Cut::instructions`]), four
//! a clock on each multiprocessor; stages 1-2 by the bytes of chart and remap, at the memory's own rate. Both clocks are those
//! that the driver tells.

use super::stages::{benchmark, lens_stages};
use super::{Bench, FILM_MM, median};
use crate::device::Choice;
use crate::progress::say;
use anyhow::{Context, Result};
use pipeline::cuda::memory::MAX_TILES;
use pipeline::cuda::{Device, bench as measured};
use pipeline::geometry::{Frame, Rect, Size};
use pipeline::psf::BandPsf;
use pipeline::psf::cuda::Cut;
use serde_json::json;
use std::sync::Arc;

/// Values of a copy that is timed.
const COPY: usize = 16 << 20;
/// Warp instructions a clock of one multiprocessor.
const ISSUED: f64 = 4.0;
/// Windows of the benchmark grid.
const WINDOWS: [(usize, [&str; 3]); 2] = [
    (51, ["gpu_svpsf_gpx_s", "gpu_svpsf_share", "gpu_svpsf_bound_gpx_s"]),
    (151, ["gpu_svpsf_151_gpx_s", "gpu_svpsf_151_share", "gpu_svpsf_151_bound_gpx_s"]),
];

pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let choice = Choice::new(&bench.args.device, bench.args.engine.named(), None)?;
    let device = choice.devices.first().context("no GPU to measure")?;
    let info = &device.info;
    say(format!(
        "     GPU {} ({}), driver {}.{}",
        info.index, info.name, info.driver_version.0, info.driver_version.1
    ));
    bench.word("gpu", json!(info.name));
    let film = Size::new(bench.args.size as usize, bench.args.size as usize);
    let frame = Frame::centred(film, film, FILM_MM * 1e3 / f64::from(bench.args.size));
    for (window, keys) in WINDOWS {
        let psf = benchmark(&frame, bench.simd, window);
        psf_stage(bench, device, &frame, &psf, keys, &format!("GPU: SVPSF, {window} px (21 x 36 nodes)"))?;
    }
    let (remap, psf) = lens_stages(bench, &frame)?;
    let words = format!("GPU: SVPSF, the lens at 550 nm ({} px)", psf.kernels().size());
    psf_stage(
        bench,
        device,
        &frame,
        &psf,
        ["gpu_svpsf_lens_gpx_s", "gpu_svpsf_lens_share", "gpu_svpsf_lens_bound_gpx_s"],
        &words,
    )?;
    let tiles = row(&frame, psf.blocks().tile);
    let rate = gpx(&tiles, measured::remap(device, &remap, &tiles, bench.rounds)?);
    bench.number("gpu_remap_gpx_s", rate, "Gpx/s", "GPU: RI + distortion remap, bicubic");
    bench.number(
        "gpu_remap_share",
        rate * 8.0 / info.memory_gb_per_s,
        "",
        "  share of its bound, 8 bytes a pixel",
    );
    let (up, down) = measured::copies(device, COPY, bench.rounds)?;
    let gb = 4e-9 * COPY as f64;
    bench.number("gpu_upload_gb_s", gb / median(up), "GB/s", "GPU: copies up, page-locked");
    bench.number("gpu_download_gb_s", gb / median(down), "GB/s", "GPU: copies down, page-locked");
    Ok(())
}

fn psf_stage(
    bench: &mut Bench<'_>,
    device: &Arc<Device>,
    frame: &Frame,
    psf: &BandPsf,
    keys: [&'static str; 3],
    words: &str,
) -> Result<()> {
    let tiles = row(frame, psf.blocks().tile);
    let bytes = (device.memory()?.0 / 2) as usize;
    let rate = gpx(&tiles, measured::psf(device, frame, psf, &tiles, bytes, bench.rounds)?);
    let info = &device.info;
    let issue = f64::from(info.multiprocessors) * ISSUED * f64::from(info.clock_mhz) * 1e-3;
    // Warp instructions a pixel, at most so many warp instructions (1e9) a second.
    let bound = issue / Cut::choose(psf.kernels().size()).instructions();
    bench.number(keys[0], rate, "Gpx/s", words);
    bench.number(keys[1], rate / bound, "", "  share of its bound, counted warp instructions");
    bench.number(keys[2], bound, "Gpx/s", "  that bound");
    Ok(())
}

/// A batch: tiles of a row at a third of the film's height.
fn row(frame: &Frame, side: usize) -> Vec<Rect> {
    let (side, film) = (side.min(frame.film.height), frame.film);
    let count = (film.width / side).clamp(1, MAX_TILES);
    let y = ((film.height - side) / 3) as i64;
    (0..count).map(|i| Rect::new(y, (i * side) as i64, side, side)).collect()
}

fn gpx(tiles: &[Rect], seconds: Vec<f64>) -> f64 {
    let pixels: usize = tiles.iter().map(|t| t.size().pixels()).sum();
    pixels as f64 * 1e-9 / median(seconds)
}
