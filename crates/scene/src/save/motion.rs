//! What moves, as nodes, skins, morph targets and animations of glTF: key frames are written as they are, weights of joints as 32-bit numbers.
//!
//! Which animations run, and what happens after the last key, glTF cannot say: it is in the extras of the scene (`diopter_playing`), where our own reader finds
//! it.

use super::Writer;
use crate::motion::{AnimatedProperty, Deformer, Extrapolation, KeyInterpolation, Local, Timeline};
use crate::scene::Description;
use glam::{Affine3A, Mat4, Vec3};
use serde_json::{Value, json};
use std::collections::{HashMap, HashSet};

/// Nodes of a scene that move, written as nodes of glTF.
pub(super) struct MovingNodes<'a> {
    d: &'a Description,
    timeline: &'a Timeline<'a>,
    /// Numbers of glTF by ours.
    written: HashMap<u32, usize>,
    /// Which nodes of glTF hang on others.
    pub children: HashSet<usize>,
    /// Skins of glTF.
    pub skins: Vec<Value>,
    /// Nodes of glTF with a mesh that morphs, and our nodes with its weights.
    morphing: Vec<(usize, u32)>,
}

/// The accessors of what bends a mesh.
pub(super) struct WrittenDeformer {
    /// Attributes beside those of the mesh at rest.
    pub attributes: Vec<(String, Value)>,
    /// Morph targets.
    pub targets: Vec<Value>,
    /// Number of the skin's matrices.
    matrices: Option<usize>,
}

impl<'a> MovingNodes<'a> {
    /// Prepares the animations of a scene for writing.
    pub fn new(d: &'a Description, timeline: &'a Timeline<'a>) -> Self {
        MovingNodes { d, timeline, written: HashMap::new(), children: HashSet::new(), skins: Vec::new(), morphing: Vec::new() }
    }

    /// Whether key frames move a node, and nothing else: a free one has no place of its own.
    pub fn holds(&self, node: u32) -> bool {
        self.timeline.moves(node) && !self.is_free(node)
    }

    /// Whether somebody else says where a node is.
    fn is_free(&self, node: u32) -> bool {
        let mut chain = std::iter::successors(Some(node), |n| self.d.nodes[*n as usize].parent).take(self.d.nodes.len());
        chain.any(|n| self.d.nodes[n as usize].free)
    }

    /// Whether all that a deformer hangs on can be written.
    pub fn can_bend(&self, deformer: &Deformer) -> bool {
        let joints = deformer.skin.iter().flat_map(|s| &s.joints);
        !self.is_free(deformer.node) && !joints.copied().any(|j| self.is_free(j))
    }

    /// Writes a mesh that bends: a node of its own below that of its deformer.
    pub fn bend(&mut self, deformer: &Deformer, written: &WrittenDeformer, nodes: &mut Vec<Value>, mesh: usize, name: &str) {
        let mut node = json!({ "name": name, "mesh": mesh });
        if !deformer.targets.is_empty() {
            node["weights"] = json!(deformer.weights);
        }
        if let (Some(skin), Some(matrices)) = (&deformer.skin, written.matrices) {
            let joints: Vec<usize> = skin.joints.iter().map(|j| self.node(*j, nodes)).collect();
            node["skin"] = json!(self.skins.len());
            self.skins.push(json!({ "joints": joints, "inverseBindMatrices": matrices }));
        }
        self.hang(deformer.node, nodes, node);
        if !deformer.targets.is_empty() {
            self.morphing.push((nodes.len() - 1, deformer.node));
        }
    }

    /// Writes something that hangs on a node, and the node with all it hangs on.
    pub fn hang(&mut self, node: u32, nodes: &mut Vec<Value>, thing: Value) {
        let parent = self.node(node, nodes);
        nodes.push(thing);
        self.adopt(parent, nodes);
    }

    /// Puts the last node below another.
    fn adopt(&mut self, parent: usize, nodes: &mut [Value]) {
        let child = nodes.len() - 1;
        self.children.insert(child);
        match nodes[parent].get_mut("children").and_then(Value::as_array_mut) {
            Some(all) => all.push(json!(child)),
            None => nodes[parent]["children"] = json!([child]),
        }
    }

