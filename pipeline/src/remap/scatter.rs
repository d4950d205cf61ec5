//! The transpose of the remap stage: each pixel of the remapped image scatters its value, times its gain and weights, onto the chart pixels that it reads.
//!
//! ```text
//! chart(i, j) += Σ_(Y, X) gain · R(r) · w_i(row) · w_j(column) · remapped(Y, X)
//! ```
//! Coordinates, gains and weights are those of [`Remap::apply`] on the same engine, to the last bit. A part of the remapped image is scattered onto a rectangle of the chart
//! and its surroundings, whose pixels are then added to the chart pixels that stand for them ([`add_with_surround`]).

#[cfg(target_arch = "x86_64")]
mod points;

#[cfg(target_arch = "x86_64")]
use super::lanes::{FillAnchors, RadialAnchors};
#[cfg(target_arch = "x86_64")]
use super::map::Map;
use super::map::{Points, min_max};
#[cfg(target_arch = "x86_64")]
use super::planar::PlanarChartMap;
#[cfg(target_arch = "x86_64")]
use super::planar::lanes::FillPlanarAnchors;
use super::surround::add_with_surround;
use super::{BandMap, Remap, RemapScratch};
use crate::field::Field;
use crate::geometry::Rect;
use crate::resample::{Interp, Surround, box_span, box_weights, cubic};
use crate::simd::Simd;
#[cfg(target_arch = "x86_64")]
use crate::simd::lanes::{Dispatch, Lanes};
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512, Isa};
#[cfg(target_arch = "x86_64")]
use points::ExpandPoints;

/// Light on a rectangle of the chart and its surroundings.
#[derive(Debug, Default)]
pub(crate) struct ChartPart {
    rect: Option<Rect>,
    /// Row-major.
    values: Vec<f32>,
}

impl ChartPart {
    /// An empty rectangle becomes `rect`, of zeros.
    fn reset(&mut self, rect: Rect) {
        self.rect = Some(rect);
        self.values.clear();
        self.values.resize(rect.size().pixels(), 0.0);
    }
}

impl Remap {
    /// The tables of the map of a lens with rotational symmetry.
    pub(crate) fn field(&self) -> Option<&Field> {
        match &self.band_map {
            BandMap::Radial { field, .. } => Some(field),
            BandMap::Planar(_) => None,
        }
    }

    /// Values outside the chart.
    pub(crate) fn surround(&self) -> Surround {
        self.interpolation.surround
    }

    /// The instruction set.
    pub(crate) fn simd(&self) -> Simd {
        self.simd
    }

    /// The parts of the remapped image on `rect` that are scattered one by one.
    pub(crate) fn parts(&self, rect: Rect) -> impl Iterator<Item = Rect> + use<> {
        let (rows, cols) = self.part_size();
        rect.tiles(rows, cols)
    }

    /// Scatters the remapped pixels of `part`, one of [`Remap::parts`], onto `to`; `from` has them from the first on, rows `stride` apart.
    pub(crate) fn scatter(
        &self,
        part: Rect,
        (from, stride): (&[f32], usize),
        to: &mut ChartPart,
        s: &mut RemapScratch,
    ) {
        let is_dark = |row: &[f32]| row[..part.width].iter().all(|v| *v == 0.0);
        if from.chunks(stride).take(part.height).all(is_dark) {
            to.rect = None;
            return;
        }
        let (sy, sx) = self.frame.scale;
        match sy.min(sx) < 1.0 {
            true => self.spread(part, (from, stride), to, s),
            false => {
                self.fill_points(part, s);
                self.scatter_points(part, (from, stride), to, &s.points);
            }
        }
    }

    /// Adds `part` to `chart` (row-major, of the frame's size).
    pub(crate) fn add_part(&self, part: &ChartPart, chart: &mut [f32]) {
        if let Some(rect) = part.rect {
            let surround = self.interpolation.surround;
            add_with_surround((&part.values, rect), surround, (chart, self.frame.chart));
        }
    }

