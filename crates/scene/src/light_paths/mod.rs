//! Caustics by paths from the lamps: photons over mirrors and through glass onto surfaces and into media, gathered by the path tracer.
//!
//! A path tracer finds the light of a small lamp behind a lens or over a mirror only by hitting the lamp by chance, and that of a point never.
//! Here photons are traced from the lamp through specular scattering alone, kept where they land, and gathered within a small disc by each
//! surface point that a camera path meets, and within a small radius by each segment of it through a medium. Source: Jensen 1996, "Global Illumination using Photon Maps" (the caustic map); Hachisuka &
//! Jensen 2009, "Stochastic Progressive Photon Mapping"; Knaus & Zwicker 2011, "Progressive Photon Mapping: A Probabilistic Approach"
//! (new photons and a smaller disc in each pass).
//!
//! # Which path is found by whom
//!
//! Vertices from the lamp: `L` a lamp that photons are emitted from; `C` a specular event at a smooth body of glass or metal (a *caster*,
//! those of `casters.rs`); `T` straight through a smooth thin dielectric; `P` any other specular event (the polish of a plastic, the reflection of a thin dielectric);
//! `D` scattering by a lobe that is not specular, at a surface; `N` the same by a lobe narrower than `BROAD_ALPHA`; `M` in a homogeneous medium, `V` in another
//! one (different from place to place, or below a surface that looks as one); `E` the camera. Faces of media and hidden faces are no events.
//!
//! | path | found by |
//! |---|---|
//! | `L T* C (C\|T)* D …E`, `L T* C (C\|T)* M …E` | photons, only: a chance hit there counts nothing |
//! | `L T* D …E`, `L T* (M\|V) …E` | next-event estimation and chance hits, weighted (as without photons) |
//! | `L (C\|T\|P)* E` | chance hits: a lamp seen directly, in a mirror or through glass |
//! | `L …P… D …E` (a `P` before the first `D`, `M` or `V`) | chance hits |
//! | `L …C… V …E` (scattered there first) | chance hits |
//! | `L …C… N …E`, lamp with extent | chance hits; a surface with lobes of both kinds counts each lobe's fraction |
//! | `L …C… N …E`, point, spot, parallel light | photons: rays cannot meet such lamps |
//! | lamps that no photons are emitted from, the environment, unlit surfaces | as without photons |
//!
//! The rows are disjoint, and together they are all paths that the path tracer alone has, and the caustics of lamps without extent, which it does
//! not have: chance hits of such lamps there are none, so their rows of chance hits stay dark as without photons. Photons are weakened by the transmittance of media. Both parts count the events of
//! the whole path against `max_depth`.
//!
//! # Bias
//!
//! Consistent, not unbiased: light is blurred over the disc, and lost where the disc reaches beyond an edge (in media, beyond their faces). The first disc holds about
//! [`FIRST_NEIGHBOURS`] photons on average; map `m` has a radius of r₀ (m + 1)^(−1/6), the area so falls by (m + 1)^(−1/3) (α = 2/3 of Knaus &
//! Zwicker; in a focus it is smaller still), the error of the mean of all maps with it, while their noise falls by (m + 1)^(−1/3) in standard deviation. A caustic's
//! total power is kept. Wavelengths of photons whose power differs by wavelength are joined over ±25 nm. In scenes that move a photon has its
//! own moment, and is gathered within a quarter of the exposure on both sides in the first map, less later: caustics of moving things are
//! blurred by so much more. The flicker of lamps is exact: it is applied at the moment of the camera path.
//! Bodies that bend by another index than they reflect by (dispersion) reflect a little differently along a path from the lamp.
//!
//! # Numbers
//!
//! A map is drawn from the seed, its number, its replicate and the photon's number alone; even and odd samples of a pixel use maps of their own,
//! so that their half difference sees the noise of photons, too.

