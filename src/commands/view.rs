//! `lenscube view`: serves a page on this machine that shows a film or a raw at any zoom.

mod content;
mod error;
mod guard;
mod handlers;
mod image_pyramid;
mod lens;
mod mosaic;
mod query;
mod server;

use crate::args::ViewArgs;
use crate::machine;
use crate::progress::{log_line, print};
use anyhow::{Context, Result};
use content::Content;
use formats::pyramid::PyramidState;
use guard::ServerState;
use std::net::{Ipv4Addr, SocketAddr};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

/// Maximum default number of threads that read and render.
const MAX_DEFAULT_THREADS: usize = 4;
/// Time limit for requests in progress after Ctrl-C.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(2);

/// Runs the command, until a signal ends it.
pub fn command(args: &ViewArgs) -> Result<()> {
    let content = Content::open(args)?;
    print_notes(&content);
    let threads = args.threads.unwrap_or_else(|| machine::threads(None).min(MAX_DEFAULT_THREADS));
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .max_blocking_threads(threads + 1)
        .enable_all()
        .build()
        .context("starting the server")?;
    let result = runtime.block_on(serve(content, args, threads));
    runtime.shutdown_timeout(SHUTDOWN_TIMEOUT);
    result
}

async fn serve(content: Content, args: &ViewArgs, threads: usize) -> Result<()> {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, args.port));
    let listener = tokio::net::TcpListener::bind(address)
        .await
        .with_context(|| format!("listening on {address}; --port 0 uses any free port"))?;
    let port = listener.local_addr().context("getting the port")?.port();
    let url = format!("http://127.0.0.1:{port}/");
    let state = Arc::new(ServerState::new(content, port, threads));
    let mut signals = signals().context("listening for Ctrl-C")?;
    let (shutdown, stopping) = tokio::sync::watch::channel(());
    let router = handlers::router(state.clone());
    let mut serving = tokio::spawn(server::serve(listener, router, stopping));
    print(&url);
    log_line("stop with Ctrl-C");
    if args.open {
        open_browser(&url);
    }
    tokio::select! {
        ended = &mut serving => return ended.context("serving the page"),
        _ = signals.recv() => (),
    }
    state.stop();
    drop(shutdown);
    let _ = tokio::time::timeout(SHUTDOWN_TIMEOUT, serving).await;
    Ok(())
}

/// Channel that receives Ctrl-C and SIGTERM.
fn signals() -> std::io::Result<tokio::sync::mpsc::Receiver<()>> {
    use tokio::signal::unix::{SignalKind, signal};
    let (sender, receiver) = tokio::sync::mpsc::channel(1);
    for kind in [SignalKind::interrupt(), SignalKind::terminate()] {
        let (mut signal, sender) = (signal(kind)?, sender.clone());
        tokio::spawn(async move {
            while signal.recv().await.is_some() {
                let _ = sender.try_send(());
            }
        });
    }
    Ok(receiver)
}

fn print_notes(content: &Content) {
    for image in [Some(&content.film), content.chart.as_ref()].into_iter().flatten() {
        if image.sizes.len() > 1 && image.stored_levels != PyramidState::Complete {
            let state = match image.stored_levels {
                PyramidState::Stale => "its pyramid was made from other pixels",
                PyramidState::Unfinished(..) => "its pyramid is unfinished",
                _ => "it has no pyramid",
            };
            log_line(format!(
                "note: {}: {state}, so low zoom levels are slow; create the pyramid of a film or raw with `lenscube pyramid`",
                image.name
            ));
        }
    }
    if let (Err(message), None) = (&content.lens, &content.film.mosaic) {
        log_line(format!("note: no lens data: {message}"));
    }
}

fn open_browser(url: &str) {
    let program = if cfg!(target_os = "macos") { "open" } else { "xdg-open" };
    let started = Command::new(program)
        .arg(url)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    if let Err(e) = started {
        log_line(format!("note: {program} cannot be started ({e}); open the address in a browser"));
    }
}
