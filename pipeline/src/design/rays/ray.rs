//! Real rays: from a field point through the pupil to the image plane.
//!
//! A field point on +x or −x (meridional plane y = 0) is given by t = tan of the chief ray's angle at the paraxial entrance pupil
//! of the primary wavelength: a plane wave for an object at infinity, else a point at height −t·(distance to the pupil). The sign
//! is that of an image on +x (`launch`; telecentric object spaces there, too). Pupil coordinates (p, q) are in the unit disc:
//!   *paraxial aiming*: the point (p, q)·R of the paraxial entrance pupil plane (every wavelength shares it);
//!   *real aiming*: the point of that plane whose ray crosses the stop at (p, q)·(real radius of the axial marginal ray there), see `aim`.
//! Clipping by apertures and obscurations: `clip`; rays are traced as if there were none.
//! Flux through dp dq: d(x, y) in the pupil plane for an object at infinity, d(L, M) at the object (Lambertian) for a finite one.
//! Light lost at coatings and in glass: `losses`. Left out: ghosts, vignetting factors.

use std::sync::OnceLock;

use super::aim::{ChiefRays, LastAim};
use super::clip::Clip;
use super::ideal_lens::{IdealLens, ideal_lenses};
use super::losses::Losses;
use super::paraxial::Paraxial;
use super::ray_budget::RayBudget;
use super::scalar::{Dual, Scalar};
use super::stop_point::{PupilPoint, Step};
use super::surface::{Ray, Stopped};
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::{RayAiming, System};

/// Last step of Newton's method, of the entrance pupil's radius, after which a ray is traced with derivatives, and the distance up to which its values follow from them: their
/// errors are of second order, 1e-12 of an aberration, those of the derivatives of first order, 1e-6.
const TRACED: f64 = 3e-4;
const LINEAR: f64 = 1e-6;
/// Rays that are traced with derivatives until one is that near; the second mostly is.
const MAX_TRACED: usize = 4;

/// A system with its indices for rays of one wavelength.
#[derive(Clone, Debug)]
pub struct Tracer<'a> {
    pub(super) system: &'a System,
    indices: Vec<f64>,
    ideal: Vec<Option<IdealLens>>,
    losses: Option<Losses>,
    sign: f64,
    stop_radius_mm: f64,
    stop_sign: f64,
    has_apertures: bool,
    has_obscurations: bool,
    chiefs: OnceLock<ChiefRays>,
    pub(super) budget: Option<RayBudget>,
    /// First-order properties at the primary wavelength, with the position of the pupil.
    pub primary: Paraxial,
    /// Wavelength, µm.
    pub wavelength_um: f64,
}

/// A ray that does not reach the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lost {
    /// Surface index.
    pub surface: usize,
    /// Reason.
    pub why: Stopped,
}

/// A ray in the image plane, with derivatives by the pupil coordinates p, q.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageRay {
    /// Intersection with the image plane, mm.
    pub x: Dual,
    /// Intersection with the image plane, mm.
    pub y: Dual,
    /// Optical direction cosine along x: times the index of the medium in front of the film, as are the others.
    pub l: Dual,
    /// That along y.
    pub m: Dual,
    /// That along z.
    pub n: f64,
    /// Optical path from the object's wavefront, mm.
    pub path: Dual,
    /// Flux per dp dq, relative to the field point's other rays, less what is lost on the way.
    pub flux: f64,
}

impl ImageRay {
    /// Index of the medium in front of the film.
    pub fn index(&self) -> f64 {
        (self.l.v * self.l.v + self.m.v * self.m.v + self.n * self.n).sqrt()
    }

    /// |d(L, M)/d(p, q)|.
    pub fn solid_angle(&self) -> f64 {
        (self.l.d[0] * self.m.d[1] - self.l.d[1] * self.m.d[0]).abs()
    }
}

