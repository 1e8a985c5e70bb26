//! A scene: described as plain data, then built once and only read.

use crate::SceneError;
use crate::bvh::{Bounds, Bvh, Filter, Hit, Primitive, Primitives};
use crate::light::area::AreaShape;
use crate::light::segment::Pivot;
use crate::light::tree::LightBounds;
use crate::light::{Aim, LightRef, Modulation, Placed, Spot};
use crate::light::{AreaLight, Environment, Lights, Punctual};
use crate::material::{Coverage, Emission, EmissionColor, Material};
use crate::medium::Air;
use crate::motion::{Animation, Deformer, Local, Motion, Node, Playing, Timeline};
use crate::movers::Movers;
use crate::shape::{Mesh, Quad, Sphere, Surface};
use diopter_light::random::{mix, to_unit};
use diopter_light::{Ray, Sampled, Wavelengths};
use glam::{Affine3A, Mat3A, Vec2, Vec3, Vec3A, Vec4};
use std::borrow::Cow;

/// Everything a file or a program says about a scene.
#[derive(Clone, Debug, Default)]
pub struct Description {
    /// For messages and metadata.
    pub name: String,
    /// Meshes, each once.
    pub meshes: Vec<Mesh>,
    /// Materials, referred to by number.
    pub materials: Vec<Material>,
    /// Things in the world.
    pub objects: Vec<Object>,
    /// Lights without extent.
    pub punctual: Vec<Punctual>,
    /// Light from all around.
    pub environment: Option<Environment>,
    /// What fills the world around the bodies, if it absorbs or scatters.
    pub air: Option<Air>,
    /// Points of view the file names.
    pub cameras: Vec<Viewpoint>,
    /// What moving things hang on.
    pub nodes: Vec<Node>,
    /// How nodes move.
    pub animations: Vec<Animation>,
    /// Which of the animations run.
    pub playing: Playing,
    /// Meshes that bend.
    pub deformers: Vec<Deformer>,
    /// Other sets of materials that the file offers.
    pub variants: Vec<Variant>,
    /// How many times its file wants light to be scattered at most.
    pub max_depth: Option<u32>,
    /// What was found odd on the way.
    pub warnings: Vec<String>,
    /// Pictures that its file names and that could not be read.
    pub missing_textures: Vec<MissingTexture>,
}

/// A picture that a scene's file names and that could not be read. Where it would give a colour, [`crate::load::STAND_IN`] is shown; a map of
/// numbers (normals, roughness, coverage) is left out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MissingTexture {
    /// Its name in the file.
    pub name: String,
    /// Why it could not be read.
    pub reason: String,
}

impl Description {
    /// Where its nodes are at any moment.
    pub fn timeline(&self) -> Timeline<'_> {
        Timeline::new(&self.nodes, &self.animations, &self.playing)
    }

    /// Whether there is anything that light could meet.
    pub fn has_surface(&self) -> bool {
        self.objects.iter().any(|o| match o.shape {
            Shape::Mesh { mesh, .. } => self.meshes.get(mesh as usize).is_some_and(|m| !m.triangles.is_empty()),
            Shape::Sphere(_) | Shape::Quad(_) => true,
        })
    }

    /// Gives objects the materials of a variant; fails with what there is.
    pub fn choose_variant(&mut self, name: &str) -> Result<(), String> {
        let Some(variant) = self.variants.iter().find(|v| v.name == name) else {
            let names: Vec<&str> = self.variants.iter().map(|v| v.name.as_str()).collect();
            return Err(if names.is_empty() {
                "the scene has no variants".into()
            } else {
                format!("one of {}", names.join(", "))
            });
        };
        for (object, material) in &variant.materials {
            if let Some(object) = self.objects.get_mut(*object as usize) {
                object.material = *material;
            }
        }
        Ok(())
    }

    /// The box around the objects that are counted, at a moment, s; what hangs on free nodes is left out.
    pub fn bounds_at(&self, time_s: f64, counted: impl Fn(&Object) -> bool) -> Bounds {
        let timeline = self.timeline();
        let placed = |mesh: u32, place: Affine3A| {
            let positions = self.meshes.get(mesh as usize).map_or(&[][..], |m| &m.positions);
            Bounds::around(positions.iter().map(|p| place.transform_point3(*p)).filter(|p| p.is_finite()))
        };
        let around = |o: &Object| match (o.shape, o.motion) {
            (Shape::Mesh { .. }, Motion::Carried { node }) if self.nodes[node as usize].free => Bounds::EMPTY,
            (Shape::Mesh { mesh, .. }, Motion::Carried { node }) => placed(mesh, timeline.world(node, time_s)),
            (Shape::Mesh { mesh, .. }, Motion::Deformed { deformer }) => {
                let pose = timeline.pose(&self.deformers[deformer as usize], &self.meshes[mesh as usize], time_s);
                Bounds::around(pose.positions)
            }
            (Shape::Mesh { mesh, world_from_mesh }, Motion::Still) => placed(mesh, world_from_mesh),
            (Shape::Sphere(s), _) => Bounds { min: s.center - s.radius, max: s.center + s.radius },
            (Shape::Quad(q), _) => Bounds::around([Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE].map(|p| q.point(p))),
        };
        self.objects.iter().filter(|o| counted(o)).fold(Bounds::EMPTY, |b, o| b.union(around(o)))
    }

    /// For each direction the point of the objects that are counted which lies farthest along it, at a moment, s: their support points, which say
    /// what a frame must hold. Empty where there is nothing; what hangs on free nodes is left out.
    pub fn support_points(&self, time_s: f64, directions: &[Vec3], counted: impl Fn(&Object) -> bool) -> Vec<Vec3> {
        let timeline = self.timeline();
        let mut farthest = vec![None; directions.len()];
        for o in self.objects.iter().filter(|o| counted(o)) {
            match (o.shape, o.motion) {
                (Shape::Mesh { .. }, Motion::Carried { node }) if self.nodes[node as usize].free => {}
                (Shape::Mesh { mesh, .. }, Motion::Deformed { deformer }) => {
                    let pose = timeline.pose(&self.deformers[deformer as usize], &self.meshes[mesh as usize], time_s);
                    offer(&mut farthest, directions, pose.positions.into_iter());
                }
                (Shape::Mesh { mesh, world_from_mesh }, motion) => {
                    let place = match motion {
                        Motion::Carried { node } => timeline.world(node, time_s),
                        _ => world_from_mesh,
                    };
                    let positions = self.meshes.get(mesh as usize).map_or(&[][..], |m| &m.positions);
                    offer(&mut farthest, directions, positions.iter().map(|p| place.transform_point3(*p)));
                }
                (Shape::Sphere(s), _) => {
                    offer(&mut farthest, directions, directions.iter().map(|d| s.center + d.normalize_or_zero() * s.radius));
                }
                (Shape::Quad(q), _) => {
                    offer(&mut farthest, directions, [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE].into_iter().map(|p| q.point(p)))
                }
            }
        }
        farthest.into_iter().flatten().map(|(_, p)| p).collect()
    }
}

