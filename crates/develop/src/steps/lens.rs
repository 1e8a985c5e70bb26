//! What the lens did, undone: distortion, lateral colour, vignetting, from what rays through its prescription do (the lens profile of the file).
//!
//! A pixel of the result asks at which height the lens put the light that belongs there; each colour has its own.

use crate::region::{Planes, Region};
use crate::setting::section;
use diopter_image::LensProfile;
use diopter_image::raw::Filter;

section! {
    /// What the lens did, undone.
    Lens "lens" {
        distortion: bool = false, "", Bool,
            "straight lines straight, by the prescription, with the edges cropped that would be empty; off: the lens is what one wants to see";
        lateral_color: bool = false, "", Bool,
            "colours on top of each other, by the prescription";
        vignetting: bool = false, "", Bool,
            "corners as bright as the middle, by the prescription";
    }
}

/// Points of the tables.
const POINTS: usize = 257;
/// Most a corner is brightened: beyond, there is only noise.
const MOST_GAIN: f32 = 8.0;

/// The correction made ready.
pub struct Correction {
    /// Radius in the taken picture over radius in the corrected one, per channel; both of half the diagonal.
    source: Vec<Vec<f32>>,
    /// Factor over the radius in the taken picture.
    gain: Option<Vec<f32>>,
    moves: bool,
}

/// A table from 0 to 1 (a little beyond by its last slope).
fn at(table: &[f32], x: f32) -> f32 {
    let last = table.len() - 1;
    let place = (x * last as f32).max(0.0);
    let i = (place as usize).min(last - 1);
    table[i] + (place - i as f32) * (table[i + 1] - table[i])
}

/// How much of the middle of the straightened picture fills the whole, so that no corner is empty that was not dark before; of lengths in the taken one.
fn filling(profile: &LensProfile) -> f32 {
    let edge = profile.reach.min(1.0);
    (profile.scale * at(&profile.tangents[1], edge / profile.reach) / edge).min(1.0)
}

/// Focal length of the picture that [`Lens`] makes straight, over half the diagonal of the taken one; `None` where it makes none straight.
pub fn straight_focal_length(profile: Option<&LensProfile>, settings: &Lens) -> Option<f64> {
    let profile = profile.filter(|p| settings.distortion && p.is_whole())?;
    Some(f64::from(profile.scale / filling(profile)))
}

