//! What embedded scenes are put together with.

use crate::material::{Conductor, Material, Principled, Scattering};
use crate::motion::{
    AnimatedProperty, Animation, AnimationPlayback, Channel, Extrapolation, KeyInterpolation, Local, Motion, Node, Parts,
};
use crate::scene::{Description, Object, Shape};
use crate::shape::{Mesh, Quad, Sphere};
use crate::texture::{Color, Scalar};
use glam::{Affine3A, Quat, Vec3};

/// A description in the making.
pub(crate) struct Builder(pub Description);

impl Builder {
    /// Adds a material; gives its number.
    pub fn material(&mut self, material: Material) -> u32 {
        self.0.materials.push(material);
        self.0.materials.len() as u32 - 1
    }

    /// Adds a glossy plastic of a roughness √α under a clear coat of a strength (0 to 1); gives its number.
    pub fn glossy(&mut self, name: &str, color: Color, roughness: f32, coat: f32) -> u32 {
        let principled = Principled {
            roughness: Scalar::Constant(roughness),
            clearcoat: Scalar::Constant(coat),
            clearcoat_roughness: Scalar::Constant(0.05),
            ..Principled::new(color, 1.5)
        };
        self.material(Material::new(name, Scattering::Principled(Box::new(principled))))
    }

    /// Adds a metal of GGX width α; gives its number.
    pub fn metal(&mut self, name: &str, alpha: f32) -> u32 {
        let conductor = Conductor::metal(name, alpha).expect("a known metal");
        self.material(Material::new(name, Scattering::Conductor(conductor)))
    }

    /// Adds a mesh; gives its number.
    pub fn mesh(&mut self, mesh: Mesh) -> u32 {
        self.0.meshes.push(mesh.into());
        self.0.meshes.len() as u32 - 1
    }

    /// Adds an object of a mesh and a material by their numbers, at a place, m, turned.
    pub fn place(&mut self, name: &str, mesh: u32, material: u32, at: Vec3, turn: Quat) {
        let shape = Shape::Mesh { mesh, world_from_mesh: Affine3A::from_rotation_translation(turn, at) };
        self.0.objects.push(Object::new(name, shape, material));
    }

    /// Adds a sphere, m, of a material by its number.
    pub fn sphere(&mut self, name: &str, center: Vec3, radius: f32, material: u32) {
        self.0.objects.push(Object::new(name, Shape::Sphere(Sphere { center, radius }), material));
    }

    /// Adds a parallelogram, m, of a material by its number.
    pub fn quad(&mut self, name: &str, corner: Vec3, edges: [Vec3; 2], material: u32) {
        self.0.objects.push(Object::new(name, Shape::Quad(Quad { corner, edges }), material));
    }

    /// Adds a diffuse material of a linear sRGB albedo; gives its number.
    pub fn matte(&mut self, name: &str, [r, g, b]: [f32; 3]) -> u32 {
        self.material(Material::new(name, Scattering::Diffuse(Color::rgb(r, g, b))))
    }

    /// A node that hangs on another.
    pub fn node(&mut self, name: &str, parent: Option<u32>, rest: Parts) -> u32 {
        self.0.nodes.push(Node { parent, rest: Local::Parts(rest), ..Node::new(name) });
        self.0.nodes.len() as u32 - 1
    }

    /// A mesh that hangs on a node.
    pub fn hang(&mut self, name: &str, mesh: Mesh, material: u32, node: u32) {
        let mesh = self.mesh(mesh);
        let shape = Shape::Mesh { mesh, world_from_mesh: Affine3A::IDENTITY };
        self.0.objects.push(Object { motion: Motion::Carried { node }, ..Object::new(name, shape, material) });
    }

    /// Key frames that run beside all others and begin anew after the last.
    pub fn animate(&mut self, name: &str, channels: Vec<Channel>) {
        self.0.animations.push(Animation { name: name.into(), channels });
        let animations = (0..self.0.animations.len()).collect();
        self.0.playing = AnimationPlayback { animations, ending: Extrapolation::Loop, frozen_at_s: None };
    }
}

/// A channel that turns a node evenly about an axis, once in `period_s`.
pub(super) fn spin(node: u32, axis: Vec3, period_s: f32) -> Channel {
    let turn = |k: f32| Quat::from_axis_angle(axis, std::f32::consts::TAU * k / 4.0).to_array();
    Channel {
        node: node as usize,
        property: AnimatedProperty::Rotation,
        interpolation: KeyInterpolation::Linear,
        times_s: (0..=4).map(|k| period_s * k as f32 / 4.0).collect(),
        values: (0..=4).flat_map(|k| turn(k as f32)).collect(),
    }
}

/// A channel that takes a node evenly from one place to another.
pub(super) fn slide(node: u32, from: Vec3, to: Vec3, time_s: f32) -> Channel {
    Channel {
        node: node as usize,
        property: AnimatedProperty::Translation,
        interpolation: KeyInterpolation::Linear,
        times_s: vec![0.0, time_s],
        values: [from.to_array(), to.to_array()].concat(),
    }
}

/// A box between two corners, faces outwards.
pub(crate) fn block(min: Vec3, max: Vec3) -> Mesh {
    let corner = |i: u32| {
        Vec3::new([min.x, max.x][i as usize & 1], [min.y, max.y][(i >> 1) as usize & 1], [min.z, max.z][(i >> 2) as usize])
    };
    let faces = [[1, 3, 7, 5], [0, 4, 6, 2], [2, 6, 7, 3], [0, 1, 5, 4], [4, 5, 7, 6], [0, 2, 3, 1]];
    let mut mesh = Mesh::default();
    for face in faces {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(face.map(corner));
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_block_is_closed_and_faces_outwards() {
        let mesh = block(Vec3::new(-1.0, -2.0, -3.0), Vec3::new(1.0, 2.0, 3.0));
        // The divergence theorem: a third of the sum of corner · normal · area is the volume.
        let volume: f32 = (0..mesh.triangles.len())
            .map(|t| {
                let [a, b, c] = mesh.corners(t);
                a.dot(b.cross(c)) / 6.0
            })
            .sum();
        assert!((volume - 48.0).abs() < 1e-3, "{volume}");
    }
}
