//! NPY arrays: the header is read and bounded before a sample is looked at.
//!
//! Magic `\x93NUMPY`, version (1, 2 or 3), header length (u16; from version 2 u32), then a Python dict in text with the keys
//! `descr`, `fortran_order`, `shape`; then the samples (NumPy's format description, NEP 1). Taken: f4 and f8 of either byte
//! order, C order, at most 5 axes. The dict is parsed, never evaluated.

use super::LARGEST_FILE;

/// Longest header.
const HEADER: usize = 1 << 16;

/// An array.
#[derive(Clone, Debug, PartialEq)]
pub struct Npy {
    /// Sizes of the axes, slowest first.
    pub shape: Vec<usize>,
    /// Were the samples f4? (f8 else.)
    pub single: bool,
    /// The samples.
    pub values: Vec<f64>,
}

/// Reads an array from the whole bytes of a file.
///
/// # Errors
/// In words: what is wrong with the header, or with the number of bytes.
pub fn parse(bytes: &[u8]) -> Result<Npy, String> {
    let not = "is no NPY file: ";
    if bytes.get(..6) != Some(b"\x93NUMPY") {
        return Err(format!("{not}it does not start with \\x93NUMPY"));
    }
    let cut = || format!("{not}it is cut short");
    let (&version, rest) = bytes.get(6).zip(bytes.get(8..)).ok_or_else(cut)?;
    let (length, rest) = match version {
        1 => rest.split_first_chunk::<2>().map(|(n, rest)| (usize::from(u16::from_le_bytes(*n)), rest)),
        2 | 3 => rest.split_first_chunk::<4>().map(|(n, rest)| (u32::from_le_bytes(*n) as usize, rest)),
        other => return Err(format!("{not}version {other}, expected 1 to 3")),
    }
    .ok_or_else(cut)?;
    if length > HEADER {
        return Err(format!("{not}a header of {length} bytes, expected at most {HEADER}"));
    }
    let header = std::str::from_utf8(rest.get(..length).ok_or_else(cut)?)
        .map_err(|_| format!("{not}its header is no text"))?;
    let (single, little, shape) = dict(header)?;
    let data = &rest[length..];
    let item = if single { 4 } else { 8 };
    let count = shape
        .iter()
        .try_fold(1u64, |n, &d| n.checked_mul(d as u64))
        .filter(|n| *n <= LARGEST_FILE / item as u64);
    let Some(count) = count else {
        return Err(format!("claims a shape of {shape:?}, more than {LARGEST_FILE} bytes"));
    };
    if count * item as u64 != data.len() as u64 {
        return Err(format!(
            "holds {} bytes of samples, expected {} for shape {shape:?}; is the file cut short?",
            data.len(),
            count * item as u64
        ));
    }
    let values = match single {
        true => data.chunks_exact(4).map(|b| f64::from(f32::from_bits(word(b, little) as u32))).collect(),
        false => data.chunks_exact(8).map(|b| f64::from_bits(word(b, little))).collect(),
    };
    Ok(Npy { shape, single, values })
}

fn word(bytes: &[u8], little: bool) -> u64 {
    let fold = |word: u64, byte: &u8| word << 8 | u64::from(*byte);
    if little { bytes.iter().rev().fold(0, fold) } else { bytes.iter().fold(0, fold) }
}

/// `{'descr': '<f4', 'fortran_order': False, 'shape': (31, 22), }` → f4?, little endian?, shape.
fn dict(header: &str) -> Result<(bool, bool, Vec<usize>), String> {
    let after = |key: &str| {
        let at =
            header.find(&format!("'{key}'")).ok_or_else(|| format!("has no `{key}` in its NPY header"))?;
        let rest = header[at + key.len() + 2..].trim_start();
        rest.strip_prefix(':')
            .map(str::trim_start)
            .ok_or_else(|| format!("has a broken `{key}` in its NPY header"))
    };
    let descr = after("descr")?.strip_prefix('\'').and_then(|d| d.split_once('\'')).map_or("", |(d, _)| d);
    let (single, little) = match descr {
        "<f4" => (true, true),
        ">f4" => (true, false),
        "<f8" => (false, true),
        ">f8" => (false, false),
        other => {
            let other: String = other.chars().take(16).collect();
            return Err(format!("has samples of type `{other}`, expected f4 or f8; convert it with astype"));
        }
    };
    if !after("fortran_order")?.starts_with("False") {
        return Err("is in Fortran order; write it with numpy.ascontiguousarray".into());
    }
    let inner = after("shape")?.strip_prefix('(').and_then(|s| s.split_once(')')).map_or("?", |(s, _)| s);
    let words: Vec<&str> = inner.split(',').map(str::trim).filter(|w| !w.is_empty()).take(6).collect();
    let shape: Option<Vec<usize>> = words.iter().map(|w| w.parse().ok()).collect();
    match shape {
        Some(shape) if shape.len() <= 5 => Ok((single, little, shape)),
        _ => Err("has a shape in its NPY header that is no list of up to 5 sizes".into()),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// An NPY file of version 1.
    pub fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn what_numpy_writes() {
        let a = parse(&npy(">f4", "(2,)", &[0x3F, 0x80, 0, 0, 0xC0, 0, 0, 0])).unwrap();
        assert_eq!((a.shape, a.single, a.values), (vec![2], true, vec![1.0, -2.0]));
        let scalar = parse(&npy("<f8", "()", &99.5f64.to_le_bytes())).unwrap();
        assert_eq!((scalar.shape, scalar.values), (vec![], vec![99.5]));
    }

    #[test]
    fn huge_claims_are_refused_before_any_sample() {
        for shape in
            ["(1000000000000000000,)", "(18446744073709551615, 2)", "(4294967296, 4294967296, 2)", "(0, 5)"]
        {
            let error = parse(&npy("<f8", shape, &[0; 8])).unwrap_err();
            assert!(error.contains("claims") || error.contains("expected 0"), "{error}");
        }
        for shape in ["(-1,)", "(1, 2, 3, 4, 5, 6)", "5", "(99999999999999999999,)"] {
            assert!(parse(&npy("<f8", shape, &[0; 8])).unwrap_err().contains("shape"), "{shape}");
        }
        assert!(parse(&npy("<i4", "(1,)", &[0; 4])).unwrap_err().contains("`<i4`"));
        let mut long = b"\x93NUMPY\x02\x00".to_vec();
        long.extend(u32::MAX.to_le_bytes());
        assert!(parse(&long).unwrap_err().contains("header"));
    }
}
