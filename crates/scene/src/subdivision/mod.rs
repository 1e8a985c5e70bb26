//! Subdivision surfaces: a control mesh becomes a fine one whose vertices lie on the limit surface.
//!
//! Catmull–Clark, Loop and bilinear subdivision of polygons of any number of corners, to a level that is the same everywhere; edges and vertices
//! may be sharp or sharp for some levels. Only the control mesh and the level decide the result, never a camera. Edges where more than two faces
//! meet, or whose faces run along them in the same direction, are infinitely sharp creases. Formulas and their sources: `refine` has the rules of
//! vertices and their limits, `sharpness` those of creases, `normals` the normals of the limit. [`displace`] moves a fine mesh by heights.
//!
//! Values at corners of faces ([`Channel`], texture coordinates and colours) are subdivided as meshes of their own: where faces disagree about a
//! value there is a seam, which is a boundary of that mesh. Limits: every level makes each face four; Chaikin's creases, `smooth` triangles
//! of Catmull–Clark and hierarchical edits are left out.

mod displacement;
mod edge_split;
mod mesh;
mod normals;
mod refine;
mod sharpness;
mod topology;

#[cfg(test)]
mod tests;

pub use displacement::{displace, displace_vertices, normals_by, smooth_normals, vertex_normals};
pub use edge_split::{Splitting, split_edges_by, split_long_edges, split_long_edges_up_to};
pub use mesh::Channels;

use glam::{DVec3, DVec4, Vec3, Vec4};
use refine::{Split, Weights};
use sharpness::{Sharp, Sharpness};
use std::collections::HashMap;
use std::ops::{Add, Mul};
use topology::{Faces, Topology};

/// Most levels: 10 make a million triangles of one.
pub const MOST_LEVELS: u32 = 10;
/// Most triangles that a mesh becomes: about 2 GB of memory at work.
pub const MOST_TRIANGLES: usize = 1 << 24;

/// From this sharpness on a crease is infinitely sharp. Source: OpenUSD, `UsdGeomMesh::SHARPNESS_INFINITE`.
pub const INFINITELY_SHARP: f32 = 10.0;

/// What can be averaged.
trait Value: Copy + Default + Send + Sync + Add<Output = Self> + Mul<f64, Output = Self> {}
impl<T: Copy + Default + Send + Sync + Add<Output = T> + Mul<f64, Output = T>> Value for T {}

/// Numbers of each list of [`ControlMesh::vertex_values`].
pub const VERTEX_LANES: usize = 16;

/// Numbers that are averaged together.
#[derive(Clone, Copy, Default)]
struct Lanes([f64; VERTEX_LANES]);

impl Add for Lanes {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Lanes(std::array::from_fn(|i| self.0[i] + other.0[i]))
    }
}

impl Mul<f64> for Lanes {
    type Output = Self;

    fn mul(self, factor: f64) -> Self {
        Lanes(self.0.map(|v| v * factor))
    }
}

/// How faces are refined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Scheme {
    /// Catmull & Clark 1978: bicubic B-splines where the mesh is regular.
    CatmullClark,
    /// Loop 1987, of triangles; other faces are cut into fans first.
    Loop,
    /// Faces are split, nothing is smoothed.
    Bilinear,
}

/// What happens at edges with one face. Names and meaning as `interpolateBoundary` of OpenUSD's `UsdGeomMesh`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Boundary {
    /// Faces that touch a boundary are not shown: they only shape their neighbours.
    None,
    /// Boundaries are B-spline curves.
    EdgeOnly,
    /// So are they, and vertices with one face stay where they are.
    #[default]
    EdgeAndCorner,
}

/// What happens to values where faces disagree about them. After `faceVaryingLinearInterpolation` of `UsdGeomMesh`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Seams {
    /// Values are interpolated linearly everywhere ("all").
    AllLinear,
    /// Along seams, linearly; elsewhere smoothly ("boundaries").
    Linear,
    /// Smoothly, but corners of a seam and vertices where more than two pieces meet stay ("cornersPlus1"; "cornersOnly" and "cornersPlus2" are read
    /// as this one).
    #[default]
    Corners,
    /// Smoothly everywhere ("none").
    Smooth,
}

