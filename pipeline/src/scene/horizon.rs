//! Directions about the up axis of a file: of the sun, of columns and rows of a map.
//!
//! Azimuth: degrees clockwise from north, seen from above, as a compass bearing. Elevation: degrees above the horizon.
//!
//! ```text
//! up axis   up   north   east
//! y         +Y    −Z     +X       glTF: the camera that looks along −Z without rotation looks north
//! z         +Z    +Y     +X       maps and CAD: x east, y north
//! ```
//! The two agree: a file with z up that is converted to y up by (x, y, z) → (x, z, −y) keeps its azimuths.

use super::vector::dot;
use crate::real;
use crate::scene::pose::Pose;

/// A vector of the file's coordinates in the camera frame.
pub(super) fn rotated(pose: &Pose, v: [f64; 3]) -> [f64; 3] {
    [pose.right, pose.down, pose.forward].map(|axis| dot(axis, v))
}

/// A point of the file's coordinates, m, in the camera frame.
pub(super) fn placed(pose: &Pose, point_m: [f64; 3]) -> [f64; 3] {
    rotated(pose, std::array::from_fn(|k| point_m[k] - pose.eye[k]))
}

/// The axis of the file that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum UpAxis {
    /// +Y, as in glTF.
    #[default]
    Y,
    /// +Z.
    Z,
}

/// Unit vectors of the horizon in the camera frame.
#[derive(Clone, Copy, Debug)]
pub struct Horizon {
    east: [f64; 3],
    north: [f64; 3],
    up: [f64; 3],
}

impl Horizon {
    /// Of a file whose `up` axis is given.
    pub fn new(pose: &Pose, up: UpAxis) -> Self {
        let (up, north) = match up {
            UpAxis::Y => ([0.0, 1.0, 0.0], [0.0, 0.0, -1.0]),
            UpAxis::Z => ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0]),
        };
        Self { east: rotated(pose, [1.0, 0.0, 0.0]), north: rotated(pose, north), up: rotated(pose, up) }
    }

    /// The unit vector of an azimuth and an elevation, in the camera frame.
    pub fn direction(&self, azimuth_deg: f64, elevation_deg: f64) -> [f64; 3] {
        let (sin_azimuth, cos_azimuth) = real::sin_cos(azimuth_deg.to_radians());
        let (sin_elevation, cos_elevation) = real::sin_cos(elevation_deg.to_radians());
        let (e, n) = (sin_azimuth * cos_elevation, cos_azimuth * cos_elevation);
        std::array::from_fn(|k| (e * self.east[k] + n * self.north[k]) + sin_elevation * self.up[k])
    }

    /// Azimuth and elevation in radians, −π to π and −π/2 to π/2, of a vector of the camera frame of any length.
    pub fn angles_rad(&self, direction: [f64; 3]) -> (f64, f64) {
        let [e, n, u] = [self.east, self.north, self.up].map(|axis| dot(axis, direction));
        (real::atan2(e, n), real::atan2(u, (e * e + n * n).sqrt()))
    }
}
