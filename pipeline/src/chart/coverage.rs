//! Share of a pixel that a shape covers, as exact area: edges are pixel means, without sampling error.
//!
//! A pixel (y, x) is the unit square about its centre. Straight edges: the convex polygon is clipped by the pixel's four
//! sides (Sutherland and Hodgman, CACM 17, 1974) and its area is the shoelace sum. Circles: the signed areas of disc ∩
//! triangle(centre, a, b) over the polygon's edges a→b; a triangle's part outside the disc is a sector. Both are exact
//! but for rounding, ≤ 1e-9 of a pixel on any chart. A Gaussian's pixel mean splits into one factor per axis.

use crate::real;

/// A point (x, y) in chart pixels.
pub(super) type Point = [f64; 2];

/// Largest number of corners: five as drawn, one for each of the four sides of a row and a pixel, and spare ones.
const MAX_CORNERS: usize = 12;

/// A convex polygon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Polygon {
    corners: [Point; MAX_CORNERS],
    count: usize,
}

impl Polygon {
    /// The convex polygon with these corners, in either orientation.
    pub(super) fn new(corners: &[Point]) -> Self {
        let mut polygon = Self { corners: [[0.0; 2]; MAX_CORNERS], count: 0 };
        corners.iter().for_each(|&p| polygon.push(p));
        polygon
    }

    /// The axis-parallel rectangle x0..x1, y0..y1.
    pub(super) fn rectangle(x0: f64, y0: f64, x1: f64, y1: f64) -> Self {
        Self::new(&[[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    }

    /// The rectangle of half sizes (along u, along v) about `centre`, u rotated by `angle_rad` from +x towards +y.
    pub(super) fn rotated(centre: Point, half: [f64; 2], angle_rad: f64) -> Self {
        let (sin, cos) = real::sin_cos(angle_rad);
        let corner = |u: f64, v: f64| {
            let (u, v) = (u * half[0], v * half[1]);
            [centre[0] + u * cos - v * sin, centre[1] + u * sin + v * cos]
        };
        Self::new(&[corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)])
    }

    fn push(&mut self, p: Point) {
        self.corners[self.count] = p;
        self.count += 1;
    }

    /// The corners, in order.
    pub(super) fn corners(&self) -> &[Point] {
        &self.corners[..self.count]
    }

    /// The part where p·normal ≤ limit.
    pub(super) fn clipped(&self, normal: Point, limit: f64) -> Self {
        self.cut(|p| p[0] * normal[0] + p[1] * normal[1] - limit, None)
    }

    /// The part with coordinate `axis` (0 x, 1 y) between two values. New corners lie exactly on them.
    pub(super) fn between(&self, axis: usize, low: f64, high: f64) -> Self {
        self.cut(|p| low - p[axis], Some((axis, low))).cut(|p| p[axis] - high, Some((axis, high)))
    }

    fn cut(&self, beyond: impl Fn(Point) -> f64, exact: Option<(usize, f64)>) -> Self {
        let corners = self.corners();
        let mut kept = Self { corners: [[0.0; 2]; MAX_CORNERS], count: 0 };
        let Some(&(mut a)) = corners.last() else { return kept };
        let mut da = beyond(a);
        for &b in corners {
            let db = beyond(b);
            if (da <= 0.0) != (db <= 0.0) {
                let t = da / (da - db);
                let mut p = [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
                if let Some((axis, value)) = exact {
                    p[axis] = value;
                }
                kept.push(p);
            }
            if db <= 0.0 {
                kept.push(b);
            }
            (a, da) = (b, db);
        }
        kept
    }

    /// Minimum and maximum of coordinate `axis`; (∞, −∞) if empty.
    pub(super) fn extent(&self, axis: usize) -> (f64, f64) {
        self.corners()
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), p| (lo.min(p[axis]), hi.max(p[axis])))
    }

    /// Minimum and maximum x of the corners at exactly `y`.
    pub(super) fn extent_at(&self, y: f64) -> (f64, f64) {
        let at = self.corners().iter().filter(|p| p[1] == y);
        at.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), p| (lo.min(p[0]), hi.max(p[0])))
    }

    /// Its area.
    pub(super) fn area(&self) -> f64 {
        let corners = self.corners();
        let Some(o) = corners.first() else { return 0.0 };
        // Relative to a corner: products of large coordinates would lose digits.
        let doubled: f64 = corners
            .windows(2)
            .map(|w| (w[0][0] - o[0]) * (w[1][1] - o[1]) - (w[1][0] - o[0]) * (w[0][1] - o[1]))
            .sum();
        doubled.abs() / 2.0
    }
}

