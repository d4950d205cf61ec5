//! Opens a lens design: a built-in one by name, or a file; its coatings.

mod bytes;
mod coatings;
mod reflectance;

use crate::args::{DesignArgs, ImagePlaneArg};
use crate::failure::usage;
use anyhow::{Context, Result, bail};
use bytes::read_bytes;
use coatings::DesignCoatings;
pub use coatings::{coating_tables, note_on_ideal};
use formats::design::builtin::{self, BuiltinLens};
use formats::design::{INFINITE_MM, LensFile, LensFileError, ReadOptions, agf, is_lens_file};
use pipeline::design::crossing::crossings;
use pipeline::design::glass_library::GlassLibrary;
use pipeline::design::system::{ImagePlane, RayAiming, System};
pub use reflectance::reflectance;
use std::path::{Path, PathBuf};

/// Name of the built-in design that examples use.
pub const BUILTIN: &str = builtin::SAMPLE;

/// Names of the built-in designs.
pub fn builtin_names() -> impl Iterator<Item = &'static str> {
    builtin::LENSES.iter().map(|lens| lens.name)
}

/// Whether `name` is a built-in design.
pub fn is_builtin(name: &str) -> bool {
    BuiltinLens::named(name).is_some()
}

/// Whether `name` is a design, as opposed to a lens pack.
pub fn is_design(name: &str) -> bool {
    is_builtin(name) || is_lens_file(Path::new(name))
}

/// The file of a design, and its BLAKE3 digest when it was read.
pub struct DesignFile {
    path: PathBuf,
    digest: blake3::Hash,
}

impl DesignFile {
    /// Checks that the file still has the bytes that were read.
    ///
    /// # Errors
    /// It changed, or can no longer be read.
    pub fn check_unchanged(&self) -> Result<()> {
        let now = read_bytes(&self.path).map(|b| blake3::hash(&b));
        match now {
            Ok(now) if now == self.digest => Ok(()),
            _ => bail!(
                "{}: the design changed during the run, so the film may be of both versions; leave the file unchanged and start again \
                 with --overwrite",
                self.path.display()
            ),
        }
    }
}

/// Opens a design and applies image plane, object distance and ray aiming of `args`.
pub fn open(name: &str, args: &DesignArgs) -> Result<System> {
    Ok(open_file(name, args)?.0)
}

/// As [`open_file`], with the film in focus at `focus_m` m from the entrance pupil by the rule of `--image-plane`; `None`: as [`open_file`].
///
/// # Errors
/// As [`open_file`]; a distance that cannot be focused.
pub fn focused(name: &str, args: &DesignArgs, focus_m: Option<f64>) -> Result<(System, Option<DesignFile>)> {
    let Some(focus_m) = focus_m else { return open_file(name, args) };
    let as_designed = DesignArgs { image_plane: ImagePlaneArg::Design, defocus_mm: 0.0, ..args.clone() };
    let (system, file) = open_file(name, &as_designed)?;
    if system.asymmetry.is_some() {
        return Err(without_symmetry("--focus-m").context(format!("design {name}")));
    }
    let focused = system.focused_at(1.0 / focus_m, image_plane(args, &system), args.defocus_mm);
    Ok((focused.with_context(|| format!("focusing {name} at {focus_m} m"))?, file))
}

/// As [`open`], but with the ray aiming that the design states unless `args` has another: for writing it to a file.
pub fn open_unchecked(name: &str, args: &DesignArgs) -> Result<System> {
    let (system, _, coatings) = read_design(name, args)?;
    apply(system, args, &coatings).with_context(|| format!("design {name}"))
}

/// As [`open`], with the file that it was read from; `None` for the built-in design.
pub fn open_file(name: &str, args: &DesignArgs) -> Result<(System, Option<DesignFile>)> {
    let (system, file, coatings) = read_design(name, args)?;
    let system = apply(system, args, &coatings).and_then(|s| match (&file, args.aiming) {
        // The built-in design keeps its setting, which its reference tables have.
        (Some(_), None) if s.asymmetry.is_none() => Ok(s.with_checked_aiming()?),
        _ => Ok(s),
    });
    let mut system = system.with_context(|| format!("design {name}"))?;
    if system.asymmetry.is_none() {
        system.notes.extend(crossings(&system));
    }
    Ok((system, file))
}

