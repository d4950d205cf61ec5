//! Stages 1-2, one pass: chart → remap. Pinhole mapping, relative illumination, distortion.
//!
//!     remap(X, Y) = R(r) · chart_ideal((X, Y)·h(r)/r)
//! for the film pixel at (X, Y) mm, r = hypot(X, Y) its REAL height; R and h from [`crate::field`]. The chart lies on
//! the IDEAL image plane: chart pixel = centre of the chart + ((X, Y)·h/r − center)/(pitch·scale). Values, never flux: no
//! Jacobian, so a uniform chart gives a remap of exactly R. A gather: every film pixel asks the chart, in f64 down to an
//! integer and an f32 fraction ([`crate::resample`]), so pixels do not depend on how the film is cut.
//!
//! Strip by strip: where its pixels lie on the chart, that rectangle of the chart, then the taps. On the portable path
//! every pixel is mapped in f64 (`map`); in lanes one in sixteen (`anchors`) and the rest from it, within 2e-6 px. On a GPU
//! ([`cuda`]) likewise, tile by tile: `reach` bounds the rectangle of the chart that a tile needs.

#[cfg(target_arch = "x86_64")]
mod anchors;
pub mod cuda;
#[cfg(target_arch = "x86_64")]
mod lanes;
mod map;
mod reach;

use crate::field::{Field, Outside};
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Frame, Rect, Size};
use crate::lens::LensBand;
use crate::resample::{Interp, Surround, bicubic, bilinear, box_span, box_weights};
use crate::simd::Simd;
#[cfg(target_arch = "x86_64")]
use crate::simd::lanes::{Gate, Lanes};
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512, Isa};
#[cfg(target_arch = "x86_64")]
use anchors::{Anchors, Knots};
#[cfg(target_arch = "x86_64")]
use lanes::{Anchoring, Chart, Resample};
use map::{Map, Points, ends};

/// Which of the three effects are on; the paper evaluates them independently.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stages {
    /// Relative illumination.
    pub ri: bool,
    /// Radial distortion.
    pub distortion: bool,
    /// Spatially variant PSF.
    pub svpsf: bool,
}

/// How the chart is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reading {
    /// Interpolation where scale ≥ 1.
    pub interp: Interp,
    /// Around the chart.
    pub surround: Surround,
    /// Beyond the lens's tables.
    pub outside: Outside,
}

impl Reading {
    /// The chart for the cells from the least to the greatest (row, column): it, and the cell whose first tap it begins
    /// with.
    fn needs(&self, (rows, cols): ((i64, i64), (i64, i64))) -> (Rect, (i32, i32)) {
        let (before, taps) = match self.interp {
            Interp::Bicubic => (1, 4),
            Interp::Bilinear => (0, 2),
        };
        let span = |(low, high): (i64, i64)| (low - before, (high - low) as usize + taps);
        let ((y, height), (x, width)) = (span(rows), span(cols));
        (Rect::new(y, x, height, width), (rows.0 as i32, cols.0 as i32))
    }
}

/// Stages 1-2 of one band.
#[derive(Debug)]
pub struct Remap {
    frame: Frame,
    field: Field,
    #[cfg(target_arch = "x86_64")]
    knots: Knots,
    reading: Reading,
    simd: Simd,
}

/// Buffers of one worker.
#[derive(Debug, Default)]
pub struct RemapScratch {
    points: Points,
    #[cfg(target_arch = "x86_64")]
    anchors: Anchors,
    gain: Vec<f32>,
    source: Vec<f32>,
    read: Vec<f32>,
    chart: Vec<(f64, f64)>,
    wy: Vec<f32>,
    wx: Vec<f32>,
}

/// Rows of film resampled at a time: their chart pixels stay in the caches.
const STRIP_ROWS: f64 = 64.0;
/// Columns of film resampled at a time: as a rule a whole tile's.
const STRIP_COLS: f64 = 1024.0;
/// Behind the chart's pixels: lanes load more than they need.
const SPARE: usize = 32;

impl Remap {
    /// The stage for `band` on the film of `frame`, which the lens's tables cover ([`crate::band`] checks; beyond them the
    /// last values go on); `gain` multiplies every value (film units); `simd` is what it computes with.
    pub fn new(
        frame: &Frame,
        band: &LensBand,
        stages: Stages,
        reading: Reading,
        gain: f64,
        simd: Simd,
    ) -> Self {
        let field = Field::new(band, frame.pitch_mm(), stages.distortion, stages.ri, gain);
        Self {
            frame: *frame,
            #[cfg(target_arch = "x86_64")]
            knots: Knots::new(&field),
            field,
            reading,
            simd,
        }
    }

