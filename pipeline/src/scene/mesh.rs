//! Triangles of a scene in the camera frame.
//!
//! Each vertex is transformed in f64 and rounded to f32 once ([`super::pose`]); all that follows uses these f32 values. Triangles have the
//! numbers of the file's order: parts, then their triangles. Triangles with two equal corners keep their number and are never hit.
//!
//! Which side is the front: corners run counter-clockwise seen from it. y points down and z away from the camera, so the front is seen if
//! N·d < 0, N = (v1 − v0) × (v2 − v0); a part with a mirrored matrix has the opposite sign (glTF 2.0, 3.7.4).
//!
//! Closed components (`solids`) bound a volume; their winding number (`winding`) is 0 unless the camera is in it.
//! Memory: 12 B a vertex, 17 B a triangle, and while it is built 12 B a vertex and 28 B a triangle more; lists beyond memory are in a scratch
//! file ([`crate::scratch`]).

mod error;
mod solids;
mod weld;
mod winding;

pub use error::MeshError;

use super::description::{AlphaMode, Geometry, Material, Part, Positions};
use super::pose::{Pose, to_camera};
use crate::scratch::{List, Scratch, ScratchError};
use rayon::prelude::*;
use solids::Component;

/// Component of a triangle that is not of a solid.
pub const NOT_SOLID: u32 = u32::MAX;

/// Most triangles of a mesh: their corners are numbered with 32 bits.
pub const MAX_TRIANGLES: usize = u32::MAX as usize / 3;

/// Two corners are equal.
const DEGENERATE: u8 = 1;
/// The back is not a surface.
const ONE_SIDED: u8 = 2;
/// The matrix of the part mirrors.
const MIRRORED: u8 = 4;

/// What a mesh makes of a file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshOptions {
    /// Metres per unit of the file.
    pub unit_m: f64,
    /// Whether closed components hide their inside; else all surfaces are open.
    pub solids: bool,
    /// Whether the back of every material is a surface.
    pub two_sided: bool,
}

/// Triangles in the camera frame.
pub struct Mesh {
    vertices: List<[f32; 3]>,
    triangles: List<[u32; 3]>,
    flags: List<u8>,
    solid: List<u32>,
    around_camera: Vec<bool>,
    /// Number of the first triangle of each part.
    first_of_part: Vec<u32>,
    facts: MeshFacts,
    scratch: Scratch,
}

/// Figures of a mesh for logs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeshFacts {
    /// Triangles, degenerate ones included.
    pub triangles: usize,
    /// Triangles with two equal corners.
    pub degenerate: usize,
    /// Closed opaque components.
    pub solids: usize,
    /// Solids that contain the camera.
    pub around_camera: usize,
    /// Other components.
    pub open: usize,
    /// A triangle of the open component with the most triangles, and their number.
    pub largest_open: Option<(u32, usize)>,
    /// Smallest z of the vertices before the camera, m.
    pub nearest_m: f64,
    /// Largest z, m.
    pub farthest_m: f64,
}

impl Mesh {
    /// The triangles of `parts` seen from `pose`, in memory.
    ///
    /// # Errors
    /// [`MeshError`].
    pub fn new(
        parts: &[Part],
        materials: &[Material],
        pose: &Pose,
        options: MeshOptions,
    ) -> Result<Self, MeshError> {
        Self::with_scratch(parts, materials, pose, options, &Scratch::default())
    }

    /// The triangles of `parts` seen from `pose`; lists that do not fit into memory are in the file of `scratch`.
    ///
    /// # Errors
    /// [`MeshError`].
    pub fn with_scratch(
        parts: &[Part],
        materials: &[Material],
        pose: &Pose,
        options: MeshOptions,
        scratch: &Scratch,
    ) -> Result<Self, MeshError> {
        check(parts, materials)?;
        let vertices = transform(parts, pose, options.unit_m, scratch)?;
        let triangles = parts.iter().map(|p| p.geometry.triangles.len()).sum();
        let mut mesh = Self {
            triangles: scratch.zeros(triangles)?,
            flags: scratch.zeros(triangles)?,
            solid: List::default(),
            around_camera: Vec::new(),
            first_of_part: Vec::with_capacity(parts.len()),
            facts: MeshFacts {
                triangles: 0,
                degenerate: 0,
                solids: 0,
                around_camera: 0,
                open: 0,
                largest_open: None,
                nearest_m: f64::INFINITY,
                farthest_m: 0.0,
            },
            vertices,
            scratch: scratch.clone(),
        };
        mesh.collect(parts, materials, options);
        mesh.find_range()?;
        mesh.find_solids(parts, materials, options.solids)?;
        Ok(mesh)
    }

