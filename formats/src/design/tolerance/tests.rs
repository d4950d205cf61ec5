//! Descriptions: the example of the documentation, units, refusals with their lines, text and back.

use std::path::Path;

use pipeline::design::System;
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::tolerance::{
    Boresight, Compensation, Criterion, CriterionFields, CriterionKind, Direction, Figure, Law, Limits,
    Pivot, Quantity, RadiusUnit, Target, Tolerance, Unit,
};

use super::*;
use crate::design::options::ReadOptions;
use crate::design::zmx;

mod import;

/// Object, ten surfaces and the film (11): glass behind 1, 3, 4, 7, 9; stop 6, a plane as 10.
fn design(unit: &str, operands: &str) -> String {
    let mut text = format!(
        "VERS 80915 0 0\nMODE SEQ\nNAME ten\nUNIT {unit} X W X CM MR CPMM\nENPD 5\nFTYP 0 0 1 1\nXFLN 0\nYFLN 0\n"
    );
    text += "WAVM 1 0.55 1\nPWAV 1\nSURF 0\n  TYPE STANDARD\n  CURV 0\n  DISZ INFINITY\n";
    for number in 1..=11 {
        let stop = if number == 6 { "  STOP\n" } else { "" };
        let curvature = if [6, 10, 11].contains(&number) { 0.0 } else { 0.02 };
        let glass = match number {
            1 | 7 => "  GLAS N-BK7 0 0 1.5 40\n",
            3 | 9 => "  GLAS N-SF6 0 0 1.5 40\n",
            4 => "  GLAS F2 0 0 1.5 40\n",
            _ => "",
        };
        let thickness = if number == 11 { 0 } else { 3 };
        text += &format!(
            "SURF {number}\n{stop}  TYPE STANDARD\n  CURV {curvature} 0\n  DISZ {thickness}\n{glass}  DIAM 8 0 0 0 1\n"
        );
    }
    text + operands
}

fn lens(unit: &str) -> System {
    zmx::parse(design(unit, "").as_bytes(), &GlassLibrary::new(), &ReadOptions::default()).unwrap()
}

fn parse(text: &str) -> Result<ToleranceFile, ToleranceFileError> {
    ToleranceFile::parse(Path::new("t.toml"), text)
}

fn of(target: Target, quantity: Quantity, size: f64) -> Tolerance {
    Tolerance { target, quantity, limits: Limits::symmetric(size, Law::Normal) }
}

/// The example of FIELDS.md, section 9.
const EXAMPLE: &str = r#"
[tolerances]                      # everything here is optional
law = "normal"                    # normal: limits are +-2 sigma, truncated | uniform | two-point | parabolic
fringe_nm = 546.1                 # ISO 10110 test wavelength
[[element]]                       # moves as one body; also for groups
surfaces = [7, 9]
decentre_um = 20                  # x and y, each drawn
tilt_arcmin = 1                   # about x and y through `pivot`
wedge_arcmin = 1                  # of the last surface
shift_um = 20                     # along z, between fixed neighbours
[[surface]]
surface = 5
radius_percent = 0.1              # or radius_fringes, radius_um
irregularity_fringes = 0.5        # figure = "astigmatism" | "zernike"
tilt_arcmin = 1                   # decentre_um, conic
[[gap]]
after = 3
thickness_um = 20                 # absorb = 5
[[glass]]
after = 3
index = 5e-4                      # abbe_percent = 0.8
[[film]]
tilt_arcmin = 5                   # decentre_um, shift_um (after focusing)
[compensate]
focus_um = [-500, 500]
film_tilt = false
boresight = "keep"                # | "remove"
[criterion]
kind = "mtf"                      # | "rms-spot" | "rms-wavefront"
frequency_per_mm = 50
fields = "film"
"#;

