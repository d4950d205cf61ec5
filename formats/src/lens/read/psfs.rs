//! PSF windows of a band, as stored or as computed from pupil functions, with validation of all samples.

use super::{CHUNKS, PackArray};
use crate::lens::error::LensPackError;
use crate::lens::store::PackStore;
use pipeline::bounds;
use pipeline::design::pupil_stack::PupilStack;
use pipeline::lens::planar::PsfPlaces;
use pipeline::lens::{Lens, LensBand, PsfStack};
use std::ops::Range;
use std::path::Path;

/// Maximum deviation of a window's sum from 1.
pub const SUM_TOLERANCE: f64 = 1e-3;
/// A window whose sum deviates from 1 by less is not normalised: f32 rounding alone gives 1e-7.
const SUM_EXACT: f64 = 1e-6;

/// Reads the windows of one band, of the depth node `node` of a pack that has some: finite, each with sum 1.
pub fn psf(
    store: &PackStore,
    lens: &Lens,
    index: usize,
    node: Option<usize>,
) -> Result<PsfStack, LensPackError> {
    windows(store, lens, (index, node), None)
}

/// As [`psf`], or the windows `only`.
pub fn windows(
    store: &PackStore,
    lens: &Lens,
    (index, node): (usize, Option<usize>),
    only: Option<Range<usize>>,
) -> Result<PsfStack, LensPackError> {
    let bands = lens.bands.len();
    let band = lens.bands.get(index).ok_or_else(|| LensPackError::Band {
        path: store.path.clone(),
        band: index,
        bands,
    })?;
    let (name, places, n, pitch_um) = match lens.depth.as_ref().zip(node) {
        None => (format!("psf/{index}"), Places::Band(band), band.psf_size, band.psf_pitch_um),
        Some((depth, d)) => {
            let node = &depth.bands[index].nodes[d];
            (
                format!("psf/{index}/{d}"),
                Places::Heights(&node.psf_height_mm),
                node.psf_size,
                node.psf_pitch_um,
            )
        }
    };
    let array = PackArray::open(store, &name)?;
    array.expect_shape(&[places.count(), n, n], "PSFs, rows, columns")?;
    let rows = only.unwrap_or(0..places.count());
    let samples = array.read_rows(rows.clone(), |v| v as f32)?;
    let mut values = samples.values;
    for (k, window) in rows.zip(values.chunks_exact_mut(n * n)) {
        let place = Window { path: &store.path, array: &name, band: index, index: k, places: &places };
        place.normalise(window, || samples.missing.clone().map(|chunk| array.missing_chunk(chunk)))?;
    }
    Ok(PsfStack { size: n, pitch_um, sample: lens.psf_sample, samples: values })
}

/// The PSFs of pupil functions of band `index`, of which the first is that of window `first`, computed on `threads` threads: finite, each with sum 1.
pub fn psfs_of(
    store: &PackStore,
    lens: &Lens,
    (index, first): (usize, usize),
    pupils: &PupilStack,
    threads: usize,
) -> Result<PsfStack, LensPackError> {
    let name = format!("pupil/{index}");
    let invalid = |source| LensPackError::Pupil { path: store.path.clone(), array: name.clone(), source };
    let mut stack = pupils.psfs(threads).map_err(invalid)?;
    let n = stack.size;
    let places = Places::Band(&lens.bands[index]);
    for (k, window) in (first..).zip(stack.samples.chunks_exact_mut(n * n)) {
        let place = Window { path: &store.path, array: &name, band: index, index: k, places: &places };
        place.normalise(window, || None)?;
    }
    Ok(stack)
}

/// Place of a window in a pack.
struct Window<'a> {
    path: &'a Path,
    array: &'a str,
    band: usize,
    index: usize,
    places: &'a Places<'a>,
}

/// Places of the windows of a stack.
enum Places<'a> {
    /// Of a band without depth nodes.
    Band(&'a LensBand),
    /// Real image heights of a depth node, mm.
    Heights(&'a [f64]),
}

impl Places<'_> {
    fn count(&self) -> usize {
        match self {
            Self::Band(band) => band.psf_count(),
            Self::Heights(heights_mm) => heights_mm.len(),
        }
    }

    /// The place of window `index`, for errors.
    fn name(&self, index: usize) -> String {
        let at = |heights_mm: &[f64], k: usize| format!("height {k} ({:.3} mm)", heights_mm[k]);
        let band = match self {
            Self::Heights(heights_mm) => return at(heights_mm, index),
            Self::Band(band) => band,
        };
        match band.planar.as_ref().map(|planar| &planar.psfs) {
            None => at(&band.psf_height_mm, index),
            Some(PsfPlaces::Polar { azimuth_samples }) => {
                let (mut k, mut a) = (0, index);
                while a >= azimuth_samples[k] {
                    (k, a) = (k + 1, a - azimuth_samples[k]);
                }
                format!("{}, azimuth {a} of {}", at(&band.psf_height_mm, k), azimuth_samples[k])
            }
            Some(PsfPlaces::Cartesian { x_mm, y_mm }) => {
                let (row, column) = (index / x_mm.len(), index % x_mm.len());
                format!("row {row}, column {column} ({:.3}, {:.3} mm)", x_mm[column], y_mm[row])
            }
        }
    }
}

impl Window<'_> {
    /// Checks that `window` is finite and of sum 1, and divides it by its sum where that deviates; `missing`: the error of a chunk that is not
    /// stored.
    fn normalise(
        &self,
        window: &mut [f32],
        missing: impl FnOnce() -> Option<LensPackError>,
    ) -> Result<(), LensPackError> {
        if let Some(i) = window.iter().position(|v| !v.is_finite()) {
            return Err(LensPackError::Value {
                path: self.path.into(),
                array: self.array.into(),
                band: self.band,
                index: self.index * window.len() + i,
                value: f64::from(window[i]),
                expected: "a finite number",
            });
        }
        let sum: f64 = window.iter().map(|&v| f64::from(v)).sum();
        let deviation = (sum - 1.0).abs();
        // A writer may omit chunks of zeros; then the sums are 1 without them.
        if deviation > SUM_EXACT
            && let Some(error) = missing()
        {
            return Err(error);
        }
        if deviation > SUM_TOLERANCE {
            return Err(LensPackError::PsfSum {
                path: self.path.into(),
                array: self.array.into(),
                index: self.index,
                place: self.places.name(self.index),
                sum,
            });
        }
        if deviation > SUM_EXACT {
            window.iter_mut().for_each(|v| *v = (f64::from(*v) / sum) as f32);
        }
        Ok(())
    }
}

/// Side of the windows of the array `name` and bytes for reading them, from the metadata; `k`: their number, and what it is.
pub(super) fn size(
    store: &PackStore,
    name: &str,
    (k, what): (usize, &str),
) -> Result<(usize, usize), LensPackError> {
    let array = PackArray::open(store, name)?;
    array.expect_float()?;
    match array.shape[..] {
        [_, rows, _] if !bounds::PSF_SIDE.contains(rows as f64) => {
            Err(array.shape_error(format!("[{k}, n, n] with n odd, {}", bounds::PSF_SIDE)))
        }
        [windows, rows, columns] if windows as usize == k && rows == columns && rows % 2 == 1 => {
            Ok((rows as usize, CHUNKS * array.chunk_bytes() as usize))
        }
        _ => Err(array.shape_error(format!("[{k}, n, n] with n odd ({k} {what})"))),
    }
}
