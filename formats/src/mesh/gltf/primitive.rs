//! Triangles of a primitive with positions, texture coordinates, colours and normals of their vertices (glTF 2.0, 3.7.2).
//!
//! Memory is proportional to the indices: of a buffer of vertices that many primitives share, each takes the vertices that it uses, in
//! order. Numbers of vertices in messages are those of the file. Of the texture coordinates the sets that the material uses are read.

use std::collections::HashMap;
use std::sync::Arc;

use super::super::error::MeshError;
use super::super::grow;
use super::super::shown::counted;
use super::accessor::{Accessor, Selection};
use super::document::Document;
use super::element::Component;
use super::json::{Attributes, Primitive};
use super::material::Materials;
use super::topology::Topology;
use pipeline::scene::description::{Geometry, Positions};
use pipeline::scratch::List;

/// A primitive of triangles, and the number of its material.
type Read = Option<(Arc<Geometry>, usize)>;

/// The primitives of a file; each is read once.
pub(super) struct Primitives<'d, 'a> {
    document: &'d Document<'a>,
    read: HashMap<[usize; 2], Read>,
    left_out: LeftOut,
}

/// Triangles, and the vertices of the file that they number, if not all.
type Indexed = (List<[u32; 3]>, Option<List<u32>>);

/// Numbers of what is not read.
#[derive(Default)]
struct LeftOut {
    points: usize,
    lines: usize,
    without_positions: usize,
    morphed: usize,
    incomplete: usize,
    without_bounds: usize,
    zero_normals: usize,
    without_texcoords: usize,
}

/// A primitive about to be read.
struct Reader<'p, 'd, 'a> {
    document: &'d Document<'a>,
    json: &'d Primitive,
    mesh: usize,
    number: usize,
    left_out: &'p mut LeftOut,
}

/// What an attribute may consist of.
struct Allowed {
    components: &'static [usize],
    types: &'static [Component],
    /// Whether integers are normalised.
    is_normalised: bool,
    /// Whether integers need [`QUANTIZATION`].
    is_quantised: bool,
    expected: &'static str,
}

/// The extension with integers in positions and normals.
const QUANTIZATION: &str = "KHR_mesh_quantization";

const POSITION: Allowed = Allowed {
    components: &[3],
    types: &[Component::F32, Component::I8, Component::U8, Component::I16, Component::U16],
    is_normalised: false,
    is_quantised: true,
    expected: "VEC3 of FLOAT, or of integers of 8 or 16 bits (KHR_mesh_quantization)",
};
const TEXCOORD: Allowed = Allowed {
    components: &[2],
    types: &[Component::F32, Component::I8, Component::U8, Component::I16, Component::U16],
    is_normalised: false,
    is_quantised: false,
    expected: "VEC2 of FLOAT, or of integers of 8 or 16 bits",
};
const COLOUR: Allowed = Allowed {
    components: &[3, 4],
    types: &[Component::F32, Component::U8, Component::U16],
    is_normalised: true,
    is_quantised: false,
    expected: "VEC3 or VEC4 of FLOAT, or of normalised unsigned integers of 8 or 16 bits",
};
const NORMAL: Allowed = Allowed {
    components: &[3],
    types: &[Component::F32, Component::I8, Component::I16],
    is_normalised: true,
    is_quantised: true,
    expected: "VEC3 of FLOAT, or of normalised signed integers of 8 or 16 bits (KHR_mesh_quantization)",
};
const INDICES: Allowed = Allowed {
    components: &[1],
    types: &[Component::U8, Component::U16, Component::U32],
    is_normalised: false,
    is_quantised: false,
    expected: "SCALAR of unsigned integers",
};

impl<'d, 'a> Primitives<'d, 'a> {
    pub(super) fn new(document: &'d Document<'a>) -> Self {
        Self { document, read: HashMap::new(), left_out: LeftOut::default() }
    }

    /// Primitive `number` of `mesh`, which exist; `None` if it has no triangles.
    ///
    /// # Errors
    /// Accessors that are invalid or do not fit each other; an index of no vertex; NaN or infinity; a material that is not there.
    pub(super) fn read(
        &mut self,
        mesh: usize,
        number: usize,
        materials: &mut Materials<'_, '_>,
    ) -> Result<Read, MeshError> {
        if let Some(read) = self.read.get(&[mesh, number]) {
            return Ok(read.clone());
        }
        let json = &self.document.json.meshes[mesh].primitives[number];
        let mut reader = Reader { document: self.document, json, mesh, number, left_out: &mut self.left_out };
        let read = reader.read(materials)?;
        self.read.insert([mesh, number], read.clone());
        Ok(read)
    }

    /// Notes on what was left out.
    pub(super) fn note(&self) {
        let (context, left_out) = (self.document.context, &self.left_out);
        let note = |number: usize, text: &str| {
            if number > 0 {
                context.note(format!("{} {text}", counted(number, "primitive")));
            }
        };
        note(left_out.points, "of points ignored");
        note(left_out.lines, "of lines ignored");
        note(left_out.without_positions, "without positions ignored");
        note(left_out.morphed, "with morph targets read without them");
        note(left_out.incomplete, "with an incomplete triangle at the end read without it");
        note(left_out.without_bounds, "without min and max of POSITION read");
        note(left_out.without_texcoords, "without the texture coordinates of its material read with (0, 0)");
        if left_out.zero_normals > 0 {
            context.note(format!("{} of length 0", counted(left_out.zero_normals, "normal")));
        }
    }
}

