//! MAT-files of level 5, as MATLAB `save -v6` and `-v7` write them (MathWorks, *MAT-File Format*, 1999 and later).
//!
//! ```text
//! file      128 bytes: 116 of text, 8 of zeros, version 0x0100, byte order "IM" (little-endian) or "MI"; then elements, one a variable
//! element   type u32, bytes u32, data padded to 8 bytes; or, of up to 4 bytes of data, bytes u16 in the upper half of the type, data, 8 bytes in all
//! array     an element of type 14 that holds elements: flags (u32: class in the lowest byte; u32), dimensions (i32), name (i8), data
//!           numbers: samples, the first dimension fastest; text: u16; struct: length of a name (i32), names (i8), an array each
//! compressed an element of type 15: a zlib stream of one element
//! ```

mod read;
mod write;

pub(crate) use read::{MAX_VALUES, MatArray, MatError, MatFile, Stream};
pub(crate) use write::{MatValue, file};

const HEADER: usize = 128;
const INT8: u32 = 1;
const UINT16: u32 = 4;
const INT32: u32 = 5;
const UINT32: u32 = 6;
const DOUBLE: u32 = 9;
const MATRIX: u32 = 14;
/// Classes of arrays.
const STRUCT_CLASS: u32 = 2;
const CHAR_CLASS: u32 = 4;
const DOUBLE_CLASS: u32 = 6;

#[cfg(test)]
mod tests;
