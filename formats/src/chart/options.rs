//! Options of opening a chart.

use super::axes::AxisOrder;

/// Treatment of NaN, infinity and declared fill values in a chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum NanPolicy {
    /// An error that names band, row and column.
    #[default]
    Error,
    /// Read as 0, and counted.
    Zero,
    /// Read unchanged: for display of incomplete films.
    Keep,
}

/// Options of opening a chart.
#[derive(Clone, Debug)]
pub struct ChartOptions {
    /// Maximum bytes of decoded pixels in the cache. Each reading thread holds one chunk in addition.
    pub cache_bytes: usize,
    /// Treatment of NaN and infinity.
    pub nan: NanPolicy,
    /// Wavelengths in nm, one per band, instead of those in the store.
    pub wavelengths_nm: Option<Vec<f64>>,
    /// Order of the axes, instead of the one that the names of dimensions imply.
    pub axes: Option<AxisOrder>,
    /// Factor of all values, besides scale and offset of the file; not 0.
    pub scale: f64,
}

impl Default for ChartOptions {
    fn default() -> Self {
        Self { cache_bytes: 256 << 20, nan: NanPolicy::Error, wavelengths_nm: None, axes: None, scale: 1.0 }
    }
}
