//! Which faces, edges and vertices of a polygon mesh touch each other.
//!
//! A *corner* is a place in the list of face corners; it stands for the vertex there, for the edge from it to the next corner of its face, and
//! for the wedge of its face at that vertex. All lists are in a fixed order, so that results do not depend on the number of threads.

/// Polygons: `corners[starts[f]..starts[f + 1]]` are the vertices of face `f`, counter-clockwise seen from outside.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Faces {
    pub starts: Vec<u32>,
    pub corners: Vec<u32>,
}

impl Faces {
    /// Faces that all have the same number of corners.
    pub fn of_size(size: usize, corners: Vec<u32>) -> Self {
        Faces { starts: (0..=corners.len() / size).map(|f| (f * size) as u32).collect(), corners }
    }

    /// Number of faces.
    pub fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Vertices of a face, in order.
    pub fn of(&self, face: usize) -> &[u32] {
        &self.corners[self.starts[face] as usize..self.starts[face + 1] as usize]
    }
}

/// Lists of numbers, one for each of some keys.
pub(super) struct Buckets {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Buckets {
    /// Sorts (key, item) pairs by key; the order of the items of a key is kept.
    pub fn new(keys: usize, pairs: impl Iterator<Item = (u32, u32)> + Clone) -> Self {
        let mut starts = vec![0u32; keys + 1];
        pairs.clone().for_each(|(key, _)| starts[key as usize + 1] += 1);
        for k in 0..keys {
            starts[k + 1] += starts[k];
        }
        let mut next = starts.clone();
        let mut items = vec![0u32; starts[keys] as usize];
        for (key, item) in pairs {
            let at = &mut next[key as usize];
            items[*at as usize] = item;
            *at += 1;
        }
        Buckets { starts, items }
    }

    /// Items of a key, in their order.
    pub fn of(&self, key: usize) -> &[u32] {
        &self.items[self.starts[key] as usize..self.starts[key + 1] as usize]
    }
}

/// A mesh with its edges.
pub(super) struct Topology {
    pub faces: Faces,
    /// The face that each corner belongs to.
    pub face_of: Vec<u32>,
    /// The edge from each corner to the next one of its face.
    pub edge_of: Vec<u32>,
    /// Ends of each edge, the smaller number first; in ascending order.
    pub edges: Vec<[u32; 2]>,
    edge_corners: Buckets,
    vertex_edges: Buckets,
    vertex_corners: Buckets,
}

impl Topology {
    /// Finds the edges of faces whose corners are all below `vertices`.
    pub fn new(faces: Faces, vertices: usize) -> Self {
        let count = faces.corners.len();
        let mut face_of = vec![0u32; count];
        for f in 0..faces.len() {
            face_of[faces.starts[f] as usize..faces.starts[f + 1] as usize].fill(f as u32);
        }
        let next = |c: u32| {
            let f = face_of[c as usize] as usize;
            if c + 1 == faces.starts[f + 1] { faces.starts[f] } else { c + 1 }
        };
        let ends = |c: u32| {
            let (a, b) = (faces.corners[c as usize], faces.corners[next(c) as usize]);
            [a.min(b), a.max(b)]
        };
        // Corners by the smaller end of their edge, then by the larger: those of one edge follow each other.
        let mut by_end = Buckets::new(vertices, (0..count as u32).map(|c| (ends(c)[0], c)));
        let (mut edges, mut edge_of) = (Vec::with_capacity(count / 2), vec![0u32; count]);
        for v in 0..vertices {
            let range = by_end.starts[v] as usize..by_end.starts[v + 1] as usize;
            let list = &mut by_end.items[range];
            list.sort_unstable_by_key(|c| (ends(*c)[1], *c));
            for c in list {
                let ends = ends(*c);
                if edges.last() != Some(&ends) {
                    edges.push(ends);
                }
                edge_of[*c as usize] = edges.len() as u32 - 1;
            }
        }
        drop(by_end);
        let edge_corners = Buckets::new(edges.len(), (0..count as u32).map(|c| (edge_of[c as usize], c)));
        let vertex_corners = Buckets::new(vertices, (0..count as u32).map(|c| (faces.corners[c as usize], c)));
        let both = edges.iter().enumerate().flat_map(|(e, [a, b])| [(*a, e as u32), (*b, e as u32)]);
        let vertex_edges = Buckets::new(vertices, both);
        Topology { faces, face_of, edge_of, edges, edge_corners, vertex_edges, vertex_corners }
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.vertex_corners.starts.len() - 1
    }

    /// The corner after one in its face.
    #[inline]
    pub fn next(&self, corner: u32) -> u32 {
        let f = self.face_of[corner as usize] as usize;
        if corner + 1 == self.faces.starts[f + 1] { self.faces.starts[f] } else { corner + 1 }
    }

