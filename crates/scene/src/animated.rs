//! Things that move, made ready for the rays of one exposure.
//!
//! Over the time of an exposure each motion is cut into equal steps, as many as keep what is straight between them close to the true
//! motion ([`TOLERANCE`]). What moves as a whole has a transform at each step, interpolated number by number; a mesh that bends has its
//! corners at each step and one moving hierarchy between two of them. Moving things hang in hierarchies of their own, one for each
//! segment of the exposure, whose boxes move too: what stands still is met as if nothing moved.

use crate::bvh::{Bounds, Bvh, Filter, Hit, Primitive, Primitives};
use crate::motion::{Deformer, Motion, Pose, Timeline};
use crate::scene::description::{Description, Shape};
use crate::shape::Mesh;
use glam::{Affine3A, Vec3, Vec4};
use rayon::prelude::*;

/// Largest distance between the true motion and the straight pieces that stand for it, as a fraction of the size of what moves: a tenth
/// of a pixel for a thing that fills 1000.
const TOLERANCE: f32 = 1e-4;
/// Most steps of a motion: a propeller of 30 turns a second over eight seconds.
const MOST_STEPS: usize = 1 << 16;
/// Most steps of a mesh that bends, and most triangles (each step a copy of about 600 bytes) it may take.
const MOST_POSES: usize = 256;
const MOST_POSED_TRIANGLES: usize = 1 << 22;
/// Most segments of an exposure, and most boxes in all of them.
const MOST_SEGMENTS: usize = 64;
const MOST_BOXES: usize = 1 << 20;

/// Doublings of the steps that change little before a motion is taken for one with jumps, which no number of steps follows.
const STALLS: usize = 9;

/// Maps a fraction of the exposure to a fraction of the key-frame cycle.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Clock {
    /// Moment of the first step and time to the last, s.
    open_s: f64,
    span_s: f64,
    /// Where in the cycle the exposure begins, in cycles, and how many it holds; `None` when it holds less than one.
    cycles: Option<(f64, f64)>,
}

impl Clock {
    fn new(timeline: &Timeline, nodes: impl IntoIterator<Item = u32>, open_s: f64, span_s: f64) -> Clock {
        match timeline.cycle(nodes, open_s).filter(|(_, period)| span_s > *period) {
            None => Clock { open_s, span_s, cycles: None },
            Some((first, period)) => {
                Clock { open_s: first, span_s: period, cycles: Some(((open_s - first) / period, span_s / period)) }
            }
        }
    }

    #[inline]
    fn fraction(&self, fraction: f32) -> f32 {
        match self.cycles {
            None => fraction,
            Some((from, turns)) => ((from + f64::from(fraction) * turns).rem_euclid(1.0)) as f32,
        }
    }
}

/// A transform that changes: at equal steps, straight between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// One, or a power of two and one.
    keys: Vec<Affine3A>,
    clock: Clock,
    /// Whether there are fewer steps than the motion would need.
    coarse: bool,
}

impl Track {
    /// The motion of a node during an exposure; `size` is what the tolerance is a fraction of, m, and `probes` are points (node space)
    /// that it is kept for.
    fn of_node(timeline: &Timeline, node: u32, probes: &[Vec3], size: f32, open_s: f64, span_s: f64) -> Track {
        let clock = Clock::new(timeline, [node], open_s, span_s);
        let still = |key| Track { keys: vec![key], clock, coarse: false };
        if span_s <= 0.0 || !timeline.moves(node) {
            return still(timeline.world(node, open_s));
        }
        let Clock { open_s, span_s, .. } = clock;
        let (mut last_worst, mut stalls) = (f32::INFINITY, 0);
        let kinks = timeline.kinks([node], open_s, open_s + span_s, MOST_STEPS / 4);
        let mut steps = (2 * kinks.len()).next_power_of_two().clamp(2, MOST_STEPS / 4);
        loop {
            let at = |x: f64| timeline.world(node, open_s + x * span_s);
            let keys = (0..=steps).map(|i| at(i as f64 / steps as f64)).collect();
            let straight = Track { keys, clock: Clock { cycles: None, ..clock }, coarse: false };
            let off = |x: f64| {
                let (true_place, drawn) = (at(x), straight.at(x as f32));
                let apart = |p: &Vec3| (true_place.transform_point3(*p) - drawn.transform_point3(*p)).length();
                probes.iter().map(apart).fold(0.0, f32::max)
            };
            let between = (0..steps).map(|i| (i as f64 + 0.5) / steps as f64);
            let worst = between.chain(kinks.iter().map(|t| (t - open_s) / span_s)).map(off).fold(0.0, f32::max);
            // A jump looks the same at any number of steps: its ramp is then short enough.
            stalls = if worst > 0.7 * last_worst { stalls + 1 } else { 0 };
            last_worst = worst;
            if worst <= TOLERANCE * size || stalls >= STALLS || steps >= MOST_STEPS {
                let first = straight.keys[0];
                if straight.keys.iter().all(|k| *k == first) {
                    return still(first);
                }
                let coarse = steps >= MOST_STEPS && worst > 100.0 * TOLERANCE * size;
                return Track { clock, coarse, ..straight };
            }
            steps *= 2;
        }
    }

