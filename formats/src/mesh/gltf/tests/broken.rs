//! Files that are no valid glTF 2.0, or that declare more than they have.

use serde_json::{Value, json};

use super::file::{FLOAT, File, UNSIGNED_BYTE, container};
use super::{error, message, read_bytes, scene};
use crate::mesh::MeshError;

#[test]
fn required_extensions_come_first() {
    for (name, way_out) in [
        (
            "KHR_draco_mesh_compression",
            "write it without Draco compression, e.g. `gltf-transform copy IN OUT`",
        ),
        (
            "EXT_meshopt_compression",
            "write it without Meshopt compression, e.g. `gltf-transform copy IN OUT`",
        ),
        ("KHR_texture_basisu", "convert its KTX2 textures to PNG, e.g. `gltf-transform png IN OUT`"),
        ("VENDOR_new", "export it without this extension"),
    ] {
        // All else is wrong as well.
        let json = json!({"extensionsRequired": ["KHR_mesh_quantization", name], "accessors": [{"bufferView": 9}], "nodes": 3});
        let expected = format!(": it requires the extension {name:?}, which is not supported; {way_out}");
        assert_eq!(message(json.to_string().as_bytes()), expected);
    }
}

#[test]
fn versions() {
    let mut file = File::triangle();
    for (asset, expected) in [
        (json!({"version": "1.0"}), ", asset: glTF version \"1.0\" is not supported; convert it to glTF 2.0"),
        (json!({"version": 1}), ", asset: glTF version \"1.0\" is not supported; convert it to glTF 2.0"),
        (
            json!({"version": "2.1", "minVersion": "2.1"}),
            ", asset: glTF version \"2.1\" is not supported; convert it to glTF 2.0",
        ),
        (json!({}), ", asset.version: expected 2.0, found none"),
    ] {
        file.json["asset"] = asset;
        assert_eq!(error(&file), expected);
    }
    file.json["asset"] = json!({"version": "2.1", "minVersion": "2.0"});
    assert_eq!(scene(&file).parts.len(), 1);
}

#[test]
fn containers() {
    let good = File::triangle().glb();
    let changed = |at: usize, bytes: &[u8]| {
        let mut file = good.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        message(&file)
    };
    assert_eq!(
        changed(4, &[1]),
        ", header: version 1 of the binary container is not supported; convert it to glTF 2.0"
    );
    let length = good.len();
    let expected =
        format!(", header: expected {} bytes, found {length}; is the file truncated?", length + 65536);
    assert_eq!(changed(8, &u32::try_from(length + 65536).unwrap().to_le_bytes()), expected);
    assert!(changed(12, &[255; 4]).starts_with(", chunk 0: expected 4294967295 bytes, found "));
    assert_eq!(changed(16, b"BIN\0"), ", chunk 0: expected type JSON, found \"BIN\\0\"");
    assert_eq!(
        message(b"glTF\x02\0\0\0\x0c\0\0\0"),
        ", chunk 0: expected a chunk of type JSON, found no chunk"
    );
    assert_eq!(message(b"glTF"), ", header: expected 12 bytes, found 4; is the file truncated?");
    // A second chunk of another type is no buffer.
    let json_length = u32::from_le_bytes(*good[12..].first_chunk().unwrap()) as usize;
    let expected = ", buffers[0]: expected a uri, or the BIN chunk of a .glb, found none";
    assert_eq!(changed(20 + json_length + 4, b"XYZ\0"), expected);
    let longer = [&good[..], b"rest"].concat();
    assert_eq!(read_bytes(&longer).unwrap().0.notes[0], "4 bytes behind the declared length are ignored");
}

#[test]
fn texts_that_are_no_gltf() {
    assert_eq!(
        message(b""),
        ", JSON line 1, column 0: expected valid glTF 2.0, found \"EOF while parsing a value\""
    );
    assert!(message(b"solid cube").starts_with(", JSON line 1, column 1: expected valid glTF 2.0"));
    let nested = "[".repeat(100_000);
    assert!(message(nested.as_bytes()).contains("JSON line 1"), "{}", message(nested.as_bytes()));
    let mut file = File::triangle();
    file.json["nodes"][0]["mesh"] = json!(-1);
    assert!(error(&file).contains("invalid value: integer `-1`, expected u64"), "{}", error(&file));
    file.json["nodes"][0]["mesh"] = json!("one\ntwo");
    assert!(error(&file).contains("expected valid glTF 2.0"), "{}", error(&file));
    // Beyond 32 bits: not taken modulo 2^32.
    file.json["nodes"][0]["mesh"] = json!(1_u64 << 32);
    assert_eq!(error(&file), ", nodes[0]: expected a number below 1 (meshes), found 4294967296");
}

/// The message after a change of the JSON of a triangle.
fn changed(pointer: &str, value: Value) -> String {
    let mut file = File::triangle();
    let (parent, key) = pointer.rsplit_once('/').unwrap();
    file.json.pointer_mut(parent).unwrap()[key] = value;
    error(&file)
}

