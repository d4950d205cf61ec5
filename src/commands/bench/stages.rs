//! Stages, in memory.

use super::{Bench, FILM_MM};
use crate::job::lens::{JobLens, UntracedLens};
use anyhow::{Context, Result};
use pipeline::band::BandStages;
use pipeline::band::{BandPlan, Options, PsfBetween};
use pipeline::bench::{Strided, fused_multiply_adds};
use pipeline::buffer::TileBuffer;
use pipeline::field::Outside;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Frame, Rect, Size};
use pipeline::lens::{PsfSample, PsfStack};
use pipeline::psf::grid::NodeGrid;
use pipeline::psf::kernel::NodeKernels;
use pipeline::psf::spectra::SpectrumCache;
use pipeline::psf::{BandPsf, PsfScratch};
use pipeline::remap::{ChartInterpolation, Remap, RemapScratch};
use pipeline::resample::{Interp, Surround};
use pipeline::simd::Simd;
use pipeline::stage::Stage;
use pipeline::stages::default_stages;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Benchmark grid of the PSF field: 21 heights to 20 mm, 36 azimuths each, windows of 51 px.
const GRID: (usize, usize, usize) = (21, 36, 51);
/// Sampled tiles along each side of the film.
const SAMPLED_TILES: usize = 9;
/// Wavelength of the lens's band that is measured.
const LENS_NM: f64 = 550.0;
/// Share of the job's memory that a run uses for node spectra, approximately.
const SPECTRA_SHARE: f64 = 0.5;

pub(super) fn measure(bench: &mut Bench<'_>) -> Result<()> {
    let film = Size::new(bench.args.film_size as usize, bench.args.film_size as usize);
    let frame = Frame::centred(film, film, FILM_MM * 1e3 / f64::from(bench.args.film_size));
    peak(bench)?;
    let bicubic_remap = stages(bench, &frame, false, Interp::Bicubic)?.remap;
    let bilinear_remap = stages(bench, &frame, false, Interp::Bilinear)?.remap;
    let (_, lens) = lens_stages(bench, &frame)?;

    let bicubic = remap(bench, &frame, &bicubic_remap)?;
    bench.add_number("remap_mpx_s", bicubic, "Mpx/s", "RI + distortion remap, bicubic");
    let bilinear = remap(bench, &frame, &bilinear_remap)?;
    bench.add_number("remap_bilinear_mpx_s", bilinear, "Mpx/s", "RI + distortion remap, bilinear");

    let rate = sampled_tiles(bench, &frame, &benchmark(&frame, bench.simd, GRID.2), bench.threads)?;
    bench.add_number("svpsf_mpx_s", rate, "Mpx/s", "SVPSF, benchmark grid (21 x 36 nodes, 51 px)");
    let rate = sampled_tiles(bench, &frame, &benchmark(&frame, bench.simd, GRID.2), 1)?;
    bench.add_number("svpsf_1_thread_mpx_s", rate, "Mpx/s", "  one thread");
    let rate = sampled_tiles(bench, &frame, &benchmark(&frame, Simd::PORTABLE, GRID.2), bench.threads)?;
    bench.add_number("svpsf_portable_mpx_s", rate, "Mpx/s", "  portable path");
    let rate = strided(bench, &frame)?;
    bench.add_number(
        "svpsf_strided_mpx_s",
        rate,
        "Mpx/s",
        "  the paper's strided multiply-accumulate, one thread",
    );
    let rate = complete_film(bench, &frame, &lens)?;
    let label = format!(
        "SVPSF, lens at {LENS_NM} nm ({} nodes, {} px), with kernels",
        lens.grid().len(),
        lens.kernels().size()
    );
    bench.add_number("svpsf_lens_mpx_s", rate, "Mpx/s", &label);
    let rate = kernels(bench, &lens)?;
    bench.add_number("kernels_per_s", rate, "1/s", "  rotation and integration of its kernels, one thread");
    super::bounds::measure(bench, lens.blocks())
}

