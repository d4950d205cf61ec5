//! Malformed exports: one sentence with file and line, no file written.

use crate::*;

/// Changes one file of the asphere's directory and checks the texts in the error.
fn check_changed(file: &str, change: impl Fn(String) -> String, expected: &[&str]) {
    let dir = asphere();
    let path = dir.path().join(file);
    let text: String = fs::read(&path).unwrap().iter().map(|b| char::from(*b)).collect();
    let changed = change(text.clone());
    assert_ne!(changed, text, "{file} was not changed");
    fs::write(&path, changed).unwrap();
    let error = import_error(dir.path(), &with_psf());
    for text in expected {
        assert!(error.contains(text), "`{text}` is not in: {error}");
    }
}

fn replace_line(text: &str, number: usize, new: &str) -> String {
    let lines = text.lines().enumerate().map(|(i, l)| if i + 1 == number { new } else { l });
    lines.collect::<Vec<_>>().join("\n")
}

#[test]
fn malformed_height_tables_are_errors() {
    let di = "AsphereF=2mm_DI_.dat";
    check_changed(
        di,
        |t| replace_line(&t, 5, ""),
        &["DI_.dat, line 21", "100 numbers, expected 105", "21 heights × 5 wavelengths"],
    );
    check_changed(di, |t| t[..t.len() / 2].into(), &["DI_.dat, line 11"]);
    check_changed(di, |t| replace_line(&t, 4, "1 2 3 4"), &["DI_.dat, line 4", "4 numbers, expected 5"]);
    check_changed(
        di,
        |t| replace_line(&t, 6, "0.1 0.1 0.1 0.1 0.1"),
        &["DI_.dat, line 6", "wavelength 3", "does not ascend"],
    );
    check_changed(di, |t| replace_line(&t, 1, "1 1 0.5 1 1"), &["DI_.dat, line 1", "expected 0"]);
    check_changed(
        di,
        |t| replace_line(&t, 6, "0.1 0.1 NaN 0.1 0.1"),
        &["DI_.dat, line 6", "`NaN` is not a finite number"],
    );
    check_changed(di, |t| replace_line(&t, 6, "0.1 0.1 1e999 0.1 0.1"), &["line 6", "`1e999`"]);
    check_changed(
        "AsphereF=2mm_RI_.dat",
        |t| replace_line(&t, 1, "1 1 0.9 1 1"),
        &["at 550 nm", "RI on the axis is 0.9"],
    );
    check_changed("AsphereF=2mm_RI_.dat", |_| "x".into(), &["RI_.dat, line 1", "`x`"]);
}

#[test]
fn malformed_parameters_are_errors() {
    let p = "ISETPARMS.TXT";
    check_changed(p, |t| t.replace("400:75:700", "ones(3)"), &["ISETPARMS.TXT, line 5", "ones(3)"]);
    check_changed(p, |t| t.replace("400:75:700", "700:-75:400"), &["line 5", "ascending"]);
    check_changed(p, |t| t.replace("400:75:700", "1:1e-9:700"), &["line 5", "more than 4096"]);
    check_changed(p, |t| t.replace("imgHeightNum=21", "imgHeightNum=1e18"), &["line 6", "imgHeightNum"]);
    check_changed(
        p,
        |t| t.replace("refWave=550.000;", ""),
        &["does not state the primary wavelength", "--primary-nm"],
    );
    check_changed(p, |t| t.replace("objDist", "objDistance"), &["has no line `objDist=…;`"]);
    check_changed(p, |t| t.replace("fov=27.38", "fov=60.38"), &["line 12", "--distortion-focal-mm"]);
    check_changed(p, |t| t.replace("F=2mm'", "F=3mm'"), &["holds no file `AsphereF=3mm_DI_.dat`"]);
}

#[test]
fn malformed_psf_windows_are_errors() {
    let psf = "AsphereF=2mm_PSF_21_3.dat";
    check_changed(psf, |t| t[..t.len() / 2].into(), &["PSF_21_3.dat, line 82", "`3.470E` is not"]);
    check_changed(
        psf,
        |t| t.lines().take(100).collect::<Vec<_>>().join("\n"),
        &["line 100", "82 rows of 128", "cut short"],
    );
    check_changed(psf, |t| t.replacen("3.206E-004", "-nan(ind)", 1), &["PSF_21_3.dat, line 19", "-nan(ind)"]);
    check_changed(psf, |t| t.replace("0.5500", "0.4750"), &["is of 475 nm, expected 550 nm"]);
    check_changed(
        psf,
        |t| t.replace("-9.59263593", "-8.59263593"),
        &["chief ray at 0.859263593 mm, the DI table at 0.9592636"],
    );
    check_changed(
        psf,
        |t| t.replace("65, 65", "165, 165"),
        &["row 165, column 165", "outside its 128 × 128"],
    );
    check_changed(psf, |t| t.replace("spacing is 0.25", "spacing is 0.5"), &["a pitch of 0.5 µm"]);
    check_changed(
        psf,
        |t| t.replace("128 by 128", "4000000000 by 4000000000"),
        &["PSF_21_3.dat, line", "image grid size"],
    );
    let dir = asphere();
    let error = import_error(dir.path(), &ImportOptions { psf_heights: None, ..with_psf() });
    assert!(
        error.contains("neither `AsphereF=2mm_PSF_2_3.dat` nor `AsphereF=2mm_2D_PSF_Fld2_Wave3.dat`"),
        "{error}"
    );
    for bad in [vec![], vec![1], vec![2, 21], vec![1, 22], vec![1, 1]] {
        let error = import_error(dir.path(), &ImportOptions { psf_heights: Some(bad), ..with_psf() });
        assert!(error.contains("--psf-heights"), "{error}");
    }
}