fn read_design(name: &str, args: &DesignArgs) -> Result<(System, Option<DesignFile>, DesignCoatings)> {
    let options = ReadOptions { strict: args.strict, configuration: args.configuration };
    if let Some(lens) = BuiltinLens::named(name) {
        if let Some(n @ 2..) = args.configuration {
            return Err(usage(format!("--configuration {n}: {name} has one configuration")));
        }
        if let Some(path) = args.glass_catalog.first() {
            return Err(usage(format!(
                "--glass-catalog {}: {name} is built in, with its glasses; `lenscube lens convert {name} FILE.zmx` makes a design that takes catalogues",
                path.display()
            )));
        }
        return Ok((lens.system(), None, DesignCoatings::default()));
    }
    let mut glasses = GlassLibrary::new();
    for path in &args.glass_catalog {
        add_catalogue(&mut glasses, path)?;
    }
    let path = Path::new(name);
    if !path.exists() {
        return Err(usage(format!(
            "design `{name}` is neither a file nor built in ({BUILTIN} and others: `lenscube lens list`)"
        )));
    }
    let bytes = read_bytes(path)?;
    let digest = blake3::hash(&bytes);
    let reading = || format!("reading design {}", path.display());
    let design = lens_file(path, bytes).with_context(reading)?;
    let mut notes = Vec::new();
    for member in &design.catalogues {
        let name = Path::new(&member.name).file_stem().unwrap_or_default().to_string_lossy();
        notes.extend(add_usable(&mut glasses, &name, &member.data));
    }
    for path in catalogues_beside(path, &design.catalogue_names()) {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        notes.extend(add_usable(&mut glasses, &name, &read_bytes(&path)?));
    }
    let mut system = match design.read(&glasses, &options) {
        Ok(system) => system,
        // Perhaps a glass is in a catalogue of the folder that the design does not name.
        Err(error) => {
            let others = other_catalogues(path, &design.catalogue_names());
            for path in &others {
                let name = path.file_stem().unwrap_or_default().to_string_lossy();
                notes.extend(add_usable(&mut glasses, &name, &read_bytes(path)?));
                notes.push(format!("glass catalogue {name} of the design's folder, which the design does not name, is read for its other glasses"));
            }
            let again = if others.is_empty() { None } else { design.read(&glasses, &options).ok() };
            again.ok_or(error).with_context(reading)?
        }
    };
    system.notes.extend(notes);
    let coatings =
        DesignCoatings { path: path.into(), name: design.coating_file(), members: design.coating_files };
    Ok((system, Some(DesignFile { path: path.into(), digest }), coatings))
}

/// The lens file of this name and content; an ending that is not known is a fault of the command line.
fn lens_file(path: &Path, bytes: Vec<u8>) -> Result<LensFile> {
    LensFile::new(path, bytes).map_err(|error| match error {
        LensFileError::Ending { .. } => usage(error.to_string()),
        other => other.into(),
    })
}

/// Glass catalogues and the coating file beside the design `path` that may be read with it; none of a file that is no design.
pub fn files_beside(path: &Path) -> Vec<PathBuf> {
    let is_file = path.metadata().is_ok_and(|m| m.is_file());
    let design = is_file.then(|| read_bytes(path).and_then(|bytes| lens_file(path, bytes)).ok()).flatten();
    let Some(design) = design else { return Vec::new() };
    // Also catalogues that are read only for a glass that is in no other.
    let mut files = catalogues_in_folder_of(path, |_| true);
    files.extend(design.coating_file().iter().flat_map(|name| coatings::named_beside(path, name)));
    files.iter().map(|file| file.strip_prefix(".").unwrap_or(file).to_path_buf()).collect()
}

/// Adds the usable glasses of a catalogue that came with a design; returns a note on the others.
fn add_usable(glasses: &mut GlassLibrary, name: &str, bytes: &[u8]) -> Option<String> {
    let (catalogue, problems) = agf::parse_usable(bytes);
    glasses.add(name, catalogue);
    let first = problems.first()?;
    Some(format!("glass catalogue {name}: entries not used: {}; {first}", problems.len()))
}

