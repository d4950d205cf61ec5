//! Resampling of a chart: bicubic and bilinear interpolation, the mean over a box, and the surround of the chart.
//!
//! Bicubic is Catmull-Rom (Keys 1981, a = −1/2): interpolates the pixels, exact for quadratics. Bilinear blurs (up to 0.16 % of the edge
//! spread). Where a film pixel covers more than a chart pixel (scale < 1) the chart, constant on each pixel square, is averaged over a
//! box of 1/scale chart pixels. Coordinates are an integer and an f32 fraction.

/// Interpolation between chart pixels where scale ≥ 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Interp {
    /// Catmull-Rom over 4 × 4 pixels.
    Bicubic,
    /// Linear over 2 × 2 pixels.
    Bilinear,
}

/// Values outside the chart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Surround {
    /// The nearest chart pixel.
    Edge,
    /// Zero.
    Black,
    /// The chart mirrored about the outer edge of its last pixel.
    Mirror,
}

impl Surround {
    /// The chart index for `i` on an axis of `n` pixels; `None` for black.
    pub fn index(self, i: i64, n: usize) -> Option<usize> {
        let n = n as i64;
        match self {
            _ if (0..n).contains(&i) => Some(i as usize),
            Self::Edge => Some(i.clamp(0, n - 1) as usize),
            Self::Black => None,
            Self::Mirror => {
                let m = i.rem_euclid(2 * n);
                Some(m.min(2 * n - 1 - m) as usize)
            }
        }
    }
}

/// A coordinate as an integer and a fraction in [0, 1].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Coordinate {
    pub(crate) cell: i32,
    pub(crate) fraction: f32,
}

/// Fractions below this are set to 0: below the resolution of f32 weights, and an identity map keeps all bits.
const MIN_FRACTION: f64 = 1.0 / (1u64 << 30) as f64;

/// Coordinates are clamped to ± this; sides of charts are smaller.
const MAX_COORDINATE: f64 = (1u64 << 30) as f64;
/// 1.5·2^52: adding and subtracting it rounds to an integer.
const ROUNDING: f64 = (3u64 << 51) as f64;

impl Coordinate {
    #[inline(always)]
    pub(crate) fn new(at: f64) -> Self {
        // Clamping, and rounding by addition (the low bits of the sum are the nearest integer), vectorise.
        let at = if at > -MAX_COORDINATE { at } else { -MAX_COORDINATE };
        let at = if at < MAX_COORDINATE { at } else { MAX_COORDINATE };
        let nearest = (at + ROUNDING) - ROUNDING;
        let integer = if nearest > at { nearest - 1.0 } else { nearest };
        let cell = (integer + ROUNDING).to_bits() as i32;
        let fraction = at - integer;
        Self { cell, fraction: if fraction < MIN_FRACTION { 0.0 } else { fraction as f32 } }
    }
}

/// Catmull-Rom weights of the pixels −1, 0, 1, 2 at fraction `f`.
#[inline(always)]
pub(crate) fn cubic(f: f32) -> [f32; 4] {
    [
        ((2.0 - f) * f - 1.0) * f * 0.5,
        ((3.0 * f - 5.0) * f * f + 2.0) * 0.5,
        ((4.0 - 3.0 * f) * f + 1.0) * f * 0.5,
        (f - 1.0) * f * f * 0.5,
    ]
}

/// Bicubic value from the 4 × 4 pixels that start at `from`, rows `stride` apart.
#[inline(always)]
pub(crate) fn bicubic(from: &[f32], stride: usize, fy: f32, fx: f32) -> f32 {
    let (wy, wx) = (cubic(fy), cubic(fx));
    // Column by column: four multiply-adds of four lanes, then one sum over the lanes.
    let mut lanes = [0f32; 4];
    for (i, wy) in wy.iter().enumerate() {
        let p: &[f32; 4] = from[i * stride..][..4].try_into().expect("four");
        for (lane, p) in lanes.iter_mut().zip(p) {
            *lane += wy * p;
        }
    }
    (wx[0] * lanes[0] + wx[1] * lanes[1]) + (wx[2] * lanes[2] + wx[3] * lanes[3])
}

/// Bilinear value from the 2 × 2 pixels that start at `from`, rows `stride` apart.
#[inline(always)]
pub(crate) fn bilinear(from: &[f32], stride: usize, fy: f32, fx: f32) -> f32 {
    let row = |p: &[f32]| (1.0 - fx) * p[0] + fx * p[1];
    (1.0 - fy) * row(&from[..2]) + fy * row(&from[stride..][..2])
}

/// Chart pixels that a box of `width` about `centre` intersects: first, count.
pub(crate) fn box_span(centre: f64, width: f64) -> (i64, usize) {
    let first = (centre - width / 2.0 + 0.5).floor() as i64;
    let last = (centre + width / 2.0 + 0.5).ceil() as i64 - 1;
    (first, (last - first + 1).max(1) as usize)
}

/// Weights of those pixels in the mean over the box; they sum to 1.
pub(crate) fn box_weights(centre: f64, width: f64, first: i64, out: &mut Vec<f32>, count: usize) {
    let (a, b) = (centre - width / 2.0, centre + width / 2.0);
    out.clear();
    out.extend((0..count).map(|i| {
        let i = (first + i as i64) as f64;
        (((i + 0.5).min(b) - (i - 0.5).max(a)).max(0.0) / width) as f32
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surround_maps_outside_indices() {
        let at = |s: Surround, i| s.index(i, 3);
        assert_eq!([-1, 0, 2, 3, 9].map(|i| at(Surround::Edge, i)), [0, 0, 2, 2, 2].map(Some));
        assert_eq!([-1, 3].map(|i| at(Surround::Black, i)), [None, None]);
        assert_eq!([-1, -3, -4, 3, 5, 6].map(|i| at(Surround::Mirror, i)), [0, 2, 2, 2, 0, 0].map(Some));
    }

    #[test]
    fn integer_coordinates_are_exact() {
        assert_eq!(cubic(0.0), [0.0, 1.0, 0.0, 0.0]);
        assert_eq!(cubic(1.0), [0.0, 0.0, 1.0, 0.0]);
        assert_eq!(Coordinate::new(5.0 + 1e-12), Coordinate { cell: 5, fraction: 0.0 });
        assert_eq!(Coordinate::new(5.0 - 1e-12), Coordinate { cell: 4, fraction: 1.0 });
    }

    #[test]
    fn box_weights_sum_to_one() {
        for (centre, width) in [(3.2, 2.5), (0.0, 1.0), (-7.49, 1.0), (100.5, 17.3)] {
            let (first, count) = box_span(centre, width);
            let mut w = Vec::new();
            box_weights(centre, width, first, &mut w, count);
            assert!((w.iter().sum::<f32>() - 1.0).abs() < 1e-6, "{centre} {width}: {w:?}");
        }
    }
}
