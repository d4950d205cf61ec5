//! OpenEXR files with channels of any name: one layer of 32-bit floats, scan lines without compression (openexr.com, "OpenEXR File Layout").

use pipeline::geometry::Size;
use std::path::Path;

/// Version 2, and the flag of a file with deep data.
const VERSION: u32 = 2;
const DEEP: u32 = 0x800;

fn attribute(out: &mut Vec<u8>, name: &str, kind: &str, value: &[u8]) {
    for text in [name, kind] {
        out.extend(text.bytes());
        out.push(0);
    }
    out.extend((value.len() as u32).to_le_bytes());
    out.extend(value);
}

fn header(size: Size, names: &[&str], version: u32) -> Vec<u8> {
    let mut out = 20_000_630u32.to_le_bytes().to_vec();
    out.extend(version.to_le_bytes());
    let mut channels = Vec::new();
    for name in names {
        channels.extend(name.bytes());
        // End of the name; float; linear, reserved; sampling of x and y.
        channels.push(0);
        for number in [2u32, 0, 1, 1] {
            channels.extend(number.to_le_bytes());
        }
    }
    channels.push(0);
    let window: Vec<u8> =
        [0, 0, size.width as i32 - 1, size.height as i32 - 1].iter().flat_map(|n| n.to_le_bytes()).collect();
    attribute(&mut out, "channels", "chlist", &channels);
    attribute(&mut out, "compression", "compression", &[0]);
    attribute(&mut out, "dataWindow", "box2i", &window);
    attribute(&mut out, "displayWindow", "box2i", &window);
    attribute(&mut out, "lineOrder", "lineOrder", &[0]);
    attribute(&mut out, "pixelAspectRatio", "float", &1f32.to_le_bytes());
    attribute(&mut out, "screenWindowCenter", "v2f", &[0; 8]);
    attribute(&mut out, "screenWindowWidth", "float", &1f32.to_le_bytes());
    if version & DEEP != 0 {
        attribute(&mut out, "name", "string", b"deep");
        attribute(&mut out, "type", "string", b"deepscanline");
        attribute(&mut out, "version", "int", &1i32.to_le_bytes());
        attribute(&mut out, "chunkCount", "int", &(size.height as i32).to_le_bytes());
        attribute(&mut out, "maxSamplesPerPixel", "int", &1i32.to_le_bytes());
    }
    out.push(0);
    out
}

/// Writes `channels`, which are sorted by their names.
pub fn write(path: &Path, size: Size, channels: &[(&str, &[f32])]) {
    let names: Vec<&str> = channels.iter().map(|channel| channel.0).collect();
    assert!(names.is_sorted() && channels.iter().all(|channel| channel.1.len() == size.pixels()));
    let mut out = header(size, &names, VERSION);
    let line_bytes = 4 * size.width * channels.len();
    let first = out.len() + 8 * size.height;
    for y in 0..size.height {
        out.extend(((first + y * (8 + line_bytes)) as u64).to_le_bytes());
    }
    for y in 0..size.height {
        out.extend((y as i32).to_le_bytes());
        out.extend((line_bytes as u32).to_le_bytes());
        for (_, values) in channels {
            out.extend(values[y * size.width..][..size.width].iter().flat_map(|v| v.to_le_bytes()));
        }
    }
    std::fs::write(path, out).unwrap();
}

/// Writes the header of a file with deep scan lines.
pub fn write_deep(path: &Path, size: Size) {
    let mut out = header(size, &["Z"], VERSION | DEEP);
    out.resize(out.len() + 64 * size.height, 0);
    std::fs::write(path, out).unwrap();
}
