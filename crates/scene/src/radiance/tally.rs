//! Where the light of a path is summed: all of it, direct light apart, or with its polarisation. Each has a path tracer of its own, so that what is not asked for
//! costs nothing.
//!
//! A path is followed from the camera, and with it the Mueller matrix of all its events so far: by it the light that the path finds becomes a Stokes vector at the
//! camera. Directions and their densities are those of unpolarised light; matrices are over what events do to that, so that throughputs are the same, too.

use crate::light::environment::LinearlyPolarized;
use crate::material::Bsdf;
use crate::material::polarization::Event;
use crate::russian_roulette::RouletteRates;
use diopter_light::SampledSpectrum;
use diopter_light::polarization::{Mueller, a_from_b};
use glam::{Mat4, Vec3, Vec4};

/// Most scattering events of direct light.
pub(crate) const DIRECT_EVENTS: u32 = 1;

/// Thin dielectrics that light from a lamp goes through, one after another as the path meets them.
pub(crate) trait ThinDielectrics: Default {
    /// One more, its scattering function seen from the path.
    fn cross(&mut self, bsdf: &Bsdf, direction: Vec3);
}

impl ThinDielectrics for () {
    #[inline]
    fn cross(&mut self, _: &Bsdf, _: Vec3) {}
}

/// Sums of the light of a path.
pub(super) trait Tally {
    /// What is known of thin dielectrics before a lamp.
    type ThinDielectrics: ThinDielectrics;
    /// What is known of a vertex that scatters light into the path.
    type Vertex;

    /// A vertex that light leaves along `wo`, towards the camera, and to which it comes from `wi`; before the path goes on from there.
    fn vertex(&self, bsdf: &Bsdf, wo: Vec3, wi: Vec3) -> Self::Vertex;

    /// Adds unpolarised light that arrives along the ray and was scattered so many times between lamp and camera.
    fn add(&mut self, light: SampledSpectrum, events: u32);

    /// The same of what `work` adds to the sum of all light.
    fn add_by<R>(&mut self, events: u32, work: impl FnOnce(&mut SampledSpectrum) -> R) -> R;

    /// The same of light that photons brought.
    #[inline]
    fn add_photons(&mut self, light: SampledSpectrum, events: u32) {
        self.add(light, events);
    }

    /// The same of light that may be polarised.
    #[inline]
    fn add_polarized(&mut self, light: SampledSpectrum, events: u32, _: impl FnOnce() -> Option<LinearlyPolarized>) {
        self.add(light, events);
    }

    /// The same of light that is scattered into the path at a vertex, and came there through thin dielectrics.
    #[inline]
    fn add_scattered(
        &mut self,
        light: SampledSpectrum,
        events: u32,
        _: &Self::Vertex,
        _: &Self::ThinDielectrics,
        _: impl FnOnce() -> Option<LinearlyPolarized>,
    ) {
        self.add(light, events);
    }

    /// Goes on behind a scattering event at a surface, from which light leaves along `wo` and comes from `wi`.
    #[inline]
    fn scatter(&mut self, _: &Bsdf, _wo: Vec3, _wi: Vec3, _specular: bool) {}

    /// One without light for a way that divides here.
    fn fork(&self) -> Self;

    /// Adds what was found on such a way.
    fn join(&mut self, fork: Self);

    /// Goes on behind one in a medium.
    #[inline]
    fn depolarize(&mut self) {}
}

impl Tally for SampledSpectrum {
    type ThinDielectrics = ();
    type Vertex = ();

    #[inline]
    fn vertex(&self, _: &Bsdf, _: Vec3, _: Vec3) {}

    #[inline]
    fn add(&mut self, light: SampledSpectrum, _: u32) {
        *self += light;
    }

    #[inline]
    fn add_by<R>(&mut self, _: u32, work: impl FnOnce(&mut SampledSpectrum) -> R) -> R {
        work(self)
    }

    #[inline]
    fn fork(&self) -> Self {
        SampledSpectrum::ZERO
    }

