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

use crate::mesh_name::{EXTENSIONS, extension};
use pipeline::scene::description::Scene;

pub use error::MeshError;
pub use gltf::read_gltf;
pub use limits::Limits;
pub use obj::read_obj;
pub use ply::read_ply;
pub use source::SourceFile;

/// Reads a mesh.
type Read = fn(&Path, &Limits) -> Result<(Scene, Vec<SourceFile>), MeshError>;

/// Readers, by the extensions of names.
const READERS: [Read; EXTENSIONS.len()] = [read_gltf, read_gltf, read_obj, read_ply];

/// Whether the name of `path` is that of a glTF file, which is in metres with +Y up.
pub fn is_gltf(path: &Path) -> bool {
    matches!(&*extension(path), "glb" | "gltf")
}

/// Reads the scene of the mesh `path`, and lists the files it consists of, this one first.
///
/// # Errors
/// See [`MeshError`].
pub fn read(path: &Path, limits: &Limits) -> Result<(Scene, Vec<SourceFile>), MeshError> {
    let extension = extension(path);
    let unsupported = |found: String, way_out: String| {
        Err(MeshError::Unsupported { path: path.into(), place: "its name".into(), found, way_out })
    };
    let Some(number) = EXTENSIONS.iter().position(|name| *name == extension) else {
        let found = match &*extension {
            "" => "a name without extension".into(),
            extension => format!(".{extension}"),
        };
        return unsupported(found, "convert it to .glb, .gltf, .obj or .ply".into());
    };
    match source::signature(path) {
        Some(other) if other != extension && !(other == "glb" && is_gltf(path)) => {
            unsupported(format!(".{extension} for content of .{other}"), format!("rename it to .{other}"))
        }
        _ => READERS[number](path, limits),
    }
}