/// Keeps of points the farthest along each direction.
fn offer(farthest: &mut [Option<(f32, Vec3)>], directions: &[Vec3], points: impl Iterator<Item = Vec3>) {
    for p in points.filter(|p| p.is_finite()) {
        for (best, direction) in farthest.iter_mut().zip(directions) {
            let along = p.dot(*direction);
            if best.is_none_or(|(most, _)| along > most) {
                *best = Some((along, p));
            }
        }
    }
}

/// A set of materials that a file offers.
#[derive(Clone, Debug, Default)]
pub struct Variant {
    /// Its name.
    pub name: String,
    /// Numbers of objects and of the materials they then have.
    pub materials: Vec<(u32, u32)>,
}

/// A thing in the world.
#[derive(Clone, Debug)]
pub struct Object {
    /// Name in its file.
    pub name: String,
    /// Its form.
    pub shape: Shape,
    /// Number of its material.
    pub material: u32,
    /// Whether and how it moves.
    pub motion: Motion,
}

impl Object {
    /// A thing that stands still.
    pub fn new(name: impl Into<String>, shape: Shape, material: u32) -> Self {
        Object { name: name.into(), shape, material, motion: Motion::Still }
    }
}

/// The form of a thing.
#[derive(Clone, Copy, Debug)]
pub enum Shape {
    /// A mesh by number, placed.
    Mesh {
        /// Number of the mesh.
        mesh: u32,
        /// Where it stands; what moves says otherwise.
        world_from_mesh: Affine3A,
    },
    /// A sphere in world space.
    Sphere(Sphere),
    /// A parallelogram in world space.
    Quad(Quad),
}

/// A camera of a file: where it is and how wide it sees.
#[derive(Clone, Debug)]
pub struct Viewpoint {
    /// Name in its file.
    pub name: String,
    /// Looks along −Z, +Y up.
    pub world_from_camera: Affine3A,
    /// How much of the world it sees.
    pub sight: Sight,
    /// Radius of the lens (0 of a pinhole) and distance of what is sharp, m, where the file says so.
    pub lens: Option<[f32; 2]>,
    /// What its file says of the film.
    pub film: FilmHints,
    /// The node it hangs on; `world_from_camera` is that node's place at rest, without its scale.
    pub node: Option<u32>,
}

/// How much of the world a camera sees.
#[derive(Clone, Debug, PartialEq)]
pub enum Sight {
    /// As through a small hole.
    Perspective {
        /// Vertical angle of view, rad.
        vertical_fov: f32,
    },
    /// Along parallel lines.
    Orthographic {
        /// Height of what is seen, m.
        height: f32,
    },
    /// All around.
    Panorama,
    /// Through a lens that a table describes, surface by surface.
    Table(LensTable),
}

/// A lens as a scene file has it.
#[derive(Clone, Debug, PartialEq)]
pub struct LensTable {
    /// Name of the file of surfaces, relative to the scene's: pbrt's `.dat`.
    pub file: String,
    /// What is in it.
    pub bytes: Vec<u8>,
    /// Diameter of the stop, mm.
    pub stop_mm: f64,
    /// What is sharp, m from the film.
    pub focus_m: f64,
}

impl Viewpoint {
    /// Vertical angle of view, rad, where it has one of its own.
    pub fn vertical_fov(&self) -> Option<f32> {
        match self.sight {
            Sight::Perspective { vertical_fov } => Some(vertical_fov),
            _ => None,
        }
    }
}

/// What a scene file says of its camera's film.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FilmHints {
    /// Columns and rows of the picture.
    pub size: Option<[usize; 2]>,
    /// Diagonal, mm.
    pub diagonal_mm: Option<f64>,
    /// Name of the sensor.
    pub sensor: Option<String>,
    /// ISO speed.
    pub iso: Option<f64>,
}

/// A scene ready to be photographed.
#[derive(Debug)]
pub struct Scene {
    description: Description,
    /// Everything: triangles of meshes used once (in world space), and others by object number.
    top: Bvh,
    /// Hierarchies of meshes used more than once, by mesh.
    shared: Vec<Option<Bvh>>,
    /// First triangle number in `top` of each object that is in it, rising, and the object.
    flat: Vec<(u32, u32)>,
    placements: Vec<Placement>,
    lights: Lights,
    /// Area light of each triangle of emissive objects; `first_light` of the object says where its own begin.
    light_of: Vec<u32>,
    /// How each area light moves; empty when none does.
    light_ways: Vec<LightWay>,
    /// What moves, over the exposure it was posed for.
    movers: Movers,
    /// When that exposure begins, s.
    open_s: f64,
    /// Whether light may go straight through a face: of media, of thin sheets.
    has_clear: bool,
    /// Whether a lamp's light changes with time.
    flickers: bool,
    /// When flashes burn.
    flashes: Vec<Modulation>,
}