impl<'d> Reader<'_, 'd, '_> {
    fn place(&self) -> String {
        let name = self.document.json.meshes[self.mesh].name.as_deref();
        let name = name.map_or_else(String::new, |name| format!(" ({})", super::super::shown::shown(name)));
        format!("meshes[{}]{name}.primitives[{}]", self.mesh, self.number)
    }

    fn read(&mut self, materials: &mut Materials<'_, '_>) -> Result<Read, MeshError> {
        let topology = match self.json.mode.unwrap_or(4) {
            0 => {
                self.left_out.points += 1;
                return Ok(None);
            }
            1..=3 => {
                self.left_out.lines += 1;
                return Ok(None);
            }
            4 => Topology::List,
            5 => Topology::Strip,
            6 => Topology::Fan,
            other => return Err(self.invalid(".mode", "0 to 6", other.to_string())),
        };
        let Some(positions) = self.attribute("POSITION", &POSITION, None)? else {
            self.left_out.without_positions += 1;
            return Ok(None);
        };
        let (triangles, used) = self.triangles(topology, positions.count)?;
        if triangles.is_empty() {
            return Ok(None);
        }
        self.left_out.morphed += usize::from(!self.json.targets.is_empty());
        self.left_out.without_bounds += usize::from(!positions.has_bounds);
        let vertices = positions.count;
        let selection = used.as_deref().map_or(Selection::All, Selection::Some);
        let positions = self.vectors::<3>("POSITION", &positions, selection)?;
        let colours = match self.attribute("COLOR_0", &COLOUR, Some(vertices))? {
            None => List::default(),
            Some(accessor) if accessor.components == 4 => self.vectors("COLOR_0", &accessor, selection)?,
            Some(accessor) => self.opaque(self.vectors("COLOR_0", &accessor, selection)?)?,
        };
        let normals = match self.attribute("NORMAL", &NORMAL, Some(vertices))? {
            None => List::default(),
            Some(accessor) => self.vectors("NORMAL", &accessor, selection)?,
        };
        self.left_out.zero_normals += normals.iter().filter(|&&n| n == [0.0; 3]).count();
        let material = materials
            .number(self.json.material, !colours.is_empty(), &|| format!("{}.material", self.place()))?;
        let texcoords = self.texcoords(materials.sets(material), vertices, selection)?;
        let geometry =
            Geometry { positions: Positions::F32(positions), triangles, texcoords, colours, normals };
        Ok(Some((Arc::new(geometry), material)))
    }

    /// Triangles, and the vertices that they use, in order, if those of the file are more than the indices; the triangles then number these.
    fn triangles(&mut self, topology: Topology, vertices: usize) -> Result<Indexed, MeshError> {
        let Some(number) = self.json.indices else {
            let triangles = self.assembled(topology, vertices, |i| u32::try_from(i).unwrap_or(u32::MAX))?;
            return Ok((triangles, None));
        };
        let accessor = Accessor::open(self.document, number, &|| format!("{}.indices", self.place()))?;
        self.check(".indices", &accessor, &INDICES)?;
        let context = self.document.context;
        let mut indices = accessor.integers(context, &self.place())?;
        if let Some((at, &index)) = indices.iter().enumerate().find(|&(_, &index)| index as usize >= vertices)
        {
            let place = format!(".indices[{at}]");
            let expected = format!("a vertex below {vertices} (accessors[{}])", accessor.number);
            return Err(self.invalid(&place, &expected, format!("vertex {index}")));
        }
        let restart = match accessor.component {
            Component::U8 => u32::from(u8::MAX),
            Component::U16 => u32::from(u16::MAX),
            _ => u32::MAX,
        };
        if let Some(at) = indices.iter().position(|&index| index == restart) {
            let expected = format!("a vertex below {restart}, which restarts primitives");
            return Err(self.invalid(&format!(".indices[{at}]"), &expected, format!("vertex {restart}")));
        }
        let used = match indices.len() < vertices {
            true => {
                let used = self.used(&indices)?;
                for index in &mut indices[..] {
                    let at = used.binary_search(index).ok();
                    *index = at.and_then(|at| u32::try_from(at).ok()).unwrap_or(u32::MAX);
                }
                Some(used)
            }
            false => None,
        };
        let triangles = self.assembled(topology, indices.len(), |i| indices[i])?;
        grow::free(context, indices);
        Ok((triangles, used))
    }

    /// The vertices of `indices`, each once, ascending.
    fn used(&self, indices: &[u32]) -> Result<List<u32>, MeshError> {
        let mut used = grow::list(self.document.context, &self.place(), indices.len() as u64)?;
        used.extend(indices.iter().copied());
        used.sort_unstable();
        let mut count = 0;
        for i in 0..used.len() {
            if i == 0 || used[i] != used[i - 1] {
                used[count] = used[i];
                count += 1;
            }
        }
        used.resize(count, 0);
        Ok(used)
    }

