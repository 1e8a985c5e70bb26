//! Autofocus: what a camera finds by looking at its pixels. Never looks at scene depth.
//!
//! Positions of the lens are film displacements from infinity, mm ([`diopter_lens::Focus::Extension`]). A probe shows a zone through the
//! real lens as the sensor reads it (`probe`); a [`measure`] says how sharp it is; `contrast` climbs to the sharpest position, slowly and
//! surely or fast; [`phase`] compares what the two halves of the pupil see and goes there at once. Zones that disagree are settled by a
//! [`Priority`].
//!
//! What "in focus" is worth is told in depths of focus, 2 N c with c the circle that is taken for sharp.

mod contrast;
pub mod measure;
pub mod motor;
pub mod phase;
mod probe;

pub use measure::Measure;
pub use motor::Motor;
pub use probe::View;

use crate::depth_of_field::CIRCLE_OF_DIAGONAL;
use crate::expose::ExposeError;
use diopter_lens::Lens;
use probe::Prober;
use serde::Serialize;
use std::time::Instant;

/// How the sharpest position is searched for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Method {
    /// Phase; contrast where that finds nothing in any zone: as in cameras, a zone without a phase signal does not hold up the others.
    #[default]
    Hybrid,
    /// By the halves of the pupil alone.
    Phase,
    /// By contrast, fast.
    Contrast,
    /// By contrast, every position.
    Exhaustive,
}

impl Method {
    /// Names as people write them.
    pub const NAMES: [(&'static str, Method); 4] = [
        ("hybrid", Method::Hybrid),
        ("phase", Method::Phase),
        ("contrast", Method::Contrast),
        ("exhaustive", Method::Exhaustive),
    ];
}

/// Which zone counts when they disagree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Priority {
    /// What is nearest: macro, and what most cameras do by themselves.
    #[default]
    Closest,
    /// What is farthest: background.
    Farthest,
    /// The middle one.
    Median,
    /// The middle one of the nearer half.
    FrontMedian,
    /// The middle one of the farther half.
    BackMedian,
    /// The zone nearest the middle of the picture.
    Centre,
    /// Where most zones agree within a depth of focus.
    Most,
}

impl Priority {
    /// Names as people write them.
    pub const NAMES: [(&'static str, Priority); 7] = [
        ("closest", Priority::Closest),
        ("farthest", Priority::Farthest),
        ("median", Priority::Median),
        ("front-median", Priority::FrontMedian),
        ("back-median", Priority::BackMedian),
        ("centre", Priority::Centre),
        ("most", Priority::Most),
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::NAMES.iter().find(|n| n.1 == self).map_or("", |n| n.0)
    }

    /// The priority of a name; macro, background, center.
    pub fn named(name: &str) -> Option<Priority> {
        match name.trim().to_lowercase().as_str() {
            "macro" | "nearest" => Some(Priority::Closest),
            "background" => Some(Priority::Farthest),
            "center" => Some(Priority::Centre),
            name => Self::NAMES.iter().find(|n| n.0 == name).map(|n| n.1),
        }
    }
}

/// Why a zone could not be focused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Failure {
    /// Noise hides what there is.
    TooDark,
    /// There is nothing to see at any position.
    NoContrast,
    /// It is sharpest nearer than the lens focuses.
    TooNear,
    /// It is sharpest beyond infinity.
    BeyondInfinity,
    /// Several positions look alike.
    Ambiguous,
    /// A peak too weak to be believed.
    Uncertain,
    /// The deadline had passed before it was looked at.
    NoTime,
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        f.write_str(match self {
            Failure::TooDark => "it is too dark",
            Failure::NoContrast => "there is no contrast",
            Failure::TooNear => "it is nearer than the lens focuses",
            Failure::BeyondInfinity => "the lens would have to go beyond infinity",
            Failure::Ambiguous => "the pattern repeats",
            Failure::Uncertain => "the peak is too weak",
            Failure::NoTime => "the time limit left no time to look",
        })
    }
}

/// What autofocus is set to.
#[derive(Clone, Debug, PartialEq)]
pub struct Autofocus {
    /// How it searches.
    pub method: Method,
    /// What it takes for sharp.
    pub measure: Measure,
    /// Where it looks: `[left, top, width, height]`, fractions of the picture.
    pub zones: Vec<[f64; 4]>,
    /// Which of them counts.
    pub priority: Priority,
    /// What moves the lens.
    pub motor: Motor,
    /// The circle that is taken for sharp, mm.
    pub circle_mm: f64,
    /// Step of the exhaustive search, mm; half the depth of focus without.
    pub step_mm: Option<f64>,
    /// Largest extension that is looked at, mm; as far as the lens goes without.
    pub reach_mm: Option<f64>,
    /// All positions from one extension to another in steps, mm, whatever the contrast does meanwhile: its curve is what is asked for. `exhaustive` alone.
    pub sweep_mm: Option<[f64; 3]>,
    /// After this no other zone is begun; the first always is, that nearest the middle of the picture before the others.
    pub deadline: Option<Instant>,
}