/// Values at the corners of faces.
#[derive(Clone, Debug, Default)]
pub struct Channel {
    /// The values: texture coordinates in x and y, or RGBA.
    pub values: Vec<Vec4>,
    /// Number of the value at each corner of the faces. Two vertices of the mesh never share a number.
    pub corners: Vec<u32>,
    /// What happens at seams.
    pub seams: Seams,
}

/// A control mesh.
#[derive(Clone, Debug, Default)]
pub struct ControlMesh {
    /// Vertices.
    pub positions: Vec<Vec3>,
    /// How many corners each face has.
    pub face_sizes: Vec<u32>,
    /// Vertices at the corners, face after face, counter-clockwise seen from outside.
    pub corners: Vec<u32>,
    /// Sharpness of edges: 0 smooth, from [`INFINITELY_SHARP`] on a sharp crease, between them sharp for as many levels.
    pub creases: Vec<([u32; 2], f32)>,
    /// Sharpness of vertices, likewise.
    pub sharp_vertices: Vec<(u32, f32)>,
    /// What happens at boundaries.
    pub boundary: Boundary,
    /// Other values.
    pub channels: Vec<Channel>,
    /// Values at vertices that are subdivided as positions are, such as the weights of joints: lists as long as `positions`.
    pub vertex_values: Vec<Vec<[f32; VERTEX_LANES]>>,
}

/// Why a mesh cannot be subdivided.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SubdivisionError {
    /// A position or a value is not a finite number.
    #[error("positions or values that are not finite")]
    NotFinite,
    /// A corner has a number beyond its list, or lists differ in length.
    #[error("faces that do not fit their points")]
    OutOfRange,
    /// The mesh itself is as large as a subdivided one may be.
    #[error("more than {MOST_TRIANGLES} triangles without any level")]
    TooLarge,
}

/// A fine mesh: faces of 3 or 4 corners (at level 0 as many as there were).
#[derive(Clone, Debug)]
pub struct Refined {
    /// Vertices, on the limit surface.
    pub positions: Vec<Vec3>,
    faces: Faces,
    /// The face of the control mesh that each face is a part of.
    pub control_face: Vec<u32>,
    normals: (Vec<Vec3>, Vec<u32>),
    channels: Vec<(Vec<Vec4>, Vec<u32>)>,
    /// The values at vertices, each list as long as `positions`.
    pub vertex_values: Vec<Vec<[f32; VERTEX_LANES]>>,
    /// Whether each face of the control mesh is left out by [`Boundary::None`].
    pub hidden: Vec<bool>,
    /// The level that was reached: less than what was asked for where that would have been more than [`MOST_TRIANGLES`].
    pub level: u32,
    /// Faces of less than three different corners, which are left out.
    pub degenerate_faces: usize,
}

/// Triangles that a mesh has after some levels, by how many corners each face has; saturates.
pub fn triangles_at(scheme: Scheme, face_sizes: &[u32], level: u32) -> usize {
    let corners: usize = face_sizes.iter().map(|n| *n as usize).sum();
    let triangles: usize = face_sizes.iter().map(|n| (*n as usize).saturating_sub(2)).sum();
    let times = |n: usize, level: u32| n.saturating_mul(1usize.checked_shl(2 * level).unwrap_or(usize::MAX));
    match (scheme, level) {
        (Scheme::Loop, _) | (_, 0) => times(triangles, level),
        _ => times(corners.saturating_mul(2), level - 1),
    }
}

/// Subdivides a mesh `level` times (at most [`MOST_LEVELS`]) and moves its vertices onto the limit surface.
///
/// A level that would make more than [`MOST_TRIANGLES`] triangles is reduced. Faces with less than three different corners in a row are left out and counted. Fails for
/// numbers that are not finite or out of range, and for a mesh that has too many triangles at the least level.
pub fn subdivide(mesh: &ControlMesh, scheme: Scheme, level: u32) -> Result<Refined, SubdivisionError> {
    subdivide_up_to(mesh, scheme, level, MOST_TRIANGLES)
}

