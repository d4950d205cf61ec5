//! Lists beyond memory: in a scratch file, mapped.
//!
//! A list goes to the file if with it the lists in memory would exceed half of what the command may use. Its pages are the system's, which writes and reads them
//! as it needs memory. Those that are mapped count as memory of the process all the same: while the file is in use, a thread
//! gives the pages of all lists back whenever the process exceeds 7/8 of the limit. They stay in the file, and are mapped again by the next access.
//! Values do not depend on where a list is. The file has no name, so that nothing of it remains however the process ends; its blocks are
//! reserved before they are mapped, so that a full disk is an error and not a signal. Where the process's memory cannot be read (not Linux), pages are left to the system.
#![allow(unsafe_code, reason = "memory mapping")]

use bytemuck::Pod;
use memmap2::{MmapOptions, MmapRaw, UncheckedAdvice};
use std::fs::File;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex, Weak};
use std::time::Duration;

/// Lists of fewer bytes stay in memory.
const MIN_BYTES: u64 = 1 << 16;
/// Places of lists in the file are multiples of it: of a page of any system.
const ALIGNMENT: u64 = 1 << 16;
/// Period at which the process's memory is read.
const PERIOD: Duration = Duration::from_millis(5);

/// Where lists are allocated.
#[derive(Clone, Debug, Default)]
pub struct Scratch(Option<Arc<Shared>>);

#[derive(Debug)]
struct Shared {
    folder: PathBuf,
    memory_bytes: u64,
    /// Of lists in memory.
    in_memory: AtomicU64,
    file: Mutex<Option<Opened>>,
}

#[derive(Debug)]
struct Opened {
    file: File,
    bytes: u64,
    /// Those of all lists, and of some that no longer exist.
    maps: Vec<Weak<MmapRaw>>,
}

/// The scratch file cannot be created or grow.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ScratchError {
    /// Its folder.
    pub folder: PathBuf,
    /// Bytes that it was to have.
    pub bytes: u64,
    /// The system's error.
    pub kind: ErrorKind,
    message: String,
}

impl std::fmt::Display for ScratchError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { folder, bytes, message, .. } = self;
        write!(
            f,
            "a scratch file of {bytes} bytes, for what does not fit into memory, cannot be made in {}: {message}; free some space, or give more with --memory",
            folder.display()
        )
    }
}

impl std::error::Error for ScratchError {}

impl Scratch {
    /// Lists in a file in `folder`, beyond half of `memory_bytes`, the limit of the process. The default has all lists in memory.
    pub fn new(folder: &Path, memory_bytes: u64) -> Self {
        let (folder, in_memory, file) = (folder.into(), AtomicU64::new(0), Mutex::default());
        Self(Some(Arc::new(Shared { folder, memory_bytes, in_memory, file })))
    }

    /// Whether a list of `bytes` would be in the file.
    pub fn takes(&self, bytes: u64) -> bool {
        self.0.as_ref().is_some_and(|shared| {
            bytes >= MIN_BYTES
                && shared.in_memory.load(Relaxed).saturating_add(bytes) > shared.memory_bytes / 2
        })
    }

    /// Bytes of the file so far.
    pub fn file_bytes(&self) -> u64 {
        let Some(shared) = &self.0 else { return 0 };
        shared.file.lock().expect("no panic while held").as_ref().map_or(0, |opened| opened.bytes)
    }

    /// An empty list for `capacity` values.
    ///
    /// # Errors
    /// [`ScratchError`].
    pub fn list<T: Pod>(&self, capacity: usize) -> Result<List<T>, ScratchError> {
        let bytes = capacity.saturating_mul(size_of::<T>()) as u64;
        match &self.0 {
            Some(shared) if self.takes(bytes) => {
                let map = shared.map(bytes)?;
                Ok(List(Memory::Mapped { map, length: 0, capacity, of: std::marker::PhantomData }))
            }
            shared => {
                let counted = shared.as_ref().map(|shared| Counted::new(shared, bytes));
                Ok(List(Memory::Heap(Vec::with_capacity(capacity), counted)))
            }
        }
    }