    /// The transform at a fraction (0 to 1) of the exposure.
    #[inline]
    pub fn at(&self, fraction: f32) -> Affine3A {
        let last = self.keys.len() - 1;
        if last == 0 {
            return self.keys[0];
        }
        let (k, f) = step(self.clock.fraction(fraction), last);
        let (a, b) = (&self.keys[k], &self.keys[k + 1]);
        Affine3A { matrix3: a.matrix3 * (1.0 - f) + b.matrix3 * f, translation: a.translation * (1.0 - f) + b.translation * f }
    }
}

/// Number of the step that a fraction of the exposure lies in, and the fraction of that step.
#[inline]
fn step(fraction: f32, steps: usize) -> (usize, f32) {
    let x = fraction * steps as f32;
    let k = (x as usize).min(steps - 1);
    (k, x - k as f32)
}

/// The motion of a moving object.
#[derive(Debug)]
enum InstanceMotion {
    /// As a whole.
    Rigid(Track),
    /// Poses at the steps; hierarchies between them (one, still, when there is one pose).
    Bending { poses: Vec<Pose>, hierarchies: Vec<Bvh>, clock: Clock, coarse: bool },
}

/// A moving object.
#[derive(Debug)]
struct AnimatedInstance {
    object: u32,
    /// Whether it hangs on a free node.
    free: bool,
    /// Number of its mesh; `NONE` of curves.
    mesh: u32,
    motion: InstanceMotion,
    /// Boxes at the steps of the motion.
    boxes: Vec<Bounds>,
}

/// All that moves.
#[derive(Debug, Default)]
pub struct AnimatedInstances {
    animated: Vec<AnimatedInstance>,
    /// Animated instance of each object; `NONE` for those that stand still.
    of_object: Vec<u32>,
    /// Motions of nodes that carry lights without extent.
    pub(crate) lights: Vec<Option<Track>>,
    segments: Vec<Bvh>,
    span_s: f32,
}

const NONE: u32 = u32::MAX;

/// A triangle as it is met.
pub(crate) struct MovedTriangle {
    pub corners: [Vec3; 3],
    /// World from mesh; identity for a mesh that bends.
    pub place: Affine3A,
    /// Of a mesh that bends.
    pub bent: Option<Bent>,
}

/// Normals and tangents at the corners of a triangle, in world space, where the mesh has them.
pub(crate) struct Bent {
    pub normals: [Option<Vec3>; 3],
    pub tangents: [Option<Vec4>; 3],
}

