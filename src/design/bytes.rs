//! Bounded reading of designs and of the files beside them.

use anyhow::{Context, Result};
use formats::durable::read_file_at_most;
use std::path::Path;

/// Maximum size of a design, glass catalogue or file of coatings; a lens of a thousand surfaces has less than 1 MB.
const MAX_BYTES: u64 = 64 << 20;

/// Reads a file of at most [`MAX_BYTES`].
pub(super) fn read_bytes(path: &Path) -> Result<Vec<u8>> {
    let reading = || format!("reading {}", path.display());
    read_file_at_most(path, MAX_BYTES).with_context(reading)?.with_context(|| {
        format!(
            "{} is larger than {MAX_BYTES} bytes, so it is not a design, glass catalogue or file of coatings",
            path.display()
        )
    })
}
