use super::*;
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use crate::sensor::diffusion::{RADIUS, Silicon};
use crate::sensor::noise::tests::example;
use crate::sensor::pixels::{Axis, Resample};
use crate::sensor::spread::{SpreadRows, run};
use crate::sensor::stream::tests::Film;
use crate::sensor::stream::{BandWeights, Pass};
use std::sync::atomic::AtomicBool;

const BANDS_NM: [f64; 4] = [450.0, 500.0, 560.0, 650.0];

/// Lines of the float64 models: what, five numbers, row, column, value.
fn golden(what: &str) -> Vec<[f64; 8]> {
    let text = include_str!("../../../tests/data/crosstalk.csv");
    let lines = text.lines().filter_map(|line| line.strip_prefix(what)?.strip_prefix(','));
    let rows: Vec<[f64; 8]> = lines
        .map(|line| {
            let numbers: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
            numbers.try_into().unwrap()
        })
        .collect();
    assert!(!rows.is_empty());
    rows
}

/// The sensor of the float64 model.
fn sensor(crosstalk: Option<Crosstalk>) -> Sensor {
    let channel = |(name, nm, values): (&str, [f64; 4], [f64; 4])| Channel {
        name: name.into(),
        plane: name.into(),
        curve: Curve { wavelengths_nm: nm.into(), values: values.into() },
    };
    let channels = [
        ("R", [400.0, 560.0, 620.0, 700.0], [0.02, 0.1, 0.6, 0.5]),
        ("G", [400.0, 530.0, 600.0, 700.0], [0.1, 0.65, 0.3, 0.1]),
        ("B", [400.0, 460.0, 520.0, 700.0], [0.4, 0.7, 0.2, 0.03]),
    ];
    Sensor { channels: channels.map(channel).into(), crosstalk, ..example() }
}

/// Shares at wavelengths of the pixels (down, right) around.
fn table(radius: usize, wavelengths_nm: &[f64], columns: &[((isize, isize), &[f64])]) -> Crosstalk {
    let side = 2 * radius + 1;
    let row = |k: usize| {
        let mut shares = vec![0.0; side * side];
        for ((down, right), values) in columns {
            let at = |v: isize| (radius as isize + v) as usize;
            shares[at(*down) * side + at(*right)] = values[k];
        }
        with_rest(shares)
    };
    Crosstalk {
        radius,
        wavelengths_nm: wavelengths_nm.into(),
        shares: (0..wavelengths_nm.len()).map(row).collect(),
        farther: vec![0.0; wavelengths_nm.len()],
    }
}

fn near() -> Crosstalk {
    table(
        1,
        &[430.0, 550.0, 680.0],
        &[
            ((0, 1), &[0.01, 0.02, 0.05]),
            ((0, -1), &[0.015, 0.02, 0.04]),
            ((1, 0), &[0.01, 0.03, 0.06]),
            ((-1, 0), &[0.02, 0.02, 0.03]),
            ((1, 1), &[0.001, 0.004, 0.02]),
        ],
    )
}

fn far() -> Crosstalk {
    table(3, &[500.0, 600.0], &[((0, 3), &[0.0, 0.04]), ((-2, 1), &[0.03, 0.0]), ((2, -3), &[0.002, 0.01])])
}

/// The signal of `window` of a sensor of the film's pixels.
fn signal(
    sensor: &Sensor,
    film: &dyn ChartSource,
    window: Rect,
    (block, threads): ((usize, usize), usize),
) -> Vec<f32> {
    let size = film.size();
    let weights = BandWeights::electrons(sensor, &BANDS_NM, &[1.0; 4]);
    let planes = [weights];
    let spread = sensor.crosstalk.as_ref().map(|of| SpreadRows::new(size, of.corrections(sensor, &BANDS_NM)));
    let read = spread.as_ref().map_or(window, |spread| spread.reach(window));
    let corrections = spread.as_ref().map(SpreadRows::factors).unwrap_or_default();
    let axis = |pixels: usize| Axis {
        film_px: pixels,
        film_pitch_um: 2.0,
        sensor_px: pixels,
        pitch_um: 2.0,
        aperture_um: 2.0,
        centre_um: 0.0,
    };
    let taps = |n: usize, first: i64, of: usize| {
        axis(n).taps(first as usize..first as usize + of, Resample::Cubic).unwrap()
    };
    let (rows, columns) = (taps(size.height, read.y, read.height), taps(size.width, read.x, read.width));
    let cancel = AtomicBool::new(false);
    let pass = Pass {
        film,
        bands: BANDS_NM.len(),
        sensor,
        rows: &rows,
        columns: &columns,
        window: read,
        planes: &planes,
        corrections: &corrections,
        block,
        bands_at_once: threads,
        threads,
        cancel: &cancel,
    };
    let mut out = Vec::new();
    let mut deliver = |first: usize, planes: &[Vec<f32>]| -> Result<(), SourceSinkError> {
        assert!(first * window.width == out.len() && planes.len() == 1);
        out.extend(&planes[0]);
        Ok(())
    };
    let whole = match &spread {
        None => pass.run(0..window.height, &mut deliver),
        Some(spread) => run(&pass, spread, window, 0..window.height, &mut deliver),
    };
    assert!(whole.unwrap() && out.len() == window.size().pixels());
    out
}

#[test]
fn signals_are_those_of_the_float64_model() {
    let film = Film::noise(Size::new(9, 11), 4);
    for (what, crosstalk) in [("near", near()), ("far", far())] {
        let got = signal(&sensor(Some(crosstalk)), &film, film.size().rect(), ((512, 512), 1));
        for [.., row, column, expected] in golden(what) {
            let got = f64::from(got[row as usize * 11 + column as usize]);
            assert!((got / expected - 1.0).abs() < 2e-6, "{what} {row} {column}: {got} {expected}");
        }
    }
}

