//! The threads on which requests are made: one small runtime for the whole process.

use std::future::Future;
use std::sync::OnceLock;
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};

use object_store::Error;
use tokio::runtime::{Builder, Runtime};

use super::fault::broken_off;

/// Threads that encrypt and sign; the waiting takes none.
const THREADS: usize = 2;

/// After so long an answer that breaks off is the last.
const PATIENCE: Duration = Duration::from_secs(30);

fn runtime() -> &'static Runtime {
    static RUNTIME: OnceLock<Runtime> = OnceLock::new();
    RUNTIME.get_or_init(|| {
        // A second provider of TLS in the process would be a mistake in the program's own dependencies.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let mut builder = Builder::new_multi_thread();
        builder.worker_threads(THREADS).thread_name("requests").enable_all();
        builder.build().expect("a process may have two more threads")
    })
}

/// The result of `work`, for which the calling thread waits, whatever kind of thread it is.
pub(super) fn wait<T: Send + 'static>(work: impl Future<Output = T> + Send + 'static) -> T {
    let (tell, told) = sync_channel(1);
    runtime().spawn(async move {
        // Nobody listens only if the process is ending.
        let _ = tell.send(work.await);
    });
    told.recv().expect("requests return their errors")
}

/// As [`wait`], for what may be asked twice. Requests are repeated further below, but not all whose answer begins and then
/// breaks off: those are repeated here.
pub(super) fn ask<T, W>(work: impl Fn() -> W) -> Result<T, Error>
where
    T: Send + 'static,
    W: Future<Output = Result<T, Error>> + Send + 'static,
{
    let begin = Instant::now();
    let mut pause = Duration::from_millis(100);
    loop {
        match wait(work()) {
            Err(e) if broken_off(&e) && begin.elapsed() < PATIENCE => std::thread::sleep(pause),
            answer => return answer,
        }
        pause *= 2;
    }
}

/// Makes what needs the runtime around it to be made.
pub(super) fn within<T>(make: impl FnOnce() -> T) -> T {
    let _inside = runtime().enter();
    make()
}
