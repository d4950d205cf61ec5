//! Traced lenses that a process keeps: films at many places of one lens find their bands without rays and without files.
//!
//! A lens is kept by all that its trace depends on: design, flags, wavelengths, trace pitch, and how far from the axis its bands are needed. A band that a film
//! made wider than that ([`super::tracing`]) depends on the film beyond these: its lens is not kept. Nor are lenses without rotational symmetry, or with depth nodes, which are
//! traced over each film or scene.

use super::traced::Traced;
use super::tracing_job::TracingJob;
use pipeline::stage::Stage;
use std::sync::{Arc, Mutex};

/// Lenses that are kept.
const MAX_LENSES: usize = 8;

/// Lenses that were traced, by what they depend on; the one used last at the end.
#[derive(Default)]
pub struct KnownLenses(Mutex<Vec<(String, Arc<Traced>)>>);

impl KnownLenses {
    /// The lens of `key`.
    pub(super) fn find(&self, key: &str) -> Option<Arc<Traced>> {
        let mut known = self.0.lock().expect("no panic while held");
        let at = known.iter().position(|(own, _)| own == key)?;
        let found = known.remove(at);
        let lens = Arc::clone(&found.1);
        known.push(found);
        Some(lens)
    }

    /// Keeps `lens`, and forgets the one that was used longest ago beyond the limit.
    pub(super) fn keep(&self, key: String, lens: &Arc<Traced>) {
        let mut known = self.0.lock().expect("no panic while held");
        if known.len() == MAX_LENSES {
            known.remove(0);
        }
        known.push((key, Arc::clone(lens)));
    }
}

/// All that the bands of `job` at `wavelengths_nm` depend on, unless a film makes one wider; none if they depend on the film in other ways.
pub(super) fn key(job: &TracingJob<'_>, wavelengths_nm: &[f64]) -> Option<String> {
    if job.asymmetric.is_some() || job.depth.is_some() {
        return None;
    }
    Some(format!(
        "{} {} {:?} {:?} {} {:?} {} {} {wavelengths_nm:?}",
        job.name,
        job.system.identity(),
        job.tracing,
        job.bands,
        job.options.stages.has(Stage::Svpsf),
        job.options.interpolation.outside,
        job.frame.pitch_um,
        job.farthest_mm(),
    ))
}