/// Stages of the lens's band.
fn stages(bench: &Bench<'_>, frame: &Frame, svpsf: bool, interp: Interp) -> Result<BandStages> {
    let options = Options {
        stages: if svpsf { default_stages() } else { default_stages().without(Stage::Svpsf) },
        interpolation: ChartInterpolation { interp, surround: Surround::Edge, outside: Outside::Clamp },
        azimuths: None,
        psf_window: None,
        between: PsfBetween::Interpolate,
        simd: bench.simd,
    };
    let lens = JobLens::new(
        UntracedLens::open(&bench.args.lens)?,
        frame,
        &[LENS_NM],
        &options,
        bench.threads,
        None,
    )?;
    let plan = BandPlan::new(frame, lens.lens(), LENS_NM, &options)?;
    let sets = plan.psf_sets(frame);
    plan.stages(0, frame, &options, 1.0, |band| {
        anyhow::Ok(lens.planned_psfs(&plan, band, sets, bench.threads)?)
    })
}

/// Remap and PSF stage of the lens's band.
pub(super) fn lens_stages(bench: &Bench<'_>, frame: &Frame) -> Result<(Arc<Remap>, Arc<BandPsf>)> {
    let all = stages(bench, frame, true, Interp::Bicubic)?;
    Ok((all.remap, all.psf.context("the lens has no PSF to measure")?))
}

fn peak(bench: &mut Bench<'_>) -> Result<()> {
    const ROUNDS: usize = 200_000;
    let per_thread = bench.median(|| {
        let start = std::time::Instant::now();
        let done = fused_multiply_adds(bench.simd, ROUNDS);
        Ok(2.0 * done as f64 / start.elapsed().as_secs_f64())
    })?;
    bench.add_number("fma_gflop_s", per_thread * 1e-9, "GFLOP/s", "multiply-add peak, one thread");
    Ok(())
}

/// Tiles of `side` px of the film.
fn tiles(frame: &Frame, side: usize) -> Vec<Rect> {
    frame.film.rect().tiles(side, side).collect()
}

/// Calls `work` for every index below `count` on `threads` threads, each with its own state.
fn parallel<S>(
    threads: usize,
    count: usize,
    state: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, usize) + Sync,
) {
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                let mut state = state();
                loop {
                    match next.fetch_add(1, Ordering::Relaxed) {
                        i if i < count => work(&mut state, i),
                        _ => return,
                    }
                }
            });
        }
    });
}

/// Chart in memory: one square repeated periodically.
struct Repeated(Size, Vec<f32>);

impl Repeated {
    const SIDE: usize = 1024;

    fn new(size: Size) -> Self {
        Self(size, (0..2 * Self::SIDE * Self::SIDE).map(sample_value).collect())
    }
}

impl ChartSource for Repeated {
    fn size(&self) -> Size {
        self.0
    }

    fn read(&self, _band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        for (y, line) in out.chunks_exact_mut(rect.width).enumerate() {
            let row = (rect.y as usize + y) % Self::SIDE;
            for (part, to) in line.chunks_mut(Self::SIDE).enumerate() {
                let col = (rect.x as usize + part * Self::SIDE) % Self::SIDE;
                to.copy_from_slice(&self.1[row * 2 * Self::SIDE + col..][..to.len()]);
            }
        }
        Ok(())
    }
}

fn sample_value(i: usize) -> f32 {
    0.1 + (i * 7919 % 1009) as f32 / 1009.0
}

fn remap(bench: &Bench<'_>, frame: &Frame, remap: &Remap) -> Result<f64> {
    let chart = Repeated::new(frame.film);
    let tiles = tiles(frame, 512);
    let pixels = frame.film.pixels() as f64 * 1e-6;
    bench.rate(pixels, || {
        let state = || (RemapScratch::default(), vec![0.0; 512 * 512]);
        parallel(bench.threads, tiles.len(), state, |(scratch, out), i| {
            let out = &mut out[..tiles[i].size().pixels()];
            remap.apply(&chart, 0, tiles[i], out, scratch).expect("a chart in memory can be read");
        });
        Ok(())
    })
}

fn benchmark_kernels(frame: &Frame, simd: Simd, window: usize) -> (NodeGrid, NodeKernels) {
    let (heights, azimuths, _) = GRID;
    let farthest_mm = 20.0 * FILM_MM / 28.282;
    let height_mm: Vec<f64> = (0..heights).map(|k| farthest_mm * k as f64 / (heights - 1) as f64).collect();
    let counts: Vec<usize> = (0..heights).map(|k| if k == 0 { 1 } else { azimuths }).collect();
    let c = (window / 2) as f32;
    let kernel = (0..window * window).map(|i| {
        let (y, x) = ((i / window) as f32 - c, (i % window) as f32 - c - 2.0);
        (-(y * y + 2.0 * x * x) / window as f32).exp() + 1e-4
    });
    let kernel: Vec<f32> = kernel.collect();
    let stack = PsfStack {
        size: window,
        pitch_um: frame.pitch_um,
        sample: PsfSample::Integrated,
        samples: kernel.repeat(heights),
    };
    (
        NodeGrid::new(&height_mm, &counts, frame.pitch_mm()),
        NodeKernels::new(&stack, frame.pitch_um, None, simd),
    )
}

