//! What a sensor is: pixels, noises, converter, mosaic, and the figures that follow from them.

use super::angle::{AngularResponse, Plate};
use super::companding::Companding;
use super::crosstalk::Crosstalk;
use super::curve::Curve;
use super::defects::Defects;
use super::dual_gain::{self, DualGain};
use super::figures::{NoiseFigures, NoiseSet};
use super::overflow::Overflow;
use super::power_law::NoiseSpectrum;
use super::quantile;

/// What a quantum efficiency is stated for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QuantumEfficiencyOf {
    /// A pixel of area pitch², its microlens included.
    Pixel,
    /// The photodiode alone, of area aperture².
    Aperture,
}

/// A pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixel {
    /// Centre-to-centre distance, µm.
    pub pitch_um: f64,
    /// (rows, columns) of the sensor, if it has a size of its own.
    pub size: Option<(usize, usize)>,
    /// Side of the light-sensitive square, centred, µm.
    pub aperture_um: f64,
    /// What the quantum efficiency is stated for.
    pub quantum_efficiency_of: QuantumEfficiencyOf,
    /// Electrons that it holds.
    pub full_well_e: f64,
    /// How it fills and overflows.
    pub overflow: Overflow,
    /// Dark current at the reference temperature, e-/s.
    pub dark_current_e_per_s: f64,
    /// Reference temperature, °C.
    pub dark_reference_c: f64,
    /// Rise of temperature that doubles the dark current, K.
    pub dark_doubling_k: f64,
}

/// The converter.
#[derive(Clone, Debug, PartialEq)]
pub struct Adc {
    /// Bits of a number of a raw, at most 16.
    pub bits: u32,
    /// Digital numbers per electron at gain 1; of two gains, of the higher one.
    pub gain_dn_per_e: f64,
    /// Digital number of no charge.
    pub black_dn: f64,
    /// Gains that the sensor has; any if empty.
    pub gains: Vec<f64>,
    /// ISO of gain 1.
    pub base_iso: Option<f64>,
    /// A second reading of a lower conversion gain; none: one reading.
    pub dual_gain: Option<DualGain>,
    /// Curve from linear numbers to those of a raw; none: they are the same.
    pub companding: Option<Companding>,
}

impl Adc {
    /// Largest number of a raw.
    pub fn max_dn(&self) -> f64 {
        ((1u32 << self.bits) - 1).into()
    }

    /// Largest linear number.
    pub fn max_linear_dn(&self) -> f64 {
        self.companding.as_ref().map_or(self.max_dn(), Companding::max_linear_dn)
    }

    /// Number of a raw for a linear one.
    pub fn stored_dn(&self, linear_dn: f64) -> f64 {
        let coded = self.companding.as_ref().map_or(linear_dn, |curve| curve.coded(linear_dn));
        dual_gain::whole(coded, self.max_dn())
    }

    /// Linear number of one of a raw.
    pub fn linear_dn(&self, stored_dn: f64) -> f64 {
        self.companding.as_ref().map_or(stored_dn, |curve| curve.linear(stored_dn))
    }

    /// Linear number of every number of a raw; none if they are the same.
    pub fn linear_table(&self) -> Option<Vec<f32>> {
        let curve = self.companding.as_ref()?;
        Some((0..1u32 << self.bits).map(|coded| curve.linear(coded.into()) as f32).collect())
    }

    /// Linear number of a charge without noise, before the last rounding.
    fn noiseless_dn(&self, gain: f64, charge_e: f64) -> f64 {
        let above_dn = gain * self.gain_dn_per_e * charge_e;
        match &self.dual_gain {
            None => self.black_dn + above_dn,
            Some(dual) => {
                let low_dn = self.black_dn + above_dn / dual.ratio;
                dual.combined(self.black_dn + above_dn, low_dn, self.black_dn)
            }
        }
    }
}

/// A kind of filter of the mosaic.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Its name in the pattern.
    pub name: String,
    /// The colour plane that it belongs to.
    pub plane: String,
    /// Quantum efficiency over wavelength, or quantum efficiency times wavelength (nm) where `per_energy`.
    pub curve: Curve,
}

