//! Shapes become meshes; a round sphere stays one.

use super::params::Params;
use super::{Fault, Place};
use crate::shape::{CurveBasis, CurveKind, Curves, Mesh, Sphere};
use crate::subdivision::{self, Boundary, Channels, ControlMesh, Scheme};
use glam::{DMat4, DVec3, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

/// What a shape becomes.
pub enum Form {
    /// A whole sphere about the origin.
    Sphere(f32),
    /// Triangles.
    Mesh(Mesh),
    /// A curve.
    Curve(Curves),
}

/// Steps around a round thing: its outline is within 1e-4 of its radius.
const AROUND: usize = 256;

/// A shape in its own space; those that bring warnings or files are made elsewhere (`loopsubdiv`, `plymesh`). Fails where the type is not known, a radius, angle or width
/// is out of range, or points, indices and what belongs to them do not fit together.
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
        "curve" => Form::Curve(curve(p, place)?),
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
            let known =
                "trianglemesh, plymesh, sphere, disk, cylinder, bilinearmesh, loopsubdiv or curve: others are not supported yet";
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
pub fn grid([nu, nv]: [usize; 2], point: impl Fn(f32, f32) -> (Vec3, Vec3)) -> Mesh {
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

/// A `curve`: one strand. Of degree 2 it becomes one of degree 3, which is the same curve. Source: pbrt-v4 file format, "Curves".
fn curve(p: &Params, place: Place) -> Result<Curves, Fault> {
    // How often pbrt splits a curve for its hierarchy.
    p.get("splitdepth");
    let points = p.vectors("P")?.ok_or_else(|| place.fault("a curve without P", "\"point3 P\""))?;
    let width = p.float("width", 1.0)?;
    let radii = [p.float("width0", width)?, p.float("width1", width)?].map(|w| 0.5 * w as f32);
    if radii.iter().any(|r| !(*r >= 0.0)) {
        return Err(place.fault("a curve of negative width", "widths of at least 0"));
    }
    let degree = match p.integer("degree", 3)? {
        2 => 2,
        3 => 3,
        other => return Err(place.fault(format!("a curve of degree {other}"), "2 or 3")),
    };
    let basis = match p.text("basis")? {
        None | Some("bezier") => CurveBasis::Bezier,
        Some("bspline") => CurveBasis::BSpline,
        Some(other) => return Err(place.fault(format!("basis \"{other}\" of a curve"), "bezier or bspline")),
    };
    let kind = match p.text("type")? {
        None | Some("flat") => CurveKind::Flat,
        Some("cylinder") => CurveKind::Cylinder,
        Some("ribbon") => CurveKind::Ribbon,
        Some(other) => return Err(place.fault(format!("a curve of type \"{other}\""), "flat, cylinder or ribbon")),
    };
    let n = points.len();
    let segments = match basis {
        CurveBasis::Bezier if n > degree && (n - 1) % degree == 0 => (n - 1) / degree,
        CurveBasis::BSpline if n > degree => n - degree,
        CurveBasis::Bezier => {
            return Err(place.fault(
                format!("{n} points of a Bézier curve of degree {degree}"),
                format!("{} or {degree} more, again and again", degree + 1),
            ));
        }
        CurveBasis::BSpline => {
            return Err(place.fault(format!("{n} points of a B-spline of degree {degree}"), format!("at least {}", degree + 1)));
        }
    };
    let normals = match (p.vectors("N")?, kind) {
        (Some(normals), CurveKind::Ribbon) if normals.len() == segments + 1 => {
            normals.into_iter().map(|n| n.normalize_or_zero()).collect()
        }
        (Some(normals), CurveKind::Ribbon) => {
            return Err(place.fault(
                format!("{} normals of a ribbon of {segments} segments", normals.len()),
                format!("{}: one for each end of a segment", segments + 1),
            ));
        }
        (None, CurveKind::Ribbon) => return Err(place.fault("a ribbon without N", "\"normal N\", one for each end of a segment")),
        _ => vec![],
    };
    let (basis, points) = match (degree, basis) {
        (3, basis) => (basis, points),
        (_, CurveBasis::Bezier) => (CurveBasis::Bezier, elevated(&points)),
        // The corners of a quadratic B-spline's Bézier form lie in the middle between its control points (PBR 4ed §6.7).
        (_, CurveBasis::BSpline) => {
            let mut quadratic = vec![points[0].midpoint(points[1])];
            for i in 1..=segments {
                quadratic.extend([points[i], points[i].midpoint(points[i + 1])]);
            }
            (CurveBasis::Bezier, elevated(&quadratic))
        }
    };
    let mut curves = Curves::new(kind, basis);
    curves.push(&points, radii, &normals);
    Ok(curves)
}

/// Control points of degree 3 of the same Bézier curve as of degree 2. Source: Farin, "Curves and Surfaces for CAGD" §6.1.
fn elevated(points: &[Vec3]) -> Vec<Vec3> {
    let mut out = vec![points[0]];
    for i in (2..points.len()).step_by(2) {
        let [a, b, c] = [points[i - 2], points[i - 1], points[i]];
        out.extend([a.lerp(b, 2.0 / 3.0), c.lerp(b, 2.0 / 3.0), c]);
    }
    out
}

fn triangle_mesh(p: &Params, place: Place) -> Result<Mesh, Fault> {
    p.get("faceIndices");
    let positions = p.vectors("P")?.ok_or_else(|| place.fault("a trianglemesh without P", "\"point3 P\""))?;
    let indices = match p.indices("indices")? {
        Some(i) => i,
        None if positions.len() == 3 => vec![0, 1, 2],
        None => return Err(place.fault("a trianglemesh without indices", "\"integer indices\"")),
    };
    let triangles = triples(&indices, positions.len(), place)?;
    let mut mesh = with_attributes(Mesh { positions, triangles, ..Mesh::default() }, p, place)?;
    if let Some(tangents) = p.vectors("S")? {
        if tangents.len() != mesh.positions.len() {
            let found = format!("{} tangents (S) for {} points", tangents.len(), mesh.positions.len());
            return Err(place.fault(found, "one for each point"));
        }
        mesh.tangents = tangents.into_iter().map(|s| s.normalize_or(Vec3::X).extend(1.0)).collect();
    }
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
        mesh.normals = normals.into_iter().map(|n| n.normalize_or_zero()).collect();
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

/// Most triangles that have texture coordinates at once, whether their material asks for them or not.
const FEW_TRIANGLES: usize = 64;

/// Coordinates of few triangles without any; of more only where their material asks for them ([`own_uvs`]).
pub fn default_uvs(mesh: &mut Mesh) {
    if mesh.triangles.len() <= FEW_TRIANGLES {
        own_uvs(mesh);
    }
}

/// Without coordinates every triangle has (0, 0), (1, 0), (1, 1), and so corners of its own.
pub fn own_uvs(mesh: &mut Mesh) {
    if mesh.uvs[0].is_empty() && !mesh.triangles.is_empty() {
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

/// Loop's subdivision with its points on the limit surface, and what is to be said of it. Boundaries are as pbrt has them, but for their limit:
/// pbrt weighs by (1, 3, 1)/5, which is that of another rule; the limit of its rule is (1, 4, 1)/6. Fails without points or indices, where they do not fit together or
/// are not finite, and for more than [`subdivision::MOST_LEVELS`] levels.
pub fn loop_subdivision(p: &Params, place: Place) -> Result<(Mesh, Option<String>), Fault> {
    p.get("scheme");
    let levels = p.integer("levels", 3)?;
    let most = subdivision::MOST_LEVELS;
    let Some(levels) = u32::try_from(levels).ok().filter(|n| *n <= most) else {
        return Err(place.fault(format!("{levels} levels"), format!("0 to {most}")));
    };
    let positions = p.vectors("P")?.ok_or_else(|| place.fault("a loopsubdiv without P", "\"point3 P\""))?;
    let indices = p.indices("indices")?.ok_or_else(|| place.fault("a loopsubdiv without indices", "\"integer indices\""))?;
    let triangles = triples(&indices, positions.len(), place)?;
    let boundary = Boundary::EdgeOnly;
    let control = ControlMesh { boundary, ..ControlMesh::of_triangles(&Mesh { positions, triangles, ..Mesh::default() }) };
    let refined = subdivision::subdivide(&control, Scheme::Loop, levels)
        .map_err(|e| place.fault(format!("a loopsubdiv: {e}"), "fewer triangles, of finite points"))?;
    let mut mesh = refined.mesh(|_| true, Channels::default());
    default_uvs(&mut mesh);
    let reduced = format!(
        "{levels} levels would be more than {} triangles: subdivided to level {}",
        subdivision::MOST_TRIANGLES,
        refined.level
    );
    Ok((mesh, (refined.level < levels).then_some(reduced)))
}

#[cfg(test)]
mod tests {
    use super::super::load as load_pbrt;
    use super::*;
    use crate::scene::Viewpoint;
    use crate::{Description, Scene};
    use diopter_light::Ray;

    const HEAD: &str = "LookAt 0 0 0  0 0 1  0 1 0\nFilm \"rgb\" \"integer xresolution\" 100 \"integer yresolution\" 100\n\
        Camera \"perspective\" \"float fov\" 90\n";

    fn try_load(text: &str) -> Result<Description, String> {
        load_pbrt(text.as_bytes(), "test.pbrt", &|_: &str| Err("there is no such file".to_owned())).map_err(|e| e.to_string())
    }

    fn load(text: &str) -> Description {
        try_load(text).unwrap_or_else(|e| panic!("{e}"))
    }

    /// The ray through a place of the picture, −1 to 1 across and up, of a square picture.
    fn through(view: &Viewpoint, x: f32, y: f32) -> Ray {
        let tan = (0.5 * view.vertical_fov().unwrap()).tan();
        let m = view.world_from_camera;
        let direction = m.transform_vector3(Vec3::new(x * tan, y * tan, -1.0)).normalize();
        Ray { origin: m.translation.into(), direction, time_s: 0.0 }
    }

    /// Sums the fraction of rays through a square of the picture that meet something, on a grid.
    fn covered(scene: &Scene, half: f32) -> f64 {
        let view = &scene.description().cameras[0];
        let n = 200;
        let at = |i: u32| half * (2.0 * (i as f32 + 0.5) / n as f32 - 1.0);
        let met = |i: u32| scene.intersect(&through(view, at(i % n), at(i / n)), f32::INFINITY).is_some();
        (0..n * n).filter(|i| met(*i)).count() as f64 / f64::from(n * n)
    }

    #[test]
    fn curves_of_every_kind_are_met_where_they_lie() {
        // A straight strand of width 0.2 from x = −1 to 1 at a distance of 2, seen in a square of ±0.5 in the picture: ±1 there.
        let line = "\"point3 P\" [-1 0 2  -0.3333333 0 2  0.3333333 0 2  1 0 2]";
        let cases = [
            format!("{line} \"float width\" 0.2"),
            format!("{line} \"float width0\" 0.1 \"float width1\" 0.3 \"string type\" \"cylinder\""),
            format!("{line} \"float width\" 0.4 \"string type\" \"ribbon\" \"normal N\" [0 0.8660254 0.5  0 0.8660254 0.5]"),
            "\"integer degree\" 2 \"point3 P\" [-1 0 2  0 0 2  1 0 2] \"float width\" 0.2".to_owned(),
            "\"integer degree\" 2 \"string basis\" \"bspline\" \"point3 P\" [-2 0 2  0 0 2  2 0 2] \"float width\" 0.2".to_owned(),
            "\"string basis\" \"bspline\" \"point3 P\" [-3 0 2  -1 0 2  1 0 2  3 0 2] \"float width\" 0.2 \"integer splitdepth\" 5"
                .to_owned(),
        ];
        for case in cases {
            let d = load(&format!("{HEAD}WorldBegin Shape \"curve\" {case}"));
            assert!(d.warnings.is_empty(), "{:?}", d.warnings);
            let covered = covered(&Scene::build(d).unwrap(), 0.5);
            // 2 × 0.2 of 2 × 2; a row of the grid is 0.005.
            assert!((covered - 0.1).abs() < 0.006, "{case}: {covered}");
        }
    }

    #[test]
    fn strands_alike_are_one_set_and_instances_share_it() {
        let strand = |x: f32| format!("Shape \"curve\" \"point3 P\" [{x} -1 4 {x} 0 4 {x} 1 4 {x} 2 4] \"float width\" 0.1\n");
        let strands: String = (0..50).map(|i| strand(i as f32 * 0.1)).collect();
        let d = load(&format!("{HEAD}WorldBegin {strands} Material \"diffuse\" {}", strand(9.0)));
        assert_eq!(d.curves.iter().map(|c| c.segments.len()).collect::<Vec<_>>(), [50, 1]);
        assert_eq!((d.objects.len(), d.curves[0].points.len()), (2, 200));
        let tuft = format!(
            "ObjectBegin \"tuft\" {} ObjectEnd ObjectInstance \"tuft\" Translate 1 0 0 ObjectInstance \"tuft\"",
            strand(0.0)
        );
        let d = load(&format!("{HEAD}WorldBegin {tuft}"));
        assert_eq!((d.curves.len(), d.objects.len()), (1, 2));
        let scene = Scene::build(d).unwrap();
        let view = &scene.description().cameras[0];
        let met = |x: f32| scene.intersect(&through(view, x / 4.0, 0.0), f32::INFINITY);
        assert!(met(0.0).is_some() && met(1.0).is_some() && met(0.5).is_none());
        // In the mirrored world of a left-handed file, too, the surface faces the camera and v grows the same way along x as without.
        let surface = met(0.02).unwrap();
        assert!(
            surface.ng.dot(through(view, 0.005, 0.0).direction) < -0.99 && (surface.uv[0].y - 0.5).abs() > 0.1,
            "{surface:?}"
        );
        assert!(
            (surface.point.x.abs() - 0.02).abs() < 1e-3
                && matches!(surface.detail, crate::shape::Detail::Strand(s) if (s.radius - 0.05).abs() < 1e-5)
        );
    }

    #[test]
    fn curves_with_holes_and_curves_that_move_are_met_so() {
        let line = "\"point3 P\" [-1 0 2  -0.3333333 0 2  0.3333333 0 2  1 0 2] \"float width\" 0.2";
        let half = load(&format!("{HEAD}WorldBegin Shape \"curve\" {line} \"float alpha\" 0.5"));
        let found = covered(&Scene::build(half).unwrap(), 0.5);
        assert!((found - 0.05).abs() < 0.006, "{found}");
        let moving =
            load(&format!("{HEAD}WorldBegin ActiveTransform EndTime Translate 0 1 0 ActiveTransform All Shape \"curve\" {line}"));
        let mut scene = Scene::build(moving).unwrap();
        scene.pose(0.0, 1.0);
        let view = scene.description().cameras[0].clone();
        for (time_s, y) in [(0.0, 0.0), (0.5, 0.5), (1.0, 1.0)] {
            let ray = |y: f32| Ray { time_s, ..through(&view, 0.0, y / 2.0) };
            let met = |y: f32| scene.intersect(&ray(y), f32::INFINITY).is_some();
            assert!(met(y) && !met(y + 0.15) && !met(y - 0.15), "{time_s}");
            assert!(scene.occluded(&ray(y), 10.0));
        }
    }

    #[test]
    fn curves_that_make_no_sense_are_refused() {
        for (curve, found) in [
            ("", "without P"),
            ("\"point3 P\" [0 0 1 1 0 1 2 0 1]", "3 points of a Bézier curve"),
            ("\"string basis\" \"bspline\" \"point3 P\" [0 0 1 1 0 1 2 0 1]", "3 points of a B-spline"),
            ("\"point3 P\" [0 0 1 1 0 1 2 0 1 3 0 1] \"string type\" \"ribbon\"", "ribbon without N"),
            ("\"point3 P\" [0 0 1 1 0 1 2 0 1 3 0 1] \"string type\" \"ribbon\" \"normal N\" [0 0 1]", "1 normals"),
            ("\"point3 P\" [0 0 1 1 0 1 2 0 1 3 0 1] \"integer degree\" 4", "degree 4"),
            ("\"point3 P\" [0 0 1 1 0 1 2 0 1 3 0 1] \"float width\" -1", "negative width"),
        ] {
            let error = try_load(&format!("{HEAD}WorldBegin Shape \"curve\" {curve}")).unwrap_err();
            assert!(error.contains(found), "{error}");
        }
    }
}
