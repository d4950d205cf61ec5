//! Colours of figures: a light style for paper and a dark one for screens, both safe for colour-blind readers.
//!
//! Curves without order take the palette of Okabe & Ito (Color Universal Design, 2008) and a dash pattern or a marker
//! each, so that they are told apart in grey too. Ordered ones (wavelengths) take part of the *inferno* scale (van der
//! Walt & Smith, 2015), whose lightness rises steadily; PSF images take all of it.

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

/// What is drawn in which colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Colour {
    /// Text, frames and what is drawn in black on paper.
    Ink,
    /// Annotations and outlines.
    Muted,
    /// Grid lines.
    Grid,
    /// The background.
    Paper,
    /// Lens elements.
    Glass,
    /// A colour of the palette, counted around.
    Palette(usize),
    /// A place 0..1 on the scale of ordered curves.
    Scale(f64),
    /// A colour of its own.
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
/// Colours of the palette.
pub const PALETTE: usize = LIGHT.len();

impl Style {
    /// The value of a colour.
    pub fn rgb(self, colour: Colour) -> Rgb {
        let dark = self == Self::Dark;
        let of = |light: Rgb, on_dark: Rgb| if dark { on_dark } else { light };
        match colour {
            Colour::Ink => of([17; 3], [232; 3]),
            Colour::Muted => of([96; 3], [160; 3]),
            Colour::Grid => of([224; 3], [58; 3]),
            Colour::Paper => of([255; 3], [24, 26, 29]),
            Colour::Glass => of([222, 235, 247], [44, 62, 80]),
            Colour::Rgb(rgb) => rgb,
            Colour::Palette(i) => (if dark { DARK } else { LIGHT })[i % PALETTE],
            // The ends that would vanish in the paper are left out.
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

/// A wavelength's own colour as the eye sees it, dark enough to read on white.
pub fn wavelength_colour(nm: f64) -> Rgb {
    // Beyond what the eye sees well hues stay as at its ends; from 640 nm up, where all are one red, they darken.
    let rgb = colour::xyz_to_linear_srgb(colour::observer(nm.clamp(410.0, 680.0))).map(|v| v.max(0.0));
    let most = rgb.iter().fold(1e-12, |a: f64, &b| a.max(b));
    let luminance = (0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]) / most;
    // Contrast of at least 4.5 against white asks for luminance up to 0.18.
    let scale = (0.18 / luminance).min(1.0) / most * (1.0 - (nm - 640.0) / 80.0).clamp(0.25, 1.0);
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
    fn curves_stand_out_from_the_paper() {
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
    fn the_scale_of_ordered_curves_rises_in_lightness() {
        for style in [Style::Light, Style::Dark] {
            let of = |i: i32| luminance(style.rgb(Colour::Scale(f64::from(i) / 30.0)));
            assert!((0..30).all(|i| of(i + 1) > of(i)));
        }
        assert_eq!(inferno(f64::NAN), inferno(0.0));
    }
}
