//! Directions of the light at the film of lenses without rotational symmetry: round trips, digests, invalid groups.

use crate::errors::{f64s, replace_array};
use crate::planar::{grid_lens, write_planar};
use crate::*;
use pipeline::lens::cone::{Cone, ConeTable};
use pipeline::lens::cone_field::{ConeField, ConeGrid};

const X_MM: [f64; 5] = [-2.0, -1.0, 0.0, 1.0, 2.0];
const Y_MM: [f64; 4] = [-1.5, -0.5, 0.5, 1.5];

fn grid(x_mm: &[f64], y_mm: &[f64], chief: f64) -> ConeField {
    let cone = |x: f64, y: f64| [chief + 0.01 * x, 0.02 * y, 0.01 * x, 0.02 * y, 0.2, 1e-3 * x * y, 0.19];
    let cones = y_mm.iter().flat_map(|y| x_mm.iter().map(|x| cone(*x, *y))).collect();
    ConeField::Planar(ConeGrid::new(x_mm.into(), y_mm.into(), cones).unwrap())
}

fn table() -> ConeField {
    let cone = Cone { chief: 0.0, centre: 0.0, tangential: 0.1, sagittal: 0.1 };
    ConeField::Symmetric(ConeTable::new(1.0, vec![cone; 4]))
}

fn with(mut lens: Lens, cones: [ConeField; 2]) -> Lens {
    lens.bands.iter_mut().zip(cones).for_each(|(band, cones)| band.cones = Some(cones));
    lens
}

fn lens() -> Lens {
    with(grid_lens(), [grid(&X_MM, &Y_MM, 0.0), grid(&X_MM, &Y_MM, 0.01)])
}

#[test]
fn cones_over_the_film_round_trip_and_change_the_digest() {
    let digest = |lens: &Lens| {
        let tmp = tempfile::tempdir().unwrap();
        let path = tmp.path().join("a.lens.zip");
        write_planar(&path, lens).unwrap();
        let pack = LensPack::open(path).unwrap();
        assert_eq!(pack.lens(), lens);
        pack.digest().unwrap().to_owned()
    };
    let moved = with(grid_lens(), [grid(&X_MM, &Y_MM, 0.0), grid(&X_MM, &Y_MM, 0.02)]);
    let turned = with(grid_lens(), [grid(&Y_MM, &X_MM, 0.0), grid(&Y_MM, &X_MM, 0.01)]);
    let digests = [grid_lens(), lens(), moved, turned].map(|lens| digest(&lens));
    assert!((0..4).all(|k| digests[..k].iter().all(|other| *other != digests[k])), "{digests:?}");
}

#[test]
fn cones_of_another_kind_or_at_other_places_are_not_written() {
    let shifted = X_MM.map(|x| x + 0.1);
    for cones in [
        [table(), table()],
        [grid(&X_MM, &Y_MM, 0.0), table()],
        [grid(&X_MM, &Y_MM, 0.0), grid(&shifted, &Y_MM, 0.0)],
    ] {
        let tmp = tempfile::tempdir().unwrap();
        let e = write_planar(&tmp.path().join("a.lens.zarr"), &with(grid_lens(), cones)).unwrap_err();
        assert!(e.to_string().contains("cones at the same places"), "{e}");
    }
    let tmp = tempfile::tempdir().unwrap();
    let symmetric = with(small_lens(), [grid(&X_MM, &Y_MM, 0.0), grid(&X_MM, &Y_MM, 0.0)]);
    let stacks = (0..2).map(|b| Ok::<_, LensPackError>(small_psf(&symmetric, b)));
    let e = write(tmp.path().join("b.lens.zarr").as_path(), &symmetric, &small_attributes(), stacks);
    assert!(e.unwrap_err().to_string().contains("cones at the same places"));
}

#[test]
fn invalid_cones_are_errors_that_name_them() {
    let good = [0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.1];
    let numbers = |bad: [f64; 7]| {
        let mut all = vec![good; 40];
        all[33] = bad;
        f64s(all.as_flattened())
    };
    let beyond = [0.9, 0.9, 0.0, 0.0, 0.1, 0.0, 0.1];
    let nan = [0.0, f64::NAN, 0.0, 0.0, 0.1, 0.0, 0.1];
    let three = f64s(&X_MM[..3]);
    let cases: [(&str, &[usize], Vec<u8>, &str); 7] = [
        (
            "cones/direction",
            &[2, 20, 7],
            numbers(beyond),
            "of band 1: expected directions less than 90 degrees",
        ),
        ("cones/direction", &[2, 20, 7], numbers(nan), "of band 1: expected directions"),
        ("cones/direction", &[2, 20, 7], numbers([0.0; 7]), "diagonals above 0"),
        ("cones/direction", &[2, 28, 5], f64s(&[0.0; 280]), "array `cones/direction`"),
        ("cones/direction", &[2, 10, 7], f64s(&[0.0; 140]), "places of cones/y and cones/x"),
        ("cones/x", &[3], three, "array `cones/x`"),
        ("cones/x", &[5], f64s(&[0.0, 1.0, 3.0, 4.0, 5.0]), "x is not uniform"),
    ];
    for (name, shape, values, expected) in cases {
        let tmp = tempfile::tempdir().unwrap();
        let path = tmp.path().join("a.lens.zarr");
        write_planar(&path, &lens()).unwrap();
        read_all(&path).unwrap();
        replace_array(path.join(name), "float64", shape, &values);
        let e = read_all(&path).unwrap_err().to_string();
        assert!(e.contains(expected) && e.contains("a.lens.zarr") && !e.contains('\n'), "{name}: {e}");
    }
}
