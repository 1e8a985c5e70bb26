//! Contrast autofocus: the lens is moved until the zone is sharpest.

use super::measure::{Frame, Sharpness, peak};
use super::probe::Prober;
use super::{Autofocus, Failure, Found, Point, Range};
use crate::expose::ExposeError;

/// Cells across a zone and samples a cell of a probe of the fast search.
const CELLS: usize = 32;
const SPP: u32 = 4;
/// Samples a cell of its last, finest probes.
const FINE_SPP: u32 = 16;
/// Cells taken together in its widest view.
const WIDE: usize = 4;
/// How much finer cells become from one view to the next, at most.
const CLOSER: f64 = 7.0;
/// Most places of a wide view.
const MOST_PLACES: usize = 60;
/// A blur of so many cells' diameter takes away most of what a measure at that size of cells shows.
const BLUR_CELLS: f64 = 2.0;
/// Deviations that detail must stand above noise, and a peak above its sides, to be believed.
const SURE_SIGNIFICANCE: f64 = 4.0;
/// Fraction by which the sides of a peak must be lower.
const DROP: f64 = 0.08;
/// What is less sure than this is looked at again, with so many times the samples.
const RETRY: f64 = 0.6;
const MORE: u32 = 4;
/// How a closer view is looked at until its peak is sure: cells taken together, and samples over those of the first look. The edge of a smooth thing is one step, which
/// larger cells show as well, with less of the noise of single cells (of the renderer's samples: those of a sensor are small).
const LOOKS: [(usize, u32); 4] = [(1, 1), (1, MORE), (2, MORE), (4, MORE)];
/// Fewest cells a side of a view whose cells are taken together.
const FEWEST_CELLS: usize = 6;
/// Most probes that climb a slope on one level.
const CLIMBS: usize = 6;
/// Samples a cell of the exhaustive search.
const THOROUGH_SPP: u32 = 16;
/// Falling values in a row that end it.
const FALLS: usize = 5;

/// A zone being focused: what is known so far.
struct Search<'s, 'a> {
    prober: &'s mut Prober<'a>,
    af: &'s Autofocus,
    f_number: f64,
    focal_mm: f64,
    /// Looks so far: values of one cannot be compared with those of another.
    pass: u32,
    points: Vec<Point>,
}

/// What is looked at: a piece of the picture in cells of a size.
#[derive(Clone, Copy)]
struct Look {
    piece: [f64; 4],
    cells: [usize; 2],
    /// Width of a cell on the film, mm.
    pitch_mm: f64,
}

impl<'s, 'a> Search<'s, 'a> {
    fn new(prober: &'s mut Prober<'a>, af: &'s Autofocus) -> Self {
        let lens = &prober.view.camera.lens;
        Search { f_number: lens.f_number(), focal_mm: lens.focal_length().0, prober, af, pass: 0, points: Vec::new() }
    }

    /// Defocus that takes away most of the detail of a size, mm.
    fn width(&self, pitch_mm: f64, at: f64) -> f64 {
        // The variance counts detail of every size: its peak is broader.
        let blur = if self.af.measure == super::Measure::Variance { 3.0 * BLUR_CELLS } else { BLUR_CELLS };
        blur * pitch_mm * self.f_number * (1.0 + at.max(0.0) / self.focal_mm)
    }

    /// A probe; `None` where the lens cannot stand.
    fn probe(&mut self, look: Look, at: f64, spp: u32) -> Result<Option<(f64, Frame)>, ExposeError> {
        self.prober.drive.go(at);
        let stands = self.prober.drive.stands_mm();
        Ok(self.prober.frame(look.piece, look.cells, spp, None)?.map(|f| (stands, f)))
    }

    fn note(&mut self, at: f64, s: Sharpness) {
        self.points.push(Point { extension_mm: at, value: s.value, floor: s.floor, level: self.pass });
    }
}

/// Cells for a zone: as many across as asked for, about square.
fn look(film: &crate::Film, piece: [f64; 4], across: usize) -> Look {
    let (w, h) = (film.width_mm * piece[2], film.height_mm * piece[3]);
    let pitch = (w * h).sqrt() / across as f64;
    let cells = [w, h].map(|side| ((side / pitch).round() as usize).clamp(4, 4 * across));
    Look { piece, cells, pitch_mm: (w / cells[0] as f64).max(h / cells[1] as f64) }
}

