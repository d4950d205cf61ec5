//! Textures and buffers in other files: formats, sizes, names that are refused.

use std::path::Path;

use base64::Engine;
use serde_json::json;

use super::super::super::{Limits, MeshError, read_gltf};
use super::file::{FLOAT, File, f32_bytes, png};
use super::limits;
use pipeline::scene::description::Scene;

/// A triangle with a texture in the file of name `uri`.
fn textured(uri: &str) -> File {
    let mut file = File::triangle();
    let texcoords = file.accessor(FLOAT, "VEC2", 3, &f32_bytes(&[0.; 6]));
    file.json["images"] = json!([{"uri": uri}]);
    file.json["textures"] = json!([{"source": 0}]);
    file.json["materials"] = json!([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]);
    file.primitive()["attributes"]["TEXCOORD_0"] = json!(texcoords);
    file.primitive()["material"] = json!(0);
    file
}

fn read_in(folder: &Path, file: &[u8], limits: &Limits) -> Result<Scene, MeshError> {
    let path = folder.join("mesh.gltf");
    std::fs::write(&path, file).unwrap();
    read_gltf(&path, limits).map(|(scene, _)| scene)
}

/// The scene or the message of a file with a texture.
fn outcome(folder: &Path, uri: &str, limits: &Limits) -> Result<Scene, String> {
    read_in(folder, &textured(uri).text(), limits).map_err(|e| e.to_string())
}

fn data_uri(bytes: &[u8]) -> String {
    format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

fn red() -> Vec<u8> {
    png(1, 1, png::ColorType::Rgb, &[255, 0, 0])
}

#[test]
fn files_in_the_folder_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("maps")).unwrap();
    std::fs::write(folder.path().join("maps/rot %ä.png"), red()).unwrap();
    let file = textured("maps/rot%20%25%C3%A4.png");
    std::fs::write(folder.path().join("mesh.bin"), &file.buffer).unwrap();
    let path = folder.path().join("mesh.gltf");
    std::fs::write(&path, file.text_with_buffer("mesh.bin")).unwrap();
    let (scene, sources) = read_gltf(&path, &limits()).unwrap();
    assert_eq!(scene.textures[0].texels, [[255, 0, 0, 255]]);
    let listed: Vec<_> =
        sources.iter().map(|s| (s.path.strip_prefix(folder.path()).unwrap(), s.bytes)).collect();
    let expected = ["mesh.gltf", "mesh.bin", "maps/rot %ä.png"]
        .map(|name| (Path::new(name), std::fs::metadata(folder.path().join(name)).unwrap().len()));
    assert_eq!(listed, expected);
    assert_eq!(sources[2].blake3, blake3::hash(&red()));
    // A shorter buffer than declared.
    std::fs::write(folder.path().join("mesh.bin"), &file.buffer[..40]).unwrap();
    let error = read_gltf(&path, &limits()).err().unwrap().to_string();
    assert!(error.ends_with("buffers[0]: expected 60 bytes, found 40; is the file truncated?"), "{error}");
    std::fs::remove_file(folder.path().join("mesh.bin")).unwrap();
    let error = read_gltf(&path, &limits()).err().unwrap().to_string();
    assert!(
        error.contains("buffers[0]: ") && error.contains("mesh.bin is not there; copy it there"),
        "{error}"
    );
}

#[test]
fn names_that_are_refused() {
    let root = tempfile::tempdir().unwrap();
    let folder = root.path().join("model");
    std::fs::create_dir(&folder).unwrap();
    let outside = root.path().join("outside.png");
    std::fs::write(&outside, red()).unwrap();
    std::os::unix::fs::symlink(&outside, folder.join("link.png")).unwrap();
    std::os::unix::fs::symlink(root.path(), folder.join("folder")).unwrap();
    let absolute = outside.to_str().unwrap();
    let long = "a".repeat(5000);
    for (uri, reason) in [
        (
            "http://example.org/a.png",
            "\"http://example.org/a.png\" is refused: only files and data: are read",
        ),
        ("https://example.org/a.png", "is refused: only files and data: are read"),
        ("file:///etc/passwd", "\"file:///etc/passwd\" is refused: only files"),
        ("C:\\a.png", "is refused: only files"),
        ("ftp:a.png", "is refused: only files"),
        (
            absolute,
            "is refused: it is absolute; name it relative to the mesh, or allow its folder with --allow-path DIR",
        ),
        ("//host/a.png", "is refused: it is absolute"),
        ("\\\\host\\a.png", "is refused: it is absolute"),
        ("../outside.png", "\"../outside.png\" is refused: it has `..`"),
        ("%2e%2E/outside.png", "is refused: it has `..`"),
        ("..%5Coutside.png", "is refused: it has `..`"),
        ("maps/../../outside.png", "is refused: it has `..`"),
        ("link.png", "\"link.png\" is refused: it leads out of the mesh's folder"),
        ("folder/outside.png", "is refused: it leads out of the mesh's folder"),
        ("100%.png", "\"100%.png\" is refused: it is no URI; write % as %25"),
        ("a%zz.png", "is refused: it is no URI"),
        ("a%4", "is refused: it is no URI"),
        ("a%4é", "is refused: it is no URI"),
        ("%ff.png", "is refused: it is no URI"),
        ("a%00.png", "is refused: it is no URI"),
        ("", "images[0]: expected a file name of 1 to 4096 bytes, found \"\""),
        (&long, "(5000 bytes)"),
        (".", "it is not a regular file"),
        ("/dev/zero", "is refused: it is absolute"),
    ] {
        let message = outcome(&folder, uri, &limits()).err().unwrap();
        assert!(message.contains(reason), "{uri}: {message}");
        assert!(!message.contains('\n') && message.len() < 600, "{message}");
    }
    let allowed = Limits { allow_paths: vec![root.path().into()], ..limits() };
    for uri in [absolute, "../outside.png", "link.png", "folder/outside.png"] {
        let scene = outcome(&folder, uri, &allowed).unwrap();
        assert_eq!(scene.textures[0].texels, [[255, 0, 0, 255]], "{uri}");
    }
    let message = outcome(&folder, "/etc/passwd", &allowed).err().unwrap();
    assert!(message.contains("is refused: it leads out of the mesh's folder"), "{message}");
}

