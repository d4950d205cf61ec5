//! In place of `objects` in a build without the feature `s3`: every URL is an error, so no value of [`Objects`] exists.

use std::path::Path;

use bytes::Bytes;

use super::error::DurableError;
use super::object_state::ObjectState;
use super::url::{Address, redacted};
use crate::features;

/// Objects below a URL: none in this build.
#[derive(Clone, Debug)]
pub enum Objects {}

impl Objects {
    /// # Errors
    /// [`DurableError::Address`].
    pub fn at(url: &Path) -> Result<Self, DurableError> {
        let text = url.to_string_lossy();
        let problem = match Address::parse(&text) {
            Err(problem) => problem,
            Ok(_) => format!("URLs are not read or written: {}", features::missing("s3")),
        };
        Err(DurableError::Address { path: redacted(&text).into(), problem })
    }
}

/// Methods of the module `objects`.
macro_rules! absent {
    ($($name:ident($($arg:ident: $kind:ty),*) -> $result:ty;)*) => {
        impl Objects {
            $(
                #[allow(missing_docs, reason = "cannot be called")]
                pub fn $name(&self $(, $arg: $kind)*) -> $result {
                    match *self {}
                }
            )*
        }
    };
}

absent! {
    root() -> &Path;
    below(_key: &str) -> Result<Self, DurableError>;
    write(_key: &str, _bytes: Bytes) -> Result<(), DurableError>;
    write_new(_key: &str, _bytes: Bytes) -> Result<bool, DurableError>;
    read_at_most(_key: &str, _limit: u64) -> Result<Option<Vec<u8>>, DurableError>;
    read_range(_key: &str, _offset: i64, _length: u64) -> Result<Option<Vec<u8>>, DurableError>;
    size_of(_key: &str) -> Result<Option<u64>, DurableError>;
    states(_keys: &[String]) -> Result<Vec<Option<ObjectState>>, DurableError>;
    exists() -> Result<bool, DurableError>;
    first_key(_predicate: impl Fn(&str) -> bool + Send + Sync + 'static) -> Result<Option<String>, DurableError>;
    names(_key: &str) -> Result<Vec<String>, DurableError>;
    remove(_key: &str) -> Result<(), DurableError>;
    remove_all(_unlisted: Vec<String>) -> Result<(), DurableError>;
}
