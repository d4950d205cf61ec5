//! `lenscube lens diff`: two lenses at the same wavelengths and REAL heights, side by side.
//!
//! PSFs are compared as film kernels at one pitch, each cropped to the smaller window and normalised there: their L1 distance
//! says how the shapes differ; windows and the light inside them stand beside it.

use super::look::{Figures, Look, Subject};
use super::show::chosen_heights;
use crate::args::DiffArgs;
use crate::failure::usage;
use crate::progress::print;
use crate::trace::wavelengths;
use anyhow::Result;
use pipeline::figures::kernel_l1;
use serde_json::{Value, json};

/// Wavelengths this close are the same, nm.
const SAME_NM: f64 = 1e-6;

/// One place in both lenses.
struct Pair {
    a: Figures,
    b: Figures,
    l1: f64,
}

/// Runs the command.
pub fn command(args: &DiffArgs) -> Result<()> {
    let (a, b) = (subject(&args.a, args)?, subject(&args.b, args)?);
    let nm = match &args.wavelengths {
        Some(text) => wavelengths(text)?,
        None => common(&a, &b)?,
    };
    let at = chosen_heights(args.heights.as_deref(), || Ok(a.reach_mm()?.min(b.reach_mm()?)))?;
    let looks = (a.look(&nm, &at)?, b.look(&nm, &at)?);
    let pairs = pairs(&looks.0, &looks.1, args.film_pitch_um);
    match args.json {
        true => print(serde_json::to_string_pretty(&as_json(args, &looks, &pairs))?),
        false => print(words(args, (&a, &b), &looks, &pairs).trim_end()),
    }
    Ok(())
}

/// Design flags mean whichever of the two is a design.
fn subject(name: &str, args: &DiffArgs) -> Result<Subject> {
    match crate::design::is_design(name) {
        true => Subject::open(name, &args.design),
        false => Subject::open(name, &Default::default()),
    }
}

/// Wavelengths that both hold; a design can be traced at any.
fn common(a: &Subject, b: &Subject) -> Result<Vec<f64>> {
    let (of_a, of_b) = (a.wavelengths_nm(), b.wavelengths_nm());
    let both: Vec<f64> = match (a, b) {
        (Subject::Design(..), Subject::Design(..)) | (Subject::Pack(_), Subject::Design(..)) => of_a.clone(),
        (Subject::Design(..), Subject::Pack(_)) => of_b.clone(),
        (Subject::Pack(_), Subject::Pack(_)) => {
            of_a.iter().copied().filter(|x| of_b.iter().any(|y| (x - y).abs() < SAME_NM)).collect()
        }
    };
    if both.is_empty() {
        let list = pipeline::wavelengths::format;
        return Err(usage(format!(
            "the packs share no wavelength: {} nm and {} nm",
            list(&of_a),
            list(&of_b)
        )));
    }
    Ok(both)
}

fn pairs(a: &Look, b: &Look, film_pitch_um: f64) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for band in 0..a.fields.len() {
        for k in 0..a.fields[band].len() {
            let kernel = |look: &Look| look.fields[band][k].psf.film_kernel(film_pitch_um);
            let ((an, ak), (bn, bk)) = (kernel(a), kernel(b));
            let l1 = kernel_l1((an, &ak), (bn, &bk));
            pairs.push(Pair { a: a.figures(band, k), b: b.figures(band, k), l1 });
        }
    }
    pairs
}

/// Scalars of the lenses: name, A's, B's.
fn heads(a: &Look, b: &Look) -> [(&'static str, f64, f64); 4] {
    let (a, b) = (&a.lens, &b.lens);
    [
        ("effective_focal_length_mm", a.effective_focal_length_mm, b.effective_focal_length_mm),
        ("distortion_focal_length_mm", a.distortion_focal_length_mm, b.distortion_focal_length_mm),
        ("f_number", a.f_number, b.f_number),
        ("magnification", a.magnification, b.magnification),
    ]
}

/// What is compared at each place: name, digits, its value.
type Column = (&'static str, usize, fn(&Figures) -> f64);
const COLUMNS: [Column; 7] = [
    ("ideal_height_mm", 6, |f| f.ideal_height_mm),
    ("relative_illumination", 6, |f| f.illumination),
    ("distortion_percent", 4, |f| f.distortion_percent),
    ("lateral_colour_um", 3, |f| f.lateral_colour_um),
    ("strehl", 4, |f| f.strehl.unwrap_or(f64::NAN)),
    ("psf_window_um", 1, |f| f.window_um),
    ("energy_in_window", 4, |f| f.energy),
];

fn as_json(args: &DiffArgs, looks: &(Look, Look), pairs: &[Pair]) -> Value {
    let fields: Vec<Value> = pairs
        .iter()
        .map(|p| json!({ "wavelength_nm": p.a.wavelength_nm, "image_height_mm": p.a.height_mm, "a": p.a.json(), "b": p.b.json(), "psf_l1": p.l1 }))
        .collect();
    let heads: serde_json::Map<String, Value> = heads(&looks.0, &looks.1)
        .into_iter()
        .map(|(name, a, b)| (name.to_owned(), json!({ "a": a, "b": b, "b_minus_a": b - a })))
        .collect();
    let largest: serde_json::Map<String, Value> =
        COLUMNS.iter().map(|c| (c.0.to_owned(), json!(largest(c, pairs)))).collect();
    json!({
        "a": args.a,
        "b": args.b,
        "film_pitch_um": args.film_pitch_um,
        "lens": heads,
        "largest_difference": largest,
        "largest_psf_l1": pairs.iter().map(|p| p.l1).fold(0.0, f64::max),
        "fields": fields,
    })
}

/// Largest |B − A| of a column; none where neither knows it everywhere.
fn largest(column: &Column, pairs: &[Pair]) -> Option<f64> {
    let off = pairs.iter().map(|p| (column.2(&p.b) - column.2(&p.a)).abs());
    off.filter(|v| v.is_finite()).reduce(f64::max)
}

fn words(args: &DiffArgs, (a, b): (&Subject, &Subject), looks: &(Look, Look), pairs: &[Pair]) -> String {
    let mut out = format!("A  {}  ({})\nB  {}  ({})\n\n", a.name(), args.a, b.name(), args.b);
    out += &format!("{:<28} {:>14} {:>14} {:>12}\n", "", "A", "B", "B - A");
    for (name, a, b) in heads(&looks.0, &looks.1) {
        out += &format!("{name:<28} {a:>14.6} {b:>14.6} {:>12.2e}\n", b - a);
    }
    out += &format!(
        "\nPSF L1: film kernels at {} um, in the smaller window, each of sum 1; lateral colour from {} nm (A), {} nm (B)\n",
        args.film_pitch_um, looks.0.primary.wavelength_nm, looks.1.primary.wavelength_nm
    );
    out += "     nm  height mm |  ideal mm: A, B - A   |    RI: A, B - A    | distortion %: A, B - A | lateral um: A, B - A | window um: A, B |  light: A, B   | PSF L1\n";
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
    out += "\nlargest difference: ";
    let each = COLUMNS.iter().filter_map(|c| largest(c, pairs).map(|v| (c, v)));
    let list: Vec<String> = each.map(|(c, v)| format!("{} {v:.1$}", c.0, c.1)).collect();
    out + &list.join(", ") + &format!(", psf_l1 {:.4}\n", pairs.iter().map(|p| p.l1).fold(0.0, f64::max))
}
