//! Learning where light comes from, by paths of its own.
//!
//! Paths run in batches that grow, each with what was learnt before; half of them are guided, half are not. The records of a batch ([`super::record`])
//! are sorted by region, and every region learns from its own in their order: results depend on nothing but seed, scene, camera and film.
//! At a pixel two guided and two unguided paths are followed; their differences tell what guiding gains, and a guide that does not pay is
//! given up, after a quarter of the training or at its end.
//!
//! Sources: T. Müller et al. 2017 (growing iterations, division of regions by their records), T. Müller 2019, "Practical Path Guiding in
//! Production" (stochastic filters; what was learnt before is kept), A. Rath et al. 2020 (second moments). Densities that have drawn a record are
//! bounded from below where it is learnt from: tails of lobes would else shout down the rest. That bends the guide, never the picture.

use super::quadtree::{Moments, PER_STERADIAN};
use super::record::{PathRecord, Record};
use super::spatial::{Spread, width_of};
use super::{Guide, GuideMode, Region};
use crate::radiance::{PathSettings, Precomputed};
use crate::scene::Scene;
use diopter_light::random::{Sampler, SamplerKind, mix, to_unit};
use diopter_light::{Ray, Wavelengths};
use rayon::prelude::*;

/// One of so many paths of an exposure is followed for training.
const PATHS_OF_EXPOSURE: u64 = 8;
/// Fewer teach too little, more hardly more than these: regions and cells are bounded.
const FEWEST_PATHS: u64 = 1 << 15;
const MOST_PATHS: u64 = 1 << 23;
/// Pixels of the first batch and of the largest; four paths each. The largest holds about 20 MB of records.
const FIRST_BATCH: u64 = 256;
const LARGEST_BATCH: u64 = 1 << 14;
/// Pixels that a thread takes at once.
const CHUNK: u64 = 64;
/// Paths of a pixel: the first half guided, the other not.
const PATHS_OF_PIXEL: u32 = 4;

/// Records after which a region is divided, and records of all over its square beyond which it grows: more paths make regions smaller and surer alike.
const RECORDS_OF_REGION: f64 = 4096.0;
const RECORDS_BY_ROOT: f64 = 4.0;
/// Regions: with densities of at most 10 KB each, 80 MB.
const MOST_REGIONS: usize = 8192;
/// New records before a density is rebuilt, if they are also as many as those it was built from.
const RECORDS_TO_REBUILD: f32 = 64.0;
/// What counts of older records each time: they are of worse guides, and of coarser cells.
const REMEMBERED: f32 = 0.25;
/// Records that a divided region's density stands for in its parts.
const INHERITED: f32 = 512.0;
/// Part of the deviation of a region's records by which they are moved (uniformly up to √3/2 of it, half of its width): the stochastic filter between regions.
const FILTER: f32 = 0.866;
/// Least density, 1/sr, that a record counts as drawn with: a tenth of an even one.
const LEAST_PDF: f32 = 0.1 * PER_STERADIAN;

/// Fractions of directions drawn by the scattering function among which a region chooses, once it has records enough.
const BSDF_FRACTIONS: [f32; 6] = [0.1, 0.3, 0.5, 0.7, 0.9, 1.0];
const FIRST_BSDF_FRACTION: f32 = 0.5;
const RECORDS_TO_CHOOSE: f64 = 128.0;

/// What a guided segment costs more than another: looking up and drawing. Estimated, beside 0.5 to 2 µs of tracing and shading.
const GUIDED_COST: f64 = 1.15;
/// Gain, in variance times cost, below which the guide is given up: at a quarter of the training, when it has learnt little, and at the end.
const LEAST_GAIN_EARLY: f64 = 1.0;
const LEAST_GAIN: f64 = 1.1;
/// Blocks a side of the film, whose means the variances of their pixels are compared with; ε of relative squared errors; one of so many blocks, those
/// with the largest variances of both, is left out: a single outlier must not decide.
const BLOCKS: usize = 16;
const EPSILON: f64 = 0.01;
const LEFT_OUT: usize = 16;

