//! Invalid lens packs, and films outside their tables.

use super::*;

/// Replaces a table of a pack by an uncompressed f64 array.
fn replace_table(pack: &Path, name: &str, shape: [usize; 2], values: &[f64]) {
    let array = pack.join(name);
    fs::remove_dir_all(&array).unwrap();
    fs::create_dir_all(array.join("c/0")).unwrap();
    let metadata = json!({
        "zarr_format": 3, "node_type": "array", "shape": shape, "data_type": "float64", "fill_value": 0.0,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": shape}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "codecs": [{"name": "bytes", "configuration": {"endian": "little"}}], "attributes": {},
    });
    fs::write(array.join("zarr.json"), metadata.to_string()).unwrap();
    fs::write(array.join("c/0/0"), values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()).unwrap();
}

#[test]
fn bands_or_film_outside_the_lens_tables_exit_1() {
    let job = SmallJob::new();
    job.assert_rejected(&["--wavelengths", "450,500,560"], FAILED, &["560 nm", "outside", "450..550 nm"]);
    let between = ["--wavelengths", "450,500,520"];
    job.assert_rejected(&between, FAILED, &["520 nm", "500 and 550 nm", "--interpolate-psf"]);
    let axis = ["--axis", "0,0", "--film-size", "100x90"];
    // hypot(89 + 2, 99 + 2) px of 2 µm: the far corner and half a window.
    job.assert_rejected(&axis, FAILED, &["0.2718", "0.2000", "450 nm", "--outside clamp"]);
    job.run(&[&axis[..], &["--outside", "clamp"]].concat()).ok();
}

#[test]
fn invalid_lens_pack_exits_1_and_names_the_array() {
    let assert_invalid_pack = |damage: &dyn Fn(&Path), words: &[&str]| {
        let job = SmallJob::new();
        damage(&job.pack);
        job.assert_rejected(&[], FAILED, words);
    };
    assert_invalid_pack(
        &|p| edit(&p.join("zarr.json"), |j| j["attributes"]["schema"] = json!("lenscube/lens-pack/9")),
        &["schema", "lens-pack/9", "lens-pack/1"],
    );
    assert_invalid_pack(&|p| fs::remove_dir_all(p.join("psf_energy")).unwrap(), &["psf_energy", "missing"]);
    assert_invalid_pack(&|p| fs::remove_file(p.join("psf/1/c/2/0/0")).unwrap(), &["psf/1", "missing"]);
    assert_invalid_pack(&|p| flip_bit(&p.join("psf/1/c/2/0/0")), &["psf/1/c/2/0/0", "damaged"]);
    let cut = |p: &Path| {
        let file = p.join("psf/2/c/3/0/0");
        fs::write(&file, &fs::read(&file).unwrap()[..20]).unwrap();
    };
    assert_invalid_pack(&cut, &["psf/2/c/3/0/0", "damaged"]);
    let heights = [[0.0, 0.1, 0.05, 0.2]; 3].concat();
    assert_invalid_pack(&|p| replace_table(p, "psf_height", [3, 4], &heights), &["psf_height", "ascend"]);
    let job = SmallJob::new();
    for (lens, code, words) in [
        ("nowhere.lens.zarr", FAILED, vec!["nowhere.lens.zarr", "no lens pack"]),
        ("no-such-lens", USAGE, vec!["no-such-lens", "double-gauss-28"]),
        (text(&job.chart), FAILED, vec!["schema"]),
    ] {
        assert_error_line(&run(text(&job.chart), &job.film, lens, &[]), code, &words);
        assert!(!job.film.exists());
    }
    // A truncated pack as one file.
    let zip = job.dir.path().join("pack.lens.zip");
    let tables = lens(vec![identity_band(450.0, 0.2, 5)]);
    let stacks = tables.bands.iter().map(|b| Ok::<_, LensPackError>(delta(b)));
    formats::lens::write(&zip, &tables, &PackAttributes::default(), stacks).unwrap();
    let bytes = fs::read(&zip).unwrap();
    fs::write(&zip, &bytes[..bytes.len() / 2]).unwrap();
    assert_error_line(
        &run(text(&job.chart), &job.film, text(&zip), &[]),
        FAILED,
        &["pack.lens.zip", "truncated"],
    );
    assert!(!job.film.exists());
}
