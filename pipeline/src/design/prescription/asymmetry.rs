//! What a design without rotational symmetry has beside its straightened lens: poses, shapes and apertures of its surfaces.
//!
//! The surfaces of a [`System`](super::system::System) are on one axis and rotationally symmetric. In a design with tilts, decentres or surfaces
//! without symmetry they are the *straightened* lens: the same surfaces without tilts and decentres, with their profile along y. It
//! gives what a design program takes from the straightened lens too: the size of the stop and of the entrance pupil, and first-order
//! figures. Rays are traced through the surfaces of this module.
//!
//! *Lens frame*: right-handed, z along the light at the first surface, mm, origin on that surface's vertex before its own tilt or
//! decentre. *Surface frame*: that of the design file by its pose. Where the light runs against its z (`is_reversed`: behind an odd number of
//! mirrors, or beyond a turn by more than a quarter) the tracer reverses z, so that shapes are as the light sees them.

use super::freeform::SkewShape;
use super::pose::Pose;

/// Highest power of x or y of a surface's XY terms.
pub const MAX_XY_POWER: u32 = 30;

/// Maximum number of XY terms of a surface, and of its coefficients of r or y.
const MAX_TERMS: usize = 1000;

/// The true surfaces of a design without rotational symmetry.
#[derive(Clone, Debug, PartialEq)]
pub struct Asymmetry {
    /// As many as the straightened lens has, in the same order, the film last.
    pub surfaces: Vec<FreeSurface>,
}

/// A surface of a design without rotational symmetry.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FreeSurface {
    /// Its place in the lens frame.
    pub pose: Pose,
    /// Whether the light arrives against the z of its pose.
    pub is_reversed: bool,
    /// Its shape, z along the light.
    pub shape: SkewShape,
    /// Whether it is a coordinate break alone, which no ray meets.
    pub is_frame: bool,
    /// Outside which light is blocked.
    pub aperture: Option<Outline>,
    /// Inside which light is blocked.
    pub obscuration: Option<Outline>,
}

/// The outline of an aperture or obscuration, in the frame of its surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outline {
    /// Its form.
    pub form: Form,
    /// Half its sides or diameters along x and y, mm.
    pub half_mm: [f64; 2],
    /// Its centre, mm.
    pub centre_mm: [f64; 2],
}

/// The form of an outline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// A circle or an ellipse.
    Ellipse,
    /// A rectangle.
    Rectangle,
}

impl Outline {
    /// A disc of `radius_mm` about the vertex.
    pub fn disc(radius_mm: f64) -> Self {
        Self { form: Form::Ellipse, half_mm: [radius_mm; 2], centre_mm: [0.0; 2] }
    }

    /// A number below 0 inside, above 0 outside; of an ellipse (x/a)² + (y/b)² − 1, of a rectangle that of the nearer pair of sides,
    /// (x/a)² − 1 or (y/b)² − 1, and whether it is the pair along y.
    pub fn level(&self, x: f64, y: f64) -> (f64, bool) {
        let [u, v] = [(x - self.centre_mm[0]) / self.half_mm[0], (y - self.centre_mm[1]) / self.half_mm[1]];
        let (u, v) = (u * u, v * v);
        match self.form {
            Form::Ellipse => (u + v - 1.0, false),
            Form::Rectangle => (u.max(v) - 1.0, v > u),
        }
    }

    /// Whether it is a disc about the vertex.
    pub fn is_centred_disc(&self) -> bool {
        self.form == Form::Ellipse && self.half_mm[0] == self.half_mm[1] && self.centre_mm == [0.0; 2]
    }
}

