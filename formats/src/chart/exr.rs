//! OpenEXR as a chart: channels of the spectral layout, or R, G, B (or Y) as an image.
//!
//! Spectral: `S0.400,000000nm` (emissive: values as they are) or `T.400,000000nm` (reflective), wavelengths in nm, µm or m, with a
//! decimal comma or point (Fichet, Pacanowski, Wilkie, JCGT 10(3), 2021); beside them R, G, B are a preview, and S1 to S3
//! polarisation: passed over. One layer, f16 or f32, lines or tiles, every compression that the `exr` crate knows.
//!
//! Samples are compressed and bands interleave line by line, so the file is laid out once, band by band, in a temporary file
//! ([`ExrChart::lay_out`]; whoever reads without that gets it done in the system's temporary directory). Blocks are read one after the
//! other and decoded on all threads; a thread holds one. What a header claims is held against the file's length and a limit per
//! block before anything is allocated; a decoder that breaks on a file is an error of the file.
//! Left out: several layers, deep data, subsampled channels, bispectral images.

use std::fs::File;
use std::io::BufReader;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, OnceLock};
use std::time::UNIX_EPOCH;

use ::exr::block::UncompressedBlock;
use ::exr::block::reader::ChunksReader;
use ::exr::meta::attribute::SampleType;
use ::exr::meta::header::Header;
use ::exr::meta::{BlockDescription, MetaData};
use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};
use serde_json::{Value, json};

use super::raster::bands::BandFile;
use super::watch::Watched;
use super::{ChartError, MAX_VALUE, NanPolicy, RasterChart};
use crate::durable::DurableError;

/// Maximum size in bytes of a decoded block. Each thread holds one, and the `exr` crate takes as much memory for the compressed bytes
/// of a block as its header claims, up to the size of a whole tile, before it reads them.
const MAX_BLOCK_BYTES: usize = 192 << 20;
/// Most channels.
const MAX_CHANNELS: usize = 4096;

/// What the channels are.
#[derive(Clone, Debug, PartialEq)]
pub enum ExrContent {
    /// Bands of light, or of reflectance.
    Spectral {
        /// Wavelength of each band, ascending.
        wavelengths_nm: Vec<f64>,
        /// Shares of the light that is reflected, rather than light.
        reflective: bool,
    },
    /// Red, green, blue.
    Rgb,
    /// One channel of grey.
    Grey,
}

/// A chart in an OpenEXR file.
#[derive(Debug)]
pub struct ExrChart {
    path: PathBuf,
    size: Size,
    block_bytes: usize,
    /// Channel of the file per band.
    channels: Vec<usize>,
    content: ExrContent,
    units: Option<String>,
    alpha: bool,
    wavelengths_nm: Option<Vec<f64>>,
    nan: NanPolicy,
    largest: f32,
    identity: (Value, Value),
    watched: Watched,
    laid: OnceLock<RasterChart>,
    laying: Mutex<()>,
}

impl ExrChart {
    /// Whether `path` looks like a file that [`ExrChart::open`] takes.
    pub fn is_one(path: &Path) -> bool {
        path.is_file() && path.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr"))
    }

