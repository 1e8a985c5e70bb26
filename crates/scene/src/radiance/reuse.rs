//! Paths of a group of pixels lend one another the light that they found.
//!
//! Where a path meets its first surface that is not a mirror or clear glass (the receiver), it goes on to a second one (the donor), and follows the light that leaves that one towards the first. That light
//! would have served the other paths of the group as well: each donor is connected with receivers of the group by shadow rays, the brighter it is with the more of them ([`super::reuse_extent`]), and what arrives is weighted by the balance
//! heuristic over all of these paths, which could have found this donor. Unbiased; indirect light that n pixels are lent has up to n times less variance, for n − 1 shadow rays. Errors of the pixels of a
//! group are correlated, those of samples of one pixel are not.
//!
//! Sources: Bekaert, Sbert & Halton 2002, "Accelerating Path Tracing by Re-Using Paths", EGWR; Veach 1997, §9.2 (balance heuristic).
//!
//! What a receiver itself sees of the environment is lent, too ([`super::reuse_sky`]). Light of lamps and of the sky at a donor is lent by the density of the donor: all that broad lobes (`BROAD_ALPHA`) send on, and what narrow ones send on from lamps without extent; the rest serves its own path alone. Light that further
//! surfaces send to a donor that is not diffuse is lent by all lobes, by the joint density of the donor and of the direction in which its path went on: towards one receiver a narrow lobe may well send what was drawn for another. Alone are also
//! directions through a surface, and donors behind panes, faces of media and surfaces that let rays through by chance: a shadow ray that meets any of them is blocked, as the path that found a donor met none.
//! Why so, with figures: `docs/decisions/path-reuse.md`.

use super::CameraPath;
use super::path::{Arrival, Next, Path, Transport};
use super::receiver::{Receiver, Receivers, Sight, Way};
use super::reuse_extent::{LightLevel, mean, within};
use super::reuse_lamps::LampSample;
use super::reuse_sky::SkySample;
use super::tally::Divisible;
use crate::bvh::packet::Bundle;
use crate::material::{Bsdf, Coverage, Material, Orientation, Scatter};
use crate::scene::{Object, Scene, Shape};
use crate::shape::{Surface, offset_origin};
use diopter_light::random::Dimensions;
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::Vec3;

/// Least GGX width of broad microfacets: what narrower ones reflect towards another receiver is not what the path was sampled for.
const BROAD_ALPHA: f32 = 0.2;

/// Least cosine to the shading normal under which a scattering function of a diffuse surface is the same from all sides (`LocalFrame::new` tilts the normal below).
const UNTILTED: f32 = 0.01;

/// Albedo that surfaces are taken to have where it is decided to how many paths they lend.
const TYPICAL_ALBEDO: f32 = 0.4;

/// Throughput by which roulette decides on the path of a donor, over that behind the donor: it serves many. Products of error and time by 0.5, 1, 2, 4 and 16, over those before it was the path's own throughput:
/// classroom 0.89, 0.74, 0.60, 0.60, 0.67; staircase 0.91, 0.83, 0.82, 0.87, 0.97.
const ROULETTE_THROUGHPUT: f32 = 2.0;

/// A surface that a path of the group found behind its receiver.
struct Donor<'a> {
    path: usize,
    surface: Surface,
    material: &'a Material,
    /// Where shadow rays end.
    end: Vec3,
    /// Geometric normal on the side of the receiver, and the shading normal.
    ng: Vec3,
    ns: Vec3,
    wavelengths: &'a SampledWavelengths,
    hero_only: bool,
    /// Its scattering function, which is turned to each receiver, where that takes more than a diffuse albedo.
    bsdf: Option<Box<(Bsdf<'a>, Orientation)>>,
    /// Light that was found there: of a lamp, where the path went on, and of a lamp in a mirror.
    found: [Found; 3],
    /// What of it goes to its own receiver, and to the others, too: radiance.
    radiance: SampledSpectrum,
    /// Whether that is the same to all sides.
    is_diffuse: bool,
    /// Where it does more than to reflect diffusely: unit direction in which its path went on, and the radiance that arrives from surfaces there, not of what they emit. Depends on the direction
    /// towards the receiver by the scattering function alone, and is lent by the joint density of the donor and of that direction.
    further: Option<(Vec3, SampledSpectrum)>,
}