fn subdivide_up_to(mesh: &ControlMesh, scheme: Scheme, level: u32, most: usize) -> Result<Refined, SubdivisionError> {
    check(mesh)?;
    // Level 0 of quadrilaterals is told by level 1.
    let least = if scheme == Scheme::Loop { 0 } else { 1 };
    let fits = |level: &u32| triangles_at(scheme, &mesh.face_sizes, least.max(*level)) <= most;
    let level = (0..=level.min(MOST_LEVELS)).rev().find(fits).ok_or(SubdivisionError::TooLarge)?;
    let base = Base::new(mesh, scheme);
    let (weights, split) = match scheme {
        Scheme::CatmullClark => (Weights::CatmullClark, Split::Quads),
        Scheme::Bilinear => (Weights::Linear, Split::Quads),
        Scheme::Loop => (Weights::Loop, Split::Triangles),
    };
    // The mask of Catmull–Clark's limit is for quadrilaterals: at level 0 the vertices of level 1 tell it.
    let extra = level == 0 && split == Split::Quads;
    let levels = if extra { 1 } else { level };

    let sharp = base.sharp(mesh);
    let points: Vec<DVec3> = mesh.positions.iter().map(|p| p.as_dvec3()).collect();
    let fine = Fine::new(base.faces(&mesh.corners), points, &sharp, levels, weights, split);
    let mut normals = normals::limit_normals(&fine.topology, &fine.sharpness, &fine.values, weights);
    let positions: Vec<Vec3> = fine.limits(weights).iter().map(|p| p.as_vec3()).collect();
    let mut faces = fine.topology.faces;
    let mut control_face = base.children(levels, split);

    let mut vertex_values = Vec::with_capacity(mesh.vertex_values.len());
    for values in &mesh.vertex_values {
        let values = values.iter().map(|v| Lanes(v.map(f64::from))).collect();
        let fine = Fine::new(base.faces(&mesh.corners), values, &sharp, levels, weights, split);
        vertex_values.push(fine.limits(weights).iter().map(|v| v.0.map(|x| x as f32)).collect());
    }
    let mut channels = Vec::with_capacity(mesh.channels.len());
    for channel in &mesh.channels {
        let weights = if channel.seams == Seams::AllLinear { Weights::Linear } else { weights };
        let values: Vec<DVec4> = channel.values.iter().map(|v| v.as_dvec4()).collect();
        let faces = base.faces(&channel.corners);
        let sharp = base.channel_sharp(mesh, channel, &sharp);
        let fine = Fine::new(faces, values, &sharp, levels, weights, split);
        let values = fine.limits(weights).iter().map(|v| v.as_vec4()).collect();
        channels.push((values, fine.topology.faces.corners));
    }
    if extra {
        // Back to the faces there were: each corner's own quadrilateral begins with it.
        let first_of = |corners: &[u32]| corners.iter().step_by(4).copied().collect::<Vec<u32>>();
        faces = Faces { starts: base.starts.clone(), corners: first_of(&faces.corners) };
        normals.1 = first_of(&normals.1);
        channels.iter_mut().for_each(|(_, corners)| *corners = first_of(corners));
        control_face = base.control_face.clone();
    }
    let hidden = base.hidden(mesh);
    Ok(Refined {
        positions,
        faces,
        control_face,
        normals,
        channels,
        vertex_values,
        hidden,
        level,
        degenerate_faces: base.degenerate,
    })
}

/// Looks for what would not be a mesh.
fn check(mesh: &ControlMesh) -> Result<(), SubdivisionError> {
    let corners = mesh.face_sizes.iter().try_fold(0usize, |n, size| n.checked_add(*size as usize));
    let fits = |list: &[u32], count: usize| corners == Some(list.len()) && list.iter().all(|i| (*i as usize) < count);
    let per_vertex = mesh.vertex_values.iter().all(|v| v.len() == mesh.positions.len());
    if !per_vertex
        || !fits(&mesh.corners, mesh.positions.len())
        || mesh.channels.iter().any(|c| !fits(&c.corners, c.values.len()))
    {
        return Err(SubdivisionError::OutOfRange);
    }
    let used = |list: &[u32], finite: &dyn Fn(usize) -> bool| list.iter().all(|i| finite(*i as usize));
    let values = |i: usize| mesh.vertex_values.iter().all(|list| list[i].iter().all(|v| v.is_finite()));
    let whole = used(&mesh.corners, &|i| mesh.positions[i].is_finite() && values(i))
        && mesh.channels.iter().all(|c| used(&c.corners, &|i| c.values[i].is_finite()));
    if whole { Ok(()) } else { Err(SubdivisionError::NotFinite) }
}

