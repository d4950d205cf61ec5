//! Where the camera is and how it is turned: from world coordinates to the camera frame.
//!
//! The place of the camera is the centre of the entrance pupil. A camera of a glTF file looks along −Z of its node, +Y is up (glTF 2.0, 3.10.2);
//! the scale of the node is ignored: −Z and +Y are made orthonormal in this order. Axes of the camera frame in world coordinates:
//! ```text
//! forward = −Z/|Z|,   up = (Y − (Y·forward) forward)/|…|,   right = forward × up,   down = −up
//! ```
//! A point p of a primitive with matrix M = (A | t) in a file of unit u metres has the camera coordinates R (u A p) + R (u t − eye),
//! R the rows right, down, forward. The products R u A and R (u t − eye) are computed once per primitive, so the position of the file's origin
//! costs no precision. The result is rounded to f32 once.

use super::vector::{cross, dot, length, sub, unit};
use std::fmt;

/// Place and axes of the camera, in metres of the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Centre of the entrance pupil, m.
    pub eye: [f64; 3],
    /// Direction of growing columns.
    pub right: [f64; 3],
    /// Direction of growing rows.
    pub down: [f64; 3],
    /// Direction of the axis into the scene.
    pub forward: [f64; 3],
}

/// A camera that has no direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum PoseError {
    /// A number of the matrix, or of eye, target or up, is NaN or infinite.
    NotFinite,
    /// The matrix maps space to a plane, a line or a point.
    Singular,
    /// The matrix mirrors (its determinant is negative).
    Mirrored,
    /// Eye and target are one point.
    NoDirection,
    /// The up vector is 0 or parallel to the direction.
    NoUp,
}

impl fmt::Display for PoseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotFinite => "the camera has a coordinate that is not a finite number",
            Self::Singular => "the matrix of the camera's node is singular: it has no direction",
            Self::Mirrored => {
                "the matrix of the camera's node mirrors (negative determinant), which no camera can do"
            }
            Self::NoDirection => "eye and target of the camera are the same point",
            Self::NoUp => "the up vector of the camera is 0 or parallel to its direction",
        })
    }
}

impl std::error::Error for PoseError {}

/// Sine of the smallest angle between two axes that counts as one: f32 matrices have 6·10⁻⁸ of rounding.
const MIN_SINE: f64 = 1e-6;

impl Pose {
    /// Of the node of a glTF camera, `to_world` with its parents, in a file of `unit_m` metres.
    ///
    /// # Errors
    /// [`PoseError::NotFinite`], [`PoseError::Singular`], [`PoseError::Mirrored`].
    pub fn of_node(to_world: &[[f64; 4]; 4], unit_m: f64) -> Result<Self, PoseError> {
        let column = |k: usize| [to_world[0][k], to_world[1][k], to_world[2][k]];
        let (x, y, z, place) = (column(0), column(1), column(2), column(3));
        if ![x, y, z, place].as_flattened().iter().all(|v| v.is_finite()) {
            return Err(PoseError::NotFinite);
        }
        let determinant = dot(cross(x, y), z);
        // The product of the lengths is that of three perpendicular axes.
        if determinant.abs() <= MIN_SINE * MIN_SINE * length(x) * length(y) * length(z) {
            return Err(PoseError::Singular);
        }
        if determinant < 0.0 {
            return Err(PoseError::Mirrored);
        }
        Self::new(place.map(|v| v * unit_m), z.map(|v| -v), y).ok_or(PoseError::Singular)
    }

    /// At `eye`, looking to `target`, `up` upwards; m.
    ///
    /// # Errors
    /// [`PoseError::NotFinite`], [`PoseError::NoDirection`], [`PoseError::NoUp`].
    pub fn looking(eye: [f64; 3], target: [f64; 3], up: [f64; 3]) -> Result<Self, PoseError> {
        if ![eye, target, up].as_flattened().iter().all(|v| v.is_finite()) {
            return Err(PoseError::NotFinite);
        }
        let direction = sub(target, eye);
        if length(direction) == 0.0 {
            return Err(PoseError::NoDirection);
        }
        Self::new(eye, direction, up).ok_or(PoseError::NoUp)
    }

