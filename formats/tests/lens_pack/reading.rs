//! Valid packs: round trips, packs of zarr-python, and the built-in one.

use crate::*;
use lenscube_formats::lens::{builtin, builtin_names, summary};

#[test]
fn directory_and_zip_round_trip_with_equal_digests() {
    let tmp = tempfile::tempdir().unwrap();
    let mut digests = Vec::new();
    for name in ["a.lens.zarr", "a.lens.zip"] {
        let path = tmp.path().join(name);
        let lens = write_small(&path);
        let pack = LensPack::open(&path).unwrap();
        assert_eq!(pack.lens(), &lens);
        assert_eq!(pack.attributes(), &small_attributes());
        assert!(pack.notes().is_empty());
        for b in [1, 0] {
            assert_eq!(pack.psf(b).unwrap(), small_psf(&lens, b));
        }
        digests.push(pack.digest().unwrap().to_owned());
    }
    assert_eq!(digests[0], digests[1]);
    assert_eq!(digests[0].len(), 64);
    let left: Vec<_> = std::fs::read_dir(tmp.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 2, "{left:?}");
}

#[test]
fn digest_changes_with_every_number_but_not_with_the_name() {
    let tmp = tempfile::tempdir().unwrap();
    let digest = |name: &str, lens: &Lens, change: &dyn Fn(&mut PsfStack)| {
        let stacks = (0..2).map(|b| {
            let mut stack = small_psf(lens, b);
            change(&mut stack);
            Ok::<_, LensPackError>(stack)
        });
        let path = tmp.path().join(name);
        write(&path, lens, &small_attributes(), stacks).unwrap();
        LensPack::open(&path).unwrap().digest().unwrap().to_owned()
    };
    let lens = small_lens();
    let plain = digest("0.zip", &lens, &|_| {});
    let mut other = lens.clone();
    other.bands[1].image_height_mm[2] += 1e-12;
    assert_ne!(digest("1.zip", &other, &|_| {}), plain);
    assert_ne!(digest("2.zip", &lens, &|p| p.samples.swap(0, 1)), plain);
    let mut renamed = lens.clone();
    renamed.name = "another name, the same pixels".into();
    assert_eq!(digest("3.zip", &renamed, &|_| {}), plain);
}

#[test]
fn pitch_of_the_samples_of_kernels_is_kept_and_belongs_to_the_digest() {
    let tmp = tempfile::tempdir().unwrap();
    let plain = tmp.path().join("plain.lens.zarr");
    write_small(&plain);
    let mut lens = small_lens();
    lens.bands[1].kernel_pitch_um = Some(1.0);
    let path = tmp.path().join("stated.lens.zarr");
    let stacks = (0..2).map(|b| Ok::<_, LensPackError>(small_psf(&lens, b)));
    write(&path, &lens, &small_attributes(), stacks).unwrap();
    let pack = LensPack::open(&path).unwrap();
    assert_eq!(pack.lens(), &lens);
    assert!(pack.notes().is_empty());
    let plain_pack = LensPack::open(&plain).unwrap();
    assert!(!plain.join("kernel_pitch").exists());
    assert_ne!(pack.digest().unwrap(), plain_pack.digest().unwrap());
    assert_eq!(pack.band_digest(0).unwrap(), plain_pack.band_digest(0).unwrap());
    for invalid in [-1.0, 1e9] {
        lens.bands[1].kernel_pitch_um = Some(invalid);
        let stacks = (0..2).map(|b| Ok::<_, LensPackError>(small_psf(&lens, b)));
        let e = write(tmp.path().join("invalid.lens.zarr"), &lens, &small_attributes(), stacks).unwrap_err();
        assert!(e.to_string().contains("kernel_pitch"), "{e}");
    }
}

/// Digests of packs with rotational symmetry, from the program before it had others.
#[test]
fn digests_of_lenses_with_symmetry_equal_the_recorded_ones() {
    let tmp = tempfile::tempdir().unwrap();
    let written = |name: &str, lens: &Lens| {
        let path = tmp.path().join(name);
        let stacks = (0..2).map(|b| Ok::<_, LensPackError>(small_psf(lens, b)));
        write(&path, lens, &small_attributes(), stacks).unwrap();
        LensPack::open(path).unwrap()
    };
    for (pack, digest) in [
        (
            written("small.zip", &small_lens()),
            "98a76b78a141ef6f0f4d7a23fadd45df5643998c3b1f38732af97546ff1e3bf9",
        ),
        (
            written("tail.zip", &tails::lens_with_tail()),
            "ff430b135749401ed64ae1306dffc46ef4bd97c6cb2818b3eded350596912620",
        ),
        (depth_pack(), "699e3fa483f6ab517fd12867ccb4301903c65af8fc5fff7fbef9104e6df5e330"),
        (
            LensPack::open(fixture()).unwrap(),
            "4fb92d1255782b75f299dbadcbaa8fe067f9cca81894c501f31998e4a70ab0bc",
        ),
    ] {
        assert_eq!(pack.digest().unwrap(), digest, "{}", pack.path().display());
    }
}

