//! Lens of a run: a pack, or a design traced at the wavelengths of the job ([`tracing`]).

pub mod asymmetric;
pub mod attributes;
mod band_widths;
mod blur;
pub mod built;
pub mod cache;
pub mod depth_nodes;
pub mod drawn;
pub mod energy;
mod estimate;
pub mod known;
mod planar;
mod planar_bands;
mod reach;
pub mod request;
pub mod samples;
pub mod tails;
mod traced;
mod tracing;
mod tracing_job;
mod untraced;

use crate::design::DesignFile;
use crate::progress::interrupt::Unchecked;
use anyhow::{Context, Result};
use asymmetric::AsymmetricLens;
use drawn::DrawnLens;
pub use estimate::estimated;
use formats::durable::fault_point;
use formats::lens::{LensPack, LensPackError};
use pipeline::band::{BandPlan, LensBands, Options};
use pipeline::geometry::Frame;
use pipeline::lens::PsfSample;
use pipeline::lens::{Lens, LensBand, PsfStack};
use pipeline::psf::kernel::NodeKernels;
use pipeline::psf::kernel::on_demand::PsfReader;
use pipeline::simd::Simd;
use serde_json::Value;
use std::sync::Arc;
use traced::Traced;
pub use tracing::without_tracing_flags;
use tracing_job::TracingJob;
pub use tracing_job::{EstimatedLens, TracedFor};
pub use untraced::{UntracedDesign, UntracedLens};

/// Most threads that read PSFs to be reduced, and the most memory that they may need.
const MAX_READERS: usize = 4;
const MAX_READING_BYTES: usize = 192 << 20;

/// Threads that read PSFs to be reduced, of `threads`: each computes one in `reading_bytes` of its own.
pub fn psf_readers(threads: usize, reading_bytes: usize) -> usize {
    threads.min(MAX_READERS).min(MAX_READING_BYTES / reading_bytes.max(1)).max(1)
}

/// The name of a lens for people: a design need not have one.
pub fn shown_name(name: &str) -> &str {
    if name.is_empty() { "a lens without a name" } else { name }
}

/// Lens of a job.
pub enum JobLens {
    /// A lens pack with its bands.
    Pack(Arc<LensPack>),
    /// A design, traced at the wavelengths of the job.
    Traced(Arc<Traced>),
}

impl JobLens {
    /// Lens for bands at `wavelengths_nm` on the film of `frame`, for surfaces at several distances if `depth` has them; traces the bands that are not in the
    /// cache.
    pub fn new(
        input: UntracedLens,
        frame: &Frame,
        wavelengths_nm: &[f64],
        options: &Options,
        threads: usize,
        depth: Option<TracedFor<'_>>,
    ) -> Result<Self> {
        match input {
            UntracedLens::Pack(pack) => Ok(Self::Pack(pack)),
            UntracedLens::Design(design) => {
                let UntracedDesign { system, name, file, tracing, bands, asymmetric, known } = *design;
                let job = TracingJob {
                    system: &system,
                    name: &name,
                    frame,
                    options,
                    tracing: tracing.as_ref(),
                    depth,
                    bands: bands.as_ref(),
                    asymmetric: asymmetric.as_ref().filter(|lens| !lens.is_symmetric()),
                };
                let key = known.as_ref().and_then(|_| known::key(&job, wavelengths_nm));
                let kept = known.zip(key);
                if let Some(lens) = kept.as_ref().and_then(|(known, key)| known.find(key))
                    && lens.covers(&job)
                {
                    return Ok(Self::Traced(lens));
                }
                let traced = {
                    let _unchecked = Unchecked::begin();
                    fault_point("tracing");
                    self::tracing::trace(&job, wavelengths_nm, threads)
                };
                let traced = traced.with_context(|| format!("tracing {name}"));
                let traced = match &tracing {
                    Some(_) => traced?,
                    None => traced.map_err(|e| without_tracing_flags(&name, e))?,
                };
                let drawn = match asymmetric {
                    Some(AsymmetricLens::Drawn(drawn)) => Some(*drawn),
                    _ => None,
                };
                let lens = Arc::new(Traced { file, drawn, ..traced });
                if let Some((known, key)) = kept.filter(|_| !lens.is_for_one_film) {
                    known.keep(key, &lens);
                }
                Ok(Self::Traced(lens))
            }
        }
    }

    pub fn lens(&self) -> &Lens {
        match self {
            Self::Pack(pack) => pack.lens(),
            Self::Traced(traced) => &traced.lens,
        }
    }

