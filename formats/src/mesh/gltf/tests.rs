//! Files made here are read, and what came out is compared with what was written.

mod accessors;
mod broken;
mod file;
mod graph;
mod materials;
mod pictures;
mod speed;
mod triangles;

use std::path::PathBuf;

use serde_json::json;
use tempfile::TempDir;

use super::super::{Limits, MeshError, SourceFile, read_gltf};
use file::File;
use pipeline::scene::description::{Geometry, Positions, Scene};

/// Memory of a reader in these tests.
const MEMORY_BYTES: u64 = 64 << 20;

fn limits() -> Limits {
    Limits::of_memory(MEMORY_BYTES)
}

/// Writes a file into a new folder.
fn saved(bytes: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mesh.glb");
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn read_bytes(bytes: &[u8]) -> Result<(Scene, Vec<SourceFile>), MeshError> {
    let (_folder, path) = saved(bytes);
    read_gltf(&path, &limits())
}

/// The scene of a file that is valid.
fn scene(file: &File) -> Scene {
    read_bytes(&file.glb()).unwrap().0
}

/// The message of a file that is not.
fn error(file: &File) -> String {
    message(&file.glb())
}

/// The message of bytes that are no valid file, without the name of the file.
fn message(bytes: &[u8]) -> String {
    let error = read_bytes(bytes).err().expect("an error").to_string();
    assert!(!error.contains('\n'), "one line: {error}");
    error.split_once("mesh.glb").expect("the name of the file").1.into()
}

fn positions(geometry: &Geometry) -> &[[f32; 3]] {
    match &geometry.positions {
        Positions::F32(positions) => positions,
        Positions::F64(_) => panic!("positions of glTF are f32"),
    }
}

#[test]
fn text_and_container_give_the_same_scene() {
    let mut file = File::triangle();
    file.json["nodes"][0]["name"] = json!("Wall");
    for bytes in [file.glb(), file.text(), [b"\xef\xbb\xbf", &file.text()[..]].concat()] {
        let (scene, sources) = read_bytes(&bytes).unwrap();
        assert_eq!(scene.parts.len(), 1);
        let part = &scene.parts[0];
        assert_eq!((part.name.as_str(), part.node), ("Wall", 0));
        assert_eq!(positions(&part.geometry), [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]]);
        assert_eq!(part.geometry.triangles, [[0, 1, 2]]);
        assert_eq!(sources.len(), 1);
        assert_eq!((sources[0].bytes, sources[0].blake3), (bytes.len() as u64, blake3::hash(&bytes)));
        assert_eq!(scene.materials[part.material].colour, [0.8; 3]);
        assert_eq!(scene.notes, ["primitives without a material and colours are grey, 0.8"]);
    }
}
