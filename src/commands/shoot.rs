//! `lenscube shoot`: chart → film → raw → picture, by the commands `run`, `sensor` and `develop` one after the other.

use super::{develop, run, sensor};
use crate::args::{Cli, Command, ProgressArg, RunArgs, ShootArgs, check_directory};
use crate::failure::{replacing_other_job, usage};
use crate::outputs::check_absent;
use crate::progress::log_line;
use anyhow::{Context, Result};
use clap::Parser;
use formats::film::FilmStore;
use formats::raw::RawStore;
use pipeline::develop::Demosaic;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Runs the command and returns its exit code.
pub fn command(args: &ShootArgs) -> Result<u8> {
    let out = text(&args.out)?;
    let ending = args.out.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    let developed = match ending.as_deref() {
        Some("png" | "tif" | "tiff" | "exr") => true,
        Some("dng") => false,
        _ => return Err(usage(format!("{out}: expected a picture, .png, .tif or .exr, or a .dng"))),
    };
    let development = args.white.is_some() || args.demosaic.is_some() || args.even_light;
    if !developed && development {
        return Err(usage(format!(
            "{out} is not developed: --white, --demosaic and --even-light are for pictures"
        )));
    }
    if args.even_light && (args.surfaces.focus_m.is_some() || !args.surfaces.gap.is_empty()) {
        return Err(usage(
            "--even-light divides by the relative illumination of the lens as designed, not of another focus: develop with `lenscube develop --shading` and a flat \
             field, or give a lens pack traced with --focus-m",
        ));
    }
    check_absent(&args.out, args.overwrite)?;
    let directory = directory(args);
    check_directory(&directory)?;
    formats::durable::create_directories(&directory, true)?;
    let [film, raw] = STORES.map(|name| text(&directory.join(name)));
    let (film, raw) = (film?, raw?);
    log_line("1/3  film");
    let mut words = command_line(args, &["run", "--lens", &args.lens]);
    words.extend(option("--var", args.var.as_ref()));
    words.extend(option("--axes", args.axes.as_ref()));
    words.extend(option("--wavelengths", args.wavelengths.as_ref()));
    words.extend(option("--chart-units", args.chart_units.as_ref()));
    words.extend(option("--film-pitch-um", args.film_pitch_um));
    words.extend(args.check_input.then(|| "--check-input".to_owned()));
    let code = replacing_other_job(
        args.overwrite,
        || execute(args, &words, &[&args.chart, &film]),
        || crate::film::remove(Path::new(&film), false),
    )?;
    if code != 0 {
        return Ok(code);
    }
    log_line("2/3  raw");
    let mut words = command_line(
        args,
        &["sensor", "--sensor", &args.sensor, "--exposure", &args.exposure, "--seed", &args.seed.to_string()],
    );
    words.extend(option("--gain", args.gain));
    words.extend(option("--iso", args.iso));
    let code = if developed {
        replacing_other_job(
            args.overwrite,
            || execute(args, &words, &[&film, &raw]),
            || sensor::remove(Path::new(&raw), false),
        )?
    } else {
        words.extend(overwrite(args));
        execute(args, &words, &[&film, &out])?
    };
    if code != 0 {
        return Ok(code);
    }
    log_line("3/3  picture");
    if developed {
        let mut words = command_line(args, &["develop"]);
        words.extend(option("--white", args.white.as_ref()));
        words.extend(option("--demosaic", args.demosaic.map(name)));
        words.extend(option("--shading", args.even_light.then_some(&args.lens)));
        words.extend(overwrite(args));
        let code = execute(args, &words, &[&raw, &out])?;
        if code != 0 {
            return Ok(code);
        }
    }
    if args.keep.is_none() {
        RawStore::remove(Path::new(&raw))?;
        FilmStore::remove(Path::new(&film))?;
        match std::fs::remove_dir(&directory) {
            Err(e) if e.kind() == ErrorKind::DirectoryNotEmpty => {
                log_line(format!("note: {} contains files of yours and was not removed", directory.display()))
            }
            removed => removed.with_context(|| format!("removing {}", directory.display()))?,
        }
    }
    Ok(0)
}

/// Whether `out` is a digital negative, which is not developed.
pub fn is_negative(out: &Path) -> bool {
    out.extension().is_some_and(|e| e.eq_ignore_ascii_case("dng"))
}

/// Names of film and raw in [`directory`].
pub const STORES: [&str; 2] = ["film.zarr", "raw.zarr"];

/// Where film and raw lie.
pub fn directory(args: &ShootArgs) -> PathBuf {
    args.keep.clone().unwrap_or_else(|| {
        let mut name = args.out.as_os_str().to_owned();
        name.push(".shot");
        name.into()
    })
}

/// A command with the flags that all three have.
fn command_line(args: &ShootArgs, words: &[&str]) -> Vec<String> {
    let mut all: Vec<String> = ["lenscube"].iter().chain(words).map(|w| (*w).to_owned()).collect();
    all.extend(option("--threads", args.threads));
    all.extend(option("--memory", args.memory));
    all
}

/// `--overwrite`, for the picture.
fn overwrite(args: &ShootArgs) -> Option<String> {
    args.overwrite.then(|| "--overwrite".to_owned())
}

fn option(flag: &str, value: Option<impl ToString>) -> Vec<String> {
    value.map_or(Vec::new(), |v| vec![format!("{flag}={}", v.to_string())])
}

fn name(demosaic: Demosaic) -> String {
    format!("{demosaic:?}").to_lowercase()
}

/// Runs the command line `words` with `paths` behind it; a film with the surfaces of `args`.
fn execute(args: &ShootArgs, words: &[String], paths: &[&String]) -> Result<u8> {
    let mut words = words.to_vec();
    words.push("--".into());
    words.extend(paths.iter().map(|p| (*p).clone()));
    match Cli::try_parse_from(words).map_err(|e| usage(e.to_string()))?.command {
        Command::Run(run) => {
            let job = RunArgs { surfaces: args.surfaces.clone(), ..run.job };
            run::run_job(&job, None, ProgressArg::Auto)
        }
        Command::Sensor(sensor) => sensor::command(&sensor),
        Command::Develop(develop) => develop::command(&develop),
        _ => unreachable!("the command lines begin with run, sensor or develop"),
    }
}

fn text(path: &Path) -> Result<String> {
    path.to_str()
        .map(str::to_owned)
        .ok_or_else(|| usage(format!("{}: the name must be UTF-8", path.display())))
}
