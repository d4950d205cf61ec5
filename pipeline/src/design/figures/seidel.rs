//! Seidel sums by surface.
//!
//! ```text
//! S_I = −A² y Δ(u/n)    S_II = −A Ā y Δ(u/n)    S_III = −Ā² y Δ(u/n)    S_IV = −H² c Δ(1/n)
//! S_V = Ā/A (S_III + S_IV) = −Ā³ y Δ(1/n²) + Ā ȳ (2 Ā y − A ȳ) c Δ(1/n)
//! C_I = A y Δ(δn/n)     C_II = Ā y Δ(δn/n)
//! W040 = S_I/8   W131 = S_II/2   W222 = S_III/2   W220 = (S_III + S_IV)/4   W311 = S_V/2      wavefront coefficients
//! ```
//! A = n i of the marginal ray, Ā of the chief ray, H the Lagrange invariant ([`super::paraxial_rays`]); Δ is behind less before the surface.
//! The second form of S_V follows with Δ(u/n) = A Δ(1/n²) − y c Δ(1/n) and H = A ȳ − Ā y: it has no quotient by A, which is 0 at a
//! surface about the marginal ray's focus. δn is the index at the shortest less that at the longest wavelength of the design. A surface that
//! departs from its sphere by G r⁴ adds 8 G (n' − n) y⁴ to S_I, and that times (ȳ/y), (ȳ/y)² and (ȳ/y)³ to S_II, S_III and S_V; odd
//! powers of r below the fourth have no third-order form. Behind a mirror n counts negative; written along the light this is Δ(1/n) = −2/n,
//! Δ(1/n²) = 0, n' − n = −2n. Ideal lenses add nothing. In mm; S_I > 0 is undercorrected spherical aberration.
//! Source: Welford, Aberrations of Optical Systems (1986), 8.2 to 8.6 and 10.2.

use super::paraxial_rays::paraxial_rays;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::shape::Shape;
use crate::design::prescription::system::{Surface, System};

/// Seidel sums and chromatic sums of a surface or a system, mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seidel {
    /// S_I to S_V: spherical aberration, coma, astigmatism, Petzval curvature, distortion.
    pub sums_mm: [f64; 5],
    /// C_I and C_II: axial and lateral colour.
    pub colour_mm: [f64; 2],
}

impl Seidel {
    /// W040, W131, W222, W220 and W311 in wavelengths of `um`.
    pub fn waves(&self, um: f64) -> [f64; 5] {
        let [s1, s2, s3, s4, s5] = self.sums_mm;
        [s1 / 8.0, s2 / 2.0, s3 / 2.0, (s3 + s4) / 4.0, s5 / 2.0].map(|mm| 1e3 * mm / um)
    }

    fn plus(self, other: &Self) -> Self {
        Self {
            sums_mm: std::array::from_fn(|i| self.sums_mm[i] + other.sums_mm[i]),
            colour_mm: std::array::from_fn(|i| self.colour_mm[i] + other.colour_mm[i]),
        }
    }
}

/// Coefficient of r⁴ by which a surface departs from its sphere of the paraxial curvature, mm⁻³; none if it has lower odd powers.
fn departure(shape: &Shape) -> Option<f64> {
    if shape.odd.iter().take(2).any(|a| *a != 0.0) {
        return None;
    }
    let (c, vertex) = (shape.curvature, shape.paraxial_curvature());
    let quartic = (1.0 + shape.conic) * c.powi(3) / 8.0 + shape.aspheric.get(1).copied().unwrap_or(0.0);
    Some(quartic - vertex.powi(3) / 8.0)
}