mod can_connect;
mod casters;
pub(crate) mod connect;
mod directional;
mod emission;
mod map;
mod photon;
mod trace;
mod vertices;
mod volume_map;

pub use directional::CameraRays;
pub use map::PhotonMap;
pub use vertices::{Connections, LightVertices};

use crate::bvh::Bounds;
use crate::material::Bsdf;
use crate::medium::Medium;
use crate::scene::Scene;
use diopter_light::SampledSpectrum;
use diopter_light::random::{Dimensions, Sampler, SamplerKind};
use diopter_light::wavelength::WavelengthSampler;
use emission::PhotonEmission;
use glam::Vec3;
use map::BROAD_ALPHA;
use rayon::prelude::*;
use trace::Traced;

/// Which lamps photons are emitted from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Lamps {
    /// Those that paths from the camera hardly ever find: points, spots, parallel light, small discs at infinity, and surfaces that are small as
    /// seen from what throws caustics.
    #[default]
    Small,
    /// All but the environment.
    All,
}

/// How connections are made.
#[derive(Clone, Debug)]
pub struct ConnectionSettings {
    /// Seed.
    pub seed: u64,
    /// Most scattering events of a path, from lamp to camera.
    pub max_depth: u32,
    /// Light paths of a pool.
    pub paths: u32,
    /// Paths carry red, green and blue instead of wavelengths.
    pub rgb: bool,
}

/// How caustics are computed.
#[derive(Clone, Debug)]
pub struct CausticSettings {
    /// From which lamps.
    pub lamps: Lamps,
    /// Seed.
    pub seed: u64,
    /// Most scattering events of a path, from lamp to camera.
    pub max_depth: u32,
    /// Photons that are emitted for each map.
    pub photons: u32,
    /// Photons carry red, green and blue instead of wavelengths.
    pub rgb: bool,
    /// How long the exposure takes, s.
    pub span_s: f64,
}

impl Default for CausticSettings {
    /// Small lamps, 2¹⁸ photons a map, depth 64, seed 1, no duration.
    fn default() -> Self {
        CausticSettings { lamps: Lamps::Small, seed: 1, max_depth: 64, photons: 1 << 18, rgb: false, span_s: 0.0 }
    }
}

impl Default for ConnectionSettings {
    /// 2¹⁶ light paths a pool, depth 64, seed 1.
    fn default() -> Self {
        ConnectionSettings { seed: 1, max_depth: 64, paths: 1 << 16, rgb: false }
    }
}

/// Photons that an average place of a caustic gathers from the first map.
pub const FIRST_NEIGHBOURS: f32 = 12.0;

/// Photons that are emitted to learn how densely they land.
const PILOT: u32 = 1 << 14;
/// Number of the map that they make: beyond all others.
const PILOT_MAP: u32 = u32::MAX;
/// Fewer of them that land are no caustic.
const FEWEST: usize = 16;
/// Photons of a cell, on average, at which the density of the pilot is read.
const PILOT_NEIGHBOURS: f32 = 4.0;
/// Photons that a thread traces at a time.
const CHUNK: u32 = 4096;
/// Shrinking of the radius from map to map: (m + 1) to this power; (α − 1) / 2 with α = 2/3.
const SHRINK: f32 = -1.0 / 6.0;
/// Half width of the first map's kernel in time, as a fraction of the exposure.
const TIME_REACH: f32 = 0.25;

/// What throws caustics in a scene, and by which lamps: makes maps of photons.
pub struct Caustics<'a> {
    scene: &'a Scene,
    emission: PhotonEmission<'a>,
    settings: CausticSettings,
    wavelengths: WavelengthSampler,
    /// Of the first map on surfaces, and in media, m.
    first_radii: [f32; 2],
}

