//! Reading rectangles: pieces out of the cache, decoded and checked once.

use std::sync::Arc;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Instant;

use pipeline::flow::{ChartSource, SourceSinkError};
use pipeline::geometry::{Rect, Size};

use super::values::Unusable;
use super::{ChartError, ChartStore};

/// A decoded piece: f32, band by band, cut to the chart.
#[derive(Debug)]
pub(super) struct Piece {
    pub(super) bands: std::ops::Range<usize>,
    pub(super) rect: Rect,
    /// Empty: every pixel has the value `fill`.
    pub(super) data: Vec<f32>,
    pub(super) fill: f32,
    missing: bool,
    /// First sample of each band that is an error: (band, row, column, sample).
    bad: Vec<(usize, usize, usize, Unusable)>,
}

impl Piece {
    /// Pixels of `band` from (`y`, `x`) on, `n` of them in one row.
    fn copy_row(&self, band: usize, y: i64, x: i64, out: &mut [f32]) {
        if self.data.is_empty() {
            out.fill(self.fill);
            return;
        }
        let Rect { height, width, .. } = self.rect;
        let row = (band - self.bands.start) * height + (y - self.rect.y) as usize;
        out.copy_from_slice(&self.data[row * width + (x - self.rect.x) as usize..][..out.len()]);
    }
}

impl ChartStore {
    /// Piece `p` of the store, decoded now or before.
    pub(super) fn piece(&self, p: [usize; 3]) -> Result<Arc<Piece>, ChartError> {
        self.cache.get(self.layout.number(p), || {
            let piece = self.load(p)?;
            let bytes = piece.data.len() * 4 + size_of::<Piece>();
            Ok((piece, bytes))
        })
    }

    /// Decodes piece `p`, cuts it to the chart, and looks for what is not finite.
    pub(super) fn load(&self, p: [usize; 3]) -> Result<Piece, ChartError> {
        let index = self.index(p)?;
        let index = index.as_ref().and_then(|i| i.as_deref());
        let encoded = self.layout.read_encoded(p, index)?;
        // Afterwards, so that what was read is of the file that the identity is of.
        self.unchanged(p)?;
        let Some(encoded) = encoded else {
            self.layout.still_there()?;
            return Ok(self.missing(p));
        };
        self.counters.bytes_read.fetch_add(encoded.len() as u64, Relaxed);
        let start = Instant::now();
        let decoded = self.layout.decode_piece(p, encoded)?;
        let piece = self.convert(p, &decoded);
        self.counters.pieces_decoded.fetch_add(1, Relaxed);
        self.counters.decode_ns.fetch_add(start.elapsed().as_nanos() as u64, Relaxed);
        Ok(piece)
    }

    /// Whether the file of piece `p` is still the one that the chart's identity is of, where that was asked for.
    fn unchanged(&self, p: [usize; 3]) -> Result<(), ChartError> {
        let file = self.layout.file(p);
        let array = self.array_path();
        let key = file.strip_prefix(&array).unwrap_or(&file).to_string_lossy();
        self.stamps.unchanged(&key, &file).or_else(|changed| {
            self.layout.still_there()?;
            Err(changed)
        })
    }

    /// The index of the shard that holds piece `p`, if the array is sharded; `None` inside: the shard is missing.
    #[allow(clippy::type_complexity, reason = "two reasons for there being none")]
    fn index(&self, p: [usize; 3]) -> Result<Option<Arc<Option<Vec<u64>>>>, ChartError> {
        let read = || {
            let index = self.layout.read_index(p)?;
            let bytes = index.as_ref().map_or(0, |i| i.len() * 8);
            self.counters.bytes_read.fetch_add(bytes as u64, Relaxed);
            Ok::<_, ChartError>((index, bytes + 64))
        };
        let sharded = self.layout.is_sharded();
        sharded.then(|| self.indexes.get(self.layout.file_number(p), read)).transpose()
    }

    /// The pieces that hold the pixels of `rect` of `band`, row by row.
    fn pieces_of(&self, band: usize, rect: Rect) -> impl Iterator<Item = [usize; 3]> + use<> {
        let [bands, rows, columns] = self.layout.piece;
        let all = |first: i64, end: i64, side: usize| first as usize / side..(end as usize).div_ceil(side);
        let (down, across) = (all(rect.y, rect.bottom(), rows), all(rect.x, rect.right(), columns));
        down.flat_map(move |i| across.clone().map(move |j| [band / bands, i, j]))
    }

    fn missing(&self, p: [usize; 3]) -> Piece {
        let (bands, rect) = self.layout.extent(p);
        let number = self.layout.number(p);
        let pixels = (bands.len() * rect.size().pixels()) as u64;
        self.counters.missing.lock().expect("no panic while counting").insert(number, pixels);
        let values = &self.layout.values;
        let mut bad = Vec::new();
        let mut replaced = 0;
        // A store has one scale for all bands.
        let mut fill = [values.of_raw(bands.start)(self.layout.fill)];
        let checked = values.check(bands.start, &mut fill, |_| self.layout.fill, self.options.nan);
        if let Some((_, error)) = checked.error {
            bad.extend(bands.clone().map(|b| (b, rect.y as usize, rect.x as usize, error)));
        }
        if checked.replaced > 0 {
            replaced = pixels;
        }
        self.count_replaced(number, replaced);
        Piece { bands, rect, data: Vec::new(), fill: fill[0], missing: true, bad }
    }

