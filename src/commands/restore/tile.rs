//! A tile: which part of film and chart it needs, its start values, and its restoration.
//!
//! ```text
//! extent ⊂ T = extent grown by the halo      free pixels: those of T that the film shows
//! used   = film pixels that show T           their residual counts
//! F      = used grown by half a PSF window   read from the film
//! C      = all that F shows, and the light beside it: T, F's places, grown by more than half a window
//! ```
//! Start values: [`pipeline::restore::places`].
//! Light from outside T is that of the start values; the halo is as wide as the solution depends on it ([`super::settings`]).

use super::optics::{Map, Optics};
use super::planes::Pixels;
use super::recorded::Recorded;
use anyhow::Result;
use pipeline::geometry::{Rect, Size};
use pipeline::restore::local::LocalSpectrum;
use pipeline::restore::places::{Place, Places, STEP};
use pipeline::restore::tikhonov::{self, Stop};
use pipeline::restore::{Part, Restored, richardson_lucy, total_variation};
use std::borrow::Cow;

/// Steps of the iteration that finds the place of a chart point on the film. Each reduces the error by the relative change of scale, a few per cent.
const PLACE_STEPS: usize = 8;
/// Pixels beside a rectangle for interpolation.
const MARGIN_PX: usize = 4;
/// Iterations of the solver, at most.
const MAX_ITERATIONS: usize = 100;
/// Steps of total variation, at most, and the change of a pixel in a step that ends them, over the tolerance: the error that is left is that of many such steps.
const MAX_STEPS: usize = 2000;
const LAST_CHANGE: f64 = 0.05;

/// Strength of regularisation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Strength {
    /// λ of Tikhonov.
    Lambda(f64),
    /// μ of total variation.
    Mu(f64),
    /// Of Richardson-Lucy.
    Iterations(usize),
}

/// How the tiles of a band are restored.
#[derive(Clone, Copy, Debug)]
pub struct Solver {
    /// What is restored: number of the plane.
    pub plane: usize,
    /// λ, μ or iterations.
    pub strength: Strength,
    /// Pixels around a tile.
    pub halo_px: usize,
    /// Side of PSF windows.
    pub window_px: usize,
    /// Error of a pixel, chart values.
    pub tolerance: f64,
    /// σ of a film pixel, to which the weights of pixels are relative.
    pub noise: f64,
}

/// What was computed.
#[derive(Clone, Copy, Debug, Default)]
pub struct Counts {
    /// Tiles.
    pub tiles: usize,
    /// The most iterations of one.
    pub max_iterations: usize,
    /// Tiles that ended before the tolerance was reached.
    pub unconverged: usize,
}

impl Counts {
    /// Adds those of further tiles.
    pub fn add(&mut self, other: Self) {
        self.tiles += other.tiles;
        self.max_iterations = self.max_iterations.max(other.max_iterations);
        self.unconverged += other.unconverged;
    }
}

/// A part of the picture with its map and start values.
pub struct Tile {
    /// Its map.
    pub map: Map,
    /// C, on the picture's grid.
    pub chart: Rect,
    /// F, on the film.
    pub film: Rect,
    /// Used pixels, in F.
    pub used: Rect,
    /// Free pixels of C.
    pub free: Vec<bool>,
    /// T, in C.
    pub free_rect: Rect,
    places: Places,
    /// Share of the film pixels that measure the plane.
    density: f64,
    /// Variance in the dark over the value of an electron.
    background: f64,
}

