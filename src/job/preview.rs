//! What distances mean for a run, without the run: the steps of a job up to the plan of one band, with a design that is not traced.

use super::depth::surfaces::SurfacePaths;
use super::depth::{Depth, DepthRequest, LensFacts, arrays};
use super::depth_forecast::{MemoryRequest, with_outside};
use super::frame::{Named, frame};
use crate::args::{DepthArgs, DepthMiss, DepthReportArgs};
use crate::failure::{line, usage};
use crate::job::cost::core_s;
use crate::job::default_options;
use crate::job::lens::depth_nodes::trace_core_s;
use crate::job::lens::{TracedFor, UntracedLens, estimated};
use crate::job::memory::Memory;
use crate::job::tile_cost::correction_s;
use crate::machine::{MAX_DEFAULT, MemoryLimit, threads};
use crate::open::{self, Chart, ChartFlags};
use anyhow::Result;
use formats::chart::{NanPolicy, exr};
use formats::film::FilmSpec;
use pipeline::band::{BandPlan, Options};
use pipeline::design::trace::with_threads;
use pipeline::field::Outside;
use pipeline::geometry::Frame;
use pipeline::lens::Lens;
use pipeline::stages::default_stages;
use pipeline::tiling::Tiling;
use std::path::Path;

/// Distances, lens and film, before the distances are read.
pub struct Opened {
    chart: Chart,
    lens: UntracedLens,
    paths: Vec<SurfacePaths>,
    /// Film and place of the chart.
    pub frame: Frame,
    /// Vergence in focus, 1/m.
    pub focus: f64,
    facts: LensFacts,
}

/// Nodes of a design that is not traced.
#[derive(Clone, Copy)]
pub struct UntracedNodes {
    /// Largest L1 error of a kernel half-way between two.
    pub l1: f64,
    /// Their PSFs, bytes.
    pub bytes: u64,
    /// Core seconds of their trace.
    pub core_s: f64,
}

/// Plan of a band.
pub struct PlannedBand {
    /// The plan.
    pub plan: BandPlan,
    /// Wavelength, nm.
    pub nm: f64,
    /// Vergences of all depth nodes of the lens's band.
    pub vergences: Vec<f64>,
    /// Of a design.
    pub untraced: Option<UntracedNodes>,
    /// Core seconds of the band.
    pub core_s: f64,
    /// The part of them that corrects surfaces out of focus.
    pub correction_core_s: f64,
    /// Of the same film of a flat chart in focus.
    pub flat_core_s: f64,
    /// Memory of the run.
    pub memory: Option<Memory>,
}

/// What a run would do.
pub struct Preview {
    /// Name of the lens.
    pub lens: String,
    /// Film and place of the chart.
    pub frame: Frame,
    /// Names of the surfaces.
    pub names: Vec<String>,
    /// The distances.
    pub depth: Depth,
    /// Vergence in focus, 1/m.
    pub focus: f64,
    /// Blur radius per dioptre, film px.
    pub blur_px: f64,
    /// Plan of the band at the primary wavelength, unless it is impossible.
    pub band: Option<PlannedBand>,
    /// Why a run would fail.
    pub problems: Vec<String>,
}

impl Opened {
    /// Opens distances and lens of `args`.
    ///
    /// # Errors
    /// They cannot be opened; the film's pitch is not known.
    pub fn new(args: &DepthReportArgs) -> Result<Self> {
        let lens = UntracedLens::open_focused(&args.lens, &args.surfaces, &args.tracing)?
            .with_bands_of(&[], true)?;
        let (chart, paths) = scene(args)?;
        let named = Named { chart_name: &args.scene, chart: &chart, lens_name: &args.lens, lens: &lens };
        let frame = frame(&args.placement, named)?;
        let (focal_mm, blur_um) = lens.focal_mm_and_blur_um()?;
        let nodes = lens.depth_nodes(&args.lens, true)?;
        let facts = LensFacts { focal_mm, blur_px: blur_um / frame.pitch_um, nodes };
        let focus = lens.focus(&args.surfaces)?;
        Ok(Self { chart, lens, paths, frame, focus, facts })
    }

