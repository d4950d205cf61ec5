//! Meshes: damaged .glb, .obj with its materials, and .ply are scenes, or errors of one line.

use crate::directory;
use crate::fuzz_support::{Random, damage, damage_text, fuzz};
use lenscube_formats::mesh::{Limits, read};
use std::cell::RefCell;
use std::fs;

const OBJ: &str = "mtllib a.mtl\no one\nv 0 0 -1 1 0 0\nv 1 0 -1\nv 0 1 -1\nv 1 1 -2\nvt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nusemtl red\n\
                   f 1/1/1 2/2/1 3/3/1\nusemtl blue\ng side\nf -1 -2 -3\nf 1 2 4 3\nl 1 2\n";
const MTL: &str = "newmtl red\nKd 0.5 0 0\nd 0.5\nnewmtl blue\nKd 0 0 1\nKe 1 1 1\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty double z\nproperty uchar red\n\
                   property uchar green\nproperty uchar blue\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n\
                   0 0 -1 255 0 0\n1 0 -1 0 255 0\n0 1 -1 0 0 255\n1 1 -2 1 2 3\n3 0 1 2\n4 0 1 3 2\n";
const GLTF: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0,1]}],
"nodes":[{"mesh":0,"matrix":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,-1,1]},{"camera":0,"translation":[0,0,1]}],
"cameras":[{"type":"perspective","perspective":{"yfov":0.5,"znear":0.1}}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"material":0}]}],
"materials":[{"pbrMetallicRoughness":{"baseColorFactor":[0.5,0.25,1,1]},"alphaMode":"MASK","alphaCutoff":0.5}],
"buffers":[{"byteLength":42}],"bufferViews":[{"buffer":0,"byteLength":36},{"buffer":0,"byteOffset":36,"byteLength":6}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]},
{"bufferView":1,"componentType":5123,"count":3,"type":"SCALAR"}]}"#;

/// The document and a triangle as a .glb.
fn glb(json: &[u8]) -> Vec<u8> {
    let mut json = json.to_vec();
    json.resize(json.len().next_multiple_of(4), b' ');
    let corners: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    let mut binary: Vec<u8> = corners.iter().flat_map(|v| v.to_le_bytes()).collect();
    binary.extend([0u16, 1, 2].iter().flat_map(|v| v.to_le_bytes()));
    binary.resize(44, 0);
    let length = |n: usize| u32::try_from(n).unwrap().to_le_bytes();
    let mut all = [&b"glTF"[..], &length(2), &length(12 + 8 + json.len() + 8 + binary.len())].concat();
    all.extend([&length(json.len())[..], b"JSON", &json, &length(binary.len()), b"BIN\0", &binary].concat());
    all
}

#[test]
fn damaged_meshes_are_scenes_or_errors() {
    let dir = directory();
    let at = |name: &str| dir.path().join(name);
    let originals = [
        ("a.obj", "a.obj", OBJ.as_bytes().to_vec()),
        ("a.mtl", "a.obj", MTL.as_bytes().to_vec()),
        ("a.ply", "a.ply", PLY.as_bytes().to_vec()),
        ("a.glb", "a.glb", glb(GLTF.as_bytes())),
    ];
    originals.iter().for_each(|(name, _, bytes)| fs::write(at(name), bytes).unwrap());
    let limits = Limits::of_memory(16 << 20);
    for mesh in ["a.obj", "a.ply", "a.glb"] {
        assert!(!read(&at(mesh), &limits).unwrap().0.parts.is_empty(), "{mesh}");
    }
    let current = RefCell::new(0);
    let make = |r: &mut Random| {
        let number = r.below(originals.len());
        *current.borrow_mut() = number;
        let mut bytes = originals[number].2.clone();
        match (originals[number].0, r.below(3)) {
            (_, 0) => damage(&mut bytes, r),
            // Damaged text within an intact container.
            ("a.glb", _) => {
                let mut json = GLTF.as_bytes().to_vec();
                damage_text(&mut json, r);
                bytes = glb(&json);
            }
            _ => damage_text(&mut bytes, r),
        }
        bytes
    };
    fuzz("mesh", 3000, make, |bytes| {
        let (name, mesh, original) = &originals[*current.borrow()];
        fs::write(at(name), bytes).unwrap();
        let found = read(&at(mesh), &limits);
        fs::write(at(name), original).unwrap();
        match found {
            Ok((scene, _)) => {
                assert!(
                    scene.parts.iter().all(|part| !part.geometry.triangles.is_empty()),
                    "a part without triangles"
                );
                true
            }
            Err(e) => {
                assert!(!e.to_string().contains('\n'), "an error of several lines");
                false
            }
        }
    });
}