/// A camera ray and the wavelengths of its path for a pixel (column, row), by the camera's numbers of a sampler; `None` where no light comes through.
pub type CameraPath<'a> = &'a (dyn Fn([u32; 2], &Sampler) -> Option<(Ray, Wavelengths)> + Sync);

/// How a guide is trained.
#[derive(Clone, Copy, Debug)]
pub struct Training {
    /// Paths to follow ([`Training::paths`]).
    pub paths: u64,
    /// Pixels across and down the film.
    pub film: [u32; 2],
    /// Seed of the exposure.
    pub seed: u64,
    /// How far its paths go.
    pub path: PathSettings,
    /// Whether a guide that does not pay is kept.
    pub mode: GuideMode,
}

/// What came of a training.
#[derive(Clone, Debug)]
pub struct Trained {
    /// The guide; `None` where it does not pay.
    pub guide: Option<Guide>,
    /// Variance times cost without the guide over the same with it, relative to the light of the surroundings; `None` where no light was found.
    pub gain: Option<f64>,
    /// Paths that were followed.
    pub paths: u64,
}

impl Training {
    /// Paths that are worth following for an exposure of so many; `None` where guiding cannot pay, or where there are too few to learn from.
    pub fn paths(exposure: u64, path: &PathSettings, mode: GuideMode) -> Option<u64> {
        let paths = exposure / PATHS_OF_EXPOSURE;
        // The first event alone is found by aiming at lights.
        let can_help = path.max_depth >= 2 && paths >= FEWEST_PATHS;
        match mode {
            GuideMode::Off => None,
            GuideMode::Auto => can_help.then_some(paths.min(MOST_PATHS)),
            GuideMode::On => (path.max_depth >= 1).then_some(paths.clamp(FEWEST_PATHS, MOST_PATHS)),
        }
    }

    /// Trains a guide. `go_on` is told the fraction that is done and says whether to go on; `None` if not.
    pub fn run(&self, scene: &Scene, camera: CameraPath, go_on: &mut dyn FnMut(f64) -> bool) -> Option<Trained> {
        let pixels = (self.paths / u64::from(PATHS_OF_PIXEL)).max(1);
        // The gain is measured between the first two of these, and between the last two.
        let marks = [pixels / 8, pixels / 4, pixels / 2, pixels];
        let mut learner = Learner::new();
        let mut trial = Trial::new();
        let (mut done, mut batch) = (0, FIRST_BATCH);
        while done < pixels {
            if !go_on(done as f64 / pixels as f64) {
                return None;
            }
            let next = marks.into_iter().find(|m| *m > done).unwrap_or(pixels);
            let end = (done + batch).min(next);
            let chunks: Vec<Chunk> = (0..(end - done).div_ceil(CHUNK))
                .into_par_iter()
                .map(|c| {
                    let first = done + c * CHUNK;
                    self.follow(scene, camera, &learner, first..(first + CHUNK).min(end))
                })
                .collect();
            for chunk in &chunks {
                chunk.pixels.iter().for_each(|p| trial.add(p));
            }
            learner.learn(chunks.into_iter().map(|c| c.lessons).collect());
            (done, batch) = (end, (2 * batch).min(LARGEST_BATCH));
            if done == marks[0] || done == marks[2] {
                trial = Trial::new();
            }
            if done == marks[1] && self.mode == GuideMode::Auto {
                let gain = trial.gain();
                if gain.is_none_or(|g| g < LEAST_GAIN_EARLY) {
                    return Some(Trained { guide: None, gain, paths: done * u64::from(PATHS_OF_PIXEL) });
                }
            }
        }
        let gain = trial.gain();
        let pays = self.mode == GuideMode::On || gain.is_some_and(|g| g >= LEAST_GAIN);
        let guide = pays.then(|| learner.finish());
        Some(Trained { guide, gain, paths: pixels * u64::from(PATHS_OF_PIXEL) })
    }

