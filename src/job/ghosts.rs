//! Ghosts of a job: the operators of its bands, those of the lens pack or of its design.

mod notes;
mod traced;

use crate::args::{CoatingsArg, GHOST_RINGS, GhostArgs, RunArgs};
use crate::design;
use crate::failure::usage;
use crate::job::lens::UntracedLens;
use anyhow::Result;
use formats::lens::{LensPack, LensPackError, PackGhosts};
pub use notes::{note_left_out, path_name, small_ghosts};
use pipeline::band::BandPlan;
use pipeline::design::ghost::estimate::{ghost_memory_bytes, ghost_seconds};
use pipeline::design::ghost::operator::GHOSTS_VERSION;
use pipeline::design::ghost::options::GhostOptions;
use pipeline::design::ghost::rings::RingOperator;
use pipeline::design::{DesignError, System};
use pipeline::flow::SourceSinkError;
use pipeline::geometry::{Frame, Rect};
use serde_json::{Value, json};
use std::sync::Arc;
use traced::TracedGhosts;

/// Ghosts of a lens on the film of a job.
pub enum JobGhosts {
    /// Of a design.
    Traced(Box<TracedGhosts>),
    /// Of a pack.
    Stored(Arc<LensPack>),
}

/// Where the ghosts of a job come from.
enum Asked<'l> {
    Design(&'l System, GhostOptions),
    Pack(&'l Arc<LensPack>),
}

/// What `args` ask for of `lens`; none without ghosts.
fn asked<'l>(args: &RunArgs, lens: &'l UntracedLens, frame: &Frame) -> Result<Option<Asked<'l>>> {
    let given = &args.veil.ghosts;
    if !given.is_on() {
        return Ok(None);
    }
    let design = match lens {
        UntracedLens::Design(design) => design,
        UntracedLens::Pack(pack) => return of_pack(args, pack).map(Some),
    };
    check_coatings(&args.tracing.coatings)?;
    let film = Rect::new(0, 0, frame.film.height, frame.film.width);
    let corner_mm = frame.farthest_mm(film) + 0.5 * frame.pitch_mm();
    Ok(Some(Asked::Design(&design.system, options(given, corner_mm)?)))
}

fn of_pack<'l>(args: &RunArgs, pack: &'l Arc<LensPack>) -> Result<Asked<'l>> {
    if pack.ghosts().is_none() {
        return Err(usage(format!(
            "--ghosts on: lens pack `{}` has no ghosts; give its design, or a pack of `lens trace --ghosts on`",
            args.lens
        )));
    }
    match args.veil.ghosts.tracing_flag() {
        Some(flag) => Err(usage(format!(
            "{flag}: the ghosts of lens pack `{}` were traced before; leave it out, or give the flag to `lens trace`",
            args.lens
        ))),
        None => Ok(Asked::Pack(pack)),
    }
}

/// Fails for coatings without ghosts.
///
/// # Errors
/// Usage.
pub fn check_coatings(coatings: &CoatingsArg) -> Result<()> {
    match coatings {
        CoatingsArg::Ideal => Err(usage(
            "--ghosts on: a lens with ideal coatings has no ghosts; choose its coatings (--coatings none, mgf2, design or a file)",
        )),
        _ => Ok(()),
    }
}

/// What the ghosts that `given` asks for are computed with, on a film whose corner is `corner_mm` from the axis.
///
/// # Errors
/// A reflectance of the film that cannot be read.
pub fn options(given: &GhostArgs, corner_mm: f64) -> Result<GhostOptions> {
    let film_reflectance = given.sensor_reflectance.as_ref().map(design::reflectance).transpose()?;
    Ok(GhostOptions {
        corner_mm,
        rings: given.ghost_rings.unwrap_or(GHOST_RINGS),
        film_reflectance: film_reflectance.unwrap_or_default(),
    })
}

