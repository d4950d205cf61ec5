//! A lens as built: which one is drawn from manufacturing errors.

use clap::Args;
use std::fmt;
use std::ops::Range;
use std::path::PathBuf;

/// Most lenses of one command.
const MAX_LENSES: u64 = 100_000;

/// A design with manufacturing errors.
#[derive(Clone, Debug, PartialEq, Args)]
#[command(next_help_heading = "Lens as built")]
pub struct BuiltArgs {
    /// Manufacturing errors of the design: the lens is one drawn from them and focused again, without rotational symmetry (`lenscube help tolerances`)
    #[arg(long, value_name = "FILE.toml")]
    pub tolerances: Option<PathBuf>,
    /// Seed of the draws; a lens depends on seed, sample and tolerances alone
    #[arg(long, value_name = "N", default_value_t = 1, requires = "tolerances")]
    pub seed: u64,
    /// The lens of the seed: K, or FIRST:END (END not included) of `run`, for a film of each, whose path has {sample}
    #[arg(long, value_name = "K", value_parser = LensSamples::parse, default_value_t = LensSamples::default(), requires = "tolerances")]
    pub lens_sample: LensSamples,
}

impl BuiltArgs {
    /// The lens `name` of these arguments in messages, in quotation marks.
    pub fn named(&self, name: &str) -> String {
        match self.tolerances {
            Some(_) => format!("`{name}` with --tolerances"),
            None => format!("`{name}`"),
        }
    }
}

impl Default for BuiltArgs {
    fn default() -> Self {
        Self { tolerances: None, seed: 1, lens_sample: LensSamples::default() }
    }
}

/// `--lens-sample`: indices of lenses, `first` to before `end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LensSamples {
    /// The first.
    pub first: u64,
    /// After the last.
    pub end: u64,
}

impl Default for LensSamples {
    fn default() -> Self {
        Self::one(0)
    }
}

impl LensSamples {
    /// The lens `sample`.
    pub fn one(sample: u64) -> Self {
        Self { first: sample, end: sample + 1 }
    }

    /// Its only lens.
    pub fn only(self) -> Option<u64> {
        (self.end - self.first == 1).then_some(self.first)
    }

    /// The lenses.
    pub fn range(self) -> Range<u64> {
        self.first..self.end
    }

    /// Parses K or FIRST:END.
    fn parse(text: &str) -> Result<Self, String> {
        let expected =
            || format!("expected K or FIRST:END (END not included) with at most {MAX_LENSES} lenses");
        let index = |text: &str| text.parse::<u64>().ok().filter(|k| *k < u64::MAX).ok_or_else(expected);
        let (first, end) = match text.split_once(':') {
            None => return Ok(Self::one(index(text)?)),
            Some((first, end)) => (index(first)?, index(end)?),
        };
        let fits = end > first && end - first <= MAX_LENSES;
        fits.then_some(Self { first, end }).ok_or_else(expected)
    }
}

impl fmt::Display for LensSamples {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.only() {
            Some(sample) => write!(f, "{sample}"),
            None => write!(f, "{}:{}", self.first, self.end),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_one_lens_or_a_range() {
        assert_eq!(LensSamples::parse("7"), Ok(LensSamples::one(7)));
        assert_eq!(LensSamples::parse("0:20").unwrap().range(), 0..20);
        for text in ["", "-1", "5:5", "7:3", "0:100001", "a", "1:2:3", "18446744073709551615"] {
            assert!(LensSamples::parse(text).is_err(), "{text}");
        }
        assert_eq!(["3", "3:9"].map(|text| LensSamples::parse(text).unwrap().to_string()), ["3", "3:9"]);
    }
}
