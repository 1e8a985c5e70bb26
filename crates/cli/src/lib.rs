//! diopter on the command line, as a library: the program, and whoever else hands it on (the Python package), calls [`run`].
//!
//! Thin: reads arguments (`args`), runs one verb (`commands`), writes files beside and renames them (`output`).
//! `help` lays the arguments out. Results go to standard output, progress and messages to standard error; with `--json` errors
//! are on standard output, too. Exit codes: 0 done, 1 failed (or stopped by a signal, with what was done written), 2 usage error,
//! 130 ended at once by a signal.
//!
//! Not here: anything that a photograph depends on; that is in `diopter`, for programs and for Python alike.

mod args;
mod checkpoint;
mod commands;
mod contact_sheet;
mod document;
mod effect;
mod help;
mod html;
mod memory;
mod output;
mod own_program;
mod paint;
mod parts;
mod pdf;
mod step_pictures;
mod views;
mod watch;

use args::{Args, Verb};
use diopter::files;
use diopter::measure::MeasureError;
use diopter::shot::{ErrorParts, ShotError};
use std::ffi::OsString;

/// A failure whose cause is the request itself: exit code 2.
#[derive(Debug)]
struct UsageError(anyhow::Error);

impl std::fmt::Display for UsageError {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        // With all that is known of the cause.
        write!(f, "{:#}", self.0)
    }
}

impl std::error::Error for UsageError {}

/// A command that was stopped, after it wrote and printed what it had: its results say so.
#[derive(Debug)]
struct Stopped(String);

impl std::fmt::Display for Stopped {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Stopped {}

/// Runs one command; `typed` is the whole command line with the name of the program first. Answers with the exit code: see the top of this page.
///
/// Takes over the signals of the process (Ctrl-C), and may set the number of threads of rayon's global pool: to be called once, as all there is to do.
pub fn run(typed: impl IntoIterator<Item = OsString>) -> u8 {
    let typed = args::joined_focus(typed.into_iter());
    let json = help::wants_json(&typed);
    let args = match help::parse(&typed) {
        Ok(args) => args,
        Err(e) => {
            if json && e.use_stderr() {
                print_error(&help::as_json(&e));
            }
            // Help and versions go to standard output; where nobody reads, nothing can be said.
            let _ = e.print();
            return u8::try_from(e.exit_code()).unwrap_or(2);
        }
    };
    watch::install();
    match run_verb(args).map_err(of_output) {
        Ok(()) => 0,
        // Whoever reads our output has gone: nothing to say, nobody to say it to.
        Err(e) if e.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe) => 0,
        Err(e) => {
            watch::say(&format!("diopter: {}", told(&e)));
            let request = e.is::<UsageError>() || e.downcast_ref::<ShotError>().is_some_and(ShotError::is_request);
            let code = if request { 2 } else { 1 };
            if json && !e.is::<Stopped>() {
                print_error(&error_json(&e, code));
            }
            code
        }
    }
}

/// What failed to be written without a name was so on standard output: all other files are named where they are opened.
fn of_output(e: anyhow::Error) -> anyhow::Error {
    if e.is::<std::io::Error>() && e.chain().count() == 1 { e.context("standard output") } else { e }
}

/// The message of an error: what was done, and why it failed, each cause once.
fn told(e: &anyhow::Error) -> String {
    let mut message = String::new();
    for cause in e.chain().map(ToString::to_string).filter(|cause| !cause.is_empty()) {
        if message.is_empty() {
            message = cause;
        } else if !message.ends_with(&cause) {
            message += &format!(": {cause}");
        }
    }
    files::without_number(&message)
}

/// An error for machines: `{"error": {"message", "place", "found", "expected", "hint", "exit_code"}}`; what is not known apart is null.
fn error_json(e: &anyhow::Error, code: u8) -> serde_json::Value {
    let message = told(e);
    let parts = match (e.downcast_ref::<ShotError>(), e.downcast_ref::<MeasureError>()) {
        (Some(e), _) => e.parts(),
        (None, Some(MeasureError::Read { path, reason })) => {
            ErrorParts { place: Some(path.clone()), found: Some(reason.clone()), ..Default::default() }
        }
        _ => ErrorParts::default(),
    };
    let [place, found, expected] = match parts_of(&message) {
        [None, None, None] => context_of(e),
        known => known,
    };
    // "(did you mean ...?)" with its brackets or without.
    let hint = message.find("did you mean").map(|at| match message[at..].find('?') {
        Some(end) => message[at..=at + end].to_owned(),
        None => message[at..].to_owned(),
    });
    serde_json::json!({ "error": {
        "place": parts.place.or(place), "found": parts.found.or(found), "expected": parts.expected.or(expected), "hint": parts.hint.or(hint),
        "message": message, "exit_code": code,
    } })
}

/// Place and found of an error that was given its place on the way up: "FILE", or "FILE: cannot be written".
fn context_of(e: &anyhow::Error) -> [Option<String>; 3] {
    let e = e.downcast_ref::<UsageError>().map_or(e, |request| &request.0);
    let outer = e.to_string();
    let inner = e.chain().nth(1).map(ToString::to_string).filter(|inner| *inner != outer);
    let message = told(e);
    let place = inner.map(|_| outer.split_once(": ").map_or(outer.as_str(), |(place, _)| place));
    let found = place.and_then(|place| message.strip_prefix(place)?.strip_prefix(": "));
    [place, found, None].map(|text| text.map(str::to_owned))
}

