//! Rays of a field point in object space.
//!
//! An object at infinity sends plane waves, an object at a finite distance d spherical ones from the height −t (d + pupil position). If the
//! object space is telecentric, the chief ray of the object point is parallel to the axis: the points (x, y) lie in the plane of the first vertex
//! and count from that ray, t is the object height over d.

use super::ray::Tracer;
use super::scalar::Scalar;
use super::surface::Ray;

impl Tracer<'_> {
    /// The ray of the field point at `tan` through the point (x, y) of the entrance pupil plane, mm.
    pub(super) fn launch<T: Scalar>(&self, tan: impl Into<T>, x: T, y: T) -> Ray<T> {
        let p = [x, y, T::of(self.primary.entrance_pupil_mm)];
        let t = T::of(self.image_sign()) * tan.into();
        let Some(distance) = self.object_distance_mm() else {
            let n = T::of(1.0) / (T::of(1.0) + t * t).sqrt();
            return Ray { p, d: [t * n, T::of(0.0), n], path: t * n * x };
        };
        let z = T::of(distance + self.primary.entrance_pupil_mm);
        let (p, dx) = match self.is_telecentric() {
            true => ([x - t * z, y, T::of(0.0)], x),
            false => (p, x + t * z),
        };
        let length = (dx * dx + y * y + z * z).sqrt();
        Ray { p, d: [dx / length, y / length, z / length], path: length }
    }
}
