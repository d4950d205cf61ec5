//! Tables over wavelength.

/// A table over wavelength, linear between its nodes, 0 outside.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Curve {
    /// Nodes, ascending, nm.
    pub wavelengths_nm: Vec<f64>,
    /// Values at the nodes.
    pub values: Vec<f64>,
}

impl Curve {
    /// The value at a wavelength.
    pub fn at(&self, nm: f64) -> f64 {
        let (x, y) = (&self.wavelengths_nm, &self.values);
        let (Some(&first), Some(&last)) = (x.first(), x.last()) else { return 0.0 };
        if !(nm >= first && nm <= last) {
            return 0.0;
        }
        let i = x.partition_point(|v| *v <= nm);
        if i == x.len() {
            return y[i - 1];
        }
        y[i - 1] + (y[i] - y[i - 1]) / (x[i] - x[i - 1]) * (nm - x[i - 1])
    }

    /// First and last wavelength, nm.
    pub fn range_nm(&self) -> (f64, f64) {
        let end = |v: Option<&f64>| v.copied().unwrap_or(0.0);
        (end(self.wavelengths_nm.first()), end(self.wavelengths_nm.last()))
    }
}