/// How an area light moves.
#[derive(Clone, Copy, Debug)]
enum LightWay {
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

/// What is looked up for an object at each hit.
#[derive(Clone, Copy, Debug)]
struct Placement {
    world_from_object: Affine3A,
    object_from_world: Affine3A,
    /// Inverse transpose: normals.
    normals: Mat3A,
    /// Start in `light_of`, or none.
    first_light: Option<u32>,
    mirrored: bool,
}

const NO_LIGHT: u32 = u32::MAX;

impl Scene {
    /// Builds a scene. Fails when numbers do not fit: a material or mesh that is not there, nothing to see.
    pub fn build(mut description: Description) -> Result<Scene, SceneError> {
        check(&description)?;
        settle(&mut description);
        let had_surface = description.has_surface();
        clean(&mut description)?;
        if had_surface && !description.has_surface() {
            return Err(SceneError::File {
                place: description.name.clone(),
                found: "no surface: all its triangles are without area or not finite".into(),
                expected: "expected a triangle with an area".into(),
            });
        }
        crate::material::prepare(&mut description.materials);
        let d = &description;
        let mut uses = vec![0u32; d.meshes.len()];
        for object in &d.objects {
            if let Shape::Mesh { mesh, .. } = object.shape {
                // What is carried needs a hierarchy of its own, what bends makes one at each pose.
                uses[mesh as usize] += match object.motion {
                    Motion::Still => 1,
                    Motion::Carried { .. } => 2,
                    Motion::Deformed { .. } => 0,
                };
            }
        }

        // Meshes used once go into the top hierarchy as they stand; others get one of their own.
        let mut flat = Vec::new();
        let mut next = 0u32;
        for (i, object) in d.objects.iter().enumerate() {
            if let Shape::Mesh { mesh, .. } = object.shape
                && uses[mesh as usize] == 1
                && object.motion == Motion::Still
            {
                flat.push((next, i as u32));
                let count = d.meshes[mesh as usize].triangles.len();
                next = next.checked_add(count as u32).filter(|n| *n < 1 << 30).ok_or(SceneError::TooLarge(count))?;
            }
        }
        let shared: Vec<Option<Bvh>> = d
            .meshes
            .iter()
            .zip(&uses)
            .enumerate()
            .map(|(i, (mesh, uses))| {
                let filtered = d.objects.iter().any(|o| {
                    matches!(o.shape, Shape::Mesh { mesh, .. } if mesh as usize == i)
                        && !matches!(d.materials[o.material as usize].coverage, Coverage::Full)
                });
                (*uses > 1).then(|| Bvh::build(&MeshPrimitives { mesh, filtered }))
            })
            .collect();
        let placements: Vec<Placement> = d.objects.iter().map(Placement::new).collect();
        let others: Vec<(u32, Bounds)> = d
            .objects
            .iter()
            .enumerate()
            .filter(|(_, object)| object.motion == Motion::Still)
            .filter_map(|(i, object)| {
                let bounds = match object.shape {
                    Shape::Sphere(s) => Bounds { min: s.center - s.radius, max: s.center + s.radius },
                    Shape::Quad(q) => {
                        // A flat box would be missed by rounding: give it a little depth.
                        let b = Bounds::around([Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE].map(|p| q.point(p)));
                        let pad = 1e-5 * b.size().max_element().max(b.max.abs().max(b.min.abs()).max_element());
                        Bounds { min: b.min - pad, max: b.max + pad }
                    }
                    Shape::Mesh { mesh, .. } => shared[mesh as usize].as_ref()?.bounds().placed(&placements[i].world_from_object),
                };
                Some((i as u32, bounds))
            })
            .collect();
        let top = Bvh::build(&TopPrimitives { description: d, flat: &flat, triangles: next as usize, others: &others });

        let AreaLights { lights, ways, light_of, first } = area_lights(d);
        let light_ways = if ways.iter().all(|w| matches!(w, LightWay::Still)) { Vec::new() } else { ways };
        let placements = placements.into_iter().zip(first).map(|(p, first_light)| Placement { first_light, ..p }).collect();
        let mut all = Lights::default();
        (all.area, all.punctual, all.environment) = (lights, d.punctual.clone(), d.environment.clone());
        let (movers, open_s, flickers, flashes) = (Movers::default(), 0.0, false, Vec::new());
        let has_clear = d.objects.iter().any(|o| d.materials[o.material as usize].may_be_clear());
        let mut scene = Scene {
            top,
            shared,
            flat,
            placements,
            lights: all,
            light_of,
            light_ways,
            movers,
            open_s,
            has_clear,
            flickers,
            flashes,
            description,
        };
        scene.note_modulations();
        scene.arrange(0.0, 0.0);
        Ok(scene)
    }

    /// Makes what moves ready for an exposure that begins at `open_s` and takes `span_s` (both s). Times of rays count from its
    /// beginning. A scene is built posed for the moment 0.
    pub fn pose(&mut self, open_s: f64, span_s: f64) {
        self.open_s = open_s;
        let d = &self.description;
        if d.objects.iter().any(|o| o.motion != Motion::Still) || d.punctual.iter().any(|l| l.carrier.is_some()) {
            self.arrange(open_s, span_s);
        }
    }

    fn arrange(&mut self, open_s: f64, span_s: f64) {
        let d = &self.description;
        self.movers = Movers::new(d, &d.timeline(), &self.shared, open_s, span_s);
        let Lights { area, punctual, environment, .. } = std::mem::take(&mut self.lights);
        let flash = |i: usize| {
            let emission = d.materials[area[i].material as usize].emission.as_ref();
            emission.is_some_and(|e| e.modulation.is_pulse())
        };
        let placed_area: Vec<Placed> = (0..area.len())
            .map(|i| {
                let way = self.light_ways.get(i).copied().unwrap_or(LightWay::Still);
                Placed { bounds: self.swept_light(&area[i], way), flash: flash(i) }
            })
            .collect();
        let placed_punctual: Vec<Placed> = punctual
            .iter()
            .zip(&self.movers.lights)
            .map(|(light, way)| {
                let track = way.as_ref();
                let bounds = track.and_then(|t| {
                    let boxes = (0..=64).map(|k| Vec3::from(t.at(k as f32 / 64.0).translation));
                    light.bounds().map(|b| b.anywhere_in(Bounds::around(boxes)))
                });
                Placed { bounds, flash: light.modulation.is_pulse() }
            })
            .collect();
        self.lights = Lights::new(area, punctual, environment, &placed_area, &placed_punctual);
    }

    /// What the choice among lights knows of one that moves.
    fn swept_light(&self, light: &AreaLight, way: LightWay) -> Option<LightBounds> {
        let (LightWay::Carried { object } | LightWay::Bending { object, .. }) = way else { return None };
        let mover = self.movers.mover(object)?;
        Some(self.moved_light(light, way, 0.0).bounds().anywhere_in(self.movers.swept(mover)))
    }

    /// An area light where it is at a share of the exposure.
    fn moved_light(&self, light: &AreaLight, way: LightWay, share: f32) -> AreaLight {
        match way {
            LightWay::Still => light.clone(),
            LightWay::Carried { object } => match self.movers.mover(object) {
                Some(mover) => light.placed(&self.movers.place(mover, share)),
                None => light.clone(),
            },
            LightWay::Bending { object, triangle, flipped } => {
                let (Some(mover), Shape::Mesh { mesh, .. }) =
                    (self.movers.mover(object), self.description.objects[object as usize].shape)
                else {
                    return light.clone();
                };
                let mesh = &self.description.meshes[mesh as usize];
                let [a, mut b, mut c] = self.movers.corners(mover, mesh, triangle as usize, share);
                if flipped {
                    (b, c) = (c, b);
                }
                let shape = AreaShape::Triangle(Quad { corner: a, edges: [b - a, c - a] });
                AreaLight::new(shape, light.material, light.uv, light.two_sided, light.luminance).with_alpha(light.alpha)
            }
        }
    }