    /// Blur radius per dioptre, film px.
    pub fn blur_px(&self) -> f64 {
        self.facts.blur_px
    }
}

/// The chart whose size and pitch count, and the surfaces: `--depth`, else what lies beside the chart, else the array itself.
fn scene(args: &DepthReportArgs) -> Result<(Chart, Vec<SurfacePaths>)> {
    let spec = &args.scene;
    if args.surfaces.depth.is_none() && exr::is_supported_path(Path::new(formats::chart::split_array(spec).0))
    {
        return Ok((arrays::open(spec, spec, None)?, vec![SurfacePaths::first(spec)]));
    }
    let flags = ChartFlags { nan: NanPolicy::Keep, ..ChartFlags::default() };
    let chart = open::chart_with(spec, &flags)?;
    let is_array = args.surfaces.depth.is_none() && SurfacePaths::of_chart(spec, &chart)?.is_empty();
    let depth = if is_array { Some(spec.clone()) } else { args.surfaces.depth.clone() };
    let mut paths = SurfacePaths::of_job(&DepthArgs { depth, ..args.surfaces.clone() }, spec, &chart)?;
    match paths.first_mut() {
        None => Err(usage("--depth none: expected distances")),
        Some(first) => {
            if is_array {
                first.name.clone_from(spec);
            }
            Ok((chart, paths))
        }
    }
}

impl Preview {
    /// Reads the distances of `opened` once and plans the band at the lens's primary wavelength. `on_row` receives the vergences of each row of the first
    /// surface.
    ///
    /// # Errors
    /// An array cannot be read.
    pub fn new(
        args: &DepthReportArgs,
        opened: Opened,
        on_row: &mut dyn FnMut(usize, &[f64]),
    ) -> Result<Self> {
        // Counted instead.
        let given = DepthArgs { depth_miss: Some(DepthMiss::Far), ..args.surfaces.clone() };
        let request = DepthRequest {
            given: &given,
            chart: &args.scene,
            flags: None,
            directory: std::env::temp_dir(),
            threads: threads(args.threads),
        };
        let Opened { lens, paths, frame, facts, .. } = &opened;
        let mut depth = Depth::open(&request, paths, frame, &[lens_nm(lens)], *facts, on_row)?;
        let mut problems = Vec::new();
        let missed: u64 = depth.findings.iter().map(|found| found.missed()).sum();
        if missed > 0 && args.surfaces.depth_miss != Some(DepthMiss::Far) {
            problems.push(format!(
                "{missed} pixels are NaN, 0 or negative: expected a distance above 0; `--depth-miss far` takes them for infinity"
            ));
        }
        let plan = || planned(args, &opened, &mut depth, &mut problems);
        let band = match with_threads(threads(args.threads), plan) {
            Ok(band) => Some(band),
            Err(error) => {
                problems.push(line(&error));
                None
            }
        };
        let names = opened.paths.into_iter().map(|paths| paths.name).collect();
        let (blur_px, lens) = (opened.facts.blur_px, opened.lens.name().to_owned());
        Ok(Self { lens, frame: opened.frame, names, depth, focus: opened.focus, blur_px, band, problems })
    }
}

fn lens_nm(lens: &UntracedLens) -> f64 {
    match lens {
        UntracedLens::Pack(pack) => pack.lens().primary_wavelength_nm,
        UntracedLens::Design(design) => design.system.primary_um() * 1e3,
    }
}

