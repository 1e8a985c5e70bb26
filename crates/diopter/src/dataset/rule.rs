//! How the values of a varied setting come about.

use super::Setting;
use super::draw::{Draw, rounded};
use super::pose::Pose;
use super::spec::VarySection;
use crate::quantity::{self, Distance, Ev, FNumber, Filter, Hertz, Iso, LengthMm, Seconds};
use crate::sheet::text_of;
use crate::shot::ShotError;
use diopter_light::names::nearest;
use toml::Value;

/// A checked `[[vary]]`.
#[derive(Clone, Debug)]
pub(super) struct Vary {
    /// Of the settings; empty for a pose.
    pub names: Vec<String>,
    /// Where it stands, for errors: "[[vary]] 2 (iso)".
    pub place: String,
    rule: Rule,
    conditions: Vec<Condition>,
}

#[derive(Clone, Debug)]
enum Rule {
    /// Values of all settings, one after another.
    Cycle(Vec<Vec<Value>>),
    /// The same, as one of the axes of a grid: how many items have the same value before the next one comes.
    Grid {
        steps: Vec<Vec<Value>>,
        repeat: u64,
    },
    /// By chance: sums of the weights up to each, from 0 to 1.
    Choice {
        steps: Vec<Vec<Value>>,
        sums: Vec<f64>,
    },
    Range {
        from: Numbers,
        to: Numbers,
        log: bool,
        step: Option<f64>,
    },
    Normal {
        mean: Numbers,
        deviation: Numbers,
        within: Option<[Numbers; 2]>,
        step: Option<f64>,
    },
    Pose(Pose),
}

/// What a setting above must be.
#[derive(Clone, Debug)]
struct Condition {
    name: String,
    test: Test,
}

#[derive(Clone, Debug)]
enum Test {
    OneOf(Vec<Value>),
    /// The least and the largest, where they are given.
    Between([Option<Value>; 2]),
}

/// Two values in one unit, where they are of one kind: "20 ms" and "1/30 s", "ISO 400" and 400.
fn in_one_unit(a: &Value, b: &Value) -> Option<[f64; 2]> {
    fn parsed<T: std::str::FromStr>(texts: [&str; 2], number: fn(T) -> f64) -> Option<[f64; 2]> {
        let [a, b] = texts.map(|text| text.parse::<T>().ok().map(number));
        Some([a?, b?])
    }
    let is_plain = |n: &Numbers| n.prefix.is_empty() && n.suffix.is_empty() && n.values.len() == 1;
    let read = [a, b].map(Numbers::read);
    if let [Some(a), Some(b)] = &read
        && (is_plain(a) && is_plain(b) || a.values.len() == 1 && a.agrees(b))
    {
        return Some([a.values[0], b.values[0]]);
    }
    let [a, b] = [text_of(a), text_of(b)];
    let texts = [a.as_str(), b.as_str()];
    // A number without a unit is one of millimetres beside others of millimetres, of metres beside other lengths.
    let in_mm = || texts.iter().any(|t| t.trim().ends_with("mm")).then(|| parsed::<LengthMm>(texts, |v| v.0)).flatten();
    parsed::<Seconds>(texts, |v| v.0)
        .or_else(in_mm)
        .or_else(|| parsed::<Distance>(texts, |v| v.0))
        .or_else(|| parsed::<FNumber>(texts, |v| v.0))
        .or_else(|| parsed::<Iso>(texts, |v| v.0))
        .or_else(|| parsed::<Ev>(texts, |v| v.0))
        .or_else(|| parsed::<Filter>(texts, |v| v.0))
        .or_else(|| parsed::<Hertz>(texts, |v| v.0))
}

/// One or several numbers with what stands around them: "f/2.8", "1/125 s", `[0.0, 1.5]`.
#[derive(Clone, Debug, PartialEq)]
struct Numbers {
    prefix: String,
    values: Vec<f64>,
    suffix: String,
    is_list: bool,
    /// Whether it is the factor of a filter ("ND8"), which with a decimal point would be a density.
    is_factor: bool,
}

