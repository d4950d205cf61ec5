//! A design written in one format after the other and read again: what must be the same.

use lenscube_formats::design::writing::Written;
use lenscube_formats::design::{Read, ReadOptions, agf, optiland, table, zmx};
use pipeline::design::System;
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::paraxial::Paraxial;

pub const STRICT: ReadOptions = ReadOptions { strict: true, configuration: None };

/// What is read of a written file, with its catalogue.
pub fn read(written: &Written, parse: Read) -> System {
    let mut glasses = GlassLibrary::new();
    if let Some(catalogue) = &written.catalogue {
        glasses.add("own", agf::parse(catalogue.as_bytes()).unwrap());
    }
    parse(written.text.as_bytes(), &glasses, &STRICT).unwrap_or_else(|e| panic!("{e}\n{}", written.text))
}

/// The same but for names of model glasses, whose n_d and V_d are rounded, radii (1e-15) and, from positions, thicknesses (1e-12 mm).
pub fn assert_same(name: &str, a: &System, b: &System) {
    assert_eq!(
        (a.stop, a.primary, a.field_kind, a.aiming, a.is_telecentric),
        (b.stop, b.primary, b.field_kind, b.aiming, b.is_telecentric),
        "{name}"
    );
    assert_eq!((&a.name, &a.wavelengths_um, &a.fields), (&b.name, &b.wavelengths_um, &b.fields), "{name}");
    assert_eq!((a.aperture, a.object_distance_mm), (b.aperture, b.object_distance_mm), "{name}");
    assert_eq!(a.surfaces.len(), b.surfaces.len(), "{name}");
    for (s, t) in a.surfaces.iter().zip(&b.surfaces) {
        let (p, q) = (&s.shape, &t.shape);
        let used = |c: &[f64]| c[..c.iter().rposition(|a| *a != 0.0).map_or(0, |i| i + 1)].to_vec();
        assert!((p.curvature - q.curvature).abs() <= 1e-15 * p.curvature.abs(), "{name}");
        assert_eq!(
            (p.conic, used(&p.aspheric), used(&p.odd)),
            (q.conic, used(&q.aspheric), used(&q.odd)),
            "{name}"
        );
        assert!((s.thickness_mm - t.thickness_mm).abs() <= 1e-12 && s.aperture_mm == t.aperture_mm, "{name}");
        assert_eq!(
            (s.is_mirror, s.obscuration_mm, s.ideal_focal_mm),
            (t.is_mirror, t.obscuration_mm, t.ideal_focal_mm),
            "{name}"
        );
        assert_eq!(s.semi_diameter_mm, t.semi_diameter_mm, "{name}");
        for (um, _) in &a.wavelengths_um {
            let apart = s.medium.index(*um).unwrap() - t.medium.index(*um).unwrap();
            assert!(apart.abs() < 1e-13, "{name}: {apart:e}");
        }
    }
    for (um, _) in &a.wavelengths_um {
        let (p, q) = (Paraxial::new(a, *um).unwrap(), Paraxial::new(b, *um).unwrap());
        let f = p.effective_focal_length_mm;
        for (v, w) in [
            (f, q.effective_focal_length_mm),
            (p.back_focal_length_mm, q.back_focal_length_mm),
            (p.entrance_pupil_mm, q.entrance_pupil_mm),
        ] {
            assert!((v - w).abs() <= 1e-12 * f.abs().max(v.abs()), "{name}: {v} {w}");
        }
    }
}

/// Written as .zmx, table, Optiland's JSON and .zmx again.
pub fn assert_survives_all_formats(name: &str, system: &System) {
    let first = read(&zmx::write(system, "own").unwrap(), zmx::parse);
    assert_same(name, system, &first);
    let second = read(&table::write(&first, "own").unwrap(), table::parse);
    assert_same(name, system, &second);
    let third = read(&optiland::write(&second).unwrap(), optiland::parse);
    assert_same(name, system, &third);
    assert_same(name, system, &read(&zmx::write(&third, "own").unwrap(), zmx::parse));
}
