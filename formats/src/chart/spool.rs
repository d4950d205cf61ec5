//! Charts whose chunks span many bands, laid out band by band before they are read.
//!
//! Read as it is, such a chart would be decoded once per band. [`ChartStore::rechunk`] decodes every piece once and
//! writes its bands apart into one temporary file: raw f32, offset = ((band, piece row, piece column) · largest piece).
//! The file has no name, so it is gone when the chart is dropped, however the process ends.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use super::{ChartError, ChartStore};
use crate::durable::{DurableError, free_bytes, nameless_file};

/// The temporary file.
#[derive(Debug)]
pub(super) struct Spool {
    file: File,
    path: PathBuf,
    /// Slot of each band of the chart.
    slots: Vec<Option<usize>>,
    /// Pieces down and across.
    grid: [usize; 2],
    /// Pixels of the largest piece of one band.
    pixels: usize,
}

impl Spool {
    fn create(directory: &Path, bands: &[usize], chart: &ChartStore) -> Result<Self, ChartError> {
        let [_, down, across] = chart.layout.pieces();
        let [_, rows, columns] = chart.layout.piece;
        let size = chart.layout.size();
        let pixels = rows.min(size.height) * columns.min(size.width);
        let needed = (bands.len() * down * across) as u64 * (pixels * 4) as u64;
        let free = free_bytes(directory)?;
        if needed > free {
            let (path, directory) = (chart.array_path(), directory.into());
            return Err(ChartError::Space { path, directory, needed, free });
        }
        let (file, path) = (nameless_file(directory)?, directory.join("(temporary file without a name)"));
        let mut slots = vec![None; chart.bands()];
        for (slot, &band) in bands.iter().enumerate() {
            slots[band] = Some(slot);
        }
        Ok(Self { file, path, slots, grid: [down, across], pixels })
    }

    pub(super) fn holds(&self, band: usize) -> bool {
        self.slots[band].is_some()
    }

    fn offset(&self, band: usize, [i, j]: [usize; 2]) -> u64 {
        let slot = self.slots[band].expect("asked for bands that it holds");
        (((slot * self.grid[0] + i) * self.grid[1] + j) * self.pixels * 4) as u64
    }

    fn write(&self, band: usize, at: [usize; 2], data: &[f32]) -> Result<(), DurableError> {
        let bytes: Vec<u8> = data.iter().flat_map(|v| v.to_ne_bytes()).collect();
        self.file
            .write_all_at(&bytes, self.offset(band, at))
            .map_err(|e| DurableError::io("write", &self.path, bytes.len() as u64, e))
    }

    pub(super) fn read(&self, band: usize, at: [usize; 2], pixels: usize) -> Result<Vec<f32>, DurableError> {
        let mut bytes = vec![0; pixels * 4];
        self.file
            .read_exact_at(&mut bytes, self.offset(band, at))
            .map_err(|e| DurableError::io("read", &self.path, bytes.len() as u64, e))?;
        Ok(bytes.as_chunks().0.iter().map(|&b| f32::from_ne_bytes(b)).collect())
    }
}

impl ChartStore {
    /// Whether reading `bands` one after the other would decode chunks once per band: chunks span several bands, more
    /// than one is wanted, and what one pass of them decodes to does not fit in the cache.
    pub fn rechunk_needed(&self, bands: &[usize]) -> bool {
        let per = self.layout.piece[0];
        let mut groups: Vec<usize> = bands.iter().map(|b| b / per).collect();
        groups.sort_unstable();
        let shared = groups.windows(2).any(|g| g[0] == g[1]);
        groups.dedup();
        let decoded = groups.len().saturating_mul(per.min(self.bands()));
        let decoded = decoded.saturating_mul(self.layout.size().pixels()).saturating_mul(4);
        self.spool.get().is_none() && shared && decoded > self.cache.limit()
    }

    /// Decodes `bands` once, on `threads` threads that hold one piece each, into a temporary file in `directory`, from
    /// which they are read from then on. `progress` is told pieces done and pieces in all. A second call does nothing.
    ///
    /// # Errors
    /// [`ChartError::Space`] before anything is written; [`ChartError`] if a chunk cannot be read, the file not written.
    pub fn rechunk(
        &self,
        bands: &[usize],
        directory: &Path,
        threads: usize,
        progress: &(dyn Fn(u64, u64) + Sync),
    ) -> Result<(), ChartError> {
        if self.spool.get().is_some() {
            return Ok(());
        }
        let mut bands: Vec<usize> = bands.iter().copied().filter(|b| *b < self.bands()).collect();
        bands.sort_unstable();
        bands.dedup();
        let spool = Spool::create(directory, &bands, self)?;
        let [groups, down, across] = self.layout.pieces();
        let mut wanted = vec![Vec::new(); groups];
        for band in bands {
            wanted[band / self.layout.piece[0]].push(band);
        }
        let pieces: Vec<usize> = (0..groups).filter(|g| !wanted[*g].is_empty()).collect();
        let total = pieces.len() * down * across;
        let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let work = || -> Result<(), ChartError> {
            loop {
                let n = next.fetch_add(1, Relaxed);
                if n >= total {
                    return Ok(());
                }
                let (group, i, j) = (pieces[n / (down * across)], n / across % down, n % across);
                self.split(&spool, [group, i, j], &wanted[group])
                    .inspect_err(|_| next.store(total, Relaxed))?;
                progress(done.fetch_add(1, Relaxed) as u64 + 1, total as u64);
            }
        };
        std::thread::scope(|s| {
            let workers: Vec<_> = (0..threads.max(1)).map(|_| s.spawn(work)).collect();
            workers.into_iter().try_for_each(|w| w.join().expect("workers return their errors"))
        })?;
        // A second caller at the same time made the same file; one of them is kept.
        let _ = self.spool.set(spool);
        Ok(())
    }

    fn split(&self, spool: &Spool, p: [usize; 3], bands: &[usize]) -> Result<(), ChartError> {
        let piece = self.load(p)?;
        let pixels = piece.rect.size().pixels();
        for &band in bands {
            self.check(p, &piece, band)?;
            let start = (band - piece.bands.start) * pixels;
            if piece.data.is_empty() {
                spool.write(band, [p[1], p[2]], &vec![piece.fill; pixels])?;
            } else {
                spool.write(band, [p[1], p[2]], &piece.data[start..start + pixels])?;
            }
        }
        Ok(())
    }
}
