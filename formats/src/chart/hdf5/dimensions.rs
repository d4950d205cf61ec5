//! Names of dimensions, and wavelengths of the bands.
//!
//! | names | written by |
//! |---|---|
//! | attribute `DIMENSION_LABELS` | h5py |
//! | `_Netcdf4Coordinates`: identifiers of dimensions, each that of an array of the group (`_Netcdf4Dimid`) | netCDF-C, h5netcdf |
//! | arrays of class `DIMENSION_SCALE` in the group, where every side of the array has the length of exactly one | others |

use std::collections::HashMap;
use std::path::Path;

use hdf5_pure::{AttrValue, Dataset, Error, Group};

use super::super::axes::axis_of;
use super::super::coordinates::nm_per_unit;
use super::super::error::ChartError;
use super::super::header::header_error;
use super::attributes::numbers;
use super::guarded;

type Attributes = HashMap<String, AttrValue>;

/// Names of arrays that may hold wavelengths, besides those of the spectral axis.
const WAVELENGTH_NAMES: [&str; 2] = ["wavelength", "wavelengths_nm"];
/// Wavelengths in nm where no unit is given.
const NM_WITHOUT_UNIT: std::ops::RangeInclusive<f64> = 200.0..=2500.0;
/// Maximum bytes of a chunk of a coordinate.
const MAX_CHUNK_BYTES: u64 = 16 << 20;

/// Names of the dimensions of an array of `sides` in `group`, if it has them.
pub(super) fn names(
    group: &Group,
    attributes: &Attributes,
    sides: &[usize],
) -> Result<Option<Vec<String>>, Error> {
    if let Some(labels) = attributes.get("DIMENSION_LABELS").and_then(AttrValue::as_strings)
        && labels.len() == sides.len()
        && labels.iter().all(|l| !l.is_empty())
    {
        return Ok(Some(labels.to_vec()));
    }
    let mut scales = Vec::new();
    for (name, dataset) in group.iter_datasets()? {
        let attributes = dataset.attrs()?;
        if attributes.get("CLASS").and_then(AttrValue::as_str) == Some("DIMENSION_SCALE") {
            let id = attributes.get("_Netcdf4Dimid").and_then(numbers).and_then(|n| n.first().copied());
            let length = dataset.shape()?.first().copied();
            scales.push((name, id, length));
        }
    }
    if let Some(ids) = attributes.get("_Netcdf4Coordinates").and_then(numbers) {
        let name = |id: &f64| scales.iter().find(|s| s.1 == Some(*id)).map(|s| s.0.clone());
        let names: Option<Vec<String>> = ids.iter().map(name).collect();
        if let Some(names) = names.filter(|n| n.len() == sides.len()) {
            return Ok(Some(names));
        }
    }
    let only = |side: &usize| {
        let mut fitting = scales.iter().filter(|s| s.2 == Some(*side as u64));
        let first = fitting.next()?;
        fitting.next().is_none().then(|| first.0.clone())
    };
    Ok(sides.iter().map(only).collect())
}

/// Wavelengths in nm of `bands` bands of the array `name`, if its group or its attributes hold them.
pub(super) fn wavelengths(
    path: &Path,
    group: &Group,
    attributes: &Attributes,
    name: &str,
    bands: usize,
) -> Result<Option<Vec<f64>>, ChartError> {
    let mut candidates: Vec<(String, Dataset)> = guarded(path, || {
        let spectral = |n: &str| axis_of(n) == Some(0) || WAVELENGTH_NAMES.contains(&n);
        Ok(group.iter_datasets()?.filter(|(n, _)| n != name && spectral(n)).collect())
    })?;
    // `wavelength` before `band`, which may hold numbers of bands.
    candidates.sort_by_key(|(n, _)| (!n.to_lowercase().contains("wave"), n.clone()));
    for (name, dataset) in candidates {
        let shape = guarded(path, || dataset.shape())?;
        let is_list = shape.iter().filter(|n| **n != 1).count() <= 1;
        if !is_list || shape.iter().product::<u64>() != bands as u64 {
            continue;
        }
        let chunk = guarded(path, || dataset.chunk_shape())?.unwrap_or_default();
        if chunk.iter().try_fold(8u64, |n, side| n.checked_mul(*side)).is_none_or(|n| n > MAX_CHUNK_BYTES) {
            let found = format!("chunks of {chunk:?} in {name}");
            return Err(header_error(path, "coordinate", "chunks of at most 16 MiB", found));
        }
        let values = guarded(path, || dataset.read_f64())?;
        let unit =
            guarded(path, || dataset.attrs())?.get("units").and_then(AttrValue::as_str).map(str::to_owned);
        match unit {
            Some(unit) => {
                let expected = "units nm, um or m";
                let factor = nm_per_unit(unit.trim()).ok_or_else(|| {
                    header_error(path, "coordinate", expected, format!("{unit:?} of {name}"))
                })?;
                return Ok(Some(values.iter().map(|v| v * factor).collect()));
            }
            None if values.iter().all(|v| NM_WITHOUT_UNIT.contains(v)) => return Ok(Some(values)),
            None => {}
        }
    }
    let attribute = ["wavelengths_nm", "wavelength_nm", "wavelengths", "wavelength"];
    let found = attribute.iter().find_map(|key| attributes.get(*key).and_then(numbers));
    Ok(found.filter(|nm| nm.len() == bands && nm.iter().all(|v| NM_WITHOUT_UNIT.contains(v))))
}
