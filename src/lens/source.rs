//! Lens of a run: a pack, or a design traced at the wavelengths of the job ([`tracing`]).

mod tracing;

use super::cache::Cache;
use crate::args::DesignArgs;
use crate::design::{self, DesignFile};
use crate::failure::usage;
use crate::open;
use anyhow::{Context, Result};
use formats::lens::{LensPack, LensPackError};
use pipeline::band::{LensBands, Options};
use pipeline::design::System;
use pipeline::design::trace::{LensTrace, TraceOptions};
use pipeline::geometry::Frame;
use pipeline::lens::{Lens, LensBand, PsfStack};

/// Lens that `--lens` names, before tracing.
pub enum UntracedLens {
    /// Tables and PSFs in a file, or built in.
    Pack(Box<LensPack>),
    /// A design, its name, and its file unless it is built in.
    Design(Box<System>, String, Option<DesignFile>),
}

impl UntracedLens {
    /// Opens a design, a pack, or a built-in lens.
    pub fn open(name: &str) -> Result<Self> {
        if design::is_design(name) {
            let hint =
                "for other glasses, focus or object distance create a lens pack with `lenscube lens trace`";
            let (system, file) = design::open_file(name, &DesignArgs::default()).context(hint)?;
            return Ok(Self::Design(Box::new(system), name.to_owned(), file));
        }
        Ok(Self::Pack(Box::new(open::lens(name)?)))
    }

    /// Fails if `name` lacks the depth nodes that surfaces at several distances need (`has_depth`), or needs a distance.
    ///
    /// # Errors
    /// Usage.
    pub fn check_depth(&self, name: &str, has_depth: bool) -> Result<()> {
        let has_nodes = match self {
            Self::Pack(pack) => pack.lens().depth.is_some(),
            Self::Design(..) => false,
        };
        match (has_depth, has_nodes) {
            (true, false) => Err(usage(format!(
                "--depth: lens `{name}` has the PSFs of one object distance; give a lens pack with depth nodes"
            ))),
            (false, true) => Err(usage(format!(
                "lens `{name}` has depth nodes: give the distance of the chart's pixels, an array or one number in m, e.g. `--depth 2`"
            ))),
            _ => Ok(()),
        }
    }

    /// Magnification (ideal height on the film over object height) and object distance in mm; none for an object at infinity.
    pub fn conjugate(&self) -> Result<Option<(f64, f64)>> {
        let (magnification, distance) = match self {
            Self::Pack(pack) => (pack.lens().magnification, pack.lens().object_distance_mm),
            Self::Design(system, ..) => {
                let options = TraceOptions::new(Vec::from([system.primary_um() * 1e3]), 1e-3);
                let header = LensTrace::new(system, &options)?.header();
                (header.magnification, header.object_distance_mm)
            }
        };
        Ok(distance.map(|d| (magnification, d)))
    }
}

/// Lens of a job.
pub enum JobLens {
    /// A lens pack with its bands.
    Pack(Box<LensPack>),
    /// A design, traced at the wavelengths of the job.
    Traced(Box<Traced>),
}

/// Design traced at the wavelengths of a job, ascending.
pub struct Traced {
    lens: Lens,
    packs: Vec<LensPack>,
    /// Per band, the digests of its inputs and of its values.
    recipes: Vec<String>,
    digest: String,
    notes: Vec<String>,
    details: Vec<String>,
    /// File of the design, unless it is built in.
    file: Option<DesignFile>,
    /// Keeps a temporary cache until the packs are closed.
    _cache: Cache,
}

impl JobLens {
    /// Lens for bands at `wavelengths_nm` on the film of `frame`; traces the bands that are not in the cache.
    pub fn new(
        input: UntracedLens,
        frame: &Frame,
        wavelengths_nm: &[f64],
        options: &Options,
        threads: usize,
    ) -> Result<Self> {
        match input {
            UntracedLens::Pack(pack) => Ok(Self::Pack(pack)),
            UntracedLens::Design(system, name, file) => {
                let traced = tracing::trace(&system, &name, frame, wavelengths_nm, options, threads);
                let traced = traced.with_context(|| format!("tracing {name}"))?;
                Ok(Self::Traced(Box::new(Traced { file, ..traced })))
            }
        }
    }