/// Window of the fixture, as in make_lens_pack.py.
fn fixture_window(k: usize, n: usize) -> Vec<f64> {
    let c = (n - 1) as f64 / 2.0;
    let raw = |i: usize| {
        let (y, x) = ((i / n) as f64 - c, (i % n) as f64 - c);
        (-(x * x + y * y) / (1.0 + k as f64)).exp() * (1.0 + 0.1 * k as f64 * x / n as f64)
    };
    let sum: f64 = (0..n * n).map(raw).sum();
    (0..n * n).map(|i| raw(i) / sum).collect()
}

#[test]
fn pack_of_zarr_python_is_read() {
    let pack = LensPack::open(fixture()).unwrap();
    let lens = pack.lens();
    assert_eq!(lens.name, "zarr-python");
    assert_eq!((lens.object_distance_mm, lens.magnification), (Some(-1000.0), -0.05));
    assert_eq!(lens.psf_sample, PsfSample::Point);
    assert_eq!(pack.attributes().defocus_mm, Some(0.125));
    let [first, second] = &lens.bands[..] else { panic!("{} bands", lens.bands.len()) };
    assert_eq!((first.wavelength_nm, second.wavelength_nm), (500.0, 600.0));
    assert_eq!(first.ideal_height_mm, [0.0, 2.0, 4.0, 6.0, 8.0]);
    assert_eq!(second.image_height_mm[3], 6.0 * (1.0 - 2e-3 * 6.0));
    assert_eq!(first.psf_height_mm, [0.0, 4.0, 7.5]);
    assert_eq!(second.psf_height_mm, [0.0, 7.0]);
    assert_eq!((&first.azimuth_count[..], &second.azimuth_count[..]), (&[1, 8, 16][..], &[1, 12][..]));
    assert_eq!(first.transmission, 1.0);
    assert!((first.solid_angle_sr - std::f64::consts::PI / 64.0).abs() < 1e-15);
    assert_eq!(pack.notes().len(), 2, "{:?}", pack.notes());
    for (b, n) in [(0, 5), (1, 7)] {
        let stack = pack.psf(b).unwrap();
        assert_eq!((stack.size, stack.heights()), (n, lens.bands[b].psf_height_mm.len()));
        for k in 0..stack.heights() {
            let expected = fixture_window(k, n);
            assert_eq!(stack.window(k).len(), expected.len());
            for (got, expected) in stack.window(k).iter().zip(expected) {
                assert!((f64::from(*got) - expected).abs() < 1e-7);
            }
        }
    }
    // λ·N/2 is 1.0 and 1.2 µm here, the pitches 0.5 and 0.75.
    assert!(summary(&pack, true, None).to_string().contains("finer than Nyquist"));
}

#[test]
fn window_is_normalised_only_if_its_sum_deviates_by_more_than_1e_6() {
    let tmp = tempfile::tempdir().unwrap();
    let lens = small_lens();
    let path = tmp.path().join("a.zip");
    let scale = |b: usize| if b == 0 { 1.0 + 5e-7 } else { 1.0 + 5e-4 };
    let stacks = (0..2).map(|b| {
        let mut stack = small_psf(&lens, b);
        stack.samples.iter_mut().for_each(|v| *v = (f64::from(*v) * scale(b)) as f32);
        Ok::<_, LensPackError>(stack)
    });
    write(&path, &lens, &small_attributes(), stacks).unwrap();
    let pack = LensPack::open(&path).unwrap();
    let sums = |b: usize| pack.psf(b).unwrap().window(0).iter().map(|&v| f64::from(v)).sum::<f64>();
    assert!((sums(0) - scale(0)).abs() < 1e-7, "unchanged: {}", sums(0));
    assert!((sums(1) - 1.0).abs() < 1e-7, "normalised: {}", sums(1));
}