/// The faces that are subdivided.
struct Base {
    starts: Vec<u32>,
    /// Which corner of the control mesh each corner is.
    sources: Vec<u32>,
    control_face: Vec<u32>,
    degenerate: usize,
}

impl Base {
    /// Leaves out corners that repeat the one before, and faces that have less than three then; cuts faces into triangles where needed.
    fn new(mesh: &ControlMesh, scheme: Scheme) -> Self {
        let mut base = Base { starts: vec![0], sources: vec![], control_face: vec![], degenerate: 0 };
        let mut first = 0u32;
        for (face, size) in mesh.face_sizes.iter().enumerate() {
            let vertex = |c: u32| mesh.corners[c as usize];
            let last = first + size;
            let previous = |c: u32| if c == first { last - 1 } else { c - 1 };
            let own: Vec<u32> = (first..last).filter(|c| vertex(*c) != vertex(previous(*c))).collect();
            first = last;
            if own.len() < 3 {
                base.degenerate += 1;
                continue;
            }
            let mut push = |corners: &[u32]| {
                base.sources.extend(corners);
                base.starts.push(base.sources.len() as u32);
                base.control_face.push(face as u32);
            };
            match scheme {
                Scheme::Loop => own.windows(2).skip(1).for_each(|pair| push(&[own[0], pair[0], pair[1]])),
                _ => push(&own),
            }
        }
        base
    }

    fn faces(&self, corners: &[u32]) -> Faces {
        Faces { starts: self.starts.clone(), corners: self.sources.iter().map(|c| corners[*c as usize]).collect() }
    }

    /// The face of the control mesh of each face after some levels.
    fn children(&self, levels: u32, split: Split) -> Vec<u32> {
        let mut out = Vec::new();
        for (f, face) in self.control_face.iter().enumerate() {
            let corners = (self.starts[f + 1] - self.starts[f]) as usize;
            let count = match (split, levels) {
                (_, 0) => 1,
                (Split::Quads, _) => corners << (2 * (levels - 1)),
                (Split::Triangles, _) => 1 << (2 * levels),
            };
            out.resize(out.len() + count, *face);
        }
        out
    }

    /// Sharpness of the control mesh: what it says, corners of boundaries, and vertices where several sheets meet in a point.
    fn sharp(&self, mesh: &ControlMesh) -> Sharp {
        let t = Topology::new(self.faces(&mesh.corners), mesh.positions.len());
        let level = |s: f32| if s >= INFINITELY_SHARP { f32::INFINITY } else { s };
        let edges = mesh.creases.iter().filter(|c| c.1 > 0.0).map(|(ends, s)| (*ends, level(*s)));
        let inside = |v: u32| (v as usize) < mesh.positions.len();
        let vertices = mesh.sharp_vertices.iter().filter(|v| v.1 > 0.0 && inside(v.0)).map(|(v, s)| (*v, level(*s)));
        let mut sharp = Sharp { edges: edges.collect(), vertices: vertices.collect() };
        sharp.pin(&t, |corners| corners == 1 && mesh.boundary == Boundary::EdgeAndCorner);
        sharp
    }

