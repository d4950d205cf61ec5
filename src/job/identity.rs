//! Identity of a job: everything that changes pixels, as readable JSON; its digest is the job digest.

use super::depth::Depth;
use super::film::chart_units;
use super::inputs::Inputs;
use crate::args::RunArgs;
use crate::open::{Chart, is_builtin};
use anyhow::Result;
use formats::durable::is_url;
use pipeline::remap::Stages;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Version of the arithmetic: raised whenever the program computes other pixel values for the same job.
pub const NUMERIC_VERSION: u32 = 4;

/// The identity of a job with the lens `lens_name` of digest `lens_digest`.
///
/// # Errors
/// The chart's chunks cannot be listed.
pub fn identity(
    args: &RunArgs,
    stages: Stages,
    inputs: &Inputs,
    keep_bits: Option<u32>,
    (lens_name, lens_digest): (&str, &str),
) -> Result<Map<String, Value>> {
    let (content, mtimes, surfaces) = contents(&inputs.chart, inputs.depth.as_ref())?;
    let frame = &inputs.frame;
    let value = json!({
        "numeric_version": NUMERIC_VERSION,
        "chart": content,
        "chart_mtimes": mtimes,
        "chart_bands": inputs.selected_bands,
        "lens_name": lens_name,
        "lens_digest": lens_digest,
        "stages": { "ri": stages.ri, "distortion": stages.distortion, "svpsf": stages.svpsf },
        "film_size": [frame.film.height, frame.film.width],
        "film_pitch_um": frame.pitch_um,
        "axis_px": { "x": frame.axis_px.1, "y": frame.axis_px.0 },
        "scale": { "x": frame.scale.1, "y": frame.scale.0 },
        "center_mm": { "x": frame.center_mm.1, "y": frame.center_mm.0 },
        "interp": format!("{:?}", args.interp).to_lowercase(),
        "surround": format!("{:?}", args.surround).to_lowercase(),
        "outside": format!("{:?}", args.outside).to_lowercase(),
        "nan": format!("{:?}", args.nan).to_lowercase(),
        "azimuths": args.azimuths,
        "psf_window": args.psf_window,
        "interpolate_psf": args.interpolate_psf,
        "film_units": format!("{:?}", args.film_units).to_lowercase(),
        "rois": args.roi.iter().map(|r| [r.x, r.y, r.width as i64, r.height as i64]).collect::<Vec<_>>(),
    });
    let Value::Object(mut map) = value else { unreachable!("an object is written above") };
    if let Some(surfaces) = surfaces {
        map.insert("depth".into(), surfaces);
    }
    // Absent for all bits: the identity is then that of programs without this option.
    if let Some(bits) = keep_bits {
        map.insert("keep_bits".into(), bits.into());
    }
    Ok(map)
}

/// Content of the chart, modification times of all input files, and the surfaces at several distances.
///
/// # Errors
/// The chunks cannot be listed.
pub fn contents(chart: &Chart, depth: Option<&Depth>) -> Result<(Value, Value, Option<Value>)> {
    let (content, mtimes) = chart.identity()?;
    let Some(depth) = depth else { return Ok((content, mtimes, None)) };
    let (surfaces, times) = depth.identity()?;
    Ok((content, json!([mtimes, times]), Some(surfaces)))
}

/// A key of the identity or layout in the words of the command line.
pub fn argument(key: &str) -> String {
    match key {
        "chart" => "chart".into(),
        "chart_mtimes" => "modification times of the chart".into(),
        "chart_bands" => "--bands".into(),
        "lens_name" | "lens_digest" => format!("--lens ({})", key.trim_start_matches("lens_")),
        "rois" => "--roi".into(),
        "axis_px" => "--axis".into(),
        "center_mm" => "--center".into(),
        "numeric_version" => "numeric version of the program".into(),
        "units" | "wavelengths" | "outputs" => key.into(),
        other => format!("--{}", other.replace('_', "-")),
    }
}

/// Where chart and lens are, and what the chart is, for people.
pub fn source(args: &RunArgs, chart: &Chart) -> Value {
    let chart_path = match args.chart.starts_with("gen:") {
        true => args.chart.clone(),
        false => absolute(&args.chart),
    };
    let size = chart.size();
    json!({
        "chart": chart_path,
        "array": args.var,
        "chart_px": { "x": size.width, "y": size.height },
        "chart_units": chart_units(args, chart),
        "lens": if is_builtin(&args.lens) { args.lens.clone() } else { absolute(&args.lens) },
    })
}

/// The absolute path of a local file, if the current directory is known.
fn absolute(path: &str) -> String {
    match is_url(Path::new(path)) || Path::new(path).is_absolute() {
        true => path.to_owned(),
        // Not `Path::join`, which would reduce the slashes of `PATH//array`.
        false => std::env::current_dir().map_or(path.into(), |d| format!("{}/{path}", d.display())),
    }
}
