//! `lenscube lens tolerance`.

use super::*;

const WRONG: i32 = 4;
/// Two elements and the film of the Double Gauss, judged by spots.
const TOLERANCES: &str = "[tolerances]\nlaw = \"uniform\"\n\
[[element]]\nsurfaces = [7, 9]\ndecentre_um = 20\n\
[[gap]]\nafter = 11\nthickness_um = 30\n\
[[film]]\ntilt_x_arcmin = 2\n\
[criterion]\nkind = \"rms-spot\"\nfields = [[0, 0], [12, 0], [0, -12]]\n";

/// A directory with the description `tol.toml`.
fn place(tolerances: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("tol.toml"), tolerances).unwrap();
    dir
}

fn tolerance(dir: &Path, out: &str, flags: &[&str]) -> CommandResult {
    let (file, out) = (dir.join("tol.toml"), dir.join(out));
    let words = ["lens", "tolerance", "double-gauss-28", text(&file), "--out", text(&out)];
    lenscube(&[&words[..], &["--max-height-mm", "18"], flags].concat())
}

/// Head and rows of a CSV file without quoted cells.
fn rows(path: &Path) -> Vec<Vec<String>> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

/// The column `name` as numbers.
fn column(rows: &[Vec<String>], name: &str) -> Vec<f64> {
    let i = rows[0].iter().position(|head| head == name).unwrap_or_else(|| panic!("{name}: {:?}", rows[0]));
    rows[1..].iter().map(|row| row[i].parse().unwrap()).collect()
}

#[test]
fn lenses_are_drawn_focused_and_judged() {
    let dir = place(TOLERANCES);
    let ran = tolerance(dir.path(), "a", &["--samples", "4", "--pass", "8", "--threads", "1"]).ok();
    assert!(ran.stdout.contains("4 lenses of seed 1, 3 fields to 18.00 mm"), "{}", ran.stdout);
    assert!(ran.stdout.contains("yield with at most 8"), "{}", ran.stdout);
    let out = dir.path().join("a");
    let mut names: Vec<_> = fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["field.svg", "film-shift.svg", "lenses.csv", "summary.json", "yield.svg"]);
    let all = rows(&out.join("lenses.csv"));
    assert_eq!(all.len(), 5);
    assert_eq!(column(&all, "sample"), [0.0, 1.0, 2.0, 3.0]);
    // u(1, 0, "element 7-9/decentre_x") = 0.2958606941195819 of fields_reference.py.
    let drawn = column(&all, "element 7-9/decentre_x [um]");
    assert_eq!(drawn[0], 20.0 * (2.0 * 0.2958606941195819 - 1.0));
    // The film follows the last gap, from the focus of the lens without errors, but for decentres and tilt.
    let (gaps, shifts) = (column(&all, "gap 11/thickness [um]"), column(&all, "film_shift_mm"));
    let summary: Value = serde_json::from_slice(&fs::read(out.join("summary.json")).unwrap()).unwrap();
    let nominal = summary["figures"]["film_shift_mm"]["nominal"].as_f64().unwrap();
    for (gap, shift) in gaps.iter().zip(&shifts) {
        assert!((shift + 1e-3 * gap - nominal).abs() < 1e-3, "{gap} {shift} {nominal}");
    }
    // Percentiles are those of actual lenses.
    let criterion = column(&all, "criterion");
    for at in summary["figures"]["criterion"]["percentiles"].as_array().unwrap() {
        let sample = at["sample"].as_u64().unwrap() as usize;
        assert_eq!(at["value"].as_f64().unwrap(), criterion[sample]);
    }
    let good = criterion.iter().filter(|v| **v <= 8.0).count();
    assert_eq!(summary["yield"]["share"].as_f64().unwrap(), good as f64 / 4.0);
    // The criterion is the mean over the fields.
    let spots: Vec<_> = (1..=3).map(|k| column(&all, &format!("rms_spot_{k}_um"))).collect();
    let mean = (spots[0][2] + spots[1][2] + spots[2][2]) / 3.0;
    assert!((mean / criterion[2] - 1.0).abs() < 1e-10);

    // Fewer lenses, more threads: the same lenses.
    tolerance(dir.path(), "b", &["--samples", "2", "--threads", "3", "--quiet"]).ok();
    let text = |out: &str| fs::read_to_string(dir.path().join(out).join("lenses.csv")).unwrap();
    assert!(text("a").starts_with(&text("b")));
    // Existing files stay.
    let again = tolerance(dir.path(), "b", &["--samples", "3"]);
    assert_eq!(again.code, OTHER_JOB, "{}", again.stderr);
    let other = json(tolerance(dir.path(), "b", &["--samples", "1", "--seed", "2", "--overwrite", "--json"]));
    assert_eq!((other["samples"].as_u64(), other["seed"].as_u64()), (Some(1), Some(2)));
    assert!(!text("a").starts_with(&text("b")));
}

#[test]
fn errors_alone_are_sorted_by_their_effect() {
    let dir = place(TOLERANCES);
    tolerance(dir.path(), "a", &["--samples", "1", "--sensitivity"]).ok();
    let all = rows(&dir.path().join("a/sensitivity.csv"));
    assert_eq!(all.len(), 1 + 2 * 4);
    let changes = column(&all, "criterion_change");
    let largest: Vec<f64> = changes.chunks(2).map(|c| c[0].abs().max(c[1].abs())).collect();
    assert!(largest.is_sorted_by(|a, b| a >= b), "{largest:?}");
    // The gap is compensated, and the film is where it was behind the lens.
    let of = |id: &str| all.iter().position(|row| row[0] == id).unwrap() - 1;
    let gap = of("gap 11/thickness");
    assert!(changes[gap].abs() < 1e-6, "{}", changes[gap]);
    let shifts = column(&all, "film_shift_change_mm");
    assert!((shifts[gap] - 0.03).abs() < 1e-5 && (shifts[gap + 1] + 0.03).abs() < 1e-5, "{shifts:?}");
    assert!(
        fs::read_to_string(dir.path().join("a/sensitivity.svg")).unwrap().contains("element 7-9/decentre_x")
    );
}

