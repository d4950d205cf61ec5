//! `lenscube measure`: edges, points and profiles of a film or chart, by the estimators of `validate`; veiling glare and flare, also of raws ([`mod@light`]).
//!
//! An edge is fitted between two given positions (ISO 12233: a straight line through the centroids of the line spread functions of
//! its rows), and its pixels are averaged in bins of 1/4 px of distance. Its plateaus are the samples beyond 3/4 of the half width.
//! Doubtful figures have remarks, meaningless ones are errors ([`quality`]).

pub mod edge_mtf;
pub mod light;
mod measurement;
pub mod plane;
pub mod quality;

use crate::args::MeasureArgs;
use crate::camera::frame::{Frame, split_group};
use crate::failure::usage;
use crate::open::{self, Chart};
use crate::outputs::check_absent;
use crate::progress::{number, print};
use anyhow::{Context, Result};
use formats::chart::NanPolicy;
use formats::durable::{AtomicFile, finish_together};
use formats::picture::bands::{band_key, band_series};
use formats::picture::figure::Figure;
use formats::picture::nearest_band;
use formats::picture::plot::{Axis, Legend, Plot, Series, stacked};
use formats::picture::style::Colour;
use formats::raw::{RawSpec, RawStore};
use light::{FlareMap, Lamp};
pub use measurement::Measurement;
use pipeline::geometry::Rect;
use pipeline::measure::centroid::centroid;
use pipeline::measure::edge::{EdgeLine, Esf, fit};
use pipeline::measure::sfr::Mtf;
use plane::{Name, Plane, read};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;

/// Start of the plateau, as a share of the half width.
pub const PLATEAU: f64 = 0.75;
/// What to give where the region around an edge or a point is not inside the image.
const SMALLER_REGION: &str = "other positions or a smaller --half-px";
/// Maximum frequency of MTF plots, twice the film's Nyquist frequency.
const MAX_CY_PX: f64 = 1.0;
/// Cache of decoded chunks.
const CACHE_BYTES: usize = 256 << 20;

/// (row, column) in pixels.
pub type Position = (f64, f64);

/// Runs the command.
///
/// # Errors
/// The film cannot be read; what is asked for is not there, or cannot be measured.
pub fn command(args: &MeasureArgs) -> Result<()> {
    let outputs = [&args.csv, &args.json, &args.plot, &args.map];
    outputs.into_iter().flatten().try_for_each(|path| check_absent(path, args.overwrite))?;
    let is_light = args.glare.is_some() || args.flare.is_some();
    let mut map = None;
    let (measured, pitch_um) = match is_light && is_raw(&args.film) {
        true => of_raw(args, &mut map)?,
        false => of_chart(args, &mut map)?,
    };
    let mut files = Vec::new();
    if let Some(path) = &args.csv {
        files.push(AtomicFile::with_text(path, &csv(args, &measured))?);
    }
    if let Some(path) = &args.json {
        let one = |m: &Measurement| {
            let (key, name) = m.name.json();
            json!({ key: name, "figures": m.figures, "curve": m.curve, "mtf": m.mtf })
        };
        let all = json!({ "film": args.film, "bands": measured.iter().map(one).collect::<Vec<_>>() });
        files.push(AtomicFile::with_text(path, &(serde_json::to_string_pretty(&all)? + "\n"))?);
    }
    if let Some(path) = &args.plot {
        files.push(figure(args, &measured, pitch_um).file(path)?);
    }
    if let Some((path, map)) = args.map.as_ref().zip(map) {
        files.push(map.image().png_file(path, &map.caption())?);
    }
    Ok(finish_together(files)?)
}

/// Whether `name` is a raw.
fn is_raw(name: &str) -> bool {
    !name.starts_with("gen:") && RawStore::is_one(Path::new(split_group(name).0)).unwrap_or(false)
}

/// Fails if a map of several bands or colours is asked for.
fn check_map(args: &MeasureArgs, what: &str, count: usize) -> Result<()> {
    match args.map.is_some() && count > 1 {
        true => Err(usage(format!("--map shows one of them, {} has {count} {what}", args.film))),
        false => Ok(()),
    }
}

