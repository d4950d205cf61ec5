//! Statistics of a number over the lenses of a batch.
//!
//! Percentiles by nearest rank: percentile p of n values is the value of rank ⌈p n/100⌉ in ascending order (rank 1 for p = 0),
//! hence always that of an actual lens. Of equal values the earlier lens comes first. The deviation is that of the sample, with
//! n − 1 in the denominator. Lenses without a value (failed ones) have no rank, and pass no limit.

/// The percentiles of summaries.
pub const PERCENTILES: [u32; 9] = [1, 5, 10, 25, 50, 75, 90, 95, 99];

/// Which values are good.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Better {
    /// The greater, as of an MTF.
    Greater,
    /// The less, as of a spot's radius.
    Less,
}

/// A number over the lenses that have it.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Number of lenses with a value.
    pub count: usize,
    /// Mean.
    pub mean: f64,
    /// Deviation of the sample; 0 of one value.
    pub deviation: f64,
    /// Least value.
    pub least: f64,
    /// Greatest value.
    pub greatest: f64,
    /// Values at [`PERCENTILES`].
    pub percentiles: [f64; 9],
}

/// Indices of the lenses with a value, in ascending order of it.
fn ranked(values: &[Option<f64>]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..values.len()).filter(|&i| values[i].is_some()).collect();
    order.sort_by(|&a, &b| values[a].unwrap_or(0.0).total_cmp(&values[b].unwrap_or(0.0)));
    order
}

/// Index in `values` of the lens at `percent` (0 to 100) in ascending order; none if none has a value.
pub fn lens_at(values: &[Option<f64>], percent: u32) -> Option<usize> {
    let order = ranked(values);
    let rank = (percent as usize * order.len()).div_ceil(100).max(1);
    order.get(rank - 1).copied()
}

/// The statistics of `values`; none if no lens has one.
pub fn summary(values: &[Option<f64>]) -> Option<Summary> {
    let sorted: Vec<f64> = ranked(values).into_iter().filter_map(|i| values[i]).collect();
    let (least, greatest) = (*sorted.first()?, *sorted.last()?);
    let count = sorted.len();
    let mean = sorted.iter().sum::<f64>() / count as f64;
    let squares: f64 = sorted.iter().map(|v| (v - mean) * (v - mean)).sum();
    let deviation = if count > 1 { (squares / (count - 1) as f64).sqrt() } else { 0.0 };
    let at = |percent: u32| sorted[(percent as usize * count).div_ceil(100).max(1) - 1];
    Some(Summary { count, mean, deviation, least, greatest, percentiles: PERCENTILES.map(at) })
}

/// Share of all lenses whose value is as good as `limit` or better; 0 of no lenses.
pub fn yield_at(values: &[Option<f64>], limit: f64, better: Better) -> f64 {
    let passes = |v: &f64| match better {
        Better::Greater => *v >= limit,
        Better::Less => *v <= limit,
    };
    let passed = values.iter().flatten().filter(|v| passes(v)).count();
    passed as f64 / values.len().max(1) as f64
}

/// The deviation that all errors together are estimated to cause, from the changes that each alone causes at its two limits: the
/// root of the sum of their mean squares.
pub fn root_sum_square(changes: &[[f64; 2]]) -> f64 {
    changes.iter().map(|[low, high]| (low * low + high * high) / 2.0).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of nearest rank: of 15, 20, 35, 40, 50 the percentiles 5, 30, 40, 50, 100 are 15, 20, 20, 35, 50.
    #[test]
    fn percentiles_are_by_nearest_rank() {
        let values = [35.0, 20.0, 15.0, 50.0, 40.0].map(Some);
        let found = [5, 30, 40, 50, 100].map(|p| lens_at(&values, p).unwrap());
        assert_eq!(found, [2, 1, 1, 0, 3]);
        assert_eq!(lens_at(&values, 0), Some(2));
        assert_eq!(lens_at(&[None, None], 50), None);
    }

    /// Of 1 to 1000 in another order: percentile p is 10 p, the mean 500.5, the deviation √(n (n + 1)/12).
    #[test]
    fn summary_of_whole_numbers() {
        let values: Vec<Option<f64>> = (0..1000).map(|k| Some(f64::from(k * 37 % 1000 + 1))).collect();
        let s = summary(&values).unwrap();
        assert_eq!(s.percentiles, PERCENTILES.map(|p| f64::from(10 * p)));
        assert_eq!((s.count, s.mean, s.least, s.greatest), (1000, 500.5, 1.0, 1000.0));
        assert!((s.deviation - (1000.0_f64 * 1001.0 / 12.0).sqrt()).abs() < 1e-9, "{}", s.deviation);
        assert_eq!(yield_at(&values, 301.0, Better::Greater), 0.7);
        assert_eq!(yield_at(&values, 300.0, Better::Less), 0.3);
    }

    #[test]
    fn failed_lenses_pass_nothing_and_have_no_rank() {
        let values = [Some(1.0), None, Some(3.0), None];
        let s = summary(&values).unwrap();
        assert_eq!((s.count, s.mean, s.percentiles[4]), (2, 2.0, 1.0));
        assert!((s.deviation - 2.0_f64.sqrt()).abs() < 1e-15);
        assert_eq!(yield_at(&values, 0.0, Better::Greater), 0.5);
        assert_eq!(summary(&[None]), None);
        assert_eq!(summary(&[Some(7.0)]).unwrap().deviation, 0.0);
        assert_eq!(yield_at(&[], 0.0, Better::Greater), 0.0);
    }

    #[test]
    fn equal_values_keep_the_order_of_lenses() {
        let values = [Some(2.0), Some(1.0), Some(2.0), Some(2.0)];
        assert_eq!([25, 50, 75, 100].map(|p| lens_at(&values, p).unwrap()), [1, 0, 2, 3]);
    }

    /// 3-4-5: two errors of equal changes at both limits.
    #[test]
    fn independent_changes_add_as_squares() {
        assert_eq!(root_sum_square(&[[3.0, -3.0], [4.0, -4.0]]), 5.0);
        assert_eq!(root_sum_square(&[[0.0, 2.0]]), 2.0_f64.sqrt());
    }
}
