//! Remap stage, chart → remapped image: pinhole mapping, relative illumination and distortion in one pass.
//!
//! ```text
//! remapped(X, Y) = gain · R(r) · chart_ideal((X, Y)·h(r)/r)
//! ```
//! for the film pixel at (X, Y) mm from the axis, r = hypot(X, Y) its REAL image height; R and h from [`crate::field`]. The chart lies on
//! the IDEAL image plane: chart pixel = middle of the chart + ((X, Y)·h/r − center)/(pitch·scale). For a lens without rotational symmetry the ideal point and R are functions
//! of (X, Y) ([`crate::field::planar`]) in place of (X, Y)·h/r and R(r). This is a gather that resamples
//! values (no Jacobian), so a uniform chart of value 1 gives exactly gain · R. Chart coordinates are f64, split into an integer and
//! an f32 fraction ([`crate::resample`]), so pixel values do not depend on the partition of the film.
//!
//! The transpose, which scatters, is in `scatter`.
//!
//! A tile is computed in parts of at most `PART_ROWS` × `PART_COLS` pixels: map them to the chart, read the chart rectangle that
//! their taps cover, interpolate. The portable path maps every pixel in f64 (`map`); SIMD maps one in sixteen (`anchors`) and expands
//! the others from it (`lanes`), within 2e-6 px. A GPU ([`cuda`]) does the same, tile by tile; `reach` bounds the chart rectangle of a
//! tile in advance.

#[cfg(target_arch = "x86_64")]
mod anchors;
mod chart_map;
pub mod cuda;
#[cfg(target_arch = "x86_64")]
mod extent;
#[cfg(target_arch = "x86_64")]
mod knots;
#[cfg(target_arch = "x86_64")]
mod lanes;
pub(crate) mod map;
pub mod memory;
mod planar;
mod reach;
mod scatter;
pub(crate) mod surround;

use crate::buffer::resize_exact;
use crate::field::planar::{FilmRow, PlanarField};
use crate::field::{Field, Outside};
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Frame, Rect, Size};
use crate::lens::LensBand;
use crate::resample::{Interp, Surround, bicubic, bilinear, box_span, box_weights};
use crate::simd::Simd;
#[cfg(target_arch = "x86_64")]
use crate::simd::lanes::{Dispatch, Lanes};
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512, Isa};
use crate::stage::{Stage, Stages};
#[cfg(target_arch = "x86_64")]
use anchors::Anchors;
use chart_map::ChartMap;
#[cfg(target_arch = "x86_64")]
use knots::Knots;
#[cfg(target_arch = "x86_64")]
use lanes::{Chart, Expand, FillAnchors, RadialAnchors, Resample};
use map::{Map, Points, min_max};
use planar::PlanarChartMap;
#[cfg(target_arch = "x86_64")]
use planar::anchors::PlanarAnchors;
#[cfg(target_arch = "x86_64")]
use planar::lanes::FillPlanarAnchors;
pub(crate) use scatter::ChartPart;
use surround::read_with_surround;

/// How the chart is interpolated and extended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChartInterpolation {
    /// Interpolation where scale ≥ 1.
    pub interp: Interp,
    /// Values outside the chart.
    pub surround: Surround,
    /// Treatment of a film larger than the lens's tables.
    pub outside: Outside,
}

impl ChartInterpolation {
    /// The chart rectangle of the taps of all cells between (minimum, maximum) rows and columns, and the cell (row, column) whose
    /// first tap is its first pixel.
    fn chart_rect(&self, (rows, cols): ((i64, i64), (i64, i64))) -> (Rect, (i32, i32)) {
        let (before, taps) = match self.interp {
            Interp::Bicubic => (1, 4),
            Interp::Bilinear => (0, 2),
        };
        let span = |(low, high): (i64, i64)| (low - before, (high - low) as usize + taps);
        let ((y, height), (x, width)) = (span(rows), span(cols));
        (Rect::new(y, x, height, width), (rows.0 as i32, cols.0 as i32))
    }
}

