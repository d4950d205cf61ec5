//! Distortion: centroids of points on the film, compared with the chief ray.
//!
//! A grid of 9 × 9 points (Gaussians of 3 px) passes relative illumination and distortion. The centroid of each on the film (not
//! divided by R, which changes by 2e-5 per pixel and so moves a centroid by less than 1e-4 px) is compared with the chief ray of
//! that field point: traced for a design, from the table for a pack. With the PSF stage a subset of the points is measured (by
//! symmetry the others add no information and would take nine times as long; `--full` measures all 81); there the radial offset of
//! the PSF's centroid from the chief ray is subtracted. Errors are distances in film pixels.

use super::film_maker::{RegionPixels, inside_film};
use super::reference::ReferenceBand;
use super::setup::Setup;
use anyhow::{Context, Result};
use pipeline::chart::Generator;
use pipeline::geometry::Rect;
use pipeline::measure::centroid::centroid;
use pipeline::stage::Stage;

/// Points along a side.
const COUNT: usize = 9;
/// Half the side of the square that a centroid is computed over, without the PSF's half window: beyond it a Gaussian of 3 px is
/// negligible.
const HALF_PX: usize = 10;
/// Margin of the film region around that square: lateral colour moves a point between bands.
const MARGIN_PX: usize = 10;

/// Positions (row, column) of one point in one band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    pub chart_px: (f64, f64),
    /// Centroid on the film.
    pub film_px: (f64, f64),
    /// Expected: chief ray, with the PSF stage centroid of the PSF.
    pub lens_px: (f64, f64),
}

impl Point {
    /// Film minus expected position, px: (row, column).
    pub fn error_px(&self) -> (f64, f64) {
        (self.film_px.0 - self.lens_px.0, self.film_px.1 - self.lens_px.1)
    }
}

/// Mean and maximum error, px.
pub fn mean_max(points: &[Point]) -> (f64, f64) {
    let errors = points.iter().map(|p| p.error_px()).map(|(y, x)| y.hypot(x));
    let (sum, max) = errors.fold((0.0, 0.0f64), |(s, m), e| (s + e, m.max(e)));
    (sum / points.len().max(1) as f64, max)
}

/// Film regions around the points.
pub struct PointFilm {
    points: Vec<(f64, f64)>,
    rects: Vec<Rect>,
    pixels: RegionPixels,
    psf: bool,
}

/// Simulates the film of the points, with or without the PSF stage.
pub fn simulate(setup: &Setup, psf: bool) -> Result<PointFilm> {
    let chart = setup.chart("points", &format!("&count={COUNT}"));
    let all = chart.parse::<Generator>()?.points_px().to_vec();
    let measured = |i: &usize| {
        let (row, col) = (i / COUNT, i % COUNT);
        let centre = COUNT / 2;
        !psf || setup.full() || (row >= centre && col >= centre && (row == centre || row == col))
    };
    let points: Vec<(f64, f64)> = (0..all.len()).filter(measured).map(|i| all[i]).collect();
    let middle = setup.reference.band(setup.wavelengths_nm[setup.wavelengths_nm.len() / 2])?;
    let max_window = setup.windows_px.iter().copied().max().unwrap_or(1);
    let half = if psf { max_window / 2 } else { 0 } + HALF_PX + MARGIN_PX;
    let rect = |&chart_px: &(f64, f64)| {
        let (row, col) = setup.film_position(&middle, chart_px)?;
        let side = 2 * half + 1;
        let rect = Rect::new(row.round() as i64 - half as i64, col.round() as i64 - half as i64, side, side);
        inside_film(rect, setup.size, "a point near the border")
    };
    let rects: Vec<Rect> = points.iter().map(rect).collect::<Result<_>>()?;
    let stages = if psf { Stage::REMAP_AND_PSF } else { Stage::REMAP };
    let pixels = setup.simulate(&chart, stages, &rects)?;
    Ok(PointFilm { points, rects, pixels, psf })
}

/// Measures the points in one band.
pub fn compare(
    setup: &Setup,
    reference: &ReferenceBand<'_>,
    band: usize,
    film: &PointFilm,
) -> Result<Vec<Point>> {
    let half = if film.psf { setup.windows_px[band] / 2 } else { 0 } + HALF_PX;
    let measured = film.points.iter().zip(&film.rects).zip(&film.pixels[band]);
    let point = |((&chart_px, &rect), pixels): ((&(f64, f64), &Rect), &Vec<f32>)| {
        let mut lens_px = setup.film_position(reference, chart_px)?;
        if film.psf {
            let (dy, dx) = (lens_px.0 - setup.axis_px.0, lens_px.1 - setup.axis_px.1);
            let r_px = dy.hypot(dx);
            let [offset, ..] = setup.psf_moments(reference, band, r_px, dy.atan2(dx))?;
            if r_px > 0.0 {
                lens_px = (lens_px.0 + offset * dy / r_px, lens_px.1 + offset * dx / r_px);
            }
        }
        let film_px = centroid(pixels, rect, lens_px, half).with_context(|| {
            format!(
                "no light around the expected image of the chart point at row {}, column {}: row {:.1}, column {:.1} of the film",
                chart_px.0, chart_px.1, lens_px.0, lens_px.1
            )
        })?;
        Ok(Point { chart_px, film_px, lens_px })
    };
    measured.map(point).collect()
}