impl Autofocus {
    /// One zone in the middle, hybrid, for a film of this diagonal (mm).
    pub fn new(diagonal_mm: f64) -> Self {
        Autofocus {
            method: Method::default(),
            measure: Measure::default(),
            zones: zones_named("one").unwrap_or_default(),
            priority: Priority::default(),
            motor: Motor::IDEAL,
            circle_mm: diagonal_mm * CIRCLE_OF_DIAGONAL,
            step_mm: None,
            reach_mm: None,
            sweep_mm: None,
            deadline: None,
        }
    }

    /// Numbers of the zones in the order in which they are looked at.
    fn order(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.zones.len()).collect();
        if self.deadline.is_some() {
            order.sort_by(|a, b| off_middle(self.zones[*a]).total_cmp(&off_middle(self.zones[*b])));
        }
        order
    }

    fn is_late(&self) -> bool {
        self.deadline.is_some_and(|deadline| Instant::now() >= deadline)
    }
}

/// Distance of the middle of a zone from that of the picture, as a fraction of the picture.
fn off_middle([x, y, w, h]: [f64; 4]) -> f64 {
    (x + 0.5 * w - 0.5).hypot(y + 0.5 * h - 0.5)
}

/// Size of the zone in the middle, and of one about a point, as fractions of the picture.
const ONE: [f64; 2] = [0.14, 0.18];
const POINT: [f64; 2] = [0.06, 0.08];

/// Zones by name: `one` in the middle, `nine` spread over the picture.
pub fn zones_named(name: &str) -> Option<Vec<[f64; 4]>> {
    let about = |x: f64, y: f64, [w, h]: [f64; 2]| [x - 0.5 * w, y - 0.5 * h, w, h];
    match name {
        "one" => Some(vec![about(0.5, 0.5, ONE)]),
        "nine" => Some(
            (0..9).map(|k| about(0.5 + 0.25 * f64::from(k % 3 - 1), 0.5 + 0.25 * f64::from(k / 3 - 1), [0.1, 0.12])).collect(),
        ),
        _ => None,
    }
}

/// The small zone about a point of the picture, moved inside where it would stick out.
pub fn zone_at([x, y]: [f64; 2]) -> [f64; 4] {
    let [w, h] = POINT;
    [(x - 0.5 * w).clamp(0.0, 1.0 - w), (y - 0.5 * h).clamp(0.0, 1.0 - h), w, h]
}

/// Positions that a lens can take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Range {
    low: f64,
    high: f64,
    /// Up to here everyday subjects lie: looked at first.
    near: f64,
}

impl Range {
    /// From a little beyond infinity to the lens's near end, at most life size.
    pub(crate) fn of(lens: &Lens, circle_mm: f64) -> Range {
        let f = lens.focal_length().0;
        // Room to see that it gets worse again, also for what is seen in coarse cells.
        let low = -(0.01 * f).max(6.0 * lens.f_number() * circle_mm).min(0.1 * f);
        let high = match lens {
            Lens::Compound(l) => match diopter_lens::compound::nearest_focus(l.prescription(), l.state().zoom) {
                Some(nearest) => l.extension_at(nearest).min(f),
                None => f,
            },
            _ => f,
        };
        Range { low, high, near: (f / 9.0).min(high) }
    }

    /// Where a search begins.
    fn start(&self) -> f64 {
        0.5 * self.near
    }

    /// First the everyday part, then the rest.
    fn parts(&self) -> Vec<[f64; 2]> {
        let mut parts = vec![[self.low, self.near]];
        if self.high > self.near * 1.01 {
            parts.push([self.near, self.high]);
        }
        parts
    }
}

/// A position that was looked at.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Film displacement from infinity, mm.
    pub extension_mm: f64,
    /// Contrast without noise; of phase: the defocus found, mm.
    pub value: f64,
    /// What noise alone would show; of phase: the correlation.
    pub floor: f64,
    /// 0 the widest view, then closer and closer ones: values of different views cannot be compared.
    pub level: u32,
}

/// What was found in a zone.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Found {
    /// Where it was looked: `[left, top, width, height]`, fractions of the picture.
    pub zone: [f64; 4],
    /// Film displacement from infinity, mm.
    pub extension_mm: f64,
    /// 0 to 1; from ½ on it is believed.
    pub confidence: f64,
    /// Why not.
    pub failure: Option<Failure>,
    /// `phase` or `contrast`; `none` where there was no time.
    pub method: &'static str,
    /// Times the lens moved.
    pub moves: u32,
    /// Where it looked.
    pub curve: Vec<Point>,
}

