//! Objects below a URL: a prefix of an S3-compatible store, or part of a web server, which is only read.
//!
//! A put makes an object whole or not at all, so there are no temp names and nothing to sweep. There are no directories to
//! rename and no locks: a group counts from the moment when its own `zarr.json` is there, and is written and removed in the
//! order that follows. Nothing depends on listings that are up to date, on conditional puts, or on clocks: what is there is
//! asked for by its key.
//!
//! Requests are tried again, with growing pauses, when the network or the store fails in a way that may pass; what is left
//! after that is [`DurableError::Unreachable`]. Callers are ordinary threads, and wait.

mod connect;
mod environment;
mod fault;
mod runtime;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytes::Bytes;
use futures_util::{StreamExt, TryStreamExt};
use object_store::path::Path as Location;
use object_store::{Error, GetOptions, GetRange, ObjectStore, ObjectStoreExt, PutMode, PutPayload};

use super::DurableError;
use fault::fault;
use runtime::{ask, wait};

/// Objects asked about at once.
const AT_ONCE: usize = 32;

pub use connect::check_url;

/// Whether a path is a URL, `SCHEME://…`.
pub fn is_url(path: &Path) -> bool {
    path.to_str().is_some_and(|p| connect::scheme(p).is_some())
}

/// Objects below a URL. Keys are relative, with `/`.
#[derive(Clone)]
pub struct Objects {
    root: PathBuf,
    prefix: Location,
    store: Arc<dyn ObjectStore>,
    /// A web server: read only, without lists.
    web: bool,
}

impl std::fmt::Debug for Objects {
    /// Not the store, which holds credentials.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Objects({})", self.root.display())
    }
}

/// What the store tells of an object without sending it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ObjectState {
    /// Its bytes.
    pub size: u64,
    /// Its ETag, or else when it was changed: another one, other bytes.
    pub tag: String,
}

