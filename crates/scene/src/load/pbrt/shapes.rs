//! Shapes become meshes; a round sphere stays one.

use super::params::Params;
use super::{Fault, Place};
use crate::shape::{Mesh, Sphere};
use glam::{DMat4, DVec3, Vec2, Vec3};
use std::collections::HashMap;
use std::f32::consts::{PI, TAU};

/// What a shape becomes.
pub enum Form {
    /// A whole sphere about the origin.
    Sphere(f32),
    /// Triangles.
    Mesh(Mesh),
}

/// Steps around a round thing: its outline is within 1e-4 of its radius.
const AROUND: usize = 256;
/// Most levels of subdivision.
const MOST_LEVELS: i64 = 10;

/// A shape in its own space.
pub fn make(kind: &str, p: &Params, place: Place) -> Result<Form, Fault> {
    let radius = || {
        let r = p.float("radius", 1.0)? as f32;
        if r > 0.0 { Ok(r) } else { Err(place.fault(format!("a radius of {r}"), "a length above 0")) }
    };
    let turn = || {
        let phi = p.float("phimax", 360.0)? as f32;
        if phi > 0.0 { Ok(phi.min(360.0).to_radians()) } else { Err(place.fault(format!("phimax {phi}"), "an angle above 0")) }
    };
    Ok(match kind {
        "trianglemesh" => Form::Mesh(triangle_mesh(p, place)?),
        "bilinearmesh" => Form::Mesh(bilinear_mesh(p, place)?),
        "loopsubdiv" => Form::Mesh(loop_subdivision(p, place)?),
        "sphere" => {
            let r = radius()?;
            let (low, high) = (p.float("zmin", f64::from(-r))? as f32, p.float("zmax", f64::from(r))? as f32);
            let phi = turn()?;
            if low <= -r && high >= r && phi >= TAU * 0.999_99 {
                return Ok(Form::Sphere(r));
            }
            let theta = |z: f32| (z / r).clamp(-1.0, 1.0).acos();
            let (from, to) = (theta(low.min(high)), theta(low.max(high)));
            let point = move |u: f32, v: f32| {
                let (theta, phi) = (from + (to - from) * v, phi * u);
                let n = Vec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                (n * r, n)
            };
            Form::Mesh(grid([AROUND, AROUND / 2], point))
        }
        "disk" => {
            let (r, inner, height) = (radius()?, p.float("innerradius", 0.0)? as f32, p.float("height", 0.0)? as f32);
            let phi = turn()?;
            let point = move |u: f32, v: f32| {
                let (r, phi) = (r + (inner - r) * v, phi * u);
                (Vec3::new(r * phi.cos(), r * phi.sin(), height), Vec3::Z)
            };
            Form::Mesh(grid([AROUND, 1], point))
        }
        "cylinder" => {
            let (r, low, high) = (radius()?, p.float("zmin", -1.0)? as f32, p.float("zmax", 1.0)? as f32);
            let phi = turn()?;
            let point = move |u: f32, v: f32| {
                let phi = phi * u;
                let n = Vec3::new(phi.cos(), phi.sin(), 0.0);
                (n * r + Vec3::Z * (low.min(high) + (high - low).abs() * v), n)
            };
            Form::Mesh(grid([AROUND, 1], point))
        }
        other => {
            let known = "trianglemesh, plymesh, sphere, disk, cylinder, bilinearmesh or loopsubdiv: others are not supported yet";
            return Err(place.fault(format!("shape \"{other}\""), known));
        }
    })
}

/// Triangles of a whole sphere, fine enough to be taken for round.
pub fn ball(r: f32) -> Mesh {
    let point = move |u: f32, v: f32| {
        let (theta, phi) = (PI * (1.0 - v), TAU * u);
        let s = if v == 0.0 || v == 1.0 { 0.0 } else { theta.sin() };
        let n = Vec3::new(s * phi.cos(), s * phi.sin(), theta.cos());
        (n * r, n)
    };
    grid([AROUND, AROUND / 2], point)
}

/// A sphere that is turned, moved and scaled evenly is a sphere.
pub fn sphere_in_world(radius: f32, place: DMat4) -> Option<Sphere> {
    let axes = [place.x_axis, place.y_axis, place.z_axis].map(|a| a.truncate());
    let length = axes[0].length();
    let even = axes.iter().all(|a| (a.length() / length - 1.0).abs() < 1e-4);
    let square = [(0, 1), (0, 2), (1, 2)].iter().all(|(i, j)| axes[*i].dot(axes[*j]).abs() < 1e-4 * length * length);
    let center: DVec3 = place.w_axis.truncate();
    (even && square).then(|| Sphere { center: center.as_vec3(), radius: (f64::from(radius) * length) as f32 })
}

