//! Values at and beyond limits: magnitudes, integers, names and paths, lists of wavelengths.

use super::Random;

/// Limits of f16, f32, f64 and of exact integers, their sums and squares; all beyond physical values.
const MAGNITUDES: [f64; 26] = [
    0.0,
    5e-324,
    1e-300,
    1e-160,
    f64::MIN_POSITIVE,
    1.4e-45,
    1.1754944e-38,
    6e-8,
    1e-7,
    0.5,
    1.0,
    65504.0,
    65520.0,
    16777217.0,
    4294967296.0,
    1099511627776.0,
    9007199254740994.0,
    1e18,
    1e19,
    1e35,
    9.97e36,
    3.4028235e38,
    3.5e38,
    1e160,
    1e300,
    1e308,
];

/// A magnitude of either sign (-0 included), sometimes infinite or NaN.
pub fn magnitude(r: &mut Random) -> f64 {
    let value = match r.below(16) {
        0 => f64::INFINITY,
        1 => f64::NAN,
        _ => MAGNITUDES[r.below(MAGNITUDES.len())],
    };
    if r.below(3) == 0 { -value } else { value }
}

/// A size, offset or count next to a power of two.
pub fn integer(r: &mut Random) -> u64 {
    let power = [0, 1, 3, 7, 8, 15, 16, 20, 24, 28, 31, 32, 33, 40, 48, 53, 60, 63][r.below(18)];
    match r.below(8) {
        0 => u64::MAX - r.below(32) as u64,
        1 => r.below(100) as u64,
        2 => (1 << power) - 1,
        3 => (1 << power) + 1,
        _ => 1 << power,
    }
}

const NAMES: [&str; 30] = [
    "",
    ".",
    "..",
    "../..",
    "../../../../tmp/x",
    "/",
    "//",
    "/etc/passwd",
    "a//b",
    "a/../b",
    "./a",
    "a/",
    "C:\\a",
    "\\\\host\\a",
    "a\0b",
    "a\nb",
    "\r",
    "\t",
    " ",
    "-",
    "--help",
    "%2e%2e",
    "~",
    "$HOME",
    "CON",
    "λ_500",
    "e\u{301}",
    "画像",
    "🌈",
    "\u{202e}gpj.x",
];

/// A name of an array, a file or a channel, not always UTF-8, up to 300 bytes long.
pub fn name(r: &mut Random) -> Vec<u8> {
    match r.below(8) {
        0 => r.pick(&["a", "ü", "🌈", "/", "../"]).repeat(300 / 4).into_bytes(),
        1 => b"a".repeat(300),
        2 => [&b"x"[..], &[0xFF, 0xC3, 0x28, 0xED, 0xA0, 0x80][..1 + r.below(6)]].concat(),
        _ => r.pick(&NAMES).as_bytes().to_vec(),
    }
}

/// As [`name`], always UTF-8.
pub fn text(r: &mut Random) -> String {
    String::from_utf8_lossy(&name(r)).into_owned()
}

/// Wavelengths that repeat, descend, or are out of range.
pub fn wavelengths_nm(count: usize, r: &mut Random) -> Vec<f64> {
    let mut nm: Vec<f64> = (0..count).map(|i| 450.0 + 50.0 * i as f64).collect();
    match r.below(5) {
        0 => nm.reverse(),
        1 => nm.fill(500.0),
        2 => nm.iter_mut().for_each(|v| *v *= 1e-3),
        3 => {
            for v in &mut nm {
                *v = magnitude(r);
            }
        }
        _ if count > 0 => nm[r.below(count)] = magnitude(r),
        _ => {}
    }
    nm
}
