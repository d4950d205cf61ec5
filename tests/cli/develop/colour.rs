//! Colours of developed charts.

use super::{CHECKER, linear};
use crate::common::assert_exit;
use crate::common::camera::{LENS, Place, develop};
use formats::chart::image::Transfer;
use formats::sensor::SensorFile;
use pipeline::chart::Generator;
use pipeline::colour::{Illuminant, linear_srgb_to_xyz};
use pipeline::develop::ColourMatrix;
use pipeline::develop::matrix::{difference, patch_targets};
use pipeline::geometry::Rect;
use std::path::Path;

/// Mean ΔE2000 of the patches of a picture, its greys made as bright as they should be.
fn delta_e(path: &Path, chart: &str, light: Illuminant) -> f64 {
    let (size, channels) = linear(path, Transfer::Linear);
    let generator = chart.parse::<Generator>().unwrap();
    let patches = generator.patches_px();
    assert_eq!(patches.len(), 24);
    let mean = |rect: &Rect, c: usize| {
        let inner = Rect::new(rect.y + 5, rect.x + 5, rect.height - 10, rect.width - 10);
        let rows = inner.y as usize..inner.bottom() as usize;
        let line = |y: usize| &channels[c][y * size.width + inner.x as usize..][..inner.width];
        rows.flat_map(line).map(|v| f64::from(*v)).sum::<f64>() / inner.size().pixels() as f64
    };
    let found: Vec<[f64; 3]> = patches.iter().map(|p| std::array::from_fn(|c| mean(p, c))).collect();
    let targets = patch_targets(light);
    let luminance = |v: &[f64; 3]| linear_srgb_to_xyz(*v)[1];
    let greys = |all: &[[f64; 3]]| all[18..22].iter().map(luminance).sum::<f64>();
    let scale = greys(&targets) / greys(&found);
    let all = std::iter::zip(found, targets).map(|(f, t)| difference(f.map(|v| v * scale), t));
    all.sum::<f64>() / 24.0
}

#[test]
fn photographs_of_a_checker_have_the_error_of_their_matrix() {
    let place = Place::new();
    for (light, chart) in
        [(Illuminant::D65, CHECKER.to_owned()), (Illuminant::A, format!("{CHECKER}&illuminant=A"))]
    {
        let film = place.run(&chart);
        for (name, expected, noise) in
            [("example-2um", [0.79, 0.88], "all"), ("ideal-xyz", [0.0, 0.0], "none")]
        {
            let raw = place.raw(
                "raw.zarr",
                &film,
                &["--sensor", name, "--exposure", "auto", "--noise", noise, "--overwrite"],
            );
            let picture = place.at("picture.exr");
            // Linear floats: the colour of patch 17 has negative red.
            let flags = ["--shading", LENS, "--overwrite"];
            assert_exit(&develop(&raw, &picture, &flags), 0, &["ΔE2000", &format!("white {}", light.name())]);
            let found = delta_e(&picture, &chart, light);
            let expected = expected[usize::from(light == Illuminant::A)];
            // Bands of 10 nm from 400 to 700 nm cost a mean of 0.14 (D65) and 0.20 (A) by themselves.
            let allowed = if noise == "none" { 0.21 } else { 0.3 };
            assert!((found - expected).abs() <= allowed, "{name} {light:?}: {found} for {expected}");
        }
        std::fs::remove_dir_all(film).unwrap();
    }
}

/// Infrared pixels see nothing of the visible light: no gain for a white, no column of the matrix.
#[test]
fn mosaics_with_infrared_and_quads_have_the_colours_of_their_matrix() {
    let place = Place::new();
    let film = place.run(CHECKER);
    std::fs::write(
        place.at("qe.csv"),
        "wavelength_nm,R,G,B,IR\n380,0,0.02,0.2,0\n450,0.02,0.1,0.55,0\n500,0.05,0.4,0.3,0\n540,0.08,0.6,0.1,0\n600,0.55,0.2,0.05,0\n650,0.5,0.1,0.02,0\n700,0,0,0,0.01\n760,0,0,0,0.3\n900,0,0,0,0.2\n",
    )
    .unwrap();
    let infrared = r#"[["B","G","R","G"],["G","I","G","I"],["R","G","B","G"],["G","I","G","I"]]"#;
    let quad = r#"[["R","R","G","G"],["R","R","G","G"],["G","G","B","B"],["G","G","B","B"]]"#;
    for (name, pattern, more) in [("rgb-ir", infrared, "I = { column = \"IR\" }"), ("quad", quad, "")] {
        let file = place.at(&format!("{name}.toml"));
        let text = format!(
            "schema = \"lenscube/sensor/1\"\nname = \"{name}\"\ndescription = \"a test\"\n[pixel]\npitch_um = 2.0\nfull_well_e = 100000\n\
             [adc]\nbits = 16\ngain_dn_per_e = 0.5\nblack_dn = 64\n[spectral]\nfile = \"qe.csv\"\nquantity = \"quantum_efficiency\"\n\
             [cfa]\npattern = {pattern}\nR = {{ column = \"R\" }}\nG = {{ column = \"G\" }}\nB = {{ column = \"B\" }}\n{more}\n[source]\n\"*\" = \"a test\"\n"
        );
        std::fs::write(&file, text).unwrap();
        let named = file.to_str().unwrap();
        let raw = place.raw(&format!("{name}.zarr"), &film, &["--sensor", named, "--exposure", "auto"]);
        let picture = place.at(&format!("{name}.exr"));
        develop(&raw, &picture, &["--shading", LENS]).ok();
        let sensor = SensorFile::open(named, &[]).unwrap().sensor(2.0);
        let expected = ColourMatrix::fitted(&sensor, Illuminant::D65).unwrap();
        if let Some(plane) = sensor.planes().iter().position(|p| *p == "I") {
            assert!(
                expected.rows.iter().all(|row| row[plane] == 0.0)
                    && sensor.white_gains(Illuminant::D65)[3] == 1.0
            );
        }
        let found = delta_e(&picture, CHECKER, Illuminant::D65);
        assert!(
            (found - expected.mean_delta_e()).abs() < 0.5,
            "{name}: {found} for {}",
            expected.mean_delta_e()
        );
    }
}
