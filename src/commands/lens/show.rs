//! `lenscube lens show`: prints the data of a lens; its tables as JSON and CSV are those of [`super::tables`].
//!
//! Of a design: system data, then figures traced at the wavelengths of the design. Of a pack: a summary of its arrays, then figures
//! of its tables and PSFs; RMS is then the radius of the PSF inside its window, and GEO, which needs rays, is not available.

use super::asymmetric;
use super::asymmetric_design;
use super::plots;
use super::shown::Shown;
use super::tables::{self, Request, Table, csv_file, design_figures, design_json};
use crate::args::{ShowArgs, TableName};
use crate::commands::lens::trace::{heights, wavelengths};
use crate::design;
use crate::failure::usage;
use crate::job::lens::cache;
use crate::job::lens::rotation_error;
use crate::job::lens::samples::{FieldFigures, LensData, evenly_spaced, nearest};
use crate::open;
use crate::outputs::check_absent_in;
use crate::progress::{log_line, print};
use anyhow::Result;
use formats::design::builtin::BuiltinLens;
use formats::durable::{AtomicFile, create_directories, finish_together};
use formats::lens::summary;
use pipeline::design::pattern_spot::{PatternSpot, RINGS, pattern_spot, weighted_tracers};
use pipeline::design::ray::Tracer;
use pipeline::design::{Description, System};
use serde_json::{Value, json};
use std::path::Path;

/// Default number of bands shown.
const DEFAULT_BANDS: usize = 5;
/// Strehl ratio that is above 1 by more than the error of its figures.
const MAX_STREHL: f64 = 1.005;
/// Default heights, as shares of the reach.
const SHARES: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// Runs the command.
pub fn command(args: &ShowArgs) -> Result<()> {
    let lens = match design::is_design(&args.lens) {
        true => {
            let system = design::open(&args.lens, &args.design)?;
            if system.asymmetry.is_some() {
                return asymmetric_design::show(args, &system);
            }
            LensData::of_design(&args.lens, system)?
        }
        false => {
            let pack = open::lens(&args.lens)?;
            if !pack.lens().is_symmetric() {
                return asymmetric::show(args, pack);
            }
            LensData::of_pack(&args.lens, pack, &args.design)?
        }
    };
    if args.overwrite && args.plot.is_none() && args.csv.is_none() {
        return Err(usage("--overwrite replaces figures and tables: give --plot or --csv, too"));
    }
    if args.tables.is_some() && args.csv.is_none() && !args.json {
        return Err(usage("--tables chooses among the tables of --json and --csv: give one of them, too"));
    }
    if let Some(dir) = &args.plot {
        plots::check_absent(dir, &lens, args.overwrite)?;
    }
    let names = if args.json || args.csv.is_some() { tables::chosen(&lens, args)? } else { Vec::new() };
    if let Some(dir) = &args.csv {
        check_absent_in(dir, names.iter().map(|name| csv_file(Path::new(""), *name)), args.overwrite)?;
    }
    let nm = match &args.wavelengths {
        Some(text) => wavelengths(text)?,
        None if args.all_bands => lens.wavelengths_nm(),
        None => default_bands(&lens.wavelengths_nm(), lens.primary_nm()),
    };
    let heights_mm = chosen_heights(args.heights.as_deref(), || lens.reach_mm())?;
    let shown = Shown::new(&lens, &nm, &heights_mm)?;
    let request = Request { nm: &nm, heights_mm: &heights_mm, args };
    let tables: Vec<Table> =
        names.iter().map(|name| tables::table(*name, &lens, &shown, &request)).collect::<Result<_>>()?;
    if let Some(dir) = &args.csv {
        create_directories(dir, true)?;
        let file = |t: &Table| AtomicFile::with_text(&csv_file(dir, t.name), &t.csv());
        finish_together(tables.iter().map(file).collect::<Result<_, _>>()?)?;
        log_line(format!("{}: {} tables", dir.display(), tables.len()));
    }
    match args.json {
        true => {
            let mut value = json(&lens, &shown, &heights_mm, args)?;
            for table in tables {
                // What JSON has under its own key: `design` and `fields`.
                if !matches!(table.name, TableName::FirstOrder | TableName::Fields) {
                    let key = table.key();
                    value[key] = table.json();
                }
            }
            print(serde_json::to_string_pretty(&value)?);
        }
        false => print(text(&lens, &shown, &heights_mm, args)?.trim_end()),
    }
    match &args.plot {
        Some(dir) => plots::write(dir, &lens, &nm, &heights_mm, &args.lp_mm, args.style),
        None => Ok(()),
    }
}

