//! The signal before exposure, measured first where the exposure follows from it.

use super::film::Film;
use super::geometry::Geometry;
use super::kept::Kept;
use super::resolve::{RawJob, Source};
use crate::progress::{counting, data_size, interrupt};
use anyhow::{Context, Result};
use formats::durable::{DurableError, free_bytes, is_url, unnamed_temp_file};
use pipeline::flow::ChartSource;
use pipeline::geometry::Rect;
use pipeline::sensor::SignalHistogram;
use pipeline::sensor::spread::{self, SpreadRows};
use pipeline::sensor::stream::{BandWeights, Deliver, Pass};
use std::fs::File;
use std::ops::Range;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// A whole signal that is on a disk.
#[derive(Clone, Copy)]
pub enum Stored<'a> {
    /// Of another raw.
    Kept(&'a Kept),
    /// In a temporary file of rows of this width.
    Temp(&'a File, usize),
}

impl Stored<'_> {
    /// The pixels of `rect`, row by row.
    pub fn read(&self, rect: Rect, out: &mut [f32]) -> Result<()> {
        match self {
            Self::Kept(kept) => Ok(kept.store.read_rect(0, rect, out)?),
            Self::Temp(file, width) => {
                let mut bytes = vec![0; rect.width * 4];
                for (i, line) in out.chunks_mut(rect.width).enumerate() {
                    let first = (rect.y as usize + i) * width + rect.x as usize;
                    file.read_exact_at(&mut bytes, first as u64 * 4)
                        .context("reading the temporary signal")?;
                    std::iter::zip(line, bytes.as_chunks().0).for_each(|(v, b)| *v = f32::from_le_bytes(*b));
                }
                Ok(())
            }
        }
    }
}

/// A signal that was measured before the exposure.
pub struct Measured {
    /// The temporary file; none where the signal is kept.
    file: Option<File>,
    /// Its values.
    pub histogram: SignalHistogram,
    /// Mean illuminance over the sensor of a relative film of scale 1, lx.
    pub mean_lux: Option<f64>,
}

impl Measured {
    /// The signal.
    pub fn stored<'a>(&'a self, job: &'a RawJob) -> Option<Stored<'a>> {
        self.file.as_ref().map(|file| Stored::Temp(file, job.size().width))
    }
}

/// Rows of a kept signal that are looked at together.
const ROWS: usize = 512;

/// Measures the signal of the whole sensor; a film's is written into a nameless file in `directory`. `None`: interrupted.
pub fn measure(job: &RawJob, directory: &Path) -> Result<Option<Measured>> {
    let mut histogram = SignalHistogram::default();
    let (film, geometry) = match &job.source {
        Source::Film(film, geometry) => (film, geometry),
        Source::Kept(kept) => {
            let size = kept.spec.sensor;
            let mut rows = Vec::new();
            for first in (0..size.height).step_by(ROWS) {
                let rect = Rect::new(first as i64, 0, ROWS.min(size.height - first), size.width);
                rows.resize(rect.size().pixels(), 0.0);
                Stored::Kept(kept).read(rect, &mut rows)?;
                histogram.add(&rows);
            }
            return Ok(Some(Measured { file: None, histogram, mean_lux: None }));
        }
    };
    let size = job.size();
    let temp = std::env::temp_dir();
    let directory = if is_url(directory) { &temp } else { directory };
    formats::durable::create_directories(directory, true)?;
    let (needed, free) = (size.pixels() as u64 * 4, free_bytes(directory)?);
    if free < needed {
        return Err(std::io::Error::new(
            std::io::ErrorKind::StorageFull,
            format!(
                "{}: the signal takes {} for a while, {} are free; free some space, or write RAW elsewhere",
                directory.display(),
                data_size(needed),
                data_size(free)
            ),
        )
        .into());
    }
    let file = unnamed_temp_file(directory)?;
    let planes = job.planes(film, job.sums_lux());
    let mut lux = job.sums_lux().then_some(0.0);
    let (bar, progress) = counting("measuring the signal");
    let mut deliver = |first: usize, planes: &[Vec<f32>]| {
        histogram.add(&planes[0]);
        if let (Some(lux), Some(plane)) = (&mut lux, planes.get(1)) {
            // Row by row, in order: the sum has the same bits whatever the blocks.
            for row in plane.chunks(size.width) {
                *lux += row.iter().map(|v| f64::from(*v)).sum::<f64>();
            }
        }
        let bytes: Vec<u8> = planes[0].iter().flat_map(|v| v.to_le_bytes()).collect();
        let at = (first * size.width) as u64 * 4;
        file.write_all_at(&bytes, at)
            .map_err(|e| DurableError::io("write a temporary file in", directory, bytes.len() as u64, e))?;
        progress((first + planes[0].len() / size.width) as u64, size.height as u64);
        Ok(())
    };
    let whole = pass(job, (film, geometry), size.rect(), &planes, 0..size.height, &mut deliver)?;
    bar.finish_and_clear();
    let mean_lux = lux.map(|sum| sum / size.pixels() as f64);
    Ok(whole.then_some(Measured { file: Some(file), histogram, mean_lux }))
}

/// Computes rows of a window of the sensor from the film; `false`: interrupted.
pub fn pass(
    job: &RawJob,
    (film, geometry): (&Film, &Geometry),
    window: Rect,
    planes: &[BandWeights],
    rows: Range<usize>,
    deliver: &mut Deliver<'_>,
) -> Result<bool> {
    let crosstalk = job.spread.as_ref();
    let read = crosstalk.map_or(window, |of| of.reach(window));
    let (row_taps, column_taps) = geometry.taps(read)?;
    let corrections = crosstalk.map(SpreadRows::factors).unwrap_or_default();
    let moved = job.motion.as_ref().map(|of| of.motion.film(&film.bands));
    let pass = Pass {
        film: moved.as_ref().map_or(&film.bands as &dyn ChartSource, |moved| moved),
        bands: film.wavelengths_nm.len(),
        sensor: &job.sensor,
        rows: &row_taps,
        columns: &column_taps,
        window: read,
        planes,
        corrections: &corrections,
        block: job.memory.block,
        bands_at_once: job.memory.bands_at_once,
        threads: job.memory.threads,
        cancel: interrupt::cancel_flag(),
    };
    let whole = match crosstalk {
        None => pass.run(rows, deliver),
        Some(of) => spread::run(&pass, of, window, rows, deliver),
    };
    whole.map_err(anyhow::Error::from_boxed)
}
