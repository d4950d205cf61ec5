//! Depth arrays as they are used: the largest number of 16-bit floats is infinity, and distances between two surfaces can be replaced.
//!
//! A renderer that filters its depth writes, in the pixels of an edge, distances at which there is no surface. Such a pixel lies between two opposite
//! neighbours a, b (left and right, or above and below) whose blur differs by more than [`EDGE_PX`], apart from both by more than [`APART_PX`]: the
//! last pixel of a curved surface before its silhouette lies between its neighbours as well, but close to one.
//!
//!     (V − V_a)·(V − V_b) < 0,   |V_a − V_b|·s > 2 px,   |V − V_a|·s > 0.5 px,   |V − V_b|·s > 0.5 px,   s: blur per dioptre
//! `--depth-edges snap` gives it the distance of the nearer one. It depends on the stored distances alone, so not on tiles.

use crate::open::Chart;
use anyhow::Result;
use formats::chart::{RasterSample, Sample};
use pipeline::depth::sheet::Distance;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Frame, Rect, Size};

/// Difference of two neighbours' blur radii from which on they are different surfaces, film px.
const EDGE_PX: f64 = 2.0;
/// Difference of blur radii from which on a pixel is apart from a neighbour, film px.
const APART_PX: f64 = 0.5;
/// Share of the pixels at edges from which on interpolated ones are reported.
const REPORTED_SHARE: f64 = 1e-3;
/// Largest finite number of 16-bit floats, which renderers write for infinity.
const F16_MAX: f32 = 65504.0;

/// A depth array.
pub struct CleanDepth {
    /// As stored.
    pub chart: Chart,
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

/// Interpolated pixels of an array.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Pixels between neighbours of different surfaces.
    edges: u64,
    /// Of them, those at a distance between both.
    between: u64,
    /// Row and column of the first.
    first: Option<(usize, usize)>,
}

impl CleanDepth {
    /// The array `chart`.
    pub fn new(chart: Chart) -> Self {
        let far_value = if is_f16(&chart) { F16_MAX } else { f32::INFINITY };
        Self { chart, far_value, snap: None }
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
        let vergence = edges.vergences(around, &stored);
        let (first_y, first_x) = ((rect.y - around.y) as usize, (rect.x - around.x) as usize);
        for (y, line) in out.chunks_exact_mut(rect.width).enumerate() {
            for (x, value) in line.iter_mut().enumerate() {
                let at = (first_y + y) * around.width + first_x + x;
                *value = stored[edges.between(&vergence, around.size(), at).nearer.unwrap_or(at)];
            }
        }
        Ok(())
    }
}

/// A pixel and its neighbours.
struct Neighbours {
    is_edge: bool,
    /// The nearer one of two neighbours that the pixel lies between.
    nearer: Option<usize>,
}

impl Edges {
    /// Vergences of the pixels `stored` of `rect`, 1/m; 0 where there is no valid distance.
    fn vergences(&self, rect: Rect, stored: &[f32]) -> Vec<f64> {
        let at = |i: usize| (rect.y as usize + i / rect.width, rect.x as usize + i % rect.width);
        let vergence = |(i, value): (usize, &f32)| {
            let (row, column) = at(i);
            self.distance.vergence(*value, Distance::ideal_mm(&self.frame, row, column)).unwrap_or(0.0)
        };
        stored.iter().enumerate().map(vergence).collect()
    }

    /// Pixel `at` of `vergence`, an array of `size`.
    fn between(&self, vergence: &[f64], size: Size, at: usize) -> Neighbours {
        let (y, x) = (at / size.width, at % size.width);
        let v = vergence[at];
        let mut found = Neighbours { is_edge: false, nearer: None };
        let pairs = [(x > 0 && x + 1 < size.width, 1), (y > 0 && y + 1 < size.height, size.width)];
        for (_, step) in pairs.into_iter().filter(|(inside, _)| *inside) {
            let (a, b) = (at - step, at + step);
            if (vergence[a] - vergence[b]).abs() * self.blur_px <= EDGE_PX {
                continue;
            }
            found.is_edge = true;
            let is_between = (v - vergence[a]) * (v - vergence[b]) < 0.0;
            let is_apart = |of: usize| (v - vergence[of]).abs() * self.blur_px > APART_PX;
            if is_between && is_apart(a) && is_apart(b) && found.nearer.is_none() {
                found.nearer = Some(if vergence[a] > vergence[b] { a } else { b });
            }
        }
        found
    }

    /// Looks for interpolated pixels in `depth`, read `rows` rows at a time.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn find(&self, depth: &CleanDepth, rows: usize) -> Result<Found> {
        let size = depth.size();
        let mut found = Found::default();
        for first in (0..size.height).step_by(rows) {
            let part = Rect::new(first as i64, 0, rows.min(size.height - first), size.width);
            let around = part.grown(1).intersect(size.rect());
            let mut stored = vec![0.0; around.size().pixels()];
            depth.read_stored(around, &mut stored).map_err(anyhow::Error::from_boxed)?;
            let vergence = self.vergences(around, &stored);
            let skipped = (part.y - around.y) as usize;
            for i in 0..part.size().pixels() {
                let pixel = self.between(&vergence, around.size(), i + skipped * size.width);
                found.edges += u64::from(pixel.is_edge);
                if pixel.nearer.is_some() {
                    found.between += 1;
                    found.first.get_or_insert((first + i / size.width, i % size.width));
                }
            }
        }
        Ok(found)
    }
}

impl Found {
    /// A note on the array `name`, if there are many.
    pub fn note(&self, name: &str) -> Option<String> {
        let (row, column) = self.first?;
        let share = self.between as f64 / self.edges as f64;
        (share >= REPORTED_SHARE).then(|| {
            format!(
                "{name}: {} of {} pixels at edges have a distance between those of their neighbours, e.g. row {row}, column {column}: the depth is \
                 anti-aliased, and blur is wrong there; render it with one sample per pixel, or add `--depth-edges snap`",
                self.between, self.edges
            )
        })
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
