//! Sinusoidal Siemens star: reflectance is sinusoidal in the angle (ISO 12233:2014, s-SFR).
//!
//! ```text
//! share of ink at (r, φ) = (1 + cos N·φ)/2,   r ≤ R, φ from +x towards +y, N the number of periods ("spokes")
//! ```
//! so that a spoke is darkest in the middle of the dark sector of the star with square profile. A pixel is the mean over its square by Gauss and Legendre's
//! rule, in as many cells that the phase k = N/r (rad per px) times their side is at most [`MAX_PHASE`]: error ≤ 2e-6 of the share. At the
//! centre the cells are at most [`MAX_CELLS`] a side, whose phases are many and cancel. On the rim each of 8 × 8 cells is weighted by its exact
//! area within the disc. cos N·φ is the real part of ((x + i·y)/r)^N by repeated squaring: + − × ÷ and square roots, the same bits on every machine.

use super::coverage::{Disc, Point, Polygon};
use super::targets::{INK, PAPER};

/// Nodes and weights on the unit interval about 0, exact to the fifth degree.
const NODES: [(f64, f64); 3] =
    [(-0.387_298_334_620_741_7, 5.0 / 18.0), (0.0, 8.0 / 18.0), (0.387_298_334_620_741_7, 5.0 / 18.0)];
/// Error of three nodes for cos(k·x) over a length of 1: k⁶/2,016,000.
const MAX_PHASE: f64 = 1.25;
const MAX_CELLS: f64 = 24.0;
/// Cells along a side of a pixel on the rim.
const RIM_CELLS: usize = 8;

/// Reflectance of a Siemens star over the angle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StarProfile {
    /// Dark sectors and gaps of the same angle.
    Square,
    /// Sinusoidal between ink and paper.
    Sine,
}

/// A Siemens star of a chart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StarSite {
    /// Its centre (row, column), film pixels.
    pub centre_px: (f64, f64),
    /// Its radius, px.
    pub radius_px: f64,
    /// Periods of a turn; the middle of a dark sector is on +x.
    pub spokes: usize,
    /// Reflectance over the angle.
    pub profile: StarProfile,
}

impl StarSite {
    /// Modulation of its fundamental, (max − min)/(max + min) of a sine: 4/π of that of ink and paper where sectors are square.
    pub fn modulation(&self) -> f64 {
        let of_sine = (PAPER - INK) / (PAPER + INK);
        match self.profile {
            StarProfile::Square => 4.0 / std::f64::consts::PI * of_sine,
            StarProfile::Sine => of_sine,
        }
    }
}

/// A star of `spokes` periods.
#[derive(Clone, Copy, Debug)]
pub(super) struct SineStar {
    pub(super) disc: Disc,
    pub(super) spokes: usize,
}

impl SineStar {
    /// Share of ink of pixel (y, x); `half_widths` are those of the disc in the row.
    pub(super) fn share(&self, y: f64, x: f64, half_widths: (f64, f64)) -> f64 {
        let [cx, cy] = self.disc.centre;
        let away = (x - cx).abs();
        if away - 0.5 >= half_widths.1 {
            0.0
        } else if away + 0.5 <= half_widths.0 {
            self.mean([x - cx, y - cy])
        } else {
            self.on_rim(y, x)
        }
    }

    /// Mean over the pixel at `p` from the centre.
    fn mean(&self, p: Point) -> f64 {
        let nearest = (p[0] * p[0] + p[1] * p[1]).sqrt() - std::f64::consts::FRAC_1_SQRT_2;
        let phase = self.spokes as f64 / nearest.max(1e-3);
        let cells = (phase / MAX_PHASE).ceil().clamp(1.0, MAX_CELLS);
        let side = 1.0 / cells;
        let mut sum = 0.0;
        for i in 0..cells as usize {
            for j in 0..cells as usize {
                let middle = |k: usize| (k as f64 + 0.5) * side - 0.5;
                let (cy, cx) = (p[1] + middle(i), p[0] + middle(j));
                for (v, wv) in NODES {
                    for (u, wu) in NODES {
                        sum += wv * wu * self.at([cx + u * side, cy + v * side]);
                    }
                }
            }
        }
        (sum * side * side).clamp(0.0, 1.0)
    }

    fn on_rim(&self, y: f64, x: f64) -> f64 {
        let [cx, cy] = self.disc.centre;
        let half = 0.5 / RIM_CELLS as f64;
        let middle = |k: usize| (2 * k + 1) as f64 * half - 0.5;
        let mut sum = 0.0;
        for (i, j) in (0..RIM_CELLS).flat_map(|i| (0..RIM_CELLS).map(move |j| (i, j))) {
            let (v, u) = (y + middle(i), x + middle(j));
            let cell = Polygon::rectangle(u - half, v - half, u + half, v + half);
            sum += self.disc.area_within(&cell) * self.at([u - cx, v - cy]);
        }
        sum.clamp(0.0, 1.0)
    }

    /// Share of ink at a point from the centre.
    fn at(&self, [x, y]: Point) -> f64 {
        let r = (x * x + y * y).sqrt();
        if r == 0.0 {
            return 0.5;
        }
        let (mut power, mut base) = ((1.0, 0.0), (x / r, y / r));
        let mut n = self.spokes;
        while n > 0 {
            if n & 1 == 1 {
                power = times(power, base);
            }
            base = times(base, base);
            n >>= 1;
        }
        (1.0 + power.0) / 2.0
    }
}

/// Product of complex numbers.
fn times(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_are_means_of_the_profile() {
        for (spokes, radius) in [(8, 30.0), (72, 45.0)] {
            let star = SineStar { disc: Disc { centre: [50.3, 49.8], radius }, spokes };
            for (y, x) in [
                (50, 50),
                (50, 51),
                (52, 47),
                (60, 55),
                (49, 75),
                (71, 71),
                (30, 40),
                (79, 52),
                (95, 50),
                (5, 52),
            ] {
                let (y, x) = (f64::from(y), f64::from(x));
                let n = 600;
                let at = |i: usize| (i as f64 + 0.5) / n as f64 - 0.5;
                let sum: f64 = (0..n * n)
                    .map(|k| (x + at(k % n) - 50.3, y + at(k / n) - 49.8))
                    .filter(|(u, v)| u.hypot(*v) <= radius)
                    .map(|(u, v)| (1.0 + (spokes as f64 * v.atan2(u)).cos()) / 2.0)
                    .sum();
                let share = star.share(y, x, star.disc.half_widths(y));
                let brute = sum / (n * n) as f64;
                let away = (x - 50.3).hypot(y - 49.8);
                // Brute force has an error of 1/n on the rim; the pixel of the centre has all phases.
                let tolerance = if away < 1.0 {
                    3e-3
                } else if (away - radius).abs() < 1.0 {
                    2e-3
                } else {
                    1e-5
                };
                assert!((share - brute).abs() < tolerance, "{spokes} at {y} {x}: {share} {brute}");
            }
        }
    }
}