impl Numbers {
    fn read(value: &Value) -> Option<Numbers> {
        let plain = |values: Vec<f64>, is_list| Numbers {
            prefix: String::new(),
            values,
            suffix: String::new(),
            is_list,
            is_factor: false,
        };
        let number = |v: &Value| v.as_float().or_else(|| v.as_integer().map(|i| i as f64)).filter(|v| v.is_finite());
        match value {
            Value::String(text) => {
                let (prefix, value, suffix) = around_number(text)?;
                let is_factor = prefix.trim().eq_ignore_ascii_case("nd") && !text.contains('.');
                Some(Numbers { prefix, values: vec![value], suffix, is_list: false, is_factor })
            }
            Value::Array(list) if !list.is_empty() => Some(plain(list.iter().map(number).collect::<Option<_>>()?, true)),
            other => Some(plain(vec![number(other)?], false)),
        }
    }

    /// Whether both are of one kind and unit.
    fn agrees(&self, other: &Numbers) -> bool {
        let unit = |n: &Numbers| (n.prefix.trim().to_owned(), n.suffix.trim().to_owned(), n.values.len(), n.is_list, n.is_factor);
        unit(self) == unit(other)
    }

    /// The same with other numbers.
    fn with(&self, values: &[f64], step: Option<f64>) -> Value {
        // Of all items alike: with steps that are no whole numbers all are fractions, also 1.0.
        let whole = step.is_some_and(|s| s.fract() == 0.0);
        let plain = |v: f64| match whole && v.fract() == 0.0 && v.abs() < 9e15 {
            true => Value::Integer(v as i64),
            false => Value::Float(v),
        };
        if self.is_list {
            return Value::Array(values.iter().map(|v| plain(*v)).collect());
        }
        match self.prefix.is_empty() && self.suffix.is_empty() {
            true => plain(values[0]),
            // Between whole factors there are others.
            false if self.is_factor && values[0].fract() != 0.0 => Value::String(format!("{} stops", values[0].log2())),
            false => Value::String(format!("{}{}{}", self.prefix, values[0], self.suffix)),
        }
    }
}

/// The first number of a text, what stands before it and what behind.
fn around_number(text: &str) -> Option<(String, f64, String)> {
    let text = text.trim();
    let bytes = text.as_bytes();
    let digit = |i: usize| bytes.get(i).is_some_and(u8::is_ascii_digit);
    let mut start = (0..bytes.len()).find(|i| digit(*i))?;
    for signs in [&b"."[..], b"+-"] {
        if start > 0 && signs.contains(&bytes[start - 1]) {
            start -= 1;
        }
    }
    let run = |mut i: usize| {
        while digit(i) || bytes.get(i) == Some(&b'.') {
            i += 1;
        }
        i
    };
    let mut end = run(if b"+-".contains(&bytes[start]) { start + 1 } else { start });
    if matches!(bytes.get(end), Some(b'e' | b'E')) {
        let signed = end + 1 + usize::from(matches!(bytes.get(end + 1), Some(b'+' | b'-')));
        if digit(signed) {
            end = run(signed);
        }
    }
    if bytes.get(end) == Some(&b'/') && digit(end + 1) {
        end = run(end + 1);
    }
    Some((text[..start].to_owned(), quantity::number(&text[start..end])?, text[end..].trim_end().to_owned()))
}

/// The numbers of a value: one of "f/2.8", all of a list, none of a word.
pub(super) fn numbers(value: &Value) -> Vec<f64> {
    Numbers::read(value).map_or(Vec::new(), |n| n.values)
}

fn entry(place: &str, found: impl Into<String>, expected: impl Into<String>) -> ShotError {
    ShotError::Entry { place: place.to_owned(), found: found.into(), expected: expected.into() }
}