    /// Aims at a light from a point at a time of the exposure.
    #[inline]
    pub(crate) fn aim(&self, light: LightRef, p: Vec3, u: [f32; 2], time_s: f32) -> Option<Aim> {
        match light {
            LightRef::Area(i) => match self.light_ways.get(i as usize) {
                None | Some(LightWay::Still) => self.lights.aim(light, p, u),
                Some(way) => self.moved_light(&self.lights.area[i as usize], *way, self.movers.share(time_s)).aim(p, u, i),
            },
            LightRef::Punctual(i) => match self.movers.lights.get(i as usize) {
                Some(Some(track)) => self.lights.punctual[i as usize].aim_placed(&track.at(self.movers.share(time_s)), p, u, i),
                _ => self.lights.aim(light, p, u),
            },
            LightRef::Environment => self.lights.aim(light, p, u),
        }
    }

    /// What equi-angular sampling needs to know of a light at a time of the exposure; `None` at infinity.
    #[inline]
    pub(crate) fn pivot(&self, light: LightRef, time_s: f32) -> Option<Pivot> {
        match light {
            LightRef::Area(i) => match self.light_ways.get(i as usize) {
                None | Some(LightWay::Still) => self.lights.pivot(light),
                Some(way) => Some(self.moved_light(&self.lights.area[i as usize], *way, self.movers.share(time_s)).pivot()),
            },
            LightRef::Punctual(i) => match self.movers.lights.get(i as usize) {
                Some(Some(track)) => self.lights.punctual[i as usize].kind.placed(&track.at(self.movers.share(time_s))).pivot(),
                _ => self.lights.pivot(light),
            },
            LightRef::Environment => None,
        }
    }

    /// Light that arrives along an aim at a time of the exposure.
    #[inline]
    pub(crate) fn arriving(&self, aim: &Aim, wavelengths: &Wavelengths, time_s: f32) -> Sampled {
        let arriving = match aim.spot {
            Spot::Punctual(i) => match self.movers.lights.get(i as usize) {
                Some(Some(track)) => {
                    let place = track.at(self.movers.share(time_s));
                    self.lights.punctual[i as usize].arriving_placed(&place, aim, wavelengths)
                }
                _ => self.lights.arriving(aim, &self.description.materials, wavelengths),
            },
            _ => self.lights.arriving(aim, &self.description.materials, wavelengths),
        };
        if !self.flickers {
            return arriving;
        }
        let modulation = match aim.spot {
            Spot::Area(i, _) => self.description.materials[self.lights.area[i as usize].material as usize].modulation(),
            Spot::Punctual(i) => self.lights.punctual[i as usize].modulation,
            Spot::Environment(_) => Modulation::Steady,
        };
        arriving * modulation.at(self.open_s, time_s)
    }

    /// An area light where it is at a time of the exposure.
    pub(crate) fn area_light_at(&self, light: u32, time_s: f32) -> Cow<'_, AreaLight> {
        let still = &self.lights.area[light as usize];
        match self.light_ways.get(light as usize) {
            None | Some(LightWay::Still) => Cow::Borrowed(still),
            Some(way) => Cow::Owned(self.moved_light(still, *way, self.movers.share(time_s))),
        }
    }

    /// Where the space of a punctual light is at a time of the exposure; `None` of one that stands still.
    pub(crate) fn punctual_place(&self, light: u32, time_s: f32) -> Option<Affine3A> {
        let track = self.movers.lights.get(light as usize)?.as_ref()?;
        Some(track.at(self.movers.share(time_s)))
    }

    /// Numbers of the area lights of an object, one for each of its emissive triangles; those of merged triangles come several times.
    pub(crate) fn area_lights_of(&self, object: u32) -> impl Iterator<Item = u32> {
        let triangles = match self.description.objects[object as usize].shape {
            Shape::Mesh { mesh, .. } => self.description.meshes[mesh as usize].triangles.len(),
            _ => 1,
        };
        let first = self.placements[object as usize].first_light.map(|f| f as usize);
        let numbers = first.map_or(&[][..], |f| &self.light_of[f..f + triangles]);
        numbers.iter().copied().filter(|n| *n != NO_LIGHT)
    }

    /// The box that a moving object stays in during the exposure; `None` of one that stands still.
    pub(crate) fn swept_bounds(&self, object: u32) -> Option<Bounds> {
        Some(self.movers.swept(self.movers.mover(object)?))
    }

    /// Factor of a modulation at a time of the exposure.
    #[inline]
    pub(crate) fn modulated(&self, modulation: &Modulation, time_s: f32) -> f32 {
        modulation.at(self.open_s, time_s)
    }

    /// Factor on what a material emits at a time of the exposure.
    #[inline]
    pub(crate) fn modulation(&self, material: &Material, time_s: f32) -> f32 {
        if self.flickers { material.modulation().at(self.open_s, time_s) } else { 1.0 }
    }

    /// Whether a flash is burning at a time of the exposure.
    #[inline]
    pub(crate) fn flash_burns(&self, time_s: f32) -> bool {
        self.flashes.iter().any(|f| f.at(0.0, time_s) > 0.0)
    }

    /// Density (solid angle) with which [`Scene::aim`] would have aimed at an area light along a ray that meets it.
    #[inline]
    pub(crate) fn aimed_density(&self, light: u32, p: Vec3, direction: Vec3, distance: f32, time_s: f32) -> f32 {
        let still = &self.lights.area[light as usize];
        match self.light_ways.get(light as usize) {
            None | Some(LightWay::Still) => still.pdf(p, direction, distance),
            Some(way) => self.moved_light(still, *way, self.movers.share(time_s)).pdf(p, direction, distance),
        }
    }

    /// Puts a free node ([`Node::free`]) somewhere. What hangs on it follows at the next [`Scene::pose`].
    pub fn place_node(&mut self, node: u32, world_from_node: Affine3A) {
        let node = &mut self.description.nodes[node as usize];
        assert!(node.free && node.parent.is_none(), "node \"{}\" is not free", node.name);
        node.rest = Local::Matrix(world_from_node);
    }

    /// Changes how the lamps of a material shine with time.
    pub fn modulate(&mut self, material: u32, modulation: Modulation) {
        if let Some(emission) = &mut self.description.materials[material as usize].emission {
            emission.modulation = modulation;
        }
        self.note_modulations();
    }

    fn note_modulations(&mut self) {
        let d = &self.description;
        let all = || d.materials.iter().map(Material::modulation).chain(d.punctual.iter().map(|l| l.modulation));
        self.flickers = all().any(|m| m != Modulation::Steady);
        self.flashes = all().filter(Modulation::is_pulse).collect();
    }

