//! Skeletons, their animations, and what they bend: skins by linear blending, blend shapes as morph targets.
//!
//! Source: OpenUSD, `UsdSkel` (schemas Skeleton, SkelAnimation, BlendShape and the binding API). A point of a skinned mesh stands at
//! Σ wᵢ · S · Jᵢ · Bᵢ⁻¹ · G · p, with G the mesh's `geomBindTransform`, B a joint's bind transform, J its transform in the skeleton's space then, and S
//! where the skeleton stands; the transform of the mesh itself does not count. Shapes between
//! are morph targets of their own, whose weights are piecewise linear in the weight of the shape. Limits: blending is linear whatever `skinningMethod` says, a subdivision
//! surface is skinned after it is subdivided, by subdivided weights, where OpenUSD skins its control mesh, and normals are those of the
//! blended transform, where OpenUSD blends normals of the joints (up to 5° apart in its own tests).

use super::bending::VertexBending;
use super::skeleton_binding::{Binding, Bones};
use super::stage::{Prim, Stage, TimeSample};
use super::world::{Place, World, affine};
use crate::SceneError;
use crate::load::usd::layer::{Key, Value};
use crate::motion::{AnimatedProperty, Channel, Deformer, KeyInterpolation, Local, Node, Parts, Skin};
use glam::{DMat4, Quat, Vec3};
use std::collections::HashMap;
use std::sync::Arc;

type Read<T> = Result<T, SceneError>;

/// Blend shapes of a mesh; none where one is not there.
pub type Shapes = Vec<Option<Arc<Prim>>>;

fn texts(stage: &Stage, prim: &Prim, name: &str) -> Read<Option<Arc<[Arc<str>]>>> {
    Ok(match stage.value(prim, name)? {
        Some(Value::Texts(list)) if !list.is_empty() => Some(list),
        _ => None,
    })
}

fn matrices(stage: &Stage, prim: &Prim, name: &str) -> Read<Vec<DMat4>> {
    let numbers = stage.value(prim, name)?.and_then(|v| v.doubles()).unwrap_or_else(|| Arc::new([]));
    Ok(numbers.as_chunks().0.iter().map(DMat4::from_cols_array).collect())
}

/// How a mesh is bound to a skeleton, and its blend shapes; `None` of what nothing bends.
pub fn binding(world: &mut World, prim: &Prim, place: &Place) -> Read<Option<(Binding, Shapes)>> {
    let has_skin = world.stage.attribute(prim, "primvars:skel:jointIndices")?.is_some();
    let names = texts(&world.stage, prim, "skel:blendShapes")?;
    if !has_skin && names.is_none() {
        return Ok(None);
    }
    let Some(skeleton) = place.skeleton.clone() else {
        world.skip_unsupported("skins and blend shapes without a skeleton, or outside of a SkelRoot");
        return Ok(None);
    };
    if place.instancers > 0 {
        world.skip_unsupported("skins and blend shapes within prototypes of instancers");
        return Ok(None);
    }
    for name in ["primvars:skel:skinningMethod", "skel:skinningMethod"] {
        let said = world.stage.value(prim, name)?;
        if said.as_ref().and_then(Value::text).is_some_and(|m| &**m == "dualQuaternion") {
            world.skip_unsupported("dual quaternions of skins: blending is linear");
        }
    }
    let geom_bind = matrices(&world.stage, prim, "primvars:skel:geomBindTransform")?.into_iter().find(DMat4::is_finite);
    let mut shapes = Vec::new();
    let paths = world.stage.targets(prim, "skel:blendShapeTargets", Key::TargetPaths)?;
    for path in paths.iter().take(names.as_ref().map_or(0, |n| n.len())) {
        let shape = world.stage.prim(path)?;
        if shape.is_none() {
            world.skip_unsupported("blend shapes that are not there");
        }
        shapes.push(shape);
    }
    let names: Vec<Arc<str>> = names.iter().flat_map(|n| n.iter()).take(shapes.len()).cloned().collect();
    let joints = texts(&world.stage, prim, "skel:joints")?;
    Ok(Some((Binding { skeleton, joints, geom_bind: geom_bind.unwrap_or(DMat4::IDENTITY), shapes: names }, shapes)))
}

