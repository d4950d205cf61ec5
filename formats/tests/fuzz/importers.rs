//! Every importer: its parsers with damaged files in memory, its directories with one damaged file.

use crate::fuzz_support::{Random, damage, damage_text, fuzz};
use crate::{data, directory};
use lenscube_formats::design::text::decode;
use lenscube_formats::import::window::{EvenWindow, Outward};
use lenscube_formats::import::{
    self, Format, ImportOptions, distortion_listing, illumination_listing, isetparms, npy, npz, psf_listing,
};
use pipeline::lens::PsfSample;
use std::fs;
use std::path::{Path, PathBuf};

const PATH: &str = "file";

fn text_target(target: &str, seeds: &[String], read: impl Fn(&str) -> bool) {
    let make = |r: &mut Random| {
        let mut bytes = seeds[r.below(seeds.len())].clone().into_bytes();
        damage_text(&mut bytes, r);
        bytes
    };
    fuzz(target, 1000, make, |bytes| read(&decode(bytes)));
}

/// A PSF listing of n × n samples.
fn psf(n: usize, field: &str, chief_ray: &str) -> String {
    let rows = format!("{}\n", vec!["1.5E-001"; n].join("\t")).repeat(n);
    let centre = n / 2 + 1;
    format!(
        "Listing of Huygens PSF Data\n\nHUYGENS PSF\n0.5500 µm at {field} deg.\nData spacing is 0.25 µm.\n\
Image grid size: {n} by {n}\nCenter point is: {centre}, {centre}\nCenter coordinates: {chief_ray}\n\
Values are relative intensity.\n\n{rows}"
    )
}

fn grid_listing() -> String {
    let mut text = "Listing of Grid Distortion Data\n\nUnits are Millimeters.\nField units are degrees\n\
Wavelength: 0.55000 µm\nReference Coordinates: Xref = 0.0, Yref = 0.0\n\n\
   i    j  X-Field  Y-Field  R-Field  Predicted X  Predicted Y  Real X  Real Y  Distortion\n"
        .to_string();
    for (i, j) in (-2i32..=2).flat_map(|i| (-2i32..=2).map(move |j| (i, j))) {
        let (x, y) = (f64::from(i), f64::from(j));
        let (px, py) = (x.to_radians().tan() * 10.0, y.to_radians().tan() * 10.0);
        let r = (px.hypot(py) / 10.0).atan().to_degrees();
        text.push_str(&format!("{i} {j} {x} {y} {r} {px} {py} {} {} -1.0%\n", px * 0.99, py * 0.99));
    }
    text + "\nMaximum distortion: -1.0%\n"
}

const ILLUMINATION: &str = "Listing of Relative Illumination Data\n\nWavelength: 0.5500 µm\n\n\
Y Field (deg)    Rel. Ill.    Eff. F/#\n0.0  1.0  2.8\n1.5 0.99 2.8\n2.9 0.98 2.8\n";
const PARAMETERS: &str = "% head\nlensFile='rtX.len'\npsfSize=4;\npsfSpacing=0.0005; % MM\nwave=500:100:600; % NM\n\
imgHeightNum=3;\nimgHeightMax=4;\nobjDist=250\nmag=-0.02\nbaseLensFileName='C:\\a\\rtX'\nrefWave=500\nfov=21.801409486\n\
efl=10\nfnumber=4\nfnumber_eff=[4.1]\n";

#[test]
fn damaged_iset_parameters_do_not_panic() {
    let seeds =
        [PARAMETERS.to_string(), PARAMETERS.replace("imgHeightNum=3;\nimgHeightMax=4", "imgHeight=0:2:4")];
    text_target("ISETPARMS.TXT", &seeds, |text| isetparms::Parameters::parse(Path::new(PATH), text).is_ok());
}

#[test]
fn damaged_psf_listings_do_not_panic() {
    let commas = psf(8, "10.00, 20.00", "3.5E+00, 7.2E+00").replace('.', ",");
    let labelled = psf(5, "0.0", "0, 1").replace("3, 3", "row 3, column 4");
    text_target("PSF listing", &[psf(6, "-2.0", "0.0, -0.35"), commas, labelled], |text| {
        let Ok(listing) = psf_listing::parse(Path::new(PATH), text) else { return false };
        let _ = listing.outward();
        true
    });
}

#[test]
fn damaged_distortion_listings_do_not_panic() {
    text_target("grid distortion listing", &[grid_listing()], |text| {
        distortion_listing::grid(Path::new(PATH), text).is_ok()
    });
    let curvature = "Listing of FIELD CURVATURE DISTORTION Data\n\nData for wavelength : 0.5500 µm.\n\
Distortion focal length = 10.0\n\nY Angle (deg)  Tan Shift  Real Height\n0.0 0.0 0.0\n1.5 0.1 0.26\n2.9 0.1 0.5\n\n\
Data for wavelength : 0.65 µm.\nY Angle (deg)  Real Height\n0.0 0.0\n1.5 0.26\n";
    text_target("field curvature listing", &[curvature.to_string()], |text| {
        distortion_listing::field_curvature(Path::new(PATH), text).is_ok()
    });
}

