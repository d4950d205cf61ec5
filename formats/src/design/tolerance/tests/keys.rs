//! Every key of a description, and its default.

use super::*;
use pipeline::design::tolerance::{
    Boresight, Compensation, Criterion, CriterionFields, CriterionKind, Direction, Figure, Pivot, RadiusUnit,
};

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
    let source = include_str!("../../tolerance.rs");
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
