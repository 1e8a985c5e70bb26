//! Slanted edges of a picture: the region in which each is measured, at a place or wherever there are any.

use super::{EdgeMtf, LEAST_SIDE, Options, measure};
use crate::measure::{MeasureError, Plane, Region};
use rayon::prelude::*;

/// Sides of regions that are tried where none is given, the largest first.
const SIDES: [usize; 6] = [160, 128, 96, 64, 48, 32];
/// The same for blurs that do not end within these.
const WIDE: [usize; 4] = [224, 320, 448, 640];
/// An edge is at a place where it is no farther than a region's side over this.
const NEAR: usize = 5;
/// Most edges that a search returns.
const MOST_FOUND: usize = 20;

/// Measures the edge at a place (pixels): within the largest region around it that holds just this edge. Fails on a place outside the picture, and as [`measure`] in the
/// smallest region.
pub fn measure_at(plane: &Plane, [x, y]: [f64; 2], options: &Options) -> Result<EdgeMtf, MeasureError> {
    let sides = [plane.width, plane.height];
    if !(x >= 0.0 && y >= 0.0 && x < sides[0] as f64 && y < sides[1] as f64) {
        return Err(MeasureError::unfit(
            format!("place {x},{y}"),
            format!("the picture has {} × {} pixels", sides[0], sides[1]),
            "a place within it",
        ));
    }
    let around = |side: usize| around(plane, [x, y], side);
    plane.check(plane.whole(), LEAST_SIDE)?;
    let [larger @ .., smallest] = SIDES;
    // Where none holds an edge, the smallest says why: it is the least likely to hold something else.
    let is_there = |e: &EdgeMtf, side: usize| {
        let [dx, dy] = [x - e.middle[0], y - e.middle[1]];
        (dx * e.across[0] + dy * e.across[1]).abs() <= (side / NEAR) as f64
    };
    let found = larger.into_iter().find_map(|side| measure(plane, around(side), options).ok().filter(|e| is_there(e, side)));
    let found = found.map_or_else(|| measure(plane, around(smallest), options), Ok)?;
    match is_there(&found, smallest.max(found.region.width)) {
        true => Ok(found),
        false => {
            let [edge_x, edge_y] = found.middle;
            let near = format!("the nearest edge is at {edge_x:.0},{edge_y:.0}");
            Err(MeasureError::unfit(format!("place {x},{y}"), near, "a place on an edge"))
        }
    }
}

/// A square of a side about a place, as far as the picture goes.
fn around(plane: &Plane, [x, y]: [f64; 2], side: usize) -> Region {
    let start = |at: f64, all: usize| (at as usize).saturating_sub(side / 2).min(all.saturating_sub(side));
    let sides = [plane.width, plane.height];
    Region { x: start(x, sides[0]), y: start(y, sides[1]), width: side.min(sides[0]), height: side.min(sides[1]) }
}

/// The edge at a place in the smallest of larger regions within which its blur ends.
fn wide(plane: &Plane, place: [f64; 2], options: &Options) -> Option<EdgeMtf> {
    WIDE.into_iter().find_map(|side| measure(plane, around(plane, place, side), options).ok().filter(is_edge))
}

/// Whether the blur of an edge ends within the reach of its region. What is still rising at the ends is a gradient, such as vignetting, or a blur that is too wide for the region, whose response
/// would be found too high.
fn is_edge(e: &EdgeMtf) -> bool {
    e.mtf50.is_none_or(|f| f * e.reach_px > 1.0)
}

/// Finds the slanted edges of a picture, each in the largest region around its middle that shows nothing else; from top to bottom. Fails on options out of range, below
/// [`LEAST_SIDE`] pixels a side, and where there is no edge.
pub fn find(plane: &Plane, options: &Options) -> Result<Vec<EdgeMtf>, MeasureError> {
    options.check()?;
    plane.check(plane.whole(), LEAST_SIDE)?;
    // A step below this fraction of the picture's range is not looked at.
    const LEAST_STEP: f64 = 0.1;
    let range = plane.samples(plane.whole()).fold([f64::MAX, f64::MIN], |[a, b], v| [a.min(v), b.max(v)]);
    let least_variance = (0.5 * LEAST_STEP * (range[1] - range[0])).powi(2);
    let mut kept: Vec<EdgeMtf> = Vec::new();
    for side in SIDES.into_iter().filter(|s| *s <= plane.width.min(plane.height)) {
        // Smaller regions are for pictures that have no others.
        if kept.len() >= MOST_FOUND {
            break;
        }
        let step = side / 2;
        let starts = |all: usize| (0..=(all - side) / step).map(move |k| k * step).collect::<Vec<_>>();
        let regions: Vec<Region> = starts(plane.height)
            .into_iter()
            .flat_map(|y| starts(plane.width).into_iter().map(move |x| Region { x, y, width: side, height: side }))
            .filter(|r| !kept.iter().any(|k| k.region.overlaps(r)))
            .collect();
        let good = |region: &Region| {
            let (n, sum, squares) = plane.samples(*region).fold((0.0, 0.0, 0.0), |(n, s, q), v| (n + 1.0, s + v, q + v * v));
            let mean = sum / f64::max(n, 1.0);
            let varies = squares / f64::max(n, 1.0) - mean * mean > least_variance;
            // What is still rising at the ends of the region is a gradient, such as vignetting.
            let may_be_edge = |e: &EdgeMtf| e.mtf50.is_none_or(|f| f * side as f64 > 2.0);
            varies.then(|| measure(plane, *region, options).ok().filter(may_be_edge))?
        };
        let mut found: Vec<EdgeMtf> = regions.par_iter().filter_map(good).collect();
        // The best of those that overlap is the one whose edge lies best within its region.
        let off_centre = |e: &EdgeMtf| {
            let [x, y] = [e.region.x as f64, e.region.y as f64].map(|v| v + 0.5 * side as f64);
            (e.middle[0] - x).hypot(e.middle[1] - y)
        };
        found.sort_by(|a, b| {
            let key = |e: &EdgeMtf| (off_centre(e), e.region.y, e.region.x);
            key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal)
        });
        for edge in found {
            if !kept.iter().any(|k| k.region.overlaps(&edge.region)) {
                kept.push(edge);
            }
        }
    }
    kept.truncate(MOST_FOUND);
    // As much of each edge as there is, and each once.
    let mut whole: Vec<EdgeMtf> = Vec::new();
    for edge in kept {
        let centred = measure_at(plane, edge.middle, options).ok().filter(|c| c.region.width >= edge.region.width);
        let edge = centred.unwrap_or(edge);
        // A blur that is too wide for its region may end within a larger one.
        let ends = if is_edge(&edge) { Some(edge) } else { wide(plane, edge.middle, options) };
        let Some(edge) = ends else { continue };
        if !whole.iter().any(|w| w.region.holds(edge.middle)) {
            whole.push(edge);
        }
    }
    let mut kept = whole;
    if kept.is_empty() {
        return Err(MeasureError::unfit(
            "picture",
            "no slanted edge found",
            "a straight edge between two even fields that aren't clipped, slanted by about 5° (\"resolution-chart\" has some) whose blur ends beside it; or --region x,y,width,height",
        ));
    }
    kept.sort_by_key(|e| (e.region.y, e.region.x));
    Ok(kept)
}
