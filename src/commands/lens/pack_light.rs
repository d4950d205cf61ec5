//! `lenscube lens light` of a lens pack: its transmission, and the ghosts that it lists.

use super::ghosts::Ghosts;
use super::trace::wavelengths;
use crate::args::{DesignArgs, GHOST_RINGS, LightArgs, ReflectanceArg};
use crate::failure::usage;
use crate::job::lens::samples::nearest;
use crate::progress::{log_line, print};
use anyhow::{Context, Result};
use formats::lens::LensPack;
use serde_json::{Value, json};

/// Prints what `pack` has of the light.
///
/// # Errors
/// Usage: flags of designs; a wavelength that is no band of the pack. Errors of reading it.
pub fn show(args: &LightArgs, pack: &LensPack) -> Result<()> {
    check(args)?;
    let lens = pack.lens();
    let all: Vec<f64> = lens.bands.iter().map(|band| band.wavelength_nm).collect();
    let bands: Vec<usize> = match &args.wavelengths {
        None => (0..all.len()).collect(),
        Some(text) => wavelengths(text)?.into_iter().map(|nm| band(args, &all, nm)).collect::<Result<_>>()?,
    };
    let chosen: Vec<f64> = bands.iter().map(|band| all[*band]).collect();
    let of_ghosts = bands[nearest(chosen.into_iter(), lens.primary_wavelength_nm)];
    let ghosts = ghosts(pack, of_ghosts).with_context(|| format!("ghosts of {}", args.lens))?;
    let coatings = pack.attributes().source.as_ref().and_then(|source| source["coatings"].as_str());
    let transmission = |band: &usize| lens.bands[*band].transmission;
    if args.json {
        let band = |band: &usize| json!({ "wavelength_nm": all[*band], "transmission": transmission(band) });
        print(serde_json::to_string_pretty(&json!({
            "name": lens.name,
            "coatings": coatings,
            "bands": bands.iter().map(band).collect::<Vec<_>>(),
            "ghosts": ghosts.as_ref().map_or(Value::Null, Ghosts::json),
        }))?);
        return Ok(());
    }
    print(match coatings {
        Some(coatings) => format!("{}, lens pack traced with coatings {coatings}", lens.name),
        None => format!("{}, lens pack", lens.name),
    });
    print("\ntransmission on the axis (mean over the pupil)\n    nm   total");
    bands.iter().for_each(|band| print(format!("{:6.1}  {:6.4}", all[*band], transmission(band))));
    match (&ghosts, pack.ghosts()) {
        (Some(ghosts), _) => ghosts.print(),
        (None, Some(_)) => log_line("note: the pack has ghosts, but does not list their paths"),
        (None, None) => {}
    }
    Ok(())
}

/// Fails for flags of designs.
fn check(args: &LightArgs) -> Result<()> {
    let flags = [
        ("--sensor-reflectance", args.sensor_reflectance != ReflectanceArg::default()),
        ("--ghost-rings", args.ghost_rings != GHOST_RINGS),
        ("flags of designs", args.parameters != DesignArgs::default()),
    ];
    match flags.into_iter().find(|(_, is_given)| *is_given) {
        Some((flag, _)) => Err(usage(format!(
            "{flag}: lens pack `{}` was traced before; leave it out, or give the design",
            args.lens
        ))),
        None => Ok(()),
    }
}

/// The band at `nm` of those at `all`.
fn band(args: &LightArgs, all: &[f64], nm: f64) -> Result<usize> {
    let found = nearest(all.iter().copied(), nm);
    match (all[found] - nm).abs() < 1e-6 {
        true => Ok(found),
        false => Err(usage(format!(
            "--wavelengths: lens pack `{}` has no band at {nm} nm, the nearest is at {} nm",
            args.lens, all[found]
        ))),
    }
}

/// The ghosts of band `band`, if the pack lists them.
fn ghosts(pack: &LensPack, band: usize) -> Result<Option<Ghosts>> {
    let (Some(of_pack), Some(paths)) = (pack.ghosts(), pack.ghost_paths(band)?) else { return Ok(None) };
    Ok(Some(Ghosts {
        paths,
        first_order: Vec::new(),
        ring_mm: of_pack.sizes.ring_mm,
        corner_mm: of_pack.sizes.corner_mm(),
        nm: pack.lens().bands[band].wavelength_nm,
    }))
}
