//! Charts in MAT-files of level 5 (MATLAB `save -v6`, `-v7`): arrays (y, x, wavelength), and scenes of ISETCam.
//!
//! | file | chart |
//! |---|---|
//! | an array of three axes, or `FILE//struct/array` | its samples; the only one, or the one named `photons`, `data` or `scene/data/photons` |
//! | `mcCOEF` (y, x, k) and the struct `basis` with `basis` (wavelength, k) and `wave` | max(0, Σ_k mcCOEF·basis + `imgMean`) |
//!
//! Wavelengths: the array `wave`, `wavelength`, … of one number a band (nm) beside it, else the only one in the file. ISETCam's data are photons, s⁻¹ m⁻² sr⁻¹
//! nm⁻¹; with wavelengths in the file they become radiance:
//!
//! ```text
//! W m⁻² sr⁻¹ nm⁻¹ = photons · h·c/λ          h, c: exact values of the SI, CODATA 2018
//! ```
//! Files of level 4 and `-v7.3` (HDF5, [`super::hdf5`]) are other formats. Not read: complex, sparse and cell arrays.
//! Source of the names: ISETCam's `vcReadImage`, `ieSaveMultiSpectralImage`, `sceneFromFile`.

mod decode;

use std::fs::File;
use std::path::Path;

use pipeline::geometry::Size;
use pipeline::sensor::HC_J_M;
use serde_json::json;

use super::decoded_chart::{Declared, DecodedChart};
use super::error::ChartError;
use super::file_change::{WatchedFile, modified_json};
use super::header::{FileArray, header_error, open_regular};
use super::options::NanPolicy;
use super::values::Values;
use crate::durable::DurableError;
use crate::mat::{MatArray, MatError, MatFile};
use crate::sample::{RasterSample, Sample};
use decode::{Bands, Samples};

/// First bytes of a file.
const SIGNATURE: &[u8] = b"MATLAB 5.0 MAT-file";
/// Arrays that are read if a file has several of three axes.
const PREFERRED: [&str; 3] = ["photons", "data", "scene/data/photons"];
/// Names of wavelengths.
const WAVELENGTHS: [&str; 5] = ["wave", "wavelength", "wavelengths", "lambda", "wavelength_nm"];
/// h·c, J nm.
const HC_J_NM: f64 = HC_J_M * 1e9;
/// Maximum bytes of a band as it is stored, and of the coefficients of a linear model.
const MAX_BYTES: usize = 1 << 30;
/// Arrays listed in a message.
const MAX_LISTED: usize = 20;

/// Whether `path` is such a file, by its first bytes.
pub fn is_matlab(path: &Path) -> bool {
    use std::os::unix::fs::FileExt;
    // Before it is opened: opening a pipe would wait for its writer.
    if !path.is_file() {
        return false;
    }
    let mut first = [0; SIGNATURE.len()];
    File::open(path).is_ok_and(|file| file.read_exact_at(&mut first, 0).is_ok() && first == SIGNATURE)
}

/// Opens the array `requested` (empty: the only one) of the file at `path`.
///
/// # Errors
/// [`ChartError`] if the file is damaged, or there is no such array.
pub fn open(path: &Path, requested: &str, nan: NanPolicy) -> Result<DecodedChart, ChartError> {
    let file = open_regular(path)?;
    let meta = file.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?;
    let mat = MatFile::open(&file, meta.len()).map_err(|e| mat_error(path, e))?;
    let found = Found::of(path, &mat, requested)?;
    let shape = found.shape(&mat, path)?;
    let [rows, columns, bands] = shape;
    let wavelengths_nm = found.wavelengths(&mat, bands);
    let mut notes =
        vec![format!("array {} [{rows}, {columns}, {bands}] is read as y, x, wavelength", found.name())];
    let is_photons = found.is_photons();
    let mut values = Values::default();
    let units = match (&wavelengths_nm, is_photons) {
        (Some(nm), true) => {
            values.scaling = nm.iter().map(|nm| (HC_J_NM / nm, 0.0)).collect();
            notes.push("its photons, s-1 m-2 sr-1 nm-1, are read as radiance, W m-2 sr-1 nm-1".to_owned());
            Some("W m-2 sr-1 nm-1".to_owned())
        }
        _ => None,
    };
    let samples = found.samples(&mat, path)?;
    let largest = samples.largest_bytes(rows * columns);
    if largest > MAX_BYTES {
        let expected = format!("at most {MAX_BYTES} bytes at a time; save the file with -v7.3");
        return Err(header_error(path, "size of a band", expected, largest.to_string()));
    }
    let declared = Declared {
        path: path.into(),
        size: Size::new(rows, columns),
        bands,
        sample: RasterSample::Plain(Sample::F64),
        wavelengths_nm,
        values,
        units,
        array: Some(FileArray { path: found.name().to_owned(), attributes: serde_json::Map::new() }),
        notes,
        content: json!({ "matlab": { "array": found.name(), "shape": shape }, "bytes": meta.len() }),
        mtimes: modified_json(&meta),
        files: vec![WatchedFile::data(path, &meta)],
        nan,
    };
    let size = Size::new(rows, columns);
    DecodedChart::new(
        declared,
        Box::new(Bands { path: path.into(), size, is_big_endian: mat.is_big_endian, samples }),
    )
}

