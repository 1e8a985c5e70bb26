//! The lamps of a scene as it is posed: where they are at a moment, how they are sampled, how they shine with time; which surfaces are lamps.

use super::{Description, Scene, Shape};
use crate::light::AreaLight;
use crate::light::area::AreaShape;
use crate::light::environment::LinearlyPolarized;
use crate::light::segment::Pivot;
use crate::light::tree::LightBounds;
use crate::light::{LightPoint, LightRef, LightSample, Modulation};
use crate::material::{Coverage, Emission, EmissionColor, Material};
use crate::motion::Motion;
use crate::shape::{Mesh, Quad, Surface};
use diopter_light::{SampledSpectrum, SampledWavelengths};
use glam::{Affine3A, Vec2, Vec3};
use std::borrow::Cow;

impl Scene {
    /// What the choice among lights knows of one that moves.
    pub(super) fn swept_light(&self, light: &AreaLight, motion: LightMotion) -> Option<LightBounds> {
        let (LightMotion::Carried { object } | LightMotion::Bending { object, .. }) = motion else { return None };
        let instance = self.posed.animated.instance(object)?;
        Some(self.moved_light(light, motion, 0.0).bounds().anywhere_in(self.posed.animated.swept(instance)))
    }

    /// An area light where it is at a fraction of the exposure.
    pub(super) fn moved_light(&self, light: &AreaLight, motion: LightMotion, fraction: f32) -> AreaLight {
        match motion {
            LightMotion::Still => light.clone(),
            LightMotion::Carried { object } => match self.posed.animated.instance(object) {
                Some(instance) => light.placed(&self.posed.animated.place(instance, fraction)),
                None => light.clone(),
            },
            LightMotion::Bending { object, triangle, flipped } => {
                let (Some(instance), Shape::Mesh { mesh, .. }) =
                    (self.posed.animated.instance(object), self.description.objects[object as usize].shape)
                else {
                    return light.clone();
                };
                let mesh = &self.description.meshes[mesh as usize];
                let [a, mut b, mut c] = self.posed.animated.corners(instance, mesh, triangle as usize, fraction);
                if flipped {
                    (b, c) = (c, b);
                }
                let shape = AreaShape::Triangle(Quad { corner: a, edges: [b - a, c - a] });
                AreaLight::new(shape, light.material, light.uv, light.two_sided, light.luminance).with_alpha(light.alpha)
            }
        }
    }

    /// Samples a light from a point at a time of the exposure.
    #[inline]
    pub(crate) fn sample_li(&self, light: LightRef, p: Vec3, u: [f32; 2], time_s: f32) -> Option<LightSample> {
        match light {
            LightRef::Area(i) => match self.built.light_motions.get(i as usize) {
                None | Some(LightMotion::Still) => self.posed.lights.sample_li(light, p, u),
                Some(motion) => self
                    .moved_light(&self.posed.lights.area[i as usize], *motion, self.posed.animated.fraction(time_s))
                    .sample_li(p, u, i),
            },
            LightRef::Punctual(i) => match self.posed.animated.lights.get(i as usize) {
                Some(Some(track)) => self.posed.lights.punctual[i as usize].sample_li_placed(
                    &track.at(self.posed.animated.fraction(time_s)),
                    p,
                    u,
                    i,
                ),
                _ => self.posed.lights.sample_li(light, p, u),
            },
            LightRef::Environment => self.posed.lights.sample_li(light, p, u),
        }
    }

    /// What equi-angular sampling needs to know of a light at a time of the exposure; `None` at infinity.
    #[inline]
    pub(crate) fn pivot(&self, light: LightRef, time_s: f32) -> Option<Pivot> {
        match light {
            LightRef::Area(i) => match self.built.light_motions.get(i as usize) {
                None | Some(LightMotion::Still) => self.posed.lights.pivot(light),
                Some(motion) => Some(
                    self.moved_light(&self.posed.lights.area[i as usize], *motion, self.posed.animated.fraction(time_s)).pivot(),
                ),
            },
            LightRef::Punctual(i) => match self.posed.animated.lights.get(i as usize) {
                Some(Some(track)) => {
                    self.posed.lights.punctual[i as usize].kind.placed(&track.at(self.posed.animated.fraction(time_s))).pivot()
                }
                _ => self.posed.lights.pivot(light),
            },
            LightRef::Environment => None,
        }
    }

