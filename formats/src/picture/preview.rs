//! What an eye would see of a stack of bands: an 8-bit sRGB picture of any chart or film.
//!
//!   (R, G, B) = exposure · Σ_b w_b·L_b,   w_b from the CIE 1931 2° observer ([`pipeline::colour::srgb_weights`])
//! Values are first averaged over area, then turned to colour: both are linear, so the order does not matter.
//! The white is a light's: a surface that reflects all of it shows neutral, and at exposure 1 a spectrum of the light's
//! shape that is 1 at 560 nm shows as exactly white. [`White::Auto`] takes the white from the picture: the mean colour
//! of those of its lit pixels that are at least half as bright as the exposure's white.
//!
//! Out of gamut: a colour that sRGB cannot show is mixed with grey of its own luminance until it can be: luminance
//! and (nearly) hue stay, saturation gives way. Luminance beyond white is white, below zero black.
//! Left out: tone curves, veiling glare, colour appearance in dim light.

use std::collections::VecDeque;
use std::path::Path;

use pipeline::colour::{self, Illuminant};

use super::average::{Grid, stream};
use super::exposure::{Exposure, Levels};
use super::image::{Image, Rgb};
use super::{ChartSource, PictureError, Progress, Shown, View, chequer};

/// Luminance of linear sRGB (IEC 61966-2-1; the primaries of ITU-R BT.709 with D65).
const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

/// What shows as neutral.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum White {
    /// This light.
    Illuminant(Illuminant),
    /// The brightest part of the picture.
    Auto,
}

impl Default for White {
    fn default() -> Self {
        Self::Illuminant(Illuminant::D65)
    }
}

impl std::str::FromStr for White {
    type Err = String;

    /// Reads `D65`, `A`, `E` (or `equal-energy`), or `auto` for [`White::Auto`].
    fn from_str(word: &str) -> Result<Self, String> {
        match word.trim().to_ascii_lowercase().as_str() {
            "auto" => Ok(Self::Auto),
            "equal-energy" => Ok(Self::Illuminant(Illuminant::E)),
            other => other
                .parse()
                .map(Self::Illuminant)
                .map_err(|_| format!("'{word}' is no white known here; take D65, A, equal-energy or auto")),
        }
    }
}

/// How a stack of bands is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PreviewOptions {
    /// What, how large, by how many threads.
    pub view: View,
    /// What shows as neutral.
    pub white: White,
    /// What shows as bright as white.
    pub exposure: Exposure,
}

/// Makes the picture in memory.
///
/// # Errors
/// If the source cannot be read, its bands show nothing to an eye, or a setting cannot be met.
pub fn preview(
    source: &dyn ChartSource,
    bands_nm: &[f64],
    options: &PreviewOptions,
    progress: Progress<'_>,
) -> Result<(Image, Shown), PictureError> {
    if let Some(problem) = options.exposure.problem() {
        return Err(PictureError::Setting { setting: "exposure", problem });
    }
    let seen = Seen::new(bands_nm, options.white)?;
    let grid = Grid::new(source.size(), &options.view)?;
    let mut linear = Vec::with_capacity(grid.out.pixels());
    let missing_samples = seen.rows(source, &grid, options.view.threads, progress, &mut |_, row| {
        linear.extend_from_slice(row);
        Ok(())
    })?;
    let factor = |pixels: &[[f32; 3]]| {
        let mut levels = Levels::default();
        pixels.iter().for_each(|p| levels.add(luminance(p.map(f64::from)) as f32));
        options.exposure.factor(&levels)
    };
    let mut exposure = factor(&linear);
    if options.white == White::Auto {
        adapt(&mut linear, exposure);
        exposure = factor(&linear);
    }
    let mut image = Image::new(grid.out, [0; 3]);
    let mut missing_pixels = 0;
    for y in 0..grid.out.height {
        let colours = &linear[y * grid.out.width..][..grid.out.width];
        for (x, (pixel, rgb)) in image.row_mut(y).iter_mut().zip(colours).enumerate() {
            *pixel = if rgb.iter().all(|v| v.is_finite()) {
                display(rgb.map(|v| f64::from(v) * exposure))
            } else {
                missing_pixels += 1;
                [(255.0 * chequer(y, x)).round() as u8; 3]
            };
        }
    }
    Ok((image, Shown { size: grid.out, exposure, missing_samples, missing_pixels }))
}

/// Makes the picture and writes it as PNG.
///
/// # Errors
/// As [`preview`], and if the file cannot be written.
pub fn write_preview(
    path: &Path,
    source: &dyn ChartSource,
    bands_nm: &[f64],
    options: &PreviewOptions,
    progress: Progress<'_>,
) -> Result<Shown, PictureError> {
    let (image, shown) = preview(source, bands_nm, options, progress)?;
    let white = match options.white {
        White::Illuminant(light) => light.name(),
        White::Auto => "from the picture",
    };
    let comment = format!("lenscube preview, CIE 1931 2 deg, white {white}, exposure {}", shown.exposure);
    image.write_png(path, &comment)?;
    Ok(shown)
}

