//! A fixed noise pattern, as on photographed or printed charts; it prevents unrealistically good compression.
//!
//! ```text
//! value → value · (1 + σ·g),   g = (u₁ + u₂ + u₃ + u₄ − 2)·√3
//! ```
//! with uᵢ uniform on [0, 1): mean 0, variance 1, close to normal and within ±2√3, so that values stay positive for
//! σ ≤ 0.28 (P. Irwin 1927, P. Hall 1927: the sum of uniform numbers). The numbers are a hash of band, row and column
//! (SplitMix64's finaliser, Steele, Lea and Flood 2014): independent of the requested rectangle.

use crate::geometry::Rect;

/// Largest σ: from 1/(2√3) = 0.289 on, values can be negative.
pub(super) const MAX_SIGMA: f64 = 0.28;

/// Multiplies `out` (row-major, `rect` of band `band`) by noise of relative standard deviation `sigma`.
pub(super) fn add(sigma: f64, band: usize, rect: Rect, out: &mut [f32]) {
    let step = (sigma * 3f64.sqrt() / f64::from(1 << 16)) as f32;
    for (y, line) in (rect.y..).zip(out.chunks_exact_mut(rect.width)) {
        let key = mix(((band as u64) << 32) ^ y as u64);
        for (x, value) in (rect.x..).zip(line) {
            let bits = mix(key ^ x as u64);
            // Four numbers of 16 bits, each at the middle of its interval.
            let sum = (0..4).map(|i| (bits >> (16 * i)) as u16 as i32).sum::<i32>() + 2 - (2 << 16);
            *value *= 1.0 + step * sum as f32;
        }
    }
}

/// SplitMix64's next number after the state `key`.
pub(super) fn mix(key: u64) -> u64 {
    let mut z = key.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_mean_0_variance_1_and_no_correlation() {
        let rect = Rect::new(5, 11, 400, 500);
        let mut out = vec![1.0; rect.size().pixels()];
        add(0.1, 3, rect, &mut out);
        let g: Vec<f64> = out.iter().map(|v| (f64::from(*v) - 1.0) / 0.1).collect();
        let n = g.len() as f64;
        let mean = g.iter().sum::<f64>() / n;
        let variance = g.iter().map(|v| v * v).sum::<f64>() / n;
        let along = |lag: usize| g.iter().zip(&g[lag..]).map(|(a, b)| a * b).sum::<f64>() / n;
        // Five standard errors of 200,000 draws.
        assert!(mean.abs() < 0.011, "mean {mean}");
        assert!((variance - 1.0).abs() < 0.016, "variance {variance}");
        assert!(along(1).abs() < 0.011 && along(500).abs() < 0.011, "{} {}", along(1), along(500));
        assert!(g.iter().all(|v| v.abs() <= 2.0 * 3f64.sqrt()));
    }
}
