//! From the signal to digital numbers: charge, noises, gain, rounding; the equations stand in [`crate::sensor`].
//!
//! A tile is computed row by row, [`LANES`] pixels at a time, each step over all of them before the next, so that the compiler vectorizes
//! the steps. A quantity whose noise is off or whose standard deviation is 0 draws no numbers; its terms drop out exactly.

use super::companding::Companding;
use super::defects::{Defects, amplitudes};
use super::dual_gain::{DualGain, whole};
use super::flicker::Flicker;
use super::lanes::Set;
use super::overflow::Overflow;
use super::power_law::{NoiseSpectrum, values};
use super::quantile::{normal_quantile, normal_quantiles, poissons};
use super::random::{Stream, uniform_pair, uniforms};
use super::{Exposure, LANES, NoiseFigures, NoiseSet, Sensor};
use crate::geometry::Rect;

/// Beyond all normal numbers, and all amplitudes of defects, of uniform numbers from 2⁻⁵³ to 1 − 2⁻⁵³.
const FARTHEST_Z: f64 = 8.3;
const FARTHEST_AMPLITUDE: f64 = 37.0;
/// A Poisson number of the mean m is below m + 10√m + 25 + this (e-): its normal number is below [`FARTHEST_Z`], its skew adds (z² + 2)/6.
const FARTHEST_E: f64 = 75.0;

/// Frames of one sensor under one exposure.
#[derive(Clone, Debug)]
pub struct Exposer {
    /// Standard deviations; 0 where the noise is off.
    sigma: NoiseFigures,
    spectrum: NoiseSpectrum,
    shot: bool,
    /// Defects, charges of the exposure (e-) in place of dark currents; 0 where their noise is off.
    defects: Defects,
    flicker: Option<Flicker>,
    seconds: f64,
    row_time_s: f64,
    /// Electrons of a signal of 1 e-/s.
    signal_scale: f64,
    /// Mean dark charge, e-.
    dark_e: f64,
    full_well_e: f64,
    overflow: Overflow,
    black_dn: f64,
    dn_per_e: f64,
    max_dn: f64,
    /// The low conversion gain, its read noise 0 where it is off.
    dual_gain: Option<DualGain>,
    companding: Option<Companding>,
    seed: u64,
    die: u64,
    frame: u32,
    set: Set,
}

/// What pixels of one row have in common, and the terms of their columns.
struct ExposeRow<'a> {
    exposer: &'a Exposer,
    row: u32,
    column: u32,
    /// Row noise, e-.
    offset_e: f64,
    /// Electrons of a signal of 1 e-/s.
    signal_scale: f64,
    /// Offset (e-) and gain of each column; empty if there is none.
    column_offset_e: &'a [f64],
    column_gain: &'a [f64],
    /// Electrons received from other pixels; empty if none are.
    received_e: &'a [f32],
}

/// Counts of pixels at the converter's ends.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Clipped {
    /// Pixels at or above white.
    pub white: u64,
    /// Pixels at 0.
    pub black: u64,
}

impl Exposer {
    /// One frame of `sensor`.
    pub fn new(sensor: &Sensor, e: &Exposure) -> Self {
        let dark = sensor.dark_current_e_per_s(e.temperature_c) * e.seconds;
        let hot_e = sensor.defects.hot_dark_e_per_s * sensor.dark_factor(e.temperature_c) * e.seconds;
        let defects = Defects {
            hot_pixels: e.noise.on(NoiseSet::DARK, sensor.defects.hot_pixels),
            hot_dark_e_per_s: hot_e,
            telegraph_pixels: e.noise.on(NoiseSet::READ, sensor.defects.telegraph_pixels),
            ..sensor.defects
        };
        Self {
            sigma: sensor.noise.switched(e.noise),
            spectrum: sensor.noise_spectrum,
            shot: e.noise.has(NoiseSet::SHOT),
            defects,
            flicker: e.flicker,
            seconds: e.seconds,
            row_time_s: sensor.row_time_s,
            signal_scale: e.scale * e.seconds,
            dark_e: e.noise.on(NoiseSet::DARK, dark),
            full_well_e: sensor.pixel.full_well_e,
            overflow: sensor.pixel.overflow,
            black_dn: sensor.adc.black_dn,
            dn_per_e: e.gain * sensor.adc.gain_dn_per_e,
            max_dn: sensor.adc.max_dn(),
            dual_gain: sensor
                .adc
                .dual_gain
                .map(|dual| DualGain { read_noise_e: e.noise.on(NoiseSet::READ, dual.read_noise_e), ..dual }),
            companding: sensor.adc.companding.clone(),
            seed: e.seed,
            die: e.die,
            frame: e.frame,
            set: Set::detect(),
        }
    }

