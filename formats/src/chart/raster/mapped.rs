//! A file mapped into memory that may shrink without killing its reader.
//!
//! Touching a page of a mapping that the file no longer reaches raises SIGBUS, which ends a process. A handler, set once
//! beside the first mapping, puts a page of zeros in its place if the address lies in one of ours, and notes which mapping
//! is torn; any other SIGBUS goes on to whoever handled it before. The reader looks at that note after each copy.
#![allow(unsafe_code, reason = "mapping files and handling their loss are asked of the system")]

use memmap2::{Advice, Mmap, UncheckedAdvice};
use std::fs::File;
use std::io::{Error, Result};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::SeqCst};
use std::sync::{Mutex, Once};

/// Most files that may be mapped at once.
const MOST: usize = 64;

/// Where the mappings lie, for the handler: it may take no lock and no memory.
static PLACES: [Place; MOST] = [const { Place::new() }; MOST];
static CLAIM: Mutex<()> = Mutex::new(());

struct Place {
    start: AtomicUsize,
    end: AtomicUsize,
    torn: AtomicBool,
}

impl Place {
    const fn new() -> Self {
        Self { start: AtomicUsize::new(0), end: AtomicUsize::new(0), torn: AtomicBool::new(false) }
    }
}

/// A file's bytes.
#[derive(Debug)]
pub(super) struct Mapped {
    map: Mmap,
    file: File,
    place: usize,
    expected: u64,
}

impl Mapped {
    /// Maps the first `expected` bytes of `file`, which has them.
    pub(super) fn new(file: File, expected: u64) -> Result<Self> {
        let length = usize::try_from(expected).map_err(|_| Error::from(std::io::ErrorKind::FileTooLarge))?;
        handle_losses()?;
        // SAFETY: the bytes are only read, and only as plain numbers, which any bytes are; if the file shrinks, the handler
        // set above puts zeros where it was; if it changes, so do the numbers, nothing else.
        let map = unsafe { memmap2::MmapOptions::new().len(length).map(&file)? };
        map.advise(Advice::Random)?;
        let _claim = CLAIM.lock().expect("no panic while held");
        let free = PLACES.iter().position(|p| p.end.load(SeqCst) == 0);
        let place = free.ok_or_else(|| Error::other(format!("{MOST} files are mapped already")))?;
        let start = map.as_ptr() as usize;
        PLACES[place].torn.store(false, SeqCst);
        PLACES[place].start.store(start, SeqCst);
        PLACES[place].end.store(start + length, SeqCst);
        Ok(Self { map, file, place, expected })
    }

    /// `length` bytes from `first`; zeros where the file has lost them.
    pub(super) fn bytes(&self, first: usize, length: usize) -> &[u8] {
        &self.map[first..first + length]
    }

    /// Whether bytes were read that the file no longer has.
    pub(super) fn is_torn(&self) -> bool {
        PLACES[self.place].torn.load(SeqCst) || self.length().is_ok_and(|n| n < self.expected)
    }

    /// Bytes that the file has now.
    pub(super) fn length(&self) -> Result<u64> {
        Ok(self.file.metadata()?.len())
    }

    /// Bytes that were mapped.
    pub(super) fn expected(&self) -> u64 {
        self.expected
    }

    /// Says that bytes will be read soon. Only a hint.
    pub(super) fn will_read(&self, first: usize, length: usize) {
        let end = (first + length).min(self.map.len());
        if first < end {
            let _ = self.map.advise_range(Advice::WillNeed, first, end - first);
        }
    }

    /// Takes bytes that were read out of this process's memory; the file has them still.
    pub(super) fn give_back(&self, first: usize, length: usize) {
        // SAFETY: the mapping is of a file and is never written to: pages given back are read from the file again.
        let _ = unsafe { self.map.unchecked_advise_range(UncheckedAdvice::DontNeed, first, length) };
    }
}

impl Drop for Mapped {
    fn drop(&mut self) {
        PLACES[self.place].start.store(0, SeqCst);
        PLACES[self.place].end.store(0, SeqCst);
    }
}

/// Sets the handler, once.
fn handle_losses() -> Result<()> {
    static ONCE: Once = Once::new();
    static SET: AtomicBool = AtomicBool::new(false);
    ONCE.call_once(|| {
        // SAFETY: `sigaction` gets a whole structure of the documented form and room for the former one; the handler does
        // only what may be done in one.
        let done = unsafe {
            let mut action: libc::sigaction = std::mem::zeroed();
            action.sa_sigaction = on_sigbus as *const () as usize;
            action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK;
            libc::sigemptyset(&raw mut action.sa_mask);
            let mut former: libc::sigaction = std::mem::zeroed();
            let done = libc::sigaction(libc::SIGBUS, &raw const action, &raw mut former);
            FORMER.store(former.sa_sigaction, SeqCst);
            FORMER_HAS_INFO.store(former.sa_flags & libc::SA_SIGINFO != 0, SeqCst);
            done
        };
        SET.store(done == 0, SeqCst);
    });
    if SET.load(SeqCst) { Ok(()) } else { Err(Error::other("no handler for lost pages can be set")) }
}

/// The handler before ours.
static FORMER: AtomicUsize = AtomicUsize::new(0);
static FORMER_HAS_INFO: AtomicBool = AtomicBool::new(false);

extern "C" fn on_sigbus(signal: libc::c_int, info: *mut libc::siginfo_t, context: *mut libc::c_void) {
    // SAFETY: the system hands a handler set with SA_SIGINFO a valid `siginfo_t`, and SIGBUS has an address in it.
    let address = unsafe { (*info).si_addr() } as usize;
    for place in &PLACES {
        if (place.start.load(SeqCst)..place.end.load(SeqCst)).contains(&address) {
            // SAFETY: asks a number of the system.
            let page = unsafe { libc::sysconf(libc::_SC_PAGESIZE) } as usize;
            let at = (address / page * page) as *mut libc::c_void;
            // SAFETY: the page lies in a mapping of ours that nobody writes to; a page of zeros takes its place.
            let new = unsafe {
                let flags = libc::MAP_PRIVATE | libc::MAP_ANONYMOUS | libc::MAP_FIXED;
                libc::mmap(at, page, libc::PROT_READ, flags, -1, 0)
            };
            if new != libc::MAP_FAILED {
                place.torn.store(true, SeqCst);
                return;
            }
        }
    }
    let former = FORMER.load(SeqCst);
    if former == libc::SIG_DFL || former == libc::SIG_IGN {
        // SAFETY: gives the signal its default meaning; coming back, the same access ends the process as it should.
        unsafe { libc::signal(signal, libc::SIG_DFL) };
    } else if FORMER_HAS_INFO.load(SeqCst) {
        // SAFETY: `sigaction` told this address as a handler of this form.
        let handler: extern "C" fn(libc::c_int, *mut libc::siginfo_t, *mut libc::c_void) =
            unsafe { std::mem::transmute(former) };
        handler(signal, info, context);
    } else {
        // SAFETY: as above, of the form without information.
        let handler: extern "C" fn(libc::c_int) = unsafe { std::mem::transmute(former) };
        handler(signal);
    }
}
