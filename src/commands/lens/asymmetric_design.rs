//! `lens show` of a design without rotational symmetry: first-order data and the places of its surfaces.
//!
//! Focal length of the ideal plane: √|det ∂(X, Y)/∂(tx, −ty)| of the chief ray at the film's centre; effective focal length and F-number are
//! those of the straightened lens. Places: vertex, mm, and normal of each surface in the frame of the first surface (x right, y up, z along the light).

use super::asymmetric::refuse;
use crate::args::ShowArgs;
use crate::progress::{number, print, short_number};
use anyhow::Result;
use pipeline::design::System;
use pipeline::design::asymmetry::{Form, FreeSurface, Outline};
use pipeline::design::skew::grid::GridTrace;
use pipeline::design::skew::map::FilmRange;
use pipeline::design::skew::system::BuiltLens;
use pipeline::design::trace::TraceOptions;
use pipeline::lens::Lens;
use serde_json::{Value, json};

/// Prints the design.
///
/// # Errors
/// Flags that need image heights; a film that no chief ray reaches; the output is closed.
pub fn show(args: &ShowArgs, system: &System) -> Result<()> {
    let way_out = "; `lenscube lens trace` makes a pack of it over a film, which has figures";
    refuse(args, &[("--plot", args.plot.is_some())], way_out)?;
    let lens = BuiltLens::of_design(system)?;
    let options = TraceOptions::new(vec![system.primary_um() * 1e3], 1e-3);
    let header = GridTrace::new(&lens, &options, FilmRange::centred([1e-3; 2]))?.header()?;
    let surfaces = system.asymmetry.iter().flat_map(|a| &a.surfaces);
    let rows: Vec<(usize, &FreeSurface)> = surfaces.enumerate().map(|(i, s)| (i + 1, s)).collect();
    match args.json {
        true => print(serde_json::to_string_pretty(&json_of(system, &header, &rows))?),
        false => print(text(system, &header, &rows).trim_end()),
    }
    Ok(())
}

/// Kind of a surface.
fn kind(system: &System, (i, s): (usize, &FreeSurface)) -> &'static str {
    let shape = &s.shape;
    match &shape.along_y {
        _ if s.is_frame => "coordinate break",
        _ if i == system.surfaces.len() => "film",
        Some(y) if y.swept_mm.is_some() => "toroid",
        Some(_) => "biconic",
        None if !shape.xy.is_empty() => "XY polynomial",
        None if shape.base.is_aspheric() => "asphere",
        None if shape.base.conic != 0.0 => "conic",
        None if shape.base.curvature != 0.0 => "sphere",
        None => "plane",
    }
}

fn normal(s: &FreeSurface) -> [f64; 3] {
    s.pose.rotation.map(|row| row[2])
}

fn outline_json(outline: &Outline) -> Value {
    let form = if outline.form == Form::Rectangle { "rectangle" } else { "ellipse" };
    json!({"form": form, "half_mm": outline.half_mm, "centre_mm": outline.centre_mm})
}

fn json_of(system: &System, header: &Lens, rows: &[(usize, &FreeSurface)]) -> Value {
    let surface = |&(i, s): &(usize, &FreeSurface)| {
        json!({
            "surface": i,
            "kind": kind(system, (i, s)),
            "is_stop": i == system.stop + 1,
            "is_mirror": system.surfaces[i - 1].is_mirror,
            "vertex_mm": s.pose.origin_mm,
            "normal": normal(s),
            "aperture": s.aperture.as_ref().map(outline_json),
            "obscuration": s.obscuration.as_ref().map(outline_json),
        })
    };
    json!({
        "name": system.name,
        "rotational_symmetry": false,
        "distortion_focal_length_mm": header.distortion_focal_length_mm,
        "straightened": {
            "effective_focal_length_mm": header.effective_focal_length_mm,
            "f_number": header.f_number,
        },
        "object_distance_mm": header.object_distance_mm,
        "primary_wavelength_nm": header.primary_wavelength_nm,
        "surfaces": rows.iter().map(surface).collect::<Vec<_>>(),
        "notes": system.notes,
    })
}

fn text(system: &System, header: &Lens, rows: &[(usize, &FreeSurface)]) -> String {
    let object = header.object_distance_mm.map_or("infinity".to_owned(), |mm| format!("{} mm", number(mm)));
    let mut out = format!(
        "{}\nno rotational symmetry: traced over the area of a film (`lenscube run`, `plan`, `lens trace`)\n\
         focal length             {} mm, of the chief rays at the film's centre, {} nm\n\
         of the straightened lens effective focal length {} mm, f/{}\n\
         object at                {object}\n\n\
         surface  kind              vertex x, y, z, mm                   normal x, y, z\n",
        system.name,
        short_number(header.distortion_focal_length_mm),
        number(header.primary_wavelength_nm),
        short_number(header.effective_focal_length_mm),
        short_number(header.f_number),
    );
    for &(i, s) in rows {
        let mut kind = kind(system, (i, s)).to_owned();
        if system.surfaces[i - 1].is_mirror {
            kind = format!("{kind} mirror");
        }
        if i == system.stop + 1 {
            kind = format!("{kind}, stop");
        }
        let three = |v: [f64; 3], digits: usize| {
            // Not −0.
            v.map(|v| format!("{:>11.digits$}", v + 0.0)).join(" ")
        };
        out.push_str(&format!("{i:>7}  {kind:<16} {} {}\n", three(s.pose.origin_mm, 4), three(normal(s), 6)));
    }
    for note in &system.notes {
        out.push_str(&format!("note: {note}\n"));
    }
    out
}
