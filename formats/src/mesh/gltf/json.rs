//! The JSON text as types: the properties that a scene needs, all others are skipped.
//!
//! Numbers of objects are u64 here and compared with the lists when they are used. Numbers of matrices and vectors are f64, as written.

use std::borrow::Cow;

use serde::Deserialize;
use serde::de::{Deserializer, IgnoredAny, MapAccess, Visitor};

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::shown::shown;

/// A text that is not copied if it has no escapes: data URIs are long.
#[derive(Deserialize)]
pub(super) struct Text<'a>(#[serde(borrow)] pub(super) Cow<'a, str>);

/// The whole.
#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Root<'a> {
    pub(super) extensions_used: Vec<String>,
    pub(super) extensions_required: Vec<String>,
    pub(super) scene: Option<u64>,
    pub(super) scenes: Vec<SceneNodes>,
    pub(super) nodes: Vec<Node>,
    pub(super) meshes: Vec<Mesh>,
    pub(super) accessors: Vec<Accessor>,
    pub(super) buffer_views: Vec<View>,
    #[serde(borrow)]
    pub(super) buffers: Vec<Buffer<'a>>,
    pub(super) materials: Vec<Material>,
    pub(super) textures: Vec<Texture>,
    #[serde(borrow)]
    pub(super) images: Vec<Image<'a>>,
    pub(super) samplers: Vec<Sampler>,
    pub(super) cameras: Vec<Camera>,
    pub(super) animations: Vec<IgnoredAny>,
    pub(super) extensions: RootExtensions,
}

impl Root<'_> {
    /// Whether the file lists the extension `name`, as required or as used.
    pub(super) fn lists(&self, name: &str) -> bool {
        [&self.extensions_used, &self.extensions_required].iter().any(|list| list.iter().any(|n| n == name))
    }
}

/// Extensions of the whole.
#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct RootExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub(super) khr_lights_punctual: Lights,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct Lights {
    pub(super) lights: Vec<Light>,
}

/// A light.
#[derive(Deserialize)]
pub(super) struct Light {
    pub(super) name: Option<String>,
    pub(super) color: Option<[f64; 3]>,
    pub(super) intensity: Option<f64>,
    pub(super) range: Option<f64>,
    pub(super) spot: Option<Spot>,
    #[serde(rename = "type")]
    pub(super) kind: String,
}

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Spot {
    pub(super) inner_cone_angle: Option<f64>,
    pub(super) outer_cone_angle: Option<f64>,
}

/// A scene.
#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct SceneNodes {
    pub(super) name: Option<String>,
    pub(super) nodes: Vec<u64>,
}

/// A node.
#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct Node {
    pub(super) name: Option<String>,
    pub(super) children: Vec<u64>,
    pub(super) mesh: Option<u64>,
    pub(super) camera: Option<u64>,
    pub(super) skin: Option<u64>,
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) translation: Option<[f64; 3]>,
    pub(super) rotation: Option<[f64; 4]>,
    pub(super) scale: Option<[f64; 3]>,
    pub(super) extensions: NodeExtensions,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct NodeExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub(super) khr_lights_punctual: Option<NodeLight>,
}

#[derive(Deserialize)]
pub(super) struct NodeLight {
    pub(super) light: u64,
}

/// A mesh.
#[derive(Deserialize)]
pub(super) struct Mesh {
    pub(super) name: Option<String>,
    pub(super) primitives: Vec<Primitive>,
}

/// A primitive of a mesh.
#[derive(Deserialize)]
pub(super) struct Primitive {
    pub(super) attributes: Attributes,
    pub(super) indices: Option<u64>,
    pub(super) material: Option<u64>,
    pub(super) mode: Option<u64>,
    #[serde(default)]
    pub(super) targets: Vec<IgnoredAny>,
}

/// Names of attributes and their accessors.
pub(super) struct Attributes(Vec<(String, u64)>);

