//! Writes a lens as a table.

use crate::design::error::LensFileError;
use crate::design::writing::{
    GlassForm, Written, catalogues_of, check_symmetry, glass_form, number, one_line, radius, surfaces_along_z,
};
use pipeline::design::system::{Aperture, FieldKind, Medium, RayAiming, System};

/// The table of `system`; `own` is the catalogue that glasses which are not built in are written to.
///
/// # Errors
/// [`LensFileError::Incomplete`] if the table cannot hold the lens.
pub fn write(system: &System, own: &str) -> Result<Written, LensFileError> {
    check_symmetry(system)?;
    let mut written = Written::default();
    let mut line = |cells: &[String]| {
        written.text += cells.join(",").trim_end_matches(',');
        written.text.push('\n');
    };
    let setting = |name: &str, values: &[f64]| -> Vec<String> {
        std::iter::once(name.to_owned()).chain(values.iter().map(|v| number(*v))).collect()
    };
    line(&["name".to_owned(), format!("\"{}\"", one_line(&system.name).replace('"', "'"))]);
    let (catalogues, own_glasses) = catalogues_of(system, own)?;
    if !catalogues.is_empty() {
        line(&[vec!["catalogues".to_owned()], catalogues.clone()].concat());
    }
    line(&match system.aperture {
        Aperture::EntrancePupil(d) => setting("entrance pupil diameter", &[d]),
        Aperture::ImageFNumber(f) => setting("f-number", &[f]),
        Aperture::WorkingFNumber(f) => setting("working f-number", &[f]),
        Aperture::ObjectNa(na) => setting("object na", &[na]),
        Aperture::StopRadius(r) => setting("stop radius", &[r]),
    });
    let kind = match system.field_kind {
        FieldKind::Angle => "field deg",
        FieldKind::ObjectHeight => "object height",
        FieldKind::ParaxialImageHeight => "paraxial image height",
        FieldKind::RealImageHeight => "real image height",
    };
    line(&setting(kind, &system.fields));
    let nm: Vec<f64> = system.wavelengths_um.iter().map(|(um, _)| nanometres(*um)).collect();
    line(&setting("wavelengths nm", &nm));
    line(&setting("weights", &system.wavelengths_um.iter().map(|w| w.1).collect::<Vec<_>>()));
    line(&setting("primary nm", &[nm[system.primary]]));
    line(&[
        "aiming".to_owned(),
        (if system.aiming == RayAiming::Real { "real" } else { "paraxial" }).to_owned(),
    ]);
    if system.is_telecentric {
        line(&["object space".to_owned(), "telecentric".to_owned()]);
    }

    let longest = |f: fn(&pipeline::design::shape::Shape) -> usize| {
        system.surfaces.iter().map(|s| f(&s.shape)).max().unwrap_or(0)
    };
    let (even, odd) = (longest(|s| s.aspheric.len()), longest(|s| s.odd.len()));
    let powers: Vec<usize> = (1..=2 * even.max(odd))
        .filter(|p| (p % 2 == 0 && p / 2 <= even) || (p % 2 == 1 && p.div_ceil(2) <= odd))
        .collect();
    let has_ideal = system.surfaces.iter().any(|s| s.ideal_focal_mm.is_some());
    let fixed = [
        "surface",
        "radius",
        "thickness",
        "glass",
        "n_d",
        "V_d",
        "dP_gF",
        "semi-diameter",
        "aperture radius",
        "obscuration radius",
        "conic",
    ];
    let ideal = has_ideal.then(|| "ideal f".to_owned());
    let header =
        fixed.iter().map(|c| (*c).to_owned()).chain(ideal).chain(powers.iter().map(|p| format!("a{p}")));
    line(&header.collect::<Vec<_>>());
    if let Some(distance) = system.object_distance_mm {
        line(&["object".to_owned(), String::new(), number(distance)]);
    }
    for (i, surface) in surfaces_along_z(system).iter().enumerate() {
        let is_image = i == system.image();
        let role = match i {
            i if i == system.stop => "stop".to_owned(),
            _ if is_image => "image".to_owned(),
            i => (i + 1).to_string(),
        };
        let given = |v: f64| if v == 0.0 { String::new() } else { number(v) };
        let thickness = if is_image { String::new() } else { number(surface.thickness_mm) };
        let mut cells = vec![role, radius(surface.shape.curvature), thickness];
        cells.extend(match &surface.medium {
            _ if surface.is_mirror => ["mirror", "", "", ""].map(str::to_owned),
            Medium::Air => [(); 4].map(|()| String::new()),
            Medium::Glass(glass) => match glass_form(glass, &catalogues) {
                GlassForm::Named(name) => [name, String::new(), String::new(), String::new()],
                GlassForm::Constant(n) => [String::new(), number(n), String::new(), String::new()],
                GlassForm::Model(n, v, delta) => [String::new(), number(n), number(v), given(delta)],
            },
        });
        cells.extend([
            given(surface.semi_diameter_mm),
            surface.aperture_mm.map_or_else(String::new, number),
            surface.obscuration_mm.map_or_else(String::new, number),
            given(surface.shape.conic),
        ]);
        if has_ideal {
            cells.push(surface.ideal_focal_mm.map_or_else(String::new, number));
        }
        for power in &powers {
            let coefficients = if power % 2 == 0 { &surface.shape.aspheric } else { &surface.shape.odd };
            cells.push(given(coefficients.get((power - 1) / 2).copied().unwrap_or(0.0)));
        }
        line(&cells);
    }
    written.catalogue = own_glasses;
    Ok(written)
}

/// The nanometres that are read as `um` again.
fn nanometres(um: f64) -> f64 {
    let nm = um * 1e3;
    let rounded = (nm * 1e6).round() / 1e6;
    let candidates = [rounded, nm, nm.next_up(), nm.next_down()];
    candidates.into_iter().find(|v| v / 1e3 == um).unwrap_or(nm)
}
