//! Poses: place and orientation of a local frame in its parent frame, and the conventions of design programs.
//!
//! ```text
//! v = R v' + o                                        v' local, v in the parent frame, R a rotation, o the local origin [mm]
//! decentre first (OpticStudio order 0, CODE V):       R = Rx Ry Rz,   o = δ
//! tilt first (OpticStudio order 1):                   R = Rz Ry Rx,   o = R δ
//! Optiland:                                           R = Rz Ry Rx,   o = δ
//! ```
//! Angles in rad, right-handed: a positive tilt about x takes +y towards +z, about y +z towards +x, about z +x towards +y. In
//! CODE V ADE and BDE are left-handed, CDE is right-handed. A pose of tilts first with −δ and −angles is the inverse of that of
//! decentre first with δ and the angles.
//! Source: OpticStudio, help of the surface type Coordinate Break (parameter 6 is the order); ray-optics (M. J. Hayford),
//! decentre types of CODE V.

use crate::real;

/// A vector, or a point in mm.
pub type Vector = [f64; 3];

/// A 3 × 3 matrix by rows.
pub type Matrix = [[f64; 3]; 3];

/// Place and orientation of a frame in its parent frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Its columns are the local axes in the parent frame.
    pub rotation: Matrix,
    /// The local origin in the parent frame, mm.
    pub origin_mm: Vector,
}

/// Order of decentre and tilts of a coordinate break.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Decentre, then tilts about x, y, z (order 0).
    DecentreFirst,
    /// Tilts about z, y, x, then decentre (order 1).
    TiltFirst,
}

/// Kind of a tilted or decentred surface in CODE V.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CodeVKind {
    /// Surface and all behind it.
    Basic,
    /// DAR: undone behind the surface.
    Return,
    /// BEN: the tilt again behind the surface.
    Bend,
    /// REV: undone behind the surface, without one before it.
    Reverse,
}

const UNIT: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Pose {
    /// The parent frame itself.
    pub const IDENTITY: Self = Self { rotation: UNIT, origin_mm: [0.0; 3] };

    /// A frame at `origin_mm` with the axes of its parent.
    pub fn at(origin_mm: Vector) -> Self {
        Self { rotation: UNIT, origin_mm }
    }

    /// The coordinate break of decentre (mm) and tilts about x, y, z (rad) in that order.
    pub fn coordinate_break(order: Order, decentre_mm: Vector, tilt_rad: Vector) -> Self {
        match order {
            Order::DecentreFirst => {
                let [x, y, z] = rotations(tilt_rad);
                Self { rotation: product(&product(&x, &y), &z), origin_mm: decentre_mm }
            }
            Order::TiltFirst => {
                let rotation = tilts_about_z_y_x(tilt_rad);
                Self { rotation, origin_mm: times(&rotation, decentre_mm) }
            }
        }
    }

    /// A decentre (mm), then tilts about x, y, z (rad).
    pub fn new(decentre_mm: Vector, tilt_rad: Vector) -> Self {
        Self::coordinate_break(Order::DecentreFirst, decentre_mm, tilt_rad)
    }

    /// That of a surface of Optiland with its `x, y, z` (mm) and `rx, ry, rz` (rad).
    pub fn optiland(decentre_mm: Vector, tilt_rad: Vector) -> Self {
        Self { rotation: tilts_about_z_y_x(tilt_rad), origin_mm: decentre_mm }
    }

    /// Those of CODE V before and behind a surface with its XDE, YDE, ZDE (mm) and ADE, BDE, CDE (rad).
    pub fn code_v(kind: CodeVKind, decentre_mm: Vector, [ade, bde, cde]: Vector) -> [Self; 2] {
        let tilt_rad = [-ade, -bde, cde];
        let whole = Self::new(decentre_mm, tilt_rad);
        match kind {
            CodeVKind::Basic => [whole, Self::IDENTITY],
            CodeVKind::Return => [whole, whole.inverse()],
            CodeVKind::Bend => [whole, Self::new([0.0; 3], tilt_rad)],
            CodeVKind::Reverse => [Self::IDENTITY, whole.inverse()],
        }
    }

    /// The pose of `inner`, a frame within this one, in this one's parent.
    pub fn compose(&self, inner: &Self) -> Self {
        Self { rotation: product(&self.rotation, &inner.rotation), origin_mm: self.point(inner.origin_mm) }
    }

    /// The pose of the parent in this frame.
    pub fn inverse(&self) -> Self {
        let rotation = transpose(&self.rotation);
        Self { rotation, origin_mm: times(&rotation, self.origin_mm).map(|v| -v) }
    }

    /// This motion, given in the frame `place`, as a motion of the parent frame: place · self · place⁻¹.
    pub fn within(&self, place: &Self) -> Self {
        place.compose(self).compose(&place.inverse())
    }

    /// A local point in the parent frame.
    pub fn point(&self, local: Vector) -> Vector {
        let v = times(&self.rotation, local);
        std::array::from_fn(|i| v[i] + self.origin_mm[i])
    }
}