#[test]
fn damaged_illumination_listings_do_not_panic() {
    text_target("illumination listing", &[ILLUMINATION.to_string()], |text| {
        illumination_listing::parse(Path::new(PATH), text).is_ok()
    });
}

#[test]
fn damaged_npy_arrays_do_not_panic() {
    let seed = fs::read(data("../../data/tables-example/psf_550.npy")).unwrap();
    let make = |r: &mut Random| {
        let mut bytes = seed.clone();
        match r.below(3) {
            0 => damage(&mut bytes, r),
            _ => {
                let mut head = bytes[10..128].to_vec();
                damage_text(&mut head, r);
                bytes[8..10].copy_from_slice(&(head.len() as u16).to_le_bytes());
                bytes.splice(10..128, head);
            }
        }
        bytes
    };
    fuzz("NPY", 1000, make, |bytes| npy::parse(bytes).is_ok());
}

/// A small archive: damaged as a whole, or with a damaged array.
#[test]
fn damaged_npz_archives_do_not_panic() {
    use std::io::{Cursor, Write};
    let array = |shape: &str, values: &[f32]| {
        let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes());
        bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        bytes
    };
    let arrays = [
        ("wavelength_um", array("(2,)", &[0.5, 0.6])),
        ("ideal_height_mm", array("(3,)", &[0.0, 1.0, 2.0])),
        ("real_height_mm", array("(2, 3)", &[0.0, 1.0, 1.9, 0.0, 1.0, 1.8])),
        ("ri", array("(2, 3)", &[1.0, 0.9, 0.8, 1.0, 0.9, 0.7])),
        ("psf", array("(2, 3, 3, 3)", &[0.1; 54])),
        ("efl_mm", array("()", &[50.0])),
        ("pixel_um", array("()", &[2.0])),
    ];
    let pack = |arrays: &[(&str, Vec<u8>)]| {
        let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
        let stored =
            zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        for (name, bytes) in arrays {
            zip.start_file(format!("{name}.npy"), stored).unwrap();
            zip.write_all(bytes).unwrap();
        }
        zip.finish().unwrap().into_inner()
    };
    let archive = pack(&arrays);
    let make = |r: &mut Random| {
        let mut arrays = arrays.clone();
        let at = r.below(arrays.len());
        match r.below(4) {
            0 => {
                let mut bytes = archive.clone();
                damage(&mut bytes, r);
                return bytes;
            }
            1 => damage_text(&mut arrays[at].1, r),
            _ => damage(&mut arrays[at].1, r),
        }
        pack(&arrays)
    };
    let options = ImportOptions { primary_wavelength_nm: Some(550.0), f_number: Some(4.0), ..required() };
    fuzz("NPZ", 500, make, |bytes| match npz::open_bytes(Path::new(PATH), bytes, &options) {
        Ok(mut imported) => imported.psf(0).is_ok() && imported.psf(imported.lens().bands.len() - 1).is_ok(),
        Err(_) => false,
    });
}

/// Options without which no import succeeds.
fn required() -> ImportOptions {
    ImportOptions {
        sample: Some(PsfSample::Point),
        outward: Some(Outward::Up),
        even_window: Some(EvenWindow::Pad),
        azimuths: 8,
        field_points: 11,
        ..ImportOptions::default()
    }
}

/// The paths of `files`, written into `dir`.
fn written(dir: &Path, files: &[(&str, Vec<u8>)]) -> Vec<PathBuf> {
    let at: Vec<PathBuf> = files.iter().map(|(name, _)| dir.join(name)).collect();
    at.iter().zip(files).for_each(|(path, (_, bytes))| fs::write(path, bytes).unwrap());
    at
}

/// Damages one of `files` at `at` in each case, and mends the one before.
fn one_damaged(
    at: &[PathBuf],
    files: &[(&str, Vec<u8>)],
    is_text: impl Fn(&str) -> bool,
) -> impl FnMut(&mut Random) -> Vec<u8> {
    let mut last = 0;
    move |r| {
        fs::write(&at[last], &files[last].1).unwrap();
        last = r.below(files.len());
        let mut bytes = files[last].1.clone();
        match is_text(files[last].0) {
            true => damage_text(&mut bytes, r),
            false => damage(&mut bytes, r),
        }
        fs::write(&at[last], &bytes).unwrap();
        bytes
    }
}

/// A directory of files, one of them damaged in each case.
fn directory_target(target: &str, files: &[(&str, Vec<u8>)], options: &ImportOptions) {
    let dir = directory();
    let at = written(dir.path(), files);
    let is_text = |name: &str| !name.ends_with(".npy");
    fuzz(target, 300, one_damaged(&at, files, is_text), |_| match import::open(dir.path(), options) {
        Ok(mut imported) => (0..imported.lens().bands.len()).all(|b| imported.psf(b).is_ok()),
        Err(_) => false,
    });
}

