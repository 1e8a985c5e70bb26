//! Normals of the limit surface at the vertices of the last level.
//!
//! The faces around a vertex fall into fans between creases; each fan has a normal of its own, the cross product of two tangents: left eigenvectors
//! of the subdivision matrix. Sources: Halstead, Kass & DeRose 1993 (Catmull–Clark, interior); Hoppe et al. 1994 (Loop's, interior); at corners the
//! two edges. Across creases and boundaries Hoppe et al. and H. Biermann, A. Levin, D. Zorin 2000, "Piecewise smooth subdivision surfaces with
//! normal control", have masks for rules that they changed beside them; those of the rules used here are solved for below, and are the same where
//! the mesh is regular. Biermann et al. changed the rules because with many faces beside a crease there is no tangent plane: there, where the
//! tangents say nothing (they are parallel, or point against the faces) and for bilinear faces the mean of the faces' normals by angle stands in.

use super::refine::Weights;
use super::sharpness::{Rule, Sharpness};
use super::topology::Topology;
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Unit normals, and the number of the one at each corner of the faces.
pub(super) fn limit_normals(t: &Topology, sharpness: &Sharpness, points: &[DVec3], weights: Weights) -> (Vec<Vec3>, Vec<u32>) {
    let around = Around { t, sharpness, points, weights };
    let of_vertex = |v: usize| {
        let fans = around.fans(v);
        let normals: Vec<Vec3> = fans.iter().map(|fan| around.normal(v, fan, fans.len()).as_vec3()).collect();
        (fans, normals)
    };
    // One normal a vertex, and more where creases part the faces; in parts, for what is found on the way takes memory.
    const PART: usize = 1 << 16;
    let mut normals = vec![Vec3::ZERO; points.len()];
    let mut of_corner = t.faces.corners.clone();
    for first in (0..points.len()).step_by(PART) {
        let part: Vec<_> = (first..(first + PART).min(points.len())).into_par_iter().map(of_vertex).collect();
        for (i, (fans, found)) in part.into_iter().enumerate() {
            for (k, (fan, normal)) in fans.into_iter().zip(found).enumerate() {
                if k == 0 {
                    normals[first + i] = normal;
                    continue;
                }
                fan.iter().for_each(|c| of_corner[*c as usize] = normals.len() as u32);
                normals.push(normal);
            }
        }
    }
    (normals, of_corner)
}

struct Around<'a> {
    t: &'a Topology,
    sharpness: &'a Sharpness,
    points: &'a [DVec3],
    weights: Weights,
}

