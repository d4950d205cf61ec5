//! Lens packs through the public API: round trips, packs of zarr-python, invalid packs.

mod cones;
mod errors;
mod ghosts;
mod planar;
mod planar_errors;
mod planar_pupils;
mod pupils;
mod reading;
mod tails;

use lenscube_formats::lens::{LensPack, LensPackError, LensPackWriter, PackAttributes, write};
use pipeline::lens::depth::BandDepth;
use pipeline::lens::{Lens, LensBand, PsfSample, PsfStack};
use std::path::{Path, PathBuf};

/// Written by tests/data/make_lens_pack.py with zarr-python.
fn fixture() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/zarr_python.lens.zip")
}

/// Two bands of different numbers of field points, heights and window sizes.
fn small_lens() -> Lens {
    let band = |wavelength_nm: f64, m: usize, k: usize, n: usize| LensBand {
        wavelength_nm,
        ideal_height_mm: (0..m).map(|i| i as f64 * 0.7).collect(),
        image_height_mm: (0..m).map(|i| i as f64 * 0.7 - 1e-3 * (i * i) as f64).collect(),
        relative_illumination: (0..m).map(|i| 1.0 - 0.01 * i as f64).collect(),
        psf_height_mm: (0..k).map(|i| i as f64 * 1.1).collect(),
        azimuth_count: (0..k).map(|i| if i == 0 { 1 } else { 8 * i }).collect(),
        psf_size: n,
        psf_pitch_um: 0.5 + n as f64 / 8.0,
        kernel_pitch_um: None,
        psf_energy: (0..k).map(|i| 0.99 - 0.01 * i as f64).collect(),
        solid_angle_sr: 0.088,
        transmission: 0.9,
        tail: None,
        cones: None,
        planar: None,
    };
    Lens {
        name: "small".into(),
        distortion_focal_length_mm: 99.25,
        effective_focal_length_mm: 99.5,
        f_number: 2.985,
        primary_wavelength_nm: 587.5618,
        object_distance_mm: None,
        magnification: 0.0,
        psf_sample: PsfSample::Integrated,
        bands: vec![band(450.0, 6, 2, 5), band(550.0, 4, 3, 3)],
        depth: None,
    }
}

/// Windows of sum 1 (within f32), all different.
fn small_psf(lens: &Lens, b: usize) -> PsfStack {
    let (n, k) = (lens.bands[b].psf_size, lens.bands[b].psf_height_mm.len());
    let mut samples = Vec::new();
    for h in 0..k {
        let raw: Vec<f64> = (0..n * n).map(|i| 1.0 + ((i * 7 + h * 3 + b) % 11) as f64).collect();
        let sum: f64 = raw.iter().sum();
        samples.extend(raw.iter().map(|v| (v / sum) as f32));
    }
    PsfStack { size: n, pitch_um: lens.bands[b].psf_pitch_um, sample: lens.psf_sample, samples }
}

fn small_attributes() -> PackAttributes {
    PackAttributes {
        image_plane: Some("paraxial focus".into()),
        defocus_mm: Some(-0.125),
        frame: None,
        psf_tolerance: Some(serde_json::json!({"l1": 0.01})),
        source: Some(serde_json::json!({"program": "test"})),
        ..PackAttributes::default()
    }
}

fn write_small(path: &Path) -> Lens {
    let lens = small_lens();
    let stacks = (0..lens.bands.len()).map(|b| Ok::<_, LensPackError>(small_psf(&lens, b)));
    write(path, &lens, &small_attributes(), stacks).unwrap();
    lens
}

/// A pack with depth nodes, two bands of different numbers of nodes.
fn depth_pack() -> LensPack {
    let golden = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/golden/depth/packs/two-bands.lens.zip");
    LensPack::open(golden).unwrap()
}

