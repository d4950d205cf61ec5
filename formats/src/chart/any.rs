//! A chart of any format, opened by its name on the command line.
//!
//! A format is a row of [`FORMATS`]; the first that recognises a name opens it. Its pixels are read by one of four types: a Zarr array
//! ([`ChartStore`]), a file that is mapped into memory ([`RasterChart`]), one that is decoded to a temporary file ([`DecodedChart`]), or a
//! surface of a scene ([`SceneChart`]).

mod access;

pub use access::check_has_files;

use std::path::Path;

use pipeline::chart::{ChartSpec, Generator};

use super::array::ArrayChart;
use super::axes::AxisOrder;
use super::decoded_chart::DecodedChart;
use super::error::ChartError;
use super::exr::{self, ExrContent, ExrFile};
use super::foreign;
use super::hdf5::{self, Hdf5Chart};
use super::matlab;
use super::open::split_array;
use super::options::{ChartOptions, NanPolicy};
use super::pictures;
use super::raster::RasterChart;
use super::raster::layout::RasterLayout;
use super::scene::{self, SceneChart};
use super::store::ChartStore;
use crate::durable::is_url;
use crate::npy::parse_dtype;

/// A chart of any format.
pub enum Chart {
    /// A Zarr array.
    Store(Box<ChartStore>),
    /// A flat file.
    Raster(Box<RasterChart>),
    /// Pictures, one per band, a TIFF of several bands, a chunked array of HDF5, or a spectral OpenEXR file.
    Decoded(Box<DecodedChart>),
    /// Generated on demand.
    Generated(Box<Generator>),
    /// A surface of a scene.
    Scene(Box<SceneChart>),
    /// An array in memory, whose pixels are not known yet.
    Array(Box<ArrayChart>),
}

/// How a chart is read.
#[derive(Clone, Copy, Default)]
pub struct ChartRequest<'a> {
    /// Wavelengths of the bands in nm in place of the file's.
    pub wavelengths_nm: Option<&'a [f64]>,
    /// Shape and sample type: the file holds raw samples.
    pub raw: Option<(&'a str, &'a str)>,
    /// Order of the axes.
    pub axes: Option<&'a AxisOrder>,
    /// Factor of all values.
    pub scale: Option<f64>,
    /// NaN and fill values.
    pub nan: NanPolicy,
    /// Bytes of decoded chunks that are cached.
    pub cache_bytes: usize,
}

/// A format of charts in files.
struct Format {
    /// What messages call it.
    name: &'static str,
    /// Whether a chart is one file; a flat one may have a header or attributes beside it, pictures are several.
    is_one_file: bool,
    /// Why `--axes` does not apply to it, if it does not.
    declares_axes: Option<&'static str>,
    /// Whether a file may hold several arrays, of which `PATH//array` and `--var` name one.
    holds_arrays: bool,
    /// Whether the name is one of a chart of this format.
    detects: fn(&str) -> bool,
    /// Opens it.
    open: fn(&str, &ChartRequest<'_>) -> Result<Chart, ChartError>,
}

/// The format of the chart that `spec` names; `None` for a Zarr store.
fn format_of(spec: &str) -> Option<&'static Format> {
    FORMATS.iter().find(|format| (format.detects)(spec))
}

/// Whether `path` is a chart of a format in which a chart is one file.
pub(super) fn is_one_file(path: &Path) -> bool {
    path.to_str().and_then(format_of).is_some_and(|format| format.is_one_file)
}

/// Whether `--axes` applies to the chart that `spec` names: formats that declare their order have none, nor have drawn charts.
pub fn takes_axes(spec: &str) -> bool {
    !spec.starts_with("gen:") && format_of(spec).is_none_or(|format| format.declares_axes.is_none())
}

/// Whether the chart that `spec` names is of a format with several arrays in a store or file.
pub fn holds_arrays(spec: &str) -> bool {
    match format_of(spec) {
        Some(format) => format.holds_arrays,
        None => !is_other_file(Path::new(spec)),
    }
}

/// Whether `path` is local, exists, and is no directory: of no format of [`FORMATS`], it cannot be a Zarr store.
fn is_other_file(path: &Path) -> bool {
    !is_url(path) && path.exists() && !path.is_dir()
}

