//! Damage independent of the format: bytes, binary numbers, words and lines of a text.

use super::Random;
use super::extreme::{integer, magnitude, name};

/// Flips bits, sets bytes, truncates, repeats a part, or writes a binary number.
pub fn damage(bytes: &mut Vec<u8>, r: &mut Random) {
    for _ in 0..=r.below(3) {
        let at = r.below(bytes.len());
        match r.below(9) {
            0 => bytes.truncate(at),
            1 if at < bytes.len() => {
                let end = at + r.below(256).min(bytes.len() - at);
                let part = bytes[at..end].to_vec();
                bytes.extend(part);
            }
            2 if at < bytes.len() => bytes[at] = [0, 0xFF, 0x7F, 0x80][r.below(4)],
            3 => write_number(bytes, at, r),
            _ if at < bytes.len() => bytes[at] ^= 1 << r.below(8),
            _ => {}
        }
    }
}

/// Writes a float or an integer of 4 or 8 bytes, in either byte order, at an offset aligned to 1, 2, 4 or 8 bytes.
fn write_number(bytes: &mut [u8], at: usize, r: &mut Random) {
    let mut number: Vec<u8> = match r.below(4) {
        0 => (magnitude(r) as f32).to_le_bytes().into(),
        1 => magnitude(r).to_le_bytes().into(),
        2 => (integer(r) as u32).to_le_bytes().into(),
        _ => integer(r).to_le_bytes().into(),
    };
    if r.below(4) == 0 {
        number.reverse();
    }
    let at = at - at % [1, 2, 4, 8][r.below(4)];
    let n = number.len().min(bytes.len().saturating_sub(at));
    bytes[at..at + n].copy_from_slice(&number[..n]);
}

/// Texts that are difficult for parsers.
const TOKENS: [&str; 40] = [
    "nan",
    "inf",
    "-inf",
    "-nan(ind)",
    "1e999",
    "-1e999",
    "1e-320",
    "-1",
    "0",
    "-0",
    "1",
    "0.5",
    "2147483648",
    "4294967296",
    "1000000000000000000",
    "18446744073709551615",
    "18446744073709551616",
    "1e18",
    "1e300",
    "1e-300",
    "1,5",
    "1.5,2",
    ",",
    ";",
    "=",
    ":",
    "'",
    "[",
    "]",
    "(",
    ")",
    "%",
    "\n",
    "\r\n",
    "\t",
    " ",
    "µ",
    "\0",
    "\u{feff}",
    "#",
];

fn token(r: &mut Random) -> Vec<u8> {
    match r.below(8) {
        0 | 1 => format!("{:e}", magnitude(r)).into_bytes(),
        2 => integer(r).to_string().into_bytes(),
        3 => name(r),
        _ => r.pick(&TOKENS).as_bytes().to_vec(),
    }
}

/// Damages words and lines of a text, and sometimes its bytes.
pub fn damage_text(bytes: &mut Vec<u8>, r: &mut Random) {
    for _ in 0..=r.below(3) {
        match r.below(8) {
            0 => damage(bytes, r),
            1 | 2 => {
                let at = r.below(bytes.len() + 1);
                bytes.splice(at..at, token(r));
            }
            3 => {
                let line = line(bytes, r);
                bytes.drain(line);
            }
            4 => {
                let (from, to) = (line(bytes, r), line(bytes, r).start);
                let copy = bytes[from].to_vec();
                bytes.splice(to..to, copy);
            }
            _ => {
                let at = r.below(bytes.len());
                let blank = |b: &u8| b.is_ascii_whitespace() || b"=,:;&?\"".contains(b);
                let start = bytes[..at.min(bytes.len())].iter().rposition(blank).map_or(0, |i| i + 1);
                let end = bytes[start..].iter().position(blank).map_or(bytes.len(), |i| start + i);
                bytes.splice(start..end, token(r));
            }
        }
    }
}

fn line(bytes: &[u8], r: &mut Random) -> std::ops::Range<usize> {
    let at = r.below(bytes.len());
    let start = bytes[..at].iter().rposition(|b| *b == b'\n').map_or(0, |i| i + 1);
    let end = bytes[start..].iter().position(|b| *b == b'\n').map_or(bytes.len(), |i| start + i + 1);
    start..end
}
