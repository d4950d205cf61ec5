//! Smaller pictures by averaging over area, streamed: every source sample is read once, in strips.
//!
//!   out[i, j] = Σ w_ik·w_jl·in[k, l] / Σ w_ik·w_jl,   w_ik = length that output pixel i and source pixel k share
//! over the samples that are finite. Along an axis of n source and m output pixels (divided by their common factor)
//! source pixel k is [k·m, (k+1)·m) and output pixel i is [i·n, (i+1)·n): the weights are whole numbers, exact in f64, for any ratio.
//!
//! Workers take strips of one band in order (strip by strip, within it band by band), average them, and hand them in
//! by turns, so sums are added in one order and the picture has the same bits for any number of threads. A worker
//! holds one strip (at most 32 MiB, and a multiple of common chunk rows where that allows) and its averages; between strips, one
//! output row a band is kept.

use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex};

use super::{ChartSource, PictureError, Progress, Rect, Size, View};

/// Rows of a strip: a multiple of the inner chunks of 256 or 512 rows that stores decode at once.
const STRIP_ROWS: usize = 512;
/// Most bytes of a strip; wider images get lower strips.
const STRIP_BYTES: usize = 32 << 20;

/// How source pixels map to output pixels along one axis; both counts free of common factors.
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

    /// Source pixels that output pixel `i` touches.
    fn span(self, i: usize) -> Range<usize> {
        i * self.source / self.out..((i + 1) * self.source).div_ceil(self.out)
    }

    /// Output pixels that source pixels `from..to` touch.
    fn touched(self, from: usize, to: usize) -> Range<usize> {
        from * self.out / self.source..(to * self.out).div_ceil(self.source)
    }

    /// Length that output pixel `i` and source pixel `k`, which touch, share.
    fn weight(self, i: usize, k: usize) -> f64 {
        let end = ((k + 1) * self.out).min((i + 1) * self.source);
        (end - (k * self.out).max(i * self.source)) as f64
    }
}

/// A window of a source and the size at which it is shown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    window: Rect,
    /// Size of the picture.
    pub(super) out: Size,
    rows: Axis,
    columns: Axis,
}

impl Grid {
    /// The window of `view` with its longer side at most `max_side`: aspect kept to the pixel, never enlarged.
    pub(super) fn new(source: Size, view: &View) -> Result<Self, PictureError> {
        let window = view.window(source)?;
        let (height, width) = (window.height, window.width);
        let longest = height.max(width);
        let most = view.max_side.unwrap_or(longest).min(longest);
        // Rounded half up; a thin image keeps one pixel.
        let side = |n: usize| ((2 * n * most + longest) / (2 * longest)).max(1);
        let out = Size::new(side(height), side(width));
        Ok(Self { window, out, rows: Axis::new(height, out.height), columns: Axis::new(width, out.width) })
    }

    /// Strips (from, to) in rows of the window, cut where the source's rows are a multiple of their height.
    fn strips(&self) -> Vec<Range<usize>> {
        let mut height = STRIP_ROWS;
        while height > 1 && height * self.window.width * size_of::<f32>() > STRIP_BYTES {
            height /= 2;
        }
        let (first, end) = (self.window.y as usize, self.window.bottom() as usize);
        (first / height..end.div_ceil(height))
            .map(|i| (i * height).max(first) - first..((i + 1) * height).min(end) - first)
            .collect()
    }

