use super::*;
use crate::sensor::{
    Adc, Channel, Curve, Defects, NoiseSpectrum, Overflow, Pattern, Pixel, QuantumEfficiencyOf,
};

/// The figures of the built-in sensor example-2um.
pub(crate) fn example() -> Sensor {
    let channel = |name: &str| Channel {
        name: name.into(),
        plane: name.into(),
        curve: Curve { wavelengths_nm: vec![1.0, 1e5], values: vec![1.0, 1.0] },
    };
    Sensor {
        name: "example".into(),
        description: String::new(),
        pixel: Pixel {
            pitch_um: 2.0,
            size: None,
            aperture_um: 2.0,
            quantum_efficiency_of: QuantumEfficiencyOf::Pixel,
            full_well_e: 13600.0,
            overflow: Overflow::NONE,
            dark_current_e_per_s: 3.0,
            dark_reference_c: 25.0,
            dark_doubling_k: 6.5,
        },
        noise: NoiseFigures {
            read_noise_e: 1.5,
            adc_noise_dn: 0.73,
            dsnu_e: 1.0,
            prnu: 0.007,
            dark_nonuniformity: 0.1,
            column_offset_e: 0.3,
            row_noise_e: 0.3,
            ..NoiseFigures::default()
        },
        noise_spectrum: NoiseSpectrum::default(),
        defects: Defects::default(),
        row_time_s: 0.0,
        adc: Adc {
            bits: 12,
            gain_dn_per_e: 0.28,
            black_dn: 256.0,
            gains: vec![],
            base_iso: Some(100.0),
            dual_gain: None,
            companding: None,
        },
        channels: ["R", "G", "B"].map(channel).into(),
        per_energy: false,
        filters: vec![],
        plates: vec![],
        angle: None,
        crosstalk: None,
        pattern: Pattern { rows: 2, columns: 2, channels: vec![0, 1, 1, 2] },
    }
}

pub(crate) fn exposure() -> Exposure {
    Exposure {
        seconds: 0.01,
        gain: 1.0,
        scale: 1.0,
        seed: 7,
        die: 3,
        frame: 0,
        noise: NoiseSet::ALL,
        temperature_c: None,
        flicker: None,
    }
}

/// linspace(0, 2·10⁵, 96) along rows plus linspace(0, 10⁶, 128) along columns.
fn ramp(factor: f32) -> Vec<f32> {
    let line =
        |i: usize, n: usize, end: f64| if i + 1 == n { end } else { i as f64 * (end / (n - 1) as f64) };
    let at = |k: usize| (line(k / 128, 96, 2e5) + line(k % 128, 128, 1e6)) as f32 * factor;
    (0..96 * 128).map(at).collect()
}

const TILE: Rect = Rect::new(0, 0, 96, 128);

fn raw(signal: &[f32], rect: Rect, sensor: &Sensor, e: &Exposure) -> Vec<u16> {
    let mut out = vec![0; signal.len()];
    Exposer::new(sensor, e).expose(signal, rect, &mut out);
    out
}

fn crc32(values: &[u16]) -> u32 {
    !values.iter().flat_map(|v| v.to_le_bytes()).fold(!0, |crc: u32, byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
    })
}

/// The checksum is that of the float64 reference (tests/golden/sensor/sensor_reference.py).
#[test]
fn raw_has_the_reference_bits_by_every_instruction_set() {
    let (signal, sensor) = (ramp(1.0), example());
    for set in Set::available() {
        let mut out = vec![0; signal.len()];
        let exposer = Exposer { set, ..Exposer::new(&sensor, &exposure()) };
        exposer.expose(&signal, TILE, &mut out);
        assert_eq!(crc32(&out), 0x2a62_7790, "{set:?}");
    }
}

#[test]
fn windows_have_the_bits_of_the_whole() {
    let (signal, sensor) = (ramp(1.0), example());
    let whole = raw(&signal, TILE, &sensor, &exposure());
    for window in [Rect::new(40, 50, 30, 40), Rect::new(95, 127, 1, 1), Rect::new(3, 0, 5, 128)] {
        let part: Vec<usize> = (0..window.size().pixels())
            .map(|k| (window.y as usize + k / window.width) * 128 + window.x as usize + k % window.width)
            .collect();
        let own: Vec<f32> = part.iter().map(|&k| signal[k]).collect();
        let expected: Vec<u16> = part.iter().map(|&k| whole[k]).collect();
        assert_eq!(raw(&own, window, &sensor, &exposure()), expected, "{window}");
    }
}

