//! Light that comes straight from a lamp to a point: what lens flare is computed from.

use super::to_light::stream_along;
use crate::light::{LightPoint, LightRef, Modulation};
use crate::medium_stack::Immersion;
use crate::scene::Scene;
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::Vec3;

/// Light of a lamp at a point.
#[derive(Clone, Copy, Debug)]
pub struct Incident {
    /// Unit direction towards the lamp.
    pub direction: Vec3,
    /// Distance, m; infinite for lamps at infinity.
    pub distance: f32,
    /// Spectral irradiance on a plane that faces it, W·m⁻²·nm⁻¹, of a lamp that is as bright everywhere as at this place; without its modulation.
    pub irradiance: SampledSpectrum,
    /// How it changes with time.
    pub modulation: Modulation,
}

impl Scene {
    /// Light of one lamp at a point in what it stands in, at a time of the exposure, by two numbers (0 to 1) that choose the place on the lamp: the mean over
    /// them is the lamp's irradiance. `None` where the lamp is hidden or does not shine that way. Light comes through up to `thin_dielectrics` thin dielectrics.
    #[allow(clippy::too_many_arguments)]
    pub fn incident(
        &self,
        lamp: LightRef,
        point: Vec3,
        u: [f32; 2],
        wavelengths: &SampledWavelengths,
        time_s: f32,
        thin_dielectrics: u32,
        Immersion(medium_stack): Immersion,
    ) -> Option<Incident> {
        let light_sample = self.sample_li(lamp, point, u, time_s)?;
        let modulation = match light_sample.spot {
            LightPoint::Area(i, _) => self.description().materials[self.lights().area[i as usize].material as usize].modulation(),
            LightPoint::Punctual(i) => self.lights().punctual[i as usize].modulation,
            LightPoint::Environment(_) => Modulation::Steady,
        };
        let steady = self.steady_radiance(&light_sample, wavelengths, time_s) / light_sample.pdf;
        let stream = || stream_along(point, light_sample.wi);
        let irradiance = self.transmittance_to_light(
            steady,
            point,
            point,
            &light_sample,
            medium_stack,
            wavelengths,
            time_s,
            thin_dielectrics,
            stream,
        );
        let lit = irradiance.is_finite() && irradiance.max_element() > 0.0;
        lit.then_some(Incident { direction: light_sample.wi, distance: light_sample.distance, irradiance, modulation })
    }
}
