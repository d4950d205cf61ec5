//! Materials: factors, modes, textures and what is ignored.

use serde_json::{Value, json};

use super::file::{FLOAT, File, f32_bytes, png};
use super::{error, scene};
use pipeline::scene::description::{AlphaMode, Material, Scene, TextureUse, Wrap};

/// A triangle with a material, a set of texture coordinates and a texture of 1 × 2 texels.
fn with_material(material: Value) -> File {
    let mut file = File::triangle();
    let texcoords = file.accessor(FLOAT, "VEC2", 3, &f32_bytes(&[0., 0., 1., 0., 0., 1.]));
    let picture = file.view(&png(1, 2, png::ColorType::Rgb, &[1, 2, 3, 4, 5, 6]));
    file.json["images"] = json!([{"bufferView": picture, "mimeType": "image/png", "name": "Wood"}]);
    file.json["textures"] = json!([{"source": 0}]);
    file.json["materials"] = json!([material]);
    file.primitive()["attributes"]["TEXCOORD_0"] = json!(texcoords);
    file.primitive()["material"] = json!(0);
    file
}

fn material(scene: &Scene) -> &Material {
    &scene.materials[scene.parts[0].material]
}

fn texture_use(file: &File) -> TextureUse {
    material(&scene(file)).texture.clone().unwrap()
}

#[test]
fn colour_opacity_emission() {
    let mut file = with_material(json!({
        "name": "Oak",
        "pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.25, 0.125, 0.75], "baseColorTexture": {"index": 0}},
        "alphaMode": "MASK",
        "doubleSided": true,
        "emissiveFactor": [1, 0.5, 0],
        "emissiveTexture": {"index": 0},
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 200}},
    }));
    let read = scene(&file);
    let found = material(&read);
    assert_eq!((found.name.as_str(), found.colour, found.alpha), ("Oak", [0.5, 0.25, 0.125], 0.75));
    assert_eq!((found.alpha_mode, found.two_sided), (AlphaMode::Mask(0.5), true));
    assert_eq!(found.emission, [200., 100., 0.]);
    assert_eq!(found.emission_texture.as_ref().map(|t| t.texture), Some(0));
    assert_eq!(read.textures.len(), 1, "decoded once");
    let texture = &read.textures[0];
    assert_eq!((texture.name.as_str(), texture.width, texture.height), ("Wood", 1, 2));
    assert_eq!(texture.texels, [[1, 2, 3, 255], [4, 5, 6, 255]]);
    file.json["materials"][0]["alphaCutoff"] = json!(0.25);
    assert_eq!(material(&scene(&file)).alpha_mode, AlphaMode::Mask(0.25));
    file.json["materials"][0]["alphaMode"] = json!("BLEND");
    assert_eq!(material(&scene(&file)).alpha_mode, AlphaMode::Blend);
    file.json["materials"][0]["alphaMode"] = json!("blend");
    assert_eq!(error(&file), ", materials[0].alphaMode: expected OPAQUE, MASK or BLEND, found \"blend\"");
    // The default of the format is white, not the grey of a surface without a material.
    let read = scene(&with_material(json!({})));
    assert_eq!((material(&read).colour, material(&read).alpha_mode), ([1.0; 3], AlphaMode::Opaque));
    assert!(!material(&read).two_sided && read.textures.is_empty() && read.notes.is_empty());
    let huge = with_material(
        json!({"emissiveFactor": [1e30, 0, 0], "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 1e30}}}),
    );
    assert!(
        error(&huge).contains("materials[0].emissiveFactor: expected numbers within the range of f32"),
        "{}",
        error(&huge)
    );
}

#[test]
fn wrap_and_filter_of_the_sampler() {
    let mut file = with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    let plain = texture_use(&file);
    assert_eq!((plain.wrap, plain.nearest, plain.set), ([Wrap::Repeat; 2], false, 0));
    assert_eq!(plain.transform, [[1., 0., 0.], [0., 1., 0.]]);
    file.json["textures"][0]["sampler"] = json!(0);
    file.json["samplers"] = json!([{"wrapS": 33071, "wrapT": 33648, "magFilter": 9728, "minFilter": 9987}]);
    let sampled = texture_use(&file);
    assert_eq!((sampled.wrap, sampled.nearest), ([Wrap::Clamp, Wrap::Mirror], true));
    file.json["samplers"] = json!([{"wrapS": 10497, "magFilter": 9729, "minFilter": 9728}]);
    assert_eq!((texture_use(&file).wrap, texture_use(&file).nearest), ([Wrap::Repeat; 2], false));
    file.json["samplers"] = json!([{"wrapT": 10496}]);
    assert_eq!(
        error(&file),
        ", textures[0].sampler: expected a wrap mode 10497, 33648 or 33071, found 10496"
    );
    file.json["samplers"] = json!([]);
    assert_eq!(error(&file), ", textures[0].sampler: expected a number below 0 (samplers), found 0");
}

#[test]
fn transform_of_texture_coordinates() {
    // The example of the extension: the lower left quadrant (v down: u ≤ ½ ≤ v), turned.
    let transform = json!({"offset": [0, 1], "rotation": std::f64::consts::FRAC_PI_2, "scale": [0.5, 0.5]});
    let mut file = with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {
        "index": 0, "texCoord": 0, "extensions": {"KHR_texture_transform": transform},
    }}}));
    let map = |used: &TextureUse, u: f64, v: f64| used.transform.map(|row| row[0] * u + row[1] * v + row[2]);
    let used = texture_use(&file);
    for ((u, v), expected) in
        [((0., 0.), [0., 1.]), ((1., 0.), [0., 0.5]), ((0., 1.), [0.5, 1.]), ((1., 1.), [0.5, 0.5])]
    {
        let found = map(&used, u, v);
        assert!(
            found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15),
            "{found:?}, expected {expected:?}"
        );
    }
    // Its other set of texture coordinates.
    let here = &mut file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"];
    here["extensions"]["KHR_texture_transform"] = json!({"texCoord": 1, "scale": [1, -1], "offset": [0, 1]});
    let accessor = file.primitive()["attributes"]["TEXCOORD_0"].clone();
    file.primitive()["attributes"]["TEXCOORD_1"] = accessor;
    let read = scene(&file);
    assert_eq!(material(&read).texture.as_ref().unwrap().set, 1);
    assert_eq!(material(&read).texture.as_ref().unwrap().transform, [[1., 0., 0.], [0., -1., 1.]]);
    let texcoords = &read.parts[0].geometry.texcoords;
    assert_eq!((texcoords[0].len(), &texcoords[1][..]), (0, &[[0., 0.], [1., 0.], [0., 1.]][..]));
    file.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"]["KHR_texture_transform"]
        ["texCoord"] = json!(4_000_000_000_u64);
    assert_eq!(
        error(&file),
        ", materials[0].baseColorTexture: expected a texCoord below 32, found 4000000000"
    );
}

