//! `lenscube measure`: edges, points, profiles and veiling glare of a film or chart, by the estimators of `validate`.
//!
//! An edge is fitted between two given positions (ISO 12233: a straight line through the centroids of the line spread functions of
//! its rows), and its pixels are averaged in bins of 1/4 px of distance. Its plateaus are the samples beyond 3/4 of the half width.
//! Doubtful figures have remarks, meaningless ones are errors ([`quality`]).

pub mod quality;

use crate::args::MeasureArgs;
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
use formats::picture::plot::{Axis, Plot, Series, stacked};
use formats::picture::style::Colour;
use pipeline::geometry::Rect;
use pipeline::measure::centroid::centroid;
use pipeline::measure::edge::{EdgeLine, Esf, fit};
use pipeline::measure::sfr::Mtf;
use quality::Remark;
use serde_json::{Value, json};
use std::fmt::Write;

/// Start of the plateau, as a share of the half width.
pub const PLATEAU: f64 = 0.75;
/// Maximum frequency of MTF plots, twice the film's Nyquist frequency.
const MAX_CY_PX: f64 = 1.0;
/// Cache of decoded chunks.
const CACHE_BYTES: usize = 256 << 20;

/// Measurement of one band.
pub struct Measurement {
    nm: f64,
    /// Figures by name.
    pub figures: Value,
    summary: String,
    /// What makes them doubtful.
    pub remarks: Vec<Remark>,
    curve: Vec<(f64, f64)>,
    /// Frequency in cycles per pixel, and modulation.
    pub mtf: Vec<(f64, f64)>,
}

/// (row, column) in pixels.
pub type Position = (f64, f64);

/// Runs the command.
pub fn command(args: &MeasureArgs) -> Result<()> {
    let outputs = [&args.csv, &args.json, &args.plot];
    outputs.into_iter().flatten().try_for_each(|path| check_absent(path, args.overwrite))?;
    let chart = open::chart(&args.film, args.wavelengths.as_deref(), NanPolicy::Keep, CACHE_BYTES)?;
    let all_nm = chart.wavelengths_nm()?;
    let bands = match args.band {
        Some(nm) => vec![nearest_band(&all_nm, nm)?],
        None => (0..all_nm.len()).collect(),
    };
    let mut measured = Vec::new();
    for band in bands {
        let (nm, shown) = (all_nm[band], number(all_nm[band]));
        let one = measure(args, &chart, band, nm)
            .with_context(|| format!("measuring {} at {shown} nm", args.film))?;
        print(format!("{shown} nm: {}", one.summary));
        for remark in &one.remarks {
            print(format!("{shown} nm: DOUBTFUL: {}", remark.text));
        }
        measured.push(one);
    }
    let mut files = Vec::new();
    if let Some(path) = &args.csv {
        files.push(AtomicFile::with_text(path, &csv(args, &measured))?);
    }
    if let Some(path) = &args.json {
        let bands: Vec<Value> = measured
            .iter()
            .map(|m| json!({ "wavelength_nm": m.nm, "figures": m.figures, "curve": m.curve, "mtf": m.mtf }))
            .collect();
        let all = json!({ "film": args.film, "bands": bands });
        files.push(AtomicFile::with_text(path, &(serde_json::to_string_pretty(&all)? + "\n"))?);
    }
    if let Some(path) = &args.plot {
        files.push(figure(args, &measured, chart.pitch_um()).file(path)?);
    }
    Ok(finish_together(files)?)
}

fn measure(args: &MeasureArgs, chart: &Chart, band: usize, nm: f64) -> Result<Measurement> {
    let half = args.half_px as usize;
    if let Some([x0, y0, x1, y1]) = args.edge {
        return edge(chart, band, nm, ((y0, x0), (y1, x1)), half);
    }
    if let Some([x0, y0, x1, y1]) = args.profile {
        return profile(chart, band, nm, ((y0, x0), (y1, x1)));
    }
    if let Some((black, white)) = args.glare.zip(args.white_area) {
        return glare(chart, band, nm, (black, white));
    }
    points(chart, band, nm, args.points.iter().flat_map(|p| &p.0), half)
}

