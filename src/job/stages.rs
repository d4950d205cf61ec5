//! The stages of a job's bands, with the PSFs of its lens.

use crate::job::Job;
use formats::lens::LensPackError;
use pipeline::band::BandStages;
use pipeline::flow::SourceSinkError;
use std::sync::Mutex;

/// A band's stages could not be constructed.
#[derive(Debug, thiserror::Error)]
pub enum StageError {
    /// Tables of the lens.
    #[error(transparent)]
    Lens(#[from] pipeline::lens::LensError),
    /// The lens pack.
    #[error(transparent)]
    Pack(#[from] LensPackError),
}

/// Constructs the stages of a band.
///
/// # Errors
/// The PSFs cannot be read.
pub fn stages(job: &Job, position: usize) -> Result<BandStages, StageError> {
    let (plan, gain) = (&job.plans[position], job.gains[position]);
    if plan.depth.is_some() {
        let reader = job.lens.psf_reader(plan.lens_bands.first);
        return Ok(plan.depth_stages(position, &job.frame, job.lens.lens(), &job.options, gain, reader));
    }
    let read_psfs = |band: usize| match plan.node {
        Some(node) => Ok(job.lens.psf_of_node(band, node)?),
        None => Ok::<_, StageError>(job.lens.psf(band)?),
    };
    plan.stages(position, &job.frame, &job.options, gain, read_psfs)
}

/// Constructs the stages of a band; `energy` receives the share of the light inside its PSF windows, the mean over heights.
pub fn prepare(
    job: &Job,
    position: usize,
    energy: &Mutex<Vec<Option<f64>>>,
) -> Result<BandStages, SourceSinkError> {
    let plan = &job.plans[position];
    let stages = stages(job, position)?;
    if let Some(psf) = &stages.psf {
        let windows = std::iter::zip(&plan.lens.psf_energy, psf.kernels().energy());
        let mean = windows.map(|(pack, crop)| pack * crop).sum::<f64>() / plan.lens.psf_energy.len() as f64;
        energy.lock().expect("no panic while held")[position] = Some(mean);
    }
    Ok(stages)
}
