//! `lenscube chart`: writes a generated chart, or a chart made from a picture or of one that moves, to a store.

pub mod image;
mod motion;

use crate::args::{ChartArgs, ChartCommand, GeneratedArgs, size_order_note};
use crate::failure::{other_job, usage};
use crate::machine::threads;
use crate::progress::{counting, data_size, log_line, plural};
use anyhow::Result;
use formats::chart::{ChartMeta, Codec, NewChart, SurfaceArray, WriteError, write_surfaces};
use pipeline::chart::{ChartSpec, Generator, Kind, ScenePart};
use serde_json::Map;
use std::path::Path;

/// Runs the command.
pub fn command(args: &ChartArgs) -> Result<()> {
    match (&args.convert, &args.generated) {
        (Some(ChartCommand::Image(args)), _) => image::command(args),
        (Some(ChartCommand::Motion(args)), _) => motion::command(args),
        (None, Some(args)) => draw(args),
        (None, None) => Err(usage(
            "a kind of chart, or `image` and a picture, or `motion` and a chart, is required; see `lenscube chart --help`",
        )),
    }
}

fn draw(args: &GeneratedArgs) -> Result<()> {
    let mut spec = ChartSpec::new(Kind::named(&args.kind).map_err(|e| usage(e.to_string()))?);
    let settings = [
        ("size", &args.size),
        ("wavelengths", &args.wavelengths),
        ("pitch_um", &args.pitch_um),
        ("overscan", &args.overscan),
        ("illuminant", &args.illuminant),
        ("value", &args.value),
        ("count", &args.count),
        ("blob", &args.blob),
        ("width_px", &args.width_px),
        ("angle_deg", &args.angle_deg),
        ("contrast", &args.contrast),
        ("grid", &args.grid),
        ("centers", &args.centers),
        ("patch_px", &args.patch_px),
        ("spokes", &args.spokes),
        ("profile", &args.profile),
        ("seed", &args.seed),
        ("r_min_px", &args.r_min_px),
        ("r_max_px", &args.r_max_px),
        ("patches", &args.patches),
        ("density", &args.density),
        ("spots", &args.spots),
        ("diameter", &args.diameter),
        ("radius", &args.radius),
        ("x", &args.x),
        ("y", &args.y),
        ("noise", &args.noise),
        ("fiducials", &args.fiducials),
        ("near_m", &args.near_m),
        ("far_m", &args.far_m),
    ];
    for (key, value) in settings {
        if let Some(value) = value {
            let flag = key.replace('_', "-");
            spec.set(key, value).map_err(|e| usage(format!("--{flag} {value}: {e}")))?;
        }
    }
    if let Some(note) = size_order_note("--film-size", spec.film) {
        log_line(format!("note: {note}"));
    }
    let chart = Generator::new(spec).map_err(|e| usage(e.to_string()))?;
    write(&chart, &args.out, args.codec, threads(args.threads), args.overwrite)
}

/// Writes a generated chart to a store at `out`.
pub fn write(chart: &Generator, out: &Path, codec: Codec, threads: usize, overwrite: bool) -> Result<()> {
    let mut attributes = Map::new();
    attributes.insert("chart".into(), chart.spec().to_string().into());
    attributes.insert("program".into(), concat!("lenscube ", env!("CARGO_PKG_VERSION")).into());
    let meta = ChartMeta {
        wavelengths_nm: chart.wavelengths_nm().to_vec(),
        pitch_um: Some(chart.pitch_um()),
        film_size: Some(chart.film_size()),
        units: Some(chart.units().to_owned()),
        attributes,
    };
    let parts = if chart.spec().has_depth() { &SURFACE_ARRAYS[..] } else { &[] };
    let parts = parts.iter().filter_map(|(name, part)| Some((*name, chart.spec().scene_part(*part)?)));
    let parts: Vec<(&str, Generator)> = parts
        .map(|(name, spec)| Ok((name, Generator::new(spec)?)))
        .collect::<Result<_, pipeline::chart::ChartError>>()?;
    let surfaces: Vec<SurfaceArray<'_>> = parts
        .iter()
        .map(|(name, source)| {
            let has_bands = source.units() == chart.units();
            SurfaceArray { name, source, has_bands, units: source.units() }
        })
        .collect();
    store(&NewChart { source: chart, meta: &meta, surfaces: &surfaces }, out, codec, threads, overwrite)
}

/// Arrays of a depth scene beside its chart.
const SURFACE_ARRAYS: [(&str, ScenePart); 4] = [
    ("depth", ScenePart::Depth),
    ("coverage", ScenePart::Coverage),
    ("hidden/1/chart", ScenePart::Hidden),
    ("hidden/1/depth", ScenePart::HiddenDepth),
];

/// Writes a chart and prints a summary.
fn store(chart: &NewChart<'_>, out: &Path, codec: Codec, threads: usize, overwrite: bool) -> Result<()> {
    let (bar, progress) = counting("drawing");
    let result = write_surfaces(out, chart, codec, threads, overwrite, &progress);
    bar.finish_and_clear();
    let report = result.map_err(|e| match e {
        WriteError::Exists { .. } => other_job(format!("{e}, or replace it with --overwrite")),
        e => e.into(),
    })?;
    let NewChart { source, meta, surfaces } = chart;
    let with = if surfaces.is_empty() { "" } else { ", with distances and hidden surfaces" };
    log_line(format!(
        "{}: {} of {} px for a film of {}{with}, {}, {}",
        out.display(),
        plural(meta.wavelengths_nm.len(), "band"),
        source.size(),
        meta.film_size.unwrap_or(source.size()),
        plural(report.shards, "shard"),
        data_size(report.bytes)
    ));
    Ok(())
}