impl Attributes {
    /// Accessor of the attribute `name`.
    pub(super) fn get(&self, name: &str) -> Option<u64> {
        self.0.iter().find(|(key, _)| key == name).map(|&(_, accessor)| accessor)
    }
}

impl<'de> Deserialize<'de> for Attributes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Pairs;
        impl<'de> Visitor<'de> for Pairs {
            type Value = Attributes;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("an object of attribute names and accessor numbers")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Attributes, A::Error> {
                let mut pairs = Vec::new();
                while let Some(pair) = map.next_entry()? {
                    pairs.push(pair);
                }
                Ok(Attributes(pairs))
            }
        }
        deserializer.deserialize_map(Pairs)
    }
}

/// An accessor.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<u64>,
    pub(super) byte_offset: Option<u64>,
    pub(super) component_type: u64,
    #[serde(default)]
    pub(super) normalized: bool,
    pub(super) count: u64,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) min: Option<IgnoredAny>,
    pub(super) max: Option<IgnoredAny>,
    pub(super) sparse: Option<Box<Sparse>>,
}

#[derive(Deserialize)]
pub(super) struct Sparse {
    pub(super) count: u64,
    pub(super) indices: SparseIndices,
    pub(super) values: SparseValues,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseIndices {
    pub(super) buffer_view: u64,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) component_type: u64,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseValues {
    pub(super) buffer_view: u64,
    #[serde(default)]
    pub(super) byte_offset: u64,
}

/// A buffer view.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct View {
    pub(super) buffer: u64,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: Option<u64>,
}

/// A buffer.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer<'a> {
    #[serde(borrow)]
    pub(super) uri: Option<Text<'a>>,
    pub(super) byte_length: u64,
}

/// A material.
#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Material {
    pub(super) name: Option<String>,
    pub(super) pbr_metallic_roughness: Option<Box<MetallicRoughness>>,
    pub(super) normal_texture: Option<IgnoredAny>,
    pub(super) occlusion_texture: Option<IgnoredAny>,
    pub(super) emissive_texture: Option<Box<TextureInfo>>,
    pub(super) emissive_factor: Option<[f64; 3]>,
    pub(super) alpha_mode: Option<String>,
    pub(super) alpha_cutoff: Option<f64>,
    pub(super) double_sided: bool,
    pub(super) extensions: MaterialExtensions,
}

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct MetallicRoughness {
    pub(super) base_color_factor: Option<[f64; 4]>,
    pub(super) base_color_texture: Option<TextureInfo>,
    pub(super) metallic_roughness_texture: Option<IgnoredAny>,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct MaterialExtensions {
    #[serde(rename = "KHR_materials_pbrSpecularGlossiness")]
    pub(super) specular_glossiness: Option<Box<SpecularGlossiness>>,
    #[serde(rename = "KHR_materials_emissive_strength")]
    pub(super) emissive_strength: Option<EmissiveStrength>,
}

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct SpecularGlossiness {
    pub(super) diffuse_factor: Option<[f64; 4]>,
    pub(super) diffuse_texture: Option<TextureInfo>,
}

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct EmissiveStrength {
    pub(super) emissive_strength: Option<f64>,
}

/// Use of a texture by a material.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureInfo {
    pub(super) index: u64,
    #[serde(default)]
    pub(super) tex_coord: u64,
    #[serde(default)]
    pub(super) extensions: TextureInfoExtensions,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct TextureInfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub(super) transform: Option<TextureTransform>,
}

#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct TextureTransform {
    pub(super) offset: Option<[f64; 2]>,
    pub(super) rotation: Option<f64>,
    pub(super) scale: Option<[f64; 2]>,
    pub(super) tex_coord: Option<u64>,
}

/// A texture: an image and how it is sampled.
#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct Texture {
    pub(super) sampler: Option<u64>,
    pub(super) source: Option<u64>,
    pub(super) extensions: TextureExtensions,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct TextureExtensions {
    #[serde(rename = "EXT_texture_webp")]
    pub(super) webp: TextureSource,
    #[serde(rename = "KHR_texture_basisu")]
    pub(super) basisu: TextureSource,
}

