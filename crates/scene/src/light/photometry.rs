//! Photometric data of lamps: intensity by direction as goniophotometers measure it, in IES files (LM-63).
//!
//! Sources: IES LM-63-19 and its editions of 1991, 1995 and 2002, "Standard File Format for Electronic Transfer of Photometric Data"; directions as
//! EXT_lights_ies (glTF) has them: a lamp is aimed along −z, where both angles are 0. Type C turns counter-clockwise about that axis from +x, seen
//! from behind the lamp; types A and B count horizontal angles to the right (+x) and vertical ones up (+y), A with the poles above and below, B with
//! the poles to the sides. Between measured angles intensity is interpolated linearly in both. The file's own unit is the candela, so that stated
//! lumens need no second look: they are the integral. Limits: the lamp is a point; `TILT` data, which are about lamps that burn inclined, are read
//! over.

use crate::exact::{Exact, Sink, Source, exact_enum, field};
use glam::Vec3;
use serde_json::Value;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Most angles of either kind, and most intensities: files of a tenth of a degree are below.
const MOST_ANGLES: usize = 8192;
const MOST_VALUES: usize = 1 << 22;

/// How the two angles span the sphere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Photometry {
    /// Poles above and below: headlamps.
    A,
    /// Poles to the sides: floodlights.
    B,
    /// Poles ahead and behind: indoor and road lighting.
    C,
}

/// Intensity of a lamp by direction.
#[derive(Clone, Debug, PartialEq)]
pub struct Web {
    kind: Photometry,
    /// Degrees, rising.
    horizontal: Vec<f32>,
    vertical: Vec<f32>,
    /// cd, `[horizontal][vertical]`.
    candela: Vec<f32>,
    /// Largest of them, cd.
    peak: f32,
    /// Their integral over the sphere, lm.
    lumens: f64,
}

/// Why a file is none.
#[derive(Clone, Debug, PartialEq)]
pub struct NotPhotometric {
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: &'static str,
}

fn fault<T>(found: impl Into<String>, expected: &'static str) -> Result<T, NotPhotometric> {
    Err(NotPhotometric { found: found.into(), expected })
}

/// The numbers of a file, one after the other.
struct Numbers<'a> {
    words: Box<dyn Iterator<Item = &'a str> + 'a>,
}

impl Numbers<'_> {
    fn next(&mut self, what: &str) -> Result<f64, NotPhotometric> {
        let Some(word) = self.words.next() else {
            return fault(format!("the end of the file where {what} should be"), "a whole IES file (LM-63)");
        };
        match word.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => fault(format!("\"{}\" as {what}", word.chars().take(40).collect::<String>()), "a number"),
        }
    }

    fn count(&mut self, what: &str) -> Result<usize, NotPhotometric> {
        let n = self.next(what)?;
        if n.fract() == 0.0 && (1.0..=MOST_ANGLES as f64).contains(&n) {
            return Ok(n as usize);
        }
        fault(format!("{n} as {what}"), "a whole number from 1 to 8192")
    }

    fn angles(&mut self, count: usize, what: &str) -> Result<Vec<f32>, NotPhotometric> {
        let all: Vec<f32> = (0..count).map(|_| self.next(what).map(|v| v as f32)).collect::<Result<_, _>>()?;
        if all.windows(2).any(|w| w[0] >= w[1]) || all.iter().any(|a| a.abs() > 360.0) {
            return fault(format!("{what}s that do not rise, or beyond 360°"), "rising angles in degrees");
        }
        Ok(all)
    }
}

