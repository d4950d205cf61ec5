//! Edge spread functions: slanted edges through the lens against its PSF summed straight across them.
//!
//! Edges stand at the centre, at mid-field on +x and in a corner, their normals 5° off the radius and off the tangent (the
//! slant of ISO 12233). The film is divided by R; a pixel's distance from the edge is that of its chart point, taken there by the
//! chief ray, over the local scale: NOT fitted, so that a displaced edge counts as an error. Bins of 1/4 px; both curves are
//! normalised by their plateaus, the means beyond the PSF's half window + 3 px.
//! The expected curve: [`pipeline::measure::expected`], of the PSF at that place and azimuth in the window that the film's
//! kernels have, as its shares of whole film pixels; with the chart pixel's square (1/m px), the bin, and the mean of the
//! Catmull-Rom taps at the phases that the window's pixels really have (on the axis all phases are the same).
//! *Whole pixels.* The film sums light over pixels, one by one; integrated over the plane instead, with squares for both
//! apertures, the curve differs by up to 1.5e-2 where the PSF has detail finer than a pixel: [`super::blame`] tells by how much.

use super::Setup;
use super::blame::{Blame, Found, RunPsfs};
use super::films::on_film;
use super::local::Local;
use super::truth::BandTruth;
use anyhow::{Context, Result};
use pipeline::geometry::Rect;
use pipeline::measure::agreement::{Agreement, agreement};
use pipeline::measure::edge::{Esf, EsfSample, OVERSAMPLING};
use pipeline::measure::expected::{ExpectedEsf, Share, Step, catmull_rom};
use pipeline::measure::sfr::Mtf;

/// Pixels this far along the edge to either side of its middle count: eleven whole crossings of the pixel columns at 5°.
const ALONG_PX: f64 = 62.9;
/// Film pixels beyond the PSF's half window before a plateau begins, and its width.
const PLATEAU_PX: (f64, f64) = (3.0, 8.0);
/// Slant, degrees.
const SLANT_DEG: f64 = 5.0;
/// Steps per film pixel of the taps' mean.
const TAP_STEPS: f64 = 64.0;

/// An edge and where it stands.
#[derive(Clone, Debug, PartialEq)]
pub struct Place {
    /// centre, mid-field or corner.
    pub name: &'static str,
    /// Which way its normal points: radial or tangential.
    pub direction: &'static str,
    /// A point (row, column) on it, chart pixels counted as film pixels.
    pub centre_px: (f64, f64),
    /// Its normal on the chart, from dark to light: azimuth in degrees.
    pub angle_deg: f64,
}

/// What was found at one place in one band.
#[derive(Clone, Debug)]
pub struct Edge {
    /// Where it stands.
    pub place: Place,
    /// REAL image height, mm.
    pub height_mm: f64,
    /// Half the PSF window, px.
    pub half_px: f64,
    /// Distances, px, and the values of film and lens there.
    pub samples: Vec<(f64, f64, f64)>,
    /// Of the samples within the half window.
    pub agreement: Agreement,
    /// What the difference comes from.
    pub blame: Blame,
    /// Of the film.
    pub film_mtf: Mtf,
    /// Of the lens.
    pub lens_mtf: Mtf,
}

/// The six places of a film of `size` pixels: mid-field and corner at 10 mm and 19 mm on the paper's film.
pub fn places(size: usize) -> Vec<Place> {
    let (middle, half) = ((size as f64 - 1.0) / 2.0, size as f64 / 2.0);
    let at = [
        ("centre", (0.0, 0.0), 0.0),
        ("mid-field", (0.0, std::f64::consts::FRAC_1_SQRT_2), 0.0),
        ("corner", (0.95, 0.95), 45.0),
    ];
    // One slant to each side: a PSF turned by twice the slant would hide behind one of them, never behind both.
    let both = [("radial", SLANT_DEG), ("tangential", 90.0 - SLANT_DEG)];
    let place = |(name, (y, x), azimuth_deg): (&'static str, (f64, f64), f64)| {
        both.map(|(direction, turn)| Place {
            name,
            direction,
            centre_px: ((middle + y * half).round(), (middle + x * half).round()),
            angle_deg: azimuth_deg + turn,
        })
    };
    at.into_iter().flat_map(place).collect()
}

/// An edge's film window and the pixels of it, band by band.
pub struct Shot {
    /// The edge.
    pub place: Place,
    /// The film window.
    pub rect: Rect,
    /// Pixels, by band.
    pub pixels: Vec<Vec<f32>>,
}

