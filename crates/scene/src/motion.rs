//! What moves, as files say it: a forest of nodes, key frames on their transforms, skins and morph targets.
//!
//! A [`Timeline`] answers where everything is at a moment; how that becomes something rays can meet is the business of
//! `animated`. Source: Khronos, glTF 2.0 specification, §3.7.3 (skins), §3.7.2.2 (morph targets), §3.11 (animations) and
//! appendix C (interpolation).

use crate::shape::Mesh;
use glam::{Affine3A, Mat3A, Quat, Vec3, Vec4};

/// A place that things hang on.
#[derive(Clone, Debug)]
pub struct Node {
    /// Name in its file.
    pub name: String,
    /// Number of the node it hangs on.
    pub parent: Option<u32>,
    /// Where it is in its parent when nothing is animated.
    pub rest: Local,
    /// Whether somebody will say later where it is ([`crate::Scene::place_node`]), though no key frame moves it.
    pub free: bool,
}

impl Node {
    /// A node without a parent, at the origin.
    pub fn new(name: &str) -> Self {
        Node { name: name.to_owned(), parent: None, rest: Local::Parts(Parts::IDENTITY), free: false }
    }
}

/// A transform within the parent.
#[derive(Clone, Copy, Debug)]
pub enum Local {
    /// Any affine one; key frames replace it as a whole.
    Matrix(Affine3A),
    /// What key frames move one by one.
    Parts(Parts),
}

/// Scale, then rotation, then translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parts {
    /// m
    pub translation: Vec3,
    /// Unit quaternion.
    pub rotation: Quat,
    /// Factors along the axes.
    pub scale: Vec3,
}

impl Parts {
    /// No change.
    pub const IDENTITY: Parts = Parts { translation: Vec3::ZERO, rotation: Quat::IDENTITY, scale: Vec3::ONE };

    fn matrix(&self) -> Affine3A {
        Affine3A::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }
}

/// How an object moves.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Motion {
    /// Not at all.
    #[default]
    Still,
    /// As a whole, with a node: its mesh is in the node's space. Meshes only.
    Carried {
        /// Number of the node.
        node: u32,
    },
    /// Corner by corner. Meshes only.
    Deformed {
        /// Number of the deformer.
        deformer: u32,
    },
}

/// Key frames of a node.
#[derive(Clone, Debug)]
pub struct Channel {
    /// Number of the node.
    pub node: usize,
    /// What is animated.
    pub property: AnimatedProperty,
    /// How values between keys are found.
    pub interpolation: KeyInterpolation,
    /// Times, s, not falling; two equal ones are a jump.
    pub times_s: Vec<f32>,
    /// Values, flattened: 3 or 4 numbers a key or one a morph target (3 times as many for cubic: tangent in, value, tangent out).
    pub values: Vec<f32>,
}

/// What a channel moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum AnimatedProperty {
    /// 3 numbers, m.
    Translation,
    /// A unit quaternion x, y, z, w.
    Rotation,
    /// 3 factors.
    Scale,
    /// One weight for each target.
    MorphWeights,
}

/// Interpolation of key frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum KeyInterpolation {
    /// The value of the last key.
    Step,
    /// Straight (rotations: along the great circle, the shorter way).
    Linear,
    /// Hermite spline with given tangents.
    Cubic,
}

/// A named set of channels.
#[derive(Clone, Debug)]
pub struct Animation {
    /// Name in its file.
    pub name: String,
    /// What moves.
    pub channels: Vec<Channel>,
}

impl Animation {
    /// Time of the first and the last key, s; both 0 without keys.
    pub fn span_s(&self) -> [f64; 2] {
        let times = || self.channels.iter().flat_map(|c| &c.times_s).map(|t| f64::from(*t));
        if times().next().is_none() {
            return [0.0; 2];
        }
        [times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max)]
    }
}

/// What happens after the last key.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Extrapolation {
    /// Everything stays where it is then.
    #[default]
    Clamp,
    /// It begins anew.
    Loop,
}

/// Which animations run, and how.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct AnimationPlayback {
    /// Numbers of the animations.
    pub animations: Vec<usize>,
    /// After the last key.
    pub ending: Extrapolation,
    /// Nothing moves: all stays as it is at this moment, s.
    pub frozen_at_s: Option<f64>,
}