impl<'a> Caustics<'a> {
    /// Looks for caustics in a scene, which must be posed for the exposure. `None` where the path tracer does as well: without smooth bodies of glass or
    /// metal, without lamps for them, or where hardly a photon lands.
    pub fn new(scene: &'a Scene, settings: CausticSettings) -> Option<Caustics<'a>> {
        let emission = PhotonEmission::new(scene, &settings)?;
        let wavelengths = if settings.rgb { WavelengthSampler::rgb() } else { WavelengthSampler::uniform() };
        let mut caustics = Caustics { scene, emission, settings, wavelengths, first_radii: [0.0; 2] };
        let Traced { landed, in_media } = caustics.photons(PILOT_MAP, 0, PILOT);
        if landed.len() + in_media.len() < FEWEST {
            return None;
        }
        let more = caustics.settings.photons.max(1) as f32 / PILOT as f32;
        let radius = |density: f32| (FIRST_NEIGHBOURS / (std::f32::consts::PI * density * more)).sqrt();
        let points: Vec<Vec3> = landed.iter().map(|p| p.point).collect();
        if !points.is_empty() {
            caustics.first_radii[0] = radius(density(&points));
        }
        if !in_media.is_empty() {
            // As they are seen along three directions.
            let seen = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| {
                let flat: Vec<Vec3> = in_media.iter().map(|p| p.photon.point * (Vec3::ONE - axis)).collect();
                density(&flat)
            });
            caustics.first_radii[1] = radius(seen.iter().product::<f32>().cbrt());
        }
        Some(caustics)
    }

    /// Whether there is something to look for: smooth bodies of glass or metal, and lamps for them.
    pub fn may_exist(scene: &Scene, settings: &CausticSettings) -> bool {
        PhotonEmission::new(scene, settings).is_some()
    }

    /// Whether some of the light comes from lamps without extent, which no path from the camera can meet.
    pub fn has_delta_lamps(&self) -> bool {
        self.emission.has_delta_lamps()
    }

    /// A map of some photons only, to learn how much they bring: larger discs, of the same neighbours.
    pub fn trial_map(&self, photons: u32) -> PhotonMap<'_> {
        let photons = photons.max(1);
        let wider = (self.settings.photons.max(1) as f32 / photons as f32).sqrt();
        let time = self.scene.moves().then_some(TIME_REACH * self.emission.span_s());
        PhotonMap::new(self, self.photons(PILOT_MAP, 1, photons), self.first_radii.map(|r| wider * r), time)
    }

    /// The photons of a map, for samples of a replicate (0 or 1, [`Sampler::replicate`]).
    pub fn map(&self, number: u32, replicate: u32) -> PhotonMap<'_> {
        let photons = self.photons(number, replicate, self.settings.photons.max(1));
        let shrink = (number as f32 + 1.0).powf(SHRINK);
        let time = self.scene.moves().then_some(TIME_REACH * self.emission.span_s() * shrink);
        PhotonMap::new(self, photons, self.first_radii.map(|r| shrink * r), time)
    }

    fn photons(&self, map: u32, replicate: u32, count: u32) -> Traced<'a> {
        // Numbers of their own beside those of pixels.
        let seed = self.settings.seed ^ 0x6a09_e667_f3bc_c908;
        let scale = 1.0 / count as f32;
        let chunks: Vec<Traced> = (0..count.div_ceil(CHUNK))
            .into_par_iter()
            .map(|chunk| {
                let mut traced = Traced::default();
                for photon in chunk * CHUNK..((chunk + 1) * CHUNK).min(count) {
                    let sampler = Sampler::new(SamplerKind::Sobol, seed, (map, 0), 2 * photon + (replicate & 1), 2 * count);
                    let wavelengths = self.wavelengths.sample(sampler.get(Dimensions::Time)[0]);
                    let depth = self.settings.max_depth;
                    trace::trace(&self.emission, self.scene, &sampler, &wavelengths, depth, scale, &mut traced);
                }
                traced
            })
            .collect();
        let mut all = Traced::default();
        for chunk in chunks {
            all.landed.extend(chunk.landed);
            all.in_media.extend(chunk.in_media);
        }
        all
    }
}

