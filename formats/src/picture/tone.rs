//! How linear values become display bytes: for pictures that are shown piece by piece, each with the same settings.
//!
//!   shown = sRGB(e·v·L^(1/γ − 1)),   L = luminance of e·v, clipped at 1;   e exposure, γ gamma
//! At γ = 1 this is what [`super::preview`] shows. A larger γ lifts the dark parts: luminance L becomes L^(1/γ), and the
//! ratios between red, green and blue stay. White (1) and black stay where they are.

use super::chequer;
use super::image::Rgb;
use super::preview::{display, luminance};

/// How values become bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tone {
    /// Factor on the values; 1 is white.
    pub exposure: f64,
    /// Gamma; 1 shows light as it is.
    pub gamma: f64,
}

impl Tone {
    /// A pixel at (`y`, `x`) of a picture, from linear red, green and blue; missing ones show as a chequer.
    pub fn colour(&self, rgb: [f32; 3], (y, x): (usize, usize)) -> Rgb {
        if rgb.iter().any(|v| !v.is_finite()) {
            return [(255.0 * chequer(y, x)).round() as u8; 3];
        }
        let rgb = rgb.map(|v| f64::from(v) * self.exposure);
        let l = luminance(rgb);
        if self.gamma == 1.0 || l <= 0.0 {
            return display(rgb);
        }
        let lift = l.min(1.0).powf(1.0 / self.gamma - 1.0);
        display(rgb.map(|v| v * lift))
    }

    /// The same of a grey value.
    pub fn grey(&self, value: f32, at: (usize, usize)) -> Rgb {
        self.colour([value; 3], at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gamma_lifts_the_dark_and_leaves_the_ends() {
        let tone = |gamma| Tone { exposure: 2.0, gamma };
        for gamma in [0.5, 1.0, 2.2] {
            assert_eq!(tone(gamma).grey(0.5, (0, 0)), [255; 3]);
            assert_eq!(tone(gamma).grey(0.0, (0, 0)), [0; 3]);
        }
        // 0.25² = 0.0625 as light is 0.25 at gamma 2.
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
}