    /// The paths of some of the training's pixels.
    fn follow(&self, scene: &Scene, camera: CameraPath, learner: &Learner, pixels: std::ops::Range<u64>) -> Chunk {
        let mut chunk = Chunk { pixels: Vec::new(), lessons: Vec::new() };
        let mut record = PathRecord::default();
        let seed = self.seed ^ TRAINING_SEED;
        for pixel in pixels {
            let at = self.place(pixel);
            let mut seen = Pixel { block: self.block(at), values: [0.0; 4], segments: [0; 4] };
            let mut whole = true;
            for k in 0..PATHS_OF_PIXEL {
                // Independent of one another and of the exposure, whose samplers have the numbers of pixels.
                let number = (pixel as u32, (pixel >> 32) as u32 | 1 << 31);
                let sampler = Sampler::new(SamplerKind::Independent, seed, number, k, PATHS_OF_PIXEL);
                let Some((ray, wavelengths)) = camera(at, &sampler) else {
                    whole = false;
                    continue;
                };
                let guided = k < PATHS_OF_PIXEL / 2;
                record.clear();
                let guide = guided.then_some(&learner.guide);
                let precomputed = Precomputed { guide, photons: None };
                let radiance = scene.trace(precomputed, ray, &wavelengths, &sampler, &self.path, Some(&mut record));
                let value = 0.25 * radiance.element_sum();
                if !value.is_finite() {
                    whole = false;
                    continue;
                }
                seen.values[k as usize] = value;
                seen.segments[k as usize] = record.segments;
                for (vertex, r) in record.records(radiance).enumerate() {
                    let number = (pixel as u32).wrapping_mul(4).wrapping_add(k).wrapping_mul(64).wrapping_add(vertex as u32);
                    chunk.lessons.push(learner.lesson(r, number));
                }
            }
            if whole {
                chunk.pixels.push(seen);
            }
        }
        chunk
    }

    /// The pixel of the film that is the n-th of the training: the R₂ sequence, which spreads any number of points evenly (M. Roberts 2018, "The
    /// Unreasonable Effectiveness of Quasirandom Sequences"), shifted by the seed.
    fn place(&self, n: u64) -> [u32; 2] {
        // Reciprocals of the plastic number and of its square.
        const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3];
        std::array::from_fn(|k| {
            let shift = f64::from(to_unit(mix(self.seed as u32 ^ mix((self.seed >> 32) as u32 ^ k as u32))));
            let x = (shift + n as f64 * STEPS[k]).fract();
            ((x * f64::from(self.film[k])) as u32).min(self.film[k].saturating_sub(1))
        })
    }

    fn block(&self, at: [u32; 2]) -> usize {
        let [x, y] = [0, 1].map(|k| at[k] as usize * BLOCKS / (self.film[k] as usize).max(1));
        y * BLOCKS + x
    }
}

/// Tells the training's random numbers from those of the exposure.
const TRAINING_SEED: u64 = 0x6775_6964_6520_7472;

/// What the paths of a pixel brought: guided, guided, unguided, unguided.
struct Pixel {
    block: usize,
    values: [f32; 4],
    segments: [u32; 4],
}

struct Chunk {
    pixels: Vec<Pixel>,
    lessons: Vec<Lesson>,
}

/// A record and the region that learns from it.
struct Lesson {
    region: u32,
    /// Density of the region's guide for the direction, 1/sr.
    guide_pdf: f32,
    /// Numbers for the filter of directions.
    jitter: [f32; 2],
    record: Record,
}

/// What a region remembers while it learns.
#[derive(Clone)]
struct Learning {
    moments: Moments,
    /// Records since the density was built.
    fresh: f32,
    /// Whether there is a density yet.
    ready: bool,
    spread: Spread,
    /// Deviation of the positions of records, m.
    deviation: glam::Vec3,
    /// Second moments of what is reflected that each of [`BSDF_FRACTIONS`] would have had, and the records that they stand for.
    costs: [f64; BSDF_FRACTIONS.len()],
    cost_records: f64,
}

struct Learner {
    guide: Guide,
    learning: Vec<Learning>,
    /// Width of the scene as paths see it, m; 0 until the first records.
    width_m: f64,
    records: f64,
}

impl Learner {
    fn new() -> Self {
        let guide = Guide::new();
        let learning = Learning {
            moments: Moments::none(&guide.regions[0].directions),
            fresh: 0.0,
            ready: false,
            spread: Spread::new(),
            deviation: glam::Vec3::ZERO,
            costs: [0.0; BSDF_FRACTIONS.len()],
            cost_records: 0.0,
        };
        Learner { guide, learning: vec![learning], width_m: 0.0, records: 0.0 }
    }

