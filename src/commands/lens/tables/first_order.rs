//! First- and third-order tables of a design.

use super::request::{Request, number};
use super::table::Table;
use crate::args::TableName;
use anyhow::Result;
use pipeline::design::cardinal::cardinal_points;
use pipeline::design::paraxial_rays::paraxial_rays;
use pipeline::design::seidel::{Seidel, seidel, total};
use pipeline::design::{Description, System};
use serde_json::{Map, Value, json};

/// System data: name, value, unit.
pub fn design_figures(d: &Description) -> [(&'static str, Value, &'static str); 21] {
    [
        ("effective focal length", json!(d.effective_focal_length_mm), "mm"),
        ("distortion focal length", json!(d.distortion_focal_length_mm), "mm"),
        ("back focal length", json!(d.back_focal_length_mm), "mm"),
        ("total track", json!(d.total_track_mm), "mm"),
        ("paraxial focus from film", json!(d.paraxial_focus_mm), "mm"),
        ("image space F-number", json!(d.image_space_f_number), ""),
        ("paraxial working F-number", json!(d.paraxial_working_f_number), ""),
        ("working F-number", json!(d.working_f_number), ""),
        ("image space NA", json!(d.image_space_na), ""),
        ("NA of real rays", json!(d.real_na), ""),
        ("entrance pupil position", json!(d.entrance_pupil_position_mm), "mm"),
        ("entrance pupil diameter", json!(d.entrance_pupil_diameter_mm), "mm"),
        ("exit pupil position", json!(d.exit_pupil_position_mm), "mm"),
        ("exit pupil diameter", json!(d.exit_pupil_diameter_mm), "mm"),
        ("stop radius", json!(d.stop_radius_mm), "mm"),
        ("paraxial image height", json!(d.paraxial_image_height_mm), "mm"),
        ("paraxial height on film", json!(d.paraxial_film_height_mm), "mm"),
        ("maximum field", json!(d.maximum_field_deg), "deg"),
        ("angular magnification", json!(d.angular_magnification), ""),
        ("magnification", json!(d.magnification), ""),
        ("object distance", json!(d.object_distance_mm), "mm"),
    ]
}

/// [`design_figures`] as JSON.
pub fn design_json(d: &Description) -> Value {
    let mut map = Map::new();
    map.insert("name".into(), json!(d.name));
    map.insert("primary_wavelength_nm".into(), json!(d.primary_wavelength_nm));
    for (name, value, unit) in design_figures(d) {
        let unit = if unit.is_empty() { String::new() } else { format!("_{unit}") };
        map.insert(format!("{}{unit}", name.replace([' ', '-'], "_").to_lowercase()), value);
    }
    Value::Object(map)
}

/// Cardinal points by wavelength: object side from the first surface, image side from the film.
pub fn cardinal(name: TableName, system: &System, request: &Request<'_>) -> Result<Table> {
    let mut rows = Vec::new();
    for nm in request.nm {
        for (side, at) in ["object", "image"].into_iter().zip(cardinal_points(system, nm / 1e3)?) {
            rows.push(vec![
                json!(nm),
                json!(side),
                number(at.focal_length_mm),
                number(at.focal_mm),
                number(at.principal_mm),
                number(at.anti_principal_mm),
                number(at.nodal_mm),
                number(at.anti_nodal_mm),
            ]);
        }
    }
    let columns = [
        "wavelength_nm",
        "side",
        "focal_length_mm",
        "focal_point_mm",
        "principal_point_mm",
        "anti_principal_point_mm",
        "nodal_point_mm",
        "anti_nodal_point_mm",
    ];
    Ok(Table::new(name, &columns, rows))
}

/// Seidel and chromatic sums by surface, with their total; then that as wavefront coefficients.
pub fn seidel_sums(name: TableName, system: &System) -> Result<Table> {
    let surfaces = seidel(system)?;
    let row = |label: Value, sums: Option<Seidel>| {
        let mut row = vec![label];
        match sums {
            Some(s) => {
                row.extend(s.sums_mm.iter().chain(&s.colour_mm).map(|mm| number(1e3 * mm)));
                row.extend(s.waves(system.primary_um()).map(number));
            }
            None => row.extend(std::iter::repeat_n(Value::Null, 12)),
        }
        row
    };
    let mut rows: Vec<Vec<Value>> =
        surfaces.iter().enumerate().map(|(i, s)| row(json!((i + 1).to_string()), *s)).collect();
    rows.push(row(json!("total"), total(&surfaces)));
    let columns = [
        "surface",
        "s1_um",
        "s2_um",
        "s3_um",
        "s4_um",
        "s5_um",
        "c1_um",
        "c2_um",
        "w040_waves",
        "w131_waves",
        "w222_waves",
        "w220_waves",
        "w311_waves",
    ];
    Ok(Table::new(name, &columns, rows))
}

/// The paraxial marginal and chief ray at each surface, the film the last.
pub fn rays(name: TableName, system: &System) -> Result<Table> {
    let all = paraxial_rays(system, system.primary_um())?;
    let row = |(i, r): (usize, &pipeline::design::paraxial_rays::ParaxialRays)| {
        let both = [r.marginal, r.chief];
        let mut row = vec![json!(i + 1), number(r.index_before), number(r.index)];
        row.extend(both.iter().flat_map(|p| [p.height_mm, p.slope, p.invariant].map(number)));
        row.push(number(r.lagrange_mm()));
        row
    };
    let columns = [
        "surface",
        "index_before",
        "index_behind",
        "marginal_height_mm",
        "marginal_slope_behind",
        "marginal_refraction_invariant",
        "chief_height_mm",
        "chief_slope_behind",
        "chief_refraction_invariant",
        "lagrange_invariant_mm",
    ];
    Ok(Table::new(name, &columns, all.iter().enumerate().map(row).collect()))
}
