//! Depth scene: surfaces at several distances, each pixel with its distance, as a renderer would write them.
//!
//! In the picture of a pinhole at the centre of the entrance pupil a plane n·X = d has at (x, y), for any focal length f,
//! ```text
//! 1/z = n·(x/f, y/f, 1)/d,
//! ```
//! so that its vergence V = 1/z is linear in x and y. The scene is therefore drawn in the picture:
//!
//! | surface | texture | vergence, 1/m |
//! |---|---|---|
//! | wall, above the horizon row | checker | 1/far |
//! | floor, below it | checks in perspective | linear in the row, from 1/far to 1/near in the chart's last row |
//! | disc | star | 1/near |
//! | ball | black | z = z_b·(1 − β·√(1 − ρ²)), 1/z_b half-way from far to near, ρ = distance from its centre/its radius, β = 0.03 = radius/distance |
//!
//! Its arrays are charts of their own ([`ScenePart`]): the pinhole's picture with its distances, and the surfaces hidden behind disc and ball, which are
//! complete. A pixel on the rim of disc or ball has the colour and the distance of that object, and the object's share as coverage. Infinity is 10¹⁰ m.

use super::coverage::{Disc, Polygon};
use super::drawing::{Drawing, snap};
use super::picture::{Picture, Shape};
use super::targets::PAPER;
use crate::geometry::Rect;
use crate::real;

/// Radius of the ball over its distance.
const BALL: f64 = 0.03;
/// Row of the horizon, share of the film's height.
const HORIZON: f64 = 0.45;
/// Distance written for infinity, m.
const INFINITE_M: f64 = 1e10;
/// Largest number of rows of checks on the floor, and of columns on either side of the middle.
const ROWS: usize = 100;
const COLUMNS: i32 = 100;

/// An array of a depth scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ScenePart {
    /// What the pinhole sees, spectral radiance.
    Chart,
    /// Its distances along the axis, m.
    Depth,
    /// Share of each pixel that its surface covers.
    Coverage,
    /// Wall and floor without disc and ball, spectral radiance.
    Hidden,
    /// Their distances, m.
    HiddenDepth,
}

impl ScenePart {
    /// All parts and their names.
    pub const ALL: [(&'static str, Self); 5] = [
        ("chart", Self::Chart),
        ("depth", Self::Depth),
        ("coverage", Self::Coverage),
        ("hidden", Self::Hidden),
        ("hidden-depth", Self::HiddenDepth),
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(_, part)| *part == self).map_or("", |(name, _)| name)
    }

    /// Whether its values are spectral radiances, of all bands.
    pub const fn is_radiance(self) -> bool {
        matches!(self, Self::Chart | Self::Hidden)
    }

    /// Unit of its values.
    pub const fn units(self) -> &'static str {
        match self {
            Self::Chart | Self::Hidden => super::inks::UNITS,
            Self::Depth | Self::HiddenDepth => "m",
            Self::Coverage => "1",
        }
    }
}

/// Geometry and near objects of a scene; wall and floor are the picture of its [`Drawing`]. Lengths are chart pixels.
pub(super) struct DepthScene {
    part: ScenePart,
    /// Vergences of wall and disc, 1/m.
    far: f64,
    near: f64,
    /// First row of the floor, and rows to the chart's last.
    horizon: f64,
    span: f64,
    disc: Disc,
    ball: Disc,
    /// Textures of the objects, beyond their rims.
    front: Picture,
    /// Ink 1 where the objects are, else ink 0.
    mask: Picture,
}

impl DepthScene {
    /// Draws wall and floor on `drawing`, and the objects.
    pub(super) fn draw(drawing: &mut Drawing, near_m: f64, far_m: f64, part: ScenePart) -> Self {
        let chart = drawing.chart();
        let (height, width) = (drawing.film.height as f64, drawing.film.width as f64);
        let horizon = snap(drawing.at(HORIZON * height, 0.0)[1]);
        let span = (chart.height as f64 - 1.0 - horizon).max(1.0);
        let short = height.min(width);
        let circle = |row: f64, column: f64, radius: f64| Disc {
            centre: drawing.at(row * height, column * width),
            radius: radius * short,
        };
        let (disc, ball) = (circle(0.46, 0.29, 0.19), circle(0.42, 0.73, 0.13));
        let mut mask = Picture::new(chart, 0);
        for object in [disc, ball] {
            let ([x, y], r) = (object.centre, object.radius);
            let around = Polygon::rectangle(x - r, y - r, x + r, y + r);
            mask.add(Shape::Polygons(vec![around], Some(object)), 1);
        }
        let front = Picture::new(chart, 0);
        let mut scene =
            Self { part, far: 1.0 / far_m, near: 1.0 / near_m, horizon, span, disc, ball, front, mask };
        scene.wall(drawing);
        scene.floor(drawing);
        let black = drawing.inks.grey(0.0);
        let (white, red) = (drawing.inks.grey(PAPER), drawing.inks.checker(14));
        let behind = std::mem::replace(&mut drawing.picture, Picture::new(chart, black));
        // Wider than the disc, so that pixels on its rim have its colours.
        let r = disc.radius + 2.0;
        drawing.block_at(disc.centre, r, r, white);
        drawing.star(disc.centre, r, 18, red);
        scene.front = std::mem::replace(&mut drawing.picture, behind);
        scene
    }

