//! Validity of the measurement of an edge: errors where its figures would not be meaningful, notes where they are doubtful.
//!
//! ISO 12233 slants its edges by about 5° so that the rows cross the edge at all phases of a pixel. Below 2° a few rows repeat the same
//! phases; above 15° the spacing along the normal is no longer that of the rows.

use crate::failure::usage;
use anyhow::Result;
use pipeline::measure::edge::{EdgeLine, Esf};
use serde_json::{Value, json};

/// Minimum length of an edge, px.
const MIN_LENGTH_PX: f64 = 10.0;
/// Slants from the nearest row or column within which the figures are accurate, degrees.
const USUAL_TILT_DEG: std::ops::RangeInclusive<f64> = 2.0..=15.0;
/// Maximum angle between the given and the fitted edge, degrees.
const MAX_ROTATION_DEG: f64 = 20.0;
/// Michelson contrast below which nothing is measured, and below which it is remarked.
const MIN_CONTRAST: f64 = 0.02;
const LOW_CONTRAST: f64 = 0.1;
/// Standard deviation of a plateau, as a share of the step, above which it is remarked.
const MAX_UNEVENNESS: f64 = 0.03;

/// A remark: its name for programs, and its text.
#[derive(Debug)]
pub struct Remark {
    name: &'static str,
    /// For the user.
    pub text: String,
}

impl Remark {
    /// A remark with its name for programs and its text.
    pub fn new(name: &'static str, text: String) -> Self {
        Self { name, text }
    }
}

/// The names of remarks.
pub fn names(remarks: &[Remark]) -> Value {
    json!(remarks.iter().map(|r| r.name).collect::<Vec<_>>())
}

/// Fails unless the two positions are far enough apart.
///
/// # Errors
/// Usage.
pub fn check_length(length_px: f64) -> Result<()> {
    match length_px >= MIN_LENGTH_PX {
        true => Ok(()),
        false => Err(usage(format!(
            "the positions are {length_px:.1} px apart: an edge needs at least {MIN_LENGTH_PX} px; give positions farther apart"
        ))),
    }
}

/// Fails if the fitted edge is another than that between the given positions.
///
/// # Errors
/// Usage: the region is not on the edge, or contains other objects.
pub fn check_place(given: EdgeLine, found: EdgeLine, half_px: usize) -> Result<()> {
    let offset = given.distance(found.at_px).abs();
    let turn = (found.normal_rad - given.normal_rad).to_degrees().rem_euclid(180.0);
    let turn = turn.min(180.0 - turn);
    if offset <= half_px as f64 / 2.0 && turn <= MAX_ROTATION_DEG {
        return Ok(());
    }
    Err(usage(format!(
        "the edge found there is {offset:.1} px from the given positions and rotated by {turn:.1} deg: the region is not on the edge or \
         contains other objects; give positions on the edge, or a smaller --half-px"
    )))
}

/// Remarks on an edge with plateaus `dark` and `light` and the normalised `esf`, whose plateaus begin at ± `plateau_px`.
///
/// # Errors
/// Usage: the contrast is too small.
pub fn remarks(line: EdgeLine, (dark, light): (f64, f64), esf: &Esf, plateau_px: f64) -> Result<Vec<Remark>> {
    let contrast = (light - dark) / (light.abs() + dark.abs());
    if contrast < MIN_CONTRAST {
        return Err(usage(format!(
            "the contrast of the edge is {:.2} % ({dark:.4e} to {light:.4e}), at least {:.0} % are needed",
            100.0 * contrast,
            100.0 * MIN_CONTRAST
        )));
    }
    let mut all = Vec::new();
    if contrast < LOW_CONTRAST {
        all.push(Remark {
            name: "low_contrast",
            text: format!("the contrast is only {:.1} %", 100.0 * contrast),
        });
    }
    let tilt = tilt_deg(line);
    if !USUAL_TILT_DEG.contains(&tilt) {
        all.push(Remark {
            name: "tilt",
            text: format!(
                "the edge is slanted by {tilt:.2} deg, expected {} to {} deg",
                USUAL_TILT_DEG.start(),
                USUAL_TILT_DEG.end()
            ),
        });
    }
    let unevenness = |side: f64, level: f64| {
        let values = esf
            .samples
            .iter()
            .filter(|s| s.distance_px * side > plateau_px)
            .map(|s| (s.value - level).powi(2));
        let (sum, count) = values.fold((0.0, 0usize), |(sum, n), v| (sum + v, n + 1));
        (sum / count.max(1) as f64).sqrt()
    };
    let worst = unevenness(-1.0, 0.0).max(unevenness(1.0, 1.0));
    if worst > MAX_UNEVENNESS {
        all.push(Remark { name: "uneven_plateau", text: format!(
                "a side of the edge is uneven by {:.1} % of the step: noise, or the window reaches another object; a smaller --half-px may help",
                100.0 * worst
            ) });
    }
    Ok(all)
}

/// Angle between the edge and the nearest row or column, degrees.
fn tilt_deg(line: EdgeLine) -> f64 {
    let angle = line.normal_rad.to_degrees().rem_euclid(90.0);
    angle.min(90.0 - angle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::measure::edge::EsfSample;

    fn line(degrees: f64) -> EdgeLine {
        EdgeLine { at_px: (50.0, 50.0), normal_rad: degrees.to_radians() }
    }

    fn esf(light: f64) -> Esf {
        let value = |d: f64| {
            if d < 0.0 {
                0.0
            } else if d > 10.0 {
                light
            } else {
                1.0
            }
        };
        let sample = |k: i32| EsfSample { distance_px: f64::from(k) / 4.0, value: value(f64::from(k) / 4.0) };
        Esf { samples: (-60..=60).map(sample).collect() }
    }

    #[test]
    fn tilt_contrast_and_uneven_plateaus_are_remarked() {
        let found = |degrees, plateaus, light| {
            let remarks = remarks(line(degrees), plateaus, &esf(light), 8.0).unwrap();
            remarks.iter().map(|r| r.name).collect::<Vec<_>>()
        };
        for (degrees, plateaus, light, expected) in [
            (5.0, (0.1, 0.9), 1.0, &[][..]),
            (185.0, (0.1, 0.9), 1.0, &[]),
            (94.0, (0.1, 0.9), 1.0, &[]),
            (0.5, (0.1, 0.9), 1.0, &["tilt"]),
            (-91.0, (0.1, 0.9), 1.0, &["tilt"]),
            (45.0, (0.5, 0.55), 1.0, &["low_contrast", "tilt"]),
            (5.0, (0.1, 0.9), 1.2, &["uneven_plateau"]),
        ] {
            assert_eq!(found(degrees, plateaus, light), expected, "{degrees}");
        }
        assert!(remarks(line(5.0), (0.5, 0.501), &esf(1.0), 8.0).is_err());
    }

    #[test]
    fn short_edge_and_edge_elsewhere_are_errors() {
        assert!(check_length(9.9).is_err() && check_length(10.0).is_ok());
        let beside = EdgeLine { at_px: (50.0, 63.0), ..line(5.0) };
        assert!(check_place(line(5.0), line(187.0), 24).is_ok());
        assert!(check_place(line(5.0), beside, 24).is_err());
        assert!(check_place(line(5.0), line(40.0), 24).is_err());
    }
}
