//! Rays at a surface without rotational symmetry ([`SkewShape`]): its sag, intersection, refraction and reflection.
//!
//! A surface without XY terms that is not biconic is a [`Shape`], with its closed forms and its bits. Else Newton's method, from the
//! intersection with the rotationally symmetric part (else with its vertex plane), with the exact gradient, to 1e-13 mm.

use crate::design::prescription::freeform::{AlongY, SkewShape};
use crate::design::prescription::shape::Shape;
use crate::design::rays::scalar::Scalar;
use crate::design::rays::surface::{Ray, Stopped};

/// Convergence limit of Newton's method, mm: 1e-9 of a wavelength.
const SAG_TOLERANCE_MM: f64 = 1e-13;
/// Iterations of Newton's method; surfaces with figure errors need 3 or 4.
const ITERATIONS: u32 = 50;

impl SkewShape {
    /// Moves `ray`, in coordinates of this surface, to its intersection, in a medium of index `n`.
    ///
    /// # Errors
    /// [`Stopped::Misses`].
    pub fn meet<T: Scalar>(&self, ray: &mut Ray<T>, n: f64) -> Result<(), Stopped> {
        match self.along_y {
            None => self.base.meet(ray, n)?,
            Some(_) => Shape::default().meet(ray, n)?,
        }
        if self.is_symmetric() {
            return Ok(());
        }
        let mut converged = 0;
        for _ in 0..ITERATIONS {
            let [x, y, z] = ray.p;
            let (sag, [sx, sy]) = self.sag(x, y).ok_or(Stopped::Misses)?;
            let t = (sag - z) / (ray.d[2] - sx * ray.d[0] - sy * ray.d[1]);
            if !t.value().is_finite() {
                return Err(Stopped::Misses);
            }
            for i in 0..3 {
                ray.p[i] = ray.p[i] + t * ray.d[i];
            }
            ray.path = ray.path + T::of(n) * t;
            // Two steps past convergence: the derivatives converge one step after the value.
            if t.value().abs() < SAG_TOLERANCE_MM {
                converged += 1;
                if converged == 2 {
                    return Ok(());
                }
            }
        }
        Err(Stopped::Misses)
    }

    /// Sag, mm, and its derivatives by x and y; none beyond the edge of a conic.
    pub fn sag<T: Scalar>(&self, x: T, y: T) -> Option<(T, [T; 2])> {
        let (mut sag, mut slope) = match &self.along_y {
            None => conic_part([self.base.curvature; 2], [self.base.conic; 2], [x, y])?,
            Some(AlongY { curvature, conic, swept_mm: None, .. }) => {
                conic_part([self.base.curvature, *curvature], [self.base.conic, *conic], [x, y])?
            }
            Some(AlongY { curvature, conic, swept_mm: Some(radius), aspheric }) => {
                let (mut g, [_, mut slope]) = conic_part([0.0, *curvature], [0.0, *conic], [x, y])?;
                let mut power = y;
                for (i, c) in aspheric.iter().enumerate() {
                    slope = slope + T::of(2.0 * (i + 1) as f64 * c) * power;
                    power = power * y;
                    g = g + T::of(*c) * power;
                    power = power * y;
                }
                swept(*radius, x, (g, slope))?
            }
        };
        let r2 = x * x + y * y;
        let mut over_r = T::of(0.0);
        let mut power = T::of(1.0);
        for (i, a) in self.base.aspheric.iter().enumerate() {
            over_r = over_r + T::of(2.0 * (i + 1) as f64 * a) * power;
            power = power * r2;
            sag = sag + T::of(*a) * power;
        }
        // At the vertex r, and with it odd powers, vanish; their slope there is taken as 0.
        if !self.base.odd.is_empty() && r2.value() > 0.0 {
            let mut power = r2.sqrt();
            for (i, b) in self.base.odd.iter().enumerate() {
                sag = sag + T::of(*b) * power;
                over_r = over_r + T::of((2 * i + 1) as f64 * b) * power / r2;
                power = power * r2;
            }
        }
        slope = [slope[0] + over_r * x, slope[1] + over_r * y];
        for term in &self.xy {
            let (c, i, j) = (term.coefficient, term.i, term.j);
            sag = sag + T::of(c) * power_of(x, i) * power_of(y, j);
            if i > 0 {
                slope[0] = slope[0] + T::of(c * f64::from(i)) * power_of(x, i - 1) * power_of(y, j);
            }
            if j > 0 {
                slope[1] = slope[1] + T::of(c * f64::from(j)) * power_of(x, i) * power_of(y, j - 1);
            }
        }
        Some((sag, slope))
    }

