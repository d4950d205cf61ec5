//! Polygons to triangles.
//!
//! The polygon is projected along the axis in which its normal (Newell's sum over its edges) is largest, the first of x, y, z if equal, so
//! that it runs counter-clockwise. cross(a, b, c) = (b − a) × (c − a) in this plane, f64.
//!
//! 1. Three corners are a triangle. If cross ≥ 0 at all corners, or the normal is 0, the triangles are (0, i, i + 1): a fan.
//! 2. Else ears are cut off: starting at corner 0, the next corner b with neighbours a, c whose cross > 0 and whose closed triangle has no
//!    other corner that had cross ≤ 0 at the start and has it still, but for those at the place of a, b or c. The search goes on behind c.
//! 3. Without ears, the first corner with cross = 0 is cut off (a triangle without area).
//! 4. Without those the polygon intersects itself: the rest is a fan, and it is counted.
//!
//! Triangles keep the orientation of the polygon. Source: G. H. Meisters, "Polygons have ears", Am. Math. Monthly 82 (1975) 648-651.

/// Maximum number of tests of one corner against one ear in a file; seconds. A polygon of n corners needs up to a few n².
const MAX_TESTS: u64 = 1_000_000_000;

/// Divides polygons.
#[derive(Default)]
pub(super) struct Triangulator {
    /// Polygons that intersect themselves.
    pub intersecting: u64,
    tests: u64,
    flat: Vec<[f64; 2]>,
    /// Corners left, as a ring: the corner before and after each.
    ring: Vec<[u32; 2]>,
    /// Corners whose cross was at most 0 at the start; those cut off are removed from time to time.
    reflex: Vec<u32>,
    triangles: Vec<[u32; 3]>,
}

/// The polygons of a file have too many corners.
#[derive(Debug, PartialEq)]
pub(super) struct TooComplex;

impl Triangulator {
    /// Bytes of memory per corner of the largest polygon, while its lists grow.
    pub const BYTES_PER_CORNER: u64 = 3 * (16 + 8 + 4 + 12);

    /// The triangles of a polygon with corner i of `corners` at `position(i)`, as numbers of its corners; none for less than three corners.
    ///
    /// # Errors
    /// [`TooComplex`].
    pub fn divide(
        &mut self,
        corners: u32,
        position: impl Fn(u32) -> [f64; 3],
    ) -> Result<&[[u32; 3]], TooComplex> {
        self.triangles.clear();
        if corners > 3 && self.project(corners, position) {
            self.cut_ears(corners)?;
        } else {
            self.triangles.extend((2..corners).map(|i| [0, i - 1, i]));
        }
        Ok(&self.triangles)
    }

    /// Projects the corners; returns whether the polygon is concave.
    fn project(&mut self, corners: u32, position: impl Fn(u32) -> [f64; 3]) -> bool {
        let origin = position(0);
        let from_origin = |i| {
            let p = position(i);
            std::array::from_fn::<f64, 3, _>(|k| p[k] - origin[k])
        };
        let mut normal = [0.0; 3];
        let mut before = from_origin(corners - 1);
        for i in 0..corners {
            let p = from_origin(i);
            for (k, sum) in normal.iter_mut().enumerate() {
                let (x, y) = ((k + 1) % 3, (k + 2) % 3);
                *sum += (before[x] - p[x]) * (before[y] + p[y]);
            }
            before = p;
        }
        let mut axis = 0;
        for k in 1..3 {
            if normal[k].abs() > normal[axis].abs() {
                axis = k;
            }
        }
        let (mut x, mut y) = ((axis + 1) % 3, (axis + 2) % 3);
        if normal[axis] < 0.0 {
            (x, y) = (y, x);
        }
        self.flat.clear();
        self.flat.extend((0..corners).map(from_origin).map(|p| [p[x], p[y]]));
        self.ring.clear();
        let last = corners - 1;
        self.ring.extend(
            (0..corners).map(|i| [if i == 0 { last } else { i - 1 }, if i == last { 0 } else { i + 1 }]),
        );
        let mut reflex = std::mem::take(&mut self.reflex);
        reflex.clear();
        reflex.extend((0..corners).filter(|&i| self.turn(i) <= 0.0));
        self.reflex = reflex;
        normal[axis] != 0.0 && self.reflex.iter().any(|&i| self.turn(i) < 0.0)
    }

    /// cross at a corner of the ring.
    fn turn(&self, corner: u32) -> f64 {
        let [before, after] = self.ring[corner as usize];
        self.cross(before, corner, after)
    }

    fn cross(&self, a: u32, b: u32, c: u32) -> f64 {
        let [a, b, c] = [a, b, c].map(|i| self.flat[i as usize]);
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    }

