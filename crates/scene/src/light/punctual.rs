//! Lights without extent (glTF's KHR_lights_punctual), and discs at infinity such as the sun.

use super::{LightPoint, LightSample, Modulation, photometry::Web, segment::Pivot, tree::LightBounds};
use crate::bvh::Bounds;
use diopter_image::Raster;
use diopter_light::color::SRGB_LUMINANCE;
use diopter_light::upsample::Sigmoid;
use diopter_light::{SampledSpectrum, SampledWavelengths, Spectrum, sampling};
use glam::{Affine3A, Mat3, Vec3};
use std::f32::consts::{PI, TAU};
use std::sync::Arc;

/// A light in a point or at infinity.
#[derive(Clone, Debug)]
pub struct Punctual {
    /// Name in its file.
    pub name: String,
    /// Spectral intensity (W·sr⁻¹·nm⁻¹) of a point or spot, spectral irradiance (W·m⁻²·nm⁻¹) of a directional light.
    pub power: Spectrum,
    /// Where and which way: in the world, or in the space of the node that carries it.
    pub kind: PunctualKind,
    /// Number of the node that carries it.
    pub carrier: Option<u32>,
    /// How it changes with time.
    pub modulation: Modulation,
    /// How its light differs by direction, beyond what its kind says.
    pub pattern: Option<Arc<Pattern>>,
}

/// A picture that a point light shines by.
#[derive(Clone, Debug)]
pub struct Pattern {
    /// Linear sRGB; multiplies the light. Empty where the spread has numbers of its own.
    pub picture: Raster<f32>,
    /// The light's directions from the world's.
    pub light_from_world: Mat3,
    /// Where on the picture directions lie.
    pub spread: Spread,
}

/// How directions lie on the picture of a [`Pattern`].
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Spread {
    /// All directions on a square of equal areas (P. Clarberg 2008).
    Sphere,
    /// Those ahead (+z) as a projector throws them: tangents of half the angles, to the right and up.
    Frame([f32; 2]),
    /// Measured intensities, over their peak; aimed along −z.
    Web(Arc<Web>),
}

impl Pattern {
    /// Measured intensities of a lamp that is aimed along −z of a space; `light_from_world` turns directions into it.
    pub fn measured(web: Web, light_from_world: Mat3) -> Self {
        Pattern { picture: Raster::new(0, 0, 3), light_from_world, spread: Spread::Web(Arc::new(web)) }
    }

    /// Factor on light that goes in a direction of the world.
    fn at(&self, direction: Vec3) -> Vec3 {
        let d = self.light_from_world * direction;
        let [u, v] = match &self.spread {
            Spread::Sphere => square_of(d),
            Spread::Web(web) => return Vec3::splat(web.candela(d) / web.peak()),
            Spread::Frame([x, y]) => {
                if d.z <= 1e-6 {
                    return Vec3::ZERO;
                }
                [0.5 + 0.5 * d.x / (d.z * x), 0.5 - 0.5 * d.y / (d.z * y)]
            }
        };
        if !((0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v)) {
            return Vec3::ZERO;
        }
        let place = |t: f32, n: usize| ((t * n as f32) as usize).min(n - 1);
        Vec3::from_slice(self.picture.pixel(place(u, self.picture.width), place(v, self.picture.height)))
    }

    /// Mean luminance of the picture: of a light of 1 cd for each 1 in it. Of measured intensities, their mean over the peak.
    pub fn mean(&self) -> f32 {
        if let Spread::Web(web) = &self.spread {
            return (web.lumens() / (4.0 * std::f64::consts::PI * f64::from(web.peak()))) as f32;
        }
        let all = self.picture.data.as_chunks::<3>().0;
        let y = |p: &[f32; 3]| f64::from(Vec3::from_array(*p).dot(SRGB_LUMINANCE));
        (all.iter().map(y).sum::<f64>() / all.len().max(1) as f64) as f32
    }
}

