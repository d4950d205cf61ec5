//! Extensions: read, ignored with a note, or refused.

use serde::Deserialize as Parse;
use serde::de::{Deserialize, Deserializer, Visitor};

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::shown::{counted, shown};
use super::document::Document;
use super::json::syntax_error;

/// Extensions that are read.
const READ: [&str; 7] = [
    "KHR_lights_punctual",
    "KHR_materials_emissive_strength",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "EXT_texture_webp",
];

/// Extensions without which a surface keeps its place and colour, and what is ignored.
const IGNORED: [(&str, &str); 14] = [
    ("KHR_animation_pointer", "animations are ignored"),
    ("KHR_materials_anisotropy", "anisotropic reflection is ignored: surfaces are matt"),
    ("KHR_materials_clearcoat", "clear coats are ignored: surfaces are matt"),
    ("KHR_materials_diffuse_transmission", "diffuse transmission is ignored: surfaces are opaque"),
    ("KHR_materials_dispersion", "dispersion is ignored: surfaces are opaque"),
    ("KHR_materials_ior", "the refractive index of materials is ignored: surfaces are matt and opaque"),
    ("KHR_materials_iridescence", "iridescence is ignored: surfaces are matt"),
    ("KHR_materials_sheen", "sheen is ignored: surfaces are matt"),
    ("KHR_materials_specular", "specular reflection is ignored: surfaces are matt"),
    ("KHR_materials_transmission", "transmission is ignored: surfaces are opaque"),
    ("KHR_materials_variants", "variants of materials are ignored: the default materials are read"),
    ("KHR_materials_volume", "volumes are ignored: surfaces are opaque"),
    ("KHR_xmp_json_ld", "metadata of KHR_xmp_json_ld are ignored"),
    ("KHR_xmp", "metadata of KHR_xmp are ignored"),
];

/// Maximum number of unknown extensions that are named.
const MAX_NOTES: usize = 16;

/// What is looked at before all else.
#[derive(Parse, Default)]
#[serde(default, rename_all = "camelCase")]
struct Header {
    asset: Option<Asset>,
    extensions_required: Vec<String>,
}

#[derive(Parse, Default)]
#[serde(default, rename_all = "camelCase")]
struct Asset {
    version: Option<Version>,
    min_version: Option<Version>,
}

/// A version, also as the number that glTF 1.0 has in places.
struct Version(String);

impl<'de> Deserialize<'de> for Version {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct TextOrNumber;
        impl Visitor<'_> for TextOrNumber {
            type Value = Version;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("a version")
            }

            fn visit_str<E>(self, text: &str) -> Result<Version, E> {
                Ok(Version(text.into()))
            }

            fn visit_u64<E>(self, number: u64) -> Result<Version, E> {
                Ok(Version(format!("{number}.0")))
            }

            fn visit_f64<E>(self, number: f64) -> Result<Version, E> {
                Ok(Version(number.to_string()))
            }
        }
        deserializer.deserialize_any(TextOrNumber)
    }
}

/// Checks the required extensions and the version.
///
/// # Errors
/// A required extension that is not supported, by name; another version than 2; text that is not JSON.
pub(super) fn check_required(context: &Context<'_>, json: &[u8]) -> Result<(), MeshError> {
    let header: Header = serde_json::from_slice(json).map_err(|e| syntax_error(context, &e))?;
    if let Some(name) = header.extensions_required.iter().find(|name| !is_known(name)) {
        return Err(MeshError::Extension {
            path: context.path.into(),
            name: shown(name),
            way_out: way_out(name),
        });
    }
    let asset = header.asset.unwrap_or_default();
    let version = asset.version.ok_or_else(|| context.invalid("asset.version", "2.0", "none"))?;
    let required = asset.min_version.as_ref().map_or("2.0", |v| &v.0);
    if version.0.split('.').next() != Some("2") || required != "2.0" {
        let needed = if required == "2.0" { &version.0 } else { required };
        return Err(MeshError::Unsupported {
            path: context.path.into(),
            place: "asset".into(),
            found: format!("glTF version {}", shown(needed)),
            way_out: "convert it to glTF 2.0".into(),
        });
    }
    Ok(())
}

/// Whether a file that requires the extension can be read.
fn is_known(name: &str) -> bool {
    READ.contains(&name) || IGNORED.iter().any(|&(known, _)| known == name)
}

/// How to write a file without the extension `name`.
fn way_out(name: &str) -> &'static str {
    match name {
        "KHR_draco_mesh_compression" => {
            "write it without Draco compression, e.g. `gltf-transform copy IN OUT`"
        }
        "EXT_meshopt_compression" | "KHR_meshopt_compression" => {
            "write it without Meshopt compression, e.g. `gltf-transform copy IN OUT`"
        }
        "KHR_texture_basisu" => "convert its KTX2 textures to PNG, e.g. `gltf-transform png IN OUT`",
        _ => "export it without this extension",
    }
}

/// Notes for skins, animations and the extensions in use that are ignored.
pub(super) fn note_used(document: &Document<'_>) {
    let skinned = document.json.nodes.iter().filter(|node| node.skin.is_some()).count();
    if skinned > 0 {
        let note =
            format!("skins of {} ignored: the vertices are placed by the node", counted(skinned, "node"));
        document.context.note(note);
    }
    if !document.json.animations.is_empty() {
        document.context.note("animations are ignored: nodes are where the file places them");
    }
    let used = &document.json.extensions_used;
    for (_, note) in IGNORED.iter().filter(|(known, _)| used.iter().any(|name| name == known)) {
        document.context.note(*note);
    }
    let unknown = || used.iter().filter(|name| !is_known(name));
    for name in unknown().take(MAX_NOTES) {
        document.context.note(format!("the extension {} is not supported and ignored", shown(name)));
    }
    if let more @ 1.. = unknown().skip(MAX_NOTES).count() {
        document.context.note(format!("{} more not supported and ignored", counted(more, "extension")));
    }
}
