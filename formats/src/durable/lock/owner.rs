//! Contents of a lock file.

use serde::{Deserialize, Serialize};

use super::super::process::ProcessIdentity;

/// Owner of a lock; the lock file is this as JSON.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct LockOwner {
    /// Unit of the job.
    pub unit: String,
    /// The process.
    #[serde(flatten)]
    pub process: ProcessIdentity,
    /// Time of locking, seconds since 1970.
    pub since_unix_s: u64,
}

impl LockOwner {
    pub(super) fn parse(bytes: &[u8]) -> Option<Box<Self>> {
        serde_json::from_slice(bytes).ok()
    }
}
