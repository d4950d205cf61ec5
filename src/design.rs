//! Opening a design by its name: the one inside the program, or a sequential .zmx file.

use crate::args::{AimingArg, DesignArgs, ImagePlaneArg};
use crate::failure::usage;
use anyhow::{Context, Result};
use pipeline::design::glass::GlassCatalog;
use pipeline::design::system::{ImagePlane, RayAiming, System};
use pipeline::design::{agf, zmx};
use std::path::Path;

/// The design inside the program.
pub const BUILTIN: &str = "double-gauss-28";

/// Whether a lens's name means a design rather than a pack.
pub fn is_design(name: &str) -> bool {
    name == BUILTIN || Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case("zmx"))
}

/// Opens a design and places film, object and aiming as asked.
pub fn open(name: &str, args: &DesignArgs) -> Result<System> {
    placed(read(name, args)?, args).with_context(|| format!("design {name}"))
}

fn read(name: &str, args: &DesignArgs) -> Result<System> {
    if name == BUILTIN {
        return Ok(System::double_gauss_28());
    }
    let bytes = |path: &Path| std::fs::read(path).with_context(|| format!("reading {}", path.display()));
    let mut glasses = GlassCatalog::schott();
    for path in &args.glass_catalog {
        let more =
            agf::parse(&bytes(path)?).with_context(|| format!("reading glasses {}", path.display()))?;
        glasses.extend(more);
    }
    let path = Path::new(name);
    if !path.exists() {
        return Err(usage(format!("design `{name}` is neither a file nor the built-in {BUILTIN}")));
    }
    zmx::parse(&bytes(path)?, &glasses).with_context(|| format!("reading design {}", path.display()))
}

fn placed(mut system: System, args: &DesignArgs) -> Result<System> {
    if let Some(distance) = args.object_distance_mm {
        system = system.with_object_distance(Some(distance))?;
    }
    let um = args.focus_nm.map_or(system.primary_um(), |nm| nm / 1e3);
    let plane = match args.image_plane {
        ImagePlaneArg::Design => ImagePlane::AsDesigned,
        ImagePlaneArg::Paraxial => ImagePlane::Paraxial(um),
        ImagePlaneArg::Rms => ImagePlane::BestRmsSpot(um),
        ImagePlaneArg::Strehl => ImagePlane::BestStrehl(um),
    };
    if (plane, args.defocus_mm) != (ImagePlane::AsDesigned, 0.0) {
        system = system.with_image_plane(plane, args.defocus_mm)?;
    }
    if let Some(aiming) = args.aiming {
        system.aiming = match aiming {
            AimingArg::Real => RayAiming::Real,
            AimingArg::Paraxial => RayAiming::Paraxial,
        };
    }
    Ok(system)
}