impl Web {
    /// Reads an IES file. Fails without a line `TILT=`, where a number is missing or is none, angles do not rise or fit no symmetry of their type, an intensity is below
    /// 0, or all are 0.
    pub fn read(bytes: &[u8]) -> Result<Web, NotPhotometric> {
        let text = String::from_utf8_lossy(bytes);
        // Keywords and notes come before the line of TILT, numbers behind it.
        let mut lines = text.lines();
        let Some(tilt) = lines.by_ref().find_map(|l| l.trim().strip_prefix("TILT=").map(str::trim)) else {
            return fault("no line TILT=", "an IES file (LM-63): notes, TILT=NONE, numbers");
        };
        let words = lines.flat_map(|l| l.split(|c: char| c.is_ascii_whitespace() || c == ',')).filter(|w| !w.is_empty());
        let mut numbers = Numbers { words: Box::new(words) };
        if tilt.eq_ignore_ascii_case("INCLUDE") {
            numbers.next("lamp-to-luminaire geometry")?;
            let pairs = numbers.count("the number of tilt angles")?;
            for _ in 0..2 * pairs {
                numbers.next("tilt data")?;
            }
        }
        numbers.next("the number of lamps")?;
        numbers.next("lumens per lamp")?;
        let mut factor = numbers.next("the candela multiplier")?;
        let (vertical, horizontal) =
            (numbers.count("the number of vertical angles")?, numbers.count("the number of horizontal angles")?);
        let kind = match numbers.next("the photometric type")? {
            1.0 => Photometry::C,
            2.0 => Photometry::B,
            3.0 => Photometry::A,
            other => return fault(format!("photometric type {other}"), "1 (C), 2 (B) or 3 (A)"),
        };
        for what in ["the units", "the width", "the length", "the height"] {
            numbers.next(what)?;
        }
        // Of the ballast, and of ballast and lamp together; the second became "future use", 1, in 2002.
        factor *= numbers.next("the ballast factor")?;
        // Some programs write 0 there.
        factor *= Some(numbers.next("the ballast-lamp factor")?).filter(|f| *f != 0.0).unwrap_or(1.0);
        numbers.next("the input watts")?;
        if !(factor > 0.0 && factor.is_finite()) {
            return fault(format!("a candela multiplier and ballast factors that make {factor}"), "factors above 0");
        }
        if vertical * horizontal > MOST_VALUES {
            return fault(format!("{vertical} × {horizontal} angles"), "at most 4 million intensities");
        }
        let (vertical, horizontal) =
            (numbers.angles(vertical, "vertical angle")?, numbers.angles(horizontal, "horizontal angle")?);
        let value = |_| {
            let cd = numbers.next("an intensity")? * factor;
            if cd >= 0.0 && cd <= f64::from(f32::MAX) {
                Ok(cd as f32)
            } else {
                fault(format!("an intensity of {cd} cd"), "0 cd or more")
            }
        };
        let candela: Vec<f32> = (0..vertical.len() * horizontal.len()).map(value).collect::<Result<_, _>>()?;
        Web::new(kind, horizontal, vertical, candela)
    }

    /// A lamp that is the same all around its axis, by intensities (cd) at rising angles to it (degrees, from 0). Fails where all are 0.
    pub(crate) fn round(vertical: Vec<f32>, candela: Vec<f32>) -> Result<Web, NotPhotometric> {
        Web::new(Photometry::C, vec![0.0], vertical, candela)
    }

    fn new(kind: Photometry, horizontal: Vec<f32>, vertical: Vec<f32>, candela: Vec<f32>) -> Result<Web, NotPhotometric> {
        let peak = candela.iter().copied().fold(0.0, f32::max);
        let mut web = Web { kind, horizontal, vertical, candela, peak, lumens: 0.0 };
        web.check_range()?;
        if web.peak <= 0.0 {
            return fault("a lamp that is dark everywhere", "an intensity above 0");
        }
        web.lumens = web.integral();
        Ok(web)
    }

    /// Whether its horizontal angles are of a symmetry that the standard has.
    fn check_range(&self) -> Result<(), NotPhotometric> {
        let (first, last) = (self.horizontal[0], self.horizontal[self.horizontal.len() - 1]);
        let known = match self.kind {
            Photometry::C => (first == 0.0 && (0.0..=360.0).contains(&last)) || (first == 90.0 && last == 270.0),
            Photometry::A | Photometry::B => first >= -180.0 && last <= 180.0,
        };
        if known {
            return Ok(());
        }
        fault(
            format!("horizontal angles from {first}° to {last}°"),
            "0 to 0, 90, 180 or 360°, or 90 to 270° (type C); within −180 to 180° (types A and B)",
        )
    }

    /// How its angles span the sphere.
    pub fn kind(&self) -> Photometry {
        self.kind
    }

    /// Largest intensity, cd.
    pub fn peak(&self) -> f32 {
        self.peak
    }

