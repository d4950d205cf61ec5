//! Ghosts of a pack: optional group, digest, invalid operators.

use super::{small_attributes, small_lens, small_psf};
use lenscube_formats::lens::{LensPack, LensPackError, LensPackWriter};
use pipeline::design::ghost::report::PathFigures;
use pipeline::design::ghost::rings::{RingOperator, RingSizes};
use std::path::Path;

/// An operator of the given light: that of each order has the other sign and a smaller share.
fn operator(rings: usize, light: f32) -> RingOperator {
    let sizes = RingSizes::new(3.0, rings);
    let [orders, film, scene] = sizes.shape();
    let value = |order: usize, at: usize| {
        let sign = if order.is_multiple_of(2) { 1.0 } else { -1.0 };
        sign * light * (1 + at % 7) as f32 / (1 + order) as f32
    };
    let values = (0..orders).flat_map(|order| (0..film * scene).map(move |at| value(order, at))).collect();
    RingOperator { sizes, values }
}

/// Writes the small lens with ghosts at `path`: band, operator, reflectance of the film.
fn write(path: &Path, ghosts: &[(usize, RingOperator, f64)]) -> Result<LensPack, LensPackError> {
    let lens = small_lens();
    let mut writer = LensPackWriter::create(path)?;
    for band in 0..lens.bands.len() {
        writer.psf(band, &small_psf(&lens, band))?;
    }
    for (band, operator, reflectance) in ghosts {
        writer.ghosts(*band, operator, *reflectance)?;
    }
    writer.finish(&lens, &small_attributes())?;
    LensPack::open(path)
}

fn both(light: f32, reflectance: f64) -> [(usize, RingOperator, f64); 2] {
    [(0, operator(16, 1e-6), 0.05), (1, operator(16, light), reflectance)]
}

#[test]
fn ghosts_are_read_as_written_and_belong_to_the_digest_of_their_band() {
    for ending in ["zarr", "zip"] {
        let dir = tempfile::tempdir().unwrap();
        let written =
            |name: &str, ghosts: &[_]| write(&dir.path().join(format!("{name}.lens.{ending}")), ghosts);
        let pack = written("ghosts", &both(2e-6, 0.1)).unwrap();
        let of = pack.ghosts().unwrap();
        assert_eq!((of.sizes, &of.film_reflectance[..]), (RingSizes::new(3.0, 16), &[0.05, 0.1][..]));
        assert_eq!(pack.ghost_operator(1).unwrap(), Some(operator(16, 2e-6)));
        assert_eq!(*pack.lens(), small_lens());
        let plain = written("plain", &[]).unwrap();
        assert_eq!((plain.ghosts(), plain.ghost_operator(1).unwrap()), (None, None));
        for band in [0, 1] {
            assert_ne!(pack.band_digest(band).unwrap(), plain.band_digest(band).unwrap());
        }
        assert_ne!(pack.digest().unwrap(), plain.digest().unwrap());
        let brighter = written("brighter", &both(2.1e-6, 0.1)).unwrap();
        assert_eq!(brighter.band_digest(0).unwrap(), pack.band_digest(0).unwrap());
        assert_ne!(brighter.band_digest(1).unwrap(), pack.band_digest(1).unwrap());
        assert_ne!(brighter.digest().unwrap(), pack.digest().unwrap());
        // The reflectance is in the operator: alone it changes no pixel.
        let described = written("described", &both(2e-6, 0.2)).unwrap();
        assert_eq!(described.digest().unwrap(), pack.digest().unwrap());
        assert!(pack.check_unchanged().is_ok());
    }
}

