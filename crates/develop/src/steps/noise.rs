//! Less noise, by what the file says of its noise: wavelet coefficients that noise alone could have made are shrunk.
//!
//! Brightness (a weighted mean of the channels) and each channel's difference to it are treated apart. The transform is the à trous algorithm with
//! the B3 spline; coefficients are shrunk by d (1 − (tσ/d)²), the non-negative garrote. How much noise of each channel reaches each scale behind
//! the demosaic is measured once, on noise. Sources: Starck, Fadili & Murtagh 2007, "The undecimated wavelet decomposition and its reconstruction"
//! (IEEE TIP 16); Gao 1998, "Wavelet shrinkage denoising using the non-negative garrote".

use super::demosaic::{Demosaicer, Mosaic};
use crate::region::{Planes, Region};
use crate::setting::section;
use diopter_image::{Cfa, RawImage};

section! {
    /// Less noise.
    Noise "noise" {
        luminance: f64 = 0.0, "", Number(0.0, 1.0),
            "brightness noise taken away, by the noise profile of the file; off: noise is part of the truth";
        color: f64 = 0.0, "", Number(0.0, 1.0),
            "colour noise taken away";
    }
}

/// Scales: noise coarser than 32 pixels is left.
const SCALES: usize = 5;
/// How far around a pixel is looked: twice the sum of the spacings 1, 2, 4, 8, 16.
pub const REACH: usize = 62;
/// Deviations of noise that full strength takes away.
const FULL: f32 = 3.0;
/// Colour can be treated more strongly: it has little detail.
const FULL_COLOUR: f32 = 4.5;

/// The step made ready.
pub struct Reducer {
    strength: [f32; 2],
    /// Weights of the channels in brightness.
    weights: Vec<f32>,
    /// Noise of each balanced channel: variance = `[0]` · value + `[1]`.
    profile: Vec<[f32; 2]>,
    /// Variance of each component at each scale for unit noise in the pixels of a channel: `[component][scale][channel]`.
    power: Vec<[Vec<f32>; SCALES]>,
}

impl Reducer {
    /// `None` where nothing is to be done. `gains`: of the white balance.
    pub fn new(settings: &Noise, raw: &RawImage, gains: &[f32], demosaicer: &Demosaicer) -> Option<Self> {
        if settings.luminance == 0.0 && settings.color == 0.0 {
            return None;
        }
        let cfa = &raw.header.cfa;
        let n = cfa.channel_count();
        let weights = if n == 3 { vec![0.25, 0.5, 0.25] } else { vec![1.0 / n as f32; n] };
        let told = &raw.header.noise;
        let profile = match told.len() == n {
            true => told.iter().map(|p| p.map(|v| v as f32)).collect::<Vec<_>>(),
            false => vec![estimate(raw); n],
        };
        // Too small or too even to be measured: shot noise of some ten thousand electrons, and a little more.
        let unknown = profile.iter().all(|p: &[f32; 2]| *p == [0.0; 2]) && told.len() != n;
        let profile = if unknown { vec![[1e-4, 1e-6]; n] } else { profile };
        let profile = profile.iter().zip(gains).map(|([a, b], g)| [a * g, b * g * g]).collect();
        let power = measure(cfa, demosaicer, &weights);
        Some(Reducer {
            strength: [settings.luminance as f32 * FULL, settings.color as f32 * FULL_COLOUR],
            weights,
            profile,
            power,
        })
    }

    /// The same for pixels that are means of so many pixels of the mosaic, or cells of a halved one.
    pub fn with_noise_of(mut self, samples: f32) -> Self {
        self.profile.iter_mut().for_each(|p| *p = p.map(|v| v / samples.max(1.0)));
        self
    }

