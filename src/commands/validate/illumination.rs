//! Relative illumination: a uniform chart through RI and distortion, and through the PSF.
//!
//! Without the PSF stage the film of a uniform chart of value 1 is R(r). It is read along two lines from the axis, to the right edge
//! and to the lower edge, and in squares along the four half-diagonals to the corners. Means over bins of REAL height are compared
//! with R at the root mean square height of the bin's pixels (R is even in height, so the width of the bins costs 1e-8); for a design
//! R is G(r)/G(0), irradiance of the film over radiance of the object, traced at that height. IoU = Σ min / Σ max over all bins.
//!
//! With the PSF stage the film of a uniform chart is not R: every pixel scatters its own PSF, with radial centroid c(r) from the
//! chief ray and second moments m(r) (radial) and n(r) (tangential), so to second order (a Taylor series of the scattered light)
//! ```text
//! film/R − 1 = −(1/R)·div(R·c r̂) + ½(1/R)·div div(R·M) = (1/(R·r))·[−(r·R·c)′ + ½(r·R·m)″ − ½(R·n)′]
//! ```
//! with c, m, n from the moments of the reference PSFs. For the Double Gauss the first term is 1e-3 and the second 1e-5 at 410 nm,
//! where it is far out of focus. The remaining difference there is 2e-5, at most 6e-5 over all bands. Its cause is not known; it is
//! neither the linear interpolation of the PSFs between heights nor the rotation of the window with azimuth.

use super::film_maker::{RegionPixels, inside_film};
use super::reference::ReferenceBand;
use super::setup::Setup;
use anyhow::Result;
use pipeline::geometry::Rect;
use pipeline::measure::agreement::{Agreement, agreement};

/// Bins from the axis to the corner.
const BINS: f64 = 80.0;
/// Squares along each half-diagonal, and their side.
const SQUARES: usize = 16;
const SQUARE_PX: usize = 48;
/// Positions measured with the PSF stage, as shares of the half-diagonal, and the side of the squares there.
const PSF_POSITIONS: [f64; 6] = [0.03, 0.2, 0.4, 0.6, 0.8, 0.96];
const PSF_SQUARE_PX: usize = 24;

/// Direction of a region from the axis.
pub const DIRECTIONS: [&str; 6] = ["right", "down", "upper left", "upper right", "lower left", "lower right"];

/// One bin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bin {
    /// Index into [`DIRECTIONS`].
    pub direction: usize,
    /// Root mean square of its pixels' REAL heights, mm.
    pub height_mm: f64,
    pub film: f64,
    /// R of the reference lens.
    pub lens: f64,
}

/// Departure of the film from R at one position with the PSF stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Departure {
    /// REAL height, mm.
    pub height_mm: f64,
    /// film/R − 1.
    pub film: f64,
    /// Expected value from the moments of the PSFs.
    pub lens: f64,
}

/// Results of one band.
#[derive(Clone, Debug)]
pub struct Illumination {
    pub bins: Vec<Bin>,
    pub agreement: Agreement,
    /// Departures from R with the PSF stage.
    pub departures: Vec<Departure>,
}

/// Films of the uniform chart without and with the PSF stage.
pub struct UniformFilms {
    /// Regions without the PSF stage, with their directions.
    regions: Vec<(usize, Rect)>,
    pixels: RegionPixels,
    /// Regions with the PSF stage.
    psf_regions: Vec<Rect>,
    psf_pixels: RegionPixels,
}