impl Tile {
    /// The tile that restores `extent` of plane `plane` with a halo of `halo_px`, for PSF windows of `window_px`; `None` if the film shows nothing of it.
    ///
    /// # Errors
    /// The lens cannot be traced.
    pub fn new(
        optics: &Optics,
        plane: usize,
        extent: Rect,
        (halo_px, window_px): (usize, usize),
    ) -> Result<Option<Self>> {
        let all = optics.film().rect();
        let shown = bounds(&optics.picture_of_film(plane, &border(all))?);
        let free = extent.grown(halo_px).intersect(shown);
        if free.is_empty() {
            return Ok(None);
        }
        let used = on_film(optics, plane, free)?.intersect(all);
        if used.is_empty() {
            return Ok(None);
        }
        let film = used.grown(window_px / 2 + MARGIN_PX).intersect(all);
        let of_film = bounds(&optics.picture_of_film(plane, &border(film))?);
        let beside = window_px / 2 + window_px / 16 + MARGIN_PX;
        let chart = union(union(of_film.grown(beside), free.grown(1)), extent);
        let map = optics.map(plane, chart, film)?;
        let places = Places::new(chart, places_of(optics, plane, &Places::points(chart))?);
        let free_rect = Rect::new(free.y - chart.y, free.x - chart.x, free.height, free.width);
        Ok(Some(Self {
            free: places.shown(free_rect, optics.film()),
            used: Rect::new(used.y - film.y, used.x - film.x, used.height, used.width),
            map,
            chart,
            film,
            free_rect,
            places,
            density: optics.plane(plane).density,
            background: optics.plane(plane).background,
        }))
    }

    /// Start values of its chart of `film`, the pixels of F.
    pub fn start(&self, film: &Pixels) -> Vec<f64> {
        self.places.start(&film.values, self.film, self.map.gain())
    }

    /// The local spectrum of its map.
    ///
    /// # Errors
    /// As the map's.
    pub fn spectrum(&self) -> Result<LocalSpectrum> {
        let spectrum = LocalSpectrum::new(&self.map, self.map.window_px(), self.free_rect);
        Ok(spectrum.map_err(anyhow::Error::from_boxed)?.with_density(self.density))
    }

    /// Its problem, of `film`, the pixels of F, from `start`.
    pub fn part<'a>(&'a self, film: &'a Pixels, start: &'a [f64]) -> Part<'a> {
        Part {
            operator: &self.map,
            film: &film.values,
            used: self.used,
            weights: film.weights.as_deref(),
            background: self.background as f32,
            start,
            free: &self.free,
        }
    }

    /// The film pixels that show `rect` of the picture, in F.
    ///
    /// # Errors
    /// As [`Optics::picture_of_film`].
    pub fn film_rect(&self, optics: &Optics, plane: usize, rect: Rect) -> Result<Rect> {
        let found = on_film(optics, plane, rect)?.intersect(self.film);
        Ok(Rect::new(found.y - self.film.y, found.x - self.film.x, found.height, found.width))
    }

    /// Restores `film`, the pixels of F, with `strength`, to `tolerance` in chart values.
    ///
    /// # Errors
    /// As the map's.
    pub fn restored(
        &self,
        spectrum: Option<&LocalSpectrum>,
        film: &Pixels,
        strength: Strength,
        tolerance: f64,
    ) -> Result<Restored> {
        let start = self.start(film);
        let part = self.part(film, &start);
        let spectrum = || match spectrum {
            Some(spectrum) => Ok(Cow::Borrowed(spectrum)),
            None => self.spectrum().map(Cow::Owned),
        };
        let restored = match strength {
            Strength::Iterations(count) => richardson_lucy::restore(&part, count),
            Strength::Mu(mu) => {
                let stop = Stop { tolerance: LAST_CHANGE * tolerance, max_iterations: MAX_STEPS };
                total_variation::restore(&part, &*spectrum()?, mu, stop)
            }
            Strength::Lambda(lambda) => {
                let stop = Stop { tolerance, max_iterations: MAX_ITERATIONS };
                tikhonov::restore(&part, &*spectrum()?, lambda, stop)
            }
        };
        restored.map_err(anyhow::Error::from_boxed)
    }

    /// The values of `rect` of the picture in `chart`, one of its charts.
    pub fn values(&self, chart: &[f64], rect: Rect) -> Vec<f64> {
        let (y, x) = ((rect.y - self.chart.y) as usize, (rect.x - self.chart.x) as usize);
        let row = |k: usize| &chart[(y + k) * self.chart.width + x..][..rect.width];
        (0..rect.height).flat_map(row).copied().collect()
    }
}

