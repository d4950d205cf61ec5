//! Charts decoded from pictures: one grey PNG or TIFF per band (a folder, a pattern), or the bands of one TIFF
//! ([`crate::image::tiff_bands`]).
//!
//! | source | order of the bands | wavelengths |
//! |---|---|---|
//! | `FOLDER`, `'FOLDER/*.png'` | file names, numbers by value | one number of 200 to 2500 nm at the same position in every name ([`names`]) |
//! | TIFF | as stored | GDAL's metadata ([`crate::image::gdal`]) |
//!
//! Samples are values, not colours: no transfer function applies, and integers are counts (unit `counts`) unless they are scaled. GDAL's
//! scale, offset and no-data sample apply. Bands are decoded once to a temporary file ([`PictureChart::copy_bands`]); a read before that
//! call decodes all of them to the system's temporary directory.

mod find;
mod names;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, OnceLock};

use pipeline::bounds;
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use serde_json::{Value, json};

use super::error::ChartError;
use super::file_change::{WatchedFile, modified_ns};
use super::header::{check_declared_wavelengths, check_wavelengths, header_error};
use super::memory::ChunkMemory;
use super::options::NanPolicy;
use super::raster::RasterChart;
use super::raster::bands::BandFile;
use super::values::Values;
use crate::durable::DurableError;
use crate::image::tiff_bands::{TiffBands, TiffPart};
use crate::image::{gdal, png};
use crate::parallel;
use crate::sample::{RasterSample, Sample};

/// Memory of a PNG decoder besides its rows: compressed input, inflate window.
const PNG_DECODER_BYTES: usize = 2 << 20;

/// A chart whose bands are pictures.
#[derive(Debug)]
pub struct PictureChart {
    /// The TIFF, the folder, or the pattern.
    path: PathBuf,
    files: Vec<PictureFile>,
    size: Size,
    bands: usize,
    sample: RasterSample,
    wavelengths_nm: Option<Vec<f64>>,
    values: Values,
    nan: NanPolicy,
    notes: Vec<String>,
    identity: (Value, Value),
    replaced: AtomicU64,
    /// Decoded bands, see [`PictureChart::copy_bands`].
    copy: OnceLock<RasterChart>,
    /// Held while bands are decoded.
    decoding: Mutex<()>,
}

/// A file; if there are several, each is one band.
#[derive(Debug)]
struct PictureFile {
    path: PathBuf,
    format: Format,
    watched: WatchedFile,
}

#[derive(Debug)]
enum Format {
    Png,
    Tiff(TiffBands),
}

/// What a thread decodes at a time.
enum Part {
    Png { file: usize },
    Tiff { file: usize, part: TiffPart },
}

/// A header that was read.
struct Opened {
    file: PictureFile,
    size: Size,
    bands: usize,
    sample: RasterSample,
    state: (u64, u64),
}

fn open_picture(path: &Path) -> Result<Opened, ChartError> {
    let meta = std::fs::metadata(path).map_err(|e| DurableError::io("look up", path, 0, e))?;
    let state = (meta.len(), modified_ns(&meta) as u64);
    let watched = WatchedFile::data(path, &meta);
    let opened = |format, size, bands, sample| Opened {
        file: PictureFile { path: path.into(), format, watched },
        size,
        bands,
        sample,
        state,
    };
    match find::kind(path)? {
        find::Kind::Png => {
            let (header, _) = png::open(path)?;
            if header.channels != 1 {
                let expected = "one grey channel, the samples of a band; a colour picture is converted by `lenscube chart image`";
                return Err(header_error(path, "channels", expected, "red, green and blue, or a palette"));
            }
            let sample = if header.white == 255 { Sample::U8 } else { Sample::U16 };
            Ok(opened(Format::Png, header.size, 1, RasterSample::Plain(sample)))
        }
        find::Kind::Tiff => {
            let tiff = TiffBands::open(path)?;
            let (size, bands, sample) = (tiff.size, tiff.bands, tiff.sample);
            Ok(opened(Format::Tiff(tiff), size, bands, sample))
        }
    }
}

impl PictureChart {
    /// Whether `spec` is a pattern of file names, or a folder of PNG or TIFF files that is not a Zarr store.
    pub fn is_set_of_pictures(spec: &str) -> bool {
        find::is_pattern(spec) || find::is_folder(Path::new(spec))
    }

