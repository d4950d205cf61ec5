//! Tests of all generated charts, then of each kind.

use super::*;
use crate::colour;

fn generate(spec: &str) -> Generator {
    spec.parse().unwrap_or_else(|e| panic!("{spec}: {e}"))
}

fn read(chart: &Generator, band: usize, rect: Rect) -> Vec<f32> {
    let mut out = vec![f32::NAN; rect.size().pixels()];
    chart.read(band, rect, &mut out).unwrap();
    out
}

/// Deterministic pseudo-random numbers.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % end
    }
}

const CHARTS: [&str; 23] = [
    "checker?size=200x97&noise=0.2&wavelengths=550",
    "uniform?value=3.5&size=40",
    "points?size=301x200&count=5&overscan=7",
    "points?size=150&count=5&blob=disc&width_px=5.5",
    "slanted-edge?size=77x101&overscan=3",
    "slanted-edge?size=200x300&grid=3&angle_deg=-84",
    "siemens?size=255&grid=2&spokes=36",
    "iso12233-esfr?size=240x300&grid=3&angle_deg=-7",
    "dot-grid?size=301x200&count=5&width_px=9.5",
    "black-spots?size=301x200&spots=4&diameter=11%",
    "lamp?size=90x120&radius=7.5&x=30.25&y=100",
    "checker?size=200x97&illuminant=A",
    "composite?size=700&wavelengths=450,550,650",
    "composite?size=1002x1301&wavelengths=550",
    "depth-scene?size=400x300&wavelengths=550,600&noise=0.1",
    "checker?size=400x300&wavelengths=550&fiducials=35",
    "slanted-edge?size=300x310&wavelengths=550&fiducials=30.25&noise=0.02",
    "uniform?size=200&value=0.01&fiducials=21",
    "siemens?size=255x200&wavelengths=550&grid=2&spokes=48&profile=sine",
    "dead-leaves?size=330x301&wavelengths=550&seed=7",
    "dead-leaves?size=300&wavelengths=550&r_min_px=3&r_max_px=3&contrast=20&fiducials=28&overscan=4",
    "oecf?size=300x250&wavelengths=550&patches=12&density=2&fiducials=21",
    "depth-scene?size=300x200&wavelengths=550&near_m=0.3&far_m=inf&part=depth",
];

#[test]
fn any_rectangle_has_the_bits_of_the_complete_chart() {
    let mut random = Random(7);
    for spec in CHARTS {
        let chart = generate(spec);
        let full = chart.size().rect();
        let all = read(&chart, 0, full);
        assert!(all.iter().all(|v| v.is_finite() && *v >= 0.0), "{spec}");
        for _ in 0..60 {
            let (y, x) = (random.below(full.height), random.below(full.width));
            let rect = Rect::new(
                y as i64,
                x as i64,
                1 + random.below((full.height - y).min(90)),
                1 + random.below((full.width - x).min(90)),
            );
            let part = read(&chart, 0, rect);
            for (i, row) in part.chunks(rect.width).enumerate() {
                let from = (y + i) * full.width + x;
                let same = row.iter().zip(&all[from..]).all(|(a, b)| a.to_bits() == b.to_bits());
                assert!(same, "{spec}: row {i} of {rect}");
            }
        }
    }
}

#[test]
fn shares_kept_from_band_to_band_do_not_change_bits() {
    for spec in CHARTS {
        let spec = format!("{}&wavelengths=450,500,550,600", spec.split("&wavelengths").next().unwrap());
        let plain = generate(&spec);
        let full = plain.size().rect();
        for cache_bytes in [plain.useful_cache_bytes(), 1500] {
            let mut cached = generate(&spec);
            cached.set_cache_bytes(cache_bytes);
            for band in [0, 3, 0] {
                let (a, b) = (read(&plain, band, full), read(&cached, band, full));
                let differing = a.iter().zip(&b).position(|(a, b)| a.to_bits() != b.to_bits());
                assert_eq!(differing, None, "{spec}, band {band}, {cache_bytes} bytes");
            }
        }
    }
}

