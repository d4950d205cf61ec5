//! Time to read a mesh of 1 M triangles: `cargo test --release read_speed -- --ignored --nocapture`.

use std::time::Instant;

use serde_json::json;

use super::file::{FLOAT, File, UNSIGNED_INT, f32_bytes, u32_bytes};

/// Vertices a side of a square net.
const SIDE: u32 = 708;

#[test]
#[ignore = "measurement: run alone, in release, with --nocapture"]
fn read_speed() {
    let mut file = File::empty();
    let places = || (0..SIDE * SIDE).map(|k| ((k % SIDE) as f32 / 100.0, (k / SIDE) as f32 / 100.0));
    let positions: Vec<f32> = places().flat_map(|(x, y)| [x, y, x.sin() * y.cos()]).collect();
    let texcoords: Vec<f32> = places().flat_map(|(x, y)| [x, y]).collect();
    let quads = (0..(SIDE - 1) * (SIDE - 1)).map(|k| k / (SIDE - 1) * SIDE + k % (SIDE - 1));
    let indices: Vec<u32> = quads.flat_map(|q| [q, q + 1, q + SIDE + 1, q, q + SIDE + 1, q + SIDE]).collect();
    let vertices = positions.len() / 3;
    let position = file.accessor(FLOAT, "VEC3", vertices, &f32_bytes(&positions));
    let normal = file.accessor(FLOAT, "VEC3", vertices, &f32_bytes(&positions));
    let texcoord = file.accessor(FLOAT, "VEC2", vertices, &f32_bytes(&texcoords));
    let index = file.accessor(UNSIGNED_INT, "SCALAR", indices.len(), &u32_bytes(&indices));
    let attributes = json!({"POSITION": position, "NORMAL": normal, "TEXCOORD_0": texcoord});
    let picture = file.view(&super::file::png(1, 1, png::ColorType::Rgb, &[1, 2, 3]));
    file.json["images"] = json!([{"bufferView": picture}]);
    file.json["textures"] = json!([{"source": 0}]);
    file.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    file.json["meshes"] =
        json!([{"primitives": [{"attributes": attributes, "indices": index, "material": 0}]}]);
    file.json["nodes"] = json!([{"mesh": 0}]);
    let (_folder, path) = super::saved(&file.glb());
    for _ in 0..5 {
        let start = Instant::now();
        let (scene, _) = super::read_gltf(&path, &super::Limits::of_memory(1 << 30)).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        let triangles = scene.parts[0].geometry.triangles.len();
        println!("{triangles} triangles, {vertices} vertices, {} bytes: {seconds:.3} s", file.buffer.len());
        assert_eq!((triangles, scene.parts[0].geometry.texcoords[0].len()), (indices.len() / 3, vertices));
    }
}
