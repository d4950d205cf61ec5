//! The bytes of a file for the reader of its structure: a limited number of them, so that lists that contain themselves end.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use hdf5_pure::{FormatError, Source};

/// Maximum bytes read: the structure of a million chunks.
const MAX_BYTES: u64 = 128 << 20;
/// Bytes that a read counts at least.
const MIN_READ_BYTES: u64 = 128;

pub(super) struct BoundedSource {
    file: File,
    length: u64,
    left: AtomicU64,
}

impl BoundedSource {
    pub(super) fn new(file: File, length: u64) -> Self {
        Self { file, length, left: AtomicU64::new(MAX_BYTES) }
    }
}

impl Source for BoundedSource {
    fn len(&self) -> u64 {
        self.length
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> Result<(), FormatError> {
        let count = (buffer.len() as u64).max(MIN_READ_BYTES);
        let spent = self.left.fetch_update(Relaxed, Relaxed, |left| left.checked_sub(count));
        if spent.is_err() {
            return Err(FormatError::Source(format!("the structure has more than {} MiB", MAX_BYTES >> 20)));
        }
        self.file.read_exact_at(buffer, offset).map_err(|e| match e.kind() {
            std::io::ErrorKind::UnexpectedEof => FormatError::UnexpectedEof {
                expected: (offset as usize).saturating_add(buffer.len()),
                available: self.length as usize,
            },
            _ => FormatError::Source(e.to_string()),
        })
    }
}
