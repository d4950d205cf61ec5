//! `lenscube dataset`: many samples by a recipe, each a picture through a lens, and perhaps a sensor, with its labels.
//!
//! ```text
//! part of a picture → bands → film of the lens at a place in its field → raw of a sensor → developed picture
//! ```
//! Films are those of `lenscube run` with the flags of the sample's line, bit for bit; sensor and development have the equations of `lenscube sensor` and `lenscube
//! develop`. Sample k depends on the recipe and k alone ([`formats::dataset::draw`]), files on the units ([`formats::dataset`]).

mod bands;
mod camera;
mod labels;
mod layout;
mod optics;
mod pictures;
mod report;
mod sample;
mod units;

use crate::args::DatasetArgs;
use crate::failure::{Coded, code, other_job, replacing_other_job, usage};
use crate::machine::{MemoryLimit, threads};
use crate::outputs::{Guard, resolve_links};
use crate::progress::{interrupt, log_line};
use anyhow::Result;
use bands::Bands;
use camera::Camera;
use formats::dataset::draw::Draws;
use formats::dataset::recipe::Recipe;
use formats::dataset::store::{DatasetError, DatasetSpec, DatasetStore};
use formats::durable::{is_url, parent_of};
use labels::Labels;
use optics::Optics;
use pictures::Picture;
use sample::Maker;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

/// Default limit of memory, at most.
const DEFAULT_MEMORY: u64 = 1 << 30;
/// Of the limit, one part in so many is for lenses; the rest for samples and the program.
const LENS_PART: u64 = 2;

/// Runs the command; the exit code.
pub fn command(args: &DatasetArgs) -> Result<u8> {
    let start = Instant::now();
    interrupt::listen();
    if is_url(&args.out) {
        return Err(usage(format!(
            "OUT {}: expected a folder of this machine, found a URL",
            args.out.display()
        )));
    }
    let mut recipe = Recipe::open(&args.recipe).map_err(|e| usage(e.to_string()))?;
    if args.samples.is_some() {
        if recipe.samples.is_none() {
            return Err(usage(
                "--samples: the recipe has every combination of its lists; give `samples` in it to draw from them",
            ));
        }
        recipe.samples = args.samples;
    }
    let folder = parent_of(&args.recipe);
    let pictures = pictures::files(&recipe.pictures, folder)?;
    check_apart(args, &recipe, folder, &pictures)?;
    let limit = MemoryLimit::new(args.memory, DEFAULT_MEMORY);
    let maker = maker(&recipe, folder, &pictures, limit.bytes / LENS_PART)?;
    maker.optics.check()?;
    let spec = layout::spec(&maker, limit)?;
    let cancel = interrupt::cancel_flag();
    if args.dry_run {
        return report::dry_run(args, &maker, &spec, cancel).map(|()| 0);
    }
    match DatasetStore::check(&args.out, &spec.digest) {
        Err(error @ DatasetError::Foreign { .. }) => return Err(coded(error)),
        // What a sample cannot be made of is known before anything is replaced.
        Err(DatasetError::OtherRecipe { .. }) if args.overwrite => drop(maker.make(0, cancel)?),
        _ => {}
    }
    let store = replacing_other_job(
        args.overwrite,
        || DatasetStore::create(&args.out, spec.clone()).map_err(|e| of_another_recipe(e, &spec)),
        || DatasetStore::remove(&args.out).map_err(coded),
    )?;
    let missing = units::missing(&store, args.part)?;
    let made =
        units::make(&maker, &store, &missing, threads(args.threads).min(layout::max_threads(&spec, limit)))?;
    if cancel.load(Relaxed) {
        log_line(format!("interrupted after {} samples; the same command resumes", made.samples));
        return Ok(code::INTERRUPTED);
    }
    let finished = store.finish().map_err(coded)?;
    report::print_made(args, &store, (missing.len(), made), finished, start.elapsed().as_secs_f64())?;
    let failed = if finished { report::failed(&store)? } else { made.failed };
    Ok(if failed > 0 { code::WRONG } else { 0 })
}

