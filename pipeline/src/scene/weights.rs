//! Weights and bases: what a place of a surface reflects or emits, in numbers that do not depend on wavelength.
//!
//! ```text
//! L(λ) = Σ_b w_b·S_b(λ),   b = (reflectance r, light l):   S_b(λ) = ρ_r(λ)·s_l(λ)/π
//! ```
//! The reflectances are ρ_R, ρ_G and ρ_B, of which [`crate::reflectance`] mixes every colour, linear in the colour, and then one for each named spectrum.
//! The lights are at first the illuminant, s = E, and then each further spectrum that lights the scene: s = (c_R ρ_R + c_G ρ_G + c_B ρ_B)·E for a coloured
//! light, white being the illuminant. E is the spectral irradiance that has the illuminance of the scene. A surface that the illuminant lights evenly,
//! without shading, has the weights w = its reflectances: L = ρ·E/π, as a generated chart.

mod spectra;

pub use spectra::{Spectra, SpectraError, spectra};

use crate::colour::{FIRST_NM, Illuminant, LAST_NM, LUMINOUS_EFFICACY, observer};

/// Number of reflectances of colours.
pub const COLOURS: usize = 3;
/// Step of the integral over the tables of the observer, nm.
const STEP_NM: usize = 5;

/// An unsuitable spectrum.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SpectrumError {
    /// Not as many values as wavelengths, or none.
    #[error(
        "spectrum `{name}` has {wavelengths} wavelengths and {values} values; expected one value for each, and at least one"
    )]
    Length {
        /// Its name.
        name: String,
        /// Wavelengths.
        wavelengths: usize,
        /// Values.
        values: usize,
    },
    /// Wavelengths that do not increase.
    #[error("spectrum `{name}`: the wavelength after {after_nm} nm is {found_nm} nm; they must increase")]
    Order {
        /// Its name.
        name: String,
        /// The one before.
        after_nm: f64,
        /// The one that is not greater, or NaN.
        found_nm: f64,
    },
    /// A value out of range.
    #[error("spectrum `{name}` is {found} at {nm} nm; expected 0 to {max}")]
    Value {
        /// Its name.
        name: String,
        /// Wavelength.
        nm: f64,
        /// The value.
        found: f64,
        /// Maximum.
        max: f64,
    },
    /// A wavelength beyond its ends.
    #[error("spectrum `{name}` ends at {first_nm} and {last_nm} nm and has no value at {nm} nm")]
    Range {
        /// Its name.
        name: String,
        /// First wavelength.
        first_nm: f64,
        /// Last wavelength.
        last_nm: f64,
        /// The one asked for.
        nm: f64,
    },
}

/// Values at increasing wavelengths, linear between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    name: String,
    wavelengths_nm: Vec<f64>,
    values: Vec<f64>,
}

impl Spectrum {
    /// A spectrum of values from 0 to `max`: 1 for a reflectance, infinity for a power.
    ///
    /// # Errors
    /// [`SpectrumError`] for other values, wavelengths that do not increase, or lists of different lengths.
    pub fn new(
        name: impl Into<String>,
        wavelengths_nm: Vec<f64>,
        values: Vec<f64>,
        max: f64,
    ) -> Result<Self, SpectrumError> {
        let name = name.into();
        if wavelengths_nm.is_empty() || wavelengths_nm.len() != values.len() {
            return Err(SpectrumError::Length {
                name,
                wavelengths: wavelengths_nm.len(),
                values: values.len(),
            });
        }
        let mut after_nm = 0.0;
        for (&nm, &found) in wavelengths_nm.iter().zip(&values) {
            if !(nm > after_nm && nm.is_finite()) {
                return Err(SpectrumError::Order { name, after_nm, found_nm: nm });
            }
            if !((0.0..=max).contains(&found) && found.is_finite()) {
                return Err(SpectrumError::Value { name, nm, found, max });
            }
            after_nm = nm;
        }
        Ok(Self { name, wavelengths_nm, values })
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its wavelengths in nm.
    pub fn wavelengths_nm(&self) -> &[f64] {
        &self.wavelengths_nm
    }

    /// The value at each.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Its value at a wavelength.
    ///
    /// # Errors
    /// [`SpectrumError::Range`] beyond its ends.
    pub fn at(&self, nm: f64) -> Result<f64, SpectrumError> {
        self.inside(nm).ok_or_else(|| SpectrumError::Range {
            name: self.name.clone(),
            first_nm: self.wavelengths_nm[0],
            last_nm: self.wavelengths_nm[self.wavelengths_nm.len() - 1],
            nm,
        })
    }

    fn inside(&self, nm: f64) -> Option<f64> {
        let (x, y) = (&self.wavelengths_nm, &self.values);
        let next = x.partition_point(|&x| x <= nm);
        match next {
            0 => None,
            n if n == x.len() => (nm == x[n - 1]).then(|| y[n - 1]),
            n => Some(y[n - 1] + (y[n] - y[n - 1]) * ((nm - x[n - 1]) / (x[n] - x[n - 1]))),
        }
    }
}

/// The spectrum of white light.
#[derive(Clone, Debug, PartialEq)]
pub enum SceneIlluminant {
    /// Of a CIE table.
    Cie(Illuminant),
    /// Relative power, measured or computed.
    Measured(Spectrum),
}

impl SceneIlluminant {
    /// Its name.
    pub fn name(&self) -> &str {
        match self {
            SceneIlluminant::Cie(light) => light.name(),
            SceneIlluminant::Measured(spectrum) => spectrum.name(),
        }
    }

