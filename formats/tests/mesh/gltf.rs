//! glTF.

#[allow(dead_code, missing_docs, reason = "shared with the tests of the reader, which use all of it")]
#[path = "../../src/mesh/gltf/tests/file.rs"]
mod file;

use super::{folder, peak_of};
use std::path::Path;

use base64::Engine;
use file::{FLOAT, File, SHORT, UNSIGNED_BYTE, UNSIGNED_SHORT, f32_bytes, png, u16_bytes};
use lenscube_formats::mesh::{Limits, read};
use serde_json::json;

/// Memory that the reader may use.
const MEMORY_BYTES: u64 = 4 << 20;
/// Of messages and of the decoders' fixed tables.
const SLACK_BYTES: isize = 1 << 20;

/// Number of random changes, or that of the environment.
fn changes() -> usize {
    let cases = std::env::var("LENSCUBE_FUZZ_CASES").ok();
    cases.map_or(20_000, |text| text.parse().expect("LENSCUBE_FUZZ_CASES is a number"))
}

/// splitmix64 (Steele, Lea, Flood 2014).
struct Random(u64);

impl Random {
    fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) % n as u64) as usize
    }
}

/// A file with all that is read: strips, sparse and quantised accessors, textures in the buffer and in data URIs, cameras, lights.
fn whole() -> File {
    let mut file = File::triangle();
    let texcoords = file.accessor(UNSIGNED_SHORT, "VEC2", 3, &u16_bytes(&[0, 0, 65535, 0, 0, 65535]));
    file.json["accessors"][texcoords]["normalized"] = json!(true);
    let colours = file.accessor(FLOAT, "VEC3", 3, &f32_bytes(&[0.5; 9]));
    let indices = file.accessor(UNSIGNED_BYTE, "SCALAR", 4, &[0, 1, 2, 0]);
    let (numbers, values) = (file.view(&[1]), file.view(&u16_bytes(&[5, 6, 7])));
    let quantised = file.accessor(SHORT, "VEC3", 5, &u16_bytes(&[1; 15]));
    file.json["accessors"][quantised]["sparse"] = json!({
        "count": 1,
        "indices": {"bufferView": numbers, "componentType": UNSIGNED_BYTE, "byteOffset": 0},
        "values": {"bufferView": values, "byteOffset": 0},
    });
    let picture = file.view(&png(2, 2, ::png::ColorType::Rgba, &[100; 16]));
    let data = base64::engine::general_purpose::STANDARD.encode(png(1, 1, ::png::ColorType::Grayscale, &[9]));
    file.json["images"] = json!([{"bufferView": picture}, {"uri": format!("data:image/png;base64,{data}")}]);
    file.json["samplers"] = json!([{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728}]);
    file.json["textures"] = json!([{"source": 0, "sampler": 0}, {"source": 1}]);
    file.json["materials"] = json!([{
        "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.5], "baseColorTexture": {"index": 0,
            "extensions": {"KHR_texture_transform": {"offset": [0, 1], "rotation": 0.3, "scale": [2, 2], "texCoord": 0}}}},
        "alphaMode": "MASK", "alphaCutoff": 0.3, "doubleSided": true,
        "emissiveFactor": [1, 1, 1], "emissiveTexture": {"index": 1},
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 3}},
    }]);
    file.json["meshes"] = json!([{"name": "Cup", "primitives": [
        {"attributes": {"POSITION": 0, "TEXCOORD_0": texcoords, "COLOR_0": colours}, "indices": indices, "mode": 5, "material": 0},
        {"attributes": {"POSITION": quantised}, "mode": 6, "indices": indices},
        {"attributes": {"POSITION": 0}, "mode": 1},
    ]}]);
    file.json["nodes"] = json!([
        {"mesh": 0, "children": [1, 2], "scale": [2, 2, 2]},
        {"camera": 0, "rotation": [0, 0.6, 0, 0.8], "translation": [1, 2, 3]},
        {"matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 4, 5, 1], "mesh": 0, "children": [3]},
        {"extensions": {"KHR_lights_punctual": {"light": 0}}},
    ]);
    file.json["cameras"] = json!([{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]);
    file.json["extensions"] =
        json!({"KHR_lights_punctual": {"lights": [{"type": "spot", "spot": {"outerConeAngle": 0.4}}]}});
    file.json["extensionsUsed"] =
        json!(["KHR_lights_punctual", "KHR_texture_transform", "KHR_materials_sheen"]);
    file.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    file
}

/// Whether the bytes give a scene; an error is one line with the file's name.
fn is_scene(path: &Path, bytes: &[u8]) -> bool {
    std::fs::write(path, bytes).unwrap();
    let (read, peak) = peak_of(|| read(path, &Limits::of_memory(MEMORY_BYTES)));
    assert!(peak < MEMORY_BYTES as isize + SLACK_BYTES, "{peak} bytes");
    match read {
        Ok((scene, sources)) => {
            let vertices = |part: &pipeline::scene::description::Part| match &part.geometry.positions {
                pipeline::scene::description::Positions::F32(p) => p.len(),
                pipeline::scene::description::Positions::F64(p) => p.len(),
            };
            for part in &scene.parts {
                let count = vertices(part);
                assert!(part.geometry.triangles.as_flattened().iter().all(|&v| (v as usize) < count));
                assert!(part.geometry.texcoords.iter().all(|set| set.is_empty() || set.len() == count));
                assert!(part.material < scene.materials.len());
            }
            let uses = scene.materials.iter().flat_map(|m| [&m.texture, &m.emission_texture]).flatten();
            assert!(uses.into_iter().all(|used| used.texture < scene.textures.len()));
            assert!(scene.textures.iter().all(|t| t.texels.len() == t.width * t.height));
            assert_eq!(sources[0].bytes, bytes.len() as u64);
            true
        }
        Err(e) => {
            let message = e.to_string();
            assert!(
                message.contains("fuzz.glb") && !message.contains('\n') && message.len() < 1000,
                "{message}"
            );
            false
        }
    }
}

#[test]
fn damaged_files_give_a_scene_or_an_error() {
    let folder = folder();
    let path = folder.path().join("fuzz.glb");
    let (container, text) = (whole().glb(), whole().text());
    assert!(is_scene(&path, &container) && is_scene(&path, &text));
    for length in 0..container.len() {
        assert!(!is_scene(&path, &container[..length]), "truncated at {length} of {}", container.len());
    }
    let mut random = Random(0x6c65_6e73);
    let (mut scenes, json_end) = (0, 20 + json_bytes(&container));
    let digits: Vec<_> = (0..text.len()).filter(|&at| text[at].is_ascii_digit()).collect();
    let changes = changes();
    for change in 0..changes {
        // Bytes of the container anywhere, of its JSON, of the text; digits of the text, which stays valid.
        let mut bytes = if change % 4 < 2 { container.clone() } else { text.clone() };
        for _ in 0..=random.below(3) {
            match change % 4 {
                0 => bytes[random.below(container.len())] = random.below(256) as u8,
                1 => bytes[random.below(json_end)] = random.below(256) as u8,
                2 => bytes[random.below(text.len())] = random.below(256) as u8,
                _ => bytes[digits[random.below(digits.len())]] = b'0' + random.below(10) as u8,
            }
        }
        scenes += usize::from(is_scene(&path, &bytes));
    }
    declared_sizes(&path);
    // Both outcomes occur: the changes reach the values, and the checks.
    assert!((changes / 20..changes * 19 / 20).contains(&scenes), "{scenes}");
}

/// Files that declare more than they have: up to the limit they are read.
fn declared_sizes(path: &Path) {
    for (count, is_read) in [(250_000_u64, true), (600_000, false), (4_000_000_000, false), (u64::MAX, false)]
    {
        let mut file = File::triangle();
        file.json["accessors"][0] = json!({"componentType": FLOAT, "type": "VEC3", "count": 3});
        let indices =
            file.push("accessors", json!({"componentType": UNSIGNED_BYTE, "type": "SCALAR", "count": count}));
        file.primitive()["indices"] = json!(indices);
        assert_eq!(is_scene(path, &file.glb()), is_read, "{count} indices");
    }
    for (nodes, is_read) in [(100, true), (20_000, false)] {
        let mut file = File::triangle();
        file.json["nodes"].as_array_mut().unwrap().extend(vec![json!({}); nodes]);
        assert_eq!(is_scene(path, &file.glb()), is_read, "{nodes} nodes");
    }
    for (side, is_read) in [(500, true), (600, false), (30_000, false)] {
        let mut file = whole();
        let picture = match side {
            ..1000 => png(side, side, ::png::ColorType::Rgba, &vec![7; 4 * (side * side) as usize]),
            _ => png_header(side),
        };
        file.json["images"][0]["bufferView"] = json!(file.view(&picture));
        assert_eq!(is_scene(path, &file.glb()), is_read, "{side} texels a side");
    }
}

/// A PNG that declares more texels than it has.
fn png_header(side: u32) -> Vec<u8> {
    let mut bytes = png(1, 1, ::png::ColorType::Rgba, &[0; 4]);
    bytes[16..20].copy_from_slice(&side.to_be_bytes());
    bytes[20..24].copy_from_slice(&side.to_be_bytes());
    let mut checksum = flate2::Crc::new();
    checksum.update(&bytes[12..29]);
    bytes[29..33].copy_from_slice(&checksum.sum().to_be_bytes());
    bytes
}

/// Length of the JSON chunk.
fn json_bytes(container: &[u8]) -> usize {
    u32::from_le_bytes(*container[12..].first_chunk().unwrap()) as usize
}