    /// Light that arrives along a light sample at a time of the exposure.
    #[inline]
    pub(crate) fn incident_radiance(
        &self,
        light_sample: &LightSample,
        wavelengths: &SampledWavelengths,
        time_s: f32,
    ) -> SampledSpectrum {
        let incident_radiance = self.steady_radiance(light_sample, wavelengths, time_s);
        if !self.flickers {
            return incident_radiance;
        }
        let modulation = match light_sample.spot {
            LightPoint::Area(i, _) => {
                self.description.materials[self.posed.lights.area[i as usize].material as usize].modulation()
            }
            LightPoint::Punctual(i) => self.posed.lights.punctual[i as usize].modulation,
            LightPoint::Environment(_) => Modulation::Steady,
        };
        incident_radiance * modulation.at(self.posed.open_s, time_s)
    }

    /// How light along a light sample is polarised, if it is: that of the sky alone.
    pub(crate) fn polarization(&self, light_sample: &LightSample) -> Option<LinearlyPolarized> {
        match light_sample.spot {
            LightPoint::Environment(_) => self.posed.lights.environment.as_ref()?.polarization(light_sample.wi),
            LightPoint::Area(..) | LightPoint::Punctual(_) => None,
        }
    }

    /// The same of a lamp whose light does not change with time.
    #[inline]
    pub(crate) fn steady_radiance(
        &self,
        light_sample: &LightSample,
        wavelengths: &SampledWavelengths,
        time_s: f32,
    ) -> SampledSpectrum {
        match light_sample.spot {
            LightPoint::Punctual(i) => match self.posed.animated.lights.get(i as usize) {
                Some(Some(track)) => {
                    let place = track.at(self.posed.animated.fraction(time_s));
                    self.posed.lights.punctual[i as usize].incident_radiance_placed(&place, light_sample, wavelengths)
                }
                _ => self.posed.lights.incident_radiance(light_sample, &self.description.materials, wavelengths),
            },
            _ => self.posed.lights.incident_radiance(light_sample, &self.description.materials, wavelengths),
        }
    }

    /// An area light where it is at a time of the exposure.
    pub(crate) fn area_light_at(&self, light: u32, time_s: f32) -> Cow<'_, AreaLight> {
        let motion = self.built.light_motions.get(light as usize).copied().unwrap_or(LightMotion::Still);
        self.placed_light(&self.posed.lights.area[light as usize], motion, time_s)
    }

    /// The same of any emissive surface of the scene.
    #[inline]
    pub(crate) fn placed_light<'a>(&'a self, light: &'a AreaLight, motion: LightMotion, time_s: f32) -> Cow<'a, AreaLight> {
        match motion {
            LightMotion::Still => Cow::Borrowed(light),
            motion => Cow::Owned(self.moved_light(light, motion, self.posed.animated.fraction(time_s))),
        }
    }

    /// Where the space of a punctual light is at a time of the exposure; `None` of one that stands still.
    pub(crate) fn punctual_place(&self, light: u32, time_s: f32) -> Option<Affine3A> {
        let track = self.posed.animated.lights.get(light as usize)?.as_ref()?;
        Some(track.at(self.posed.animated.fraction(time_s)))
    }

    /// Numbers of the area lights of an object, one for each of its emissive triangles; those of merged triangles come several times.
    pub(crate) fn area_lights_of(&self, object: u32) -> impl Iterator<Item = u32> {
        let triangles = match self.description.objects[object as usize].shape {
            Shape::Mesh { mesh, .. } => self.description.meshes[mesh as usize].triangles.len(),
            _ => 1,
        };
        let first = self.built.placements[object as usize].first_light.map(|f| f as usize);
        let numbers = first.map_or(&[][..], |f| &self.built.light_of[f..f + triangles]);
        numbers.iter().copied().filter(|n| *n != NO_LIGHT)
    }

    /// Factor of a modulation at a time of the exposure.
    #[inline]
    pub(crate) fn modulated(&self, modulation: &Modulation, time_s: f32) -> f32 {
        modulation.at(self.posed.open_s, time_s)
    }

    /// Factor on what a material emits at a time of the exposure.
    #[inline]
    pub(crate) fn modulation(&self, material: &Material, time_s: f32) -> f32 {
        if self.flickers { material.modulation().at(self.posed.open_s, time_s) } else { 1.0 }
    }

    /// Whether there are flashes.
    pub(crate) fn has_flashes(&self) -> bool {
        !self.flashes.is_empty()
    }

    /// Whether a flash is burning at a time of the exposure.
    #[inline]
    pub(crate) fn flash_burns(&self, time_s: f32) -> bool {
        self.flashes.iter().any(|f| f.at(0.0, time_s) > 0.0)
    }

    /// Density (solid angle) with which [`Scene::sample_li`] would have sampled an area light along a ray that meets it.
    #[inline]
    pub(crate) fn pdf_li(&self, light: u32, p: Vec3, direction: Vec3, distance: f32, time_s: f32) -> f32 {
        let still = &self.posed.lights.area[light as usize];
        match self.built.light_motions.get(light as usize) {
            None | Some(LightMotion::Still) => still.pdf(p, direction, distance),
            Some(motion) => self.moved_light(still, *motion, self.posed.animated.fraction(time_s)).pdf(p, direction, distance),
        }
    }

    /// The number among [`crate::light::Lights::area`] of the area light that a surface point belongs to; `None` where it is of none.
    #[inline]
    pub fn light_at(&self, surface: &Surface) -> Option<u32> {
        let first = self.built.placements[surface.object as usize].first_light?;
        let light = self.built.light_of[first as usize + surface.triangle as usize];
        (light != NO_LIGHT).then_some(light)
    }
}

