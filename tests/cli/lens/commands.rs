//! `lenscube lens trace | show | diff`.

use super::*;

#[test]
fn traced_pack_has_requested_bands_and_heights_and_is_not_overwritten() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("dg.lens.zarr");
    let ran = trace("double-gauss-28", &out, &[]).ok();
    for word in
        ["500 nm: window", "% of the light", "PSFs traced in", " MB", "lenscube run CHART FILM --lens"]
    {
        assert!(ran.stderr.contains(word), "`{word}` is not in: {}", ran.stderr);
    }
    let pack = LensPack::open(&out).unwrap();
    let bands = &pack.lens().bands;
    assert_eq!(bands.iter().map(|b| b.wavelength_nm).collect::<Vec<_>>(), [500.0, 600.0]);
    assert_eq!(bands[0].psf_height_mm, [0.0, 1.5, 3.0]);
    assert!((bands[1].image_height_mm.last().unwrap() - 3.0).abs() < 1e-9);
    assert!(bands.iter().flat_map(|b| &b.psf_energy).all(|e| *e >= 0.99));
    assert!(pack.lens().object_distance_mm.is_none() && pack.psf(1).unwrap().heights() == 3);
    // The same output again is an error and stays unchanged.
    let before = files(&out);
    let again = trace("double-gauss-28", &out, &[]);
    assert_eq!(again.code, OTHER_JOB, "{}", again.stderr);
    assert!(again.stderr.contains("dg.lens.zarr") && files(&out) == before);
    // As one file.
    let zip = dir.path().join("dg.lens.zip");
    trace("double-gauss-28", &zip, &[]).ok();
    assert_eq!(LensPack::open(&zip).unwrap().digest().unwrap(), pack.digest().unwrap());
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 2, "leftover files");
}

#[test]
fn film_plane_and_object_distance_flags_set_the_conjugates() {
    let dir = tempfile::tempdir().unwrap();
    let pack = |name: &str, flags: &[&str]| {
        let out = dir.path().join(name);
        trace("double-gauss-28", &out, flags).ok();
        LensPack::open(out).unwrap()
    };
    let (design, rms) = (pack("a", &[]), pack("b", &["--image-plane", "rms", "--focus-nm", "600"]));
    let far = pack("c", &["--image-plane", "rms", "--focus-nm", "600", "--defocus-mm", "0.2"]);
    let focal = |p: &LensPack| p.lens().distortion_focal_length_mm;
    // 0.2 mm of defocus change the height of the chief ray by its slope, the angular magnification.
    assert!((focal(&far) - focal(&rms) - 0.2 * 0.919_234).abs() < 2e-5, "{} {}", focal(&far), focal(&rms));
    assert_ne!(design.digest().unwrap(), rms.digest().unwrap());
    let near = pack("d", &["--object-distance-mm", "100000"]);
    assert_eq!(near.lens().object_distance_mm, Some(100_000.0));
    // The chief ray from height y leaves at y/(100000 + entrance pupil 58.94) and lands at 99.332 times that, upside down.
    assert!(
        (near.lens().magnification + 99.332_063 / 100_058.939_762).abs() < 1e-10,
        "{}",
        near.lens().magnification
    );
}

