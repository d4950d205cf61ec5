//! Plots of curves: named, in colours that colour-blind eyes tell apart, solid or dashed, with axes in words and units.

use std::path::Path;

use super::PictureError;
use super::axes::{Panel, text};
use super::figure::{Anchor, Figure, Mark};
use super::file::write_text;
use super::image::Rgb;
use pipeline::geometry::Size;

/// Okabe & Ito's colours (Color Universal Design, 2008) but for yellow, which paper swallows, and ordered like the spectrum.
pub const COLOURS: [Rgb; 7] =
    [[0, 114, 178], [86, 180, 233], [0, 158, 115], [230, 159, 0], [213, 94, 0], [204, 121, 167], [0, 0, 0]];

/// Pixels left of, right of, above and below the axes.
const MARGIN: (f64, f64, f64, f64) = (136.0, 220.0, 64.0, 76.0);

/// One curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// Its name in the legend; the same name twice is told once, no name not at all.
    pub name: String,
    /// Its points, x ascending.
    pub points: Vec<(f64, f64)>,
    /// Its colour.
    pub colour: Rgb,
    /// Dashed or solid.
    pub dashed: bool,
}

/// Curves over one pair of axes.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// What is shown.
    pub title: String,
    /// What goes right, with its unit.
    pub x_label: String,
    /// What goes up, with its unit.
    pub y_label: String,
    /// Values that the y axis holds at least.
    pub y_holds: (f64, f64),
    /// The curves, the first lowest.
    pub curves: Vec<Curve>,
    /// What solid and dashed mean, if both are there.
    pub styles: Option<[&'static str; 2]>,
}

impl Plot {
    /// Draws it, 960 by 600 or as high as its legend.
    pub fn figure(&self) -> Figure {
        let mut named: Vec<&Curve> = Vec::new();
        for c in &self.curves {
            if !c.name.is_empty() && named.iter().all(|n| n.name != c.name) {
                named.push(c);
            }
        }
        let rows = named.len() + if self.styles.is_some() { 3 } else { 0 };
        let size = Size::new(600.max(150 + 26 * rows), 960);
        let (left, right, top, bottom) = MARGIN;
        let all = || self.curves.iter().flat_map(|c| &c.points).filter(|p| p.1.is_finite());
        let (least_x, most_x) = all().fold((0.0f64, 0.0f64), |(l, m), p| (l.min(p.0), m.max(p.0)));
        let (low, high) = all().fold(self.y_holds, |(l, h), p| (l.min(p.1), h.max(p.1)));
        // A value that the axis holds anyway, such as 0, may lie on the frame; curves get a little air.
        let air = 0.05 * (high - low).max(1e-9);
        let room = |v: f64, held: f64, air: f64| if v == held { v } else { v + air };
        let panel = Panel {
            left,
            right: size.width as f64 - right,
            top,
            bottom: size.height as f64 - bottom,
            x: (least_x, if most_x > least_x { most_x } else { 1.0 }),
            y: (room(low, self.y_holds.0, -air), room(high, self.y_holds.1, air)),
        };
        let mut marks = vec![text((left, top / 2.0), self.title.clone(), 2, Anchor::Start, false)];
        panel.draw(&mut marks, &self.y_label, Some(&self.x_label));
        for c in &self.curves {
            marks.extend(stroke(panel.places(&c.points), 2.5, c.colour, c.dashed));
        }
        let x = panel.right + 16.0;
        let mut y = top + 10.0;
        let mut entry = |name: &str, colour: Rgb, dashed: bool| {
            marks.extend(stroke(vec![(x, y), (x + 40.0, y)], 2.5, colour, dashed));
            marks.push(text((x + 50.0, y), name.to_owned(), 2, Anchor::Start, false));
            y += 26.0;
        };
        for c in named {
            entry(&c.name, c.colour, c.dashed && self.styles.is_none());
        }
        if let Some([solid, dashed]) = self.styles {
            y += 13.0;
            for (name, dashed) in [(solid, false), (dashed, true)] {
                marks.extend(stroke(vec![(x, y), (x + 40.0, y)], 2.5, [90; 3], dashed));
                marks.push(text((x + 50.0, y), name.to_owned(), 2, Anchor::Start, false));
                y += 26.0;
            }
        }
        Figure { size, marks }
    }
}

