//! Weights of the film's bands behind the filters of a sensor.
//!
//!   w_cb(s) = ∫ hat_b(λ) · λ/(hc) · QE_c(λ) · ΠT(λ, s) dλ   (nm/J)        s: sine of the angle of incidence on plates ([`super::angle`]), 0 unless said
//!
//! Between bands E is linear in λ, so hat_b is the triangle between a band's neighbours; before the first and after the last band E stays
//! constant for half a spacing; a single band represents 10 nm. QE and transmittances are linear between their nodes and 0 outside their tables.
//! Three Gauss points on every piece between nodes are exact: at most five linear factors (hat, λ, QE, two transmittances).

use super::model::Sensor;
use crate::colour::{self, Illuminant};

/// Planck's constant times the speed of light, J·m (SI, exact).
pub const HC_J_M: f64 = 6.626_070_15e-34 * 299_792_458.0;

/// Abscissae and weights of Gauss's rule with three points.
const GAUSS: [(f64, f64); 3] =
    [(-0.774_596_669_241_483_4, 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.774_596_669_241_483_4, 5.0 / 9.0)];
/// Light that colours are made of, nm.
const SEEN_NM: (f64, f64) = (400.0, 700.0);
/// Half of the width of a single band, nm.
const SINGLE_BAND_HALF_NM: f64 = 5.0;

impl Sensor {
    /// Electrons per photon of a wavelength on the area of [`Sensor::area_m2`], filters and plates included, at normal incidence.
    pub fn quantum_efficiency(&self, channel: usize, nm: f64) -> f64 {
        let value = self.channels[channel].curve.at(nm);
        let value = if self.per_energy { value / nm } else { value };
        self.behind_filters(value, nm, 0.0)
    }

    /// Electrons per joule of a wavelength, filters and plates included, at normal incidence.
    pub fn response_e_per_j(&self, channel: usize, nm: f64) -> f64 {
        self.response_at(channel, nm, 0.0)
    }

    /// [`Sensor::response_e_per_j`] behind plates at the square of the sine of the angle of incidence.
    fn response_at(&self, channel: usize, nm: f64, sine_square: f64) -> f64 {
        let value = self.channels[channel].curve.at(nm) * (1e-9 / HC_J_M);
        let value = if self.per_energy { value } else { value * nm };
        self.behind_filters(value, nm, sine_square)
    }

    fn behind_filters(&self, value: f64, nm: f64, sine_square: f64) -> f64 {
        let value = self.filters.iter().fold(value, |v, filter| v * filter.at(nm));
        self.plates.iter().fold(value, |v, plate| v * plate.at(nm, sine_square))
    }

    /// Nodes of all curves in a channel's response at normal incidence, ascending, nm.
    pub fn nodes_nm(&self, channel: usize) -> Vec<f64> {
        self.nodes_at(channel, 0.0)
    }

    fn nodes_at(&self, channel: usize, sine_square: f64) -> Vec<f64> {
        let curves = self.filters.iter().chain([&self.channels[channel].curve]);
        let mut nodes: Vec<f64> = curves.flat_map(|c| c.wavelengths_nm.iter().copied()).collect();
        nodes.extend(self.plates.iter().flat_map(|plate| plate.nodes_nm(sine_square)));
        nodes.sort_by(f64::total_cmp);
        nodes.dedup();
        nodes
    }

    /// ∫ response · f over `low`..`high` at the square of a sine, exact where f is linear between the ends and plates do not absorb.
    fn integral(
        &self,
        (channel, sine_square): (usize, f64),
        nodes: &[f64],
        (low, high): (f64, f64),
        f: impl Fn(f64) -> f64,
    ) -> f64 {
        let inside = nodes.iter().copied().filter(|n| *n > low && *n < high);
        let cuts: Vec<f64> = [low].into_iter().chain(inside).chain([high]).collect();
        let piece = |(x, weight): (f64, f64), ends: &[f64]| {
            let (mid, half) = ((ends[1] + ends[0]) / 2.0, (ends[1] - ends[0]) / 2.0);
            let nm = mid + half * x;
            weight * half * f(nm) * self.response_at(channel, nm, sine_square)
        };
        GAUSS.iter().map(|&g| cuts.windows(2).map(|ends| piece(g, ends)).sum::<f64>()).sum()
    }

    /// w_cb of a channel for the film's bands, ascending in wavelength, nm/J.
    pub fn band_weights(&self, channel: usize, bands_nm: &[f64]) -> Vec<f64> {
        self.weights_times((channel, 0.0), bands_nm, (&[], |_| 1.0))
    }

    /// Electrons per second of film values of 1, of which `factors` are the irradiances (W m⁻² nm⁻¹) in the bands, in perpendicular light.
    pub(super) fn electron_weights(&self, channel: usize, bands: (&[f64], &[f64])) -> Vec<f64> {
        self.electron_weights_times(channel, bands, 0.0, (&[], |_| 1.0))
    }

    /// Those behind plates at the square of the sine of the angle of incidence, with a factor `f` under the integral, linear between the wavelengths `nodes_nm` (exact behind at most one filter or plate).
    pub(super) fn electron_weights_times(
        &self,
        channel: usize,
        (bands_nm, factors): (&[f64], &[f64]),
        sine_square: f64,
        linear: (&[f64], impl Fn(f64) -> f64),
    ) -> Vec<f64> {
        let weights = self.weights_times((channel, sine_square), bands_nm, linear);
        std::iter::zip(weights, factors).map(|(w, f)| w * self.area_m2() * f).collect()
    }