/// The place of a direction on a square, areas kept: the middle is +z, the corners −z. Source: P. Clarberg 2008, "Fast equal-area mapping of the
/// (hemi)sphere using SIMD".
pub(crate) fn square_of(d: Vec3) -> [f32; 2] {
    let d = d.normalize_or_zero();
    let r = (1.0 - d.z.abs()).max(0.0).sqrt();
    let phi = d.y.abs().atan2(d.x.abs()) * std::f32::consts::FRAC_2_PI;
    let v = r * phi;
    let u = r - v;
    let (u, v) = if d.z < 0.0 { (1.0 - v, 1.0 - u) } else { (u, v) };
    [0.5 * (u.copysign(d.x) + 1.0), 0.5 * (v.copysign(d.y) + 1.0)]
}

/// How the light of a spot falls off from its inner to its outer cone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum SpotEdge {
    /// As the square of a ramp in the cosine (KHR_lights_punctual).
    Squared,
    /// Smoothly on both sides, 3t² − 2t³ of the cosine (pbrt).
    Smooth,
    /// Linearly in the angle (Mitsuba).
    LinearInAngle,
}

/// Geometry of a punctual light.
#[derive(Clone, Copy, Debug)]
pub enum PunctualKind {
    /// The same in all directions.
    Point {
        /// Where, m.
        position: Vec3,
    },
    /// A cone with a soft edge.
    Spot {
        /// Where, m.
        position: Vec3,
        /// Unit direction the light goes.
        direction: Vec3,
        /// Cosine of the half angle of full intensity.
        cos_inner: f32,
        /// Cosine of the half angle beyond which there is none.
        cos_outer: f32,
        /// How it falls off between the two.
        edge: SpotEdge,
    },
    /// Parallel light.
    Directional {
        /// Unit direction the light goes.
        direction: Vec3,
    },
    /// A disc at infinity, evenly bright.
    Disc {
        /// Unit direction the light of its middle goes.
        direction: Vec3,
        /// Half of the angle under which it is seen, rad.
        half_angle: f32,
    },
}

impl PunctualKind {
    /// The geometry when its space is placed in the world.
    pub(crate) fn placed(self, place: &Affine3A) -> PunctualKind {
        let turned = |d: Vec3| place.transform_vector3(d).try_normalize().unwrap_or(d);
        match self {
            PunctualKind::Point { position } => PunctualKind::Point { position: place.transform_point3(position) },
            PunctualKind::Spot { position, direction, cos_inner, cos_outer, edge } => PunctualKind::Spot {
                position: place.transform_point3(position),
                direction: turned(direction),
                cos_inner,
                cos_outer,
                edge,
            },
            PunctualKind::Directional { direction } => PunctualKind::Directional { direction: turned(direction) },
            PunctualKind::Disc { direction, half_angle } => PunctualKind::Disc { direction: turned(direction), half_angle },
        }
    }

    /// What equi-angular sampling needs to know; `None` at infinity.
    pub(crate) fn pivot(self) -> Option<Pivot> {
        match self {
            PunctualKind::Point { position } => Some(Pivot::point(position)),
            PunctualKind::Spot { position, direction, cos_outer, .. } => {
                Some(Pivot { cone: Some((direction, cos_outer)), ..Pivot::point(position) })
            }
            PunctualKind::Directional { .. } | PunctualKind::Disc { .. } => None,
        }
    }

    /// Intensity of a spot in a direction over that of its middle; 1 of other lights.
    fn spot_falloff(self, light_direction: Vec3) -> f32 {
        let PunctualKind::Spot { direction, cos_inner, cos_outer, edge, .. } = self else { return 1.0 };
        // KHR_lights_punctual, "Inner and Outer Cone Angles": squared linear ramp in the cosine.
        let cos = direction.dot(light_direction);
        let ramp = ((cos - cos_outer) / (cos_inner - cos_outer).max(1e-4)).clamp(0.0, 1.0);
        match edge {
            SpotEdge::Squared => ramp * ramp,
            SpotEdge::Smooth => ramp * ramp * (3.0 - 2.0 * ramp),
            SpotEdge::LinearInAngle => {
                let (outer, inner) = (cos_outer.acos(), cos_inner.acos());
                ((outer - cos.clamp(-1.0, 1.0).acos()) / (outer - inner).max(1e-4)).clamp(0.0, 1.0)
            }
        }
    }