/// What the paths of a group lend one another, and where they receive it.
struct Group<'a> {
    receivers: Receivers<'a>,
    donors: Vec<Donor<'a>>,
    sky: Vec<SkySample>,
    lamps: Vec<LampSample>,
}

impl Group<'_> {
    /// One of so many paths, none of which was followed yet.
    fn of(paths: usize) -> Self {
        let receivers = Receivers { all: Vec::with_capacity(paths), bsdfs: Vec::with_capacity(paths) };
        Group { receivers, donors: Vec::with_capacity(paths), sky: Vec::new(), lamps: Vec::new() }
    }
}

/// A group whose paths were followed: what they lend one another, and what each brings by itself.
struct Followed<'a, T> {
    group: Group<'a>,
    tallies: Vec<T>,
}

impl<T: Divisible> Followed<'_, T> {
    /// Light before it is lent: direct light of paths that are scattered at what they see, which is the same where all paths end after one event; and all light.
    fn levels(&self) -> [LightLevel; 2] {
        let Followed { group: Group { receivers, donors, sky, lamps }, tallies } = self;
        let [mut of_sky, mut of_donors, mut of_lamps] = [(); 3].map(|()| vec![0.0; tallies.len()]);
        lamps.iter().for_each(|sample| of_lamps[sample.path] += mean(sample.own));
        sky.iter().for_each(|sample| of_sky[sample.path] += sample.brightness());
        donors.iter().for_each(|donor| of_donors[donor.path] += donor.brightness() + donor.further_brightness());
        let [mut direct, mut all] = [LightLevel::default(); 2];
        donors.iter().filter(|donor| donor.bsdf.is_some()).for_each(|donor| all.add_glossy(donor.brightness()));
        lamps.iter().filter(|sample| sample.depth == 0).for_each(|sample| direct.add_lamp(mean(sample.own)));
        let mut left = receivers.all.iter().peekable();
        for (path, tally) in tallies.iter().enumerate() {
            let receiver = left.next_if(|receiver| receiver.path == path);
            if let Some(receiver) = receiver.filter(|receiver| receiver.depth == 0) {
                direct.add(receiver.direct + of_lamps[path] + of_sky[path] * receiver.onward, Some(receiver.onward));
            }
            let onward = receiver.map(|receiver| receiver.onward);
            all.add(mean(tally.all()) + of_lamps[path] + (of_sky[path] + of_donors[path]) * onward.unwrap_or_default(), onward);
        }
        [direct, all]
    }
}

/// What is kept of a path while it follows the light of its donor.
struct Suspended<T> {
    /// Of the path up to the donor.
    tally_before: T,
    depth: u32,
    throughput: SampledSpectrum,
    /// f cos θ of the lobes that are lent, and of the others; density of the direction in which it goes on.
    broad: SampledSpectrum,
    narrow: SampledSpectrum,
    density: f32,
    /// Whether light from further surfaces is lent by all lobes.
    is_joint: bool,
}

/// Light that was found at a donor.
#[derive(Clone, Copy, Default)]
struct Found {
    /// Unit direction from which it comes.
    wi: Vec3,
    /// Radiance over the density of the direction.
    light: SampledSpectrum,
    /// Whether narrow lobes are lent, too. Not where it could have been found in two ways, of which narrow lobes decide how much each counts; and what was drawn for one direction is noise in another.
    through_narrow: bool,
}

impl Found {
    /// f cos θ of what is lent.
    #[inline]
    fn response(&self, bsdf: &Bsdf) -> SampledSpectrum {
        match self.light == SampledSpectrum::ZERO {
            true => SampledSpectrum::ZERO,
            false if self.through_narrow => bsdf.eval(self.wi).0,
            false => bsdf.eval_broad(self.wi, BROAD_ALPHA),
        }
    }
}

impl Scene {
    /// Whether paths of several pixels may lend one another light ([`Scene::trace_groups`]): nothing moves or flickers, there is no fog around, and there are no splats or soft strands, which rays go through by chance.
    pub fn lets_paths_be_reused(&self) -> bool {
        let is_certain = |object: &Object| {
            let material = self.material_at(object.material);
            match object.shape {
                Shape::Splats { .. } => false,
                Shape::Curves { .. } => !matches!(material.coverage, Coverage::Blend(_)),
                _ => true,
            }
        };
        self.air().is_none() && !self.moves() && !self.flickers() && self.description().objects.iter().all(is_certain)
    }
}