    /// Whether something moves in more turns than its steps can follow in the exposure it was posed for.
    pub fn motion_is_coarse(&self) -> bool {
        self.movers.coarse()
    }

    /// Whether anything moves while light is gathered.
    pub fn moves(&self) -> bool {
        !self.movers.is_empty() || self.movers.lights.iter().any(Option::is_some)
    }

    /// What the scene was built from.
    pub fn description(&self) -> &Description {
        &self.description
    }

    /// Its lights.
    pub fn lights(&self) -> &Lights {
        &self.lights
    }

    /// The box around everything, as it is when the exposure begins; what hangs on free nodes is left out.
    pub fn bounds(&self) -> Bounds {
        self.top.bounds().union(self.movers.opening_bounds())
    }

    /// Triangles in meshes, each mesh counted once.
    pub fn triangle_count(&self) -> usize {
        self.description.meshes.iter().map(|m| m.triangles.len()).sum()
    }

    /// Bytes held by (meshes, hierarchies).
    pub fn memory(&self) -> (usize, usize) {
        let meshes = self.description.meshes.iter().map(Mesh::memory).sum();
        (meshes, self.top.memory() + self.shared.iter().flatten().map(Bvh::memory).sum::<usize>() + self.movers.memory())
    }

    /// Material of an object.
    #[inline]
    pub fn material(&self, object: u32) -> &Material {
        &self.description.materials[self.description.objects[object as usize].material as usize]
    }

    /// Nearest surface along a ray.
    #[inline]
    pub fn intersect(&self, ray: &Ray, t_max: f32) -> Option<Surface> {
        let filter = TopFilter { scene: self, ray };
        let mut hit = self.top.closest(ray.origin, ray.direction, t_max, &filter);
        if !self.movers.is_empty() {
            let share = self.movers.share(ray.time_s);
            let filter = MoverFilter { scene: self, ray, share };
            let limit = hit.map_or(t_max, |h| h.t);
            hit = self.movers.closest(share, ray.origin, ray.direction, limit, &filter).or(hit);
        }
        Some(self.surface(ray, &hit?))
    }

    /// Fills the world around its bodies.
    pub fn fill_air(&mut self, air: Option<Air>) {
        self.description.air = air;
    }

    /// What fills the world around its bodies.
    pub fn air(&self) -> Option<&Air> {
        self.description.air.as_ref()
    }

    /// Whether some of its surfaces are the faces of media and nothing else.
    pub(crate) fn has_clear(&self) -> bool {
        self.has_clear
    }

    /// Whether anything is met before `t_max`.
    #[inline]
    pub fn occluded(&self, ray: &Ray, t_max: f32) -> bool {
        if self.top.any(ray.origin, ray.direction, t_max, &TopFilter { scene: self, ray }) {
            return true;
        }
        if self.movers.is_empty() {
            return false;
        }
        let share = self.movers.share(ray.time_s);
        self.movers.any(share, ray.origin, ray.direction, t_max, &MoverFilter { scene: self, ray, share })
    }

    /// The area light that a surface point belongs to.
    #[inline]
    pub fn light_at(&self, surface: &Surface) -> Option<u32> {
        let first = self.placements[surface.object as usize].first_light?;
        let light = self.light_of[first as usize + surface.triangle as usize];
        (light != NO_LIGHT).then_some(light)
    }

    /// Object and triangle of a triangle number of the top hierarchy.
    #[inline]
    fn flat_object(&self, id: u32) -> (u32, u32) {
        let i = self.flat.partition_point(|(first, _)| *first <= id) - 1;
        (self.flat[i].1, id - self.flat[i].0)
    }

    fn surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let mut bent = None;
        let moved;
        let (object, triangle, corners, placement) = if hit.instance > 0 {
            let object = hit.instance - 1;
            let Shape::Mesh { mesh, .. } = self.description.objects[object as usize].shape else {
                unreachable!("only meshes are instanced")
            };
            match self.movers.mover(object) {
                None => {
                    let placement = &self.placements[object as usize];
                    let bvh = self.shared[mesh as usize].as_ref().expect("an instance has a hierarchy");
                    let corners = bvh.corners(hit.slot).map(|c| placement.world_from_object.transform_point3(c));
                    (object, hit.id, corners, placement)
                }
                Some(mover) => {
                    let (shared, mesh) = (self.shared[mesh as usize].as_ref(), &self.description.meshes[mesh as usize]);
                    let met = self.movers.met(mover, shared, mesh, hit.slot, hit.id, self.movers.share(ray.time_s));
                    bent = met.bent;
                    moved = Placement::at(met.place);
                    (object, hit.id, met.corners, &moved)
                }
            }
        } else if hit.slot == u32::MAX {
            return self.simple_surface(ray, hit);
        } else {
            let (object, triangle) = self.flat_object(hit.id);
            (object, triangle, self.top.corners(hit.slot), &self.placements[object as usize])
        };
        let Shape::Mesh { mesh, .. } = self.description.objects[object as usize].shape else {
            unreachable!("triangles belong to meshes")
        };
        let mesh = &self.description.meshes[mesh as usize];
        let [a, b, c] = corners;
        let weights = [1.0 - hit.u - hit.v, hit.u, hit.v];
        let mut ng = (b - a).cross(c - a).normalize();
        if placement.mirrored {
            ng = -ng;
        }
        let i = triangle as usize;
        let to_world = |n: Vec3| Vec3::from(placement.normals * Vec3A::from(n));
        let normal = match &bent {
            None => mesh.mix(&mesh.normals, i, weights).map(to_world),
            Some(bent) => mixed(&bent.normals, weights),
        };
        let ns = normal.and_then(Vec3::try_normalize).unwrap_or(ng);
        // Files exist whose winding and normals disagree: the normals say which side is out.
        if ns.dot(ng) < 0.0 {
            ng = -ng;
        }
        let uv = [0, 1].map(|s| mesh.mix(&mesh.uvs[s], i, weights).unwrap_or(Vec2::ZERO));
        let given = match &bent {
            None => mesh.mix(&mesh.tangents, i, weights),
            Some(bent) => mixed(&bent.tangents, weights),
        };
        let (tangent, handedness) = tangent(mesh, i, given, corners, placement, ng);
        Surface {
            point: a * weights[0] + b * weights[1] + c * weights[2],
            t: hit.t,
            ng,
            ns,
            tangent,
            handedness,
            uv,
            color: mesh.mix(&mesh.colors, i, weights).unwrap_or(Vec4::ONE),
            object,
            triangle,
        }
    }

    fn simple_surface(&self, ray: &Ray, hit: &Hit) -> Surface {
        let (point, ng, uv, tangent) = match self.description.objects[hit.id as usize].shape {
            Shape::Sphere(s) => {
                let n = (ray.at(hit.t) - s.center).normalize();
                // Longitude and latitude, as the environment map's.
                let uv =
                    Vec2::new(n.x.atan2(-n.z) / std::f32::consts::TAU + 0.5, n.y.clamp(-1.0, 1.0).acos() / std::f32::consts::PI);
                (s.center + n * s.radius, n, uv, Vec3::Y.cross(n))
            }
            Shape::Quad(q) => (q.point(Vec2::new(hit.u, hit.v)), q.normal(), Vec2::new(hit.u, hit.v), q.edges[0]),
            Shape::Mesh { .. } => unreachable!("meshes have triangles"),
        };
        Surface {
            point,
            t: hit.t,
            ng,
            ns: ng,
            tangent,
            handedness: 1.0,
            uv: [uv; 2],
            color: Vec4::ONE,
            object: hit.id,
            triangle: 0,
        }
    }
}

