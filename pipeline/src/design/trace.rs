//! From a prescription to the tables of a [`Lens`], one band at a time.
//!
//! Per band: dense chief-ray heights and RI; one sample pitch, film pitch / m with the least m that stays 10 % finer than the
//! Nyquist pitch λN/2 of the fastest, most oblique cone; one window, the least odd number of film pixels that holds the share
//! `energy` of the light of every field point looked at; then the PSFs, at heights and azimuth counts that `grid`
//! chooses by error. Heights are REAL image heights in mm. Only one band's samples are alive at a time.
//! Same bits for any number of threads: each PSF is summed by one thread in a fixed order.
//! Left out: transmission (1), and light between the window and infinity, whose share is recorded.

use rayon::prelude::*;

use super::error::DesignError;
use super::grid::{self, Kernels};
use super::illumination::solid_angle_sr;
use super::paraxial::Paraxial;
use super::psf::{PsfGrid, PsfScratch, PupilFunction};
use super::ray::Tracer;
use super::system::System;
use crate::lens::{Lens, LensBand, PsfSample, PsfStack};

/// Raised whenever the tracer gives other numbers for the same design and options.
pub const TRACER_VERSION: u32 = 2;

/// Runs `work` with so many threads for its rays and sums; the numbers are the same for any.
pub fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.install(work),
        // No new threads to be had: those that are there will do.
        Err(_) => work(),
    }
}

/// Which heights get a PSF.
#[derive(Clone, Debug, PartialEq)]
pub enum PsfHeights {
    /// As many as `psf_tolerance` asks for.
    ByError,
    /// These real image heights, mm, ascending from 0.
    Given(Vec<f64>),
}

/// How many azimuths a height gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Azimuths {
    /// As many as `psf_tolerance` asks for.
    ByError,
    /// This many (a multiple of 4) at every height but the axis.
    Given(usize),
}

/// What to trace, and how well. Image plane, object distance and ray aiming belong to the [`System`].
#[derive(Clone, Debug, PartialEq)]
pub struct TraceOptions {
    /// Wavelengths, nm, ascending.
    pub wavelengths_nm: Vec<f64>,
    /// Real image height the tables reach, mm.
    pub max_height_mm: f64,
    /// Field points of the dense tables: 1001 keep linear interpolation within 1e-4 px to 25 mm.
    pub field_points: usize,
    /// Pitch of the film the PSFs are meant for, µm.
    pub film_pitch_um: f64,
    /// Share of the light that the window must hold.
    pub energy: f64,
    /// Largest window, film pixels (odd).
    pub max_window_px: usize,
    /// A window of this many film pixels (odd) instead of one chosen by `energy`.
    pub window_px: Option<usize>,
    /// Sample pitch, µm, instead of one chosen by Nyquist.
    pub psf_pitch_um: Option<f64>,
    /// L1 error allowed of a kernel between nodes, integrated over the film pixel.
    pub psf_tolerance: f64,
    /// Which heights get a PSF.
    pub heights: PsfHeights,
    /// How many azimuths a height gets.
    pub azimuths: Azimuths,
}

impl TraceOptions {
    /// The defaults for these wavelengths and this height.
    pub fn new(wavelengths_nm: Vec<f64>, max_height_mm: f64) -> Self {
        Self {
            wavelengths_nm,
            max_height_mm,
            field_points: 1001,
            film_pitch_um: 2.0,
            energy: 0.99,
            max_window_px: 401,
            window_px: None,
            psf_pitch_um: None,
            psf_tolerance: 0.01,
            heights: PsfHeights::ByError,
            azimuths: Azimuths::ByError,
        }
    }