/// `--heights`, ascending, or [`SHARES`] of the reach.
pub fn chosen_heights(requested: Option<&str>, reach_mm: impl FnOnce() -> Result<f64>) -> Result<Vec<f64>> {
    let mut heights_mm = match requested {
        Some(text) => heights(text)?,
        None => {
            let reach = reach_mm()?;
            SHARES.map(|s| s * reach).to_vec()
        }
    };
    heights_mm.sort_by(f64::total_cmp);
    heights_mm.dedup();
    Ok(heights_mm)
}

/// At most [`DEFAULT_BANDS`] wavelengths, evenly spaced, including the one nearest the primary wavelength.
fn default_bands(all: &[f64], primary_nm: f64) -> Vec<f64> {
    let mut chosen = evenly_spaced(all.len(), DEFAULT_BANDS);
    let primary = nearest(all.iter().copied(), primary_nm);
    // It replaces its neighbour among the chosen ones, but not the first or the last.
    if all.len() > DEFAULT_BANDS && !chosen.contains(&primary) {
        let inner = 1 + nearest(chosen[1..DEFAULT_BANDS - 1].iter().map(|&i| all[i]), all[primary]);
        chosen[inner] = primary;
    }
    chosen.into_iter().map(|i| all[i]).collect()
}

fn json(lens: &LensData, shown: &Shown, heights_mm: &[f64], args: &ShowArgs) -> Result<Value> {
    let fields: Vec<Value> = shown.fields.iter().map(FieldFigures::json).collect();
    Ok(match lens {
        LensData::Pack(pack) => {
            let mut value = serde_json::to_value(summary(pack, args.all_bands, rotation_error(pack)?))?;
            value["rms_is"] = json!("of the PSF inside its window");
            value["fields"] = Value::Array(fields);
            value
        }
        LensData::Design(system, d) => {
            let rms = "geometric, about the centroid";
            let spots: Vec<Value> = spots(system, heights_mm)?
                .iter()
                .map(|(mm, s)| json!({ "image_height_mm": mm, "rms_um": s.rms_um, "geo_um": s.geo_um }))
                .collect();
            json!({
                "design": design_json(d),
                "notes": system.notes,
                "rms_is": rms,
                "window_is": "estimated from rays and diffraction at the edge of the pupil",
                "fields": fields,
                "missing": shown.missing,
                "polychromatic_spots": spots,
            })
        }
    })
}

