//! What films of one lens and pitch share, wherever they lie in its field: kernels and spectra.
//!
//! A design is traced up to a step of its field ([`crate::job::lens`]), so that films at several places have several sets of kernels. Sets are kept up to a share of the
//! memory, spectra of all of them in one cache.

use crate::job::Job;
use crate::job::stages;
use anyhow::Result;
use pipeline::band::{BandPlan, BandStages};
use pipeline::geometry::Size;
use pipeline::psf::BandPsf;
use pipeline::psf::spectra::SpectrumCache;
use pipeline::tails::{TailKernels, TailPlan};
use std::sync::{Arc, Mutex, OnceLock};

/// Sizes and scales of films of which a set keeps the kernels of tails.
const MAX_SIZES: usize = 2;
/// Of the limit of memory, one part in so many is for the kernels of all sets and the spectra of their tails.
const KERNEL_PART: u64 = 4;
/// Of that part, one in so many is for the spectra of the tails of a set on films of one size.
const TAIL_PART: u64 = 4;

/// Sets of kernels of a lens.
#[derive(Default)]
pub struct SharedSets {
    sets: Vec<Arc<SharedStages>>,
    /// Sets so far.
    made: usize,
    spectra: OnceLock<Arc<SpectrumCache>>,
}

/// PSF stages of the bands of a lens on films of one pitch.
pub struct SharedStages {
    /// What they depend on.
    key: String,
    psfs: Vec<Option<Arc<BandPsf>>>,
    /// Bytes of their kernels.
    kernel_bytes: u64,
    /// Spectra of their kernels, and of those of other sets.
    pub spectra: Arc<SpectrumCache>,
    /// Kernels of tails by size and scale of the film.
    tails: Mutex<Vec<SizedTails>>,
}

/// Kernels of the tails of all bands on films of one size and scale.
struct SizedTails {
    film: Size,
    scale: (f64, f64),
    bytes: u64,
    bands: Vec<Option<Arc<TailKernels>>>,
}

impl SharedSets {
    /// The set of `job`, known or new.
    ///
    /// # Errors
    /// The PSFs cannot be read.
    pub fn of_job(&mut self, job: &Job) -> Result<Arc<SharedStages>> {
        let options = &job.options;
        let tails: Vec<bool> = job.plans.iter().map(|plan| plan.tail.is_some()).collect();
        let key = format!(
            "{} {} {:?} {:?} {:?} {:?} {:?} {tails:?}",
            job.lens.digest()?,
            job.frame.pitch_um,
            options.stages,
            options.azimuths,
            options.psf_window,
            options.between,
            options.simd.isa(),
        );
        let found = match self.sets.iter().position(|set| set.key == key) {
            Some(at) => self.sets.remove(at),
            None => self.new_set(job, key)?,
        };
        self.sets.push(Arc::clone(&found));
        Ok(found)
    }

    fn new_set(&mut self, job: &Job, key: String) -> Result<Arc<SharedStages>> {
        let first_id = self.made * job.plans.len();
        let psf = |position: usize| Ok(stages::with_id(job, position, first_id + position)?.psf);
        let psfs = (0..job.plans.len()).map(psf).collect::<Result<Vec<_>>>()?;
        self.made += 1;
        let spectra = self.spectra.get_or_init(|| Arc::new(SpectrumCache::new(job.memory.spectra)));
        let kernel_bytes = job.plans.iter().map(|plan| plan.kernels_bytes() as u64).sum();
        let spectra = Arc::clone(spectra);
        Ok(Arc::new(SharedStages { key, psfs, kernel_bytes, spectra, tails: Mutex::default() }))
    }

    /// Forgets the sets that were used longest ago, until the kernels of the others take at most their part of `memory` bytes; returns what it forgot.
    pub fn trim(&mut self, memory: u64) -> Vec<Arc<SharedStages>> {
        let mut forgotten = Vec::new();
        while self.sets.len() > 1
            && self.sets.iter().map(|set| set.bytes()).sum::<u64>() > memory / KERNEL_PART
        {
            forgotten.push(self.sets.remove(0));
        }
        forgotten
    }
}

impl SharedStages {
    /// Bytes of its kernels and of the spectra of its tails.
    fn bytes(&self) -> u64 {
        let tails = self.tails.lock().expect("no panic while held");
        self.kernel_bytes + tails.iter().map(|tails| tails.bytes).sum::<u64>()
    }

    /// The kernels of the tails of the bands of `job`, where they are small enough to be kept.
    pub fn tails(&self, job: &Job) -> Vec<Option<Arc<TailKernels>>> {
        let (film, scale) = (job.frame.film, job.frame.scale);
        let mut known = self.tails.lock().expect("no panic while held");
        if let Some(tails) = known.iter().find(|tails| tails.film == film && tails.scale == scale) {
            return tails.bands.clone();
        }
        let plans = || job.plans.iter().filter_map(|plan| plan.tail.as_ref());
        let needed = plans().map(TailPlan::kept_bytes).sum::<usize>() as u64;
        let is_kept = needed <= job.memory.limit as u64 / KERNEL_PART / TAIL_PART;
        let bytes = if is_kept { needed } else { 0 };
        let kernels = |plan: &TailPlan| Arc::new(TailKernels::new(plan, job.options.simd, true));
        let of_band = |plan: &BandPlan| plan.tail.as_ref().filter(|_| is_kept).map(kernels);
        let bands: Vec<_> = job.plans.iter().map(of_band).collect();
        if known.len() == MAX_SIZES {
            known.remove(0);
        }
        known.push(SizedTails { film, scale, bytes, bands: bands.clone() });
        bands
    }

    /// The stages of the bands of `job`, one of those that share these.
    pub fn stages(&self, job: &Job) -> Vec<BandStages> {
        let stages = |position: usize| stages::with_psf(job, position, self.psfs[position].clone());
        (0..job.plans.len()).map(stages).collect()
    }
}
