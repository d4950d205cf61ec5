//! One pass over depth and coverage arrays: every value is checked, the range of vergences is found.

use crate::failure::usage;
use crate::open::Chart;
use anyhow::{Result, bail};
use pipeline::depth::occupancy::Occupancy;
use pipeline::depth::plan::Surfaces;
use pipeline::depth::sheet::Distance;
use pipeline::flow::ChartSource;
use pipeline::geometry::{Frame, Rect, Size};
use std::sync::Arc;

/// Rows read together, at least.
pub const MIN_ROWS: usize = 64;

/// Rows of `chart` read together: those of a chunk.
pub fn rows_at_a_time(chart: &Chart) -> usize {
    chart.chunk_size().height.max(MIN_ROWS)
}

/// Row and column of a chart pixel, and whether a distance was found there.
pub struct Position {
    row: usize,
    column: usize,
    is_missed: bool,
}

/// Calls `add` with every pixel of the array `source` of `name`, read `rows` rows at a time, and its vergence in 1/m.
///
/// # Errors
/// It cannot be read; a distance is not positive.
pub fn distances(
    name: &str,
    source: &dyn ChartSource,
    rows: usize,
    distance: &Distance,
    frame: &Frame,
    add: &mut dyn FnMut(Position, f64),
) -> Result<()> {
    for_each(source, rows, |row, column, value| {
        let Some(v) = distance.vergence(value, Distance::ideal_mm(frame, row, column)) else {
            return Err(usage(format!(
                "{name}: the depth at row {row}, column {column} is {value}, expected a distance above 0; `--depth-miss far` takes NaN, 0 \
                 and negative numbers for infinity"
            )));
        };
        add(Position { row, column, is_missed: value.is_nan() || value <= 0.0 }, v);
        Ok(())
    })
}

/// What was found in the depth arrays.
pub struct Scan {
    /// Vergences of the farthest and the nearest surface, 1/m.
    first: f64,
    last: f64,
    occupancy: Occupancy,
    /// Pixels at infinity because nothing was met.
    missed: u64,
}

impl Scan {
    /// Nothing yet, for a chart of `size` and a lens with depth nodes over the vergences `nodes`.
    pub fn new(size: Size, nodes: (f64, f64)) -> Self {
        Self { first: f64::INFINITY, last: 0.0, occupancy: Occupancy::new(size, nodes), missed: 0 }
    }

    /// Adds a pixel of vergence `v`.
    pub fn add(&mut self, at: Position, v: f64) {
        self.missed += u64::from(at.is_missed);
        self.first = self.first.min(v);
        self.last = self.last.max(v);
        self.occupancy.add(at.row, at.column, v);
    }

    /// Vergence of the nearest surface, 1/m.
    pub fn nearest(&self) -> f64 {
        self.last
    }

    /// Vergences found; `is_opaque`: of one surface without holes; `invent`: what is hidden behind edges is invented.
    pub fn surfaces(self, is_opaque: bool, invent: bool) -> Surfaces {
        let Self { first, last, .. } = self;
        let (occupancy, is_invented) = (Arc::new(self.occupancy), invent && first < last);
        Surfaces { first, last, is_opaque, occupancy, is_invented }
    }

    /// Notes to print.
    pub fn notes(&self) -> Vec<String> {
        let note = format!(
            "{} pixels of the depth arrays are NaN, 0 or negative and are taken for infinity (--depth-miss far)",
            self.missed
        );
        if self.missed > 0 { vec![note] } else { Vec::new() }
    }
}

/// Checks the coverage array of the surface `name`.
///
/// # Errors
/// It cannot be read; a value outside 0 to 1.
pub fn coverage(name: &str, chart: &Chart) -> Result<()> {
    for_each(chart.source(), rows_at_a_time(chart), |row, column, value| {
        if !(0.0..=1.0).contains(&value) {
            bail!("{name}: the coverage at row {row}, column {column} is {value}, expected 0 to 1");
        }
        Ok(())
    })
}

/// Calls `each` with row, column and value of every pixel.
fn for_each(
    source: &dyn ChartSource,
    rows: usize,
    mut each: impl FnMut(usize, usize, f32) -> Result<()>,
) -> Result<()> {
    let size = source.size();
    let mut pixels = vec![0f32; rows.min(size.height) * size.width];
    for first in (0..size.height).step_by(rows) {
        let count = rows.min(size.height - first);
        let pixels = &mut pixels[..count * size.width];
        let rect = Rect::new(first as i64, 0, count, size.width);
        source.read(0, rect, pixels).map_err(|e| anyhow::anyhow!(e))?;
        for (y, line) in pixels.chunks_exact(size.width).enumerate() {
            for (x, value) in line.iter().enumerate() {
                each(first + y, x, *value)?;
            }
        }
    }
    Ok(())
}