    fn check(&self) -> Result<(), DesignError> {
        let bad = |option, value: String, expected| Err(DesignError::Option { option, value, expected });
        let waves = &self.wavelengths_nm;
        if waves.is_empty() || waves.iter().any(|w| !w.is_finite()) || waves.windows(2).any(|w| w[1] <= w[0])
        {
            return bad("wavelengths", format!("{waves:?}"), "one or more ascending numbers of nm");
        }
        for (option, v) in [
            ("max height", self.max_height_mm),
            ("film pitch", self.film_pitch_um),
            ("psf pitch", self.psf_pitch_um.unwrap_or(1.0)),
            ("psf tolerance", self.psf_tolerance),
        ] {
            if !(v.is_finite() && v > 0.0) {
                return bad(option, v.to_string(), "a positive number");
            }
        }
        if !(self.energy > 0.0 && self.energy < 1.0) {
            return bad("energy", self.energy.to_string(), "a share between 0 and 1");
        }
        if self.field_points < 2 {
            return bad("field points", self.field_points.to_string(), "at least 2");
        }
        for px in [self.max_window_px, self.window_px.unwrap_or(3)] {
            if px.is_multiple_of(2) || !(3..=2001).contains(&px) {
                return bad("window", px.to_string(), "an odd number of film pixels, 3..2001");
            }
        }
        if let PsfHeights::Given(h) = &self.heights {
            let ascend = h.windows(2).all(|w| w[1] > w[0]) && h.iter().all(|v| v.is_finite());
            if h.len() < 2 || h[0] != 0.0 || !ascend {
                return bad("heights", format!("{h:?}"), "two or more heights ascending from 0");
            }
        }
        if let Azimuths::Given(j) = self.azimuths
            && (j == 0 || !j.is_multiple_of(4))
        {
            return bad("azimuths", j.to_string(), "a multiple of 4");
        }
        Ok(())
    }
}

/// How far a trace has come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Band now traced, from 0.
    pub band: usize,
    /// Bands in all.
    pub bands: usize,
    /// What is done to it.
    pub step: &'static str,
    /// PSFs of this band so far.
    pub psfs: usize,
}

/// What is told of a trace's progress, from the calling thread.
pub type OnProgress<'a> = &'a mut dyn FnMut(Progress);

/// A band as traced.
#[derive(Clone, Debug, PartialEq)]
pub struct TracedBand {
    /// Its tables.
    pub tables: LensBand,
    /// Its PSFs.
    pub psf: PsfStack,
    /// How they were chosen.
    pub report: BandReport,
}

/// How a band's PSFs were chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BandReport {
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Largest L1 error found at cell centres; `None` when heights and azimuths were given, not chosen.
    pub psf_error: Option<f64>,
    /// Window, film pixels.
    pub window_px: usize,
    /// Least share of the light held at any height.
    pub least_energy: f64,
    /// PSFs computed on the way.
    pub psfs: usize,
}

/// A lens being traced.
#[derive(Debug)]
pub struct LensTrace<'a> {
    system: &'a System,
    options: &'a TraceOptions,
    primary: Paraxial,
}

impl<'a> LensTrace<'a> {
    /// Checks what can be checked before any ray.
    ///
    /// # Errors
    /// An option that makes no sense; what the first-order optics or a glass refuses.
    pub fn new(system: &'a System, options: &'a TraceOptions) -> Result<Self, DesignError> {
        options.check()?;
        let primary = Paraxial::new(system, system.primary_um())?;
        for nm in &options.wavelengths_nm {
            Tracer::new(system, nm / 1e3)?.field_of_height(options.max_height_mm)?;
        }
        Ok(Self { system, options, primary })
    }

    /// The lens without its bands.
    pub fn header(&self) -> Lens {
        Lens {
            name: self.system.name.clone(),
            distortion_focal_length_mm: self.primary.distortion_focal_length_mm.abs(),
            effective_focal_length_mm: self.primary.effective_focal_length_mm,
            f_number: self.primary.image_f_number(),
            primary_wavelength_nm: self.system.primary_um() * 1e3,
            object_distance_mm: self.system.object_distance_mm,
            magnification: self.primary.film_magnification(self.system.object_distance_mm),
            psf_sample: PsfSample::Point,
            bands: Vec::new(),
        }
    }

