//! What a pack has of a band besides its tables.

use pipeline::design::pupil_stack::PupilStack;
use pipeline::lens::PsfStack;

/// PSFs, or the pupil functions that give them.
pub(super) enum Stored {
    Psfs(PsfStack),
    Pupils(PupilStack),
}
