//! Values of accessors: all component types, normalised, sparse, strided, quantised.

use serde_json::json;

use super::file::{
    BYTE, FLOAT, File, SHORT, UNSIGNED_BYTE, UNSIGNED_INT, UNSIGNED_SHORT, f32_bytes, u16_bytes, u32_bytes,
};
use super::{error, positions, scene};

/// A triangle with an attribute of three elements, in a file that may have quantised ones.
fn with_attribute(name: &str, component: u64, kind: &str, is_normalised: bool, bytes: &[u8]) -> File {
    let mut file = File::triangle();
    let accessor = file.accessor(component, kind, 3, bytes);
    file.json["accessors"][accessor]["normalized"] = json!(is_normalised);
    file.primitive()["attributes"][name] = json!(accessor);
    file.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    if name.starts_with("TEXCOORD") {
        let picture = super::file::png(1, 1, png::ColorType::Rgb, &[1, 2, 3]);
        let view = file.view(&picture);
        file.json["images"] = json!([{"bufferView": view, "mimeType": "image/png"}]);
        file.json["textures"] = json!([{"source": 0}]);
        file.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
        file.primitive()["material"] = json!(0);
    }
    file
}

#[test]
fn indices_of_all_types() {
    for (component, bytes) in [
        (UNSIGNED_BYTE, vec![2, 0, 1]),
        (UNSIGNED_SHORT, u16_bytes(&[2, 0, 1])),
        (UNSIGNED_INT, u32_bytes(&[2, 0, 1])),
    ] {
        let mut file = File::triangle();
        let indices = file.accessor(component, "SCALAR", 3, &bytes);
        file.primitive()["indices"] = json!(indices);
        assert_eq!(scene(&file).parts[0].geometry.triangles, [[2, 0, 1]]);
    }
    let mut file = File::triangle();
    let indices = file.accessor(SHORT, "SCALAR", 3, &u16_bytes(&[0, 1, 2]));
    file.primitive()["indices"] = json!(indices);
    let expected = ", meshes[0].primitives[0].indices: expected SCALAR of unsigned integers, found 1 component of SHORT (accessors[1])";
    assert_eq!(error(&file), expected);
}

#[test]
fn normalised_texture_coordinates() {
    let bytes = [0, 255, 51, 102, 153, 204].as_slice();
    // Elements of two bytes lie two bytes apart.
    let file = with_attribute("TEXCOORD_0", UNSIGNED_BYTE, "VEC2", true, bytes);
    assert_eq!(scene(&file).parts[0].geometry.texcoords, [[[0.0, 1.0], [0.2, 0.4], [0.6, 0.8]]]);
    let bytes = u16_bytes(&[0, 65535, 13107, 26214, 39321, 52428]);
    let file = with_attribute("TEXCOORD_0", UNSIGNED_SHORT, "VEC2", true, &bytes);
    assert_eq!(scene(&file).parts[0].geometry.texcoords, [[[0.0, 1.0], [0.2, 0.4], [0.6, 0.8]]]);
    let bytes = [0x80, 0x81, 0, 127, 1, 255].as_slice();
    let file = with_attribute("TEXCOORD_0", BYTE, "VEC2", true, bytes);
    let sevenths = 1.0_f32 / 127.0;
    assert_eq!(scene(&file).parts[0].geometry.texcoords, [[[-1.0, -1.0], [0.0, 1.0], [sevenths, -sevenths]]]);
    let file = with_attribute("TEXCOORD_0", BYTE, "VEC2", false, bytes);
    assert_eq!(scene(&file).parts[0].geometry.texcoords, [[[-128.0, -127.0], [0.0, 127.0], [1.0, -1.0]]]);
}

#[test]
fn colours_are_linear_with_alpha() {
    let file = with_attribute(
        "COLOR_0",
        FLOAT,
        "VEC3",
        false,
        &f32_bytes(&[0.5, 0.25, 1.0, 0., 0., 0., 1., 1., 1.]),
    );
    let read = scene(&file);
    assert_eq!(read.parts[0].geometry.colours, [[0.5, 0.25, 1.0, 1.0], [0., 0., 0., 1.], [1.; 4]]);
    // Colours without a material: they are not dimmed.
    assert_eq!(read.materials[read.parts[0].material].colour, [1.0; 3]);
    let bytes = [255, 0, 51, 102, 0, 0, 0, 255, 255, 255, 255, 0];
    let file = with_attribute("COLOR_0", UNSIGNED_BYTE, "VEC4", true, &bytes);
    assert_eq!(
        scene(&file).parts[0].geometry.colours,
        [[1.0, 0.0, 0.2, 0.4], [0., 0., 0., 1.], [1., 1., 1., 0.]]
    );
    let file = with_attribute("COLOR_0", UNSIGNED_BYTE, "VEC4", false, &bytes);
    assert!(
        error(&file).contains("COLOR_0: expected VEC3 or VEC4 of FLOAT, or of normalised"),
        "{}",
        error(&file)
    );
}