/// Measurements of the bands of a film or chart, and its pixel pitch if it is known.
fn of_chart(args: &MeasureArgs, map: &mut Option<FlareMap>) -> Result<(Vec<Measurement>, Option<f64>)> {
    if args.frame != 0 {
        return Err(usage(format!("--frame {}: {} is not a raw", args.frame, args.film)));
    }
    let chart = open::chart(&args.film, args.wavelengths.as_deref(), NanPolicy::Keep, CACHE_BYTES)?;
    let all_nm = chart.wavelengths_nm()?;
    let bands = match args.band {
        Some(nm) => vec![nearest_band(&all_nm, nm)?],
        None => (0..all_nm.len()).collect(),
    };
    check_map(args, "bands; give --band", bands.len())?;
    let one = |band: usize| {
        let nm = all_nm[band];
        let plane = Plane::Band(&chart, band);
        let measured = match light(args, &plane, Name::Band(nm), map) {
            Some(measured) => measured,
            None => measure(args, &chart, band, nm),
        };
        measured.with_context(|| format!("measuring {} at {} nm", args.film, number(nm)))
    };
    Ok((printed(bands.into_iter().map(one))?, chart.pitch_um()))
}

/// Measurements of the colours of a raw, and its pixel pitch.
fn of_raw(args: &MeasureArgs, map: &mut Option<FlareMap>) -> Result<(Vec<Measurement>, Option<f64>)> {
    if args.band.is_some() || args.wavelengths.is_some() {
        return Err(usage(format!("--band and --wavelengths: {} is a raw, which has colours", args.film)));
    }
    let chunk = RawSpec::chunk_shape();
    let width = Frame::open(&args.film, args.frame, 0)?.rect.width;
    let frame = Frame::open(&args.film, args.frame, 2 * 4 * chunk.0 * width.next_multiple_of(chunk.1))?;
    let names: Vec<String> = frame.sensor.planes().iter().map(|name| (*name).to_owned()).collect();
    check_map(args, "colours", names.len())?;
    let one = |(plane, name): (usize, &String)| {
        let measured = light(args, &Plane::Raw(&frame, plane), Name::Plane(name.clone()), map);
        measured
            .context("only light is measured in raws")?
            .with_context(|| format!("measuring plane {name} of {}", args.film))
    };
    let pitch_um = Some(frame.spec.pitch_um);
    Ok((printed(names.iter().enumerate().map(one))?, pitch_um))
}

/// Prints each measurement as it is made, with its remarks.
fn printed(all: impl Iterator<Item = Result<Measurement>>) -> Result<Vec<Measurement>> {
    let print_one = |measured: Result<Measurement>| {
        let one = measured?;
        print(format!("{}: {}", one.name, one.summary));
        for remark in &one.remarks {
            print(format!("{}: DOUBTFUL: {}", one.name, remark.text));
        }
        Ok(one)
    };
    all.map(print_one).collect()
}

/// Veiling glare or flare, if one of them is asked for.
fn light(
    args: &MeasureArgs,
    plane: &Plane<'_>,
    name: Name,
    map: &mut Option<FlareMap>,
) -> Option<Result<Measurement>> {
    if let Some((black, white)) = args.glare.zip(args.white_area) {
        return Some(light::glare(plane, name, (black, white)));
    }
    let (x, y, radius_px) = args.flare?;
    if args.map.is_some() {
        *map = Some(FlareMap::new(plane.size()));
    }
    Some(light::flare(plane, name, Lamp { centre_px: (y, x), radius_px }, args.white_area, map.as_mut()))
}

fn measure(args: &MeasureArgs, chart: &Chart, band: usize, nm: f64) -> Result<Measurement> {
    let half = args.half_px as usize;
    if let Some([x0, y0, x1, y1]) = args.edge {
        return edge(chart, band, nm, ((y0, x0), (y1, x1)), half);
    }
    if let Some([x0, y0, x1, y1]) = args.profile {
        return profile(chart, band, nm, ((y0, x0), (y1, x1)));
    }
    points(chart, band, nm, args.points.iter().flat_map(|p| &p.0), half)
}

