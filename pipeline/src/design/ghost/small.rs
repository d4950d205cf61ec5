//! How far the rings understate the peak of a small ghost.
//!
//! The light of a small lamp is shared between two rings of the scene and lands, shared between the rings about it, on discs two rings apart at most; azimuthal orders end at M. A ghost wider than a
//! few rings keeps its density; that of a smaller disc is spread, its power and its mean place kept. The factor is that of an even disc, for a lamp half-way between two rings, by the
//! rings themselves.

use super::report::PathReport;
use super::rings::RingSizes;
use super::sums::RingSums;
use crate::real;

/// Rays of a disc.
const RAYS: usize = 4000;
/// The golden angle: rays on a spiral cover a disc evenly.
const GOLDEN: f64 = 2.399_963_229_728_653;

/// The density of an even disc of `diameter_mm` over the largest that the rings give it. The lamp stands at the
/// ideal height `source_mm`, its ghost at `magnification` times that.
pub fn understated(sizes: RingSizes, source_mm: f64, magnification: f64, diameter_mm: f64) -> f64 {
    // Rings on either side of the lamp, half-way between them; the innermost for one on the axis.
    let low = (source_mm / sizes.ring_mm - 0.5).max(0.0) as usize;
    let sources = if source_mm < 0.5 * sizes.ring_mm { low..low + 1 } else { low..low + 2 };
    let share = 1.0 / sources.len() as f64;
    let mut sums = RingSums::new(sizes, 1);
    for ring in sources {
        let centre = magnification.abs() * sizes.radius_mm(ring);
        for ray in 0..RAYS {
            let k = ray as f64 + 0.5;
            let (sin, cos) = real::sin_cos(k * GOLDEN);
            let rho = 0.5 * diameter_mm * (k / RAYS as f64).sqrt();
            sums.add((centre + rho * cos, rho * sin), &[share / RAYS as f64]);
        }
    }
    let orders = sums.orders(0);
    // At the azimuth of the disc: V_0 + 2 Σ V_m.
    let density = |ring: usize| {
        let sum: f64 = (1..=sizes.orders()).map(|m| orders[m * sizes.rings + ring]).sum();
        (orders[ring] + 2.0 * sum) / sizes.area_mm2(ring)
    };
    let peak = (0..sizes.rings).map(density).fold(0.0, f64::max);
    let disc = 0.25 * std::f64::consts::PI * diameter_mm * diameter_mm;
    if peak > 0.0 { (1.0 / (disc * peak)).max(1.0) } else { 1.0 }
}

impl PathReport {
    /// How far the rings of `sizes` understate the peak of its ghost of a small lamp on the axis and at half of the film's corner.
    pub fn understated(&self, sizes: RingSizes) -> [f64; 2] {
        let half_mm = 0.5 * sizes.rings as f64 * sizes.ring_mm;
        let magnification = self.half.x_mm / half_mm;
        [(0.0, self.axis), (half_mm, self.half)]
            .map(|(source_mm, light)| understated(sizes, source_mm, magnification, light.diameter_mm()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against the same sums in NumPy, of 200,000 rays each: a row per diameter in rings, sources on the axis, 20 and 40 rings from it.
    #[test]
    fn peaks_of_discs_are_those_of_numpy() {
        let sizes = RingSizes::new(64.0, 64);
        let rows = [
            (0.5, [2.2806, 18.8728, 36.9326]),
            (1.3, [1.1388, 3.1473, 5.5995]),
            (2.0, [1.0, 1.6221, 2.5907]),
            (4.0, [1.0, 1.0091, 1.1847]),
        ];
        for (diameter, expected) in rows {
            for (source, expected) in [0.0, 20.0, 40.0].into_iter().zip(expected) {
                let found = understated(sizes, source, -1.06, diameter);
                assert!((found / expected - 1.0).abs() < 0.02, "{diameter} at {source}: {found} {expected}");
            }
        }
    }
}
