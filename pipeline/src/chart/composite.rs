//! The composite chart: targets for all effects of a lens in one picture, for visual inspection.
//!
//! Paper ruled in square cells, 30 along the film's shorter side: straight lines and circles (distortion, lateral colour), white paper
//! (relative illumination), a ColorChecker, a grey scale and a spectrum near the middle. Stations of 3 × 3 cells are placed in the
//! middle, half-way out and at the edges and corners; their details are sized in FILM pixels, down to lines of one pixel, for crops at
//! 100 %. The layout is in cells from the film's middle; lines run between cells.

use super::coverage::{Point, Polygon};
use super::drawing::{Drawing, snap};
use super::glyphs;
use super::picture::{Ink, Shape};
use super::targets::{INK, PAPER};
use crate::real;

/// Cells along the film's shorter side.
const CELLS: f64 = 30.0;

struct Composite<'a> {
    drawing: &'a mut Drawing,
    paper: Ink,
    ink: Ink,
    line: Ink,
    /// Side of a cell in pixels.
    cell: f64,
    /// Middle of film and chart.
    middle: Point,
    pitch_um: f64,
}

/// Draws the chart.
pub(super) fn draw(drawing: &mut Drawing, pitch_um: f64) {
    let paper = drawing.inks.grey(PAPER);
    let (ink, line) = (drawing.inks.grey(INK), drawing.inks.grey(0.16));
    let (short, long) =
        (drawing.film.height.min(drawing.film.width), drawing.film.height.max(drawing.film.width));
    // At least 8 px for legibility, and at most 400 cells along a very long film, for speed.
    let cell = (short as f64 / CELLS).max(long as f64 / 400.0).max(8.0);
    let middle = drawing.centre();
    let mut c = Composite { drawing, paper, ink, line, cell, middle, pitch_um };
    c.ruling();
    c.circles();
    c.colour_panel();
    c.tone_panel();
    c.stations();
    c.large_figures();
}