/// Pixels of a rectangle, which must be inside the film.
fn read(chart: &Chart, band: usize, rect: Rect, what: &str) -> Result<Vec<f32>> {
    let size = chart.size();
    if !size.rect().contains(rect) {
        return Err(usage(format!(
            "{what} needs {rect}, which is not inside the image of {size}; give other positions or a smaller --half-px"
        )));
    }
    let mut pixels = vec![0f32; rect.size().pixels()];
    chart.source().read(band, rect, &mut pixels).map_err(anyhow::Error::from_boxed)?;
    match pixels.iter().position(|v| !v.is_finite()) {
        None => Ok(pixels),
        Some(i) => anyhow::bail!(
            "row {}, column {} is {}: the film is not complete; finish its run first",
            rect.y + (i / rect.width) as i64,
            rect.x + (i % rect.width) as i64,
            pixels[i]
        ),
    }
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
    let pixels = read(chart, band, rect, "the edge")?;
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
        nm,
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

/// Mean and standard deviation of the pixels of `rect`.
fn statistics(chart: &Chart, band: usize, rect: Rect, what: &str) -> Result<(f64, f64)> {
    let pixels = read(chart, band, rect, what)?;
    let n = pixels.len() as f64;
    let mean = pixels.iter().map(|v| f64::from(*v)).sum::<f64>() / n;
    let variance = pixels.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / n;
    Ok((mean, variance.sqrt()))
}

/// Veiling glare index: the mean of a black area over that of a white one, ISO 9358. In dB as a ratio of signals, 20 log₁₀.
fn glare(chart: &Chart, band: usize, nm: f64, (black, white): (Rect, Rect)) -> Result<Measurement> {
    let (of_black, black_deviation) = statistics(chart, band, black, "the black area")?;
    let (of_white, white_deviation) = statistics(chart, band, white, "the white area")?;
    if of_white <= 0.0 {
        anyhow::bail!("--white-area {white}: its mean is {of_white}, expected light");
    }
    let index = of_black / of_white;
    let attenuation_db = (index > 0.0).then(|| -20.0 * index.log10());
    let in_db = attenuation_db.map_or(String::new(), |db| format!(" (-{db:.2} dB)"));
    Ok(Measurement {
        nm,
        summary: format!(
            "veiling glare index {:.4} %{in_db}: black {of_black:.6e}, standard deviation {black_deviation:.2e}; white {of_white:.6e}, {white_deviation:.2e}",
            100.0 * index
        ),
        figures: json!({
            "veiling_glare_index": index, "attenuation_db": attenuation_db,
            "black": of_black, "black_deviation": black_deviation,
            "white": of_white, "white_deviation": white_deviation,
        }),
        remarks: Vec::new(),
        curve: Vec::new(),
        mtf: Vec::new(),
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
        let pixels = read(chart, band, rect, "a point")?;
        let found = centroid(&pixels, rect, (row, col), half);
        centroids.push(found.with_context(|| {
            format!("no point near {col},{row}: the values there do not exceed the background")
        })?);
    }
    let summary: Vec<String> = centroids.iter().map(|(y, x)| format!("{x:.4},{y:.4}")).collect();
    let figures: Vec<Value> = centroids.iter().map(|(y, x)| json!({ "row": y, "column": x })).collect();
    let curve = centroids.iter().map(|(y, x)| (*x, *y)).collect();
    let summary = summary.join("; ");
    Ok(Measurement { nm, figures: json!(figures), summary, remarks: Vec::new(), curve, mtf: Vec::new() })
}

fn profile(chart: &Chart, band: usize, nm: f64, (a, b): (Position, Position)) -> Result<Measurement> {
    let rect = bounding_rect([a, b], 0);
    let pixels = read(chart, band, rect, "the profile")?;
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
        nm,
        summary: format!("{} values, {low:.6} to {high:.6}, mean {mean:.6}", curve.len()),
        figures: json!({ "least": low, "most": high, "mean": mean }),
        remarks: Vec::new(),
        curve,
        mtf: Vec::new(),
    })
}

fn csv(args: &MeasureArgs, measured: &[Measurement]) -> String {
    let columns = match (args.edge.is_some(), args.points.is_some()) {
        (true, _) => "distance_px,edge_spread",
        (_, true) => "column,row",
        _ => "distance_px,value",
    };
    let mut text = format!("wavelength_nm,{columns}\n");
    for m in measured {
        for (x, y) in &m.curve {
            // Writing to a String cannot fail.
            let _ = writeln!(text, "{},{x:.6},{y:.8}", m.nm);
        }
    }
    text
}

/// Edge spread function and MTF of an edge, or values along a line. `pitch_um`: pixel pitch, if known.
fn figure(args: &MeasureArgs, measured: &[Measurement], pitch_um: Option<f64>) -> Figure {
    let nm: Vec<f64> = measured.iter().map(|m| m.nm).collect();
    let plot =
        |x: Axis, y: Axis, top: Option<(String, f64)>, curve: &dyn Fn(&Measurement) -> Vec<(f64, f64)>| {
            let series = measured.iter().enumerate().map(|(i, m)| band_series(&nm, i, curve(m))).collect();
            Plot { series, top, key: band_key(&nm), ..Plot::new("", x, y) }
        };
    let um = |name: &str| pitch_um.map(|pitch| (format!("{name} (µm)"), pitch));
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