    /// `length` zeros.
    ///
    /// # Errors
    /// [`ScratchError`].
    pub fn zeros<T: Pod>(&self, length: usize) -> Result<List<T>, ScratchError> {
        if !self.takes(length.saturating_mul(size_of::<T>()) as u64) {
            return self.keep(vec![T::zeroed(); length]);
        }
        let mut list = self.list(length)?;
        // New blocks of a file are zeros.
        if let Memory::Mapped { length: of, .. } = &mut list.0 {
            *of = length;
        }
        Ok(list)
    }

    /// The values of `vec`, which are copied where the list is in the file.
    ///
    /// # Errors
    /// [`ScratchError`].
    pub fn keep<T: Pod>(&self, vec: Vec<T>) -> Result<List<T>, ScratchError> {
        let bytes = (vec.capacity() * size_of::<T>()) as u64;
        match &self.0 {
            Some(shared) if !self.takes(bytes) => {
                Ok(List(Memory::Heap(vec, Some(Counted::new(shared, bytes)))))
            }
            None => Ok(List(Memory::Heap(vec, None))),
            Some(_) => {
                let mut list = self.list(vec.len())?;
                list.extend(vec);
                Ok(list)
            }
        }
    }
}

impl Shared {
    /// `bytes` at the end of the file, mapped.
    fn map(self: &Arc<Self>, bytes: u64) -> Result<Arc<MmapRaw>, ScratchError> {
        let mut file = self.file.lock().expect("no panic while held");
        let before = file.as_ref().map_or(0, |opened| opened.bytes);
        let after = before.saturating_add(bytes).next_multiple_of(ALIGNMENT);
        let failed = |e: std::io::Error| ScratchError {
            folder: self.folder.clone(),
            bytes: after,
            kind: e.kind(),
            message: e.to_string(),
        };
        if file.is_none() {
            let created = unnamed(&self.folder).map_err(failed)?;
            *file = Some(Opened { file: created, bytes: 0, maps: Vec::new() });
            let shared = Arc::downgrade(self);
            std::thread::Builder::new()
                .name("scratch".into())
                .spawn(move || watch(&shared))
                .map_err(failed)?;
        }
        let opened = file.as_mut().expect("assigned above");
        reserve(&opened.file, before, after - before).map_err(failed)?;
        let length = usize::try_from(bytes).map_err(|_| failed(ErrorKind::OutOfMemory.into()))?;
        let map = MmapOptions::new().offset(before).len(length).map_raw(&opened.file).map_err(failed)?;
        let map = Arc::new(map);
        opened.bytes = after;
        opened.maps.retain(|map| map.strong_count() > 0);
        opened.maps.push(Arc::downgrade(&map));
        Ok(map)
    }

    /// Gives the pages of all lists back to the system.
    fn release(&self) {
        let file = self.file.lock().expect("no panic while held");
        let maps = file.iter().flat_map(|opened| &opened.maps);
        for map in maps.filter_map(Weak::upgrade) {
            // SAFETY: the mapping is shared and backed by a file: its pages, written or not, remain those of the file, from which the next
            // access maps them again.
            let _ = unsafe { map.unchecked_advise(UncheckedAdvice::DontNeed) };
        }
    }
}

/// Releases pages whenever the process has too many, as long as the lists exist.
fn watch(shared: &Weak<Shared>) {
    while let Some(shared) = shared.upgrade() {
        let limit = shared.memory_bytes - shared.memory_bytes / 8;
        let is_above = || resident_bytes().map(|resident| resident > limit);
        let mut pause = PERIOD;
        match is_above() {
            None => return,
            Some(false) => {}
            Some(true) => {
                shared.release();
                // Where the lists in memory alone exceed the limit, pages would only be mapped again.
                if is_above() == Some(true) {
                    pause *= 20;
                }
            }
        }
        drop(shared);
        std::thread::sleep(pause);
    }
}

/// Memory of the process.
fn resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib << 10)
}

