//! s-SFR: modulation of a Siemens star over spatial frequency (after ISO 12233).
//!
//! On the circle of radius r (px) around its centre a star of N pairs of sectors has the spatial frequency f = N/(2πr) cycles per pixel. The
//! pixels of a ring around that circle, in a sector of azimuths, are fitted by least squares,
//! ```text
//! v(φ) = a + b·cos Nφ + c·sin Nφ,      m = √(b² + c²) / a,      MTF(f) = m / m_chart
//! ```
//! m_chart is the modulation of the chart: (p − d)/(p + d) of a sinusoidal star between the reflectances d and p, 4/π of that of a star of
//! equal sectors, whose fundamental is what is fitted. Light that is veiled over the star lowers the curve at all frequencies. Values must be linear in light. Pixels of the picture are part of the camera: their aperture is
//! in the MTF. The centre is refined by the phases atan2(c, b) of the sectors: a star whose centre is (x, y) from the assumed one has the phase N(y·cos φ − x·sin φ)/r at φ.

use crate::geometry::Rect;
use crate::least_squares::Qr;
use crate::real;
use std::f64::consts::TAU;

/// Sectors of azimuths that are fitted by themselves, each 45° wide, the first centred on +x, then clockwise on the picture.
pub const SECTORS: usize = 8;
/// Half width of a ring, px.
const HALF_RING_PX: f64 = 1.5;
/// Least pixels of a ring in a sector.
const MIN_PIXELS: usize = 12;

/// A star on a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Star {
    /// Centre (row, column), px.
    pub centre_px: (f64, f64),
    /// Radius, px.
    pub radius_px: f64,
    /// Pairs of a dark and a light sector.
    pub pairs: usize,
}

/// Modulation over frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct StarCurve {
    /// Cycles per pixel, ascending.
    pub frequency_cy_px: Vec<f64>,
    /// Modulation of each sector of azimuths at each frequency.
    pub sectors: Vec<[f64; SECTORS]>,
}

impl StarCurve {
    /// Mean of the sectors at each frequency.
    pub fn mean(&self) -> Vec<f64> {
        self.sectors.iter().map(|all| all.iter().sum::<f64>() / SECTORS as f64).collect()
    }
}

impl Star {
    /// Lowest frequency of its rings, cycles per pixel.
    pub fn lowest_cy_px(&self) -> f64 {
        self.pairs as f64 / (TAU * (0.97 * self.radius_px - HALF_RING_PX))
    }

    /// Its modulation in `pixels` (row-major on `rect`, which contains it) at `frequencies` (cycles per pixel), over that of the chart. `None` if a ring has too few pixels: a radius of a few px, or not inside `rect`.
    pub fn curve(
        &self,
        pixels: &[f32],
        rect: Rect,
        frequencies: &[f64],
        chart_modulation: f64,
    ) -> Option<StarCurve> {
        let at = |f: f64| {
            let fits = self.fits(pixels, rect, self.pairs as f64 / (TAU * f))?;
            Some(fits.map(|[a, b, c]| real::hypot(b, c) / a / chart_modulation))
        };
        let sectors = frequencies.iter().map(|f| at(*f)).collect::<Option<_>>()?;
        Some(StarCurve { frequency_cy_px: frequencies.to_vec(), sectors })
    }

