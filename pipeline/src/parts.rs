//! Parts of one computation, shared among the threads of a phase.

use crate::clock::on_threads;
use std::sync::Mutex;

/// Passes each of `parts` to `each`, on `threads` threads that each have a worker of `worker`. After an error a thread takes no more.
///
/// # Errors
/// The first error.
pub(crate) fn for_each_part<P: Send, W, E: Send>(
    threads: usize,
    parts: impl Iterator<Item = P> + Send,
    worker: impl Fn() -> W + Sync,
    each: impl Fn(&mut W, P) -> Result<(), E> + Sync,
) -> Result<(), E> {
    let (parts, failure) = (Mutex::new(parts), Mutex::new(None));
    let next = || parts.lock().expect("no panic while held").next();
    on_threads(threads, || {
        let mut worker = worker();
        while let Some(part) = next() {
            if let Err(error) = each(&mut worker, part) {
                failure.lock().expect("no panic while held").get_or_insert(error);
                break;
            }
        }
    });
    failure.into_inner().expect("no panic while held").map_or(Ok(()), Err)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_is_done_once_and_an_error_is_returned() {
        for threads in [0, 1, 3] {
            let mut squares = vec![0; 100];
            let done: Result<(), ()> = for_each_part(
                threads,
                squares.chunks_mut(7).enumerate(),
                || 7,
                |width, (part, out)| {
                    out.iter_mut().enumerate().for_each(|(i, v)| *v += (part * *width + i).pow(2));
                    Ok(())
                },
            );
            assert!(done.is_ok() && squares.iter().enumerate().all(|(i, v)| *v == i * i));
            let fails_at_5 = |_: &mut (), part| if part == 5 { Err("fifth") } else { Ok(()) };
            assert_eq!(for_each_part(threads, 0..20, || (), fails_at_5), Err("fifth"));
        }
    }
}
