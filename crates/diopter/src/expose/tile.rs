//! Samples of the pixels of a tile: rays to radiance, radiance to bands.

use super::camera_rays::{CameraRay, Displacement, Numbers, times};
use super::dispersion_variate::{DispersionVariate, WavelengthHit};
use super::light_tracing::LightTracing;
use super::pixel_cone::PixelCones;
use super::response::{GROUP, add_to};
use super::starbursts;
use super::summed_bands;
use super::sums::{Sums, Tile};
use super::tile_sums::TileSums;
use super::unit::Unit;
use crate::polarizer::Analysis;
use crate::row_store::RowStore;
use diopter_lens::Lens;
use diopter_scene::light::EmitterMis;
use diopter_scene::light_paths::{LightPaths, LightVertices, PhotonMap};
use diopter_scene::radiance::CameraPath;
use diopter_scene::radiance::record::{Radiance, RadianceAndDirect, Record, StokesVectors};
use std::ops::Range;

/// Q / I and U / I of each wavelength behind all filters, where the film tells them.
type Linear = Option<[[f32; 4]; 2]>;

/// Light along a camera ray.
struct CameraLight {
    radiance: glam::Vec4,
    /// Fraction of each wavelength that is direct light, where that is recorded.
    direct: Option<[f32; 4]>,
    linear: Linear,
}

/// A control variate, and where the sums of its light begin.
type Variate = (usize, DispersionVariate);

/// Photons and light vertices of a pass, each by replicate of the samples.
#[derive(Clone, Copy, Default)]
pub(super) struct PassPaths<'a> {
    pub photons: Option<&'a [PhotonMap<'a>; 2]>,
    pub vertices: Option<&'a [LightVertices<'a>; 2]>,
    /// Where light is traced from lamps, too.
    pub lamps: Option<&'a LightTracing<'a>>,
}