    /// Chooses who learns from a record: the region of its place, moved at random within the reach of the filter.
    fn lesson(&self, record: Record, number: u32) -> Lesson {
        let uniform = |k: u32| to_unit(mix(number.wrapping_mul(0x9e37_79b9).wrapping_add(mix(k ^ 0x1f83_d9ab))));
        let home = self.guide.tree.find(&record.place);
        let deviation = self.learning[home].deviation;
        let mut moved = record.place;
        for k in 0..3 {
            moved[k] += deviation[k] * (FILTER * (2.0 * uniform(k as u32) - 1.0));
        }
        let region = self.guide.tree.find(&moved);
        let guide_pdf = self.guide.regions[region].directions.pdf_at(record.direction);
        Lesson { region: region as u32, guide_pdf, jitter: [uniform(3), uniform(4)], record }
    }

    /// Learns from the records of a batch, in the order of their paths.
    fn learn(&mut self, lessons: Vec<Vec<Lesson>>) {
        let lessons: Vec<Lesson> = lessons.into_iter().flatten().collect();
        if lessons.is_empty() {
            return;
        }
        if self.width_m == 0.0 {
            self.width_m = width_of(lessons.iter().map(|l| &l.record.place));
        }
        self.records += lessons.len() as f64;

        // Sort by region, keeping the order (counting sort).
        let mut ends = vec![0usize; self.guide.regions.len()];
        lessons.iter().for_each(|l| ends[l.region as usize] += 1);
        let mut sum = 0;
        let starts: Vec<usize> = ends
            .iter_mut()
            .map(|count| {
                let start = sum;
                sum += *count;
                *count = start;
                start
            })
            .collect();
        let mut order = vec![0u32; lessons.len()];
        for (i, l) in lessons.iter().enumerate() {
            let end = &mut ends[l.region as usize];
            order[*end] = i as u32;
            *end += 1;
        }
        let regions = self.guide.regions.par_iter_mut().zip(&mut self.learning).zip(starts.into_par_iter().zip(ends));
        regions.for_each(|((region, learning), (start, end))| {
            order[start..end].iter().for_each(|i| learning.add(region, &lessons[*i as usize]));
            if learning.fresh >= RECORDS_TO_REBUILD && 2.0 * learning.fresh >= learning.moments.records {
                learning.rebuild(region);
            }
        });
        self.divide();
    }

    /// Divides regions that have learnt from many records.
    fn divide(&mut self) {
        let most = RECORDS_OF_REGION.max(RECORDS_BY_ROOT * self.records.sqrt());
        for i in 0..self.learning.len() {
            if self.guide.regions.len() >= MOST_REGIONS {
                return;
            }
            if self.learning[i].spread.count < most {
                continue;
            }
            let split = self.learning[i].spread.split(self.width_m);
            let learning = &mut self.learning[i];
            learning.deviation = learning.spread.deviation();
            learning.spread = Spread::new();
            let Some((dimension, at)) = split else { continue };
            self.guide.tree.split(i, dimension, at);
            if dimension < 3 {
                learning.deviation[dimension] *= 0.5;
            }
            if learning.moments.records > INHERITED {
                learning.moments.scale(INHERITED / learning.moments.records);
            }
            learning.fresh = 0.0;
            let (learning, region) = (learning.clone(), self.guide.regions[i].clone());
            self.learning.push(learning);
            self.guide.regions.push(region);
        }
    }

    /// The guide, with everything that was learnt.
    fn finish(mut self) -> Guide {
        let regions = self.guide.regions.par_iter_mut().zip(&mut self.learning);
        regions.filter(|(_, learning)| learning.fresh > 0.0).for_each(|(region, learning)| learning.rebuild(region));
        self.guide
    }
}