    /// Fills `out` (row-major) with the remap on the film rectangle `rect`, read from band `band` of `chart`.
    ///
    /// # Errors
    /// What `chart` reports.
    pub fn apply(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        rect: Rect,
        out: &mut [f32],
        s: &mut RemapScratch,
    ) -> Result<(), SourceSinkError> {
        let (sy, sx) = self.frame.scale;
        let (rows, cols) = self.strip();
        for strip in rect.tiles(rows, cols) {
            let first = (strip.y - rect.y) as usize * rect.width + (strip.x - rect.x) as usize;
            match sy.min(sx) < 1.0 {
                true => self.average(chart, band, strip, &mut out[first..], rect.width, s)?,
                false => self.interpolate(chart, band, strip, &mut out[first..], rect.width, s)?,
            }
        }
        Ok(())
    }

    /// Rows and columns of film resampled at a time.
    fn strip(&self) -> (usize, usize) {
        let side = |full: f64, scale: f64| (full * scale.min(1.0)).max(1.0) as usize;
        (side(STRIP_ROWS, self.frame.scale.0), side(STRIP_COLS, self.frame.scale.1))
    }

    /// About the chart rectangle that the film rectangle `rect` is made from, cut to a chart of `size`: a hint for
    /// reading ahead, from the rectangle's corners and the middles of its sides.
    pub fn about(&self, size: Size, rect: Rect) -> Rect {
        let map = Map::new(&self.frame, &self.field);
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

    /// One interpolation: where the strip's pixels lie on the chart, that rectangle of the chart, the taps.
    fn interpolate(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        strip: Rect,
        out: &mut [f32],
        stride: usize,
        s: &mut RemapScratch,
    ) -> Result<(), SourceSinkError> {
        match self.simd.isa() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => self.in_lanes::<Avx512>(chart, band, strip, out, stride, s),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => self.in_lanes::<Avx2>(chart, band, strip, out, stride, s),
            _ => self.one_by_one(chart, band, strip, out, stride, s),
        }
    }

    #[cfg(target_arch = "x86_64")]
    fn in_lanes<V: Lanes>(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        strip: Rect,
        out: &mut [f32],
        stride: usize,
        s: &mut RemapScratch,
    ) -> Result<(), SourceSinkError> {
        let (map, knots, gate) =
            (Map::new(&self.frame, &self.field), &self.knots, Gate::<V>::open(self.simd));
        gate.run(Anchoring { map, knots, strip, to: &mut s.anchors });
        let (need, first) = self.reading.needs(s.anchors.ends);
        self.fetch(chart, band, need, s)?;
        let chart = Chart { source: &s.source, width: need.width, first };
        let interp = self.reading.interp;
        gate.run(Resample { map, knots, anchors: &s.anchors, chart, interp, strip, out, stride });
        Ok(())
    }

    fn one_by_one(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        strip: Rect,
        out: &mut [f32],
        stride: usize,
        s: &mut RemapScratch,
    ) -> Result<(), SourceSinkError> {
        s.points.resize(strip);
        Map::new(&self.frame, &self.field).strip(strip, &mut s.points);
        let (need, first) = self.reading.needs((ends(&s.points.row), ends(&s.points.col)));
        self.fetch(chart, band, need, s)?;
        let p = &s.points;
        for (line, to) in out.chunks_mut(stride).take(strip.height).enumerate() {
            for (x, to) in to[..strip.width].iter_mut().enumerate() {
                let i = line * p.stride + x;
                let at = (p.row[i] - first.0) as usize * need.width + (p.col[i] - first.1) as usize;
                let (from, fy, fx) = (&s.source[at..], p.row_fraction[i], p.col_fraction[i]);
                let value = match self.reading.interp {
                    Interp::Bicubic => bicubic(from, need.width, fy, fx),
                    Interp::Bilinear => bilinear(from, need.width, fy, fx),
                };
                *to = value * p.gain[i];
            }
        }
        Ok(())
    }

