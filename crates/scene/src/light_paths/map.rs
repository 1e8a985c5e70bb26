//! The photon map: photons of caustics, stored in a grid, and the light that a surface point gathers from those around it; and what a ray gathers in a medium.

use super::photon::Photon;
use super::trace::Traced;
use super::volume_map::VolumeMap;
use super::{CausticSuffix, Caustics};
use crate::bvh::Bounds;
use crate::material::Bsdf;
use crate::medium::{Medium, phase};
use crate::shape::Surface;
use diopter_light::random::mix;
use diopter_light::{Ray, SampledSpectrum, SampledWavelengths};
use glam::{IVec3, Vec3};
use std::f32::consts::PI;
use std::ops::Range;

/// GGX width from which on lobes gather photons of lamps that rays can meet. Narrower ones see these lamps as mirrors do: by chance, as ever.
pub(super) const BROAD_ALPHA: f32 = 0.04;

/// Distance from the plane of the surface, in radii, beyond which photons belong to another surface.
const THICKNESS: f32 = 0.3;

/// Photons around a point from which on the disc is smaller: in a focus far more lie within the radius than are needed for a mean, and gathering
/// them would take the time and the sharpness.
const MAX_PHOTONS_GATHERED: u32 = 1024;

/// Least cosine between the normals of a photon's surface and of the one that gathers it.
const SAME_SIDE: f32 = 0.7;

/// Least cosine that the power of a photon is divided by.
const LEAST_COSINE: f32 = 0.01;

/// The photons of some samples: where light is that came over mirrors and through glass, on surfaces and in media. Made by [`Caustics::map`].
pub struct PhotonMap<'a> {
    caustics: &'a Caustics<'a>,
    grid: Grid,
    in_media: VolumeMap<'a>,
    /// Of the disc within which photons are gathered, m.
    radius: f32,
    /// Half width of the time within which photons are gathered, s; everything without.
    time_radius_s: Option<f32>,
}

impl<'a> PhotonMap<'a> {
    /// Gathered within radii (m): on surfaces, in media.
    pub(super) fn new(caustics: &'a Caustics<'a>, photons: Traced<'a>, radii: [f32; 2], time_radius_s: Option<f32>) -> Self {
        let grid = Grid::new(photons.landed, 2.0 * radii[0]);
        PhotonMap { caustics, grid, in_media: VolumeMap::new(photons.in_media, radii[1]), radius: radii[0], time_radius_s }
    }

    /// How many photons have landed on surfaces.
    pub fn on_surfaces(&self) -> usize {
        self.grid.photons.len()
    }

    /// Whether there are none, neither on surfaces nor in media.
    pub fn is_empty(&self) -> bool {
        self.grid.photons.is_empty() && self.in_media.photons().is_empty()
    }

    /// How many photons are in media.
    pub fn in_media(&self) -> usize {
        self.in_media.photons().len()
    }

    /// Radius of the disc within which photons are gathered, m.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// What photons send out at their wavelengths, W·nm⁻¹ at the wavelengths of a path, altogether: for tests of energy.
    pub fn power(&self, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        let (scene, lamps) = (self.caustics.scene, &self.caustics.emission.lamps);
        let one = |p: &Photon| p.at(wavelengths) * lamps[p.lamp as usize].spectrum(scene, wavelengths, p.time_s);
        self.grid.photons.iter().map(one).sum()
    }

    /// Radiance that photons send along the direction of view of a surface's scattering function, W·m⁻²·sr⁻¹·nm⁻¹; of photons that came by at most so
    /// many scattering events.
    ///
    /// Σ f(wi) Φ K, with Silverman's kernel K = 2 (1 − d²/r²) / (π r²) over the distance d in the plane of the surface (Jensen 2001 §7.2;
    /// Knaus & Zwicker 2011 for any kernel).
    pub(crate) fn gather(
        &self,
        surface: &Surface,
        bsdf: &Bsdf,
        wavelengths: &SampledWavelengths,
        time_s: f32,
        most_events: u32,
    ) -> SampledSpectrum {
        let mut sum = SampledSpectrum::ZERO;
        let crowd = self.grid.count(surface.point, self.radius);
        if crowd == 0 {
            return sum;
        }
        let radius = self.radius * (MAX_PHOTONS_GATHERED as f32 / crowd.max(MAX_PHOTONS_GATHERED) as f32).sqrt();
        let (r2, ng) = (radius * radius, surface.ng);
        let (scene, lamps) = (self.caustics.scene, &self.caustics.emission.lamps);
        let mut last: Option<(u32, SampledSpectrum)> = None;
        self.grid.around(surface.point, radius, |photon| {
            let offset = photon.point - surface.point;
            let (d2, height) = (offset.length_squared(), offset.dot(ng));
            if d2 >= r2 || height.abs() > THICKNESS * radius || u32::from(photon.events) > most_events {
                return;
            }
            let in_time = self.in_time(photon, time_s);
            let (wi, normal) = (photon.from(), photon.normal());
            let side = if wi.dot(ng) > 0.0 { ng } else { -ng };
            if in_time == 0.0 || normal.dot(side) < SAME_SIDE {
                return;
            }
            let lamp = &lamps[photon.lamp as usize];
            let f = match lamp.is_delta {
                true => bsdf.eval(wi).0,
                false => bsdf.eval_broad(wi, BROAD_ALPHA),
            };
            if f == SampledSpectrum::ZERO {
                return;
            }
            let spectrum = match last {
                Some((number, spectrum)) if number == photon.lamp => spectrum,
                _ => {
                    let spectrum = lamp.spectrum(scene, wavelengths, time_s);
                    last = Some((photon.lamp, spectrum));
                    spectrum
                }
            };
            let kernel = kernel(d2 - height * height, r2);
            // `f` has the cosine that the photon's power already has: as the surface is, not as it is shaded (Veach 1997 §5.3.2).
            let cosine = normal.dot(wi).max(LEAST_COSINE);
            sum += f * spectrum * photon.at(wavelengths) * (kernel * in_time / cosine);
        });
        sum
    }

