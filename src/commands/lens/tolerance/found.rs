//! What is computed of a batch of lenses.

use super::rows::Row;
use super::sensitivity::Sensitivity;
use super::summary::Summary;

/// What is computed.
pub struct Found {
    /// By sample, from 0.
    pub rows: Vec<Row>,
    /// The nominal lens.
    pub nominal: Row,
    /// Each error alone, the strongest first.
    pub sensitivity: Option<Sensitivity>,
    /// Places of the criterion, mm.
    pub places: Vec<[f64; 2]>,
    pub summary: Summary,
}