#[test]
fn the_example_is_read_completely() {
    use Direction::{X, Y};
    let file = parse(EXAMPLE).unwrap();
    let (element, surface) = (Target::element(7, 9), Target::Surface(5));
    let expected = [
        of(element, Quantity::Decentre(X), 20.0),
        of(element, Quantity::Decentre(Y), 20.0),
        of(element, Quantity::Tilt(X), 1.0),
        of(element, Quantity::Tilt(Y), 1.0),
        of(element, Quantity::Wedge(X), 1.0),
        of(element, Quantity::Wedge(Y), 1.0),
        of(element, Quantity::Shift, 20.0),
        of(surface, Quantity::Radius(RadiusUnit::Percent), 0.1),
        of(surface, Quantity::Irregularity(Figure::Astigmatism), 0.5),
        of(surface, Quantity::Tilt(X), 1.0),
        of(surface, Quantity::Tilt(Y), 1.0),
        of(Target::Gap { after: 3, absorb: None }, Quantity::Thickness, 20.0),
        of(Target::Glass(3), Quantity::Index, 5e-4),
        of(Target::Film, Quantity::Tilt(X), 5.0),
        of(Target::Film, Quantity::Tilt(Y), 5.0),
    ];
    assert_eq!(file.list, expected);
    assert_eq!(file.fringe_nm, 546.1);
    assert_eq!(
        file.compensation,
        Compensation { focus_um: Some((-500.0, 500.0)), film_tilt: false, boresight: Boresight::Keep }
    );
    let kind = CriterionKind::Mtf { frequency_per_mm: 50.0 };
    assert_eq!(file.criterion, Criterion { kind, fields: CriterionFields::Film });
    let tolerances = file.tolerances(&lens("MM")).unwrap();
    // Values of fields_reference.py: the draw of `element 7-9/decentre_x` for seed 1, lens 0.
    let values = tolerances.draw(1, 0);
    let index = tolerances.parameters().iter().position(|p| p.id == "element 7-9/decentre_x").unwrap();
    let u: f64 = 0.2958606941195819;
    assert_eq!(values[index], Limits::symmetric(20.0, Law::Normal).value(u));
}

#[test]
fn the_documentation_has_an_example_that_is_read() {
    let source = include_str!("../tolerance.rs");
    let text = source.split("```toml").nth(1).unwrap().split("```").next().unwrap();
    let text: String = text.lines().map(|l| l.trim_start_matches("//!").to_owned() + "\n").collect();
    let file = parse(&text).unwrap();
    assert_eq!(file.list.len(), 7 + 3 + 8 + 1 + 2 + 2);
    file.tolerances(&lens("MM")).unwrap();
}

#[test]
fn every_other_key() {
    use Direction::{Radial, X, Y};
    let file = parse(
        r#"
        [tolerances]
        law = "uniform"
        fringe_nm = 632.8
        [[element]]
        surfaces = [1, 2]
        decentre_um = { limits = [-5, 10], law = "two-point" }
        radial = true
        tilt_arcmin = { limits = 2, law = "parabolic" }
        tilt_radial = true
        pivot = 2
        pivot_offset_mm = -1.5
        wedge_x_arcmin = 0.5
        wedge_y_arcmin = [0, 1]
        [[surface]]
        surface = 3
        radius_fringes = 2
        irregularity_fringes = 0.5
        figure = "mixed"
        conic = 1e-3
        decentre_x_um = 0x10
        tilt_y_arcmin = 1_0
        [[surface]]
        surface = 4
        radius_um = 10
        figure = "zernike"
        zernike = { terms = [4, 7], rms_waves = 0.05 }
        [[gap]]
        after = 3
        absorb = 5
        thickness_um = [0, 20]
        [[glass]]
        after = 4
        abbe_percent = 0.8
        [[film]]
        decentre_y_um = 7
        shift_um = 3
        [compensate]
        focus = false
        film_tilt = true
        boresight = "remove"
        [criterion]
        kind = "rms-wavefront"
        fields = [[0, 0], [1.5, -2]]
        "#,
    )
    .unwrap();
    let uniform = |target, quantity, low, high| Tolerance {
        target,
        quantity,
        limits: Limits { low, high, law: Law::Uniform },
    };
    let element = Target::Element { first: 1, last: 2, pivot: Pivot { surface: 2, offset_mm: -1.5 } };
    let (third, fourth) = (Target::Surface(3), Target::Surface(4));
    let mut expected = vec![
        Tolerance {
            limits: Limits { low: -5.0, high: 10.0, law: Law::TwoPoint },
            ..of(element, Quantity::Decentre(Radial), 0.0)
        },
        Tolerance {
            limits: Limits::symmetric(2.0, Law::Parabolic),
            ..of(element, Quantity::Tilt(Radial), 0.0)
        },
        uniform(element, Quantity::Wedge(X), -0.5, 0.5),
        uniform(element, Quantity::Wedge(Y), 0.0, 1.0),
        uniform(third, Quantity::Radius(RadiusUnit::Fringes), -2.0, 2.0),
        uniform(third, Quantity::Irregularity(Figure::Mixed), -0.5, 0.5),
        uniform(third, Quantity::Conic, -1e-3, 1e-3),
        uniform(third, Quantity::Decentre(X), -16.0, 16.0),
        uniform(third, Quantity::Tilt(Y), -10.0, 10.0),
        uniform(fourth, Quantity::Radius(RadiusUnit::Um), -10.0, 10.0),
    ];
    // Four terms, each at half of the RMS.
    expected.extend((4..=7).map(|j| uniform(fourth, Quantity::Zernike(j), -0.025, 0.025)));
    expected.extend([
        uniform(Target::Gap { after: 3, absorb: Some(5) }, Quantity::Thickness, 0.0, 20.0),
        uniform(Target::Glass(4), Quantity::Abbe, -0.8, 0.8),
        uniform(Target::Film, Quantity::Decentre(Y), -7.0, 7.0),
        uniform(Target::Film, Quantity::Shift, -3.0, 3.0),
    ]);
    assert_eq!(file.list, expected);
    assert_eq!(file.fringe_nm, 632.8);
    assert_eq!(
        file.compensation,
        Compensation { focus_um: None, film_tilt: true, boresight: Boresight::Remove }
    );
    let fields = CriterionFields::Places(vec![[0.0, 0.0], [1.5, -2.0]]);
    assert_eq!(file.criterion, Criterion { kind: CriterionKind::RmsWavefront, fields });
    file.tolerances(&lens("MM")).unwrap();
}

