//! Steps 1 and 3: chart and lens opened; bands selected, film geometry resolved. Of the chart only metadata are read.

use super::depth::surfaces::SurfacePaths;
use super::depth::{Depth, DepthRequest, LensFacts};
use super::field_height::field_height_mm;
use super::frame::{Named, frame};
use super::ghosts;
use super::scatter::JobScatter;
use crate::args::{RunArgs, bands};
use crate::failure::{other_job, usage};
use crate::job::lens::UntracedLens;
use crate::job::lens::known::KnownLenses;
use crate::open::{self, Chart, ChartFlags, check_has_files};
use crate::progress::{log_line, plural};
use anyhow::Result;
use formats::chart::{NanPolicy, SceneChart};
use pipeline::geometry::Frame;
use pipeline::projection::Projection;
use serde_json::Value;
use std::path::Path;
use std::sync::{Arc, Once};

/// What films of surfaces at several distances are called where GPUs do not compute them.
pub const DEPTH: &str = "a film of surfaces at several distances";
/// Relative difference of focal lengths or pitches that are the same.
const SAME: f64 = 1e-6;

/// Chart, lens and names of the surfaces' arrays: what is opened first.
pub struct Opened {
    chart: Chart,
    lens: UntracedLens,
    surfaces: Vec<SurfacePaths>,
}

impl Opened {
    /// Opens those of `args`.
    ///
    /// # Errors
    /// Chart or lens cannot be opened.
    pub fn new(args: &RunArgs) -> Result<Self> {
        if args.check_input {
            check_has_files(Path::new(&args.chart))?;
        }
        Self::with_chart(args, open_chart(args, args.nan)?)
    }

    /// Opens the lens of `args`, for `chart`.
    ///
    /// # Errors
    /// The lens cannot be opened.
    pub fn with_chart(args: &RunArgs, chart: Chart) -> Result<Self> {
        let lens = UntracedLens::open_focused(&args.lens, &args.surfaces, &args.tracing)?
            .with_errors(&args.built)?;
        let surfaces = SurfacePaths::of_job(&args.surfaces, &args.chart, &chart)?;
        if !lens.is_symmetric() {
            check_asymmetric(args, &lens)?;
        }
        Ok(Self { chart, lens, surfaces })
    }

    /// With the lenses that the process keeps.
    pub fn among(self, known: &Arc<KnownLenses>) -> Self {
        Self { lens: self.lens.among(Arc::clone(known)), ..self }
    }

    /// Whether there are surfaces at several distances.
    pub fn has_depth(&self) -> bool {
        !self.surfaces.is_empty()
    }

    /// What GPUs do not compute.
    pub fn on_cpu(&self) -> Option<&'static str> {
        match self.lens.is_symmetric() {
            true => self.has_depth().then_some(DEPTH),
            false => Some("a lens without rotational symmetry"),
        }
    }
}

/// Inputs of a job.
pub struct Inputs {
    /// The chart; its chunk cache is empty until the memory is planned.
    pub chart: Chart,
    /// Film, axis, placement of the chart.
    pub frame: Frame,
    /// Height of the lens's outermost field point, mm, if it is known.
    pub field_height_mm: Option<f64>,
    /// Bands of the chart that the complete job computes, by band of the film.
    pub selected_bands: Vec<usize>,
    /// Their wavelengths, nm.
    pub selected_nm: Vec<f64>,
    /// Surfaces at several distances.
    pub depth: Option<Depth>,
    /// Notes on distances, also on those of a flat chart.
    pub depth_notes: Vec<String>,
    /// Scatter, if there is any.
    pub scatter: Option<JobScatter>,
    /// What ghosts add to the identity of the job, if there are any.
    pub ghosts: Option<Value>,
    /// Bands of the film that this process computes; all, unless it does units of a plan.
    pub film_bands: Vec<usize>,
}

impl Inputs {
    /// The inputs for the bands `film_bands` of the film (`None`: all).
    ///
    /// # Errors
    /// Bands or geometry do not fit chart and lens; fewer bands than planned (exit code 3); surfaces that are not valid.
    pub fn new(args: &RunArgs, opened: Opened, film_bands: Option<&[usize]>) -> Result<(Self, UntracedLens)> {
        let Opened { chart, lens, surfaces } = opened;
        let all_nm = chart.wavelengths_nm()?;
        let selected_bands: Vec<usize> = match &args.bands {
            None => (0..all_nm.len()).collect(),
            Some(text) => chosen_bands(text, &all_nm)?,
        };
        let film_bands = film_bands.map_or_else(|| (0..selected_bands.len()).collect(), <[_]>::to_vec);
        if let Some(missing) = film_bands.iter().find(|b| **b >= selected_bands.len()) {
            return Err(other_job(format!(
                "the plan uses band {missing}, the job has only {} of chart `{}`: the chart or --bands are not those of the plan",
                plural(selected_bands.len(), "band"),
                args.chart
            )));
        }
        let named = Named { chart_name: &args.chart, chart: &chart, lens_name: &args.lens, lens: &lens };
        let frame = frame(&args.placement, named)?;
        let field_height_mm = field_height_mm(&lens)?;
        let selected_nm: Vec<f64> = selected_bands.iter().map(|&b| all_nm[b]).collect();
        let scatter = JobScatter::new(args, &lens, &selected_nm)?;
        let lens = lens.with_bands_of(&all_nm, !surfaces.is_empty())?;
        let nodes = lens.depth_nodes(&args.lens, !surfaces.is_empty())?;
        if let Chart::Scene(scene) = &chart {
            check_scene(args, scene, &lens, &frame)?;
        }
        let (depth, depth_notes) = match surfaces.is_empty() {
            true => (None, Vec::new()),
            false => {
                let (focal_mm, blur_um) = lens.focal_mm_and_blur_um()?;
                let facts = LensFacts { focal_mm, blur_px: blur_um / frame.pitch_um, nodes };
                let request = DepthRequest::new(args);
                let mut depth = Depth::open(&request, &surfaces, &frame, &all_nm, facts, &mut |_, _| ())?;
                let is_flat = lens.is_within_focus(&args.lens, &depth.surfaces, frame.pitch_um)?;
                let notes = std::mem::take(&mut depth.notes);
                (Some(depth).filter(|_| !is_flat), notes)
            }
        };
        let ghosts = ghosts::identity(args, &lens, &frame)?;
        let inputs = Self {
            chart,
            frame,
            field_height_mm,
            selected_bands,
            selected_nm,
            depth,
            depth_notes,
            scatter,
            ghosts,
            film_bands,
        };
        Ok((inputs, lens))
    }

