//! Edge spread function (ESF) of an edge on a film: pixels by their distance from the edge.
//!
//! A slanted edge crosses the rows of pixels at all phases, so the pixels along it sample its profile much finer than the pitch
//! (ISO 12233: e-SFR). Pixels are binned by distance in bins of 1/4 px; the sample of a bin is the mean of the values at the mean of the
//! distances. The caller supplies the distance, from a straight line or from the chart's edge as distorted by the lens.

use crate::geometry::Rect;
use crate::real;
use thiserror::Error;

/// Bins per film pixel.
pub const OVERSAMPLING: f64 = 4.0;

/// A straight edge on the film: light where the distance is positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeLine {
    /// A point (row, column) of the edge, film pixels.
    pub at_px: (f64, f64),
    /// Azimuth of its normal, from dark to light, rad.
    pub normal_rad: f64,
}

impl EdgeLine {
    /// Signed distance of (row, column) from the edge, film pixels.
    pub fn distance(&self, (row, col): (f64, f64)) -> f64 {
        let (sin, cos) = real::sin_cos(self.normal_rad);
        (col - self.at_px.1) * cos + (row - self.at_px.0) * sin
    }

    /// The edge through two points (row, column); which side is light is undetermined.
    pub fn through(a: (f64, f64), b: (f64, f64)) -> Self {
        let (dy, dx) = (b.0 - a.0, b.1 - a.1);
        Self { at_px: ((a.0 + b.0) / 2.0, (a.1 + b.1) / 2.0), normal_rad: real::atan2(dx, -dy) }
    }
}

/// One bin of an ESF.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EsfSample {
    /// Mean distance of its pixels from the edge, film pixels, light side positive.
    pub distance_px: f64,
    /// Mean of their values.
    pub value: f64,
}

/// An ESF that cannot be computed.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum EdgeError {
    /// A bin without a pixel.
    #[error(
        "no pixel lies {distance_px:.2} px from the edge: the region is too short, or the edge too close to vertical or horizontal"
    )]
    Empty {
        /// The bin.
        distance_px: f64,
    },
    /// No contrast.
    #[error("no edge: the values on both sides are nearly equal ({dark:.3e} and {light:.3e})")]
    Flat {
        /// Mean on the dark side.
        dark: f64,
        /// Mean on the light side.
        light: f64,
    },
}

/// An edge spread function: samples 1/4 px apart, dark side first.
#[derive(Clone, Debug, PartialEq)]
pub struct Esf {
    /// The bins, by distance.
    pub samples: Vec<EsfSample>,
}

impl Esf {
    /// The ESF within ± `half_px` of an edge, from the pixels of `rect` (row-major). `distance` of a pixel (row, column) from the edge;
    /// `None` excludes the pixel.
    ///
    /// # Errors
    /// [`EdgeError::Empty`].
    pub fn new(
        pixels: &[f32],
        rect: Rect,
        half_px: f64,
        distance: impl Fn(i64, i64) -> Option<f64>,
    ) -> Result<Self, EdgeError> {
        let reach = (half_px * OVERSAMPLING).round() as i64;
        let mut bins = vec![(0.0, 0.0, 0usize); (2 * reach + 1) as usize];
        for (y, line) in (rect.y..).zip(pixels.chunks_exact(rect.width)) {
            for (x, value) in (rect.x..).zip(line) {
                let Some(d) = distance(y, x) else { continue };
                let bin = (d * OVERSAMPLING).round();
                if bin.abs() <= reach as f64 {
                    let (distance, sum, count) = &mut bins[(bin as i64 + reach) as usize];
                    (*distance, *sum, *count) = (*distance + d, *sum + f64::from(*value), *count + 1);
                }
            }
        }
        let sample = |(i, (distance, sum, count)): (usize, (f64, f64, usize))| match count {
            0 => Err(EdgeError::Empty { distance_px: (i as i64 - reach) as f64 / OVERSAMPLING }),
            n => Ok(EsfSample { distance_px: distance / n as f64, value: sum / n as f64 }),
        };
        Ok(Self { samples: bins.into_iter().enumerate().map(sample).collect::<Result<_, _>>()? })
    }

