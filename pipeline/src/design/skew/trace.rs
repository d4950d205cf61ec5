//! Rays of a built lens: from a field point through the pupil to the film.
//!
//! A field point is given by the slopes t = (L/N, M/N) of its light in object space, in the lens frame ([`super::system`]): a
//! plane wave for an object at infinity, else the point whose ray through the centre of the NOMINAL entrance pupil (primary
//! wavelength) has these slopes. Pupil coordinates (p, q) are in the unit disc, p along x and q along y of the lens frame:
//!   *paraxial aiming*: the point (p, q)·R of the nominal entrance pupil plane;
//!   *real aiming*: the point of that plane whose ray crosses the stop AS BUILT at (p, q)·(real radius of the nominal axial
//! marginal ray), see [`super::aim`]. A built lens is aimed as its nominal lens is.
//!
//! *Film frame* of [`ImageRay`]: X right, Y DOWN, mm from the centre of the film as built, in its plane: X = x, Y = −y of the
//! frame of the film, which is tilted with it. Direction cosines L, M alike. For a lens without deviations X = r cos φ, Y = −r
//! sin φ of the symmetric tracer's height r. The sign is applied here and nowhere else.
//!
//! Clipping: [`Outline::level`] (of a disc r²/a² − 1) in the frame of each surface with an aperture (maximum) or an obscuration
//! (minimum), as in [`crate::design::rays::ray`]. Flux through dp dq: d(x, y) in the pupil plane for an object at infinity, d(L, M) at the object
//! for a finite one. Left out: coatings, absorption, ghosts.

use std::sync::OnceLock;

use super::aim::Chiefs;
use super::ideal_plane::IdealPlane;
use super::system::BuiltLens;
use crate::design::prescription::asymmetry::Outline;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::{RayAiming, System};
use crate::design::rays::paraxial::Paraxial;
use crate::design::rays::ray::{ImageRay, Lost, Tracer};
use crate::design::rays::scalar::{Dual, Scalar};
use crate::design::rays::surface::{Ray, Stopped};
use crate::real;

/// Pupil coordinate of the ray that gives the sign of the magnification to the stop.
const NEAR_AXIS: f64 = 1e-6;

/// A built lens with its indices for rays of one wavelength.
#[derive(Clone, Debug)]
pub struct SkewTracer<'a> {
    pub(super) lens: &'a BuiltLens,
    pub(super) nominal: Tracer<'a>,
    indices: Vec<f64>,
    stop_sign: f64,
    ideal: IdealPlane,
    pub(super) chiefs: OnceLock<Chiefs>,
    /// First-order properties of the NOMINAL lens at the primary wavelength.
    pub primary: Paraxial,
    /// Wavelength, µm.
    pub wavelength_um: f64,
}

/// Where a ray crosses apertures and obscurations: r²/a² − 1, and the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SkewClip {
    /// Maximum over the apertures.
    pub over: (f64, usize),
    /// Minimum over the obscurations.
    pub hidden: (f64, usize),
}

impl SkewClip {
    /// Without apertures and obscurations.
    pub const NONE: Self = Self { over: (f64::NEG_INFINITY, 0), hidden: (f64::INFINITY, 0) };

    /// Whether the ray reaches the film: no aperture and no obscuration blocks it.
    pub fn passes(&self) -> bool {
        self.over.0 <= 0.0 && self.hidden.0 > 0.0
    }
}

impl<'a> SkewTracer<'a> {
    /// Prepares `lens` for rays of `um`.
    ///
    /// # Errors
    /// [`DesignError::Wavelength`] of a glass, or no first-order properties of the nominal lens.
    pub fn new(lens: &'a BuiltLens, um: f64) -> Result<Self, DesignError> {
        let nominal = Tracer::new(lens.nominal(), um)?;
        let at_stop = nominal.meridional_ray(0.0, NEAR_AXIS).map(|points| points[lens.nominal().stop][1]);
        Ok(Self {
            lens,
            indices: lens.indices(um)?,
            stop_sign: at_stop.map_or(1.0, f64::signum),
            ideal: lens.ideal_plane().copied().unwrap_or_else(|| IdealPlane::straight(&nominal.primary)),
            chiefs: OnceLock::new(),
            primary: nominal.primary.clone(),
            wavelength_um: um,
            nominal,
        })
    }