/// Weights of the shapes of a blend shape that has a weight: linear between those next to it, and beyond the last two. `at`: where each is seen alone, rising, none of
/// them 0, where there is nothing. Source: OpenUSD, `UsdSkelBlendShapeQuery::ComputeSubShapeWeights`.
fn shape_weights(at: &[f32], weight: f32) -> Vec<f32> {
    let nothing = at.partition_point(|w| *w < 0.0);
    let known = |k: usize| match k.cmp(&nothing) {
        std::cmp::Ordering::Less => at[k],
        std::cmp::Ordering::Equal => 0.0,
        std::cmp::Ordering::Greater => at[k - 1],
    };
    let above = (0..=at.len()).position(|k| known(k) > weight).unwrap_or(at.len()).clamp(1, at.len());
    let part = (weight - known(above - 1)) / (known(above) - known(above - 1));
    let mut weights = vec![0.0; at.len() + 1];
    (weights[above - 1], weights[above]) = (1.0 - part, part);
    weights.remove(nothing);
    weights
}

/// Most key frames that the kinks of in-between shapes add.
const MOST_KINKS: usize = 1 << 16;

/// Key frames (times, and weights of all blend shapes then) with others where a weight passes one at which a shape is seen alone: between them the weights of all shapes are
/// straight.
fn with_kinks(
    keys: &[TimeSample],
    weights_of: &[Vec<f32>],
    weights: impl Fn(&[f64]) -> Vec<f32>,
) -> Option<Vec<(f64, Vec<f32>)>> {
    let mut all: Vec<(f64, Vec<f32>)> = Vec::with_capacity(keys.len());
    let mut kinks = 0;
    for (time, values) in keys {
        let now = weights(values);
        if let Some((before_s, before)) = all.last().cloned() {
            let mut between: Vec<f64> = Vec::new();
            for ((from, to), at) in before.iter().zip(&now).zip(weights_of).filter(|(_, at)| at.len() > 1) {
                let passed = at.iter().chain(&[0.0]).map(|w| f64::from(w - from) / f64::from(to - from));
                between.extend(passed.filter(|t| *t > 0.0 && *t < 1.0));
            }
            between.sort_by(f64::total_cmp);
            between.dedup();
            kinks += between.len();
            if kinks > MOST_KINKS {
                return None;
            }
            for t in between {
                let then = before.iter().zip(&now).map(|(a, b)| a + (b - a) * t as f32).collect();
                all.push((before_s + (time - before_s) * t, then));
            }
        }
        all.push((*time, now));
    }
    Some(all)
}

/// The nodes of a skeleton, made when it is first asked for; `None` where it is not one that can hold a mesh.
fn bones(world: &mut World, path: &Arc<str>) -> Read<Option<Arc<Bones>>> {
    if let Some(known) = world.bones.get(path) {
        return Ok(known.clone());
    }
    let made = make_bones(world, path)?.map(Arc::new);
    world.bones.insert(path.clone(), made.clone());
    Ok(made)
}

fn make_bones(world: &mut World, path: &Arc<str>) -> Read<Option<Bones>> {
    let (Some(place), Some(prim)) = (world.skeletons.get(path).cloned(), world.stage.prim(path)?) else {
        world.skip_unsupported("skins whose skeleton is not there, or not in a SkelRoot");
        return Ok(None);
    };
    let names = texts(&world.stage, &prim, "joints")?.unwrap_or_else(|| Arc::new([]));
    let bind = matrices(&world.stage, &prim, "bindTransforms")?;
    let whole = |m: &DMat4| m.is_finite() && m.determinant().abs() > 1e-300;
    // One without joints may still move blend shapes.
    if bind.len() != names.len() || !bind.iter().all(whole) {
        world.skip_unsupported("skeletons without a bind transform for each joint");
        return Ok(None);
    }
    let number_of: HashMap<Arc<str>, usize> = names.iter().enumerate().rev().map(|(i, n)| (n.clone(), i)).collect();
    // A joint hangs on the nearest one that its path goes through.
    let parent = |name: &str| {
        std::iter::successors(name.rfind('/'), |end| name[..*end].rfind('/')).find_map(|end| number_of.get(&name[..end]).copied())
    };
    let parents: Vec<Option<usize>> = names.iter().map(|n| parent(n)).collect();
    let said = matrices(&world.stage, &prim, "restTransforms")?;
    let rest: Vec<DMat4> = match said.len() == names.len() && said.iter().all(DMat4::is_finite) {
        true => said,
        false => (0..names.len()).map(|i| parents[i].map_or(bind[i], |p| bind[p].inverse() * bind[i])).collect(),
    };
    let base = world.node_at(&place, prim.name());
    let first = world.description.nodes.len();
    let moves = match &place.skeleton_animation {
        Some(path) => animation(world, path)?,
        None => None,
    };
    for (i, name) in names.iter().enumerate() {
        let own = moves.as_ref().and_then(|m| Some((m, *m.joints.get(name)?)));
        let parent = parents[i].map_or(base, |p| (first + p) as u32);
        let place = match own {
            None => Local::Matrix(affine(rest[i])),
            Some((moves, joint)) => {
                let (scale, rotation, translation) = rest[i].to_scale_rotation_translation();
                let whole = scale.is_finite() && rotation.is_finite() && rest[i].determinant() != 0.0;
                let parts = if whole {
                    Parts { translation: translation.as_vec3(), rotation: rotation.as_quat(), scale: scale.as_vec3() }
                } else {
                    Parts::IDENTITY
                };
                Local::Parts(moves.key(joint, parts))
            }
        };
        world.description.nodes.push(Node { parent: Some(parent), rest: place, ..Node::new(name) });
        if let Some((moves, joint)) = own {
            world.channels.extend(moves.channels(joint, first + i));
        }
    }
    Ok(Some(Bones {
        number_of,
        nodes: (first..first + names.len()).map(|n| n as u32).collect(),
        joint_from_bound: bind.iter().map(DMat4::inverse).collect(),
        animation: moves.map(|m| m.prim),
    }))
}

