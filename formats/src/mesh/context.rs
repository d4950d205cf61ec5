//! What the parts of a reader share: the file's name for messages, limits, memory in use, files read, notes.

use std::cell::{Cell, RefCell};
use std::collections::HashSet;
use std::path::Path;

use super::error::MeshError;
use super::limits::Limits;
use super::source::SourceFile;

/// Of one call of a reader.
pub(super) struct Context<'a> {
    /// The mesh.
    pub(super) path: &'a Path,
    pub(super) limits: &'a Limits,
    used_bytes: Cell<u64>,
    pub(super) sources: RefCell<Vec<SourceFile>>,
    notes: RefCell<Vec<String>>,
    /// Those of `notes`.
    noted: RefCell<HashSet<String>>,
}

impl<'a> Context<'a> {
    pub(super) fn new(path: &'a Path, limits: &'a Limits) -> Self {
        Self {
            path,
            limits,
            used_bytes: Cell::new(0),
            sources: RefCell::default(),
            notes: RefCell::default(),
            noted: RefCell::default(),
        }
    }

    /// Counts `bytes` about to be allocated for `place`.
    ///
    /// # Errors
    /// More than the limit of all together.
    pub(super) fn charge(&self, bytes: u64, place: impl FnOnce() -> String) -> Result<(), MeshError> {
        let (needed, allowed) = (self.used_bytes.get().saturating_add(bytes), self.limits.max_total_bytes);
        if needed > allowed {
            return Err(MeshError::Memory { path: self.path.into(), place: place(), needed, allowed });
        }
        self.used_bytes.set(needed);
        Ok(())
    }

    /// Counts `bytes` that have been freed.
    pub(super) fn release(&self, bytes: u64) {
        self.used_bytes.set(self.used_bytes.get().saturating_sub(bytes));
    }

    /// Checks the size of one decoded object.
    ///
    /// # Errors
    /// More than the limit of one.
    pub(super) fn check_single(&self, needed: u64, place: &str) -> Result<(), MeshError> {
        let allowed = self.limits.max_bytes;
        match needed <= allowed {
            true => Ok(()),
            false => Err(MeshError::Memory { path: self.path.into(), place: place.into(), needed, allowed }),
        }
    }

    /// Content that the format does not allow.
    pub(super) fn invalid(
        &self,
        place: impl Into<String>,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> MeshError {
        let (place, expected, found) = (place.into(), expected.into(), found.into());
        MeshError::Invalid { path: self.path.into(), place, expected, found }
    }

    /// Adds a sentence without a full stop, once.
    pub(super) fn note(&self, note: impl Into<String>) {
        let note = note.into();
        if self.noted.borrow_mut().insert(note.clone()) {
            self.notes.borrow_mut().push(note);
        }
    }

    /// The notes so far.
    pub(super) fn take_notes(&self) -> Vec<String> {
        self.notes.take()
    }
}
