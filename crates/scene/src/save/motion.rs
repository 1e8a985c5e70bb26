//! What moves, as nodes and animations of glTF: key frames on transforms are written as they are.
//!
//! Which animations run, and what happens after the last key, glTF cannot say: it is in the extras of the scene (`diopter_playing`), where our own reader finds
//! it.

use super::Writer;
use crate::motion::{AnimatedProperty, Ending, KeyInterpolation, Local, Timeline};
use crate::scene::Description;
use glam::Mat4;
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
}

impl<'a> MovingNodes<'a> {
    pub fn new(d: &'a Description, timeline: &'a Timeline<'a>) -> Self {
        MovingNodes { d, timeline, written: HashMap::new(), children: HashSet::new() }
    }

    /// Whether key frames move a node, and nothing else: a free one has no place of its own.
    pub fn holds(&self, node: u32) -> bool {
        let mut chain = std::iter::successors(Some(node), |n| self.d.nodes[*n as usize].parent).take(self.d.nodes.len());
        self.timeline.moves(node) && !chain.any(|n| self.d.nodes[n as usize].free)
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
                let Some(node) = u32::try_from(channel.node).ok().and_then(|n| self.written.get(&n)) else { continue };
                let (path, width) = match channel.property {
                    AnimatedProperty::Translation => ("translation", 3),
                    AnimatedProperty::Rotation => ("rotation", 4),
                    AnimatedProperty::Scale => ("scale", 3),
                    AnimatedProperty::MorphWeights => continue,
                };
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
                channels.push(json!({ "sampler": samplers.len(), "target": { "node": node, "path": path } }));
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
            Ending::Clamp => "clamp",
            Ending::Loop => "loop",
        };
        (all, json!({ "animations": playing, "ending": ending }))
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
