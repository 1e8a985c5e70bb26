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
//! In media that are the same everywhere scattering events are receivers and donors, too.
//! Why so, with figures: `docs/decisions/path-reuse.md`.

use super::CameraPath;
use super::donor::{BROAD_ALPHA, BROAD_ASYMMETRY, Donor, Found, Scatterer, Sent, is_untilted};
use super::media::MediumVertex;
use super::medium_between::MediumBetween;
use super::path::{Next, Path, Place, SurfaceVertex, Transport};
use super::receiver::{Lobe, Receiver, Receivers, Sight, Way};
use super::reuse_extent::{LightLevel, mean, within};
use super::reuse_lamps::LampSample;
use super::reuse_sky::SkySample;
use super::tally::{Divisible, Tally};
use super::work::Work;
use crate::bvh::packet::Bundle;
use crate::material::{Coverage, Scatter};
use crate::scene::{Object, Scene, Shape};
use diopter_light::SampledSpectrum;
use diopter_light::random::Dimensions;
use glam::Vec3;

/// Throughput by which roulette decides on the path of a donor, over that behind the donor: it serves many. Products of error and time by 0.5, 1, 2, 4 and 16, over those before it was the path's own throughput:
/// classroom 0.89, 0.74, 0.60, 0.60, 0.67; staircase 0.91, 0.83, 0.82, 0.87, 0.97.
const ROULETTE_THROUGHPUT: f32 = 2.0;

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
        let receivers = Receivers::of(paths);
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
        donors.iter().filter(|donor| donor.is_glossy()).for_each(|donor| all.add_glossy(donor.brightness()));
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
    /// Whether what shines where it goes to next is the path's own.
    keeps_emission: bool,
}

impl Scene {
    /// Whether paths of several pixels may lend one another light ([`Scene::trace_groups`]): nothing moves or flickers, what is around is the same everywhere, and there are no splats or soft strands, which rays go through by chance.
    pub fn lets_paths_be_reused(&self) -> bool {
        let is_certain = |object: &Object| {
            let material = self.material_at(object.material);
            match object.shape {
                Shape::Splats { .. } => false,
                Shape::Curves { .. } => !matches!(material.coverage, Coverage::Blend(_)),
                _ => true,
            }
        };
        self.air().is_none_or(|air| air.medium.volume.is_none())
            && !self.moves()
            && !self.flickers()
            && self.description().objects.iter().all(is_certain)
    }
}

