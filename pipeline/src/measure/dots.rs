//! Distortion and lateral chromatic displacement of a chart of dots (after ISO 17850 and ISO 19084).
//!
//! Dots at the chart positions p are found at q (row, column; px of the picture). The picture of a chart that may be displaced, rotated, scaled and slightly tilted through a lens whose
//! distortion is radial about the middle c of the picture is
//! ```text
//! u = M·(p − p̄)/(1 + g·(p − p̄)) + t,    M = ((a, −b), (b, a)),     q = c + u·(1 + k₁ρ² + k₂ρ⁴ + k₃ρ⁶),     ρ = |u|/half diagonal
//! ```
//! fitted to all dots by least squares (Gauss and Newton); u is where a lens without distortion, of the same magnification in the middle, has the dot.
//! ```text
//! geometric distortion = |q − c|/|u| − 1,         residual = |q − fit|
//! ```
//! Lateral chromatic displacement of a channel is that of its dot against the green one, along the radius from c (outward positive) and across it.

use crate::geometry::Size;
use crate::least_squares::Qr;
use crate::real;

/// Unknowns: a, b, t, g, k.
const UNKNOWNS: usize = 9;
/// Steps of the fit; it converges quadratically.
const STEPS: usize = 12;

/// (row, column), px.
pub type Position = (f64, f64);

/// A fitted distortion.
#[derive(Clone, Debug, PartialEq)]
pub struct Distortion {
    /// Middle of the picture.
    centre: Position,
    /// Half diagonal of the picture, px.
    half_px: f64,
    /// Mean chart position.
    middle: Position,
    unknowns: [f64; UNKNOWNS],
    /// Residual of each dot, px.
    pub residuals_px: Vec<f64>,
}

