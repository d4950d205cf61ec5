//! Memory mapping of a file that may be truncated while it is read.
//!
//! Access to a mapped page beyond the end of the file raises SIGBUS, which by default terminates the process. A handler, installed with
//! the first mapping, replaces such a page of a registered mapping by zeros and marks the mapping; it passes any other SIGBUS to the
//! previous handler. The reader checks the mark after each copy.
#![allow(unsafe_code, reason = "memory mapping and signal handling are system calls")]

use memmap2::{Advice, Mmap, UncheckedAdvice};
use std::fs::File;
use std::io::{Error, Result};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::{Mutex, Once};

/// Maximum number of mapped files.
const MAX_MAPPINGS: usize = 64;

/// Address ranges of the mappings, for the handler, which must neither lock nor allocate.
static RANGES: [Range; MAX_MAPPINGS] = [const { Range::new() }; MAX_MAPPINGS];
/// Held while a range is registered.
static REGISTER: Mutex<()> = Mutex::new(());

/// Both addresses are 0 if the entry is free.
struct Range {
    start: AtomicUsize,
    end: AtomicUsize,
    has_lost_pages: AtomicBool,
}

impl Range {
    const fn new() -> Self {
        Self { start: AtomicUsize::new(0), end: AtomicUsize::new(0), has_lost_pages: AtomicBool::new(false) }
    }
}

/// A mapped file.
#[derive(Debug)]
pub(super) struct MappedFile {
    map: Mmap,
    file: File,
    /// Entry in [`RANGES`].
    entry: usize,
    expected: u64,
}

impl MappedFile {
    /// Maps the first `expected` bytes of `file`, which must have at least as many.
    pub(super) fn new(file: File, expected: u64) -> Result<Self> {
        let length = usize::try_from(expected).map_err(|_| Error::from(std::io::ErrorKind::FileTooLarge))?;
        install_handler()?;
        // SAFETY: the bytes are only read, and only as integers and floats, for which any bytes are valid; pages lost by truncation are
        // replaced by zeros by the handler installed above.
        let map = unsafe { memmap2::MmapOptions::new().len(length).map(&file)? };
        map.advise(Advice::Random)?;
        let _register = REGISTER.lock().expect("no panic while held");
        let free = RANGES.iter().position(|p| p.end.load(SeqCst) == 0);
        let entry = free.ok_or_else(|| Error::other(format!("{MAX_MAPPINGS} files are mapped already")))?;
        let start = map.as_ptr() as usize;
        RANGES[entry].has_lost_pages.store(false, SeqCst);
        RANGES[entry].start.store(start, SeqCst);
        RANGES[entry].end.store(start + length, SeqCst);
        Ok(Self { map, file, entry, expected })
    }

    /// `length` bytes from `first`; zeros where the file was truncated.
    pub(super) fn bytes(&self, first: usize, length: usize) -> &[u8] {
        &self.map[first..first + length]
    }

    /// Whether the file was truncated, or lost pages were read.
    pub(super) fn has_lost_pages(&self) -> bool {
        RANGES[self.entry].has_lost_pages.load(SeqCst) || self.file_bytes().is_ok_and(|n| n < self.expected)
    }

    /// Current size of the file.
    pub(super) fn file_bytes(&self) -> Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    /// Bytes that were mapped.
    pub(super) fn expected_bytes(&self) -> u64 {
        self.expected
    }

    /// Advises the system that bytes will be read soon.
    pub(super) fn prefetch(&self, first: usize, length: usize) {
        let end = (first + length).min(self.map.len());
        if first < end {
            let _ = self.map.advise_range(Advice::WillNeed, first, end - first);
        }
    }

    /// Releases the memory of bytes that were read; a later access reads them from the file again.
    pub(super) fn release(&self, first: usize, length: usize) {
        // SAFETY: the mapping is backed by a file and never written to: released pages are read from the file again.
        let _ = unsafe { self.map.unchecked_advise_range(UncheckedAdvice::DontNeed, first, length) };
    }
}

impl Drop for MappedFile {
    fn drop(&mut self) {
        RANGES[self.entry].start.store(0, SeqCst);
        RANGES[self.entry].end.store(0, SeqCst);
    }
}

/// Installs the handler on the first call.
fn install_handler() -> Result<()> {
    static ONCE: Once = Once::new();
    static INSTALLED: AtomicBool = AtomicBool::new(false);
    ONCE.call_once(|| {
        // SAFETY: `sigaction` receives a fully initialized structure and space for the previous one; the handler calls only
        // async-signal-safe functions.
        let done = unsafe {
            let mut action: libc::sigaction = std::mem::zeroed();
            action.sa_sigaction = on_sigbus as *const () as usize;
            action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
            libc::sigemptyset(&raw mut action.sa_mask);
            let mut previous: libc::sigaction = std::mem::zeroed();
            let done = libc::sigaction(libc::SIGBUS, &raw const action, &raw mut previous);
            PREVIOUS.store(previous.sa_sigaction, SeqCst);
            PREVIOUS_HAS_INFO.store(previous.sa_flags & libc::SA_SIGINFO != 0, SeqCst);
            done
        };
        INSTALLED.store(done == 0, SeqCst);
    });
    if INSTALLED.load(SeqCst) { Ok(()) } else { Err(Error::other("the SIGBUS handler cannot be installed")) }
}

/// The previous handler.
static PREVIOUS: AtomicUsize = AtomicUsize::new(0);
static PREVIOUS_HAS_INFO: AtomicBool = AtomicBool::new(false);

extern "C" fn on_sigbus(signal: libc::c_int, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
    // SAFETY: with SA_SIGINFO the system passes a valid `siginfo_t`, which has an address for SIGBUS.
    let address = unsafe { (*info).si_addr() } as usize;
    for range in &RANGES {
        if (range.start.load(SeqCst)..range.end.load(SeqCst)).contains(&address) {
            // SAFETY: a query without arguments in memory.
            let page = unsafe { libc::sysconf(libc::_SC_PAGESIZE) } as usize;
            let at = (address / page * page) as *mut libc::c_void;
            // SAFETY: the page lies in a read-only mapping of this module and is replaced by a page of zeros.
            let new = unsafe {
                let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_FIXED;
                libc::mmap(at, page, libc::PROT_READ, flags, -1, 0)
            };
            if new != libc::MAP_FAILED {
                range.has_lost_pages.store(true, SeqCst);
                return;
            }
        }
    }
    let previous = PREVIOUS.load(SeqCst);
    if previous == libc::SIG_DFL || previous == libc::SIG_IGN {
        // SAFETY: restores the default action; on return the same access terminates the process.
        unsafe { libc::signal(signal, libc::SIG_DFL) };
    } else if PREVIOUS_HAS_INFO.load(SeqCst) {
        // SAFETY: `sigaction` reported this address as a handler of this signature.
        let handler: extern "C" fn(libc::c_int, *mut libc::siginfo_t, *mut libc::c_void) =
            unsafe { std::mem::transmute(previous) };
        handler(signal, info, context);
    } else {
        // SAFETY: as above, with the signature without `siginfo_t`.
        let handler: extern "C" fn(libc::c_int) = unsafe { std::mem::transmute(previous) };
        handler(signal);
    }
}
