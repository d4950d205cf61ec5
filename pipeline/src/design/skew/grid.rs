//! From a lens without rotational symmetry by design to the tables of its bands: map of the film, and PSFs on columns and rows.
//!
//! Per band: the map ([`super::trace_map`]); one window that holds its share of the light at 5 × 5 film places; columns and rows, uniform in X
//! and in Y, as many as the kernels between them need (`nodes`); the PSF of each of their places, not turned, centred on its chief ray.
//! Solid angle: G at the film's centre. The same bits for any number of threads. First-order figures are those of the straightened
//! lens, but the focal length of the ideal plane, which is that of the rays.
//! Left out: tails, losses of coatings (a design that has coatings is refused), depth.

mod kernels;
mod nodes;

use super::band::{Band, MAP_TOLERANCE_PX, Sampling, stack};
use super::error::SkewError;
use super::map::FilmRange;
use super::system::BuiltLens;
use super::trace::SkewTracer;
use super::trace_map::trace_map;
use crate::design::psf::{PsfGrid, PupilFunction};
use crate::design::tables::trace::{LensTrace, OnProgress, Progress, TraceOptions, TracedBand, lens_header};
use crate::design::tables::window::{core_samples, half_samples};
use crate::lens::Lens;
use crate::lens::planar::PsfPlaces;
use crate::real;
use kernels::PlaceKernels;

/// Incremented when the results for the same design and options change.
pub const GRID_VERSION: u32 = 2;

/// Places along a side at which the window is determined.
const WINDOW_SIDE: usize = 5;
/// Side of the window that is examined first, µm, and its least, film pixels.
const FIRST_UM: f64 = 130.0;
const FIRST_PX: usize = 9;
/// Maximum samples of the PSFs of a band: 1 GiB in f32.
const MAX_SAMPLES: usize = 1 << 28;

/// Trace of a lens without rotational symmetry by design.
#[derive(Debug)]
pub struct GridTrace<'a> {
    lens: &'a BuiltLens,
    options: &'a TraceOptions,
    film: FilmRange,
}

impl<'a> GridTrace<'a> {
    /// Of `lens`, with tables of `film`: the rectangle of the film and half the widest window around it.
    ///
    /// # Errors
    /// Options that cannot be used; no first-order properties of the straightened lens.
    pub fn new(lens: &'a BuiltLens, options: &'a TraceOptions, film: FilmRange) -> Result<Self, SkewError> {
        LensTrace::check_options(options)?;
        Ok(Self { lens, options, film })
    }

    /// The lens without its bands.
    ///
    /// # Errors
    /// No first-order properties of the straightened lens.
    pub fn header(&self) -> Result<Lens, SkewError> {
        let straight = lens_header(self.lens.nominal())?;
        let focal_mm = SkewTracer::new(self.lens, self.lens.nominal().primary_um())?.ideal_focal_mm();
        let magnification = straight.magnification * focal_mm / straight.distortion_focal_length_mm;
        Ok(Lens { distortion_focal_length_mm: focal_mm, magnification, ..straight })
    }

    /// Traces band `index`.
    ///
    /// # Errors
    /// A place of the film that has no chief ray or no light; a ray within the apertures that does not reach the film; a window that
    /// does not hold enough light; a map that folds.
    pub fn band(&self, index: usize, on_progress: OnProgress<'_>) -> Result<TracedBand, SkewError> {
        let options = self.options;
        let nm = options.wavelengths_nm[index];
        let mut psfs = 0;
        let mut report = |step, computed: usize| {
            psfs += computed;
            on_progress(Progress { band: index, bands: options.wavelengths_nm.len(), step, psfs });
        };
        let tracer = SkewTracer::new(self.lens, nm / 1e3)?;
        report("map", 0);
        let traced = trace_map(&tracer, self.film, MAP_TOLERANCE_PX * 1e-3 * options.film_pitch_um)?;
        let mut kernels = PlaceKernels::new(&tracer)?;
        report("window", 0);
        let Sampling { windows, pitch_um } = self.sampling(&mut kernels)?;
        let film_um = options.film_pitch_um;
        let grid = PsfGrid::new(half_samples(windows.px, film_um, pitch_um), pitch_um);
        let (core_half, core_pitch_um) = core_samples(windows.core_px, film_um, pitch_um);
        let core = PsfGrid::new(core_half, core_pitch_um);
        kernels.start(&core, windows.core_px, film_um);
        let most = options.base_nodes().min(MAX_SAMPLES / (grid.size() * grid.size()));
        let nodes = nodes::choose(&mut kernels, self.film, (options, most), &mut report)?;
        let places = nodes.places();
        report("PSFs", 0);
        let functions = kernels.into_functions(&places)?;
        let stacked = stack(&functions, &grid);
        report("PSFs", places.len());
        let heights_mm = places.iter().map(|[x, y]| real::hypot(*x, *y));
        let band = Band {
            wavelength_nm: nm,
            map: traced,
            nodes: (Vec::new(), Vec::new()),
            places: PsfPlaces::Cartesian { x_mm: nodes.x_mm, y_mm: nodes.y_mm },
            error: nodes.error,
            window_px: windows.px,
            psfs,
        };
        band.with_psfs(stacked, &grid, functions, heights_mm)
    }

    /// Windows and sample pitch.
    fn sampling(&self, kernels: &mut PlaceKernels<'_>) -> Result<Sampling, SkewError> {
        let share = |i: usize| i as f64 / (WINDOW_SIDE - 1) as f64;
        let places: Vec<[f64; 2]> = (0..WINDOW_SIDE * WINDOW_SIDE)
            .map(|k| self.film.at([share(k % WINDOW_SIDE), share(k / WINDOW_SIDE)]))
            .collect();
        kernels.prepare(&places)?;
        let found: Vec<(f64, &PupilFunction)> =
            places.iter().map(|p| (real::hypot(p[0], p[1]), kernels.function(*p))).collect();
        let first_px = ((FIRST_UM / self.options.film_pitch_um) as usize).max(FIRST_PX);
        Ok(Sampling::new(self.options, &found, f64::INFINITY, first_px)?)
    }
}
