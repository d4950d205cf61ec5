//! `lenscube report`: each figure on a picture whose answer is known in closed form, the page of two cameras, and refusals.

use crate::common::{assert_exit, lenscube, text};
use formats::developed::{Developed, write_exr};
use formats::export::ExportError;
use pipeline::chart::Generator;
use pipeline::colour::Illuminant;
use pipeline::develop::matrix::patch_targets;
use pipeline::flow::ChartSource;
use pipeline::geometry::{Rect, Size};
use serde_json::Value;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

const USAGE: i32 = 2;
/// Radiance of a reflectance of 1 in the charts here is this to the value of a picture: any number, the figures are relative.
const GAIN: f64 = 2.5;

/// The film of a chart in its one band.
fn film(chart: &str) -> (Size, Vec<f64>) {
    let chart: Generator = chart.parse().unwrap();
    let (size, margin) = (chart.film_size(), chart.overscan_px() as i64);
    let mut pixels = vec![0f32; size.pixels()];
    chart.read(0, Rect::new(margin, margin, size.height, size.width), &mut pixels).unwrap();
    (size, pixels.iter().map(|v| GAIN * f64::from(*v)).collect())
}

/// Writes a picture of one or three channels as OpenEXR.
fn write(path: &Path, size: Size, channels: &[&[f64]]) {
    let picture = Developed {
        path,
        size,
        channels: channels.len(),
        depth: 16,
        linear: true,
        comment: "",
        rows: 16,
        threads: 2,
    };
    let make = |rows: std::ops::Range<usize>| {
        let pixels = rows.start * size.width..rows.end * size.width;
        Ok(pixels.flat_map(|i| channels.iter().map(move |c| c[i] as f32)).collect())
    };
    write_exr::<ExportError>(&picture, &|_, _| {}, make).unwrap();
}

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

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Values of the sections of the first camera of the report of `picture`.
    fn measured(&self, picture: &Path, chart: &str, flags: &[&str]) -> Vec<Value> {
        let out = self.at("report");
        let words = ["report", text(picture), "--chart", chart, "--out", text(&out), "--overwrite"];
        lenscube(&[&words[..], flags].concat()).ok();
        let all: Value = serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
        let page = std::fs::read_to_string(out.join("report.html")).unwrap();
        assert!(page.contains("<svg") || chart.starts_with("black-spots"), "a page with plots");
        all["cameras"][0]["sections"].as_array().unwrap().iter().map(|s| s["values"].clone()).collect()
    }
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("a number, not {value}"))
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

/// Two cameras of other noise, found by the fiducials of a chart that is smaller in the picture, rotated by 180 degrees.
#[test]
fn tones_of_two_cameras_stand_side_by_side_found_by_fiducials() {
    let place = Place::new();
    let chart = "oecf?size=700&wavelengths=550&density=2&fiducials=42";
    let (size, pixels) = film(chart);
    let white = pixels.iter().copied().fold(0.0, f64::max);
    let camera = |name: &str, full_e: f64| {
        // Poisson noise as a normal number of its variance, by Box and Muller.
        let mut state = 1u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            ((state >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        };
        let noisy: Vec<f64> = (0..pixels.len())
            .map(|i| {
                let electrons = full_e * pixels[pixels.len() - 1 - i] / white;
                let normal = (-2.0 * uniform().ln()).sqrt() * (2.0 * PI * uniform()).cos();
                (electrons + electrons.sqrt() * normal) / full_e
            })
            .collect();
        let path = place.at(name);
        write(&path, size, &[&noisy]);
        path
    };
    let (a, b) = (camera("a.exr", 20_000.0), camera("b.exr", 5_000.0));
    let out = place.at("two");
    let words =
        ["report", text(&a), "--chart", chart, "--against", text(&b), "--name", "first", "--name", "second"];
    let ran = lenscube(&[&words[..], &["--out", text(&out)]].concat()).ok();
    assert!(ran.stdout.contains("first: dynamic range, grey: at least"), "{}", ran.stdout);
    let all: Value = serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
    for (camera, full_e) in [(0, 20_000.0), (1, 5_000.0)] {
        let colour = &all["cameras"][camera]["sections"][0]["values"]["colours"][0];
        let tones = colour["tones"].as_array().unwrap();
        assert_eq!(tones.len(), 20);
        // SNR = √electrons; mean of the twenty, each of about 300 pixels: 4 % / √20.
        let ratio = |t: &Value| {
            let electrons = full_e * number(&t["reflectance"]) / 0.9;
            number(&t["snr"]) / electrons.sqrt()
        };
        let mean = tones.iter().map(ratio).sum::<f64>() / 20.0;
        assert!((mean - 1.0).abs() < 0.03, "camera {camera}: {mean}");
    }
    let page = std::fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("class=\"sides\"") && page.contains("Report of first and second"));
    for name in ["a1-noise-1.svg", "b1-noise-3.svg"] {
        assert!(std::fs::read_to_string(out.join(name)).unwrap().starts_with("<svg"), "{name}");
    }
}

