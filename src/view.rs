//! `lenscube view`: a page, for this machine alone, that shows a film as deep as one likes.

mod answers;
mod door;
mod lens;
mod query;
mod site;
mod stack;

use crate::args::ViewArgs;
use crate::job;
use crate::progress::{print, say};
use anyhow::{Context, Result};
use formats::film::PyramidState;
use site::Site;
use std::net::{Ipv4Addr, SocketAddr};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

/// Most threads that read and render, if nobody says how many.
const MAX_THREADS: usize = 4;
/// How long answers in hand may take after Ctrl-C.
const LAST_ANSWERS: Duration = Duration::from_secs(2);

/// Runs the command, until a signal ends it.
pub fn command(args: &ViewArgs) -> Result<()> {
    let site = Site::open(args)?;
    tell(&site);
    let threads = args.threads.unwrap_or_else(|| job::threads(None).min(MAX_THREADS));
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(1)
        .max_blocking_threads(threads + 1)
        .enable_all()
        .build()
        .context("starting the server")?;
    let result = runtime.block_on(serve(site, args, threads));
    // What still reads for nobody ends by itself, soon.
    runtime.shutdown_timeout(LAST_ANSWERS);
    result
}

async fn serve(site: Site, args: &ViewArgs, threads: usize) -> Result<()> {
    let address = SocketAddr::from((Ipv4Addr::LOCALHOST, args.port));
    let listener = tokio::net::TcpListener::bind(address)
        .await
        .with_context(|| format!("listening on {address}; --port 0 takes any port that is free"))?;
    let port = listener.local_addr().context("asking for the port")?.port();
    let url = format!("http://127.0.0.1:{port}/");
    let desk = Arc::new(door::Desk::new(site, port, threads));
    let mut ended = signals().context("listening for Ctrl-C")?;
    let (leave, left) = tokio::sync::oneshot::channel::<()>();
    let server = axum::serve(listener, door::router(desk.clone())).with_graceful_shutdown(async {
        // A sender that is gone ends it as well.
        let _ = left.await;
    });
    print(&url);
    say("Ctrl-C ends it");
    if args.open {
        open_browser(&url);
    }
    let mut serving = tokio::spawn(server.into_future());
    tokio::select! {
        failed = &mut serving => return Ok(failed.context("serving the page")??),
        _ = ended.recv() => (),
    }
    desk.stop();
    let _ = leave.send(());
    // Browsers keep connections open; who has nothing to say any more is not waited for.
    let _ = tokio::time::timeout(LAST_ANSWERS, serving).await;
    Ok(())
}

/// Hears of Ctrl-C and SIGTERM.
fn signals() -> std::io::Result<tokio::sync::mpsc::Receiver<()>> {
    use tokio::signal::unix::{SignalKind, signal};
    let (heard, hear) = tokio::sync::mpsc::channel(1);
    for kind in [SignalKind::interrupt(), SignalKind::terminate()] {
        let (mut signal, heard) = (signal(kind)?, heard.clone());
        tokio::spawn(async move {
            while signal.recv().await.is_some() {
                let _ = heard.try_send(());
            }
        });
    }
    Ok(hear)
}

fn tell(site: &Site) {
    for stack in [Some(&site.film), site.chart.as_ref()].into_iter().flatten() {
        let far = stack.sizes.len() > 1 && stack.pyramid != PyramidState::Complete;
        if far {
            let why = match stack.pyramid {
                PyramidState::Stale => "its pyramid is of other pixels",
                PyramidState::Unfinished(..) => "its pyramid is unfinished",
                _ => "it has no pyramid",
            };
            say(format!(
                "note: {}: {why}, so far views read all of it; `lenscube pyramid` makes a film's",
                stack.name
            ));
        }
    }
    if let Err(why) = &site.lens {
        say(format!("note: no lens data: {why}"));
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
        say(format!("note: {program} cannot be started ({e}); open the address yourself"));
    }
}