/// What a camera path joins with the paths of lamps.
#[derive(Clone, Copy, Default)]
pub struct LightPaths<'a> {
    /// Caustics.
    pub photons: Option<&'a PhotonMap<'a>>,
    /// Vertices to connect with.
    pub vertices: Option<&'a LightVertices<'a>>,
}

impl<'a> LightPaths<'a> {
    /// Photons alone.
    pub fn of_photons(photons: Option<&'a PhotonMap<'a>>) -> Self {
        LightPaths { photons, vertices: None }
    }
}

/// Points per area (1/m²) where they are: the geometric mean of the densities of an average place with points and of an average point.
fn density(points: &[Vec3]) -> f32 {
    let bounds = Bounds::around(points.iter().copied());
    let size = bounds.size().max_element();
    // Below this, rounding of places would show.
    let least = (1e-5 * size).max(4e-7 * bounds.min.abs().max(bounds.max.abs()).max_element()).max(1e-12);
    let mut cell = (0.25 * size).max(least);
    loop {
        let mut cells: Vec<_> = points.iter().map(|p| ((*p - bounds.min) / cell).floor().as_ivec3().to_array()).collect();
        cells.sort_unstable();
        let (mut occupied, mut squares) = (0usize, 0.0f64);
        for same in cells.chunk_by(|a, b| a == b) {
            occupied += 1;
            squares += (same.len() as f64).powi(2);
        }
        let mean = points.len() as f32 / occupied as f32;
        if mean <= PILOT_NEIGHBOURS || cell <= least {
            let of_points = (squares / points.len() as f64) as f32;
            return (mean * of_points).sqrt() / (cell * cell);
        }
        cell = (cell * std::f32::consts::FRAC_1_SQRT_2).max(least);
    }
}

/// Suffix of a camera path since its last event that is not specular: it decides whether photons or a scattered ray bring the light of a lamp.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CausticSuffix {
    /// What chance hits count after the last event that was not specular, where photons are gathered; `None` from the camera or another medium on, and after
    /// specular events that photons do not have.
    scattered: Option<SampledSpectrum>,
    /// Whether a caster bent the path since.
    is_bent: bool,
}

impl CausticSuffix {
    /// The path was scattered along `wi` by a lobe that is not specular.
    #[inline]
    pub fn scatter(&mut self, bsdf: &Bsdf, wi: Vec3) {
        let breadth = bsdf.breadth(BROAD_ALPHA);
        let left = match (breadth.broad, breadth.narrow) {
            (_, false) => SampledSpectrum::ZERO,
            (false, true) => SampledSpectrum::ONE,
            (true, true) => {
                let (whole, broad) = (bsdf.eval(wi).0, bsdf.eval_broad(wi, BROAD_ALPHA));
                let fraction = |k: usize| if whole[k] > 0.0 { (1.0 - broad[k] / whole[k]).clamp(0.0, 1.0) } else { 1.0 };
                SampledSpectrum::new(fraction(0), fraction(1), fraction(2), fraction(3))
            }
        };
        *self = CausticSuffix { scattered: Some(left), is_bent: false };
    }

    /// The path was scattered in a medium.
    #[inline]
    pub fn scatter_in(&mut self, medium: &Medium) {
        *self = CausticSuffix { scattered: medium.scatters_homogeneously().then_some(SampledSpectrum::ZERO), is_bent: false };
    }

    /// The path went on by a specular event that is no straight passage through a thin dielectric.
    #[inline]
    pub fn bend(&mut self, by_caster: bool) {
        match by_caster {
            true => self.is_bent = true,
            false => *self = CausticSuffix::default(),
        }
    }

    /// Fraction of what it meets that still counts.
    #[inline]
    fn left(&self) -> SampledSpectrum {
        self.scattered.filter(|_| self.is_bent).unwrap_or(SampledSpectrum::ONE)
    }
}
