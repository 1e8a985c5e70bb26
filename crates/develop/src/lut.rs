//! Look-up tables for colour: `.cube` files, 1D and 3D, read, written and applied.
//!
//! Source: Adobe, Cube LUT Specification 1.0 (2013); a 1D table before a 3D one and the keywords `LUT_1D_INPUT_RANGE`, `LUT_3D_INPUT_RANGE` as
//! DaVinci Resolve writes them. Tetrahedral interpolation: Kasson, Plouffe & Nin 1993, "Tetrahedral interpolation technique for color space
//! conversion" (SPIE 1909).

use crate::setting::{names, section};
use glam::{Vec3, Vec4};
use std::fmt::Write;

section! {
    /// A look from a file.
    LutStep "lut" {
        file: String = String::new(), "", Text,
            "a .cube file, 1D or 3D; none where empty";
        input: LutInput = LutInput::Srgb, "", Names(LutInput::NAMES),
            "what the table expects: codes or light of the picture, or of the scene";
        interpolation: Interpolation = Interpolation::Tetrahedral, "", Names(Interpolation::NAMES),
            "between the points of a 3D table";
        amount: f64 = 1.0, "", Number(0.0, 1.0),
            "how much of the look";
    }
}

names! {
    /// What a look-up table is fed with, and what it gives.
    #[non_exhaustive]
    LutInput {
        /// sRGB codes of the finished picture; the table gives sRGB codes.
        Srgb = "srgb",
        /// Rec.709 linear light of the finished picture; the table gives the same.
        Linear = "linear",
        /// ACEScct codes (AP1) of the scene: the table is the whole look and gives sRGB codes; curve and grading are left out.
        Acescct = "acescct",
        /// As `acescct`, but logarithmic codes of linear sRGB as [`crate::lut::log_code`] makes them: what `lut bake` is most exact with.
        Log = "log",
    }
}

names! {
    /// Interpolation in a 3D table.
    Interpolation {
        /// Between the 4 corners of a tetrahedron: greys stay clean.
        Tetrahedral = "tetrahedral",
        /// Between the 8 corners of a cube.
        Trilinear = "trilinear",
    }
}

/// Points of a 1D table: the specification's limits.
const POINTS_1D: std::ops::RangeInclusive<usize> = 2..=65_536;
/// Points a side of a 3D table: the specification's limits.
const POINTS_3D: std::ops::RangeInclusive<usize> = 2..=256;

/// A table that cannot be read.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("line {line}: {found}; expected {expected}")]
pub struct LutError {
    /// Line in the file, from 1.
    pub line: usize,
    /// What is there.
    pub found: String,
    /// What belongs there.
    pub expected: String,
}

/// Points of one or three dimensions.
#[derive(Clone, Debug, PartialEq)]
struct Points {
    /// Points a side.
    size: usize,
    /// Values the first and the last point stand for.
    domain: [Vec3; 2],
    /// The points, red fastest.
    points: Vec<Vec4>,
}

/// A look-up table.
#[derive(Clone, Debug, PartialEq)]
pub struct Lut {
    /// Its title; may be empty.
    pub title: String,
    /// One curve a channel, before the cube.
    curves: Option<Points>,
    cube: Option<Points>,
}

impl Lut {
    /// A 3D table of a function of codes from 0 to 1, `size` points a side, 2 or more.
    pub fn from_function(title: &str, size: usize, f: impl Fn(Vec3) -> Vec3) -> Lut {
        let scale = 1.0 / (size - 1) as f32;
        let mut points = Vec::with_capacity(size * size * size);
        for b in 0..size {
            for g in 0..size {
                for r in 0..size {
                    points.push(f(Vec3::new(r as f32, g as f32, b as f32) * scale).extend(0.0));
                }
            }
        }
        let cube = Some(Points { size, domain: [Vec3::ZERO, Vec3::ONE], points });
        Lut { title: title.to_owned(), curves: None, cube }
    }

    /// Points a side of the 1D and of the 3D table.
    pub fn sizes(&self) -> [Option<usize>; 2] {
        [&self.curves, &self.cube].map(|t| t.as_ref().map(|t| t.size))
    }

