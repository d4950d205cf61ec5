//! Stages 1-2, one pass: chart → scene. Pinhole mapping, relative illumination, distortion.
//!
//!     scene(X, Y) = R(r) · chart_ideal((X, Y)·h(r)/r)
//! for the film pixel at (X, Y) mm, r = hypot(X, Y) its REAL height; R and h from [`crate::field`]. The chart lies on
//! the IDEAL image plane: chart pixel = centre of the chart + ((X, Y)·h/r − center)/(pitch·scale). Values, never flux: no
//! Jacobian, so a uniform chart gives a scene of exactly R. A gather: every film pixel asks the chart, in f64 down to an
//! integer and an f32 fraction ([`crate::resample`]), so pixels do not depend on how the film is cut.
//!
//! Strip by strip: where its pixels lie on the chart (`map`, the same bits on every path), that rectangle of the chart,
//! then the taps: scalar here, in lanes in `lanes`.

#[cfg(target_arch = "x86_64")]
mod lanes;
mod map;

use crate::field::{Field, Outside};
use crate::flow::{ChartSource, DoorError};
use crate::geometry::{Frame, Rect};
use crate::lens::{LensBand, LensError};
use crate::resample::{Interp, Surround, bicubic, bilinear, box_span, box_weights};
use crate::simd::Simd;
#[cfg(target_arch = "x86_64")]
use crate::simd::lanes::Gate;
#[cfg(target_arch = "x86_64")]
use crate::simd::{Avx2, Avx512, Isa};
#[cfg(target_arch = "x86_64")]
use lanes::Resample;
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

/// Stages 1-2 of one band.
#[derive(Debug)]
pub struct Scene {
    frame: Frame,
    field: Field,
    reading: Reading,
    simd: Simd,
}

/// Buffers of one worker.
#[derive(Debug, Default)]
pub struct SceneScratch {
    points: Points,
    gain: Vec<f32>,
    source: Vec<f32>,
    read: Vec<f32>,
    chart: Vec<(f64, f64)>,
    wy: Vec<f32>,
    wx: Vec<f32>,
}

/// Rows of film resampled at a time: their chart pixels stay in the caches.
const STRIP_ROWS: f64 = 64.0;
/// Columns of film resampled at a time.
const STRIP_COLS: f64 = 512.0;
/// Behind the chart's pixels: lanes load more than they need.
const SPARE: usize = 32;

impl Scene {
    /// The stage for `band` on the film of `frame` grown by `margin` px; `gain` multiplies every value (film units);
    /// `simd` is what it computes with.
    ///
    /// # Errors
    /// [`LensError::Outside`] if the tables end before the grown film's corner and `reading.outside` says error.
    pub fn new(
        frame: &Frame,
        band: &LensBand,
        stages: Stages,
        reading: Reading,
        margin: usize,
        gain: f64,
        simd: Simd,
    ) -> Result<Self, LensError> {
        if stages.ri || stages.distortion {
            let needed = frame.farthest_mm(frame.film.rect().grown(margin));
            let last = band.image_height_mm[band.image_height_mm.len() - 1];
            reading.outside.check("image_height table", band.wavelength_nm, needed, last)?;
        }
        let field = Field::new(band, frame.pitch_mm(), stages.distortion, stages.ri, gain);
        Ok(Self { frame: *frame, field, reading, simd })
    }

    /// Fills `out` (row-major) with the scene on the film rectangle `rect`, read from band `band` of `chart`.
    ///
    /// # Errors
    /// What `chart` reports.
    pub fn apply(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        rect: Rect,
        out: &mut [f32],
        s: &mut SceneScratch,
    ) -> Result<(), DoorError> {
        let (sy, sx) = self.frame.scale;
        let rows = (STRIP_ROWS * sy.min(1.0)).max(1.0) as usize;
        let cols = (STRIP_COLS * sx.min(1.0)).max(1.0) as usize;
        for strip in rect.tiles(rows, cols) {
            let first = (strip.y - rect.y) as usize * rect.width + (strip.x - rect.x) as usize;
            match sy.min(sx) < 1.0 {
                true => self.average(chart, band, strip, &mut out[first..], rect.width, s)?,
                false => self.interpolate(chart, band, strip, &mut out[first..], rect.width, s)?,
            }
        }
        Ok(())
    }