#[test]
fn dng_of_a_camera_is_measured_as_its_raw_and_tells_its_gain() {
    let place = Place::new();
    let exposed = |chart: &str| {
        let film = place.at("film.zarr");
        let wavelengths = "wavelengths=450:650:50&pitch_um=2";
        let generator = format!("gen:{chart}&{wavelengths}");
        let optics = ["--lens", "double-gauss-28-npz", "--stages", "ri", "--overwrite"];
        lenscube(&[&["run", &generator, text(&film)], &optics[..]].concat()).ok();
        ["a.zarr", "a.dng"].map(|name| {
            let out = place.at(name);
            let flags = ["--sensor", "example-2um", "--exposure", "auto", "--overwrite"];
            lenscube(&[&["sensor", text(&film), text(&out)], &flags[..]].concat()).ok();
            out
        })
    };
    let chart = "oecf?size=600x600";
    let [raw, dng] = exposed(chart);
    let attributes: Value = serde_json::from_slice(&std::fs::read(raw.join("zarr.json")).unwrap()).unwrap();
    let measured = [&raw, &dng].map(|picture| place.measured(picture, chart, &[]).remove(0));
    let page = std::fs::read_to_string(place.at("report").join("report.html")).unwrap();
    assert!(page.contains("lenscube example-2um"), "the page names the camera");
    assert!(page.contains("electrons are not known"));
    assert_eq!(measured[0]["photon_transfer"][1], Value::Null);
    for colour in [0, 1, 2] {
        let tones = |k: usize| measured[k]["colours"][colour]["tones"].as_array().unwrap().clone();
        assert_eq!(measured[1]["colours"][colour]["unit"], "DN");
        assert_eq!(tones(0).len(), tones(1).len());
        // The lightest patches: DN per electron, the dark current being small.
        let (e, dn) = (&tones(0)[19], &tones(1)[19]);
        let gain = number(&dn["mean"]) / number(&e["mean"]);
        let spread = number(&dn["standard_deviation"]) / number(&e["standard_deviation"]);
        assert!((spread / gain - 1.0).abs() < 2e-3, "{gain} {spread}");
        assert!((number(&dn["snr"]) / number(&e["snr"]) - 1.0).abs() < 5e-3);
        // Twenty variances, of some hundred pixels each, and three terms of noise.
        let found = number(&measured[1]["photon_transfer"][colour]["gain_dn_per_e"]);
        assert!((found / gain - 1.0).abs() < 0.15, "colour {colour}: {found} for {gain}; {attributes}");
    }
    let chart = "checker?size=300x200";
    let [raw, dng] = exposed(chart);
    let [raw, dng] = [&raw, &dng].map(|picture| place.measured(picture, chart, &[]).remove(0));
    for k in 0..24 {
        for c in 0..3 {
            let value = |v: &Value| number(&v["patches"][k]["linear_srgb"][c]);
            assert!((value(&raw) - value(&dng)).abs() < 2e-3, "patch {k}: {} {}", value(&raw), value(&dng));
        }
    }
    assert!((number(&raw["mean_delta_e_2000"]) - number(&dng["mean_delta_e_2000"])).abs() < 0.05);
    let file = std::fs::read(place.at("a.dng")).unwrap();
    let cut = place.at("cut.dng");
    std::fs::write(&cut, &file[..file.len() * 3 / 4]).unwrap();
    let out = place.at("none");
    let words = ["report", text(&cut), "--chart", chart, "--out", text(&out)];
    assert_exit(&lenscube(&words), 1, &["cut.dng"]);
    assert!(!out.exists());
}

#[test]
fn what_cannot_be_measured_is_refused_before_work_and_nothing_is_written() {
    let place = Place::new();
    let exr = place.at("grey.exr");
    write(&exr, Size::new(200, 300), &[&vec![0.5; 60_000]]);
    let out = place.at("out");
    let refused = |flags: &[&str], code: i32, texts: &[&str]| {
        let words = ["report", text(&exr), "--out", text(&out)];
        assert_exit(&lenscube(&[&words[..], flags].concat()), code, texts);
        assert!(!out.exists(), "{flags:?} wrote");
    };
    refused(&["--chart", "cheker"], USAGE, &["checker"]);
    refused(&["--chart", "lamp"], USAGE, &["nothing is measured of a chart `lamp`"]);
    refused(
        &["--chart", "uniform", "--chart", "uniform"],
        USAGE,
        &["--chart: expected one for all pictures"],
    );
    refused(&["--chart", "checker"], USAGE, &["expected a picture in colour, found grey"]);
    refused(&["--chart", "oecf?fiducials=42"], USAGE, &["grey.exr", "mark"]);
    refused(&["--chart", "uniform", "--against", "a.png", "b.png"], USAGE, &["--against: expected as many"]);
    refused(&["--chart", "uniform", "--frame", "2"], USAGE, &["is not a raw"]);
    refused(&["--chart", "iso12233-esfr?grid=3"], 1, &["0 of the 36 edges of the chart could be measured"]);
    refused(&["--chart", "siemens"], 1, &["found none that can be measured"]);
    let none = place.at("none.png");
    let words = ["report", text(&none), "--chart", "uniform", "--out", text(&out)];
    assert_exit(&lenscube(&words), 1, &["none.png", "no such file"]);
    // The picture is not replaced by the report.
    let own = place.at("report.json");
    std::fs::copy(&exr, &own).unwrap();
    let words = ["report", text(&own), "--chart", "uniform", "--out", text(place.0.path()), "--overwrite"];
    assert_exit(&lenscube(&words), USAGE, &["report.json"]);
}
