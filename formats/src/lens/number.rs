//! Number types a pack's tables may be stored in; all become f64.

/// A number type.
#[derive(Clone, Copy)]
pub(super) enum Number {
    F32,
    F64,
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
}

impl Number {
    /// By its Zarr name; `None` = another type.
    pub(super) fn named(name: &str) -> Option<Self> {
        Some(match name {
            "float32" => Self::F32,
            "float64" => Self::F64,
            "int8" => Self::I8,
            "int16" => Self::I16,
            "int32" => Self::I32,
            "int64" => Self::I64,
            "uint8" => Self::U8,
            "uint16" => Self::U16,
            "uint32" => Self::U32,
            "uint64" => Self::U64,
            _ => return None,
        })
    }

    /// Bytes of one sample.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::F32 | Self::I32 | Self::U32 => 4,
            Self::F64 | Self::I64 | Self::U64 => 8,
        }
    }

    /// One sample from its native bytes; integers beyond 2^53 round.
    pub(super) fn value(self, b: &[u8]) -> f64 {
        match self {
            Self::F32 => f64::from(f32::from_ne_bytes([b[0], b[1], b[2], b[3]])),
            Self::F64 => f64::from_ne_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]),
            Self::I8 => f64::from(b[0] as i8),
            Self::U8 => f64::from(b[0]),
            Self::I16 => f64::from(i16::from_ne_bytes([b[0], b[1]])),
            Self::U16 => f64::from(u16::from_ne_bytes([b[0], b[1]])),
            Self::I32 => f64::from(i32::from_ne_bytes([b[0], b[1], b[2], b[3]])),
            Self::U32 => f64::from(u32::from_ne_bytes([b[0], b[1], b[2], b[3]])),
            Self::I64 => i64::from_ne_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]) as f64,
            Self::U64 => u64::from_ne_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]) as f64,
        }
    }
}