    /// How the sensor's pixels fill and overflow.
    pub fn overflow(&self) -> Overflow {
        self.overflow
    }

    /// Electrons that a pixel holds.
    pub fn full_well_e(&self) -> f64 {
        self.full_well_e
    }

    /// Digital numbers of the sensor pixels `rect` from their signal (e-/s), both row by row.
    ///
    /// # Panics
    /// If the lengths are not those of `rect`, or it begins before the sensor's first pixel.
    pub fn expose(&self, signal: &[f32], rect: Rect, out: &mut [u16]) {
        self.expose_with(signal, &[], rect, out);
    }

    /// [`Exposer::expose`] of pixels that receive `received_e` electrons from others ([`super::overflow::received`]); none if it is empty.
    ///
    /// # Panics
    /// As [`Exposer::expose`].
    pub fn expose_with(&self, signal: &[f32], received_e: &[f32], rect: Rect, out: &mut [u16]) {
        assert!(
            signal.len() == rect.size().pixels() && out.len() == signal.len() && rect.y >= 0 && rect.x >= 0
        );
        assert!(received_e.is_empty() || received_e.len() == signal.len());
        let (rows, columns) = (self.row_offsets_e(rect), self.columns(rect));
        for (i, (signal, out)) in
            std::iter::zip(signal.chunks(rect.width), out.chunks_mut(rect.width)).enumerate()
        {
            let row = rect.y as u32 + i as u32;
            let received_e =
                if received_e.is_empty() { &[] } else { &received_e[i * rect.width..][..rect.width] };
            let row = ExposeRow {
                exposer: self,
                row,
                column: rect.x as u32,
                offset_e: rows.get(i).copied().unwrap_or_default(),
                signal_scale: self.signal_scale_of(row),
                column_offset_e: &columns.0,
                column_gain: &columns.1,
                received_e,
            };
            self.set.run(
                #[inline(always)]
                || expose_row(&row, signal, out),
            );
        }
    }

    /// Charges (e-) of the sensor pixels `rect` before the full well, from their signal (e-/s), all row by row.
    ///
    /// # Panics
    /// As [`Exposer::expose`].
    pub fn charges(&self, signal: &[f32], rect: Rect, out: &mut [f64]) {
        assert!(
            signal.len() == rect.size().pixels() && out.len() == signal.len() && rect.y >= 0 && rect.x >= 0
        );
        for (i, (signal, out)) in
            std::iter::zip(signal.chunks(rect.width), out.chunks_mut(rect.width)).enumerate()
        {
            let row = ExposeRow {
                exposer: self,
                row: rect.y as u32 + i as u32,
                column: rect.x as u32,
                offset_e: 0.0,
                signal_scale: self.signal_scale_of(rect.y as u32 + i as u32),
                column_offset_e: &[],
                column_gain: &[],
                received_e: &[],
            };
            self.set.run(
                #[inline(always)]
                || charge_row(&row, signal, out),
            );
        }
    }