    /// Whether `path` is a TIFF file, by its first bytes.
    pub fn is_tiff(path: &Path) -> bool {
        path.is_file() && matches!(find::kind(path), Ok(find::Kind::Tiff))
    }

    /// Opens a folder or pattern of pictures, one per band.
    ///
    /// # Errors
    /// [`ChartError`] if there are none, or one is not supported or differs from the first in format, size or sample type.
    pub fn open_set(spec: &str, nan: NanPolicy) -> Result<Self, ChartError> {
        let found = find::pictures(spec)?;
        let mut files = found.paths.iter().map(|path| {
            let opened = open_picture(path)?;
            match opened.bands {
                1 => Ok(opened),
                n => Err(header_error(path, "bands", "one in each picture", n.to_string())),
            }
        });
        let first = files.next().expect("`find` returns at least one")?;
        let mut all = vec![first];
        for next in files {
            let (next, first) = (next?, &all[0]);
            let describe = |o: &Opened| {
                let format = if matches!(o.file.format, Format::Png) { "PNG" } else { "TIFF" };
                format!("{format} of {} px, {}", o.size, o.sample.name())
            };
            if (describe(&next), next.sample) != (describe(first), first.sample) {
                let expected = format!("{}, as {}", describe(first), name_of(&first.file.path));
                return Err(header_error(&next.file.path, "picture", expected, describe(&next)));
            }
            all.push(next);
        }
        let names: Vec<String> = found.paths.iter().map(|p| name_of(p)).collect();
        let wavelengths_nm = names::wavelengths(&names);
        let mut notes = vec![order_note(&names, wavelengths_nm.as_deref())];
        if found.ignored > 0 {
            notes.push(format!("{} other files in {spec} are not used", found.ignored));
        }
        Self::new(Path::new(spec), all, wavelengths_nm, Values::default(), notes, nan)
    }

    /// Opens a TIFF with one or more bands.
    ///
    /// # Errors
    /// [`ChartError`] if its header or GDAL's metadata in it are invalid or not supported.
    pub fn open_tiff(path: &Path, nan: NanPolicy) -> Result<Self, ChartError> {
        let opened = open_picture(path)?;
        let Format::Tiff(tiff) = &opened.file.format else {
            return Err(header_error(path, "first bytes", "those of a TIFF", "something else"));
        };
        let metadata = match &tiff.metadata {
            None => gdal::GdalMetadata::default(),
            Some(xml) => gdal::parse(xml, tiff.bands)
                .map_err(|found| header_error(path, "GDAL metadata (tag 42112)", "valid XML", found))?,
        };
        let mut values = Values { scaling: metadata.scaling, ..Values::default() };
        if let Some(text) = &tiff.no_data {
            let text = text.trim_end_matches('\0').trim();
            let number = text.parse::<f64>().map_err(|_| {
                let found = format!("`{}`", text.chars().take(40).collect::<String>());
                header_error(path, "GDAL no-data value (tag 42113)", "a number", found)
            })?;
            // NaN is no data in any case.
            values.no_data.extend(Some(opened.sample.nearest(number)).filter(|v| v.is_finite()));
        }
        let mut notes = Vec::new();
        if !values.scaling.is_empty() {
            notes
                .push("the TIFF's GDAL scale and offset are applied: value = sample · scale + offset".into());
        }
        Self::new(path, vec![opened], metadata.wavelengths_nm, values, notes, nan)
    }

    fn new(
        path: &Path,
        opened: Vec<Opened>,
        wavelengths_nm: Option<Vec<f64>>,
        values: Values,
        notes: Vec<String>,
        nan: NanPolicy,
    ) -> Result<Self, ChartError> {
        let (size, sample) = (opened[0].size, opened[0].sample);
        let bands: usize = opened.iter().map(|o| o.bands).sum();
        if let Err(e) = bounds::chart_size(bands, size) {
            return Err(header_error(path, e.bound.name, e.bound.to_string(), e.found));
        }
        check_wavelengths(path, wavelengths_nm.as_deref().unwrap_or_default())?;
        let files: Vec<_> =
            opened.iter().map(|o| json!({ "name": name_of(&o.file.path), "bytes": o.state.0 })).collect();
        let content = json!({
            "pictures": files,
            "layout": format!("{size}, {bands} bands, {sample:?}"),
            "wavelengths_nm": wavelengths_nm,
            "values": values.identity(),
        });
        let mtimes = json!(opened.iter().map(|o| o.state.1).collect::<Vec<_>>());
        Ok(Self {
            path: path.into(),
            files: opened.into_iter().map(|o| o.file).collect(),
            size,
            bands,
            sample,
            wavelengths_nm,
            values,
            nan,
            notes,
            identity: (content, mtimes),
            replaced: AtomicU64::new(0),
            copy: OnceLock::new(),
            decoding: Mutex::new(()),
        })
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.bands
    }