#[test]
fn invalid_designs_and_trace_flags_fail_with_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let out = at("out.lens.zarr");
    let bad = |design: &str, flags: &[&str], code: i32, words: &[&str]| {
        assert_exit(&lenscube(&[&["lens", "trace", design, text(&out)], flags].concat()), code, words);
        assert!(
            !out.exists()
                && fs::read_dir(dir.path()).unwrap().all(|e| !text(&e.unwrap().path()).contains("part"))
        );
    };
    bad("doublet", &[], USAGE, &["doublet", "double-gauss-28"]);
    bad("double-gauss-28", &["--energy", "2"], USAGE, &["--energy", "between 0 and 1"]);
    bad("double-gauss-28", &["--heights", "0,3,1"], FAILED, &["heights", "ascending"]);
    bad("double-gauss-28", &["--heights", "0:x:1"], USAGE, &["--heights 0:x:1", "`x`"]);
    bad("double-gauss-28", &["--wavelengths", "700:400:10"], USAGE, &["--wavelengths 700:400:10"]);
    bad("double-gauss-28", &["--max-height-mm", "200"], FAILED, &["200", "maximum real image height"]);
    bad("double-gauss-28", &["--image-plane", "best"], USAGE, &["best", "strehl"]);
    bad("double-gauss-28", &["--max-nodes", "3"], FAILED, &["max nodes is 3", "at least 16"]);
    bad(
        "double-gauss-28",
        &["--heights", "0:20:0.002", "--wavelengths", "400"],
        USAGE,
        &["GB a band", "--heights"],
    );
    let missed =
        ["--wavelengths", "550", "--max-height-mm", "3", "--psf-tolerance", "1e-5", "--max-nodes", "20"];
    bad(
        "double-gauss-28",
        &missed,
        FAILED,
        &[
            "550 nm: kernels between the nodes have errors up to",
            "0.001 % (--psf-tolerance): give more --max-nodes",
        ],
    );
    let far_out = ["--defocus-mm", "8", "--wavelengths", "550"];
    bad("double-gauss-28", &far_out, FAILED, &["401 film pixels", "--energy", "--image-plane rms"]);
    bad(
        "double-gauss-28",
        &["--psf-pitch-um", "5", "--wavelengths", "500"],
        FAILED,
        &["psf pitch", "Nyquist"],
    );
    fs::write(at("glass.zmx"), DESIGN.replace("N-SK16", "N-SK160")).unwrap();
    bad(text(&at("glass.zmx")), &[], FAILED, &["N-SK160", "nearest", "N-SK16"]);
    fs::write(at("text.zmx"), "not a design").unwrap();
    bad(text(&at("text.zmx")), &[], FAILED, &["text.zmx"]);
    assert_exit(&lenscube(&["lens", "show", "no.zmx"]), USAGE, &["no.zmx", "double-gauss-28"]);
}

#[test]
fn show_design_prints_system_data_and_writes_plots() {
    let dir = tempfile::tempdir().unwrap();
    let shown = json(lenscube(&["lens", "show", "double-gauss-28", "--json"]));
    let design = |key: &str| shown["design"][key].as_f64().unwrap_or_else(|| panic!("{key} in {shown}"));
    // Values of the design program for this lens.
    assert!((design("distortion_focal_length_mm") - 99.332_063).abs() < 1e-6);
    assert!((design("effective_focal_length_mm") - 99.500_679).abs() < 1e-6);
    for key in [
        "back_focal_length_mm",
        "total_track_mm",
        "working_f_number",
        "image_space_na",
        "na_of_real_rays",
        "stop_radius_mm",
    ] {
        assert!(design(key) > 0.0, "{key}");
    }
    assert!(shown["design"]["object_distance_mm"].is_null());
    let fields = shown["fields"].as_array().unwrap();
    assert_eq!(fields.len(), 15, "three wavelengths, five heights");
    let edge =
        fields.iter().find(|f| f["wavelength_nm"] == 587.6 && f["image_height_mm"].as_f64() > Some(24.0));
    assert!((edge.unwrap()["distortion_percent"].as_f64().unwrap() + 0.8673).abs() < 3e-3, "{edge:?}");
    let words = lenscube(&["lens", "show", "double-gauss-28", "--heights", "0,5", "--wavelengths", "550"])
        .ok()
        .stdout;
    for word in ["effective focal length", "exit pupil position", "Strehl", "RMS", "GEO", "99.332063 mm"] {
        assert!(words.contains(word), "`{word}` is not in: {words}");
    }
    let plots = dir.path().join("plots");
    let far = lenscube(&["lens", "show", "double-gauss-28", "--heights", "1e300"]);
    assert_error_line(&far, USAGE, &["--heights 1e300: ", "is 1e300 mm, expected 0 to"]);
    // The axis alone.
    let axis =
        lenscube(&["lens", "show", "double-gauss-28", "--heights", "0", "--wavelengths", "550", "--json"])
            .ok();
    let axis: Value = serde_json::from_str(&axis.stdout).unwrap();
    assert_eq!(axis["fields"].as_array().unwrap().len(), 1, "{axis}");
    let small = ["--heights", "0,2", "--wavelengths", "550", "--lp-mm", "10,30", "--plot", text(&plots)];
    lenscube(&[&["lens", "show", "double-gauss-28"], &small[..]].concat()).ok();
    for (file, word) in [
        ("relative-illumination", "relative illumination"),
        ("distortion", "% of f tan θ"),
        ("lateral-colour", "µm"),
        ("mtf-field", "30 lp/mm"),
        ("mtf-frequency", "spatial frequency"),
        ("psf", "base64"),
        ("nodes", "kernels at"),
        ("layout", "z from the first surface (mm)"),
        ("encircled-energy", "share of the light"),
        ("spots", "wavelength (nm)"),
        ("ray-fans", "ray error (µm)"),
        ("opd-fans", "OPD (waves)"),
        ("field-curvature", "focus from the film (mm)"),
        ("mtf-focus", "film position (mm)"),
    ] {
        let svg = fs::read_to_string(plots.join(format!("{file}.svg"))).unwrap();
        assert!(svg.starts_with("<svg") && svg.ends_with("</svg>\n") && svg.contains(word), "{file}");
        let png = fs::read(plots.join(format!("{file}.png"))).unwrap();
        assert!(png.starts_with(b"\x89PNG"), "{file}");
    }
    assert_eq!(fs::read_dir(&plots).unwrap().count(), 2 * 14);
    let again = [&["lens", "show", "double-gauss-28"], &small[..]].concat();
    let ran = lenscube(&again);
    assert_exit(&ran, OTHER_JOB, &["relative-illumination.svg already exists", "--overwrite"]);
    assert_eq!(ran.stdout, "");
    // Only what would be replaced is in the way.
    fs::remove_dir_all(&plots).unwrap();
    fs::create_dir(&plots).unwrap();
    fs::write(plots.join("mine.svg"), "mine").unwrap();
    fs::write(plots.join("spots.png"), "mine").unwrap();
    assert_exit(&lenscube(&again), OTHER_JOB, &["spots.png already exists"]);
    lenscube(&[&again[..], &["--overwrite"]].concat()).ok();
    assert_eq!(fs::read(plots.join("mine.svg")).unwrap(), b"mine");
    assert!(fs::read(plots.join("spots.png")).unwrap().starts_with(b"\x89PNG"));
}

