//! One surface: intersection of its [`Shape`] with a ray, normal, refraction or reflection.
//!
//! ```text
//! n' d' = n d + (n' cos i' − n cos i) N                          Snell's law in vector form, N along the ray
//! d' = d − 2 (d·N) N                                             mirror; z then counts along the reflected light
//! ```
//! Coordinates in mm, origin at the vertex, +z along the light. The intersection with STANDARD surfaces (all
//! α_i = 0) is in closed form, that with even aspheres by Newton's method from there. Of two intersections the one nearer the vertex is
//! used.
//! Source: Welford, Aberrations of Optical Systems, chapters 4.3-4.5. Left out: gratings, tilts, coatings.

use super::scalar::Scalar;
use crate::design::prescription::shape::Shape;

/// A ray: a point, a unit direction and the optical path length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray<T> {
    /// A point of the ray, mm.
    pub p: [T; 3],
    /// Direction cosines (L, M, N).
    pub d: [T; 3],
    /// Optical path length, mm.
    pub path: T,
}

/// Reason why a ray ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stopped {
    /// No intersection with the surface.
    Misses,
    /// Total reflection.
    Reflected,
}

/// Steps of Newton's method at most.
const MAX_STEPS: usize = 50;
/// Convergence limit of Newton's method, mm: 1e-9 of a wavelength.
const SAG_TOLERANCE_MM: f64 = 1e-13;

impl<T: Scalar> Ray<T> {
    /// Cosine of the angle to the unit normal `normal`.
    fn cosine(&self, normal: [T; 3]) -> T {
        self.d[0] * normal[0] + self.d[1] * normal[1] + self.d[2] * normal[2]
    }

    /// Refracts it at a surface of unit normal `normal`, along +z; `ratio`: the index before over that behind.
    ///
    /// # Errors
    /// [`Stopped::Reflected`].
    pub(in crate::design) fn refract(&mut self, normal: [T; 3], ratio: f64) -> Result<(), Stopped> {
        let cos1 = self.cosine(normal);
        let root = T::of(1.0) - (T::of(1.0) - cos1 * cos1).times(ratio * ratio);
        if root.value() < 0.0 || cos1.value() <= 0.0 {
            return Err(Stopped::Reflected);
        }
        let gamma = root.sqrt() - cos1.times(ratio);
        for (d, n) in self.d.iter_mut().zip(normal) {
            *d = d.times(ratio) + gamma * n;
        }
        Ok(())
    }

    /// Reflects it at a surface of unit normal `normal`; z is reversed, so that it counts along the light again.
    ///
    /// # Errors
    /// [`Stopped::Misses`] where the light does not turn back.
    pub(in crate::design) fn reflect(&mut self, normal: [T; 3]) -> Result<(), Stopped> {
        let twice = T::of(2.0) * self.cosine(normal);
        let [l, m, n] = self.d;
        self.d = [l - twice * normal[0], m - twice * normal[1], -(n - twice * normal[2])];
        self.p[2] = -self.p[2];
        if self.d[2].value() > 0.0 { Ok(()) } else { Err(Stopped::Misses) }
    }
}

impl Shape {
    /// Moves `ray`, in coordinates of this surface, to its intersection, in a medium of index `n`.
    ///
    /// # Errors
    /// [`Stopped::Misses`].
    pub fn meet<T: Scalar>(&self, ray: &mut Ray<T>, n: f64) -> Result<(), Stopped> {
        // First to the vertex plane, so that the quadratic below has small numbers.
        let mut travelled = -ray.p[2] / ray.d[2];
        if !travelled.value().is_finite() {
            return Err(Stopped::Misses);
        }
        advance(ray, travelled);
        if !self.is_flat() {
            let (c, k) = (self.curvature, self.conic);
            let [x, y, _] = ray.p;
            let [l, m, nz] = ray.d;
            // c (x² + y² + (1+κ) z²) − 2 z = 0 along the ray; t = F / (G + √(G² − A F)), the root that is 0 at c = 0.
            let f = (x * x + y * y).times(c);
            let g = nz - (x * l + y * m).times(c);
            let af = match k == 0.0 {
                true => f.times(c),
                false => (T::of(1.0) + nz.times(k) * nz).times(c) * f,
            };
            let root = g * g - af;
            if root.value() < 0.0 || !root.value().is_finite() {
                return Err(Stopped::Misses);
            }
            let t = f / (g + root.sqrt());
            if !t.value().is_finite() {
                return Err(Stopped::Misses);
            }
            advance(ray, t);
            travelled = travelled + t;
            if self.is_aspheric() {
                travelled = travelled + self.newton(ray)?;
            }
        }
        ray.path = ray.path + travelled.times(n);
        Ok(())
    }