/// The error of a file.
fn mat_error(path: &Path, error: MatError) -> ChartError {
    match error {
        MatError::Io(e) => DurableError::io("read", path, 0, e).into(),
        MatError::Invalid(reason) => ChartError::Damaged { path: path.into(), reason },
    }
}

/// What a file has as a chart.
enum Found<'a> {
    Array(&'a MatArray),
    /// Coefficients of a linear model.
    Model(&'a MatArray),
}

impl<'a> Found<'a> {
    fn of(path: &Path, mat: &'a MatFile, requested: &str) -> Result<Self, ChartError> {
        let none = |requested: String| {
            let list = mat.arrays.iter().take(MAX_LISTED).map(|a| format!("{} {:?}", a.path, a.shape));
            let mut list = list.collect::<Vec<_>>().join(", ");
            if mat.arrays.len() > MAX_LISTED {
                list += ", …";
            }
            let found = if list.is_empty() { "none".to_owned() } else { list };
            ChartError::NoArray { path: path.into(), requested, found }
        };
        if !requested.is_empty() {
            return mat.array(requested).map(Self::Array).ok_or_else(|| none(format!("{requested:?}")));
        }
        if let (Some(model), Some(_)) = (mat.array("mcCOEF"), mat.array("basis/basis")) {
            return Ok(Self::Model(model));
        }
        let cubes: Vec<&MatArray> =
            mat.arrays.iter().filter(|a| a.shape.len() == 3 && a.shape.iter().all(|n| *n > 1)).collect();
        let preferred = PREFERRED.iter().find_map(|name| cubes.iter().find(|a| a.path == *name));
        match (preferred, &cubes[..]) {
            (Some(array), _) | (None, [array]) => Ok(Self::Array(array)),
            (None, []) => Err(none("of three axes".to_owned())),
            (None, _) => Err(none("selected, and several have three axes".to_owned())),
        }
    }

    fn array(&self) -> &'a MatArray {
        match self {
            Self::Array(array) | Self::Model(array) => array,
        }
    }

    fn name(&self) -> &'a str {
        &self.array().path
    }

    fn is_photons(&self) -> bool {
        match self {
            Self::Model(_) => true,
            Self::Array(array) => array.path.rsplit('/').next() == Some("photons"),
        }
    }

    /// Rows, columns and bands.
    fn shape(&self, mat: &MatFile, path: &Path) -> Result<[usize; 3], ChartError> {
        let shape = &self.array().shape;
        let (rows, columns, last) = match shape[..] {
            [rows, columns] => (rows, columns, 1),
            [rows, columns, last] => (rows, columns, last),
            _ => {
                return Err(header_error(
                    path,
                    "axes",
                    "y, x, wavelength or y, x",
                    format!("{shape:?} of {}", self.name()),
                ));
            }
        };
        match self {
            Self::Array(_) => Ok([rows, columns, last]),
            Self::Model(_) => {
                let basis = mat.array("basis/basis").map_or(&[][..], |basis| &basis.shape);
                match *basis {
                    [bands, k] if k == last && bands > 0 => Ok([rows, columns, bands]),
                    _ => Err(header_error(
                        path,
                        "basis/basis",
                        format!("(wavelength, {last}), as mcCOEF {shape:?} has"),
                        format!("{basis:?}"),
                    )),
                }
            }
        }
    }

    /// Wavelengths of `bands` bands, nm.
    fn wavelengths(&self, mat: &MatFile, bands: usize) -> Option<Vec<f64>> {
        let name =
            |array: &MatArray| array.path.rsplit('/').next().is_some_and(|name| WAVELENGTHS.contains(&name));
        let is_one = |array: &&MatArray| name(array) && array.shape.iter().product::<usize>() == bands;
        let all: Vec<&MatArray> = mat.arrays.iter().filter(is_one).collect();
        let outer = |path: &str| path.rsplit_once('/').map_or(String::new(), |(outer, _)| outer.to_owned());
        let own = match self {
            Self::Array(array) => outer(&array.path),
            Self::Model(_) => "basis".to_owned(),
        };
        let beside = all.iter().find(|array| outer(&array.path) == own);
        let chosen = beside.or(if all.len() == 1 { all.first() } else { None })?;
        chosen.values.clone()
    }

    fn samples(&self, mat: &MatFile, path: &Path) -> Result<Samples, ChartError> {
        let array = self.array().clone();
        if let Self::Array(_) = self {
            return Ok(Samples::Stored(array));
        }
        let values = |name: &str| mat.array(name).map(|a| (a.shape.clone(), a.values.clone()));
        let basis = match values("basis/basis") {
            Some((_, Some(values))) => values,
            found => {
                let expected = format!("at most {} numbers", crate::mat::MAX_VALUES);
                return Err(header_error(path, "basis/basis", expected, format!("{:?}", found.map(|f| f.0))));
            }
        };
        let count = array.shape.get(2).copied().unwrap_or(1);
        let bands = basis.len() / count.max(1);
        let mean = match values("imgMean") {
            None => vec![0.0; bands],
            Some((_, Some(mean))) if mean.len() == bands => mean,
            Some((shape, _)) => {
                return Err(header_error(path, "imgMean", format!("{bands} numbers"), format!("{shape:?}")));
            }
        };
        Ok(Samples::Model { coefficients: array, count, basis, mean })
    }
}

#[cfg(test)]
mod tests;
