//! Descriptions that cannot be read or do not fit the lens.

use super::*;

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
