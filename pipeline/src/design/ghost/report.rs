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

/// A ghost path in numbers, as a lens pack has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathFigures {
    /// Numbers of the surfaces that reflect, in the order of the light, counted from 1; 0: the film.
    pub surfaces: [usize; 2],
    /// Light from the axis, over that of the image there.
    pub axis_share: f64,
    /// Light from half of the film's corner, over that of the image on the axis.
    pub half_share: f64,
    /// Diameter of an even disc of the spread of the light from the axis, mm.
    pub diameter_mm: f64,
    /// x on the film per height in the entrance pupil, first order.
    pub height_per_pupil: f64,
    /// x on the film per tangent of the field angle, first order, mm.
    pub height_per_tan: f64,
    /// Whether the operator has it.
    pub is_kept: bool,
}

impl PathFigures {
    /// Numbers of a path.
    pub const NUMBERS: usize = 8;

    /// Share from the axis per area of the disc, 1/mm²; infinite of a point.
    pub fn density(&self) -> f64 {
        self.axis_share / (0.25 * std::f64::consts::PI * self.diameter_mm * self.diameter_mm)
    }

    /// Its numbers, in the order of the fields.
    pub fn numbers(&self) -> [f64; Self::NUMBERS] {
        let [first, second] = self.surfaces.map(|k| k as f64);
        let Self { axis_share, half_share, diameter_mm, height_per_pupil, height_per_tan, is_kept, .. } =
            *self;
        let kept = f64::from(u8::from(is_kept));
        [first, second, axis_share, half_share, diameter_mm, height_per_pupil, height_per_tan, kept]
    }

    /// The path of [`PathFigures::numbers`]; none of numbers that no path has.
    pub fn of_numbers(numbers: [f64; Self::NUMBERS]) -> Option<Self> {
        /// Surfaces of a lens at most.
        const SURFACES: f64 = 1e5;
        let [first, second, axis_share, half_share, diameter_mm, height_per_pupil, height_per_tan, kept] =
            numbers;
        let is_surface = |v: f64| v.fract() == 0.0 && (0.0..SURFACES).contains(&v);
        let is_size = |v: f64| v.is_finite() && v >= 0.0;
        let is_valid = is_surface(first)
            && is_surface(second)
            && [axis_share, half_share, diameter_mm].into_iter().all(is_size)
            && height_per_pupil.is_finite()
            && height_per_tan.is_finite()
            && [0.0, 1.0].contains(&kept);
        is_valid.then_some(Self {
            surfaces: [first as usize, second as usize],
            axis_share,
            half_share,
            diameter_mm,
            height_per_pupil,
            height_per_tan,
            is_kept: kept == 1.0,
        })
    }
}

impl PathReport {
    /// In numbers, of a lens whose film is surface `film`, from 0.
    pub fn figures(&self, film: usize) -> PathFigures {
        PathFigures {
            surfaces: [self.path.first, self.path.second].map(|k| if k == film { 0 } else { k + 1 }),
            axis_share: self.axis.share,
            half_share: self.half.share,
            diameter_mm: self.axis.diameter_mm(),
            height_per_pupil: self.first_order.height_per_pupil,
            height_per_tan: self.first_order.height_per_tan,
            is_kept: self.is_kept,
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_a_path_give_it_back_and_wrong_ones_none() {
        let path = PathFigures {
            surfaces: [0, 7],
            axis_share: 2.5e-3,
            half_share: 1e-3,
            diameter_mm: 0.8,
            height_per_pupil: -0.01,
            height_per_tan: 40.0,
            is_kept: true,
        };
        assert_eq!(PathFigures::of_numbers(path.numbers()), Some(path));
        assert!((path.density() * std::f64::consts::PI * 0.16 - 2.5e-3).abs() < 1e-15);
        for (k, wrong) in
            [(0, 1.5), (1, -1.0), (2, f64::NAN), (3, -1e-9), (4, f64::INFINITY), (6, f64::NAN), (7, 0.5)]
        {
            let mut numbers = path.numbers();
            numbers[k] = wrong;
            assert_eq!(PathFigures::of_numbers(numbers), None, "{k}: {wrong}");
        }
    }
}
