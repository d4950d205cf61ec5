//! Opens charts (stores, files, generators) and lens packs by the names in the arguments.

use crate::design;
use crate::failure::usage;
use crate::progress::{counting, log_line};
use anyhow::{Context, Result};
use formats::chart::exr::{ExrChart, ExrContent};
use formats::chart::{
    AxisOrder, ChartOptions, ChartStore, ChunkMemory, NanPolicy, PictureChart, RasterChart, RasterLayout,
    RasterSample, parse_dtype,
};
use formats::durable::is_url;
use formats::lens::{LensPack, builtin, builtin_names};
use pipeline::chart::{Generator, Kind};
use pipeline::flow::ChartSource;
use pipeline::geometry::Size;
use serde_json::{Value, json};
use std::path::Path;

/// A chart of any format.
pub enum Chart {
    /// A Zarr array.
    Store(Box<ChartStore>),
    /// A flat file.
    Raster(Box<RasterChart>),
    /// Pictures, one per band, or a TIFF of several bands.
    Pictures(Box<PictureChart>),
    /// A spectral OpenEXR file.
    Exr(Box<ExrChart>),
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
                "--axes applies to Zarr arrays, .npy and raw samples; chart `{spec}`: {format}"
            ))),
        };
        if ExrChart::is_supported_path(path) {
            without_axes("OpenEXR declares its order")?;
            return Self::exr(ExrChart::open(path, nan)?, declared, scale);
        }
        if PictureChart::is_tiff(path) {
            without_axes("TIFF declares its order")?;
            return Self::pictures(PictureChart::open_tiff(path, nan)?, declared, scale);
        }
        if RasterChart::is_supported_path(path) {
            check_local(spec)?;
            return Self::raster(RasterChart::open_with_axes(path, flags.axes, nan)?, declared, scale);
        }
        if PictureChart::is_set_of_pictures(spec) {
            without_axes("each picture is a band")?;
            return Self::pictures(PictureChart::open_set(spec, nan)?, declared, scale);
        }
        let options = ChartOptions {
            cache_bytes: flags.cache_bytes,
            nan,
            wavelengths_nm: declared,
            axes: flags.axes.cloned(),
            scale: scale.unwrap_or(1.0),
        };
        Ok(Self::Store(Box::new(ChartStore::open(spec, options)?)))
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

    fn pictures(chart: PictureChart, declared: Option<Vec<f64>>, scale: Option<f64>) -> Result<Self> {
        let chart = chart.with_scale(scale.unwrap_or(1.0));
        Ok(Self::Pictures(Box::new(match declared {
            Some(nm) => chart.with_wavelengths(nm)?,
            None => chart,
        })))
    }

    fn exr(chart: ExrChart, declared: Option<Vec<f64>>, scale: Option<f64>) -> Result<Self> {
        if !matches!(chart.content(), ExrContent::Spectral { .. }) {
            return Err(usage(format!(
                "chart {}: a colour image without wavelengths; convert it with `lenscube chart image {} CHART.zarr`",
                chart.path().display(),
                chart.path().display()
            )));
        }
        let chart = chart.with_scale(scale.unwrap_or(1.0));
        Ok(Self::Exr(Box::new(match declared {
            Some(nm) => chart.with_wavelengths(nm)?,
            None => chart,
        })))
    }

    /// The pixels.
    pub fn source(&self) -> &dyn ChartSource {
        match self {
            Self::Store(s) => s.as_ref(),
            Self::Raster(r) => r.as_ref(),
            Self::Pictures(p) => p.as_ref(),
            Self::Exr(e) => e.as_ref(),
            Self::Generated(g) => g.as_ref(),
        }
    }

    /// Sorts the chart by band into a temporary file in `directory`, if its bands would otherwise be fetched or decoded once per band;
    /// prints that.
    pub fn sort_by_band(&mut self, bands: &[usize], directory: &Path, threads: usize) -> Result<()> {
        let (bar, progress) = counting("sorting the chart by band");
        match self {
            Self::Raster(raster) if bands.len() > 1 && raster.needs_band_copy() => {
                log_line(copying_bands("they are interleaved"));
                raster.copy_bands(bands, directory, &progress)?;
            }
            Self::Store(store) if store.rechunk_needed(bands) => {
                log_line(copying_bands("chunks span several of them"));
                store.rechunk(bands, directory, threads, &progress)?;
            }
            Self::Pictures(pictures) => {
                log_line(
                    "the chart's bands are stored as pictures: decoding them once into a temporary file",
                );
                pictures.copy_bands(bands, directory, threads, &progress)?;
            }
            Self::Exr(exr) => {
                log_line(copying_bands("the file is compressed line by line"));
                exr.copy_bands(bands, directory, threads, &progress)?;
            }
            _ => (),
        }
        bar.finish_and_clear();
        Ok(())
    }

    /// Rows and columns of a chunk; one pixel where the chart has none.
    pub fn chunk_size(&self) -> Size {
        match self {
            Self::Store(s) => Size::new(s.chunk_shape()[1], s.chunk_shape()[2]),
            Self::Raster(_) | Self::Pictures(_) | Self::Exr(_) | Self::Generated(_) => Size::new(1, 1),
        }
    }

    /// Bytes of cache with which tiles of `rows` rows, read row by row, decode no chunk twice, and a drawn chart no edge.
    pub fn cache_for_rows(&self, rows: usize) -> usize {
        match self {
            Self::Store(s) => s.cache_for_rows(rows),
            Self::Generated(g) => g.useful_cache_bytes(),
            Self::Raster(_) | Self::Pictures(_) | Self::Exr(_) => 0,
        }
    }

    /// Memory of its chunks while `bands` are read one after the other.
    pub fn chunk_memory(&self, bands: &[usize]) -> ChunkMemory {
        match self {
            Self::Store(s) => s.chunk_memory(bands),
            Self::Pictures(p) => p.chunk_memory(),
            Self::Exr(e) => e.chunk_memory(),
            Self::Raster(_) | Self::Generated(_) => ChunkMemory::default(),
        }
    }

    /// Sets the size of the cache of decoded chunks, or of drawn edges, and empties it.
    pub fn set_cache_bytes(&mut self, bytes: usize) {
        match self {
            Self::Store(store) => store.set_cache_bytes(bytes),
            Self::Generated(generator) => generator.set_cache_bytes(bytes),
            Self::Raster(_) | Self::Pictures(_) | Self::Exr(_) => (),
        }
    }

    /// Size in pixels.
    pub fn size(&self) -> Size {
        self.source().size()
    }

    /// Wavelength of every band in nm.
    pub fn wavelengths_nm(&self) -> Result<Vec<f64>> {
        match self {
            Self::Generated(g) => Ok(g.wavelengths_nm().to_vec()),
            Self::Raster(r) => {
                r.wavelengths_nm().map(<[f64]>::to_vec).ok_or_else(|| no_wavelengths(r.path(), r.bands()))
            }
            Self::Pictures(p) => p.wavelengths_nm().map(<[f64]>::to_vec).ok_or_else(|| match p.is_set() {
                true => usage(format!(
                    "chart {}: expected one number of 200 to 2500 (nm) at the same position in the name of each of the {} pictures; give \
                     the wavelengths in their order, e.g. `--wavelengths 400:700:10`",
                    p.path().display(),
                    p.bands()
                )),
                false => no_wavelengths(p.path(), p.bands()),
            }),
            Self::Exr(e) => {
                e.wavelengths_nm().map(<[f64]>::to_vec).ok_or_else(|| no_wavelengths(e.path(), e.bands()))
            }
            Self::Store(s) => {
                s.wavelengths_nm().map(<[f64]>::to_vec).ok_or_else(|| no_wavelengths(s.path(), s.bands()))
            }
        }
    }

    /// Pixel pitch in µm, if it is known.
    pub fn pitch_um(&self) -> Option<f64> {
        match self {
            Self::Store(s) => s.pitch_um(),
            Self::Raster(_) | Self::Pictures(_) | Self::Exr(_) => None,
            Self::Generated(g) => Some(g.pitch_um()),
        }
    }

    /// Size of the film that it was made for, if it is known.
    pub fn film_size(&self) -> Option<Size> {
        match self {
            Self::Store(s) => s.film_size(),
            Self::Raster(_) | Self::Pictures(_) | Self::Exr(_) => None,
            Self::Generated(g) => Some(g.film_size()),
        }
    }

    /// Units of its values.
    pub fn units(&self) -> Option<&str> {
        match self {
            Self::Store(s) => s.units(),
            Self::Raster(_) => None,
            Self::Pictures(p) => p.units(),
            Self::Exr(e) => e.units(),
            Self::Generated(g) => Some(g.units()),
        }
    }

    /// Limits the magnitude of values to `max`; larger ones are an error. Call it before pixels are read.
    pub fn limit_values(&mut self, max: f32) -> Result<()> {
        match self {
            Self::Store(s) => s.limit_values(max),
            Self::Raster(r) => r.limit_values(max),
            Self::Pictures(p) => p.limit_values(max),
            Self::Exr(e) => e.limit_values(max),
            Self::Generated(g) => {
                if let Kind::Uniform { value } = g.spec().kind
                    && value.abs() > f64::from(max)
                {
                    return Err(usage(format!(
                        "chart `gen:uniform`: value={value:e}: expected at most {max:e} in magnitude, so that 32-bit sums do \
                         not overflow"
                    )));
                }
            }
        }
        Ok(())
    }

    /// Notes on how its values are read.
    pub fn notes(&self) -> Vec<String> {
        match self {
            Self::Store(s) => {
                let note = |(scale, offset): (f64, f64)| {
                    format!(
                        "the chart's samples are scaled (scale_factor, add_offset, --chart-scale): value = sample · {scale} + {offset}"
                    )
                };
                s.scaling().map(note).into_iter().collect()
            }
            Self::Raster(r) => r.notes().to_vec(),
            Self::Pictures(p) => p.notes().to_vec(),
            Self::Exr(_) | Self::Generated(_) => Vec::new(),
        }
    }

    /// Whether it is a store whose note contains scale and offset.
    pub fn is_scaled_store(&self) -> bool {
        matches!(self, Self::Store(s) if s.scaling().is_some())
    }

    /// Whether its samples are integers.
    pub fn has_integer_samples(&self) -> bool {
        match self {
            Self::Store(s) => RasterSample::Plain(s.sample()).is_integer(),
            Self::Raster(r) => r.sample().is_integer(),
            Self::Pictures(p) => p.sample().is_integer(),
            Self::Exr(_) | Self::Generated(_) => false,
        }
    }

    /// Identity for the job's digest: its content (names and sizes of files, parameters), and the modification times of its files.
    pub fn identity(&self) -> Result<(Value, Value)> {
        Ok(match self {
            Self::Store(s) => {
                let identity = s.identity().context("listing the chart's chunks")?;
                (json!({ "store": identity.content }), json!(identity.mtimes))
            }
            Self::Raster(r) => r.identity()?,
            Self::Pictures(p) => p.identity()?,
            Self::Exr(e) => e.identity()?,
            Self::Generated(g) => (json!({ "drawn": g.spec().to_string() }), Value::Null),
        })
    }
}

fn copying_bands(reason: &str) -> String {
    format!("copying the chart's bands once into a temporary file ({reason})")
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

fn no_wavelengths(path: &Path, bands: usize) -> anyhow::Error {
    usage(format!(
        "chart {} has no wavelengths for its {bands} bands; give them, e.g. `--wavelengths 400:700:10`",
        path.display()
    ))
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
            "`{name}` is neither a lens pack nor a built-in lens; give the path of a *.lens.zarr, its .zip or a design (.zmx, .seq, .csv, .zar, .json); built-in lenses: {}",
            known.join(", ")
        )));
    }
    Ok(LensPack::open(path)?)
}
