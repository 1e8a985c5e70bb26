//! Values of flags: how they are read from text, and how help lists names. Errors say what was found and what is expected.

use crate::quantity::{Ev, LengthMm, number};

/// Help of a flag that takes a name: what it is for, and the names.
pub fn one_of<T>(purpose: &str, names: &[(&str, T)]) -> String {
    format!("{purpose}: {}", alternatives(names))
}

/// Names that can be written: "a, b or c".
pub fn alternatives<T>(names: &[(&str, T)]) -> String {
    let names: Vec<&str> = names.iter().map(|n| n.0).collect();
    match names.split_last() {
        Some((last, before)) if !before.is_empty() => format!("{} or {last}", before.join(", ")),
        _ => names.join(", "),
    }
}

/// "x,y,z"; fails where it is not three numbers.
pub fn point(text: &str) -> Result<[f32; 3], String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers.and_then(|n| n.try_into().ok()).ok_or_else(|| format!("\"{text}\" is not three numbers such as 0,1.5,-2"))
}

/// "x,y"; fails where it is not two numbers.
pub fn pair(text: &str) -> Result<[f64; 2], String> {
    list(text)?.try_into().map_err(|_| format!("\"{text}\" is not two numbers such as 0,0.7"))
}

/// "90", "90deg" or "90°": degrees; fails where it is no finite number.
pub fn degrees(text: &str) -> Result<f64, String> {
    let bare = text.trim();
    let bare = bare.strip_suffix("deg").or_else(|| bare.strip_suffix('°')).unwrap_or(bare).trim();
    bare.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| format!("\"{text}\" is not an angle such as 90deg"))
}

/// The same, of settings in single precision.
pub fn degrees_f32(text: &str) -> Result<f32, String> {
    degrees(text).map(|v| v as f32)
}

/// "+1", "-1/3" or "0.5 EV": stops; fails where it is no finite number.
pub fn stops(text: &str) -> Result<f32, String> {
    text.parse::<Ev>().map(|ev| ev.0 as f32).map_err(|e| e.to_string())
}

/// "12" or "12 EV": an exposure value; fails where it is no finite number.
pub fn exposure_value(text: &str) -> Result<f64, String> {
    text.parse::<Ev>().map(|ev| ev.0).map_err(|_| format!("\"{text}\" is not an exposure value such as 12 or \"12 EV\""))
}

/// "550" or "550nm": a wavelength; fails where it is no finite number.
pub fn wavelength(text: &str) -> Result<f64, String> {
    let bare = text.trim();
    number(bare.strip_suffix("nm").unwrap_or(bare)).ok_or_else(|| format!("\"{text}\" is not a wavelength such as 550nm"))
}

/// "20", "-10C" or "20 °C": a temperature; fails where it is no finite number.
pub fn celsius(text: &str) -> Result<f64, String> {
    let bare = text.trim();
    let bare = bare.strip_suffix("°C").or_else(|| bare.strip_suffix('C')).unwrap_or(bare);
    number(bare).ok_or_else(|| format!("\"{text}\" is not a temperature such as 20C"))
}

/// "8deg" or "0,5deg": degrees about both axes, 0 for one that is left out; fails where one is no angle.
pub fn tilt(text: &str) -> Result<[f64; 2], String> {
    let (x, y) = text.split_once(',').unwrap_or((text, "0"));
    Ok([degrees(x)?, degrees(y)?])
}

/// "5mm", "5mm,-3mm" or "0,8mm": mm along both axes, 0 for one that is left out; fails where one is no length.
pub fn shift(text: &str) -> Result<[f64; 2], String> {
    let length = |part: &str| match part.trim() {
        "0" | "" => Some(0.0),
        part => part
            .strip_prefix('-')
            .map_or_else(|| part.parse::<LengthMm>().ok().map(|l| l.0), |p| p.parse::<LengthMm>().ok().map(|l| -l.0)),
    };
    let (x, y) = text.split_once(',').unwrap_or((text, "0"));
    length(x).zip(length(y)).map(|(x, y)| [x, y]).ok_or_else(|| format!("\"{text}\" is not a shift such as 5mm or 0,8mm"))
}

/// "a,b,c"; fails where it is not three numbers.
pub fn triple(text: &str) -> Result<[f64; 3], String> {
    list(text)?.try_into().map_err(|_| format!("\"{text}\" is not three numbers such as 0.01,0.04,20"))
}

/// A fraction: "0.25" or "1/4"; fails where it is no finite number.
pub fn fraction(text: &str) -> Result<f64, String> {
    number(text).ok_or_else(|| format!("\"{text}\" is not a fraction such as 0.25 or 1/4"))
}

/// Most samples a pixel: numbers of single precision count no further one by one.
pub const MOST_SAMPLES: u32 = 1 << 24;

/// Samples a pixel; fails where they are no whole number, none or more than [`MOST_SAMPLES`].
pub fn samples_a_pixel(text: &str) -> Result<u32, String> {
    let count = text.trim().parse().ok().filter(|n| (1..=MOST_SAMPLES).contains(n));
    count.ok_or_else(|| format!("\"{text}\" is not a number of samples from 1 to {MOST_SAMPLES}"))
}

/// Samples "A..B": the first, and one after the last; fails where they are not whole numbers.
pub fn range(text: &str) -> Result<[u32; 2], String> {
    let ends = text.split_once("..").and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    ends.ok_or_else(|| format!("\"{text}\" is not a range such as 0..64"))
}

/// "a,b,c"; fails where one is no finite number, or where there are more than 100.
pub fn list(text: &str) -> Result<Vec<f64>, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
    let numbers = numbers.filter(|n| !n.is_empty() && n.len() <= 100);
    numbers.ok_or_else(|| format!("\"{text}\" is not a list of numbers such as 0,10,14"))
}