#[test]
fn missing_textures() {
    let folder = tempfile::tempdir().unwrap();
    let message = outcome(folder.path(), "wood.png", &limits()).err().unwrap();
    assert!(
        message.contains("images[0]: ")
            && message.ends_with("wood.png is not there; copy it there, or give --missing-textures grey")
    );
    let grey = Limits { missing_textures_grey: true, ..limits() };
    let scene = outcome(folder.path(), "wood.png", &grey).unwrap();
    assert_eq!(scene.textures[0].texels, [[231, 231, 231, 255]]);
    assert_eq!(scene.notes, ["missing texture \"wood.png\" read as grey, 0.8"]);
    // Linear 0.8 to half a code: the slope of the curve there is 0.49.
    let linear = ((231.0_f64 / 255.0 + 0.055) / 1.055).powf(2.4);
    assert!((linear - 0.8).abs() < 0.5 / 255.0 / 0.49, "{linear}");
    let mut file = textured("wood.png");
    file.json["textures"] = json!([{}]);
    let message = read_in(folder.path(), &file.text(), &limits()).err().unwrap().to_string();
    assert!(
        message.ends_with("textures[0]: expected a source; or give --missing-textures grey, found none"),
        "{message}"
    );
    assert_eq!(read_in(folder.path(), &file.text(), &grey).unwrap().textures.len(), 1);
    // Refused names stay refused.
    assert!(outcome(folder.path(), "../wood.png", &grey).err().unwrap().contains("is refused"));
}

#[test]
fn pictures_of_all_kinds() {
    let folder = tempfile::tempdir().unwrap();
    let read = |bytes: &[u8]| outcome(folder.path(), &data_uri(bytes), &limits());
    use png::ColorType::{Grayscale, GrayscaleAlpha, Rgba};
    for (colour, samples, expected) in [
        (Grayscale, &[7, 9][..], [[7, 7, 7, 255], [9, 9, 9, 255]]),
        (GrayscaleAlpha, &[7, 1, 9, 2], [[7, 7, 7, 1], [9, 9, 9, 2]]),
        (Rgba, &[1, 2, 3, 4, 5, 6, 7, 8], [[1, 2, 3, 4], [5, 6, 7, 8]]),
    ] {
        assert_eq!(read(&png(2, 1, colour, samples)).unwrap().textures[0].texels, expected);
    }
    // 16 bits are rounded: 0x7f7f = 127 · 257, 0x7fff is nearer to 127.5 + ... = 128.
    let mut sixteen = Vec::new();
    let mut encoder = png::Encoder::new(&mut sixteen, 1, 1);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.write_header().unwrap().write_image_data(&[0x7f, 0x7f, 0x80, 0x00, 0xff, 0xff]).unwrap();
    assert_eq!(read(&sixteen).unwrap().textures[0].texels, [[127, 128, 255, 255]]);
    let mut webp = Vec::new();
    let encoder = image_webp::WebPEncoder::new(&mut webp);
    encoder.encode(&[9, 8, 7, 200, 6, 5, 4, 255], 2, 1, image_webp::ColorType::Rgba8).unwrap();
    assert_eq!(read(&webp).unwrap().textures[0].texels, [[9, 8, 7, 200], [6, 5, 4, 255]]);
    for (start, name) in [
        (&b"\xabKTX 20\xbb\r\n\x1a\n"[..], "a KTX2 picture"),
        (b"DDS |", "a DDS picture"),
        (b"GIF89a", "a GIF picture"),
        (b"hello", "a picture of unknown format"),
        (b"", "a picture of unknown format"),
    ] {
        let message = read(start).err().unwrap();
        assert!(
            message
                .ends_with(&format!("images[0]: {name} is not supported; convert it to PNG, JPEG or WebP")),
            "{message}"
        );
    }
    let message = read(&red()[..50]).err().unwrap();
    assert!(message.contains("images[0]: the picture is damaged or truncated"), "{message}");
}