    /// Values the first and last point of the first table stand for.
    pub fn domain(&self) -> [[f32; 3]; 2] {
        let first = self.curves.as_ref().or(self.cube.as_ref());
        first.map_or([[0.0; 3], [1.0; 3]], |t| t.domain.map(|v| v.to_array()))
    }

    /// Reads a `.cube` file. Fails with line, what was found and what was expected; numbers that are not finite are errors.
    pub fn parse(text: &str) -> Result<Lut, LutError> {
        Reader::default().read(text)
    }

    /// The table as a `.cube` file.
    pub fn to_cube(&self) -> String {
        let mut text = String::new();
        if !self.title.is_empty() {
            let _ = writeln!(text, "TITLE \"{}\"", self.title.replace(['"', '\n', '\r'], "'"));
        }
        let both = self.curves.is_some() && self.cube.is_some();
        for (table, key) in [(&self.curves, "LUT_1D"), (&self.cube, "LUT_3D")] {
            let Some(t) = table else { continue };
            let _ = writeln!(text, "{key}_SIZE {}", t.size);
            let [low, high] = t.domain;
            if both {
                let _ = writeln!(text, "{key}_INPUT_RANGE {} {}", low.x, high.x);
            } else if t.domain != [Vec3::ZERO, Vec3::ONE] {
                let _ = writeln!(text, "DOMAIN_MIN {} {} {}", low.x, low.y, low.z);
                let _ = writeln!(text, "DOMAIN_MAX {} {} {}", high.x, high.y, high.z);
            }
        }
        for t in [&self.curves, &self.cube].into_iter().flatten() {
            for p in &t.points {
                let _ = writeln!(text, "{} {} {}", p.x, p.y, p.z);
            }
        }
        text
    }

    /// The value of a colour; beyond the domain that of its edge.
    #[inline]
    pub fn at(&self, c: Vec3, how: Interpolation) -> Vec3 {
        let c = match &self.curves {
            Some(curves) => curves.along(c),
            None => c,
        };
        match (&self.cube, how) {
            (None, _) => c,
            (Some(cube), Interpolation::Tetrahedral) => cube.tetrahedral(c),
            (Some(cube), Interpolation::Trilinear) => cube.trilinear(c),
        }
    }

    /// Applies the table to pixels of three channels, in place and in parallel.
    pub fn apply(&self, pixels: &mut [f32], how: Interpolation) {
        use rayon::prelude::*;
        pixels.par_chunks_mut(3 * 16_384).for_each(|part| {
            for pixel in part.as_chunks_mut::<3>().0 {
                *pixel = self.at(Vec3::from_array(*pixel), how).to_array();
            }
        });
    }
}

impl Points {
    /// Cell and place in it of a colour.
    #[inline]
    fn place(&self, c: Vec3) -> ([usize; 3], Vec3) {
        let last = (self.size - 1) as f32;
        let p = (c - self.domain[0]) / (self.domain[1] - self.domain[0]) * last;
        // Not a number becomes 0.
        let p = p.max(Vec3::ZERO).min(Vec3::splat(last));
        let cell = p.floor().min(Vec3::splat(last - 1.0));
        (cell.to_array().map(|v| v as usize), p - cell)
    }

    #[inline]
    fn along(&self, c: Vec3) -> Vec3 {
        let (i, t) = self.place(c);
        let at = |k: usize| {
            let (a, b) = (self.points[i[k]][k], self.points[i[k] + 1][k]);
            a + t[k] * (b - a)
        };
        Vec3::new(at(0), at(1), at(2))
    }

    #[inline]
    fn tetrahedral(&self, c: Vec3) -> Vec3 {
        let ([r, g, b], t) = self.place(c);
        let (dr, dg, db) = (1, self.size, self.size * self.size);
        let base = r * dr + g * dg + b * db;
        // The path along the edges from the nearest corner to the farthest, largest step first.
        let (x, y, z) = (t.x, t.y, t.z);
        let (first, second, w) = if x >= y {
            if y >= z {
                (dr, dr + dg, [x, y, z])
            } else if x >= z {
                (dr, dr + db, [x, z, y])
            } else {
                (db, db + dr, [z, x, y])
            }
        } else if x >= z {
            (dg, dg + dr, [y, x, z])
        } else if y >= z {
            (dg, dg + db, [y, z, x])
        } else {
            (db, db + dg, [z, y, x])
        };
        let p = &self.points[base..base + dr + dg + db + 1];
        (p[0] * (1.0 - w[0]) + p[first] * (w[0] - w[1]) + p[second] * (w[1] - w[2]) + p[dr + dg + db] * w[2]).truncate()
    }

