//! State of the server: access control and a limited number of threads.
//!
//! The server listens on 127.0.0.1 only, but any page open in the user's browser could send requests to it. Therefore the Host of a
//! request must be this machine (against DNS rebinding), its Origin and Sec-Fetch-Site must not be another site, and the headers of
//! a response forbid its use by other sites. Addresses name tiles and pixels, never files. Reading and rendering run on a few
//! threads; a request whose client disconnects leaves the queue, and its work is cancelled.

use super::content::Content;
use super::error::HttpError;
use super::image_pyramid::Cancelled;
use anyhow::Error;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use tokio::sync::Semaphore;

/// Maximum number of requests that wait for a thread.
const MAX_WAITING: usize = 512;
/// Default port of HTTP, which browsers omit from Host and Origin.
const DEFAULT_PORT: u16 = 80;
/// Resources of this server only; images also from the page's memory.
const CONTENT_SECURITY_POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; \
base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// State shared by all requests.
pub struct ServerState {
    /// Film, chart and lens.
    pub content: Content,
    port: u16,
    threads: Semaphore,
    waiting: AtomicUsize,
}

/// Whether `host`, the authority of a Host or Origin header, is this server at `port`: `NAME:PORT`, at the default port also
/// `NAME`. Names are case-insensitive and may end with the dot of the root (RFC 3986, section 3.2.2).
fn is_this_server(host: &[u8], port: u16) -> bool {
    let Ok(host) = std::str::from_utf8(host) else { return false };
    let name = match host.strip_suffix(&format!(":{port}")) {
        Some(name) => name,
        None if port == DEFAULT_PORT => host,
        None => return false,
    };
    let name = name.to_ascii_lowercase();
    matches!(&*name, "127.0.0.1" | "localhost" | "localhost." | "[::1]")
}

/// Sets the cancel flag of a request when it is dropped, e.g. because the client disconnected.
struct CancelOnDrop(Arc<AtomicBool>);

impl Drop for CancelOnDrop {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Entry in the queue for a thread.
struct QueueEntry<'a>(&'a AtomicUsize);

impl Drop for QueueEntry<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

impl ServerState {
    /// State of a server at `port` with `threads` threads for reading and rendering.
    pub fn new(content: Content, port: u16, threads: usize) -> Self {
        Self { content, port, threads: Semaphore::new(threads), waiting: AtomicUsize::new(0) }
    }

    /// Starts no further work: waiting and new requests fail with status 503.
    pub fn stop(&self) {
        self.threads.close();
    }

    /// Runs `work` on one of the threads; its flag is set when the request is cancelled.
    pub async fn run_blocking<T: Send + 'static>(
        self: &Arc<Self>,
        work: impl FnOnce(&Content, &AtomicBool) -> Result<T, HttpError> + Send + 'static,
    ) -> Result<T, HttpError> {
        let entry = QueueEntry(&self.waiting);
        if self.waiting.fetch_add(1, Ordering::Relaxed) >= MAX_WAITING {
            return Err(HttpError(StatusCode::SERVICE_UNAVAILABLE, "too many requests at once".into()));
        }
        let permit = self.threads.acquire().await.map_err(|_| HttpError::from(Error::new(Cancelled)))?;
        drop(entry);
        let cancel = Arc::new(AtomicBool::new(false));
        let cancel_on_drop = CancelOnDrop(cancel.clone());
        let state = self.clone();
        // The thread runs until the flag is set, so it releases the permit itself.
        permit.forget();
        let done = tokio::task::spawn_blocking(move || {
            let _release = ReleasePermit(&state.threads);
            work(&state.content, &cancel)
        });
        let done = done.await;
        drop(cancel_on_drop);
        done.unwrap_or_else(|_| {
            Err(HttpError(StatusCode::INTERNAL_SERVER_ERROR, "a bug in the program".into()))
        })
    }

    /// Reason to reject a request; none for an allowed one.
    fn rejection(&self, headers: &HeaderMap, is_start_page: bool) -> Option<&'static str> {
        let value = |name: HeaderName| headers.get(name).map(HeaderValue::as_bytes);
        let is_own = |host: &[u8]| is_this_server(host, self.port);
        if headers.get_all(header::HOST).iter().count() != 1 || !value(header::HOST).is_some_and(is_own) {
            return Some("the Host of the request must be 127.0.0.1 or localhost");
        }
        if let Some(origin) = value(header::ORIGIN)
            && !origin.strip_prefix(b"http://").is_some_and(is_own)
        {
            return Some("requests from pages of other sites are not allowed");
        }
        match value(HeaderName::from_static("sec-fetch-site")) {
            // Address entered by the user, or a link of the page itself.
            None | Some(b"none" | b"same-origin") => None,
            Some(_)
                if is_start_page && value(HeaderName::from_static("sec-fetch-mode")) == Some(b"navigate") =>
            {
                None
            }
            Some(_) => Some("requests from pages of other sites are not allowed"),
        }
    }
}

/// Releases a thread's permit when dropped.
struct ReleasePermit<'a>(&'a Semaphore);

impl Drop for ReleasePermit<'_> {
    fn drop(&mut self) {
        self.0.add_permits(1);
    }
}

/// Middleware: rejects requests from elsewhere with status 403, and adds the security headers to every response.
pub async fn guard(State(state): State<Arc<ServerState>>, request: Request, next: Next) -> Response {
    let rejection = state.rejection(request.headers(), request.uri().path() == "/");
    let mut response = match rejection {
        Some(reason) => HttpError(StatusCode::FORBIDDEN, reason.into()).into_response(),
        None => next.run(request).await,
    };
    for (name, value) in [
        ("content-security-policy", CONTENT_SECURITY_POLICY),
        ("x-content-type-options", "nosniff"),
        ("x-frame-options", "DENY"),
        ("referrer-policy", "no-referrer"),
        ("cross-origin-resource-policy", "same-origin"),
        ("cross-origin-opener-policy", "same-origin"),
        // Another film may be served at this address later.
        ("cache-control", "no-store"),
    ] {
        response.headers_mut().insert(HeaderName::from_static(name), HeaderValue::from_static(value));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::is_this_server;

    #[test]
    fn host_matches_with_its_port_in_any_case_and_without_port_only_at_80() {
        for name in ["127.0.0.1", "localhost", "LocalHost", "localhost.", "[::1]"] {
            let (with_8080, with_80) = (format!("{name}:8080"), format!("{name}:80"));
            assert!(is_this_server(with_8080.as_bytes(), 8080), "{name}");
            assert!(!is_this_server(name.as_bytes(), 8080), "{name}");
            assert!(!is_this_server(with_80.as_bytes(), 8080), "{name}");
            assert!(is_this_server(name.as_bytes(), 80) && is_this_server(with_80.as_bytes(), 80), "{name}");
        }
        for other in [
            "",
            ":80",
            "evil.example",
            "localhost.evil.example",
            "127.0.0.1:8080",
            "localhost:",
            "localhost..",
            "::1",
        ] {
            assert!(!is_this_server(other.as_bytes(), 80), "{other}");
        }
    }
}