    /// Triangles of a sequence of vertices.
    fn assembled(
        &mut self,
        topology: Topology,
        length: usize,
        vertex: impl Fn(usize) -> u32,
    ) -> Result<List<[u32; 3]>, MeshError> {
        let number = topology.triangles(length);
        let is_complete = topology != Topology::List || length.is_multiple_of(3);
        self.left_out.incomplete += usize::from(!is_complete);
        let mut triangles = grow::list(self.document.context, &self.place(), number as u64)?;
        triangles.extend((0..number).map(|i| topology.triangle(i, &vertex)));
        Ok(triangles)
    }

    /// Texture coordinates: those of `sets`, others empty.
    fn texcoords(
        &mut self,
        sets: [Option<usize>; 2],
        vertices: usize,
        selection: Selection<'_>,
    ) -> Result<Vec<List<[f32; 2]>>, MeshError> {
        let mut texcoords: Vec<List<[f32; 2]>> = Vec::new();
        for set in sets.into_iter().flatten() {
            if texcoords.len() <= set {
                texcoords.resize_with(set + 1, List::default);
            }
            if !texcoords[set].is_empty() {
                continue;
            }
            let name = format!("TEXCOORD_{set}");
            texcoords[set] = match self.attribute(&name, &TEXCOORD, Some(vertices))? {
                Some(accessor) => self.vectors(&name, &accessor, selection)?,
                None => {
                    self.left_out.without_texcoords += 1;
                    let length = selection.len(vertices) as u64;
                    grow::zeros(self.document.context, &self.place(), length)?
                }
            };
        }
        Ok(texcoords)
    }

    /// Accessor of an attribute, if the primitive has it; of `vertices` elements, if given.
    fn attribute(
        &self,
        name: &str,
        allowed: &Allowed,
        vertices: Option<usize>,
    ) -> Result<Option<Accessor<'d>>, MeshError> {
        let attributes: &Attributes = &self.json.attributes;
        let Some(number) = attributes.get(name) else {
            return Ok(None);
        };
        let property = format!(".attributes.{name}");
        let accessor = Accessor::open(self.document, number, &|| format!("{}{property}", self.place()))?;
        self.check(&property, &accessor, allowed)?;
        if let Some(vertices) = vertices.filter(|&vertices| vertices != accessor.count) {
            let expected = format!("{vertices} elements, as POSITION");
            return Err(self.invalid(
                &property,
                &expected,
                format!("{} (accessors[{number}])", accessor.count),
            ));
        }
        Ok(Some(accessor))
    }

    fn check(&self, property: &str, accessor: &Accessor<'_>, allowed: &Allowed) -> Result<(), MeshError> {
        let is_float = accessor.component == Component::F32;
        let is_allowed = allowed.components.contains(&accessor.components)
            && allowed.types.contains(&accessor.component)
            && (is_float || accessor.is_normalised || !allowed.is_normalised);
        let is_missing = allowed.is_quantised && !is_float && !self.document.json.lists(QUANTIZATION);
        if is_allowed && !is_missing {
            return Ok(());
        }
        let normalised = if accessor.is_normalised { "normalised " } else { "" };
        let found = format!(
            "{} of {normalised}{} (accessors[{}])",
            counted(accessor.components, "component"),
            accessor.component.name(),
            accessor.number
        );
        if !is_allowed {
            return Err(self.invalid(property, allowed.expected, found));
        }
        let expected = format!(
            "FLOAT, or {QUANTIZATION} in extensionsUsed (list it there, or export the mesh without quantization)"
        );
        Err(self.invalid(property, &expected, found))
    }

    /// The selected elements of an accessor, all finite.
    fn vectors<const N: usize>(
        &self,
        name: &str,
        accessor: &Accessor<'_>,
        selection: Selection<'_>,
    ) -> Result<List<[f32; N]>, MeshError> {
        let vectors = accessor.vectors::<N>(self.document.context, selection, &self.place())?;
        match vectors.iter().position(|v| !v.iter().all(|c| c.is_finite())) {
            None => Ok(vectors),
            Some(at) => {
                let place = format!(".attributes.{name}, vertex {}", selection.number(at));
                Err(self.invalid(&place, "finite numbers", format!("{:?}", vectors[at])))
            }
        }
    }

    /// Colours with alpha 1.
    fn opaque(&self, colours: List<[f32; 3]>) -> Result<List<[f32; 4]>, MeshError> {
        let context = self.document.context;
        let mut opaque = grow::list(context, &self.place(), colours.len() as u64)?;
        opaque.extend(colours.iter().map(|&[r, g, b]| [r, g, b, 1.0]));
        grow::free(context, colours);
        Ok(opaque)
    }

    fn invalid(&self, property: &str, expected: &str, found: String) -> MeshError {
        self.document.context.invalid(format!("{}{property}", self.place()), expected, found)
    }
}
