//! `--device`, `--engine` and `lenscube device`.

use crate::args::engine::Engine;
use clap::{Args, Subcommand};
use std::fmt;
use std::str::FromStr;

/// `lenscube device`
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  lenscube device list\n  lenscube device check --device cuda:0")]
pub struct DeviceArgs {
    /// What to do
    #[command(subcommand)]
    pub command: DeviceCommand,
}

/// Commands of `lenscube device`.
#[derive(Debug, Subcommand)]
pub enum DeviceCommand {
    /// List the CPU's instruction sets and the GPUs
    #[command(after_help = "Example:\n  lenscube device list")]
    List,
    /// Compare films of the GPUs with the CPU's: seconds; exit code 4 if they differ by more than 2e-6 of the peak
    #[command(after_help = "Example:\n  lenscube device check && lenscube run chart.zarr film.zarr")]
    Check {
        /// GPUs: auto or cuda (all), cuda:0,2
        #[arg(long, value_name = "DEVICE", default_value_t = Device::Auto)]
        device: Device,
    },
}

/// `--device`: what computes the tiles.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Device {
    /// Usable GPUs, else the CPU.
    Auto,
    /// The CPU.
    Cpu,
    /// GPUs by index, one queue per entry; all GPUs if empty.
    Cuda(Vec<usize>),
}

/// Maximum number of GPU queues; a longer list is probably a typo.
const MAX_QUEUES: usize = 64;

impl Device {
    /// Whether `engine` runs on this device.
    pub fn allows(&self, engine: Engine) -> bool {
        match (engine, self) {
            (_, Self::Auto) | (Engine::Cpu(_), Self::Cpu) | (Engine::Cuda(_), Self::Cuda(_)) => true,
            (Engine::Cpu(_), Self::Cuda(_)) | (Engine::Cuda(_), Self::Cpu) => false,
        }
    }
}

impl FromStr for Device {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (kind, list) = text.split_once(':').map_or((text, None), |(kind, list)| (kind, Some(list)));
        match (kind, list) {
            ("auto", None) => Ok(Self::Auto),
            ("cpu", None) => Ok(Self::Cpu),
            ("cuda", None) => Ok(Self::Cuda(Vec::new())),
            ("cuda", Some(list)) => {
                let index =
                    |t: &str| t.trim().parse().map_err(|_| format!("`{t}` is not the index of a GPU"));
                let all = list.split(',').map(index).collect::<Result<Vec<usize>, String>>()?;
                match all.len() {
                    n if n <= MAX_QUEUES => Ok(Self::Cuda(all)),
                    n => Err(format!("{n} queues, expected at most {MAX_QUEUES}")),
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
    /// The film's engine, else the fastest.
    Auto,
    /// This engine.
    Explicit(Engine),
}

impl EngineArg {
    /// The engine given by name; `None` for `auto`.
    pub fn explicit(self) -> Option<Engine> {
        match self {
            Self::Auto => None,
            Self::Explicit(engine) => Some(engine),
        }
    }
}

impl FromStr for EngineArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" { Ok(Self::Auto) } else { text.parse().map(Self::Explicit) }
    }
}

impl fmt::Display for EngineArg {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Explicit(engine) => engine.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::simd::Isa;

    #[test]
    fn device_text_survives_parsing_and_printing() {
        for text in ["auto", "cpu", "cuda", "cuda:0", "cuda:0,2", "cuda:0,0"] {
            assert_eq!(text.parse::<Device>().unwrap().to_string(), text);
        }
        for text in ["", "gpu", "cuda:", "cuda:a", "cuda:-1", "cpu:0", "cuda:0,,1", "CUDA"] {
            assert!(text.parse::<Device>().is_err(), "{text}");
        }
    }

    #[test]
    fn device_allows_the_engines_of_its_kind() {
        let (cpu, gpu) = (Engine::Cpu(Isa::Portable), Engine::Cuda((8, 0)));
        for (device, of_cpu, of_gpu) in
            [(Device::Auto, true, true), (Device::Cpu, true, false), (Device::Cuda(vec![0]), false, true)]
        {
            assert_eq!((device.allows(cpu), device.allows(gpu)), (of_cpu, of_gpu), "{device}");
        }
    }
}
