//! Opens charts (stores, files, generators) and lens packs by the names in the arguments.

use crate::design;
use crate::failure::usage;
use crate::progress::{counting, log_line};
use anyhow::{Context, Result};
use formats::chart::exr::{ExrChart, ExrContent};
use formats::chart::{
    ChartOptions, ChartStore, ChunkMemory, Interleave, NanPolicy, RasterChart, RasterLayout, parse_dtype,
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
    /// A spectral OpenEXR file.
    Exr(Box<ExrChart>),
    /// Generated on demand.
    Generated(Box<Generator>),
}

impl Chart {
    /// Opens `PATH`, `PATH//array` or `gen:KIND?…`.
    pub fn open(spec: &str, wavelengths: Option<&str>, nan: NanPolicy, cache_bytes: usize) -> Result<Self> {
        let declared = declared_nm(wavelengths)?;
        if let Some(drawn) = spec.strip_prefix("gen:") {
            let mut spec: pipeline::chart::ChartSpec =
                drawn.parse().map_err(|e| usage(format!("chart `{spec}`: {e}")))?;
            if let Some(nm) = declared {
                spec.wavelengths_nm = nm;
            }
            let generator = Generator::new(spec).map_err(|e| usage(format!("chart `gen:{drawn}`: {e}")))?;
            return Ok(Self::Generated(Box::new(generator)));
        }
        if ExrChart::is_supported_path(Path::new(spec)) {
            return Self::exr(ExrChart::open(Path::new(spec), nan)?, declared);
        }
        if RasterChart::is_supported_path(Path::new(spec)) {
            check_local(spec)?;
            return Self::raster(RasterChart::open(Path::new(spec), nan)?, declared);
        }
        let options = ChartOptions { cache_bytes, nan, wavelengths_nm: declared };
        Ok(Self::Store(Box::new(ChartStore::open(spec, options)?)))
    }

    /// Opens raw samples of `shape` = `BANDS,ROWS,COLUMNS` and NumPy's type `dtype`, band after band.
    pub fn raw(
        spec: &str,
        shape: &str,
        dtype: &str,
        wavelengths: Option<&str>,
        nan: NanPolicy,
    ) -> Result<Self> {
        check_local(spec)?;
        let declared = declared_nm(wavelengths)?;
        let sides: Option<Vec<usize>> = shape.split(',').map(|w| w.trim().parse().ok()).collect();
        let Some(&[bands, rows, columns]) = sides.as_deref() else {
            return Err(usage(format!("--chart-shape {shape}: expected BANDS,ROWS,COLUMNS")));
        };
        let Some((sample, little_endian)) = parse_dtype(dtype) else {
            return Err(usage(format!(
                "--chart-dtype {dtype}: expected u8, u16, f16, f32 or f64, prefix `>` for big-endian; or NumPy's u1, u2, f2, f4, f8"
            )));
        };
        let shape = [bands, rows, columns];
        let layout = RasterLayout { shape, interleave: Interleave::Bsq, sample, little_endian, offset: 0 };
        Self::raster(RasterChart::raw(Path::new(spec), layout, nan)?, declared)
    }

    fn raster(chart: RasterChart, declared: Option<Vec<f64>>) -> Result<Self> {
        Ok(Self::Raster(Box::new(match declared {
            Some(nm) => chart.with_wavelengths(nm)?,
            None => chart,
        })))
    }

    fn exr(chart: ExrChart, declared: Option<Vec<f64>>) -> Result<Self> {
        if !matches!(chart.content(), ExrContent::Spectral { .. }) {
            return Err(usage(format!(
                "chart {}: a colour image without wavelengths; convert it with `lenscube chart image {} CHART.zarr`",
                chart.path().display(),
                chart.path().display()
            )));
        }
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
            Self::Raster(_) | Self::Exr(_) | Self::Generated(_) => Size::new(1, 1),
        }
    }

    /// Bytes of cache with which tiles of `rows` rows, read row by row, decode no chunk twice, and a drawn chart no edge.
    pub fn cache_for_rows(&self, rows: usize) -> usize {
        match self {
            Self::Store(s) => s.cache_for_rows(rows),
            Self::Generated(g) => g.useful_cache_bytes(),
            Self::Raster(_) | Self::Exr(_) => 0,
        }
    }

    /// Memory of its chunks while `bands` are read one after the other.
    pub fn chunk_memory(&self, bands: &[usize]) -> ChunkMemory {
        match self {
            Self::Store(s) => s.chunk_memory(bands),
            Self::Exr(e) => e.chunk_memory(),
            Self::Raster(_) | Self::Generated(_) => ChunkMemory::default(),
        }
    }

    /// Sets the size of the cache of decoded chunks, or of drawn edges, and empties it.
    pub fn set_cache_bytes(&mut self, bytes: usize) {
        match self {
            Self::Store(store) => store.set_cache_bytes(bytes),
            Self::Generated(generator) => generator.set_cache_bytes(bytes),
            Self::Raster(_) | Self::Exr(_) => (),
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
            Self::Raster(_) | Self::Exr(_) => None,
            Self::Generated(g) => Some(g.pitch_um()),
        }
    }

    /// Size of the film that it was made for, if it is known.
    pub fn film_size(&self) -> Option<Size> {
        match self {
            Self::Store(s) => s.film_size(),
            Self::Raster(_) | Self::Exr(_) => None,
            Self::Generated(g) => Some(g.film_size()),
        }
    }

    /// Units of its values.
    pub fn units(&self) -> Option<&str> {
        match self {
            Self::Store(s) => s.units(),
            Self::Raster(_) => None,
            Self::Exr(e) => e.units(),
            Self::Generated(g) => Some(g.units()),
        }
    }

    /// Limits the magnitude of values to `max`; larger ones are an error. Call it before pixels are read.
    pub fn limit_values(&mut self, max: f32) -> Result<()> {
        match self {
            Self::Store(s) => s.limit_values(max),
            Self::Raster(r) => r.limit_values(max),
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
                        "the chart's scale_factor and add_offset are applied: value = sample · {scale} + {offset}"
                    )
                };
                s.scaling().map(note).into_iter().collect()
            }
            Self::Raster(r) => r.notes().to_vec(),
            Self::Exr(_) | Self::Generated(_) => Vec::new(),
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
    name == design::BUILTIN || builtin_names().any(|known| known == name)
}

/// Opens a lens pack, or a built-in one by its name.
pub fn lens(name: &str) -> Result<LensPack> {
    if builtin_names().any(|known| known == name) {
        return Ok(builtin(name)?);
    }
    let path = Path::new(name);
    if !path.exists() && !name.contains(['/', '.']) {
        let known: Vec<_> = [design::BUILTIN].into_iter().chain(builtin_names()).collect();
        return Err(usage(format!(
            "`{name}` is neither a lens pack nor a built-in lens; give the path of a *.lens.zarr, its .zip or a .zmx; built-in lenses: {}",
            known.join(", ")
        )));
    }
    Ok(LensPack::open(path)?)
}
