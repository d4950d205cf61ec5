//! Directions of the light at the film: the group `cones`.

use super::LensPackWriter;
use crate::lens::error::LensPackError;
use pipeline::lens::LensBand;
use pipeline::lens::cone::ConeTable;

impl LensPackWriter {
    /// Writes the cones of `bands`, one table of as many heights each.
    pub(super) fn cones(&mut self, bands: &[LensBand], cones: &[&ConeTable]) -> Result<(), LensPackError> {
        let steps: Vec<u8> = cones.iter().flat_map(|table| table.step_mm().to_ne_bytes()).collect();
        self.array("cones/height_step", "float64", &[bands.len()], "mm", &["wavelength"], &steps)?;
        let heights = cones[0].directions().count();
        let values = cones.iter().flat_map(|table| table.directions().flatten());
        let bytes: Vec<u8> = values.flat_map(f64::to_ne_bytes).collect();
        let axes = ["wavelength", "height", "chief_centre_tangential_sagittal"];
        self.array("cones/direction", "float64", &[bands.len(), heights, 4], "1", &axes, &bytes)
    }
}