#[test]
fn quantised_positions_and_normals() {
    let mut file =
        with_attribute("POSITION", SHORT, "VEC3", false, &u16_bytes(&[0, 0, 0xffff, 300, 0, 0, 0, 7, 0]));
    file.json["extensionsUsed"] = json!([]);
    file.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    file.json["nodes"][0]["scale"] = json!([0.5, 0.5, 0.5]);
    let read = scene(&file);
    assert_eq!(positions(&read.parts[0].geometry), [[0., 0., -1.], [300., 0., 0.], [0., 7., 0.]]);
    assert_eq!(read.parts[0].to_world[0], [0.5, 0., 0., 0.]);
    let bytes = u16_bytes(&[0, 0, 32767, 0x8000, 0, 0, 0, 0x8001, 0]);
    let file = with_attribute("POSITION", SHORT, "VEC3", true, &bytes);
    assert_eq!(positions(&scene(&file).parts[0].geometry), [[0., 0., 1.], [-1., 0., 0.], [0., -1., 0.]]);
    let file = with_attribute("POSITION", UNSIGNED_BYTE, "VEC3", false, &[0, 0, 1, 200, 0, 0, 0, 9, 0]);
    assert_eq!(positions(&scene(&file).parts[0].geometry), [[0., 0., 1.], [200., 0., 0.], [0., 9., 0.]]);
    let file = with_attribute("NORMAL", BYTE, "VEC3", true, &[0, 0, 127, 0, 0, 0, 0x81, 0, 0]);
    let read = scene(&file);
    assert_eq!(read.parts[0].geometry.normals, [[0., 0., 1.], [0.; 3], [-1., 0., 0.]]);
    assert!(read.notes.contains(&"1 normal of length 0".into()), "{:?}", read.notes);
    let file = with_attribute("POSITION", UNSIGNED_INT, "VEC3", false, &u32_bytes(&[0; 9]));
    assert!(error(&file).ends_with("found 3 components of UNSIGNED_INT (accessors[1])"), "{}", error(&file));
}

#[test]
fn integers_without_the_extension_of_quantisation_are_refused() {
    for (name, component, type_name, is_normalised, bytes) in [
        ("POSITION", SHORT, "SHORT", false, vec![0_u8; 18]),
        ("POSITION", UNSIGNED_BYTE, "UNSIGNED_BYTE", false, vec![0; 9]),
        ("NORMAL", BYTE, "BYTE", true, vec![0; 9]),
    ] {
        let mut file = with_attribute(name, component, "VEC3", is_normalised, &bytes);
        scene(&file);
        file.json["extensionsUsed"] = json!(["KHR_texture_transform"]);
        let message = error(&file);
        let place = format!(".attributes.{name}: expected FLOAT, or KHR_mesh_quantization in extensionsUsed");
        let found = format!("{type_name} (accessors[1])");
        assert!(message.contains(&place) && message.ends_with(&found), "{message}");
    }
}

#[test]
fn interleaved_elements_and_offsets() {
    let mut file = File::triangle();
    // Position, then normal of each vertex, after 4 bytes of the view.
    let mut bytes = vec![9; 4];
    for k in [1.0_f32, 2.0, 3.0] {
        bytes.extend(f32_bytes(&[k, 0., k * k, 0., 0., -k]));
    }
    let view = file.view(&bytes);
    file.json["bufferViews"][view]["byteStride"] = json!(24);
    let element = |offset: usize| json!({"bufferView": view, "byteOffset": offset, "componentType": FLOAT, "type": "VEC3", "count": 3});
    let (position, normal) = (file.push("accessors", element(4)), file.push("accessors", element(16)));
    file.primitive()["attributes"] = json!({"POSITION": position, "NORMAL": normal});
    let read = scene(&file);
    assert_eq!(positions(&read.parts[0].geometry), [[1., 0., 1.], [2., 0., 4.], [3., 0., 9.]]);
    assert_eq!(read.parts[0].geometry.normals, [[0., 0., -1.], [0., 0., -2.], [0., 0., -3.]]);
    assert!(
        read.notes.contains(&"1 primitive without min and max of POSITION read".into()),
        "{:?}",
        read.notes
    );
    // The last element ends with its view; one byte less is an error.
    file.json["bufferViews"][view]["byteLength"] = json!(bytes.len() - 1);
    let expected = ", accessors[2]: expected elements within the 75 bytes of its buffer view, found 3 of 12 bytes, 24 apart, from byte 16 on";
    assert_eq!(error(&file), expected);
}

