//! PSF windows of a field: read band by band, in the film frame, centred, of sum 1.

use super::arrays::{ArrayName, Loader};
use super::axis::Axes;
use super::centre;
use super::description::{Centre, Description};
use crate::import::npy::Npy;
use crate::import::{ImportError, MAX_SIDE};
use pipeline::bounds;
use pipeline::lens::planar::PsfPlaces;
use pipeline::lens::{PsfSample, PsfStack};
use std::path::Path;

/// The windows of all bands.
pub(super) struct Windows {
    /// One a band, or one of all.
    files: Vec<ArrayName>,
    axes: Axes,
    /// Sides by band, samples.
    sides: Vec<usize>,
    pitch_um: f64,
    sample: PsfSample,
    y_up: bool,
    centre: Centre,
}

impl Windows {
    /// The places, and the sizes of the windows of each band.
    pub fn new(path: &Path, description: &Description, loader: &mut Loader) -> Result<Self, ImportError> {
        let psf = &description.psf;
        let axes = Axes::load(path, &psf.grid, "[psf]", bounds::PSF_COLUMNS, loader)?;
        let bands = description.wavelengths_nm.len();
        if let Err(e) = bounds::PSF_ROWS.check_product(&[axes.y.len(), axes.x.len()]) {
            return Err(ImportError::file(path, format!("[psf] {e}")));
        }
        let sides = (0..bands).map(|b| {
            let file = &psf.files[b % psf.files.len()];
            let shared = (psf.files.len() < bands).then_some(bands);
            side(loader.load(file)?, &axes, shared).map_err(|e| file.error(e))
        });
        Ok(Self {
            sides: sides.collect::<Result<_, _>>()?,
            files: psf.files.clone(),
            axes,
            pitch_um: psf.pitch_um,
            sample: psf.sample,
            y_up: psf.grid.y_up,
            centre: psf.centre,
        })
    }

    /// Places of the windows on the film.
    pub fn places(&self) -> PsfPlaces {
        PsfPlaces::Cartesian { x_mm: self.axes.x.film_mm.clone(), y_mm: self.axes.y.film_mm.clone() }
    }

    pub fn axes(&self) -> &Axes {
        &self.axes
    }

    /// Side of the windows of band `b`, samples.
    pub fn side(&self, b: usize) -> usize {
        self.sides[b]
    }

    /// Half the side of the largest window, mm.
    pub fn half_side_mm(&self) -> f64 {
        self.sides.iter().max().map_or(0.0, |&n| n as f64 * self.pitch_um * 0.5e-3)
    }

    pub fn centre(&self) -> Centre {
        self.centre
    }

    pub fn y_up(&self) -> bool {
        self.y_up
    }

    /// The windows of band `b`, and the number of negative samples in their file.
    pub fn read(&self, b: usize, loader: &mut Loader) -> Result<(PsfStack, usize), ImportError> {
        let file = &self.files[b % self.files.len()];
        let array = loader.load(file)?;
        let (n, count) = (self.sides[b], self.axes.count());
        let first = if self.files.len() < self.sides.len() { b * count } else { 0 };
        let mut samples = Vec::with_capacity(count * n * n);
        let mut negative = 0;
        for (j, i) in (0..self.axes.y.len()).flat_map(|j| (0..self.axes.x.len()).map(move |i| (j, i))) {
            let (row, column) = (self.axes.y.source(j), self.axes.x.source(i));
            let at = first + row * self.axes.x.len() + column;
            let Some(window) = array.values.get(at * n * n..(at + 1) * n * n) else {
                return Err(file.error("changed while it was read"));
            };
            negative += window.iter().filter(|v| **v < 0.0).count();
            let window = self.window(window, n).map_err(|e| {
                let (x, y) = (self.axes.x.film_mm[i], self.axes.y.film_mm[j]);
                file.error(format!("the window of row {row}, column {column} (film place {x}, {y} mm) {e}"))
            })?;
            samples.extend(window);
        }
        Ok((PsfStack { size: n, pitch_um: self.pitch_um, sample: self.sample, samples }, negative))
    }

