//! OpticStudio listings: both forms of the centre line, decimal commas, encodings, files that belong together.

use crate::*;
use lenscube_formats::import::distortion_listing::field_curvature;
use lenscube_formats::import::psf_listing;

/// Header of OpticStudio 25.1 (decimal commas, labelled centre) with invented samples.
const FFT_HEAD: &str = "Listing of FFT PSF Data\n\nPolychromatic FFT PSF\n0,5430 to 0,5430 µm at 10,00, 20,00 (deg).\n\
Data spacing is 1,213 µm.\nData area is 38,829 µm wide.\nSurface: Image\nReference Coordinates: 3,52988E+00, 7,28631E+00\n\
Pupil grid size: 128 by 128\nImage grid size: 4 by 4\nCenter point is: row 3, column 2\nValues are not normalized.\n\n";

#[test]
fn decimal_commas_and_labelled_centre_are_read() {
    let text = format!("{FFT_HEAD}{}", "0,1 0,2 0,3 4,0E-01\n".repeat(4));
    for bytes in [utf16(&text), text.clone().into_bytes(), text.chars().map(|c| c as u8).collect()] {
        let l =
            psf_listing::parse(Path::new("fft"), &lenscube_formats::design::text::decode(&bytes)).unwrap();
        assert!((l.wavelength_nm - 543.0).abs() < 1e-9, "{}", l.wavelength_nm);
        assert_eq!((l.pitch_um, l.window.centre), (1.213, Some((2, 1))));
        assert_eq!((l.chief_ray_mm, l.field_deg), (Some((3.52988, 7.28631)), Some((10.0, 20.0))));
        assert_eq!(l.window.samples[..4], [0.1, 0.2, 0.3, 0.4]);
        assert!(l.outward().unwrap_err().contains("neither axis"));
    }
}

#[test]
fn centre_of_a_cropped_grid_is_read() {
    // Header of OpticStudio 25.1 for 32 × 32 samples of a grid of 256 × 256.
    let head = FFT_HEAD.replace("4 by 4", "256 by 256").replace("row 3, column 2", "row 129, column 128");
    let rows = format!("{}\n", vec!["0,1"; 32].join(" ")).repeat(32);
    let l = psf_listing::parse(Path::new("fft"), &format!("{head}{rows}")).unwrap();
    assert_eq!((l.window.rows, l.window.columns, l.window.centre), (32, 32, Some((16, 15))));
    let short =
        psf_listing::parse(Path::new("fft"), &format!("{head}{}", &rows[..rows.len() / 2])).unwrap_err();
    assert!(short.to_string().contains("16 rows of 32, expected 32 rows of 32"), "{short}");
}

#[test]
fn an_unlabelled_centre_of_two_numbers_is_not_guessed() {
    let text = format!("{FFT_HEAD}{}", "1 1 1 1\n".repeat(4)).replace("row 3, column 2", "3, 2");
    let error = psf_listing::parse(Path::new("fft"), &text).unwrap_err().to_string();
    assert!(error.contains("fft, line 11") && error.contains("row R, column C"), "{error}");
    let several = text.replace("3, 2", "3, 3").replace("0,5430 to 0,5430", "0,4861 to 0,6563");
    let error = psf_listing::parse(Path::new("fft"), &several).unwrap_err().to_string();
    assert!(error.contains("line 4") && error.contains("one at a time"), "{error}");
}

/// RI of the real export as a listing: its 21 heights' field angles, by `number`.
fn illumination_listing(number: impl Fn(f64) -> String) -> String {
    let mut text = "Listing of Relative Illumination Data\n\nWavelength: 0.5500 µm\n\n\
Y Field (deg)    Rel. Ill.    Eff. F/#\n"
        .to_string();
    let table = String::from_utf8(export("RI_.dat")).unwrap();
    for (i, row) in table.lines().enumerate() {
        let deg = (i as f64 / 20.0 * 27.38f64.to_radians().tan()).atan().to_degrees();
        let ri: f64 = row.split_whitespace().nth(2).unwrap().parse().unwrap();
        text.push_str(&format!("{}   {}   {}\n", number(deg), number(ri), number(2.8)));
    }
    text
}

fn listings() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    fs::write(at("grid.txt"), grid_listing()).unwrap();
    fs::write(at("ri.txt"), illumination_listing(|v| format!("{v:.7}"))).unwrap();
    fs::write(at("axis.txt"), axis_listing(plain)).unwrap();
    fs::write(at("corner.txt"), export("PSF_21_3.dat")).unwrap();
    fs::write(at("notes.txt"), "bought in 2005").unwrap();
    dir
}

fn optical_data() -> ImportOptions {
    ImportOptions {
        primary_wavelength_nm: Some(550.0),
        effective_focal_length_mm: Some(1.97422),
        f_number: Some(2.8),
        ..ImportOptions::default()
    }
}

