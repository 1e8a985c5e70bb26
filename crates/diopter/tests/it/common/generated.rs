//! glTF files that move, made here: a cart whose wheels turn, and a tail that a skin and a morph target bend.
// Each test file uses a part of it.
#![allow(dead_code)]

use serde_json::{Value, json};
use std::f32::consts::PI;

/// What a glTF file keeps in its buffer.
#[derive(Default)]
struct Buffer {
    binary: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    fn push(&mut self, bytes: &[u8], mut accessor: Value) -> usize {
        self.views.push(json!({"buffer": 0, "byteOffset": self.binary.len(), "byteLength": bytes.len()}));
        accessor["bufferView"] = json!(self.views.len() - 1);
        self.accessors.push(accessor);
        self.binary.extend(bytes);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        self.accessors.len() - 1
    }

    /// Numbers with `width` a value; `kind` is glTF's name for that many.
    fn floats(&mut self, kind: &str, width: usize, values: &[f32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let limit = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
            (0..width).map(|i| values.iter().skip(i).step_by(width).copied().reduce(pick).unwrap_or(0.0)).collect()
        };
        let accessor = json!({
            "componentType": 5126, "type": kind, "count": values.len() / width, "min": limit(f32::min), "max": limit(f32::max),
        });
        self.push(&bytes, accessor)
    }

    fn indices(&mut self, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.push(&bytes, json!({"componentType": 5123, "type": "SCALAR", "count": values.len()}))
    }

    fn joints(&mut self, values: &[u8]) -> usize {
        self.push(values, json!({"componentType": 5121, "type": "VEC4", "count": values.len() / 4}))
    }

    /// The whole file as `.glb`.
    fn file(self, mut json: Value) -> Vec<u8> {
        json["asset"] = json!({"version": "2.0"});
        json["scene"] = json!(0);
        json["buffers"] = json!([{"byteLength": self.binary.len()}]);
        json["bufferViews"] = json!(self.views);
        json["accessors"] = json!(self.accessors);
        diopter::scene::save::Gltf { json, binary: self.binary, warnings: vec![] }.container()
    }
}

fn paint(red: f32, green: f32, blue: f32) -> Value {
    json!({"pbrMetallicRoughness": {"baseColorFactor": [red, green, blue, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.9}})
}

/// A turn about z, as glTF's quaternion.
fn turn(angle: f32) -> [f32; 4] {
    [0.0, 0.0, (0.5 * angle).sin(), (0.5 * angle).cos()]
}

/// Adds a box to a list of corners and triangles.
fn add_box(positions: &mut Vec<f32>, indices: &mut Vec<u16>, half: [f32; 3]) {
    let first = (positions.len() / 3) as u16;
    for corner in 0..8 {
        positions.extend((0..3).map(|axis| if (corner >> axis) & 1 == 1 { half[axis] } else { -half[axis] }));
    }
    for [a, b, c, d] in [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]] {
        indices.extend([a, b, c, a, c, d].map(|i: u16| first + i));
    }
}

/// Times of the keys of both files, s; their last is their first.
const KEYS_S: [f32; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// A cart of 3 m that bounces; its wheels are crosses of 1 m that turn once a second.
pub fn cart() -> Vec<u8> {
    let mut buffer = Buffer::default();
    let (mut body, mut body_faces) = (vec![], vec![]);
    add_box(&mut body, &mut body_faces, [1.5, 0.3, 0.5]);
    let (mut wheel, mut wheel_faces) = (vec![], vec![]);
    add_box(&mut wheel, &mut wheel_faces, [0.5, 0.1, 0.05]);
    add_box(&mut wheel, &mut wheel_faces, [0.1, 0.5, 0.05]);
    let body = [buffer.floats("VEC3", 3, &body), buffer.indices(&body_faces)];
    let wheel = [buffer.floats("VEC3", 3, &wheel), buffer.indices(&wheel_faces)];
    let times = buffer.floats("SCALAR", 1, &KEYS_S);
    let turns: Vec<f32> = KEYS_S.iter().flat_map(|t| turn(2.0 * PI * t)).collect();
    let turns = buffer.floats("VEC4", 4, &turns);
    let bounces = buffer.floats("VEC3", 3, &[0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0]);
    let mesh = |[positions, indices]: [usize; 2], material: usize| json!({"primitives": [{"attributes": {"POSITION": positions}, "indices": indices, "material": material}]});
    buffer.file(json!({
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"name": "cart", "mesh": 0, "children": [1, 2]},
            {"name": "rear wheel", "mesh": 1, "translation": [-1.0, -0.4, 0.6]},
            {"name": "front wheel", "mesh": 1, "translation": [1.0, -0.4, 0.6]},
        ],
        "meshes": [mesh(body, 0), mesh(wheel, 1)],
        "materials": [paint(0.6, 0.15, 0.1), paint(0.1, 0.1, 0.1)],
        "animations": [{
            "name": "drive",
            "samplers": [{"input": times, "output": turns}, {"input": times, "output": bounces}],
            "channels": [
                {"sampler": 0, "target": {"node": 1, "path": "rotation"}},
                {"sampler": 0, "target": {"node": 2, "path": "rotation"}},
                {"sampler": 1, "target": {"node": 0, "path": "translation"}},
            ],
        }],
    }))
}

