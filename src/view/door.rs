//! Who is let in, and how many at once.
//!
//! The server listens on 127.0.0.1 alone, but any page that the user has open could have the browser ask it. So a request must name
//! this machine as its Host (a name that some other site points here is refused), must not come from a page of another
//! site (Origin, Sec-Fetch-Site), and answers say that no other site may use them. Addresses name tiles and pixels, never
//! files. Reading and rendering go on on a few threads; who waits for one and goes away gives its place up, and stops what it began.

use super::answers;
use super::site::Site;
use super::stack::Stopped;
use anyhow::Error;
use axum::Router;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, header};
use axum::middleware::{Next, from_fn_with_state};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use tokio::sync::Semaphore;

/// Most requests that wait for a thread.
const MAX_WAITING: usize = 512;
/// The port that browsers leave out of Host and Origin.
const HTTP: u16 = 80;
/// Only what this server itself serves; images also from the page's own memory.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob:; connect-src 'self'; \
base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// What answers are made from, and who may have them.
pub struct Desk {
    /// What is on view.
    pub site: Site,
    hosts: Hosts,
    threads: Semaphore,
    waiting: AtomicUsize,
    over: AtomicBool,
}

/// The names of this server, as a Host header or an origin has them.
struct Hosts {
    port: u16,
}

impl Hosts {
    /// Whether `host`, `NAME:PORT` or at HTTP's default port also `NAME`, is this server. Names have no case, and a name may end with
    /// the dot of the root (RFC 3986, section 3.2.2).
    fn name(&self, host: &[u8]) -> bool {
        let Ok(host) = std::str::from_utf8(host) else { return false };
        let own = format!(":{}", self.port);
        let name = match host.strip_suffix(&own) {
            Some(name) => name,
            None if self.port == HTTP => host,
            None => return false,
        };
        let name = name.to_ascii_lowercase();
        matches!(&*name, "127.0.0.1" | "localhost" | "localhost." | "[::1]")
    }
}

/// Why there is no answer.
#[derive(Debug)]
pub struct Refusal(StatusCode, String);

impl Refusal {
    /// A request that makes no sense.
    pub fn bad(why: impl Into<String>) -> Self {
        Self(StatusCode::BAD_REQUEST, why.into())
    }

    /// Something that is not there.
    pub fn missing(why: impl Into<String>) -> Self {
        Self(StatusCode::NOT_FOUND, why.into())
    }
}

impl From<Error> for Refusal {
    fn from(e: Error) -> Self {
        let status = match e.is::<Stopped>() {
            true => StatusCode::SERVICE_UNAVAILABLE,
            false => StatusCode::INTERNAL_SERVER_ERROR,
        };
        Self(status, crate::failure::line(&e))
    }
}

impl IntoResponse for Refusal {
    fn into_response(self) -> Response {
        (self.0, [(header::CONTENT_TYPE, "text/plain; charset=utf-8")], self.1).into_response()
    }
}

/// Sets its flag when whoever asked has gone.
struct Withdraw(Arc<AtomicBool>);

impl Drop for Withdraw {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// A place in the queue.
struct Place<'a>(&'a AtomicUsize);

impl Drop for Place<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Desk {
    /// For a server at `port`, with `threads` to read and render on.
    pub fn new(site: Site, port: u16, threads: usize) -> Self {
        let hosts = Hosts { port };
        let (waiting, over) = (AtomicUsize::new(0), AtomicBool::new(false));
        Self { site, hosts, threads: Semaphore::new(threads), waiting, over }
    }

    /// From now on nothing new is begun.
    pub fn stop(&self) {
        self.over.store(true, Ordering::Relaxed);
        self.threads.close();
    }

