//! Expected veiling glare index: the light in a small black disc on the axis, in a white scene, over that beside it.
//!
//! ```text
//! index = (a (1 − M(ρ)/M(r_max)) + g (R̄ − f) + V_ghosts) / (1 + V_ghosts)
//! ```
//! R̄ the mean of the relative illumination over the film; a, g shares of scatter and glare, which keep a uniform field as it is; ρ the radius of the disc, 2.5 % of the film's height, f its share of the film;
//! V_ghosts the ghosts of the scene on the axis, which are added to black and white alike. Each term over the same white is its part of the index.
//! Source: ISO 9358 (black patch method).

use super::kernel::ScatterKernel;
use super::plan::VeilShares;
use crate::design::ghost::rings::{RingOperator, RingPower};
use crate::geometry::Frame;
use crate::real;
use std::f64::consts::PI;

/// Radius of the disc over the height of the film.
const DISC: f64 = 0.025;
/// Rings of the scene are divided into so many, each with so many azimuths.
const PARTS: usize = 16;
const AZIMUTHS: usize = 256;
/// Places of the film along a side, for the mean of the illumination.
const PLACES: usize = 64;

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
    /// Of the veil with `shares` and the kernel `scatter` on the film of `frame`, and the ghosts of `operator`; `illumination` is R at a real height in mm.
    pub fn new(
        frame: &Frame,
        illumination: impl Fn(f64) -> f64,
        shares: VeilShares,
        scatter: Option<ScatterKernel>,
        operator: Option<&RingOperator>,
    ) -> Self {
        let height_mm = frame.film.height as f64 * frame.pitch_mm();
        let (radius_mm, width_mm) = (DISC * height_mm, frame.film.width as f64 * frame.pitch_mm());
        let of_disc = PI * radius_mm * radius_mm / (height_mm * width_mm);
        let ghosts = operator.map_or(0.0, |operator| ghosts_on_axis(frame, operator, radius_mm));
        let white = 1.0 + ghosts;
        let outside = scatter.map_or(0.0, |kernel| 1.0 - kernel.share_within(radius_mm));
        let of_film = mean_over_film(frame, illumination) - of_disc;
        Self {
            ghosts: ghosts / white,
            scatter: shares.scatter * outside / white,
            glare: shares.glare * of_film / white,
        }
    }

    /// Sum of the parts.
    pub fn total(&self) -> f64 {
        self.ghosts + self.scatter + self.glare
    }
}

/// Mean of `illumination` over the film.
fn mean_over_film(frame: &Frame, illumination: impl Fn(f64) -> f64) -> f64 {
    let at = |k: usize, n: usize, axis: f64| {
        ((k as f64 + 0.5) / PLACES as f64 * n as f64 - 0.5 - axis) * frame.pitch_mm()
    };
    let places = (0..PLACES).flat_map(|i| (0..PLACES).map(move |j| (i, j)));
    let sum: f64 = places
        .map(|(i, j)| {
            let y = at(i, frame.film.height, frame.axis_px.0);
            let x = at(j, frame.film.width, frame.axis_px.1);
            illumination((y * y + x * x).sqrt())
        })
        .sum();
    sum / (PLACES * PLACES) as f64
}

/// Ghosts on the axis, of a chart of 1 outside the disc of `radius_mm`.
fn ghosts_on_axis(frame: &Frame, operator: &RingOperator, radius_mm: f64) -> f64 {
    let sizes = operator.sizes;
    let half = |n: usize, scale: f64| 0.5 * n as f64 * scale * frame.pitch_mm();
    let (down, across) = (half(frame.chart.height, frame.scale.0), half(frame.chart.width, frame.scale.1));
    let is_lit = |r: f64, azimuth: usize| {
        let (sin, cos) = real::sin_cos(2.0 * PI * (azimuth as f64 + 0.5) / AZIMUTHS as f64);
        let [x, y] = frame.projection.point_mm([r * cos, r * sin]);
        (y - frame.center_mm.0).abs() <= down && (x - frame.center_mm.1).abs() <= across
    };
    let mut scene = RingPower::dark(sizes.source_rings, sizes.azimuths());
    let part_mm = sizes.ring_mm / PARTS as f64;
    for (ring, power) in scene.power.chunks_exact_mut(scene.azimuths).enumerate() {
        let of_part = |k: usize| {
            let r = ring as f64 * sizes.ring_mm + (k as f64 + 0.5) * part_mm;
            let lit = if r > radius_mm { (0..AZIMUTHS).filter(|k| is_lit(r, *k)).count() } else { 0 };
            2.0 * PI * r * part_mm * lit as f64 / AZIMUTHS as f64
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
        let found = ExpectedIndex::new(&frame, |_| 1.0, shares, Some(kernel), None);
        let mass = |r: f64| (r / 0.01f64).powi(2).ln_1p();
        assert!((found.scatter / (0.03 * (1.0 - mass(0.05) / mass(0.8))) - 1.0).abs() < 1e-12);
        assert!((found.glare / (0.02 * (1.0 - PI * 0.0025 / 8.0)) - 1.0).abs() < 1e-12);
        assert_eq!((found.ghosts, found.total()), (0.0, found.scatter + found.glare));
        // Illumination that falls with the square of the height, to 0.9 at 1 mm: its mean over the film of 2 mm x 4 mm.
        let falling = ExpectedIndex::new(&frame, |r| 1.0 - 0.1 * r * r, shares, None, None);
        let mean = 1.0 - 0.1 * (4.0 + 16.0) / 12.0;
        assert!((falling.glare / (0.02 * (mean - PI * 0.0025 / 8.0)) - 1.0).abs() < 1e-3);
        // All light of each ring of the scene on the innermost ring of the film, a thousandth of it; of a chart as large as the film.
        let sizes = RingSizes::new(2.3, 32);
        let mut values = vec![0.0; (sizes.orders() + 1) * sizes.rings * sizes.source_rings];
        values[..sizes.source_rings].fill(1e-3);
        let operator = RingOperator { sizes, values };
        let ghosts = ExpectedIndex::new(&frame, |_| 1.0, VeilShares::default(), None, Some(&operator));
        let on_ring = 1e-3 * (8.0 - PI * 0.0025);
        let mut alone = RingPower::dark(sizes.rings, sizes.azimuths());
        alone.power[..sizes.azimuths()].fill(on_ring / sizes.azimuths() as f64);
        let expected = alone.density(&sizes, (0.0, 0.0));
        assert!(
            (ghosts.ghosts / (expected / (1.0 + expected)) - 1.0).abs() < 5e-3,
            "{} {expected}",
            ghosts.ghosts
        );
    }
}
