//! From a prescription to the tables of a [`Lens`], one band at a time.
//!
//! Per band: chief-ray heights and relative illumination at many field points (`dense`); one sample pitch and one window (`sampled`); then the PSFs, at heights
//! and azimuth counts that `grid` chooses by the error of kernels in a smaller window (`window`). Heights are REAL image heights in mm. Samples of one band at a
//! time are in memory.
//! The same bits for any number of threads: each PSF is summed by one thread in a fixed order.
//! Transmission: light of the axis over that without losses; RI and PSFs have the losses of each ray. Left out: energy outside the window, whose share is recorded.

use rayon::prelude::*;

pub use super::band_mean::BandRange;
use super::band_mean::{BandSampling, BandTracers};
use super::dense::transmission;
pub use super::difference::ESF_SHARE;
pub use super::estimate::Estimate;
use super::grid::{self, Chosen};
use super::kernels::Compared;
use super::lens_header::header;
pub use super::lens_header::lens_header;
pub use super::options::{Azimuths, MAX_NODES, PsfHeights, TraceOptions};
pub use super::refine::NodeError;
use super::sampled::{Sampled, Sampling};
pub use super::shared_nodes::{SharedNodes, node_wavelengths};
pub use super::window::LEAST_TAIL_WINDOW_PX;
use super::window::{Found, half_samples};
use crate::bounds::PSF_ENERGY;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::psf::middle::band_tail;
use crate::design::psf::pupil_stack::{PupilStack, energy, normalise};
pub use crate::design::psf::tails::NoTail;
use crate::design::psf::{PsfGrid, PsfScratch};
use crate::design::pupil::pupils::Pupils;
use crate::design::rays::aim::lagrange;
use crate::design::rays::paraxial::Paraxial;
use crate::design::rays::ray::Tracer;
use crate::lens::{Lens, LensBand, PsfSample, PsfStack};

/// Of bands without samples of their PSFs in windows that are given, heights whose share of energy is computed, about; between them it is interpolated.
const ENERGIES: usize = 24;

/// Incremented when the results for the same design and options change.
pub const TRACER_VERSION: u32 = 11;
/// Incremented when nodes, windows or pitches of samples for the same design and options change, which packs with pupil functions have stored.
pub const NODES_VERSION: u32 = 8;

/// Incremented when tails for the same design and options change.
pub const TAILS_VERSION: u32 = 7;

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
    /// Its PSFs; without samples where they would have more bytes than the trace may keep.
    pub psf: PsfStack,
    /// The pupil functions of its PSFs; without heights for means over a band's width.
    pub pupils: PupilStack,
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
    /// Why the band has no tail, if one was asked for.
    pub no_tail: Option<NoTail>,
}