impl Composite<'_> {
    /// A position given in cells from the middle.
    fn at(&self, [x, y]: Point) -> Point {
        [self.middle[0] + x * self.cell, self.middle[1] + y * self.cell]
    }

    /// Half of the film in cells, (x, y).
    fn half(&self) -> Point {
        [self.drawing.film.width as f64 / self.cell / 2.0, self.drawing.film.height as f64 / self.cell / 2.0]
    }

    /// Line width in pixels, an integer: a share of a cell, so that it is visible in the complete picture.
    fn stroke(&self, of_cell: f64) -> f64 {
        (of_cell * self.cell).round().max(1.0)
    }

    fn block(&mut self, [x0, y0]: Point, [x1, y1]: Point, ink: Ink) {
        let (a, b) = (self.at([x0, y0]), self.at([x1, y1]));
        self.drawing.block([a[0], a[1], b[0], b[1]], ink);
    }

    /// Lines between all cells up to the chart's border, every fifth heavier.
    fn ruling(&mut self) {
        let chart = self.drawing.chart();
        let (w, h) = (chart.width as f64 - 0.5, chart.height as f64 - 0.5);
        let (fine, heavy) = (self.stroke(0.006), self.stroke(0.016));
        let mut boxes = Vec::new();
        for (axis, length) in [(0, w), (1, h)] {
            let lines = ((length / self.cell) / 2.0).ceil() as i64 + 1;
            for k in -lines..lines {
                let thick = if (k - 2).rem_euclid(5) == 0 { heavy } else { fine };
                let from = snap(self.middle[axis] + (k as f64 + 0.5) * self.cell - thick / 2.0);
                boxes.push(if axis == 0 {
                    [from, -0.5, from + thick, h]
                } else {
                    [-0.5, from, w, from + thick]
                });
            }
        }
        self.drawing.picture.add(Shape::Boxes(boxes), self.line);
    }

    /// Circles of equal field height at fifths of the half diagonal, and both diagonals.
    fn circles(&mut self) {
        let [hx, hy] = self.half();
        let (half_diagonal, thick) = (real::hypot(hx, hy) * self.cell, self.stroke(0.01));
        let blue = self.drawing.inks.checker(7);
        for fifth in 1..=4 {
            let radius = half_diagonal * f64::from(fifth) / 5.0;
            self.drawing
                .picture
                .add(Shape::Ring(self.middle, radius - thick / 2.0, radius + thick / 2.0), blue);
        }
        let chart = self.drawing.chart();
        let reach = real::hypot(chart.width as f64, chart.height as f64) / 2.0;
        for sign in [-1.0, 1.0] {
            let bar = Polygon::rotated(self.middle, [reach, thick / 2.0], sign * real::atan2(hy, hx));
            self.drawing.picture.add(Shape::Polygons(vec![bar], None), blue);
        }
    }

    /// ColorChecker below the middle, in a dark frame.
    fn colour_panel(&mut self) {
        self.block([-3.5, 2.5], [3.5, 7.5], self.ink);
        let (a, b) = (self.at([-3.36, 2.64]), self.at([3.36, 7.36]));
        self.drawing.checker_in([a[0], a[1], b[0], b[1]], 0.07);
    }

    /// Title, spectrum and grey scale above the middle.
    fn tone_panel(&mut self) {
        self.block([-3.5, -7.5], [3.5, -2.5], self.ink);
        let title = "LENSCUBE";
        let dot = (6.6 * self.cell / glyphs::width(title) as f64).floor();
        self.text(title, [0.0, -6.55], dot, self.paper);
        let stripes = 31;
        for i in 0..stripes {
            let nm = 400.0 + 10.0 * f64::from(i);
            let ink = self.drawing.inks.narrow(nm, 30.0);
            let x = |i: i32| -3.3 + 6.6 * f64::from(i) / f64::from(stripes);
            self.block([x(i), -5.55], [x(i + 1), -4.15], ink);
        }
        let steps = 12;
        for i in 0..steps {
            // Equal density steps from 0.9 to 0.02.
            let ink =
                self.drawing.inks.grey(0.9 * real::pow(0.02_f64 / 0.9, f64::from(i) / f64::from(steps - 1)));
            let x = |i: i32| -3.3 + 6.6 * f64::from(i) / f64::from(steps);
            self.block([x(i), -3.95], [x(i + 1), -2.75], ink);
        }
    }

    /// Positions of the outermost stations and those half-way, in cells (x, y).
    fn ranks(&self) -> (Point, Point) {
        let far = self.half().map(|h| (h - 2.0).floor().max(0.0));
        (far, far.map(|f| (f / 2.0).round()))
    }

    /// Stations in the middle, half-way and outermost, along both axes and the diagonals.
    fn stations(&mut self) {
        let (far, half) = self.ranks();
        let mut places = vec![[0.0, 0.0]];
        for (sx, sy) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
            places.push([sx * half[0], sy * half[1]]);
            places.push([sx * far[0], sy * far[1]]);
        }
        for sign in [-1.0, 1.0] {
            places.extend([[sign * half[0], 0.0], [sign * far[0], 0.0], [0.0, sign * far[1]]]);
        }
        let mut taken: Vec<Point> = Vec::new();
        for place in places {
            // On a very long film stations can overlap each other, or the panels beside the middle.
            let clear =
                |other: &Point| (place[0] - other[0]).abs() >= 3.0 || (place[1] - other[1]).abs() >= 3.0;
            let on_panels = place[0].abs() < 5.0 && (1.0..9.0).contains(&place[1].abs());
            if taken.iter().all(clear) && !on_panels {
                self.station(place);
                taken.push(place);
            }
        }
    }

    /// Stars and zone plates of the size of a station between the outer ones, visible in the complete picture.
    fn large_figures(&mut self) {
        let (far, half) = self.ranks();
        // Only where a row of three fits between the middle and the corner.
        for (sx, sy) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
            if half[0] >= 3.0 && far[0] - half[0] >= 3.0 && far[1] >= 11.0 {
                let centre = self.at([sx * half[0], sy * far[1]]);
                self.backed_disc(centre);
                self.drawing.star(centre, 1.38 * self.cell, 36, self.ink);
            }
            if half[1] >= 3.0 && far[1] - half[1] >= 3.0 && far[0] >= 11.0 {
                let centre = self.at([sx * far[0], sy * half[1]]);
                self.backed_disc(centre);
                self.zones(centre, 1.38 * self.cell, (0.02 * self.cell).max(3.0));
            }
        }
    }

    /// White paper under a large figure, which hides the ruling.
    fn backed_disc(&mut self, centre: Point) {
        self.drawing.disc(centre, 1.45 * self.cell, self.paper);
    }

    /// 3 × 3 cells of detail, framed.
    fn station(&mut self, [x, y]: Point) {
        let frame = 1.5 + self.stroke(0.012) / self.cell;
        self.block([x - frame, y - frame], [x + frame, y + frame], self.ink);
        self.block([x - 1.5, y - 1.5], [x + 1.5, y + 1.5], self.paper);
        let toward = real::atan2(y, x);
        self.tilted_square([x - 1.0, y - 1.0], self.ink);
        self.oriented_lines([x, y - 1.0], toward);
        self.dots([x + 1.0, y - 1.0]);
        self.bars([x - 1.0, y]);
        let centre = self.at([x, y]);
        self.drawing.star(centre, 0.46 * self.cell, 60, self.ink);
        let plate = self.at([x + 1.0, y]);
        self.zones(plate, 0.46 * self.cell, 3.0);
        self.colours([x - 1.0, y + 1.0]);
        self.legend([x, y + 1.0], [x, y]);
        let grey = self.drawing.inks.grey(0.45);
        self.tilted_square([x + 1.0, y + 1.0], grey);
    }

    /// A square rotated by 5°: near-vertical and near-horizontal slanted edges.
    fn tilted_square(&mut self, cell: Point, ink: Ink) {
        let half = 0.34 * self.cell;
        let square = Polygon::rotated(self.at(cell), [half, half], 5_f64.to_radians());
        self.drawing.picture.add(Shape::Polygons(vec![square], None), ink);
    }

    /// Groups of lines along the radius and across it, periods of 12, 8, 6 and 4 px.
    fn oriented_lines(&mut self, cell: Point, toward: f64) {
        let centre = self.at(cell);
        let side = 0.2 * self.cell;
        let (sin, cos) = real::sin_cos(toward);
        let mut lines = Vec::new();
        for (row, period) in [12.0, 8.0, 6.0, 4.0].into_iter().enumerate() {
            let v = (row as f64 - 1.5) * 0.165 * self.cell;
            let count = ((0.15 * self.cell / period).floor() as i64).max(1);
            for (u, across) in [(-0.16 * self.cell, true), (0.16 * self.cell, false)] {
                // Lines across the radius are stacked along u, lines along it along v.
                let (count, half) = if across {
                    ((side * 1.3 / period).floor() as i64, [period / 4.0, 0.065 * self.cell])
                } else {
                    (count, [side * 0.65, period / 4.0])
                };
                for i in 0..count {
                    let shift = (i as f64 - (count - 1) as f64 / 2.0) * period;
                    let (lu, lv) = if across { (u + shift, v) } else { (u, v + shift) };
                    let place = [centre[0] + lu * cos - lv * sin, centre[1] + lu * sin + lv * cos];
                    lines.push(Polygon::rotated(place, half, toward));
                }
            }
        }
        self.drawing.picture.add(Shape::Polygons(lines, None), self.ink);
    }

    /// White dots of 2 to 8 px on black: images of the PSF.
    fn dots(&mut self, cell: Point) {
        let [x, y] = self.at(cell);
        let half = 0.44 * self.cell;
        self.drawing.block_at([x, y], half, half, self.ink);
        let gap = 0.17 * self.cell;
        for (row, diameter) in [2.0, 3.0, 4.0, 6.0, 8.0].into_iter().enumerate() {
            if gap < 2.0 * diameter {
                continue;
            }
            for column in 0..5 {
                let place =
                    [x + (f64::from(column) - 2.0) * gap, y + (row as f64 - 2.0) * gap].map(f64::round);
                self.drawing.disc(place, diameter / 2.0, self.paper);
                self.drawing.note_point(place);
            }
        }
    }

    /// Vertical and horizontal lines of 4, 3, 2 and 1 px, aligned to pixels: up to the film's resolution limit.
    fn bars(&mut self, cell: Point) {
        // In smaller cells the groups do not fit.
        if self.cell < 32.0 {
            return;
        }
        let [x, y] = self.at(cell).map(snap);
        let gap = (0.015 * self.cell).floor().max(1.0);
        let (group, length) = ((0.2 * self.cell).floor(), (0.36 * self.cell).floor());
        let mut boxes = Vec::new();
        for (row, width) in [4.0, 3.0, 2.0, 1.0].into_iter().enumerate() {
            let top = y + (row as f64 - 2.0) * (group + gap);
            let mut across = 0.0;
            while across + width <= length {
                boxes.push([x - length - 4.0 + across, top, x - length - 4.0 + across + width, top + group]);
                if across + width <= group {
                    boxes.push([x + 4.0, top + across, x + 4.0 + length, top + across + width]);
                }
                across += 2.0 * width;
            }
        }
        self.drawing.picture.add(Shape::Boxes(boxes), self.ink);
    }

    /// A zone plate: rings at radii ∝ √k, all frequencies in all directions up to lines of width `finest`.
    fn zones(&mut self, centre: Point, reach: f64, finest: f64) {
        // r_k² = k·a, so a ring is a/2r wide: `finest` at the rim.
        let a = 2.0 * finest * reach;
        let count = (reach * reach / a) as i64;
        self.drawing.disc(centre, a.sqrt().min(reach), self.ink);
        for k in (2..count).step_by(2) {
            let radius = |k: i64| (k as f64 * a).sqrt();
            self.drawing.picture.add(Shape::Ring(centre, radius(k), radius(k + 1)), self.ink);
        }
    }

    /// Four adjoining colours, to show lateral colour at their borders.
    fn colours(&mut self, [x, y]: Point) {
        for (patch, dx, dy) in [(14, -1.0, -1.0), (13, 0.0, -1.0), (12, -1.0, 0.0), (15, 0.0, 0.0)] {
            let ink = self.drawing.inks.checker(patch);
            let (x0, y0) = (x + 0.4 * dx, y + 0.4 * dy);
            self.block([x0, y0], [x0 + 0.4, y0 + 0.4], ink);
        }
    }

    /// Position on the film in mm from its middle, then the alphabet in decreasing sizes.
    fn legend(&mut self, cell: Point, station: Point) {
        let mm = |cells: f64| cells * self.cell * self.pitch_um * 1e-3;
        let height = format!("{:.2} mm", mm(real::hypot(station[0], station[1])));
        let size = |share: f64| (share * self.cell).floor();
        let lines = [
            (height, -0.32, (0.9 * self.cell / 60.0).floor()),
            (format!("x {:+.1}", mm(station[0])), -0.12, size(0.011)),
            (format!("y {:+.1}", mm(station[1])), 0.04, size(0.011)),
            ("ABCDEFGHIJKLM".into(), 0.18, 4.0),
            ("NOPQRSTUVWXYZ".into(), 0.27, 3.0),
            ("THE LIGHT ON THE FILM".into(), 0.345, 2.0),
            ("0123456789 - THE LIGHT ON THE FILM".into(), 0.41, 1.0),
        ];
        for (text, y, dot) in lines {
            if dot * glyphs::width(&text) as f64 <= 0.98 * self.cell {
                self.text(&text, [cell[0], cell[1] + y], dot, self.ink);
            }
        }
    }

    /// A line of text centred on a position in cells, `dot` pixels per dot; nothing below one.
    fn text(&mut self, text: &str, cell: Point, dot: f64, ink: Ink) {
        if dot < 1.0 {
            return;
        }
        let [x, y] = self.at(cell);
        let left = snap(x - dot * glyphs::width(text) as f64 / 2.0);
        let top = snap(y - dot * glyphs::HEIGHT as f64 / 2.0);
        let run = |(row, first, end): (usize, usize, usize)| {
            let (row, first, end) = (row as f64, first as f64, end as f64);
            [left + first * dot, top + row * dot, left + end * dot, top + (row + 1.0) * dot]
        };
        let boxes = glyphs::runs(text).into_iter().map(run).collect();
        self.drawing.picture.add(Shape::Boxes(boxes), ink);
    }
}
