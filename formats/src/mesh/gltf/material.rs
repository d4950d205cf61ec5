//! Materials (glTF 2.0, 3.9): colour, opacity, emission and their textures.
//!
//! Colour and opacity are those of the metallic-roughness model, or the diffuse ones of `KHR_materials_pbrSpecularGlossiness`. Emission is
//! emissiveFactor × emissiveStrength (`KHR_materials_emissive_strength`), cd/m² for white. Texture coordinates (`KHR_texture_transform`), s
//! scale, o offset, φ rotation:
//!   u' = cos φ·s_u·u + sin φ·s_v·v + o_u,   v' = −sin φ·s_u·u + cos φ·s_v·v + o_v
//! v points down, so that φ is counter-clockwise for the viewer: the extension's text and its example of the lower left quadrant.

use super::super::error::MeshError;
use super::super::shown::{counted, shown};
use super::document::Document;
use super::image::Images;
use super::json;
use pipeline::scene::description::{AlphaMode, Material, Texture, TextureUse, Wrap};

/// Maximum number of sets of texture coordinates.
const MAX_SETS: u64 = 32;
/// Largest number of a transform of texture coordinates.
const MAX_TRANSFORM: f64 = 1e9;
/// Linear colour of a surface without any.
const GREY: f32 = 0.8;
/// Cutoff of `MASK` without one.
const ALPHA_CUTOFF: f64 = 0.5;

/// The materials of a file, with those of primitives without one.
pub(super) struct Materials<'d, 'a> {
    document: &'d Document<'a>,
    /// Textures by their number in the file until [`Materials::finish`].
    list: Vec<Material>,
    is_used: Vec<bool>,
    /// Of primitives without material and vertex colours.
    grey: Option<usize>,
    /// Of primitives with vertex colours alone.
    white: Option<usize>,
}

impl<'d, 'a> Materials<'d, 'a> {
    /// Reads all but the pictures.
    ///
    /// # Errors
    /// Numbers of no texture or sampler, unknown modes, numbers that are not finite in f32.
    pub(super) fn new(document: &'d Document<'a>) -> Result<Self, MeshError> {
        let materials = &document.json.materials;
        document
            .context
            .charge((materials.len() * 2 * size_of::<Material>()) as u64, || "its materials".into())?;
        let list = materials
            .iter()
            .enumerate()
            .map(|(k, m)| material(document, k, m))
            .collect::<Result<Vec<_>, _>>()?;
        let is_used = vec![false; list.len()];
        Ok(Self { document, list, is_used, grey: None, white: None })
    }

    /// Marks the material of a primitive as used and returns its number.
    ///
    /// # Errors
    /// There is none of this number, which `place` states.
    pub(super) fn number(
        &mut self,
        number: Option<u64>,
        has_colours: bool,
        place: &dyn Fn() -> String,
    ) -> Result<usize, MeshError> {
        if let Some(number) = number {
            let (number, _) =
                self.document.object(&self.document.json.materials, number, "materials", place)?;
            self.is_used[number] = true;
            return Ok(number);
        }
        let slot = if has_colours { &mut self.white } else { &mut self.grey };
        if let Some(number) = *slot {
            return Ok(number);
        }
        let number = *slot.insert(self.list.len());
        let colour = if has_colours { 1.0 } else { GREY };
        if !has_colours {
            self.document.context.note(format!("primitives without a material and colours are grey, {GREY}"));
        }
        self.list.push(plain(colour));
        self.is_used.push(true);
        Ok(number)
    }

    /// Sets of texture coordinates that a material uses: of the colour, of the emission.
    pub(super) fn sets(&self, material: usize) -> [Option<usize>; 2] {
        let material = &self.list[material];
        [&material.texture, &material.emission_texture].map(|used| used.as_ref().map(|used| used.set))
    }

    /// The materials, and the textures of those in use.
    ///
    /// # Errors
    /// Pictures that are missing, refused or do not decode.
    pub(super) fn finish(mut self) -> Result<(Vec<Material>, Vec<Texture>), MeshError> {
        let mut images = Images::new(self.document);
        for (material, &is_used) in self.list.iter_mut().zip(&self.is_used) {
            for slot in [&mut material.texture, &mut material.emission_texture] {
                match slot {
                    Some(used) if is_used => used.texture = images.texture(used.texture)?,
                    _ => *slot = None,
                }
            }
        }
        self.note_ignored();
        Ok((self.list, images.finish()))
    }

    fn note_ignored(&self) {
        let used = || {
            self.document.json.materials.iter().zip(&self.is_used).filter(|&(_, &used)| used).map(|(m, _)| m)
        };
        let note = |number: usize, what: &str| {
            if number > 0 {
                self.document.context.note(format!("{what} of {} ignored", counted(number, "material")));
            }
        };
        let is_metallic = |m: &json::Material| {
            m.pbr_metallic_roughness.as_ref().is_some_and(|p| p.metallic_roughness_texture.is_some())
        };
        note(used().filter(|m| m.normal_texture.is_some()).count(), "normal texture");
        note(used().filter(|m| m.occlusion_texture.is_some()).count(), "occlusion texture");
        note(used().filter(|m| is_metallic(m)).count(), "metallic-roughness texture");
        let diffuse = used().filter(|m| m.extensions.specular_glossiness.is_some()).count();
        note(diffuse, "the specular part of KHR_materials_pbrSpecularGlossiness");
    }
}

