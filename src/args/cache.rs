//! `lenscube cache`.

use super::values::bytes;
use clap::{Args, ValueEnum};

/// `lenscube cache`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube cache\n  lenscube cache trim --limit 500MB\n  lenscube cache clear\n\
The cache holds the traced bands of designs, their depth nodes, and the reduced charts of films with scatter, glare or ghosts, in XDG_CACHE_HOME or \
~/.cache. A run that uses it trims it to 2 GB; what was used in the last hour stays. Removed bands are traced again, about half a second each, and removed \
charts read again."
)]
pub struct CacheArgs {
    /// What to do
    #[arg(value_enum, value_name = "ACTION", default_value = "show")]
    pub action: CacheAction,
    /// Bytes that `trim` leaves, e.g. 500MB
    #[arg(long, value_name = "BYTES", value_parser = bytes, default_value = "2GB")]
    pub limit: u64,
}

/// The action.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum CacheAction {
    /// Print directory, number of entries and bytes
    Show,
    /// Remove the least recently used entries beyond the limit
    Trim,
    /// Remove all entries
    Clear,
}