#[test]
fn an_empty_description_has_the_defaults() {
    let file = parse("").unwrap();
    assert!(file.list.is_empty());
    assert_eq!(file.compensation.focus_um, Some((-1000.0, 1000.0)));
    assert_eq!(file.criterion.kind, CriterionKind::Mtf { frequency_per_mm: 50.0 });
    assert!(file.tolerances(&lens("MM")).unwrap().draw(1, 1).is_empty());
}

/// Each text with the message: line, entry, found, expected.
#[test]
fn what_cannot_be_read_names_its_line() {
    let cases = [
        (
            "[[element]]\nsurfaces = [1, 2]\ndecenter_um = 3\n",
            "line 3: [[element]] has no key `decenter_um`; did you mean `decentre_um`? Keys: surfaces, ",
        ),
        ("[tolerance]\n", "line 1: the file has no key `tolerance`; did you mean `tolerances`?"),
        (
            "[tolerances]\nlaw = \"gauss\"\n",
            "line 2: [tolerances] law: expected \"normal\" or \"uniform\" or \"two-point\" or \"parabolic\", found \"gauss\"",
        ),
        (
            "[tolerances]\nfringe_nm = 0.5461\n",
            "line 2: [tolerances] fringe_nm: expected a wavelength in nm, 1 to 1000000, found 0.5461",
        ),
        (
            "\n[[element]]\ndecentre_um = 3\n",
            "line 2: [[element]] has no key `surfaces`: expected [first, last], surface numbers",
        ),
        (
            "[[element]]\nsurfaces = 3\n",
            "line 2: [[element]] surfaces: expected [first, last], surface numbers, found 3",
        ),
        (
            "[[element]]\nsurfaces = [1, 2.5]\n",
            "line 2: [[element]] surfaces: expected a whole number, found 2.5",
        ),
        (
            "[[element]]\nsurfaces = [1, -2]\n",
            "line 2: [[element]] surfaces: expected a whole number, found -2",
        ),
        (
            "\n\n[[element]]\nsurfaces = [1, 2]\n",
            "line 3: [[element]] has no error: expected one with its limits at least",
        ),
        (
            "[[element]]\nsurfaces = [1, 2]\nradial = true\nshift_um = 1\n",
            "line 3: [[element]] radial: expected false, or decentre_um, found true",
        ),
        (
            "[[element]]\nsurfaces = [1, 2]\nshift_um = -1\n",
            "line 3: [[element]] shift_um: expected a number that is not negative (it is ±), or [low, high], found -1",
        ),
        (
            "[[element]]\nsurfaces = [1, 2]\nshift_um = [2, 1]\n",
            "line 3: [[element]] shift_um: expected the lower limit first, found [2, 1]",
        ),
        (
            "[[element]]\nsurfaces = [1, 2]\nshift_um = [1, 2, 3]\n",
            "line 3: [[element]] shift_um: expected [low, high], found [1, 2, 3]",
        ),
        (
            "[[element]]\nsurfaces = [1, 2]\nshift_um = \"20\"\n",
            "line 3: [[element]] shift_um: expected a number (±), [low, high] or {limits = …, law = …}, found \"20\"",
        ),
        (
            "[[element]]\nsurfaces = [1, 2]\nshift_um = nan\n",
            "line 3: [[element]] shift_um: expected a number",
        ),
        (
            "[[element]]\nsurfaces = [1, 2]\nshift_um = { law = \"uniform\" }\n",
            "line 3: [[element]] shift_um has no key `limits`: expected [low, high] or a number",
        ),
        (
            "[[element]]\nsurfaces = [1, 2]\nshift_um = { limit = 3 }\n",
            "line 3: [[element]] shift_um has no key `limit`; did you mean `limits`?",
        ),
        (
            "[element]\nsurfaces = [1, 2]\n",
            "line 1: element: expected tables headed [[element]], found [element]",
        ),
        (
            "[[surface]]\nsurface = 1\nfigure = \"mixed\"\nconic = 1\n",
            "line 3: [[surface]] figure: expected none without irregularity_fringes, found \"mixed\"",
        ),
        (
            "[[surface]]\nsurface = 1\nirregularity_fringes = 1\nzernike = { terms = [4, 5], rms_waves = 1 }\n",
            "line 4: [[surface]] zernike: expected none but where figure = \"zernike\"",
        ),
        (
            "[[surface]]\nsurface = 1\nzernike = { terms = [3, 5], rms_waves = 1 }\n",
            "line 3: zernike terms: expected [first, last], numbers of Zernike terms (standard) from 4 to 231, found [3, 5]",
        ),
        (
            "[[surface]]\nsurface = 1\nzernike = { terms = [4, 5], rms_waves = [0, 1] }\n",
            "line 3: zernike rms_waves: expected one number (±), found [0, 1]",
        ),
        (
            "[[gap]]\nthickness_um = 1\n",
            "line 1: [[gap]] has no key `after`: expected the number of the surface before the gap",
        ),
        (
            "[compensate]\nfocus_um = [1, -1]\n",
            "line 2: [compensate] focus_um: expected [low, high] in µm, the lower one first, found [1, -1]",
        ),
        (
            "[compensate]\nfocus = false\nfocus_um = [-1, 1]\n",
            "line 2: [compensate] focus: expected true, or no focus_um, found false",
        ),
        (
            "[compensate]\nboresight = \"kept\"\n",
            "line 2: [compensate] boresight: expected \"keep\" or \"remove\", found \"kept\"",
        ),
        (
            "[criterion]\nkind = \"rms-spot\"\nfrequency_per_mm = 5\n",
            "line 3: [criterion] frequency_per_mm: expected none: only kind = \"mtf\" has a frequency, found 5",
        ),
        (
            "[criterion]\nfrequency_per_mm = 0\n",
            "line 2: [criterion] frequency_per_mm: expected a number above 0, found 0",
        ),
        (
            "[criterion]\nfields = [[0, 0], [1]]\n",
            "line 2: [criterion] fields: expected [x_mm, y_mm], found [1]",
        ),
        (
            "[criterion]\nfields = \"all\"\n",
            "line 2: [criterion] fields: expected \"film\" or a list of [x_mm, y_mm], found \"all\"",
        ),
        ("[[element]]\nsurfaces = [1, 2\n", "line "),
    ];
    for (text, expected) in cases {
        let message = parse(text).unwrap_err().to_string();
        assert!(
            message.starts_with(&format!("tolerances t.toml: {expected}")),
            "{message}\n  expected {expected}"
        );
    }
}

