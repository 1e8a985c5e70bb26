//! Saturated channels, guessed from those that are not.
//!
//! Source of the approach: the description of "inpaint opposed" by Iain and Hanno Schwalm (darktable 4.2): a saturated pixel takes the mean, in
//! cube roots, of the other colours around it, shifted by the colour cast of what is just not saturated near by. Where all colours are
//! saturated we go on to white.

use crate::overview::SATURATED;
use crate::region::Region;
use crate::setting::{names, section};
use diopter_image::{Cfa, RawImage};
use rayon::prelude::*;

section! {
    /// What is brighter than the sensor can tell.
    Highlights "highlights" {
        method: HighlightMethod = HighlightMethod::Recover, "", Names(HighlightMethod::NAMES),
            "clip: neutral where the first channel saturates, as bright as that; recover: saturated channels are guessed from the others";
    }
}

names! {
    /// What is done about saturated channels.
    #[non_exhaustive]
    HighlightMethod {
        /// All channels end where the first saturates: blown highlights are white.
        Clip = "clip",
        /// Saturated channels are guessed from those that are not.
        Recover = "recover",
    }
}

/// Colour casts next to saturated places, a number a channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Cast(Vec<f32>);

/// Pixels a side of the cells in which saturation is looked for.
const CELL: usize = 8;

/// How far around a pixel the other colours are taken from: enough for every pattern to have them all.
pub fn reach(cfa: &Cfa) -> usize {
    if cfa.is_bayer() {
        1
    } else if cfa.has_all_channels() {
        // The samples of the pixel itself and of its neighbours.
        cfa.channel_count() - 1
    } else {
        cfa.columns().max(cfa.rows()) / 2
    }
}

/// Balanced value at which a channel saturates.
fn limits(gains: &[f32]) -> Vec<f32> {
    gains.iter().map(|g| g * SATURATED).collect()
}

/// Means of the cube roots of each channel around a pixel, and how many of the values were saturated.
fn around(
    data: &[f32],
    width: usize,
    i: usize,
    reach: usize,
    channel: impl Fn(i64, i64) -> usize,
    limits: &[f32],
) -> [(f32, f32, f32); 4] {
    let mut sums = [(0.0, 0.0, 0.0); 4];
    let reach = reach as i64;
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let c = channel(dx, dy);
            let v = data[(i as i64 + dy * width as i64 + dx) as usize];
            sums[c].0 += v.max(0.0).cbrt();
            sums[c].1 += 1.0;
            sums[c].2 += f32::from(u8::from(v >= limits[c]));
        }
    }
    sums
}

/// The mean of the other colours at a pixel, and the fraction of them that is saturated. A saturated colour is at least as bright as it reads, and taken for as bright as those of
/// the others that are not: in white light whose blue is lost, too, green is as bright as red.
fn opposed(sums: &[(f32, f32, f32); 4], own: usize, channels: usize) -> (f32, f32) {
    let others =
        || (0..channels).filter(|c| *c != own && sums[*c].1 > 0.0).map(|c| (sums[c].0 / sums[c].1, sums[c].2 / sums[c].1));
    let (mut kept, mut weights, mut saturated, mut n) = (0.0, 0.0f32, 0.0, 0.0f32);
    for (root, full) in others() {
        kept += (1.0 - full) * root;
        weights += 1.0 - full;
        saturated += full;
        n += 1.0;
    }
    let n = n.max(1.0);
    let unsaturated = if weights > 0.0 { kept / weights } else { 0.0 };
    let mean = others().map(|(root, full)| root + full * (unsaturated - root).max(0.0)).sum::<f32>() / n;
    (mean * mean * mean, saturated / n)
}

/// How far towards white a saturated value goes where so much of the other colours is saturated: not where half of them tell what they saw, wholly where none does.
fn towards_white(saturated: f32) -> f32 {
    (2.0 * saturated - 1.0).max(0.0)
}