/// What ghosts add to the identity of a job: the design with its clear radii, which the tables of the lens do not hold. Those of a pack belong to its digest.
pub fn identity(args: &RunArgs, lens: &UntracedLens, frame: &Frame) -> Result<Option<Value>> {
    Ok(asked(args, lens, frame)?.map(|asked| match asked {
        Asked::Design(system, options) => json!({
            "version": GHOSTS_VERSION,
            "design": blake3::hash(system.identity().as_bytes()).to_hex().to_string(),
            "rings": options.rings,
            "sensor_reflectance": options.film_reflectance.0,
        }),
        Asked::Pack(_) => json!("on"),
    }))
}

impl JobGhosts {
    /// Those of `args`; none without them.
    ///
    /// # Errors
    /// Usage: a lens without surfaces that reflect, or a pack without ghosts. A reflectance of the film that cannot be read or has not all wavelengths.
    pub fn new(
        args: &RunArgs,
        lens: &UntracedLens,
        frame: &Frame,
        wavelengths_nm: &[f64],
        threads: usize,
    ) -> Result<Option<Self>> {
        let (system, options) = match asked(args, lens, frame)? {
            None => return Ok(None),
            Some(Asked::Pack(pack)) => return Ok(Some(Self::Stored(Arc::clone(pack)))),
            Some(Asked::Design(system, options)) => (system, options),
        };
        for nm in wavelengths_nm {
            options.film_reflectance.at(*nm)?;
        }
        note_left_out(system, &options);
        let traced = TracedGhosts::new(system, options, wavelengths_nm, threads);
        Ok(Some(Self::Traced(Box::new(traced))))
    }

    /// Description in the film.
    pub fn part(&self) -> Value {
        match self {
            Self::Traced(of) => {
                json!({ "rings": of.options.rings, "sensor_reflectance": of.options.film_reflectance.0 })
            }
            Self::Stored(pack) => {
                let reflectance = |ghosts: &PackGhosts| {
                    let bands = pack.lens().bands.iter().zip(&ghosts.film_reflectance);
                    bands.map(|(band, share)| (band.wavelength_nm, *share)).collect::<Vec<_>>()
                };
                json!({
                    "rings": pack.ghosts().map(|ghosts| ghosts.sizes.rings),
                    "sensor_reflectance": pack.ghosts().map(reflectance),
                })
            }
        }
    }

    /// Bytes while they are traced or read.
    pub fn making_bytes(&self) -> usize {
        match self {
            Self::Traced(of) => ghost_memory_bytes(&of.system, &of.options, &of.wavelengths_nm, of.threads),
            // Operators of two bands and their mean, and decoded chunks.
            Self::Stored(pack) => {
                pack.ghosts().map_or(0, |ghosts| 16 * ghosts.sizes.shape().iter().product::<usize>())
            }
        }
    }

    /// Core seconds of tracing a band.
    pub fn making_s(&self) -> f64 {
        match self {
            Self::Traced(of) => {
                ghost_seconds(&of.system, &of.options, &of.wavelengths_nm) / of.wavelengths_nm.len() as f64
            }
            Self::Stored(_) => 0.0,
        }
    }

    /// Share that the film reflects in the ghosts of a band.
    ///
    /// # Errors
    /// A wavelength outside the table of the reflectance.
    pub fn film_reflectance(&self, plan: &BandPlan) -> Result<f64, DesignError> {
        match self {
            Self::Traced(of) => of.options.film_reflectance.at(plan.lens.wavelength_nm),
            Self::Stored(pack) => {
                Ok(pack.ghosts().map_or(0.0, |ghosts| ghosts.film_reflectance[plan.lens_bands.first]))
            }
        }
    }

    /// The operator of a band on the film.
    ///
    /// # Errors
    /// A wavelength outside the tables of a glass or a coating; errors of reading a pack.
    pub fn operator(&self, plan: &BandPlan) -> Result<RingOperator, SourceSinkError> {
        let pack = match self {
            Self::Traced(traced) => return Ok(traced.operator(plan.lens.wavelength_nm)?),
            Self::Stored(pack) => pack,
        };
        let of_band =
            |band| Ok::<_, LensPackError>(pack.ghost_operator(band)?.expect("checked at the start"));
        let first = of_band(plan.lens_bands.first)?;
        match plan.lens_bands.second {
            None => Ok(first),
            Some((second, share)) => Ok(first.towards(&of_band(second)?, share)),
        }
    }
}