    /// Averages one strip, as far as its rows go.
    fn average(&self, strip: &Range<usize>, pixels: &[f32]) -> Part {
        let width = self.window.width;
        let touched = self.rows.touched(strip.start, strip.end);
        let mut part = Part { first: touched.start, rows: Vec::with_capacity(touched.len()), missing: 0 };
        let mut column = vec![0f64; width];
        let mut whole = true;
        for i in touched {
            let span = self.rows.span(i);
            let inside = span.start.max(strip.start)..span.end.min(strip.end);
            column.fill(0.0);
            for k in inside.clone() {
                let weight = self.rows.weight(i, k);
                let row = &pixels[(k - strip.start) * width..][..width];
                column.iter_mut().zip(row).for_each(|(c, &v)| *c += weight * f64::from(v));
            }
            let height: f64 = inside.clone().map(|k| self.rows.weight(i, k)).sum();
            let mut sums = Sums { values: vec![0.0; self.out.width], weights: vec![0.0; self.out.width] };
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
                    whole = false;
                    (sum, weight) = self.finite_sum((i, inside.clone()), j, strip.start, pixels);
                }
                (sums.values[j], sums.weights[j]) = (sum, weight);
            }
            part.rows.push(match (inside == span, span.end <= strip.end) {
                (true, _) => Row::Whole(sums.means()),
                (false, last) => Row::Part { sums, last },
            });
        }
        if !whole {
            part.missing = pixels.iter().filter(|v| !v.is_finite()).count() as u64;
        }
        part
    }

    /// Sum and weight of one output pixel over the finite samples of rows `inside` of a strip.
    fn finite_sum(
        &self,
        (i, inside): (usize, Range<usize>),
        j: usize,
        strip_start: usize,
        pixels: &[f32],
    ) -> (f64, f64) {
        let mut total = (0.0, 0.0);
        for k in inside {
            let row = &pixels[(k - strip_start) * self.window.width..];
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

/// Weighted sums of one output row.
struct Sums {
    values: Vec<f64>,
    weights: Vec<f64>,
}

impl Sums {
    /// Means as samples; NaN where no sample was finite.
    fn means(&self) -> Vec<f32> {
        self.values.iter().zip(&self.weights).map(|(v, w)| (v / w) as f32).collect()
    }

    fn add(&mut self, other: &Self) {
        self.values.iter_mut().zip(&other.values).for_each(|(a, b)| *a += b);
        self.weights.iter_mut().zip(&other.weights).for_each(|(a, b)| *a += b);
    }
}

enum Row {
    /// Means of a row that lies in one strip.
    Whole(Vec<f32>),
    /// What this strip adds to a row, and whether it is the last to do so.
    Part { sums: Sums, last: bool },
}

/// What a strip makes of the output rows it touches.
struct Part {
    first: usize,
    rows: Vec<Row>,
    missing: u64,
}

/// Takes output rows: (position among the bands, output row, its means). Rows of one band come in order.
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
    let desk = Desk {
        state: Mutex::new(State {
            turn: 0,
            error: None,
            abandoned: false,
            carried: bands.iter().map(|_| None).collect(),
            missing: 0,
            read: 0,
            emit,
        }),
        turned: Condvar::new(),
        total: (grid.window.size().pixels() * bands.len()) as u64,
        progress,
    };
    let strips = grid.strips();
    let next = AtomicUsize::new(0);
    let work = || {
        let _leave = Leave(&desk);
        let mut pixels = Vec::new();
        loop {
            let unit = next.fetch_add(1, Ordering::Relaxed);
            let (strip, position) = (unit / bands.len().max(1), unit % bands.len().max(1));
            let Some(strip) = strips.get(strip).filter(|_| !bands.is_empty()) else { return };
            let window = &grid.window;
            let rect = Rect::new(window.y + strip.start as i64, window.x, strip.len(), window.width);
            pixels.resize(rect.size().pixels(), 0.0);
            let part = source
                .read(bands[position], rect, &mut pixels)
                .map(|()| grid.average(strip, &pixels))
                .map_err(|source| PictureError::Read { band: bands[position], rect, source });
            if !desk.hand_in(unit, position, pixels.len(), part) {
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
    let state = desk.state.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner);
    state.error.map_or(Ok(state.missing), Err)
}

/// Where parts are handed in by turns.
struct Desk<'a, 'e> {
    state: Mutex<State<'a, 'e>>,
    turned: Condvar,
    total: u64,
    progress: Progress<'a>,
}

struct State<'a, 'e> {
    turn: usize,
    error: Option<PictureError>,
    abandoned: bool,
    /// Per band: the output row that the strips so far have begun.
    carried: Vec<Option<Sums>>,
    missing: u64,
    read: u64,
    emit: &'a mut Emit<'e>,
}

impl Desk<'_, '_> {
    /// Waits for `unit`'s turn and adds its part. False: stop, someone has failed.
    fn hand_in(
        &self,
        unit: usize,
        position: usize,
        samples: usize,
        part: Result<Part, PictureError>,
    ) -> bool {
        let locked = self.state.lock().expect("a worker panicked");
        let waiting = |s: &mut State<'_, '_>| s.turn != unit && s.error.is_none() && !s.abandoned;
        let mut state = self.turned.wait_while(locked, waiting).expect("a worker panicked");
        if state.error.is_some() || state.abandoned {
            return false;
        }
        let added = part.and_then(|part| self.add(&mut state, position, part));
        state.turn += 1;
        state.read += samples as u64;
        (self.progress)(state.read, self.total);
        state.error = added.err();
        self.turned.notify_all();
        state.error.is_none()
    }

    fn add(&self, state: &mut State<'_, '_>, position: usize, part: Part) -> Result<(), PictureError> {
        state.missing += part.missing;
        for (i, row) in (part.first..).zip(part.rows) {
            match row {
                Row::Whole(means) => (state.emit)(position, i, &means)?,
                Row::Part { mut sums, last } => {
                    if let Some(before) = state.carried[position].take() {
                        sums.add(&before);
                    }
                    if last {
                        (state.emit)(position, i, &sums.means())?;
                    } else {
                        state.carried[position] = Some(sums);
                    }
                }
            }
        }
        Ok(())
    }
}

/// Wakes those who wait when a worker panics: its turn will never pass.
struct Leave<'a, 'b, 'e>(&'a Desk<'b, 'e>);

impl Drop for Leave<'_, '_, '_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.state.lock().unwrap_or_else(std::sync::PoisonError::into_inner).abandoned = true;
            self.0.turned.notify_all();
        }
    }
}
