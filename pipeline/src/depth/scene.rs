//! Remapped image per slab: the planes of a film rectangle.
//!
//! For every slab that has pixels in reach, and every film pixel:
//!
//! ```text
//! a = Σ_q share_q                 share of the pixel's area whose surfaces lie in the slab
//! c = R·Σ_q share_q·chart_q       light
//! m = Σ_q share_q·t_q             share times position in the slab
//! share_q = [V_q in slab]·coverage_q·Π_{p<q, same slab} (1 − coverage_p)      per chart pixel: "over" in the order of the sheets
//! ```
//! The map from film to chart and R are those of the slab's middle vergence ([`crate::lens::depth`]). Scale ≥ 1: charts are interpolated as in
//! [`crate::remap`], within one surface (`surface`); shares and distances are those of the nearest chart pixel, since a distance between two surfaces is
//! that of neither. Scale < 1: means over the film pixel. Neither values nor distances where the coverage is 0 count. What no sheet covers is black behind
//! everything: `uncovered`.

use super::hidden::Hidden;
use super::occupancy::Occupancy;
use super::planes::{Planes, SlabPlanes};
use super::sheet::{ChangedDistance, Distance, InvalidDistance, Sheet};
use super::slabs::Slabs;
use super::surface::{Surface, beyond_chart, uncovered};
use crate::buffer::resize_exact;
use crate::field::Field;
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Frame, Rect};
use crate::remap::ChartInterpolation;
use crate::remap::map::{Map, Points, min_max};
use crate::remap::surround::read_with_surround;
use crate::resample::{Surround, box_span, box_weights};
use std::collections::BTreeSet;

/// What determines the planes of one band.
#[derive(Debug)]
pub struct Scene {
    frame: Frame,
    slabs: Slabs,
    /// Slabs that the scene was found to have.
    occupied: Vec<bool>,
    /// Heights and gain at each slab's middle vergence.
    fields: Vec<Field>,
    /// Whether the map is the same for all slabs: no pupil shift.
    same_map: bool,
    interpolation: ChartInterpolation,
}

/// Pixels of one sheet on a rectangle of the chart.
#[derive(Debug, Default)]
struct SheetPixels {
    /// Slab, or that of pixels that are not covered or beyond the chart.
    slab: Vec<u16>,
    position: Vec<f32>,
    share: Vec<f32>,
    /// Light of the surface alone.
    chart: Vec<f32>,
}

/// Buffers of one worker.
#[derive(Debug, Default)]
pub(super) struct SceneScratch {
    sheets: Vec<SheetPixels>,
    /// Product of (1 − coverage) over all sheets.
    open: Vec<f32>,
    /// Coverages of a sheet whose light is multiplied by them.
    coverage: Vec<f32>,
    raw: Vec<f32>,
    inside: Vec<f32>,
    points: Points,
    wy: Vec<f32>,
    wx: Vec<f32>,
}

/// Distance of the film pixels whose place on the chart is computed to find out what is there, px; the map is smooth, blocks of the occupancy are wider.
const STEP_PX: usize = 16;

/// First and last of rows and columns of the chart.
type Cells = ((i64, i64), (i64, i64));

impl Scene {
    /// For `fields` at the middle of each of `slabs`, of which the scene has those `occupied`; `same_map`: their heights are equal.
    pub(super) fn new(
        frame: &Frame,
        (slabs, occupied): (&Slabs, &[bool]),
        fields: Vec<Field>,
        same_map: bool,
        interpolation: ChartInterpolation,
    ) -> Self {
        let (slabs, occupied) = (slabs.clone(), occupied.to_vec());
        Self { frame: *frame, slabs, occupied, fields, same_map, interpolation }
    }

