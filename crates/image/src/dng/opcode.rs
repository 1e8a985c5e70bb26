//! Opcode lists: corrections that a DNG leaves to its reader.
//!
//! Source: Adobe, Digital Negative Specification 1.6.0.0, chapter 7 "Opcode List Processing". List 1 is for the raw numbers as read, list 2 for
//! linear reference values (0 black, 1 white), list 3 for the picture once it is demosaiced. All numbers are big-endian, whatever the file is. What the text leaves
//! open follows Adobe's DNG SDK 1.7: offsets are in the unit of 16-bit numbers; values below black are mirrored by what is no straight line; a
//! table's last entry goes on.

use crate::ImageError;
use crate::cfa::Cfa;
use rayon::prelude::*;
use std::fmt;

/// The unit of 16-bit numbers.
pub(super) const SHORT: f32 = 65_535.0;

/// Most terms of a polynomial, as in the DNG SDK.
const MOST_DEGREE: u32 = 8;

/// Most opcodes of a list: files in use have some tens. Each is work over all of the picture, asked for by as little as 24 bytes.
const MOST_OPCODES: u32 = 256;

/// Most numbers of a picture that the opcodes of a list may call bad: 1 / so many.
const BAD_FRACTION: usize = 10;

/// How far around a bad pixel good ones are looked for.
const BAD_REACH: i64 = 8;

/// A part of a picture: every so many rows and columns of some planes.
#[derive(Clone, Debug, PartialEq)]
pub struct Area {
    /// Top, left, bottom, right; the last two are outside.
    bounds: [u32; 4],
    /// First plane.
    plane: u32,
    /// Number of planes.
    planes: u32,
    /// Rows and columns from one to the next.
    pitch: [u32; 2],
}

impl Area {
    /// Row and column of a pixel among those of the area; `None` outside.
    fn index(&self, plane: usize, [x, y]: [usize; 2]) -> Option<[usize; 2]> {
        let [top, left, bottom, right] = self.bounds.map(|v| v as usize);
        let [rows, columns] = self.pitch.map(|v| v as usize);
        let planes = self.plane as usize..self.plane as usize + self.planes as usize;
        if !planes.contains(&plane) || !(top..bottom).contains(&y) || !(left..right).contains(&x) {
            return None;
        }
        let (row, column) = (y - top, x - left);
        (row.is_multiple_of(rows) && column.is_multiple_of(columns)).then_some([row / rows, column / columns])
    }
}

/// Factors on a grid over the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct GainMap {
    area: Area,
    /// Points down and across.
    points: [usize; 2],
    /// From one point to the next, and the place of the first: down and across, of the picture's sides.
    spacing: [f64; 2],
    origin: [f64; 2],
    planes: usize,
    /// `[row][column][plane]`.
    factors: Vec<f32>,
}

impl GainMap {
    /// Bilinear between points, constant beyond them.
    fn at(&self, [width, height]: [usize; 2], plane: usize, [x, y]: [usize; 2]) -> f32 {
        let place = |v: usize, side: usize, axis: usize| {
            let last = (self.points[axis] - 1) as f64;
            let p = (((v as f64 + 0.5) / side as f64 - self.origin[axis]) / self.spacing[axis]).clamp(0.0, last);
            let first = (p as usize).min(self.points[axis].saturating_sub(2));
            (first, (first + 1).min(self.points[axis] - 1), (p - first as f64) as f32)
        };
        let ((top, bottom, down), (left, right, along)) = (place(y, height, 0), place(x, width, 1));
        let plane = plane.min(self.planes - 1);
        let factor = |row: usize, column: usize| self.factors[(row * self.points[1] + column) * self.planes + plane];
        let between = |row: usize| factor(row, left) + along * (factor(row, right) - factor(row, left));
        between(top) + down * (between(bottom) - between(top))
    }
}

/// A mapping of places, the same or another for each plane.
#[derive(Clone, Debug, PartialEq)]
pub struct Warp {
    /// Radial terms of each plane, in the order of the specification; the last are those of all further planes.
    pub radial: Vec<[f64; 4]>,
    /// Tangential terms of each plane; all 0 of a fisheye.
    pub tangential: Vec<[f64; 2]>,
    /// The optical centre, across and down, of the picture's sides.
    pub center: [f64; 2],
    /// Whether the radial terms are over the angle (WarpFisheye).
    pub fisheye: bool,
}

