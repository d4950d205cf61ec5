//! Parallel work with results consumed in order.

use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

struct State<E, F> {
    /// Unit whose result is consumed next.
    next: usize,
    stopped: bool,
    error: Option<E>,
    take: F,
}

/// Makes units 0 to `units` − 1 on `threads` threads and passes them to `take` in that order. A thread waits until all earlier units
/// are taken, so at most `threads` results are in memory. The first error stops all threads.
pub(crate) fn in_order<T, E: Send>(
    units: usize,
    threads: usize,
    make: impl Fn(usize) -> Result<T, E> + Sync,
    take: impl FnMut(usize, T) -> Result<(), E> + Send,
) -> Result<(), E> {
    let state = Mutex::new(State { next: 0, stopped: false, error: None, take });
    let (changed, unclaimed) = (Condvar::new(), AtomicUsize::new(0));
    let work = || {
        let _on_panic = OnPanic(|| {
            lock(&state).stopped = true;
            changed.notify_all();
        });
        loop {
            let unit = unclaimed.fetch_add(1, Relaxed);
            if unit >= units {
                return;
            }
            let made = make(unit);
            let waiting = |s: &mut State<E, _>| s.next != unit && !s.stopped;
            let mut state = changed.wait_while(lock(&state), waiting).unwrap_or_else(PoisonError::into_inner);
            if state.stopped {
                return;
            }
            let taken = made.and_then(|made| (state.take)(unit, made));
            state.next += 1;
            state.error = taken.err();
            state.stopped = state.error.is_some();
            changed.notify_all();
        }
    };
    std::thread::scope(|s| {
        (1..threads.clamp(1, units.max(1))).for_each(|_| drop(s.spawn(work)));
        work();
    });
    state.into_inner().unwrap_or_else(PoisonError::into_inner).error.map_or(Ok(()), Err)
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Stops the other threads when a thread panics: its unit will never be taken.
struct OnPanic<F: Fn()>(F);

impl<F: Fn()> Drop for OnPanic<F> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            (self.0)();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_taken_in_order_and_an_error_stops_all() {
        for threads in [1, 2, 7] {
            let mut seen = Vec::new();
            let make = |i: usize| {
                std::thread::sleep(std::time::Duration::from_micros((i * 37 % 11) as u64 * 20));
                Ok::<_, String>(i * i)
            };
            in_order(50, threads, make, |i, v| {
                assert_eq!(v, i * i);
                seen.push(i);
                Ok(())
            })
            .unwrap();
            assert_eq!(seen, (0..50).collect::<Vec<_>>());
            let failed = |i: usize| if i == 9 { Err(format!("{i} fails")) } else { Ok(i) };
            let mut last = 0;
            let error = in_order(50, threads, failed, |i, _| {
                last = i;
                Ok(())
            });
            assert_eq!((error, last), (Err("9 fails".into()), 8));
        }
        in_order(0, 3, |_| Ok::<_, ()>(()), |_, ()| Err(())).unwrap();
    }
}