impl<'a> Tracer<'a> {
    /// Prepares `system` for rays of `um`.
    ///
    /// # Errors
    /// [`DesignError::Wavelength`] of a glass, no first-order properties, or no rotational symmetry.
    pub fn new(system: &'a System, um: f64) -> Result<Self, DesignError> {
        if system.asymmetry.is_some() {
            return Err(DesignError::Asymmetric);
        }
        let primary = Paraxial::new(system, system.primary_um())?;
        let mut tracer = Self {
            system,
            indices: indices(system, system.primary_um())?,
            ideal: Vec::new(),
            losses: Losses::new(system, um)?,
            sign: primary.distortion_focal_length_mm.signum(),
            stop_radius_mm: primary.stop_radius_mm,
            stop_sign: 1.0,
            chiefs: OnceLock::new(),
            budget: None,
            has_apertures: system.surfaces.iter().any(|s| s.aperture_mm.is_some()),
            has_obscurations: system.surfaces.iter().any(|s| s.obscuration_mm.is_some()),
            primary,
            wavelength_um: system.primary_um(),
        };
        tracer.ideal = ideal_lenses(system, &tracer.indices);
        if system.aiming == RayAiming::Real
            && !matches!(system.aperture, crate::design::prescription::system::Aperture::StopRadius(_))
        {
            let radius = tracer.primary.entrance_radius_mm;
            let ray = tracer.launch(0.0, radius, 0.0);
            let at_stop = tracer.run(ray, system.stop, |_, _| {});
            tracer.stop_radius_mm = at_stop.map_err(|lost| tracer.lost(0.0, 1.0, 0.0, lost))?.p[0].abs();
        }
        tracer.indices = indices(system, um)?;
        tracer.ideal = ideal_lenses(system, &tracer.indices);
        tracer.wavelength_um = um;
        let near_axis = tracer.launch(0.0, 1e-6 * tracer.primary.entrance_radius_mm, 0.0);
        tracer.stop_sign = tracer.run(near_axis, system.stop, |_, _| {}).map_or(1.0, |r| r.p[0].signum());
        Ok(tracer)
    }

    /// Whether any surface can clip light.
    pub fn has_apertures(&self) -> bool {
        self.has_apertures
    }

    /// Ideal height over tan(field angle): the distortion focal length, positive.
    pub fn ideal_scale_mm(&self) -> f64 {
        self.primary.distortion_focal_length_mm.abs()
    }

    /// The same system with all of the light: no coatings, no absorption.
    pub fn without_losses(&self) -> Self {
        Self { losses: None, ..self.clone() }
    }

    /// Whether light is lost on the way.
    pub fn has_losses(&self) -> bool {
        self.losses.is_some()
    }

    /// Share of the light of the ray from `start` that is left at the image; 1 without coatings.
    fn share_left(&self, start: Ray<f64>) -> Result<f64, Lost> {
        let Some(losses) = &self.losses else { return Ok(1.0) };
        losses.share(self.system, &self.indices, start, |i, ray| self.bend(i, ray))
    }

    /// Whether any surface has a central obscuration.
    pub fn has_obscurations(&self) -> bool {
        self.has_obscurations
    }

    /// Traces `ray` to its intersection with surface `last`, without refraction there; `met` is called where it meets each surface.
    pub(super) fn run<T: Scalar>(
        &self,
        mut ray: Ray<T>,
        last: usize,
        mut met: impl FnMut(usize, &Ray<T>),
    ) -> Result<Ray<T>, Lost> {
        for (i, s) in self.system.surfaces.iter().enumerate().take(last + 1) {
            let lost = |why| Lost { surface: i, why };
            s.shape.meet(&mut ray, self.indices[i]).map_err(lost)?;
            met(i, &ray);
            if i == last {
                break;
            }
            self.bend(i, &mut ray).map_err(lost)?;
            ray.p[2] = ray.p[2] - T::of(s.thickness_mm);
        }
        Ok(ray)
    }

    /// Bends `ray` at surface `i`.
    fn bend<T: Scalar>(&self, i: usize, ray: &mut Ray<T>) -> Result<(), Stopped> {
        let (s, [n1, n2]) = (&self.system.surfaces[i], [self.indices[i], self.indices[i + 1]]);
        match (&self.ideal[i], s.is_mirror) {
            (Some(lens), _) => lens.bend(ray, n1, n2),
            (None, true) => s.shape.reflect(ray),
            (None, false) => s.shape.refract(ray, n1, n2),
        }
    }

