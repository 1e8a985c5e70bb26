//! Refined faces as meshes of triangles.

use super::{ControlMesh, Refined};
use crate::shape::Mesh;
use glam::{Vec2, Vec4};

/// Which channels become what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    /// Numbers of the channels of texture coordinates.
    pub uvs: [Option<usize>; 2],
    /// Number of the channel of colours.
    pub colors: Option<usize>,
}

impl Refined {
    /// The faces whose face of the control mesh is wanted, as triangles. Vertices are shared where all their values are.
    pub fn mesh(&self, wanted: impl Fn(u32) -> bool, channels: Channels) -> Mesh {
        self.mesh_and_positions(wanted, channels).0
    }

    /// The same, and the number of each vertex's position among [`Refined::positions`].
    pub fn mesh_and_positions(&self, wanted: impl Fn(u32) -> bool, channels: Channels) -> (Mesh, Vec<u32>) {
        let mut mesh = Mesh::default();
        let mut numbers = Vec::new();
        let lists = [Some(&self.normals.1), self.list(channels.uvs[0]), self.list(channels.uvs[1]), self.list(channels.colors)];
        let value = |channel: Option<usize>, number: u32| -> Option<Vec4> { Some(self.channels[channel?].0[number as usize]) };
        // The first vertex at each position, and the next one there with other values.
        let mut first = vec![u32::MAX; self.positions.len()];
        let (mut next, mut keys): (Vec<u32>, Vec<[u32; 4]>) = (vec![], vec![]);
        let mut polygon: Vec<u32> = vec![];
        for face in (0..self.faces.len()).filter(|f| wanted(self.control_face[*f])) {
            polygon.clear();
            for corner in self.faces.starts[face] as usize..self.faces.starts[face + 1] as usize {
                let position = self.faces.corners[corner] as usize;
                let key = lists.map(|list| list.map_or(0, |l| l[corner]));
                let mut vertex = first[position];
                while vertex != u32::MAX && keys[vertex as usize] != key {
                    vertex = next[vertex as usize];
                }
                if vertex == u32::MAX {
                    vertex = keys.len() as u32;
                    keys.push(key);
                    next.push(std::mem::replace(&mut first[position], vertex));
                    mesh.positions.push(self.positions[position]);
                    numbers.push(position as u32);
                    mesh.normals.push(self.normals.0[key[0] as usize]);
                    for k in 0..2 {
                        mesh.uvs[k].extend(value(channels.uvs[k], key[k + 1]).map(|v| Vec2::new(v.x, v.y)));
                    }
                    mesh.colors.extend(value(channels.colors, key[3]));
                }
                polygon.push(vertex);
            }
            push_triangles(&polygon, &mut mesh);
        }
        (mesh, numbers)
    }

    fn list(&self, channel: Option<usize>) -> Option<&Vec<u32>> {
        Some(&self.channels[channel?].1)
    }
}

/// Cuts a face into a fan; a quadrilateral along its shorter diagonal.
fn push_triangles(polygon: &[u32], mesh: &mut Mesh) {
    if let [a, b, c, d] = *polygon {
        let length = |i: u32, j: u32| mesh.positions[i as usize].distance_squared(mesh.positions[j as usize]);
        mesh.triangles.extend(match length(b, d) < length(a, c) {
            true => [[a, b, d], [b, c, d]],
            false => [[a, b, c], [a, c, d]],
        });
        return;
    }
    mesh.triangles.extend(polygon.windows(2).skip(1).map(|pair| [polygon[0], pair[0], pair[1]]));
}

impl ControlMesh {
    /// A mesh of triangles without anything else.
    pub fn of_triangles(mesh: &Mesh) -> Self {
        ControlMesh {
            positions: mesh.positions.clone(),
            face_sizes: vec![3; mesh.triangles.len()],
            corners: mesh.triangles.iter().flatten().copied().collect(),
            ..ControlMesh::default()
        }
    }
}
