//! Edge spread functions of slanted edges on the film, compared with the integral of the PSF across the edge.
//!
//! Edges are at the centre, at mid-field on +x and in a corner, with normals 5° off the radial and off the tangential direction
//! (the slant of ISO 12233). The film is divided by R. The distance of a film pixel from the edge is that of its chart point, found
//! by the chief ray, divided by the local scale. It is NOT fitted, so a displaced edge counts as an error. Bins of 1/4 px; both
//! curves are normalised by their plateaus, the means beyond the PSF's half window + 3 px.
//!
//! The expected curve is [`pipeline::measure::expected`] of the PSF at that field point in the window of the film kernels, as shares
//! of entire film pixels, with the square of the chart pixel (1/m px), the bin, and the mean of the Catmull-Rom weights at the
//! phases of the region's pixels (on the axis all phases are equal). Where the film has the tails of PSFs, the PSF is that of three windows a side: its light
//! beyond the film kernels' window is expected where it lies, not scaled into the window. What lies beyond three windows moves both
//! plateaus alike, to about 1.5e-4 of the step.
//! *Entire pixels.* The film sums light over discrete pixels. Integrated over the plane instead, with squares for both apertures,
//! the curve differs by up to 1.5e-2 where the PSF has detail finer than a pixel ([`super::error_budget`], `sampling`).

use super::edge_places::{EdgePlace, angles};
use super::error_budget::{ErrorBudget, MeasuredEdge, RunPsfs};
use super::film_maker::inside_film;
use super::interpolated_lens::InterpolatedLens;
use super::reference::{Beyond, ReferenceBand};
use super::setup::Setup;
use anyhow::{Context, Result};
use pipeline::geometry::Rect;
use pipeline::measure::agreement::{Agreement, agreement};
use pipeline::measure::edge::{Esf, EsfSample, OVERSAMPLING};
use pipeline::measure::expected::{ExpectedEsf, Share, StepEdge, catmull_rom};
use pipeline::measure::sfr::Mtf;
use pipeline::stage::Stage;

/// Half the measured length of an edge: eleven complete crossings of the pixel columns at 5°.
const HALF_LENGTH_PX: f64 = 62.9;
/// Distance of a plateau from the PSF's half window, and its width.
const PLATEAU_PX: (f64, f64) = (3.0, 8.0);
/// Resolution of the mean interpolation weights, steps per film pixel.
const WEIGHT_STEPS: f64 = 64.0;

/// Results of one edge in one band.
#[derive(Clone, Debug)]
pub struct EdgeResult {
    pub place: EdgePlace,
    /// REAL image height, mm.
    pub height_mm: f64,
    /// Half the PSF window, px.
    pub half_px: f64,
    /// Distance from the edge, px; edge spread function of the film; expected value.
    pub samples: Vec<(f64, f64, f64)>,
    /// Agreement of the samples within the half window.
    pub agreement: Agreement,
    /// Attribution of the difference.
    pub error_budget: ErrorBudget,
    pub film_mtf: Mtf,
    pub lens_mtf: Mtf,
}

/// Film region around an edge.
pub struct EdgeFilm {
    pub place: EdgePlace,
    pub rect: Rect,
    pub pixels: Vec<Vec<f32>>,
}

/// Simulates the films: one per angle, with a region around each edge.
pub fn simulate(setup: &Setup, places: &[EdgePlace]) -> Result<Vec<EdgeFilm>> {
    let max_window = setup.windows_px.iter().copied().max().unwrap_or(1) as f64;
    let reach = max_window / 2.0 + PLATEAU_PX.0 + PLATEAU_PX.1;
    // Lateral colour moves an edge by a few px between bands.
    let side = 2 * (reach * 1.09 + 12.0).max(HALF_LENGTH_PX + 12.0).ceil() as usize + 1;
    let patch = (2 * side + max_window as usize).max(600);
    let middle = setup.reference.band(setup.wavelengths_nm[setup.wavelengths_nm.len() / 2])?;
    let mut films = Vec::new();
    for angle in angles(places) {
        let edges: Vec<&EdgePlace> = places.iter().filter(|p| p.angle_deg == angle).collect();
        let centres: Vec<String> =
            edges.iter().map(|p| format!("{},{}", p.centre_px.1, p.centre_px.0)).collect();
        let chart = setup.chart(
            "slanted-edge",
            &format!("&angle_deg={angle}&patch_px={patch}&centers={}", centres.join(";")),
        );
        let rects = edges.iter().map(|p| {
            let (row, col) = setup.film_position(&middle, p.centre_px)?;
            let half = (side / 2) as i64;
            let rect = Rect::new(row.round() as i64 - half, col.round() as i64 - half, side, side);
            inside_film(rect, setup.size, &format!("the edge at the {}", p.name))
        });
        let rects: Vec<Rect> = rects.collect::<Result<_>>()?;
        let mut bands = setup.simulate(&chart, Stage::REMAP_AND_PSF, &rects)?;
        for (i, (place, rect)) in edges.into_iter().zip(rects).enumerate() {
            let pixels = bands.iter_mut().map(|band| std::mem::take(&mut band[i])).collect();
            films.push(EdgeFilm { place: place.clone(), rect, pixels });
        }
    }
    Ok(films)
}