/// The remap stage of one band.
#[derive(Debug)]
pub struct Remap {
    frame: Frame,
    band_map: BandMap,
    interpolation: ChartInterpolation,
    simd: Simd,
}

/// Tables of the map of a band.
#[derive(Debug)]
enum BandMap {
    /// With rotational symmetry.
    Radial {
        field: Field,
        #[cfg(target_arch = "x86_64")]
        knots: Knots,
    },
    /// Without.
    Planar(PlanarField),
}

/// Buffers of one worker.
#[derive(Debug, Default)]
pub struct RemapScratch {
    points: Points,
    #[cfg(target_arch = "x86_64")]
    anchors: Anchors,
    #[cfg(target_arch = "x86_64")]
    planar_anchors: PlanarAnchors,
    /// Cubics along a film row.
    film_row: FilmRow,
    source: Vec<f32>,
    /// Chart pixels without surround.
    inside: Vec<f32>,
    /// Chart coordinates and gain of the pixels of a part.
    places: Vec<(f64, f64, f64)>,
    wy: Vec<f32>,
    wx: Vec<f32>,
}

/// A part of a tile to compute.
struct Part<'a> {
    chart: &'a dyn ChartSource,
    band: usize,
    rect: Rect,
    /// The output from the first pixel of `rect` on, rows `stride` apart.
    out: &'a mut [f32],
    stride: usize,
}

/// Film rows per part: their chart pixels stay in the caches.
const PART_ROWS: usize = 64;
/// Film columns per part: more than those of most tiles.
const PART_COLS: usize = 1024;
/// Values after the chart's pixels: SIMD loads extend beyond the last tap.
const PADDING: usize = 32;

impl Remap {
    /// The stage for `band` on the film of `frame`. [`crate::band`] checks that the lens's tables cover the film; beyond them the last
    /// values are used. `gain` multiplies every value (film units).
    pub fn new(
        frame: &Frame,
        band: &LensBand,
        stages: Stages,
        interpolation: ChartInterpolation,
        gain: f64,
        simd: Simd,
    ) -> Self {
        let (distortion, illumination) = (stages.has(Stage::Distortion), stages.has(Stage::Ri));
        if let Some(planar) = &band.planar {
            let field = PlanarField::new(&planar.map, frame.pitch_mm(), distortion, illumination, gain);
            return Self { frame: *frame, band_map: BandMap::Planar(field), interpolation, simd };
        }
        let field = Field::on_chart(band, frame, distortion, illumination, gain);
        let band_map = BandMap::Radial {
            #[cfg(target_arch = "x86_64")]
            knots: Knots::new(&field),
            field,
        };
        Self { frame: *frame, band_map, interpolation, simd }
    }

