//! The film of a mesh: its scene is made beside the film as FILM.scene, which is the chart, and removed when the film is complete.
//!
//! The scene is made again by each run that has shards to compute, and its bytes are the same then: the times of its files do not matter (`--trust-input`).

mod request;

use super::{already_complete, run_job_of};
use crate::args::{PlacementArgs, RunCommand, SceneArgs};
use crate::commands::scene;
use crate::failure::{other_job, usage};
use crate::job::arguments::Arguments;
use crate::job::inputs::DEPTH;
use crate::open::{check_has_files, is_mesh};
use crate::progress::jsonl::Jsonl;
use crate::progress::log_line;
use anyhow::Result;
use formats::durable::{Store, link_target};
use formats::film::FilmStore;
use formats::scene::SceneStore;
use std::path::{Path, PathBuf};

/// Whether the chart of `args` is a mesh.
pub fn is_of_mesh(args: &RunCommand) -> bool {
    args.work.plan.is_none() && is_mesh(&args.job.chart)
}

/// Path of the scene of the film `film`.
pub fn scene_path(film: &Path) -> PathBuf {
    // `film.zarr/` is `film.zarr`.
    let name = film.to_string_lossy();
    PathBuf::from(format!("{}.scene", name.trim_end_matches('/')))
}

/// Makes the scene of the mesh of `args` and its film, and removes the scene when the film is complete; the exit code. Of a film that is complete the scene is not
/// made again.
///
/// # Errors
/// Flags that do not fit a mesh; those of the scene and of the film.
pub fn run(args: &RunCommand, jsonl: Option<&Jsonl>) -> Result<u8> {
    let out = scene_path(&args.job.film);
    // What the film would be refused for.
    Arguments::resolve(&args.job, true, Some(DEPTH))?;
    let film = match !args.job.process.overwrite && Store::at(&link_target(&args.job.film))?.exists()? {
        true => {
            Some(FilmStore::open(&args.job.film, !args.job.no_fsync).map_err(|e| other_job(e.to_string()))?)
        }
        false => None,
    };
    if let Some(nm) = &args.job.wavelengths {
        pipeline::wavelengths::parse(nm).map_err(|e| usage(format!("--wavelengths: {e}")))?;
    }
    if args.job.check_input {
        check_has_files(&out)?;
    }
    let of_scene = scene_args(args, &out)?;
    let asked = request::request(&args.job);
    if let Some(film) = film {
        let is_of_scene = is_of_scene(&film, &of_scene)?;
        if let (true, Some(asked), false) = (is_of_scene, &asked, args.mesh.keep_scene)
            && request::is_complete(&film, asked)?
        {
            let code = already_complete(&args.job, &film, jsonl, args.work.progress)?;
            if code == 0 && is_of_job(&out, request::scene_digest(&film)) {
                remove(&out);
            }
            return Ok(code);
        }
    }
    match scene::command(&of_scene)? {
        0 => {}
        code => return Ok(code),
    }
    let mut job = args.job.clone();
    job.chart = out.display().to_string();
    job.trust_input |= !job.check_input;
    let source = asked.map(|asked| (request::MESH, asked));
    let code = run_job_of(&job, source, jsonl, args.work.progress)?;
    if code != 0 || args.mesh.keep_scene {
        log_line(format!("the scene is {}", out.display()));
    } else {
        remove(&out);
    }
    Ok(code)
}

/// Whether `film` records that it is of the scene of `of_scene`, which is not made for that.
///
/// # Errors
/// It is of another scene (exit code 3); the mesh cannot be read.
fn is_of_scene(film: &FilmStore, of_scene: &SceneArgs) -> Result<bool> {
    match request::scene_digest(film) {
        None => Ok(false),
        Some(theirs) if *theirs == scene::job_digest(of_scene)? => Ok(true),
        Some(_) => Err(other_job(format!(
            "{} exists and belongs to another job: its scene is another than this of {} (mesh, camera, light, lens, focus or film); choose another path, or start \
             again with --overwrite",
            film.path().display(),
            of_scene.mesh.display()
        ))),
    }
}

/// Whether the scene of the job of that digest is at `path`.
fn is_of_job(path: &Path, job_digest: Option<&str>) -> bool {
    let scene = SceneStore::open_to_verify(path, true);
    scene.is_ok_and(|scene| {
        let found = scene.attributes().get("provenance").and_then(|p| p["job_digest"].as_str());
        found.is_some() && found == job_digest
    })
}

/// Removes the scene of a complete film.
fn remove(scene: &Path) {
    if let Err(e) = SceneStore::remove(scene) {
        log_line(format!("note: the film is complete; its scene remains: {e}"));
    }
}

/// The request of the scene `out`.
fn scene_args(args: &RunCommand, out: &Path) -> Result<SceneArgs> {
    let RunCommand { job, mesh, .. } = args;
    if args.dry_run {
        return Err(usage(format!(
            "--dry-run: the film of a mesh follows its scene: `lenscube scene {} --info` prints its size and cost",
            job.chart
        )));
    }
    let PlacementArgs { film_size, film_pitch_um, axis, scale, chart_pitch_mm, fit, center } = job.placement;
    let (Some(film_size), Some(film_pitch_um)) = (film_size, film_pitch_um) else {
        return Err(usage("a mesh has no size in pixels: give --film-size and --film-pitch-um"));
    };
    let placed = [
        ("--axis", axis.is_some()),
        ("--scale", scale != (1.0, 1.0)),
        ("--chart-pitch-mm", chart_pitch_mm.is_some()),
        ("--fit", fit.is_some()),
        ("--center", center != (0.0, 0.0)),
        ("--chart-shape", job.chart_shape.is_some()),
        ("--var", job.var.is_some()),
        ("--axes", job.axes.is_some()),
        ("--chart-scale", job.chart_scale.is_some()),
        ("--depth", job.surfaces.depth.is_some()),
        ("--depth-unit", job.surfaces.depth_unit.is_some()),
        ("--depth-kind", job.surfaces.depth_kind.is_some()),
        ("--depth-miss", job.surfaces.depth_miss.is_some()),
        ("--depth-edges", job.surfaces.depth_edges.is_some()),
        ("--coverage-light", job.surfaces.coverage_light.is_some()),
        ("--hidden", !job.surfaces.hidden.is_empty()),
    ];
    if let Some((flag, _)) = placed.iter().find(|(_, given)| *given) {
        return Err(usage(format!(
            "{flag} does not apply to a mesh, which the camera places: {}",
            job.chart
        )));
    }
    Ok(SceneArgs {
        mesh: job.chart.clone().into(),
        out: Some(out.into()),
        lens: job.lens.clone(),
        focus_m: job.surfaces.focus_m,
        film_size,
        film_pitch_um,
        depths_m: mesh.depths_m,
        view: mesh.view.clone(),
        surfaces: mesh.surfaces.clone(),
        look: mesh.look.clone(),
        info: false,
        materials: false,
        threads: job.threads,
        memory: job.memory,
        no_fsync: job.no_fsync,
        process: job.process,
        design: job.tracing.design(&job.surfaces.gap),
    })
}