/// CPU time of this thread in s.
fn thread_cpu_s() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

#[test]
#[ignore = "measurement: run alone, in release, with --nocapture"]
fn cost_of_drawing_a_band_with_and_without_kept_shares() {
    for size in [4000, 8000, 14141] {
        let spec = format!("composite?size={size}&wavelengths=450,500,550,600");
        let (plain, mut kept) = (generate(&spec), generate(&spec));
        kept.set_cache_bytes(usize::MAX);
        let tiles: Vec<Rect> = plain.size().rect().tiles(442, 442).collect();
        for band in 0..3 {
            let seconds = [&plain, &kept].map(|chart| {
                let start = thread_cpu_s();
                tiles.iter().for_each(|tile| drop(read(chart, band, *tile)));
                thread_cpu_s() - start
            });
            println!("{size} px, band {band}: {:.3} s, with kept shares {:.3} s", seconds[0], seconds[1]);
        }
        let all = kept.useful_cache_bytes();
        println!("{size} px: {} of {all} bytes", all - kept.picture.cache_bytes_left());
    }
}

#[test]
fn very_small_and_very_long_films_can_be_drawn() {
    for size in ["1", "7x5", "2x1", "3x400", "64x1"] {
        for kind in [
            "uniform",
            "points?count=1",
            "slanted-edge",
            "siemens",
            "siemens?profile=sine",
            "checker",
            "composite",
            "dead-leaves",
        ] {
            let separator = if kind.contains('?') { '&' } else { '?' };
            let chart = generate(&format!("{kind}{separator}size={size}&wavelengths=550&overscan=2"));
            assert_eq!(chart.size().height, chart.film_size().height + 4);
            assert!(read(&chart, 0, chart.size().rect()).iter().all(|v| v.is_finite()), "{kind} {size}");
        }
    }
}

#[test]
fn ink_share_of_a_pixel_is_the_same_in_every_band() {
    let chart = generate("slanted-edge?size=64&wavelengths=450,550,650&overscan=0");
    let bands: Vec<_> = (0..3).map(|b| read(&chart, b, chart.size().rect())).collect();
    let share = |b: usize, i: usize| {
        let (light, dark) = (f64::from(bands[b][63]), f64::from(bands[b][0]));
        (f64::from(bands[b][i]) - light) / (dark - light)
    };
    for i in 0..64 * 64 {
        assert!((share(0, i) - share(1, i)).abs() < 1e-6 && (share(0, i) - share(2, i)).abs() < 1e-6);
    }
}

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
fn checker_luminance_corresponds_to_1000_lux() {
    let chart = generate("checker?size=900x600&wavelengths=380:780:5&overscan=10");
    let weights = colour::xyz_weights(chart.wavelengths_nm());
    let luminance = |patch: usize| {
        let p = chart.patches_px()[patch];
        let middle = Rect::new(p.y + 10 + p.height as i64 / 2, p.x + 10 + p.width as i64 / 2, 1, 1);
        (0..weights.len()).map(|b| f64::from(read(&chart, b, middle)[0]) * weights[b][1]).sum::<f64>()
    };
    // The white patch reflects about 0.9 of 1000 lx: 0.9·1000/π cd/m².
    assert!((luminance(18) - 286.0).abs() < 6.0, "{}", luminance(18));
    assert!((luminance(23) - 10.0).abs() < 1.0, "{}", luminance(23));
    assert_eq!(chart.patches_px().len(), 24);
}

#[test]
fn composite_covers_the_complete_film() {
    let chart = generate("composite?size=3000&wavelengths=550");
    assert!(chart.points_px().len() > 100 && chart.patches_px().len() == 24);
    assert_eq!(chart.size(), Size::new(3188, 3188));
    let film = chart.film_size().rect();
    assert!(chart.points_px().iter().all(|&(y, x)| film.contains(Rect::new(y as i64, x as i64, 1, 1))));
    assert!(chart.points_px().iter().any(|&(y, x)| y < 450.0 && x < 450.0));
}