impl Learning {
    fn add(&mut self, region: &Region, lesson: &Lesson) {
        let r = &lesson.record;
        let value = r.light * r.light / r.pdf.max(LEAST_PDF);
        if !value.is_finite() {
            return;
        }
        self.moments.add(&region.directions, r.direction, value, lesson.jitter);
        self.fresh += 1.0;
        self.spread.add(&r.place);
        if self.ready {
            // What drawing this direction by each mixture would have cost, by this one draw.
            let (bsdf, guide) = (f64::from(r.bsdf_pdf), f64::from(lesson.guide_pdf));
            let square = f64::from(r.reflected).powi(2) / f64::from(r.pdf);
            for (cost, fraction) in self.costs.iter_mut().zip(BSDF_FRACTIONS.map(f64::from)) {
                let pdf = fraction * bsdf + (1.0 - fraction) * guide;
                if square > 0.0 {
                    // A direction that it never draws counts as drawn hardly ever.
                    *cost += square / pdf.max(1e-6 * f64::from(r.pdf));
                }
            }
            self.cost_records += 1.0;
        }
    }

    /// Builds the density anew from what was learnt, and chooses the fraction.
    fn rebuild(&mut self, region: &mut Region) {
        self.fresh = 0.0;
        if self.spread.count >= f64::from(RECORDS_TO_REBUILD) {
            self.deviation = self.spread.deviation();
        }
        let Some((directions, mut moments)) = region.directions.refined(&self.moments) else { return };
        moments.scale(REMEMBERED);
        (region.directions, self.moments) = (directions, moments);
        if !self.ready {
            (self.ready, region.bsdf_fraction) = (true, FIRST_BSDF_FRACTION);
            return;
        }
        if self.cost_records >= RECORDS_TO_CHOOSE {
            let best = self.costs.iter().zip(BSDF_FRACTIONS).min_by(|a, b| a.0.total_cmp(b.0));
            region.bsdf_fraction = best.map_or(FIRST_BSDF_FRACTION, |b| b.1);
        }
        let remembered = f64::from(REMEMBERED);
        self.costs.iter_mut().for_each(|c| *c *= remembered);
        self.cost_records *= remembered;
    }
}

/// What guiding gains, by paths of the same pixels with and without it.
struct Trial {
    /// Of each block: pixels, sum of the values, variances guided and unguided.
    blocks: Vec<[f64; 4]>,
    segments: [f64; 2],
}

impl Trial {
    fn new() -> Self {
        Trial { blocks: vec![[0.0; 4]; BLOCKS * BLOCKS], segments: [0.0; 2] }
    }

    fn add(&mut self, pixel: &Pixel) {
        let v = pixel.values.map(f64::from);
        let block = &mut self.blocks[pixel.block];
        block[0] += 1.0;
        block[1] += v.iter().sum::<f64>();
        // Half the square of a difference is an unbiased variance.
        block[2] += 0.5 * (v[0] - v[1]).powi(2);
        block[3] += 0.5 * (v[2] - v[3]).powi(2);
        let s = pixel.segments.map(f64::from);
        self.segments[0] += s[0] + s[1];
        self.segments[1] += s[2] + s[3];
    }

    fn gain(&self) -> Option<f64> {
        let seen: Vec<&[f64; 4]> = self.blocks.iter().filter(|b| b[0] > 0.0).collect();
        let paths = f64::from(PATHS_OF_PIXEL);
        let mean = seen.iter().map(|b| b[1]).sum::<f64>() / (paths * seen.iter().map(|b| b[0]).sum::<f64>());
        if !(mean > 0.0) {
            return None;
        }
        let mut relative: Vec<[f64; 2]> = seen
            .iter()
            .map(|b| {
                let square = (b[1] / (paths * b[0])).powi(2) + EPSILON * mean * mean;
                [b[2] / square, b[3] / square]
            })
            .collect();
        relative.sort_by(|a, b| (a[0] + a[1]).total_cmp(&(b[0] + b[1])));
        relative.truncate(relative.len() - relative.len() / LEFT_OUT);
        let sum = |k: usize| relative.iter().map(|r| r[k]).sum::<f64>();
        let [guided, unguided] = [sum(0) * GUIDED_COST * self.segments[0], sum(1) * self.segments[1]];
        // Without any noise there is nothing to gain.
        if guided > 0.0 { Some((unguided / guided).min(MOST_GAIN)) } else { (unguided > 0.0).then_some(MOST_GAIN) }
    }
}

/// A gain larger than this is not told from it.
const MOST_GAIN: f64 = 1e6;
