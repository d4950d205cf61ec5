//! Opening what the command line names: charts (stores or generators) and lenses (packs or built in).

use crate::design;
use crate::failure::usage;
use crate::memory::Chunks;
use crate::progress::{counting, say};
use anyhow::{Context, Result};
use formats::chart::exr::{ExrChart, ExrContent};
use formats::chart::{
    ChartOptions, ChartStore, Interleave, NanPolicy, RasterChart, RasterLayout, sample_named,
};
use formats::durable::is_url;
use formats::lens::{LensPack, builtin, builtin_names};
use pipeline::chart::{Generator, Kind};
use pipeline::flow::ChartSource;
use pipeline::geometry::Size;
use serde_json::{Value, json};
use std::path::Path;

/// A chart, wherever it comes from.
pub enum Chart {
    /// A Zarr array.
    Store(Box<ChartStore>),
    /// A flat file.
    Raster(Box<RasterChart>),
    /// A spectral OpenEXR file.
    Exr(Box<ExrChart>),
    /// Drawn on the fly.
    Drawn(Box<Generator>),
}

impl Chart {
    /// Opens `PATH`, `PATH//array` or `gen:KIND?…`.
    pub fn open(spec: &str, wavelengths: Option<&str>, nan: NanPolicy, cache_bytes: usize) -> Result<Self> {
        let declared = wavelengths.map(pipeline::wavelengths::parse).transpose();
        let declared = declared.map_err(|e| usage(format!("--wavelengths: {e}")))?;
        if let Some(drawn) = spec.strip_prefix("gen:") {
            let mut spec: pipeline::chart::ChartSpec =
                drawn.parse().map_err(|e| usage(format!("chart `{spec}`: {e}")))?;
            if let Some(nm) = declared {
                spec.wavelengths_nm = nm;
            }
            let generator = Generator::new(spec).map_err(|e| usage(format!("chart `gen:{drawn}`: {e}")))?;
            return Ok(Self::Drawn(Box::new(generator)));
        }
        if ExrChart::is_one(Path::new(spec)) {
            return Self::exr(ExrChart::open(Path::new(spec), nan)?, declared);
        }
        if RasterChart::is_one(Path::new(spec)) {
            on_disk(spec)?;
            return Self::flat(RasterChart::open(Path::new(spec), nan)?, declared);
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
        on_disk(spec)?;
        let declared = wavelengths.map(pipeline::wavelengths::parse).transpose();
        let declared = declared.map_err(|e| usage(format!("--wavelengths: {e}")))?;
        let sides: Option<Vec<usize>> = shape.split(',').map(|w| w.trim().parse().ok()).collect();
        let Some(&[bands, rows, columns]) = sides.as_deref() else {
            return Err(usage(format!("--chart-shape {shape}: expected BANDS,ROWS,COLUMNS")));
        };
        let Some((sample, little_endian)) = sample_named(dtype) else {
            return Err(usage(format!(
                "--chart-dtype {dtype}: expected u1, u2, f2, f4 or f8, `>` before it for highest byte first"
            )));
        };
        let shape = [bands, rows, columns];
        let layout = RasterLayout { shape, interleave: Interleave::Bsq, sample, little_endian, offset: 0 };
        Self::flat(RasterChart::raw(Path::new(spec), layout, nan)?, declared)
    }

    fn flat(chart: RasterChart, declared: Option<Vec<f64>>) -> Result<Self> {
        Ok(Self::Raster(Box::new(match declared {
            Some(nm) => chart.with_wavelengths(nm)?,
            None => chart,
        })))
    }

    fn exr(chart: ExrChart, declared: Option<Vec<f64>>) -> Result<Self> {
        if !matches!(chart.content(), ExrContent::Spectral { .. }) {
            return Err(usage(format!(
                "chart {}: an image of colours, not of wavelengths; `lenscube chart image {} CHART.zarr` makes a chart of it",
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
            Self::Drawn(g) => g.as_ref(),
        }
    }

    /// Lays out `bands` one after the other in a temporary file in `directory` where they would otherwise be fetched or decoded
    /// once per band; says so.
    pub fn lay_out(&mut self, bands: &[usize], directory: &Path, threads: usize) -> Result<()> {
        let (bar, progress) = counting("laying the chart's bands out");
        match self {
            Self::Raster(raster) if bands.len() > 1 && raster.must_be_laid_out() => {
                say("the chart's bands interleave: laying them out once in a temporary file");
                raster.in_bands(bands, directory, &progress)?;
            }
            Self::Store(store) if store.rechunk_needed(bands) => {
                say(
                    "the chart's chunks span several bands: re-chunking them once into a temporary file beside the output",
                );
                store.rechunk(bands, directory, threads, &progress)?;
            }
            Self::Exr(exr) => {
                say(
                    "the chart is compressed, its bands line by line: laying them out once in a temporary file",
                );
                exr.lay_out(bands, directory, threads, &progress)?;
            }
            _ => (),
        }
        bar.finish_and_clear();
        Ok(())
    }

    /// Rows and columns that are decoded at once; one pixel where nothing is.
    pub fn piece(&self) -> Size {
        match self {
            Self::Store(s) => Size::new(s.piece_shape()[1], s.piece_shape()[2]),
            Self::Raster(_) | Self::Exr(_) | Self::Drawn(_) => Size::new(1, 1),
        }
    }

    /// Bytes of cache with which strips of `rows` rows, one after the other, decode nothing twice.
    pub fn cache_for_rows(&self, rows: usize) -> usize {
        match self {
            Self::Store(s) => s.cache_for_rows(rows),
            Self::Raster(_) | Self::Exr(_) | Self::Drawn(_) => 0,
        }
    }

    /// What its chunks take in memory while `bands` are read one after the other.
    pub fn chunks(&self, bands: &[usize]) -> Chunks {
        match self {
            Self::Store(s) => store_chunks(s, bands),
            Self::Exr(e) => Chunks { splitting: 3 * e.block_bytes(), ..Chunks::default() },
            Self::Raster(_) | Self::Drawn(_) => Chunks::default(),
        }
    }

    /// Size in pixels.
    pub fn size(&self) -> Size {
        self.source().size()
    }

    /// Wavelength of every band in nm.
    pub fn wavelengths_nm(&self) -> Result<Vec<f64>> {
        match self {
            Self::Drawn(g) => Ok(g.wavelengths_nm().to_vec()),
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
            Self::Drawn(g) => Some(g.pitch_um()),
        }
    }

    /// Size of the film that it was made for.
    pub fn film_size(&self) -> Option<Size> {
        match self {
            Self::Store(s) => s.film_size(),
            Self::Raster(_) | Self::Exr(_) => None,
            Self::Drawn(g) => Some(g.film_size()),
        }
    }

    /// What its values are.
    pub fn units(&self) -> Option<&str> {
        match self {
            Self::Store(s) => s.units(),
            Self::Raster(_) => None,
            Self::Exr(e) => e.units(),
            Self::Drawn(g) => Some(g.units()),
        }
    }

    /// Makes values an error that are beyond `largest` in magnitude, where the reader's own limit is larger. Call it before
    /// anything is read.
    pub fn limit_values(&mut self, largest: f32) -> Result<()> {
        match self {
            Self::Store(s) => s.limit_values(largest),
            Self::Raster(r) => r.limit_values(largest),
            Self::Exr(e) => e.limit_values(largest),
            Self::Drawn(g) => {
                if let Kind::Uniform { value } = g.spec().kind
                    && value.abs() > f64::from(largest)
                {
                    return Err(usage(format!(
                        "chart `gen:uniform`: value={value:e}: expected at most {largest:e} in magnitude, so that 32-bit sums do \
                         not overflow"
                    )));
                }
            }
        }
        Ok(())
    }

    /// What the user should know of how its values are read, a line each.
    pub fn notes(&self) -> Vec<String> {
        match self {
            Self::Store(s) => {
                let words = |(scale, offset): (f64, f64)| {
                    format!(
                        "the chart's scale_factor and add_offset are applied: value = sample · {scale} + {offset}"
                    )
                };
                s.scaling().map(words).into_iter().collect()
            }
            Self::Raster(r) => r.notes().to_vec(),
            Self::Exr(_) | Self::Drawn(_) => Vec::new(),
        }
    }

    /// What makes it this chart and no other, for the job's digest: what it is, and when its files were last changed.
    pub fn identity(&self) -> Result<(Value, Value)> {
        Ok(match self {
            Self::Store(s) => {
                let identity = s.identity().context("listing the chart's chunks")?;
                (json!({ "store": identity.content }), json!(identity.mtimes))
            }
            Self::Raster(r) => r.identity()?,
            Self::Exr(e) => e.identity()?,
            Self::Drawn(g) => (json!({ "drawn": g.spec().to_string() }), Value::Null),
        })
    }
}

fn store_chunks(store: &ChartStore, bands: &[usize]) -> Chunks {
    let ([chunk_bands, rows, columns], size) = (store.piece_shape(), store.size());
    let held_bands = chunk_bands.min(store.bands());
    let pixels = rows.min(size.height) * columns.min(size.width);
    let count = size.height.div_ceil(rows) * size.width.div_ceil(columns);
    let (encoded, values) = (chunk_bands * rows * columns * store.sample().bytes(), 4 * held_bands * pixels);
    let apart = 4 * pixels;
    // Laid out apart a band's part is read as bytes and values; while they are laid out, all of it is held.
    match held_bands > 1 && bands.len() > 1 {
        true => Chunks { count, loading: apart, values: apart, splitting: 2 * encoded + values + apart },
        false => Chunks { count, loading: 2 * encoded, values, splitting: 0 },
    }
}

/// Flat files are mapped into memory.
fn on_disk(spec: &str) -> Result<()> {
    match is_url(Path::new(spec)) {
        true => Err(usage(format!("chart `{spec}`: at a URL only Zarr stores are read; copy the file here"))),
        false => Ok(()),
    }
}

fn no_wavelengths(path: &Path, bands: usize) -> anyhow::Error {
    usage(format!(
        "chart {} does not tell the wavelengths of its {bands} bands; say them, e.g. `--wavelengths 400:700:10`",
        path.display()
    ))
}

/// Whether a lens's name is that of a lens inside the program. Such a name never means a file: `./NAME` does.
pub fn is_builtin(name: &str) -> bool {
    name == design::BUILTIN || builtin_names().any(|known| known == name)
}

/// Opens a lens pack, or one inside the program by its name.
pub fn lens(name: &str) -> Result<LensPack> {
    if builtin_names().any(|known| known == name) {
        return Ok(builtin(name)?);
    }
    let path = Path::new(name);
    if !path.exists() && !name.contains(['/', '.']) {
        let known: Vec<_> = [design::BUILTIN].into_iter().chain(builtin_names()).collect();
        return Err(usage(format!(
            "`{name}` is neither a lens pack nor a built-in lens ({}); give the path of a *.lens.zarr, its .zip or a .zmx",
            known.join(", ")
        )));
    }
    Ok(LensPack::open(path)?)
}
