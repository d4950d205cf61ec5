//! Attributes of HDF5 as JSON, as those of Zarr are.

use std::collections::HashMap;

use hdf5_pure::AttrValue;
use serde_json::{Map, Value, json};

/// The attributes that are numbers or text; a list of one is its element.
pub(super) fn to_json(attributes: &HashMap<String, AttrValue>) -> Map<String, Value> {
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
