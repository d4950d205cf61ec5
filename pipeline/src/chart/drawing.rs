//! Drawing surface of a chart: the film with overscan around it, and the positions of targets for measurements.

use super::coverage::{Disc, Point, Polygon};
use super::inks::Inks;
use super::picture::{Ink, Picture, Shape};
use super::sine_star::StarSite;
use crate::geometry::{Rect, Size};
use crate::real;

/// A straight edge: dark where (x − x₀)·cos α + (y − y₀)·sin α ≤ 0, α its angle from the vertical.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeSite {
    /// Middle of the patch (row, column), a point of the edge, film pixels.
    pub centre_px: (f64, f64),
    /// α in degrees: 0 is a vertical edge, dark on the left; the normal rotates from +x towards +y.
    pub angle_deg: f64,
    /// The part of the film that contains this edge only, film pixels.
    pub patch: Rect,
}

/// A chart being drawn. All lengths are chart pixels, all points (x, y).
pub(super) struct Drawing {
    pub(super) film: Size,
    pub(super) margin: usize,
    pub(super) inks: Inks,
    pub(super) picture: Picture,
    pub(super) points: Vec<(f64, f64)>,
    pub(super) edges: Vec<EdgeSite>,
    pub(super) patches: Vec<Rect>,
    pub(super) stars: Vec<StarSite>,
    /// Colours of the patches.
    pub(super) colours: Vec<PatchColour>,
    /// Columns and rows of the film's corners that marks cover, px; 0 without.
    pub(super) corner_px: [f64; 2],
    /// What the marks cover, film pixels.
    pub(super) marks: Vec<Rect>,
}

/// Known reflectance of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum PatchColour {
    /// The same at all wavelengths.
    Grey(f64),
    /// A patch of the ColorChecker.
    Checker(usize),
}

impl Drawing {
    pub(super) fn new(film: Size, margin: usize, inks: Inks) -> Self {
        let chart = Size::new(film.height + 2 * margin, film.width + 2 * margin);
        // Ink 0, the first that a drawing allocates, is the paper.
        let picture = Picture::new(chart, 0);
        Self {
            film,
            margin,
            inks,
            picture,
            points: Vec::new(),
            edges: Vec::new(),
            patches: Vec::new(),
            stars: Vec::new(),
            colours: Vec::new(),
            corner_px: [0.0; 2],
            marks: Vec::new(),
        }
    }

    /// Size with overscan.
    pub(super) const fn chart(&self) -> Size {
        Size::new(self.film.height + 2 * self.margin, self.film.width + 2 * self.margin)
    }

    /// Chart position (x, y) of a film position (row, column).
    pub(super) fn at(&self, row: f64, column: f64) -> Point {
        [column + self.margin as f64, row + self.margin as f64]
    }

    /// Middle of film and chart.
    pub(super) fn centre(&self) -> Point {
        self.at((self.film.height as f64 - 1.0) / 2.0, (self.film.width as f64 - 1.0) / 2.0)
    }

    /// A rectangle snapped to pixel borders.
    pub(super) fn block(&mut self, [x0, y0, x1, y1]: [f64; 4], ink: Ink) {
        let snapped = [snap(x0), snap(y0), snap(x1), snap(y1)];
        if snapped[0] < snapped[2] && snapped[1] < snapped[3] {
            self.picture.add(Shape::Boxes(vec![snapped]), ink);
        }
    }

    /// A rectangle at sub-pixel positions.
    pub(super) fn boxed(&mut self, place: [f64; 4], ink: Ink) {
        self.picture.add(Shape::Boxes(vec![place]), ink);
    }

    /// A rectangle of known reflectance, snapped to pixel borders.
    pub(super) fn patch(&mut self, place: [f64; 4], colour: PatchColour) {
        let ink = match colour {
            PatchColour::Grey(reflectance) => self.inks.grey(reflectance),
            PatchColour::Checker(patch) => self.inks.checker(patch),
        };
        self.block(place, ink);
        self.patches.push(self.film_rect(place));
        self.colours.push(colour);
    }

    /// A rectangle snapped to pixel borders, by its middle and half sizes.
    pub(super) fn block_at(&mut self, [x, y]: Point, half_x: f64, half_y: f64, ink: Ink) {
        self.block([x - half_x, y - half_y, x + half_x, y + half_y], ink);
    }

    /// A filled circle.
    pub(super) fn disc(&mut self, centre: Point, radius: f64, ink: Ink) {
        let ([x, y], r) = (centre, radius);
        let around = Polygon::rectangle(x - r, y - r, x + r, y + r);
        self.picture.add(Shape::Polygons(vec![around], Some(Disc { centre, radius })), ink);
    }

    /// A Siemens star: `spokes` dark sectors and as many gaps of the same angle.
    pub(super) fn star(&mut self, centre: Point, radius: f64, spokes: usize, ink: Ink) {
        let half = std::f64::consts::PI / (2 * spokes) as f64;
        // The triangle's outer side lies beyond the rim.
        let far = radius / real::cos(half) * 1.01;
        let sector = |k: usize| {
            let middle = 4.0 * half * k as f64;
            let point = |angle: f64| [centre[0] + far * real::cos(angle), centre[1] + far * real::sin(angle)];
            Polygon::new(&[centre, point(middle - half), point(middle + half)])
        };
        let sectors = (0..spokes).map(sector).collect();
        self.picture.add(Shape::Polygons(sectors, Some(Disc { centre, radius })), ink);
    }

    /// Records the centre of an isolated point.
    pub(super) fn note_point(&mut self, [x, y]: Point) {
        self.points.push((y - self.margin as f64, x - self.margin as f64));
    }

    /// Film pixels of a rectangle snapped to pixel borders.
    pub(super) fn film_rect(&self, [x0, y0, x1, y1]: [f64; 4]) -> Rect {
        let first = |v: f64| (snap(v) + 0.5) as i64;
        let m = self.margin as i64;
        let count = |a: f64, b: f64| (first(b) - first(a)).max(0) as usize;
        Rect::new(first(y0) - m, first(x0) - m, count(y0, y1), count(x0, x1))
    }
}

/// The nearest border between pixels.
pub(super) fn snap(v: f64) -> f64 {
    (v + 0.5).round() - 0.5
}
