//! The trials of `auto`: some thousand paths before the exposure say whether photons and connections pay in this picture; and the camera rays from which both
//! `auto` and `bidirectional` learn where the sun matters. They depend on seed, scene, camera
//! and film alone, not on which samples are asked for, so that parts of an exposure decide alike.

use super::TILE;
use super::camera_rays::CameraRay;
use super::pixel_groups::{PAIR, PAIRS};
use super::unit::Unit;
use super::{Exposure, Integrator};
use diopter_light::random::{Sampler, SamplerKind};
use diopter_light::{Ray, SampledWavelengths};
use diopter_scene::light_paths::{Caustics, Connections, LightPaths};
use diopter_scene::radiance::CameraPath;
use diopter_scene::radiance::record::{RadianceAndCaustics, RadianceAndWork};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Blocks of the film a side.
pub(super) const BLOCKS: usize = 8;
/// Their numbers are not those of the samples.
const SEED: u64 = 0xbb67_ae85_84ca_a73b;

/// Photons, and pixels of a block a side, of the trial of caustics: some tens of milliseconds.
const PHOTONS: u32 = 1 << 14;
const PHOTON_SIDE: usize = 12;
/// Caustics show where they are so much of all light, or of the light of some block that is not darker than a tenth of the mean.
const MIN_FRACTION: f64 = 0.05;
const MIN_FRACTION_OF_BLOCK: f64 = 0.3;

/// Light paths of each of the two pools of the trial of connections.
const LIGHT_PATHS: u32 = 1 << 12;
/// Fewest and most pixels of a block a side, and pixels of the film for each of them.
const PAIR_SIDE: (usize, usize) = (4, 12);
const FILM_A_PAIR: usize = 4;
/// The worst pairs of either integrator are left out: with them a single one decides.
const WORST: f64 = 0.0005;
/// Light of a block below so much of the mean of all is not asked for its relative noise.
const DARK: f64 = 0.1;
/// A sample with connections takes 2 to 2.5 times the time of one without: they pay where they leave clearly less than half of the squared error. In Cornell boxes
/// they leave 0.42 to 0.54.
const ACCEPT_FRACTION: f64 = 0.3;
/// Where a sample without them has so large a relative squared error, rare bright ones make it (a Cornell box: 0.6; rooms lit by a patch of sun: 2 to 27), and a
/// trial sees few of those: more pairs are taken, and if this is not reached, there are none. Connections leave less than what it finds then (a classroom: 0.26 to
/// 0.7 in trials, 0.2 in the exposure).
const NOISY: f64 = 1.5;
const ACCEPT_LAST: f64 = 0.5;
const REJECT_FRACTION: f64 = 0.8;
/// Processor time of what reuse does for each segment of a path, and of a shadow ray between paths, over that of a segment of a path alone. Measured by both, seconds over those of samples alone, foretold / seen:
/// small meshes in the open 2.6 / 2.5, Cornell box 1.7 / 1.7, classroom 1.6 / 1.7, dining room 1.4 / 1.1, living room 2 1.8 / 2.1, bathroom 1.7 / 1.7, staircase 1.7 / 2.0, coffee maker 1.4 / 1.7, still life 1.8 / 1.9, fog 1.6 / 1.4.
const COST_OF_REUSE: f64 = 0.25;
const COST_OF_RAY: f64 = 0.13;
/// Most that error times time may be, over that of paths alone: the numbers of a trial are independent, those of a picture are nets, from which paths alone gain more (glossy balls in the open: 0.31 of the squared error by the trial,
/// 0.49 in the picture).
const REUSE_PAYS: f64 = 0.75;
/// Processor time of a path whose light is lent, over that of one alone, by which what connections must leave was found (in rooms and Cornell boxes).
const COST_BESIDE_CONNECTIONS: f64 = 1.7;
/// Where a sample of paths alone has so large a relative squared error, and connections leave so little of it, they are taken whatever reuse leaves by the trial: a lamp that shines on a spot of the ceiling. Groups see rare bright
/// paths too seldom for a trial to know. Error by time is the same there (veach-bidir 1.13 and a room under an uplight 1.02 of that of reuse, six seeds), but errors of groups are alike, and denoisers leave them: denoised
/// at 16 samples relMSE is 0.44 and 0.32 of that of reuse. Alone, connected over alone by three trials: these 10 to 24, 0.10 to 0.14; classroom 5 to 7, 0.30 to 0.38; staircase, living room 2, Cornell box 2 to 4, 0.26 to 0.6.
const HARD: f64 = 5.0;
const EASED_FRACTION: f64 = 0.15;
/// Where a fourth of the blocks says by so much that something pays, or does not, the others are not asked: they say the same, and asking them took 2 to 5 % of 64 samples of a room.
const CLEARLY: f64 = 2.0;
/// Most rounds of pairs, and samples of a pixel for each of them.
const ROUNDS: usize = 4;
const SAMPLES_A_ROUND: usize = 16;

