//! MTF of an edge on a picture (e-SFR, ISO 12233), and what makes it doubtful.

use super::PLATEAU;
use super::quality::{self, Remark};
use anyhow::Result;
use pipeline::geometry::Rect;
use pipeline::measure::edge::{EdgeLine, Esf};
use pipeline::measure::sfr::Mtf;

/// MTF of an edge, and what makes it doubtful.
pub struct EdgeMtf {
    /// The MTF.
    pub mtf: Mtf,
    /// Remarks.
    pub remarks: Vec<Remark>,
}

impl EdgeMtf {
    /// Of the edge `line` in the pixels of `rect` for which `own` (row, column) holds, within `half` px on either side and half of `length` along it from `middle` (row, column).
    ///
    /// # Errors
    /// Too few pixels; no contrast.
    pub fn new(
        (pixels, rect): (&[f32], Rect),
        line: EdgeLine,
        (middle, length): ((f64, f64), f64),
        half: usize,
        own: &dyn Fn(i64, i64) -> bool,
    ) -> Result<Self> {
        let (sin, cos) = line.normal_rad.sin_cos();
        let distance = |y: i64, x: i64| {
            let at = (y as f64, x as f64);
            let along = (at.0 - middle.0) * cos - (at.1 - middle.1) * sin;
            (along.abs() <= length / 2.0 && own(y, x)).then(|| line.distance(at))
        };
        let reach = half as f64 - 1.0;
        let raw = Esf::new(pixels, rect, reach, distance)?;
        let esf = raw.normalised(PLATEAU * reach)?;
        let remarks = quality::remarks(line, raw.plateaus(PLATEAU * reach), &esf, PLATEAU * reach)?;
        Ok(Self { mtf: Mtf::from_esf(&esf), remarks })
    }
}
