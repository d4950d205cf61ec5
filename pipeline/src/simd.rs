//! Which instructions a run computes with: found out once, or asked for and then insisted on.
//!
//! Films of one choice have the same bits on every machine that has its instructions; two choices differ within 2e-6 of the
//! peak, by the order of their roundings. So nothing else that computes pixels may choose instructions by itself: FFTs are
//! compiled without rustfft's own detection, and functions such as the sine come from the `libm` crate ([`crate::real`]).
//! What is computed in lanes is written once, in the words of `lanes`; `avx512` and `avx2` say what they mean.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "x86_64")]
pub(crate) mod lanes;

#[cfg(target_arch = "x86_64")]
pub(crate) use avx2::Avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) use avx512::Avx512;
use std::str::FromStr;
use thiserror::Error;

/// An instruction set that there is a path for, the fastest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Isa {
    /// 16 f32 a lane register, x86-64.
    Avx512,
    /// 8 f32 a lane register with fused multiply-add, x86-64.
    Avx2,
    /// No particular instructions: the same bits on any machine.
    Portable,
}

impl Isa {
    /// All of them, the fastest first.
    pub const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Portable];

    /// Its name on the command line, in films, logs and run records.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Avx512 => "avx512",
            Self::Avx2 => "avx2",
            Self::Portable => "portable",
        }
    }

    /// Whether this machine has it.
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

/// What a choice of instructions can be refused for.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SimdError {
    /// No such path.
    #[error("{value}: not one of avx512, avx2, portable")]
    Unknown {
        /// What was asked for.
        value: String,
    },
    /// This machine lacks it.
    #[error("this processor has no {}; the fastest it has is {}", .wanted.name(), .fastest.name())]
    Unavailable {
        /// What was asked for.
        wanted: Isa,
        /// What there is instead.
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

/// A choice that this machine can run: nothing else can be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Simd(Isa);

impl Simd {
    /// The path that needs no particular processor.
    pub const PORTABLE: Self = Self(Isa::Portable);

    /// The fastest that this machine has.
    pub fn detect() -> Self {
        Isa::ALL.into_iter().find(|isa| isa.is_available()).map_or(Self::PORTABLE, Self)
    }

    /// `isa`, if this machine has it.
    ///
    /// # Errors
    /// [`SimdError::Unavailable`] where it does not.
    pub fn of(isa: Isa) -> Result<Self, SimdError> {
        match isa.is_available() {
            true => Ok(Self(isa)),
            false => Err(SimdError::Unavailable { wanted: isa, fastest: Self::detect().isa() }),
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
    fn a_choice_is_met_or_refused() {
        assert_eq!("avx2".parse(), Ok(Isa::Avx2));
        assert_eq!("sse".parse::<Isa>(), Err(SimdError::Unknown { value: "sse".into() }));
        assert_eq!(Simd::of(Isa::Portable), Ok(Simd::PORTABLE));
        for isa in Isa::ALL {
            assert_eq!(Simd::of(isa).is_ok(), isa.is_available());
        }
        assert!(Simd::detect().isa().is_available());
    }
}