/// A disc: centre and radius in chart pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disc {
    pub(super) centre: Point,
    pub(super) radius: f64,
}

impl Disc {
    /// Area of the intersection with a convex polygon.
    pub(super) fn area_within(&self, polygon: &Polygon) -> f64 {
        let corners = polygon.corners();
        let Some(&last) = corners.last() else { return 0.0 };
        let local = |p: Point| [p[0] - self.centre[0], p[1] - self.centre[1]];
        let mut a = local(last);
        let mut sum = 0.0;
        for &p in corners {
            let b = local(p);
            sum += self.area_of_triangle(a, b);
            a = b;
        }
        sum.abs()
    }

    /// Signed area of disc ∩ triangle(centre, a, b), a and b from the centre.
    fn area_of_triangle(&self, a: Point, b: Point) -> f64 {
        let r2 = self.radius * self.radius;
        let dot = |p: Point, q: Point| p[0] * q[0] + p[1] * q[1];
        let d = [b[0] - a[0], b[1] - a[1]];
        // The cross product of a + s·d and a + t·d is (t − s)·(a × d). Computing a × b directly, a difference of two products of the
        // size of the radius squared, would lose the digits of one pixel on a large circle.
        let span = a[0] * d[1] - a[1] * d[0];
        let at = |t: f64| [a[0] + t * d[0], a[1] + t * d[1]];
        let sector = |s: f64, t: f64| r2 / 2.0 * angle((t - s) * span, dot(at(s), at(t)));
        let (aa, dd, ad) = (dot(a, a), dot(d, d), dot(a, d));
        if aa <= r2 && dot(b, b) <= r2 {
            return span / 2.0;
        }
        // |a + t·d| = r
        let root = ad * ad - dd * (aa - r2);
        if root <= 0.0 {
            return sector(0.0, 1.0);
        }
        let (enters, leaves) = ((-ad - root.sqrt()) / dd, (-ad + root.sqrt()) / dd);
        if enters >= 1.0 || leaves <= 0.0 {
            return sector(0.0, 1.0);
        }
        let outside_before = if enters > 0.0 { sector(0.0, enters) } else { 0.0 };
        let outside_after = if leaves < 1.0 { sector(leaves, 1.0) } else { 0.0 };
        outside_before + (leaves.min(1.0) - enters.max(0.0)) * span / 2.0 + outside_after
    }

    /// Smallest and largest half width of the disc within row y ± ½: (inner, outer). Columns within ± inner are inside, those beyond
    /// ± outer are outside; inner < 0 if none is inside.
    pub(super) fn half_widths(&self, y: f64) -> (f64, f64) {
        let away = (y - self.centre[1]).abs();
        let half = |d: f64| {
            let left = self.radius * self.radius - d * d;
            if left >= 0.0 { left.sqrt() } else { -1.0 }
        };
        (half(away + 0.5), half((away - 0.5).max(0.0)))
    }

    /// Covered share of pixel (y, x); `half_widths` are those of the row.
    pub(super) fn share(&self, y: f64, x: f64, half_widths: (f64, f64)) -> f64 {
        let away = (x - self.centre[0]).abs();
        if away + 0.5 <= half_widths.0 {
            1.0
        } else if away - 0.5 >= half_widths.1 {
            0.0
        } else {
            self.area_within(&Polygon::rectangle(x - 0.5, y - 0.5, x + 0.5, y + 0.5)).min(1.0)
        }
    }
}

/// atan2, by its series for small angles: the next term t⁷/7 ≤ 2e-13 where r ≤ 1/t contributes ≤ 3e-10 px².
fn angle(cross: f64, dot: f64) -> f64 {
    let t = cross / dot;
    if dot > 0.0 && t.abs() < 0.02 {
        let t2 = t * t;
        t * (1.0 - t2 * (1.0 / 3.0 - t2 / 5.0))
    } else {
        real::atan2(cross, dot)
    }
}