#[test]
fn list_draws_every_built_in_lens() {
    let dir = tempfile::tempdir().unwrap();
    let pictures = dir.path().join("pictures");
    let listed = json(lenscube(&["lens", "list", "--json", "--plot", text(&pictures)]));
    let names: Vec<&str> =
        listed["designs"].as_array().unwrap().iter().filter_map(|d| d["name"].as_str()).collect();
    assert!(names.len() >= 14, "{names:?}");
    for name in &names {
        let svg = fs::read_to_string(pictures.join(format!("{name}.svg"))).unwrap();
        assert!(svg.contains("z from the first surface (mm)"), "{name}");
        assert!(fs::read(pictures.join(format!("{name}.png"))).unwrap().starts_with(b"\x89PNG"), "{name}");
    }
    assert_eq!(fs::read_dir(&pictures).unwrap().count(), 2 * names.len());
    assert_exit(&lenscube(&["lens", "list", "--plot", text(&pictures)]), OTHER_JOB, &["already exists"]);
}

#[test]
fn show_pack_prints_its_tables_and_rejects_design_flags() {
    let dir = tempfile::tempdir().unwrap();
    let pack = "double-gauss-28-npz";
    let shown = json(lenscube(&["lens", "show", pack, "--json", "--wavelengths", "550", "--heights", "10"]));
    let tables = formats::lens::builtin(pack).unwrap();
    let band = &tables.lens().bands[15];
    let field = &shown["fields"][0];
    assert_eq!(field["relative_illumination"].as_f64().unwrap(), band.illumination_at(10.0));
    assert!(field["strehl"].is_null() && field["geo_um"].is_null(), "not available from integrated samples");
    let plots = dir.path().join("plots");
    lenscube(&["lens", "show", pack, "--plot", text(&plots)]).ok();
    assert!(plots.join("mtf-field.svg").exists() && !plots.join("layout.svg").exists());
    assert_exit(
        &lenscube(&["lens", "show", pack, "--image-plane", "rms"]),
        USAGE,
        &["is a lens pack", "designs"],
    );
    assert_exit(
        &lenscube(&["lens", "show", pack, "--wavelengths", "555"]),
        USAGE,
        &["no band at 555 nm", "400:700:10"],
    );
    assert_exit(
        &lenscube(&["lens", "show", pack, "--heights", "0,30"]),
        USAGE,
        &["data up to 20.8", "30 mm"],
    );
}