/// A new file in `folder` without a name.
fn unnamed(folder: &Path) -> std::io::Result<File> {
    let mut number = 0;
    loop {
        let path = folder.join(format!(".lenscube-scratch-{}-{number}.tmp", std::process::id()));
        match File::options().read(true).write(true).create_new(true).open(&path) {
            // Of another process of this number, on another machine or killed.
            Err(e) if e.kind() == ErrorKind::AlreadyExists => number += 1,
            file => {
                let file = file?;
                std::fs::remove_file(&path)?;
                return Ok(file);
            }
        }
    }
}

/// Allocates blocks of a file.
fn reserve(file: &File, start: u64, bytes: u64) -> std::io::Result<()> {
    #[cfg(target_os = "linux")]
    match rustix::fs::fallocate(file, rustix::fs::FallocateFlags::empty(), start, bytes) {
        // A file system without it.
        Err(rustix::io::Errno::OPNOTSUPP) => (),
        other => return other.map_err(Into::into),
    }
    let mut file = file;
    std::io::Seek::seek(&mut file, std::io::SeekFrom::Start(start))?;
    std::io::copy(&mut std::io::Read::take(std::io::repeat(0), bytes), &mut file)?;
    Ok(())
}

/// Bytes of a list in memory, counted while it exists.
#[derive(Debug)]
struct Counted {
    shared: Arc<Shared>,
    bytes: u64,
}

impl Counted {
    fn new(shared: &Arc<Shared>, bytes: u64) -> Self {
        shared.in_memory.fetch_add(bytes, Relaxed);
        Self { shared: Arc::clone(shared), bytes }
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.shared.in_memory.fetch_sub(self.bytes, Relaxed);
    }
}

/// Values one after another, of a capacity that is known when the list is made.
#[derive(Debug)]
pub struct List<T>(Memory<T>);

#[derive(Debug)]
enum Memory<T> {
    Heap(Vec<T>, #[expect(dead_code, reason = "counts until it is dropped")] Option<Counted>),
    Mapped { map: Arc<MmapRaw>, length: usize, capacity: usize, of: std::marker::PhantomData<T> },
}

impl<T> Default for List<T> {
    fn default() -> Self {
        Vec::new().into()
    }
}

impl<T> From<Vec<T>> for List<T> {
    fn from(values: Vec<T>) -> Self {
        Self(Memory::Heap(values, None))
    }
}

impl<T: Pod> FromIterator<T> for List<T> {
    fn from_iter<I: IntoIterator<Item = T>>(values: I) -> Self {
        values.into_iter().collect::<Vec<T>>().into()
    }
}

impl<T: Pod> List<T> {
    /// Number of values that it can hold.
    pub fn capacity(&self) -> usize {
        match &self.0 {
            Memory::Heap(values, _) => values.capacity(),
            Memory::Mapped { capacity, .. } => *capacity,
        }
    }

    /// Bytes in memory: none of a list in the scratch file.
    pub fn memory_bytes(&self) -> usize {
        match &self.0 {
            Memory::Heap(values, _) => values.capacity() * size_of::<T>(),
            Memory::Mapped { .. } => 0,
        }
    }

    /// Adds a value.
    ///
    /// # Panics
    /// A list in the file is full.
    #[inline]
    pub fn push(&mut self, value: T) {
        match &mut self.0 {
            Memory::Heap(values, _) => values.push(value),
            Memory::Mapped { length, capacity, .. } => {
                assert!(length < capacity, "a list has the capacity that it was made with");
                *length += 1;
                if let Some(last) = self.last_mut() {
                    *last = value;
                }
            }
        }
    }

