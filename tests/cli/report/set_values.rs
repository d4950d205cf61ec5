//! Distortion, lateral colour, shading, glare and colours that are set.

use super::*;
use pipeline::colour::Illuminant;
use pipeline::develop::matrix::patch_targets;

/// Dots at places that a lens of k₁ = −0.06 displaces by up to 20 px, in three channels of slightly different size.
#[test]
fn a_set_distortion_and_lateral_colour_are_measured_within_1e_2_px() {
    let place = Place::new();
    let exr = place.at("dots.exr");
    let chart = "dot-grid?size=900x700&wavelengths=550&count=15&width_px=14";
    let generator: Generator = chart.parse().unwrap();
    let size = generator.film_size();
    let (half, k1) = ((size.height as f64).hypot(size.width as f64) / 2.0, -0.06);
    let centre = ((size.height as f64 - 1.0) / 2.0, (size.width as f64 - 1.0) / 2.0);
    let scales = [1.0 + 8e-4, 1.0, 1.0 - 5e-4];
    let shown = |p: (f64, f64), scale: f64| {
        let (y, x) = (p.0 - centre.0, p.1 - centre.1);
        let factor = scale * (1.0 + k1 * (y * y + x * x) / (half * half));
        (centre.0 + y * factor, centre.1 + x * factor)
    };
    let channels: Vec<Vec<f64>> = scales
        .iter()
        .map(|scale| {
            let mut pixels = vec![0.8; size.pixels()];
            for (y, x) in generator.points_px().iter().map(|p| shown(*p, *scale)) {
                for i in (y - 12.0) as usize..=(y + 12.0) as usize {
                    for j in (x - 12.0) as usize..=(x + 12.0) as usize {
                        // A soft disc of radius 7, whose centroid is its centre.
                        let r = (i as f64 - y).hypot(j as f64 - x);
                        let share = 1.0 / (1.0 + ((r - 7.0) / 0.7).exp());
                        pixels[i * size.width + j] -= 0.7 * share;
                    }
                }
            }
            pixels
        })
        .collect();
    let channels: Vec<&[f64]> = channels.iter().map(Vec::as_slice).collect();
    write(&exr, size, &channels);
    let values = &place.measured(&exr, "dot-grid?count=15&width_px=14", &[])[0];
    assert_eq!(values["missing"], 0);
    assert!((number(&values["corner_percent"]) - 100.0 * k1).abs() < 0.01, "{}", values["corner_percent"]);
    assert!(number(&values["residual_rms_px"]) < 2e-3);
    for dot in values["dots"].as_array().unwrap() {
        let film = (number(&dot["film_row"]), number(&dot["film_column"]));
        let found = |k: usize| (number(&dot["channels"][k][0]), number(&dot["channels"][k][1]));
        for (k, scale) in scales.iter().enumerate() {
            let ((y, x), at) = (shown(film, *scale), found(k));
            assert!((at.0 - y).hypot(at.1 - x) < 1e-2, "{film:?}: {at:?} for {y} {x}");
        }
    }
    let farthest = generator.points_px().iter().map(|p| {
        let at = shown(*p, 1.0);
        (at.0 - centre.0).hypot(at.1 - centre.1)
    });
    let farthest = farthest.fold(0.0, f64::max);
    let red = number(&values["lateral"][0]["largest_px"]);
    assert!((red - 8e-4 * farthest).abs() < 1e-2, "{red} for {}", 8e-4 * farthest);
}