    /// Means on the dark and the light plateau, beyond ± `plateau_px`.
    pub fn plateaus(&self, plateau_px: f64) -> (f64, f64) {
        let mean = |side: &dyn Fn(f64) -> bool| {
            let values: Vec<f64> =
                self.samples.iter().filter(|s| side(s.distance_px)).map(|s| s.value).collect();
            values.iter().sum::<f64>() / values.len() as f64
        };
        (mean(&|d| d < -plateau_px), mean(&|d| d > plateau_px))
    }

    /// The ESF scaled to 0 on the dark plateau and 1 on the light one, the means beyond ± `plateau_px`.
    ///
    /// # Errors
    /// [`EdgeError::Flat`] if the light side is not above the dark one.
    pub fn normalised(&self, plateau_px: f64) -> Result<Self, EdgeError> {
        let (dark, light) = self.plateaus(plateau_px);
        if light - dark <= 1e-9 * light.abs() || light.is_nan() || dark.is_nan() {
            return Err(EdgeError::Flat { dark, light });
        }
        let scaled = |s: &EsfSample| EsfSample { value: (s.value - dark) / (light - dark), ..*s };
        Ok(Self { samples: self.samples.iter().map(scaled).collect() })
    }

    /// The samples within ± `half_px`.
    pub fn within(&self, half_px: f64) -> impl Iterator<Item = &EsfSample> {
        self.samples.iter().filter(move |s| s.distance_px.abs() <= half_px)
    }

    /// Values at multiples of 1/4 px, by linear interpolation between the bins' mean distances.
    pub fn uniform(&self) -> Vec<f64> {
        let reach = (self.samples.len() / 2) as f64;
        (0..self.samples.len())
            .map(|i| {
                let at = (i as f64 - reach) / OVERSAMPLING;
                let right =
                    self.samples.partition_point(|s| s.distance_px < at).clamp(1, self.samples.len() - 1);
                let (a, b) = (self.samples[right - 1], self.samples[right]);
                let t = ((at - a.distance_px) / (b.distance_px - a.distance_px)).clamp(0.0, 1.0);
                a.value + t * (b.value - a.value)
            })
            .collect()
    }
}

