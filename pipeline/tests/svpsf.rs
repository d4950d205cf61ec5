//! SVPSF against the f64 sum: any window, grid, axis; every engine of this machine.

mod oracle;

use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::{PsfSample, PsfStack};
use lenscube_pipeline::psf::grid::NodeGrid;
use lenscube_pipeline::psf::kernel::NodeKernels;
use lenscube_pipeline::psf::spectra::SpectrumCache;
use lenscube_pipeline::psf::{BandPsf, PsfScratch, Scattered};
use lenscube_pipeline::simd::Simd;
use oracle::{Grid, Image, Noise, errors};

/// Random, asymmetric windows of sum 1.
fn stack(noise: &mut Noise, n: usize, heights: usize) -> PsfStack {
    let c = (n as f64 - 1.0) / 2.0;
    let mut samples = Vec::new();
    for k in 0..heights {
        let width = 0.15 * n as f64 + 0.5;
        let w: Vec<f64> = (0..n * n)
            .map(|i| {
                let (y, x) = ((i / n) as f64 - c, (i % n) as f64 - c - 0.1 * k as f64);
                (-(x * x + 1.7 * y * y + 0.4 * x * y) / (2.0 * width * width)).exp() * noise.between(0.5, 1.5)
            })
            .collect();
        let sum: f64 = w.iter().sum();
        samples.extend(w.iter().map(|v| (v / sum) as f32));
    }
    PsfStack { size: n, pitch_um: 2.0, sample: PsfSample::Integrated, samples }
}

/// The whole film of `frame` from `scene` on the film grown by the margin, tile by tile.
fn film(psf: &BandPsf, frame: &Frame, scene: &Image) -> Vec<f32> {
    let m = psf.margin();
    let grown = frame.film.rect().grown(m);
    let cache = SpectrumCache::new(64 << 20);
    let (mut out, mut scratch) = (Scattered::default(), PsfScratch::default());
    let mut film = vec![0f32; frame.film.pixels()];
    for tile in grown.tiles(psf.blocks().tile, psf.blocks().tile) {
        let pixels: Vec<f32> = (0..tile.size().pixels())
            .map(|i| {
                let (y, x) = (tile.y - grown.y, tile.x - grown.x);
                scene.at(y as usize + i / tile.width, x as usize + i % tile.width) as f32
            })
            .collect();
        psf.scatter(frame, tile, &pixels, &cache, &mut out, &mut scratch);
        let reach = psf.reaches(tile);
        let on_film = reach.intersect(frame.film.rect());
        for y in on_film.y..on_film.bottom() {
            for x in on_film.x..on_film.right() {
                film[y as usize * frame.film.width + x as usize] +=
                    out.data[(y - reach.y) as usize * out.stride + (x - reach.x) as usize];
            }
        }
    }
    film
}

fn check(noise: &mut Noise, n: usize, heights_mm: &[f64], size: Size, axis_px: (f64, f64)) {
    let stack = stack(noise, n, heights_mm.len());
    let base: Vec<Vec<f64>> =
        (0..heights_mm.len()).map(|k| stack.window(k).iter().map(|&v| f64::from(v)).collect()).collect();
    let mut counts = vec![4; heights_mm.len()];
    counts[0] = 1;
    let frame = Frame { axis_px, ..Frame::centred(size, size, 2.0) };
    let grid = NodeGrid::new(heights_mm, &counts, frame.pitch_mm());
    let simd = Simd::from_env().expect("a choice this machine can run");
    let psf = BandPsf::new(0, grid, NodeKernels::new(&stack, 2.0, None), simd);
    let grown = size.rect().grown(psf.margin());
    let pixels: Vec<f64> = (0..grown.size().pixels())
        .map(|i| if i % 977 == 0 { 50.0 } else { f64::from(noise.next() as f32) })
        .collect();
    let scene = Image { size: grown.size(), data: pixels };
    let got = film(&psf, &frame, &scene);
    let want = oracle::svpsf(
        &scene,
        (grown.y, grown.x),
        &frame,
        &Grid::quarter_turns(n, heights_mm, &base),
        Rect::new(0, 0, size.height, size.width),
    );
    let (worst, l2) = errors(&got, &want.data);
    println!("n {n}, film {size}, F {}: max {worst:.1e} of the peak, L2 {l2:.1e}", psf.blocks().fft);
    assert!(worst <= 2e-6 && l2 <= 1e-6, "n {n}, film {size}: max {worst:.1e}, L2 {l2:.1e}");
}

#[test]
fn film_equals_the_sum_over_pixels() {
    let mut noise = Noise(7);
    let corner = |size: Size, axis: (f64, f64), margin: usize| {
        let frame = Frame { axis_px: axis, ..Frame::centred(size, size, 2.0) };
        frame.farthest_mm(size.rect().grown(margin))
    };
    for (n, size, axis) in [
        (15, Size::new(61, 77), (30.0, 38.0)),
        (15, Size::new(300, 211), (149.5, 105.0)),
        (51, Size::new(200, 333), (20.3, 301.7)),
        (3, Size::new(64, 600), (-40.0, 10.25)),
        (1, Size::new(33, 45), (16.0, 22.0)),
        (33, Size::new(1, 1), (0.0, 0.0)),
        (25, Size::new(130, 120), (-900.0, 5000.5)),
    ] {
        let last = corner(size, axis, n / 2);
        for heights in [vec![0.0, last], vec![0.0, 0.11 * last, 0.17 * last, 0.6 * last, 0.95 * last, last]] {
            check(&mut noise, n, &heights, size, axis);
        }
    }
}

#[test]
fn wide_windows_too() {
    let mut noise = Noise(11);
    let size = Size::new(40, 50);
    check(&mut noise, 151, &[0.0, 0.1, 0.3], size, (19.5, 24.5));
    check(&mut noise, 401, &[0.0, 0.5, 1.0], Size::new(20, 30), (9.5, 14.5));
}
