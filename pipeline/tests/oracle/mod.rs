//! Reference implementation: the model as direct f64 sums of its equations, with which every engine is compared.
//! Conventions as in `pipeline::geometry`.
#![allow(dead_code, reason = "each test binary uses its part")]

use lenscube_pipeline::band::{Options, PsfBetween};
use lenscube_pipeline::geometry::{Frame, Rect, Size};
use lenscube_pipeline::lens::{Lens, LensBand, PsfSample};
use lenscube_pipeline::remap::ChartInterpolation;
use lenscube_pipeline::resample::{Interp, Surround};
use lenscube_pipeline::simd::{Isa, Simd};
use lenscube_pipeline::stage::Stages;
use libtest_mimic::{Arguments, Trial};
use std::f64::consts::TAU;
use std::process::ExitCode;

/// An image of f64 values, row-major.
#[derive(Clone, Debug)]
pub struct Image {
    pub size: Size,
    pub data: Vec<f64>,
}

impl Image {
    pub fn new(size: Size, f: impl Fn(usize, usize) -> f64) -> Self {
        let data = (0..size.pixels()).map(|i| f(i / size.width, i % size.width)).collect();
        Self { size, data }
    }

    pub fn at(&self, y: usize, x: usize) -> f64 {
        self.data[y * self.size.width + x]
    }
}

/// A lens of 50 mm at F/2.
pub fn lens(name: &str, bands: Vec<LensBand>) -> Lens {
    Lens {
        name: name.into(),
        distortion_focal_length_mm: 50.0,
        effective_focal_length_mm: 50.0,
        f_number: 2.0,
        primary_wavelength_nm: 550.0,
        object_distance_mm: None,
        magnification: 0.0,
        psf_sample: PsfSample::Integrated,
        bands,
        depth: None,
    }
}

/// Options of a run without flags, of some stages.
pub fn options(stages: Stages, simd: Simd) -> Options {
    Options {
        stages,
        interpolation: ChartInterpolation {
            interp: Interp::Bicubic,
            surround: Surround::Edge,
            outside: lenscube_pipeline::field::Outside::Error,
        },
        azimuths: None,
        psf_window: None,
        between: PsfBetween::Error,
        simd,
    }
}

/// Pseudo-random numbers (xorshift64*).
pub struct Noise(pub u64);