impl Found {
    fn not_looked_at(zone: [f64; 4]) -> Found {
        let (failure, curve) = (Some(Failure::NoTime), Vec::new());
        Found { zone, extension_mm: 0.0, confidence: 0.0, failure, method: "none", moves: 0, curve }
    }
}

/// What autofocus did.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// What each zone says.
    pub zones: Vec<Found>,
    /// Number of the zone that counts; `None` when none can be believed.
    pub chosen: Option<usize>,
    /// Film displacement from infinity that was settled on, mm.
    pub extension_mm: f64,
    /// The distance that this stands for, m; `None` for infinity.
    pub distance_m: Option<f64>,
    /// Of the chosen zone.
    pub confidence: f64,
    /// `closest`, `farthest` ...
    pub priority: &'static str,
    /// Exposures taken.
    pub probes: u32,
    /// Rays traced into the scene.
    pub rays: u64,
    /// Way of the drive, mm, and time it and the probes took, s.
    pub travelled_mm: f64,
    /// The camera's time, not the computer's.
    pub seconds: f64,
}

impl Report {
    /// Why it failed, if it did: of the zone that came closest.
    pub fn failure(&self) -> Option<Failure> {
        match self.chosen {
            Some(_) => None,
            // There is one at least that was looked at.
            None => {
                let looked_at = self.zones.iter().filter(|z| z.failure != Some(Failure::NoTime));
                looked_at.max_by(|a, b| a.confidence.total_cmp(&b.confidence)).and_then(|z| z.failure)
            }
        }
    }
}

/// Looks for the sharpest position. Fails when stopped.
pub fn autofocus(view: &View, af: &Autofocus) -> Result<Report, ExposeError> {
    let mut range = Range::of(&view.camera.lens, af.circle_mm);
    if let Some(reach) = af.reach_mm {
        range.high = reach.max(range.low);
        range.near = range.near.min(range.high);
    }
    if let Some([from, to, _]) = af.sweep_mm {
        range = Range { low: from, high: to, near: to };
    }
    let mut prober = Prober::new(view, af.motor, range.start());
    let mut zones: Vec<Found> = af.zones.iter().map(|zone| Found::not_looked_at(*zone)).collect();
    for (looked_at, number) in af.order().into_iter().enumerate() {
        if looked_at > 0 && af.is_late() {
            break;
        }
        let zone = af.zones[number];
        zones[number] = match af.method {
            Method::Contrast => contrast::fast(&mut prober, af, zone, range)?,
            Method::Exhaustive => contrast::exhaustive(&mut prober, af, zone, range)?,
            Method::Phase | Method::Hybrid => phase::search(&mut prober, af, zone, range)?,
        };
    }
    let depth = 2.0 * view.camera.lens.f_number() * af.circle_mm;
    let mut chosen = choose(&zones, af.priority, depth);
    if chosen.is_none() && af.method == Method::Hybrid {
        for number in af.order() {
            if af.is_late() {
                break;
            }
            zones[number] = contrast::fast(&mut prober, af, af.zones[number], range)?;
        }
        chosen = choose(&zones, af.priority, depth);
    }
    let extension_mm = match chosen {
        Some((_, at)) => at,
        // As a snapshot is taken: from half the hyperfocal distance to infinity all is about sharp.
        None => {
            let f = view.camera.lens.focal_length().0;
            let hyperfocal = 1000.0 * crate::depth_of_field::hyperfocal_m(f, view.camera.lens.f_number(), af.circle_mm);
            (f * f / (hyperfocal - f)).min(range.high)
        }
    };
    prober.drive.go(extension_mm);
    let extension_mm = prober.drive.stands_mm();
    let lens = prober.view.camera.lens.with_extension(extension_mm);
    Ok(Report {
        chosen: chosen.map(|c| c.0),
        extension_mm,
        distance_m: lens.ok().and_then(|l| l.focus_distance()).map(|d| d.0 / 1000.0),
        confidence: chosen.map_or(zones.iter().map(|z| z.confidence).fold(0.0, f64::max).min(0.49), |c| zones[c.0].confidence),
        zones,
        priority: af.priority.name(),
        probes: prober.probes,
        rays: prober.rays,
        travelled_mm: prober.drive.travelled_mm,
        seconds: prober.drive.seconds,
    })
}

/// The middle one; of two the first.
fn middle(sorted: &[usize]) -> Option<usize> {
    sorted.get(sorted.len().checked_sub(1)? / 2).copied()
}

