//! The program: [`diopter_cli::run`] on what was typed.

use std::process::ExitCode;

#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    ExitCode::from(diopter_cli::run(std::env::args_os()))
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

/// An error for machines: `{"error": {"message", "place", "found", "expected", "hint", "exit_code"}}`; what is not known apart is null.
fn error_json(e: &anyhow::Error, code: u8) -> serde_json::Value {
    let message = format!("{e:#}");
    let all = |place: &dyn ToString, found: &dyn ToString, expected: &dyn ToString| {
        [place, found, expected].map(|text| Some(text.to_string()))
    };
    let [place, found, expected] = match e.downcast_ref::<ShotError>() {
        Some(ShotError::Read { path, reason } | ShotError::Syntax { path, reason }) => {
            [Some(path.clone()), Some(reason.clone()), parts_of(&message)[2].clone()]
        }
        Some(ShotError::Value { what, found, expected }) => all(what, found, expected),
        Some(ShotError::Recipe(e)) => all(&e.place, &e.found, &e.expected),
        Some(ShotError::Scene(SceneError::File { place, found, expected })) => {
            all(place, found, &expected.strip_prefix("expected ").unwrap_or(expected))
        }
        Some(ShotError::Lens(LensError::Range { what, found, expected })) => all(what, found, expected),
        Some(ShotError::Lens(LensError::Setting { what, found, expected })) => all(what, found, expected),
        Some(ShotError::Sensor(SensorError::Range { what, found, expected })) => all(what, found, expected),
        Some(ShotError::Sensor(SensorError::Unknown { what, found, .. })) => {
            [Some((*what).to_owned()), Some(found.clone()), parts_of(&message)[2].clone()]
        }
        _ => parts_of(&message),
    };
    // "(did you mean ...?)" with its brackets or without.
    let hint = message.find("did you mean").map(|at| match message[at..].find('?') {
        Some(end) => message[at..=at + end].to_owned(),
        None => message[at..].to_owned(),
    });
    serde_json::json!({ "error": {
        "message": message, "place": place, "found": found, "expected": expected, "hint": hint, "exit_code": code,
    } })
}

/// Place, found and expected of a message, by the form that ours have: "PLACE FOUND: expected WHAT" or "PLACE: FOUND; expected WHAT".
fn parts_of(message: &str) -> [Option<String>; 3] {
    let split =
        [": expected ", "; expected ", ", expected "].iter().filter_map(|s| message.split_once(s)).min_by_key(|s| s.0.len());
    let Some((before, expected)) = split else { return [None, None, None] };
    let is_name = |word: &str| word.chars().all(|c| c.is_ascii_lowercase() || matches!(c, '-' | '_'));
    let (place, found) = match before.split_once(": ") {
        Some((place, found)) => (place, Some(found)),
        // "wavelength 200 nm", but not the name of a file.
        None => match before.split_once(' ') {
            Some((place, found)) if is_name(place) => (place, Some(found)),
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
        Verb::Measure { verb } => commands::measure::run(&verb, json),
        Verb::Completions { shell } => commands::manual::completions(shell),
        Verb::Man { verb, output } => commands::manual::man(&verb, output.as_deref(), json),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
                AskedWrongly(anyhow::anyhow!("wavelength 200 nm: expected 300 to 2500")).into(),
                "wavelength",
                Some("200 nm"),
                "300 to 2500",
            ),
            (AskedWrongly(anyhow::anyhow!("my photo.xyz: expected a name")).into(), "my photo.xyz", None, "a name"),
            (
                AskedWrongly(anyhow::anyhow!("a: this is a folder; expected a file")).into(),
                "a",
                Some("this is a folder"),
                "a file",
            ),
        ] {
            let e = json(e);
            assert_eq!(
                (e["place"].as_str(), e["found"].as_str(), e["expected"].as_str()),
                (Some(place), found, Some(expected)),
                "{e}"
            );
        }
        let near = json(AskedWrongly(anyhow::anyhow!("lens \"planr\": expected a lens (did you mean \"planar\"?)")).into());
        assert_eq!(near["hint"], "did you mean \"planar\"?");
        let other = json(anyhow::anyhow!("the exposure was stopped"));
        assert!(other["expected"].is_null() && other["hint"].is_null() && other["message"] == "the exposure was stopped");
    }
}
