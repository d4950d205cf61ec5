//! Flare of a lamp: the light beside its image, over the light in it.
//!
//! ```text
//! normalised flare   v(x) = E(x) / E₀      E₀ the mean over the lamp's image, or over a white area in the same light
//! attenuation        −20 log₁₀ v           dB, as a ratio of signals
//! ```
//! outside the lamp's radius R: percentiles over the pixels, means over rings about its centre, and the sum of E outside over that inside. What is known of
//! the image itself, its edge and the tails of its PSF, counts as flare where it lies outside R.
//!
//! Percentiles are those of a histogram whose steps are 1/2048 to 1/4096 of a value, so within 0.03 %.
//! Source: IEEE P2020 automotive image quality (normalized flare); D. Lambert et al., Electronic Imaging 2021, autonomous vehicles and machines.

use crate::geometry::Size;

/// Rings of a profile, at most; none narrower than a pixel.
const MAX_RINGS: usize = 2000;
/// Low bits of a value that its step of the histogram lacks.
const DROPPED_BITS: u32 = 12;
/// Sign of an f32.
const SIGN: u32 = 1 << 31;

/// Sums of the pixels about a lamp.
#[derive(Clone, Debug)]
pub struct Flare {
    centre_px: (f64, f64),
    radius_px: f64,
    ring_px: f64,
    /// Sum and number of the pixels of each ring.
    rings: Vec<(f64, u64)>,
    inside: (f64, u64),
    outside: (f64, u64),
    /// Pixels outside by value.
    levels: Vec<u64>,
}

/// Flare of a lamp, in the unit of its pixels but where it is normalised.
#[derive(Clone, Debug, PartialEq)]
pub struct FlareFigures {
    /// Mean over the lamp's image.
    pub lamp: f64,
    /// Light outside over light inside.
    pub outside_over_inside: f64,
    /// Percentiles of the pixels outside: percent, normalised flare.
    pub percentiles: Vec<(f64, f64)>,
    /// Mean normalised flare of each ring, at the middle of its distances from the centre, px; rings without a pixel are left out.
    pub profile: Vec<(f64, f64)>,
}

/// Step of the histogram, in the order of values.
fn step(value: f32) -> usize {
    let bits = value.to_bits();
    let ordered = if bits & SIGN == 0 { bits | SIGN } else { !bits };
    (ordered >> DROPPED_BITS) as usize
}

/// The value in the middle of a step.
fn middle(step: usize) -> f64 {
    let ordered = (step as u32) << DROPPED_BITS | 1 << (DROPPED_BITS - 1);
    let bits = if ordered & SIGN == 0 { !ordered } else { ordered & !SIGN };
    f64::from(f32::from_bits(bits))
}

fn length(y: f64, x: f64) -> f64 {
    (y * y + x * x).sqrt()
}

impl Flare {
    /// Of a lamp whose image has its centre (row, column) and radius at `centre_px`, `radius_px` on a film of `size`.
    pub fn new(centre_px: (f64, f64), radius_px: f64, size: Size) -> Self {
        let far = |at: f64, n: usize| at.abs().max((n as f64 - 1.0 - at).abs());
        let farthest = length(far(centre_px.0, size.height), far(centre_px.1, size.width));
        let ring_px = ((farthest + 1.0) / MAX_RINGS as f64).ceil().max(1.0);
        let rings = vec![(0.0, 0); (farthest / ring_px) as usize + 1];
        let levels = vec![0; 1 << (u32::BITS - DROPPED_BITS)];
        Self { centre_px, radius_px, ring_px, rings, inside: (0.0, 0), outside: (0.0, 0), levels }
    }

    /// Adds the finite `value` of the pixel at row `y`, column `x`; whether it is in the lamp's image.
    pub fn add(&mut self, y: f64, x: f64, value: f32) -> bool {
        let distance = length(y - self.centre_px.0, x - self.centre_px.1);
        let count = |sum: &mut (f64, u64)| *sum = (sum.0 + f64::from(value), sum.1 + 1);
        if let Some(ring) = self.rings.get_mut((distance / self.ring_px) as usize) {
            count(ring);
        }
        let is_inside = distance <= self.radius_px;
        match is_inside {
            true => count(&mut self.inside),
            false => {
                count(&mut self.outside);
                self.levels[step(value)] += 1;
            }
        }
        is_inside
    }

