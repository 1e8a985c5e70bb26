//! Flights and transmittance through media that differ from place to place.
//!
//! *Flights* by delta tracking (E. Woodcock et al. 1965): collisions are drawn by the majorant of each cell, and are real with the probability of
//! the extinction there over the majorant. One wavelength, drawn with a probability as its fraction of the throughput, decides; the densities of all
//! four are carried along, and the result is weighted by their mean (null-scattering path integral and its spectral balance heuristic: B. Miller,
//! I. Georgiev, W. Jarosz 2019; PBR 4ed §14.2.2). In a medium that is the same everywhere this is [`Sigma::sample_distance`].
//!
//! *Transmittance* by residual ratio tracking (J. Novák, A. Selle, W. Jarosz 2014, "Residual Ratio Tracking for Estimating Attenuation in Participating
//! Media"): what each cell has everywhere is attenuated in closed form, only the rest by collisions, for all wavelengths by the same.
//!
//! *Emission* is collected by the track-length estimator (J. Spanier 1966): each stretch between two collisions adds its length times the emission
//! at a random place of it, so that thin flames, which few collisions meet, are seen by all rays.

use super::volume::{Limits, Volume};
use super::{DistanceSample, Medium, Sigma};
use crate::russian_roulette::survives;
use diopter_light::random::Stream;
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths};
use glam::Vec3;

/// Collisions after which a ray is let through what is left: far more than a body that can be rendered has.
const MOST_COLLISIONS: u32 = 1 << 20;

/// Transmittance below which Russian roulette decides whether it is estimated further.
const ROULETTE_TRANSMITTANCE: f32 = 0.1;

/// A part of a ray in a volume.
pub(crate) struct Track<'a> {
    medium: &'a Medium,
    volume: &'a Volume,
    wavelengths: &'a SampledWavelengths,
    /// Coefficients where the factors are 1.
    sigma: Sigma,
    /// The ray in the volume's space; distances stay those of the world.
    origin: Vec3,
    direction: Vec3,
    span: [f32; 2],
}

/// A stretch of a ray in one cell: where it begins and ends, and what is in the cell.
struct MajorantSegment<'a> {
    from: f32,
    to: f32,
    limits: &'a Limits,
}

/// Walks through the cells that a ray meets, one after the other. Source: J. Amanatides, A. Woo 1987, "A Fast Voxel Traversal Algorithm for Ray
/// Tracing".
struct MajorantIterator {
    size: [usize; 3],
    cell: [usize; 3],
    /// Whether the ray goes towards lower cells.
    backward: [bool; 3],
    /// Distance of the next boundary along each axis, and between two.
    next: [f32; 3],
    step: [f32; 3],
    at: f32,
    end: f32,
    is_over: bool,
}

impl MajorantIterator {
    fn new(track: &Track) -> Option<Self> {
        let (bounds, size) = (track.volume.bounds(), track.volume.cells());
        let count = Vec3::new(size[0] as f32, size[1] as f32, size[2] as f32);
        let scale = count / bounds.size();
        let (o, d) = ((track.origin - bounds.min) * scale, track.direction * scale);
        // Where the ray is within the box.
        let [mut at, mut end] = track.span;
        for k in 0..3 {
            if d[k] == 0.0 {
                if !(0.0..=count[k]).contains(&o[k]) {
                    return None;
                }
                continue;
            }
            let (a, b) = (-o[k] / d[k], (count[k] - o[k]) / d[k]);
            (at, end) = (at.max(a.min(b)), end.min(a.max(b)));
        }
        if !(at < end) {
            return None;
        }
        let start = o + d * at;
        let cell = [0, 1, 2].map(|k: usize| (start[k].max(0.0) as usize).min(size[k] - 1));
        let backward = [0, 1, 2].map(|k: usize| d[k] < 0.0);
        let next = [0, 1, 2].map(|k: usize| match d[k] {
            0.0 => f32::INFINITY,
            v => (((cell[k] + usize::from(!backward[k])) as f32 - o[k]) / v).max(at),
        });
        let step = [0, 1, 2].map(|k: usize| if d[k] == 0.0 { f32::INFINITY } else { 1.0 / d[k].abs() });
        Some(MajorantIterator { size, cell, backward, next, step, at, end, is_over: false })
    }