/// Place, found and expected of a message, by the form that ours have: "PLACE FOUND: expected WHAT" or "PLACE: FOUND; expected WHAT".
fn parts_of(message: &str) -> [Option<String>; 3] {
    let split =
        [": expected ", "; expected ", ", expected "].iter().filter_map(|s| message.split_once(s)).min_by_key(|s| s.0.len());
    let Some((before, expected)) = split else { return [None, None, None] };
    let is_of_value = |c: char| c.is_ascii_digit() || matches!(c, '"' | '-' | '+' | '.');
    let is_name = |word: &str| word.chars().all(|c| c.is_ascii_lowercase() || matches!(c, '-' | '_'));
    let (place, found) = match before.split_once(": ") {
        Some((place, found)) => (place, Some(found)),
        // "wavelength 200 nm", but not the name of a file.
        None => match before.split_once(' ') {
            Some((place, found)) if is_name(place) && found.starts_with(is_of_value) => (place, Some(found)),
            _ => (before, None),
        },
    };
    [Some(place), found, Some(expected)].map(|text| text.map(str::to_owned))
}

/// Prints an error where results for machines go. Nothing can be done when nobody reads it: the exit code says it, too.
fn print_error(error: &serde_json::Value) {
    use std::io::Write;
    let _ = writeln!(std::io::stdout(), "{error:#}");
}

fn run_verb(args: Args) -> anyhow::Result<()> {
    if let Some(threads) = args.threads {
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
        Verb::Denoise { plane, output, by, oidn } => commands::denoise::run(&plane, &output, by, oidn.as_deref(), json),
        Verb::Merge(merge) => commands::merge::run(&merge, json),
        Verb::QuickLook(look) => commands::quick_look::run(&look, json),
        Verb::Stack(stack) => commands::stack::run(&stack, json),
        Verb::Rig(rig) => commands::rig::run(&rig, json),
        Verb::Events(events) => commands::events::run(&events, json),
        Verb::Dataset { verb } => commands::dataset::run(&verb, json),
        Verb::Lesson(lesson) => commands::lesson::run(&lesson, args.threads, json),
        Verb::Sheet(sheet) => commands::sheet::run(&sheet, json),
        Verb::Scene { verb } => commands::scene::run(&verb, json),
        Verb::Lens { verb } => verb.run(&commands::lens::GlobalFlags { threads: args.threads, json }),
        Verb::Body { verb } => commands::body::run(&verb, json),
        Verb::Viewfinder(viewfinder) => commands::viewfinder::run(&viewfinder, json),
        Verb::Completions { shell } => commands::manual::completions(shell),
        Verb::Measure { verb } => commands::measure::run(&verb, json),
        Verb::Why(why) => commands::why::run(&why, json),
        Verb::Man { verb, output } => commands::manual::man(&verb, output.as_deref(), json),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter::lens::LensError;
    use diopter::scene::SceneError;

    #[test]
    fn errors_for_machines_say_what_was_expected() {
        let json = |e: anyhow::Error| error_json(&e, 2)["error"].clone();
        let lens = LensError::Range { what: "aperture", found: "f/-1".into(), expected: "a number above 0" };
        let scene =
            SceneError::File { place: "a.obj: line 5".into(), found: "\"f 1\"".into(), expected: "expected corners".into() };
        for (e, place, found, expected) in [
            (anyhow::Error::from(ShotError::from(lens)), "aperture", Some("f/-1"), "a number above 0"),
            (ShotError::from(scene).into(), "a.obj: line 5", Some("\"f 1\""), "corners"),
            (
                UsageError(anyhow::anyhow!("wavelength 200 nm: expected 300 to 2500")).into(),
                "wavelength",
                Some("200 nm"),
                "300 to 2500",
            ),
            (UsageError(anyhow::anyhow!("my photo.xyz: expected a name")).into(), "my photo.xyz", None, "a name"),
            (UsageError(anyhow::anyhow!("a: this is a folder; expected a file")).into(), "a", Some("this is a folder"), "a file"),
        ] {
            let e = json(e);
            assert_eq!(
                (e["place"].as_str(), e["found"].as_str(), e["expected"].as_str()),
                (Some(place), found, Some(expected)),
                "{e}"
            );
        }
        let near = json(UsageError(anyhow::anyhow!("lens \"planr\": expected a lens (did you mean \"planar\"?)")).into());
        assert_eq!(near["hint"], "did you mean \"planar\"?");
        let gone = || std::io::Error::new(std::io::ErrorKind::NotFound, "there is no such file");
        for (e, place, found) in [
            (anyhow::Error::from(gone()).context("a.dng"), "a.dng", "there is no such file"),
            (UsageError(anyhow::Error::from(gone()).context("a.dng")).into(), "a.dng", "there is no such file"),
            (
                anyhow::Error::from(std::io::Error::from_raw_os_error(28)).context("a.jpg: cannot be written"),
                "a.jpg",
                "cannot be written: No space left on device",
            ),
            (of_output(gone().into()), "standard output", "there is no such file"),
            (
                anyhow::Error::from(diopter::image::ImageError::Io(gone())).context("a.png: cannot be written"),
                "a.png",
                "cannot be written: there is no such file",
            ),
        ] {
            let e = json(e);
            assert_eq!((e["place"].as_str(), e["found"].as_str()), (Some(place), Some(found)), "{e}");
            assert_eq!(e["message"], format!("{place}: {found}"));
        }
        let other = json(anyhow::anyhow!("the exposure was stopped"));
        assert!(other["place"].is_null() && other["found"].is_null(), "{other}");
        assert!(other["expected"].is_null() && other["hint"].is_null() && other["message"] == "the exposure was stopped");
    }
}