/// A surface over u and v in 0..1: place and unit normal. Outside is where ∂p/∂u × ∂p/∂v points.
fn grid([nu, nv]: [usize; 2], point: impl Fn(f32, f32) -> (Vec3, Vec3)) -> Mesh {
    let mut mesh = Mesh::default();
    for j in 0..=nv {
        for i in 0..=nu {
            let uv = Vec2::new(i as f32 / nu as f32, j as f32 / nv as f32);
            let (p, n) = point(uv.x, uv.y);
            mesh.positions.push(p);
            mesh.normals.push(n);
            mesh.uvs[0].push(uv);
        }
    }
    let at = |i: usize, j: usize| (j * (nu + 1) + i) as u32;
    for j in 0..nv {
        for i in 0..nu {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            // Not at poles, where two corners are one.
            let p = |i: u32| mesh.positions[i as usize];
            let whole = |t: &[u32; 3]| (p(t[1]) - p(t[0])).cross(p(t[2]) - p(t[0])).length_squared() > 0.0;
            let both = [[a, b, c], [a, c, d]].into_iter().filter(whole).collect::<Vec<_>>();
            mesh.triangles.extend(both);
        }
    }
    agree_with_normals(&mut mesh);
    mesh
}

fn triangle_mesh(p: &Params, place: Place) -> Result<Mesh, Fault> {
    for name in ["S", "faceIndices"] {
        p.get(name);
    }
    let positions = p.vectors("P")?.ok_or_else(|| place.fault("a trianglemesh without P", "\"point3 P\""))?;
    let indices = match p.indices("indices")? {
        Some(i) => i,
        None if positions.len() == 3 => vec![0, 1, 2],
        None => return Err(place.fault("a trianglemesh without indices", "\"integer indices\"")),
    };
    let triangles = triples(&indices, positions.len(), place)?;
    let mesh = with_attributes(Mesh { positions, triangles, ..Mesh::default() }, p, place)?;
    Ok(mesh)
}

fn triples(indices: &[u32], count: usize, place: Place) -> Result<Vec<[u32; 3]>, Fault> {
    let (triangles, rest) = indices.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(place.fault(format!("{} indices", indices.len()), "a multiple of 3"));
    }
    match indices.iter().find(|i| **i as usize >= count) {
        Some(i) => Err(place.fault(format!("index {i}"), format!("less than {count}, the number of points"))),
        None => Ok(triangles.to_vec()),
    }
}

/// Normals and texture coordinates of a mesh of this directive.
fn with_attributes(mut mesh: Mesh, p: &Params, place: Place) -> Result<Mesh, Fault> {
    let n = mesh.positions.len();
    let fits = |what: &str, found: usize| match found == n {
        true => Ok(()),
        false => Err(place.fault(format!("{found} {what} for {n} points"), "one for each point")),
    };
    if let Some(normals) = p.vectors("N")? {
        fits("normals", normals.len())?;
        mesh.normals = normals.into_iter().map(|n| n.normalize_or(Vec3::Z)).collect();
    }
    let uv = p.points2("uv")?;
    if let Some(uv) = uv {
        fits("uv", uv.len())?;
        mesh.uvs[0] = uv;
    }
    agree_with_normals(&mut mesh);
    default_uvs(&mut mesh);
    Ok(mesh)
}

/// Triangles are turned so that their outside is that of their normals.
pub fn agree_with_normals(mesh: &mut Mesh) {
    if mesh.normals.is_empty() {
        return;
    }
    let (positions, normals) = (&mesh.positions, &mesh.normals);
    for t in &mut mesh.triangles {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        let mean: Vec3 = t.iter().map(|i| normals[*i as usize]).sum();
        if (b - a).cross(c - a).dot(mean) < 0.0 {
            t.swap(1, 2);
        }
    }
}