    #[inline]
    fn join(&mut self, fork: Self) {
        *self += fork;
    }
}

/// A tally of which a part can be summed apart and added later: of all light alone.
pub(super) trait Divisible: Tally + Default {
    /// All light so far.
    fn all(&self) -> SampledSpectrum;
}

impl Divisible for SampledSpectrum {
    fn all(&self) -> SampledSpectrum {
        *self
    }
}

impl Divisible for DirectTally {
    fn all(&self) -> SampledSpectrum {
        self.all
    }
}

/// All light, and that of at most [`DIRECT_EVENTS`].
#[derive(Default)]
pub(super) struct DirectTally {
    pub all: SampledSpectrum,
    pub direct: SampledSpectrum,
}

impl DirectTally {
    /// All light, and direct light.
    pub fn both(self) -> [SampledSpectrum; 2] {
        [self.all, self.direct]
    }
}

impl Tally for DirectTally {
    type ThinDielectrics = ();
    type Vertex = ();

    #[inline]
    fn vertex(&self, _: &Bsdf, _: Vec3, _: Vec3) {}

    #[inline]
    fn add(&mut self, light: SampledSpectrum, events: u32) {
        self.all += light;
        if events <= DIRECT_EVENTS {
            self.direct += light;
        }
    }

    #[inline]
    fn add_by<R>(&mut self, events: u32, work: impl FnOnce(&mut SampledSpectrum) -> R) -> R {
        let before = self.all;
        let result = work(&mut self.all);
        if events <= DIRECT_EVENTS {
            self.direct += self.all - before;
        }
        result
    }

    fn fork(&self) -> Self {
        Self::default()
    }

    fn join(&mut self, fork: Self) {
        self.all += fork.all;
        self.direct += fork.direct;
    }
}

/// Light by how often it was scattered, and that of photons: what trials ask for.
#[derive(Default)]
pub(super) struct TrialTally {
    /// That of at most [`RouletteRates::EVENTS`] events and more than those before; the last of all that is left.
    pub by_events: [SampledSpectrum; RouletteRates::EVENTS.len() + 1],
    /// Of all light.
    pub gathered: SampledSpectrum,
}

impl TrialTally {
    #[inline]
    fn of(&mut self, events: u32) -> &mut SampledSpectrum {
        &mut self.by_events[RouletteRates::EVENTS.partition_point(|most| *most < events)]
    }
}

impl Tally for TrialTally {
    type ThinDielectrics = ();
    type Vertex = ();

    #[inline]
    fn vertex(&self, _: &Bsdf, _: Vec3, _: Vec3) {}

    #[inline]
    fn add(&mut self, light: SampledSpectrum, events: u32) {
        *self.of(events) += light;
    }

    #[inline]
    fn add_by<R>(&mut self, events: u32, work: impl FnOnce(&mut SampledSpectrum) -> R) -> R {
        work(self.of(events))
    }

    fn fork(&self) -> Self {
        Self::default()
    }

    fn join(&mut self, fork: Self) {
        self.by_events.iter_mut().zip(fork.by_events).for_each(|(sum, light)| *sum += light);
        self.gathered += fork.gathered;
    }

    #[inline]
    fn add_photons(&mut self, light: SampledSpectrum, events: u32) {
        self.add(light, events);
        self.gathered += light;
    }
}

/// Stokes vectors at the camera, and the events of the path so far.
pub(super) struct Polarized {
    /// I, Q, U, V of each wavelength.
    pub stokes: [Vec4; 4],
    /// From the frame of the ray to that of the camera.
    matrices: [Mueller; 4],
    /// x axis of the frame of the ray.
    axis: Vec3,
}

impl Polarized {
    /// A path that begins at a camera whose frame has this x axis.
    pub fn seen_along(axis: Vec3) -> Self {
        Polarized { stokes: [Vec4::ZERO; 4], matrices: [Mat4::IDENTITY; 4], axis }
    }