    fn sample_li(self, p: Vec3, u: [f32; 2], number: u32) -> Option<LightSample> {
        let (wi, distance) = match self {
            PunctualKind::Disc { direction, half_angle } => {
                let wi = within_disc(-direction, half_angle, u);
                let (distance, pdf) = (f32::INFINITY, disc_density(half_angle));
                return Some(LightSample {
                    wi,
                    distance,
                    pdf,
                    has_extent: true,
                    spot: LightPoint::Punctual(number),
                    clearance: 0.0,
                });
            }
            PunctualKind::Directional { direction } => (-direction, f32::INFINITY),
            PunctualKind::Point { position } | PunctualKind::Spot { position, .. } => {
                let to = position - p;
                let distance = to.length();
                if !(distance > 0.0) {
                    return None;
                }
                (to / distance, distance)
            }
        };
        let clearance = if distance.is_finite() { super::clearance(p, p + wi * distance, distance, 1.0) } else { 0.0 };
        Some(LightSample { wi, distance, pdf: 1.0, has_extent: false, spot: LightPoint::Punctual(number), clearance })
    }
}

impl Punctual {
    /// A steady light that stands still; `power` is intensity (W·sr⁻¹·nm⁻¹) or, of lights at infinity, irradiance (W·m⁻²·nm⁻¹).
    pub fn new(name: &str, power: Spectrum, kind: PunctualKind) -> Self {
        Punctual { name: name.into(), power, kind, carrier: None, modulation: Modulation::Steady, pattern: None }
    }

    /// The light when its space is placed in the world.
    pub(crate) fn placed(&self, place: &Affine3A) -> Punctual {
        let pattern = self.pattern.as_ref().map(|p| {
            let m = Mat3::from(place.matrix3);
            Arc::new(Pattern { light_from_world: p.light_from_world * m.inverse(), ..(**p).clone() })
        });
        Punctual { kind: self.kind.placed(place), pattern, ..self.clone() }
    }

    /// Whether it is infinitely far away.
    pub fn is_infinite(&self) -> bool {
        self.bounds().is_none()
    }

    /// Its mirror image, z → −z.
    pub(crate) fn mirrored(&self) -> Punctual {
        self.placed(&Affine3A::from_scale(Vec3::new(1.0, 1.0, -1.0)))
    }

    /// Luminous intensity (cd) or, of lights at infinity, illuminance on a plane that faces them (lx); without its pattern and its modulation.
    pub fn illuminance(&self) -> f32 {
        diopter_light::color::luminance(|nm| self.power.at(nm)) as f32
    }

    pub(crate) fn bounds(&self) -> Option<LightBounds> {
        let candela = self.illuminance() * self.pattern.as_ref().map_or(1.0, |p| p.mean());
        match self.kind {
            PunctualKind::Point { position } => {
                let here = Bounds { min: position, max: position };
                Some(LightBounds::new(here, Vec3::Z, PI, PI / 2.0, false, 4.0 * PI * candela))
            }
            PunctualKind::Spot { position, direction, cos_outer, .. } => {
                // 4π I, not the cone's own power: within the cone the light is as strong as a point's (PBR 12.6.3).
                let here = Bounds { min: position, max: position };
                Some(LightBounds::new(here, direction, 0.0, cos_outer.acos(), false, 4.0 * PI * candela))
            }
            PunctualKind::Directional { .. } | PunctualKind::Disc { .. } => None,
        }
    }

