//! Spectra of bases against the colours that they stand for.

use super::*;
use crate::colour::{srgb_weights, xyz_weights};
use crate::reflectance::EXACT;
use std::f64::consts::PI;

fn bands() -> Vec<f64> {
    (0..31).map(|i| 400.0 + 10.0 * f64::from(i)).collect()
}

fn named() -> Spectrum {
    Spectrum::new("paint", vec![380.0, 500.0, 600.0, 780.0], vec![0.1, 0.3, 0.9, 0.9], 1.0).unwrap()
}

#[test]
fn white_has_the_reflectance_1_and_the_luminance_of_the_illuminance() {
    let basis = bases(&[], &[LightSpectrum::Illuminant]);
    for light in Illuminant::ALL {
        let found = spectra(&basis, &bands(), &SceneIlluminant::Cie(light), 1000.0, EXACT).unwrap();
        let scale = light.irradiance_scale(1000.0);
        let mut luminance = 0.0;
        for (band, (&nm, xyz)) in bands().iter().zip(xyz_weights(&bands())).enumerate() {
            let white: f64 = found.radiance.iter().map(|s| s[band]).sum();
            let expected = scale * light.relative_power(nm) / PI;
            assert!((white / expected - 1.0).abs() < 1e-12, "{white} {expected}");
            luminance += white * xyz[1];
        }
        // Bands of 10 nm from 400 nm on.
        assert!((luminance / (1000.0 / PI) - 1.0).abs() < 3e-3, "{luminance}");
        assert!(found.colour_error.0 <= EXACT);
    }
}

#[test]
fn colours_are_those_of_the_weights_and_linear_in_them() {
    let basis = bases(&[], &[LightSpectrum::Illuminant]);
    let light = SceneIlluminant::Cie(Illuminant::A);
    let found = spectra(&basis, &bands(), &light, 500.0, EXACT).unwrap().radiance;
    let white: Vec<f64> = (0..31).map(|b| found.iter().map(|s| s[b]).sum()).collect();
    let power = |nm: f64| Illuminant::A.relative_power(nm);
    let srgb = srgb_weights(&bands(), power);
    let unit = white[16] / power(560.0);
    for weights in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.2, 0.5, 0.9]] {
        let radiance = |b: usize| (0..3).map(|c| weights[c] * found[c][b]).sum::<f64>() / unit;
        for c in 0..3 {
            let seen: f64 = (0..31).map(|b| radiance(b) * srgb[b][c]).sum();
            assert!((seen - weights[c]).abs() < 2.0 * EXACT, "{seen} of {weights:?}");
        }
    }
}

#[test]
fn a_measured_illuminant_with_the_table_of_d65_is_d65() {
    let nm: Vec<f64> = (0..81).map(|i| 380.0 + 5.0 * f64::from(i)).collect();
    let power = nm.iter().map(|&nm| 0.02 * Illuminant::D65.relative_power(nm)).collect();
    let measured = SceneIlluminant::Measured(Spectrum::new("lamp", nm, power, f64::INFINITY).unwrap());
    let basis = bases(&[named()], &[LightSpectrum::Illuminant]);
    let of = |light| spectra(&basis, &bands(), light, 1000.0, EXACT).unwrap().radiance;
    let (a, b) = (of(&measured), of(&SceneIlluminant::Cie(Illuminant::D65)));
    for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
        // Normalised to their peak or to 100, the programme stops at 1e-7.
        assert!((a - b).abs() < 1e-5 * b.abs().max(0.01), "{a} {b}");
    }
}

#[test]
fn named_spectra_are_linear_between_their_wavelengths_and_errors_beyond() {
    let paint = named();
    for (nm, expected) in [(380.0, 0.1), (440.0, 0.2), (500.0, 0.3), (550.0, 0.6), (700.0, 0.9), (780.0, 0.9)]
    {
        assert!((paint.at(nm).unwrap() - expected).abs() < 1e-15, "{nm}");
    }
    let error = paint.at(900.0).unwrap_err().to_string();
    assert_eq!(error, "spectrum `paint` ends at 380 and 780 nm and has no value at 900 nm");
    assert!(paint.at(379.999).is_err());
    let basis = bases(&[paint], &[LightSpectrum::Illuminant]);
    let light = SceneIlluminant::Cie(Illuminant::E);
    // Two bands have no colours; any error of them is accepted here.
    let found = spectra(&basis, &[440.0, 550.0], &light, 1000.0, 10.0).unwrap().radiance;
    let white = Illuminant::E.irradiance_scale(1000.0) * 100.0 / PI;
    assert!((found[3][0] / white - 0.2).abs() < 1e-14 && (found[3][1] / white - 0.6).abs() < 1e-14);
    assert!(matches!(
        spectra(&basis, &[800.0], &light, 1.0, 1.0),
        Err(SpectraError::Spectrum(_) | SpectraError::Colours(_))
    ));
    assert!(matches!(spectra(&basis, &[550.0], &light, 1.0, EXACT), Err(SpectraError::Colours(_))));
}

#[test]
fn spectra_that_are_none_are_errors() {
    let error = |nm: &[f64], values: &[f64]| {
        Spectrum::new("s", nm.to_vec(), values.to_vec(), 1.0).unwrap_err().to_string()
    };
    assert!(error(&[], &[]).contains("0 wavelengths and 0 values"));
    assert!(error(&[1.0], &[1.0, 1.0]).contains("1 wavelengths and 2 values"));
    assert_eq!(
        error(&[400.0, 400.0], &[0.0, 0.0]),
        "spectrum `s`: the wavelength after 400 nm is 400 nm; they must increase"
    );
    assert_eq!(error(&[400.0, 500.0], &[0.5, 1.5]), "spectrum `s` is 1.5 at 500 nm; expected 0 to 1");
    assert!(error(&[f64::NAN], &[0.5]).contains("NaN"));
    assert!(error(&[400.0], &[f64::NAN]).contains("NaN"));
    let dark = Spectrum::new("infrared", vec![800.0, 900.0], vec![1.0, 1.0], f64::INFINITY).unwrap();
    let basis = bases(&[], &[LightSpectrum::Illuminant]);
    let error = spectra(&basis, &[850.0], &SceneIlluminant::Measured(dark), 1.0, 1.0).unwrap_err();
    assert!(error.to_string().contains("`infrared` has no power that is visible"));
}

#[test]
fn coloured_lights_multiply_reflectances() {
    let lights = [LightSpectrum::Illuminant, LightSpectrum::Colour([1.0, 0.5, 0.0])];
    let basis = bases(&[named()], &lights);
    let kinds: Vec<&str> = basis.iter().map(Basis::kind).collect();
    let one = ["red", "green", "blue", "spectrum"];
    assert_eq!(kinds, [one, one].concat());
    assert_eq!((basis[3].name(), basis[0].name()), ("paint", "red"));
    let light = SceneIlluminant::Cie(Illuminant::D65);
    let found = spectra(&basis, &bands(), &light, 1000.0, EXACT).unwrap().radiance;
    for band in 0..31 {
        let white: f64 = found[..3].iter().map(|s| s[band]).sum();
        let colour = (found[0][band] + 0.5 * found[1][band]) / white;
        for r in 0..4 {
            assert!((found[4 + r][band] - found[r][band] * colour).abs() < 1e-15);
        }
    }
}
