//! Attributes of an array (Zarr, HDF5, or beside a `.npy` file) that define its values (CF conventions 1.11, as written by xarray and netCDF).
//!
//! | attribute | meaning here |
//! |---|---|
//! | `scale_factor`, `add_offset` | value = raw · scale_factor + add_offset |
//! | `_FillValue`, `missing_value` | raw samples that stand for no data |
//! | `valid_range`, `valid_min`, `valid_max` | raw samples outside this range stand for no data |
//! | `_Unsigned` | an error unless it agrees with the sample type |
//!
//! xarray writes the `_FillValue` of floats in Zarr v3 as base64 of 8 little-endian bytes, and in Zarr v2 as the array's `fill_value`: a
//! v2 fill value other than 0 counts if the array has xarray's attribute `_ARRAY_DIMENSIONS`. An attribute that cannot be parsed is an
//! error, since wrong values look like right ones.

use base64::Engine;
use serde_json::{Map, Value};

use super::values::Values;
use crate::sample::{RasterSample, Sample};

/// An attribute, its expected and its found value.
pub(super) type AttributeError = (&'static str, &'static str, String);

/// The conversion of samples of an array with `attributes`; `fill` is the fill value of an array that xarray wrote in Zarr v2.
pub(super) fn parse_values(
    attributes: &Map<String, Value>,
    sample: RasterSample,
    fill: Option<f64>,
) -> Result<Values, AttributeError> {
    check_unsigned(attributes, sample)?;
    let mut values = Values::default();
    for key in ["_FillValue", "missing_value"] {
        let Some(v) = attributes.get(key).filter(|v| !v.is_null()) else { continue };
        let list = if let Value::Array(list) = v { list.as_slice() } else { std::slice::from_ref(v) };
        if list.is_empty() {
            return Err((key, "a number", "an empty list".into()));
        }
        for v in list {
            let raw = number(v).or_else(|| base64_f64(v)).ok_or((key, "a number", v.to_string()))?;
            values.no_data.push(sample.nearest(raw));
        }
    }
    values.no_data.extend(fill.map(|v| sample.nearest(v)));
    // NaN is no data in any case.
    values.no_data.retain(|v| v.is_finite());
    values.no_data.sort_by(f64::total_cmp);
    values.no_data.dedup();
    if let Some(v) = attributes.get("valid_range") {
        let pair = v.as_array().map(Vec::as_slice).and_then(|list| match list {
            [low, high] => number(low).zip(number(high)),
            _ => None,
        });
        values.valid = pair.ok_or(("valid_range", "two numbers", v.to_string()))?;
    }
    let limit = |key, default| match attributes.get(key) {
        None => Ok(default),
        Some(v) => number(v).ok_or((key, "a number", v.to_string())),
    };
    values.valid = (limit("valid_min", values.valid.0)?, limit("valid_max", values.valid.1)?);
    if values.valid.0.is_nan() || values.valid.1.is_nan() || values.valid.0 > values.valid.1 {
        return Err((
            "valid_range",
            "a minimum and a maximum",
            format!("{} to {}", values.valid.0, values.valid.1),
        ));
    }
    let (scale, offset) = (factor(attributes, "scale_factor")?, factor(attributes, "add_offset")?);
    if scale == Some(0.0) {
        return Err(("scale_factor", "a number other than 0", "0".into()));
    }
    let scaling = (scale.unwrap_or(1.0), offset.unwrap_or(0.0));
    if scaling != (1.0, 0.0) {
        values.scaling = vec![scaling];
    }
    Ok(values)
}

/// Numbers of a coordinate with `attributes` that is stored as `raw`, times `factor`. Packed ones are rounded to 10⁻⁶.
pub(super) fn coordinate(
    attributes: &Map<String, Value>,
    raw: Vec<f64>,
    factor: f64,
) -> Result<Vec<f64>, AttributeError> {
    let values = parse_values(attributes, RasterSample::Plain(Sample::F64), None)?;
    if let Some(missing) = raw.iter().find(|v| values.is_no_data(**v)) {
        return Err((
            "coordinate",
            "numbers other than its fill value and within its valid range",
            missing.to_string(),
        ));
    }
    Ok(match values.scaling.first() {
        None => raw.into_iter().map(|v| v * factor).collect(),
        // 4505 · 0.1 is 450.5, not 450.50000000000006.
        Some((scale, offset)) => {
            raw.into_iter().map(|v| ((v * scale + offset) * factor * 1e6).round() / 1e6).collect()
        }
    })
}

fn factor(attributes: &Map<String, Value>, key: &'static str) -> Result<Option<f64>, AttributeError> {
    let Some(v) = attributes.get(key) else { return Ok(None) };
    let one = if let Value::Array(list) = v { list.first().filter(|_| list.len() == 1) } else { Some(v) };
    let number = one.and_then(number).filter(|n| n.is_finite());
    number.map(Some).ok_or((key, "one finite number", v.to_string()))
}

