//! Change of image plane or object distance of a design.

use super::error::DesignError;
use super::paraxial::Paraxial;
use super::spots;
use super::system::{Aperture, ImagePlane, System};

impl System {
    /// The same lens with its film `defocus_mm` behind `plane`.
    ///
    /// # Errors
    /// An error of first-order optics or of a ray.
    pub fn with_image_plane(&self, plane: ImagePlane, defocus_mm: f64) -> Result<Self, DesignError> {
        let mut moved = self.clone();
        let gap = self.image() - 1;
        moved.surfaces[gap].thickness_mm += match plane {
            ImagePlane::AsDesigned => 0.0,
            ImagePlane::Paraxial(um) => Paraxial::new(self, um)?.focus_shift_mm(),
            ImagePlane::BestRmsSpot(um) => spots::best_rms_shift_mm(self, um)?,
            ImagePlane::BestStrehl(um) => spots::best_strehl_shift_mm(self, um)?,
        } + defocus_mm;
        moved.check()?;
        Ok(moved)
    }

    /// The same lens for an object at another distance before its first surface (`None` = infinity). Image plane and stop radius are
    /// unchanged.
    ///
    /// # Errors
    /// An error of first-order optics at either distance.
    pub fn with_object_distance(&self, distance_mm: Option<f64>) -> Result<Self, DesignError> {
        let primary = Paraxial::new(self, self.primary_um())?;
        let mut moved = self.clone();
        // The stop radius is kept: an F-number or NA given for one conjugate must not change it at another.
        moved.aperture = Aperture::StopRadius(primary.stop_radius_mm);
        moved.object_distance_mm = distance_mm;
        moved.check()?;
        Ok(moved)
    }
}
