//! The sensor: what a camera records of the film, as digital numbers (DN). A linear camera after EMVA 1288 Release 4.0 Linear.
//!
//! Of a sensor pixel with the filter c, in this order (z, u: independent standard normal and uniform numbers, [`random`]):
//!
//! ```text
//! signal (e-/s)  = A · Σ_b w_cb · ⟨E_b⟩                                             spectrum, pixels, stream
//! mean (e-)      = max(signal, 0)·κ·t·max(1 + PRNU·z, 0) + D(T)·max(1 + DCNU·z, 0)·t   noise
//! charge (e-)    = min(Poisson(mean), full well)                                    noise, quantile
//! read (e-)      = (charge + DSNU·z + reset·z + read·z + column offset·z + row·z)·(1 + column gain·z)
//! raw (DN)       = clip(⌊black + g·K·read + adc·z + ½⌋, 0, 2^bits − 1)
//! ```
//!
//! ⟨E_b⟩ (W m⁻² nm⁻¹) is the mean of the film's band b over the pixel's aperture, w_cb (nm/J) the weight of the band behind the filter, A
//! (m²) the area that the quantum efficiency is stated for, t (s) the exposure time, κ the scale of a relative film, g the gain, K (DN/e-) the
//! conversion at gain 1. The signal is rounded to f32 once; all that follows starts from that. PRNU is applied before the Poisson number: it is a
//! share of light that is not caught, so it has shot noise. PRNU, DCNU, DSNU and the column terms belong to the die and are the same in
//! every frame; shot, reset, read, converter and row noise belong to the frame.
//!
//! Left out: crosstalk, microlens shading, blooming, lag, non-linearity, rolling shutter. A raw of a given signal has the same bits on every
//! machine, in any region, order and number of threads.
//!
//! # Words
//!
//! - **signal**: electrons per second of a sensor pixel behind its filter, without noise. **raw**: the digital numbers of a sensor's frames.
//!   **die**: what is the same in every frame of a sensor. **filter**: what stands before a pixel of the mosaic (Gr and Gb are two). **plane**:
//!   the colour that filters belong to. **mosaic**: one filter per pixel; **demosaicing** interpolates every plane at every pixel.

pub mod emva;
pub mod exposure;
pub mod figures;
mod lanes;
pub mod noise;
pub mod pixels;
pub mod quantile;
pub mod random;
pub mod spectrum;
pub mod stream;
mod variance;

pub use exposure::{Exposure, SignalHistogram};
pub use figures::{NoiseFigures, NoiseSet};
pub use spectrum::Curve;
pub use variance::NoiseVariance;

/// Pixels of a row that are computed together.
pub const LANES: usize = 128;

/// Planck's constant times the speed of light, J·m (SI, exact).
pub const HC_J_M: f64 = 6.626_070_15e-34 * 299_792_458.0;

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
    /// Bits, at most 16.
    pub bits: u32,
    /// Digital numbers per electron at gain 1.
    pub gain_dn_per_e: f64,
    /// Digital number of no charge.
    pub black_dn: f64,
    /// Gains that the sensor has; any if empty.
    pub gains: Vec<f64>,
    /// ISO of gain 1.
    pub base_iso: Option<f64>,
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
    /// Its converter.
    pub adc: Adc,
    /// The filters of its mosaic.
    pub channels: Vec<Channel>,
    /// Whether the channels' curves are per unit of energy: quantum efficiency times wavelength.
    pub per_energy: bool,
    /// Transmittances of the filters before all pixels.
    pub filters: Vec<Curve>,
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
    /// Area that the quantum efficiency is stated for, m².
    pub fn area_m2(&self) -> f64 {
        let side = match self.pixel.quantum_efficiency_of {
            QuantumEfficiencyOf::Pixel => self.pixel.pitch_um,
            QuantumEfficiencyOf::Aperture => self.pixel.aperture_um,
        };
        side * side * 1e-12
    }

    /// Largest digital number.
    pub fn max_dn(&self) -> f64 {
        ((1u32 << self.adc.bits) - 1).into()
    }

    /// Charge at which the well or the converter ends, whichever is first, e-.
    pub fn saturation_e(&self, gain: f64) -> f64 {
        let converter = (self.max_dn() - self.adc.black_dn) / (gain * self.adc.gain_dn_per_e);
        self.pixel.full_well_e.min(converter)
    }

    /// Digital number of saturation.
    pub fn white_dn(&self, gain: f64) -> f64 {
        (self.adc.black_dn + gain * self.adc.gain_dn_per_e * self.saturation_e(gain) + 0.5).floor()
    }

    /// Dark current at a temperature (the reference's if none), e-/s.
    pub fn dark_current_e_per_s(&self, temperature_c: Option<f64>) -> f64 {
        let p = &self.pixel;
        let above = temperature_c.unwrap_or(p.dark_reference_c) - p.dark_reference_c;
        p.dark_current_e_per_s * quantile::exp(above / p.dark_doubling_k * std::f64::consts::LN_2)
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