    #[inline]
    fn trilinear(&self, c: Vec3) -> Vec3 {
        let ([r, g, b], t) = self.place(c);
        let n = self.size;
        let edge = |g: usize, b: usize| {
            let i = (b * n + g) * n + r;
            self.points[i].lerp(self.points[i + 1], t.x)
        };
        let near = edge(g, b).lerp(edge(g + 1, b), t.y);
        let far = edge(g, b + 1).lerp(edge(g + 1, b + 1), t.y);
        near.lerp(far, t.z).truncate()
    }
}

/// What has been read so far.
#[derive(Default)]
struct Reader {
    title: String,
    sizes: [Option<usize>; 2],
    domain: [Option<(Vec3, usize)>; 2],
    ranges: [Option<[f32; 2]>; 2],
    points: Vec<Vec4>,
}

impl Reader {
    fn read(mut self, text: &str) -> Result<Lut, LutError> {
        let mut last = 1;
        for (i, line) in text.lines().enumerate() {
            let line = line.trim_start_matches('\u{feff}').trim();
            // Comments may follow what is said, but for titles, which may hold anything.
            let line = if line.starts_with("TITLE") { line } else { line.split('#').next().unwrap_or("").trim() };
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            last = i + 1;
            self.line(i + 1, line)?;
        }
        self.finish(last)
    }

