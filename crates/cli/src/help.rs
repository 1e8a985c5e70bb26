//! How the command line is read and shown: headings of the flags of `shoot`, `expose` and `events`, the short help (`-h`), errors for machines.
//!
//! [`Args`] says which flags there are, and under which heading. Here headings are put in the order a photographer decides, and all flags but the most
//! used are left out of `-h`; `--help` and the manual pages show every flag.

use crate::args::Args;
use clap::error::{ContextKind, ContextValue};
use clap::{Arg, Command, CommandFactory, FromArgMatches};
use std::collections::HashSet;
use std::ffi::OsString;

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
    let mut matches = command.try_get_matches_from_mut(typed)?;
    Args::from_arg_matches_mut(&mut matches).map_err(|e| e.format(&mut command))
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
