use super::*;

fn axis(film_px: usize, film_pitch_um: f64, sensor_px: usize, pitch_um: f64) -> Axis {
    Axis { film_px, film_pitch_um, sensor_px, pitch_um, aperture_um: pitch_um, centre_um: 0.0 }
}

fn taps(axis: Axis, resample: Resample) -> Taps {
    axis.taps(0..axis.sensor_px, resample).unwrap()
}

const BOTH: [Resample; 2] = [Resample::Area, Resample::Cubic];

#[test]
fn one_to_one_is_the_film_and_k_to_one_the_mean_of_k() {
    for resample in BOTH {
        let copy = taps(axis(24, 2.0, 24, 2.0), resample);
        assert!(copy.is_copy() && (0..24).all(|i| copy.of(i) == (i, &[1.0][..])));
        let mean = taps(axis(24, 2.0, 8, 6.0), resample);
        assert!((0..8).all(|i| mean.of(i) == (3 * i, &[1.0 / 3.0; 3][..])));
        // The photodiode of a third of the pitch, in the middle.
        let small = taps(Axis { aperture_um: 2.0, ..axis(9, 2.0, 3, 6.0) }, resample);
        assert!((0..3).all(|i| small.of(i) == (3 * i + 1, &[1.0][..])));
    }
}

#[test]
fn resampling_conserves_light() {
    for resample in BOTH {
        let t = taps(axis(36, 2.0, 13, 5.5), resample);
        let mut seen = [0.0; 36];
        for i in 0..13 {
            let (first, weights) = t.of(i);
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            weights.iter().enumerate().for_each(|(k, w)| seen[first + k] += w);
        }
        assert!(seen[6..30].iter().all(|w| (w - 2.0 / 5.5).abs() < 1e-12), "{seen:?}");
    }
}

#[test]
fn whole_ratios_are_snapped_to_film_edges() {
    assert_eq!(axis(25, 2.0, 12, 4.0).snapped().centre_um.abs(), 1.0);
    assert_eq!(axis(24, 2.0, 12, 4.0).snapped().centre_um, 0.0);
    assert_eq!(axis(25, 2.0, 9, 5.5).snapped().centre_um, 0.0);
    let t = taps(axis(25, 2.0, 12, 4.0).snapped(), Resample::Cubic);
    assert!((0..12).all(|i| t.of(i).1 == [0.5, 0.5]));
}

#[test]
fn sensor_beyond_the_film_is_an_error() {
    assert!(axis(24, 2.0, 9, 5.5).taps(0..9, Resample::Cubic).is_err());
}

#[test]
fn a_part_of_the_sensor_has_the_weights_of_the_whole() {
    let axis = axis(36, 2.0, 13, 5.5);
    let (whole, part) = (taps(axis, Resample::Cubic), axis.taps(4..9, Resample::Cubic).unwrap());
    assert!((0..5).all(|i| part.of(i) == whole.of(i + 4)));
}

/// Errors of full modulation at the sensor's Nyquist frequency, worst place: area, cubic (float64 reference).
#[test]
fn nyquist_errors_are_those_of_the_reference() {
    for (ratio, area, cubic) in [
        (1.25, 0.40, 0.30),
        (1.5, 0.22, 0.11),
        (2.0, 0.19, 0.07),
        (2.5, 0.09, 0.02),
        (2.75, 0.09, 0.02),
        (4.0, 0.05, 0.006),
    ] {
        let (a, c) = (nyquist_error(ratio, Resample::Area), nyquist_error(ratio, Resample::Cubic));
        println!("{ratio}: area {a:.4} cubic {c:.4}");
        assert!((a - area).abs() < 0.006 + 0.05 * area, "{ratio}: area {a}");
        assert!((c - cubic).abs() < 0.006 + 0.05 * cubic, "{ratio}: cubic {c}");
    }
}
