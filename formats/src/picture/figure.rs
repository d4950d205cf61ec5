//! A figure as an SVG document, and its PNG: the same document drawn by `resvg`.
//!
//! Coordinates are (x, y) in px from the top left, y down. The SVG holds text as text and embeds the font; in the PNG the
//! text is drawn as outlines at the same places, so no font of the machine is used. Equal figures have equal bytes.

use std::fmt::Write;
use std::path::Path;

use base64::Engine;
#[cfg(feature = "figures")]
use resvg::{tiny_skia, usvg};

use super::PictureError;
use super::image::Image;
use super::style::{Colour, Rgb, Style, hex};
use super::text::{self, CAP_HEIGHT, FAMILY, escape};
use crate::durable::AtomicFile;
use pipeline::geometry::Size;

/// Pixels of a PNG per px of a figure, for print at column width.
pub const PNG_SCALE: f64 = 2.0;

/// Font size of labels and numbers, px.
pub const FONT: f64 = 15.0;

/// Position of a text's anchor along its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// At the first letter.
    Start,
    /// In the middle.
    Middle,
    /// After the last letter.
    End,
}

/// Line style.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    /// Colour.
    pub colour: Colour,
    /// Width, px.
    pub width: f64,
    /// Pattern, an index into [`DASHES`]; 0: solid.
    pub dash: usize,
}

impl Stroke {
    /// Frames and ticks.
    pub(super) const THIN: Self = Self { colour: Colour::Ink, width: 1.0, dash: 0 };
}

/// Dash patterns, px: one for each colour of the palette.
pub const DASHES: [&str; 7] = ["", "8 4", "2 3", "10 3 2 3", "16 4", "10 3 2 3 2 3", "5 2"];

/// One line of text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Text<'a> {
    /// Anchor, px, at half the height of capitals.
    pub at: (f64, f64),
    /// Font size, px.
    pub size: f64,
    /// Position of the anchor along the line.
    pub anchor: Anchor,
    /// Whether the line is rotated by 90° to read upwards.
    pub upwards: bool,
    /// Maximum width, px; longer text is cut with an ellipsis, the SVG keeps the full text as tooltip.
    pub max_width: f64,
    /// The text.
    pub text: &'a str,
}

impl<'a> Text<'a> {
    /// A horizontal line at the font size of labels, of any length.
    pub fn new(at: (f64, f64), anchor: Anchor, text: &'a str) -> Self {
        Self { at, size: FONT, anchor, upwards: false, max_width: f64::MAX, text }
    }
}

enum Element {
    Svg(String),
    Text { start: (f64, f64), size: f64, upwards: bool, text: String, tooltip: Option<String> },
}

/// A drawing on a background of one colour.
pub struct Figure {
    size: Size,
    style: Style,
    background: Rgb,
    elements: Vec<Element>,
}

impl Figure {
    /// An empty figure.
    pub fn new(size: Size, style: Style) -> Self {
        Self { size, style, background: style.rgb(Colour::Paper), elements: Vec::new() }
    }

    /// With another background.
    pub(super) fn with_background(self, background: Rgb) -> Self {
        Self { background, ..self }
    }

    /// Colours.
    pub const fn style(&self) -> Style {
        self.style
    }

    /// Size, px.
    pub const fn size(&self) -> Size {
        self.size
    }

    fn add(&mut self, element: String) {
        self.elements.push(Element::Svg(element));
    }

    fn stroke_attributes(&self, stroke: Stroke) -> String {
        let dash = DASHES[stroke.dash % DASHES.len()];
        let dash = if dash.is_empty() { String::new() } else { format!(" stroke-dasharray=\"{dash}\"") };
        let colour = hex(self.style.rgb(stroke.colour));
        format!(" stroke=\"{colour}\" stroke-width=\"{}\"{dash}", number(stroke.width))
    }

    /// A line through points.
    pub fn line(&mut self, points: &[(f64, f64)], stroke: Stroke) {
        let stroke = self.stroke_attributes(stroke);
        let data = path_data(points);
        self.add(format!("<path d=\"{data}\" fill=\"none\" stroke-linejoin=\"round\"{stroke}/>"));
    }

    /// A filled polygon.
    pub fn area(&mut self, points: &[(f64, f64)], colour: Colour) {
        let fill = hex(self.style.rgb(colour));
        self.add(format!("<path d=\"{}Z\" fill=\"{fill}\"/>", path_data(points)));
    }

    /// Round dots.
    pub fn dots(&mut self, centres: &[(f64, f64)], radius: f64, colour: Colour) {
        // Lines of near-zero length with round ends: one element for all dots.
        let data: String = centres.iter().map(|c| path_data(&[*c, (c.0 + 0.01, c.1)])).collect();
        let (stroke, width) = (hex(self.style.rgb(colour)), number(2.0 * radius));
        self.add(format!(
            "<path d=\"{data}\" stroke=\"{stroke}\" stroke-width=\"{width}\" stroke-linecap=\"round\"/>"
        ));
    }

    /// A marker of shape `kind` modulo 5: circle, square, triangle, diamond, inverted triangle.
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

