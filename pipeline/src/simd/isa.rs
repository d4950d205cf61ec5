//! Instruction sets and their availability on this processor.

use std::str::FromStr;
use thiserror::Error;

/// A supported instruction set, the fastest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Isa {
    /// Registers of 16 f32, x86-64.
    Avx512,
    /// Registers of 8 f32, fused multiply-add, x86-64.
    Avx2,
    /// No particular instructions, any processor.
    Portable,
}

impl Isa {
    /// All, the fastest first.
    pub const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Portable];

    /// Name on the command line, in films, logs and run records.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Avx512 => "avx512",
            Self::Avx2 => "avx2",
            Self::Portable => "portable",
        }
    }

    /// Whether this processor supports it.
    pub fn is_available(self) -> bool {
        match self {
            Self::Portable => true,
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => std::arch::is_x86_feature_detected!("avx512f"),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => {
                std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
            }
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
        }
    }
}

/// An instruction set that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SimdError {
    /// Unknown name.
    #[error("{value}: not one of avx512, avx2, portable")]
    Unknown {
        /// The requested one.
        value: String,
    },
    /// Not supported by this processor.
    #[error("this processor has no {}; the fastest it has is {}", .requested.name(), .fastest.name())]
    Unavailable {
        /// The requested one.
        requested: Isa,
        /// The fastest supported one.
        fastest: Isa,
    },
}

impl FromStr for Isa {
    type Err = SimdError;

    fn from_str(value: &str) -> Result<Self, SimdError> {
        let found = Self::ALL.into_iter().find(|isa| isa.name() == value);
        found.ok_or_else(|| SimdError::Unknown { value: value.to_owned() })
    }
}

/// An instruction set that this processor supports: no other value can be constructed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Simd(Isa);

impl Simd {
    /// The instruction set of any processor.
    pub const PORTABLE: Self = Self(Isa::Portable);

    /// The fastest supported by this processor.
    pub fn detect() -> Self {
        Isa::ALL.into_iter().find(|isa| isa.is_available()).map_or(Self::PORTABLE, Self)
    }

    /// `isa`, if this processor supports it.
    ///
    /// # Errors
    /// [`SimdError::Unavailable`].
    pub fn require(isa: Isa) -> Result<Self, SimdError> {
        match isa.is_available() {
            true => Ok(Self(isa)),
            false => Err(SimdError::Unavailable { requested: isa, fastest: Self::detect().isa() }),
        }
    }

    /// The instruction set.
    pub const fn isa(self) -> Isa {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unavailable_instruction_sets_are_errors() {
        assert_eq!("avx2".parse(), Ok(Isa::Avx2));
        assert_eq!("sse".parse::<Isa>(), Err(SimdError::Unknown { value: "sse".into() }));
        assert_eq!(Simd::require(Isa::Portable), Ok(Simd::PORTABLE));
        for isa in Isa::ALL {
            assert_eq!(Simd::require(isa).is_ok(), isa.is_available());
        }
        assert!(Simd::detect().isa().is_available());
    }
}