/// The optical centre in pixels, and its distance to the furthest corner: the unit of radii.
fn normalisation([width, height]: [usize; 2], center: [f64; 2]) -> ([f64; 2], f64) {
    let (w, h) = ((width.max(1) - 1) as f64, (height.max(1) - 1) as f64);
    let [x, y] = [center[0] * w, center[1] * h];
    ([x, y], x.max(w - x).hypot(y.max(h - y)).max(0.5))
}

impl Warp {
    /// Where a place of the corrected picture (`size` pixels) lies in the taken one. Both in pixels.
    pub fn source(&self, size: [usize; 2], plane: usize, [x, y]: [f64; 2]) -> [f64; 2] {
        let ([cx, cy], unit) = normalisation(size, self.center);
        let (dx, dy) = ((x - cx) / unit, (y - cy) / unit);
        let r2 = dx * dx + dy * dy;
        // Without terms nothing moves.
        let [k0, k1, k2, k3] = self.radial.get(plane).or(self.radial.last()).copied().unwrap_or([1.0, 0.0, 0.0, 0.0]);
        let [t0, t1] = self.tangential.get(plane).or(self.tangential.last()).copied().unwrap_or([0.0; 2]);
        let factor = match self.fisheye {
            false => k0 + r2 * (k1 + r2 * (k2 + r2 * k3)),
            true => {
                let r = r2.sqrt();
                let angle = r.atan();
                let a2 = angle * angle;
                // Where r vanishes the angle is r.
                let over_r = if r > 1e-9 { angle / r } else { 1.0 };
                over_r * (k0 + a2 * (k1 + a2 * (k2 + a2 * k3)))
            }
        };
        let tangential = [2.0 * t0 * dx * dy + t1 * (r2 + 2.0 * dx * dx), 2.0 * t1 * dx * dy + t0 * (r2 + 2.0 * dy * dy)];
        [cx + unit * (factor * dx + tangential[0]), cy + unit * (factor * dy + tangential[1])]
    }

    /// Longest way of any pixel, as a part of the diagonal; infinite for terms that are no lens's.
    pub fn reach(&self, [width, height]: [usize; 2]) -> f64 {
        const STEPS: usize = 32;
        let at = |k: usize, side: usize| k as f64 / STEPS as f64 * (side.max(1) - 1) as f64;
        let mut longest = 0.0f64;
        for plane in 0..self.radial.len() {
            for (row, column) in (0..=STEPS).flat_map(|r| (0..=STEPS).map(move |c| (r, c))) {
                let place = [at(column, width), at(row, height)];
                let [x, y] = self.source([width, height], plane, place);
                let way = (x - place[0]).hypot(y - place[1]);
                longest = if way.is_finite() { longest.max(way) } else { f64::INFINITY };
            }
        }
        longest / (width as f64).hypot(height as f64)
    }
}

/// What an opcode does.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Action {
    /// Places of pixels, of lenses that are not fisheyes (id 1) or are (id 2).
    Warp(Warp),
    /// Brightness over the distance from the optical centre: 1 + k0 r² + k1 r⁴ + … + k4 r¹⁰ (id 3).
    FixVignetteRadial {
        /// k0 to k4.
        terms: [f64; 5],
        /// The optical centre, across and down, of the picture's sides.
        center: [f64; 2],
    },
    /// Pixels of this number are bad (id 4).
    FixBadPixelsConstant(u32),
    /// Bad pixels (row, column) and rectangles (top, left, bottom, right) of them (id 5).
    FixBadPixelsList {
        /// Single pixels.
        points: Vec<[u32; 2]>,
        /// Rectangles.
        rectangles: Vec<[u32; 4]>,
    },
    /// Only this part of the picture remains: top, left, bottom, right (id 6).
    TrimBounds([u32; 4]),
    /// Numbers by a table over 16-bit numbers (id 7).
    MapTable(Area, Vec<u16>),
    /// Values by a polynomial, from the constant on (id 8).
    MapPolynomial(Area, Vec<f64>),
    /// Factors on a grid (id 9).
    GainMap(GainMap),
    /// What is added to rows, values between 0 and 1 (id 10).
    DeltaPerRow(Area, Vec<f32>),
    /// What is added to columns (id 11).
    DeltaPerColumn(Area, Vec<f32>),
    /// Factors of rows (id 12).
    ScalePerRow(Area, Vec<f32>),
    /// Factors of columns (id 13).
    ScalePerColumn(Area, Vec<f32>),
}

/// One correction of a list.
#[derive(Clone, Debug, PartialEq)]
pub struct Opcode {
    /// Whether the picture is right, if not best, without it.
    pub optional: bool,
    /// What it does.
    pub action: Action,
}

