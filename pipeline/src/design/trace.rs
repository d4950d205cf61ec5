//! From a prescription to the tables of a [`Lens`], one band at a time.
//!
//! Per band: dense chief-ray heights and RI; one sample pitch, film pitch / m with the minimum m that is 10 % finer than the
//! Nyquist pitch λN/2 of the fastest, max oblique cone; one window, the minimum odd number of film pixels that contains the share
//! `energy` of the energy of every sampled field point; then the PSFs, at heights and azimuth counts that `grid`
//! chooses by error. Heights are REAL image heights in mm. Samples of one band at a time are in memory.
//! The same bits for any number of threads: each PSF is summed by one thread in a fixed order.
//! Left out: transmission (1), and energy outside the window, whose share is recorded.

use rayon::prelude::*;

use super::error::DesignError;
use super::grid::{self, Kernels};
use super::illumination::solid_angle_sr;
pub use super::options::{Azimuths, PsfHeights, TraceOptions};
use super::paraxial::Paraxial;
use super::psf::{PsfGrid, PsfScratch, PupilFunction};
use super::ray::Tracer;
use super::system::System;
use crate::lens::{Lens, LensBand, PsfSample, PsfStack};

/// Incremented when the results for the same design and options change.
pub const TRACER_VERSION: u32 = 2;

/// Runs `work` with `threads` threads for its rays and sums; the results do not depend on their number.
pub fn with_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> T {
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.install(work),
        // New threads cannot be created: the existing ones are used.
        Err(_) => work(),
    }
}

/// Progress of a trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Progress {
    /// Current band, from 0.
    pub band: usize,
    /// Number of bands.
    pub bands: usize,
    /// Current step.
    pub step: &'static str,
    /// PSFs of this band so far.
    pub psfs: usize,
}

/// Progress callback, called on the calling thread.
pub type OnProgress<'a> = &'a mut dyn FnMut(Progress);

/// A traced band.
#[derive(Clone, Debug, PartialEq)]
pub struct TracedBand {
    /// Its tables.
    pub tables: LensBand,
    /// Its PSFs.
    pub psf: PsfStack,
    /// Report on the choice of window and nodes.
    pub report: BandReport,
}

/// Report on the choice of a band's window and nodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BandReport {
    /// Wavelength, nm.
    pub wavelength_nm: f64,
    /// Maximum L1 error at cell centres; `None` if heights and azimuths were given.
    pub psf_error: Option<f64>,
    /// Window, film pixels.
    pub window_px: usize,
    /// Minimum over heights of the share of energy in the window.
    pub min_energy: f64,
    /// PSFs computed.
    pub psfs: usize,
}

/// Trace of a lens.
#[derive(Debug)]
pub struct LensTrace<'a> {
    system: &'a System,
    options: &'a TraceOptions,
    primary: Paraxial,
}

impl<'a> LensTrace<'a> {
    /// Checks options, glasses, first-order optics and the maximum height.
    ///
    /// # Errors
    /// An option out of range; an error of first-order optics or of a glass; a height that the lens does not reach.
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
    /// A ray that does not reach the image.
    pub fn band(&self, index: usize, on_progress: OnProgress<'_>) -> Result<TracedBand, DesignError> {
        let options = self.options;
        let nm = options.wavelengths_nm[index];
        let tracer = Tracer::new(self.system, nm / 1e3)?;
        let mut psfs = 0;
        let mut report_step = |step, computed: usize| {
            psfs += computed;
            on_progress(Progress { band: index, bands: options.wavelengths_nm.len(), step, psfs });
        };
        report_step("chief rays", 0);
        let [ideal, real, omega] = self.dense(&tracer)?;
        let last_mm = match &options.heights {
            PsfHeights::ByError => options.max_height_mm,
            PsfHeights::Given(h) => h.last().copied().unwrap_or(0.0),
        };
        report_step("window", 0);
        let samples = pupils(&tracer, &(0..17).map(|i| last_mm * f64::from(i) / 16.0).collect::<Vec<_>>())?;
        let pitch_um = self.pitch(&samples)?;
        let window_px = match options.window_px {
            Some(px) => px,
            None => self.window(&samples, pitch_um),
        };
        report_step("window", if options.window_px.is_some() { 0 } else { samples.len() });
        let grid = PsfGrid::new(half_samples(window_px, options.film_pitch_um, pitch_um), pitch_um);
        let kernels = Kernels::new(&tracer, &grid, window_px, options.film_pitch_um);
        let chosen = grid::choose(&kernels, options, last_mm, &mut report_step)?;
        report_step("PSFs", 0);
        let stack = stack(&tracer, &grid, &chosen.heights)?;
        report_step("PSFs", chosen.heights.len());
        let report = BandReport {
            wavelength_nm: nm,
            psf_error: chosen.error,
            window_px,
            min_energy: stack.1.iter().copied().fold(1.0, f64::min),
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

    /// Ideal heights, real heights and solid angles of the pupil, evenly spaced in ideal height.
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
                requested_mm: self.options.max_height_mm,
                reached_mm: real[i],
                wavelength_um: tracer.wavelength_um,
                problem: "the real image height folds back".to_owned(),
            });
        }
        Ok([tans.iter().map(|t| t * tracer.ideal_scale_mm()).collect(), real, omega])
    }

    fn pitch(&self, samples: &[PupilFunction]) -> Result<f64, DesignError> {
        let nyquist = samples.iter().map(PupilFunction::nyquist_um).fold(f64::INFINITY, f64::min);
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

    /// Minimum odd number of film pixels that contains the requested share of energy.
    fn window(&self, samples: &[PupilFunction], pitch_um: f64) -> usize {
        let (film, max) = (self.options.film_pitch_um, self.options.max_window_px);
        let mut px = 65.min(max);
        loop {
            let grid = PsfGrid::new(half_samples(px, film, pitch_um), pitch_um);
            let needed: Vec<Option<usize>> = samples
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
                // Margin for field points between the sampled ones.
                Some(w) => return (w + 2).min(max),
                None if px >= max => return max,
                None => px = (2 * px - 1).min(max),
            }
        }
    }
}

/// Traces all bands and passes each to `sink`; returns the lens with all tables, without PSFs.
///
/// # Errors
/// As [`LensTrace::new`] and [`LensTrace::band`]; [`DesignError::Sink`] for an error of `sink`.
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

/// Share in the centred square of half-width i samples, for every i.
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

/// The PSFs at `heights`, each of sum 1, and their shares of energy in the window.
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
