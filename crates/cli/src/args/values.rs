//! Values of flags: how they are read from text.

use super::Checkpoint;
use diopter::quantity::Seconds;
use diopter::shot::flag_values;
use std::num::NonZeroUsize;

/// Numbers separated by commas.
#[derive(Clone, Debug, PartialEq)]
pub struct List(pub Vec<f64>);

/// "a,b,c".
pub fn list(text: &str) -> Result<List, String> {
    flag_values::list(text).map(List)
}

/// Words of `--focus` that take another: "--focus at 0.4,0.6" is "--focus 'at 0.4,0.6'".
pub fn joined_focus(args: impl Iterator<Item = std::ffi::OsString>) -> Vec<std::ffi::OsString> {
    let mut joined: Vec<std::ffi::OsString> = Vec::new();
    for arg in args {
        let waits = |word: &std::ffi::OsString| ["at", "on", "extension"].iter().any(|w| word == w);
        match joined.as_slice() {
            [.., flag, word] if flag == "--focus" && waits(word) => {
                let last = joined.last_mut().expect("it was just matched");
                last.push(" ");
                last.push(arg);
            }
            _ => joined.push(arg),
        }
    }
    joined
}

/// More than any machine has; each takes memory for its stack.
const MOST_THREADS: usize = 1024;

/// A number of threads.
pub(super) fn threads(text: &str) -> Result<NonZeroUsize, String> {
    let count = text.trim().parse().ok().filter(|n: &NonZeroUsize| n.get() <= MOST_THREADS);
    count.ok_or_else(|| format!("\"{text}\" is not a number of threads from 1 to {MOST_THREADS}"))
}

/// A part of a picture.
pub(super) fn rectangle(text: &str) -> Result<[usize; 4], String> {
    let wrong = || format!("\"{text}\" is not four whole numbers x,y,width,height such as 300,200,64,64");
    let numbers: Option<Vec<usize>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers.and_then(|n| n.try_into().ok()).ok_or_else(wrong)
}

/// Four corners.
pub(super) fn corners(text: &str) -> Result<[[f64; 2]; 4], String> {
    let [a, b, c, d, e, f, g, h] =
        list(text)?.0.try_into().map_err(|_| format!("\"{text}\" is not eight numbers: x,y of the four corners"))?;
    Ok([[a, b], [c, d], [e, f], [g, h]])
}

/// "30s" or "off".
pub(super) fn checkpoint(text: &str) -> Result<Checkpoint, String> {
    match text.parse::<Seconds>() {
        _ if text.trim() == "off" => Ok(Checkpoint::Off),
        Ok(Seconds(s)) if s > 0.0 => Ok(Checkpoint::Every(s)),
        _ => Err(format!("\"{text}\" is neither a time above 0, such as 30s, nor off")),
    }
}

/// A display's gamma, as the recipe names its encoding.
pub(super) fn gamma(text: &str) -> Result<&'static str, String> {
    match text.trim() {
        "1.8" => Ok("gamma-1.8"),
        "2.2" => Ok("gamma-2.2"),
        "2.4" => Ok("gamma-2.4"),
        "srgb" | "sRGB" => Ok("srgb"),
        _ => Err(format!("\"{text}\" is not a gamma: 1.8, 2.2, 2.4 or srgb")),
    }
}

/// Numbers of items: "0..200".
pub(super) fn items(text: &str) -> Result<[u64; 2], String> {
    let ends = text.split_once("..").and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    ends.filter(|[a, b]| a < b).ok_or_else(|| format!("\"{text}\" is not a range of items such as 0..200"))
}
