//! Depth edges of a tile's planes: where one surface ends before another one.
//!
//! Without an edge in reach all parts of the pupil see one surface, whatever slabs it runs through: the correction is then 0 but for the surface's slope,
//! 0.2·|∇ρ| of its contrast at most (slanted planes in f64: 0.0010 at 0.005 px per px, 0.0022 at 0.01). So edges decide which cells are corrected, not which
//! slabs are apart: two surfaces less than a quarter of their blur apart change the film by a tenth of the peak, too.
//!
//! ```text
//! edge    |ρ − ρ'| > 0.01 px of a pixel's first surface and that of a neighbour, or of two surfaces of one pixel of which the first does not cover it
//! reach   an edge of blur ρ = max(|ρ|, |ρ'|) changes film pixels that are not farther in rows and in columns than (max |d_p| + R) |ρ/ρ_w| + 1
//! ```

use super::layer::PRESENT;
use super::shape::Pieces;
use crate::depth::planes::Planes;
use crate::depth::slabs::Slabs;
use crate::geometry::Rect;

/// Blur radii of one surface differ less from pixel to pixel, px.
pub(super) const LEAST_STEP_PX: f32 = 0.01;

/// Edges of the planes of a tile.
#[derive(Debug, Default)]
pub(in crate::depth) struct Edges {
    /// Row and column on the film, larger blur radius of the two surfaces, px.
    edges: Vec<(i32, i32, f32)>,
    /// Of each pixel: blur radius of its first surface, NaN without, and of the last one so far; share that they cover; larger blur radius at an edge, else 0.
    first: Vec<f32>,
    last: Vec<f32>,
    cover: Vec<f32>,
    blur: Vec<f32>,
}

/// Bytes of a pixel of the planes.
pub(in crate::depth) const BYTES_PER_PIXEL: usize = 4 * 4 + 12;

impl Edges {
    /// Finds those of `planes`.
    pub(in crate::depth) fn find(&mut self, slabs: &Slabs, planes: &Planes) {
        let rect = planes.rect.expect("computed before");
        let (n, width) = (rect.size().pixels(), rect.width);
        for (plane, value) in [
            (&mut self.first, f32::NAN),
            (&mut self.last, f32::NAN),
            (&mut self.cover, 0.0),
            (&mut self.blur, 0.0),
        ] {
            plane.clear();
            plane.resize(n, value);
        }
        for slab in planes.slabs.iter().rev() {
            let (low, high) = slabs.ends(slab.slab);
            for (i, a) in (slab.first..).zip(&slab.a) {
                if *a <= 0.0 || self.cover[i] >= 1.0 - PRESENT {
                    continue;
                }
                let rho = slabs.blur_at(low + f64::from(slab.position(i)) * (high - low)) as f32;
                if self.cover[i] == 0.0 {
                    self.first[i] = rho;
                } else if self.last[i] - rho > LEAST_STEP_PX {
                    self.blur[i] = self.blur[i].max(rho.abs()).max(self.last[i].abs());
                }
                self.last[i] = rho;
                self.cover[i] += a;
            }
        }
        let first = &self.first;
        let mut compare = |i: usize, next: usize| {
            let (a, b) = (first[i], first[next]);
            if (a - b).abs() > LEAST_STEP_PX {
                self.blur[i] = self.blur[i].max(a.abs()).max(b.abs());
            }
        };
        for i in 0..n {
            if i % width + 1 < width {
                compare(i, i + 1);
            }
            if i + width < n {
                compare(i, i + width);
            }
        }
        self.edges.clear();
        for (i, blur) in self.blur.iter().enumerate().filter(|(_, blur)| **blur > 0.0) {
            let (y, x) = (rect.y + (i / width) as i64, rect.x + (i % width) as i64);
            self.edges.push((y as i32, x as i32, *blur));
        }
    }

    /// Whether there are none.
    pub(in crate::depth) fn is_empty(&self) -> bool {
        self.edges.is_empty()
    }