/// Values at the corners of a triangle mixed by barycentric weights.
fn mixed<T: Copy + std::ops::Mul<f32, Output = T> + std::ops::Add<Output = T>>(
    at: &[Option<T>; 3],
    weights: [f32; 3],
) -> Option<T> {
    Some(at[0]? * weights[0] + at[1]? * weights[1] + at[2]? * weights[2])
}

impl Placement {
    fn new(object: &Object) -> Self {
        match object.shape {
            Shape::Mesh { world_from_mesh, .. } => Placement::at(world_from_mesh),
            _ => Placement::at(Affine3A::IDENTITY),
        }
    }

    fn at(world_from_object: Affine3A) -> Self {
        let object_from_world = world_from_object.inverse();
        Placement {
            world_from_object,
            object_from_world,
            normals: object_from_world.matrix3.transpose(),
            first_light: None,
            mirrored: world_from_object.matrix3.determinant() < 0.0,
        }
    }
}

/// Tangent from the mesh or from how its texture coordinates run (0 without either), in world space, and the frame's handedness.
fn tangent(
    mesh: &Mesh,
    triangle: usize,
    given: Option<Vec4>,
    corners: [Vec3; 3],
    placement: &Placement,
    ng: Vec3,
) -> (Vec3, f32) {
    if let Some(t) = given {
        return (
            placement.world_from_object.transform_vector3(t.truncate()),
            if (t.w < 0.0) != placement.mirrored { -1.0 } else { 1.0 },
        );
    }
    if mesh.uvs[0].is_empty() {
        return (Vec3::ZERO, 1.0);
    }
    let [ua, ub, uc] = mesh.triangles[triangle].map(|i| mesh.uvs[0][i as usize]);
    let ((e1, e2), (d1, d2)) = ((corners[1] - corners[0], corners[2] - corners[0]), (ub - ua, uc - ua));
    let det = d1.perp_dot(d2);
    if det == 0.0 {
        return (Vec3::ZERO, 1.0);
    }
    let (tangent, bitangent) = ((e1 * d2.y - e2 * d1.y) / det, (e2 * d1.x - e1 * d2.x) / det);
    // glTF's v runs down the image: its bitangent points up it.
    (tangent, if ng.cross(tangent).dot(-bitangent) < 0.0 { -1.0 } else { 1.0 })
}

/// Holds numbers against what they refer to.
fn check(d: &Description) -> Result<(), SceneError> {
    let number = |what, of: &Object, found: u32, count: usize| match (found as usize) < count {
        true => Ok(()),
        false => Err(SceneError::Number { what, of: of.name.clone(), found: found as usize, count }),
    };
    for object in &d.objects {
        match object.motion {
            Motion::Still => {}
            Motion::Carried { node } => number("node", object, node, d.nodes.len())?,
            Motion::Deformed { deformer } => number("deformer", object, deformer, d.deformers.len())?,
        }
        assert!(
            object.motion == Motion::Still || matches!(object.shape, Shape::Mesh { .. }),
            "\"{}\" moves: only meshes do",
            object.name
        );
        if object.material as usize >= d.materials.len() {
            return Err(SceneError::Number {
                what: "material",
                of: object.name.clone(),
                found: object.material as usize,
                count: d.materials.len(),
            });
        }
        if let Shape::Mesh { mesh, .. } = object.shape
            && mesh as usize >= d.meshes.len()
        {
            return Err(SceneError::Number {
                what: "mesh",
                of: object.name.clone(),
                found: mesh as usize,
                count: d.meshes.len(),
            });
        }
    }
    Ok(())
}

/// Turns what could move, but does not as the animations are played, into what stands still.
fn settle(d: &mut Description) {
    let Description { nodes, animations, playing, deformers, objects, meshes, punctual, .. } = d;
    let timeline = Timeline::new(nodes, animations, playing);
    for object in objects {
        let Shape::Mesh { mesh, world_from_mesh } = &mut object.shape else { continue };
        match object.motion {
            Motion::Carried { node } if !timeline.moves(node) => {
                *world_from_mesh = timeline.world(node, 0.0);
                object.motion = Motion::Still;
            }
            Motion::Deformed { deformer } if !timeline.bends(&deformers[deformer as usize]) => {
                let rest = &meshes[*mesh as usize];
                let pose = timeline.pose(&deformers[deformer as usize], rest, 0.0);
                let posed = Mesh { positions: pose.positions, normals: pose.normals, tangents: pose.tangents, ..rest.clone() };
                meshes.push(posed);
                (*mesh, *world_from_mesh) = (meshes.len() as u32 - 1, Affine3A::IDENTITY);
                object.motion = Motion::Still;
            }
            _ => {}
        }
    }
    for light in punctual {
        if let Some(node) = light.carrier.filter(|n| !timeline.moves(*n)) {
            *light = Punctual { carrier: None, ..light.placed(&timeline.world(node, 0.0)) };
        }
    }
}

/// Most meshes that a warning lists by name.
const MOST_NAMED: usize = 6;

