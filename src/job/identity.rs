//! Identity of a job: everything that changes pixels, as readable JSON; its digest is the job digest.

use super::depth::Depth;
use super::film::chart_units;
use super::inputs::Inputs;
use super::keys::{DIGEST, FileState, MTIMES, SAMPLE};
use super::numeric_version::numeric_version;
use super::own_layers;
use super::tails::TAIL_LAYER_VERSION;
use crate::args::{CoatingsArg, RunArgs};
use crate::open::{Chart, is_builtin};
use anyhow::Result;
use formats::durable::is_url;
use formats::object;
use pipeline::stage::Stages;
use pipeline::stages::DESCRIPTIONS;
use serde_json::{Map, Value, json};
use std::path::Path;

/// Version of the kernels that are made from coarse samples ([`pipeline::psf::coarse`]).
pub const KERNELS_VERSION: (&str, u32) = ("kernels_version", 2);

/// What is in an identity only where a film has it.
#[derive(Clone, Copy, Debug)]
pub struct Effects {
    /// Bits that its values keep.
    pub keep_bits: Option<u32>,
    /// Whether it has the tails of PSFs.
    pub has_tails: bool,
    /// Whether the kernels of a band are made from coarse samples.
    pub is_coarse: bool,
}

/// The identity of a job with the lens `lens_name` of digest `lens_digest`.
///
/// # Errors
/// The chart's chunks cannot be listed; its files cannot be read.
pub fn identity(
    args: &RunArgs,
    stages: Stages,
    inputs: &Inputs,
    Effects { keep_bits, has_tails, is_coarse }: Effects,
    (lens_name, lens_digest): (&str, &str),
    state: FileState,
) -> Result<Map<String, Value>> {
    // Before the times: the files that were read are those that were opened.
    let sample = match state {
        FileState::TimesAndSample => sample(inputs)?,
        FileState::Times | FileState::Digest => None,
    };
    let Contents { content, files: (key, files), surfaces } =
        contents(&inputs.chart, inputs.depth.as_ref(), state == FileState::Digest)?;
    let frame = &inputs.frame;
    let mut map = object! {
        "numeric_version": numeric_version(surfaces.is_some()),
        "chart": content,
        key: files,
        "chart_bands": inputs.selected_bands,
        "lens_name": lens_name,
        "lens_digest": lens_digest,
        "stages": named_stages(stages),
        "film_size": [frame.film.height, frame.film.width],
        "film_pitch_um": frame.pitch_um,
        "axis_px": json!({ "x": frame.axis_px.1, "y": frame.axis_px.0 }),
        "scale": json!({ "x": frame.scale.1, "y": frame.scale.0 }),
        "center_mm": json!({ "x": frame.center_mm.1, "y": frame.center_mm.0 }),
        "interp": format!("{:?}", args.interp).to_lowercase(),
        "surround": format!("{:?}", args.surround).to_lowercase(),
        "outside": format!("{:?}", args.outside).to_lowercase(),
        "nan": format!("{:?}", args.nan).to_lowercase(),
        "azimuths": args.azimuths,
        "psf_window": args.psf_window,
        "interpolate_psf": args.interpolate_psf,
        "film_units": format!("{:?}", args.film_units).to_lowercase(),
        "rois": args.roi.iter().map(|r| [r.x, r.y, r.width as i64, r.height as i64]).collect::<Vec<_>>(),
    };
    if let Some(surfaces) = surfaces {
        map.insert("depth".into(), surfaces);
    }
    if let Some(sample) = sample {
        map.insert(SAMPLE.into(), sample);
    }
    // Absent without tails: the identity is then that of programs without them.
    if has_tails {
        map.insert("tails".into(), true.into());
        map.insert(TAIL_LAYER_VERSION.0.into(), TAIL_LAYER_VERSION.1.into());
    }
    if is_coarse {
        map.insert(KERNELS_VERSION.0.into(), KERNELS_VERSION.1.into());
    }
    map.extend(own_layers::identity(args, inputs));
    if let Some(bands) = args.tracing.integrated_bands() {
        map.insert("band_samples".into(), json!({ "count": bands.count, "width_nm": bands.width_nm }));
    }
    // Absent for all bits: the identity is then that of programs without this option.
    if let Some(bits) = keep_bits {
        map.insert("keep_bits".into(), bits.into());
    }
    Ok(map)
}

