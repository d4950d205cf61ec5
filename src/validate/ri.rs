//! Relative illumination: a uniform chart through RI and distortion, and through the PSF.
//!
//! The film of a uniform chart of 1 is R(r): read along a strip from the axis to the right edge, one down to the lower edge, and
//! in squares along the four half-diagonals to the corners; means over bins of REAL height against R at the root mean square height
//! of the bin's pixels (R is even in height: so the bins' width costs 1e-8) (for a design Ω(r)/Ω(0), the pupil's projected solid angle traced at that height). IoU = Σ min / Σ max over all bins.
//! With the PSF on, the film of a uniform chart is not R: every pixel scatters its own PSF, of centroid c(r) outwards from the
//! chief ray and second moments m(r) outwards and n(r) across, so that to second order (a Taylor series of the scattered light)
//!     film/R − 1 = −(1/R)·div(R·c r̂) + ½(1/R)·div div(R·M) = (1/(R·r))·[−(r·R·c)′ + ½(r·R·m)″ − ½(R·n)′]
//! with c, m, n from the PSFs' own moments, apart from any film. For the Double Gauss the first term is 1e-3 and the second 1e-5 at
//! 410 nm, where it is far out of focus. Left over there: 2e-5, at most 6e-5 over all bands, not traced to a term; neither the
//! PSFs' being linear between heights nor the window's turning with azimuth makes it.

use super::Setup;
use super::films::{self, on_film};
use super::truth::BandTruth;
use anyhow::Result;
use pipeline::geometry::Rect;
use pipeline::measure::agreement::{Agreement, agreement};

/// Bins from the axis to the corner.
const BINS: f64 = 80.0;
/// Squares along each half-diagonal, and their side.
const SQUARES: usize = 16;
const SQUARE_PX: usize = 48;
/// Places with the PSF, as shares of the half-diagonal, and the side of the squares there.
const PSF_PLACES: [f64; 6] = [0.03, 0.2, 0.4, 0.6, 0.8, 0.96];
const PSF_SQUARE_PX: usize = 24;

/// Which way a window lies from the axis.
pub const DIRECTIONS: [&str; 6] = ["right", "down", "upper left", "upper right", "lower left", "lower right"];

/// One bin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bin {
    /// Index into [`DIRECTIONS`].
    pub direction: usize,
    /// Root mean square of its pixels' REAL heights, mm.
    pub height_mm: f64,
    /// Mean of the film.
    pub film: f64,
    /// R of the lens.
    pub lens: f64,
}

/// One place with the PSF: the film's departure from R, and what the PSFs' moments make it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Departure {
    /// REAL height, mm.
    pub height_mm: f64,
    /// film/R − 1.
    pub film: f64,
    /// What the PSFs' moments make it.
    pub lens: f64,
}

/// What was found in one band.
#[derive(Clone, Debug)]
pub struct Illumination {
    /// Bins of all directions.
    pub bins: Vec<Bin>,
    /// Over all bins.
    pub agreement: Agreement,
    /// With the PSF.
    pub departures: Vec<Departure>,
}

/// The films and where to look.
pub struct Shots {
    /// Windows with their directions.
    windows: Vec<(usize, Rect)>,
    plain: films::Shots,
    /// Windows with the PSF.
    places: Vec<Rect>,
    psf: films::Shots,
}

/// Makes the films of the uniform chart.
pub fn shoot(setup: &Setup) -> Result<Shots> {
    let n = setup.size;
    let middle = (n - 1) / 2;
    let mut windows = vec![
        (0, Rect::new(middle as i64, middle as i64, 2, n - middle)),
        (1, Rect::new(middle as i64, middle as i64, n - middle, 2)),
    ];
    for (direction, (sy, sx)) in [(-1, -1), (-1, 1), (1, -1), (1, 1)].into_iter().enumerate() {
        for k in 0..SQUARES {
            let out = (middle - SQUARE_PX / 2) * (k + 1) / SQUARES;
            let at = |sign: i64| middle as i64 + sign * out as i64 - (SQUARE_PX / 2) as i64;
            windows.push((2 + direction, Rect::new(at(sy), at(sx), SQUARE_PX, SQUARE_PX)));
        }
    }
    let chart = setup.chart("uniform", "&value=1");
    let rects: Vec<Rect> =
        windows.iter().map(|w| on_film(w.1, n, "relative illumination")).collect::<Result<_>>()?;
    let plain = setup.films.shoot(&chart, "ri,distortion", &rects)?;
    let places: Vec<Rect> = PSF_PLACES
        .iter()
        .map(|out| {
            let at = middle as f64 * (1.0 + out) - PSF_SQUARE_PX as f64 / 2.0;
            let rect = Rect::new(at.round() as i64, at.round() as i64, PSF_SQUARE_PX, PSF_SQUARE_PX);
            on_film(rect, n, "relative illumination with the PSF")
        })
        .collect::<Result<_>>()?;
    let psf = setup.films.shoot(&chart, "ri,distortion,svpsf", &places)?;
    Ok(Shots { windows, plain, places, psf })
}

