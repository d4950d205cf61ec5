//! glTF files made in a test: JSON and one buffer.

use base64::Engine;
use serde_json::{Value, json};

/// A file with one buffer.
pub struct File {
    /// Its JSON.
    pub json: Value,
    /// Its buffer.
    pub buffer: Vec<u8>,
}

/// Component types.
pub const BYTE: u64 = 5120;
pub const UNSIGNED_BYTE: u64 = 5121;
pub const SHORT: u64 = 5122;
pub const UNSIGNED_SHORT: u64 = 5123;
pub const UNSIGNED_INT: u64 = 5125;
pub const FLOAT: u64 = 5126;

impl File {
    /// Without objects.
    pub fn empty() -> Self {
        Self { json: json!({"asset": {"version": "2.0"}}), buffer: Vec::new() }
    }

    /// A node with a mesh of one triangle in the plane z = 0: accessor 0 has its three positions.
    pub fn triangle() -> Self {
        let mut file = Self::empty();
        let positions = file.accessor(FLOAT, "VEC3", 3, &f32_bytes(&[0., 0., 0., 1., 0., 0., 0., 1., 0.]));
        file.json["accessors"][positions]["min"] = json!([0, 0, 0]);
        file.json["accessors"][positions]["max"] = json!([1, 1, 0]);
        file.json["meshes"] = json!([{"primitives": [{"attributes": {"POSITION": positions}}]}]);
        file.json["nodes"] = json!([{"mesh": 0}]);
        file.json["scenes"] = json!([{"nodes": [0]}]);
        file.json["scene"] = json!(0);
        file
    }

    /// Adds an object to a list; its number.
    pub fn push(&mut self, list: &str, object: Value) -> usize {
        let list = &mut self.json[list];
        if list.is_null() {
            *list = json!([]);
        }
        let list = list.as_array_mut().unwrap();
        list.push(object);
        list.len() - 1
    }

    /// Adds bytes to the buffer, at a multiple of 4, and a view of them.
    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.buffer.resize(self.buffer.len().next_multiple_of(4), 0);
        let offset = self.buffer.len();
        self.buffer.extend_from_slice(bytes);
        self.push("bufferViews", json!({"buffer": 0, "byteOffset": offset, "byteLength": bytes.len()}))
    }

    /// Adds an accessor of new bytes.
    pub fn accessor(&mut self, component: u64, kind: &str, count: usize, bytes: &[u8]) -> usize {
        let view = self.view(bytes);
        let accessor = json!({"bufferView": view, "componentType": component, "type": kind, "count": count});
        self.push("accessors", accessor)
    }

    /// The first primitive.
    pub fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    /// As a binary container.
    pub fn glb(&self) -> Vec<u8> {
        let mut json = self.json.clone();
        if !self.buffer.is_empty() {
            json["buffers"] = json!([{"byteLength": self.buffer.len()}]);
        }
        container(json.to_string().as_bytes(), &self.buffer)
    }

    /// As text with the buffer in a data URI.
    pub fn text(&self) -> Vec<u8> {
        let data = base64::engine::general_purpose::STANDARD.encode(&self.buffer);
        self.text_with_buffer(&format!("data:application/octet-stream;base64,{data}"))
    }

    /// As text with the buffer in another file.
    pub fn text_with_buffer(&self, uri: &str) -> Vec<u8> {
        let mut json = self.json.clone();
        json["buffers"] = json!([{"byteLength": self.buffer.len(), "uri": uri}]);
        json.to_string().into_bytes()
    }
}

/// A binary container of two chunks.
pub fn container(json: &[u8], binary: &[u8]) -> Vec<u8> {
    let mut file = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, content, padding) in [(b"JSON", json, b' '), (b"BIN\0", binary, 0)] {
        let length = content.len().next_multiple_of(4);
        file.extend(u32::try_from(length).unwrap().to_le_bytes());
        file.extend(kind);
        file.extend(content);
        file.resize(file.len() + length - content.len(), padding);
    }
    let length = u32::try_from(file.len()).unwrap();
    file[8..12].copy_from_slice(&length.to_le_bytes());
    file
}

/// Little-endian bytes.
pub fn f32_bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Little-endian bytes.
pub fn u16_bytes(values: &[u16]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// Little-endian bytes.
pub fn u32_bytes(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

/// A PNG of 8-bit samples.
pub fn png(width: u32, height: u32, colour: png::ColorType, samples: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(colour);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(samples).unwrap();
    bytes
}