/// Names by number: DNG 1.6, chapter 7.
fn name(id: u32) -> &'static str {
    match id {
        1 => "WarpRectilinear",
        2 => "WarpFisheye",
        3 => "FixVignetteRadial",
        4 => "FixBadPixelsConstant",
        5 => "FixBadPixelsList",
        6 => "TrimBounds",
        7 => "MapTable",
        8 => "MapPolynomial",
        9 => "GainMap",
        10 => "DeltaPerRow",
        11 => "DeltaPerColumn",
        12 => "ScalePerRow",
        13 => "ScalePerColumn",
        14 => "WarpRectilinear2",
        _ => "unknown",
    }
}

impl fmt::Display for Opcode {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let id = match &self.action {
            Action::Warp(Warp { fisheye: false, .. }) => 1,
            Action::Warp(_) => 2,
            Action::FixVignetteRadial { .. } => 3,
            Action::FixBadPixelsConstant(_) => 4,
            Action::FixBadPixelsList { .. } => 5,
            Action::TrimBounds(_) => 6,
            Action::MapTable(..) => 7,
            Action::MapPolynomial(..) => 8,
            Action::GainMap(_) => 9,
            Action::DeltaPerRow(..) => 10,
            Action::DeltaPerColumn(..) => 11,
            Action::ScalePerRow(..) => 12,
            Action::ScalePerColumn(..) => 13,
        };
        f.write_str(name(id))
    }
}

/// A straight line is kept below 0, where only noise is; what bends is mirrored about its value there.
fn mirrored(v: f32, f: impl Fn(f32) -> f32) -> f32 {
    if v < 0.0 { 2.0 * f(0.0) - f(-v) } else { f(v) }
}

impl Opcode {
    /// Whether it changes values pixel by pixel: [`Opcode::value`] is all of it.
    pub fn is_of_pixels(&self) -> bool {
        !matches!(
            self.action,
            Action::Warp(_) | Action::FixBadPixelsConstant(_) | Action::FixBadPixelsList { .. } | Action::TrimBounds(_)
        )
    }

    /// A value (0 black, 1 white) of a plane at a place (column, row) of a picture of `size` pixels, corrected. Results above 1 are kept.
    pub fn value(&self, size: [usize; 2], plane: usize, place: [usize; 2], v: f32) -> f32 {
        match &self.action {
            Action::FixVignetteRadial { terms, center } => {
                let ([cx, cy], unit) = normalisation(size, *center);
                let (dx, dy) = ((place[0] as f64 - cx) / unit, (place[1] as f64 - cy) / unit);
                let r2 = dx * dx + dy * dy;
                v * (1.0 + r2 * terms.iter().rev().fold(0.0, |sum, k| sum * r2 + k)) as f32
            }
            Action::GainMap(map) => match map.area.index(plane, place) {
                Some(_) => v * map.at(size, plane, place),
                None => v,
            },
            Action::MapTable(area, table) => match area.index(plane, place) {
                Some(_) => mirrored(v, |v| {
                    let entry = ((v * SHORT + 0.5) as usize).min(table.len() - 1);
                    f32::from(table[entry]) / SHORT
                }),
                None => v,
            },
            Action::MapPolynomial(area, terms) => match area.index(plane, place) {
                Some(_) => mirrored(v, |v| terms.iter().rev().fold(0.0, |sum, k| sum * f64::from(v) + k) as f32),
                None => v,
            },
            Action::DeltaPerRow(area, deltas) => area.index(plane, place).map_or(v, |i| v + deltas[i[0]]),
            Action::DeltaPerColumn(area, deltas) => area.index(plane, place).map_or(v, |i| v + deltas[i[1]]),
            Action::ScalePerRow(area, scales) => area.index(plane, place).map_or(v, |i| v * scales[i[0]]),
            Action::ScalePerColumn(area, scales) => area.index(plane, place).map_or(v, |i| v * scales[i[1]]),
            Action::Warp(_) | Action::FixBadPixelsConstant(_) | Action::FixBadPixelsList { .. } | Action::TrimBounds(_) => v,
        }
    }

    /// The same on numbers as the file has them, for list 1: a polynomial is then one of the numbers themselves.
    fn of_numbers(mut self) -> Self {
        if let Action::MapPolynomial(_, terms) = &mut self.action {
            let mut factor = 1.0 / f64::from(SHORT);
            for term in terms {
                *term *= factor;
                factor *= f64::from(SHORT);
            }
        }
        self
    }
}

