//! What a lens says of itself, apart from all that makes films: no tables of a run, no kernels, no remap.
//!
//! A design is traced at the very field point asked for: chief ray, solid angle of the pupil, Huygens PSF. A pack says what its
//! tables hold: linear between field points, its PSFs mixed linearly between the two heights around (the model's own words).

use crate::failure::usage;
use crate::lens::source::Named;
use anyhow::Result;
use formats::lens::LensPack;
use pipeline::design::System;
use pipeline::design::film_pixel::FilmPixels;
use pipeline::design::illumination::solid_angle_sr;
use pipeline::design::psf::{PsfGrid, PsfScratch, PupilFunction};
use pipeline::design::ray::Tracer;
use pipeline::lens::{LensBand, PsfSample, PsfStack};
use pipeline::measure::expected::Share;

/// Wavelengths this close are the same, nm.
const SAME_NM: f64 = 1e-6;

/// A lens to compare with.
pub enum Truth {
    /// Its tables.
    Pack(Box<LensPack>),
    /// Its prescription.
    Design(Box<System>),
}

/// One wavelength of it.
pub struct BandTruth<'a> {
    of: Of<'a>,
}

enum Of<'a> {
    Table { band: &'a LensBand, stack: PsfStack },
    Traced { tracer: Box<Tracer<'a>>, axis_sr: f64 },
}

/// A PSF as light shares of a field point on +x, distances in film pixels from the chief ray.
#[derive(Clone, Debug)]
pub struct Psf {
    /// Samples.
    pub shares: Vec<Share>,
    /// Their pitch, film pixels.
    pub step_px: f64,
    /// Whether each is a mean over the square of its pitch already.
    pub integrated: bool,
}

impl Truth {
    /// Opens a pack or a design.
    pub fn open(name: &str) -> Result<Self> {
        Ok(match Named::open(name)? {
            Named::Pack(pack) => Self::Pack(pack),
            Named::Design(system, ..) => Self::Design(system),
        })
    }

    /// In words, for the report.
    pub fn words(&self) -> &'static str {
        match self {
            Self::Pack(_) => "the tables of the pack",
            Self::Design(_) => "the prescription, traced at each place",
        }
    }

    /// The lens at `nm`.
    pub fn band(&self, nm: f64) -> Result<BandTruth<'_>> {
        let of = match self {
            Self::Pack(pack) => {
                let bands = &pack.lens().bands;
                let found = bands.iter().position(|b| (b.wavelength_nm - nm).abs() < SAME_NM);
                let all: Vec<f64> = bands.iter().map(|b| b.wavelength_nm).collect();
                let Some(index) = found else {
                    return Err(usage(format!(
                        "{} has no band at {nm} nm to compare with; it has {} nm: take `--wavelengths` of these",
                        pack.path().display(),
                        pipeline::wavelengths::format(&all)
                    )));
                };
                Of::Table { band: &bands[index], stack: pack.psf(index)? }
            }
            Self::Design(system) => {
                let tracer = Tracer::new(system, nm / 1e3)?;
                let axis_sr = solid_angle_sr(&tracer, 0.0)?;
                Of::Traced { tracer: Box::new(tracer), axis_sr }
            }
        };
        Ok(BandTruth { of })
    }
}