    fn interpolate(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        strip: Rect,
        out: &mut [f32],
        stride: usize,
        s: &mut SceneScratch,
    ) -> Result<(), DoorError> {
        let (y, x) = self.map(strip, &mut s.points);
        let (before, taps) = match self.reading.interp {
            Interp::Bicubic => (1, 4),
            Interp::Bilinear => (0, 2),
        };
        let span = |(low, high): (i64, i64)| (low - before, (high - low) as usize + taps);
        let ((y0, height), (x0, width)) = (span(y), span(x));
        self.fetch(chart, band, Rect::new(y0, x0, height, width), s)?;
        let taps = Taps {
            points: &s.points,
            source: &s.source,
            width,
            first: ((y0 + before) as i32, (x0 + before) as i32),
            strip,
            stride,
        };
        taps.apply(self.reading.interp, self.simd, out);
        Ok(())
    }

    /// Fills `points`; the least and the greatest chart row and column.
    fn map(&self, strip: Rect, points: &mut Points) -> ((i64, i64), (i64, i64)) {
        let map = Map::new(&self.frame, &self.field);
        points.resize(strip);
        match self.simd.isa() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => lanes::map::<Avx512>(self.simd, map, strip, points),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => lanes::map::<Avx2>(self.simd, map, strip, points),
            _ => {
                map.strip(strip, points);
                (ends(&points.row), ends(&points.col))
            }
        }
    }

    fn average(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        strip: Rect,
        out: &mut [f32],
        stride: usize,
        s: &mut SceneScratch,
    ) -> Result<(), DoorError> {
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
        s: &mut SceneScratch,
    ) -> Result<(), DoorError> {
        let size = chart.size();
        let n = need.size().pixels();
        s.source.resize(n + SPARE, 0.0);
        let source = &mut s.source[..n];
        if size.rect().contains(need) {
            return chart.read(band, need, source);
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
            source.fill(0.0);
            return Ok(());
        };
        let part = Rect::new(y0 as i64, x0 as i64, y1 - y0 + 1, x1 - x0 + 1);
        s.read.resize(part.size().pixels(), 0.0);
        chart.read(band, part, &mut s.read)?;
        for (y, to) in source.chunks_exact_mut(need.width).enumerate() {
            let Some(row) = surround.index(need.y + y as i64, size.height) else {
                to.fill(0.0);
                continue;
            };
            let from = &s.read[(row - y0) * part.width..][..part.width];
            for (x, to) in to.iter_mut().enumerate() {
                *to = surround.index(need.x + x as i64, size.width).map_or(0.0, |col| from[col - x0]);
            }
        }
        Ok(())
    }
}

/// The taps of one strip.
#[derive(Clone, Copy, Debug)]
struct Taps<'a> {
    points: &'a Points,
    /// The chart, `width` columns; its first pixel is the first tap of a cell at `first`.
    source: &'a [f32],
    width: usize,
    first: (i32, i32),
    strip: Rect,
    /// From line to line of the film.
    stride: usize,
}

impl Taps<'_> {
    fn apply(&self, interp: Interp, simd: Simd, out: &mut [f32]) {
        match simd.isa() {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => Gate::<Avx512>::open(simd).run(Resample { taps: self, interp, out }),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => Gate::<Avx2>::open(simd).run(Resample { taps: self, interp, out }),
            _ => self.scalar(interp, out),
        }
    }

    fn scalar(&self, interp: Interp, out: &mut [f32]) {
        let p = self.points;
        for (line, to) in out.chunks_mut(self.stride).take(self.strip.height).enumerate() {
            for (x, to) in to[..self.strip.width].iter_mut().enumerate() {
                let i = line * p.stride + x;
                let first =
                    (p.row[i] - self.first.0) as usize * self.width + (p.col[i] - self.first.1) as usize;
                let (from, fy, fx) = (&self.source[first..], p.row_fraction[i], p.col_fraction[i]);
                let value = match interp {
                    Interp::Bicubic => bicubic(from, self.width, fy, fx),
                    Interp::Bilinear => bilinear(from, self.width, fy, fx),
                };
                *to = value * p.gain[i];
            }
        }
    }
}