/// Errors of the lens and of two entries, with both lines.
#[test]
fn what_does_not_fit_the_lens_names_its_lines() {
    let element = |first, last, rest: &str| format!("[[element]]\nsurfaces = [{first}, {last}]\n{rest}\n");
    let shift = "shift_um = 1";
    let cases = [
        (element(10, 12, shift), "line 3: element 10-12/shift: surface 12: expected 1 to 10"),
        (element(0, 2, shift), "line 3: element 0-2/shift: surface 0: expected 1 to 10"),
        (
            element(1, 4, shift) + &element(3, 5, shift),
            "line 6: element 3-5/shift: its surfaces cross those of `element 1-4` and neither range contains the other: give a group all surfaces of its elements (the other one: line 3)",
        ),
        (
            element(1, 2, shift) + &element(1, 2, shift),
            "line 6: element 1-2/shift: `element 1-2/shift` draws the same parameter: keep one of them (the other one: line 3)",
        ),
        (
            element(1, 2, "decentre_um = 1\ndecentre_y_um = 2"),
            "line 4: element 1-2/decentre_y: `element 1-2/decentre_y` draws the same parameter",
        ),
        (
            element(1, 2, "wedge_arcmin = 1") + "[[surface]]\nsurface = 2\ntilt_x_arcmin = 1\n",
            "line 6: surface 2/tilt_x: `element 1-2/wedge_x` draws the same parameter: keep one of them (the other one: line 3)",
        ),
        (
            "[[surface]]\nsurface = 1\nradius_um = 1\nradius_percent = 1\n".to_owned(),
            "line 3: surface 1/radius: `surface 1/radius` draws the same parameter",
        ),
        (
            "[[surface]]\nsurface = 11\nconic = 1\n".to_owned(),
            "line 3: surface 11/conic: surface 11 is the film: name surfaces before it",
        ),
        (
            "[[surface]]\nsurface = 6\nradius_percent = 1\n".to_owned(),
            "line 3: surface 6/radius: surface 6 is flat and has no radius: give the error in fringes",
        ),
        (
            "[[glass]]\nafter = 2\nindex = 1e-4\n".to_owned(),
            "line 3: glass 2/index: there is no glass behind surface 2",
        ),
        (
            "[[gap]]\nafter = 5\nabsorb = 4\nthickness_um = 1\n".to_owned(),
            "line 4: gap 5/thickness: surface 4: expected the surface in front of a later gap, 6 to 10",
        ),
    ];
    let lens = lens("MM");
    for (text, expected) in cases {
        let message = parse(&text).unwrap().tolerances(&lens).unwrap_err().to_string();
        assert!(
            message.starts_with(&format!("tolerances t.toml: {expected}")),
            "{message}\n  expected {expected}"
        );
    }
}

