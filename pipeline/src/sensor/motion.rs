//! Motion of the camera during an exposure: the film as each row of a sensor sees it.
//!
//! At the time t the picture on the film is shifted by s(t) (µm; right, down) and then rotated about the optical axis by θ(t) (clockwise as the film is seen with rows down). s and θ are linear between the rows of a table. The film pixel p (µm from the axis) under the
//! sensor row r, which is exposed from r·row time on for T, then has the mean
//!
//! ```text
//! E'(p) = 1/K·Σ_k E(R(−θ(t_k))·p − s(t_k)),   t_k = r·row time + T·(k + ½)/K
//! ```
//!
//! K is such that no pixel of the film moves by more than [`STEP_PX`] between two t_k: of a pattern of ν cycles a pixel the sum is larger than the integral by (πν/4)²/6, 2.6 % at 0.5 and 0.6 % at 0.25. Between film pixels E is interpolated by cubic convolution
//! (R. G. Keys, IEEE Trans. ASSP 29, 1981, a = −½): weights sum to 1, so light is kept, up to what a rolling shutter shows twice or not at all. Offsets are those of the middle of a few columns, so many that they differ from the own ones by at most 0.02 px. Beyond the film the last pixel counts on.
//! Left out: PSFs, distortion and relative illumination stay where they are on the film, though they belong to the picture that moves: with a field that changes over the length of the motion, the error is that change.

use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};
use crate::real;

/// Largest movement of a film pixel between two moments that are summed, px.
pub const STEP_PX: f64 = 0.25;
/// Largest difference of the offset of a film pixel from that of the middle of its columns, px.
const ROTATED_PX: f64 = 0.02;
/// Columns that share offsets, at most.
const COLUMNS: usize = 512;
/// Pixels beyond an offset that the interpolation reads.
const HALO_PX: f64 = 3.0;

/// A place of the camera at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Time since the start of the first row, s.
    pub time_s: f64,
    /// Shift of the picture to the right, µm.
    pub x_um: f64,
    /// Shift of the picture down, µm.
    pub y_um: f64,
    /// Rotation of the picture about the optical axis, rad.
    pub rotation_rad: f64,
}

/// When the rows of a sensor are exposed, and where they are on the film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RowTimes {
    /// Time from the start of a row to that of the next, s.
    pub row_time_s: f64,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Rows of the sensor.
    pub rows: usize,
    /// Upper edge of the first row, film pixels from the film's upper edge.
    pub first_px: f64,
    /// Film pixels a row.
    pub row_px: f64,
}

impl RowTimes {
    /// End of the last row, s.
    pub fn end_s(&self) -> f64 {
        self.row_time_s * (self.rows.max(1) - 1) as f64 + self.exposure_s
    }

    /// Start of the sensor row over a film row, s.
    fn start_s(&self, film_row: i64) -> f64 {
        let row = ((film_row as f64 + 0.5 - self.first_px) / self.row_px).floor();
        row.clamp(0.0, (self.rows.max(1) - 1) as f64) * self.row_time_s
    }
}

/// A film behind a camera that moves.
#[derive(Clone, Debug)]
pub struct Motion {
    poses: Vec<Pose>,
    times: RowTimes,
    pitch_um: f64,
    /// Optical axis (row, column), film pixels, 0 at the middle of the first.
    axis_px: (f64, f64),
    /// K.
    steps: usize,
    margin_px: usize,
    columns: usize,
}

impl Motion {
    /// Of `poses`, in order of time, at least one; `axis_px`: (row, column) of the optical axis on a film of `size` pixels, from the middle of the first.
    pub fn new(
        poses: Vec<Pose>,
        times: RowTimes,
        (size, pitch_um, axis_px): (Size, f64, (f64, f64)),
    ) -> Self {
        let farthest = |axis: f64, n: usize| axis.abs().max((n as f64 - 1.0 - axis).abs());
        let radius_um =
            real::hypot(farthest(axis_px.0, size.height), farthest(axis_px.1, size.width)) * pitch_um;
        let mut motion = Self { poses, times, pitch_um, axis_px, steps: 1, margin_px: 0, columns: COLUMNS };
        let rotated = motion.seen().map(|pose| pose.rotation_rad.abs()).fold(0.0, f64::max);
        motion.steps = (motion.fastest_um_per_s(radius_um) * times.exposure_s / pitch_um / STEP_PX)
            .ceil()
            .max(1.0) as usize;
        motion.margin_px = (motion.reach_um(radius_um) / pitch_um + HALO_PX).ceil() as usize;
        // An offset changes by at most 2·sin(θ/2) a pixel.
        motion.columns = ((2.0 * ROTATED_PX / rotated.max(1e-9)) as usize).clamp(1, COLUMNS);
        motion
    }

