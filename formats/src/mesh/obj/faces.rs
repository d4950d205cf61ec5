//! Faces: polygons become triangles, each of a part.

use std::collections::{BTreeSet, HashMap};

use super::super::context::Context;
use super::super::error::MeshError;
use super::super::grow;
use super::super::polygon::Triangulator;
use super::super::shown::{counted, shown};
use super::super::text::{Lines, keyword, name, quote, words};
use super::invalid;
use super::vertices::{Counts, Vertices};
use pipeline::scratch::List;

/// No texture coordinates, or no normal.
pub(super) const NONE: u32 = u32::MAX;
/// Memory of a part: its key, its geometry, its place in maps, without its names.
const PART_BYTES: u64 = 1024;

/// Numbers of position, texture coordinates and normal, from 0.
pub(super) type Corner = [u32; 3];

/// What makes a part.
#[derive(Clone, Default, PartialEq, Eq, Hash)]
pub(super) struct PartKey {
    pub object: String,
    pub group: String,
    pub material: Option<String>,
    pub has_texcoords: bool,
    pub has_normals: bool,
}

/// All faces of a file.
#[derive(Default)]
pub(super) struct Faces {
    pub triangles: List<[Corner; 3]>,
    /// Of each triangle.
    pub part: List<u32>,
    /// Key and node of each part.
    pub parts: Vec<(PartKey, u32)>,
    /// Line and text of each `mtllib`.
    pub libraries: Vec<(u64, String)>,
    pub polygons: u64,
    small: u64,
    mixed: u64,
    intersecting: u64,
    points: u64,
    lines: u64,
    curves: u64,
    smoothing: u64,
    unknown: BTreeSet<String>,
}

/// Keywords that are known and have no effect on triangles, or none without curves.
const SILENT: [&[u8]; 20] = [
    b"v",
    b"vt",
    b"vn",
    b"vp",
    b"deg",
    b"bmat",
    b"step",
    b"cstype",
    b"parm",
    b"trim",
    b"hole",
    b"scrv",
    b"sp",
    b"end",
    b"con",
    b"mg",
    b"bevel",
    b"c_interp",
    b"d_interp",
    b"lod",
];
/// Unknown keywords that a note names.
const MAX_UNKNOWN: usize = 5;

impl Faces {
    pub fn read(
        context: &Context<'_>,
        text: &[u8],
        counts: &Counts,
        vertices: &Vertices,
    ) -> Result<Self, MeshError> {
        let mut faces = Self {
            triangles: grow::list(context, "triangles", counts.triangles)?,
            part: grow::list(context, "triangles", counts.triangles)?,
            ..Self::default()
        };
        let mut state = State::new(vertices);
        let mut lines = Lines::new(text);
        while let Some((line, statement)) = lines.next() {
            let (word, rest) = keyword(statement);
            match word {
                b"f" | b"fo" => state.face(context, line, rest, &mut faces)?,
                b"v" => state.seen[0] += 1,
                b"vt" => state.seen[1] += 1,
                b"vn" => state.seen[2] += 1,
                b"o" => state.change(|key| key.object = name(rest)),
                b"g" => state.change(|key| key.group = name(rest)),
                b"usemtl" => state.change(|key| key.material = Some(name(rest))),
                b"mtllib" => faces.libraries.push((line, name(rest))),
                b"p" => faces.points += 1,
                b"l" => faces.lines += 1,
                b"curv" | b"curv2" | b"surf" => faces.curves += 1,
                b"s" => faces.smoothing += u64::from(!matches!(rest, b"off" | b"0" | b"")),
                _ if word.is_empty() || word[0] == b'#' || SILENT.contains(&word) => {}
                _ if faces.unknown.len() <= MAX_UNKNOWN => {
                    faces.unknown.insert(quote(word));
                }
                _ => {}
            }
        }
        faces.intersecting = state.triangulator.intersecting;
        Ok(faces)
    }

