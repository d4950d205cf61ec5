//! Ghosts of a design: operators traced when the first layer needs one, and stored in the cache.

use super::notes::small_ghosts;
use crate::job::lens::cache::Cache;
use crate::job::lens::cache::operators::{CachedGhosts, ghosts_recipe};
use crate::progress::log_line;
use pipeline::design::ghost::geometry_nm;
use pipeline::design::ghost::operator::trace_ghosts;
use pipeline::design::ghost::options::GhostOptions;
use pipeline::design::ghost::rings::{RingOperator, RingSizes};
use pipeline::design::trace::with_threads;
use pipeline::design::{DesignError, System};
use std::sync::{Mutex, OnceLock};

/// Ghosts of a design.
pub struct TracedGhosts {
    pub(super) system: System,
    pub(super) options: GhostOptions,
    /// Wavelengths of the job, nm.
    pub(super) wavelengths_nm: Vec<f64>,
    pub(super) threads: usize,
    /// Bands that are traced and not yet used.
    traced: Mutex<Vec<(f64, CachedGhosts)>>,
    /// None if it cannot be written.
    cache: OnceLock<Option<Cache>>,
}

impl TracedGhosts {
    /// Those of `system`, none of them traced, at `wavelengths_nm`.
    pub(super) fn new(
        system: &System,
        options: GhostOptions,
        wavelengths_nm: &[f64],
        threads: usize,
    ) -> Self {
        Self {
            system: system.clone(),
            options,
            wavelengths_nm: wavelengths_nm.to_vec(),
            threads,
            traced: Mutex::default(),
            cache: OnceLock::new(),
        }
    }

    /// The operator of the band at `nm`. Bands that share its rays are traced with it.
    ///
    /// # Errors
    /// A wavelength outside the tables of a glass or a coating.
    pub(super) fn operator(&self, nm: f64) -> Result<RingOperator, DesignError> {
        let mut traced = self.traced.lock().expect("no panic while held");
        let take = |traced: &mut Vec<(f64, CachedGhosts)>| {
            let k = traced.iter().position(|band| band.0 == nm)?;
            Some(traced.swap_remove(k).1)
        };
        let found = match take(&mut traced).or_else(|| self.find(nm)) {
            Some(found) => found,
            None => {
                *traced = self.trace(nm)?;
                take(&mut traced).expect("the band is traced")
            }
        };
        found.notes.iter().for_each(log_line);
        Ok(found.operator)
    }

    fn find(&self, nm: f64) -> Option<CachedGhosts> {
        let cache = self.cache.get_or_init(Cache::open_if_usable).as_ref()?;
        let sizes = RingSizes::new(self.options.corner_mm, self.options.rings);
        cache.find_ghosts(&ghosts_recipe(&self.system, nm, &self.options), sizes)
    }

    /// Traces the bands that share the rays of the one at `nm`, and stores them in the cache.
    fn trace(&self, nm: f64) -> Result<Vec<(f64, CachedGhosts)>, DesignError> {
        let mut together: Vec<f64> = self
            .wavelengths_nm
            .iter()
            .copied()
            .filter(|other| geometry_nm(*other) == geometry_nm(nm))
            .collect();
        together.sort_by(f64::total_cmp);
        together.dedup();
        let bands = with_threads(self.threads, || trace_ghosts(&self.system, &together, &self.options))?;
        let mut traced = Vec::with_capacity(bands.len());
        let mut cache = self.cache.get_or_init(Cache::open_if_usable).as_ref();
        for band in bands {
            let nm = band.wavelength_nm;
            let ghosts = CachedGhosts { notes: small_ghosts(&self.system, &band), operator: band.operator };
            let recipe = ghosts_recipe(&self.system, nm, &self.options);
            if let Some(Err(error)) = cache.map(|cache| cache.insert_ghosts(&recipe, &ghosts)) {
                log_line(format!(
                    "note: ghosts cannot be stored in the cache ({}); they are traced for this run only",
                    crate::failure::line(&error)
                ));
                cache = None;
            }
            traced.push((nm, ghosts));
        }
        Ok(traced)
    }
}