    fn line(&mut self, number: usize, line: &str) -> Result<(), LutError> {
        let wrong = |expected: &str| LutError { line: number, found: format!("\"{}\"", short(line)), expected: expected.into() };
        let (key, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        let size = |limits: std::ops::RangeInclusive<usize>| {
            let n = rest.trim().parse().ok().filter(|n| limits.contains(n));
            n.ok_or_else(|| wrong(&format!("{key} and a number from {} to {}", limits.start(), limits.end())))
        };
        let numbers = |text: &str, n: usize, expected: &str| {
            let values: Option<Vec<f32>> =
                text.split_whitespace().map(|v| v.parse().ok().filter(|v: &f32| v.is_finite())).collect();
            values.filter(|v| v.len() == n).ok_or_else(|| wrong(expected))
        };
        match key {
            "TITLE" => {
                self.title = rest.trim().trim_matches('"').to_owned();
                return Ok(());
            }
            "LUT_1D_SIZE" | "LUT_3D_SIZE" => {
                let which = usize::from(key == "LUT_3D_SIZE");
                if self.sizes[which].is_some() || !self.points.is_empty() {
                    return Err(wrong("one size, before the points"));
                }
                self.sizes[which] = Some(size(if which == 0 { POINTS_1D } else { POINTS_3D })?);
                return Ok(());
            }
            "DOMAIN_MIN" | "DOMAIN_MAX" => {
                let v = numbers(rest, 3, "three numbers")?;
                self.domain[usize::from(key == "DOMAIN_MAX")] = Some((Vec3::from_slice(&v), number));
                return Ok(());
            }
            "LUT_1D_INPUT_RANGE" | "LUT_3D_INPUT_RANGE" => {
                let v = numbers(rest, 2, "two numbers, the smaller first")?;
                if v[0] >= v[1] {
                    return Err(wrong("two numbers, the smaller first"));
                }
                self.ranges[usize::from(key == "LUT_3D_INPUT_RANGE")] = Some([v[0], v[1]]);
                return Ok(());
            }
            _ => {}
        }
        if matches!(key, "LUT_IN_VIDEO_RANGE" | "LUT_OUT_VIDEO_RANGE") {
            return Err(wrong("a table for full-range codes: those for video range are not read"));
        }
        if key.parse::<f32>().is_err() && key.starts_with(|c: char| c.is_ascii_alphabetic()) {
            return Err(wrong("a keyword of a .cube file or three numbers"));
        }
        let v = numbers(line, 3, "three finite numbers")?;
        if self.sizes == [None, None] {
            return Err(wrong("LUT_1D_SIZE or LUT_3D_SIZE before the points"));
        }
        if self.points.len() >= self.expected() {
            return Err(wrong(&format!("the end: all {} points have been given", self.expected())));
        }
        self.points.push(Vec3::from_slice(&v).extend(0.0));
        Ok(())
    }

    /// Number of points of both tables.
    fn expected(&self) -> usize {
        self.sizes[0].unwrap_or(0) + self.sizes[1].map_or(0, |n| n * n * n)
    }

    fn finish(mut self, line: usize) -> Result<Lut, LutError> {
        let fail = |line, found: String, expected: String| Err(LutError { line, found, expected });
        if self.sizes == [None, None] {
            return fail(line, "the end of the file".into(), "LUT_1D_SIZE or LUT_3D_SIZE".into());
        }
        if self.points.len() != self.expected() {
            let expected =
                format!("{} (of {:?} points a side)", self.expected(), self.sizes.iter().flatten().collect::<Vec<_>>());
            return fail(line, format!("the end after {} points", self.points.len()), expected);
        }
        let low = self.domain[0].map_or(Vec3::ZERO, |d| d.0);
        let high = self.domain[1].map_or(Vec3::ONE, |d| d.0);
        let wide = high - low;
        if !(wide.is_finite() && wide.cmpgt(Vec3::splat(1e-6)).all()) {
            let line = self.domain.iter().flatten().map(|d| d.1).max().unwrap_or(line);
            return fail(line, format!("a domain from {low} to {high}"), "DOMAIN_MIN below DOMAIN_MAX in each channel".into());
        }
        let rest = self.points.split_off(self.sizes[0].unwrap_or(0));
        let domain = |which: usize| match self.ranges[which] {
            Some([a, b]) => [Vec3::splat(a), Vec3::splat(b)],
            // Behind curves a cube takes what they give.
            None if which == 1 && self.sizes[0].is_some() => [Vec3::ZERO, Vec3::ONE],
            None => [low, high],
        };
        Ok(Lut {
            curves: self.sizes[0].map(|size| Points { size, domain: domain(0), points: std::mem::take(&mut self.points) }),
            cube: self.sizes[1].map(|size| Points { size, domain: domain(1), points: rest }),
            title: self.title,
        })
    }
}

/// The beginning of a line that may be long.
fn short(line: &str) -> String {
    let begin: String = line.chars().take(40).collect();
    if begin.len() < line.len() { format!("{begin}…") } else { begin }
}

/// Offset and largest light of the logarithmic code.
const LOG_OFFSET: f32 = 0.18 / 64.0;
const LOG_TOP: f32 = 0.18 * 90.509_67;

/// Code, 0 to 1, of linear light from 0 to 6.5 stops above middle grey: log2(1 + v/o) / log2(1 + top/o), o = 0.18/64. Light below 0 is 0.
pub fn log_code(light: f32) -> f32 {
    (1.0 + light.max(0.0) / LOG_OFFSET).log2() / (1.0 + LOG_TOP / LOG_OFFSET).log2()
}

/// Light of a logarithmic code.
pub fn log_light(code: f32) -> f32 {
    ((code * (1.0 + LOG_TOP / LOG_OFFSET).log2()).exp2() - 1.0) * LOG_OFFSET
}

/// ACEScct code of linear light. Source: AMPAS S-2016-001.
pub fn acescct_code(light: f32) -> f32 {
    if light <= 0.007_812_5 { 10.540_237_7 * light + 0.072_905_53 } else { (light.log2() + 9.72) / 17.52 }
}

/// Linear light of an ACEScct code.
pub fn acescct_light(code: f32) -> f32 {
    if code <= 0.155_251_14 { (code - 0.072_905_53) / 10.540_237_7 } else { (code * 17.52 - 9.72).exp2() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOTH: [Interpolation; 2] = [Interpolation::Tetrahedral, Interpolation::Trilinear];

    #[test]
    fn tables_give_back_what_is_linear() {
        let f = |c: Vec3| Vec3::new(0.2 + 0.5 * c.x + 0.1 * c.y, 0.9 * c.y - 0.3 * c.z, c.z);
        let lut = Lut::from_function("linear", 5, f);
        for i in 0..1000 {
            let c = Vec3::new((i * 7 % 101) as f32, (i * 31 % 97) as f32, (i * 17 % 89) as f32) / 101.0;
            for how in BOTH {
                assert!((lut.at(c, how) - f(c)).length() < 1e-5, "{how:?} {c}");
            }
        }
        // Beyond the domain: the edge.
        assert!((lut.at(Vec3::new(-1.0, 2.0, f32::NAN), BOTH[0]) - f(Vec3::new(0.0, 1.0, 0.0))).length() < 1e-5);
    }

    #[test]
    fn points_are_exact_and_greys_stay_on_the_diagonal() {
        let f = |c: Vec3| c * c;
        let lut = Lut::from_function("squares", 9, f);
        for i in 0..9 {
            let c = Vec3::splat(i as f32 / 8.0);
            BOTH.iter().for_each(|how| assert!((lut.at(c, *how) - f(c)).length() < 1e-6));
        }
        let grey = lut.at(Vec3::splat(0.3), Interpolation::Tetrahedral);
        assert!(grey.x == grey.y && grey.y == grey.z);
        // By hand: a cell from 0.25 to 0.375, at 0.4 of it.
        assert!((grey.x - (0.0625 + 0.4 * (0.140_625 - 0.0625))).abs() < 1e-6);
    }

    #[test]
    fn files_come_back_and_red_runs_fastest() {
        let lut = Lut::from_function("a \"look\"", 3, |c| Vec3::new(c.x, 0.5 * c.y, 1.0 - c.z));
        let text = lut.to_cube();
        assert_eq!(text.lines().nth(3), Some("0.5 0 1"));
        let back = Lut::parse(&text).unwrap();
        assert_eq!(back.cube, lut.cube);
        let shaped = "# both\nLUT_1D_SIZE 3\nLUT_1D_INPUT_RANGE 0 2\nLUT_3D_SIZE 2\nLUT_3D_INPUT_RANGE 0 1\n\n0 0 0\n.25 .25 .25\n1 1 1\n\
                      0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 0 1\n1 0 1\n0 1 1\n1 1 1\n";
        let lut = Lut::parse(shaped).unwrap();
        assert!((lut.at(Vec3::splat(1.5), BOTH[0]) - Vec3::splat(0.625)).length() < 1e-6);
        assert_eq!(Lut::parse(&lut.to_cube()).unwrap(), lut);
    }

    #[test]
    fn wrong_files_say_where() {
        let cube = |head: &str, n: usize| format!("{head}\n{}", "0 0 0\n".repeat(n));
        for (text, part) in [
            ("", "LUT_1D_SIZE"),
            ("0 0 0\n", "before the points"),
            (&cube("LUT_3D_SIZE 2", 7), "the end after 7 points; expected 8"),
            (&cube("LUT_3D_SIZE 2", 9), "line 10"),
            (&cube("LUT_3D_SIZE 1", 1), "2 to 256"),
            (&cube("LUT_3D_SIZE 1000000000000", 1), "2 to 256"),
            (&cube("LUT_1D_SIZE 2\nLUT_1D_SIZE 2", 2), "one size"),
            (&cube("LUT_1D_SIZE 2\nDOMAIN_MIN 1 0 0\nDOMAIN_MAX 0 1 1", 2), "line 3: a domain"),
            ("LUT_1D_SIZE 2\n0 0 0\nnan 0 0\n", "line 3"),
            ("LUT_1D_SIZE 2\n0 0 0\ninf 0 0\n", "finite"),
            ("LUT_1D_SIZE 2\n0 0\n1 1 1\n", "line 2"),
            ("LUT_1D_SIZE 2\nWHAT 3\n", "keyword"),
            ("LUT_1D_SIZE 2\nLUT_1D_INPUT_RANGE 1 0\n", "smaller first"),
        ] {
            let e = Lut::parse(text).unwrap_err().to_string();
            assert!(e.contains(part), "{text:?}: {e}");
        }
    }

    #[test]
    fn codes_of_light_come_back() {
        for i in 0..=100 {
            let code = i as f32 / 100.0;
            assert!((log_code(log_light(code)) - code).abs() < 1e-5);
            assert!((acescct_code(acescct_light(code)) - code).abs() < 1e-5);
        }
        // S-2016-001: 18 % grey.
        assert!((acescct_code(0.18) - 0.413_588).abs() < 1e-5);
    }
}
