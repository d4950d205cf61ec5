//! Edge functions and plane of a triangle.

use crate::scene::vector::{cross, sub};

/// What is evaluated at the samples of a triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edges {
    /// Normals of the planes through the camera and each edge, that opposite of corner k at k.
    pub(crate) n: [[f64; 3]; 3],
    /// e is positive from here on: 0, or the least number above if 0 has the negative sign.
    pub(crate) least: [f64; 3],
    /// N.
    pub(crate) plane: [f64; 3],
    /// N·v0.
    pub(crate) offset: f64,
}

/// The least positive f64.
const ABOVE_ZERO: f64 = f64::from_bits(1);

/// (n_x x + n_y y) + n_z.
#[inline(always)]
pub(crate) fn along(n: &[f64; 3], x: f64, y: f64) -> f64 {
    (n[0] * x + n[1] * y) + n[2]
}

impl Edges {
    /// Of the corners; `None` if no ray has a hit: the plane of the triangle, or of an edge, holds the camera.
    pub(crate) fn new([a, b, c]: [[f64; 3]; 3]) -> Option<Self> {
        let n = [cross(b, c), cross(c, a), cross(a, b)];
        let mut least = [0.0; 3];
        for (least, n) in least.iter_mut().zip(&n) {
            let first = n.iter().find(|v| **v != 0.0)?;
            *least = if *first > 0.0 { 0.0 } else { ABOVE_ZERO };
        }
        let plane = cross(sub(b, a), sub(c, a));
        let offset = (plane[0] * a[0] + plane[1] * a[1]) + plane[2] * a[2];
        (offset != 0.0).then_some(Self { n, least, plane, offset })
    }

    /// Whether a ray can have a hit if its direction lies in the rectangle from (x0, y0) to (x1, y1).
    ///
    /// Products and sums round monotonically, so e and N·d have their extremes at corners of the rectangle: no hit is missed.
    pub(crate) fn may_hit(&self, low: [f64; 2], high: [f64; 2]) -> bool {
        let corners = [[low[0], low[1]], [high[0], low[1]], [low[0], high[1]], [high[0], high[1]]];
        let (mut all_positive, mut all_negative) = (true, true);
        for (n, least) in self.n.iter().zip(self.least) {
            let positive = corners.map(|[x, y]| along(n, x, y) >= least);
            all_positive &= positive.contains(&true);
            all_negative &= positive.contains(&false);
        }
        (all_positive || all_negative)
            && corners.iter().any(|&[x, y]| along(&self.plane, x, y) / self.offset > 0.0)
    }

    /// Vergence of the plane in 1/m.
    #[cfg(test)]
    fn vergence(&self, x: f64, y: f64) -> f64 {
        along(&self.plane, x, y) / self.offset
    }

    /// Barycentric coordinates.
    #[inline]
    pub(crate) fn barycentric(&self, x: f64, y: f64) -> [f64; 3] {
        let e = [along(&self.n[0], x, y), along(&self.n[1], x, y), along(&self.n[2], x, y)];
        let sum = (e[0] + e[1]) + e[2];
        if sum == 0.0 {
            return [1.0 / 3.0; 3];
        }
        let share = 1.0 / sum;
        e.map(|e| {
            let b = e * share;
            let b = if b > 0.0 { b } else { 0.0 };
            if b < 1.0 { b } else { 1.0 }
        })
    }

    /// Whether hits see the side from which corners run counter-clockwise: N·d < 0 and V > 0.
    pub(crate) fn is_counter_clockwise(&self) -> bool {
        self.offset < 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether the ray meets the triangle, from the definition.
    fn meets(e: &Edges, x: f64, y: f64) -> bool {
        let positive = [0, 1, 2].map(|k| along(&e.n[k], x, y) >= e.least[k]);
        positive == [true; 3] || positive == [false; 3]
    }

    #[test]
    fn a_ray_through_a_shared_edge_or_corner_meets_one_triangle() {
        // A fan of 8 triangles about (0, 0, 1), and rays through the centre, the edges and between them.
        let rim: [[f64; 3]; 8] = [
            [1.0, 0.0, 1.0],
            [1.0, 1.0, 1.0],
            [0.0, 1.0, 1.0],
            [-1.0, 1.0, 1.0],
            [-1.0, 0.0, 1.0],
            [-1.0, -1.0, 1.0],
            [0.0, -1.0, 1.0],
            [1.0, -1.0, 1.0],
        ];
        let fan: Vec<Edges> =
            (0..8).map(|i| Edges::new([[0.0, 0.0, 1.0], rim[i], rim[(i + 1) % 8]]).unwrap()).collect();
        for i in -7..8 {
            for j in -7..8 {
                let (x, y) = (f64::from(i) / 8.0, f64::from(j) / 8.0);
                assert_eq!(fan.iter().filter(|e| meets(e, x, y)).count(), 1, "{x} {y}");
            }
        }
        assert!(fan.iter().all(|e| e.vergence(0.3, 0.2) == 1.0 && !e.is_counter_clockwise()));
    }

    #[test]
    fn triangles_seen_edge_on_are_never_hit() {
        assert!(Edges::new([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, 2.0]]).is_none());
        assert!(Edges::new([[0.5, 0.5, 1.0], [1.0, 1.0, 2.0], [1.0, 0.0, 2.0]]).is_none());
    }

    #[test]
    fn barycentric_coordinates_are_those_of_the_corners() {
        let corners = [[0.0, 0.0, 1.0], [2.0, 0.0, 2.0], [0.0, 4.0, 4.0]];
        let e = Edges::new(corners).unwrap();
        let at = [0.25, 0.25, 0.5];
        let p: [f64; 3] = std::array::from_fn(|k| (0..3).map(|i| at[i] * corners[i][k]).sum());
        let got = e.barycentric(p[0] / p[2], p[1] / p[2]);
        assert!((0..3).all(|k| (got[k] - at[k]).abs() < 1e-15), "{got:?}");
        assert!((e.vergence(p[0] / p[2], p[1] / p[2]) - 1.0 / p[2]).abs() < 1e-15);
    }

    #[test]
    fn rectangles_without_hits_are_found_and_no_others() {
        let e = Edges::new([[-0.1, 0.0, 1.0], [0.1, 0.0, 1.0], [0.0, 2.0, -1.0]]).unwrap();
        for i in -20..20 {
            for j in -20..20 {
                let (x, y) = (f64::from(i) / 10.0, f64::from(j) / 10.0);
                let inside = (0..=8).any(|a| {
                    (0..=8).any(|b| {
                        let (x, y) = (x + f64::from(a) / 80.0, y + f64::from(b) / 80.0);
                        meets(&e, x, y) && e.vergence(x, y) > 0.0
                    })
                });
                let may = e.may_hit([x, y], [x + 0.1, y + 0.1]);
                assert!(may || !inside, "{x} {y}");
            }
        }
        assert!(!e.may_hit([-0.01, -0.75], [0.01, -0.5]) && e.may_hit([-0.1, 0.1], [0.1, 0.2]));
    }
}