    /// The corner before one in its face.
    #[inline]
    pub fn previous(&self, corner: u32) -> u32 {
        let f = self.face_of[corner as usize] as usize;
        if corner == self.faces.starts[f] { self.faces.starts[f + 1] - 1 } else { corner - 1 }
    }

    /// The corner across the face from one, of a quadrilateral.
    #[inline]
    pub fn opposite(&self, corner: u32) -> u32 {
        self.next(self.next(corner))
    }

    /// Vertex of a corner.
    #[inline]
    pub fn vertex(&self, corner: u32) -> u32 {
        self.faces.corners[corner as usize]
    }

    /// Edges at a vertex.
    #[inline]
    pub fn edges_at(&self, vertex: usize) -> &[u32] {
        self.vertex_edges.of(vertex)
    }

    /// Corners at a vertex.
    #[inline]
    pub fn corners_at(&self, vertex: usize) -> &[u32] {
        self.vertex_corners.of(vertex)
    }

    /// Corners whose edge it is, one for each face beside it.
    #[inline]
    pub fn corners_of_edge(&self, edge: usize) -> &[u32] {
        self.edge_corners.of(edge)
    }

    /// The end of an edge that is not `vertex`.
    #[inline]
    pub fn other_end(&self, edge: u32, vertex: u32) -> u32 {
        let [a, b] = self.edges[edge as usize];
        if a == vertex { b } else { a }
    }

    /// The edge between two vertices.
    pub fn find(&self, a: u32, b: u32) -> Option<u32> {
        self.edges.binary_search(&[a.min(b), a.max(b)]).ok().map(|e| e as u32)
    }

    /// Whether exactly two faces meet at an edge and run along it in opposite directions: where a surface can be smooth.
    #[inline]
    pub fn is_manifold(&self, edge: usize) -> bool {
        matches!(self.corners_of_edge(edge), [a, b] if self.vertex(*a) != self.vertex(*b))
    }

    /// The corner at the same vertex in the next face counter-clockwise; `None` across an edge that is not manifold.
    pub fn turned(&self, corner: u32) -> Option<u32> {
        let before = self.previous(corner);
        let edge = self.edge_of[before as usize] as usize;
        match self.corners_of_edge(edge) {
            [a, b] if self.vertex(*a) != self.vertex(*b) => Some(if *a == before { *b } else { *a }),
            _ => None,
        }
    }

    /// Corners at a vertex in fans: each begins at an edge that `cuts` (or anywhere, if there is none) and runs counter-clockwise to the next one.
    pub fn fans(&self, vertex: usize, cuts: impl Fn(u32) -> bool) -> Vec<Vec<u32>> {
        let corners = self.corners_at(vertex);
        let is_cut = |edge: u32| cuts(edge) || !self.is_manifold(edge as usize);
        let mut used = vec![false; corners.len()];
        let mut fans = Vec::new();
        // First those that begin at a cut, then those that close around the vertex.
        let begins: Vec<usize> = (0..corners.len()).filter(|i| is_cut(self.edge_of[corners[*i] as usize])).collect();
        for start in begins.into_iter().chain(0..corners.len()) {
            if std::mem::replace(&mut used[start], true) {
                continue;
            }
            let (mut last, mut fan) = (corners[start], vec![corners[start]]);
            while !is_cut(self.edge_of[self.previous(last) as usize]) {
                // Corners of a vertex are in ascending order.
                let Some(next) = self.turned(last).and_then(|c| corners.binary_search(&c).ok()) else { break };
                if std::mem::replace(&mut used[next], true) {
                    break;
                }
                last = corners[next];
                fan.push(last);
            }
            fans.push(fan);
        }
        fans
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_and_fans_of_a_fin() {
        // Two triangles that share an edge, and a third at the same edge.
        let flat = Topology::new(Faces::of_size(3, vec![0, 1, 2, 1, 0, 3]), 4);
        assert_eq!(flat.edges, [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3]]);
        assert!(flat.is_manifold(0) && !flat.is_manifold(1));
        assert_eq!(flat.find(3, 1), Some(4));
        assert_eq!(flat.find(2, 3), None);
        // About vertex 0, counter-clockwise: from face (1, 0, 3) to face (0, 1, 2).
        assert_eq!(flat.fans(0, |_| false), [vec![4, 0]]);
        assert_eq!(flat.fans(0, |e| e == 0).len(), 2);
        let fin = Topology::new(Faces::of_size(3, vec![0, 1, 2, 1, 0, 3, 0, 1, 4]), 5);
        assert!(!fin.is_manifold(0) && fin.fans(0, |_| false).len() == 3);
        // Faces that run along their edge in the same direction are no surface with an outside.
        let twisted = Topology::new(Faces::of_size(3, vec![0, 1, 2, 0, 1, 3]), 4);
        assert!(!twisted.is_manifold(0));
    }
}