    /// The materials of the parts, each once, in the order of the first face.
    pub fn material_names(&self) -> impl Iterator<Item = &Option<String>> {
        self.parts.iter().map(|(key, _)| &key.material)
    }

    /// What there is besides polygons, for messages.
    pub fn others(&self) -> String {
        let others = [(self.points, "of points"), (self.lines, "of lines"), (self.curves, "of curves")];
        let present = others.iter().filter(|(count, _)| *count > 0);
        present.map(|(count, what)| format!(", {} {what}", counted(*count as usize, "statement"))).collect()
    }

    /// Notes on what is left out.
    pub fn add_notes(&self, context: &Context<'_>) {
        let notes = [
            (self.points, "statement", "of points (p) ignored"),
            (self.lines, "statement", "of lines (l) ignored"),
            (self.curves, "statement", "of curves and free-form surfaces (curv, curv2, surf) ignored"),
            (self.small, "face", "with less than 3 corners ignored"),
            (
                self.mixed,
                "face",
                "with texture coordinates or normals at some corners only, which are ignored",
            ),
            (self.intersecting, "polygon", "with edges that intersect, divided into fans"),
        ];
        for (count, noun, note) in notes.iter().filter(|(count, ..)| *count > 0) {
            context.note(format!("{} {note}", counted(*count as usize, noun)));
        }
        if self.smoothing > 0 && self.parts.iter().any(|(key, _)| !key.has_normals) {
            context.note("smoothing groups (s) are not applied: faces without normals are flat");
        }
        if !self.unknown.is_empty() {
            let more = if self.unknown.len() > MAX_UNKNOWN { " and others" } else { "" };
            let names: Vec<_> = self.unknown.iter().take(MAX_UNKNOWN).map(String::as_str).collect();
            context.note(format!("statements {}{more} are ignored", names.join(", ")));
        }
    }
}

/// What the statements so far determine.
struct State<'a> {
    vertices: &'a Vertices,
    /// Positions, texture coordinates and normals so far.
    seen: [u64; 3],
    totals: [u64; 3],
    key: PartKey,
    /// Part of the key without and with texture coordinates, and normals, if already known.
    current: [[Option<u32>; 2]; 2],
    numbers: HashMap<PartKey, u32>,
    nodes: HashMap<(String, String), u32>,
    corners: List<Corner>,
    triangulator: Triangulator,
    most_corners: u64,
}

impl<'a> State<'a> {
    fn new(vertices: &'a Vertices) -> Self {
        let totals = [vertices.positions.len(), vertices.texcoords.len(), vertices.normals.len()];
        Self {
            vertices,
            seen: [0; 3],
            totals: totals.map(|n| n as u64),
            key: PartKey::default(),
            current: [[None; 2]; 2],
            numbers: HashMap::new(),
            nodes: HashMap::new(),
            corners: List::default(),
            triangulator: Triangulator::default(),
            most_corners: 0,
        }
    }

    fn change(&mut self, change: impl FnOnce(&mut PartKey)) {
        change(&mut self.key);
        self.current = [[None; 2]; 2];
    }

    fn face(
        &mut self,
        context: &Context<'_>,
        line: u64,
        text: &[u8],
        faces: &mut Faces,
    ) -> Result<(), MeshError> {
        let mut corners = std::mem::take(&mut self.corners);
        corners.resize(0, [0; 3]);
        for word in words(text).take_while(|word| word[0] != b'#') {
            let corner = self.corner(word);
            let corner = corner.map_err(|expected| invalid(context.path, line, expected, quote(word)))?;
            grow::push(context, "corners of a face", &mut corners, corner)?;
        }
        faces.polygons += 1;
        if corners.len() < 3 {
            faces.small += 1;
        } else {
            self.divide(context, line, &mut corners, faces)?;
        }
        self.corners = corners;
        Ok(())
    }

