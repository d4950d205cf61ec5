//! Truncated and changed meshes: a scene or an error, never a panic, never more memory than allowed.
#![cfg(feature = "mesh")]
#![allow(unsafe_code, reason = "an allocator that counts")]

mod gltf;
mod text;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

thread_local! {
    /// Bytes allocated by this thread, and their maximum.
    static BYTES: Cell<(isize, isize)> = const { Cell::new((0, 0)) };
}

struct Counting;

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn count(bytes: isize) {
    let _ = BYTES.try_with(|counted| {
        let (now, peak) = counted.get();
        counted.set((now + bytes, peak.max(now + bytes)));
    });
}

// SAFETY: all is done by the system's allocator; counting does not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: the caller's contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: the caller's contract.
        unsafe { System.dealloc(at, layout) }
    }
}

/// Runs `work`: its result, and the most bytes that this thread had allocated meanwhile beyond those before.
fn peak_of<T>(work: impl FnOnce() -> T) -> (T, isize) {
    let before = BYTES.get().0;
    BYTES.set((before, before));
    let result = work();
    (result, BYTES.get().1 - before)
}

/// In memory where that is possible: thousands of files are written.
fn folder() -> tempfile::TempDir {
    tempfile::tempdir_in("/dev/shm").or_else(|_| tempfile::tempdir()).unwrap()
}
