//! Drawn values as rows.

use pipeline::design::tolerance::{Tolerances, Unit};
use serde_json::{Value, json};

/// Names of the columns of values: identifier and unit, `element 7-9/decentre_x [um]`.
pub fn columns(tolerances: &Tolerances) -> Vec<String> {
    let column = |id: &str, unit: Unit| match unit {
        Unit::One => id.to_owned(),
        unit => format!("{id} [{}]", unit.name()),
    };
    tolerances.parameters().iter().map(|p| column(&p.id, p.unit)).collect()
}

/// A lens with these values, one a parameter, for the record of a pack: seed, sample, digest of the description, and each value
/// with its unit.
pub fn record(tolerances: &Tolerances, values: &[f64], seed: u64, sample: u64, digest: &str) -> Value {
    let rows = std::iter::zip(tolerances.parameters(), values)
        .map(|(p, value)| json!({ "id": p.id, "unit": p.unit.name(), "value": value }))
        .collect::<Vec<_>>();
    json!({ "seed": seed, "sample": sample, "description": digest, "values": rows })
}
