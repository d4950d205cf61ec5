//! Materials and their spectra, and what a scene needs to show them.

use super::{Appearance, Reflects, Surface};
use crate::scene::description::{AlphaMode, Material, Part, Positions, TextureUse};
use crate::scene::frame::Frame;
use crate::scene::horizon::rotated;
use crate::scene::light::Lighting;
use crate::scene::light::shadow::{Occluders, TooManyTriangles, Triangles};
use crate::scene::pose::Pose;
use crate::scene::texture::Pyramid;
use crate::scene::vector::cross;
use crate::scene::weights::{COLOURS, Spectrum, bases};
use std::collections::BTreeSet;
use std::sync::atomic::AtomicU64;

/// A spectrum in place of a material's colour.
#[derive(Clone, Debug, PartialEq)]
pub struct Assigned {
    /// Numbers of the materials.
    pub materials: Vec<usize>,
    /// Their reflectance.
    pub spectrum: Spectrum,
    /// Whether the luminance of their texture multiplies it.
    pub times_texture: bool,
}

/// What is behind all triangles.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Background {
    /// Nothing: black.
    #[default]
    None,
    /// White of this luminance, cd/m².
    Luminance(f64),
    /// The map of the light around; black without one.
    Environment,
}

/// All that determines the weights.
pub struct AppearanceRequest<'a, T> {
    /// Triangles in the camera frame.
    pub triangles: &'a T,
    /// Parts of the scene.
    pub parts: &'a [Part],
    /// Its materials.
    pub materials: &'a [Material],
    /// Its textures, all of them.
    pub textures: Vec<Pyramid>,
    /// Spectra in place of colours; their order is that of the bases.
    pub assigned: &'a [Assigned],
    /// The camera.
    pub pose: Pose,
    /// The chart.
    pub frame: Frame,
    /// The light.
    pub lighting: Lighting,
    /// Background.
    pub background: Background,
}

/// A scene that cannot be shown.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AppearanceError {
    /// No material of this name.
    #[error("no material is called `{name}`; the materials are {known}")]
    UnknownMaterial {
        /// The name.
        name: String,
        /// Those of the scene.
        known: String,
    },
    /// A reference beyond a list.
    #[error("{what} {number} does not exist: there are {count}")]
    Missing {
        /// What refers to what.
        what: String,
        /// The number, from 0.
        number: usize,
        /// How many there are.
        count: usize,
    },
    /// An attribute that not all vertices have.
    #[error("part `{part}` has {found} {what} for {vertices} vertices")]
    Attribute {
        /// Name of the part.
        part: String,
        /// The attribute.
        what: &'static str,
        /// How many it has.
        found: usize,
        /// Vertices.
        vertices: usize,
    },
    /// Two spectra for a material.
    #[error("material `{material}` has two spectra, `{first}` and `{second}`")]
    AssignedTwice {
        /// Name of the material.
        material: String,
        /// One spectrum.
        first: String,
        /// The other one.
        second: String,
    },
    /// A spectrum times a texture that does not exist.
    #[error("material `{material}` has no texture that could multiply the spectrum `{spectrum}`")]
    NoTexture {
        /// Name of the material.
        material: String,
        /// Name of the spectrum.
        spectrum: String,
    },
    /// A background that is no luminance.
    #[error("the luminance of the background is {0} cd/m²; expected 0 or a positive number")]
    Background(f64),
    /// Too many triangles for shadows.
    #[error(transparent)]
    TooMany(#[from] TooManyTriangles),
}

/// Numbers of the materials of this name.
///
/// # Errors
/// [`AppearanceError::UnknownMaterial`] with a list of all.
pub fn materials_named(materials: &[Material], name: &str) -> Result<Vec<usize>, AppearanceError> {
    let found: Vec<usize> = (0..materials.len()).filter(|&m| materials[m].name == name).collect();
    if found.is_empty() {
        let names: BTreeSet<String> = materials.iter().map(|m| format!("`{}`", m.name)).collect();
        let known =
            if names.is_empty() { "none".into() } else { names.into_iter().collect::<Vec<_>>().join(", ") };
        return Err(AppearanceError::UnknownMaterial { name: name.into(), known });
    }
    Ok(found)
}

impl<'a, T: Triangles> Appearance<'a, T> {
    /// Checks all references, and builds the hierarchy of shadows if the light has any.
    ///
    /// # Errors
    /// [`AppearanceError`].
    pub fn new(request: AppearanceRequest<'a, T>) -> Result<Self, AppearanceError> {
        let AppearanceRequest { triangles, parts, materials, textures, assigned, .. } = request;
        let mut notes = Vec::new();
        let mut surfaces = materials.iter().map(surface).collect::<Vec<_>>();
        check_textures(materials, textures.len())?;
        check_parts(parts, materials, &mut notes)?;
        assign(assigned, materials, &mut surfaces, &mut notes)?;
        if request.lighting.rays_per_site() > 0 {
            notes.extend(shadow_note(parts, materials));
        }
        let lighting = request.lighting;
        if let Background::Luminance(l) = request.background
            && !(l >= 0.0 && l.is_finite())
        {
            return Err(AppearanceError::Background(l));
        }
        let spectra: Vec<Spectrum> = assigned.iter().map(|a| a.spectrum.clone()).collect();
        Ok(Self {
            bases: bases(&spectra, lighting.spectra()),
            reflectances: COLOURS + spectra.len(),
            occluders: (lighting.rays_per_site() > 0).then(|| Occluders::new(triangles)).transpose()?,
            normal_matrices: parts.iter().map(|p| normal_matrix(p, &request.pose)).collect(),
            background: request.background,
            frame: request.frame,
            clipped: AtomicU64::new(0),
            triangles,
            parts,
            surfaces,
            textures,
            lighting,
            notes,
        })
    }
}

