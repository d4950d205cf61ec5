//! Edges, stars and leaves through a Gaussian.

use super::*;

/// Through a Gaussian of `sigma` px along rows and columns; beyond the border as on it.
fn blurred(size: Size, pixels: &[f64], sigma: f64) -> Vec<f64> {
    let reach = (6.0 * sigma).ceil() as i64;
    let kernel: Vec<f64> =
        (-reach..=reach).map(|d| (-((d * d) as f64) / (2.0 * sigma * sigma)).exp()).collect();
    let sum: f64 = kernel.iter().sum();
    let along = |pixels: &[f64], step: (i64, i64)| -> Vec<f64> {
        let at = |i: usize, d: i64| {
            let clamp = |v: i64, n: usize| v.clamp(0, n as i64 - 1) as usize;
            let y = clamp((i / size.width) as i64 + d * step.0, size.height);
            let x = clamp((i % size.width) as i64 + d * step.1, size.width);
            pixels[y * size.width + x]
        };
        let one = |i| kernel.iter().zip(-reach..).map(|(k, d)| k * at(i, d)).sum::<f64>() / sum;
        (0..pixels.len()).map(one).collect()
    };
    along(&along(pixels, (0, 1)), (1, 0))
}

/// Transform of a sampled Gaussian along rows or columns: that of the Gaussian and of its repetitions.
fn gaussian(sigma: f64, f: f64) -> f64 {
    (-1..=1).map(|k| (-2.0 * (PI * sigma * (f - f64::from(k))).powi(2)).exp()).sum()
}

/// Mean over azimuths of the transform of [`blurred`], of pixels that are means over squares if `squares`.
fn mean_over_azimuths(sigma: f64, f: f64, squares: bool) -> f64 {
    let of = |degrees: u32| {
        let (sin, cos) = f64::from(degrees).to_radians().sin_cos();
        let aperture = if squares { sinc(f * cos) * sinc(f * sin) } else { 1.0 };
        gaussian(sigma, f * cos) * gaussian(sigma, f * sin) * aperture
    };
    (0..360).map(of).sum::<f64>() / 360.0
}

fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) }
}

#[test]
fn edges_and_stars_of_a_gaussian_have_its_mtf_within_5e_3() {
    let (place, sigma) = (Place::new(), 0.9);
    let exr = place.at("esfr.exr");
    let chart = "iso12233-esfr?size=600x480&wavelengths=550&grid=3";
    let (size, pixels) = film(chart);
    write(&exr, size, &[&blurred(size, &pixels, sigma)]);
    let sections = place.measured(&exr, "iso12233-esfr?grid=3", &[]);
    let edges = sections[0]["edges"].as_array().unwrap();
    assert_eq!(edges.len(), 36, "nine squares");
    for edge in edges {
        let curve = std::iter::zip(
            edge["frequency_cy_px"].as_array().unwrap(),
            edge["modulation"].as_array().unwrap(),
        );
        for (f, m) in curve.map(|(f, m)| (number(f), number(m))).filter(|(f, _)| *f <= 0.4) {
            // The chart's pixels are means over squares, nearly along the normal.
            let (along, across) = (f * 5f64.to_radians().cos(), f * 5f64.to_radians().sin());
            let expected = gaussian(sigma, along) * gaussian(sigma, across) * sinc(along) * sinc(across);
            assert!((m - expected).abs() < 5e-3, "{edge:.60}: {m} for {expected} at {f}");
        }
    }
    assert_eq!(sections.len(), 2, "edges, and the tones of the grey steps");

    let exr = place.at("star.exr");
    // The third harmonic of square sectors aliases to a quarter of a cycle per pixel.
    for (profile, limit) in [("sine", 5e-3), ("square", 1.5e-2)] {
        let (size, pixels) = film(&format!("siemens?size=500&wavelengths=550&profile={profile}"));
        write(&exr, size, &[&blurred(size, &pixels, sigma)]);
        let star = &place.measured(&exr, &format!("siemens?profile={profile}"), &[])[0]["stars"][0];
        let curve = std::iter::zip(
            star["frequency_cy_px"].as_array().unwrap(),
            star["modulation"].as_array().unwrap(),
        );
        let curve: Vec<(f64, f64)> =
            curve.map(|(f, m)| (number(f), number(m))).filter(|(f, _)| *f <= 0.4).collect();
        assert!(curve.len() > 25, "{}", curve.len());
        for (f, m) in curve {
            let expected = mean_over_azimuths(sigma, f, true);
            assert!((m - expected).abs() < limit, "{profile}: {m} for {expected} at {f}");
        }
    }
}

#[test]
fn leaves_through_a_gaussian_have_its_mtf_within_5e_3_also_displaced() {
    let (place, sigma) = (Place::new(), 0.8);
    let exr = place.at("leaves.exr");
    let (size, pixels) = film("dead-leaves?size=640&wavelengths=550");
    let shown = blurred(size, &pixels, sigma);
    // As if a lens displaced it by 5 rows and 3 columns.
    let moved: Vec<f64> =
        (0..shown.len()).map(|i| shown[(i / 640).saturating_sub(5) * 640 + (i % 640 + 3).min(639)]).collect();
    for picture in [&shown, &moved] {
        write(&exr, size, &[picture]);
        let texture = &place.measured(&exr, "dead-leaves", &[])[0];
        let curve = std::iter::zip(
            texture["frequency_cy_px"].as_array().unwrap(),
            texture["modulation"].as_array().unwrap(),
        );
        let curve: Vec<(f64, f64)> =
            curve.map(|(f, m)| (number(f), number(m))).filter(|(f, _)| (0.02..0.5).contains(f)).collect();
        assert!(curve.len() > 50 && texture["tiles_missed"] == 0, "{texture:.200}");
        for (f, m) in curve {
            let expected = mean_over_azimuths(sigma, f, false);
            assert!((m - expected).abs() < 5e-3, "{m} for {expected} at {f}");
        }
    }
    // Another chart than that of the picture is not measured.
    let out = place.at("other");
    let words = ["report", text(&exr), "--chart", "dead-leaves?seed=9", "--out", text(&out)];
    assert_exit(&lenscube(&words), 1, &["of 49 tiles", "do not agree with the chart"]);
}
