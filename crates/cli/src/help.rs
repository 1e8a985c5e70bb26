//! How the command line is read and shown: headings of the flags of `shoot`, `expose` and `events`, the short help (`-h`), errors for machines.
//!
//! [`Args`] says which flags there are, and under which heading. Here headings are put in the order a photographer decides, and all flags but the most
//! used are left out of `-h`; `--help` and the manual pages show every flag.

use crate::args::Args;
use clap::builder::{StringValueParser, TypedValueParser};
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Arg, Command, CommandFactory, FromArgMatches};
use std::collections::HashSet;
use std::error::Error as _;
use std::ffi::{OsStr, OsString};
use std::num::{IntErrorKind, ParseFloatError, ParseIntError, TryFromIntError};

/// Verbs with so many flags that they need headings.
const GROUPED: [&str; 3] = ["shoot", "expose", "events"];

/// The headings, in the order in which a photographer decides.
const HEADINGS: [&str; 11] =
    ["Scene", "Camera", "Lens", "Exposure", "Focus", "Time", "Sensor", "Development", "Rendering", "Output", "Contact sheet"];

/// Flags of these verbs that `-h` shows, too, by their long names in the order in which help shows them.
const COMMON: [&str; 29] = [
    "light",
    "environment",
    "sun",
    "ground",
    "scale",
    "body",
    "look-from",
    "look-at",
    "viewpoint",
    "lens",
    "focal-length",
    "mode",
    "aperture",
    "shutter",
    "iso",
    "compensation",
    "flash",
    "focus",
    "at",
    "preset",
    "exposure-ev",
    "size",
    "spp",
    "time-limit",
    "denoise",
    "quick",
    "output",
    "vary",
    "sheet",
];

/// The whole command line, with headings.
pub fn command() -> Command {
    Args::command().mut_subcommands(|verb| if GROUPED.contains(&verb.get_name()) { grouped(verb) } else { verb })
}

/// The same of flags that only `events` has.
const COMMON_OF_EVENTS: [&str; 3] = ["sensor", "duration", "step"];

/// Puts headings, and under them the flags that are used most, in their order; leaves others to `--help`.
fn grouped(mut verb: Command) -> Command {
    for heading in HEADINGS {
        let of_heading = verb.get_arguments().filter(|a| a.get_help_heading() == Some(heading));
        let of_verb: &[&str] = if verb.get_name() == "events" { &COMMON_OF_EVENTS } else { &[] };
        let place = |a: &Arg| of_verb.iter().chain(&COMMON).position(|c| a.get_long() == Some(c));
        let flags = of_heading.map(|a| (a.get_id().to_string(), place(a)));
        // A changed argument goes to the end: headings come in their order.
        for (order, (id, common)) in flags.collect::<Vec<_>>().into_iter().enumerate() {
            let order = common.unwrap_or(COMMON.len() + COMMON_OF_EVENTS.len() + order);
            verb = verb.mut_arg(id, |a| a.display_order(order).hide_short_help(common.is_none()));
        }
    }
    verb
}

/// Negative values of flags: "--focal-length -5mm" is "--focal-length=-5mm". No flag begins with a digit; what is wrong with a value is then said of the
/// value, and clap gives no tip that leads nowhere.
fn joined_negatives(typed: &[OsString], command: &Command) -> Vec<OsString> {
    fn with_values(command: &Command, to: &mut HashSet<String>) {
        let flags = command.get_arguments().filter(|a| a.get_action().takes_values()).filter_map(|a| a.get_long());
        to.extend(flags.map(|long| format!("--{long}")));
        command.get_subcommands().for_each(|c| with_values(c, to));
    }
    let mut known = HashSet::new();
    with_values(command, &mut known);
    let negative = |word: &&OsString| {
        let rest = word.to_str().and_then(|w| w.strip_prefix('-'));
        rest.is_some_and(|r| r.starts_with(|c: char| c.is_ascii_digit() || c == '.'))
    };
    let mut joined = Vec::with_capacity(typed.len());
    let mut words = typed.iter().peekable();
    let mut all_values = false;
    while let Some(word) = words.next() {
        let mut word = word.clone();
        all_values |= word == "--";
        if !all_values
            && word.to_str().is_some_and(|w| known.contains(w))
            && let Some(value) = words.next_if(negative)
        {
            word.push("=");
            word.push(value);
        }
        joined.push(word);
    }
    joined
}

