//! Shadow rays: whether a triangle lies between a place and a source.
//!
//! Boxes (f32, eight-wide compressed hierarchy of the crate `obvhs`) find the triangles that a ray may meet; an exact test decides. It is that of
//! visibility, in f64, with all corners minus the start of the ray: e_ij = (v_i × v_j)·d of the three edges have one sign, 0 having the sign of the first
//! component of the normal that is not 0, so that no ray passes between two triangles that share an edge (one that meets a corner to the last bit may).
//! The answer does not depend on the hierarchy if no box is missed: boxes are grown by 24·2⁻²⁴ times the largest coordinate M, which is more than the
//! roundings of a box test as displacements of a plane. Those of the start and of the grown corner are 2⁻²⁴ M each; those of the direction, its product
//! with the unit, inverse, box's origin minus start, that times the inverse, child's corner, their sum, and, when the hierarchy is built, of the child's
//! corner and its limit to 255 steps at most 2⁻²⁴·2M each; in all 20·2⁻²⁴ M.
//!
//! `obvhs` takes 10⁻⁴ for the least distance of a box. Distances are therefore counted in units of 1000 times the growth: a triangle's grown box ends more
//! than a tenth of the growth behind the place where the ray meets the triangle.

mod hierarchy;

use super::ShadowRay;
use crate::scene::mesh::Mesh;
use crate::scene::vector::{cross, dot, scaled};
use hierarchy::{Bounds, build};
use obvhs::cwbvh::CwBvh;
use obvhs::cwbvh::bvh2_to_cwbvh::bvh2_to_cwbvh;
use obvhs::ray::Ray;

/// Growth of boxes on each side, in largest coordinates: 24·2⁻²⁴.
const GROWTH: f32 = 24.0 / (1 << 24) as f32;
/// Length of the hierarchy's unit of distance, in growths.
const UNIT_GROWTHS: f32 = 1000.0;
/// Components of a direction that are smaller count as this: a displacement of 10⁻¹² of a ray's length.
const LEAST_COMPONENT: f32 = 1e-12;
/// Maximum number of triangles: `obvhs` numbers 14 decisions for each in 32 bits.
pub const MAX_TRIANGLES: usize = 1 << 28;
/// Bytes per triangle that building takes: the binary hierarchy 96 and 4, decisions on its nodes 14 × 8, the result 13; before them boxes 24.
pub const BUILD_BYTES_PER_TRIANGLE: usize = 240;

/// Triangles of a mesh in the camera frame, numbered in the order of the file.
pub trait Triangles: Sync {
    /// How many.
    fn triangles(&self) -> u32;
    /// Corners in m, f32 values, in the order of the file.
    fn corners(&self, triangle: u32) -> [[f64; 3]; 3];
    /// Number of the part, and of the triangle in its geometry.
    fn part_of(&self, triangle: u32) -> (usize, usize);
}

impl Triangles for Mesh {
    fn triangles(&self) -> u32 {
        Mesh::triangles(self)
    }

    fn corners(&self, triangle: u32) -> [[f64; 3]; 3] {
        Mesh::corners(self, triangle)
    }

    fn part_of(&self, triangle: u32) -> (usize, usize) {
        Mesh::part_of(self, triangle)
    }
}

/// Triangles that are too many for the hierarchy.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{found} triangles; shadows are limited to {MAX_TRIANGLES}")]
pub struct TooManyTriangles {
    /// How many.
    pub found: usize,
}

/// The hierarchy of boxes.
pub struct Occluders {
    boxes: CwBvh,
    growth: f32,
}

impl Occluders {
    /// Builds it; 0.8 s for 10⁶ triangles.
    ///
    /// # Errors
    /// [`TooManyTriangles`].
    pub fn new(triangles: &impl Triangles) -> Result<Self, TooManyTriangles> {
        let found = triangles.triangles() as usize;
        if found > MAX_TRIANGLES {
            return Err(TooManyTriangles { found });
        }
        // Triangles that are a point, of which files have many, meet no ray.
        let is_point = |t: u32| {
            let [a, b, c] = triangles.corners(t);
            a == b && b == c
        };
        let numbers: Vec<u32> = (0..found as u32).filter(|&t| !is_point(t)).collect();
        let mut largest = 0f32;
        for &t in &numbers {
            largest = triangles.corners(t).iter().flatten().fold(largest, |l, c| l.max(c.abs() as f32));
        }
        // A mesh that is one point at the origin has no size; any growth is right.
        let growth = (largest * GROWTH).max(f32::MIN_POSITIVE * 1e20);
        let boxes: Vec<Bounds> = numbers
            .iter()
            .map(|&t| {
                let corners = triangles.corners(t).map(|c| c.map(|v| v as f32));
                let of = |choose: fn(f32, f32) -> f32, by: f32| {
                    std::array::from_fn(|k| choose(choose(corners[0][k], corners[1][k]), corners[2][k]) + by)
                };
                Bounds { min: of(f32::min, -growth), max: of(f32::max, growth) }
            })
            .collect();
        let mut binary = build(&boxes);
        binary.primitive_indices.iter_mut().for_each(|i| *i = numbers[*i as usize]);
        drop((boxes, numbers));
        let mut boxes = bvh2_to_cwbvh(&binary, 3, true, false);
        boxes.nodes.shrink_to_fit();
        Ok(Self { boxes, growth })
    }