/// Bytes of an opcode, from the front; `None` where they end.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*first)
    }

    fn part(&mut self, length: usize) -> Option<&'a [u8]> {
        let (first, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        Some(first)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_be_bytes)
    }

    fn u32s<const N: usize>(&mut self) -> Option<[u32; N]> {
        let mut all = [0; N];
        for v in &mut all {
            *v = self.u32()?;
        }
        Some(all)
    }

    /// Finite ones only, as all numbers of opcodes are.
    fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut all = [0.0; N];
        for v in &mut all {
            *v = f64::from_be_bytes(self.take()?);
        }
        all.iter().all(|v| v.is_finite()).then_some(all)
    }

    fn f32s(&mut self, count: usize) -> Option<Vec<f32>> {
        let bytes = self.part(count.checked_mul(4)?)?;
        let all: Vec<f32> = bytes.as_chunks().0.iter().map(|b| f32::from_be_bytes(*b)).collect();
        all.iter().all(|v| v.is_finite()).then_some(all)
    }

    fn area(&mut self) -> Option<Area> {
        let [top, left, bottom, right, plane, planes, rows, columns] = self.u32s::<8>()?;
        let fine = top <= bottom && left <= right && rows > 0 && columns > 0 && planes > 0;
        fine.then_some(Area { bounds: [top, left, bottom, right], plane, planes, pitch: [rows, columns] })
    }

    /// An area, and a number for each of its rows (axis 0) or columns (axis 1).
    fn lines(&mut self, axis: usize) -> Option<(Area, Vec<f32>)> {
        let area = self.area()?;
        let needed = (area.bounds[axis + 2] - area.bounds[axis]).div_ceil(area.pitch[axis]);
        if self.u32()? != needed {
            return None;
        }
        let numbers = self.f32s(needed as usize)?;
        Some((area, numbers))
    }

    fn warp(&mut self, fisheye: bool) -> Option<Warp> {
        let planes = self.u32()?;
        // More planes than a picture can have is damage.
        if !(1..=16).contains(&planes) {
            return None;
        }
        let (mut radial, mut tangential): (Vec<[f64; 4]>, Vec<[f64; 2]>) = (Vec::new(), Vec::new());
        for _ in 0..planes {
            radial.push(self.f64s()?);
            tangential.push(if fisheye { [0.0; 2] } else { self.f64s()? });
        }
        Some(Warp { radial, tangential, center: self.center()?, fisheye })
    }

    /// The optical centre, which lies in the picture.
    fn center(&mut self) -> Option<[f64; 2]> {
        self.f64s::<2>().filter(|c| c.iter().all(|v| (0.0..=1.0).contains(v)))
    }

    fn gain_map(&mut self) -> Option<GainMap> {
        let area = self.area()?;
        let points = self.u32s::<2>()?.map(|n: u32| n as usize);
        let (spacing, origin) = (self.f64s::<2>()?, self.f64s::<2>()?);
        let planes = self.u32()? as usize;
        // The spacing of a single point means nothing.
        let spacing = [0, 1].map(|axis| if points[axis] == 1 { 1.0 } else { spacing[axis] });
        if points.contains(&0) || planes == 0 || spacing.iter().any(|s| *s <= 0.0) {
            return None;
        }
        let factors = self.f32s(points[0].checked_mul(points[1])?.checked_mul(planes)?)?;
        Some(GainMap { area, points, spacing, origin, planes, factors })
    }

    fn table(&mut self) -> Option<(Area, Vec<u16>)> {
        let area = self.area()?;
        let entries = self.u32()? as usize;
        if !(1..=65_536).contains(&entries) {
            return None;
        }
        let bytes = self.part(2 * entries)?;
        Some((area, bytes.as_chunks().0.iter().map(|b| u16::from_be_bytes(*b)).collect()))
    }

    fn polynomial(&mut self) -> Option<(Area, Vec<f64>)> {
        let area = self.area()?;
        let degree = self.u32().filter(|d| *d <= MOST_DEGREE)?;
        let mut terms = Vec::new();
        for _ in 0..=degree {
            let [term] = self.f64s::<1>()?;
            terms.push(term);
        }
        Some((area, terms))
    }

    fn bad_pixels(&mut self) -> Option<Action> {
        // The phase of the filters is known from their pattern.
        let [_phase, points, rectangles] = self.u32s::<3>()?;
        let mut of = |count: u32, size: usize| -> Option<Vec<u32>> {
            let bytes = self.part((count as usize).checked_mul(4 * size)?)?;
            Some(bytes.as_chunks().0.iter().map(|b| u32::from_be_bytes(*b)).collect())
        };
        let (points, rectangles) = (of(points, 2)?, of(rectangles, 4)?);
        Some(Action::FixBadPixelsList { points: points.as_chunks().0.to_vec(), rectangles: rectangles.as_chunks().0.to_vec() })
    }
}

