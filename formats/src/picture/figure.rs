//! A drawing as a list of marks, so that one layout makes both the PNG and the SVG.
//!
//! Places are (x, y) in pixels from the top left, y down. Text is placed by its middle line, so that labels sit level with
//! what they name in either format; the SVG asks for a plain typeface as high as the PNG's dots, and no wider.

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
    /// A filled shape.
    Area {
        /// Its corners, in order.
        points: Vec<(f64, f64)>,
        /// Its colour.
        colour: Rgb,
    },
    /// A round dot.
    Dot {
        /// Its centre.
        at: (f64, f64),
        /// Its radius.
        radius: f64,
        /// Its colour.
        colour: Rgb,
    },
    /// A picture; the SVG holds it as PNG, its pixels as squares.
    Picture {
        /// Its top left corner.
        at: (f64, f64),
        /// The picture.
        image: Image,
        /// Side of one of its pixels.
        enlarge: usize,
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
                Mark::Area { points, colour } => image.area(points, *colour),
                Mark::Dot { at, radius, colour } => image.line(&[*at, *at], 2.0 * radius, *colour),
                Mark::Picture { at: (x, y), image: picture, enlarge } => {
                    image.lay((y.round() as usize, x.round() as usize), picture, *enlarge);
                }
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
             viewBox=\"0 0 {width} {height}\" font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\">\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n"
        );
        let mut marks = self.marks.iter().peekable();
        while let Some(mark) = marks.next() {
            // Writing to a String cannot fail.
            let _ = match mark {
                Mark::Line { points, width, colour } => {
                    // Lines alike that follow each other, as dashes do, are one path.
                    let mut path = path(points);
                    let alike = |m: &&Mark| matches!(m, Mark::Line { width: w, colour: c, .. } if w == width && c == colour);
                    while let Some(Mark::Line { points, .. }) = marks.next_if(alike) {
                        path.push_str(&self::path(points));
                    }
                    let stroke = hex(*colour);
                    writeln!(
                        svg,
                        "<path d=\"{path}\" fill=\"none\" stroke=\"{stroke}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"/>",
                    )
                }
                Mark::Area { points, colour } => {
                    let points: Vec<_> = points.iter().map(|(x, y)| format!("{x:.2},{y:.2}")).collect();
                    writeln!(svg, "<polygon points=\"{}\" fill=\"{}\"/>", points.join(" "), hex(*colour))
                }
                Mark::Dot { at: (x, y), radius, colour } => writeln!(
                    svg,
                    "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius:.2}\" fill=\"{}\"/>",
                    hex(*colour)
                ),
                Mark::Picture { at: (x, y), image, enlarge } => writeln!(
                    svg,
                    "<image x=\"{x:.2}\" y=\"{y:.2}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" \
                     style=\"image-rendering:pixelated\" href=\"data:image/png;base64,{}\"/>",
                    image.size().width * enlarge,
                    image.size().height * enlarge,
                    base64(&image.to_png())
                ),
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

/// A line in SVG's words, to a tenth of a pixel.
fn path(points: &[(f64, f64)]) -> String {
    let place = |(i, (x, y)): (usize, &(f64, f64))| {
        format!(
            "{}{x:.1} {y:.1}",
            if i == 0 {
                "M"
            } else if i == 1 {
                "L"
            } else {
                " "
            }
        )
    };
    points.iter().enumerate().map(place).collect()
}

fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// RFC 4648.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let word = three.iter().fold(0u32, |w, &b| w << 8 | u32::from(b)) << (8 * (3 - three.len()));
        for i in 0..4 {
            let letter = LETTERS[(word >> (18 - 6 * i)) as usize & 63] as char;
            out.push(if i <= three.len() { letter } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_as_in_its_standard() {
        for (plain, coded) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
    }

    #[test]
    fn shapes_dots_and_pictures_in_both() {
        let mut small = Image::new(Size::new(2, 1), [0, 0, 255]);
        small.row_mut(1)[0] = [0, 255, 0];
        let figure = Figure {
            size: Size::new(60, 80),
            marks: vec![
                Mark::Area { points: vec![(10.0, 10.0), (30.0, 10.0), (10.0, 30.0)], colour: [9, 9, 9] },
                Mark::Dot { at: (50.0, 20.0), radius: 5.0, colour: [255, 0, 0] },
                Mark::Picture { at: (40.0, 40.0), image: small, enlarge: 4 },
            ],
        };
        let (image, svg) = (figure.to_image(), figure.to_svg());
        assert_eq!((image.pixel(12, 12), image.pixel(28, 28)), ([9; 3], [255; 3]));
        let filled = image.pixels().iter().filter(|p| **p == [9; 3]).count();
        assert!(filled.abs_diff(200) < 25, "{filled}");
        assert_eq!((image.pixel(20, 50), image.pixel(20, 57)), ([255, 0, 0], [255; 3]));
        assert_eq!(
            (image.pixel(43, 43), image.pixel(44, 40), image.pixel(48, 40)),
            ([0, 0, 255], [0, 255, 0], [255; 3])
        );
        for word in ["<polygon", "<circle", "base64,iVBORw0KGgo", "width=\"4\" height=\"8\""] {
            assert!(svg.contains(word), "{word}");
        }
    }

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