#[test]
fn ranges_are_checked_before_allocation() {
    let huge = u64::MAX;
    for (pointer, value, expected) in [
        (
            "/bufferViews/0/byteLength",
            huge,
            ", bufferViews[0]: expected bytes within the 36 of its buffer, found bytes 0 to 18446744073709551615",
        ),
        (
            "/bufferViews/0/byteOffset",
            huge,
            ", bufferViews[0]: expected bytes within the 36 of its buffer, found bytes 18446744073709551615 to 18446744073709551651",
        ),
        (
            "/bufferViews/0/byteOffset",
            1,
            ", bufferViews[0]: expected bytes within the 36 of its buffer, found bytes 1 to 37",
        ),
        (
            "/bufferViews/0/byteStride",
            8,
            ", accessors[0].bufferView: expected a byteStride of at least 12, found 8",
        ),
        (
            "/bufferViews/0/byteStride",
            huge,
            ", accessors[0]: expected elements within the 36 bytes of its buffer view, found 3 of 12 bytes, 18446744073709551615 apart, from byte 0 on",
        ),
        ("/bufferViews/0/buffer", 1, ", bufferViews[0]: expected a number below 1 (buffers), found 1"),
        (
            "/accessors/0/byteOffset",
            huge,
            ", accessors[0]: expected elements within the 36 bytes of its buffer view, found 3 of 12 bytes, 12 apart, from byte 18446744073709551615 on",
        ),
        (
            "/accessors/0/byteOffset",
            4,
            ", accessors[0]: expected elements within the 36 bytes of its buffer view, found 3 of 12 bytes, 12 apart, from byte 4 on",
        ),
        (
            "/accessors/0/count",
            huge,
            ", accessors[0]: expected elements within the 36 bytes of its buffer view, found 18446744073709551615 of 12 bytes, 12 apart, from byte 0 on",
        ),
        (
            "/accessors/0/count",
            4,
            ", accessors[0]: expected elements within the 36 bytes of its buffer view, found 4 of 12 bytes, 12 apart, from byte 0 on",
        ),
        (
            "/accessors/0/componentType",
            5124,
            ", accessors[0].componentType: expected 5120 to 5123, 5125 or 5126, found 5124",
        ),
        (
            "/accessors/0/bufferView",
            1,
            ", accessors[0].bufferView: expected a number below 1 (bufferViews), found 1",
        ),
    ] {
        assert_eq!(changed(pointer, json!(value)), expected);
    }
    assert_eq!(
        changed("/accessors/0/type", json!("VEC5")),
        ", accessors[0].type: expected SCALAR, VEC2, VEC3, VEC4 or a matrix, found \"VEC5\""
    );
    assert_eq!(
        changed("/meshes/0/primitives/0/attributes/POSITION", json!(5)),
        ", meshes[0].primitives[0].attributes.POSITION: expected a number below 1 (accessors), found 5"
    );
    assert!(changed("/accessors/0/type", json!("VEC2")).contains("expected VEC3 of FLOAT"));
}

#[test]
fn declared_counts_do_not_allocate() {
    // No buffer view: zeros, as many as are declared.
    for count in [1_u64 << 31, u64::from(u32::MAX), 1 << 40] {
        let mut file = File::triangle();
        file.json["accessors"][0] = json!({"componentType": FLOAT, "type": "VEC3", "count": count});
        let message = error(&file);
        assert!(
            message.contains("bytes of memory, allowed are 67108864")
                || message.contains("count: expected at most"),
            "{message}"
        );
        let mut file = File::triangle();
        let indices =
            file.push("accessors", json!({"componentType": UNSIGNED_BYTE, "type": "SCALAR", "count": count}));
        file.primitive()["indices"] = json!(indices);
        let message = error(&file);
        assert!(
            message.contains("bytes of memory, allowed are 67108864")
                || message.contains("count: expected at most"),
            "{message}"
        );
    }
}

#[test]
fn short_texts_of_many_objects_are_refused() {
    let many = |object: &str, number: usize| {
        let mut text = String::from(r#"{"asset": {"version": "2.0"}, "nodes": ["#);
        text.push_str(&vec![object; number].join(","));
        text.push_str("]}");
        read_bytes(&container(text.as_bytes(), &[])).err().unwrap()
    };
    assert!(matches!(many("{}", 1 << 20), MeshError::Memory { .. }));
    assert!(matches!(many("{}", 100), MeshError::Empty { .. }));
    // Many instances of a long name: the parts count, not the text.
    let mut file = File::triangle();
    file.json["meshes"][0]["name"] = json!("n".repeat(100_000));
    file.json["nodes"] = json!(vec![json!({"mesh": 0}); 1000]);
    file.json["scenes"][0]["nodes"] = json!((0..1000).collect::<Vec<_>>());
    assert!(error(&file).contains("bytes of memory"), "{}", error(&file));
}

#[test]
fn primitives_without_positions_are_noted() {
    let mut file = File::triangle();
    let without = json!({"attributes": {}});
    file.json["meshes"][0]["primitives"].as_array_mut().unwrap().push(without);
    assert!(scene(&file).notes.contains(&"1 primitive without positions ignored".into()));
}

#[test]
fn folders_and_missing_files() {
    let folder = tempfile::tempdir().unwrap();
    let read =
        |path: &std::path::Path| crate::mesh::read_gltf(path, &super::limits()).err().unwrap().to_string();
    assert!(
        read(folder.path()).ends_with("cannot open it: it is not a regular file"),
        "{}",
        read(folder.path())
    );
    let absent = folder.path().join("absent.glb");
    assert!(read(&absent).contains("absent.glb: cannot open it: No such file"), "{}", read(&absent));
}