    /// [`Sensor::band_weights`] with a factor `f` under the integral, linear between the wavelengths `nodes_nm` (exact behind at most one filter).
    pub(super) fn band_weights_times(
        &self,
        channel: usize,
        bands_nm: &[f64],
        linear: (&[f64], impl Fn(f64) -> f64),
    ) -> Vec<f64> {
        self.weights_times((channel, 0.0), bands_nm, linear)
    }

    fn weights_times(
        &self,
        (channel, sine_square): (usize, f64),
        bands_nm: &[f64],
        (nodes_nm, f): (&[f64], impl Fn(f64) -> f64),
    ) -> Vec<f64> {
        let mut nodes = self.nodes_at(channel, sine_square);
        nodes.extend_from_slice(nodes_nm);
        nodes.sort_by(f64::total_cmp);
        nodes.dedup();
        self.weights_of((channel, sine_square), nodes, bands_nm, f)
    }

    /// ∫ hat_b · response · f for each band, response at a channel and the square of a sine.
    fn weights_of(
        &self,
        channel: (usize, f64),
        nodes: Vec<f64>,
        bands_nm: &[f64],
        f: impl Fn(f64) -> f64,
    ) -> Vec<f64> {
        let w = bands_nm;
        let flat = |low, high| self.integral(channel, &nodes, (low, high), &f);
        let last = w.len() - 1;
        if last == 0 {
            return vec![flat(w[0] - SINGLE_BAND_HALF_NM, w[0] + SINGLE_BAND_HALF_NM)];
        }
        let of = |b: usize| {
            let below = match b {
                0 => flat(w[0] - (w[1] - w[0]) / 2.0, w[0]),
                _ => {
                    let (a, c) = (w[b - 1], w[b]);
                    self.integral(channel, &nodes, (a, c), |nm| f(nm) * ((nm - a) / (c - a)))
                }
            };
            let above = match b == last {
                true => flat(w[b], w[b] + (w[b] - w[b - 1]) / 2.0),
                false => {
                    let (a, c) = (w[b], w[b + 1]);
                    self.integral(channel, &nodes, (a, c), |nm| f(nm) * ((c - nm) / (c - a)))
                }
            };
            below + above
        };
        (0..w.len()).map(of).collect()
    }

    /// Share of a channel's response to light of equal energy at all wavelengths that lies outside the film's bands.
    pub fn share_outside(&self, channel: usize, bands_nm: &[f64]) -> f64 {
        let nodes = self.nodes_nm(channel);
        let (Some(&low), Some(&high)) = (nodes.first(), nodes.last()) else { return 0.0 };
        let all = self.integral((channel, 0.0), &nodes, (low, high), |_| 1.0);
        let inside: f64 = self.band_weights(channel, bands_nm).iter().sum();
        if all > 0.0 { (1.0 - inside / all).max(0.0) } else { 0.0 }
    }

    /// Gain per channel that makes a white under a light neutral; the minimum is 1, as it is for channels of no colour ([`Sensor::sees_colour`]).
    pub fn white_gains(&self, light: Illuminant) -> Vec<f64> {
        let sensor = self.in_uniform_light();
        let grid = || (0..=400).map(|i| colour::FIRST_NM + f64::from(i));
        let of = |c: usize| {
            grid().map(|nm| sensor.response_e_per_j(c, nm) * light.relative_power(nm)).sum::<f64>()
        };
        let responses: Vec<f64> = (0..self.channels.len()).map(of).collect();
        let max = responses.iter().copied().fold(0.0, f64::max);
        let gain = |(r, sees): (&f64, bool)| if sees { max / r } else { 1.0 };
        std::iter::zip(&responses, self.sees_colour(light)).map(gain).collect()
    }

    /// Whether each channel is one of a colour: half of its response to a light (380 to 780 nm) or more lies within 400 to 700 nm. Infrared filters of a mosaic are none; all are, if none is.
    pub fn sees_colour(&self, light: Illuminant) -> Vec<bool> {
        let sensor = self.in_uniform_light();
        let of = |c: usize| {
            let response = |nm: f64| sensor.response_e_per_j(c, nm) * light.relative_power(nm);
            let all = (0..=400).map(|i| colour::FIRST_NM + f64::from(i));
            let seen =
                all.clone().filter(|nm| (SEEN_NM.0..=SEEN_NM.1).contains(nm)).map(response).sum::<f64>();
            seen > 0.0 && seen >= 0.5 * all.map(response).sum::<f64>()
        };
        let sees: Vec<bool> = (0..self.channels.len()).map(of).collect();
        if sees.contains(&true) { sees } else { vec![true; sees.len()] }
    }

    /// Electrons of a channel per lux second of a light.
    pub fn electrons_per_lux_second(&self, channel: usize, light: Illuminant) -> f64 {
        let sensor = self.in_uniform_light();
        let grid = || (0..=400).map(|i| colour::FIRST_NM + f64::from(i));
        let sum: f64 = grid().map(|nm| sensor.response_e_per_j(channel, nm) * light.relative_power(nm)).sum();
        sum * light.irradiance_scale(1.0) * self.area_m2()
    }
}

/// Weights v_b with illuminance (lx) = Σ_b v_b·E_b for a film of spectral irradiance (W m⁻² nm⁻¹).
pub fn illuminance_weights(bands_nm: &[f64]) -> Vec<f64> {
    colour::xyz_weights(bands_nm).iter().map(|w| w[1]).collect()
}
