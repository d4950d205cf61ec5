//! Ctrl-C and SIGTERM: the first signal stops the run after the tiles in flight, the second at once; while a lens is traced, the first one ([`Unchecked`]). Either way
//! shards are complete or absent.

use crate::failure::code;
use crate::progress::log_line;
use formats::durable::{Lock, fault_signal_handled};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// A computation is running that checks [`CANCEL`].
static RUNNING: AtomicBool = AtomicBool::new(false);
/// Parts of the program in progress that do not check [`CANCEL`].
static UNCHECKED: AtomicUsize = AtomicUsize::new(0);
/// Set by the first signal.
static CANCEL: AtomicBool = AtomicBool::new(false);
/// Message about the output when the process is stopped at once.
static OUTPUT_STATE: Mutex<&str> = Mutex::new("the same command resumes");
/// The lock to release when the process is stopped at once.
static LOCK: Mutex<Option<PathBuf>> = Mutex::new(None);

/// Installs the signal handler. Further calls change nothing.
pub fn listen() {
    let _ = ctrlc::set_handler(signal);
}

/// Sets the lock to release when a signal stops the process at once.
pub fn release_on_exit(lock: &Path) {
    *LOCK.lock().expect("no panic while held") = Some(lock.into());
}

/// The flag that the first signal sets from now on; the second signal stops the process.
pub fn cancel_flag() -> &'static AtomicBool {
    RUNNING.store(true, Ordering::SeqCst);
    &CANCEL
}

/// As [`cancel_flag`], for an output that is removed if it is not complete; installs the handler.
pub fn cancel_flag_of_removable_output() -> &'static AtomicBool {
    *OUTPUT_STATE.lock().expect("no panic while held") = "nothing was written";
    let _ = ctrlc::set_handler(signal);
    cancel_flag()
}

/// Work that does not check the flag, and follows work that does: while this exists the first signal stops the process at once.
pub struct Unchecked(());

impl Unchecked {
    /// From now on. After a signal the process stops.
    pub fn begin() -> Self {
        UNCHECKED.fetch_add(1, Ordering::SeqCst);
        if CANCEL.load(Ordering::SeqCst) {
            stop();
        }
        Self(())
    }
}

impl Drop for Unchecked {
    fn drop(&mut self) {
        UNCHECKED.fetch_sub(1, Ordering::SeqCst);
    }
}

fn signal() {
    let again = CANCEL.swap(true, Ordering::SeqCst);
    if RUNNING.load(Ordering::SeqCst) && UNCHECKED.load(Ordering::SeqCst) == 0 && !again {
        log_line("stopping after the tiles in progress; press Ctrl-C again to stop at once");
        fault_signal_handled();
        return;
    }
    stop();
}

/// Stops the process.
fn stop() -> ! {
    if let Some(path) = LOCK.lock().expect("no panic while held").as_deref() {
        Lock::release(path);
    }
    log_line(format!("stopped; {}", OUTPUT_STATE.lock().expect("no panic while held")));
    std::process::exit(i32::from(code::INTERRUPTED));
}

/// Lets the kernel kill this process when the thread that started it ends, so that no worker outlives its scheduler. Shards are complete
/// or absent however a run ends.
#[cfg(target_os = "linux")]
pub fn die_with_parent() -> std::io::Result<()> {
    use rustix::process::{Signal, getppid, set_parent_process_death_signal};
    let parent = getppid();
    set_parent_process_death_signal(Some(Signal::KILL))?;
    if getppid() != parent {
        // The parent ended before the call.
        std::process::exit(i32::from(code::INTERRUPTED));
    }
    Ok(())
}

/// Not supported on other systems.
#[cfg(not(target_os = "linux"))]
pub fn die_with_parent() -> std::io::Result<()> {
    Err(std::io::ErrorKind::Unsupported.into())
}