    /// The same for the mesh of a channel: creases of the surface are creases of its values.
    fn channel_sharp(&self, mesh: &ControlMesh, channel: &Channel, of_mesh: &Sharp) -> Sharp {
        let t = Topology::new(self.faces(&mesh.corners), mesh.positions.len());
        let own = self.faces(&channel.corners);
        let mut sharp = Sharp::default();
        for (ends, s) in &of_mesh.edges {
            let corners = t.find(ends[0], ends[1]).map_or(&[][..], |e| t.corners_of_edge(e as usize));
            sharp.edges.extend(corners.iter().map(|c| ([*c, t.next(*c)].map(|c| own.corners[c as usize]), *s)));
        }
        for (v, s) in &of_mesh.vertices {
            sharp.vertices.extend(t.corners_at(*v as usize).iter().map(|c| (own.corners[*c as usize], *s)));
        }
        // Vertices where more than two pieces meet.
        if channel.seams == Seams::Corners {
            for v in 0..mesh.positions.len() {
                let mut numbers: Vec<u32> = t.corners_at(v).iter().map(|c| own.corners[*c as usize]).collect();
                numbers.sort_unstable();
                numbers.dedup();
                if numbers.len() > 2 {
                    sharp.vertices.extend(numbers.iter().map(|n| (*n, f32::INFINITY)));
                }
            }
        }
        let t = Topology::new(own, channel.values.len());
        sharp.pin(&t, |corners| match channel.seams {
            Seams::Linear => true,
            Seams::Corners => corners == 1,
            Seams::AllLinear | Seams::Smooth => false,
        });
        sharp
    }

    /// Faces of the control mesh that touch a boundary, where those are not shown.
    fn hidden(&self, mesh: &ControlMesh) -> Vec<bool> {
        let mut hidden = vec![false; mesh.face_sizes.len()];
        if mesh.boundary == Boundary::None {
            let t = Topology::new(self.faces(&mesh.corners), mesh.positions.len());
            for (e, ends) in t.edges.iter().enumerate().filter(|(e, _)| t.corners_of_edge(*e).len() == 1) {
                debug_assert!(!t.is_manifold(e));
                let faces = ends.iter().flat_map(|v| t.corners_at(*v as usize)).map(|c| t.face_of[*c as usize]);
                faces.for_each(|f| hidden[self.control_face[f as usize] as usize] = true);
            }
        }
        hidden
    }
}

impl Sharp {
    /// Makes vertices infinitely sharp where several sheets meet in a point, and those on a boundary that `pinned` says, by the number of
    /// their corners.
    fn pin(&mut self, t: &Topology, pinned: impl Fn(usize) -> bool) {
        for v in 0..t.vertex_count() {
            let corners = t.corners_at(v).len();
            let on_boundary = t.edges_at(v).iter().any(|e| t.corners_of_edge(*e as usize).len() == 1);
            if corners > 1 && t.fans(v, |_| false).len() > 1 || on_boundary && pinned(corners) {
                self.vertices.push((v as u32, f32::INFINITY));
            }
        }
    }
}

/// A mesh of the last level, its values not yet on the limit.
struct Fine<V> {
    topology: Topology,
    sharpness: Sharpness,
    values: Vec<V>,
}

impl<V: Value> Fine<V> {
    fn new(faces: Faces, mut values: Vec<V>, sharp: &Sharp, levels: u32, weights: Weights, split: Split) -> Self {
        let mut topology = Topology::new(faces, values.len());
        let mut sharp = sharp.clone();
        let mut sharpness = Sharpness::new(&topology, &sharp);
        for _ in 0..levels {
            let (faces, count) = refine::faces(&topology, split);
            values = refine::values(&topology, &sharpness, &values, weights, split);
            sharp = sharp.weakened(&topology, topology.vertex_count() as u32);
            topology = Topology::new(faces, count);
            sharpness = Sharpness::new(&topology, &sharp);
        }
        Fine { topology, sharpness, values }
    }

    fn limits(&self, weights: Weights) -> Vec<V> {
        refine::limits(&self.topology, &self.sharpness, &self.values, weights)
    }
}

/// Numbers the values at corners so that equal ones of a vertex are one: `(value numbers, values)` of a [`Channel`] from what `value` says.
pub fn indexed(corners: &[u32], value: impl Fn(usize) -> Vec4) -> (Vec<u32>, Vec<Vec4>) {
    let mut known: HashMap<(u32, [u32; 4]), u32> = HashMap::new();
    let mut values = Vec::new();
    let number = |(c, vertex): (usize, &u32)| {
        let v = value(c);
        *known.entry((*vertex, v.to_array().map(f32::to_bits))).or_insert_with(|| {
            values.push(v);
            values.len() as u32 - 1
        })
    };
    let numbers = corners.iter().enumerate().map(number).collect();
    (numbers, values)
}