/// The zone that counts among those that are believed, and the position: that zone's, or the mean of those that agree with it.
pub fn choose(zones: &[Found], priority: Priority, depth_mm: f64) -> Option<(usize, f64)> {
    let mut sure: Vec<usize> = (0..zones.len()).filter(|k| zones[*k].failure.is_none() && zones[*k].confidence >= 0.5).collect();
    sure.sort_by(|a, b| zones[*a].extension_mm.total_cmp(&zones[*b].extension_mm));
    let at = |k: usize| zones[k].extension_mm;
    let own = |k: usize| (k, at(k));
    match priority {
        Priority::Closest => sure.last().copied().map(own),
        Priority::Farthest => sure.first().copied().map(own),
        Priority::Median => middle(&sure).map(own),
        // Of an odd number the middle one belongs to both halves.
        Priority::FrontMedian => middle(&sure[sure.len() / 2..]).map(own),
        Priority::BackMedian => middle(&sure[..sure.len().div_ceil(2)]).map(own),
        Priority::Centre => {
            let off = |k: &usize| off_middle(zones[*k].zone);
            sure.into_iter().min_by(|a, b| off(a).total_cmp(&off(b))).map(own)
        }
        Priority::Most => {
            // The longest run within a depth of focus; of equal ones the nearest to the camera.
            let run = |first: usize| sure[first..].iter().take_while(|k| at(**k) - at(sure[first]) <= depth_mm).count();
            let first = (0..sure.len()).max_by_key(|i| (run(*i), *i))?;
            let run = &sure[first..first + run(first)];
            Some((run[run.len() / 2], run.iter().map(|k| at(*k)).sum::<f64>() / run.len() as f64))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(extension_mm: f64, confidence: f64, zone: [f64; 4]) -> Found {
        Found { zone, extension_mm, confidence, failure: None, method: "contrast", moves: 1, curve: vec![] }
    }

    #[test]
    fn priorities_settle_zones_that_disagree() {
        let z = zones_named("nine").unwrap();
        let all: Vec<Found> = [0.2, 0.21, 0.9, 1.5, 0.5, 0.22, 3.0, 0.19, 1.4]
            .iter()
            .enumerate()
            .map(|(k, e)| found(*e, if k == 6 { 0.3 } else { 0.9 }, z[k]))
            .collect();
        // Zone 6 is not believed.
        assert_eq!(choose(&all, Priority::Closest, 0.1).unwrap(), (3, 1.5));
        assert_eq!(choose(&all, Priority::Farthest, 0.1).unwrap(), (7, 0.19));
        assert_eq!(choose(&all, Priority::Median, 0.1).unwrap(), (5, 0.22));
        // Sorted: 0.19 0.2 0.21 0.22 | 0.5 0.9 1.4 1.5.
        assert_eq!(choose(&all, Priority::FrontMedian, 0.1).unwrap(), (2, 0.9));
        assert_eq!(choose(&all, Priority::BackMedian, 0.1).unwrap(), (0, 0.2));
        assert_eq!(choose(&all[..1], Priority::FrontMedian, 0.1).unwrap(), (0, 0.2));
        assert_eq!(choose(&all[..1], Priority::BackMedian, 0.1).unwrap(), (0, 0.2));
        assert_eq!(choose(&all, Priority::Centre, 0.1).unwrap(), (4, 0.5));
        let (k, at) = choose(&all, Priority::Most, 0.1).unwrap();
        assert!([0, 1, 5, 7].contains(&k) && (at - 0.205).abs() < 1e-9, "{k} {at}");
        assert_eq!(choose(&[found(1.0, 0.2, z[0])], Priority::Closest, 0.1), None);
        assert_eq!(choose(&[], Priority::Most, 0.1), None);
    }

    #[test]
    fn with_a_deadline_the_middle_of_the_picture_comes_first() {
        let zones = zones_named("nine").unwrap();
        let af = Autofocus { zones, ..Autofocus::new(43.0) };
        assert_eq!(af.order(), (0..9).collect::<Vec<_>>());
        let begun = Instant::now();
        let hurried = Autofocus { deadline: Some(begun), ..af };
        assert_eq!(hurried.order()[0], 4);
        assert!(hurried.is_late());
    }

    #[test]
    fn names_lead_to_priorities() {
        for (name, p) in Priority::NAMES {
            assert_eq!(Priority::named(name), Some(p));
        }
        assert_eq!(Priority::named("macro"), Some(Priority::Closest));
        assert_eq!(Priority::named("background"), Some(Priority::Farthest));
        assert_eq!(Priority::named("whatever"), None);
    }
}