/// The sums of each surface before the film at the primary wavelength; none at a surface without a third-order form.
///
/// # Errors
/// As [`paraxial_rays`].
pub fn seidel(system: &System) -> Result<Vec<Option<Seidel>>, DesignError> {
    let um = system.primary_um();
    let used = || system.wavelengths_um.iter().map(|w| w.0);
    let (short, long) = (used().fold(f64::INFINITY, f64::min), used().fold(0.0, f64::max));
    let mut dispersion = vec![0.0];
    for s in &system.surfaces {
        dispersion.push(s.medium.index(short)? - s.medium.index(long)?);
    }
    let rays = paraxial_rays(system, um)?;
    let of_surface = |(i, s): (usize, &Surface)| {
        let r = &rays[i];
        if s.ideal_focal_mm.is_some() {
            return Some(Seidel::default());
        }
        let (n, next) = (r.index_before, r.index);
        let (a, a_bar, y, y_bar) =
            (r.marginal.invariant, r.chief.invariant, r.marginal.height_mm, r.chief.height_mm);
        let (c, lagrange) = (s.shape.paraxial_curvature(), r.lagrange_mm());
        let (inverse, inverse_square, step) = match s.is_mirror {
            true => (-2.0 / n, 0.0, -2.0 * n),
            false => (1.0 / next - 1.0 / n, 1.0 / (next * next) - 1.0 / (n * n), next - n),
        };
        let bent = y * (r.marginal.slope / next - r.marginal.slope_before / n);
        let figured = 8.0 * departure(&s.shape)? * step;
        let colour = match s.is_mirror {
            true => 0.0,
            false => y * (dispersion[i + 1] / next - dispersion[i] / n),
        };
        let distortion =
            -a_bar.powi(3) * y * inverse_square + a_bar * y_bar * (2.0 * a_bar * y - a * y_bar) * c * inverse;
        Some(Seidel {
            sums_mm: [
                -a * a * bent + figured * y.powi(4),
                -a * a_bar * bent + figured * y.powi(3) * y_bar,
                -a_bar * a_bar * bent + figured * (y * y_bar).powi(2),
                -lagrange * lagrange * c * inverse,
                distortion + figured * y * y_bar.powi(3),
            ],
            colour_mm: [a * colour, a_bar * colour],
        })
    };
    Ok(system.surfaces[..system.image()].iter().enumerate().map(of_surface).collect())
}

