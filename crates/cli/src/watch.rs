//! Progress on the terminal, and being stopped: by Ctrl-C, SIGTERM or a closed terminal (SIGHUP).

use crate::parts;
use diopter::expose::ProgressReporter;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

static STOP: AtomicBool = AtomicBool::new(false);
/// Commands and loops that look at `STOP` and end by themselves.
static HELD: AtomicUsize = AtomicUsize::new(0);
/// Exit code of who is stopped at once, as shells give it for Ctrl-C.
const STOPPED: i32 = 130;

/// Makes a signal ask for a clean stop where one is possible; elsewhere, and the second time, it ends the program at once.
pub fn install() {
    // Where no handler can be installed, signals simply end the program.
    let _ = ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::Relaxed) || HELD.load(Ordering::Relaxed) == 0 {
            parts::remove_parts();
            std::process::exit(STOPPED);
        }
    });
}

/// While this lives, the first signal is only noted.
pub struct Held(());

/// For commands that end cleanly by themselves when they are stopped.
pub fn hold() -> Held {
    HELD.fetch_add(1, Ordering::Relaxed);
    Held(())
}

impl Drop for Held {
    fn drop(&mut self) {
        HELD.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Whether a signal has asked to stop.
pub fn stopping() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// Set when a signal asks to stop.
pub fn stop() -> &'static AtomicBool {
    &STOP
}

/// How often the progress bar is drawn.
const TICK: Duration = Duration::from_millis(100);

/// Runs something long with a progress bar and time left; the bar only where somebody sees it. Workers only store a number: the bar has a lock, and
/// a thread of its own that takes it.
pub fn watched<T>(what: &'static str, run: impl FnOnce(&ProgressReporter) -> T) -> T {
    const STEPS: u64 = 1000;
    let _held = hold();
    let bar = if std::io::stderr().is_terminal() { ProgressBar::new(STEPS) } else { ProgressBar::hidden() };
    let style =
        ProgressStyle::with_template("{msg} {wide_bar} {percent}%  {eta} left").unwrap_or_else(|_| ProgressStyle::default_bar());
    bar.set_style(style);
    bar.set_message(what);
    let position = AtomicU64::new(0);
    let result = std::thread::scope(|threads| {
        // Dropped at the end, also by a panic: then the drawing ends.
        let (_running, ended) = mpsc::channel::<()>();
        if !bar.is_hidden() {
            threads.spawn(|| {
                let ended = ended;
                while ended.recv_timeout(TICK) == Err(RecvTimeoutError::Timeout) {
                    bar.set_position(position.load(Ordering::Relaxed));
                }
            });
        }
        run(&ProgressReporter {
            cancel: &STOP,
            progress: &|done| position.store((done * STEPS as f64) as u64, Ordering::Relaxed),
        })
    });
    bar.finish_and_clear();
    result
}

/// A line for the user on standard error. Where that cannot be written (closed, a full disk) nothing is said: `eprintln!` would panic, and a
/// photograph is not lost for a message.
pub fn say(text: &str) {
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Something odd the user should know.
pub fn warn(text: &str) {
    say(&format!("warning: {text}"));
}
