//! The table of ghosts of `lenscube lens light`.

use crate::args::LightArgs;
use crate::design;
use crate::job::ghosts::path_name;
use crate::progress::{log_line, print};
use anyhow::Result;
use pipeline::design::System;
use pipeline::design::ghost::first_order::FirstOrder;
use pipeline::design::ghost::options::GhostOptions;
use pipeline::design::ghost::report::PathFigures;
use pipeline::design::ghost::table::{GhostTable, ghost_table};
use pipeline::design::ray::Tracer;
use serde_json::{Value, json};

/// The sum of the ghosts from which on four reflections are worth a note.
const MUCH: f64 = 0.05;

/// Ghosts at a wavelength.
pub struct Ghosts {
    /// The paths, the largest share on the axis first.
    pub paths: Vec<PathFigures>,
    /// First-order figures of each path of a design; none of a pack.
    pub first_order: Vec<FirstOrder>,
    /// Width of a ring, mm.
    pub ring_mm: f64,
    /// Height of the film's corner, mm.
    pub corner_mm: f64,
    /// The wavelength, nm.
    pub nm: f64,
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
    Ok(Some(Ghosts {
        paths: table.paths.iter().map(|p| p.figures(system.image())).collect(),
        first_order: table.paths.iter().map(|p| p.first_order).collect(),
        ring_mm: table.ring_mm,
        corner_mm,
        nm,
    }))
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
    pub fn json(&self) -> Value {
        let path = |(k, p): (usize, &PathFigures)| {
            let mut first_order = json!({
                "height_per_pupil_height": p.height_per_pupil,
                "height_per_tan_mm": p.height_per_tan,
            });
            if let Some(of_path) = self.first_order.get(k) {
                first_order["share"] = of_path.share.into();
                first_order["diameter_mm"] = (2.0 * of_path.blob_mm).into();
            }
            json!({
                "path": path_name(p.surfaces),
                "share_on_axis": p.axis_share,
                "share_at_half_field": p.half_share,
                "density_per_mm2": finite(p.density()),
                "diameter_mm": p.diameter_mm,
                "diameter_rings": p.diameter_mm / self.ring_mm,
                "first_order": first_order,
            })
        };
        let sum = |share: fn(&PathFigures) -> f64| -> f64 { self.paths.iter().map(share).sum() };
        json!({
            "wavelength_nm": self.nm,
            "film_corner_mm": self.corner_mm,
            "ring_mm": self.ring_mm,
            "share_on_axis": sum(|p| p.axis_share),
            "share_at_half_field": sum(|p| p.half_share),
            "paths": self.paths.iter().enumerate().map(path).collect::<Vec<_>>(),
        })
    }

    /// As text.
    pub fn print(&self) {
        let Self { paths, ring_mm, corner_mm, nm, .. } = self;
        let sum = |share: fn(&PathFigures) -> f64| -> f64 { 100.0 * paths.iter().map(share).sum::<f64>() };
        print(format!(
            "\nghosts at {nm:.1} nm: {} paths of two reflections; light over that of the image on the axis: from the axis {:.4} %, from half of the field {:.4} %",
            paths.len(),
            sum(|p| p.axis_share),
            sum(|p| p.half_share)
        ));
        print(format!(
            "light of a small source on the axis lands on a disc (of the same spread); rings of {ring_mm:.3} mm to {corner_mm:.2} mm"
        ));
        print("    path      axis   half field   per mm2    disc mm   rings".to_owned());
        for p in paths {
            let (axis, half) = (100.0 * p.axis_share, 100.0 * p.half_share);
            let density = finite(p.density()).map_or("       -".to_owned(), |d| format!("{d:8.1e}"));
            print(format!(
                "{:>8}  {axis:.1e} %  {half:.1e} %   {density}  {:9.3}  {:6.1}",
                path_name(p.surfaces),
                p.diameter_mm,
                p.diameter_mm / ring_mm
            ));
        }
    }
}

fn finite(value: f64) -> Option<f64> {
    Some(value).filter(|v| v.is_finite())
}
