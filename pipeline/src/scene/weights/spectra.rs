//! Spectra of the bases in the bands of a run.

use super::{Basis, LightSpectrum, Reflectance, SceneIlluminant, SpectrumError};
use crate::reflectance::{Primaries, ReflectanceError, primaries_under};

/// Spectra that bands cannot have.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SpectraError {
    /// A named spectrum or the illuminant.
    #[error(transparent)]
    Spectrum(#[from] SpectrumError),
    /// Reflectances of colours.
    #[error(transparent)]
    Colours(#[from] ReflectanceError),
    /// No visible light.
    #[error("illuminant `{name}` has no power that is visible; an illuminance needs some from 380 to 780 nm")]
    Invisible {
        /// Name of the illuminant.
        name: String,
    },
}

/// Radiance of each basis for the weight 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectra {
    /// S_b(λ), (basis, band), W m⁻² sr⁻¹ nm⁻¹.
    pub radiance: Vec<Vec<f64>>,
    /// Error of the colours, of white, and the corner of the sRGB cube that has it; see [`Primaries`].
    pub colour_error: (f64, &'static str),
}

/// The spectra of `bases` at `wavelengths_nm` (in any order) in `light` of `illuminance_lx`. Colours may be in error by `max_colour_error` of white.
///
/// # Errors
/// [`SpectraError`] for wavelengths beyond the ends of a spectrum, bands that cannot represent the colours, an illuminant without visible power.
pub fn spectra(
    bases: &[Basis],
    wavelengths_nm: &[f64],
    light: &SceneIlluminant,
    illuminance_lx: f64,
    max_colour_error: f64,
) -> Result<Spectra, SpectraError> {
    let invisible = || SpectraError::Invisible { name: light.name().into() };
    let scale = light.irradiance_scale(illuminance_lx).ok_or_else(invisible)?;
    let power: Vec<f64> =
        wavelengths_nm.iter().map(|&nm| light.relative_power(nm)).collect::<Result<_, _>>()?;
    let colours = match bases.iter().any(uses_colours) {
        true => colours(wavelengths_nm, light, max_colour_error)?,
        false => Primaries { rho: vec![[0.0; 3]; wavelengths_nm.len()], corner: "red", error: 0.0 },
    };
    let value = |basis: &Basis, band: usize| -> Result<f64, SpectrumError> {
        let nm = wavelengths_nm[band];
        let white = scale * power[band] / std::f64::consts::PI;
        let rho = &colours.rho[band];
        let lit = match &basis.light {
            LightSpectrum::Illuminant => white,
            LightSpectrum::Colour(c) => (c[0] * rho[0] + c[1] * rho[1] + c[2] * rho[2]) * white,
        };
        Ok(lit
            * match &basis.reflectance {
                Reflectance::Red => rho[0],
                Reflectance::Green => rho[1],
                Reflectance::Blue => rho[2],
                Reflectance::Named(spectrum) => spectrum.at(nm)?,
            })
    };
    let of_basis = |basis| (0..wavelengths_nm.len()).map(|band| value(basis, band)).collect();
    let radiance = bases.iter().map(of_basis).collect::<Result<_, _>>()?;
    Ok(Spectra { radiance, colour_error: (colours.error, colours.corner) })
}

fn uses_colours(basis: &Basis) -> bool {
    matches!(basis.reflectance, Reflectance::Red | Reflectance::Green | Reflectance::Blue)
        || matches!(basis.light, LightSpectrum::Colour(_))
}

/// ρ_R, ρ_G and ρ_B of the bands under the light; a measured one counts as 0 beyond its ends.
fn colours(bands_nm: &[f64], light: &SceneIlluminant, max_error: f64) -> Result<Primaries, ReflectanceError> {
    let (name, most) = match light {
        SceneIlluminant::Cie(light) => (light.name(), 100.0),
        SceneIlluminant::Measured(s) => {
            ("the given illuminant", s.values().iter().copied().fold(0.0, f64::max))
        }
    };
    primaries_under(bands_nm, &|nm| light.relative_power(nm).unwrap_or(0.0) / most, name, max_error)
}
