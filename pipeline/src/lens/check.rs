//! Checks of the tables of a band.

use super::planar::{PlanarBand, PsfPlaces, uniform};
use super::{LensBand, LensError};
use crate::bounds::{self, Bound};

/// Names the band in errors.
struct Checks {
    wavelength_nm: f64,
}

impl Checks {
    fn bad<T>(&self, table: &'static str, problem: String) -> Result<T, LensError> {
        Err(LensError::Table { wavelength_nm: self.wavelength_nm, table, problem })
    }

    fn one(&self, table: &'static str, bound: Bound, value: f64) -> Result<(), LensError> {
        match bound.check(value) {
            Ok(_) => Ok(()),
            Err(e) => self.bad(table, format!("is out of bounds: {e}")),
        }
    }

    fn all(&self, table: &'static str, bound: Bound, values: &[f64]) -> Result<(), LensError> {
        match bound.check_all(values) {
            Ok(()) => Ok(()),
            Err((i, e)) => self.bad(table, format!("is out of bounds at index {i}: {e}")),
        }
    }

    fn heights(&self, table: &'static str, heights_mm: &[f64]) -> Result<(), LensError> {
        if let Err(problem) = ascending_from_zero(heights_mm) {
            return self.bad(table, problem);
        }
        self.all(table, bounds::HEIGHT_MM, heights_mm)
    }
}

impl LensBand {
    /// Checks the contract of every table; all numbers lie within [`bounds`].
    ///
    /// # Errors
    /// [`LensError::Table`] with the first table that violates it.
    pub fn check(&self) -> Result<(), LensError> {
        let checks = Checks { wavelength_nm: self.wavelength_nm };
        checks.one("wavelength", bounds::WAVELENGTH_NM, self.wavelength_nm)?;
        match &self.planar {
            None => {
                self.check_field_points(&checks)?;
                self.check_nodes(&checks)?;
            }
            Some(planar) => self.check_planar(&checks, planar)?,
        }
        if self.psf_size.is_multiple_of(2) {
            let problem = format!("has a window of {} samples, expected an odd number", self.psf_size);
            return checks.bad("psf", problem);
        }
        checks.one("psf", bounds::PSF_SIDE, self.psf_size as f64)?;
        checks.one("psf_pitch", bounds::PITCH_UM, self.psf_pitch_um)?;
        if let Some(pitch_um) = self.kernel_pitch_um {
            checks.one("kernel_pitch", bounds::PITCH_UM, pitch_um)?;
        }
        checks.all("psf_energy", bounds::PSF_ENERGY, &self.psf_energy)?;
        checks.one("solid_angle", bounds::SOLID_ANGLE_SR, self.solid_angle_sr)?;
        checks.one("transmission", bounds::TRANSMISSION, self.transmission)?;
        self.tail.as_ref().map_or(Ok(()), |tail| tail.check(self.wavelength_nm))
    }

    /// Distortion and relative illumination over image height.
    fn check_field_points(&self, checks: &Checks) -> Result<(), LensError> {
        let m = self.ideal_height_mm.len();
        checks.one("ideal_height", bounds::FIELD_POINTS, m as f64)?;
        for (name, table) in
            [("ideal_height", &self.ideal_height_mm), ("image_height", &self.image_height_mm)]
        {
            if table.len() != m {
                return checks.bad(name, format!("has {} field points, expected {m}", table.len()));
            }
            checks.heights(name, table)?;
        }
        if self.relative_illumination.len() != m {
            let n = self.relative_illumination.len();
            return checks.bad("relative_illumination", format!("has {n} field points, expected {m}"));
        }
        checks.all("relative_illumination", bounds::RELATIVE_ILLUMINATION, &self.relative_illumination)
    }

