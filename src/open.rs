//! Opens charts (stores, files, generators) and lens packs by the names in the arguments.

pub mod access;

use crate::args::DESIGN_FILES;
use crate::design;
use crate::failure::usage;
use anyhow::Result;
use formats::chart::exr::{self, ExrContent, ExrFile};
use formats::chart::hdf5::{self, Hdf5Chart};
use formats::chart::{
    AxisOrder, ChartError, ChartOptions, ChartStore, DecodedChart, NanPolicy, RasterChart, RasterLayout,
    parse_dtype, pictures, split_array,
};
use formats::durable::is_url;
use formats::lens::{LensPack, builtin, builtin_names};
use formats::raw::RawStore;
use pipeline::chart::Generator;
use std::path::Path;

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
}

/// How a chart is read: flags of the command line.
#[derive(Clone, Copy, Default)]
pub struct ChartFlags<'a> {
    /// `--wavelengths`.
    pub wavelengths: Option<&'a str>,
    /// `--chart-shape` and `--chart-dtype`: the file holds raw samples.
    pub raw: Option<(&'a str, &'a str)>,
    /// `--var`.
    pub var: Option<&'a str>,
    /// `--axes`.
    pub axes: Option<&'a AxisOrder>,
    /// `--chart-scale`.
    pub scale: Option<f64>,
    /// `--nan`.
    pub nan: NanPolicy,
    /// Bytes of decoded chunks that are cached.
    pub cache_bytes: usize,
}

impl Chart {
    /// Opens `PATH`, `PATH//array` or `gen:KIND?…` without flags of its format.
    pub fn open(spec: &str, wavelengths: Option<&str>, nan: NanPolicy, cache_bytes: usize) -> Result<Self> {
        Self::open_with(spec, &ChartFlags { wavelengths, nan, cache_bytes, ..ChartFlags::default() })
    }

    /// Opens `PATH`, `PATH//array`, a folder or pattern of pictures, or `gen:KIND?…`.
    pub fn open_with(spec: &str, flags: &ChartFlags<'_>) -> Result<Self> {
        let declared = declared_nm(flags.wavelengths)?;
        let with_var;
        let spec = match flags.var {
            None => spec,
            Some(var) => {
                check_takes_var(spec, var)?;
                with_var = format!("{spec}//{var}");
                &with_var
            }
        };
        let (path, nan, scale) = (Path::new(spec), flags.nan, flags.scale);
        if let Some((shape, dtype)) = flags.raw {
            return Self::raster(Self::raw(spec, shape, dtype, flags)?, declared, scale);
        }
        if let Some(drawn) = spec.strip_prefix("gen:") {
            let given = [("--axes", flags.axes.is_some()), ("--chart-scale", scale.is_some())];
            if let Some((flag, _)) = given.iter().find(|(_, given)| *given) {
                return Err(usage(format!("{flag} applies to charts in files, not to `{spec}`")));
            }
            let mut spec: pipeline::chart::ChartSpec =
                drawn.parse().map_err(|e| usage(format!("chart `{spec}`: {e}")))?;
            if let Some(nm) = declared {
                spec.wavelengths_nm = nm;
            }
            let generator = Generator::new(spec).map_err(|e| usage(format!("chart `gen:{drawn}`: {e}")))?;
            return Ok(Self::Generated(Box::new(generator)));
        }
        let without_axes = |format: &str| match flags.axes {
            None => Ok(()),
            Some(_) => Err(usage(format!(
                "--axes applies to Zarr and HDF5 arrays, .npy and raw samples; chart `{spec}`: {format}"
            ))),
        };
        if exr::is_supported_path(path) {
            without_axes("OpenEXR declares its order")?;
            return Self::decoded(spectral(exr::open(path, nan)?)?, declared, scale);
        }
        if pictures::is_tiff(path) {
            without_axes("TIFF declares its order")?;
            return Self::decoded(pictures::open_tiff(path, nan)?, declared, scale);
        }
        let (file, array) = split_array(spec);
        if hdf5::is_hdf5(Path::new(file)) {
            return match hdf5::open(Path::new(file), array, flags.axes, nan, declared.is_some())? {
                Hdf5Chart::Raster(chart) => Self::raster(*chart, declared, scale),
                Hdf5Chart::Decoded(chart) => Self::decoded(*chart, declared, scale),
            };
        }
        if RasterChart::is_supported_path(path) {
            check_local(spec)?;
            return Self::raster(RasterChart::open_with_axes(path, flags.axes, nan)?, declared, scale);
        }
        if pictures::is_set_of_pictures(spec) {
            without_axes("each picture is a band")?;
            return Self::decoded(pictures::open_set(spec, nan)?, declared, scale);
        }
        let options = ChartOptions {
            cache_bytes: flags.cache_bytes,
            nan,
            wavelengths_nm: declared,
            axes: flags.axes.cloned(),
            scale: scale.unwrap_or(1.0),
        };
        let store = ChartStore::open(spec, options).map_err(|e| match e {
            ChartError::NoArray { .. } if RawStore::is_one(Path::new(file)).unwrap_or(false) => usage(format!(
                "`{spec}` is a raw of a sensor: `lenscube develop` makes a picture of it, `lenscube compare` measures two of them"
            )),
            e => e.into(),
        })?;
        Ok(Self::Store(Box::new(store)))
    }

