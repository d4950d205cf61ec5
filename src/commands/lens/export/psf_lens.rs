//! A lens whose PSFs are exported: a pack, or a design that is traced for the film as for `lenscube run`.

use super::psf_film::PsfFilm;
use crate::args::{LensExportArgs, TracingArgs};
use crate::commands::lens::comparison::WAVELENGTH_TOLERANCE_NM;
use crate::commands::lens::trace::wavelengths;
use crate::design::{self, DesignFile};
use crate::failure::usage;
use crate::job::default_options;
use crate::job::lens::samples::design_reach_mm;
use crate::job::lens::{JobLens, UntracedLens};
use crate::machine::threads;
use crate::open;
use crate::progress::{log_line, number};
use anyhow::{Context, Result};
use formats::lens::LensPack;
use pipeline::design::System;
use pipeline::figures::on_film::BandOnFilm;
use pipeline::geometry::Frame;
use pipeline::lens::PsfSample;
use std::sync::Arc;

/// Share of a design's field within which PSFs lie by default: tracing needs half a window beyond them, where the lens may have no rays.
const WITHIN_FIELD: f64 = 0.95;

/// A lens before its PSFs are known.
pub enum PsfLens {
    Pack(Arc<LensPack>),
    Design(Box<System>, Option<DesignFile>),
}

impl PsfLens {
    /// Opens the lens of `args`.
    ///
    /// # Errors
    /// Usage: flags of designs for a pack; a pack with PSFs of several distances.
    pub fn open(args: &LensExportArgs) -> Result<Self> {
        let name = &args.lens;
        if design::is_design(name) {
            let (system, file) = design::focused(name, &args.parameters, args.focus_m)?;
            system.notes.iter().for_each(|note| log_line(format!("note: {note}")));
            return Ok(Self::Design(Box::new(system), file));
        }
        let pack = open::lens(name)?;
        if args.focus_m.is_some() || args.parameters != Default::default() {
            return Err(usage(format!(
                "`{name}` is a lens pack, whose film plane and object distance were set when it was traced; the flags for film plane, object, aiming, \
                 glasses and coatings apply to designs only"
            )));
        }
        if pack.lens().depth.is_some() {
            return Err(usage(format!(
                "`{name}` has PSFs of several object distances: expected a lens of one; trace its design without --depths-m"
            )));
        }
        Ok(Self::Pack(Arc::new(pack)))
    }

    /// The wavelengths `nm`, ascending, as the lens has them; without any its primary one.
    ///
    /// # Errors
    /// Usage: a pack without such a band.
    pub fn wavelengths_nm(&self, args: &LensExportArgs, nm: &[f64]) -> Result<Vec<f64>> {
        let pack = match self {
            Self::Pack(pack) => pack,
            Self::Design(..) if !nm.is_empty() => return Ok(nm.to_vec()),
            Self::Design(system, _) => return Ok(vec![number(system.primary_um() * 1e3)]),
        };
        let all: Vec<f64> = pack.lens().bands.iter().map(|band| band.wavelength_nm).collect();
        let nearest = |nm: f64| {
            all.iter().copied().min_by(|a, b| (a - nm).abs().total_cmp(&(b - nm).abs())).context("no bands")
        };
        if nm.is_empty() {
            return Ok(vec![nearest(pack.lens().primary_wavelength_nm)?]);
        }
        let exact = |nm: &f64| {
            let found = nearest(*nm)?;
            match (found - nm).abs() < WAVELENGTH_TOLERANCE_NM {
                true => Ok(found),
                false => Err(usage(format!(
                    "{} has no band at {nm} nm; its bands are at {} nm",
                    args.lens,
                    pipeline::wavelengths::format(&all)
                ))),
            }
        };
        nm.iter().map(exact).collect()
    }

    /// The wavelengths of all bands of a pack, nm; those of `text` of a design.
    ///
    /// # Errors
    /// Usage: `text` is no list of wavelengths.
    pub fn all_or(&self, text: &str) -> Result<Vec<f64>> {
        match self {
            Self::Pack(pack) => Ok(pack.lens().bands.iter().map(|band| band.wavelength_nm).collect()),
            Self::Design(..) => wavelengths(text),
        }
    }

    /// Fails for a lens without rotational symmetry.
    ///
    /// # Errors
    /// Usage.
    pub fn require_symmetric(&self, args: &LensExportArgs) -> Result<()> {
        let is_symmetric = match self {
            Self::Pack(pack) => pack.lens().is_symmetric(),
            Self::Design(system, _) => system.asymmetry.is_none(),
        };
        match is_symmetric {
            true => Ok(()),
            false => Err(usage(format!(
                "{}: expected a lens with rotational symmetry, `{}` has none: its PSFs are no function of the field height",
                args.model.name(),
                args.lens
            ))),
        }
    }

    /// Half the sides (X, Y) of the default film, mm: of a pack with rotational symmetry those of the square within its image circle, of a design those of 0.95
    /// of it, of another pack those of its map.
    ///
    /// # Errors
    /// Usage: a design that has neither.
    pub fn half_sides_mm(&self, args: &LensExportArgs) -> Result<[f64; 2]> {
        let within = |mm: f64| [mm * std::f64::consts::FRAC_1_SQRT_2; 2];
        match self {
            Self::Pack(pack) if pack.lens().is_symmetric() => {
                Ok(within(pack.lens().bands.iter().map(|band| band.reach_mm()).fold(f64::INFINITY, f64::min)))
            }
            Self::Pack(pack) => Ok(pack.lens().bands.iter().fold([f64::INFINITY; 2], |least, band| {
                let half = BandOnFilm::new(band, args.film_pitch_um).half_sides_mm();
                [0, 1].map(|i| least[i].min(half[i]))
            })),
            Self::Design(system, _) if system.asymmetry.is_some() => Err(usage(format!(
                "{} has no rotational symmetry: give the film that it is traced for, --film-size WxH (with --film-pitch-um)",
                args.lens
            ))),
            Self::Design(system, _) => Ok(within(WITHIN_FIELD * design_reach_mm(system)?)),
        }
    }

    /// The lens with its PSFs at `nm` over `film`; a design is traced, unless its bands are in the cache.
    ///
    /// # Errors
    /// It cannot be traced so far; PSFs that are means over pixels for other samples than these.
    pub fn traced(self, args: &LensExportArgs, film: &PsfFilm, nm: &[f64]) -> Result<JobLens> {
        let untraced = match self {
            Self::Pack(pack) => {
                if pack.lens().psf_sample == PsfSample::Integrated {
                    check_samples(args, film, &pack)?;
                }
                UntracedLens::Pack(pack)
            }
            Self::Design(system, file) => {
                UntracedLens::of_design(&args.lens, *system, file, TracingArgs::default())?
            }
        };
        let frame = Frame::centred(film.size, film.size, film.pitch_um);
        JobLens::new(untraced, &frame, nm, &default_options(), threads(None), None)
    }
}

/// Fails unless the samples of a pack that are means over pixels are those of the film.
fn check_samples(args: &LensExportArgs, film: &PsfFilm, pack: &LensPack) -> Result<()> {
    let differs = |pitch_um: f64| (pitch_um / film.pitch_um - 1.0).abs() > 1e-9 || film.oversample != 1;
    match pack.lens().bands.iter().map(|band| band.psf_pitch_um).find(|um| differs(*um)) {
        None => Ok(()),
        Some(um) => Err(usage(format!(
            "{}: its PSFs are means over pixels of {um} µm, from which finer samples do not follow; give --film-pitch-um {um} --oversample 1",
            args.lens
        ))),
    }
}