#[derive(Deserialize, Default)]
#[serde(default)]
pub(super) struct TextureSource {
    pub(super) source: Option<u64>,
}

/// An image.
#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Image<'a> {
    pub(super) name: Option<String>,
    #[serde(borrow)]
    pub(super) uri: Option<Text<'a>>,
    pub(super) buffer_view: Option<u64>,
}

/// A sampler.
#[derive(Deserialize, Default)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Sampler {
    pub(super) mag_filter: Option<u64>,
    pub(super) wrap_s: Option<u64>,
    pub(super) wrap_t: Option<u64>,
}

/// A camera.
#[derive(Deserialize)]
pub(super) struct Camera {
    pub(super) name: Option<String>,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) perspective: Option<Perspective>,
    pub(super) orthographic: Option<IgnoredAny>,
}

#[derive(Deserialize)]
pub(super) struct Perspective {
    pub(super) yfov: f64,
}

/// Memory of the largest object in a list.
const OBJECT_BYTES: usize = {
    let sizes = [
        size_of::<Node>(),
        size_of::<Mesh>(),
        size_of::<Primitive>(),
        size_of::<Accessor>(),
        size_of::<View>(),
        size_of::<Buffer<'_>>(),
        size_of::<Material>(),
        size_of::<Texture>(),
        size_of::<Image<'_>>(),
        size_of::<Sampler>(),
        size_of::<Camera>(),
        size_of::<Light>(),
        size_of::<SceneNodes>(),
        // In boxes.
        size_of::<MetallicRoughness>(),
        size_of::<SpecularGlossiness>(),
        size_of::<Sparse>(),
    ];
    let (mut largest, mut k) = (0, 0);
    while k < sizes.len() {
        if sizes[k] > largest {
            largest = sizes[k];
        }
        k += 1;
    }
    largest
};
/// Memory of an element of a list that is not an object: a name and an accessor.
const ELEMENT_BYTES: usize = size_of::<(String, u64)>();
/// A list that grows is copied into twice its memory.
const GROWTH: u64 = 3;

/// Counts the memory of the parsed text as in use.
///
/// # Errors
/// More than the limits.
pub(super) fn charge(context: &Context<'_>, text: &[u8]) -> Result<(), MeshError> {
    context.charge(parsed_bytes(text), || "its JSON text".into())
}

/// Parses the text.
///
/// # Errors
/// Text that is not JSON, properties of a wrong type or missing, by line and column.
pub(super) fn parse<'a>(context: &Context<'_>, text: &'a [u8]) -> Result<Root<'a>, MeshError> {
    serde_json::from_slice(text).map_err(|e| syntax_error(context, &e))
}

/// Upper bound of the memory of the parsed text: an object for each `{`, an element for each comma and each list, and the text itself.
fn parsed_bytes(text: &[u8]) -> u64 {
    let (mut objects, mut elements, mut in_string, mut is_escaped) = (0_u64, 0_u64, false, false);
    for &byte in text {
        match byte {
            _ if is_escaped => is_escaped = false,
            b'\\' if in_string => is_escaped = true,
            b'"' => in_string = !in_string,
            b'{' if !in_string => objects += 1,
            b',' | b'[' if !in_string => elements += 1,
            _ => {}
        }
    }
    GROWTH * (objects * OBJECT_BYTES as u64 + elements * ELEMENT_BYTES as u64) + text.len() as u64
}

/// An error of the parser.
pub(super) fn syntax_error(context: &Context<'_>, error: &serde_json::Error) -> MeshError {
    let text = error.to_string();
    let what = text.rsplit_once(" at line ").map_or(text.as_str(), |(what, _)| what);
    let place = format!("JSON line {}, column {}", error.line(), error.column());
    context.invalid(place, "valid glTF 2.0", shown(what))
}