impl Noise {
    pub fn next(&mut self) -> f64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    pub fn below(&mut self, n: usize) -> usize {
        (self.next() * n as f64) as usize
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outside {
    Edge,
    Black,
    Mirror,
}

fn fetch(img: &Image, y: i64, x: i64, outside: Outside) -> f64 {
    let (h, w) = (img.size.height as i64, img.size.width as i64);
    let inside = y >= 0 && y < h && x >= 0 && x < w;
    let fold = |v: i64, n: i64| {
        let v = v.rem_euclid(2 * n);
        v.min(2 * n - 1 - v)
    };
    match outside {
        Outside::Black if !inside => 0.0,
        Outside::Mirror => img.at(fold(y, h) as usize, fold(x, w) as usize),
        _ => img.at(y.clamp(0, h - 1) as usize, x.clamp(0, w - 1) as usize),
    }
}

/// Interpolation weight at distance `d`: Keys' cubic with a = −1/2 (Catmull-Rom), or linear.
fn tap(d: f64, cubic: bool) -> f64 {
    let d = d.abs();
    match (cubic, d) {
        (false, d) => (1.0 - d).max(0.0),
        (true, d) if d <= 1.0 => 1.5 * d.powi(3) - 2.5 * d * d + 1.0,
        (true, d) if d < 2.0 => -0.5 * d.powi(3) + 2.5 * d * d - 4.0 * d + 2.0,
        _ => 0.0,
    }
}

fn sample(img: &Image, y: f64, x: f64, cubic: bool, outside: Outside) -> f64 {
    let mut sum = 0.0;
    for iy in y.floor() as i64 - 1..=y.floor() as i64 + 2 {
        for ix in x.floor() as i64 - 1..=x.floor() as i64 + 2 {
            let w = tap(y - iy as f64, cubic) * tap(x - ix as f64, cubic);
            if w != 0.0 {
                sum += w * fetch(img, iy, ix, outside);
            }
        }
    }
    sum
}

/// Mean of the image over a box centred on (y, x); each pixel is a constant square.
fn box_mean(img: &Image, y: f64, x: f64, by: f64, bx: f64, outside: Outside) -> f64 {
    let overlap = |i: i64, centre: f64, b: f64| {
        ((i as f64 + 0.5).min(centre + b / 2.0) - (i as f64 - 0.5).max(centre - b / 2.0)).max(0.0)
    };
    let range =
        |centre: f64, b: f64| (centre - b / 2.0).floor() as i64 - 1..=(centre + b / 2.0).ceil() as i64 + 1;
    let mut sum = 0.0;
    for iy in range(y, by) {
        for ix in range(x, bx) {
            let w = overlap(iy, y, by) * overlap(ix, x, bx);
            if w > 0.0 {
                sum += w * fetch(img, iy, ix, outside);
            }
        }
    }
    sum / (by * bx)
}

fn lookup(at: f64, xs: &[f64], ys: &[f64]) -> f64 {
    let i = xs.partition_point(|&x| x <= at).clamp(1, xs.len() - 1);
    let u = ((at - xs[i - 1]) / (xs[i] - xs[i - 1])).clamp(0.0, 1.0);
    ys[i - 1] + u * (ys[i] - ys[i - 1])
}

/// Field tables: ideal height, real image height, relative illumination.
pub struct Tables<'a> {
    pub ideal: &'a [f64],
    pub real: &'a [f64],
    pub ri: &'a [f64],
}

/// Remap stage on the film rectangle `rect` (which may reach beyond the film).
pub fn remap(
    chart: &Image,
    frame: &Frame,
    t: &Tables<'_>,
    rect: Rect,
    cubic: bool,
    outside: Outside,
) -> Image {
    let pitch = frame.pitch_mm();
    Image::new(rect.size(), |row, col| {
        let y = (rect.y as f64 + row as f64 - frame.axis_px.0) * pitch;
        let x = (rect.x as f64 + col as f64 - frame.axis_px.1) * pitch;
        let r = y.hypot(x).min(*t.real.last().unwrap());
        let mag = if r > 0.0 { lookup(r, t.real, t.ideal) / r } else { t.ideal[1] / t.real[1] };
        let (sy, sx) = frame.scale;
        let cy = (chart.size.height as f64 - 1.0) / 2.0 + (y * mag - frame.center_mm.0) / (pitch * sy);
        let cx = (chart.size.width as f64 - 1.0) / 2.0 + (x * mag - frame.center_mm.1) / (pitch * sx);
        let value = match sy.min(sx) < 1.0 {
            true => box_mean(chart, cy, cx, (1.0 / sy).max(1.0), (1.0 / sx).max(1.0), outside),
            false => sample(chart, cy, cx, cubic, outside),
        };
        lookup(r, t.real, t.ri) * value
    })
}

/// A lens with field points of real image height `real` mm, the last r₁: h = r·(paraxial + bend·(r/r₁)²), R = 1 − 0.4·(r/r₁)², a PSF
/// of one sample.
pub fn lens_band(real: Vec<f64>, paraxial: f64, bend: f64) -> LensBand {
    let last = real[real.len() - 1];
    LensBand {
        ideal_height_mm: real.iter().map(|r| r * (paraxial + bend * (r / last).powi(2))).collect(),
        relative_illumination: real.iter().map(|r| 1.0 - 0.4 * (r / last).powi(2)).collect(),
        ..LensBand::ideal(550.0, real)
    }
}

/// A polar grid of kernels: `kernels[k][j]`, n × n each.
pub struct Grid {
    pub n: usize,
    pub heights_mm: Vec<f64>,
    pub kernels: Vec<Vec<Vec<f64>>>,
}

impl Grid {
    /// `base[k]` at J = 4 azimuths each (1 on the axis), rotated by exact quarter turns from +x to +y (down).
    pub fn quarter_turns(n: usize, heights_mm: &[f64], base: &[Vec<f64>]) -> Self {
        let rotated = |b: &[f64], j: usize| -> Vec<f64> {
            let mut k = b.to_vec();
            for _ in 0..j {
                k = (0..n * n).map(|i| k[(n - 1 - i % n) * n + i / n]).collect();
            }
            k
        };
        let ring = |k: usize| (0..if k == 0 { 1 } else { 4 }).map(|j| rotated(&base[k], j)).collect();
        Self { n, heights_mm: heights_mm.to_vec(), kernels: (0..base.len()).map(ring).collect() }
    }