    /// Triangles with the file's numbers, and what is known before their corners are compared.
    fn collect(&mut self, parts: &[Part], materials: &[Material], options: MeshOptions) {
        let (mut first_vertex, mut first) = (0, 0);
        for part in parts {
            self.first_of_part.push(first as u32);
            let one_sided = !(options.two_sided || materials[part.material].two_sided);
            let flags = if one_sided { ONE_SIDED } else { 0 } | if mirrors(part) { MIRRORED } else { 0 };
            let (vertices, of_part) = (&self.vertices[..], &part.geometry.triangles[..]);
            let triangles = &mut self.triangles[first..][..of_part.len()];
            let all = triangles.par_iter_mut().zip(&mut self.flags[first..][..of_part.len()]);
            all.zip(of_part).for_each(|((triangle, of), t)| {
                *triangle = t.map(|v| v + first_vertex);
                let [a, b, c] = triangle.map(|v| vertices[v as usize]);
                *of = if a == b || b == c || c == a { flags | DEGENERATE } else { flags };
            });
            first_vertex += positions(&part.geometry) as u32;
            first += of_part.len();
        }
        self.facts.triangles = self.triangles.len();
        self.facts.degenerate = self.flags.iter().filter(|&&f| f & DEGENERATE != 0).count();
    }

    fn find_range(&mut self) -> Result<(), MeshError> {
        let range = (0..self.triangles.len() as u32).into_par_iter().filter(|&t| !self.is_degenerate(t));
        let (near, far) = range
            .flat_map_iter(|t| self.triangles[t as usize].map(|v| self.vertices[v as usize][2]))
            .filter(|&z| z > 0.0)
            .map(|z| (z, z))
            .reduce(|| (f32::INFINITY, 0.0), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        if far == 0.0 {
            let found = self.facts.triangles - self.facts.degenerate;
            return Err(if found == 0 {
                MeshError::NoTriangles { degenerate: self.facts.degenerate }
            } else {
                MeshError::NothingInFront { triangles: found }
            });
        }
        (self.facts.nearest_m, self.facts.farthest_m) = (f64::from(near), f64::from(far));
        Ok(())
    }

    fn find_solids(
        &mut self,
        parts: &[Part],
        materials: &[Material],
        solids: bool,
    ) -> Result<(), ScratchError> {
        let components = {
            let weld = weld::weld(&self.vertices, &self.scratch)?;
            let (flags, triangles) = (&self.flags[..], &self.triangles[..]);
            // Corners in the order in which they run counter-clockwise; none of degenerate triangles.
            let corners = |t: u32| {
                let flags = flags[t as usize];
                let [a, b, c] = triangles[t as usize].map(|v| weld[v as usize]);
                match (flags & DEGENERATE != 0, flags & MIRRORED != 0) {
                    (true, _) => None,
                    (false, true) => Some([a, c, b]),
                    (false, false) => Some([a, b, c]),
                }
            };
            solids::components(triangles.len() as u32, weld.len(), corners, &self.scratch)?
        };
        let Components { of_triangle, mut is_solid, size, first } = Components::of(components);
        for (part, &start) in parts.iter().zip(&self.first_of_part) {
            if !solids || materials[part.material].alpha_mode != AlphaMode::Opaque {
                for t in start as usize..start as usize + part.geometry.triangles.len() {
                    if of_triangle[t] != NOT_SOLID {
                        is_solid[of_triangle[t] as usize] = false;
                    }
                }
            }
        }
        self.facts.solids = is_solid.iter().filter(|&&s| s).count();
        self.facts.open = is_solid.len() - self.facts.solids;
        let open = (0..is_solid.len()).filter(|&c| !is_solid[c]);
        let largest = open.max_by_key(|&c| (size[c], std::cmp::Reverse(first[c])));
        self.facts.largest_open = largest.map(|c| (first[c], size[c] as usize));
        let mut number = 0;
        let numbers: Vec<u32> = is_solid
            .iter()
            .map(|&s| {
                number += u32::from(s);
                if s { number - 1 } else { NOT_SOLID }
            })
            .collect();
        self.solid = of_triangle;
        self.solid.par_iter_mut().for_each(|c| {
            *c = if *c == NOT_SOLID { NOT_SOLID } else { numbers[*c as usize] };
        });
        self.around_camera = winding::around_camera(self);
        self.facts.around_camera = self.around_camera.iter().filter(|&&a| a).count();
        Ok(())
    }

    /// Number of triangles, degenerate ones included: their numbers are less.
    pub fn triangles(&self) -> u32 {
        self.triangles.len() as u32
    }

    /// Corners of a triangle in the camera frame, m.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [[f64; 3]; 3] {
        self.triangles[triangle as usize].map(|v| self.vertices[v as usize].map(f64::from))
    }

    /// Whether two corners are equal.
    #[inline]
    pub fn is_degenerate(&self, triangle: u32) -> bool {
        self.flags[triangle as usize] & DEGENERATE != 0
    }

    /// Whether the back of the triangle is not a surface.
    #[inline]
    pub fn is_one_sided(&self, triangle: u32) -> bool {
        self.flags[triangle as usize] & ONE_SIDED != 0
    }