impl<'a> Transport<'a> {
    /// Follows the paths of two groups, of which each lends light among itself, where it may: among those of the same wavelengths, without light paths. How many a light is lent to goes by the light of the other
    /// group ([`super::reuse_extent`]); without another one to all.
    pub fn follow_groups<T: Divisible>(&self, groups: [&'a [CameraPath<'a>]; 2], tally: impl Fn() -> T) -> Vec<T> {
        let mut followed = groups.map(|cameras| {
            let lends = cameras.len() >= 2 && may_lend(cameras, self.scene);
            let mut group = Group::of(cameras.len());
            let follow = |(number, camera)| match lends {
                true => self.follow_divided(camera, tally(), number, &mut group),
                false => self.follow(camera, tally()),
            };
            let tallies = cameras.iter().enumerate().map(follow).collect();
            Followed { group, tallies }
        });
        let of_other = [1, 0].map(|other: usize| followed[other].levels());
        for (followed, [direct, all]) in followed.iter_mut().zip(of_other) {
            let Followed { group: Group { receivers, donors, sky, lamps }, tallies } = followed;
            self.lend_sky(receivers, sky, direct, tallies);
            self.lend_lamps(receivers, lamps, direct, tallies);
            self.lend(receivers, donors, all, tallies);
        }
        followed.into_iter().flat_map(|followed| followed.tallies).collect()
    }

    /// Follows a path, and leaves out of its tally what its donor brings and what it sees of the environment from its receiver.
    fn follow_divided<T: Divisible>(&self, camera: &'a CameraPath<'a>, tally: T, number: usize, group: &mut Group<'a>) -> T {
        let Group { receivers, donors, sky, lamps } = group;
        let mut path = self.begin(camera, tally);
        let mut at_rough = false;
        let (before, time_s) = (receivers.all.len(), path.ray.time_s);
        while !at_rough {
            // What other ways bring goes by more than one event: it must not decide how far direct light is lent.
            path.keep_apart();
            let mut hit = self.find_hit(&path);
            let next = self.arrive(&mut path, hit.as_mut(), |path, here| {
                at_rough = !here.bsdf.is_specular();
                let (throughput, depth) = (path.throughput, path.depth());
                // Where roulette could end the path here, the density of what it finds would be another.
                let receives = at_rough
                    && path.vertex + 1 < path.roulette_depth
                    && path.medium_stack.is_outside()
                    && !here.bsdf.is_fiber()
                    && !here.surface.is_strand();
                let next = self.scatter_light(path, &here.vertex());
                if receives {
                    let Arrival { surface, bsdf, .. } = here;
                    let (point, ng, ns, albedo) =
                        (surface.point, bsdf.side_normal(), bsdf.shading_normal(), bsdf.diffuse_albedo());
                    let (origin, lights) = (offset_origin(point, ng), self.scene.lights());
                    let sky_probability = lights.environment_probability(point, bsdf.light_normal(), path.flash);
                    receivers.all.push(Receiver {
                        path: number,
                        point,
                        origin,
                        ng,
                        ns,
                        throughput,
                        albedo,
                        depth,
                        time_s,
                        flash: path.flash,
                        sky_probability,
                        direct: 0.0,
                        onward: 0.0,
                    });
                    receivers.bsdfs.push(bsdf);
                }
                next
            });
            if let Some(receiver) = receivers.all.get(before) {
                sky.extend(self.take_sky_sample(&mut path, receiver));
                lamps.extend(self.take_lamp_sample(&mut path, receiver));
            }
            self.connect_to_light(&mut path);
            let direct = mean(path.tally.all());
            path.join_apart();
            if next == Next::Ended {
                return path.tally;
            }
            if let Some(receiver) = receivers.all.get_mut(before) {
                (receiver.direct, receiver.onward) = (direct, mean(path.throughput));
            }
        }
        let Some(receiver) = receivers.all.get(before) else { return self.follow_on(path) };
        // A surface may also be a mirror, by chance, or let light through.
        let was_rough = path.last.is_some_and(|last| last.point == receiver.point);
        if !was_rough || path.ray.direction.dot(receiver.ng) <= 0.0 {
            return self.follow_on(path);
        }
        let mut hit = self.find_hit(&path);
        if hit.is_none()
            && let Some(sample) = self.scattered_to_sky(&path, receiver)
        {
            sky.push(sample);
            self.see_discs(&mut path);
            return path.tally;
        }
        if let Some(sample) = hit.as_ref().and_then(|surface| self.scattered_to_lamp(&path, receiver, surface)) {
            lamps.push(sample);
            path.leaves_out_emission = true;
        }
        let (mut donor, mut suspended) = (None, None);
        let blends = self.scene.has_blends();
        let next = self.arrive(&mut path, hit.as_mut(), |path, here| {
            let end = offset_origin(here.surface.point, here.bsdf.side_normal());
            let lends =
                here.bsdf.only_reflects() && !here.bsdf.is_specular() && !here.surface.is_strand() && !here.material.is_mixed();
            // The path itself may have gone through a blended surface.
            if !lends || blends && receiver.may_not_see(self.scene, end) {
                return self.scatter_light(path, &here.vertex());
            }
            let next = self.scatter_apart(path, &here, number, &mut donor, &mut suspended);
            if let (Some(donor), None) = (&mut donor, here.bsdf.diffuse_albedo()) {
                donor.bsdf = Some(Box::new((here.bsdf, here.material.orientation(here.surface))));
            }
            next
        });
        path.leaves_out_emission = false;
        self.connect_to_light(&mut path);
        let (mut next, mut before_surface) = (next, None);
        if suspended.as_ref().is_some_and(|suspended: &Suspended<T>| suspended.is_joint) {
            while next == Next::GoesOn && before_surface.is_none() {
                let mut hit = self.find_hit(&path);
                next = self.arrive(&mut path, hit.as_mut(), |path, here| {
                    // Light through glass and over mirrors was found in two ways, of which narrow lobes decide how much each counts.
                    let in_two_ways =
                        self.scene.may_pass(here.surface.object) || self.mirror_of_light_samples(path, here.surface).is_some();
                    if !here.bsdf.is_specular() || !in_two_ways {
                        before_surface = Some(std::mem::take(&mut path.tally));
                    }
                    self.scatter_light(path, &here.vertex())
                });
                self.connect_to_light(&mut path);
            }
        }
        let tally = if next == Next::Ended { path.tally } else { self.follow_on(path) };
        let Some(mut donor) = donor else { return tally };
        let tally = match suspended {
            None => tally,
            Some(Suspended { mut tally_before, depth, throughput, broad, narrow, density, .. }) => {
                let mut light = tally.all();
                if let Some(before_surface) = before_surface {
                    donor.further = Some((donor.found[1].wi, light * density));
                    light = before_surface.all();
                }
                donor.found[1].light = light;
                donor.radiance += broad * light;
                tally_before.add(throughput * narrow * light, depth + 1);
                tally_before
            }
        };
        let is_lit = |light: SampledSpectrum| light != SampledSpectrum::ZERO;
        if donor.further.is_some_and(|(_, light)| is_lit(light)) || donor.found.iter().any(|found| is_lit(found.light)) {
            donors.push(donor);
        }
        tally
    }

    /// Light at a donor, and where the path goes on from there: what is found from now on is the donor's, and the path's own tally is kept in `suspended`, unless a mirror was drawn.
    fn scatter_apart<T: Divisible>(
        &self,
        path: &mut Path<'a, T>,
        here: &Arrival<'_, 'a>,
        number: usize,
        donor: &mut Option<Donor<'a>>,
        suspended: &mut Option<Suspended<T>>,
    ) -> Next {
        let (vertex, bsdf) = (here.vertex(), &here.bsdf);
        let [light_numbers, scatter_numbers] =
            path.camera.sampler.get_two([Dimensions::Light(path.vertex), Dimensions::Scatter(path.vertex)]);
        let throughput = std::mem::replace(&mut path.throughput, SampledSpectrum::ONE);
        let mut tally_before = std::mem::take(&mut path.tally);
        let (depth, chosen) = (path.depth(), self.choose_light(path, &vertex, light_numbers, None, false));
        self.connect_to_light(path);
        let light = std::mem::take(&mut path.tally).all();
        let by_light = chosen.map_or(Found::default(), |c| Found { wi: c.wi, light, through_narrow: !c.has_extent });
        let wi = self.add_mirrored_light(path, &vertex, false);
        let light = std::mem::take(&mut path.tally).all();
        let mirrored = wi.map_or(Found::default(), |wi| Found { wi, light, through_narrow: false });
        let mut radiance = SampledSpectrum::ZERO;
        for (found, events) in [(&by_light, 1), (&mirrored, 2)] {
            let broad = found.response(bsdf);
            radiance += broad * found.light;
            if found.light != SampledSpectrum::ZERO && !found.through_narrow {
                tally_before.add(throughput * (bsdf.eval(found.wi).0 - broad) * found.light, depth + events);
            }
        }
        let donor = donor.insert(Donor {
            path: number,
            surface: *here.surface,
            material: here.material,
            end: offset_origin(here.surface.point, vertex.ng),
            ng: vertex.ng,
            ns: bsdf.shading_normal(),
            wavelengths: &path.camera.wavelengths,
            hero_only: path.hero_only,
            bsdf: None,
            is_diffuse: bsdf.diffuse_albedo().is_some() && bsdf.shading_normal().dot(vertex.wo) >= UNTILTED,
            found: [by_light, Found::default(), mirrored],
            radiance,
            further: None,
        });
        let Some(scatter) = bsdf.sample(scatter_numbers) else {
            path.tally = tally_before;
            return Next::Ended;
        };
        let u = scatter_numbers[3];
        let broad = bsdf.eval_broad(scatter.wi, BROAD_ALPHA);
        let is_joint = bsdf.diffuse_albedo().is_none();
        if scatter.specular || !is_joint && broad == SampledSpectrum::ZERO {
            (path.tally, path.throughput) = (tally_before, throughput);
            return self.go_along(path, &vertex, scatter, u, None, None);
        }
        donor.found[1].wi = scatter.wi;
        let all = scatter.weight * scatter.pdf;
        let narrow = (all - broad).max(SampledSpectrum::ZERO);
        *suspended = Some(Suspended { tally_before, depth, throughput, broad, narrow, density: scatter.pdf, is_joint });
        // The same for whoever found the donor.
        path.eta_scale *= ROULETTE_THROUGHPUT * scatter.weight.max_element() * scatter.pdf;
        let weight = SampledSpectrum::splat(1.0 / scatter.pdf);
        self.go_along(path, &vertex, Scatter { weight, ..scatter }, u, None, None)
    }

    /// Adds what all donors bring to all receivers.
    fn lend<T: Divisible>(&self, receivers: &Receivers<'a>, donors: &mut [Donor<'a>], level: LightLevel, tallies: &mut [T]) {
        let mut sight = Sight::default();
        let mut lent = Vec::with_capacity(receivers.all.len());
        for donor in donors {
            let Ok(own) = receivers.all.binary_search_by_key(&donor.path, |receiver| receiver.path) else { continue };
            let own = &receivers.all[own];
            lent.clear();
            let part = |brightness| level.part_for_surface(brightness, donor.path, tallies.len());
            let of_donor = match donor.bsdf.is_none() {
                true => part(donor.brightness()),
                false => level.part_for_glossy(donor.path, tallies.len()),
            };
            let jointly = if donor.further.is_some() { part(donor.further_brightness()) } else { of_donor.clone() };
            let either = within(&receivers.all, if jointly.len() > of_donor.len() { &jointly } else { &of_donor });
            let faces =
                |receiver: &Receiver| receiver.depth == own.depth && receiver.way_to(donor.surface.point, donor.ng).is_some();
            let shadow_ray = |receiver: &Receiver| faces(receiver).then(|| receiver.ray_to(donor.end));
            let bundle = Bundle::Towards(donor.end);
            let seeing = sight.of(self.scene, &receivers.all, either, donor.path, bundle, shadow_ray);
            // Of the donor, and of it and the direction in which its path went on.
            let (mut density, mut joint_density) = (0.0, 0.0);
            for &number in seeing {
                let receiver = &receivers.all[number];
                let Some(Way { wi, geometry, .. }) = receiver.way_to(donor.surface.point, donor.ng) else { continue };
                // Only where nothing hides it does the scattering function count: most of what it costs.
                let (f, pdf) = receiver.eval(&receivers.bsdfs[number], wi);
                if f == SampledSpectrum::ZERO {
                    continue;
                }
                let is_own = receiver.path == donor.path;
                let (is_lent, is_lent_jointly) = (of_donor.contains(&receiver.path), jointly.contains(&receiver.path));
                let (radiance, further) = match donor.further.is_none() && (is_own || donor.is_alike_from(-wi)) {
                    true => (donor.radiance, (SampledSpectrum::ZERO, 0.0)),
                    false => self.radiance_towards(donor, -wi),
                };
                density += if is_lent { pdf * geometry } else { 0.0 };
                joint_density += if is_lent_jointly { pdf * geometry * further.1 } else { 0.0 };
                let to_film = receiver.throughput * f * geometry;
                let counted = |counts: bool, light: SampledSpectrum| if counts { to_film * light } else { SampledSpectrum::ZERO };
                lent.push((receiver.path, [counted(is_lent, radiance), counted(is_lent_jointly, further.0)]));
            }
            for (path, [light, further]) in &lent {
                // At both surfaces.
                let further = if joint_density > 0.0 { *further / joint_density } else { SampledSpectrum::ZERO };
                let light = *light / density + further;
                if light.is_finite() {
                    tallies[*path].add(light, own.depth + 2);
                }
            }
        }
    }

    /// Radiance from a donor towards `wo` that is lent by the density of the donor; what is lent by the joint density, and the density of the further direction.
    #[inline(never)]
    fn radiance_towards(&self, donor: &mut Donor<'a>, wo: Vec3) -> (SampledSpectrum, (SampledSpectrum, f32)) {
        let (material, wavelengths) = (donor.material, donor.wavelengths);
        match &mut donor.bsdf {
            Some(turned) => {
                let (bsdf, orientation) = &mut **turned;
                material.turn(bsdf, &donor.surface, *orientation, wo, wavelengths);
                lent_by(&donor.found, donor.further, bsdf)
            }
            None => match material.bsdf(&donor.surface, wo, wavelengths, donor.hero_only, None) {
                Some(bsdf) => lent_by(&donor.found, donor.further, &bsdf),
                None => (SampledSpectrum::ZERO, (SampledSpectrum::ZERO, 0.0)),
            },
        }
    }
}