/// Column and row of a pixel of a block, of a grid of `side` × `side` over it.
pub(super) fn pixel_of_block([columns, rows]: [usize; 2], block: usize, k: usize, side: usize) -> [usize; 2] {
    let within = |cell: usize, step: usize, pixels: usize| ((cell * side + step) * pixels / (BLOCKS * side)).min(pixels - 1);
    [within(block % BLOCKS, k % side, columns), within(block / BLOCKS, k / side, rows)]
}

/// A camera ray of a sequence that is spread over the film (R2: Roberts 2018, "The Unreasonable Effectiveness of Quasirandom Sequences").
pub(super) fn spread_ray(exposure: &Exposure, unit: &Unit, number: u32) -> Option<(Ray, SampledWavelengths)> {
    let film = &exposure.camera.film;
    let along = |step: f64, pixels: usize| (((0.5 + step * f64::from(number)).fract() * pixels as f64) as usize).min(pixels - 1);
    let (column, row) = (along(0.754_877_666_246_693, film.columns), along(0.569_840_290_998_053, film.rows));
    let sampler = Sampler::new(SamplerKind::Independent, exposure.settings.seed ^ SEED.rotate_left(32), (number, 0), 0, 1);
    unit.camera_ray(column, row, &sampler, &sampler).map(|camera| (camera.ray, camera.wavelengths))
}

/// Whether caustics matter by all light and that of the photons, for each block.
fn shows(blocks: &[[f64; 2]]) -> bool {
    let [all, photons] = [0, 1].map(|k| blocks.iter().map(|b| b[k]).sum::<f64>());
    let dark = 0.1 * all / blocks.len() as f64;
    photons > MIN_FRACTION * all || blocks.iter().any(|b| b[0] > dark && b[1] > MIN_FRACTION_OF_BLOCK * b[0])
}

/// Two samples of a pixel of the trial, by each of [`Candidate`].
type Pair = [[f64; 2]; 3];

/// What is tried.
#[derive(Clone, Copy)]
enum Candidate {
    Alone,
    Reuse,
    Connected,
}

/// What the paths of an exposure are helped by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Help {
    /// Nothing.
    Alone,
    /// The light that other pixels' paths found.
    Reuse,
    /// Connections with light paths.
    Connections,
}

/// Relative squared error of a sample, of all pairs of all blocks but the worst, by each of the candidates that were `tried`; 0 of others.
fn relative_noise(blocks: &[Vec<Pair>], tried: &[Candidate]) -> [f64; 3] {
    let mean = |pairs: &Vec<Pair>| {
        let sum: f64 = tried.iter().flat_map(|c| pairs.iter().flat_map(|pair| pair[*c as usize])).sum();
        0.5 * sum / (tried.len() * pairs.len()).max(1) as f64
    };
    let means: Vec<f64> = blocks.iter().map(mean).collect();
    [0, 1, 2].map(|k| relative_mean(blocks, &means, |pair| 0.5 * (pair[k][0] - pair[k][1]).powi(2), WORST))
}

/// Mean of squares of light over the square of the mean light of their block, without a fraction of the largest.
pub(super) fn relative_mean<T>(blocks: &[Vec<T>], means: &[f64], square: impl Fn(&T) -> f64, worst: f64) -> f64 {
    let dark = DARK * means.iter().sum::<f64>() / means.len().max(1) as f64;
    let of_block = |(all, mean): (&Vec<T>, &f64)| {
        let scale = 1.0 / (mean * mean + dark * dark).max(f64::MIN_POSITIVE);
        all.iter().map(|one| scale * square(one)).collect::<Vec<_>>()
    };
    let mut squares: Vec<f64> = blocks.iter().zip(means).flat_map(of_block).collect();
    squares.sort_by(f64::total_cmp);
    let kept = squares.len() - (worst * squares.len() as f64).ceil() as usize;
    squares[..kept].iter().sum::<f64>() / kept.max(1) as f64
}