/// A SkelAnimation.
struct Moves {
    prim: Arc<Prim>,
    joints: HashMap<Arc<str>, usize>,
    tracks: [Track; 3],
}

/// Translations, rotations or scales of all joints.
struct Track {
    property: AnimatedProperty,
    width: usize,
    /// At the scene's first time.
    at_start: Arc<[f64]>,
    /// Seconds and the numbers then.
    keys: Vec<TimeSample>,
}

fn animation(world: &mut World, path: &str) -> Read<Option<Moves>> {
    let Some(prim) = world.stage.prim(path)? else {
        world.skip_unsupported("animations of skeletons that are not there");
        return Ok(None);
    };
    if &*world.stage.type_name(&prim)? != "SkelAnimation" {
        return Ok(None);
    }
    let names = texts(&world.stage, &prim, "joints")?.unwrap_or_else(|| Arc::new([]));
    let joints = names.iter().enumerate().rev().map(|(i, n)| (n.clone(), i)).collect();
    let mut tracks = Vec::with_capacity(3);
    for (name, property, width) in [
        ("translations", AnimatedProperty::Translation, 3),
        ("rotations", AnimatedProperty::Rotation, 4),
        ("scales", AnimatedProperty::Scale, 3),
    ] {
        let (at_start, keys) = numbers_over_time(world, &prim, name, names.len() * width)?;
        tracks.push(Track { property, width, at_start, keys });
    }
    let tracks: Result<[Track; 3], _> = tracks.try_into();
    Ok(tracks.ok().map(|tracks| Moves { prim, joints, tracks }))
}

/// An attribute at the scene's first time, and its samples by seconds, of those with `count` finite numbers.
fn numbers_over_time(world: &mut World, prim: &Prim, name: &str, count: usize) -> Read<(Arc<[f64]>, Vec<TimeSample>)> {
    let none: Arc<[f64]> = Arc::new([]);
    let Some(found) = world.stage.attribute(prim, name)? else { return Ok((none, vec![])) };
    let fits = |v: &Arc<[f64]>| v.len() == count && v.iter().all(|x| x.is_finite());
    let at_start = world.stage.at_start(&found)?.and_then(|v| v.doubles());
    let samples = world.stage.samples(&found)?.unwrap_or_default();
    let before = samples.len();
    let mut keys: Vec<TimeSample> = samples.into_iter().filter(|(t, v)| t.is_finite() && fits(v)).collect();
    if keys.len() < before || at_start.as_ref().is_some_and(|v| !v.is_empty() && !fits(v)) {
        world.skip_unsupported("animations of skeletons that do not fit their joints");
    }
    keys.iter_mut().for_each(|k| k.0 = world.seconds(k.0));
    Ok((at_start.filter(fits).unwrap_or(none), keys))
}

