//! Random numbers that belong to pixels: each is a function of (column, row, frame, stream) and a 64-bit key, so any window, order of
//! computing, number of threads and machine has the same ones.
//!
//! Philox4x32-10: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC11 (2011), table 2.
//! Four words of 32 bits make two uniform numbers u = (k + ½)·2⁻⁵², k the first 52 of 64 bits: exact, symmetric about ½, never 0 or 1.

use super::LANES;

const MULTIPLIERS: [u32; 2] = [0xd251_1f53, 0xcd9e_8d57];
const KEY_STEPS: [u32; 2] = [0x9e37_79b9, 0xbb67_ae85];
const ROUNDS: usize = 10;

/// Numbers of one purpose. Those of a frame have the key `seed`, those of a die the key `die` and frame 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Stream {
    /// Frame: photon and dark shot noise; read noise.
    ShotRead = 0,
    /// Frame: reset noise; noise of the converter.
    ResetAdc = 1,
    /// Frame: row noise, at column 0.
    Row = 2,
    /// Frame: state of telegraph noise.
    Telegraph = 3,
    /// Frame: read noise; noise of the converter, both of the low conversion gain.
    LowGain = 4,
    /// Die: PRNU; DSNU.
    PrnuDsnu = 16,
    /// Die: dark current.
    Dcnu = 17,
    /// Die: offset and gain of a column, at row 0.
    Column = 18,
    /// Die: hot pixels; telegraph noise.
    Defects = 19,
    /// What a sample of a data set is made of.
    Sample = 32,
}

/// Four words of a counter and a key.
#[inline(always)]
pub fn philox4x32(counter: [u32; 4], key: [u32; 2], rounds: usize) -> [u32; 4] {
    let ([mut c0, mut c1, mut c2, mut c3], [mut k0, mut k1]) = (counter, key);
    for _ in 0..rounds {
        let a = u64::from(c0) * u64::from(MULTIPLIERS[0]);
        let b = u64::from(c2) * u64::from(MULTIPLIERS[1]);
        (c0, c1, c2, c3) = ((b >> 32) as u32 ^ c1 ^ k0, b as u32, (a >> 32) as u32 ^ c3 ^ k1, a as u32);
        (k0, k1) = (k0.wrapping_add(KEY_STEPS[0]), k1.wrapping_add(KEY_STEPS[1]));
    }
    [c0, c1, c2, c3]
}

/// (k + ½)·2⁻⁵², k the first 52 bits of two words.
#[inline(always)]
fn uniform(high: u32, low: u32) -> f64 {
    let k = u64::from(high) << 20 | u64::from(low >> 12);
    // k as the fraction of a number in [2⁵², 2⁵³): exact, and vectorizable everywhere.
    let k = f64::from_bits(0x4330_0000_0000_0000 | k) - 4_503_599_627_370_496.0;
    (k + 0.5) * (1.0 / 4_503_599_627_370_496.0)
}

/// A uniform number of a counter and a key, of no pixel.
pub fn uniform_of(counter: [u32; 4], key: u64) -> f64 {
    let word = word_of(counter, key);
    uniform((word >> 32) as u32, word as u32)
}

/// 64 random bits of a counter and a key.
pub fn word_of(counter: [u32; 4], key: u64) -> u64 {
    let [high, low, ..] = philox4x32(counter, [key as u32, (key >> 32) as u32], ROUNDS);
    u64::from(high) << 32 | u64::from(low)
}

/// The two uniform numbers of the pixels (`row`, `column`), (`row`, `column` + 1), …
#[inline(always)]
pub fn uniforms(stream: Stream, row: u32, column: u32, frame: u32, key: u64) -> [[f64; LANES]; 2] {
    let key = [key as u32, (key >> 32) as u32];
    let mut out = [[0.0; LANES]; 2];
    let [first, second] = &mut out;
    for (i, (u, v)) in std::iter::zip(first, second).enumerate() {
        let counter = [column.wrapping_add(i as u32), row, frame, stream as u32];
        let [a, b, c, d] = philox4x32(counter, key, ROUNDS);
        (*u, *v) = (uniform(a, b), uniform(c, d));
    }
    out
}

