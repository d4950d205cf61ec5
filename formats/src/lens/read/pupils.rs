//! Pupil functions of a pack of schema [`PUPIL_SCHEMA`](super::super::attributes::PUPIL_SCHEMA).

use super::{Arrays, CHUNKS, PackArray};
use crate::lens::array::MAX_SAMPLES;
use crate::lens::error::LensPackError;
use crate::lens::store::PackStore;
use pipeline::bounds;
use pipeline::design::pupil_stack::{PupilStack, SEGMENT_NUMBERS, VALUE_ROWS};
use pipeline::lens::Lens;

/// Bytes for the sum of a PSF: per sample (grids of the FFT, rays, result), and in addition.
const SUM_BYTES: (usize, usize) = (64, 8 << 20);

/// Side of the windows of band `b` at `heights` heights, stated as `side`, and bytes for computing them.
pub(super) fn side(
    tables: &Arrays<'_>,
    b: usize,
    heights: usize,
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
    if (heights * n * n) as u64 > MAX_SAMPLES {
        return Err(LensPackError::TooLarge {
            path: tables.store.path.clone(),
            array: name,
            stated: format!("{heights} PSFs of {n} × {n} samples (psf_size)"),
            limit: format!("{MAX_SAMPLES} samples"),
        });
    }
    let sum_bytes = SUM_BYTES.0 * n * n + SUM_BYTES.1;
    // The values as read and as interpolated.
    Ok((n, CHUNKS * array.chunk_bytes() as usize + 2 * 8 * values as usize + sum_bytes))
}

/// Reads the pupil functions of band `index`.
///
/// # Errors
/// There is no such band; an array is missing, damaged or of another shape; [`LensPackError::Pupil`].
pub fn pupils(store: &PackStore, lens: &Lens, index: usize) -> Result<PupilStack, LensPackError> {
    let bands = lens.bands.len();
    let no_band = || LensPackError::Band { path: store.path.clone(), band: index, bands };
    let band = lens.bands.get(index).ok_or_else(no_band)?;
    let (name, segments) = (format!("pupil/{index}"), format!("pupil_segment/{index}"));
    let segment_array = PackArray::open(store, &segments)?;
    let count = segment_array.shape[0] as usize;
    segment_array.expect_shape(&[count, SEGMENT_NUMBERS], "segments, numbers of a segment")?;
    segment_array.expect_at_most(&bounds::TABLE_NUMBERS)?;
    let array = PackArray::open(store, &name)?;
    let points = array.shape.last().map_or(0, |n| *n as usize);
    array.expect_shape(&[count, VALUE_ROWS, points], "segments, quantities, points")?;
    array.expect_float()?;
    array.expect_at_most(&bounds::PUPIL_NUMBERS)?;
    let numbers = segment_array.read()?;
    let (numbers, _) = numbers.as_chunks::<SEGMENT_NUMBERS>();
    PupilStack::from_parts(
        band.wavelength_nm,
        &band.psf_height_mm,
        (band.psf_size, band.psf_pitch_um),
        numbers,
        &array.read()?,
    )
    .map_err(|source| LensPackError::Pupil { path: store.path.clone(), array: segments, source })
}