    /// One window of sum 1, row down, centred.
    fn window(&self, window: &[f64], n: usize) -> Result<Vec<f32>, String> {
        if let Some(i) = window.iter().position(|v| !v.is_finite()) {
            let (row, column) = (i / n, i % n);
            return Err(format!(
                "has {} at row {row}, column {column}, expected a finite number; fill such samples from their neighbours",
                window[i]
            ));
        }
        let mut window = match self.y_up {
            false => window.to_vec(),
            true => window.chunks_exact(n).rev().flatten().copied().collect(),
        };
        normalise(&mut window)?;
        if self.centre != Centre::Keep {
            window = self.centred(&window, n)?;
            normalise(&mut window)?;
        }
        let mut samples: Vec<f32> = window.iter().map(|v| *v as f32).collect();
        let sum: f64 = samples.iter().map(|v| f64::from(*v)).sum();
        samples.iter_mut().for_each(|v| *v = (f64::from(*v) / sum) as f32);
        Ok(samples)
    }

    fn centred(&self, window: &[f64], n: usize) -> Result<Vec<f64>, String> {
        if self.centre == Centre::Peak {
            return centre::whole(window, n, centre::peak(window, n));
        }
        let [x, y] = centre::centroid(window, n);
        let half = (n / 2) as f64;
        if !(x.abs() <= half && y.abs() <= half) {
            return Err(format!(
                "has its centroid at ({x:.1}, {y:.1}) samples from its middle, expected it inside; subtract the background"
            ));
        }
        let by = [x.round() as isize, y.round() as isize];
        let moved = centre::whole(window, n, by)?;
        match self.sample {
            PsfSample::Integrated => Ok(moved),
            PsfSample::Point => Ok(centre::fraction(&moved, n, [x - x.round(), y - y.round()])),
        }
    }
}

/// Sum of a window over that of its absolute samples, at least: what is less is noise about 0, and division by the sum would enlarge it.
const MIN_SUM: f64 = 0.1;

/// Divides a window by its sum.
fn normalise(window: &mut [f64]) -> Result<(), String> {
    let sum: f64 = window.iter().sum();
    if !(sum > 0.0 && sum.is_finite()) {
        return Err(format!("has the sum {sum}, expected a positive number; subtract less background"));
    }
    let share = sum / window.iter().map(|v| v.abs()).sum::<f64>();
    if share < MIN_SUM {
        return Err(format!(
            "has a sum of {share:.1e} of that of its absolute samples, expected at least {MIN_SUM}; subtract less background, or cut the window"
        ));
    }
    window.iter_mut().for_each(|v| *v /= sum);
    Ok(())
}

/// Side of the windows of an array at the places `axes`, of all `bands` of a shared file.
fn side(array: &Npy, axes: &Axes, bands: Option<usize>) -> Result<usize, String> {
    let (rows, columns) = (axes.y.len(), axes.x.len());
    let shape = array.shape.as_slice();
    let (found_bands, windows) = match (bands, shape) {
        (Some(_), [found, rest @ ..]) => (Some(*found), rest),
        (_, all) => (None, all),
    };
    let side = match *windows {
        [r, c, height, width] if (r, c) == (rows, columns) => Some((height, width)),
        [count, height, width] if count == rows * columns => Some((height, width)),
        _ => None,
    };
    let Some((height, width)) = side.filter(|_| found_bands == bands) else {
        let of_bands = bands.map_or(String::new(), |b| format!("{b}, "));
        return Err(format!(
            "has shape {shape:?}, expected ({of_bands}{rows}, {columns}, n, n): {rows} places of y_mm and {columns} of x_mm; \
             places that are no grid (scattered) are not read"
        ));
    };
    if height != width {
        return Err(format!(
            "has windows of {height} × {width} samples, expected squares; pad them with zeros"
        ));
    }
    if height.is_multiple_of(2) {
        return Err(format!(
            "has windows of {height} × {height} samples, expected an odd number, with the reference point on the middle one; drop or add a row and a column"
        ));
    }
    match height <= MAX_SIDE {
        true => Ok(height),
        false => Err(format!("has windows of {height} samples, expected at most {MAX_SIDE}")),
    }
}