/// A mesh that bends.
#[derive(Clone, Debug)]
pub struct Deformer {
    /// Number of the mesh at rest.
    pub mesh: u32,
    /// Node it hangs on; without a skin, it stands in that node's space.
    pub node: u32,
    /// Morph targets.
    pub targets: Vec<Target>,
    /// Their weights when nothing is animated.
    pub weights: Vec<f32>,
    /// Joints that hold it.
    pub skin: Option<Skin>,
}

/// What one morph target adds at full weight; each list is empty or as long as the mesh's positions.
#[derive(Clone, Debug, Default)]
pub struct Target {
    /// m
    pub positions: Vec<Vec3>,
    /// Differences of normals.
    pub normals: Vec<Vec3>,
    /// Differences of tangents.
    pub tangents: Vec<Vec3>,
}

/// Joints and how much each corner hangs on them.
#[derive(Clone, Debug)]
pub struct Skin {
    /// Nodes.
    pub joints: Vec<u32>,
    /// From the mesh to each joint as they were when the skin was bound.
    pub joint_from_mesh: Vec<Affine3A>,
    /// Joint (number in `joints`) and weight, `per_corner` for each corner; weights of a corner sum to 1.
    pub influences: Vec<(u16, f32)>,
    /// Influences a corner.
    pub per_corner: usize,
}

/// Scales the weights of a corner so that they sum to 1. What nothing holds is held by the first joint. Not for an empty list.
pub(crate) fn influences_summing_to_one(corner: &mut [(u16, f32)]) {
    let total: f32 = corner.iter().map(|(_, w)| w).sum();
    // What sums to 1 but for rounding stays as it is: written and read again it is the same.
    let total = if (total - 1.0).abs() < 1e-6 { 1.0 } else { total };
    if !(total.abs() > 1e-6 && total.is_finite()) {
        corner.fill((0, 0.0));
        corner[0].1 = 1.0;
        return;
    }
    corner.iter_mut().for_each(|(j, w)| (*j, *w) = (if *w == 0.0 { 0 } else { *j }, *w / total));
}

/// A deformed mesh at a moment, in world space; lists as in [`Mesh`].
#[derive(Clone, Debug, Default)]
pub struct Pose {
    /// m
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// Tangents, w the handedness.
    pub tangents: Vec<Vec4>,
}

