//! One level of subdivision: faces, and values at their vertices; and where values end up after infinitely many.
//!
//! New vertices are numbered: those of the old vertices, then one for each edge, then (of quadrilaterals) one for each face. The children of a
//! face follow each other, so that all channels of a mesh, whatever their vertices, have the same faces in the same order.
//!
//! Sources: E. Catmull & J. Clark 1978, "Recursively generated B-spline surfaces on arbitrary topological meshes"; C. Loop 1987, "Smooth
//! Subdivision Surfaces Based on Triangles", with J. Warren's weights; creases as DeRose, Kass & Truong 1998; limit positions: M. Halstead,
//! M. Kass, T. DeRose 1993, "Efficient, fair interpolation using Catmull-Clark surfaces" (interior), H. Hoppe et al. 1994, "Piecewise smooth
//! surface reconstruction" (Loop's), uniform cubic B-splines (1, 4, 1)/6 (creases and boundaries).

use super::Value;
use super::sharpness::{Rule, Sharpness};
use super::topology::{Faces, Topology};
use rayon::prelude::*;

/// By what new values are made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Weights {
    /// Bilinear: nothing is smoothed.
    Linear,
    CatmullClark,
    Loop,
}

/// Into what faces are split.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Split {
    /// A quadrilateral for each corner of a face.
    Quads,
    /// Four triangles for each triangle.
    Triangles,
}

/// Faces of the next level and the number of its vertices.
pub(super) fn faces(t: &Topology, split: Split) -> (Faces, usize) {
    let (vertices, edges) = (t.vertex_count() as u32, t.edges.len() as u32);
    let on_edge = |c: u32| vertices + t.edge_of[c as usize];
    let corners = 0..t.faces.corners.len() as u32;
    match split {
        Split::Quads => {
            let quad = |c: u32| {
                let center = vertices + edges + t.face_of[c as usize];
                [t.vertex(c), on_edge(c), center, on_edge(t.previous(c))]
            };
            (Faces::of_size(4, corners.flat_map(quad).collect()), vertices as usize + edges as usize + t.faces.len())
        }
        Split::Triangles => {
            let four = |c: u32| {
                let [a, b, c] = [c, c + 1, c + 2];
                let [ab, bc, ca] = [a, b, c].map(on_edge);
                let [a, b, c] = [a, b, c].map(|c| t.vertex(c));
                [a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca]
            };
            (Faces::of_size(3, corners.step_by(3).flat_map(four).collect()), vertices as usize + edges as usize)
        }
    }
}

/// Values at the vertices of the next level.
pub(super) fn values<V: Value>(t: &Topology, sharpness: &Sharpness, values: &[V], weights: Weights, split: Split) -> Vec<V> {
    let value = |v: u32| values[v as usize];
    let of_face = |f: usize| {
        let corners = t.faces.of(f);
        sum(corners.iter().map(|v| value(*v))) * (1.0 / corners.len() as f64)
    };
    let of_faces: Vec<V> = match split {
        Split::Quads => (0..t.faces.len()).into_par_iter().map(of_face).collect(),
        Split::Triangles => vec![],
    };
    let of_edge = |e: usize| {
        let [a, b] = t.edges[e].map(value);
        let middle = (a + b) * 0.5;
        let s = f64::from(sharpness.edges[e]);
        if weights == Weights::Linear || s >= 1.0 {
            return middle;
        }
        let beside = t.corners_of_edge(e);
        let smooth = match weights {
            Weights::CatmullClark => (a + b + sum(beside.iter().map(|c| of_faces[t.face_of[*c as usize] as usize]))) * 0.25,
            _ => (a + b) * 0.375 + sum(beside.iter().map(|c| value(t.vertex(t.previous(*c))))) * 0.125,
        };
        smooth * (1.0 - s) + middle * s
    };
    let of_vertex = |v: usize| {
        let old = values[v];
        if weights == Weights::Linear {
            return old;
        }
        sharpness.blended(t, v, |rule| match rule {
            Rule::Corner => old,
            Rule::Crease([a, b]) => old * 0.75 + (value(a) + value(b)) * 0.125,
            Rule::Smooth => {
                let n = t.edges_at(v).len() as f64;
                if n == 0.0 {
                    return old;
                }
                let edges = sum(t.edges_at(v).iter().map(|e| value(t.other_end(*e, v as u32))));
                match weights {
                    Weights::CatmullClark => {
                        let centers = sum(t.corners_at(v).iter().map(|c| of_faces[t.face_of[*c as usize] as usize]));
                        old * ((n - 2.0) / n) + (edges + centers) * (1.0 / (n * n))
                    }
                    _ => old * (1.0 - n * beta(n)) + edges * beta(n),
                }
            }
        })
    };
    let mut all = Vec::with_capacity(values.len() + t.edges.len() + of_faces.len());
    all.par_extend((0..values.len()).into_par_iter().map(of_vertex));
    all.par_extend((0..t.edges.len()).into_par_iter().map(of_edge));
    all.extend(of_faces);
    all
}

/// Values on the limit surface. Of Catmull–Clark's scheme all faces must be quadrilaterals, as they are from level 1 on. Creases that are still
/// sharp by 1 or more count as infinitely sharp, weaker ones are blended by their sharpness.
pub(super) fn limits<V: Value>(t: &Topology, sharpness: &Sharpness, values: &[V], weights: Weights) -> Vec<V> {
    let value = |v: u32| values[v as usize];
    let of_vertex = |v: usize| {
        let old = values[v];
        sharpness.blended(t, v, |rule| match rule {
            Rule::Corner => old,
            Rule::Crease([a, b]) => (value(a) + old * 4.0 + value(b)) * (1.0 / 6.0),
            Rule::Smooth => {
                let n = t.edges_at(v).len() as f64;
                if n == 0.0 {
                    return old;
                }
                let edges = sum(t.edges_at(v).iter().map(|e| value(t.other_end(*e, v as u32))));
                match weights {
                    Weights::CatmullClark => {
                        let across = sum(t.corners_at(v).iter().map(|c| value(t.vertex(t.opposite(*c)))));
                        (old * (n * n) + edges * 4.0 + across) * (1.0 / (n * (n + 5.0)))
                    }
                    _ => {
                        let w = 1.0 / (n + 3.0 / (8.0 * beta(n)));
                        old * (1.0 - n * w) + edges * w
                    }
                }
            }
        })
    };
    match weights {
        Weights::Linear => values.to_vec(),
        _ => (0..values.len()).into_par_iter().map(of_vertex).collect(),
    }
}

/// Loop's weight of a neighbour in Warren's form: 3/16 of three, else 3 / (8 n).
fn beta(n: f64) -> f64 {
    if n == 3.0 { 3.0 / 16.0 } else { 3.0 / (8.0 * n) }
}

fn sum<V: Value>(values: impl Iterator<Item = V>) -> V {
    values.fold(V::default(), |a, b| a + b)
}
