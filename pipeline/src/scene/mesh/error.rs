//! Meshes that cannot be drawn.

use crate::scratch::ScratchError;
use std::fmt;

/// Why there is no mesh.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum MeshError {
    /// No triangle has three different corners.
    NoTriangles {
        /// Triangles with two equal corners.
        degenerate: usize,
    },
    /// All triangles lie behind the camera.
    NothingInFront {
        /// Their number.
        triangles: usize,
    },
    /// More than numbers of 32 bits can address.
    TooMany {
        /// Triangles of all instances.
        triangles: u64,
        /// Vertices of all instances.
        vertices: u64,
    },
    /// A coordinate is NaN or infinite, in the file or in the camera frame.
    NotFinite {
        /// Name of the part.
        name: String,
        /// Number of the vertex in the part.
        vertex: usize,
    },
    /// A triangle has a vertex that does not exist.
    NoVertex {
        /// Name of the part.
        name: String,
        /// Number of the triangle in the part.
        triangle: usize,
        /// The vertex.
        vertex: u32,
        /// Vertices of the part.
        vertices: usize,
    },
    /// A part has a material that does not exist.
    NoMaterial {
        /// Name of the part.
        name: String,
        /// The material.
        material: usize,
        /// Materials of the scene.
        materials: usize,
    },
    /// There is no disk space for what does not fit into memory.
    Scratch(ScratchError),
}

impl From<ScratchError> for MeshError {
    fn from(e: ScratchError) -> Self {
        Self::Scratch(e)
    }
}

impl fmt::Display for MeshError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoTriangles { degenerate: 0 } => f.write_str("the scene has no triangles"),
            Self::NoTriangles { degenerate } => {
                write!(f, "the scene has no triangles but {degenerate} with two equal corners")
            }
            Self::NothingInFront { triangles } => {
                write!(f, "nothing lies before the camera: all {triangles} triangles are behind it")
            }
            Self::TooMany { triangles, vertices } => write!(
                f,
                "{triangles} triangles and {vertices} vertices with all instances; at most {} and {} are possible",
                super::MAX_TRIANGLES,
                u32::MAX - 1
            ),
            Self::NotFinite { name, vertex } => {
                write!(f, "`{name}`: vertex {vertex} has a coordinate that is not a finite number")
            }
            Self::NoVertex { name, triangle, vertex, vertices } => {
                write!(f, "`{name}`: triangle {triangle} has vertex {vertex}, of {vertices} vertices")
            }
            Self::NoMaterial { name, material, materials } => {
                write!(f, "`{name}` has material {material}, of {materials} materials")
            }
            Self::Scratch(e) => e.fmt(f),
        }
    }
}

impl std::error::Error for MeshError {}
