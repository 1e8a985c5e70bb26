//! The viewfinder: a camera in a page of the browser, served on this machine alone.
//!
//! [`serve`] runs three things until it is stopped: the server (`server`), which talks to pages; the engine (`engine`), a thread that turns the shot as it is
//! set into frames; and the darkroom (`darkroom`), a thread that takes pictures in full. What they share is the `session`. The page lies in `web/`: plain
//! modules that need no build.
//!
//! Begin with [`serve`]. Not here: rendering, metering and development (the crate `diopter`), pages for other machines than this one, more than one user.
//!
//! Security: loopback only; a random token (`guard`); nothing is read but what the command line names (`folders`); messages are bounded in size and
//! rate (`protocol`, `server`). Nothing that a page sends is run or written to disk but shots, whose pictures go into a temporary folder.

mod catalog;
mod darkroom;
mod engine;
mod folders;
mod frame;
mod guard;
mod lock;
mod point_image;
mod pointer;
mod pose;
mod problem;
mod protocol;
mod series;
mod server;
mod session;
mod timer;

use darkroom::Darkroom;
use diopter::shot::{ShotError, ShotFile};
use folders::Folders;
use guard::Guard;
use session::Session;
use std::net::Ipv4Addr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::watch;

/// How a viewfinder is served.
pub struct Options<'a> {
    /// The shot to begin with.
    pub shot: ShotFile,
    /// Folders whose files a page may name.
    pub folders: Vec<PathBuf>,
    /// Port; 0 for a free one.
    pub port: u16,
    /// Set to end.
    pub stop: &'a AtomicBool,
    /// The date and time as EXIF writes it.
    pub now: fn() -> String,
}

/// Why there is no viewfinder.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServeError {
    /// The shot cannot be taken.
    #[error(transparent)]
    Shot(#[from] ShotError),
    /// The port cannot be had.
    #[error("port {port}: {reason}; expected a free one, or --port 0 for any")]
    Port {
        /// Which.
        port: u16,
        /// What the system says.
        reason: std::io::Error,
    },
    /// Something the system does not give.
    #[error(transparent)]
    System(#[from] std::io::Error),
}

/// How often the stop is looked at.
const TICK: Duration = Duration::from_millis(50);
/// How often pages are told how far a picture is.
const PROGRESS: Duration = Duration::from_millis(500);

/// Serves a viewfinder until `stop` is set. `ready` gets the address with the token once it can be opened; `warn` what was found odd in the shot. Fails at once
/// where the shot cannot be prepared.
pub fn serve(options: &Options, ready: impl FnOnce(&str), warn: &mut dyn FnMut(&str)) -> Result<(), ServeError> {
    let folders = Folders::new(&options.folders)?;
    let first = engine::prepared(&engine::for_finder(&options.shot), warn)?;
    let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build()?;
    let listener = runtime
        .block_on(TcpListener::bind((Ipv4Addr::LOCALHOST, options.port)))
        .map_err(|reason| ServeError::Port { port: options.port, reason })?;
    let guard = Guard::new(listener.local_addr()?.port())?;
    let session = Arc::new(Session::new(options.shot.clone(), folders, Darkroom::new(options.now)?));
    let address = guard.address();
    let served = std::thread::scope(|threads| {
        threads.spawn(|| engine::run(&session, Some(first)));
        threads.spawn(|| session.darkroom.run(&|| session.publish()));
        let (ends, ending) = watch::channel(false);
        let served = runtime.block_on(async {
            let watched = async {
                let mut told = std::time::Instant::now();
                while !options.stop.load(Ordering::Relaxed) {
                    tokio::time::sleep(TICK).await;
                    session.tick(std::time::Instant::now());
                    if told.elapsed() >= PROGRESS && session.darkroom.is_busy() {
                        told = std::time::Instant::now();
                        session.publish();
                    }
                }
                ends.send_replace(true);
            };
            ready(&address);
            let (served, ()) = tokio::join!(server::serve(listener, session.clone(), guard, ending), watched);
            served
        });
        session.end();
        served
    });
    // Sockets of pages that do not answer are not waited for.
    runtime.shutdown_timeout(Duration::from_millis(200));
    Ok(served?)
}