#[test]
fn malformed_grids_are_errors() {
    let grid = "AsphereF=2mm_GridDistortion_3.dat";
    check_changed(grid, |t| t[..t.len() / 2].into(), &["GridDistortion_3.dat, line"]);
    check_changed(
        grid,
        |t| t.lines().take(1000).collect::<Vec<_>>().join("\n"),
        &["line 1000", "987 points, expected 4225"],
    );
    check_changed(grid, |t| t.replace("Millimeters", "Inches"), &["other units than millimeters"]);
    check_changed(
        grid,
        |t| t.replace("Yref = 0.0", "Yref = 1.0"),
        &["line 11", "the reference is not the axis"],
    );
    check_changed(grid, |t| t.replace("-6.64084E-001", "-7.64084E-001"), &["differs from the DI table"]);
}

/// Changes one file of the example and checks the texts in the error.
fn check_changed_example(file: &str, change: impl Fn(Vec<u8>) -> Vec<u8>, expected: &[&str]) {
    let dir = tempfile::tempdir().unwrap();
    for entry in fs::read_dir(data("../../data/tables-example")).unwrap() {
        let entry = entry.unwrap();
        let bytes = fs::read(entry.path()).unwrap();
        let bytes = if entry.file_name() == file { change(bytes) } else { bytes };
        if !bytes.is_empty() {
            fs::write(dir.path().join(entry.file_name()), bytes).unwrap();
        }
    }
    let error = import_error(dir.path(), &ImportOptions::default());
    for text in expected {
        assert!(error.contains(text), "`{text}` is not in: {error}");
    }
}

fn replaced(from: &'static str, to: &'static str) -> impl Fn(Vec<u8>) -> Vec<u8> {
    move |bytes| {
        let text = String::from_utf8(bytes).unwrap();
        assert!(text.contains(from), "{from}");
        text.replace(from, to).into_bytes()
    }
}

#[test]
fn malformed_plain_tables_are_errors() {
    check_changed_example("heights.csv", |_| Vec::new(), &["heights.csv: cannot read"]);
    check_changed_example(
        "heights.csv",
        replaced("500,5.0", "500,2.0"),
        &["heights.csv, line 4", "height 2 mm does not ascend from 2.5 mm"],
    );
    check_changed_example(
        "heights.csv",
        replaced("550,0.0,", "550,1.0,"),
        &["heights.csv, line 7", "expected 0"],
    );
    check_changed_example(
        "heights.csv",
        replaced("7.415254219", "7,415254219"),
        &["heights.csv, line 5", "5 columns, expected 4"],
    );
    check_changed_example(
        "heights.csv",
        replaced("0.956474435", "nan"),
        &["heights.csv, line 5", "relative_illumination is `nan`"],
    );
    check_changed_example(
        "heights.csv",
        replaced("relative_ill", "ill"),
        &["has no column `relative_illumination`"],
    );
    check_changed_example(
        "lens.csv",
        replaced("psf_outward,down\n", ""),
        &["lens.csv does not state on which side", "--psf-outward"],
    );
    check_changed_example("lens.csv", replaced("even_window,shift\n", ""), &["8 × 8", "--even-window"]);
    check_changed_example(
        "lens.csv",
        replaced("even_window,shift\n", "even_window,shift\neven_window,pad\n"),
        &["lens.csv, line", "`even_window` is given twice"],
    );
    check_changed_example(
        "lens.csv",
        replaced("point", "dots"),
        &["lens.csv, line 9", "`dots`, expected point or integrated"],
    );
    check_changed_example(
        "psf.csv",
        replaced("psf_500.npy,2", "../psf_500.npy,2"),
        &["psf.csv, line 4", "plain file name"],
    );
    check_changed_example(
        "psf.csv",
        replaced("psf_500.npy,2", "psf_500.npy,3"),
        &["has 3 windows, psf.csv refers to index 3"],
    );
    check_changed_example(
        "psf_550.npy",
        |mut b| {
            b.truncate(500);
            b
        },
        &["psf_550.npy", "cut short"],
    );
    check_changed_example("psf_550.npy", |b| b[..4].to_vec(), &["psf_550.npy", "no NPY file"]);
    let huge = |mut b: Vec<u8>| {
        let at = b.windows(9).position(|w| w == b"(3, 8, 8)").unwrap();
        b[at..at + 9].copy_from_slice(b"(9999999)");
        b
    };
    check_changed_example("psf_550.npy", huge, &["psf_550.npy", "expected 39999996"]);
    let nan = |mut b: Vec<u8>| {
        let at = b.len() - 4;
        b[at..].copy_from_slice(&f32::NAN.to_le_bytes());
        b
    };
    check_changed_example("psf_550.npy", nan, &["psf_550.npy", "window 2 has NaN at row 7, column 7"]);
}

#[test]
fn path_without_export_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let none = ImportOptions::default();
    assert!(import_error(&dir.path().join("absent"), &none).contains("cannot open"));
    assert!(import_error(dir.path(), &none).contains("holds no listing of grid distortion"));
    let file = dir.path().join("a.txt");
    fs::write(&file, "x").unwrap();
    assert!(import_error(&file, &none).contains("--from"));
    let npz = dir.path().join("a.npz");
    fs::write(&npz, "PK").unwrap();
    assert!(import_error(&npz, &none).contains("no .npz archive"));
}
