//! What pages and server say to each other over a WebSocket.
//!
//! A page sends commands as JSON texts ([`Command`]); the server sends JSON texts (`state`, `probe`, `problem`) and frames as binary messages
//! (`frame`). A command changes the shot by a merge patch (RFC 7396) in the words of shot files, so that everything that a shot file can say can
//! be set, and what is wrong is answered as on the command line.

use crate::pose::Motion;
use crate::problem::Problem;
use crate::series::Series;
use crate::timer;
use diopter::shot::ShotFile;
use serde::Deserialize;
use serde_json::{Map, Value};

/// Most bytes of a message from a page.
pub const LARGEST_MESSAGE: usize = 64 << 10;

/// What a page asks for.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(tag = "do", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Command {
    /// Change the shot: a merge patch.
    Set {
        /// Sections and keys of a shot file; null takes a key away.
        shot: Value,
    },
    /// Back to the shot of the command line.
    Reset {},
    /// Let autofocus find what is sharp at a place of the picture.
    Focus {
        /// 0 to 1 across and down.
        at: [f64; 2],
    },
    /// Take what is at a place of the picture for grey.
    White {
        /// 0 to 1 across and down.
        at: [f64; 2],
    },
    /// Move the camera.
    Move {
        /// How.
        how: Motion,
        /// By how much, to the right and down: radians of an orbit or a turn, fractions of the picture's width of a pan; of a dolly the second number, as
        /// the logarithm of the distance.
        by: [f64; 2],
    },
    /// Take the picture, or a series of them.
    Shoot {
        /// Left out: a single picture.
        #[serde(default)]
        series: Option<Series>,
        /// Seconds of the self-timer; left out: at once.
        #[serde(default)]
        timer_s: Option<f64>,
    },
    /// Stop the self-timer.
    CancelTimer {},
    /// Stop a picture that waits or is being taken.
    Cancel {
        /// Its number.
        id: u64,
    },
    /// Stop all pictures of a series that wait or are being taken.
    CancelSeries {
        /// The number of the series.
        id: u64,
    },
    /// Throw away a picture that was taken.
    Discard {
        /// Its number.
        id: u64,
    },
    /// A frame has been shown: the next may be sent.
    Ack {
        /// Its number.
        frame: u64,
    },
    /// Tell the numbers at a place of the picture.
    Probe {
        /// 0 to 1 across and down.
        at: [f64; 2],
    },
}

/// Reads a command. Fails on what is no JSON object with a known `do`, on places outside the picture, and on moves that are too large.
pub fn parse(text: &str) -> Result<Command, Problem> {
    let value: Value = serde_json::from_str(text).map_err(|e| Problem::new("message", excerpt(text), format!("JSON ({e})")))?;
    let Some(verb) = value.get("do").and_then(Value::as_str).map(str::to_owned) else {
        return Err(Problem::new("message", excerpt(text), "an object with \"do\", such as {\"do\": \"shoot\"}"));
    };
    let command: Command = serde_json::from_value(value)
        .map_err(|e| Problem::of_parser(format!("command \"{verb}\""), excerpt(text), &e.to_string()))?;
    let place = match &command {
        Command::Focus { at } | Command::White { at } | Command::Probe { at } => Some(*at),
        _ => None,
    };
    if let Some(at) = place.filter(|at| !at.iter().all(|v| (0.0..=1.0).contains(v))) {
        let found = format!("at {},{}", at[0], at[1]);
        return Err(Problem::new(verb, found, "a place in the picture: 0 to 1 across and down"));
    }
    if let Command::Move { by, .. } = &command
        && !by.iter().all(|v| v.is_finite() && v.abs() <= LARGEST_MOVE)
    {
        return Err(Problem::new(
            "move",
            format!("by {},{}", by[0], by[1]),
            format!("numbers from -{LARGEST_MOVE} to {LARGEST_MOVE}"),
        ));
    }
    if let Command::Shoot { series, timer_s } = &command {
        series.as_ref().map_or(Ok(()), Series::check)?;
        timer_s.map_or(Ok(()), timer::check)?;
    }
    Ok(command)
}

/// Most that one command moves the camera: once around, and a little.
const LARGEST_MOVE: f64 = 10.0;

/// The beginning of what was sent.
fn excerpt(text: &str) -> String {
    const LONGEST: usize = 80;
    match text.char_indices().nth(LONGEST) {
        None => text.to_owned(),
        Some((end, _)) => format!("{}...", &text[..end]),
    }
}