    /// A signal (e-/s) up to which no charge of a row exceeds `charge_e`; −∞ where dark charge may.
    pub(super) fn signal_within(&self, charge_e: f64, row: u32) -> f64 {
        let root = (charge_e - FARTHEST_E).max(0.0).sqrt() - 5.0;
        let mean_e = if root > 0.0 { root * root } else { 0.0 };
        let dark_e = self.dark_e * (1.0 + FARTHEST_Z * self.sigma.dark_nonuniformity);
        let hot_e = if self.defects.hot_pixels > 0.0 {
            FARTHEST_AMPLITUDE * self.defects.hot_dark_e_per_s
        } else {
            0.0
        };
        let left_e = mean_e - dark_e - hot_e;
        if left_e <= 0.0 {
            return f64::NEG_INFINITY;
        }
        let scale = self.signal_scale_of(row) * (1.0 + FARTHEST_Z * self.sigma.prnu);
        left_e / scale.max(f64::MIN_POSITIVE)
    }

    /// Electrons of a signal of 1 e-/s in a row.
    fn signal_scale_of(&self, row: u32) -> f64 {
        match &self.flicker {
            None => self.signal_scale,
            Some(flicker) => self.signal_scale * flicker.mean(f64::from(row) * self.row_time_s, self.seconds),
        }
    }

    /// Row noise of the rows of `rect`, e-; empty if there is none.
    fn row_offsets_e(&self, rect: Rect) -> Vec<f64> {
        let sigma = self.sigma.row_noise_e;
        if sigma == 0.0 {
            return Vec::new();
        }
        let z = |row| normal_quantile(uniform_pair(Stream::Row, row, 0, self.frame, self.seed)[0]);
        let mut offsets = values(self.spectrum.row_exponent, rect.y as u32..rect.bottom() as u32, z);
        offsets.iter_mut().for_each(|v| *v *= sigma);
        offsets
    }

    /// Offset (e-) and gain of the columns of `rect`.
    fn columns(&self, rect: Rect) -> (Vec<f64>, Vec<f64>) {
        let of = |which: usize, sigma: f64, exponent: f64| {
            if sigma == 0.0 {
                return Vec::new();
            }
            let z = |x| normal_quantile(uniform_pair(Stream::Column, 0, x, 0, self.die)[which]);
            let mut all = values(exponent, rect.x as u32..rect.right() as u32, z);
            all.iter_mut().for_each(|v| *v *= sigma);
            all
        };
        (of(0, self.sigma.column_offset_e, self.spectrum.column_exponent), of(1, self.sigma.column_gain, 0.0))
    }
}

/// Adds `sigma`·z of the numbers `u`.
#[inline(always)]
fn add_noise(to: &mut [f64; LANES], sigma: f64, u: &[f64; LANES]) {
    let z = normal_quantiles(u);
    std::iter::zip(to, &z).for_each(|(v, z)| *v += sigma * z);
}

/// Multiplies by max(1 + `sigma`·z, 0) of the numbers `u`.
#[inline(always)]
fn vary(by: &mut [f64; LANES], sigma: f64, u: &[f64; LANES]) {
    let z = normal_quantiles(u);
    for (v, z) in std::iter::zip(by, &z) {
        let factor = 1.0 + sigma * z;
        *v *= if factor > 0.0 { factor } else { 0.0 };
    }
}

/// One row of a tile.
#[inline(always)]
fn expose_row(row: &ExposeRow<'_>, signal: &[f32], out: &mut [u16]) {
    for (k, (signal, out)) in std::iter::zip(signal.chunks(LANES), out.chunks_mut(LANES)).enumerate() {
        let dn = expose_lanes(row, k * LANES, light(signal));
        std::iter::zip(out, &dn).for_each(|(out, dn)| *out = *dn);
    }
}

/// Charges of one row of a tile before the full well.
#[inline(always)]
fn charge_row(row: &ExposeRow<'_>, signal: &[f32], out: &mut [f64]) {
    for (k, (signal, out)) in std::iter::zip(signal.chunks(LANES), out.chunks_mut(LANES)).enumerate() {
        let u = of_defects(row, k * LANES);
        let (charge, ..) = charge_lanes(row, k * LANES, light(signal), &u[0]);
        std::iter::zip(out, &charge).for_each(|(out, charge)| *out = *charge);
    }
}