    fn new(eye: [f64; 3], direction: [f64; 3], up: [f64; 3]) -> Option<Self> {
        let forward = unit(direction)?;
        let up = unit(up)?;
        let along = dot(up, forward);
        let across = sub(up, forward.map(|v| v * along));
        if length(across) < MIN_SINE {
            return None;
        }
        let up = unit(across)?;
        let right = cross(forward, up);
        Some(Self { eye, right, down: up.map(|v| -v), forward })
    }

    /// Rows (R u A | R (u t − eye)) of a primitive with matrix `to_world` in a file of `unit_m` metres.
    pub fn from_primitive(&self, to_world: &[[f64; 4]; 4], unit_m: f64) -> [[f64; 4]; 3] {
        let column = |k: usize| [to_world[0][k] * unit_m, to_world[1][k] * unit_m, to_world[2][k] * unit_m];
        let columns = [column(0), column(1), column(2), sub(column(3), self.eye)];
        [self.right, self.down, self.forward].map(|axis| columns.map(|c| dot(axis, c)))
    }
}

/// `p` by the rows of [`Pose::from_primitive`], rounded to f32; −0 is 0.
pub fn to_camera(rows: &[[f64; 4]; 3], p: [f64; 3]) -> [f32; 3] {
    // The sum with 0 makes 0 of −0.
    rows.map(|row| (((row[0] * p[0] + row[1] * p[1]) + row[2] * p[2]) + row[3]) as f32 + 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const IDENTITY: [[f64; 4]; 4] =
        [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

    #[test]
    fn a_gltf_camera_looks_along_minus_z() {
        let mut m = IDENTITY;
        (m[0][3], m[1][3], m[2][3]) = (1.0, 2.0, 3.0);
        let pose = Pose::of_node(&m, 1.0).unwrap();
        assert_eq!(pose.eye, [1.0, 2.0, 3.0]);
        let rows = pose.from_primitive(&IDENTITY, 1.0);
        assert_eq!(to_camera(&rows, [1.5, 3.0, 1.0]), [0.5, -1.0, 2.0]);
        assert_eq!(to_camera(&rows, [1.0, 2.0, 3.0]).map(f32::to_bits), [0; 3]);
    }

    #[test]
    fn scale_and_shear_of_the_node_are_ignored() {
        let mut m = IDENTITY;
        (m[0][0], m[1][1], m[2][2], m[2][1]) = (2.0, 3.0, 0.5, 7.0);
        let pose = Pose::of_node(&m, 1.0).unwrap();
        assert_eq!(
            (pose.forward, pose.down, pose.right),
            ([0.0, 0.0, -1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0])
        );
    }

    #[test]
    fn matrices_without_a_rotation_are_errors() {
        let with = |row: usize, column: usize, v: f64| {
            let mut m = IDENTITY;
            m[row][column] = v;
            Pose::of_node(&m, 1.0)
        };
        assert_eq!(with(0, 0, -1.0), Err(PoseError::Mirrored));
        assert_eq!(with(2, 2, 0.0), Err(PoseError::Singular));
        assert_eq!(with(0, 3, f64::NAN), Err(PoseError::NotFinite));
        let at = |target, up| Pose::looking([0.0; 3], target, up);
        assert_eq!(at([0.0; 3], [0.0, 1.0, 0.0]), Err(PoseError::NoDirection));
        assert_eq!(at([0.0, 2.0, 0.0], [0.0, 1.0, 0.0]), Err(PoseError::NoUp));
        assert_eq!(at([0.0, 0.0, 2.0], [0.0; 3]), Err(PoseError::NoUp));
    }

    #[test]
    fn the_origin_of_the_file_costs_no_precision() {
        let far = [5e6, -5e6, 5e6];
        let mut m = IDENTITY;
        (0..3).for_each(|k| m[k][3] = far[k]);
        let pose = Pose::looking(far, [far[0], far[1], far[2] - 1.0], [0.0, 1.0, 0.0]).unwrap();
        let rows = pose.from_primitive(&m, 1.0);
        assert_eq!(to_camera(&rows, [0.1, 0.2, -0.7]), [0.1, -0.2, 0.7]);
    }
}