/// Simulates the films of the uniform chart.
pub fn simulate(setup: &Setup) -> Result<UniformFilms> {
    let n = setup.size;
    let middle = (n - 1) / 2;
    let mut regions = vec![
        (0, Rect::new(middle as i64, middle as i64, 2, n - middle)),
        (1, Rect::new(middle as i64, middle as i64, n - middle, 2)),
    ];
    for (direction, (sy, sx)) in [(-1, -1), (-1, 1), (1, -1), (1, 1)].into_iter().enumerate() {
        for k in 0..SQUARES {
            let out = (middle - SQUARE_PX / 2) * (k + 1) / SQUARES;
            let at = |sign: i64| middle as i64 + sign * out as i64 - (SQUARE_PX / 2) as i64;
            regions.push((2 + direction, Rect::new(at(sy), at(sx), SQUARE_PX, SQUARE_PX)));
        }
    }
    let chart = setup.chart("uniform", "&value=1");
    let rects: Vec<Rect> =
        regions.iter().map(|r| inside_film(r.1, n, "relative illumination")).collect::<Result<_>>()?;
    let pixels = setup.simulate(&chart, "ri,distortion", &rects)?;
    let psf_regions: Vec<Rect> = PSF_POSITIONS
        .iter()
        .map(|out| {
            let at = middle as f64 * (1.0 + out) - PSF_SQUARE_PX as f64 / 2.0;
            let rect = Rect::new(at.round() as i64, at.round() as i64, PSF_SQUARE_PX, PSF_SQUARE_PX);
            inside_film(rect, n, "relative illumination with the PSF")
        })
        .collect::<Result<_>>()?;
    let psf_pixels = setup.simulate(&chart, "ri,distortion,svpsf", &psf_regions)?;
    Ok(UniformFilms { regions, pixels, psf_regions, psf_pixels })
}

/// Measures one band and compares it with the reference.
pub fn compare(
    setup: &Setup,
    reference: &ReferenceBand<'_>,
    band: usize,
    films: &UniformFilms,
) -> Result<Illumination> {
    let pitch_mm = setup.pitch_um * 1e-3;
    let corner_mm = setup.size as f64 * pitch_mm / std::f64::consts::SQRT_2;
    let height_mm =
        |y: i64, x: i64| (y as f64 - setup.axis_px.0).hypot(x as f64 - setup.axis_px.1) * pitch_mm;
    let mut sums = vec![(0.0, 0.0, 0usize); DIRECTIONS.len() * (BINS as usize + 2)];
    for ((direction, rect), pixels) in films.regions.iter().zip(&films.pixels[band]) {
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
        bins.push(Bin { direction, height_mm, film, lens: reference.illumination(height_mm)? });
    }
    let values = |value: fn(&Bin) -> f64| bins.iter().map(value).collect::<Vec<_>>();
    let agreement = agreement(&values(|b| b.film), &values(|b| b.lens), 1.0 / BINS);
    let departures = films.psf_regions.iter().zip(&films.psf_pixels[band]).map(|(rect, pixels)| {
        let (cy, cx) =
            (rect.y as f64 + rect.height as f64 / 2.0 - 0.5, rect.x as f64 + rect.width as f64 / 2.0 - 0.5);
        let r_px = (cy - setup.axis_px.0).hypot(cx - setup.axis_px.1);
        let azimuth_rad = (cy - setup.axis_px.0).atan2(cx - setup.axis_px.1);
        let film = pixels.iter().map(|v| f64::from(*v)).sum::<f64>() / pixels.len() as f64;
        // Central differences over ± 0.5 mm, or half the distance to the axis.
        let step = (0.5 / pitch_mm).min(r_px / 2.0);
        let moments = |r: f64| -> Result<[f64; 3]> {
            let [c, m, n] = setup.psf_moments(reference, band, r, azimuth_rad)?;
            let gain = reference.illumination(r * pitch_mm)?;
            Ok([r * gain * c, r * gain * m, gain * n])
        };
        let (inner, middle, outer) = (moments(r_px - step)?, moments(r_px)?, moments(r_px + step)?);
        let first = |i: usize| (outer[i] - inner[i]) / (2.0 * step);
        let second = (outer[1] - 2.0 * middle[1] + inner[1]) / (step * step);
        let gain = reference.illumination(r_px * pitch_mm)?;
        let lens = (-first(0) + 0.5 * second - 0.5 * first(2)) / (gain * r_px);
        Ok(Departure { height_mm: r_px * pitch_mm, film: film / gain - 1.0, lens })
    });
    let departures = departures.collect::<Result<_>>()?;
    Ok(Illumination { bins, agreement, departures })
}
