//! Calls of the crate `hdf5-pure`, whose errors and panics are errors of the file.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

use hdf5_pure::{Error, FormatError};

use crate::chart::error::ChartError;
use crate::chart::header::header_error;
use crate::durable::DurableError;

/// Calls the reader of the structure; its errors and panics are errors of the file.
pub(super) fn guarded<T>(path: &Path, read: impl FnOnce() -> Result<T, Error>) -> Result<T, ChartError> {
    let damaged = |reason: String| ChartError::Damaged { path: path.into(), reason };
    match catch_unwind(AssertUnwindSafe(read)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(Error::Io(e))) => Err(DurableError::io("read", path, 0, e).into()),
        Ok(Err(e @ Error::Format(FormatError::UnexpectedEof { .. }))) => Err(damaged(e.to_string())),
        Ok(Err(e)) => {
            let expected = "a structure that is read; if the file is complete, `h5repack IN OUT` rewrites it";
            Err(header_error(path, "HDF5 structure", expected, e.to_string()))
        }
        Err(_) => Err(damaged("the HDF5 reader failed on it".into())),
    }
}