/// Supported samples are unsigned integers or floats; an attribute that contradicts the type implies other values.
fn check_unsigned(attributes: &Map<String, Value>, sample: RasterSample) -> Result<(), AttributeError> {
    let Some(v) = attributes.get("_Unsigned") else { return Ok(()) };
    let unsigned = match v {
        Value::Bool(b) => Some(*b),
        Value::String(s) if s.eq_ignore_ascii_case("true") => Some(true),
        Value::String(s) if s.eq_ignore_ascii_case("false") => Some(false),
        _ => None,
    };
    match (unsigned, sample) {
        (Some(true), RasterSample::Plain(Sample::U8 | Sample::U16)) => Ok(()),
        (Some(false), RasterSample::I16 | RasterSample::Plain(Sample::F16 | Sample::F32 | Sample::F64)) => {
            Ok(())
        }
        _ => Err((
            "_Unsigned",
            "the signedness of the sample type; store the array in its actual type",
            v.to_string(),
        )),
    }
}

/// A JSON number, or one of the strings for numbers that JSON lacks.
fn number(v: &Value) -> Option<f64> {
    match v {
        Value::Number(n) => n.as_f64(),
        Value::String(s) => match s.as_str() {
            "NaN" => Some(f64::NAN),
            "Infinity" => Some(f64::INFINITY),
            "-Infinity" => Some(f64::NEG_INFINITY),
            _ => None,
        },
        _ => None,
    }
}

/// A little-endian f64 in base64.
fn base64_f64(v: &Value) -> Option<f64> {
    let bytes = base64::engine::general_purpose::STANDARD.decode(v.as_str()?).ok()?;
    Some(f64::from_le_bytes(bytes.try_into().ok()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn parse(attributes: Value, sample: Sample) -> Result<Values, AttributeError> {
        parse_values(attributes.as_object().unwrap(), RasterSample::Plain(sample), None)
    }

    #[test]
    fn attributes_of_packed_samples_give_scaling_fill_values_and_range() {
        let packed = json!({
            "scale_factor": 0.0001, "add_offset": [0.5], "_FillValue": 65535, "missing_value": [0, 65534], "_Unsigned": "true",
            "valid_min": 1, "valid_max": 10000
        });
        let values = parse(packed, Sample::U16).unwrap();
        assert_eq!(values.scaling, [(0.0001, 0.5)]);
        assert_eq!(values.no_data, [0.0, 65534.0, 65535.0]);
        assert_eq!(values.valid, (1.0, 10000.0));
        assert!(
            parse(json!({"units": "reflectance", "scale_factor": 1, "add_offset": 0.0}), Sample::F32)
                .unwrap()
                .is_identity()
        );
    }

    #[test]
    fn float_fill_values_are_rounded_to_the_sample_type() {
        // numpy.float32(9.969209968386869e36), as a number and as xarray writes it in Zarr v3.
        let stored = f64::from(9.969_21e36f32);
        let base64 = base64::engine::general_purpose::STANDARD.encode(stored.to_le_bytes());
        for fill in [json!(9.969_209_968_386_869e36), json!(base64)] {
            assert_eq!(parse(json!({"_FillValue": fill}), Sample::F32).unwrap().no_data, [stored]);
        }
        for nan in [json!("NaN"), json!("AAAAAAAA+H8="), json!(null)] {
            assert!(
                parse(json!({"_FillValue": nan}), Sample::F32).unwrap().is_identity(),
                "NaN is no data in any case"
            );
        }
        // 0.1 is not a half-precision number.
        let half = parse(json!({"_FillValue": 0.1}), Sample::F16).unwrap();
        assert_eq!(half.no_data, [f64::from(half::f16::from_f64(0.1))]);
    }

    #[test]
    fn invalid_attribute_is_an_error_that_names_it() {
        for (key, value, sample) in [
            ("scale_factor", json!("0.1"), Sample::U16),
            ("scale_factor", json!(0), Sample::U16),
            ("scale_factor", json!([1, 2]), Sample::U16),
            ("add_offset", json!(null), Sample::U16),
            ("_FillValue", json!({"a": 1}), Sample::F32),
            ("_FillValue", json!("none"), Sample::F32),
            ("_FillValue", json!([]), Sample::F32),
            ("missing_value", json!([1, "x"]), Sample::F32),
            ("valid_range", json!([1]), Sample::F32),
            ("valid_range", json!([2, 1]), Sample::F32),
            ("valid_min", json!("low"), Sample::F32),
            ("_Unsigned", json!("false"), Sample::U8),
            ("_Unsigned", json!("true"), Sample::F32),
            ("_Unsigned", json!(1), Sample::U8),
        ] {
            let (named, _, found) = parse(json!({key: value}), sample).unwrap_err();
            assert_eq!(named, key, "{found}");
        }
    }
}
