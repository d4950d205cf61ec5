//! A figure as an SVG document, and its PNG: the same document drawn by `resvg`.
//!
//! Places are (x, y) in px from the top left, y down. The SVG holds its text as text and carries the font; for the PNG
//! the text is laid out in the same places as outlines, so that no font of the machine takes part. The same figure is
//! always the same bytes.

use std::fmt::Write;
use std::path::Path;

use base64::Engine;
use resvg::{tiny_skia, usvg};

use super::PictureError;
use super::image::Image;
use super::style::{Colour, Rgb, Style, hex};
use super::text::{self, CAP_HEIGHT, FAMILY, escape};
use crate::durable::WholeFile;
use pipeline::geometry::Size;

/// Pixels of a PNG per px of a figure: enough for a column of a printed page.
pub const PNG_SCALE: f64 = 2.0;

/// Font size of labels and numbers, px.
pub const FONT: f64 = 15.0;

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

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    /// Its colour.
    pub colour: Colour,
    /// Its width, px.
    pub width: f64,
    /// Its pattern, one of [`DASHES`]; 0: solid.
    pub dash: usize,
}

/// Dash patterns, px: each of a palette's colours has its own.
pub const DASHES: [&str; 7] = ["", "8 4", "2 3", "10 3 2 3", "16 4", "10 3 2 3 2 3", "5 2"];

/// One line of text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Text<'a> {
    /// Its anchor, at half the height of its capitals.
    pub at: (f64, f64),
    /// Font size, px.
    pub size: f64,
    /// Where the anchor is.
    pub anchor: Anchor,
    /// Whether it reads upwards.
    pub upwards: bool,
    /// Largest width, px; longer text is cut with an ellipsis, the SVG keeps the whole as its tooltip.
    pub most: f64,
    /// What it says.
    pub text: &'a str,
}

impl<'a> Text<'a> {
    /// A line to the right at the font size of labels, of any length.
    pub fn new(at: (f64, f64), anchor: Anchor, text: &'a str) -> Self {
        Self { at, size: FONT, anchor, upwards: false, most: f64::MAX, text }
    }
}

enum Mark {
    Svg(String),
    Text { start: (f64, f64), size: f64, upwards: bool, text: String, whole: Option<String> },
}

/// A drawing on paper of one colour.
pub struct Figure {
    size: Size,
    style: Style,
    paper: Rgb,
    marks: Vec<Mark>,
}

impl Figure {
    /// An empty figure.
    pub fn new(size: Size, style: Style) -> Self {
        Self { size, style, paper: style.rgb(Colour::Paper), marks: Vec::new() }
    }

    /// The same on paper of another colour.
    pub fn on(self, paper: Rgb) -> Self {
        Self { paper, ..self }
    }

    /// Its style.
    pub const fn style(&self) -> Style {
        self.style
    }

    /// Size, px.
    pub const fn size(&self) -> Size {
        self.size
    }

    fn add(&mut self, element: String) {
        self.marks.push(Mark::Svg(element));
    }