fn rotations([ax, ay, az]: Vector) -> [Matrix; 3] {
    let [(sx, cx), (sy, cy), (sz, cz)] = [ax, ay, az].map(real::sin_cos);
    [
        [[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]],
        [[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]],
        [[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]],
    ]
}

fn tilts_about_z_y_x(tilt_rad: Vector) -> Matrix {
    let [x, y, z] = rotations(tilt_rad);
    product(&product(&z, &y), &x)
}

/// a b.
pub(in crate::design) fn product(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| {
        std::array::from_fn(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j])
    })
}

pub(in crate::design) fn transpose(a: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// a v.
pub(in crate::design) fn times(a: &Matrix, v: Vector) -> Vector {
    a.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    const DECENTRE: Vector = [0.3, -1.2, 0.7];
    const TILT: Vector = [0.4, -0.9, 1.3];

    fn worst(a: &Pose, b: &Pose) -> f64 {
        let pairs = a.rotation.iter().flatten().zip(b.rotation.iter().flatten());
        pairs.chain(a.origin_mm.iter().zip(&b.origin_mm)).fold(0.0, |w, (x, y)| f64::max(w, (x - y).abs()))
    }

    /// v' = (Rx Ry Rz)ᵀ (v − δ), or (Rz Ry Rx)ᵀ v − δ: one rotation after the other.
    fn by_steps(order: Order, v: Vector) -> Vector {
        let minus = |v: Vector| std::array::from_fn(|i| v[i] - DECENTRE[i]);
        let back = |v: Vector, axis: usize| times(&transpose(&rotations(TILT)[axis]), v);
        match order {
            Order::DecentreFirst => [0, 1, 2].into_iter().fold(minus(v), back),
            Order::TiltFirst => minus([2, 1, 0].into_iter().fold(v, back)),
        }
    }

    #[test]
    fn coordinate_breaks_of_both_orders() {
        let v = [0.5, 2.0, -1.0];
        for order in [Order::DecentreFirst, Order::TiltFirst] {
            let local = Pose::coordinate_break(order, DECENTRE, TILT).inverse().point(v);
            let expected = by_steps(order, v);
            assert!((0..3).all(|i| (local[i] - expected[i]).abs() < 1e-14), "{order:?}");
        }
        // A tilt about x takes +y towards +z, about y +z towards +x, about z +x towards +y.
        let turned = |tilt: Vector, v: Vector| Pose::new([0.0; 3], tilt).point(v);
        assert!(turned([0.1, 0.0, 0.0], [0.0, 1.0, 0.0])[2] > 0.09);
        assert!(turned([0.0, 0.1, 0.0], [0.0, 0.0, 1.0])[0] > 0.09);
        assert!(turned([0.0, 0.0, 0.1], [1.0, 0.0, 0.0])[1] > 0.09);
    }

    #[test]
    fn a_break_of_the_other_order_undoes_one() {
        let minus = |v: Vector| v.map(|c| -c);
        let there = Pose::new(DECENTRE, TILT);
        let back = Pose::coordinate_break(Order::TiltFirst, minus(DECENTRE), minus(TILT));
        assert!(worst(&there.compose(&back), &Pose::IDENTITY) < 1e-15);
        assert!(worst(&there.inverse(), &back) < 1e-15);
    }

    #[test]
    fn kinds_of_code_v() {
        let [before, behind] = Pose::code_v(CodeVKind::Return, DECENTRE, TILT);
        assert!(worst(&before.compose(&behind), &Pose::IDENTITY) < 1e-15);
        let [before, _] = Pose::code_v(CodeVKind::Basic, [0.0; 3], [0.1, 0.0, 0.0]);
        // ADE is left-handed: +y goes towards −z.
        assert!(before.point([0.0, 1.0, 0.0])[2] < -0.09);
        // A fold mirror of 45 degrees: the axis leaves at 90 degrees.
        let [before, behind] =
            Pose::code_v(CodeVKind::Bend, [0.0; 3], [std::f64::consts::FRAC_PI_4, 0.0, 0.0]);
        let axis = before.compose(&behind).point([0.0, 0.0, 1.0]);
        assert!((axis[1] - 1.0).abs() < 1e-15 && axis[2].abs() < 1e-15);
        let [before, behind] = Pose::code_v(CodeVKind::Reverse, DECENTRE, TILT);
        assert_eq!(before, Pose::IDENTITY);
        assert!(worst(&behind, &Pose::code_v(CodeVKind::Return, DECENTRE, TILT)[1]) == 0.0);
    }

    #[test]
    fn a_motion_about_a_pivot_keeps_the_pivot() {
        let pivot = Pose::at([0.0, 0.0, 20.0]);
        let motion = Pose::new([0.0; 3], TILT).within(&pivot);
        assert!((0..3).all(|i| (motion.point([0.0, 0.0, 20.0])[i] - pivot.origin_mm[i]).abs() < 1e-14));
    }
}
