//! Colours of developed charts.

use super::{CHECKER, linear};
use crate::common::assert_exit;
use crate::common::camera::{LENS, Place, develop};
use formats::chart::image::Transfer;
use pipeline::chart::Generator;
use pipeline::colour::{Illuminant, linear_srgb_to_xyz};
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
