//! Sheets: surfaces with a chart, a distance and a coverage per chart pixel.
//!
//! Sheet 0 is what a pinhole at the centre of the entrance pupil sees; the others are hidden behind it. All have the chart's size.
//!
//! ```text
//! V = 1/z,   z = distance · unit                      distance along the axis from the entrance pupil (planar)
//! z = distance · unit · f_D/hypot(f_D, X, Y)          distance along the ray to the chart pixel at (X, Y) on the ideal image plane
//! ```
//! A distance of 10⁶ m or more is infinity, V = 0.

use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::Frame;
use crate::real;

/// Distances from here on are infinity, m.
const INFINITE_M: f64 = 1e6;

/// Distances of a depth array and their unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// Metres per unit.
    pub metres: f64,
    /// Distances are along the ray, of a lens with this distortion focal length in mm; `None`: along the axis.
    pub ray_focal_mm: Option<f64>,
    /// NaN, 0 and negative distances are infinity: renderers write them where a ray meets nothing.
    pub miss_is_far: bool,
}

impl Distance {
    /// Vergence in 1/m of the distance `value` at `ideal_mm` (Y, X) from the axis on the ideal image plane; `None` for a distance that is not
    /// positive.
    pub fn vergence(&self, value: f32, ideal_mm: (f64, f64)) -> Option<f64> {
        let along_axis =
            self.ray_focal_mm.map_or(1.0, |f| f / real::hypot(f, real::hypot(ideal_mm.0, ideal_mm.1)));
        let z = f64::from(value) * self.metres * along_axis;
        match z > 0.0 {
            true if z >= INFINITE_M => Some(0.0),
            true => Some(1.0 / z),
            false => self.miss_is_far.then_some(0.0),
        }
    }

    /// Position (Y, X) in mm from the axis on the ideal image plane of chart pixel (row, column).
    pub fn ideal_mm(frame: &Frame, row: usize, column: usize) -> (f64, f64) {
        let pitch = frame.pitch_mm();
        let at = |i: usize, n: usize, scale: f64, centre: f64| {
            (i as f64 - (n as f64 - 1.0) / 2.0) * pitch * scale + centre
        };
        let (y, x) = (
            at(row, frame.chart.height, frame.scale.0, frame.center_mm.0),
            at(column, frame.chart.width, frame.scale.1, frame.center_mm.1),
        );
        let [x, y] = frame.projection.ideal_point_mm([x, y]);
        (y, x)
    }
}

/// One sheet.
#[derive(Clone, Copy)]
pub struct Sheet<'a> {
    /// Its chart; `None`: the chart of the job, for sheet 0.
    pub chart: Option<&'a dyn ChartSource>,
    /// Distances, band 0.
    pub depth: &'a dyn ChartSource,
    /// Share of each pixel that it covers, 0 to 1, band 0; `None`: 1. Where it is 0 neither light nor distance count.
    pub coverage: Option<&'a dyn ChartSource>,
    /// Whether the light of its chart is multiplied by the coverage; else it is that of the surface alone.
    pub is_premultiplied: bool,
    /// What a distance means.
    pub distance: Distance,
}

/// The same distance everywhere.
#[derive(Clone, Copy, Debug)]
pub struct ConstantDepth {
    /// Size of the chart.
    pub size: crate::geometry::Size,
    /// The distance.
    pub distance: f32,
}

impl ChartSource for ConstantDepth {
    fn size(&self) -> crate::geometry::Size {
        self.size
    }

    fn read(&self, _: usize, _: crate::geometry::Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        out.fill(self.distance);
        Ok(())
    }
}

/// A distance that is not positive, found while tiles are computed.
#[derive(Debug, thiserror::Error)]
#[error("the depth at row {row}, column {column} is {value}, expected a distance above 0")]
pub struct InvalidDistance {
    /// Row of the chart.
    pub row: usize,
    /// Column of the chart.
    pub column: usize,
    /// As stored.
    pub value: f32,
}

/// A distance at which the scene had no surface when the job was planned.
#[derive(Debug, thiserror::Error)]
#[error(
    "the depth at row {row}, column {column} is {value}: the depth array changed after the run was planned; start again"
)]
pub struct ChangedDistance {
    /// Row of the chart.
    pub row: usize,
    /// Column of the chart.
    pub column: usize,
    /// As stored.
    pub value: f32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Size;

    #[test]
    fn distances_become_vergences() {
        let metres = Distance { metres: 1.0, ray_focal_mm: None, miss_is_far: false };
        let at = |d: &Distance, z: f32| d.vergence(z, (0.0, 0.0));
        assert_eq!([2.0, 1e6, f32::INFINITY].map(|z| at(&metres, z)), [Some(0.5), Some(0.0), Some(0.0)]);
        assert_eq!([0.0, -1.0, f32::NAN].map(|z| at(&metres, z)), [None; 3]);
        let far = Distance { miss_is_far: true, ..metres };
        assert_eq!([0.0, -1.0, f32::NAN].map(|z| at(&far, z)), [Some(0.0); 3]);
        let mm = Distance { metres: 1e-3, ..metres };
        assert_eq!(at(&mm, 500.0), Some(2.0));
    }

    #[test]
    fn ray_distances_are_projected_on_the_axis() {
        let frame = Frame::centred(Size::new(3, 7), Size::new(3, 7), 1e4);
        let ray = Distance { metres: 1.0, ray_focal_mm: Some(40.0), miss_is_far: false };
        // Chart pixel (1, 6) is 3 pixels of 10 mm from the axis: 3-4-5.
        let at = Distance::ideal_mm(&frame, 1, 6);
        assert_eq!(at, (0.0, 30.0));
        assert!((ray.vergence(2.0, at).unwrap() - 1.0 / 1.6).abs() < 1e-15);
    }
}
