//! What is measured of a lens, and what is asked of it.

use super::parameter::Change;

/// Kinds of quantities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum QuantityKind {
    /// Effective focal length, mm.
    Efl,
    /// How far the compensator moved the film, mm.
    Refocus,
    /// Distance of the axial image from the axis, mm.
    Boresight,
    /// Its x, mm.
    BoresightX,
    /// Its y, mm.
    BoresightY,
    /// Root mean square spot radius of all wavelengths, µm.
    Spot,
    /// Root mean square wavefront error at the reference wavelength without tilt, waves.
    Wavefront,
    /// Distortion, per cent.
    Distortion,
    /// Contrast of all wavelengths together.
    Mtf,
    /// How far a compensator other than the film moved, mm or degrees; no limit names it, since its range is one.
    Compensator,
}

impl QuantityKind {
    /// Their names in sheets.
    pub const NAMES: [&str; 9] =
        ["efl", "refocus", "boresight", "boresight_x", "boresight_y", "spot", "wavefront", "distortion", "mtf"];
    const ALL: [QuantityKind; 9] = [
        QuantityKind::Efl,
        QuantityKind::Refocus,
        QuantityKind::Boresight,
        QuantityKind::BoresightX,
        QuantityKind::BoresightY,
        QuantityKind::Spot,
        QuantityKind::Wavefront,
        QuantityKind::Distortion,
        QuantityKind::Mtf,
    ];

    /// By its name.
    pub fn parse(name: &str) -> Option<QuantityKind> {
        QuantityKind::NAMES.iter().position(|n| *n == name).map(|i| QuantityKind::ALL[i])
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        QuantityKind::NAMES.get(self as usize).copied().unwrap_or("compensator")
    }

    fn unit(self) -> &'static str {
        match self {
            QuantityKind::Spot => "µm",
            QuantityKind::Wavefront => "waves",
            QuantityKind::Distortion => "%",
            QuantityKind::Mtf => "",
            _ => "mm",
        }
    }
}

/// Direction of an MTF.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Direction {
    /// Detail along the field's direction.
    Tangential,
    /// Detail across it.
    Sagittal,
}

impl Direction {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Direction::Tangential => "tangential",
            Direction::Sagittal => "sagittal",
        }
    }
}

/// One number that is measured of every lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    /// Which.
    pub kind: QuantityKind,
    /// Field angle, degrees, of what depends on it.
    pub field_deg: Option<f64>,
    /// Cycles/mm, of an MTF.
    pub frequency: Option<f64>,
    /// Of an MTF.
    pub direction: Option<Direction>,
    /// What a compensator changes.
    pub change: Option<Change>,
}

impl Quantity {
    /// Of the lens as a whole.
    pub(super) fn of_lens(kind: QuantityKind) -> Quantity {
        Quantity { kind, field_deg: None, frequency: None, direction: None, change: None }
    }

    /// Of a compensator.
    pub(super) fn of_compensator(change: Change) -> Quantity {
        Quantity { change: Some(change), ..Quantity::of_lens(QuantityKind::Compensator) }
    }

    /// Of a field.
    pub(super) fn of_field(kind: QuantityKind, field_deg: f64) -> Quantity {
        Quantity { field_deg: Some(field_deg), ..Quantity::of_lens(kind) }
    }

    /// Its unit.
    pub fn unit(&self) -> &'static str {
        self.change.map_or(self.kind.unit(), Change::unit)
    }

    /// What it is called: "mtf 30/mm tangential, field 10°".
    pub fn name(&self) -> String {
        let mut name = self.kind.name().to_owned();
        if let Some(change) = self.change {
            name = format!("{name}, {}", change.name());
        }
        if let Some(f) = self.frequency {
            name += &format!(" {f}/mm");
        }
        match self.direction {
            Some(Direction::Tangential) => name += " tangential",
            Some(Direction::Sagittal) => name += " sagittal",
            None => {}
        }
        if let Some(f) = self.field_deg {
            name += &format!(", field {f}°");
        }
        name
    }
}

/// What is asked of the quantities it matches.
#[derive(Clone, Debug, PartialEq)]
pub struct Limit {
    /// Line of the sheet.
    pub(super) line: usize,
    /// Which.
    pub kind: QuantityKind,
    /// Only of this field.
    pub field_deg: Option<f64>,
    /// Only at this frequency.
    pub frequency: Option<f64>,
    /// Only in this direction.
    pub direction: Option<Direction>,
    /// Not less than this.
    pub at_least: Option<f64>,
    /// Not more than this.
    pub at_most: Option<f64>,
}

