//! `lenscube shoot`: chart → film → raw → picture, by the commands `run`, `sensor` and `develop` one after the other.

use super::{develop, run, sensor};
use crate::args::{
    DevelopArgs, DevelopStyle, ExposeArgs, PlacementArgs, ProgressArg, RunArgs, ShootArgs, check_directory,
};
use crate::failure::{replacing_other_job, usage};
use crate::job::UntracedJob;
use crate::outputs::check_absent;
use crate::progress::log_line;
use anyhow::{Context, Result};
use formats::film::FilmStore;
use formats::raw::RawStore;
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
    let development = args.demosaic.is_some() || args.even_light;
    if !developed && development {
        return Err(usage(format!("{out} is not developed: --demosaic and --even-light are for pictures")));
    }
    let neutral = match &args.white {
        Some(name) if !developed => {
            Some(name.parse().map_err(|_| usage(format!("--white {name}: a .dng takes D65, A or E")))?)
        }
        _ => None,
    };
    let is_as_designed = args.surfaces.focus_m.is_none() && args.surfaces.gap.is_empty();
    if args.even_light && !(is_as_designed && args.tracing.given().is_empty()) {
        return Err(usage(
            "--even-light divides by the relative illumination of the lens as designed, not of another focus or trace: develop with `lenscube develop --shading` and a flat \
             field, or give a lens pack traced by `lenscube lens trace` with these flags",
        ));
    }
    check_absent(&args.out, args.overwrite)?;
    let directory = directory(args);
    check_directory(&directory)?;
    let [film, raw] = STORES.map(|name| text(&directory.join(name)));
    let (film, raw) = (film?, raw?);
    let job = RunArgs {
        lens: args.lens.clone(),
        var: args.var.clone(),
        axes: args.axes.clone(),
        wavelengths: args.wavelengths.clone(),
        chart_units: args.chart_units.clone(),
        check_input: args.check_input,
        surfaces: args.surfaces.clone(),
        tracing: args.tracing.clone(),
        veil: args.veil.clone(),
        placement: PlacementArgs {
            film_size: args.film_size,
            film_pitch_um: args.film_pitch_um,
            ..PlacementArgs::default()
        },
        threads: args.threads,
        memory: args.memory,
        ..RunArgs::new(&args.chart, &film)
    };
    // What the sensor and the picture refuse is known before the film is made.
    sensor::check_film_pitch(&args.sensor, UntracedJob::new(&job)?.pitch_um())?;
    formats::durable::create_directories(&directory, true)?;
    log_line("1/3  film");
    let code = replacing_other_job(
        args.overwrite,
        || run::run_job(&job, None, ProgressArg::Auto),
        || crate::film::remove(Path::new(&film), false),
    )?;
    if code != 0 {
        return Ok(code);
    }
    log_line("2/3  raw");
    let exposure = ExposeArgs {
        sensor: Some(args.sensor.clone()),
        exposure: Some(args.exposure.clone()),
        gain: args.gain,
        iso: args.iso,
        seed: args.seed,
        threads: args.threads,
        memory: args.memory,
        ..ExposeArgs::new(&film, &raw)
    };
    let code = match developed {
        true => replacing_other_job(
            args.overwrite,
            || sensor::expose(&exposure),
            || sensor::remove(Path::new(&raw), false),
        )?,
        false => sensor::expose(&ExposeArgs {
            raw: Some(args.out.clone()),
            overwrite: args.overwrite,
            white: neutral,
            ..exposure
        })?,
    };
    if code != 0 {
        return Ok(code);
    }
    log_line("3/3  picture");
    if developed {
        let shading = args.even_light.then(|| args.lens.clone());
        let standard = DevelopStyle::default();
        let style = DevelopStyle {
            white: args.white.clone(),
            demosaic: args.demosaic,
            shading: shading.unwrap_or(standard.shading),
            ..standard
        };
        let code = develop::command(&DevelopArgs {
            style,
            threads: args.threads,
            memory: args.memory,
            overwrite: args.overwrite,
            ..DevelopArgs::new(&raw, &args.out)
        })?;
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

fn text(path: &Path) -> Result<String> {
    path.to_str()
        .map(str::to_owned)
        .ok_or_else(|| usage(format!("{}: the name must be UTF-8", path.display())))
}