    /// Pixels inside and outside the radius.
    pub fn pixels(&self) -> (u64, u64) {
        (self.inside.1, self.outside.1)
    }

    /// The figures, normalised by `reference`, or by the mean over the lamp; `None` if there is no pixel inside or outside, or no light to normalise by.
    pub fn figures(&self, reference: Option<f64>, percents: &[f64]) -> Option<FlareFigures> {
        if self.inside.1 == 0 || self.outside.1 == 0 {
            return None;
        }
        let lamp = self.inside.0 / self.inside.1 as f64;
        let unit = Some(reference.unwrap_or(lamp)).filter(|unit| *unit > 0.0 && lamp > 0.0)?;
        let ring = |(k, (sum, n)): (usize, &(f64, u64))| {
            (*n > 0).then(|| ((k as f64 + 0.5) * self.ring_px, sum / *n as f64 / unit))
        };
        Some(FlareFigures {
            lamp,
            outside_over_inside: self.outside.0 / self.inside.0,
            percentiles: percents.iter().map(|p| (*p, self.percentile(*p) / unit)).collect(),
            profile: self.rings.iter().enumerate().filter_map(ring).collect(),
        })
    }

    /// The least value that `percent` of the pixels outside do not exceed.
    fn percentile(&self, percent: f64) -> f64 {
        let target = (self.outside.1 as f64 * percent / 100.0).ceil().max(1.0) as u64;
        let mut below = 0;
        let found = self.levels.iter().position(|n| {
            below += n;
            below >= target
        });
        found.map_or(f64::NAN, middle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_keep_the_order_of_values() {
        let values = [-1e9f32, -2.0, -1.999, -1e-30, -0.0, 0.0, 1e-30, 0.5, 0.50025, 3e8];
        assert!(values.windows(2).all(|pair| step(pair[0]) <= step(pair[1])));
        for value in values {
            let error = (middle(step(value)) - f64::from(value)).abs();
            assert!(error <= 2.5e-4 * f64::from(value.abs()) + 1e-38, "{value}: {}", middle(step(value)));
        }
    }

    /// A lamp of 2 over a flare of 1e-3/r²: rings have that value, its integral outside is 2π 1e-3 ln(r/R).
    #[test]
    fn figures_of_a_known_flare() {
        let (size, centre, radius) = (Size::new(401, 401), (200.0, 200.0), 10.5);
        let mut flare = Flare::new(centre, radius, size);
        let value = |r: f64| if r <= radius { 2.0 } else { 1e-3 / (r * r) };
        let (mut inside, mut outside, mut values) = (0.0, 0.0, Vec::new());
        for (y, x) in (0..401).flat_map(|y| (0..401).map(move |x| (f64::from(y), f64::from(x)))) {
            let r = (y - centre.0).hypot(x - centre.1);
            flare.add(y, x, value(r) as f32);
            match r <= radius {
                true => inside += value(r),
                false => {
                    outside += value(r);
                    values.push(value(r) / 2.0);
                }
            }
        }
        let figures = flare.figures(None, &[50.0, 95.0, 99.9]).unwrap();
        assert_eq!((figures.lamp, figures.profile.len()), (2.0, 283));
        assert!((figures.outside_over_inside / (outside / inside) - 1.0).abs() < 1e-6);
        let (r, at_100) = figures.profile[100];
        assert!(r == 100.5 && (at_100 / (0.5e-3 / (r * r)) - 1.0).abs() < 0.02, "{at_100}");
        values.sort_by(f64::total_cmp);
        for (percent, found) in figures.percentiles {
            let expected = values[(values.len() as f64 * percent / 100.0).ceil() as usize - 1];
            assert!((found / expected - 1.0).abs() < 3e-4, "{percent} %: {found} {expected}");
        }
        // A white area of 0.5 in the same light: four times as much.
        let of_white = flare.figures(Some(0.5), &[50.0]).unwrap();
        assert!((of_white.profile[100].1 / at_100 - 4.0).abs() < 1e-12);
        assert_eq!(Flare::new(centre, radius, size).figures(None, &[50.0]), None);
    }
}