    fn count_replaced(&self, number: u64, pixels: u64) {
        if pixels > 0 {
            self.counters.replaced.lock().expect("no panic while counting").insert(number, pixels);
        }
    }

    fn convert(&self, p: [usize; 3], decoded: &[u8]) -> Piece {
        let (bands, rect) = self.layout.extent(p);
        let [_, rows, columns] = self.layout.piece;
        let (sample, values) = (self.layout.sample, &self.layout.values);
        let (height, width) = (rect.height, rect.width);
        let mut data = Vec::with_capacity(bands.len() * height * width);
        let mut bad = Vec::new();
        let mut replaced = 0;
        for band in bands.clone() {
            let mut first = None;
            for row in 0..height {
                let start = ((band - bands.start) * rows + row) * columns;
                let from = data.len();
                let line = &decoded[start * sample.bytes()..][..width * sample.bytes()];
                match values.are_raw() {
                    true => sample.extend(&mut data, line),
                    false => sample.extend_by(&mut data, line, values.of_raw(band)),
                }
                let checked =
                    values.check(band, &mut data[from..], |k| sample.raw(line, k), self.options.nan);
                replaced += checked.replaced;
                if let Some((column, error)) = checked.error {
                    first.get_or_insert((band, rect.y as usize + row, rect.x as usize + column, error));
                }
            }
            bad.extend(first);
        }
        self.count_replaced(self.layout.number(p), replaced);
        Piece { bands, rect, data, fill: 0.0, missing: false, bad }
    }

    /// The error that a value of `band` in `piece` stands for, if it is not finite.
    pub(super) fn check(&self, p: [usize; 3], piece: &Piece, band: usize) -> Result<(), ChartError> {
        let Some(&(band, row, column, error)) = piece.bad.iter().find(|b| b.0 == band) else { return Ok(()) };
        let fill = self.layout.fill;
        Err(match error {
            Unusable::NotFinite(_) | Unusable::NoData(_) if piece.missing => {
                ChartError::MissingChunk { path: self.layout.file(p), band, region: piece.rect, fill }
            }
            error => error.at(self.array_path(), (band, row, column), self.layout.values.largest),
        })
    }

    /// [`ChartSource::read`] with its own error type.
    ///
    /// # Errors
    /// [`ChartError`] if the rectangle is not in the chart, or its pixels cannot be read.
    pub fn read_rect(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), ChartError> {
        let size = self.layout.size();
        let inside = size.rect().contains(rect) && band < self.bands();
        if !inside || out.len() != rect.size().pixels() {
            return Err(ChartError::Request {
                path: self.array_path(),
                band,
                rect,
                room: out.len(),
                bands: self.bands(),
                size,
            });
        }
        if rect.is_empty() {
            return Ok(());
        }
        let spool = self.spool.get().filter(|s| s.holds(band));
        for p in self.pieces_of(band, rect) {
            let piece = match spool {
                Some(spool) => self.spooled(spool, band, p)?,
                None => self.piece(p)?,
            };
            self.check(p, &piece, band)?;
            let part = rect.intersect(piece.rect);
            for y in part.y..part.bottom() {
                let start = (y - rect.y) as usize * rect.width + (part.x - rect.x) as usize;
                piece.copy_row(band, y, part.x, &mut out[start..start + part.width]);
            }
        }
        Ok(())
    }

    /// A piece of one band, out of the temporary store.
    fn spooled(
        &self,
        spool: &super::spool::Spool,
        band: usize,
        p: [usize; 3],
    ) -> Result<Arc<Piece>, ChartError> {
        // Numbers of pieces of single bands lie beyond those of pieces of the store.
        let first = self.layout.pieces().iter().product::<usize>() as u64;
        let n = self.layout.pieces();
        let number = first + ((band * n[1] + p[1]) * n[2] + p[2]) as u64;
        self.cache.get(number, || {
            let (_, rect) = self.layout.extent(p);
            let data = spool.read(band, [p[1], p[2]], rect.size().pixels())?;
            self.counters.bytes_read.fetch_add(data.len() as u64 * 4, Relaxed);
            let bytes = data.len() * 4 + size_of::<Piece>();
            let piece =
                Piece { bands: band..band + 1, rect, data, fill: 0.0, missing: false, bad: Vec::new() };
            Ok((piece, bytes))
        })
    }
}

impl ChartSource for ChartStore {
    fn size(&self) -> Size {
        self.layout.size()
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        Ok(self.read_rect(band, rect, out)?)
    }

    fn prefetch(&self, band: usize, rect: Rect) {
        if band < self.bands() && self.spool.get().is_none() {
            for p in self.pieces_of(band, rect.intersect(self.size().rect())) {
                if !self.cache.has(self.layout.number(p)) {
                    self.layout
                        .will_read(p, self.index(p).ok().flatten().as_ref().and_then(|i| i.as_deref()));
                }
            }
        }
    }
}
