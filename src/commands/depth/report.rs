//! Text and JSON of `lenscube depth`.

use super::overview::Overview;
use crate::job::depth::MAX_STEP_PX;
use crate::job::depth::scan::{Findings, Pixels};
use crate::job::preview::{PlannedBand, Preview};
use crate::progress::mib;
use crate::progress::short_number;
use pipeline::psf::blocks::Blocks;
use serde_json::{Value, json};

/// Counts of a surface: name, what they are, whether they are worth a look.
fn counts(found: &Findings) -> [(&'static str, &'static str, Pixels); 8] {
    [
        ("nan", "NaN", found.nan),
        ("zero", "0", found.zero),
        ("negative", "negative", found.negative),
        ("infinite", "at infinity: infinite, 1e6 m or more, or 65504 in 16-bit floats", found.infinite),
        ("nearer_than_nodes", "nearer than the nearest depth node of the lens", found.nearer),
        ("farther_than_nodes", "farther than the farthest depth node of the lens", found.farther),
        (
            "between_surfaces",
            "between two neighbours of different surfaces: anti-aliased depth (--depth-edges snap)",
            found.between,
        ),
        ("outliers", "alone before or behind the surface around them", found.outliers),
    ]
}

/// Distance of vergence `v` with its unit.
pub fn distance_text(v: f64) -> String {
    if v > 0.0 { format!("{} m", metres(v)) } else { "infinity".into() }
}

/// Distance of vergence `v`, m.
pub fn metres(v: f64) -> String {
    if v > 0.0 { short_number(1.0 / v) } else { "inf".into() }
}

/// Least and greatest blur radius of the surfaces, film px.
fn blur_range(preview: &Preview) -> (f64, f64) {
    let (first, last) = (preview.depth.surfaces.first, preview.depth.surfaces.last);
    let blur = |v: f64| (v - preview.focus).abs() * preview.blur_px;
    let least =
        if first <= preview.focus && preview.focus <= last { 0.0 } else { blur(first).min(blur(last)) };
    (least, blur(first).max(blur(last)))
}

/// Windows of the nodes that are used, film px.
fn windows(band: &PlannedBand) -> Option<(usize, usize)> {
    let of_flat = band.plan.blocks.as_ref().map(|blocks| blocks.window);
    let of_nodes = band.plan.depth.iter().flat_map(|depth| depth.used()).map(|node| node.blocks.window);
    of_nodes.chain(of_flat).fold(None, |range, w| {
        let (least, most) = range.unwrap_or((w, w));
        Some((w.min(least), w.max(most)))
    })
}

/// Mean and maximum of the slabs of tiles.
pub fn mean_and_most(slabs: &[usize]) -> (f64, usize) {
    (slabs.iter().sum::<usize>() as f64 / slabs.len().max(1) as f64, slabs.iter().copied().max().unwrap_or(0))
}

/// The report as text.
pub fn text(preview: &Preview, overview: &Overview) -> String {
    let Preview { frame, depth, .. } = preview;
    let mut lines: Vec<(&str, String)> = Vec::new();
    let focus = distance_text(preview.focus);
    lines.push((
        "lens",
        format!(
            "{}, in focus at {focus}; the blur radius grows by {} px per dioptre",
            preview.lens,
            short(preview.blur_px)
        ),
    ));
    lines.push((
        "chart",
        format!("{} px, on a film of {} px of {} µm", frame.chart, frame.film, frame.pitch_um),
    ));
    lines.extend(preview.names.iter().map(|name| ("surface", name.clone())));
    let surfaces = &depth.surfaces;
    lines.push((
        "range",
        format!(
            "{} to {} ({} to {} 1/m)",
            distance_text(surfaces.last),
            distance_text(surfaces.first),
            short_number(surfaces.first),
            short_number(surfaces.last)
        ),
    ));
    let (least, most) = blur_range(preview);
    let sharp = 100.0 * overview.sharp as f64 / overview.pixels();
    lines.push((
        "blur",
        format!(
            "radius {} to {} px, mean {}; {sharp:.1} % of the pixels at most 1 px",
            short(least),
            short(most),
            short(overview.blur_px / overview.pixels())
        ),
    ));
    let edges: u64 = depth.findings.iter().map(|found| found.edges).sum();
    let hidden = match (depth.count() - 1, surfaces.is_invented) {
        (0, true) => "what they hide is invented".to_owned(),
        (0, false) => "what they hide is black".to_owned(),
        (1, _) => "a hidden surface is given".to_owned(),
        (n, _) => format!("{n} hidden surfaces are given"),
    };
    lines.push((
        "edges",
        match edges {
            0 => "none: no neighbours differ by more than 2 px of blur".to_owned(),
            edges => format!(
                "{edges} pixels, {:.3} %, between neighbours that differ by more than 2 px of blur; {hidden}",
                100.0 * edges as f64 / (overview.pixels() * depth.count() as f64)
            ),
        },
    ));
    if let Some(band) = &preview.band {
        band_lines(preview, band, &mut lines);
    }
    let mut suspicious = Vec::new();
    for (name, found) in std::iter::zip(&preview.names, &depth.findings) {
        for (_, what, Pixels { count, first }) in counts(found) {
            if let Some((row, column)) = first {
                let of = if preview.names.len() > 1 { format!(" of {name}") } else { String::new() };
                let place = format!("row {row}, column {column}");
                suspicious.push(match count {
                    1 => format!("1 pixel{of}, {place}: {what}"),
                    _ => format!("{count} pixels{of}, e.g. {place}: {what}"),
                });
            }
        }
    }
    if let Some(step_px) = depth.f16_step_px {
        let verdict = if step_px > MAX_STEP_PX { "save 32-bit floats" } else { "not visible" };
        suspicious.push(format!(
            "16-bit floats: their rounding changes blur by up to {} px, {verdict}",
            short(step_px)
        ));
    }
    if suspicious.is_empty() {
        suspicious.push("no pixel".into());
    }
    lines.extend(suspicious.into_iter().map(|text| ("suspicious", text)));
    lines.extend(preview.problems.iter().map(|text| ("error", format!("of a run: {text}"))));
    let mut last = "";
    let rows = lines.iter().map(|(label, text)| {
        let shown = if *label == last { "" } else { label };
        last = label;
        format!("{shown:<12}{text}")
    });
    rows.collect::<Vec<_>>().join("\n")
}