/// The shot as a JSON object in the words of shot files.
pub fn shot_as_json(shot: &ShotFile) -> Value {
    serde_json::to_value(shot).unwrap_or_else(|e| unreachable!("a shot file is plain data: {e}"))
}

/// A shot with a merge patch applied. Fails with the key that is wrong.
pub fn patched(shot: &ShotFile, patch: &Value) -> Result<ShotFile, Problem> {
    if !patch.is_object() {
        return Err(Problem::new(
            "set",
            excerpt(&patch.to_string()),
            "sections of a shot file, such as {\"exposure\": {\"iso\": 400}}",
        ));
    }
    let whole = shot_as_json(shot);
    let read = |patch: &Value| {
        let mut value = whole.clone();
        merge(&mut value, patch);
        serde_json::from_value::<ShotFile>(value)
    };
    read(patch).map_err(|e| {
        // Which of the keys it is shows when each is set alone.
        let mut keys = Vec::new();
        leaves(patch, String::new(), &mut keys);
        let one = |(path, value): &(String, Value)| {
            let alone =
                path.rsplit('.').fold(value.clone(), |inner, key| Value::Object(Map::from_iter([(key.to_owned(), inner)])));
            read(&alone).err().map(|e| (path.clone(), value.to_string(), e.to_string()))
        };
        match keys.iter().find_map(one) {
            Some((place, found, reason)) => Problem::of_parser(place, excerpt(&found), &reason),
            None => Problem::of_parser("set", excerpt(&patch.to_string()), &e.to_string()),
        }
    })
}

/// Merges a patch into a value (RFC 7396).
fn merge(value: &mut Value, patch: &Value) {
    let Value::Object(patch) = patch else {
        *value = patch.clone();
        return;
    };
    if !value.is_object() {
        *value = Value::Object(Map::new());
    }
    let Value::Object(object) = value else { return };
    for (key, of_patch) in patch {
        match of_patch {
            Value::Null => {
                object.remove(key);
            }
            _ => merge(object.entry(key.clone()).or_insert(Value::Null), of_patch),
        }
    }
}