/// Mean of exp(−u²/2σ²) over the unit interval about `offset`, by Gauss-Legendre on five points: error
/// ≤ 4e-13·945/σ¹⁰, below 1e-9 from σ = 0.9 px up.
pub(super) fn gaussian_mean(offset: f64, sigma: f64) -> f64 {
    const NODES: [(f64, f64); 5] = [
        (0.0, 0.284_444_444_444_444_4),
        (-0.269_234_655_052_841_5, 0.239_314_335_249_683_2),
        (0.269_234_655_052_841_5, 0.239_314_335_249_683_2),
        (-0.453_089_922_969_332, 0.118_463_442_528_094_6),
        (0.453_089_922_969_332, 0.118_463_442_528_094_6),
    ];
    NODES.iter().map(|(at, weight)| weight * real::exp(-0.5 * ((offset + at) / sigma).powi(2))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Share of a unit pixel by brute force, n × n points.
    fn sampled(y: f64, x: f64, n: usize, inside: impl Fn(f64, f64) -> bool) -> f64 {
        let at = |i: usize| (i as f64 + 0.5) / n as f64 - 0.5;
        let hits = (0..n * n).filter(|k| inside(y + at(k / n), x + at(k % n))).count();
        hits as f64 / (n * n) as f64
    }

    #[test]
    fn half_planes_match_brute_force() {
        for k in 0..40 {
            let (angle, shift) = (0.161 * f64::from(k), 0.031 * f64::from(k) - 0.6);
            let normal = [angle.cos(), angle.sin()];
            let (y, x) = (9000.0, 12345.0);
            let limit = x * normal[0] + y * normal[1] + shift;
            let pixel = Polygon::rectangle(x - 0.5, y - 0.5, x + 0.5, y + 0.5);
            let area = pixel.clipped(normal, limit).area();
            let brute = sampled(0.0, 0.0, 1000, |v, u| u * normal[0] + v * normal[1] <= shift);
            assert!((area - brute).abs() < 2e-3, "{k}: {area} {brute}");
        }
    }

    #[test]
    fn discs_match_brute_force_and_add_up() {
        for (radius, cy, cx) in [(0.3, 2.1, 2.2), (1.7, 3.0, 3.0), (4.9, 5.3, 6.4), (300.0, 305.0, 3.0)] {
            let disc = Disc { centre: [cx, cy], radius };
            let mut sum = 0.0;
            for y in 0..14 {
                let (y, mut row) = (f64::from(y), 0.0);
                let half_widths = disc.half_widths(y);
                for x in 0..14 {
                    let x = f64::from(x);
                    let share = disc.share(y, x, half_widths);
                    let brute = sampled(y, x, 200, |v, u| (u - cx).hypot(v - cy) <= radius);
                    assert!((share - brute).abs() < 5e-3, "r {radius} at {y} {x}: {share} {brute}");
                    row += share;
                }
                sum += row;
            }
            if radius < 5.0 {
                assert!((sum - std::f64::consts::PI * radius * radius).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn large_circles_are_accurate() {
        for radius in [900.0, 1e4, 7e5] {
            for x in [0.0, 0.3 * radius, 0.9 * radius] {
                let (disc, x) = (Disc { centre: [0.25, 0.0], radius }, f64::round(x));
                // Area of the disc's lower half in one column: by integration, and as the sum over pixels.
                let height = |u: f64| ((radius - u) * (radius + u)).sqrt();
                let n = 4000;
                let mean = |i: usize| height(x - 0.25 - 0.5 + (i as f64 + 0.5) / n as f64);
                let first = height(x).floor() - 12.0;
                let total = (0..n).map(|i| mean(i) - (first - 0.5)).sum::<f64>() / n as f64;
                let pixels: f64 = (0..24)
                    .map(|i| first + f64::from(i))
                    .map(|y| disc.share(y, x, disc.half_widths(y)))
                    .sum();
                assert!((pixels - total).abs() < 2e-8, "{radius} {x}: {pixels} {total}");
            }
        }
    }

    #[test]
    fn gaussian_means_match_fine_sums() {
        for (offset, sigma) in [(0.0, 1.0), (0.7, 1.0), (3.0, 1.5), (0.2, 6.0)] {
            let n = 20_000;
            let at = |i: usize| offset - 0.5 + (i as f64 + 0.5) / n as f64;
            let fine = (0..n).map(|i| (-0.5 * (at(i) / sigma).powi(2)).exp()).sum::<f64>() / n as f64;
            assert!((gaussian_mean(offset, sigma) - fine).abs() < 1e-9, "{offset} {sigma}");
        }
    }

    #[test]
    fn clipped_polygons_have_the_expected_area() {
        let square = Polygon::rectangle(0.0, 0.0, 4.0, 2.0);
        assert_eq!(square.between(1, 3.0, 4.0).area(), 0.0);
        assert_eq!(square.between(1, 0.5, 1.5).area(), 4.0);
        assert_eq!(square.between(0, 1.0, 3.0).extent_at(0.0), (1.0, 3.0));
    }
}
