//! What a band needs, estimated from a few rays before it is traced.

use rayon::prelude::*;

use super::options::{Azimuths, PsfHeights};
use super::refine::max_psfs;
use super::sampled::pitch_below;
#[cfg(doc)]
use super::shared_nodes::node_wavelengths;
use super::trace::LensTrace;
use super::window::{Windows, core_samples, expected, half_samples};
use crate::design::prescription::error::DesignError;
use crate::design::pupil::bundle::Bundle;
use crate::design::rays::ray::Tracer;

/// PSFs that choose the nodes of a band without a limit: 125 to 270 for the built-in lenses.
const PSFS: usize = 220;

/// PSFs that determine the window of a band and the error of nodes chosen at another wavelength.
const CHECKS: usize = 25;

/// PSFs that a band has without a limit: 30 to 46 for most built-in lenses, 54 to 125 where they are so wide that films use a part of their samples.
const HEIGHTS: (usize, usize) = (40, 80);

/// What a band needs, estimated from rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Window, film pixels.
    pub window_px: usize,
    /// Minimum share of the light inside it.
    pub light: f64,
    /// Samples per side of a PSF.
    pub side: usize,
    /// Samples that are computed: of the PSFs of the band, and of those that determine its window and check its nodes.
    pub samples: usize,
    /// Samples of the PSFs that choose nodes, once for all bands of [`node_wavelengths`].
    pub samples_of_choice: usize,
    /// Size of the PSFs of the band, bytes.
    pub bytes: usize,
    /// Its maximum.
    pub max_bytes: usize,
}

impl LensTrace<'_> {
    /// What the band `index` needs.
    ///
    /// # Errors
    /// A ray that does not reach the image.
    pub fn estimate(&self, index: usize) -> Result<Estimate, DesignError> {
        let options = self.options;
        let tracer = Tracer::new(self.system, options.wavelengths_nm[index] / 1e3)?;
        let last = options.max_height_mm;
        let bundles: Vec<Bundle> = (0..5)
            .into_par_iter()
            .map(|i| Bundle::trace(&tracer, tracer.field_of_height(last * f64::from(i) / 4.0)?, 12, 16))
            .collect::<Result<_, DesignError>>()?;
        let film = options.film_pitch_um;
        let nyquist = bundles.iter().map(Bundle::nyquist_um).fold(f64::INFINITY, f64::min);
        let pitch_um = options.psf_pitch_um.unwrap_or_else(|| pitch_below(options, nyquist));
        let Windows { px: window_px, core_px } = match options.window_px {
            Some(px) => Windows { px, core_px: px },
            None => expected(options, bundles.iter(), pitch_um),
        };
        let light =
            1.0 - bundles.iter().map(|b| b.light_outside(0.5 * film * window_px as f64)).fold(0.0, f64::max);
        let spline_pitch_um = self.spline_pitch((pitch_um, nyquist), window_px);
        let side = 2 * half_samples(window_px, film, spline_pitch_um) + 1;
        let core_side = 2 * core_samples(core_px, film, pitch_um).0 + 1;
        let limited = PSFS.min(max_psfs(&self.node_options(), core_side.pow(2) as f64));
        let film_samples = self.film_samples(side, spline_pitch_um);
        let (chosen_by, max_bytes) = match (&options.heights, options.azimuths) {
            (PsfHeights::Given(h), Azimuths::Given(_)) => (0, 4 * side * side * h.len()),
            (PsfHeights::Given(h), _) => (limited.max(3 * h.len()), 4 * side * side * h.len()),
            (PsfHeights::ByError, _) => {
                let heights = film_samples.most(options);
                (limited, 4 * side * side * heights.min(options.max_nodes))
            }
        };
        let bytes = match &options.heights {
            PsfHeights::Given(_) => max_bytes,
            PsfHeights::ByError => {
                let heights = if film_samples.allowed(options).len() > 1 { HEIGHTS.1 } else { HEIGHTS.0 };
                max_bytes.min(4 * side * side * heights)
            }
        };
        let core_samples = core_side * core_side;
        let samples = CHECKS.min(chosen_by) * core_samples + bytes / 4;
        let samples_of_choice = chosen_by * core_samples;
        Ok(Estimate { window_px, light, side, samples, samples_of_choice, bytes, max_bytes })
    }
}
