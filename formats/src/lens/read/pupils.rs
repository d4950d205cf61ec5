//! Pupil functions of a pack that has them in place of PSFs: of lenses with rotational symmetry 8 numbers a segment, of the half pupil; of others 9, of
//! the whole pupil.

use super::{Arrays, CHUNKS, PackArray};
use crate::lens::array::MAX_SAMPLES;
use crate::lens::error::LensPackError;
use crate::lens::store::PackStore;
use pipeline::bounds;
use pipeline::design::pupil_stack::{PupilStack, VALUE_ROWS};
use pipeline::lens::planar::PsfPlaces;
use pipeline::lens::{Lens, LensBand};
use std::ops::Range;
use std::path::Path;

/// Bytes for the sum of a PSF: per sample (grids of the FFT, rays, result), and in addition.
const SUM_BYTES: (usize, usize) = (64, 8 << 20);

/// Side of the windows of band `b`, stated as `side`, and bytes for computing them; `windows` of them are computed together.
pub(super) fn side(
    tables: &Arrays<'_>,
    b: usize,
    windows: usize,
    side: f64,
) -> Result<(usize, usize), LensPackError> {
    if !bounds::PSF_SIDE.contains(side) || side.rem_euclid(2.0) != 1.0 {
        return Err(tables.value("psf_size", b, 0, side, "an odd number up to 8191"));
    }
    let name = format!("pupil/{b}");
    let array = PackArray::open(tables.store, &name)?;
    array.expect_at_most(&bounds::PUPIL_NUMBERS)?;
    let values: u64 = array.shape.iter().product();
    let n = side as usize;
    check_together(&tables.store.path, &name, (windows, n), MAX_SAMPLES)?;
    let sum_bytes = SUM_BYTES.0 * n * n + SUM_BYTES.1;
    // The values as read and as interpolated.
    Ok((n, CHUNKS * array.chunk_bytes() as usize + 2 * 8 * values as usize + sum_bytes))
}

/// Checks that `windows` PSFs of side `n` of the pupil functions `name` have at most `max_samples` samples.
pub fn check_together(
    path: &Path,
    name: &str,
    (windows, n): (usize, usize),
    max_samples: u64,
) -> Result<(), LensPackError> {
    if (windows * n * n) as u64 <= max_samples {
        return Ok(());
    }
    Err(LensPackError::TooLarge {
        path: path.into(),
        array: name.into(),
        stated: format!("{windows} PSFs of {n} × {n} samples (psf_size) that are computed together"),
        limit: format!("{max_samples} samples"),
    })
}

/// Reads the pupil functions of band `index`, or those of the PSFs `only`.
///
/// # Errors
/// There is no such band; an array is missing, damaged or of another shape; [`LensPackError::Pupil`].
pub fn pupils(
    store: &PackStore,
    lens: &Lens,
    index: usize,
    only: Option<Range<usize>>,
) -> Result<PupilStack, LensPackError> {
    let bands = lens.bands.len();
    let no_band = || LensPackError::Band { path: store.path.clone(), band: index, bands };
    let band = lens.bands.get(index).ok_or_else(no_band)?;
    let heights_mm = heights_mm(band);
    let heights_mm = &heights_mm[only.clone().unwrap_or(0..heights_mm.len())];
    let samples = (band.psf_size, band.psf_pitch_um);
    let stack = match band.is_symmetric() {
        true => {
            let (numbers, values) = parts(store, index, only)?;
            PupilStack::from_parts(band.wavelength_nm, heights_mm, samples, &numbers, &values)
        }
        false => {
            let (numbers, values) = parts(store, index, only)?;
            PupilStack::from_whole_parts(band.wavelength_nm, heights_mm, samples, &numbers, &values)
        }
    };
    let array = format!("pupil_segment/{index}");
    stack.map_err(|source| LensPackError::Pupil { path: store.path.clone(), array, source })
}

/// `N` numbers of every segment, and values of all.
type Parts<const N: usize> = (Vec<[f64; N]>, Vec<f64>);

/// `N` numbers of each segment of band `index` and their values, or of those of the PSFs `only`, then numbered from 0.
fn parts<const N: usize>(
    store: &PackStore,
    index: usize,
    only: Option<Range<usize>>,
) -> Result<Parts<N>, LensPackError> {
    let (name, segments) = (format!("pupil/{index}"), format!("pupil_segment/{index}"));
    let segment_array = PackArray::open(store, &segments)?;
    let count = segment_array.shape[0] as usize;
    segment_array.expect_shape(&[count, N], "segments, numbers of a segment")?;
    segment_array.expect_at_most(&bounds::TABLE_NUMBERS)?;
    let array = PackArray::open(store, &name)?;
    let points = array.shape.last().map_or(0, |n| *n as usize);
    array.expect_shape(&[count, VALUE_ROWS, points], "segments, quantities, points")?;
    array.expect_float()?;
    array.expect_at_most(&bounds::PUPIL_NUMBERS)?;
    let numbers = segment_array.read()?;
    let (numbers, _) = numbers.as_chunks::<N>();
    let values = array.read()?;
    let Some(only) = only else { return Ok((numbers.to_vec(), values)) };
    let is_of = |n: &[f64; N]| n[0] >= only.start as f64 && n[0] < only.end as f64;
    let chosen = || numbers.iter().zip(values.chunks_exact(VALUE_ROWS * points)).filter(|(n, _)| is_of(n));
    let renumbered = chosen().map(|(n, _)| {
        let mut numbers = *n;
        numbers[0] -= only.start as f64;
        numbers
    });
    Ok((renumbered.collect(), chosen().flat_map(|(_, values)| values).copied().collect()))
}

/// Real image height of each PSF of `band`, mm.
fn heights_mm(band: &LensBand) -> Vec<f64> {
    match band.planar.as_ref().map(|planar| &planar.psfs) {
        None => band.psf_height_mm.clone(),
        Some(PsfPlaces::Polar { azimuth_samples }) => {
            let rows = band.psf_height_mm.iter().zip(azimuth_samples);
            rows.flat_map(|(height_mm, count)| std::iter::repeat_n(*height_mm, *count)).collect()
        }
        Some(PsfPlaces::Cartesian { x_mm, y_mm }) => {
            y_mm.iter().flat_map(|y| x_mm.iter().map(move |x| x.hypot(*y))).collect()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_samples_than_are_read_at_once_are_refused() {
        let check = |windows| check_together(Path::new("a.lens.zarr"), "pupil/2", (windows, 5), 100);
        assert!(check(4).is_ok());
        let error = check(5).unwrap_err().to_string();
        assert!(error.contains("`pupil/2`") && error.contains("5 PSFs of 5 × 5 samples"), "{error}");
        assert!(error.contains("100 samples"), "{error}");
    }
}
