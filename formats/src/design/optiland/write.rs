//! Writes Optiland's JSON.

use super::{OWN, film_height_scale, json};
use crate::design::agf;
use crate::design::error::LensFileError;
use crate::design::writing::{
    GlassForm, Written, catalogues_of, check_symmetry, glass_form, surfaces_along_z,
};
use pipeline::design::glass::Glass;
use pipeline::design::glass_library::maker_of_glass;
use pipeline::design::model_glass::LINES_UM;
use pipeline::design::shape::Shape;
use pipeline::design::system::{Aperture, FieldKind, Medium, RayAiming, System};
use serde_json::{Value, json};

/// The file of `system`. What it cannot hold is listed in the notes.
///
/// # Errors
/// [`LensFileError::Incomplete`] for an aperture that the format does not have; no first-order properties, for paraxial image heights.
pub fn write(system: &System) -> Result<Written, LensFileError> {
    check_symmetry(system)?;
    let mut notes = Vec::new();
    let aperture = match system.aperture {
        Aperture::EntrancePupil(d) => {
            json!({"type": "EPD", "value": d, "object_space_telecentric": system.is_telecentric})
        }
        Aperture::ImageFNumber(f) => {
            json!({"type": "imageFNO", "value": f, "object_space_telecentric": system.is_telecentric})
        }
        Aperture::ObjectNa(na) => {
            json!({"type": "objectNA", "value": na, "object_space_telecentric": system.is_telecentric})
        }
        Aperture::StopRadius(r) => {
            json!({"type": "float_by_stop_size", "value": 2.0 * r, "object_space_telecentric": system.is_telecentric})
        }
        Aperture::WorkingFNumber(_) => {
            let problem = "has a working F-number as aperture, which Optiland's JSON does not support: write .zmx or .csv";
            return Err(LensFileError::Incomplete { problem: problem.to_owned() });
        }
    };
    let (kind, definition) = match system.field_kind {
        FieldKind::Angle => ("angle", "AngleField"),
        FieldKind::ObjectHeight => ("object_height", "ObjectHeightField"),
        FieldKind::ParaxialImageHeight => ("paraxial_image_height", "ParaxialImageHeightField"),
        FieldKind::RealImageHeight => ("real_image_height", "RealImageHeightField"),
    };
    let scale = film_height_scale(system)?;
    let field = |y: &f64| json!({"field_type": kind, "x": 0.0, "y": y * scale, "vx": 0.0, "vy": 0.0});
    // Older versions of the program accept no weight.
    let are_weighted = system.wavelengths_um.iter().any(|w| w.1 != 1.0);
    let wavelength = |(i, w): (usize, &(f64, f64))| match are_weighted {
        true => json!({"value": w.0, "is_primary": i == system.primary, "unit": "um", "weight": w.1}),
        false => json!({"value": w.0, "is_primary": i == system.primary, "unit": "um"}),
    };
    let own = catalogues_of(system, OWN).map(|(_, agf)| agf).unwrap_or_else(|e| {
        notes.push(e.to_string());
        None
    });
    let air = json!({"type": "IdealMaterial", "index": 1.0, "absorp": 0.0});
    let first_z = system.object_distance_mm.map_or(-json::INFINITE, |d| -d);
    let mut surfaces = vec![json!({
        "type": "ObjectSurface",
        "geometry": {"type": "Plane", "cs": position(first_z), "radius": json::INFINITE},
        "material_post": air,
    })];
    let (mut z, mut before) = (0.0, air.clone());
    for (i, surface) in surfaces_along_z(system).iter().enumerate() {
        let after = match &surface.medium {
            Medium::Air => air.clone(),
            Medium::Glass(glass) => material(glass, own.is_some(), &mut notes)?,
        };
        let (outer, inner) = (surface.aperture_mm, surface.obscuration_mm);
        let aperture = (outer.is_some() || inner.is_some()).then(|| {
            json!({"type": "RadialAperture", "r_max": outer.unwrap_or(json::INFINITE), "r_min": inner.unwrap_or(0.0)})
        });
        surfaces.push(json!({
            "type": if surface.ideal_focal_mm.is_some() { "ParaxialSurface" } else { "Surface" },
            "f": surface.ideal_focal_mm,
            "geometry": geometry(&surface.shape, z),
            "material_pre": before,
            "material_post": after.clone(),
            "is_stop": i == system.stop,
            "aperture": aperture,
            "coating": null,
            "bsdf": null,
            "is_reflective": surface.is_mirror,
        }));
        z += surface.thickness_mm;
        before = after;
    }
    let aiming = if system.aiming == RayAiming::Real { "robust" } else { "paraxial" };
    let file = json!({
        "version": 1.0,
        "name": system.name,
        "aperture": aperture,
        "fields": {
            "fields": system.fields.iter().map(field).collect::<Vec<_>>(),
            "telecentric": system.is_telecentric,
            "field_definition": {"field_type": definition},
            "field_type": kind,
            "object_space_telecentric": system.is_telecentric,
        },
        "wavelengths": {
            "wavelengths": system.wavelengths_um.iter().enumerate().map(wavelength).collect::<Vec<_>>(),
            "polarization": "ignore",
        },
        "ray_tracer": {"ray_aiming_config": {"mode": aiming, "max_iter": 10, "tol": 1e-6}},
        "ray_aiming": {"mode": aiming},
        "pickups": [],
        "solves": {"solves": []},
        "surface_group": {"surfaces": surfaces},
        // What the format does not have, for this program.
        "lenscube": {
            "semi_diameters_mm": system.surfaces.iter().map(|s| s.semi_diameter_mm).collect::<Vec<_>>(),
            "glasses_agf": own,
        },
    });
    Ok(Written { text: json::text(&file), catalogue: None, notes })
}

