//! Invalid charts and samples.

use super::*;

#[test]
fn missing_or_foreign_chart_exits_1_and_names_the_path() {
    let job = SmallJob::new();
    let assert_invalid = |chart: &Path, words: &[&str]| {
        assert_error_line(&run(text(chart), &job.film, text(&job.pack), &[]), FAILED, words);
        assert!(!job.film.exists());
    };
    let at = |name: &str| job.dir.path().join(name);
    assert_invalid(&at("nowhere.zarr"), &["nowhere.zarr", "not found"]);
    fs::create_dir(at("empty")).unwrap();
    assert_invalid(&at("empty"), &["empty", "no Zarr metadata", "Zarr v2 or v3"]);
    fs::write(at("file.tif"), "II*").unwrap();
    assert_invalid(&at("file.tif"), &["file.tif", "unsupported format .tif"]);
    fs::write(at("cut.tif"), b"II*\0\x08\0\0\0").unwrap();
    assert_invalid(&at("cut.tif"), &["cut.tif", "damaged"]);
    fs::write(at("cube.mat"), "MATLAB 5.0 MAT-file").unwrap();
    assert_invalid(&at("cube.mat"), &["cube.mat", "complete"]);
    fs::write(at("cube.xyz"), "1 2 3").unwrap();
    assert_invalid(&at("cube.xyz"), &["unsupported format .xyz; supported: Zarr"]);
    let made = std::process::Command::new("mkfifo").arg(at("pipe.npy")).status().unwrap();
    assert!(made.success());
    let pipe = run(text(&at("pipe.npy")), &job.film, text(&job.pack), &[]);
    assert_error_line(&pipe, USAGE, &["the chart", "pipe.npy is a FIFO or pipe", "not a regular file"]);
    assert_invalid(&job.pack, &["no array", "chart", "wavelength"]);
    fs::write(at("empty/zarr.json"), "{\"zarr_format\": 3,").unwrap();
    assert_invalid(&at("empty"), &["empty", "JSON"]);
}

#[test]
fn chart_with_wrong_axes_type_or_missing_metadata_is_rejected() {
    let array = |job: &SmallJob| job.chart.join("chart/zarr.json");
    let job = SmallJob::new();
    edit(&array(&job), |j| j["dimension_names"] = json!(["y", "time", "depth"]));
    job.assert_rejected(&[], FAILED, &["any order", "(y, time, depth)", "--axes"]);
    let job = SmallJob::new();
    edit(&array(&job), |j| (j["data_type"], j["fill_value"]) = (json!("int64"), json!(0)));
    job.assert_rejected(&[], FAILED, &["sample type", "float32", "int64"]);
    let job = SmallJob::new();
    edit(&job.chart.join("zarr.json"), |j| j["attributes"] = json!({}));
    job.assert_rejected(&[], USAGE, &["pitch_um", "--film-pitch-um"]);
    job.run(&["--film-pitch-um", "2"]).ok();
    let job = SmallJob::new();
    fs::remove_dir_all(job.chart.join("wavelength")).unwrap();
    job.assert_rejected(&[], USAGE, &["wavelengths", "3 bands", "--wavelengths"]);
    job.assert_rejected(&["--wavelengths", "450,500"], FAILED, &["3 bands", "found 2"]);
    job.run(&["--wavelengths", "450:550:50"]).ok();
}

/// Job with a chart as another program may write it: `picture`, which may contain NaN and infinity, one uncompressed file per band.
/// `attributes` are those of the array.
fn job_with_raw_chart(picture: Picture, attributes: Value) -> SmallJob {
    let finite = |v: &f32| if v.is_finite() { *v } else { 0.0 };
    let numbers = picture.bands.iter().map(|b| b.iter().map(finite).collect()).collect();
    let job = SmallJob::with(Picture { size: picture.size, bands: numbers });
    let array = job.chart.join("chart");
    let mut metadata: Value = serde_json::from_slice(&fs::read(array.join("zarr.json")).unwrap()).unwrap();
    metadata["chunk_grid"]["configuration"]["chunk_shape"] =
        json!([1, picture.size.height, picture.size.width]);
    metadata["codecs"] = json!([{"name": "bytes", "configuration": {"endian": "little"}}]);
    metadata["attributes"] = attributes;
    fs::write(array.join("zarr.json"), metadata.to_string()).unwrap();
    fs::remove_dir_all(array.join("c")).unwrap();
    for (band, values) in picture.bands.iter().enumerate() {
        let directory = array.join(format!("c/{band}/0"));
        fs::create_dir_all(&directory).unwrap();
        fs::write(directory.join("0"), values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>())
            .unwrap();
    }
    job
}

#[test]
fn sample_above_1e30_is_an_error_with_band_row_column() {
    for huge in [9.969_21e36, -3.4e38] {
        let mut picture = Picture::noise(5, Size::new(90, 100), 3);
        picture.bands[1][7 * 100 + 13] = huge;
        let job = job_with_raw_chart(picture, json!({}));
        job.assert_fails(&[], &["band 1, row 7, column 13", "at most 1e30", "_FillValue"]);
        // `--nan zero` does not replace large values.
        job.assert_fails(&["--nan", "zero", "--overwrite"], &["band 1, row 7, column 13"]);
        job.assert_fails(&["--dtype", "f16", "--overwrite"], &["band 1, row 7, column 13"]);
    }
}