    /// Traces band `index`.
    ///
    /// # Errors
    /// Rays that the tables need and that do not arrive.
    pub fn band(&self, index: usize, on_progress: OnProgress<'_>) -> Result<TracedBand, DesignError> {
        let options = self.options;
        let nm = options.wavelengths_nm[index];
        let tracer = Tracer::new(self.system, nm / 1e3)?;
        let mut psfs = 0;
        let mut tell = |step, more: usize| {
            psfs += more;
            on_progress(Progress { band: index, bands: options.wavelengths_nm.len(), step, psfs });
        };
        tell("chief rays", 0);
        let [ideal, real, omega] = self.dense(&tracer)?;
        let last_mm = match &options.heights {
            PsfHeights::ByError => options.max_height_mm,
            PsfHeights::Given(h) => h.last().copied().unwrap_or(0.0),
        };
        tell("window", 0);
        let looks = pupils(&tracer, &(0..17).map(|i| last_mm * f64::from(i) / 16.0).collect::<Vec<_>>())?;
        let pitch_um = self.pitch(&looks)?;
        let window_px = match options.window_px {
            Some(px) => px,
            None => self.window(&looks, pitch_um),
        };
        tell("window", if options.window_px.is_some() { 0 } else { looks.len() });
        let grid = PsfGrid::new(half_samples(window_px, options.film_pitch_um, pitch_um), pitch_um);
        let kernels = Kernels::new(&tracer, &grid, window_px, options.film_pitch_um);
        let chosen = grid::choose(&kernels, options, last_mm, &mut tell)?;
        tell("PSFs", 0);
        let stack = stack(&tracer, &grid, &chosen.heights)?;
        tell("PSFs", chosen.heights.len());
        let report = BandReport {
            wavelength_nm: nm,
            psf_error: chosen.error,
            window_px,
            least_energy: stack.1.iter().copied().fold(1.0, f64::min),
            psfs,
        };
        let tables = LensBand {
            wavelength_nm: nm,
            ideal_height_mm: ideal,
            image_height_mm: real,
            relative_illumination: omega.iter().map(|o| o / omega[0]).collect(),
            psf_height_mm: chosen.heights,
            azimuth_count: chosen.azimuths,
            psf_size: grid.size(),
            psf_pitch_um: pitch_um,
            psf_energy: stack.1,
            solid_angle_sr: omega[0],
            transmission: 1.0,
        };
        Ok(TracedBand { tables, psf: stack.0, report })
    }

    /// Ideal and real heights and the pupil's solid angles, evenly spaced in ideal height.
    fn dense(&self, tracer: &Tracer<'_>) -> Result<[Vec<f64>; 3], DesignError> {
        let last = tracer.field_of_height(self.options.max_height_mm)?;
        let points = self.options.field_points;
        let tans: Vec<f64> = (0..points).map(|i| last * i as f64 / (points - 1) as f64).collect();
        let rows: Result<Vec<(f64, f64)>, DesignError> =
            tans.par_iter().map(|t| Ok((tracer.chief_height_mm(*t)?, solid_angle_sr(tracer, *t)?))).collect();
        let (mut real, omega): (Vec<f64>, Vec<f64>) = rows?.into_iter().unzip();
        real[0] = 0.0;
        if let Some(i) = real.windows(2).position(|w| w[1] <= w[0]) {
            return Err(DesignError::Height {
                wanted_mm: self.options.max_height_mm,
                reached_mm: real[i],
                wavelength_um: tracer.wavelength_um,
                problem: "the real image height folds back".to_owned(),
            });
        }
        Ok([tans.iter().map(|t| t * tracer.ideal_scale_mm()).collect(), real, omega])
    }

    fn pitch(&self, looks: &[PupilFunction]) -> Result<f64, DesignError> {
        let nyquist = looks.iter().map(PupilFunction::nyquist_um).fold(f64::INFINITY, f64::min);
        match self.options.psf_pitch_um {
            Some(pitch) if pitch > nyquist => Err(DesignError::Option {
                option: "psf pitch",
                value: format!("{pitch} µm"),
                expected: "one finer than Nyquist, λN/2 of the widest cone",
            }),
            Some(pitch) => Ok(pitch),
            None => Ok(self.options.film_pitch_um / (self.options.film_pitch_um / (0.9 * nyquist)).ceil()),
        }
    }

