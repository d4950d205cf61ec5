//! Edges, stars, points, spots, dots and lamps against their exact shapes.

use super::*;

#[test]
fn slanted_edge_equals_its_exact_coverage() {
    for (angle, patch) in [(5.0, ""), (-5.0, "&patch_px=60"), (85.0, ""), (45.0, "&patch_px=51"), (0.0, "")] {
        let spec =
            format!("slanted-edge?size=80x91&overscan=0&wavelengths=550&contrast=4&angle_deg={angle}{patch}");
        let chart = generate(&spec);
        let edge = chart.edges()[0];
        let (cy, cx) = edge.centre_px;
        let light = f64::from(generate("checker?size=1").radiance[15][0]) / 0.03 * 0.9;
        let (sin, cos) = f64::to_radians(angle).sin_cos();
        let pixels = read(&chart, 0, chart.size().rect());
        for y in 0..91_i64 {
            for x in 0..80_i64 {
                let inside = edge.patch.contains(Rect::new(y, x, 1, 1));
                // ∫ over the row of the exact share of each line, 4000 midpoints: error ≤ 1/(8·4000²) where it bends.
                let at = |v: f64| (x as f64 - cx) * cos + (y as f64 + v - cy) * sin;
                let share = |v: f64| {
                    if cos.abs() < 1e-12 {
                        return if at(v) <= 0.0 { 1.0 } else { 0.0 };
                    }
                    let cut = (0.5 - at(v) / cos).clamp(0.0, 1.0);
                    if cos > 0.0 { cut } else { 1.0 - cut }
                };
                let near = at(0.0).abs() < 0.8;
                let n = if near { 4000 } else { 1 };
                let mean = (0..n).map(|i| share((i as f64 + 0.5) / n as f64 - 0.5)).sum::<f64>() / n as f64;
                let dark = if inside { mean } else { 0.0 };
                let got = (1.0 - f64::from(pixels[(y * 80 + x) as usize]) / light) / 0.75;
                assert!((got - dark).abs() <= 1e-6, "{spec} at {y} {x}: {got} {dark}");
            }
        }
    }
}

#[test]
fn star_equals_its_supersampled_coverage() {
    for spokes in [5, 36] {
        let chart = generate(&format!("siemens?size=81&overscan=0&wavelengths=550&spokes={spokes}"));
        let (centre, radius) = (40.0, 0.45 * 81.0);
        let light = f64::from(read(&chart, 0, Rect::new(0, 0, 1, 1))[0]);
        for (i, value) in read(&chart, 0, chart.size().rect()).into_iter().enumerate() {
            let n = 60;
            let mut hits = 0;
            for k in 0..n * n {
                let at = |j: usize| (j as f64 + 0.5) / n as f64 - 0.5 - centre;
                let (y, x) = ((i / 81) as f64 + at(k / n), (i % 81) as f64 + at(k % n));
                let spoke = y.atan2(x) / std::f64::consts::TAU * spokes as f64;
                hits += usize::from(y.hypot(x) <= radius && (spoke - spoke.round()).abs() <= 0.25);
            }
            let got = (1.0 - f64::from(value) / light) / (1.0 - 0.03 / 0.9);
            // Supersampling with n × n points is exact to about 1/n.
            assert!((got - hits as f64 / (n * n) as f64).abs() < 0.02, "{spokes} at {i}: {got}");
        }
    }
}

#[test]
fn points_are_symmetric_about_their_reported_centres() {
    for spec in ["points?size=221x300&count=4&overscan=20", "points?size=256&count=3&blob=disc&width_px=7.3"]
    {
        let chart = generate(spec);
        let m = chart.overscan_px() as i64;
        assert_eq!(chart.points_px().len(), if spec.contains("count=4") { 16 } else { 9 });
        for &(row, column) in chart.points_px() {
            let window = Rect::new(row as i64 + m - 5, column as i64 + m - 5, 11, 11);
            let pixels = read(&chart, 3, window);
            assert!((0..121).all(|i| pixels[i] == pixels[120 - i]), "{spec}");
            assert!(pixels[60] > 0.0 && pixels.iter().all(|v| *v <= pixels[60]));
        }
    }
    let corner = generate("points?size=1000").points_px()[0];
    assert_eq!(corner, (20.0, 20.0));
}

#[test]
fn slanted_squares_are_dark_inside_their_reported_edges() {
    let chart = generate("iso12233-esfr?size=600&grid=3&angle_deg=5&contrast=4&wavelengths=550");
    assert_eq!(chart.edges().len(), 36);
    let m = chart.overscan_px() as i64;
    let all = read(&chart, 0, chart.size().rect());
    let at = |row: f64, column: f64| {
        all[(row.round() as i64 + m) as usize * chart.size().width + (column.round() as i64 + m) as usize]
    };
    for site in chart.edges() {
        let (sin, cos) = site.angle_deg.to_radians().sin_cos();
        let (row, column) = site.centre_px;
        let (dark, light) =
            (at(row - 6.0 * sin, column - 6.0 * cos), at(row + 6.0 * sin, column + 6.0 * cos));
        assert!((light / dark - 4.0).abs() < 1e-5, "{site:?}: {dark} {light}");
        assert!(site.patch.height >= 24 && site.patch.width >= 24, "{site:?}");
    }
    let steps = chart.patches_px();
    assert_eq!(steps.len(), 20);
    let greys: Vec<f32> = steps
        .iter()
        .map(|p| at(p.y as f64 + p.height as f64 / 2.0, p.x as f64 + p.width as f64 / 2.0))
        .collect();
    let ratio = (0.90f32 / 0.03).powf(1.0 / 19.0);
    assert!(greys.windows(2).all(|g| (g[1] / g[0] / ratio - 1.0).abs() < 1e-4), "{greys:?}");
    assert!(steps.iter().all(|p| p.bottom() < 45), "the steps overlap the squares' rows");
    assert!("iso12233-esfr?size=100&grid=9".parse::<Generator>().is_err());
}

