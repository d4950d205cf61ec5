//! Values of Optiland's JSON.

use super::json;
use crate::design::error::LensFileError;
use serde_json::Value;

pub(super) fn incomplete(problem: impl Into<String>) -> LensFileError {
    LensFileError::Incomplete { problem: problem.into() }
}

/// A number, possibly infinite, at `pointer`; `missing` if it is absent or null.
pub(super) fn number(value: &Value, pointer: &str, missing: f64) -> Result<f64, LensFileError> {
    match value.pointer(pointer) {
        None | Some(Value::Null) => Ok(missing),
        Some(v) => {
            let v = v.as_f64().ok_or_else(|| incomplete(format!("has no number at `{pointer}`: {v}")))?;
            Ok(if v.abs() >= json::INFINITE { v.signum() * f64::INFINITY } else { v })
        }
    }
}

pub(super) fn text<'a>(value: &'a Value, pointer: &str) -> &'a str {
    value.pointer(pointer).and_then(Value::as_str).unwrap_or_default()
}

pub(super) fn list<'a>(value: &'a Value, pointer: &str) -> &'a [Value] {
    value.pointer(pointer).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

pub(super) fn is_true(value: &Value, pointer: &str) -> bool {
    value.pointer(pointer).and_then(Value::as_bool).unwrap_or(false)
}