fn position(z: f64) -> Value {
    json!({"x": 0.0, "y": 0.0, "z": z, "rx": 0.0, "ry": 0.0, "rz": 0.0, "reference_cs": null})
}

fn geometry(shape: &Shape, z: f64) -> Value {
    let radius = if shape.curvature == 0.0 { json::INFINITE } else { 1.0 / shape.curvature };
    let at = |c: &[f64], i: usize| c.get(i).copied().unwrap_or(0.0);
    let is_odd = shape.odd.iter().any(|a| *a != 0.0);
    let is_even = shape.aspheric.iter().any(|a| *a != 0.0);
    let (kind, coefficients): (_, Vec<f64>) = match (is_odd, is_even) {
        (true, _) => {
            let count = shape.odd.len().max(shape.aspheric.len());
            ("OddAsphere", (0..count).flat_map(|i| [at(&shape.odd, i), at(&shape.aspheric, i)]).collect())
        }
        (false, true) => ("EvenAsphere", shape.aspheric.clone()),
        (false, false) if shape.curvature == 0.0 => {
            return json!({"type": "Plane", "cs": position(z), "radius": json::INFINITE});
        }
        (false, false) => {
            return json!({"type": "StandardGeometry", "cs": position(z), "radius": radius, "conic": shape.conic});
        }
    };
    json!({
        "type": kind, "cs": position(z), "radius": radius, "conic": shape.conic,
        "tol": 1e-10, "max_iter": 100, "coefficients": coefficients,
    })
}

/// `has_own`: whether the file has a catalogue of the glasses that are not built in.
fn material(glass: &Glass, has_own: bool, notes: &mut Vec<String>) -> Result<Value, LensFileError> {
    let abbe = |n: f64, v: f64| json!({"type": "AbbeMaterial", "index": n, "abbe": v});
    match glass_form(glass, &[]) {
        GlassForm::Constant(n) => return Ok(json!({"type": "IdealMaterial", "index": n, "absorp": 0.0})),
        GlassForm::Model(n, v, delta) => {
            if delta != 0.0 {
                notes.push(format!("glass {}: Optiland does not use its ΔP_gF = {delta:.4}", glass.name));
            }
            let mut material = abbe(n, v);
            material["dP_gF"] = json!(delta);
            return Ok(material);
        }
        GlassForm::Named(_) => (),
    }
    if let Some(maker) = maker_of_glass(glass) {
        return Ok(json!({
            "type": "Material", "filename": null, "name": glass.name, "reference": maker.to_lowercase(),
            "robust_search": true, "min_wavelength": null, "max_wavelength": null,
        }));
    }
    let [first, _, last, _] = LINES_UM;
    if glass.range_um.0 > first || glass.range_um.1 < last {
        let problem = format!(
            "has glass {} of a catalogue of its own, which is not of the visible: Optiland's JSON cannot hold it, write .zmx or .csv",
            glass.name
        );
        return Err(LensFileError::Incomplete { problem });
    }
    let [f, d, c, _] = LINES_UM.map(|um| glass.dispersion.index(um));
    let v = (d - 1.0) / (f - c);
    notes.push(format!(
        "glass {} of a catalogue of its own: Optiland uses its n_d = {d:.6} and V_d = {v:.3}",
        glass.name
    ));
    let mut material = abbe(d, v);
    if has_own {
        material["lenscube_glass"] = json!(agf::written_name(glass));
    }
    Ok(material)
}
