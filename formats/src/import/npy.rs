//! NumPy arrays of f4 or f8 in either byte order. The header is parsed as for charts; the number of samples is checked before
//! any is read.

use super::MAX_ARRAY_BYTES;
use super::window::Window;
use crate::chart::{RasterSample, Sample};
use crate::npy::{Header, header};

/// An array.
#[derive(Clone, Debug, PartialEq)]
pub struct Npy {
    /// Sizes of the axes, slowest first.
    pub shape: Vec<usize>,
    /// Whether the samples were f4, else f8.
    pub single: bool,
    /// The samples.
    pub values: Vec<f64>,
}

impl Npy {
    /// Window `index` of consecutive windows of (rows, columns); all samples must be finite.
    pub(super) fn window(&self, index: usize, (rows, columns): (usize, usize)) -> Result<Window, String> {
        let samples = &self.values[index * rows * columns..][..rows * columns];
        match samples.iter().position(|v| !v.is_finite()) {
            Some(i) => Err(format!(
                "window {index} has {} at row {}, column {}",
                samples[i],
                i / columns,
                i % columns
            )),
            None => Ok(Window { rows, columns, samples: samples.to_vec(), centre: None }),
        }
    }
}

/// Reads an array from all bytes of a file.
///
/// # Errors
/// The error of the header, or of the number of bytes.
pub fn parse(bytes: &[u8]) -> Result<Npy, String> {
    let Header { sample, little_endian: little, shape, offset, fortran } =
        header(bytes).map_err(|(what, expected, found)| {
            format!("is no NPY file that can be used: {what}: expected {expected}, found {found}")
        })?;
    if fortran {
        return Err("is in Fortran order, expected C order (numpy.ascontiguousarray)".into());
    }
    let single = match sample {
        RasterSample::Plain(Sample::F32) => true,
        RasterSample::Plain(Sample::F64) => false,
        other => {
            return Err(format!("has {}, expected f4 or f8; convert it with astype", other.name()));
        }
    };
    let data = &bytes[offset..];
    let item = sample.bytes() as u64;
    let count =
        shape.iter().try_fold(1u64, |n, &d| n.checked_mul(d as u64)).filter(|n| *n <= MAX_ARRAY_BYTES / item);
    let Some(count) = count else {
        return Err(format!("declares a shape of {shape:?}, more than {MAX_ARRAY_BYTES} bytes"));
    };
    if count * item != data.len() as u64 {
        return Err(format!(
            "holds {} bytes of samples, expected {} for shape {shape:?}{}",
            data.len(),
            count * item,
            if count * item > data.len() as u64 { "; is the file cut short?" } else { "" }
        ));
    }
    let values = match single {
        true => data.chunks_exact(4).map(|b| f64::from(f32::from_bits(bits(b, little) as u32))).collect(),
        false => data.chunks_exact(8).map(|b| f64::from_bits(bits(b, little))).collect(),
    };
    Ok(Npy { shape, single, values })
}

fn bits(bytes: &[u8], little: bool) -> u64 {
    let fold = |bits: u64, byte: &u8| bits << 8 | u64::from(*byte);
    if little { bytes.iter().rev().fold(0, fold) } else { bytes.iter().fold(0, fold) }
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
    fn big_endian_f4_and_scalar_f8_are_read() {
        let a = parse(&npy(">f4", "(2,)", &[0x3F, 0x80, 0, 0, 0xC0, 0, 0, 0])).unwrap();
        assert_eq!((a.shape, a.single, a.values), (vec![2], true, vec![1.0, -2.0]));
        let scalar = parse(&npy("<f8", "()", &99.5f64.to_le_bytes())).unwrap();
        assert_eq!((scalar.shape, scalar.values), (vec![], vec![99.5]));
    }

    #[test]
    fn invalid_or_too_large_shapes_are_errors() {
        for shape in
            ["(1000000000000000000,)", "(18446744073709551615, 2)", "(4294967296, 4294967296, 2)", "(0, 5)"]
        {
            let error = parse(&npy("<f8", shape, &[0; 8])).unwrap_err();
            assert!(error.contains("declares") || error.contains("expected 0"), "{error}");
        }
        for shape in ["(-1,)", "(1, 2, 3, 4, 5, 6)", "5", "(99999999999999999999,)"] {
            assert!(parse(&npy("<f8", shape, &[0; 8])).unwrap_err().contains("shape"), "{shape}");
        }
        assert!(parse(&npy("<i8", "(1,)", &[0; 8])).unwrap_err().contains("`<i8`"));
        let mut long = b"\x93NUMPY\x02\x00".to_vec();
        long.extend(u32::MAX.to_le_bytes());
        assert!(parse(&long).unwrap_err().contains("header"));
    }
}
