//! Execution of requests by one small runtime for the whole process; callers are ordinary threads and block.

use std::future::Future;
use std::sync::OnceLock;
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};

use object_store::Error;
use tokio::runtime::{Builder, Runtime};

use super::response::is_interrupted;

/// Threads, which encrypt and sign; waiting for a response occupies none.
const THREADS: usize = 2;

/// Time after which a request with an interrupted response is not repeated.
const RETRY_TIMEOUT: Duration = Duration::from_secs(30);

fn runtime() -> &'static Runtime {
    static RUNTIME: OnceLock<Runtime> = OnceLock::new();
    RUNTIME.get_or_init(|| {
        // Fails only if a provider of TLS is installed already, which this program does nowhere else.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let mut builder = Builder::new_multi_thread();
        builder.worker_threads(THREADS).thread_name("requests").enable_all();
        builder.build().expect("a process may start two more threads")
    })
}

/// The result of `work`; the calling thread, of any kind, blocks.
pub(super) fn block_on<T: Send + 'static>(work: impl Future<Output = T> + Send + 'static) -> T {
    let (sender, receiver) = sync_channel(1);
    runtime().spawn(async move {
        // The receiver is closed only while the process ends.
        let _ = sender.send(work.await);
    });
    receiver.recv().expect("requests return their errors")
}

/// As [`block_on`], for requests that may be repeated. The client repeats failed requests, but not all whose response is interrupted:
/// those are repeated here.
pub(super) fn block_on_with_retry<T, W>(work: impl Fn() -> W) -> Result<T, Error>
where
    T: Send + 'static,
    W: Future<Output = Result<T, Error>> + Send + 'static,
{
    let begin = Instant::now();
    let mut pause = Duration::from_millis(100);
    loop {
        match block_on(work()) {
            Err(e) if is_interrupted(&e) && begin.elapsed() < RETRY_TIMEOUT => std::thread::sleep(pause),
            result => return result,
        }
        pause *= 2;
    }
}

/// Calls `make` inside the runtime, as constructors of clients require.
pub(super) fn within_runtime<T>(make: impl FnOnce() -> T) -> T {
    let _inside = runtime().enter();
    make()
}