    /// Opens raw samples of `shape` (`BANDS,ROWS,COLUMNS`, or the sides along `--axes`) and NumPy's type `dtype`.
    fn raw(spec: &str, shape: &str, dtype: &str, flags: &ChartFlags<'_>) -> Result<RasterChart> {
        check_local(spec)?;
        let standard = "wavelength,y,x".parse::<AxisOrder>().expect("a valid order");
        let axes = flags.axes.unwrap_or(&standard);
        let sides: Option<Vec<usize>> = shape.split(',').map(|w| w.trim().parse().ok()).collect();
        let invalid =
            || usage(format!("--chart-shape {shape}: expected the sides along {axes}, e.g. 31,512,512"));
        let sides = sides.ok_or_else(invalid)?;
        let Some((sample, little_endian)) = parse_dtype(dtype) else {
            return Err(usage(format!(
                "--chart-dtype {dtype}: expected u8, u16, f16, f32 or f64, prefix `>` for big-endian; or NumPy's u1, u2, f2, f4, f8"
            )));
        };
        let layout = RasterLayout::raw(&sides, axes, sample, little_endian).map_err(|_| invalid())?;
        Ok(RasterChart::raw(Path::new(spec), layout, flags.nan)?)
    }

    fn raster(chart: RasterChart, declared: Option<Vec<f64>>, scale: Option<f64>) -> Result<Self> {
        let chart = chart.with_scale(scale.unwrap_or(1.0));
        Ok(Self::Raster(Box::new(match declared {
            Some(nm) => chart.with_wavelengths(nm)?,
            None => chart,
        })))
    }

    fn decoded(chart: DecodedChart, declared: Option<Vec<f64>>, scale: Option<f64>) -> Result<Self> {
        let chart = chart.with_scale(scale.unwrap_or(1.0));
        Ok(Self::Decoded(Box::new(match declared {
            Some(nm) => chart.with_wavelengths(nm)?,
            None => chart,
        })))
    }
}

/// The chart of a file with wavelengths.
fn spectral(file: ExrFile) -> Result<DecodedChart> {
    if matches!(file.content, ExrContent::Spectral { .. }) {
        return Ok(file.chart);
    }
    let path = file.chart.path().display();
    Err(usage(format!(
        "chart {path}: a colour image without wavelengths; convert it with `lenscube chart image {path} CHART.zarr`"
    )))
}

/// Fails unless `--var` fits the chart: a store or an HDF5 file without an array in its path.
fn check_takes_var(spec: &str, var: &str) -> Result<()> {
    let (path, array) = split_array(spec);
    if !array.is_empty() {
        return Err(usage(format!("--var {var}: chart `{spec}` names its array already; give one of them")));
    }
    let path = Path::new(path);
    if is_url(path) || !path.is_file() || hdf5::is_hdf5(path) {
        return Ok(());
    }
    Err(usage(format!(
        "--var selects an array of a Zarr store or of HDF5 (.mat v7.3, NetCDF-4), not of `{spec}`"
    )))
}

/// Fails for a URL: flat files are mapped into memory.
fn check_local(spec: &str) -> Result<()> {
    match is_url(Path::new(spec)) {
        true => Err(usage(format!(
            "chart `{spec}`: only Zarr stores are supported at a URL; copy the file to a local disk"
        ))),
        false => Ok(()),
    }
}

/// The wavelengths of `--wavelengths`.
fn declared_nm(wavelengths: Option<&str>) -> Result<Option<Vec<f64>>> {
    let declared = wavelengths.map(pipeline::wavelengths::parse).transpose();
    declared.map_err(|e| usage(format!("--wavelengths: {e}")))
}

/// Whether `name` is that of a built-in lens. Such a name never means a file; `./NAME` does.
pub fn is_builtin(name: &str) -> bool {
    design::builtin_names().chain(builtin_names()).any(|known| known == name)
}

/// Opens a lens pack, or a built-in one by its name.
pub fn lens(name: &str) -> Result<LensPack> {
    if builtin_names().any(|known| known == name) {
        return Ok(builtin(name)?);
    }
    let path = Path::new(name);
    if !path.exists() && !name.contains(['/', '.']) {
        let known: Vec<_> = design::builtin_names().chain(builtin_names()).collect();
        return Err(usage(format!(
            "`{name}` is neither a lens pack nor a built-in lens; give the path of a *.lens.zarr, its .zip or a design ({DESIGN_FILES}); built-in lenses: {}",
            known.join(", ")
        )));
    }
    Ok(LensPack::open(path)?)
}