/// Reads what was typed.
pub fn parse(typed: &[OsString]) -> Result<Args, clap::Error> {
    let mut command = command();
    let typed = joined_negatives(typed, &command);
    let mut matches = match command.try_get_matches_from_mut(typed) {
        Ok(matches) => matches,
        Err(e) => return Err(number_error(e, &mut command)),
    };
    Args::from_arg_matches_mut(&mut matches).map_err(|e| e.format(&mut command))
}

/// What a number is, by the name of its value in the help, with an example.
const NUMBERS: [(&str, &str); 17] = [
    ("DEG", "an angle in degrees such as 30"),
    ("DEG/S", "an angular velocity in degrees a second such as 0.6"),
    ("EV", "a number of stops such as -0.5"),
    ("NM", "a wavelength in nm such as 550"),
    ("UM", "a length in µm such as 4.5"),
    ("M/S", "a speed in m/s such as 1.4"),
    ("C", "a temperature in °C such as 20"),
    ("GN", "a guide number such as 40"),
    ("HZ", "a frequency in Hz such as 100"),
    ("PX", "a number of pixels such as 16"),
    ("PIXELS", "a number of pixels such as 2"),
    ("ALBEDO", "an albedo from 0 to 1 such as 0.2"),
    ("FRACTION", "a fraction from 0 to 1 such as 0.04"),
    ("FACTOR", "a factor such as 0.001"),
    ("RATIO", "a ratio such as 16"),
    ("M", "a magnification such as -0.5"),
    ("T", "a turbidity such as 3"),
];

/// An error of a number that clap read by itself, in words that say what was expected (the standard library says "invalid float literal").
/// Other errors stay as they are.
fn number_error(e: clap::Error, command: &mut Command) -> clap::Error {
    let text = |kind| match e.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        _ => None,
    };
    let known =
        (e.kind() == ErrorKind::ValueValidation).then(|| text(ContextKind::InvalidArg).zip(text(ContextKind::InvalidValue)));
    let Some((name, found)) = known.flatten() else { return e };
    command.build();
    let Some(arg) = argument(command, &name) else { return e };
    let Some(expected) = e.source().and_then(|source| expected_number(source, arg, &found)) else { return e };
    // A parser that refuses everything makes an error of the same form.
    let message = format!("\"{found}\" is not {expected}");
    let refuse = StringValueParser::new().try_map(move |_: String| Err::<String, String>(message.clone()));
    refuse.parse_ref(command, Some(arg), OsStr::new(&found)).err().unwrap_or(e)
}

/// An argument of a command or of those below it, by how errors name it: "--turbidity <T>".
fn argument<'a>(command: &'a Command, name: &str) -> Option<&'a Arg> {
    let own = command.get_arguments().find(|a| a.to_string() == name);
    own.or_else(|| command.get_subcommands().find_map(|c| argument(c, name)))
}