/// Pixels around two positions, `margin` larger on every side.
fn bounding_rect([a, b]: [Position; 2], margin: usize) -> Rect {
    let (y0, y1) = (a.0.min(b.0).floor() as i64, a.0.max(b.0).ceil() as i64);
    let (x0, x1) = (a.1.min(b.1).floor() as i64, a.1.max(b.1).ceil() as i64);
    Rect::new(y0, x0, (y1 - y0 + 1) as usize, (x1 - x0 + 1) as usize).grown(margin)
}

/// The line through two positions (row, column), the pixels around it and its length, px.
pub fn edge_region(a: Position, b: Position, half: usize) -> (EdgeLine, Rect, f64) {
    let guess = EdgeLine::through(a, b);
    // Enlarged across the edge only: beyond its ends there may be other objects.
    let upright = guess.normal_rad.cos().abs() >= guess.normal_rad.sin().abs();
    let (ends, wide) = (bounding_rect([a, b], 0), bounding_rect([a, b], half + 2));
    let rect = match upright {
        true => Rect::new(ends.y, wide.x, ends.height, wide.width),
        false => Rect::new(wide.y, ends.x, wide.height, ends.width),
    };
    (guess, rect, (b.0 - a.0).hypot(b.1 - a.1))
}

/// The edge between two positions.
///
/// # Errors
/// The positions are not on an edge that can be measured; the film is not complete.
pub fn edge(
    chart: &Chart,
    band: usize,
    nm: f64,
    (a, b): (Position, Position),
    half: usize,
) -> Result<Measurement> {
    let (guess, rect, length) = edge_region(a, b, half);
    quality::check_length(length)?;
    let pixels = read(chart, band, rect, "the edge", SMALLER_REGION)?;
    let line = fit(&pixels, rect, guess, half)
        .context("no edge found between these positions; give positions on the edge, farther apart")?;
    quality::check_place(guess, line, half)?;
    let (sin, cos) = line.normal_rad.sin_cos();
    let middle = ((a.0 + b.0) / 2.0, (a.1 + b.1) / 2.0);
    let distance = |y: i64, x: i64| {
        let at = (y as f64, x as f64);
        let along = (at.0 - middle.0) * cos - (at.1 - middle.1) * sin;
        (along.abs() <= length / 2.0).then(|| line.distance(at))
    };
    let reach = half as f64 - 1.0;
    let raw = Esf::new(&pixels, rect, reach, distance)?;
    let plateaus = raw.plateaus(PLATEAU * reach);
    let esf = raw.normalised(PLATEAU * reach)?;
    let remarks = quality::remarks(line, plateaus, &esf, PLATEAU * reach)?;
    let mtf = Mtf::from_esf(&esf);
    let crossing = |level: f64| {
        let pair = esf.samples.windows(2).find(|w| w[0].value < level && w[1].value >= level)?;
        let t = (level - pair[0].value) / (pair[1].value - pair[0].value);
        Some(pair[0].distance_px + t * (pair[1].distance_px - pair[0].distance_px))
    };
    let rise = crossing(0.1).zip(crossing(0.9)).map(|(a, b)| b - a);
    let (angle, mtf50) = (line.normal_rad.to_degrees(), mtf.mtf50_cy_px());
    let per_mm = chart.pitch_um().map(|pitch_um| 1e3 / pitch_um);
    let mtf50_lp_mm = mtf50.zip(per_mm).map(|(f, per_mm)| f * per_mm);
    let in_lp_mm = mtf50_lp_mm.map_or(String::new(), |v| format!(" ({v:.2} lp/mm)"));
    let number = |v: Option<f64>| v.map_or("none".into(), |v| format!("{v:.4}"));
    Ok(Measurement {
        name: Name::Band(nm),
        summary: format!(
            "edge through row {:.3}, column {:.3}, normal {angle:.3} deg; 10-90 % rise {} px, MTF50 {} cycles/px{in_lp_mm}",
            line.at_px.0,
            line.at_px.1,
            number(rise),
            number(mtf50)
        ),
        figures: json!({
            "row": line.at_px.0, "column": line.at_px.1, "normal_deg": angle,
            "rise_10_90_px": rise, "mtf50_cy_px": mtf50, "mtf50_lp_mm": mtf50_lp_mm, "remarks": quality::names(&remarks),
        }),
        remarks,
        curve: esf.samples.iter().map(|s| (s.distance_px, s.value)).collect(),
        mtf: mtf.frequency_cy_px.iter().copied().zip(mtf.modulation.iter().copied()).collect(),
    })
}

