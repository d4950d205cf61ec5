//! Tables of real rays: marginal and chief rays by surface, field curvature, spots.

use super::request::{Request, number, places, tracers};
use super::table::Table;
use crate::args::TableName;
use anyhow::Result;
use pipeline::design::System;
use pipeline::design::field_curvature::foci;
use pipeline::design::pattern_spot::{PatternSpot, pattern_spot, weighted_tracers};
use pipeline::design::ray::Tracer;
use serde_json::{Value, json};

/// Meridional rays at the primary wavelength through the top, the middle and the bottom of the pupil by height and surface.
pub fn real_rays(name: TableName, system: &System, request: &Request<'_>) -> Result<Table> {
    let tracer = Tracer::new(system, system.primary_um())?;
    let mut rows = Vec::new();
    for mm in request.heights_mm {
        let Ok(tan) = tracer.field_of_height(*mm) else { continue };
        for p in [-1.0, 0.0, 1.0] {
            // A ray beyond the rim may end at a surface.
            let Ok(points) = tracer.meridional_ray(tan, p) else { continue };
            for (i, [z, x, sine]) in points.into_iter().enumerate() {
                let passes = tracer.passes(tan, p, 0.0);
                rows.push(vec![
                    number(*mm),
                    number(p),
                    json!(passes),
                    json!(i + 1),
                    number(x),
                    number(z),
                    number(sine.asin().to_degrees()),
                ]);
            }
        }
    }
    let columns = ["image_height_mm", "pupil", "passes", "surface", "x_mm", "z_mm", "angle_before_deg"];
    Ok(Table::new(name, &columns, rows))
}

/// Tangential and sagittal focus by wavelength and height, from the film.
pub fn curvature(name: TableName, system: &System, request: &Request<'_>) -> Result<Table> {
    let tracers = tracers(system, request)?;
    let row = |(nm, mm, tracer, tan): (f64, f64, &Tracer<'_>, f64)| {
        let foci = foci(tracer, tan).ok()?;
        let astigmatism = foci.tangential_mm - foci.sagittal_mm;
        Some([nm, mm, foci.tangential_mm, foci.sagittal_mm, astigmatism].map(number).to_vec())
    };
    let rows = places(&tracers, request).into_iter().filter_map(row).collect();
    let columns =
        ["wavelength_nm", "image_height_mm", "tangential_focus_mm", "sagittal_focus_mm", "astigmatism_mm"];
    Ok(Table::new(name, &columns, rows))
}

/// Spots on the hexapolar pattern: by wavelength about its own chief ray, and of all wavelengths of the design by weight about that of the primary
/// wavelength, whose `wavelength_nm` is null.
pub fn spots(name: TableName, system: &System, request: &Request<'_>) -> Result<Table> {
    let row = |nm: Value, mm: f64, s: &PatternSpot| {
        let radii = [s.rms_um, s.geo_um, s.rms_chief_um, s.geo_chief_um, s.centroid_um];
        let mut row = vec![nm, number(mm)];
        row.extend(radii.map(number));
        row.push(json!(s.rays));
        row
    };
    let mut rows = Vec::new();
    for (nm, tracer) in tracers(system, request)? {
        let one = [(tracer, 1.0)];
        for mm in request.heights_mm {
            let spot = one[0]
                .0
                .field_of_height(*mm)
                .and_then(|tan| pattern_spot(&one, tan, usize::from(request.args.rings), *mm));
            rows.extend(spot.ok().map(|s| row(json!(nm), *mm, &s)));
        }
    }
    let (primary, weighted) = (Tracer::new(system, system.primary_um())?, weighted_tracers(system)?);
    for mm in request.heights_mm {
        let tan = primary.field_of_height(*mm);
        let spot = tan.and_then(|tan| pattern_spot(&weighted, tan, usize::from(request.args.rings), *mm));
        rows.extend(spot.ok().map(|s| row(Value::Null, *mm, &s)));
    }
    let columns = [
        "wavelength_nm",
        "image_height_mm",
        "rms_um",
        "geo_um",
        "rms_about_chief_um",
        "geo_about_chief_um",
        "centroid_from_chief_um",
        "rays",
    ];
    Ok(Table::new(name, &columns, rows))
}
