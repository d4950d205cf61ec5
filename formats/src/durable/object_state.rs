//! What identifies the contents of an object.

/// Metadata of an object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectState {
    /// Size in bytes.
    pub size: u64,
    /// ETag, or else time of modification; changes with the contents.
    pub tag: String,
}
