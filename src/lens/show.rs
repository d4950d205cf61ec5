//! `lenscube lens show`: a lens in numbers.
//!
//! A design: its system data, then its figures traced at its own wavelengths. A pack: what it holds, then the figures that its
//! tables and PSFs give; RMS is then that of the PSF inside its window, and GEO needs rays.

use super::cache;
use super::look::{Figures, Look, Subject};
use super::{plots, turning_error};
use crate::args::ShowArgs;
use crate::design;
use crate::failure::usage;
use crate::progress::print;
use crate::trace::{bytes_of, heights, wavelengths};
use anyhow::Result;
use formats::lens::summary;
use pipeline::design::ray::Tracer;
use pipeline::design::spots::polychromatic_spot;
use pipeline::design::{Description, System};
use serde_json::{Value, json};

/// Bands of a pack that are shown unless more are asked for.
const FEW: usize = 5;
/// Heights shown, as shares of the reach.
const SHARES: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// Runs the command.
pub fn command(args: &ShowArgs) -> Result<()> {
    let subject = Subject::open(&args.lens, &args.design)?;
    let nm = match &args.wavelengths {
        Some(text) => wavelengths(text)?,
        None => few(&subject.wavelengths_nm(), subject.primary_nm(), args.all_bands),
    };
    let at = chosen_heights(args.heights.as_deref(), || subject.reach_mm())?;
    let look = subject.look(&nm, &at)?;
    match args.json {
        true => print(serde_json::to_string_pretty(&as_json(&subject, &look, args)?)?),
        false => print(words(&subject, &look, args)?.trim_end()),
    }
    match &args.plot {
        Some(dir) => plots::write(dir, &subject, &nm, &at, &args.lp_mm, args.style.into()),
        None => Ok(()),
    }
}

/// `--heights`, ascending, or [`SHARES`] of the reach.
pub fn chosen_heights(asked: Option<&str>, reach_mm: impl FnOnce() -> Result<f64>) -> Result<Vec<f64>> {
    let mut at = match asked {
        Some(text) => heights(text)?,
        None => {
            let reach = reach_mm()?;
            SHARES.map(|s| s * reach).to_vec()
        }
    };
    at.sort_by(f64::total_cmp);
    at.dedup();
    match at.last() {
        Some(last) if *last > 0.0 => Ok(at),
        _ => Err(usage("--heights: give at least one height above 0 mm")),
    }
}

/// All wavelengths, or a few of them spread evenly with the one nearest the primary.
fn few(all: &[f64], primary_nm: f64, every: bool) -> Vec<f64> {
    if every || all.len() <= FEW {
        return all.to_vec();
    }
    let mut chosen: Vec<f64> =
        (0..FEW).map(|i| all[(i * (all.len() - 1) + (FEW - 1) / 2) / (FEW - 1)]).collect();
    let off = |nm: &f64| (nm - primary_nm).abs();
    let nearest = all.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(primary_nm);
    // It takes the place of the nearest that is not an end.
    if !chosen.contains(&nearest) {
        let inner =
            (1..FEW - 1).min_by(|&a, &b| (chosen[a] - nearest).abs().total_cmp(&(chosen[b] - nearest).abs()));
        inner.into_iter().for_each(|i| chosen[i] = nearest);
    }
    chosen
}

fn figures(look: &Look) -> Vec<Figures> {
    let of = |b: usize| (0..look.fields[b].len()).map(move |k| look.figures(b, k));
    (0..look.fields.len()).flat_map(of).collect()
}

fn as_json(subject: &Subject, look: &Look, args: &ShowArgs) -> Result<Value> {
    let fields: Vec<Value> = figures(look).iter().map(Figures::json).collect();
    Ok(match subject {
        Subject::Pack(pack) => {
            let mut value = serde_json::to_value(summary(pack, args.all_bands, turning_error(pack)?))?;
            value["rms_is"] = json!("of the PSF inside its window");
            value["fields"] = Value::Array(fields);
            value
        }
        Subject::Design(system, d) => {
            let rms = "geometric, about the centroid";
            let spots: Vec<Value> = spots(system, look)?
                .iter()
                .map(|(mm, rms, geo)| json!({ "image_height_mm": mm, "rms_um": rms, "geo_um": geo }))
                .collect();
            json!({ "design": design_json(d), "rms_is": rms, "fields": fields, "polychromatic_spots": spots })
        }
    })
}

/// System data under the names a designer expects, with units.
fn design_figures(d: &Description) -> [(&'static str, Value, &'static str); 19] {
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
        ("entrance pupil position", json!(d.entrance_pupil_position_mm), "mm"),
        ("entrance pupil diameter", json!(d.entrance_pupil_diameter_mm), "mm"),
        ("exit pupil position", json!(d.exit_pupil_position_mm), "mm"),
        ("exit pupil diameter", json!(d.exit_pupil_diameter_mm), "mm"),
        ("stop radius", json!(d.stop_radius_mm), "mm"),
        ("paraxial image height", json!(d.paraxial_image_height_mm), "mm"),
        ("maximum field", json!(d.maximum_field_deg), "deg"),
        ("angular magnification", json!(d.angular_magnification), ""),
        ("magnification", json!(d.magnification), ""),
        ("object distance", json!(d.object_distance_mm), "mm"),
    ]
}