/// The formats of files, in the order in which a name is compared with them; what none recognises is a Zarr store.
static FORMATS: &[Format] = &[
    Format {
        name: "a scene",
        is_one_file: false,
        declares_axes: Some("a scene declares its order"),
        holds_arrays: true,
        detects: scene::is_scene,
        open: |spec, request| {
            let chart = SceneChart::open(spec, request.wavelengths_nm, request.scale, request.cache_bytes)?;
            Ok(Chart::Scene(Box::new(chart)))
        },
    },
    Format {
        name: "spectral OpenEXR",
        is_one_file: true,
        declares_axes: Some("OpenEXR declares its order"),
        holds_arrays: false,
        detects: |spec| exr::is_supported_path(Path::new(spec)),
        open: |spec, request| decoded(spectral(exr::open(Path::new(spec), request.nan)?)?, request),
    },
    Format {
        name: "multi-band TIFF",
        is_one_file: true,
        declares_axes: Some("TIFF declares its order"),
        holds_arrays: false,
        detects: |spec| pictures::is_tiff(Path::new(spec)),
        open: |spec, request| decoded(pictures::open_tiff(Path::new(spec), request.nan)?, request),
    },
    Format {
        name: "HDF5 (.h5, NetCDF-4)",
        is_one_file: true,
        declares_axes: None,
        holds_arrays: true,
        detects: |spec| hdf5::is_hdf5(Path::new(split_array(spec).0)),
        open: |spec, request| {
            let (file, array) = split_array(spec);
            let declared = request.wavelengths_nm.map(<[f64]>::len);
            match hdf5::open(Path::new(file), array, request.axes, request.nan, declared)? {
                Hdf5Chart::Raster(chart) => raster(*chart, request),
                Hdf5Chart::Decoded(chart) => decoded(*chart, request),
            }
        },
    },
    Format {
        name: "MATLAB (.mat)",
        is_one_file: true,
        declares_axes: Some("MATLAB's arrays are y, x, wavelength (`permute` changes their axes)"),
        holds_arrays: true,
        detects: |spec| matlab::is_matlab(Path::new(split_array(spec).0)),
        open: |spec, request| {
            let (file, array) = split_array(spec);
            decoded(matlab::open(Path::new(file), array, request.nan)?, request)
        },
    },
    Format {
        name: ".npy, ENVI (.hdr)",
        is_one_file: false,
        declares_axes: None,
        holds_arrays: false,
        detects: |spec| RasterChart::is_supported_path(Path::new(spec)),
        open: |spec, request| {
            check_local(spec)?;
            raster(RasterChart::open_with_axes(Path::new(spec), request.axes, request.nan)?, request)
        },
    },
    Format {
        name: "a folder or pattern of grey PNG or TIFF pictures",
        is_one_file: false,
        declares_axes: Some("each picture is a band"),
        holds_arrays: false,
        detects: pictures::is_set_of_pictures,
        open: |spec, request| decoded(pictures::open_set(spec, request.nan)?, request),
    },
];

impl Chart {
    /// Opens `PATH`, `PATH//array`, a folder or pattern of pictures, or `gen:KIND?…`.
    ///
    /// # Errors
    /// [`ChartError::Usage`] if the name or the request is invalid; else that the chart cannot be opened.
    pub fn open(spec: &str, request: &ChartRequest<'_>) -> Result<Self, ChartError> {
        if let Some((shape, dtype)) = request.raw {
            return raster(raw(spec, shape, dtype, request)?, request);
        }
        if let Some(drawn) = spec.strip_prefix("gen:") {
            return generated(drawn, request);
        }
        let Some(format) = format_of(spec) else {
            let path = Path::new(split_array(spec).0);
            if is_other_file(path) {
                let names = FORMATS.iter().map(|format| format.name).collect::<Vec<_>>().join(", ");
                return Err(foreign::unsupported(path, &names));
            }
            let options = ChartOptions {
                cache_bytes: request.cache_bytes,
                nan: request.nan,
                wavelengths_nm: request.wavelengths_nm.map(<[f64]>::to_vec),
                axes: request.axes.cloned(),
                scale: request.scale.unwrap_or(1.0),
            };
            return Ok(Self::Store(Box::new(ChartStore::open(spec, options)?)));
        };
        if let (Some(declared), Some(_)) = (format.declares_axes, request.axes) {
            return Err(ChartError::Usage(format!(
                "--axes applies to Zarr and HDF5 arrays, .npy and raw samples; chart `{spec}`: {declared}"
            )));
        }
        (format.open)(spec, request)
    }
}

