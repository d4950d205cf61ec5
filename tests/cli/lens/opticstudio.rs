//! The 59 figures that OpticStudio 25.1.1 printed for a biconvex lens (`opticstudio/SOURCES.md`), against what the commands print.
//!
//! Rays and wavefronts agree to all printed digits. PSF and MTF agree to the sampling of the program, which `why` has beside each tolerance.

use super::{json, lenscube, text};
use serde_json::Value;
use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};

/// Image height of the field point (10°, 20°) and its azimuth, by a separate trace of its chief ray.
const HEIGHT_MM: &str = "8.096318412634092";
const AZIMUTH_DEG: &str = "64.15192788812082";

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/cli/lens/opticstudio").join(name)
}

/// Samples of an array of `<f4` or `<f8`.
fn npy(path: &Path) -> Vec<f64> {
    let bytes = fs::read(path).unwrap();
    let start = 10 + usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
    let is_f4 = String::from_utf8_lossy(&bytes[..start]).contains("<f4");
    let samples = &bytes[start..];
    match is_f4 {
        true => {
            samples.chunks_exact(4).map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap()))).collect()
        }
        false => samples.chunks_exact(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect(),
    }
}

/// `lens show simple.zmx --json FLAGS`.
fn show(flags: &str) -> Value {
    let lens = data("simple.zmx");
    let words =
        [&["lens", "show", text(&lens), "--json"][..], &flags.split(' ').collect::<Vec<_>>()].concat();
    json(lenscube(&words))
}

/// The row of `table` whose values are those of `place`.
fn row<'a>(table: &'a Value, place: &[(&str, f64)]) -> &'a Value {
    let is_here =
        |row: &&Value| place.iter().all(|(k, v)| row[*k].as_f64().is_some_and(|x| (x - v).abs() < 1e-9));
    table.as_array().unwrap().iter().find(is_here).unwrap_or_else(|| panic!("no {place:?} in {table}"))
}

/// The rows of a field point: first the wavefront's, then its Zernike coefficients.
struct Field<'a>(&'a Value, f64);

impl Field<'_> {
    fn figure(&self, key: &str) -> f64 {
        let coefficient = |j: f64| {
            let found = row(&self.0["zernike_standard"], &[("image_height_mm", self.1), ("index", j)]);
            found["coefficient_waves"].as_f64().unwrap()
        };
        let wavefront =
            |key: &str| row(&self.0["wavefront"], &[("image_height_mm", self.1)])[key].as_f64().unwrap();
        match key {
            "z4" => coefficient(4.0),
            "n4" => coefficient(4.0).abs(),
            "n11" => coefficient(11.0).abs(),
            "ast" => coefficient(5.0).hypot(coefficient(6.0)),
            "coma" => coefficient(7.0).hypot(coefficient(8.0)),
            key => wavefront(key),
        }
    }
}

/// Light of the window of 128 × 128 samples about the chief ray (−64 to 63) at a frequency, relative to that at 0.
fn mtf_in_window(psf: &[f64], pitch_um: f64, lp_mm: f64) -> f64 {
    let (mut re, mut im, mut total) = (0.0, 0.0, 0.0);
    for (row, column) in (0..128).flat_map(|row| (0..128).map(move |column| (row, column))) {
        let v = psf[row * 129 + column];
        let (s, c) = (2e-3 * PI * lp_mm * pitch_um * (column as f64 - 64.0)).sin_cos();
        (re, im, total) = (re + v * c, im + v * s, total + v);
    }
    re.hypot(im) / total
}

