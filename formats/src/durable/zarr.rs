//! [`Directory`] as a zarrs storage.

use std::path::Path;

use zarrs::storage::byte_range::{ByteRange, ByteRangeIterator};
use zarrs::storage::{
    Bytes, ListableStorageTraits, MaybeBytes, MaybeBytesIterator, OffsetBytesIterator, ReadableStorageTraits,
    StorageError, StoreKey, StoreKeys, StoreKeysPrefixes, StorePrefix, WritableStorageTraits,
};

use super::{Directory, DurableError, is_temp_name};

impl From<DurableError> for StorageError {
    fn from(e: DurableError) -> Self {
        let kind = match &e {
            DurableError::StorageFull { source, .. }
            | DurableError::Permission { source, .. }
            | DurableError::Io { source, .. } => source.kind(),
            _ => std::io::ErrorKind::InvalidData,
        };
        std::io::Error::new(kind, e).into()
    }
}

impl ReadableStorageTraits for Directory {
    fn get(&self, key: &StoreKey) -> Result<MaybeBytes, StorageError> {
        Ok(self.read(key.as_str())?.map(Bytes::from))
    }

    fn get_partial_many<'a>(
        &'a self,
        key: &StoreKey,
        byte_ranges: ByteRangeIterator<'a>,
    ) -> Result<MaybeBytesIterator<'a>, StorageError> {
        let Some(size) = self.size_of(key.as_str())? else { return Ok(None) };
        let key = key.clone();
        Ok(Some(Box::new(byte_ranges.map(move |range| {
            let (offset, length) = match range {
                ByteRange::FromStart(o, length) => {
                    (i64::try_from(o).unwrap_or(i64::MAX), length.unwrap_or(size.saturating_sub(o)))
                }
                ByteRange::Suffix(n) => (i64::try_from(n).map_or(i64::MIN, |n| -n), n),
            };
            let gone = || StorageError::Other(format!("{key} vanished while it was read"));
            // A suffix of nothing begins at the end, not at the start.
            let bytes =
                if length == 0 { Some(Vec::new()) } else { self.read_range(key.as_str(), offset, length)? };
            bytes.map(Bytes::from).ok_or_else(gone)
        }))))
    }

    fn size_key(&self, key: &StoreKey) -> Result<Option<u64>, StorageError> {
        Ok(self.size_of(key.as_str())?)
    }

    fn supports_get_partial(&self) -> bool {
        true
    }
}

impl WritableStorageTraits for Directory {
    fn set(&self, key: &StoreKey, value: Bytes) -> Result<(), StorageError> {
        Ok(self.write(key.as_str(), &value)?)
    }

    fn set_partial_many(&self, key: &StoreKey, _: OffsetBytesIterator<'_>) -> Result<(), StorageError> {
        Err(StorageError::Unsupported(format!("{key}: files are written whole here, never in part")))
    }

    fn erase(&self, key: &StoreKey) -> Result<(), StorageError> {
        Ok(self.remove(key.as_str())?)
    }

    fn erase_prefix(&self, prefix: &StorePrefix) -> Result<(), StorageError> {
        self.list_prefix(prefix)?.iter().try_for_each(|key| self.erase(key))
    }

    fn supports_set_partial(&self) -> bool {
        false
    }
}

impl ListableStorageTraits for Directory {
    fn list(&self) -> Result<StoreKeys, StorageError> {
        self.list_prefix(&StorePrefix::root())
    }

    fn list_prefix(&self, prefix: &StorePrefix) -> Result<StoreKeys, StorageError> {
        let mut keys = Vec::new();
        let mut todo = vec![prefix.clone()];
        while let Some(prefix) = todo.pop() {
            let here = self.list_dir(&prefix)?;
            keys.extend_from_slice(here.keys());
            todo.extend_from_slice(here.prefixes());
        }
        keys.sort();
        Ok(keys)
    }

    fn list_dir(&self, prefix: &StorePrefix) -> Result<StoreKeysPrefixes, StorageError> {
        let (mut keys, mut prefixes) = (Vec::new(), Vec::new());
        for (name, is_dir) in entries(&self.root().join(prefix.as_str()))? {
            let path = format!("{}{name}", prefix.as_str());
            if is_dir {
                prefixes.push(StorePrefix::new(path + "/")?);
            } else {
                keys.push(StoreKey::new(path)?);
            }
        }
        Ok(StoreKeysPrefixes::new(keys, prefixes))
    }

    fn size_prefix(&self, prefix: &StorePrefix) -> Result<u64, StorageError> {
        self.list_prefix(prefix)?.iter().try_fold(0, |sum, k| Ok(sum + self.size_key(k)?.unwrap_or(0)))
    }
}

/// Names in `directory` and whether each is a directory, sorted; temp files do not count.
pub(super) fn entries(directory: &Path) -> Result<Vec<(String, bool)>, DurableError> {
    let failed = |e| DurableError::io("list", directory, 0, e);
    let listing = match std::fs::read_dir(directory) {
        Err(e) if super::absent(&e) => return Ok(Vec::new()),
        other => other.map_err(failed)?,
    };
    let mut names = Vec::new();
    for entry in listing {
        let path = entry.map_err(failed)?.path();
        let Some(name) = path.file_name().and_then(|n| n.to_str()) else { continue };
        if !is_temp_name(name) {
            names.push((name.to_owned(), path.is_dir()));
        }
    }
    names.sort();
    Ok(names)
}