#[test]
fn damaged_iset_directories_do_not_panic() {
    let window = b"0 0 0 0\n0 0 25 0\n0 0 75 0\n0 0 0 0\n".to_vec();
    let mut files = vec![
        ("rtX_ISETPARMS.TXT", PARAMETERS.as_bytes().to_vec()),
        ("rtX_DI_.dat", b"0 0\n1.99 1.98\n3.9 3.8\n".to_vec()),
        ("rtX_RI_.dat", b"1\n1\n0.9\n0.9\n0.7\n0.6\n".to_vec()),
    ];
    for name in
        ["rtX_PSF_1_1.dat", "rtX_PSF_2_1.dat", "rtX_2D_PSF_Fld1_Wave2.dat", "rtX_2D_PSF_Fld2_Wave2.dat"]
    {
        files.push((name, window.clone()));
    }
    let options = ImportOptions { psf_heights: Some(vec![1, 2]), ..required() };
    directory_target("ISET folder", &files, &options);
}

#[test]
fn damaged_listing_directories_do_not_panic() {
    let files = [
        ("grid.txt", grid_listing().into_bytes()),
        ("ri.txt", ILLUMINATION.as_bytes().to_vec()),
        ("axis.txt", psf(6, "0.0", "0.0, 0.0").into_bytes()),
        ("edge.txt", psf(6, "-2.0", "0.0, -0.35").into_bytes()),
    ];
    let options = ImportOptions {
        format: Some(Format::Listings),
        primary_wavelength_nm: Some(550.0),
        effective_focal_length_mm: Some(10.0),
        f_number: Some(4.0),
        ..required()
    };
    directory_target("folder of listings", &files, &options);
}

#[test]
fn damaged_table_directories_do_not_panic() {
    let names = ["lens.csv", "heights.csv", "psf.csv", "psf_500.npy", "psf_550.npy"];
    let files = names.map(|n| (n, fs::read(data("../../data/tables-example").join(n)).unwrap()));
    directory_target(
        "CSV and NPY folder",
        &files,
        &ImportOptions { field_points: 11, ..ImportOptions::default() },
    );
}

/// Places, windows, map and flat field of a description, one of the files damaged.
#[test]
fn damaged_fields_do_not_panic() {
    let npy = |shape: &str, values: &[f32]| {
        let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.bytes());
        bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        bytes
    };
    let mut fits = Vec::new();
    for card in [
        "SIMPLE  =                    T",
        "BITPIX  =                   16",
        "NAXIS   =                    2",
        "NAXIS1  =                    4",
        "NAXIS2  =                    4",
        "BZERO   =                32768",
        "END",
    ] {
        fits.extend(format!("{card:80}").into_bytes());
    }
    fits.resize(2880, b' ');
    fits.extend([0; 2880]);
    let windows: Vec<f32> = (0..54).map(|i| 1.0 + (i % 9) as f32).collect();
    let row = [-3.0, -1.0, 1.0, 3.0];
    let across: Vec<f32> = (0..16).map(|i| row[i % 4]).collect();
    let down: Vec<f32> = (0..16).map(|i| row[i / 4]).collect();
    let head = "name = \"a\"\nwavelengths_nm = [500, 600]\n[psf]\nfiles = \"psf.npy\"\nx_mm = [-1, 0, 1]\ny_mm = [2]\npitch_um = 1\n\
sample = \"point\"\ny_up = true\ncentre = \"centroid\"\n";
    let ideal = format!(
        "distortion_focal_length_mm = 9\n{head}[map]\nideal_x = \"x.npy\"\nideal_y = \"y.npy\"\nx_mm = [-3, -1, 1, 3]\ny_mm = [-3, -1, 1, 3]\n\
[shading]\nrelative_illumination = \"flat.fits\"\nnormalise = \"largest\"\n"
    );
    let brown = format!(
        "{head}[map]\nsize_px = [90, 70]\npitch_um = 2\nbrown = {{ f_px = 300, c_px = [44, 35], k = [-0.2, 0.1, 0.0], p = [1e-3, 1e-3] }}\n"
    );
    let files = [
        ("ideal.toml", ideal.into_bytes()),
        ("brown.toml", brown.into_bytes()),
        ("psf.npy", npy("(2, 1, 3, 3, 3)", &windows)),
        ("x.npy", npy("(4, 4)", &across)),
        ("y.npy", npy("(4, 4)", &down)),
        ("flat.fits", fits),
    ];
    let dir = directory();
    let at = written(dir.path(), &files);
    let read = |path: &Path| match import::field::open(path) {
        Ok(mut field) => (0..field.lens().bands.len()).all(|b| field.psf(b).is_ok()),
        Err(_) => false,
    };
    assert!(read(&at[0]) && read(&at[1]));
    let make = one_damaged(&at, &files, |name| name.ends_with(".toml"));
    fuzz("measured field", 400, make, |_| read(&at[0]) && read(&at[1]));
}