/// Strehl ratio from the PSF of a pack (its peak over that of a uniform pupil) and from the rays of the design.
#[test]
fn strehl_of_pack_and_design_agree() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("a.lens.zarr");
    trace("double-gauss-28", &out, &[]).ok();
    let strehl = |lens: &str| {
        let shown = json(lenscube(&[
            "lens",
            "show",
            lens,
            "--json",
            "--wavelengths",
            "500,600",
            "--heights",
            "0,1.5,3",
        ]));
        let of = |f: &Value| f["strehl"].as_f64().unwrap();
        shown["fields"].as_array().unwrap().iter().map(of).collect::<Vec<_>>()
    };
    let (of_pack, of_rays) = (strehl(text(&out)), strehl("double-gauss-28"));
    assert_eq!((of_pack.len(), of_rays.len()), (6, 6));
    for (pack, rays) in of_pack.into_iter().zip(of_rays) {
        assert!((pack / rays - 1.0).abs() < 2e-3, "{pack} {rays}");
    }
}

#[test]
fn diff_of_equal_lenses_is_zero_and_of_a_defocused_lens_large() {
    let same = ["lens", "diff", "double-gauss-28", "double-gauss-28", "--json", "--heights", "0,4"];
    let none = json(lenscube(&same));
    assert_eq!(none["largest_psf_l1"], 0.0);
    let largest = none["largest_difference"].as_object().unwrap();
    assert!(largest.len() == 7 && largest.values().all(|v| *v == 0.0), "{largest:?}");
    let words = ["lens", "diff", "double-gauss-28", "double-gauss-28-npz", "--wavelengths", "500,600"];
    // The same prescription computed by other software, whose PSFs are normalised in 102 µm.
    let other = json(lenscube(&[&words[..], &["--heights", "0,10", "--json"]].concat()));
    let differs = |key: &str| other["largest_difference"][key].as_f64().unwrap();
    // Its relative illumination is the solid angle of the bundle, 7e-4 below the light per film area at 10 mm.
    assert!(differs("ideal_height_mm") < 1e-4 && differs("relative_illumination") < 1e-3, "{other}");
    assert!(other["largest_psf_l1"].as_f64().unwrap() < 0.02, "{other}");
    let defocused =
        json(lenscube(&[&words[..], &["--heights", "0,10", "--json", "--defocus-mm", "0.05"]].concat()));
    assert!(defocused["largest_psf_l1"].as_f64().unwrap() > 0.1);
    let text = lenscube(&[&words[..], &["--heights", "0,10"]].concat()).ok().stdout;
    assert!(text.contains("maximum difference") && text.contains("PSF L1"), "{text}");
    assert_exit(
        &lenscube(&["lens", "diff", "double-gauss-28-npz", "nowhere.lens.zarr"]),
        FAILED,
        &["nowhere.lens.zarr"],
    );
}

#[test]
fn former_names_of_size_and_pitch_are_read() {
    let camera = |size: &str, pitch: &str| {
        lenscube(&["lens", "camera", "triplet", size, "300x200", pitch, "5", "--json"]).ok().stdout
    };
    assert_eq!(camera("--film-size", "--film-pitch-um"), camera("--film", "--pitch-um"));
    let help = lenscube(&["lens", "camera", "--help"]).ok().stdout;
    assert!(help.contains("--film-size") && !help.contains("--pitch-um "), "{help}");
    let dir = tempfile::tempdir().unwrap();
    let chart = |name: &str, size: &str, pitch: &str| {
        let path = dir.path().join(name);
        lenscube(&["chart", "checker", text(&path), size, "60x40", pitch, "3", "--wavelengths", "550"]).ok();
        files(&path)
    };
    assert!(chart("a", "--film-size", "--film-pitch-um") == chart("b", "--size", "--pitch-um"));
    for command in ["validate", "bench", "demo"] {
        let words = [command, "--size", "12", "--film-size", "12"];
        assert_exit(&lenscube(&words), USAGE, &["--film-size"]);
    }
}