/// A material of one colour, visible from the front.
fn plain(colour: f32) -> Material {
    Material {
        name: String::new(),
        colour: [colour; 3],
        alpha: 1.0,
        texture: None,
        alpha_mode: AlphaMode::Opaque,
        two_sided: false,
        emission: [0.0; 3],
        emission_texture: None,
    }
}

fn material(document: &Document<'_>, number: usize, json: &json::Material) -> Result<Material, MeshError> {
    let place = |property: &str| format!("materials[{number}].{property}");
    let (factor, texture) = match (&json.extensions.specular_glossiness, &json.pbr_metallic_roughness) {
        (Some(diffuse), _) => (diffuse.diffuse_factor, &diffuse.diffuse_texture),
        (None, Some(base)) => (base.base_color_factor, &base.base_color_texture),
        (None, None) => (None, &None),
    };
    let [red, green, blue, alpha] =
        finite(document, factor.unwrap_or([1.0; 4]), &|| place("baseColorFactor"))?;
    let strength =
        json.extensions.emissive_strength.as_ref().and_then(|e| e.emissive_strength).unwrap_or(1.0);
    let emission = json.emissive_factor.unwrap_or_default().map(|c| c * strength);
    let emission = finite(document, emission, &|| place("emissiveFactor"))?;
    let alpha_mode = match json.alpha_mode.as_deref() {
        None | Some("OPAQUE") => AlphaMode::Opaque,
        Some("MASK") => {
            let [cutoff] =
                finite(document, [json.alpha_cutoff.unwrap_or(ALPHA_CUTOFF)], &|| place("alphaCutoff"))?;
            AlphaMode::Mask(cutoff)
        }
        Some("BLEND") => AlphaMode::Blend,
        Some(other) => {
            return Err(document.context.invalid(place("alphaMode"), "OPAQUE, MASK or BLEND", shown(other)));
        }
    };
    // A texture of an emission of 0 has no effect.
    let emission_texture = json.emissive_texture.as_deref().filter(|_| emission != [0.0; 3]);
    Ok(Material {
        name: json.name.clone().unwrap_or_default(),
        colour: [red, green, blue],
        alpha,
        texture: texture
            .as_ref()
            .map(|t| texture_use(document, t, &|| place("baseColorTexture")))
            .transpose()?,
        alpha_mode,
        two_sided: json.double_sided,
        emission,
        emission_texture: emission_texture
            .map(|t| texture_use(document, t, &|| place("emissiveTexture")))
            .transpose()?,
    })
}

fn finite<const N: usize>(
    document: &Document<'_>,
    numbers: [f64; N],
    place: &dyn Fn() -> String,
) -> Result<[f32; N], MeshError> {
    let single = numbers.map(|v| v as f32);
    match single.iter().all(|v| v.is_finite()) {
        true => Ok(single),
        false => {
            Err(document.context.invalid(place(), "numbers within the range of f32", format!("{numbers:?}")))
        }
    }
}

/// Use of a texture, by its number in the file.
fn texture_use(
    document: &Document<'_>,
    info: &json::TextureInfo,
    place: &dyn Fn() -> String,
) -> Result<TextureUse, MeshError> {
    let (texture, json) = document.object(&document.json.textures, info.index, "textures", place)?;
    let here = |property: &str| format!("textures[{texture}].{property}");
    let sampler = match json.sampler {
        None => &json::Sampler::default(),
        Some(number) => document.object(&document.json.samplers, number, "samplers", &|| here("sampler"))?.1,
    };
    let wrap = |mode: Option<u64>| match mode {
        None | Some(10497) => Ok(Wrap::Repeat),
        Some(33648) => Ok(Wrap::Mirror),
        Some(33071) => Ok(Wrap::Clamp),
        Some(other) => {
            let expected = "a wrap mode 10497, 33648 or 33071";
            Err(document.context.invalid(here("sampler"), expected, other.to_string()))
        }
    };
    let nearest = match sampler.mag_filter {
        None | Some(9729) => false,
        Some(9728) => true,
        Some(other) => {
            let expected = "a magFilter 9728 or 9729";
            return Err(document.context.invalid(here("sampler"), expected, other.to_string()));
        }
    };
    let transform = info.extensions.transform.as_ref();
    let set = transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord);
    if set >= MAX_SETS {
        let expected = format!("a texCoord below {MAX_SETS}");
        return Err(document.context.invalid(place(), expected, set.to_string()));
    }
    let transform = transform.map_or([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], affine);
    if let Some(v) = transform.as_flattened().iter().find(|v| v.is_nan() || v.abs() > MAX_TRANSFORM) {
        let expected = format!("a transform of numbers up to {MAX_TRANSFORM:e}");
        return Err(document.context.invalid(here("KHR_texture_transform"), expected, v.to_string()));
    }
    Ok(TextureUse {
        texture,
        set: usize::try_from(set).unwrap_or_default(),
        wrap: [wrap(sampler.wrap_s)?, wrap(sampler.wrap_t)?],
        nearest,
        transform,
    })
}

/// Rows of the map of (u, v, 1). Sine and cosine of the same bits on every machine.
fn affine(t: &json::TextureTransform) -> [[f64; 3]; 2] {
    let ([ou, ov], [su, sv]) = (t.offset.unwrap_or_default(), t.scale.unwrap_or([1.0; 2]));
    let (sin, cos) = pipeline::real::sin_cos(t.rotation.unwrap_or_default());
    [[cos * su, sin * sv, ou], [-sin * su, cos * sv, ov]]
}
