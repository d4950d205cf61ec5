//! Elements to a scene.

use std::sync::Arc;

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::shown::{counted, shown};
use super::elements::{self, Skip};
use super::faces::Faces;
use super::header::Header;
use super::rows::Rows;
use super::vertices;
use pipeline::scene::description::{AlphaMode, Geometry, Material, Part, Positions, Scene};

/// Colour of surfaces without colour.
const GREY: f32 = 0.8;
/// Elements that a note names.
const MAX_NAMES: usize = 5;
const IDENTITY: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

/// What the elements hold.
pub(super) struct Mesh {
    geometry: Geometry,
    faces: Faces,
}

impl Mesh {
    pub fn read(context: &Context<'_>, header: &Header, mut rows: impl Rows) -> Result<Self, MeshError> {
        let declared = header.elements.iter().find(|e| e.name == "vertex").map_or(0, |e| e.rows);
        let mut mesh = Self { geometry: Geometry::default(), faces: Faces::default() };
        let mut skipped = Vec::new();
        for element in &header.elements {
            match element.name.as_str() {
                "vertex" => mesh.geometry = vertices::read(context, element, &mut rows)?,
                "face" | "tristrips" => mesh.faces.read(context, element, declared, &mut rows)?,
                _ => {
                    elements::read(context, element, &mut rows, &mut Skip)?;
                    skipped.push(element);
                }
            }
        }
        if !skipped.is_empty() {
            let names = skipped
                .iter()
                .take(MAX_NAMES)
                .map(|e| format!("{} ({})", shown(&e.name), counted(e.rows as usize, "row")));
            let more = if skipped.len() > MAX_NAMES { " and others" } else { "" };
            context.note(format!("elements {}{more} are ignored", names.collect::<Vec<_>>().join(", ")));
        }
        if rows.has_more() {
            context.note("the file has more data than its header declares; they are ignored");
        }
        Ok(mesh)
    }

    pub fn into_scene(self, context: &Context<'_>) -> Result<Scene, MeshError> {
        let Self { mut geometry, faces } = self;
        geometry.triangles = match &geometry.positions {
            Positions::F32(p) => faces.triangles(context, |i| p[i as usize].map(f64::from))?,
            Positions::F64(p) => faces.triangles(context, |i| p[i as usize])?,
        };
        if geometry.triangles.is_empty() {
            let vertices = match &geometry.positions {
                Positions::F32(p) => p.len(),
                Positions::F64(p) => p.len(),
            };
            let found = format!("vertices: {vertices}, faces: {}", faces.count());
            return Err(MeshError::Empty { path: context.path.into(), found });
        }
        let is_coloured = !geometry.colours.is_empty();
        if !is_coloured {
            context.note("vertices without colour are 0.8 grey");
        }
        let is_opaque = geometry.colours.iter().all(|colour| colour[3] == 1.0);
        let alpha_mode = if is_opaque { AlphaMode::Opaque } else { AlphaMode::Blend };
        let colour = [if is_coloured { 1.0 } else { GREY }; 3];
        let material = Material { alpha_mode, ..Material::matt(String::new(), colour) };
        let name = context.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let geometry = Arc::new(geometry);
        let part = Part { name, node: 0, to_world: IDENTITY, geometry, material: 0 };
        Ok(Scene { parts: vec![part], materials: vec![material], ..Scene::default() })
    }
}
