//! A scene as a file describes it: instances of triangle primitives in world coordinates, materials, textures, cameras and lights.
//!
//! Positions are in units of the file: glTF is in metres with +Y up, OBJ and PLY state no unit. Matrices are rows; a column vector
//! (x, y, z, 1) is multiplied from the right. Colours are linear. Readers of files are in the package `formats`.

use crate::scratch::List;
use std::collections::HashSet;
use std::sync::Arc;

/// All that a file describes.
#[derive(Default)]
pub struct Scene {
    /// Instances of primitives, in the order of the file: scene graph depth first, primitives, one instance after another.
    pub parts: Vec<Part>,
    /// Materials; the parts name them by their number.
    pub materials: Vec<Material>,
    /// Textures; the materials name them by their number.
    pub textures: Vec<Texture>,
    /// Cameras.
    pub cameras: Vec<Camera>,
    /// Lights of `KHR_lights_punctual`.
    pub lights: Vec<Light>,
    /// What the file holds and a scene leaves out, one sentence each, without a full stop.
    pub notes: Vec<String>,
}

impl Scene {
    /// Bytes in memory of its geometry, each once, and of its textures.
    pub fn bytes(&self) -> usize {
        let mut counted = HashSet::new();
        let once = self.parts.iter().filter(|part| counted.insert(Arc::as_ptr(&part.geometry)));
        let geometry: usize = once.map(|part| part.geometry.bytes()).sum();
        geometry + self.textures.iter().map(|texture| size_of_val(&texture.texels[..])).sum::<usize>()
    }
}

/// One instance of a primitive.
pub struct Part {
    /// Name of the node (glTF), object or group (OBJ), or of the file.
    pub name: String,
    /// Number of the node, from 0.
    pub node: u32,
    /// From the primitive's coordinates to the file's.
    pub to_world: [[f64; 4]; 4],
    /// Its triangles.
    pub geometry: Arc<Geometry>,
    /// Number of its material.
    pub material: usize,
}

/// Triangles of a primitive.
#[derive(Default)]
pub struct Geometry {
    /// Positions of the vertices.
    pub positions: Positions,
    /// Three vertices a triangle, counter-clockwise seen from the front.
    pub triangles: List<[u32; 3]>,
    /// Sets of texture coordinates, each empty or one pair per vertex.
    pub texcoords: Vec<List<[f32; 2]>>,
    /// Linear colour and alpha of each vertex; empty without.
    pub colours: List<[f32; 4]>,
    /// Normal of each vertex; empty without.
    pub normals: List<[f32; 3]>,
}

/// Positions in the precision of the file.
pub enum Positions {
    /// Of glTF and most PLY files.
    F32(List<[f32; 3]>),
    /// Of OBJ and PLY files with doubles.
    F64(List<[f64; 3]>),
}

impl Geometry {
    /// Bytes in memory of its lists.
    pub fn bytes(&self) -> usize {
        let positions = match &self.positions {
            Positions::F32(all) => all.memory_bytes(),
            Positions::F64(all) => all.memory_bytes(),
        };
        let sets: usize = self.texcoords.iter().map(List::memory_bytes).sum();
        positions
            + sets
            + self.triangles.memory_bytes()
            + self.colours.memory_bytes()
            + self.normals.memory_bytes()
    }
}

impl Default for Positions {
    fn default() -> Self {
        Positions::F32(List::default())
    }
}

/// What a surface looks like.
#[derive(Clone)]
pub struct Material {
    /// Name in the file; empty without.
    pub name: String,
    /// Linear base colour, a factor of the texture's and the vertices'.
    pub colour: [f32; 3],
    /// Opacity, a factor likewise.
    pub alpha: f32,
    /// Texture of colour and alpha.
    pub texture: Option<TextureUse>,
    /// What alpha means.
    pub alpha_mode: AlphaMode,
    /// Whether the back is a surface as well.
    pub two_sided: bool,
    /// Emitted light, linear colour × strength, cd/m² for white.
    pub emission: [f32; 3],
    /// Texture of the emission.
    pub emission_texture: Option<TextureUse>,
}

impl Material {
    /// An opaque one of this linear colour, with two sides, without texture and emission.
    pub fn matt(name: String, colour: [f32; 3]) -> Self {
        Self {
            name,
            colour,
            alpha: 1.0,
            texture: None,
            alpha_mode: AlphaMode::Opaque,
            two_sided: true,
            emission: [0.0; 3],
            emission_texture: None,
        }
    }
}

/// Meaning of a material's alpha.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum AlphaMode {
    /// It is ignored.
    Opaque,
    /// Below the cutoff nothing is there.
    Mask(f32),
    /// It is a share of coverage.
    Blend,
}

/// How a material uses a texture.
#[derive(Clone, PartialEq, Debug)]
pub struct TextureUse {
    /// Number of the texture.
    pub texture: usize,
    /// Set of texture coordinates.
    pub set: usize,
    /// Beyond 0…1, across and down.
    pub wrap: [Wrap; 2],
    /// Nearest texel instead of linear.
    pub nearest: bool,
    /// Rows of the affine map of (u, v, 1) (`KHR_texture_transform`); the identity without.
    pub transform: [[f64; 3]; 2],
}

/// Texture coordinates beyond 0…1.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Wrap {
    /// Repeated.
    Repeat,
    /// Mirrored in turn.
    Mirror,
    /// The edge's.
    Clamp,
}

/// A decoded picture, sRGB coded, row 0 at v = 0, straight alpha.
pub struct Texture {
    /// Name for messages.
    pub name: String,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green, blue, alpha of each texel.
    pub texels: Vec<[u8; 4]>,
}

/// A camera of the file.
pub struct Camera {
    /// Name; `camera N` without one.
    pub name: String,
    /// From the camera's coordinates (looks along −Z, +Y up) to the file's.
    pub to_world: [[f64; 4]; 4],
    /// Vertical field of view in radians; `None` for an orthographic camera.
    pub yfov_rad: Option<f64>,
}

/// A light of the file.
pub struct Light {
    /// Name.
    pub name: String,
    /// From the light's coordinates (shines along −Z) to the file's.
    pub to_world: [[f64; 4]; 4],
    /// Linear colour.
    pub colour: [f32; 3],
    /// lx of a directional light, cd of a point or spot light.
    pub intensity: f64,
    /// Kind.
    pub kind: LightKind,
}

/// Kind of a light.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum LightKind {
    /// Parallel light.
    Directional,
    /// A point; range in m if limited.
    Point(Option<f64>),
    /// A cone: inner and outer half angle in radians, range.
    Spot(f64, f64, Option<f64>),
}
