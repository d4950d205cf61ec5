//! Sample types of stored arrays and flat files, and their conversion to f32 and f64.

use zarrs::array::{DataType, data_type};

/// Sample type of a chart in its store.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sample {
    /// Unsigned 8-bit integer.
    U8,
    /// Unsigned 16-bit integer.
    U16,
    /// IEEE binary16.
    F16,
    /// IEEE binary32.
    F32,
    /// IEEE binary64.
    F64,
}

/// Sample type of a flat file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RasterSample {
    /// Signed 16-bit integer.
    I16,
    /// Signed 32-bit integer.
    I32,
    /// Unsigned 32-bit integer.
    U32,
    /// A sample type that stores have as well.
    Plain(Sample),
}

impl Sample {
    /// The sample type of a Zarr data type; `None` if it is not supported.
    pub(crate) fn from_zarr(t: &DataType) -> Option<Self> {
        let supported = [
            (data_type::uint8(), Self::U8),
            (data_type::uint16(), Self::U16),
            (data_type::float16(), Self::F16),
            (data_type::float32(), Self::F32),
            (data_type::float64(), Self::F64),
        ];
        supported.into_iter().find(|(d, _)| d == t).map(|(_, s)| s)
    }

    /// Bytes of one sample.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::F16 => 2,
            Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Sample `k` of `bytes` (native byte order).
    pub(crate) fn read(self, bytes: &[u8], k: usize) -> f64 {
        match self {
            Self::U8 => f64::from(bytes[k]),
            Self::U16 => f64::from(u16::from_ne_bytes(bytes.as_chunks().0[k])),
            Self::F16 => half::f16::from_ne_bytes(bytes.as_chunks().0[k]).to_f64(),
            Self::F32 => f64::from(f32::from_ne_bytes(bytes.as_chunks().0[k])),
            Self::F64 => f64::from_ne_bytes(bytes.as_chunks().0[k]),
        }
    }

    /// Appends the samples in `bytes` (native byte order) as f32.
    pub(crate) fn append(self, out: &mut Vec<f32>, bytes: &[u8]) {
        match self {
            Self::U8 => out.extend(bytes.iter().map(|&b| f32::from(b))),
            Self::U16 => out.extend(bytes.as_chunks().0.iter().map(|&b| f32::from(u16::from_ne_bytes(b)))),
            Self::F16 => {
                out.extend(bytes.as_chunks().0.iter().map(|&b| half::f16::from_ne_bytes(b).to_f32()));
            }
            Self::F32 => out.extend(bytes.as_chunks().0.iter().map(|&b| f32::from_ne_bytes(b))),
            Self::F64 => out.extend(bytes.as_chunks().0.iter().map(|&b| f64::from_ne_bytes(b) as f32)),
        }
    }

    /// Appends `convert(sample)` of the samples in `bytes` (native byte order).
    pub(crate) fn append_converted(self, out: &mut Vec<f32>, bytes: &[u8], convert: impl Fn(f64) -> f32) {
        match self {
            Self::U8 => out.extend(bytes.iter().map(|&b| convert(f64::from(b)))),
            Self::U16 => {
                out.extend(bytes.as_chunks().0.iter().map(|&b| convert(f64::from(u16::from_ne_bytes(b)))));
            }
            Self::F16 => {
                let samples = bytes.as_chunks().0.iter().map(|&b| half::f16::from_ne_bytes(b).to_f64());
                out.extend(samples.map(convert));
            }
            Self::F32 => {
                out.extend(bytes.as_chunks().0.iter().map(|&b| convert(f64::from(f32::from_ne_bytes(b)))));
            }
            Self::F64 => out.extend(bytes.as_chunks().0.iter().map(|&b| convert(f64::from_ne_bytes(b)))),
        }
    }

    /// `value` rounded to this type if it is a float type; unchanged for integer types, whose samples it may never equal.
    pub(crate) fn nearest(self, value: f64) -> f64 {
        match self {
            Self::U8 | Self::U16 | Self::F64 => value,
            Self::F16 => half::f16::from_f64(value).to_f64(),
            Self::F32 => f64::from(value as f32),
        }
    }
}

impl RasterSample {
    /// Bytes of one sample.
    pub const fn bytes(self) -> usize {
        match self {
            Self::I16 => 2,
            Self::I32 | Self::U32 => 4,
            Self::Plain(sample) => sample.bytes(),
        }
    }

    /// Whether samples are integers.
    pub const fn is_integer(self) -> bool {
        matches!(self, Self::I16 | Self::I32 | Self::U32 | Self::Plain(Sample::U8 | Sample::U16))
    }

