//! Drawings to scale: shapes in mm on axes of one scale, as a lens's cross-section or the nodes on the film.

use super::axes::{Panel, text};
use super::figure::{Anchor, Figure, Mark};
use super::image::Rgb;
use pipeline::geometry::Size;

/// Pixels left of, right of, above and below the axes.
const MARGIN: (f64, f64, f64, f64) = (136.0, 190.0, 64.0, 76.0);
const WIDTH: usize = 1000;

/// A thing drawn, in the drawing's units.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A line; its width in pixels.
    Line(Vec<(f64, f64)>, f64, Rgb),
    /// A filled shape.
    Area(Vec<(f64, f64)>, Rgb),
    /// Dots; their radius in pixels.
    Dots(Vec<(f64, f64)>, f64, Rgb),
}

/// Shapes on axes of one scale, y up.
#[derive(Clone, Debug, PartialEq)]
pub struct Drawing {
    /// What is shown.
    pub title: String,
    /// What goes right, with its unit.
    pub x_label: String,
    /// What goes up, with its unit.
    pub y_label: String,
    /// First and last x.
    pub x: (f64, f64),
    /// First and last y.
    pub y: (f64, f64),
    /// The shapes, the first lowest.
    pub shapes: Vec<Shape>,
    /// Names of colours.
    pub legend: Vec<(String, Rgb)>,
}

impl Drawing {
    /// Draws it, 1000 wide, as high as its scale asks.
    pub fn figure(&self) -> Figure {
        let (left, right, top, bottom) = MARGIN;
        let across = WIDTH as f64 - left - right;
        let up = across * (self.y.1 - self.y.0) / (self.x.1 - self.x.0);
        let size = Size::new((top + up + bottom).ceil() as usize, WIDTH);
        let panel = Panel { left, right: left + across, top, bottom: top + up, x: self.x, y: self.y };
        let mut marks = vec![text((left, top / 2.0), self.title.clone(), 2, Anchor::Start, false)];
        panel.draw(&mut marks, &self.y_label, Some(&self.x_label));
        let places = |points: &[(f64, f64)]| points.iter().map(|p| panel.place(*p)).collect::<Vec<_>>();
        for shape in &self.shapes {
            match shape {
                Shape::Line(points, width, colour) => {
                    marks.push(Mark::Line { points: places(points), width: *width, colour: *colour });
                }
                Shape::Area(points, colour) => {
                    marks.push(Mark::Area { points: places(points), colour: *colour });
                }
                Shape::Dots(points, radius, colour) => {
                    let dot = |at| Mark::Dot { at, radius: *radius, colour: *colour };
                    marks.extend(places(points).into_iter().map(dot));
                }
            }
        }
        for (i, (name, colour)) in self.legend.iter().enumerate() {
            let (x, y) = (panel.right + 16.0, top + 10.0 + 26.0 * i as f64);
            marks.push(Mark::Line { points: vec![(x, y), (x + 30.0, y)], width: 3.0, colour: *colour });
            marks.push(text((x + 38.0, y), name.clone(), 2, Anchor::Start, false));
        }
        Figure { size, marks }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_circle_stays_a_circle() {
        let circle =
            (0..=360).map(|i| f64::from(i).to_radians().sin_cos()).map(|(s, c)| (30.0 + 4.0 * c, 4.0 * s));
        let drawing = Drawing {
            title: "circle".into(),
            x_label: "z (mm)".into(),
            y_label: "x (mm)".into(),
            x: (0.0, 100.0),
            y: (-10.0, 10.0),
            shapes: vec![Shape::Area(circle.collect(), [1, 2, 3])],
            legend: vec![("disc".into(), [1, 2, 3])],
        };
        let image = drawing.figure().to_image();
        let inside: Vec<(usize, usize)> = (0..image.size().height)
            .flat_map(|y| (0..800).map(move |x| (y, x)))
            .filter(|&(y, x)| image.pixel(y, x) == [1, 2, 3])
            .collect();
        let extent = |of: fn(&(usize, usize)) -> usize| {
            inside.iter().map(of).max().unwrap() - inside.iter().map(of).min().unwrap()
        };
        assert!(extent(|p| p.0).abs_diff(extent(|p| p.1)) <= 1 && extent(|p| p.0) > 40);
    }
}