    /// Newton's method from the conic on: steps of values, then one with derivatives, which has those of all: where the value has converged, they follow from the
    /// surface there.
    fn newton<T: Scalar>(&self, ray: &mut Ray<T>) -> Result<T, Stopped> {
        let mut values = Ray { p: ray.p.map(T::value), d: ray.d.map(T::value), path: 0.0 };
        let mut total = T::of(0.0);
        let mut converged = 0;
        for _ in 0..MAX_STEPS {
            let t = self.step(&values)?;
            if t.abs() < SAG_TOLERANCE_MM {
                converged += 1;
                if converged == 2 {
                    let t = self.step(ray)?;
                    advance(ray, t);
                    return Ok(total + t);
                }
            }
            advance(&mut values, t);
            for (p, d) in ray.p.iter_mut().zip(ray.d) {
                *p = *p + d.times(t);
            }
            total = total + T::of(t);
        }
        Err(Stopped::Misses)
    }

    /// A step of Newton's method along `ray`.
    fn step<T: Scalar>(&self, ray: &Ray<T>) -> Result<T, Stopped> {
        let [x, y, z] = ray.p;
        let (sag, slope) = self.sag(x * x + y * y).ok_or(Stopped::Misses)?;
        let closing = ray.d[2] - slope * (x * ray.d[0] + y * ray.d[1]);
        let t = (sag - z) / closing;
        if t.value().is_finite() { Ok(t) } else { Err(Stopped::Misses) }
    }

    /// Sag at distance `r_mm` from the axis, mm; none beyond the edge of a conic.
    pub fn sag_mm(&self, r_mm: f64) -> Option<f64> {
        self.sag(r_mm * r_mm).map(|(sag, _)| sag)
    }

    /// Sag and (1/r) d(sag)/dr at r²; none beyond the edge of a conic.
    fn sag<T: Scalar>(&self, r2: T) -> Option<(T, T)> {
        let c = self.curvature;
        let root2 = T::of(1.0) - r2.times((1.0 + self.conic) * c * c);
        if root2.value() <= 0.0 {
            return None;
        }
        let root = root2.sqrt();
        let mut sag = r2.times(c) / (T::of(1.0) + root);
        let mut slope = T::of(c) / root;
        let mut power = T::of(1.0);
        for (i, a) in self.aspheric.iter().enumerate() {
            slope = slope + power.times(2.0 * (i + 1) as f64 * a);
            power = power * r2;
            sag = sag + power.times(*a);
        }
        // At the vertex r, and with it odd powers, vanish; their slope there is taken as 0.
        if !self.odd.is_empty() && r2.value() > 0.0 {
            let mut power = r2.sqrt();
            for (i, b) in self.odd.iter().enumerate() {
                sag = sag + power.times(*b);
                slope = slope + power.times((2 * i + 1) as f64 * b) / r2;
                power = power * r2;
            }
        }
        Some((sag, slope))
    }

    /// Refracts `ray` at its point on the surface, from index `n1` to `n2`.
    ///
    /// # Errors
    /// [`Stopped::Reflected`], or [`Stopped::Misses`] at the very edge of a conic.
    pub fn refract<T: Scalar>(&self, ray: &mut Ray<T>, n1: f64, n2: f64) -> Result<(), Stopped> {
        if n1 == n2 {
            return Ok(());
        }
        let normal = self.normal(ray)?;
        ray.refract(normal, n1 / n2)
    }

    /// Reflects `ray` at its point on the surface; z of the ray is reversed, so that it counts along the light again.
    ///
    /// # Errors
    /// [`Stopped::Misses`] at the very edge of a conic, or where the light does not turn back.
    pub fn reflect<T: Scalar>(&self, ray: &mut Ray<T>) -> Result<(), Stopped> {
        let normal = self.normal(ray)?;
        ray.reflect(normal)
    }

