//! Axes of an array: which one is the spectral axis, the rows and the columns of a chart.

use std::fmt::{self, Display, Formatter};
use std::str::FromStr;

use super::interleave::Interleave;

/// Names of the spectral axis.
const SPECTRAL: [&str; 14] = [
    "wavelength",
    "wavelengths",
    "wavelength_nm",
    "wave",
    "wl",
    "band",
    "bands",
    "lambda",
    "channel",
    "channels",
    "c",
    "spectral",
    "spectrum",
    "λ",
];
const ROWS: [&str; 8] = ["y", "row", "rows", "line", "lines", "height", "lat", "latitude"];
const COLUMNS: [&str; 10] =
    ["x", "col", "cols", "column", "columns", "sample", "samples", "width", "lon", "longitude"];
/// Names in messages, by axis of the chart.
const CHART_AXES: [&str; 3] = ["wavelength", "y", "x"];
/// Ratio of both of the first two sides to the last from which they are taken for rows and columns, the last for bands.
const SPATIAL_RATIO: usize = 4;

/// The axis of the chart (0 wavelength, 1 row, 2 column) that each axis of an array holds, slowest first; a permutation, without the
/// wavelength for an array of two axes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AxisOrder(Vec<usize>);

/// A list of axes that is not one of (wavelength, y, x) or (y, x) in some order.
#[derive(Debug, thiserror::Error)]
#[error("`{0}`: expected wavelength, y and x in the order of the array, e.g. y,x,wavelength; or y and x")]
pub struct AxisOrderError(String);

/// The axis that a name implies.
pub(super) fn axis_of(name: &str) -> Option<usize> {
    let name = name.trim().to_lowercase();
    let last = name.rsplit('_').next().unwrap_or(&name);
    [&SPECTRAL[..], &ROWS, &COLUMNS]
        .iter()
        .position(|names| names.contains(&name.as_str()) || names.contains(&last))
}

impl AxisOrder {
    /// (wavelength, y, x), or (y, x).
    pub(super) fn standard(rank: usize) -> Self {
        Self((3usize.saturating_sub(rank)..3).collect())
    }

    pub(super) fn is_standard(&self) -> bool {
        self.0.windows(2).all(|w| w[0] < w[1])
    }

    /// Number of axes.
    pub(super) fn rank(&self) -> usize {
        self.0.len()
    }

    /// The axes of the chart, in the order of the array.
    pub(super) fn axes(&self) -> &[usize] {
        &self.0
    }

    /// The order that names imply; an unknown name stands for the axis at its place in the standard order, or, if the others are known,
    /// for the remaining one. `None` if the names contradict each other.
    pub(super) fn from_names(names: &[String]) -> Option<Self> {
        let standard = Self::standard(names.len());
        let known: Vec<_> = names.iter().map(|n| axis_of(n)).collect();
        if known.iter().zip(&standard.0).all(|(k, s)| k.is_none_or(|k| k == *s)) {
            return Some(standard);
        }
        let missing: Vec<usize> = standard.0.iter().copied().filter(|a| !known.contains(&Some(*a))).collect();
        let unknown = known.iter().filter(|k| k.is_none()).count();
        if unknown > 1 || missing.len() != unknown {
            return None;
        }
        Some(Self(known.into_iter().map(|k| k.unwrap_or_else(|| missing[0])).collect()))
    }

    /// Sides of an array by axis of the chart; 1 for an axis that it lacks.
    pub(super) fn to_chart<T: Copy>(&self, sides: &[T], one: T) -> [T; 3] {
        let mut out = [one; 3];
        self.0.iter().zip(sides).for_each(|(&axis, &side)| out[axis] = side);
        out
    }

    /// Values by axis of the chart in the order of the array.
    pub(super) fn to_array<T: Copy>(&self, of_chart: &[T; 3]) -> Vec<T> {
        self.0.iter().map(|&axis| of_chart[axis]).collect()
    }