    fn node(&mut self, node: u32, nodes: &mut Vec<Value>) -> usize {
        if let Some(number) = self.written.get(&node) {
            return *number;
        }
        let own = &self.d.nodes[node as usize];
        let parent = own.parent.map(|parent| self.node(parent, nodes));
        let channels = self.d.animations.iter().flat_map(|a| &a.channels);
        let keyed = channels.filter(|c| c.property != AnimatedProperty::MorphWeights).any(|c| c.node == node as usize);
        let mut json = json!({ "name": own.name });
        match own.rest {
            Local::Matrix(m) if !keyed => json["matrix"] = json!(Mat4::from(m).to_cols_array()),
            // Key frames move the parts of a transform, not a matrix.
            Local::Matrix(m) => {
                let (scale, rotation, translation) = m.to_scale_rotation_translation();
                json["translation"] = json!(translation.to_array());
                json["rotation"] = json!(rotation.to_array());
                json["scale"] = json!(scale.to_array());
            }
            Local::Parts(p) => {
                json["translation"] = json!(p.translation.to_array());
                json["rotation"] = json!(p.rotation.to_array());
                json["scale"] = json!(p.scale.to_array());
            }
        }
        nodes.push(json);
        let number = nodes.len() - 1;
        if let Some(parent) = parent {
            self.adopt(parent, nodes);
        }
        self.written.insert(node, number);
        number
    }

    /// The animations of all nodes that were written, and what is said of them in extras.
    pub fn animations(&self, w: &mut Writer) -> (Vec<Value>, Value) {
        let (mut all, mut playing) = (Vec::new(), Vec::new());
        for (number, animation) in self.d.animations.iter().enumerate() {
            let (mut channels, mut samplers) = (Vec::new(), Vec::new());
            for channel in animation.channels.iter().filter(|c| !c.times_s.is_empty()) {
                let own =
                    || self.written.iter().filter(|(n, _)| **n as usize == channel.node).map(|(_, written)| *written).collect();
                let morphing = || self.morphing.iter().filter(|(_, n)| *n as usize == channel.node).map(|m| m.0).collect();
                let (path, width, targets): (_, _, Vec<usize>) = match channel.property {
                    AnimatedProperty::Translation => ("translation", 3, own()),
                    AnimatedProperty::Rotation => ("rotation", 4, own()),
                    AnimatedProperty::Scale => ("scale", 3, own()),
                    AnimatedProperty::MorphWeights => ("weights", 1, morphing()),
                };
                if targets.is_empty() {
                    continue;
                }
                let interpolation = match channel.interpolation {
                    KeyInterpolation::Step => "STEP",
                    KeyInterpolation::Linear => "LINEAR",
                    KeyInterpolation::Cubic => "CUBICSPLINE",
                };
                // Times of glTF rise strictly: a jump takes the least time there is.
                let mut times = channel.times_s.clone();
                for i in 1..times.len() {
                    times[i] = times[i].max(times[i - 1].next_up());
                }
                let input = w.numbers(&times, 1);
                (w.accessors[input]["min"], w.accessors[input]["max"]) = (json!([times[0]]), json!([times[times.len() - 1]]));
                let output = w.numbers(&channel.values, width);
                for node in targets {
                    channels.push(json!({ "sampler": samplers.len(), "target": { "node": node, "path": path } }));
                }
                samplers.push(json!({ "input": input, "output": output, "interpolation": interpolation }));
            }
            if !channels.is_empty() {
                if self.d.playing.animations.contains(&number) {
                    playing.push(all.len());
                }
                all.push(json!({ "name": animation.name, "channels": channels, "samplers": samplers }));
            }
        }
        let ending = match self.d.playing.ending {
            Extrapolation::Clamp => "clamp",
            Extrapolation::Loop => "loop",
        };
        (all, json!({ "animations": playing, "ending": ending }))
    }
}

