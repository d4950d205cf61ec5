//! An array of pixels of a film or raw: all of it, or a region.

use pipeline::geometry::{Rect, Size};
use serde_json::{Value, json};

use crate::hierarchy::coordinate;

/// An array of a film or raw.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Output {
    /// Name of the array: `film` or `raw`, or `roi_0`, …
    pub name: String,
    /// Its pixels, in coordinates of the film or sensor.
    pub rect: Rect,
}

impl Output {
    /// Name and size of the array.
    pub(crate) fn array(&self) -> (&str, Size) {
        (&self.name, self.rect.size())
    }

    /// Names of its (y, x) coordinates.
    pub(crate) fn axes(&self) -> (String, String) {
        match &*self.name {
            "film" | "raw" => ("y".into(), "x".into()),
            name => (format!("{name}_y"), format!("{name}_x")),
        }
    }

    /// Its coordinates, of pixels at `y_mm` and `x_mm`: name, metadata and chunk.
    pub(crate) fn coordinates(&self, y_mm: &[f64], x_mm: &[f64]) -> [(String, (Value, Vec<u8>)); 2] {
        let (y, x) = self.axes();
        let down = coordinate(&y, "mm", "distance below the optical axis", y_mm);
        let across = coordinate(&x, "mm", "distance right of the optical axis", x_mm);
        [(y, down), (x, across)]
    }

    /// As the attributes of a group have it.
    pub(crate) fn to_json(&self) -> Value {
        let Self { name, rect } = self;
        json!({"name": name, "row": rect.y, "column": rect.x, "size": [rect.height, rect.width]})
    }

    /// From the attributes of a group.
    pub(crate) fn from_json(value: &Value) -> Option<Self> {
        let (height, width) = serde_json::from_value(value["size"].clone()).ok()?;
        let rect = Rect::new(value["row"].as_i64()?, value["column"].as_i64()?, height, width);
        Some(Self { name: value["name"].as_str()?.into(), rect })
    }
}