/// One warning for all triangles that were dropped: `losses` are numbers of meshes and how many each lost. Meshes bear the name of the first object
/// made of them; those that lost most come first.
fn dropped_triangles(losses: &[(usize, usize)], objects: &[Object]) -> String {
    let mut names = std::collections::HashMap::new();
    for object in objects {
        if let Shape::Mesh { mesh, .. } = object.shape {
            names.entry(mesh as usize).or_insert(object.name.as_str());
        }
    }
    let mut sorted = losses.to_vec();
    sorted.sort_by_key(|(mesh, count)| (std::cmp::Reverse(*count), *mesh));
    let named = sorted.iter().take(MOST_NAMED).map(|(mesh, count)| match names.get(mesh) {
        Some(name) if !name.is_empty() => format!("\"{name}\": {count}"),
        _ => format!("mesh {mesh}: {count}"),
    });
    let mut list = named.collect::<Vec<_>>().join(", ");
    if sorted.len() > MOST_NAMED {
        list += &format!(", {} more", sorted.len() - MOST_NAMED);
    }
    let total: usize = losses.iter().map(|l| l.1).sum();
    let meshes = if losses.len() == 1 { "1 mesh".to_owned() } else { format!("{} meshes", losses.len()) };
    let triangles = if total == 1 { "triangle" } else { "triangles" };
    format!("{total} {triangles} of {meshes} without area or with corners that are not finite were left out ({list})")
}

/// Leaves out what no ray can meet.
fn clean(d: &mut Description) -> Result<(), SceneError> {
    let mut bends = vec![false; d.meshes.len()];
    for object in d.objects.iter().filter(|o| matches!(o.motion, Motion::Deformed { .. })) {
        if let Shape::Mesh { mesh, .. } = object.shape {
            bends[mesh as usize] = true;
        }
    }
    let mut losses = Vec::new();
    for (i, mesh) in d.meshes.iter_mut().enumerate() {
        let n = mesh.positions.len();
        let whole = |len: usize| len == 0 || len == n;
        assert!(
            whole(mesh.normals.len())
                && whole(mesh.tangents.len())
                && whole(mesh.colors.len())
                && mesh.uvs.iter().all(|u| whole(u.len())),
            "mesh {i}: attribute lists differ in length from its {n} positions"
        );
        // What is flat at rest may unfold.
        let dropped = if bends[i] { mesh.drop_broken_triangles() } else { mesh.drop_unusable_triangles() };
        if dropped > 0 {
            losses.push((i, dropped));
        }
    }
    if !losses.is_empty() {
        let text = dropped_triangles(&losses, &d.objects);
        d.warnings.push(text);
    }
    // A placement that flattens (scale 0) or is not finite cannot be seen or inverted.
    let (warnings, before) = (&mut d.warnings, d.objects.len());
    d.objects.retain(|object| {
        let ok = match object.shape {
            Shape::Mesh { .. } if object.motion != Motion::Still => true,
            Shape::Mesh { world_from_mesh: m, .. } => {
                m.is_finite() && m.matrix3.determinant().abs() > 1e-30 && m.inverse().is_finite()
            }
            Shape::Sphere(s) => s.center.is_finite() && s.radius.is_finite() && s.radius > 0.0,
            Shape::Quad(q) => q.corner.is_finite() && q.area().is_finite() && q.area() > 0.0,
        };
        if !ok {
            warnings.push(format!("object \"{}\" has scale 0 or a place that is not finite: it was left out", object.name));
        }
        ok
    });
    let left = before - d.objects.len();
    if d.objects.is_empty() && left > 0 {
        return Err(SceneError::Empty(format!("all {left} objects have scale 0 or are not finite")));
    }
    Ok(())
}

struct MeshPrimitives<'a> {
    mesh: &'a Mesh,
    filtered: bool,
}

impl Primitives for MeshPrimitives<'_> {
    fn len(&self) -> usize {
        self.mesh.triangles.len()
    }
    fn get(&self, index: usize) -> Primitive {
        Primitive::Triangle { corners: self.mesh.corners(index), id: index as u32, filtered: self.filtered }
    }
}

struct TopPrimitives<'a> {
    description: &'a Description,
    flat: &'a [(u32, u32)],
    triangles: usize,
    others: &'a [(u32, Bounds)],
}

impl Primitives for TopPrimitives<'_> {
    fn len(&self) -> usize {
        self.triangles + self.others.len()
    }
    fn get(&self, index: usize) -> Primitive {
        if index >= self.triangles {
            let (id, bounds) = self.others[index - self.triangles];
            return Primitive::Other { bounds, id };
        }
        let (first, object) = self.flat[self.flat.partition_point(|(first, _)| *first <= index as u32) - 1];
        let object = &self.description.objects[object as usize];
        let Shape::Mesh { mesh, world_from_mesh } = object.shape else { unreachable!("flat objects are meshes") };
        let corners = self.description.meshes[mesh as usize].corners(index - first as usize);
        let filtered = !matches!(self.description.materials[object.material as usize].coverage, Coverage::Full);
        Primitive::Triangle { corners: corners.map(|c| world_from_mesh.transform_point3(c)), id: index as u32, filtered }
    }
}

struct TopFilter<'a> {
    scene: &'a Scene,
    ray: &'a Ray,
}

impl Scene {
    /// Whether a hit on a surface with holes counts. The random number is a hash of ray and place: the same ray always gets
    /// the same answer, and no sampler dimension is spent.
    fn covers(&self, ray: &Ray, object: u32, triangle: u32, u: f32, v: f32) -> bool {
        let Shape::Mesh { mesh, .. } = self.description.objects[object as usize].shape else { return true };
        let mesh = &self.description.meshes[mesh as usize];
        let weights = [1.0 - u - v, u, v];
        let uv = [0, 1].map(|s| mesh.mix(&mesh.uvs[s], triangle as usize, weights).unwrap_or(Vec2::ZERO));
        let alpha = mesh.mix(&mesh.colors, triangle as usize, weights).map_or(1.0, |c| c.w);
        let bits = |v: Vec3| v.x.to_bits() ^ mix(v.y.to_bits() ^ mix(v.z.to_bits()));
        let draw = to_unit(mix(bits(ray.origin) ^ mix(bits(ray.direction) ^ mix(triangle ^ object << 20))));
        self.material(object).coverage.accepts(&uv, alpha, draw)
    }
}

impl Filter for TopFilter<'_> {
    fn accept(&self, id: u32, u: f32, v: f32) -> bool {
        let (object, triangle) = self.scene.flat_object(id);
        self.scene.covers(self.ray, object, triangle, u, v)
    }

    fn intersect_other(&self, id: u32, t_max: f32, any: bool) -> Option<Hit> {
        let hit = |t, u, v| Hit { t, u, v, id, slot: u32::MAX, instance: 0 };
        match self.scene.description.objects[id as usize].shape {
            Shape::Sphere(s) => s.intersect(self.ray.origin, self.ray.direction, t_max).map(|t| hit(t, 0.0, 0.0)),
            Shape::Quad(q) => q.intersect(self.ray.origin, self.ray.direction, t_max).map(|(t, p)| hit(t, p.x, p.y)),
            Shape::Mesh { mesh, .. } => {
                let bvh = self.scene.shared[mesh as usize].as_ref()?;
                let place = &self.scene.placements[id as usize].object_from_world;
                // The direction keeps its scale, so t means the same in both spaces.
                let (o, d) = (place.transform_point3(self.ray.origin), place.transform_vector3(self.ray.direction));
                let filter = InstanceFilter { scene: self.scene, ray: self.ray, object: id };
                let found = if any {
                    bvh.any(o, d, t_max, &filter).then_some(Hit { t: 0.0, u: 0.0, v: 0.0, id, slot: 0, instance: id + 1 })
                } else {
                    bvh.closest(o, d, t_max, &filter)
                };
                found.map(|h| Hit { instance: id + 1, ..h })
            }
        }
    }
}

