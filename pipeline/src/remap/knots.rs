//! The field's table as anchors use it: its intervals and the changes of slope between them.

use super::map::ANCHOR_SPACING_PX;
use crate::field::{Field, TableInterval};

/// Position of the anchor in its block, and the distance of the farthest pixel from it, px.
pub(super) const HALF_PX: f64 = (ANCHOR_SPACING_PX / 2) as f64;

/// The steps of the field's table with the slope changes at their ends.
#[derive(Clone, Debug)]
pub(super) struct Knots {
    pub(super) steps: Vec<TableInterval>,
    /// Per step: slope of R, slope changes of h and R at its outer end, the same at its inner end.
    slope_changes: Vec<[f32; 5]>,
    /// Per step: sum of |slope change of h| at both ends.
    pub(super) slope_change_sum: Vec<f64>,
    pub(super) last_px: f64,
    /// Every step is at least half a block wide: no block extends beyond the steps next to its anchor's.
    pub(super) sparse: bool,
}

impl Knots {
    pub(super) fn new(field: &Field) -> Self {
        let steps = field.steps().to_vec();
        let n = steps.len();
        let change = |i: usize| match (1..n).contains(&i) {
            true => (
                steps[i].h_slope - steps[i - 1].h_slope,
                (steps[i].gain_slope - steps[i - 1].gain_slope) as f32,
            ),
            false => (0.0, 0.0),
        };
        Self {
            slope_changes: (0..n)
                .map(|i| {
                    let (outer, inner) = (change(i + 1), change(i));
                    [steps[i].gain_slope as f32, outer.0 as f32, outer.1, inner.0 as f32, inner.1]
                })
                .collect(),
            slope_change_sum: (0..n).map(|i| change(i).0.abs() + change(i + 1).0.abs()).collect(),
            last_px: field.last_px(),
            sparse: steps.iter().all(|step| step.until - step.from >= HALF_PX),
            steps,
        }
    }

    /// Slope of R, then slope changes (of h, of R) at the outer and at the inner end of step `i`.
    #[inline(always)]
    pub(super) fn slope_changes(&self, i: i32) -> &[f32; 5] {
        &self.slope_changes[i as usize]
    }
}

/// A slope change beyond the ends of the anchor's step.
#[derive(Clone, Copy, Debug)]
pub(super) struct SlopeChange {
    /// +1: acts on pixels farther out than `at`; −1: on those nearer.
    pub(super) side: f32,
    /// Radius relative to ρ, px.
    pub(super) at: f32,
    /// Change of slope of h.
    pub(super) h: f32,
    /// Change of slope of R.
    pub(super) gain: f32,
}