    /// Unit normal at the ray's point on the surface, along +z.
    pub(in crate::design) fn normal<T: Scalar>(&self, ray: &Ray<T>) -> Result<[T; 3], Stopped> {
        Ok(if self.is_flat() {
            [T::of(0.0), T::of(0.0), T::of(1.0)]
        } else if self.conic == 0.0 && !self.is_aspheric() {
            // The normal of a sphere points to its centre.
            let c = self.curvature;
            let normal = [ray.p[0].times(-c), ray.p[1].times(-c), T::of(1.0) - ray.p[2].times(c)];
            if normal[2].value() <= 0.0 {
                return Err(Stopped::Misses);
            }
            normal
        } else {
            let [x, y, _] = ray.p;
            let (_, slope) = self.sag(x * x + y * y).ok_or(Stopped::Misses)?;
            let (nx, ny) = (-slope * x, -slope * y);
            let length = (nx * nx + ny * ny + T::of(1.0)).sqrt();
            [nx / length, ny / length, T::of(1.0) / length]
        })
    }
}

fn advance<T: Scalar>(ray: &mut Ray<T>, t: T) {
    for i in 0..3 {
        ray.p[i] = ray.p[i] + t * ray.d[i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::rays::scalar::Dual;

    fn ray(x: f64, y: f64, l: f64, m: f64) -> Ray<f64> {
        Ray { p: [x, y, -5.0], d: [l, m, (1.0 - l * l - m * m).sqrt()], path: 0.0 }
    }

    #[test]
    fn parabola_as_a_conic_equals_parabola_as_an_asphere() {
        // The parabola c r²/2 as a conic of κ = −1 and as a flat with α1 = c/2.
        let conic = Shape { curvature: 0.02, conic: -1.0, ..Shape::default() };
        let asphere = Shape { curvature: 0.0, aspheric: vec![0.01], ..Shape::default() };
        for (x, y, l, m) in [(3.0, 1.0, 0.1, -0.05), (-8.0, 2.0, 0.2, 0.1), (0.0, 0.0, 0.0, 0.0)] {
            let (mut a, mut b) = (ray(x, y, l, m), ray(x, y, l, m));
            conic.meet(&mut a, 1.3).unwrap();
            asphere.meet(&mut b, 1.3).unwrap();
            conic.refract(&mut a, 1.3, 1.6).unwrap();
            asphere.refract(&mut b, 1.3, 1.6).unwrap();
            for i in 0..3 {
                assert!((a.p[i] - b.p[i]).abs() < 1e-12 && (a.d[i] - b.d[i]).abs() < 1e-13);
            }
            assert!((a.path - b.path).abs() < 1e-12);
            let r2 = a.p[0] * a.p[0] + a.p[1] * a.p[1];
            assert!((a.p[2] - 0.01 * r2).abs() < 1e-12);
        }
    }

    #[test]
    fn derivatives_equal_differences_of_neighbouring_rays() {
        let shape =
            Shape { curvature: 0.03, conic: 0.4, aspheric: vec![1e-4, -2e-6, 3e-9], odd: vec![0.0, 2e-5] };
        let go = |x: f64, y: f64| {
            let mut r = ray(x, y, 0.1, 0.02);
            shape.meet(&mut r, 1.0).unwrap();
            shape.refract(&mut r, 1.0, 1.5).unwrap();
            r
        };
        let base = ray(4.0, 1.0, 0.1, 0.02);
        let mut dual = Ray {
            p: [Dual::new(4.0, 1.0, 0.0), Dual::new(1.0, 0.0, 1.0), Dual::of(-5.0)],
            d: base.d.map(Dual::of),
            path: Dual::of(0.0),
        };
        shape.meet(&mut dual, 1.0).unwrap();
        shape.refract(&mut dual, 1.0, 1.5).unwrap();
        let h = 1e-5;
        for i in 0..3 {
            let dx = (go(4.0 + h, 1.0).d[i] - go(4.0 - h, 1.0).d[i]) / (2.0 * h);
            let dy = (go(4.0, 1.0 + h).d[i] - go(4.0, 1.0 - h).d[i]) / (2.0 * h);
            assert!((dx - dual.d[i].d[0]).abs() < 1e-9 && (dy - dual.d[i].d[1]).abs() < 1e-9);
        }
        let path = (go(4.0 + h, 1.0).path - go(4.0 - h, 1.0).path) / (2.0 * h);
        assert!((path - dual.path.d[0]).abs() < 1e-8);
    }

    #[test]
    fn ray_without_intersection_and_total_reflection_are_errors() {
        let ball = Shape { curvature: 0.2, ..Shape::default() };
        assert_eq!(ball.meet(&mut ray(6.0, 0.0, 0.0, 0.0), 1.0), Err(Stopped::Misses));
        let mut steep = ray(0.0, 0.0, 0.9, 0.0);
        Shape::default().meet(&mut steep, 1.5).unwrap();
        assert_eq!(Shape::default().refract(&mut steep, 1.5, 1.0), Err(Stopped::Reflected));
    }
}
