//! A picture as a list of shapes, each in one ink, painted over paper in order.
//!
//!   pixel ← pixel + c·(ink − pixel),   c = share of the pixel that the shape covers
//! which is the exact mean over the pixel wherever at most one edge crosses it (or edges along both axes, as in a grid).
//! Edges of different shapes are at least 1.5 px apart, and shapes that meet, such as the spokes of a star, are one [`Shape`];
//! exceptions are the few pixels where a circle or a diagonal crosses the ruling, mixed as uniform layers.
//! The value of a pixel depends on its position only, not on the requested rectangle, so any tiling has the same bits. Boxes and rows
//! outside the rectangle are skipped, runs inside a shape are filled. The shares of slanted and curved edges are kept for the next band
//! (`shares.rs`).

use super::coverage::{Disc, Point, Polygon, gaussian_mean};
use super::shares::Cells;
use super::sine_star::SineStar;
use crate::geometry::{Rect, Size};

/// Index of a spectrum.
pub(super) type Ink = usize;

/// A shape.
pub(super) enum Shape {
    /// Axis-parallel rectangles (x0, y0, x1, y1), at sub-pixel positions.
    Boxes(Vec<[f64; 4]>),
    /// Convex polygons that do not overlap, but may share pixels, clipped to the disc if given.
    Polygons(Vec<Polygon>, Option<Disc>),
    /// A Siemens star of sinusoidal profile.
    SineStar(SineStar),
    /// The ring between two concentric circles: centre, inner and outer radius.
    Ring(Point, f64, f64),
    /// A Gaussian of peak 1: its pixel means along x and y from the first pixel of the bounds.
    Gaussian(Vec<f64>, Vec<f64>),
}

/// A shape and its ink.
pub(super) struct Object {
    pub(super) bounds: Rect,
    shape: Shape,
    ink: Ink,
}

impl Object {
    /// Paints `area`, a part of its bounds, in `ink`; `out` are the pixels of `rect`.
    pub(super) fn paint(&self, ink: f32, rect: Rect, area: Rect, out: &mut [f32]) {
        Canvas { out, rect, area, ink }.paint(self);
    }

    /// Whether the shares of its pixels take much longer to compute than to read.
    pub(super) const fn has_costly_edges(&self) -> bool {
        matches!(self.shape, Shape::Polygons(..) | Shape::Ring(..) | Shape::SineStar(..))
    }

    /// `false` if it surely covers nothing of `area`.
    pub(super) fn may_touch(&self, area: Rect) -> bool {
        if self.bounds.intersect(area).is_empty() {
            return false;
        }
        // Two pixels wider, so that rounding does not matter.
        let (top, bottom) = (area.y as f64 - 2.0, area.bottom() as f64 + 1.0);
        let (left, right) = (area.x as f64 - 2.0, area.right() as f64 + 1.0);
        match &self.shape {
            Shape::Boxes(boxes) => {
                boxes.iter().any(|[x0, y0, x1, y1]| *x0 < right && *x1 > left && *y0 < bottom && *y1 > top)
            }
            Shape::Polygons(parts, _) => {
                parts.iter().any(|p| !p.between(1, top, bottom).between(0, left, right).corners().is_empty())
            }
            Shape::Ring([x, y], inner, outer) => {
                let far = |at: f64, low: f64, high: f64| (at - low).abs().max((high - at).abs());
                let near = |at: f64, low: f64, high: f64| (low - at).max(at - high).max(0.0);
                let square = |dx: f64, dy: f64| dx * dx + dy * dy;
                square(far(*x, left, right), far(*y, top, bottom)) > inner.max(0.0).powi(2)
                    && square(near(*x, left, right), near(*y, top, bottom)) < outer.powi(2)
            }
            Shape::Gaussian(..) | Shape::SineStar(..) => true,
        }
    }
}

/// Paper and the shapes on it.
pub(super) struct Picture {
    size: Size,
    paper: Ink,
    objects: Vec<Object>,
    cells: Cells,
}

impl Picture {
    /// Blank paper.
    pub(super) fn new(size: Size, paper: Ink) -> Self {
        Self { size, paper, objects: Vec::new(), cells: Cells::new(size) }
    }