    /// Least odd number of film pixels that holds the share asked for.
    fn window(&self, looks: &[PupilFunction], pitch_um: f64) -> usize {
        let (film, most) = (self.options.film_pitch_um, self.options.max_window_px);
        let mut px = 65.min(most);
        loop {
            let grid = PsfGrid::new(half_samples(px, film, pitch_um), pitch_um);
            let needed: Vec<Option<usize>> = looks
                .par_iter()
                .map_init(PsfScratch::default, |scratch, f| {
                    let psf = grid.psf(f, 0.0, scratch);
                    let held = squares(&psf, grid.size());
                    (1..=px / 2).map(|i| 2 * i + 1).find(|w| {
                        held[half_samples(*w, film, pitch_um).min(held.len() - 1)] >= self.options.energy
                    })
                })
                .collect();
            let all: Option<usize> = needed.into_iter().try_fold(3, |a, w| w.map(|w| a.max(w)));
            match all {
                // Field points between those looked at may need a little more.
                Some(w) => return (w + 2).min(most),
                None if px >= most => return most,
                None => px = (2 * px - 1).min(most),
            }
        }
    }
}

/// Traces all bands, handing each to `sink` as soon as it is there; the lens that comes back holds all tables, no PSF.
///
/// # Errors
/// As [`LensTrace::new`] and [`LensTrace::band`]; [`DesignError::Sink`] with the sink's words.
pub fn trace_lens<E: std::fmt::Display>(
    system: &System,
    options: &TraceOptions,
    on_progress: OnProgress<'_>,
    mut sink: impl FnMut(usize, TracedBand) -> Result<(), E>,
) -> Result<Lens, DesignError> {
    let trace = LensTrace::new(system, options)?;
    let mut lens = trace.header();
    for (i, nm) in options.wavelengths_nm.iter().enumerate() {
        let band = trace.band(i, on_progress)?;
        lens.bands.push(band.tables.clone());
        sink(i, band).map_err(|e| DesignError::Sink { wavelength_nm: *nm, problem: e.to_string() })?;
    }
    Ok(lens)
}

/// Samples to either side of the centre in a window of `px` film pixels.
fn half_samples(px: usize, film_pitch_um: f64, pitch_um: f64) -> usize {
    ((px as f64 * film_pitch_um / pitch_um - 1.0 + 1e-9) / 2.0).floor() as usize
}

/// Share held by the centred square of half-width i samples, for every i.
fn squares(psf: &[f64], n: usize) -> Vec<f64> {
    let half = n / 2;
    let mut rings = vec![0.0; half + 1];
    for (i, v) in psf.iter().enumerate() {
        rings[(i / n).abs_diff(half).max((i % n).abs_diff(half))] += v;
    }
    rings
        .iter()
        .scan(0.0, |sum, r| {
            *sum += r;
            Some(*sum)
        })
        .collect()
}

pub(crate) fn pupils(tracer: &Tracer<'_>, heights: &[f64]) -> Result<Vec<PupilFunction>, DesignError> {
    heights.par_iter().map(|h| PupilFunction::trace(tracer, tracer.field_of_height(*h)?)).collect()
}

/// The PSFs of the nodes, each of sum 1, and the share of the light each window held.
fn stack(tracer: &Tracer<'_>, grid: &PsfGrid, heights: &[f64]) -> Result<(PsfStack, Vec<f64>), DesignError> {
    let n = grid.size();
    let mut stack = PsfStack {
        size: n,
        pitch_um: grid.pitch_um(),
        sample: PsfSample::Point,
        samples: vec![0.0; n * n * heights.len()],
    };
    let energy: Result<Vec<f64>, DesignError> = stack
        .samples
        .par_chunks_exact_mut(n * n)
        .zip(heights)
        .map_init(PsfScratch::default, |scratch, (out, h)| {
            let f = PupilFunction::trace(tracer, tracer.field_of_height(*h)?)?;
            let psf = grid.psf(&f, 0.0, scratch);
            let sum: f64 = psf.iter().sum();
            for (o, v) in out.iter_mut().zip(&psf) {
                *o = (v / sum) as f32;
            }
            Ok(sum)
        })
        .collect();
    let energy = energy?;
    Ok((stack, energy))
}
