//! `lenscube plan`: divides a job into units that any number of processes compute, in any order and more than once.

mod command_line;
mod cut;
mod file;
mod lens_pack;
mod startup;
pub mod unit_list;

pub use command_line::CommandLine;
pub use file::{Plan, Totals};

use crate::args::{
    BuiltArgs, DepthArgs, Device, EngineArg, GhostArgs, NO_HIDDEN, PlanArgs, RunArgs, TracingArgs,
};
use crate::failure::usage;
use crate::film;
use crate::job::film_engine;
use crate::job::{Job, KERNELS_VERSION, PlannedBands, UntracedJob, cost, tail_bins_px};
use crate::open::is_builtin;
use crate::progress::{log_line, plural, print};
use anyhow::Result;
use clap::ArgMatches;
use command_line::{absolute_chart, absolute_path};
use serde_json::Value;
use std::path::Path;

/// Number of units above which a note recalls the limits of array jobs.
const MANY_UNITS: usize = 1000;

/// Fails for `--pyramid`: a process of a plan computes only its units.
pub fn reject_pyramid(args: &RunArgs) -> Result<()> {
    match args.pyramid {
        true => Err(usage(
            "--pyramid is not supported with a plan, whose units do not complete the film; run `lenscube pyramid FILM` after the last",
        )),
        false => Ok(()),
    }
}

/// Runs the command, parsed from `matches`; the exit code.
pub fn command(args: &PlanArgs, matches: &ArgMatches) -> Result<u8> {
    reject_pyramid(&args.job)?;
    // The devices of the workers are not needed here.
    let mut run = RunArgs { device: Device::Cpu, engine: EngineArg::Auto, ..args.job.clone() };
    // All outputs are checked before any is touched.
    file::check_place(&args.output)?;
    if let Some(path) = &args.lens_pack {
        run.lens = lens_pack::write(&run, path)?;
        // The pack has them.
        run.tracing = TracingArgs::default();
        run.built = BuiltArgs::default();
        run.veil.ghosts = GhostArgs { ghosts: run.veil.ghosts.ghosts, ..GhostArgs::default() };
        run.surfaces = DepthArgs { focus_m: None, gap: Vec::new(), depth_tolerance: None, ..run.surfaces };
    }
    let command = worker_command(&run, matches)?;
    let untraced = UntracedJob::new(&run)?;
    let engine = film_engine::planned(&args.job, untraced.on_cpu())?;
    film::check_before_tracing(&untraced, &run)?;
    let mut job = untraced.traced()?;
    job.engine = engine;
    let plan = make(&job, &run, command, args)?;
    plan.check_output(&args.output)?;
    let store = film::open(&job, &run)?;
    film_engine::check(&store, engine, run.mixed_engines)?;
    plan.check_film(&args.output, &store)?;
    let path = plan.write(&args.output)?;
    for note in &job.notes {
        log_line(format!("note: {note}"));
    }
    print_summary(&plan, &path);
    print_layers(&job, &plan);
    startup::measure(&plan, &run)?;
    print(path.display());
    Ok(0)
}

fn make(job: &Job, run: &RunArgs, command: CommandLine, args: &PlanArgs) -> Result<Plan> {
    let units = cut::units(job, args.unit_rows, args.units);
    let provenance = film::expected_provenance(job, run)?;
    let attribute = |key: &str| provenance.get(key).and_then(Value::as_str).unwrap_or_default().to_owned();
    Ok(Plan {
        schema: Plan::schema(),
        program: concat!("lenscube ", env!("CARGO_PKG_VERSION")).into(),
        command,
        job_digest: attribute("job_digest"),
        layout_digest: attribute("layout_digest"),
        engine: attribute("engine"),
        // From the film: with --trust-input it was created with other modification times of the chart.
        job: provenance.get("job").and_then(Value::as_object).cloned().unwrap_or_default(),
        layout: film::layout(&job.film),
        lens_bands: job.plans.iter().map(|p| job.lens.band_digest(p.lens_bands)).collect::<Result<_, _>>()?,
        tail_bins_px: tail_bins_px(&job.film),
        wavelengths_nm: job.film.wavelengths_nm.clone(),
        outputs: cut::outputs(job),
        totals: cut::totals(&units),
        units,
    })
}

