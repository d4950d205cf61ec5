//! e-SFR: MTF of slanted edges (ISO 12233), in luminance.
//!
//! The squares of an `iso12233-esfr` chart are followed from the middle of the picture outwards, so that distortion may displace them by many pixels; the edges are sought beside their squares. A single `slanted-edge` is sought where it is without distortion.

use super::place::{Placed, Position, square};
use super::section::{Section, cells, shown};
use crate::args::ReportArgs;
use crate::commands::measure::edge_mtf::EdgeMtf;
use crate::commands::measure::edge_region;
use crate::commands::measure::quality::{self, names};
use crate::failure::line as message;
use crate::progress::plural;
use anyhow::{Context, Result, bail};
use formats::picture::plot::{Axis, Plot, Series};
use formats::picture::series::Shape;
use formats::picture::style::Colour;
use pipeline::chart::{EdgeSite, Kind};
use pipeline::measure::dots::follow;
use pipeline::measure::edge::fit;
use serde_json::json;

/// Half width of the region of an edge, px: the most, and the least.
const HALF_PX: (f64, f64) = (24.0, 6.0);
/// Half widths of the regions in which a square is sought in turn, over half its side: wide, then without what is beside it.
const SEARCH: [f64; 2] = [1.6, 1.25];
/// Share of clipped pixels of a colour from which on an edge is clipped.
const MAX_CLIPPED: f64 = 0.01;
/// Edges of a square.
const SIDES: usize = 4;
/// Frequency up to which curves are shown, cycles per pixel.
pub const MAX_CY_PX: f64 = 0.6;

/// An edge and its MTF.
struct Edge {
    at: Position,
    height: f64,
    azimuth_deg: f64,
    measured: EdgeMtf,
    is_clipped: bool,
}

/// Measures the edges of the chart.
///
/// # Errors
/// No edge can be measured; the picture cannot be read.
pub fn measure(placed: &Placed<'_>, args: &ReportArgs) -> Result<Section> {
    let sites = placed.chart.edges();
    let displacements = displacements(placed)?;
    let (mut edges, mut failed) = (Vec::new(), Vec::new());
    for (site, by) in std::iter::zip(sites, displacements) {
        let found = by.context("its square was not found").and_then(|by| edge(placed, site, by));
        match found {
            Ok(edge) => edges.push(edge),
            Err(e) => failed.push(format!(
                "edge at film position {:.0},{:.0}: {}",
                site.centre_px.1,
                site.centre_px.0,
                message(&e)
            )),
        }
    }
    if edges.len() < sites.len().div_ceil(2) {
        bail!(
            "{}: {} of the {} edges of the chart could be measured, expected at least half: the chart has other settings, or is elsewhere in the picture; {}",
            placed.picture.name,
            edges.len(),
            sites.len(),
            failed.first().map_or("it has none", |f| f)
        );
    }
    edges.sort_by(|a, b| a.height.total_cmp(&b.height));
    Ok(section(placed, args, &edges, failed))
}

/// Displacement by distortion at each edge.
fn displacements(placed: &Placed<'_>) -> Result<Vec<Option<Position>>> {
    let sites = placed.chart.edges();
    let Kind::Esfr { .. } = placed.chart.spec().kind else { return Ok(vec![Some((0.0, 0.0)); sites.len()]) };
    let middles: Vec<Position> = sites
        .chunks_exact(SIDES)
        .map(|four| {
            let mean = |of: &dyn Fn(&EdgeSite) -> f64| four.iter().map(of).sum::<f64>() / SIDES as f64;
            (mean(&|s| s.centre_px.0), mean(&|s| s.centre_px.1))
        })
        .collect();
    // Half the side of a square: as long as the patch of an edge.
    let half = sites.first().map_or(0.0, |s| s.patch.width.max(s.patch.height) as f64);
    let mut failed = None;
    let found = follow(
        &middles,
        placed.middle(),
        |p| placed.at(p),
        |k, near| {
            let half = half * placed.scale(middles[k]);
            let mut at = near;
            for share in SEARCH {
                match dark_centroid(placed, at, share * half) {
                    Ok(found) => at = found?,
                    Err(e) => {
                        failed.get_or_insert(e);
                        return None;
                    }
                }
            }
            Some(at)
        },
    );
    if let Some(e) = failed {
        return Err(e);
    }
    let by = |(found, film): (&Option<Position>, &Position)| {
        let (found, at) = ((*found)?, placed.at(*film));
        Some((found.0 - at.0, found.1 - at.1))
    };
    let all: Vec<Option<Position>> = found.iter().zip(&middles).map(by).collect();
    Ok(all.into_iter().flat_map(|by| [by; SIDES]).collect())
}

