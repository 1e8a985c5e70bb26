//! Meshes that pictures of heights displace: of files that say no edge length (USD, OBJ), and of all files as fine as a camera asks for.
//!
//! Edges are split ([`subdivision::split_long_edges`]) until none is longer than [`EDGE_FRACTION`] of the meshes' size, or in a picture than so many of its pixels
//! ([`Description::refine_displaced`]); then all vertices are moved along their normals ([`subdivision::displace`]), as pbrt's displaced meshes are. Meshes of several
//! materials are displaced together, so that what they share does not crack. Whether an edge is split depends on its two ends alone, also there.

use super::pbrt::shapes;
use crate::bvh::Bounds;
use crate::motion::Motion;
use crate::scene::description::DisplacedSurface;
use crate::scene::{Description, Shape};
use crate::shape::Mesh;
use crate::subdivision::{self, MOST_TRIANGLES, Splitting};
use crate::texture::{Lookup, Scalar};
use glam::{Affine3A, Vec2, Vec3, Vec4};

/// Longest edge as a fraction of the diagonal of the box around all meshes that are displaced together: about a million triangles for a ball, a
/// pixel or two where that fills a picture of a thousand.
pub const EDGE_FRACTION: f32 = 1.0 / 512.0;
/// Most triangles of all meshes of a scene that are displaced by pictures.
pub const MOST_IN_ALL: usize = 1 << 23;

/// What came of meshes that were displaced.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Displaced {
    /// Whether edges are longer than they should be: there would be too many triangles.
    pub stopped: bool,
    /// Vertices whose height was no number; they stay.
    pub without_height: usize,
}

/// A camera, as far as it says how fine surfaces must be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelView {
    /// Where it stands, m.
    pub eye: Vec3,
    /// Where it looks, of length 1.
    pub axis: Vec3,
    /// Half of the angle that it sees, to the corners, rad; π where it sees everything.
    pub half_angle: f32,
    /// Pixels in a radian, in the middle of the picture.
    pub pixels_per_radian: f32,
}

/// By how much edges may be longer that the camera does not see: they throw shadows, and mirrors show them.
const UNSEEN: f32 = 8.0;
/// Copies of a mesh that are looked at, those that look largest.
const MOST_PLACES: usize = 16;

impl PixelView {
    /// Length of an edge in the picture, pixels, as if it were seen across; an eighth outside of the picture. `a` and `b` may be swapped.
    fn pixels(&self, a: Vec3, b: Vec3) -> f32 {
        let length = a.distance(b);
        let near = a.distance(self.eye).min(b.distance(self.eye)).max(1e-6);
        let pixels = self.pixels_per_radian * length / near;
        // A ball around the edge against the cone of the camera.
        let (to, radius) = (0.5 * (a + b) - self.eye, 0.5 * length);
        let distance = to.length();
        let angle = || (to.dot(self.axis) / distance).clamp(-1.0, 1.0).acos() - (radius / distance).asin();
        if distance > radius && angle() > self.half_angle { pixels / UNSEEN } else { pixels }
    }
}

impl Description {
    /// Displaces all meshes that heights displace anew, so finely that no edge is longer than `edge_px` pixels (> 0) of a picture, at a moment of the scene, s; edges
    /// outside of the picture may be eight times as long. Where that takes more than `MOST_IN_ALL` triangles edges stay longer, and a warning says so.
    pub fn refine_displaced(&mut self, view: &PixelView, edge_px: f32, at_s: f64) {
        self.refine_displaced_up_to(view, edge_px, at_s, MOST_IN_ALL);
    }

    fn refine_displaced_up_to(&mut self, view: &PixelView, edge_px: f32, at_s: f64, most: usize) {
        let surfaces = self.displaced.clone();
        let most = most / surfaces.len().max(1);
        let mut stopped = false;
        for surface in &surfaces {
            let places: Vec<Affine3A> = surface.parts.iter().flat_map(|part| self.places(part.0, at_s)).collect();
            let bounds = Bounds::around(surface.parts.iter().flat_map(|part| part.1.positions.iter().copied()));
            let places = largest(view, bounds, places);
            let length = |a: Vec3, b: Vec3| {
                let in_place = |place: &Affine3A| view.pixels(place.transform_point3(a), place.transform_point3(b));
                places.iter().map(in_place).fold(0.0, f32::max)
            };
            stopped |= surface.displace(&length, edge_px, most, self);
        }
        if stopped {
            self.warnings.push(format!(
                "{}: edges of displaced meshes stay longer than {edge_px} pixels: shorter ones need more than {most} triangles a surface",
                self.name
            ));
        }
    }