#[test]
fn all_59_figures_are_those_that_opticstudio_printed() {
    let dir = tempfile::tempdir().unwrap();
    let printed: Value = serde_json::from_str(&fs::read_to_string(data("figures.json")).unwrap()).unwrap();
    let figures = printed.as_array().unwrap();
    let waves = |side: usize| {
        show(&format!(
            "--heights 0,{HEIGHT_MM} --azimuth-deg {AZIMUTH_DEG} --wavefront-samples {side} --tables wavefront,zernike-standard,spots"
        ))
    };
    let (coarse, fine) = (waves(64), waves(128));
    let field_mm: f64 = HEIGHT_MM.parse().unwrap();
    let numbers = |key: &'static str, how: &'static str| {
        let of = move |f: &&Value| f["how"] == how && !f[key].is_null();
        figures
            .iter()
            .filter(of)
            .map(move |f| f[key].as_f64().unwrap().to_string())
            .collect::<Vec<_>>()
            .join(",")
    };
    let frequencies = figures.iter().filter(|f| f["how"] == "mtf" && f["defocus"].is_null());
    let frequencies: Vec<String> = frequencies.map(|f| f["freq"].as_f64().unwrap().to_string()).collect();
    let mtf = show(&format!("--lp-mm {} --tables mtf", frequencies.join(",")));
    let focus =
        show(&format!("--lp-mm 10 --focus-mm {} --tables mtf-through-focus", numbers("defocus", "mtf")));
    let psf = |pitch: &str, size: &str| {
        let (lens, out) = (data("simple.zmx"), dir.path().join(format!("{size}.npy")));
        let words = ["lens", "psf", text(&lens), text(&out), "--pitch-um", pitch, "--size", size];
        lenscube(&[&words[..], &["--normalise", "strehl", "--overwrite"]].concat()).ok();
        npy(&out)
    };
    let window = psf("0.4827993551", "129");
    // Largest difference to their PSF, whose axis is `wider` than stated.
    let huygens = |wider: f64| {
        let axis = npy(&data("huygens-psf-64-axis-um.npy"));
        let pitch = (axis[63] - axis[0]) / 63.0 / wider;
        let (ours, theirs) = (psf(&pitch.to_string(), "65"), npy(&data("huygens-psf-64.npy")));
        (0..64 * 64).map(|i| (ours[i / 64 * 65 + i % 64] - theirs[i]).abs()).fold(0.0, f64::max)
    };
    let mut wrong = Vec::new();
    for f in figures {
        let [quantity, text, how] = ["quantity", "printed", "how"].map(|k| f[k].as_str().unwrap());
        let value: f64 = text.parse().unwrap();
        let key = f["key"].as_str().unwrap_or_default();
        let side = if f["grid"] == 64 { &coarse } else { &fine };
        let found = match how {
            "show" => coarse["design"][key].as_f64().unwrap(),
            "hexa" => row(&coarse["spots"], &[("image_height_mm", 0.0), ("wavelength_nm", 543.0)])[key]
                .as_f64()
                .unwrap(),
            "strehl0" if f["kind"] == "PSF" => coarse["fields"][0]["strehl"].as_f64().unwrap(),
            "strehl0" => Field(&fine, 0.0).figure("strehl_of_rms"),
            "wfe" => {
                let field = Field(side, if f["field"].is_null() { 0.0 } else { field_mm });
                field.figure(match (key, f["grid"].is_null()) {
                    ("rms", false) => "rms_waves",
                    ("rms_c", false) => "rms_without_tilt_waves",
                    ("rms", true) => "rms_of_zernike_waves",
                    ("rms_c", true) => "rms_of_zernike_without_tilt_waves",
                    ("pv", _) => "peak_to_valley_waves",
                    (key, _) => key,
                })
            }
            "mtf" => {
                let place = match f["defocus"].as_f64() {
                    None => row(&mtf["mtf"], &[("frequency_lp_mm", f["freq"].as_f64().unwrap())]),
                    Some(z) => row(&focus["mtf_through_focus"], &[("film_position_mm", z)]),
                };
                place["tangential"].as_f64().unwrap()
            }
            "mtf_window" => mtf_in_window(&window, 0.4827993551, f["freq"].as_f64().unwrap()),
            "psf" => huygens(1.0),
            other => panic!("{other}"),
        };
        // Half a unit of the last digit of rays and wavefronts; JSON has no zeros at the end, where `sig` is the number of digits.
        let digits = text.split_once('.').map_or(0, |(_, d)| d.len().min(9)) as i32;
        let tolerance = match (how, f["tol"].as_f64(), f["sig"].as_i64()) {
            ("mtf" | "mtf_window" | "psf", Some(tolerance), _) => tolerance,
            (_, _, Some(_)) if value == 0.0 => 1e-12,
            (_, _, Some(sig)) => 0.5 * 10f64.powi(value.abs().log10().floor() as i32 + 1 - sig as i32),
            // The sum of squares of two printed numbers: a whole unit.
            _ if ["ast", "coma"].contains(&key) => 10f64.powi(-digits),
            _ => 0.5 * 10f64.powi(-digits),
        };
        let miss = (found - value).abs();
        println!("{quantity}: {text} printed, {found} found");
        if miss.is_nan() || miss > tolerance {
            wrong.push(format!("{quantity}: {text} printed, {found} found, tolerance {tolerance:e}"));
        }
    }
    // Their PSF of 64 x 64 rays is 1.45 % wider; but for that it is ours.
    assert!(huygens(1.0145) < 4e-4, "{}", huygens(1.0145));
    assert!(wrong.is_empty() && figures.len() == 59, "{} figures:\n{}", figures.len(), wrong.join("\n"));
}