    #[inline]
    fn next<'a>(&mut self, volume: &'a Volume) -> Option<MajorantSegment<'a>> {
        if self.is_over {
            return None;
        }
        let limits = volume.limits(self.cell);
        let from = self.at;
        let k = if self.next[0] <= self.next[1] && self.next[0] <= self.next[2] {
            0
        } else if self.next[1] <= self.next[2] {
            1
        } else {
            2
        };
        let to = self.next[k].min(self.end);
        let edge = if self.backward[k] { 0 } else { self.size[k] - 1 };
        if self.next[k] >= self.end || self.cell[k] == edge {
            self.is_over = true;
        } else {
            self.cell[k] = if self.backward[k] { self.cell[k] - 1 } else { self.cell[k] + 1 };
            self.next[k] += self.step[k];
            self.at = to;
        }
        Some(MajorantSegment { from, to, limits })
    }
}

impl<'a> Track<'a> {
    /// The part of a ray between two distances (m) in a volume of a medium, at a moment of the scene (s).
    pub fn new(
        medium: &'a Medium,
        volume: &'a Volume,
        ray: &Ray,
        span: [f32; 2],
        wavelengths: &'a SampledWavelengths,
        time_s: f64,
    ) -> Self {
        let own_from_world = volume.place.own_from_world(time_s);
        let origin = own_from_world.transform_point3(ray.origin);
        let direction = own_from_world.transform_vector3(ray.direction);
        Track { medium, volume, wavelengths, sigma: medium.at(wavelengths), origin, direction, span }
    }

    fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }

    /// Absorption and scattering at a distance, 1/m.
    #[inline]
    fn coefficients(&self, t: f32) -> [SampledSpectrum; 2] {
        let [absorption, scattering] = self.volume.factors(self.at(t), self.wavelengths);
        [self.sigma.absorption * absorption, self.sigma.scattering * scattering]
    }

    /// Radiance that is emitted a metre at a distance.
    fn emission(&self, t: f32) -> SampledSpectrum {
        let p = self.at(t);
        let [absorption, _] = self.volume.factors(p, self.wavelengths);
        if absorption == SampledSpectrum::ZERO {
            return absorption;
        }
        let radiance = self.volume.radiance(p, self.wavelengths, self.medium.emission.as_ref());
        self.sigma.absorption * absorption * radiance
    }

    /// The least (0) or the greatest (1) extinction in a cell, 1/m.
    #[inline]
    fn extinction(&self, limits: &Limits, which: usize) -> SampledSpectrum {
        self.sigma.absorption * limits.absorption[which] + self.sigma.scattering * limits.scattering[which]
    }

    /// Follows a path of a throughput to its next scattering event or to the end; what is emitted on the way, as the path brings it, is added to
    /// `emitted`.
    pub fn sample_distance(
        &self,
        throughput: SampledSpectrum,
        stream: &mut Stream,
        emitted: &mut SampledSpectrum,
    ) -> DistanceSample {
        let total = throughput.element_sum();
        if !(total > 0.0) {
            return DistanceSample::Through(SampledSpectrum::ONE);
        }
        if self.sigma.scattering == SampledSpectrum::ZERO {
            return DistanceSample::Through(self.transmittance(stream, Some((throughput, emitted))));
        }
        let fraction = throughput / total;
        let lane = lane(fraction, stream.draw());
        let shines = self.volume.shines();
        // Densities of the path so far, as each of the wavelengths would have drawn it, up to a common factor.
        let mut densities = SampledSpectrum::ONE;
        let mut collisions = 0;
        let Some(mut walk) = MajorantIterator::new(self) else { return DistanceSample::Through(SampledSpectrum::ONE) };
        while let Some(stretch) = walk.next(self.volume) {
            let majorant = self.extinction(stretch.limits, 1);
            if majorant == SampledSpectrum::ZERO {
                continue;
            }
            let mut at = stretch.from;
            loop {
                // As ∞ where the wavelength is not attenuated.
                let collision = at - (1.0 - stream.draw()).ln() / majorant[lane];
                let to = if collision < stretch.to { collision } else { stretch.to };
                if shines {
                    let place = at + (to - at) * stream.draw();
                    let there = attenuated(densities, majorant, place - at);
                    *emitted += throughput * weighted(there, fraction.dot(there)) * self.emission(place) * (to - at);
                }
                densities = normalised(attenuated(densities, majorant, to - at));
                if !(collision < stretch.to) {
                    break;
                }
                let [absorption, scattering] = self.coefficients(collision);
                let extinction = absorption + scattering;
                collisions += 1;
                if stream.draw() * majorant[lane] < extinction[lane] {
                    let density = fraction.dot(densities * extinction);
                    return DistanceSample::Scattered(collision, weighted(densities * scattering, density));
                }
                densities = normalised(densities * (majorant - extinction).max(SampledSpectrum::ZERO));
                if collisions > MOST_COLLISIONS {
                    return DistanceSample::Through(weighted(densities, fraction.dot(densities)));
                }
                at = collision;
            }
        }
        DistanceSample::Through(weighted(densities, fraction.dot(densities)))
    }

    /// Fraction of light that is left at the end, an estimate; what is emitted on the way, times a throughput, is added where asked for.
    pub fn transmittance(
        &self,
        stream: &mut Stream,
        mut emitted: Option<(SampledSpectrum, &mut SampledSpectrum)>,
    ) -> SampledSpectrum {
        let mut left = SampledSpectrum::ONE;
        let Some(mut walk) = MajorantIterator::new(self) else { return left };
        let shines = emitted.is_some() && self.volume.shines();
        let mut collisions = 0;
        while let Some(stretch) = walk.next(self.volume) {
            let everywhere = self.extinction(stretch.limits, 0);
            let rest = (self.extinction(stretch.limits, 1) - everywhere).max_element();
            let mut at = stretch.from;
            loop {
                let collision = if rest > 0.0 { at - (1.0 - stream.draw()).ln() / rest } else { f32::INFINITY };
                let to = if collision < stretch.to { collision } else { stretch.to };
                if let Some((throughput, sum)) = emitted.as_mut().filter(|_| shines) {
                    let place = at + (to - at) * stream.draw();
                    **sum += *throughput * attenuated(left, everywhere, place - at) * self.emission(place) * (to - at);
                }
                left = attenuated(left, everywhere, to - at);
                if !(collision < stretch.to) {
                    break;
                }
                let [absorption, scattering] = self.coefficients(collision);
                left *= (SampledSpectrum::ONE - (absorption + scattering - everywhere) / rest)
                    .clamp(SampledSpectrum::ZERO, SampledSpectrum::ONE);
                collisions += 1;
                let most = left.max_element();
                if most < ROULETTE_TRANSMITTANCE && !survives(&mut left, most / ROULETTE_TRANSMITTANCE, stream.draw()) {
                    return SampledSpectrum::ZERO;
                }
                if collisions > MOST_COLLISIONS {
                    return left;
                }
                at = collision;
            }
        }
        left
    }
}