    fn wall(&self, drawing: &mut Drawing) {
        drawing.inks.grey(0.7);
        let dark = drawing.inks.grey(0.08);
        let (height, width) = (drawing.film.height as f64, drawing.film.width as f64);
        let side = (height.min(width) / 10.0).max(height.max(width) / 400.0).max(1.0);
        let chart = drawing.chart();
        let count = |length: f64| (length / side).ceil() as usize;
        let rows = count(self.horizon + 0.5);
        let squares = (0..rows).flat_map(|i| (0..count(chart.width as f64)).map(move |j| (i, j)));
        let squares = squares.filter(|(i, j)| (i + j) % 2 == 0).map(|(i, j)| {
            // Upwards from the horizon.
            let (x, y) = (side * j as f64 - 0.5, self.horizon - side * i as f64);
            [x, y - side, x + side, y]
        });
        drawing.picture.add(Shape::Boxes(squares.collect()), dark);
    }

    fn floor(&self, drawing: &mut Drawing) {
        let (light, dark) = (drawing.inks.checker(1), drawing.inks.checker(0));
        let chart = drawing.chart();
        let (right, bottom) = (chart.width as f64 - 0.5, chart.height as f64 - 0.5);
        drawing.picture.add(Shape::Boxes(vec![[-0.5, self.horizon, right, bottom]]), light);
        let range = self.near - self.far;
        // Width of a check in the last row; its length makes it half as high there.
        let side = (chart.width as f64 / 12.0).max(2.0);
        let length_m = 0.5 * side * range / (self.span * self.near * self.near);
        // Lines along z meet where V = 0, those across lie where V = 1/z.
        let middle = drawing.centre()[0];
        let point = |line: i32, v: f64| {
            let y = self.horizon + (v - self.far) / range * self.span;
            [middle + f64::from(line) * side * v / self.near, y]
        };
        let mut checks = Vec::new();
        for k in 0..ROWS {
            let v = |k: usize| (1.0 / (1.0 / self.near + length_m * k as f64)).max(self.far);
            let (low, high) = (v(k + 1), v(k));
            if low >= high {
                break;
            }
            for j in (-COLUMNS..COLUMNS).filter(|j| (j + k as i32).rem_euclid(2) == 0) {
                let corners = [point(j, low), point(j + 1, low), point(j + 1, high), point(j, high)];
                if corners.iter().any(|[x, _]| (-1.0..=right + 1.0).contains(x)) {
                    checks.push(Polygon::new(&corners));
                }
            }
        }
        drawing.picture.add(Shape::Polygons(checks, None), dark);
    }

    /// Distance of wall or floor in row `y`, m.
    fn behind_m(&self, y: f64) -> f64 {
        let share = ((y - self.horizon) / self.span).clamp(0.0, 1.0);
        (1.0 / (self.far + share * (self.near - self.far))).min(INFINITE_M)
    }

    /// Distance of the disc or ball at (x, y), m.
    fn object_m(&self, x: f64, y: f64) -> f64 {
        let from = |disc: &Disc| real::hypot(x - disc.centre[0], y - disc.centre[1]) / disc.radius;
        let (disc, ball) = (from(&self.disc), from(&self.ball));
        if disc < ball {
            return 1.0 / self.near;
        }
        let centre_m = 2.0 / (self.far + self.near);
        centre_m * (1.0 - BALL * (1.0 - ball * ball).max(0.0).sqrt())
    }

