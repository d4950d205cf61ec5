//! The page of a comparison: figures over image height, MTF, tables.

use super::Pair;
use super::edges::Edge;
use super::patches::Patch;
use super::regions::{Difference, Region};
use crate::commands::measure::edge_mtf::EdgeMtf;
use crate::outputs::page::table;
use crate::progress::print;
use formats::picture::figure::Figure;
use formats::picture::plot::{Axis, Plot, Series, stacked};
use formats::picture::series::Shape;
use formats::picture::style::Style;
use formats::picture::text::escape;

const PAGE: &str = "body{font:15px/1.5 'DejaVu Sans',Helvetica,Arial,sans-serif;color:#111;max-width:1100px;margin:0 auto;padding:24px}\
h1{font-size:24px}h2{font-size:19px;margin-top:32px;border-bottom:1px solid #bbb}table{border-collapse:collapse;font-size:13px}\
th,td{padding:2px 8px;border:1px solid #ccc;text-align:right}th{background:#f2f2f2}img,svg{max-width:100%;height:auto}\
@media print{body{padding:0;font-size:11px}tr,img,svg{break-inside:avoid}}";
/// Highest frequency that is shown, cycles per pixel.
pub const MAX_CY_PX: f64 = 0.6;

/// Names of the raws or films.
pub const NAMES: [&str; 2] = ["A", "B"];

/// SNR and difference over image height, and the MTF of each edge.
pub fn figures(pair: &Pair, regions: &[Region], edges: &[Edge]) -> Figure {
    let mut planes: Vec<&str> = Vec::new();
    for r in regions {
        if !planes.contains(&r.plane.as_str()) {
            planes.push(&r.plane);
        }
    }
    let over_height = |value: &dyn Fn(&Region) -> f64, plane: &str| {
        let points = regions.iter().filter(|r| r.plane == plane).map(|r| (r.height_mm, value(r)));
        points.collect::<Vec<_>>()
    };
    let axis = || Axis::new("image height (mm)", 0.0, 0.0);
    let mut snr = Plot::new("", axis(), Axis::new("SNR of a pixel (dB)", 0.0, 0.0));
    let mut ratio = Plot::new("", axis(), Axis::new("difference / its noise", 0.0, 0.0));
    for (i, plane) in planes.iter().enumerate() {
        for (raw, name) in NAMES.iter().enumerate() {
            let points = over_height(&|r| r.snr_db(raw), plane);
            let dots = Shape::Dots(if raw == 0 { 3.5 } else { 2.0 });
            snr.series.push(Series::distinct(format!("{plane} in {name}"), points, 2 * i + raw).shaped(dots));
        }
        let points = over_height(&|r| r.difference_e.0 / r.equivalent_e(), plane);
        ratio
            .series
            .push(Series::distinct(format!("{plane}: B − A"), points, 2 * i).shaped(Shape::Dots(3.0)));
    }
    let mut plots = vec![snr, ratio];
    for (k, edge) in edges.iter().enumerate() {
        let mut plot = Plot::new(
            format!("edge {k}"),
            Axis::new("spatial frequency (cycles/px)", 0.0, 0.0),
            Axis::new(format!("MTF, edge {k}"), 0.0, 1.05),
        );
        for (i, curve) in edge.curves.iter().enumerate() {
            for (raw, name) in NAMES.iter().enumerate() {
                let Ok(EdgeMtf { mtf, .. }) = &curve.measured[raw] else { continue };
                let points = std::iter::zip(&mtf.frequency_cy_px, &mtf.modulation);
                let points = points.filter(|(f, _)| **f <= MAX_CY_PX).map(|(f, m)| (*f, *m)).collect();
                plot.series
                    .push(Series::distinct(format!("{} in {name}", curve.name), points, i).dashed(2 * raw));
            }
        }
        plots.push(plot);
    }
    stacked(&format!("A: {}   B: {}", pair.names[0], pair.names[1]), &plots, Style::Light)
}

