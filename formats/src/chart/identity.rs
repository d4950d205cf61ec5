//! Which chart this is: a digest of all that its pixels follow from, the place where it lies excepted.

use std::path::Path;
use std::time::UNIX_EPOCH;

use serde_json::json;

use super::ChartStore;
use super::open::{canonical, sorted};
use crate::durable::{DurableError, is_temp_name};

impl ChartStore {
    /// What the chart is, as JSON with sorted keys: the array's metadata (without attributes), wavelengths, pitch, film
    /// size, units.
    pub fn description(&self) -> String {
        sorted(json!({
            "array": canonical(&self.layout.array),
            "wavelengths_nm": self.wavelengths_nm,
            "pitch_um": self.pitch_um,
            "film_size": self.film_size.map(|s| [s.height, s.width]),
            "units": self.units,
        }))
        .to_string()
    }

    /// BLAKE3 of [`ChartStore::description`] and of the name and size, and with `mtimes` the time of last change, of
    /// every file of the array, as 64 hexadecimal digits. A copy has the same identity (with `mtimes`: a copy that keeps
    /// them); pixels changed within a file of the same size show in `mtimes` only.
    ///
    /// # Errors
    /// [`DurableError`] if the files cannot be listed.
    pub fn identity(&self, mtimes: bool) -> Result<String, DurableError> {
        let mut files = Vec::new();
        list(&self.array_path(), "", &mut files)?;
        files.sort();
        let mut hash = blake3::Hasher::new();
        hash.update(b"lenscube/chart-identity/1\n");
        hash.update(self.description().as_bytes());
        for (name, size, time) in files {
            let time = if mtimes { time.to_string() } else { String::new() };
            hash.update(format!("\n{name}\t{size}\t{time}").as_bytes());
        }
        Ok(hash.finalize().to_hex().to_string())
    }
}

/// Names below `directory`, sizes and times in ns; metadata is in the description already.
fn list(directory: &Path, prefix: &str, files: &mut Vec<(String, u64, u128)>) -> Result<(), DurableError> {
    let failed = |e| DurableError::io("list", directory, 0, e);
    for entry in std::fs::read_dir(directory).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if is_temp_name(&name) || matches!(&*name, "zarr.json" | ".zarray" | ".zattrs" | ".zmetadata") {
            continue;
        }
        let meta =
            std::fs::metadata(entry.path()).map_err(|e| DurableError::io("look up", &entry.path(), 0, e))?;
        let name = format!("{prefix}{name}");
        if meta.is_dir() {
            list(&entry.path(), &(name + "/"), files)?;
        } else {
            let time = meta.modified().ok().and_then(|t| t.duration_since(UNIX_EPOCH).ok());
            files.push((name, meta.len(), time.map_or(0, |t| t.as_nanos())));
        }
    }
    Ok(())
}
