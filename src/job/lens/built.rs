//! A lens as built, adjusted once for its film (focus, tilt, place), and the rectangle of its map.
//!
//! PSF nodes reach as far as those of the nominal lens; the map covers the film with the same margin on all sides, as wide as its corners stay within that
//! reach.

use super::drawn::DrawnLens;
use super::tracing_job::TracingJob;
use anyhow::Result;
use formats::lens::{PackAttributes, ReferencePoint};
use pipeline::design::skew::map::FilmRange;
use pipeline::design::skew::tables::NominalNodes;
use pipeline::design::tolerance::Compensated;
use pipeline::design::trace::with_threads;
use serde_json::{Value, json};

/// A lens as built and adjusted, and the nodes of its nominal lens.
pub(super) struct BuiltBands {
    pub(super) compensated: Compensated,
    /// Its errors, as recorded.
    errors: Value,
    pub(super) nodes: NominalNodes,
}

impl BuiltBands {
    /// The drawn lens, adjusted for the film of `job` by `threads` threads.
    ///
    /// # Errors
    /// A lens that loses its light.
    pub(super) fn new(job: &TracingJob<'_>, drawn: &DrawnLens, threads: usize) -> Result<Self> {
        let corner_mm = job.frame.farthest_mm(job.frame.film.rect());
        let compensated = with_threads(threads, || drawn.compensated(corner_mm))?;
        Ok(Self { compensated, errors: drawn.record.clone(), nodes: NominalNodes::default() })
    }

    /// Notes on what was adjusted.
    pub(super) fn notes(&self) -> &[String] {
        &self.compensated.notes
    }

    /// `attributes` with its errors and with what was adjusted.
    pub(super) fn record(&self, attributes: PackAttributes) -> PackAttributes {
        recorded(attributes, self.errors.clone(), &self.compensated)
    }
}

/// `attributes` of a pack of a lens with `errors`, and with what was adjusted.
pub fn recorded(attributes: PackAttributes, errors: Value, adjusted: &Compensated) -> PackAttributes {
    let compensators = json!({
        "film_shift_mm": adjusted.film_shift_mm,
        "film_tilt_rad": adjusted.film_tilt_rad,
        "boresight_mm": adjusted.boresight_mm,
    });
    PackAttributes {
        reference_point: Some(ReferencePoint::ChiefRay),
        errors: Some(errors),
        compensators: Some(compensators),
        ..attributes
    }
}

/// The rectangle of the map of a film that `half_mm` (X, Y) are half the sides of: as much wider on all sides as its corners stay within `reach_mm`.
pub fn map_range([x, y]: [f64; 2], reach_mm: f64) -> FilmRange {
    // (x + m)² + (y + m)² = reach²
    let sum = x + y;
    let root2 = (sum * sum - 2.0 * (x * x + y * y - reach_mm * reach_mm)).max(0.0);
    let margin = 0.5 * (root2.sqrt() - sum);
    FilmRange::centred([x + margin, y + margin])
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::real;

    #[test]
    fn maps_have_the_margin_of_the_reach_on_all_sides() {
        for (half, reach) in [([18.0, 12.0], 22.0), ([3.0, 3.0], 4.3), ([0.0, 5.0], 5.5)] {
            let FilmRange { x_mm: [_, x], y_mm: [_, y] } = map_range(half, reach);
            assert!((real::hypot(x, y) - reach).abs() < 1e-12);
            let margin = x - half[0];
            assert!((y - half[1] - margin).abs() < 1e-12);
            // Half a window, of half the diagonal that the reach has beyond the corner.
            assert!(margin > (reach - real::hypot(half[0], half[1])) / std::f64::consts::SQRT_2 - 1e-12);
        }
        // A reach of the film's corner: no margin.
        assert!((map_range([3.0, 4.0], 5.0).x_mm[1] - 3.0).abs() < 1e-12);
    }
}