/// Digests of samples of the bytes of the input files; none of what is drawn, and of objects at URLs.
fn sample(inputs: &Inputs) -> Result<Option<Value>> {
    let mut samples = vec![inputs.chart.content_sample()?];
    if let Some(depth) = &inputs.depth {
        samples.extend(depth.content_samples()?);
    }
    let has_any = samples.iter().any(|sample| !sample.is_null());
    Ok(has_any.then(|| if let [only] = &samples[..] { only.clone() } else { json!(samples) }))
}

/// Each stage by its name: true where it is applied.
fn named_stages(stages: Stages) -> Value {
    let named = DESCRIPTIONS.iter().filter(|d| d.always_in_identity || stages.has(d.stage));
    named.map(|d| (d.name.to_owned(), Value::Bool(stages.has(d.stage)))).collect::<Map<_, _>>().into()
}

/// What identifies the inputs.
pub struct Contents {
    /// Everything that determines the chart's values except its samples.
    pub content: Value,
    /// State of all input files: [`MTIMES`] or [`DIGEST`], and its value.
    pub files: (&'static str, Value),
    /// The surfaces at several distances.
    pub surfaces: Option<Value>,
}

/// What identifies the inputs: by the content of their files if `check_input`, else by their modification times.
///
/// # Errors
/// The chunks cannot be listed; the files cannot be read, changed, or are at a URL (`check_input`).
pub fn contents(chart: &Chart, depth: Option<&Depth>, check_input: bool) -> Result<Contents> {
    let digests = match check_input {
        false => None,
        true => Some([chart.content_digest()?, depth.map_or(Ok(Value::Null), Depth::content_digests)?]),
    };
    // After the digests: the files that were read are those that were opened.
    let (content, mtimes) = chart.identity()?;
    let (surfaces, times) = depth.map(Depth::identity).transpose()?.unzip();
    let state = |of_chart, of_depth: Option<Value>| match of_depth {
        None => of_chart,
        Some(of_depth) => json!([of_chart, of_depth]),
    };
    let files = match digests {
        None => (MTIMES, state(mtimes, times)),
        Some([of_chart, of_depth]) => (DIGEST, state(of_chart, depth.map(|_| of_depth))),
    };
    Ok(Contents { content, files, surfaces })
}

/// Where chart and lens are, and what the chart is, for people.
pub fn source(args: &RunArgs, chart: &Chart) -> Value {
    let chart_path = match args.chart.starts_with("gen:") {
        true => args.chart.clone(),
        false => absolute(&args.chart),
    };
    let size = chart.size();
    let mut source = json!({
        "chart": chart_path,
        "array": args.var,
        "chart_px": { "x": size.width, "y": size.height },
        "chart_units": chart_units(args, chart),
        "lens": if is_builtin(&args.lens) { args.lens.clone() } else { absolute(&args.lens) },
    });
    if args.tracing.coatings != CoatingsArg::Ideal {
        source["coatings"] = args.tracing.coatings.to_string().into();
    }
    source
}

/// The absolute path of a local file, if the current directory is known.
fn absolute(path: &str) -> String {
    match is_url(Path::new(path)) || Path::new(path).is_absolute() {
        true => path.to_owned(),
        // Not `Path::join`, which would reduce the slashes of `PATH//array`.
        false => std::env::current_dir().map_or(path.into(), |d| format!("{}/{path}", d.display())),
    }
}