/// Centroid of what is darker than halfway between paper and square within `half` px of `near`; `None` if that is not in the picture.
fn dark_centroid(placed: &Placed<'_>, near: Position, half: f64) -> Result<Option<Position>> {
    let rect = square(near, half, placed.picture.size());
    if rect.width < 8 || rect.height < 8 {
        return Ok(None);
    }
    let pixels = placed.picture.luminance(rect)?;
    let mut sorted = pixels.clone();
    sorted.sort_by(f32::total_cmp);
    let (dark, light) = (sorted[sorted.len() / 10], sorted[sorted.len() * 9 / 10]);
    let limit = (dark + light) / 2.0;
    let (mut n, mut y, mut x) = (0usize, 0.0, 0.0);
    for (i, _) in pixels.iter().enumerate().filter(|(_, v)| **v < limit) {
        (n, y, x) = (n + 1, y + (i / rect.width) as f64, x + (i % rect.width) as f64);
    }
    Ok((n > 0 && light > dark).then(|| (rect.y as f64 + y / n as f64, rect.x as f64 + x / n as f64)))
}

fn edge(placed: &Placed<'_>, site: &EdgeSite, by: Position) -> Result<Edge> {
    let (sin, cos) = site.angle_deg.to_radians().sin_cos();
    // Half of the edge's length in its patch.
    let reach = 0.45 * site.patch.width.min(site.patch.height) as f64;
    let end = |along: f64| {
        let (y, x) = placed.at((site.centre_px.0 + along * cos, site.centre_px.1 - along * sin));
        (y + by.0, x + by.1)
    };
    let (a, b) = (end(-reach), end(reach));
    let half = (reach * placed.scale(site.centre_px) - 2.0).min(HALF_PX.0);
    if half < HALF_PX.1 {
        bail!(
            "its patch of {} px is too small: expected at least {:.0} px of the picture",
            site.patch.size(),
            2.0 * (HALF_PX.1 + 2.0) / 0.9
        );
    }
    let half = half as usize;
    let (guess, rect, length) = edge_region(a, b, half);
    quality::check_length(length)?;
    let pixels = placed.picture.luminance(rect)?;
    let line = fit(&pixels, rect, guess, half).context("no edge was found")?;
    quality::check_place(guess, line, half)?;
    let middle = ((a.0 + b.0) / 2.0, (a.1 + b.1) / 2.0);
    let measured = EdgeMtf::new((&pixels, rect), line, (middle, length), half, &|_, _| true)?;
    let colours = placed.picture.colours(rect)?;
    Ok(Edge {
        is_clipped: colours.iter().any(|c| c.clipped as f64 > MAX_CLIPPED * c.pixels.len() as f64),
        at: line.at_px,
        height: placed.height(line.at_px),
        azimuth_deg: line.normal_rad.to_degrees().rem_euclid(360.0),
        measured,
    })
}

fn edges_are(n: usize) -> String {
    format!("{} {}", plural(n, "edge"), if n == 1 { "is" } else { "are" })
}

/// Mean MTF50 of the edges of which `is` holds; `None` if one has none.
fn mean(edges: &[Edge], is: impl Fn(&Edge) -> bool) -> Option<f64> {
    let of: Vec<f64> =
        edges.iter().filter(|e| is(e)).map(|e| e.measured.mtf.mtf50_cy_px()).collect::<Option<_>>()?;
    (!of.is_empty()).then(|| of.iter().sum::<f64>() / of.len() as f64)
}