    /// Does `work` on one of the threads, and lets it know when nobody waits for it any more.
    pub async fn work<T: Send + 'static>(
        self: &Arc<Self>,
        work: impl FnOnce(&Site, &AtomicBool) -> Result<T, Refusal> + Send + 'static,
    ) -> Result<T, Refusal> {
        let busy = || Refusal(StatusCode::SERVICE_UNAVAILABLE, "too many requests at once".into());
        let place = Place(&self.waiting);
        if self.waiting.fetch_add(1, Ordering::Relaxed) >= MAX_WAITING {
            return Err(busy());
        }
        let thread = self.threads.acquire().await.map_err(|_| Refusal::from(Error::new(Stopped)))?;
        drop(place);
        let stop = Arc::new(AtomicBool::new(false));
        let withdraw = Withdraw(stop.clone());
        let desk = self.clone();
        // The thread goes on until it sees the flag, so it keeps its permit, not whoever asked.
        thread.forget();
        let done = tokio::task::spawn_blocking(move || {
            let _back = Back(&desk.threads);
            work(&desk.site, &stop)
        });
        let done = done.await;
        drop(withdraw);
        done.unwrap_or_else(|_| {
            Err(Refusal(StatusCode::INTERNAL_SERVER_ERROR, "a fault of the program".into()))
        })
    }

    /// Why a request is refused, if it is.
    fn refuses(&self, headers: &HeaderMap, at_home: bool) -> Option<&'static str> {
        let word = |name: HeaderName| headers.get(name).map(HeaderValue::as_bytes);
        let own = |host: &[u8]| self.hosts.name(host);
        if headers.get_all(header::HOST).iter().count() != 1 || !word(header::HOST).is_some_and(own) {
            return Some("this server is for its own machine: ask for it as 127.0.0.1 or localhost");
        }
        if let Some(origin) = word(header::ORIGIN)
            && !origin.strip_prefix(b"http://").is_some_and(own)
        {
            return Some("pages of other sites have no business here");
        }
        match word(HeaderName::from_static("sec-fetch-site")) {
            // Typed by the user, or followed from a link to the page itself.
            None | Some(b"none" | b"same-origin") => None,
            Some(_) if at_home && word(HeaderName::from_static("sec-fetch-mode")) == Some(b"navigate") => {
                None
            }
            Some(_) => Some("pages of other sites have no business here"),
        }
    }
}

/// Gives a thread's permit back.
struct Back<'a>(&'a Semaphore);

impl Drop for Back<'_> {
    fn drop(&mut self) {
        self.0.add_permits(1);
    }
}

/// All that is served.
pub fn router(desk: Arc<Desk>) -> Router {
    let mut router = Router::new();
    for file in answers::FILES {
        router = router.route(file.path, get(move || async move { file.answer() }));
    }
    router
        .route("/api/site", get(answers::site))
        .route("/api/exposure", get(answers::exposure))
        .route("/api/pixel", get(answers::pixel))
        .route("/api/lens", get(answers::lens))
        .route("/psf.png", get(answers::psf))
        .route("/crop.png", get(answers::crop))
        .route("/tile/{stack}/{level}/{name}", get(answers::tile))
        .fallback(|| async { Refusal::missing("no such page") })
        .layer(from_fn_with_state(desk.clone(), guard))
        .with_state(desk)
}

/// Lets a request in or not, and marks every answer.
async fn guard(State(desk): State<Arc<Desk>>, request: Request, next: Next) -> Response {
    let refusal = desk.refuses(request.headers(), request.uri().path() == "/");
    let mut response = match refusal {
        Some(why) => Refusal(StatusCode::FORBIDDEN, why.into()).into_response(),
        None => next.run(request).await,
    };
    for (name, value) in [
        ("content-security-policy", POLICY),
        ("x-content-type-options", "nosniff"),
        ("x-frame-options", "DENY"),
        ("referrer-policy", "no-referrer"),
        ("cross-origin-resource-policy", "same-origin"),
        ("cross-origin-opener-policy", "same-origin"),
        // Another film may be at this address next time.
        ("cache-control", "no-store"),
    ] {
        response.headers_mut().insert(HeaderName::from_static(name), HeaderValue::from_static(value));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::Hosts;

    #[test]
    fn hosts_are_named_with_port_in_any_case_and_without_it_at_port_80() {
        let (high, http) = (Hosts { port: 8080 }, Hosts { port: 80 });
        for name in ["127.0.0.1", "localhost", "LocalHost", "localhost.", "[::1]"] {
            assert!(high.name(format!("{name}:8080").as_bytes()), "{name}");
            assert!(!high.name(name.as_bytes()) && !high.name(format!("{name}:80").as_bytes()), "{name}");
            assert!(http.name(name.as_bytes()) && http.name(format!("{name}:80").as_bytes()), "{name}");
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
            assert!(!http.name(other.as_bytes()), "{other}");
        }
    }
}