impl AnimatedInstances {
    /// Everything that moves between two moments (s). `shared`: hierarchies of the meshes that are carried; `sets`: boxes of the sets of
    /// curves, and of those of splats.
    pub(crate) fn new(
        d: &Description,
        timeline: &Timeline,
        shared: &[Option<Bvh>],
        sets: [&[Bounds]; 2],
        open_s: f64,
        span_s: f64,
    ) -> AnimatedInstances {
        let animated: Vec<AnimatedInstance> = d
            .objects
            .par_iter()
            .enumerate()
            .filter_map(|(i, object)| {
                let of_set = match object.shape {
                    Shape::Curves { curves, .. } => Some(&sets[0][curves as usize]),
                    Shape::Splats { splats, .. } => Some(&sets[1][splats as usize]),
                    _ => None,
                };
                let mesh = match (object.shape, object.motion) {
                    (Shape::Mesh { mesh, .. }, _) => mesh,
                    (_, Motion::Carried { node }) => {
                        let (motion, boxes) = carried(timeline, node, of_set?, open_s, span_s);
                        return Some(AnimatedInstance {
                            object: i as u32,
                            free: d.nodes[node as usize].free,
                            mesh: NONE,
                            motion,
                            boxes,
                        });
                    }
                    _ => return None,
                };
                let (motion, boxes) = match object.motion {
                    Motion::Still => return None,
                    Motion::Carried { node } => {
                        let local = shared[mesh as usize].as_ref().map_or(Bounds::EMPTY, Bvh::bounds);
                        carried(timeline, node, &local, open_s, span_s)
                    }
                    Motion::Deformed { deformer } => {
                        let mesh = &d.meshes[mesh as usize];
                        let filtered = !matches!(d.materials[object.material as usize].coverage, crate::material::Coverage::Full);
                        bending(timeline, &d.deformers[deformer as usize], mesh, filtered, open_s, span_s)
                    }
                };
                let free = matches!(object.motion, Motion::Carried { node } if d.nodes[node as usize].free);
                Some(AnimatedInstance { object: i as u32, free, mesh, motion, boxes })
            })
            .collect();
        let mut of_object = if animated.is_empty() { Vec::new() } else { vec![NONE; d.objects.len()] };
        animated.iter().enumerate().for_each(|(i, m)| of_object[m.object as usize] = i as u32);
        let lights = d
            .punctual
            .iter()
            .map(|l| Some(l.carrier?).map(|node| Track::of_node(timeline, node, &[Vec3::ZERO, Vec3::NEG_Z], 1.0, open_s, span_s)))
            .collect();
        let segments = segments(&animated);
        AnimatedInstances { animated, of_object, lights, segments, span_s: span_s as f32 }
    }

