//! `--check-input`: charts of every kind that are changed without a change of size and modification time, and others that are touched only.

use crate::common::{
    CommandResult, assert_error_line, assert_exit, files, identity_band, lens, run, scattered, text,
    write_pack,
};
use std::fs;
use std::path::{Path, PathBuf};

const OTHER_JOB: i32 = 3;

/// A folder with a lens pack, a chart in a file or folder of its own, and its film.
struct Place {
    dir: tempfile::TempDir,
    chart: String,
    flags: Vec<&'static str>,
}

impl Place {
    /// With a copy of `fixture`, opened as `chart` in it.
    fn new(fixture: &str, chart: &str, flags: &[&'static str]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let from = Path::new(env!("CARGO_MANIFEST_DIR")).join("formats/tests/data").join(fixture);
        let to = dir.path().join("chart").join(from.file_name().unwrap());
        let all =
            if from.is_dir() { files(&from) } else { [(PathBuf::new(), fs::read(&from).unwrap())].into() };
        for (name, bytes) in all {
            let to = if name.as_os_str().is_empty() { to.clone() } else { to.join(name) };
            fs::create_dir_all(to.parent().unwrap()).unwrap();
            fs::write(to, bytes).unwrap();
        }
        let lens = lens([400.0, 410.0, 420.5].map(|nm| identity_band(nm, 0.2, 5)).into());
        let stacks = lens.bands.iter().zip(1..).map(|(b, seed)| scattered(seed, b)).collect();
        write_pack(&dir.path().join("pack.lens.zarr"), &lens, stacks);
        Self { chart: format!("{}{chart}", text(&to)), flags: flags.to_vec(), dir }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn run(&self, film: &str, flags: &[&str]) -> CommandResult {
        let all = [&["--film-pitch-um", "2", "--film-size", "35x33"], &self.flags[..], flags].concat();
        run(&self.chart, &self.at(film), text(&self.at("pack.lens.zarr")), &all)
    }

    /// A file with samples: the last one of the chart that is not JSON.
    fn data(&self) -> PathBuf {
        let mut found: Vec<_> =
            files(&self.at("chart")).into_keys().map(|f| self.at("chart").join(f)).collect();
        found.retain(|file| {
            file.extension().is_none_or(|e| e != "json") && !text(file).contains("wavelength/")
        });
        found.pop().unwrap()
    }
}

/// Changes the last byte of a file, and restores its modification time.
fn change(file: &Path) {
    let modified = fs::metadata(file).unwrap().modified().unwrap();
    let mut bytes = fs::read(file).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    fs::write(file, bytes).unwrap();
    fs::File::options().write(true).open(file).unwrap().set_modified(modified).unwrap();
}

#[test]
fn changed_bytes_of_every_kind_of_chart_are_another_job() {
    let nm = ["--wavelengths", "400,410,420.5"];
    let axes = ["--axes", "y,x,wavelength", "--wavelengths", "400,410,420.5"];
    let cases: [(&str, &str, &[&str]); 5] = [
        ("charts/v3-sharded", "", &[]),
        ("pictures/y-x-wavelength.npy", "", &axes),
        ("pictures/png16", "", &[]),
        ("pictures/tiff/pages-f64.tif", "", &nm),
        ("hdf5/filters.h5", "//scene/deflate", &[]),
    ];
    for (fixture, array, flags) in cases {
        let place = Place::new(fixture, array, flags);
        place.run("film.zarr", &["--check-input"]).ok();
        place.run("by-time.zarr", &[]).ok();
        let data = place.data();
        change(&data);
        // The film knows that its chart is identified by content.
        for given in [&["--check-input"][..], &[], &["--trust-input"]] {
            assert_error_line(&place.run("film.zarr", given), OTHER_JOB, &["content of the chart (film "]);
        }
        // Files so small are in its sample as a whole.
        for given in [&[][..], &["--trust-input"]] {
            assert_error_line(&place.run("by-time.zarr", given), OTHER_JOB, &["content of the chart (film "]);
        }
        // The same bytes at another time.
        change(&data);
        fs::File::options().write(true).open(&data).unwrap().set_modified(std::time::UNIX_EPOCH).unwrap();
        assert_exit(&place.run("film.zarr", &[]), 0, &["is complete"]);
        assert_error_line(
            &place.run("by-time.zarr", &[]),
            OTHER_JOB,
            &["modification times", "--trust-input"],
        );
    }
}

#[test]
fn another_chart_of_the_same_size_and_time_is_another_job() {
    let place = Place::new(
        "pictures/y-x-wavelength.npy",
        "",
        &["--axes", "y,x,wavelength", "--wavelengths", "400,410,420.5"],
    );
    let (first, link) = (place.data(), place.at("link.npy"));
    let other = place.at("other.npy");
    fs::copy(&first, &other).unwrap();
    change(&other);
    let time = fs::metadata(&first).unwrap().modified().unwrap();
    fs::File::options().write(true).open(&other).unwrap().set_modified(time).unwrap();
    std::os::unix::fs::symlink(&first, &link).unwrap();
    let run = |chart: &Path| {
        let all = [&["--film-pitch-um", "2", "--film-size", "35x33"], &place.flags[..]].concat();
        run(text(chart), &place.at("film.zarr"), text(&place.at("pack.lens.zarr")), &all)
    };
    run(&link).ok();
    fs::copy(&first, place.at("moved.npy")).unwrap();
    fs::File::options().write(true).open(place.at("moved.npy")).unwrap().set_modified(time).unwrap();
    assert_exit(&run(&place.at("moved.npy")), 0, &["is complete"]);
    fs::remove_file(&link).unwrap();
    std::os::unix::fs::symlink(&other, &link).unwrap();
    for chart in [&link, &other] {
        assert_error_line(&run(chart), OTHER_JOB, &["content of the chart (film "]);
    }
}

#[test]
fn film_without_a_recorded_content_continues_when_it_is_trusted() {
    let place = Place::new("charts/v3-sharded", "", &[]);
    place.run("film.zarr", &[]).ok();
    let words = ["created without --check-input", "content of the chart (film nothing", "--trust-input"];
    assert_error_line(&place.run("film.zarr", &["--check-input"]), OTHER_JOB, &words);
    assert_exit(&place.run("film.zarr", &["--check-input", "--trust-input"]), 0, &["is complete"]);
    assert_exit(&place.run("film.zarr", &[]), 0, &["is complete"]);
}

#[test]
fn objects_have_no_content_to_check() {
    let place = Place::new("charts/v3-sharded", "", &[]);
    let url = Place { chart: "s3://bucket/chart.zarr".into(), ..place };
    assert_error_line(
        &url.run("film.zarr", &["--check-input"]),
        2,
        &["--check-input", "s3://bucket", "ETags"],
    );
    assert!(!url.at("film.zarr").exists());
}
