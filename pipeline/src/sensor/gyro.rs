//! Motion of the picture by the rates of a gyroscope on the camera.
//!
//! Axes of the camera: x to the right, y down, z forward. A rotation by θ_x turns the camera up, by θ_y to the right, by θ_z clockwise; the picture moves the other way:
//!
//! ```text
//! θ(t) = ∫₀ᵗ ω dt        ω linear between samples; from the first sample on where that is later than 0
//! shift right = −f tan θ_y        shift down = f tan θ_x        rotation = −θ_z (clockwise)
//! ```
//! f: focal length. Left out: the order of rotations, a change of θ² of a shift, and perspective: off the axis a shift grows by 1 + tan² of the field angle, of which the film has that at its middle.
//! Poses are linear in time: each interval between samples has eight of them, which leaves 1/64 of the curvature.

use super::motion::Pose;
use crate::real;

/// Poses of an interval between two samples.
const PARTS: usize = 8;

/// Poses of a camera of `focal_length_mm` of samples of (time, s; rates about x, y and z, rad/s), in order of time.
pub fn poses(samples: &[[f64; 4]], focal_length_mm: f64) -> Vec<Pose> {
    let mut angles: Vec<(f64, [f64; 3])> = Vec::with_capacity(samples.len() * PARTS);
    let mut angle = [0.0; 3];
    for pair in samples.windows(2) {
        let (from, to) = (&pair[0], &pair[1]);
        let length_s = to[0] - from[0];
        let integral = |axis: usize, share: f64| {
            let change = 0.5 * share * (to[axis + 1] - from[axis + 1]);
            length_s * share * (from[axis + 1] + change)
        };
        for part in 0..PARTS {
            let share = part as f64 / PARTS as f64;
            angles.push((
                from[0] + share * length_s,
                std::array::from_fn(|axis| angle[axis] + integral(axis, share)),
            ));
        }
        angle = std::array::from_fn(|axis| angle[axis] + integral(axis, 1.0));
    }
    angles.push((samples[samples.len() - 1][0], angle));
    let start = at(&angles, samples[0][0].max(0.0));
    let focal_um = 1e3 * focal_length_mm;
    let pose = |(time_s, angle): &(f64, [f64; 3])| {
        let [x, y, z]: [f64; 3] = std::array::from_fn(|axis| angle[axis] - start[axis]);
        Pose {
            time_s: *time_s,
            x_um: -focal_um * real::sin(y) / real::cos(y),
            y_um: focal_um * real::sin(x) / real::cos(x),
            rotation_rad: -z,
        }
    };
    angles.iter().map(pose).collect()
}

/// The angles at a time, between those around it.
fn at(angles: &[(f64, [f64; 3])], time_s: f64) -> [f64; 3] {
    let after = angles.partition_point(|(t, _)| *t <= time_s).clamp(1, angles.len() - 1);
    let ((t0, a), (t1, b)) = (&angles[after - 1], &angles[after]);
    let share = (time_s - t0) / (t1 - t0);
    std::array::from_fn(|axis| a[axis] + share * (b[axis] - a[axis]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against integrals in closed form: a constant rate, and one that grows with time; angles are 0 at the time 0, between samples.
    #[test]
    fn rates_become_shifts_and_rotations() {
        let rate = |t: f64| [0.2, -0.1 + 3.0 * t, 0.5];
        let samples: Vec<[f64; 4]> = (0..11)
            .map(|k| {
                let t = -0.005 + 0.004 * f64::from(k);
                let [x, y, z] = rate(t);
                [t, x, y, z]
            })
            .collect();
        let found = poses(&samples, 50.0);
        assert_eq!(found.len(), 81);
        for pose in &found {
            let t = pose.time_s;
            let expected = [-50e3 * (-0.1 * t + 1.5 * t * t).tan(), 50e3 * (0.2 * t).tan(), -0.5 * t];
            // The start, between two poses, is off by the curvature: 3/8 of a 0.5 ms step squared, 5e-3 um.
            assert!((pose.x_um - expected[0]).abs() < 6e-3, "{pose:?}");
            assert!((pose.y_um - expected[1]).abs() < 1e-6, "{pose:?}");
            assert!((pose.rotation_rad - expected[2]).abs() < 1e-12, "{pose:?}");
        }
    }

    /// Of a log that counts from another event than the exposure.
    #[test]
    fn angles_of_samples_that_begin_later_count_from_the_first() {
        let samples = |from: f64| [0.0, 0.01, 0.03].map(|t| [from + t, 0.2, 0.1 + t, -0.4]);
        let (at_zero, late) = (poses(&samples(0.0), 50.0), poses(&samples(1000.0), 50.0));
        assert_eq!(late.len(), at_zero.len());
        for (a, b) in late.iter().zip(&at_zero) {
            let pairs = [
                (a.time_s - 1000.0, b.time_s),
                (a.x_um, b.x_um),
                (a.y_um, b.y_um),
                (a.rotation_rad, b.rotation_rad),
            ];
            for (a, b) in pairs {
                assert!((a - b).abs() < 1e-6, "{a} {b}");
            }
        }
    }
}