    /// Coordinates and gains of the pixels of `rect`, in `s.points`.
    fn fill_points(&self, rect: Rect, s: &mut RemapScratch) {
        match self.simd.isa() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => self.expand_points::<Avx512>(rect, s),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => self.expand_points::<Avx2>(rect, s),
            _ => self.map().fill(rect, &mut s.points, &mut s.film_row),
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn expand_points<V: Lanes>(&self, rect: Rect, s: &mut RemapScratch) {
        let dispatch = Dispatch::<V>::new(self.simd);
        let RemapScratch { points: to, anchors, planar_anchors, film_row, .. } = s;
        match &self.band_map {
            BandMap::Radial { field, knots } => {
                let map = Map::new(&self.frame, field);
                dispatch.run(FillAnchors { map, knots, rect, to: anchors });
                let anchors = RadialAnchors { map, knots, anchors, y: rect.y };
                dispatch.run(ExpandPoints { anchors, rect, to });
            }
            BandMap::Planar(field) => {
                let map = PlanarChartMap::new(&self.frame, field);
                dispatch.run(FillPlanarAnchors { map, rect, film_row, to: planar_anchors });
                dispatch.run(ExpandPoints { anchors: &*planar_anchors, rect, to });
            }
        }
    }

    /// Scatters the pixels of `part` at `points` (scale ≥ 1).
    fn scatter_points(
        &self,
        part: Rect,
        (from, stride): (&[f32], usize),
        to: &mut ChartPart,
        points: &Points,
    ) {
        let (chart_rect, first) = self.interpolation.chart_rect((
            cells(&points.row, points.stride, part.width),
            cells(&points.col, points.stride, part.width),
        ));
        to.reset(chart_rect);
        for (y, from) in from.chunks(stride).take(part.height).enumerate() {
            for (x, value) in from[..part.width].iter().enumerate() {
                let i = y * points.stride + x;
                let (row, col) = ((points.row[i] - first.0) as usize, (points.col[i] - first.1) as usize);
                let to = &mut to.values[row * chart_rect.width + col..];
                let (fy, fx) = (points.row_fraction[i], points.col_fraction[i]);
                let value = value * points.gain[i];
                match self.interpolation.interp {
                    Interp::Bicubic => add_taps((cubic(fy), cubic(fx)), value, to, chart_rect.width),
                    Interp::Bilinear => {
                        add_taps(([1.0 - fy, fy], [1.0 - fx, fx]), value, to, chart_rect.width);
                    }
                }
            }
        }
    }

    /// Spreads the pixels of `part` over the boxes that they are means of (scale < 1).
    fn spread(&self, part: Rect, (from, stride): (&[f32], usize), to: &mut ChartPart, s: &mut RemapScratch) {
        let (chart_rect, (by, bx)) = self.boxes(part, s);
        to.reset(chart_rect);
        for (y, from) in from.chunks(stride).take(part.height).enumerate() {
            for (x, value) in from[..part.width].iter().enumerate() {
                let (row_at, col_at, gain) = s.places[y * part.width + x];
                let ((y0, h), (x0, w)) = (box_span(row_at, by), box_span(col_at, bx));
                box_weights(row_at, by, y0, &mut s.wy, h);
                box_weights(col_at, bx, x0, &mut s.wx, w);
                let value = value * gain as f32;
                for (j, wy) in s.wy.iter().enumerate() {
                    let row = (y0 - chart_rect.y) as usize + j;
                    let to = &mut to.values[row * chart_rect.width + (x0 - chart_rect.x) as usize..][..w];
                    to.iter_mut().zip(&s.wx).for_each(|(to, wx)| *to += wy * wx * value);
                }
            }
        }
    }
}

/// Minimum and maximum cell of the first `width` of each `stride` pixels.
fn cells(cells: &[i32], stride: usize, width: usize) -> (i64, i64) {
    if width == stride {
        return min_max(cells);
    }
    let of_rows = cells.chunks_exact(stride).flat_map(|row| &row[..width]);
    let (low, high) = of_rows.fold((i32::MAX, i32::MIN), |(low, high), v| (low.min(*v), high.max(*v)));
    (i64::from(low), i64::from(high))
}

/// Adds `value` times the weights of N × N taps to the pixels that start at `to`, rows `stride` apart.
#[inline(always)]
fn add_taps<const N: usize>((wy, wx): ([f32; N], [f32; N]), value: f32, to: &mut [f32], stride: usize) {
    for (j, wy) in wy.into_iter().enumerate() {
        let line: &mut [f32; N] = (&mut to[j * stride..][..N]).try_into().expect("N");
        let value = wy * value;
        for (to, wx) in line.iter_mut().zip(wx) {
            *to += wx * value;
        }
    }
}
