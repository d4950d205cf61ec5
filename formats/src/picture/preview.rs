//! Colour picture of a stack of bands: 8-bit sRGB, of any chart or film.
//!
//!   (R, G, B) = exposure · Σ_b w_b·L_b,   w_b from the CIE 1931 2° observer ([`pipeline::colour::srgb_weights`])
//! Values are averaged over area before they are converted to colour; both are linear, so the order does not matter.
//! White is the colour of a light: a perfect reflector in it shows neutral, and at exposure 1 a spectrum of the light's
//! shape that is 1 at 560 nm shows as white. [`White::Auto`] takes white from the picture: the mean colour of its lit
//! pixels of at least half the luminance of the exposure's white. [`super::tone`] brings colours into the gamut.
//! Not modelled: tone curves, veiling glare, colour appearance in dim light.

use std::path::Path;

use pipeline::colour::{self, Illuminant};

use super::area::Grid;
use super::exposure::{Exposure, Levels};
use super::image::Image;
use super::spectral::VisibleBands;
use super::tone::{Tone, is_missing, luminance};
use super::{ChartSource, PictureError, PictureSummary, Progress, View};

/// Colour that shows as neutral.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum White {
    /// The colour of a light.
    Illuminant(Illuminant),
    /// The mean colour of the brightest part of the picture.
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
    fn from_str(name: &str) -> Result<Self, String> {
        match name.trim().to_ascii_lowercase().as_str() {
            "auto" => Ok(Self::Auto),
            "equal-energy" => Ok(Self::Illuminant(Illuminant::E)),
            other => other
                .parse()
                .map(Self::Illuminant)
                .map_err(|_| format!("white '{name}' is not supported: use D65, A, E or auto")),
        }
    }
}

/// Settings of a colour picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PreviewOptions {
    /// Region, size, threads.
    pub view: View,
    /// Colour that shows as neutral.
    pub white: White,
    /// Luminance that shows as white.
    pub exposure: Exposure,
}

/// The picture in memory.
///
/// # Errors
/// If the source cannot be read, none of its bands is visible, or a setting is invalid.
pub fn preview(
    source: &dyn ChartSource,
    bands_nm: &[f64],
    options: &PreviewOptions,
    progress: Progress<'_>,
) -> Result<(Image, PictureSummary), PictureError> {
    options.exposure.check()?;
    let light = match options.white {
        White::Illuminant(light) => light,
        White::Auto => Illuminant::D65,
    };
    let visible = VisibleBands::new(bands_nm, light)?;
    let grid = Grid::new(source.size(), &options.view)?;
    let mut linear = Vec::with_capacity(grid.out.pixels());
    let missing_samples =
        visible.stream_rows(source, &grid, options.view.threads, progress, &mut |_, row| {
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
        adapt_white(&mut linear, exposure);
        exposure = factor(&linear);
    }
    let tone = Tone { exposure, gamma: 1.0 };
    let mut image = Image::new(grid.out, [0; 3]);
    for y in 0..grid.out.height {
        let colours = &linear[y * grid.out.width..][..grid.out.width];
        for (x, (pixel, rgb)) in image.row_mut(y).iter_mut().zip(colours).enumerate() {
            *pixel = tone.colour(*rgb, (y, x));
        }
    }
    let missing_pixels = linear.iter().filter(|rgb| is_missing(rgb)).count() as u64;
    Ok((image, PictureSummary { size: grid.out, exposure, missing_samples, missing_pixels }))
}

/// Writes the picture as PNG.
///
/// # Errors
/// As [`preview`], and if the file cannot be written.
pub fn write_preview(
    path: &Path,
    source: &dyn ChartSource,
    bands_nm: &[f64],
    options: &PreviewOptions,
    progress: Progress<'_>,
) -> Result<PictureSummary, PictureError> {
    let (image, summary) = preview(source, bands_nm, options, progress)?;
    let white = match options.white {
        White::Illuminant(light) => light.name(),
        White::Auto => "from the picture",
    };
    let comment = format!("lenscube preview, CIE 1931 2 deg, white {white}, exposure {}", summary.exposure);
    image.write_png(path, &comment)?;
    Ok(summary)
}

/// Makes the mean of the bright pixels neutral, at its own luminance, by the Bradford transform.
fn adapt_white(linear: &mut [[f32; 3]], exposure: f64) {
    let mut sum = [0f64; 3];
    for p in linear.iter().map(|p| p.map(f64::from)) {
        if luminance(p) * exposure >= 0.5 {
            (0..3).for_each(|c| sum[c] += p[c]);
        }
    }
    let white = multiply(&SRGB_TO_XYZ, sum.map(|v| v / luminance(sum)));
    if !white.iter().all(|v| v.is_finite() && *v > 0.0) {
        return;
    }
    let matrix = colour::adaptation(white, Illuminant::D65.white());
    for p in linear {
        let xyz = multiply(&matrix, multiply(&SRGB_TO_XYZ, p.map(f64::from)));
        *p = colour::xyz_to_linear_srgb(xyz).map(|v| v as f32);
    }
}

/// Linear sRGB to XYZ (IEC 61966-2-1), inverse of [`colour::xyz_to_linear_srgb`] to 1e-4.
const SRGB_TO_XYZ: [[f64; 3]; 3] = [
    [0.412_390_8, 0.357_584_3, 0.180_480_8],
    [0.212_639_0, 0.715_168_7, 0.072_192_3],
    [0.019_330_8, 0.119_194_8, 0.950_532_2],
];

fn multiply(m: &[[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn white_names_are_parsed_and_others_are_errors() {
        assert_eq!("d65".parse(), Ok(White::default()));
        assert_eq!("equal-energy".parse(), Ok(White::Illuminant(Illuminant::E)));
        assert_eq!("auto".parse(), Ok(White::Auto));
        assert!("D50".parse::<White>().unwrap_err().contains("D65"));
    }
}
