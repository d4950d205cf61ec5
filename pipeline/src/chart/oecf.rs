//! Grey patches for the response of a camera to light, and frames of flat grey.
//!
//! OECF chart (ISO 14524): N patches of equal steps in density on a background of 18 %,
//! ```text
//! ρᵢ = 0.9·10^(−D·(N − 1 − i)/(N − 1)),   i = 0 .. N − 1 from dark to light, D the range of density
//! ```
//! on a circle about the middle of the film, so that relative illumination is the same for all. The angle from the top is 2π·(i + 1)/(N + 1), clockwise:
//! neighbours differ by one step, and the gap at the top separates the darkest from the lightest. Patches are squares of 0.6 of their distance.
//! Dead leaves have a frame of their mean grey, 0.1 of the film's shorter side wide or as wide as the corner marks, for noise and mean level.

use super::dead_leaves::MEAN;
use super::drawing::{Drawing, PatchColour};
use super::error::ChartError;
use super::targets::PAPER;
use crate::geometry::Rect;
use crate::real;

/// Reflectance of the background.
const BACKGROUND: f64 = 0.18;
/// Radius of the circle over the film's shorter side.
const RADIUS: f64 = 0.34;
/// Side of a patch over the distance of two, and its smallest and largest value: px, and share of the radius.
const SIDE: f64 = 0.6;
const MIN_SIDE_PX: f64 = 4.0;
const MAX_SIDE: f64 = 0.35;
/// Width of the frame of dead leaves over the film's shorter side.
const FRAME: f64 = 0.1;

impl Drawing {
    /// `count` patches over a range of `density`.
    pub(super) fn oecf(&mut self, count: usize, density: f64) -> Result<(), ChartError> {
        self.inks.grey(BACKGROUND);
        let radius = RADIUS * self.film.height.min(self.film.width) as f64;
        let step_rad = std::f64::consts::TAU / (count + 1) as f64;
        let spacing_px = 2.0 * radius * real::sin(step_rad / 2.0);
        let side = (SIDE * spacing_px).min(MAX_SIDE * radius);
        if side < MIN_SIDE_PX {
            let needed_px = MIN_SIDE_PX / SIDE;
            return Err(ChartError::Crowded { what: "grey patches", count, spacing_px, needed_px });
        }
        let [x, y] = self.centre();
        for i in 0..count {
            let (sin, cos) = real::sin_cos(step_rad * (i + 1) as f64);
            let share = (count - 1 - i) as f64 / (count - 1) as f64;
            let grey = PatchColour::Grey(PAPER * real::pow(10.0, -density * share));
            let (px, py, half) = (x + radius * sin, y - radius * cos, side / 2.0);
            self.patch([px - half, py - half, px + half, py + half], grey);
        }
        Ok(())
    }

    /// The paper of dead leaves; returns the chart pixels that they fill.
    pub(super) fn leaf_frame(&mut self) -> Rect {
        self.inks.grey(MEAN);
        let (height, width) = (self.film.height, self.film.width);
        let [columns, rows] = self.corner_px;
        let frame = (FRAME * height.min(width) as f64).max(columns).max(rows).ceil() as usize;
        let (inner_height, inner_width) = (height.saturating_sub(2 * frame), width.saturating_sub(2 * frame));
        // Clear of the texture by a quarter of the frame, for its blur.
        let strip = Rect::new(frame as i64, 0, inner_height, frame - frame / 4);
        if !strip.is_empty() {
            for x in [0, (width - strip.width) as i64] {
                self.patches.push(Rect { x, ..strip });
                self.colours.push(PatchColour::Grey(MEAN));
            }
        }
        let first = (frame + self.margin) as i64;
        Rect::new(first, first, inner_height, inner_width)
    }
}
