//! Font of figures: an embedded subset of Inter (Regular 4.1, SIL Open Font License, `font/LICENSE-Inter.txt`).
//!
//! No font of the machine is used: an SVG embeds this one, a PNG is drawn with its outlines, and both place letters by
//! its advance widths (px, no kerning: the subset has none). It has Latin, Greek, Cyrillic, mathematical signs, sub- and
//! superscript digits; digits have equal widths. Other characters are drawn as an empty box in PNG files; an SVG viewer
//! takes them from its own fonts.

use std::fmt::Write;
use std::sync::LazyLock;

use base64::Engine;
use ttf_parser::{Face, GlyphId, OutlineBuilder};

const FONT: &[u8] = include_bytes!("font/Inter-subset.ttf");
/// The embedded font, then fallbacks for SVG editors that ignore embedded fonts.
pub(super) const FAMILY: &str = "Inter, 'DejaVu Sans', Helvetica, Arial, sans-serif";
/// Height of capitals and digits over the font size.
pub(super) const CAP_HEIGHT: f64 = 0.727;

static FACE: LazyLock<Face<'static>> =
    LazyLock::new(|| Face::parse(FONT, 0).expect("the embedded font is valid"));

/// A CSS rule with the font.
pub fn font_css() -> String {
    let data = base64::engine::general_purpose::STANDARD.encode(FONT);
    format!("@font-face{{font-family:Inter;src:url(data:font/ttf;base64,{data})}}")
}

fn glyph(letter: char) -> GlyphId {
    FACE.glyph_index(letter).unwrap_or_default()
}

fn advance(letter: char) -> f64 {
    f64::from(FACE.glyph_hor_advance(glyph(letter)).unwrap_or_default()) / f64::from(FACE.units_per_em())
}

/// Width of a line of text at a font size, px.
pub(super) fn width(text: &str, size: f64) -> f64 {
    size * text.chars().map(advance).sum::<f64>()
}

/// The text, cut to `max_width` px with an ellipsis.
pub(super) fn fit(text: &str, size: f64, max_width: f64) -> String {
    if width(text, size) <= max_width {
        return text.to_owned();
    }
    let mut left = max_width - width("…", size);
    let kept = text.chars().take_while(|&c| {
        left -= size * advance(c);
        left >= 0.0
    });
    kept.collect::<String>().trim_end().to_owned() + "…"
}

/// Outlines of a line of text as SVG path data, its baseline from (x, y) to the right.
pub(super) fn outlines(text: &str, size: f64, (x, y): (f64, f64)) -> String {
    let mut path = Path { data: String::new(), scale: size / f64::from(FACE.units_per_em()), x, y };
    for letter in text.chars() {
        FACE.outline_glyph(glyph(letter), &mut path);
        path.x += size * advance(letter);
    }
    path.data
}

struct Path {
    data: String,
    scale: f64,
    x: f64,
    y: f64,
}

impl Path {
    fn add<const N: usize>(&mut self, command: char, points: [(f32, f32); N]) {
        self.data.push(command);
        for (x, y) in points {
            let (x, y) = (self.x + self.scale * f64::from(x), self.y - self.scale * f64::from(y));
            // Writing to a String cannot fail.
            let _ = write!(self.data, "{x:.3} {y:.3} ");
        }
    }
}

impl OutlineBuilder for Path {
    fn move_to(&mut self, x: f32, y: f32) {
        self.add('M', [(x, y)]);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.add('L', [(x, y)]);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.add('Q', [(x1, y1), (x, y)]);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        self.add('C', [(x1, y1), (x2, y2), (x, y)]);
    }

    fn close(&mut self) {
        self.data.push('Z');
    }
}

/// Text for XML and HTML: markup escaped, line ends as spaces, characters outside XML replaced.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\t' | '\n' | '\r' => out.push(' '),
            '\0'..='\x1f' | '\u{fffe}' | '\u{ffff}' => out.push('\u{fffd}'),
            other => out.push(other),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn font_has_the_letters_and_signs_of_optics() {
        for letter in "λθµ°ΔΩ₀₁₅₀⁻⁶×−′″≤≥≈∞·…–ш".chars() {
            assert!(FACE.glyph_index(letter).is_some(), "{letter}");
        }
        assert_eq!(width("0123456789", 10.0), 10.0 * width("1", 10.0));
        assert!(
            (FACE.capital_height().unwrap() as f64 / f64::from(FACE.units_per_em()) - CAP_HEIGHT).abs()
                < 1e-3
        );
    }

    #[test]
    fn long_text_is_cut_to_the_maximum_width() {
        let long = "a name that is far too long";
        let short = fit(long, 15.0, 80.0);
        assert!(short.ends_with('…') && width(&short, 15.0) <= 80.0 && width(&short, 15.0) > 60.0, "{short}");
        assert_eq!(fit(long, 15.0, 500.0), long);
        assert_eq!(fit(long, 15.0, -1.0), "…");
    }

    #[test]
    fn markup_and_control_characters_are_escaped() {
        assert_eq!(escape("a<b & \"c\"\n\u{1}"), "a&lt;b &amp; &quot;c&quot; \u{fffd}");
    }
}
