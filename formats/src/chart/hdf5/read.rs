//! Opening an array: its place in the file, the order of its axes, its wavelengths and attributes, and how it is stored.

use std::fs::File;
use std::path::Path;

use hdf5_pure::{Dataset, Layout};
use serde_json::json;

use super::chunks::ChunkGrid;
use super::guard::guarded;
use super::source::BoundedSource;
use super::variables::Variable;
use super::{Hdf5Chart, attributes, dimensions, sample_type, variables};
use crate::chart::axes::AxisOrder;
use crate::chart::conventions::parse_values;
use crate::chart::coordinates::axis_order;
use crate::chart::decoded_chart::{Declared, DecodedChart};
use crate::chart::error::ChartError;
use crate::chart::file_change::{WatchedFile, modified_json};
use crate::chart::header::{FileArray, header_error};
use crate::chart::options::NanPolicy;
use crate::chart::raster::RasterChart;
use crate::chart::raster::layout::RasterLayout;
use crate::durable::DurableError;
use pipeline::geometry::Size;

/// Opens the array `requested` (empty: the only one) of the file at `path`; `axes` are its axes as h5py, xarray or MATLAB show them. Wavelengths in the file
/// are not read if the caller has `given_wavelengths`, so many.
///
/// # Errors
/// [`ChartError`] if the file is damaged, there is no such array, or it is not supported.
pub fn open(
    path: &Path,
    requested: &str,
    axes: Option<&AxisOrder>,
    nan: NanPolicy,
    given_wavelengths: Option<usize>,
) -> Result<Hdf5Chart, ChartError> {
    let file = File::open(path).map_err(|e| DurableError::io("open", path, 0, e))?;
    let meta = file.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?;
    let again = file.try_clone().map_err(|e| DurableError::io("open", path, 0, e))?;
    let hdf5 = guarded(path, || hdf5_pure::File::from_source(BoundedSource::new(again, meta.len())))?;
    let (variable, chosen) = variables::select(path, &hdf5, requested, given_wavelengths)?;
    let Variable { group, name, dataset } = &variable;
    let full_name = variable.full_name();
    let attributes = guarded(path, || dataset.attrs())?;
    let sides = sides(path, dataset)?;
    let (sample, little_endian) =
        sample_type::of(&guarded(path, || dataset.datatype())?).map_err(|found| {
            header_error(path, "samples", sample_type::EXPECTED, format!("{found} in {full_name}"))
        })?;
    let groups = guarded(path, || variables::groups(&hdf5, group))?;
    let (order, names, mut notes) = match attributes.contains_key("MATLAB_class") {
        true => {
            let (order, notes) = matlab_order(path, &full_name, &sides, axes)?;
            (order, None, notes)
        }
        false => {
            let names = guarded(path, || dimensions::names(&groups, &attributes, &sides))?;
            let has_references =
                || guarded(path, || Ok(dataset.attr_datatypes()?.contains_key("DIMENSION_LIST")));
            if names.is_none() && axes.is_none() && has_references()? {
                let expected =
                    "dimensions with names; give the axes of the array by --axes, e.g. --axes wavelength,y,x";
                let found = format!(
                    "dimension scales attached by references (DIMENSION_LIST) to {full_name} {sides:?}"
                );
                return Err(header_error(path, "order of dimensions", expected, found));
            }
            let by_sides = names.is_none() && axes.is_none() && sides.len() == 3;
            let counts = match (by_sides, given_wavelengths) {
                (false, _) => Vec::new(),
                (true, Some(given)) => vec![given],
                (true, None) => guarded(path, || dimensions::wavelength_counts(&groups))?,
            };
            let order = axis_order(&sides, names.as_deref(), axes)
                .and_then(|order| counts_tell_bands(&sides, &counts).map(|()| order))
                .map_err(|(expected, found)| header_error(path, "order of dimensions", expected, found))?;
            let axis_names = names.as_ref().map_or_else(
                || "without names of axes".into(),
                |n: &Vec<String>| format!("({})", n.join(", ")),
            );
            let note = format!("array {full_name} {sides:?}, {axis_names}, is read as {order}");
            (order, names, vec![note])
        }
    };
    notes.extend(chosen);
    let shape = order.to_chart(&sides, 1);
    let spectral = order.axes().iter().position(|&axis| axis == 0);
    let spectral = names.as_deref().zip(spectral).map(|(names, k)| names[k].as_str());
    let wavelengths_nm = match given_wavelengths.is_some() {
        true => None,
        false => dimensions::wavelengths(path, &groups, &attributes, (name, spectral), shape[0])?,
    };
    let json = attributes::read(path, &full_name, dataset)?;
    let values = parse_values(&json, sample, None).map_err(|(what, expected, found)| {
        header_error(path, what, expected, format!("{found} in {full_name}"))
    })?;
    if let Some((scale, offset)) = values.scaling.first() {
        notes.push(format!(
            "its scale_factor and add_offset are applied: value = sample · {scale} + {offset}"
        ));
    }
    let units = json.get("units").and_then(|u| u.as_str()).map(str::to_owned);
    let array = FileArray { path: full_name.clone(), attributes: json };
    match guarded(path, || dataset.layout())? {
        Layout::Contiguous { address: Some(offset), .. } => {
            let layout =
                RasterLayout { shape, interleave: order.interleave(), sample, little_endian, offset };
            let chart =
                RasterChart::described(array, path, layout, (wavelengths_nm, values, units, notes), nan)?;
            Ok(Hdf5Chart::Raster(Box::new(chart)))
        }
        Layout::Chunked { chunk_shape, .. } => {
            let grid = ChunkGrid::new(
                path,
                file,
                meta.len(),
                &variable,
                (&chunk_shape, &sides),
                (sample, little_endian),
                order,
            )?;
            let declared = Declared {
                path: path.into(),
                size: Size::new(shape[1], shape[2]),
                bands: shape[0],
                sample,
                wavelengths_nm,
                values,
                units,
                array: Some(array),
                notes,
                content: json!({ "hdf5": full_name, "bytes": meta.len(), "layout": grid.description() }),
                mtimes: modified_json(&meta),
                files: vec![WatchedFile::data(path, &meta)],
                nan,
            };
            Ok(Hdf5Chart::Decoded(Box::new(DecodedChart::new(declared, Box::new(grid))?)))
        }
        other => {
            let expected = "contiguous or chunked with data in this file; h5repack IN OUT rewrites it";
            Err(header_error(path, "storage", expected, format!("{other} in {full_name}")))
        }
    }
}

