//! From a built lens to the tables of its bands: map of the film, and PSFs at polar places in turned frames.
//!
//! Per band: the map ([`super::trace_map`]); heights r_k and azimuth counts J_k of the nodes, those of the nominal lens if they are good
//! enough (`nodes`); one window that holds its share of the light at 6 heights × 8 azimuths; the azimuths A_k at which the PSFs of a height
//! are stored (`azimuths`); then PSF (k, a), of the film place at r_k and φ = 2πa/A_k (from +X towards +Y, down), seen in the frame that is
//! turned by φ: its pupil function is turned, not the image. Pupil functions are interpolated between traced places (`smooth`).
//! Solid angle: G at the film's centre. The same bits for any number of threads: each PSF is summed by one thread in a fixed order.
//! Left out: tails, losses of coatings (a design that has coatings is refused).

mod azimuths;
mod band_limited;
mod functions;
mod kernels;
mod nodes;
mod nominal;
mod smooth;

pub use nominal::NominalNodes;

use super::band::{Band, MAP_TOLERANCE_PX, Sampling, stack};
use super::error::SkewError;
use super::map::FilmRange;
use super::system::BuiltLens;
use super::trace::SkewTracer;
use super::trace_map::trace_map;
use crate::design::psf::{PsfGrid, PupilFunction};
use crate::design::tables::trace::{LensTrace, OnProgress, Progress, TraceOptions, TracedBand};
use crate::design::tables::window::{Windows, core_samples, half_samples};
use crate::lens::Lens;
use crate::lens::planar::PsfPlaces;
use band_limited::azimuth_of;
use functions::Functions;
use kernels::Views;
use nominal::Nominal;

/// Incremented when the results for the same lens and options change.
pub const SKEW_VERSION: u32 = 3;

/// Heights, from the axis on, and azimuths at which the window is determined.
const WINDOW_HEIGHTS: usize = 6;
const WINDOW_AZIMUTHS: usize = 8;

/// Trace of a built lens.
#[derive(Debug)]
pub struct SkewTrace<'a> {
    lens: &'a BuiltLens,
    options: &'a TraceOptions,
    film: FilmRange,
}

impl<'a> SkewTrace<'a> {
    /// Of `lens`, with maps of `film`: the rectangle of the film and half the widest window around it.
    ///
    /// # Errors
    /// As [`LensTrace::new`] for the nominal lens.
    pub fn new(lens: &'a BuiltLens, options: &'a TraceOptions, film: FilmRange) -> Result<Self, SkewError> {
        LensTrace::new(lens.nominal(), options)?;
        Ok(Self { lens, options, film })
    }

    /// The lens without its bands: that of the nominal lens.
    ///
    /// # Errors
    /// No first-order properties.
    pub fn header(&self) -> Result<Lens, SkewError> {
        Ok(crate::design::trace::lens_header(self.lens.nominal())?)
    }

    /// Traces band `index`.
    ///
    /// # Errors
    /// A place of the film that has no chief ray or no light; a ray within the apertures that does not reach the film; a window that
    /// does not hold enough light; a map that folds.
    pub fn band(
        &self,
        index: usize,
        nominal: &mut NominalNodes,
        on_progress: OnProgress<'_>,
    ) -> Result<TracedBand, SkewError> {
        let options = self.options;
        let nm = options.wavelengths_nm[index];
        let mut psfs = 0;
        let mut report = |step, computed: usize| {
            psfs += computed;
            on_progress(Progress { band: index, bands: options.wavelengths_nm.len(), step, psfs });
        };
        report("nominal lens", 0);
        let nominal = nominal.of(self.lens, options, index, &mut report)?;
        let tracer = SkewTracer::new(self.lens, nm / 1e3)?;
        report("map", 0);
        let traced = trace_map(&tracer, self.film, MAP_TOLERANCE_PX * 1e-3 * options.film_pitch_um)?;
        let last = nominal.chosen.heights[nominal.chosen.heights.len() - 1];
        let mut functions = Functions::new(&tracer, last);
        let Sampling { windows, pitch_um } = self.sampling(&mut functions, &nominal, &mut report)?;
        let film_um = options.film_pitch_um;
        let (core_half, core_pitch_um) = core_samples(windows.core_px, film_um, pitch_um);
        let core = PsfGrid::new(core_half, core_pitch_um);
        let mut views = Views::new(&core, windows.core_px, film_um);
        let nodes = nodes::choose(&mut views, &mut functions, options, &nominal, &mut report)?;
        let places = (&nodes.heights[..], &nodes.azimuths[..]);
        let (azimuth_samples, _) =
            azimuths::choose(&mut views, &mut functions, places, options.psf_tolerance, &mut report)?;
        drop(views);
        let grid = PsfGrid::new(half_samples(windows.px, film_um, pitch_um), pitch_um);
        let places = rows(&nodes.heights, &azimuth_samples);
        report("PSFs", 0);
        functions.prepare(places.iter().copied())?;
        let functions = functions.into_functions(&places);
        let stacked = stack(&functions, &grid);
        report("PSFs", places.len());
        let band = Band {
            wavelength_nm: nm,
            map: traced,
            nodes: (nodes.heights, nodes.azimuths),
            places: PsfPlaces::Polar { azimuth_samples },
            error: nodes.error,
            window_px: windows.px,
            psfs,
        };
        band.with_psfs(stacked, &grid, functions, places.iter().map(|(height_mm, _)| *height_mm))
    }

    /// Pitch and windows: those of the nominal lens, if they are enough, with the share of the light of the built one.
    fn sampling(
        &self,
        functions: &mut Functions<'_>,
        nominal: &Nominal,
        report: &mut dyn FnMut(&'static str, usize),
    ) -> Result<Sampling, SkewError> {
        let last = nominal.chosen.heights[nominal.chosen.heights.len() - 1];
        let height = |i: usize| last * i as f64 / (WINDOW_HEIGHTS - 1) as f64;
        let azimuth = |i: usize| azimuth_of(i, WINDOW_AZIMUTHS);
        let places: Vec<(f64, f64)> = (0..WINDOW_HEIGHTS)
            .flat_map(|k| {
                let azimuths = if k == 0 { 1 } else { WINDOW_AZIMUTHS };
                (0..azimuths).map(move |a| (height(k), azimuth(a)))
            })
            .collect();
        report("window", 0);
        functions.prepare(places.iter().copied())?;
        let found: Vec<(f64, &PupilFunction)> =
            places.iter().map(|place| (place.0, functions.at(*place))).collect();
        let first_px = nominal.window_px + nominal.window_px / 8 + 2;
        let Sampling { windows, pitch_um } = Sampling::new(self.options, &found, nominal.pitch_um, first_px)?;
        report("window", found.len());
        // The same windows for the lenses of a batch, where that of the nominal lens holds their light.
        let windows =
            Windows { px: windows.px.max(nominal.window_px), core_px: windows.core_px.max(nominal.core_px) };
        Ok(Sampling { windows, pitch_um })
    }
}

/// The places of the PSFs (k, a): height, mm, and azimuth, rad.
fn rows(heights: &[f64], azimuth_samples: &[usize]) -> Vec<(f64, f64)> {
    let places = |(h, count): (&f64, &usize)| {
        let (h, count) = (*h, *count);
        (0..count).map(move |a| (h, azimuth_of(a, count)))
    };
    heights.iter().zip(azimuth_samples).flat_map(places).collect()
}
