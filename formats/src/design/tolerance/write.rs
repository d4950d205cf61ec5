//! The text of a description.
//!
//! Errors of a target are one entry, in the order of their first mention; Zernike terms beside an irregularity are an entry of
//! their own. Numbers have at most 12 significant digits: unit conversions leave rounding beyond them.

use std::fmt::Write;

use pipeline::design::tolerance::{
    Boresight, Compensation, Direction, Figure, Law, Limits, Quantity, RadiusUnit, Target, Tolerance,
};

/// The description of `list`, with fringes at `fringe_nm`; limits of the normal law need no word.
pub fn write(list: &[Tolerance], fringe_nm: f64, compensation: &Compensation) -> String {
    let mut text = format!("[tolerances]\nfringe_nm = {}\n", number(fringe_nm));
    let key = |t: &Tolerance| (t.target, matches!(t.quantity, Quantity::Zernike(_)));
    let mut written = Vec::new();
    for tolerance in list {
        let entry = key(tolerance);
        if !written.contains(&entry) {
            written.push(entry);
            let own: Vec<&Tolerance> = list.iter().filter(|t| key(t) == entry).collect();
            text += &head(tolerance.target);
            own.iter().for_each(|t| text += &lines(t, &own));
        }
    }
    text + "\n" + &compensate(compensation)
}

/// A number without the rounding of unit conversions.
fn number(value: f64) -> String {
    let rounded: f64 = format!("{value:.11e}").parse().unwrap_or(value);
    let size = rounded.abs();
    // TOML reads exponents as they are printed.
    if size != 0.0 && !(1e-4..1e9).contains(&size) { format!("{rounded:e}") } else { format!("{rounded}") }
}

fn head(target: Target) -> String {
    match target {
        Target::Element { first, last, pivot } => {
            let mut text = format!("\n[[element]]\nsurfaces = [{first}, {last}]\n");
            if pivot.surface != first {
                text += &format!("pivot = {}\n", pivot.surface);
            }
            if pivot.offset_mm != 0.0 {
                text += &format!("pivot_offset_mm = {}\n", number(pivot.offset_mm));
            }
            text
        }
        Target::Surface(surface) => format!("\n[[surface]]\nsurface = {surface}\n"),
        Target::Gap { after, absorb } => {
            let absorb = absorb.map_or(String::new(), |s| format!("absorb = {s}\n"));
            format!("\n[[gap]]\nafter = {after}\n{absorb}")
        }
        Target::Glass(after) => format!("\n[[glass]]\nafter = {after}\n"),
        Target::Film => "\n[[film]]\n".to_owned(),
    }
}

fn limits(limits: &Limits) -> String {
    let plain = match limits.low == -limits.high {
        true => number(limits.high),
        false => format!("[{}, {}]", number(limits.low), number(limits.high)),
    };
    match limits.law {
        Law::Normal => plain,
        law => format!("{{ limits = {plain}, law = \"{}\" }}", law.name()),
    }
}

/// The lines of an error; `own` are all of its target.
fn lines(tolerance: &Tolerance, own: &[&Tolerance]) -> String {
    let size = limits(&tolerance.limits);
    let along = |what: &str, unit: &str, flag: &str, d: Direction, make: fn(Direction) -> Quantity| {
        let has_equal = |d| own.iter().any(|t| t.quantity == make(d) && t.limits == tolerance.limits);
        match d {
            Direction::Radial => format!("{what}_{unit} = {size}\n{flag} = true\n"),
            // One key for both axes, at x.
            Direction::X if has_equal(Direction::Y) => format!("{what}_{unit} = {size}\n"),
            Direction::Y if has_equal(Direction::X) => String::new(),
            Direction::X => format!("{what}_x_{unit} = {size}\n"),
            Direction::Y => format!("{what}_y_{unit} = {size}\n"),
        }
    };
    match tolerance.quantity {
        Quantity::Decentre(d) => along("decentre", "um", "radial", d, Quantity::Decentre),
        Quantity::Tilt(d) => along("tilt", "arcmin", "tilt_radial", d, Quantity::Tilt),
        Quantity::Wedge(d) => along("wedge", "arcmin", "wedge_radial", d, Quantity::Wedge),
        Quantity::Shift => format!("shift_um = {size}\n"),
        Quantity::Radius(RadiusUnit::Percent) => format!("radius_percent = {size}\n"),
        Quantity::Radius(RadiusUnit::Fringes) => format!("radius_fringes = {size}\n"),
        Quantity::Radius(RadiusUnit::Um) => format!("radius_um = {size}\n"),
        Quantity::Irregularity(figure) => {
            let mixed = if figure == Figure::Mixed { "figure = \"mixed\"\n" } else { "" };
            format!("irregularity_fringes = {size}\n{mixed}")
        }
        Quantity::Zernike(term) => zernike(term, tolerance, own),
        Quantity::Conic => format!("conic = {size}\n"),
        Quantity::Thickness => format!("thickness_um = {size}\n"),
        Quantity::Index => format!("index = {size}\n"),
        Quantity::Abbe => format!("abbe_percent = {size}\n"),
    }
}

/// All terms of a surface, at the first of them: a description gives a surface one range of terms.
fn zernike(term: u32, tolerance: &Tolerance, own: &[&Tolerance]) -> String {
    let terms =
        || own.iter().filter_map(|t| if let Quantity::Zernike(j) = t.quantity { Some(j) } else { None });
    let (first, last) = (terms().min().unwrap_or(term), terms().max().unwrap_or(term));
    if term != first {
        return String::new();
    }
    let all =
        Limits::symmetric(tolerance.limits.high * f64::from(last - first + 1).sqrt(), tolerance.limits.law);
    format!("figure = \"zernike\"\nzernike = {{ terms = [{first}, {last}], rms_waves = {} }}\n", limits(&all))
}

fn compensate(compensation: &Compensation) -> String {
    let mut text = "[compensate]\n".to_owned();
    // Writing to a string does not fail.
    let _ = match compensation.focus_um {
        Some((low, high)) => writeln!(text, "focus_um = [{}, {}]", number(low), number(high)),
        None => writeln!(text, "focus = false"),
    };
    let boresight = match compensation.boresight {
        Boresight::Keep => "keep",
        Boresight::Remove => "remove",
    };
    text + &format!("film_tilt = {}\nboresight = \"{boresight}\"\n", compensation.film_tilt)
}