    fn average(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        strip: Rect,
        out: &mut [f32],
        stride: usize,
        s: &mut RemapScratch,
    ) -> Result<(), SourceSinkError> {
        let n = strip.size().pixels();
        let (by, bx) = ((1.0 / self.frame.scale.0).max(1.0), (1.0 / self.frame.scale.1).max(1.0));
        s.chart.resize(n, (0.0, 0.0));
        s.gain.resize(n, 0.0);
        let (mut y, mut x) = ((i64::MAX, i64::MIN), (i64::MAX, i64::MIN));
        let map = Map::new(&self.frame, &self.field);
        let lines = s.chart.chunks_exact_mut(strip.width).zip(s.gain.chunks_exact_mut(strip.width));
        for (line, (at, gain)) in (strip.y..).zip(lines) {
            for ((x_film, at), gain) in (strip.x..).zip(at).zip(gain) {
                let (row, col, r) = map.at(line, x_film);
                (*at, *gain) = ((row, col), r as f32);
                let ((y0, h), (x0, w)) = (box_span(row, by), box_span(col, bx));
                y = (y.0.min(y0), y.1.max(y0 + h as i64));
                x = (x.0.min(x0), x.1.max(x0 + w as i64));
            }
        }
        let need = Rect::new(y.0, x.0, (y.1 - y.0) as usize, (x.1 - x.0) as usize);
        self.fetch(chart, band, need, s)?;
        for (line, to) in out.chunks_mut(stride).take(strip.height).enumerate() {
            for (col, to) in to[..strip.width].iter_mut().enumerate() {
                let i = line * strip.width + col;
                let (row_at, col_at) = s.chart[i];
                let ((y0, h), (x0, w)) = (box_span(row_at, by), box_span(col_at, bx));
                box_weights(row_at, by, y0, &mut s.wy, h);
                box_weights(col_at, bx, x0, &mut s.wx, w);
                let mut sum = 0.0f64;
                for (j, wy) in s.wy.iter().enumerate() {
                    let first = (y0 - need.y) as usize + j;
                    let from = &s.source[first * need.width + (x0 - need.x) as usize..][..w];
                    let line: f64 = s.wx.iter().zip(from).map(|(w, v)| f64::from(*w) * f64::from(*v)).sum();
                    sum += f64::from(*wy) * line;
                }
                *to = sum as f32 * s.gain[i];
            }
        }
        Ok(())
    }

    /// The chart with its surround on `need` (which may lie outside), into `s.source`.
    fn fetch(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        need: Rect,
        s: &mut RemapScratch,
    ) -> Result<(), SourceSinkError> {
        let n = need.size().pixels();
        let mut source = std::mem::take(&mut s.source);
        resize_exact(&mut source, n + SPARE);
        let read = self.fill(chart, band, need, &mut source[..n], s);
        s.source = source;
        read
    }

    /// Fills `out` (row-major) with band `band` of `chart` on `need`, its surround where `need` lies outside.
    ///
    /// # Errors
    /// What `chart` reports.
    pub fn fill(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        need: Rect,
        out: &mut [f32],
        s: &mut RemapScratch,
    ) -> Result<(), SourceSinkError> {
        let read = &mut s.read;
        let size = chart.size();
        if size.rect().contains(need) {
            return chart.read(band, need, out);
        }
        let surround = self.reading.surround;
        let reached = |first: i64, count: usize, n: usize| {
            let inside = (0..count as i64).filter_map(|i| surround.index(first + i, n));
            inside.fold(None, |range: Option<(usize, usize)>, i| {
                Some(range.map_or((i, i), |(a, b)| (a.min(i), b.max(i))))
            })
        };
        let rows = reached(need.y, need.height, size.height);
        let cols = reached(need.x, need.width, size.width);
        let (Some((y0, y1)), Some((x0, x1))) = (rows, cols) else {
            out.fill(0.0);
            return Ok(());
        };
        let part = Rect::new(y0 as i64, x0 as i64, y1 - y0 + 1, x1 - x0 + 1);
        resize_exact(read, part.size().pixels());
        chart.read(band, part, &mut read[..part.size().pixels()])?;
        for (y, to) in out.chunks_exact_mut(need.width).enumerate() {
            let Some(row) = surround.index(need.y + y as i64, size.height) else {
                to.fill(0.0);
                continue;
            };
            let from = &read[(row - y0) * part.width..][..part.width];
            for (x, to) in to.iter_mut().enumerate() {
                *to = surround.index(need.x + x as i64, size.width).map_or(0.0, |col| from[col - x0]);
            }
        }
        Ok(())
    }
}

/// Resizes a buffer whose old values are not needed, without spare capacity: its size is part of the memory plan.
fn resize_exact(buffer: &mut Vec<f32>, n: usize) {
    if buffer.capacity() < n {
        *buffer = Vec::new();
        buffer.reserve_exact(n);
    }
    buffer.resize(n, 0.0);
}
