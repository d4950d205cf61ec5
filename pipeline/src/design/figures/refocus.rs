//! Change of image plane or object distance of a design.

use super::spots;
use crate::design::prescription::error::DesignError;
use crate::design::prescription::system::{Aperture, ImagePlane, System};
use crate::design::rays::paraxial::Paraxial;

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

    /// The same lens with its film in focus on an axial point at vergence `focus` (1/m from the centre of the entrance pupil), by the rule
    /// `plane`, `defocus_mm` behind it. As designed: at the distance from the paraxial image that the design's film has for the design's object.
    ///
    /// # Errors
    /// As [`System::at_vergence`]; an error of a ray.
    pub fn focused_at(&self, focus: f64, plane: ImagePlane, defocus_mm: f64) -> Result<Self, DesignError> {
        let um = self.primary_um();
        let designed_mm = -Paraxial::new(self, um)?.focus_shift_mm();
        let moved = self.at_vergence(focus)?;
        match plane {
            ImagePlane::AsDesigned => {
                moved.with_image_plane(ImagePlane::Paraxial(um), designed_mm + defocus_mm)
            }
            plane => moved.with_image_plane(plane, defocus_mm),
        }
    }

    /// The same lens and film for an object at vergence `v`, 1/m from the centre of the entrance pupil; 0 = infinity.
    ///
    /// # Errors
    /// An object at or behind the first surface; a telecentric object space; an error of first-order optics.
    pub fn at_vergence(&self, v: f64) -> Result<Self, DesignError> {
        if self.is_telecentric {
            return Err(DesignError::Option {
                option: "object distance from the entrance pupil",
                value: format!("{} m", 1.0 / v),
                expected: "a lens with an entrance pupil: the object space of this one is telecentric",
            });
        }
        let pupil_mm = Paraxial::new(self, self.primary_um())?.entrance_pupil_mm;
        // Beyond 1000 km the bundles of any lens are parallel to the last bit of its path lengths.
        let distance_mm = (v > 1e-6).then(|| 1e3 / v - pupil_mm);
        if distance_mm.is_some_and(|d| d <= 0.0) {
            return Err(DesignError::Option {
                option: "object distance from the entrance pupil",
                value: format!("{} m", 1.0 / v),
                expected: "one in front of the first surface",
            });
        }
        self.with_object_distance(distance_mm)
    }

    /// Vergence of the design's object, 1/m from the centre of the entrance pupil; 0 = infinity.
    ///
    /// # Errors
    /// An error of first-order optics.
    pub fn object_vergence(&self) -> Result<f64, DesignError> {
        let pupil_mm = Paraxial::new(self, self.primary_um())?.entrance_pupil_mm;
        Ok(self.object_distance_mm.map_or(0.0, |d| 1e3 / (d + pupil_mm)))
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
