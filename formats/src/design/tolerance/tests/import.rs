//! TOL lines of .zmx files: every operand with its units, and notes on what is left out.

use super::{design, lens, of, parse};
use crate::design::tolerance::import;
use pipeline::design::tolerance::{Direction, Figure, Law, Limits, Quantity, RadiusUnit, Target, Tolerance};

/// Every operand, on a lens in inches: lengths × 25.4, angles × 60, S = 8 in.
#[test]
fn every_operand_is_imported() {
    let operands = "\
TOL COMP  10   0           -0.02           0.03   0 0 0
TCMM Default test wavelength.
TOL TWAV   0   0         0.5461              0   0 0 0
TOL TRAD   1   0           -0.2            0.2   0 0 0
TOL TCUR   2   0         -1e-06          1e-06   0 0 0
TOL TFRN   6   0             -2              3   0 0 0
TOL TCON   3   0          -0.01           0.01   0 0 0
TOL TIRR   1   0           -0.5            0.5   0 0 0
TOL TEXI   2   9             -1              1   0 0 0
TOL TTHI   1   2          -0.06           0.06   0 0 0
TOL TTHI   3   3          -0.02           0.02   0 0 0 0 0
TOL TTHI   4   0           0.01           0.02   0 0 0
TOL TIND   1   0        -0.0002         0.0002   0 0 0
TOL TABB   1   0   -0.641673362    0.641673362   0 0 0
TOL TEDX   1   2 -2.0000000000000000E-02 2.0000000000000000E-02   0 0 0 0 0
TOL TEDY   1   2          -0.02           0.02   0 0 0
TOL TETX   1   2          -0.06           0.06   0 0 0
TOL TETY   1   2          -0.05           0.06   0 0 0
TOL TEDR   3   5          -0.01           0.01   0 0 0
TOL TETR   3   5           -0.1            0.1   0 0 0
TOL TSDX   7   0          -0.02           0.02   0 0 0
TOL TSDY   7   0          -0.02           0.02   0 0 0
TOL TSTX   7   0           -0.2            0.2   0 0 0
TOL TSTY   7   0           -0.2            0.2   0 0 0
TOL TSDR   8   0          -0.02           0.02   0 0 0
TOL TIRX   9   0          -0.01           0.02   0 0 0
TOL TIRY   9   0          -0.01           0.02   0 0 0
TOL TOFF   0   0              0              0   0 0 0
MNUM 1 1
";
    use Direction::{Radial, X, Y};
    let lens = lens("IN");
    let found = import(design("IN", operands).as_bytes(), &lens);
    let fringes_of_curvature = 1e-6 / 25.4 * 203.2 * 203.2 / 546.1e-6;
    let within = |target, quantity, low, high| Tolerance {
        target,
        quantity,
        limits: Limits { low, high, law: Law::Normal },
    };
    // TIR/(2S): 0.01 in and 0.02 in over 16 in, in arcmin.
    let runout = [0.01, 0.02].map(|t: f64| (t / 16.0).to_degrees() * 60.0);
    let (pair, triple) = (Target::element(1, 2), Target::element(3, 5));
    let gap = |after, absorb| Target::Gap { after, absorb };
    // N-BK7: V_d = 64.17, so 1 %; fringe terms 5 to 9: mean squares 1/6, 1/6, 1/8, 1/8, 1/5, coefficients 1/√5 of half a wave.
    let rms: f64 = 0.5 * ((2.0 / 6.0 + 2.0 / 8.0 + 1.0 / 5.0) / 5.0_f64).sqrt();
    let mut expected = vec![
        of(Target::Surface(1), Quantity::Radius(RadiusUnit::Um), 5080.0),
        of(Target::Surface(2), Quantity::Radius(RadiusUnit::Fringes), fringes_of_curvature),
        within(Target::Surface(6), Quantity::Radius(RadiusUnit::Fringes), -2.0, 3.0),
        of(Target::Surface(3), Quantity::Conic, 0.01),
        of(Target::Surface(1), Quantity::Irregularity(Figure::Mixed), 0.5),
    ];
    expected.extend((4..=15).map(|j| of(Target::Surface(2), Quantity::Zernike(j), rms / 12.0_f64.sqrt())));
    expected.extend([
        of(gap(1, Some(2)), Quantity::Thickness, 1524.0),
        of(gap(3, None), Quantity::Thickness, 508.0),
        within(gap(4, None), Quantity::Thickness, 254.0, 508.0),
        of(Target::Glass(1), Quantity::Index, 2e-4),
        of(Target::Glass(1), Quantity::Abbe, 1.0),
        of(pair, Quantity::Decentre(X), 508.0),
        of(pair, Quantity::Decentre(Y), 508.0),
        of(pair, Quantity::Tilt(X), 3.6),
        within(pair, Quantity::Tilt(Y), -3.0, 3.6),
        of(triple, Quantity::Decentre(Radial), 254.0),
        of(triple, Quantity::Tilt(Radial), 6.0),
        of(Target::Surface(7), Quantity::Decentre(X), 508.0),
        of(Target::Surface(7), Quantity::Decentre(Y), 508.0),
        of(Target::Surface(7), Quantity::Tilt(X), 12.0),
        of(Target::Surface(7), Quantity::Tilt(Y), 12.0),
        of(Target::Surface(8), Quantity::Decentre(Radial), 508.0),
        within(Target::Surface(9), Quantity::Tilt(Y), -runout[1], runout[0]),
        within(Target::Surface(9), Quantity::Tilt(X), -runout[0], runout[1]),
    ]);
    let is_close = |a: &Tolerance, b: &Tolerance| {
        // V_d of the program's glass against that of the file; 12 digits.
        let tolerance = if a.quantity == Quantity::Abbe { 1e-4 } else { 1e-11 };
        let same = |a: f64, b: f64| (a - b).abs() <= tolerance * b.abs();
        (a.target, a.quantity) == (b.target, b.quantity)
            && same(a.limits.low, b.limits.low)
            && same(a.limits.high, b.limits.high)
    };
    assert_eq!(found.list.len(), expected.len(), "{:#?}", found.notes);
    for (a, b) in found.list.iter().zip(&expected) {
        assert!(is_close(a, b), "{a:?}\n  expected {b:?}");
    }
    assert_eq!(found.notes.len(), 1, "{:#?}", found.notes);
    assert!(
        found.notes[0]
            .ends_with("fringe terms 5 to 9 become standard terms 4 to 15 of the same RMS, 0.1979 waves"),
        "{}",
        found.notes[0]
    );
    // Its text gives the same errors to 12 digits, whatever their order.
    let file = parse(&found.text).unwrap();
    assert_eq!(file.compensation.focus_um, Some((-508.0, 762.0)));
    assert_eq!(file.fringe_nm, 546.1);
    assert_eq!(file.list.len(), found.list.len());
    for a in &found.list {
        assert!(file.list.iter().any(|b| is_close(a, b)), "{a:?}\n{}", found.text);
    }
    file.tolerances(&lens).unwrap();
}