impl Distortion {
    /// Fits pairs of chart and picture positions of a picture of `size`. `None` of fewer than nine dots, or if they do not determine the unknowns.
    pub fn fit(pairs: &[(Position, Position)], size: Size) -> Option<Self> {
        if pairs.len() < UNKNOWNS {
            return None;
        }
        let n = pairs.len() as f64;
        let mean = |of: &dyn Fn(&(Position, Position)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
        let centre = ((size.height as f64 - 1.0) / 2.0, (size.width as f64 - 1.0) / 2.0);
        let middle = (mean(&|p| p.0.0), mean(&|p| p.0.1));
        let found = (mean(&|p| p.1.0) - centre.0, mean(&|p| p.1.1) - centre.1);
        // Similarity by least squares.
        let (mut dot, mut cross, mut norm) = (0.0, 0.0, 0.0);
        for (p, q) in pairs {
            let (p, q) =
                ((p.0 - middle.0, p.1 - middle.1), (q.0 - centre.0 - found.0, q.1 - centre.1 - found.1));
            dot += p.0 * q.0 + p.1 * q.1;
            cross += p.0 * q.1 - p.1 * q.0;
            norm += p.0 * p.0 + p.1 * p.1;
        }
        let mut unknowns = [0.0; UNKNOWNS];
        unknowns[..4].copy_from_slice(&[dot / norm, cross / norm, found.0, found.1]);
        let half_px = real::hypot(size.height as f64, size.width as f64) / 2.0;
        let mut fit = Self { centre, half_px, middle, unknowns, residuals_px: Vec::new() };
        // Tilt in units of the half diagonal, so that all columns are of a scale.
        let steps = [1e-7, 1e-7, 1e-4, 1e-4, 1e-7 / half_px, 1e-7 / half_px, 1e-7, 1e-7, 1e-7];
        for _ in 0..STEPS {
            let errors = |fit: &Self| -> Vec<f64> {
                let one = |(p, q): &(Position, Position)| {
                    let at = fit.at(*p);
                    [at.0 - q.0, at.1 - q.1]
                };
                pairs.iter().flat_map(one).collect()
            };
            let before = errors(&fit);
            let column = |k: usize| {
                let moved = |by: f64| {
                    let mut other = fit.clone();
                    other.unknowns[k] += by;
                    errors(&other)
                };
                let (ahead, behind) = (moved(steps[k]), moved(-steps[k]));
                std::iter::zip(ahead, behind).map(|(a, b)| (a - b) / (2.0 * steps[k])).collect::<Vec<f64>>()
            };
            let change = Qr::new((0..UNKNOWNS).map(column).collect())?.solve(&before);
            std::iter::zip(&mut fit.unknowns, &change).for_each(|(u, d)| *u -= d);
        }
        let residual = |(p, q): &(Position, Position)| {
            let at = fit.at(*p);
            real::hypot(at.0 - q.0, at.1 - q.1)
        };
        fit.residuals_px = pairs.iter().map(residual).collect();
        fit.residuals_px.iter().all(|r| r.is_finite()).then_some(fit)
    }

    /// Picture position of a chart position by a lens of the same magnification in the middle without distortion.
    pub fn without_distortion(&self, p: Position) -> Position {
        let u = self.undistorted(p);
        (self.centre.0 + u.0, self.centre.1 + u.1)
    }

    /// Picture position of a chart position.
    pub fn at(&self, p: Position) -> Position {
        let u = self.undistorted(p);
        let factor = 1.0 + self.distortion(real::hypot(u.0, u.1) / self.half_px);
        (self.centre.0 + u.0 * factor, self.centre.1 + u.1 * factor)
    }

    /// Geometric distortion at an undistorted distance from the middle, as a share of the half diagonal.
    pub fn distortion(&self, share: f64) -> f64 {
        let (r2, k) = (share * share, &self.unknowns[6..]);
        r2 * (k[0] + r2 * (k[1] + r2 * k[2]))
    }

    /// Distance of a picture position from the middle as a share of the half diagonal.
    pub fn share(&self, q: Position) -> f64 {
        real::hypot(q.0 - self.centre.0, q.1 - self.centre.1) / self.half_px
    }

    /// Displacement of `other` against `green` along the radius, outward, and across it, px.
    pub fn lateral(&self, green: Position, other: Position) -> (f64, f64) {
        let (y, x) = (green.0 - self.centre.0, green.1 - self.centre.1);
        let r = real::hypot(y, x);
        let (dy, dx) = (other.0 - green.0, other.1 - green.1);
        match r > 0.0 {
            true => ((dy * y + dx * x) / r, (dx * y - dy * x) / r),
            false => (0.0, real::hypot(dy, dx)),
        }
    }

    fn undistorted(&self, p: Position) -> Position {
        let [a, b, t0, t1, g0, g1, ..] = self.unknowns;
        let (y, x) = (p.0 - self.middle.0, p.1 - self.middle.1);
        let w = 1.0 + g0 * y + g1 * x;
        ((a * y - b * x) / w + t0, (b * y + a * x) / w + t1)
    }
}

/// Finds the details of a chart one after the other, from the middle outwards: `find` looks for detail `k` near a place, which is that of `map` plus the displacement of the nearest detail that was found before.
pub fn follow(
    sites: &[Position],
    middle: Position,
    map: impl Fn(Position) -> Position,
    mut find: impl FnMut(usize, Position) -> Option<Position>,
) -> Vec<Option<Position>> {
    let distance = |a: Position, b: Position| real::hypot(a.0 - b.0, a.1 - b.1);
    let mut order: Vec<usize> = (0..sites.len()).collect();
    order.sort_by(|a, b| distance(sites[*a], middle).total_cmp(&distance(sites[*b], middle)));
    let mut found: Vec<Option<Position>> = vec![None; sites.len()];
    let mut known: Vec<(Position, Position)> = Vec::new();
    for k in order {
        let nearest = known.iter().min_by(|a, b| distance(a.0, sites[k]).total_cmp(&distance(b.0, sites[k])));
        let by = nearest.map_or((0.0, 0.0), |(_, by)| *by);
        let expected = map(sites[k]);
        found[k] = find(k, (expected.0 + by.0, expected.1 + by.1));
        if let Some(at) = found[k] {
            known.push((sites[k], (at.0 - expected.0, at.1 - expected.1)));
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Vec<Position> {
        (0..11)
            .flat_map(|i| (0..15).map(move |j| (20.0 + 96.0 * f64::from(i), 30.0 + 96.0 * f64::from(j))))
            .collect()
    }

    #[test]
    fn a_set_distortion_is_found_within_1e_5_px_of_a_rotated_displaced_tilted_chart() {
        let size = Size::new(1001, 1401);
        for k in [[-0.08, 0.02, -0.004], [0.05, 0.0, 0.01], [0.0; 3]] {
            let truth = Distortion {
                centre: (500.0, 700.0),
                half_px: 1001f64.hypot(1401.0) / 2.0,
                middle: (500.0, 702.0),
                unknowns: [0.97, 0.02, 4.0, -3.0, 1e-5, -2e-5, k[0], k[1], k[2]],
                residuals_px: Vec::new(),
            };
            let pairs: Vec<_> = grid().into_iter().map(|p| (p, truth.at(p))).collect();
            let fit = Distortion::fit(&pairs, size).unwrap();
            let worst = fit.residuals_px.iter().copied().fold(0.0, f64::max);
            assert!(worst < 1e-5, "{worst:e}");
            for p in grid() {
                let (a, b) = (fit.without_distortion(p), truth.without_distortion(p));
                assert!((a.0 - b.0).hypot(a.1 - b.1) < 1e-3, "{p:?}: {a:?} for {b:?}");
            }
            for share in [0.2, 0.6, 1.0] {
                let expected = share * share * (k[0] + share * share * (k[1] + share * share * k[2]));
                assert!((fit.distortion(share) - expected).abs() < 1e-5);
            }
        }
        assert_eq!(Distortion::fit(&[((0.0, 0.0), (0.0, 0.0)); 8], size), None);
        assert_eq!(Distortion::fit(&[((0.0, 0.0), (0.0, 0.0)); 20], size), None);
    }

    #[test]
    fn lateral_displacement_is_along_and_across_the_radius() {
        let pairs: Vec<_> = grid().into_iter().map(|p| (p, p)).collect();
        let fit = Distortion::fit(&pairs, Size::new(1001, 1401)).unwrap();
        let (along, across) = fit.lateral((500.0, 900.0), (500.25, 900.5));
        assert!((along - 0.5).abs() < 1e-12 && (across.abs() - 0.25).abs() < 1e-12);
    }

    #[test]
    fn details_are_followed_where_the_displacement_is_larger_than_the_search() {
        let shown = |p: Position| {
            let (y, x) = (p.0 - 500.0, p.1 - 702.0);
            let f = 1.0 - 1.5e-7 * (y * y + x * x);
            (500.0 + y * f, 702.0 + x * f)
        };
        let sites = grid();
        let within = |k: usize, near: Position| {
            let at = shown(sites[k]);
            ((at.0 - near.0).hypot(at.1 - near.1) < 25.0).then_some(at)
        };
        let found = follow(&sites, (500.0, 702.0), |p| p, within);
        assert!(found.iter().all(Option::is_some));
        let alone = sites.iter().enumerate().filter(|(k, p)| within(*k, **p).is_none()).count();
        assert!(alone > 10, "the search alone misses {alone}");
    }
}