impl BandTruth<'_> {
    /// Ideal height of the field point whose chief ray lands at REAL height `real_mm`.
    pub fn ideal_mm(&self, real_mm: f64) -> Result<f64> {
        Ok(match &self.of {
            Of::Table { band, .. } => band.ideal_of(real_mm),
            Of::Traced { tracer, .. } => tracer.field_of_height(real_mm)? * tracer.ideal_scale_mm(),
        })
    }

    /// REAL height of the field point at `ideal_mm`.
    pub fn real_mm(&self, ideal_mm: f64) -> Result<f64> {
        Ok(match &self.of {
            Of::Table { band, .. } => band.real_of(ideal_mm),
            Of::Traced { tracer, .. } => tracer.chief_height_mm(ideal_mm / tracer.ideal_scale_mm())?,
        })
    }

    /// Relative illumination at REAL height `real_mm`.
    pub fn illumination(&self, real_mm: f64) -> Result<f64> {
        Ok(match &self.of {
            Of::Table { band, .. } => band.illumination_of(real_mm),
            Of::Traced { tracer, axis_sr } => {
                solid_angle_sr(tracer, tracer.field_of_height(real_mm)?)? / axis_sr
            }
        })
    }

    /// The PSF at REAL height `real_mm`, over at most `window_px` film pixels of `pitch_um`.
    pub fn psf(&self, real_mm: f64, window_px: usize, pitch_um: f64) -> Result<Psf> {
        match &self.of {
            Of::Table { band, stack } => {
                let psf = band.psf_of(stack, real_mm);
                let step_px = psf.pitch_um / pitch_um;
                let samples: Vec<f64> = psf.samples.iter().map(|&v| f64::from(v)).collect();
                let integrated = psf.sample == PsfSample::Integrated;
                Ok(Psf { shares: shares(&samples, psf.size, step_px), step_px, integrated })
            }
            Of::Traced { .. } => {
                let (samples, n, step_px) = self.traced(real_mm, 0.0, window_px, pitch_um)?;
                Ok(Psf { shares: shares(&samples, n, step_px), step_px, integrated: false })
            }
        }
    }

    /// The same at `azimuth_rad`, upright, as the shares of whole film pixels in a window of `window_px` of them, of sum 1.
    pub fn pixels(
        &self,
        real_mm: f64,
        azimuth_rad: f64,
        window_px: usize,
        pitch_um: f64,
    ) -> Result<Vec<Share>> {
        let mut out = match &self.of {
            Of::Table { .. } => self
                .psf(real_mm, window_px, pitch_um)?
                .windowed(window_px, azimuth_rad)
                .in_pixels(azimuth_rad),
            Of::Traced { .. } => {
                // Traced at the azimuth itself; what lies outside the turned square of the window is cut as a run cuts it.
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

    /// Samples of the traced PSF, their number along a side and their pitch in film pixels: as fine as a traced pack's, a
    /// tenth finer than Nyquist and a whole number of samples a film pixel.
    fn traced(
        &self,
        real_mm: f64,
        azimuth_rad: f64,
        window_px: usize,
        pitch_um: f64,
    ) -> Result<(Vec<f64>, usize, f64)> {
        let Of::Traced { tracer, .. } = &self.of else { unreachable!("only a design is traced") };
        let pupil = PupilFunction::trace(tracer, tracer.field_of_height(real_mm)?)?;
        let per_px = (pitch_um / (0.9 * pupil.nyquist_um())).ceil();
        let half = ((window_px as f64 * per_px - 1.0 + 1e-9) / 2.0).floor() as usize;
        let grid = PsfGrid::new(half, pitch_um / per_px);
        Ok((grid.psf(&pupil, azimuth_rad, &mut PsfScratch::default()), grid.size(), 1.0 / per_px))
    }
}

fn shares(samples: &[f64], n: usize, step: f64) -> Vec<Share> {
    let at = |i: usize| (i as f64 - (n / 2) as f64) * step;
    samples.iter().enumerate().map(|(i, v)| ((at(i / n), at(i % n)), *v)).collect()
}

impl Psf {
    /// What a film's window of `window_px` pixels keeps of it at `azimuth_rad`, of sum 1: a run turns the PSF's own square
    /// window, cuts it by the film's upright one, and normalises.
    pub fn windowed(mut self, window_px: usize, azimuth_rad: f64) -> Self {
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

    /// Turned by `azimuth_rad` and shared out to whole film pixels, each sample spread over the square of its pitch; samples
    /// of pixels of the film's own pitch stay where they are.
    fn in_pixels(&self, azimuth_rad: f64) -> Vec<Share> {
        let (sin, cos) = azimuth_rad.sin_cos();
        let turned = self.shares.iter().map(|&((y, x), p)| ((x * sin + y * cos, x * cos - y * sin), p));
        if self.integrated && (self.step_px - 1.0).abs() < 1e-9 {
            return turned.collect();
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
        for ((y, x), p) in turned {
            for (i, wy) in parts(y) {
                for (j, wx) in parts(x) {
                    *pixels.entry((i, j)).or_insert(0.0) += p * wy * wx;
                }
            }
        }
        pixels.into_iter().map(|((i, j), p)| ((i as f64, j as f64), p)).collect()
    }

    /// Sides of the film's squares that a step through it sees: none where the samples hold the film pixel already.
    pub fn film_square(&self) -> Option<f64> {
        (!self.integrated || (self.step_px - 1.0).abs() > 1e-9).then_some(1.0)
    }
}