impl Vary {
    /// Checks an entry. `file`: what it is called in errors; `number`: which it is, from 1; `before`: the names of those above; `repeat`: the product of
    /// the grids above, which this one is multiplied into. Fails without a rule and with several, and on names, values, ranges,
    /// weights and conditions that do not suit it.
    pub fn new(section: &VarySection, file: &str, number: usize, before: &[String], repeat: &mut u64) -> Result<Vary, ShotError> {
        let names: Vec<String> = section.name.list().iter().map(|n| n.trim().to_owned()).collect();
        let shown = if section.pose.is_some() { "pose".to_owned() } else { names.join(":") };
        let place = format!("{file}: [[vary]] {number} ({shown})");
        let s = section;
        let rules = [
            ("values", s.values.is_some()),
            ("grid", s.grid.is_some()),
            ("choice", s.choice.is_some()),
            ("range", s.range.is_some() && s.normal.is_none()),
            ("normal", s.normal.is_some()),
            ("pose", s.pose.is_some()),
        ];
        let given: Vec<&str> = rules.iter().filter(|r| r.1).map(|r| r.0).collect();
        let [rule] = given[..] else {
            let found = if given.is_empty() { "no rule".to_owned() } else { given.join(" and ") };
            return Err(entry(&place, found, "one of values, grid, choice, range, normal and pose"));
        };
        match (rule, names.is_empty()) {
            ("pose", false) => {
                return Err(entry(&place, "a name beside pose", "no name: a pose sets camera.look_from and camera.look_at"));
            }
            ("pose", true) | (_, false) => {}
            (_, true) => return Err(entry(&place, "no name", "the name of a setting, such as name = \"iso\"")),
        }
        if names.iter().any(String::is_empty) {
            return Err(entry(&place, "an empty name", "the name of a setting, such as name = \"iso\""));
        }
        for (name, is_there, belongs) in [
            ("weights", s.weights.is_some(), rule == "choice"),
            ("scale", s.scale.is_some(), rule == "range"),
            ("step", s.step.is_some(), matches!(rule, "range" | "normal")),
        ] {
            if is_there && !belongs {
                return Err(entry(&place, format!("{name} beside {rule}"), format!("no {name} there")));
            }
        }
        if matches!(rule, "range" | "normal") && names.len() > 1 {
            return Err(entry(
                &place,
                format!("{} names", names.len()),
                format!("one name: settings of a {rule} do not change together"),
            ));
        }
        if let Some(step) = s.step.filter(|v| !(*v > 0.0 && v.is_finite())) {
            return Err(entry(&place, format!("step {step}"), "a number above 0"));
        }
        let steps = |list: &[Value]| -> Result<Vec<Vec<Value>>, ShotError> {
            if list.is_empty() {
                return Err(entry(&place, format!("{rule} is empty"), "a value at least"));
            }
            let step = |v: &Value| match v.as_array() {
                _ if names.len() == 1 => Ok(vec![v.clone()]),
                Some(all) if all.len() == names.len() => Ok(all.clone()),
                _ => Err(entry(
                    &place,
                    format!("\"{}\"", text_of(v)),
                    format!("a list with a value of each of the {} settings", names.len()),
                )),
            };
            list.iter().map(step).collect()
        };
        let rule = if let Some(list) = &s.values {
            Rule::Cycle(steps(list)?)
        } else if let Some(list) = &s.grid {
            if !s.when.is_empty() {
                return Err(entry(
                    &place,
                    "a condition (when) of a grid",
                    "no condition: all combinations are made; or values or choice instead",
                ));
            }
            let rule = Rule::Grid { steps: steps(list)?, repeat: *repeat };
            *repeat = repeat
                .checked_mul(list.len() as u64)
                .ok_or_else(|| entry(&place, "more than 2^64 combinations", "smaller grids"))?;
            rule
        } else if let Some(list) = &s.choice {
            let steps = steps(list)?;
            let weights = s.weights.clone().unwrap_or_else(|| vec![1.0; steps.len()]);
            let total: f64 = weights.iter().sum();
            if weights.len() != steps.len() || !weights.iter().all(|w| *w >= 0.0) || !(total > 0.0 && total.is_finite()) {
                let expected = format!("{} numbers of at least 0, one of them above", steps.len());
                return Err(entry(&place, format!("weights {weights:?}"), expected));
            }
            let mut sum = 0.0;
            let sums = weights.iter().map(|w| {
                sum += w / total;
                sum
            });
            let sums = sums.collect();
            Rule::Choice { steps, sums }
        } else if let Some(pose) = &s.pose {
            Rule::Pose(Pose::new(pose, &place)?)
        } else {
            let pair = |what: &str, list: &[Value]| -> Result<[Numbers; 2], ShotError> {
                let shown = || format!("{what} = [{}]", list.iter().map(text_of).collect::<Vec<_>>().join(", "));
                let expected = "two numbers of the same unit, such as [\"f/2\", \"f/8\"] or [100, 6400]";
                match list.iter().map(Numbers::read).collect::<Option<Vec<_>>>().as_deref() {
                    Some([a, b]) if a.agrees(b) => Ok([a.clone(), b.clone()]),
                    _ => Err(entry(&place, shown(), expected)),
                }
            };
            let bounds = s.range.as_deref().map(|list| pair("range", list)).transpose()?;
            let in_order = |a: &Numbers, b: &Numbers| a.values.iter().zip(&b.values).all(|(a, b)| a <= b);
            if let Some([from, to]) = bounds.as_ref().filter(|[a, b]| !in_order(a, b)) {
                return Err(entry(&place, format!("range from {:?} to {:?}", from.values, to.values), "the smaller value first"));
            }
            if let (Some([from, to]), Some(step)) = (&bounds, s.step) {
                let mut ends = from.values.iter().zip(&to.values);
                if let Some((from, to)) = ends.find(|(a, b)| multiples(**a, **b, Some(step)).is_none()) {
                    return Err(entry(
                        &place,
                        format!("step {step} from {from} to {to}"),
                        "a range that holds a multiple of the step",
                    ));
                }
            }
            match &s.normal {
                Some(list) => {
                    let [mean, deviation] = pair("normal", list)?;
                    if !deviation.values.iter().all(|v| *v >= 0.0) {
                        return Err(entry(
                            &place,
                            "a standard deviation below 0",
                            "mean and standard deviation, such as [50, 5]",
                        ));
                    }
                    if let Some([low, high]) = &bounds {
                        // What is drawn again until it lies within must have a chance.
                        let near = |k: usize| {
                            let (m, d) = (mean.values[k], deviation.values[k]);
                            let (low, high) = (low.values[k].max(m - 2.0 * d), high.values[k].min(m + 2.0 * d));
                            if d == 0.0 { low <= high } else { high - low >= 0.1 * d }
                        };
                        if !low.agrees(&mean) || !(0..mean.values.len()).all(near) {
                            let expected = "a range in the unit of the mean that covers a tenth of a standard deviation within two of them about it";
                            return Err(entry(&place, format!("range from {:?} to {:?}", low.values, high.values), expected));
                        }
                    }
                    Rule::Normal { mean, deviation, within: bounds, step: s.step }
                }
                None => {
                    let [from, to] = bounds.expect("the rule is a range");
                    let log = match s.scale.as_deref() {
                        None | Some("linear") => false,
                        Some("log") if from.values.iter().all(|v| *v > 0.0) => true,
                        Some("log") => return Err(entry(&place, format!("scale log from {:?}", from.values), "a range above 0")),
                        Some(other) => return Err(entry(&place, format!("scale \"{other}\""), "linear or log")),
                    };
                    Rule::Range { from, to, log, step: s.step }
                }
            }
        };
        let condition = |(name, value): (&String, &Value)| Condition::new(name, value, &place, before);
        let conditions = s.when.iter().map(condition).collect::<Result<_, _>>()?;
        Ok(Vary { names, place, rule, conditions })
    }

