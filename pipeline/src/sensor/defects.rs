//! Pixels of a die that are not like the others: hot pixels and those of telegraph noise, by their density.
//!
//! Two uniform numbers u, v of a pixel of the die and one, w, of a frame ([`super::random`]):
//!
//! ```text
//! hot         u < density:   the dark current is larger by −ln(u/density)·mean        (e-/s at the reference temperature; it doubles as all dark current does)
//! telegraph   v < density:   the charge is ±a/2, + where w ≥ ½, a = −ln(v/density)·mean  (e-): one trap, new in each frame
//! ```
//!
//! So amplitudes are exponentially distributed, as the tails of measured dark currents and of telegraph amplitudes about are. Hot pixels belong to the dark current (`--noise dark`), telegraph noise to the read noise (`read`). Figures of EMVA 1288 are those of all
//! pixels, defects included; the noise that developments and comparisons assume is without them.

use super::LANES;
use super::quantile::ln;
use serde::{Deserialize, Serialize};

/// Densities and means of defects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields, default)]
pub struct Defects {
    /// Share of the pixels that are hot.
    pub hot_pixels: f64,
    /// Mean of their additional dark current, e-/s.
    pub hot_dark_e_per_s: f64,
    /// Share of the pixels with telegraph noise.
    pub telegraph_pixels: f64,
    /// Mean distance of its two levels, e-.
    pub telegraph_e: f64,
}

/// −ln(u/density) where u is below the density, else 0: exponential numbers of mean 1 of a share of the pixels. None if all are 0.
#[inline(always)]
pub(super) fn amplitudes(u: &[f64; LANES], density: f64) -> Option<[f64; LANES]> {
    let any = u.iter().fold(false, |any, u| any | (*u < density));
    any.then(|| u.map(|u| if u < density { -ln(u / density) } else { 0.0 }))
}
