//! `lenscube demo`.

use super::choices::{STYLE, one_of};
use super::values::threads;
use clap::Args;
use formats::picture::style::Style;
use std::path::PathBuf;

/// `lenscube demo`
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  lenscube demo --dir demo --film-size 2048\n  lenscube demo --depth --dir focus"
)]
pub struct DemoArgs {
    /// Directory for pictures and stores: new, empty, or of an earlier demo
    #[arg(long, default_value = "lenscube-demo")]
    pub dir: PathBuf,
    /// Film side of the overview in pixels; the film is always 28.28 mm wide
    #[arg(long = "film-size", alias = "size", value_name = "PX", default_value_t = 2048, value_parser = clap::value_parser!(u32).range(64..=14141))]
    pub size: u32,
    /// A scene at several distances instead: the focus pulled from near to far
    #[arg(long, conflicts_with_all = ["size", "style"])]
    pub depth: bool,
    /// Colours of the plots
    #[arg(long, value_parser = one_of(STYLE), default_value = "light")]
    pub style: Style,
    /// Worker threads [default: all cores]
    #[arg(long, value_parser = threads)]
    pub threads: Option<usize>,
}
