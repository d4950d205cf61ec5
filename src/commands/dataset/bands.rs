//! Bands of charts and films, and their colours.
//!
//! `colours = "bands"`: a picture's linear red, green and blue are the bands at three wavelengths, and a film's bands are its red, green and blue.
//! `colours = "spectra"`: a picture's colours are spectra of reflected D65, as `lenscube chart image` makes them, and a film's colours those that the
//! CIE 1931 observer sees. Films of cubes have the latter.

use crate::failure::usage;
use anyhow::Result;
use formats::dataset::recipe::Colours;
use pipeline::colour::{Illuminant, srgb_weights};
use pipeline::reflectance::primaries;

/// Wavelengths of red, green and blue without `wavelengths_nm`: near the dominant wavelengths of the primaries of sRGB.
const RGB_NM: [f64; 3] = [610.0, 550.0, 465.0];
/// Bands of spectra without `wavelengths_nm`.
const SPECTRA_NM: &str = "400:700:10";
/// Error of colours that is admitted, of white.
const MAX_COLOUR_ERROR: f64 = 0.02;
/// Relative power of the illuminant that is 1.
const POWER: f64 = 0.01;

/// The bands of a data set.
#[derive(Clone, Debug)]
pub struct Bands {
    wavelengths_nm: Vec<f64>,
    /// Factors of red, green and blue in each band.
    of_rgb: Vec<[f32; 3]>,
    /// Weights of the bands in red, green and blue.
    to_rgb: Vec<[f32; 3]>,
    /// Whether bands are colours.
    are_colours: bool,
}

impl Bands {
    /// The bands at `wavelengths_nm` (of a cube, or of the recipe), ascending; `of_cubes`: pictures are none.
    ///
    /// # Errors
    /// Usage: wavelengths that are not ascending, or not three of colours; bands that cannot represent colours.
    pub fn new(wavelengths_nm: Option<&[f64]>, colours: Colours, of_cubes: bool) -> Result<Self> {
        if colours == Colours::Bands && !of_cubes {
            let nm = wavelengths_nm.unwrap_or(&RGB_NM);
            let [red, green, blue] = nm else {
                return Err(usage(format!(
                    "pictures.wavelengths_nm: with colours = \"bands\" expected those of red, green and blue, found {} numbers; \
                     colours = \"spectra\" has any number",
                    nm.len()
                )));
            };
            let mut order = [(*red, 0), (*green, 1), (*blue, 2)];
            order.sort_by(|a, b| a.0.total_cmp(&b.0));
            let unit: Vec<[f32; 3]> =
                order.iter().map(|(_, k)| std::array::from_fn(|c| f32::from(u8::from(c == *k)))).collect();
            let wavelengths_nm: Vec<f64> = order.iter().map(|(nm, _)| *nm).collect();
            check_ascends(&wavelengths_nm)?;
            return Ok(Self { wavelengths_nm, of_rgb: unit.clone(), to_rgb: unit, are_colours: true });
        }
        let wavelengths_nm = match wavelengths_nm {
            Some(nm) => nm.to_vec(),
            None => pipeline::wavelengths::parse(SPECTRA_NM).expect("bands of its own"),
        };
        check_ascends(&wavelengths_nm)?;
        let light = Illuminant::D65;
        let power = |nm: f64| POWER * light.relative_power(nm);
        let of_rgb = match of_cubes {
            true => Vec::new(),
            false => {
                let found = primaries(&wavelengths_nm, light, MAX_COLOUR_ERROR)
                    .map_err(|e| usage(format!("pictures.wavelengths_nm: {e}")))?;
                let of = |(nm, rho): (&f64, [f64; 3])| rho.map(|r| (r * power(*nm)) as f32);
                wavelengths_nm.iter().zip(found.rho).map(of).collect()
            }
        };
        let to_rgb = srgb_weights(&wavelengths_nm, power).iter().map(|w| w.map(|v| v as f32)).collect();
        Ok(Self { wavelengths_nm, of_rgb, to_rgb, are_colours: false })
    }

    /// Wavelengths, nm, ascending.
    pub fn wavelengths_nm(&self) -> &[f64] {
        &self.wavelengths_nm
    }

    /// Whether pictures have red, green and blue; else they are cubes.
    pub fn are_of_colours(&self) -> bool {
        !self.of_rgb.is_empty()
    }

