//! A drawing as a list of marks, so that one layout makes both the PNG and the SVG.
//!
//! Places are (x, y) in pixels from the top left, y down. Text is placed by its middle line, so that labels sit level with
//! what they name in either format; the SVG asks for a typeface of even width as high as the PNG's dots.

use std::fmt::Write;

use super::image::{Image, Rgb, text_size};
use pipeline::geometry::Size;

/// Where a text's anchor lies along its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// At its first letter.
    Start,
    /// In its middle.
    Middle,
    /// After its last letter.
    End,
}

/// One thing drawn.
#[derive(Clone, Debug, PartialEq)]
pub enum Mark {
    /// A line through points.
    Line {
        /// Its points.
        points: Vec<(f64, f64)>,
        /// Its width.
        width: f64,
        /// Its colour.
        colour: Rgb,
    },
    /// A line of text.
    Text {
        /// Its anchor, on its middle line.
        at: (f64, f64),
        /// What it says.
        text: String,
        /// Pixels a dot of its letters (7 dots high).
        dot: usize,
        /// Where its anchor is.
        anchor: Anchor,
        /// Whether it reads upwards.
        up: bool,
        /// Its colour.
        colour: Rgb,
    },
}

/// A drawing on white paper.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// Size in pixels.
    pub size: Size,
    /// What is drawn, the first lowest.
    pub marks: Vec<Mark>,
}

impl Figure {
    /// Draws it in pixels.
    pub fn to_image(&self) -> Image {
        let mut image = Image::new(self.size, [255; 3]);
        for mark in &self.marks {
            match mark {
                Mark::Line { points, width, colour } => image.line(points, *width, *colour),
                Mark::Text { at, text, dot, anchor, up, colour } => {
                    let box_ = text_size(text, *dot);
                    let along = match anchor {
                        Anchor::Start => 0.0,
                        Anchor::Middle => box_.width as f64 / 2.0,
                        Anchor::End => box_.width as f64,
                    };
                    let across = box_.height as f64 / 2.0;
                    let whole = |v: f64| v.round() as i64;
                    if *up {
                        image.text_up((whole(at.1 + along), whole(at.0 - across)), text, *dot, *colour);
                    } else {
                        image.text((whole(at.1 - across), whole(at.0 - along)), text, *dot, *colour);
                    }
                }
            }
        }
        image
    }

    /// Writes it as an SVG document.
    pub fn to_svg(&self) -> String {
        let Size { height, width } = self.size;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"monospace\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
        );
        for mark in &self.marks {
            // Writing to a String cannot fail.
            let _ = match mark {
                Mark::Line { points, width, colour } => {
                    let points: Vec<_> = points.iter().map(|(x, y)| format!("{x:.2},{y:.2}")).collect();
                    writeln!(
                        svg,
                        "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"/>",
                        points.join(" "),
                        hex(*colour)
                    )
                }
                Mark::Text { at: (x, y), text, dot, anchor, up, colour } => {
                    let anchor = match anchor {
                        Anchor::Start => "start",
                        Anchor::Middle => "middle",
                        Anchor::End => "end",
                    };
                    let turn =
                        if *up { format!(" transform=\"rotate(-90 {x:.2} {y:.2})\"") } else { String::new() };
                    writeln!(
                        svg,
                        "<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"{}\" text-anchor=\"{anchor}\" dominant-baseline=\"central\" fill=\"{}\"{turn}>{}</text>",
                        9 * dot,
                        hex(*colour),
                        escape(text)
                    )
                }
            };
        }
        svg + "</svg>\n"
    }
}

fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_layout_makes_both() {
        let figure = Figure {
            size: Size::new(60, 80),
            marks: vec![
                Mark::Line { points: vec![(5.0, 50.0), (75.0, 50.0)], width: 2.0, colour: [255, 0, 0] },
                Mark::Text {
                    at: (40.0, 20.0),
                    text: "a<b".into(),
                    dot: 2,
                    anchor: Anchor::Middle,
                    up: false,
                    colour: [0; 3],
                },
            ],
        };
        let (image, svg) = (figure.to_image(), figure.to_svg());
        assert_eq!(image.pixel(50, 40), [255, 0, 0]);
        let dark: Vec<usize> = (0..80).filter(|&x| (0..40).any(|y| image.pixel(y, x) == [0; 3])).collect();
        assert_eq!((dark[0] + dark[dark.len() - 1] + 1).abs_diff(80) / 2, 0, "{dark:?}");
        assert!(svg.contains("a&lt;b") && svg.contains("#ff0000") && svg.ends_with("</svg>\n"));
    }
}