impl Writer {
    /// Joints, weights and morph targets of a mesh with so many positions.
    pub(super) fn deformer(&mut self, deformer: &Deformer, positions: usize) -> WrittenDeformer {
        let mut written = WrittenDeformer { attributes: vec![], targets: vec![], matrices: None };
        if let Some(skin) = &deformer.skin {
            // Four influences to an attribute.
            for set in 0..skin.per_corner.div_ceil(4) {
                let of = |corner: &[(u16, f32)], k: usize| corner.get(4 * set + k).copied().unwrap_or((0, 0.0));
                let corners = || skin.influences.chunks_exact(skin.per_corner).take(positions);
                let joints: Vec<u8> =
                    corners().flat_map(|c| std::array::from_fn::<_, 4, _>(|k| of(c, k).0)).flat_map(u16::to_le_bytes).collect();
                let view = self.view(joints, Some(34_962));
                self.accessors.push(json!({ "bufferView": view, "componentType": 5123, "count": positions, "type": "VEC4" }));
                written.attributes.push((format!("JOINTS_{set}"), json!(self.accessors.len() - 1)));
                let weights: Vec<[f32; 4]> = corners().map(|c| std::array::from_fn(|k| of(c, k).1)).collect();
                written.attributes.push((format!("WEIGHTS_{set}"), json!(self.vectors(&weights))));
            }
            let matrix =
                |i: usize| Mat4::from(skin.joint_from_mesh.get(i).copied().unwrap_or(Affine3A::IDENTITY)).to_cols_array();
            let numbers: Vec<f32> = (0..skin.joints.len()).flat_map(matrix).collect();
            let view = self.view(numbers.iter().flat_map(|v| v.to_le_bytes()), None);
            self.accessors.push(json!({ "bufferView": view, "componentType": 5126, "count": skin.joints.len(), "type": "MAT4" }));
            written.matrices = Some(self.accessors.len() - 1);
        }
        for target in &deformer.targets {
            let mut json = json!({});
            // An attribute at least: what moves nothing is written as zeros.
            let zeros = vec![Vec3::ZERO; positions];
            let moved = if target.positions.is_empty() { &zeros } else { &target.positions };
            for (name, list) in [("POSITION", moved), ("NORMAL", &target.normals), ("TANGENT", &target.tangents)] {
                if list.is_empty() {
                    continue;
                }
                let number = self.vectors(&list.iter().map(|v| v.to_array()).collect::<Vec<_>>());
                if name == "POSITION" {
                    let bounds = crate::bvh::Bounds::around(list.iter().copied());
                    self.accessors[number]["min"] = json!(bounds.min.to_array());
                    self.accessors[number]["max"] = json!(bounds.max.to_array());
                }
                json[name] = json!(number);
            }
            written.targets.push(json);
        }
        written
    }
}

#[cfg(test)]
mod tests {
    use crate::motion::Motion;
    use crate::scene::Shape;
    use crate::{Description, builtin, load};
    use glam::{Affine3A, Vec3};

    /// Where a point of each mesh is at a moment.
    fn places(d: &Description, time_s: f64) -> Vec<Vec3> {
        let timeline = d.timeline();
        let place = |o: &crate::Object| match (o.shape, o.motion) {
            (Shape::Mesh { .. }, Motion::Carried { node }) => Some(timeline.world(node, time_s)),
            (Shape::Mesh { world_from_mesh, .. }, _) => Some(world_from_mesh),
            (Shape::Quad(_), _) => Some(Affine3A::IDENTITY),
            _ => None,
        };
        d.objects.iter().filter_map(place).map(|p| p.transform_point3(Vec3::new(0.3, 0.2, -0.1))).collect()
    }

    /// Poses of all that bends, by the objects' names.
    fn poses(d: &Description, time_s: f64) -> Vec<(String, Vec<Vec3>, Vec<Vec3>)> {
        let timeline = d.timeline();
        let pose = |o: &crate::Object| match (o.shape, o.motion) {
            (Shape::Mesh { mesh, .. }, Motion::Deformed { deformer }) => {
                let pose = timeline.pose(&d.deformers[deformer as usize], &d.meshes[mesh as usize], time_s);
                Some((o.name.clone(), pose.positions, pose.normals))
            }
            _ => None,
        };
        let mut all: Vec<_> = d.objects.iter().filter_map(pose).collect();
        all.sort_by(|a, b| a.0.cmp(&b.0));
        all
    }

