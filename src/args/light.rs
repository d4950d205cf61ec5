//! `lenscube lens light`.

use super::design::{DESIGN_FILES, DesignArgs};
use super::ghosts::{RINGS, ReflectanceArg, reflectance, rings};
use clap::Args;

/// `lenscube lens light`
#[derive(Debug, Args)]
#[command(
    after_help = "Example:\n  lenscube lens light double-gauss-28 --coatings mgf2 --wavelengths 400:700:50\n  lenscube lens light my.zmx --coatings design --sensor-reflectance 5%\n  lenscube lens light ghosts.lens.zarr"
)]
pub struct LightArgs {
    /// Design file, lens pack, or name of a built-in lens
    #[arg(value_name = "LENS", help = format!("Design file ({DESIGN_FILES}), lens pack, or name of a built-in lens (`lens list`)"))]
    pub lens: String,
    /// Wavelengths in nm: 400:700:50 (both ends included) or 450,550 [default: those of the design, or all of the pack]
    #[arg(long, value_name = "NM")]
    pub wavelengths: Option<String>,
    /// Share that the film reflects like a mirror, for its ghosts: a number (0.05, 5%) or a table `wavelength_nm,reflectance` (.csv)
    #[arg(long, value_name = "R|FILE", value_parser = reflectance, default_value = "0")]
    pub sensor_reflectance: ReflectanceArg,
    /// Rings from the axis to the largest field, in whose width the table of ghosts gives their size
    #[arg(long, value_name = "N", value_parser = rings, default_value_t = RINGS)]
    pub ghost_rings: usize,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// Parameters of the design.
    #[command(flatten)]
    pub parameters: DesignArgs,
}
