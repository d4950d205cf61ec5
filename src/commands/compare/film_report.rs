//! The files of a comparison of films, its page with difference over wavelength, MTF and tables; and what is printed.

use super::films::{Comparison, Edge};
use super::report::{MAX_CY_PX, NAMES, page};
use crate::outputs::page::table;
use crate::progress::{number, print};
use anyhow::Result;
use formats::durable::{AtomicFile, create_directories};
use formats::picture::figure::Figure;
use formats::picture::plot::{Axis, Plot, Series, stacked};
use formats::picture::style::Style;
use formats::picture::text::escape;
use std::path::Path;

/// The files of the comparison, for the directory `out`, which is made.
///
/// # Errors
/// They cannot be written.
pub fn files(out: &Path, found: &Comparison) -> Result<Vec<AtomicFile>> {
    let figures = figures(found);
    create_directories(out, true)?;
    let at = |name: &str| out.join(name);
    let mut files = vec![
        found.difference.image.png_file(&at("difference.png"), &found.caption())?,
        figures.file(&at("figures.png"))?,
        AtomicFile::with_text(&at("regions.csv"), &found.regions_csv())?,
        AtomicFile::with_text(&at("compare.json"), &(serde_json::to_string_pretty(&found.json())? + "\n"))?,
        AtomicFile::with_text(&at("report.html"), &html(found, &figures))?,
    ];
    if !found.edges.is_empty() {
        files.push(AtomicFile::with_text(&at("mtf.csv"), &found.mtf_csv())?);
    }
    Ok(files)
}

/// The difference over wavelength, and the MTF of each edge.
fn figures(found: &Comparison) -> Figure {
    let axis = Axis::new("wavelength (nm)", 0.0, 0.0);
    let mut share = Plot::new("", axis, Axis::new("RMS of the difference (% of A)", 0.0, 0.0));
    let points = found.bands.iter().filter_map(|b| Some((b.nm, 100.0 * b.all.share()?))).collect();
    share.series.push(Series::distinct("B − A", points, 0));
    let mut plots = vec![share];
    for (k, edge) in found.edges.iter().enumerate() {
        let axis = Axis::new("spatial frequency (cycles/px)", 0.0, 0.0);
        let mut plot = Plot::new(format!("edge {k}"), axis, Axis::new(format!("MTF, edge {k}"), 0.0, 1.05));
        for (i, (nm, both)) in edge.bands.iter().enumerate() {
            for (film, name) in NAMES.iter().enumerate() {
                let Ok(measured) = &both[film] else { continue };
                let points = measured.mtf.iter().copied().filter(|(f, _)| *f <= MAX_CY_PX).collect();
                let label = format!("{} nm in {name}", number(*nm));
                plot.series.push(Series::distinct(label, points, i).dashed(2 * film));
            }
        }
        plots.push(plot);
    }
    stacked(&format!("A: {}   B: {}", found.names[0], found.names[1]), &plots, Style::Light)
}

/// The page.
fn html(found: &Comparison, figures: &Figure) -> String {
    let unit = match &found.units {
        [Some(a), Some(b)] if a == b => format!(" Values in {a}."),
        _ => String::new(),
    };
    let common = found.common.as_ref().map_or(String::new(), |c| {
        format!(
            " The films have other pixels: both are compared at {} x {} px of {} µm, on which the optical axis is at {}, {} px (right, down).",
            c["width"], c["height"], c["pitch_um"], c["axis_px"]["x"], c["axis_px"]["y"]
        )
    });
    let mut body = format!(
        "<p>A: <b>{}</b><br>B: <b>{}</b>.{}{common}</p><h2>Difference B &minus; A</h2><p>{}</p><img src=\"difference.png\" alt=\"difference\">\
         <h2>Difference over wavelength; MTF</h2>{}",
        escape(&found.names[0]),
        escape(&found.names[1]),
        escape(&unit),
        escape(&found.caption()),
        figures.to_svg_element()
    );
    let head = ["wavelength (nm)", "mean A", "mean B", "difference", "RMS", "RMS (% of A)", "largest"];
    let mut rows = vec![head.map(String::from).to_vec()];
    for band in &found.bands {
        let [a, b] = band.all.means();
        let values = [a, b, b - a, band.all.rms()].map(short).to_vec();
        let mut row = vec![number(band.nm).to_string()];
        row.extend(values);
        row.extend([share(band.all.share()), short(band.all.largest())]);
        rows.push(row);
    }
    body += &format!("<h2>Bands</h2>{}", table(rows));
    if !found.edges.is_empty() {
        let head = ["edge", "wavelength (nm)", "MTF50 A (cycles/px)", "MTF50 B (cycles/px)", "doubtful"];
        let mut rows = vec![head.map(String::from).to_vec()];
        for (k, edge) in found.edges.iter().enumerate() {
            for (nm, both) in &edge.bands {
                let mtf50 = [0, 1].map(|film| Edge::mtf50(&both[film]));
                let doubts = doubts(both).join("; ");
                rows.push(vec![
                    k.to_string(),
                    number(*nm).to_string(),
                    mtf50[0].clone(),
                    mtf50[1].clone(),
                    doubts,
                ]);
            }
        }
        body += &format!("<h2>Edges</h2>{}", table(rows));
    }
    page("Comparison of two films", &body)
}

/// Figures on stdout.
pub fn print_summary(found: &Comparison) {
    for band in &found.bands {
        let [a, b] = band.all.means();
        print(format!(
            "{} nm: mean {} and {}, difference {}, its RMS {} ({} % of A), largest {}",
            number(band.nm),
            short(a),
            short(b),
            short(b - a),
            short(band.all.rms()),
            share(band.all.share()),
            short(band.all.largest())
        ));
    }
    for (k, edge) in found.edges.iter().enumerate() {
        for (nm, both) in &edge.bands {
            let [a, b] = [0, 1].map(|film| Edge::mtf50(&both[film]));
            print(format!("edge {k}, {} nm: MTF50 {a} and {b} cycles/px", number(*nm)));
            doubts(both).iter().for_each(|d| print(format!("edge {k}, {} nm: DOUBTFUL: {d}", number(*nm))));
        }
    }
}

/// Remarks on the figures of an edge in both films.
fn doubts(both: &[Result<crate::commands::measure::Measurement, String>; 2]) -> Vec<String> {
    let of = |film: usize| {
        both[film].iter().flat_map(|m| &m.remarks).map(move |r| format!("{} in {}", r.text, NAMES[film]))
    };
    of(0).chain(of(1)).collect()
}

/// Five significant digits: films have any unit.
fn short(v: f64) -> String {
    let rounded: f64 = format!("{v:.4e}").parse().unwrap_or(v);
    match rounded == 0.0 || (1e-4..1e6).contains(&rounded.abs()) {
        true => rounded.to_string(),
        false => format!("{rounded:e}"),
    }
}

/// A share in %.
fn share(v: Option<f64>) -> String {
    v.map_or_else(|| "-".to_owned(), |v| format!("{:.3}", 100.0 * v))
}
