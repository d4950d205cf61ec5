//! The sensor: what a camera records of the film, as digital numbers (DN). A linear camera after EMVA 1288 Release 4.0 Linear.
//!
//! Of a sensor pixel with the filter c, in this order (z, u: independent standard normal and uniform numbers, [`random`]):
//!
//! ```text
//! signal (e-/s)  = A · Σ_b w_cb · ⟨E_b⟩                                             spectrum, pixels, stream; w_cb(place): angle, field_weights; between pixels: crosstalk, diffusion, spread
//! mean (e-)      = max(signal, 0)·κ·t·max(1 + PRNU·z, 0) + D(T)·max(1 + DCNU·z, 0)·t   noise; of hot pixels more: defects
//! charge (e-)    = held(Poisson(mean)) + received; min(Poisson(mean), full well) without knee and blooming    noise, quantile, overflow
//! read (e-)      = (charge + DSNU·z + reset·z + read·z + column offset·z + row·z)·(1 + column gain·z)
//! raw (DN)       = clip(⌊black + g·K·read + adc·z + ½⌋, 0, 2^bits − 1)               two readings of two gains: dual_gain; coded by a curve: companding
//! ```
//!
//! ⟨E_b⟩ (W m⁻² nm⁻¹) is the mean of the film's band b over the pixel's aperture, w_cb (nm/J) the weight of the band behind the filter, A
//! (m²) the area that the quantum efficiency is stated for, t (s) the exposure time, κ the scale of a relative film, g the gain, K (DN/e-) the
//! conversion at gain 1. The signal is rounded to f32 once; all that follows starts from that. PRNU is applied before the Poisson number: it is a
//! share of light that is not caught, so it has shot noise. PRNU, DCNU, DSNU and the column terms belong to the die and are the same in
//! every frame; shot, reset, read, converter and row noise belong to the frame. The numbers z of rows and of columns are independent, or have a power-law spectrum ([`power_law`]).
//!
//! Wherever no other is named, a digital number is a linear one: before the curve of a companded raw.
//!
//! The film that rows see while the camera moves is that of [`motion`].
//!
//! Left out: lag, black sun, non-linearity of the electronics, motion of the scene. A raw of a given signal has the same bits on every
//! machine, in any region, order and number of threads.
//!
//! # Words
//!
//! - **signal**: electrons per second of a sensor pixel behind its filter, without noise. **raw**: the digital numbers of a sensor's frames.
//!   **die**: what is the same in every frame of a sensor. **filter**: what stands before a pixel of the mosaic (Gr and Gb are two). **plane**:
//!   the colour that filters belong to. **mosaic**: one filter per pixel; **demosaicing** interpolates every plane at every pixel.

pub mod angle;
pub mod companding;
pub mod crosstalk;
mod curve;
pub mod defects;
pub mod diffusion;
pub mod dual_gain;
pub mod emva;
pub mod exposure;
mod field_sums;
pub mod field_weights;
pub mod figures;
pub mod flicker;
pub mod gyro;
mod lanes;
mod model;
pub mod motion;
pub mod noise;
pub mod overflow;
pub mod pixels;
pub mod power_law;
pub mod quantile;
pub mod random;
pub mod response_map;
mod row_sums;
pub mod spectrum;
pub mod spread;
pub mod stream;
mod variance;

pub use companding::Companding;
pub use crosstalk::Crosstalk;
pub use curve::Curve;
pub use defects::Defects;
pub use dual_gain::DualGain;
pub use exposure::{Exposure, SignalHistogram};
pub use figures::{NoiseFigures, NoiseSet};
pub use model::{Adc, Channel, Pattern, Pixel, QuantumEfficiencyOf, Sensor};
pub use overflow::Overflow;
pub use power_law::NoiseSpectrum;
pub use quantile::LANES;
pub use spectrum::HC_J_M;
pub use variance::NoiseVariance;
