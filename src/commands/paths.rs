//! Inputs and outputs among the arguments of each command, checked before it begins ([`Guard`]).

use super::{compare, export, lens, report, sensor, shoot, validate};
use crate::args::{
    ChartArgs, ChartCommand, Command, DesignArgs, DevelopStyle, ExposeArgs, LensCommand, LookArgs, PlanArgs,
    SceneArgs, SensorCommand, ShootArgs,
};
use crate::camera::frame::split_group;
use crate::commands::lens::convert::catalogue_path;
use crate::design::is_design;
use crate::open::{check_mesh_file, is_builtin, is_mesh};
use crate::outputs::Guard;
use anyhow::Result;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

#[cfg(test)]
mod tests;

/// Fails (exit code 2) if an output of the command is, lies in or contains an input or another output. Nothing is changed; inputs are not
/// opened, except a design that `lens convert` may write a catalogue beside, and coatings, which name tables.
pub fn check(command: &Command) -> Result<()> {
    of_command(command)?.check()
}

/// Inputs and outputs of a command. Of `run --plan` the job is not known yet: [`Guard::of_job`].
fn of_command(command: &Command) -> Result<Guard> {
    let guard = Guard::default();
    Ok(match command {
        Command::Demo(args) => guard.writes("--dir", &args.dir),
        Command::Chart(args) => of_chart(args),
        Command::Scene(args) => {
            check_mesh_file(&args.mesh)?;
            of_scene(args)
        }
        Command::Lens(args) => of_lens(&args.command),
        Command::Depth(args) => guard
            .reads_chart("scene", &args.scene)
            .reads_surfaces(&args.surfaces)
            .reads_lens(&args.lens)
            .reads_glasses(&args.tracing)
            .may_write("--plot", args.plot.as_ref()),
        Command::Run(args) if args.work.plan.is_none() => {
            if is_mesh(&args.job.chart) {
                check_mesh_file(Path::new(&args.job.chart))?;
            }
            reads_look(Guard::of_job(&args.job), &args.mesh.look)
        }
        Command::Sensor(args) => match &args.command {
            Some(SensorCommand::List) => guard,
            Some(SensorCommand::Show(args)) => in_directory(
                guard.reads_sensor(&args.sensor, &args.set),
                "--plot",
                args.plot.as_deref(),
                sensor::FIGURES,
            ),
            Some(SensorCommand::Validate(args)) => in_directory(
                guard.reads_sensor(&args.sensor, &args.set),
                "--out",
                args.out.as_deref(),
                sensor::validation_files(),
            ),
            None => of_exposure(&args.expose)?,
        },
        Command::Develop(args) => {
            style(guard.reads_chart("raw", split_group(&args.raw).0), &args.style).writes("OUT", &args.out)
        }
        Command::Shoot(args) => of_shot(args),
        Command::Compare(args) => guard
            .reads_chart("raw", split_group(&args.first).0)
            .reads_chart("raw", split_group(&args.second).0)
            .writes_in("--out", &args.out, compare::FILES),
        // The files that the recipe names are compared with OUT when it has been read.
        Command::Dataset(args) => guard.reads_text("recipe", &args.recipe).writes("OUT", &args.out),
        // The lens that the film names is compared with OUT when the film has been opened.
        Command::Restore(args) => {
            let guard = guard.reads("film", &args.film).writes("OUT", &args.out);
            let guard = args.of_film.iter().fold(guard, |guard, film| guard.reads("--film", film));
            args.lens.iter().fold(guard, |guard, lens| guard.reads_lens(lens))
        }
        Command::Plan(args) => of_plan(args),
        Command::Export(args) => {
            let guard = guard.reads_chart("film", &args.film);
            export::files(args)?.into_iter().fold(guard, |guard, path| guard.writes("OUT", path))
        }
        Command::Validate(args) => {
            let against =
                args.against.iter().fold(guard.reads_lens(&args.lens), |g, lens| g.reads_lens(lens));
            let against = against.reads_catalogues(&[], &args.coatings);
            let timed = args.timing.iter().fold(against, |guard, film| guard.reads("film", film));
            timed.writes_in("--out", &args.out, validate::FILES)
        }
        Command::Measure(args) => guard
            .reads_chart("film", &args.film)
            .may_write("--csv", args.csv.as_ref())
            .may_write("--json", args.json.as_ref())
            .may_write("--plot", args.plot.as_ref())
            .may_write("--map", args.map.as_ref()),
        Command::Report(args) => {
            let pictures = args.pictures.iter().chain(&args.against);
            let guard = pictures.fold(guard, |guard, name| guard.reads_chart("picture", split_group(name).0));
            guard.writes_in("--out", &args.out, report::files(args)?)
        }
        Command::Man(args) => guard.may_write("DIR", args.dir.as_ref()),
        // What `pyramid` and `verify --repair` write belongs to their input.
        Command::Pyramid(args) => guard.reads("film", &args.film),
        Command::Verify(args) => guard.reads("film", &args.film),
        Command::Status(args) => args.film.iter().fold(guard, |guard, film| guard.reads("film", film)),
        Command::View(args) => {
            let guard = args.chart.iter().fold(guard.reads_chart("film", &args.film), |guard, chart| {
                guard.reads_chart("chart", chart)
            });
            args.lens.iter().fold(guard, |guard, lens| guard.reads_lens(lens))
        }
        // It writes into a temporary directory.
        Command::Bench(args) => guard.reads_lens(&args.lens),
        Command::Run(_)
        | Command::Device(_)
        | Command::Cache(_)
        | Command::Help(_)
        | Command::Completions(_) => guard,
    })
}

