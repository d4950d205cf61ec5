//! `lenscube demo`.

use super::choices::{STYLE, one_of};
use super::values::threads;
use clap::Args;
use formats::picture::style::Style;
use std::path::PathBuf;

/// `lenscube demo`
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  lenscube demo --dir demo --size 2048")]
pub struct DemoArgs {
    /// Directory for pictures and stores: new, empty, or of an earlier demo
    #[arg(long, default_value = "lenscube-demo")]
    pub dir: PathBuf,
    /// Film side of the overview in pixels; the film is always 28.28 mm wide
    #[arg(long, value_name = "PX", default_value_t = 2048, value_parser = clap::value_parser!(u32).range(64..=14141))]
    pub size: u32,
    /// Colours of the plots
    #[arg(long, value_parser = one_of(STYLE), default_value = "light")]
    pub style: Style,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
}