/// The pixels of `extent` of the restored picture.
///
/// # Errors
/// The film cannot be read; as the map's.
pub fn restore(
    film: &Recorded,
    optics: &Optics,
    solver: &Solver,
    extent: Rect,
) -> Result<(Vec<f64>, Counts)> {
    let found = Tile::new(optics, solver.plane, extent, (solver.halo_px, solver.window_px))?;
    let Some(tile) = found else {
        return Ok((vec![0.0; extent.size().pixels()], Counts { tiles: 1, ..Counts::default() }));
    };
    let pixels = film.read(solver.plane, tile.film, solver.noise)?;
    let restored = tile.restored(None, &pixels, solver.strength, solver.tolerance)?;
    let counts = Counts {
        tiles: 1,
        max_iterations: restored.iterations,
        unconverged: usize::from(!restored.converged),
    };
    Ok((tile.values(&restored.chart, extent), counts))
}

/// The smallest rectangle around the places of the film that show `rect` of the picture.
fn on_film(optics: &Optics, plane: usize, rect: Rect) -> Result<Rect> {
    let places = places_of(optics, plane, &border(rect))?;
    Ok(bounds(&places.iter().map(|place| (place.row, place.column)).collect::<Vec<_>>()))
}

/// The places on the film, or beside it, of points (row, column) of the picture.
fn places_of(optics: &Optics, plane: usize, points: &[(f64, f64)]) -> Result<Vec<Place>> {
    let Size { height, width } = optics.film();
    let inside = |(y, x): (f64, f64)| (y.clamp(0.0, (height - 1) as f64), x.clamp(0.0, (width - 1) as f64));
    let mut places: Vec<(f64, f64)> = points.iter().map(|p| inside(*p)).collect();
    let mut shown = optics.picture_of_film(plane, &places)?;
    for _ in 0..PLACE_STEPS {
        for ((place, shown), point) in places.iter_mut().zip(&shown).zip(points) {
            *place = inside((place.0 + point.0 - shown.0, place.1 + point.1 - shown.1));
        }
        shown = optics.picture_of_film(plane, &places)?;
    }
    let illumination = optics.illumination(plane, &places)?;
    let of = |k: usize| {
        let (place, point, at) = (places[k], points[k], shown[k]);
        // Beyond the border the scale is that of the border, 1 to a few per cent.
        Place {
            row: place.0 + point.0 - at.0,
            column: place.1 + point.1 - at.1,
            illumination: illumination[k],
        }
    };
    Ok((0..points.len()).map(of).collect())
}

/// Points (row, column) on the border of `rect`, at most [`STEP`] px apart, and its corners.
fn border(rect: Rect) -> Vec<(f64, f64)> {
    let along = |first: i64, n: usize| {
        let steps = (n - 1).div_ceil(STEP).max(1);
        (0..=steps).map(move |k| first as f64 + (n - 1) as f64 * k as f64 / steps as f64)
    };
    let (top, bottom) = (rect.y as f64, (rect.bottom() - 1) as f64);
    let (left, right) = (rect.x as f64, (rect.right() - 1) as f64);
    let across = along(rect.x, rect.width).flat_map(|x| [(top, x), (bottom, x)]);
    across.chain(along(rect.y, rect.height).flat_map(|y| [(y, left), (y, right)])).collect()
}

/// The smallest rectangle of pixels around `places` (row, column).
fn bounds(places: &[(f64, f64)]) -> Rect {
    let range = |of: fn(&(f64, f64)) -> f64| {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in places.iter().map(of) {
            (low, high) = (low.min(value), high.max(value));
        }
        (low.floor() as i64, high.ceil() as i64)
    };
    let ((top, bottom), (left, right)) = (range(|p| p.0), range(|p| p.1));
    Rect::new(top, left, (bottom - top + 1) as usize, (right - left + 1) as usize)
}

fn union(a: Rect, b: Rect) -> Rect {
    let (y, x) = (a.y.min(b.y), a.x.min(b.x));
    let (bottom, right) = (a.bottom().max(b.bottom()), a.right().max(b.right()));
    Rect::new(y, x, (bottom - y) as usize, (right - x) as usize)
}