/// Channels of one node.
#[derive(Clone, Copy, Default)]
struct Tracks<'a> {
    translation: Option<(&'a Channel, [f64; 2])>,
    rotation: Option<(&'a Channel, [f64; 2])>,
    scale: Option<(&'a Channel, [f64; 2])>,
    weights: Option<(&'a Channel, [f64; 2])>,
}

/// Where everything is at any moment.
pub struct Timeline<'a> {
    nodes: &'a [Node],
    playing: &'a AnimationPlayback,
    tracks: Vec<Tracks<'a>>,
    /// Whether a node or one it hangs on is animated.
    moves: Vec<bool>,
}

impl<'a> Timeline<'a> {
    /// Gathers the channels that run. Of two channels on the same property the later one counts.
    pub fn new(nodes: &'a [Node], animations: &'a [Animation], playing: &'a AnimationPlayback) -> Self {
        let mut tracks = vec![Tracks::default(); nodes.len()];
        let running = playing.animations.iter().filter_map(|i| animations.get(*i));
        for animation in running {
            let span = animation.span_s();
            for channel in animation.channels.iter().filter(|c| c.node < nodes.len() && !c.times_s.is_empty()) {
                let track = &mut tracks[channel.node];
                let slot = match channel.property {
                    AnimatedProperty::Translation => &mut track.translation,
                    AnimatedProperty::Rotation => &mut track.rotation,
                    AnimatedProperty::Scale => &mut track.scale,
                    AnimatedProperty::MorphWeights => &mut track.weights,
                };
                *slot = Some((channel, span));
            }
        }
        let mut timeline = Timeline { nodes, playing, tracks, moves: Vec::new() };
        let animated = |n: u32| {
            let t = &timeline.tracks[n as usize];
            t.translation.is_some() || t.rotation.is_some() || t.scale.is_some()
        };
        timeline.moves = (0..nodes.len() as u32)
            .map(|n| timeline.chain(n).any(|n| nodes[n as usize].free || (playing.frozen_at_s.is_none() && animated(n))))
            .collect();
        timeline
    }

    /// A node and all it hangs on, upwards.
    fn chain(&self, node: u32) -> impl Iterator<Item = u32> {
        let mut steps = 0;
        std::iter::successors(Some(node), move |n| {
            steps += 1;
            assert!(steps <= self.nodes.len(), "node {n} hangs on itself");
            self.nodes[*n as usize].parent
        })
    }

    /// Whether a node may be elsewhere at another moment. Panics on a number that is no node's.
    pub fn moves(&self, node: u32) -> bool {
        self.moves[node as usize]
    }

    /// Whether a deformer's mesh may look different at another moment.
    pub fn bends(&self, deformer: &Deformer) -> bool {
        let runs = self.playing.frozen_at_s.is_none();
        let joints = deformer.skin.as_ref().map_or(&[][..], |s| &s.joints);
        (deformer.skin.is_none() && self.moves(deformer.node))
            || joints.iter().any(|j| self.moves(*j))
            || (runs && !deformer.targets.is_empty() && self.tracks[deformer.node as usize].weights.is_some())
    }

    /// The moment of an animation's keys that a moment of the scene shows.
    fn moment(&self, time_s: f64, [first, last]: [f64; 2]) -> f64 {
        let time = self.playing.frozen_at_s.unwrap_or(time_s);
        match self.playing.ending {
            Extrapolation::Loop if time > last && last > first => first + (time - first).rem_euclid(last - first),
            _ => time.clamp(first, last),
        }
    }

    fn local(&self, node: u32, time_s: f64) -> Affine3A {
        let track = &self.tracks[node as usize];
        let rest = &self.nodes[node as usize].rest;
        if track.translation.is_none() && track.rotation.is_none() && track.scale.is_none() {
            return match rest {
                Local::Matrix(m) => *m,
                Local::Parts(p) => p.matrix(),
            };
        }
        let mut parts = match rest {
            Local::Parts(p) => *p,
            Local::Matrix(m) => {
                let (scale, rotation, translation) = m.to_scale_rotation_translation();
                Parts { translation, rotation, scale }
            }
        };
        let at = |(channel, span): (&Channel, [f64; 2])| channel.at(self.moment(time_s, span));
        if let Some(v) = track.translation.map(at) {
            parts.translation = Vec3::from_slice(&v);
        }
        if let Some(v) = track.rotation.map(at) {
            parts.rotation = Quat::from_slice(&v);
        }
        if let Some(v) = track.scale.map(at) {
            parts.scale = Vec3::from_slice(&v);
        }
        parts.matrix()
    }

    /// Where a node is at a moment of the scene (s), in the world. Panics on a number that is no node's, and where nodes hang on themselves.
    pub fn world(&self, node: u32, time_s: f64) -> Affine3A {
        self.chain(node).fold(Affine3A::IDENTITY, |below, n| self.local(n, time_s) * below)
    }

    /// First moment and length (s) of what a node and all it hangs on do again and again from a moment on; `None` where they do not, or
    /// not in step.
    pub fn cycle(&self, nodes: impl IntoIterator<Item = u32>, open_s: f64) -> Option<(f64, f64)> {
        if self.playing.ending != Extrapolation::Loop {
            return None;
        }
        let mut spans = nodes.into_iter().flat_map(|n| self.chain(n)).flat_map(|n| {
            let t = &self.tracks[n as usize];
            [t.translation, t.rotation, t.scale, t.weights].into_iter().flatten().map(|(_, span)| span)
        });
        let first = spans.next()?;
        let [from, to] = first;
        (to > from && open_s >= from && spans.all(|s| s == first)).then_some((from, to - from))
    }

    /// Moments (s, in no order) within an interval at which the way of a node (or of a deformer's mesh) may have a kink, at most `limit` of them.
    pub fn kinks(&self, nodes: impl IntoIterator<Item = u32>, open_s: f64, close_s: f64, limit: usize) -> Vec<f64> {
        let mut moments = Vec::new();
        let mut seen = std::collections::HashSet::new();
        for node in nodes.into_iter().flat_map(|n| self.chain(n)).filter(|n| seen.insert(*n)) {
            let t = &self.tracks[node as usize];
            for (channel, [first, last]) in [t.translation, t.rotation, t.scale, t.weights].into_iter().flatten() {
                let period = last - first;
                let turns = match self.playing.ending {
                    Extrapolation::Loop if period > 0.0 => {
                        ((open_s - first) / period).floor().max(0.0) as i64..=((close_s - first) / period).floor().max(0.0) as i64
                    }
                    _ => 0..=0,
                };
                for turn in turns {
                    let keys = channel.times_s.iter().map(|k| f64::from(*k) + turn as f64 * period);
                    moments.extend(keys.filter(|k| *k > open_s && *k < close_s));
                    if moments.len() > limit {
                        moments.truncate(limit);
                        return moments;
                    }
                }
            }
        }
        moments
    }

    /// A deformer's mesh at a moment (s), in world space, m.
    pub fn pose(&self, deformer: &Deformer, mesh: &Mesh, time_s: f64) -> Pose {
        let mut pose = Pose { positions: mesh.positions.clone(), normals: mesh.normals.clone(), tangents: mesh.tangents.clone() };
        let animated = self.tracks[deformer.node as usize].weights;
        let weights = animated.map(|(channel, span)| channel.at(self.moment(time_s, span)));
        let weights = weights.as_deref().unwrap_or(&deformer.weights);
        for (target, weight) in deformer.targets.iter().zip(weights).filter(|(_, w)| **w != 0.0) {
            pose.positions.iter_mut().zip(&target.positions).for_each(|(p, d)| *p += *d * *weight);
            pose.normals.iter_mut().zip(&target.normals).for_each(|(n, d)| *n += *d * *weight);
            pose.tangents.iter_mut().zip(&target.tangents).for_each(|(t, d)| *t += (*d * *weight).extend(0.0));
        }
        let mut place = |i: usize, m: &Affine3A, normals: &Mat3A| {
            let p = m.transform_point3(pose.positions[i]);
            // A corner that leads nowhere must not spoil the boxes of the others.
            pose.positions[i] = if p.is_finite() { p } else { Vec3::ZERO };
            if let Some(n) = pose.normals.get_mut(i) {
                *n = (*normals * *n).normalize_or_zero();
            }
            if let Some(t) = pose.tangents.get_mut(i) {
                *t = m.transform_vector3(t.truncate()).normalize_or_zero().extend(t.w);
            }
        };
        match &deformer.skin {
            None => {
                let m = self.world(deformer.node, time_s);
                let normals = normals_by(&m);
                (0..mesh.positions.len()).for_each(|i| place(i, &m, &normals));
            }
            Some(skin) => {
                // A skinned mesh stands where its joints are, not where its node is.
                let joints: Vec<Affine3A> = skin
                    .joints
                    .iter()
                    .enumerate()
                    .map(|(i, j)| self.world(*j, time_s) * skin.joint_from_mesh.get(i).copied().unwrap_or(Affine3A::IDENTITY))
                    .collect();
                for (i, influences) in skin.influences.chunks_exact(skin.per_corner).enumerate().take(mesh.positions.len()) {
                    let mut blend = Affine3A { matrix3: Mat3A::ZERO, translation: glam::Vec3A::ZERO };
                    for (joint, weight) in influences.iter().filter(|(_, w)| *w != 0.0) {
                        let m = &joints[*joint as usize];
                        blend.matrix3 += m.matrix3 * *weight;
                        blend.translation += m.translation * *weight;
                    }
                    place(i, &blend, &normals_by(&blend));
                }
            }
        }
        pose
    }
}

/// Turns normals as a transform turns surfaces; any length. The transposed cofactors also serve where the inverse does not exist.
fn normals_by(m: &Affine3A) -> Mat3A {
    let [x, y, z] = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis];
    let cofactors = Mat3A::from_cols(y.cross(z), z.cross(x), x.cross(y));
    if m.matrix3.determinant() < 0.0 { -cofactors } else { cofactors }
}

impl Channel {
    /// Numbers a value has.
    fn width(&self) -> usize {
        let per_key = self.values.len() / self.times_s.len().max(1);
        if self.interpolation == KeyInterpolation::Cubic { per_key / 3 } else { per_key }
    }

    /// The value at a moment (s): as many numbers as the property has, translations in m, rotations unit quaternions x, y, z, w; those of the first and last key beyond
    /// them.
    pub fn at(&self, time_s: f64) -> Vec<f32> {
        let (times, width) = (&self.times_s, self.width());
        let cubic = self.interpolation == KeyInterpolation::Cubic;
        // `part`: 0 tangent in, 1 value, 2 tangent out.
        let get = |key: usize, part: usize| match cubic {
            true => &self.values[(3 * key + part) * width..][..width],
            false => &self.values[key * width..][..width],
        };
        let finish = |mut v: Vec<f32>| {
            if self.property == AnimatedProperty::Rotation {
                let q = Quat::from_slice(&v);
                let q = if q.length_squared() > 1e-12 { q.normalize() } else { Quat::IDENTITY };
                v.copy_from_slice(&q.to_array());
            }
            v
        };
        let next = times.partition_point(|t| f64::from(*t) <= time_s);
        if next == 0 || next == times.len() {
            return finish(get(next.saturating_sub(1), 1).to_vec());
        }
        let (k, length) = (next - 1, f64::from(times[next]) - f64::from(times[next - 1]));
        let t = ((time_s - f64::from(times[k])) / length) as f32;
        match self.interpolation {
            KeyInterpolation::Step => finish(get(k, 1).to_vec()),
            KeyInterpolation::Linear if self.property == AnimatedProperty::Rotation => {
                let [a, b] = [k, next].map(|i| Quat::from_array(std::array::from_fn(|c| finish(get(i, 1).to_vec())[c])));
                a.slerp(b, t).to_array().to_vec()
            }
            KeyInterpolation::Linear => get(k, 1).iter().zip(get(next, 1)).map(|(a, b)| a + (b - a) * t).collect(),
            KeyInterpolation::Cubic => {
                // glTF 2.0, appendix C.5.
                let (t2, t3, length) = (t * t, t * t * t, length as f32);
                let (p0, m0, p1, m1) = (get(k, 1), get(k, 2), get(next, 1), get(next, 0));
                let at = |i: usize| {
                    (2.0 * t3 - 3.0 * t2 + 1.0) * p0[i]
                        + length * (t3 - 2.0 * t2 + t) * m0[i]
                        + (3.0 * t2 - 2.0 * t3) * p1[i]
                        + length * (t3 - t2) * m1[i]
                };
                finish((0..width).map(at).collect())
            }
        }
    }

    /// What is wrong with the key frames of a file, or `Ok` with what was set right: times that were not in order. Fails without keys, with a time below 0, with a number
    /// that is not finite, or with numbers that do not fit the keys.
    pub fn check(&mut self) -> Result<Option<String>, String> {
        let keys = self.times_s.len();
        if keys == 0 {
            return Err("it has no keys".into());
        }
        if let Some(bad) = self.times_s.iter().find(|t| !t.is_finite() || **t < 0.0) {
            return Err(format!("a key is at {bad} s"));
        }
        if let Some(bad) = self.values.iter().find(|v| !v.is_finite()) {
            return Err(format!("a value is {bad}"));
        }
        let parts = if self.interpolation == KeyInterpolation::Cubic { 3 } else { 1 };
        let fits = match self.property {
            AnimatedProperty::Translation | AnimatedProperty::Scale => self.values.len() == 3 * parts * keys,
            AnimatedProperty::Rotation => self.values.len() == 4 * parts * keys,
            AnimatedProperty::MorphWeights => self.values.len() >= parts * keys && self.values.len().is_multiple_of(parts * keys),
        };
        if !fits {
            return Err(format!("{} numbers for {keys} keys", self.values.len()));
        }
        if self.times_s.is_sorted() {
            return Ok(None);
        }
        let per_key = self.values.len() / keys;
        let mut order: Vec<usize> = (0..keys).collect();
        order.sort_by(|a, b| self.times_s[*a].total_cmp(&self.times_s[*b]));
        self.values = order.iter().flat_map(|k| self.values[k * per_key..(k + 1) * per_key].to_vec()).collect();
        self.times_s = order.iter().map(|k| self.times_s[*k]).collect();
        Ok(Some("its keys were not in the order of time: they were sorted".into()))
    }
}

#[cfg(test)]
mod tests;