    #[test]
    fn what_bends_is_read_back_bending_as_it_did() {
        // A rod of three joints with two materials, and blend shapes of which one moves nothing.
        let text = r#"#usda 1.0
( metersPerUnit = 1
  timeCodesPerSecond = 10 )
def SkelRoot "Root" {
    double3 xformOp:translate.timeSamples = { 0: (0, 0, 0), 20: (0.3, 1, -2) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    rel skel:skeleton = </Root/Bones>
    def Skeleton "Bones" {
        rel skel:animationSource = <Turn>
        uniform token[] joints = ["a", "a/b", "a/b/c"]
        uniform matrix4d[] bindTransforms = [( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1) ), ( (1,0,0,0), (0,1,0,0), (0,0,1,0), (1,0,0,1) ), ( (0.6,0.8,0,0), (-0.8,0.6,0,0), (0,0,1,0), (2,0,0,1) )]
        def SkelAnimation "Turn" {
            uniform token[] joints = ["a/b", "a/b/c"]
            float3[] translations.timeSamples = { 0: [(1, 0, 0), (1, 0, 0)], 7: [(1.3, 0, 0), (1, 0.1, 0)] }
            half3[] scales = [(1, 1, 1), (1, 2, 1)]
            quatf[] rotations.timeSamples = { 3: [(1, 0, 0, 0), (1, 0, 0, 0)], 15: [(0.6, 0, 0, 0.8), (0.28, 0.96, 0, 0)] }
            uniform token[] blendShapes = ["up", "none"]
            float[] blendShapeWeights.timeSamples = { 0: [0.1, 1], 9: [0.9, 1] }
        }
    }
    def Mesh "Skin" {
        int[] faceVertexCounts = [4, 3]
        int[] faceVertexIndices = [0, 1, 4, 3, 1, 2, 4]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0.1), (0, 1, 0), (1.5, 1, 0.3)]
        uniform token[] skel:blendShapes = ["none", "up"]
        rel skel:blendShapeTargets = [<none>, <up>]
        def BlendShape "none" { uniform vector3f[] offsets = [] }
        def BlendShape "up" { uniform vector3f[] offsets = [(0, 2, 0)]
            uniform int[] pointIndices = [1] }
        int[] primvars:skel:jointIndices = [0, 1, 2, 0, 1, 2, 1, 2, 0, 0, 1, 2, 2, 1, 0] ( interpolation = "vertex" elementSize = 3 )
        float[] primvars:skel:jointWeights = [1, 0, 0, 0.3, 0.4, 0.3, 0.1, 0.7, 0.2, 0.9, 0.1, 0, 0.3, 0.3, 0.3] ( interpolation = "vertex" elementSize = 3 )
    }
    def Mesh "Shape" {
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 1, 0.1)]
        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1)] ( interpolation = "vertex" )
        uniform token[] skel:blendShapes = ["up"]
        rel skel:blendShapeTargets = [<up>]
        def BlendShape "up" { uniform vector3f[] offsets = [(0, 2, 0), (1, 1, 1), (0, 0.1, 0)]
            uniform vector3f[] normalOffsets = [(0, 2, 0), (1, 1, 1), (0, 0.1, 0)] }
    }
}"#;
        let none = |_: &str| Err("no files".into());
        let before = load::usd::load(text.into(), "x.usda", &none).unwrap();
        assert!(before.warnings.is_empty() && before.deformers.len() == 2, "{:?}", before.warnings);
        let written = super::super::gltf(&before);
        assert!(written.warnings.is_empty(), "{:?}", written.warnings);
        let after = load::gltf::load(&written.container(), "x.glb", &none).unwrap();
        assert!(after.warnings.is_empty(), "{:?}", after.warnings);
        for time_s in [0.0, 0.2, 0.65, 0.9, 1.4, 3.0] {
            let (a, b) = (poses(&before, time_s), poses(&after, time_s));
            assert_eq!(a.iter().map(|p| &p.0).collect::<Vec<_>>(), ["Shape", "Skin"]);
            // To the last bit.
            assert_eq!(a, b, "{time_s} s");
        }
        assert_ne!(poses(&before, 0.2), poses(&before, 0.65));
    }

    #[test]
    fn what_moves_is_written_and_read_back_moving() {
        for name in ["propeller", "rolling-ball", "moving-bars", "night"] {
            let before = builtin::named(name).unwrap();
            let written = super::super::gltf(&before);
            let after = load::gltf::load(&written.container(), "x.glb", &|_| Err("no files".into())).unwrap();
            assert!(after.warnings.is_empty(), "{:?}", after.warnings);
            assert_eq!((after.playing.ending, after.playing.animations.len()), (before.playing.ending, before.animations.len()));
            let end = before.animations.iter().map(|a| a.span_s()[1]).fold(0.0, f64::max);
            let mut moved = false;
            // One and a half times the longest: what repeats, repeats.
            for step in 0..8 {
                let time_s = 1.5 * end * f64::from(step) / 7.0;
                let (a, b) = (places(&before, time_s), places(&after, time_s));
                for p in &a {
                    // Balls become meshes: others stand elsewhere in the list.
                    let nearest = b.iter().map(|q| (*q - *p).length()).fold(f32::INFINITY, f32::min);
                    assert!(nearest < 1e-4 * p.length().max(1.0), "{name} at {time_s} s: {p} is {nearest} m off");
                }
                moved |= a.iter().zip(places(&before, 0.0)).any(|(p, q)| (*p - q).length() > 1e-3);
            }
            assert!(moved, "{name}");
        }
    }
}
