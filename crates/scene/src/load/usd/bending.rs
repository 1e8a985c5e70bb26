//! What bends the points of a mesh, as its prim and its blend shapes say it, and the same for the vertices of the mesh that is drawn.

use super::layer::{Key, Value};
use super::stage::{Prim, Stage};
use crate::SceneError;
use crate::motion::{Target, influences_summing_to_one};
use crate::shape::Mesh;
use crate::subdivision::{VERTEX_LANES, smooth_normals};
use glam::Vec3;
use std::sync::Arc;

type Read<T> = Result<T, SceneError>;

/// Most joints that hold a vertex of a subdivided mesh: the heaviest count.
const MOST_INFLUENCES: usize = 12;
/// Most numbers that bend all vertices of a subdivided mesh: a gigabyte.
const MOST_NUMBERS: usize = 1 << 28;

/// What bends a mesh, point by point.
#[derive(Default)]
pub struct Bending {
    /// Joint and weight, `per_point` for each point; empty of what has no skin.
    influences: Vec<(u16, f32)>,
    per_point: usize,
    /// Of all blend shapes one after the other, each with its in-between shapes by rising weight.
    shapes: Vec<Offsets>,
    /// For each blend shape the weights at which its `shapes` are seen alone.
    weights_of: Vec<Vec<f32>>,
}

/// What a blend shape adds to the points of a mesh.
#[derive(Default)]
struct Offsets {
    positions: Vec<Vec3>,
    /// Empty where the file says none.
    normals: Vec<Vec3>,
}

/// The same for the vertices of a mesh, as the renderer has it.
pub struct VertexBending {
    pub influences: Vec<(u16, f32)>,
    pub per_vertex: usize,
    pub targets: Vec<Target>,
    pub weights_of: Vec<Vec<f32>>,
}

fn vectors(stage: &Stage, prim: &Prim, name: &str) -> Read<Vec<Vec3>> {
    let numbers = stage.value(prim, name)?.and_then(|v| v.floats()).unwrap_or_else(|| Arc::new([]));
    Ok(numbers.as_chunks().0.iter().map(|v| Vec3::from_array(*v)).collect())
}