    /// Relative power.
    ///
    /// # Errors
    /// [`SpectrumError::Range`] beyond the ends of a measured spectrum.
    pub fn relative_power(&self, nm: f64) -> Result<f64, SpectrumError> {
        match self {
            SceneIlluminant::Cie(light) => Ok(light.relative_power(nm)),
            SceneIlluminant::Measured(spectrum) => spectrum.at(nm),
        }
    }

    /// Factor that turns [`Self::relative_power`] into spectral irradiance [W m⁻² nm⁻¹] of `illuminance_lx` lux. A measured spectrum counts as 0 beyond its
    /// ends; `None` if no power is visible.
    pub fn irradiance_scale(&self, illuminance_lx: f64) -> Option<f64> {
        let scale = match self {
            SceneIlluminant::Cie(light) => light.irradiance_scale(illuminance_lx),
            SceneIlluminant::Measured(spectrum) => {
                let nodes = (FIRST_NM as usize..=LAST_NM as usize).step_by(STEP_NM).map(|nm| nm as f64);
                let visible = nodes.map(|nm| spectrum.inside(nm).unwrap_or(0.0) * observer(nm)[1]);
                illuminance_lx / (LUMINOUS_EFFICACY * visible.map(|v| v * STEP_NM as f64).sum::<f64>())
            }
        };
        scale.is_finite().then_some(scale)
    }
}

/// A spectrum of reflectance.
#[derive(Clone, Debug, PartialEq)]
pub enum Reflectance {
    /// ρ_R.
    Red,
    /// ρ_G.
    Green,
    /// ρ_B.
    Blue,
    /// A named spectrum.
    Named(Spectrum),
}

/// A spectrum of light that falls on surfaces.
#[derive(Clone, Debug, PartialEq)]
pub enum LightSpectrum {
    /// The illuminant.
    Illuminant,
    /// The illuminant times the reflectance of a linear colour.
    Colour([f64; 3]),
}

/// A basis: the radiance of a surface of some reflectance in some light, for the weight 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Basis {
    /// Reflectance.
    pub reflectance: Reflectance,
    /// Light.
    pub light: LightSpectrum,
}

impl Basis {
    /// Kind of its reflectance: `red`, `green`, `blue` or `spectrum`.
    pub fn kind(&self) -> &'static str {
        match self.reflectance {
            Reflectance::Red => "red",
            Reflectance::Green => "green",
            Reflectance::Blue => "blue",
            Reflectance::Named(_) => "spectrum",
        }
    }

    /// Name of the reflectance's spectrum, or its kind.
    pub fn name(&self) -> &str {
        match &self.reflectance {
            Reflectance::Named(spectrum) => spectrum.name(),
            _ => self.kind(),
        }
    }
}

/// The bases of a scene: every pair of a reflectance and a light. That of reflectance `r` in light `l` is number
/// l·(3 + spectra) + r; the first three are red, green and blue in the illuminant.
pub fn bases(spectra: &[Spectrum], lights: &[LightSpectrum]) -> Vec<Basis> {
    let colours = [Reflectance::Red, Reflectance::Green, Reflectance::Blue];
    let reflectances: Vec<Reflectance> =
        colours.into_iter().chain(spectra.iter().cloned().map(Reflectance::Named)).collect();
    let mut all = Vec::with_capacity(reflectances.len() * lights.len());
    for light in lights {
        all.extend(reflectances.iter().map(|r| Basis { reflectance: r.clone(), light: light.clone() }));
    }
    all
}

#[cfg(test)]
mod tests;