    /// Manufacturing errors of a lens as built, and what was adjusted, as recorded in its pack.
    pub fn errors(&self) -> Option<[(&'static str, Value); 2]> {
        let pack = match self {
            Self::Pack(pack) => pack,
            Self::Traced(traced) => match &traced.drawn {
                Some(drawn) if drawn.is_nominal() => {
                    return Some([("errors", drawn.record.clone()), ("compensators", built::unmoved())]);
                }
                _ => traced.packs.first()?,
            },
        };
        let attributes = pack.attributes();
        Some([("errors", attributes.errors.clone()?), ("compensators", attributes.compensators.clone()?)])
    }

    /// The lens pack; none for a design.
    pub fn pack(&self) -> Option<&LensPack> {
        match self {
            Self::Pack(pack) => Some(pack),
            Self::Traced(_) => None,
        }
    }

    /// Whether it is a sealed pack, of which a film records no file.
    pub fn is_sealed(&self) -> bool {
        self.pack().is_some_and(|pack| pack.attributes().sealed)
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

    /// PSFs of band `band` as the stages of `plan` need them, at least those of the first `sets` sets: of a traced band no others. Reduced PSFs are read in parts, by
    /// [`psf_readers`] of `threads` threads.
    ///
    /// # Errors
    /// As [`JobLens::psf`].
    pub fn planned_psfs(
        &self,
        plan: &BandPlan,
        band: usize,
        sets: usize,
        threads: usize,
    ) -> Result<PsfStack, LensPackError> {
        let (pack, index) = self.pack_of(band);
        let LensBand { psf_size: size, psf_pitch_um: pitch_um, .. } = self.lens().bands[band];
        let of_sets = |sets, threads| {
            let samples = pack.psfs_of_sets(index, plan.node.unwrap_or(0), sets, threads)?;
            Ok(PsfStack { size, pitch_um, sample: self.lens().psf_sample, samples })
        };
        if plan.is_coarse() {
            let readers = psf_readers(threads, self.psf_reading_bytes(band));
            return plan.samples.read(sets, readers, |sets| of_sets(sets, readers));
        }
        match (self, plan.node) {
            (_, Some(node)) => self.psf_of_node(band, node),
            (Self::Pack(pack), None) => pack.psf(band),
            (Self::Traced(_), None) => of_sets(0..sets, 1),
        }
    }

    /// PSFs of depth node `node` of band `band` of [`JobLens::lens`].
    ///
    /// # Errors
    /// As [`LensPack::psf_of_node`].
    pub fn psf_of_node(&self, band: usize, node: usize) -> Result<PsfStack, LensPackError> {
        match self {
            Self::Pack(pack) => pack.psf_of_node(band, node),
            Self::Traced(traced) if traced.lens.depth.is_some() => traced.packs[band].psf_of_node(0, node),
            Self::Traced(_) => self.psf(band),
        }
    }

    /// The pack with band `band` of [`JobLens::lens`], and its index there.
    fn pack_of(&self, band: usize) -> (&Arc<LensPack>, usize) {
        match self {
            Self::Pack(pack) => (pack, band),
            Self::Traced(traced) => (&traced.packs[band], 0),
        }
    }

    /// Reader of sets of PSFs of band `band` of [`JobLens::lens`], or of its depth nodes; computed on `threads` threads.
    pub fn psf_reader(&self, band: usize, threads: usize) -> PsfReader {
        let (pack, band) = self.pack_of(band);
        let pack = Arc::clone(pack);
        Arc::new(move |node, sets| Ok(pack.psfs_of_sets(band, node, sets, threads)?))
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
                traced.packs.iter().try_for_each(|pack| pack.check_unchanged())?;
                traced.drawn.as_ref().map_or(Ok(()), DrawnLens::check_unchanged)?;
                traced.file.as_ref().map_or(Ok(()), DesignFile::check_unchanged)
            }
        }
    }

    /// Bytes that reading the PSFs of a band of [`JobLens::lens`] needs in addition to the samples.
    pub fn psf_reading_bytes(&self, band: usize) -> usize {
        let (pack, band) = self.pack_of(band);
        pack.psf_reading_bytes(band)
    }

    /// Maximum over the bands of the bytes that reading a band needs, its PSFs or pupil functions; the digest reads all bands in sequence.
    pub fn max_reading_bytes(&self) -> usize {
        let bytes = |(b, band): (usize, &LensBand)| {
            if self.pack_of(b).0.has_pupils() {
                return self.psf_reading_bytes(b);
            }
            let nodes = self.lens().depth.iter().flat_map(|depth| &depth.bands[b].nodes);
            let samples = nodes.map(|node| node.psf_height_mm.len() * node.psf_size.pow(2)).max();
            let samples = samples.unwrap_or(band.psf_count() * band.psf_size * band.psf_size);
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

    /// For a film in physical units: what coatings would take from the light of a design without them.
    pub fn ideal_light(&self) -> Option<&str> {
        match self {
            Self::Pack(_) => None,
            Self::Traced(traced) => traced.ideal_light.as_deref(),
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

/// Estimated L1 error of rotating the kernels of an integrated pack at the primary wavelength; none for point samples.
pub fn rotation_error(pack: &LensPack) -> Result<Option<f64>> {
    let lens = pack.lens();
    if lens.psf_sample != PsfSample::Integrated || lens.bands.is_empty() {
        return Ok(None);
    }
    let band = samples::nearest_band(&lens.bands, lens.primary_wavelength_nm);

    let kernels = NodeKernels::new(&pack.psf(band)?, lens.bands[band].psf_pitch_um, None, Simd::PORTABLE);
    Ok(Some(kernels.rotation_error()))
}
