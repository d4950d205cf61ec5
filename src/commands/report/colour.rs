//! Colour errors of a ColorChecker: ΔE2000 against its spectra under the light, and the sensor metamerism index.
//!
//! The colours are as bright as their greys should be. The index is that of ISO 17321-1 by its published formula, SMI = 100 − 5.5·mean ΔE*ab of the 18 colours after the best matrix; here the matrix is fitted to the picture's
//! own values, balanced on its greys, by least squares with neutral kept ([`ColourMatrix`]), so it also corrects a matrix that the picture has already been through.

use super::place::Placed;
use super::section::{Section, cells, shown};
use crate::args::ReportArgs;
use crate::failure::usage;
use anyhow::{Result, bail};
use formats::picture::plot::{Axis, Plot, Series};
use formats::picture::series::Shape;
use formats::picture::style::Colour;
use pipeline::colour::{CHECKER_PATCHES, Illuminant, checker_names, lab, linear_srgb_to_xyz};
use pipeline::develop::matrix::{ColourMatrix, GREYS, difference, patch_targets, scaled_to_greys};
use serde_json::json;

/// Measures the 24 patches.
///
/// # Errors
/// A grey picture; patches that are not in the picture; dark greys.
pub fn measure(placed: &Placed<'_>, args: &ReportArgs) -> Result<Section> {
    let picture = placed.picture;
    let mut found: Vec<[f64; 3]> = Vec::new();
    let mut clipped = 0;
    for film in placed.chart.patches_px() {
        let rect = placed.patch(*film);
        if rect.width == 0 || rect.height == 0 {
            return Err(usage(format!(
                "{}: the patches of the chart are smaller than a pixel",
                picture.name
            )));
        }
        let channels = picture.channels(rect)?;
        let [red, green, blue] = &channels[..] else {
            return Err(usage(format!("{}: expected a picture in colour, found grey", picture.name)));
        };
        let mean =
            |channel: &Vec<f32>| channel.iter().map(|v| f64::from(*v)).sum::<f64>() / channel.len() as f64;
        found.push([mean(red), mean(green), mean(blue)]);
        clipped += usize::from(picture.colours(rect)?.iter().any(|c| c.clipped * 100 > c.pixels.len()));
    }
    let light = picture.frame().and_then(crate::camera::frame::Frame::light).unwrap_or(args.light);
    let targets = patch_targets(light);
    let scaled = scaled_to_greys(&found, &targets).ok_or_else(|| {
        usage(format!(
            "{}: the greys of the chart are dark: it is elsewhere in the picture, or not exposed",
            picture.name
        ))
    })?;
    if let Some(pair) = scaled[GREYS.start..].windows(2).find(|pair| pair[1][1] > 0.95 * pair[0][1]) {
        bail!(
            "{}: the greys of the chart do not become darker from white to black: {:.4} is followed by {:.4}; the chart is elsewhere in the picture, or clipped",
            picture.name,
            pair[0][1],
            pair[1][1]
        );
    }
    let delta_e: Vec<f64> = std::iter::zip(&scaled, &targets).map(|(f, t)| difference(*f, *t)).collect();
    Ok(section(placed, args, (light, clipped), (&scaled, &targets), &delta_e))
}

/// CIE 1976 L*, a*, b* of linear sRGB.
fn lab_of(rgb: [f64; 3]) -> [f64; 3] {
    lab(linear_srgb_to_xyz(rgb), Illuminant::D65.white())
}

/// Sensor metamerism index; `None` if the colours do not determine a matrix.
fn metamerism(found: &[[f64; 3]], targets: &[[f64; 3]]) -> Option<f64> {
    // White balance: the greys are neutral.
    let greys = |all: &[[f64; 3]], c: usize| all[GREYS].iter().map(|v| v[c]).sum::<f64>();
    let gains = [0, 1, 2].map(|c| greys(targets, c) / greys(found, c));
    let camera: Vec<Vec<f64>> = found.iter().map(|v| (0..3).map(|c| gains[c] * v[c]).collect()).collect();
    let rows = ColourMatrix::rows_to(&camera, targets)?;
    let error = |k: usize| {
        let fitted: [f64; 3] =
            [0, 1, 2].map(|i| std::iter::zip(&rows[i], &camera[k]).map(|(m, v)| m * v).sum());
        let (a, b) = (lab_of(fitted), lab_of(targets[k]));
        std::iter::zip(a, b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    };
    Some(100.0 - 5.5 * (0..GREYS.start).map(error).sum::<f64>() / GREYS.start as f64)
}

fn section(
    placed: &Placed<'_>,
    args: &ReportArgs,
    (light, clipped): (Illuminant, usize),
    (found, targets): (&[[f64; 3]], &[[f64; 3]]),
    delta_e: &[f64],
) -> Section {
    let mean = delta_e.iter().sum::<f64>() / delta_e.len() as f64;
    let largest = delta_e.iter().copied().fold(0.0, f64::max);
    let index = metamerism(found, targets);
    let figures = vec![
        ("colour error, mean ΔE2000".into(), format!("{mean:.2}")),
        ("colour error, largest ΔE2000".into(), format!("{largest:.2}")),
        ("sensor metamerism index".into(), shown(index, 1)),
    ];
    let plane = |all: &[[f64; 3]]| -> Vec<(f64, f64)> {
        all.iter().map(|c| lab_of(*c)).map(|[_, a, b]| (a, b)).collect()
    };
    let mut plot = Plot::new("Colours", Axis::new("a*", 0.0, 0.0), Axis::new("b*", 0.0, 0.0));
    plot.equal_scale = true;
    let (theirs, ours) = (plane(targets), plane(found));
    for (t, o) in std::iter::zip(&theirs, &ours) {
        plot.series.push(Series::line("", vec![*t, *o], Colour::Muted));
    }
    plot.series.push(Series::line("chart", theirs, Colour::Palette(1)).shaped(Shape::Dots(3.5)));
    plot.series.push(Series::line("picture", ours, Colour::Palette(0)).shaped(Shape::Dots(3.5)));
    let mut table = vec![cells([
        "patch",
        "L*",
        "a*",
        "b*",
        "L* of the chart",
        "a* of the chart",
        "b* of the chart",
        "ΔE2000",
    ])];
    for k in 0..CHECKER_PATCHES {
        let mut row = vec![checker_names()[k].clone()];
        row.extend([found[k], targets[k]].iter().flat_map(|c| lab_of(*c)).map(|v| format!("{v:.1}")));
        row.push(format!("{:.2}", delta_e[k]));
        table.push(row);
    }
    let remarks = match clipped {
        0 => Vec::new(),
        n => vec![format!("{n} patches are clipped: their colours are wrong; expose less")],
    };
    let one = |k: usize| json!({ "name": checker_names()[k], "linear_srgb": found[k], "target": targets[k], "delta_e_2000": delta_e[k] });
    Section {
        slug: "colour",
        title: "Colour",
        standard: "CIEDE2000 (ISO/CIE 11664-6) against the spectra of the chart; metamerism index after ISO 17321-1:2012, from published descriptions of it",
        picture: placed.picture.name.clone(),
        camera: None,
        figures,
        remarks,
        plots: vec![plot.figure(args.style)],
        tables: vec![table],
        json: json!({
            "light": light.name(), "mean_delta_e_2000": mean, "largest_delta_e_2000": largest, "sensor_metamerism_index": index,
            "patches": (0..CHECKER_PATCHES).map(one).collect::<Vec<_>>(),
        }),
    }
}