    fn cut_ears(&mut self, corners: u32) -> Result<(), TooComplex> {
        let (mut left, mut corner, mut failed) = (corners, 0, 0);
        while left > 3 {
            if self.is_ear(corner)? {
                let after = self.cut(corner);
                (left, corner, failed) = (left - 1, self.ring[after as usize][1], 0);
                continue;
            }
            (corner, failed) = (self.ring[corner as usize][1], failed + 1);
            if failed < left {
                continue;
            }
            let straight = self.corners_from(corner, left).find(|&i| self.turn(i) == 0.0);
            let Some(straight) = straight else {
                self.intersecting += 1;
                break;
            };
            (left, corner, failed) = (left - 1, self.cut(straight), 0);
        }
        let second = self.ring[corner as usize][1];
        let mut at = second;
        for _ in 2..left {
            let next = self.ring[at as usize][1];
            self.triangles.push([corner, at, next]);
            at = next;
        }
        Ok(())
    }

    /// The corners left, from one on.
    fn corners_from(&self, first: u32, left: u32) -> impl Iterator<Item = u32> {
        std::iter::successors(Some(first), |&i| Some(self.ring[i as usize][1])).take(left as usize)
    }

    /// Makes a triangle of a corner and its neighbours and removes it from the ring; returns the next corner.
    fn cut(&mut self, corner: u32) -> u32 {
        let [before, after] = self.ring[corner as usize];
        self.triangles.push([before, corner, after]);
        self.ring[before as usize][1] = after;
        self.ring[after as usize][0] = before;
        self.ring[corner as usize] = [corner; 2];
        after
    }

    fn is_cut(&self, corner: u32) -> bool {
        self.ring[corner as usize][0] == corner
    }

    fn is_ear(&mut self, b: u32) -> Result<bool, TooComplex> {
        if self.turn(b) <= 0.0 {
            return Ok(false);
        }
        let [a, c] = self.ring[b as usize];
        let places = [a, b, c].map(|i| self.flat[i as usize]);
        let is_inside = |i: u32| {
            [(a, b), (b, c), (c, a)].iter().all(|&(from, to)| self.cross(from, to, i) >= 0.0)
                && !places.contains(&self.flat[i as usize])
        };
        let blocks = |i: u32| is_inside(i) && !self.is_cut(i) && self.turn(i) <= 0.0;
        let blocking = self.reflex.iter().position(|&i| blocks(i));
        self.tests += blocking.map_or(self.reflex.len(), |at| at + 1) as u64;
        if self.tests > MAX_TESTS {
            return Err(TooComplex);
        }
        if blocking.is_none() {
            let ring = &self.ring;
            self.reflex.retain(|&i| ring[i as usize][0] != i);
        }
        Ok(blocking.is_none())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles of a flat polygon, mapped into space by `place`.
    fn divided(corners: &[[f64; 2]], place: impl Fn([f64; 2]) -> [f64; 3]) -> (Vec<[u32; 3]>, u64) {
        let mut triangulator = Triangulator::default();
        let count = u32::try_from(corners.len()).unwrap();
        let triangles = triangulator.divide(count, |i| place(corners[i as usize])).unwrap().to_vec();
        (triangles, triangulator.intersecting)
    }

    fn area(corners: &[[f64; 2]], [a, b, c]: [u32; 3]) -> f64 {
        let [a, b, c] = [a, b, c].map(|i| corners[i as usize]);
        ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0
    }

    /// Checks that the triangles of a simple polygon tile it: all positive, and the areas add up.
    fn check_tiling(corners: &[[f64; 2]], triangles: &[[u32; 3]]) {
        assert_eq!(triangles.len(), corners.len() - 2);
        let mut polygon = 0.0;
        for (i, a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            polygon += (a[0] * b[1] - a[1] * b[0]) / 2.0;
        }
        let areas: Vec<f64> = triangles.iter().map(|&t| area(corners, t)).collect();
        assert!(areas.iter().all(|&a| a >= 0.0), "{areas:?}");
        let sum: f64 = areas.iter().sum();
        assert!((sum - polygon).abs() <= 1e-12 * polygon, "{sum} {polygon}");
    }

    const ARROW: [[f64; 2]; 4] = [[0.0, 0.0], [4.0, 1.0], [0.0, 2.0], [1.0, 1.0]];

    #[test]
    fn convex_polygon_is_a_fan() {
        let square = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [2.0, 2.0], [0.0, 2.0]];
        let (triangles, _) = divided(&square, |[x, y]| [x, y, 0.0]);
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
        assert_eq!(divided(&square[..3], |[x, y]| [x, y, 0.0]).0, [[0, 1, 2]]);
        assert!(divided(&square[..2], |[x, y]| [x, y, 0.0]).0.is_empty());
    }

    #[test]
    fn concave_quad_is_divided_at_its_reflex_corner_from_every_start_and_in_every_plane() {
        let places: [fn([f64; 2]) -> [f64; 3]; 5] = [
            |[x, y]| [x, y, 5.0],
            |[x, y]| [7.0, x, y],
            |[x, y]| [y, 1e6, x],
            |[x, y]| [y, x, 0.0],
            |[x, y]| [x + y, 3.0 * x - y, x - 2.0 * y],
        ];
        for start in 0..4 {
            let mut corners = ARROW;
            corners.rotate_left(start);
            for place in places {
                let (triangles, intersecting) = divided(&corners, place);
                check_tiling(&corners, &triangles);
                assert_eq!(intersecting, 0);
            }
            let fan = [[0, 1, 2], [0, 2, 3]];
            assert_eq!(fan.iter().all(|&t| area(&corners, t) >= 0.0), start % 2 == 1);
        }
    }

