//! `lenscube dataset`.

use super::values::{bytes, threads};
use clap::Args;
use std::path::PathBuf;

/// `lenscube dataset`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube dataset recipe.toml train --dry-run\n  lenscube dataset recipe.toml train\n  \
lenscube dataset recipe.toml train --part 3/20\n\
A recipe:\n  schema = \"lenscube/dataset/1\"\n  samples = 1000\n  [pictures]\n  files = \"photos/*.jpg\"\n  size = [256, 256]\n  [lens]\n  name = \"phone\"\n  \
focus_m = [0.5, 1, 4]\n  [film]\n  pitch_um = 2\n  radius_mm = { from = 0, to = 1.8 }\n  [output]\n  film = \"png\"\n  clean = \"png\"\n\
`lenscube help datasets` has all of its fields. The same command resumes after an interruption, and adds samples where the recipe has more."
)]
pub struct DatasetArgs {
    /// Recipe, a TOML file
    #[arg(value_name = "RECIPE.toml")]
    pub recipe: PathBuf,
    /// Folder of the data set
    #[arg(value_name = "OUT")]
    pub out: PathBuf,
    /// Number of samples, in place of the recipe's
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub samples: Option<u64>,
    /// Make only part K of N parts, in one of N processes, in any order and on any machine
    #[arg(long, value_name = "K/N", value_parser = part)]
    pub part: Option<Part>,
    /// Print what would be made, with time and bytes measured on the first sample
    #[arg(long)]
    pub dry_run: bool,
    /// Print the report as JSON
    #[arg(long)]
    pub json: bool,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
    /// Maximum memory, e.g. 1GiB [default: half of what is available, at most 1 GiB]
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub memory: Option<u64>,
    /// Replace a data set of another recipe; one of this recipe is resumed
    #[arg(long)]
    pub overwrite: bool,
}

/// Part `index`, from 0, of `count`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// Its index, from 0.
    pub index: u64,
    /// Number of parts.
    pub count: u64,
}

fn part(text: &str) -> Result<Part, String> {
    let numbers = text.split_once('/').and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
    match numbers {
        Some((k, count)) if (1..=count).contains(&k) => Ok(Part { index: k - 1, count }),
        _ => Err("expected K/N with K from 1 to N, e.g. 3/20".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_count_from_one() {
        assert_eq!(part("3/20"), Ok(Part { index: 2, count: 20 }));
        for text in ["0/2", "3/2", "1", "a/b", "-1/2", "1/0", ""] {
            assert!(part(text).is_err(), "{text}");
        }
    }
}