/// The fast search: a few wide views bracket the peak, closer and closer ones refine it.
pub(super) fn fast(prober: &mut Prober, af: &Autofocus, zone: [f64; 4], range: Range) -> Result<Found, ExposeError> {
    let film = prober.view.camera.film;
    let mut s = Search::new(prober, af);
    let wide = look(&film, zone, CELLS);
    // 1. Wide views over the range, in coarse cells, then in finer ones; beyond the everyday part only if that shows nothing or rises
    // towards its end.
    // A scene of noisy light is looked at again with more samples.
    for (by, spp) in [(WIDE, SPP), (WIDE, MORE * SPP), (1, SPP)] {
        s.pass += u32::from(!s.points.is_empty());
        let mut seen: Vec<(f64, Sharpness)> = Vec::new();
        for (n, part) in range.parts().into_iter().enumerate() {
            let step = 1.1 * s.width(wide.pitch_mm * by as f64, part[0]);
            let count = ((part[1] - part[0]) / step).ceil().max(2.0) as usize;
            if count > MOST_PLACES {
                continue;
            }
            for k in usize::from(n > 0)..=count {
                let at = part[0] + (part[1] - part[0]) * k as f64 / count as f64;
                let Some((at, frame)) = s.probe(wide, at, spp)? else { continue };
                let sharp = frame.binned(by).sharpness(s.af.measure, 1);
                s.note(at, sharp);
                seen.push((at, sharp));
            }
            let Some(top) = highest(&seen) else { continue };
            if top + 1 == seen.len() && part[1] < range.high {
                continue;
            }
            let around: Vec<(f64, f64)> =
                seen[top.saturating_sub(1)..(top + 2).min(seen.len())].iter().map(|p| (p.0, p.1.value)).collect();
            if let Some((at, confidence, failure)) = s.refine(&film, wide, peak(&around).unwrap_or(seen[top].0), spp, range)? {
                return Ok(s.found(zone, at, confidence, failure));
            }
        }
    }
    Ok(s.failed(zone, range))
}

impl Search<'_, '_> {
    /// Second: closer views around a place, until cells are as fine as what counts as sharp: place, confidence, failure. `None` when the
    /// first closer look shows that there is nothing.
    fn refine(
        &mut self,
        film: &crate::Film,
        wide: Look,
        start: f64,
        base_spp: u32,
        range: Range,
    ) -> Result<Option<(f64, f64, Option<Failure>)>, ExposeError> {
        let finest = (1.2 * self.af.circle_mm).max(2.0 * self.prober.view.sensor.pitch_mm()[0]);
        let (mut here, mut at, mut confidence) = (wide, start, 0.0);
        for level in 1.. {
            let last = here.pitch_mm <= 1.3 * finest;
            let spp = base_spp * if last { FINE_SPP / SPP } else { 2 };
            let (mut climb, mut together) = (Climb::Flat, 1);
            // Nearer than everyday subjects lie, rims of the blur disks of lamps far behind look like edges of large things.
            let fits = |by: usize| by == 1 || (at <= range.near && here.cells.iter().all(|n| n / by >= FEWEST_CELLS));
            for (by, more) in LOOKS.into_iter().filter(|(by, _)| fits(*by)) {
                let next = self.climb(here, by, more * spp, climb.place().unwrap_or(at), range)?;
                // What was seen in finer cells stands unless coarser ones show it better.
                if by == 1 || next.sure() > climb.sure() || matches!(climb, Climb::Flat) {
                    (climb, together) = (next, by);
                }
                if climb.sure() >= RETRY {
                    break;
                }
            }
            let seen = Look { cells: here.cells.map(|n| n / together), pitch_mm: here.pitch_mm * together as f64, ..here };
            let frame = match climb {
                Climb::Flat if level == 1 => return Ok(None),
                // What a coarser view has shown is all there is.
                Climb::Flat => return Ok(Some((at, 0.4 * confidence, Some(Failure::Uncertain)))),
                Climb::End(end, _) if last => {
                    let near = end > 0.5 * (range.low + range.high);
                    return Ok(Some((end, 0.0, Some(if near { Failure::TooNear } else { Failure::BeyondInfinity }))));
                }
                Climb::End(end, frame) => {
                    at = end;
                    frame
                }
                Climb::Peak { at: top, sure, frame } => {
                    (at, confidence) = (top, sure);
                    if last {
                        break;
                    }
                    frame
                }
            };
            // Where the detail is, in finer cells.
            here = closer(film, seen, &frame, (here.pitch_mm / CLOSER).max(finest));
        }
        let failure = (confidence < 0.5).then_some(Failure::Uncertain);
        Ok(Some((at, confidence, failure)))
    }
}

enum Climb {
    Peak {
        at: f64,
        sure: f64,
        frame: Frame,
    },
    /// It still rises at an end of the range.
    End(f64, Frame),
    Flat,
}