    /// Fills `out` with the pixels of `rect` in the band with `inks`; `behind` is the picture of wall and floor.
    pub(super) fn paint(&self, behind: &Picture, inks: &[f32], rect: Rect, out: &mut [f32]) {
        match self.part {
            ScenePart::Chart | ScenePart::Hidden => behind.paint(inks, rect, out),
            ScenePart::Coverage => out.fill(1.0),
            ScenePart::Depth | ScenePart::HiddenDepth => {
                for (y, line) in (rect.y..).zip(out.chunks_exact_mut(rect.width)) {
                    line.fill(self.behind_m(y as f64) as f32);
                }
            }
        }
        if matches!(self.part, ScenePart::Hidden | ScenePart::HiddenDepth) {
            return;
        }
        for object in [self.disc, self.ball] {
            let ([x, y], r) = (object.centre, object.radius + 1.0);
            let side = (2.0 * r).ceil() as usize + 2;
            let bounds = Rect::new((y - r).floor() as i64, (x - r).floor() as i64, side, side);
            let part = bounds.intersect(rect);
            if !part.is_empty() {
                self.object(inks, rect, part, out);
            }
        }
    }

    /// Replaces the pixels of disc and ball in `area`, a part of `rect`.
    fn object(&self, inks: &[f32], rect: Rect, area: Rect, out: &mut [f32]) {
        let mut share = vec![0.0; area.size().pixels()];
        self.mask.paint(&[0.0, 1.0], area, &mut share);
        let mut colour = Vec::new();
        if self.part == ScenePart::Chart {
            colour.resize(share.len(), 0.0);
            self.front.paint(inks, area, &mut colour);
        }
        for (i, share) in share.iter().enumerate().filter(|(_, share)| **share > 0.0) {
            let (y, x) = (area.y + (i / area.width) as i64, area.x + (i % area.width) as i64);
            out[(y - rect.y) as usize * rect.width + (x - rect.x) as usize] = match self.part {
                ScenePart::Chart => colour[i],
                ScenePart::Coverage => *share,
                _ => self.object_m(x as f64, y as f64) as f32,
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::Generator;
    use crate::flow::ChartSource;
    use crate::geometry::Size;

    fn part(settings: &str, part: ScenePart) -> (Size, Vec<f32>) {
        let spec = format!("depth-scene?size=330x240&wavelengths=550&{settings}&part={}", part.name());
        let chart: Generator = spec.parse().unwrap();
        let mut pixels = vec![0.0; chart.size().pixels()];
        chart.read(0, chart.size().rect(), &mut pixels).unwrap();
        (chart.size(), pixels)
    }

    #[test]
    fn floor_is_a_plane_that_ends_at_wall_and_near_distance() {
        let (size, depth) = part("near_m=0.5&far_m=4", ScenePart::HiddenDepth);
        let row = |y: usize| f64::from(depth[y * size.width]);
        assert_eq!((row(0), row(size.height - 1)), (4.0, 0.5));
        // 1/z has no second difference within the floor.
        let first = (0..size.height).find(|y| row(*y) < 4.0).unwrap();
        for y in first + 1..size.height - 1 {
            let second = 1.0 / row(y - 1) - 2.0 / row(y) + 1.0 / row(y + 1);
            assert!(second.abs() < 1e-6, "row {y}: {second}");
        }
    }

    #[test]
    fn objects_are_in_front_of_what_they_hide() {
        let with = "near_m=0.5&far_m=inf";
        let (size, depth) = part(with, ScenePart::Depth);
        let (_, behind) = part(with, ScenePart::HiddenDepth);
        let (_, coverage) = part(with, ScenePart::Coverage);
        let (_, chart) = part(with, ScenePart::Chart);
        let (_, hidden) = part(with, ScenePart::Hidden);
        assert_eq!(behind[0], 1e10);
        let mut areas = [0.0; 2];
        for i in 0..size.pixels() {
            match depth[i] == behind[i] {
                true => assert_eq!((coverage[i], chart[i]), (1.0, hidden[i]), "pixel {i}"),
                false => {
                    assert!(depth[i] < behind[i] && coverage[i] > 0.0, "pixel {i}");
                    areas[usize::from(depth[i] > 0.5)] += f64::from(coverage[i]);
                    // The ball at 1 m is nearer by up to 3 % of that, and black.
                    if depth[i] > 0.5 {
                        assert!((0.97..=1.0).contains(&depth[i]) && chart[i] == 0.0, "pixel {i}");
                    }
                }
            }
        }
        for (found, radius) in std::iter::zip(areas, [0.19, 0.13]) {
            let expected = std::f64::consts::PI * (radius * 240.0f64).powi(2);
            assert!((found / expected - 1.0).abs() < 1e-6, "{found} {expected}");
        }
    }
}