    /// The planes of the film rectangle `rect` of `sheets` and band `band` of `chart` into `planes`.
    ///
    /// # Errors
    /// Those of the sources; a distance that is not positive.
    pub(super) fn planes(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        sheets: &[Sheet<'_>],
        rect: Rect,
        planes: &mut Planes,
        s: &mut SceneScratch,
    ) -> Result<(), SourceSinkError> {
        let chart_rect = self.chart_rect(rect, s);
        let present = self.read(chart, band, sheets, chart_rect, s)?;
        planes.rect = Some(rect);
        planes.slabs.clear();
        let n = rect.size().pixels();
        for slab in present {
            let mut to = SlabPlanes::zeros(planes.free.pop(), slab, n);
            match self.averages() {
                true => self.average(&self.fields[slab], slab, rect, chart_rect, &mut to, s),
                false => self.interpolate(slab, rect, chart_rect, &mut to, s),
            }
            planes.slabs.extend(to.trimmed(rect.width));
            planes.free.push(to);
        }
        self.uncovered(rect, chart_rect, &mut planes.uncovered, s);
        Ok(())
    }

    /// Whether the chart is averaged over film pixels.
    fn averages(&self) -> bool {
        self.frame.scale.0.min(self.frame.scale.1) < 1.0
    }

    /// Sides of the box that is averaged, chart pixels (rows, columns).
    fn box_sides(&self) -> (f64, f64) {
        ((1.0 / self.frame.scale.0).max(1.0), (1.0 / self.frame.scale.1).max(1.0))
    }

    /// Whether a surface may be hidden behind another one under `rect`, by where the scene was found to have surfaces.
    pub(super) fn may_hide(&self, rect: Rect, hidden: &Hidden, occupancy: &Occupancy) -> bool {
        let at_steps = |first: i64, end: i64| (first..end).step_by(STEP_PX).chain([end - 1]);
        let (mut y, mut x) = ((i64::MAX, i64::MIN), (i64::MAX, i64::MIN));
        for field in [&self.fields[0], &self.fields[self.fields.len() - 1]] {
            let map = Map::new(&self.frame, field);
            for row in at_steps(rect.y, rect.bottom()) {
                for column in at_steps(rect.x, rect.right()) {
                    let (row, col, _) = map.at(row, column);
                    let (row, col) = (row.round() as i64, col.round() as i64);
                    y = (y.0.min(row), y.1.max(row));
                    x = (x.0.min(col), x.1.max(col));
                }
            }
        }
        let rect = Rect::new(y.0, x.0, (y.1 - y.0 + 1) as usize, (x.1 - x.0 + 1) as usize);
        hidden.may_be_in(rect, occupancy)
    }

    /// The chart rectangle under `rect` for all slabs. Coordinates are linear in vergence, so the first and the last slab bound them.
    fn chart_rect(&self, rect: Rect, s: &mut SceneScratch) -> Rect {
        let last = self.fields.len() - 1;
        let mut all = self.cells(&self.fields[0], rect, s);
        if !self.same_map && last > 0 {
            let ((y0, y1), (x0, x1)) = self.cells(&self.fields[last], rect, s);
            all = ((all.0.0.min(y0), all.0.1.max(y1)), (all.1.0.min(x0), all.1.1.max(x1)));
        }
        let ((y0, y1), (x0, x1)) = all;
        Rect::new(y0, x0, (y1 - y0 + 1) as usize, (x1 - x0 + 1) as usize)
    }

    /// Chart pixels that the map of `field` needs under `rect`.
    fn cells(&self, field: &Field, rect: Rect, s: &mut SceneScratch) -> Cells {
        let map = Map::new(&self.frame, field);
        if !self.averages() {
            map.fill(rect, &mut s.points);
            let (rows, cols) = (min_max(&s.points.row), min_max(&s.points.col));
            return ((rows.0 - 1, rows.1 + 2), (cols.0 - 1, cols.1 + 2));
        }
        let (by, bx) = self.box_sides();
        let (mut y, mut x) = ((i64::MAX, i64::MIN), (i64::MAX, i64::MIN));
        for row in rect.y..rect.bottom() {
            for col in rect.x..rect.right() {
                let (row, col, _) = map.at(row, col);
                let ((y0, h), (x0, w)) = (box_span(row, by), box_span(col, bx));
                y = (y.0.min(y0), y.1.max(y0 + h as i64 - 1));
                x = (x.0.min(x0), x.1.max(x0 + w as i64 - 1));
            }
        }
        (y, x)
    }

    /// Reads the sheets on `rect` of the chart; the slabs that have pixels there.
    fn read(
        &self,
        chart: &dyn ChartSource,
        band: usize,
        sheets: &[Sheet<'_>],
        rect: Rect,
        s: &mut SceneScratch,
    ) -> Result<BTreeSet<usize>, SourceSinkError> {
        let (n, surround) = (rect.size().pixels(), self.interpolation.surround);
        let mut present = vec![false; self.slabs.count()];
        s.sheets.resize_with(sheets.len(), SheetPixels::default);
        resize_exact(&mut s.open, n);
        resize_exact(&mut s.raw, n);
        s.open.fill(1.0);
        for (q, sheet) in sheets.iter().enumerate() {
            let (before, rest) = s.sheets.split_at_mut(q);
            let to = &mut rest[0];
            for plane in [&mut to.share, &mut to.chart, &mut to.position] {
                resize_exact(plane, n);
            }
            to.slab.resize(n, 0);
            match sheet.coverage {
                None => to.share.fill(1.0),
                Some(source) => {
                    read_with_surround(source, 0, rect, surround, &mut to.share, &mut s.inside)?;
                }
            }
            if sheet.is_premultiplied {
                s.coverage.clone_from(&to.share);
            }
            read_with_surround(sheet.depth, 0, rect, surround, &mut s.raw, &mut s.inside)?;
            self.place(&sheet.distance, rect, &s.raw, to)?;
            for i in 0..n {
                let coverage = to.share[i];
                for over in before.iter().filter(|over| over.slab[i] == to.slab[i]) {
                    // `share` of a sheet above is its coverage times what is open; the rest of its pixel is open.
                    to.share[i] -= (coverage * over.share[i]).min(to.share[i]);
                }
                s.open[i] *= 1.0 - coverage;
                if to.share[i] > 0.0 {
                    present[usize::from(to.slab[i])] = true;
                }
            }
            if to.share.iter().any(|share| *share > 0.0) {
                let from = sheet.chart.unwrap_or(chart);
                read_with_surround(from, band, rect, surround, &mut to.chart, &mut s.inside)?;
                if sheet.is_premultiplied {
                    let covered = |(_, coverage): &(&mut f32, &f32)| **coverage > 0.0;
                    let all = to.chart.iter_mut().zip(&s.coverage).filter(covered);
                    all.for_each(|(light, coverage)| *light /= coverage);
                }
            } else {
                to.chart.fill(0.0);
            }
        }
        Ok((0..present.len()).filter(|&slab| present[slab]).collect())
    }

    /// Slab and position of the distances `raw` on `rect` of the chart where its share is not 0. Outside a chart with a black surround the share becomes 0.
    fn place(
        &self,
        distance: &Distance,
        rect: Rect,
        raw: &[f32],
        to: &mut SheetPixels,
    ) -> Result<(), SourceSinkError> {
        let (size, surround) = (self.frame.chart, self.interpolation.surround);
        let columns: Vec<_> =
            (0..rect.width as i64).map(|x| surround.index(rect.x + x, size.width)).collect();
        // Neighbouring pixels often have the same distance.
        let mut last = (f32::NAN, 0, 0.0);
        for y in 0..rect.height {
            let row = surround.index(rect.y + y as i64, size.height);
            for (x, column) in columns.iter().enumerate() {
                let i = y * rect.width + x;
                let (Some(row), Some(column)) = (row, *column) else {
                    (to.slab[i], to.position[i], to.share[i]) = (beyond_chart(self.slabs.count()), 0.0, 0.0);
                    continue;
                };
                if to.share[i] <= 0.0 {
                    (to.slab[i], to.position[i]) = (uncovered(self.slabs.count()), 0.0);
                    continue;
                }
                let value = raw[i];
                if value != last.0 || distance.ray_focal_mm.is_some() {
                    let ideal = Distance::ideal_mm(&self.frame, row, column);
                    let v = distance.vergence(value, ideal).ok_or(InvalidDistance { row, column, value })?;
                    let slab = self.slabs.of(v);
                    if !self.occupied[slab] {
                        return Err(ChangedDistance { row, column, value }.into());
                    }
                    last = (value, slab as u16, self.slabs.position(slab, v) as f32);
                }
                (to.slab[i], to.position[i]) = (last.1, last.2);
            }
        }
        Ok(())
    }

    fn interpolate(&self, slab: usize, rect: Rect, from: Rect, to: &mut SlabPlanes, s: &mut SceneScratch) {
        let map = Map::new(&self.frame, &self.fields[slab]);
        if !self.same_map {
            map.fill(rect, &mut s.points);
        }
        // Else they are those that `cells` computed for slab 0.
        let p = &s.points;
        let (id, is_of) = (slab as u16, self.of_surface(slab));
        for y in 0..rect.height {
            for x in 0..rect.width {
                let (i, k) = (y * p.stride + x, y * rect.width + x);
                let (row, col) =
                    ((i64::from(p.row[i]) - from.y) as usize, (i64::from(p.col[i]) - from.x) as usize);
                let (fy, fx) = (p.row_fraction[i], p.col_fraction[i]);
                let nearest = (row + usize::from(fy >= 0.5)) * from.width + col + usize::from(fx >= 0.5);
                let (mut a, mut c, mut m) = (0.0, 0.0, 0.0);
                for sheet in s.sheets.iter().filter(|sheet| sheet.slab[nearest] == id) {
                    let share = sheet.share[nearest];
                    if share > 0.0 {
                        let surface = Surface {
                            chart: &sheet.chart,
                            slab: &sheet.slab,
                            is_of: &is_of,
                            stride: from.width,
                        };
                        let value = surface.value(self.interpolation.interp, row * from.width + col, fy, fx);
                        a += share;
                        c += share * value;
                        m += share * sheet.position[nearest];
                    }
                }
                if a > 0.0 {
                    let gain = match self.same_map {
                        true => map.at(rect.y + y as i64, rect.x + x as i64).2 as f32,
                        false => p.gain[i],
                    };
                    (to.a[k], to.c[k], to.m[k]) = (a, c * gain, m);
                }
            }
        }
    }

    /// Whether chart pixels of each slab number are of the surface of `slab`.
    fn of_surface(&self, slab: usize) -> Vec<bool> {
        let count = self.slabs.count();
        let mut is_of: Vec<bool> =
            (0..count).map(|other| !self.slabs.apart(slab.min(other), slab.max(other))).collect();
        is_of.resize(usize::from(beyond_chart(count)) + 1, false);
        is_of[usize::from(beyond_chart(count))] = true;
        is_of
    }

    fn average(
        &self,
        field: &Field,
        slab: usize,
        rect: Rect,
        from: Rect,
        to: &mut SlabPlanes,
        s: &mut SceneScratch,
    ) {
        let id = slab as u16;
        let mut k = 0;
        self.for_each_box(field, rect, from, s, |s, first, height, width, gain| {
            let (mut a, mut c, mut m) = (0.0f64, 0.0f64, 0.0f64);
            for y in 0..height {
                let at = first + y * from.width;
                for sheet in &s.sheets {
                    for x in 0..width {
                        if sheet.slab[at + x] == id {
                            let share =
                                f64::from(s.wy[y]) * f64::from(s.wx[x]) * f64::from(sheet.share[at + x]);
                            a += share;
                            c += share * f64::from(sheet.chart[at + x]);
                            m += share * f64::from(sheet.position[at + x]);
                        }
                    }
                }
            }
            (to.a[k], to.c[k], to.m[k]) = (a as f32, (c * gain) as f32, m as f32);
            k += 1;
        });
    }

    /// Calls `each` with the box of chart pixels under every pixel of `rect`: its first pixel in the buffers of the chart rectangle `from`, its rows
    /// and columns (their weights are in `wy` and `wx`), and the gain.
    fn for_each_box(
        &self,
        field: &Field,
        rect: Rect,
        from: Rect,
        s: &mut SceneScratch,
        mut each: impl FnMut(&SceneScratch, usize, usize, usize, f64),
    ) {
        let map = Map::new(&self.frame, field);
        let (by, bx) = self.box_sides();
        for y in rect.y..rect.bottom() {
            for x in rect.x..rect.right() {
                let (row, col, gain) = map.at(y, x);
                let ((y0, h), (x0, w)) = (box_span(row, by), box_span(col, bx));
                box_weights(row, by, y0, &mut s.wy, h);
                box_weights(col, bx, x0, &mut s.wx, w);
                let first = (y0 - from.y) as usize * from.width + (x0 - from.x) as usize;
                each(s, first, h, w, gain);
            }
        }
    }

    /// What no sheet covers, by the map of the farthest slab.
    fn uncovered(&self, rect: Rect, from: Rect, to: &mut Vec<f32>, s: &mut SceneScratch) {
        resize_exact(to, rect.size().pixels());
        let inside = self.frame.chart.rect().contains(from) || self.interpolation.surround != Surround::Black;
        if inside && s.open.iter().all(|open| *open == 0.0) {
            return to.fill(0.0);
        }
        if self.averages() {
            let mut k = 0;
            return self.for_each_box(&self.fields[0], rect, from, s, |s, first, height, width, _| {
                let row = |y: usize| {
                    let open = &s.open[first + y * from.width..][..width];
                    let sum: f64 =
                        std::iter::zip(open, &s.wx).map(|(o, w)| f64::from(*o) * f64::from(*w)).sum();
                    f64::from(s.wy[y]) * sum
                };
                to[k] = (0..height).map(row).sum::<f64>() as f32;
                k += 1;
            });
        }
        Map::new(&self.frame, &self.fields[0]).fill(rect, &mut s.points);
        let p = &s.points;
        for y in 0..rect.height {
            for x in 0..rect.width {
                let i = y * p.stride + x;
                let row = (i64::from(p.row[i]) - from.y) as usize + usize::from(p.row_fraction[i] >= 0.5);
                let col = (i64::from(p.col[i]) - from.x) as usize + usize::from(p.col_fraction[i] >= 0.5);
                to[y * rect.width + x] = s.open[row * from.width + col];
            }
        }
    }
}