impl Moves {
    /// A joint's parts at the scene's first time; what is not said is as at rest.
    fn key(&self, joint: usize, rest: Parts) -> Parts {
        let mut parts = rest;
        for track in self.tracks.iter().filter(|t| !t.at_start.is_empty()) {
            let v = track.of_joint(joint, &track.at_start);
            match track.property {
                AnimatedProperty::Translation => parts.translation = Vec3::from_slice(&v),
                AnimatedProperty::Rotation => {
                    let q = Quat::from_slice(&v);
                    parts.rotation = if q.length_squared() > 1e-12 { q.normalize() } else { Quat::IDENTITY };
                }
                _ => parts.scale = Vec3::from_slice(&v),
            }
        }
        parts
    }

    /// Key frames of a joint.
    fn channels(&self, joint: usize, node: usize) -> impl Iterator<Item = Channel> {
        self.tracks.iter().filter(|t| t.keys.len() > 1).map(move |track| Channel {
            node,
            property: track.property,
            interpolation: KeyInterpolation::Linear,
            times_s: track.keys.iter().map(|k| k.0 as f32).collect(),
            values: track.keys.iter().flat_map(|k| track.of_joint(joint, &k.1)).collect(),
        })
    }
}

impl Track {
    /// The numbers of a joint; of rotations x, y, z, w, where USD has w first.
    fn of_joint(&self, joint: usize, all: &[f64]) -> Vec<f32> {
        let mut own: Vec<f32> = all[joint * self.width..][..self.width].iter().map(|v| *v as f32).collect();
        if self.property == AnimatedProperty::Rotation {
            own.rotate_left(1);
        }
        own
    }
}

/// The deformer of a mesh that hangs on a skeleton; `None` where it is drawn as it was modelled. `node` is where the mesh stands.
pub fn deformer(world: &mut World, binding: &Binding, bending: &VertexBending, mesh: u32, node: u32) -> Read<Option<Deformer>> {
    let Some(bones) = bones(world, &binding.skeleton)? else { return Ok(None) };
    let mut skin = None;
    if bending.per_vertex > 0 {
        // What the indices of the mesh count.
        let numbers: Option<Vec<usize>> = match &binding.joints {
            None => Some((0..bones.nodes.len()).collect()),
            Some(names) => names.iter().map(|n| bones.number_of.get(n).copied()).collect(),
        };
        let Some(numbers) = numbers.filter(|n| bending.influences.iter().all(|i| usize::from(i.0) < n.len())) else {
            world.skip_unsupported("skins with joints that their skeleton does not have");
            return Ok(None);
        };
        skin = Some(Skin {
            joints: numbers.iter().map(|n| bones.nodes[*n]).collect(),
            joint_from_mesh: numbers.iter().map(|n| affine(bones.joint_from_bound[*n] * binding.geom_bind)).collect(),
            influences: bending.influences.clone(),
            per_corner: bending.per_vertex,
        });
    }
    let mut weights = vec![0.0; bending.targets.len()];
    if let Some(animation) = bones.animation.clone().filter(|_| !weights.is_empty()) {
        let names = texts(&world.stage, &animation, "blendShapes")?.unwrap_or_else(|| Arc::new([]));
        let (at_start, keys) = numbers_over_time(world, &animation, "blendShapeWeights", names.len())?;
        let number = |shape: usize| names.iter().position(|n| Some(n) == binding.shapes.get(shape));
        let numbers: Vec<Option<usize>> = (0..bending.weights_of.len()).map(number).collect();
        let of = |all: &[f64]| numbers.iter().map(|n| n.and_then(|n| all.get(n)).map_or(0.0, |v| *v as f32)).collect::<Vec<_>>();
        let of_targets = |of_shapes: &[f32]| -> Vec<f32> {
            bending.weights_of.iter().zip(of_shapes).flat_map(|(at, w)| shape_weights(at, *w)).collect()
        };
        weights = of_targets(&of(&at_start));
        if keys.len() > 1 {
            let keys = with_kinks(&keys, &bending.weights_of, of).unwrap_or_else(|| {
                world.skip_unsupported("kinks of in-between shapes between key frames: there are too many");
                keys.iter().map(|(time, values)| (*time, of(values))).collect()
            });
            world.channels.push(Channel {
                node: node as usize,
                property: AnimatedProperty::MorphWeights,
                interpolation: KeyInterpolation::Linear,
                times_s: keys.iter().map(|k| k.0 as f32).collect(),
                values: keys.iter().flat_map(|k| of_targets(&k.1)).collect(),
            });
        }
    }
    Ok(Some(Deformer { mesh, node, targets: bending.targets.clone(), weights, skin }))
}
