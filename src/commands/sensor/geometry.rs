//! Position of the sensor on the film: its size, its centre, the weights of film pixels.

use crate::args::{ExposeArgs, SizeArg, size_order_note};
use crate::failure::usage;
use crate::film::plane::FilmPlane;
use crate::progress::log_line;
use anyhow::Result;
use pipeline::geometry::{Rect, Size};
use pipeline::sensor::Sensor;
use pipeline::sensor::pixels::{Axis, Resample, Taps, nyquist_error};
use serde_json::{Value, json};

/// Film pixels per sensor pixel below which an unaligned sensor is warned of.
const COARSE: f64 = 2.0;

/// A sensor on a film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Geometry {
    /// Along rows, down.
    pub rows: Axis,
    /// Along columns, right.
    pub columns: Axis,
    /// Interpolation.
    pub resample: Resample,
    /// Middle of the sensor (y, x) from the optical axis, mm.
    pub centre_mm: (f64, f64),
}

impl Geometry {
    /// Places `sensor` on `film`.
    pub fn new(sensor: &Sensor, film: &FilmPlane, args: &ExposeArgs) -> Result<Self> {
        let (p, a) = (sensor.pixel.pitch_um, sensor.pixel.aperture_um);
        if !args.coarse_film {
            check_pitch(
                sensor,
                film.pitch_um,
                "make the film with `lenscube run ",
                ", or take it as it is with --coarse-film",
            )?;
        }
        let wanted = (args.center.1 * 1e3, args.center.0 * 1e3);
        let centre = (film.axis_um.0 + wanted.0, film.axis_um.1 + wanted.1);
        let axis = |film_px, sensor_px, centre_um| Axis {
            film_px,
            film_pitch_um: film.pitch_um,
            sensor_px,
            pitch_um: p,
            aperture_um: a,
            centre_um,
        };
        let fitting = |film_px: usize, centre_um: f64| {
            let free = film_px as f64 * film.pitch_um - 2.0 * centre_um.abs();
            let max = (free / p + 1e-9).floor().max(0.0) as usize;
            // Snapping may move the sensor by half a film pixel beyond the edge.
            (1..=max)
                .rev()
                .take(2)
                .find(|n| axis(film_px, *n, centre_um).snapped().taps(0..1, Resample::Area).is_ok())
        };
        let size = match args.size {
            Some(SizeArg::Px(size)) => {
                if let Some(note) = size_order_note("--size", size) {
                    log_line(format!("note: {note}"));
                }
                size
            }
            Some(SizeArg::Native) => match sensor.pixel.size {
                Some((height, width)) => Size::new(height, width),
                None => {
                    return Err(usage(format!(
                        "--size native: sensor {} has no size of its own; give --size WxH",
                        sensor.name
                    )));
                }
            },
            None => match (fitting(film.size.height, centre.0), fitting(film.size.width, centre.1)) {
                (Some(height), Some(width)) => Size::new(height, width),
                _ => return Err(beyond(Size::new(1, 1), p, centre, film)),
            },
        };
        let rows = axis(film.size.height, size.height, centre.0).snapped();
        let columns = axis(film.size.width, size.width, centre.1).snapped();
        let resample = args.resample;
        let centre_mm =
            ((rows.centre_um - film.axis_um.0) * 1e-3, (columns.centre_um - film.axis_um.1) * 1e-3);
        let geometry = Self { rows, columns, resample, centre_mm };
        if rows.taps(0..1, resample).is_err() || columns.taps(0..1, resample).is_err() {
            return Err(beyond(size, p, centre, film));
        }
        check_rois(args, size)?;
        Ok(geometry)
    }

    /// Size of the sensor in pixels.
    pub fn size(&self) -> Size {
        Size::new(self.rows.sensor_px, self.columns.sensor_px)
    }

    /// Weights of film rows and columns of the sensor pixels `window`.
    pub fn taps(&self, window: Rect) -> Result<(Taps, Taps)> {
        let range = |first: i64, n: usize| first as usize..first as usize + n;
        let rows = self.rows.taps(range(window.y, window.height), self.resample);
        let columns = self.columns.taps(range(window.x, window.width), self.resample);
        Ok((rows.map_err(|e| usage(e.to_string()))?, columns.map_err(|e| usage(e.to_string()))?))
    }

    /// What is worth knowing of it.
    pub fn warning(&self) -> Option<String> {
        let ratio = self.rows.ratio();
        let loses = !self.rows.is_whole() && ratio < COARSE;
        loses.then(|| {
            format!(
                "warning: {ratio:.3} film pixels a sensor pixel, edges not aligned: the finest stripes that the sensor resolves may be \
                 off by {:.2} of their modulation; a film of `lenscube run --film-pitch-um {}` has none of it",
                nyquist_error(ratio, self.resample),
                self.rows.pitch_um / 2.0
            )
        })
    }

    /// All that changes the signal.
    pub fn identity(&self) -> Value {
        json!({
            "size": [self.rows.sensor_px, self.columns.sensor_px],
            "centre_um": {"y": self.rows.centre_um, "x": self.columns.centre_um},
            "resample": match self.resample { Resample::Cubic => "cubic", Resample::Area => "area" },
        })
    }
}

/// Fails for a film of coarser pixels than the sensor's; the way out is `make` with a flag, `or` another.
///
/// # Errors
/// Usage.
pub fn check_pitch(sensor: &Sensor, film_um: f64, make: &str, or: &str) -> Result<()> {
    let p = sensor.pixel.pitch_um;
    match p < film_um * (1.0 - 1e-9) {
        true => Err(usage(format!(
            "sensor pixels of {p} µm on a film of {film_um} µm: nothing is known inside a film pixel; {make}--film-pitch-um {p}` or less{or}"
        ))),
        false => Ok(()),
    }
}

/// Fails for regions that are not inside the sensor.
pub fn check_rois(args: &ExposeArgs, size: Size) -> Result<()> {
    match args.roi.iter().find(|r| !size.rect().contains(**r)) {
        None => Ok(()),
        Some(roi) => Err(usage(format!(
            "--roi {},{},{},{} is not inside the sensor of {size} pixels",
            roi.x, roi.y, roi.width, roi.height
        ))),
    }
}

fn beyond(size: Size, pitch_um: f64, centre_um: (f64, f64), film: &FilmPlane) -> anyhow::Error {
    let mm = |n: usize, pitch_um: f64| n as f64 * pitch_um * 1e-3;
    usage(format!(
        "a sensor of {:.4} x {:.4} mm (width x height) with its middle {:.4}, {:.4} mm (right, down) from the film's reaches beyond the \
         film of {:.4} x {:.4} mm; give a smaller --size or another --center, or make a larger film",
        mm(size.width, pitch_um),
        mm(size.height, pitch_um),
        centre_um.1 * 1e-3,
        centre_um.0 * 1e-3,
        mm(film.size.width, film.pitch_um),
        mm(film.size.height, film.pitch_um),
    ))
}