impl Limit {
    /// Whether a quantity is limited by it.
    pub fn matches(&self, q: &Quantity) -> bool {
        let near = |asked: Option<f64>, is: Option<f64>| asked.is_none_or(|a| is.is_some_and(|i| (a - i).abs() < 1e-9));
        q.kind == self.kind
            && near(self.field_deg, q.field_deg)
            && near(self.frequency, q.frequency)
            && self.direction.is_none_or(|d| q.direction == Some(d))
    }

    /// Whether a value keeps it; what could not be measured does not.
    pub fn keeps(&self, value: f64) -> bool {
        value.is_finite() && self.at_least.is_none_or(|l| value >= l) && self.at_most.is_none_or(|m| value <= m)
    }

    /// What it asks: "mtf at least 0.4, field 10°".
    pub fn name(&self) -> String {
        let of = Quantity {
            field_deg: self.field_deg,
            frequency: self.frequency,
            direction: self.direction,
            ..Quantity::of_lens(self.kind)
        };
        let mut name = of.name();
        for (word, value) in [("at least", self.at_least), ("at most", self.at_most)] {
            if let Some(v) = value {
                name += &format!(", {word} {v}");
            }
        }
        name
    }
}

/// A quantity over many builds. Builds in which it could not be measured are left out and counted.
#[derive(Clone, Debug, PartialEq)]
pub struct Summary {
    /// Mean.
    pub mean: f64,
    /// Standard deviation (of the population that the builds are drawn from).
    pub deviation: f64,
    /// Values that 2, 10, 50, 90 and 98 % of the builds do not exceed.
    pub percentiles: [f64; 5],
    /// Smallest and largest.
    pub range: [f64; 2],
    /// Builds in which it could not be measured.
    pub missing: usize,
}

impl Summary {
    /// The fractions of [`Summary::percentiles`].
    pub const PERCENTS: [f64; 5] = [2.0, 10.0, 50.0, 90.0, 98.0];

    /// Statistics of the values of one quantity in the order of the builds; values that are not finite count as missing, and without any other the statistics are no number.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Summary {
        let (mut all, mut missing) = (vec![], 0);
        for v in values {
            if v.is_finite() { all.push(v) } else { missing += 1 }
        }
        let count = all.len() as f64;
        let mean = all.iter().sum::<f64>() / count;
        let deviation = (all.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / (count - 1.0).max(1.0)).sqrt();
        all.sort_by(f64::total_cmp);
        // Linear between neighbours.
        let at = |percent: f64| match all.len() {
            0 => f64::NAN,
            n => {
                let x = 0.01 * percent * (n - 1) as f64;
                let i = (x as usize).min(n - 1);
                all[i] + (all[(i + 1).min(n - 1)] - all[i]) * (x - i as f64)
            }
        };
        Summary { mean, deviation, percentiles: Summary::PERCENTS.map(at), range: [at(0.0), at(100.0)], missing }
    }
}

/// How many builds are good: the fraction, and the interval that holds the true one 95 times of 100 (Wilson 1927, J. Am. Stat. Assoc.
/// 22, 209).
pub fn yield_of(good: usize, builds: usize) -> (f64, [f64; 2]) {
    if builds == 0 {
        return (f64::NAN, [0.0, 1.0]);
    }
    const Z: f64 = 1.959_964;
    let n = builds as f64;
    let p = good as f64 / n;
    let middle = p + Z * Z / (2.0 * n);
    let half = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    let scale = 1.0 + Z * Z / n;
    (p, [((middle - half) / scale).max(0.0), ((middle + half) / scale).min(1.0)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn yield_has_wilsons_interval() {
        // Newcombe 1998, Statist. Med. 17, 857, table I: 81 of 263 → 0.2553 to 0.3662.
        let (p, [low, high]) = yield_of(81, 263);
        assert!((p - 0.307_984).abs() < 1e-6 && (low - 0.2553).abs() < 5e-5 && (high - 0.3662).abs() < 5e-5, "{low} {high}");
        assert!(yield_of(0, 20).1[0] == 0.0 && yield_of(20, 20).1[1] == 1.0);
    }

    #[test]
    fn names_and_kinds_are_in_one_order() {
        for name in QuantityKind::NAMES {
            assert_eq!(QuantityKind::parse(name).unwrap().name(), name);
        }
    }

    #[test]
    fn summaries_leave_out_what_could_not_be_measured() {
        let s = Summary::of((0..=100).map(f64::from).chain([f64::NAN]));
        assert_eq!((s.mean, s.missing, s.percentiles, s.range), (50.0, 1, [2.0, 10.0, 50.0, 90.0, 98.0], [0.0, 100.0]));
        assert!(
            !Limit {
                line: 0,
                kind: QuantityKind::Spot,
                field_deg: None,
                frequency: None,
                direction: None,
                at_least: None,
                at_most: Some(9.0)
            }
            .keeps(f64::NAN)
        );
    }
}