#[test]
fn shares_of_diffusion_are_those_of_the_float64_model() {
    for [alpha, length, depletion, pitch, aperture, i, j, expected] in golden("diffusion") {
        let silicon = Silicon { diffusion_length_um: length, depletion_um: depletion };
        let (shares, _) = silicon.shares(alpha, pitch, aperture);
        let got = shares[(RADIUS + i as usize) * (2 * RADIUS + 1) + RADIUS + j as usize];
        assert!((got - expected).abs() < 1e-8, "{alpha} {length} {i} {j}: {got} {expected}");
    }
}

#[test]
fn light_is_kept_and_windows_have_the_same_bits() {
    let film = Film::noise(Size::new(40, 53), 4);
    let whole = film.size().rect();
    let none = signal(&sensor(None), &film, whole, ((512, 512), 1));
    let total = |of: &[f32]| of.iter().map(|v| f64::from(*v)).sum::<f64>();
    // Alike in opposite directions; three times, it reaches three pixels.
    let (side, down) = (&[0.01, 0.04][..], &[0.02, 0.05][..]);
    let even = table(1, &[450.0, 650.0], &[((0, 1), side), ((0, -1), side), ((1, 0), down), ((-1, 0), down)]);
    for crosstalk in [near(), far(), near().and(&far()), even.clone(), even.and(&even).and(&even)] {
        let sensor = sensor(Some(crosstalk));
        let all = signal(&sensor, &film, whole, ((512, 512), 2));
        assert!(all != none && (total(&all) / total(&none) - 1.0).abs() < 1e-7);
        for (window, block) in [
            (Rect::new(0, 0, 40, 53), ((7, 16), 3)),
            (Rect::new(11, 5, 20, 30), ((5, 9), 2)),
            (Rect::new(38, 50, 2, 3), ((40, 53), 1)),
            (Rect::new(1, 0, 3, 53), ((1, 1), 4)),
        ] {
            let part = signal(&sensor, &film, window, block);
            for (i, line) in part.chunks(window.width).enumerate() {
                let from = (window.y as usize + i) * 53 + window.x as usize;
                assert_eq!(line, &all[from..from + window.width], "{window:?}");
            }
        }
    }
    let zero = table(1, &[500.0], &[((0, 1), &[0.0])]);
    assert!(signal(&sensor(Some(zero)), &film, whole, ((16, 16), 2)) == none);
}

/// Far from the edges of a picture of one colour each filter responds as the curves that colours are fitted with.
#[test]
fn a_uniform_picture_has_the_responses_in_uniform_light() {
    struct Uniform;
    impl ChartSource for Uniform {
        fn size(&self) -> Size {
            Size::new(24, 24)
        }

        fn read(&self, band: usize, _: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
            out.fill([0.3, 1.0, 0.7, 0.2][band]);
            Ok(())
        }
    }
    for crosstalk in [near(), near().and(&far())] {
        let sensor = sensor(Some(crosstalk));
        let got = signal(&sensor, &Uniform, Size::new(24, 24).rect(), ((512, 512), 1));
        let uniform = sensor.in_uniform_light();
        for channel in 0..3 {
            let weights = uniform.band_weights(channel, &BANDS_NM);
            let expected: f64 =
                std::iter::zip(weights, [0.3, 1.0, 0.7, 0.2]).map(|(w, e)| w * e * 4e-12).sum();
            let places = (12..14).flat_map(|y| (12..14).map(move |x| (y, x)));
            let own: Vec<f64> = places
                .filter(|(y, x)| sensor.pattern.channel(*y, *x) == channel)
                .map(|(y, x)| f64::from(got[y * 24 + x]))
                .collect();
            let mean = own.iter().sum::<f64>() / own.len() as f64;
            // Curves of the products have nodes every 5 nm.
            assert!((mean / expected - 1.0).abs() < 2e-4, "{channel}: {mean} {expected}");
        }
    }
}

#[test]
fn one_kernel_after_another_moves_charge_twice() {
    let (a, b) = (
        table(1, &[500.0], &[((0, 1), &[0.1])]),
        table(1, &[400.0, 600.0], &[((0, 1), &[0.2, 0.4]), ((1, 0), &[0.1, 0.1])]),
    );
    let both = a.and(&b);
    assert_eq!((both.radius, both.wavelengths_nm.clone()), (2, vec![400.0, 500.0, 600.0]));
    let at = |down: usize, right: usize, nm: f64| both.share_at((2 + down) * 5 + 2 + right, nm);
    for (got, expected) in [
        (at(0, 1, 500.0), 0.1 * 0.6 + 0.9 * 0.3),
        (at(0, 2, 500.0), 0.1 * 0.3),
        (at(1, 1, 500.0), 0.1 * 0.1),
        (at(0, 0, 400.0), 0.9 * 0.7),
        (at(0, 1, 700.0), 0.1 * 0.5 + 0.9 * 0.4),
    ] {
        assert!((got - expected).abs() < 1e-15, "{got} {expected}");
    }
    assert!(both.farther.iter().all(|share| share.abs() < 1e-15));
    // (0, 4) and (2, −4)… are beyond three pixels: counted where they come from.
    let beyond = far().and(&far());
    assert!(beyond.farther[0] > 0.0 && (beyond.shares[0].iter().sum::<f64>() - 1.0).abs() < 1e-15);
}