#[test]
fn jpeg_pictures() {
    // 8 × 8 texels of one grey: baseline, one component; the scan has DC 0 and the end of the block: 1-bit codes 0 and 0.
    let mut jpeg = b"\xff\xd8\xff\xdb\0\x43\0".to_vec();
    jpeg.extend([1; 64]);
    jpeg.extend(b"\xff\xc0\0\x0b\x08\0\x08\0\x08\x01\x01\x11\0");
    for table in [0x00, 0x10] {
        jpeg.extend([0xff, 0xc4, 0, 20, table, 1]);
        jpeg.extend([0; 16]);
    }
    jpeg.extend(b"\xff\xda\0\x08\x01\x01\0\0\x3f\0\x3f\xff\xd9");
    let folder = tempfile::tempdir().unwrap();
    let scene = outcome(folder.path(), &data_uri(&jpeg), &limits()).unwrap();
    assert_eq!(
        (scene.textures[0].width, scene.textures[0].texels.as_slice()),
        (8, &[[128, 128, 128, 255]; 64][..])
    );
    let message = outcome(folder.path(), &data_uri(&jpeg[..80]), &limits()).err().unwrap();
    assert!(message.contains("images[0]: the picture is damaged or truncated"), "{message}");
}

#[test]
fn sizes_are_checked_by_headers() {
    // A PNG header alone: nothing behind it is looked at.
    let header = |width: u32, height: u32| {
        let mut bytes = red();
        bytes[16..20].copy_from_slice(&width.to_be_bytes());
        bytes[20..24].copy_from_slice(&height.to_be_bytes());
        let mut crc = flate2::Crc::new();
        crc.update(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&crc.sum().to_be_bytes());
        data_uri(&bytes)
    };
    let folder = tempfile::tempdir().unwrap();
    let read = |uri: &str| outcome(folder.path(), uri, &limits()).err().unwrap();
    assert!(
        read(&header(1 << 16, 1))
            .ends_with("images[0]: expected a picture of 1 to 32768 texels a side, found 65536x1")
    );
    let message = read(&header(1 << 15, 1 << 15));
    let expected =
        "images[0]: it takes 4294967296 bytes of memory, allowed are 16777216; give more with --memory";
    assert!(message.ends_with(expected), "{message}");
    // A data URI by its length: 17 MiB of zeros.
    let long = format!("data:;base64,{}", "A".repeat(24 << 20));
    let message = read(&long);
    assert!(message.contains("bytes of memory, allowed are"), "{message}");
}

#[test]
fn data_uris() {
    let folder = tempfile::tempdir().unwrap();
    let png = red();
    let escaped: String = png.iter().map(|b| format!("%{b:02X}")).collect();
    let unpadded = data_uri(&png);
    for uri in [
        format!("data:,{escaped}"),
        format!("DATA:image/png,{escaped}"),
        unpadded.trim_end_matches('=').to_owned(),
        data_uri(&png).replace('/', "%2F").replace('+', "%2b"),
    ] {
        assert_eq!(
            outcome(folder.path(), &uri, &limits()).unwrap().textures[0].texels,
            [[255, 0, 0, 255]],
            "{uri}"
        );
    }
    for (uri, expected) in [
        (
            "data:image/png;base64",
            "images[0]: expected a data URI, data:TYPE;base64,DATA, found \"data:image/png;base64\"",
        ),
        ("data:image/png;base64,a$b", "images[0]: expected base64 data, found \"data:image/png;base64,a$b\""),
        ("data:,%4", "images[0]: expected two hexadecimal digits after each %"),
    ] {
        let message = outcome(folder.path(), uri, &limits()).err().unwrap();
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn webp_and_basisu_extensions() {
    let folder = tempfile::tempdir().unwrap();
    let mut file = textured(&data_uri(&red()));
    file.json["textures"] = json!([{"source": 0, "extensions": {"KHR_texture_basisu": {"source": 7}}}]);
    file.json["extensionsUsed"] = json!(["KHR_texture_basisu"]);
    assert_eq!(
        read_in(folder.path(), &file.text(), &limits()).unwrap().textures[0].texels,
        [[255, 0, 0, 255]]
    );
    file.json["textures"] = json!([{"extensions": {"KHR_texture_basisu": {"source": 7}}}]);
    let message = read_in(folder.path(), &file.text(), &limits()).err().unwrap().to_string();
    assert!(
        message.contains("textures[0]: a KTX2 picture (KHR_texture_basisu) without another is not supported"),
        "{message}"
    );
    let mut webp = Vec::new();
    image_webp::WebPEncoder::new(&mut webp).encode(&[1, 2, 3], 1, 1, image_webp::ColorType::Rgb8).unwrap();
    std::fs::write(folder.path().join("a.webp"), webp).unwrap();
    file.push("images", json!({"uri": "a.webp"}));
    file.json["textures"] = json!([{"source": 0, "extensions": {"EXT_texture_webp": {"source": 1}}}]);
    file.json["extensionsRequired"] = json!(["EXT_texture_webp"]);
    assert_eq!(read_in(folder.path(), &file.text(), &limits()).unwrap().textures[0].texels, [[1, 2, 3, 255]]);
}
