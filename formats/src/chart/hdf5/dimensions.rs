//! Names of dimensions, and wavelengths of the bands.
//!
//! | names | written by |
//! |---|---|
//! | attribute `DIMENSION_LABELS` | h5py |
//! | `_Netcdf4Coordinates`: identifiers of dimensions, each that of an array of the group (`_Netcdf4Dimid`) | netCDF-C, h5netcdf |
//! | arrays of class `DIMENSION_SCALE`, where every side of the array has the length of exactly one | others |
//!
//! Arrays of class `DIMENSION_SCALE` are those of the group and of the groups above it. Scales that are attached by references (`DIMENSION_LIST`) are not
//! followed: an array with such a list whose dimensions have no names otherwise is read only with declared axes.

use std::collections::HashMap;
use std::path::Path;

use hdf5_pure::{AttrValue, Dataset, Error, Group};

use super::super::axes::axis_of;
use super::super::conventions;
use super::super::coordinates::nm_per_unit;
use super::super::error::ChartError;
use super::super::header::header_error;
use super::attributes::{self, numbers};
use super::guard::guarded;

type Attributes = HashMap<String, AttrValue>;

/// Names of arrays that may hold wavelengths, besides those of the spectral axis.
const WAVELENGTH_NAMES: [&str; 2] = ["wavelength", "wavelengths_nm"];
/// Wavelengths in nm where no unit is given.
const NM_WITHOUT_UNIT: std::ops::RangeInclusive<f64> = 200.0..=2500.0;
/// Maximum bytes of a chunk of a coordinate.
const MAX_CHUNK_BYTES: u64 = 16 << 20;

/// Names of the dimensions of an array of `sides` in the first of `groups`, if it has them; the others are the groups above it.
pub(super) fn names(
    groups: &[Group],
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
    for (name, dataset) in
        groups.iter().map(Group::iter_datasets).collect::<Result<Vec<_>, _>>()?.into_iter().flatten()
    {
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

/// Whether an array of this name may hold wavelengths.
fn may_hold_wavelengths(name: &str) -> bool {
    axis_of(name) == Some(0) || WAVELENGTH_NAMES.contains(&name)
}

/// Lengths of the lists that may hold wavelengths in the first of `groups` that has any.
pub(super) fn wavelength_counts(groups: &[Group]) -> Result<Vec<usize>, Error> {
    for group in groups {
        let mut counts = Vec::new();
        for (_, dataset) in group.iter_datasets()?.filter(|(name, _)| may_hold_wavelengths(name)) {
            let shape = dataset.shape()?;
            if shape.iter().filter(|n| **n != 1).count() <= 1 {
                counts.extend(shape.iter().max().and_then(|n| usize::try_from(*n).ok()));
            }
        }
        if !counts.is_empty() {
            return Ok(counts);
        }
    }
    Ok(Vec::new())
}

/// Wavelengths in nm of `bands` bands of the array `name`, if its group, those above it or its attributes hold them. The coordinate of the dimension
/// `spectral` comes first, then `wavelength`, then others; of these, several that differ are an error.
pub(super) fn wavelengths(
    path: &Path,
    groups: &[Group],
    attributes: &Attributes,
    (name, spectral): (&str, Option<&str>),
    bands: usize,
) -> Result<Option<Vec<f64>>, ChartError> {
    // `wavelength` before `band`, which may hold numbers of bands.
    let rank = |n: &str| match n {
        _ if Some(n) == spectral && n.to_lowercase().contains("wave") => 0,
        "wavelength" => 1,
        _ if n.to_lowercase().contains("wave") => 2,
        _ => 3,
    };
    for group in groups {
        let mut candidates: Vec<(String, Dataset)> = guarded(path, || {
            Ok(group.iter_datasets()?.filter(|(n, _)| n != name && may_hold_wavelengths(n)).collect())
        })?;
        candidates.sort_by_key(|(n, _)| (rank(n), n.clone()));
        for same_rank in candidates.chunk_by(|a, b| rank(&a.0) == rank(&b.0)) {
            let mut found: Option<(&str, Vec<f64>)> = None;
            for (name, dataset) in same_rank {
                let Some(nm) = coordinate(path, name, dataset, bands)? else { continue };
                match &found {
                    Some((first, other)) if *other != nm => {
                        let expected =
                            "one array of wavelengths; name it wavelength, or give them by --wavelengths";
                        return Err(header_error(
                            path,
                            "wavelengths",
                            expected,
                            format!("{first} and {name}"),
                        ));
                    }
                    Some(_) => {}
                    None => found = Some((name, nm)),
                }
            }
            if let Some((_, nm)) = found {
                return Ok(Some(nm));
            }
        }
    }
    let attribute = ["wavelengths_nm", "wavelength_nm", "wavelengths", "wavelength"];
    let found = attribute.iter().find_map(|key| attributes.get(*key).and_then(numbers));
    Ok(found.filter(|nm| nm.len() == bands && nm.iter().all(|v| NM_WITHOUT_UNIT.contains(v))))
}

/// The array `name` as wavelengths in nm; `None` if it does not hold one per band.
fn coordinate(
    path: &Path,
    name: &str,
    dataset: &Dataset,
    bands: usize,
) -> Result<Option<Vec<f64>>, ChartError> {
    let shape = guarded(path, || dataset.shape())?;
    let is_list = shape.iter().filter(|n| **n != 1).count() <= 1;
    if !is_list || shape.iter().product::<u64>() != bands as u64 {
        return Ok(None);
    }
    let chunk = guarded(path, || dataset.chunk_shape())?.unwrap_or_default();
    if chunk.iter().try_fold(8u64, |n, side| n.checked_mul(*side)).is_none_or(|n| n > MAX_CHUNK_BYTES) {
        let found = format!("chunks of {chunk:?} in {name}");
        return Err(header_error(path, "coordinate", "chunks of at most 16 MiB", found));
    }
    let raw = guarded(path, || dataset.read_f64())?;
    let attributes = attributes::read(path, name, dataset)?;
    let unit = attributes.get("units").and_then(serde_json::Value::as_str);
    let factor = match unit {
        None => 1.0,
        Some(unit) => nm_per_unit(unit.trim()).ok_or_else(|| {
            let expected = "units nm, um or m; or give the wavelengths by --wavelengths";
            header_error(path, "coordinate", expected, format!("{unit:?} of {name}"))
        })?,
    };
    let nm = conventions::coordinate(&attributes, raw, factor).map_err(|(what, expected, found)| {
        header_error(path, what, expected, format!("{found} in {name}"))
    })?;
    Ok(Some(nm).filter(|nm| unit.is_some() || nm.iter().all(|v| NM_WITHOUT_UNIT.contains(v))))
}