/// Whether connections pay, by the relative squared error of a sample without and with them, the first times what it costs; `None` where more pairs are to tell, if there are any.
fn pays([without, with]: [f64; 2], is_last: bool) -> Option<bool> {
    if with < ACCEPT_FRACTION * without {
        Some(true)
    } else if without < NOISY || with > REJECT_FRACTION * without {
        Some(false)
    } else {
        is_last.then_some(with < ACCEPT_LAST * without)
    }
}

/// Processor time of paths whose light is reused over that of paths alone, by the segments and the shadow rays between paths of either.
fn cost_of_reuse([alone, _]: [u64; 2], [segments, rays]: [u64; 2]) -> f64 {
    COST_OF_REUSE + (segments as f64 + COST_OF_RAY * rays as f64) / alone.max(1) as f64
}

/// What helps most for what it costs, by the relative squared errors of the candidates that were `tried`, where reuse costs so much; `None` where more pairs are to tell.
fn best(noise: [f64; 3], tried: &[Candidate], cost_of_reuse: f64, is_last: bool) -> Option<Help> {
    let [alone, reuse, connected] = noise;
    let reuses = tried.iter().any(|c| matches!(c, Candidate::Reuse)) && reuse * cost_of_reuse < REUSE_PAYS * alone;
    let (help, without) = if reuses { (Help::Reuse, reuse * COST_BESIDE_CONNECTIONS) } else { (Help::Alone, alone) };
    match tried.iter().any(|c| matches!(c, Candidate::Connected)) {
        false => Some(help),
        true if alone > HARD && connected < EASED_FRACTION * alone => Some(Help::Connections),
        true => pays([without, connected], is_last).map(|pays| if pays { Help::Connections } else { help }),
    }
}

/// The same where it is far from being otherwise; `None` where the others are to tell, and where nothing was seen.
fn clearly_best([alone, reuse, connected]: [f64; 3], tried: &[Candidate], cost_of_reuse: f64) -> Option<Help> {
    let tries_reuse = tried.iter().any(|c| matches!(c, Candidate::Reuse));
    let (gained, asked) = (reuse * cost_of_reuse, REUSE_PAYS * alone);
    let (help, without) = match tries_reuse {
        true if gained * CLEARLY < asked => (Help::Reuse, reuse * COST_BESIDE_CONNECTIONS),
        true if gained < asked * CLEARLY => return None,
        _ if alone <= 0.0 => return None,
        _ => (Help::Alone, alone),
    };
    let tries_connections = tried.iter().any(|c| matches!(c, Candidate::Connected));
    let may_ease = alone * CLEARLY > HARD && connected < CLEARLY * EASED_FRACTION * alone;
    let may_connect = tries_connections && (may_ease || connected < CLEARLY * REJECT_FRACTION * without);
    (!may_connect).then_some(help)
}

/// Blocks that are asked first: a fourth, in each row and column of them two.
fn is_first(block: usize) -> bool {
    let (column, row) = (block % BLOCKS, block / BLOCKS);
    (column + [0, 2, 1, 3][row % 4]).is_multiple_of(4)
}

