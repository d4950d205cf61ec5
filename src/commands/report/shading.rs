//! Shading of light and colour of a uniform picture (ISO 17957).

use super::place::Placed;
use super::section::{Section, shown};
use crate::args::ReportArgs;
use crate::failure::usage;
use anyhow::{Context, Result};
use formats::picture::plot::{Axis, Plot, Series};
use formats::picture::series::Shape;
use formats::picture::style::Colour;
use pipeline::geometry::Rect;
use pipeline::measure::shading::Shading;
use serde_json::json;

/// Parts along a side.
const ALONG: usize = 31;
/// Rows that are read at a time, at most.
const ROWS: usize = 64;

/// Measures a uniform picture.
///
/// # Errors
/// A picture of less than two pixels a part, or a dark one; a chart with corner marks.
pub fn measure(placed: &Placed<'_>, args: &ReportArgs) -> Result<Section> {
    let size = placed.picture.size();
    if size.height.min(size.width) < 2 * ALONG {
        return Err(usage(format!(
            "{}: expected at least {} pixels a side for shading, found {size}",
            placed.picture.name,
            2 * ALONG
        )));
    }
    if placed.chart.fiducials().is_some() {
        return Err(usage(format!(
            "{}: shading is measured over the whole picture; give a uniform chart without fiducials",
            placed.picture.name
        )));
    }
    let edge = |k: usize, n: usize| k * n / ALONG;
    let mut means: Vec<Vec<f64>> = Vec::new();
    for i in 0..ALONG {
        let (top, bottom) = (edge(i, size.height), edge(i + 1, size.height));
        let mut sums: Vec<Vec<f64>> = Vec::new();
        for row in (top..bottom).step_by(ROWS) {
            let rect = Rect::new(row as i64, 0, ROWS.min(bottom - row), size.width);
            let channels = placed.picture.channels(rect)?;
            sums.resize(ALONG, vec![0.0; channels.len()]);
            for (c, channel) in channels.iter().enumerate() {
                for line in channel.chunks_exact(size.width) {
                    for (j, sums) in sums.iter_mut().enumerate() {
                        sums[c] += line[edge(j, size.width)..edge(j + 1, size.width)]
                            .iter()
                            .map(|v| f64::from(*v))
                            .sum::<f64>();
                    }
                }
            }
        }
        for (j, mut sums) in sums.into_iter().enumerate() {
            let n = (bottom - top) * (edge(j + 1, size.width) - edge(j, size.width));
            sums.iter_mut().for_each(|s| *s /= n as f64);
            means.push(sums);
        }
    }
    let shading = Shading::of_means(ALONG, &means).with_context(|| {
        format!("{}: its middle is dark: expected a picture of a uniform chart", placed.picture.name)
    })?;
    Ok(section(placed, args, &shading))
}

fn section(placed: &Placed<'_>, args: &ReportArgs, shading: &Shading) -> Section {
    let size = placed.picture.size();
    let height = |k: usize| {
        let place = |i: usize, n: usize| (i as f64 + 0.5) * n as f64 / ALONG as f64 - 0.5;
        placed.height((place(k / ALONG, size.height), place(k % ALONG, size.width)))
    };
    let axis = || Axis::new("image height (of half the diagonal)", 0.0, 1.0);
    let over = |value: &dyn Fn(&pipeline::measure::shading::Part) -> Option<f64>| -> Vec<(f64, f64)> {
        shading.parts.iter().enumerate().filter_map(|(k, part)| Some((height(k), value(part)?))).collect()
    };
    let dots = |name: &str, points, colour| {
        Series::line(name, points, Colour::Palette(colour)).shaped(Shape::Dots(2.0))
    };
    let mut light = Plot::new("Relative illumination", axis(), Axis::new("relative illumination", 0.0, 1.05));
    light.series.push(dots("", over(&|p| Some(p.relative_illumination)), 0));
    let mut plots = vec![light.figure(args.style)];
    let mut figures = vec![(
        "relative illumination of the corners (%)".into(),
        format!("{:.2}", 100.0 * shading.corners()),
    )];
    let least = shading.parts.iter().map(|p| p.relative_illumination).fold(f64::INFINITY, f64::min);
    figures.push(("least relative illumination (%)".into(), format!("{:.2}", 100.0 * least)));
    if let Some([red, blue]) = shading.max_ratios() {
        let mut colour =
            Plot::new("Shading of colour", axis(), Axis::new("ratio over that of the middle", 0.98, 1.02));
        colour.series.push(dots("red / green", over(&|p| p.ratios.map(|r| r[0])), 1));
        colour.series.push(dots("blue / green", over(&|p| p.ratios.map(|r| r[1])), 0));
        plots.push(colour.figure(args.style));
        figures.push(("shading of colour, red / green, largest (%)".into(), format!("{:.2}", 100.0 * red)));
        figures.push(("shading of colour, blue / green, largest (%)".into(), format!("{:.2}", 100.0 * blue)));
        figures.push((
            "shading of colour, largest difference of chroma ΔC".into(),
            shown(shading.max_delta_c(), 2),
        ));
    }
    let column = |value: &dyn Fn(&pipeline::measure::shading::Part) -> serde_json::Value| {
        shading.parts.iter().map(value).collect::<Vec<_>>()
    };
    Section {
        slug: "shading",
        title: "Shading of light and colour",
        standard: "after ISO 17957:2015, from published descriptions of it; means of 31 x 31 parts, linear in light",
        picture: placed.picture.name.clone(),
        camera: None,
        figures,
        remarks: Vec::new(),
        plots,
        tables: Vec::new(),
        json: json!({
            "parts_along_a_side": ALONG, "corners": shading.corners(), "max_ratio_deviation": shading.max_ratios(), "max_delta_c": shading.max_delta_c(),
            "relative_illumination": column(&|p| json!(p.relative_illumination)), "ratios": column(&|p| json!(p.ratios)), "delta_c": column(&|p| json!(p.delta_c)),
        }),
    }
}
