//! What one measurement found.

use super::plane::Name;
use super::quality::Remark;
use serde_json::Value;

/// Measurement of one band, or of a plane of a raw.
pub struct Measurement {
    /// What was measured.
    pub name: Name,
    /// Figures by name.
    pub figures: Value,
    /// Figures in words.
    pub summary: String,
    /// What makes them doubtful.
    pub remarks: Vec<Remark>,
    /// Curve or points.
    pub curve: Vec<(f64, f64)>,
    /// Frequency in cycles per pixel, and modulation.
    pub mtf: Vec<(f64, f64)>,
}