/// Makes the films: one per angle, each with its windows.
pub fn shoot(setup: &Setup, places: &[Place]) -> Result<Vec<Shot>> {
    let widest = setup.windows_px.iter().copied().max().unwrap_or(1) as f64;
    let reach = widest / 2.0 + PLATEAU_PX.0 + PLATEAU_PX.1;
    // Lateral colour moves an edge by a few px between bands.
    let side = 2 * (reach * 1.09 + 12.0).max(ALONG_PX + 12.0).ceil() as usize + 1;
    let patch = (2 * side + widest as usize).max(600);
    let middle = setup.truth.band(setup.wavelengths_nm[setup.wavelengths_nm.len() / 2])?;
    let mut angles: Vec<f64> = places.iter().map(|p| p.angle_deg).collect();
    angles.sort_by(f64::total_cmp);
    angles.dedup();
    let mut shots = Vec::new();
    for angle in angles {
        let here: Vec<&Place> = places.iter().filter(|p| p.angle_deg == angle).collect();
        let list: Vec<String> = here.iter().map(|p| format!("{},{}", p.centre_px.1, p.centre_px.0)).collect();
        let chart = setup.chart(
            "slanted-edge",
            &format!("&angle_deg={angle}&patch_px={patch}&centers={}", list.join(";")),
        );
        let rects = here.iter().map(|p| {
            let (row, col) = setup.on_film(&middle, p.centre_px)?;
            let half = (side / 2) as i64;
            let rect = Rect::new(row.round() as i64 - half, col.round() as i64 - half, side, side);
            on_film(rect, setup.size, &format!("the edge at the {}", p.name))
        });
        let rects: Vec<Rect> = rects.collect::<Result<_>>()?;
        let mut films = setup.films.shoot(&chart, "ri,distortion,svpsf", &rects)?;
        for (i, (place, rect)) in here.into_iter().zip(rects).enumerate() {
            let pixels = films.iter_mut().map(|band| std::mem::take(&mut band[i])).collect();
            shots.push(Shot { place: place.clone(), rect, pixels });
        }
    }
    Ok(shots)
}

/// Film pixels by their distance from an edge on the chart.
pub struct Mapped {
    local: Local,
    /// A point (row, column) of the edge from the middle of the chart, chart pixels.
    edge: (f64, f64),
    normal: (f64, f64),
    middle: (f64, f64),
    /// Chart pixels per film pixel across the edge.
    scale: f64,
    /// Direction of the edge's normal on the film, rad.
    normal_rad: f64,
}

impl Mapped {
    /// The edge of `place` through `truth`.
    pub fn new(setup: &Setup, truth: &BandTruth<'_>, place: &Place, rect: Rect) -> Result<Self> {
        let local = Local::new(truth, rect, setup.axis_px, setup.pitch_um * 1e-3)?;
        let chart_middle = setup.chart_middle();
        let (sin, cos) = place.angle_deg.to_radians().sin_cos();
        let middle = (rect.y as f64 + (rect.height / 2) as f64, rect.x as f64 + (rect.width / 2) as f64);
        let mut mapped = Self {
            local,
            edge: (place.centre_px.0 - chart_middle.0, place.centre_px.1 - chart_middle.1),
            normal: (sin, cos),
            middle,
            scale: 1.0,
            normal_rad: 0.0,
        };
        let across = |dy: f64, dx: f64| mapped.on_chart((middle.0 + dy, middle.1 + dx)).0;
        let slope = (across(2.0, 0.0) - across(-2.0, 0.0), across(0.0, 2.0) - across(0.0, -2.0));
        (mapped.scale, mapped.normal_rad) = (slope.0.hypot(slope.1) / 4.0, slope.0.atan2(slope.1));
        Ok(mapped)
    }

    /// Distance on the chart, chart pixels; the place (row, column) there from the middle; R.
    fn on_chart(&self, at: (f64, f64)) -> (f64, (f64, f64), f64) {
        let ((row, col), gain) = self.local.at(at);
        let d = (row - self.edge.0) * self.normal.0 + (col - self.edge.1) * self.normal.1;
        (d, (row, col), gain)
    }

    /// Distance on the film, px, where the pixel lies near enough to the edge's middle to count.
    fn distance(&self, y: i64, x: i64) -> Option<f64> {
        let at = (y as f64, x as f64);
        let (sin, cos) = self.normal_rad.sin_cos();
        let along = (at.0 - self.middle.0) * cos - (at.1 - self.middle.1) * sin;
        (along.abs() <= ALONG_PX).then(|| self.on_chart(at).0 / self.scale)
    }