    /// Radiance that photons send back along a part of a ray (m) in a medium, W·m⁻²·sr⁻¹·nm⁻¹; of photons that came by at most so many scattering events.
    ///
    /// Σ p(θ) σs Tr Φ K over the distance from the ray, with the kernel of [`PhotonMap::gather`] (Jarosz et al. 2008, eq. 10).
    pub(crate) fn gather_along(
        &self,
        ray: &Ray,
        span: [f32; 2],
        medium: &Medium,
        wavelengths: &SampledWavelengths,
        most_events: u32,
    ) -> SampledSpectrum {
        let mut sum = SampledSpectrum::ZERO;
        let (scene, lamps) = (self.caustics.scene, &self.caustics.emission.lamps);
        let sigma = medium.at(wavelengths);
        let r2 = self.in_media.radius() * self.in_media.radius();
        let mut last: Option<(u32, SampledSpectrum)> = None;
        self.in_media.along(ray, span, |p, t, d2| {
            let photon = &p.photon;
            if !std::ptr::eq(p.medium, medium) || u32::from(photon.events) > most_events {
                return;
            }
            let in_time = self.in_time(photon, ray.time_s);
            if in_time == 0.0 {
                return;
            }
            let spectrum = match last {
                Some((number, spectrum)) if number == photon.lamp => spectrum,
                _ => {
                    let spectrum = lamps[photon.lamp as usize].spectrum(scene, wavelengths, ray.time_s);
                    last = Some((photon.lamp, spectrum));
                    spectrum
                }
            };
            let phase = phase(ray.direction.dot(photon.from()), medium.asymmetry);
            let factor = kernel(d2, r2) * in_time * phase;
            sum += spectrum * photon.at(wavelengths) * sigma.transmittance(t - span[0]) * factor;
        });
        sum * sigma.scattering
    }

    /// Weight of a photon for a path of a moment (s).
    #[inline]
    fn in_time(&self, photon: &Photon, time_s: f32) -> f32 {
        match self.time_radius_s {
            None => 1.0,
            Some(reach) => time_weight(photon.time_s, time_s, reach, self.caustics.emission.lamps[photon.lamp as usize].window),
        }
    }

    /// Fraction of what an area light shows that a camera path still counts where it meets it.
    #[inline]
    pub(crate) fn area_emission_fraction(&self, suffix: &CausticSuffix, light: Option<u32>) -> SampledSpectrum {
        match light {
            Some(light) if self.caustics.emission.has_area(light) => suffix.left(),
            _ => SampledSpectrum::ONE,
        }
    }

    /// The same of a punctual light.
    #[inline]
    pub(crate) fn punctual_emission_fraction(&self, suffix: &CausticSuffix, light: u32) -> SampledSpectrum {
        if self.caustics.emission.has_punctual(light) { suffix.left() } else { SampledSpectrum::ONE }
    }

    /// Whether an object throws caustics.
    #[inline]
    pub(crate) fn casts(&self, object: u32) -> bool {
        self.caustics.emission.casters.casts(object)
    }
}

/// Silverman's kernel over the square of a distance and of the radius, m²; 1/m².
#[inline]
fn kernel(d2: f32, r2: f32) -> f32 {
    2.0 * (1.0 - d2 / r2) / (PI * r2)
}

/// Weight of a photon of one moment for a path of another, of a lamp that sends its photons evenly over a window (all s): photons within
/// `reach` stand for all.
fn time_weight(photon_s: f32, path_s: f32, reach: f32, [from, to]: [f32; 2]) -> f32 {
    let (length, near) = (to - from, (path_s + reach).min(to) - (path_s - reach).max(from));
    if length <= 0.0 || near <= 0.0 {
        // A lamp of a moment, or one that is out: its modulation says what counts.
        return 1.0;
    }
    if (photon_s - path_s).abs() <= reach { length / near } else { 0.0 }
}

