//! Ctrl-C and SIGTERM: the first lets the tiles in flight end, the second stops at once. Shards are whole or absent either way.

use crate::failure::code;
use crate::progress::say;
use formats::durable::Lock;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// Tiles are in flight, so that a first signal lets them end.
static RUNNING: AtomicBool = AtomicBool::new(false);
/// Set by the first signal.
static CANCEL: AtomicBool = AtomicBool::new(false);
/// What is left when the process ends at once.
static LEFT: Mutex<&str> = Mutex::new("the same command resumes");
/// The lock to give up when the process ends at once.
static LOCK: Mutex<Option<PathBuf>> = Mutex::new(None);

/// From now on a signal ends the program in order. A second call changes nothing.
pub fn listen() {
    let _ = ctrlc::set_handler(signal);
}

/// The lock to give up when a signal ends the program at once.
pub fn release_on_exit(lock: &Path) {
    *LOCK.lock().expect("no panic while held") = Some(lock.into());
}

/// From now on the first signal only sets what this returns.
pub fn finish_tiles() -> &'static AtomicBool {
    RUNNING.store(true, Ordering::SeqCst);
    &CANCEL
}

/// From now on the first signal only sets what this returns; nothing that was begun is kept.
pub fn leave_nothing() -> &'static AtomicBool {
    *LEFT.lock().expect("no panic while held") = "nothing was written";
    let _ = ctrlc::set_handler(signal);
    finish_tiles()
}

fn signal() {
    let again = CANCEL.swap(true, Ordering::SeqCst);
    if RUNNING.load(Ordering::SeqCst) && !again {
        say("stopping: finishing the tiles in flight (again to stop at once)");
        return;
    }
    if let Some(path) = LOCK.lock().expect("no panic while held").as_deref() {
        Lock::release(path);
    }
    say(format!("stopped; {}", LEFT.lock().expect("no panic while held")));
    std::process::exit(i32::from(code::INTERRUPTED));
}

/// From now on the kernel kills this process when the thread that started it ends: no worker outlives its driver, and no shard
/// suffers, for they are whole or absent whatever kills a run.
#[cfg(target_os = "linux")]
pub fn die_with_parent() -> std::io::Result<()> {
    use rustix::process::{Signal, getppid, set_parent_process_death_signal};
    let parent = getppid();
    set_parent_process_death_signal(Some(Signal::KILL))?;
    if getppid() != parent {
        // It ended just before.
        std::process::exit(i32::from(code::INTERRUPTED));
    }
    Ok(())
}

/// Other systems have no such signal.
#[cfg(not(target_os = "linux"))]
pub fn die_with_parent() -> std::io::Result<()> {
    Err(std::io::ErrorKind::Unsupported.into())
}
