//! Reading ahead of a chart that is larger than the page cache can keep: threads read encoded chunks with `O_DIRECT` into buffers.
//!
//! The kernel's read-ahead fills the page cache, from which each chunk is copied once and never read again; allocation and copy cost more
//! than decoding. Here the disk writes into the buffer that is decoded. At most [`ReadAhead::bytes`] are held.

use std::collections::HashMap;
use std::sync::{Arc, Condvar, Mutex, MutexGuard};
use std::thread::JoinHandle;

use crossbeam::channel::{Receiver, Sender, unbounded};

use crate::durable::{DurableError, FileBytes, Store};

/// Reading threads: enough for a disk to overlap requests; they wait most of the time.
const READERS: usize = 4;

/// Where a chunk is stored.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// Key of its file.
    pub(super) key: String,
    pub(super) offset: u64,
    pub(super) length: u64,
}

type Read = Result<Option<FileBytes>, DurableError>;

#[derive(Debug)]
enum Entry {
    /// Requested; no thread has begun.
    Waiting(Place),
    Reading,
    Done(Box<Read>),
}

#[derive(Debug, Default)]
struct State {
    /// By chunk number, with the bytes held and the number of the request.
    entries: HashMap<u64, (Entry, u64, u64)>,
    bytes: u64,
    /// Requests so far, with those that were refused.
    requests: u64,
}

#[derive(Debug)]
struct Shared {
    state: Mutex<State>,
    /// An entry became [`Entry::Done`].
    done: Condvar,
    store: Arc<Store>,
}

/// Chunks read ahead, and the threads that read them.
#[derive(Debug)]
pub(super) struct ReadAhead {
    shared: Arc<Shared>,
    requests: Option<Sender<u64>>,
    readers: Vec<JoinHandle<()>>,
    limit: u64,
}

impl ReadAhead {
    /// For chunks of `store`, at most `limit` encoded bytes at a time.
    pub(super) fn new(store: Arc<Store>, limit: u64) -> Self {
        let shared = Arc::new(Shared { state: Mutex::default(), done: Condvar::new(), store });
        let (sender, receiver) = unbounded();
        let reader = |_| {
            let (shared, receiver): (_, Receiver<u64>) = (shared.clone(), receiver.clone());
            std::thread::spawn(move || receiver.iter().for_each(|chunk| shared.read(chunk)))
        };
        let readers = (0..READERS).map(reader).collect();
        Self { shared, requests: Some(sender), readers, limit }
    }

    /// Limit of the encoded bytes held.
    pub(super) fn bytes(&self) -> u64 {
        self.limit
    }

    /// Requests `chunk`, which is stored at `place`. Nothing happens if it was requested already, or the limit is reached.
    pub(super) fn request(&self, chunk: u64, place: Place) {
        let mut guard = self.shared.lock();
        let state = &mut *guard;
        if state.entries.contains_key(&chunk) {
            return;
        }
        state.requests += 1;
        if !state.make_room(place.length, self.limit) {
            return;
        }
        state.bytes += place.length;
        let (length, request) = (place.length, state.requests);
        state.entries.insert(chunk, (Entry::Waiting(place), length, request));
        drop(guard);
        // The readers end only when this sender is dropped.
        let _ = self.requests.as_ref().map(|sender| sender.send(chunk));
    }

    /// The bytes of `chunk`, waiting while it is being read; `None` if it was not requested, or no thread has begun with it: the caller
    /// then reads it itself.
    pub(super) fn take(&self, chunk: u64) -> Option<Read> {
        let mut state = self.shared.lock();
        while let Some((Entry::Reading, ..)) = state.entries.get(&chunk) {
            state = self.shared.done.wait(state).expect("no panic while the read-ahead is locked");
        }
        match state.remove(chunk)? {
            Entry::Done(read) => Some(*read),
            Entry::Waiting(_) | Entry::Reading => None,
        }
    }
}

impl Drop for ReadAhead {
    fn drop(&mut self) {
        self.requests = None;
        self.shared.lock().entries.retain(|_, (entry, ..)| matches!(entry, Entry::Reading));
        for reader in self.readers.drain(..) {
            let _ = reader.join();
        }
    }
}

