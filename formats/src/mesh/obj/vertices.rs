//! Statements are counted, vertices read.

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::grow;
use super::super::text::{Lines, keyword, quote, words};
use super::faces::Corner;
use super::{invalid, numbers, single};
use pipeline::colour::srgb_decode;
use pipeline::scratch::List;

/// Numbers of statements.
#[derive(Default)]
pub(super) struct Counts {
    pub positions: u64,
    pub texcoords: u64,
    pub normals: u64,
    /// Triangles, at most.
    pub triangles: u64,
}

impl Counts {
    pub fn of(text: &[u8]) -> Self {
        let mut counts = Self::default();
        let mut lines = Lines::new(text);
        while let Some((_, line)) = lines.next() {
            let (word, rest) = keyword(line);
            match word {
                b"v" => counts.positions += 1,
                b"vt" => counts.texcoords += 1,
                b"vn" => counts.normals += 1,
                b"f" | b"fo" => counts.triangles += (words(rest).count() as u64).saturating_sub(2),
                _ => {}
            }
        }
        counts
    }
}

/// All vertices of a file, by index − 1.
pub(super) struct Vertices {
    pub positions: List<[f64; 3]>,
    pub texcoords: List<[f32; 2]>,
    pub normals: List<[f32; 3]>,
    /// Per position; empty without. The fourth number is [`UNCOLOURED`] or [`BEYOND`] for a note, else 1.
    pub colours: List<[f32; 4]>,
}

/// Mark of a position without colour.
const UNCOLOURED: f32 = 2.0;
/// Mark of a position whose colour is outside 0…1.
const BEYOND: f32 = 3.0;

impl Vertices {
    pub fn read(context: &Context<'_>, text: &[u8], counts: &Counts) -> Result<Self, MeshError> {
        let path = context.path;
        let largest = counts.positions.max(counts.texcoords).max(counts.normals).max(counts.triangles);
        if largest >= u64::from(u32::MAX) {
            return Err(context.invalid(
                "vertices and triangles",
                "less than 4294967295",
                largest.to_string(),
            ));
        }
        let mut all = Self {
            positions: grow::list(context, "positions", counts.positions)?,
            texcoords: grow::list(context, "texture coordinates", counts.texcoords)?,
            normals: grow::list(context, "normals", counts.normals)?,
            colours: List::default(),
        };
        let mut weighted = 0u64;
        let mut lines = Lines::new(text);
        while let Some((line, statement)) = lines.next() {
            let (word, rest) = keyword(statement);
            let wrong = |expected: &str| Err(invalid(path, line, expected, quote(statement)));
            match word {
                b"v" => {
                    let (values, count) = numbers::<6>(path, line, rest)?;
                    let [x, y, z, r, g, b] = values;
                    match count {
                        3 => {}
                        4 => weighted += u64::from(r != 1.0),
                        6 => {
                            if all.colours.is_empty() {
                                all.colours = grow::list(context, "colours", counts.positions)?;
                            }
                            all.colours.resize(all.positions.len(), [1.0, 1.0, 1.0, UNCOLOURED]);
                            let is_beyond = [r, g, b].iter().any(|v| !(0.0..=1.0).contains(v));
                            let [r, g, b] = [r, g, b].map(|v| srgb_decode(v) as f32);
                            all.colours.push([r, g, b, if is_beyond { BEYOND } else { 1.0 }]);
                        }
                        _ => return wrong("v with 3 coordinates, a weight or 3 colour values after them"),
                    }
                    all.positions.push([x, y, z]);
                }
                b"vt" => {
                    let (values, count) = numbers::<3>(path, line, rest)?;
                    if count == 0 {
                        return wrong("vt with 1 to 3 coordinates");
                    }
                    all.texcoords
                        .push([single(path, line, values[0])?, single(path, line, 1.0 - values[1])?]);
                }
                b"vn" => {
                    let (values, count) = numbers::<3>(path, line, rest)?;
                    if count != 3 {
                        return wrong("vn with 3 components");
                    }
                    let [x, y, z] = values.map(|v| single(path, line, v));
                    all.normals.push([x?, y?, z?]);
                }
                _ => {}
            }
        }
        if !all.colours.is_empty() {
            all.colours.resize(all.positions.len(), [1.0, 1.0, 1.0, UNCOLOURED]);
        }
        if weighted > 0 {
            context.note(format!("vertices whose weight (w) is not applied: {weighted}"));
        }
        Ok(all)
    }

    /// Notes on the colours of the corners of `triangles`, and removes the marks.
    pub fn note_colours(&mut self, context: &Context<'_>, triangles: &[[Corner; 3]]) {
        let (mut uncoloured, mut beyond) = (0u64, 0u64);
        for corner in triangles.iter().flatten() {
            let Some([.., mark]) = self.colours.get_mut(corner[0] as usize) else { continue };
            uncoloured += u64::from(*mark == UNCOLOURED);
            beyond += u64::from(*mark == BEYOND);
            *mark = 1.0;
        }
        self.colours.iter_mut().for_each(|colour| colour[3] = 1.0);
        if uncoloured > 0 {
            context.note(format!("vertices without colour are white: {uncoloured}"));
        }
        if beyond > 0 {
            context.note(format!(
                "vertices whose colours are outside 0…1 and are clipped: {beyond}; colours of 0…255 must be divided by 255"
            ));
        }
    }
}