/// Numbers of tables.npz (float64 real heights, float32 RI), at its 1 mm field points.
#[test]
fn builtin_lens_has_the_values_of_its_source() {
    assert_eq!(builtin_names().collect::<Vec<_>>(), ["double-gauss-28-npz"]);
    let pack = builtin("double-gauss-28-npz").unwrap();
    let lens = pack.lens();
    assert_eq!(lens.bands.len(), 31);
    assert_eq!((lens.bands[0].wavelength_nm, lens.bands[30].wavelength_nm), (400.0, 700.0));
    assert_eq!(lens.distortion_focal_length_mm, 99.332063);
    assert!((lens.effective_focal_length_mm - 99.500675).abs() < 1e-6);
    let red = &lens.bands[18];
    assert_eq!(red.wavelength_nm, 580.0);
    let given = [(1, 0.99832592), (5, 4.99021323), (10, 9.97129423), (15, 14.93266888), (21, 20.8408289)];
    for (k, real) in given {
        assert!((red.psf_height_mm[k] - real).abs() < 5e-9, "{k}");
        let ideal = k as f64 * lens.distortion_focal_length_mm / lens.effective_focal_length_mm;
        let got = interpolate(&red.ideal_height_mm, &red.image_height_mm, ideal);
        assert!((got - real).abs() < 2e-7, "1e-4 px of 2 µm: {got} {real}");
    }
    let blue = &lens.bands[0];
    assert!((blue.image_height_mm[1000] - 20.84832465).abs() < 5e-9);
    let ideal = 10.0 * lens.distortion_focal_length_mm / lens.effective_focal_length_mm;
    let ri = interpolate(&blue.ideal_height_mm, &blue.relative_illumination, ideal);
    assert!((ri - 0.984441).abs() < 1e-6, "{ri}");
    assert!((blue.relative_illumination[1000] - 0.93999535).abs() < 1e-6);
    assert!((blue.psf_energy[0] - 0.49546644).abs() < 1e-7);
    assert_eq!(red.azimuth_count.iter().sum::<usize>(), 1 + 21 * 72);
}

/// `centroid_y_um` of tables.npz at 550 nm; in a pack the field point is on +x.
#[test]
fn builtin_psfs_are_symmetric_with_centroid_on_plus_x() {
    let pack = builtin("double-gauss-28-npz").unwrap();
    let stack = pack.psf(15).unwrap();
    assert_eq!((stack.size, stack.heights(), stack.pitch_um), (51, 22, 2.0));
    for (k, centroid_um) in [(0, 0.0), (5, 1.0126889), (10, 1.8037217), (21, 1.968503)] {
        let w = stack.window(k);
        let moment = |of: fn(usize) -> usize| -> f64 {
            w.iter().enumerate().map(|(i, &v)| f64::from(v) * (of(i) as f64 - 25.0) * 2.0).sum()
        };
        assert!((moment(|i| i % 51) - centroid_um).abs() < 1e-5, "{k}");
        assert!(moment(|i| i / 51).abs() < 1e-9);
        assert!((0..51 * 51).all(|i| w[i] == w[(50 - i / 51) * 51 + i % 51]));
    }
}

#[test]
fn builtin_lens_digest_equals_the_recorded_one() {
    // It changes with the pack's numbers, and then old jobs must not resume.
    let digest = builtin("double-gauss-28-npz").unwrap().digest().unwrap().to_owned();
    assert_eq!(digest, "bbe319b8eb0f71326a6f9f5347698040a818532f46a8184bbe5f9efc9f4d804e");
}

#[test]
fn summary_has_the_same_figures_as_text_and_json() {
    let pack = builtin("double-gauss-28-npz").unwrap();
    let short = summary(&pack, false, Some(0.055));
    let nm: Vec<f64> = short.table.iter().map(|b| b.wavelength_nm).collect();
    assert_eq!(nm, [400.0, 480.0, 550.0, 630.0, 700.0]);
    let text = short.to_string();
    for expected in
        ["99.332063 mm for distortion", "f/2.985", "5 of 31 bands", "estimated L1 error 5.5 %", "51 (102.0)"]
    {
        assert!(text.contains(expected), "{expected} in\n{text}");
    }
    let all = summary(&pack, true, None);
    assert_eq!(all.table.len(), 31);
    let primary =
        all.table.iter().min_by(|a, b| a.lateral_colour_um.abs().total_cmp(&b.lateral_colour_um.abs()));
    assert_eq!(primary.unwrap().wavelength_nm, 590.0);
    // 20.84832465 - 20.84026 mm at 400 and 590 nm, the last row of tables.npz
    assert!((all.table[0].lateral_colour_um - 8.0437).abs() < 1e-3, "{}", all.table[0].lateral_colour_um);
    let json = serde_json::to_value(&all).unwrap();
    assert_eq!(json["bands"], 31);
    assert_eq!(json["table"][0]["nodes"], 1513);
}

fn interpolate(x: &[f64], y: &[f64], v: f64) -> f64 {
    let i = x.partition_point(|&p| p < v).clamp(1, x.len() - 1);
    y[i - 1] + (y[i] - y[i - 1]) * (v - x[i - 1]) / (x[i] - x[i - 1])
}
