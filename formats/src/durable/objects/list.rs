//! Lists and removals of objects.

use std::sync::Arc;

use futures_util::{StreamExt, TryStreamExt};
use object_store::ObjectStore;
use object_store::path::Path as Location;

use super::super::error::DurableError;
use super::request::block_on_with_retry;
use super::{Objects, found};

impl Objects {
    /// A listed key for which `predicate` is true.
    pub fn first_key(
        &self,
        predicate: impl Fn(&str) -> bool + Send + Sync + 'static,
    ) -> Result<Option<String>, DurableError> {
        Ok(self.list(predicate, 1)?.pop())
    }

    /// The first `max_count` listed keys for which `predicate` is true; none for web servers, which have no lists.
    fn list(
        &self,
        predicate: impl Fn(&str) -> bool + Send + Sync + 'static,
        max_count: usize,
    ) -> Result<Vec<String>, DurableError> {
        if self.web {
            return Ok(Vec::new());
        }
        let predicate = Arc::new(predicate);
        let keys = block_on_with_retry(|| {
            let (store, prefix, predicate) = (self.store.clone(), self.prefix.clone(), predicate.clone());
            async move {
                let relative = |at: &Location| {
                    let parts: Vec<_> = at.prefix_match(&prefix)?.collect();
                    let key = parts.iter().map(AsRef::as_ref).collect::<Vec<&str>>().join("/");
                    Some(key).filter(|key| predicate(key))
                };
                let objects = store.list(Some(&prefix));
                let keys = objects.try_filter_map(|meta| std::future::ready(Ok(relative(&meta.location))));
                keys.boxed().take(max_count).try_collect::<Vec<_>>().await
            }
        });
        keys.map_err(self.failed("list", ""))
    }

    /// Names directly below `key`, sorted; none for web servers, which have no lists.
    pub fn names(&self, key: &str) -> Result<Vec<String>, DurableError> {
        if self.web {
            return Ok(Vec::new());
        }
        let (store, prefix) = (self.store.clone(), self.location(key)?);
        let listed = block_on_with_retry(|| {
            let (store, prefix) = (store.clone(), prefix.clone());
            async move { store.list_with_delimiter(Some(&prefix)).await }
        });
        let listed = listed.map_err(self.failed("list", key))?;
        let all = listed.objects.into_iter().map(|o| o.location).chain(listed.common_prefixes);
        let mut names: Vec<String> = all.filter_map(|at| at.filename().map(str::to_owned)).collect();
        names.sort();
        names.dedup();
        Ok(names)
    }

    /// Removes `key`; a missing object is no error.
    pub fn remove(&self, key: &str) -> Result<(), DurableError> {
        self.remove_many(vec![key.to_owned()])
    }

    fn remove_many(&self, keys: Vec<String>) -> Result<(), DurableError> {
        let Some(first) = keys.first().cloned() else { return Ok(()) };
        self.check_writable("remove", &first)?;
        let locations: Vec<_> = keys.iter().map(|key| self.location(key)).collect::<Result<_, _>>()?;
        let removed = block_on_with_retry(|| {
            let (store, locations) = (self.store.clone(), locations.clone());
            async move {
                let locations = futures_util::stream::iter(locations.into_iter().map(Ok)).boxed();
                let removed = store.delete_stream(locations).map(found).map_ok(drop);
                removed.try_collect::<Vec<()>>().await
            }
        });
        removed.map(drop).map_err(self.failed("remove", &first))
    }

    /// Removes all listed objects and those of `unlisted`, which may be too new for the list. The group's own metadata is removed
    /// last: until then the group is recognised, and an interrupted removal can be repeated.
    pub fn remove_all(&self, mut unlisted: Vec<String>) -> Result<(), DurableError> {
        unlisted.extend(self.list(|_| true, usize::MAX)?);
        unlisted.retain(|key| key != "zarr.json");
        self.remove_many(unlisted)?;
        self.remove("zarr.json")
    }
}