/// At most [`LANES`] pixels of a signal, negative ones as 0.
#[inline(always)]
fn light(signal: &[f32]) -> [f64; LANES] {
    let mut lanes = [0.0; LANES];
    for (to, s) in std::iter::zip(&mut lanes, signal) {
        *to = f64::from(if *s > 0.0 { *s } else { 0.0 });
    }
    lanes
}

/// Numbers of [`LANES`] pixels.
type Lanes = [f64; LANES];

/// The uniform numbers of the defects of [`LANES`] pixels from column `first` of the tile on: hot pixels, telegraph noise.
#[inline(always)]
fn of_defects(row: &ExposeRow<'_>, first: usize) -> [Lanes; 2] {
    let (e, column) = (row.exposer, row.column.wrapping_add(first as u32));
    match e.defects.hot_pixels != 0.0 || e.defects.telegraph_pixels != 0.0 {
        true => uniforms(Stream::Defects, row.row, column, 0, e.die),
        false => [[1.0; LANES]; 2],
    }
}

/// Charges of [`LANES`] pixels from column `first` of the tile on before the full well, and the uniform numbers of their DSNU and read noise; `signal` is not negative, `of_hot` are the numbers of hot pixels.
#[inline(always)]
fn charge_lanes(row: &ExposeRow<'_>, first: usize, signal: Lanes, of_hot: &Lanes) -> (Lanes, Lanes, Lanes) {
    let e = row.exposer;
    let s = &e.sigma;
    let column = row.column.wrapping_add(first as u32);
    let mut mean = signal.map(|v| v * row.signal_scale);
    let die = match s.prnu != 0.0 || s.dsnu_e != 0.0 {
        true => uniforms(Stream::PrnuDsnu, row.row, column, 0, e.die),
        false => [[0.5; LANES]; 2],
    };
    if s.prnu != 0.0 {
        vary(&mut mean, s.prnu, &die[0]);
    }
    if e.dark_e != 0.0 {
        let mut dark = [e.dark_e; LANES];
        if s.dark_nonuniformity != 0.0 {
            vary(&mut dark, s.dark_nonuniformity, &uniforms(Stream::Dcnu, row.row, column, 0, e.die)[0]);
        }
        std::iter::zip(&mut mean, &dark).for_each(|(m, d)| *m += d);
    }
    if let Some(amplitudes) = amplitudes(of_hot, e.defects.hot_pixels) {
        std::iter::zip(&mut mean, amplitudes).for_each(|(m, a)| *m += e.defects.hot_dark_e_per_s * a);
    }
    let own = match e.shot || s.read_noise_e != 0.0 {
        true => uniforms(Stream::ShotRead, row.row, column, e.frame, e.seed),
        false => [[0.5; LANES]; 2],
    };
    let charge = if e.shot { poissons(&mean, &own[0]) } else { mean };
    (charge, die[1], own[1])
}

