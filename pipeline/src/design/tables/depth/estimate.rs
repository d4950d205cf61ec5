//! What the depth nodes of a band need, estimated from a few rays before any PSF is traced.
//!
//! ```text
//! ρ = blur per dioptre · |V − V_f| in film px
//! window  that in focus + 2ρ px
//! ```
//! The number of nodes is that of [`super::trace::estimated_nodes`].

use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::System;
use crate::design::rays::paraxial::Paraxial;
use crate::design::tables::refine::max_samples;
use crate::design::tables::trace::{LensTrace, TraceOptions};
use crate::design::tables::window::coarse_um;

use super::trace::{COARSE_PX, DepthOptions, header};

/// Heights of a node without a limit: 4 to 6 of a Double Gauss up to 1.9 mm, 50 to 60 up to 21 mm; further ones per tangent of the field angle.
const HEIGHTS: (f64, f64, f64) = (2.0, 250.0, 56.0);
/// PSFs of placing the nodes, for each of them but at most for so many: some rounds, of which each computes two or three PSFs at two heights.
const PLACING_PSFS: usize = 16;
const PLACING_CELLS: usize = 96;
/// Samples of a PSF over those of one that serves placing.
const COARSER: f64 = 2.25;
/// Work of choosing window, heights and azimuths, in PSFs, on average over nodes that share them: 2494 for 135 nodes of a Double Gauss, of which 640 are theirs.
const OTHER_PSFS: usize = 14;
/// Half a window beyond the blur radius with its rim: at most and at least, px, and µm.
const RIM_PX: (f64, f64) = (12.0, 2.0);
const RIM_UM: f64 = 24.0;
/// Half a window over the blur radius: aberrations widen the rim.
const RIM: f64 = 1.2;

/// Blur radius from which on rays give the window, px.
const WIDE_PX: f64 = 10.0;

/// What depth nodes of a band need.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DepthEstimate {
    /// Number of nodes.
    pub nodes: usize,
    /// PSFs that are stored.
    pub psfs: usize,
    /// Smallest and largest window, film px.
    pub window_px: (usize, usize),
    /// PSFs that are stored, bytes, not compressed.
    pub bytes: u64,
    /// PSFs that are computed: of the nodes, of the choice of their heights and azimuths, and of placing them.
    pub computed: usize,
    /// Samples that are computed.
    pub samples: f64,
}

impl DepthEstimate {
    /// That of several bands with these nodes each.
    #[must_use]
    pub fn times(self, bands: usize) -> Self {
        let Self { nodes, psfs, window_px, bytes, computed, samples } = self;
        Self {
            nodes: nodes * bands,
            psfs: psfs * bands,
            window_px,
            bytes: bytes * bands as u64,
            computed: computed * bands,
            samples: samples * bands as f64,
        }
    }
}

/// What the nodes at `vergence` (1/m) of band `index` need, of a lens with its film in focus at `options.focus`.
///
/// # Errors
/// A ray that does not reach the image; a height that the lens does not reach.
pub fn estimate(
    system: &System,
    trace: &TraceOptions,
    index: usize,
    options: &DepthOptions,
    vergence: &[f64],
) -> Result<DepthEstimate, DesignError> {
    let focused = system.at_vergence(options.focus)?;
    let in_focus = LensTrace::new(&focused, trace)?.estimate(index)?;
    let blur_px = header(system, options)?.blur_per_dioptre_um / trace.film_pitch_um;
    let samples_per_px = in_focus.side as f64 / in_focus.window_px as f64;
    let film_um = trace.film_pitch_um;
    let coarse_per_px = film_um / coarse_um(film_um, film_um / samples_per_px);
    let focal_mm = Paraxial::new(system, system.primary_um())?.distortion_focal_length_mm.abs();
    let heights = (HEIGHTS.0 + HEIGHTS.1 * trace.max_height_mm / focal_mm).min(HEIGHTS.2);
    let mut total = DepthEstimate { window_px: (usize::MAX, 0), ..DepthEstimate::default() };
    let mut of_a_psf = 0.0;
    // Half the windows that rays give at the ends of the range, where they are wide, over the blur radius: spherical aberration narrows or widens them.
    let ends = [options.range.0, options.range.1].map(|v| -> Result<f64, DesignError> {
        let rho = blur_px * (v - options.focus).abs();
        if rho < WIDE_PX {
            return Ok(2.0);
        }
        let moved = system.at_vergence(v)?;
        let px = LensTrace::new(&moved, trace)?.expected_windows(index)?.px;
        Ok((px.saturating_sub(in_focus.window_px) as f64 / rho).clamp(1.0, 2.5))
    });
    let [far, near] = ends;
    let (far, near) = (far?, near?);
    for v in vergence {
        let rho = blur_px * (v - options.focus).abs();
        let wider = if *v < options.focus { far } else { near };
        let px = (in_focus.window_px + (wider * rho) as usize).min(trace.max_window_px);
        let is_coarse = options.is_for_film && rho >= COARSE_PX;
        let samples = (px as f64 * if is_coarse { coarse_per_px } else { samples_per_px }).powi(2);
        let heights = heights.min(max_samples(trace) as f64 / samples).max(3.0) as usize;
        total.nodes += 1;
        total.psfs += heights;
        total.window_px = (total.window_px.0.min(px), total.window_px.1.max(px));
        total.bytes += (4.0 * samples) as u64 * heights as u64;
        total.computed += heights + OTHER_PSFS;
        total.samples += samples * (heights + OTHER_PSFS) as f64;
        of_a_psf += samples;
    }
    let placing = if vergence.len() > 1 { PLACING_PSFS * vergence.len().min(PLACING_CELLS) } else { 0 };
    total.computed += placing;
    total.samples += placing as f64 * of_a_psf / vergence.len().max(1) as f64 / COARSER;
    Ok(total)
}