    /// Where a mesh stands at a moment, s.
    fn places(&self, number: u32, at_s: f64) -> Vec<Affine3A> {
        let timeline = self.timeline();
        let own = self.objects.iter().filter_map(|o| match (o.shape, o.motion) {
            (Shape::Mesh { mesh, .. }, Motion::Carried { node }) if mesh == number => Some(timeline.world(node, at_s)),
            (Shape::Mesh { mesh, world_from_mesh }, _) if mesh == number => Some(world_from_mesh),
            _ => None,
        });
        own.collect()
    }
}

/// Of many places of a mesh those where it looks largest.
fn largest(view: &PixelView, bounds: Bounds, mut places: Vec<Affine3A>) -> Vec<Affine3A> {
    if places.len() > MOST_PLACES {
        let size = |place: &Affine3A| {
            let box_there = bounds.placed(place);
            let near = view.eye.clamp(box_there.min, box_there.max).distance(view.eye);
            box_there.size().length() / near.max(1e-6)
        };
        places.sort_by(|a, b| size(b).total_cmp(&size(a)));
        places.truncate(MOST_PLACES);
    }
    places
}

impl DisplacedSurface {
    /// Displaces its meshes anew and puts them into a description; whether there would have been too many triangles.
    fn displace(&self, length: &(dyn Fn(Vec3, Vec3) -> f32 + Sync), longest: f32, most: usize, d: &mut Description) -> bool {
        let mut meshes: Vec<Mesh> = self.parts.iter().map(|(_, mesh, _)| Mesh::clone(mesh)).collect();
        let stopped = match self.alone {
            Some((place, is_reversed)) => {
                let (mesh, height) = (&mut meshes[0], &self.parts[0].2);
                let split = subdivision::split_edges_by(mesh, length, longest, most.min(MOST_TRIANGLES));
                displace_alone(mesh, height, &place, is_reversed);
                split == Splitting::Stopped
            }
            None => {
                let mut parts: Vec<(&mut Mesh, &Scalar)> = meshes.iter_mut().zip(&self.parts).map(|(m, p)| (m, &*p.2)).collect();
                displace_by(&mut parts, |mesh| subdivision::split_edges_by(mesh, length, longest, most)).stopped
            }
        };
        for (mesh, (number, ..)) in meshes.into_iter().zip(&self.parts) {
            d.meshes[*number as usize] = mesh.into();
        }
        stopped
    }
}

/// Moves the points of a mesh of pbrt, whose triangles are short enough; how many heights are no numbers. `place`: the space of textures from that of the mesh.
pub fn displace_alone(mesh: &mut Mesh, height: &Scalar, place: &Affine3A, is_reversed: bool) -> usize {
    let without_height = subdivision::displace(mesh, |uv, p, n| {
        let normal = place.transform_vector3(n).normalize_or_zero();
        height.lookup(&Lookup { uv: *uv, point: place.transform_point3(p), normal, footprint: None })
    });
    shapes::default_uvs(mesh);
    if is_reversed {
        shapes::reverse(mesh);
    }
    without_height
}

/// Displaces meshes that belong together by their heights (in their space, along their normals), with at most so many triangles.
pub fn displace(parts: &mut [(&mut Mesh, &Scalar)], most: usize) -> Displaced {
    displace_by(parts, |whole| {
        let bounds = Bounds::around(whole.positions.iter().copied());
        let longest = EDGE_FRACTION * (bounds.max - bounds.min).length();
        match longest > 0.0 && longest.is_finite() {
            true => subdivision::split_long_edges_up_to(whole, &Affine3A::IDENTITY, longest, most),
            false => Splitting::Complete,
        }
    })
}