fn band_lines(preview: &Preview, band: &PlannedBand, lines: &mut Vec<(&'static str, String)>) {
    let all = &band.vergences;
    if let [first, .., last] = &all[..] {
        let used = band.plan.depth.as_ref().map_or(1, |depth| depth.used().count());
        let estimated = band.untraced.map_or_else(String::new, |nodes| {
            format!(
                "; to be traced unless cached: PSFs of about {:.0} MB a band, error between nodes at most {:.2} %",
                nodes.bytes as f64 * 1e-6,
                100.0 * nodes.l1
            )
        });
        lines.push((
            "nodes",
            format!(
                "{used} of {} at {} nm, {} to {}{estimated}",
                all.len(),
                short_number(band.nm),
                distance_text(*last),
                distance_text(*first)
            ),
        ));
    }
    if let Some((least, most)) = windows(band) {
        lines.push(("windows", format!("{least} to {most} px (at most {} px)", Blocks::widest_window())));
    }
    let (tiling, slabs) = band.tile_slabs(&preview.frame);
    let ((mean, most), tile) = (mean_and_most(&slabs), tiling.tile());
    lines.push(("slabs", format!("{mean:.1} in reach of a tile of {tile} px on average, {most} at most")));
    lines.push(("time", format!(
        "about {} core seconds a band at the speed of a 2.2 GHz core with AVX-512, {:.1} times a flat film{}{}",
        short(band.core_s),
        band.core_s / band.flat_core_s,
        match band.correction_core_s {
            0.0 => String::new(),
            seconds => format!("; {} of them correct edges of surfaces out of focus", short(seconds)),
        },
        band.untraced.map_or_else(String::new, |nodes| format!(", and {} to trace its nodes", short(nodes.core_s)))
    )));
    if let Some(memory) = &band.memory {
        lines.push(("memory", format!("{} of at most {}", mib(memory.planned), mib(memory.limit))));
    }
}

/// Three digits.
fn short(v: f64) -> String {
    match v.abs() {
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 10.0 => format!("{v:.1}"),
        v => format!("{v:.2}"),
    }
}

/// The report as JSON.
pub fn json(preview: &Preview, overview: &Overview) -> Value {
    let Preview { frame, depth, .. } = preview;
    let surfaces = &depth.surfaces;
    let distance = |v: f64| if v > 0.0 { json!(1.0 / v) } else { json!("inf") };
    let (least, most) = blur_range(preview);
    let surface = |(name, found): (&String, &Findings)| {
        let mut object = json!({ "name": name, "edge_pixels": found.edges });
        for (key, _, Pixels { count, first }) in counts(found) {
            object[key] = json!({ "pixels": count, "first": first.map(|(row, column)| json!({ "row": row, "column": column })) });
        }
        object
    };
    let band = preview.band.as_ref().map(|band| {
        let (tiling, tile_slabs) = band.tile_slabs(frame);
        let (mean, most) = mean_and_most(&tile_slabs);
        json!({
            "wavelength_nm": band.nm,
            "node_vergences_per_m": band.vergences,
            "nodes_used": band.plan.depth.as_ref().map_or(1, |depth| depth.used().count()),
            "window_px": windows(band).map(|(least, most)| json!([least, most])),
            "trace_core_s": band.untraced.map(|nodes| nodes.core_s),
            "psf_bytes_to_trace": band.untraced.map(|nodes| nodes.bytes),
            "node_error_l1": band.untraced.map(|nodes| nodes.l1),
            "tile_px": tiling.tile(),
            "tiles": { "rows": tiling.count().0, "columns": tiling.count().1 },
            "slabs_of_tiles": tile_slabs,
            "slabs_mean": mean,
            "slabs_max": most,
            "core_s": band.core_s,
            "correction_core_s": band.correction_core_s,
            "flat_core_s": band.flat_core_s,
            "memory_bytes": band.memory.map(|memory| memory.planned),
            "memory_limit_bytes": band.memory.map(|memory| memory.limit),
        })
    });
    json!({
        "lens": preview.lens,
        "focus_m": distance(preview.focus),
        "blur_px_per_dioptre": preview.blur_px,
        "chart_px": { "x": frame.chart.width, "y": frame.chart.height },
        "film_px": { "x": frame.film.width, "y": frame.film.height },
        "film_pitch_um": frame.pitch_um,
        "nearest_m": distance(surfaces.last),
        "farthest_m": distance(surfaces.first),
        "blur_px": { "least": least, "greatest": most, "mean": overview.blur_px / overview.pixels() },
        "share_within_1_px": overview.sharp as f64 / overview.pixels(),
        "is_invented": surfaces.is_invented,
        "f16_step_px": depth.f16_step_px,
        "surfaces": std::iter::zip(&preview.names, &depth.findings).map(surface).collect::<Vec<_>>(),
        "band": band,
        "problems": preview.problems,
    })
}
