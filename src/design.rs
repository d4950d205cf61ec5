//! Opening a design by its name: the one inside the program, or a sequential .zmx file.

use crate::args::{AimingArg, DesignArgs, ImagePlaneArg};
use crate::failure::usage;
use anyhow::{Context, Result, bail};
use pipeline::design::glass::GlassCatalog;
use pipeline::design::system::{ImagePlane, RayAiming, System};
use pipeline::design::{agf, zmx};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

/// The design inside the program.
pub const BUILTIN: &str = "double-gauss-28";

/// Whether a lens's name means a design rather than a pack.
pub fn is_design(name: &str) -> bool {
    name == BUILTIN || Path::new(name).extension().is_some_and(|e| e.eq_ignore_ascii_case("zmx"))
}

/// Largest file of a design or of glasses, bytes: a lens of a thousand surfaces has less than 1 MB.
const LARGEST: u64 = 64 << 20;

/// The file of a design, and the blake3 of its bytes when it was read.
pub struct DesignFile {
    path: PathBuf,
    digest: blake3::Hash,
}

impl DesignFile {
    /// Checks that the file still has the bytes that were read.
    ///
    /// # Errors
    /// It changed, or cannot be read any more.
    pub fn check_unchanged(&self) -> Result<()> {
        let now = bytes(&self.path).map(|b| blake3::hash(&b));
        match now {
            Ok(now) if now == self.digest => Ok(()),
            _ => bail!(
                "{}: the design changed while it was used, so it is not known of which the film is; let it rest, then start anew \
                 with --overwrite",
                self.path.display()
            ),
        }
    }
}

/// Opens a design and places film, object and aiming as asked.
pub fn open(name: &str, args: &DesignArgs) -> Result<System> {
    Ok(open_file(name, args)?.0)
}

/// As [`open`], and the file that it was read from; none for the built-in design.
pub fn open_file(name: &str, args: &DesignArgs) -> Result<(System, Option<DesignFile>)> {
    let (system, file) = read(name, args)?;
    Ok((placed(system, args).with_context(|| format!("design {name}"))?, file))
}

/// The bytes of a file that is not absurdly large.
fn bytes(path: &Path) -> Result<Vec<u8>> {
    let reading = || format!("reading {}", path.display());
    let mut bytes = Vec::new();
    File::open(path).and_then(|f| f.take(LARGEST + 1).read_to_end(&mut bytes)).with_context(reading)?;
    match bytes.len() as u64 > LARGEST {
        true => bail!(
            "{} is larger than {LARGEST} bytes, so it is no design and no glass catalogue",
            path.display()
        ),
        false => Ok(bytes),
    }
}

fn read(name: &str, args: &DesignArgs) -> Result<(System, Option<DesignFile>)> {
    if name == BUILTIN {
        return Ok((System::double_gauss_28(), None));
    }
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
    let bytes = bytes(path)?;
    let system =
        zmx::parse(&bytes, &glasses).with_context(|| format!("reading design {}", path.display()))?;
    Ok((system, Some(DesignFile { path: path.into(), digest: blake3::hash(&bytes) })))
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
