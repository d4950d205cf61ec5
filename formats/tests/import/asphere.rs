//! The real export of 2005, and names and layouts of other macros derived from it.

use crate::*;
use lenscube_formats::design::text::decode;
use lenscube_formats::import::distortion_listing::grid;
use lenscube_formats::import::isetparms::Parameters;
use lenscube_formats::import::psf_listing;
use lenscube_formats::import::window::{Outward, RowOrder};
use pipeline::lens::PsfSample;

#[test]
fn height_21_equals_the_centre_coordinate_of_the_listing() {
    let dir = asphere();
    let (_keep, pack) = pack(dir.path(), &with_psf());
    let lens = pack.lens();
    let band = &lens.bands[0];
    assert_eq!((lens.bands.len(), band.wavelength_nm, lens.psf_sample), (1, 550.0, PsfSample::Point));
    // DI has 7 digits, the listing 9.
    assert_eq!(band.psf_height_mm, [0.0, 0.9592636]);
    let path = data("zemax-asphere/AsphereF=2mm_PSF_21_3.dat");
    let listing = psf_listing::parse(&path, &decode(&fs::read(&path).unwrap())).unwrap();
    assert_eq!(listing.chief_ray_mm, Some((0.0, -0.959263593)));
    assert!((band.psf_height_mm[1] - 0.959263593).abs() < 5e-8);
    assert!((band.image_height_mm.last().unwrap() - 0.9592636).abs() < 1e-15);
    assert!((band.relative_illumination.last().unwrap() - 0.8035191).abs() < 1e-15);
    // EFL 1.974220 mm, object at infinity: the distortion focal length is the same within the digits of height and angle.
    assert!((lens.distortion_focal_length_mm - 1.974220).abs() < 5e-5, "{}", lens.distortion_focal_length_mm);
    assert_eq!((lens.object_distance_mm, lens.magnification), (None, 0.0));
}

#[test]
fn psf_centroid_is_preserved() {
    let path = data("zemax-asphere/AsphereF=2mm_PSF_21_3.dat");
    let w = psf_listing::parse(&path, &decode(&fs::read(&path).unwrap())).unwrap().window;
    assert_eq!((w.rows, w.columns, w.centre), (128, 128, Some((64, 64))));
    let total: f64 = w.samples.iter().sum();
    let along = |axis: fn(usize) -> usize| {
        let moment = w.samples.iter().enumerate().map(|(i, v)| v * (axis(i) as f64 - 64.0) * 0.25);
        moment.sum::<f64>() / total
    };
    let (rows, columns) = (along(|i| i / 128), along(|i| i % 128));
    let dir = asphere();
    let (_keep, top) = pack(dir.path(), &with_psf());
    // The field point is on −y, the top row first: rows run outward, columns against the pack's rows.
    let (x, y) = centroid_um(&top, 0, 1);
    assert!((x - rows).abs() < 1e-5 && (y + columns).abs() < 1e-5, "{x} {y}, listing {rows} {columns}");
    assert!((-2.3..-2.1).contains(&x), "{x}");
    let (_keep, bottom) = pack(dir.path(), &ImportOptions { rows: RowOrder::Bottom, ..with_psf() });
    let (x, y) = centroid_um(&bottom, 0, 1);
    assert!((x + rows).abs() < 1e-5 && (y + columns).abs() < 1e-5, "{x} {y}");
}

#[test]
fn tables_without_psf_agree_with_the_grid_listing() {
    let dir = asphere();
    let options = ImportOptions { without_psf: true, ..ImportOptions::default() };
    let notes = import::open(dir.path(), &options).unwrap().notes().join("\n");
    assert!(notes.contains("agrees with the DI table") && notes.contains("ideal point"), "{notes}");
    let (_keep, pack) = pack(dir.path(), &options);
    let nm: Vec<f64> = pack.lens().bands.iter().map(|b| b.wavelength_nm).collect();
    assert_eq!(nm, [400.0, 475.0, 550.0, 625.0, 700.0]);
    // All 4225 points of the grid against the dense table: the spline through 21 rows of 7 digits.
    let band = &pack.lens().bands[2];
    let grid = grid(Path::new("grid"), &decode(&grid_listing())).unwrap();
    assert_eq!(grid.radii_mm.len(), 65 * 65);
    let last = *band.ideal_height_mm.last().unwrap();
    let mut worst: f64 = 0.0;
    for &(ideal, real) in grid.radii_mm.iter().filter(|(ideal, _)| *ideal <= last) {
        let i = band.ideal_height_mm.partition_point(|h| *h <= ideal).clamp(1, 1000);
        let (a, b) = (band.ideal_height_mm[i - 1], band.ideal_height_mm[i]);
        let (c, d) = (band.image_height_mm[i - 1], band.image_height_mm[i]);
        worst = worst.max((c + (ideal - a) / (b - a) * (d - c) - real).abs());
    }
    assert!(worst < 1e-5, "{worst} mm");
}

