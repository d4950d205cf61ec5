//! Reference lens: expected relative illumination, distortion and PSF, independent of the code that makes films (its tables,
//! kernels and remap).
//!
//! A design is traced at the requested field point: chief ray, light per film area, Huygens PSF. A pack is interpolated
//! linearly in its tables, and its PSFs linearly between the two neighbouring heights, as the model prescribes.

use crate::args::CoatingsArg;
use crate::failure::usage;
use crate::job::lens::UntracedLens;
use anyhow::Result;
use formats::lens::LensPack;
use pipeline::design::System;
use pipeline::design::film_pixel::FilmPixels;
use pipeline::design::illumination::irradiance_sr;
use pipeline::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use pipeline::design::ray::Tracer;
use pipeline::figures::PsfWindow;
use pipeline::lens::{LensBand, PsfSample, PsfStack, linear, tail};
use pipeline::measure::expected::Share;
use std::sync::Arc;

/// Largest difference of wavelengths that count as equal, nm.
const WAVELENGTH_TOLERANCE_NM: f64 = 1e-6;

/// Side of the PSF with its light beyond a window, windows.
pub const BEYOND_WINDOWS: usize = 3;

/// Lens that films are compared with.
pub enum ReferenceLens {
    Pack(Arc<LensPack>),
    Design(Box<System>),
}

/// Reference lens at one wavelength.
pub enum ReferenceBand<'a> {
    /// Tables and PSFs of a pack.
    Table { band: &'a LensBand, stack: PsfStack },
    /// Ray tracer of a design.
    Traced {
        tracer: Box<Tracer<'a>>,
        /// Irradiance of the film on the axis over radiance of the object, sr.
        axis_sr: f64,
    },
}

/// PSF of a field point on +x as light shares, distances in film pixels from the chief ray.
#[derive(Clone, Debug)]
pub struct Psf {
    pub shares: Vec<Share>,
    /// Sample pitch, film pixels.
    pub step_px: f64,
    /// Whether each sample is a mean over the square of its pitch.
    pub integrated: bool,
}

/// The light of a PSF beyond a window.
#[derive(Clone, Debug)]
pub struct Beyond {
    /// Share of the light in the window.
    pub inside: f64,
    /// Shares of entire film pixels beyond the window, on the film's axes, up to [`BEYOND_WINDOWS`] windows a side.
    pub shares: Vec<Share>,
}

impl Default for Beyond {
    fn default() -> Self {
        Self { inside: 1.0, shares: Vec::new() }
    }
}

impl ReferenceLens {
    /// Opens a pack, or a design with `coatings`.
    pub fn open(name: &str, coatings: &CoatingsArg) -> Result<Self> {
        Ok(match UntracedLens::open_coated(name, coatings)? {
            UntracedLens::Pack(pack) => Self::Pack(pack),
            UntracedLens::Design(design) => Self::Design(Box::new(design.system)),
        })
    }

    /// Kind of data, for the report.
    pub fn description(&self) -> &'static str {
        match self {
            Self::Pack(_) => "tables of the lens pack",
            Self::Design(_) => "prescription, traced at each field point",
        }
    }

    /// Band at `nm`; an error if a pack has none within [`WAVELENGTH_TOLERANCE_NM`].
    pub fn band(&self, nm: f64) -> Result<ReferenceBand<'_>> {
        Ok(match self {
            Self::Pack(pack) => {
                let bands = &pack.lens().bands;
                let found = bands.iter().position(|b| (b.wavelength_nm - nm).abs() < WAVELENGTH_TOLERANCE_NM);
                let all: Vec<f64> = bands.iter().map(|b| b.wavelength_nm).collect();
                let Some(index) = found else {
                    return Err(usage(format!(
                        "{} has no band at {nm} nm to compare with; choose `--wavelengths` from {} nm",
                        pack.path().display(),
                        pipeline::wavelengths::format(&all)
                    )));
                };
                ReferenceBand::Table { band: &bands[index], stack: pack.psf(index)? }
            }
            Self::Design(system) => {
                let tracer = Tracer::new(system, nm / 1e3)?;
                let axis_sr = irradiance_sr(&tracer, 0.0)?;
                ReferenceBand::Traced { tracer: Box::new(tracer), axis_sr }
            }
        })
    }
}

