//! Definitions of MTL files to materials and textures of a scene.
//!
//! Texture coordinates are (u, v) with v up in the file: u' = s_u u + o_u, v' = s_v v + o_v. With v down (v → 1 − v on both sides) the map
//! is v' = s_v v + 1 − s_v − o_v. Both sides of all materials are surfaces. A material without `Kd` is 0.8 grey, or
//! white under a texture or under colours of vertices.
//!
//! Opacity textures (`map_d`) are put into the alpha channel of the colour texture. Opacity is the alpha channel of the picture of `map_d`,
//! or its luminance (weights of ITU-R BT.709 on the coded values) if that is 255 everywhere. Pictures of different sizes are put
//! together in the larger width and height, each texel being that of its centre.

use std::collections::HashMap;
use std::path::PathBuf;

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::grow;
use super::super::paths::resolve;
use super::super::shown::shown;
use super::super::source::read_file;
use super::super::texture;
use super::findings::Findings;
use super::mtl::{Definition, Library, Map, note_case};
use pipeline::scene::description::{AlphaMode, Material, Scene, Texture, TextureUse, Wrap};

/// Colour of surfaces without material or colour.
const GREY: f32 = 0.8;

/// Adds the materials `names` (of the parts, in their order) to the scene; returns the number of the material of each. Where there is
/// no colour the surface is white if vertices `are_coloured`, else grey.
pub(super) fn add_materials<'a>(
    context: &Context<'_>,
    library: &mut Library,
    names: impl Iterator<Item = &'a Option<String>>,
    are_coloured: bool,
    scene: &mut Scene,
) -> Result<Vec<usize>, MeshError> {
    let mut known: HashMap<&Option<String>, usize> = HashMap::new();
    let findings = std::mem::take(&mut library.findings);
    let mut textures = Textures { context, are_coloured, numbers: HashMap::new(), findings };
    let mut numbers = Vec::new();
    for name in names {
        let number = match known.get(name) {
            Some(&number) => number,
            None => {
                let definition = name.as_ref().and_then(|name| library.definitions.get(name));
                match name {
                    None if are_coloured => {}
                    None => context.note("faces without material (usemtl) are 0.8 grey"),
                    Some(name) if definition.is_none() => textures.findings.add(UNDEFINED, name),
                    Some(_) => {}
                }
                let name_text = name.clone().unwrap_or_default();
                let material = textures.material(name_text, definition, &mut scene.textures)?;
                scene.materials.push(material);
                known.insert(name, scene.materials.len() - 1);
                scene.materials.len() - 1
            }
        };
        numbers.push(number);
    }
    textures.findings.add_notes(context);
    Ok(numbers)
}

const UNDEFINED: &str = "materials without definition, which are 0.8 grey or have the colours of vertices";
const COLOURLESS: &str = "materials without colour (Kd), which are 0.8 grey or have the colours of vertices";
const BLACK: &str = "materials that are black because Kd, a factor of their texture, is 0";
const INVISIBLE: &str = "materials that are invisible, as their opacity is 0";
const OTHER_MAPPING: &str = "materials whose opacity texture is ignored, as its options -s, -o, -clamp are not those of the colour texture";
const MISSING: &str = "missing textures, read as 0.8 grey";

/// Textures of the scene by the files of colour and opacity.
struct Textures<'a> {
    context: &'a Context<'a>,
    are_coloured: bool,
    numbers: HashMap<(Option<PathBuf>, Option<PathBuf>), usize>,
    findings: Findings,
}

/// A texture file of a material.
struct MapFile<'m> {
    map: &'m Map,
    path: PathBuf,
}

