//! `lenscube lens light`: what a lens leaves of the light.

use super::trace::wavelengths;
use super::{ghosts, pack_light};
use crate::args::{CoatingsArg, LightArgs};
use crate::design;
use crate::open;
use crate::progress::{log_line, print};
use anyhow::{Context, Result};
use pipeline::design::System;
use pipeline::design::describe::field_tan;
use pipeline::design::light::{LightFigures, SurfaceLight, light_figures, surface_light};
use pipeline::design::paraxial::Paraxial;
use serde_json::json;

/// Runs the command.
pub fn command(args: &LightArgs) -> Result<()> {
    if !design::is_design(&args.lens) {
        return pack_light::show(args, &open::lens(&args.lens)?);
    }
    let system = design::open(&args.lens, &args.parameters)?;
    let wavelengths_nm = match &args.wavelengths {
        Some(text) => wavelengths(text)?,
        None => {
            let mut nm: Vec<f64> = system.wavelengths_um.iter().map(|(um, _)| um * 1e3).collect();
            nm.sort_by(f64::total_cmp);
            nm.dedup();
            nm
        }
    };
    let light = || format!("light of {}", args.lens);
    let (edge_tan, edge_deg) = edge(&system).with_context(light)?;
    let figures: Vec<LightFigures> = wavelengths_nm
        .iter()
        .map(|nm| light_figures(&system, *nm, edge_tan))
        .collect::<Result<_, _>>()
        .with_context(light)?;
    let surfaces = surface_light(&system, system.primary_um() * 1e3).with_context(light)?;
    let ghosts = ghosts::of_design(args, &system, edge_tan).with_context(light)?;
    system.notes.iter().for_each(|note| log_line(format!("note: {note}")));
    match args.json {
        true => print(serde_json::to_string_pretty(&json!({
            "name": system.name,
            "coatings": args.parameters.coatings.to_string(),
            "edge_field_tan": edge_tan,
            "bands": figures.iter().map(band).collect::<Vec<_>>(),
            "surfaces": surfaces.iter().map(surface).collect::<Vec<_>>(),
            "ghosts": ghosts.as_ref().map(ghosts::Ghosts::json),
        }))?),
        false => {
            text(args, &system, edge_deg, &figures, &surfaces);
            ghosts.iter().for_each(ghosts::Ghosts::print);
        }
    }
    Ok(())
}

/// Tangent of the largest field of the design and its angle in degrees.
fn edge(system: &System) -> Result<(f64, f64)> {
    let first = Paraxial::new(system, system.primary_um())?;
    let largest = system.fields.iter().fold(0.0_f64, |a, f| a.max(f.abs()));
    let tan = field_tan(system, &first, largest).abs();
    Ok((tan, tan.atan().to_degrees()))
}

fn band(f: &LightFigures) -> serde_json::Value {
    json!({
        "wavelength_nm": f.wavelength_nm,
        "transmission": f.transmission,
        "transmission_of_surfaces": f.surfaces,
        "transmission_of_glass": f.transmission / f.surfaces,
        "edge_illumination_ratio": f.edge_ratio,
    })
}

fn surface(s: &SurfaceLight) -> serde_json::Value {
    json!({
        "surface": s.number,
        "index_before": s.indices.0,
        "index_behind": s.indices.1,
        "coating": s.coating,
        "reflectance": s.reflectance,
        "transmittance": s.transmittance,
    })
}

fn text(
    args: &LightArgs,
    system: &System,
    edge_deg: f64,
    figures: &[LightFigures],
    surfaces: &[SurfaceLight],
) {
    let coatings = &args.parameters.coatings;
    print(format!("{}, coatings {coatings}", system.name));
    if *coatings == CoatingsArg::Ideal {
        print(
            "nothing is lost in an ideal lens; --coatings none, mgf2, design or a file shows what its surfaces and glasses take",
        );
    }
    print(format!(
        "\ntransmission on the axis (mean over the pupil), and the fall-off that losses add at {edge_deg:.1} deg"
    ));
    print("    nm   total  surfaces   glass   edge over axis");
    for f in figures {
        let LightFigures { wavelength_nm, transmission, surfaces, edge_ratio } = f;
        // A ratio of nothing to nothing where no light passes.
        let ratio = |v: f64| if v.is_finite() { format!("{v:.4}") } else { "-".to_owned() };
        let (glass, edge) = (ratio(transmission / surfaces), ratio(*edge_ratio));
        print(format!("{wavelength_nm:6.1}  {transmission:6.4}    {surfaces:6.4}  {glass:>6}  {edge:>15}"));
    }
    print(format!("\nsurfaces at {:.1} nm, normal incidence", system.primary_um() * 1e3));
    print(" surface   n before   n behind   coating        reflected   transmitted");
    for s in surfaces {
        let (before, behind) = s.indices;
        let (r, t) = (100.0 * s.reflectance, 100.0 * s.transmittance);
        print(format!(
            "{:8}  {before:9.5}  {behind:9.5}   {:<12}  {r:8.3} %  {t:10.3} %",
            s.number, s.coating
        ));
    }
}
