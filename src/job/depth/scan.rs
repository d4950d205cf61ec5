//! One pass over a depth array: every value is checked, the vergences that occur are collected, and what is suspicious is counted.
//!
//! Rows are read in strips of a chunk's rows; of their vergences three rows are held, so memory does not grow with the array's height.

use super::clean::Edges;
use crate::failure::usage;
use crate::open::Chart;
use anyhow::{Result, bail};
use pipeline::depth::occupancy::Occupancy;
use pipeline::depth::plan::Surfaces;
use pipeline::flow::ChartSource;
use pipeline::geometry::{Rect, Size};
use std::sync::Arc;

/// Rows read together, at least.
pub const MIN_ROWS: usize = 64;
/// Share of the pixels at edges from which on interpolated ones are reported.
const REPORTED_SHARE: f64 = 1e-3;
/// Vergences beyond the nodes of a lens by less than this share are rounding.
const ROUNDING: f64 = 1e-6;

/// Rows of `chart` read together: those of a chunk.
pub fn rows_at_a_time(chart: &Chart) -> usize {
    chart.chunk_size().height.max(MIN_ROWS)
}

/// Pixels of a kind: their number, and row and column of the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pixels {
    /// Number.
    pub count: u64,
    /// Row and column of the first.
    pub first: Option<(usize, usize)>,
}

impl Pixels {
    fn add(&mut self, row: usize, column: usize) {
        self.count += 1;
        self.first.get_or_insert((row, column));
    }
}

/// What was found in the depth array of one surface.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Findings {
    /// NaN, taken for infinity.
    pub nan: Pixels,
    /// 0, taken for infinity.
    pub zero: Pixels,
    /// Negative, taken for infinity.
    pub negative: Pixels,
    /// Infinite, at 10⁶ m or more, or the largest number of 16-bit floats.
    pub infinite: Pixels,
    /// Nearer than the nearest depth node of the lens.
    pub nearer: Pixels,
    /// Farther than the farthest depth node of the lens.
    pub farther: Pixels,
    /// Between neighbours of different surfaces.
    pub edges: u64,
    /// Of these, at a distance between both.
    pub between: Pixels,
    /// Single pixels before or behind the surface around them.
    pub outliers: Pixels,
    /// Covered in part.
    pub partly_covered: Pixels,
}

impl Findings {
    /// A note on interpolated distances in the array `name`, if there are many.
    pub fn edge_note(&self, name: &str) -> Option<String> {
        let (row, column) = self.between.first?;
        let (between, edges) = (self.between.count, self.edges);
        (between as f64 / edges as f64 >= REPORTED_SHARE).then(|| {
            format!(
                "{name}: {between} of {edges} pixels at edges have a distance between those of their neighbours, e.g. row {row}, column {column}: the depth is \
                 anti-aliased, and blur is wrong there; render it with one sample per pixel, or add `--depth-edges snap`"
            )
        })
    }

    /// A note on pixels of the array `name` that are covered in part, whose light is taken as that of the surface alone.
    pub fn coverage_note(&self, name: &str) -> Option<String> {
        let (row, column) = self.partly_covered.first?;
        Some(format!(
            "{name}: {} pixels, e.g. row {row}, column {column}, are covered in part; their light is taken for that of the surface alone: if it is \
             multiplied by the coverage, add `--coverage-light premultiplied`, else `--coverage-light straight`",
            self.partly_covered.count
        ))
    }

    /// A note on pixels of the array `name` at infinity.
    pub fn infinity_note(&self, name: &str) -> Option<String> {
        let (row, column) = self.infinite.first?;
        Some(format!(
            "{name}: {} pixels, e.g. row {row}, column {column}, are at infinity: infinite, 1e6 m or more, or 65504 in 16-bit floats",
            self.infinite.count
        ))
    }

    /// Pixels without a valid distance.
    pub fn missed(&self) -> u64 {
        self.nan.count + self.zero.count + self.negative.count
    }

    /// Counts pixel (`row`, `column`) with the stored number `value` and vergence `v`, for a lens with depth nodes over the vergences `nodes`.
    fn add(&mut self, row: usize, column: usize, value: f32, v: f64, nodes: Option<(f64, f64)>) {
        let kind = match value {
            value if value.is_nan() => Some(&mut self.nan),
            0.0 => Some(&mut self.zero),
            value if value < 0.0 => Some(&mut self.negative),
            _ if v == 0.0 => Some(&mut self.infinite),
            _ => None,
        };
        kind.into_iter().for_each(|pixels| pixels.add(row, column));
        if let Some((farthest, nearest)) = nodes {
            if v > nearest * (1.0 + ROUNDING) {
                self.nearer.add(row, column);
            } else if v < farthest * (1.0 - ROUNDING) {
                self.farther.add(row, column);
            }
        }
    }

    /// Counts what the neighbours of the pixels of row `y` show.
    fn add_neighbours(
        &mut self,
        edges: &Edges,
        y: usize,
        (above, row, below): (Option<&[f64]>, &[f64], Option<&[f64]>),
    ) {
        for x in 0..row.len() {
            let found = edges.around(above, row, below, x);
            self.edges += u64::from(found.is_edge);
            if found.nearer.is_some() {
                self.between.add(y, x);
            }
            if found.is_outlier {
                self.outliers.add(y, x);
            }
        }
    }
}