#[test]
fn names_and_layout_of_2013_give_the_same_pack() {
    let old = asphere();
    let new = asphere();
    let at = |name: &str| new.path().join(format!("{BASE}_{name}"));
    for table in ["DI_.dat", "RI_.dat"] {
        let text = String::from_utf8(export(table)).unwrap();
        fs::write(at(table), utf16(&text.split_whitespace().collect::<Vec<_>>().join("\n"))).unwrap();
    }
    fs::rename(at("PSF_1_3.dat"), at("2D_PSF_Fld1_Wave3.dat")).unwrap();
    fs::rename(at("PSF_21_3.dat"), at("2D_PSF_Fld21_Wave3.dat")).unwrap();
    let (_a, old) = pack(old.path(), &with_psf());
    let (_b, new) = pack(new.path(), &with_psf());
    assert_eq!(old.digest().unwrap(), new.digest().unwrap());
}

#[test]
fn code_v_export_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let parms = "% C:\\LENS\\X.len\nlensFile='X.len'\npsfSize=4   % PSF ROW AND COL SIZE\npsfSpacing=0.0005 % MM\n\
wave=500:100:600 % NM\nimgHeight=0:2:4 % MM\nobjDist=1e+014\nmag=0\nbaseLensFileName='rtX'\nrefWave=500\n\
fov=21.801409486\nefl=10\nfnumber=4\nfnumber_eff=4.1\n";
    fs::write(at("rtX_ISETPARMS.TXT"), parms).unwrap();
    fs::write(at("rtX_DI_.dat"), "0 0\n1.99 1.98\n3.9 3.8\n").unwrap();
    fs::write(at("rtX_RI_.dat"), "1 1\n0.9 0.9\n0.7 0.6\n").unwrap();
    for (h, w) in [(1, 1), (2, 1), (3, 1), (1, 2), (2, 2), (3, 2)] {
        // A tail one row above the chief ray, which is on row 3, column 3.
        fs::write(at(&format!("rtX_PSF_{h}_{w}.dat")), "0 0 0 0\n0 0 25 0\n0 0 75 0\n0 0 0 0\n").unwrap();
    }
    assert!(import_error(dir.path(), &ImportOptions::default()).contains("--psf-outward"));
    let (_keep, pack) =
        pack(dir.path(), &ImportOptions { outward: Some(Outward::Up), ..ImportOptions::default() });
    assert_eq!(pack.lens().bands[1].psf_height_mm, [0.0, 1.98, 3.8]);
    assert_eq!((pack.lens().bands[0].psf_size, pack.lens().bands[0].psf_pitch_um), (5, 0.5));
    let (x, y) = centroid_um(&pack, 0, 2);
    assert!((x - 0.125).abs() < 1e-7 && y.abs() < 1e-7, "{x} {y}");
    let solid_angle = std::f64::consts::PI / (4.0 * 4.1 * 4.1);
    assert_eq!(pack.lens().bands[0].solid_angle_sr, solid_angle);
}

/// Real parameters (an object at 250 mm), invented tables.
#[test]
fn finite_object_distance_and_magnification_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::copy(data("zemax-asphere/ISETPARMS-EO54852.TXT"), at("ISETPARMS.TXT")).unwrap();
    let table = |of: fn(f64) -> f64| -> String {
        (0..13).map(|i| format!("{}\n", vec![of(0.25 * f64::from(i)).to_string(); 7].join(" "))).collect()
    };
    // This lens images +y on −y.
    fs::write(at("EO54852_DI_.dat"), table(|h| -h * (1.0 - 0.01 * h * h))).unwrap();
    fs::write(at("EO54852_RI_.dat"), table(|h| 1.0 - 0.02 * h * h)).unwrap();
    let (_keep, pack) = pack(dir.path(), &ImportOptions { without_psf: true, ..ImportOptions::default() });
    let lens = pack.lens();
    assert_eq!((lens.object_distance_mm, lens.magnification), (Some(250.0), -0.023954));
    // Slope of the paraxial chief ray: 3 mm at 26.198448°.
    assert!((lens.distortion_focal_length_mm - 3.0 / 26.198448f64.to_radians().tan()).abs() < 1e-12);
    assert_eq!((lens.effective_focal_length_mm, lens.f_number), (5.999968, 1.774644));
    assert!((lens.bands[6].image_height_mm[1000] - 3.0 * 0.91).abs() < 1e-12);
    let omega = std::f64::consts::PI / (4.0 * 1.780820 * 1.780820);
    assert_eq!(lens.bands[0].solid_angle_sr, omega);
}

#[test]
fn public_parameter_file_is_read() {
    let path = data("zemax-asphere/ISETPARMS-EO54852.TXT");
    let p = Parameters::parse(&path, &decode(&fs::read(&path).unwrap())).unwrap();
    assert_eq!(p.list("wave").unwrap().1, [400.0, 450.0, 500.0, 550.0, 600.0, 650.0, 700.0]);
    assert_eq!(p.text("baseLensFileName"), Some("C:\\Program Files\\ZEMAX\\ISET\\EO54852\\EO54852"));
    assert_eq!((p.count("imgHeightNum", 2).unwrap(), p.number("mag").unwrap()), (13, -0.023954));
    assert_eq!(p.number("fnumber").unwrap(), 1.774644);
}