impl Correction {
    /// `None` where nothing is asked or known.
    pub fn new(profile: Option<&LensProfile>, settings: &Lens, filters: &[Filter]) -> Option<Self> {
        let moves = settings.distortion || settings.lateral_color;
        let profile = profile.filter(|p| p.is_whole() && (moves || settings.vignetting))?;
        let tangent = |channel: usize, height: f32| at(&profile.tangents[channel], height / profile.reach);
        // Height of green light over the tangent of its angle: the scale of the picture in its middle.
        let scale = profile.scale;
        let fill = filling(profile);
        let height_of = |channel: usize, wanted: f32| {
            // Beyond its reach a table goes on by its last slope: there the lens is dark.
            let (mut low, mut high) = (0.0f32, 3.0);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if tangent(channel, middle) < wanted { low = middle } else { high = middle }
            }
            0.5 * (low + high)
        };
        let source = |filter: &Filter| {
            let own = match filter {
                Filter::Red => 0,
                Filter::Green | Filter::Clear => 1,
                Filter::Linear0 | Filter::Linear45 | Filter::Linear90 | Filter::Linear135 => 1,
                Filter::Blue => 2,
            };
            let channel = if settings.lateral_color { own } else { 1 };
            let along = |i: usize| {
                let r = i as f32 / (POINTS - 1) as f32;
                let wanted = if settings.distortion { fill * r / scale } else { tangent(1, r) };
                let green = if settings.distortion { height_of(1, wanted) } else { r };
                // Against green, so that green itself stays exactly where it is.
                if channel == 1 { green } else { green + height_of(channel, wanted) - height_of(1, wanted) }
            };
            (0..POINTS).map(along).collect()
        };
        let gain = settings.vignetting.then(|| {
            (0..POINTS)
                .map(|i| 1.0 / at(&profile.brightness, i as f32 / (POINTS - 1) as f32 / profile.reach).max(1.0 / MOST_GAIN))
                .collect()
        });
        Some(Correction { source: filters.iter().map(source).collect(), gain, moves })
    }

    /// Where a place of the corrected picture (pixels from its middle) comes from.
    fn from(&self, channel: usize, x: f32, y: f32, half_diagonal: f32) -> (f32, f32) {
        let r = x.hypot(y) / half_diagonal;
        let factor = if r > 1e-6 { at(&self.source[channel], r) / r } else { at(&self.source[channel], 1e-3) / 1e-3 };
        (x * factor, y * factor)
    }

    /// The part of the taken picture that a region is made of. `size`: of the whole picture.
    pub fn source(&self, region: Region, size: [usize; 2]) -> Region {
        if !self.moves {
            return region;
        }
        let (cx, cy, half) = middle(size);
        let mut bounds = [f32::MAX, f32::MAX, f32::MIN, f32::MIN];
        // The mapping is smooth: a coarse grid and a margin hold it.
        let ticks = |n: usize| (0..=8).map(move |k| k as f32 / 8.0 * (n.max(1) - 1) as f32);
        for channel in 0..self.source.len() {
            for dy in ticks(region.height) {
                for dx in ticks(region.width) {
                    let (x, y) = self.from(channel, region.left as f32 + dx - cx, region.top as f32 + dy - cy, half);
                    bounds = [bounds[0].min(x), bounds[1].min(y), bounds[2].max(x), bounds[3].max(y)];
                }
            }
        }
        let (left, top) = ((bounds[0] + cx).floor() as i64 - 4, (bounds[1] + cy).floor() as i64 - 4);
        let (right, bottom) = ((bounds[2] + cx).ceil() as i64 + 5, (bounds[3] + cy).ceil() as i64 + 5);
        Region { left, top, width: (right - left) as usize, height: (bottom - top) as usize }
    }

    /// A corrected region from the planes of [`Correction::source`].
    pub fn apply(&self, from: Planes, region: Region, size: [usize; 2]) -> Planes {
        let (cx, cy, half) = middle(size);
        let mut out = Planes { region, planes: vec![vec![0.0; region.area()]; from.planes.len()] };
        for row in 0..region.height {
            let y = (region.top + row as i64) as f32 - cy;
            for column in 0..region.width {
                let x = (region.left + column as i64) as f32 - cx;
                for (channel, (plane, to)) in from.planes.iter().zip(&mut out.planes).enumerate() {
                    let (sx, sy) = if self.moves { self.from(channel, x, y, half) } else { (x, y) };
                    let gain = self.gain.as_ref().map_or(1.0, |g| at(g, sx.hypot(sy) / half));
                    to[row * region.width + column] = gain
                        * if self.moves {
                            cubic(plane, from.region, sx + cx, sy + cy)
                        } else {
                            plane[row * region.width + column]
                        };
                }
            }
        }
        out
    }
}

/// The middle in pixels, and half the diagonal.
fn middle([w, h]: [usize; 2]) -> (f32, f32, f32) {
    let (w, h) = (w as f32, h as f32);
    (0.5 * (w - 1.0), 0.5 * (h - 1.0), 0.5 * w.hypot(h))
}

/// Catmull-Rom weights of the four pixels around a place `t` past the second.
fn weights(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)]
}

