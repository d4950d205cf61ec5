//! The elements `face` and `tristrips`.

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::grow;
use super::super::polygon::Triangulator;
use super::super::shown::counted;
use super::elements::{self, Fault, Sink, list_length, possible_rows, skip, wrong};
use super::header::{Element, Property};
use super::rows::Rows;
use pipeline::scratch::List;

/// Faces as their file lists them.
#[derive(Default)]
pub(super) struct Faces {
    /// Corners of all faces, and where each face ends.
    corners: List<u32>,
    ends: List<u64>,
    /// Triangles of strips.
    strips: List<[u32; 3]>,
}

impl Faces {
    /// Reads faces or strips of `vertices` vertices.
    pub fn read<R: Rows>(
        &mut self,
        context: &Context<'_>,
        element: &Element,
        vertices: u64,
        rows: &mut R,
    ) -> Result<(), MeshError> {
        let is_list = |p: &Property| p.count.is_some() && p.of.is_integer();
        let is_indices =
            |p: &Property| is_list(p) && matches!(p.name.as_str(), "vertex_indices" | "vertex_index");
        let Some(index) = element.properties.iter().position(is_indices) else {
            let expected = "a list vertex_indices of whole numbers";
            return Err(context.invalid(format!("element {:?}", element.name), expected, "none"));
        };
        elements::note_skipped(context, element, |other| other == index);
        let are_strips = element.name == "tristrips";
        if !are_strips {
            self.ends = grow::list(context, "faces", possible_rows(element, rows))?;
        }
        elements::read(
            context,
            element,
            rows,
            &mut Lists { faces: self, context, index, vertices, are_strips },
        )
    }

    /// Number of faces.
    pub fn count(&self) -> usize {
        self.ends.len()
    }

    /// The triangles of all faces and strips.
    pub fn triangles(
        &self,
        context: &Context<'_>,
        position: impl Fn(u32) -> [f64; 3],
    ) -> Result<List<[u32; 3]>, MeshError> {
        let starts = || std::iter::once(0).chain(self.ends.iter().copied());
        let lengths = || starts().zip(&self.ends[..]).map(|(start, &end)| end - start);
        let count: u64 = lengths().map(|length| length.saturating_sub(2)).sum();
        if count + self.strips.len() as u64 >= u64::from(u32::MAX) {
            return Err(context.invalid("faces", "less than 4294967295 triangles", count.to_string()));
        }
        let mut triangles = grow::list(context, "triangles", count + self.strips.len() as u64)?;
        let most = lengths().max().unwrap_or(0);
        let scratch = most * Triangulator::BYTES_PER_CORNER;
        context.charge(scratch, || format!("a polygon of {most} corners"))?;
        let mut triangulator = Triangulator::default();
        for (face, (start, &end)) in starts().zip(&self.ends[..]).enumerate() {
            let corners = &self.corners[start as usize..end as usize];
            // Corners are fewer than triangles and two, or too few for any.
            let length = corners.len() as u32;
            let divided = triangulator.divide(length, |corner| position(corners[corner as usize]));
            let divided = divided.map_err(|_| {
                let expected = "polygons with fewer corners; export the mesh in triangles";
                context.invalid(
                    format!("row {face} of element \"face\""),
                    expected,
                    format!("one of {length}"),
                )
            })?;
            triangles.extend(divided.iter().map(|t| t.map(|corner| corners[corner as usize])));
        }
        context.release(scratch);
        triangles.extend(self.strips.iter().copied());
        let small = lengths().filter(|&length| length < 3).count();
        if small > 0 {
            context.note(format!("{} with less than 3 corners ignored", counted(small, "face")));
        }
        if triangulator.intersecting > 0 {
            let count = triangulator.intersecting;
            context.note(format!(
                "{} with edges that intersect, divided into fans",
                counted(count as usize, "polygon")
            ));
        }
        Ok(triangles)
    }
}

struct Lists<'a> {
    faces: &'a mut Faces,
    context: &'a Context<'a>,
    /// Of the property.
    index: usize,
    vertices: u64,
    are_strips: bool,
}

impl Lists<'_> {
    /// A vertex; `None` for a negative number.
    fn vertex<R: Rows>(&self, property: &Property, rows: &mut R) -> Result<Option<u32>, Fault> {
        let value = rows.number(property.of)?;
        match value {
            _ if value < 0.0 && self.are_strips => Ok(None),
            _ if value >= 0.0 && value < self.vertices as f64 => Ok(Some(value as u32)),
            _ if self.vertices == 0 => {
                Err(wrong("no vertex index, as there are no vertices", value.to_string()))
            }
            _ => Err(wrong(format!("a vertex index of 0 to {}", self.vertices - 1), value.to_string())),
        }
    }
}

impl Sink for Lists<'_> {
    fn property<R: Rows>(&mut self, index: usize, property: &Property, rows: &mut R) -> Result<(), Fault> {
        if index != self.index {
            return skip(property, rows);
        }
        let length = list_length(property, rows)?;
        // The last two vertices of a strip, and the number of its triangles.
        let (mut last, mut count) = ([None; 2], 0u64);
        for _ in 0..length {
            let vertex = self.vertex(property, rows)?;
            match (self.are_strips, vertex) {
                (false, Some(vertex)) => {
                    grow::push(self.context, "corners", &mut self.faces.corners, vertex)?
                }
                (false, None) => {}
                (true, None) => (last, count) = ([None; 2], 0),
                (true, Some(c)) => {
                    if let [Some(a), Some(b)] = last {
                        let triangle = if count % 2 == 0 { [a, b, c] } else { [b, a, c] };
                        if a != b && b != c && a != c {
                            grow::push(self.context, "triangles", &mut self.faces.strips, triangle)?;
                        }
                        count += 1;
                    }
                    last = [last[1], Some(c)];
                }
            }
        }
        Ok(())
    }

    fn end(&mut self) -> Result<(), Fault> {
        if !self.are_strips {
            self.faces.ends.push(self.faces.corners.len() as u64);
        }
        Ok(())
    }
}