    fn stroke(&self, stroke: Stroke) -> String {
        let dash = DASHES[stroke.dash % DASHES.len()];
        let dash = if dash.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{dash}\"") };
        let colour = hex(self.style.rgb(stroke.colour));
        format!(" stroke=\"{colour}\" stroke-width=\"{}\"{dash}", number(stroke.width))
    }

    /// A line through points.
    pub fn line(&mut self, points: &[(f64, f64)], stroke: Stroke) {
        let style = self.stroke(stroke);
        let data = path(points);
        self.add(format!("<path d=\"{data}\" fill=\"none\" stroke-linejoin=\"round\"{style}/>"));
    }

    /// A filled polygon.
    pub fn area(&mut self, points: &[(f64, f64)], colour: Colour) {
        let fill = hex(self.style.rgb(colour));
        self.add(format!("<path d=\"{}Z\" fill=\"{fill}\"/>", path(points)));
    }

    /// Round dots.
    pub fn dots(&mut self, centres: &[(f64, f64)], radius: f64, colour: Colour) {
        // Lines of no length with round ends: one element for all.
        let data: String = centres.iter().map(|c| path(&[*c, (c.0 + 0.01, c.1)])).collect();
        let (stroke, width) = (hex(self.style.rgb(colour)), number(2.0 * radius));
        self.add(format!(
            "<path d=\"{data}\" stroke=\"{stroke}\" stroke-width=\"{width}\" stroke-linecap=\"round\"/>"
        ));
    }

    /// A marker of shape `kind` (circle, square, triangle, diamond, cross), counted around.
    pub fn marker(&mut self, (x, y): (f64, f64), kind: usize, colour: Colour) {
        let polygon: &[(f64, f64)] = match kind % 5 {
            0 => return self.dots(&[(x, y)], 3.6, colour),
            1 => &[(-3.2, -3.2), (3.2, -3.2), (3.2, 3.2), (-3.2, 3.2)],
            2 => &[(0.0, -4.6), (4.3, 3.4), (-4.3, 3.4)],
            3 => &[(0.0, -4.8), (4.8, 0.0), (0.0, 4.8), (-4.8, 0.0)],
            _ => &[(0.0, 4.6), (4.3, -3.4), (-4.3, -3.4)],
        };
        let placed: Vec<_> = polygon.iter().map(|(dx, dy)| (x + dx, y + dy)).collect();
        self.area(&placed, colour);
    }

    /// A picture, its pixels as squares of `enlarge` px.
    pub fn picture(&mut self, (x, y): (f64, f64), image: &Image, enlarge: usize) {
        let data = base64::engine::general_purpose::STANDARD.encode(image.to_quick_png(""));
        self.add(format!(
            "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" \
             style=\"image-rendering:pixelated\" href=\"data:image/png;base64,{data}\"/>",
            number(x),
            number(y),
            image.size().width * enlarge,
            image.size().height * enlarge,
        ));
    }

    /// Draws only inside a rectangle (left, top, width, height) until [`Figure::clip_end`].
    pub fn clip(&mut self, [x, y, width, height]: [f64; 4]) {
        let [x, y, width, height] = [x, y, width, height].map(number);
        self.add(format!(
            "<svg x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" viewBox=\"{x} {y} {width} {height}\">"
        ));
    }

    /// Ends [`Figure::clip`].
    pub fn clip_end(&mut self) {
        self.add("</svg>".into());
    }

    /// A line of text.
    pub fn text(&mut self, label: Text<'_>) {
        // As XML will hold it: what is measured is what is shown.
        let cleaned: String = label.text.chars().map(|c| if c.is_whitespace() { ' ' } else { c }).collect();
        let shown = text::fit(&cleaned, label.size, label.most).into_owned();
        if shown.trim().is_empty() {
            return;
        }
        let width = text::width(&shown, label.size);
        let back = match label.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => width / 2.0,
            Anchor::End => width,
        };
        let down = CAP_HEIGHT * label.size / 2.0;
        let (x, y) = label.at;
        let start = if label.upwards { (x + down, y + back) } else { (x - back, y + down) };
        let whole = (shown != cleaned).then_some(cleaned);
        self.marks.push(Mark::Text { start, size: label.size, upwards: label.upwards, text: shown, whole });
    }

    /// The SVG document, with its font.
    pub fn to_svg(&self) -> String {
        self.document(&format!("<style>{}</style>\n", text::font_css()), false)
    }

    /// The SVG element for an HTML page that holds [`text::font_css`].
    pub fn to_svg_element(&self) -> String {
        self.document("", false)
    }

    fn document(&self, head: &str, outlined: bool) -> String {
        let Size { height, width } = self.size;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"{FAMILY}\">\n{head}\
             <rect width=\"{width}\" height=\"{height}\" fill=\"{}\"/>\n",
            hex(self.paper)
        );
        let ink = hex(self.style.rgb(Colour::Ink));
        for mark in &self.marks {
            // Writing to a String cannot fail.
            let _ = match mark {
                Mark::Svg(element) => writeln!(svg, "{element}"),
                Mark::Text { start: (x, y), size, upwards, text, whole } => {
                    let (sx, sy) = (number(*x), number(*y));
                    let rotate = if *upwards {
                        format!(" transform=\"rotate(-90 {sx} {sy})\"")
                    } else {
                        String::new()
                    };
                    if outlined {
                        let data = text::outlines(text, *size, (*x, *y));
                        writeln!(svg, "<path d=\"{data}\" fill=\"{ink}\"{rotate}/>")
                    } else {
                        let whole = whole.as_ref().map(|w| format!("<title>{}</title>", escape(w)));
                        writeln!(
                            svg,
                            "<text x=\"{sx}\" y=\"{sy}\" font-size=\"{}\" fill=\"{ink}\"{rotate}>{}{}</text>",
                            number(*size),
                            whole.unwrap_or_default(),
                            escape(text)
                        )
                    }
                }
            };
        }
        svg + "</svg>\n"
    }

    /// Draws it, `scale` pixels per px.
    ///
    /// # Errors
    /// If the picture would have no pixels, or more than fit a drawing (2³¹ bytes).
    pub fn to_image(&self, scale: f64) -> Result<Image, PictureError> {
        let failed = |problem: String| PictureError::Setting { setting: "figure", problem };
        let tree = usvg::Tree::from_str(&self.document("", true), &usvg::Options::default())
            .map_err(|e| failed(format!("{} px cannot be drawn: {e}", self.size)))?;
        let side = |px: usize| (px as f64 * scale).round();
        let (width, height) = (side(self.size.width), side(self.size.height));
        let mut pixels = tiny_skia::Pixmap::new(width as u32, height as u32)
            .ok_or_else(|| failed(format!("a picture of {width} x {height} pixels cannot be drawn")))?;
        resvg::render(
            &tree,
            tiny_skia::Transform::from_scale(scale as f32, scale as f32),
            &mut pixels.as_mut(),
        );
        let mut image = Image::new(Size::new(height as usize, width as usize), [0; 3]);
        let bytes = pixels.data().chunks_exact(4 * width as usize);
        for (y, line) in bytes.enumerate() {
            for (to, from) in image.row_mut(y).iter_mut().zip(line.chunks_exact(4)) {
                // The paper covers everything: no pixel is transparent.
                *to = [from[0], from[1], from[2]];
            }
        }
        Ok(image)
    }

    /// Writes it, whole or not at all: PNG of [`PNG_SCALE`] pixels per px if the name ends in `.png`, else SVG.
    ///
    /// # Errors
    /// As [`Figure::to_image`], and if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), PictureError> {
        Ok(self.file(path)?.finish()?)
    }

    /// As [`Figure::write`], a file that has not got its name yet.
    ///
    /// # Errors
    /// As [`Figure::write`].
    pub fn file(&self, path: &Path) -> Result<WholeFile, PictureError> {
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
            return self.to_image(PNG_SCALE)?.png_file(path, "lenscube figure");
        }
        Ok(WholeFile::with_text(path, &self.to_svg())?)
    }
}

