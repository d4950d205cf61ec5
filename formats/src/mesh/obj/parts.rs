//! Triangles of a file to parts, each with vertices of its own.
//!
//! A vertex is a position with its texture coordinates and normal; its number is that of its first corner in the part.

use std::collections::HashMap;
use std::sync::Arc;

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::grow;
use super::faces::{Corner, Faces, NONE, PartKey};
use super::vertices::Vertices;
use pipeline::scene::description::{Geometry, Part, Positions};
use pipeline::scratch::List;

/// Memory of an entry of [`Numbering::others`]: 17 bytes at a load of 7/8, twice that after growth, with the table before it.
const ENTRY_BYTES: u64 = 64;
const IDENTITY: [[f64; 4]; 4] =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

/// The parts; `materials` has the number of each one's material.
pub(super) fn build(
    context: &Context<'_>,
    vertices: &Vertices,
    faces: &Faces,
    materials: &[usize],
) -> Result<Vec<Part>, MeshError> {
    // Triangles in the order of their parts.
    let mut ends = vec![0usize; faces.parts.len() + 1];
    faces.part.iter().for_each(|&part| ends[part as usize + 1] += 1);
    for part in 0..faces.parts.len() {
        ends[part + 1] += ends[part];
    }
    let mut next = ends.clone();
    let mut order = grow::zeros(context, "triangles", faces.triangles.len() as u64)?;
    for (triangle, &part) in faces.part.iter().enumerate() {
        order[next[part as usize]] = triangle as u32;
        next[part as usize] += 1;
    }
    let mut numbering = Numbering::new(context, vertices.positions.len())?;
    let mut parts = Vec::with_capacity(faces.parts.len());
    for (number, (key, node)) in faces.parts.iter().enumerate() {
        let triangles = &order[ends[number]..ends[number + 1]];
        let geometry = numbering.geometry(context, vertices, faces, key, triangles)?;
        let (name, node) = (part_name(context, key), *node);
        parts.push(Part {
            name,
            node,
            to_world: IDENTITY,
            geometry: Arc::new(geometry),
            material: materials[number],
        });
    }
    Ok(parts)
}

/// Object and group, or the name of the file.
fn part_name(context: &Context<'_>, key: &PartKey) -> String {
    match (key.object.as_str(), key.group.as_str()) {
        ("", "") => context.path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        ("", name) | (name, "") => name.into(),
        (object, group) if object == group => object.into(),
        (object, group) => format!("{object}/{group}"),
    }
}

/// Numbers of vertices in a part.
struct Numbering {
    /// Of each position: the first vertex there.
    first: List<u32>,
    /// Vertices of the part.
    corners: List<Corner>,
    /// Further vertices at a position.
    others: HashMap<Corner, u32>,
}

impl Numbering {
    fn new(context: &Context<'_>, positions: usize) -> Result<Self, MeshError> {
        let mut first = grow::list(context, "numbers of vertices", positions as u64)?;
        first.resize(positions, NONE);
        Ok(Self { first, corners: List::default(), others: HashMap::new() })
    }

    fn geometry(
        &mut self,
        context: &Context<'_>,
        vertices: &Vertices,
        faces: &Faces,
        key: &PartKey,
        triangles: &[u32],
    ) -> Result<Geometry, MeshError> {
        let mut numbered = grow::list(context, "triangles", triangles.len() as u64)?;
        for &triangle in triangles {
            let [a, b, c] = faces.triangles[triangle as usize].map(|corner| self.number(context, corner));
            numbered.push([a?, b?, c?]);
        }
        let count = self.corners.len() as u64;
        let mut positions = grow::list(context, "positions", count)?;
        positions.extend(self.corners.iter().map(|c| vertices.positions[c[0] as usize]));
        let mut geometry =
            Geometry { positions: Positions::F64(positions), triangles: numbered, ..Geometry::default() };
        if key.has_texcoords {
            let mut set = grow::list(context, "texture coordinates", count)?;
            set.extend(self.corners.iter().map(|c| vertices.texcoords[c[1] as usize]));
            geometry.texcoords.push(set);
        }
        if key.has_normals {
            geometry.normals = grow::list(context, "normals", count)?;
            geometry.normals.extend(self.corners.iter().map(|c| vertices.normals[c[2] as usize]));
        }
        if !vertices.colours.is_empty() {
            geometry.colours = grow::list(context, "colours", count)?;
            geometry.colours.extend(self.corners.iter().map(|c| vertices.colours[c[0] as usize]));
        }
        self.clear(context);
        Ok(geometry)
    }

    fn number(&mut self, context: &Context<'_>, corner: Corner) -> Result<u32, MeshError> {
        let next = self.corners.len() as u32;
        let first = &mut self.first[corner[0] as usize];
        match *first {
            NONE => *first = next,
            number if self.corners[number as usize] == corner => return Ok(number),
            _ => {
                if let Some(&number) = self.others.get(&corner) {
                    return Ok(number);
                }
                context.charge(ENTRY_BYTES, || "numbers of vertices".into())?;
                self.others.insert(corner, next);
            }
        }
        grow::push(context, "vertices of a part", &mut self.corners, corner)?;
        Ok(next)
    }

    /// Ends a part.
    fn clear(&mut self, context: &Context<'_>) {
        self.corners.iter().for_each(|corner| self.first[corner[0] as usize] = NONE);
        self.corners.resize(0, [0; 3]);
        context.release(self.others.len() as u64 * ENTRY_BYTES);
        // Not `clear`, whose time is that of the largest part.
        self.others = HashMap::new();
    }
}