/// The two uniform numbers of one pixel.
pub fn uniform_pair(stream: Stream, row: u32, column: u32, frame: u32, key: u64) -> [f64; 2] {
    let key = [key as u32, (key >> 32) as u32];
    let [a, b, c, d] = philox4x32([column, row, frame, stream as u32], key, ROUNDS);
    [uniform(a, b), uniform(c, d)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Random123, tests/kat_vectors: counter and key, then the result.
    #[test]
    fn philox_gives_the_authors_known_answers() {
        let pi = [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344, 0xa409_3822, 0x299f_31d0];
        for (rounds, words, answer) in [
            (7, [0; 6], [0x5f6f_b709, 0x0d89_3f64, 0x4f12_1f81, 0x4f73_0a48]),
            (7, [u32::MAX; 6], [0x5207_ddc2, 0x4516_5e59, 0x4d8e_e751, 0x8c52_f662]),
            (7, pi, [0x4dfc_caba, 0x190a_87f0, 0xc473_62ba, 0xb6b5_242a]),
            (10, [0; 6], [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]),
            (10, [u32::MAX; 6], [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]),
            (10, pi, [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]),
        ] {
            let [a, b, c, d, e, f] = words;
            assert_eq!(philox4x32([a, b, c, d], [e, f], rounds), answer);
        }
    }

    #[test]
    fn uniforms_are_exact_symmetric_and_inside_the_unit_interval() {
        assert_eq!(uniform(0, 0), 2f64.powi(-53));
        assert_eq!(uniform(u32::MAX, u32::MAX), 1.0 - 2f64.powi(-53));
        assert_eq!(uniform(1 << 31, 0), 0.5 + 2f64.powi(-53));
    }

    #[test]
    fn numbers_belong_to_pixels_and_streams_are_independent() {
        let a = uniforms(Stream::ShotRead, 7, 100, 0, 1);
        let b = uniforms(Stream::ShotRead, 7, 103, 0, 1);
        assert_eq!(a[0][3..], b[0][..LANES - 3]);
        assert_eq!(uniform_pair(Stream::ShotRead, 7, 103, 0, 1), [b[0][0], b[1][0]]);
        let others = [
            (Stream::ResetAdc, 7, 100, 0, 1),
            (Stream::ShotRead, 8, 100, 0, 1),
            (Stream::ShotRead, 7, 100, 1, 1),
            (Stream::ShotRead, 7, 100, 0, 2),
            (Stream::ShotRead, 7, 100, 0, 1 << 32),
        ];
        for (stream, row, column, frame, key) in others {
            assert_ne!(uniforms(stream, row, column, frame, key)[0], a[0]);
        }
    }

    /// Correlation within five standard errors of 0, mean and variance within five of ½ and 1/12.
    #[test]
    fn two_million_numbers_are_uniform_and_uncorrelated() {
        let (mut n, mut sum, mut squares, mut product) = (0.0, 0.0, 0.0, 0.0);
        for row in 0..1000 {
            for column in (0..1000).step_by(LANES) {
                let [u, v] = uniforms(Stream::PrnuDsnu, row, column, 0, 9);
                for (u, v) in std::iter::zip(u, v) {
                    n += 1.0;
                    sum += u;
                    squares += (u - 0.5) * (u - 0.5);
                    product += (u - 0.5) * (v - 0.5);
                }
            }
        }
        let variance: f64 = 1.0 / 12.0;
        assert!((sum / n - 0.5).abs() < 5.0 * (variance / n).sqrt());
        assert!((squares / n - variance).abs() < 5.0 * (1.0f64 / 180.0 / n).sqrt());
        assert!((product / n).abs() < 5.0 * variance / n.sqrt());
    }
}
