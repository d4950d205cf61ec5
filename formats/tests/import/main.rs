//! Imports through the public API: real exports, variants of them, and errors of malformed ones.

mod asphere;
mod errors;
mod field;
mod listings;
mod tables;

use lenscube_formats::import::{self, ImportOptions};
use lenscube_formats::lens::LensPack;
use std::fs;
use std::path::{Path, PathBuf};

const BASE: &str = "AsphereF=2mm";

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

/// A file of the export, unchanged.
fn export(ending: &str) -> Vec<u8> {
    fs::read(data("zemax-asphere").join(format!("{BASE}_{ending}"))).unwrap()
}

/// The grid distortion listing, from its .zip.
fn grid_listing() -> Vec<u8> {
    let zip = fs::File::open(data("zemax-asphere/AsphereF=2mm_GridDistortion_3.zip")).unwrap();
    let mut bytes = Vec::new();
    std::io::copy(&mut zip::ZipArchive::new(zip).unwrap().by_index(0).unwrap(), &mut bytes).unwrap();
    bytes
}

/// A listing of a round PSF on the axis at 550 nm, in the format of the real one; samples formatted by `number`.
fn axis_listing(number: impl Fn(f64) -> String) -> String {
    let mut text = "Listing of Huygens PSF Data\n\nHUYGENS PSF\n0.5500 µm at 0.00 deg.\nData spacing is 0.25 µm.\n\
Data area is 32.00 by 32.00 µm.\nStrehl ratio: 0.9\nPupil grid size: 32 by 32\nImage grid size: 128 by 128\n\
Center point is: 65, 65\nCenter coordinates: 0.00000000E+000, 0.00000000E+000\nValues are relative intensity.\n\n"
        .to_string();
    for row in 0..128 {
        let y = f64::from(row - 64);
        let samples = (0..128).map(|c| number((-(y * y + f64::from((c - 64) * (c - 64))) / 20.0).exp()));
        text.push_str(&samples.collect::<Vec<_>>().join("\t"));
        text.push('\n');
    }
    text
}

fn plain(v: f64) -> String {
    format!("{v:.3E}")
}

/// A directory as written by the macros of 2005, with the available PSFs.
fn asphere() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    fs::copy(data("zemax-asphere/ISETPARMS.TXT"), dir.path().join("ISETPARMS.TXT")).unwrap();
    for ending in ["DI_.dat", "RI_.dat", "PSF_21_3.dat"] {
        fs::write(dir.path().join(format!("{BASE}_{ending}")), export(ending)).unwrap();
    }
    fs::write(dir.path().join(format!("{BASE}_PSF_1_3.dat")), axis_listing(plain)).unwrap();
    fs::write(dir.path().join(format!("{BASE}_GridDistortion_3.dat")), grid_listing()).unwrap();
    dir
}

/// Options for the one wavelength and the two heights that have PSFs.
fn with_psf() -> ImportOptions {
    ImportOptions { bands: Some(vec![2]), psf_heights: Some(vec![1, 21]), ..ImportOptions::default() }
}

/// Imports into a temporary pack and opens it.
fn pack(source: &Path, options: &ImportOptions) -> (tempfile::TempDir, LensPack) {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.lens.zip");
    import::write(&out, import::open(source, options).unwrap(), |_, _| ()).unwrap();
    let pack = LensPack::open(&out).unwrap();
    (dir, pack)
}

/// Error of a source that cannot be imported; checks that no file remains.
fn import_error(source: &Path, options: &ImportOptions) -> String {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out.lens.zarr");
    let imported = import::open(source, options).and_then(|i| import::write(&out, i, |_, _| ()));
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 0, "a file remains");
    imported.unwrap_err().to_string()
}

/// Centroid of a pack's window from its chief ray: outward and down, µm.
fn centroid_um(pack: &LensPack, band: usize, k: usize) -> (f64, f64) {
    let stack = pack.psf(band).unwrap();
    let half = (stack.size / 2) as f64;
    let (mut x, mut y) = (0.0, 0.0);
    for (i, &v) in stack.window(k).iter().enumerate() {
        x += f64::from(v) * ((i % stack.size) as f64 - half) * stack.pitch_um;
        y += f64::from(v) * ((i / stack.size) as f64 - half) * stack.pitch_um;
    }
    (x, y)
}

/// UTF-16LE with a BOM, CRLF.
fn utf16(text: &str) -> Vec<u8> {
    let units =
        std::iter::once(0xFEFFu16).chain(text.replace('\n', "\r\n").encode_utf16().collect::<Vec<_>>());
    units.flat_map(u16::to_le_bytes).collect()
}