    /// Whether nothing moves.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.animated.is_empty()
    }

    /// The fraction (0 to 1) of the exposure at a time after its beginning.
    #[inline]
    pub(crate) fn fraction(&self, time_s: f32) -> f32 {
        if self.span_s > 0.0 { (time_s / self.span_s).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// Number of the instance that an object is.
    #[inline]
    pub(crate) fn instance(&self, object: u32) -> Option<u32> {
        self.of_object.get(object as usize).copied().filter(|m| *m != NONE)
    }

    /// Where a instance that moves as a whole is; identity for a mesh that bends.
    pub(crate) fn place(&self, instance: u32, fraction: f32) -> Affine3A {
        match &self.animated[instance as usize].motion {
            InstanceMotion::Rigid(track) => track.at(fraction),
            InstanceMotion::Bending { .. } => Affine3A::IDENTITY,
        }
    }

    /// The box that a instance stays in.
    pub(crate) fn swept(&self, instance: u32) -> Bounds {
        self.animated[instance as usize].boxes.iter().fold(Bounds::EMPTY, |a, b| a.union(*b))
    }

    /// The box around all that moves, at the beginning; without what hangs on free nodes.
    pub(crate) fn opening_bounds(&self) -> Bounds {
        self.animated.iter().filter(|m| !m.free).fold(Bounds::EMPTY, |b, m| b.union(m.boxes[0]))
    }

    /// Whether a motion is longer than its steps can follow.
    pub(crate) fn coarse(&self) -> bool {
        self.animated.iter().any(|m| match &m.motion {
            InstanceMotion::Rigid(track) => track.coarse,
            InstanceMotion::Bending { coarse, .. } => *coarse,
        }) || self.lights.iter().flatten().any(|t| t.coarse)
    }

    /// Bytes held.
    pub(crate) fn memory(&self) -> usize {
        let motion = |m: &AnimatedInstance| match &m.motion {
            InstanceMotion::Rigid(track) => track.keys.len() * size_of::<Affine3A>(),
            InstanceMotion::Bending { poses, hierarchies, .. } => {
                let pose = |p: &Pose| p.positions.len() * 12 + p.normals.len() * 12 + p.tangents.len() * 16;
                poses.iter().map(pose).sum::<usize>() + hierarchies.iter().map(Bvh::memory).sum::<usize>()
            }
        };
        self.animated.iter().map(motion).sum::<usize>() + self.segments.iter().map(Bvh::memory).sum::<usize>()
    }

    /// Corners of a triangle by its number in the mesh (not by a hit), in world space.
    pub(crate) fn corners(&self, instance: u32, mesh: &Mesh, triangle: usize, fraction: f32) -> [Vec3; 3] {
        match &self.animated[instance as usize].motion {
            InstanceMotion::Rigid(track) => {
                let place = track.at(fraction);
                mesh.corners(triangle).map(|c| place.transform_point3(c))
            }
            InstanceMotion::Bending { poses, clock, .. } => {
                let (a, b, f) = between(poses, clock.fraction(fraction));
                mesh.triangles[triangle].map(|i| {
                    let i = i as usize;
                    a.positions[i] + (b.positions[i] - a.positions[i]) * f
                })
            }
        }
    }

    /// What a hit at a slot of a instance's hierarchy has met.
    pub(crate) fn met(
        &self,
        instance: u32,
        shared: Option<&Bvh>,
        mesh: &Mesh,
        slot: u32,
        triangle: u32,
        fraction: f32,
    ) -> MovedTriangle {
        match &self.animated[instance as usize].motion {
            InstanceMotion::Rigid(track) => {
                let place = track.at(fraction);
                let shared = shared.expect("what is carried has a hierarchy");
                MovedTriangle { corners: shared.corners(slot).map(|c| place.transform_point3(c)), place, bent: None }
            }
            InstanceMotion::Bending { poses, hierarchies, clock, .. } => {
                let fraction = clock.fraction(fraction);
                let (k, f) = step(fraction, hierarchies.len());
                let corners = hierarchies[k].corners_at(slot, f);
                let (a, b, f) = between(poses, fraction);
                let at = mesh.triangles[triangle as usize].map(|i| i as usize);
                let normals = at.map(|i| Some(*a.normals.get(i)? * (1.0 - f) + *b.normals.get(i)? * f));
                let tangents = at.map(|i| {
                    let (a, b) = (*a.tangents.get(i)?, *b.tangents.get(i)?);
                    Some((a.truncate() * (1.0 - f) + b.truncate() * f).extend(a.w))
                });
                MovedTriangle { corners, place: Affine3A::IDENTITY, bent: Some(Bent { normals, tangents }) }
            }
        }
    }

    /// Nearest hit on what moves; `filter` meets a instance by its number.
    #[inline]
    pub(crate) fn closest(&self, fraction: f32, origin: Vec3, direction: Vec3, t_max: f32, filter: &impl Filter) -> Option<Hit> {
        let (k, f) = step(fraction, self.segments.len());
        self.segments[k].closest_at(f, origin, direction, t_max, filter)
    }

    /// Any hit on what moves.
    #[inline]
    pub(crate) fn any(&self, fraction: f32, origin: Vec3, direction: Vec3, t_max: f32, filter: &impl Filter) -> bool {
        let (k, f) = step(fraction, self.segments.len());
        self.segments[k].any_at(f, origin, direction, t_max, filter)
    }

    /// Follows a ray into one instance. `t` of the hit means the same as in the world.
    #[inline]
    #[allow(clippy::too_many_arguments, reason = "a ray, a moment, a limit and who is asked")]
    pub(crate) fn enter(
        &self,
        instance: u32,
        shared: &[Option<Bvh>],
        fraction: f32,
        (origin, direction): (Vec3, Vec3),
        t_max: f32,
        any: bool,
        filter: &impl Filter,
    ) -> Option<Hit> {
        let instance = &self.animated[instance as usize];
        let found = Hit { t: 0.0, u: 0.0, v: 0.0, id: 0, slot: 0, instance: 0 };
        match &instance.motion {
            InstanceMotion::Rigid(track) => {
                let place = track.at(fraction);
                // Scaled to nothing: not there.
                if place.matrix3.determinant().abs() < 1e-30 {
                    return None;
                }
                let place = place.inverse();
                let (o, d) = (place.transform_point3(origin), place.transform_vector3(direction));
                let bvh = shared[instance.mesh as usize].as_ref()?;
                if any { bvh.any(o, d, t_max, filter).then_some(found) } else { bvh.closest(o, d, t_max, filter) }
            }
            InstanceMotion::Bending { hierarchies, clock, .. } => {
                let (k, f) = step(clock.fraction(fraction), hierarchies.len());
                let bvh = &hierarchies[k];
                if any {
                    bvh.any_at(f, origin, direction, t_max, filter).then_some(found)
                } else {
                    bvh.closest_at(f, origin, direction, t_max, filter)
                }
            }
        }
        .map(|h| Hit { instance: instance.object + 1, ..h })
    }

    /// Object of a instance.
    #[inline]
    pub(crate) fn object(&self, instance: u32) -> u32 {
        self.animated[instance as usize].object
    }
}

/// The poses around a fraction of the exposure, and the fraction between them.
fn between(poses: &[Pose], fraction: f32) -> (&Pose, &Pose, f32) {
    if poses.len() == 1 {
        return (&poses[0], &poses[0], 0.0);
    }
    let (k, f) = step(fraction, poses.len() - 1);
    (&poses[k], &poses[k + 1], f)
}

fn carried(timeline: &Timeline, node: u32, local: &Bounds, open_s: f64, span_s: f64) -> (InstanceMotion, Vec<Bounds>) {
    if local.is_empty() {
        let clock = Clock { open_s, span_s, cycles: None };
        return (InstanceMotion::Rigid(Track { keys: vec![Affine3A::IDENTITY], clock, coarse: false }), vec![Bounds::EMPTY]);
    }
    let probes = local.corners();
    let placed = timeline.world(node, open_s);
    let size = 0.5 * Bounds::around(probes.map(|p| placed.transform_point3(p))).size().length();
    let track = Track::of_node(timeline, node, &probes, size.max(1e-9), open_s, span_s);
    let boxes = track.keys.iter().map(|k| local.placed(k)).collect();
    let boxes = over_cycles(boxes, &track.clock);
    (InstanceMotion::Rigid(track), boxes)
}

/// Boxes over the exposure: of what is done again and again, the one around all of it.
fn over_cycles(boxes: Vec<Bounds>, clock: &Clock) -> Vec<Bounds> {
    match clock.cycles {
        None => boxes,
        Some(_) => vec![boxes.into_iter().fold(Bounds::EMPTY, Bounds::union)],
    }
}

fn bending(
    timeline: &Timeline,
    deformer: &Deformer,
    mesh: &Mesh,
    filtered: bool,
    open_s: f64,
    span_s: f64,
) -> (InstanceMotion, Vec<Bounds>) {
    let joints = || deformer.skin.iter().flat_map(|s| s.joints.iter().copied()).chain([deformer.node]);
    let clock = Clock::new(timeline, joints(), open_s, span_s);
    let moves = span_s > 0.0 && timeline.bends(deformer);
    let Clock { open_s, span_s, .. } = if moves { clock } else { Clock { open_s, span_s, cycles: None } };
    let at = |x: f64| timeline.pose(deformer, mesh, open_s + x * span_s);
    let mut poses = vec![at(0.0)];
    let mut coarse = false;
    if moves {
        let kinks = timeline.kinks(joints(), open_s, open_s + span_s, 4096).len();
        let most = (MOST_POSED_TRIANGLES / mesh.triangles.len().max(1)).clamp(1, MOST_POSES);
        let most = if most.is_power_of_two() { most } else { most.next_power_of_two() / 2 };
        let mut steps = (kinks + 1).next_power_of_two().clamp(1, most);
        let size = 0.5 * Bounds::around(poses[0].positions.iter().copied()).size().length();
        poses = (0..=steps).into_par_iter().map(|i| at(i as f64 / steps as f64)).collect();
        while steps < most {
            // What lies halfway becomes the next finer row of poses if it is needed.
            let halfway: Vec<Pose> = (0..steps).into_par_iter().map(|i| at((i as f64 + 0.5) / steps as f64)).collect();
            let off = |(i, pose): (usize, &Pose)| {
                let ends = poses[i].positions.iter().zip(&poses[i + 1].positions);
                let apart = pose.positions.iter().zip(ends).map(|(p, (a, b))| (*p - (*a + *b) * 0.5).length_squared());
                apart.fold(0.0f32, f32::max)
            };
            let worst = halfway.iter().enumerate().map(off).fold(0.0, f32::max).sqrt();
            if worst <= TOLERANCE * size {
                break;
            }
            coarse = 2 * steps >= most && worst > 100.0 * TOLERANCE * size;
            let mut finer = Vec::with_capacity(2 * steps + 1);
            let mut ends = poses.into_iter();
            for pose in halfway {
                finer.extend(ends.next());
                finer.push(pose);
            }
            finer.extend(ends);
            poses = finer;
            steps *= 2;
        }
    }
    let hierarchies = match poses.len() {
        1 => vec![Bvh::build(&Posed { mesh, open: &poses[0], close: None, filtered })],
        n => (0..n - 1)
            .into_par_iter()
            .map(|k| Bvh::build(&Posed { mesh, open: &poses[k], close: Some(&poses[k + 1]), filtered }))
            .collect(),
    };
    let boxes = poses.iter().map(|p| Bounds::around(mesh.triangles.iter().flatten().map(|i| p.positions[*i as usize]))).collect();
    let boxes = over_cycles(boxes, &clock);
    (InstanceMotion::Bending { poses, hierarchies, clock, coarse }, boxes)
}

/// Triangles between two poses.
struct Posed<'a> {
    mesh: &'a Mesh,
    open: &'a Pose,
    close: Option<&'a Pose>,
    filtered: bool,
}

