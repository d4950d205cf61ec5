//! What films of one lens and pitch share, wherever they lie in its field: kernels and spectra.
//!
//! A design is traced up to a step of its field ([`crate::job::lens`]), so that films at several places have several sets of kernels. Sets are kept up to a share of the
//! memory, spectra of all of them in one cache.

use crate::job::Job;
use crate::job::stages;
use anyhow::Result;
use pipeline::band::BandStages;
use pipeline::geometry::Size;
use pipeline::psf::BandPsf;
use pipeline::psf::spectra::SpectrumCache;
use pipeline::tails::{TailKernels, TailPlan};
use std::sync::{Arc, Mutex};

/// Sizes and scales of films of which a set keeps the kernels of tails.
const MAX_SIZES: usize = 2;
/// Of the limit of memory, one part in so many is for the kernels of all sets.
const KERNEL_PART: u64 = 4;

/// Sets of kernels of a lens.
#[derive(Default)]
pub struct SharedSets {
    sets: Vec<Arc<SharedStages>>,
    /// Spectra of the kernels of all sets.
    spectra: Option<Arc<SpectrumCache>>,
    /// The first id of a band in their cache that is not used yet.
    next_id: usize,
}

/// PSF stages of the bands of a lens on films of one pitch.
pub struct SharedStages {
    /// What they depend on.
    key: String,
    psfs: Vec<Option<Arc<BandPsf>>>,
    /// Bytes of their kernels.
    kernel_bytes: u64,
    spectra: Arc<SpectrumCache>,
    /// Kernels of tails by size and scale of the film.
    tails: Mutex<Vec<SizedTails>>,
}

/// Kernels of the tails of all bands on films of one size and scale.
struct SizedTails {
    film: Size,
    scale: (f64, f64),
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
        let new = || Arc::new(SpectrumCache::new(job.memory.spectra));
        let spectra = Arc::clone(self.spectra.get_or_insert_with(new));
        let first_id = self.next_id;
        self.next_id += job.plans.len();
        let psf = |position: usize| Ok(stages::with_id(job, position, first_id + position)?.psf);
        let psfs = (0..job.plans.len()).map(psf).collect::<Result<Vec<_>>>()?;
        let kernel_bytes = job.plans.iter().map(|plan| plan.kernels_bytes() as u64).sum();
        Ok(Arc::new(SharedStages { key, psfs, kernel_bytes, spectra, tails: Mutex::default() }))
    }

    /// Forgets the sets that were used longest ago, until the kernels of the others take at most their part of `memory` bytes; returns what it forgot.
    pub fn trim(&mut self, memory: u64) -> Vec<Arc<SharedStages>> {
        let mut forgotten = Vec::new();
        while self.sets.len() > 1
            && self.sets.iter().map(|set| set.kernel_bytes).sum::<u64>() > memory / KERNEL_PART
        {
            forgotten.push(self.sets.remove(0));
        }
        forgotten
    }
}

impl SharedStages {
    /// Spectra of the kernels.
    pub fn spectra(&self) -> &Arc<SpectrumCache> {
        &self.spectra
    }

    /// The kernels of the tails of the bands of `job`; none where they would take more than their part of the memory: they are then made anew for each film.
    pub fn tails(&self, job: &Job) -> Vec<Option<Arc<TailKernels>>> {
        let (film, scale) = (job.frame.film, job.frame.scale);
        let plans = job.plans.iter().filter_map(|plan| plan.tail.as_ref());
        let bytes = plans.map(|tail| tail.kernel_bytes() as u64).sum::<u64>() * MAX_SIZES as u64;
        if bytes > job.memory.limit as u64 / KERNEL_PART {
            return vec![None; job.plans.len()];
        }
        let mut known = self.tails.lock().expect("no panic while held");
        if let Some(tails) = known.iter().find(|tails| tails.film == film && tails.scale == scale) {
            return tails.bands.clone();
        }
        let kernels = |plan: &TailPlan| Arc::new(TailKernels::new(plan, job.options.simd));
        let bands: Vec<_> = job.plans.iter().map(|plan| plan.tail.as_ref().map(kernels)).collect();
        if known.len() == MAX_SIZES {
            known.remove(0);
        }
        known.push(SizedTails { film, scale, bands: bands.clone() });
        bands
    }

    /// The stages of the bands of `job`, one of those that share these.
    pub fn stages(&self, job: &Job) -> Vec<BandStages> {
        let stages = |position: usize| stages::with_psf(job, position, self.psfs[position].clone());
        (0..job.plans.len()).map(stages).collect()
    }
}