impl Asymmetry {
    /// What is wrong with it for a lens of `count` surfaces, if anything.
    pub(super) fn problem(&self, count: usize) -> Option<&'static str> {
        let is_positive = |outline: &Outline| {
            let finite = outline.centre_mm.iter().all(|v| v.is_finite());
            finite && outline.half_mm.iter().all(|v| v.is_finite() && *v > 0.0)
        };
        let numbers = |s: &FreeSurface| {
            let pose = s.pose.origin_mm.into_iter().chain(s.pose.rotation.into_iter().flatten());
            pose.chain(s.shape.numbers()).all(f64::is_finite)
        };
        if self.surfaces.len() != count {
            return Some("has another number of tilted surfaces than of surfaces");
        }
        if !self.surfaces.iter().all(numbers) {
            return Some("has a surface with a number that is not finite");
        }
        let is_bounded = |s: &FreeSurface| {
            let along_y = s.shape.along_y.as_ref();
            let counts = [&s.shape.base.aspheric, &s.shape.base.odd].map(Vec::len);
            counts
                .into_iter()
                .chain([s.shape.xy.len(), along_y.map_or(0, |y| y.aspheric.len())])
                .all(|n| n <= MAX_TERMS)
                && s.shape.xy.iter().all(|t| t.i.max(t.j) <= MAX_XY_POWER)
        };
        if !self.surfaces.iter().all(is_bounded) {
            return Some("has a surface with more than 1000 terms, or with a power of x or y above 30");
        }
        let is_swept = |s: &FreeSurface| {
            s.shape
                .along_y
                .as_ref()
                .and_then(|y| y.swept_mm)
                .is_none_or(|radius| !radius.is_nan() && radius != 0.0)
        };
        if !self.surfaces.iter().all(is_swept) {
            return Some("has a toroid whose radius of rotation is not a number other than 0");
        }
        let outlines =
            |s: &FreeSurface| [s.aperture, s.obscuration].into_iter().flatten().all(|o| is_positive(&o));
        if !self.surfaces.iter().all(outlines) {
            return Some("has a surface whose aperture or obscuration has a side that is not positive");
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::design::prescription::freeform::{AlongY, XyTerm};

    #[test]
    fn terms_powers_and_radii_of_rotation_are_bounded() {
        let problem = |shape: SkewShape| {
            let surface = FreeSurface { shape, ..FreeSurface::default() };
            Asymmetry { surfaces: vec![surface] }.problem(1).unwrap_or_default()
        };
        let xy = |xy: Vec<XyTerm>| SkewShape { xy, ..SkewShape::default() };
        assert_eq!(problem(xy(vec![XyTerm::new(30, 30, 1.0); 1000])), "");
        assert!(problem(xy(vec![XyTerm::new(2, 31, 1.0)])).contains("power of x or y above 30"));
        assert!(problem(xy(vec![XyTerm::new(1, 1, 1.0); 1001])).contains("more than 1000 terms"));
        let toroid = |radius: f64| SkewShape {
            along_y: Some(AlongY { swept_mm: Some(radius), ..AlongY::default() }),
            ..SkewShape::default()
        };
        assert_eq!(problem(toroid(f64::INFINITY)), "");
        assert!([0.0, f64::NAN].into_iter().all(|r| problem(toroid(r)).contains("radius of rotation")));
    }

    #[test]
    fn levels_change_their_sign_at_the_outline() {
        let ellipse = Outline { form: Form::Ellipse, half_mm: [2.0, 1.0], centre_mm: [5.0, 0.0] };
        assert!(ellipse.level(7.0, 0.0).0.abs() < 1e-15 && ellipse.level(5.0, -1.0).0.abs() < 1e-15);
        assert!(ellipse.level(0.0, 0.0).0 > 0.0 && ellipse.level(5.5, 0.5).0 < 0.0);
        let rectangle = Outline { form: Form::Rectangle, ..ellipse };
        assert_eq!(rectangle.level(7.0, 0.9), (0.0, false));
        assert_eq!(rectangle.level(6.9, 1.0), (0.0, true));
        assert!(rectangle.level(6.99, 0.99).0 < 0.0 && !rectangle.is_centred_disc());
        assert!(Outline::disc(3.0).is_centred_disc());
    }
}
