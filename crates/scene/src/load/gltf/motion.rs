//! What moves in a glTF file: nodes, animations, skins, morph targets.

use super::{Loader, error, label};
use crate::SceneError;
use crate::motion::{
    AnimatedProperty, Animation, AnimationPlayback, Channel, Deformer, Extrapolation, KeyInterpolation, Local, Node, Parts, Skin,
    Target, influences_summing_to_one,
};
use glam::{Affine3A, Mat4, Quat, Vec3};
use serde_json::Value;

impl Loader<'_> {
    /// Every node of the file, by its number there.
    pub(super) fn nodes(&mut self) {
        let mut nodes: Vec<Node> = self
            .document
            .nodes()
            .map(|node| {
                let rest = match node.transform() {
                    gltf::scene::Transform::Matrix { matrix } => {
                        Local::Matrix(Affine3A::from_mat4(Mat4::from_cols_array_2d(&matrix)))
                    }
                    gltf::scene::Transform::Decomposed { translation, rotation, scale } => Local::Parts(Parts {
                        translation: Vec3::from_array(translation),
                        rotation: Quat::from_array(rotation),
                        scale: Vec3::from_array(scale),
                    }),
                };
                Node { rest, ..Node::new(&node.name().map_or_else(|| format!("node {}", node.index()), str::to_owned)) }
            })
            .collect();
        for node in self.document.nodes() {
            for child in node.children() {
                // Trees within the scene have been checked; what lies outside of it must not make a ring either.
                let rings = std::iter::successors(Some(node.index() as u32), |n| nodes[*n as usize].parent)
                    .take(nodes.len() + 1)
                    .any(|n| n == child.index() as u32);
                if !rings {
                    nodes[child.index()].parent = Some(node.index() as u32);
                }
            }
        }
        self.description.nodes = nodes;
    }

    /// How a mesh of a node bends, if it does: the number of its deformer.
    pub(super) fn deformer(
        &mut self,
        node: &gltf::Node,
        mesh: &gltf::Mesh,
        primitive: &gltf::Primitive,
        number: u32,
        world: &[Option<Mat4>],
    ) -> Result<Option<u32>, SceneError> {
        let targets = self.targets(mesh, primitive, number);
        let skin = match node.skin() {
            Some(skin) => self.skin(&skin, primitive, number, world)?,
            None => None,
        };
        if targets.is_empty() && skin.is_none() {
            return Ok(None);
        }
        let mut weights = node.weights().or_else(|| mesh.weights()).unwrap_or_default().to_vec();
        if !weights.is_empty() && weights.len() != targets.len() {
            let place = format!("mesh {}{}", mesh.index(), label(mesh.name()));
            let warning = format!("{place}: {} weights for {} morph targets", weights.len(), targets.len());
            self.description.warnings.push(warning);
        }
        weights.resize(targets.len(), 0.0);
        self.description.deformers.push(Deformer { mesh: number, node: node.index() as u32, targets, weights, skin });
        Ok(Some(self.description.deformers.len() as u32 - 1))
    }

    fn targets(&mut self, mesh: &gltf::Mesh, primitive: &gltf::Primitive, number: u32) -> Vec<Target> {
        let n = self.description.meshes[number as usize].positions.len();
        let reader = primitive.reader(|b| self.buffers.get(b.index()).map(Vec::as_slice));
        let mut short = 0;
        let mut whole = |list: Option<gltf::mesh::util::ReadPositions>| -> Vec<Vec3> {
            let list: Vec<Vec3> = list.map(|it| it.map(Vec3::from_array).collect()).unwrap_or_default();
            short += usize::from(!list.is_empty() && list.len() != n);
            if list.len() == n { list } else { Vec::new() }
        };
        let targets = reader
            .read_morph_targets()
            .map(|(positions, normals, tangents)| Target {
                positions: whole(positions),
                normals: whole(normals),
                tangents: whole(tangents),
            })
            .collect();
        if short > 0 {
            let place = format!("mesh {}{}", mesh.index(), label(mesh.name()));
            self.description.warnings.push(format!("{place}: {short} lists of morph targets do not fit its {n} positions"));
        }
        targets
    }

    fn skin(
        &mut self,
        skin: &gltf::Skin,
        primitive: &gltf::Primitive,
        number: u32,
        world: &[Option<Mat4>],
    ) -> Result<Option<Skin>, SceneError> {
        let place = format!("skin {}{}", skin.index(), label(skin.name()));
        let get = |b: gltf::Buffer| self.buffers.get(b.index()).map(Vec::as_slice);
        let joint_from_mesh: Vec<Affine3A> = skin
            .reader(get)
            .read_inverse_bind_matrices()
            .map(|it| it.map(|m| Affine3A::from_mat4(Mat4::from_cols_array_2d(&m))).collect())
            .unwrap_or_default();
        if let Some(bad) = joint_from_mesh.iter().position(|m| !m.is_finite()) {
            let found = format!("inverse bind matrix {bad} is not finite");
            return Err(error(self.name, &place, found, "expected numbers"));
        }
        let given = joint_from_mesh.len();
        if given > 0 && given < skin.joints().count() {
            let warning = format!(
                "{place}: {given} inverse bind matrices for {} joints: the others are taken as they stand",
                skin.joints().count()
            );
            self.description.warnings.push(warning);
        }
        let joints: Vec<u32> = skin.joints().map(|j| j.index() as u32).collect();
        if let Some(lost) = joints.iter().find(|j| world[**j as usize].is_none()) {
            let found = format!("joint node {lost} is not in the scene");
            return Err(error(self.name, &place, found, "expected all joints below the scene's roots"));
        }
        if joints.is_empty() {
            return Err(error(self.name, &place, "it has no joints", "expected at least one"));
        }
        let corners = self.description.meshes[number as usize].positions.len();
        let reader = primitive.reader(get);
        let mut influences = vec![Vec::new(); corners];
        let mut sets = 0;
        while let (Some(j), Some(w)) = (reader.read_joints(sets), reader.read_weights(sets)) {
            for (corner, (j, w)) in influences.iter_mut().zip(j.into_u16().zip(w.into_f32())) {
                corner.extend(j.into_iter().zip(w));
            }
            sets += 1;
        }
        if sets == 0 {
            let warning = format!("{place}: a mesh without joints and weights stands where its node is");
            self.description.warnings.push(warning);
            return Ok(None);
        }
        let per_corner = 4 * sets as usize;
        for (i, corner) in influences.iter_mut().enumerate() {
            corner.resize(per_corner, (0, 0.0));
            if let Some((j, _)) = corner.iter().find(|(j, w)| *w != 0.0 && usize::from(*j) >= joints.len()) {
                let expected = format!("expected less than {}", joints.len());
                return Err(error(self.name, &place, format!("joint {j} of vertex {i}"), expected));
            }
            influences_summing_to_one(corner);
        }
        Ok(Some(Skin { joints, joint_from_mesh, influences: influences.concat(), per_corner }))
    }

    /// Key frames; the first animation runs unless somebody chooses another.
    pub(super) fn animations(&mut self) -> Result<(), SceneError> {
        for animation in self.document.clone().animations() {
            let mut channels = Vec::new();
            for (number, channel) in animation.channels().enumerate() {
                use gltf::animation::util::ReadOutputs;
                let place = format!("animation {}{} channel {number}", animation.index(), label(animation.name()));
                let reader = channel.reader(|b| self.buffers.get(b.index()).map(Vec::as_slice));
                let values: Option<Vec<f32>> = reader.read_outputs().map(|outputs| match outputs {
                    ReadOutputs::Translations(it) => it.flatten().collect(),
                    ReadOutputs::Rotations(it) => it.into_f32().flatten().collect(),
                    ReadOutputs::Scales(it) => it.flatten().collect(),
                    ReadOutputs::MorphTargetWeights(it) => it.into_f32().collect(),
                });
                let times = reader.read_inputs().map(|it| it.collect());
                let (Some(values), Some(times_s)) = (values, times) else {
                    return Err(error(self.name, &place, "its keys cannot be read", "expected times and values in a buffer"));
                };
                let mut channel = Channel {
                    node: channel.target().node().index(),
                    property: match channel.target().property() {
                        gltf::animation::Property::Translation => AnimatedProperty::Translation,
                        gltf::animation::Property::Rotation => AnimatedProperty::Rotation,
                        gltf::animation::Property::Scale => AnimatedProperty::Scale,
                        gltf::animation::Property::MorphTargetWeights => AnimatedProperty::MorphWeights,
                    },
                    interpolation: match channel.sampler().interpolation() {
                        gltf::animation::Interpolation::Step => KeyInterpolation::Step,
                        gltf::animation::Interpolation::Linear => KeyInterpolation::Linear,
                        gltf::animation::Interpolation::CubicSpline => KeyInterpolation::Cubic,
                    },
                    times_s,
                    values,
                };
                let expected = "expected rising times from 0 s and finite values, one a key (three for CUBICSPLINE)";
                if let Some(repaired) = channel.check().map_err(|found| error(self.name, &place, found, expected))? {
                    self.description.warnings.push(format!("{}: {place}: {repaired}", self.name));
                }
                channels.push(channel);
            }
            self.description.animations.push(Animation { name: animation.name().unwrap_or("").to_owned(), channels });
        }
        if !self.description.animations.is_empty() {
            self.description.playing =
                self.said_playing().unwrap_or(AnimationPlayback { animations: vec![0], ..AnimationPlayback::default() });
        }
        Ok(())
    }

    /// What a file of our own says of its animations ([`crate::save`]); `None` of others.
    fn said_playing(&self) -> Option<AnimationPlayback> {
        let scene = self.document.default_scene().or_else(|| self.document.scenes().next())?;
        let extras: Value = serde_json::from_str(scene.extras().as_ref()?.get()).ok()?;
        let said = extras.get("diopter_playing")?;
        let count = self.description.animations.len() as u64;
        let numbers = said.get("animations")?.as_array()?.iter().filter_map(Value::as_u64).filter(|n| *n < count);
        let ending = match said.get("ending").and_then(Value::as_str) {
            Some("loop") => Extrapolation::Loop,
            _ => Extrapolation::Clamp,
        };
        Some(AnimationPlayback { animations: numbers.map(|n| n as usize).collect(), ending, frozen_at_s: None })
    }
}
