//! What a file or a program says about a scene: plain data.

use crate::bvh::Bounds;
use crate::light::{Environment, Punctual};
use crate::material::Material;
use crate::medium::Air;
use crate::motion::{Animation, AnimationPlayback, Deformer, Motion, Node, Timeline};
use crate::shape::{Curves, Mesh, Quad, Sphere, Splats};
use crate::texture::Scalar;
use glam::{Affine3A, Vec3};
use std::sync::Arc;

/// Everything a file or a program says about a scene.
#[derive(Clone, Debug, Default)]
pub struct Description {
    /// For messages and metadata.
    pub name: String,
    /// Meshes, each once; copies of a description share them.
    pub meshes: Vec<Arc<Mesh>>,
    /// Sets of curves, each once; shared alike.
    pub curves: Vec<Arc<Curves>>,
    /// Sets of Gaussian splats, each once; shared alike.
    pub splats: Vec<Arc<Splats>>,
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
    pub playing: AnimationPlayback,
    /// Meshes that bend.
    pub deformers: Vec<Deformer>,
    /// Other sets of materials that the file offers.
    pub variants: Vec<Variant>,
    /// Meshes that heights displace, as they were before.
    pub displaced: Vec<DisplacedSurface>,
    /// How many times its file wants light to be scattered at most.
    pub max_depth: Option<u32>,
    /// Whether surfaces that shine by a picture are lamps by the words of the file, however little of the picture is bright; else they may be displays of a model.
    pub declares_lamps: bool,
    /// Classes that a table lists, each once, in its order: they are numbered first, so that scenes with one table have the same numbers.
    pub listed_classes: Vec<Arc<str>>,
    /// What was found odd on the way.
    pub warnings: Vec<String>,
    /// Pictures and measured materials that its file names and that could not be read.
    pub missing_textures: Vec<MissingTexture>,
}

