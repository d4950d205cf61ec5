//! Attributes of HDF5 as JSON, as those of Zarr are.

use std::collections::HashMap;
use std::path::Path;

use hdf5_pure::{AttrValue, Dataset};
use serde_json::{Map, Value, json};

use super::super::error::ChartError;
use super::super::header::header_error;
use super::guard::guarded;
use super::sample_type;

/// Attributes of which the values of samples depend.
const CONVERSION: [&str; 8] = [
    "_FillValue",
    "missing_value",
    "valid_range",
    "valid_min",
    "valid_max",
    "scale_factor",
    "add_offset",
    "_Unsigned",
];

/// The attributes of `dataset`, called `name`, that are numbers or text; a list of one is its element.
///
/// # Errors
/// One that the values of samples depend on is of another type.
pub(super) fn read(path: &Path, name: &str, dataset: &Dataset) -> Result<Map<String, Value>, ChartError> {
    let attributes = guarded(path, || dataset.attrs())?;
    let json = to_json(&attributes);
    let types = guarded(path, || dataset.attr_datatypes())?;
    match CONVERSION.iter().find(|key| types.contains_key(**key) && !json.contains_key(**key)) {
        None => Ok(json),
        Some(key) => {
            let expected = "a number of up to 64 bits (of floats, 32 or 64) or text; write it as f64";
            let found = format!("{} in {name}", sample_type::describe(&types[*key]));
            Err(header_error(path, key, expected, found))
        }
    }
}

fn to_json(attributes: &HashMap<String, AttrValue>) -> Map<String, Value> {
    let converted = attributes.iter().filter_map(|(key, value)| Some((key.clone(), one(value)?)));
    converted.collect()
}

fn one(value: &AttrValue) -> Option<Value> {
    if let Some(texts) = value.as_strings() {
        return Some(collapsed(texts.iter().map(|t| json!(t)).collect()));
    }
    Some(collapsed(numbers(value)?.into_iter().map(number).collect()))
}

fn collapsed(mut list: Vec<Value>) -> Value {
    match (list.len(), list.pop()) {
        (1, Some(value)) => value,
        (_, last) => {
            list.extend(last);
            Value::Array(list)
        }
    }
}

/// A number; strings for those that JSON lacks.
fn number(v: f64) -> Value {
    match v {
        v if v.is_nan() => json!("NaN"),
        f64::INFINITY => json!("Infinity"),
        f64::NEG_INFINITY => json!("-Infinity"),
        v => json!(v),
    }
}

/// The numbers of an attribute; `None` if it is not numeric.
pub(super) fn numbers(value: &AttrValue) -> Option<Vec<f64>> {
    use AttrValue as A;
    macro_rules! list {
        ($v:expr) => {
            $v.iter().map(|&x| x as f64).collect()
        };
    }
    Some(match value {
        A::F32(v) => vec![f64::from(*v)],
        A::F64(v) => vec![*v],
        A::I8(v) => vec![f64::from(*v)],
        A::I16(v) => vec![f64::from(*v)],
        A::I32(v) => vec![f64::from(*v)],
        A::I64(v) => vec![*v as f64],
        A::U8(v) => vec![f64::from(*v)],
        A::U16(v) => vec![f64::from(*v)],
        A::U32(v) => vec![f64::from(*v)],
        A::U64(v) => vec![*v as f64],
        A::F32Array(v) => list!(v),
        A::F64Array(v) => list!(v),
        A::I8Array(v) => list!(v),
        A::I16Array(v) => list!(v),
        A::I32Array(v) => list!(v),
        A::I64Array(v) => list!(v),
        A::U8Array(v) => list!(v),
        A::U16Array(v) => list!(v),
        A::U32Array(v) => list!(v),
        A::U64Array(v) => list!(v),
        _ => return None,
    })
}