#[test]
fn listings_and_macros_give_the_same_lens() {
    let dir = listings();
    let notes = import::open(dir.path(), &optical_data()).unwrap().notes().join("\n");
    assert!(notes.contains("notes.txt is not a listing"), "{notes}");
    let (_a, listed) = pack(dir.path(), &optical_data());
    let iset = asphere();
    let (_b, macros) = pack(iset.path(), &with_psf());
    assert_eq!(listed.psf(0).unwrap(), macros.psf(0).unwrap());
    let (a, b) = (&listed.lens().bands[0], &macros.lens().bands[0]);
    assert!((listed.lens().distortion_focal_length_mm - 1.97422).abs() < 1e-5);
    assert_eq!(a.psf_height_mm, [0.0, 0.959263593]);
    // The grid ends before the table of 21 heights does; where both are, they agree within the linear steps.
    let last = *a.ideal_height_mm.last().unwrap();
    assert!((0.869..0.871).contains(&last), "{last}");
    let interpolate = |table: &[f64], h: f64| {
        let i = b.ideal_height_mm.partition_point(|x| *x <= h).clamp(1, 1000);
        let (x, y) = (b.ideal_height_mm[i - 1], b.ideal_height_mm[i]);
        table[i - 1] + (h - x) / (y - x) * (table[i] - table[i - 1])
    };
    for (i, &h) in a.ideal_height_mm.iter().enumerate() {
        assert!((a.image_height_mm[i] - interpolate(&b.image_height_mm, h)).abs() < 2e-5, "height {h}");
        assert!(
            (a.relative_illumination[i] - interpolate(&b.relative_illumination, h)).abs() < 1e-4,
            "height {h}"
        );
    }
}

#[test]
fn encoding_and_decimal_commas_do_not_change_the_digest() {
    let comma = |text: String| text.replace('.', ",");
    let (plain_dir, comma_dir) = (listings(), listings());
    let at = |name: &str| comma_dir.path().join(name);
    let grid =
        String::from_utf8_lossy(&grid_listing()).replace('.', ",").replace("= 0,00000E+000, Y", "= 0,0, Y");
    fs::write(at("grid.txt"), utf16(&grid)).unwrap();
    fs::write(
        at("ri.txt"),
        utf16(&comma(illumination_listing(|v| format!("{v:.7}"))).replace("Rel, Ill,", "Rel. Ill.")),
    )
    .unwrap();
    let corner: String = export("PSF_21_3.dat").iter().map(|b| char::from(*b)).collect();
    fs::write(at("corner.txt"), comma(corner)).unwrap();
    let (_a, a) = pack(plain_dir.path(), &optical_data());
    let (_b, b) = pack(comma_dir.path(), &optical_data());
    assert_eq!(a.digest().unwrap(), b.digest().unwrap());
}

#[test]
fn field_curvature_listing_is_read_by_column_titles() {
    let text = "Listing of FIELD CURVATURE DISTORTION Data\nField Curvature / F-Tan(Theta) Distortion\n\n\
Data for wavelength : 0.486133 µm.\nDistortion focal length = 99.500000\n\n\
 Y Angle (deg)      Tan Shift      Sag Shift     Real Height      Ref. Height    Distortion (%)\n\
 0.00000000   0.0   0.0   0.0   0.0   0.0 %\n 7.00000000   0.1   0.0   12.2   12.217   -0.1 %\n\
14.00000000   0.1   0.0   24.6   24.81   -0.8 %\n\nData for wavelength : 0.587562 µm.\n\
Y Angle (deg)\tReal Height\n0\t0\n14\t24.7\n";
    // The per cent sign of the last column is separate: the row has one field too many.
    let error = field_curvature(Path::new("fcd"), text).unwrap_err().to_string();
    assert!(error.contains("fewer than 2"), "{error}");
    let tables = field_curvature(Path::new("fcd"), &text.replace(" %\n", "%\n")).unwrap();
    assert_eq!((tables.len(), tables[0].focal_length_mm), (2, Some(99.5)));
    assert_eq!(tables[0].image_height_mm, [0.0, 12.2, 24.6]);
    assert_eq!((tables[1].wavelength_nm.round(), &tables[1].field_deg[..]), (588.0, &[0.0, 14.0][..]));
}

#[test]
fn missing_option_or_listing_is_an_error_naming_it() {
    let dir = listings();
    assert!(import_error(dir.path(), &ImportOptions::default()).contains("--primary-nm"));
    assert!(
        import_error(dir.path(), &ImportOptions { f_number: None, ..optical_data() }).contains("--f-number")
    );
    fs::remove_file(dir.path().join("axis.txt")).unwrap();
    assert!(import_error(dir.path(), &optical_data()).contains("on the axis and one off it at 550 nm"));
    fs::remove_file(dir.path().join("ri.txt")).unwrap();
    assert!(
        import_error(dir.path(), &optical_data()).contains("no listing of relative illumination at 550 nm")
    );
    fs::remove_file(dir.path().join("grid.txt")).unwrap();
    assert!(import_error(dir.path(), &optical_data()).contains("holds no listing of grid distortion"));
}
