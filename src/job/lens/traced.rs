//! A traced design: its bands, and what identifies them.

use super::cache::Cache;
use super::drawn::DrawnLens;
use super::tracing_job::TracingJob;
use crate::design::DesignFile;
use formats::lens::LensPack;
use pipeline::lens::Lens;
use std::sync::Arc;

/// Design traced at the wavelengths of a job, ascending.
pub struct Traced {
    pub(super) lens: Lens,
    pub(super) packs: Vec<Arc<LensPack>>,
    /// Per band, the digests of its inputs and of its values.
    pub(super) recipes: Vec<String>,
    pub(super) digest: String,
    pub(super) notes: Vec<String>,
    pub(super) details: Vec<String>,
    /// What coatings would take from the light of a lens without them.
    pub(super) ideal_light: Option<String>,
    /// File of the design, unless it is built in.
    pub(super) file: Option<DesignFile>,
    /// The lens as built, if it has manufacturing errors.
    pub(super) drawn: Option<DrawnLens>,
    /// Whether a band reaches farther than the lens needs, because the film of the job needs that.
    pub(super) is_for_one_film: bool,
    /// Keeps a temporary cache until the packs are closed.
    pub(super) _cache: Cache,
}

impl Traced {
    /// Whether no band has to be wider for the film of `job`.
    pub(super) fn covers(&self, job: &TracingJob<'_>) -> bool {
        self.packs.iter().all(|pack| {
            let nm = pack.lens().bands[0].wavelength_nm;
            job.wider_for_film(pack.lens(), nm, 0.0).is_none()
        })
    }
}
