//! The chart as the middle of the pupil sees it: each sheet over those behind it.
//!
//! ```text
//! seen = Σ_q coverage_q · chart_q · Π_{p<q} (1 − coverage_p)
//! ```
//! per chart pixel, in the order of the sheets, nearest first; what no sheet covers is black. It stands for the scene where its blur by distance does not
//! matter: for layers of light, which are smooth.

use super::sheet::Sheet;
use crate::flow::{ChartSource, SourceSinkError};
use crate::geometry::{Rect, Size};

/// Sheets as one chart.
pub struct SeenChart<'a> {
    /// Chart of the job, which sheet 0 has.
    chart: &'a dyn ChartSource,
    sheets: Vec<Sheet<'a>>,
}

impl<'a> SeenChart<'a> {
    /// The `sheets` of a scene, nearest first; the first has `chart`.
    ///
    /// ```
    /// use lenscube_pipeline::depth::seen::SeenChart;
    /// use lenscube_pipeline::depth::sheet::{ConstantDepth, Distance, Sheet};
    /// use lenscube_pipeline::flow::ChartSource;
    /// use lenscube_pipeline::geometry::Size;
    ///
    /// let size = Size::new(2, 3);
    /// let same = |distance| ConstantDepth { size, distance };
    /// let (front, behind, quarter, metre) = (same(8.0), same(2.0), same(0.25), same(1.0));
    /// let distance = Distance { metres: 1.0, ray_focal_mm: None, miss_is_far: false };
    /// let sheet = Sheet { chart: None, depth: &metre, coverage: Some(&quarter), is_premultiplied: false, distance };
    /// let hidden = Sheet { chart: Some(&behind), coverage: None, ..sheet };
    /// let seen = SeenChart::new(&front, vec![sheet, hidden]);
    /// let mut pixels = [0.0; 6];
    /// seen.read(0, size.rect(), &mut pixels).unwrap();
    /// assert_eq!(pixels, [0.25 * 8.0 + 0.75 * 2.0; 6]);
    /// ```
    pub fn new(chart: &'a dyn ChartSource, sheets: Vec<Sheet<'a>>) -> Self {
        Self { chart, sheets }
    }

    /// Bytes while `pixels` pixels are read.
    pub const fn bytes(pixels: usize) -> usize {
        3 * size_of::<f32>() * pixels
    }
}

impl ChartSource for SeenChart<'_> {
    fn size(&self) -> Size {
        self.chart.size()
    }

    fn read(&self, band: usize, rect: Rect, out: &mut [f32]) -> Result<(), SourceSinkError> {
        let (mut coverage, mut light) = (vec![0.0; out.len()], vec![0.0; out.len()]);
        let mut open = vec![1f32; out.len()];
        out.fill(0.0);
        for sheet in &self.sheets {
            if open.iter().all(|open| *open == 0.0) {
                break;
            }
            sheet.chart.unwrap_or(self.chart).read(band, rect, &mut light)?;
            match sheet.coverage {
                None => coverage.fill(1.0),
                Some(source) => source.read(0, rect, &mut coverage)?,
            }
            for (i, out) in out.iter_mut().enumerate() {
                let share = if coverage[i] > 0.0 && sheet.is_premultiplied { 1.0 } else { coverage[i] };
                *out += open[i] * share * light[i];
                open[i] *= 1.0 - coverage[i];
            }
        }
        Ok(())
    }
}
