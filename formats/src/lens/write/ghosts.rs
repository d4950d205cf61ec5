//! Ghosts of the bands of a pack: the group `ghost`.

use super::LensPackWriter;
use crate::lens::error::LensPackError;
use pipeline::design::ghost::report::PathFigures;
use pipeline::design::ghost::rings::RingOperator;
use pipeline::lens::Lens;

impl LensPackWriter {
    /// Writes the ghosts of band `band`, of a film that reflects the share `film_reflectance`.
    ///
    /// # Errors
    /// Values that are not those of an operator; the band was written before; other rings than those of the bands before; an error of the disk.
    pub fn ghosts(
        &mut self,
        band: usize,
        operator: &RingOperator,
        film_reflectance: f64,
    ) -> Result<(), LensPackError> {
        let name = format!("ghost/operator/{band}");
        operator.check().map_err(|problem| self.invalid(format!("{name}: {problem}")))?;
        if let Some((_, (sizes, _))) = self.ghosts.first_key_value()
            && *sizes != operator.sizes
        {
            return Err(self.invalid(format!("{name} has other rings than the bands before")));
        }
        if self.ghosts.insert(band, (operator.sizes, film_reflectance)).is_some() {
            return Err(self.invalid(format!("{name} was written twice")));
        }
        let bytes: Vec<u8> = operator.values.iter().flat_map(|v| v.to_ne_bytes()).collect();
        self.array(
            &name,
            "float32",
            &operator.sizes.shape(),
            "1",
            &["order", "film_ring", "scene_ring"],
            &bytes,
        )
    }

    /// Writes the paths of the ghosts of band `band`, which films do not depend on.
    ///
    /// # Errors
    /// Numbers that no path has; an error of the disk.
    pub fn ghost_paths(&mut self, band: usize, paths: &[PathFigures]) -> Result<(), LensPackError> {
        let name = format!("ghost/paths/{band}");
        if let Some(path) = paths.iter().find(|path| PathFigures::of_numbers(path.numbers()).is_none()) {
            return Err(self.invalid(format!("{name} has the path {path:?}")));
        }
        if paths.is_empty() {
            return Ok(());
        }
        self.has_ghost_paths = true;
        let bytes: Vec<u8> = paths.iter().flat_map(PathFigures::numbers).flat_map(f64::to_ne_bytes).collect();
        let shape = [paths.len(), PathFigures::NUMBERS];
        self.array(&name, "float64", &shape, "1, but column 4 and 6: mm", &["path", "figure"], &bytes)
    }

    /// Writes the rings and reflectances of the bands of `lens`, of which all have ghosts or none; whether they have.
    pub(super) fn ghost_tables(&mut self, lens: &Lens) -> Result<bool, LensPackError> {
        if self.ghosts.is_empty() {
            return Ok(false);
        }
        if lens.depth.is_some() || !lens.is_symmetric() {
            let problem = "ghosts belong to a lens with rotational symmetry and one object distance";
            return Err(self.invalid(problem.into()));
        }
        let bands = lens.bands.len();
        if self.ghosts.keys().copied().ne(0..bands) {
            let have: Vec<_> = self.ghosts.keys().collect();
            return Err(self.invalid(format!("the lens has {bands} bands, ghosts were written for {have:?}")));
        }
        let of_bands = |value: fn(&super::GhostHead) -> f64| -> Vec<u8> {
            self.ghosts.values().flat_map(|head| value(head).to_ne_bytes()).collect()
        };
        let (ring, reflectance) = (of_bands(|head| head.0.ring_mm), of_bands(|head| head.1));
        self.array("ghost/ring", "float64", &[bands], "mm", &["wavelength"], &ring)?;
        self.array("ghost/sensor_reflectance", "float64", &[bands], "1", &["wavelength"], &reflectance)?;
        Ok(true)
    }
}
