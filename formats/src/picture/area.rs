//! Reduction by averaging over area, streamed: every source sample is read once, in strips.
//!
//!   out[i, j] = Σ w_ik·w_jl·in[k, l] / Σ w_ik·w_jl,   w_ik = overlap of output pixel i and source pixel k
//! over the samples that are finite. Along an axis of n source and m output pixels (divided by their common factor)
//! source pixel k is [k·m, (k+1)·m) and output pixel i is [i·n, (i+1)·n): the weights are whole numbers, exact in f64, at any ratio.
//!
//! Workers take units (one band of one strip) in order, strip by strip and within it band by band, and average them
//! in parallel. The averages are added in the order of the units, so the picture has the same bits for any number of threads.
//! A worker holds one strip (at most 32 MiB, and a multiple of common chunk rows where that allows) and its averages;
//! between strips, one output row a band is kept.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex};

use super::{ChartSource, PictureError, Progress, Rect, Size, View};

/// Rows of a strip: a multiple of the inner chunks of 256 or 512 rows that stores decode at once.
const STRIP_ROWS: usize = 512;
/// Maximum bytes of a strip; wider images get fewer rows.
const MAX_BAND_BYTES: usize = 32 << 20;

/// Source and output pixels along one axis, divided by their common factor.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Axis {
    source: usize,
    out: usize,
}

impl Axis {
    fn new(source: usize, out: usize) -> Self {
        let (mut a, mut b) = (source, out);
        while b != 0 {
            (a, b) = (b, a % b);
        }
        Self { source: source / a, out: out / a }
    }

    /// Source pixels that overlap output pixel `i`.
    fn span(self, i: usize) -> Range<usize> {
        i * self.source / self.out..((i + 1) * self.source).div_ceil(self.out)
    }

    /// Output pixels that overlap source pixels `from..to`.
    fn outputs(self, from: usize, to: usize) -> Range<usize> {
        from * self.out / self.source..(to * self.out).div_ceil(self.source)
    }

    /// Overlap of output pixel `i` and source pixel `k`, which do overlap.
    fn weight(self, i: usize, k: usize) -> f64 {
        let end = ((k + 1) * self.out).min((i + 1) * self.source);
        (end - (k * self.out).max(i * self.source)) as f64
    }
}

/// A region of a source and the size of its picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    region: Rect,
    /// Size of the picture.
    pub(super) out: Size,
    rows: Axis,
    columns: Axis,
}

impl Grid {
    /// The region of `view` with its longer side at most `max_side`: aspect kept to the pixel, never enlarged.
    pub(super) fn new(source: Size, view: &View) -> Result<Self, PictureError> {
        let region = view.region(source)?;
        let (height, width) = (region.height, region.width);
        let longest = height.max(width);
        let max_side = view.max_side.unwrap_or(longest).min(longest);
        // Rounded half up; a thin image keeps one pixel.
        let side = |n: usize| ((2 * n * max_side + longest) / (2 * longest)).max(1);
        let out = Size::new(side(height), side(width));
        Ok(Self { region, out, rows: Axis::new(height, out.height), columns: Axis::new(width, out.width) })
    }

    /// Strips in rows of the region; their borders are at multiples of their height in the source.
    fn strips(&self) -> Vec<Range<usize>> {
        let mut height = STRIP_ROWS;
        while height > 1 && height * self.region.width * size_of::<f32>() > MAX_BAND_BYTES {
            height /= 2;
        }
        let (first, end) = (self.region.y as usize, self.region.bottom() as usize);
        (first / height..end.div_ceil(height))
            .map(|i| (i * height).max(first) - first..((i + 1) * height).min(end) - first)
            .collect()
    }

    /// Averages one strip.
    fn average(&self, rows: &Range<usize>, pixels: &[f32]) -> StripAverage {
        let width = self.region.width;
        let outputs = self.rows.outputs(rows.start, rows.end);
        let mut average =
            StripAverage { first: outputs.start, rows: Vec::with_capacity(outputs.len()), missing: 0 };
        let mut column = vec![0f64; width];
        let mut all_finite = true;
        for i in outputs {
            let span = self.rows.span(i);
            let inside = span.start.max(rows.start)..span.end.min(rows.end);
            column.fill(0.0);
            for k in inside.clone() {
                let weight = self.rows.weight(i, k);
                let row = &pixels[(k - rows.start) * width..][..width];
                column.iter_mut().zip(row).for_each(|(c, &v)| *c += weight * f64::from(v));
            }
            let height: f64 = inside.clone().map(|k| self.rows.weight(i, k)).sum();
            let mut sums = Sums::with_capacity(self.out.width);
            for j in 0..self.out.width {
                let span = self.columns.span(j);
                let mut sum = 0.0;
                if let [first, middle @ .., last] = &column[span.clone()] {
                    let ends = first * self.columns.weight(j, span.start)
                        + last * self.columns.weight(j, span.end - 1);
                    sum = ends + middle.iter().sum::<f64>() * self.columns.out as f64;
                } else if let [only] = &column[span.clone()] {
                    sum = only * self.columns.weight(j, span.start);
                }
                let mut weight = height * self.columns.source as f64;
                if !sum.is_finite() {
                    all_finite = false;
                    (sum, weight) = self.finite_sum((i, inside.clone()), j, rows.start, pixels);
                }
                sums.push((sum, weight));
            }
            average.rows.push(match (inside == span, span.end <= rows.end) {
                (true, _) => Row::Complete(means(&sums)),
                (false, last) => Row::Partial { sums, last },
            });
        }
        if !all_finite {
            average.missing = pixels.iter().filter(|v| !v.is_finite()).count() as u64;
        }
        average
    }