/// PSF stage on the benchmark grid with windows of `window` px.
pub(super) fn benchmark(frame: &Frame, simd: Simd, window: usize) -> BandPsf {
    let (grid, kernels) = benchmark_kernels(frame, simd, window);
    BandPsf::new(0, grid, kernels, simd)
}

/// Rate on tiles evenly spaced over the film, with all spectra in memory.
fn sampled_tiles(bench: &Bench<'_>, frame: &Frame, psf: &BandPsf, threads: usize) -> Result<f64> {
    let side = psf.blocks().tile.min(frame.film.height);
    let at = |i: usize| ((frame.film.height - side) * i / (SAMPLED_TILES - 1)) as i64;
    let rects: Vec<Rect> = (0..SAMPLED_TILES * SAMPLED_TILES)
        .map(|i| Rect::new(at(i / SAMPLED_TILES), at(i % SAMPLED_TILES), side, side))
        .collect();
    let remap: Vec<f32> = (0..side * side).map(sample_value).collect();
    let cache = SpectrumCache::new(usize::MAX);
    let state = <(TileBuffer, PsfScratch)>::default;
    let work = |(out, scratch): &mut (TileBuffer, PsfScratch), i: usize| {
        psf.scatter(frame, rects[i], &remap, &cache, out, scratch);
    };
    parallel(threads, rects.len(), state, work);
    bench.rate((rects.len() * side * side) as f64 * 1e-6, || {
        parallel(threads, rects.len(), state, work);
        Ok(())
    })
}

/// Rate on the complete film in the tile order of a run, from an empty, bounded cache, including kernels and spectra.
fn complete_film(bench: &Bench<'_>, frame: &Frame, psf: &BandPsf) -> Result<f64> {
    let tiles = tiles(frame, psf.blocks().tile.max(1));
    let side = tiles.iter().map(|t| t.size().pixels()).max().unwrap_or(0);
    let remap: Vec<f32> = (0..side).map(sample_value).collect();
    bench.rate(frame.film.pixels() as f64 * 1e-6, || {
        let cache = SpectrumCache::new((bench.args.memory as f64 * SPECTRA_SHARE) as usize);
        let state = <(TileBuffer, PsfScratch)>::default;
        parallel(bench.threads, tiles.len(), state, |(out, scratch), i| {
            psf.scatter(frame, tiles[i], &remap[..tiles[i].size().pixels()], &cache, out, scratch);
        });
        Ok(())
    })
}

fn strided(bench: &Bench<'_>, frame: &Frame) -> Result<f64> {
    let (grid, kernels) = benchmark_kernels(frame, bench.simd, GRID.2);
    let third = (frame.film.height / 3) as i64;
    let tile = Rect::new(third, third, 153, 153);
    let remap: Vec<f32> = (0..tile.size().pixels()).map(sample_value).collect();
    let mut film = vec![0.0; (tile.height + kernels.size() - 1) * (tile.width + kernels.size() - 1)];
    let baseline = Strided::new(frame, &grid, &kernels, tile);
    bench.rate(tile.size().pixels() as f64 * 1e-6, || {
        film.fill(0.0);
        baseline.scatter(tile, &remap, &mut film, bench.simd);
        Ok(())
    })
}

/// Kernels per second, for nodes from all heights of the grid.
fn kernels(bench: &Bench<'_>, psf: &BandPsf) -> Result<f64> {
    use pipeline::psf::grid::Node;
    let counts = psf.grid().azimuths();
    let nodes: Vec<Node> = (0..counts.len())
        .flat_map(|k| (0..counts[k]).step_by(counts[k].div_ceil(3)).map(move |j| Node { k, j }))
        .collect();
    let mut out = vec![0.0; psf.kernels().size().pow(2)];
    let mut scratch = pipeline::psf::kernel::KernelScratch::default();
    bench.rate(nodes.len() as f64, || {
        for node in &nodes {
            psf.kernels().kernel(psf.grid(), *node, &mut scratch, &mut out);
        }
        Ok(())
    })
}
