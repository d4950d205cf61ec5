//! Durable, atomic storage: a file, or an object of an S3-compatible store, is absent or complete, also after `kill -9` or a power failure.
//!
//! Sequence of a write: unique temporary name in the same directory, write, check of the length, fsync, rename, fsync of the directory.
//! A reader, or a resumed job, finds the old bytes or the new ones. Each new directory is flushed in its parent. [`sweep`](sweep())
//! removes the temporary files of ended processes.
//!
//! Every fallible operation returns [`DurableError`]; sections "Errors" list only variants and guarantees beyond that.
//!
//! No lock is required for that: of two writers of one key the last rename wins, and all writers of one job write the same bytes.
//! A [`Lock`] only prevents two runs from doing the same work twice.
//!
//! | module | contents |
//! |---|---|
//! | `store` | [`Store`]: one interface to directories and objects |
//! | `directory`, `handle` | [`Directory`]: keys of a directory, by system calls relative to an open directory; [`Batch`]: files of it that are committed together |
//! | `objects` | [`Objects`]: keys below a URL; `no_objects` in a build without the feature `s3` |
//! | `atomic_file`, `file_group`, `rename` | replacement of one file, of files that belong together, of a directory |
//! | `hashed_file` | [`HashedFile`]: an open file and the digest of its bytes |
//! | `temp`, `sweep`, `process` | temporary names, their removal, identity of the process that made them |
//! | `lock`, `removal` | lock files; removal of a store without files of others |
//! | `error`, `step`, `fault` | errors; steps of an operation; errors injected by tests |

mod atomic_file;
mod direct;
mod directory;
mod error;
mod fault;
mod file_group;
mod file_state;
mod file_system;
mod file_writer;
mod handle;
mod hashed_file;
mod lock;
mod object_state;
#[cfg(feature = "s3")]
mod objects;
#[cfg(not(feature = "s3"))]
#[path = "durable/no_objects.rs"]
mod objects;
mod process;
mod removal;
mod rename;
mod step;
mod store;
mod sweep;
mod temp;
mod url;
mod zarr;

pub use atomic_file::{AtomicFile, unnamed_temp_file};
pub use direct::FileBytes;
pub use directory::{Batch, Directory};
pub use error::{DurableError, passes};
pub(crate) use error::{is_not_found, store_error};
pub use fault::{point as fault_point, signal_handled as fault_signal_handled};
pub use file_group::finish_together;
pub(crate) use file_state::FileState;
pub use file_system::{
    check_writable, create_directories, evict, free_bytes, link_target, parent_of, read_file_at_most,
};
pub use file_writer::FileWriter;
pub use hashed_file::HashedFile;
pub use lock::{Lock, LockError, LockOwner, locks};
pub use object_state::ObjectState;
pub use objects::Objects;
pub use process::ProcessIdentity;
pub use removal::Removal;
pub use rename::{publish, replace_directory};
#[cfg(test)]
pub(crate) use step::FileStep;
pub use store::Store;
pub use sweep::{Sweep, sweep, sweep_entries, temp_files};
pub use temp::{is_temp_name, remove_temp, temp_name};
pub use url::{check_url, is_url};