fn text(lens: &LensData, shown: &Shown, heights_mm: &[f64], args: &ShowArgs) -> Result<String> {
    let mut out = match lens {
        LensData::Pack(pack) => format!("{}\n", summary(pack, args.all_bands, rotation_error(pack)?)),
        LensData::Design(system, d) => {
            let mut out = design_text(&args.lens, d);
            for note in &system.notes {
                out += &format!("note: {note}\n");
            }
            if BuiltinLens::named(&args.lens).is_some() {
                out += &cache_text();
            }
            out + "\n"
        }
    };
    let (rms, window) = match lens {
        LensData::Design(..) => (
            "RMS and GEO: RMS and maximum radius of the spot of rays about its centroid",
            "window: side of the PSF window for 99 % of the light and light inside it, estimated from rays and edge diffraction;\n\
             angle: projected solid angle of the bundle at the film relative to the axis, equal to RI in perfect focus",
        ),
        LensData::Pack(_) => (
            "RMS: RMS radius of the PSF about its centroid, inside its window",
            "window: side of the PSF window; light: share of the light inside it",
        ),
    };
    out += &format!(
        "height: real image height; RI: relative illumination; distortion: relative to f tan w with f = {:.6} mm (distortion focal \
         length, {} nm);\nlateral: lateral colour relative to {} nm; {rms};\nStrehl: Strehl ratio at the chief ray; {window}.\n\n",
        shown.lens.distortion_focal_length_mm,
        tidy_nm(shown.lens.primary_wavelength_nm),
        tidy_nm(shown.primary_nm),
    );
    out += "     nm  height mm  field deg        RI    angle  distortion %  lateral µm   RMS µm   GEO µm  Strehl  window µm  light %\n";
    let optional = |v: Option<f64>, digits: usize| v.map_or("-".into(), |v| format!("{v:.digits$}"));
    for f in &shown.fields {
        let tan = f.ideal_height_mm / shown.lens.distortion_focal_length_mm;
        let degrees = shown.lens.object_distance_mm.is_none().then(|| tan.atan().to_degrees());
        out += &format!(
            "{:7.2}  {:9.4}  {:>9}  {:8.5}  {:>7}  {:12.4}  {:10.3}  {:7.3}  {:>7}  {:>6}  {:9.1}  {:7.2}\n",
            f.wavelength_nm,
            f.height_mm,
            optional(degrees, 4),
            f.illumination,
            optional(f.relative_projected_solid_angle, 5),
            f.distortion_percent,
            f.lateral_colour_um,
            f.rms_um,
            optional(f.geo_um, 3),
            optional(f.strehl, 4),
            f.window_um,
            100.0 * f.energy,
        );
    }
    for missing in &shown.missing {
        out += &format!("no figures of {missing}\n");
    }
    out += &strehl_note(&shown.fields);
    if let LensData::Design(system, _) = lens {
        out += &format!(
            "\nPolychromatic spots: all wavelengths of the design by weight, {RINGS} rings of rays, radius about the centroid\n"
        );
        for (mm, s) in spots(system, heights_mm)? {
            out += &format!("{mm:9.4} mm   RMS {:.3} µm   GEO {:.3} µm\n", s.rms_um, s.geo_um);
        }
    }
    Ok(out)
}

/// A line if a Strehl ratio exceeds 1.
pub fn strehl_note<'a>(fields: impl IntoIterator<Item = &'a FieldFigures>) -> String {
    let above = fields.into_iter().filter(|f| f.strehl.is_some_and(|s| s > MAX_STREHL)).count();
    match above {
        0 => String::new(),
        n => format!(
            "note: the Strehl ratio of {n} field points exceeds 1, which no lens has: PSF samples, solid angle and share of the light \
             in the window do not belong together\n"
        ),
    }
}

/// Polychromatic spots by height at the primary wavelength in mm, without field points whose rays do not reach the image.
fn spots(system: &System, heights_mm: &[f64]) -> Result<Vec<(f64, PatternSpot)>> {
    let tracer = Tracer::new(system, system.primary_um())?;
    let tracers = weighted_tracers(system)?;
    let spot =
        |mm: f64| Some((mm, pattern_spot(&tracers, tracer.field_of_height(mm).ok()?, RINGS, mm).ok()?));
    Ok(heights_mm.iter().filter_map(|mm| spot(*mm)).collect())
}

fn design_text(name: &str, d: &Description) -> String {
    let mut out =
        format!("{}  ({name}, a design; values at {} nm)\n", d.name, tidy_nm(d.primary_wavelength_nm));
    for (name, value, unit) in design_figures(d) {
        let value = match value.as_f64() {
            Some(v) => format!("{v:.6}"),
            None if name == "object distance" => "infinity".into(),
            // An infinite value is null in JSON: a pupil at infinity.
            None => "infinite".into(),
        };
        out += &format!("{name:<26} {value:>14} {unit}\n");
    }
    out + "Pupil positions: entrance pupil from the first surface, exit pupil from the film. Working F-number: from real rays.\n"
}

/// Without the digits of rounding: 587.5618 for 587.5618000000001.
fn tidy_nm(nm: f64) -> f64 {
    (nm * 1e6).round() / 1e6
}

/// Number and size of the entries of the cache.
fn cache_text() -> String {
    let Some(dir) = cache::directory() else { return String::new() };
    let Ok(all) = cache::entries::entries(&dir) else { return String::new() };
    format!(
        "`lenscube run` traces the bands of the chart and stores them in the cache: now {}, of all designs, in {}\n",
        cache::entries::described(&all),
        dir.display()
    )
}
