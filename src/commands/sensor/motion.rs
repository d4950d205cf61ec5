//! Motion of the camera during an exposure, from a table of shifts or of a gyroscope's rates (`--motion`): one frame of one time, of a film that reaches beyond the sensor by the motion.

use super::exposure::{Times, time_or_zero};
use super::geometry::Geometry;
use crate::args::ExposeArgs;
use crate::failure::usage;
use crate::film::digest;
use crate::film::plane::FilmPlane;
use anyhow::Result;
use formats::sensor::{self, camera_motion};
use pipeline::sensor::Sensor;
use pipeline::sensor::angle::radians;
use pipeline::sensor::gyro;
use pipeline::sensor::motion::{Motion, Pose, RowTimes};
use serde_json::{Value, json};
use std::path::Path;

/// Moments of an exposure, at most.
pub const MAX_STEPS: usize = 20_000;
/// Pixels beside a pixel that a motion may read, at most.
pub const MAX_MARGIN_PX: usize = 2048;

/// The motion of a camera, ready for a film.
pub struct CameraMotion {
    /// The film behind it.
    pub motion: Motion,
    identity: Value,
    note: String,
}

impl CameraMotion {
    /// That of `--motion` for the sensor at `geometry` on `film`; none without the flag.
    ///
    /// # Errors
    /// Usage: several frames or times, a time that follows from the signal, a kept signal, a table that does not cover the exposure, a sensor that the motion takes beyond the film.
    pub fn of_film(
        args: &ExposeArgs,
        times: &Times,
        sensor: &Sensor,
        (film, geometry): (&FilmPlane, &Geometry),
    ) -> Result<Option<Self>> {
        let Some(path) = &args.motion else {
            return match args.focal_length_mm {
                None => Ok(None),
                Some(_) => Err(usage("--focal-length-mm is for --motion with the rates of a gyroscope")),
            };
        };
        let exposure_s = match times {
            Times::Given(times) if times.len() == 1 && args.frames == 1 && !args.keep_signal => times[0],
            _ => {
                return Err(usage(
                    "--motion: expected one frame of one exposure time, without --keep-signal, for each has a signal of its own; give --exposure TIME, and for other frames --motion-start",
                ));
            }
        };
        let motion = camera_motion(path).map_err(|e| usage(e.to_string()))?;
        let (sensor::CameraMotion::Shifts(table) | sensor::CameraMotion::Rates(table)) = &motion;
        let rows = &geometry.rows;
        let row_px = rows.ratio();
        let middle_px = 0.5 * film.size.height as f64 + rows.centre_um / film.pitch_um;
        let times = RowTimes {
            row_time_s: sensor.row_time_s,
            exposure_s,
            rows: rows.sensor_px,
            first_px: middle_px - 0.5 * rows.sensor_px as f64 * row_px,
            row_px,
        };
        let start_s = args.motion_start.as_deref();
        let start_s = start_s.map_or(Ok(0.0), |text| time_or_zero("--motion-start", text))?;
        check_covers(path, table, (start_s, times.end_s()))?;
        let axis = |n: usize, axis_um: f64| (n as f64 - 1.0) / 2.0 + axis_um / film.pitch_um;
        let axis_px = (axis(film.size.height, film.axis_um.0), axis(film.size.width, film.axis_um.1));
        let mut poses = poses(args, path, &motion)?;
        poses.iter_mut().for_each(|pose| pose.time_s -= start_s);
        let identity_of_table = match args.focal_length_mm {
            None => json!(table),
            Some(mm) => json!([mm, table]),
        };
        let motion = Motion::new(poses, times, (film.size, film.pitch_um, axis_px));
        if motion.steps() > MAX_STEPS || motion.margin_px() > MAX_MARGIN_PX {
            return Err(usage(format!(
                "--motion {}: moves the picture by up to {} film pixels and needs {} moments an exposure, expected at most {MAX_MARGIN_PX} and {MAX_STEPS}",
                path.display(),
                motion.margin_px(),
                motion.steps()
            )));
        }
        check_inside(path, &motion, film, geometry)?;
        let mut identity = json!({
            "table": digest(&identity_of_table),
            "exposure_s": exposure_s,
            "row_time_s": sensor.row_time_s,
        });
        // Absent at 0: the identity is then that of programs without this flag.
        if start_s > 0.0 {
            identity["start_s"] = start_s.into();
        }
        let note = format!(
            "motion of the camera: the picture moves by up to {:.1} film pixels; each row is the mean of {} moments",
            reach_um(&motion, film, geometry) / film.pitch_um,
            motion.steps()
        );
        Ok(Some(Self { motion, identity, note }))
    }