    /// Whether `pieces` see one from a pixel of `cell`.
    pub(super) fn reach(&self, cell: Rect, pieces: &Pieces) -> bool {
        let per_px = (pieces.farthest_px() + pieces.radius_px) / pieces.blur_px.abs();
        let beyond =
            |at: i32, first: i64, last: i64| (first - i64::from(at)).max(i64::from(at) - last).max(0);
        self.edges.iter().any(|(y, x, blur)| {
            let (dy, dx) = (beyond(*y, cell.y, cell.bottom() - 1), beyond(*x, cell.x, cell.right() - 1));
            dy.max(dx) as f64 <= f64::from(*blur) * per_px + 1.0
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::planes::SlabPlanes;

    /// Slabs 1/m wide, 10 px of blur each, focus at 0; pixels of `vergence` and share.
    fn edges(rect: Rect, surfaces: &[&dyn Fn(usize) -> (f32, f32)]) -> Vec<(i32, i32, f32)> {
        let slabs = Slabs::new(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 0.0, 10.0);
        let n = rect.size().pixels();
        let mut all: Vec<SlabPlanes> = (0..6).map(|s| SlabPlanes::zeros(None, s, n)).collect();
        for (surface, i) in surfaces.iter().flat_map(|surface| (0..n).map(move |i| (surface, i))) {
            let (v, share) = surface(i % rect.width);
            let s = v as usize;
            (all[s].a[i], all[s].m[i]) = (all[s].a[i] + share, all[s].m[i] + share * (v - s as f32));
        }
        let trimmed = all.iter().filter_map(|slab| slab.trimmed(rect.width)).collect();
        let planes = Planes { rect: Some(rect), slabs: trimmed, uncovered: vec![0.0; n], free: Vec::new() };
        let mut edges = Edges::default();
        edges.find(&slabs, &planes);
        assert_eq!(edges.is_empty(), edges.edges.is_empty());
        edges.edges
    }

    /// A surface that runs through slabs has no edge, with or without another one hidden behind it; a step of 0.2 px has, though its slabs are neighbours.
    #[test]
    fn edges_are_steps_of_the_first_surface() {
        let rect = Rect::new(-2, 3, 3, 20);
        let plane = |x: usize| (2.995 + 0.0009 * x as f32, 1.0);
        assert_eq!(edges(rect, &[&plane]), []);
        assert_eq!(edges(rect, &[&plane, &|x| (if x < 7 { 0.3 } else { 1.9 }, 1.0)]), []);
        let step = |x: usize| (if x < 12 { 2.99 } else { 3.01 }, 1.0);
        let found = edges(rect, &[&step]);
        assert_eq!(found.iter().map(|e| (e.0, e.1)).collect::<Vec<_>>(), [(-2, 14), (-1, 14), (0, 14)]);
        assert!(found.iter().all(|e| (e.2 - 30.1).abs() < 1e-4), "{found:?}");
    }

    #[test]
    fn a_surface_that_does_not_cover_its_pixels_has_edges() {
        let rect = Rect::new(0, 0, 1, 4);
        let found = edges(rect, &[&|_| (4.5, 0.5), &|_| (0.5, 1.0)]);
        assert_eq!(found.iter().map(|e| e.1).collect::<Vec<_>>(), [0, 1, 2, 3]);
        assert!(found.iter().all(|e| (e.2 - 45.0).abs() < 1e-4));
        assert_eq!(edges(rect, &[&|_| (4.5, 0.5)]), []);
    }

    /// A disc of 30 px: edges of the same blur reach as far as its pieces, those of half the blur half as far.
    #[test]
    fn edges_reach_as_far_as_their_blur() {
        let pieces = Pieces {
            pieces: vec![(0.5, (27.0, 3.0)), (0.5, (-20.0, -25.0))],
            radius_px: 4.0,
            blur_px: -30.0,
        };
        let cell = Rect::new(64, 128, 64, 64);
        let of = |y: i32, x: i32, blur: f32| Edges { edges: vec![(y, x, blur)], ..Edges::default() };
        for (y, x, blur, is_in_reach) in [
            (100, 150, 0.5, true),
            (32, 150, 30.0, true),
            (31, 150, 30.0, false),
            (100, 207, 15.0, true),
            (100, 208, 15.0, false),
            (100, 208, 16.0, true),
        ] {
            assert_eq!(of(y, x, blur).reach(cell, &pieces), is_in_reach, "({y}, {x}), blur {blur}");
        }
    }
}
