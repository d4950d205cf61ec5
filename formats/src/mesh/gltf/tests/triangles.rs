//! Modes of primitives, indices and vertices.

use serde_json::json;

use super::file::{FLOAT, File, UNSIGNED_BYTE, UNSIGNED_SHORT, f32_bytes, u16_bytes};
use super::{error, positions, scene};

/// Five vertices in a row, drawn in a mode.
fn five(mode: u64) -> File {
    let mut file = File::triangle();
    let many: Vec<f32> = (0..15).map(|k| k as f32).collect();
    let position = file.accessor(FLOAT, "VEC3", 5, &f32_bytes(&many));
    *file.primitive() = json!({"attributes": {"POSITION": position}, "mode": mode});
    file
}

#[test]
fn strips_and_fans() {
    assert_eq!(scene(&five(5)).parts[0].geometry.triangles, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]);
    assert_eq!(scene(&five(6)).parts[0].geometry.triangles, [[1, 2, 0], [2, 3, 0], [3, 4, 0]]);
    let read = scene(&five(4));
    assert_eq!(read.parts[0].geometry.triangles, [[0, 1, 2]]);
    let note = "1 primitive with an incomplete triangle at the end read without it".to_owned();
    assert!(read.notes.contains(&note), "{:?}", read.notes);
    let mut file = five(5);
    let indices = file.accessor(UNSIGNED_BYTE, "SCALAR", 5, &[4, 3, 2, 1, 0]);
    file.primitive()["indices"] = json!(indices);
    assert_eq!(scene(&file).parts[0].geometry.triangles, [[4, 3, 2], [3, 1, 2], [2, 1, 0]]);
}

#[test]
fn points_and_lines_are_counted() {
    let mut file = File::triangle();
    for mode in [0, 1, 2, 3] {
        let primitive = json!({"attributes": {"POSITION": 0}, "mode": mode});
        file.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(primitive);
    }
    // A second instance does not count them again.
    file.json["nodes"] = json!([{"mesh": 0}, {"mesh": 0}]);
    file.json["scenes"][0]["nodes"] = json!([0, 1]);
    let read = scene(&file);
    assert_eq!(read.parts.len(), 2);
    assert_eq!(&read.notes[1..], ["1 primitive of points ignored", "3 primitives of lines ignored"]);
    assert!(std::sync::Arc::ptr_eq(&read.parts[0].geometry, &read.parts[1].geometry));
    let mut file = five(1);
    let expected = ": no triangles: found 1 scene, 1 node, 1 mesh, 1 primitive, 1 primitive of lines ignored";
    assert_eq!(error(&file), expected);
    file.primitive()["mode"] = json!(7);
    assert_eq!(error(&file), ", meshes[0].primitives[0].mode: expected 0 to 6, found 7");
}

#[test]
fn index_beyond_the_vertices() {
    let mut file = File::triangle();
    file.json["meshes"][0]["name"] = json!("Cup");
    let indices = file.accessor(UNSIGNED_SHORT, "SCALAR", 6, &u16_bytes(&[0, 1, 2, 0, 1, 3]));
    file.primitive()["indices"] = json!(indices);
    let expected = ", meshes[0] (\"Cup\").primitives[0].indices[5]: expected a vertex below 3 (accessors[1]), found vertex 3";
    assert_eq!(error(&file), expected);
}

#[test]
fn restart_is_an_error() {
    let mut file = File::triangle();
    let position = file.accessor(FLOAT, "VEC3", 256, &f32_bytes(&[0.5; 768]));
    let indices = file.accessor(UNSIGNED_BYTE, "SCALAR", 3, &[0, 1, 255]);
    *file.primitive() = json!({"attributes": {"POSITION": position}, "indices": indices, "mode": 5});
    let expected = ", meshes[0].primitives[0].indices[2]: expected a vertex below 255, which restarts primitives, found vertex 255";
    assert_eq!(error(&file), expected);
}

#[test]
fn not_finite_vertices() {
    for (value, shown) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf")] {
        let mut file = File::triangle();
        file.buffer[16..20].copy_from_slice(&value.to_le_bytes());
        let expected = format!(
            ", meshes[0].primitives[0].attributes.POSITION, vertex 1: expected finite numbers, found [1.0, {shown}, 0.0]"
        );
        assert_eq!(error(&file), expected);
        for (name, kind, n) in [("NORMAL", "VEC3", 9), ("COLOR_0", "VEC4", 12)] {
            let mut file = File::triangle();
            let mut values = vec![0.5; n];
            values[n - 1] = value;
            let accessor = file.accessor(FLOAT, kind, 3, &f32_bytes(&values));
            file.primitive()["attributes"][name] = json!(accessor);
            assert!(
                error(&file).contains(&format!("{name}, vertex 2: expected finite numbers")),
                "{}",
                error(&file)
            );
        }
    }
}

#[test]
fn attributes_of_other_lengths() {
    let mut file = File::triangle();
    let normal = file.accessor(FLOAT, "VEC3", 2, &f32_bytes(&[0.; 6]));
    file.primitive()["attributes"]["NORMAL"] = json!(normal);
    let expected = ", meshes[0].primitives[0].attributes.NORMAL: expected 3 elements, as POSITION, found 2 (accessors[1])";
    assert_eq!(error(&file), expected);
}

#[test]
fn morph_targets_are_noted() {
    let mut file = File::triangle();
    file.primitive()["targets"] = json!([{"POSITION": 0}]);
    let read = scene(&file);
    assert_eq!(positions(&read.parts[0].geometry)[1], [1., 0., 0.]);
    assert!(read.notes.contains(&"1 primitive with morph targets read without them".into()));
}

#[test]
fn too_many_triangles_in_instances() {
    // 2^20 triangles of one vertex, 4097 instances: the 1366th is beyond (2^32 - 1)/3.
    let mut file = File::triangle();
    let count = 3 << 20;
    let indices =
        file.push("accessors", json!({"componentType": UNSIGNED_BYTE, "type": "SCALAR", "count": count}));
    file.primitive()["indices"] = json!(indices);
    file.json["nodes"] = json!(vec![json!({"mesh": 0}); 4097]);
    file.json["scenes"][0]["nodes"] = json!((0..4097).collect::<Vec<_>>());
    let bytes = file.glb();
    let (_folder, path) = super::saved(&bytes);
    let limits = super::Limits::of_memory(1 << 30);
    let error = super::read_gltf(&path, &limits).err().unwrap().to_string();
    let expected = "nodes[1365], meshes[0].primitives[0]: expected at most 1431655765 triangles in all instances, found 1432354816 with this one";
    assert!(error.ends_with(expected), "{error}");
}