    /// Path of the TIFF or folder, or the pattern.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Sample type of the files.
    pub fn sample(&self) -> RasterSample {
        self.sample
    }

    /// Wavelengths in nm, if the names or the metadata contain them.
    pub fn wavelengths_nm(&self) -> Option<&[f64]> {
        self.wavelengths_nm.as_deref()
    }

    /// Replaces the wavelengths.
    ///
    /// # Errors
    /// [`ChartError::Header`] unless there is one per band, each within its bounds.
    pub fn with_wavelengths(mut self, nm: Vec<f64>) -> Result<Self, ChartError> {
        check_declared_wavelengths(&self.path, self.bands, &nm)?;
        self.identity.0["wavelengths_nm"] = json!(nm);
        self.wavelengths_nm = Some(nm);
        Ok(self)
    }

    /// Multiplies all values by `scale`.
    #[must_use]
    pub fn with_scale(mut self, scale: f64) -> Self {
        self.values.multiply(scale);
        self.identity.0["values"] = self.values.identity();
        self
    }

    /// Unit of the values: `counts` for unscaled integers.
    pub fn units(&self) -> Option<&str> {
        (self.sample.is_integer() && self.values.scaling.is_empty()).then_some("counts")
    }

    /// Whether several files are one band each.
    pub fn is_set(&self) -> bool {
        self.files.len() > 1
    }

    /// Remarks for the user, one line each.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Makes values beyond `max_magnitude` an error, instead of those beyond [`MAX_VALUE`](super::MAX_VALUE). To be called before
    /// [`PictureChart::copy_bands`].
    pub fn limit_values(&mut self, max_magnitude: f32) {
        self.values.max_magnitude = max_magnitude;
    }

    /// Everything that determines its values except the samples, and the modification times of the files.
    ///
    /// # Errors
    /// [`ChartError::Changed`] if a file changed after it was opened.
    pub fn identity(&self) -> Result<(Value, Value), ChartError> {
        self.files.iter().try_for_each(|f| f.watched.check_unchanged())?;
        Ok(self.identity.clone())
    }

    /// Bytes of samples read so far, and pixels without data that were read as 0.
    pub fn stats(&self) -> (u64, u64) {
        let (bytes, replaced) = self.copy.get().map_or((0, 0), RasterChart::stats);
        (bytes, replaced + self.replaced.load(Relaxed))
    }

    /// Memory of a decoder while the bands are written to a temporary file.
    pub fn chunk_memory(&self) -> ChunkMemory {
        let decoder = |f: &PictureFile| match &f.format {
            Format::Png => PNG_DECODER_BYTES,
            Format::Tiff(tiff) => tiff.decoder_bytes,
        };
        let line = 24 * self.size.width;
        let rechunking = line + self.files.iter().map(decoder).max().unwrap_or(0);
        ChunkMemory { rechunking, ..ChunkMemory::default() }
    }