/// Without coordinates every triangle has (0, 0), (1, 0), (1, 1): only what a constant texture needs is kept.
pub fn default_uvs(mesh: &mut Mesh) {
    if mesh.uvs[0].is_empty() && (1..=64).contains(&mesh.triangles.len()) {
        // Few triangles: corners of their own.
        let list = |v: &[Vec3]| mesh.triangles.iter().flatten().map(|i| v[*i as usize]).collect::<Vec<_>>();
        let positions = list(&mesh.positions);
        let normals = if mesh.normals.is_empty() { vec![] } else { list(&mesh.normals) };
        mesh.uvs[0] = mesh.triangles.iter().flat_map(|_| [Vec2::ZERO, Vec2::X, Vec2::ONE]).collect();
        mesh.triangles = (0..mesh.triangles.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        (mesh.positions, mesh.normals) = (positions, normals);
    }
}

/// ReverseOrientation: outside becomes inside.
pub fn reverse(mesh: &mut Mesh) {
    mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    mesh.normals.iter_mut().for_each(|n| *n = -*n);
}

fn bilinear_mesh(p: &Params, place: Place) -> Result<Mesh, Fault> {
    p.get("faceIndices");
    if p.get("emissionfilename").is_some() {
        return Err(place.fault("a bilinear mesh with emissionfilename", "one without"));
    }
    let positions = p.vectors("P")?.ok_or_else(|| place.fault("a bilinearmesh without P", "\"point3 P\""))?;
    let indices = match p.indices("indices")? {
        Some(i) => i,
        None if positions.len() == 4 => vec![0, 1, 2, 3],
        None => return Err(place.fault("a bilinearmesh without indices", "\"integer indices\"")),
    };
    let (patches, rest) = indices.as_chunks::<4>();
    if !rest.is_empty() {
        return Err(place.fault(format!("{} indices", indices.len()), "a multiple of 4"));
    }
    if let Some(i) = indices.iter().find(|i| **i as usize >= positions.len()) {
        return Err(place.fault(format!("index {i}"), format!("less than {}, the number of points", positions.len())));
    }
    let whole = with_attributes(Mesh { positions, ..Mesh::default() }, p, place)?;
    let mut mesh = Mesh::default();
    for patch in patches {
        let corner = |list: &[Vec3]| patch.map(|i| list[i as usize]);
        let [a, b, c, d] = corner(&whole.positions);
        // Flat ones are two triangles, bent ones many.
        let flat = (b - a).cross(c - a).normalize_or_zero().dot(d - a).abs() < 1e-4 * (d - a).length();
        let n = if flat { 1 } else { 16 };
        let normals = (!whole.normals.is_empty()).then(|| corner(&whole.normals));
        let uv = match whole.uvs[0].is_empty() {
            true => [Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE],
            false => patch.map(|i| whole.uvs[0][i as usize]),
        };
        let first = mesh.positions.len() as u32;
        for j in 0..=n {
            for i in 0..=n {
                let (u, v) = (i as f32 / n as f32, j as f32 / n as f32);
                let mix = |[a, b, c, d]: [Vec3; 4]| a.lerp(b, u).lerp(c.lerp(d, u), v);
                mesh.positions.push(mix([a, b, c, d]));
                mesh.uvs[0].push(uv[0].lerp(uv[1], u).lerp(uv[2].lerp(uv[3], u), v));
                mesh.normals.push(match normals {
                    Some(n) => mix(n).normalize_or(Vec3::Z),
                    None => (b - a).lerp(d - c, v).cross((c - a).lerp(d - b, u)).normalize_or(Vec3::Z),
                });
            }
        }
        let at = |i: u32, j: u32| first + j * (n as u32 + 1) + i;
        for j in 0..n as u32 {
            for i in 0..n as u32 {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
            }
        }
    }
    agree_with_normals(&mut mesh);
    Ok(mesh)
}

/// Loop's subdivision, points pushed to the limit surface. Sources: C. Loop 1987, "Smooth subdivision surfaces based on triangles"; limit
/// positions and tangents as H. Hoppe et al. 1994, "Piecewise smooth surface reconstruction", and pbrt §3.8 of the 3rd edition give them.
fn loop_subdivision(p: &Params, place: Place) -> Result<Mesh, Fault> {
    p.get("scheme");
    let levels = p.integer("levels", 3)?;
    if !(0..=MOST_LEVELS).contains(&levels) {
        return Err(place.fault(format!("{levels} levels"), format!("0 to {MOST_LEVELS}")));
    }
    let positions = p.vectors("P")?.ok_or_else(|| place.fault("a loopsubdiv without P", "\"point3 P\""))?;
    let indices = p.indices("indices")?.ok_or_else(|| place.fault("a loopsubdiv without indices", "\"integer indices\""))?;
    let mut triangles = triples(&indices, positions.len(), place)?;
    if triangles.len().checked_mul(1 << (2 * levels)).is_none_or(|n| n > 1 << 22) {
        return Err(
            place.fault(format!("{} triangles subdivided {levels} times", triangles.len()), "at most 4 million in the end")
        );
    }
    let mut points: Vec<DVec3> = positions.iter().map(|p| p.as_dvec3()).collect();
    for _ in 0..levels {
        let around = Neighbours::of(&triangles, points.len());
        let mut next: Vec<DVec3> = (0..points.len()).map(|v| around.smoothed(v, &points)).collect();
        let mut middle: HashMap<(u32, u32), u32> = HashMap::new();
        let mut fine = Vec::with_capacity(4 * triangles.len());
        for t in &triangles {
            let edge = |i: usize| (t[i].min(t[(i + 1) % 3]), t[i].max(t[(i + 1) % 3]));
            let mids: [u32; 3] = std::array::from_fn(|i| {
                let (a, b) = edge(i);
                *middle.entry((a, b)).or_insert_with(|| {
                    let [pa, pb] = [a, b].map(|k| points[k as usize]);
                    let opposite = around.opposite.get(&(a, b)).map_or(&[][..], Vec::as_slice);
                    next.push(match opposite {
                        [c, d] => (pa + pb) * 0.375 + (points[*c as usize] + points[*d as usize]) * 0.125,
                        _ => (pa + pb) * 0.5,
                    });
                    next.len() as u32 - 1
                })
            });
            let [a, b, c] = *t;
            let [ab, bc, ca] = mids;
            fine.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
        }
        (points, triangles) = (next, fine);
    }
    let around = Neighbours::of(&triangles, points.len());
    let limit: Vec<DVec3> = (0..points.len()).map(|v| around.limit(v, &points)).collect();
    let mut normals = vec![DVec3::ZERO; limit.len()];
    for t in &triangles {
        // Weighted by area, which on the limit of equal triangles is what tangents give to high order.
        let [a, b, c] = t.map(|i| limit[i as usize]);
        let n = (b - a).cross(c - a);
        t.iter().for_each(|i| normals[*i as usize] += n);
    }
    let mut mesh = Mesh {
        positions: limit.iter().map(|p| p.as_vec3()).collect(),
        normals: normals.iter().map(|n| n.as_vec3().normalize_or(Vec3::Z)).collect(),
        triangles,
        ..Mesh::default()
    };
    default_uvs(&mut mesh);
    Ok(mesh)
}

/// Who is beside whom in a mesh.
struct Neighbours {
    /// Of each point: its neighbours, and those along the edge of the mesh.
    ring: Vec<(Vec<u32>, Vec<u32>)>,
    /// Points across from an edge.
    opposite: HashMap<(u32, u32), Vec<u32>>,
}

impl Neighbours {
    fn of(triangles: &[[u32; 3]], count: usize) -> Self {
        let mut opposite: HashMap<(u32, u32), Vec<u32>> = HashMap::new();
        for t in triangles {
            for i in 0..3 {
                let (a, b) = (t[i], t[(i + 1) % 3]);
                opposite.entry((a.min(b), a.max(b))).or_default().push(t[(i + 2) % 3]);
            }
        }
        let mut ring = vec![(vec![], vec![]); count];
        let mut edges: Vec<_> = opposite.iter().map(|(e, o)| (*e, o.len())).collect();
        edges.sort_unstable();
        for ((a, b), sides) in edges {
            for (v, w) in [(a, b), (b, a)] {
                ring[v as usize].0.push(w);
                if sides == 1 {
                    ring[v as usize].1.push(w);
                }
            }
        }
        Neighbours { ring, opposite }
    }

    fn weighted(&self, v: usize, points: &[DVec3], interior: impl Fn(f64) -> f64, edge: f64) -> DVec3 {
        let (all, border) = &self.ring[v];
        let (of, beta) = match border.len() {
            0 if all.is_empty() => return points[v],
            0 => (all, interior(all.len() as f64)),
            2 => (border, edge),
            _ => return points[v],
        };
        points[v] * (1.0 - of.len() as f64 * beta) + of.iter().map(|w| points[*w as usize]).sum::<DVec3>() * beta
    }

    fn smoothed(&self, v: usize, points: &[DVec3]) -> DVec3 {
        self.weighted(v, points, beta, 0.125)
    }

    fn limit(&self, v: usize, points: &[DVec3]) -> DVec3 {
        self.weighted(v, points, |n| 1.0 / (n + 3.0 / (8.0 * beta(n))), 0.2)
    }
}

/// Loop's weight of a neighbour in Warren's form: 3/16 of three, else 3 / (8 n).
fn beta(n: f64) -> f64 {
    if n == 3.0 { 3.0 / 16.0 } else { 3.0 / (8.0 * n) }
}
