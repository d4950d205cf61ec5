//! `--style`: colours of figures.

use clap::ValueEnum;
use formats::picture::style::Style;

/// Colours of figures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum StyleArg {
    /// Black on white
    #[default]
    Light,
    /// Light on dark grey
    Dark,
}

impl From<StyleArg> for Style {
    fn from(style: StyleArg) -> Self {
        match style {
            StyleArg::Light => Self::Light,
            StyleArg::Dark => Self::Dark,
        }
    }
}