impl ReferenceBand<'_> {
    /// Ideal height, mm, of the field point whose chief ray has the REAL height `real_mm`.
    pub fn ideal_mm(&self, real_mm: f64) -> Result<f64> {
        Ok(match self {
            Self::Table { band, .. } => band.ideal_height_at(real_mm),
            Self::Traced { tracer, .. } => tracer.field_of_height(real_mm)? * tracer.ideal_scale_mm(),
        })
    }

    /// REAL height, mm, of the field point at `ideal_mm`.
    pub fn real_mm(&self, ideal_mm: f64) -> Result<f64> {
        Ok(match self {
            Self::Table { band, .. } => band.real_height_at(ideal_mm),
            Self::Traced { tracer, .. } => tracer.chief_height_mm(ideal_mm / tracer.ideal_scale_mm())?,
        })
    }

    /// Relative illumination at REAL height `real_mm`.
    pub fn illumination(&self, real_mm: f64) -> Result<f64> {
        Ok(match self {
            Self::Table { band, .. } => band.illumination_at(real_mm),
            Self::Traced { tracer, axis_sr } => {
                irradiance_sr(tracer, tracer.field_of_height(real_mm)?)? / axis_sr
            }
        })
    }

    /// PSF at REAL height `real_mm`; a design is traced over a window of at most `window_px` film pixels of `pitch_um`.
    pub fn psf(&self, real_mm: f64, window_px: usize, pitch_um: f64) -> Result<Psf> {
        match self {
            Self::Table { band, stack } => Ok(Psf::from_window(&band.psf_at(stack, real_mm), pitch_um)),
            Self::Traced { .. } => {
                let (samples, n, step_px) = self.traced(real_mm, 0.0, window_px, pitch_um)?;
                Ok(Psf { shares: shares(&samples, n, step_px), step_px, integrated: false })
            }
        }
    }

    /// PSF at `azimuth_rad` on the film's axes: shares of entire film pixels in a window of `window_px` of them, with sum 1.
    pub fn pixels(
        &self,
        real_mm: f64,
        azimuth_rad: f64,
        window_px: usize,
        pitch_um: f64,
    ) -> Result<Vec<Share>> {
        let mut out = match self {
            Self::Table { .. } => {
                self.psf(real_mm, window_px, pitch_um)?.cropped(window_px, azimuth_rad).in_pixels(azimuth_rad)
            }
            Self::Traced { .. } => {
                // Traced at the azimuth; samples outside the rotated square of the window are cropped as in a run.
                let (mut samples, n, step) = self.traced(real_mm, azimuth_rad, window_px, pitch_um)?;
                let (sin, cos) = azimuth_rad.sin_cos();
                let half = n as f64 * step / 2.0;
                for (((y, x), _), v) in shares(&samples.clone(), n, step).iter().zip(&mut samples) {
                    if (x * cos + y * sin).abs() > half || (y * cos - x * sin).abs() > half {
                        *v = 0.0;
                    }
                }
                let pixels = FilmPixels::new(n, step, window_px, 1.0).integrate(&samples);
                shares(&pixels, window_px, 1.0)
            }
        };
        let sum: f64 = out.iter().map(|s| s.1).sum();
        out.iter_mut().for_each(|s| s.1 /= sum);
        Ok(out)
    }

    /// The light of the PSF at `azimuth_rad` beyond the window of `window_px` film pixels; a design is traced over [`BEYOND_WINDOWS`] windows a side.
    pub fn beyond(&self, real_mm: f64, azimuth_rad: f64, window_px: usize, pitch_um: f64) -> Result<Beyond> {
        let half = window_px as f64 / 2.0;
        let (sin, cos) = azimuth_rad.sin_cos();
        let along = |(y, x): (f64, f64)| (y * cos - x * sin, x * cos + y * sin);
        let is_inside = |at: (f64, f64)| {
            let turned = along(at);
            [at.0, at.1, turned.0, turned.1].iter().all(|v| v.abs() <= half)
        };
        let wide_px = BEYOND_WINDOWS * window_px;
        match self {
            Self::Table { band, .. } => {
                let Some(tail) = &band.tail else { return Ok(Beyond::default()) };
                let (c, pitch_mm) = (tail.at(real_mm), pitch_um * 1e-3);
                let pixels = shares(&vec![0.0; wide_px * wide_px], wide_px, 1.0);
                let shares = pixels.into_iter().filter(|(at, _)| !is_inside(*at)).map(|(at, _)| {
                    let (y, x) = along(at);
                    let (x_mm, y_mm) = (x * pitch_mm, y * pitch_mm);
                    let irradiance =
                        tail::value(&c, tail.inner_mm, x_mm, y_mm) + tail.middle_density(real_mm, x_mm, y_mm);
                    (at, irradiance * pitch_mm * pitch_mm)
                });
                let energy = linear(&band.psf_height_mm, &band.psf_energy, real_mm);
                Ok(Beyond { inside: energy, shares: shares.collect() })
            }
            Self::Traced { .. } => {
                let (mut samples, n, step) = self.traced(real_mm, azimuth_rad, wide_px, pitch_um)?;
                let mut inside = 0.0;
                for (v, (at, _)) in samples.iter_mut().zip(shares(&vec![0.0; n * n], n, step)) {
                    if is_inside(at) {
                        inside += std::mem::take(v);
                    }
                }
                let pixels = FilmPixels::new(n, step, wide_px, 1.0).integrate(&samples);
                Ok(Beyond { inside, shares: shares(&pixels, wide_px, 1.0) })
            }
        }
    }

    /// Samples of the traced PSF, their number along a side and their pitch in film pixels: a tenth finer than
    /// Nyquist with an integer number of samples per film pixel.
    fn traced(
        &self,
        real_mm: f64,
        azimuth_rad: f64,
        window_px: usize,
        pitch_um: f64,
    ) -> Result<(Vec<f64>, usize, f64)> {
        let Self::Traced { tracer, .. } = self else { unreachable!("only a design is traced") };
        let pupil = PupilFunction::trace(tracer, tracer.field_of_height(real_mm)?)?;
        let per_px = (pitch_um / (0.9 * pupil.nyquist_um())).ceil();
        let half = ((window_px as f64 * per_px - 1.0 + 1e-9) / 2.0).floor() as usize;
        let grid = PsfGrid::new(half, pitch_um / per_px);
        Ok((grid.psf(&pupil, azimuth_rad, &mut PsfScratch::default()), grid.size(), 1.0 / per_px))
    }
}