    #[test]
    fn clockwise_polygon_keeps_its_orientation() {
        let mut corners = ARROW;
        corners.reverse();
        let (triangles, _) = divided(&corners, |[x, y]| [x, y, 0.0]);
        assert!(triangles.iter().all(|&t| area(&corners, t) <= 0.0));
        assert_eq!(triangles.iter().map(|&t| area(&corners, t)).sum::<f64>(), -3.0);
    }

    #[test]
    fn combs_spirals_and_random_stars_are_tiled() {
        let mut comb = Vec::new();
        for k in 0..200 {
            comb.push([f64::from(k), if k % 2 == 0 { 0.0 } else { 9.0 }]);
        }
        comb.extend([[199.0, 10.0], [0.0, 10.0]]);
        check_tiling(&comb, &divided(&comb, |[x, y]| [x, y, 0.0]).0);

        let arm = |k: i32, width: f64| {
            let (angle, radius) = (f64::from(k) * 0.1, 1.0 + f64::from(k) * 0.01 + width);
            [radius * angle.cos(), radius * angle.sin()]
        };
        let mut spiral: Vec<_> = (0..400).map(|k| arm(k, 0.3)).collect();
        spiral.extend((0..400).rev().map(|k| arm(k, 0.0)));
        check_tiling(&spiral, &divided(&spiral, |[x, y]| [0.0, x, y]).0);

        let mut seed = 1u32;
        for corners in [5, 17, 300] {
            let star: Vec<_> = (0..corners)
                .map(|k| {
                    seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    let (angle, radius) =
                        (f64::from(k) / f64::from(corners) * std::f64::consts::TAU, f64::from(seed >> 16));
                    [radius * angle.cos(), radius * angle.sin()]
                })
                .collect();
            let (triangles, intersecting) = divided(&star, |[x, y]| [x, y, 0.0]);
            assert_eq!(intersecting, 0);
            check_tiling(&star, &triangles);
        }
    }

    #[test]
    fn straight_and_repeated_corners_of_a_concave_polygon_are_kept() {
        // An L with a corner in the middle of each edge, one of them twice.
        let corners = [
            [0.0, 0.0],
            [1.0, 0.0],
            [2.0, 0.0],
            [2.0, 0.5],
            [2.0, 1.0],
            [1.0, 1.0],
            [1.0, 1.5],
            [1.0, 1.5],
            [1.0, 2.0],
            [0.0, 2.0],
            [0.0, 1.0],
        ];
        check_tiling(&corners, &divided(&corners, |[x, y]| [x, y, 0.0]).0);
    }

    #[test]
    fn hole_with_a_bridge_is_tiled() {
        let corners = [
            [0.0, 0.0],
            [4.0, 0.0],
            [4.0, 4.0],
            [0.0, 4.0],
            [0.0, 0.0],
            [1.0, 1.0],
            [1.0, 3.0],
            [3.0, 3.0],
            [3.0, 1.0],
            [1.0, 1.0],
        ];
        let (triangles, intersecting) = divided(&corners, |[x, y]| [x, y, 0.0]);
        assert_eq!(intersecting, 0);
        check_tiling(&corners, &triangles);
    }

    #[test]
    fn polygon_that_intersects_itself_is_counted_and_degenerate_ones_are_fans() {
        let bow = [[0.0, 0.0], [3.0, 1.0], [3.0, 0.0], [0.0, 2.0], [-1.0, 1.0]];
        let (triangles, _) = divided(&bow, |[x, y]| [x, y, 0.0]);
        assert_eq!(triangles.len(), 3);
        let star: Vec<_> =
            (0..5).map(|k| f64::from(k) * 0.8 * std::f64::consts::PI).map(|a| [a.cos(), a.sin()]).collect();
        assert_eq!(divided(&star, |[x, y]| [x, y, 0.0]).0.len(), 3);
        let line = [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.5, 0.5]];
        assert_eq!(divided(&line, |[x, y]| [x, y, 0.0]).0, [[0, 1, 2], [0, 2, 3]]);
        let huge = [[0.0, 0.0], [1e308, -1e308], [-1e308, 1e308], [1e308, 1e308]];
        assert_eq!(divided(&huge, |[x, y]| [x, y, x]).0.len(), 2);
    }

    #[test]
    fn polygon_with_too_many_corners_is_an_error_within_seconds() {
        let count = 200_000;
        let comb = |i: u32| match i {
            i if i < count => [f64::from(i), if i % 2 == 0 { 0.0 } else { 9.0 }, 0.0],
            i if i == count => [f64::from(count), 10.0, 0.0],
            _ => [0.0, 10.0, 0.0],
        };
        let mut triangulator = Triangulator { tests: MAX_TESTS - 1000, ..Triangulator::default() };
        assert_eq!(triangulator.divide(count + 2, comb), Err(TooComplex));
    }
}