impl Around<'_> {
    /// Fans of corners between the creases at a vertex. A crease that ends there parts nothing.
    fn fans(&self, v: usize) -> Vec<Vec<u32>> {
        let creases = self.t.edges_at(v).iter().filter(|e| self.sharpness.is_crease(**e)).count();
        self.t.fans(v, |e| creases >= 2 && self.sharpness.is_crease(e))
    }

    fn point(&self, corner: u32) -> DVec3 {
        self.points[self.t.vertex(corner) as usize]
    }

    fn normal(&self, v: usize, fan: &[u32], fans: usize) -> DVec3 {
        let mean: DVec3 = fan.iter().map(|c| self.by_angle(*c)).sum();
        // As for the fans: what is sharp by 1 or more.
        let rule = self.sharpness.rule(self.t, v, 1.0 - f32::EPSILON);
        let closed = self.t.turned(fan[fan.len() - 1]) == Some(fan[0]);
        let tangents = match (self.weights, rule) {
            (Weights::Linear, _) => None,
            (_, Rule::Smooth) if fans == 1 && closed => Some(self.smooth(fan)),
            (_, Rule::Crease(_)) if fans <= 2 => self.along_crease(v, fan),
            (_, Rule::Corner) if !closed => {
                let (from, to) = self.ends(fan);
                Some([from - self.points[v], to - self.points[v]])
            }
            _ => None,
        };
        let mean = mean.normalize_or_zero();
        let by_mask = tangents.and_then(|[a, b]| a.normalize_or_zero().cross(b.normalize_or_zero()).try_normalize());
        match by_mask {
            Some(n) if n.dot(mean) > 0.0 => n,
            _ => mean.try_normalize().unwrap_or(DVec3::Z),
        }
    }

    /// The normal of the wedge of a face at a corner times its angle.
    fn by_angle(&self, corner: u32) -> DVec3 {
        let at = self.point(corner);
        let (a, b) = (self.point(self.t.next(corner)) - at, self.point(self.t.previous(corner)) - at);
        let n = a.cross(b);
        n.normalize_or_zero() * n.length().atan2(a.dot(b))
    }

    /// First and last neighbour of a fan.
    fn ends(&self, fan: &[u32]) -> (DVec3, DVec3) {
        (self.point(self.t.next(fan[0])), self.point(self.t.previous(fan[fan.len() - 1])))
    }

    /// Tangents of a vertex with faces all around.
    fn smooth(&self, fan: &[u32]) -> [DVec3; 2] {
        let n = fan.len() as f64;
        let angle = |i: usize| TAU * i as f64 / n;
        let mut tangents = [DVec3::ZERO; 2];
        for (i, corner) in fan.iter().enumerate() {
            let edge = self.point(self.t.next(*corner));
            let mut add = |edge_weights: [f64; 2], face: Option<(DVec3, [f64; 2])>| {
                for k in 0..2 {
                    tangents[k] += edge * edge_weights[k] + face.map_or(DVec3::ZERO, |(face, w)| face * w[k]);
                }
            };
            let here = [angle(i).cos(), angle(i).sin()];
            match self.weights {
                Weights::CatmullClark => {
                    let c = (TAU / n).cos();
                    let a = 1.0 + c + (PI / n).cos() * (2.0 * (9.0 + c)).sqrt();
                    let then = [angle(i + 1).cos(), angle(i + 1).sin()];
                    let face = self.point(self.t.opposite(*corner));
                    add(here.map(|w| w * a), Some((face, [here[0] + then[0], here[1] + then[1]])));
                }
                _ => add(here, None),
            }
        }
        tangents
    }

    /// Tangents along a crease, from the last to the first neighbour of a fan, and across it, into the fan; `None` where there is no tangent plane.
    fn along_crease(&self, v: usize, fan: &[u32]) -> Option<[DVec3; 2]> {
        let (from, to) = self.ends(fan);
        let at = self.points[v];
        let along = from - to;
        if fan.len() == 1 {
            // Its two edges say where one face lies.
            return Some([along, from + to - at * 2.0]);
        }
        // The mode sin(iθ) about the vertex: its eigenvalue λ, weights of inner edges and of faces, and what these bring to the equations of the
        // neighbour on the crease (`g`) and of the vertex (`h`): (λ − ½) w_neighbour = w_vertex / 8 + g, (λ − ¾) w_vertex = w_neighbour + h.
        let theta = PI / fan.len() as f64;
        let (s, c) = theta.sin_cos();
        let sines = 1.0 / (0.5 * theta).tan();
        let (lambda, edge, face, g, h) = match self.weights {
            Weights::CatmullClark => {
                let lambda = (5.0 + c + (0.5 * theta).cos() * (2.0 * (9.0 + c)).sqrt()) / 16.0;
                (lambda, 16.0 * lambda - 4.0, 1.0, lambda * s, sines * (6.0 * lambda - 1.0))
            }
            _ => (0.375 + 0.25 * c, 1.0, 0.0, s / 8.0, 0.375 * sines),
        };
        // The mode sin(2iθ) must fade faster than the crease, which halves: up to 3 quadrilaterals or 5 triangles.
        let most = if self.weights == Weights::CatmullClark { 3 } else { 5 };
        if fan.len() > most {
            return None;
        }
        let (p, q) = (lambda - 0.5, lambda - 0.75);
        let of_vertex = (g + p * h) / (p * q - 0.125);
        let of_neighbour = q * of_vertex - h;
        let mut across = at * of_vertex + (from + to) * of_neighbour;
        for (i, corner) in fan.iter().enumerate() {
            let (here, then) = ((i as f64 * theta).sin(), ((i + 1) as f64 * theta).sin());
            if i > 0 {
                across += self.point(self.t.next(*corner)) * (edge * here);
            }
            if face > 0.0 {
                across += self.point(self.t.opposite(*corner)) * (face * (here + then));
            }
        }
        Some([along, across])
    }
}
