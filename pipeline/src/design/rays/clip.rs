//! Where rays cross apertures and central obscurations.
//!
//! Clipping by apertures is measured by the maximum of r²/a² − 1 over all surfaces with an aperture radius a, a central obscuration by the
//! minimum over all surfaces with an obscuration of radius a. Rays within an obscuration are traced as if it were not there.

use super::aim::{LastAim, SHORT};
use super::ray::Tracer;
use super::scalar::Scalar;
use super::surface::Ray;
use crate::design::prescription::error::DesignError;

/// Where a ray crosses apertures and obscurations: r²/a² − 1, and the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::design) struct Clip {
    /// Maximum over the apertures.
    pub(super) over: (f64, usize),
    /// Minimum over the obscurations.
    pub(super) hidden: (f64, usize),
}

impl Clip {
    pub(in crate::design) const NONE: Self =
        Self { over: (f64::NEG_INFINITY, 0), hidden: (f64::INFINITY, 0) };

    /// Whether the ray reaches the image: no aperture and no obscuration blocks it.
    pub(in crate::design) fn passes(&self) -> bool {
        self.over.0 <= 0.0 && self.hidden.0 > 0.0
    }

    /// Whether it passes all apertures and an obscuration hides it.
    pub(in crate::design) fn is_hidden(&self) -> bool {
        self.over.0 <= 0.0 && self.hidden.0 <= 0.0
    }
}

/// r²/a² − 1 of a ray at a surface.
fn place<T: Scalar>(ray: &Ray<T>, a: f64) -> f64 {
    let (x, y) = (ray.p[0].value(), ray.p[1].value());
    (x * x + y * y) / (a * a) - 1.0
}

impl Tracer<'_> {
    /// Adds the place of `ray` at surface `i` to `clip`.
    pub(super) fn clip_at<T: Scalar>(&self, clip: &mut Clip, i: usize, ray: &Ray<T>) {
        let s = &self.system.surfaces[i];
        let place = |a: f64| (place(ray, a), i);
        if let Some(over) = s.aperture_mm.map(place).filter(|o| o.0 > clip.over.0) {
            clip.over = over;
        }
        if let Some(hidden) = s.obscuration_mm.map(place).filter(|h| h.0 < clip.hidden.0) {
            clip.hidden = hidden;
        }
    }

    /// Maximum overshoot of an aperture by the ray through (p, q), and its surface: (r²/a² − 1, surface), in a search that has aimed at `last`. A ray that does not reach the
    /// image counts as blocked at the surface where it ends.
    pub(in crate::design) fn overshoot(&self, last: &LastAim, tan: f64, p: f64, q: f64) -> (f64, usize) {
        self.clip(last, tan, p, q).over
    }

    /// Overshoot of the part of the pupil that is hidden by central obscurations: negative where a ray passes all apertures and is hidden. The
    /// surface of an obscuration is counted from the number of surfaces.
    pub(in crate::design) fn overshoot_of_hidden(
        &self,
        last: &LastAim,
        tan: f64,
        p: f64,
        q: f64,
    ) -> (f64, usize) {
        let clip = self.clip(last, tan, p, q);
        let hidden = (clip.hidden.0, self.system.surfaces.len() + clip.hidden.1);
        if clip.over.0 > hidden.0 { clip.over } else { hidden }
    }

    /// Whether the ray through (p, q) reaches the image: no aperture and no obscuration blocks it.
    pub fn passes(&self, tan: f64, p: f64, q: f64) -> bool {
        self.clip(&LastAim::default(), tan, p, q).passes()
    }

    /// Intersection with the image plane, mm, of the ray through (p, q), if no aperture and no obscuration blocks it.
    pub(in crate::design) fn landing(&self, tan: f64, p: f64, q: f64) -> Option<(f64, f64)> {
        let [x, y] = self.aim(tan, p, q).ok()?;
        let mut clip = Clip::NONE;
        let met = |i, ray: &Ray<f64>| self.clip_at(&mut clip, i, ray);
        let ray = self.run(self.launch(tan, x, y), self.system.image(), met).ok()?;
        clip.passes().then_some((ray.p[0], ray.p[1]))
    }

    /// The surfaces with an aperture, then those with an obscuration.
    pub(in crate::design) fn limits(&self) -> [Vec<usize>; 2] {
        let surfaces = || self.system.surfaces.iter().enumerate();
        let apertures = surfaces().filter(|(_, s)| s.aperture_mm.is_some()).map(|(i, _)| i);
        let obscurations = surfaces().filter(|(_, s)| s.obscuration_mm.is_some()).map(|(i, _)| i);
        [apertures.collect(), obscurations.collect()]
    }

    /// r²/a² − 1 at each of [`Tracer::limits`] for the ray through (p, q), whatever blocks it, in a search that has aimed at `last`.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if it does not reach the image.
    pub(in crate::design) fn places(
        &self,
        last: &LastAim,
        tan: f64,
        p: f64,
        q: f64,
    ) -> Result<Vec<f64>, DesignError> {
        let [x, y] = self.aim_from(last, tan, (p, q), SHORT)?;
        let (mut places, mut hidden) = (Vec::new(), Vec::new());
        let met = |i: usize, ray: &Ray<f64>| {
            let s = &self.system.surfaces[i];
            places.extend(s.aperture_mm.map(|a| place(ray, a)));
            hidden.extend(s.obscuration_mm.map(|a| place(ray, a)));
        };
        self.run(self.launch(tan, x, y), self.system.image(), met)
            .map_err(|lost| self.lost(tan, p, q, lost))?;
        places.append(&mut hidden);
        Ok(places)
    }

    fn clip(&self, last: &LastAim, tan: f64, p: f64, q: f64) -> Clip {
        let blocked = |surface| Clip { over: (1.0, surface), ..Clip::NONE };
        let Ok([x, y]) = self.aim_from(last, tan, (p, q), SHORT) else { return blocked(self.system.stop) };
        let mut clip = Clip::NONE;
        let met = |i, ray: &Ray<f64>| self.clip_at(&mut clip, i, ray);
        match self.run(self.launch(tan, x, y), self.system.image(), met) {
            Ok(_) => clip,
            Err(lost) => blocked(lost.surface),
        }
    }
}
