//! Charts in files of other software (formats/tests/data/make_charts.py, make_pictures.py, make_hdf5.py): each gives the film of its Zarr twin bit for
//! bit.

use crate::common::{
    CommandResult, assert_error_line, assert_exit, bits, identity_band, lens, pixels, run, scattered, text,
    write_pack,
};
use std::path::{Path, PathBuf};

const NM: &str = "400,410,420.5";

struct Films {
    dir: tempfile::TempDir,
    pack: PathBuf,
}

impl Films {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        let pack = dir.path().join("pack.lens.zarr");
        let lens = lens([400.0, 410.0, 420.5].map(|nm| identity_band(nm, 0.2, 5)).into());
        let stacks = lens.bands.iter().zip(1..).map(|(b, seed)| scattered(seed, b)).collect();
        write_pack(&pack, &lens, stacks);
        Self { dir, pack }
    }

    fn film(&self, name: &str) -> PathBuf {
        self.dir.path().join(format!("{}.zarr", name.replace(['/', '*'], "-")))
    }

    fn run(&self, chart: &str, flags: &[&str]) -> CommandResult {
        let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("formats/tests/data").join(chart);
        let flags = [&["--film-pitch-um", "2", "--film-size", "35x33"], flags].concat();
        run(text(&fixture), &self.film(chart), text(&self.pack), &flags)
    }

    fn bits(&self, chart: &str, flags: &[&str]) -> Vec<Vec<u32>> {
        self.run(chart, flags).ok();
        bits(&pixels(&self.film(chart), "film").1)
    }
}

#[test]
fn charts_of_other_software_give_the_film_of_their_zarr_twin() {
    let films = Films::new();
    let twin = films.bits("charts/v3-sharded", &[]);
    let (nm, axes) = (["--wavelengths", NM], ["--axes", "y,x,wavelength", "--wavelengths", NM]);
    let cases: [(&str, &[&str]); 20] = [
        ("charts/v3-columns-first", &[]),
        ("charts/v3-wrong-order", &nm),
        ("pictures/png16", &[]),
        ("pictures/png16/scene_*.png", &["--memory", "200MiB"]),
        ("pictures/numbered-tif", &nm),
        ("pictures/tiff/planar-deflate-f32.tif", &[]),
        ("pictures/tiff/chunky-tiled-big-endian-bigtiff.tif", &[]),
        ("pictures/tiff/chunky-lzw-u8.tif", &[]),
        ("pictures/tiff/planar-one-strip-u16.tif", &[]),
        ("pictures/tiff/pages-f64.tif", &nm),
        ("pictures/gdal/descriptions.tif", &[]),
        ("pictures/gdal/scaled.tif", &[]),
        ("hdf5/matlab.mat", &[]),
        ("hdf5/matlab-contiguous.mat//rad", &[]),
        ("hdf5/filters.h5", &["--var", "scene/deflate", "--memory", "200MiB"]),
        ("hdf5/netcdf4.nc", &[]),
        ("hdf5/packed.nc//radiance", &[]),
        ("hdf5/latest.h5", &["--var", "extensible"]),
        ("pictures/fortran-y-x-wavelength.npy", &axes),
        ("pictures/y-x-wavelength.npy", &axes),
    ];
    for (chart, flags) in cases {
        assert!(films.bits(chart, flags) == twin, "{chart}");
    }
}

#[test]
fn chart_scale_is_noted_and_gives_another_job() {
    let films = Films::new();
    let chart = "pictures/png16";
    let ran = films.run(chart, &[]).ok();
    assert!(
        ran.stderr.contains("integers, whose values are used as they are; --chart-scale"),
        "{}",
        ran.stderr
    );
    assert!(ran.stderr.contains("scene_400nm.png (400 nm)"), "{}", ran.stderr);
    let one = pixels(&films.film(chart), "film").1;
    assert_error_line(&films.run(chart, &["--chart-scale", "0.25"]), 3, &["another job", "chart"]);
    let ran = films.run(chart, &["--chart-scale", "0.25", "--overwrite"]).ok();
    assert!(ran.stderr.contains("multiplied by 0.25"), "{}", ran.stderr);
    let quarter = pixels(&films.film(chart), "film").1;
    for (a, b) in crate::common::pairs(&one, &quarter) {
        assert!((a * 0.25 - b).abs() <= 1e-4, "{a} {b}");
    }
    assert_exit(&films.run(chart, &["--chart-scale", "0"]), 2, &["--chart-scale"]);
}

