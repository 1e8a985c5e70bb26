//! Steps of a path in a medium: along a segment, and on from where the medium scatters it.

use super::media::{Flight, MediumVertex};
use super::medium_segment::MediumSegment;
use super::path::{Next, Path, Transport};
use super::tally::Tally;
use crate::light_paths::PhotonMap;
use crate::light_paths::connect::CameraSubpath;
use crate::medium::Medium;
use crate::medium_stack::MediumId;
use diopter_light::SampledSpectrum;
use diopter_light::random::Dimensions;
use glam::Vec3;

/// Segments in media, behind a first scattering event, for each along which photons are gathered: a gathering takes as long as the rest of the segment, and photons
/// are less noisy than the path that comes to them.
const SEGMENTS_A_GATHERING: f32 = 4.0;

/// Scattering events within bodies after which a path is given up: of light in a half space that does not absorb one part in a hundred gets so far.
const MAX_SUBSURFACE_EVENTS: u32 = 8192;

impl<'a> Transport<'a> {
    /// Takes a segment through a medium; `None` where the path reaches the end of it.
    #[inline(never)]
    pub fn cross_medium<T: Tally>(&self, path: &mut Path<'a, T>, medium: &'a Medium, span: [f32; 2]) -> Option<MediumVertex<'a>> {
        if let Some(photons) = path.camera.light_paths.photons {
            self.gather_along(path, photons, medium, span);
        }
        let start = path.last.and_then(|last| last.start(self.scene, medium));
        let segment = MediumSegment { start, ..self.segment(path, medium, span) };
        match segment.fly(&mut path.throughput, &mut path.tally) {
            Flight::Through => {
                path.camera_subpath.block_light_paths();
                None
            }
            Flight::Scattered(on) => Some(MediumVertex { segment, on }),
        }
    }

    /// Adds the light that a medium scatters into the ray, and sends the path on.
    #[inline(never)]
    pub fn scatter_in_medium<T: Tally>(&self, path: &mut Path<'a, T>, here: &MediumVertex<'a>) -> Next {
        let MediumVertex { segment, on } = here;
        if !segment.may_scatter(path.throughput) {
            return Next::Ended;
        }
        let (throughput, tally) = (path.throughput, &mut path.tally);
        segment.add_lamp(on, throughput, tally);
        let joint = segment.add_joint(on, throughput, SampledSpectrum::splat, |light, events, _| tally.add(light, events));
        self.go_on_in_medium(path, here, segment.sample_phase(), joint)
    }

    /// Goes on in a direction from where a medium scattered the path; `joint`: the medium in which lights were sought.
    pub fn go_on_in_medium<T: Tally>(
        &self,
        path: &mut Path<'a, T>,
        here: &MediumVertex<'a>,
        direction: (Vec3, f32),
        joint: Option<MediumId>,
    ) -> Next {
        let MediumVertex { segment, on } = here;
        let rate = path.roulette_rate(path.depth() + 1);
        let Some(onward) = segment.go_on(on, direction, joint, &mut path.throughput, path.eta_scale, rate) else {
            return Next::Ended;
        };
        (path.ray, path.last, path.medium_scatter) = (onward.ray, onward.last, Some(*on));
        (path.is_straight, path.camera_subpath) = (false, CameraSubpath::NONE);
        path.tally.depolarize();
        path.suffix.scatter_in(segment.medium);
        path.cone.forget();
        path.vertex += 1;
        path.subsurface_events += u32::from(segment.medium.is_subsurface);
        if path.subsurface_events > MAX_SUBSURFACE_EVENTS { Next::Ended } else { Next::GoesOn }
    }

    /// The segment of a path through a medium, not one that begins where lights were sought.
    pub fn segment<T: Tally>(&self, path: &Path<'a, T>, medium: &'a Medium, span: [f32; 2]) -> MediumSegment<'a> {
        MediumSegment {
            scene: self.scene,
            medium,
            span,
            ray: path.ray,
            medium_stack: path.medium_stack,
            wavelengths: &path.camera.wavelengths,
            sampler: &path.camera.sampler,
            settings: self.settings,
            vertex: path.vertex,
            depth: path.depth(),
            segment_index: path.segment_index,
            flash: path.flash,
            start: None,
        }
    }

    /// Light that comes over mirrors and through glass and is scattered on a segment.
    fn gather_along<T: Tally>(&self, path: &mut Path<'a, T>, photons: &PhotonMap, medium: &Medium, span: [f32; 2]) {
        // Where the path was scattered before, one in some segments stands for all.
        let one_in = if path.last.is_some() { SEGMENTS_A_GATHERING } else { 1.0 };
        let (depth, camera) = (path.depth(), path.camera);
        if medium.scatters_homogeneously()
            && depth < self.settings.max_depth
            && (one_in == 1.0 || camera.sampler.get(Dimensions::Medium(path.segment_index))[3] * one_in < 1.0)
        {
            let most_events = self.settings.max_depth - depth - 1;
            let light = photons.gather_along(&path.ray, span, medium, &camera.wavelengths, most_events);
            path.tally.add_photons(path.throughput * light * one_in, depth + 2);
        }
    }
}