    /// Settings that it gives.
    pub fn settings(&self) -> Vec<String> {
        match &self.rule {
            Rule::Pose(_) => Pose::SETTINGS.map(str::to_owned).to_vec(),
            _ => self.names.clone(),
        }
    }

    /// Whether its values are listed one by one.
    pub fn is_listed(&self) -> bool {
        matches!(self.rule, Rule::Cycle(_) | Rule::Grid { .. } | Rule::Choice { .. })
    }

    /// Values that can be tried before any item is made: all that are listed, and the ends of ranges.
    pub fn samples(&self) -> Vec<Vec<Setting>> {
        let of = |values: &[Value]| self.names.iter().cloned().zip(values.iter().cloned()).collect();
        match &self.rule {
            Rule::Cycle(steps) | Rule::Grid { steps, .. } | Rule::Choice { steps, .. } => steps.iter().map(|v| of(v)).collect(),
            Rule::Range { from, to, step, .. } => {
                [from, to].map(|n| of(&[n.with(&inside(&n.values, from, to, *step), *step)])).to_vec()
            }
            Rule::Normal { mean, step, .. } => vec![of(&[mean.with(&stepped(&mean.values, *step), *step)])],
            Rule::Pose(_) => Vec::new(),
        }
    }

    /// The settings of an item; `None` where its conditions do not hold. `above`: what was drawn for it by the entries before.
    pub fn draw(&self, draw: &Draw, above: &[Setting]) -> Option<Vec<Setting>> {
        if !self.conditions.iter().all(|c| c.holds(above)) {
            return None;
        }
        let key = self.names.join(":");
        let of = |values: &[Value]| self.names.iter().cloned().zip(values.iter().cloned()).collect();
        let at = |steps: &[Vec<Value>], k: u64| of(&steps[(k % steps.len() as u64) as usize]);
        Some(match &self.rule {
            Rule::Cycle(steps) => at(steps, draw.item),
            Rule::Grid { steps, repeat } => at(steps, draw.item / repeat),
            Rule::Choice { steps, sums } => {
                let u = draw.uniform(&key, 0);
                // The last sum may be a little below 1: then the last one that has a weight.
                let last = sums.iter().position(|s| s == &sums[sums.len() - 1]).unwrap_or(0);
                of(&steps[sums.iter().position(|s| u < *s).unwrap_or(last)])
            }
            Rule::Range { from, to, log, step } => {
                let one = |(k, (a, b)): (usize, (&f64, &f64))| {
                    let u = draw.uniform(&key, k as u64);
                    // Rounded afterwards: of an even range each multiple has its own step, the first and the last too.
                    let (a, b) = multiples(*a, *b, *step).filter(|_| !log).map_or((*a, *b), |[a, b]| {
                        let half = 0.5 * step.unwrap_or(0.0);
                        (a - half, b + half)
                    });
                    rounded(if *log { (a.ln() + u * (b.ln() - a.ln())).exp() } else { a + u * (b - a) })
                };
                let drawn: Vec<f64> = from.values.iter().zip(&to.values).enumerate().map(one).collect();
                of(&[from.with(&inside(&drawn, from, to, *step), *step)])
            }
            Rule::Normal { mean, deviation, within, step } => {
                /// Of a range with at least half a per cent of the distribution all miss once in 10⁸ draws and less.
                const ATTEMPTS: u64 = 4096;
                let one = |k: usize| {
                    let value = |attempt: u64| {
                        rounded(
                            mean.values[k]
                                + deviation.values[k] * draw.normal(&key, attempt * mean.values.len() as u64 + k as u64),
                        )
                    };
                    match within {
                        None => value(0),
                        Some([low, high]) => {
                            let (low, high) = (low.values[k], high.values[k]);
                            let found = (0..ATTEMPTS).map(value).find(|v| (low..=high).contains(v));
                            found.unwrap_or_else(|| mean.values[k].clamp(low, high))
                        }
                    }
                };
                let drawn: Vec<f64> = (0..mean.values.len()).map(one).collect();
                let drawn = match within {
                    Some([low, high]) => inside(&drawn, low, high, *step),
                    None => stepped(&drawn, *step),
                };
                of(&[mean.with(&drawn, *step)])
            }
            Rule::Pose(pose) => pose.draw(draw),
        })
    }
}