    /// An image, each pixel a square of `enlarge` px.
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

    /// Limits drawing to a rectangle (left, top, width, height) until [`Figure::clip_end`].
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
        // As written to XML, where line ends are spaces: the measured width is that of the text shown.
        let cleaned: String = label.text.chars().map(|c| if c.is_whitespace() { ' ' } else { c }).collect();
        let fitted = text::fit(&cleaned, label.size, label.max_width);
        if fitted.trim().is_empty() {
            return;
        }
        let width = text::width(&fitted, label.size);
        let back = match label.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => width / 2.0,
            Anchor::End => width,
        };
        let down = CAP_HEIGHT * label.size / 2.0;
        let (x, y) = label.at;
        let start = if label.upwards { (x + down, y + back) } else { (x - back, y + down) };
        let tooltip = (fitted != cleaned).then_some(cleaned);
        let (size, upwards) = (label.size, label.upwards);
        self.elements.push(Element::Text { start, size, upwards, text: fitted, tooltip });
    }

    /// The SVG document with the embedded font.
    pub fn to_svg(&self) -> String {
        self.document(&format!("<style>{}</style>\n", text::font_css()), false)
    }

    /// The SVG element for an HTML page that includes [`text::font_css`].
    pub fn to_svg_element(&self) -> String {
        self.document("", false)
    }

    fn document(&self, head: &str, outlined: bool) -> String {
        let Size { height, width } = self.size;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"{FAMILY}\">\n{head}\
             <rect width=\"{width}\" height=\"{height}\" fill=\"{}\"/>\n",
            hex(self.background)
        );
        let ink = hex(self.style.rgb(Colour::Ink));
        for element in &self.elements {
            // Writing to a String cannot fail.
            let _ = match element {
                Element::Svg(svg_element) => writeln!(svg, "{svg_element}"),
                Element::Text { start: (x, y), size, upwards, text, tooltip } => {
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
                        let title = tooltip.as_ref().map(|t| format!("<title>{}</title>", escape(t)));
                        writeln!(
                            svg,
                            "<text x=\"{sx}\" y=\"{sy}\" font-size=\"{}\" fill=\"{ink}\"{rotate}>{}{}</text>",
                            number(*size),
                            title.unwrap_or_default(),
                            escape(text)
                        )
                    }
                }
            };
        }
        svg + "</svg>\n"
    }

    /// An error: this build draws none.
    ///
    /// # Errors
    /// Always.
    #[cfg(not(feature = "figures"))]
    pub fn to_image(&self, _scale: f64) -> Result<Image, PictureError> {
        let problem =
            format!("PNG of figures cannot be drawn, SVG can: {}", crate::features::missing("figures"));
        Err(PictureError::Setting { setting: "figure", problem })
    }

    /// The figure as pixels, `scale` pixels per px.
    ///
    /// # Errors
    /// If the image would have no pixels, or more than 2³¹ bytes.
    #[cfg(feature = "figures")]
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
                // The background is opaque, so no pixel is transparent.
                *to = [from[0], from[1], from[2]];
            }
        }
        Ok(image)
    }

    /// Writes the file atomically: PNG of [`PNG_SCALE`] pixels per px if the name ends in `.png`, else SVG.
    ///
    /// # Errors
    /// As [`Figure::to_image`], and if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), PictureError> {
        Ok(self.file(path)?.finish()?)
    }

    /// As [`Figure::write`], but the file appears when [`AtomicFile::finish`] is called.
    ///
    /// # Errors
    /// As [`Figure::write`].
    pub fn file(&self, path: &Path) -> Result<AtomicFile, PictureError> {
        if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
            return self.to_image(PNG_SCALE)?.png_file(path, "lenscube figure");
        }
        Ok(AtomicFile::with_text(path, &self.to_svg())?)
    }
}

/// At most two decimals, without trailing zeros.
fn number(v: f64) -> String {
    let text = format!("{v:.2}");
    let short = text.trim_end_matches('0').trim_end_matches('.');
    if short == "-0" { "0".into() } else { short.to_owned() }
}

fn path_data(points: &[(f64, f64)]) -> String {
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
    fn lines_areas_dots_and_images_have_their_pixels() {
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
    fn text_is_centred_in_the_png_and_kept_as_text_in_the_svg() {
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
    fn equal_figures_have_equal_bytes_and_the_requested_size() {
        let make = || {
            let mut figure = Figure::new(Size::new(60, 80), Style::Dark);
            figure.text(label("λ = 550 nm", (40.0, 30.0)));
            figure
        };
        assert_eq!(make().to_svg(), make().to_svg());
        for (scale, expected) in
            [(1.0, Size::new(60, 80)), (2.0, Size::new(120, 160)), (1.5, Size::new(90, 120))]
        {
            let image = make().to_image(scale).unwrap();
            assert_eq!(image.size(), expected);
            assert_eq!(image, make().to_image(scale).unwrap());
        }
        assert!(make().to_image(0.0).is_err() && make().to_image(1e9).is_err());
    }
}
