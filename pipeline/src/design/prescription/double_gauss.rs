//! A lens for examples and tests: the sample "Double Gauss 28 degree field" of a lens design program (`formats/data/lenses`).

use super::glass_library::GlassLibrary;
use super::system::{Aperture, FieldKind, Medium, RayAiming, Surface, System};

/// Curvature [1/mm], thickness [mm], glass behind the surface, semi-diameter [mm].
const SURFACES: [(f64, f64, Option<&str>, f64); 12] = [
    (0.018466113683, 8.74665785, Some("N-SK2"), 29.22529777),
    (0.006556434601899999, 0.5, None, 28.140954031),
    (0.027815928521, 14.0, Some("N-SK16"), 24.295812439),
    (0.0, 3.77696589, Some("F5"), 21.297190924),
    (0.044903609561, 14.2530593, None, 14.919352563),
    (0.0, 12.4281291, None, 10.228835191),
    (-0.038933179444, 3.77696589, Some("F5"), 13.187758486),
    (0.0, 10.8339285, Some("N-SK16"), 16.468122395),
    (-0.027041482725, 0.5, None, 18.929567529),
    (0.0050912003495, 6.85817491, Some("N-SK16"), 21.310764717),
    (-0.014892576119999999, 57.314537905, None, 21.646258433),
    (0.0, 0.0, None, 24.57),
];

impl System {
    /// A Double Gauss of 100 mm, f/3: object at infinity, film as designed, no apertures, rays aimed at the paraxial entrance pupil.
    pub fn double_gauss_28() -> Self {
        let glasses = GlassLibrary::new();
        let schott = ["SCHOTT".to_owned()];
        let medium = |name: &str| {
            let (glass, _) = glasses.find(name, &schott).expect("the built-in table has these glasses");
            Medium::Glass(glass)
        };
        let surface = |(curvature, thickness_mm, glass, semi_diameter_mm): (f64, f64, Option<&str>, f64)| {
            let medium = glass.map_or(Medium::Air, medium);
            Surface { semi_diameter_mm, ..Surface::new(curvature, thickness_mm, medium) }
        };
        Self {
            name: "Double Gauss 28 degree field".to_owned(),
            object_distance_mm: None,
            is_telecentric: false,
            surfaces: SURFACES.map(surface).to_vec(),
            stop: 5,
            aperture: Aperture::EntrancePupil(33.33),
            field_kind: FieldKind::Angle,
            fields: vec![0.0, 10.0, 14.0],
            wavelengths_um: [0.4861, 0.5876, 0.6563].map(|um| (um, 1.0)).to_vec(),
            primary: 1,
            aiming: RayAiming::Paraxial,
            notes: Vec::new(),
            asymmetry: None,
        }
    }
}