fn of_plan(args: &PlanArgs) -> Guard {
    // In a directory the plan's file name follows from its digest.
    let plan = match args.output.is_dir() {
        true => args.output.join("plan-DIGEST.json"),
        false => args.output.clone(),
    };
    Guard::of_job(&args.job).writes("--output", plan).may_write("--lens-pack", args.lens_pack.as_ref())
}

fn of_chart(args: &ChartArgs) -> Guard {
    let guard = Guard::default();
    match (&args.convert, &args.generated) {
        (Some(ChartCommand::Image(args)), _) => {
            guard.reads("picture", &args.file).writes("OUT.zarr", &args.out)
        }
        (Some(ChartCommand::Motion(args)), _) => guard
            .reads_chart("chart", &args.chart)
            .reads("--motion", &args.motion)
            .writes("OUT.zarr", &args.out),
        (None, Some(args)) => guard.writes("OUT.zarr", &args.out),
        (None, None) => guard,
    }
}

/// A scene; the files that the mesh names are compared with it when they are known.
fn of_scene(args: &SceneArgs) -> Guard {
    let guard = of_design(&args.lens, &args.design).reads("mesh", &args.mesh);
    reads_look(guard, &args.look).may_write("SCENE", args.out.as_ref())
}

/// Adds the tables of spectra and the picture of the light around.
fn reads_look(guard: Guard, look: &LookArgs) -> Guard {
    let files = look.materials().filter_map(|(_, parts)| Some(parts?.1));
    let guard = files.fold(guard, |guard, file| guard.reads_text("spectrum", file));
    let around = look.environment.iter();
    let guard = around.fold(guard, |guard, of| guard.reads("--environment", &of.path));
    look.illuminant_file().into_iter().fold(guard, |guard, file| guard.reads_text("illuminant", file))
}