/// The same with edges split by a function.
fn displace_by(parts: &mut [(&mut Mesh, &Scalar)], split: impl FnOnce(&mut Mesh) -> Splitting) -> Displaced {
    let mut whole = Mesh::default();
    let has = |list: fn(&Mesh) -> bool| parts.iter().any(|(mesh, _)| list(mesh));
    let uv_lists = [has(|m| !m.uvs[0].is_empty()), has(|m| !m.uvs[1].is_empty())];
    let has_normals = parts.iter().all(|(mesh, _)| !mesh.normals.is_empty());
    // What each part has of its own.
    let own = parts.iter().map(|(mesh, _)| (mesh.uvs.each_ref().map(Vec::is_empty), mesh.colors.is_empty())).collect::<Vec<_>>();
    for (number, (mesh, _)) in parts.iter_mut().enumerate() {
        mesh.drop_partial_lists();
        mesh.drop_broken_triangles();
        let mesh = std::mem::take(*mesh);
        let (first, count) = (whole.positions.len() as u32, mesh.positions.len());
        whole.positions.extend(mesh.positions);
        if has_normals {
            whole.normals.extend(mesh.normals);
        }
        for (k, uvs) in mesh.uvs.into_iter().enumerate().filter(|(k, _)| uv_lists[*k]) {
            whole.uvs[k].extend(uvs.into_iter().chain(std::iter::repeat(Vec2::ZERO)).take(count));
        }
        // Alpha, which no file of these formats has, says which part a vertex belongs to: it stays so between two of the same part.
        let colors = mesh.colors.into_iter().chain(std::iter::repeat(Vec4::ZERO)).take(count);
        whole.colors.extend(colors.map(|c| c.truncate().extend(number as f32)));
        whole.triangles.extend(mesh.triangles.iter().map(|t| t.map(|v| v + first)));
    }
    // Even heights need no shorter edges.
    let even = parts.iter().all(|(_, height)| matches!(height, Scalar::Constant(_)));
    let split = if even { Splitting::Complete } else { split(&mut whole) };
    let part_of: Vec<usize> = whole.colors.iter().map(|c| c.w as usize).collect();
    let heights: Vec<&Scalar> = parts.iter().map(|(_, height)| *height).collect();
    let without_height = subdivision::displace_vertices(&mut whole, |v, uv, point, normal| {
        heights[part_of[v]].lookup(&Lookup { uv: *uv, point, normal, footprint: None })
    });
    // Back into parts: the new number of each vertex.
    let mut number_of = vec![0u32; whole.positions.len()];
    for (v, part) in part_of.iter().enumerate() {
        let (mesh, _) = &mut parts[*part];
        let ([no_first, no_second], no_colors) = own[*part];
        number_of[v] = mesh.positions.len() as u32;
        mesh.positions.push(whole.positions[v]);
        mesh.normals.push(whole.normals[v]);
        for (k, none) in [no_first, no_second].into_iter().enumerate() {
            if !none {
                mesh.uvs[k].push(whole.uvs[k][v]);
            }
        }
        if !no_colors {
            mesh.colors.push(whole.colors[v].truncate().extend(1.0));
        }
    }
    for t in &whole.triangles {
        parts[part_of[t[0] as usize]].0.triangles.push(t.map(|v| number_of[v as usize]));
    }
    Displaced { stopped: split == Splitting::Stopped, without_height }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::{Image, Texture};
    use std::collections::HashMap;
    use std::sync::Arc;

    /// A unit square in z = 0 from `x` on, its texture coordinates its places.
    fn square(x: f32) -> Mesh {
        let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]].map(Vec2::from_array);
        Mesh {
            positions: corners.iter().map(|c| Vec3::new(x + c.x, c.y, 0.0)).collect(),
            uvs: [corners.to_vec(), vec![]],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        }
    }

    fn ramp(factor: f32) -> Scalar {
        // From black on the left to white on the right, linear codes.
        let image = Image::new(64, 1, (0..64).map(|x| [(x * 255 / 63) as u8; 4]).collect());
        let texture = Texture { codes: crate::texture::Codes::Linear, ..Texture::color(Arc::new(image)) };
        Scalar::Textured { factor, texture, channel: 0 }
    }

    #[test]
    fn heights_are_those_of_the_picture() {
        let (mut mesh, height) = (square(0.0), ramp(0.2));
        let done = displace(&mut [(&mut mesh, &height)], 1 << 20);
        assert_eq!(done, Displaced { stopped: false, without_height: 0 });
        assert!(mesh.triangles.len() > 200_000, "{}", mesh.triangles.len());
        assert_eq!((mesh.uvs[0].len(), mesh.colors.len()), (mesh.positions.len(), 0));
        for (p, n) in mesh.positions.iter().zip(&mesh.normals).filter(|(p, _)| (0.1..0.9).contains(&p.x)) {
            // A texel's middle is half a texel further.
            let expected = 0.2 * (p.x * 64.0 - 0.5) / 63.0;
            assert!((p.z - expected).abs() < 1.5e-3, "{p}: {expected}");
            assert!(n.z > 0.9 && n.x < 0.0, "{p}: {n}");
        }
    }

    #[test]
    fn parts_do_not_part() {
        let (mut left, mut right, high, low) = (square(0.0), square(1.0), ramp(0.2), Scalar::Constant(0.05));
        left.colors = vec![Vec4::new(0.5, 0.25, 1.0, 1.0); 4];
        displace(&mut [(&mut left, &high), (&mut right, &low)], 1 << 21);
        assert!(left.colors.iter().all(|c| *c == Vec4::new(0.5, 0.25, 1.0, 1.0)) && right.colors.is_empty());
        // Every edge but those of the outline lies between two triangles, also along the seam.
        let mut edges: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
        for mesh in [&left, &right] {
            for t in 0..mesh.triangles.len() {
                let p = mesh.corners(t).map(|p| (p + Vec3::ZERO).to_array().map(f32::to_bits));
                for k in 0..3 {
                    *edges.entry([p[k], p[(k + 1) % 3]]).or_default() += 1;
                    *edges.entry([p[(k + 1) % 3], p[k]]).or_default() -= 1;
                }
            }
        }
        let on_seam = |p: &[u32; 3]| (f32::from_bits(p[0]) - 1.0).abs() < 1e-6;
        let seam: Vec<_> = left.positions.iter().filter(|p| (p.x - 1.0).abs() < 1e-6).collect();
        assert!(seam.len() > 100 && edges.iter().filter(|(e, _)| e.iter().all(on_seam)).all(|(_, n)| *n == 0));
        // The mean of both heights where they meet: the picture repeats, and is half white at its edge.
        assert!(seam.iter().all(|p| (p.z - 0.075).abs() < 1e-3), "{:?}", seam[0]);
    }

    #[test]
    fn few_triangles_where_few_are_allowed_and_where_heights_are_even() {
        let (mut mesh, height) = (square(0.0), ramp(1.0));
        assert!(displace(&mut [(&mut mesh, &height)], 1000).stopped);
        assert!((100..=1000).contains(&mesh.triangles.len()));
        let (mut mesh, height) = (square(0.0), Scalar::Constant(-0.25));
        assert!(!displace(&mut [(&mut mesh, &height)], 1000).stopped);
        assert!(mesh.triangles.len() == 2 && mesh.positions.iter().all(|p| p.z == -0.25));
    }

    /// A square of 1 m at z = 0 that a picture displaces, and a camera before it.
    fn seen(distance: f32) -> (Description, PixelView) {
        let mesh = Arc::new(square(-0.5));
        let mut d = Description { meshes: vec![mesh.clone()], ..Description::default() };
        d.displaced = vec![DisplacedSurface { parts: vec![(0, mesh, Arc::new(ramp(0.01)))], alone: None }];
        d.objects.push(crate::scene::Object::new("square", Shape::Mesh { mesh: 0, world_from_mesh: Affine3A::IDENTITY }, 0));
        let eye = Vec3::new(0.0, 0.5, distance);
        (d, PixelView { eye, axis: Vec3::NEG_Z, half_angle: 0.6, pixels_per_radian: 200.0 })
    }

    fn longest_px(d: &Description, view: &PixelView) -> f32 {
        let mesh = &d.meshes[0];
        let corners = (0..mesh.triangles.len()).map(|t| mesh.corners(t));
        corners.flat_map(|[a, b, c]| [view.pixels(a, b), view.pixels(b, c), view.pixels(c, a)]).fold(0.0, f32::max)
    }

    #[test]
    fn edges_are_as_short_as_the_picture_asks_for() {
        let mut counts = vec![];
        for (distance, edge_px) in [(2.0, 1.0), (2.0, 4.0), (8.0, 1.0)] {
            let (mut d, view) = seen(distance);
            d.refine_displaced(&view, edge_px, 0.0);
            let longest = longest_px(&d, &view);
            // Moving its points makes edges longer: by 1 % of slope and of nearness here.
            assert!((0.5 * edge_px..1.03 * edge_px).contains(&longest), "{distance} m, {edge_px} px: {longest}");
            assert!(d.warnings.is_empty(), "{:?}", d.warnings);
            counts.push(d.meshes[0].triangles.len());
            // Again is the same: from what the mesh was before.
            let first = d.meshes[0].clone();
            d.refine_displaced(&view, edge_px, 0.0);
            assert_eq!(first.positions, d.meshes[0].positions);
        }
        // 100 pixels across, halves of triangles: as the square of the ratio.
        assert!(counts[0] > 10 * counts[1] && counts[1] < 2 * counts[2] && counts[2] < 2 * counts[1], "{counts:?}");
        // What the camera does not see may be coarser: it looks away.
        let (mut d, view) = seen(2.0);
        d.refine_displaced(&PixelView { axis: Vec3::Z, ..view }, 1.0, 0.0);
        assert!(d.meshes[0].triangles.len() < counts[0] / 30, "{}", d.meshes[0].triangles.len());
        // Of two copies the nearer one counts.
        let (mut d, view) = seen(8.0);
        let near = Affine3A::from_translation(Vec3::Z * 6.0);
        d.objects.push(crate::scene::Object::new("near", Shape::Mesh { mesh: 0, world_from_mesh: near }, 0));
        d.refine_displaced(&view, 1.0, 0.0);
        assert!(d.meshes[0].triangles.len() >= counts[0], "{}", d.meshes[0].triangles.len());
        // Not more triangles than there may be.
        let (mut d, view) = seen(2.0);
        d.refine_displaced_up_to(&view, 1.0, 0.0, 5000);
        assert!(d.warnings[0].contains("stay longer") && (500..=5000).contains(&d.meshes[0].triangles.len()));
    }
}