/// Trace of a lens.
#[derive(Clone, Debug)]
pub struct LensTrace<'a> {
    pub(super) system: &'a System,
    pub(super) options: &'a TraceOptions,
    primary: Paraxial,
    pub(super) tails: bool,
    pub(super) band: Option<BandRange>,
    pub(super) sampling: Sampling,
    pub(super) has_base_nodes: bool,
    /// Most bytes of the samples of a band's PSFs.
    max_psf_bytes: usize,
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
        Ok(Self {
            system,
            options,
            primary,
            tails: false,
            band: None,
            sampling: Sampling::default(),
            has_base_nodes: false,
            max_psf_bytes: usize::MAX,
        })
    }

    /// Checks options that do not depend on a lens.
    ///
    /// # Errors
    /// [`DesignError::Option`].
    pub fn check_options(options: &TraceOptions) -> Result<(), DesignError> {
        options.check()
    }

    /// With the tails of PSFs beyond their windows, if `tails`: nodes are the same, windows those of before or larger.
    #[must_use]
    pub fn with_tails(self, tails: bool) -> Self {
        Self { tails, ..self }
    }

    /// With tables and PSFs that are means over `band`, if any: of the trace of one band, whose wavelength is that of distortion and nodes. Without tails.
    #[must_use]
    pub fn over(self, band: Option<BandRange>) -> Self {
        Self { band, has_base_nodes: self.has_base_nodes || band.is_some(), ..self }
    }

    /// With samples of the PSFs of bands where they have at most `bytes`; [`TracedBand::psf`] of others has none, and their pupil functions stand for them. Means
    /// over a band's width always have samples.
    #[must_use]
    pub fn with_psfs_up_to(self, bytes: usize) -> Self {
        Self { max_psf_bytes: bytes, ..self }
    }

    /// With at most [`TraceOptions::base_nodes`], of bands whose PSFs take more time and memory than those of one wavelength, one plane and a lens with symmetry.
    #[must_use]
    pub(in crate::design) fn with_base_nodes(self) -> Self {
        Self { has_base_nodes: true, ..self }
    }

    /// The options that nodes are chosen with.
    pub(super) fn node_options(&self) -> TraceOptions {
        match self.has_base_nodes {
            true => TraceOptions { max_nodes: self.options.base_nodes(), ..self.options.clone() },
            false => self.options.clone(),
        }
    }

    /// What it traces.
    pub(super) fn options(&self) -> &'a TraceOptions {
        self.options
    }

    /// With PSFs sampled as `sampling` states.
    #[must_use]
    pub(super) fn sampled_as(self, sampling: Sampling) -> Self {
        Self { sampling, ..self }
    }

    /// The lens without its bands.
    pub fn header(&self) -> Lens {
        header(self.system, &self.primary)
    }

    /// Traces all bands and passes each to `sink`, as [`trace_lens`].
    ///
    /// # Errors
    /// As [`LensTrace::band`]; [`DesignError::Sink`] for an error of `sink`.
    pub fn all<E: std::fmt::Display>(
        &self,
        on_progress: OnProgress<'_>,
        mut sink: impl FnMut(usize, TracedBand) -> Result<(), E>,
    ) -> Result<Lens, DesignError> {
        let (mut lens, mut shared) = (self.header(), SharedNodes::default());
        for (i, nm) in self.options.wavelengths_nm.iter().enumerate() {
            let band = self.band_sharing(i, &mut shared, on_progress)?;
            lens.bands.push(band.tables.clone());
            sink(i, band).map_err(|e| DesignError::Sink { wavelength_nm: *nm, problem: e.to_string() })?;
        }
        Ok(lens)
    }

    /// Traces band `index`, with nodes of its own.
    ///
    /// # Errors
    /// A ray that does not reach the image.
    pub fn band(&self, index: usize, on_progress: OnProgress<'_>) -> Result<TracedBand, DesignError> {
        self.band_at(index, None, on_progress, |sampled, report| self.choose(sampled, report))
    }

    /// Traces band `index` with nodes of `shared`, which belong to its wavelength, not to the other bands that are traced.
    ///
    /// # Errors
    /// As [`LensTrace::band`].
    pub fn band_sharing(
        &self,
        index: usize,
        shared: &mut SharedNodes,
        on_progress: OnProgress<'_>,
    ) -> Result<TracedBand, DesignError> {
        let nm = self.options.wavelengths_nm[index];
        let known = shared.windows(self, nm);
        self.band_at(index, known, on_progress, |sampled, report| shared.choose(self, nm, sampled, report))
    }

    /// Traces band `index` with nodes that `choose` selects, and with windows that are `known`, if they are.
    pub(super) fn band_at(
        &self,
        index: usize,
        known: Option<Found>,
        on_progress: OnProgress<'_>,
        choose: impl FnOnce(&mut Sampled<'_>, &mut dyn FnMut(&'static str, usize)) -> Result<Chosen, DesignError>,
    ) -> Result<TracedBand, DesignError> {
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
        let tracers = self.band.map(|range| BandTracers::new(self.system, &tracer, range)).transpose()?;
        let (light, transmission, of_band) = match &tracers {
            None => {
                let transmission = transmission(&tracer, light[0])?;
                (light, transmission, None)
            }
            Some(tracers) => {
                let found = tracers.light(&self.tans(&tracer)?)?;
                (found.sum.clone(), found.transmission, Some((tracers, found)))
            }
        };
        let mut sampled = self.sampled(&tracer, known, &mut report_step)?;
        let chosen = choose(&mut sampled, &mut report_step)?;
        let stated = match options.heights {
            PsfHeights::ByError => sampled.film_samples.stated(chosen.heights.len(), &self.node_options()),
            PsfHeights::Given(_) => None,
        };
        if let Some((tracers, _)) = &of_band {
            report_step("window of the band", 0);
            let own = BandSampling { pitch_um: sampled.grid.pitch_um(), window_px: sampled.window_px };
            let BandSampling { pitch_um, window_px } = tracers.sampling(options, &sampled.first, own)?;
            sampled.window_px = window_px;
            sampled.grid = PsfGrid::new(half_samples(window_px, options.film_pitch_um, pitch_um), pitch_um);
        }
        let Sampled { mut pupils, grid, window_px, first, edges, found, .. } = sampled;
        let tail = match &edges {
            None => None,
            Some(edges) => {
                report_step("tails", 0);
                Some(band_tail(&tracer, &pupils, (&first, edges), (grid.size(), grid.pitch_um()))?)
            }
        };
        report_step("PSFs", 0);
        let (stack, pupils) = match &of_band {
            None => {
                pupils.keep(&chosen.heights);
                pupils.prepare(chosen.heights.iter().copied())?;
                let bytes = 4 * grid.size().pow(2) * chosen.heights.len();
                let stack = match bytes <= self.max_psf_bytes {
                    true => stack(&pupils, &grid, &chosen.heights),
                    false => {
                        let side_um = grid.size() as f64 * grid.pitch_um();
                        let known = found.and_then(|found| found.light.within_um(side_um));
                        let known =
                            known.map(|shares| std::iter::zip(first.iter().copied(), shares).collect());
                        let known = known.unwrap_or_else(|| energies(&pupils, &grid, &chosen.heights));
                        let at = |height: &f64| energy_between(&known, *height);
                        (empty_stack(&grid), chosen.heights.iter().map(at).collect())
                    }
                };
                (stack, PupilStack::new(&grid, pupils.into_functions(&chosen.heights)))
            }
            Some((tracers, light)) => {
                drop(pupils);
                let stack = tracers.stack(&grid, (&first, &chosen.heights), (&real, light))?;
                (stack, PupilStack::new(&grid, Vec::new()))
            }
        };
        let mut shares = std::iter::zip(&chosen.heights, &stack.1);
        if let Some((&height_mm, &share)) = shares.find(|(_, s)| **s > PSF_ENERGY.max || s.is_nan()) {
            return Err(DesignError::Unresolved { height_mm, wavelength_um: nm / 1e3, share });
        }
        report_step("PSFs", chosen.heights.len() * self.band.map_or(1, |band| band.samples));
        let report = BandReport {
            wavelength_nm: nm,
            psf_error: chosen.error,
            window_px,
            min_energy: stack.1.iter().copied().fold(1.0, f64::min),
            psfs,
            no_tail: tail.as_ref().and_then(|t| t.as_ref().err()).copied(),
        };
        let tables = LensBand {
            wavelength_nm: nm,
            ideal_height_mm: ideal,
            image_height_mm: real,
            relative_illumination: light.iter().map(|g| g / light[0]).collect(),
            psf_height_mm: chosen.heights,
            azimuth_count: chosen.azimuths,
            psf_size: grid.size(),
            psf_pitch_um: grid.pitch_um(),
            kernel_pitch_um: stated.map(|per_pixel| options.film_pitch_um / per_pixel),
            psf_energy: stack.1,
            solid_angle_sr: light[0] / transmission,
            transmission,
            tail: tail.and_then(Result::ok),
            cones: None,
            planar: None,
        };
        Ok(TracedBand { tables, psf: stack.0, pupils, report })
    }

    /// Chooses nodes at the wavelength of `sampled`.
    pub(super) fn choose(
        &self,
        sampled: &mut Sampled<'_>,
        report: &mut dyn FnMut(&'static str, usize),
    ) -> Result<Chosen, DesignError> {
        let Sampled { pupils, last_mm, film_samples, core, inner, .. } = sampled;
        let mut kernels = Compared::new(core, inner.as_ref(), self.options.film_pitch_um);
        grid::choose(&mut kernels, pupils, &self.node_options(), (*last_mm, film_samples), report)
    }

    /// The nodes `other` of a similar band if their error is about the same here ([`grid::adopt`]), else none.
    pub(super) fn adopt(
        &self,
        sampled: &mut Sampled<'_>,
        other: &Chosen,
        report: &mut dyn FnMut(&'static str, usize),
    ) -> Result<Option<Chosen>, DesignError> {
        let Sampled { pupils, core, inner, film_samples, .. } = sampled;
        let mut kernels = Compared::new(core, inner.as_ref(), self.options.film_pitch_um);
        let options = self.node_options();
        let allowed = (options.psf_tolerance, options.excess);
        let found = grid::adopt(&mut kernels, pupils, allowed, other, report)?;
        let most = film_samples.most(&options);
        let fits = |nodes: &Chosen| nodes.heights.len() <= most && !nodes.is_limited_beside(most, &options);
        Ok(found.filter(|nodes| self.has_base_nodes || fits(nodes)))
    }
}

/// Traces all bands and passes each to `sink`; returns the lens with all tables, without PSFs.
///
/// ```
/// use lenscube_pipeline::design::{System, TraceOptions, trace_lens};
///
/// // Tables and PSFs of the built-in lens at 550 nm, up to 0.3 mm from the axis.
/// let options = TraceOptions::new(vec![550.0], 0.3);
/// let mut stacks = vec![];
/// let lens = trace_lens(&System::double_gauss_28(), &options, &mut |_| (), |_, band| {
///     stacks.push(band.psf);
///     Ok::<(), String>(())
/// })?;
/// assert!((lens.effective_focal_length_mm - 99.5).abs() < 0.01);
/// // The PSF on the axis has sum 1 and its maximum in the middle sample.
/// let psf = stacks[0].window(0);
/// assert!((psf.iter().sum::<f32>() - 1.0).abs() < 1e-5);
/// assert!(psf.iter().all(|&v| v <= psf[psf.len() / 2]));
/// # Ok::<(), lenscube_pipeline::design::DesignError>(())
/// ```
///
/// # Errors
/// As [`LensTrace::new`] and [`LensTrace::band`]; [`DesignError::Sink`] for an error of `sink`.
pub fn trace_lens<E: std::fmt::Display>(
    system: &System,
    options: &TraceOptions,
    on_progress: OnProgress<'_>,
    sink: impl FnMut(usize, TracedBand) -> Result<(), E>,
) -> Result<Lens, DesignError> {
    LensTrace::new(system, options)?.all(on_progress, sink)
}

/// The share of energy at `height` from those of `computed`, ascending: the cubic through the four nearest heights.
fn energy_between(computed: &[(f64, f64)], height: f64) -> f64 {
    let above = computed.partition_point(|(h, _)| *h < height);
    if let Some((_, energy)) = computed.get(above).filter(|(h, _)| *h == height) {
        return *energy;
    }
    let first = above.saturating_sub(2).min(computed.len().saturating_sub(4));
    lagrange(&computed[first..computed.len().min(first + 4)], height)
}

/// About [`ENERGIES`] of `heights` with the shares of energy in the window of their PSFs.
fn energies(pupils: &Pupils<'_>, grid: &PsfGrid, heights: &[f64]) -> Vec<(f64, f64)> {
    let (step, last) = (heights.len().div_ceil(ENERGIES), heights.len() - 1);
    let computed: Vec<usize> = (0..last).step_by(step).chain([last]).collect();
    computed
        .par_iter()
        .map_init(<(PsfScratch, Vec<f32>)>::default, |(scratch, psf), k| {
            grid.psf_into(pupils.at(heights[*k]), 0.0, scratch, psf);
            (heights[*k], energy(psf))
        })
        .collect()
}

/// A stack on `grid` without PSFs.
fn empty_stack(grid: &PsfGrid) -> PsfStack {
    PsfStack { size: grid.size(), pitch_um: grid.pitch_um(), sample: PsfSample::Point, samples: Vec::new() }
}

/// The PSFs at `heights`, each of sum 1, and their shares of energy in the window.
fn stack(pupils: &Pupils<'_>, grid: &PsfGrid, heights: &[f64]) -> (PsfStack, Vec<f64>) {
    let n = grid.size();
    let mut stack = PsfStack { samples: vec![0.0; n * n * heights.len()], ..empty_stack(grid) };
    let energy = stack
        .samples
        .par_chunks_exact_mut(n * n)
        .zip(heights)
        .map_init(<(PsfScratch, Vec<f32>)>::default, |(scratch, psf), (out, h)| {
            grid.psf_into(pupils.at(*h), 0.0, scratch, psf);
            normalise(psf, out)
        })
        .collect();
    (stack, energy)
}
