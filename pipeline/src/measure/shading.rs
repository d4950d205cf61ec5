//! Shading of light and colour of a uniform area (after ISO 17957).
//!
//! The picture is divided into n × n equal parts. Of each, with the means (R, G, B) of its pixels, linear in light,
//! ```text
//! relative illumination = Y / Y_centre,     ΔC = √(Δa*² + Δb*²) against the centre,     ratios (R/G) / (R/G)_centre, (B/G) / (B/G)_centre
//! ```
//! Y = 0.2126 R + 0.7152 G + 0.0722 B. For ΔC the colours are scaled to the luminance of the centre, which is L* = 100 of a neutral: colour alone, not the fall of light. n is odd, so that the centre is a part.

use crate::colour::{Illuminant, lab, linear_srgb_to_xyz};
use crate::real;

/// Luminance of linear sRGB.
pub const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// Shading of a part of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Y over that of the centre.
    pub relative_illumination: f64,
    /// R/G and B/G over those of the centre; `None` of grey pictures.
    pub ratios: Option<[f64; 2]>,
    /// Difference of colour from the centre; `None` of grey pictures.
    pub delta_c: Option<f64>,
}

/// Shading of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Shading {
    /// Parts along a side.
    pub along: usize,
    /// Row by row.
    pub parts: Vec<Part>,
}

impl Shading {
    /// Of the means of `along`² parts, row by row, of one or three channels. `None` if the centre is dark.
    pub fn of_means(along: usize, means: &[Vec<f64>]) -> Option<Self> {
        assert!(along % 2 == 1 && means.len() == along * along, "{along} x {along} parts");
        let luminance = |v: &[f64]| match v {
            [r, g, b] => LUMINANCE[0] * r + LUMINANCE[1] * g + LUMINANCE[2] * b,
            grey => grey[0],
        };
        let centre = &means[means.len() / 2];
        let light = luminance(centre);
        if light.is_nan() || light <= 0.0 || centre.iter().any(|v| v.is_nan() || *v <= 0.0) {
            return None;
        }
        let lab_of = |v: &[f64]| {
            // Balanced to the centre, so that it is neutral, and as bright.
            let balanced = [0, 1, 2].map(|i| v[i] / centre[i]);
            let y = luminance(&balanced);
            lab(linear_srgb_to_xyz(balanced.map(|v| v / y)), Illuminant::D65.white())
        };
        let part = |v: &Vec<f64>| {
            let is_colour = v.len() == 3;
            Part {
                relative_illumination: luminance(v) / light,
                ratios: is_colour.then(|| [0, 2].map(|i| v[i] / v[1] / (centre[i] / centre[1]))),
                delta_c: is_colour.then(|| {
                    let [_, a, b] = lab_of(v);
                    real::hypot(a, b)
                }),
            }
        };
        Some(Self { along, parts: means.iter().map(part).collect() })
    }

    /// Mean of the four corner parts over the centre.
    pub fn corners(&self) -> f64 {
        let (n, last) = (self.along, self.parts.len() - 1);
        let corners = [0, n - 1, last + 1 - n, last];
        corners.iter().map(|k| self.parts[*k].relative_illumination).sum::<f64>() / 4.0
    }

    /// Largest ΔC.
    pub fn max_delta_c(&self) -> Option<f64> {
        self.parts.iter().map(|p| p.delta_c).try_fold(0.0, |m: f64, v| Some(m.max(v?)))
    }

    /// Largest |ratio − 1| of R/G and of B/G.
    pub fn max_ratios(&self) -> Option<[f64; 2]> {
        let all = self.parts.iter().map(|p| p.ratios);
        all.into_iter().try_fold([0.0; 2], |m: [f64; 2], ratios| {
            let ratios = ratios?;
            Some([0, 1].map(|i| m[i].max((ratios[i] - 1.0).abs())))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_shading_is_measured() {
        // 1 − 0.3 r² with red that falls by 5 % more; r = 1 in the middles of the corner parts.
        let along = 9;
        let means: Vec<Vec<f64>> = (0..along * along)
            .map(|k| {
                let (y, x) = ((k / along) as f64 / 4.0 - 1.0, (k % along) as f64 / 4.0 - 1.0);
                let r2 = (y * y + x * x) / 2.0;
                let light = 0.4 * (1.0 - 0.3 * r2);
                vec![light * (1.0 - 0.05 * r2) * 0.5, light, light * 0.7]
            })
            .collect();
        let shading = Shading::of_means(along, &means).unwrap();
        let [red, blue] = shading.max_ratios().unwrap();
        assert!((red - 0.05).abs() < 1e-12 && blue < 1e-12, "{red} {blue}");
        let y = |r2: f64| {
            (1.0 - 0.3 * r2) * (LUMINANCE[0] * 0.5 * (1.0 - 0.05 * r2) + LUMINANCE[1] + LUMINANCE[2] * 0.7)
        };
        assert!((shading.corners() - y(1.0) / y(0.0)).abs() < 1e-12, "{}", shading.corners());
        assert!(
            shading.parts[along * along / 2].delta_c.unwrap() < 0.02,
            "the white of sRGB has four digits"
        );
        let worst = shading.max_delta_c().unwrap();
        assert!(worst > 1.0 && worst < 3.0, "{worst}");
        assert_eq!(shading.parts[0].delta_c, Some(worst));
    }

    #[test]
    fn grey_pictures_have_no_colour_and_dark_ones_no_shading() {
        let means: Vec<Vec<f64>> = (0..9).map(|k| vec![1.0 + f64::from(k)]).collect();
        let shading = Shading::of_means(3, &means).unwrap();
        assert_eq!((shading.max_delta_c(), shading.max_ratios()), (None, None));
        assert!((shading.corners() - 1.0).abs() < 1e-12);
        assert_eq!(Shading::of_means(3, &vec![vec![0.0]; 9]), None);
    }
}