#[test]
fn texture_coordinates_that_are_missing_or_not_finite() {
    let mut file =
        with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": 1}}}));
    let read = scene(&file);
    assert_eq!(read.parts[0].geometry.texcoords[1], [[0.; 2]; 3]);
    assert_eq!(read.notes, ["1 primitive without the texture coordinates of its material read with (0, 0)"]);
    let texcoords = file.accessor(FLOAT, "VEC2", 3, &f32_bytes(&[0., 0., 0., f32::NEG_INFINITY, 0., 0.]));
    file.primitive()["attributes"]["TEXCOORD_1"] = json!(texcoords);
    assert!(
        error(&file).contains("TEXCOORD_1, vertex 1: expected finite numbers, found [0.0, -inf]"),
        "{}",
        error(&file)
    );
}

#[test]
fn diffuse_part_of_specular_glossiness() {
    let file = with_material(json!({
        "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1]},
        "extensions": {"KHR_materials_pbrSpecularGlossiness": {
            "diffuseFactor": [0.5, 0.25, 0, 1], "diffuseTexture": {"index": 0}, "glossinessFactor": 0.2,
        }},
    }));
    let read = scene(&file);
    assert_eq!((material(&read).colour, material(&read).texture.is_some()), ([0.5, 0.25, 0.0], true));
    assert_eq!(
        read.notes,
        ["the specular part of KHR_materials_pbrSpecularGlossiness of 1 material ignored"]
    );
}

#[test]
fn ignored_features_have_one_note_each() {
    let mut file = with_material(json!({
        "pbrMetallicRoughness": {"metallicRoughnessTexture": {"index": 0}},
        "normalTexture": {"index": 0},
        "occlusionTexture": {"index": 0},
        "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 1}, "KHR_materials_unlit": {}},
    }));
    file.json["extensionsUsed"] = json!([
        "KHR_materials_clearcoat",
        "KHR_materials_sheen",
        "KHR_materials_volume",
        "KHR_materials_transmission",
        "KHR_materials_specular",
        "KHR_materials_unlit",
        "EXT_unheard\nof",
    ]);
    file.json["extensionsRequired"] = json!(["KHR_materials_clearcoat"]);
    file.json["animations"] = json!([{"channels": [], "samplers": []}]);
    file.json["nodes"][0]["skin"] = json!(0);
    let read = scene(&file);
    assert!(read.textures.is_empty(), "textures without use are not read");
    assert_eq!(
        read.notes,
        [
            "skins of 1 node ignored: the vertices are placed by the node",
            "animations are ignored: nodes are where the file places them",
            "clear coats are ignored: surfaces are matt",
            "sheen is ignored: surfaces are matt",
            "specular reflection is ignored: surfaces are matt",
            "transmission is ignored: surfaces are opaque",
            "volumes are ignored: surfaces are opaque",
            "the extension \"EXT_unheard\\nof\" is not supported and ignored",
            "normal texture of 1 material ignored",
            "occlusion texture of 1 material ignored",
            "metallic-roughness texture of 1 material ignored",
        ]
    );
}

#[test]
fn materials_that_are_not_there() {
    let mut file = with_material(json!({}));
    file.primitive()["material"] = json!(1);
    assert_eq!(
        error(&file),
        ", meshes[0].primitives[0].material: expected a number below 1 (materials), found 1"
    );
    let file = with_material(json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 3}}}));
    assert_eq!(
        error(&file),
        ", materials[0].baseColorTexture: expected a number below 1 (textures), found 3"
    );
}