    /// Whether corners run clockwise seen from the front.
    #[inline]
    pub fn is_mirrored(&self, triangle: u32) -> bool {
        self.flags[triangle as usize] & MIRRORED != 0
    }

    /// Number of the solid of the triangle, or [`NOT_SOLID`].
    #[inline]
    pub fn solid(&self, triangle: u32) -> u32 {
        self.solid[triangle as usize]
    }

    /// Whether a solid contains the camera.
    #[inline]
    pub fn is_around_camera(&self, solid: u32) -> bool {
        self.around_camera[solid as usize]
    }

    /// Number of the part of a triangle, and the triangle's number in it.
    pub fn part_of(&self, triangle: u32) -> (usize, usize) {
        let part = self.first_of_part.partition_point(|&first| first <= triangle) - 1;
        (part, (triangle - self.first_of_part[part]) as usize)
    }

    /// Bytes in memory of its lists.
    pub fn bytes(&self) -> usize {
        self.vertices.memory_bytes()
            + self.triangles.memory_bytes()
            + self.flags.memory_bytes()
            + self.solid.memory_bytes()
    }

    /// Where its lists are.
    pub fn scratch(&self) -> &Scratch {
        &self.scratch
    }

    /// Figures for logs.
    pub fn facts(&self) -> &MeshFacts {
        &self.facts
    }
}

/// Components by their number.
struct Components {
    of_triangle: List<u32>,
    is_solid: Vec<bool>,
    size: Vec<u32>,
    first: Vec<u32>,
}

impl Components {
    fn of((of_triangle, components): (List<u32>, Vec<Component>)) -> Self {
        let mut size = vec![0; components.len()];
        of_triangle.iter().filter(|&&c| c != NOT_SOLID).for_each(|&c| size[c as usize] += 1);
        let is_solid = components.iter().map(|c| c.is_closed).collect();
        Self { of_triangle, is_solid, size, first: components.iter().map(|c| c.first).collect() }
    }
}

fn positions(geometry: &Geometry) -> usize {
    match &geometry.positions {
        Positions::F32(p) => p.len(),
        Positions::F64(p) => p.len(),
    }
}

/// Whether the matrix of a part mirrors.
fn mirrors(part: &Part) -> bool {
    let m = &part.to_world;
    let minor = |a: usize, b: usize| m[1][a] * m[2][b] - m[1][b] * m[2][a];
    (m[0][0] * minor(1, 2) - m[0][1] * minor(0, 2)) + m[0][2] * minor(0, 1) < 0.0
}

/// Counts and indices of all parts.
fn check(parts: &[Part], materials: &[Material]) -> Result<(), MeshError> {
    let triangles: u64 = parts.iter().map(|p| p.geometry.triangles.len() as u64).sum();
    if triangles == 0 {
        return Err(MeshError::NoTriangles { degenerate: 0 });
    }
    let vertices: u64 = parts.iter().map(|p| positions(&p.geometry) as u64).sum();
    if triangles > MAX_TRIANGLES as u64 || vertices >= u64::from(u32::MAX) {
        return Err(MeshError::TooMany { triangles, vertices });
    }
    for part in parts {
        if part.material >= materials.len() {
            let (name, material, materials) = (part.name.clone(), part.material, materials.len());
            return Err(MeshError::NoMaterial { name, material, materials });
        }
        let vertices = positions(&part.geometry);
        let bad = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= vertices);
        if let Some(triangle) = part.geometry.triangles.par_iter().position_first(bad) {
            let corners = part.geometry.triangles[triangle];
            let vertex = corners.into_iter().find(|&v| v as usize >= vertices).unwrap_or(u32::MAX);
            return Err(MeshError::NoVertex { name: part.name.clone(), triangle, vertex, vertices });
        }
    }
    Ok(())
}

/// All vertices in the camera frame.
fn transform(
    parts: &[Part],
    pose: &Pose,
    unit_m: f64,
    scratch: &Scratch,
) -> Result<List<[f32; 3]>, MeshError> {
    let mut vertices = scratch.zeros(parts.iter().map(|p| positions(&p.geometry)).sum())?;
    let mut rest = &mut vertices[..];
    for part in parts {
        let rows = pose.from_primitive(&part.to_world, unit_m);
        let (of_part, after) = rest.split_at_mut(positions(&part.geometry));
        let all = of_part.par_iter_mut();
        match &part.geometry.positions {
            Positions::F32(p) => {
                all.zip(&p[..]).for_each(|(to, p)| *to = to_camera(&rows, p.map(f64::from)));
            }
            Positions::F64(p) => all.zip(&p[..]).for_each(|(to, p)| *to = to_camera(&rows, *p)),
        }
        let bad = |v: &[f32; 3]| !v.iter().all(|c| c.is_finite());
        if let Some(vertex) = of_part.par_iter().position_first(bad) {
            return Err(MeshError::NotFinite { name: part.name.clone(), vertex });
        }
        rest = after;
    }
    Ok(vertices)
}

#[cfg(test)]
pub(crate) mod tests;