impl<'a> Transport<'a> {
    /// Follows the paths of two groups, of which each lends light among itself, where it may: among those of the same wavelengths, without connections to light paths. How many a light is lent to goes by the light of the other
    /// group ([`super::reuse_extent`]); without another one to all. With the work of both.
    pub fn follow_groups<T: Divisible>(&self, groups: [&'a [CameraPath<'a>]; 2], tally: impl Fn() -> T) -> (Vec<T>, Work) {
        let mut segments = 0;
        let mut followed = groups.map(|cameras| {
            let lends = cameras.len() >= 2 && may_lend(cameras, self.scene);
            let mut group = Group::of(cameras.len());
            let follow = |(number, camera)| {
                let mut path = self.begin(camera, tally());
                match lends {
                    true => self.follow_divided(&mut path, number, &mut group),
                    false => self.follow_to_end(&mut path),
                }
                segments += path.segment_index;
                path.tally
            };
            let tallies = cameras.iter().enumerate().map(follow).collect();
            Followed { group, tallies }
        });
        let of_other = [1, 0].map(|other: usize| followed[other].levels());
        let mut sight = Sight::default();
        for (followed, [direct, all]) in followed.iter_mut().zip(of_other) {
            let Followed { group: Group { receivers, donors, sky, lamps }, tallies } = followed;
            self.lend_sky(receivers, sky, direct, tallies, &mut sight);
            self.lend_lamps(receivers, lamps, direct, tallies, &mut sight);
            self.lend(receivers, donors, all, tallies, &mut sight);
        }
        let tallies = followed.into_iter().flat_map(|followed| followed.tallies).collect();
        (tallies, Work { segments, reuse_rays: sight.cast })
    }

    /// Follows a path, and leaves out of its tally what its donor brings and what it sees of the environment from its receiver.
    fn follow_divided<T: Divisible>(&self, path: &mut Path<'a, T>, number: usize, group: &mut Group<'a>) {
        let Group { receivers, donors, sky, lamps } = group;
        let mut at_rough = false;
        let before = receivers.all.len();
        while !at_rough {
            // What other ways bring goes by more than one event: it must not decide how far direct light is lent.
            path.keep_apart();
            let mut hit = self.find_hit(path);
            let next = self.arrive(path, hit.as_mut(), |path, place| {
                let here = match place {
                    Place::Surface(here) => here,
                    Place::Medium(here) => {
                        at_rough = true;
                        return self.receive_in_medium(path, here, number, receivers);
                    }
                };
                at_rough = !here.bsdf.is_specular();
                let receives = at_rough && self.may_receive(path) && !here.bsdf.is_fiber() && !here.surface.is_strand();
                if receives {
                    let (surface, bsdf) = (here.surface, here.bsdf);
                    let lobe = receivers.lobe(bsdf);
                    let normals = [bsdf.side_normal(), bsdf.shading_normal()];
                    let lights = self.scene.lights();
                    let sky_probability = lights.environment_probability(surface.point, bsdf.light_normal(), path.flash);
                    let places = [surface.point, surface.beside(normals[0])];
                    let receiver = self.receiver(path, number, places, normals, lobe);
                    receivers.all.push(Receiver { sky_probability, ..receiver });
                }
                self.scatter_light(path, &here)
            });
            if let Some(receiver) = receivers.all.get(before).filter(|receiver| self.is_in_vacuum(receiver)) {
                sky.extend(self.take_sky_sample(path, receiver));
                lamps.extend(self.take_lamp_sample(path, receiver));
            }
            self.connect_to_light(path);
            let direct = mean(path.tally.all());
            path.join_apart();
            if next == Next::Ended {
                return;
            }
            if let Some(receiver) = receivers.all.get_mut(before) {
                (receiver.direct, receiver.onward) = (direct, mean(path.throughput));
            }
        }
        let Some(receiver) = receivers.all.get(before) else { return self.follow_to_end(path) };
        // A surface may also be a mirror, by chance, or let light through.
        let was_rough = path.last.is_some_and(|last| last.point == receiver.point);
        if !was_rough || !receiver.faces(path.ray.direction) {
            return self.follow_to_end(path);
        }
        let mut hit = self.find_hit(path);
        if self.is_in_vacuum(receiver) {
            if hit.is_none()
                && let Some(sample) = self.scattered_to_sky(path, receiver)
            {
                sky.push(sample);
                self.see_discs(path);
                return;
            }
            if let Some(sample) = hit.as_ref().and_then(|surface| self.scattered_to_lamp(path, receiver, surface)) {
                lamps.push(sample);
                path.leaves_out_emission = true;
            }
        }
        let (mut donor, mut suspended) = (None, None);
        let blends = self.scene.has_blends();
        let mut next = self.arrive(path, hit.as_mut(), |path, place| {
            let end = match &place {
                Place::Surface(here) => here.surface.beside(here.ng),
                Place::Medium(here) => here.segment.point(&here.on),
            };
            // The path itself may have gone through a blended surface.
            if !may_be_donor(path, &place) || blends && receiver.may_not_see(self.scene, end) {
                return self.scatter_at(path, place);
            }
            match place {
                Place::Surface(here) => self.scatter_apart(path, &here, number, &mut donor, &mut suspended),
                Place::Medium(here) => self.scatter_apart_in_medium(path, here, number, &mut donor, &mut suspended),
            }
        });
        path.leaves_out_emission = false;
        self.connect_to_light(path);
        let (mut before_surface, mut emitted) = (None, SampledSpectrum::ZERO);
        if suspended.as_ref().is_some_and(|suspended| suspended.is_joint) {
            while next == Next::GoesOn && before_surface.is_none() {
                let mut hit = self.find_hit(path);
                next = self.arrive(path, hit.as_mut(), |path, place| {
                    // Light through glass and over mirrors was found in two ways, of which narrow lobes decide how much each counts.
                    let in_two_ways = match &place {
                        Place::Surface(here) if here.bsdf.is_specular() => {
                            self.scene.may_pass(here.surface.object) || self.mirror_of_light_samples(path, here.surface).is_some()
                        }
                        _ => false,
                    };
                    if !in_two_ways {
                        before_surface = Some(std::mem::take(&mut path.tally));
                    }
                    self.scatter_at(path, place)
                });
                self.connect_to_light(path);
            }
        }
        if suspended.as_ref().is_some_and(|suspended| suspended.keeps_emission) {
            path.emission_apart = Some(SampledSpectrum::ZERO);
            while next == Next::GoesOn && path.emission_apart.is_some() {
                let mut hit = self.find_hit(path);
                next = self.arrive(path, hit.as_mut(), |path, place| {
                    emitted = path.emission_apart.take().unwrap_or_default();
                    self.scatter_at(path, place)
                });
                self.connect_to_light(path);
            }
            emitted += path.emission_apart.take().unwrap_or_default();
        }
        if next == Next::GoesOn {
            self.follow_to_end(path);
        }
        let Some(mut donor) = donor else { return };
        if let Some(Suspended { mut tally_before, depth, throughput, broad, narrow, density, .. }) = suspended {
            let mut light = path.tally.all();
            if let Some(before_surface) = before_surface {
                donor.further = Some((donor.found[1].wi, light * density));
                light = before_surface.all();
            }
            donor.found[1].light = light;
            donor.radiance += broad * light;
            tally_before.add(throughput * (narrow * light + broad * emitted), depth + 1);
            path.tally = tally_before;
        }
        if donor.is_lit() {
            donors.push(donor);
        }
    }

    /// Adds the light that a medium scatters into the ray, and sends the path on; where it may, it is a receiver there.
    fn receive_in_medium<T: Tally>(
        &self,
        path: &mut Path<'a, T>,
        here: &MediumVertex<'a>,
        number: usize,
        receivers: &mut Receivers<'a>,
    ) -> Next {
        let MediumVertex { segment, on } = here;
        if self.may_receive(path) && segment.may_scatter(path.throughput) {
            let lobe = Lobe::Phase { along: segment.ray.direction, asymmetry: segment.medium.asymmetry };
            receivers.all.push(self.receiver(path, number, [segment.point(on); 2], [Vec3::ZERO; 2], lobe));
        }
        self.scatter_in_medium(path, here)
    }

    /// A receiver where a path is, before it goes on; places: its own, and where shadow rays start; normals: geometric and shading, 0 in a medium. Of light of the sky it knows nothing yet.
    fn receiver<T: Tally>(
        &self,
        path: &Path<'a, T>,
        number: usize,
        [point, origin]: [Vec3; 2],
        [ng, ns]: [Vec3; 2],
        lobe: Lobe,
    ) -> Receiver {
        Receiver {
            path: number,
            point,
            origin,
            ng,
            ns,
            throughput: path.throughput,
            lobe,
            medium: path.medium_stack.medium(self.scene),
            depth: path.depth(),
            time_s: path.ray.time_s,
            flash: path.flash,
            sky_probability: 0.0,
            direct: 0.0,
            onward: 0.0,
        }
    }

    /// Whether a path may receive light where it is.
    fn may_receive<T: Tally>(&self, path: &Path<'a, T>) -> bool {
        let medium = self.scene.medium(path.medium_stack.medium(self.scene));
        let lets_light_through = match medium {
            None => !path.medium_stack.is_in_body(),
            Some(medium) => medium.scatters_homogeneously() || !path.medium_stack.is_in_body() && medium.only_absorbs(),
        };
        // Where roulette could end the path here, the density of what it finds would be another.
        path.vertex + 1 < path.roulette_depth && lets_light_through
    }

    /// Whether nothing stands between a receiver and what it sees but surfaces.
    fn is_in_vacuum(&self, receiver: &Receiver) -> bool {
        self.scene.medium(receiver.medium).is_none()
    }

    /// Light at a donor, and where the path goes on from there: what is found from now on is the donor's, and the path's own tally is kept in `suspended`, unless a mirror was drawn.
    fn scatter_apart<T: Divisible>(
        &self,
        path: &mut Path<'a, T>,
        here: &SurfaceVertex<'_, 'a>,
        number: usize,
        donor: &mut Option<Donor<'a>>,
        suspended: &mut Option<Suspended<T>>,
    ) -> Next {
        let &SurfaceVertex { surface, material, bsdf, .. } = here;
        let [light_numbers, scatter_numbers] =
            path.camera.sampler.get_two([Dimensions::Light(path.vertex), Dimensions::Scatter(path.vertex)]);
        let throughput = std::mem::replace(&mut path.throughput, SampledSpectrum::ONE);
        let mut tally_before = std::mem::take(&mut path.tally);
        let is_even = bsdf.diffuse_albedo().is_some();
        let is_diffuse = is_even && is_untilted(bsdf.shading_normal(), here.wo);
        let (depth, mut even) = (path.depth(), SampledSpectrum::ZERO);
        if let Some(photons) = path.camera.light_paths.photons {
            self.gather(path, here, photons);
            let light = std::mem::take(&mut path.tally).all();
            match is_diffuse {
                true => even = light,
                false => tally_before.add_photons(throughput * light, depth + 2),
            }
        }
        let chosen = self.choose_light(path, here, light_numbers, None, false);
        self.connect_to_light(path);
        let light = std::mem::take(&mut path.tally).all();
        let by_light = chosen.map_or(Found::default(), |c| Found { wi: c.wi, light, through_narrow: !c.has_extent });
        let wi = self.add_mirrored_light(path, here, false);
        let light = std::mem::take(&mut path.tally).all();
        let mirrored = wi.map_or(Found::default(), |wi| Found { wi, light, through_narrow: false });
        let (mut near_lamp, mut joint) = (Found::default(), None);
        if let Some((medium, span)) = path.medium_stack.span(self.scene, &path.ray, surface.t) {
            let response = |wi: Vec3| {
                let (f, density) = bsdf.eval(wi);
                (if f == SampledSpectrum::ZERO { f } else { SampledSpectrum::ONE }, density)
            };
            let add = |_: &mut T, light: SampledSpectrum, _, wi| near_lamp = Found { wi, light, through_narrow: false };
            joint = self.sample_jointly(path, here, medium, span, response, add);
        }
        let mut radiance = even;
        for (found, events) in [(&by_light, 1), (&mirrored, 2), (&near_lamp, 2)] {
            let broad = found.response(bsdf);
            radiance += broad * found.light;
            if found.light != SampledSpectrum::ZERO && !found.through_narrow {
                tally_before.add(throughput * (bsdf.eval(found.wi).0 - broad) * found.light, depth + events);
            }
        }
        let donor = donor.insert(Donor {
            path: number,
            point: surface.point,
            end: surface.beside(here.ng),
            ng: here.ng,
            scatterer: Scatterer::Surface {
                surface: *surface,
                material,
                ns: bsdf.shading_normal(),
                hero_only: path.hero_only,
                is_diffuse,
                bsdf: (!is_even).then(|| Box::new((bsdf.clone(), material.orientation(surface)))),
            },
            wavelengths: &path.camera.wavelengths,
            found: [by_light, Found::default(), mirrored, near_lamp],
            even,
            radiance,
            further: None,
        });
        let Some(scatter) = bsdf.sample(scatter_numbers) else {
            path.tally = tally_before;
            return Next::Ended;
        };
        let u = scatter_numbers[3];
        let broad = bsdf.eval_broad(scatter.wi, BROAD_ALPHA);
        if scatter.specular || is_even && broad == SampledSpectrum::ZERO {
            (path.tally, path.throughput) = (tally_before, throughput);
            return self.go_along(path, here, scatter, u, None, joint);
        }
        donor.found[1].wi = scatter.wi;
        let all = scatter.weight * scatter.pdf;
        let narrow = (all - broad).max(SampledSpectrum::ZERO);
        // What a medium scatters near lamps was found in two ways, one of which knows the donor alone.
        let is_joint = !is_even && joint.is_none();
        let density = scatter.pdf;
        *suspended = Some(Suspended { tally_before, depth, throughput, broad, narrow, density, is_joint, keeps_emission: false });
        // The same for whoever found the donor.
        path.eta_scale *= ROULETTE_THROUGHPUT * scatter.weight.max_element() * scatter.pdf;
        let weight = SampledSpectrum::splat(1.0 / scatter.pdf);
        self.go_along(path, here, Scatter { weight, ..scatter }, u, None, joint)
    }

    /// The same where a medium scatters the path. Light of lamps that are seen from there stays the path's own: its weight depends on the segment to there, on which other ways look for it.
    fn scatter_apart_in_medium<T: Divisible>(
        &self,
        path: &mut Path<'a, T>,
        here: &MediumVertex<'a>,
        number: usize,
        donor: &mut Option<Donor<'a>>,
        suspended: &mut Option<Suspended<T>>,
    ) -> Next {
        let MediumVertex { segment, on } = here;
        let (point, depth) = (segment.point(on), path.depth());
        segment.add_lamp(on, path.throughput, &mut path.tally);
        let mut near_lamp = Found::default();
        let add = |light: SampledSpectrum, _: u32, wi: Vec3| near_lamp = Found { wi, light, through_narrow: false };
        let joint = segment.add_joint(on, SampledSpectrum::ONE, |_| SampledSpectrum::ONE, add);
        let (wi, density) = segment.sample_phase();
        *donor = Some(Donor {
            path: number,
            point,
            end: point,
            ng: Vec3::ZERO,
            scatterer: Scatterer::Medium { asymmetry: segment.medium.asymmetry },
            wavelengths: segment.wavelengths,
            found: [Found::default(), Found { wi, ..Found::default() }, Found::default(), near_lamp],
            even: SampledSpectrum::ZERO,
            radiance: near_lamp.light * segment.phase(near_lamp.wi),
            further: None,
        });
        *suspended = Some(Suspended {
            tally_before: std::mem::take(&mut path.tally),
            depth,
            throughput: path.throughput,
            broad: SampledSpectrum::splat(density),
            narrow: SampledSpectrum::ZERO,
            density,
            is_joint: false,
            keeps_emission: true,
        });
        // The same for whoever found the donor.
        path.throughput = SampledSpectrum::splat(1.0 / density);
        path.eta_scale *= ROULETTE_THROUGHPUT * segment.medium.at(segment.wavelengths).albedo().max_element() * density;
        self.go_on_in_medium(path, here, (wi, density), joint)
    }

    /// Adds what all donors bring to all receivers.
    fn lend<T: Divisible>(
        &self,
        receivers: &Receivers<'a>,
        donors: &mut [Donor<'a>],
        level: LightLevel,
        tallies: &mut [T],
        sight: &mut Sight,
    ) {
        let mut lent = Vec::with_capacity(receivers.all.len());
        for donor in donors {
            let Ok(own) = receivers.all.binary_search_by_key(&donor.path, |receiver| receiver.path) else { continue };
            let own = &receivers.all[own];
            lent.clear();
            let part = |brightness| level.part_for_surface(brightness, donor.path, tallies.len());
            let of_donor = match donor.is_glossy() {
                false => part(donor.brightness()),
                true => level.part_for_glossy(donor.path, tallies.len()),
            };
            let jointly = if donor.further.is_some() { part(donor.further_brightness()) } else { of_donor.clone() };
            let either = within(&receivers.all, if jointly.len() > of_donor.len() { &jointly } else { &of_donor });
            let faces = |receiver: &Receiver| {
                receiver.depth == own.depth && receiver.medium == own.medium && receiver.way_to(donor.point, donor.ng).is_some()
            };
            let bundle = Bundle::Towards(donor.end);
            let seeing = sight.of(self.scene, &receivers.all, either, donor.path, bundle, faces);
            let between = MediumBetween::new(self.scene, own.medium, donor);
            // Of the donor, and of it and the direction in which its path went on.
            let (mut density, mut joint_density) = (0.0, 0.0);
            for &number in seeing {
                let receiver = &receivers.all[number];
                let Some(Way { wi, distance, geometry }) = receiver.way_to(donor.point, donor.ng) else { continue };
                // Only where nothing hides it does the scattering function count: most of what it costs.
                let (f, pdf) = receivers.eval(receiver, wi);
                if f == SampledSpectrum::ZERO {
                    continue;
                }
                let is_own = receiver.path == donor.path;
                let (is_lent, is_lent_jointly) = (of_donor.contains(&receiver.path), jointly.contains(&receiver.path));
                let Sent { radiance, further } = donor.sent(-wi, is_own);
                let (left, reaches) = match &between {
                    None => (SampledSpectrum::ONE, 1.0),
                    Some(between) => between.left(receiver, wi, distance, receiver.throughput * f),
                };
                let found = pdf * geometry * reaches;
                density += if is_lent { found } else { 0.0 };
                joint_density += if is_lent_jointly { found * further.1 } else { 0.0 };
                let to_film = receiver.throughput * f * left * geometry;
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
}

/// Whether what a path finds at a place may be lent.
fn may_be_donor<T: Tally>(path: &Path<T>, place: &Place) -> bool {
    match place {
        Place::Surface(SurfaceVertex { surface, material, bsdf, .. }) => {
            bsdf.only_reflects() && !bsdf.is_specular() && !surface.is_strand() && !material.is_mixed()
        }
        Place::Medium(MediumVertex { segment, .. }) => {
            segment.medium.scatters_homogeneously()
                && segment.medium.asymmetry.abs() <= BROAD_ASYMMETRY
                && segment.may_scatter(path.throughput)
        }
    }
}

/// Whether paths carry the same wavelengths and are not connected with light paths. Behind lenses that disperse each ray has its own weight of the hero where a body disperses, too: they are to be the same
/// within 2 %, by which light behind such bodies may be off.
fn may_lend(cameras: &[CameraPath], scene: &Scene) -> bool {
    let first = &cameras[0].wavelengths;
    let same_hero = |camera: &CameraPath| (camera.wavelengths.hero_only().x / first.hero_only().x - 1.0).abs() < 0.02;
    cameras.iter().all(|camera| {
        camera.light_paths.vertices.is_none() && camera.wavelengths.nm == first.nm && (!scene.may_disperse() || same_hero(camera))
    })
}