    /// Bands of the chart that this process computes.
    pub fn chart_bands(&self) -> Vec<usize> {
        self.film_bands.iter().map(|&b| self.selected_bands[b]).collect()
    }

    /// Wavelengths of the bands that this process computes, nm.
    pub fn wavelengths_nm(&self) -> Vec<f64> {
        self.film_bands.iter().map(|&b| self.selected_nm[b]).collect()
    }
}

/// What films of a lens without rotational symmetry cannot have.
///
/// # Errors
/// Usage: stray light, bands with a width, azimuths of PSFs on a grid.
fn check_asymmetric(args: &RunArgs, lens: &UntracedLens) -> Result<()> {
    if args.azimuths.is_some() && lens.has_psf_grid() {
        let lens = args.built.named(&args.lens);
        return Err(usage(format!(
            "--azimuths: the PSFs of {lens} are on a grid of columns and rows; leave it out"
        )));
    }
    let refused = [
        (args.veil.is_on(), "scatter, veiling glare and ghosts"),
        (args.tracing.integrated_bands().is_some(), "--band-samples"),
    ];
    match refused.iter().find(|(is_asked, _)| *is_asked) {
        None => Ok(()),
        Some((_, what)) => {
            let lens = args.built.named(&args.lens);
            Err(usage(format!("{what}: expected a lens with rotational symmetry, {lens} has none")))
        }
    }
}

/// Bands that `--bands` selects; a note on an old syntax is printed.
pub fn chosen_bands(text: &str, nm: &[f64]) -> Result<Vec<usize>> {
    let (chosen, note) = bands(text, nm).map_err(|e| usage(format!("--bands {text}: {e}")))?;
    // Bands of one wavelength are those of several arrays, as of two polarisations.
    for word in text.split(',').map(str::trim) {
        let is_it = |band: &f64| word.parse().is_ok_and(|given: f64| given == *band);
        let first = nm.iter().position(is_it);
        let last = nm.iter().rposition(is_it);
        if let Some((first, last)) = first.zip(last).filter(|(first, last)| first != last) {
            return Err(usage(format!(
                "--bands {text}: bands #{first} and #{last} have {word} nm; select one by its index, '#{first}'"
            )));
        }
    }
    // An export opens its input twice.
    static NOTED: Once = Once::new();
    if let Some(note) = note {
        NOTED.call_once(|| log_line(format!("note: {note}")));
    }
    Ok(chosen)
}

/// Fails if `scene` was made for a lens of another focal length, in focus, or for another film.
fn check_scene(args: &RunArgs, scene: &SceneChart, lens: &UntracedLens, frame: &Frame) -> Result<()> {
    let focal_mm = lens.focal_mm_and_blur_um()?.0;
    let other = |what: String| {
        Err(usage(format!(
            "scene `{}` was made for {what}: give --lens, --focus-m, --gap, --film-size and --film-pitch-um as to `lenscube scene`, or make the scene again",
            args.chart
        )))
    };
    let differs = |a: f64, b: f64| (a / b - 1.0).abs() > SAME;
    if differs(scene.focal_mm(), focal_mm) {
        let (was, lens) = (scene.focal_mm(), &args.lens);
        return other(format!("a lens of f_D = {was:.6} mm, `{lens}` in focus has {focal_mm:.6} mm"));
    }
    if scene.projection() != Projection::Planar && !lens.is_symmetric() {
        return Err(usage(format!(
            "scene `{}` is in the projection of the film: expected a lens with rotational symmetry, {} has none; make the scene with --projection planar",
            args.chart,
            args.built.named(&args.lens)
        )));
    }
    if frame.scale != (1.0, 1.0) || frame.center_mm != (0.0, 0.0) {
        return Err(usage(format!(
            "scene `{}`: --scale, --fit, --chart-pitch-mm and --center do not apply to a scene, which the camera places",
            args.chart
        )));
    }
    if differs(scene.pitch_um(), frame.pitch_um) {
        return other(format!("pixels of {} µm, the film has {} µm", scene.pitch_um(), frame.pitch_um));
    }
    match scene.film_size() {
        Some(film) if frame.film.height > film.height || frame.film.width > film.width => {
            other(format!("a film of {film} px, this one has {} px", frame.film))
        }
        _ => Ok(()),
    }
}

fn open_chart(args: &RunArgs, nan: NanPolicy) -> Result<Chart> {
    let flags = ChartFlags {
        wavelengths: args.wavelengths.as_deref(),
        raw: args.chart_shape.as_deref().zip(args.chart_dtype.as_deref()),
        var: args.var.as_deref(),
        axes: args.axes.as_ref(),
        scale: args.chart_scale,
        nan,
        cache_bytes: 0,
    };
    open::chart_with(&args.chart, &flags)
}