#[test]
fn kept_lenses_are_packs_with_their_errors() {
    let dir = place(&TOLERANCES.replace("12]", "1]").replace("[12,", "[1,"));
    let out = dir.path().join("a");
    let flags = ["--samples", "2", "--keep", "1,worst", "--wavelengths", "560", "--max-height-mm", "1.5"];
    let (file, design) = (dir.path().join("tol.toml"), "double-gauss-28");
    let words = ["lens", "tolerance", design, text(&file), "--out", text(&out)];
    lenscube(&[&words[..], &flags].concat()).ok();
    let all = rows(&out.join("lenses.csv"));
    let (criterion, shifts) = (column(&all, "criterion"), column(&all, "film_shift_mm"));
    let worst = if criterion[0] > criterion[1] { 0 } else { 1 };
    for sample in [1, worst] {
        let pack = out.join(format!("packs/{sample}.lens.zarr/zarr.json"));
        let pack: Value = serde_json::from_slice(&fs::read(pack).unwrap()).unwrap();
        let attributes = &pack["attributes"];
        assert_eq!(attributes["errors"]["sample"].as_u64(), Some(sample as u64));
        let shift = attributes["compensators"]["film_shift_mm"].as_f64().unwrap();
        assert!((shift / shifts[sample] - 1.0).abs() < 1e-10, "{shift} {}", shifts[sample]);
    }
    assert_eq!(fs::read_dir(out.join("packs")).unwrap().count(), if worst == 1 { 1 } else { 2 });
}

#[test]
fn more_than_a_tenth_of_failed_lenses_is_exit_code_4() {
    let broken = "[tolerances]\nlaw = \"two-point\"\n[[element]]\nsurfaces = [1, 2]\ndecentre_x_um = 60000\n\
[criterion]\nkind = \"rms-spot\"\nfields = [[0, 0]]\n";
    let dir = place(broken);
    let ran = tolerance(dir.path(), "a", &["--samples", "2"]);
    assert_eq!(ran.code, WRONG, "{}", ran.stderr);
    let text = fs::read_to_string(dir.path().join("a/lenses.csv")).unwrap();
    assert_eq!(text.lines().filter(|line| line.contains(",failed,")).count(), 2, "{text}");
}

#[test]
fn tolerances_that_cannot_be_fail_with_one_line() {
    let dir = place("[[element]]\nsurfaces = [7, 9]\ndecenter_um = 20\n");
    let ran = tolerance(dir.path(), "a", &["--samples", "1"]);
    assert_error_line(&ran, USAGE, &["line 3", "decentre_um"]);
    assert!(!dir.path().join("a").exists());
    for flags in [&["--keep", "p101"][..], &["--samples", "0"], &["--pass", "good"], &["--film-size", "99"]] {
        assert_eq!(tolerance(dir.path(), "a", flags).code, USAGE, "{flags:?}");
    }
    // Where nothing can be created: before a lens is drawn.
    fs::write(dir.path().join("tol.toml"), TOLERANCES).unwrap();
    fs::write(dir.path().join("file"), "").unwrap();
    let ran = tolerance(dir.path(), "file", &["--samples", "1"]);
    assert_error_line(&ran, OTHER_JOB, &["file/lenses.csv", "file is not a directory", "--out"]);
    fs::create_dir_all(dir.path().join("a/packs/3.lens.zarr")).unwrap();
    let ran = tolerance(dir.path(), "a", &["--samples", "1", "--keep", "0", "--overwrite"]);
    assert_error_line(&ran, OTHER_JOB, &["a/packs has lens packs", "--keep", "--out"]);
    assert!(!dir.path().join("a/lenses.csv").exists());
    // An output in place of the description.
    fs::rename(dir.path().join("tol.toml"), dir.path().join("lenses.csv")).unwrap();
    let input = dir.path().join("lenses.csv");
    let ran = lenscube(&["lens", "tolerance", "double-gauss-28", text(&input), "--out", text(dir.path())]);
    assert_eq!(ran.code, USAGE, "{}", ran.stderr);
}

#[test]
fn tol_lines_of_a_design_become_a_description() {
    let dir = tempfile::tempdir().unwrap();
    let design = dir.path().join("dg.zmx");
    let lines = "TOL TEDX   7   9  -0.02  0.02  0 0 0\nTOL TTHI   3   3  -0.03  0.03  0 0 0\n";
    fs::write(&design, format!("{}\n{lines}", DESIGN.trim_end())).unwrap();
    let out = dir.path().join("tol.toml");
    let import = ["lens", "tolerance", text(&design), "--import-tol"];
    let printed = lenscube(&import).ok().stdout;
    lenscube(&[&import[..], &["-o", text(&out)]].concat()).ok();
    let written = fs::read_to_string(&out).unwrap();
    assert_eq!(printed.trim_end(), written.trim_end());
    assert!(written.contains("[[element]]\nsurfaces = [7, 9]\ndecentre_x_um = 20"), "{written}");
    assert!(written.contains("[[gap]]\nafter = 3\nthickness_um = 30"), "{written}");
    assert_eq!(lenscube(&[&import[..], &["-o", text(&out)]].concat()).code, OTHER_JOB);
    assert_eq!(lenscube(&["lens", "tolerance", "double-gauss-28", "--import-tol"]).code, USAGE);
}
