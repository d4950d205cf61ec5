//! What a pack records of a lens as built, and the rectangle of the map of a lens without rotational symmetry.
//!
//! PSF nodes of a lens as built reach as far as those of the nominal lens; the map covers the film with the same margin on all sides, as wide as its corners stay within that
//! reach.

use formats::lens::{PackAttributes, ReferencePoint};
use pipeline::design::skew::map::FilmRange;
use pipeline::design::tolerance::Compensated;
use serde_json::{Value, json};

/// `attributes` of a pack of a lens with `errors`, and with what was adjusted.
pub fn recorded(attributes: PackAttributes, errors: Value, adjusted: &Compensated) -> PackAttributes {
    let Compensated { film_shift_mm, film_tilt_rad, boresight_mm, .. } = adjusted;
    PackAttributes {
        reference_point: Some(ReferencePoint::ChiefRay),
        errors: Some(errors),
        compensators: Some(compensators(*film_shift_mm, *film_tilt_rad, *boresight_mm)),
        ..attributes
    }
}

/// What was adjusted, as recorded.
fn compensators(film_shift_mm: f64, film_tilt_rad: [f64; 2], boresight_mm: [f64; 2]) -> Value {
    json!({ "film_shift_mm": film_shift_mm, "film_tilt_rad": film_tilt_rad, "boresight_mm": boresight_mm })
}

/// Record of a film that stays in its place.
pub fn unmoved() -> Value {
    compensators(0.0, [0.0; 2], [0.0; 2])
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
