//! Predictors of TIFF (6.0, section 14; technical note 3 of Photoshop's TIFF for floats), undone row by row.

/// Predictor of compressed chunks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Predictor {
    None,
    /// Differences to the same sample of the pixel before, of integers.
    Horizontal,
    /// Bytes of equal significance side by side, most significant first; then differences of bytes.
    Float,
}

/// Adds up differences along a row of integers of `sample` bytes (native byte order), `samples` per pixel.
pub(super) fn add_horizontally(row: &mut [u8], samples: usize, sample: usize) {
    if sample == 1 {
        return add_bytes(row, samples);
    }
    let row = row.as_chunks_mut::<2>().0;
    for first in 0..samples {
        let mut sum = 0u16;
        for value in row.iter_mut().skip(first).step_by(samples) {
            sum = sum.wrapping_add(u16::from_ne_bytes(*value));
            *value = sum.to_ne_bytes();
        }
    }
}

fn add_bytes(row: &mut [u8], samples: usize) {
    for first in 0..samples {
        let mut sum = 0u8;
        for value in row.iter_mut().skip(first).step_by(samples) {
            sum = sum.wrapping_add(*value);
            *value = sum;
        }
    }
}

/// Restores a row of floats of `sample` bytes (native byte order), `samples` per pixel; `planes` is overwritten.
pub(super) fn join_floats(row: &mut [u8], samples: usize, sample: usize, planes: &mut Vec<u8>) {
    add_bytes(row, samples);
    planes.clear();
    planes.extend_from_slice(row);
    let count = row.len() / sample;
    for (k, value) in row.chunks_exact_mut(sample).enumerate() {
        for (byte, to) in value.iter_mut().enumerate() {
            let significance = if cfg!(target_endian = "little") { sample - 1 - byte } else { byte };
            *to = planes[significance * count + k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_added_per_sample_of_a_pixel() {
        let mut bytes = [250, 1, 10, 2, 1, 3];
        add_horizontally(&mut bytes, 2, 1);
        assert_eq!(bytes, [250, 1, 4, 3, 5, 6]);
        let mut words: Vec<u8> = [65_000u16, 1000, 1].into_iter().flat_map(u16::to_ne_bytes).collect();
        add_horizontally(&mut words, 1, 2);
        assert_eq!(words, [65_000u16, 464, 465].into_iter().flat_map(u16::to_ne_bytes).collect::<Vec<_>>());
    }

    #[test]
    fn bytes_of_floats_are_joined() {
        let values = [1.5f32, -2.25, 1e-20];
        let mut row: Vec<u8> = (0..4).flat_map(|b| values.map(|v| v.to_be_bytes()[b])).collect();
        for k in (1..row.len()).rev() {
            row[k] = row[k].wrapping_sub(row[k - 1]);
        }
        join_floats(&mut row, 1, 4, &mut Vec::new());
        assert_eq!(row, values.into_iter().flat_map(f32::to_ne_bytes).collect::<Vec<_>>());
    }
}