    /// As `--chart-dtype` names it. Part of a chart's identity, which films store: do not change.
    pub(crate) const fn code(self) -> &'static str {
        match self {
            Self::I16 => "i16",
            Self::I32 => "i32",
            Self::U32 => "u32",
            Self::Plain(Sample::U8) => "u8",
            Self::Plain(Sample::U16) => "u16",
            Self::Plain(Sample::F16) => "f16",
            Self::Plain(Sample::F32) => "f32",
            Self::Plain(Sample::F64) => "f64",
        }
    }

    /// Short name, as in `--chart-dtype`'s terms: bits and kind.
    pub const fn name(self) -> &'static str {
        match self {
            Self::I16 => "16-bit signed integers",
            Self::I32 => "32-bit signed integers",
            Self::U32 => "32-bit unsigned integers",
            Self::Plain(Sample::U8) => "8-bit unsigned integers",
            Self::Plain(Sample::U16) => "16-bit unsigned integers",
            Self::Plain(Sample::F16) => "16-bit floats",
            Self::Plain(Sample::F32) => "32-bit floats",
            Self::Plain(Sample::F64) => "64-bit floats",
        }
    }

    /// Copies every `step`-th sample of `from` to `out`.
    pub(crate) fn gather(self, from: &[u8], step: usize, out: &mut [u8]) {
        match (step, self.bytes()) {
            (1, _) => out.copy_from_slice(&from[..out.len()]),
            (_, 1) => gather::<1>(from, step, out),
            (_, 2) => gather::<2>(from, step, out),
            (_, 4) => gather::<4>(from, step, out),
            _ => gather::<8>(from, step, out),
        }
    }

    /// As [`Sample::read`].
    pub(crate) fn read(self, bytes: &[u8], k: usize) -> f64 {
        match self {
            Self::I16 => f64::from(i16::from_ne_bytes(bytes.as_chunks().0[k])),
            Self::I32 => f64::from(i32::from_ne_bytes(bytes.as_chunks().0[k])),
            Self::U32 => f64::from(u32::from_ne_bytes(bytes.as_chunks().0[k])),
            Self::Plain(sample) => sample.read(bytes, k),
        }
    }

    /// The sample nearest to `value` in native byte order: integers saturate.
    pub(crate) fn to_ne_bytes(self, value: f64) -> Vec<u8> {
        match self {
            Self::I16 => (value as i16).to_ne_bytes().to_vec(),
            Self::I32 => (value as i32).to_ne_bytes().to_vec(),
            Self::U32 => (value as u32).to_ne_bytes().to_vec(),
            Self::Plain(Sample::U8) => vec![value as u8],
            Self::Plain(Sample::U16) => (value as u16).to_ne_bytes().to_vec(),
            Self::Plain(Sample::F16) => half::f16::from_f64(value).to_ne_bytes().to_vec(),
            Self::Plain(Sample::F32) => (value as f32).to_ne_bytes().to_vec(),
            Self::Plain(Sample::F64) => value.to_ne_bytes().to_vec(),
        }
    }

    /// As [`Sample::append`].
    pub(crate) fn append(self, out: &mut Vec<f32>, bytes: &[u8]) {
        match self {
            Self::I16 => out.extend(bytes.as_chunks().0.iter().map(|&b| f32::from(i16::from_ne_bytes(b)))),
            // Above 2²⁴ rounded to f32.
            Self::I32 => out.extend(bytes.as_chunks().0.iter().map(|&b| i32::from_ne_bytes(b) as f32)),
            Self::U32 => out.extend(bytes.as_chunks().0.iter().map(|&b| u32::from_ne_bytes(b) as f32)),
            Self::Plain(sample) => sample.append(out, bytes),
        }
    }

    /// As [`Sample::append_converted`].
    pub(crate) fn append_converted(self, out: &mut Vec<f32>, bytes: &[u8], convert: impl Fn(f64) -> f32) {
        match self {
            Self::I16 => {
                out.extend(bytes.as_chunks().0.iter().map(|&b| convert(f64::from(i16::from_ne_bytes(b)))));
            }
            Self::I32 => {
                out.extend(bytes.as_chunks().0.iter().map(|&b| convert(f64::from(i32::from_ne_bytes(b)))));
            }
            Self::U32 => {
                out.extend(bytes.as_chunks().0.iter().map(|&b| convert(f64::from(u32::from_ne_bytes(b)))));
            }
            Self::Plain(sample) => sample.append_converted(out, bytes, convert),
        }
    }

    /// As [`Sample::nearest`].
    pub(crate) fn nearest(self, value: f64) -> f64 {
        match self {
            Self::I16 | Self::I32 | Self::U32 => value,
            Self::Plain(sample) => sample.nearest(value),
        }
    }
}

/// Copies every `step`-th sample of `N` bytes.
fn gather<const N: usize>(from: &[u8], step: usize, out: &mut [u8]) {
    let from = from.as_chunks::<N>().0;
    for (n, to) in out.as_chunks_mut::<N>().0.iter_mut().enumerate() {
        *to = from[n * step];
    }
}