/// Maps film pixels to distances from an edge on the chart.
struct EdgeMapping {
    lens: InterpolatedLens,
    /// Centre (row, column) of the edge from the chart centre, chart pixels.
    edge: (f64, f64),
    /// Normal (row, column) of the edge on the chart.
    normal: (f64, f64),
    /// Centre (row, column) of the film region.
    centre: (f64, f64),
    /// Chart pixels per film pixel across the edge.
    scale: f64,
    /// Azimuth of the edge's normal on the film, rad.
    normal_rad: f64,
}

impl EdgeMapping {
    fn new(setup: &Setup, reference: &ReferenceBand<'_>, place: &EdgePlace, rect: Rect) -> Result<Self> {
        let lens = InterpolatedLens::new(reference, rect, setup.axis_px, setup.pitch_um * 1e-3)?;
        let chart_centre = setup.chart_centre();
        let (sin, cos) = place.angle_deg.to_radians().sin_cos();
        let centre = (rect.y as f64 + (rect.height / 2) as f64, rect.x as f64 + (rect.width / 2) as f64);
        let mut mapping = Self {
            lens,
            edge: (place.centre_px.0 - chart_centre.0, place.centre_px.1 - chart_centre.1),
            normal: (sin, cos),
            centre,
            scale: 1.0,
            normal_rad: 0.0,
        };
        let distance = |dy: f64, dx: f64| mapping.chart_distance((centre.0 + dy, centre.1 + dx)).0;
        let slope = (distance(2.0, 0.0) - distance(-2.0, 0.0), distance(0.0, 2.0) - distance(0.0, -2.0));
        (mapping.scale, mapping.normal_rad) = (slope.0.hypot(slope.1) / 4.0, slope.0.atan2(slope.1));
        Ok(mapping)
    }

    /// Of a film position: distance from the edge on the chart, chart pixels; chart position (row, column) from the chart
    /// centre; R.
    fn chart_distance(&self, film_px: (f64, f64)) -> (f64, (f64, f64), f64) {
        let ((row, col), gain) = self.lens.chart_position(film_px);
        let d = (row - self.edge.0) * self.normal.0 + (col - self.edge.1) * self.normal.1;
        (d, (row, col), gain)
    }

    /// Distance from the edge on the film, px; none beyond [`HALF_LENGTH_PX`] along the edge.
    fn distance(&self, y: i64, x: i64) -> Option<f64> {
        let at = (y as f64, x as f64);
        let (sin, cos) = self.normal_rad.sin_cos();
        let along = (at.0 - self.centre.0) * cos - (at.1 - self.centre.1) * sin;
        (along.abs() <= HALF_LENGTH_PX).then(|| self.chart_distance(at).0 / self.scale)
    }

    /// Mean interpolation weights of the pixels within ±3 px of the edge, projected on its normal. Only the fraction of
    /// `chart_centre`, in chart pixels, is used.
    fn mean_weights(&self, rect: Rect, chart_centre: (f64, f64)) -> Vec<Share> {
        let reach = (4.0 * WEIGHT_STEPS) as usize;
        let mut line = vec![0.0; 2 * reach + 2];
        let mut count = 0.0;
        for y in rect.y..rect.bottom() {
            for x in rect.x..rect.right() {
                if self.distance(y, x).is_none_or(|d| d.abs() > 3.0) {
                    continue;
                }
                let (_, (row, col), _) = self.chart_distance((y as f64, x as f64));
                let fraction = |v: f64| v - v.floor();
                let (fy, fx) = (fraction(row + chart_centre.0), fraction(col + chart_centre.1));
                count += 1.0;
                for (i, wy) in catmull_rom(fy).into_iter().enumerate() {
                    for (j, wx) in catmull_rom(fx).into_iter().enumerate() {
                        let (dy, dx) = (i as f64 - 1.0 - fy, j as f64 - 1.0 - fx);
                        let u = (dy * self.normal.0 + dx * self.normal.1) / self.scale;
                        let at = u * WEIGHT_STEPS + reach as f64;
                        let (cell, t) = (at.floor() as usize, at - at.floor());
                        line[cell] += wy * wx * (1.0 - t);
                        line[cell + 1] += wy * wx * t;
                    }
                }
            }
        }
        let (sin, cos) = self.normal_rad.sin_cos();
        let place = |i: usize| (i as f64 - reach as f64) / WEIGHT_STEPS;
        let nonzero = line.iter().enumerate().filter(|(_, w)| **w != 0.0);
        nonzero.map(|(i, w)| ((place(i) * sin, place(i) * cos), w / count)).collect()
    }
}

