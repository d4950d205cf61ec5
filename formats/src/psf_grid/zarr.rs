//! PSFs as a Zarr v3 group: `psf` (wavelength, place_y, place_x, y, x), `energy` (wavelength, place_y, place_x), and their coordinates: wavelengths in nm,
//! places in mm from the axis (`place_y` down), samples in µm from the chief ray. A chunk is one PSF.

use std::path::Path;

use serde_json::{Value, json};

use super::{BandPsfs, PsfGrid, PsfGridError, SCHEMA};
use crate::durable::Store;
use crate::group::read_json;
use crate::hierarchy::{NewGroup, array, bytes_and_crc, coordinate, with_crc};

/// Axes of the PSFs.
const AXES: [&str; 5] = ["wavelength", "place_y", "place_x", "y", "x"];

/// A writer of bands in order.
#[derive(Debug)]
pub struct ZarrWriter<'a> {
    grid: &'a PsfGrid,
    path: &'a Path,
    group: NewGroup,
    energy: Vec<f64>,
    bands: usize,
}

impl<'a> ZarrWriter<'a> {
    /// Begins the group; of an existing directory only a group of PSFs is replaced when it is complete.
    ///
    /// # Errors
    /// [`PsfGridError::Foreign`]: another directory, or, at a URL, anything.
    pub fn new(path: &'a Path, grid: &'a PsfGrid) -> Result<Self, PsfGridError> {
        let foreign = || PsfGridError::Foreign { path: path.into() };
        let group = match NewGroup::begin(path, true, |_| false)? {
            Some(group) => group,
            None => {
                let store = Store::at(path)?;
                let group = match &store {
                    Store::Directory(_) => read_json(&store, "zarr.json")?,
                    Store::Objects(_) => None,
                };
                let schema = group.as_ref().and_then(|group| group["attributes"]["schema"].as_str());
                match schema == Some(SCHEMA) {
                    true => NewGroup::replacing(path, true)?,
                    false => return Err(foreign()),
                }
            }
        };
        Ok(Self { grid, path, group, energy: Vec::new(), bands: 0 })
    }

    /// Writes the next band, and reads it again.
    ///
    /// # Errors
    /// [`PsfGridError`].
    pub fn band(&mut self, band: &BandPsfs) -> Result<(), PsfGridError> {
        let columns = self.grid.x_px.len();
        for (i, psf) in band.samples.chunks(self.grid.side() * self.grid.side()).enumerate() {
            let key = format!("psf/c/{}/{}/{}/0/0", self.bands, i / columns, i % columns);
            self.put(&key, with_crc(psf.iter().flat_map(|v| v.to_le_bytes()).collect()))?;
        }
        self.energy.extend(&band.energy);
        self.bands += 1;
        Ok(())
    }

    fn put(&self, key: &str, bytes: Vec<u8>) -> Result<(), PsfGridError> {
        let store = &self.group.store;
        store.write(key, bytes.clone())?;
        match store.read(key)?.is_some_and(|read| read == bytes) {
            true => Ok(()),
            false => Err(PsfGridError::Differs { path: self.path.join(key) }),
        }
    }

    /// Writes coordinates and metadata, and gives the group its name.
    ///
    /// # Errors
    /// [`PsfGridError`].
    pub fn finish(mut self) -> Result<(), PsfGridError> {
        let grid = self.grid;
        let (n, places) = (grid.side(), [grid.wavelengths_nm.len(), grid.y_px.len(), grid.x_px.len()]);
        let energy = with_crc(self.energy.iter().flat_map(|v| v.to_le_bytes()).collect());
        self.put("energy/c/0/0/0", energy)?;
        let at_um = grid.at_um();
        let coordinates: [(&str, &str, &str, &[f64]); 5] = [
            ("wavelength", "nm", "wavelength", &grid.wavelengths_nm),
            ("place_y", "mm", "place below the optical axis", &grid.y_mm()),
            ("place_x", "mm", "place right of the optical axis", &grid.x_mm()),
            ("y", "um", "distance below the chief ray", &at_um),
            ("x", "um", "distance right of the chief ray", &at_um),
        ];
        for (name, unit, long_name, values) in coordinates {
            self.group.coordinate(name, coordinate(name, unit, long_name, values))?;
        }
        let of = |long_name: &str, units: &str| json!({ "long_name": long_name, "units": units });
        let psf = array(
            &[&places[..], &[n, n]].concat(),
            &[1, 1, 1, n, n],
            "float32",
            bytes_and_crc(),
            &AXES,
            of("light in the film pixel about the sample over all light of the point", "1"),
        );
        self.group.array("psf", psf)?;
        let of_energy = of("share of all light of the point in the PSF", "1");
        let energy = array(&places, &places, "float64", bytes_and_crc(), &AXES[..3], of_energy);
        self.group.array("energy", energy)?;
        let attributes: Value = grid.description();
        match self.group.publish(attributes)? {
            true => Ok(()),
            false => Err(PsfGridError::Foreign { path: self.path.into() }),
        }
    }
}