    pub(crate) fn sample_li(&self, p: Vec3, u: [f32; 2], number: u32) -> Option<LightSample> {
        self.kind.sample_li(p, u, number)
    }

    /// What [`Punctual::sample_li`] of the light would be where its space is placed in the world.
    pub(crate) fn sample_li_placed(&self, place: &Affine3A, p: Vec3, u: [f32; 2], number: u32) -> Option<LightSample> {
        self.kind.placed(place).sample_li(p, u, number)
    }

    /// Radiance of a disc seen in a direction, and the density of [`Punctual::sample_li`] for that; `None` beside it, or for other lights.
    pub(crate) fn disc(&self, direction: Vec3, wavelengths: &SampledWavelengths) -> Option<(SampledSpectrum, f32)> {
        match self.kind {
            PunctualKind::Disc { direction: d, half_angle } if half_sine2(direction, -d) <= (0.5 * half_angle).sin().powi(2) => {
                Some((self.power.sample_light(wavelengths) / disc_sr(half_angle), disc_density(half_angle)))
            }
            _ => None,
        }
    }

    /// Irradiance on a plane facing the light; of a disc, its radiance.
    pub(crate) fn incident_radiance(&self, light_sample: &LightSample, wavelengths: &SampledWavelengths) -> SampledSpectrum {
        self.incident_radiance_from(self.kind, -light_sample.wi, light_sample, wavelengths)
    }

    /// What [`Punctual::incident_radiance`] of the light would be where its space is placed in the world. Nothing is copied: the picture of a
    /// light can be large.
    pub(crate) fn incident_radiance_placed(
        &self,
        place: &Affine3A,
        light_sample: &LightSample,
        wavelengths: &SampledWavelengths,
    ) -> SampledSpectrum {
        let own = match self.pattern {
            Some(_) => Mat3::from(place.matrix3).inverse() * -light_sample.wi,
            None => -light_sample.wi,
        };
        self.incident_radiance_from(self.kind.placed(place), own, light_sample, wavelengths)
    }

    /// Light of a kind in the world; `own`: its direction in the space in which the light's picture stands.
    fn incident_radiance_from(
        &self,
        kind: PunctualKind,
        own: Vec3,
        light_sample: &LightSample,
        wavelengths: &SampledWavelengths,
    ) -> SampledSpectrum {
        let power = self.power.sample_light(wavelengths);
        match kind {
            PunctualKind::Directional { .. } => power,
            PunctualKind::Disc { half_angle, .. } => power / disc_sr(half_angle),
            PunctualKind::Point { .. } => {
                let power = match &self.pattern {
                    Some(pattern) => power * tint(pattern.at(own), wavelengths),
                    None => power,
                };
                power / (light_sample.distance * light_sample.distance)
            }
            PunctualKind::Spot { .. } => {
                power * (kind.spot_falloff(-light_sample.wi) / (light_sample.distance * light_sample.distance))
            }
        }
    }

    /// Intensity of a point or spot in a direction of the world over its power, its space placed in the world or not; 1 of other lights.
    pub(crate) fn relative_intensity(
        &self,
        place: Option<&Affine3A>,
        direction: Vec3,
        wavelengths: &SampledWavelengths,
    ) -> SampledSpectrum {
        let kind = place.map_or(self.kind, |p| self.kind.placed(p));
        match (kind, &self.pattern) {
            (PunctualKind::Point { .. }, Some(pattern)) => {
                let own = place.map_or(direction, |p| Mat3::from(p.matrix3).inverse() * direction);
                tint(pattern.at(own), wavelengths)
            }
            _ => SampledSpectrum::splat(kind.spot_falloff(direction)),
        }
    }
}