/// Clips or recovers saturated values of a mosaic, in place. `data`: `[row][column]` of `region`, 1 = saturation, balanced by `gains` (one a channel). The
/// outer [`reach`] pixels on each side are read and left as they are.
pub fn apply(data: &mut [f32], region: Region, cfa: &Cfa, gains: &[f32], method: HighlightMethod, cast: Option<&Cast>) {
    let Some(cast) = cast.filter(|_| method == HighlightMethod::Recover) else {
        if method == HighlightMethod::Clip {
            // Not above 1 either, where every channel is amplified.
            let first = gains.iter().copied().fold(1.0, f32::min);
            data.iter_mut().for_each(|v| *v = v.min(first));
        }
        return;
    };
    let limits = limits(gains);
    let lowest = limits.iter().copied().fold(f32::MAX, f32::min);
    let white = gains.iter().copied().fold(0.0, f32::max);
    let (w, r) = (region.width, reach(cfa));
    let from = data.to_vec();
    for y in r..region.height.saturating_sub(r) {
        for x in r..w.saturating_sub(r) {
            let i = y * w + x;
            if from[i] < lowest {
                continue;
            }
            let (px, py) = (region.left + x as i64, region.top + y as i64);
            let own = cfa.channel_beyond(px, py);
            if from[i] < limits[own] {
                continue;
            }
            let sums = around(&from, w, i, r, |dx, dy| cfa.channel_beyond(px + dx, py + dy), &limits);
            let (mean, saturated) = opposed(&sums, own, limits.len());
            let guess = (mean + cast.0[own]).max(from[i]);
            data[i] = guess + towards_white(saturated) * (white.max(guess) - guess);
        }
    }
}