/// A note on materials of which a part of the light passes, whose shadows are complete.
fn shadow_note(parts: &[Part], materials: &[Material]) -> Option<String> {
    let blended =
        parts.iter().map(|part| &materials[part.material]).find(|m| m.alpha_mode == AlphaMode::Blend)?;
    Some(format!("material `{}` is blended: its surfaces cast complete shadows all the same", blended.name))
}

fn surface(material: &Material) -> Surface {
    Surface {
        colour: material.colour.map(f64::from),
        alpha: f64::from(material.alpha),
        texture: material.texture.clone(),
        alpha_mode: material.alpha_mode,
        emission: material.emission.map(f64::from),
        emission_texture: material.emission_texture.clone(),
        reflects: Reflects::Colour,
    }
}

fn textures_of(material: &Material) -> impl Iterator<Item = &TextureUse> {
    [&material.texture, &material.emission_texture].into_iter().flatten()
}

fn check_textures(materials: &[Material], count: usize) -> Result<(), AppearanceError> {
    for material in materials {
        if let Some(t) = textures_of(material).find(|t| t.texture >= count) {
            let what = format!("texture of material `{}`, number", material.name);
            return Err(AppearanceError::Missing { what, number: t.texture, count });
        }
    }
    Ok(())
}

/// Checks materials and attributes; notes textures for which there are no coordinates.
fn check_parts(
    parts: &[Part],
    materials: &[Material],
    notes: &mut Vec<String>,
) -> Result<(), AppearanceError> {
    for part in parts {
        let Some(material) = materials.get(part.material) else {
            let what = format!("material of part `{}`, number", part.name);
            return Err(AppearanceError::Missing { what, number: part.material, count: materials.len() });
        };
        let geometry = &part.geometry;
        let vertices = match &geometry.positions {
            Positions::F32(p) => p.len(),
            Positions::F64(p) => p.len(),
        };
        let sets = geometry.texcoords.iter().map(|set| ("texture coordinates", set.len()));
        let others = [("colours", geometry.colours.len()), ("normals", geometry.normals.len())];
        if let Some((what, found)) = sets.chain(others).find(|(_, n)| *n != 0 && *n != vertices) {
            return Err(AppearanceError::Attribute { part: part.name.clone(), what, found, vertices });
        }
        let lacks = |t: &&TextureUse| geometry.texcoords.get(t.set).is_none_or(|set| set.is_empty());
        if let Some(t) = textures_of(material).find(lacks) {
            notes.push(format!(
                "part `{}` has no texture coordinates of set {}: a texture of its material `{}` is not used",
                part.name, t.set, material.name
            ));
        }
    }
    Ok(())
}

fn assign(
    assigned: &[Assigned],
    materials: &[Material],
    surfaces: &mut [Surface],
    notes: &mut Vec<String>,
) -> Result<(), AppearanceError> {
    for (i, Assigned { materials: numbers, spectrum, times_texture }) in assigned.iter().enumerate() {
        for &number in numbers {
            let (Some(material), Some(surface)) = (materials.get(number), surfaces.get_mut(number)) else {
                let what = format!("material of spectrum `{}`, number", spectrum.name());
                return Err(AppearanceError::Missing { what, number, count: materials.len() });
            };
            let name = || material.name.clone();
            if let Reflects::Spectrum(r) | Reflects::SpectrumTimesTexture(r) = surface.reflects {
                let first = assigned[r - COLOURS].spectrum.name().into();
                let second = spectrum.name().into();
                return Err(AppearanceError::AssignedTwice { material: name(), first, second });
            }
            if *times_texture && material.texture.is_none() {
                return Err(AppearanceError::NoTexture {
                    material: name(),
                    spectrum: spectrum.name().into(),
                });
            }
            if !times_texture && material.texture.is_some() {
                notes.push(format!(
                    "the texture of material `{}` is ignored: its reflectance is the spectrum `{}`",
                    material.name,
                    spectrum.name()
                ));
            }
            let kind = if *times_texture { Reflects::SpectrumTimesTexture } else { Reflects::Spectrum };
            surface.reflects = kind(COLOURS + i);
        }
    }
    Ok(())
}

/// Cofactors of the matrix from the part to the camera frame: the inverse, transposed, times the determinant.
fn normal_matrix(part: &Part, pose: &Pose) -> [[f64; 3]; 3] {
    let column = |c: usize| [part.to_world[0][c], part.to_world[1][c], part.to_world[2][c]];
    let [x, y, z] = [0, 1, 2].map(|c| rotated(pose, column(c)));
    let row = |k: usize| [x[k], y[k], z[k]];
    [cross(row(1), row(2)), cross(row(2), row(0)), cross(row(0), row(1))]
}
