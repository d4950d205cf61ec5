//! Expected veiling glare index: the light in a small black disc on the axis, in a white scene, over that beside it.
//!
//! ```text
//! index = (a (1 − M(ρ)/M(r_max)) + g (1 − f) + V_ghosts) / (1 + V_ghosts)
//! ```
//! a, g shares of scatter and glare, which keep a uniform field as it is; ρ the radius of the disc, 2.5 % of the film's height, f its share of the film;
//! V_ghosts the ghosts of the scene on the axis, which are added to black and white alike. Each term over the same white is its part of the index.
//! Source: ISO 9358 (black patch method).

use super::kernel::ScatterKernel;
use super::plan::VeilShares;
use crate::design::ghost::rings::{RingOperator, RingPower};
use crate::geometry::Frame;
use std::f64::consts::PI;

/// Radius of the disc over the height of the film.
const DISC: f64 = 0.025;
/// Rings of the scene are divided into so many where the disc ends.
const PARTS: usize = 64;

/// Parts of an expected index.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExpectedIndex {
    /// Of ghosts.
    pub ghosts: f64,
    /// Of scatter.
    pub scatter: f64,
    /// Of glare.
    pub glare: f64,
}

impl ExpectedIndex {
    /// Of the veil with `shares` and the kernel `scatter` on the film of `frame`, and the ghosts of `operator`.
    pub fn new(
        frame: &Frame,
        shares: VeilShares,
        scatter: Option<ScatterKernel>,
        operator: Option<&RingOperator>,
    ) -> Self {
        let height_mm = frame.film.height as f64 * frame.pitch_mm();
        let (radius_mm, width_mm) = (DISC * height_mm, frame.film.width as f64 * frame.pitch_mm());
        let of_disc = PI * radius_mm * radius_mm / (height_mm * width_mm);
        let ghosts = operator.map_or(0.0, |operator| ghosts_on_axis(operator, radius_mm));
        let white = 1.0 + ghosts;
        let outside = scatter.map_or(0.0, |kernel| 1.0 - kernel.share_within(radius_mm));
        Self {
            ghosts: ghosts / white,
            scatter: shares.scatter * outside / white,
            glare: shares.glare * (1.0 - of_disc) / white,
        }
    }

    /// Sum of the parts.
    pub fn total(&self) -> f64 {
        self.ghosts + self.scatter + self.glare
    }
}

/// Ghosts on the axis, of a scene of 1 outside the disc of `radius_mm`.
fn ghosts_on_axis(operator: &RingOperator, radius_mm: f64) -> f64 {
    let sizes = operator.sizes;
    let mut scene = RingPower::dark(sizes.source_rings, sizes.azimuths());
    for (ring, power) in scene.power.chunks_exact_mut(scene.azimuths).enumerate() {
        let part_mm = sizes.ring_mm / PARTS as f64;
        let of_part = |k: usize| {
            let r = ring as f64 * sizes.ring_mm + (k as f64 + 0.5) * part_mm;
            if r > radius_mm { 2.0 * PI * r * part_mm } else { 0.0 }
        };
        let area: f64 = (0..PARTS).map(of_part).sum();
        power.fill(area / sizes.azimuths() as f64);
    }
    operator.apply(&scene).density(&sizes, (0.0, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::ghost::rings::RingSizes;
    use crate::geometry::Size;

    /// Ghosts that lie on their sources, a hundredth of the light: none in a black disc wider than the innermost rings.
    #[test]
    fn parts_have_their_closed_forms() {
        let side = Size::new(1000, 2000);
        let frame = Frame::centred(side, side, 2.0);
        let shares = VeilShares { glare: 0.02, scatter: 0.03 };
        let kernel = ScatterKernel { shoulder_mm: 0.01, slope: 2.0, reach_mm: 0.8 };
        let found = ExpectedIndex::new(&frame, shares, Some(kernel), None);
        let mass = |r: f64| (r / 0.01f64).powi(2).ln_1p();
        assert!((found.scatter / (0.03 * (1.0 - mass(0.05) / mass(0.8))) - 1.0).abs() < 1e-12);
        assert!((found.glare / (0.02 * (1.0 - PI * 0.0025 / 8.0)) - 1.0).abs() < 1e-12);
        assert_eq!((found.ghosts, found.total()), (0.0, found.scatter + found.glare));
        // All light of each ring of the scene on the innermost ring of the film, a thousandth of it.
        let sizes = RingSizes::new(2.3, 32);
        let mut values = vec![0.0; (sizes.orders() + 1) * sizes.rings * sizes.source_rings];
        values[..sizes.source_rings].fill(1e-3);
        let ghosts =
            ExpectedIndex::new(&frame, VeilShares::default(), None, Some(&RingOperator { sizes, values }));
        let scene_mm = sizes.source_rings as f64 * sizes.ring_mm;
        let on_ring = 1e-3 * PI * (scene_mm.powi(2) - 0.05f64.powi(2));
        let mut alone = RingPower::dark(sizes.rings, sizes.azimuths());
        alone.power[..sizes.azimuths()].fill(on_ring / sizes.azimuths() as f64);
        let expected = alone.density(&sizes, (0.0, 0.0));
        assert!(
            (ghosts.ghosts / (expected / (1.0 + expected)) - 1.0).abs() < 1e-3,
            "{} {expected}",
            ghosts.ghosts
        );
    }
}