#[test]
fn specification_text_round_trips() {
    for spec in CHARTS.iter().chain(&["slanted-edge?centers=10,20;300,40.5&patch_px=90", "gen:composite"]) {
        let read: ChartSpec = spec.parse().unwrap();
        let written = read.to_string();
        let again: ChartSpec = written.parse().unwrap();
        assert_eq!(again.to_string(), written);
        assert_eq!(ChartSpec { overscan_px: read.overscan_px, ..again }, read);
    }
    let chart = generate("gen:composite?size=14141&wavelengths=400:700:10&pitch_um=2");
    assert_eq!((chart.overscan_px(), chart.size().height, chart.wavelengths_nm().len()), (206, 14553, 31));
}

#[test]
fn invalid_specification_is_an_error_with_a_hint() {
    for (spec, hint) in [
        ("composit", "'composite'"),
        ("slantededge", "'slanted-edge'"),
        ("", "Kinds: uniform, points"),
        ("points?wavelength=550", "'wavelengths'"),
        ("checker?spokes=5", "a checker chart has no setting 'spokes'"),
        ("composite?size=1e18", "size=1e18"),
        ("composite?size=999999999999999999999999", "1 to 1000000"),
        ("composite?size=0", "1 to 1000000"),
        ("composite?size=-3x10", "1 to 1000000"),
        ("composite?overscan=18446744073709551615", "overscan="),
        ("composite?size=10&size=20", "twice"),
        ("composite?size", "key=value"),
        ("composite?pitch_um=0", "pitch"),
        ("composite?pitch_um=nan", "a number"),
        ("composite?wavelengths=400:700:0", "step above 0"),
        ("composite?wavelengths=350", "380 to 780"),
        ("composite?illuminant=F2", "D65, A or E"),
        ("uniform?value=1e300", "32-bit"),
        ("uniform?value=inf", "a number"),
        ("points?size=20", "reduce the number"),
        ("points?count=100000", "1 to 128"),
        ("points?blob=square", "gaussian or disc"),
        ("points?width_px=0.1", "2.2"),
        ("slanted-edge?contrast=0", "light over dark"),
        ("slanted-edge?centers=5", "X,Y;X,Y"),
        ("slanted-edge?centers=5000,5", "on the film"),
        ("slanted-edge?centers=50,50;52,50&patch_px=9", "apart"),
        ("siemens?spokes=1", "2 to 720"),
        ("siemens?profile=saw", "square or sine"),
        ("dead-leaves?r_min_px=0.5", "1 to 10000 px"),
        ("dead-leaves?r_min_px=9&r_max_px=8", "r_min_px to 100000 px"),
        ("dead-leaves?seed=-1", "a whole number"),
        ("oecf?patches=1", "2 to 64"),
        ("oecf?density=6", "0.1 to 5"),
        ("oecf?size=50&patches=60", "grey patches"),
        ("checker?fiducials=20", "21 to 100000 px"),
        ("checker?fiducials=-7", "21 to 100000 px"),
        ("checker?size=200x300&fiducials=70", "corner marks are 200.0 px apart and need 270.0 px"),
        ("uniform?value=0&fiducials=30", "without light"),
        ("depth-scene?near_m=0", "0.0001 to 100000 m"),
        ("depth-scene?near_m=2&far_m=2", "more than near_m"),
        ("depth-scene?part=dept", "one of chart, depth, coverage"),
    ] {
        let error =
            spec.parse::<Generator>().err().unwrap_or_else(|| panic!("{spec} was accepted")).to_string();
        assert!(error.contains(hint), "{spec}: {error}");
    }
    assert!("uniform?wavelengths=350".parse::<Generator>().is_ok());
}