    /// The poses of the exposure: its start and end, and those between.
    fn seen(&self) -> impl Iterator<Item = Pose> {
        let end_s = self.times.end_s();
        let between = self.poses.iter().copied().filter(move |pose| pose.time_s > 0.0 && pose.time_s < end_s);
        [self.at(0.0)].into_iter().chain(between).chain([self.at(end_s)])
    }

    /// The pose at a time; before the first and after the last they stay.
    fn at(&self, time_s: f64) -> Pose {
        let i = self.poses.partition_point(|pose| pose.time_s <= time_s);
        let (Some(a), Some(b)) = (i.checked_sub(1).and_then(|i| self.poses.get(i)), self.poses.get(i)) else {
            return self.poses.get(i.saturating_sub(1)).copied().unwrap_or_default();
        };
        let t = (time_s - a.time_s) / (b.time_s - a.time_s);
        let of = |f: fn(&Pose) -> f64| f(a) + t * (f(b) - f(a));
        Pose { time_s, x_um: of(|p| p.x_um), y_um: of(|p| p.y_um), rotation_rad: of(|p| p.rotation_rad) }
    }

    /// Greatest speed of a point so far from the axis, during the exposure, µm/s.
    fn fastest_um_per_s(&self, radius_um: f64) -> f64 {
        let poses: Vec<Pose> = self.seen().collect();
        let speed = |p: &[Pose]| {
            let shifted = real::hypot(p[1].x_um - p[0].x_um, p[1].y_um - p[0].y_um);
            let rotated = (p[1].rotation_rad - p[0].rotation_rad).abs() * radius_um;
            let seconds = p[1].time_s - p[0].time_s;
            if seconds > 0.0 { (shifted + rotated) / seconds } else { 0.0 }
        };
        poses.windows(2).map(speed).fold(0.0, f64::max)
    }

    /// Greatest distance of a point so far from the axis from where it is without motion, µm.
    pub fn reach_um(&self, radius_um: f64) -> f64 {
        let of =
            |p: Pose| real::hypot(p.x_um, p.y_um) + 2.0 * real::sin(0.5 * p.rotation_rad).abs() * radius_um;
        self.seen().map(of).fold(0.0, f64::max)
    }

    /// K: moments whose mean is an exposure.
    pub fn steps(&self) -> usize {
        self.steps
    }

    /// Film pixels around those that are read.
    pub fn margin_px(&self) -> usize {
        self.margin_px
    }

    /// The film as the rows of the sensor see it.
    pub fn film<'a>(&'a self, film: &'a dyn ChartSource) -> MovedFilm<'a> {
        MovedFilm { film, motion: self }
    }

    /// The moments t_k of a film row.
    fn moments(&self, row: i64) -> Vec<Moment> {
        let start_s = self.times.start_s(row);
        let moment = |k: usize| {
            let time_s = start_s + self.times.exposure_s * (k as f64 + 0.5) / self.steps as f64;
            let pose = self.at(time_s);
            let (sin, cos) = (real::sin(pose.rotation_rad), real::cos(pose.rotation_rad));
            Moment { sin, cos, shift_px: (pose.y_um / self.pitch_um, pose.x_um / self.pitch_um) }
        };
        (0..self.steps).map(moment).collect()
    }