    /// The map of the band.
    fn map(&self) -> ChartMap<'_> {
        match &self.band_map {
            BandMap::Radial { field, .. } => ChartMap::Radial(Map::new(&self.frame, field)),
            BandMap::Planar(field) => ChartMap::Planar(PlanarChartMap::new(&self.frame, field)),
        }
    }

    /// Computes the remapped image on the film rectangle `rect` from band `band` of `chart` into `out` (row-major).
    ///
    /// # Errors
    /// Errors of `chart`.
    pub fn apply(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        rect: Rect,
        out: &mut [f32],
        s: &mut RemapScratch,
    ) -> Result<(), SourceSinkError> {
        let (sy, sx) = self.frame.scale;
        let (rows, cols) = self.part_size();
        for part in rect.tiles(rows, cols) {
            let first = (part.y - rect.y) as usize * rect.width + (part.x - rect.x) as usize;
            let part = Part { chart, band, rect: part, out: &mut out[first..], stride: rect.width };
            match sy.min(sx) < 1.0 {
                true => self.average(part, s)?,
                false => self.interpolate(part, s)?,
            }
        }
        Ok(())
    }

    /// Film rows and columns of a part.
    fn part_size(&self) -> (usize, usize) {
        let side = |full: f64, scale: f64| (full * scale.min(1.0)).max(1.0) as usize;
        (side(PART_ROWS as f64, self.frame.scale.0), side(PART_COLS as f64, self.frame.scale.1))
    }

    /// Approximate chart rectangle of the film rectangle `rect`, clipped to a chart of `size`: a hint for prefetching, from the corners
    /// of `rect` and the middles of its sides.
    pub fn approx_chart_rect(&self, size: Size, rect: Rect) -> Rect {
        let map = self.map();
        let (mut rows, mut cols) = ((f64::MAX, f64::MIN), (f64::MAX, f64::MIN));
        let three = |first: i64, n: usize| [first, first + n as i64 / 2, first + n as i64 - 1];
        for y in three(rect.y, rect.height) {
            for x in three(rect.x, rect.width) {
                let (row, col, _) = map.at(y, x);
                rows = (rows.0.min(row), rows.1.max(row));
                cols = (cols.0.min(col), cols.1.max(col));
            }
        }
        let span = |(low, high): (f64, f64)| (low.floor() as i64 - 2, (high - low) as usize + 6);
        let ((y, height), (x, width)) = (span(rows), span(cols));
        Rect::new(y, x, height, width).intersect(size.rect())
    }

    /// Interpolates the chart on the film rectangle `part` (scale ≥ 1).
    fn interpolate(&self, part: Part<'_>, s: &mut RemapScratch) -> Result<(), SourceSinkError> {
        match self.simd.isa() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => self.interpolate_simd::<Avx512>(part, s),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => self.interpolate_simd::<Avx2>(part, s),
            _ => self.interpolate_portable(part, s),
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn interpolate_simd<V: Lanes>(
        &self,
        part: Part<'_>,
        s: &mut RemapScratch,
    ) -> Result<(), SourceSinkError> {
        let (dispatch, rect) = (Dispatch::<V>::new(self.simd), part.rect);
        match &self.band_map {
            BandMap::Radial { field, knots } => {
                let map = Map::new(&self.frame, field);
                let mut anchors = std::mem::take(&mut s.anchors);
                dispatch.run(FillAnchors { map, knots, rect, to: &mut anchors });
                let expand = RadialAnchors { map, knots, anchors: &anchors, y: rect.y };
                let done = self.resample(dispatch, expand, anchors.cells, part, s);
                s.anchors = anchors;
                done
            }
            BandMap::Planar(field) => {
                let map = PlanarChartMap::new(&self.frame, field);
                let mut anchors = std::mem::take(&mut s.planar_anchors);
                dispatch.run(FillPlanarAnchors { map, rect, film_row: &mut s.film_row, to: &mut anchors });
                let done = self.resample(dispatch, &anchors, anchors.cells, part, s);
                s.planar_anchors = anchors;
                done
            }
        }
    }

    /// Interpolates the chart at the pixels of `part`, which lie in the chart's `cells` (minimum, maximum of rows and columns).
    #[cfg(target_arch = "x86_64")]
    fn resample<V: Lanes>(
        &self,
        dispatch: Dispatch<V>,
        anchors: impl Expand,
        cells: ((i64, i64), (i64, i64)),
        part: Part<'_>,
        s: &mut RemapScratch,
    ) -> Result<(), SourceSinkError> {
        let (chart_rect, first) = self.interpolation.chart_rect(cells);
        self.fetch(part.chart, part.band, chart_rect, s)?;
        let chart = Chart { source: &s.source, width: chart_rect.width, first };
        let Part { rect, out, stride, .. } = part;
        dispatch.run(Resample { anchors, chart, interp: self.interpolation.interp, rect, out, stride });
        Ok(())
    }

    fn interpolate_portable(&self, part: Part<'_>, s: &mut RemapScratch) -> Result<(), SourceSinkError> {
        self.map().fill(part.rect, &mut s.points, &mut s.film_row);
        let (chart_rect, first) =
            self.interpolation.chart_rect((min_max(&s.points.row), min_max(&s.points.col)));
        self.fetch(part.chart, part.band, chart_rect, s)?;
        let p = &s.points;
        for (y, to) in part.out.chunks_mut(part.stride).take(part.rect.height).enumerate() {
            for (x, to) in to[..part.rect.width].iter_mut().enumerate() {
                let i = y * p.stride + x;
                let at = (p.row[i] - first.0) as usize * chart_rect.width + (p.col[i] - first.1) as usize;
                let (from, fy, fx) = (&s.source[at..], p.row_fraction[i], p.col_fraction[i]);
                let value = match self.interpolation.interp {
                    Interp::Bicubic => bicubic(from, chart_rect.width, fy, fx),
                    Interp::Bilinear => bilinear(from, chart_rect.width, fy, fx),
                };
                *to = value * p.gain[i];
            }
        }
        Ok(())
    }

    /// Averages the chart over the pixels of the film rectangle `part` (scale < 1).
    fn average(&self, part: Part<'_>, s: &mut RemapScratch) -> Result<(), SourceSinkError> {
        let Part { rect, out, stride, .. } = part;
        let (chart_rect, (by, bx)) = self.boxes(rect, s);
        self.fetch(part.chart, part.band, chart_rect, s)?;
        for (row, to) in out.chunks_mut(stride).take(rect.height).enumerate() {
            for (col, to) in to[..rect.width].iter_mut().enumerate() {
                let (row_at, col_at, gain) = s.places[row * rect.width + col];
                let ((y0, h), (x0, w)) = (box_span(row_at, by), box_span(col_at, bx));
                box_weights(row_at, by, y0, &mut s.wy, h);
                box_weights(col_at, bx, x0, &mut s.wx, w);
                let mut sum = 0.0f64;
                for (j, wy) in s.wy.iter().enumerate() {
                    let first = (y0 - chart_rect.y) as usize + j;
                    let from = &s.source[first * chart_rect.width + (x0 - chart_rect.x) as usize..][..w];
                    let line: f64 = s.wx.iter().zip(from).map(|(w, v)| f64::from(*w) * f64::from(*v)).sum();
                    sum += f64::from(*wy) * line;
                }
                *to = sum as f32 * gain as f32;
            }
        }
        Ok(())
    }

    /// The places of the pixels of `rect` on the chart, in `s.places`; the chart rectangle of the boxes about them, and the size of a box, chart pixels.
    fn boxes(&self, rect: Rect, s: &mut RemapScratch) -> (Rect, (f64, f64)) {
        let (by, bx) = ((1.0 / self.frame.scale.0).max(1.0), (1.0 / self.frame.scale.1).max(1.0));
        s.places.resize(rect.size().pixels(), (0.0, 0.0, 0.0));
        let (mut y, mut x) = ((i64::MAX, i64::MIN), (i64::MAX, i64::MIN));
        let map = self.map();
        for (y_film, line) in (rect.y..).zip(s.places.chunks_exact_mut(rect.width)) {
            map.fill_line(y_film, rect.x, line, &mut s.film_row);
            for &(row, col, _) in line.iter() {
                let ((y0, h), (x0, w)) = (box_span(row, by), box_span(col, bx));
                y = (y.0.min(y0), y.1.max(y0 + h as i64));
                x = (x.0.min(x0), x.1.max(x0 + w as i64));
            }
        }
        (Rect::new(y.0, x.0, (y.1 - y.0) as usize, (x.1 - x.0) as usize), (by, bx))
    }

    /// Reads the chart and its surround on `rect` (which may extend beyond the chart) into `s.source`.
    fn fetch(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        rect: Rect,
        s: &mut RemapScratch,
    ) -> Result<(), SourceSinkError> {
        let n = rect.size().pixels();
        let mut source = std::mem::take(&mut s.source);
        resize_exact(&mut source, n + PADDING);
        let read = self.fill(chart, band, rect, &mut source[..n], s);
        s.source = source;
        read
    }

    /// Fills `out` (row-major) with band `band` of `chart` on `rect`, with its surround outside the chart.
    ///
    /// # Errors
    /// Errors of `chart`.
    pub fn fill(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        rect: Rect,
        out: &mut [f32],
        s: &mut RemapScratch,
    ) -> Result<(), SourceSinkError> {
        read_with_surround(chart, band, rect, self.interpolation.surround, out, &mut s.inside)
    }
}