    /// The pixels of `region`; the planes reach [`REACH`] further.
    pub fn apply(&self, planes: Planes, region: Region) -> Planes {
        let from = planes.region;
        let mut components = split(&planes, &self.weights);
        // The level that the noise is judged by: brightness without its finer scales.
        let mut level = components[0].clone();
        for scale in 0..2 {
            level = smoothed(&level, from.width, 1 << scale);
        }
        for (k, component) in components.iter_mut().enumerate() {
            let strength = self.strength[usize::from(k > 0)];
            if strength == 0.0 {
                continue;
            }
            let mut coarse = std::mem::take(component);
            let mut sum = vec![0.0f32; coarse.len()];
            for scale in 0..SCALES {
                let next = smoothed(&coarse, from.width, 1 << scale);
                // Variance as a line in the level.
                let (a, b) = self
                    .profile
                    .iter()
                    .zip(&self.power[k][scale])
                    .fold((0.0, 0.0), |(a, b), (p, power)| (a + p[0] * power, b + p[1] * power));
                let t2 = strength * strength;
                for (((sum, fine), smooth), level) in sum.iter_mut().zip(&coarse).zip(&next).zip(&level) {
                    let d = fine - smooth;
                    let noise = t2 * (a * level.max(0.0) + b);
                    *sum += d * (1.0 - noise / (d * d).max(1e-20)).max(0.0);
                }
                coarse = next;
            }
            sum.iter_mut().zip(&coarse).for_each(|(s, c)| *s += c);
            *component = sum;
        }
        join(components, from).cut(region)
    }
}

/// Brightness, then each channel's difference to it; of one channel only itself.
fn split(planes: &Planes, weights: &[f32]) -> Vec<Vec<f32>> {
    let mut brightness = vec![0.0f32; planes.region.area()];
    for (plane, w) in planes.planes.iter().zip(weights) {
        brightness.iter_mut().zip(plane).for_each(|(b, v)| *b += w * v);
    }
    let difference = |p: &Vec<f32>| p.iter().zip(&brightness).map(|(v, b)| v - b).collect::<Vec<f32>>();
    let differences: Vec<Vec<f32>> = if weights.len() == 1 { vec![] } else { planes.planes.iter().map(difference).collect() };
    std::iter::once(brightness).chain(differences).collect()
}

fn join(mut components: Vec<Vec<f32>>, region: Region) -> Planes {
    let differences = components.split_off(1);
    let brightness = components.remove(0);
    if differences.is_empty() {
        return Planes { region, planes: vec![brightness] };
    }
    let mut planes = differences;
    planes.iter_mut().for_each(|p| p.iter_mut().zip(&brightness).for_each(|(v, b)| *v += b));
    Planes { region, planes }
}

/// One step of the à trous algorithm: 1 4 6 4 1 with a spacing, both ways. Within twice the spacing of an edge values are not to be used.
fn smoothed(plane: &[f32], w: usize, spacing: usize) -> Vec<f32> {
    let h = plane.len() / w;
    let kernel = |a: f32, b: f32, c: f32, d: f32, e: f32| 0.0625 * (a + e) + 0.25 * (b + d) + 0.375 * c;
    let mut across = plane.to_vec();
    if w > 4 * spacing {
        for (line, to) in plane.chunks_exact(w).zip(across.chunks_exact_mut(w)) {
            for x in 2 * spacing..w - 2 * spacing {
                to[x] = kernel(line[x - 2 * spacing], line[x - spacing], line[x], line[x + spacing], line[x + 2 * spacing]);
            }
        }
    }
    let mut out = across.clone();
    for y in 2 * spacing..h.saturating_sub(2 * spacing) {
        let line = |k: usize| &across[(y + k * spacing - 2 * spacing) * w..][..w];
        let [a, b, c, d, e] = std::array::from_fn(line);
        for (x, to) in out[y * w..][..w].iter_mut().enumerate() {
            *to = kernel(a[x], b[x], c[x], d[x], e[x]);
        }
    }
    out
}

