//! OBJ and MTL files made here.

mod geometry;
mod materials;
mod statements;
mod textures;

use crate::mesh::{Limits, MeshError, SourceFile, read_obj};
use pipeline::scene::description::{AlphaMode, Scene};
use std::path::PathBuf;

/// A folder with files; the first is the mesh.
struct Files(tempfile::TempDir);

const MESH: &str = "mesh.obj";
const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

impl Files {
    fn new(mesh: impl AsRef<[u8]>) -> Self {
        Self(tempfile::tempdir().unwrap()).with(MESH, mesh)
    }

    fn with(self, name: &str, bytes: impl AsRef<[u8]>) -> Self {
        std::fs::write(self.path(name), bytes).unwrap();
        self
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn limits() -> Limits {
        Limits::of_memory(1 << 24)
    }

    fn read_with(&self, limits: &Limits) -> Result<(Scene, Vec<SourceFile>), MeshError> {
        read_obj(&self.path(MESH), limits)
    }

    fn scene(&self) -> Scene {
        self.read_with(&Self::limits()).unwrap().0
    }

    /// The message of the error, without the folder.
    fn error(&self) -> String {
        let message = self.read_with(&Self::limits()).map(drop).unwrap_err().to_string();
        message.replace(&format!("{}/", self.0.path().display()), "")
    }
}

/// A mesh of one material `m` of these statements.
fn with_material(statements: &str) -> Files {
    let mesh = format!("mtllib a.mtl\nusemtl m\n{TRIANGLE}vt 0 0\nf 1/1 2/1 3/1\n");
    Files::new(mesh).with("a.mtl", format!("newmtl m\n{statements}\n"))
}
