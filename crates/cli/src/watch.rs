//! Progress on the terminal and Ctrl-C.

use diopter::expose::Watch;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::atomic::{AtomicBool, Ordering};

static STOP: AtomicBool = AtomicBool::new(false);

/// Makes Ctrl-C ask for a clean stop; a second one ends the program at once.
pub fn install() {
    // Where no handler can be installed, Ctrl-C simply ends the program.
    let _ = ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    });
}

/// Runs something long with a progress bar and time left; the bar only where somebody sees it.
pub fn watched<T>(what: &'static str, run: impl FnOnce(&Watch) -> T) -> T {
    const STEPS: u64 = 1000;
    let bar = if std::io::stderr().is_terminal() { ProgressBar::new(STEPS) } else { ProgressBar::hidden() };
    let style =
        ProgressStyle::with_template("{msg} {wide_bar} {percent}%  {eta} left").unwrap_or_else(|_| ProgressStyle::default_bar());
    bar.set_style(style);
    bar.set_message(what);
    let result = run(&Watch { cancel: &STOP, progress: &|done| bar.set_position((done * STEPS as f64) as u64) });
    bar.finish_and_clear();
    result
}

/// A line for the user.
pub fn say(text: &str) {
    eprintln!("{text}");
}

/// Something odd the user should know.
pub fn warn(text: &str) {
    eprintln!("warning: {text}");
}