/// Reads one opcode. `Ok(None)`: its number is unknown; `Err(())`: its bytes are not what they should be. `unit`: of offsets.
fn action(id: u32, bytes: &[u8], unit: f32) -> Result<Option<Action>, ()> {
    let mut b = Bytes(bytes);
    let scaled = |(area, v): (Area, Vec<f32>)| (area, v.into_iter().map(|v| v * unit).collect::<Vec<f32>>());
    let read = match id {
        1 => b.warp(false).map(Action::Warp),
        2 => b.warp(true).map(Action::Warp),
        3 => b.f64s::<5>().and_then(|terms| Some(Action::FixVignetteRadial { terms, center: b.center()? })),
        4 => b.u32s::<2>().map(|[constant, _phase]| Action::FixBadPixelsConstant(constant)),
        5 => b.bad_pixels(),
        6 => b.u32s::<4>().filter(|[top, left, bottom, right]| top < bottom && left < right).map(Action::TrimBounds),
        7 => b.table().map(|(area, table)| Action::MapTable(area, table)),
        8 => b.polynomial().map(|(area, terms)| Action::MapPolynomial(area, terms)),
        9 => b.gain_map().map(Action::GainMap),
        10 => b.lines(0).map(scaled).map(|(area, v)| Action::DeltaPerRow(area, v)),
        11 => b.lines(1).map(scaled).map(|(area, v)| Action::DeltaPerColumn(area, v)),
        12 => b.lines(0).map(|(area, v)| Action::ScalePerRow(area, v)),
        13 => b.lines(1).map(|(area, v)| Action::ScalePerColumn(area, v)),
        _ => return Ok(None),
    };
    read.map(Some).ok_or(())
}

/// Reads an opcode list (`number` 1 to 3). `float`: whether the picture is of floating-point numbers, whose offsets have the unit 1. What is left out
/// though the picture needs it is told in `warnings`; damage to what it needs is an error.
pub(super) fn list(bytes: &[u8], number: usize, float: bool, warnings: &mut Vec<String>) -> Result<Vec<Opcode>, ImageError> {
    let malformed = |what: String| ImageError::Malformed { format: "DNG", reason: format!("OpcodeList{number}: {what}") };
    let mut b = Bytes(bytes);
    let count = b.u32().ok_or_else(|| malformed("it ends before its count".into()))?;
    if count > MOST_OPCODES {
        return Err(malformed(format!("it holds {count} opcodes: expected at most {MOST_OPCODES}")));
    }
    let mut all = Vec::new();
    for k in 1..=count {
        let head = b.u32s::<4>().and_then(|[id, _version, flags, length]| Some((id, flags, b.part(length as usize)?)));
        let (id, flags, data) = head.ok_or_else(|| malformed(format!("it ends early, in opcode {k} of {count}")))?;
        let optional = flags & 1 != 0;
        match action(id, data, if float { 1.0 } else { 1.0 / SHORT }) {
            Ok(Some(action)) => {
                let opcode = Opcode { optional, action };
                all.push(if number == 1 && !float { opcode.of_numbers() } else { opcode });
            }
            Err(()) if !optional => {
                return Err(malformed(format!(
                    "opcode {k} of {count}, {}: its {} bytes are not what the specification says",
                    name(id),
                    data.len()
                )));
            }
            Ok(None) if !optional => warnings.push(format!(
                "OpcodeList{number}: opcode {id} ({}) is not known here and was left out; what it corrects remains in the picture",
                name(id)
            )),
            Ok(None) | Err(()) => {}
        }
    }
    Ok(all)
}

/// Numbers of a raw image between 0 and 1 while opcodes are applied to them.
pub(super) struct Values<'a> {
    /// Rows of samples.
    pub data: Vec<f32>,
    /// Pixels a row, and rows.
    pub size: [usize; 2],
    /// The pattern, and the pixel at which it begins.
    pub cfa: &'a Cfa,
    pub phase: [usize; 2],
}

