//! Files by SciPy (`tests/data/make_matlab.py`), and damaged ones.

use std::fs;
use std::path::PathBuf;

use super::*;
use pipeline::flow::ChartSource;

const SIZE: Size = Size::new(4, 5);
const NM: [f64; 3] = [450.0, 550.0, 650.0];

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/matlab").join(name)
}

/// All bands of a chart, read in an order of requests that skips some.
fn pixels(chart: &DecodedChart) -> Vec<Vec<f32>> {
    let dir = tempfile::tempdir().unwrap();
    let all: Vec<usize> = (0..chart.bands()).collect();
    chart.copy_bands(&all, dir.path(), 2, &|_, _| ()).unwrap();
    let band = |band: usize| {
        let mut out = vec![0.0; chart.size().pixels()];
        chart.read_rect(band, chart.size().rect(), &mut out).unwrap();
        out
    };
    all.into_iter().map(band).collect()
}

/// Number `k` of band `b` of the files.
fn value(b: usize, k: usize) -> f64 {
    (1000 * (k / 5) + 10 * (k % 5) + b + 1) as f64
}

fn open_all(name: &str, array: &str) -> DecodedChart {
    open(&fixture(name), array, NanPolicy::Error).unwrap()
}

#[test]
fn photons_of_isetcam_are_radiance() {
    for (name, array) in [
        ("photons.mat", ""),
        ("photons.mat", "photons"),
        ("model.mat", ""),
        ("scene.mat", ""),
        ("scene.mat", "scene/data/photons"),
    ] {
        let chart = open_all(name, array);
        assert_eq!((chart.size(), chart.wavelengths_nm()), (SIZE, Some(&NM[..])), "{name} {array}");
        assert_eq!(chart.units(), Some("W m-2 sr-1 nm-1"));
        assert!(chart.notes().iter().any(|note| note.contains("read as radiance")), "{:?}", chart.notes());
        for (b, band) in pixels(&chart).iter().enumerate() {
            for (k, found) in band.iter().enumerate() {
                // 3.6e-19 J at 550 nm.
                let expected = value(b, k) * 1.986_445_857e-16 / NM[b];
                assert!(
                    (f64::from(*found) / expected - 1.0).abs() < 1e-6,
                    "{name} {array}, band {b}, pixel {k}: {found}, {expected}"
                );
            }
        }
    }
}

#[test]
fn other_arrays_are_samples() {
    // Coefficients themselves, integers, an array of two axes.
    let chart = open_all("scene.mat", "counts");
    let band = &pixels(&chart)[1];
    assert!(
        (0..20).all(|k| f64::from(band[k]) == value(1, k))
            && chart.wavelengths_nm().is_none()
            && chart.units().is_none()
    );
    let plane = open_all("other.mat", "plane");
    assert_eq!((plane.bands(), pixels(&plane)[0][7]), (1, value(0, 7) as f32));
    assert_eq!(open_all("model.mat", "mcCOEF").bands(), 2);
    let dir = tempfile::tempdir().unwrap();
    // One band of several, of which those before are skipped.
    let chart = open_all("photons.mat", "").with_scale(2.0);
    chart.copy_bands(&[2], dir.path(), 1, &|_, _| ()).unwrap();
    let mut out = vec![0.0; 20];
    chart.read_rect(2, SIZE.rect(), &mut out).unwrap();
    assert!((f64::from(out[3]) / (2.0 * value(2, 3) * HC_J_NM / 650.0) - 1.0).abs() < 1e-6);
}

#[test]
fn what_is_not_there_is_named() {
    let error = |name: &str, array: &str| {
        open(&fixture(name), array, NanPolicy::Error).map(|_| ()).unwrap_err().to_string()
    };
    let text = error("scene.mat", "no");
    assert!(
        text.contains("\"no\"")
            && text.contains("scene/data/photons [4, 5, 3]")
            && text.contains("counts [4, 5, 2]"),
        "{text}"
    );
    // Complex numbers, cells and texts are no arrays of a chart.
    let text = error("other.mat", "");
    assert!(
        text.contains("of three axes") && text.contains("plane [4, 5]") && !text.contains("complex"),
        "{text}"
    );
    assert!(
        is_matlab(&fixture("model.mat"))
            && !is_matlab(&fixture("../hdf5/matlab.mat"))
            && !is_matlab(&fixture(".."))
    );
}

#[test]
fn damaged_files_are_errors_of_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.mat");
    let error = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let text = open(&path, "", NanPolicy::Error).map(|_| ()).unwrap_err().to_string();
        assert!(!text.contains('\n') && text.contains("a.mat"), "{text}");
        text
    };
    let whole = fs::read(fixture("model.mat")).unwrap();
    for length in [19, 127, 132, 200, 600, whole.len() - 4] {
        let text = error(&whole[..length]);
        assert!(
            text.contains("complete")
                || text.contains("larger than what holds it")
                || text.contains("order of bytes"),
            "{length}: {text}"
        );
    }
    let with = |at: usize, bytes: &[u8]| {
        let mut damaged = whole.clone();
        damaged[at..at + bytes.len()].copy_from_slice(bytes);
        damaged
    };
    // The dimensions of the first array say a million of each.
    let dimensions = whole.windows(4).position(|w| w == [5, 0, 0, 0]).unwrap() + 8;
    let text =
        error(&with(dimensions, &[0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff, 0x7f, 0xff, 0xff, 0xff, 0x7f]));
    assert!(text.contains("bytes of F64") || text.contains("dimensions"), "{text}");
    assert!(error(&with(126, b"XX")).contains("order of bytes"));
    let compressed = fs::read(fixture("photons.mat")).unwrap();
    let mut broken = compressed.clone();
    broken[150] ^= 0xff;
    broken[160] ^= 0xff;
    assert!(error(&broken).contains("zlib") || error(&broken).contains("element"), "{}", error(&broken));
}