    pub(super) fn lost(&self, tan: f64, p: f64, q: f64, lost: Lost) -> DesignError {
        let what = match lost.why {
            Stopped::Misses => "misses",
            Stopped::Reflected => "is totally reflected at",
        };
        self.ray_error(tan, p, q, format!("{what} surface {}", lost.surface + 1))
    }

    pub(in crate::design) fn ray_error(&self, tan: f64, px: f64, py: f64, problem: String) -> DesignError {
        let advice = match self.system.aiming {
            _ if tan == 0.0 => "use a smaller aperture: the lens does not transmit the axial bundle",
            RayAiming::Paraxial => "use a smaller field, or aim rays at the real stop (`--aiming real`)",
            RayAiming::Real if self.has_apertures => "use a smaller field",
            RayAiming::Real => {
                "use a smaller field, or give the surfaces their clear radii, which block such rays"
            }
        };
        DesignError::Ray { px, py, field_tan: tan, wavelength_um: self.wavelength_um, problem, advice }
    }

    pub(super) fn aiming(&self) -> RayAiming {
        self.system.aiming
    }

    /// Index of the stop.
    pub(super) fn stop(&self) -> usize {
        self.system.stop
    }

    /// Index of the image plane.
    pub(super) fn image(&self) -> usize {
        self.system.image()
    }

    /// Radius in the stop that real aiming aims at, mm.
    pub(in crate::design) fn stop_radius_mm(&self) -> f64 {
        self.stop_radius_mm
    }

    /// Coordinate in the stop over pupil coordinate, mm: negative where the stop is imaged upside down into the entrance pupil, which pupil coordinates follow.
    pub(super) fn stop_scale_mm(&self) -> f64 {
        self.stop_sign * self.stop_radius_mm
    }

    /// Sign of a field point for an image on +x.
    pub fn image_sign(&self) -> f64 {
        self.sign
    }

    pub(super) fn is_telecentric(&self) -> bool {
        self.system.is_telecentric
    }

    /// Object distance before the first surface, mm; none for an object at infinity.
    pub fn object_distance_mm(&self) -> Option<f64> {
        self.system.object_distance_mm
    }

    /// The chief rays of all field angles.
    pub(super) fn chiefs(&self) -> &ChiefRays {
        self.chiefs.get_or_init(|| self.follow_chiefs())
    }

    /// The ray through pupil point (p, q) in the image plane, with derivatives by (p, q). Apertures are ignored.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if it does not reach the image.
    pub fn ray(&self, tan: f64, p: f64, q: f64) -> Result<ImageRay, DesignError> {
        Ok(self.ray_from(&LastAim::default(), tan, p, q)?.0)
    }

    /// [`Tracer::ray`], in a search that has aimed at `last`, and its places in apertures to about 1e-6.
    ///
    /// # Errors
    /// As there.
    pub(in crate::design) fn ray_from(
        &self,
        last: &LastAim,
        tan: f64,
        p: f64,
        q: f64,
    ) -> Result<(ImageRay, Clip), DesignError> {
        let at = self.aim_from(last, tan, (p, q), TRACED)?;
        let (point, found) = self.ray_near(at, tan, p, q).or_else(|first| {
            let at = self.aim(tan, p, q)?;
            self.ray_near(at, tan, p, q).map_err(|_| first)
        })?;
        last.set(tan, p, q, point);
        Ok(found)
    }

