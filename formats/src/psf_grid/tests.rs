//! Files of PSFs hold what was given.

use super::*;
use serde_json::Value;

/// Two wavelengths, 2 × 3 places, PSFs of 3 px with two samples each; and their bands.
fn grid() -> (PsfGrid, Vec<BandPsfs>) {
    let grid = PsfGrid {
        lens: "test 'µ'".into(),
        wavelengths_nm: vec![500.0, 600.0],
        film: Size::new(41, 61),
        pitch_um: 2.0,
        x_px: vec![0.0, 30.0, 60.0],
        y_px: vec![0.0, 40.0],
        oversample: 2,
        window_px: 3,
        f_number: 2.8,
        object_distance_mm: None,
    };
    let band = |b: usize| BandPsfs {
        energy: (0..6).map(|i| 0.9 + 0.01 * (i + b) as f64).collect(),
        samples: (0..6 * 36).map(|i| (i + 1000 * b) as f32 * 0.5).collect(),
    };
    (grid, vec![band(0), band(1)])
}

#[test]
fn places_are_measured_from_the_axis() {
    let (grid, _) = grid();
    assert_eq!(grid.x_mm(), [-0.06, 0.0, 0.06]);
    assert_eq!(grid.y_mm(), [-0.04, 0.04]);
    // Between four samples lies the chief ray.
    assert_eq!(grid.at_um(), [-2.5, -1.5, -0.5, 0.5, 1.5, 2.5]);
}

#[test]
fn fits_has_the_cards_of_gridded_models() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("psf.fits");
    let (grid, bands) = grid();
    fits::file(&path, &grid, 1, &bands[1]).unwrap().finish().unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let text: String = bytes.iter().map(|b| char::from(*b)).collect();
    let cards: Vec<&str> =
        (0..).map(|i| &text[80 * i..][..80]).take_while(|c| c.trim_end() != "END").collect();
    let value = |key: &str| {
        let card = cards.iter().find(|card| card[..8].trim_end() == key && &card[8..10] == "= ");
        card.unwrap_or_else(|| panic!("no {key}"))[10..].split(" / ").next().unwrap().trim().to_owned()
    };
    assert_eq!(["NAXIS", "NAXIS1", "NAXIS2", "NAXIS3", "BITPIX"].map(value), ["3", "6", "6", "6", "-32"]);
    assert_eq!(
        ["OVERSAMP", "NUM_PSFS", "PITCH_UM", "AXIS_X", "AXIS_Y"].map(value),
        ["2", "6", "2.0", "30.0", "20.0"]
    );
    assert_eq!(
        ["DET_YX0", "DET_YX1", "DET_YX5"].map(value),
        ["'(0.0, 0.0)'", "'(0.0, 30.0)'", "'(40.0, 60.0)'"]
    );
    assert_eq!(
        (value("ENERGY5").parse().unwrap(), value("WAVELEN")),
        (bands[1].energy[5], "6E-7".replace('6', "6.0"))
    );
    // Blocks of 2880 bytes; data behind the header, big-endian.
    assert_eq!(bytes.len() % 2880, 0);
    let data = &bytes[(80 * (cards.len() + 1)).next_multiple_of(2880)..];
    let read: Vec<f32> = data.as_chunks::<4>().0.iter().map(|b| f32::from_be_bytes(*b)).collect();
    assert_eq!(read[..216], bands[1].samples);
    assert!(read[216..].iter().all(|v| *v == 0.0));
}

#[test]
fn npy_and_zarr_have_an_axis_of_wavelengths() {
    let dir = tempfile::tempdir().unwrap();
    let (npy_file, store) = (dir.path().join("psf.npy"), dir.path().join("psf.zarr"));
    let (grid, bands) = grid();
    let mut npy = npy::NpyWriter::new(&npy_file, &grid).unwrap();
    let mut zarr = zarr::ZarrWriter::new(&store, &grid).unwrap();
    for band in &bands {
        npy.band(band).unwrap();
        zarr.band(band).unwrap();
    }
    assert!(!npy_file.exists() && !store.exists());
    npy.finish().unwrap();
    zarr.finish().unwrap();
    let bytes = std::fs::read(&npy_file).unwrap();
    let header = crate::npy::header(&bytes).unwrap();
    assert_eq!(header.shape, [2, 2, 3, 6, 6]);
    let f32s =
        |bytes: &[u8]| bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect::<Vec<_>>();
    assert_eq!(f32s(&bytes[header.offset..]), [&bands[0].samples[..], &bands[1].samples].concat());
    let json: Value = serde_json::from_slice(&std::fs::read(dir.path().join("psf.json")).unwrap()).unwrap();
    assert_eq!(json["energy"][1][1][2], bands[1].energy[5]);
    assert_eq!((&json["places_x_mm"][0], &json["axis_px"][0]), (&json!(-0.06), &json!(30.0)));
    let chunk = std::fs::read(store.join("psf/c/1/1/2/0/0")).unwrap();
    assert_eq!(f32s(&chunk[..144]), bands[1].samples[180..]);
    let group: Value = serde_json::from_slice(&std::fs::read(store.join("zarr.json")).unwrap()).unwrap();
    assert_eq!(group["attributes"]["schema"], SCHEMA);
    assert_eq!(group["consolidated_metadata"]["metadata"]["psf"]["dimension_names"][1], "place_y");
}

#[test]
fn only_groups_of_psfs_are_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let (grid, bands) = grid();
    let write = |path: &Path| {
        let mut zarr = zarr::ZarrWriter::new(path, &grid)?;
        bands.iter().try_for_each(|band| zarr.band(band))?;
        zarr.finish()
    };
    let own = dir.path().join("psf.zarr");
    write(&own).unwrap();
    write(&own).unwrap();
    let other = dir.path().join("other");
    std::fs::create_dir(&other).unwrap();
    std::fs::write(other.join("note"), "kept").unwrap();
    assert!(matches!(write(&other), Err(PsfGridError::Foreign { .. })));
    assert_eq!(std::fs::read_to_string(other.join("note")).unwrap(), "kept");
}

#[test]
fn a_file_that_reads_otherwise_than_written_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("psf.npy");
    let file = AtomicFile::create(&path).unwrap();
    let mut digest = blake3::Hasher::new();
    write(&mut file.writer(), &mut digest, &path, b"written").unwrap();
    verify(&file, &path, &digest).unwrap();
    file.file().write_all(b"more").unwrap();
    assert!(matches!(verify(&file, &path, &digest), Err(PsfGridError::Differs { .. })));
}
