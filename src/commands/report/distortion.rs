//! Geometric distortion and lateral chromatic displacement of a chart of dots (ISO 17850, ISO 19084), channel by channel.

use super::place::{Placed, Position, square};
use super::section::{Section, cells, shown};
use crate::args::ReportArgs;
use anyhow::{Context, Result, bail};
use formats::picture::plot::{Axis, Plot, Series};
use formats::picture::series::Shape;
use formats::picture::style::Colour;
use pipeline::chart::Kind;
use pipeline::measure::centroid::centroid;
use pipeline::measure::dots::{Distortion, follow};
use serde_json::json;

/// Names of the channels of a picture in colour; the second, green, is the reference.
const CHANNELS: [&str; 3] = ["red", "green", "blue"];
const GREEN: usize = 1;
/// Largest residual of the fit, RMS over the distance of dots.
const MAX_RESIDUAL: f64 = 0.02;

/// A dot: its place on the film, and in each channel of the picture.
struct Dot {
    film: Position,
    channels: Vec<Position>,
}

/// Measures the dots of the chart.
///
/// # Errors
/// Too few dots are found.
pub fn measure(placed: &Placed<'_>, args: &ReportArgs) -> Result<Section> {
    let Kind::DotGrid { width_px, .. } = placed.chart.spec().kind else {
        bail!("{} has no dots", placed.chart.spec())
    };
    let sites = placed.chart.points_px();
    let spacing = spacing(sites).context("a chart of one dot has no distortion: expected more")?;
    let mut dots: Vec<Option<Dot>> = (0..sites.len()).map(|_| None).collect();
    let mut failed = None;
    let found = follow(
        sites,
        placed.middle(),
        |p| placed.at(p),
        |k, near| {
            let scale = placed.scale(sites[k]);
            match dot(placed, near, (width_px * scale / 2.0, spacing * scale)) {
                Ok(Some(channels)) => {
                    let at = channels[GREEN.min(channels.len() - 1)];
                    dots[k] = Some(Dot { film: sites[k], channels });
                    Some(at)
                }
                Ok(None) => None,
                Err(e) => {
                    failed.get_or_insert(e);
                    None
                }
            }
        },
    );
    if let Some(e) = failed {
        return Err(e);
    }
    let missing = found.iter().filter(|f| f.is_none()).count();
    let dots: Vec<Dot> = dots.into_iter().flatten().collect();
    if dots.len() < sites.len().div_ceil(2) {
        bail!(
            "{}: {} of {} dots were found, expected at least half: the chart has other settings, or is elsewhere in the picture",
            placed.picture.name,
            dots.len(),
            sites.len()
        );
    }
    let pairs: Vec<(Position, Position)> =
        dots.iter().map(|d| (d.film, d.channels[GREEN.min(d.channels.len() - 1)])).collect();
    let fit = Distortion::fit(&pairs, placed.picture.size()).with_context(|| {
        format!(
            "{}: {} of {} dots were found, which do not determine the distortion",
            placed.picture.name,
            dots.len(),
            sites.len()
        )
    })?;
    let rms_px = (fit.residuals_px.iter().map(|r| r * r).sum::<f64>() / fit.residuals_px.len() as f64).sqrt();
    if rms_px > MAX_RESIDUAL * spacing * placed.scale(placed.middle()) {
        bail!(
            "{}: the dots are {rms_px:.2} px (RMS) from any radial distortion of the chart: it has other settings, or the picture has been cropped beside its middle",
            placed.picture.name
        );
    }
    Ok(section(placed, args, &dots, (&fit, rms_px), missing))
}

/// Least distance of neighbours, px of the film.
fn spacing(sites: &[Position]) -> Option<f64> {
    let first = sites.first()?;
    let distance = |p: &Position| (p.0 - first.0).hypot(p.1 - first.1);
    sites[1..].iter().map(distance).reduce(f64::min)
}

/// Centroids of the dark dot of `radius` near a place in each channel; `None` if there is none.
fn dot(placed: &Placed<'_>, near: Position, (radius, spacing): (f64, f64)) -> Result<Option<Vec<Position>>> {
    // Coarse, then fine: a ring of paper around the dot, and no neighbour.
    let wide = (0.45 * spacing).min(spacing - radius - 3.0).max(radius + 3.0);
    let tight = (radius * 1.3 + 6.0).min(wide);
    let size = placed.picture.size();
    let mut at = near;
    let mut channels: Vec<Position> = Vec::new();
    for half in [wide, tight, tight] {
        let half = half.floor() as usize;
        let rect = square(at, half as f64 + 2.0, size);
        // Near the border of the picture the guess is good enough for the fine search alone.
        if half > tight as usize && rect.width.min(rect.height) < 2 * half + 5 {
            continue;
        }
        let planes =
            if rect.width * rect.height == 0 { Vec::new() } else { placed.picture.channels(rect)? };
        let of = |pixels: &Vec<f32>| {
            // Dots are dark.
            let dark: Vec<f32> = pixels.iter().map(|v| -v).collect();
            centroid(&dark, rect, at, half)
        };
        let Some(found) = planes.iter().map(of).collect::<Option<Vec<_>>>().filter(|found| !found.is_empty())
        else {
            return Ok(None);
        };
        at = found[GREEN.min(found.len() - 1)];
        channels = found;
    }
    let away = (at.0 - near.0).hypot(at.1 - near.1);
    Ok((away < spacing / 2.0).then_some(channels))
}