/// The page.
pub fn html(
    pair: &Pair,
    difference: &Difference,
    figures: &Figure,
    regions: &[Region],
    edges: &[Edge],
    patches: &[Patch],
) -> String {
    let mut body = format!(
        "<p>A: <b>{}</b><br>B: <b>{}</b>. {}</p><h2>Difference B &minus; A</h2><p>{}</p><img src=\"difference.png\" alt=\"difference\">\
         <h2>SNR and difference over image height; MTF</h2><p>One dot per region. SNR: mean over the standard deviation of a pixel by the \
         sensor's noises. Difference over its noise: the mean difference of a region in units of the noise-equivalent difference \
         &radic;(&sigma;<sub>A</sub>&sup2; + &sigma;<sub>B</sub>&sup2;) of a pair of pixels.</p>{}",
        escape(&pair.names[0]),
        escape(&pair.names[1]),
        escape(&pair.noise_note()),
        escape(&difference.caption(pair)),
        figures.to_svg_element()
    );
    if !edges.is_empty() {
        let head = ["edge", "plane", "MTF50 A (cycles/px)", "MTF50 B (cycles/px)", "doubtful"];
        let mut rows = vec![head.map(String::from).to_vec()];
        for (k, edge) in edges.iter().enumerate() {
            for curve in &edge.curves {
                let remarks: Vec<String> = (0..2)
                    .flat_map(|raw| curve.remarks(raw).map(move |r| format!("{}: {r}", NAMES[raw])))
                    .collect();
                let cells =
                    [k.to_string(), curve.name.clone(), curve.mtf50(0), curve.mtf50(1), remarks.join("; ")];
                rows.push(cells.to_vec());
            }
        }
        body += &format!("<h2>Edges</h2>{}", table(rows));
    }
    if !patches.is_empty() {
        let head =
            ["patch", "ΔE2000 B against A", "A against the ColorChecker", "B against the ColorChecker"];
        let mut rows = vec![head.map(String::from).to_vec()];
        for p in patches {
            let [a, b] =
                p.to_checker.map_or([String::new(), String::new()], |c| c.map(|v| format!("{v:.2}")));
            rows.push(vec![p.name.clone(), format!("{:.2}", p.delta_e), a, b]);
        }
        body += &format!("<h2>Patches</h2>{}", table(rows));
    }
    let head = [
        "x",
        "y",
        "plane",
        "height (mm)",
        "mean A (e-)",
        "mean B (e-)",
        "difference (e-)",
        "its σ (e-)",
        "SNR A (dB)",
        "SNR B (dB)",
        "noise-equivalent (e-)",
    ];
    let mut rows = vec![head.map(String::from).to_vec()];
    for r in regions {
        rows.push(vec![
            r.rect.x.to_string(),
            r.rect.y.to_string(),
            r.plane.clone(),
            format!("{:.2}", r.height_mm),
            format!("{:.1}", r.mean_e[0]),
            format!("{:.1}", r.mean_e[1]),
            format!("{:+.2}", r.difference_e.0),
            format!("{:.2}", r.difference_e.1),
            format!("{:.1}", r.snr_db(0)),
            format!("{:.1}", r.snr_db(1)),
            format!("{:.2}", r.equivalent_e()),
        ]);
    }
    body += &format!("<h2>Regions</h2>{}", table(rows));
    page("Comparison of two raws", &body)
}

/// A page of this title.
pub fn page(title: &str, body: &str) -> String {
    crate::outputs::page::page("lenscube compare", title, PAGE, body)
}

/// Figures on stdout.
pub fn print_summary(regions: &[Region], edges: &[Edge], patches: &[Patch]) {
    let mut planes: Vec<&str> = regions.iter().map(|r| r.plane.as_str()).collect();
    planes.dedup();
    planes.sort_unstable();
    planes.dedup();
    for plane in planes {
        let own: Vec<&Region> = regions.iter().filter(|r| r.plane == plane).collect();
        let weight: f64 = own.iter().map(|r| r.rect.size().pixels() as f64).sum();
        let mean = |value: &dyn Fn(&Region) -> f64| {
            own.iter().map(|r| value(r) * r.rect.size().pixels() as f64).sum::<f64>() / weight
        };
        print(format!(
            "{plane}: mean {:.1} and {:.1} e-, difference {:+.2} e-, its standard deviation {:.2} e-; noise-equivalent difference {:.2} e-",
            mean(&|r| r.mean_e[0]),
            mean(&|r| r.mean_e[1]),
            mean(&|r| r.difference_e.0),
            mean(&|r| r.difference_e.1),
            mean(&Region::equivalent_e),
        ));
    }
    for (k, edge) in edges.iter().enumerate() {
        for c in &edge.curves {
            print(format!("edge {k}, {}: MTF50 {} and {} cycles/px", c.name, c.mtf50(0), c.mtf50(1)));
            for (raw, name) in NAMES.iter().enumerate() {
                c.remarks(raw).for_each(|r| print(format!("edge {k}, {} in {name}: DOUBTFUL: {r}", c.name)));
            }
        }
    }
    if !patches.is_empty() {
        let mean = |v: &dyn Fn(&Patch) -> f64| patches.iter().map(v).sum::<f64>() / patches.len() as f64;
        let largest = patches.iter().map(|p| p.delta_e).fold(0.0, f64::max);
        print(format!("patches: mean ΔE2000 {:.2}, largest {largest:.2}", mean(&|p| p.delta_e)));
        if patches.iter().all(|p| p.to_checker.is_some()) {
            let of = |raw: usize| mean(&|p| p.to_checker.map_or(0.0, |c| c[raw]));
            print(format!("against the ColorChecker: mean ΔE2000 {:.2} and {:.2}", of(0), of(1)));
        }
    }
}
