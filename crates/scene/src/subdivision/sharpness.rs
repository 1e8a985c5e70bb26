//! Creases and corners: which rule holds at an edge and a vertex, and how it weakens from level to level.
//!
//! Source: T. DeRose, M. Kass, T. Truong 1998, "Subdivision Surfaces in Character Animation" §3 and appendix B; where the rule of a vertex
//! changes within a level the two are blended by the mean of the fractional sharpness that ends there, as OpenSubdiv 3 does
//! (`Sdc::Crease::ComputeFractionalWeightAtVertex`). Sharpness falls by 1 a level (the uniform method, not Chaikin's).

use super::Value;
use super::topology::Topology;

/// Sharpness of a mesh's edges and vertices, as lists of those that have any.
#[derive(Clone, Debug, Default)]
pub(super) struct Sharp {
    /// Ends of edges and their sharpness, > 0.
    pub edges: Vec<([u32; 2], f32)>,
    /// Vertices and their sharpness, > 0.
    pub vertices: Vec<(u32, f32)>,
}

impl Sharp {
    /// Sharpness that creases and corners have left after one more level of subdivision (1 less, at least 0), where vertices keep their numbers and the vertex of edge `e` has number `first_edge_vertex + e`.
    pub fn weakened(&self, topology: &Topology, first_edge_vertex: u32) -> Sharp {
        let mut next = Sharp::default();
        for (ends, sharpness) in &self.edges {
            if let (Some(edge), true) = (topology.find(ends[0], ends[1]), *sharpness > 1.0) {
                next.edges.extend(ends.map(|end| ([end, first_edge_vertex + edge], sharpness - 1.0)));
            }
        }
        next.vertices.extend(self.vertices.iter().filter(|v| v.1 > 1.0).map(|(v, sharpness)| (*v, sharpness - 1.0)));
        next
    }
}

/// The rule of a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Rule {
    /// As on a smooth surface; also where a crease ends.
    Smooth,
    /// On a crease between two other vertices.
    Crease([u32; 2]),
    /// It stays where it is.
    Corner,
}

/// Sharpness by number, for one level.
pub(super) struct Sharpness {
    /// Of each edge; infinite where no surface goes on or where more than two faces meet.
    pub edges: Vec<f32>,
    vertices: Vec<f32>,
}

impl Sharpness {
    /// Sharpness of all edges and vertices of a mesh.
    pub fn new(topology: &Topology, sharp: &Sharp) -> Self {
        let infinite = |e: usize| if topology.is_manifold(e) { 0.0 } else { f32::INFINITY };
        let mut edges: Vec<f32> = (0..topology.edges.len()).map(infinite).collect();
        let mut vertices = vec![0.0f32; topology.vertex_count()];
        for (ends, sharpness) in &sharp.edges {
            if let Some(edge) = topology.find(ends[0], ends[1]) {
                let edge = &mut edges[edge as usize];
                *edge = edge.max(*sharpness);
            }
        }
        for (vertex, sharpness) in &sharp.vertices {
            let vertex = &mut vertices[*vertex as usize];
            *vertex = vertex.max(*sharpness);
        }
        Sharpness { edges, vertices }
    }

    /// The rule of a vertex where only what is sharper than `above` counts.
    pub fn rule(&self, topology: &Topology, vertex: usize, above: f32) -> Rule {
        if self.vertices[vertex] > above {
            return Rule::Corner;
        }
        let mut ends = [0; 2];
        let mut count = 0;
        for edge in topology.edges_at(vertex).iter().filter(|e| self.edges[**e as usize] > above) {
            if count < 2 {
                ends[count] = topology.other_end(*edge, vertex as u32);
            }
            count += 1;
        }
        match count {
            0 | 1 => Rule::Smooth,
            2 => Rule::Crease(ends),
            _ => Rule::Corner,
        }
    }

    /// What the rules of a vertex give, this level's and the next one's blended where they differ.
    pub fn blended<V: Value>(&self, topology: &Topology, vertex: usize, by: impl Fn(Rule) -> V) -> V {
        let (now, then) = (self.rule(topology, vertex, 0.0), self.rule(topology, vertex, 1.0));
        if now == then {
            return by(now);
        }
        let own = self.vertices[vertex];
        let at_edges = topology.edges_at(vertex).iter().map(|e| self.edges[*e as usize]);
        let ending = at_edges.chain([own]).filter(|s| *s > 0.0 && *s <= 1.0);
        let (sum, count) = ending.fold((0.0, 0), |(sum, n), s| (sum + f64::from(s), n + 1));
        let weight = if count == 0 { 0.0 } else { sum / f64::from(count) };
        by(now) * weight + by(then) * (1.0 - weight)
    }

    /// Whether normals differ on the two sides of an edge.
    pub fn is_crease(&self, edge: u32) -> bool {
        self.edges[edge as usize] >= 1.0
    }
}