/// Samples of a centred window of `n` x `n` at `step` film pixels, with their positions.
pub fn shares(samples: &[f64], n: usize, step: f64) -> Vec<Share> {
    let at = |i: usize| (i as f64 - (n / 2) as f64) * step;
    samples.iter().enumerate().map(|(i, v)| ((at(i / n), at(i % n)), *v)).collect()
}

impl Psf {
    /// PSF window of a pack, on film pixels of `pitch_um`.
    pub fn from_window(psf: &PsfWindow, pitch_um: f64) -> Self {
        let step_px = psf.pitch_um / pitch_um;
        let samples: Vec<f64> = psf.samples.iter().map(|&v| f64::from(v)).collect();
        let integrated = psf.sample == PsfSample::Integrated;
        Self { shares: shares(&samples, psf.size, step_px), step_px, integrated }
    }

    /// Crop to the window of `window_px` film pixels at `azimuth_rad`, normalised to sum 1: a run rotates the square window of
    /// the PSF, crops it by the upright window of the film kernel, and normalises.
    pub fn cropped(mut self, window_px: usize, azimuth_rad: f64) -> Self {
        let half = window_px as f64 / 2.0;
        let (sin, cos) = azimuth_rad.sin_cos();
        let inside = |v: f64| v.abs() <= half;
        self.shares.retain(|&((y, x), _)| {
            inside(y) && inside(x) && inside(x * cos - y * sin) && inside(x * sin + y * cos)
        });
        let sum: f64 = self.shares.iter().map(|s| s.1).sum();
        self.shares.iter_mut().for_each(|s| s.1 /= sum);
        self
    }

    /// Shares of film pixels after rotation by `azimuth_rad`, each sample spread over the square of its pitch; integrated samples
    /// at the film's pitch stay at their rotated positions.
    fn in_pixels(&self, azimuth_rad: f64) -> Vec<Share> {
        let (sin, cos) = azimuth_rad.sin_cos();
        let rotated = self.shares.iter().map(|&((y, x), p)| ((x * sin + y * cos, x * cos - y * sin), p));
        if self.integrated && (self.step_px - 1.0).abs() < 1e-9 {
            return rotated.collect();
        }
        let mut pixels = std::collections::BTreeMap::new();
        let half = self.step_px / 2.0;
        let parts = |v: f64| {
            let (first, last) = ((v - half).round() as i64, (v + half).round() as i64);
            (first..=last).map(move |i| {
                let (a, b) = ((v - half).max(i as f64 - 0.5), (v + half).min(i as f64 + 0.5));
                (i, ((b - a) / (2.0 * half)).max(0.0))
            })
        };
        for ((y, x), p) in rotated {
            for (i, wy) in parts(y) {
                for (j, wx) in parts(x) {
                    *pixels.entry((i, j)).or_insert(0.0) += p * wy * wx;
                }
            }
        }
        pixels.into_iter().map(|((i, j), p)| ((i as f64, j as f64), p)).collect()
    }

    /// Side of the film pixel that an edge profile must still be integrated over, px; none if the samples include it.
    pub fn remaining_aperture_px(&self) -> Option<f64> {
        (!self.integrated || (self.step_px - 1.0).abs() > 1e-9).then_some(1.0)
    }
}
