//! Number types of a pack's stored tables; all are converted to f64.

macro_rules! number_types {
    ($($variant:ident: $type:ident = $name:literal),*) => {
        /// A number type.
        #[derive(Clone, Copy)]
        pub(super) enum Number { $($variant),* }

        impl Number {
            /// The type with a Zarr name; `None`: not supported.
            pub(super) fn from_name(name: &str) -> Option<Self> {
                Some(match name {
                    $($name => Self::$variant,)*
                    _ => return None,
                })
            }

            /// Bytes of one sample.
            pub(super) fn bytes(self) -> usize {
                match self { $(Self::$variant => size_of::<$type>()),* }
            }

            /// One sample from its native bytes; integers above 2^53 are rounded.
            pub(super) fn value(self, bytes: &[u8]) -> f64 {
                match self {
                    $(Self::$variant => $type::from_ne_bytes(bytes.try_into().expect("the bytes of one sample")) as f64),*
                }
            }
        }
    };
}

number_types!(
    F32: f32 = "float32", F64: f64 = "float64",
    I8: i8 = "int8", I16: i16 = "int16", I32: i32 = "int32", I64: i64 = "int64",
    U8: u8 = "uint8", U16: u16 = "uint16", U32: u32 = "uint32", U64: u64 = "uint64"
);