fn points<'a>(
    chart: &Chart,
    band: usize,
    nm: f64,
    positions: impl Iterator<Item = &'a Position>,
    half: usize,
) -> Result<Measurement> {
    let mut centroids = Vec::new();
    for &(row, col) in positions {
        let rect = bounding_rect([(row.round(), col.round()); 2], half);
        let pixels = read(chart, band, rect, "a point", SMALLER_REGION)?;
        let found = centroid(&pixels, rect, (row, col), half);
        centroids.push(found.with_context(|| {
            format!("no point near {col},{row}: the values there do not exceed the background")
        })?);
    }
    let summary: Vec<String> = centroids.iter().map(|(y, x)| format!("{x:.4},{y:.4}")).collect();
    let figures: Vec<Value> = centroids.iter().map(|(y, x)| json!({ "row": y, "column": x })).collect();
    let curve = centroids.iter().map(|(y, x)| (*x, *y)).collect();
    let summary = summary.join("; ");
    Ok(Measurement {
        name: Name::Band(nm),
        figures: json!(figures),
        summary,
        remarks: Vec::new(),
        curve,
        mtf: Vec::new(),
    })
}

fn profile(chart: &Chart, band: usize, nm: f64, (a, b): (Position, Position)) -> Result<Measurement> {
    let rect = bounding_rect([a, b], 0);
    let pixels = read(chart, band, rect, "the profile", "other positions")?;
    let length = (b.0 - a.0).hypot(b.1 - a.1);
    let value = |(y, x): (f64, f64)| {
        let (y, x) = (y - rect.y as f64, x - rect.x as f64);
        let (i, j) = (y.floor() as usize, x.floor() as usize);
        let at = |i: usize, j: usize| {
            f64::from(pixels[i.min(rect.height - 1) * rect.width + j.min(rect.width - 1)])
        };
        let (fy, fx) = (y - y.floor(), x - x.floor());
        (1.0 - fy) * ((1.0 - fx) * at(i, j) + fx * at(i, j + 1))
            + fy * ((1.0 - fx) * at(i + 1, j) + fx * at(i + 1, j + 1))
    };
    let steps = length.floor() as usize;
    let curve: Vec<(f64, f64)> = (0..=steps)
        .map(|i| {
            let t = i as f64 / length;
            (i as f64, value((a.0 + t * (b.0 - a.0), a.1 + t * (b.1 - a.1))))
        })
        .collect();
    let (low, high) = curve.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p.1), h.max(p.1)));
    let mean = curve.iter().map(|p| p.1).sum::<f64>() / curve.len() as f64;
    Ok(Measurement {
        name: Name::Band(nm),
        summary: format!("{} values, {low:.6} to {high:.6}, mean {mean:.6}", curve.len()),
        figures: json!({ "least": low, "most": high, "mean": mean }),
        remarks: Vec::new(),
        curve,
        mtf: Vec::new(),
    })
}

fn csv(args: &MeasureArgs, measured: &[Measurement]) -> String {
    let columns = match () {
        () if args.edge.is_some() => "distance_px,edge_spread",
        () if args.points.is_some() => "column,row",
        () if args.flare.is_some() => "distance_px,normalised_flare",
        () => "distance_px,value",
    };
    let key = measured.first().map_or("wavelength_nm", |m| m.name.json().0);
    let mut text = format!("{key},{columns}\n");
    for m in measured {
        for (x, y) in &m.curve {
            // Writing to a String cannot fail.
            let _ = match args.flare {
                None => writeln!(text, "{},{x:.6},{y:.8}", m.name.csv()),
                Some(_) => writeln!(text, "{},{x:.6},{y:.6e}", m.name.csv()),
            };
        }
    }
    text
}

