//! diopter: photographs of 3D scenes the way a real camera takes them.
//!
//! Thin: reads arguments ([`args`]), runs one verb ([`commands`]), writes files beside and renames them ([`output`]).
//! [`help`] lays the arguments out. Results go to standard output, progress and messages to standard error; with `--json` errors
//! are on standard output, too. Exit codes: 0 done, 1 failed (or stopped by a signal, with what was done written), 2 asked wrongly,
//! 130 ended at once by a signal.

mod args;
mod checkpoint;
mod commands;
mod help;
mod memory;
mod output;
mod paint;
mod sheet;
mod views;
mod watch;

use args::{Args, Verb};
use diopter::shot::ShotError;
use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// A failure whose cause is the request itself: exit code 2.
#[derive(Debug)]
struct AskedWrongly(anyhow::Error);

impl std::fmt::Display for AskedWrongly {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        // With all that is known of the cause.
        write!(f, "{:#}", self.0)
    }
}

impl std::error::Error for AskedWrongly {}

fn main() -> ExitCode {
    let typed = args::joined_focus(std::env::args_os());
    let json = help::wants_json(&typed);
    let args = match help::parse(&typed) {
        Ok(args) => args,
        Err(e) => {
            if json && e.use_stderr() {
                print_error(&help::as_json(&e));
            }
            e.exit()
        }
    };
    watch::install();
    match run(args) {
        Ok(()) => ExitCode::SUCCESS,
        // Whoever reads our output has gone: nothing to say, nobody to say it to.
        Err(e) if e.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe) => {
            ExitCode::SUCCESS
        }
        Err(e) => {
            watch::say(&format!("diopter: {e:#}"));
            let request = e.is::<AskedWrongly>() || e.downcast_ref::<ShotError>().is_some_and(ShotError::is_request);
            let code = if request { 2 } else { 1 };
            if json {
                print_error(&error_json(&e, code));
            }
            ExitCode::from(code)
        }
    }
}

/// An error for machines: `{"error": {"message", "place", "found", "expected", "exit_code"}}`; what is not known apart is null.
fn error_json(e: &anyhow::Error, code: u8) -> serde_json::Value {
    let [place, found, expected] = match e.downcast_ref::<ShotError>() {
        Some(ShotError::Read { path, .. } | ShotError::Syntax { path, .. }) => [Some(path.clone()), None, None],
        Some(ShotError::Value { what, found, expected }) => {
            [Some((*what).to_owned()), Some(found.clone()), Some(expected.clone())]
        }
        Some(ShotError::Recipe(e)) => [Some(e.place.clone()), Some(e.found.clone()), Some(e.expected.clone())],
        _ => [None, None, None],
    };
    serde_json::json!({ "error": {
        "message": format!("{e:#}"), "place": place, "found": found, "expected": expected, "exit_code": code,
    } })
}

/// Prints an error where results for machines go. Nothing can be done when nobody reads it: the exit code says it, too.
fn print_error(error: &serde_json::Value) {
    use std::io::Write;
    let _ = writeln!(std::io::stdout(), "{error:#}");
}

/// More than any machine has; each takes memory for its stack.
const MOST_THREADS: usize = 1024;

fn run(args: Args) -> anyhow::Result<()> {
    if let Some(threads) = args.threads {
        if threads.get() > MOST_THREADS {
            let wrong = anyhow::anyhow!("--threads {threads}: expected 1 to {MOST_THREADS}");
            return Err(AskedWrongly(wrong).into());
        }
        rayon::ThreadPoolBuilder::new().num_threads(threads.get()).build_global()?;
    }
    let json = args.json;
    match args.verb {
        Verb::Shoot(shoot) => commands::shoot::run(&shoot, json),
        Verb::Expose(expose) => commands::expose::run(&expose, json),
        Verb::ReadOut(read_out) => commands::read_out::run(&read_out, json),
        Verb::Develop(develop) => commands::develop::run(&develop, json),
        Verb::Lut { verb } => commands::lut::run(&verb, json),
        Verb::Calc { verb } => commands::calc::run(&verb, json),
        Verb::Denoise { plane, output } => commands::denoise::run(&plane, &output, json),
        Verb::Merge(merge) => commands::merge::run(&merge, json),
        Verb::QuickLook(look) => commands::quick_look::run(&look, json),
        Verb::Stack(stack) => commands::stack::run(&stack, json),
        Verb::Scene { verb } => commands::scene::run(&verb, json),
        Verb::Lens { verb } => commands::lens::run(&verb, json),
        Verb::Body { verb } => commands::body::run(&verb, json),
        Verb::Completions { shell } => commands::manual::completions(shell),
        Verb::Man { verb, output } => commands::manual::man(&verb, output.as_deref(), json),
    }
}
