//! Descriptions of the manufacturing errors of a lens (TOML), their record, and their import from OpticStudio.
//!
//! | module | content |
//! |---|---|
//! | `read`, `limits`, `settings` | the entries of a description; limits and laws; what is compensated and judged |
//! | `write` | the text of a description |
//! | `record` | drawn values as rows |
//! | [`import`](mod@import) | TOL lines of .zmx files |
//!
//! # The description
//!
//! Surfaces are numbered as the design file does (object = 0). A number is ±; `[low, high]` are limits; `{limits = [low, high],
//! law = "uniform"}` sets the law as well. Everything is optional but the surfaces of an entry and one error of it.
//!
//! ```toml
//! [tolerances]
//! law = "normal"                    # normal: limits are ±2 sigma, truncated | uniform | two-point | parabolic
//! fringe_nm = 546.1                 # test wavelength
//! [[element]]                       # moves as one body; groups: an element that spans others contains them
//! surfaces = [7, 9]
//! decentre_um = 20                  # x and y, each drawn; radial = true: one size in a drawn direction; decentre_x_um, decentre_y_um
//! tilt_arcmin = 1                   # about x and y; or tilt_x_arcmin, tilt_y_arcmin; tilt_radial = true
//! pivot = 7                         # surface that it is tilted about, and pivot_offset_mm behind it
//! wedge_arcmin = 1                  # of the last surface; or wedge_x_arcmin, wedge_y_arcmin; wedge_radial = true
//! shift_um = 20                     # along z, between fixed neighbours
//! [[surface]]
//! surface = 5
//! radius_percent = 0.1              # or radius_fringes, radius_um
//! irregularity_fringes = 0.5        # figure = "astigmatism" | "mixed"
//! conic = 0.01                      # and decentre, tilt
//! [[surface]]
//! surface = 6
//! figure = "zernike"
//! zernike = { terms = [4, 11], rms_waves = 0.05 }   # first and last term; rms_waves is shared by all of them equally
//! [[gap]]
//! after = 3
//! thickness_um = 20                 # absorb = 5: the gap behind surface 5 takes it up
//! [[glass]]
//! after = 3
//! index = 5e-4
//! abbe_percent = 0.8
//! [[film]]
//! tilt_arcmin = 5                   # and decentre, shift_um
//! [compensate]
//! focus_um = [-500, 500]            # absent: [-1000, 1000]; focus = false: none
//! film_tilt = false
//! boresight = "keep"                # "remove"
//! [criterion]
//! kind = "mtf"                      # "rms-spot" | "rms-wavefront"
//! frequency_per_mm = 50
//! fields = "film"                   # or a list of [x_mm, y_mm]
//! ```

mod error;
pub mod import;
mod limits;
mod read;
mod record;
mod settings;
#[cfg(test)]
mod tests;
mod write;

pub use error::ToleranceFileError;
pub use import::{Import, import};
pub use read::ToleranceFile;
pub use record::{columns, record};
pub use write::write;