/// What unit noise in the pixels of each channel becomes, by trial on a grey field.
fn measure(cfa: &Cfa, demosaicer: &Demosaicer, weights: &[f32]) -> Vec<[Vec<f32>; SCALES]> {
    const SIDE: usize = 160;
    const AMPLITUDE: f32 = 0.01;
    let n = weights.len();
    let cell = demosaicer.cell(cfa);
    let region = Region::whole(SIDE, SIDE);
    let around = Region { left: 0, top: 0, width: SIDE * cell[0], height: SIDE * cell[1] }.grown(demosaicer.reach());
    let mut power: Vec<[Vec<f32>; SCALES]> = vec![std::array::from_fn(|_| vec![0.0; n]); if n == 1 { 1 } else { n + 1 }];
    for channel in 0..n {
        // A plain generator: the noise need only be white (Marsaglia 2003, xorshift).
        let mut state = 0x2545_f491u32;
        let mut uniform = || {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            state as f32 / u32::MAX as f32 - 0.5
        };
        let data = (0..around.area())
            .map(|i| {
                let (x, y) = (around.left + (i % around.width) as i64, around.top + (i / around.width) as i64);
                let own = cfa.channel_beyond(x, y);
                // A uniform number has a variance of 1/12.
                let noise = 12f32.sqrt() * uniform() * AMPLITUDE;
                if own == channel { 0.5 + noise } else { 0.5 }
            })
            .collect();
        let planes = demosaicer.run(&Mosaic { region: around, data, cfa }, region);
        for (k, component) in split(&planes, weights).into_iter().enumerate() {
            let mut coarse = component;
            for scale in 0..SCALES {
                let next = smoothed(&coarse, SIDE, 1 << scale);
                let (mut sum, mut count) = (0.0f64, 0.0f64);
                for y in REACH / 2..SIDE - REACH / 2 {
                    for x in REACH / 2..SIDE - REACH / 2 {
                        sum += f64::from(coarse[y * SIDE + x] - next[y * SIDE + x]).powi(2);
                        count += 1.0;
                    }
                }
                power[k][scale][channel] = (sum / count) as f32 / (AMPLITUDE * AMPLITUDE);
                coarse = next;
            }
        }
    }
    power
}