fn section(
    placed: &Placed<'_>,
    args: &ReportArgs,
    dots: &[Dot],
    (fit, rms): (&Distortion, f64),
    missing: usize,
) -> Section {
    let green = |d: &Dot| d.channels[GREEN.min(d.channels.len() - 1)];
    // Geometric distortion of each dot itself, by its place without distortion.
    let centre = placed.picture.size();
    let centre = ((centre.height as f64 - 1.0) / 2.0, (centre.width as f64 - 1.0) / 2.0);
    let radius = |p: Position| (p.0 - centre.0).hypot(p.1 - centre.1);
    let percent = |d: &Dot| 100.0 * (radius(green(d)) / radius(fit.without_distortion(d.film)) - 1.0);
    let far = |d: &&Dot| fit.share(green(d)) > 0.05;
    let worst =
        dots.iter().filter(far).map(percent).fold(0.0, |m: f64, v| if v.abs() > m.abs() { v } else { m });
    let mut figures = vec![
        ("geometric distortion, largest (%)".into(), format!("{worst:+.3}")),
        ("distortion of the fit at the corner (%)".into(), format!("{:+.3}", 100.0 * fit.distortion(1.0))),
        ("residual of the fit, RMS (px)".into(), format!("{rms:.4}")),
        ("dots found".into(), format!("{} of {}", dots.len(), dots.len() + missing)),
    ];
    let height = || Axis::new("image height (of half the diagonal)", 0.0, 1.0);
    let mut shape = Plot::new("Geometric distortion", height(), Axis::new("distortion (%)", 0.0, 0.0));
    let points = dots.iter().filter(far).map(|d| (fit.share(green(d)), percent(d))).collect();
    shape.series.push(Series::line("dots", points, Colour::Palette(0)).shaped(Shape::Dots(2.5)));
    let curve = (0..=50)
        .map(|i| f64::from(i) / 50.0)
        .map(|u| (u * (1.0 + fit.distortion(u)), 100.0 * fit.distortion(u)));
    shape.series.push(Series::distinct("fit", curve.collect(), 1));
    let mut plots = vec![shape.figure(args.style)];
    let mut lateral_json = Vec::new();
    if dots.first().is_some_and(|d| d.channels.len() == CHANNELS.len()) {
        let mut plot = Plot::new(
            "Lateral chromatic displacement along the radius",
            height(),
            Axis::new("displacement from green (px)", 0.0, 0.0),
        );
        for channel in [0, 2] {
            let all: Vec<(f64, (f64, f64))> = dots
                .iter()
                .map(|d| (fit.share(green(d)), fit.lateral(green(d), d.channels[channel])))
                .collect();
            let largest = all.iter().map(|(_, (along, across))| along.hypot(*across)).fold(0.0, f64::max);
            figures.push((
                format!("lateral displacement, {}, largest (px)", CHANNELS[channel]),
                format!("{largest:.3}"),
            ));
            let points = all.iter().map(|(h, (along, _))| (*h, *along)).collect();
            let colour = Colour::Palette(if channel == 0 { 1 } else { 0 });
            plot.series.push(Series::line(CHANNELS[channel], points, colour).shaped(Shape::Dots(2.5)));
            lateral_json.push(json!({ "channel": CHANNELS[channel], "largest_px": largest }));
        }
        plots.push(plot.figure(args.style));
    }
    let one = |d: &Dot| json!({ "film_row": d.film.0, "film_column": d.film.1, "channels": d.channels, "distortion_percent": percent(d), "height": fit.share(green(d)) });
    let mut table = vec![cells(["image height", "distortion of the fit (%)"])];
    table.extend(
        (1..=10)
            .map(|i| f64::from(i) / 10.0)
            .map(|u| vec![shown(Some(u), 1), format!("{:+.4}", 100.0 * fit.distortion(u))]),
    );
    let remarks = match missing {
        0 => Vec::new(),
        n => vec![format!("{n} dots were not found, or are not in the picture")],
    };
    Section {
        slug: "distortion",
        title: "Distortion and lateral colour",
        standard: "after ISO 17850:2015 and ISO 19084:2015, from published descriptions of them; against a chart without distortion of the magnification in the middle, displacement, rotation and tilt fitted",
        picture: placed.picture.name.clone(),
        camera: None,
        figures,
        remarks,
        plots,
        tables: vec![table],
        json: json!({
            "largest_percent": worst, "corner_percent": 100.0 * fit.distortion(1.0), "residual_rms_px": rms, "lateral": lateral_json,
            "dots": dots.iter().map(one).collect::<Vec<_>>(), "missing": missing,
        }),
    }
}