/// Plans the band at the primary wavelength; `problems` receives what a run would refuse.
fn planned(
    args: &DepthReportArgs,
    opened: &Opened,
    depth: &mut Depth,
    problems: &mut Vec<String>,
) -> Result<PlannedBand> {
    let Opened { lens, frame, .. } = opened;
    let is_flat = lens.is_within_focus(&args.lens, &depth.surfaces, frame.pitch_um)?;
    let (tables, untraced) = match lens {
        UntracedLens::Pack(pack) => (pack.lens().clone(), None),
        UntracedLens::Design(design) => {
            let options = lens.depth_options(&args.surfaces, depth.range)?;
            let traced_for = TracedFor { surfaces: &depth.surfaces, options, before_trace: None };
            let found = estimated(
                (&design.system, &design.name, &args.tracing),
                frame,
                &options_of(args.outside),
                traced_for,
            )?;
            (
                found.lens,
                Some(UntracedNodes {
                    l1: found.l1,
                    bytes: found.needed.bytes,
                    core_s: trace_core_s(&found.needed),
                }),
            )
        }
    };
    let primary = lens_nm(lens);
    let distance = |nm: f64| (nm - primary).abs();
    let nms = tables.bands.iter().map(|band| band.wavelength_nm);
    let nm = nms.min_by(|a, b| distance(*a).total_cmp(&distance(*b))).unwrap_or(primary);
    let plan = |outside: Outside| match is_flat {
        true => BandPlan::new(frame, &tables, nm, &options_of(outside)),
        false => BandPlan::with_depth(frame, &tables, nm, &options_of(outside), &depth.surfaces),
    };
    // A trace extends its tables to the film with the margin of its windows.
    let plan = match plan(if untraced.is_some() { Outside::Clamp } else { args.outside }) {
        Ok(plan) => plan,
        Err(error) => {
            let clamped = plan(Outside::Clamp)?;
            problems.push(error.to_string());
            clamped
        }
    };
    let tiles = |plan: &BandPlan| -> Vec<(usize, usize)> {
        let (rows, columns) = plan.tiling.count();
        (0..rows).flat_map(|i| (0..columns).map(move |j| (i, j))).collect()
    };
    let cost = |plan: &BandPlan| core_s(plan, default_stages(), &tiles(plan));
    let index = plan.lens_bands.first;
    let nodes = tables.depth.as_ref().map(|depth| &depth.bands[index]);
    let mut flat = tables.clone();
    if let Some(nodes) = nodes {
        flat.bands[index] = nodes.at_node(&tables.bands[index], nodes.nearest(opened.focus));
        flat.depth = None;
    }
    let flat = BandPlan::new(frame, &flat, nm, &options_of(Outside::Clamp))?;
    let vergences = nodes.map_or_else(Vec::new, |nodes| nodes.vergence.clone());
    let memory = match memory(args, opened, &tables, &plan, depth) {
        Ok(memory) => Some(memory),
        Err(error) => {
            problems.push(line(&error));
            None
        }
    };
    let (core_s, flat_core_s) = (cost(&plan), cost(&flat));
    let correction_core_s = correction_s(&plan, &tiles(&plan));
    Ok(PlannedBand { plan, nm, vergences, untraced, core_s, correction_core_s, flat_core_s, memory })
}

/// Memory of a run of this band.
fn memory(
    args: &DepthReportArgs,
    opened: &Opened,
    lens: &Lens,
    plan: &BandPlan,
    depth: &Depth,
) -> Result<Memory> {
    let (frame, options) = (&opened.frame, options_of(args.outside));
    let has_invented = depth.surfaces.is_invented;
    let film = FilmSpec {
        has_invented,
        ..FilmSpec::full_film(frame.film, vec![plan.lens.wavelength_nm], frame.pitch_um)
    };
    let psf_reading = match &opened.lens {
        UntracedLens::Pack(pack) => pack.psf_reading_bytes(plan.lens_bands.first),
        UntracedLens::Design(..) => 0,
    };
    let request = MemoryRequest {
        frame,
        options: &options,
        chart: &opened.chart,
        depth,
        film: &film,
        path: Path::new("film"),
        threads: threads(args.threads),
        limit: MemoryLimit::new(args.memory, MAX_DEFAULT),
        psf_reading,
    };
    request.plan(lens, std::slice::from_ref(plan))
}

/// The options of a run without flags.
fn options_of(outside: Outside) -> Options {
    with_outside(default_options(), outside)
}

impl PlannedBand {
    /// Slabs in reach of each tile of the film, row by row; 1 for one distance.
    pub fn tile_slabs(&self, frame: &Frame) -> (Tiling, Vec<usize>) {
        match &self.plan.depth {
            Some(depth) => (self.plan.tiling, depth.tile_work.iter().map(|work| work.slabs).collect()),
            None => {
                let tiling = Tiling::new(frame.film, None);
                let (rows, columns) = tiling.count();
                (tiling, vec![1; rows * columns])
            }
        }
    }
}