    /// Luminous flux, lm: the integral of intensity over the sphere.
    pub fn lumens(&self) -> f64 {
        self.lumens
    }

    fn integral(&self) -> f64 {
        // Rings about the axis: finer than the half degree of most files.
        const RINGS: usize = 720;
        const SECTORS: usize = 360;
        let mut sum = 0.0;
        for i in 0..RINGS {
            let (from, to) = (PI * i as f64 / RINGS as f64, PI * (i + 1) as f64 / RINGS as f64);
            let theta = 0.5 * (from + to);
            let ring: f64 = (0..SECTORS)
                .map(|j| {
                    let phi = TAU * (j as f64 + 0.5) / SECTORS as f64;
                    let d = glam::DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), -theta.cos());
                    f64::from(self.candela(d.as_vec3()))
                })
                .sum();
            sum += ring * TAU / SECTORS as f64 * (from.cos() - to.cos());
        }
        sum
    }

    /// Intensity in a direction of any length, cd, linear between measured angles; 0 where nothing was measured.
    pub fn candela(&self, direction: Vec3) -> f32 {
        let d = direction.normalize_or_zero();
        let degrees = |v: f32| v.to_degrees();
        let (horizontal, vertical) = match self.kind {
            Photometry::C => (self.folded(degrees(d.y.atan2(d.x))), degrees(d.x.hypot(d.y).atan2(-d.z))),
            Photometry::A => (self.sideways(degrees(d.x.atan2(-d.z))), degrees(d.y.atan2(d.x.hypot(d.z)))),
            Photometry::B => (self.sideways(degrees(d.x.atan2(d.y.hypot(d.z)))), degrees(d.y.atan2(-d.z))),
        };
        let Some((j, v)) = between(&self.vertical, vertical) else { return 0.0 };
        let rows = self.vertical.len();
        let at = |i: usize| {
            let row = &self.candela[i * rows..(i + 1) * rows];
            row[j] + (row[(j + 1).min(rows - 1)] - row[j]) * v
        };
        let last = self.horizontal.len() - 1;
        if last == 0 {
            return at(0);
        }
        match between(&self.horizontal, horizontal) {
            Some((i, h)) => at(i) + (at((i + 1).min(last)) - at(i)) * h,
            // Files that do not repeat the first plane at 360°.
            None if self.kind == Photometry::C && self.horizontal[last] > 180.0 => {
                let h = (horizontal - self.horizontal[last]) / (360.0 - self.horizontal[last]);
                at(last) + (at(0) - at(last)) * h
            }
            None => 0.0,
        }
    }

    /// A horizontal angle of type C, by the symmetry of the lamp, degrees.
    fn folded(&self, horizontal: f32) -> f32 {
        let h = horizontal.rem_euclid(360.0);
        let half = if h > 180.0 { 360.0 - h } else { h };
        match (self.horizontal[0], self.horizontal[self.horizontal.len() - 1]) {
            (90.0, _) if h < 90.0 => 180.0 - h,
            (90.0, _) if h > 270.0 => 540.0 - h,
            (90.0, _) => h,
            // Of four quarters that are alike, or two halves; what else ends below 180° ends there.
            (_, last) if last <= 90.0 => {
                if half > 90.0 {
                    180.0 - half
                } else {
                    half
                }
            }
            (_, last) if last <= 180.0 => half,
            _ => h,
        }
    }

    /// One of types A and B: those that begin at 0 are alike on both sides.
    fn sideways(&self, horizontal: f32) -> f32 {
        if self.horizontal[0] >= 0.0 { horizontal.abs() } else { horizontal }
    }
}

/// The place of an angle among rising ones: the one below, and the fraction of the way to the next; `None` beyond them, by more than rounding.
fn between(angles: &[f32], angle: f32) -> Option<(usize, f32)> {
    const ROUNDING: f32 = 1e-3;
    let last = angles.len() - 1;
    if !(angle >= angles[0] - ROUNDING && angle <= angles[last] + ROUNDING) {
        return None;
    }
    let i = angles.partition_point(|a| *a <= angle).saturating_sub(1).min(last.saturating_sub(1));
    if last == 0 {
        return Some((0, 0.0));
    }
    Some((i, ((angle - angles[i]) / (angles[i + 1] - angles[i])).clamp(0.0, 1.0)))
}