impl Values<'_> {
    /// Applies one list in its order. Of what is not done here (warps, bounds) nothing is said.
    pub fn apply(&mut self, opcodes: &[Opcode], warnings: &mut Vec<String>) {
        let mut most_bad = self.data.len() / BAD_FRACTION;
        for opcode in opcodes {
            match &opcode.action {
                Action::FixBadPixelsConstant(constant) => {
                    let bad = self.data.iter().map(|v| f64::from(*v * SHORT).round() == f64::from(*constant)).collect();
                    self.repair(bad, opcode, &mut most_bad, warnings);
                }
                Action::FixBadPixelsList { points, rectangles } => match self.marked(points, rectangles) {
                    Some(bad) => self.repair(bad, opcode, &mut most_bad, warnings),
                    None => warnings.push(format!(
                        "{opcode}: its pixels and rectangles together are larger than the picture; all were left as they are"
                    )),
                },
                _ if opcode.is_of_pixels() => {
                    let (size, samples) = (self.size, self.cfa.samples_per_pixel());
                    self.data.par_chunks_mut((size[0] * samples).max(1)).enumerate().for_each(|(y, line)| {
                        for (i, v) in line.iter_mut().enumerate() {
                            *v = opcode.value(size, i % samples, [i / samples, y], *v);
                        }
                    });
                }
                _ => {}
            }
        }
    }

    /// Marks listed pixels, with all their samples; `None` where the areas, also those that overlap, come to more than the picture: some kilobytes of
    /// rectangles could ask for hours.
    fn marked(&self, points: &[[u32; 2]], rectangles: &[[u32; 4]]) -> Option<Vec<bool>> {
        let ([width, height], samples) = (self.size, self.cfa.samples_per_pixel());
        let mut bad = vec![false; self.data.len()];
        let mut left_over = width * height;
        let single = points.iter().map(|&[row, column]| [row, column, row.saturating_add(1), column.saturating_add(1)]);
        for [top, left, bottom, right] in single.chain(rectangles.iter().copied()) {
            let (left, right) = ((left as usize).min(width), (right as usize).min(width));
            let (top, bottom) = ((top as usize).min(height), (bottom as usize).min(height));
            if left >= right || top >= bottom {
                continue;
            }
            left_over = left_over.checked_sub((right - left) * (bottom - top))?;
            for row in top..bottom {
                bad[(row * width + left) * samples..(row * width + right) * samples].fill(true);
            }
        }
        Some(bad)
    }

    /// Bad pixels become the mean of the nearest good ones of their colour. No more than `most` of them, which grows less by those of this opcode.
    fn repair(&mut self, bad: Vec<bool>, opcode: &Opcode, most: &mut usize, warnings: &mut Vec<String>) {
        let count = bad.iter().filter(|b| **b).count();
        let Some(left) = most.checked_sub(count) else {
            let all = self.data.len();
            let earlier = all / BAD_FRACTION - *most;
            let before = if earlier > 0 { format!(" beside the {earlier} of opcodes before") } else { String::new() };
            warnings.push(format!("{opcode}: {count} of {all} numbers would be bad{before}; they were left as they are"));
            return;
        };
        *most = left;
        let ([width, height], samples) = (self.size, self.cfa.samples_per_pixel());
        let color = |x: i64, y: i64| self.cfa.channel_beyond(x - self.phase[0] as i64, y - self.phase[1] as i64);
        let data = &self.data;
        let mean = |i: usize| {
            let (sample, x, y) = (i % samples, (i / samples % width) as i64, (i / samples / width) as i64);
            (1..=BAD_REACH).find_map(|r| {
                let (mut sum, mut n) = (0.0, 0.0f32);
                for dy in -r..=r {
                    for dx in -r..=r {
                        let (px, py) = (x + dx, y + dy);
                        // The ring at this distance, inside the picture.
                        let ring = dx.abs().max(dy.abs()) == r;
                        if !ring || !(0..width as i64).contains(&px) || !(0..height as i64).contains(&py) {
                            continue;
                        }
                        let other = (py as usize * width + px as usize) * samples + sample;
                        if !bad[other] && (samples > 1 || color(px, py) == color(x, y)) {
                            sum += data[other];
                            n += 1.0;
                        }
                    }
                }
                (n > 0.0).then(|| sum / n)
            })
        };
        let listed = (0..bad.len()).into_par_iter().filter(|i| bad[*i]);
        let repaired: Vec<(usize, f32)> = listed.filter_map(|i| mean(i).map(|v| (i, v))).collect();
        for (i, v) in repaired {
            self.data[i] = v;
        }
    }
}

#[cfg(test)]
pub(super) mod tests;
