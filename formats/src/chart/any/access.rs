//! What a job needs of a chart of any format.

use std::path::Path;

use pipeline::chart::Kind;
use pipeline::flow::ChartSource;
use pipeline::geometry::Size;
use pipeline::projection::Projection;
use serde_json::{Value, json};

use super::Chart;
use crate::chart::content::{self, DataFile};
use crate::chart::error::ChartError;
use crate::chart::header::FileArray;
use crate::chart::memory::ChunkMemory;
use crate::chart::store::ReadStats;
use crate::durable::is_url;
use crate::sample::{RasterSample, Sample};

impl Chart {
    /// The pixels.
    pub fn source(&self) -> &dyn ChartSource {
        match self {
            Self::Store(s) => s.as_ref(),
            Self::Raster(r) => r.as_ref(),
            Self::Decoded(p) => p.as_ref(),
            Self::Generated(g) => g.as_ref(),
            Self::Scene(s) => s.as_ref(),
            Self::Array(a) => a.as_ref(),
        }
    }

    /// What is said before the chart is sorted by band into a temporary file; `None` if its bands are read as they are stored.
    pub fn sorting_note(&self, bands: &[usize]) -> Option<String> {
        let copying =
            |reason: &str| format!("copying the chart's bands once into a temporary file ({reason})");
        match self {
            Self::Raster(raster) if bands.len() > 1 && raster.needs_band_copy() => {
                Some(copying("they are interleaved"))
            }
            Self::Store(store) if store.rechunk_needed(bands) => Some(copying("chunks span several of them")),
            Self::Decoded(_) => Some(
                "the chart's files are compressed or in parts: decoding its bands once into a temporary file"
                    .into(),
            ),
            _ => None,
        }
    }

