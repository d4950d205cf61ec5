//! Mean and variance of numbers in every segment against sums over all charges and readings in float64 (tests/golden/sensor/make_range_golden.py).

use super::*;
use crate::geometry::{Rect, Size};
use crate::sensor::emva::Bench;
use crate::sensor::noise::Exposer;
use crate::sensor::noise::tests::{example, exposure};
use crate::sensor::{Adc, Companding, Exposure, NoiseFigures, NoiseSet, Sensor};

const SIZE: Size = Size::new(512, 512);

/// The sensors of the model.
fn sensor(case: &str) -> Sensor {
    let curve = |linear_dn: &[f64], coded_dn: &[f64]| {
        Some(Companding { linear_dn: linear_dn.to_vec(), coded_dn: coded_dn.to_vec() })
    };
    let dual = |ratio, bits, read_noise_e, transition_dn| {
        Some(DualGain { ratio, bits, read_noise_e, transition_dn })
    };
    let (gain_dn_per_e, bits, dual_gain, companding) = match case {
        "companding" => {
            (4.0, 12, None, curve(&[0.0, 1024.0, 16384.0, 65535.0], &[0.0, 1024.0, 2944.0, 4095.0]))
        }
        "dual" => (2.0, 16, dual(8.0, 12, 5.0, (3000.0, 3000.0)), None),
        _ => (
            8.0,
            12,
            dual(64.0, 14, 20.0, (14000.0, 15500.0)),
            curve(&[0.0, 1024.0, 32768.0, 1_048_575.0], &[0.0, 1024.0, 2048.0, 4095.0]),
        ),
    };
    let mut sensor = example();
    sensor.pixel.full_well_e = 125_000.0;
    sensor.pixel.dark_current_e_per_s = 0.0;
    sensor.noise = NoiseFigures { read_noise_e: 1.5, adc_noise_dn: 0.73, ..NoiseFigures::default() };
    sensor.adc = Adc { bits, gain_dn_per_e, dual_gain, companding, ..sensor.adc };
    sensor
}

fn numbers(sensor: &Sensor, charge_e: f64, rect: Rect, noise: NoiseSet) -> Vec<u16> {
    let signal = vec![(charge_e / exposure().seconds) as f32; rect.size().pixels()];
    let mut out = vec![0; signal.len()];
    Exposer::new(sensor, &Exposure { noise, ..exposure() }).expose(&signal, rect, &mut out);
    out
}

fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / n)
}

/// Five standard errors: of a mean σ/√N, of a variance √(2/N). The formula of variances leaves out what the choice of a reading adds.
#[test]
fn means_and_variances_are_those_of_the_float64_model() {
    let golden = include_str!("../../../tests/data/range.csv");
    for line in golden.lines().skip(1) {
        let mut words = line.split(',');
        let case = words.next().unwrap();
        let [charge_e, mean, variance] =
            std::array::from_fn(|_| words.next().unwrap().parse::<f64>().unwrap());
        let sensor = sensor(case);
        let stored = numbers(&sensor, charge_e, SIZE.rect(), NoiseSet::ALL);
        let linear: Vec<f64> = stored.iter().map(|v| sensor.adc.linear_dn((*v).into())).collect();
        let (got_mean, got_variance) = moments(&linear);
        let n = SIZE.pixels() as f64;
        let far = (got_mean - mean).abs() / (variance / n).sqrt();
        assert!(far < 5.0, "{line}: mean {got_mean}, {far} standard errors");
        assert!(
            (got_variance / variance - 1.0).abs() < 5.0 * (2.0 / n).sqrt(),
            "{line}: variance {got_variance}"
        );
        let stated = sensor.noise_variance(NoiseSet::ALL, 1.0, charge_e, 0.0);
        let stated = stated.temporal_e2() * sensor.adc.gain_dn_per_e * sensor.adc.gain_dn_per_e;
        // At knee points and in a transition half of the pixels are on either side.
        let next_to = [1372.0, 96.0, 190.0, 4064.0, 1750.0].contains(&charge_e);
        let limit = if next_to { 0.05 } else { 0.005 };
        assert!((stated / variance - 1.0).abs() < limit, "{line}: stated {stated}");
    }
}

#[test]
fn windows_have_the_bits_of_the_whole_and_nothing_else_changes_them() {
    let sensor = sensor("both");
    let whole = numbers(&sensor, 1750.0, SIZE.rect(), NoiseSet::ALL);
    let window = Rect::new(100, 37, 20, 90);
    let part: Vec<u16> = (0..window.size().pixels())
        .map(|k| whole[(100 + k / window.width) * SIZE.width + 37 + k % window.width])
        .collect();
    assert_eq!(numbers(&sensor, 1750.0, window, NoiseSet::ALL), part);
}

#[test]
fn white_and_saturation_are_those_of_the_low_gain() {
    let sensor = sensor("both");
    assert_eq!(sensor.saturation_e(1.0), 125_000.0);
    assert_eq!(sensor.saturation_e(2.0), 64.0 * (16383.0 - 256.0) / 16.0);
    for gain in [1.0, 2.0, 4.0] {
        // A full pixel without noise has the number of white.
        let (mut out, rect) = ([0], Rect::new(0, 0, 1, 1));
        let still = Exposure { gain, noise: NoiseSet::NONE, ..exposure() };
        Exposer::new(&sensor, &still).expose(&[1e9], rect, &mut out);
        assert_eq!(sensor.adc.linear_dn(out[0].into()), sensor.white_dn(gain), "{gain}");
        assert_eq!(sensor.adc.linear_table().unwrap()[usize::from(out[0])], sensor.white_dn(gain) as f32);
    }
}

/// What a laboratory measures of the linearized numbers.
#[test]
fn photon_transfer_of_linear_numbers_gives_gain_and_dark_noise() {
    for case in ["dual", "both"] {
        let sensor = sensor(case);
        let bench = Bench { sensor: &sensor, quantum_efficiency: 0.5, seconds: 0.01, seed: 1, die: 1 };
        let (got, stated) = (bench.measure(), bench.stated());
        for (name, got, stated, limit) in [
            ("K", got.dn_per_e, stated.dn_per_e, 0.005),
            ("QE", got.quantum_efficiency, stated.quantum_efficiency, 0.005),
            ("dark noise", got.dark_noise_e, stated.dark_noise_e, 0.01),
        ] {
            assert!((got / stated - 1.0).abs() < limit, "{case}, {name}: {got}, stated {stated}");
        }
        let off = got.saturation_photons - stated.saturation_e / 0.5;
        assert!(off.abs() <= bench.saturation_tolerance_photons(), "{case}: {off}");
    }
}
