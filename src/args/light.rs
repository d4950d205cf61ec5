//! `lenscube lens light`.

use super::design::{DESIGN_FILES, DesignArgs};
use clap::Args;

/// `lenscube lens light`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  lenscube lens light double-gauss-28 --coatings mgf2 --wavelengths 400:700:50"
)]
pub struct LightArgs {
    /// Design file, or name of a built-in design
    #[arg(value_name = "DESIGN", help = format!("Design file ({DESIGN_FILES}), or name of a built-in design (`lens list`)"))]
    pub design: String,
    /// Wavelengths in nm: 400:700:50 (both ends included) or 450,550 [default: those of the design]
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Parameters of the design.
    #[command(flatten)]
    pub parameters: DesignArgs,
}