fn design_json(d: &Description) -> Value {
    let mut map = serde_json::Map::new();
    map.insert("name".into(), json!(d.name));
    map.insert("primary_wavelength_nm".into(), json!(d.primary_wavelength_nm));
    for (name, value, unit) in design_figures(d) {
        let unit = if unit.is_empty() { String::new() } else { format!("_{unit}") };
        map.insert(format!("{}{unit}", name.replace([' ', '-'], "_").to_lowercase()), value);
    }
    Value::Object(map)
}

fn words(subject: &Subject, look: &Look, args: &ShowArgs) -> Result<String> {
    let mut out = match subject {
        Subject::Pack(pack) => format!("{}\n", summary(pack, args.all_bands, turning_error(pack)?)),
        Subject::Design(system, d) => {
            let mut out = design_words(&args.lens, d);
            for note in &system.notes {
                out += &format!("note: {note}\n");
            }
            if args.lens == design::BUILTIN {
                out += &cached();
            }
            out + "\n"
        }
    };
    let rms = match subject {
        Subject::Design(..) => "RMS and GEO: radius of the spot of rays about its centroid",
        Subject::Pack(_) => "RMS: radius of the PSF about its centroid, inside its window",
    };
    out += &format!(
        "Distortion of f tan w, f = {:.6} mm (distortion focal length, {} nm); lateral colour from {} nm.\n{rms}; \
         Strehl at the chief ray.\n\n",
        look.lens.distortion_focal_length_mm, look.lens.primary_wavelength_nm, look.primary.wavelength_nm,
    );
    out += "     nm  height mm  field deg        RI  distortion %  lateral um   RMS um   GEO um  Strehl  window um  light %\n";
    let known = |v: Option<f64>, digits: usize| v.map_or("-".into(), |v| format!("{v:.digits$}"));
    for f in figures(look) {
        let tan = f.ideal_height_mm / look.lens.distortion_focal_length_mm;
        let degrees = look.lens.object_distance_mm.is_none().then(|| tan.atan().to_degrees());
        out += &format!(
            "{:7.2}  {:9.4}  {:>9}  {:8.5}  {:12.4}  {:10.3}  {:7.3}  {:>7}  {:>6}  {:9.1}  {:7.2}\n",
            f.wavelength_nm,
            f.height_mm,
            known(degrees, 4),
            f.illumination,
            f.distortion_percent,
            f.lateral_colour_um,
            f.rms_um,
            known(f.geo_um, 3),
            known(f.strehl, 4),
            f.window_um,
            100.0 * f.energy,
        );
    }
    if let Subject::Design(system, _) = subject {
        out += &format!(
            "\nSpots of all the design's wavelengths by weight, {RINGS} rings of rays, about the centroid\n"
        );
        for (mm, rms, geo) in spots(system, look)? {
            out += &format!("{mm:9.4} mm   RMS {rms:.3} um   GEO {geo:.3} um\n");
        }
    }
    Ok(out)
}

/// Rings of rays of the polychromatic spots: the design programs' default.
const RINGS: usize = 6;

/// Height at the primary wavelength, RMS and GEO radius.
fn spots(system: &System, look: &Look) -> Result<Vec<(f64, f64, f64)>> {
    let tracer = Tracer::new(system, system.primary_um())?;
    let at = look.fields.first().into_iter().flatten();
    at.map(|f| {
        let (rms, geo) = polychromatic_spot(system, tracer.field_of_height(f.height_mm)?, RINGS)?;
        Ok((f.height_mm, rms, geo))
    })
    .collect()
}

fn design_words(name: &str, d: &Description) -> String {
    let mut out = format!("{}  ({name}, a design; figures at {} nm)\n", d.name, d.primary_wavelength_nm);
    for (name, value, unit) in design_figures(d) {
        let value = match value.as_f64() {
            Some(v) => format!("{v:.6}"),
            None if name == "object distance" => "infinity".into(),
            // JSON has no word for it: a pupil at infinity.
            None => "infinite".into(),
        };
        out += &format!("{name:<26} {value:>14} {unit}\n");
    }
    out + "Entrance pupil from the first surface, exit pupil from the film; working F-number and NA by real rays.\n"
}

/// The built-in lens as a pack: what of it has been traced so far.
fn cached() -> String {
    let Some(dir) = cache::directory() else { return String::new() };
    let entries = std::fs::read_dir(&dir).map_or(0, |d| d.flatten().count());
    format!(
        "As a pack: `run` traces the bands that a chart asks for and keeps them; so far {entries} of all designs, {:.0} MB, in {}\n",
        bytes_of(&dir) as f64 * 1e-6,
        dir.display()
    )
}