/// The command line for workers with another current directory: absolute paths, and always a lens. A built-in lens keeps its name,
/// which never means a file.
fn worker_command(run: &RunArgs, matches: &ArgMatches) -> Result<CommandLine> {
    let mut line = CommandLine::given(matches)?;
    let film = run
        .film
        .to_str()
        .ok_or_else(|| usage("the film's path is not UTF-8, so it cannot be stored in a plan"))?;
    line.chart = Some(absolute_chart(&run.chart)?);
    line.film = Some(absolute_path(film)?);
    let lens = if is_builtin(&run.lens) { run.lens.clone() } else { absolute_path(&run.lens)? };
    let surfaces = &run.surfaces;
    let of_path = |flag: &String| {
        let is = |name: &str| flag.strip_prefix(name).is_some_and(|rest| rest.starts_with('='));
        let of_pack = [
            ("--focus-m", surfaces.focus_m.is_none()),
            ("--gap", surfaces.gap.is_empty()),
            ("--depth-tolerance", surfaces.depth_tolerance.is_none()),
            ("--sensor-reflectance", run.veil.ghosts.sensor_reflectance.is_none()),
            ("--ghost-rings", run.veil.ghosts.ghost_rings.is_none()),
        ];
        let has = |flag: &&str| run.tracing.given().contains(flag);
        let of_built = ["--seed", "--lens-sample"];
        ["--lens", "--depth", "--hidden", "--glass-catalog", "--tolerances"].into_iter().any(is)
            || run.built.tolerances.is_none() && of_built.into_iter().any(is)
            || of_pack.iter().any(|(name, has)| *has && is(name))
            || TracingArgs::FLAGS.iter().any(|flag| !has(flag) && is(flag))
    };
    line.flags.retain(|flag| !of_path(flag));
    for catalogue in &run.tracing.glass_catalog {
        let catalogue = catalogue.to_str().ok_or_else(|| {
            usage("the path of a --glass-catalog is not UTF-8, so it cannot be stored in a plan")
        })?;
        line.flags.push(format!("--glass-catalog={}", absolute_path(catalogue)?));
    }
    if let Some(tolerances) = &run.built.tolerances {
        let tolerances = tolerances.to_str().ok_or_else(|| {
            usage("the path of --tolerances is not UTF-8, so it cannot be stored in a plan")
        })?;
        line.flags.push(format!("--tolerances={}", absolute_path(tolerances)?));
    }
    for group in &run.surfaces.hidden {
        let group = if group == NO_HIDDEN { group.clone() } else { absolute_chart(group)? };
        line.flags.push(format!("--hidden={group}"));
    }
    if let Some(depth) = &run.surfaces.depth {
        let is_path = depth != "none" && depth.parse::<f32>().is_err();
        let depth = if is_path { absolute_chart(depth)? } else { depth.clone() };
        line.flags.push(format!("--depth={depth}"));
    }
    line.flags.insert(0, format!("--lens={lens}"));
    Ok(line)
}

/// Prints what units of a band that start together compute more than once.
fn print_layers(job: &Job, plan: &Plan) {
    let is_shared = plan.units.iter().any(|unit| {
        unit.bands
            .iter()
            .any(|band| plan.units.iter().any(|other| other.unit != unit.unit && other.bands.contains(band)))
    });
    if job.layers.is_empty() || !is_shared {
        return;
    }
    let (bytes, core_s) = cost::layers(job);
    log_line(format!(
        "note: units of a band that start before its light beside the image is in the film each compute it, with the same result: {:.2} GB of the chart and \
         about {core_s:.1} core seconds",
        bytes as f64 * 1e-9
    ));
}

/// Prints the number of units and their cost.
fn print_summary(plan: &Plan, path: &Path) {
    let Totals { shards, tiles, tiles_again, .. } = plan.totals;
    let n = plan.units.len();
    let first = &plan.units[0];
    let rows: usize = first.rows.values().map(|(first, end)| end - first).sum();
    let max = |of: fn(&Totals) -> u64| plan.units.iter().map(|u| of(&u.cost)).max().unwrap_or(0) as f64;
    let core_s =
        |pick: fn(f64, f64) -> f64| plan.units.iter().map(|u| u.cost.core_s).reduce(pick).unwrap_or(0.0);
    log_line(format!(
        "{}: {}, 0 to {}, of at most {} x {} each, {}; tiles at unit borders are computed in both \
         units: {tiles_again} of {tiles} ({:.1} %)",
        path.display(),
        plural(n, "unit"),
        n - 1,
        plural(first.bands.len(), "band"),
        plural(rows, "shard row"),
        plural(shards, "shard"),
        100.0 * tiles_again as f64 / tiles as f64
    ));
    log_line(format!(
        "a unit: about {:.2} to {:.2} core seconds, reads {:.2} GB and writes {:.2} GB at most before compression, GPU memory {:.1} GiB",
        core_s(f64::min),
        core_s(f64::max),
        max(|c| c.bytes_read) * 1e-9,
        max(|c| c.bytes_written) * 1e-9,
        max(|c| c.gpu_bytes) / f64::from(1 << 30)
    ));
    if n > MANY_UNITS {
        log_line(format!(
            "note: {n} units; array jobs of many clusters are limited to {MANY_UNITS}: use larger --unit-rows"
        ));
    }
}

impl Plan {
    /// What a process that computes `bands` needs from the plan.
    pub fn planned_bands<'a>(&'a self, bands: &'a [usize]) -> PlannedBands<'a> {
        let lens_digest = self.job.get("lens_digest").and_then(Value::as_str).unwrap_or_default();
        let (lens_bands, tail_bins_px) = (&self.lens_bands, &self.tail_bins_px);
        let is_coarse = self.job.contains_key(KERNELS_VERSION.0);
        PlannedBands { bands, lens_bands, tail_bins_px, lens_digest, is_coarse }
    }
}