    /// Refracts `ray` at its point on the surface, from index `n1` to `n2`.
    ///
    /// # Errors
    /// [`Stopped::Reflected`], or [`Stopped::Misses`] at the very edge of a conic.
    pub fn refract<T: Scalar>(&self, ray: &mut Ray<T>, n1: f64, n2: f64) -> Result<(), Stopped> {
        if self.is_symmetric() {
            return self.base.refract(ray, n1, n2);
        }
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
        if self.is_symmetric() {
            return self.base.reflect(ray);
        }
        let normal = self.normal(ray)?;
        ray.reflect(normal)
    }

    /// Unit normal at the ray's point, along +z.
    fn normal<T: Scalar>(&self, ray: &Ray<T>) -> Result<[T; 3], Stopped> {
        let (_, [sx, sy]) = self.sag(ray.p[0], ray.p[1]).ok_or(Stopped::Misses)?;
        let length = (sx * sx + sy * sy + T::of(1.0)).sqrt();
        Ok([-sx / length, -sy / length, T::of(1.0) / length])
    }
}

/// Sag and slopes of a conic or biconic of curvatures (cx, cy) and conic constants (kx, ky); none beyond its edge.
fn conic_part<T: Scalar>([cx, cy]: [f64; 2], [kx, ky]: [f64; 2], [x, y]: [T; 2]) -> Option<(T, [T; 2])> {
    let (bend_x, bend_y) = (T::of((1.0 + kx) * cx * cx) * x, T::of((1.0 + ky) * cy * cy) * y);
    let root2 = T::of(1.0) - bend_x * x - bend_y * y;
    if root2.value().is_nan() || root2.value() <= 0.0 {
        return None;
    }
    let root = root2.sqrt();
    let (cx, cy, divisor) = (T::of(cx), T::of(cy), T::of(1.0) + root);
    let sag = (cx * x * x + cy * y * y) / divisor;
    // d/dx of u/w: 2 cx x/w + u (1 + κx) cx² x/(root w²).
    let by_root = sag / (root * divisor);
    let two = T::of(2.0);
    Some((sag, [two * cx * x / divisor + by_root * bend_x, two * cy * y / divisor + by_root * bend_y]))
}

/// Sag and slopes of the curve of sag and slopes (g, g') along y, swept about the axis at z = `radius`; none beyond its edge.
fn swept<T: Scalar>(radius: f64, x: T, (g, slope): (T, T)) -> Option<(T, [T; 2])> {
    if radius.is_infinite() {
        return Some((g, [T::of(0.0), slope]));
    }
    let rest = T::of(radius) - g;
    let square = rest * rest - x * x;
    if square.value().is_nan() || square.value() <= 0.0 {
        return None;
    }
    let depth = T::of(radius.signum()) * square.sqrt();
    Some((T::of(radius) - depth, [x / depth, slope * rest / depth]))
}

