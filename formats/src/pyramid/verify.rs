//! Verification of a pyramid: its metadata, its shards, and how the film or raw lists it.

use serde_json::Value;

use super::Pyramid;
use crate::group::{Finding, GroupError, OME, PYRAMID_GROUP, metadata_key, read_json};
use crate::hierarchy::pretty;

/// Where the stamp of the present pixels is recorded.
struct Stamped {
    stamp: String,
    /// Whether `pyramid/zarr.json` exists.
    exists: bool,
    /// Whether it is that of the present pixels.
    in_file: bool,
    /// Whether the listed one is that of the present pixels.
    in_list: bool,
}

impl Pyramid<'_> {
    /// `None` if there is no pyramid.
    fn stamped(&self) -> Result<Option<Stamped>, GroupError> {
        let store = &self.group().store;
        let group = read_json(store, "zarr.json")?.unwrap_or_default();
        let file = read_json(store, &metadata_key(PYRAMID_GROUP))?;
        let copy = group["consolidated_metadata"]["metadata"].get(PYRAMID_GROUP);
        let is_listed = copy.is_some() || group["attributes"].get(OME).is_some();
        if file.is_none() && !is_listed {
            return Ok(None);
        }
        let stamp = self.stamp()?;
        let expected = self.pyramid_group(&stamp);
        let (in_file, in_list) = (file.as_ref() == Some(&expected), copy == Some(&expected));
        Ok(Some(Stamped { stamp, exists: file.is_some(), in_file, in_list }))
    }

    /// Checks metadata and shards of the pyramid, if there is one; returns the bytes read and the defects. What follows from pixels is compared only with
    /// those of intact arrays (`is_intact`): the smallest level may be the film itself.
    pub(crate) fn check(&self, threads: usize, is_intact: bool) -> Result<(u64, Vec<Finding>), GroupError> {
        let finding = |key: &str, reason: String| Finding::Metadata { key: key.into(), reason };
        let Some(stamped) = self.stamped()? else { return Ok((0, Vec::new())) };
        let group_key = metadata_key(PYRAMID_GROUP);
        if !stamped.in_file && !stamped.in_list {
            let reason = match stamped.exists {
                true => {
                    "the pyramid was made of pixels that have changed since; run `lenscube pyramid` again"
                }
                false => "no such file; run `lenscube pyramid` again",
            };
            return Ok((0, vec![finding(&group_key, reason.into())]));
        }
        let mut findings = Vec::new();
        if !stamped.in_file {
            findings.push(finding(&group_key, "it is missing or differs from its copy in zarr.json".into()));
        }
        for (path, metadata) in self.metadata() {
            findings.extend(self.group().check_json(&metadata_key(&path), &metadata)?);
        }
        let (bytes, of_shards) = self.group().check_files(&self.shard_files(), threads, &|_, _| ())?;
        findings.extend(of_shards);
        // The attribute `ome` depends on pixels.
        if findings.is_empty() && is_intact {
            let group = read_json(&self.group().store, "zarr.json")?.unwrap_or_default();
            if self.listed(group.clone(), &stamped.stamp)? != group {
                let reason = "it does not list the pyramid as it is; --repair corrects it";
                findings.push(finding("zarr.json", reason.into()));
            }
        }
        Ok((bytes, findings))
    }

    /// Writes the metadata file `key` again if the pyramid determines it; whether it does. A pyramid of other pixels determines none.
    pub(crate) fn restore(&self, key: &str) -> Result<bool, GroupError> {
        let Some(stamped) = self.stamped()?.filter(|s| s.in_file || s.in_list) else { return Ok(false) };
        let write = |metadata: &Value| self.group().commit(key, pretty(metadata).into()).map(|()| true);
        if key == metadata_key(PYRAMID_GROUP) {
            return write(&self.pyramid_group(&stamped.stamp));
        }
        if key == "zarr.json" {
            let keys: Vec<String> = self.shard_files().into_iter().map(|file| file.key).collect();
            let is_complete = self.group().store.sizes_of(&keys)?.iter().all(Option::is_some);
            return if is_complete { self.list(&stamped.stamp).map(|()| true) } else { Ok(false) };
        }
        match self.metadata().iter().find(|(path, _)| metadata_key(path) == key) {
            Some((_, metadata)) => write(metadata),
            None => Ok(false),
        }
    }
}