    /// The nodes (k, j) of a pixel with their weights: up to four are not 0.
    pub fn weights(&self, dy_mm: f64, dx_mm: f64) -> Vec<(usize, usize, f64)> {
        let r = dy_mm.hypot(dx_mm);
        let theta = dy_mm.atan2(dx_mm).rem_euclid(TAU);
        let last = self.heights_mm.len() - 1;
        let k = (self.heights_mm.partition_point(|&h| h <= r).max(1) - 1).min(last - 1);
        let u = ((r - self.heights_mm[k]) / (self.heights_mm[k + 1] - self.heights_mm[k])).clamp(0.0, 1.0);
        let mut out = Vec::new();
        for (k, w) in [(k, 1.0 - u), (k + 1, u)] {
            let count = self.kernels[k].len();
            let a = theta * count as f64 / TAU;
            let v = a - a.floor();
            let j = a.floor() as usize % count;
            out.push((k, j, w * (1.0 - v)));
            out.push((k, (j + 1) % count, w * v));
        }
        out
    }
}

/// PSF stage: the film rectangle `film`, the sum of the PSFs of all pixels of `remap`, whose first pixel is `origin` on the film.
pub fn svpsf(remap: &Image, origin: (i64, i64), frame: &Frame, grid: &Grid, film: Rect) -> Image {
    let (n, c) = (grid.n as i64, grid.n as i64 / 2);
    let mut out = Image::new(film.size(), |_, _| 0.0);
    for row in 0..remap.size.height {
        for col in 0..remap.size.width {
            let value = remap.at(row, col);
            let (y, x) = (origin.0 + row as i64, origin.1 + col as i64);
            let pitch = frame.pitch_mm();
            let shares =
                grid.weights((y as f64 - frame.axis_px.0) * pitch, (x as f64 - frame.axis_px.1) * pitch);
            for (k, j, w) in shares {
                if w * value == 0.0 {
                    continue;
                }
                let kernel = &grid.kernels[k][j];
                for dy in 0..n {
                    let ty = y - c + dy - film.y;
                    if ty < 0 || ty >= film.height as i64 {
                        continue;
                    }
                    for dx in 0..n {
                        let tx = x - c + dx - film.x;
                        if tx >= 0 && tx < film.width as i64 {
                            out.data[ty as usize * film.width + tx as usize] +=
                                value * w * kernel[(dy * n + dx) as usize];
                        }
                    }
                }
            }
        }
    }
    out
}

/// (maximum |difference| relative to the peak of `expected`, relative L2).
pub fn errors(got: &[f32], expected: &[f64]) -> (f64, f64) {
    assert_eq!(got.len(), expected.len());
    let peak = expected.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let (mut worst, mut d2, mut w2) = (0.0f64, 0.0, 0.0);
    for (g, w) in got.iter().zip(expected) {
        let d = (f64::from(*g) - w).abs();
        assert!(d.is_finite(), "NaN or infinity in the film");
        worst = worst.max(d);
        d2 += d * d;
        w2 += w * w;
    }
    (worst / peak, (d2 / w2).sqrt())
}

/// A check of one instruction set.
pub type Check = fn(Simd);

/// Runs every check on every instruction set; sets that the machine lacks are reported as ignored.
pub fn on_every_isa(checks: &[(&'static str, Check)]) -> ExitCode {
    let mut trials = Vec::new();
    for isa in Isa::ALL {
        for &(name, check) in checks {
            let run = move || {
                check(Simd::require(isa)?);
                Ok(())
            };
            let trial = Trial::test(format!("{}::{name}", isa.name()), run);
            trials.push(trial.with_ignored_flag(!isa.is_available()));
        }
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}