#[test]
fn sparse_elements_replace_others() {
    let mut file = File::triangle();
    let (numbers, values) = (file.view(&[0, 2]), file.view(&f32_bytes(&[5., 6., 7., 8., 9., 10.])));
    let sparse = json!({
        "count": 2,
        "indices": {"bufferView": numbers, "componentType": UNSIGNED_BYTE},
        "values": {"bufferView": values},
    });
    file.json["accessors"][0]["sparse"] = sparse.clone();
    assert_eq!(positions(&scene(&file).parts[0].geometry), [[5., 6., 7.], [1., 0., 0.], [8., 9., 10.]]);
    // Without a view the others are 0.
    file.json["accessors"][0] = json!({"componentType": FLOAT, "type": "VEC3", "count": 3, "sparse": sparse});
    assert_eq!(positions(&scene(&file).parts[0].geometry), [[5., 6., 7.], [0.; 3], [8., 9., 10.]]);
    // Sparse indices of triangles.
    let mut file = File::triangle();
    let (numbers, values) = (file.view(&u16_bytes(&[1, 2])), file.view(&[2, 1]));
    let indices = file.push(
        "accessors",
        json!({"componentType": UNSIGNED_BYTE, "type": "SCALAR", "count": 3, "sparse": {
            "count": 2,
            "indices": {"bufferView": numbers, "componentType": UNSIGNED_SHORT},
            "values": {"bufferView": values},
        }}),
    );
    file.primitive()["indices"] = json!(indices);
    assert_eq!(scene(&file).parts[0].geometry.triangles, [[0, 2, 1]]);
}

#[test]
fn sparse_errors_name_their_place() {
    let mut file = File::triangle();
    let (numbers, values) = (file.view(&[2, 0]), file.view(&f32_bytes(&[0.; 6])));
    file.json["accessors"][0]["sparse"] = json!({
        "count": 2,
        "indices": {"bufferView": numbers, "componentType": UNSIGNED_BYTE},
        "values": {"bufferView": values},
    });
    assert_eq!(
        error(&file),
        ", accessors[0].sparse.indices[1]: expected numbers that increase, below 3, found 0"
    );
    file.json["accessors"][0]["sparse"]["indices"]["componentType"] = json!(FLOAT);
    assert!(
        error(&file).contains("sparse.indices.componentType: expected an unsigned integer type, found FLOAT")
    );
    file.json["accessors"][0]["sparse"]["indices"]["componentType"] = json!(UNSIGNED_SHORT);
    assert!(
        error(&file).contains("accessors[0].sparse.indices: expected elements within the 2 bytes"),
        "{}",
        error(&file)
    );
    file.json["accessors"][0]["sparse"]["indices"]["componentType"] = json!(UNSIGNED_BYTE);
    file.json["accessors"][0]["sparse"]["count"] = json!(u64::MAX);
    assert!(error(&file).contains("found 18446744073709551615 of 1 bytes"), "{}", error(&file));
}

#[test]
fn vertices_shared_by_primitives_are_taken_as_used() {
    let mut file = File::triangle();
    let many: Vec<f32> = (0..300).map(|k| k as f32).collect();
    let position = file.accessor(FLOAT, "VEC3", 100, &f32_bytes(&many));
    let indices = file.accessor(UNSIGNED_BYTE, "SCALAR", 6, &[90, 7, 50, 7, 90, 60]);
    let (numbers, values) = (file.view(&[8, 50]), file.view(&f32_bytes(&[1., 1., 1., 2., 2., 2.])));
    file.json["accessors"][position]["sparse"] = json!({
        "count": 2,
        "indices": {"bufferView": numbers, "componentType": UNSIGNED_BYTE},
        "values": {"bufferView": values},
    });
    *file.primitive() = json!({"attributes": {"POSITION": position}, "indices": indices});
    let read = scene(&file);
    let geometry = &read.parts[0].geometry;
    assert_eq!(positions(geometry), [[21., 22., 23.], [2., 2., 2.], [180., 181., 182.], [270., 271., 272.]]);
    assert_eq!(geometry.triangles, [[3, 0, 1], [0, 3, 2]]);
    // Vertices in messages are those of the file.
    file.buffer[36 + 12 * 90..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(
        error(&file).contains("POSITION, vertex 90: expected finite numbers, found [NaN, 271.0, 272.0]"),
        "{}",
        error(&file)
    );
}