impl State {
    /// Drops chunks that were read and not taken, oldest first, until `length` more bytes fit below `limit`. A chunk is dropped only after
    /// as many other requests as are held: a hint that was wrong.
    fn make_room(&mut self, length: u64, limit: u64) -> bool {
        while self.bytes + length > limit {
            let held = self.entries.len() as u64;
            let is_old = |(_, (entry, _, request)): &(&u64, &(Entry, u64, u64))| {
                matches!(entry, Entry::Done(_)) && request + held < self.requests
            };
            let oldest = self.entries.iter().filter(is_old).min_by_key(|(_, (_, _, request))| *request);
            let Some((&chunk, _)) = oldest else { return false };
            self.remove(chunk);
        }
        true
    }

    fn remove(&mut self, chunk: u64) -> Option<Entry> {
        let (entry, length, _) = self.entries.remove(&chunk)?;
        self.bytes -= length;
        Some(entry)
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("no panic while the read-ahead is locked")
    }

    /// Reads `chunk` if it is still waiting.
    fn read(&self, chunk: u64) {
        let mut state = self.lock();
        let place = match state.entries.get_mut(&chunk) {
            Some((entry @ Entry::Waiting(_), ..)) => match std::mem::replace(entry, Entry::Reading) {
                Entry::Waiting(place) => place,
                _ => unreachable!("it is waiting"),
            },
            _ => return,
        };
        drop(state);
        let read = self.store.read_direct(&place.key, place.offset, place.length);
        if let Some((entry, ..)) = self.lock().entries.get_mut(&chunk) {
            *entry = Entry::Done(Box::new(read));
        }
        self.done.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn store(bytes: &[u8]) -> (tempfile::TempDir, Arc<Store>) {
        let directory = tempfile::tempdir().unwrap();
        std::fs::write(directory.path().join("data"), bytes).unwrap();
        let store = Arc::new(Store::at(directory.path()).unwrap());
        (directory, store)
    }

    fn place(chunk: u64) -> Place {
        Place { key: "data".into(), offset: chunk * 5000, length: 5000 }
    }

    #[test]
    fn chunks_that_are_taken_are_those_of_the_file() {
        let bytes: Vec<u8> = (0..50_000u32).map(|i| (i * 7 % 251) as u8).collect();
        let (_directory, store) = store(&bytes);
        let ahead = ReadAhead::new(store, 20_000);
        for chunk in 0..10 {
            ahead.request(chunk, place(chunk));
            ahead.request(chunk, place(chunk));
            if let Some(read) = ahead.take(chunk) {
                let at = chunk as usize * 5000;
                assert!(read.unwrap().unwrap()[..] == bytes[at..at + 5000], "{chunk}");
            }
            assert!(ahead.take(chunk).is_none());
        }
        assert_eq!(ahead.shared.lock().bytes, 0);
    }

    #[test]
    fn limit_holds_and_chunks_that_nobody_takes_give_way() {
        let (_directory, store) = store(&[1; 1_000_000]);
        let ahead = ReadAhead::new(store, 20_000);
        for chunk in 0..100 {
            ahead.request(chunk, place(chunk));
            let state = || ahead.shared.lock();
            assert!(state().bytes <= 20_000 && state().entries.len() <= 4);
            while state().entries.values().any(|e| !matches!(e.0, Entry::Done(_))) {
                std::thread::yield_now();
            }
        }
        let mut held: Vec<u64> = ahead.shared.lock().entries.keys().copied().collect();
        held.sort_unstable();
        assert!(held.len() == 4 && held[0] > 80, "{held:?}");
    }

    #[test]
    fn errors_reach_the_one_who_takes() {
        let (_directory, store) = store(&[1; 100]);
        let ahead = ReadAhead::new(store, 20_000);
        ahead.request(1, place(1));
        if let Some(read) = ahead.take(1) {
            assert!(matches!(read, Err(DurableError::Range { .. })), "{read:?}");
        }
        ahead.request(2, Place { key: "nothing".into(), ..place(0) });
        if let Some(read) = ahead.take(2) {
            assert!(matches!(read, Ok(None)), "{read:?}");
        }
    }
}
