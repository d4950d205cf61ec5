//! Objects below a URL: a prefix of an S3-compatible store, or part of a web server, which is read-only.
//!
//! A put creates an object completely or not at all, so there are no temporary names and nothing to sweep. There are no directories to
//! rename and no locks: a group exists when its own `zarr.json` exists, which is written last and removed last. Nothing depends on
//! up-to-date lists, on conditional puts, or on clocks: objects are looked up by their keys.
//!
//! Requests are repeated, with growing pauses, when the network or the store fails in a way that may pass; an error that remains is
//! [`DurableError::Unreachable`]. Callers are ordinary threads and block.

mod connect;
mod environment;
mod list;
mod request;
mod response;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytes::Bytes;
use futures_util::StreamExt;
use object_store::path::Path as Location;
use object_store::{Error, GetOptions, GetRange, ObjectStore, ObjectStoreExt, PutMode, PutPayload};

use super::error::DurableError;
use super::object_state::ObjectState;
use super::url::{Address, redacted};
use request::{block_on, block_on_with_retry};
use response::durable_error;

/// Metadata requests in flight at a time.
const CONCURRENT_REQUESTS: usize = 32;

/// Objects below a URL. Keys are relative, with `/`.
#[derive(Clone)]
pub struct Objects {
    root: PathBuf,
    prefix: Location,
    store: Arc<dyn ObjectStore>,
    /// A web server: read-only, without lists.
    web: bool,
}

impl std::fmt::Debug for Objects {
    /// Without the client, which has credentials.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Objects({})", self.root.display())
    }
}

impl Objects {
    /// The objects below `url`: `s3://BUCKET/PREFIX`, `http://…` or `https://…`. No object is requested yet.
    ///
    /// # Errors
    /// [`DurableError::Address`] if the URL or the environment is invalid.
    pub fn at(url: &Path) -> Result<Self, DurableError> {
        let text = url.to_string_lossy();
        let invalid = |problem: String| DurableError::Address { path: redacted(&text).into(), problem };
        let address = Address::parse(&text).map_err(invalid)?;
        let web = matches!(address.scheme, "http" | "https");
        let prefix = match web {
            true => Location::from_url_path(address.path),
            false => Location::parse(address.path),
        };
        let prefix = prefix.map_err(|e| invalid(e.to_string()))?;
        let store = connect::client(&address).map_err(invalid)?;
        Ok(Self { root: text.trim_end_matches('/').to_owned().into(), prefix, store, web })
    }

    /// The URL.
    pub fn root(&self) -> &Path {
        &self.root
    }

    fn location(&self, key: &str) -> Result<Location, DurableError> {
        let joined = match self.prefix.as_ref() {
            "" => key.to_owned(),
            prefix if key.is_empty() => prefix.to_owned(),
            prefix => format!("{prefix}/{key}"),
        };
        let outside = |_| DurableError::Key { key: key.into(), root: self.root.clone() };
        Location::parse(joined).map_err(outside)
    }

    /// The objects below `key`.
    ///
    /// # Errors
    /// [`DurableError::Key`] for a key outside the prefix.
    pub fn below(&self, key: &str) -> Result<Self, DurableError> {
        Ok(Self { root: self.root.join(key), prefix: self.location(key)?, ..self.clone() })
    }

