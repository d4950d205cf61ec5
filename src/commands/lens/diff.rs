//! `lenscube lens diff`: compares two lenses at the same wavelengths and REAL heights; where one has no rotational symmetry, at places of the
//! film ([`film_diff`]).
//!
//! PSFs are compared as film kernels at one pitch, each cropped to the smaller window and normalised there, by their L1 distance.
//! The sizes of the windows and the share of light inside them are listed separately.

use super::comparison::{common, scalars};
use super::film_diff;
use super::show::{chosen_heights, strehl_note};
use crate::args::DiffArgs;
use crate::commands::lens::trace::wavelengths;
use crate::design::is_design;
use crate::job::lens::samples::{FieldFigures, LensData, LensSamples, nearest_band};
use crate::open;
use crate::progress::{log_line, print};
use anyhow::Result;
use formats::lens::LensPack;
use pipeline::figures::kernel_l1;
use serde_json::{Value, json};

/// One field point of both lenses.
struct Pair {
    a: FieldFigures,
    b: FieldFigures,
    /// L1 distance of the film kernels.
    l1: f64,
}

/// Runs the command.
pub fn command(args: &DiffArgs) -> Result<()> {
    let sides = [pack(&args.a)?, pack(&args.b)?];
    if sides.iter().flatten().any(|pack| !pack.lens().is_symmetric()) {
        let [a, b] = sides;
        return film_diff::diff(args, (&args.a, a), (&args.b, b));
    }
    let [a, b] = sides;
    let (a, b) = (lens(&args.a, a, args)?, lens(&args.b, b, args)?);
    let nm = match &args.wavelengths {
        Some(text) => wavelengths(text)?,
        None => {
            let of = |lens: &LensData| matches!(lens, LensData::Pack(_)).then(|| lens.wavelengths_nm());
            // Of two designs, those of A.
            common([of(&a), of(&b)]).unwrap_or_else(|| Ok(a.wavelengths_nm()))?
        }
    };
    let heights_mm = chosen_heights(args.heights.as_deref(), || Ok(a.reach_mm()?.min(b.reach_mm()?)))?;
    let mut samples = (a.sample(&nm, &heights_mm)?, b.sample(&nm, &heights_mm)?);
    // Lateral colour of both relative to one wavelength, which both lenses have.
    let reference = nearest_band(&samples.0.lens.bands, samples.0.lens.primary_wavelength_nm);
    for lens in [&mut samples.0, &mut samples.1] {
        lens.primary = lens.lens.bands[reference].clone();
    }
    let pairs = pairs(&samples.0, &samples.1, args.film_pitch_um);
    match args.json {
        true => print(serde_json::to_string_pretty(&json(args, &samples, &pairs))?),
        false => print(text(args, (&a, &b), &samples, &pairs).trim_end()),
    }
    Ok(())
}

/// The lens pack `name`; none for a design.
fn pack(name: &str) -> Result<Option<LensPack>> {
    (!is_design(name)).then(|| open::lens(name)).transpose()
}

/// The lens `name`, `pack` if it is one; the design flags apply to designs only.
fn lens(name: &str, pack: Option<LensPack>, args: &DiffArgs) -> Result<LensData> {
    match pack {
        Some(pack) => Ok(LensData::Pack(Box::new(pack))),
        None => {
            let lens = LensData::open(name, &args.design)?;
            if let LensData::Design(system, _) = &lens {
                system.notes.iter().for_each(|note| log_line(format!("note: {name}: {note}")));
            }
            Ok(lens)
        }
    }
}

fn pairs(a: &LensSamples, b: &LensSamples, film_pitch_um: f64) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for band in 0..a.fields.len() {
        for k in 0..a.fields[band].len() {
            let kernel = |lens: &LensSamples| lens.fields[band][k].psf.film_kernel(film_pitch_um);
            let ((an, ak), (bn, bk)) = (kernel(a), kernel(b));
            let l1 = kernel_l1((an, &ak), (bn, &bk));
            pairs.push(Pair { a: a.figures(band, k), b: b.figures(band, k), l1 });
        }
    }
    pairs
}