/// Half a window beyond the blur radius with its rim, film px.
pub(super) fn rim_px(film_pitch_um: f64) -> f64 {
    (RIM_UM / film_pitch_um).clamp(RIM_PX.1, RIM_PX.0)
}

/// Half the window of surfaces at the ends of the range of `options`, film px of `trace`, at most its largest one.
///
/// # Errors
/// No first-order properties.
pub fn half_window_px(
    system: &System,
    trace: &TraceOptions,
    options: &DepthOptions,
) -> Result<f64, DesignError> {
    let blur_px = header(system, options)?.blur_per_dioptre_um / trace.film_pitch_um;
    let (first, last) = options.range;
    let rho = blur_px * (first - options.focus).abs().max((last - options.focus).abs());
    Ok((RIM * rho + rim_px(trace.film_pitch_um)).min(trace.max_window_px as f64 / 2.0))
}

/// Farthest and nearest vergence, 1/m, whose blur on film pixels of `trace` fits into its largest window.
///
/// # Errors
/// No first-order properties.
pub fn range_that_fits(
    system: &System,
    trace: &TraceOptions,
    options: &DepthOptions,
) -> Result<(f64, f64), DesignError> {
    let blur_px = header(system, options)?.blur_per_dioptre_um / trace.film_pitch_um;
    let reach = (trace.max_window_px as f64 / 2.0 - rim_px(trace.film_pitch_um)) / RIM / blur_px;
    Ok(((options.focus - reach).max(0.0), options.focus + reach))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_film_at_two_metres_holds_one_and_a_half_to_three() {
        let system = System::double_gauss_28();
        let um = system.primary_um();
        let image = crate::design::prescription::system::ImagePlane::Paraxial(um);
        let system = system.focused_at(0.5, image, 0.0).unwrap();
        let trace = TraceOptions::new(vec![550.0], 8.0);
        let options =
            DepthOptions { focus: 0.5, range: (1.0 / 3.0, 1.0 / 1.5), tolerance: 0.02, is_for_film: false };
        let (far, near) = range_that_fits(&system, &trace, &options).unwrap();
        assert!(far < options.range.0 && near > options.range.1 && near < 0.69, "{far} {near}");
        // Traced: 285 nodes, windows of 39 to 325 px; up to 3.1 mm, where no limit of PSFs is reached, 7.1 GB compressed.
        let nodes: Vec<f64> = (0..285).map(|i| (1.0 + f64::from(i) / 284.0) / 3.0).collect();
        let needed = estimate(&system, &trace, 0, &options, &nodes).unwrap();
        assert!((3e9..12e9).contains(&(needed.bytes as f64)), "{needed:?}");
        assert!(needed.window_px.0 < 80 && needed.window_px.1.abs_diff(325) < 45, "{needed:?}");
        assert_eq!(needed.times(3).bytes, 3 * needed.bytes);
    }
}
