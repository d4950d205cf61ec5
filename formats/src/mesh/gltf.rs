//! glTF 2.0 (Khronos specification 2.0.1; ISO/IEC 12113:2022), `.glb` and `.gltf`.
//!
//! Positions are in metres, +Y up, counter-clockwise triangles seen from the front. Of a file the default scene is read, else the first,
//! else all root nodes; its nodes depth first, the primitives of a node in order. Matrices are products of the file's numbers in f64.
//!
//! | module | content |
//! |---|---|
//! | `container`, `json` | the chunks of a `.glb`; the JSON text as types |
//! | `extension` | extensions that are read, ignored or refused |
//! | `document` | objects by number, buffers |
//! | `accessor`, `element` | values in buffers, sparse and normalised ones |
//! | `graph`, `matrix` | nodes in order, with the products of their matrices |
//! | `primitive`, `topology` | triangles of a primitive |
//! | `material`, `image` | colours, textures |
//! | `camera`, `light` | cameras and lights of a node |
//!
//! Extensions read: `KHR_lights_punctual`, `KHR_materials_emissive_strength`, `KHR_materials_pbrSpecularGlossiness` (its diffuse part),
//! `KHR_materials_unlit`, `KHR_mesh_quantization`, `KHR_texture_transform`, `EXT_texture_webp`. Left out, with a note each: normal,
//! occlusion and metallic-roughness textures, other material extensions, skins, morph targets, animations, points and lines.

mod accessor;
mod camera;
mod container;
mod document;
mod element;
mod extension;
mod graph;
mod image;
mod json;
mod light;
mod material;
mod matrix;
mod primitive;
mod topology;

use std::path::Path;
use std::sync::Arc;

use super::context::Context;
use super::error::MeshError;
use super::limits::Limits;
use super::shown::counted;
use super::source::SourceFile;
use super::source::read_file;
use document::Document;
use graph::Placed;
use material::Materials;
use pipeline::scene::description::{Camera, Light, Part, Scene};
use pipeline::scene::mesh::MAX_TRIANGLES;
use primitive::Primitives;

/// Reads the scene of the glTF file `path`, and lists the files it consists of, this one first.
///
/// Textures are read of the materials that parts use; the others have none. A primitive without a material and without vertex colours
/// gets a material of 0.8 grey, one with vertex colours a white one, both behind those of the file.
///
/// # Errors
/// See [`MeshError`]: an extension that is required and not supported, before all else; content that the format does not allow; files
/// that are missing or refused; more memory than the limits; no triangles.
pub fn read_gltf(path: &Path, limits: &Limits) -> Result<(Scene, Vec<SourceFile>), MeshError> {
    let context = Context::new(path, limits);
    let bytes = read_file(&context, path, path)?;
    let container = container::split(&context, &bytes)?;
    json::charge(&context, container.json)?;
    extension::check_required(&context, container.json)?;
    let json = json::parse(&context, container.json)?;
    let document = Document::new(&context, json, container.binary);
    extension::note_used(&document);
    let mut scene = Scene::default();
    let mut reading = Reading { document: &document, primitives: Primitives::new(&document), triangles: 0 };
    let mut materials = Materials::new(&document)?;
    for placed in graph::nodes(&document)? {
        reading.node(&mut scene, &mut materials, &placed)?;
    }
    reading.primitives.note();
    if scene.parts.is_empty() {
        return Err(MeshError::Empty { path: path.into(), found: contents(&document) });
    }
    (scene.materials, scene.textures) = materials.finish()?;
    scene.notes = context.take_notes();
    drop(document);
    Ok((scene, context.sources.take()))
}

struct Reading<'d, 'a> {
    document: &'d Document<'a>,
    primitives: Primitives<'d, 'a>,
    /// Of the parts so far.
    triangles: u64,
}