#[test]
fn pack_with_depth_nodes_is_equal_when_read_again() {
    let (pack, tmp) = (depth_pack(), tempfile::tempdir().unwrap());
    let depth = pack.lens().depth.as_ref().unwrap();
    assert_eq!(depth.bands.iter().map(|b| b.nodes.len()).collect::<Vec<_>>(), [5, 6]);
    let path = tmp.path().join("copy.lens.zarr");
    let mut writer = LensPackWriter::create(&path).unwrap();
    for (b, band) in depth.bands.iter().enumerate() {
        for d in 0..band.nodes.len() {
            writer.psf_of_node(b, d, &pack.psf_of_node(b, d).unwrap()).unwrap();
        }
    }
    writer.finish(pack.lens(), &small_attributes()).unwrap();
    let copy = LensPack::open(&path).unwrap();
    assert_eq!(copy.lens(), pack.lens());
    assert_eq!(copy.digest().unwrap(), pack.digest().unwrap());
    assert!(copy.check_unchanged().is_ok());
    // A node whose PSFs were not written.
    let mut incomplete = LensPackWriter::create(tmp.path().join("incomplete.lens.zarr")).unwrap();
    incomplete.psf_of_node(0, 0, &pack.psf_of_node(0, 0).unwrap()).unwrap();
    let e = incomplete.finish(pack.lens(), &small_attributes()).unwrap_err();
    assert!(e.to_string().contains("PSFs were written for"), "{e}");
}

#[test]
fn the_psf_of_one_height_is_that_of_all_heights() {
    let (pack, tmp) = (depth_pack(), tempfile::tempdir().unwrap());
    let path = tmp.path().join("copy.lens.zarr");
    let mut writer = LensPackWriter::create(&path).unwrap();
    let depth = pack.lens().depth.as_ref().unwrap();
    let nodes =
        || depth.bands.iter().enumerate().flat_map(|(b, band)| (0..band.nodes.len()).map(move |d| (b, d)));
    for (b, d) in nodes() {
        writer.psf_of_node(b, d, &pack.psf_of_node(b, d).unwrap()).unwrap();
    }
    writer.finish(pack.lens(), &small_attributes()).unwrap();
    // With chunks of one height, and as the golden pack has them.
    for pack in [&LensPack::open(&path).unwrap(), &pack] {
        for (b, d) in nodes() {
            let stack = pack.psf_of_node(b, d).unwrap();
            for k in 0..stack.heights() {
                assert_eq!(
                    pack.psfs_of_sets(b, d, k..k + 1, 2).unwrap(),
                    stack.window(k),
                    "band {b}, node {d}, height {k}"
                );
            }
        }
    }
    std::fs::remove_dir_all(path.join("psf/1/2/c")).unwrap();
    let e = LensPack::open(&path).unwrap().psfs_of_sets(1, 2, 1..2, 2).unwrap_err();
    assert!(e.to_string().contains("psf/1/2"), "{e}");
}

#[test]
fn invalid_depth_nodes_are_errors_with_their_table() {
    let pack = depth_pack();
    let band = &pack.lens().bands[0];
    let nodes = &pack.lens().depth.as_ref().unwrap().bands[0];
    let error = |change: &dyn Fn(&mut BandDepth)| {
        let mut nodes = nodes.clone();
        change(&mut nodes);
        nodes.check(band).unwrap_err().to_string()
    };
    assert!(error(&|n| n.vergence[1] = 5.0).contains("vergence does not ascend at node 2"));
    assert!(error(&|n| n.vergence[0] = -1.0).contains("vergence is out of bounds at index 0"));
    assert!(error(&|n| n.pupil_shift_mm.truncate(3)).contains("pupil_shift does not have 100 field points"));
    assert!(
        error(&|n| n.nodes[2].etendue_ratio[7] = f64::NAN)
            .contains("etendue_ratio is out of bounds at index 7")
    );
    assert!(error(&|n| n.nodes[1].azimuth_count[1] = 5).contains("azimuth_count is 5 at height 1"));
}

/// Reads tables and all PSFs; returns the first error.
fn read_all(path: &Path) -> Result<(), LensPackError> {
    let pack = LensPack::open(path)?;
    for b in 0..pack.lens().bands.len() {
        pack.psf(b)?;
    }
    Ok(())
}
