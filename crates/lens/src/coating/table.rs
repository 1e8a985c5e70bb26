//! Transmittance by wavelength and cosine in a table: what packets of rays look up.

use super::Stack;
use crate::glass::Glass;
use crate::ray::TraceDirection;
use std::sync::{Arc, OnceLock};

/// Wavelengths of a table: from 380 to 780 nm every 5 nm.
const WAVELENGTHS: usize = 81;
const STEP_NM: f64 = 5.0;
/// Cosines of a table: from 0 to 1.
const COSINES: usize = 33;

/// Fraction of unpolarised light that a surface lets on (a mirror: reflects), by wavelength and cosine; bilinear between.
///
/// The cosine is that in the thinner of the two media, where it runs from 0 to 1 without total reflection; light takes the same way back with
/// the same transmittance, so that one table serves both directions. Against the films themselves it is right to 3e-4 for cosines from 0.5,
/// to 1e-2 at grazing.
#[derive(Clone, Debug)]
pub struct LightTable {
    stack: Arc<Stack>,
    glasses: [Glass; 2],
    mirror: bool,
    /// Whether cosines count on the object's side.
    object_side: bool,
    values: OnceLock<Box<[f32]>>,
}

impl LightTable {
    /// For films between two media, the first on the object's side. The values are computed when they are first asked for.
    pub fn new(stack: &Arc<Stack>, glasses: [&Glass; 2], mirror: bool) -> LightTable {
        let [before, after] = glasses.map(|g| g.index(super::DESIGN_NM));
        LightTable {
            stack: stack.clone(),
            glasses: glasses.map(Glass::clone),
            mirror,
            object_side: mirror || before <= after,
            values: OnceLock::new(),
        }
    }

    /// Whether another surface has the same table.
    pub fn serves(&self, stack: &Arc<Stack>, glasses: [&Glass; 2], mirror: bool) -> bool {
        let [a, b] = [&self.glasses[0], &self.glasses[1]];
        self.mirror == mirror
            && *a == *glasses[0]
            && *b == *glasses[1]
            && (Arc::ptr_eq(&self.stack, stack) || self.stack == *stack)
    }

    /// Whether cosines count on the object's side of the surface.
    pub fn is_by_object_side(&self) -> bool {
        self.object_side
    }

    /// Transmittance (of mirrors reflectance) of unpolarised light, 0 to 1, `[wavelength][cosine]`.
    pub fn values(&self) -> &[f32] {
        self.values.get_or_init(|| {
            let mut values = Vec::with_capacity(WAVELENGTHS * COSINES);
            for i in 0..WAVELENGTHS {
                let nm = 380.0 + STEP_NM * i as f64;
                let [before, after] = [0, 1].map(|k| self.glasses[k].index(nm));
                // Where a glass has no index it lets no light on.
                if !(before.is_finite() && after.is_finite()) {
                    values.extend([0.0; COSINES]);
                    continue;
                }
                for j in 0..COSINES {
                    let cos = j as f64 / (COSINES - 1) as f64;
                    values.push(if self.mirror {
                        on_aluminium(&self.stack, before, cos, nm).unpolarised_reflectance()
                    } else if self.object_side {
                        self.stack.response(TraceDirection::ToFilm, before, after.into(), cos, nm).unpolarised_transmittance()
                    } else {
                        self.stack.response(TraceDirection::ToObject, after, before.into(), cos, nm).unpolarised_transmittance()
                    } as f32);
                }
            }
            values.into()
        })
    }

    /// A value of [`LightTable::values`] at a wavelength in nm and a cosine.
    #[inline(always)]
    pub fn at(values: &[f32], nm: f32, cos: f32) -> f32 {
        let x = ((nm - 380.0) * (1.0 / STEP_NM as f32)).clamp(0.0, (WAVELENGTHS - 1) as f32 - 1e-3);
        let y = (cos * (COSINES - 1) as f32).clamp(0.0, (COSINES - 1) as f32 - 1e-3);
        let (i, j) = (x as usize, y as usize);
        let (fx, fy) = (x - i as f32, y - j as f32);
        let at = i * COSINES + j;
        // A lost lane may bring anything: the index stays within.
        let Some(v) = values.get(at..at + COSINES + 2) else { return 0.0 };
        let low = v[0] + (v[1] - v[0]) * fy;
        let high = v[COSINES] + (v[COSINES + 1] - v[COSINES]) * fy;
        low + (high - low) * fx
    }
}

/// Films on aluminium, light from a medium of index `incident`.
pub(crate) fn on_aluminium(stack: &Stack, incident: f64, cos: f64, nm: f64) -> super::Response {
    stack.response(TraceDirection::ToFilm, incident, super::material::aluminium(nm), cos, nm)
}