fn section(placed: &Placed<'_>, args: &ReportArgs, edges: &[Edge], failed: Vec<String>) -> Section {
    let (first, last) = (edges[0].height, edges[edges.len() - 1].height);
    let third = (last - first) / 3.0;
    let name = |what: &str| format!("MTF50, {what} (cycles/px)");
    let figures = vec![
        (name("inner third"), shown(mean(edges, |e| e.height <= first + third), 4)),
        (name("outer third"), shown(mean(edges, |e| e.height >= last - third), 4)),
        ("edges measured".into(), format!("{} of {}", edges.len(), placed.chart.edges().len())),
    ];
    let mut curves = Plot::new(
        "MTF of the edges nearest to and farthest from the middle",
        Axis::new("spatial frequency (cycles/px)", 0.0, MAX_CY_PX),
        Axis::new("MTF", 0.0, 1.05),
    );
    let picks = if edges.len() > 1 { vec![0, edges.len() - 1] } else { vec![0] };
    for (i, k) in picks.into_iter().enumerate() {
        let (edge, mtf) = (&edges[k], &edges[k].measured.mtf);
        let points = std::iter::zip(&mtf.frequency_cy_px, &mtf.modulation).map(|(f, m)| (*f, *m));
        let points = points.take_while(|p| p.0 <= MAX_CY_PX).collect();
        curves.series.push(Series::distinct(format!("height {:.2}", edge.height), points, i));
    }
    let mut heights = Plot::new(
        "MTF50 over image height",
        Axis::new("image height (of half the diagonal)", 0.0, 1.0),
        Axis::new("MTF50 (cycles/px)", 0.0, 0.0),
    );
    let upright = |e: &Edge| e.azimuth_deg.to_radians().cos().abs() >= std::f64::consts::FRAC_1_SQRT_2;
    for (i, (name, kind)) in [("upright edges", true), ("level edges", false)].into_iter().enumerate() {
        let points = edges.iter().filter(|e| upright(e) == kind);
        let points = points.filter_map(|e| Some((e.height, e.measured.mtf.mtf50_cy_px()?))).collect();
        heights.series.push(Series::line(name, points, Colour::Palette(i)).shaped(Shape::Dots(3.5)));
    }
    let doubtful = edges.iter().filter(|e| !e.measured.remarks.is_empty());
    let mut remarks: Vec<String> = doubtful
        .flat_map(|e| {
            e.measured.remarks.iter().map(move |r| format!("edge at {:.0},{:.0}: {}", e.at.1, e.at.0, r.text))
        })
        .collect();
    match edges.iter().filter(|e| e.is_clipped).count() {
        0 => {}
        n => remarks.push(format!("{} clipped: the MTF is too high; expose less", edges_are(n))),
    }
    remarks.extend(failed);
    let mut table = vec![cells(["x", "y", "height", "normal (deg)", "MTF50 (cycles/px)"])];
    table.extend(edges.iter().map(|e| {
        vec![
            format!("{:.1}", e.at.1),
            format!("{:.1}", e.at.0),
            format!("{:.3}", e.height),
            format!("{:.2}", e.azimuth_deg),
            shown(e.measured.mtf.mtf50_cy_px(), 4),
        ]
    }));
    let one = |e: &Edge| {
        json!({
            "row": e.at.0, "column": e.at.1, "height": e.height, "normal_deg": e.azimuth_deg,
            "mtf50_cy_px": e.measured.mtf.mtf50_cy_px(), "frequency_cy_px": e.measured.mtf.frequency_cy_px,
            "modulation": e.measured.mtf.modulation, "clipped": e.is_clipped, "remarks": names(&e.measured.remarks),
        })
    };
    Section {
        slug: "e-sfr",
        title: "Resolution by slanted edges (e-SFR)",
        standard: "after ISO 12233:2023, from published descriptions of it; luminance in linear light, bins of 1/4 px",
        picture: placed.picture.name.clone(),
        camera: None,
        figures,
        remarks,
        plots: vec![curves.figure(args.style), heights.figure(args.style)],
        tables: vec![table],
        json: json!({ "edges": edges.iter().map(one).collect::<Vec<_>>() }),
    }
}