/// Photons by the cell of a hashed uniform grid.
struct Grid {
    /// Edge of a cell, m.
    cell: f32,
    /// Sorted by bucket, in a bucket as they were.
    photons: Vec<Photon>,
    /// Where each bucket begins; one more entry for the end.
    starts: Vec<u32>,
    bounds: Bounds,
}

impl Grid {
    /// Counting sort: the order depends on nothing but the photons'.
    fn new(unsorted: Vec<Photon>, cell: f32) -> Self {
        let buckets = unsorted.len().next_power_of_two().max(1);
        let bucket = |p: &Photon| hash(cell_of(p.point, cell)) as usize & (buckets - 1);
        let mut starts = vec![0u32; buckets + 1];
        unsorted.iter().for_each(|p| starts[bucket(p) + 1] += 1);
        for b in 0..buckets {
            starts[b + 1] += starts[b];
        }
        let mut next = starts.clone();
        let mut order = vec![0u32; unsorted.len()];
        for (i, p) in unsorted.iter().enumerate() {
            let place = &mut next[bucket(p)];
            order[*place as usize] = i as u32;
            *place += 1;
        }
        let photons = order.into_iter().map(|i| unsorted[i as usize]).collect();
        let bounds = Bounds::around(unsorted.iter().map(|p| p.point));
        Grid { cell, photons, starts, bounds }
    }

    /// The cells that a box of half an edge `reach` around a point touches, and where their photons are, with those of other cells.
    #[inline]
    fn cells(&self, p: Vec3, reach: f32) -> impl Iterator<Item = (IVec3, Range<usize>)> {
        let outside = (p + reach).cmplt(self.bounds.min).any() || (p - reach).cmpgt(self.bounds.max).any();
        let (low, high) = (cell_of(p - reach, self.cell), cell_of(p + reach, self.cell));
        let columns = (low.x..=high.x).take(if outside { 0 } else { usize::MAX });
        let cells =
            columns.flat_map(move |x| (low.y..=high.y).flat_map(move |y| (low.z..=high.z).map(move |z| IVec3::new(x, y, z))));
        cells.map(|cell| {
            let bucket = hash(cell) as usize & (self.starts.len() - 2);
            (cell, self.starts[bucket] as usize..self.starts[bucket + 1] as usize)
        })
    }

    /// How many photons are in the cells around a point, about.
    #[inline]
    fn count(&self, p: Vec3, reach: f32) -> u32 {
        self.cells(p, reach).map(|(_, range)| range.len() as u32).sum()
    }

    /// Visits all photons in the cells that a box of half an edge `reach` (half a cell's at most) around a point touches, each once.
    #[inline]
    fn around(&self, p: Vec3, reach: f32, mut visit: impl FnMut(&Photon)) {
        for (cell, range) in self.cells(p, reach) {
            // Other cells share the bucket.
            self.photons[range].iter().filter(|photon| cell_of(photon.point, self.cell) == cell).for_each(&mut visit);
        }
    }
}

#[inline]
fn cell_of(p: Vec3, cell: f32) -> IVec3 {
    (p / cell).floor().as_ivec3()
}

#[inline]
fn hash(cell: IVec3) -> u32 {
    mix(cell.x as u32 ^ mix(cell.y as u32 ^ mix(cell.z as u32)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_light::random::to_unit;

    #[test]
    fn time_weights_have_mean_one() {
        let window = [0.2, 1.0];
        for path in [0.2, 0.25, 0.6, 1.0] {
            let n = 10_000;
            let mean = (0..n).map(|i| 0.2 + 0.8 * (i as f32 + 0.5) / n as f32).map(|t| time_weight(t, path, 0.1, window));
            let mean = mean.sum::<f32>() / n as f32;
            assert!((mean - 1.0).abs() < 2e-3, "{path}: {mean}");
        }
        assert_eq!(time_weight(0.5, 0.5, 0.1, [0.5, 0.5]), 1.0);
    }

    #[test]
    fn the_grid_finds_each_photon_in_reach_once() {
        let place = |i: u32| Vec3::from_array([0, 1, 2].map(|k| 4.0 * to_unit(mix(3 * i + k)) - 2.0));
        let photons: Vec<Photon> = (0..5000).map(|i| Photon::for_tests(place(i))).collect();
        let (cell, reach) = (0.25, 0.125);
        let grid = Grid::new(photons.clone(), cell);
        for i in 0..200 {
            let p = place(100_000 + i);
            let near = |q: &Photon| (q.point - p).length() < reach;
            let mut found = Vec::new();
            grid.around(p, reach, |q| {
                if near(q) {
                    found.push(q.point.to_array().map(f32::to_bits));
                }
            });
            let mut expected: Vec<_> = photons.iter().filter(|q| near(q)).map(|q| q.point.to_array().map(f32::to_bits)).collect();
            found.sort_unstable();
            expected.sort_unstable();
            assert_eq!(found, expected);
        }
        // Nothing at all.
        Grid::new(Vec::new(), cell).around(Vec3::ZERO, reach, |_| panic!("no photon"));
    }
}