    /// A corner of a face; the error is what is expected.
    fn corner(&self, word: &[u8]) -> Result<Corner, String> {
        let mut corner = [NONE; 3];
        let mut parts = word.split(|&b| b == b'/');
        for (kind, number) in corner.iter_mut().enumerate() {
            match parts.next() {
                None | Some(b"") if kind > 0 => {}
                part => *number = self.index(kind, part.unwrap_or_default())?,
            }
        }
        match parts.next() {
            None => Ok(corner),
            Some(_) => Err("a corner v, v/vt, v//vn or v/vt/vn".into()),
        }
    }

    fn index(&self, kind: usize, digits: &[u8]) -> Result<u32, String> {
        let (total, seen) = (self.totals[kind], self.seen[kind]);
        let index = std::str::from_utf8(digits).ok().and_then(|digits| digits.parse::<i64>().ok());
        let number = match index {
            Some(index) if index > 0 => Some(index.unsigned_abs() - 1).filter(|&n| n < total),
            Some(index) if index < 0 => seen.checked_sub(index.unsigned_abs()),
            _ => None,
        };
        let number = number.and_then(|n| u32::try_from(n).ok());
        number.ok_or_else(|| {
            let what = ["vertex", "texture coordinate", "normal"][kind];
            format!("a {what} index of 1 to {total}, or -1 to -{seen} counted backwards")
        })
    }

    fn divide(
        &mut self,
        context: &Context<'_>,
        line: u64,
        corners: &mut [Corner],
        faces: &mut Faces,
    ) -> Result<(), MeshError> {
        let mut is_mixed = false;
        let [has_texcoords, has_normals] = [1, 2].map(|kind| {
            let with = corners.iter().filter(|corner| corner[kind] != NONE).count();
            if with > 0 && with < corners.len() {
                corners.iter_mut().for_each(|corner| corner[kind] = NONE);
                is_mixed = true;
            }
            with == corners.len()
        });
        faces.mixed += u64::from(is_mixed);
        let part = match self.current[usize::from(has_texcoords)][usize::from(has_normals)] {
            Some(part) => part,
            None => self.part(context, has_texcoords, has_normals, &mut faces.parts)?,
        };
        let count = corners.len() as u64;
        if count > self.most_corners {
            context.charge((count - self.most_corners) * Triangulator::BYTES_PER_CORNER, || {
                format!("line {line}, a polygon of {count} corners")
            })?;
            self.most_corners = count;
        }
        let too_many = || {
            let expected = "polygons with fewer corners; export the mesh in triangles";
            invalid(context.path, line, expected, format!("one of {count}"))
        };
        let count = u32::try_from(count).map_err(|_| too_many())?;
        let positions = &self.vertices.positions;
        let position = |corner: u32| positions[corners[corner as usize][0] as usize];
        let triangles = self.triangulator.divide(count, position).map_err(|_| too_many())?;
        for triangle in triangles {
            faces.triangles.push(triangle.map(|corner| corners[corner as usize]));
            faces.part.push(part);
        }
        Ok(())
    }

    /// The number of the part, which may be new.
    fn part(
        &mut self,
        context: &Context<'_>,
        has_texcoords: bool,
        has_normals: bool,
        parts: &mut Vec<(PartKey, u32)>,
    ) -> Result<u32, MeshError> {
        (self.key.has_texcoords, self.key.has_normals) = (has_texcoords, has_normals);
        let part = match self.numbers.get(&self.key) {
            Some(&part) => part,
            None => {
                let key = &self.key;
                let names = key.object.len() + key.group.len() + key.material.as_ref().map_or(0, String::len);
                context.charge(PART_BYTES + 4 * names as u64, || format!("part {}", shown(&key.object)))?;
                let next = self.nodes.len() as u32;
                let node = *self.nodes.entry((key.object.clone(), key.group.clone())).or_insert(next);
                let part = parts.len() as u32;
                parts.push((key.clone(), node));
                self.numbers.insert(key.clone(), part);
                part
            }
        };
        self.current[usize::from(has_texcoords)][usize::from(has_normals)] = Some(part);
        Ok(part)
    }
}