/// A chart that is drawn.
fn generated(drawn: &str, request: &ChartRequest<'_>) -> Result<Chart, ChartError> {
    let given = [("--axes", request.axes.is_some()), ("--chart-scale", request.scale.is_some())];
    if let Some((flag, _)) = given.iter().find(|(_, given)| *given) {
        return Err(ChartError::Usage(format!("{flag} applies to charts in files, not to `gen:{drawn}`")));
    }
    let mut spec: ChartSpec =
        drawn.parse().map_err(|e| ChartError::Usage(format!("chart `gen:{drawn}`: {e}")))?;
    if let Some(nm) = request.wavelengths_nm {
        spec.wavelengths_nm = nm.to_vec();
    }
    let generator =
        Generator::new(spec).map_err(|e| ChartError::Usage(format!("chart `gen:{drawn}`: {e}")))?;
    Ok(Chart::Generated(Box::new(generator)))
}

/// Opens raw samples of `shape` (`BANDS,ROWS,COLUMNS`, or the sides along `--axes`) and NumPy's type `dtype`.
fn raw(spec: &str, shape: &str, dtype: &str, request: &ChartRequest<'_>) -> Result<RasterChart, ChartError> {
    check_local(spec)?;
    let standard = "wavelength,y,x".parse::<AxisOrder>().expect("a valid order");
    let axes = request.axes.unwrap_or(&standard);
    let sides: Option<Vec<usize>> = shape.split(',').map(|w| w.trim().parse().ok()).collect();
    let invalid = || {
        ChartError::Usage(format!("--chart-shape {shape}: expected the sides along {axes}, e.g. 31,512,512"))
    };
    let sides = sides.ok_or_else(invalid)?;
    let Some((sample, little_endian)) = parse_dtype(dtype) else {
        return Err(ChartError::Usage(format!(
            "--chart-dtype {dtype}: expected u8, u16, f16, f32 or f64, prefix `>` for big-endian; or NumPy's u1, u2, u4, i2, i4, f2, f4, f8"
        )));
    };
    let layout = RasterLayout::raw(&sides, axes, sample, little_endian).map_err(|_| invalid())?;
    RasterChart::raw(Path::new(spec), layout, request.nan)
}

fn raster(chart: RasterChart, request: &ChartRequest<'_>) -> Result<Chart, ChartError> {
    let chart = chart.with_scale(request.scale.unwrap_or(1.0));
    Ok(Chart::Raster(Box::new(match request.wavelengths_nm {
        Some(nm) => chart.with_wavelengths(nm.to_vec())?,
        None => chart,
    })))
}

fn decoded(chart: DecodedChart, request: &ChartRequest<'_>) -> Result<Chart, ChartError> {
    let chart = chart.with_scale(request.scale.unwrap_or(1.0));
    Ok(Chart::Decoded(Box::new(match request.wavelengths_nm {
        Some(nm) => chart.with_wavelengths(nm.to_vec())?,
        None => chart,
    })))
}

/// The chart of a file with wavelengths.
fn spectral(file: ExrFile) -> Result<DecodedChart, ChartError> {
    if matches!(file.content, ExrContent::Spectral { .. }) {
        return Ok(file.chart);
    }
    let path = file.chart.path().display();
    Err(ChartError::Usage(format!(
        "chart {path}: a colour image without wavelengths; convert it with `lenscube chart image {path} CHART.zarr`"
    )))
}

/// Fails for a URL: flat files are mapped into memory.
fn check_local(spec: &str) -> Result<(), ChartError> {
    match is_url(Path::new(spec)) {
        true => Err(ChartError::Usage(format!(
            "chart `{spec}`: only Zarr stores are supported at a URL; copy the file to a local disk"
        ))),
        false => Ok(()),
    }
}
