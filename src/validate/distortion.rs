//! Distortion: where points land, against the chief ray.
//!
//! A grid of 9 × 9 points (Gaussians of 3 px) through RI and distortion: the centroid of each, on the film as it is (divided by
//! nothing: R changes by 2e-5 a pixel, which moves a centroid by less than 1e-4 px), against the film place of the chief ray of that
//! field point: traced at that very field for a design, the table's for a pack. Then with the PSF, some of the points (all 81 take
//! nine times as long and tell nothing new by symmetry; `--full` takes them all): there a point moves by its PSF's centroid from
//! the chief ray, outwards, which is taken off. Errors are lengths in film pixels.

use super::Setup;
use super::films::{self, on_film};
use super::truth::BandTruth;
use anyhow::{Context, Result};
use pipeline::chart::Generator;
use pipeline::geometry::Rect;
use pipeline::measure::centroid::centroid;

/// Points along a side.
const COUNT: usize = 9;
/// Half the square that a centroid is taken over without PSF: a Gaussian of 3 px has died out.
const HALF_PX: usize = 10;
/// Beyond the PSF's half window with it, and around both: a point moves between bands.
const SPARE_PX: usize = 10;

/// One point in one band: film places (row, column).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// On the chart.
    pub chart_px: (f64, f64),
    /// Measured.
    pub film_px: (f64, f64),
    /// Of the chief ray, or of the PSF's centroid.
    pub lens_px: (f64, f64),
}

impl Point {
    /// Film less lens, px: (row, column).
    pub fn error_px(&self) -> (f64, f64) {
        (self.film_px.0 - self.lens_px.0, self.film_px.1 - self.lens_px.1)
    }
}

/// Mean and largest error, px.
pub fn mean_max(points: &[Point]) -> (f64, f64) {
    let errors = points.iter().map(|p| p.error_px()).map(|(y, x)| y.hypot(x));
    let (sum, most) = errors.fold((0.0, 0.0f64), |(s, m), e| (s + e, m.max(e)));
    (sum / points.len().max(1) as f64, most)
}

/// The films of the points and where to look.
pub struct Shots {
    points: Vec<(f64, f64)>,
    rects: Vec<Rect>,
    films: films::Shots,
    psf: bool,
}

/// Makes the film of the points, with or without the PSF.
pub fn shoot(setup: &Setup, psf: bool) -> Result<Shots> {
    let chart = setup.chart("points", &format!("&count={COUNT}"));
    let all = chart.parse::<Generator>()?.points_px().to_vec();
    let few = |i: &usize| {
        let (row, col) = (i / COUNT, i % COUNT);
        let out = COUNT / 2;
        !psf || setup.films.full || (row >= out && col >= out && (row == out || row == col))
    };
    let points: Vec<(f64, f64)> = (0..all.len()).filter(few).map(|i| all[i]).collect();
    let middle = setup.truth.band(setup.wavelengths_nm[setup.wavelengths_nm.len() / 2])?;
    let widest = setup.windows_px.iter().copied().max().unwrap_or(1);
    let half = if psf { widest / 2 } else { 0 } + HALF_PX + SPARE_PX;
    let rect = |&at: &(f64, f64)| {
        let (row, col) = setup.on_film(&middle, at)?;
        let side = 2 * half + 1;
        let rect = Rect::new(row.round() as i64 - half as i64, col.round() as i64 - half as i64, side, side);
        on_film(rect, setup.size, "a point near the border")
    };
    let rects: Vec<Rect> = points.iter().map(rect).collect::<Result<_>>()?;
    let stages = if psf { "ri,distortion,svpsf" } else { "ri,distortion" };
    let films = setup.films.shoot(&chart, stages, &rects)?;
    Ok(Shots { points, rects, films, psf })
}

/// Measures the points in one band.
pub fn compare(setup: &Setup, truth: &BandTruth<'_>, band: usize, shots: &Shots) -> Result<Vec<Point>> {
    let half = if shots.psf { setup.windows_px[band] / 2 } else { 0 } + HALF_PX;
    let measured = shots.points.iter().zip(&shots.rects).zip(&shots.films[band]);
    let point = |((&chart_px, &rect), pixels): ((&(f64, f64), &Rect), &Vec<f32>)| {
        let mut lens_px = setup.on_film(truth, chart_px)?;
        if shots.psf {
            let (dy, dx) = (lens_px.0 - setup.axis_px.0, lens_px.1 - setup.axis_px.1);
            let r_px = dy.hypot(dx);
            let [moved, ..] = setup.moments_px(truth, band, r_px, dy.atan2(dx))?;
            if r_px > 0.0 {
                lens_px = (lens_px.0 + moved * dy / r_px, lens_px.1 + moved * dx / r_px);
            }
        }
        let film_px = centroid(pixels, rect, lens_px, half).with_context(|| {
            format!(
                "no light where the chart's point at row {}, column {} should land, row {:.1}, column {:.1} of the film",
                chart_px.0, chart_px.1, lens_px.0, lens_px.1
            )
        })?;
        Ok(Point { chart_px, film_px, lens_px })
    };
    measured.map(point).collect()
}