impl Reading<'_, '_> {
    /// Adds the parts, the camera and the light of a node.
    fn node(
        &mut self,
        scene: &mut Scene,
        materials: &mut Materials<'_, '_>,
        placed: &Placed,
    ) -> Result<(), MeshError> {
        let (document, node) = (self.document, &self.document.json.nodes[placed.node]);
        let place = || format!("nodes[{}]", placed.node);
        if let Some(number) = node.mesh {
            let mesh = document.object(&document.json.meshes, number, "meshes", &place)?;
            let name = node.name.as_deref().or(mesh.1.name.as_deref());
            let name = name.map_or_else(|| format!("node {}", placed.node), str::to_owned);
            for primitive in 0..mesh.1.primitives.len() {
                self.part(scene, materials, placed, &name, [mesh.0, primitive])?;
            }
        }
        if let Some(number) = node.camera {
            let (number, camera) = document.object(&document.json.cameras, number, "cameras", &place)?;
            let name = node.name.as_deref().or(camera.name.as_deref());
            let name = name.map_or_else(|| format!("camera {}", scene.cameras.len()), str::to_owned);
            document.context.charge(2 * (size_of::<Camera>() + name.len()) as u64, place)?;
            let yfov_rad = camera::vertical_field(document.context, number, camera)?;
            scene.cameras.push(Camera { name, to_world: placed.to_world, yfov_rad });
        }
        if let Some(used) = &node.extensions.khr_lights_punctual {
            let lights = &document.json.extensions.khr_lights_punctual.lights;
            let list = "extensions.KHR_lights_punctual.lights";
            let (number, light) = document.object(lights, used.light, list, &place)?;
            let name = node.name.as_deref().or(light.name.as_deref());
            let name = name.map_or_else(|| format!("light {}", scene.lights.len()), str::to_owned);
            document.context.charge(2 * (size_of::<Light>() + name.len()) as u64, place)?;
            let (colour, intensity, kind) = light::photometry(document.context, number, light)?;
            scene.lights.push(Light { name, to_world: placed.to_world, colour, intensity, kind });
        }
        Ok(())
    }

    /// Adds the triangles of a primitive at a node.
    fn part(
        &mut self,
        scene: &mut Scene,
        materials: &mut Materials<'_, '_>,
        placed: &Placed,
        name: &str,
        [mesh, primitive]: [usize; 2],
    ) -> Result<(), MeshError> {
        let context = self.document.context;
        let place = || format!("nodes[{}], meshes[{mesh}].primitives[{primitive}]", placed.node);
        let Some((geometry, material)) = self.primitives.read(mesh, primitive, materials)? else {
            return Ok(());
        };
        self.triangles += geometry.triangles.len() as u64;
        if self.triangles > MAX_TRIANGLES as u64 {
            let found = format!("{} with this one", self.triangles);
            return Err(context.invalid(
                place(),
                format!("at most {MAX_TRIANGLES} triangles in all instances"),
                found,
            ));
        }
        // Twice: a list that grows is copied.
        context.charge(2 * (size_of::<Part>() + name.len()) as u64, place)?;
        scene.parts.push(Part {
            name: name.into(),
            // Fewer than the file has bytes, which fit into memory; numbers beyond 32 bits do not occur below 2³² nodes of 100 bytes.
            node: u32::try_from(placed.node).unwrap_or(u32::MAX),
            to_world: placed.to_world,
            geometry: Arc::clone(&geometry),
            material,
        });
        Ok(())
    }
}

/// What a file without triangles holds, and the notes on it.
fn contents(document: &Document<'_>) -> String {
    let json = &document.json;
    let primitives = json.meshes.iter().map(|mesh| mesh.primitives.len()).sum();
    let mut found = vec![
        counted(json.scenes.len(), "scene"),
        counted(json.nodes.len(), "node"),
        if json.meshes.len() == 1 { "1 mesh".into() } else { format!("{} meshes", json.meshes.len()) },
        counted(primitives, "primitive"),
    ];
    found.extend(document.context.take_notes());
    found.join(", ")
}

#[cfg(test)]
mod tests;
