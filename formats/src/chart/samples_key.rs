//! Key of a chart's samples for caches on this machine: a change of any sample changes it.
//!
//! Stricter than the identity of a job ([`ChartStore::identity`]), which names and modification times make: files that were unpacked or installed together
//! may share both. The key has the complete [`FileState`] of each file, whose inode and time of last status change no program can set. A second change within
//! the clock step of the file system would leave the times, so files that changed just now have no key. Samples that are written through a memory mapping
//! while the chart is used are not noticed, as elsewhere.

use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::Value;

use super::any::Chart;
use super::error::ChartError;
use super::file_change::WatchedFile;
use super::store::ChartStore;
use crate::durable::{DurableError, FileState, is_url};

/// Time after a change within which another may leave the same times: file systems record 1 ns to 2 s.
const CLOCK_STEP: Duration = Duration::from_secs(3);

impl Chart {
    /// The key of the samples and of how they are converted to values, but for the treatment of NaN; 64 hexadecimal digits. `None` if it is at a URL, or a file changed just before
    /// `now`.
    ///
    /// # Errors
    /// The files cannot be listed, or changed after the chart was opened.
    pub fn samples_key(&self, now: SystemTime) -> Result<Option<String>, ChartError> {
        let mut states = Vec::new();
        match self {
            Self::Array(_) => return Ok(None),
            Self::Store(store) if is_url(store.path()) => return Ok(None),
            Self::Scene(scene) if is_url(scene.path()) => return Ok(None),
            Self::Store(store) => store.file_states(&mut states)?,
            Self::Scene(scene) => scene.weights().file_states(&mut states)?,
            Self::Raster(raster) => states.extend(raster.files.iter().filter_map(WatchedFile::data_state)),
            Self::Decoded(decoded) => {
                states.extend(decoded.files().iter().filter_map(WatchedFile::data_state))
            }
            Self::Generated(_) => {}
        }
        let now = now.duration_since(UNIX_EPOCH).unwrap_or_default();
        let is_settled =
            |state: &FileState| state.changed_s() < now.saturating_sub(CLOCK_STEP).as_secs() as i64;
        if !states.iter().all(is_settled) {
            return Ok(None);
        }
        let (content, times): (Value, Value) = self.identity()?;
        let mut key = blake3::Hasher::new();
        key.update(format!("lenscube/chart-samples/1\n{content}\n{times}\n").as_bytes());
        states.iter().for_each(|state| {
            key.update(format!("{state:?}\n").as_bytes());
        });
        Ok(Some(key.finalize().to_hex().to_string()))
    }
}

impl ChartStore {
    /// Adds the states of the files with pixels, in the order of their keys.
    fn file_states(&self, states: &mut Vec<FileState>) -> Result<(), ChartError> {
        let mut files = self.chunk_files()?;
        files.sort();
        let array = self.array_path();
        for file in files {
            let path = array.join(&file.key);
            let look_up =
                |path: &Path| std::fs::metadata(path).map_err(|e| DurableError::io("look up", path, 0, e));
            states.push(FileState::from_metadata(&look_up(&path)?));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chart::{ChartRequest, NanPolicy};

    fn open(path: &Path) -> Chart {
        let request =
            ChartRequest { wavelengths_nm: Some(&[550.0]), nan: NanPolicy::Keep, ..ChartRequest::default() };
        Chart::open(path.to_str().unwrap(), &request).unwrap()
    }

    /// Replaced by other samples of the same size and modification time, which the identity of a job does not tell apart.
    #[test]
    fn key_changes_with_samples_whose_times_are_set_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("chart.npy");
        let write = |value: f32| {
            let samples = std::iter::repeat_n(value, 6).flat_map(f32::to_le_bytes);
            let bytes: Vec<u8> = crate::npy::header_of_f32(&[2, 3]).into_iter().chain(samples).collect();
            std::fs::write(&path, bytes).unwrap();
            std::fs::File::open(&path).unwrap().set_modified(UNIX_EPOCH + Duration::from_secs(1)).unwrap();
        };
        let later = SystemTime::now() + Duration::from_secs(3600);
        write(1.0);
        let first = open(&path);
        let key = first.samples_key(later).unwrap().expect("settled");
        assert_eq!(open(&path).samples_key(later).unwrap().as_ref(), Some(&key));
        // Changed just now: another change might leave the same times.
        assert_eq!(first.samples_key(SystemTime::now()).unwrap(), None);
        std::thread::sleep(Duration::from_millis(20));
        write(2.0);
        let second = open(&path);
        assert_eq!(second.identity().unwrap(), open(&path).identity().unwrap());
        assert_ne!(second.samples_key(later).unwrap(), Some(key));
    }
}
