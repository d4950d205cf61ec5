//! Engines: the implementations of the arithmetic (avx512, avx2, portable; cuda-sm_NN per GPU compute capability).
//!
//! Engines differ by up to 2e-6 of the film's peak, by the order of their roundings. On a GPU the PSFs are resampled to kernels
//! by the portable engine, so the name of a GPU engine is independent of the host's processor.

use pipeline::cuda::error::Version;
use pipeline::simd::{Isa, Simd};
use std::fmt;
use std::str::FromStr;

/// An implementation of the arithmetic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// The CPU, with this instruction set.
    Cpu(Isa),
    /// NVIDIA GPUs of this compute capability.
    Cuda(Version),
}

impl Engine {
    /// The CPU engine of `simd`.
    pub const fn cpu(simd: Simd) -> Self {
        Self::Cpu(simd.isa())
    }
}

impl fmt::Display for Engine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu(isa) => f.write_str(isa.name()),
            Self::Cuda((major, minor)) => write!(f, "cuda-sm_{major}{minor}"),
        }
    }
}

impl FromStr for Engine {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if let Some(digits) = text.strip_prefix("cuda-sm_") {
            let all = digits.bytes().all(|b| b.is_ascii_digit());
            let number = digits.parse::<i32>().ok().filter(|n| all && (10..=999).contains(n));
            return number.map(|n| Self::Cuda((n / 10, n % 10))).ok_or_else(|| {
                format!("`{text}`: expected a compute capability without its point, as in cuda-sm_90")
            });
        }
        let isa: Result<Isa, _> = text.parse();
        isa.map(Self::Cpu).map_err(|_| {
            "expected auto, avx512, avx2, portable or cuda-sm_90 (a GPU's compute capability)".into()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn engine_names_parse_to_the_same_engine() {
        let gpus = [(8, 0), (9, 0), (12, 1)].map(Engine::Cuda);
        for engine in Isa::ALL.map(Engine::Cpu).into_iter().chain(gpus) {
            assert_eq!(engine.to_string().parse(), Ok(engine));
        }
        assert_eq!(Engine::Cuda((12, 0)).to_string(), "cuda-sm_120");
        for text in ["", "cuda", "cuda-sm_", "cuda-sm_9", "cuda-sm_9.0", "cuda-sm_+90", "AVX2", "sse", "auto"]
        {
            assert!(text.parse::<Engine>().is_err(), "{text}");
        }
    }
}
