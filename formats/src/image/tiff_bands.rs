//! Bands of a TIFF 6.0 or BigTIFF file: samples of a pixel side by side (chunky), plane after plane (planar), or page after page.
//!
//! | | supported |
//! |---|---|
//! | samples | u8, u16, i16, f16, f32, f64; all bands of one type |
//! | layout | strips or tiles; chunky, planar, or one band per page |
//! | compression | none, LZW, deflate, PackBits, zstd; predictors |
//!
//! A chunk that a sparse file (GDAL's `SPARSE_OK`) does not store, with offset and size 0, holds the no-data sample, or 0 without one.
//!
//! Reduced pages (overviews) and masks are skipped. A *chunk* is a strip or tile of one plane. Compressed chunks are at most 256 MiB each when
//! decoded; rows of uncompressed ones are read directly, so these may have any size.

mod page;
mod predictor;
mod strip;

use std::fs::File;
use std::io::BufReader;
use std::ops::Range;
use std::path::Path;

use ::tiff::TiffResult;
use ::tiff::decoder::Decoder;
use ::tiff::tags::Tag;
use pipeline::geometry::Size;

use super::header::{ImageError, guarded, header_error};
use crate::durable::DurableError;
use crate::sample::RasterSample;
use page::{Page, PageLayout, check_page, open_decoder};

/// Maximum number of pages.
const MAX_PAGES: usize = 65_536;
/// Ranges of strips into which an image is divided for several threads.
const MAX_RANGES: usize = 64;
/// Tags of GDAL.
const GDAL_METADATA: Tag = Tag::Unknown(42112);
const GDAL_NODATA: Tag = Tag::GdalNodata;

/// A file whose headers have been read.
#[derive(Debug)]
pub(crate) struct TiffBands {
    pub(crate) size: Size,
    pub(crate) bands: usize,
    pub(crate) sample: RasterSample,
    /// GDAL's metadata: XML.
    pub(crate) metadata: Option<String>,
    /// GDAL's no-data sample.
    pub(crate) no_data: Option<String>,
    /// Memory of decoding.
    pub(crate) decoder_bytes: usize,
    order: Order,
}

#[derive(Clone, Debug, PartialEq)]
enum Order {
    Chunky,
    Planar,
    /// Page of each band.
    Pages(Vec<usize>),
}

/// Part of a file that one thread decodes.
#[derive(Clone, Debug)]
pub(crate) struct TiffPart {
    /// First band in it: the only one, except of a chunky file.
    pub(crate) first_band: usize,
    page: usize,
    /// Strips of the plane (module `strip`).
    strips: Range<usize>,
}

/// Receives complete rows, or part of one: (band, row, column, samples in native byte order).
pub(crate) type BandSink<'a, E> = &'a mut dyn FnMut(usize, usize, usize, &[u8]) -> Result<(), E>;

impl TiffBands {
    /// Reads the headers.
    pub(crate) fn open(path: &Path) -> Result<Self, ImageError> {
        let (mut decoder, file) = open_decoder(path)?;
        let length = file.metadata().map_err(|e| DurableError::io("look up", path, 0, e))?.len();
        let (layout, mut decoder_bytes) = check_page(path, &mut decoder, length)?;
        let text = |decoder: &mut Decoder<_>, tag| guarded(path, || tag_text(decoder, tag));
        let (metadata, no_data) = (text(&mut decoder, GDAL_METADATA)?, text(&mut decoder, GDAL_NODATA)?);
        let mut pages = vec![0];
        for page in 1.. {
            if !decoder.more_images() {
                break;
            }
            if page == MAX_PAGES {
                return Err(header_error(path, "pages", format!("at most {MAX_PAGES}"), "more"));
            }
            let kind = guarded(path, || {
                decoder.next_image()?;
                decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType)
            })?;
            // Bit 0: a reduced image; bit 2: a mask.
            if kind.unwrap_or(0) & 0b101 != 0 {
                continue;
            }
            if layout.samples > 1 {
                let expected = "one where a pixel has several samples; `gdal_translate GTIFF_DIR:1:IN OUT` writes page 1 alone";
                let found = format!("page {} after one of {} samples per pixel", page + 1, layout.samples);
                return Err(header_error(path, "pages", expected, found));
            }
            let (other, bytes) = check_page(path, &mut decoder, length)?;
            if other != layout {
                let expected = format!("{} of {} as on the first page", layout.size, layout.sample.name());
                let found = match other.samples {
                    1 => format!("{} of {} on page {page}", other.size, other.sample.name()),
                    n => format!("{n} samples per pixel on page {page}"),
                };
                return Err(header_error(path, "pages", expected, found));
            }
            decoder_bytes = decoder_bytes.max(bytes);
            pages.push(page);
        }
        let (bands, order) = match layout {
            PageLayout { samples: 1, .. } => (pages.len(), Order::Pages(pages)),
            PageLayout { planar: true, samples, .. } => (samples, Order::Planar),
            PageLayout { samples, .. } => (samples, Order::Chunky),
        };
        let (size, sample) = (layout.size, layout.sample);
        Ok(Self { size, bands, sample, metadata, no_data, decoder_bytes, order })
    }

    /// GDAL's no-data sample; the error is a text that is not a number.
    pub(crate) fn no_data_value(&self) -> Result<Option<f64>, String> {
        let Some(text) = &self.no_data else { return Ok(None) };
        let text = text.trim_end_matches('\0').trim();
        text.parse().map(Some).map_err(|_| text.chars().take(40).collect())
    }

    /// Samples of a pixel of a page.
    fn samples(&self) -> usize {
        if matches!(self.order, Order::Pages(_)) { 1 } else { self.bands }
    }

    /// The parts that hold `bands`, each to be decoded once, in any order.
    pub(crate) fn parts(&self, path: &Path, bands: &[usize]) -> Result<Vec<TiffPart>, ImageError> {
        if let Order::Pages(pages) = &self.order {
            let whole =
                |&band: &usize| TiffPart { first_band: band, page: pages[band], strips: 0..usize::MAX };
            return Ok(bands.iter().map(whole).collect());
        }
        let page = Page::open(path, self, 0)?;
        let strips = page.strips_per_plane();
        if self.order == Order::Planar {
            let plane = |&band: &usize| TiffPart { first_band: band, page: 0, strips: 0..strips };
            return Ok(bands.iter().map(plane).collect());
        }
        let step = strips.div_ceil(MAX_RANGES);
        let range = |first| TiffPart { first_band: 0, page: 0, strips: first..(first + step).min(strips) };
        Ok((0..strips).step_by(step).map(range).collect())
    }

    /// Decodes the samples of `bands` in a part.
    pub(crate) fn decode<E: From<ImageError>>(
        &self,
        path: &Path,
        part: &TiffPart,
        bands: &[usize],
        sink: BandSink<'_, E>,
    ) -> Result<(), E> {
        let mut page = Page::open(path, self, part.page)?;
        let plane = if self.order == Order::Planar { part.first_band } else { 0 };
        for strip in part.strips.start..part.strips.end.min(page.strips_per_plane()) {
            page.decode_strip(path, (plane, strip), part.first_band, bands, sink)?;
        }
        Ok(())
    }
}

/// Text of a tag.
fn tag_text(decoder: &mut Decoder<BufReader<File>>, tag: Tag) -> TiffResult<Option<String>> {
    let value = decoder.find_tag(tag)?;
    Ok(value.and_then(|v| v.into_string().ok()))
}
