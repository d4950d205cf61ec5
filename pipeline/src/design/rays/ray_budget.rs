//! Budget of the rays that a search may aim.
//!
//! To aim a ray costs 1 to 8 rays to the stop in a real lens. Where surfaces fold over (aspheric coefficients with a wrong digit) most rays
//! are lost, each after hundreds of attempts, and the search for the rim of the pupil takes seconds. The rays to the stop that one search
//! aims are therefore counted, on one thread, so that the result is the same on every machine; a search with more of them is an error that
//! names the surface at which most rays were lost.

use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

use super::ray::{Lost, Tracer};
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::RayAiming;

/// Rays to the stop of one search, and those lost at each surface.
#[derive(Debug)]
pub(super) struct RayBudget {
    max: u32,
    aimed: AtomicU32,
    lost: Vec<AtomicU32>,
}

impl Clone for RayBudget {
    fn clone(&self) -> Self {
        let copy = |count: &AtomicU32| AtomicU32::new(count.load(Relaxed));
        Self { max: self.max, aimed: copy(&self.aimed), lost: self.lost.iter().map(copy).collect() }
    }
}

impl Tracer<'_> {
    /// The result of `work`, which aims at most `max` rays, with a tracer that counts them; `work` uses one thread.
    ///
    /// # Errors
    /// That of `work`; [`DesignError::Ray`] if it needs more rays.
    pub(in crate::design) fn within_budget<T>(
        &self,
        tan: f64,
        max: u32,
        work: impl FnOnce(&Self) -> Result<T, DesignError>,
    ) -> Result<T, DesignError> {
        if self.budget.is_some() {
            return work(self);
        }
        if self.aiming() == RayAiming::Real {
            // Followed once, not by each search.
            self.chiefs();
        }
        let lost = (0..self.surfaces()).map(|_| AtomicU32::new(0)).collect();
        let budget = RayBudget { max, aimed: AtomicU32::new(0), lost };
        let mut counting = self.clone();
        counting.budget = Some(budget);
        let found = work(&counting);
        // A search that is out of rays may have taken the rest for blocked.
        counting.check_budget(tan).and(found)
    }

    /// Counts a ray to the stop.
    pub(super) fn count_ray(&self, tan: f64) -> Result<(), DesignError> {
        if let Some(budget) = &self.budget {
            budget.aimed.fetch_add(1, Relaxed);
        }
        self.check_budget(tan)
    }

    /// [`Tracer::lost`] of a ray to the stop.
    pub(super) fn lost_in_search(&self, tan: f64, p: f64, q: f64, lost: Lost) -> DesignError {
        if let Some(count) = self.budget.as_ref().and_then(|b| b.lost.get(lost.surface)) {
            count.fetch_add(1, Relaxed);
        }
        self.lost(tan, p, q, lost)
    }

    fn check_budget(&self, tan: f64) -> Result<(), DesignError> {
        let Some(budget) = self.budget.as_ref().filter(|b| b.aimed.load(Relaxed) > b.max) else {
            return Ok(());
        };
        let lost = budget.lost.iter().map(|count| count.load(Relaxed)).enumerate();
        let place = match lost.max_by_key(|(i, count)| (*count, std::cmp::Reverse(*i))) {
            Some((surface, count)) if count > 0 => {
                format!("most of those lost end at surface {}", surface + 1)
            }
            _ => "they do not converge".to_owned(),
        };
        Err(DesignError::Search {
            field_tan: tan,
            wavelength_um: self.wavelength_um,
            rays: budget.max,
            place,
        })
    }
}