/// Meets what moves, at one moment.
struct MoverFilter<'a> {
    scene: &'a Scene,
    ray: &'a Ray,
    share: f32,
}

impl Filter for MoverFilter<'_> {
    fn accept(&self, _: u32, _: f32, _: f32) -> bool {
        unreachable!("hierarchies of movers hold no triangles")
    }
    fn intersect_other(&self, id: u32, t_max: f32, any: bool) -> Option<Hit> {
        let movers = &self.scene.movers;
        let filter = InstanceFilter { scene: self.scene, ray: self.ray, object: movers.object(id) };
        movers.enter(id, &self.scene.shared, self.share, (self.ray.origin, self.ray.direction), t_max, any, &filter)
    }
}

struct InstanceFilter<'a> {
    scene: &'a Scene,
    ray: &'a Ray,
    object: u32,
}

impl Filter for InstanceFilter<'_> {
    fn accept(&self, id: u32, u: f32, v: f32) -> bool {
        self.scene.covers(self.ray, self.object, id, u, v)
    }
    fn intersect_other(&self, _: u32, _: f32, _: bool) -> Option<Hit> {
        None
    }
}

/// Emissive surfaces.
struct AreaLights {
    lights: Vec<AreaLight>,
    ways: Vec<LightWay>,
    /// Light of each triangle.
    light_of: Vec<u32>,
    /// Where each object's triangles begin in `light_of`.
    first: Vec<Option<u32>>,
}

fn area_lights(d: &Description) -> AreaLights {
    let (mut lights, mut light_of, mut ways) = (Vec::new(), Vec::new(), Vec::new());
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
            let emission = material.emission.as_ref().filter(|e| e.is_light)?;
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
            let mut push = |shape, uv: [[Vec2; 3]; 2], alpha: [f32; 3], way: LightWay| {
                let luminance = luminance(&uv);
                // A textured lamp may be dark at the seven places looked at: keep it, with little weight.
                if luminance == 0.0 && constant[object.material as usize].is_some() {
                    return NO_LIGHT;
                }
                let light = AreaLight::new(shape, object.material, uv, emission.two_sided, luminance.max(1e-6));
                lights.push(light.with_alpha(alpha));
                ways.push(way);
                lights.len() as u32 - 1
            };
            match object.shape {
                Shape::Sphere(s) => light_of.push(push(AreaShape::Sphere(s), Default::default(), [1.0; 3], LightWay::Still)),
                Shape::Quad(q) => {
                    let corners = [Vec2::ZERO, Vec2::X, Vec2::Y];
                    light_of.push(push(AreaShape::Parallelogram(q), [corners; 2], [1.0; 3], LightWay::Still));
                }
                Shape::Mesh { mesh, world_from_mesh } => {
                    let mesh = &d.meshes[mesh as usize];
                    let (world_from_mesh, way) = match object.motion {
                        Motion::Still => (world_from_mesh, LightWay::Still),
                        Motion::Carried { .. } => (Affine3A::IDENTITY, LightWay::Carried { object: object_number }),
                        Motion::Deformed { .. } => {
                            (Affine3A::IDENTITY, LightWay::Bending { object: object_number, triangle: 0, flipped: false })
                        }
                    };
                    let bends = matches!(way, LightWay::Bending { .. });
                    let mirrored = world_from_mesh.matrix3.determinant() < 0.0;
                    let world = |t: usize| mesh.corners(t).map(|c| world_from_mesh.transform_point3(c));
                    let mut t = 0;
                    while t < mesh.triangles.len() {
                        let whole = constant[object.material as usize].is_some() && matches!(material.coverage, Coverage::Full);
                        let merged = whole && !bends && t + 1 < mesh.triangles.len();
                        if let Some(quad) = merged.then(|| parallelogram(world(t), world(t + 1))).flatten() {
                            let quad = if outside_differs(mesh, t, mirrored) { flipped(quad) } else { quad };
                            let light = push(AreaShape::Parallelogram(quad), Default::default(), [1.0; 3], way);
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
                        let way = match way {
                            LightWay::Bending { object, .. } => LightWay::Bending { object, triangle: t as u32, flipped },
                            way => way,
                        };
                        light_of.push(push(AreaShape::Triangle(Quad { corner: a, edges: [b - a, c - a] }), uv, alpha, way));
                        t += 1;
                    }
                }
            }
            Some(start)
        })
        .collect();
    AreaLights { lights, ways, light_of, first }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::Scattering;
    use crate::texture::Color;

    #[test]
    fn triangles_without_area_make_one_warning_with_count_and_names() {
        // Mesh n has one triangle with area and n without.
        let mesh = |flat: usize| {
            let mut triangles = vec![[0, 1, 2]];
            triangles.resize(1 + flat, [0, 1, 1]);
            Mesh { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles, ..Default::default() }
        };
        let scene = |count: usize| {
            let object = |n: usize| {
                let shape = Shape::Mesh { mesh: n as u32, world_from_mesh: Affine3A::IDENTITY };
                Object::new(format!("part {n}"), shape, 0)
            };
            let description = Description {
                meshes: (0..count).map(mesh).collect(),
                materials: vec![Material::new("grey", Scattering::Diffuse(Color::rgb(0.5, 0.5, 0.5)))],
                objects: (0..count).map(object).collect(),
                ..Default::default()
            };
            Scene::build(description).unwrap().description().warnings.clone()
        };
        assert!(scene(1).is_empty());
        let (two, many) = (scene(2), scene(10));
        assert_eq!([two.len(), many.len()], [1, 1]);
        let (two, many) = (&two[0], &many[0]);
        assert!(two.starts_with("1 triangle of 1 mesh ") && two.ends_with("(\"part 1\": 1)"), "{two}");
        assert!(many.starts_with("45 triangles of 9 meshes ") && many.contains("\"part 9\": 9, \"part 8\": 8"), "{many}");
        assert!(many.ends_with(", 3 more)") && !many.contains("part 3"), "{many}");
    }
}
