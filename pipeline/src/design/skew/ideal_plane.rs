//! The ideal plane of a lens: where the field of slopes t would be imaged without distortion.
//!
//! ```text
//! I = f O ((tx, −ty) − (tx, −ty)_centre)
//! symmetric nominal lens:   f O = its distortion focal length at the primary wavelength, negative for an inverted image; centre 0
//! asymmetric by design:     f = √|det J₀|,  J₀ = ∂(X, Y)/∂(tx, −ty) of the chief ray at the film's centre, primary wavelength;
//!                           O = that of the eight flips and quarter turns with the largest tr(Oᵀ J₀);  centre: the field that lands on
//!                           the film's centre
//! ```
//! So the picture is upright and unmirrored also behind an odd number of mirrors, and what the film's centre sees is the chart's
//! centre, also where a design looks to one side. An anamorphic squeeze and a small rotation stay in the map. All bands share the
//! plane. t slopes of the light in object space; X right, Y down (film frame).

use super::chief::Chief;
use super::error::SkewError;
use super::system::BuiltLens;
use super::trace::SkewTracer;
use crate::design::rays::paraxial::Paraxial;
use crate::real;

/// Slopes where a field that lands on the film's centre is searched from, and azimuths of each.
const SEARCHED: [f64; 6] = [0.0, 0.03, 0.1, 0.2, 0.35, 0.6];
const AZIMUTHS: usize = 8;

/// The ideal plane of a lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct IdealPlane {
    /// f O.
    matrix_mm: [[f64; 2]; 2],
    /// Slopes of the field whose ideal point is (0, 0).
    centre: [f64; 2],
}

impl IdealPlane {
    /// That of a rotationally symmetric lens.
    pub(super) fn straight(primary: &Paraxial) -> Self {
        let scale = primary.distortion_focal_length_mm;
        Self { matrix_mm: [[scale, 0.0], [0.0, scale]], centre: [0.0; 2] }
    }

    /// That of the rays of a lens without symmetry.
    ///
    /// # Errors
    /// No chief ray reaches the film's centre.
    pub(super) fn of_rays(lens: &BuiltLens) -> Result<Self, SkewError> {
        let tracer = SkewTracer::new(lens, lens.nominal().primary_um())?;
        let starts = SEARCHED.iter().flat_map(|tan| {
            let azimuths = if *tan == 0.0 { 1 } else { AZIMUTHS };
            (0..azimuths).map(move |k| {
                let (sin, cos) = real::sin_cos(std::f64::consts::TAU * k as f64 / AZIMUTHS as f64);
                [tan * cos, tan * sin]
            })
        });
        let mut first = None;
        for start in starts {
            match tracer.field_near([0.0; 2], start) {
                Ok((centre, chief)) => return Ok(Self::at_centre(centre, &chief)),
                Err(e) => first = first.or(Some(e)),
            }
        }
        Err(first.expect("several starts"))
    }

    /// That of the field of slopes `centre` with its chief ray.
    fn at_centre(centre: [f64; 2], chief: &Chief) -> Self {
        let focal_mm = chief.determinant().abs().sqrt();
        // Columns by tx and by −ty.
        let jacobian = chief.by_slopes.map(|row| [row[0], -row[1]]);
        let signs = [[1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]];
        let candidates = signs.into_iter().flat_map(|[a, b]| [[[a, 0.0], [0.0, b]], [[0.0, a], [b, 0.0]]]);
        let trace = |o: &[[f64; 2]; 2]| -> f64 {
            o.iter().zip(&jacobian).map(|(a, b)| a[0] * b[0] + a[1] * b[1]).sum()
        };
        let best = candidates.max_by(|a, b| trace(a).total_cmp(&trace(b))).expect("eight candidates");
        Self { matrix_mm: best.map(|row| row.map(|v| focal_mm * v)), centre }
    }

    /// f, mm.
    pub(super) fn focal_mm(&self) -> f64 {
        let [a, b] = self.matrix_mm;
        (a[0] * b[1] - a[1] * b[0]).abs().sqrt()
    }

    /// The ideal point of the field of slopes `t` in the film frame, mm.
    pub(super) fn point_mm(&self, t: [f64; 2]) -> [f64; 2] {
        let [x, y] = [t[0] - self.centre[0], self.centre[1] - t[1]];
        self.matrix_mm.map(|row| row[0] * x + row[1] * y)
    }

    /// The slopes of the field with the ideal point `ideal_mm`.
    pub(super) fn slopes(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        // The inverse of f O is Oᵀ/f.
        let [a, b] = self.matrix_mm;
        let square = a[0] * a[0] + a[1] * a[1];
        let [u, v] = [(a[0] * x + b[0] * y) / square, (a[1] * x + b[1] * y) / square];
        [u + self.centre[0], self.centre[1] - v]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(by_slopes: [[f64; 2]; 2], centre: [f64; 2]) -> IdealPlane {
        IdealPlane::at_centre(centre, &Chief { at_mm: [0.0; 2], by_slopes })
    }

    #[test]
    fn the_orientation_is_the_nearest_flip_or_quarter_turn() {
        // X = 50 tx, Y = −50 ty: upright.
        assert_eq!(plane([[50.0, 0.0], [0.0, -50.0]], [0.0; 2]).matrix_mm, [[50.0, 0.0], [0.0, 50.0]]);
        // Inverted; mirrored, turned by a little; turned by a quarter.
        assert_eq!(plane([[-50.0, 0.0], [0.0, 50.0]], [0.0; 2]).matrix_mm, [[-50.0, 0.0], [0.0, -50.0]]);
        let tilted = plane([[-49.0, 3.0], [2.0, -51.0]], [0.0; 2]);
        assert!(
            tilted.matrix_mm[0][0] < 0.0 && tilted.matrix_mm[1][1] > 0.0 && tilted.matrix_mm[0][1] == 0.0
        );
        assert!((tilted.focal_mm() - (49.0_f64 * 51.0 - 6.0).sqrt()).abs() < 1e-12);
        let quarter = plane([[1.0, 40.0], [40.0, 1.0]], [0.0; 2]);
        assert!(
            quarter.matrix_mm[0][0] == 0.0 && quarter.matrix_mm[0][1] < 0.0 && quarter.matrix_mm[1][0] > 0.0
        );
    }

    #[test]
    fn ideal_points_and_slopes_are_inverse() {
        for matrix in [[[-30.0, 0.0], [0.0, 30.0]], [[0.0, 30.0], [-30.0, 0.0]]] {
            let plane = IdealPlane { matrix_mm: matrix, centre: [0.01, -0.2] };
            assert_eq!(plane.point_mm([0.01, -0.2]), [0.0; 2]);
            for t in [[0.3, 0.1], [-0.2, 0.05]] {
                let back = plane.slopes(plane.point_mm(t));
                assert!((back[0] - t[0]).abs() < 1e-15 && (back[1] - t[1]).abs() < 1e-15);
            }
        }
    }
}