/// Sides of an array; each fits in memory addresses.
fn sides(path: &Path, dataset: &Dataset) -> Result<Vec<usize>, ChartError> {
    let shape = guarded(path, || dataset.shape())?;
    if !(2..=3).contains(&shape.len()) {
        return Err(header_error(path, "axes of the array", "two or three", format!("{shape:?}")));
    }
    shape
        .iter()
        .map(|&n| usize::try_from(n).ok().filter(|n| *n <= 1 << 40))
        .collect::<Option<_>>()
        .ok_or_else(|| header_error(path, "shape", "at most 2^40 along each axis", format!("{shape:?}")))
}

/// Fails if the numbers of wavelengths, `counts`, leave it open which axis of an array without names of axes is the spectral one, or fit another
/// than the first.
fn counts_tell_bands(sides: &[usize], counts: &[usize]) -> Result<(), (String, String)> {
    for &count in counts.iter().filter(|n| **n > 1) {
        let fitting: Vec<usize> = (0..sides.len()).filter(|&k| sides[k] == count).collect();
        if !fitting.is_empty() && fitting != [0] {
            let expected = "(wavelength, y, x), and as many wavelengths as the first side alone; give the axes of the array by --axes, e.g. \
                            --axes y,x,wavelength, or --axes wavelength,x,y for MATLAB's (y, x, wavelength)";
            return Err((
                expected.into(),
                format!("{sides:?} without names of axes, and {count} wavelengths"),
            ));
        }
    }
    Ok(())
}

/// Order of the axes of an array that MATLAB stored, with a note: its files hold the axes in reverse.
pub(super) fn matlab_order(
    path: &Path,
    name: &str,
    sides: &[usize],
    declared: Option<&AxisOrder>,
) -> Result<(AxisOrder, Vec<String>), ChartError> {
    let in_matlab: Vec<usize> = sides.iter().rev().copied().collect();
    let standard = if sides.len() == 3 { "y,x,wavelength" } else { "y,x" };
    let order = match declared {
        Some(order) => order.clone(),
        None => standard.parse().expect("a valid order"),
    };
    if order.rank() != sides.len() {
        let expected = format!("{} axes, as in --axes {order}", order.rank());
        return Err(header_error(path, "order of dimensions", expected, format!("{in_matlab:?} in {name}")));
    }
    // Its own order is doubtful if both of the last two sides are far larger than the first.
    if declared.is_none() && AxisOrder::spatial_first(sides).is_some() {
        let found = format!(
            "{in_matlab:?}; is it (wavelength, y, x)? Add --axes wavelength,y,x, or --axes {standard} if it is not"
        );
        return Err(header_error(
            path,
            "order of dimensions",
            "(y, x, wavelength) as MATLAB shows them",
            found,
        ));
    }
    let note = format!("array {name} {in_matlab:?} as MATLAB shows it is read as {order}");
    Ok((order.reversed(), vec![note]))
}