    /// Adds values up to `length`, each `value`, or removes those beyond.
    ///
    /// # Panics
    /// As [`List::push`].
    pub fn resize(&mut self, length: usize, value: T) {
        match &mut self.0 {
            Memory::Heap(values, _) => values.resize(length, value),
            Memory::Mapped { length: of, .. } => *of = length.min(*of),
        }
        let more = length - self.len();
        self.extend(std::iter::repeat_n(value, more));
    }
}

impl<T: Pod> Extend<T> for List<T> {
    fn extend<I: IntoIterator<Item = T>>(&mut self, values: I) {
        match &mut self.0 {
            Memory::Heap(of, _) => of.extend(values),
            Memory::Mapped { .. } => values.into_iter().for_each(|value| self.push(value)),
        }
    }
}

impl<T: Pod> std::ops::Deref for List<T> {
    type Target = [T];
    #[inline]
    fn deref(&self) -> &[T] {
        match &self.0 {
            Memory::Heap(values, _) => values,
            Memory::Mapped { map, length, .. } => {
                // SAFETY: the mapping, aligned to a page, has `capacity` ≥ `length` values of `T`, for which any bytes are valid, as this list alone
                // refers to this part of a file that no other process can open; it is borrowed like the list.
                unsafe { std::slice::from_raw_parts(map.as_ptr().cast(), *length) }
            }
        }
    }
}

impl<T: Pod> std::ops::DerefMut for List<T> {
    #[inline]
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.0 {
            Memory::Heap(values, _) => values,
            Memory::Mapped { map, length, .. } => {
                // SAFETY: as above; the list is borrowed exclusively.
                unsafe { std::slice::from_raw_parts_mut(map.as_mut_ptr().cast(), *length) }
            }
        }
    }
}

impl<T: Pod + PartialEq<U>, U, const N: usize> PartialEq<[U; N]> for List<T> {
    fn eq(&self, other: &[U; N]) -> bool {
        self[..] == other[..]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_beyond_half_of_the_memory_are_in_the_file_and_have_the_same_values() {
        let folder = std::env::temp_dir();
        let scratch = Scratch::new(&folder, 1 << 20);
        let numbers = || (0..100_000u32).map(|k| k.wrapping_mul(2_654_435_761));
        let mut lists: Vec<List<u32>> = Vec::new();
        for _ in 0..3 {
            let mut list = scratch.list(100_000).unwrap();
            list.extend(numbers());
            lists.push(list);
        }
        let in_memory: Vec<bool> = lists.iter().map(|list| list.memory_bytes() > 0).collect();
        assert_eq!((in_memory, scratch.file_bytes()), (vec![true, false, false], 2 * 7 * 65_536));
        scratch.0.as_ref().unwrap().release();
        for list in &lists {
            assert!(list.iter().copied().eq(numbers()) && list.capacity() == 100_000);
        }
        // A list that is freed leaves memory for others; small ones are always there.
        lists.remove(0);
        assert!(scratch.keep(vec![1u8; 100_000]).unwrap().memory_bytes() > 0);
        assert!(!scratch.takes(65_535) && !Scratch::default().takes(u64::MAX));
        let mut list = scratch.zeros::<[f64; 3]>(100_000).unwrap();
        assert!(list.memory_bytes() == 0 && list.iter().all(|v| *v == [0.0; 3]));
        list[99_999] = [1.0; 3];
        list.resize(1, [0.0; 3]);
        list.resize(100_000, [2.0; 3]);
        assert_eq!((list[0], list[1], list[99_999]), ([0.0; 3], [2.0; 3], [2.0; 3]));
        let kept = scratch.keep(vec![[7u32; 2]; 100_000]).unwrap();
        assert!(kept.memory_bytes() == 0 && kept.iter().all(|v| *v == [7, 7]));
    }

    #[test]
    fn a_folder_that_is_not_there_is_an_error() {
        let folder = std::env::temp_dir().join("lenscube-no-such-folder");
        let error = Scratch::new(&folder, 0).list::<u8>(1 << 20).unwrap_err();
        assert_eq!((error.kind, error.bytes), (ErrorKind::NotFound, 1 << 20));
        assert!(error.to_string().contains("lenscube-no-such-folder"));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn pages_are_given_back_when_the_process_exceeds_its_memory() {
        // Any process exceeds 4 MiB.
        let scratch = Scratch::new(&std::env::temp_dir(), 4 << 20);
        let mut list = scratch.list::<u64>(8 << 20).unwrap();
        list.extend((0..8 << 20).map(|k| k * 3));
        std::thread::sleep(20 * PERIOD);
        let resident = resident_bytes().unwrap();
        assert!(list.iter().enumerate().all(|(k, v)| *v == 3 * k as u64));
        assert!(resident > 0);
    }
}