fn of_lens(command: &LensCommand) -> Guard {
    let guard = Guard::default();
    match command {
        LensCommand::Show(args) => {
            let guard = of_design(&args.lens, &args.design);
            // Figures of both kinds of lenses, of which some have one name.
            let figures = lens::plots::all_files().chain(lens::film_figures::all_files());
            let figures: BTreeSet<String> = figures.collect();
            let guard = in_directory(guard, "--plot", args.plot.as_deref(), figures);
            in_directory(guard, "--csv", args.csv.as_deref(), lens::tables::all_files())
        }
        LensCommand::Psf(args) => of_design(&args.design, &args.parameters)
            .may_write("OUT", args.out.as_ref())
            .may_write("--sections", args.sections.as_ref()),
        LensCommand::Export(args) => {
            let guard = of_design(&args.lens, &args.parameters);
            lens::export::files(args).into_iter().fold(guard, |guard, path| guard.writes("OUT", path))
        }
        LensCommand::Trace(args) => of_design(&args.design, &args.parameters)
            .reads_tolerances(&args.built)
            .reads_ghosts(&args.ghosts)
            .writes("OUT.lens.zarr", &args.out),
        LensCommand::Tolerance(args) => {
            let guard = of_design(&args.design, &args.parameters);
            let guard = args.tolerances.iter().fold(guard, |guard, file| guard.reads("tolerances", file));
            in_directory(guard, "--out", args.out.as_deref(), lens::tolerance::all_files())
                .may_write("--output", args.output.as_ref())
        }
        LensCommand::Convert(args) => of_design(&args.design, &args.parameters)
            .writes("OUT", &args.out)
            .writes("OUT", catalogue_path(&args.out)),
        LensCommand::Import(args) => {
            let sources = args.source.iter();
            let guard = sources.fold(guard, |guard, source| {
                guard.reads_as("source", &source.display().to_string(), entries(source))
            });
            guard
                .may_write("OUT.lens.zarr", args.out.as_ref())
                .may_write("--template", args.template.as_ref())
        }
        LensCommand::List(args) => guard.may_write("--plot", args.plot.as_ref()),
        LensCommand::Diff(args) => guard.reads_lens(&args.a).reads_lens(&args.b),
        LensCommand::Camera(args) => guard.reads_lens(&args.design),
        LensCommand::Light(args) => guard.reads_lens(&args.lens),
    }
}

/// A design with the catalogues and coatings that are given.
fn of_design(lens: &str, args: &DesignArgs) -> Guard {
    Guard::default().reads_lens(lens).reads_catalogues(&args.glass_catalog, &args.coatings)
}

fn of_exposure(args: &ExposeArgs) -> Result<Guard> {
    let guard =
        args.film.iter().fold(Guard::default(), |guard, film| guard.reads_chart("film", split_group(film).0));
    let guard = args.sensor.iter().fold(guard, |guard, sensor| guard.reads_sensor(sensor, &args.set));
    let guard = args.lens.iter().fold(guard, |guard, lens| guard.reads_lens(lens));
    let guard = args.chief_ray_angles.iter().fold(guard, |g, table| g.reads("--chief-ray-angles", table));
    let guard = args.motion.iter().fold(guard, |guard, table| guard.reads("--motion", table));
    let Some(out) = &args.raw else { return Ok(guard) };
    let guard = guard.writes("RAW", out);
    Ok(match sensor::is_file(out)? {
        true => guard.writes("the temporary raw", sensor::temporary_raw(out)),
        false => guard,
    })
}

fn of_shot(args: &ShootArgs) -> Guard {
    let guard = Guard::default().reads_chart("chart", &args.chart).reads_surfaces(&args.surfaces);
    let guard = guard.reads_lens(&args.lens).reads_glasses(&args.tracing).reads_ghosts(&args.veil.ghosts);
    let guard = guard.reads_sensor(&args.sensor, &[]);
    let directory = if args.keep.is_some() { "--keep" } else { "the temporary directory" };
    let guard = guard.writes("OUT", &args.out).writes_in(directory, &shoot::directory(args), shoot::STORES);
    match shoot::is_negative(&args.out) {
        true => guard.writes("the temporary raw", sensor::temporary_raw(&args.out)),
        false => guard,
    }
}

/// What is in a folder of exports, where a pack may be written under another name; else the path itself.
fn entries(source: &Path) -> Vec<PathBuf> {
    match std::fs::read_dir(source) {
        Ok(entries) => entries.flatten().map(|entry| entry.path()).collect(),
        Err(_) => vec![source.into()],
    }
}

/// Matrix and shading of a development.
fn style(guard: Guard, style: &DevelopStyle) -> Guard {
    let guard = match style.matrix.as_str() {
        "fitted" | "none" => guard,
        file => guard.reads_text("matrix", Path::new(file)),
    };
    match style.shading.as_str() {
        "none" => guard,
        lens if is_builtin(lens) || is_design(lens) => guard.reads_lens(lens),
        flat => guard.reads_chart("shading", split_group(flat).0),
    }
}

/// The files `names` in a directory that is optional.
fn in_directory(
    guard: Guard,
    argument: &'static str,
    directory: Option<&Path>,
    names: impl IntoIterator<Item = impl AsRef<Path>>,
) -> Guard {
    match directory {
        Some(directory) => guard.writes_in(argument, directory, names),
        None => guard,
    }
}
