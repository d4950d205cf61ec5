//! Connections of the server: a limited number of them, each of which ends if no request arrives in time.
//!
//! Connections that send no complete request would else take all file descriptors of the process, and no request would be answered. At the
//! maximum number of connections new ones wait in the queue of the system until one ends: answered, closed by its client, or timed out.

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use rustix::process::{Resource, getrlimit};
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};
use tokio::task::JoinSet;

/// Time limit for the head of a request, from the connection or the previous response on: idle connections end, too. Clients are on this
/// machine.
const REQUEST_HEAD_TIMEOUT: Duration = Duration::from_secs(2);
/// Maximum number of connections; a browser opens 6 for a page.
const MAX_CONNECTIONS: u64 = 64;
/// Pause after a failed accept, e.g. with too many open files.
const ACCEPT_RETRY: Duration = Duration::from_millis(100);

/// Maximum number of connections of a process that may open `descriptors` files (`None`: any number): half of them are for film, chart and
/// lens.
fn max_connections(descriptors: Option<u64>) -> usize {
    descriptors.map_or(MAX_CONNECTIONS, |n| MAX_CONNECTIONS.min(n / 2)).max(1) as usize
}

/// Answers requests until the sender of `stopping` is dropped; then finishes those in progress.
pub async fn serve(listener: TcpListener, router: Router, mut stopping: watch::Receiver<()>) {
    let limit = max_connections(getrlimit(Resource::Nofile).current);
    let permits = Arc::new(Semaphore::new(limit));
    let mut connections = JoinSet::new();
    loop {
        let accept = async {
            let permit = permits.clone().acquire_owned().await;
            (permit, listener.accept().await)
        };
        let (permit, accepted) = tokio::select! {
            accepted = accept => accepted,
            _ = stopping.changed() => break,
        };
        match accepted {
            Ok((stream, _)) => {
                let connection = answer(stream, router.clone(), stopping.clone());
                connections.spawn(async move {
                    let _permit = permit;
                    connection.await;
                });
            }
            Err(_) => tokio::time::sleep(ACCEPT_RETRY).await,
        }
        while connections.try_join_next().is_some() {}
    }
    while connections.join_next().await.is_some() {}
}

/// Answers the requests of one connection.
async fn answer(stream: TcpStream, router: Router, mut stopping: watch::Receiver<()>) {
    let mut connection = pin!(
        http1::Builder::new()
            .timer(TokioTimer::new())
            .header_read_timeout(REQUEST_HEAD_TIMEOUT)
            .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router))
    );
    // Errors are the client's: it disconnected, or sent no request.
    tokio::select! {
        _ = connection.as_mut() => return,
        _ = stopping.changed() => connection.as_mut().graceful_shutdown(),
    }
    let _ = connection.await;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_the_descriptors_are_left_for_files() {
        for (descriptors, connections) in
            [(None, 64), (Some(1 << 20), 64), (Some(128), 64), (Some(64), 32), (Some(1), 1), (Some(0), 1)]
        {
            assert_eq!(max_connections(descriptors), connections, "{descriptors:?}");
        }
    }
}