/// Measures an edge in one band and compares it with the reference; `run` holds the PSFs that the film was made with.
pub fn compare(
    setup: &Setup,
    reference: &ReferenceBand<'_>,
    run: &RunPsfs,
    band: usize,
    film: &EdgeFilm,
) -> Result<EdgeResult> {
    let (window, pitch_um) = (setup.windows_px[band], setup.pitch_um);
    let EdgeFilm { place, rect, .. } = film;
    let mapping = EdgeMapping::new(setup, reference, place, *rect)?;
    let (dy, dx) = (mapping.centre.0 - setup.axis_px.0, mapping.centre.1 - setup.axis_px.1);
    let (height_mm, azimuth_rad) = (dy.hypot(dx) * pitch_um * 1e-3, dy.atan2(dx));
    let step = StepEdge {
        normal_rad: mapping.normal_rad,
        squares_px: vec![1.0 / mapping.scale],
        bin_px: 1.0 / OVERSAMPLING,
        taps: mapping.mean_weights(*rect, setup.chart_centre()),
    };
    let kernel = reference.pixels(height_mm, azimuth_rad, window, pitch_um)?;
    let inside = ExpectedEsf::new(kernel.into_iter(), 0.0, &step);
    let beyond = match setup.has_tails[band] {
        true => reference.beyond(height_mm, azimuth_rad, window, pitch_um)?,
        false => Beyond::default(),
    };
    let outside = ExpectedEsf::new(beyond.shares.iter().copied(), 0.0, &step);
    let whole = |distance_px: f64, inside: f64| beyond.inside * inside + outside.at(distance_px);
    let half_px = (window as f64 - 1.0) / 2.0;
    let plateau = half_px + PLATEAU_PX.0;
    let mut pixels = film.pixels[band].clone();
    for (y, line) in (rect.y..).zip(pixels.chunks_exact_mut(rect.width)) {
        for (x, value) in (rect.x..).zip(line) {
            *value /= mapping.chart_distance((y as f64, x as f64)).2 as f32;
        }
    }
    let context = || format!("the edge at the {}", place.title());
    let distance = |y, x| mapping.distance(y, x);
    let film = Esf::new(&pixels, *rect, plateau + PLATEAU_PX.1, distance).with_context(context)?;
    let at = |s: &EsfSample| whole(s.distance_px, inside.at(s.distance_px));
    let lens = Esf { samples: film.samples.iter().map(|s| EsfSample { value: at(s), ..*s }).collect() };
    let (dark, light) = lens.plateaus(plateau);
    let normalised_whole =
        |distance_px: f64, inside: f64| (whole(distance_px, inside) - dark) / (light - dark);
    let lens = lens.normalised(plateau).with_context(context)?;
    let film = film.normalised(plateau).with_context(context)?;
    let samples: Vec<(f64, f64, f64)> =
        film.samples.iter().zip(&lens.samples).map(|(f, l)| (f.distance_px, f.value, l.value)).collect();
    let in_window = |esf: &Esf| esf.within(half_px).map(|s| s.value).collect::<Vec<_>>();
    let psf = reference.psf(height_mm, window, pitch_um)?;
    let field_point = (height_mm, azimuth_rad);
    let measured = MeasuredEdge {
        psf: &psf,
        field_point,
        step: &step,
        samples: &samples,
        half_px,
        whole: &normalised_whole,
    };
    Ok(EdgeResult {
        place: place.clone(),
        height_mm,
        half_px,
        agreement: agreement(&in_window(&film), &in_window(&lens), 1.0 / OVERSAMPLING),
        error_budget: run.error_budget(setup, &measured),
        samples,
        film_mtf: Mtf::from_esf(&film),
        lens_mtf: Mtf::from_esf(&lens),
    })
}