/// Adds a glass catalogue under the name of its file.
fn add_catalogue(glasses: &mut GlassLibrary, path: &Path) -> Result<()> {
    let catalogue =
        agf::parse(&read_bytes(path)?).with_context(|| format!("reading glasses {}", path.display()))?;
    glasses.add(&path.file_stem().unwrap_or_default().to_string_lossy(), catalogue);
    Ok(())
}

/// Files `NAME.agf`, ignoring case, in the design's directory for the catalogues that it names.
fn catalogues_beside(design: &Path, names: &[String]) -> Vec<PathBuf> {
    catalogues_in_folder_of(design, |stem| names.iter().any(|name| name.eq_ignore_ascii_case(stem)))
}

/// The other catalogues in the design's directory.
fn other_catalogues(design: &Path, names: &[String]) -> Vec<PathBuf> {
    catalogues_in_folder_of(design, |stem| !names.iter().any(|name| name.eq_ignore_ascii_case(stem)))
}

/// Glass catalogues in the design's directory whose names without ending are `wanted`, sorted.
fn catalogues_in_folder_of(design: &Path, wanted: impl Fn(&str) -> bool) -> Vec<PathBuf> {
    let directory = design.parent().filter(|d| !d.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let is_wanted = |path: &PathBuf| {
        let is_agf = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("agf"));
        is_agf && path.is_file() && wanted(&path.file_stem().unwrap_or_default().to_string_lossy())
    };
    let entries = std::fs::read_dir(directory).into_iter().flatten();
    let mut paths: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).filter(is_wanted).collect();
    paths.sort();
    paths
}

/// The rule of `--image-plane` and `--focus-nm`.
pub fn image_plane(args: &DesignArgs, system: &System) -> ImagePlane {
    let um = args.focus_nm.map_or(system.primary_um(), |nm| nm / 1e3);
    match args.image_plane {
        ImagePlaneArg::Design => ImagePlane::AsDesigned,
        ImagePlaneArg::Paraxial => ImagePlane::Paraxial(um),
        ImagePlaneArg::Rms => ImagePlane::BestRmsSpot(um),
        ImagePlaneArg::Strehl => ImagePlane::BestStrehl(um),
    }
}

/// The error of a flag for designs with rotational symmetry.
fn without_symmetry(flag: &str) -> anyhow::Error {
    usage(format!("{flag}: expected a design with rotational symmetry, this one has none"))
}

/// The flag of `args` that designs without rotational symmetry do not have, if one is given.
fn refused_without_symmetry(args: &DesignArgs) -> Option<&'static str> {
    let flags = [
        ("--gap", !args.gap.is_empty()),
        ("--image-plane", args.image_plane != ImagePlaneArg::Design),
        ("--defocus-mm", args.defocus_mm != 0.0),
        ("--aiming paraxial", args.aiming == Some(RayAiming::Paraxial)),
    ];
    flags.into_iter().find_map(|(flag, is_given)| is_given.then_some(flag))
}

fn apply(mut system: System, args: &DesignArgs, coatings: &DesignCoatings) -> Result<System> {
    if let (Some(_), Some(flag)) = (&system.asymmetry, refused_without_symmetry(args)) {
        return Err(without_symmetry(flag));
    }
    for (surface, mm) in &args.gap {
        let gaps = system.image();
        if !(1..=gaps).contains(surface) {
            return Err(usage(format!(
                "--gap {surface}={mm}: the design has gaps behind surfaces 1 to {gaps}"
            )));
        }
        system.surfaces[surface - 1].thickness_mm = *mm;
        system.check()?;
    }
    if let Some(distance) = args.object_distance_mm {
        system = system.with_object_distance(Some(distance).filter(|mm| mm.abs() < INFINITE_MM))?;
    }
    let plane = image_plane(args, &system);
    if (plane, args.defocus_mm) != (ImagePlane::AsDesigned, 0.0) {
        system = system.with_image_plane(plane, args.defocus_mm)?;
    }
    if let Some(aiming) = args.aiming {
        system.aiming = aiming;
    }
    coatings::coat(system, &args.coatings, coatings)
}