/// What a coefficient (1/m) leaves of a quantity after a distance, m.
#[inline]
fn attenuated(quantity: SampledSpectrum, coefficient: SampledSpectrum, distance: f32) -> SampledSpectrum {
    quantity * (coefficient * -distance).exp()
}

/// The wavelength that a number between 0 and 1 draws by fractions of 1.
fn lane(fraction: SampledSpectrum, mut u: f32) -> usize {
    let fraction = fraction.to_array();
    let mut lane = 0;
    while lane < 3 && u >= fraction[lane] {
        u -= fraction[lane];
        lane += 1;
    }
    lane
}

/// What a path brings over its density; nothing where that is below the smallest number.
#[inline]
fn weighted(brought: SampledSpectrum, density: f32) -> SampledSpectrum {
    if density > 0.0 { brought / density } else { SampledSpectrum::ZERO }
}

/// Divided by the largest: products of many factors stay in range.
#[inline]
fn normalised(densities: SampledSpectrum) -> SampledSpectrum {
    let most = densities.max_element();
    if most > 0.0 { densities / most } else { SampledSpectrum::ONE }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::Bounds;
    use crate::medium::Coefficient;
    use crate::medium::volume::{Field, Glow, Grid, Scalars, Tint, VolumePlace};
    use diopter_light::Spectrum;
    use diopter_light::random::{Dimensions, Sampler, SamplerKind};
    use diopter_light::spectrum::Table;
    use glam::Affine3A;

    const NM: [f32; 4] = [450.0, 520.0, 590.0, 660.0];

    fn colored() -> Coefficient {
        Coefficient::Scaled(1.0, Spectrum::Table(Table::from_points(&[(400.0, 3.0), (700.0, 0.3)])))
    }

    /// 4 × 4 × 4 m about the middle, in `n` values along x.
    fn volume(n: usize, density: impl Fn(f32) -> f32, glow: Option<Glow>) -> Volume {
        let bounds = Bounds { min: Vec3::splat(-2.0), max: Vec3::splat(2.0) };
        let x = |i: usize| -2.0 + 4.0 * (i as f32 + 0.5) / n as f32;
        let values = (0..n * 256).map(|i| density(x(i % n))).collect();
        let grid = Grid::new([n, 16, 16], values, &bounds).unwrap();
        let place = VolumePlace::still(Affine3A::IDENTITY).unwrap();
        Volume::new(place, bounds, Field::Density(Scalars::Grid(grid)), glow)
    }

    fn medium(scattering: Coefficient, absorption: Coefficient, volume: Volume) -> Medium {
        Medium { name: "smoke".into(), scattering, absorption, volume: Some(Box::new(volume)), ..Default::default() }
    }

    /// Mean over `n` streams of a function of a track along x from −1 to `far`, and its standard error.
    fn mean(m: &Medium, far: f32, n: u32, f: impl Fn(&Track, &mut Stream) -> SampledSpectrum) -> [[f64; 2]; 4] {
        let wavelengths = SampledWavelengths::fixed(NM);
        // Not along an axis: cells are crossed on all sides.
        let (from, to) = (Vec3::new(-1.0, -0.3, 0.2), Vec3::new(far, 0.4, -0.5));
        let ray = Ray { origin: from, direction: (to - from).normalize(), time_s: 0.0 };
        let reach = (to - from).length();
        let track = Track::new(m, m.volume.as_ref().unwrap(), &ray, [0.0, reach], &wavelengths, 0.0);
        let (mut sum, mut squares) = ([0.0f64; 4], [0.0f64; 4]);
        for i in 0..n {
            let mut stream = Sampler::new(SamplerKind::Independent, 3, (1, 2), i, n).stream(Dimensions::Tracking(0));
            let v = f(&track, &mut stream);
            (0..4).for_each(|k| (sum[k], squares[k]) = (sum[k] + v[k] as f64, squares[k] + (v[k] as f64).powi(2)));
        }
        let n = n as f64;
        [0, 1, 2, 3].map(|k: usize| {
            let mean = sum[k] / n;
            [mean, ((squares[k] / n - mean * mean).max(0.0) / n).sqrt()]
        })
    }

    fn assert_near(found: [[f64; 2]; 4], expected: [f64; 4], what: &str) {
        for k in 0..4 {
            let [mean, error] = found[k];
            // 4 standard errors: once in 16 000; and f32.
            assert!((mean - expected[k]).abs() < 4.0 * error + 1e-4, "{what} {}: {mean} ± {error}, {}", NM[k], expected[k]);
        }
    }

    /// Length of the track of [`mean`] for a metre along x.
    fn stretch(far: f32) -> f64 {
        (Vec3::new(far, 0.4, -0.5) - Vec3::new(-1.0, -0.3, 0.2)).length() as f64 / (far as f64 + 1.0)
    }

    /// ∫ density over the track, of values that are linear between those given in `n` parts of 4 m.
    fn depth(n: usize, density: impl Fn(f32) -> f32, far: f32) -> f64 {
        let node = |i: f64| density((-2.0 + 4.0 * (i + 0.5) / n as f64) as f32) as f64;
        let at = |x: f64| {
            let g = (x + 2.0) / 4.0 * n as f64 - 0.5;
            node(g.floor()) * (1.0 - g.fract()) + node(g.floor() + 1.0) * g.fract()
        };
        let steps = 20_000;
        let width = (far as f64 + 1.0) / steps as f64;
        (0..steps).map(|i| at(-1.0 + (i as f64 + 0.5) * width) * width).sum::<f64>() * stretch(far)
    }

    fn extinction(m: &Medium) -> [f64; 4] {
        m.at(&SampledWavelengths::fixed(NM)).extinction.to_array().map(f64::from)
    }

    #[test]
    fn transmittance_is_that_of_the_integral() {
        let even = |_: f32| 0.7f32;
        let rising = |x: f32| 0.2 + 0.35 * (x + 2.0);
        let falling = |x: f32| (-1.5 * x).exp();
        let n = 40_000;
        for (what, density) in [("even", &even as &dyn Fn(f32) -> f32), ("rising", &rising), ("falling", &falling)] {
            let m = medium(colored(), Coefficient::grey(0.2), volume(32, density, None));
            let expected = extinction(&m).map(|s| (-s * depth(32, density, 1.0)).exp());
            let found = mean(&m, 1.0, n, |track, stream| track.transmittance(stream, None));
            assert_near(found, expected, what);
            // What is the same everywhere takes no random numbers.
            assert!(what != "even" || found.iter().all(|[_, error]| *error < 1e-6), "{found:?}");
        }
    }

    #[test]
    fn flights_end_as_the_coefficients_say_at_every_wavelength() {
        let falling = |x: f32| (-1.2 * x).exp();
        let m = medium(colored(), Coefficient::grey(0.4), volume(24, falling, None));
        let sigma = m.at(&SampledWavelengths::fixed(NM));
        let throughput = SampledSpectrum::new(1.0, 0.5, 2.0, 0.3);
        let left = extinction(&m).map(|s| (-s * depth(24, falling, 1.0)).exp());
        let n = 80_000;
        let through =
            mean(&m, 1.0, n, |track, stream| match track.sample_distance(throughput, stream, &mut { SampledSpectrum::ZERO }) {
                DistanceSample::Through(w) => w,
                DistanceSample::Scattered(..) => SampledSpectrum::ZERO,
            });
        assert_near(through, left, "through");
        let scattered =
            mean(&m, 1.0, n, |track, stream| match track.sample_distance(throughput, stream, &mut { SampledSpectrum::ZERO }) {
                DistanceSample::Through(_) => SampledSpectrum::ZERO,
                DistanceSample::Scattered(_, w) => w,
            });
        let albedo = (sigma.scattering / sigma.extinction).to_array();
        assert_near(scattered, [0, 1, 2, 3].map(|k| albedo[k] as f64 * (1.0 - left[k])), "scattered");
        // The mean distance from the start, over its own closed form by quadrature: places are right, not only their number.
        let steps = 4000;
        let unit = stretch(1.0);
        let moments = extinction(&m).map(|s| {
            let mut sum = 0.0;
            for i in 0..steps {
                let x = -1.0 + 2.0 * (i as f64 + 0.5) / steps as f64;
                let before = depth_until(24, falling, x);
                sum += (x + 1.0) * unit * s * density_at(24, falling, x) * (-s * before).exp() * unit * 2.0 / steps as f64;
            }
            sum
        });
        let found =
            mean(&m, 1.0, n, |track, stream| match track.sample_distance(throughput, stream, &mut { SampledSpectrum::ZERO }) {
                DistanceSample::Through(_) => SampledSpectrum::ZERO,
                DistanceSample::Scattered(t, w) => w * t,
            });
        assert_near(found, [0, 1, 2, 3].map(|k| albedo[k] as f64 * moments[k]), "distances");
    }

    fn density_at(n: usize, density: impl Fn(f32) -> f32, x: f64) -> f64 {
        let g = (x + 2.0) / 4.0 * n as f64 - 0.5;
        let node = |i: f64| density((-2.0 + 4.0 * (i + 0.5) / n as f64) as f32) as f64;
        node(g.floor()) * (1.0 - g.fract()) + node(g.floor() + 1.0) * g.fract()
    }

    fn depth_until(n: usize, density: impl Fn(f32) -> f32 + Copy, x: f64) -> f64 {
        let steps = 200;
        let width = (x + 1.0) / steps as f64;
        (0..steps).map(|i| density_at(n, density, -1.0 + (i as f64 + 0.5) * width) * width).sum::<f64>() * stretch(1.0)
    }

    #[test]
    fn what_shines_and_absorbs_has_the_radiance_of_its_depth() {
        // Of even radiance: L (1 − e^(−σa ∫ρ)), whatever the density does.
        let rising = |x: f32| 0.1 + 0.5 * (x + 2.0);
        let scaled = Some(Glow::Scaled(None));
        let glowing = Medium {
            emission: Some(Spectrum::Constant(3.0)),
            ..medium(Coefficient::NONE, colored(), volume(16, rising, scaled.clone()))
        };
        let seen = |m: &Medium, n: u32| {
            mean(m, 1.0, n, |track, stream| {
                let mut emitted = SampledSpectrum::ZERO;
                track.sample_distance(SampledSpectrum::ONE, stream, &mut emitted);
                emitted
            })
        };
        let depth = depth(16, rising, 1.0);
        let expected = extinction(&glowing).map(|s| 3.0 * (1.0 - (-s * depth).exp()));
        assert_near(seen(&glowing, 30_000), expected, "absorbing");
        // The same where it scatters, too: what is seen without having been scattered, L σa/σt (1 − e^(−σt ∫ρ)).
        let m = Medium {
            emission: Some(Spectrum::Constant(3.0)),
            ..medium(Coefficient::grey(0.8), colored(), volume(16, rising, scaled))
        };
        let sigma = m.at(&SampledWavelengths::fixed(NM));
        let fraction = (sigma.absorption / sigma.extinction).to_array();
        let total = extinction(&m);
        let expected = [0, 1, 2, 3].map(|k| 3.0 * fraction[k] as f64 * (1.0 - (-total[k] * depth).exp()));
        assert_near(seen(&m, 60_000), expected, "scattering");
    }

    #[test]
    fn colors_attenuate_each_by_their_own() {
        let bounds = Bounds { min: Vec3::splat(-2.0), max: Vec3::splat(2.0) };
        let tint = Tint::from_rgb(Vec3::new(0.9, 0.3, 0.1));
        let grid = || Grid::new([8, 8, 8], vec![tint; 512], &bounds).unwrap();
        let place = VolumePlace::still(Affine3A::IDENTITY).unwrap();
        let field = Field::Colors { absorption: Some(grid()), scattering: Some(grid()) };
        let m = medium(Coefficient::grey(1.5), Coefficient::grey(0.5), Volume::new(place, bounds, field, None));
        let n = 40_000;
        let found = mean(&m, 1.0, n, |track, stream| track.transmittance(stream, None));
        let unit = Spectrum::Sigmoid(diopter_light::upsample::Sigmoid::from_rgb(Vec3::new(0.5, 1.0 / 6.0, 1.0 / 18.0)));
        let length = 2.0 * stretch(1.0);
        let expected = NM.map(|nm| (-2.0 * 1.8 * unit.at(nm) as f64 * length).exp());
        assert_near(found, expected, "transmittance");
        let through = mean(&m, 1.0, n, |track, stream| {
            match track.sample_distance(SampledSpectrum::ONE, stream, &mut { SampledSpectrum::ZERO }) {
                DistanceSample::Through(w) => w,
                DistanceSample::Scattered(..) => SampledSpectrum::ZERO,
            }
        });
        assert_near(through, expected, "flights");
    }

    #[test]
    fn rays_beside_a_volume_pass() {
        let m = medium(Coefficient::grey(1.0), Coefficient::NONE, volume(8, |_| 5.0, None));
        let wavelengths = SampledWavelengths::fixed(NM);
        for (origin, direction, span) in [
            (Vec3::new(0.0, 3.0, 0.0), Vec3::X, [0.0, f32::INFINITY]),
            (Vec3::new(-9.0, 0.0, 0.0), Vec3::NEG_X, [0.0, f32::INFINITY]),
            (Vec3::new(-9.0, 0.0, 0.0), Vec3::X, [0.0, 6.0]),
            (Vec3::new(-9.0, 0.0, 0.0), Vec3::X, [12.0, 30.0]),
        ] {
            let ray = Ray { origin, direction, time_s: 0.0 };
            let track = Track::new(&m, m.volume.as_ref().unwrap(), &ray, span, &wavelengths, 0.0);
            let mut stream = Sampler::new(SamplerKind::Independent, 3, (1, 2), 0, 1).stream(Dimensions::Tracking(0));
            assert_eq!(track.transmittance(&mut stream, None), SampledSpectrum::ONE);
            let distance_sample = track.sample_distance(SampledSpectrum::ONE, &mut stream, &mut { SampledSpectrum::ZERO });
            assert!(matches!(distance_sample, DistanceSample::Through(w) if w == SampledSpectrum::ONE));
        }
        // Through all of it, from far away and to infinity: 4 m less the fall at both ends.
        let ray = Ray { origin: Vec3::new(-900.0, 0.1, 0.1), direction: Vec3::X, time_s: 0.0 };
        let track = Track::new(&m, m.volume.as_ref().unwrap(), &ray, [0.0, f32::INFINITY], &wavelengths, 0.0);
        let n = 4000;
        let left: f32 = (0..n)
            .map(|i| {
                let mut stream = Sampler::new(SamplerKind::Independent, 3, (1, 2), i, n).stream(Dimensions::Tracking(0));
                track.transmittance(&mut stream, None).x
            })
            .sum();
        // ∫ρ = 5 (3.5 + 2 · 0.25 · 0.75) = 19.4: nothing is left.
        assert!(left / (n as f32) < 1e-4, "{left}");
    }
}