    /// Decodes `bands` on `threads` threads to a temporary file in `directory`, from which they are read from then on; other bands can no
    /// longer be read. `progress` receives the numbers of parts done and in total. A second call does nothing.
    ///
    /// # Errors
    /// [`ChartError::Space`] before anything is written; [`ChartError`] if a file does not decode, changed, or has an invalid value.
    pub fn copy_bands(
        &self,
        bands: &[usize],
        directory: &Path,
        threads: usize,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<(), ChartError> {
        let _decoding = self.decoding.lock().expect("no panic while decoding");
        if self.copy.get().is_some() {
            return Ok(());
        }
        let shape = [self.bands, self.size.height, self.size.width];
        let out = BandFile::create(directory, &self.path, bands, shape)?;
        let parts = self.parts(out.bands())?;
        let decoded = parallel::for_each(threads, parts.len(), progress, |n| self.decode(&parts[n], &out));
        self.files.iter().try_for_each(|f| f.watched.check_unchanged())?;
        decoded?;
        let (nm, max) = (self.wavelengths_nm.clone(), self.values.max_magnitude);
        let _ = self.copy.set(RasterChart::from_band_file(&self.path, out, self.nan, nm, max)?);
        Ok(())
    }

    /// The parts that hold `bands`.
    fn parts(&self, bands: &[usize]) -> Result<Vec<Part>, ChartError> {
        if let [PictureFile { path, format: Format::Tiff(tiff), .. }] = &self.files[..] {
            let parts = tiff.parts(path, bands)?;
            return Ok(parts.into_iter().map(|part| Part::Tiff { file: 0, part }).collect());
        }
        let mut all = Vec::new();
        for &file in bands {
            let PictureFile { path, format, .. } = &self.files[file];
            match format {
                Format::Png => all.push(Part::Png { file }),
                Format::Tiff(tiff) => {
                    all.extend(tiff.parts(path, &[0])?.into_iter().map(|part| Part::Tiff { file, part }));
                }
            }
        }
        Ok(all)
    }

    fn decode(&self, part: &Part, out: &BandFile) -> Result<(), ChartError> {
        let mut line = Vec::with_capacity(self.size.width);
        let (Part::Png { file } | Part::Tiff { file, .. }) = part;
        let PictureFile { path, format, .. } = &self.files[*file];
        let mut put = |band: usize, row: usize, column: usize, raw: &[f64]| -> Result<(), ChartError> {
            line.clear();
            let convert = self.values.converter(band);
            line.extend(raw.iter().map(|v| convert(*v)));
            let checked = self.values.check(band, &mut line, |k| raw[k], self.nan);
            if let Some((k, invalid)) = checked.error {
                let pixel = (band, row, column + k);
                return Err(invalid.into_error(path.clone(), pixel, self.values.max_magnitude));
            }
            self.replaced.fetch_add(checked.replaced, Relaxed);
            Ok(out.write(band, row, column, &line)?)
        };
        match (part, format) {
            (Part::Tiff { part, .. }, Format::Tiff(tiff)) => {
                tiff.decode(path, part, &mut |band, row, column, raw| put(file + band, row, column, raw))
            }
            _ => {
                let (header, rows) = png::open(path)?;
                if (header.size, header.channels) != (self.size, 1) {
                    let reason = "it changed after it was opened".into();
                    return Err(ChartError::Damaged { path: path.clone(), reason });
                }
                let (mut raw, mut decoded) = (Vec::with_capacity(self.size.width), 0);
                rows.for_each_row(path, &header, &mut |row, samples| {
                    raw.clear();
                    raw.extend(samples.iter().map(|&v| f64::from(v)));
                    decoded += 1;
                    put(*file, row, 0, &raw)
                })?;
                match decoded == self.size.height {
                    true => Ok(()),
                    false => {
                        let reason = format!("it holds {decoded} rows of {}", self.size.height);
                        Err(ChartError::Damaged { path: path.clone(), reason })
                    }
                }
            }
        }
    }

    /// [`ChartSource::read`] with its own error type.
    ///
    /// # Errors
    /// [`ChartError`] if a file does not decode, or as [`RasterChart::read_rect`].
    pub fn read_rect(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), ChartError> {
        if self.copy.get().is_none() {
            let all: Vec<usize> = (0..self.bands).collect();
            self.copy_bands(&all, &std::env::temp_dir(), 1, &|_, _| ())?;
        }
        self.copy.get().expect("decoded above").read_rect(band, rect, out)
    }
}

impl ChartSource for PictureChart {
    fn size(&self) -> Size {
        self.size
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        Ok(self.read_rect(band, rect, out)?)
    }

    fn prefetch(&self, band: usize, rect: Rect) {
        if let Some(copy) = self.copy.get() {
            copy.prefetch(band, rect);
        }
    }
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or(String::new(), |n| n.to_string_lossy().into_owned())
}

/// The order of the pictures: all of a few, else the first two and the last.
fn order_note(names: &[String], nm: Option<&[f64]>) -> String {
    const ALL: usize = 6;
    let one = |k: usize| match nm {
        Some(nm) => format!("{} ({} nm)", names[k], nm[k]),
        None => names[k].clone(),
    };
    let list = match names.len() {
        0..=ALL => (0..names.len()).map(one).collect::<Vec<_>>().join(", "),
        n => format!("{}, {}, …, {}", one(0), one(1), one(n - 1)),
    };
    let source = if nm.is_some() { " (wavelengths from the names)" } else { "" };
    format!("{} pictures are the bands, in this order{source}: {list}", names.len())
}

#[cfg(test)]
mod tests;