#[test]
fn reading_outside_the_chart_is_an_error() {
    let chart = generate("uniform?size=10&overscan=0");
    let mut out = [0.0; 4];
    assert!(chart.read(31, Rect::new(0, 0, 2, 2), &mut out).is_err());
    assert!(chart.read(0, Rect::new(9, 9, 2, 2), &mut out).is_err());
    assert!(chart.read(0, Rect::new(0, 0, 3, 2), &mut out).is_err());
}

/// Prints pixels per second of one core, in tiles of 512 as a job reads them.
#[test]
#[ignore = "measurement: run alone, in release, with --nocapture"]
fn reading_speed_per_chart_kind_is_printed() {
    for kind in ["uniform", "points", "slanted-edge", "siemens", "checker", "composite", "dead-leaves"] {
        let chart = generate(&format!("{kind}?size=14141&wavelengths=550"));
        let mut out = vec![0.0; 512 * 512];
        let (start, mut slowest) = (std::time::Instant::now(), std::time::Duration::ZERO);
        for tile in chart.size().rect().tiles(512, 512) {
            let began = std::time::Instant::now();
            chart.read(0, tile, &mut out[..tile.size().pixels()]).unwrap();
            slowest = slowest.max(began.elapsed());
        }
        let seconds = start.elapsed().as_secs_f64();
        let rate = chart.size().pixels() as f64 / seconds / 1e6;
        println!("{kind:13} {rate:7.0} Mpx/s  {seconds:.2} s  slowest tile {slowest:?}");
    }
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
fn corner_marks_are_found_where_they_are_drawn() {
    for spec in [
        "checker?size=500x400&fiducials=42",
        "slanted-edge?size=600&grid=3&fiducials=30.3",
        "siemens?size=450&grid=2&fiducials=49",
        "composite?size=700x900&fiducials=40",
        "uniform?size=300&value=0.05&fiducials=28",
        "iso12233-esfr?size=900&grid=4&fiducials=60",
    ] {
        let chart = generate(&format!("{spec}&wavelengths=550&overscan=10"));
        let film = chart.film_size();
        let picture = read(&chart, 0, Rect::new(10, 10, film.height, film.width));
        let found = crate::measure::fiducial::find(&picture, film).unwrap_or_else(|e| panic!("{spec}: {e}"));
        for (found, drawn) in std::iter::zip(found, chart.fiducials().unwrap()) {
            let error = (found.0 - drawn.0).hypot(found.1 - drawn.1);
            assert!(error < 0.01, "{spec}: {found:?} {drawn:?}");
        }
    }
}

#[test]
fn without_corner_marks_nothing_changes() {
    for spec in CHARTS.iter().filter(|s| !s.contains("fiducials")) {
        let (without, zero) = (generate(spec), generate(&format!("{spec}&fiducials=0")));
        assert_eq!(zero.spec().to_string(), without.spec().to_string());
        assert!(!without.spec().to_string().contains("fiducials"));
        assert_eq!(without.fiducials(), None);
    }
}

#[test]
fn targets_below_corner_marks_are_not_reported() {
    let module = 5.0;
    let covered = [Rect::new(0, 0, 65, 80), Rect::new(0, 645, 55, 55), Rect::new(545, 645, 55, 55)];
    for spec in ["points?count=20", "iso12233-esfr?grid=4", "checker", "slanted-edge", "dot-grid?count=9"] {
        let separator = if spec.contains('?') { '&' } else { '?' };
        let size = "size=700x600&wavelengths=550";
        let without = generate(&format!("{spec}{separator}{size}"));
        let chart = generate(&format!("{spec}{separator}{size}&fiducials={}", 7.0 * module));
        for mark in covered {
            let clear = |rect: Rect| rect.intersect(mark).is_empty();
            assert!(chart.patches_px().iter().all(|p| clear(*p) && !p.is_empty()), "{spec}");
            assert!(chart.edges().iter().all(|e| clear(e.patch)), "{spec}");
            assert!(
                chart.points_px().iter().all(|p| clear(Rect::new(p.0 as i64, p.1 as i64, 1, 1))),
                "{spec}"
            );
        }
        assert_eq!(chart.patches_px().len(), without.patches_px().len());
        assert_eq!(chart.edges().is_empty(), without.edges().is_empty(), "{spec}");
        assert!(chart.points_px().len() + 30 > without.points_px().len());
    }
}

#[test]
fn patches_have_their_reported_reflectance() {
    for spec in ["checker?size=300x200&illuminant=A", "iso12233-esfr?size=300&grid=3&fiducials=21"] {
        let chart = generate(&format!("{spec}&wavelengths=450,550,650&overscan=0"));
        let reflectance: Vec<Vec<f64>> =
            chart.wavelengths_nm().iter().map(|nm| chart.patch_reflectance(*nm)).collect();
        assert_eq!(reflectance[0].len(), chart.patches_px().len());
        for (band, reflectance) in reflectance.iter().enumerate() {
            let level = |i: usize| f64::from(read(&chart, band, chart.patches_px()[i])[0]);
            for i in 1..reflectance.len() {
                let ratio = level(i) / level(0) * reflectance[0] / reflectance[i];
                assert!((ratio - 1.0).abs() < 1e-6, "{spec}, band {band}, patch {i}: {ratio}");
            }
        }
    }
}

#[test]
fn grey_patches_lie_on_a_circle_and_have_equal_steps_of_density() {
    let chart = generate("oecf?size=900x700&wavelengths=550&overscan=0");
    let patches = chart.patches_px();
    assert_eq!(patches.len(), 20);
    for p in patches {
        let (y, x) = (p.y as f64 + (p.height as f64 - 1.0) / 2.0, p.x as f64 + (p.width as f64 - 1.0) / 2.0);
        let radius = (y - 349.5).hypot(x - 449.5);
        assert!((radius - 0.34 * 700.0).abs() < 1.0 && p.height.abs_diff(p.width) <= 1, "{p}");
    }
    let apart = |i: usize, j: usize| patches[i].intersect(patches[j]).is_empty();
    assert!((0..20).all(|i| (0..i).all(|j| apart(i, j))));
    let reflectance = chart.patch_reflectance(550.0);
    assert!((reflectance[19] - 0.9).abs() < 1e-12 && (reflectance[0] - 0.0009).abs() < 1e-12);
    let level = |rect: Rect| f64::from(read(&chart, 0, rect)[0]);
    let background = level(Rect::new(0, 0, 1, 1));
    for (p, reflectance) in std::iter::zip(patches, &reflectance) {
        assert!((level(*p) / background / (reflectance / 0.18) - 1.0).abs() < 1e-6, "{p}");
    }
    let ratios = reflectance.windows(2).map(|r| (r[1] / r[0]).log10());
    ratios.for_each(|step| assert!((step - 3.0 / 19.0).abs() < 1e-12, "{step}"));
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

#[test]
fn leaves_fill_the_middle_of_a_frame_of_their_mean() {
    let chart = generate("dead-leaves?size=400x300&wavelengths=450,550&fiducials=21&contrast=9");
    let texture = chart.texture_px().unwrap();
    // 16 modules of 3 px are wider than a tenth of the film.
    assert_eq!(texture, Rect::new(48, 48, 204, 304));
    let m = chart.overscan_px() as i64;
    let in_chart = |r: Rect| Rect { y: r.y + m, x: r.x + m, ..r };
    for band in 0..2 {
        let grey = read(&chart, band, in_chart(chart.patches_px()[0]));
        assert!(grey.iter().all(|v| *v == grey[0]));
        let mean = f64::from(grey[0]);
        // 0.08 to 0.72.
        let leaves = read(&chart, band, in_chart(texture));
        assert!(leaves.iter().all(|v| (0.2 - 1e-6..=1.8 + 1e-6).contains(&(f64::from(*v) / mean))));
        assert!(leaves.iter().any(|v| f64::from(*v) / mean < 0.4));
    }
    assert_eq!(chart.patch_reflectance(550.0), [0.4, 0.4]);
}