impl Objects {
    /// The objects below `url`: `s3://BUCKET/PREFIX`, `http://…` or `https://…`. Nothing is asked for yet.
    ///
    /// # Errors
    /// [`DurableError::Address`] if the URL or the environment do not tell a store.
    pub fn at(url: &Path) -> Result<Self, DurableError> {
        connect::connect(url)
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
    /// [`DurableError::Key`] for a key that would leave the prefix.
    pub fn below(&self, key: &str) -> Result<Self, DurableError> {
        Ok(Self { root: self.root.join(key), prefix: self.location(key)?, ..self.clone() })
    }

    fn fault<'a>(&'a self, doing: &'static str, key: &'a str) -> impl Fn(Error) -> DurableError + 'a {
        move |e| fault(doing, &self.root.join(key), &e)
    }

    fn writable(&self, doing: &'static str, key: &str) -> Result<(), DurableError> {
        if !self.web {
            return Ok(());
        }
        Err(DurableError::Refused {
            doing,
            path: self.root.join(key),
            reason: "web servers are only read".into(),
            way_out: "choose a directory or s3://BUCKET/PREFIX",
        })
    }

    /// Puts `bytes` under `key`, replacing what was there.
    ///
    /// # Errors
    /// [`DurableError`]; the key then holds what it held before, or all of `bytes`.
    pub fn write(&self, key: &str, bytes: Bytes) -> Result<(), DurableError> {
        self.writable("write", key)?;
        let (store, location) = (self.store.clone(), self.location(key)?);
        wait(async move { store.put(&location, bytes.into()).await })
            .map(drop)
            .map_err(self.fault("write", key))
    }

    /// Puts `bytes` under `key` if nothing, or the same, is there; `false` if something else is. A store without conditional
    /// puts is asked first, which leaves a moment for another to come in between.
    ///
    /// # Errors
    /// As [`Objects::write`].
    pub fn write_new(&self, key: &str, bytes: Bytes) -> Result<bool, DurableError> {
        self.writable("write", key)?;
        let (store, location, payload) =
            (self.store.clone(), self.location(key)?, PutPayload::from(bytes.clone()));
        if wait(async move { store.put_opts(&location, payload, PutMode::Create.into()).await }).is_ok() {
            return Ok(true);
        }
        // Something is there, or the store has no such puts, or its answer was lost: such a put is not sent twice. What is wrong
        // otherwise is told by the plain one.
        match self.read_at_most(key, u64::MAX)? {
            Some(there) => Ok(there == bytes),
            None => self.write(key, bytes).map(|()| true),
        }
    }

    /// The bytes of `key`, at most `limit`, or `None` if there is no such object.
    ///
    /// # Errors
    /// [`DurableError::Length`] past the limit; [`DurableError`] if it cannot be read.
    pub fn read_at_most(&self, key: &str, limit: u64) -> Result<Option<Vec<u8>>, DurableError> {
        let (store, location) = (self.store.clone(), self.location(key)?);
        let got = ask(|| {
            let (store, location) = (store.clone(), location.clone());
            async move {
                let found = store.get(&location).await?;
                let size = found.meta.size;
                Ok((size, if size > limit { Bytes::new() } else { found.bytes().await? }))
            }
        });
        let Some((size, bytes)) = absent(got).map_err(self.fault("read", key))? else { return Ok(None) };
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
        let (range, asked) = match u64::try_from(offset) {
            Ok(start) => (GetRange::Bounded(start..start.saturating_add(length)), length),
            Err(_) => (GetRange::Suffix(offset.unsigned_abs()), offset.unsigned_abs().max(length)),
        };
        let options = GetOptions { range: Some(range), ..GetOptions::default() };
        let (store, location) = (self.store.clone(), self.location(key)?);
        let got = ask(|| {
            let (store, location, options) = (store.clone(), location.clone(), options.clone());
            async move { store.get_opts(&location, options).await?.bytes().await }
        });
        match absent(got) {
            Ok(None) => Ok(None),
            Ok(Some(bytes)) if bytes.len() as u64 >= asked => {
                let mut bytes = Vec::from(bytes);
                bytes.truncate(length as usize);
                Ok(Some(bytes))
            }
            short => {
                let Some(size) = self.size_of(key)? else { return Ok(None) };
                let start =
                    if offset < 0 { size.checked_sub(offset.unsigned_abs()) } else { Some(offset as u64) };
                match (start.and_then(|s| s.checked_add(length)), short) {
                    (Some(end), Err(e)) if end <= size => Err(self.fault("read", key)(e)),
                    _ => Err(DurableError::Range { path: self.root.join(key), offset, length, size }),
                }
            }
        }
    }

    /// The size of `key` in bytes, or `None` if there is no such object.
    ///
    /// # Errors
    /// [`DurableError`] if the store does not tell.
    pub fn size_of(&self, key: &str) -> Result<Option<u64>, DurableError> {
        Ok(self.states(&[key.to_owned()])?.pop().flatten().map(|s| s.size))
    }

    /// What the store tells of each of `keys`; `None` for an object that is not there.
    ///
    /// # Errors
    /// As [`Objects::size_of`].
    pub fn states(&self, keys: &[String]) -> Result<Vec<Option<ObjectState>>, DurableError> {
        let locations: Vec<Location> = keys.iter().map(|key| self.location(key)).collect::<Result<_, _>>()?;
        let store = self.store.clone();
        let heads = wait(async move {
            let ask = |at: Location| {
                let store = store.clone();
                async move { absent(store.head(&at).await) }
            };
            // In order, so that of several errors it is always the first that is told.
            futures_util::stream::iter(locations).map(ask).buffered(AT_ONCE).collect::<Vec<_>>().await
        });
        let state = |meta: object_store::ObjectMeta| ObjectState {
            size: meta.size,
            tag: meta.e_tag.unwrap_or_else(|| meta.last_modified.to_rfc3339()),
        };
        std::iter::zip(keys, heads)
            .map(|(key, head)| Ok(head.map_err(self.fault("look up", key))?.map(state)))
            .collect()
    }

    /// Whether anything is there.
    ///
    /// # Errors
    /// [`DurableError`] if the store does not tell.
    pub fn exists(&self) -> Result<bool, DurableError> {
        let metadata = ["zarr.json", ".zgroup", ".zarray"].map(str::to_owned);
        Ok(self.states(&metadata)?.iter().any(Option::is_some) || self.first_key(|_| true)?.is_some())
    }

    /// A key that a list shows and `wanted` accepts.
    ///
    /// # Errors
    /// [`DurableError`] if the store cannot be listed.
    pub fn first_key(
        &self,
        wanted: impl Fn(&str) -> bool + Send + Sync + 'static,
    ) -> Result<Option<String>, DurableError> {
        Ok(self.list(move |key| wanted(key), 1)?.pop())
    }

    /// The first `most` keys that a list shows and `wanted` accepts. Web servers have no lists.
    fn list(
        &self,
        wanted: impl Fn(&str) -> bool + Send + Sync + 'static,
        most: usize,
    ) -> Result<Vec<String>, DurableError> {
        if self.web {
            return Ok(Vec::new());
        }
        let wanted = Arc::new(wanted);
        let found = ask(|| {
            let (store, prefix, wanted) = (self.store.clone(), self.prefix.clone(), wanted.clone());
            async move {
                let below = |at: &Location| {
                    let parts: Vec<_> = at.prefix_match(&prefix)?.collect();
                    let key = parts.iter().map(AsRef::as_ref).collect::<Vec<&str>>().join("/");
                    Some(key).filter(|key| wanted(key))
                };
                let objects = store.list(Some(&prefix));
                let keys = objects.try_filter_map(|meta| std::future::ready(Ok(below(&meta.location))));
                keys.boxed().take(most).try_collect::<Vec<_>>().await
            }
        });
        found.map_err(self.fault("list", ""))
    }

    /// Names of what lies below `key`, sorted. Nothing for web servers, which have no lists.
    ///
    /// # Errors
    /// [`DurableError`] if the store cannot be listed.
    pub fn names(&self, key: &str) -> Result<Vec<String>, DurableError> {
        if self.web {
            return Ok(Vec::new());
        }
        let (store, prefix) = (self.store.clone(), self.location(key)?);
        let found = ask(|| {
            let (store, prefix) = (store.clone(), prefix.clone());
            async move { store.list_with_delimiter(Some(&prefix)).await }
        });
        let found = found.map_err(self.fault("list", key))?;
        let all = found.objects.into_iter().map(|o| o.location).chain(found.common_prefixes);
        let mut names: Vec<String> = all.filter_map(|at| at.filename().map(str::to_owned)).collect();
        names.sort();
        names.dedup();
        Ok(names)
    }

    /// Removes `key`; one that is not there is fine.
    ///
    /// # Errors
    /// [`DurableError`] if it cannot be removed.
    pub fn remove(&self, key: &str) -> Result<(), DurableError> {
        self.remove_many(vec![key.to_owned()])
    }

    fn remove_many(&self, keys: Vec<String>) -> Result<(), DurableError> {
        let Some(first) = keys.first().cloned() else { return Ok(()) };
        self.writable("remove", &first)?;
        let at: Vec<_> = keys.iter().map(|key| self.location(key)).collect::<Result<_, _>>()?;
        let gone = ask(|| {
            let (store, at) = (self.store.clone(), at.clone());
            async move {
                let at = futures_util::stream::iter(at.into_iter().map(Ok)).boxed();
                let removed = store.delete_stream(at).map(absent).map_ok(drop);
                removed.try_collect::<Vec<()>>().await
            }
        });
        gone.map(drop).map_err(self.fault("remove", &first))
    }

    /// Removes all objects that a list shows, and those of `known`, which may be too new for the list. The group's own
    /// metadata goes last: until then it says what this is, and the removal can be taken up again.
    ///
    /// # Errors
    /// [`DurableError`] if they cannot be listed or removed.
    pub fn remove_all(&self, mut known: Vec<String>) -> Result<(), DurableError> {
        known.extend(self.list(|_| true, usize::MAX)?);
        known.retain(|key| key != "zarr.json");
        self.remove_many(known)?;
        self.remove("zarr.json")
    }
}

/// `None` for what is not there, but for a bucket that is not there.
fn absent<T>(got: Result<T, Error>) -> Result<Option<T>, Error> {
    match got {
        Err(Error::NotFound { path, source }) if fault::names_bucket(source.as_ref()) => {
            Err(Error::NotFound { path, source })
        }
        Err(Error::NotFound { .. }) => Ok(None),
        other => other.map(Some),
    }
}

#[cfg(test)]
mod tests;