/// What a scattering function sends on of the light that was found there, by the density of the donor, and by the joint density; the density of the further direction.
fn lent_by(
    found: &[Found; 3],
    further: Option<(Vec3, SampledSpectrum)>,
    bsdf: &Bsdf,
) -> (SampledSpectrum, (SampledSpectrum, f32)) {
    let further = further.map_or((SampledSpectrum::ZERO, 0.0), |(wi, light)| {
        let (f, density) = bsdf.eval(wi);
        (f * light, density)
    });
    (found.iter().map(|found| found.response(bsdf) * found.light).sum(), further)
}

impl Donor<'_> {
    /// Mean radiance towards all sides, where that is the same.
    #[inline]
    fn brightness(&self) -> f32 {
        mean(self.radiance)
    }

    /// About the mean radiance that it sends on from its further direction, divided by the density of that.
    #[inline]
    fn further_brightness(&self) -> f32 {
        self.further.map_or(0.0, |(_, light)| TYPICAL_ALBEDO * mean(light))
    }

    /// Whether its light towards `wo` is that towards its own receiver.
    #[inline]
    fn is_alike_from(&self, wo: Vec3) -> bool {
        self.is_diffuse && self.ns.dot(wo) >= UNTILTED
    }
}

/// Whether paths carry the same wavelengths and know nothing of light paths. Behind lenses that disperse each ray has its own weight of the hero where a body disperses, too: they are to be the same
/// within 2 %, by which light behind such bodies may be off.
fn may_lend(cameras: &[CameraPath], scene: &Scene) -> bool {
    let first = &cameras[0].wavelengths;
    let same_hero = |camera: &CameraPath| (camera.wavelengths.hero_only().x / first.hero_only().x - 1.0).abs() < 0.02;
    cameras.iter().all(|camera| {
        camera.light_paths.photons.is_none()
            && camera.light_paths.vertices.is_none()
            && camera.wavelengths.nm == first.nm
            && (!scene.may_disperse() || same_hero(camera))
    })
}