/// Noise of a file that does not tell, of the unbalanced fraction of saturation: the calm parts of small blocks, a line through them.
fn estimate(raw: &RawImage) -> [f32; 2] {
    const BLOCK: usize = 16;
    let (w, h) = (raw.mosaic.width, raw.mosaic.height);
    let (columns, rows) = (raw.header.cfa.columns().max(2), raw.header.cfa.rows().max(2));
    let scale = (1.0 / (raw.header.white_level - raw.header.black_level)) as f32;
    let black = raw.header.black_level as f32;
    let mut bins: Vec<Vec<f32>> = vec![Vec::new(); 32];
    // About forty thousand blocks say enough.
    let step = ((w * h / (BLOCK * BLOCK)) / 40_000 + 1).min(64);
    let blocks = (0..h.saturating_sub(BLOCK + rows))
        .step_by(BLOCK)
        .flat_map(|y| (0..w.saturating_sub(BLOCK + columns)).step_by(BLOCK).map(move |x| (x, y)));
    for (x, y) in blocks.step_by(step) {
        let (mut sum, mut squares) = (0.0f32, 0.0f32);
        for dy in 0..BLOCK {
            for dx in 0..BLOCK {
                let at = |x: usize, y: usize| (f32::from(raw.mosaic.data[y * w + x]) - black) * scale;
                let v = at(x + dx, y + dy);
                let d = v - at(x + dx + columns, y + dy);
                sum += v;
                squares += 0.5 * d * d;
            }
        }
        let count = (BLOCK * BLOCK) as f32;
        let mean = sum / count;
        if mean < 0.9 {
            bins[((mean.max(0.0).sqrt() * 32.0) as usize).min(31)].push(squares / count);
        }
    }
    // The tenth part with the least variance of each brightness holds little but noise.
    let points: Vec<(f32, f32)> = bins
        .iter_mut()
        .enumerate()
        .filter(|(_, b)| b.len() >= 20)
        .map(|(i, b)| {
            b.sort_unstable_by(f32::total_cmp);
            (((i as f32 + 0.5) / 32.0).powi(2), b[b.len() / 10])
        })
        .collect();
    let n = points.len() as f32;
    let (sx, sy) = points.iter().fold((0.0, 0.0), |(a, b), p| (a + p.0, b + p.1));
    let (sxx, sxy) = points.iter().fold((0.0, 0.0), |(a, b), p| (a + p.0 * p.0, b + p.0 * p.1));
    let det = n * sxx - sx * sx;
    if points.len() < 2 || det <= 0.0 {
        return [0.0, sy / n.max(1.0)];
    }
    let slope = ((n * sxy - sx * sy) / det).max(0.0);
    [slope, ((sy - slope * sx) / n).max(0.0)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::Demosaic;
    use crate::tests::{gaussian, raw};

    /// Noise of the signal as a sensor has it: variance 0.5 DN² a DN above black, and 16.
    fn noisy(level: f64, i: usize) -> f64 {
        level + gaussian(i) * (0.5 * level + 16.0).sqrt()
    }

    fn deviation(plane: &[f32]) -> f32 {
        let n = plane.len() as f32;
        let mean = plane.iter().sum::<f32>() / n;
        (plane.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / n).sqrt()
    }

    #[test]
    fn noise_goes_and_edges_stay() {
        let edge = |x: usize| if x < 150 { 100.0 } else { 400.0 };
        let mut image = raw(300, 300, "RG/GB", |x, y| noisy(edge(x), y * 300 + x));
        for told in [true, false] {
            // Fractions of saturation (1000 DN).
            image.header.noise = if told { vec![[0.5 / 1000.0, 16.0 / 1e6]; 3] } else { vec![] };
            let demosaicer = Demosaicer::new(Demosaic::Gbtf, &image.header.cfa);
            let gains = [1.0; 3];
            let region = Region { left: 80, top: 80, width: 140, height: 140 };
            let around = region.grown(REACH);
            let mosaic_region = around.grown(demosaicer.reach());
            let data = crate::steps::black_level::take(&image, mosaic_region, &gains, &[]);
            let planes = demosaicer.run(&Mosaic { region: mosaic_region, data, cfa: &image.header.cfa }, around);
            let reducer = Reducer::new(&Noise { luminance: 1.0, color: 1.0 }, &image, &gains, &demosaicer).unwrap();
            let before = planes.clone().cut(region);
            let after = reducer.apply(planes, region);
            let flat = |p: &Planes| p.planes[1].chunks(140).flat_map(|r| r[..50].to_vec()).collect::<Vec<f32>>();
            let ratio = deviation(&flat(&after)) / deviation(&flat(&before));
            assert!(ratio < 0.3, "{told}: {ratio}");
            // The step lies between columns 149 and 150 of the picture.
            let mean_of = |x: usize| (0..140).map(|y| after.planes[1][y * 140 + x]).sum::<f32>() / 140.0;
            assert!((mean_of(60) - 0.1).abs() < 0.01 && (mean_of(78) - 0.4).abs() < 0.015, "{} {}", mean_of(60), mean_of(78));
            assert!(mean_of(67) < 0.14 && mean_of(72) > 0.36, "{} {}", mean_of(67), mean_of(72));
        }
    }

    #[test]
    fn a_file_that_does_not_tell_is_measured() {
        let image = raw(600, 400, "RG/GB", |x, y| noisy(20.0 + 1.2 * x as f64, y * 600 + x));
        let [slope, floor] = estimate(&image);
        // The calmest tenth lies below the mean by some tenths.
        assert!((0.3e-3..0.6e-3).contains(&slope), "{slope}");
        assert!((0.0..40e-6).contains(&floor), "{floor}");
    }
}