    fn sum(&mut self, light: SampledSpectrum, matrices: &[Mueller; 4], axis: Vec3, k: Vec3, source: Option<LinearlyPolarized>) {
        let arriving = match source {
            None => Vec4::X,
            Some(source) => a_from_b(axis, source.axis, k) * Vec4::new(1.0, source.degree, 0.0, 0.0),
        };
        for (lane, stokes) in self.stokes.iter_mut().enumerate() {
            *stokes += matrices[lane] * arriving * light[lane];
        }
    }
}

/// `matrices`, whose frame has the x axis `axis`, behind an event from which light leaves along `wo`.
fn behind(matrices: &[Mueller; 4], axis: Vec3, event: &Event, wo: Vec3) -> [Mueller; 4] {
    let turn = a_from_b(axis, event.outgoing, wo);
    std::array::from_fn(|lane| matrices[lane] * turn * event.matrices[lane])
}

/// A vertex of a polarised path.
pub(super) struct PolarizedVertex {
    event: Event,
    wo: Vec3,
    wi: Vec3,
    /// Those of the path before it.
    matrices: [Mueller; 4],
    axis: Vec3,
}

impl Tally for Polarized {
    type ThinDielectrics = ThinDielectricMueller;
    type Vertex = PolarizedVertex;

    fn vertex(&self, bsdf: &Bsdf, wo: Vec3, wi: Vec3) -> PolarizedVertex {
        PolarizedVertex { event: bsdf.polarization(wi, false), wo, wi, matrices: self.matrices, axis: self.axis }
    }

    fn add(&mut self, light: SampledSpectrum, _: u32) {
        let matrices = self.matrices;
        self.sum(light, &matrices, self.axis, Vec3::Z, None);
    }

    fn add_by<R>(&mut self, events: u32, work: impl FnOnce(&mut SampledSpectrum) -> R) -> R {
        let mut light = SampledSpectrum::ZERO;
        let result = work(&mut light);
        self.add(light, events);
        result
    }

    fn add_polarized(&mut self, light: SampledSpectrum, _: u32, source: impl FnOnce() -> Option<LinearlyPolarized>) {
        let source = source();
        let (matrices, axis) = (self.matrices, self.axis);
        let k = source.map_or(Vec3::Z, |s| s.along);
        self.sum(light, &matrices, axis, k, source);
    }

    fn add_scattered(
        &mut self,
        light: SampledSpectrum,
        _: u32,
        vertex: &PolarizedVertex,
        passed: &ThinDielectricMueller,
        source: impl FnOnce() -> Option<LinearlyPolarized>,
    ) {
        let PolarizedVertex { event, wo, wi, matrices, axis } = vertex;
        let together = passed.0.as_ref().map(|thin_dielectrics| event.then(thin_dielectrics, -*wi));
        let event = together.as_ref().unwrap_or(event);
        let matrices = behind(matrices, *axis, event, *wo);
        self.sum(light, &matrices, event.incoming, -*wi, source());
    }

    fn scatter(&mut self, bsdf: &Bsdf, wo: Vec3, wi: Vec3, specular: bool) {
        let event = bsdf.polarization(wi, specular);
        self.matrices = behind(&self.matrices, self.axis, &event, wo);
        self.axis = event.incoming;
    }

    fn fork(&self) -> Self {
        Polarized { stokes: [Vec4::ZERO; 4], ..*self }
    }

    fn join(&mut self, fork: Self) {
        for (stokes, more) in self.stokes.iter_mut().zip(fork.stokes) {
            *stokes += more;
        }
    }

    fn depolarize(&mut self) {
        self.matrices = self.matrices.map(|m| m * diopter_light::polarization::DEPOLARIZER);
    }
}

/// The Mueller matrices of thin dielectrics that were passed, if any.
#[derive(Default)]
pub(super) struct ThinDielectricMueller(Option<Event>);

impl ThinDielectrics for ThinDielectricMueller {
    fn cross(&mut self, bsdf: &Bsdf, direction: Vec3) {
        let event = bsdf.polarization(direction, true);
        self.0 = Some(match &self.0 {
            None => event,
            Some(before) => before.then(&event, -direction),
        });
    }
}