impl Textures<'_> {
    fn material(
        &mut self,
        name: String,
        definition: Option<&Definition>,
        textures: &mut Vec<Texture>,
    ) -> Result<Material, MeshError> {
        let mut material = Material::matt(name, [if self.are_coloured { 1.0 } else { GREY }; 3]);
        if let Some(definition) = definition {
            self.set_colour(&mut material, definition, textures)?;
            self.set_emission(&mut material, definition, textures)?;
        }
        Ok(material)
    }

    /// Colour and opacity.
    fn set_colour(
        &mut self,
        material: &mut Material,
        definition: &Definition,
        textures: &mut Vec<Texture>,
    ) -> Result<(), MeshError> {
        let colour = self.file(definition, definition.diffuse_map.as_ref())?;
        let mut opacity = self.file(definition, definition.opacity_map.as_ref())?;
        let mapping = |file: &MapFile<'_>| (file.map.scale, file.map.offset, file.map.clamp);
        if let (Some(colour), Some(alpha)) = (&colour, &opacity)
            && mapping(colour) != mapping(alpha)
        {
            self.findings.add(OTHER_MAPPING, &material.name);
            opacity = None;
        }
        match (definition.diffuse, &definition.diffuse_map) {
            (Some(factor), _) => material.colour = factor,
            (None, Some(_)) => material.colour = [1.0; 3],
            (None, None) => self.findings.add(COLOURLESS, &material.name),
        }
        if definition.diffuse_map.is_some() && material.colour == [0.0; 3] {
            self.findings.add(BLACK, &material.name);
        }
        if definition.diffuse_map.is_some() && colour.is_none() {
            material.colour = material.colour.map(|v| v * GREY);
        }
        material.alpha =
            definition.opacity.or(definition.transparency.map(|t| 1.0 - t)).unwrap_or(1.0) as f32;
        if material.alpha == 0.0 {
            self.findings.add(INVISIBLE, &material.name);
        }
        if material.alpha < 1.0 || opacity.is_some() {
            material.alpha_mode = AlphaMode::Blend;
        }
        if let Some(file) = colour.as_ref().or(opacity.as_ref()) {
            let number = self.number(&material.name, colour.as_ref(), opacity.as_ref(), textures)?;
            material.texture = Some(texture_use(file.map, number));
        }
        Ok(())
    }

    fn set_emission(
        &mut self,
        material: &mut Material,
        definition: &Definition,
        textures: &mut Vec<Texture>,
    ) -> Result<(), MeshError> {
        material.emission = definition.emission.unwrap_or([0.0; 3]);
        if let Some(file) = self.file(definition, definition.emission_map.as_ref())? {
            let number = self.number(&material.name, Some(&file), None, textures)?;
            material.emission_texture = Some(texture_use(file.map, number));
            // Programs that write the texture alone, or with 0, mean 1.
            if material.emission == [0.0; 3] {
                material.emission = [1.0; 3];
            }
        }
        if material.emission != [0.0; 3] {
            self.context.note("emission (Ke) has no unit in MTL files; its values are taken as cd/m²");
        }
        Ok(())
    }

    /// The file of a texture; `None` if it is missing and may be.
    fn file<'m>(
        &mut self,
        definition: &Definition,
        map: Option<&'m Map>,
    ) -> Result<Option<MapFile<'m>>, MeshError> {
        let Some(map) = map else { return Ok(None) };
        match resolve(self.context, &definition.path, &format!("line {}", map.line), &map.reference) {
            Ok(found) => {
                note_case(&mut self.findings, &map.reference, &found);
                Ok(Some(MapFile { map, path: found.path }))
            }
            Err(MeshError::Missing { .. }) if self.context.limits.missing_textures_grey => {
                self.findings.add(MISSING, &map.reference);
                Ok(None)
            }
            Err(error) => Err(error),
        }
    }

    /// Number of the texture of `colour` (white without) and `opacity`.
    fn number(
        &mut self,
        material: &str,
        colour: Option<&MapFile<'_>>,
        opacity: Option<&MapFile<'_>>,
        textures: &mut Vec<Texture>,
    ) -> Result<usize, MeshError> {
        let key = (colour.map(|file| file.path.clone()), opacity.map(|file| file.path.clone()));
        if let Some(&number) = self.numbers.get(&key) {
            return Ok(number);
        }
        let colour = colour.map(|file| self.decode(material, file)).transpose()?;
        let opacity = opacity.map(|file| self.decode(material, file)).transpose()?;
        textures.push(match (colour, opacity) {
            (Some(colour), None) => colour,
            (colour, Some(opacity)) => self.combined(colour, opacity)?,
            (None, None) => return Err(self.context.invalid("textures", "a file", "none")),
        });
        self.numbers.insert(key, textures.len() - 1);
        Ok(textures.len() - 1)
    }

    fn decode(&self, material: &str, file: &MapFile<'_>) -> Result<Texture, MeshError> {
        let bytes = read_file(self.context, &file.path, &file.path)?;
        let place = format!("texture of material {}", shown(material));
        let texture = texture::decode(self.context, &file.path, &place, file.map.reference.clone(), &bytes)?;
        grow::free(self.context, bytes);
        Ok(texture)
    }

    /// One texture of two.
    fn combined(&self, colour: Option<Texture>, opacity: Texture) -> Result<Texture, MeshError> {
        let by_alpha = opacity.texels.iter().any(|texel| texel[3] != 255);
        let alpha = |texel: [u8; 4]| {
            let [r, g, b] = [texel[0], texel[1], texel[2]].map(u32::from);
            let luminance = ((2126 * r + 7152 * g + 722 * b + 5000) / 10_000) as u8;
            if by_alpha { texel[3] } else { luminance }
        };
        let size = |t: &Texture| [t.width, t.height];
        let white = Texture { name: opacity.name.clone(), width: 1, height: 1, texels: vec![[255; 4]] };
        let colour = colour.unwrap_or(white);
        let [width, height] = [0, 1].map(|axis| size(&colour)[axis].max(size(&opacity)[axis]));
        let bytes = 4 * width as u64 * height as u64;
        self.context.charge(bytes, || format!("texture {}", shown(&colour.name)))?;
        let nearest = |t: &Texture, row: usize, column: usize| {
            let index = |at: usize, of: usize, side: usize| (2 * at + 1) * side / (2 * of);
            t.texels[index(row, height, t.height) * t.width + index(column, width, t.width)]
        };
        let mut texels = Vec::with_capacity(width * height);
        for row in 0..height {
            texels.extend((0..width).map(|column| {
                let [r, g, b, _] = nearest(&colour, row, column);
                [r, g, b, alpha(nearest(&opacity, row, column))]
            }));
        }
        let before = colour.texels.len() + opacity.texels.len();
        self.context.release(4 * before as u64);
        Ok(Texture { name: colour.name, width, height, texels })
    }
}

fn texture_use(map: &Map, texture: usize) -> TextureUse {
    let wrap = if map.clamp { Wrap::Clamp } else { Wrap::Repeat };
    let ([su, sv], [ou, ov]) = (map.scale, map.offset);
    let transform = [[su, 0.0, ou], [0.0, sv, 1.0 - sv - ov]];
    TextureUse { texture, set: 0, wrap: [wrap; 2], nearest: false, transform }
}