    fn failed<'a>(&'a self, doing: &'static str, key: &'a str) -> impl Fn(Error) -> DurableError + 'a {
        move |e| durable_error(doing, &self.root.join(key), &e)
    }

    fn check_writable(&self, doing: &'static str, key: &str) -> Result<(), DurableError> {
        if !self.web {
            return Ok(());
        }
        Err(DurableError::Rejected {
            doing,
            path: self.root.join(key),
            reason: "web servers are read-only".into(),
            way_out: "choose a directory or s3://BUCKET/PREFIX",
        })
    }

    /// Puts `bytes` under `key`, replacing an existing object.
    ///
    /// # Errors
    /// [`DurableError`]; the object is then unchanged, or has all of `bytes`.
    pub fn write(&self, key: &str, bytes: Bytes) -> Result<(), DurableError> {
        self.check_writable("write", key)?;
        let (store, location) = (self.store.clone(), self.location(key)?);
        block_on(async move { store.put(&location, bytes.into()).await })
            .map(drop)
            .map_err(self.failed("write", key))
    }

    /// Puts `bytes` under `key` if there is no object, or one with these bytes; `false` if there is another. Without conditional puts
    /// the object is read first, so another process may put one in between.
    pub fn write_new(&self, key: &str, bytes: Bytes) -> Result<bool, DurableError> {
        self.check_writable("write", key)?;
        let (store, location, payload) =
            (self.store.clone(), self.location(key)?, PutPayload::from(bytes.clone()));
        if block_on(async move { store.put_opts(&location, payload, PutMode::Create.into()).await }).is_ok() {
            return Ok(true);
        }
        // The object exists, or the store has no conditional puts, or the response was lost: the client does not repeat such a put.
        // Any other error is reported by the unconditional put.
        match self.read_at_most(key, u64::MAX)? {
            Some(existing) => Ok(existing == bytes),
            None => self.write(key, bytes).map(|()| true),
        }
    }

    /// The bytes of `key`, at most `limit`, or `None` if there is no such object.
    ///
    /// # Errors
    /// [`DurableError::Length`] above the limit; [`DurableError`] if it cannot be read.
    pub fn read_at_most(&self, key: &str, limit: u64) -> Result<Option<Vec<u8>>, DurableError> {
        let (store, location) = (self.store.clone(), self.location(key)?);
        let got = block_on_with_retry(|| {
            let (store, location) = (store.clone(), location.clone());
            async move {
                let found = store.get(&location).await?;
                let size = found.meta.size;
                Ok((size, if size > limit { Bytes::new() } else { found.bytes().await? }))
            }
        });
        let Some((size, bytes)) = found(got).map_err(self.failed("read", key))? else { return Ok(None) };
        let length = |expected| DurableError::Length { path: self.root.join(key), expected, found: size };
        match bytes.len() as u64 {
            _ if size > limit => Err(length(limit)),
            n if n != size => Err(length(n)),
            _ => Ok(Some(bytes.into())),
        }
    }

    /// `length` bytes of `key` from `offset`, or `None` if there is no such object. A negative offset counts from the end.
    ///
    /// # Errors
    /// [`DurableError::Range`] if the object is too short; [`DurableError`] if it cannot be read.
    pub fn read_range(&self, key: &str, offset: i64, length: u64) -> Result<Option<Vec<u8>>, DurableError> {
        let (range, expected) = match u64::try_from(offset) {
            Ok(start) => (GetRange::Bounded(start..start.saturating_add(length)), length),
            Err(_) => (GetRange::Suffix(offset.unsigned_abs()), offset.unsigned_abs().max(length)),
        };
        let options = GetOptions { range: Some(range), ..GetOptions::default() };
        let (store, location) = (self.store.clone(), self.location(key)?);
        let got = block_on_with_retry(|| {
            let (store, location, options) = (store.clone(), location.clone(), options.clone());
            async move { store.get_opts(&location, options).await?.bytes().await }
        });
        match found(got) {
            Ok(None) => Ok(None),
            Ok(Some(bytes)) if bytes.len() as u64 >= expected => {
                let mut bytes = Vec::from(bytes);
                bytes.truncate(length as usize);
                Ok(Some(bytes))
            }
            short => {
                let Some(size) = self.size_of(key)? else { return Ok(None) };
                let start =
                    if offset < 0 { size.checked_sub(offset.unsigned_abs()) } else { Some(offset as u64) };
                match (start.and_then(|s| s.checked_add(length)), short) {
                    (Some(end), Err(e)) if end <= size => Err(self.failed("read", key)(e)),
                    _ => Err(DurableError::Range { path: self.root.join(key), offset, length, size }),
                }
            }
        }
    }

    /// The size of `key` in bytes, or `None` if there is no such object.
    pub fn size_of(&self, key: &str) -> Result<Option<u64>, DurableError> {
        Ok(self.states(&[key.to_owned()])?.pop().flatten().map(|s| s.size))
    }

    /// Metadata of each of `keys`; `None` for a missing object.
    pub fn states(&self, keys: &[String]) -> Result<Vec<Option<ObjectState>>, DurableError> {
        let locations: Vec<Location> = keys.iter().map(|key| self.location(key)).collect::<Result<_, _>>()?;
        let store = self.store.clone();
        let heads = block_on(async move {
            let head = |at: Location| {
                let store = store.clone();
                async move { found(store.head(&at).await) }
            };
            // In order, so that of several errors always the first is reported.
            let requests = futures_util::stream::iter(locations).map(head).buffered(CONCURRENT_REQUESTS);
            requests.collect::<Vec<_>>().await
        });
        let state = |meta: object_store::ObjectMeta| ObjectState {
            size: meta.size,
            tag: meta.e_tag.unwrap_or_else(|| meta.last_modified.to_rfc3339()),
        };
        std::iter::zip(keys, heads)
            .map(|(key, head)| Ok(head.map_err(self.failed("look up", key))?.map(state)))
            .collect()
    }

    /// Whether there is any object below the URL.
    pub fn exists(&self) -> Result<bool, DurableError> {
        let metadata = ["zarr.json", ".zgroup", ".zarray"].map(str::to_owned);
        Ok(self.states(&metadata)?.iter().any(Option::is_some) || self.first_key(|_| true)?.is_some())
    }
}

/// `None` for a missing object; a missing bucket is an error.
fn found<T>(got: Result<T, Error>) -> Result<Option<T>, Error> {
    match got {
        Err(Error::NotFound { path, source }) if response::is_missing_bucket(source.as_ref()) => {
            Err(Error::NotFound { path, source })
        }
        Err(Error::NotFound { .. }) => Ok(None),
        other => other.map(Some),
    }
}

#[cfg(test)]
mod tests;
