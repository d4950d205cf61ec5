//! Where a film lies in the field, and which part of the chart it shows.
//!
//! ```text
//! film  x_mm = center + (x − W/2) · pitch           x from the left edge of the film's first pixel, W its width
//! chart x_mm = chart_center + (x − W_c/2) · pitch   on the ideal image plane; film pixels and chart pixels have one pitch
//! ```
//! y likewise, downwards.

use pipeline::geometry::Size;

/// A film and its chart, of one pitch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Size of the film.
    pub film: Size,
    /// Size of the chart.
    pub chart: Size,
    /// Their pitch, µm.
    pub pitch_um: f64,
    /// Centre of the film, (x, y) in mm from the axis.
    pub center_mm: [f64; 2],
    /// Centre of the chart on the ideal image plane.
    pub chart_center_mm: [f64; 2],
}

impl Placement {
    /// Flags of `lenscube run` for the film.
    pub fn flags(&self) -> Vec<String> {
        let Size { height, width } = self.film;
        let mut flags =
            vec![format!("--film-pitch-um={}", self.pitch_um), format!("--film-size={width}x{height}")];
        let [x, y] = self.center_mm;
        if [x, y] != [0.0; 2] {
            let per_mm = 1e3 / self.pitch_um;
            let (column, row) =
                ((width as f64 - 1.0) / 2.0 - x * per_mm, (height as f64 - 1.0) / 2.0 - y * per_mm);
            flags.push(format!("--axis={column},{row}"));
        }
        let [x, y] = self.chart_center_mm;
        if [x, y] != [0.0; 2] {
            flags.push(format!("--center={x},{y}"));
        }
        flags
    }

    /// Points of the film, mm, of points in pixels from the upper left corner of the film.
    pub fn film_mm(&self, px: &[[f64; 2]]) -> Vec<[f64; 2]> {
        px.iter().map(|p| self.mm(self.film, self.center_mm, *p)).collect()
    }

    /// Points of the chart, mm, of points in pixels from its upper left corner.
    pub fn chart_mm(&self, px: &[[f64; 2]]) -> Vec<[f64; 2]> {
        px.iter().map(|p| self.mm(self.chart, self.chart_center_mm, *p)).collect()
    }

    /// The inverse of [`Placement::film_mm`].
    pub fn film_px(&self, mm: &[[f64; 2]]) -> Vec<[f64; 2]> {
        mm.iter().map(|p| self.px(self.film, self.center_mm, *p)).collect()
    }

    /// The inverse of [`Placement::chart_mm`].
    pub fn chart_px(&self, mm: &[[f64; 2]]) -> Vec<[f64; 2]> {
        mm.iter().map(|p| self.px(self.chart, self.chart_center_mm, *p)).collect()
    }

    fn mm(&self, size: Size, center: [f64; 2], px: [f64; 2]) -> [f64; 2] {
        let half = [size.width as f64 / 2.0, size.height as f64 / 2.0];
        std::array::from_fn(|i| center[i] + (px[i] - half[i]) * self.pitch_um * 1e-3)
    }

    fn px(&self, size: Size, center: [f64; 2], mm: [f64; 2]) -> [f64; 2] {
        let half = [size.width as f64 / 2.0, size.height as f64 / 2.0];
        std::array::from_fn(|i| (mm[i] - center[i]) / (self.pitch_um * 1e-3) + half[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_and_flags_are_those_of_a_run() {
        let place = Placement {
            film: Size::new(200, 301),
            chart: Size::new(210, 311),
            pitch_um: 2.0,
            center_mm: [0.5, -0.25],
            chart_center_mm: [0.51, -0.255],
        };
        // The axis is the point 0 mm: in pixel indices 0.5 less than from the corner.
        let [x, y] = place.film_px(&[[0.0, 0.0]])[0];
        let flags = place.flags();
        assert_eq!(flags[..2], ["--film-pitch-um=2", "--film-size=301x200"]);
        assert_eq!(flags[2], format!("--axis={},{}", x - 0.5, y - 0.5));
        assert_eq!(flags[3], "--center=0.51,-0.255");
        let there = place.chart_mm(&[[3.0, 4.0]]);
        let back = place.chart_px(&there)[0];
        assert!((back[0] - 3.0).abs() < 1e-9 && (back[1] - 4.0).abs() < 1e-9);
        let centre = place.chart_px(&[place.chart_center_mm])[0];
        assert_eq!(centre, [155.5, 105.0]);
        let plain = Placement { center_mm: [0.0; 2], chart_center_mm: [0.0; 2], ..place };
        assert_eq!(plain.flags().len(), 2);
    }
}