/// How an area light moves.
#[derive(Clone, Copy, Debug)]
pub(crate) enum LightMotion {
    Still,
    /// With its object; it is kept in the object's space.
    Carried {
        object: u32,
    },
    /// It is a triangle of a mesh that bends, its corners in that order or not.
    Bending {
        object: u32,
        triangle: u32,
        flipped: bool,
    },
}

const NO_LIGHT: u32 = u32::MAX;

/// Emissive surfaces.
#[derive(Debug)]
pub(crate) struct AreaLights {
    pub lights: Vec<AreaLight>,
    pub motions: Vec<LightMotion>,
    /// Light of each triangle.
    pub light_of: Vec<u32>,
    /// Where each object's triangles begin in `light_of`.
    pub first: Vec<Option<u32>>,
}

impl AreaLights {
    /// The light that a surface point belongs to.
    #[inline]
    pub fn at(&self, surface: &Surface) -> Option<u32> {
        let first = self.first[surface.object as usize]?;
        let light = self.light_of[first as usize + surface.triangle as usize];
        (light != NO_LIGHT).then_some(light)
    }
}

/// The emissive surfaces whose emission is counted.
pub(crate) fn area_lights(d: &Description, counted: impl Fn(&Emission) -> bool) -> AreaLights {
    let (mut lights, mut light_of, mut motions) = (Vec::new(), Vec::new(), Vec::new());
    // Constant emissions are integrated once a material.
    let constant: Vec<Option<f32>> = d
        .materials
        .iter()
        .map(|m| match &m.emission {
            Some(e @ Emission { radiance: EmissionColor::Constant(_), .. }) => Some(e.luminance(&[Vec2::ZERO; 2])),
            _ => None,
        })
        .collect();
    let first = d
        .objects
        .iter()
        .enumerate()
        .map(|(number, object)| {
            let object_number = number as u32;
            let material = &d.materials[object.material as usize];
            let is_sampled = |e: &&Emission| counted(e) && !matches!(e.radiance, EmissionColor::Captured { .. });
            let emission = material.emission.as_ref().filter(is_sampled)?;
            let luminance = |uv: &[[Vec2; 3]; 2]| {
                constant[object.material as usize].unwrap_or_else(|| {
                    // Corners, edge middles and centre of the triangle.
                    let places = [
                        (1., 0., 0.),
                        (0., 1., 0.),
                        (0., 0., 1.),
                        (0.5, 0.5, 0.),
                        (0., 0.5, 0.5),
                        (0.5, 0., 0.5),
                        (1. / 3., 1. / 3., 1. / 3.),
                    ];
                    let at = |(a, b, c): (f32, f32, f32)| emission.luminance(&uv.map(|u| u[0] * a + u[1] * b + u[2] * c));
                    places.map(at).iter().sum::<f32>() / places.len() as f32
                })
            };
            let start = light_of.len() as u32;
            let mut push = |shape, uv: [[Vec2; 3]; 2], alpha: [f32; 3], motion: LightMotion| {
                let luminance = luminance(&uv);
                // A textured lamp may be dark at the seven places looked at: keep it, with little weight.
                if luminance == 0.0 && constant[object.material as usize].is_some() {
                    return NO_LIGHT;
                }
                let light = AreaLight::new(shape, object.material, uv, emission.two_sided, luminance.max(1e-6));
                lights.push(light.with_alpha(alpha));
                motions.push(motion);
                lights.len() as u32 - 1
            };
            match object.shape {
                // What shines there is met by chance.
                Shape::Curves { .. } | Shape::Splats { .. } => return None,
                Shape::Sphere(s) => light_of.push(push(AreaShape::Sphere(s), Default::default(), [1.0; 3], LightMotion::Still)),
                Shape::Quad(q) => {
                    let corners = [Vec2::ZERO, Vec2::X, Vec2::Y];
                    light_of.push(push(AreaShape::Parallelogram(q), [corners; 2], [1.0; 3], LightMotion::Still));
                }
                Shape::Mesh { mesh, world_from_mesh } => {
                    let mesh = &d.meshes[mesh as usize];
                    let (world_from_mesh, motion) = match object.motion {
                        Motion::Still => (world_from_mesh, LightMotion::Still),
                        Motion::Carried { .. } => (Affine3A::IDENTITY, LightMotion::Carried { object: object_number }),
                        Motion::Deformed { .. } => {
                            (Affine3A::IDENTITY, LightMotion::Bending { object: object_number, triangle: 0, flipped: false })
                        }
                    };
                    let bends = matches!(motion, LightMotion::Bending { .. });
                    let mirrored = world_from_mesh.matrix3.determinant() < 0.0;
                    let world = |t: usize| mesh.corners(t).map(|c| world_from_mesh.transform_point3(c));
                    let mut t = 0;
                    while t < mesh.triangles.len() {
                        let whole = constant[object.material as usize].is_some() && matches!(material.coverage, Coverage::Full);
                        let merged = whole && !bends && t + 1 < mesh.triangles.len();
                        if let Some(quad) = merged.then(|| parallelogram(world(t), world(t + 1))).flatten() {
                            let quad = if outside_differs(mesh, t, mirrored) { flipped(quad) } else { quad };
                            let light = push(AreaShape::Parallelogram(quad), Default::default(), [1.0; 3], motion);
                            light_of.extend([light, light]);
                            t += 2;
                            continue;
                        }
                        let [a, b, c] = world(t);
                        let uv = [0, 1].map(|s| match mesh.uvs[s].is_empty() {
                            true => [Vec2::ZERO; 3],
                            false => mesh.triangles[t].map(|i| mesh.uvs[s][i as usize]),
                        });
                        let alpha = match mesh.colors.is_empty() {
                            true => [1.0; 3],
                            false => mesh.triangles[t].map(|i| mesh.colors[i as usize].w),
                        };
                        let flipped = outside_differs(mesh, t, mirrored);
                        let (b, c, uv, alpha) = match flipped {
                            true => (c, b, uv.map(|[x, y, z]| [x, z, y]), [alpha[0], alpha[2], alpha[1]]),
                            false => (b, c, uv, alpha),
                        };
                        let motion = match motion {
                            LightMotion::Bending { object, .. } => LightMotion::Bending { object, triangle: t as u32, flipped },
                            motion => motion,
                        };
                        light_of.push(push(AreaShape::Triangle(Quad { corner: a, edges: [b - a, c - a] }), uv, alpha, motion));
                        t += 1;
                    }
                }
            }
            Some(start)
        })
        .collect();
    AreaLights { lights, motions, light_of, first }
}

