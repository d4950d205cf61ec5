//! Stages 1-2, one pass: chart → scene. Pinhole mapping, relative illumination, distortion.
//!
//!     scene(X, Y) = R(r) · chart_ideal((X, Y)·h(r)/r)
//! for the film pixel at (X, Y) mm, r = hypot(X, Y) its REAL height; R and h from [`crate::field`]. The chart lies on
//! the IDEAL image plane: chart pixel = centre of the chart + ((X, Y)·h/r − center)/(pitch·scale). Values, never flux: no
//! Jacobian, so a uniform chart gives a scene of exactly R. A gather: every film pixel asks the chart, in f64 down to an
//! integer and an f32 fraction ([`crate::resample`]), so pixels do not depend on how the film is cut.

use crate::field::{Field, Outside};
use crate::flow::{ChartSource, DoorError};
use crate::geometry::{Frame, Rect};
use crate::lens::{LensBand, LensError};
use crate::resample::{Coordinate, Interp, Surround, bicubic, bilinear, box_span, box_weights};

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
}

/// Buffers of one worker.
#[derive(Debug, Default)]
pub struct SceneScratch {
    rows: Vec<Coordinate>,
    cols: Vec<Coordinate>,
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

impl Scene {
    /// The stage for `band` on the film of `frame` grown by `margin` px; `gain` multiplies every value (film units).
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
    ) -> Result<Self, LensError> {
        if stages.ri || stages.distortion {
            let needed = frame.farthest_mm(frame.film.rect().grown(margin));
            let last = band.image_height_mm[band.image_height_mm.len() - 1];
            reading.outside.check("image_height table", band.wavelength_nm, needed, last)?;
        }
        let field = Field::new(band, frame.pitch_mm(), stages.distortion, stages.ri, gain);
        Ok(Self { frame: *frame, field, reading })
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

    /// Calls `f(index, chart row, chart column, R)` for the film pixels of `strip`, row by row.
    fn map(&self, strip: Rect, mut f: impl FnMut(usize, f64, f64, f64)) {
        let frame = &self.frame;
        let centre = |n: usize| (n as f64 - 1.0) / 2.0;
        let offset_y = centre(frame.chart.height) - frame.center_mm.0 / (frame.pitch_mm() * frame.scale.0);
        let offset_x = centre(frame.chart.width) - frame.center_mm.1 / (frame.pitch_mm() * frame.scale.1);
        let mut i = 0;
        for y in strip.y..strip.bottom() {
            let dy = y as f64 - frame.axis_px.0;
            for x in strip.x..strip.right() {
                let dx = x as f64 - frame.axis_px.1;
                let (magnification, gain) = self.field.at((dy * dy + dx * dx).sqrt());
                let row = offset_y + dy * magnification / frame.scale.0;
                let col = offset_x + dx * magnification / frame.scale.1;
                f(i, row, col, gain);
                i += 1;
            }
        }
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
        let n = strip.size().pixels();
        s.rows.resize(n, Coordinate::default());
        s.cols.resize(n, Coordinate::default());
        s.gain.resize(n, 0.0);
        let (mut y, mut x) = ((i64::MAX, i64::MIN), (i64::MAX, i64::MIN));
        let (rows, cols, gain) = (&mut s.rows, &mut s.cols, &mut s.gain);
        self.map(strip, |i, row, col, r| {
            (rows[i], cols[i], gain[i]) = (Coordinate::new(row), Coordinate::new(col), r as f32);
            y = (y.0.min(rows[i].cell), y.1.max(rows[i].cell));
            x = (x.0.min(cols[i].cell), x.1.max(cols[i].cell));
        });
        let (before, taps) = match self.reading.interp {
            Interp::Bicubic => (1, 4),
            Interp::Bilinear => (0, 2),
        };
        let span = |(low, high): (i64, i64)| (low - before, (high - low) as usize + taps);
        let ((y0, height), (x0, width)) = (span(y), span(x));
        self.fetch(chart, band, Rect::new(y0, x0, height, width), s)?;
        for (line, to) in out.chunks_mut(stride).take(strip.height).enumerate() {
            for (x, to) in to[..strip.width].iter_mut().enumerate() {
                let i = line * strip.width + x;
                let (row, col) = (s.rows[i], s.cols[i]);
                let first = (row.cell - before - y0) as usize * width + (col.cell - before - x0) as usize;
                let value = match self.reading.interp {
                    Interp::Bicubic => bicubic(&s.source[first..], width, row.fraction, col.fraction),
                    Interp::Bilinear => bilinear(&s.source[first..], width, row.fraction, col.fraction),
                };
                *to = value * s.gain[i];
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
        s: &mut SceneScratch,
    ) -> Result<(), DoorError> {
        let n = strip.size().pixels();
        let (by, bx) = ((1.0 / self.frame.scale.0).max(1.0), (1.0 / self.frame.scale.1).max(1.0));
        s.chart.resize(n, (0.0, 0.0));
        s.gain.resize(n, 0.0);
        let (mut y, mut x) = ((i64::MAX, i64::MIN), (i64::MAX, i64::MIN));
        let (at, gain) = (&mut s.chart, &mut s.gain);
        self.map(strip, |i, row, col, r| {
            (at[i], gain[i]) = ((row, col), r as f32);
            let ((y0, h), (x0, w)) = (box_span(row, by), box_span(col, bx));
            y = (y.0.min(y0), y.1.max(y0 + h as i64));
            x = (x.0.min(x0), x.1.max(x0 + w as i64));
        });
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
        s.source.resize(need.size().pixels(), 0.0);
        if size.rect().contains(need) {
            return chart.read(band, need, &mut s.source);
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
            s.source.fill(0.0);
            return Ok(());
        };
        let part = Rect::new(y0 as i64, x0 as i64, y1 - y0 + 1, x1 - x0 + 1);
        s.read.resize(part.size().pixels(), 0.0);
        chart.read(band, part, &mut s.read)?;
        for (y, to) in s.source.chunks_exact_mut(need.width).enumerate() {
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