impl Exposure<'_> {
    /// Whether caustics show in the picture, by some paths of few photons: where they do not, photons cost and bring nothing.
    pub(super) fn shows_caustics(&self, unit: &Unit, caustics: &Caustics) -> bool {
        if self.settings.integrator == Integrator::Caustics {
            return true;
        }
        let map = caustics.trial_map(PHOTONS);
        let film = [self.camera.film.columns, self.camera.film.rows];
        let block = |number: usize| {
            let begin = |k: usize| {
                let [column, row] = pixel_of_block(film, number, k, PHOTON_SIDE);
                let (seed, pixel) = (self.settings.seed ^ SEED, (number as u32, k as u32));
                let sampler = Sampler::new(SamplerKind::Independent, seed, pixel, 0, 1);
                let camera = unit.camera_ray(column, row, &sampler, &sampler)?;
                let light_paths = LightPaths::of_photons(Some(&map));
                let path = CameraPath::new(camera.ray, camera.wavelengths, sampler);
                Some(CameraPath { light_paths, immersion: unit.immersion, ..path })
            };
            let paths: Vec<CameraPath> = (0..PHOTON_SIDE * PHOTON_SIDE).filter_map(begin).collect();
            let seen = self.scene.trace(&paths, RadianceAndCaustics, &self.settings.path);
            let mut sums = [0.0f64; 2];
            for (path, both) in paths.iter().zip(seen) {
                for (sum, light) in sums.iter_mut().zip(both) {
                    let light = f64::from((light * path.wavelengths.weight).element_sum());
                    *sum += if light.is_finite() { light } else { 0.0 };
                }
            }
            sums
        };
        let blocks: Vec<[f64; 2]> = (0..BLOCKS * BLOCKS).into_par_iter().map(block).collect();
        // Without photons the light of lamps without extent would be missing, not noisy.
        let gathered = blocks.iter().any(|b| b[1] > 0.0);
        gathered && (caustics.has_delta_lamps() || shows(&blocks))
    }

    /// What takes away more noise than it costs, by pairs of samples at some pixels without any help and with each. Pixels may lend one another light where the
    /// unit has groups of them.
    pub(super) fn help(&self, unit: &Unit, connections: Option<&Connections>, caustics: Option<&Caustics>) -> Help {
        let may_reuse = unit.groups.is_some();
        match (self.settings.integrator, connections) {
            (Integrator::Bidirectional, Some(_)) => return Help::Connections,
            (Integrator::PathReuse, _) if may_reuse => return Help::Reuse,
            (Integrator::Auto, None) if !may_reuse => return Help::Alone,
            (Integrator::Auto, None) if !self.has_paths_for_trial() => return Help::Reuse,
            (Integrator::Auto, _) => {}
            _ => return Help::Alone,
        }
        let map = caustics.map(|caustics| caustics.trial_map(PHOTONS));
        let pools = connections.map(|connections| [0, 1].map(|replicate| connections.trial_pool(LIGHT_PATHS, replicate)));
        let mut tried = vec![Candidate::Alone];
        tried.extend(may_reuse.then_some(Candidate::Reuse));
        tried.extend(pools.is_some().then_some(Candidate::Connected));
        let film = [self.camera.film.columns, self.camera.film.rows];
        let pairs = film[0] * film[1] / (FILM_A_PAIR * BLOCKS * BLOCKS);
        let side = pairs.isqrt().clamp(PAIR_SIDE.0, PAIR_SIDE.1);
        // As many pixels, in pairs of groups.
        let side = if may_reuse { (side * side / PAIR).isqrt().max(1) } else { side };
        // Segments and shadow rays between paths of each candidate; sums of whole numbers: the same in any order.
        let work: [[AtomicU64; 2]; 3] = Default::default();
        let group = |block: usize, k: usize| -> Vec<Pair> {
            let pixel = pixel_of_block(film, block, k % (side * side), side);
            let pixels = match unit.groups {
                None => vec![pixel],
                Some(groups) => {
                    let tile = pixel.map(|at| at / TILE * TILE);
                    let of_pair = (0..PAIR).map(|number| groups.pixel_of_pair(tile, k % PAIRS, number));
                    of_pair.filter(|[x, y]| *x < film[0] && *y < film[1]).collect()
                }
            };
            let samplers_of = |number: usize| {
                let (seed, pixel) = (self.settings.seed ^ !SEED, (block as u32, (k * PAIR + number) as u32));
                [0, 1].map(|replicate| Sampler::new(SamplerKind::Independent, seed, pixel, replicate, 2))
            };
            let len_of_first =
                |pixels: &[[usize; 2]]| unit.groups.map_or(0, |groups| groups.len_of_first(pixels.iter().copied()));
            let second = len_of_first(&pixels);
            let of_groups = [0, second].map(|first| samplers_of(first)[0]);
            // One camera ray: what film, lens and wavelengths add to the noise is the same with and without help.
            let begin = |(number, [column, row]): (usize, &[usize; 2])| {
                let samplers = samplers_of(number);
                Some((unit.camera_ray(*column, *row, &samplers[0], &of_groups[usize::from(number >= second)])?, samplers))
            };
            let rays: Vec<_> = pixels.iter().enumerate().filter_map(begin).collect();
            let of_first = len_of_first(&rays.iter().map(|(camera, _)| camera.pixel).collect::<Vec<_>>());
            let mut pairs = vec![Pair::default(); rays.len()];
            for replicate in [0, 1] {
                for candidate in &tried {
                    let vertices = match candidate {
                        Candidate::Connected => pools.as_ref().map(|pools| &pools[replicate]),
                        _ => None,
                    };
                    let light_paths = LightPaths { photons: map.as_ref(), vertices };
                    let roulette = unit.roulette.as_ref().filter(|_| matches!(candidate, Candidate::Alone));
                    let path = |(camera, samplers): &(CameraRay, [Sampler; 2])| CameraPath {
                        light_paths,
                        roulette,
                        immersion: unit.immersion,
                        ..CameraPath::new(camera.ray, camera.wavelengths, samplers[replicate])
                    };
                    let paths: Vec<CameraPath> = rays.iter().map(path).collect();
                    let (scene, settings) = (self.scene, &self.settings.path);
                    let found = match candidate {
                        Candidate::Reuse => scene.trace_groups(paths.split_at(of_first).into(), RadianceAndWork, settings),
                        Candidate::Alone | Candidate::Connected => scene.trace(&paths, RadianceAndWork, settings),
                    };
                    let [segments, rays] = &work[*candidate as usize];
                    segments.fetch_add(found.iter().map(|(_, work)| u64::from(work.segments)).sum(), Ordering::Relaxed);
                    rays.fetch_add(found.iter().map(|(_, work)| u64::from(work.reuse_rays)).sum(), Ordering::Relaxed);
                    for ((pair, (light, _)), path) in pairs.iter_mut().zip(found).zip(&paths) {
                        let light = f64::from((light * path.wavelengths.weight).element_sum());
                        pair[*candidate as usize][replicate] = if light.is_finite() { light } else { 0.0 };
                    }
                }
            }
            pairs
        };
        let mut blocks: Vec<Vec<Pair>> = vec![Vec::new(); BLOCKS * BLOCKS];
        let rounds = (self.settings.spp as usize / SAMPLES_A_ROUND).clamp(1, ROUNDS);
        let cost = || {
            let [alone, reuse, _] = work.each_ref().map(|counts| counts.each_ref().map(|count| count.load(Ordering::Relaxed)));
            cost_of_reuse(alone, reuse)
        };
        for round in 0..rounds {
            let numbers = round * side * side..(round + 1) * side * side;
            let ask = |(block, pairs): (usize, &mut Vec<Pair>)| pairs.extend(numbers.clone().flat_map(|k| group(block, k)));
            if round == 0 {
                blocks.par_iter_mut().enumerate().filter(|(block, _)| is_first(*block)).for_each(ask);
                let asked: Vec<Vec<Pair>> = blocks.iter().filter(|pairs| !pairs.is_empty()).cloned().collect();
                if let Some(help) = clearly_best(relative_noise(&asked, &tried), &tried, cost()) {
                    return help;
                }
            }
            blocks.par_iter_mut().enumerate().filter(|(block, _)| round > 0 || !is_first(*block)).for_each(ask);
            if let Some(help) = best(relative_noise(&blocks, &tried), &tried, cost(), round + 1 == rounds) {
                return help;
            }
        }
        Help::Alone
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn caustics_show_by_their_share_of_all_light_or_of_a_bright_block() {
        let mut blocks = [[1.0, 0.0]; 64];
        assert!(!shows(&blocks));
        blocks[3][1] = 0.29;
        assert!(!shows(&blocks));
        blocks[3][1] = 0.31;
        assert!(shows(&blocks));
        // A block in the dark does not count, an even veil does.
        blocks[3] = [0.05, 0.05];
        assert!(!shows(&blocks));
        assert!(shows(&[[1.0, 0.051]; 64]) && !shows(&[[0.0; 2]; 64]));
    }

    #[test]
    fn noise_is_relative_to_the_light_of_a_block_and_without_the_worst_pairs() {
        // Means 1 and 100, of relative differences 0.2 without and 0.1 with connections.
        let pair = |mean: f64| [[0.9 * mean, 1.1 * mean], [0.0; 2], [0.95 * mean, 1.05 * mean]];
        let tried = [Candidate::Alone, Candidate::Connected];
        let mut blocks = vec![vec![pair(1.0); 500], vec![pair(100.0); 500]];
        let [without, _, with] = relative_noise(&blocks, &tried);
        // The dim block is a fiftieth of the mean of both: 1 / (1 + 5.05²) of its own noise counts.
        let counts = 0.5 * (1.0 / (1.0 + 5.05f64.powi(2)) + 1.0 / (1.0 + 0.0505f64.powi(2)));
        assert!((without - 0.02 * counts).abs() < 1e-4 && (with - 0.005 * counts).abs() < 3e-5, "{without} {with}");
        // One sample that met the lamp by chance does not decide.
        blocks[1][7][0] = [20_000.0, 0.0];
        assert!((relative_noise(&blocks, &tried)[0] / without - 1.0).abs() < 0.25);
        assert_eq!(relative_noise(&[vec![Pair::default(); 4]], &tried), [0.0; 3]);
    }

    #[test]
    fn reuse_is_taken_where_it_leaves_clearly_less_than_it_costs() {
        // Glossy balls in the open, a classroom: segments alone and with reuse, shadow rays of 10 000 paths; error with reuse.
        let tried = [Candidate::Alone, Candidate::Reuse];
        for (alone, reuse, error, cost, expected) in
            [(23_300, [23_300, 224_000], 0.31, 2.5, Help::Alone), (49_800, [57_300, 88_600], 0.12, 1.63, Help::Reuse)]
        {
            let found = cost_of_reuse([alone, 0], reuse);
            assert!((found - cost).abs() < 0.01, "{found}");
            assert_eq!(best([1.0, error, 0.0], &tried, found, true), Some(expected));
        }
    }

    #[test]
    fn connections_are_taken_where_paths_alone_hardly_find_the_light() {
        // A room under an uplight, a classroom in the sun, a staircase.
        let tried = [Candidate::Alone, Candidate::Reuse, Candidate::Connected];
        for (noise, cost, expected) in [
            ([20.7, 0.73, 2.13], 1.58, Help::Connections),
            ([7.1, 0.75, 2.16], 1.87, Help::Reuse),
            ([2.3, 0.17, 1.2], 1.7, Help::Reuse),
        ] {
            assert_eq!(best(noise, &tried, cost, true), Some(expected), "{noise:?}");
        }
    }

    #[test]
    fn a_fourth_of_the_blocks_decides_what_is_clear() {
        let tried = [Candidate::Alone, Candidate::Reuse, Candidate::Connected];
        for (noise, expected) in [
            // A bathroom, a staircase, balls in the open: far from where it would be otherwise.
            ([0.42, 0.068, 0.45], Some(Help::Reuse)),
            ([2.0, 0.17, 1.0], Some(Help::Reuse)),
            ([0.42, 1.0, 0.9], Some(Help::Alone)),
            // Reuse may or may not pay, connections may, a lamp that shines on the ceiling, nothing to see.
            ([1.0, 0.3, 9.0], None),
            ([1.0, 0.1, 0.25], None),
            ([20.7, 0.73, 4.0], None),
            ([0.0; 3], None),
        ] {
            assert_eq!(clearly_best(noise, &tried, 1.7), expected, "{noise:?}");
            if let Some(expected) = expected {
                assert_eq!(best(noise, &tried, 1.7, true), Some(expected), "{noise:?}");
            }
        }
        let first: Vec<usize> = (0..BLOCKS * BLOCKS).filter(|block| is_first(*block)).collect();
        for line in 0..BLOCKS {
            assert_eq!(
                [first.iter().filter(|b| *b % BLOCKS == line).count(), first.iter().filter(|b| *b / BLOCKS == line).count()],
                [2; 2]
            );
        }
    }

    #[test]
    fn connections_pay_where_they_leave_little_noise_or_less_than_half_of_much() {
        let (yes, no) = ([Some(true); 2], [Some(false); 2]);
        let cases = [
            ([0.6, 0.17], yes),
            ([0.6, 0.27], no),
            ([5.0, 1.4], yes),
            ([5.0, 2.4], [None, Some(true)]),
            ([5.0, 3.9], [None, Some(false)]),
            ([5.0, 4.1], no),
            ([0.0, 0.0], no),
        ];
        for (noise, expected) in cases {
            assert_eq!([false, true].map(|is_last| pays(noise, is_last)), expected, "{noise:?}");
        }
    }

    #[test]
    fn pixels_of_blocks_cover_the_film() {
        assert_eq!(pixel_of_block([80, 40], 0, 0, 4), [0, 0]);
        assert_eq!(pixel_of_block([80, 40], 63, 15, 4), [77, 38]);
        assert_eq!(pixel_of_block([1, 3], 63, 15, 4), [0, 2]);
    }
}
