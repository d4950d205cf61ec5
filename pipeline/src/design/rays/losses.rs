//! Light lost along a ray: reflections at surfaces, absorption in coatings and glass.
//!
//! A ray of unpolarised light carries two fields E of equal power, orthogonal to each other and to the ray. At a surface with the normal m, between
//! the directions d and d', s = d×m/|d×m| and p = d×s:
//! ```text
//! E' = t_s (E·s) s + t_p (E·p) p',   p' = d'×s        refracted;       −r_p in place of t_p, r_s in place of t_s: reflected by a mirror
//! w = (|E₁|² + |E₂|²)/2 × Π e^(−α path)
//! ```
//! with the amplitudes of [`coating`](crate::design::prescription::coating) and α of
//! [`absorption`](crate::design::prescription::absorption). w multiplies the flux of the ray, so that it enters illumination, transmission and the
//! amplitude of the pupil alike. Surfaces without a coating, ideal thin lenses and uncoated mirrors lose nothing.
//! Source: Chipman, Lam & Young, Polarized Light and Optical Systems (2018), chapter 9.
//! Left out: the phase of coatings; interference of the two fields on the film (unpolarised light, apertures far below 1).

use super::ray::Lost;
use super::surface::{Ray, Stopped};
use crate::design::prescription::absorption::Absorption;
use crate::design::prescription::coating::CoatingAt;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::{Medium, System};
use crate::real;
use num_complex::Complex64;

/// What a system takes from the light of one wavelength.
#[derive(Clone, Debug)]
pub(in crate::design) struct Losses {
    /// Of each surface.
    pub(in crate::design) coatings: Vec<Option<CoatingAt>>,
    /// Of the medium before each surface, 1/mm.
    pub(in crate::design) absorption_per_mm: Vec<f64>,
}

impl Losses {
    /// Those of `system` at `um`; none if no surface has a coating.
    ///
    /// # Errors
    /// A wavelength outside the tables of a coating.
    pub(in crate::design) fn new(system: &System, um: f64) -> Result<Option<Self>, DesignError> {
        if system.surfaces.iter().all(|s| s.coating.is_none()) {
            return Ok(None);
        }
        let coatings = system.surfaces.iter().map(|s| s.coating.as_ref().map(|c| c.at(um)).transpose());
        let behind = |medium: &Medium| match medium {
            Medium::Glass(glass) => glass.absorption.as_ref().map_or(0.0, |a: &Absorption| a.per_mm(um)),
            Medium::Air => 0.0,
        };
        let absorption = system.surfaces.iter().map(|s| behind(&s.medium));
        Ok(Some(Self {
            coatings: coatings.collect::<Result<_, _>>()?,
            absorption_per_mm: std::iter::once(0.0).chain(absorption).collect(),
        }))
    }

    /// Share of the light of the ray from `start` that is left at the image; `bend` bends it at a surface of `system`.
    pub(super) fn share(
        &self,
        system: &System,
        indices: &[f64],
        start: Ray<f64>,
        bend: impl Fn(usize, &mut Ray<f64>) -> Result<(), Stopped>,
    ) -> Result<f64, Lost> {
        let (mut ray, mut absorbed, mut fields) = (start, 0.0, transverse(start.d));
        for (i, s) in system.surfaces.iter().enumerate() {
            let lost = |why| Lost { surface: i, why };
            let before = ray.path;
            s.shape.meet(&mut ray, indices[i]).map_err(lost)?;
            // Before the first surface and towards a virtual image light may be traced backwards.
            absorbed += self.absorption_per_mm[i] * ((ray.path - before) / indices[i]).max(0.0);
            if i == system.image() {
                break;
            }
            let (d, coating) = (ray.d, self.coatings[i].as_ref());
            let normal = match coating {
                Some(_) => Some(s.shape.normal(&ray).map_err(lost)?),
                None => None,
            };
            bend(i, &mut ray).map_err(lost)?;
            if let (Some(coating), Some(normal)) = (coating, normal) {
                let cos1 = dot(d, normal).abs().min(1.0);
                let a = coating.amplitudes(indices[i], indices[i + 1], cos1);
                // z counts along the light: behind a mirror in the direction of its reflection.
                let (new, amplitudes) = match s.is_mirror {
                    true => ([ray.d[0], ray.d[1], -ray.d[2]], [a.r[0], -a.r[1]]),
                    false => (ray.d, a.t),
                };
                carry(&mut fields, d, new, normal, amplitudes);
                if s.is_mirror {
                    fields.iter_mut().for_each(|e| e[2] = -e[2]);
                }
            } else {
                // Nothing is lost; the fields turn with the ray.
                turn(&mut fields, d, ray.d, s.is_mirror);
            }
            ray.p[2] -= s.thickness_mm;
        }
        let power: f64 = fields.iter().flatten().map(|v| v.norm_sqr()).sum();
        Ok(0.5 * power * real::exp(-absorbed))
    }
}

type Vector = [f64; 3];
type Field = [Complex64; 3];

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn along(e: &Field, v: Vector) -> Complex64 {
    e[0] * v[0] + e[1] * v[1] + e[2] * v[2]
}

/// Two unit fields at right angles to `d` and to each other.
fn transverse(d: Vector) -> [Field; 2] {
    let reference = if d[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let u = unit(cross(reference, d)).unwrap_or([0.0, 1.0, 0.0]);
    [u, cross(d, u)].map(|v| v.map(|x| Complex64::new(x, 0.0)))
}

fn unit(v: Vector) -> Option<Vector> {
    let length = dot(v, v).sqrt();
    (length > 1e-12).then(|| v.map(|x| x / length))
}

/// The fields behind a surface of normal `m` between the directions `d` and `new`, with the amplitudes of s and p.
fn carry(fields: &mut [Field; 2], d: Vector, new: Vector, m: Vector, [a_s, a_p]: [Complex64; 2]) {
    // Along the normal any direction at right angles is s.
    let s = unit(cross(d, m)).unwrap_or_else(|| transverse(d)[0].map(|v| v.re));
    let (p, p_new) = (cross(d, s), cross(new, s));
    for e in fields {
        let (on_s, on_p) = (a_s * along(e, s), a_p * along(e, p));
        *e = std::array::from_fn(|k| on_s * s[k] + on_p * p_new[k]);
    }
}

/// The fields of a ray that turns from `d` to `new` without loss.
fn turn(fields: &mut [Field; 2], d: Vector, new: Vector, is_mirror: bool) {
    let one = Complex64::new(1.0, 0.0);
    match is_mirror {
        false if d == new => {}
        false => carry(fields, d, new, new, [one, one]),
        true => {
            let back = [new[0], new[1], -new[2]];
            let bisector = std::array::from_fn(|k| back[k] - d[k]);
            carry(fields, d, back, bisector, [-one, one]);
            fields.iter_mut().for_each(|e| e[2] = -e[2]);
        }
    }
}
