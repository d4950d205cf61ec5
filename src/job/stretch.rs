//! Stretch of the remap: how far the lens's tables magnify the chart, and the likely error in them if that is far from 1.

use pipeline::band::{BandPlan, Options};
use pipeline::geometry::Frame;
use pipeline::remap::Remap;

/// Stretch, or its inverse, beyond which a note is printed: no camera lens reaches it.
const MAX_USUAL_STRETCH: f64 = 4.0;

/// Stretch of the remap over all bands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RemapStretch {
    /// Ideal over REAL lengths, minimum and maximum.
    pub range: (f64, f64),
    /// Ideal over REAL height near the axis.
    near_axis: f64,
    /// Wavelength of the band with the greatest stretch.
    pub wavelength_nm: f64,
}

impl RemapStretch {
    /// Over `bands` on the film of `frame`.
    pub fn new(frame: &Frame, bands: &[BandPlan], options: &Options) -> Self {
        let none = Self { range: (1.0, 1.0), near_axis: 1.0, wavelength_nm: 0.0 };
        bands.iter().fold(none, |all, plan| {
            let remap =
                Remap::new(frame, &plan.lens, options.stages, options.interpolation, 1.0, options.simd);
            let band = remap.stretch(&plan.tiling);
            let range = (all.range.0.min(band.least), all.range.1.max(band.greatest));
            match range == all.range {
                true => all,
                false => {
                    let near_axis = plan.lens.scale_on_axis();
                    Self { range, near_axis, wavelength_nm: plan.lens.wavelength_nm }
                }
            }
        })
    }

    /// Note on a stretch that no camera lens has.
    pub fn note(&self) -> Option<String> {
        let (min, max) = self.range;
        let usual = max <= MAX_USUAL_STRETCH && min >= 1.0 / MAX_USUAL_STRETCH;
        (!usual).then(|| {
            format!(
                "at {} nm the ideal heights of the lens table grow by {min:.3e} to {max:.3e} mm per mm of REAL height (camera \
                 lenses: 0.25 to 4); {}",
                self.wavelength_nm,
                self.cause()
            )
        })
    }

    /// The likely cause: a wrong unit, by the ratio of the heights near the axis.
    pub fn cause(&self) -> String {
        let near = |factor: f64| (self.near_axis / factor).ln().abs() < 0.4;
        let units = |ideal: &str, real: &str| {
            format!("ideal_height is probably in {ideal} or image_height in {real}, expected mm for both")
        };
        match self.near_axis {
            _ if near(1e3) => units("µm", "m"),
            _ if near(1e-3) => units("m", "µm"),
            _ if near(10.0) => units("tenths of a mm", "cm"),
            _ if near(0.1) => units("cm", "tenths of a mm"),
            near_axis if near_axis < MAX_USUAL_STRETCH && self.range.1 > MAX_USUAL_STRETCH => {
                "towards 90 degrees off the axis a flat chart is stretched without limit: make the film smaller (`--film-size`)"
                    .into()
            }
            _ => {
                "check ideal_height and image_height of the lens, expected mm for both (`lenscube lens show`)"
                    .into()
            }
        }
    }
}
