//! The element `vertex`.

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::grow;
use super::super::shown::shown;
use super::elements::{self, Fault, Sink, possible_rows, skip, wrong};
use super::header::{Element, Property, Type};
use super::rows::Rows;
use pipeline::colour::srgb_decode;
use pipeline::scene::description::{Geometry, Positions};

// Places of the numbers of a vertex that are read.
const NORMAL: usize = 3;
const COLOUR: usize = 6;
const ALPHA: usize = 9;
const TEXCOORD: usize = 10;
const NUMBERS: usize = 12;

const COLOURS: [[&str; 3]; 3] =
    [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];
const ALPHAS: [[&str; 1]; 3] = [["alpha"], ["diffuse_alpha"], ["a"]];
const TEXCOORDS: [[&str; 2]; 3] = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]];

/// Reads the vertices into the geometry.
pub(super) fn read<R: Rows>(
    context: &Context<'_>,
    element: &Element,
    rows: &mut R,
) -> Result<Geometry, MeshError> {
    let mut places = vec![None; element.properties.len()];
    let mut place = |names: &[&str], first: usize| {
        let find = |name: &&str| element.properties.iter().position(|p| p.name == *name && p.count.is_none());
        let indices: Option<Vec<usize>> = names.iter().map(find).collect();
        for (k, &index) in indices.iter().flatten().enumerate() {
            places[index] = Some(first + k);
        }
        indices
    };
    let Some(xyz) = place(&["x", "y", "z"], 0) else {
        let names: Vec<_> = element.properties.iter().take(8).map(|p| shown(&p.name)).collect();
        return Err(context.invalid("element \"vertex\"", "properties x, y and z", names.join(", ")));
    };
    let has_normals = place(&["nx", "ny", "nz"], NORMAL).is_some();
    let has_colours = COLOURS.iter().any(|names| place(names, COLOUR).is_some());
    let has_alpha = has_colours && ALPHAS.iter().any(|names| place(names, ALPHA).is_some());
    let has_texcoords = TEXCOORDS.iter().any(|names| place(names, TEXCOORD).is_some());
    elements::note_skipped(context, element, |index| places[index].is_some());

    let is_double =
        xyz.iter().any(|&i| matches!(element.properties[i].of, Type::F64 | Type::I32 | Type::U32));
    let count = possible_rows(element, rows);
    let mut geometry = Geometry {
        positions: match is_double {
            true => Positions::F64(grow::list(context, "positions", count)?),
            false => Positions::F32(grow::list(context, "positions", count)?),
        },
        ..Geometry::default()
    };
    if has_normals {
        geometry.normals = grow::list(context, "normals", count)?;
    }
    if has_colours {
        geometry.colours = grow::list(context, "colours", count)?;
    }
    if has_texcoords {
        geometry.texcoords.push(grow::list(context, "texture coordinates", count)?);
    }
    let decoded: Vec<f64> = (0..=255u8).map(|v| srgb_decode(f64::from(v) / 255.0)).collect();
    let mut values = [0.0; NUMBERS];
    values[ALPHA] = 1.0;
    let mut sink = Vertices { geometry, places, values, decoded, has_normals, has_colours, beyond: 0 };
    elements::read(context, element, rows, &mut sink)?;
    if sink.beyond > 0 {
        context.note(format!(
            "vertices whose colours are outside 0…1 and are clipped: {}; colours of 0…255 must be divided by 255",
            sink.beyond
        ));
    }
    let colours = &mut sink.geometry.colours;
    if has_alpha && !colours.is_empty() && colours.iter().all(|colour| colour[3] == 0.0) {
        colours.iter_mut().for_each(|colour| colour[3] = 1.0);
        context.note("the alpha of all vertices is 0, and is ignored");
    }
    Ok(sink.geometry)
}

struct Vertices {
    geometry: Geometry,
    /// Of each property.
    places: Vec<Option<usize>>,
    values: [f64; NUMBERS],
    /// Linear values of sRGB codes of 8 bits.
    decoded: Vec<f64>,
    has_normals: bool,
    has_colours: bool,
    /// Vertices whose colours are outside 0…1.
    beyond: u64,
}

impl Sink for Vertices {
    fn property<R: Rows>(&mut self, index: usize, property: &Property, rows: &mut R) -> Result<(), Fault> {
        let Some(place) = self.places[index] else { return skip(property, rows) };
        let value = rows.number(property.of)?;
        // f32 is what most are stored in.
        if !value.is_finite() || (place >= NORMAL && !(value as f32).is_finite()) {
            return Err(wrong(format!("a finite number {}", shown(&property.name)), value.to_string()));
        }
        self.values[place] = match (place, property.of) {
            (COLOUR..ALPHA, of) if of.is_integer() => match of {
                Type::U16 => srgb_decode(value / 65_535.0),
                _ => self.decoded[value.clamp(0.0, 255.0) as usize],
            },
            (ALPHA, Type::U16) => value / 65_535.0,
            (ALPHA, of) if of.is_integer() => (value / 255.0).clamp(0.0, 1.0),
            (ALPHA, _) => value.clamp(0.0, 1.0),
            _ => value,
        };
        Ok(())
    }

    fn end(&mut self) -> Result<(), Fault> {
        let Self { geometry, values, .. } = self;
        let single = |at: usize| values[at] as f32;
        match &mut geometry.positions {
            Positions::F64(positions) => positions.push([values[0], values[1], values[2]]),
            Positions::F32(positions) => positions.push([single(0), single(1), single(2)]),
        }
        if self.has_normals {
            geometry.normals.push([single(NORMAL), single(NORMAL + 1), single(NORMAL + 2)]);
        }
        if self.has_colours {
            let colour = &values[COLOUR..ALPHA];
            self.beyond += u64::from(colour.iter().any(|v| !(0.0..=1.0).contains(v)));
            geometry.colours.push([single(COLOUR), single(COLOUR + 1), single(COLOUR + 2), single(ALPHA)]);
        }
        if let Some(set) = geometry.texcoords.first_mut() {
            set.push([single(TEXCOORD), (1.0 - values[TEXCOORD + 1]) as f32]);
        }
        Ok(())
    }
}