impl Climb {
    fn sure(&self) -> f64 {
        if let Climb::Peak { sure, .. } = self { *sure } else { 0.0 }
    }

    fn place(&self) -> Option<f64> {
        match self {
            Climb::Peak { at, .. } | Climb::End(at, _) => Some(*at),
            Climb::Flat => None,
        }
    }
}

impl Search<'_, '_> {
    /// A probe that is noted, `by` × `by` cells taken together, unless the steps of the motor have led to a place that was seen before.
    fn see(
        &mut self,
        look: Look,
        by: usize,
        spp: u32,
        at: f64,
        seen: &mut Vec<(f64, Sharpness, Frame)>,
    ) -> Result<(), ExposeError> {
        if let Some((at, frame)) = self.probe(look, at, spp)?
            && !seen.iter().any(|(p, ..)| (p - at).abs() < 1e-9)
        {
            let frame = frame.binned(by);
            let sharp = frame.sharpness(self.af.measure, 1);
            self.note(at, sharp);
            seen.push((at, sharp, frame));
        }
        Ok(())
    }

    /// Three probes about a place, more where it rises further; the peak between them.
    fn climb(&mut self, look: Look, by: usize, spp: u32, start: f64, range: Range) -> Result<Climb, ExposeError> {
        self.pass += 1;
        let step = self.width(look.pitch_mm * by as f64, start);
        let mut seen: Vec<(f64, Sharpness, Frame)> = Vec::new();
        let mut wanted = vec![start - step, start, start + step];
        let mut climbs = 0;
        loop {
            for at in wanted.drain(..) {
                self.see(look, by, spp, at.clamp(range.low, range.high), &mut seen)?;
            }
            seen.sort_by(|a, b| a.0.total_cmp(&b.0));
            if seen.is_empty() {
                return Ok(Climb::Flat);
            }
            let top = (0..seen.len()).max_by(|a, b| seen[*a].1.value.total_cmp(&seen[*b].1.value)).unwrap_or(0);
            if seen[top].1.significance() < SURE_SIGNIFICANCE {
                return Ok(Climb::Flat);
            }
            let (low, high) = (top == 0, top == seen.len() - 1);
            if !(low || high) {
                break;
            }
            let next = seen[top].0 + if low { -step } else { step };
            let at_end = (low && seen[top].0 <= range.low + 1e-9) || (high && seen[top].0 >= range.high - 1e-9);
            if at_end {
                return Ok(Climb::End(seen[top].0, seen.swap_remove(top).2));
            }
            climbs += 1;
            if climbs > CLIMBS {
                return Ok(Climb::Flat);
            }
            wanted.push(next);
        }
        let top = (0..seen.len()).max_by(|a, b| seen[*a].1.value.total_cmp(&seen[*b].1.value)).unwrap_or(0);
        // Two more, halfway: the fit has something to average.
        for at in [0.5 * (seen[top - 1].0 + seen[top].0), 0.5 * (seen[top].0 + seen[top + 1].0)] {
            self.see(look, by, spp, at, &mut seen)?;
        }
        seen.sort_by(|a, b| a.0.total_cmp(&b.0));
        let top = (0..seen.len()).max_by(|a, b| seen[*a].1.value.total_cmp(&seen[*b].1.value)).unwrap_or(0);
        let near: Vec<(f64, f64)> =
            seen.iter().filter(|p| (p.0 - seen[top].0).abs() <= 1.05 * step).map(|p| (p.0, p.1.value)).collect();
        let at = peak(&near).unwrap_or(seen[top].0);
        let side = |range: &[(f64, Sharpness, Frame)]| range.iter().map(|p| p.1.value).fold(f64::INFINITY, f64::min);
        let highest_side = side(&seen[..top]).max(side(&seen[top + 1..]));
        let best = seen[top].1;
        let drop = 1.0 - highest_side / best.value;
        // The drop in deviations of the value.
        let deviations = drop * best.value / (best.deviation * best.raw / best.value).max(1e-12);
        let sure = (deviations / (2.0 * SURE_SIGNIFICANCE)).min(drop / (2.0 * DROP)).clamp(0.0, 1.0);
        let frame = seen.swap_remove(top).2;
        Ok(Climb::Peak { at, sure, frame })
    }

    fn found(self, zone: [f64; 4], at: f64, confidence: f64, failure: Option<Failure>) -> Found {
        Found {
            zone,
            extension_mm: at,
            confidence,
            failure,
            method: "contrast",
            moves: self.points.len() as u32,
            curve: self.points,
        }
    }