exact_enum!(Photometry { A, B, C });

impl Exact for Arc<Web> {
    fn write(&self, sink: &mut Sink) -> Value {
        let object = [
            ("kind", self.kind.write(sink)),
            ("horizontal", self.horizontal.write(sink)),
            ("vertical", self.vertical.write(sink)),
            ("candela", self.candela.write(sink)),
            ("peak", self.peak.write(sink)),
            ("lumens", self.lumens.write(sink)),
        ];
        object.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let web = Web {
            kind: field(value, "kind", source)?,
            horizontal: field(value, "horizontal", source)?,
            vertical: field(value, "vertical", source)?,
            candela: field(value, "candela", source)?,
            peak: field(value, "peak", source)?,
            lumens: field(value, "lumens", source)?,
        };
        let count = web.horizontal.len().checked_mul(web.vertical.len());
        match count == Some(web.candela.len()) && !web.candela.is_empty() && web.peak > 0.0 {
            true => Ok(Arc::new(web)),
            false => Err("measured intensities whose lists do not fit each other".into()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(numbers: &str) -> Vec<u8> {
        format!("IESNA:LM-63-2002\r\n[TEST] made up\r\n[MANUFAC] nobody\r\nTILT=NONE\r\n{numbers}").into_bytes()
    }

    /// A direction of type C, degrees.
    fn c(vertical: f32, horizontal: f32) -> Vec3 {
        let ((sv, cv), (sh, ch)) = (vertical.to_radians().sin_cos(), horizontal.to_radians().sin_cos());
        Vec3::new(sv * ch, sv * sh, -cv)
    }

    fn close(found: f32, expected: f32) {
        assert!((found - expected).abs() <= 1e-3 * expected.abs().max(1.0), "{found} {expected}");
    }

    #[test]
    fn an_even_lamp_sends_out_four_pi_and_a_cosine_pi_times_its_peak() {
        let even = Web::read(&file("1 1000 2.0 2 1 1 2 0 0 0 0.5 1.0 60\n0 180\n0\n100 100\n")).unwrap();
        assert_eq!((even.peak(), even.kind()), (100.0, Photometry::C));
        assert!((even.lumens() / (400.0 * PI) - 1.0).abs() < 1e-6);
        // A Lambertian lamp at every 5°, down only; linear between: 0.1 %.
        let angles: Vec<String> = (0..=18).map(|i| (5 * i).to_string()).collect();
        let values: Vec<String> = (0..=18).map(|i| (1000.0 * (5.0 * i as f64).to_radians().cos()).to_string()).collect();
        let text = format!("1 -1 1 19 1 1 2 0,0,0 1 1 60\n{}\n0\n{}\n", angles.join(" "), values.join("\n"));
        let lambert = Web::read(&file(&text)).unwrap();
        assert!((lambert.lumens() / (1000.0 * PI) - 1.0).abs() < 2e-3, "{}", lambert.lumens());
        close(lambert.candela(c(30.0, 77.0) * 5.0), 866.0254);
        close(lambert.candela(c(32.5, 200.0)), 0.5 * (866.0254 + 819.152));
        assert_eq!(lambert.candela(Vec3::Z), 0.0);
    }

    #[test]
    fn symmetries_of_type_c_are_those_of_the_standard() {
        // At 90°: the horizontal angle itself, in cd; below, 0.
        let lamp = |horizontal: &[u32]| {
            let angles = horizontal.iter().map(u32::to_string).collect::<Vec<_>>().join(" ");
            let values = horizontal.iter().map(|h| format!("0 {h}")).collect::<Vec<_>>().join("\n");
            let n = horizontal.len();
            Web::read(&file(&format!("1 1 1 2 {n} 1 1 0 0 0 1 1 1\n0 90\n{angles}\n{values}\n"))).unwrap()
        };
        type Case = (&'static [u32], [(f32, f32); 4]);
        let cases: [Case; 5] = [
            (&[0, 45, 90], [(30.0, 30.0), (150.0, 30.0), (210.0, 30.0), (300.0, 60.0)]),
            (&[0, 90, 180], [(30.0, 30.0), (150.0, 150.0), (210.0, 150.0), (330.0, 30.0)]),
            (&[0, 90, 180, 270, 360], [(30.0, 30.0), (150.0, 150.0), (210.0, 210.0), (330.0, 330.0)]),
            // The last plane is the first again.
            (&[0, 90, 180, 270], [(30.0, 30.0), (150.0, 150.0), (270.0, 270.0), (315.0, 135.0)]),
            (&[90, 180, 270], [(100.0, 100.0), (80.0, 100.0), (260.0, 260.0), (280.0, 260.0)]),
        ];
        for (horizontal, expected) in cases {
            let web = lamp(horizontal);
            for (at, cd) in expected {
                close(web.candela(c(90.0, at)), cd);
                close(web.candela(c(45.0, at)), 0.5 * cd);
            }
        }
    }

    #[test]
    fn types_a_and_b_have_their_poles_where_they_belong() {
        // Intensity 100 + vertical + 2 × horizontal, degrees; alike on both sides.
        let text = |kind: u32| {
            let vertical = "-90 0 90";
            let rows = [0, 45, 90].map(|h| [-90, 0, 90].map(|v| (100 + v + 2 * h).to_string()).join(" ")).join("\n");
            format!("1 1 1 3 3 {kind} 2 0 0 0 1 1 1\n{vertical}\n0 45 90\n{rows}\n")
        };
        let [a, b] = [3, 2].map(|kind| Web::read(&file(&text(kind))).unwrap());
        let (h, v) = (30f32.to_radians(), 40f32.to_radians());
        for side in [1.0, -1.0] {
            close(a.candela(Vec3::new(v.cos() * h.sin() * side, v.sin(), -v.cos() * h.cos())), 200.0);
            close(b.candela(Vec3::new(h.sin() * side, h.cos() * v.sin(), -h.cos() * v.cos())), 200.0);
        }
        close(a.candela(Vec3::NEG_Z), 100.0);
        // Straight up is one direction of A, whatever the horizontal angle; to the side one of B.
        close(a.candela(Vec3::new(0.0, 1.0, -1e-4)), 190.0);
        close(b.candela(Vec3::new(1.0, 0.0, -1e-4)), 280.0);
        // Behind: beyond all angles of both.
        assert_eq!([a.candela(Vec3::Z), b.candela(Vec3::Z)], [0.0, 0.0]);
    }

    #[test]
    fn tilt_data_are_read_over_and_nonsense_is_refused() {
        let numbers = "1 1000 1 2 1 1 2 0 0 0 1 1 60\n0 90\n0\n100 50\n";
        let plain = Web::read(&file(numbers)).unwrap();
        let tilted = format!("IESNA91\nTILT=INCLUDE\n1\n3\n0 45 90\n1 0.9 0.8\n{numbers}");
        assert_eq!(Web::read(tilted.as_bytes()).unwrap(), plain);
        for (text, found) in [
            ("1 2 3", "the end of the file"),
            ("1 1000 1 2 x 1 2 0 0 0 1 1 60", "\"x\" as the number of horizontal angles"),
            ("1 1000 1 2 0 1 2 0 0 0 1 1 60", "0 as the number of horizontal angles"),
            ("1 1000 1 2 1 4 2 0 0 0 1 1 60", "photometric type 4"),
            ("1 1000 0 2 1 1 2 0 0 0 1 1 60\n0 90 0 1 1", "a candela multiplier"),
            ("1 1000 1 2 1 1 2 0 0 0 1 1 60\n90 0 0 1 1", "vertical angles that do not rise"),
            ("1 1000 1 2 1 1 2 0 0 0 1 1 60\n0 90 45 1 1", "horizontal angles from 45"),
            ("1 1000 1 2 1 1 2 0 0 0 1 1 60\n0 90 0 1 -1", "an intensity of -1 cd"),
            ("1 1000 1 2 1 1 2 0 0 0 1 1 60\n0 90 0 0 0", "dark everywhere"),
            ("1 1000 1 8000 8000 1 2 0 0 0 1 1 60\n", "8000 × 8000 angles"),
        ] {
            let error = Web::read(&file(text)).unwrap_err();
            assert!(error.found.starts_with(found) || error.found.contains(found), "{error:?}");
        }
        assert_eq!(Web::read(b"\x89PNG").unwrap_err().found, "no line TILT=");
    }
}