    /// Sets the bytes of shares of pixels that are kept from band to band.
    pub(super) fn set_cache_bytes(&mut self, bytes: usize) {
        self.cells.set_cache_bytes(bytes);
    }

    /// Bytes of shares that may still be kept.
    #[cfg(test)]
    pub(super) fn cache_bytes_left(&self) -> usize {
        self.cells.bytes_left()
    }

    /// Adds a shape on top.
    pub(super) fn add(&mut self, shape: Shape, ink: Ink) {
        let extent = match &shape {
            Shape::Boxes(boxes) => boxes.iter().copied().reduce(union),
            Shape::Polygons(parts, _) => parts.iter().map(extent).reduce(union),
            Shape::Ring([x, y], _, r)
            | Shape::SineStar(SineStar { disc: Disc { centre: [x, y], radius: r }, .. }) => {
                Some([x - r, y - r, x + r, y + r])
            }
            // Added by `gaussian`, with its bounds.
            Shape::Gaussian(..) => None,
        };
        if let Some([x0, y0, x1, y1]) = extent {
            self.push(pixels(x0, y0, x1, y1), shape, ink);
        }
    }

    /// Adds a Gaussian of peak 1 about (x, y), truncated at 6 σ, 1.5e-8 of the peak.
    pub(super) fn gaussian(&mut self, [x, y]: Point, sigma: f64, ink: Ink) {
        let reach = (6.0 * sigma).ceil();
        let bounds = pixels(x - reach, y - reach, x + reach, y + reach);
        let along = |first: i64, count: usize, centre: f64| {
            (0..count).map(|i| gaussian_mean((first + i as i64) as f64 - centre, sigma)).collect()
        };
        let (fx, fy) = (along(bounds.x, bounds.width, x), along(bounds.y, bounds.height, y));
        self.push(bounds, Shape::Gaussian(fx, fy), ink);
    }

    fn push(&mut self, bounds: Rect, shape: Shape, ink: Ink) {
        if !bounds.intersect(self.size.rect()).is_empty() {
            self.objects.push(Object { bounds, shape, ink });
        }
    }

    /// Fills `out` with the pixels of `rect`; `inks` are the values of one band.
    pub(super) fn paint(&self, inks: &[f32], rect: Rect, out: &mut [f32]) {
        out.fill(inks[self.paper]);
        self.cells.for_each(&self.objects, rect, |object, shares, area| match shares {
            Some(shares) => shares.paint(inks[object.ink], rect, area, out),
            None => object.paint(inks[object.ink], rect, area, out),
        });
    }
}

/// The part of a rectangle that an object may touch.
struct Canvas<'a> {
    out: &'a mut [f32],
    rect: Rect,
    area: Rect,
    ink: f32,
}