    /// The star with its centre where the phases of the sectors of a ring agree. `None` as for [`Star::curve`].
    pub fn centred(mut self, pixels: &[f32], rect: Rect) -> Option<Self> {
        // Wide rings first: there an offset turns the phase least.
        for share in [0.9, 0.7, 0.5, 0.5] {
            let radius = share * self.radius_px;
            let fits = self.fits(pixels, rect, radius)?;
            let phases = fits.map(|[_, b, c]| real::atan2(c, b));
            // Differences from the first sector, within half a turn.
            let turns = |p: f64| (p - phases[0] + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
            let azimuths = (0..SECTORS).map(|k| TAU * k as f64 / SECTORS as f64);
            let scale = self.pairs as f64 / radius;
            let (sin, cos): (Vec<f64>, Vec<f64>) = azimuths.map(real::sin_cos).unzip();
            let columns = vec![
                cos.iter().map(|v| scale * v).collect(),
                sin.iter().map(|v| -scale * v).collect(),
                vec![1.0; SECTORS],
            ];
            let found = Qr::new(columns)?.solve(&phases.map(turns));
            self.centre_px = (self.centre_px.0 + found[0], self.centre_px.1 + found[1]);
        }
        Some(self)
    }

    /// (a, b, c) of each sector of the ring at `radius`.
    fn fits(&self, pixels: &[f32], rect: Rect, radius: f64) -> Option<[[f64; 3]; SECTORS]> {
        let (row, column) = self.centre_px;
        let reach = radius + HALF_RING_PX;
        let (first, last) = ((row - reach).ceil() as i64, (row + reach).floor() as i64);
        let mut samples: [Vec<(f64, f64)>; SECTORS] = Default::default();
        for y in first..=last {
            let dy = y as f64 - row;
            let half = (reach * reach - dy * dy).max(0.0).sqrt();
            for x in (column - half).ceil() as i64..=(column + half).floor() as i64 {
                let dx = x as f64 - column;
                let r = real::hypot(dx, dy);
                if (r - radius).abs() > HALF_RING_PX {
                    continue;
                }
                if !rect.contains(Rect::new(y, x, 1, 1)) {
                    return None;
                }
                let value = pixels[(y - rect.y) as usize * rect.width + (x - rect.x) as usize];
                let azimuth = real::atan2(dy, dx).rem_euclid(TAU);
                let sector = (azimuth / TAU * SECTORS as f64).round() as usize % SECTORS;
                samples[sector].push((azimuth, f64::from(value)));
            }
        }
        let mut all = [[0.0; 3]; SECTORS];
        for (fit, samples) in std::iter::zip(&mut all, &samples) {
            if samples.len() < MIN_PIXELS {
                return None;
            }
            let (sin, cos): (Vec<f64>, Vec<f64>) =
                samples.iter().map(|(azimuth, _)| real::sin_cos(self.pairs as f64 * azimuth)).unzip();
            let right: Vec<f64> = samples.iter().map(|(_, v)| *v).collect();
            let found = Qr::new(vec![vec![1.0; samples.len()], cos, sin])?.solve(&right);
            *fit = [found[0], found[1], found[2]];
        }
        Some(all)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// A sinusoidal star of mean 0.5 and modulation 0.8 through a Gaussian of `sigma`: on a plane wave exp(−2π²σ²f²).
    fn picture(star: Star, sigma: f64, side: usize) -> Vec<f32> {
        (0..side * side)
            .map(|i| {
                let (y, x) = ((i / side) as f64 - star.centre_px.0, (i % side) as f64 - star.centre_px.1);
                let f = star.pairs as f64 / (TAU * y.hypot(x).max(1.0));
                let modulation = 0.8 * (-2.0 * (PI * sigma * f).powi(2)).exp();
                (0.5 + 0.5 * modulation * (star.pairs as f64 * y.atan2(x)).cos()) as f32
            })
            .collect()
    }

    #[test]
    fn gaussian_is_measured_within_2e_3_from_a_centre_that_is_off() {
        let rect = Rect::new(0, 0, 601, 601);
        let truth = Star { centre_px: (300.37, 299.81), radius_px: 280.0, pairs: 72 };
        for sigma in [0.6, 1.0, 1.5] {
            let pixels = picture(truth, sigma, 601);
            let guess = Star { centre_px: (301.2, 299.0), ..truth };
            let star = guess.centred(&pixels, rect).unwrap();
            let off = (star.centre_px.0 - truth.centre_px.0).hypot(star.centre_px.1 - truth.centre_px.1);
            assert!(off < 0.01, "{off}");
            let frequencies: Vec<f64> = (1..=8).map(|k| 0.05 * f64::from(k)).collect();
            assert!(star.lowest_cy_px() < 0.05);
            let curve = star.curve(&pixels, rect, &frequencies, 0.8).unwrap();
            for (f, m) in frequencies.iter().zip(curve.mean()) {
                let expected = (-2.0 * (PI * sigma * f).powi(2)).exp();
                assert!((m - expected).abs() < 2e-3, "σ {sigma}, {f}: {m} for {expected}");
            }
        }
    }

    #[test]
    fn a_star_beyond_the_picture_has_no_curve() {
        let star = Star { centre_px: (10.0, 10.0), radius_px: 60.0, pairs: 36 };
        assert_eq!(star.curve(&[0.5; 400], Rect::new(0, 0, 20, 20), &[0.2], 1.0), None);
    }
}