    /// The lens.
    pub fn lens(&self) -> &'a BuiltLens {
        self.lens
    }

    pub(super) fn system(&self) -> &System {
        self.lens.nominal()
    }

    /// Focal length f of the ideal plane, mm: of the nominal lens at the primary wavelength, or of an asymmetric design.
    pub fn ideal_focal_mm(&self) -> f64 {
        self.ideal.focal_mm()
    }

    /// The ideal point of the field of slopes `t` in the film frame, mm.
    pub fn ideal_point_mm(&self, t: [f64; 2]) -> [f64; 2] {
        self.ideal.point_mm(t)
    }

    /// The slopes of the field with the ideal point `ideal_mm`.
    pub fn slopes_of_ideal(&self, ideal_mm: [f64; 2]) -> [f64; 2] {
        self.ideal.slopes(ideal_mm)
    }

    /// Whether any surface can clip light.
    pub fn has_apertures(&self) -> bool {
        self.lens.surfaces().iter().any(|s| s.aperture.is_some())
    }

    /// Whether any surface has an obscuration.
    pub fn has_obscurations(&self) -> bool {
        self.lens.surfaces().iter().any(|s| s.obscuration.is_some())
    }

    /// Number of surfaces. The rims of a surface's aperture have its index, those of its obscuration the index counted from here;
    /// the sides along y of rectangles are counted from twice this.
    pub fn surface_count(&self) -> usize {
        self.system().surfaces.len()
    }

    /// Object distance before the first nominal surface, mm; none for an object at infinity.
    pub fn object_distance_mm(&self) -> Option<f64> {
        self.system().object_distance_mm
    }

    pub(super) fn aiming(&self) -> RayAiming {
        self.system().aiming
    }

    /// Signed radius in the stop that real aiming aims at, mm: pupil coordinates follow the entrance pupil.
    pub(super) fn stop_scale_mm(&self) -> f64 {
        self.stop_sign * self.nominal.stop_radius_mm()
    }

    /// The ray of the field of slopes `t` through the point (x, y) of the nominal entrance pupil plane, mm, in the lens frame.
    pub(super) fn launch<T: Scalar>(&self, [tx, ty]: [T; 2], x: T, y: T) -> Ray<T> {
        let p = [x, y, T::of(self.primary.entrance_pupil_mm)];
        let one = T::of(1.0);
        let Some(distance) = self.object_distance_mm() else {
            let n = one / (one + tx * tx + ty * ty).sqrt();
            return Ray { p, d: [tx * n, ty * n, n], path: tx * n * x + ty * n * y };
        };
        let z = T::of(distance + self.primary.entrance_pupil_mm);
        let (p, dx, dy) = match self.system().is_telecentric {
            true => ([x - tx * z, y - ty * z, T::of(0.0)], x, y),
            false => (p, x + tx * z, y + ty * z),
        };
        let length = (dx * dx + dy * dy + z * z).sqrt();
        Ray { p, d: [dx / length, dy / length, z / length], path: length }
    }

    /// Traces `ray` of the lens frame to its intersection with surface `last`, without refraction there; `visit` sees it on each
    /// surface, in the surface's frame.
    pub(super) fn run<T: Scalar>(
        &self,
        mut ray: Ray<T>,
        last: usize,
        mut visit: impl FnMut(usize, &Ray<T>),
    ) -> Result<Ray<T>, Lost> {
        for (i, built) in self.lens.surfaces().iter().enumerate().take(last + 1) {
            let lost = |why| Lost { surface: i, why };
            built.arrival.apply(&mut ray);
            if built.is_frame {
                continue;
            }
            built.shape.meet(&mut ray, self.indices[i]).map_err(lost)?;
            visit(i, &ray);
            if i == last {
                break;
            }
            match self.system().surfaces[i].is_mirror {
                true => built.shape.reflect(&mut ray),
                false => built.shape.refract(&mut ray, self.indices[i], self.indices[i + 1]),
            }
            .map_err(lost)?;
        }
        Ok(ray)
    }

    pub(super) fn lost(&self, t: [f64; 2], p: f64, q: f64, lost: Lost) -> DesignError {
        let what = match lost.why {
            Stopped::Misses => "misses",
            Stopped::Reflected => "is totally reflected at",
        };
        self.ray_error(t, p, q, &format!("{what} surface {}", lost.surface + 1))
    }

    /// The error of a ray.
    pub fn ray_error(&self, [tx, ty]: [f64; 2], p: f64, q: f64, problem: &str) -> DesignError {
        let lens = if self.lens.is_asymmetric_design() { "the design" } else { "the lens with tolerances" };
        let problem = format!("of slopes ({tx:.4}, {ty:.4}) {problem} of {lens}");
        self.nominal.ray_error(real::hypot(tx, ty), p, q, problem)
    }

    /// The ray through pupil point (p, q) on the film, in the film frame, with derivatives by (p, q). Apertures are ignored.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if it does not reach the film.
    pub fn ray(&self, t: [f64; 2], p: f64, q: f64) -> Result<ImageRay, DesignError> {
        Ok(self.ray_and_clip(t, p, q)?.0)
    }

    /// [`SkewTracer::ray`] and its places in apertures.
    ///
    /// # Errors
    /// [`DesignError::Ray`] if it does not reach the film.
    pub fn ray_and_clip(&self, t: [f64; 2], p: f64, q: f64) -> Result<(ImageRay, SkewClip), DesignError> {
        let [x, y] = self.aim(t, p, q)?;
        let start = self.launch(t.map(Dual::of), x, y);
        let flux = match self.object_distance_mm() {
            None => [x, y],
            Some(_) => [start.d[0], start.d[1]],
        };
        let mut clip = SkewClip::NONE;
        let film = self.system().image();
        let r = self
            .run(start, film, |i, ray| self.clip_at(&mut clip, i, ray))
            .map_err(|lost| self.lost(t, p, q, lost))?;
        let index = Dual::of(self.indices[film]);
        let ray = ImageRay {
            x: r.p[0],
            y: -r.p[1],
            l: index * r.d[0],
            m: -(index * r.d[1]),
            n: (index * r.d[2]).v,
            path: r.path,
            flux: (flux[0].d[0] * flux[1].d[1] - flux[0].d[1] * flux[1].d[0]).abs(),
        };
        Ok((ray, clip))
    }

    fn clip_at<T: Scalar>(&self, clip: &mut SkewClip, i: usize, ray: &Ray<T>) {
        let s = &self.lens.surfaces()[i];
        let (x, y) = (ray.p[0].value(), ray.p[1].value());
        let place = |outline: Outline| {
            let (level, is_along_y) = outline.level(x, y);
            (level, if is_along_y { i + 2 * self.surface_count() } else { i })
        };
        if let Some(over) = s.aperture.map(place).filter(|o| o.0 > clip.over.0) {
            clip.over = over;
        }
        if let Some(hidden) = s.obscuration.map(place).filter(|h| h.0 < clip.hidden.0) {
            clip.hidden = hidden;
        }
    }

    /// Places of the ray through (p, q) in apertures. A ray that does not reach the film counts as blocked at the surface where
    /// it ends.
    pub fn clip(&self, t: [f64; 2], p: f64, q: f64) -> SkewClip {
        let blocked = |surface| SkewClip { over: (1.0, surface), ..SkewClip::NONE };
        let Ok([x, y]) = self.aim(t, p, q) else { return blocked(self.system().stop) };
        let mut clip = SkewClip::NONE;
        let start = self.launch(t, x.v, y.v);
        match self.run(start, self.system().image(), |i, ray| self.clip_at(&mut clip, i, ray)) {
            Ok(_) => clip,
            Err(lost) => blocked(lost.surface),
        }
    }

    /// Maximum overshoot of an aperture by the ray through (p, q), and its surface: (r²/a² − 1, surface).
    pub fn overshoot(&self, t: [f64; 2], p: f64, q: f64) -> (f64, usize) {
        self.clip(t, p, q).over
    }

    /// Overshoot of the part of the pupil that obscurations hide: negative where a ray passes all apertures and is hidden. The
    /// surface of an obscuration is counted from the number of surfaces.
    pub fn overshoot_of_hidden(&self, t: [f64; 2], p: f64, q: f64) -> (f64, usize) {
        let clip = self.clip(t, p, q);
        let hidden = (clip.hidden.0, self.surface_count() + clip.hidden.1);
        if clip.over.0 > hidden.0 { clip.over } else { hidden }
    }
}
