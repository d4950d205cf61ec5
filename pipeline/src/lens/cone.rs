//! The light that reaches a place of the film, as directions.
//!
//! (l, m): direction cosines of a ray in air in front of the film, l along the meridian, positive away from the axis, m across. Irradiance is ∫∫ L dl dm for the radiance L, so a
//! bundle of even radiance fills its part of the (l, m) plane evenly. The *cone* of a height is an ellipse with the area, the centroid and the second moments of that part:
//!
//! ```text
//! ((l − c)/a)² + (m/b)² ≤ 1        c = ⟨l⟩, a = 2 √(⟨l²⟩ − c²), b = 2 √⟨m²⟩        ⟨·⟩: mean over the bundle
//! ```
//! Of a circular pupil these are its middle and its marginal rays (tangential c ± a, sagittal b). A vignetted pupil is less high than wide; its outline is not an
//! ellipse, and means of functions that are linear or quadratic over it are right nevertheless. The chief ray passes the middle of the aperture stop, which is not that of a vignetted pupil.
//!
//! Between heights: cubic polynomials through four of them; c and the chief ray are odd in the height, a and b even.
//! Left out: surfaces of the pupil that a central obscuration hides, radiance that differs over the pupil.

use crate::real;
use crate::spline::lagrange_weights;

/// Heights of a table of chief rays between which its cones are interpolated.
const CHIEF_RAYS: usize = 257;

/// The directions of the light at a place of the film, as direction cosines in air.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Chief ray, positive away from the axis.
    pub chief: f64,
    /// Middle of the ellipse, likewise.
    pub centre: f64,
    /// Half of its axis along the meridian.
    pub tangential: f64,
    /// Half of its axis across.
    pub sagittal: f64,
}

impl Cone {
    /// The largest direction cosine from the film's normal: the sine of the angle of incidence.
    pub fn largest_sine(&self) -> f64 {
        (self.centre.abs() + self.tangential)
            .max((self.centre * self.centre + self.sagittal * self.sagittal).sqrt())
    }

    fn numbers(&self) -> [f64; 4] {
        [self.chief, self.centre, self.tangential, self.sagittal]
    }
}

/// Cones by height.
#[derive(Clone, Debug, PartialEq)]
pub struct ConeTable {
    /// Spacing of the heights, mm, from 0 on.
    step_mm: f64,
    cones: Vec<Cone>,
}

impl ConeTable {
    /// `cones` at the heights 0, `step_mm`, 2 `step_mm`, …
    ///
    /// # Panics
    /// Fewer than three.
    pub fn new(step_mm: f64, cones: Vec<Cone>) -> Self {
        assert!(cones.len() >= 3 && step_mm > 0.0);
        Self { step_mm, cones }
    }

    /// Of chief rays up to `last_mm`: at a height (mm), `chief_ray` has the angle θ in air (degrees, positive away from the axis) and the F-number N of the exit pupil, a circle.
    ///
    /// ```text
    /// centre sin θ, half axes  a = cos³θ/(2N) along the meridian,  b = cos θ/(2N) across
    /// ```
    ///
    /// # Panics
    /// `last_mm` of 0 or less.
    pub fn of_chief_rays(last_mm: f64, chief_ray: impl Fn(f64) -> (f64, f64)) -> Self {
        let step_mm = last_mm / (CHIEF_RAYS - 1) as f64;
        let at = |k: usize| {
            let (cra_deg, f_number) = chief_ray(step_mm * k as f64);
            let (sine, cosine) = (real::sin(cra_deg.to_radians()), real::cos(cra_deg.to_radians()));
            let half = 0.5 / f_number;
            let (tangential, sagittal) = (half * cosine * cosine * cosine, half * cosine);
            Cone { chief: sine, centre: sine, tangential, sagittal }
        };
        Self::new(step_mm, (0..CHIEF_RAYS).map(at).collect())
    }

    /// Height of the last, mm.
    pub fn last_mm(&self) -> f64 {
        self.step_mm * (self.cones.len() - 1) as f64
    }