fn power_of<T: Scalar>(x: T, n: u32) -> T {
    (0..n).fold(T::of(1.0), |p, _| p * x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::prescription::freeform::XyTerm;
    use crate::design::rays::scalar::Dual;

    fn freeform() -> SkewShape {
        let base = Shape { curvature: 0.02, conic: -0.7, aspheric: vec![1e-3, 2e-5], odd: vec![0.0, 3e-5] };
        let xy = vec![XyTerm::new(1, 0, 1e-3), XyTerm::new(2, 1, 3e-5), XyTerm::new(0, 3, -2e-5)];
        SkewShape { base, along_y: Some(AlongY { curvature: -0.01, conic: 0.4, ..AlongY::default() }), xy }
    }

    fn ray(x: f64, y: f64) -> Ray<f64> {
        Ray { p: [x, y, -10.0], d: [0.1, -0.2, 0.95_f64.sqrt()], path: 0.0 }
    }

    fn toroid(swept_mm: f64) -> SkewShape {
        let along_y =
            AlongY { curvature: 0.03, conic: -0.5, aspheric: vec![1e-3, -2e-5], swept_mm: Some(swept_mm) };
        SkewShape { along_y: Some(along_y), ..SkewShape::default() }
    }

    #[test]
    fn gradient_equals_differences_of_the_sag() {
        let h = 1e-6;
        for shape in [freeform(), toroid(-40.0), toroid(25.0), toroid(f64::INFINITY)] {
            let sag = |x: f64, y: f64| shape.sag(x, y).unwrap().0;
            for (x, y) in [(2.0, 1.0), (-3.0, 0.7), (0.1, -2.9)] {
                let (_, [sx, sy]) = shape.sag(x, y).unwrap();
                assert!((sx - (sag(x + h, y) - sag(x - h, y)) / (2.0 * h)).abs() < 1e-8);
                assert!((sy - (sag(x, y + h) - sag(x, y - h)) / (2.0 * h)).abs() < 1e-8);
            }
        }
    }

    /// A toroid of equal radii is a sphere; one of an infinite radius has no sag along x.
    #[test]
    fn toroids_in_closed_form() {
        let along_y = AlongY { curvature: 0.03, swept_mm: Some(1.0 / 0.03), ..AlongY::default() };
        let ball = SkewShape { along_y: Some(along_y), ..SkewShape::default() };
        let sphere = Shape { curvature: 0.03, ..Shape::default() };
        for (x, y) in [(2.0, 1.0), (-9.0, 5.0), (0.1, -12.0)] {
            let r2: f64 = x * x + y * y;
            let expected = sphere.sag_mm(r2.sqrt()).unwrap();
            assert!((ball.sag(x, y).unwrap().0 - expected).abs() < 1e-13);
            assert_eq!(toroid(f64::INFINITY).sag(x, y), toroid(f64::INFINITY).sag(0.0, y));
            let mut met = ray(x, y);
            ball.meet(&mut met, 1.0).unwrap();
            let mut known = ray(x, y);
            sphere.meet(&mut known, 1.0).unwrap();
            assert!((0..3).all(|i| (met.p[i] - known.p[i]).abs() < 1e-12));
        }
        assert_eq!(toroid(25.0).sag(26.0, 0.0), None);
    }

    #[test]
    fn newton_meets_a_conic_where_its_closed_form_does() {
        let base = Shape { curvature: 0.02, conic: -0.7, ..Shape::default() };
        let conic = SkewShape { base: base.clone(), ..SkewShape::default() };
        let biconic = SkewShape {
            base,
            along_y: Some(AlongY { curvature: 0.02, conic: -0.7, ..AlongY::default() }),
            xy: vec![],
        };
        let zero = SkewShape { xy: vec![XyTerm::new(0, 0, 0.0)], ..conic.clone() };
        for (x, y) in [(2.0, 1.0), (-9.0, 5.0), (0.1, -12.0)] {
            let mut expected = ray(x, y);
            conic.meet(&mut expected, 1.2).unwrap();
            conic.refract(&mut expected, 1.2, 1.7).unwrap();
            for other in [&biconic, &zero] {
                let mut found = ray(x, y);
                other.meet(&mut found, 1.2).unwrap();
                other.refract(&mut found, 1.2, 1.7).unwrap();
                assert!((0..3).all(|i| (found.p[i] - expected.p[i]).abs() < 1e-12));
                assert!((0..3).all(|i| (found.d[i] - expected.d[i]).abs() < 1e-13));
                assert!((found.path - expected.path).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn derivatives_equal_differences_of_neighbouring_rays() {
        let (shape, h) = (freeform(), 1e-5);
        let go = |x: f64, y: f64| {
            let mut r = ray(x, y);
            shape.meet(&mut r, 1.0).unwrap();
            shape.refract(&mut r, 1.0, 1.5).unwrap();
            r
        };
        let mut dual = Ray {
            p: [Dual::new(1.0, 1.0, 0.0), Dual::new(-2.0, 0.0, 1.0), Dual::of(-10.0)],
            d: ray(0.0, 0.0).d.map(Dual::of),
            path: Dual::of(0.0),
        };
        shape.meet(&mut dual, 1.0).unwrap();
        shape.refract(&mut dual, 1.0, 1.5).unwrap();
        let differences = [[1.0, 0.0], [0.0, 1.0]].map(|[a, b]| {
            let [more, less] = [h, -h].map(|e| go(1.0 + e * a, -2.0 + e * b));
            [0, 1, 2].map(|i| (more.d[i] - less.d[i]) / (2.0 * h))
        });
        for (k, by) in differences.iter().enumerate() {
            assert!(dual.d.iter().zip(by).all(|(d, expected)| (d.d[k] - expected).abs() < 1e-9));
        }
    }

    /// A cylinder of curvature c along x images along x alone, at n/(c (n − 1)).
    #[test]
    fn a_cylinder_has_power_along_one_direction() {
        let base = Shape { curvature: 0.02, ..Shape::default() };
        let cylinder = SkewShape { base, along_y: Some(AlongY::default()), xy: vec![] };
        let mut ray = Ray { p: [1e-3, 1e-3, -1.0], d: [0.0, 0.0, 1.0], path: 0.0 };
        cylinder.meet(&mut ray, 1.0).unwrap();
        cylinder.refract(&mut ray, 1.0, 1.5).unwrap();
        let focus = 1.5 / (0.02 * 0.5);
        assert!((ray.p[0] + focus * ray.d[0]).abs() < 1e-9);
        assert_eq!((ray.p[1], ray.d[1]), (1e-3, 0.0));
    }

    #[test]
    fn a_ray_beyond_the_edge_of_a_conic_misses() {
        let base = Shape { curvature: 0.2, ..Shape::default() };
        let ball = SkewShape { base, along_y: None, xy: vec![XyTerm::new(1, 1, 1e-4)] };
        let mut far = Ray { p: [6.0, 0.0, -5.0], d: [0.0, 0.0, 1.0], path: 0.0 };
        assert_eq!(ball.meet(&mut far, 1.0), Err(Stopped::Misses));
        assert_eq!(ball.sag(6.0, 0.0), None);
    }
}