#[test]
fn shading_glare_and_colours_that_are_set_are_measured() {
    let place = Place::new();
    // Light falls to 1 - 0.4 in the corner, red by 3 % more.
    let size = Size::new(310, 465);
    let height2 = |i: usize| {
        let (y, x) = ((i / 465) as f64 - 154.5, (i % 465) as f64 - 232.0);
        (y * y + x * x) / (154.5f64.powi(2) + 232f64.powi(2))
    };
    let light: Vec<f64> = (0..size.pixels()).map(|i| 0.7 * (1.0 - 0.4 * height2(i))).collect();
    let red: Vec<f64> = (0..size.pixels()).map(|i| light[i] * (1.0 - 0.03 * height2(i))).collect();
    let exr = place.at("uniform.exr");
    write(&exr, size, &[&red, &light, &light]);
    let values = &place.measured(&exr, "uniform", &[])[0];
    // Parts of 10 x 15 pixels.
    let mean = |of: &[f64], top: usize, left: usize| {
        let part = (0..150).map(|k| of[(top + k / 15) * 465 + left + k % 15]);
        part.sum::<f64>() / 150.0
    };
    let [(r0, g0), (r, g)] = [(150, 225), (0, 0)].map(|(y, x)| (mean(&red, y, x), mean(&light, y, x)));
    let corners = (0.2126 * r + 0.7874 * g) / (0.2126 * r0 + 0.7874 * g0);
    assert!((number(&values["corners"]) - corners).abs() < 1e-4, "{} for {corners}", values["corners"]);
    let deviation = 1.0 - r / g / (r0 / g0);
    assert!((number(&values["max_ratio_deviation"][0]) - deviation).abs() < 1e-4 && deviation > 0.027);
    assert!(number(&values["max_ratio_deviation"][1]) < 1e-6);

    let (size, pixels) = film("black-spots?size=600x400&wavelengths=550");
    let paper = pixels.iter().copied().fold(0.0, f64::max);
    let veiled: Vec<f64> = pixels.iter().map(|v| v + 0.02 * paper).collect();
    let exr = place.at("spots.exr");
    write(&exr, size, &[&veiled]);
    let discs = place.measured(&exr, "black-spots", &[])[0]["discs"].as_array().unwrap().clone();
    assert_eq!(discs.len(), 9);
    for disc in discs {
        let index = number(&disc["veiling_glare_index"]);
        assert!((index - 0.02 / 1.02).abs() < 1e-6, "{index}");
    }

    // The same inside a larger picture, placed by its corners.
    let (wide, high, right, down) = (700, 470, 60, 25);
    let mut larger = vec![0.3 * paper; wide * high];
    for (y, row) in veiled.chunks(size.width).enumerate() {
        larger[(y + down) * wide + right..][..size.width].copy_from_slice(row);
    }
    write(&exr, Size::new(high, wide), &[&larger]);
    let (x, y) = (right as f64 - 0.5, down as f64 - 0.5);
    let (last_x, last_y) = (x + size.width as f64, y + size.height as f64);
    let corners = format!("--corners={x},{y};{last_x},{y};{last_x},{last_y};{x},{last_y}");
    let placed = place.measured(&exr, "black-spots", &[&corners])[0]["discs"].as_array().unwrap().clone();
    assert_eq!(placed.len(), 9);
    for disc in placed {
        let index = number(&disc["veiling_glare_index"]);
        assert!((index - 0.02 / 1.02).abs() < 1e-6, "{index}");
    }

    // A ColorChecker as its spectra are seen, half as bright; and one whose blue is a fifth too weak.
    let generator: Generator = "checker?size=480x320&wavelengths=550".parse().unwrap();
    let size = generator.film_size();
    let targets = patch_targets(Illuminant::D65);
    let mut channels = vec![vec![0.01; size.pixels()]; 3];
    for (rect, target) in std::iter::zip(generator.patches_px(), &targets) {
        for (i, channel) in (0..size.pixels()).flat_map(|i| (0..3).map(move |c| (i, c))) {
            if rect.contains(Rect::new((i / 480) as i64, (i % 480) as i64, 1, 1)) {
                channels[channel][i] = 0.5 * target[channel];
            }
        }
    }
    let exr = place.at("checker.exr");
    let views =
        |channels: &[Vec<f64>]| write(&exr, size, &channels.iter().map(Vec::as_slice).collect::<Vec<_>>());
    views(&channels);
    let values = &place.measured(&exr, "checker", &[])[0];
    assert!(number(&values["largest_delta_e_2000"]) < 1e-3, "{values:.300}");
    assert!(number(&values["sensor_metamerism_index"]) > 99.9);
    channels[2].iter_mut().for_each(|v| *v *= 0.8);
    views(&channels);
    let values = &place.measured(&exr, "checker", &[])[0];
    let mean = number(&values["mean_delta_e_2000"]);
    assert!(
        mean > 3.0 && number(&values["sensor_metamerism_index"]) > 95.0,
        "{mean}: a matrix mends most of it"
    );
}