/// What was expected where a number could not be read, with an example; `None` of other errors.
fn expected_number(source: &(dyn std::error::Error + 'static), arg: &Arg, found: &str) -> Option<String> {
    let name = arg.get_value_names().and_then(|names| names.first()).map_or("", |name| name.as_str());
    let known = NUMBERS.iter().find(|n| n.0 == name).map(|n| n.1);
    if source.is::<ParseFloatError>() {
        return Some(known.unwrap_or("a number such as 0.5").to_owned());
    }
    let default = arg.get_default_values().first().and_then(|v| v.to_str()).unwrap_or("4");
    if let Some(e) = source.downcast_ref::<ParseIntError>() {
        return Some(match e.kind() {
            IntErrorKind::Zero => format!("a whole number of 1 or more, such as {default}"),
            IntErrorKind::PosOverflow | IntErrorKind::NegOverflow => format!("a number within the range, such as {default}"),
            _ => format!("a whole number, 0 or more, such as {default}"),
        });
    }
    if source.is::<TryFromIntError>() {
        return Some(format!("a number within the range, such as {default}"));
    }
    // "0 is not in 1..=100", or without an end "0 is not in 1..18446744073709551615".
    let text = source.to_string();
    let (first, last) = text.split_once(" is not in ")?.1.split_once("..")?;
    Some(match last.strip_prefix('=') {
        Some(last) if !(found.starts_with('-') && last == u32::MAX.to_string()) => {
            format!("a whole number from {first} to {last}")
        }
        // No bound that anybody has thought of.
        _ => format!("a whole number of {first} or more"),
    })
}

/// Whether results are wanted for machines; asked before the arguments are known to be good.
pub fn wants_json(typed: &[OsString]) -> bool {
    typed.iter().take_while(|a| *a != "--").any(|a| a == "--json")
}

/// An error of the command line as JSON.
pub fn as_json(e: &clap::Error) -> serde_json::Value {
    // Without the title, which is for terminals: the usage and hints below stay.
    let text = e.render().to_string();
    let message = text.trim().strip_prefix("error: ").unwrap_or(text.trim());
    let told = |kind| match e.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        Some(ContextValue::Strings(texts)) => Some(texts.join(", ")),
        _ => None,
    };
    // Values that our own types refuse: "... is not a time such as 8 ms".
    let refused = std::error::Error::source(e).map(|source| source.to_string());
    let expected = refused.and_then(|text| Some(text.split_once(" is not ")?.1.to_owned()));
    let hint =
        [ContextKind::SuggestedArg, ContextKind::SuggestedValue, ContextKind::SuggestedSubcommand].into_iter().find_map(told);
    serde_json::json!({ "error": {
        "message": message,
        "place": told(ContextKind::InvalidArg).or_else(|| told(ContextKind::InvalidSubcommand)),
        "found": told(ContextKind::InvalidValue),
        "expected": told(ContextKind::ValidValue).filter(|v| !v.is_empty()).or(expected),
        "hint": hint,
        "exit_code": e.exit_code(),
    } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::Verb;
    use diopter::shot::ShotFile;

    fn words(text: &str) -> Vec<OsString> {
        text.split_whitespace().map(OsString::from).collect()
    }

    fn help(verb: &str, flag: &str) -> String {
        let e = parse(&words(&format!("diopter {verb} {flag}"))).expect_err("help ends the parsing");
        e.render().to_string()
    }

    #[test]
    fn errors_of_values_say_what_was_expected() {
        let error = |line: &str| as_json(&parse(&words(line)).unwrap_err())["error"].clone();
        let time = error("diopter shoot --shutter fast");
        assert_eq!((&time["found"], &time["exit_code"]), (&serde_json::json!("fast"), &serde_json::json!(2)));
        assert!(time["expected"].as_str().unwrap().starts_with("a time such as"), "{time}");
        assert!(error("diopter shoot --apperture f/2")["hint"].as_str().unwrap().contains("aperture"));
    }

    #[test]
    fn no_value_is_refused_in_the_words_of_the_standard_library() {
        fn all<'a>(command: &'a Command, path: &str, to: &mut Vec<(String, &'a Arg)>) {
            to.extend(
                command
                    .get_arguments()
                    .filter(|a| a.get_long().is_some() && a.get_action().takes_values())
                    .map(|a| (path.to_owned(), a)),
            );
            command.get_subcommands().for_each(|c| all(c, &format!("{path} {}", c.get_name()), to));
        }
        let mut command = command();
        command.build();
        let mut flags = vec![];
        all(&command, "diopter", &mut flags);
        let mut numbers = 0;
        // The same flag of several verbs is read by the same parser.
        let mut seen = HashSet::new();
        flags.retain(|(_, arg)| seen.insert((arg.get_long(), arg.get_value_names())));
        for (path, arg) in flags {
            for value in ["abc", "0", "-1", "1.5", "99999999999999999999999"] {
                let flag = format!("--{}={value}", arg.get_long().unwrap());
                let mut typed: Vec<OsString> = words(&path);
                typed.push(flag.clone().into());
                let Err(e) = parse(&typed) else { continue };
                if e.kind() != ErrorKind::ValueValidation {
                    continue;
                }
                let said = e.source().map(ToString::to_string).unwrap_or_default();
                numbers += 1;
                for foreign in
                    ["invalid float", "invalid digit", "non-zero type", "too large to fit", "out of range integral", "is not in "]
                {
                    assert!(!said.contains(foreign), "{path} {flag}: {said}");
                }
            }
        }
        assert!(numbers > 200, "{numbers}");
    }

    #[test]
    fn numbers_are_refused_with_what_was_expected_and_an_example() {
        for (line, expected) in [
            ("diopter shoot --turbidity thick", "\"thick\" is not a turbidity such as 3"),
            ("diopter shoot --frames x", "\"x\" is not a whole number, 0 or more, such as 4"),
            ("diopter read-out a.exr -o a.dng --shots 0", "\"0\" is not a whole number of 1 or more, such as 1"),
            ("diopter develop a.dng -o a.jpg --quality 0", "\"0\" is not a whole number from 1 to 100"),
            ("diopter dataset job a.toml -o a.yaml --items-per-task 0", "\"0\" is not a whole number of 1 or more"),
            ("diopter calc thin-lens --object 1m --magnification half", "\"half\" is not a magnification such as -0.5"),
            ("diopter shoot --shutter-angle half", "\"half\" is not an angle such as 90deg"),
        ] {
            let e = parse(&words(line)).unwrap_err();
            assert!(e.to_string().contains(expected), "{line}: {e}");
            let json = as_json(&e);
            let error = &json["error"];
            assert!(error["expected"].as_str().is_some_and(|v| expected.ends_with(v)), "{error}");
            assert!(error["place"].as_str().unwrap().starts_with("--"), "{error}");
        }
        // Angles, stops and wavelengths may carry their unit.
        let typed = "diopter shoot --shutter-angle 180deg --blade-rotation 15° --environment-rotation=-90deg --exposure-ev +1/3 --ambient-ev 12EV";
        let Verb::Shoot(shoot) = parse(&words(typed)).unwrap().verb else { panic!("shoot") };
        let said = &shoot.taking.said;
        assert_eq!(shoot.sequence.shutter_angle_deg, Some(180.0));
        assert_eq!((said.camera.blade_rotation_deg, said.scene.environment_rotation_deg), (Some(15.0), Some(-90.0)));
        assert_eq!(said.scene.ambient_ev, Some(12.0));
    }

    #[test]
    fn negative_values_reach_their_flags() {
        let taken = parse(&words("diopter shoot --focal-length -5mm --time-limit -1s --compensation -1/3")).unwrap();
        let Verb::Shoot(shoot) = taken.verb else { panic!("shoot") };
        assert_eq!(shoot.taking.said.camera.focal_length.unwrap().0, -5.0);
        assert_eq!(shoot.taking.said.render.time_limit.unwrap().0, -1.0);
        assert_eq!(shoot.taking.said.exposure.compensation.unwrap().0, -1.0 / 3.0);
        // What is wrong is the value, and no tip says to write it behind "--".
        let e = parse(&words("diopter shoot --spp -4")).unwrap_err().to_string();
        assert!(e.contains("invalid value '-4'") && !e.contains("-- -4"), "{e}");
        // A flag without a value, another flag and what follows "--" stay as they are.
        let typed = words("diopter shoot --strict -5 --lens --spp 4 -- --lens -5");
        assert_eq!(joined_negatives(&typed, &command()), typed);
    }

    #[test]
    fn every_flag_of_a_photograph_is_under_a_heading() {
        let command = command();
        for name in GROUPED {
            let verb = command.find_subcommand(name).unwrap();
            for a in verb.get_arguments().filter(|a| !a.is_positional()) {
                assert!(a.get_help_heading().is_some(), "{name} --{}", a.get_id());
                let heading = a.get_help_heading().unwrap();
                assert!(HEADINGS.contains(&heading), "{name} --{}: \"{heading}\" is none of HEADINGS", a.get_id());
            }
        }
        // And all that `-h` shows are flags.
        let shoot = command.find_subcommand("shoot").unwrap();
        for flag in COMMON {
            assert!(shoot.get_arguments().any(|a| a.get_long() == Some(flag)), "--{flag} is no flag");
        }
    }

    #[test]
    fn short_help_is_short_and_long_help_has_everything_in_order() {
        let (short, long) = (help("shoot", "-h"), help("shoot", "--help"));
        assert!(short.lines().count() <= 65, "{short}");
        let of_flags = short.lines().filter(|l| l.trim_start().starts_with('-'));
        for line in of_flags {
            assert!(line.chars().count() <= 130, "{line}");
        }
        assert!(short.contains("--lens ") && !short.contains("--microlens-gap"));
        assert!(long.contains("--lens ") && long.contains("--microlens-gap"));
        let places: Vec<usize> = HEADINGS.iter().map(|h| long.find(&format!("\n{h}:\n")).expect(h)).collect();
        assert!(places.is_sorted(), "{places:?}");
    }

    #[test]
    fn every_setting_of_one_picture_can_be_varied() {
        // Who makes the picture and where it goes, and how many there are.
        let others = [
            "bracket",
            "step",
            "frames",
            "focus-bracket",
            "focus-step",
            "staggered",
            "staggered-ratio",
            "staggered-gap",
            "merge",
            "stack",
            "dual-pixel",
            "output",
            "dng",
            "keep-plane",
            "truth",
            "truth-layout",
            "truth-sidecar",
            "plot-focus",
            "save-shot",
            "vary",
            "sheet",
            "json",
            "threads",
            "max-memory",
            "checkpoint",
            "no-resume",
            "resume",
            "recipe",
            "set",
            "help",
            "version",
        ];
        let command = command();
        let shoot = command.find_subcommand("shoot").unwrap();
        let flags = shoot.get_arguments().filter_map(|a| a.get_long());
        let flags: Vec<&str> = flags.filter(|f| !others.contains(f) && !f.starts_with("sheet-")).collect();
        assert!(flags.len() > 80, "{}", flags.len());
        for flag in flags {
            if let Err(e) = ShotFile::default().with(flag, "1") {
                assert!(!e.to_string().contains("a key of the shot file"), "--{flag}: {e}");
            }
        }
    }

    #[test]
    fn the_last_of_a_flag_given_twice_wins_and_lists_grow() {
        let args =
            parse(&words("diopter shoot --lens thin --quick --quick --lens pinhole -o a.jpg -o b.png --spp 1 --spp 2")).unwrap();
        let Verb::Shoot(shoot) = args.verb else { panic!("it is shoot") };
        let (camera, render) = (&shoot.taking.said.camera, &shoot.taking.said.render);
        assert_eq!((camera.lens.as_deref(), render.spp, render.quick), (Some("pinhole"), Some(2), true));
        assert_eq!(shoot.output.len(), 2);
    }

    #[test]
    fn errors_of_the_command_line_are_told_to_machines() {
        let typed = words("diopter shoot --json --spp many");
        assert!(wants_json(&typed) && !wants_json(&words("diopter shoot -- --json")));
        let e = as_json(&parse(&typed).unwrap_err());
        let e = &e["error"];
        assert_eq!((e["exit_code"].as_i64(), e["found"].as_str()), (Some(2), Some("many")), "{e}");
        assert!(e["place"].as_str().unwrap().contains("--spp") && e["message"].as_str().unwrap().contains("many"), "{e}");
        let e = as_json(&parse(&words("diopter shot --json")).unwrap_err());
        assert!(e["error"]["message"].as_str().unwrap().contains("shoot"), "{e}");
    }
}