/// Looks for saturated places and the casts around them; `None` where nothing is saturated.
pub fn cast(raw: &RawImage, gains: &[f32]) -> Option<Cast> {
    let h = &raw.header;
    let (w, height, n) = (raw.mosaic.width, raw.mosaic.height, h.cfa.channel_count());
    let full = h.black_level + f64::from(SATURATED) * (h.white_level - h.black_level);
    let full = full.ceil().clamp(0.0, 65_535.0) as u16;
    let across = w.div_ceil(CELL);
    let cells: Vec<bool> = raw
        .mosaic
        .data
        .par_chunks(w * CELL)
        .flat_map_iter(|rows| {
            let mut cells = vec![false; across];
            for line in rows.chunks(w) {
                for (cell, part) in cells.iter_mut().zip(line.chunks(CELL)) {
                    *cell |= part.iter().fold(0, |a, b| a.max(*b)) >= full;
                }
            }
            cells
        })
        .collect();
    if !cells.iter().any(|c| *c) {
        return None;
    }
    let down = cells.len() / across;
    let near = |cx: usize, cy: usize| {
        (cy.saturating_sub(1)..(cy + 2).min(down))
            .any(|y| (cx.saturating_sub(1)..(cx + 2).min(across)).any(|x| cells[y * across + x]))
    };
    let limits = limits(gains);
    let r = reach(&h.cfa);
    let sums: Vec<(f64, f64)> = (0..down)
        .into_par_iter()
        .map(|cy| {
            let mut sums = vec![(0.0, 0.0); n];
            for cx in (0..across).filter(|cx| near(*cx, cy)) {
                let region = Region { left: (cx * CELL) as i64, top: (cy * CELL) as i64, width: CELL, height: CELL };
                let grown = region.grown(r);
                let data = super::black_level::take(raw, grown, gains, &[]);
                for y in 0..CELL {
                    for x in 0..CELL {
                        let (px, py) = (cx * CELL + x, cy * CELL + y);
                        if px >= w || py >= height {
                            continue;
                        }
                        let own = h.cfa.channel_at(px, py);
                        let v = data[(y + r) * grown.width + x + r];
                        // Bright, but neither it nor what it is compared with is saturated.
                        if v < 0.2 * limits[own] || v >= limits[own] {
                            continue;
                        }
                        let channel = |dx: i64, dy: i64| h.cfa.channel_beyond(px as i64 + dx, py as i64 + dy);
                        let around = around(&data, grown.width, (y + r) * grown.width + x + r, r, channel, &limits);
                        let (mean, saturated) = opposed(&around, own, n);
                        if saturated == 0.0 {
                            sums[own].0 += f64::from(v - mean);
                            sums[own].1 += 1.0;
                        }
                    }
                }
            }
            sums
        })
        .reduce(|| vec![(0.0, 0.0); n], |a, b| a.iter().zip(&b).map(|(a, b)| (a.0 + b.0, a.1 + b.1)).collect());
    Some(Cast(sums.iter().map(|(sum, count)| if *count > 0.0 { (sum / count) as f32 } else { 0.0 }).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::steps::black_level;
    use crate::tests::raw;

    /// A patch that gets brighter to the right, seen by a camera whose green saturates first.
    fn ramp(x: usize) -> f64 {
        0.3 + 1.2 * x as f64 / 120.0
    }

    #[test]
    fn a_saturated_channel_follows_the_others() {
        let neutral = [0.5, 1.0, 0.6];
        let cfa = Cfa::parse("RG/GB").unwrap();
        let image = raw(120, 40, "RG/GB", |x, y| (1000.0 * neutral[cfa.channel_at(x, y)] * ramp(x)).min(1000.0));
        let gains: Vec<f32> = neutral.iter().map(|n| 1.0 / *n as f32).collect();
        let cast = cast(&image, &gains).unwrap();
        let region = Region::whole(120, 40);
        let mut data = black_level::take(&image, region, &gains, &[]);
        apply(&mut data, region, &cfa, &gains, HighlightMethod::Recover, Some(&cast));
        // Green saturates at 1, where x = 70; blue at 1.67, red at 2: light up to 1.5 is known by both.
        for x in 75..115 {
            let y = 20 + (x + 1) % 2;
            assert_eq!(cfa.channel_at(x, y), 1);
            let got = f64::from(data[y * 120 + x]);
            assert!((got / ramp(x) - 1.0).abs() < 0.04, "{x}: {got} of {}", ramp(x));
        }
        let mut clipped = black_level::take(&image, region, &gains, &[]);
        apply(&mut clipped, region, &cfa, &gains, HighlightMethod::Clip, None);
        assert!(clipped.iter().all(|v| *v <= 1.0));
    }

    #[test]
    fn white_light_stays_white_until_no_channel_tells_how_bright_it_is() {
        // Green saturates at 1, blue at 1.67, red at 2.
        let neutral = [0.5, 1.0, 0.6];
        let cfa = Cfa::parse("RG/GB").unwrap();
        let light = |x: usize| 0.6 + 1.8 * x as f64 / 240.0;
        let image = raw(240, 40, "RG/GB", |x, y| (1000.0 * neutral[cfa.channel_at(x, y)] * light(x)).min(1000.0));
        let gains: Vec<f32> = neutral.iter().map(|n| 1.0 / *n as f32).collect();
        let region = Region::whole(240, 40);
        let mut data = black_level::take(&image, region, &gains, &[]);
        apply(&mut data, region, &cfa, &gains, HighlightMethod::Recover, cast(&image, &gains).as_ref());
        for x in 5..235 {
            for y in 20..22 {
                let (got, expected) = (f64::from(data[y * 240 + x]), light(x).min(2.0));
                assert!((got / expected - 1.0).abs() < 0.04, "{x}, channel {}: {got} of {expected}", cfa.channel_at(x, y));
            }
        }
    }

    #[test]
    fn what_no_channel_saw_is_white() {
        let neutral = [0.5, 1.0, 0.6];
        let cfa = Cfa::parse("RG/GB").unwrap();
        let image = raw(40, 40, "RG/GB", |_, _| 1000.0);
        let gains: Vec<f32> = neutral.iter().map(|n| 1.0 / *n as f32).collect();
        let region = Region::whole(40, 40);
        let mut data = black_level::take(&image, region, &gains, &[]);
        apply(&mut data, region, &cfa, &gains, HighlightMethod::Recover, cast(&image, &gains).as_ref());
        let inside: Vec<f32> = (5..35).flat_map(|y| data[y * 40 + 5..y * 40 + 35].to_vec()).collect();
        assert!(inside.iter().all(|v| (v - 2.0).abs() < 1e-3), "{:?}", &inside[..8]);
        assert_eq!(super::cast(&raw(40, 40, "RG/GB", |_, _| 500.0), &gains), None);
    }
}