#[test]
fn black_spots_have_no_light_and_their_share_of_the_film() {
    let chart = generate("black-spots?size=400x300&diameter=6%&wavelengths=550&overscan=0");
    let middles: Vec<(f64, f64)> = [49.5, 149.5, 249.5]
        .iter()
        .flat_map(|y| [1.0, 3.0, 5.0].map(|x| (*y, x * 400.0 / 6.0 - 0.5)))
        .collect();
    for (found, expected) in std::iter::zip(chart.points_px(), &middles) {
        assert!((found.0 - expected.0).hypot(found.1 - expected.1) < 1e-9, "{found:?} {expected:?}");
    }
    let pixels = read(&chart, 0, chart.size().rect());
    assert_eq!(pixels[150 * 400 + 200], 0.0);
    let missing: f64 = pixels.iter().map(|v| 1.0 - f64::from(v / pixels[0])).sum();
    assert!((missing / (9.0 * std::f64::consts::PI * 81.0) - 1.0).abs() < 1e-4, "{missing}");
    let text = chart.spec().to_string();
    assert!(text.contains("&spots=9&diameter=0.06"), "{text}");
    assert_eq!(text.parse::<ChartSpec>().unwrap(), *chart.spec());
    for wrong in ["spots=8", "spots=0", "diameter=60%", "diameter=30%", "radius=3"] {
        assert!(format!("black-spots?size=400&{wrong}").parse::<Generator>().is_err(), "{wrong}");
    }
}

#[test]
fn lamp_has_a_million_times_the_radiance_of_the_paper() {
    let chart = generate("lamp?size=100x80&radius=6&x=30&wavelengths=550&overscan=0");
    assert_eq!(chart.points_px(), [(39.5, 30.0)]);
    let pixels = read(&chart, 0, chart.size().rect());
    let (lamp, paper) = (pixels[39 * 100 + 30], pixels[0]);
    assert!((f64::from(lamp / paper) / 1e6 - 1.0).abs() < 1e-6, "{lamp} {paper}");
    let area: f64 = pixels.iter().map(|v| f64::from((v - paper) / (lamp - paper))).sum();
    assert!((area / (std::f64::consts::PI * 36.0) - 1.0).abs() < 1e-4, "{area}");
    assert_eq!(chart.spec().to_string().parse::<ChartSpec>().unwrap(), *chart.spec());
}

#[test]
fn dots_are_dark_on_paper_and_have_the_expected_area() {
    let chart = generate("dot-grid?size=400&count=5&width_px=20&wavelengths=550");
    assert_eq!(chart.points_px().len(), 25);
    let m = chart.overscan_px() as i64;
    for &(row, column) in chart.points_px() {
        let rect = Rect::new(row as i64 + m - 14, column as i64 + m - 14, 29, 29);
        let pixels = read(&chart, 0, rect);
        let (paper, ink) = (pixels[0], pixels[14 * 29 + 14]);
        assert!((f64::from(paper / ink) - 30.0).abs() < 1e-3, "{paper} {ink}");
        // Radiance missing because of the dot, in pixels: its area.
        let missing: f64 = pixels.iter().map(|v| f64::from((paper - v) / (paper - ink))).sum();
        assert!((missing - std::f64::consts::PI * 100.0).abs() < 1e-2, "{missing}");
    }
    assert!("dot-grid?size=100&count=20&width_px=10".parse::<Generator>().is_err());
}

#[test]
fn stars_are_reported_and_a_sine_has_the_mean_of_ink_and_paper() {
    for profile in ["square", "sine"] {
        let chart =
            generate(&format!("siemens?size=400x300&grid=2&wavelengths=550&overscan=0&profile={profile}"));
        assert_eq!(chart.stars().len(), 4);
        let star = chart.stars()[1];
        assert_eq!((star.centre_px, star.radius_px, star.spokes), ((74.5, 299.5), 67.5, 72));
        let pixels = read(&chart, 0, chart.size().rect());
        let (paper, area) = (f64::from(pixels[0]), std::f64::consts::PI * 67.5 * 67.5);
        let missing: f64 = pixels.iter().map(|v| 1.0 - f64::from(*v) / paper).sum();
        // Half of each star is ink of 1/30 of the paper.
        assert!(
            (missing / (4.0 * area * 0.5 * (1.0 - 1.0 / 30.0)) - 1.0).abs() < 1e-3,
            "{profile}: {missing}"
        );
        // Darkest in the middle of a sector, on +x.
        let at = |x: usize| f64::from(pixels[74 * 400 + 299 + x]) / paper;
        assert!(at(60) < 0.4, "{profile}: {}", at(60));
    }
    assert!(!generate("siemens?profile=square").spec().to_string().contains("profile"));
}