    /// The mean tap set of the pixels within ±3 px of the edge, laid out along its normal. `chart_middle` is the middle of the
    /// chart in chart pixels, of which the fraction counts.
    fn taps(&self, rect: Rect, chart_middle: (f64, f64)) -> Vec<Share> {
        let reach = (4.0 * TAP_STEPS) as usize;
        let mut line = vec![0.0; 2 * reach + 2];
        let mut count = 0.0;
        for y in rect.y..rect.bottom() {
            for x in rect.x..rect.right() {
                if self.distance(y, x).is_none_or(|d| d.abs() > 3.0) {
                    continue;
                }
                let (_, (row, col), _) = self.on_chart((y as f64, x as f64));
                let fraction = |v: f64| v - v.floor();
                let (fy, fx) = (fraction(row + chart_middle.0), fraction(col + chart_middle.1));
                count += 1.0;
                for (i, wy) in catmull_rom(fy).into_iter().enumerate() {
                    for (j, wx) in catmull_rom(fx).into_iter().enumerate() {
                        let (dy, dx) = (i as f64 - 1.0 - fy, j as f64 - 1.0 - fx);
                        let u = (dy * self.normal.0 + dx * self.normal.1) / self.scale;
                        let at = u * TAP_STEPS + reach as f64;
                        let (cell, t) = (at.floor() as usize, at - at.floor());
                        line[cell] += wy * wx * (1.0 - t);
                        line[cell + 1] += wy * wx * t;
                    }
                }
            }
        }
        let (sin, cos) = self.normal_rad.sin_cos();
        let place = |i: usize| (i as f64 - reach as f64) / TAP_STEPS;
        let taken = line.iter().enumerate().filter(|(_, w)| **w != 0.0);
        taken.map(|(i, w)| ((place(i) * sin, place(i) * cos), w / count)).collect()
    }
}

/// Measures an edge in one band, and compares; `run` are the PSFs that the film was made with.
pub fn compare(
    setup: &Setup,
    truth: &BandTruth<'_>,
    run: &RunPsfs,
    band: usize,
    shot: &Shot,
) -> Result<Edge> {
    let (window, pitch_um) = (setup.windows_px[band], setup.pitch_um);
    let mapped = Mapped::new(setup, truth, &shot.place, shot.rect)?;
    let (dy, dx) = (mapped.middle.0 - setup.axis_px.0, mapped.middle.1 - setup.axis_px.1);
    let (height_mm, azimuth_rad) = (dy.hypot(dx) * pitch_um * 1e-3, dy.atan2(dx));
    let step = Step {
        normal_rad: mapped.normal_rad,
        squares_px: vec![1.0 / mapped.scale],
        bin_px: 1.0 / OVERSAMPLING,
        taps: mapped.taps(shot.rect, setup.chart_middle()),
    };
    let kernel = truth.pixels(height_mm, azimuth_rad, window, pitch_um)?;
    let expected = ExpectedEsf::new(kernel.into_iter(), 0.0, &step);
    let half_px = (window as f64 - 1.0) / 2.0;
    let plateau = half_px + PLATEAU_PX.0;
    let mut pixels = shot.pixels[band].clone();
    for (y, line) in (shot.rect.y..).zip(pixels.chunks_exact_mut(shot.rect.width)) {
        for (x, value) in (shot.rect.x..).zip(line) {
            *value /= mapped.on_chart((y as f64, x as f64)).2 as f32;
        }
    }
    let place = || format!("the edge at the {}, {}", shot.place.name, shot.place.direction);
    let at = |y, x| mapped.distance(y, x);
    let film = Esf::of(&pixels, shot.rect, plateau + PLATEAU_PX.1, at).with_context(place)?;
    let lens = film.samples.iter().map(|s| EsfSample { value: expected.at(s.distance_px), ..*s }).collect();
    let lens = Esf { samples: lens }.normalised(plateau).with_context(place)?;
    let film = film.normalised(plateau).with_context(place)?;
    let samples: Vec<(f64, f64, f64)> =
        film.samples.iter().zip(&lens.samples).map(|(f, l)| (f.distance_px, f.value, l.value)).collect();
    let inside = |esf: &Esf| esf.within(half_px).map(|s| s.value).collect::<Vec<_>>();
    let psf = truth.psf(height_mm, window, pitch_um)?;
    let found = Found { psf: &psf, at: (height_mm, azimuth_rad), step: &step, samples: &samples, half_px };
    Ok(Edge {
        place: shot.place.clone(),
        height_mm,
        half_px,
        agreement: agreement(&inside(&film), &inside(&lens), 1.0 / OVERSAMPLING),
        blame: run.blame(setup, &found),
        samples,
        film_mtf: Mtf::of(&film),
        lens_mtf: Mtf::of(&lens),
    })
}