    /// Heights, azimuths and energies of the PSFs.
    fn check_nodes(&self, checks: &Checks) -> Result<(), LensError> {
        let k = self.psf_height_mm.len();
        checks.one("psf_height", bounds::PSF_HEIGHTS, k as f64)?;
        checks.heights("psf_height", &self.psf_height_mm)?;
        if self.azimuth_count.len() != k || self.psf_energy.len() != self.psf_count() {
            let problem = format!("or psf_energy does not have {k} heights");
            return checks.bad("azimuth_count", problem);
        }
        if self.azimuth_count[0] != 1 {
            let problem = format!("is {} on the axis, expected 1", self.azimuth_count[0]);
            return checks.bad("azimuth_count", problem);
        }
        if let Some(i) =
            (1..k).find(|&i| self.azimuth_count[i] == 0 || !self.azimuth_count[i].is_multiple_of(4))
        {
            let j = self.azimuth_count[i];
            let problem = format!("is {j} at height {i}, expected a multiple of 4");
            return checks.bad("azimuth_count", problem);
        }
        self.azimuth_count.iter().try_for_each(|&j| checks.one("azimuth_count", bounds::AZIMUTHS, j as f64))
    }

    /// Those of a lens without rotational symmetry.
    fn check_planar(&self, checks: &Checks, planar: &PlanarBand) -> Result<(), LensError> {
        if let Some(name) = [
            ("ideal_height", &self.ideal_height_mm),
            ("image_height", &self.image_height_mm),
            ("relative_illumination", &self.relative_illumination),
        ]
        .iter()
        .find_map(|(name, table)| (!table.is_empty()).then_some(*name))
        {
            return checks.bad(name, "is over image height, but the lens has a map".to_owned());
        }
        if self.tail.is_some() {
            return checks.bad("tail", "belongs to a lens with rotational symmetry".to_owned());
        }
        planar.map.check(self.wavelength_nm)?;
        match &planar.psfs {
            PsfPlaces::Polar { azimuth_samples } => {
                let k = self.psf_height_mm.len();
                if azimuth_samples.len() != k {
                    let problem = format!("has {} heights, expected {k}", azimuth_samples.len());
                    return checks.bad("psf_azimuths", problem);
                }
                for &a in azimuth_samples {
                    checks.one("psf_azimuths", bounds::AZIMUTH_SAMPLES, a as f64)?;
                }
                if let Some(&a) = azimuth_samples.first().filter(|a| **a != 1) {
                    return checks.bad("psf_azimuths", format!("is {a} on the axis, expected 1"));
                }
                checks.one("psf_azimuths", bounds::PSF_ROWS, planar.psfs.count() as f64)?;
                self.check_nodes(checks)
            }
            PsfPlaces::Cartesian { x_mm, y_mm } => {
                if !(self.psf_height_mm.is_empty() && self.azimuth_count.is_empty()) {
                    let problem = "is given beside psf_x and psf_y".to_owned();
                    return checks.bad("psf_height", problem);
                }
                for (name, nodes) in [("psf_x", x_mm), ("psf_y", y_mm)] {
                    if let Err(problem) = uniform(nodes, bounds::PSF_COLUMNS) {
                        return checks.bad(name, problem);
                    }
                }
                let count = planar.psfs.count();
                checks.one("psf_x", bounds::PSF_ROWS, count as f64)?;
                match self.psf_energy.len() == count {
                    true => Ok(()),
                    false => checks
                        .bad("psf_energy", format!("has {} values, expected {count}", self.psf_energy.len())),
                }
            }
        }
    }
}

/// 0 at first, then ascending.
pub(super) fn ascending_from_zero(table: &[f64]) -> Result<(), String> {
    if table[0] != 0.0 {
        return Err(format!("starts at {} mm, expected 0", table[0]));
    }
    match table.windows(2).position(|w| !(w[1] > w[0] && w[1].is_finite())) {
        None => Ok(()),
        Some(i) => Err(format!(
            "does not ascend: {} mm at index {}, {} mm at index {}",
            table[i],
            i,
            table[i + 1],
            i + 1
        )),
    }
}