impl Canvas<'_> {
    fn paint(&mut self, object: &Object) {
        match &object.shape {
            Shape::Boxes(boxes) => boxes.iter().for_each(|b| self.rectangle(*b)),
            Shape::Polygons(parts, None) if parts.len() == 1 => self.polygon(&parts[0]),
            Shape::Polygons(parts, disc) => self.polygons(parts, disc.as_ref()),
            Shape::Ring(centre, inner, outer) => self.ring(*centre, *inner, *outer),
            Shape::SineStar(star) => self.sine_star(star),
            Shape::Gaussian(fx, fy) => self.gaussian(object.bounds, fx, fy),
        }
    }

    fn rectangle(&mut self, [x0, y0, x1, y1]: [f64; 4]) {
        let area = pixels(x0, y0, x1, y1).intersect(self.area);
        // Columns entirely inside, the same for all rows.
        let interior = ((x0 + 0.5).ceil() as i64, (x1 - 0.5).floor() as i64 + 1);
        for y in area.y..area.bottom() {
            let cy = overlap(y, y0, y1);
            let (from, to) = (interior.0.clamp(area.x, area.right()), interior.1.clamp(area.x, area.right()));
            if from < to {
                self.run(y, from, to, cy);
                (area.x..from)
                    .chain(to..area.right())
                    .for_each(|x| self.blend(y, x, cy * overlap(x, x0, x1)));
            } else {
                (area.x..area.right()).for_each(|x| self.blend(y, x, cy * overlap(x, x0, x1)));
            }
        }
    }

    fn polygon(&mut self, polygon: &Polygon) {
        for y in self.area.y..self.area.bottom() {
            let row = PolygonRow::new(polygon, y);
            let (first, end) = row.clipped(self.area);
            let (from, to) = row.inside(first, end);
            self.run(y, from, to, 1.0);
            (first..from).chain(to..end).for_each(|x| self.blend(y, x, row.pixel(x).area()));
        }
    }

    /// Parts may share a pixel, so the shares of a row are summed before painting.
    fn polygons(&mut self, parts: &[Polygon], disc: Option<&Disc>) {
        // A part is tested only on the rows that it covers within the area: a star has many parts and a tile few of them. The area is
        // one pixel wider, so that rounding at a touching border does not depend on it.
        let near = self.area.grown(1);
        let rows = |part: &Polygon| {
            part.between(1, near.y as f64 - 0.5, near.bottom() as f64 - 0.5)
                .between(0, near.x as f64 - 0.5, near.right() as f64 - 0.5)
                .extent(1)
        };
        let parts: Vec<_> =
            parts.iter().map(|p| (p, rows(p))).filter(|(_, (top, bottom))| top <= bottom).collect();
        let mut shares = vec![0.0; self.area.width];
        for y in self.area.y..self.area.bottom() {
            let (low, high) = (y as f64 - 0.5, y as f64 + 0.5);
            let mut area = Rect::new(y, self.area.x, 1, self.area.width);
            let half_widths = disc.map(|d| d.half_widths(y as f64));
            if let (Some(d), Some((_, outer))) = (disc, half_widths) {
                area = area.intersect(pixels(d.centre[0] - outer, low, d.centre[0] + outer, high));
            }
            if area.is_empty() {
                continue;
            }
            let shares = &mut shares[..area.width];
            shares.fill(0.0);
            for (part, _) in parts.iter().filter(|(_, (top, bottom))| *top <= high && *bottom >= low) {
                let row = PolygonRow::new(part, y);
                let (first, end) = row.clipped(area);
                // Columns entirely inside this part and the disc.
                let (mut from, mut to) = row.inside(first, end);
                if let (Some(d), Some((inner, _))) = (disc, half_widths) {
                    from = from.max((d.centre[0] - inner + 0.5).ceil() as i64).min(end);
                    to = to.min((d.centre[0] + inner - 0.5).floor() as i64 + 1).max(from);
                }
                shares[(from - area.x) as usize..(to - area.x) as usize].fill(1.0);
                for x in (first..from).chain(to..end) {
                    let common = row.pixel(x);
                    let on_rim = disc
                        .zip(half_widths)
                        .filter(|(d, (inner, _))| (x as f64 - d.centre[0]).abs() + 0.5 > *inner);
                    shares[(x - area.x) as usize] +=
                        on_rim.map_or_else(|| common.area(), |(d, _)| d.area_within(&common));
                }
            }
            let i = self.index(y, area.x);
            self.out[i..i + area.width].iter_mut().zip(shares.iter()).for_each(|(p, &c)| mix(p, self.ink, c));
        }
    }

    fn ring(&mut self, centre: Point, inner: f64, outer: f64) {
        let (hole, disc) = (Disc { centre, radius: inner }, Disc { centre, radius: outer });
        for y in self.area.y..self.area.bottom() {
            let (of_hole, of_disc) = (hole.half_widths(y as f64), disc.half_widths(y as f64));
            let low = y as f64;
            let area = pixels(centre[0] - of_disc.1, low, centre[0] + of_disc.1, low).intersect(Rect::new(
                y,
                self.area.x,
                1,
                self.area.width,
            ));
            // Columns entirely inside the hole are skipped.
            let (skip, resume) = if of_hole.0 > 0.5 {
                (
                    (centre[0] - of_hole.0 + 0.5).ceil() as i64,
                    (centre[0] + of_hole.0 - 0.5).floor() as i64 + 1,
                )
            } else {
                (area.right(), area.right())
            };
            let skip = skip.clamp(area.x, area.right());
            let resume = resume.clamp(skip, area.right());
            for x in (area.x..skip).chain(resume..area.right()) {
                let share = disc.share(low, x as f64, of_disc);
                if share > 0.0 {
                    self.blend(y, x, share - hole.share(low, x as f64, of_hole));
                }
            }
        }
    }

    fn sine_star(&mut self, star: &SineStar) {
        for y in self.area.y..self.area.bottom() {
            let half_widths = star.disc.half_widths(y as f64);
            for x in self.area.x..self.area.right() {
                let share = star.share(y as f64, x as f64, half_widths);
                if share > 0.0 {
                    self.blend(y, x, share);
                }
            }
        }
    }

    fn gaussian(&mut self, bounds: Rect, fx: &[f64], fy: &[f64]) {
        for y in self.area.y..self.area.bottom() {
            for x in self.area.x..self.area.right() {
                self.blend(y, x, fy[(y - bounds.y) as usize] * fx[(x - bounds.x) as usize]);
            }
        }
    }

    fn index(&self, y: i64, x: i64) -> usize {
        (y - self.rect.y) as usize * self.rect.width + (x - self.rect.x) as usize
    }

    fn blend(&mut self, y: i64, x: i64, share: f64) {
        let i = self.index(y, x);
        mix(&mut self.out[i], self.ink, share);
    }

    fn run(&mut self, y: i64, from: i64, to: i64, share: f64) {
        if from < to {
            let i = self.index(y, from);
            let pixels = &mut self.out[i..i + (to - from) as usize];
            if share >= 1.0 {
                pixels.fill(self.ink);
            } else {
                pixels.iter_mut().for_each(|p| mix(p, self.ink, share));
            }
        }
    }
}

