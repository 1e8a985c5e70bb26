//! Values of flags: how they are read from text.

use super::Checkpoint;
use diopter::quantity::{LengthMm, Seconds};
use diopter::shot::file::Zones;

/// Numbers separated by commas.
#[derive(Clone, Debug, PartialEq)]
pub struct List(pub Vec<f64>);

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

/// "x,y,z".
pub(super) fn point(text: &str) -> Result<[f32; 3], String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers.and_then(|n| n.try_into().ok()).ok_or_else(|| format!("\"{text}\" is not three numbers such as 0,1.5,-2"))
}

/// "x,y".
pub(super) fn pair(text: &str) -> Result<[f64; 2], String> {
    list(text)?.0.try_into().map_err(|_| format!("\"{text}\" is not two numbers such as 0,0.7"))
}

/// "90", "90deg" or "90°".
pub(super) fn degrees(text: &str) -> Result<f64, String> {
    let bare = text.trim();
    let bare = bare.strip_suffix("deg").or_else(|| bare.strip_suffix('°')).unwrap_or(bare).trim();
    bare.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| format!("\"{text}\" is not an angle such as 90deg"))
}

/// "8deg" or "0,5deg".
pub(super) fn tilt(text: &str) -> Result<[f64; 2], String> {
    let (x, y) = text.split_once(',').unwrap_or((text, "0"));
    Ok([degrees(x)?, degrees(y)?])
}

/// "5mm", "5mm,-3mm" or "0,8mm".
pub(super) fn shift(text: &str) -> Result<[f64; 2], String> {
    let length = |part: &str| match part.trim() {
        "0" | "" => Some(0.0),
        part => part
            .strip_prefix('-')
            .map_or_else(|| part.parse::<LengthMm>().ok().map(|l| l.0), |p| p.parse::<LengthMm>().ok().map(|l| -l.0)),
    };
    let (x, y) = text.split_once(',').unwrap_or((text, "0"));
    length(x).zip(length(y)).map(|(x, y)| [x, y]).ok_or_else(|| format!("\"{text}\" is not a shift such as 5mm or 0,8mm"))
}

/// Three numbers.
pub(super) fn triple(text: &str) -> Result<[f64; 3], String> {
    list(text)?.0.try_into().map_err(|_| format!("\"{text}\" is not three numbers such as 0.01,0.04,20"))
}

/// Zones of autofocus.
pub(super) fn zones(text: &str) -> Result<Zones, String> {
    if !text.contains(',') {
        return Ok(Zones::Named(text.trim().to_owned()));
    }
    let zone = |part: &str| list(part)?.0.try_into().map_err(|_| format!("\"{part}\" is not a zone \"x,y,width,height\""));
    Ok(Zones::Boxes(text.split(';').filter(|p| !p.trim().is_empty()).map(zone).collect::<Result<_, String>>()?))
}

/// "a,b,c".
pub(super) fn list(text: &str) -> Result<List, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
    let numbers = numbers.filter(|n| !n.is_empty() && n.len() <= 100);
    numbers.map(List).ok_or_else(|| format!("\"{text}\" is not a list of numbers such as 0,10,14"))
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

/// A fraction: "0.25" or "1/4".
pub(super) fn fraction(text: &str) -> Result<f64, String> {
    diopter::quantity::number(text).ok_or_else(|| format!("\"{text}\" is not a fraction such as 0.25 or 1/4"))
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

/// "A..B".
/// Numbers of items: "0..200".
pub(super) fn items(text: &str) -> Result<[u64; 2], String> {
    let ends = text.split_once("..").and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    ends.filter(|[a, b]| a < b).ok_or_else(|| format!("\"{text}\" is not a range of items such as 0..200"))
}

pub(super) fn range(text: &str) -> Result<[u32; 2], String> {
    let ends = text.split_once("..").and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    ends.ok_or_else(|| format!("\"{text}\" is not a range such as 0..64"))
}