impl Posed<'_> {
    fn triangle(&self, pose: &Pose, index: usize) -> Primitive {
        let corners = self.mesh.triangles[index].map(|i| pose.positions[i as usize]);
        Primitive::Triangle { corners, id: index as u32, filtered: self.filtered }
    }
}

impl Primitives for Posed<'_> {
    fn len(&self) -> usize {
        self.mesh.triangles.len()
    }
    fn get(&self, index: usize) -> Primitive {
        self.triangle(self.open, index)
    }
    fn moves(&self) -> bool {
        self.close.is_some()
    }
    fn get_at_end(&self, index: usize) -> Primitive {
        self.triangle(self.close.unwrap_or(self.open), index)
    }
}

/// Boxes of the animated instances at the two ends of a segment.
struct Boxes(Vec<[Bounds; 2]>);

impl Primitives for Boxes {
    fn len(&self) -> usize {
        self.0.len()
    }
    fn get(&self, index: usize) -> Primitive {
        Primitive::Other { bounds: self.0[index][0], id: index as u32 }
    }
    fn moves(&self) -> bool {
        self.0.iter().any(|[a, b]| a != b)
    }
    fn get_at_end(&self, index: usize) -> Primitive {
        Primitive::Other { bounds: self.0[index][1], id: index as u32 }
    }
}