/// A plane between its pixels.
pub(super) fn cubic(plane: &[f32], region: Region, x: f32, y: f32) -> f32 {
    let (fx, fy) = (x.floor(), y.floor());
    let (wx, wy) = (weights(x - fx), weights(y - fy));
    let left = (fx as i64 - region.left - 1).clamp(0, region.width as i64 - 4) as usize;
    let top = (fy as i64 - region.top - 1).clamp(0, region.height as i64 - 4) as usize;
    let mut sum = 0.0;
    for (k, weight) in wy.iter().enumerate() {
        let line = &plane[(top + k) * region.width + left..][..4];
        sum += weight * (wx[0] * line[0] + wx[1] * line[1] + wx[2] * line[2] + wx[3] * line[3]);
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lens with h = f tan θ (1 − 0.2 tan² θ) for green, and colours of slightly other scales.
    fn profile() -> LensProfile {
        let n = 65;
        let height = |t: f64, c: usize| [0.998, 1.0, 1.002][c] * t * (1.0 - 0.2 * t * t);
        let tangents = std::array::from_fn(|c| {
            (0..n)
                .map(|i| {
                    let h = i as f64 / (n - 1) as f64 * 0.8;
                    let (mut low, mut high) = (0.0, 1.2);
                    for _ in 0..60 {
                        let m = 0.5 * (low + high);
                        if height(m, c) < h { low = m } else { high = m }
                    }
                    low as f32
                })
                .collect()
        });
        let brightness = (0..n).map(|i| 1.0 - 0.5 * (i as f32 / (n - 1) as f32).powi(2)).collect();
        LensProfile { reach: 0.8, scale: 1.0, tangents, brightness }
    }

    #[test]
    fn straight_lines_become_straight_and_colours_meet() {
        let size = [801usize, 601];
        let (cx, cy, half) = middle(size);
        let settings = Lens { distortion: true, lateral_color: true, vignetting: false };
        let correction = Correction::new(Some(&profile()), &settings, &Filter::ALL[..3]).unwrap();
        for c in 0..3 {
            for (x, y) in [(100.0f32, 50.0f32), (250.0, -200.0), (30.0, 10.0), (-200.0, 150.0)] {
                // Where the lens puts the light that belongs here.
                let t = x.hypot(y) / half;
                let factor = [0.998, 1.0, 1.002][c] * (1.0 - 0.2 * t * t);
                let (sx, sy) = correction.from(c, x, y, half);
                let miss = (sx - x * factor).hypot(sy - y * factor);
                assert!(miss < 0.02, "{c} {x} {y}: {miss} px");
            }
        }
        let region = Region { left: 500, top: 400, width: 60, height: 40 };
        let from = correction.source(region, size);
        let planes = Planes {
            region: from,
            planes: vec![(0..from.area()).map(|i| (from.left + (i % from.width) as i64) as f32).collect(); 3],
        };
        let got = correction.apply(planes, region, size);
        // The plane says where it comes from.
        let (x, y) = (region.left as f32 + 30.0 - cx, region.top as f32 + 20.0 - cy);
        let (sx, _) = correction.from(1, x, y, half);
        assert!((got.planes[1][20 * 60 + 30] - (sx + cx)).abs() < 1e-3);
    }

    #[test]
    fn corners_become_as_bright_as_the_middle() {
        let size = [801usize, 601];
        let settings = Lens { vignetting: true, ..Lens::default() };
        let correction = Correction::new(Some(&profile()), &settings, &Filter::ALL[..3]).unwrap();
        let (cx, cy, half) = middle(size);
        let region = Region { left: 0, top: 0, width: 801, height: 601 };
        let dark: Vec<f32> = (0..region.area())
            .map(|i| {
                let r = ((i % 801) as f32 - cx).hypot((i / 801) as f32 - cy) / half;
                1.0 - 0.5 * (r / 0.8).powi(2)
            })
            .collect();
        let got = correction.apply(Planes { region, planes: vec![dark; 3] }, region, size);
        // The profile reaches 0.8 of the half diagonal.
        for i in (0..region.area()).filter(|i| ((i % 801) as f32 - cx).hypot((i / 801) as f32 - cy) < 0.79 * half) {
            assert!((got.planes[0][i] - 1.0).abs() < 2e-3, "{i} {}", got.planes[0][i]);
        }
        assert!(Correction::new(Some(&profile()), &Lens::default(), &Filter::ALL[..3]).is_none());
        assert!(Correction::new(None, &settings, &Filter::ALL[..3]).is_none());
    }
}
