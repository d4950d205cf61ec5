//! Work on numbered items on several threads.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering::Relaxed};

/// Receives numbers of items done and in total: ascending, from any thread.
pub type Progress<'a> = &'a (dyn Fn(u64, u64) + Sync);

/// Calls `work(0)` to `work(count − 1)`, each once, on `threads` threads; no call begins after an error. `progress` receives the numbers
/// of items done and in total.
///
/// # Errors
/// The error of a call.
pub fn for_each<E: Send>(
    threads: usize,
    count: usize,
    progress: Progress<'_>,
    work: impl Fn(usize) -> Result<(), E> + Sync,
) -> Result<(), E> {
    let (next, done) = (AtomicUsize::new(0), AtomicU64::new(0));
    let run = || -> Result<(), E> {
        loop {
            let n = next.fetch_add(1, Relaxed);
            if n >= count {
                return Ok(());
            }
            work(n).inspect_err(|_| next.store(count, Relaxed))?;
            progress(done.fetch_add(1, Relaxed) + 1, count as u64);
        }
    };
    std::thread::scope(|s| {
        let workers: Vec<_> = (0..threads.max(1)).map(|_| s.spawn(run)).collect();
        workers.into_iter().try_for_each(|w| w.join().expect("workers return their errors"))
    })
}
