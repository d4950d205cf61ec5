//! Series of a plot: a named curve, area or set of dots.

use super::axes::{Panel, drawable};
use super::figure::{Figure, Stroke};
use super::style::Colour;

/// Markers along one series.
const MAX_MARKERS: usize = 5;

/// How points are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A curve.
    Line {
        /// Width, px; 0: the default of the plot.
        width: f64,
        /// Pattern of [`super::figure::DASHES`].
        dash: usize,
    },
    /// A filled polygon.
    Area,
    /// Dots of a radius in px.
    Dots(f64),
}

/// One curve, area or set of dots. A point that is not finite leaves a gap.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Name in the legend, where equal names are listed once; empty: no entry.
    pub name: String,
    /// Points, in the units of the axes.
    pub points: Vec<(f64, f64)>,
    /// Colour.
    pub colour: Colour,
    /// How the points are drawn.
    pub shape: Shape,
    /// Shape of the markers along it, see [`Figure::marker`].
    pub marker: Option<usize>,
}

impl Series {
    /// A solid curve.
    pub fn line(name: impl Into<String>, points: Vec<(f64, f64)>, colour: Colour) -> Self {
        Self { name: name.into(), points, colour, shape: Shape::Line { width: 0.0, dash: 0 }, marker: None }
    }

    /// A curve with the `i`-th colour and dash pattern of the palette, for curves without an order.
    pub fn distinct(name: impl Into<String>, points: Vec<(f64, f64)>, i: usize) -> Self {
        Self::line(name, points, Colour::Palette(i)).dashed(i)
    }

    /// With a dash pattern.
    pub fn dashed(self, dash: usize) -> Self {
        let width = if let Shape::Line { width, .. } = self.shape { width } else { 0.0 };
        Self { shape: Shape::Line { width, dash }, ..self }
    }

    /// With markers along it.
    pub fn marked(self, kind: usize) -> Self {
        Self { marker: Some(kind), ..self }
    }

    /// In another shape.
    pub fn shaped(self, shape: Shape) -> Self {
        Self { shape, ..self }
    }

    /// Points that can be drawn.
    pub(super) fn drawable_points(&self) -> impl Iterator<Item = &(f64, f64)> {
        self.points.iter().filter(|p| drawable(p.0) && drawable(p.1))
    }

    /// Draws it on the axes of `panel`; `line_width` in px where the series has none.
    pub(super) fn draw(&self, figure: &mut Figure, panel: &Panel, line_width: f64) {
        for segment in panel.segments(&self.points) {
            match (self.shape, segment.as_slice()) {
                (Shape::Area, points) => figure.area(points, self.colour),
                (Shape::Dots(radius), points) => figure.dots(points, radius, self.colour),
                (Shape::Line { width, dash }, points) => {
                    let width = if width > 0.0 { width } else { line_width };
                    match points {
                        [_] => figure.dots(points, 1.8 * width, self.colour),
                        _ => figure.line(points, Stroke { colour: self.colour, width, dash }),
                    }
                }
            }
        }
        if let Some(kind) = self.marker {
            let points: Vec<_> = self.drawable_points().collect();
            let count = points.len().min(MAX_MARKERS);
            for i in 0..count {
                let at = points[(2 * i + 1) * points.len() / (2 * count)];
                figure.marker(panel.place(*at), kind, self.colour);
            }
        }
    }
}
