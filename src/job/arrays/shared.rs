//! What films of one lens and pitch share, wherever they lie in its field: kernels and spectra.

use crate::job::Job;
use crate::job::stages;
use anyhow::Result;
use pipeline::band::BandStages;
use pipeline::psf::BandPsf;
use pipeline::psf::spectra::SpectrumCache;
use std::sync::{Arc, Mutex};

/// Lenses at a pitch whose kernels are kept.
const MAX_KEPT: usize = 2;

/// PSF stages of the bands of a lens on films of one pitch.
pub struct SharedStages {
    /// What they depend on.
    key: String,
    psfs: Vec<Option<Arc<BandPsf>>>,
    /// Spectra of their kernels.
    pub spectra: Arc<SpectrumCache>,
}

impl SharedStages {
    /// Those of `job`, from `kept` or new.
    ///
    /// # Errors
    /// The PSFs cannot be read.
    pub fn of_job(job: &Job, kept: &Mutex<Vec<Arc<Self>>>) -> Result<Arc<Self>> {
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
        let mut kept = kept.lock().expect("no panic while held");
        if let Some(at) = kept.iter().position(|shared| shared.key == key) {
            let shared = kept.remove(at);
            kept.push(Arc::clone(&shared));
            return Ok(shared);
        }
        let psf = |position: usize| Ok(stages::stages(job, position)?.psf);
        let psfs = (0..job.plans.len()).map(psf).collect::<Result<Vec<_>>>()?;
        let spectra = Arc::new(SpectrumCache::new(job.memory.spectra));
        let shared = Arc::new(Self { key, psfs, spectra });
        if kept.len() == MAX_KEPT {
            kept.remove(0);
        }
        kept.push(Arc::clone(&shared));
        Ok(shared)
    }

    /// The stages of the bands of `job`, one of those that share these.
    pub fn stages(&self, job: &Job) -> Vec<BandStages> {
        let stages = |position: usize| stages::with_psf(job, position, self.psfs[position].clone());
        (0..job.plans.len()).map(stages).collect()
    }
}
