//! `--device` and `--engine`.

use crate::engine::Engine;
use std::fmt;
use std::str::FromStr;

/// What computes the tiles.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Device {
    /// GPUs where there are some that work, else the processor.
    Auto,
    /// The processor.
    Cpu,
    /// These GPUs, a queue for each mention; all of them where none is mentioned.
    Cuda(Vec<usize>),
}

/// More queues than anyone has GPUs are a slip of the finger.
const MAX_QUEUES: usize = 64;

impl FromStr for Device {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (word, list) = text.split_once(':').map_or((text, None), |(word, list)| (word, Some(list)));
        match (word, list) {
            ("auto", None) => Ok(Self::Auto),
            ("cpu", None) => Ok(Self::Cpu),
            ("cuda", None) => Ok(Self::Cuda(Vec::new())),
            ("cuda", Some(list)) => {
                let index =
                    |t: &str| t.trim().parse().map_err(|_| format!("`{t}` is not the index of a GPU"));
                let all = list.split(',').map(index).collect::<Result<Vec<usize>, String>>()?;
                match all.len() {
                    n if n <= MAX_QUEUES => Ok(Self::Cuda(all)),
                    n => Err(format!("{n} queues, at most {MAX_QUEUES}")),
                }
            }
            _ => Err("expected auto, cpu, cuda or cuda:0,2".into()),
        }
    }
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Cpu => f.write_str("cpu"),
            Self::Cuda(all) if all.is_empty() => f.write_str("cuda"),
            Self::Cuda(all) => {
                let all: Vec<String> = all.iter().map(usize::to_string).collect();
                write!(f, "cuda:{}", all.join(","))
            }
        }
    }
}

/// `--engine`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EngineArg {
    /// The film's own, else the fastest.
    Auto,
    /// This one.
    Named(Engine),
}

impl EngineArg {
    /// The engine that is named, if one is.
    pub fn named(self) -> Option<Engine> {
        match self {
            Self::Auto => None,
            Self::Named(engine) => Some(engine),
        }
    }
}

impl FromStr for EngineArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" { Ok(Self::Auto) } else { text.parse().map(Self::Named) }
    }
}

impl fmt::Display for EngineArg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Named(engine) => engine.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_come_back_as_they_were() {
        for text in ["auto", "cpu", "cuda", "cuda:0", "cuda:0,2", "cuda:0,0"] {
            assert_eq!(text.parse::<Device>().unwrap().to_string(), text);
        }
        for text in ["", "gpu", "cuda:", "cuda:a", "cuda:-1", "cpu:0", "cuda:0,,1", "CUDA"] {
            assert!(text.parse::<Device>().is_err(), "{text}");
        }
    }
}