/// Quantity that is compared at each field point: name, digits after the point, value.
type Column = (&'static str, usize, fn(&FieldFigures) -> f64);
const COLUMNS: [Column; 7] = [
    ("ideal_height_mm", 6, |f| f.ideal_height_mm),
    ("relative_illumination", 6, |f| f.illumination),
    ("distortion_percent", 4, |f| f.distortion_percent),
    ("lateral_colour_um", 3, |f| f.lateral_colour_um),
    ("strehl", 4, |f| f.strehl.unwrap_or(f64::NAN)),
    ("psf_window_um", 1, |f| f.window_um),
    ("energy_in_window", 4, |f| f.energy),
];

fn json(args: &DiffArgs, samples: &(LensSamples, LensSamples), pairs: &[Pair]) -> Value {
    let fields: Vec<Value> = pairs
        .iter()
        .map(|p| json!({ "wavelength_nm": p.a.wavelength_nm, "image_height_mm": p.a.height_mm, "a": p.a.json(), "b": p.b.json(), "psf_l1": p.l1 }))
        .collect();
    let scalars: serde_json::Map<String, Value> = scalars(&samples.0.lens, &samples.1.lens)
        .into_iter()
        .map(|(name, a, b)| (name.to_owned(), json!({ "a": a, "b": b, "b_minus_a": b - a })))
        .collect();
    let max_difference: serde_json::Map<String, Value> =
        COLUMNS.iter().map(|c| (c.0.to_owned(), json!(max_difference(c, pairs)))).collect();
    json!({
        "a": args.a,
        "b": args.b,
        "film_pitch_um": args.film_pitch_um,
        "lens": scalars,
        "largest_difference": max_difference,
        "largest_psf_l1": max_psf_l1(pairs),
        "fields": fields,
    })
}

/// Maximum |B − A| of a column; none if no field point has both values.
fn max_difference(column: &Column, pairs: &[Pair]) -> Option<f64> {
    let differences = pairs.iter().map(|p| (column.2(&p.b) - column.2(&p.a)).abs());
    differences.filter(|v| v.is_finite()).reduce(f64::max)
}

fn max_psf_l1(pairs: &[Pair]) -> f64 {
    pairs.iter().map(|p| p.l1).fold(0.0, f64::max)
}

fn text(
    args: &DiffArgs,
    (a, b): (&LensData, &LensData),
    samples: &(LensSamples, LensSamples),
    pairs: &[Pair],
) -> String {
    let mut out = format!("A  {}  ({})\nB  {}  ({})\n\n", a.name(), args.a, b.name(), args.b);
    out += &format!("{:<28} {:>14} {:>14} {:>12}\n", "", "A", "B", "B - A");
    for (name, a, b) in scalars(&samples.0.lens, &samples.1.lens) {
        out += &format!("{name:<28} {a:>14.6} {b:>14.6} {:>12.2e}\n", b - a);
    }
    out += &format!(
        "\nheight: real image height; ideal: ideal image height; RI: relative illumination; lateral: lateral colour relative to {} nm;\nwindow: side of the PSF window; light: share of the light inside it; PSF L1: L1 distance of the film \
         kernels at {} µm pitch, in the smaller window, each with sum 1\n",
        samples.0.primary.wavelength_nm, args.film_pitch_um
    );
    out += "     nm  height mm |  ideal mm: A, B - A   |    RI: A, B - A    | distortion %: A, B - A | lateral µm: A, B - A | window µm: A, B |  light: A, B   | PSF L1\n";
    for p in pairs {
        let (a, b) = (&p.a, &p.b);
        out += &format!(
            "{:7.2}  {:9.4} | {:10.6} {:+10.2e} | {:8.6} {:+9.2e} | {:11.4} {:+10.2e} | {:10.3} {:+9.2e} | {:7.1} {:7.1} | {:.4} {:.4} | {:.4}\n",
            a.wavelength_nm,
            a.height_mm,
            a.ideal_height_mm,
            b.ideal_height_mm - a.ideal_height_mm,
            a.illumination,
            b.illumination - a.illumination,
            a.distortion_percent,
            b.distortion_percent - a.distortion_percent,
            a.lateral_colour_um,
            b.lateral_colour_um - a.lateral_colour_um,
            a.window_um,
            b.window_um,
            a.energy,
            b.energy,
            p.l1
        );
    }
    out += "\nmaximum difference: ";
    let columns = COLUMNS.iter().filter_map(|c| max_difference(c, pairs).map(|v| (c, v)));
    let list: Vec<String> = columns.map(|(c, v)| format!("{} {v:.1$}", c.0, c.1)).collect();
    out += &list.join(", ");
    out += &format!(", psf_l1 {:.4}\n", max_psf_l1(pairs));
    out + &strehl_note(pairs.iter().flat_map(|p| [&p.a, &p.b]))
}
