//! Tails of a pack: optional group, digest, unknown extras.

use super::{small_attributes, small_lens, small_psf};
use lenscube_formats::lens::{LensPack, LensPackError, write};
use pipeline::lens::Lens;
use pipeline::lens::middle::Middle;
use pipeline::lens::tail::BandTail;

/// The small lens with a tail of its second band.
pub(crate) fn lens_with_tail() -> Lens {
    let mut lens = small_lens();
    let coefficients = |k: usize| {
        let c = 2e-5 * (k + 1) as f64;
        std::array::from_fn(|m| [c / (m + 1) as f64, 1e-9 * (m + k) as f64])
    };
    lens.bands[1].tail = Some(BandTail {
        inner_mm: 0.02,
        height_mm: vec![0.0, 0.7, 1.5],
        coefficients: (0..3).map(coefficients).collect(),
        middle: None,
    });
    lens
}

fn written(lens: &Lens, name: &str) -> (tempfile::TempDir, LensPack) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join(name);
    let stacks = (0..lens.bands.len()).map(|b| Ok::<_, LensPackError>(small_psf(lens, b)));
    write(&path, lens, &small_attributes(), stacks).unwrap();
    let pack = LensPack::open(&path).unwrap();
    (dir, pack)
}

#[test]
fn tails_are_read_as_written_and_belong_to_the_digest_of_their_band() {
    let (lens, without) = (lens_with_tail(), small_lens());
    for name in ["small.lens.zarr", "small.lens.zip"] {
        let (_dir, pack) = written(&lens, name);
        assert_eq!(*pack.lens(), lens);
        let (_other, plain) = written(&without, name);
        assert_eq!(*plain.lens(), without);
        assert_eq!(pack.band_digest(0).unwrap(), plain.band_digest(0).unwrap());
        assert_ne!(pack.band_digest(1).unwrap(), plain.band_digest(1).unwrap());
        assert_ne!(pack.digest().unwrap(), plain.digest().unwrap());
        let mut other = lens.clone();
        other.bands[1].tail.as_mut().unwrap().coefficients[2][4][1] *= 1.0 + 1e-15;
        let (_dir, changed) = written(&other, name);
        assert_ne!(changed.digest().unwrap(), pack.digest().unwrap());
    }
}

#[test]
fn middle_parts_are_read_as_written_and_belong_to_the_digest_of_their_band() {
    let mut lens = lens_with_tail();
    let samples = (0..27).map(|i| 1e-3 * (i + 1) as f32).collect();
    let middle = Some(Middle { size: 3, pitch_mm: 0.04 / 3.0, samples });
    lens.bands[1].tail.as_mut().unwrap().middle = middle;
    for name in ["small.lens.zarr", "small.lens.zip"] {
        let (_dir, pack) = written(&lens, name);
        assert_eq!(*pack.lens(), lens);
        let (_other, without) = written(&lens_with_tail(), name);
        assert_eq!(pack.band_digest(0).unwrap(), without.band_digest(0).unwrap());
        assert_ne!(pack.band_digest(1).unwrap(), without.band_digest(1).unwrap());
    }
    let (dir, _) = written(&lens, "small.lens.zarr");
    let root = dir.path().join("small.lens.zarr");
    let head = std::fs::read_to_string(root.join("zarr.json")).unwrap();
    assert!(head.contains("\"middle\""), "{head}");
    std::fs::remove_file(root.join("tail/middle/1/c/0/0/0")).unwrap();
    let error = LensPack::open(&root).err().unwrap().to_string();
    assert!(error.contains("tail/middle/1"), "{error}");
    // Samples far beyond the radius.
    let mut wide = lens.clone();
    wide.bands[1].tail.as_mut().unwrap().middle.as_mut().unwrap().pitch_mm = 2.0;
    let path = dir.path().join("wide.lens.zip");
    let stacks = (0..2).map(|b| Ok::<_, LensPackError>(small_psf(&wide, b)));
    write(&path, &wide, &small_attributes(), stacks).unwrap();
    let error = LensPack::open(&path).err().unwrap().to_string();
    assert!(error.contains("tail/middle_pitch") && error.contains("tail/inner_radius"), "{error}");
    // All of the light, and none.
    for factor in [100.0, 0.0] {
        let mut wrong = lens.clone();
        let middle = wrong.bands[1].tail.as_mut().unwrap().middle.as_mut().unwrap();
        middle.samples = middle.samples.iter().map(|v| v * factor).collect();
        let stacks = (0..2).map(|b| Ok::<_, LensPackError>(small_psf(&wrong, b)));
        let error =
            write(dir.path().join("wrong.lens.zip"), &wrong, &small_attributes(), stacks).unwrap_err();
        assert!(error.to_string().contains("tail/middle"), "{error}");
    }
}

#[test]
fn packs_without_tails_name_no_extras() {
    let (dir, _) = written(&small_lens(), "small.lens.zarr");
    let root = dir.path().join("small.lens.zarr");
    assert!(!root.join("tail").exists());
    assert!(!std::fs::read_to_string(root.join("zarr.json")).unwrap().contains("extras"));
}

#[test]
fn an_unknown_extra_and_a_tail_of_too_much_light_are_errors() {
    let (dir, _) = written(&lens_with_tail(), "small.lens.zarr");
    let root = dir.path().join("small.lens.zarr");
    let head = root.join("zarr.json");
    let text = std::fs::read_to_string(&head).unwrap();
    std::fs::write(&head, text.replace("\"tail\"", "\"glow\"")).unwrap();
    let error = LensPack::open(&root).err().unwrap().to_string();
    assert!(error.contains("extras") && error.contains("glow"), "{error}");
    let mut lens = lens_with_tail();
    lens.bands[1].tail.as_mut().unwrap().inner_mm = 1e-6;
    let stacks = (0..2).map(|b| Ok::<_, LensPackError>(small_psf(&lens, b)));
    let error = write(dir.path().join("wrong.lens.zip"), &lens, &small_attributes(), stacks).unwrap_err();
    assert!(error.to_string().contains("tail/coefficient"), "{error}");
}