/// Measures one band.
pub fn compare(setup: &Setup, truth: &BandTruth<'_>, band: usize, shots: &Shots) -> Result<Illumination> {
    let pitch_mm = setup.pitch_um * 1e-3;
    let corner_mm = setup.size as f64 * pitch_mm / std::f64::consts::SQRT_2;
    let height_mm =
        |y: i64, x: i64| (y as f64 - setup.axis_px.0).hypot(x as f64 - setup.axis_px.1) * pitch_mm;
    let mut sums = vec![(0.0, 0.0, 0usize); DIRECTIONS.len() * (BINS as usize + 2)];
    for ((direction, rect), pixels) in shots.windows.iter().zip(&shots.plain[band]) {
        for (i, v) in pixels.iter().enumerate() {
            let r = height_mm(rect.y + (i / rect.width) as i64, rect.x + (i % rect.width) as i64);
            let bin = ((r / corner_mm * BINS) as usize).min(BINS as usize + 1);
            let (height, sum, count) = &mut sums[direction * (BINS as usize + 2) + bin];
            (*height, *sum, *count) = (*height + r * r, *sum + f64::from(*v), *count + 1);
        }
    }
    let mut bins = Vec::new();
    for (i, (height, sum, count)) in sums.into_iter().enumerate().filter(|(_, s)| s.2 > 0) {
        let (height_mm, film) = ((height / count as f64).sqrt(), sum / count as f64);
        let direction = i / (BINS as usize + 2);
        bins.push(Bin { direction, height_mm, film, lens: truth.illumination(height_mm)? });
    }
    let of = |f: fn(&Bin) -> f64| bins.iter().map(f).collect::<Vec<_>>();
    let agreement = agreement(&of(|b| b.film), &of(|b| b.lens), 1.0 / BINS);
    let departures = shots.places.iter().zip(&shots.psf[band]).map(|(rect, pixels)| {
        let (cy, cx) =
            (rect.y as f64 + rect.height as f64 / 2.0 - 0.5, rect.x as f64 + rect.width as f64 / 2.0 - 0.5);
        let r_px = (cy - setup.axis_px.0).hypot(cx - setup.axis_px.1);
        let azimuth_rad = (cy - setup.axis_px.0).atan2(cx - setup.axis_px.1);
        let film = pixels.iter().map(|v| f64::from(*v)).sum::<f64>() / pixels.len() as f64;
        // Derivatives across ± 0.5 mm, or half way to the axis.
        let step = (0.5 / pitch_mm).min(r_px / 2.0);
        let moments = |r: f64| -> Result<[f64; 3]> {
            let [c, out, across] = setup.moments_px(truth, band, r, azimuth_rad)?;
            let gain = truth.illumination(r * pitch_mm)?;
            Ok([r * gain * c, r * gain * out, gain * across])
        };
        let (inner, middle, outer) = (moments(r_px - step)?, moments(r_px)?, moments(r_px + step)?);
        let slope = |i: usize| (outer[i] - inner[i]) / (2.0 * step);
        let bend = (outer[1] - 2.0 * middle[1] + inner[1]) / (step * step);
        let at = truth.illumination(r_px * pitch_mm)?;
        let lens = (-slope(0) + 0.5 * bend - 0.5 * slope(2)) / (at * r_px);
        Ok(Departure { height_mm: r_px * pitch_mm, film: film / at - 1.0, lens })
    });
    let departures = departures.collect::<Result<_>>()?;
    Ok(Illumination { bins, agreement, departures })
}