/// Reads what bends the points of a mesh. What does not fit the mesh is left out.
pub fn read(
    stage: &Stage,
    prim: &Prim,
    shapes: &[Option<Arc<Prim>>],
    points: usize,
    left_out: &mut Vec<&'static str>,
) -> Read<Option<Bending>> {
    let mut bending = Bending::default();
    if let Some(indices) = stage.value(prim, "primvars:skel:jointIndices")?.and_then(|v| v.ints()) {
        let weights = stage.value(prim, "primvars:skel:jointWeights")?.and_then(|v| v.floats());
        let said = stage.property_field(prim, "primvars:skel:jointIndices", Key::Interpolation)?;
        // One set for the whole mesh holds it as a rigid body.
        let is_rigid = said.as_ref().and_then(Value::text).is_some_and(|t| &**t == "constant");
        match weights.filter(|w| w.len() == indices.len() && points > 0) {
            Some(weights) if is_rigid || indices.len() % points == 0 && !indices.is_empty() => {
                let all: Vec<(u16, f32)> = indices
                    .iter()
                    .zip(weights.iter())
                    .map(|(i, w)| u16::try_from(*i).map_or((0, 0.0), |i| (i, if w.is_finite() { *w } else { 0.0 })))
                    .collect();
                bending.per_point = if is_rigid { all.len() } else { all.len() / points };
                bending.influences = if is_rigid { all.repeat(points) } else { all };
                if bending.per_point > 0 {
                    bending.influences.chunks_exact_mut(bending.per_point).for_each(influences_summing_to_one);
                }
            }
            _ => left_out.push("skins that do not fit their mesh"),
        }
    }
    for shape in shapes {
        let mut all = vec![(1.0, Offsets::default())];
        if let Some(shape) = shape {
            let which = stage.value(shape, "pointIndices")?.and_then(|v| v.ints()).filter(|i| !i.is_empty());
            let offsets = |name: &str, normals: &str| -> Read<Option<Offsets>> {
                Ok(spread([vectors(stage, shape, name)?, vectors(stage, shape, normals)?], which.as_deref(), points))
            };
            match offsets("offsets", "normalOffsets")? {
                Some(offsets) => all[0].1 = offsets,
                None => left_out.push("blend shapes that do not fit their mesh"),
            }
            for name in stage.inbetweens(shape) {
                let weight = stage.property_field(shape, &name, Key::Weight)?.and_then(|v| v.number()).map(|w| w as f32);
                // At 0 there is nothing and at 1 the shape itself; the first of several at a weight counts.
                let is_new = |w: f32| w.is_finite() && w.abs() > 1e-6 && all.iter().all(|(other, _)| (other - w).abs() > 1e-6);
                match (weight.filter(|w| is_new(*w)), offsets(&name, &format!("{name}:normalOffsets"))?) {
                    (Some(weight), Some(offsets)) => all.push((weight, offsets)),
                    (None, _) => left_out.push("in-between shapes without a weight of their own"),
                    (_, None) => left_out.push("in-between shapes that do not fit their mesh"),
                }
            }
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        bending.weights_of.push(all.iter().map(|(weight, _)| *weight).collect());
        bending.shapes.extend(all.into_iter().map(|(_, offsets)| offsets));
    }
    Ok((!bending.influences.is_empty() || !bending.shapes.is_empty()).then_some(bending))
}

/// Offsets of positions and of normals of the points with these numbers (of all in order without) as those of all points; `None` where they do not fit.
fn spread([moved, normals]: [Vec<Vec3>; 2], which: Option<&[i32]>, points: usize) -> Option<Offsets> {
    let number = |k: usize| which.map_or(Some(k), |w| w.get(k).and_then(|i| usize::try_from(*i).ok()));
    let fits = (0..moved.len()).all(|k| number(k).is_some_and(|i| i < points)) && moved.iter().all(|v| v.is_finite());
    let spread = |list: &[Vec3]| {
        let mut all = vec![Vec3::ZERO; points];
        list.iter().enumerate().for_each(|(k, v)| all[number(k).unwrap_or(0)] = *v);
        all
    };
    let has_normals = normals.len() == moved.len() && normals.iter().all(|v| v.is_finite());
    fits.then(|| Offsets { positions: spread(&moved), normals: if has_normals { spread(&normals) } else { vec![] } })
}

impl Bending {
    /// What bends vertices, by the point of each.
    pub fn of_vertices(&self, points: &[u32], mesh: &Mesh) -> VertexBending {
        let gather = |list: &[Vec3]| if list.is_empty() { vec![] } else { points.iter().map(|p| list[*p as usize]).collect() };
        let n = self.per_point;
        let targets = self.shapes.iter().map(|s| Target {
            positions: gather(&s.positions),
            normals: if mesh.normals.is_empty() { vec![] } else { gather(&s.normals) },
            tangents: vec![],
        });
        VertexBending {
            influences: points.iter().flat_map(|p| &self.influences[*p as usize * n..][..n]).copied().collect(),
            per_vertex: n,
            targets: targets.collect(),
            weights_of: self.weights_of.clone(),
        }
    }

    /// Joints that hold a point, rising.
    fn used_joints(&self) -> Vec<u16> {
        let mut used: Vec<u16> = self.influences.iter().filter(|i| i.1 != 0.0).map(|i| i.0).collect();
        used.sort_unstable();
        used.dedup();
        used
    }

    /// Whether the numbers of all vertices of a subdivided mesh would be too many.
    pub fn is_too_large(&self, vertices: usize) -> bool {
        let lanes = self.used_joints().len() + 3 * self.shapes.len();
        vertices.saturating_mul(lanes.next_multiple_of(VERTEX_LANES)) > MOST_NUMBERS
    }

    /// Weights of all joints that are used, then offsets of all shapes, as values of points that are subdivided.
    pub fn lanes(&self, points: usize) -> Vec<Vec<[f32; VERTEX_LANES]>> {
        let joints = self.used_joints();
        let count = joints.len() + 3 * self.shapes.len();
        let mut all = vec![vec![[0.0; VERTEX_LANES]; points]; count.div_ceil(VERTEX_LANES)];
        let mut add = |lane: usize, point: usize, v: f32| all[lane / VERTEX_LANES][point][lane % VERTEX_LANES] += v;
        for (i, (joint, weight)) in self.influences.iter().enumerate().filter(|(_, i)| i.1 != 0.0) {
            add(joints.partition_point(|j| j < joint), i / self.per_point, *weight);
        }
        for (s, shape) in self.shapes.iter().enumerate() {
            for (point, offset) in shape.positions.iter().enumerate() {
                (0..3).for_each(|k| add(joints.len() + 3 * s + k, point, offset[k]));
            }
        }
        all
    }

    /// What bends the vertices of a subdivided mesh, from subdivided [`Bending::lanes`] and the position of each vertex in them.
    pub fn of_fine_vertices(&self, lanes: &[Vec<[f32; VERTEX_LANES]>], positions: &[u32], mesh: &Mesh) -> VertexBending {
        let joints = self.used_joints();
        let at = |lane: usize, position: u32| lanes[lane / VERTEX_LANES][position as usize][lane % VERTEX_LANES];
        let mut bending =
            VertexBending { influences: vec![], per_vertex: 0, targets: vec![], weights_of: self.weights_of.clone() };
        if !joints.is_empty() {
            bending.per_vertex = joints.len().min(MOST_INFLUENCES);
            for position in positions {
                let weights = joints.iter().enumerate().map(|(k, joint)| (*joint, at(k, *position)));
                let mut own: Vec<(u16, f32)> = weights.filter(|i| i.1 > 0.0).collect();
                own.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
                own.resize(bending.per_vertex, (0, 0.0));
                influences_summing_to_one(&mut own);
                bending.influences.extend(own);
            }
        }
        for s in 0..self.shapes.len() {
            let lane = joints.len() + 3 * s;
            let positions: Vec<Vec3> =
                positions.iter().map(|p| Vec3::from_array(std::array::from_fn(|k| at(lane + k, *p)))).collect();
            if positions.iter().all(|p| *p == Vec3::ZERO) {
                bending.targets.push(Target::default());
                continue;
            }
            let mut moved = Mesh { positions: mesh.positions.clone(), triangles: mesh.triangles.clone(), ..Mesh::default() };
            let before = smooth_normals(&moved);
            moved.positions.iter_mut().zip(&positions).for_each(|(p, d)| *p += *d);
            let normals = smooth_normals(&moved).iter().zip(&before).map(|(after, before)| *after - *before).collect();
            bending.targets.push(Target { positions, normals, tangents: vec![] });
        }
        bending
    }
}
