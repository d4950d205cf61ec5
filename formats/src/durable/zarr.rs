//! [`Store`] as readable storage of the zarrs library.

use zarrs::storage::byte_range::{ByteRange, ByteRangeIterator};
use zarrs::storage::{Bytes, MaybeBytes, MaybeBytesIterator, ReadableStorageTraits, StorageError, StoreKey};

use super::error::DurableError;
use super::store::Store;

impl From<DurableError> for StorageError {
    fn from(e: DurableError) -> Self {
        std::io::Error::from(e).into()
    }
}

impl ReadableStorageTraits for Store {
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
            let missing = || StorageError::Other(format!("{key} was removed while it was read"));
            // Without this, a suffix of 0 bytes would be read from offset -0, the start.
            let bytes =
                if length == 0 { Some(Vec::new()) } else { self.read_range(key.as_str(), offset, length)? };
            bytes.map(Bytes::from).ok_or_else(missing)
        }))))
    }

    fn size_key(&self, key: &StoreKey) -> Result<Option<u64>, StorageError> {
        Ok(self.size_of(key.as_str())?)
    }

    fn supports_get_partial(&self) -> bool {
        true
    }
}