/// A sensor.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    /// Its name.
    pub name: String,
    /// What it is.
    pub description: String,
    /// Its pixels.
    pub pixel: Pixel,
    /// Its noises.
    pub noise: NoiseFigures,
    /// Spectra of those of rows and columns.
    pub noise_spectrum: NoiseSpectrum,
    /// Pixels that are not like the others.
    pub defects: Defects,
    /// Time from the start of a row to that of the next, s; 0: all rows at once.
    pub row_time_s: f64,
    /// Its converter.
    pub adc: Adc,
    /// The filters of its mosaic.
    pub channels: Vec<Channel>,
    /// Whether the channels' curves are per unit of energy: quantum efficiency times wavelength.
    pub per_energy: bool,
    /// Transmittances of the filters before all pixels.
    pub filters: Vec<Curve>,
    /// Plates before all pixels whose transmittance depends on the angle of incidence.
    pub plates: Vec<Plate>,
    /// Response of the pixels over the angle of incidence; none: the same for all.
    pub angle: Option<AngularResponse>,
    /// What pixels collect of the light of others; none: nothing.
    pub crosstalk: Option<Crosstalk>,
    /// Channel of each pixel of a period.
    pub pattern: Pattern,
}

/// The mosaic: channel numbers over one period.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Pattern {
    /// Rows of a period.
    pub rows: usize,
    /// Columns of a period.
    pub columns: usize,
    /// Channel numbers, row by row.
    pub channels: Vec<usize>,
}

impl Pattern {
    /// Channel of the sensor pixel (`row`, `column`).
    pub fn channel(&self, row: usize, column: usize) -> usize {
        self.channels[row % self.rows * self.columns + column % self.columns]
    }
}

impl Sensor {
    /// Whether its signal depends on the directions of the light.
    pub fn depends_on_angles(&self) -> bool {
        self.angle.is_some() || !self.plates.is_empty()
    }

    /// Area that the quantum efficiency is stated for, m².
    pub fn area_m2(&self) -> f64 {
        let side = match self.pixel.quantum_efficiency_of {
            QuantumEfficiencyOf::Pixel => self.pixel.pitch_um,
            QuantumEfficiencyOf::Aperture => self.pixel.aperture_um,
        };
        side * side * 1e-12
    }

    /// Charge at which the well or the converter ends, whichever is first, e-.
    pub fn saturation_e(&self, gain: f64) -> f64 {
        let (adc, dn_per_e) = (&self.adc, gain * self.adc.gain_dn_per_e);
        let converter = (adc.max_linear_dn() - adc.black_dn) / dn_per_e;
        let low = adc.dual_gain.map(|low| low.ratio * (low.max_dn() - adc.black_dn) / dn_per_e);
        self.pixel.full_well_e.min(converter).min(low.unwrap_or(f64::INFINITY))
    }

    /// Digital number of saturation.
    pub fn white_dn(&self, gain: f64) -> f64 {
        let linear_dn = self.adc.noiseless_dn(gain, self.saturation_e(gain));
        self.adc.linear_dn(self.adc.stored_dn(linear_dn))
    }

    /// Dark current at a temperature (the reference's if none), e-/s.
    pub fn dark_current_e_per_s(&self, temperature_c: Option<f64>) -> f64 {
        self.pixel.dark_current_e_per_s * self.dark_factor(temperature_c)
    }

    /// Dark current at a temperature over that at the reference's.
    pub(super) fn dark_factor(&self, temperature_c: Option<f64>) -> f64 {
        let p = &self.pixel;
        let above = temperature_c.unwrap_or(p.dark_reference_c) - p.dark_reference_c;
        quantile::exp(above / p.dark_doubling_k * std::f64::consts::LN_2)
    }

    /// Standard deviation of a pixel in the dark over pixels and frames, DN, rounding included.
    pub fn dark_sigma_dn(&self, gain: f64, seconds: f64, temperature_c: Option<f64>) -> f64 {
        let dark_e = self.dark_current_e_per_s(temperature_c) * seconds;
        let variance = self.noise_variance(NoiseSet::ALL, gain, dark_e, dark_e);
        gain * self.adc.gain_dn_per_e * variance.total_e2().sqrt()
    }

    /// Ratio of saturation to the temporal noise of the dark at gain 1 and no exposure.
    pub fn dynamic_range(&self) -> f64 {
        let noise_e = self.noise_variance(NoiseSet::ALL, 1.0, 0.0, 0.0).temporal_e2().sqrt();
        self.saturation_e(1.0) / noise_e
    }

    /// Colour planes: R, G, B first, then the others in the order of the pattern.
    pub fn planes(&self) -> Vec<&str> {
        let mut planes: Vec<&str> =
            ["R", "G", "B"].into_iter().filter(|p| self.channels.iter().any(|c| c.plane == *p)).collect();
        for channel in &self.channels {
            if !planes.contains(&channel.plane.as_str()) {
                planes.push(&channel.plane);
            }
        }
        planes
    }

    /// Number of each channel's plane in [`Sensor::planes`].
    pub fn plane_of_channels(&self) -> Vec<usize> {
        let planes = self.planes();
        let of = |c: &Channel| planes.iter().position(|p| *p == c.plane).unwrap_or_default();
        self.channels.iter().map(of).collect()
    }
}