#[test]
fn seeds_and_frames_change_noise_and_the_die_stays() {
    let (signal, sensor) = (ramp(1.0), example());
    let whole = raw(&signal, TILE, &sensor, &exposure());
    let differ = |e: &Exposure| {
        let other = raw(&signal, TILE, &sensor, e);
        std::iter::zip(&whole, &other).filter(|(a, b)| a != b).count() as f64 / whole.len() as f64
    };
    assert!(differ(&Exposure { seed: 8, ..exposure() }) > 0.9);
    assert!(differ(&Exposure { frame: 1, ..exposure() }) > 0.9);
    let still = |die, seed| {
        let fixed = "dsnu,prnu,column".parse().unwrap();
        raw(&signal, TILE, &sensor, &Exposure { noise: fixed, die, seed, ..exposure() })
    };
    assert_eq!(still(3, 7), still(3, 8));
    assert_ne!(still(3, 7), still(4, 7));
}

#[test]
fn raw_without_noise_equals_the_formula() {
    let (signal, sensor) = (ramp(1.0), example());
    let still = raw(&signal, TILE, &sensor, &Exposure { noise: NoiseSet::NONE, ..exposure() });
    for (raw, s) in std::iter::zip(still, signal) {
        let charge = (f64::from(s) * 0.01).min(13600.0);
        assert_eq!(f64::from(raw), (256.0 + 0.28 * charge + 0.5).floor().clamp(0.0, 4095.0));
    }
    let flooded = raw(&ramp(1e6), TILE, &sensor, &exposure());
    let mean = flooded.iter().map(|v| f64::from(*v)).sum::<f64>() / flooded.len() as f64;
    assert!((mean - sensor.white_dn(1.0)).abs() < 5.0, "{mean}");
}

/// One step down is allowed: at the seam of the two Poisson methods.
#[test]
fn under_one_seed_more_light_never_shows_darker() {
    let sensor = example();
    let (less, more) =
        (raw(&ramp(1.0), TILE, &sensor, &exposure()), raw(&ramp(1.01), TILE, &sensor, &exposure()));
    assert!(std::iter::zip(less, more).all(|(a, b)| i32::from(b) >= i32::from(a) - 1));
}

/// Means of 64 frames of a uniform signal within five standard errors.
#[test]
fn mean_of_frames_is_the_mean_charge() {
    let sensor = example();
    let signal = vec![2e5f32; 64 * 64];
    let rect = Rect::new(0, 0, 64, 64);
    let noise = "shot,dark,read,adc,reset".parse().unwrap();
    let mut sum = 0.0;
    for frame in 0..64 {
        let out = raw(&signal, rect, &sensor, &Exposure { frame, noise, ..exposure() });
        sum += out.iter().map(|v| f64::from(*v)).sum::<f64>();
    }
    let n = 64.0 * 64.0 * 64.0;
    let electrons = 2000.0 + 0.03;
    let variance = 0.28f64.powi(2) * (electrons + 1.5 * 1.5) + 0.73 * 0.73 + 1.0 / 12.0;
    let error = sum / n - (256.0 + 0.28 * electrons);
    assert!(error.abs() < 5.0 * (variance / n).sqrt(), "{error}");
}

/// Row noise of a power law has the variance of white noise, is alike in neighbouring rows, and is that of the whole in any window.
#[test]
fn rows_and_columns_of_a_power_law_are_correlated_and_keep_their_variance() {
    let mut sensor = example();
    sensor.noise = NoiseFigures { row_noise_e: 100.0, column_offset_e: 100.0, ..NoiseFigures::default() };
    sensor.adc.black_dn = 2000.0;
    let size = Rect::new(0, 0, 40, 30);
    let frame = |sensor: &Sensor, rect: Rect, noise: &str, frame: u32| {
        let e = Exposure { frame, noise: noise.parse().unwrap(), ..exposure() };
        raw(&vec![0.0; rect.size().pixels()], rect, sensor, &e)
    };
    let white = frame(&sensor, size, "row,column", 0);
    sensor.noise_spectrum = NoiseSpectrum { row_exponent: 1.0, column_exponent: 1.0 };
    let whole = frame(&sensor, size, "row,column", 0);
    assert_ne!(whole, white);
    let window = Rect::new(7, 11, 20, 9);
    let part: Vec<u16> = (0..180).map(|k| whole[(7 + k / 9) * 30 + 11 + k % 9]).collect();
    assert_eq!(frame(&sensor, window, "row,column", 0), part);
    let (mut variance, mut steps) = (0.0, 0.0);
    let frames = 400;
    for k in 0..frames {
        let rows: Vec<f64> =
            frame(&sensor, size, "row", k).chunks(30).map(|row| f64::from(row[0]) - 2000.0).collect();
        variance += rows.iter().map(|v| v * v).sum::<f64>() / 40.0;
        steps += rows.windows(2).map(|v| (v[1] - v[0]) * (v[1] - v[0])).sum::<f64>() / 39.0;
    }
    // 100 e- are 28 DN; within a frame rows are alike, so that each counts for few.
    let (variance, steps) = (variance / f64::from(frames) / 784.0, steps / f64::from(frames) / 784.0);
    assert!((variance - 1.0).abs() < 0.2, "{variance}");
    // White noise: 2.
    assert!(steps < 1.0, "{steps}");
}