/// At most two digits after the point, without zeros at the end.
fn number(v: f64) -> String {
    let text = format!("{v:.2}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".into() } else { short.to_owned() }
}

fn path(points: &[(f64, f64)]) -> String {
    let mut data = String::with_capacity(12 * points.len());
    for (i, (x, y)) in points.iter().enumerate() {
        data.push(if i == 0 { 'M' } else { 'L' });
        data.push_str(&number(*x));
        data.push(' ');
        data.push_str(&number(*y));
    }
    data
}

#[cfg(test)]
mod tests {
    use super::*;

    const INK: Stroke = Stroke { colour: Colour::Ink, width: 2.0, dash: 0 };

    fn label(text: &str, at: (f64, f64)) -> Text<'_> {
        Text { size: 20.0, ..Text::new(at, Anchor::Middle, text) }
    }

    #[test]
    fn lines_areas_dots_and_pictures_are_drawn() {
        let mut small = Image::new(Size::new(2, 1), [0, 0, 255]);
        small.row_mut(1)[0] = [0, 255, 0];
        let mut figure = Figure::new(Size::new(60, 80), Style::Light);
        figure.area(&[(10.0, 10.0), (30.0, 10.0), (10.0, 30.0)], Colour::Ink);
        figure.dots(&[(50.0, 20.0)], 5.0, Colour::Palette(4));
        figure.picture((40.0, 40.0), &small, 4);
        figure.line(&[(5.0, 55.0), (35.0, 55.0)], INK);
        let image = figure.to_image(1.0).unwrap();
        let (ink, red) = (Style::Light.rgb(Colour::Ink), Style::Light.rgb(Colour::Palette(4)));
        assert_eq!((image.pixel(12, 12), image.pixel(28, 28)), (ink, [255; 3]));
        assert_eq!((image.pixel(20, 50), image.pixel(20, 57)), (red, [255; 3]));
        assert_eq!((image.pixel(54, 20), image.pixel(50, 20)), (ink, [255; 3]));
        let picture = [(40, 40), (43, 43), (44, 40), (47, 43)].map(|(y, x)| image.pixel(y, x));
        assert_eq!(picture, [[0, 0, 255], [0, 0, 255], [0, 255, 0], [0, 255, 0]]);
        assert_eq!([image.pixel(39, 40), image.pixel(48, 40), image.pixel(41, 44)], [[255; 3]; 3]);
    }

    #[test]
    fn text_is_centred_in_the_png_and_text_in_the_svg() {
        let mut figure = Figure::new(Size::new(60, 160), Style::Light);
        figure.text(label("a<b & \"c\"", (80.0, 30.0)));
        let image = figure.to_image(1.0).unwrap();
        let dark = |y: usize, x: usize| image.pixel(y, x)[0] < 128;
        let columns: Vec<usize> = (0..160).filter(|&x| (0..60).any(|y| dark(y, x))).collect();
        assert!((columns[0] + columns[columns.len() - 1]).abs_diff(160) <= 3, "{columns:?}");
        let svg = figure.to_svg();
        let document = usvg::roxmltree::Document::parse(&svg).unwrap();
        let texts: Vec<_> = document.descendants().filter(|n| n.has_tag_name("text")).collect();
        assert_eq!(texts[0].text(), Some("a<b & \"c\""));
    }

    #[test]
    fn a_figure_is_the_same_bytes_each_time_and_as_large_as_asked() {
        let make = || {
            let mut figure = Figure::new(Size::new(60, 80), Style::Dark);
            figure.text(label("λ = 550 nm", (40.0, 30.0)));
            figure
        };
        assert_eq!(make().to_svg(), make().to_svg());
        for (scale, want) in [(1.0, Size::new(60, 80)), (2.0, Size::new(120, 160)), (1.5, Size::new(90, 120))]
        {
            let image = make().to_image(scale).unwrap();
            assert_eq!(image.size(), want);
            assert_eq!(image, make().to_image(scale).unwrap());
        }
        assert!(make().to_image(0.0).is_err() && make().to_image(1e9).is_err());
    }
}