#[test]
fn fill_value_is_an_error_or_a_counted_zero() {
    let clean = Picture::noise(5, Size::new(90, 100), 3);
    let mut holed = Picture { size: clean.size, bands: clean.bands.clone() };
    let mut zeros = clean;
    for k in [7 * 100 + 13, 89 * 100 + 99] {
        (holed.bands[1][k], zeros.bands[1][k]) = (9.969_21e36, 0.0);
    }
    let job = job_with_raw_chart(holed, json!({"_FillValue": 9.969_209_968_386_869e36}));
    job.assert_fails(&[], &["no data", "band 1, row 7, column 13", "--nan zero"]);
    let ran = job.run(&["--nan", "zero", "--overwrite"]).ok();
    assert!(ran.stderr.contains("2 NaN or infinite pixels or fill values"), "{}", ran.stderr);
    let other = SmallJob::with(zeros);
    other.run(&[]).ok();
    assert_eq!(pixels(&job.film, "film"), pixels(&other.film, "film"));
}

#[test]
fn generated_value_above_1e30_exits_2() {
    let job = SmallJob::new();
    let ran = run("gen:uniform?size=40&value=1e35&wavelengths=500", &job.film, text(&job.pack), &[]);
    assert_error_line(&ran, USAGE, &["value=1e35", "at most 1e30"]);
}

#[test]
fn nan_or_infinite_pixel_is_an_error_with_band_row_column() {
    let clean = || Picture::noise(5, Size::new(90, 100), 3);
    // One bad pixel per chart: with several, any of them may be reported.
    for (band, row, column, value) in [(1, 7, 13, f32::NAN), (2, 89, 99, f32::NEG_INFINITY)] {
        let mut picture = clean();
        picture.bands[band][row * 100 + column] = value;
        let at = format!("{value} at band {band}, row {row}, column {column}");
        job_with_raw_chart(picture, json!({})).assert_fails(&[], &[&at, "--nan zero"]);
    }
    let (mut picture, mut zeros) = (clean(), clean());
    for (band, pixel, value) in [(1, 7 * 100 + 13, f32::NAN), (2, 89 * 100 + 99, f32::NEG_INFINITY)] {
        (picture.bands[band][pixel], zeros.bands[band][pixel]) = (value, 0.0);
    }
    let job = job_with_raw_chart(picture, json!({}));
    job.assert_fails(&[], &["--nan zero"]);
    let job = SmallJob { film: job.dir.path().join("zero.zarr"), ..job };
    let ran = job.run(&["--nan", "zero"]).ok();
    assert!(ran.stderr.contains("2 NaN or infinite pixels"), "{}", ran.stderr);
    let other = SmallJob::with(zeros);
    other.run(&[]).ok();
    assert_eq!(pixels(&job.film, "film"), pixels(&other.film, "film"));
}

#[test]
fn film_without_a_shard_is_begun_again_by_another_job() {
    let mut picture = Picture::noise(5, Size::new(90, 100), 1);
    picture.bands[0][713] = f32::NAN;
    let job = job_with_raw_chart(picture, json!({}));
    job.assert_fails(&[], &["--nan zero"]);
    let ran = job.run(&["--nan", "zero"]).ok();
    assert!(ran.stderr.contains("has no shard yet: it begins again"), "{}", ran.stderr);
    // With its shard it is a film again that only its own job continues.
    assert_error_line(&job.run(&["--nan", "error"]), OTHER_JOB, &["another job", "nan", "--overwrite"]);
}

#[test]
fn damaged_chart_chunk_exits_1_and_names_the_file() {
    let job = SmallJob::new();
    let chunk = job.chart.join("chart/c/1/0/0");
    let good = fs::read(&chunk).unwrap();
    flip_bit(&chunk);
    job.assert_fails(&[], &["chart/c/1/0/0", "damaged", "checksum"]);
    fs::write(&chunk, &good[..good.len() / 2]).unwrap();
    fs::remove_dir_all(&job.film).unwrap();
    job.assert_fails(&[], &["chart/c/1/0/0", "damaged"]);
}

#[test]
fn restored_chart_is_another_chart_that_begins_a_film_without_a_shard_again() {
    // Of one band, whose only shard needs the damaged chunk: of several, others may be written before the failure.
    let job = SmallJob::with(Picture::noise(5, Size::new(90, 100), 1));
    let chunk = job.chart.join("chart/c/0/0/0");
    let good = fs::read(&chunk).unwrap();
    fs::write(&chunk, &good[..good.len() / 2]).unwrap();
    job.assert_fails(&[], &["chart/c/0/0/0", "damaged"]);
    // The restored file has another modification time, so the job has another chart.
    fs::write(&chunk, &good).unwrap();
    let ran = job.run(&[]).ok();
    assert!(ran.stderr.contains("has no shard yet"), "{}", ran.stderr);
    fs::write(&chunk, good).unwrap();
    assert_error_line(&job.run(&[]), OTHER_JOB, &["another job", "chart"]);
    job.run(&["--overwrite"]).ok();
}