/// The sums of all surfaces; none if one has no third-order form.
pub fn total(surfaces: &[Option<Seidel>]) -> Option<Seidel> {
    surfaces.iter().try_fold(Seidel::default(), |sum, s| Some(sum.plus(s.as_ref()?)))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{parabolic_mirror, system};
    use super::super::wavefront::ReferenceSphere;
    use super::*;
    use crate::design::prescription::glass::{Dispersion, Glass};
    use crate::design::prescription::system::{Aperture, FieldKind, ImagePlane, Medium};
    use crate::design::rays::ray::Tracer;

    const INDEX: f64 = 1.6;

    /// A thin lens of power 1/f and bending B = (c1 + c2)/(c1 − c2) at the stop, its film in the paraxial focus.
    fn thin(f: f64, bending: f64) -> System {
        let difference = 1.0 / (f * (INDEX - 1.0));
        let (c1, c2) = (0.5 * difference * (bending + 1.0), 0.5 * difference * (bending - 1.0));
        let dispersion = Dispersion::constant(INDEX);
        let glass = Medium::Glass(Glass::new("constant".into(), dispersion, (0.1, 9.0)));
        let surfaces = vec![
            Surface::new(c1, 1e-7, glass),
            Surface::new(c2, f, Medium::Air),
            Surface::new(0.0, 0.0, Medium::Air),
        ];
        system(surfaces, 0, 4.0, 5.0).with_image_plane(ImagePlane::Paraxial(0.5), 0.0).unwrap()
    }

    /// Welford, 12.2: S_I = y⁴K³/4 · {(n/(n−1))² + (n+2)/(n(n−1)²) (B + 2(n²−1)/(n+2) C)² − n/(n+2) C²},
    /// S_II = −y²K²H/2 · {(n+1)/(n(n−1)) B + (2n+1)/n C}, S_III = H²K, S_IV = H²K/n, S_V = 0; C = −1 for an object at infinity.
    #[test]
    fn thin_lens_at_the_stop_has_the_sums_of_the_textbook() {
        let f = 100.0;
        for bending in [-1.0, 0.0, 0.5, 1.0] {
            let lens = thin(f, bending);
            let found = total(&seidel(&lens).unwrap()).unwrap();
            let (n, k, y, h) = (INDEX, 1.0 / f, 2.0_f64, 2.0 * 5.0_f64.to_radians().tan());
            // H = −ū y for parallel light; the conjugate variable (u + u')/(u − u') is −1.
            let (h, c) = (-h, -1.0);
            let s1 = y.powi(4) * k.powi(3) / 4.0
                * ((n / (n - 1.0)).powi(2)
                    + (n + 2.0) / (n * (n - 1.0).powi(2))
                        * (bending + 2.0 * (n * n - 1.0) / (n + 2.0) * c).powi(2)
                    - n / (n + 2.0) * c * c);
            let s2 = -(y * k).powi(2) * h / 2.0
                * ((n + 1.0) / (n * (n - 1.0)) * bending + (2.0 * n + 1.0) / n * c);
            let expected = [s1, s2, h * h * k, h * h * k / n, 0.0];
            for (found, expected) in found.sums_mm.iter().zip(expected) {
                assert!(
                    (found - expected).abs() < 1e-6 * s1.abs().max(expected.abs()),
                    "{bending}: {found} {expected}"
                );
            }
        }
    }

    #[test]
    fn parabolic_mirror_has_no_spherical_aberration_and_the_coma_of_its_focal_ratio() {
        let found = total(&seidel(&parabolic_mirror(200.0, 20.0)).unwrap()).unwrap();
        let tan = 1.0_f64.to_radians().tan();
        assert!(found.sums_mm[0].abs() < 1e-15);
        // Tangential coma of a parabola 3 θ / (16 N²) = 3 S_II / (2 n' u'): S_II = y³ θ / (2 f²) in size.
        let coma = 1e3 * tan / (2.0 * 200.0 * 200.0);
        assert!((found.sums_mm[1].abs() - coma).abs() < 1e-9 * coma, "{found:?} {coma}");
        // Petzval radius f: S_IV = −H²/f.
        let h = 10.0 * tan;
        assert!((found.sums_mm[3] + h * h / 200.0).abs() < 1e-12, "{found:?}");
    }

    /// At a small aperture and field the wavefront of real rays is the sum of the third-order terms.
    #[test]
    fn sums_of_the_double_gauss_are_the_wavefront_of_its_real_rays() {
        let mut lens = System::double_gauss_28();
        lens.aperture = Aperture::EntrancePupil(8.0);
        lens.field_kind = FieldKind::Angle;
        lens.fields = vec![2.0];
        let um = lens.primary_um();
        let lens = lens.with_image_plane(ImagePlane::Paraxial(um), 0.0).unwrap();
        let w = total(&seidel(&lens).unwrap()).unwrap().waves(um);
        let tracer = Tracer::new(&lens, um).unwrap();
        let at = |tan: f64, p: f64, q: f64| {
            ReferenceSphere::new(&tracer, tan).unwrap().waves(&tracer.ray(tan, p, q).unwrap())
        };
        let spherical = at(0.0, 1.0, 0.0);
        assert!((spherical / w[0] - 1.0).abs() < 0.05, "W040 {spherical} {}", w[0]);
        let tan = 2.0_f64.to_radians().tan();
        let odd = 0.5 * (at(tan, 1.0, 0.0) - at(tan, -1.0, 0.0));
        assert!((odd / w[1] - 1.0).abs() < 0.05, "W131 {odd} {}", w[1]);
        let (tangential, sagittal) = (0.5 * (at(tan, 1.0, 0.0) + at(tan, -1.0, 0.0)), at(tan, 0.0, 1.0));
        assert!(((tangential - sagittal) / w[2] - 1.0).abs() < 0.05, "W222 {}", w[2]);
        assert!(((sagittal - spherical) / w[3] - 1.0).abs() < 0.05, "W220 {} {}", sagittal - spherical, w[3]);
    }

    /// A conic and the same surface as a sphere with a term in r⁴ have the same sums.
    #[test]
    fn departures_from_the_sphere_add_up() {
        let mut a = thin(100.0, 0.3);
        a.surfaces[0].shape.conic = -0.8;
        let mut b = thin(100.0, 0.3);
        let c = b.surfaces[0].shape.curvature;
        b.surfaces[0].shape.aspheric = vec![0.0, -0.8 * c.powi(3) / 8.0];
        let [a, b] = [a, b].map(|s| total(&seidel(&s).unwrap()).unwrap());
        assert!((a.sums_mm[0] - b.sums_mm[0]).abs() < 1e-15 && a.sums_mm[0] != 0.0);
        let mut odd = thin(100.0, 0.3);
        odd.surfaces[1].shape.odd = vec![0.0, 1e-5];
        let sums = seidel(&odd).unwrap();
        assert!(sums[0].is_some() && sums[1].is_none() && total(&sums).is_none());
    }
}