    /// Bytes of the hierarchy.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.boxes.nodes[..]) + size_of_val(&self.boxes.primitive_indices[..])
    }

    /// Whether one of `triangles`, of which this is the hierarchy, blocks the ray. `exists` says of a triangle that the ray meets, and of the barycentric
    /// coordinates, whether there is a surface.
    pub fn is_blocked(
        &self,
        triangles: &impl Triangles,
        ray: &ShadowRay,
        exists: impl Fn(u32, [f64; 3]) -> bool,
    ) -> bool {
        let length = dot(ray.direction, ray.direction).sqrt();
        if !(length > 0.0 && length.is_finite()) || self.boxes.nodes.is_empty() {
            return false;
        }
        let of_boxes = self.ray_of_boxes(ray, length);
        let octant = [0x0404_0404, 0x0202_0202, 0x0101_0101];
        let octant = (0..3).filter(|&k| of_boxes.direction[k] >= 0.0).fold(0, |o, k| o | octant[k]);
        // Groups of eight children: first child, and in the upper byte those still to visit, in the lower the mask of inner nodes.
        let mut rest = Pending::default();
        let (mut first_child, mut children) = (0u32, 0x8000_0000u32);
        loop {
            let slot_bit = highest_bit(children);
            let mask = children;
            children &= !(1 << slot_bit);
            if children & 0xff00_0000 != 0 {
                rest.push((first_child, children));
            }
            let slot = (slot_bit - 24) ^ (octant & 0xff);
            let child = first_child + (mask & !(u32::MAX << slot)).count_ones();
            let node = &self.boxes.nodes[child as usize];
            let hits = node.intersect_ray(&of_boxes, octant);
            let mut leaves = hits & 0x00ff_ffff;
            while leaves != 0 {
                let leaf = highest_bit(leaves);
                leaves &= !(1 << leaf);
                let triangle = self.boxes.primitive_indices[(node.primitive_base_idx + leaf) as usize];
                let met = meets(triangles.corners(triangle), ray);
                if met.is_some_and(|barycentric| exists(triangle, barycentric)) {
                    return true;
                }
            }
            (first_child, children) = (node.child_base_idx, (hits & 0xff00_0000) | u32::from(node.imask));
            if children & 0xff00_0000 == 0 {
                match rest.pop() {
                    Some(next) => (first_child, children) = next,
                    None => return false,
                }
            }
        }
    }

    /// The ray as the boxes are tested with: distances in units of [`UNIT_GROWTHS`] growths.
    fn ray_of_boxes(&self, ray: &ShadowRay, length: f64) -> Ray {
        let unit = UNIT_GROWTHS * self.growth;
        let direction = scaled(ray.direction, 1.0 / length).map(|d| d as f32);
        let direction = direction.map(|d| if d.abs() < LEAST_COMPONENT { LEAST_COMPONENT } else { d });
        let end = (ray.end * length + f64::from(self.growth)) * 1.000_001 / f64::from(unit);
        Ray {
            origin: ray.start.map(|v| v as f32).into(),
            direction: direction.into(),
            inv_direction: direction.map(|d| 1.0 / (d * unit)).into(),
            tmin: 0.0,
            tmax: end as f32,
        }
    }
}

/// Groups of children still to visit: as many as hierarchies usually need without an allocation; degenerate ones are deeper.
#[derive(Default)]
struct Pending {
    usual: [(u32, u32); 32],
    count: usize,
    more: Vec<(u32, u32)>,
}

impl Pending {
    fn push(&mut self, group: (u32, u32)) {
        match self.usual.get_mut(self.count) {
            Some(place) => {
                *place = group;
                self.count += 1;
            }
            None => self.more.push(group),
        }
    }

    fn pop(&mut self) -> Option<(u32, u32)> {
        if let Some(group) = self.more.pop() {
            return Some(group);
        }
        self.count = self.count.checked_sub(1)?;
        Some(self.usual[self.count])
    }
}

fn highest_bit(value: u32) -> u32 {
    31 - value.leading_zeros()
}

/// Barycentric coordinates of the place where the ray meets a triangle, if it does before its end.
fn meets(corners: [[f64; 3]; 3], ray: &ShadowRay) -> Option<[f64; 3]> {
    let d = ray.direction;
    let v: [[f64; 3]; 3] = corners.map(|c| std::array::from_fn(|k| c[k] - ray.start[k]));
    let side = |a: [f64; 3], b: [f64; 3]| {
        let n = cross(a, b);
        let e = dot(n, d);
        let decides = [e, n[0], n[1], n[2]].into_iter().find(|&v| v != 0.0);
        decides.map(|sign| (e, sign > 0.0))
    };
    let (e0, s0) = side(v[1], v[2])?;
    let (e1, s1) = side(v[2], v[0])?;
    if s0 != s1 {
        return None;
    }
    let (e2, s2) = side(v[0], v[1])?;
    if s1 != s2 {
        return None;
    }
    let along = |k: usize, l: usize| std::array::from_fn(|c| v[k][c] - v[l][c]);
    let n = cross(along(1, 0), along(2, 0));
    let at = dot(n, v[0]) / dot(n, d);
    if !(at > 0.0 && at < ray.end && at.is_finite()) {
        return None;
    }
    let sum = e0 + e1 + e2;
    Some(if sum == 0.0 { [1.0 / 3.0; 3] } else { [e0, e1, e2].map(|e| (e / sum).clamp(0.0, 1.0)) })
}

#[cfg(test)]
mod tests;
