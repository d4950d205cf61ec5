//! Light of a PSF in squares about its centre.

/// Share in the centred square of 2i + 1 samples a side, for every i.
pub(in crate::design) fn squares(psf: &[f32], n: usize) -> Vec<f64> {
    let half = n / 2;
    let mut rings = vec![0.0; half + 1];
    for (y, row) in psf.chunks_exact(n).enumerate() {
        for (x, v) in row.iter().enumerate() {
            rings[y.abs_diff(half).max(x.abs_diff(half))] += f64::from(*v);
        }
    }
    rings
        .iter()
        .scan(0.0, |sum, r| {
            *sum += r;
            Some(*sum)
        })
        .collect()
}

/// Share in the centred square of `side` samples a side, interpolated between `squares`.
pub(in crate::design) fn within(squares: &[f64], side: f64) -> f64 {
    let at = (0.5 * (side - 1.0)).max(0.0);
    let i = (at as usize).min(squares.len() - 1);
    let next = squares[(i + 1).min(squares.len() - 1)];
    squares[i] + (at - i as f64).min(1.0) * (next - squares[i])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_linear_between_squares_of_whole_samples() {
        let held = squares(&[1.0; 25], 5);
        assert_eq!(held, [1.0, 9.0, 25.0]);
        assert_eq!([1.0, 3.0, 4.0, 5.0, 7.0].map(|side| within(&held, side)), [1.0, 9.0, 17.0, 25.0, 25.0]);
    }
}
