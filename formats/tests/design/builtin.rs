//! The lenses in the program, and what is traced of them.

use lenscube_formats::design::builtin::{BuiltinLens, LENSES, SAMPLE};
use pipeline::design::bundle::Bundle;
use pipeline::design::crossing::crossings;
use pipeline::design::describe::field_tan;
use pipeline::design::field_figures::field_figures;
use pipeline::design::illumination::irradiance_sr;
use pipeline::design::paraxial::Paraxial;
use pipeline::design::ray::Tracer;
use pipeline::design::{DesignError, System, describe};

fn lens(name: &str) -> System {
    BuiltinLens::named(name).unwrap().system()
}

#[test]
fn sample_is_the_lens_of_the_library_examples() {
    assert_eq!(lens(SAMPLE), System::double_gauss_28());
}

/// Nominal focal length in mm and F-number, of the source or of the product that was made of it.
#[test]
fn focal_length_and_f_number_are_those_of_the_source() {
    for (name, mm, f_number) in [
        ("fast-fifty", 50.0, 1.8),
        ("macro-100", 100.0, 2.9),
        ("macro-70", 69.2, 2.9),
        ("mirror-500", 499.48, 6.7),
        ("mirrorless-50", 49.57, 1.85),
        ("triplet", 50.0, 4.0),
        ("uv-105", 105.0, 4.5),
        (SAMPLE, 100.0, 3.0),
    ] {
        let system = BuiltinLens::named(name).unwrap().system();
        let p = Paraxial::new(&system, system.primary_um()).unwrap();
        let f = p.effective_focal_length_mm;
        // Lenses are engraved with rounded figures: a 50 mm lens has up to 52 mm.
        assert!((f / mm - 1.0).abs() < 0.03, "{name}: {f} mm");
        assert!((p.image_f_number() / f_number - 1.0).abs() < 0.03, "{name}: f/{}", p.image_f_number());
    }
}

#[test]
fn light_of_the_outermost_field_point_of_every_lens_reaches_the_film() {
    for lens in LENSES {
        let system = lens.system();
        let tracer = Tracer::new(&system, system.primary_um()).unwrap();
        let tans = system.fields.iter().map(|f| field_tan(&system, &tracer.primary, *f).abs());
        let bundle = Bundle::trace(&tracer, tans.fold(0.0, f64::max), 12, 16);
        let bundle = bundle.unwrap_or_else(|e| panic!("{}: {e}", lens.name));
        assert!(bundle.rays.len() >= 12 * 16 && bundle.chief.x.v > 1.0, "{}", lens.name);
    }
}

#[test]
fn every_lens_is_near_focus_and_names_its_source() {
    assert!(LENSES.len() >= 9 && LENSES[1..].windows(2).all(|w| w[0].name < w[1].name));
    for lens in LENSES {
        let system = lens.system();
        let p = Paraxial::new(&system, system.primary_um()).unwrap();
        let shift = p.focus_shift_mm() / p.effective_focal_length_mm;
        assert!(shift.abs() < 0.01, "{}: focus {shift} focal lengths from the film", lens.name);
        assert!(lens.source().len() > 20 && system.fields.last() > Some(&0.0), "{}", lens.name);
    }
}

#[test]
fn surfaces_of_no_lens_cross() {
    for lens in LENSES {
        let notes = crossings(&lens.system());
        assert!(notes.is_empty(), "{}: {notes:?}", lens.name);
    }
}

#[test]
fn surface_that_folds_rays_over_is_an_error_after_the_budget_and_names_the_surface() {
    let mut damaged = lens("mirrorless-50");
    // The strong asphere of the rear group, where the second surface should be.
    let strong = damaged.surfaces.iter().find(|s| s.shape.aspheric.len() > 1).unwrap().clone();
    damaged.surfaces.insert(1, strong);
    damaged.stop += 1;
    let error = describe(&damaged).unwrap_err();
    let DesignError::Search { rays, field_tan, .. } = &error else { panic!("{error}") };
    assert!(*rays > 0 && *field_tan == 0.0);
    assert!(error.to_string().contains("end at surface 2;"), "{error}");
    assert_eq!(describe(&damaged).unwrap_err(), error);
}

#[test]
fn every_built_in_lens_is_traced_to_the_edge_of_its_field_within_the_budget() {
    for lens in LENSES {
        let system = lens.system();
        let tracer = Tracer::new(&system, system.primary_um()).unwrap();
        let tan = system.fields.iter().map(|f| field_tan(&system, &tracer.primary, *f).abs());
        let edge = tracer.chief_height_mm(tan.fold(0.0, f64::max)).unwrap();
        let um = [system.primary_um()];
        for found in field_figures(&system, &um, &[0.0, 0.75 * edge, edge], 0.99, 2.0).unwrap() {
            assert!(found.is_ok(), "{}: {:?}", lens.name, found.err());
        }
    }
}

/// Up to six surfaces limit the pupils of these lenses, some of them a few degrees of its rim.
#[test]
fn irradiance_equals_that_of_more_rays_where_many_surfaces_limit_the_pupil() {
    for (name, heights_mm) in [("fast-fifty", [3.551, 8.661, 14.05]), ("mirrorless-50", [7.764, 12.0, 20.0])]
    {
        let system = BuiltinLens::named(name).unwrap().system();
        let tracer = Tracer::new(&system, 0.55).unwrap();
        for height in heights_mm {
            let tan = tracer.field_of_height(height).unwrap();
            let found = irradiance_sr(&tracer, tan).unwrap();
            let more = Bundle::trace(&tracer, tan, 24, 300).unwrap().light(&tracer).unwrap();
            let error = found / more.irradiance_sr - 1.0;
            assert!(error.abs() < 5e-8, "{name}, {height} mm: {error:e}");
        }
    }
}