/// Edge spread function and MTF of an edge, or values along a line. `pitch_um`: pixel pitch, if known.
fn figure(args: &MeasureArgs, measured: &[Measurement], pitch_um: Option<f64>) -> Figure {
    let nm: Vec<f64> = measured.iter().map(|m| m.name.nm()).collect();
    let series = |i: usize, points| match &measured[i].name {
        Name::Band(_) => band_series(&nm, i, points),
        Name::Plane(name) => Series::distinct(name, points, i),
    };
    let key = || match measured.first().map(|m| &m.name) {
        Some(Name::Plane(_)) => Legend::Names,
        _ => band_key(&nm),
    };
    let plot =
        |x: Axis, y: Axis, top: Option<(String, f64)>, curve: &dyn Fn(&Measurement) -> Vec<(f64, f64)>| {
            let series = measured.iter().enumerate().map(|(i, m)| series(i, curve(m))).collect();
            Plot { series, top, key: key(), ..Plot::new("", x, y) }
        };
    let um = |name: &str| pitch_um.map(|pitch| (format!("{name} (µm)"), pitch));
    if args.flare.is_some() {
        let axis = Axis::new("distance from the lamp (px)", 0.0, 0.0);
        let value = Axis::new("normalised flare (dB)", 0.0, 0.0);
        let in_db = |m: &Measurement| {
            let lit = m.curve.iter().filter(|(_, flare)| *flare > 0.0);
            lit.map(|(px, flare)| (*px, 20.0 * flare.log10())).collect::<Vec<_>>()
        };
        let profile = plot(axis, value, um("distance from the lamp"), &in_db);
        return stacked("Flare of a lamp", &[profile], args.style);
    }
    if args.edge.is_none() {
        let axis = Axis::new("distance along the line (px)", 0.0, 0.0);
        let value = Axis::new("value", 0.0, 0.0);
        let profile = plot(axis, value, um("distance along the line"), &|f| f.curve.clone());
        return stacked("Profile", &[profile], args.style);
    }
    let axis = Axis::new("distance from the edge (px)", 0.0, 0.0);
    let spread = Axis::new("edge spread function", -0.05, 1.05);
    let esf = plot(axis, spread, um("distance from the edge"), &|f| f.curve.clone());
    let (axis, top, lp_mm) = frequency_axes(pitch_um);
    let scaled = |m: &Measurement| {
        let shown = m.mtf.iter().take_while(|p| p.0 <= MAX_CY_PX);
        shown.map(|(f, m)| (f * lp_mm, *m)).collect::<Vec<_>>()
    };
    let mut mtf = plot(axis, Axis::new("MTF", 0.0, 1.05), top, &scaled);
    mtf.series.push(Series::line("", vec![(0.5 * lp_mm, 0.0), (0.5 * lp_mm, 1.05)], Colour::Muted).dashed(2));
    stacked("Edge spread function and MTF (dotted: Nyquist frequency)", &[esf, mtf], args.style)
}

/// Frequency axes: lp/mm below and cycles/px above if the pitch is known, else cycles/px below; and the units of the lower axis
/// per cycle/px.
pub fn frequency_axes(pitch_um: Option<f64>) -> (Axis, Option<(String, f64)>, f64) {
    let name = "spatial frequency";
    match pitch_um {
        None => (Axis::new(format!("{name} (cycles/px)"), 0.0, 0.0), None, 1.0),
        Some(pitch) => {
            let lp_mm = 1e3 / pitch;
            let top = Some((format!("{name} (cycles/px)"), 1.0 / lp_mm));
            (Axis::new(format!("{name} (lp/mm)"), 0.0, 0.0), top, lp_mm)
        }
    }
}