/// A colour of any brightness as a factor on light.
fn tint(rgb: Vec3, wavelengths: &SampledWavelengths) -> SampledSpectrum {
    if wavelengths.is_rgb() {
        return SampledWavelengths::lanes(rgb);
    }
    let scale = 2.0 * rgb.max_element();
    if scale > 0.0 { Sigmoid::from_rgb(rgb / scale).sample(wavelengths) * scale } else { SampledSpectrum::ZERO }
}

/// Projected solid angle of a disc on a plane that faces it: what its radiance is to its irradiance.
pub(crate) fn disc_sr(half_angle: f32) -> f32 {
    PI * half_angle.sin().powi(2)
}

/// A direction within so wide a cone about another, evenly over the solid angle.
pub(crate) fn within_disc(axis: Vec3, half_angle: f32, u: [f32; 2]) -> Vec3 {
    let drop = u[0] * 2.0 * (0.5 * half_angle).sin().powi(2);
    let (sin, phi) = ((drop * (2.0 - drop)).sqrt(), TAU * u[1]);
    let (x, y) = sampling::frame(axis);
    (x * (sin * phi.cos()) + y * (sin * phi.sin()) + axis * (1.0 - drop)).normalize()
}

/// One over its solid angle.
pub(crate) fn disc_density(half_angle: f32) -> f32 {
    1.0 / (4.0 * PI * (0.5 * half_angle).sin().powi(2))
}

/// sin² of half the angle between two unit vectors: it keeps its digits where the cosine has none left.
fn half_sine2(a: Vec3, b: Vec3) -> f32 {
    0.25 * (a - b).length_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_that_is_carried_is_the_light_where_it_stands() {
        let place = Affine3A::from_scale_rotation_translation(
            Vec3::splat(0.7),
            glam::Quat::from_rotation_y(0.8) * glam::Quat::from_rotation_x(-0.3),
            Vec3::new(1.0, -2.0, 0.5),
        );
        let picture = Raster { width: 8, height: 8, channels: 3, data: (0..192).map(|i| 0.2 + i as f32 * 0.01).collect() };
        let (position, direction) = (Vec3::new(0.2, 0.1, -0.3), Vec3::NEG_Z);
        let kinds = [
            PunctualKind::Point { position },
            PunctualKind::Spot { position, direction, cos_inner: 0.9, cos_outer: -0.5, edge: SpotEdge::Smooth },
            PunctualKind::Directional { direction },
            PunctualKind::Disc { direction, half_angle: 0.1 },
        ];
        let wavelengths = SampledWavelengths::fixed([450.0, 520.0, 590.0, 660.0]);
        let mut seen = Vec::new();
        for kind in kinds {
            let mut light = Punctual::new("lamp", Spectrum::Constant(3.0), kind);
            light.pattern =
                Some(Arc::new(Pattern { picture: picture.clone(), light_from_world: Mat3::IDENTITY, spread: Spread::Sphere }));
            let whole = light.placed(&place);
            for p in [Vec3::ZERO, Vec3::new(3.0, 1.0, 2.0), Vec3::new(-1.0, -4.0, 0.0)] {
                let [a, b] =
                    [light.sample_li_placed(&place, p, [0.3, 0.6], 0), whole.sample_li(p, [0.3, 0.6], 0)].map(Option::unwrap);
                assert_eq!((a.wi, a.distance, a.pdf), (b.wi, b.distance, b.pdf), "{kind:?}");
                let [x, y] =
                    [light.incident_radiance_placed(&place, &a, &wavelengths), whole.incident_radiance(&b, &wavelengths)];
                for (x, y) in x.to_array().into_iter().zip(y.to_array()) {
                    assert!((x - y).abs() <= 1e-5 * y.abs(), "{kind:?}: {x} {y}");
                }
                if matches!(kind, PunctualKind::Point { .. }) {
                    seen.push(x.to_array()[0] * a.distance * a.distance);
                }
            }
        }
        assert!(seen.iter().any(|v| (v / seen[0] - 1.0).abs() > 0.01), "the picture differs by direction: {seen:?}");
    }
}