/// Rounded to multiples of a step.
fn stepped(values: &[f64], step: Option<f64>) -> Vec<f64> {
    // Not -0: it would be another value than 0.
    values.iter().map(|v| step.map_or(*v, |s| rounded((v / s).round() * s) + 0.0)).collect()
}

/// The least and the largest multiple of a step between two numbers; `None` without a step, and where there is none.
fn multiples(from: f64, to: f64, step: Option<f64>) -> Option<[f64; 2]> {
    // What decimals make of a multiple is one.
    const ROUNDING: f64 = 1e-9;
    let step = step?;
    let [first, last] = [(from / step - ROUNDING).ceil(), (to / step + ROUNDING).floor()];
    (first <= last).then(|| [rounded(first * step), rounded(last * step)])
}

/// The same, and not beyond the ends of a range.
fn inside(values: &[f64], from: &Numbers, to: &Numbers, step: Option<f64>) -> Vec<f64> {
    let ends = from.values.iter().zip(&to.values).map(|(a, b)| multiples(*a, *b, step).unwrap_or([*a, *b]));
    stepped(values, step).into_iter().zip(ends).map(|(v, [a, b])| v.clamp(a, b)).collect()
}

impl Condition {
    fn new(name: &str, value: &Value, place: &str, before: &[String]) -> Result<Condition, ShotError> {
        if !before.iter().any(|b| b == name) {
            let hint =
                nearest(name, before.iter().map(String::as_str)).map_or(String::new(), |n| format!(" (did you mean \"{n}\"?)"));
            let found = format!("when \"{name}\"");
            return Err(entry(
                place,
                found,
                format!("the name of a setting that is varied further up, as it is written there{hint}"),
            ));
        }
        let test = match value {
            Value::Array(list) => Test::OneOf(list.clone()),
            Value::Table(table) => {
                let ends = ["min", "max"].map(|key| table.get(key).cloned());
                let is_number = |v: &Value| Numbers::read(v).is_some_and(|n| n.values.len() == 1);
                let known = table.keys().all(|k| k == "min" || k == "max");
                match ends.iter().flatten().all(is_number) {
                    true if known => Test::Between(ends),
                    _ => {
                        return Err(entry(
                            place,
                            format!("when {name} = {value}"),
                            "a value, a list of values, or { min = 100, max = 800 }",
                        ));
                    }
                }
            }
            other => Test::OneOf(vec![other.clone()]),
        };
        Ok(Condition { name: name.to_owned(), test })
    }

