//! What surfaces look like: materials with their spectra, textures, and the light of the scene.

use super::environment::environment;
use super::illuminant::spectrum;
use super::prepared::{Prepared, check_memory};
use crate::args::{BackgroundArg, SceneArgs};
use crate::failure::usage;
use anyhow::{Context, Result};
use formats::sensor::film_reflectance;
use pipeline::scene::appearance::{Appearance, AppearanceRequest, Assigned, Background, materials_named};
use pipeline::scene::description::Light;
use pipeline::scene::horizon::Horizon;
use pipeline::scene::light::shadow::BUILD_BYTES_PER_TRIANGLE;
use pipeline::scene::light::{LightRequest, Lighting, Sun};
use pipeline::scene::mesh::Mesh;
use pipeline::scene::texture::Pyramid;

/// Materials and light of `args`.
///
/// # Errors
/// Light that cannot be; a spectrum times a texture that is not there.
pub fn appearance<'a>(
    args: &SceneArgs,
    prepared: &'a Prepared,
    textures: Vec<Pyramid>,
    assigned: &'a [Assigned],
) -> Result<Appearance<'a, Mesh>> {
    let lighting = lighting(args, prepared)?;
    if args.look.background == BackgroundArg::None && args.look.background_m.is_some() {
        return Err(usage("--background-m is the distance of --background, which is none"));
    }
    let background = match args.look.background {
        BackgroundArg::None => Background::None,
        BackgroundArg::Luminance(luminance) => Background::Luminance(luminance),
        BackgroundArg::Environment if args.look.environment.is_none() => {
            return Err(usage("--background environment: give the picture by --environment"));
        }
        BackgroundArg::Environment => Background::Environment,
    };
    let request = AppearanceRequest {
        triangles: &prepared.mesh,
        parts: &prepared.scene.parts,
        materials: &prepared.scene.materials,
        textures,
        assigned,
        pose: prepared.pose,
        frame: prepared.frame.clone(),
        lighting,
        background,
    };
    if request.lighting.rays_per_site() > 0 {
        let boxes = prepared.mesh.facts().triangles * BUILD_BYTES_PER_TRIANGLE;
        check_memory(&prepared.limit, prepared.bytes() + boxes, "the mesh with the boxes of its shadows")?;
    }
    Appearance::new(request).with_context(|| format!("mesh {}", args.mesh.display()))
}

/// The textures of the mesh, each with its means over larger and larger areas; they leave `prepared`.
///
/// # Errors
/// A picture without texels.
pub fn textures(prepared: &mut Prepared) -> Result<Vec<Pyramid>> {
    let levels: usize =
        prepared.scene.textures.iter().map(|texture| Pyramid::bytes_of(texture.texels.len(), true)).sum();
    let mesh = prepared.bytes();
    check_memory(&prepared.limit, mesh + levels, "the mesh with the levels of its textures")?;
    let pictures = std::mem::take(&mut prepared.scene.textures);
    Ok(pictures.into_iter().map(Pyramid::new).collect::<Result<_, _>>()?)
}

/// The spectra of `--material`.
///
/// # Errors
/// A material that the mesh lacks; a table that cannot be read.
pub fn assigned_spectra(args: &SceneArgs, prepared: &Prepared) -> Result<Vec<Assigned>> {
    let spectra = args.look.materials().map(|(text, parts)| {
        let flag = || format!("--material {text}");
        let (name, file, times_texture) = parts
            .ok_or_else(|| usage(format!("{}: expected NAME=FILE.csv or NAME=FILE.csv*texture", flag())))?;
        let materials = materials_named(&prepared.scene.materials, name)
            .map_err(|e| usage(format!("{}: {e}", flag())))?;
        let curve = film_reflectance(file).with_context(flag)?;
        let spectrum = spectrum(file, curve, 1.0).with_context(flag)?;
        Ok(Assigned { materials, spectrum, times_texture })
    });
    spectra.collect()
}

fn lighting(args: &SceneArgs, prepared: &Prepared) -> Result<Lighting> {
    let look = &args.look;
    if look.sky_samples.is_some() && look.sky.is_none() && look.environment.is_none() {
        return Err(usage(
            "--sky-samples is the number of directions of --sky and --environment, of which none is given",
        ));
    }
    let lights: &[Light] = match look.lights {
        None => &[],
        Some(_) if prepared.scene.lights.is_empty() => {
            return Err(usage(format!("--lights file: {} has no lights", args.mesh.display())));
        }
        Some(_) => &prepared.scene.lights,
    };
    let sun = look.sun.map(|sun| Sun {
        azimuth_deg: sun.azimuth_deg,
        elevation_deg: sun.elevation_deg,
        illuminance_lx: sun.illuminance_lx.unwrap_or(look.illuminance),
    });
    if sun.is_none() && look.sky.is_none() && look.environment.is_none() && lights.is_empty() {
        return Ok(Lighting::even(look.illuminance));
    }
    let horizon = Horizon::new(&prepared.pose, prepared.up);
    let environment = environment(look, &prepared.limit, horizon)?;
    let request = LightRequest {
        illuminance_lx: look.illuminance,
        sun,
        sky_lx: look.sky,
        lights,
        unit_m: prepared.unit_m,
        environment,
        sky_samples: look.sky_directions(),
    };
    Lighting::new(request, &prepared.pose, &horizon).map_err(|e| usage(e.to_string()))
}
