//! Linear colour to display bytes, with one exposure and gamma for all parts of a picture.
//!
//!   displayed = sRGB(v·L^(1/γ − 1)),   v = exposure · value,   L = luminance of v, clipped at 1;   γ gamma
//! γ = 1 changes nothing but the exposure. A larger γ brightens the shadows: luminance L becomes L^(1/γ), and the ratios
//! between red, green and blue stay. White (1) and black (0) stay.
//!
//! A colour outside the sRGB gamut is mixed with grey of its own luminance until it is inside: luminance and (nearly) hue
//! are kept, saturation is reduced. Luminance above white becomes white, below zero black.
//! A pixel with a NaN or infinite component is missing and shows as a chequer of 8 × 8 px squares.

use pipeline::colour;

use super::style::Rgb;

/// Luminance of linear sRGB (IEC 61966-2-1; the primaries of ITU-R BT.709 with D65).
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Conversion of linear values to display values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// Factor on the values; 1 is white.
    pub exposure: f64,
    /// Gamma; 1 keeps values proportional.
    pub gamma: f64,
}

impl Tone {
    /// The pixel at (`y`, `x`) of a picture, from linear red, green and blue.
    pub fn colour(&self, rgb: [f32; 3], at: (usize, usize)) -> Rgb {
        self.encoded(rgb, at).map(|v| (255.0 * v).round() as u8)
    }

    /// The pixel at (`y`, `x`) of a picture, from a grey value.
    pub fn grey(&self, value: f32, at: (usize, usize)) -> Rgb {
        self.colour([value; 3], at)
    }

    /// As [`Tone::colour`]; sRGB-encoded values 0 to 1.
    pub(super) fn encoded(&self, rgb: [f32; 3], (y, x): (usize, usize)) -> [f64; 3] {
        if is_missing(&rgb) {
            return [chequer(y, x); 3];
        }
        let rgb = rgb.map(|v| f64::from(v) * self.exposure);
        let l = luminance(rgb);
        if self.gamma == 1.0 || l <= 0.0 {
            return encoded(rgb);
        }
        let lift = l.min(1.0).powf(1.0 / self.gamma - 1.0);
        encoded(rgb.map(|v| v * lift))
    }
}

/// Whether a colour has a component that is NaN or infinite.
pub(super) fn is_missing(rgb: &[f32; 3]) -> bool {
    rgb.iter().any(|v| !v.is_finite())
}

/// Display value 0 to 1 (sRGB-encoded) of missing pixels.
pub(super) fn chequer(y: usize, x: usize) -> f64 {
    if (y / 8 + x / 8).is_multiple_of(2) { 0.4 } else { 0.6 }
}

/// Luminance of a linear sRGB colour.
pub(super) fn luminance(rgb: [f64; 3]) -> f64 {
    (0..3).map(|c| LUMINANCE[c] * rgb[c]).sum()
}

/// A linear colour as sRGB-encoded values 0 to 1, brought into the gamut.
fn encoded(rgb: [f64; 3]) -> [f64; 3] {
    let grey = luminance(rgb).clamp(0.0, 1.0);
    // The largest share of the colour that leaves every channel in 0..1.
    let share = rgb.iter().fold(1f64, |share, &v| {
        let bound = if v > 1.0 { 1.0 - grey } else { grey };
        if (0.0..=1.0).contains(&v) { share } else { share.min(bound / (v - grey).abs()) }
    });
    rgb.map(|v| colour::srgb_encode(grey + share * (v - grey)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gamma_brightens_shadows_and_keeps_black_and_white() {
        let tone = |gamma| Tone { exposure: 2.0, gamma };
        for gamma in [0.5, 1.0, 2.2] {
            assert_eq!(tone(gamma).grey(0.5, (0, 0)), [255; 3]);
            assert_eq!(tone(gamma).grey(0.0, (0, 0)), [0; 3]);
        }
        // Linear 0.25² = 0.0625 is 0.25 at gamma 2.
        assert_eq!(tone(2.0).grey(0.03125, (0, 0)), tone(1.0).grey(0.125, (0, 0)));
        let [r, g, b] = tone(2.0).colour([0.2, 0.1, 0.05], (0, 0));
        assert!(r > g && g > b);
    }

    #[test]
    fn missing_pixels_show_as_a_chequer() {
        let tone = Tone { exposure: 1.0, gamma: 1.0 };
        assert_eq!(tone.grey(f32::NAN, (0, 0)), [102; 3]);
        assert_eq!(tone.colour([1.0, f32::INFINITY, 0.0], (0, 8)), [153; 3]);
    }

    #[test]
    fn out_of_gamut_colours_keep_luminance_and_channel_order() {
        let display = |rgb: [f64; 3]| encoded(rgb).map(|v| (255.0 * v).round() as u8);
        assert_eq!(display([1.0; 3]), [255; 3]);
        assert_eq!(display([0.0; 3]), [0; 3]);
        assert_eq!(display([-0.5, -0.2, 0.1]), [0; 3]);
        assert_eq!(display([3.0, 2.0, 0.5]), [255; 3]);
        for rgb in [[1.6, 0.1, 0.05], [-0.2, 0.4, 0.3], [0.2, -0.05, 1.4]] {
            let decoded = display(rgb).map(|v| {
                let v = f64::from(v) / 255.0;
                if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) }
            });
            assert!((luminance(decoded) - luminance(rgb)).abs() < 0.01, "{rgb:?} {decoded:?}");
            let order = |c: [f64; 3]| (c[0] > c[1], c[1] > c[2], c[0] > c[2]);
            assert_eq!(order(decoded), order(rgb));
        }
    }
}
