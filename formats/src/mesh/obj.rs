//! Wavefront OBJ. Source: Wavefront Technologies, Advanced Visualizer manual, appendix B1 (Object files) and its MTL specification.
//!
//! | statement | read as |
//! |---|---|
//! | `v x y z [w]`, `v x y z r g b` | position in f64 (w is not applied), sRGB coded colour 0…1, as Blender and MeshLab write it |
//! | `vt u [v]` | texture coordinates; v goes up in the file, down here: 1 − v |
//! | `vn x y z` | normal |
//! | `f v v/vt v//vn v/vt/vn …` | polygon, divided into triangles; indices from 1, or −1 for the last vertex so far |
//! | `o`, `g`, `usemtl` | a part per object, group and material, in the order of the first face |
//! | `mtllib` | materials; several names, or one with spaces |
//! | `p`, `l`, `curv`, `curv2`, `surf` | ignored and counted |
//!
//! Faces with and without texture coordinates, or normals, are parts of their own. Both sides of all triangles are surfaces. Colours of
//! vertices are factors of those of the materials. A line may end with a backslash and continue on the next. A `#` at the start of a word
//! of numbers starts a comment; names extend to the end of the line.
//!
//! The text is read three times: statements are counted, so that lists are allocated in their size; vertices; faces. Faces may thus name
//! vertices that follow.

mod faces;
mod findings;
mod material;
mod mtl;
mod parts;
#[cfg(test)]
mod tests;
mod vertices;

use std::path::Path;

use super::context::Context;
use super::error::MeshError;
use super::grow;
use super::limits::Limits;
use super::source::SourceFile;
use super::text;
use faces::Faces;
use mtl::Library;
use pipeline::scene::description::Scene;
use vertices::{Counts, Vertices};

/// Reads an OBJ file with the materials and textures that it names. Positions are in the file's unit.
///
/// # Errors
/// [`MeshError`] with the line of what is wrong; also if there are no triangles.
pub fn read_obj(path: &Path, limits: &Limits) -> Result<(Scene, Vec<SourceFile>), MeshError> {
    let context = Context::new(path, limits);
    let text = text::read(&context, path, path)?;
    let counts = Counts::of(&text);
    let mut vertices = Vertices::read(&context, &text, &counts)?;
    let faces = Faces::read(&context, &text, &counts, &vertices)?;
    grow::free(&context, text);
    if faces.triangles.is_empty() {
        let found = format!("vertices: {}, faces: {}{}", counts.positions, faces.polygons, faces.others());
        return Err(MeshError::Empty { path: path.into(), found });
    }
    vertices.note_colours(&context, &faces.triangles);
    faces.add_notes(&context);
    let mut library = Library::read(&context, &faces.libraries)?;
    let mut scene = Scene::default();
    let are_coloured = !vertices.colours.is_empty();
    let numbers =
        material::add_materials(&context, &mut library, faces.material_names(), are_coloured, &mut scene)?;
    scene.parts = parts::build(&context, &vertices, &faces, &numbers)?;
    scene.notes = context.take_notes();
    Ok((scene, context.sources.take()))
}

/// What is wrong in line `line` of `path`.
fn invalid(path: &Path, line: u64, expected: impl Into<String>, found: impl Into<String>) -> MeshError {
    let (expected, found) = (expected.into(), found.into());
    MeshError::Invalid { path: path.into(), place: format!("line {line}"), expected, found }
}

/// Up to `N` numbers, up to a comment, and how many there are.
fn numbers<const N: usize>(path: &Path, line: u64, text: &[u8]) -> Result<([f64; N], usize), MeshError> {
    let (mut values, mut count) = ([0.0; N], 0);
    for word in text::words(text).take_while(|word| word[0] != b'#') {
        let Some(value) = text::number(word) else {
            return Err(invalid(path, line, text::expected_number(word), text::quote(word)));
        };
        let Some(place) = values.get_mut(count) else {
            return Err(invalid(path, line, format!("at most {N} numbers"), text::quote(text)));
        };
        (*place, count) = (value, count + 1);
    }
    Ok((values, count))
}

/// A finite f32.
fn single(path: &Path, line: u64, value: f64) -> Result<f32, MeshError> {
    let single = value as f32;
    match single.is_finite() {
        true => Ok(single),
        false => Err(invalid(path, line, "at most 3.4e38", value.to_string())),
    }
}