    /// Weights of the film pixels around those of a film row whose columns have the middle `column`: offsets (down, right) and weights, in order.
    fn kernel(&self, moments: &[Moment], row: i64, column: f64) -> Vec<((i64, i64), f64)> {
        let (y, x) = (row as f64 - self.axis_px.0, column - self.axis_px.1);
        let offset = |m: &Moment| {
            let from = (m.cos * y - m.sin * x, m.sin * y + m.cos * x);
            (from.0 - y - m.shift_px.0, from.1 - x - m.shift_px.1)
        };
        let offsets: Vec<(f64, f64)> = moments.iter().map(offset).collect();
        let first = |of: fn(&(f64, f64)) -> f64| {
            offsets.iter().map(of).fold(f64::INFINITY, f64::min).floor() as i64 - 1
        };
        let last = |of: fn(&(f64, f64)) -> f64| {
            offsets.iter().map(of).fold(f64::NEG_INFINITY, f64::max).floor() as i64 + 2
        };
        let (top, left) = (first(|o| o.0), first(|o| o.1));
        let (height, width) = ((last(|o| o.0) - top + 1) as usize, (last(|o| o.1) - left + 1) as usize);
        let mut weights = vec![0.0; height * width];
        for (down, right) in &offsets {
            let (i, j) =
                ((down.floor() as i64 - 1 - top) as usize, (right.floor() as i64 - 1 - left) as usize);
            let (of_rows, of_columns) = (cubic(down - down.floor()), cubic(right - right.floor()));
            for (m, of_row) in of_rows.iter().enumerate() {
                let line = &mut weights[(i + m) * width + j..][..4];
                std::iter::zip(line, &of_columns).for_each(|(w, of_column)| *w += of_row * of_column);
            }
        }
        let share = 1.0 / self.steps as f64;
        let place = |k: usize| (top + (k / width) as i64, left + (k % width) as i64);
        let used = weights.iter().enumerate().filter(|(_, w)| **w != 0.0);
        used.map(|(k, w)| (place(k), w * share)).collect()
    }
}

/// The camera at a moment of the exposure of a row.
struct Moment {
    sin: f64,
    cos: f64,
    /// (down, right).
    shift_px: (f64, f64),
}

/// Weights of the pixels −1, 0, 1, 2 of cubic convolution at a fraction of a pixel.
fn cubic(f: f64) -> [f64; 4] {
    [
        ((-0.5 * f + 1.0) * f - 0.5) * f,
        (1.5 * f - 2.5) * f * f + 1.0,
        ((-1.5 * f + 2.0) * f + 0.5) * f,
        (0.5 * f - 0.5) * f * f,
    ]
}

/// A film as the rows of a sensor see it while the camera moves.
#[derive(Clone, Copy)]
pub struct MovedFilm<'a> {
    film: &'a dyn ChartSource,
    motion: &'a Motion,
}

impl MovedFilm<'_> {
    /// What is read for `rect`.
    fn needs(&self, rect: Rect) -> Rect {
        rect.grown(self.motion.margin_px).intersect(self.film.size().rect())
    }
}

impl ChartSource for MovedFilm<'_> {
    fn size(&self) -> Size {
        self.film.size()
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        let needs = self.needs(rect);
        let mut pixels = vec![0.0; needs.size().pixels()];
        self.film.read(band, needs, &mut pixels)?;
        let columns = self.motion.columns as i64;
        let mut sums = Vec::with_capacity(self.motion.columns);
        for (line, y) in out.chunks_mut(rect.width).zip(rect.y..) {
            let moments = self.motion.moments(y);
            let mut x = rect.x;
            while x < rect.right() {
                // Columns of the whole film share offsets, so that a part has those of the whole.
                let block = x / columns;
                let end = ((block + 1) * columns).min(rect.right());
                let middle = (block * columns) as f64 + 0.5 * (columns - 1) as f64;
                sums.clear();
                sums.resize((end - x) as usize, 0.0);
                for ((down, right), weight) in self.motion.kernel(&moments, y, middle) {
                    let row = (y + down).clamp(needs.y, needs.bottom() - 1) - needs.y;
                    let row = &pixels[row as usize * needs.width..][..needs.width];
                    if x + right >= needs.x && end + right <= needs.right() {
                        let from = &row[(x + right - needs.x) as usize..][..sums.len()];
                        std::iter::zip(&mut sums, from).for_each(|(sum, v)| *sum += weight * f64::from(*v));
                    } else {
                        for (k, sum) in sums.iter_mut().enumerate() {
                            let at = (x + right + k as i64).clamp(needs.x, needs.right() - 1) - needs.x;
                            *sum += weight * f64::from(row[at as usize]);
                        }
                    }
                }
                let to = &mut line[(x - rect.x) as usize..][..sums.len()];
                std::iter::zip(to, &sums).for_each(|(to, sum)| *to = *sum as f32);
                x = end;
            }
        }
        Ok(())
    }

    fn prefetch(&self, band: usize, rect: Rect) {
        self.film.prefetch(band, self.needs(rect));
    }
}

#[cfg(test)]
mod tests;