/// Fits the edge near `guess` in the pixels of `rect`: the straight line through the centroids of the line spread function of each row,
/// or of each column for an edge closer to horizontal, within `half_px` on either side (ISO 12233). Its normal points from dark to
/// light. `None` if fewer than three lines cross the edge.
pub fn fit(pixels: &[f32], rect: Rect, guess: EdgeLine, half_px: usize) -> Option<EdgeLine> {
    let (sin, cos) = real::sin_cos(guess.normal_rad);
    let upright = cos.abs() >= sin.abs();
    let (lines, length) = if upright { (rect.height, rect.width) } else { (rect.width, rect.height) };
    let value = |line: usize, i: usize| {
        f64::from(if upright { pixels[line * rect.width + i] } else { pixels[i * rect.width + line] })
    };
    let origin = if upright { (rect.y as f64, rect.x as f64) } else { (rect.x as f64, rect.y as f64) };
    let mut points = Vec::new();
    let mut rise = 0.0;
    for line in 0..lines {
        let along = origin.0 + line as f64;
        // Intersection of the guess with this line.
        let crossing = match upright {
            true => guess.at_px.1 - (along - guess.at_px.0) * sin / cos,
            false => guess.at_px.0 - (along - guess.at_px.1) * cos / sin,
        } - origin.1;
        let (first, last) = (crossing.round() - half_px as f64, crossing.round() + half_px as f64);
        if first < 0.0 || last + 1.0 >= length as f64 {
            continue;
        }
        let (mut sum, mut moment) = (0.0, 0.0);
        for i in first as usize..last as usize {
            let slope = value(line, i + 1) - value(line, i);
            sum += slope;
            moment += slope * (i as f64 + 0.5);
        }
        if sum != 0.0 {
            points.push((along, origin.1 + moment / sum));
            rise += sum;
        }
    }
    let n = points.len() as f64;
    if n < 3.0 {
        return None;
    }
    let (ma, mc) = points.iter().fold((0.0, 0.0), |(a, c), p| (a + p.0 / n, c + p.1 / n));
    let (saa, sac) =
        points.iter().fold((0.0, 0.0), |(s, t), p| (s + (p.0 - ma).powi(2), t + (p.0 - ma) * (p.1 - mc)));
    let slope = sac / saa;
    let reversal = if rise < 0.0 { std::f64::consts::PI } else { 0.0 };
    Some(match upright {
        // across = mc + slope·(along − ma): the normal of that line, towards rising values.
        true => EdgeLine { at_px: (ma, mc), normal_rad: real::atan2(-slope, 1.0) + reversal },
        false => EdgeLine { at_px: (mc, ma), normal_rad: real::atan2(1f64, -slope) + reversal },
    })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Φ, the Gaussian's integral: Abramowitz and Stegun 7.1.26 is too coarse (1e-7 is required): Simpson's rule.
    pub(in crate::measure) fn phi(x: f64) -> f64 {
        let n = 400;
        let h = x / f64::from(n);
        let f = |t: f64| real::exp(-t * t / 2.0);
        let inner = (1..n).map(|i| if i % 2 == 1 { 4.0 } else { 2.0 } * f(f64::from(i) * h)).sum::<f64>();
        0.5 + (f(0.0) + inner + f(x)) * h / 3.0 / std::f64::consts::TAU.sqrt()
    }

    /// A straight edge through a Gaussian of `sigma`, point-sampled.
    pub(in crate::measure) fn edge(rect: Rect, line: EdgeLine, sigma: f64) -> Vec<f32> {
        (0..rect.size().pixels())
            .map(|i| {
                let at = (rect.y as f64 + (i / rect.width) as f64, rect.x as f64 + (i % rect.width) as f64);
                (0.2 + 0.6 * phi((line.distance(at) / sigma).clamp(-8.0, 8.0))) as f32
            })
            .collect()
    }

    #[test]
    fn esf_of_an_analytic_edge_agrees_within_1e_3() {
        let rect = Rect::new(1000, 2000, 120, 110);
        for (degrees, sigma) in [(5.0f64, 1.0), (-5.0, 0.8), (95.0, 1.5), (50.0, 1.2), (185.0, 2.0)] {
            let line = EdgeLine { at_px: (1060.2, 2054.7), normal_rad: degrees.to_radians() };
            let pixels = edge(rect, line, sigma);
            let at = |y: i64, x: i64| Some(line.distance((y as f64, x as f64)));
            let esf = Esf::new(&pixels, rect, 20.0, at).unwrap().normalised(14.0).unwrap();
            let worst =
                esf.samples.iter().map(|s| (s.value - phi((s.distance_px / sigma).clamp(-8.0, 8.0))).abs());
            let worst = worst.fold(0.0, f64::max);
            assert!(worst < 1e-3, "{degrees}°, σ {sigma}: {worst:.1e}");
        }
    }

    #[test]
    fn fit_converges_from_a_rough_guess() {
        let rect = Rect::new(0, 0, 100, 90);
        for degrees in [4.0f64, 86.0, 184.0, 266.0, -7.0] {
            let line = EdgeLine { at_px: (50.3, 44.6), normal_rad: degrees.to_radians() };
            let guess = EdgeLine { at_px: (49.0, 46.0), normal_rad: (degrees + 1.0).to_radians() };
            let found = fit(&edge(rect, line, 1.1), rect, guess, 12).unwrap();
            let error = (found.normal_rad - line.normal_rad).rem_euclid(std::f64::consts::TAU);
            let error = error.min(std::f64::consts::TAU - error);
            assert!(error < 1e-3, "{degrees}°: {error}");
            assert!(line.distance(found.at_px).abs() < 5e-3, "{degrees}°: {}", line.distance(found.at_px));
        }
    }

    #[test]
    fn empty_bins_and_flat_regions_are_errors() {
        let rect = Rect::new(0, 0, 50, 50);
        let line = EdgeLine { at_px: (25.0, 25.0), normal_rad: 0.0 };
        let at = |y: i64, x: i64| Some(line.distance((y as f64, x as f64)));
        // Vertical: three of four bins are empty.
        assert!(matches!(Esf::new(&[1.0; 2500], rect, 5.0, at), Err(EdgeError::Empty { .. })));
        let slanted = EdgeLine { normal_rad: 0.1, ..line };
        let at = |y: i64, x: i64| Some(slanted.distance((y as f64, x as f64)));
        let flat = Esf::new(&[1.0; 2500], rect, 9.0, at).unwrap().normalised(6.0);
        assert!(matches!(flat, Err(EdgeError::Flat { .. })));
    }
}