/// The intersection of a polygon and a row of pixels.
struct PolygonRow {
    polygon: Polygon,
    outer: (f64, f64),
    inner: (f64, f64),
}

impl PolygonRow {
    fn new(polygon: &Polygon, y: i64) -> Self {
        let (low, high) = (y as f64 - 0.5, y as f64 + 0.5);
        let polygon = polygon.between(1, low, high);
        // Convex: columns inside on both border lines of the row are inside between them. If one line is missed, the run is empty.
        let (top, bottom) = (polygon.extent_at(low), polygon.extent_at(high));
        Self { polygon, outer: polygon.extent(0), inner: (top.0.max(bottom.0), top.1.min(bottom.1)) }
    }

    /// The columns that it may touch (first, end) within `area`.
    fn clipped(&self, area: Rect) -> (i64, i64) {
        if self.outer.0 > self.outer.1 {
            return (area.x, area.x);
        }
        let first = column(self.outer.0).clamp(area.x, area.right());
        (first, (column(self.outer.1) + 1).clamp(first, area.right()))
    }

    /// The columns (first, end) entirely inside, within first..end.
    fn inside(&self, first: i64, end: i64) -> (i64, i64) {
        if self.inner.0 >= self.inner.1 {
            return (end, end);
        }
        let from = ((self.inner.0 + 0.5).ceil() as i64).clamp(first, end);
        (from, ((self.inner.1 - 0.5).floor() as i64 + 1).clamp(from, end))
    }

    /// Its intersection with the pixel in column `x`.
    fn pixel(&self, x: i64) -> Polygon {
        self.polygon.between(0, x as f64 - 0.5, x as f64 + 0.5)
    }
}

fn mix(pixel: &mut f32, ink: f32, share: f64) {
    if share >= 1.0 {
        *pixel = ink;
    } else {
        *pixel += share as f32 * (ink - *pixel);
    }
}

/// Column or row of coordinate `v`.
fn column(v: f64) -> i64 {
    (v + 0.5).floor() as i64
}

/// The pixels that touch x0..x1, y0..y1, possibly including some that only share a border.
fn pixels(x0: f64, y0: f64, x1: f64, y1: f64) -> Rect {
    let (x, y) = (column(x0), column(y0));
    Rect::new(y, x, (column(y1) - y + 1).max(0) as usize, (column(x1) - x + 1).max(0) as usize)
}

/// Length of the intersection of pixel `i` and low..high.
fn overlap(i: i64, low: f64, high: f64) -> f64 {
    ((i as f64 + 0.5).min(high) - (i as f64 - 0.5).max(low)).max(0.0)
}

fn extent(polygon: &Polygon) -> [f64; 4] {
    let ((x0, x1), (y0, y1)) = (polygon.extent(0), polygon.extent(1));
    [x0, y0, x1, y1]
}

fn union(a: [f64; 4], b: [f64; 4]) -> [f64; 4] {
    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
}
