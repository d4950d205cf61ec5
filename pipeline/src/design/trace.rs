//! From a prescription to the tables of a [`Lens`], one band at a time.
//!
//! Per band: dense chief-ray heights and RI; one sample pitch, film pitch / m with the minimum m that is 10 % finer than the
//! Nyquist pitch λN/2 of the fastest, max oblique cone; one window, the minimum odd number of film pixels that contains the share
//! `energy` of the energy of every sampled field point; then the PSFs, at heights and azimuth counts that `grid`
//! chooses by error. Heights are REAL image heights in mm. Samples of one band at a time are in memory.
//! The same bits for any number of threads: each PSF is summed by one thread in a fixed order.
//! Left out: transmission (1), and energy outside the window, whose share is recorded.

use rayon::prelude::*;

use super::bundle::Bundle;
use super::error::DesignError;
use super::grid::{self, Kernels};
use super::illumination::irradiance_table;
pub use super::options::{Azimuths, MAX_NODES, PsfHeights, TraceOptions};
use super::paraxial::Paraxial;
use super::psf::{PsfGrid, PsfScratch, PupilFunction};
use super::ray::Tracer;
use super::refine::MAX_SAMPLES;
pub use super::refine::NodeError;
use super::system::System;
use crate::lens::{Lens, LensBand, PsfSample, PsfStack};

/// Share of the light that a window of the maximum size may leave out without `energy` being set lower.
const MAX_LEFT_OUT: f64 = 0.05;

