//! Depth arrays as they are used: the largest number of 16-bit floats is infinity, and distances between two surfaces can be replaced.
//!
//! A renderer that filters its depth writes, in the pixels of an edge, distances at which there is no surface. Such a pixel lies between two opposite
//! neighbours a, b (left and right, or above and below) whose blur differs by more than [`EDGE_PX`], apart from both by more than [`APART_PX`]: the
//! last pixel of a curved surface before its silhouette lies between its neighbours as well, but close to one.
//!
//! ```text
//! (V − V_a)·(V − V_b) < 0,   |V_a − V_b|·s > 2 px,   |V − V_a|·s > 0.5 px,   |V − V_b|·s > 0.5 px,   s: blur per dioptre
//! ```
//! `--depth-edges snap` gives it the distance of the nearer one. It depends on the stored distances and the coverage alone, so not on tiles.
//!
//! Where the coverage is 0 there is no surface: what is stored there is not a distance.
//!
//! An outlier differs by more than 2 px from all its four neighbours, which are of one surface.

use crate::open::Chart;
use formats::chart::{RasterSample, Sample};
use pipeline::depth::sheet::Distance;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Frame, Rect, Size};

/// Difference of two neighbours' blur radii from which on they are different surfaces, film px.
const EDGE_PX: f64 = 2.0;
/// Difference of blur radii from which on a pixel is apart from a neighbour, film px.
const APART_PX: f64 = 0.5;
/// Largest finite number of 16-bit floats, which renderers write for infinity.
const F16_MAX: f32 = 65504.0;

/// A depth array.
pub struct CleanDepth {
    /// As stored.
    pub chart: Chart,
    /// Share of each pixel that the surface covers, if it has holes.
    pub coverage: Option<Chart>,
    /// Stored numbers from here on are infinity.
    far_value: f32,
    /// Finds interpolated pixels, which are replaced.
    snap: Option<Edges>,
}

/// Finds interpolated pixels.
#[derive(Clone, Copy)]
pub struct Edges {
    /// What a stored number means.
    pub distance: Distance,
    /// Place of the chart's pixels.
    pub frame: Frame,
    /// Blur radius per dioptre, film px.
    pub blur_px: f64,
}

/// What the neighbours of a pixel show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Neighbourhood {
    /// Whether two opposite neighbours are of different surfaces.
    pub is_edge: bool,
    /// Row and column, from the pixel, of the nearer one of two neighbours that it lies between.
    pub nearer: Option<(isize, isize)>,
    /// Whether its neighbours are of one surface, and it is not.
    pub is_outlier: bool,
}

impl CleanDepth {
    /// The array `chart` of a surface with `coverage`.
    pub fn new(chart: Chart, coverage: Option<Chart>) -> Self {
        let far_value = if is_f16(&chart) { F16_MAX } else { f32::INFINITY };
        Self { chart, coverage, far_value, snap: None }
    }

    /// Replaces the pixels that `edges` finds.
    pub fn snap(&mut self, edges: Edges) {
        self.snap = Some(edges);
    }

    /// Whether interpolated pixels are replaced.
    pub fn is_snapped(&self) -> bool {
        self.snap.is_some()
    }

    /// Whether its numbers have 16 bits.
    pub fn is_f16(&self) -> bool {
        self.far_value < f32::INFINITY
    }

    fn read_stored(&self, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        self.chart.source().read(0, rect, out)?;
        out.iter_mut().filter(|v| **v >= self.far_value).for_each(|v| *v = f32::INFINITY);
        Ok(())
    }
}

impl ChartSource for CleanDepth {
    fn size(&self) -> Size {
        self.chart.size()
    }