#[test]
fn damaged_descriptions_do_not_panic() {
    let lens = lens("MM");
    for end in (0..EXAMPLE.len()).filter(|end| EXAMPLE.is_char_boundary(*end)) {
        for replaced in ["", "[", "-", "µ", "\n[[element]]\n"] {
            let text = format!("{}{replaced}{}", &EXAMPLE[..end], EXAMPLE.get(end + 1..).unwrap_or(""));
            if let Ok(file) = parse(&text) {
                let _ = file.tolerances(&lens);
            }
        }
    }
}

#[test]
fn records_have_units_and_digits() {
    let file = parse(EXAMPLE).unwrap();
    let tolerances = file.tolerances(&lens("MM")).unwrap();
    let values = tolerances.draw(1, 7);
    let record = record(&tolerances, &values, 1, 7, "abc");
    assert_eq!(record["seed"], 1);
    assert_eq!(record["sample"], 7);
    assert_eq!(record["description"], "abc");
    let rows = record["values"].as_array().unwrap();
    assert_eq!(rows.len(), values.len());
    for ((row, value), p) in rows.iter().zip(&values).zip(tolerances.parameters()) {
        let text = serde_json::to_string(row).unwrap();
        let read: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert_eq!(read["value"].as_f64().map(f64::to_bits), Some(value.to_bits()));
        assert_eq!((read["id"].as_str(), read["unit"].as_str()), (Some(&*p.id), Some(p.unit.name())));
    }
    let columns = columns(&tolerances);
    assert_eq!(columns[0], "element 7-9/decentre_x [um]");
    assert!(columns.contains(&"glass 3/index".to_owned()), "{columns:?}");
    assert!(columns.contains(&"surface 5/irregularity_angle [rad]".to_owned()), "{columns:?}");
    assert_eq!(tolerances.parameters()[0].unit, Unit::Um);
}

#[test]
fn a_description_is_written_and_read_back() {
    let text = r#"
        [tolerances]
        fringe_nm = 632.8
        [[element]]
        surfaces = [1, 5]
        pivot = 3
        pivot_offset_mm = 0.25
        decentre_um = 20
        radial = true
        tilt_x_arcmin = 1
        tilt_y_arcmin = [-1, 3]
        wedge_arcmin = { limits = 1, law = "uniform" }
        wedge_radial = true
        [[surface]]
        surface = 5
        radius_percent = 0.1
        irregularity_fringes = 0.5
        figure = "mixed"
        conic = 1e-7
        [[surface]]
        surface = 5
        zernike = { terms = [4, 11], rms_waves = 0.05 }
        [[gap]]
        after = 3
        absorb = 5
        thickness_um = { limits = [-10, 20], law = "two-point" }
        [[glass]]
        after = 3
        index = 5e-4
        abbe_percent = 0.8
        [[film]]
        tilt_arcmin = 5
        [compensate]
        focus = false
        boresight = "remove"
        "#;
    let file = parse(text).unwrap();
    let written = write(&file.list, file.fringe_nm, &file.compensation);
    let again = parse(&written).unwrap();
    assert_eq!(
        (&again.list, again.fringe_nm, again.compensation),
        (&file.list, 632.8, file.compensation),
        "{written}"
    );
}
