//! Meshes for tests: parts of triangles in the camera frame, which is that of the file.

use super::description::{Geometry, Material, Part, Positions};
use super::light::shadow::Triangles;
use super::pose::Pose;
use std::sync::Arc;

/// The camera frame is the file's.
pub const POSE: Pose =
    Pose { eye: [0.0; 3], right: [1.0, 0.0, 0.0], down: [0.0, 1.0, 0.0], forward: [0.0, 0.0, 1.0] };

pub const IDENTITY: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

/// Parts, and what they are in the camera frame.
#[derive(Default)]
pub struct TestMesh {
    pub parts: Vec<Part>,
    corners: Vec<[[f64; 3]; 3]>,
    part_of: Vec<(usize, usize)>,
}

impl TestMesh {
    /// With another part.
    pub fn with(mut self, material: usize, geometry: Geometry) -> Self {
        let Positions::F32(positions) = &geometry.positions else { panic!("positions are f32") };
        for (i, t) in geometry.triangles.iter().enumerate() {
            self.corners.push(t.map(|v| positions[v as usize].map(f64::from)));
            self.part_of.push((self.parts.len(), i));
        }
        let name = format!("part {}", self.parts.len());
        self.parts.push(Part { name, node: 0, to_world: IDENTITY, geometry: Arc::new(geometry), material });
        self
    }
}

impl Triangles for TestMesh {
    fn triangles(&self) -> u32 {
        self.corners.len() as u32
    }

    fn corners(&self, triangle: u32) -> [[f64; 3]; 3] {
        self.corners[triangle as usize]
    }

    fn part_of(&self, triangle: u32) -> (usize, usize) {
        self.part_of[triangle as usize]
    }
}

/// The parallelogram o, o + u, o + u + v, o + v, with texture coordinates (0, 0), (1, 0), (1, 1), (0, 1).
pub fn quad(o: [f32; 3], u: [f32; 3], v: [f32; 3]) -> Geometry {
    let at = |a: f32, b: f32| std::array::from_fn(|k| o[k] + a * u[k] + b * v[k]);
    let texcoords = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    Geometry {
        positions: Positions::F32(texcoords.iter().map(|&[a, b]| at(a, b)).collect()),
        triangles: vec![[0, 1, 2], [0, 2, 3]].into(),
        texcoords: vec![texcoords.into()],
        ..Geometry::default()
    }
}

/// A wall at distance z across the axis.
pub fn wall(z: f32, half: f32) -> Geometry {
    quad([-half, -half, z], [2.0 * half, 0.0, 0.0], [0.0, 2.0 * half, 0.0])
}

/// A material of this linear colour.
pub fn material(name: &str, colour: [f32; 3]) -> Material {
    Material::matt(name.into(), colour)
}

/// Pseudo-random numbers 0…1 (SplitMix64).
pub struct Random(pub u64);

impl Random {
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}
