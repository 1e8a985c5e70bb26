//! What light paths bring to their vertices, and the recurrences of its weights in multiple importance sampling, as [`super`] derives them.

use super::{Connections, Event, LEAST_COSINE, LightLeSample};
use crate::light::LightRef;
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::Vec3;

/// What a light path brings to a vertex at some wavelengths, and its weights; squares of ratios as the module says.
#[derive(Clone, Copy, Debug)]
pub(in crate::light_paths) struct State {
    /// Power over the densities of all places so far, W·nm⁻¹ for one light path.
    pub flux: SampledSpectrum,
    pub weights: Weights,
}

/// Of the strategies that make less from the lamp than the one that connects a vertex.
#[derive(Clone, Copy, Debug)]
pub(in crate::light_paths) struct Weights {
    /// Strategies before this one that need no density of a direction here: (e / κ l₀)² at v₁, then 1 or 0.
    pub a: f64,
    /// The others: what the squared density of the direction towards the lamp is multiplied by.
    pub j: f64,
    /// 1 / lᵢ².
    pub over_l2: f64,
}

#[inline]
pub(in crate::light_paths) fn squared(x: f64) -> f64 {
    x * x
}

impl Connections<'_> {
    /// The state at v₁, with the light sent out given.
    pub(super) fn first_state(&self, start: &LightLeSample, event: &Event, flux: SampledSpectrum) -> State {
        let (lights, light) = (self.scene.lights(), self.lamps[start.lamp as usize].light);
        let point = event.surface.point;
        let d2 = f64::from(event.d2);
        let cos = f64::from(event.surface.ng.dot(event.to_prev).abs());
        let kappa_l0 = self.kappa * start.l0;
        if let LightRef::Punctual(i) = light
            && let Some(directional) = &self.directional[i as usize]
        {
            let chosen = lights.infinite_light_probability(point, event.surface.ng, light, false);
            let e = f64::from(chosen * directional.direction_density());
            let j = if directional.is_delta() { 0.0 } else { squared(1.0 / kappa_l0) };
            let l = f64::from(start.p_line) * cos;
            return State { flux, weights: Weights { a: squared(e / kappa_l0), j, over_l2: 1.0 / squared(l) } };
        }
        let l = f64::from(start.p_line) * cos / d2;
        let chosen = f64::from(lights.finite_light_probability(point, event.surface.ng, light));
        let (e, j) = match light {
            LightRef::Area(i) => {
                let geometry = f64::from(start.normal.dot(event.to_prev).abs()) / d2;
                let pdf = self.scene.pdf_li(i, point, event.to_prev, event.d2.sqrt(), 0.0);
                (chosen * f64::from(pdf) * geometry, squared(geometry / kappa_l0))
            }
            _ => (chosen, 0.0),
        };
        State { flux, weights: Weights { a: squared(e / kappa_l0), j, over_l2: 1.0 / squared(l) } }
    }
}

/// The state one event farther, at some wavelengths; `None` where no light gets there.
pub(super) fn next_state(state: State, last: &Event, event: &Event, wavelengths: &SampledWavelengths) -> Option<State> {
    let (surface, ng) = (&last.surface, last.surface.ng);
    let bsdf = |wo: Vec3| last.material.bsdf(surface, wo, wavelengths, false, last.around);
    let (passed, to_lamp, from_lamp, a) = match last.is_specular {
        true => {
            let bsdf = bsdf(last.to_prev)?;
            let scatter = bsdf.sample(last.u).filter(|s| s.specular)?;
            // Radiance changes by η² where it is bent, power does not (Veach 1997 §5.2).
            let eta_scale = if scatter.transmitted { scatter.eta_scale } else { 1.0 };
            (scatter.weight * (bsdf.shading_correction(scatter.wi) * eta_scale), 1.0, 1.0, 0.0)
        }
        false => {
            // As the camera sees it: what is not reciprocal is so computed alike by all strategies.
            let (f, to_lamp) = bsdf(last.to_next)?.eval(last.to_prev);
            let cosines = ng.dot(last.to_next).abs() / ng.dot(last.to_prev).abs().max(LEAST_COSINE);
            let from_lamp = last.material.pdf(surface, last.to_prev, last.to_next, wavelengths, last.around);
            (f * cosines, to_lamp, from_lamp, state.weights.a)
        }
    };
    let d2 = f64::from(event.d2);
    let cos = |event: &Event, way: Vec3| f64::from(event.surface.ng.dot(way).abs()) / d2;
    let before = (a + squared(f64::from(to_lamp)) * state.weights.j) * state.weights.over_l2;
    let l = f64::from(from_lamp) * cos(event, event.to_prev);
    Some(State {
        flux: state.flux * passed * last.over_density,
        weights: Weights {
            a: f64::from(u8::from(!last.is_specular)),
            j: before * squared(cos(last, event.to_prev)),
            over_l2: 1.0 / squared(l),
        },
    })
}