impl Unit<'_> {
    /// The sums so far that the samples of a tile are added to one by one; none where they are summed apart.
    pub(super) fn before<S: RowStore>(&self, index: usize, sums: &mut Sums<S>) -> std::io::Result<Vec<f64>> {
        if matches!(self.camera.lens, Lens::Compound(_)) || self.starbursts {
            return Ok(Vec::new());
        }
        let [column, row, width, height] = self.rectangle(index);
        let channels = 2 * self.summed_bands();
        let mut before = Vec::with_capacity(width * height * channels);
        for y in row..row + height {
            before.extend_from_slice(&sums.sums.row(y)?[column * channels..(column + width) * channels]);
        }
        Ok(before)
    }

    /// The samples of a pass in a tile, on top of what [`Unit::before`] gave.
    pub(super) fn tile(&self, index: usize, samples: Range<u32>, before: Vec<f64>, light_paths: PassPaths) -> Tile {
        let rectangle = self.rectangle(index);
        let mut sums = TileSums::new(&self.camera.film, rectangle, self.summed_bands(), before);
        let mut variates = self.variates(rectangle, &samples);
        let numbers = Numbers { rectangle, samples, groups: self.groups };
        let Some(groups) = &self.groups else {
            self.camera_rays(&numbers, !variates.is_empty(), |rays| {
                let light = self.light_along(rays, light_paths);
                rays.iter().zip(light).for_each(|(ray, light)| self.count(ray, &light, &mut variates, &mut sums));
            });
            return self.tile_done(variates, sums);
        };
        // Control variates want the samples of a pixel one after the other.
        let by_pixel = !variates.is_empty();
        let mut of_pair: Vec<(CameraRay, CameraLight)> = Vec::new();
        let pair = |ray: &CameraRay| groups.pair_of(ray.pixel);
        // Empties the rays, all of a sample of a pair.
        let mut count = |rays: &mut Vec<CameraRay>| {
            let light = self.light_along(rays, light_paths);
            if !by_pixel {
                return rays.drain(..).zip(light).for_each(|(ray, light)| self.count(&ray, &light, &mut variates, &mut sums));
            }
            if let (Some((before, _)), Some(ray)) = (of_pair.first(), rays.first())
                && pair(before) != pair(ray)
            {
                self.count_pair(&mut of_pair, &mut variates, &mut sums);
            }
            of_pair.extend(rays.drain(..).zip(light));
        };
        // Samples of a pair come in parts; they are traced together.
        let sample = |ray: &CameraRay| (ray.sampler.number(), pair(ray));
        let mut waiting: Vec<CameraRay> = Vec::new();
        self.camera_rays(&numbers, by_pixel, |rays| {
            while let Some(first) = rays.first() {
                let current = sample(waiting.first().unwrap_or(first));
                let of_current = rays.iter().take_while(|ray| sample(ray) == current).count();
                waiting.extend(rays.drain(..of_current));
                if !rays.is_empty() {
                    count(&mut waiting);
                }
            }
        });
        count(&mut waiting);
        self.count_pair(&mut of_pair, &mut variates, &mut sums);
        self.tile_done(variates, sums)
    }

    /// A tile whose samples are all counted.
    fn tile_done(&self, mut variates: Vec<Variate>, mut sums: TileSums) -> Tile {
        for (from, variate) in &mut variates {
            self.end_pixel(variate, *from, &mut sums);
        }
        sums.done()
    }

    /// Adds the samples of a pair of groups of pixels to the sums, pixel by pixel.
    fn count_pair(&self, samples: &mut Vec<(CameraRay, CameraLight)>, variates: &mut [Variate], sums: &mut TileSums) {
        samples.sort_by_key(|(ray, _)| (ray.pixel[1], ray.pixel[0]));
        for (ray, light) in samples.drain(..) {
            self.count(&ray, &light, variates, sums);
        }
    }

    /// Control variates of a tile's samples: of all light, and of direct light where that is recorded; nothing of bands that tell polarisation, nor of a lens whose
    /// group moves.
    fn variates(&self, [column, _, width, _]: [usize; 4], samples: &Range<u32>) -> Vec<Variate> {
        let moving_group = self.camera.motion.moving().is_some_and(|moving| moving.lenses().len() > 0);
        let other = self.in_radiance() || self.behind.is_some() || !self.analyzers.is_empty() || moving_group;
        if other || !matches!(self.camera.lens, Lens::Compound(_)) {
            return Vec::new();
        }
        let (columns, kind) = (column..column + width, self.settings.sampler);
        let new = || DispersionVariate::new(samples, columns.clone(), kind, &self.camera.film, self.groups.is_none());
        [Some(0), self.direct].into_iter().flatten().filter_map(|from| Some((from, new()?))).collect()
    }

    /// Light along some camera rays; of lamps seen directly what the camera sample counts beside light that is traced
    /// from them.
    fn light_along(&self, rays: &[CameraRay], light_paths: PassPaths) -> Vec<CameraLight> {
        let weight = |path: usize, number: u32, met: glam::Vec3| match (light_paths.lamps, &rays[path].drawn) {
            (Some(lamps), Some(drawn)) => lamps.weight(self, drawn, number, met),
            _ => 1.0,
        };
        let begin = |(path, ray): (usize, &CameraRay)| {
            let CameraRay { pixel, sampler, wavelengths, .. } = *ray;
            let replicate = sampler.replicate();
            let lamps = light_paths.lamps.filter(|_| ray.drawn.is_some());
            let light_paths = LightPaths {
                photons: light_paths.photons.map(|maps| &maps[replicate]),
                vertices: light_paths.vertices.map(|pools| &pools[replicate]),
            };
            let emitter_mis = lamps.map(|lamps| EmitterMis { emitters: lamps.emitters(), weight: &weight, path });
            let cone = PixelCones::cone(self.cones.as_ref(), pixel, sampler.number(), ray.ray);
            CameraPath {
                cone,
                wavelengths,
                sampler,
                light_paths,
                emitter_mis,
                immersion: self.immersion,
                roulette: self.roulette.as_ref(),
            }
        };
        let paths: Vec<CameraPath> = rays.iter().enumerate().map(begin).collect();
        if self.polarized {
            return self.polarized_light(&paths);
        }
        match self.direct {
            None => {
                let of = |radiance| CameraLight { radiance, direct: None, linear: None };
                self.trace(rays, &paths, Radiance).into_iter().map(of).collect()
            }
            Some(_) => {
                let of = |[all, direct]: [glam::Vec4; 2]| {
                    let fraction = std::array::from_fn(|c| if all[c] > 0.0 { direct[c] / all[c] } else { 0.0 });
                    CameraLight { radiance: all, direct: Some(fraction), linear: None }
                };
                self.trace(rays, &paths, RadianceAndDirect).into_iter().map(of).collect()
            }
        }
    }

    /// Traces the paths of some camera rays: where there are groups of pixels, those of a sample of a pair of them.
    fn trace<R: Record>(&self, rays: &[CameraRay], paths: &[CameraPath], record: R) -> Vec<R::Light> {
        let settings = &self.settings.path;
        let Some(groups) = &self.groups else { return self.scene.trace(paths, record, settings) };
        let of_first = groups.len_of_first(rays.iter().map(|ray| ray.pixel));
        self.scene.trace_groups(paths.split_at(of_first).into(), record, settings)
    }

    /// Light along camera paths that are followed with their polarisation: behind the polariser, if there is one.
    fn polarized_light(&self, paths: &[CameraPath]) -> Vec<CameraLight> {
        let analysis = |path: &CameraPath| Analysis::of(self.camera, self.settings.polarizer.as_ref(), &path.cone.ray);
        let analyses: Vec<Analysis> = paths.iter().map(analysis).collect();
        let axes: Vec<glam::Vec3> = analyses.iter().map(|a| a.axis).collect();
        let seen = self.scene.trace(paths, StokesVectors { axes: &axes }, &self.settings.path);
        let light = |(analysis, stokes): (&Analysis, [diopter_light::polarization::Stokes; 4])| {
            let stokes = stokes.map(|s| analysis.apply(s));
            let radiance = glam::Vec4::from_array(stokes.map(|s| s.x));
            let linear = (!self.analyzers.is_empty())
                .then(|| [1, 2].map(|part: usize| stokes.map(|s| if s.x > 0.0 { s[part] / s.x } else { 0.0 })));
            CameraLight { radiance, direct: None, linear }
        };
        analyses.iter().zip(seen).map(light).collect()
    }

    /// Adds a sample to the sums of the pixels where it lands.
    fn count(&self, ray: &CameraRay, light: &CameraLight, variates: &mut [Variate], sums: &mut TileSums) {
        let &CameraRay { pixel: [x, y], ref sampler, ref wavelengths, exposure, weights, factors, .. } = ray;
        let CameraLight { radiance, direct, linear } = light;
        let weighted = (*radiance * wavelengths.weight).to_array();
        // One bad number must not poison a pixel.
        if !weighted.iter().all(|v| v.is_finite()) {
            return;
        }
        let (half, nm) = (sampler.replicate(), wavelengths.nm.to_array());
        // Without the factors of the displacement: what a sample is must not depend on them.
        let lamp = ray.displacement.as_ref().filter(|_| {
            let light = times(weighted, weights);
            self.starbursts && self.is_lamp(|group| self.value(group, nm, light, linear) * exposure)
        });
        let mut counted = factors;
        if let Some(Displacement { displaced, arrived }) = lamp.map(|l| &**l) {
            counted = times(factors, displaced.gathered());
            let sent = times(times(weighted, weights), times(factors, displaced.wings()));
            for c in 0..4 {
                let from = self.camera.pixel_of(arrived[c].as_vec2().to_array());
                let value = |group: usize| self.value_at(group, nm, c, linear) * (sent[c] * exposure);
                let direct = direct.map_or(0.0, |fraction| fraction[c]);
                self.note_starburst(sums, from, half, nm[c], direct, value);
            }
        }
        let Some(spread) = &ray.spread else {
            // All colours where the sample was asked for.
            let weighted = times(weighted, counted);
            let of = |weighted| move |group: usize| self.value(group, nm, weighted, linear) * (weights[0] * exposure);
            let direct = direct.map(|fraction| of(times(weighted, fraction)));
            return self.add(sums.pixel(x, y), half, 1.0, of(weighted), direct);
        };
        for (from, variate) in variates.iter_mut().filter(|_| spread.footprints.is_some()) {
            if variate.is_of_other([x, y]) {
                self.end_pixel(variate, *from, sums);
            }
            // The hero lands where it started: nothing is up to chance.
            for (c, footprint) in (1..4).zip(spread.footprints.into_iter().flatten()) {
                let gain = wavelengths.weight[c] * weights[c] * factors[c] * exposure;
                let of_it = if *from == 0 { 1.0 } else { direct.map_or(0.0, |fraction| fraction[c]) };
                if let (Some((px, py)), true) = (spread.pixels[c], gain > 0.0) {
                    let (radiance, pixel, nm) = (radiance[c] * of_it, [px, py], nm[c]);
                    let (time, pupil) = (spread.time, spread.pupil);
                    variate.note([x, y], sampler.number(), WavelengthHit { nm, radiance, gain, pixel, footprint, time, pupil });
                }
            }
        }
        for c in 0..4 {
            let weight = weights[c] * counted[c];
            if let (Some((px, py)), Some((open, close))) = (spread.pixels[c], spread.windows[c])
                && weight > 0.0
                && (open..=close).contains(&spread.time)
            {
                // A quarter of the sample: all of it would be four times as bright.
                let of = |weighted: f32| move |group: usize| self.value_at(group, nm, c, linear) * (weighted * weight * exposure);
                let direct = direct.map(|fraction| of(weighted[c] * fraction[c]));
                self.add(sums.pixel(px, py), half, 4.0, of(weighted[c]), direct);
            }
        }
    }

    /// Moves the predicted part of a pixel's samples from the pixels where they arrived to those that its displaced footprint covers; the mean stays.
    /// `from`: where the sums of this light begin.
    fn end_pixel(&self, variate: &mut DispersionVariate, from: usize, sums: &mut TileSums) {
        let bands = self.curves_len();
        let by_pixel = self.shutter.differs_by_pixel();
        let open = |[x, y]: [usize; 2], landing: &WavelengthHit| {
            !by_pixel || {
                let (open, close) = self.window(x, y, landing.pupil);
                (open..=close).contains(&landing.time)
            }
        };
        let response = |group: usize, nm: f32| self.curves.at(group, nm);
        variate.end_pixel(bands.div_ceil(GROUP), response, open, |[x, y], half, values, times| {
            let signal = &mut sums.pixel(x, y)[from..from + bands];
            signal.chunks_mut(GROUP).zip(values).for_each(|(bands, value)| add_to(bands, half, *value * times));
        });
    }

    /// What the four wavelengths of a path are worth in a group of bands, with their polarisation where the bands tell it.
    #[inline]
    fn value(&self, group: usize, nm: [f32; 4], weighted: [f32; 4], linear: &Linear) -> glam::Vec4 {
        let value = self.curves.value(group, nm, weighted);
        let Some([q, u]) = linear else { return value };
        let [by_q, by_u] = self.analyzers[group];
        value
            + by_q * self.curves.value(group, nm, times(weighted, *q))
            + by_u * self.curves.value(group, nm, times(weighted, *u))
    }

    /// The same of one of them.
    #[inline]
    fn value_at(&self, group: usize, nm: [f32; 4], c: usize, linear: &Linear) -> glam::Vec4 {
        let value = self.curves.at(group, nm[c]);
        let Some([q, u]) = linear else { return value };
        let [by_q, by_u] = self.analyzers[group];
        value * (glam::Vec4::ONE + by_q * q[c] + by_u * u[c])
    }

    /// Adds a part of a sample to the sums of a pixel. `value`: what it adds to a group of bands; `direct`: what of it is direct light, where that is recorded;
    /// `parts`: how many such parts make a sample.
    #[inline]
    fn add(
        &self,
        pixel: &mut [[f64; 2]],
        half: usize,
        parts: f32,
        value: impl Fn(usize) -> glam::Vec4,
        direct: Option<impl Fn(usize) -> glam::Vec4>,
    ) {
        let bands = self.curves_len();
        let (signal, buffers) = pixel.split_at_mut(bands);
        let mut brightest = 0.0f32;
        for (group, bands) in signal.chunks_mut(GROUP).enumerate() {
            let value = value(group);
            // One bad number must not poison a pixel.
            if value.is_finite() {
                add_to(bands, half, value);
                brightest = brightest.max(value.max_element());
            }
        }
        if let (Some(from), Some(direct)) = (self.direct, direct) {
            for (group, sums) in buffers[from - bands..from].chunks_mut(GROUP).enumerate() {
                let direct = direct(group);
                if direct.is_finite() {
                    add_to(sums, half, direct);
                }
            }
        }
        if let Some(cascade) = &self.cascade {
            cascade.add(buffers, bands, half, brightest * parts, value);
        }
    }

    /// Whether a sample is so bright that what it sends far out counts as a starburst. `value`: what it is in a group of bands.
    fn is_lamp(&self, value: impl Fn(usize) -> glam::Vec4) -> bool {
        let Some(white_e) = self.optics.and_then(|o| o.white_e) else { return false };
        let groups = self.curves_len().div_ceil(GROUP);
        (0..groups).any(|group| value(group).max_element() >= white_e)
    }

    /// Notes what a wavelength of a lamp sends far out, a quarter of a sample, in the pixel where it would have arrived. From beyond the film nothing is
    /// sent. `direct`: what fraction of it is direct light.
    #[allow(clippy::too_many_arguments)]
    fn note_starburst(
        &self,
        sums: &mut TileSums,
        from: Option<(usize, usize)>,
        half: usize,
        nm: f32,
        direct: f32,
        value: impl Fn(usize) -> glam::Vec4,
    ) {
        let Some((x, y)) = from else { return };
        let bands = self.curves_len();
        let before = summed_bands(bands, self.cascade.is_some(), false, false);
        let pixel = sums.pixel(x, y);
        if let Some(from) = self.direct {
            starbursts::note_direct(&mut pixel[from + bands..from + 2 * bands], half, direct, &value);
        }
        starbursts::note(&mut pixel[before..], bands, half, nm, 0.25, value);
    }
}