    /// The order of the same array in memory if its first axis varies fastest.
    pub(super) fn reversed(&self) -> Self {
        Self(self.0.iter().rev().copied().collect())
    }

    /// Order of the samples of a file whose axes, slowest first, have this order.
    pub(super) fn interleave(&self) -> Interleave {
        match self.0[..] {
            [1, 0, 2] => Interleave::Bil,
            [1, 2, 0] => Interleave::Bip,
            [0, 2, 1] | [2, 1] => Interleave::BandColumnRow,
            [2, 0, 1] => Interleave::ColumnBandRow,
            [2, 1, 0] => Interleave::ColumnRowBand,
            _ => Interleave::Bsq,
        }
    }

    /// What is wrong if an array without names of axes has `sides`: the first two far larger than the last look like rows and columns.
    pub(super) fn spatial_first(sides: &[usize]) -> Option<String> {
        match *sides {
            [a, b, last] if last > 0 && a.min(b) / SPATIAL_RATIO > last => Some(format!(
                "{sides:?}; is it (y, x, wavelength)? Add --axes y,x,wavelength, or --axes wavelength,y,x if it is not"
            )),
            _ => None,
        }
    }
}

impl FromStr for AxisOrder {
    type Err = AxisOrderError;

    fn from_str(list: &str) -> Result<Self, AxisOrderError> {
        let axes: Option<Vec<usize>> = list.split(',').map(axis_of).collect();
        let valid = |axes: &Vec<usize>| {
            let mut sorted = axes.clone();
            sorted.sort_unstable();
            (2..=3).contains(&axes.len()) && sorted == Self::standard(axes.len()).0
        };
        axes.filter(valid).map(Self).ok_or_else(|| AxisOrderError(list.into()))
    }
}

impl Display for AxisOrder {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "({})", self.0.iter().map(|&a| CHART_AXES[a]).collect::<Vec<_>>().join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_give_the_order_or_contradict() {
        let cases: [(&[&str], Option<&[usize]>); 11] = [
            (&["wavelength", "y", "x"], Some(&[0, 1, 2])),
            (&["y", "x", "wavelength"], Some(&[1, 2, 0])),
            (&["x", "y", "band"], Some(&[2, 1, 0])),
            (&["lat", "lon", "wl"], Some(&[1, 2, 0])),
            (&["y", "x", "dim_0"], Some(&[1, 2, 0])),
            (&["a", "b", "c_0"], Some(&[0, 1, 2])),
            (&["x", "y"], Some(&[2, 1])),
            (&["dim_1", "x", "dim_2"], None),
            (&["y", "y", "x"], None),
            (&["y", "wavelength"], None),
            (&["x", "a", "b"], None),
        ];
        for (names, expected) in cases {
            let names: Vec<String> = names.iter().map(|n| (*n).to_owned()).collect();
            let found = AxisOrder::from_names(&names).map(|o| o.0);
            assert_eq!(found.as_deref(), expected, "{names:?}");
        }
    }

    #[test]
    fn list_of_axes_is_a_permutation() {
        assert_eq!("y,x,wavelength".parse::<AxisOrder>().unwrap().0, [1, 2, 0]);
        assert_eq!("x, y".parse::<AxisOrder>().unwrap().0, [2, 1]);
        for wrong in ["", "y", "y,x,y", "y,x,foo", "wavelength,y", "y,x,wavelength,x"] {
            assert!(wrong.parse::<AxisOrder>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn only_two_sides_far_larger_than_the_last_look_like_rows_and_columns() {
        for (sides, spatial) in [
            (&[512, 512, 31][..], true),
            (&[12, 12, 2], true),
            (&[31, 512, 512], false),
            (&[224, 50, 50], false),
            (&[3, 37, 41], false),
            (&[512, 512], false),
        ] {
            assert_eq!(AxisOrder::spatial_first(sides).is_some(), spatial, "{sides:?}");
        }
    }
}