/// [`LANES`] pixels from column `first` of the tile on; `signal` is not negative.
#[inline(always)]
fn expose_lanes(row: &ExposeRow<'_>, first: usize, signal: Lanes) -> [u16; LANES] {
    let e = row.exposer;
    let s = &e.sigma;
    let column = row.column.wrapping_add(first as u32);
    let [of_hot, of_telegraph] = of_defects(row, first);
    let (mut charge, of_dsnu, of_read) = charge_lanes(row, first, signal, &of_hot);
    let begins_e = e.overflow.begins_e(e.full_well_e);
    if !charge.iter().fold(true, |all, q| all & (*q <= begins_e)) {
        charge = charge.map(|q| e.overflow.held(q, e.full_well_e));
    }
    if !row.received_e.is_empty() {
        std::iter::zip(&mut charge, &row.received_e[first..]).for_each(|(v, r)| *v += f64::from(*r));
    }
    if s.dsnu_e != 0.0 {
        add_noise(&mut charge, s.dsnu_e, &of_dsnu);
    }
    let reset = match s.reset_noise_e != 0.0 || s.adc_noise_dn != 0.0 {
        true => uniforms(Stream::ResetAdc, row.row, column, e.frame, e.seed),
        false => [[0.5; LANES]; 2],
    };
    if s.reset_noise_e != 0.0 {
        add_noise(&mut charge, s.reset_noise_e, &reset[0]);
    }
    let telegraph_e = telegraph_e(row, column, &of_telegraph);
    let mut dn = reading(
        row,
        first,
        charge,
        &Reading {
            read_noise_e: s.read_noise_e,
            dn_per_e: e.dn_per_e,
            u: [&of_read, &reset[1]],
            telegraph_e: telegraph_e.as_ref(),
        },
    );
    if let Some(dual) = &e.dual_gain {
        let u = match dual.read_noise_e != 0.0 || s.adc_noise_dn != 0.0 {
            true => uniforms(Stream::LowGain, row.row, column, e.frame, e.seed),
            false => [[0.5; LANES]; 2],
        };
        let low = reading(
            row,
            first,
            charge,
            &Reading {
                read_noise_e: dual.read_noise_e,
                dn_per_e: e.dn_per_e / dual.ratio,
                u: [&u[0], &u[1]],
                telegraph_e: telegraph_e.as_ref(),
            },
        );
        std::iter::zip(&mut dn, &low).for_each(|(v, low)| *v = dual.combined(*v, *low, e.black_dn));
    }
    if let Some(curve) = &e.companding {
        dn = dn.map(|v| curve.coded(v));
    }
    dn.map(|v| whole(v, e.max_dn) as u16)
}

/// Telegraph noise of [`LANES`] pixels from `column` of the sensor on, of their numbers `u`; none if none of them has it.
#[inline(always)]
fn telegraph_e(row: &ExposeRow<'_>, column: u32, u: &Lanes) -> Option<Lanes> {
    let e = row.exposer;
    let amplitudes = amplitudes(u, e.defects.telegraph_pixels)?;
    let w = uniforms(Stream::Telegraph, row.row, column, e.frame, e.seed)[0];
    Some(std::array::from_fn(|i| {
        let half = 0.5 * e.defects.telegraph_e * amplitudes[i];
        if w[i] < 0.5 { -half } else { half }
    }))
}

/// One reading of a charge.
struct Reading<'a> {
    read_noise_e: f64,
    dn_per_e: f64,
    /// Uniform numbers of the noises of reading and converter.
    u: [&'a Lanes; 2],
    telegraph_e: Option<&'a Lanes>,
}

/// Numbers before rounding of a reading of `charge` in [`LANES`] pixels from column `first` of the tile on.
#[inline(always)]
fn reading(row: &ExposeRow<'_>, first: usize, mut charge: Lanes, of: &Reading<'_>) -> Lanes {
    let e = row.exposer;
    if of.read_noise_e != 0.0 {
        add_noise(&mut charge, of.read_noise_e, of.u[0]);
    }
    if let Some(telegraph_e) = of.telegraph_e {
        std::iter::zip(&mut charge, telegraph_e).for_each(|(v, e)| *v += e);
    }
    if !row.column_offset_e.is_empty() {
        std::iter::zip(&mut charge, &row.column_offset_e[first..]).for_each(|(v, offset)| *v += offset);
    }
    if e.sigma.row_noise_e != 0.0 {
        charge.iter_mut().for_each(|v| *v += row.offset_e);
    }
    if !row.column_gain.is_empty() {
        std::iter::zip(&mut charge, &row.column_gain[first..]).for_each(|(v, gain)| *v *= 1.0 + gain);
    }
    let mut dn = charge.map(|v| e.black_dn + of.dn_per_e * v);
    if e.sigma.adc_noise_dn != 0.0 {
        add_noise(&mut dn, e.sigma.adc_noise_dn, of.u[1]);
    }
    dn
}

/// Pixels of a raw at its ends.
pub fn clipped(raw: &[u16], white_dn: f64) -> Clipped {
    raw.iter().fold(Clipped::default(), |c, v| Clipped {
        white: c.white + u64::from(f64::from(*v) >= white_dn),
        black: c.black + u64::from(*v == 0),
    })
}

#[cfg(test)]
pub(crate) mod tests;