    pub fn lens(&self) -> &Lens {
        match self {
            Self::Pack(pack) => pack.lens(),
            Self::Traced(traced) => &traced.lens,
        }
    }

    /// The lens pack; none for a design.
    pub fn pack(&self) -> Option<&LensPack> {
        match self {
            Self::Pack(pack) => Some(pack),
            Self::Traced(_) => None,
        }
    }

    /// PSFs of band `band` of [`JobLens::lens`].
    ///
    /// # Errors
    /// As [`LensPack::psf`].
    pub fn psf(&self, band: usize) -> Result<PsfStack, LensPackError> {
        match self {
            Self::Pack(pack) => pack.psf(band),
            Self::Traced(traced) => traced.packs[band].psf(0),
        }
    }

    /// PSFs of depth node `node` of band `band` of [`JobLens::lens`].
    ///
    /// # Errors
    /// As [`LensPack::psf_of_node`].
    pub fn psf_of_node(&self, band: usize, node: usize) -> Result<PsfStack, LensPackError> {
        match self {
            Self::Pack(pack) => pack.psf_of_node(band, node),
            Self::Traced(_) => self.psf(band),
        }
    }

    /// Digest of the lens.
    ///
    /// # Errors
    /// As [`LensPack::digest`].
    pub fn digest(&self) -> Result<&str, LensPackError> {
        match self {
            Self::Pack(pack) => pack.digest(),
            Self::Traced(traced) => Ok(&traced.digest),
        }
    }

    /// Digest of the tables and PSFs of one band, independent of the other bands: of a design its recipe and values, of a pack
    /// the bands that it is interpolated from.
    ///
    /// # Errors
    /// As [`LensPack::psf`].
    pub fn band_digest(&self, choice: LensBands) -> Result<String, LensPackError> {
        let digest = |band: usize| match self {
            Self::Pack(pack) => pack.band_digest(band),
            Self::Traced(traced) => Ok(traced.recipes[band].clone()),
        };
        let first = digest(choice.first)?;
        Ok(match choice.second {
            None => first,
            Some((second, _)) => format!("{first}+{}", digest(second)?),
        })
    }

    /// Checks that the pack, or the design's file, has not changed since it was opened.
    ///
    /// # Errors
    /// It changed.
    pub fn check_unchanged(&self) -> Result<()> {
        match self {
            Self::Pack(pack) => Ok(pack.check_unchanged()?),
            Self::Traced(traced) => {
                traced.packs.iter().try_for_each(LensPack::check_unchanged)?;
                traced.file.as_ref().map_or(Ok(()), DesignFile::check_unchanged)
            }
        }
    }

    /// Bytes that reading the PSFs of a band of [`JobLens::lens`] needs in addition to the samples.
    pub fn psf_reading_bytes(&self, band: usize) -> usize {
        match self {
            Self::Pack(pack) => pack.psf_reading_bytes(band),
            Self::Traced(traced) => traced.packs[band].psf_reading_bytes(0),
        }
    }

    /// Maximum over the bands of the bytes that reading the PSFs of a band needs; the digest reads all bands in sequence.
    pub fn max_reading_bytes(&self) -> usize {
        let bytes = |(b, band): (usize, &LensBand)| {
            let nodes = self.lens().depth.iter().flat_map(|depth| &depth.bands[b].nodes);
            let samples = nodes.map(|node| node.psf_height_mm.len() * node.psf_size.pow(2)).max();
            let samples = samples.unwrap_or(band.psf_height_mm.len() * band.psf_size * band.psf_size);
            4 * samples + self.psf_reading_bytes(b)
        };
        self.lens().bands.iter().enumerate().map(bytes).max().unwrap_or(0)
    }

    /// Notes for the user.
    pub fn notes(&self) -> &[String] {
        match self {
            Self::Pack(pack) => pack.notes(),
            Self::Traced(traced) => &traced.notes,
        }
    }

    /// Notes for `--verbose`: those on the glasses of a built-in design.
    pub fn details(&self) -> &[String] {
        match self {
            Self::Pack(_) => &[],
            Self::Traced(traced) => &traced.details,
        }
    }
}
