//! Light of rays on the rings of the film, and its azimuthal orders.

use std::f64::consts::PI;

use super::rings::{RingSizes, jackson};
use crate::real;

/// Azimuths over half a turn per ring, for the light that is collected.
pub(super) const HALF_TURN: usize = 4;
/// Light that lands on the rings of the film from one ring of the scene, for several bands, over half a turn: rays are given with their mirror image.
pub(super) struct RingSums {
    sizes: RingSizes,
    bands: usize,
    /// Ring, azimuth from 0 to half a turn, band.
    sums: Vec<f64>,
}

impl RingSums {
    pub(super) fn new(sizes: RingSizes, bands: usize) -> Self {
        Self { sizes, bands, sums: vec![0.0; sizes.rings * (HALF_TURN * sizes.rings + 1) * bands] }
    }

    /// Adds a ray and its mirror image, of the light `weights` together.
    pub(super) fn add(&mut self, (x, y): (f64, f64), weights: &[f64]) {
        let steps = HALF_TURN * self.sizes.rings;
        let (ring, share) = self.sizes.about((x * x + y * y).sqrt());
        if ring >= self.sizes.rings {
            return;
        }
        let turn = real::atan2(y.abs(), x) / PI * steps as f64;
        let azimuth = (turn as usize).min(steps - 1);
        let part = turn - azimuth as f64;
        for (ring, share) in [(ring, 1.0 - share), (ring + 1, share)] {
            if ring >= self.sizes.rings {
                continue;
            }
            let at = (ring * (steps + 1) + azimuth) * self.bands;
            let (low, high) = self.sums[at..at + 2 * self.bands].split_at_mut(self.bands);
            for ((low, high), weight) in low.iter_mut().zip(high).zip(weights) {
                *low += weight * share * (1.0 - part);
                *high += weight * share * part;
            }
        }
    }

    /// Azimuthal orders of a band: order, ring.
    pub(super) fn orders(&self, band: usize) -> Vec<f64> {
        let mut orders = vec![0.0; (self.sizes.orders() + 1) * self.sizes.rings];
        self.add_orders(band, &mut orders);
        orders
    }

    /// Adds the azimuthal orders of a band to `orders`: order, ring.
    pub(super) fn add_orders(&self, band: usize, orders: &mut [f64]) {
        let RingSizes { rings, .. } = self.sizes;
        let steps = HALF_TURN * rings;
        let cosines: Vec<f64> = (0..2 * steps).map(|k| real::cos(PI * k as f64 / steps as f64)).collect();
        let damping = jackson(self.sizes.orders());
        // Of an azimuth: the cosines of its multiples.
        let multiples: Vec<f64> = (0..=steps)
            .flat_map(|k| (0..damping.len()).map(move |m| k * m % (2 * steps)))
            .map(|k| cosines[k])
            .collect();
        let mut sums = vec![0.0; damping.len()];
        for ring in 0..rings {
            let row = &self.sums[ring * (steps + 1) * self.bands..][..(steps + 1) * self.bands];
            sums.fill(0.0);
            for (v, multiples) in
                row[band..].iter().step_by(self.bands).zip(multiples.chunks_exact(damping.len()))
            {
                if *v != 0.0 {
                    sums.iter_mut().zip(multiples).for_each(|(sum, cosine)| *sum += v * cosine);
                }
            }
            for (m, (g, sum)) in damping.iter().zip(&sums).enumerate() {
                orders[m * rings + ring] += g * sum;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Σ_j G_0(j) is the light that lands within the rings, to rounding.
    #[test]
    fn order_zero_is_the_light_on_the_film() {
        let sizes = RingSizes::new(8.0, 16);
        let mut sums = RingSums::new(sizes, 2);
        let (last, mut light) = (sizes.radius_mm(15), [0.0; 2]);
        for k in 0..20_000 {
            let t = f64::from(k) + 0.5;
            let (radius, angle) = (9.0 * (t * 0.618_033_988_749_895).fract(), t * 2.399_963);
            let weights = [1e-3 * (1.0 + real::cos(t)), 2e-5];
            sums.add((radius * real::cos(angle), radius * real::sin(angle)), &weights);
            // Between the last ring and one beyond it the light is shared.
            let share = 1.0 - ((radius - last) / sizes.ring_mm).clamp(0.0, 1.0);
            light = [0, 1].map(|band| light[band] + weights[band] * share);
        }
        for (band, light) in light.into_iter().enumerate() {
            let found: f64 = sums.orders(band)[..sizes.rings].iter().sum();
            assert!((found / light - 1.0).abs() < 1e-12, "{found} {light}");
        }
    }
}