/// A tail of 3 m on three joints, which wags and swells within a second.
pub fn tail() -> Vec<u8> {
    const RINGS: usize = 13;
    let mut buffer = Buffer::default();
    let (mut positions, mut swelling, mut joints, mut weights, mut faces) = (vec![], vec![], vec![], vec![], vec![]);
    for ring in 0..RINGS {
        let x = 3.0 * ring as f32 / (RINGS - 1) as f32;
        let joint = (x as u8).min(2);
        let next = (joint + 1).min(2);
        let fraction = if joint == next { 0.0 } else { x - f32::from(joint) };
        for [y, z] in [[-0.2f32, -0.2f32], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]] {
            positions.extend([x, y, z]);
            swelling.extend([0.0, 0.5 * y, 0.5 * z]);
            joints.extend([joint, next, 0, 0]);
            weights.extend([1.0 - fraction, fraction, 0.0, 0.0]);
        }
    }
    for ring in 0..RINGS as u16 - 1 {
        for k in 0..4 {
            let [a, b] = [k, (k + 1) % 4].map(|k| 4 * ring + k);
            faces.extend([a, b, b + 4, a, b + 4, a + 4]);
        }
    }
    let end = 4 * (RINGS as u16 - 1);
    faces.extend([0, 2, 1, 0, 3, 2, end, end + 1, end + 2, end, end + 2, end + 3]);
    // From the mesh to the joints at rest: 1 m apart along x; columns one after the other.
    let binding: Vec<f32> =
        (0..3).flat_map(|j| [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -(j as f32), 0.0, 0.0, 1.0]).collect();
    let positions = buffer.floats("VEC3", 3, &positions);
    let swelling = buffer.floats("VEC3", 3, &swelling);
    let joints = buffer.joints(&joints);
    let weights = buffer.floats("VEC4", 4, &weights);
    let faces = buffer.indices(&faces);
    let binding = buffer.floats("MAT4", 16, &binding);
    let times = buffer.floats("SCALAR", 1, &KEYS_S);
    let wag = |buffer: &mut Buffer, angle: f32| {
        let turns: Vec<f32> = [0.0, angle, 0.0, -angle, 0.0].into_iter().flat_map(turn).collect();
        buffer.floats("VEC4", 4, &turns)
    };
    let wags = [0.3, 0.6, 0.9].map(|angle| wag(&mut buffer, angle));
    let swell = buffer.floats("SCALAR", 1, &[0.0, 1.0, 0.0, 1.0, 0.0]);
    buffer.file(json!({
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [
            {"name": "tail", "mesh": 0, "skin": 0},
            {"name": "root", "children": [2]},
            {"name": "middle", "translation": [1.0, 0.0, 0.0], "children": [3]},
            {"name": "tip", "translation": [1.0, 0.0, 0.0]},
        ],
        "meshes": [{
            "weights": [0.0],
            "primitives": [{
                "attributes": {"POSITION": positions, "JOINTS_0": joints, "WEIGHTS_0": weights}, "indices": faces, "material": 0,
                "targets": [{"POSITION": swelling}],
            }],
        }],
        "skins": [{"joints": [1, 2, 3], "inverseBindMatrices": binding}],
        "materials": [paint(0.7, 0.3, 0.05)],
        "animations": [{
            "name": "wag",
            "samplers": [
                {"input": times, "output": wags[0]}, {"input": times, "output": wags[1]}, {"input": times, "output": wags[2]},
                {"input": times, "output": swell},
            ],
            "channels": [
                {"sampler": 0, "target": {"node": 1, "path": "rotation"}},
                {"sampler": 1, "target": {"node": 2, "path": "rotation"}},
                {"sampler": 2, "target": {"node": 3, "path": "rotation"}},
                {"sampler": 3, "target": {"node": 0, "path": "weights"}},
            ],
        }],
    }))
}
