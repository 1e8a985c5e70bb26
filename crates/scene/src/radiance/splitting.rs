//! Splitting at specular interfaces, for what shines behind them alone.
//!
//! Where a smooth dielectric both mirrors and lets through, or mirrors over a base, a path goes one of these ways by chance. What it shows of lamps and sky over specular surfaces alone is most of the noise of glass: a lamp
//! that is reflected in one sample of twenty-five. The ways that were not chosen are followed, too, but only as far as specular surfaces go, and for what shines there: some rays, no shading. The path itself brings the fraction of
//! what shines on its way that is the product of the probabilities of its choices ([`Path::emission_fraction`]); what rough surfaces scatter it brings as ever. Unbiased.
//!
//! Source: Arvo & Kirk 1990, "Particle transport and image synthesis", SIGGRAPH (splitting, Russian roulette). Measured: `docs/decisions/clear-glass.md`.

use super::path::{Next, Path, Place, SurfaceVertex, Transport};
use super::tally::Tally;
use crate::material::Scatter;
use crate::shape::Surface;
use diopter_light::random::{Dimensions, Stream};

/// Vertices at which other ways are followed: front and back of a hollow body of glass that stands behind another.
const MOST_VERTICES: u32 = 8;

/// Least fraction of the light at the film that another way carries for it to be followed in any case; by chance below.
const LEAST_CERTAIN: f32 = 1.0 / 8.0;

/// Specular surfaces behind which Russian roulette may end a way.
const ROULETTE_AFTER: u32 = 3;

impl<'a> Transport<'a> {
    /// Adds what shines along the specular lobes of a surface that were not chosen.
    #[inline]
    pub fn look_along_other_lobes<T: Tally>(
        &self,
        path: &mut Path<'a, T>,
        here: &SurfaceVertex<'_, 'a>,
        chosen: Option<&Scatter>,
    ) {
        if path.vertex < MOST_VERTICES && self.scene.media_only_absorb() {
            let lobes = here.bsdf.specular_lobes();
            if lobes.iter().any(Option::is_some) {
                self.look_along(path, here, lobes, chosen.filter(|chosen| chosen.specular));
            }
        }
    }

    #[inline(never)]
    fn look_along<T: Tally>(
        &self,
        path: &mut Path<'a, T>,
        here: &SurfaceVertex<'_, 'a>,
        lobes: [Option<Scatter>; 2],
        chosen: Option<&Scatter>,
    ) {
        let mut stream = path.camera.sampler.stream(Dimensions::Splitting(path.vertex));
        for lobe in lobes.into_iter().flatten() {
            if chosen.is_some_and(|chosen| chosen.transmitted == lobe.transmitted) {
                continue;
            }
            let carried = lobe.weight * (lobe.pdf * path.emission_fraction);
            let to_film = (path.throughput * carried).max_element() * path.eta_scale * lobe.eta_scale;
            let survival = (to_film / LEAST_CERTAIN).min(1.0);
            if stream.draw() >= survival {
                continue;
            }
            let mut way = path.fork();
            way.roulette_depth = u32::MAX;
            let next = self.go_along(&mut way, here, Scatter { weight: carried / survival, ..lobe }, 0.0, None, None);
            way.restart_roulette(ROULETTE_AFTER);
            self.follow_specular(&mut way, next, &mut stream);
            path.join(way);
        }
        path.emission_fraction *= chosen.map_or(1.0, |chosen| chosen.pdf);
    }

    /// Follows a path up to the first surface that is not specular, for what shines there.
    pub(super) fn follow_specular<T: Tally>(&self, path: &mut Path<'a, T>, mut next: Next, stream: &mut Stream) {
        while next == Next::GoesOn {
            let mut hit = self.find_hit(path);
            next = self.pass_specular(path, hit.as_mut(), stream);
        }
    }

    /// The same as far as one surface.
    pub(super) fn pass_specular<T: Tally>(&self, path: &mut Path<'a, T>, hit: Option<&mut Surface>, stream: &mut Stream) -> Next {
        self.arrive(path, hit, |path, place| {
            let Place::Surface(here) = place else { return self.scatter_at(path, place) };
            let [choice, roulette] = [stream.draw(), stream.draw()];
            let scatter = here.bsdf.sample([0.5, 0.5, choice, roulette]).filter(|scatter| scatter.specular);
            match scatter {
                Some(scatter) => self.go_along(path, &here, scatter, roulette, None, None),
                None => Next::Ended,
            }
        })
    }
}