/// A picture or a measured material that a scene's file names and that could not be read. Where it would give a colour, [`crate::load::STAND_IN`] is shown; a map of
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
            Shape::Curves { curves, .. } => self.curves.get(curves as usize).is_some_and(|c| !c.segments.is_empty()),
            Shape::Splats { splats, .. } => self.splats.get(splats as usize).is_some_and(|s| !s.is_empty()),
            Shape::Sphere(_) | Shape::Quad(_) => true,
        })
    }

    /// Gives objects the materials of a variant; fails, where there is none of that name, with the names there are.
    pub fn choose_variant(&mut self, name: &str) -> Result<(), String> {
        let Some(variant) = self.variants.iter().find(|v| v.name == name) else {
            let names: Vec<&str> = self.variants.iter().map(|v| v.name.as_str()).collect();
            return Err(if names.is_empty() {
                "none: the scene has no variants".into()
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

    /// The box (m, in the world) around the objects that are counted, at a moment, s; what hangs on free nodes is left out. Of Gaussian splats it holds the core
    /// ([`Splats::core_bounds`]): a few lie far away from what was captured.
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
            (Shape::Curves { .. }, Motion::Carried { node }) if self.nodes[node as usize].free => Bounds::EMPTY,
            (Shape::Curves { curves, world_from_curves }, motion) => {
                let place = match motion {
                    Motion::Carried { node } => timeline.world(node, time_s),
                    _ => world_from_curves,
                };
                self.curves.get(curves as usize).map_or(Bounds::EMPTY, |c| c.bounds()).placed(&place)
            }
            (Shape::Splats { .. }, Motion::Carried { node }) if self.nodes[node as usize].free => Bounds::EMPTY,
            (Shape::Splats { splats, world_from_splats }, motion) => {
                let place = match motion {
                    Motion::Carried { node } => timeline.world(node, time_s),
                    _ => world_from_splats,
                };
                self.splats.get(splats as usize).map_or(Bounds::EMPTY, |s| s.core_bounds()).placed(&place)
            }
            (Shape::Sphere(s), _) => Bounds { min: s.center - s.radius, max: s.center + s.radius },
            (Shape::Quad(q), _) => Bounds::around(q.corners()),
        };
        self.objects.iter().filter(|o| counted(o)).fold(Bounds::EMPTY, |b, o| b.union(around(o)))
    }

    /// For each direction the point (m, in the world) of the objects that are counted which lies farthest along it, at a moment, s: their support points, which say what
    /// a frame must hold. Empty where there is nothing; what hangs on free nodes is left out.
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
                (Shape::Curves { .. }, Motion::Carried { node }) if self.nodes[node as usize].free => {}
                (Shape::Curves { curves, world_from_curves }, motion) => {
                    let place = match motion {
                        Motion::Carried { node } => timeline.world(node, time_s),
                        _ => world_from_curves,
                    };
                    // Both ends of each segment: strands are thin.
                    let set = self.curves.get(curves as usize);
                    let ends =
                        set.into_iter().flat_map(|c| (0..c.segments.len() as u32).flat_map(|i| [c.at(i, 0.0), c.at(i, 1.0)]));
                    offer(&mut farthest, directions, ends.map(|p| place.transform_point3(p.center)));
                }
                (Shape::Splats { .. }, Motion::Carried { node }) if self.nodes[node as usize].free => {}
                (Shape::Splats { splats, world_from_splats }, motion) => {
                    let place = match motion {
                        Motion::Carried { node } => timeline.world(node, time_s),
                        _ => world_from_splats,
                    };
                    let core = self.splats.get(splats as usize).map(|s| s.core_bounds()).filter(|b| !b.is_empty());
                    let corners = core.into_iter().flat_map(|b| b.corners());
                    offer(&mut farthest, directions, corners.map(|p| place.transform_point3(p)));
                }
                (Shape::Sphere(s), _) => {
                    offer(&mut farthest, directions, directions.iter().map(|d| s.center + d.normalize_or_zero() * s.radius));
                }
                (Shape::Quad(q), _) => offer(&mut farthest, directions, q.corners().into_iter()),
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
    /// What kind of thing it is, for labels ([`crate::classes`]); shared by all of one kind.
    pub class: Option<Arc<str>>,
}

impl Object {
    /// A thing that stands still.
    pub fn new(name: impl Into<String>, shape: Shape, material: u32) -> Self {
        Object { name: name.into(), shape, material, motion: Motion::Still, class: None }
    }
}

/// The form of a thing.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum Shape {
    /// A mesh by number, placed.
    Mesh {
        /// Number of the mesh.
        mesh: u32,
        /// Where it stands; what moves says otherwise.
        world_from_mesh: Affine3A,
    },
    /// A set of curves by number, placed.
    Curves {
        /// Number of the set.
        curves: u32,
        /// Where it stands; what moves says otherwise.
        world_from_curves: Affine3A,
    },
    /// A set of Gaussian splats by number, placed.
    Splats {
        /// Number of the set.
        splats: u32,
        /// Where it stands; what moves says otherwise.
        world_from_splats: Affine3A,
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
    pub sight: CameraProjection,
    /// Radius of the lens (0 of a pinhole) and distance of what is sharp, m, where the file says so.
    pub lens: Option<[f32; 2]>,
    /// What its file says of the film.
    pub film: FilmHints,
    /// The node it hangs on; `world_from_camera` is that node's place at rest, without its scale.
    pub node: Option<u32>,
}

/// How much of the world a camera sees.
#[derive(Clone, Debug, PartialEq)]
pub enum CameraProjection {
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
            CameraProjection::Perspective { vertical_fov } => Some(vertical_fov),
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
    /// How far the middle of the picture lies beside the axis of the camera, to the right and up as the picture shows it, in heights of the picture: of a lens that is
    /// shifted, or of a picture that is a piece of a larger one.
    pub shift: [f64; 2],
}

/// Meshes as they were before heights moved their points, to be displaced anew.
#[derive(Clone, Debug)]
pub struct DisplacedSurface {
    /// Number of each mesh in [`Description::meshes`], the mesh itself and its heights (along its normals, in its space).
    pub(crate) parts: Vec<(u32, Arc<Mesh>, Arc<Scalar>)>,
    /// Of a mesh of pbrt, which is displaced by itself: the space of its textures, and whether it is turned inside out afterwards.
    pub(crate) alone: Option<(Affine3A, bool)>,
}