    /// Whether red, green and blue are bands.
    pub fn are_colours(&self) -> bool {
        self.are_colours
    }

    /// Index of the band of red, green or blue.
    pub fn of_colour(&self, colour: usize) -> usize {
        self.of_rgb.iter().position(|factors| factors[colour] == 1.0).unwrap_or_default()
    }

    /// Bands of linear `channels` (3, or 1 of grey) of `pixels` each, both one after the other.
    pub fn of_colours(&self, linear: &[f32], channels: usize, pixels: usize) -> Vec<f32> {
        let mut out = vec![0.0; self.of_rgb.len() * pixels];
        for (factors, to) in self.of_rgb.iter().zip(out.chunks_exact_mut(pixels)) {
            for (channel, factor) in factors.iter().enumerate() {
                // Grey is red, green and blue.
                let from = &linear[channel.min(channels - 1) * pixels..][..pixels];
                to.iter_mut().zip(from).for_each(|(to, v)| *to += factor * v.max(0.0));
            }
        }
        out
    }

    /// Linear red, green and blue, pixel by pixel, of bands of `pixels` each, over `white`.
    pub fn rgb(&self, bands: &[f32], pixels: usize, white: f64) -> Vec<f32> {
        let mut out = vec![0.0; 3 * pixels];
        let scale = (1.0 / white) as f32;
        for (weights, from) in self.to_rgb.iter().zip(bands.chunks_exact(pixels)) {
            for (to, v) in out.as_chunks_mut::<3>().0.iter_mut().zip(from) {
                to.iter_mut().zip(weights).for_each(|(to, w)| *to += scale * w * v);
            }
        }
        out
    }

    /// Index of the band next to green, whose places labels follow.
    pub fn of_labels(&self) -> usize {
        const GREEN_NM: f64 = 550.0;
        let off = |k: &usize| (self.wavelengths_nm[*k] - GREEN_NM).abs();
        (0..self.wavelengths_nm.len()).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or_default()
    }
}

fn check_ascends(nm: &[f64]) -> Result<()> {
    match nm.windows(2).find(|w| w[0] >= w[1]) {
        None if !nm.is_empty() => Ok(()),
        None => Err(usage("pictures.wavelengths_nm: expected one or more numbers, found none")),
        Some(pair) => Err(usage(format!(
            "pictures.wavelengths_nm: expected ascending numbers, each once, found {} after {}",
            pair[1], pair[0]
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_bands_at_their_wavelengths_and_back() {
        let bands = Bands::new(Some(&[650.0, 550.0, 450.0]), Colours::Bands, false).unwrap();
        assert_eq!(bands.wavelengths_nm(), [450.0, 550.0, 650.0]);
        let linear = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6];
        let cube = bands.of_colours(&linear, 3, 2);
        assert_eq!(cube, [0.5, 0.6, 0.3, 0.4, 0.1, 0.2]);
        assert_eq!(bands.rgb(&cube, 2, 1.0), [0.1, 0.3, 0.5, 0.2, 0.4, 0.6]);
        assert_eq!((bands.of_colour(0), bands.of_colour(2), bands.of_labels()), (2, 0, 1));
        assert_eq!(bands.of_colours(&[0.5], 1, 1), [0.5; 3]);
    }

    #[test]
    fn spectra_give_back_the_colours() {
        let bands = Bands::new(None, Colours::Spectra, false).unwrap();
        assert_eq!(bands.wavelengths_nm().len(), 31);
        for rgb in [[1.0, 1.0, 1.0], [0.8, 0.1, 0.2], [0.1, 0.2, 0.7]] {
            let found = bands.rgb(&bands.of_colours(&rgb, 3, 1), 1, 1.0);
            assert!(rgb.iter().zip(&found).all(|(a, b)| (a - b).abs() < 2e-4), "{rgb:?} {found:?}");
        }
    }

    #[test]
    fn bands_that_cannot_be_are_refused() {
        let error = |nm: &[f64], colours| Bands::new(Some(nm), colours, false).unwrap_err().to_string();
        assert!(error(&[500.0, 600.0], Colours::Bands).contains("those of red, green and blue, found 2"));
        assert!(error(&[500.0, 500.0, 600.0], Colours::Bands).contains("each once"));
        assert!(error(&[500.0, 600.0], Colours::Spectra).contains("cannot represent all sRGB colours"));
        assert!(error(&[600.0, 500.0], Colours::Spectra).contains("ascending"));
    }
}