/// Writes a figure as SVG, whole or not at all.
///
/// # Errors
/// If the file cannot be written.
pub fn write_svg(path: &Path, figure: &Figure) -> Result<(), PictureError> {
    write_text(path, &figure.to_svg())
}

/// A line, cut into dashes of 9 with gaps of 6 pixels if asked.
fn stroke(points: Vec<(f64, f64)>, width: f64, colour: Rgb, dashed: bool) -> Vec<Mark> {
    if !dashed {
        return vec![Mark::Line { points, width, colour }];
    }
    let (on, off) = (9.0, 6.0);
    let mut marks = Vec::new();
    let mut dash: Vec<(f64, f64)> = points.first().copied().into_iter().collect();
    let (mut drawing, mut left) = (true, on);
    for pair in points.windows(2) {
        let (mut from, to) = (pair[0], pair[1]);
        loop {
            let length = (to.0 - from.0).hypot(to.1 - from.1);
            if length <= left {
                left -= length;
                if drawing {
                    dash.push(to);
                }
                break;
            }
            let t = left / length;
            from = (from.0 + t * (to.0 - from.0), from.1 + t * (to.1 - from.1));
            if drawing {
                dash.push(from);
                marks.push(Mark::Line { points: std::mem::take(&mut dash), width, colour });
            } else {
                dash = vec![from];
            }
            drawing = !drawing;
            left = if drawing { on } else { off };
        }
    }
    if drawing && dash.len() > 1 {
        marks.push(Mark::Line { points: dash, width, colour });
    }
    marks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dashes_cover_three_fifths_of_the_way() {
        let bent = vec![(0.0, 0.0), (100.0, 0.0), (100.0, 50.0)];
        let length = |marks: &[Mark]| -> f64 {
            let of = |m: &Mark| match m {
                Mark::Line { points, .. } => {
                    points.windows(2).map(|p| (p[1].0 - p[0].0).hypot(p[1].1 - p[0].1)).sum()
                }
                _ => 0.0,
            };
            marks.iter().map(of).sum()
        };
        assert!((length(&stroke(bent.clone(), 1.0, [0; 3], true)) - 90.0).abs() < 1e-9);
        assert_eq!(length(&stroke(bent, 1.0, [0; 3], false)), 150.0);
    }

    #[test]
    fn curves_left_of_the_origin_and_without_a_name() {
        let curve = |name: &str, points| Curve { name: name.into(), points, colour: [0; 3], dashed: false };
        let plot = Plot {
            title: String::new(),
            x_label: "distance (px)".into(),
            y_label: "value".into(),
            y_holds: (0.0, 1.0),
            curves: vec![curve("", vec![(-20.0, 0.0), (20.0, 1.0)]), curve("film", vec![(0.0, 0.5)])],
            styles: None,
        };
        let figure = plot.figure();
        let svg = figure.to_svg();
        assert!(svg.contains(">-20<") && svg.contains(">20<") && svg.contains(">film<"), "{svg}");
        let left = figure.size.width as f64 - MARGIN.1;
        let inside = |p: &(f64, f64)| p.0 >= MARGIN.0 - 1e-9 && p.0 <= left + 1e-9;
        let long = |m: &&Mark| matches!(m, Mark::Line { width: 2.5, points, .. } if points.len() == 2);
        let Some(Mark::Line { points, .. }) = figure.marks.iter().find(long) else { panic!("no curve") };
        assert!(points.iter().all(inside), "{points:?}");
    }

    #[test]
    fn a_plot_names_its_curves_once_and_its_axes() {
        let curve = |dashed| Curve {
            name: "550 nm".into(),
            points: vec![(0.0, 0.2), (10.0, 0.9)],
            colour: COLOURS[0],
            dashed,
        };
        let plot = Plot {
            title: "MTF".into(),
            x_label: "real image height (mm)".into(),
            y_label: "contrast".into(),
            y_holds: (0.0, 1.0),
            curves: vec![curve(false), curve(true)],
            styles: Some(["sagittal", "tangential"]),
        };
        let svg = plot.figure().to_svg();
        for word in ["550 nm", "real image height (mm)", "contrast", "sagittal", "tangential", "MTF"] {
            assert_eq!(svg.matches(word).count(), 1, "{word}");
        }
    }
}
