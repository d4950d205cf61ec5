//! PLY, ascii and binary. Source: G. Turk, "The PLY polygon file format" (1994), and files of MeshLab, Blender, VTK.
//!
//! | element | properties | read as |
//! |---|---|---|
//! | `vertex` | `x y z` | position: f32, or f64 if one of them is a double or 32-bit integer |
//! | | `nx ny nz` | normal |
//! | | `red green blue [alpha]`, also with `diffuse_` | floats are linear, integers sRGB coded: 255 (16 bits: 65535) is 1; alpha is linear |
//! | | `s t`, `u v`, `texture_u texture_v` | texture coordinates; t goes up in the file, down here: 1 − t |
//! | `face` | list `vertex_indices` or `vertex_index` | polygon, divided into triangles |
//! | `tristrips` | the same list | strips that end at a negative index; every second triangle is reversed |
//!
//! Other elements and properties are skipped. Both sides of all triangles are surfaces. An alpha below 1 is a share of coverage.

mod elements;
mod faces;
mod header;
mod mesh;
mod rows;
#[cfg(test)]
mod tests;
mod vertices;

use std::path::Path;

use super::context::Context;
use super::error::MeshError;
use super::grow;
use super::limits::Limits;
use super::source::SourceFile;
use super::source::read_file;
use header::{Encoding, Header};
use mesh::Mesh;
use pipeline::scene::description::Scene;
use rows::{Ascii, Binary};

/// Reads a PLY file. Positions are in the file's unit.
///
/// # Errors
/// [`MeshError`] with the line, or the byte, of what is wrong; also if there are no triangles.
pub fn read_ply(path: &Path, limits: &Limits) -> Result<(Scene, Vec<SourceFile>), MeshError> {
    let context = Context::new(path, limits);
    let bytes = read_file(&context, path, path)?;
    let header = Header::read(&context, &bytes)?;
    let body = &bytes[header.body..];
    let mesh = match header.encoding {
        Encoding::Ascii => Mesh::read(&context, &header, Ascii::new(body, header.lines))?,
        Encoding::Little => Mesh::read(&context, &header, Binary::new(body, header.body, true))?,
        Encoding::Big => Mesh::read(&context, &header, Binary::new(body, header.body, false))?,
    };
    grow::free(&context, bytes);
    let mut scene = mesh.into_scene(&context)?;
    scene.notes = context.take_notes();
    Ok((scene, context.sources.take()))
}
