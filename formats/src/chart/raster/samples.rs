//! Conversion of the samples of a flat file.

use super::layout::RasterLayout;
use crate::sample::{RasterSample, Sample};

/// Converts samples at intervals of `step` bytes in `bytes` to f32.
pub(super) fn convert(layout: &RasterLayout, bytes: &[u8], step: usize, out: &mut [f32]) {
    let little = layout.little_endian;
    match layout.sample {
        RasterSample::I16 => convert_each(bytes, step, out, |b| {
            f32::from(if little { i16::from_le_bytes(b) } else { i16::from_be_bytes(b) })
        }),
        RasterSample::I32 => convert_each(bytes, step, out, |b| {
            (if little { i32::from_le_bytes(b) } else { i32::from_be_bytes(b) }) as f32
        }),
        RasterSample::U32 => convert_each(bytes, step, out, |b| {
            (if little { u32::from_le_bytes(b) } else { u32::from_be_bytes(b) }) as f32
        }),
        RasterSample::Plain(Sample::U8) => convert_each(bytes, step, out, |[b]| f32::from(b)),
        RasterSample::Plain(Sample::U16) => convert_each(bytes, step, out, |b| {
            f32::from(if little { u16::from_le_bytes(b) } else { u16::from_be_bytes(b) })
        }),
        RasterSample::Plain(Sample::F16) => convert_each(bytes, step, out, |b| {
            if little { half::f16::from_le_bytes(b) } else { half::f16::from_be_bytes(b) }.to_f32()
        }),
        RasterSample::Plain(Sample::F32) => {
            convert_each(
                bytes,
                step,
                out,
                |b| if little { f32::from_le_bytes(b) } else { f32::from_be_bytes(b) },
            )
        }
        RasterSample::Plain(Sample::F64) => convert_each(
            bytes,
            step,
            out,
            |b| if little { f64::from_le_bytes(b) } else { f64::from_be_bytes(b) } as f32,
        ),
    }
}

/// Applies `convert` to samples at intervals of `step` bytes in `bytes`.
pub(super) fn convert_by(
    layout: &RasterLayout,
    bytes: &[u8],
    step: usize,
    out: &mut [f32],
    convert: impl Fn(f64) -> f32,
) {
    out.iter_mut().zip(bytes.chunks(step)).for_each(|(to, b)| *to = convert(read(layout, b)));
}

/// The first sample in `bytes`.
pub(super) fn read(layout: &RasterLayout, bytes: &[u8]) -> f64 {
    let little = layout.little_endian;
    macro_rules! read {
        ($t:ty) => {{
            let bytes = *bytes.first_chunk().expect("a complete sample");
            if little { <$t>::from_le_bytes(bytes) } else { <$t>::from_be_bytes(bytes) }
        }};
    }
    match layout.sample {
        RasterSample::I16 => f64::from(read!(i16)),
        RasterSample::I32 => f64::from(read!(i32)),
        RasterSample::U32 => f64::from(read!(u32)),
        RasterSample::Plain(Sample::U8) => f64::from(bytes[0]),
        RasterSample::Plain(Sample::U16) => f64::from(read!(u16)),
        RasterSample::Plain(Sample::F16) => read!(half::f16).to_f64(),
        RasterSample::Plain(Sample::F32) => f64::from(read!(f32)),
        RasterSample::Plain(Sample::F64) => read!(f64),
    }
}

#[inline(always)]
fn convert_each<const N: usize>(
    bytes: &[u8],
    step: usize,
    out: &mut [f32],
    convert: impl Fn([u8; N]) -> f32,
) {
    if step == N {
        out.iter_mut().zip(bytes.as_chunks::<N>().0).for_each(|(to, b)| *to = convert(*b));
        return;
    }
    for (to, b) in out.iter_mut().zip(bytes.chunks(step)) {
        *to = convert(*b.first_chunk().expect("a complete sample"));
    }
}
