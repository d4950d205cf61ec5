//! Shares of the ghost paths of a band, and which of them its operator leaves out.
//!
//! Paths with next to no light are left out of a band: the weakest, as long as they have together less than 10⁻⁴ of the light of all from the axis, from half of the corner and from the
//! corner, and each a density below 1 % of the largest.

use super::first_order::FirstOrder;
use super::path::GhostPath;
use super::share::PathLight;

/// Share of the light that paths may have together that are left out.
const LEFT_OUT: f64 = 1e-4;
/// Density of such a path over the largest.
const FAINT: f64 = 0.01;

/// A path in the operator of a band.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathReport {
    /// The path.
    pub path: GhostPath,
    /// Its light from the axis.
    pub axis: PathLight,
    /// From half of the film's corner.
    pub half: PathLight,
    /// From the film's corner.
    pub corner: PathLight,
    /// First-order figures.
    pub first_order: FirstOrder,
    /// Whether the operator has it.
    pub is_kept: bool,
}

/// Sorts `paths` by their share on the axis, the largest first.
pub(super) fn sort(paths: &mut [PathReport]) {
    paths.sort_by(|a, b| b.axis.share.total_cmp(&a.axis.share));
}

/// Leaves out the weakest paths of a band.
pub(super) fn leave_out(paths: &mut [PathReport]) {
    let fields = |p: &PathReport| [p.axis, p.half, p.corner];
    let sum = |field: usize| paths.iter().map(|p| fields(p)[field].share).sum::<f64>();
    let all = [0, 1, 2].map(sum);
    let densities =
        paths.iter().flat_map(fields).filter(|light| light.share > 0.0).map(|light| light.density());
    let densest = densities.filter(|d| d.is_finite()).fold(0.0, f64::max);
    // A point has no finite density.
    let is_faint = |light: PathLight| light.share == 0.0 || light.density() < FAINT * densest;
    let part = |p: &PathReport| {
        std::iter::zip(fields(p), all)
            .map(|(light, all)| light.share / all.max(f64::MIN_POSITIVE))
            .fold(0.0, f64::max)
    };
    let mut order: Vec<usize> = (0..paths.len()).collect();
    order.sort_by(|a, b| part(&paths[*a]).total_cmp(&part(&paths[*b])));
    let mut left_out = [0.0; 3];
    for k in order {
        let lights = fields(&paths[k]);
        let with = [0, 1, 2].map(|field| left_out[field] + lights[field].share);
        if std::iter::zip(with, all).any(|(with, all)| with > LEFT_OUT * all) {
            break;
        }
        if lights.into_iter().all(is_faint) {
            left_out = with;
            paths[k].is_kept = false;
        }
    }
}