    /// The cone at a height, mm; beyond the last one that of the polynomial there.
    pub fn at(&self, height_mm: f64) -> Cone {
        let u = height_mm / self.step_mm;
        let cell = u.floor().min((self.cones.len() - 2) as f64);
        let weights = lagrange_weights(u - cell);
        let mut sum = [0.0; 4];
        for (tap, weight) in weights.into_iter().enumerate() {
            let of = self.cone(cell as i64 - 1 + tap as i64).numbers();
            sum.iter_mut().zip(of).for_each(|(sum, v)| *sum += weight * v);
        }
        let [chief, centre, tangential, sagittal] = sum;
        Cone { chief, centre, tangential, sagittal }
    }

    /// Distance of the heights, mm.
    pub fn step_mm(&self) -> f64 {
        self.step_mm
    }

    /// Direction cosines of the cones, height by height: chief ray, centre, half axes along the meridian and across.
    pub fn directions(&self) -> impl Iterator<Item = [f64; 4]> {
        self.cones.iter().map(Cone::numbers)
    }

    /// The inverse of [`ConeTable::step_mm`] and [`ConeTable::directions`].
    ///
    /// # Errors
    /// A text: what is expected of a pack's numbers.
    pub fn from_directions(step_mm: f64, directions: &[[f64; 4]]) -> Result<Self, String> {
        if !(step_mm > 0.0 && step_mm.is_finite()) || directions.len() < 3 {
            return Err(format!(
                "expected three heights or more, a positive distance apart, found {} and {step_mm} mm",
                directions.len()
            ));
        }
        let is_cone = |d: &&[f64; 4]| d.iter().all(|v| v.abs() < 1.0) && d[2] > 0.0 && d[3] > 0.0;
        if let Some(bad) = directions.iter().find(|d| !is_cone(d)) {
            return Err(format!("expected direction cosines below 1, half axes above 0, found {bad:?}"));
        }
        let cone = |[chief, centre, tangential, sagittal]: &[f64; 4]| Cone {
            chief: *chief,
            centre: *centre,
            tangential: *tangential,
            sagittal: *sagittal,
        };
        Ok(Self::new(step_mm, directions.iter().map(cone).collect()))
    }

    /// That of the height `index`: mirrored below 0, beyond the last one from it and the two before.
    fn cone(&self, index: i64) -> Cone {
        let last = self.cones.len() - 1;
        let [chief, centre, tangential, sagittal] = match index {
            ..0 => {
                let of = self.cones[index.unsigned_abs() as usize];
                [-of.chief, -of.centre, of.tangential, of.sagittal]
            }
            k if k as usize <= last => self.cones[k as usize].numbers(),
            _ => {
                let [a, b, c] = [2, 1, 0].map(|back| self.cones[last - back].numbers());
                std::array::from_fn(|i| a[i] - 3.0 * b[i] + 3.0 * c[i])
            }
        };
        Cone { chief, centre, tangential, sagittal }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cones_between_heights_are_those_of_a_cubic_law() {
        let law = |h: f64| Cone {
            chief: 0.03 * h - 1e-4 * h * h * h,
            centre: 0.029 * h,
            tangential: 0.2 - 2e-3 * h * h,
            sagittal: 0.2 - 1e-3 * h * h,
        };
        let table = ConeTable::new(0.5, (0..9).map(|k| law(0.5 * f64::from(k))).collect());
        assert!((table.last_mm() - 4.0).abs() < 1e-15);
        for h in [0.0, 0.1, 0.74, 2.0, 3.4] {
            for (found, expected) in table.at(h).numbers().into_iter().zip(law(h).numbers()) {
                assert!((found - expected).abs() < 1e-14, "{h}: {found} {expected}");
            }
        }
        // The last cell has a parabola's value beyond it.
        for (found, expected) in table.at(3.9).numbers().into_iter().zip(law(3.9).numbers()) {
            assert!((found - expected).abs() < 1e-5, "{found} {expected}");
        }
    }
}
