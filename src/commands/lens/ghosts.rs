//! The table of ghosts of `lenscube lens light`.

use crate::args::LightArgs;
use crate::design;
use crate::job::ghosts::path_name;
use crate::progress::{log_line, print};
use anyhow::Result;
use pipeline::design::System;
use pipeline::design::ghost::options::GhostOptions;
use pipeline::design::ghost::report::PathReport;
use pipeline::design::ghost::table::{GhostTable, ghost_table};
use pipeline::design::ray::Tracer;
use serde_json::{Value, json};

/// The sum of the ghosts from which on four reflections are worth a note.
const MUCH: f64 = 0.05;

/// Ghosts of a design at its primary wavelength.
pub struct Ghosts {
    table: GhostTable,
    corner_mm: f64,
    nm: f64,
}

/// Those of `system`, for a film to the field of the tangent `edge_tan`; none of a lens with ideal coatings, which reflects nothing.
///
/// # Errors
/// A reflectance of the film with ideal coatings, or that cannot be read; an error of tracing.
pub fn of_design(args: &LightArgs, system: &System, edge_tan: f64) -> Result<Option<Ghosts>> {
    let film_reflectance = design::reflectance(&args.sensor_reflectance)?;
    if system.surfaces.iter().all(|s| s.coating.is_none()) {
        return match film_reflectance.is_zero() {
            true => Ok(None),
            false => Err(crate::failure::usage(
                "--sensor-reflectance: a lens with ideal coatings reflects nothing back to the film; choose its coatings (--coatings none, mgf2, design or a file)",
            )),
        };
    }
    let nm = system.primary_um() * 1e3;
    let tracer = Tracer::new(system, system.primary_um())?;
    // A design of the axis alone: its ghosts over a hundredth of the focal length.
    let corner_mm = match edge_tan > 0.0 {
        true => tracer.chief_height_mm(edge_tan)?.abs(),
        false => 0.01 * tracer.ideal_scale_mm(),
    };
    let options = GhostOptions { corner_mm, rings: args.ghost_rings, film_reflectance };
    let table = ghost_table(system, nm, &options)?;
    if table.paths.iter().any(|p| !p.axis.share.is_finite()) {
        log_line("note: no light of the image reaches the film on the axis: ghosts have no shares of it");
        return Ok(None);
    }
    notes(&table);
    Ok(Some(Ghosts { table, corner_mm, nm }))
}

fn notes(table: &GhostTable) {
    if !table.radii_of_rays.is_empty() {
        let surfaces: Vec<String> = table.radii_of_rays.iter().map(|k| (k + 1).to_string()).collect();
        log_line(format!(
            "note: clear radii of surfaces {} are not in the design: ghosts are clipped where the image's rays end",
            surfaces.join(", ")
        ));
    }
    if table.across_mirrors > 0 {
        log_line(format!(
            "note: {} ghosts between whose reflections a mirror lies are left out",
            table.across_mirrors
        ));
    }
    let sum: f64 = table.paths.iter().map(|p| p.axis.share).sum();
    if sum > MUCH {
        log_line(format!(
            "note: with ghosts of {:.1} % of the image, four reflections and more, which are left out, have up to {:.2} %",
            100.0 * sum,
            250.0 * sum * sum
        ));
    }
}

impl Ghosts {
    /// As JSON.
    pub fn json(&self, system: &System) -> Value {
        let path = |p: &PathReport| {
            json!({
                "path": path_name(p.path, system.image()),
                "share_on_axis": p.axis.share,
                "share_at_half_field": p.half.share,
                "density_per_mm2": finite(p.axis.density()),
                "diameter_mm": p.axis.diameter_mm(),
                "diameter_rings": p.axis.diameter_mm() / self.table.ring_mm,
                "first_order": {
                    "share": p.first_order.share,
                    "diameter_mm": 2.0 * p.first_order.blob_mm,
                    "height_per_pupil_height": p.first_order.height_per_pupil,
                    "height_per_tan_mm": p.first_order.height_per_tan,
                },
            })
        };
        let sum = |share: fn(&PathReport) -> f64| -> f64 { self.table.paths.iter().map(share).sum() };
        json!({
            "wavelength_nm": self.nm,
            "film_corner_mm": self.corner_mm,
            "ring_mm": self.table.ring_mm,
            "share_on_axis": sum(|p| p.axis.share),
            "share_at_half_field": sum(|p| p.half.share),
            "paths": self.table.paths.iter().map(path).collect::<Vec<_>>(),
        })
    }

    /// As text.
    pub fn print(&self, system: &System) {
        let Self { table, corner_mm, nm } = self;
        let sum =
            |share: fn(&PathReport) -> f64| -> f64 { 100.0 * table.paths.iter().map(share).sum::<f64>() };
        print(format!(
            "\nghosts at {nm:.1} nm: {} paths of two reflections; light over that of the image on the axis: from the axis {:.4} %, from half of the field {:.4} %",
            table.paths.len(),
            sum(|p| p.axis.share),
            sum(|p| p.half.share)
        ));
        print(format!(
            "light of a small source on the axis lands on a disc (of the same spread); rings of {:.3} mm to {corner_mm:.2} mm",
            table.ring_mm
        ));
        print("    path      axis   half field   per mm2    disc mm   rings".to_owned());
        for p in &table.paths {
            let (axis, half) = (100.0 * p.axis.share, 100.0 * p.half.share);
            let density = finite(p.axis.density()).map_or("       -".to_owned(), |d| format!("{d:8.1e}"));
            let diameter = p.axis.diameter_mm();
            print(format!(
                "{:>8}  {axis:.1e} %  {half:.1e} %   {density}  {diameter:9.3}  {:6.1}",
                path_name(p.path, system.image()),
                diameter / table.ring_mm
            ));
        }
    }
}

fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|v| v.is_finite())
}