    /// Sorts the chart by band into a temporary file in `directory`; `progress` receives the steps done and all.
    ///
    /// # Errors
    /// The chart cannot be read; the file cannot be written.
    pub fn sort_by_band(
        &mut self,
        bands: &[usize],
        directory: &Path,
        threads: usize,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<(), ChartError> {
        match self {
            Self::Raster(raster) => raster.copy_bands(bands, directory, progress),
            Self::Store(store) => store.rechunk(bands, directory, threads, progress),
            Self::Decoded(chart) => chart.copy_bands(bands, directory, threads, progress),
            Self::Generated(_) | Self::Scene(_) | Self::Array(_) => Ok(()),
        }
    }

    /// Bytes of the temporary file of [`Chart::sort_by_band`]; 0 without one.
    pub fn temporary_bytes(&self, bands: &[usize]) -> u64 {
        let sample = match self {
            Self::Raster(raster) if bands.len() > 1 && raster.needs_band_copy() => size_of::<f32>(),
            Self::Store(store) if store.rechunk_needed(bands) => size_of::<f32>(),
            Self::Decoded(chart) => chart.copied_sample().bytes(),
            _ => 0,
        };
        (bands.len() * self.size().pixels() * sample) as u64
    }

    /// The plane on which it lies.
    pub fn projection(&self) -> Projection {
        match self {
            Self::Scene(scene) => scene.projection(),
            Self::Store(_) | Self::Raster(_) | Self::Decoded(_) | Self::Generated(_) | Self::Array(_) => {
                Projection::Planar
            }
        }
    }

    /// Rows and columns of a chunk; one pixel where the chart has none.
    pub fn chunk_size(&self) -> Size {
        match self {
            Self::Store(s) => Size::new(s.chunk_shape()[1], s.chunk_shape()[2]),
            Self::Scene(s) => Size::new(s.weights().chunk_shape()[1], s.weights().chunk_shape()[2]),
            Self::Raster(_) | Self::Decoded(_) | Self::Generated(_) | Self::Array(_) => Size::new(1, 1),
        }
    }

    /// Bytes of cache with which tiles of `rows` rows, read row by row, decode no chunk twice, and a drawn chart no edge.
    pub fn cache_for_rows(&self, rows: usize) -> usize {
        match self {
            Self::Store(s) => s.cache_for_rows(rows),
            Self::Generated(g) => g.useful_cache_bytes(),
            Self::Scene(s) => s.bases() * s.weights().cache_for_rows(rows),
            Self::Raster(_) | Self::Decoded(_) | Self::Array(_) => 0,
        }
    }

    /// Memory of its chunks while `bands` are read one after the other.
    pub fn chunk_memory(&self, bands: &[usize]) -> ChunkMemory {
        match self {
            Self::Store(s) => s.chunk_memory(bands),
            Self::Decoded(p) => p.chunk_memory(),
            Self::Scene(s) => s.weights().chunk_memory(&s.all_bases()),
            Self::Raster(_) | Self::Generated(_) | Self::Array(_) => ChunkMemory::default(),
        }
    }

    /// Sets the size of the cache of decoded chunks, or of drawn edges, and empties it.
    pub fn set_cache_bytes(&mut self, bytes: usize) {
        match self {
            Self::Store(store) => store.set_cache_bytes(bytes),
            Self::Generated(generator) => generator.set_cache_bytes(bytes),
            Self::Scene(scene) => scene.weights_mut().set_cache_bytes(bytes),
            Self::Raster(_) | Self::Decoded(_) | Self::Array(_) => (),
        }
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        match self {
            Self::Store(s) => s.bands(),
            Self::Raster(r) => r.bands(),
            Self::Decoded(p) => p.bands(),
            Self::Generated(g) => g.wavelengths_nm().len(),
            Self::Scene(s) => s.wavelengths_nm().len(),
            Self::Array(a) => a.wavelengths_nm().len(),
        }
    }

    /// Bytes of a sample as it is read: those of the temporary file of a decoded chart; 0 for a generated one.
    pub fn sample_bytes(&self) -> usize {
        match self {
            Self::Store(s) => s.sample().bytes(),
            Self::Raster(r) => r.sample().bytes(),
            Self::Decoded(p) => p.copied_sample().bytes(),
            Self::Scene(s) => s.bases() * size_of::<f32>(),
            Self::Generated(_) => 0,
            Self::Array(_) => size_of::<f32>(),
        }
    }

    /// Whether the numbers of its file have 16 bits.
    pub fn is_f16(&self) -> bool {
        match self {
            Self::Store(s) => s.sample() == Sample::F16,
            Self::Raster(r) => r.sample() == RasterSample::Plain(Sample::F16),
            // Channels of OpenEXR are decoded to 32 bits.
            Self::Decoded(p) => {
                p.identity().is_ok_and(|(content, _)| content["exr"]["channels"][0]["sample"] == "f16")
            }
            Self::Generated(_) | Self::Scene(_) | Self::Array(_) => false,
        }
    }

    /// What was read so far; `None` for a generated chart.
    pub fn stats(&self) -> Option<ReadStats> {
        let flat =
            |(bytes_read, nan_replaced)| ReadStats { bytes_read, nan_replaced, ..ReadStats::default() };
        match self {
            Self::Store(s) => Some(s.stats()),
            Self::Raster(r) => Some(flat(r.stats())),
            Self::Decoded(p) => Some(flat(p.stats())),
            Self::Scene(s) => Some(s.weights().stats()),
            Self::Generated(_) | Self::Array(_) => None,
        }
    }

    /// The array of an HDF5 file that it was opened from, and the path of the file.
    pub fn hdf5_array(&self) -> Option<(&Path, &FileArray)> {
        match self {
            Self::Raster(raster) => Some((raster.path(), raster.array()?)),
            Self::Decoded(decoded) => Some((decoded.path(), decoded.array()?)),
            Self::Store(_) | Self::Generated(_) | Self::Scene(_) | Self::Array(_) => None,
        }
    }

    /// An attribute of its array that is text.
    pub fn text_attribute(&self, key: &str) -> Option<&str> {
        match self {
            Self::Store(store) => store.text_attribute(key),
            _ => self.hdf5_array()?.1.text_attribute(key),
        }
    }

    /// Size in pixels.
    pub fn size(&self) -> Size {
        self.source().size()
    }

    /// Wavelength of every band in nm.
    pub fn wavelengths_nm(&self) -> Result<Vec<f64>, ChartError> {
        match self {
            Self::Generated(g) => Ok(g.wavelengths_nm().to_vec()),
            Self::Scene(s) => Ok(s.wavelengths_nm().to_vec()),
            Self::Array(a) => Ok(a.wavelengths_nm().to_vec()),
            Self::Raster(r) => {
                r.wavelengths_nm().map(<[f64]>::to_vec).ok_or_else(|| no_wavelengths(r.path(), r.bands()))
            }
            Self::Decoded(p) => p.wavelengths_nm().map(<[f64]>::to_vec).ok_or_else(|| match p.is_set() {
                true => ChartError::Usage(format!(
                    "chart {}: expected one number of 200 to 2500 (nm) at the same position in the name of each of the {} pictures; give \
                     the wavelengths in their order, e.g. `--wavelengths 400:700:10`",
                    p.path().display(),
                    p.bands()
                )),
                false => no_wavelengths(p.path(), p.bands()),
            }),
            Self::Store(s) => {
                s.wavelengths_nm().map(<[f64]>::to_vec).ok_or_else(|| no_wavelengths(s.path(), s.bands()))
            }
        }
    }

    /// Pixel pitch in µm, if it is known.
    pub fn pitch_um(&self) -> Option<f64> {
        match self {
            Self::Store(s) => s.pitch_um(),
            Self::Raster(_) | Self::Decoded(_) | Self::Array(_) => None,
            Self::Generated(g) => Some(g.pitch_um()),
            Self::Scene(s) => Some(s.pitch_um()),
        }
    }

    /// Size of the film that it was made for, if it is known.
    pub fn film_size(&self) -> Option<Size> {
        match self {
            Self::Store(s) => s.film_size(),
            Self::Raster(_) | Self::Decoded(_) | Self::Array(_) => None,
            Self::Generated(g) => Some(g.film_size()),
            Self::Scene(s) => s.film_size(),
        }
    }

    /// Units of its values.
    pub fn units(&self) -> Option<&str> {
        match self {
            Self::Store(s) => s.units(),
            Self::Raster(r) => r.units(),
            Self::Decoded(p) => p.units(),
            Self::Generated(g) => Some(g.units()),
            Self::Scene(_) => Some(super::super::scene::UNITS),
            Self::Array(_) => None,
        }
    }

    /// Name of the illuminant whose colour is its white, if it is recorded.
    pub fn light(&self) -> Option<String> {
        match self {
            Self::Store(s) => s.light(),
            Self::Generated(g) => Some(g.spec().light().name().to_owned()),
            Self::Scene(s) => Some(s.illuminant().to_owned()),
            Self::Raster(_) | Self::Decoded(_) | Self::Array(_) => None,
        }
    }

    /// Limits the magnitude of values to `max`; larger ones are an error. Call it before pixels are read.
    pub fn limit_values(&mut self, max: f32) -> Result<(), ChartError> {
        match self {
            Self::Store(s) => s.limit_values(max),
            Self::Raster(r) => r.limit_values(max),
            Self::Decoded(p) => p.limit_values(max),
            Self::Scene(s) => s.limit_values(max),
            Self::Array(a) => a.limit_values(max),
            Self::Generated(g) => {
                if let Kind::Uniform { value } = g.spec().kind
                    && value.abs() > f64::from(max)
                {
                    return Err(ChartError::Usage(format!(
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
            Self::Decoded(p) => p.notes().to_vec(),
            Self::Scene(s) => s.notes(),
            Self::Generated(_) | Self::Array(_) => Vec::new(),
        }
    }

    /// Whether it is a store whose note contains scale and offset.
    pub fn is_scaled_store(&self) -> bool {
        matches!(self, Self::Store(_)) && self.is_scaled()
    }

    /// Whether its values are its samples times a factor, or plus an offset.
    pub fn is_scaled(&self) -> bool {
        match self {
            Self::Store(s) => s.scaling().is_some(),
            Self::Raster(r) => r.is_scaled(),
            Self::Decoded(p) => p.is_scaled(),
            Self::Generated(_) | Self::Scene(_) | Self::Array(_) => false,
        }
    }

    /// Whether its samples are integers.
    pub fn has_integer_samples(&self) -> bool {
        match self {
            Self::Store(s) => RasterSample::Plain(s.sample()).is_integer(),
            Self::Raster(r) => r.sample().is_integer(),
            Self::Decoded(p) => p.sample().is_integer(),
            Self::Generated(_) | Self::Scene(_) | Self::Array(_) => false,
        }
    }

    /// Digest of the bytes of its files, all of which are read; null if it is generated. For `--check-input`.
    ///
    /// # Errors
    /// Usage: it is at a URL. A file cannot be read, or changes meanwhile.
    pub fn content_digest(&self) -> Result<Value, ChartError> {
        match self {
            Self::Store(s) => check_has_files(s.path())?,
            Self::Scene(s) => check_has_files(s.path())?,
            Self::Raster(_) | Self::Decoded(_) | Self::Generated(_) | Self::Array(_) => {}
        }
        Ok(json!(self.data_files()?.as_deref().map(content::digest).transpose()?))
    }

    /// Digest of a sample of the bytes of its files; null without local files.
    ///
    /// # Errors
    /// [`ChartError`] if a file cannot be read.
    pub fn content_sample(&self) -> Result<Value, ChartError> {
        Ok(json!(self.data_files()?.as_deref().map(content::sample).transpose()?))
    }

    /// Its local files with pixels, if it has any.
    fn data_files(&self) -> Result<Option<Vec<DataFile>>, ChartError> {
        Ok(match self {
            Self::Store(s) if !is_url(s.path()) => Some(s.data_files()?),
            Self::Scene(s) if !is_url(s.path()) => Some(s.weights().data_files()?),
            Self::Raster(r) => Some(r.data_files()),
            Self::Decoded(p) => Some(p.data_files()),
            Self::Store(_) | Self::Scene(_) | Self::Generated(_) | Self::Array(_) => None,
        })
    }

    /// Identity for the job's digest: its content (names and sizes of files, parameters), and the modification times of its files.
    pub fn identity(&self) -> Result<(Value, Value), ChartError> {
        Ok(match self {
            Self::Store(s) => {
                let identity = s.identity()?;
                (json!({ "store": identity.content }), json!(identity.mtimes))
            }
            Self::Raster(r) => r.identity()?,
            Self::Decoded(p) => p.identity()?,
            Self::Scene(s) => s.identity()?,
            Self::Generated(g) => (json!({ "drawn": g.spec().to_string() }), Value::Null),
            Self::Array(a) => {
                (json!({ "array": [a.wavelengths_nm(), [a.size().height, a.size().width]] }), Value::Null)
            }
        })
    }
}

/// Fails for a URL, which `--check-input` does not read.
///
/// # Errors
/// Usage.
pub fn check_has_files(path: &Path) -> Result<(), ChartError> {
    match is_url(path) {
        true => Err(ChartError::Usage(format!(
            "--check-input: expected local files, found {}, whose objects are identified by their ETags; leave it out, or copy the chart to a \
             local disk",
            path.display()
        ))),
        false => Ok(()),
    }
}

fn no_wavelengths(path: &Path, bands: usize) -> ChartError {
    ChartError::Usage(format!(
        "chart {} has no wavelengths for its {bands} bands; give them, e.g. `--wavelengths 400:700:10`",
        path.display()
    ))
}