/// One hierarchy for each segment of the exposure.
fn segments(animated: &[AnimatedInstance]) -> Vec<Bvh> {
    let steps = animated.iter().map(|m| m.boxes.len() - 1).max().unwrap_or(0).max(1);
    let affordable = (MOST_BOXES / animated.len().max(1)).next_power_of_two().max(1);
    let count = steps.next_power_of_two().min(MOST_SEGMENTS).min(affordable);
    (0..count)
        .into_par_iter()
        .map(|s| Bvh::build(&Boxes(animated.iter().map(|m| segment_boxes(&m.boxes, s, count)).collect())))
        .collect()
}

/// Boxes at the two ends of a segment whose interpolation holds the object all the while; `boxes` hold it when interpolated.
fn segment_boxes(boxes: &[Bounds], segment: usize, count: usize) -> [Bounds; 2] {
    let steps = boxes.len() - 1;
    if steps == 0 {
        return [boxes[0]; 2];
    }
    let lerp = |a: &Bounds, b: &Bounds, f: f32| Bounds { min: a.min + (b.min - a.min) * f, max: a.max + (b.max - a.max) * f };
    let at = |fraction: f32| {
        let (k, f) = step(fraction, steps);
        lerp(&boxes[k], &boxes[k + 1], f)
    };
    let (from, to) = (segment as f32 / count as f32, (segment + 1) as f32 / count as f32);
    let [mut open, mut close] = [at(from), at(to)];
    // Steps within the segment stand out of the straight line between its ends: widen both ends by the most that any does.
    let (mut below, mut above) = (Vec3::ZERO, Vec3::ZERO);
    for (k, inside) in boxes.iter().enumerate() {
        let fraction = k as f32 / steps as f32;
        if fraction > from && fraction < to {
            let straight = lerp(&open, &close, (fraction - from) / (to - from));
            (below, above) = (below.max(straight.min - inside.min), above.max(inside.max - straight.max));
        }
    }
    for b in [&mut open, &mut close] {
        (b.min, b.max) = (b.min - below, b.max + above);
    }
    [open, close]
}

#[cfg(test)]
mod tests;