#[test]
fn integers_with_a_scale_of_their_own_have_one_note_on_it() {
    let films = Films::new();
    for chart in ["hdf5/packed.nc//radiance", "pictures/gdal/scaled.tif"] {
        let ran = films.run(chart, &[]).ok();
        assert!(!ran.stderr.contains("--chart-scale"), "{chart}: {}", ran.stderr);
        let ran = films.run(chart, &["--chart-scale", "0.5", "--overwrite"]).ok();
        assert!(ran.stderr.contains("multiplied by 0.5 (--chart-scale)"), "{chart}: {}", ran.stderr);
    }
}

#[test]
fn chart_units_are_those_of_the_film() {
    let films = Films::new();
    let chart = "pictures/fortran-y-x-wavelength.npy";
    let flags = ["--axes", "y,x,wavelength", "--wavelengths", NM];
    let units = |film: &Path| {
        let text = std::fs::read_to_string(film.join("film/zarr.json")).unwrap();
        serde_json::from_str::<serde_json::Value>(&text).unwrap()["attributes"]["units"].clone()
    };
    films.run(chart, &flags).ok();
    assert_eq!(units(&films.film(chart)), "relative");
    let radiance = ["--chart-units", "µW cm-2 sr-1 nm-1"];
    films.run(chart, &[&flags[..], &radiance, &["--overwrite"]].concat()).ok();
    assert_eq!(units(&films.film(chart)), radiance[1]);
    // A film in physical units says how to convert such a chart.
    let ran =
        films.run(chart, &[&flags[..], &radiance, &["--film-units", "photons", "--overwrite"]].concat());
    assert_exit(&ran, 2, &["--chart-scale 0.01 --chart-units 'W m-2 sr-1 nm-1'"]);
    assert_exit(&films.run(chart, &["--chart-units", " "]), 2, &["--chart-units"]);
}

#[test]
fn missing_wavelengths_and_misplaced_axes_are_usage_errors() {
    let films = Films::new();
    let words = ["numbered-tif", "name of each of the 3 pictures", "--wavelengths"];
    assert_error_line(&films.run("pictures/numbered-tif", &[]), 2, &words);
    assert_error_line(&films.run("pictures/numbered-tif", &["--wavelengths", "400,410"]), 1, &["found 2"]);
    assert_error_line(&films.run("pictures/tiff/pages-f64.tif", &[]), 2, &["3 bands", "--wavelengths"]);
    assert_error_line(&films.run("pictures/png16", &["--axes", "y,x"]), 2, &["--axes", "each picture"]);
    let npy = "pictures/y-x-wavelength.npy";
    assert_error_line(&films.run(npy, &[]), 1, &["[37, 41, 3]", "--axes y,x,wavelength"]);
    assert_error_line(&films.run("hdf5/filters.h5", &[]), 1, &["several have three axes", "scene/lzf"]);
    assert_error_line(&films.run("hdf5/matlab.mat//rad", &["--var", "rad"]), 2, &["names its array"]);
    assert_error_line(&films.run(npy, &["--var", "rad"]), 2, &["--var", "y-x-wavelength.npy"]);
    assert_error_line(&films.run("hdf5/matlab-v5.mat", &[]), 2, &["2 bands", "--wavelengths"]);
    assert_error_line(&films.run("matlab/scene.mat//no", &[]), 1, &["no", "scene/data/photons [4, 5, 3]"]);
    assert_error_line(
        &films.run("matlab/photons.mat", &["--axes", "y,x,wavelength"]),
        2,
        &["--axes", "permute"],
    );
    assert_error_line(&films.run("hdf5/netcdf3.nc", &[]), 1, &["NetCDF-3", "to_zarr"]);
    assert_exit(&films.run(npy, &["--axes", "y,z,x"]), 2, &["--axes", "wavelength, y and x"]);
    let colour = "pictures/colour/rgb.png";
    assert_error_line(&films.run(colour, &[]), 1, &["a picture", "lenscube chart image"]);
}
