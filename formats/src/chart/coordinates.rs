//! Order of the axes, and wavelengths of the bands.

use pipeline::bounds;
use serde_json::Value;
use zarrs::array::{Array, DataType, data_type};

use super::axes::{AxisOrder, axis_of};
use super::conventions;
use super::error::ChartError;
use super::layout::Layout;
use super::node::{Node, open_array};
use crate::bounded::BoundedChain;
use crate::durable::{DurableError, Store};

/// Names of the array's dimensions: `dimension_names` of Zarr v3, or xarray's attribute in v2.
pub(super) fn dimension_names(array: &Array<Store>) -> Option<Vec<String>> {
    if let Some(names) = array.dimension_names() {
        return Some(names.iter().map(|n| n.clone().unwrap_or_default()).collect());
    }
    let names = array.attributes().get("_ARRAY_DIMENSIONS")?.as_array()?;
    Some(names.iter().map(|n| n.as_str().unwrap_or_default().to_owned()).collect())
}

/// Order of the axes of an array of `sides`: `declared` by the caller, else by the names of its dimensions, else (wavelength, y, x).
///
/// # Errors
/// The expected and the found order, if the names contradict it or there are none and the sides make it doubtful.
pub(super) fn axis_order(
    sides: &[usize],
    names: Option<&[String]>,
    declared: Option<&AxisOrder>,
) -> Result<AxisOrder, (String, String)> {
    if let Some(order) = declared {
        return match order.rank() == sides.len() {
            true => Ok(order.clone()),
            false => Err((format!("{} axes, as in --axes {order}", order.rank()), format!("{sides:?}"))),
        };
    }
    if !(2..=3).contains(&sides.len()) {
        // An error of the layout.
        return Ok(AxisOrder::standard(sides.len()));
    }
    let Some(names) = names else {
        return match AxisOrder::spatial_first(sides) {
            None => Ok(AxisOrder::standard(sides.len())),
            Some(found) => Err(("(wavelength, y, x)".into(), found)),
        };
    };
    let order = if names.len() == sides.len() { AxisOrder::from_names(names) } else { None };
    order.ok_or_else(|| {
        let expected = "wavelength, y and x in any order, or y and x; --axes gives the axes of this array";
        (expected.into(), format!("({})", names.join(", ")))
    })
}

/// Wavelengths in nm: those of the caller, else of the coordinate array, else of an attribute.
pub(super) fn wavelengths<'a>(
    layout: &Layout,
    names: Option<&[String]>,
    find: &impl Fn(&str) -> Option<&'a Value>,
    declared: Option<Vec<f64>>,
) -> Result<Option<Vec<f64>>, ChartError> {
    let bands = layout.shape[0];
    let invalid = |expected: String, found: String| ChartError::Metadata {
        path: layout.store.root().into(),
        array: layout.name.clone(),
        what: "wavelengths",
        expected,
        found,
    };
    let found = match declared {
        Some(w) => Some(w),
        None => match coordinate(layout, names)? {
            Some(w) => Some(w),
            None => from_attribute(find),
        },
    };
    if let Some(w) = &found {
        if w.len() != bands {
            return Err(invalid(format!("one for each of {bands} bands"), format!("{}", w.len())));
        }
        if let Err((band, e)) = bounds::WAVELENGTH_NM.check_all(w) {
            return Err(invalid(
                format!("{} each", bounds::WAVELENGTH_NM),
                format!("{} for band {band}", e.found),
            ));
        }
    }
    Ok(found)
}

fn from_attribute<'a>(find: &impl Fn(&str) -> Option<&'a Value>) -> Option<Vec<f64>> {
    ["wavelengths_nm", "wavelength_nm", "wavelengths", "wavelength"]
        .iter()
        .find_map(|key| find(key)?.as_array()?.iter().map(Value::as_f64).collect())
}

/// Wavelengths in nm from the 1-D array beside the chart that has the name of the spectral dimension, or `wavelength`.
fn coordinate(layout: &Layout, names: Option<&[String]>) -> Result<Option<Vec<f64>>, ChartError> {
    // An array of two axes beside a cube, such as a depth, has no wavelengths of its own.
    let is_plane_of_cube = |w: &Vec<f64>| layout.order.rank() == 2 && w.len() != 1;
    Ok(beside(layout, names)?.filter(|w| !is_plane_of_cube(w)))
}