/// What makes the samples of `recipe`.
fn maker<'a>(
    recipe: &'a Recipe,
    folder: &'a Path,
    pictures: &'a [PathBuf],
    memory: u64,
) -> Result<Maker<'a>> {
    // The first picture that opens says whether they are cubes, and of which bands.
    let first = match pictures.iter().map(|path| Picture::open(path)).find(Result::is_ok) {
        Some(first) => first?,
        None => Picture::open(&pictures[0])?,
    };
    let of_cube = first.wavelengths_nm()?;
    let given = recipe.pictures.wavelengths_nm.as_deref();
    let bands = Bands::new(given.or(of_cube.as_deref()), recipe.pictures.colours, of_cube.is_some())?;
    let optics = Optics::new(recipe, folder, bands.wavelengths_nm(), memory)?;
    let camera = Camera::new(recipe, folder, &bands)?;
    let labels = Labels::open(&recipe.pictures, folder)?;
    let draws = Draws::new(recipe, pictures.len());
    Ok(Maker {
        recipe,
        folder,
        pictures,
        draws,
        bands,
        optics,
        camera,
        labels,
        quantizers: Maker::quantizers(),
    })
}

/// Fails if OUT is, lies in or contains an input.
fn check_apart(args: &DatasetArgs, recipe: &Recipe, folder: &Path, pictures: &[PathBuf]) -> Result<()> {
    let guard = Guard::default().writes("OUT", &args.out).reads_text("recipe", &args.recipe);
    let guard = recipe.pictures.labels.iter().fold(guard, |g, path| g.reads("labels", &folder.join(path)));
    let guard = recipe.pictures.masks.iter().fold(guard, |g, path| g.reads("masks", &folder.join(path)));
    let guard = optics::files(recipe, folder).iter().fold(guard, |g, path| g.reads("lens", path));
    let sensors = recipe.sensor.iter().flat_map(|s| &s.name.0).filter(|name| folder.join(name).exists());
    sensors.fold(guard, |g, name| g.reads_sensor(&folder.join(name).to_string_lossy(), &[])).check()?;
    // Pictures may be many: their folders are resolved once.
    let out = resolve_links(&args.out);
    let mut folders = BTreeSet::new();
    for picture in pictures {
        let inside =
            folders.insert(parent_of(picture)) && resolve_links(parent_of(picture)).starts_with(&out);
        if inside
            || picture.is_dir() && out.starts_with(resolve_links(picture))
            || resolve_links(picture) == out
        {
            return Err(usage(format!(
                "OUT {} and the picture {} are, or lie in, one another; give another OUT",
                args.out.display(),
                picture.display()
            )));
        }
    }
    Ok(())
}

/// An error of the data set that is not `requested`: what differs, if its record has that.
fn of_another_recipe(error: DatasetError, requested: &DatasetSpec) -> anyhow::Error {
    if let DatasetError::OtherRecipe { path, record } = &error
        && let Some(difference) = layout::difference(record, &requested.record)
    {
        return other_job(format!(
            "{} is a data set of {difference}; give another OUT, or --overwrite to replace it",
            path.display()
        ));
    }
    coded(error)
}

/// An error of the data set with its exit code.
fn coded(error: DatasetError) -> anyhow::Error {
    match error {
        DatasetError::OtherRecipe { .. } | DatasetError::Fewer { .. } | DatasetError::Replaced { .. } => {
            other_job(error.to_string())
        }
        DatasetError::Foreign { .. } => Coded { code: code::OTHER_JOB, message: error.to_string() }.into(),
        error => error.into(),
    }
}

/// A layout that its recipe cannot have.
fn refused(problem: String) -> anyhow::Error {
    usage(format!("recipe: {problem}"))
}
