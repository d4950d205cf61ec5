//! Names of meshes.

use std::path::Path;

/// Extensions of the names of meshes: binary glTF, glTF, Wavefront OBJ, PLY.
pub const EXTENSIONS: [&str; 4] = ["glb", "gltf", "obj", "ply"];

/// The extension of `path` in lower case.
pub(crate) fn extension(path: &Path) -> String {
    path.extension().map_or(String::new(), |e| e.to_string_lossy().to_lowercase())
}

/// Whether the name of `path` is that of a mesh.
pub fn is_mesh(path: &Path) -> bool {
    EXTENSIONS.contains(&&*extension(path))
}