    fn read(&self, _: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        let Some(edges) = &self.snap else { return self.read_stored(rect, out) };
        let around = rect.grown(1).intersect(self.size().rect());
        let mut stored = vec![0.0; around.size().pixels()];
        self.read_stored(around, &mut stored)?;
        let mut covered = vec![1.0; stored.len()];
        if let Some(coverage) = &self.coverage {
            coverage.source().read(0, around, &mut covered)?;
        }
        let row = |y: usize| {
            let at = |x: usize| {
                let (i, x) = (y * around.width + x, around.x as usize + x);
                let v = |value| edges.vergence(value, around.y as usize + y, x).unwrap_or(0.0);
                if covered[i] > 0.0 { v(stored[i]) } else { f64::NAN }
            };
            (0..around.width).map(at).collect()
        };
        let vergence: Vec<Vec<f64>> = (0..around.height).map(row).collect();
        let (first_y, first_x) = ((rect.y - around.y) as usize, (rect.x - around.x) as usize);
        for (y, line) in (first_y..).zip(out.chunks_exact_mut(rect.width)) {
            let above = y.checked_sub(1).map(|y| &vergence[y][..]);
            let below = vergence.get(y + 1).map(|row| &row[..]);
            for (x, value) in (first_x..).zip(line) {
                let (dy, dx) = edges.around(above, &vergence[y], below, x).nearer.unwrap_or_default();
                *value = stored[y.strict_add_signed(dy) * around.width + x.strict_add_signed(dx)];
            }
        }
        Ok(())
    }
}

impl Edges {
    /// Vergence of the stored number `value` of a pixel, 1/m; `None` for a distance that is not valid.
    pub fn vergence(&self, value: f32, row: usize, column: usize) -> Option<f64> {
        self.distance.vergence(value, Distance::ideal_mm(&self.frame, row, column))
    }

    /// The neighbourhood of pixel `x` of `row` between the rows `above` and `below`, all of vergences; NaN where there is no surface.
    pub fn around(
        &self,
        above: Option<&[f64]>,
        row: &[f64],
        below: Option<&[f64]>,
        x: usize,
    ) -> Neighbourhood {
        let v = row[x];
        let differ = |a: f64, b: f64, px: f64| (a - b).abs() * self.blur_px > px;
        if let (true, Some(above), Some(below)) = (x > 0 && x + 1 < row.len(), above, below) {
            let all = [row[x - 1], row[x + 1], above[x], below[x]];
            // The usual case: one surface.
            if all.iter().all(|n| !differ(v, *n, EDGE_PX / 2.0)) {
                return Neighbourhood::default();
            }
        }
        let across = (x > 0 && x + 1 < row.len()).then(|| [((0, -1), row[x - 1]), ((0, 1), row[x + 1])]);
        let down = above.zip(below).map(|(above, below)| [((-1, 0), above[x]), ((1, 0), below[x])]);
        let mut found = Neighbourhood::default();
        for &[(to_a, a), (to_b, b)] in across.iter().chain(&down) {
            if !differ(a, b, EDGE_PX) {
                continue;
            }
            found.is_edge = true;
            let is_between = (v - a) * (v - b) < 0.0;
            let is_apart = differ(v, a, APART_PX) && differ(v, b, APART_PX);
            if is_between && is_apart && found.nearer.is_none() {
                found.nearer = Some(if a > b { to_a } else { to_b });
            }
        }
        if let (Some([(_, a), (_, b)]), Some([(_, c), (_, d)])) = (across, down) {
            let (far, near) = (a.min(b).min(c).min(d), a.max(b).max(c).max(d));
            let is_beyond = |end: f64| differ(v, end, EDGE_PX);
            found.is_outlier =
                !differ(far, near, EDGE_PX) && (v < far && is_beyond(far) || v > near && is_beyond(near));
        }
        found
    }
}

/// Whether the numbers of a file have 16 bits.
fn is_f16(chart: &Chart) -> bool {
    match chart {
        Chart::Store(store) => store.sample() == Sample::F16,
        Chart::Raster(raster) => raster.sample() == RasterSample::Plain(Sample::F16),
        // Channels of OpenEXR are decoded to 32 bits.
        Chart::Decoded(decoded) => {
            decoded.identity().is_ok_and(|(content, _)| content["exr"]["channels"][0]["sample"] == "f16")
        }
        Chart::Generated(_) => false,
    }
}