/// Takes a row of the picture in linear sRGB, and its number.
type TakeRow<'a> = dyn FnMut(usize, &[[f32; 3]]) -> Result<(), PictureError> + Send + 'a;

/// The bands that an eye sees, and what each adds to linear sRGB.
pub(super) struct Seen {
    bands: Vec<usize>,
    weights: Vec<[f32; 3]>,
}

impl Seen {
    pub(super) fn new(bands_nm: &[f64], white: White) -> Result<Self, PictureError> {
        let light = match white {
            White::Illuminant(light) => light,
            White::Auto => Illuminant::D65,
        };
        let weights = colour::srgb_weights(bands_nm, |nm| light.relative_power(nm) / 100.0);
        if weights.iter().flatten().all(|&w| w == 0.0) {
            return Err(PictureError::Invisible { bands_nm: bands_nm.to_vec(), white: light.name() });
        }
        // A band that adds less than 1e-12 of the white cannot be seen, but would be read, and might be missing.
        let bands: Vec<usize> =
            (0..weights.len()).filter(|&b| weights[b].iter().any(|w| w.abs() > 1e-12)).collect();
        let weights = bands.iter().map(|&b| weights[b].map(|w| w as f32)).collect();
        Ok(Self { bands, weights })
    }

    /// Reads the source once and hands on the picture's rows, top to bottom, in linear sRGB; the number of missing samples.
    pub(super) fn rows(
        &self,
        source: &dyn ChartSource,
        grid: &Grid,
        threads: usize,
        progress: Progress<'_>,
        each: &mut TakeRow<'_>,
    ) -> Result<u64, PictureError> {
        let last = self.bands.len() - 1;
        // Rows that lack bands still: a strip's.
        let mut open: VecDeque<Vec<[f32; 3]>> = VecDeque::new();
        let mut first = 0;
        stream(source, &self.bands, grid, threads, progress, &mut |position, y, means| {
            while open.len() <= y - first {
                open.push_back(vec![[0.0; 3]; grid.out.width]);
            }
            let w = self.weights[position];
            // NaN stays NaN in the sum: a pixel missing in one band is missing.
            open[y - first].iter_mut().zip(means).for_each(|(p, &v)| (0..3).for_each(|c| p[c] += w[c] * v));
            if position == last
                && let Some(row) = open.pop_front()
            {
                first += 1;
                each(y, &row)?;
            }
            Ok(())
        })
    }
}

pub(super) fn luminance(rgb: [f64; 3]) -> f64 {
    (0..3).map(|c| LUMINANCE[c] * rgb[c]).sum()
}

/// Makes the mean of the bright pixels neutral, at its own luminance, by the Bradford transform.
fn adapt(linear: &mut [[f32; 3]], exposure: f64) {
    let mut sum = [0f64; 3];
    for p in linear.iter().map(|p| p.map(f64::from)) {
        if luminance(p) * exposure >= 0.5 {
            (0..3).for_each(|c| sum[c] += p[c]);
        }
    }
    let to_xyz = srgb_to_xyz();
    let white = times(&to_xyz, sum.map(|v| v / luminance(sum)));
    if !white.iter().all(|v| v.is_finite() && *v > 0.0) {
        return;
    }
    let matrix = colour::adaptation(white, Illuminant::D65.white());
    for p in linear {
        let xyz = times(&matrix, times(&to_xyz, p.map(f64::from)));
        *p = colour::xyz_to_linear_srgb(xyz).map(|v| v as f32);
    }
}

/// Linear sRGB to XYZ (IEC 61966-2-1), inverse of [`colour::xyz_to_linear_srgb`] to 1e-4.
fn srgb_to_xyz() -> [[f64; 3]; 3] {
    [
        [0.412_390_8, 0.357_584_3, 0.180_480_8],
        [0.212_639_0, 0.715_168_7, 0.072_192_3],
        [0.019_330_8, 0.119_194_8, 0.950_532_2],
    ]
}

fn times(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// A linear colour as display bytes, brought into the gamut.
pub(super) fn display(rgb: [f64; 3]) -> Rgb {
    encoded(rgb).map(|v| (255.0 * v).round() as u8)
}

/// A linear colour as sRGB-encoded values 0 to 1, brought into the gamut.
pub(super) fn encoded(rgb: [f64; 3]) -> [f64; 3] {
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
    fn colours_out_of_gamut_keep_their_luminance() {
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

    #[test]
    fn whites_are_read_from_words() {
        assert_eq!("d65".parse(), Ok(White::default()));
        assert_eq!("equal-energy".parse(), Ok(White::Illuminant(Illuminant::E)));
        assert_eq!("auto".parse(), Ok(White::Auto));
        assert!("D50".parse::<White>().unwrap_err().contains("D65"));
    }
}