    /// What it adds to the identity of a signal.
    pub fn identity(&self) -> Value {
        self.identity.clone()
    }

    /// What is printed.
    pub fn note(&self) -> String {
        self.note.clone()
    }
}

/// The poses of a table.
///
/// # Errors
/// Usage: rates without a focal length, or shifts with one.
fn poses(args: &ExposeArgs, path: &Path, motion: &sensor::CameraMotion) -> Result<Vec<Pose>> {
    match (motion, args.focal_length_mm) {
        (sensor::CameraMotion::Shifts(rows), None) => Ok(shifted(rows)),
        (sensor::CameraMotion::Rates(rows), Some(mm)) => {
            let in_radians = |[t, x, y, z]: &[f64; 4]| [*t, radians(*x), radians(*y), radians(*z)];
            Ok(gyro::poses(&rows.iter().map(in_radians).collect::<Vec<_>>(), mm))
        }
        (sensor::CameraMotion::Rates(_), None) => Err(usage(format!(
            "--motion {} has the rates of a gyroscope: give --focal-length-mm, which makes them shifts of the picture",
            path.display()
        ))),
        (sensor::CameraMotion::Shifts(_), Some(_)) => Err(usage(format!(
            "--focal-length-mm is for rates of a gyroscope; --motion {} has shifts of the picture",
            path.display()
        ))),
    }
}

/// The poses of a table of time (s), shift (µm; right, down) and rotation (degrees).
pub fn shifted(rows: &[[f64; 4]]) -> Vec<Pose> {
    let pose = |[time_s, x_um, y_um, degrees]: &[f64; 4]| Pose {
        time_s: *time_s,
        x_um: *x_um,
        y_um: *y_um,
        rotation_rad: radians(*degrees),
    };
    rows.iter().map(pose).collect()
}

/// Fails for a table that does not span an exposure that begins at `start_s` and lasts `length_s` with all rows.
///
/// # Errors
/// Usage.
pub fn check_covers(path: &Path, table: &[[f64; 4]], (start_s, length_s): (f64, f64)) -> Result<()> {
    let (first_s, last_s, end_s) = (table[0][0], table[table.len() - 1][0], start_s + length_s);
    match first_s <= start_s && last_s >= end_s * (1.0 - 1e-9) {
        true => Ok(()),
        false => Err(usage(format!(
            "--motion {}: expected times from {start_s} to {end_s} s, the end of the exposure, found {first_s} to {last_s} s",
            path.display()
        ))),
    }
}

/// Greatest shift of a pixel of the sensor, µm.
fn reach_um(motion: &Motion, film: &FilmPlane, geometry: &Geometry) -> f64 {
    let corner = |centre_um: f64, axis_um: f64, n: usize, pitch_um: f64| {
        (centre_um - axis_um).abs() + 0.5 * n as f64 * pitch_um
    };
    let (rows, columns) = (&geometry.rows, &geometry.columns);
    let down = corner(rows.centre_um, film.axis_um.0, rows.sensor_px, rows.pitch_um);
    let right = corner(columns.centre_um, film.axis_um.1, columns.sensor_px, columns.pitch_um);
    motion.reach_um(pipeline::real::hypot(down, right))
}

/// Fails where the motion takes a pixel of the sensor beyond the film.
fn check_inside(path: &Path, motion: &Motion, film: &FilmPlane, geometry: &Geometry) -> Result<()> {
    let reach_um = reach_um(motion, film, geometry);
    let free = |axis: &pipeline::sensor::pixels::Axis| {
        0.5 * (axis.film_px as f64 * film.pitch_um - axis.sensor_px as f64 * axis.pitch_um)
            - axis.centre_um.abs()
    };
    let free_um = free(&geometry.rows).min(free(&geometry.columns));
    match reach_um <= free_um + 1e-6 {
        true => Ok(()),
        false => Err(usage(format!(
            "--motion {}: moves the picture by up to {reach_um:.2} µm, but the film reaches {:.2} µm beyond the sensor; give a smaller --size, or make a larger film",
            path.display(),
            free_um.max(0.0)
        ))),
    }
}