    /// Reads the header.
    ///
    /// # Errors
    /// [`ChartError`]: no OpenEXR file, or one of what is left out, or whose header cannot be true.
    pub fn open(path: &Path, nan: NanPolicy) -> Result<Self, ChartError> {
        let file = File::open(path).map_err(|e| DurableError::io("open", path, 0, e))?;
        let meta = file.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?;
        let read = || MetaData::read_from_unbuffered(file, false);
        let headers = match catch_unwind(AssertUnwindSafe(read)) {
            Ok(Ok(read)) => read.headers,
            Ok(Err(::exr::error::Error::Io(e))) if e.raw_os_error().is_some() => {
                return Err(DurableError::io("read", path, 0, e).into());
            }
            Ok(Err(e)) => return Err(wrong(path, "file", "an OpenEXR image", e.to_string())),
            Err(_) => {
                return Err(wrong(path, "header", "one that holds together", "one that does not".into()));
            }
        };
        let [header] = &headers[..] else {
            return Err(wrong(path, "layers", "one; save it without others", headers.len().to_string()));
        };
        let block_bytes = check(path, header, meta.len())?;
        let (content, channels) = content(path, header)?;
        let text = |name: &str| match header.own_attributes.other.iter().find(|(k, _)| *k == name) {
            Some((_, ::exr::meta::attribute::AttributeValue::Text(t))) => Some(t.to_string()),
            _ => None,
        };
        let units = text("emissiveUnits").filter(|u| u != "unknown");
        let wavelengths_nm = match &content {
            ExrContent::Spectral { wavelengths_nm, .. } => Some(wavelengths_nm.clone()),
            _ => None,
        };
        super::raster::check_wavelengths(path, wavelengths_nm.as_deref())?;
        let size = Size::new(header.layer_size.height(), header.layer_size.width());
        let modified = meta.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok());
        let samples: Vec<_> = channels.iter().map(|&c| header.channels.list[c].sample_type).collect();
        let what = format!(
            "{size}, {channels:?}, {samples:?}, {:?}, {:?}, {content:?}",
            header.compression, header.blocks
        );
        Ok(Self {
            path: path.into(),
            size,
            block_bytes,
            alpha: header.channels.list.iter().any(|c| c.name == *"A"),
            channels,
            content,
            units,
            wavelengths_nm,
            nan,
            largest: MAX_VALUE,
            watched: Watched::data(path, &meta),
            identity: (
                json!({ "exr": what, "bytes": meta.len() }),
                json!(modified.map_or(0, |t| t.as_nanos() as u64)),
            ),
            laid: OnceLock::new(),
            laying: Mutex::new(()),
        })
    }

    /// Number of bands.
    pub fn bands(&self) -> usize {
        self.channels.len()
    }

    /// What they are.
    pub fn content(&self) -> &ExrContent {
        &self.content
    }

    /// Whether there is a channel of transparency.
    pub fn has_alpha(&self) -> bool {
        self.alpha
    }

    /// Bytes of its largest block, decoded.
    pub fn block_bytes(&self) -> usize {
        self.block_bytes
    }

    /// What the values are, in the file's words.
    pub fn units(&self) -> Option<&str> {
        self.units.as_deref()
    }

    /// Wavelengths in nm.
    pub fn wavelengths_nm(&self) -> Option<&[f64]> {
        self.wavelengths_nm.as_deref()
    }

    /// Takes other wavelengths than the channels' names.
    ///
    /// # Errors
    /// [`ChartError::Header`] if they are not one a band.
    pub fn with_wavelengths(mut self, nm: Vec<f64>) -> Result<Self, ChartError> {
        if nm.len() != self.bands() {
            let expected = format!("{}, one a band", self.bands());
            return Err(wrong(&self.path, "number of wavelengths", &expected, nm.len().to_string()));
        }
        super::raster::check_wavelengths(&self.path, Some(&nm))?;
        self.identity.0["wavelengths_nm"] = json!(nm);
        self.wavelengths_nm = Some(nm);
        Ok(self)
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Makes values beyond `largest` in magnitude an error, where [`MAX_VALUE`] is too much. Call it before bands are laid out.
    pub fn limit_values(&mut self, largest: f32) {
        self.largest = largest;
    }

    /// What it is, and when it was last changed.
    ///
    /// # Errors
    /// [`ChartError::Changed`] if the file is not what it was when it was opened.
    pub fn identity(&self) -> Result<(Value, Value), ChartError> {
        self.watched.unchanged()?;
        Ok(self.identity.clone())
    }

    /// Bytes of samples read so far; pixels read as 0 for not being finite.
    pub fn stats(&self) -> (u64, u64) {
        self.laid.get().map_or((0, 0), RasterChart::stats)
    }

    /// Lays `bands` out in a temporary file in `directory`, from which they are read from then on; others cannot be read then.
    /// `progress` is told pixels done and pixels in all. A second call does nothing.
    ///
    /// # Errors
    /// [`ChartError::Space`] before anything is written; [`ChartError`] if a block does not decode, the file is not written.
    pub fn lay_out(
        &self,
        bands: &[usize],
        directory: &Path,
        threads: usize,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<(), ChartError> {
        let _one = self.laying.lock().expect("no panic while laying out");
        if self.laid.get().is_some() {
            return Ok(());
        }
        let shape = [self.bands(), self.size.height, self.size.width];
        let out = BandFile::create(directory, &self.path, bands, shape)?;
        let decoded = self.decode(&out, threads, progress);
        self.watched.unchanged()?;
        decoded?;
        let chart =
            RasterChart::laid_out(&self.path, out, self.nan, self.wavelengths_nm.clone(), self.largest)?;
        let _ = self.laid.set(chart);
        Ok(())
    }

    /// Decodes every block into `out`.
    fn decode(
        &self,
        out: &BandFile,
        threads: usize,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<(), ChartError> {
        let damaged = |reason: String| ChartError::Damaged { path: self.path.clone(), reason };
        let file = File::open(&self.path).map_err(|e| DurableError::io("open", &self.path, 0, e))?;
        let open = || {
            let reader = ::exr::block::read(BufReader::with_capacity(1 << 20, file), false)?;
            reader.filter_chunks(false, |_, _, block| block.level == ::exr::prelude::Vec2(0, 0))
        };
        let reader = catch_unwind(AssertUnwindSafe(open))
            .unwrap_or_else(|_| Err(::exr::error::Error::Invalid("blocks that cannot be".into())))
            .map_err(|e| damaged(e.to_string()))?;
        let meta = reader.meta_data().clone();
        let header = meta.headers.first().ok_or_else(|| damaged("no layer".into()))?;
        // It may have been replaced since it was opened.
        check(&self.path, header, u64::MAX)?;
        if content(&self.path, header)?.1 != self.channels
            || (header.layer_size.height(), header.layer_size.width()) != (self.size.height, self.size.width)
        {
            return Err(damaged("it was changed since it was opened".into()));
        }
        let mut band_of = vec![None; header.channels.list.len()];
        self.channels.iter().enumerate().for_each(|(band, &channel)| band_of[channel] = Some(band));
        let seen = Mutex::new(std::collections::HashSet::new());
        let (reader, done, total) = (Mutex::new(reader), AtomicU64::new(0), self.size.pixels() as u64);
        let work = || -> Result<(), ChartError> {
            loop {
                let next = || reader.lock().unwrap_or_else(std::sync::PoisonError::into_inner).next();
                let block = || match next() {
                    None => Ok(None),
                    Some(chunk) => UncompressedBlock::decompress_chunk(chunk?, &meta, false).map(Some),
                };
                let block = catch_unwind(AssertUnwindSafe(block))
                    .unwrap_or_else(|_| {
                        Err(::exr::error::Error::Invalid("a block that breaks its decoder".into()))
                    })
                    .map_err(|e| damaged(e.to_string()))?;
                let Some(block) = block else { return Ok(()) };
                let position = (block.index.pixel_position.x(), block.index.pixel_position.y());
                if !seen.lock().expect("no panic while held").insert(position) {
                    return Err(damaged(format!("two blocks at column {}, row {}", position.0, position.1)));
                }
                let pixels = self.spread(header, &block, &band_of, out)?;
                progress(done.fetch_add(pixels, Relaxed) + pixels, total);
            }
        };
        std::thread::scope(|s| {
            let threads: Vec<_> = (0..threads.max(1)).map(|_| s.spawn(work)).collect();
            threads.into_iter().try_for_each(|t| t.join().expect("workers return their errors"))
        })?;
        match done.into_inner() {
            n if n == total => Ok(()),
            n => Err(damaged(format!("it holds {n} pixels of {total}"))),
        }
    }

    /// Writes a block's lines to their bands; the number of its pixels.
    fn spread(
        &self,
        header: &Header,
        block: &UncompressedBlock,
        band_of: &[Option<usize>],
        out: &BandFile,
    ) -> Result<u64, ChartError> {
        let (width, height) = (block.index.pixel_size.x(), block.index.pixel_size.y());
        let (x, y) = (block.index.pixel_position.x(), block.index.pixel_position.y());
        let bytes = header.channels.bytes_per_pixel * width * height;
        if x + width > self.size.width || y + height > self.size.height || block.data.len() != bytes {
            let reason = format!("a block of {width}x{height} px at column {x}, row {y}");
            return Err(ChartError::Damaged { path: self.path.clone(), reason });
        }
        let mut pixels = vec![0.0; width];
        let mut rest = &block.data[..];
        for row in y..y + height {
            for (channel, band) in header.channels.list.iter().zip(band_of) {
                let (line, after) = rest.split_at(width * channel.sample_type.bytes_per_sample());
                rest = after;
                let Some(band) = *band else { continue };
                match channel.sample_type {
                    SampleType::F16 => {
                        let halves = line.as_chunks().0.iter().map(|b| half::f16::from_ne_bytes(*b).to_f32());
                        pixels.iter_mut().zip(halves).for_each(|(p, v)| *p = v);
                    }
                    _ => {
                        let floats = line.as_chunks().0.iter().map(|b| f32::from_ne_bytes(*b));
                        pixels.iter_mut().zip(floats).for_each(|(p, v)| *p = v);
                    }
                }
                out.write(band, row, x, &pixels)?;
            }
        }
        Ok((width * height) as u64)
    }

    /// [`ChartSource::read`] with its own error type.
    ///
    /// # Errors
    /// [`ChartError`] if the file cannot be laid out, or as [`RasterChart::read_rect`].
    pub fn read_rect(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), ChartError> {
        if self.laid.get().is_none() {
            let all: Vec<usize> = (0..self.bands()).collect();
            self.lay_out(&all, &std::env::temp_dir(), 1, &|_, _| ())?;
        }
        self.laid.get().expect("laid out above").read_rect(band, rect, out)
    }
}

impl ChartSource for ExrChart {
    fn size(&self) -> Size {
        self.size
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        Ok(self.read_rect(band, rect, out)?)
    }

    fn prefetch(&self, band: usize, rect: Rect) {
        if let Some(laid) = self.laid.get() {
            laid.prefetch(band, rect);
        }
    }
}

fn wrong(path: &Path, what: &'static str, expected: &str, found: String) -> ChartError {
    let found = found.chars().take(200).collect();
    ChartError::Header { path: path.into(), what, expected: expected.into(), found }
}

/// What a header claims, before anything is allocated for it; bytes of a block.
fn check(path: &Path, header: &Header, length: u64) -> Result<usize, ChartError> {
    let (width, height) = (header.layer_size.width(), header.layer_size.height());
    let channels = &header.channels.list;
    if header.deep {
        return Err(wrong(path, "data", "flat pixels", "deep ones".into()));
    }
    if width == 0 || height == 0 || channels.is_empty() || channels.len() > MAX_CHANNELS {
        let found = format!("{} channels of {width}x{height} px", channels.len());
        return Err(wrong(path, "size", "at least one pixel and 1 to 4096 channels", found));
    }
    if let Some(c) = channels.iter().find(|c| c.sampling != ::exr::prelude::Vec2(1, 1)) {
        return Err(wrong(path, "channels", "one sample a pixel", format!("`{}` is subsampled", c.name)));
    }
    let (columns, rows) = match header.blocks {
        BlockDescription::ScanLines => (width, header.compression.scan_lines_per_block().min(height)),
        // Not cut at the image's edges: see MAX_BLOCK_BYTES.
        BlockDescription::Tiles(t) => (t.tile_size.width(), t.tile_size.height()),
    };
    let pixel_bytes = header.channels.bytes_per_pixel;
    let block_bytes = columns.checked_mul(rows).and_then(|n| n.checked_mul(pixel_bytes));
    if block_bytes.is_none_or(|n| n > MAX_BLOCK_BYTES) {
        let found = format!("{columns}x{rows} px of {pixel_bytes} bytes");
        return Err(wrong(path, "block size", "at most 192 MiB; save it in smaller tiles", found));
    }
    // Each block has at least its offset of eight bytes in the file.
    if header.chunk_count as u64 > length / 8 {
        return Err(ChartError::Short {
            path: path.into(),
            expected: (header.chunk_count as u64).saturating_mul(8),
            found: length,
        });
    }
    Ok(columns.min(width) * rows.min(height) * pixel_bytes)
}

/// What a header's channels are, and which of them are the bands.
fn content(path: &Path, header: &Header) -> Result<(ExrContent, Vec<usize>), ChartError> {
    let list = &header.channels.list;
    let names: Vec<String> = list.iter().map(|c| c.name.to_string()).collect();
    let bands = |prefix: &str| -> Result<Vec<(f64, usize)>, ChartError> {
        let named = names.iter().enumerate().filter_map(|(i, n)| Some((i, n.strip_prefix(prefix)?)));
        let mut found: Vec<(f64, usize)> = named
            .map(|(i, length)| {
                let nm = in_nm(length).ok_or_else(|| {
                    wrong(path, "channel", "a wavelength such as S0.400,0nm", format!("`{}`", names[i]))
                })?;
                Ok((nm, i))
            })
            .collect::<Result<_, ChartError>>()?;
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(found)
    };
    let (light, reflected) = (bands("S0.")?, bands("T.")?);
    let at = |name: &str| names.iter().position(|n| n == name);
    let (content, channels) = match (light.is_empty(), reflected.is_empty()) {
        (false, false) => {
            return Err(wrong(path, "channels", "S0 or T", "both of them".into()));
        }
        (true, true) => match (at("R"), at("G"), at("B"), at("Y")) {
            (Some(r), Some(g), Some(b), _) => (ExrContent::Rgb, vec![r, g, b]),
            (None, None, None, Some(y)) => (ExrContent::Grey, vec![y]),
            _ => {
                let expected = "S0.…nm or T.…nm (spectral), R, G and B, or Y";
                return Err(wrong(path, "channels", expected, names.join(", ")));
            }
        },
        (_, reflective) => {
            let found = if light.is_empty() { &reflected } else { &light };
            let wavelengths_nm = found.iter().map(|f| f.0).collect();
            (
                ExrContent::Spectral { wavelengths_nm, reflective: !reflective },
                found.iter().map(|f| f.1).collect(),
            )
        }
    };
    if let Some(&i) = channels.iter().find(|&&i| list[i].sample_type == SampleType::U32) {
        return Err(wrong(path, "samples", "half or float", format!("`{}` of whole numbers", names[i])));
    }
    Ok((content, channels))
}

/// `400,000000nm`, `0.4um`: the wavelength in nm.
fn in_nm(text: &str) -> Option<f64> {
    let units = [("nm", 1.0), ("um", 1e3), ("µm", 1e3), ("m", 1e9)];
    let (number, per_unit) = units.iter().find_map(|(unit, nm)| Some((text.strip_suffix(unit)?, nm)))?;
    let nm = number.replace(',', ".").parse::<f64>().ok()? * per_unit;
    // 0.55 µm is 550 nm, not 550.0000000000001.
    Some((nm * 1e6).round() / 1e6).filter(|nm| *nm > 0.0 && nm.is_finite())
}
