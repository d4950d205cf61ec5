//! Components of an accessor (glTF 2.0, 3.6.2.2) and their conversion to f32 (3.6.2.2, KHR_mesh_quantization), little-endian.
//!
//! Normalised: unsigned v/(2ⁿ − 1); signed max(v/(2ⁿ⁻¹ − 1), −1). Otherwise integers are converted as they are, exactly.

/// Type of a component.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    /// Of the number in the file.
    pub(super) fn from_number(number: u64) -> Option<Self> {
        Some(match number {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    /// Bytes.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// Name for messages.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::I8 => "BYTE",
            Self::U8 => "UNSIGNED_BYTE",
            Self::I16 => "SHORT",
            Self::U16 => "UNSIGNED_SHORT",
            Self::U32 => "UNSIGNED_INT",
            Self::F32 => "FLOAT",
        }
    }
}

/// Components per element of a type; 0 for an unknown one.
pub(super) fn components(kind: &str) -> usize {
    match kind {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" | "MAT2" => 4,
        "MAT3" => 9,
        "MAT4" => 16,
        _ => 0,
    }
}

/// Unsigned integer at the start of `bytes`, which has at least the size of `component`.
pub(super) fn unsigned(component: Component, bytes: &[u8]) -> u32 {
    let byte = |k: usize| u32::from(bytes[k]);
    match component.bytes() {
        1 => byte(0),
        2 => byte(0) | byte(1) << 8,
        _ => byte(0) | byte(1) << 8 | byte(2) << 16 | byte(3) << 24,
    }
}

/// Converts `elements`, each the bytes of at least N components, to f32.
pub(super) fn to_f32<'a, const N: usize>(
    component: Component,
    is_normalised: bool,
    elements: impl Iterator<Item = &'a [u8]>,
    out: &mut impl Extend<[f32; N]>,
) {
    match (component, is_normalised) {
        (Component::F32, _) => convert(elements, out, f32::from_le_bytes),
        (Component::U8, false) => convert(elements, out, |[b]| f32::from(b)),
        (Component::U8, true) => convert(elements, out, |[b]| f32::from(b) / 255.0),
        (Component::I8, false) => convert(elements, out, |b| f32::from(i8::from_le_bytes(b))),
        (Component::I8, true) => {
            convert(elements, out, |b| (f32::from(i8::from_le_bytes(b)) / 127.0).max(-1.0))
        }
        (Component::U16, false) => convert(elements, out, |b| f32::from(u16::from_le_bytes(b))),
        (Component::U16, true) => convert(elements, out, |b| f32::from(u16::from_le_bytes(b)) / 65535.0),
        (Component::I16, false) => convert(elements, out, |b| f32::from(i16::from_le_bytes(b))),
        (Component::I16, true) => {
            convert(elements, out, |b| (f32::from(i16::from_le_bytes(b)) / 32767.0).max(-1.0))
        }
        // Of indices alone, which are not converted.
        (Component::U32, _) => convert(elements, out, |b| f64::from(u32::from_le_bytes(b)) as f32),
    }
}

fn convert<'a, const N: usize, const S: usize>(
    elements: impl Iterator<Item = &'a [u8]>,
    out: &mut impl Extend<[f32; N]>,
    one: impl Fn([u8; S]) -> f32,
) {
    out.extend(elements.map(|element| {
        let components = element.as_chunks::<S>().0;
        std::array::from_fn(|k| one(components[k]))
    }));
}