    /// The ray through (p, q), its places in apertures and its point in the entrance pupil plane, from the point `at` nearby, mm.
    ///
    /// Near a ray, coordinates at the stop and on the image are linear in its point of the entrance pupil plane: the values of the ray through (p, q), and their derivatives by
    /// p and q, follow from a ray nearby with derivatives by the point.
    fn ray_near(
        &self,
        mut at: [f64; 2],
        tan: f64,
        p: f64,
        q: f64,
    ) -> Result<(PupilPoint, (ImageRay, Clip)), DesignError> {
        let lost = |lost| self.lost(tan, p, q, lost);
        let radius_mm = self.primary.entrance_radius_mm;
        // By (p, q), or by the point.
        let scale = if self.aiming() == RayAiming::Paraxial { radius_mm } else { 1.0 };
        for _ in 0..MAX_TRACED {
            let start = self.launch(tan, Dual::new(at[0], scale, 0.0), Dual::new(at[1], 0.0, scale));
            let (mut at_stop, mut clip) = (start.p, Clip::NONE);
            let met = |i, ray: &Ray<Dual>| {
                self.clip_at(&mut clip, i, ray);
                if i == self.system.stop {
                    at_stop = ray.p;
                }
            };
            let r = self.run(start, self.system.image(), met).map_err(lost)?;
            let step = match self.aiming() {
                RayAiming::Paraxial => Some(Step::NONE),
                RayAiming::Real => Step::new([at_stop[0], at_stop[1]], (p, q), self.stop_scale_mm()),
            };
            let Some(step) = step else { break };
            at = [at[0] + step.mm[0], at[1] + step.mm[1]];
            if step.length_mm() > LINEAR * radius_mm {
                continue;
            }
            let share = self.share_left(self.launch(tan, at[0], at[1])).map_err(lost)?;
            let index = Dual::of(self.indices[self.system.image()]);
            let flux = match self.system.object_distance_mm {
                None => [start.p[0], start.p[1]],
                Some(_) => [start.d[0], start.d[1]],
            };
            let [a, b] = flux.map(|v| step.carry(v).d);
            let ray = ImageRay {
                x: step.carry(r.p[0]),
                y: step.carry(r.p[1]),
                l: index * step.carry(r.d[0]),
                m: index * step.carry(r.d[1]),
                n: (index * step.carry(r.d[2])).v,
                path: step.carry(r.path),
                flux: (a[0] * b[1] - a[1] * b[0]).abs() * share,
            };
            return Ok((PupilPoint { at, by: step.by }, (ray, clip)));
        }
        Err(self.not_aimed(tan, p, q))
    }

    /// Intersections (z, x) in mm of the meridional ray through pupil height `p` with all surfaces, z from the first vertex; the first
    /// point is `before_mm` in front of that vertex.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if it does not reach the image.
    pub fn path(&self, tan: f64, p: f64, before_mm: f64) -> Result<Vec<(f64, f64)>, DesignError> {
        let [x, _] = self.aim(tan, p, 0.0)?;
        let ray = self.launch(tan, x, 0.0);
        let slope = ray.d[0] / ray.d[2];
        let first = (-before_mm, ray.p[0] - slope * (ray.p[2] + before_mm));
        let points = self.meridional_ray(tan, p)?;
        Ok(std::iter::once(first).chain(points.iter().map(|[z, x, _]| (*z, *x))).collect())
    }

    /// The meridional ray through pupil height `p` at each surface: z from the first vertex, x, both in mm, and the sine of its angle to the axis
    /// before the surface.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if it does not reach the image.
    pub fn meridional_ray(&self, tan: f64, p: f64) -> Result<Vec<[f64; 3]>, DesignError> {
        let [x, _] = self.aim(tan, p, 0.0)?;
        let mut ray = self.launch(tan, x, 0.0);
        let axis = self.system.axis();
        let mut points = Vec::with_capacity(axis.len());
        for (i, s) in self.system.surfaces.iter().enumerate() {
            let (vertex, direction) = axis[i];
            let lost = |why| self.lost(tan, p, 0.0, Lost { surface: i, why });
            let sine = ray.d[0];
            s.shape.meet(&mut ray, self.indices[i]).map_err(lost)?;
            points.push([vertex + direction * ray.p[2], ray.p[0], sine]);
            if i < self.system.image() {
                self.bend(i, &mut ray).map_err(lost)?;
                ray.p[2] -= s.thickness_mm;
            }
        }
        Ok(points)
    }

    /// Number of surfaces; surfaces of obscurations are counted from here.
    pub(in crate::design) fn surfaces(&self) -> usize {
        self.system.surfaces.len()
    }
}

fn indices(system: &System, um: f64) -> Result<Vec<f64>, DesignError> {
    let mut n = vec![1.0];
    for s in &system.surfaces {
        n.push(s.medium.index(um)?);
    }
    Ok(n)
}