/// Incremented when the results for the same design and options change.
pub const TRACER_VERSION: u32 = 3;

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
    /// L1 errors at cell centres; `None` if heights and azimuths were given.
    pub psf_error: Option<NodeError>,
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
        primary.check_image()?;
        for nm in &options.wavelengths_nm {
            Tracer::new(system, nm / 1e3)?.field_of_height(options.max_height_mm)?;
        }
        Ok(Self { system, options, primary })
    }

    /// The lens without its bands.
    pub fn header(&self) -> Lens {
        header(self.system, &self.primary)
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
        let [ideal, real, light] = self.dense(&tracer)?;
        let last_mm = match &options.heights {
            PsfHeights::ByError => options.max_height_mm,
            PsfHeights::Given(h) => h.last().copied().unwrap_or(0.0),
        };
        report_step("window", 0);
        let heights: Vec<f64> = (0..17).map(|i| last_mm * f64::from(i) / 16.0).collect();
        let samples = pupils(&tracer, &heights)?;
        let pitch_um = self.pitch(&samples)?;
        let window_px = match options.window_px {
            Some(px) => px,
            None => self.window(&tracer, &heights, &samples, pitch_um)?,
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
            relative_illumination: light.iter().map(|g| g / light[0]).collect(),
            psf_height_mm: chosen.heights,
            azimuth_count: chosen.azimuths,
            psf_size: grid.size(),
            psf_pitch_um: pitch_um,
            psf_energy: stack.1,
            solid_angle_sr: light[0],
            transmission: 1.0,
        };
        Ok(TracedBand { tables, psf: stack.0, report })
    }

    /// Ideal heights, real heights and G of [`super::illumination`], evenly spaced in ideal height.
    fn dense(&self, tracer: &Tracer<'_>) -> Result<[Vec<f64>; 3], DesignError> {
        let last = tracer.field_of_height(self.options.max_height_mm)?;
        let points = self.options.field_points;
        let tans: Vec<f64> = (0..points).map(|i| last * i as f64 / (points - 1) as f64).collect();
        let real: Result<Vec<f64>, DesignError> =
            tans.par_iter().map(|t| tracer.chief_height_mm(*t)).collect();
        let mut real = real?;
        real[0] = 0.0;
        if let Some(i) = real.windows(2).position(|w| w[1] <= w[0]) {
            return Err(DesignError::Height {
                requested_mm: self.options.max_height_mm,
                reached_mm: real[i],
                wavelength_um: tracer.wavelength_um,
                problem: "the real image height folds back".to_owned(),
            });
        }
        let light = irradiance_table(tracer, &tans)?;
        Ok([tans.iter().map(|t| t * tracer.ideal_scale_mm()).collect(), real, light])
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

    /// Minimum odd number of film pixels that contains the requested share of energy, at most the maximum.
    fn window(
        &self,
        tracer: &Tracer<'_>,
        heights: &[f64],
        samples: &[PupilFunction],
        pitch_um: f64,
    ) -> Result<usize, DesignError> {
        let (film, max) = (self.options.film_pitch_um, self.options.max_window_px);
        let allowed = self.options.energy.min(1.0 - MAX_LEFT_OUT);
        let fail = |height_mm: f64, held: f64| {
            let (requested, wavelength_um) = (allowed, tracer.wavelength_um);
            DesignError::Window { max_px: max, height_mm, wavelength_um, held, requested }
        };
        let bundles: Vec<(f64, Bundle)> = heights
            .par_iter()
            .step_by(4)
            .map(|h| Ok((*h, Bundle::trace(tracer, tracer.field_of_height(*h)?, 12, 16)?)))
            .collect::<Result<_, DesignError>>()?;
        let widest = |b: &Bundle| b.light_outside(0.5 * film * max as f64);
        let worst = bundles.iter().max_by(|a, b| widest(&a.1).total_cmp(&widest(&b.1)));
        // Clearly too wide by the estimate: no PSF is computed.
        if let Some((height, bundle)) = worst
            && 1.0 - widest(bundle) < allowed - 0.05
        {
            return Err(fail(*height, 1.0 - widest(bundle)));
        }
        let guess = |b: &Bundle| b.window_px(self.options.energy, film, max).unwrap_or(max);
        let expected = bundles.iter().map(|(_, b)| guess(b)).max().unwrap_or(max);
        let mut px = (expected + expected / 4 + 8).clamp(65, max.max(65)).min(max) | 1;
        loop {
            let grid = PsfGrid::new(half_samples(px, film, pitch_um), pitch_um);
            let needed: Vec<(Option<usize>, f64)> = samples
                .par_iter()
                .map_init(PsfScratch::default, |scratch, f| {
                    let psf = grid.psf(f, 0.0, scratch);
                    let held = squares(&psf, grid.size());
                    let within = |w: usize| held[half_samples(w, film, pitch_um).min(held.len() - 1)];
                    let least = (1..=px / 2).map(|i| 2 * i + 1).find(|w| within(*w) >= self.options.energy);
                    (least, within(px))
                })
                .collect();
            let all: Option<usize> = needed.iter().try_fold(3, |a, (w, _)| w.map(|w| a.max(w)));
            let (height, held) = heights
                .iter()
                .zip(&needed)
                .map(|(h, (_, held))| (*h, *held))
                .fold((0.0, 1.0), |a, b| if b.1 < a.1 { b } else { a });
            match all {
                // Margin for field points between the sampled ones.
                Some(w) => return Ok((w + 2).min(max)),
                None if px >= max && held < allowed => return Err(fail(height, held)),
                None if px >= max => return Ok(max),
                None => px = (2 * px - 1).min(max),
            }
        }
    }

    /// What the band `index` needs, estimated from rays before it is traced.
    ///
    /// # Errors
    /// A ray that does not reach the image.
    pub fn estimate(&self, index: usize) -> Result<Estimate, DesignError> {
        let options = self.options;
        let tracer = Tracer::new(self.system, options.wavelengths_nm[index] / 1e3)?;
        let last = options.max_height_mm;
        let bundles: Vec<Bundle> = (0..5)
            .into_par_iter()
            .map(|i| Bundle::trace(&tracer, tracer.field_of_height(last * f64::from(i) / 4.0)?, 12, 16))
            .collect::<Result<_, DesignError>>()?;
        let film = options.film_pitch_um;
        let guess = |b: &Bundle| b.window_px(options.energy, film, options.max_window_px);
        let window_px = options.window_px.unwrap_or_else(|| {
            bundles.iter().map(|b| guess(b).unwrap_or(options.max_window_px)).max().unwrap_or(3)
        });
        let light =
            1.0 - bundles.iter().map(|b| b.light_outside(0.5 * film * window_px as f64)).fold(0.0, f64::max);
        let nyquist = bundles.iter().map(Bundle::nyquist_um).fold(f64::INFINITY, f64::min);
        let pitch_um = options.psf_pitch_um.unwrap_or(film / (film / (0.9 * nyquist)).ceil());
        let side = 2 * half_samples(window_px, film, pitch_um) + 1;
        let max_bytes = match &options.heights {
            PsfHeights::Given(h) => 4 * side * side * h.len(),
            PsfHeights::ByError => (4 * MAX_SAMPLES).min(4 * side * side * options.max_nodes),
        };
        Ok(Estimate { window_px, light, side, max_bytes })
    }
}

/// What a band needs, estimated from rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Window, film pixels.
    pub window_px: usize,
    /// Minimum share of the light inside it.
    pub light: f64,
    /// Samples per side of a PSF.
    pub side: usize,
    /// Maximum size of the PSFs of the band, bytes.
    pub max_bytes: usize,
}

/// The lens of `system` without bands.
///
/// # Errors
/// No first-order properties.
pub fn lens_header(system: &System) -> Result<Lens, DesignError> {
    Ok(header(system, &Paraxial::new(system, system.primary_um())?))
}

fn header(system: &System, primary: &Paraxial) -> Lens {
    Lens {
        name: system.name.clone(),
        distortion_focal_length_mm: primary.distortion_focal_length_mm.abs(),
        effective_focal_length_mm: primary.effective_focal_length_mm,
        f_number: primary.image_f_number(),
        primary_wavelength_nm: system.primary_um() * 1e3,
        object_distance_mm: system.object_distance_mm,
        magnification: primary.film_magnification(system.object_distance_mm),
        psf_sample: PsfSample::Point,
        bands: Vec::new(),
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
