//! The table `[map]` of a description: which of its three forms it has.

use super::arrays::ArrayName;
use super::brown::Brown;
use super::description::{Grid, array, grid};
use crate::import::ImportError;
use crate::toml_table::{Entry, TableError};
use pipeline::bounds;
use std::path::Path;

/// Keys of the table.
pub(super) const MAP: [&str; 10] = [
    "ideal_x",
    "ideal_y",
    "displacement_x_px",
    "displacement_y_px",
    "x_mm",
    "y_mm",
    "pitch_um",
    "size_px",
    "brown",
    "y_up",
];
const BROWN: [&str; 4] = ["f_px", "c_px", "k", "p"];

/// Source of the ideal points.
pub(super) enum MapTable {
    Identity,
    Ideal { x: ArrayName, y: ArrayName, grid: Grid },
    Displacement { x: ArrayName, y: ArrayName, grid: Grid, pitch_um: f64 },
    Brown(Brown),
}

impl MapTable {
    pub fn name(&self) -> &'static str {
        match self {
            Self::Identity => "none",
            Self::Ideal { .. } => "ideal points",
            Self::Displacement { .. } => "displacements",
            Self::Brown(_) => "brown",
        }
    }
}

/// The map of the table `map` of the description `path`.
pub(super) fn map_table(path: &Path, map: &Entry<'_>) -> Result<MapTable, ImportError> {
    let (has, file) = (|key: &str| map.field(key).is_some(), |key: &str| array(path, map, key));
    let kinds = [["ideal_x", "ideal_y"], ["displacement_x_px", "displacement_y_px"], ["brown", "brown"]];
    let given = kinds.map(|kind| kind.into_iter().any(has));
    let beside = |keys: &[&str], kind: &str| match keys.iter().find(|key| has(key)) {
        Some(key) => Err(map.error(format!("has {key} beside {kind}, which has no use for it; remove one"))),
        None => Ok(()),
    };
    match given {
        [true, false, false] => {
            beside(&["pitch_um", "size_px"], "ideal_x and ideal_y (mm)")?;
            Ok(MapTable::Ideal { x: file("ideal_x")?, y: file("ideal_y")?, grid: grid(path, map)? })
        }
        [false, true, false] => {
            beside(&["size_px"], "displacements")?;
            let pitch = map.required("pitch_um", "pitch of the film's pixels, µm")?;
            Ok(MapTable::Displacement {
                x: file("displacement_x_px")?,
                y: file("displacement_y_px")?,
                grid: grid(path, map)?,
                pitch_um: pitch.bounded(bounds::PITCH_UM)?,
            })
        }
        [false, false, true] => {
            beside(&["x_mm", "y_mm", "y_up"], "brown (of the whole film, rows down)")?;
            Ok(MapTable::Brown(brown(map)?))
        }
        _ => Err(map
            .error("needs one of: ideal_x and ideal_y; displacement_x_px and displacement_y_px; brown")
            .into()),
    }
}

fn brown(map: &Entry<'_>) -> Result<Brown, TableError> {
    let field = map.required("brown", "{ f_px, c_px, k, p }")?;
    let table = field.table("brown".into(), &BROWN)?;
    let required = |key: &str, expected: &str| table.required(key, expected);
    let f_px = required("f_px", "focal length, px")?;
    let c_px = required("c_px", "[x, y], principal point, px from the centre of the first pixel")?;
    let size = map.required("size_px", "[width, height] of the film")?;
    let pitch = map.required("pitch_um", "pitch of the film's pixels, µm")?;
    let list = |key: &str, most: usize| match table.field(key) {
        None => Ok::<_, TableError>(vec![0.0; most]),
        Some(field) => {
            let found = field.numbers()?.filter(|v| v.len() <= most);
            let mut found = found.ok_or_else(|| field.error(format!("a list of up to {most} numbers")))?;
            found.resize(most, 0.0);
            Ok(found)
        }
    };
    let (k, p) = (list("k", 3)?, list("p", 2)?);
    let (size_px, c) = (size.numbers_of(2)?, c_px.numbers_of(2)?);
    if size_px.iter().any(|n| n.fract() != 0.0 || !bounds::FILM_SIDE_PX.contains(*n)) {
        return Err(size.error("[width, height], whole numbers"));
    }
    if c.iter().any(|v| !bounds::POSITION_PX.contains(*v)) {
        return Err(c_px.error(bounds::POSITION_PX));
    }
    let brown = Brown {
        f_px: f_px.number()?,
        c_px: [c[0], c[1]],
        k: [k[0], k[1], k[2]],
        p: [p[0], p[1]],
        size_px: [size_px[0], size_px[1]],
        pitch_um: pitch.bounded(bounds::PITCH_UM)?,
    };
    match bounds::FOCAL_LENGTH_MM.check(brown.focal_length_mm()) {
        Ok(_) => Ok(brown),
        Err(e) => Err(f_px.error(format!("a positive number of px ({e})"))),
    }
}