#[test]
fn what_is_not_imported_is_noted_with_its_line() {
    let operands = "\
TOL TETZ   1   2             -1              1   0 0 0
TOL TUDX   2   0           -0.1            0.1   0 0 0
TOL COMP   8   0             -5              5   0 0 0
TOL TEDX   1   4             -5              5   0 0 0
TOL TEDX   3   5             -5              5   0 0 0
TOL TEDX   1   4             -5              5   0 0 0
TOL TRAD   6   0             -5              5   0 0 0
TOL TIND   2   0          -1e-4           1e-4   0 0 0
TOL TABB   2   0          -1e-4           1e-4   0 0 0
TOL TTHI  20  20             -5              5   0 0 0
TOL TRAD   1   0              5             -5   0 0 0
TOL TRAD   1   0              x              5   0 0 0
TOL TEXI   1   3             -5              5   0 0 0
TOL TWAV   0   0              0              0   0 0 0
";
    let text = design("MM", operands);
    let first = text.lines().position(|l| l.starts_with("TOL")).unwrap() + 1;
    let found = import(text.as_bytes(), &lens("MM"));
    assert_eq!(found.list.len(), 1);
    let expected = [
        (11, "expected an operand, two surface numbers, and two limits; it is left out"),
        (13, "expected a wavelength in µm; fringes are of 632.8 nm"),
        (0, "TETZ is not imported"),
        (1, "TUDX is not imported"),
        (2, "only the gap before the film (surface 10, 0) compensates; it is left out"),
        (4, "element 3-5/decentre_x: its surfaces cross those of `element 1-4`"),
        (5, "element 1-4/decentre_x: `element 1-4/decentre_x` draws the same parameter"),
        (6, "surface 6/radius: surface 6 is flat and has no radius"),
        (7, "glass 2/index: there is no glass behind surface 2"),
        (8, "there is no glass with an index at the lines d, F and C behind this surface; it is left out"),
        (9, "gap 20/thickness: surface 20: expected 1 to 10"),
        (10, "surface 1/radius: limits 5000 to -5000"),
        (12, "expected the greatest fringe term as Int2, 5 to 37; it is left out"),
    ];
    for ((offset, what), note) in expected.iter().zip(&found.notes) {
        let head = format!("line {}: `", first + offset);
        assert!(note.starts_with(&head) && note.contains(what), "{note}\n  expected {head} … {what}");
    }
    assert_eq!(found.notes.len(), expected.len() + 1);
    assert!(found.notes[expected.len()].contains("no operand COMP"), "{:?}", found.notes.last());
    let none = import(design("MM", "TOL TOFF   0   0 0 0   0 0 0\n").as_bytes(), &lens("MM"));
    assert_eq!(none.notes, ["the design has no tolerances (TOL lines)"]);
    assert!(parse(&none.text).unwrap().list.is_empty());
}