    /// Nothing stood out: because it is dark or because there is nothing to see.
    fn failed(self, zone: [f64; 4], range: Range) -> Found {
        let dark = self.points.iter().all(|p| p.floor > 0.15 || (p.floor == 0.0 && p.value == 0.0));
        let failure = if dark { Failure::TooDark } else { Failure::NoContrast };
        let at = self.points.iter().max_by(|a, b| a.value.total_cmp(&b.value)).map_or(range.low, |p| p.extension_mm);
        self.found(zone, at, 0.0, Some(failure))
    }
}

/// Number of the highest value, if it stands out of noise.
fn highest(seen: &[(f64, Sharpness)]) -> Option<usize> {
    let top = (0..seen.len()).max_by(|a, b| seen[*a].1.value.total_cmp(&seen[*b].1.value))?;
    (seen[top].1.significance() > SURE_SIGNIFICANCE).then_some(top)
}

/// The block of a view with the most detail, in finer cells.
fn closer(film: &crate::Film, from: Look, frame: &Frame, pitch_mm: f64) -> Look {
    let side = (CELLS as f64 * pitch_mm / from.pitch_mm).round().max(3.0) as usize;
    let size = from.cells.map(|n| side.min(n));
    let [x, y] = frame.busiest_block(size[0], size[1]);
    let cell = [from.piece[2] / from.cells[0] as f64, from.piece[3] / from.cells[1] as f64];
    let piece = [
        from.piece[0] + x as f64 * cell[0],
        from.piece[1] + y as f64 * cell[1],
        size[0] as f64 * cell[0],
        size[1] as f64 * cell[1],
    ];
    look(film, piece, ((piece[2] * film.width_mm * piece[3] * film.height_mm).sqrt() / pitch_mm).round().max(6.0) as usize)
}

/// The reference: all positions from infinity to life size, in steps of half the depth of focus, with every pixel of the zone; it ends
/// after five falling values in a row.
pub(super) fn exhaustive(prober: &mut Prober, af: &Autofocus, zone: [f64; 4], range: Range) -> Result<Found, ExposeError> {
    let film = prober.view.camera.film;
    // Every pixel of the picture, or cells as fine as the fast search's last ones.
    let fine = 1.2 * af.circle_mm;
    let pixels = [(film.columns, film.width_mm, zone[2]), (film.rows, film.height_mm, zone[3])];
    let cells = pixels.map(|(n, mm, fraction)| ((n as f64 * fraction).max(mm * fraction / fine).round() as usize).max(8));
    let whole = Look { piece: zone, cells, pitch_mm: film.width_mm * zone[2] / cells[0] as f64 };
    let mut s = Search::new(prober, af);
    let step = af.sweep_mm.map(|[_, _, step]| step).or(af.step_mm).unwrap_or(s.f_number * af.circle_mm);
    let mut seen: Vec<(f64, Sharpness)> = Vec::new();
    let mut falls = 0;
    let count = ((range.high - range.low) / step - 1e-9).ceil() as usize;
    for k in 0..=count {
        let Some((at, frame)) = s.probe(whole, range.low + k as f64 * step, THOROUGH_SPP)? else { continue };
        let sharp = frame.sharpness(af.measure, 1);
        s.note(at, sharp);
        falls = if seen.last().is_some_and(|l| sharp.value < l.1.value) { falls + 1 } else { 0 };
        seen.push((at, sharp));
        // A curve that has not risen above its noise has no peak to fall from.
        if af.sweep_mm.is_none() && falls >= FALLS && highest(&seen).is_some() {
            break;
        }
    }
    let Some(i) = highest(&seen) else { return Ok(s.failed(zone, range)) };
    let around: Vec<(f64, f64)> = seen[i.saturating_sub(2)..(i + 3).min(seen.len())].iter().map(|p| (p.0, p.1.value)).collect();
    let at = peak(&around).unwrap_or(seen[i].0);
    let failure = match i {
        0 => Some(Failure::BeyondInfinity),
        i if i + 1 == seen.len() => Some(Failure::TooNear),
        _ => None,
    };
    // A peak falls on both sides, by more than noise and by a fraction of itself.
    let lowest = |part: &[(f64, Sharpness)]| part.iter().map(|p| p.1.value).fold(f64::INFINITY, f64::min);
    let drop = 1.0 - lowest(&seen[..i]).max(lowest(&seen[i + 1..])) / seen[i].1.value;
    let sure = (seen[i].1.significance() / (4.0 * SURE_SIGNIFICANCE)).min(drop / (4.0 * DROP));
    let confidence = if failure.is_some() { 0.0 } else { sure.clamp(0.0, 1.0) };
    let failure = failure.or((confidence < 0.5).then_some(Failure::Uncertain));
    Ok(s.found(zone, at, confidence, failure))
}
