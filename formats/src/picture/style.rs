//! Colours of figures: a light style for paper and a dark one for screens, both safe for colour-blind readers.
//!
//! Curves without an order have colours of the palette of Okabe & Ito (Color Universal Design, 2008) and a dash pattern
//! or a marker each, so that they are distinguishable in grey too. Ordered ones (wavelengths) use a part of the *inferno*
//! scale (van der Walt & Smith, 2015), whose lightness rises steadily; PSF images use all of it.

use pipeline::colour;

/// A colour, sRGB-encoded.
pub type Rgb = [u8; 3];

/// Colours of a figure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Style {
    /// Black on white.
    #[default]
    Light,
    /// Light on dark grey.
    Dark,
}

/// A colour by its role in a figure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Colour {
    /// Text and frames.
    Ink,
    /// Annotations and outlines.
    Muted,
    /// Grid lines.
    Grid,
    /// The background.
    Paper,
    /// Lens elements.
    Glass,
    /// A colour of the palette, modulo [`PALETTE`].
    Palette(usize),
    /// A position 0..1 on the scale of ordered curves.
    Scale(f64),
    /// A given colour.
    Rgb(Rgb),
}

/// Okabe & Ito's colours without yellow, in the order of the spectrum.
const LIGHT: [Rgb; 7] =
    [[0, 114, 178], [86, 180, 233], [0, 158, 115], [230, 159, 0], [213, 94, 0], [204, 121, 167], [0, 0, 0]];
/// The same, blue and vermilion lightened, yellow in place of black.
const DARK: [Rgb; 7] = [
    [64, 140, 224],
    [120, 200, 245],
    [0, 178, 130],
    [240, 170, 20],
    [236, 112, 32],
    [214, 140, 180],
    [240, 228, 66],
];
/// Number of colours of the palette.
pub const PALETTE: usize = LIGHT.len();

impl Style {
    /// The sRGB value of a colour.
    pub fn rgb(self, colour: Colour) -> Rgb {
        let dark = self == Self::Dark;
        let choose = |light: Rgb, on_dark: Rgb| if dark { on_dark } else { light };
        match colour {
            Colour::Ink => choose([17; 3], [232; 3]),
            Colour::Muted => choose([96; 3], [160; 3]),
            Colour::Grid => choose([224; 3], [58; 3]),
            Colour::Paper => choose([255; 3], [24, 26, 29]),
            Colour::Glass => choose([222, 235, 247], [44, 62, 80]),
            Colour::Rgb(rgb) => rgb,
            Colour::Palette(i) => (if dark { DARK } else { LIGHT })[i % PALETTE],
            // Without the end that has too little contrast to the paper.
            Colour::Scale(t) => inferno(if dark { 0.38 + 0.57 * t } else { 0.12 + 0.66 * t }),
        }
    }
}

/// A colour as SVG writes it.
pub fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// The *inferno* scale, black to light yellow over 0..1.
pub fn inferno(t: f64) -> Rgb {
    let colour = colorous::INFERNO.eval_continuous(if t.is_finite() { t.clamp(0.0, 1.0) } else { 0.0 });
    [colour.r, colour.g, colour.b]
}

/// Colour of monochromatic light, dark enough to be readable on white.
pub fn wavelength_colour(nm: f64) -> Rgb {
    // Constant hue beyond 410 to 680 nm; from 640 nm up, where the hue hardly changes, wavelengths darken.
    let rgb = colour::xyz_to_linear_srgb(colour::observer(nm.clamp(410.0, 680.0))).map(|v| v.max(0.0));
    let brightest = rgb.iter().fold(1e-12, |a: f64, &b| a.max(b));
    let luminance = (0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]) / brightest;
    // A contrast of at least 4.5 against white needs a luminance of at most 0.18.
    let scale = (0.18 / luminance).min(1.0) / brightest * (1.0 - (nm - 640.0) / 80.0).clamp(0.25, 1.0);
    rgb.map(|v| (255.0 * colour::srgb_encode(v * scale)).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn luminance(rgb: Rgb) -> f64 {
        let [r, g, b] = rgb.map(|v| colour::srgb_decode(f64::from(v) / 255.0));
        0.2126 * r + 0.7152 * g + 0.0722 * b
    }

    #[test]
    fn curves_and_text_have_contrast_to_the_paper() {
        for style in [Style::Light, Style::Dark] {
            let paper = luminance(style.rgb(Colour::Paper));
            let drawn = (0..PALETTE).map(Colour::Palette).chain([0.0, 0.5, 1.0].map(Colour::Scale));
            for colour in drawn.chain([Colour::Ink, Colour::Muted]) {
                let (a, b) = (luminance(style.rgb(colour)), paper);
                let contrast = (a.max(b) + 0.05) / (a.min(b) + 0.05);
                assert!(contrast >= 1.9, "{style:?} {colour:?}: {contrast}");
            }
        }
    }

    #[test]
    fn scale_of_ordered_curves_rises_in_luminance() {
        for style in [Style::Light, Style::Dark] {
            let at = |i: i32| luminance(style.rgb(Colour::Scale(f64::from(i) / 30.0)));
            assert!((0..30).all(|i| at(i + 1) > at(i)));
        }
        assert_eq!(inferno(f64::NAN), inferno(0.0));
    }
}
