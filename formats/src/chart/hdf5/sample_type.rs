//! Sample types of HDF5.

use hdf5_pure::{Datatype, DatatypeByteOrder, FloatingPointLayout};

use crate::sample::{RasterSample, Sample};

/// Sample types that are read, for messages.
pub(super) const EXPECTED: &str = "u8, u16, i16, f16, f32 or f64; convert others in Python: `import numpy, h5py` and \
     `numpy.save(\"cube.npy\", h5py.File(FILE)[ARRAY][:].astype(\"f4\"))`";

/// The sample type, and whether samples are little-endian; the error describes another type.
pub(super) fn of(t: &Datatype) -> Result<(RasterSample, bool), String> {
    let (sample, order) = match t {
        Datatype::FixedPoint { size, byte_order, layout } => {
            let complete = layout.bit_offset == 0 && u32::from(layout.bit_precision) == size * 8;
            let sample = match (complete, size, layout.signed) {
                (true, 1, false) => RasterSample::Plain(Sample::U8),
                (true, 2, false) => RasterSample::Plain(Sample::U16),
                (true, 2, true) => RasterSample::I16,
                _ => {
                    let kind = if layout.signed { "signed" } else { "unsigned" };
                    return Err(format!("{}-bit {kind} integers", layout.bit_precision));
                }
            };
            (sample, byte_order)
        }
        Datatype::FloatingPoint { size, byte_order, layout } => {
            let sample = match size {
                2 if is_half(layout) => Sample::F16,
                4 if *layout == FloatingPointLayout::IEEE754_BINARY32 => Sample::F32,
                8 if *layout == FloatingPointLayout::IEEE754_BINARY64 => Sample::F64,
                _ => return Err(format!("{size}-byte floats of another format")),
            };
            (RasterSample::Plain(sample), byte_order)
        }
        Datatype::Compound { .. } => return Err("records (complex numbers?)".into()),
        Datatype::String { .. } | Datatype::VariableLength { .. } => return Err("text or lists".into()),
        Datatype::Reference { .. } => return Err("references (a cell array?)".into()),
        _ => return Err("another type".into()),
    };
    match order {
        DatatypeByteOrder::LittleEndian => Ok((sample, true)),
        DatatypeByteOrder::BigEndian => Ok((sample, false)),
        DatatypeByteOrder::Vax => Err("VAX floats".into()),
    }
}

/// The type of an attribute, for messages.
pub(super) fn describe(t: &Datatype) -> String {
    of(t).map_or_else(|other| other, |(sample, _)| sample.name().to_owned())
}

fn is_half(layout: &FloatingPointLayout) -> bool {
    let FloatingPointLayout { bit_offset, bit_precision, exponent_location, exponent_size, .. } = *layout;
    let FloatingPointLayout { mantissa_location, mantissa_size, exponent_bias, .. } = *layout;
    (bit_offset, bit_precision, exponent_location, exponent_size) == (0, 16, 10, 5)
        && (mantissa_location, mantissa_size, exponent_bias) == (0, 10, 15)
}
