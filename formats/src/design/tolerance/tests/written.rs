//! What is written: records of drawn lenses, and descriptions.

use super::*;
use pipeline::design::tolerance::Unit;

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
