//! The sheet a chart is drawn on: film in the middle, overscan around it, and what a drawing says about itself.

use super::coverage::{Disc, Point, Polygon};
use super::inks::Inks;
use super::picture::{Ink, Picture, Shape};
use crate::geometry::{Rect, Size};
use crate::real;

/// A straight edge: dark where (x − x₀)·cos α + (y − y₀)·sin α ≤ 0, α its angle from the vertical.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeSite {
    /// A point (row, column) on the edge, the middle of its patch, film pixels.
    pub centre_px: (f64, f64),
    /// α in degrees: 0 is an upright edge with its dark side on the left; the edge's normal turns from +x towards +y.
    pub angle_deg: f64,
    /// The part of the film, in film pixels, in which nothing else is drawn.
    pub patch: Rect,
}

/// A picture being drawn. All lengths are chart pixels; (x, y) order throughout.
pub(super) struct Sheet {
    pub(super) film: Size,
    pub(super) margin: usize,
    pub(super) inks: Inks,
    pub(super) picture: Picture,
    pub(super) points: Vec<(f64, f64)>,
    pub(super) edges: Vec<EdgeSite>,
    pub(super) patches: Vec<Rect>,
}

impl Sheet {
    pub(super) fn new(film: Size, margin: usize, inks: Inks) -> Self {
        let chart = Size::new(film.height + 2 * margin, film.width + 2 * margin);
        // Ink 0 is the paper, and the drawing's first choice of ink.
        let picture = Picture::new(chart, 0);
        Self { film, margin, inks, picture, points: Vec::new(), edges: Vec::new(), patches: Vec::new() }
    }

    /// Size with overscan.
    pub(super) const fn chart(&self) -> Size {
        Size::new(self.film.height + 2 * self.margin, self.film.width + 2 * self.margin)
    }

    /// Chart place (x, y) of film place (row, column).
    pub(super) fn at(&self, row: f64, column: f64) -> Point {
        [column + self.margin as f64, row + self.margin as f64]
    }

    /// Middle of film and chart.
    pub(super) fn centre(&self) -> Point {
        self.at((self.film.height as f64 - 1.0) / 2.0, (self.film.width as f64 - 1.0) / 2.0)
    }

    /// A rectangle of whole pixels nearest to x0..x1, y0..y1.
    pub(super) fn block(&mut self, [x0, y0, x1, y1]: [f64; 4], ink: Ink) {
        let whole = [snap(x0), snap(y0), snap(x1), snap(y1)];
        if whole[0] < whole[2] && whole[1] < whole[3] {
            self.picture.add(Shape::Boxes(vec![whole]), ink);
        }
    }

    /// A rectangle of whole pixels, by its middle and half sizes.
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
        // Far enough for the triangle's outer side to clear the rim.
        let far = radius / real::cos(half) * 1.01;
        let sector = |k: usize| {
            let middle = 4.0 * half * k as f64;
            let point = |angle: f64| [centre[0] + far * real::cos(angle), centre[1] + far * real::sin(angle)];
            Polygon::new(&[centre, point(middle - half), point(middle + half)])
        };
        let sectors = (0..spokes).map(sector).collect();
        self.picture.add(Shape::Polygons(sectors, Some(Disc { centre, radius })), ink);
    }

    /// Marks a place as the centre of an isolated blob.
    pub(super) fn note_point(&mut self, [x, y]: Point) {
        self.points.push((y - self.margin as f64, x - self.margin as f64));
    }

    /// Film pixels of the whole-pixel rectangle nearest to x0..x1, y0..y1.
    pub(super) fn film_rect(&self, [x0, y0, x1, y1]: [f64; 4]) -> Rect {
        let first = |v: f64| (snap(v) + 0.5) as i64;
        let m = self.margin as i64;
        let count = |a: f64, b: f64| (first(b) - first(a)).max(0) as usize;
        Rect::new(first(y0) - m, first(x0) - m, count(y0, y1), count(x0, x1))
    }
}

/// The border between pixels that is nearest to `v`.
pub(super) fn snap(v: f64) -> f64 {
    (v + 0.5).round() - 0.5
}