/// The 1-D array of [`coordinate`].
fn beside(layout: &Layout, names: Option<&[String]>) -> Result<Option<Vec<f64>>, ChartError> {
    if layout.name.is_empty() {
        return Ok(None);
    }
    let group = layout.name.rsplit_once('/').map_or(String::new(), |(group, _)| format!("{group}/"));
    let spectral = layout.order.axes().iter().position(|&axis| axis == 0);
    let named = names.zip(spectral).and_then(|(n, k)| n.get(k)).map(String::as_str);
    let named = named.filter(|n| axis_of(n) == Some(0));
    let mut candidates: Vec<&str> = named.into_iter().collect();
    candidates.push("wavelength");
    for name in candidates {
        let name = format!("{group}{name}");
        if !Node::read(&layout.store, &name)?.is_some_and(|n| n.is_array) {
            continue;
        }
        let array = open_array(&layout.store, &name)?;
        // An axis `band` without units may hold names or numbers of bands.
        let unit = array.attributes().get("units").and_then(Value::as_str);
        let is_band_number = axis_of(&name) == Some(0) && (name.ends_with("band") || name.ends_with("bands"));
        if is_band_number && unit.is_none() {
            continue;
        }
        let invalid = |expected: &str, found: String| ChartError::Metadata {
            path: layout.store.root().into(),
            array: name.clone(),
            what: "coordinate",
            expected: expected.into(),
            found,
        };
        let unit = unit.unwrap_or("nm").trim();
        let to_nm = nm_per_unit(unit).ok_or_else(|| invalid("units nm, um or m", format!("{unit:?}")))?;
        let values = numbers(&layout.store, &array).map_err(|(found, store)| match store {
            Some(e) => e.into(),
            None => invalid("a 1-D array of at most 10^6 numbers", found),
        })?;
        let nm = conventions::coordinate(array.attributes(), values, to_nm)
            .map_err(|(what, expected, found)| invalid(&format!("{what}: {expected}"), found))?;
        return Ok(Some(nm));
    }
    Ok(None)
}

/// Nanometres in a unit of length.
pub(super) fn nm_per_unit(unit: &str) -> Option<f64> {
    match unit {
        "nm" | "nanometer" | "nanometers" | "nanometre" | "nanometres" => Some(1.0),
        "um" | "µm" | "μm" | "micron" | "microns" | "micrometer" | "micrometers" => Some(1e3),
        "m" | "meter" | "metre" => Some(1e9),
        _ => None,
    }
}

/// Reads a 1-D array. An error has a description, and the store's error if that is the cause.
fn numbers(store: &Store, array: &Array<Store>) -> Result<Vec<f64>, (String, Option<DurableError>)> {
    const MAX_NUMBERS: u64 = 1_000_000;
    let invalid = |found: String| (found, None);
    let shape = array.shape();
    let chunk = array.chunk_shape(&vec![0; shape.len()]).map_err(|e| invalid(e.to_string()))?;
    let samples = chunk.iter().fold(1u64, |n, c| n.saturating_mul(c.get()));
    if shape.len() != 1 || shape[0] > MAX_NUMBERS || samples > MAX_NUMBERS {
        return Err(invalid(format!("shape {shape:?}, chunks of {samples}")));
    }
    let t = array.data_type();
    let (bytes, number) = number(t).ok_or_else(|| invalid(format!("samples of type {t}")))?;
    let chain = BoundedChain::new(&array.codecs())
        .map_err(|found| invalid(format!("{found}; give the wavelengths by --wavelengths")))?;
    let fill = array.fill_value();
    // Codecs lengthen incompressible data slightly.
    let limit = samples * bytes as u64 * 2 + (64 << 10);
    let mut all = Vec::new();
    for index in 0..shape[0].div_ceil(samples) {
        let key = array.chunk_key(&[index]);
        let encoded = match store.read_at_most(key.as_str(), limit) {
            Ok(encoded) => encoded,
            Err(e) => return Err((e.to_string(), Some(e))),
        };
        let decoded = match encoded {
            Some(encoded) => chain
                .decode(encoded.into(), &chunk, t, fill)
                .map_err(|reason| invalid(format!("chunk {key}: {reason}")))?,
            None => fill.as_ne_bytes().repeat(samples as usize),
        };
        all.extend(decoded.chunks_exact(bytes).map(number));
    }
    all.truncate(shape[0] as usize);
    Ok(all)
}

/// Bytes of a sample, and its value.
type Number = (usize, fn(&[u8]) -> f64);

/// Reader of samples of type `t`; `None` if the type is not supported.
fn number(t: &DataType) -> Option<Number> {
    macro_rules! read {
        ($t:ty) => {
            (size_of::<$t>(), |b| <$t>::from_ne_bytes(*b.first_chunk().expect("a complete sample")) as f64)
        };
    }
    let known: [(DataType, Number); 8] = [
        (data_type::float64(), read!(f64)),
        (data_type::float32(), read!(f32)),
        (data_type::int64(), read!(i64)),
        (data_type::int32(), read!(i32)),
        (data_type::int16(), read!(i16)),
        (data_type::uint64(), read!(u64)),
        (data_type::uint32(), read!(u32)),
        (data_type::uint16(), read!(u16)),
    ];
    known.into_iter().find(|(known, _)| known == t).map(|(_, read)| read)
}