#[test]
fn paths_are_read_as_written_and_change_no_digest() {
    let path = |share: f64| PathFigures {
        surfaces: [0, 5],
        axis_share: share,
        half_share: 0.5 * share,
        diameter_mm: 1.5,
        height_per_pupil: 0.02,
        height_per_tan: -30.0,
        is_kept: true,
    };
    let dir = tempfile::tempdir().unwrap();
    let lens = small_lens();
    let write_paths = |name: &str, paths: &[PathFigures]| {
        let mut writer = LensPackWriter::create(dir.path().join(name))?;
        for (band, operator, reflectance) in both(2e-6, 0.1) {
            writer.psf(band, &small_psf(&lens, band))?;
            writer.ghosts(band, &operator, reflectance)?;
        }
        writer.ghost_paths(1, paths)?;
        writer.finish(&lens, &small_attributes())?;
        LensPack::open(dir.path().join(name))
    };
    let paths = [path(1e-3), path(2e-4)];
    let pack = write_paths("paths.lens.zarr", &paths).unwrap();
    assert_eq!(pack.ghost_paths(1).unwrap().as_deref(), Some(&paths[..]));
    assert_eq!(pack.ghost_paths(0).unwrap(), None);
    let without = write(&dir.path().join("without.lens.zarr"), &both(2e-6, 0.1)).unwrap();
    assert_eq!(without.ghost_paths(1).unwrap(), None);
    assert!(!dir.path().join("without.lens.zarr/ghost/paths").exists());
    assert_eq!(pack.digest().unwrap(), without.digest().unwrap());
    let error = write_paths("wrong.lens.zarr", &[path(f64::NAN)]).err().unwrap().to_string();
    assert!(error.contains("ghost/paths/1"), "{error}");
    let root = dir.path().join("paths.lens.zarr/ghost/paths/1");
    let metadata = std::fs::read_to_string(root.join("zarr.json")).unwrap();
    std::fs::write(root.join("zarr.json"), metadata.replace('8', "4")).unwrap();
    let error = LensPack::open(dir.path().join("paths.lens.zarr")).unwrap().ghost_paths(1).unwrap_err();
    assert!(error.to_string().contains("ghost/paths/1"), "{error}");
}

#[test]
fn ghosts_that_are_not_those_of_all_bands_are_not_written() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |ghosts: &[(usize, RingOperator, f64)], part: &str| {
        let path = dir.path().join("refused.lens.zarr");
        let error = write(&path, ghosts).err().expect("refused").to_string();
        assert!(error.contains(part), "{error}");
        assert!(!path.exists());
    };
    let one = |rings| (0, operator(rings, 1e-6), 0.0);
    refused(&[one(16)], "ghosts were written for [0]");
    refused(&[one(16), one(16)], "written twice");
    refused(&[one(16), (1, operator(18, 1e-6), 0.0)], "other rings");
    let mut wrong = operator(16, 1e-6);
    *wrong.values.last_mut().unwrap() = f32::NAN;
    refused(&[(0, wrong, 0.0)], "NaN at order 24, ring 15 of the film and 19 of the scene");
    refused(&[(0, operator(16, 100.0), 0.0)], "times the light of its image");
}

#[test]
fn damaged_ghosts_are_errors_that_name_the_array() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("damaged.lens.zarr");
    write(&path, &both(2e-6, 0.1)).unwrap();
    let edited = |name: &str, edit: &dyn Fn(Vec<u8>) -> Vec<u8>, part: &str| {
        let file = path.join(name);
        let intact = std::fs::read(&file).unwrap();
        std::fs::write(&file, edit(intact.clone())).unwrap();
        let read = LensPack::open(&path).and_then(|pack| pack.ghost_operator(1).map(drop));
        let error = read.expect_err("damaged").to_string();
        assert!(error.contains(part), "{error}");
        std::fs::write(&file, intact).unwrap();
    };
    let flipped = |mut bytes: Vec<u8>| {
        let last = bytes.len() - 1;
        bytes[last] ^= 1;
        bytes
    };
    edited("ghost/operator/1/c/3/0/0", &flipped, "ghost/operator/1");
    edited("ghost/ring/c/0", &flipped, "ghost/ring");
    let replaced = |from: &'static str, to: &'static str| {
        move |bytes: Vec<u8>| {
            let text = String::from_utf8(bytes).unwrap();
            assert!(text.contains(from), "{text}");
            text.replacen(from, to, 1).into_bytes()
        }
    };
    edited("ghost/operator/0/zarr.json", &replaced("25,", "20,"), "ghost/operator/0");
    edited("zarr.json", &replaced("lens-pack/1", "lens-pack/2"), "extras");
    std::fs::remove_dir_all(path.join("ghost")).unwrap();
    let error = LensPack::open(&path).err().unwrap().to_string();
    assert!(error.contains("ghost/ring") && error.contains("missing"), "{error}");
}