    fn holds(&self, above: &[Setting]) -> bool {
        // What was drawn last counts, as it does in the shot.
        let Some((_, value)) = above.iter().rev().find(|s| s.0 == self.name) else { return false };
        match &self.test {
            Test::OneOf(list) => {
                let is_same = |[a, b]: [f64; 2]| (a - b).abs() <= 1e-9 * a.abs();
                list.iter().any(|other| text_of(other) == text_of(value) || in_one_unit(value, other).is_some_and(is_same))
            }
            Test::Between([least, most]) => {
                let within = |end: &Option<Value>, test: fn([f64; 2]) -> bool| {
                    end.as_ref().is_none_or(|end| in_one_unit(value, end).is_some_and(test))
                };
                in_one_unit(value, value).is_some() && within(least, |[v, end]| v >= end) && within(most, |[v, end]| v <= end)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vary(text: &str) -> Result<Vary, ShotError> {
        let section: VarySection = toml::from_str(text).unwrap();
        Vary::new(&section, "spec.toml", 1, &["iso".into()], &mut 1)
    }

    fn numbers(text: &str, items: u64) -> Vec<f64> {
        let vary = vary(text).unwrap();
        let one = |item| vary.draw(&Draw { seed: 3, item }, &[]).unwrap().remove(0).1;
        (0..items).flat_map(|item| Numbers::read(&one(item)).unwrap().values).collect()
    }

    #[test]
    fn numbers_keep_what_stands_around_them() {
        for (text, prefix, number, suffix) in [
            ("f/2.8", "f/", 2.8, ""),
            ("1/125 s", "", 0.008, " s"),
            ("ISO 400", "ISO ", 400.0, ""),
            ("-1 EV", "", -1.0, " EV"),
            ("+1.5ev", "", 1.5, "ev"),
            ("1e-3", "", 0.001, ""),
            ("ND 0.9", "ND ", 0.9, ""),
            ("at .5", "at ", 0.5, ""),
        ] {
            let (a, b, c) = around_number(text).unwrap();
            assert_eq!((a.as_str(), b, c.as_str()), (prefix, number, suffix), "{text}");
        }
        assert!(around_number("auto").is_none());
    }

    #[test]
    fn ranges_are_filled_evenly() {
        let linear = numbers("name = \"aperture\"\nrange = [\"f/2\", \"f/6\"]", 4000);
        assert!(linear.iter().all(|v| (2.0..=6.0).contains(v)));
        // Standard deviation of the mean: 4 / √12 / √4000 = 0.018; five of them are allowed.
        assert!((linear.iter().sum::<f64>() / 4000.0 - 4.0).abs() < 0.09);
        let log = numbers("name = \"iso\"\nrange = [100, 6400]\nscale = \"log\"", 4000);
        let mean = log.iter().map(|v| v.log2()).sum::<f64>() / 4000.0;
        // From log2 100 to log2 6400 are six stops.
        assert!((mean - (100f64.log2() + 3.0)).abs() < 0.14, "{mean}");
        let whole = numbers("name = \"spp\"\nrange = [1, 4]\nstep = 1", 600);
        assert!((1..=4).all(|k| whole.contains(&f64::from(k))) && whole.iter().all(|v| v.fract() == 0.0));
        // Each as often: √(4000 · 1/4 · 3/4) = 27; five of them are allowed.
        let whole = numbers("name = \"spp\"\nrange = [1, 4]\nstep = 1", 4000);
        assert!((1..=4).all(|k| whole.iter().filter(|v| **v == f64::from(k)).count().abs_diff(1000) < 137));
        // Multiples, also where the ends are none.
        let hundreds = numbers("name = \"iso\"\nrange = [110, 390]\nstep = 100", 100);
        assert!(hundreds.iter().all(|v| [200.0, 300.0].contains(v)), "{hundreds:?}");
        let tenths = numbers("name = \"nd\"\nrange = [0.1, 0.3]\nstep = 0.1", 100);
        assert!([0.1, 0.2, 0.3].iter().all(|v| tenths.contains(v)) && tenths.iter().all(|v| *v < 0.301), "{tenths:?}");
        let pairs = numbers("name = \"sun\"\nrange = [[10, 0], [60, 360]]", 100);
        assert!(pairs.chunks(2).all(|p| (10.0..=60.0).contains(&p[0])) && pairs.chunks(2).any(|p| p[1] > 180.0));
    }

    #[test]
    fn values_keep_their_units() {
        let one = |text: &str| vary(text).unwrap().draw(&Draw { seed: 1, item: 0 }, &[]).unwrap().remove(0).1;
        let Value::String(aperture) = one("name = \"aperture\"\nrange = [\"f/2\", \"f/6\"]\nstep = 0.5") else {
            panic!("no text")
        };
        assert!(aperture.starts_with("f/") && aperture.len() <= 5, "{aperture}");
        assert!(matches!(one("name = \"spp\"\nrange = [4, 16]\nstep = 1"), Value::Integer(4..=16)));
        // Steps of a half: all are fractions, so that a column has one type.
        assert!(matches!(one("name = \"exposure-ev\"\nrange = [1, 1.2]\nstep = 0.5"), Value::Float(1.0)));
        assert!(matches!(one("name = \"fov\"\nrange = [40, 60]"), Value::Float(_)));
    }

    #[test]
    fn values_are_compared_in_one_unit() {
        let of = |text: &str| text.parse::<f64>().map_or_else(|_| Value::String(text.into()), Value::Float);
        for (a, b, least) in [
            ("1/30 s", "20 ms", false),
            ("500 us", "1 ms", true),
            ("20 ms", "0.03", true),
            ("50 cm", "1 m", true),
            ("35 mm", "50", true),
            ("f/2.8", "f/4", true),
            ("ISO 800", "400", false),
            ("ND8", "2 stops", false),
            ("-1 EV", "0", true),
            ("3", "10", true),
        ] {
            let [x, y] = in_one_unit(&of(a), &of(b)).unwrap_or_else(|| panic!("{a} {b}"));
            assert_eq!(x < y, least, "{a} {b}: {x} {y}");
        }
        assert!([("20 ms", "1 m"), ("auto", "3")].iter().all(|(a, b)| in_one_unit(&of(a), &of(b)).is_none()));
    }

    #[test]
    fn factors_of_filters_stay_factors() {
        let vary = vary("name = \"nd\"\nrange = [\"ND2\", \"ND8\"]").unwrap();
        for item in 0..50 {
            let (_, value) = vary.draw(&Draw { seed: 3, item }, &[]).unwrap().remove(0);
            let stops = text_of(&value).parse::<Filter>().unwrap().0;
            assert!((1.0..=3.0).contains(&stops), "{value}");
        }
        // A factor and a density are no range.
        assert!(super::tests::vary("name = \"nd\"\nrange = [\"ND2\", \"ND 0.9\"]").is_err());
    }

    #[test]
    fn steps_know_one_zero_and_logarithms_keep_their_shares() {
        let evs = numbers("name = \"compensation\"\nrange = [\"-1 EV\", \"1 EV\"]\nstep = 0.5", 200);
        assert!(evs.iter().all(|v| *v != 0.0 || v.is_sign_positive()) && evs.contains(&0.0));
        // ISO 100 stands for 100 to 150: ln 1.5 / ln 8 = 0.195 of all; √(4000 · 0.195 · 0.805) = 25; five of them are allowed.
        let log = numbers("name = \"iso\"\nrange = [100, 800]\nscale = \"log\"\nstep = 100", 4000);
        assert!(log.iter().filter(|v| **v == 100.0).count().abs_diff(780) < 126);
    }

    #[test]
    fn normal_values_stay_within_their_range() {
        let free = numbers("name = \"compensation\"\nnormal = [\"1 EV\", \"0.5 EV\"]", 4000);
        let mean = free.iter().sum::<f64>() / 4000.0;
        assert!((mean - 1.0).abs() < 0.04 && free.iter().any(|v| *v < 0.0), "{mean}");
        let bound = numbers("name = \"compensation\"\nnormal = [\"1 EV\", \"0.5 EV\"]\nrange = [\"1 EV\", \"1.2 EV\"]", 500);
        assert!(bound.iter().all(|v| (1.0..=1.2).contains(v)));
    }

    #[test]
    fn choices_have_their_weights() {
        let drawn = numbers("name = \"iso\"\nchoice = [1, 2, 3, 4]\nweights = [3, 1, 0, 0]", 4000);
        let first = drawn.iter().filter(|v| **v == 1.0).count();
        // √(4000 · 3/4 · 1/4) = 27; five of them are allowed.
        assert!(first.abs_diff(3000) < 137 && drawn.iter().all(|v| *v < 3.0), "{first}");
    }

    #[test]
    fn conditions_look_at_what_was_drawn() {
        let drawn = |when: &str, iso: Value| {
            let vary = vary(&format!("name = \"aperture\"\nvalues = [2]\nwhen = {{ iso = {when} }}")).unwrap();
            vary.draw(&Draw { seed: 1, item: 0 }, &[("iso".into(), iso)]).is_some()
        };
        assert!(drawn("400", Value::Integer(400)) && !drawn("400", Value::Integer(100)));
        assert!(drawn("[100, \"ISO 400\"]", Value::String("ISO 400".into())));
        assert!(drawn("{ min = 300 }", Value::String("ISO 400".into())) && !drawn("{ max = 300 }", Value::Integer(400)));
    }

    #[test]
    fn what_makes_no_rule_is_told() {
        let told = |text: &str| vary(text).unwrap_err().to_string();
        for (text, said) in [
            ("name = \"iso\"", "no rule"),
            ("name = \"iso\"\nvalues = [1]\nchoice = [2]", "values and choice"),
            ("name = \"iso\"\nvalues = []", "values is empty"),
            ("values = [1]", "the name of a setting"),
            ("name = \"iso\"\nrange = [1]", "two numbers of the same unit"),
            ("name = \"aperture\"\nrange = [\"f/2\", 8]", "two numbers of the same unit"),
            ("name = \"iso\"\nrange = [8, 1]", "the smaller value first"),
            ("name = \"iso\"\nrange = [110, 190]\nstep = 100", "a multiple of the step"),
            ("name = \"iso\"\nrange = [0, 1]\nscale = \"log\"", "above 0"),
            ("name = \"iso\"\nchoice = [1, 2]\nweights = [1]", "2 numbers"),
            ("name = \"iso\"\nvalues = [1]\nweights = [1]", "no weights there"),
            ("name = [\"iso\", \"aperture\"]\nvalues = [[1, 2], 3]", "each of the 2"),
            ("name = \"fov\"\nvalues = [1]\nwhen = { isso = 1 }", "did you mean \"iso\""),
            ("name = \"iso\"\ngrid = [1]\nwhen = { iso = 1 }", "all combinations"),
            ("name = \"iso\"\nnormal = [100, 1]\nrange = [500, 600]", "within two"),
        ] {
            let told = told(text);
            assert!(told.starts_with("spec.toml: [[vary]] 1") && told.contains(said), "{text}: {told}");
        }
    }
}