/// Whether the side of a mesh triangle that counts as outside is not the one its corners, placed, run counter-clockwise on.
fn outside_differs(mesh: &Mesh, triangle: usize, mirrored: bool) -> bool {
    let [a, b, c] = mesh.corners(triangle);
    let n = mesh.mix(&mesh.normals, triangle, [1.0 / 3.0; 3]);
    let against = n.is_some_and(|n| n.dot((b - a).cross(c - a)) < 0.0);
    against != mirrored
}

fn flipped(q: Quad) -> Quad {
    Quad { corner: q.corner, edges: [q.edges[1], q.edges[0]] }
}

/// The parallelogram that two triangles make, if they do: they share an edge, and the fourth corner completes it.
fn parallelogram(t0: [Vec3; 3], t1: [Vec3; 3]) -> Option<Quad> {
    for i in 0..3 {
        // The corner of the first triangle that is not shared; the others are its neighbours.
        let (corner, p, q) = (t0[i], t0[(i + 1) % 3], t0[(i + 2) % 3]);
        let Some(opposite) = t1.iter().find(|c| **c != p && **c != q) else { continue };
        if !(t1.contains(&p) && t1.contains(&q)) {
            continue;
        }
        let expected = p + q - corner;
        let size = (p - q).length();
        if (*opposite - expected).length() > 1e-5 * size {
            continue;
        }
        // Both must wind the same way.
        let n1 = (t1[1] - t1[0]).cross(t1[2] - t1[0]);
        if (p - corner).cross(q - corner).dot(n1) > 0.0 {
            return Some(Quad { corner, edges: [p - corner, q - corner] });
        }
    }
    None
}