/// A depth array to scan.
pub struct Scanned<'a> {
    /// Name in messages.
    pub name: &'a str,
    /// The array.
    pub source: &'a dyn ChartSource,
    /// Share of each pixel that the surface covers; none: 1. Where it is 0 there is no distance.
    pub coverage: Option<&'a dyn ChartSource>,
    /// Rows read together.
    pub rows: usize,
    /// What its numbers mean, and what an edge is.
    pub edges: Edges,
    /// Vergences of a lens's farthest and nearest depth node, 1/m; none if it is traced for the scene.
    pub nodes: Option<(f64, f64)>,
}

/// Vergences of all surfaces.
pub struct Scan {
    /// Those of the farthest and the nearest surface, 1/m.
    range: (f64, f64),
    occupancy: Occupancy,
}

impl Scan {
    /// Nothing yet, for a chart of `size`.
    pub fn new(size: Size) -> Self {
        Self { range: (f64::INFINITY, 0.0), occupancy: Occupancy::new(size) }
    }

    /// Adds the array `of`; `on_row` receives the vergences of each row, NaN where there is no surface.
    ///
    /// # Errors
    /// It cannot be read; a distance or a coverage is not valid.
    pub fn add(&mut self, of: &Scanned<'_>, on_row: &mut dyn FnMut(usize, &[f64])) -> Result<Findings> {
        let mut found = Findings::default();
        let mut rows: [Vec<f64>; 3] = std::array::from_fn(|_| vec![0.0; of.source.size().width]);
        let last = of.source.size().height - 1;
        for_each_row(&[Some(of.source), of.coverage], of.rows, |y, [values, coverage]| {
            // Rows y − 2, y − 1 and y.
            rows.rotate_left(1);
            self.add_row(of, y, (values, coverage), &mut rows[2], &mut found)?;
            on_row(y, &rows[2]);
            let [above, row, below] = &rows;
            if y > 0 {
                let above = (y > 1).then_some(&above[..]);
                found.add_neighbours(&of.edges, y - 1, (above, row, Some(below)));
            }
            if y == last {
                found.add_neighbours(&of.edges, y, ((y > 0).then_some(&row[..]), below, None));
            }
            Ok(())
        })?;
        Ok(found)
    }

    /// Adds the row `y` of stored numbers `values` and their coverages, none if all are 1; their vergences.
    fn add_row(
        &mut self,
        of: &Scanned<'_>,
        y: usize,
        (values, coverage): (&[f32], &[f32]),
        vergences: &mut [f64],
        found: &mut Findings,
    ) -> Result<()> {
        for (x, (value, vergence)) in std::iter::zip(values, vergences).enumerate() {
            if let Some(share) = coverage.get(x) {
                if !(0.0..=1.0).contains(share) {
                    bail!("{}: the coverage at row {y}, column {x} is {share}, expected 0 to 1", of.name);
                }
                if *share == 0.0 {
                    *vergence = f64::NAN;
                    continue;
                }
                if *share < 1.0 {
                    found.partly_covered.add(y, x);
                }
            }
            let Some(v) = of.edges.vergence(*value, y, x) else {
                return Err(usage(format!(
                    "{}: the depth at row {y}, column {x} is {value}, expected a distance above 0; `--depth-miss far` takes NaN, 0 \
                     and negative numbers for infinity",
                    of.name
                )));
            };
            *vergence = v;
            found.add(y, x, *value, v, of.nodes);
            self.range = (self.range.0.min(v), self.range.1.max(v));
            self.occupancy.add(y, x, v);
        }
        Ok(())
    }

    /// Vergences of the farthest and the nearest surface, 1/m.
    pub fn range(&self) -> (f64, f64) {
        self.range
    }

    /// Vergences found; `is_opaque`: of one surface without holes; `invent`: what is hidden behind edges is invented.
    pub fn surfaces(self, is_opaque: bool, invent: bool) -> Surfaces {
        let ((first, last), occupancy) = (self.range, Arc::new(self.occupancy));
        Surfaces { first, last, is_opaque, occupancy, is_invented: invent && first < last }
    }
}

/// Calls `each` with every row of `sources`, which have one size, read `rows` rows at a time; the row of a source that is absent is empty.
///
/// # Errors
/// A source cannot be read; errors of `each`.
pub fn for_each_row<const N: usize>(
    sources: &[Option<&dyn ChartSource>; N],
    rows: usize,
    mut each: impl FnMut(usize, &[&[f32]; N]) -> Result<()>,
) -> Result<()> {
    let Some(size) = sources.iter().flatten().map(|source| source.size()).next() else { return Ok(()) };
    let rows = rows.min(size.height);
    let mut pixels = sources.map(|source| vec![0f32; source.map_or(0, |_| rows * size.width)]);
    for first in (0..size.height).step_by(rows) {
        let rect = Rect::new(first as i64, 0, rows.min(size.height - first), size.width);
        for (source, pixels) in std::iter::zip(sources, &mut pixels) {
            if let Some(source) = source {
                let part = &mut pixels[..rect.size().pixels()];
                source.read(0, rect, part).map_err(anyhow::Error::from_boxed)?;
            }
        }
        for y in 0..rect.height {
            let of = |i: usize| pixels[i].get(y * size.width..(y + 1) * size.width).unwrap_or_default();
            each(first + y, &std::array::from_fn(of))?;
        }
    }
    Ok(())
}
