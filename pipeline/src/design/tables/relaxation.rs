//! By how much the errors of nodes exceed their parts of the tolerance where the budget does not allow the tolerance.
//!
//! An error in r of e_r needs heights ∝ 1/√e_r, one in θ azimuths ∝ 1/√e_θ, and of all nodes with the same sum e_r + e_θ those with e_r = e_θ are fewest: both parts grow by a
//! common factor. Where the limit of the heights is reached first, by the samples of their PSFs or the PSFs that are traced, nodes are left over: e_r is what the heights
//! allow, and e_θ may be smaller. At a quarter, with twice the azimuths, the sum is 0.63 times as large and a film takes 1.3 to 1.4 times as long; beyond that the
//! time grows faster than the error falls.

use super::refine::Fit;

/// Largest ratio of the two factors.
const MAX_RATIO: f64 = 4.0;
/// Step of a factor, and the largest that is tried.
const STEP: f64 = 1.1;
const MAX: f64 = 1e4;

/// Factor of the tolerance of edges ([`super::difference`]) where that of the L1 has `factor`: 1 up to `kept_up_to`; infinite, no tolerance, if that is 0.
pub(super) fn relaxed_esf(factor: f64, kept_up_to: f64) -> f64 {
    (factor / kept_up_to).max(1.0)
}

/// Factors of the parts of the tolerance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Relaxation {
    /// Of the error in r.
    pub(super) radial: f64,
    /// Of the error in θ.
    pub(super) angular: f64,
}

impl Relaxation {
    /// The least common factor, of those from `from` on, at which nodes fit; if it is the heights that need it, the least factor of the error in θ, of those within [`MAX_RATIO`], at which nodes fit.
    pub(super) fn least(from: f64, fits: impl Fn(f64, f64) -> Fit) -> Self {
        let (mut both, mut is_by_heights) = (from, false);
        loop {
            let fit = fits(both, both);
            if (fit.heights && fit.nodes) || both > MAX {
                break;
            }
            is_by_heights = fit.nodes;
            both *= STEP;
        }
        let mut angular = if is_by_heights { (both / MAX_RATIO).max(1.0) } else { both };
        while angular < both && !fits(both, angular).nodes {
            angular *= STEP;
        }
        Self { radial: both, angular: angular.min(both) }
    }

    /// Factor of their sum.
    pub(super) fn mean(self) -> f64 {
        0.5 * (self.radial + self.angular)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Limits of heights and nodes of a lens that needs 50 heights and 10,000 nodes.
    fn least(heights: f64, nodes: f64) -> Relaxation {
        Relaxation::least(1.0, |radial, angular| Fit {
            heights: 50.0 / radial.sqrt() <= heights,
            nodes: 1e4 / (radial * angular).sqrt() <= nodes,
        })
    }

    #[test]
    fn both_errors_grow_alike_where_the_nodes_are_limited() {
        assert_eq!(least(60.0, 2e4), Relaxation { radial: 1.0, angular: 1.0 });
        let Relaxation { radial, angular } = least(60.0, 2500.0);
        assert!(radial == angular && (4.0..4.5).contains(&radial), "{radial}");
    }

    #[test]
    fn azimuths_use_the_nodes_that_limited_heights_leave() {
        // Nodes for a quarter of the error.
        let many = least(12.5, 1e4);
        assert!((16.0..17.7).contains(&many.radial) && many.angular == many.radial / MAX_RATIO);
        assert_eq!(many.mean(), 0.625 * many.radial);
        // Not for all of it: 1,000 nodes, of which heights and equal errors need 625.
        let some = least(12.5, 1000.0);
        assert_eq!(some.radial, many.radial);
        let nodes = 1e4 / (some.radial * some.angular).sqrt();
        assert!(nodes <= 1000.0 && nodes * STEP.sqrt() > 1000.0 && some.angular < some.radial, "{some:?}");
    }

    #[test]
    fn edges_keep_their_tolerance_up_to_the_excess_of_the_l1() {
        let at = |kept_up_to| [1.0, 1.5, 2.0, 3.0].map(|factor| relaxed_esf(factor, kept_up_to));
        assert_eq!(at(2.0), [1.0, 1.0, 1.0, 1.5]);
        assert_eq!(at(1.0), [1.0, 1.5, 2.0, 3.0], "both alike");
        assert_eq!(at(0.0), [f64::INFINITY; 4], "none");
    }

    #[test]
    fn a_part_of_the_tolerance_is_never_below_it() {
        let relaxed = least(40.0, 1e6);
        assert!(relaxed.radial > 1.5 && relaxed.angular == 1.0, "{relaxed:?}");
    }
}
