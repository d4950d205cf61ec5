//! PSFs as a NumPy array of 32-bit floats, (wavelength, place_y, place_x, y, x), and a JSON of the same name with what they are: the description, wavelengths
//! in nm, places in mm and film pixels, `energy` (wavelength, place_y, place_x).

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::{BandPsfs, PsfGrid, PsfGridError, verify, write};
use crate::durable::{AtomicFile, finish_together};
use crate::npy::header_of_f32;

/// The JSON beside the array `path`.
pub fn json_path(path: &Path) -> PathBuf {
    path.with_extension("json")
}

/// A writer of bands in order.
#[derive(Debug)]
pub struct NpyWriter<'a> {
    grid: &'a PsfGrid,
    path: &'a Path,
    file: AtomicFile,
    digest: blake3::Hasher,
    energy: Vec<Value>,
}

impl<'a> NpyWriter<'a> {
    /// Begins the file.
    ///
    /// # Errors
    /// [`PsfGridError`].
    pub fn new(path: &'a Path, grid: &'a PsfGrid) -> Result<Self, PsfGridError> {
        let (file, mut digest) = (AtomicFile::create(path)?, blake3::Hasher::new());
        let n = grid.side();
        let shape = [grid.wavelengths_nm.len(), grid.y_px.len(), grid.x_px.len(), n, n];
        write(&mut file.writer(), &mut digest, path, &header_of_f32(&shape))?;
        Ok(Self { grid, path, file, digest, energy: Vec::new() })
    }

    /// Writes the next band.
    ///
    /// # Errors
    /// [`PsfGridError`].
    pub fn band(&mut self, band: &BandPsfs) -> Result<(), PsfGridError> {
        let mut out = self.file.writer();
        for psf in band.samples.chunks(self.grid.side() * self.grid.side()) {
            let bytes: Vec<u8> = psf.iter().flat_map(|v| v.to_le_bytes()).collect();
            write(&mut out, &mut self.digest, self.path, &bytes)?;
        }
        self.energy.push(json!(band.energy.chunks(self.grid.x_px.len()).collect::<Vec<_>>()));
        Ok(())
    }

    /// Reads the array again, and gives both files their names.
    ///
    /// # Errors
    /// [`PsfGridError`]; existing files are unchanged then.
    pub fn finish(self) -> Result<(), PsfGridError> {
        let Self { grid, path, file, digest, energy } = self;
        verify(&file, path, &digest)?;
        let mut description = grid.description();
        description["axes"] = json!(["wavelength", "place_y", "place_x", "y", "x"]);
        description["wavelengths_nm"] = json!(grid.wavelengths_nm);
        description["places_x_mm"] = json!(grid.x_mm());
        description["places_y_mm"] = json!(grid.y_mm());
        description["places_x_px"] = json!(grid.x_px);
        description["places_y_px"] = json!(grid.y_px);
        description["energy"] = Value::Array(energy);
        let text = serde_json::to_string_pretty(&description).expect("a JSON value serializes") + "\n";
        let json = AtomicFile::with_text(&json_path(path), &text)?;
        Ok(finish_together(vec![file, json])?)
    }
}
