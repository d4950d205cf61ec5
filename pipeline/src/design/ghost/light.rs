//! The light of a ray along a ghost path: reflectances, transmittances, absorption; unpolarised light, its polarisation followed.
//!
//! With the fields on (s, p = d×s) of a surface, C = (⟨|E_s|²⟩, ⟨|E_p|²⟩, ⟨E_s E_p*⟩) starts as (1, 1, 0); before each surface it is turned by χ about the ray, then
//! ```text
//! C_s ← |a_s|² C_s,   C_p ← |a_p|² C_p,   C_sp ← a_s a_p* C_sp,          w = (C_s + C_p)/2 · Π e^(−α path)
//! ```
//! with the amplitudes a of the coating ([`coating`](crate::design::prescription::coating)), transmitted or reflected. In the unfolded path z turns round at a reflection, and with it the
//! handedness of (s, p): a_p is +r_p there, r of the tangential field. The film reflects the share R of both fields.
//! Geometry and light are separate: one ray serves for the light of all wavelengths near its own.

use super::path::{Act, Crossing};
use super::trace::Meeting;
use crate::design::prescription::coating::CoatingAt;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::rays::losses::Losses;
use crate::real;
use num_complex::Complex64;

/// What surfaces and glasses do to the light of one wavelength.
#[derive(Clone, Debug)]
pub struct GhostLight {
    pub(super) losses: Losses,
    pub(super) indices: Vec<f64>,
    film_reflectance: f64,
}

/// |a_s|², |a_p|², and a_s a_p*.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Factors {
    pub(super) s: f64,
    pub(super) p: f64,
    pub(super) sp: Complex64,
}

impl Factors {
    pub(super) const NONE: Self = Self::both(1.0);

    const fn both(power: f64) -> Self {
        Self { s: power, p: power, sp: Complex64::new(power, 0.0) }
    }

    fn of([s, p]: [Complex64; 2]) -> Self {
        Self { s: s.norm_sqr(), p: p.norm_sqr(), sp: s * p.conj() }
    }
}

/// C of a ray.
#[derive(Clone, Copy, Debug)]
struct Coherence {
    s: f64,
    p: f64,
    sp: Complex64,
}

impl Coherence {
    fn turned(self, [cos, sin]: [f64; 2]) -> Self {
        let (cc, ss, cs) = (cos * cos, sin * sin, cos * sin);
        let cross = 2.0 * cs * self.sp.re;
        Self {
            s: cc * self.s + ss * self.p + cross,
            p: ss * self.s + cc * self.p - cross,
            sp: Complex64::new(cs * (self.p - self.s) + (cc - ss) * self.sp.re, self.sp.im),
        }
    }
}

impl GhostLight {
    /// Light of `um` in `system`; its film reflects the share `film_reflectance`.
    ///
    /// # Errors
    /// [`DesignError::Incomplete`] of a lens without coatings; a wavelength outside the tables of a glass or a coating.
    pub fn new(system: &System, um: f64, film_reflectance: f64) -> Result<Self, DesignError> {
        let problem = "has ideal coatings, and a lens that reflects nothing has no ghosts";
        let losses = Losses::new(system, um)?
            .ok_or_else(|| DesignError::Incomplete { problem: problem.to_owned() })?;
        let mut indices = vec![1.0];
        for s in &system.surfaces {
            indices.push(s.medium.index(um)?);
        }
        Ok(Self { losses, indices, film_reflectance })
    }

    /// Factors of `crossing` at the cosine `cos` of the angle of incidence.
    pub(super) fn factors(&self, crossing: &Crossing<'_>, cos: f64) -> Factors {
        if crossing.surface + 1 == self.losses.coatings.len() && crossing.act == Act::Reflects {
            return Factors::both(self.film_reflectance);
        }
        let Some(coating) = &self.losses.coatings[crossing.surface] else { return Factors::NONE };
        let (n1, n2) = (self.indices[crossing.media.0], self.indices[crossing.media.1]);
        let is_total = n1 * n1 * (1.0 - cos * cos) >= n2 * n2;
        match crossing.act {
            Act::Ideal => Factors::NONE,
            Act::Refracts => Factors::of(coating.amplitudes(n1, n2, cos).t),
            // Tables and reflectances have no phase there.
            Act::Reflects if is_total && !matches!(coating, CoatingAt::Films(_)) => Factors::NONE,
            Act::Reflects | Act::Mirrors => Factors::of(coating.amplitudes(n1, n2, cos).r),
        }
    }

    /// Share of the light of a ray that is left on the film.
    pub(super) fn weight(&self, crossings: &[Crossing<'_>], meetings: &[Meeting]) -> f64 {
        let last = crossings.len() - 1;
        let mut c = Coherence { s: 1.0, p: 1.0, sp: Complex64::new(0.0, 0.0) };
        let mut absorbed = 0.0;
        for (index, (crossing, meeting)) in crossings.iter().zip(meetings).enumerate() {
            absorbed += self.losses.absorption_per_mm[crossing.media.0] * meeting.length_mm.max(0.0);
            if index == last || !crossing.is_boundary {
                continue;
            }
            let factors = self.factors(crossing, meeting.cos);
            c = c.turned(meeting.turn);
            c = Coherence { s: factors.s * c.s, p: factors.p * c.p, sp: factors.sp * c.sp };
        }
        0.5 * (c.s + c.p) * real::exp(-absorbed)
    }

    /// Product of reflectances and transmittances along the axis, without absorption.
    pub(super) fn on_axis(&self, crossings: &[Crossing<'_>]) -> f64 {
        let bent = crossings[..crossings.len() - 1].iter().filter(|c| c.is_boundary);
        bent.map(|crossing| self.factors(crossing, 1.0).s).product()
    }
}