/// Keys of a patch with their values; sections are named with dots.
fn leaves(patch: &Value, path: String, found: &mut Vec<(String, Value)>) {
    match patch {
        Value::Object(object) if !object.is_empty() => {
            for (key, value) in object {
                let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
                leaves(value, path, found);
            }
        }
        _ => found.push((path, patch.clone())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter::quantity::{FNumber, FocusTo};
    use serde_json::json;

    #[test]
    fn patches_are_in_the_words_of_shot_files() {
        let shot = ShotFile::default();
        let patch = json!({
            "exposure": { "aperture": "f/2.8", "iso": 400 }, "focus": { "distance": "2.5 m" }, "develop": { "tone": { "curve": "agx" } },
            "camera": { "look_from": [1, 2, 3] }, "render": { "size": "480x320" },
        });
        let changed = patched(&shot, &patch).unwrap();
        assert_eq!(changed.exposure.aperture, Some(FNumber(2.8)));
        assert!(matches!(changed.focus.distance, Some(FocusTo::Distance(d)) if d.0 == 2.5));
        assert_eq!(changed.camera.look_from, Some([1.0, 2.0, 3.0]));
        // As JSON it comes back, and null takes away.
        let again: ShotFile = serde_json::from_value(shot_as_json(&changed)).unwrap();
        assert_eq!(again, changed);
        let without = patched(&changed, &json!({ "exposure": { "aperture": null, "iso": null } })).unwrap();
        assert_eq!(without.exposure, shot.exposure);
        assert_eq!(without.camera, changed.camera);
    }

    #[test]
    fn wrong_keys_and_values_are_named() {
        let shot = ShotFile::default();
        for (patch, place, words) in [
            (json!({ "exposure": { "iso": 100, "aperture": "wide" } }), "exposure.aperture", "f/2.8"),
            (
                json!({ "exposure": { "apertur": "f/2" } }),
                "exposure.apertur",
                "apertur: unknown field `apertur`, expected one of",
            ),
            (json!({ "exposure": { "apertur": "f/2" } }), "exposure.apertur", "(did you mean `aperture`?)"),
            (json!({ "focus": { "distance": {} } }), "focus.distance", "2.5m"),
            (json!({ "develop": { "tone": { "curve": "sepia" } } }), "develop.tone.curve", "agx"),
            (json!([1]), "set", "sections"),
        ] {
            let problem = patched(&shot, &patch).unwrap_err();
            assert_eq!(problem.place.as_deref(), Some(place), "{problem:?}");
            assert!(problem.message.contains(words), "{problem:?}");
        }
    }

    #[test]
    fn malformed_messages_are_answered() {
        for text in [
            "",
            "nonsense",
            "{",
            "[]",
            "{}",
            "{\"do\": 5}",
            "{\"do\": \"fly\"}",
            "{\"do\": \"focus\"}",
            "{\"do\": \"focus\", \"at\": [0.5]}",
            "{\"do\": \"focus\", \"at\": [0.5, 2.0]}",
            "{\"do\": \"probe\", \"at\": [0.5, 0.5], \"more\": 1}",
            "{\"do\": \"move\", \"how\": \"orbit\", \"by\": [1e9, 0]}",
            "{\"do\": \"move\", \"how\": \"jump\", \"by\": [0, 0]}",
            "{\"do\": \"shoot\", \"series\": 3}",
            "{\"do\": \"shoot\", \"series\": {\"count\": 3}}",
            "{\"do\": \"shoot\", \"series\": {\"kind\": \"burst\", \"count\": 3}}",
            "{\"do\": \"shoot\", \"series\": {\"kind\": \"bracket\", \"count\": 3}}",
            "{\"do\": \"shoot\", \"series\": {\"kind\": \"bracket\", \"count\": -3, \"step_ev\": 1}}",
            "{\"do\": \"shoot\", \"series\": {\"kind\": \"bracket\", \"count\": 1, \"step_ev\": 1}}",
            "{\"do\": \"shoot\", \"series\": {\"kind\": \"bracket\", \"count\": 3, \"step_ev\": 0}}",
            "{\"do\": \"shoot\", \"series\": {\"kind\": \"bracket\", \"count\": 3, \"step_ev\": 1, \"near_m\": 1}}",
            "{\"do\": \"shoot\", \"series\": {\"kind\": \"focus\", \"count\": 3, \"near_m\": 2, \"far_m\": 1}}",
            "{\"do\": \"shoot\", \"timer_s\": 0}",
            "{\"do\": \"shoot\", \"timer_s\": 1e9}",
            "{\"do\": \"shoot\", \"timer_s\": \"soon\"}",
            "{\"do\": \"cancel-series\"}",
            "{\"do\": \"cancel-timer\", \"id\": 1}",
            "\u{0}\u{1}",
        ] {
            let problem = parse(text).unwrap_err();
            assert!(!problem.message.is_empty() && problem.place.is_some(), "{text}: {problem:?}");
        }
        // Nested too deeply for any use.
        assert!(parse(&"[".repeat(10_000)).is_err());
        let long = parse(&"ä".repeat(1000)).unwrap_err();
        assert!(long.found.is_some_and(|f| f.chars().count() < 90));
        assert_eq!(parse("{\"do\": \"shoot\"}"), Ok(Command::Shoot { series: None, timer_s: None }));
        let bracket =
            parse("{\"do\": \"shoot\", \"series\": {\"kind\": \"bracket\", \"count\": 3, \"step_ev\": 1}, \"timer_s\": 2}");
        let series = Some(Series::Bracket { count: 3, step_ev: 1.0 });
        assert_eq!(bracket, Ok(Command::Shoot { series, timer_s: Some(2.0) }));
        let stack =
            parse("{\"do\": \"shoot\", \"series\": {\"kind\": \"focus\", \"count\": 5, \"near_m\": 0.5, \"far_m\": null}}");
        let series = Some(Series::Focus { count: 5, near_m: 0.5, far_m: None });
        assert_eq!(stack, Ok(Command::Shoot { series, timer_s: None }));
        let moved = parse("{\"do\": \"move\", \"how\": \"dolly\", \"by\": [0, -0.1]}");
        assert_eq!(moved, Ok(Command::Move { how: Motion::Dolly, by: [0.0, -0.1] }));
    }

    #[test]
    fn problems_have_the_parts_of_the_command_line() {
        let problem = Problem::from(diopter::shot::read_lens("planr").unwrap_err());
        assert_eq!(problem.place.as_deref(), Some("lens"));
        assert_eq!(problem.found.as_deref(), Some("\"planr\""));
    }
}
