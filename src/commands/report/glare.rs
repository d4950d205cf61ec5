//! Veiling glare of black discs on white paper (ISO 18844, ISO 9358), colour by colour.
//!
//! ```text
//! index = mean of the inner half of a disc / mean of the paper on both sides of it
//! ```

use super::place::{Placed, square};
use super::section::{Section, cells};
use crate::args::ReportArgs;
use crate::failure::usage;
use anyhow::{Result, bail};
use pipeline::chart::Kind;
use pipeline::geometry::Rect;
use serde_json::json;

/// Half a side of the measured squares over the diameter of a disc: a square of half its diameter is inside it.
const HALF: f64 = 0.2;

/// Index of a disc in a colour.
struct Index {
    colour: String,
    at: (f64, f64),
    black: f64,
    white: f64,
    clipped: bool,
}

/// Measures the discs of the chart.
///
/// # Errors
/// Discs that are too small or not in the picture; paper without light.
pub fn measure(placed: &Placed<'_>, _: &ReportArgs) -> Result<Section> {
    let Kind::BlackSpots { diameter, .. } = placed.chart.spec().kind else {
        bail!("{} has no black discs", placed.chart.spec())
    };
    let diameter_px = diameter * placed.chart.film_size().height as f64;
    let mut all = Vec::new();
    for film in placed.chart.points_px() {
        let at = placed.at(*film);
        let d = diameter_px * placed.scale(*film);
        let black = means(placed, square(at, HALF * d, placed.picture.size()))?;
        // Between this disc and those beside it, which are at least a diameter away.
        let beside = [-1.0, 1.0]
            .map(|side| means(placed, square((at.0, at.1 + side * d), HALF * d, placed.picture.size())));
        let [left, right] = beside;
        for (black, (left, right)) in std::iter::zip(black, std::iter::zip(left?, right?)) {
            let white = (left.mean + right.mean) / 2.0;
            if white.is_nan() || white <= 0.0 {
                bail!(
                    "{}: the paper beside the disc at {:.0},{:.0} has no light in {}",
                    placed.picture.name,
                    at.1,
                    at.0,
                    black.name
                );
            }
            if black.mean > white / 2.0 {
                bail!(
                    "{}: expected a black disc at {:.0},{:.0}, found {:.4e} in {} beside paper of {white:.4e}: the chart has other settings, or is elsewhere in the picture",
                    placed.picture.name,
                    at.1,
                    at.0,
                    black.mean,
                    black.name
                );
            }
            let clipped = left.is_clipped || right.is_clipped;
            all.push(Index { colour: black.name, at, black: black.mean, white, clipped });
        }
    }
    Ok(section(placed, &all))
}

struct Mean {
    name: String,
    mean: f64,
    is_clipped: bool,
}

fn means(placed: &Placed<'_>, rect: Rect) -> Result<Vec<Mean>> {
    let of = |colour: super::picture::Colour| {
        if colour.pixels.is_empty() {
            return Err(usage(format!(
                "{}: {rect} has no pixel of {}: the discs are too small in the picture, or outside",
                placed.picture.name, colour.name
            )));
        }
        let mean = colour.pixels.iter().map(|p| p.2).sum::<f64>() / colour.pixels.len() as f64;
        Ok(Mean { name: colour.name, mean, is_clipped: colour.clipped > 0 })
    };
    placed.picture.colours(rect)?.into_iter().map(of).collect()
}

fn section(placed: &Placed<'_>, all: &[Index]) -> Section {
    let mut names: Vec<&str> = Vec::new();
    for index in all {
        if !names.contains(&&*index.colour) {
            names.push(&index.colour);
        }
    }
    let percent = |i: &Index| 100.0 * i.black / i.white;
    let mut figures = Vec::new();
    for name in &names {
        let own: Vec<f64> = all.iter().filter(|i| i.colour == *name).map(percent).collect();
        let mean = own.iter().sum::<f64>() / own.len() as f64;
        let most = own.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        figures.push((
            format!("veiling glare index, {name}, mean and largest (%)"),
            format!("{mean:.4}, {most:.4}"),
        ));
    }
    let unit = placed.picture.unit();
    let mut table = vec![cells([
        "x",
        "y",
        "height",
        "colour",
        &format!("black ({unit})"),
        &format!("white ({unit})"),
        "index (%)",
    ])];
    table.extend(all.iter().map(|i| {
        vec![
            format!("{:.0}", i.at.1),
            format!("{:.0}", i.at.0),
            format!("{:.3}", placed.height(i.at)),
            i.colour.clone(),
            format!("{:.5e}", i.black),
            format!("{:.5e}", i.white),
            format!("{:.4}", percent(i)),
        ]
    }));
    let remarks = match all.iter().any(|i| i.clipped) {
        true => vec!["the paper is clipped: the index is too large; expose less".to_owned()],
        false => Vec::new(),
    };
    let one = |i: &Index| json!({ "row": i.at.0, "column": i.at.1, "colour": i.colour, "black": i.black, "white": i.white, "veiling_glare_index": i.black / i.white });
    Section {
        slug: "glare",
        title: "Veiling glare",
        standard: "after ISO 18844:2017, from published descriptions of it; black discs on a white chart, linear in light; raws in electrons, or digital numbers of a DNG",
        picture: placed.picture.name.clone(),
        camera: None,
        figures,
        remarks,
        plots: Vec::new(),
        tables: vec![table],
        json: json!({ "unit": unit, "discs": all.iter().map(one).collect::<Vec<_>>() }),
    }
}
