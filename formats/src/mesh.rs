//! Triangle meshes: a file becomes a [`pipeline::scene::description::Scene`].
//!
//! | module | content |
//! |---|---|
//! | [`mod@gltf`] | glTF 2.0, `.gltf` and `.glb` |
//! | [`mod@obj`] | Wavefront OBJ with its materials (MTL) |
//! | [`mod@ply`] | PLY, ascii and binary |
//!
//! All that a file declares is compared with the bytes it has before memory is allocated.

mod context;
pub mod error;
pub mod gltf;
mod grow;
pub mod limits;
pub mod obj;
mod paths;
pub mod ply;
mod polygon;
mod shown;
pub mod source;
mod text;
mod texture;
mod uri;

use std::path::Path;

use pipeline::scene::description::Scene;

pub use error::MeshError;
pub use gltf::read_gltf;
pub use limits::Limits;
pub use obj::read_obj;
pub use ply::read_ply;
pub use source::SourceFile;

/// Reads a mesh, and its extension.
type Read = fn(&Path, &Limits) -> Result<(Scene, Vec<SourceFile>), MeshError>;

/// Formats by the extension of a file's name.
const FORMATS: [(&str, Read); 4] =
    [("glb", read_gltf), ("gltf", read_gltf), ("obj", read_obj), ("ply", read_ply)];

/// The extension of `path` in lower case.
fn extension(path: &Path) -> String {
    path.extension().map_or(String::new(), |e| e.to_string_lossy().to_lowercase())
}

/// Whether the name of `path` is that of a mesh.
pub fn is_mesh(path: &Path) -> bool {
    FORMATS.iter().any(|(name, _)| *name == extension(path))
}

/// Whether the name of `path` is that of a glTF file, which is in metres with +Y up.
pub fn is_gltf(path: &Path) -> bool {
    matches!(&*extension(path), "glb" | "gltf")
}

/// Reads the scene of the mesh `path`, and lists the files it consists of, this one first.
///
/// # Errors
/// See [`MeshError`].
pub fn read(path: &Path, limits: &Limits) -> Result<(Scene, Vec<SourceFile>), MeshError> {
    match FORMATS.iter().find(|(name, _)| *name == extension(path)) {
        Some((_, read)) => read(path, limits),
        None => Err(MeshError::Unsupported {
            path: path.into(),
            place: "its name".into(),
            found: match &*extension(path) {
                "" => "a name without extension".into(),
                extension => format!(".{extension}"),
            },
            way_out: "convert it to .glb, .gltf, .obj or .ply".into(),
        }),
    }
}