    /// Sum and weight of output pixel (i, j) over the finite samples of rows `inside` of a strip.
    fn finite_sum(
        &self,
        (i, inside): (usize, Range<usize>),
        j: usize,
        first_row: usize,
        pixels: &[f32],
    ) -> (f64, f64) {
        let mut total = (0.0, 0.0);
        for k in inside {
            let row = &pixels[(k - first_row) * self.region.width..];
            for l in self.columns.span(j) {
                if row[l].is_finite() {
                    let weight = self.rows.weight(i, k) * self.columns.weight(j, l);
                    total.0 += weight * f64::from(row[l]);
                    total.1 += weight;
                }
            }
        }
        total
    }
}

/// Weighted sum and weight of each pixel of an output row.
type Sums = Vec<(f64, f64)>;

/// Means as samples; NaN where no sample was finite.
fn means(sums: &Sums) -> Vec<f32> {
    sums.iter().map(|(sum, weight)| (sum / weight) as f32).collect()
}

enum Row {
    /// Means of an output row that lies in one strip.
    Complete(Vec<f32>),
    /// Contribution of this strip to an output row, and whether it is the last one.
    Partial { sums: Sums, last: bool },
}

/// Averages of one band of a strip.
struct StripAverage {
    /// Output row of `rows[0]`.
    first: usize,
    rows: Vec<Row>,
    missing: u64,
}

/// Receives output rows: (position among the bands, output row, its means). Rows of one band come in order.
pub(super) type Emit<'a> = dyn FnMut(usize, usize, &[f32]) -> Result<(), PictureError> + Send + 'a;

/// Averages `bands` of a source onto `grid`. Returns the number of missing samples.
pub(super) fn stream(
    source: &dyn ChartSource,
    bands: &[usize],
    grid: &Grid,
    threads: usize,
    progress: Progress<'_>,
    emit: &mut Emit<'_>,
) -> Result<u64, PictureError> {
    let merge = OrderedMerge {
        state: Mutex::new(State {
            next_unit: 0,
            error: None,
            panicked: false,
            partial: bands.iter().map(|_| None).collect(),
            missing: 0,
            read: 0,
            emit,
        }),
        unit_added: Condvar::new(),
        total: (grid.region.size().pixels() * bands.len()) as u64,
        progress,
    };
    let strips = grid.strips();
    let next = AtomicUsize::new(0);
    let work = || {
        let _on_panic = WakeOnPanic(&merge);
        let mut pixels = Vec::new();
        loop {
            let unit = next.fetch_add(1, Ordering::Relaxed);
            let (strip, position) = (unit / bands.len().max(1), unit % bands.len().max(1));
            let Some(rows) = strips.get(strip).filter(|_| !bands.is_empty()) else { return };
            let region = &grid.region;
            let rect = Rect::new(region.y + rows.start as i64, region.x, rows.len(), region.width);
            pixels.resize(rect.size().pixels(), 0.0);
            let average = source
                .read(bands[position], rect, &mut pixels)
                .map(|()| grid.average(rows, &pixels))
                .map_err(|source| PictureError::Read { band: bands[position], rect, source });
            if !merge.add_in_order(unit, position, pixels.len(), average) {
                return;
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads.max(1) {
            scope.spawn(work);
        }
        work();
    });
    let state = merge.state.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    state.error.map_or(Ok(state.missing), Err)
}

/// Adds the averages of units in their order.
struct OrderedMerge<'a, 'e> {
    state: Mutex<State<'a, 'e>>,
    unit_added: Condvar,
    total: u64,
    progress: Progress<'a>,
}

struct State<'a, 'e> {
    next_unit: usize,
    error: Option<PictureError>,
    panicked: bool,
    /// Per band: sums of the output row that continues in the next strip.
    partial: Vec<Option<Sums>>,
    missing: u64,
    read: u64,
    emit: &'a mut Emit<'e>,
}

impl OrderedMerge<'_, '_> {
    /// Waits until all units before `unit` are added, then adds it. False after an error: the worker stops.
    fn add_in_order(
        &self,
        unit: usize,
        position: usize,
        samples: usize,
        average: Result<StripAverage, PictureError>,
    ) -> bool {
        let locked = self.state.lock().expect("a worker panicked");
        let waiting = |s: &mut State<'_, '_>| s.next_unit != unit && s.error.is_none() && !s.panicked;
        let mut state = self.unit_added.wait_while(locked, waiting).expect("a worker panicked");
        if state.error.is_some() || state.panicked {
            return false;
        }
        let added = average.and_then(|average| state.add(position, average));
        state.next_unit += 1;
        state.read += samples as u64;
        (self.progress)(state.read, self.total);
        state.error = added.err();
        self.unit_added.notify_all();
        state.error.is_none()
    }
}

impl State<'_, '_> {
    fn add(&mut self, position: usize, average: StripAverage) -> Result<(), PictureError> {
        self.missing += average.missing;
        for (i, row) in (average.first..).zip(average.rows) {
            match row {
                Row::Complete(means) => (self.emit)(position, i, &means)?,
                Row::Partial { mut sums, last } => {
                    if let Some(before) = self.partial[position].take() {
                        sums.iter_mut().zip(before).for_each(|(s, b)| *s = (s.0 + b.0, s.1 + b.1));
                    }
                    if last {
                        (self.emit)(position, i, &means(&sums))?;
                    } else {
                        self.partial[position] = Some(sums);
                    }
                }
            }
        }
        Ok(())
    }
}

/// Stops the waiting workers when one panics: its unit is never added.
struct WakeOnPanic<'a, 'b, 'e>(&'a OrderedMerge<'b, 'e>);

impl Drop for WakeOnPanic<'_, '_, '_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner).panicked = true;
            self.0.unit_added.notify_all();
        }
    }
}
