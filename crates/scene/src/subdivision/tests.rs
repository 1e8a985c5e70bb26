//! Subdivision against closed forms: B-splines, box splines, eigenvectors; and meshes that make no sense.

use super::*;
use crate::shape::Mesh;
use glam::Vec2;

const CUBE: [[u32; 4]; 6] = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];

/// A cube from −1 to 1 whose vertex `i` is at the signs of its bits.
fn cube() -> ControlMesh {
    let sign = |i: u32, bit: u32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
    ControlMesh {
        positions: (0..8).map(|i| Vec3::new(sign(i, 0), sign(i, 1), sign(i, 2))).collect(),
        face_sizes: vec![4; 6],
        corners: CUBE.concat(),
        ..ControlMesh::default()
    }
}

fn tetrahedron() -> ControlMesh {
    ControlMesh {
        positions: [(1.0, 1.0, 1.0), (1.0, -1.0, -1.0), (-1.0, 1.0, -1.0), (-1.0, -1.0, 1.0)].map(Vec3::from).to_vec(),
        face_sizes: vec![3; 4],
        corners: vec![0, 1, 2, 0, 3, 1, 0, 2, 3, 1, 3, 2],
        ..ControlMesh::default()
    }
}

/// Numbers between −1 and 1 that look like chance.
fn noise(i: usize) -> f32 {
    let x = (i as u32).wrapping_mul(2_654_435_769) ^ 0x9e37_79b9;
    let x = (x ^ (x >> 15)).wrapping_mul(0x85eb_ca6b);
    ((x ^ (x >> 13)) >> 8) as f32 / (1u32 << 23) as f32 - 1.0
}

/// A grid of `n` × `n` vertices in the plane with heights.
fn grid(n: usize, height: impl Fn(usize, usize) -> f32) -> ControlMesh {
    let at = |i: usize, j: usize| (j * n + i) as u32;
    let cells = (0..n - 1).flat_map(|j| (0..n - 1).map(move |i| (i, j)));
    ControlMesh {
        positions: (0..n * n).map(|k| Vec3::new((k % n) as f32, (k / n) as f32, height(k % n, k / n))).collect(),
        face_sizes: vec![4; (n - 1) * (n - 1)],
        corners: cells.flat_map(|(i, j)| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]).collect(),
        ..ControlMesh::default()
    }
}

fn refined(mesh: &ControlMesh, scheme: Scheme, level: u32) -> Refined {
    subdivide(mesh, scheme, level).unwrap()
}

fn whole(refined: &Refined) -> Mesh {
    refined.mesh(|_| true, Channels::default())
}

fn volume(mesh: &Mesh) -> f64 {
    let six = |t: usize| {
        let [a, b, c] = mesh.corners(t).map(|p| p.as_dvec3());
        a.dot(b.cross(c))
    };
    (0..mesh.triangles.len()).map(six).sum::<f64>() / 6.0
}

/// Whether every edge, told by the places of its ends, has two triangles that run along it in opposite directions.
pub(super) fn is_closed(mesh: &Mesh) -> bool {
    let mut edges: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
    for t in &mesh.triangles {
        let place = t.map(|v| (mesh.positions[v as usize] + Vec3::ZERO).to_array().map(f32::to_bits));
        for k in 0..3 {
            let (a, b) = (place[k], place[(k + 1) % 3]);
            let (ends, way) = if a < b { ([a, b], 1) } else { ([b, a], 1 << 16) };
            *edges.entry(ends).or_default() += way;
        }
    }
    edges.values().all(|n| *n == 1 + (1 << 16))
}

/// Weights of a uniform cubic B-spline and of its derivative at `t` in [0, 1] between the second and third of four points.
fn cubic(t: f64) -> ([f64; 4], [f64; 4]) {
    let s = 1.0 - t;
    (
        [
            s * s * s / 6.0,
            (3.0 * t * t * t - 6.0 * t * t + 4.0) / 6.0,
            (3.0 * s * s * s - 6.0 * s * s + 4.0) / 6.0,
            t * t * t / 6.0,
        ],
        [-s * s / 2.0, (9.0 * t * t - 12.0 * t) / 6.0, (-9.0 * s * s + 12.0 * s) / 6.0, t * t / 2.0],
    )
}

#[test]
fn vertices_of_cube_and_tetrahedron_have_their_limits() {
    for level in 0..5 {
        // Vertices keep their numbers. By hand from the rules of valence 3: ½ and 2/9 by Catmull & Clark, 1/5 by Loop.
        for (mesh, scheme, factor) in [
            (cube(), Scheme::CatmullClark, 0.5),
            (tetrahedron(), Scheme::CatmullClark, 2.0 / 9.0),
            (tetrahedron(), Scheme::Loop, 0.2),
            (cube(), Scheme::Bilinear, 1.0),
        ] {
            let fine = refined(&mesh, scheme, level);
            for (p, control) in fine.positions.iter().zip(&mesh.positions) {
                assert!((*p - *control * factor).length() < 1e-6, "{scheme:?} {level}: {p} {control}");
            }
            let triangles = whole(&fine);
            assert!(is_closed(&triangles) && triangles.triangles.len() == triangles_at(scheme, &mesh.face_sizes, level));
            if scheme == Scheme::Bilinear {
                continue;
            }
            // The surfaces are symmetric: normals at the vertices point away from the middle.
            for (p, n) in triangles.positions.iter().zip(&triangles.normals).take(mesh.positions.len()) {
                assert!(!mesh.positions.iter().any(|c| (*c * factor - *p).length() < 1e-6) || n.dot(p.normalize()) > 0.99999);
            }
        }
    }
    // The middle of a face: (16 · 1 + 4 · 4 · ¾ + 4 · 5/9) / 36.
    let fine = refined(&cube(), Scheme::CatmullClark, 1);
    let top = fine.positions.iter().map(|p| p.z).fold(0.0, f32::max);
    assert!((top - 68.0 / 81.0).abs() < 1e-6, "{top}");
}

#[test]
fn regular_grids_are_bicubic_b_splines() {
    let n = 8;
    let h = |i: usize, j: usize| noise(i + 97 * j);
    let fine = whole(&refined(&grid(n, h), Scheme::CatmullClark, 2));
    let inner = 1.0..(n - 2) as f32;
    let mut seen = 0;
    for (p, normal) in fine.positions.iter().zip(&fine.normals) {
        if !inner.contains(&p.x) || !inner.contains(&p.y) {
            continue;
        }
        let (i, j) = (p.x as usize, p.y as usize);
        let ((wx, dx), (wy, dy)) = (cubic(f64::from(p.x) - i as f64), cubic(f64::from(p.y) - j as f64));
        let sum = |wx: [f64; 4], wy: [f64; 4]| -> f64 {
            (0..16).map(|k| wx[k % 4] * wy[k / 4] * f64::from(h(i + k % 4 - 1, j + k / 4 - 1))).sum()
        };
        assert!((sum(wx, wy) - f64::from(p.z)).abs() < 1e-5, "{p}");
        let expected = DVec3::new(-sum(dx, wy), -sum(wx, dy), 1.0).normalize();
        assert!((expected - normal.as_dvec3()).length() < 1e-4, "{p}: {normal} {expected}");
        seen += 1;
    }
    assert_eq!(seen, 400);
}

#[test]
fn regular_triangles_are_quartic_box_splines() {
    // Of control heights that are quadratic the limit is the same quadratic plus half the sum of its second derivatives times the variances of the
    // box spline: two boxes along each of three directions d have the variance Σ 2 d dᵀ / 12 = ¼ in every direction.
    let n = 9;
    let place = |i: usize, j: usize| Vec2::new(i as f32 + 0.5 * j as f32, 0.75f32.sqrt() * j as f32);
    let mut mesh = grid(n, |_, _| 0.0);
    let quadratic = |p: Vec2| 0.3 * p.x * p.x - 0.2 * p.y * p.y + 0.25 * p.x * p.y + 0.1 * p.x - 0.7;
    for k in 0..n * n {
        let p = place(k % n, k / n);
        mesh.positions[k] = p.extend(quadratic(p));
    }
    // Cut along the diagonal from (1, 0) to (0, 1), whose length is 1.
    let quads = mesh.corners.as_chunks::<4>().0.to_vec();
    mesh.corners = quads.iter().flat_map(|[a, b, c, d]| [*a, *b, *d, *b, *c, *d]).collect();
    mesh.face_sizes = vec![3; mesh.corners.len() / 3];
    let fine = whole(&refined(&mesh, Scheme::Loop, 3));
    let (mut seen, middle) = (0, place(n / 2, n / 2));
    for (p, normal) in fine.positions.iter().zip(&fine.normals) {
        if (p.truncate() - middle).length() > 1.9 {
            continue;
        }
        let expected = quadratic(p.truncate()) + 0.5 * (0.6 - 0.4) * 0.25;
        assert!((p.z - expected).abs() < 2e-5, "{p} {expected}");
        let slopes = Vec2::new(0.6 * p.x + 0.25 * p.y + 0.1, -0.4 * p.y + 0.25 * p.x);
        assert!((*normal - (-slopes).extend(1.0).normalize()).length() < 1e-4, "{p} {normal}");
        seen += 1;
    }
    assert!(seen > 700, "{seen}");
}

#[test]
fn infinitely_sharp_creases_are_cubic_b_splines_and_part_the_normals() {
    let (n, row) = (9, 4);
    let h = |i: usize, j: usize| noise(i + 31 * j);
    for (scheme, triangles) in [(Scheme::CatmullClark, false), (Scheme::Loop, true)] {
        let mut mesh = grid(n, h);
        if triangles {
            let quads = mesh.corners.as_chunks::<4>().0.to_vec();
            mesh.corners = quads.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]).collect();
            mesh.face_sizes = vec![3; mesh.corners.len() / 3];
        }
        mesh.creases = (0..n - 1).map(|i| ([(row * n + i) as u32, (row * n + i + 1) as u32], INFINITELY_SHARP)).collect();
        let fine = whole(&refined(&mesh, scheme, 2));
        let mut on_crease: HashMap<[u32; 3], Vec<Vec3>> = HashMap::new();
        for (p, normal) in fine.positions.iter().zip(&fine.normals).filter(|(p, _)| p.y == row as f32) {
            on_crease.entry(p.to_array().map(f32::to_bits)).or_default().push(*normal);
        }
        assert_eq!(on_crease.len(), (n - 1) * 4 + 1);
        for (bits, normals) in on_crease {
            let p = Vec3::from_array(bits.map(f32::from_bits));
            if !(1.0..(n - 2) as f32).contains(&p.x) {
                continue;
            }
            let i = p.x as usize;
            let (w, _) = cubic(f64::from(p.x) - i as f64);
            let z: f64 = (0..4).map(|k| w[k] * f64::from(h(i + k - 1, row))).sum();
            assert!((z - f64::from(p.z)).abs() < 1e-5, "{scheme:?} {p} {z}");
            assert!(normals.len() == 2 && normals[0].distance(normals[1]) > 1e-3, "{scheme:?} {p} {normals:?}");
        }
    }
}

#[test]
fn creases_are_sharp_for_as_many_levels_as_they_say() {
    let sharp_cube = |sharpness: f32| {
        let edges = CUBE.iter().flat_map(|f| (0..4).map(move |k| ([f[k], f[(k + 1) % 4]], sharpness)));
        ControlMesh { creases: edges.collect(), ..cube() }
    };
    // Sharp for so many levels: the same as a smooth surface of the cube with its faces cut as often.
    for levels in [1, 2] {
        let cut = refined(&cube(), Scheme::Bilinear, levels);
        let cut = ControlMesh {
            face_sizes: vec![4; cut.faces.len()],
            corners: cut.faces.corners,
            positions: cut.positions,
            ..ControlMesh::default()
        };
        let one = refined(&sharp_cube(levels as f32), Scheme::CatmullClark, 4);
        let other = refined(&cut, Scheme::CatmullClark, 4 - levels);
        assert!(one.positions.iter().zip(&other.positions).all(|(a, b)| a.distance(*b) < 1e-6), "{levels}");
    }
    // In between, volumes are in between; infinitely sharp, it is the cube.
    let volumes: Vec<f64> = [0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 9.0, 10.0]
        .iter()
        .map(|s| volume(&whole(&refined(&sharp_cube(*s), Scheme::CatmullClark, 4))))
        .collect();
    assert!(volumes.windows(2).all(|v| v[1] > v[0] + 1e-3 || v[1] > 7.99), "{volumes:?}");
    assert!((volumes[7] - 8.0).abs() < 1e-5);
    // By hand, the vertex of sharpness s in 0..1: (1 − s) of the smooth rule, 5/9, and s of the corner, 1.
    let mut t = Topology::new(Faces::of_size(4, CUBE.concat()), 8);
    let points: Vec<DVec3> = cube().positions.iter().map(|p| p.as_dvec3()).collect();
    let sharp = Sharp { edges: sharp_cube(0.25).creases, vertices: vec![] };
    let sharpness = Sharpness::new(&t, &sharp);
    let next = refine::values(&t, &sharpness, &points, Weights::CatmullClark, Split::Quads);
    assert!((next[7] - DVec3::splat(0.75 * 5.0 / 9.0 + 0.25)).length() < 1e-12, "{}", next[7]);
    // And the middle of an edge: ¾ of (0, ¾, ¾), ¼ of (0, 1, 1).
    let edge = t.find(6, 7).unwrap() as usize;
    assert!((next[8 + edge] - DVec3::new(0.0, 0.8125, 0.8125)).length() < 1e-12);
    // A vertex alone may be sharp.
    let tip = ControlMesh { sharp_vertices: vec![(7, INFINITELY_SHARP)], ..cube() };
    assert_eq!(refined(&tip, Scheme::CatmullClark, 3).positions[7], Vec3::ONE);
    // For one level: (9 · 1 + 4 · 1.5 + 1) / 24.
    let tip = ControlMesh { sharp_vertices: vec![(7, 1.0)], ..cube() };
    assert!(refined(&tip, Scheme::CatmullClark, 3).positions[7].distance(Vec3::splat(2.0 / 3.0)) < 1e-6);
    t = Topology::new(Faces::default(), 0);
    assert_eq!(t.edges.len(), 0);
}

#[test]
fn boundaries_are_curves_corners_stay_or_are_left_out() {
    let of = |boundary| ControlMesh { boundary, ..grid(4, |_, _| 0.0) };
    // Of a plane square nothing is lost.
    let fine = refined(&of(Boundary::EdgeAndCorner), Scheme::CatmullClark, 2);
    let m = whole(&fine);
    let area: f32 = (0..m.triangles.len()).map(|t| m.corners(t)).map(|[a, b, c]| 0.5 * (b - a).cross(c - a).z).sum();
    assert!((area - 9.0).abs() < 1e-4 && !fine.hidden.contains(&true));
    assert!(fine.positions[0].length() < 1e-6 && fine.positions[15].distance(Vec3::new(3.0, 3.0, 0.0)) < 1e-6);
    // Cut into triangles, two of its corners have one face and two have two.
    let fine = refined(&of(Boundary::EdgeAndCorner), Scheme::Loop, 2);
    assert!(fine.positions[3].distance(Vec3::X * 3.0) < 1e-6 && fine.positions[0].length() > 0.1);
    // The corner of a closed B-spline: (1 + 1)/6 towards its neighbours.
    let fine = refined(&of(Boundary::EdgeOnly), Scheme::CatmullClark, 3);
    assert!((fine.positions[0] - Vec3::new(1.0 / 6.0, 1.0 / 6.0, 0.0)).length() < 1e-6, "{}", fine.positions[0]);
    let fine = refined(&of(Boundary::None), Scheme::CatmullClark, 1);
    assert_eq!(fine.hidden.iter().filter(|h| !**h).count(), 1);
    assert_eq!(fine.mesh(|f| !fine.hidden[f as usize], Channels::default()).triangles.len(), 8);
}

#[test]
fn volumes_converge_as_the_square_of_the_edges() {
    for (mesh, scheme) in [(cube(), Scheme::CatmullClark), (tetrahedron(), Scheme::CatmullClark), (tetrahedron(), Scheme::Loop)] {
        let v: Vec<f64> = (2..6).map(|level| volume(&whole(&refined(&mesh, scheme, level)))).collect();
        let ratio = (v[2] - v[1]) / (v[3] - v[2]);
        assert!((3.0..5.0).contains(&ratio) && v[3] > 0.0, "{scheme:?} {v:?}");
    }
}

/// Faces about vertex 0: `n` of them, closed or with a boundary, quadrilaterals or triangles, and faces around those; of any heights.
fn fan(n: usize, closed: bool, triangles: bool, seed: usize) -> ControlMesh {
    let rings = 2;
    let turn = if closed { std::f32::consts::TAU } else { std::f32::consts::PI };
    let mut mesh = ControlMesh { boundary: Boundary::EdgeOnly, ..ControlMesh::default() };
    let height = |i: usize| 0.3 * noise(seed * 131 + i);
    mesh.positions.push(Vec3::ZERO.with_z(height(0)));
    // A ray of a sector is an edge from the middle outwards; within a sector (a, b) are the steps along its two rays.
    let mut known: HashMap<(usize, usize, usize), u32> = HashMap::new();
    let mut at = |ray: usize, a: usize, b: usize, mesh: &mut ControlMesh| {
        let key = match (a, b) {
            (0, 0) => return 0,
            (a, 0) => (ray, a, 0),
            (0, b) => (if closed { (ray + 1) % n } else { ray + 1 }, b, 0),
            other => (ray, other.0, other.1),
        };
        *known.entry(key).or_insert_with(|| {
            let direction = |ray: usize| Vec2::from_angle(turn * ray as f32 / n as f32);
            let p = direction(ray) * a as f32 + direction(ray + 1) * b as f32;
            mesh.positions.push(p.extend(height(mesh.positions.len())));
            mesh.positions.len() as u32 - 1
        })
    };
    for ray in 0..n {
        for a in 0..rings {
            for b in 0..rings {
                let [p, q, r, s] = [(a, b), (a + 1, b), (a + 1, b + 1), (a, b + 1)].map(|(a, b)| at(ray, a, b, &mut mesh));
                if triangles {
                    mesh.corners.extend([p, q, s, q, r, s]);
                    mesh.face_sizes.extend([3, 3]);
                } else {
                    mesh.corners.extend([p, q, r, s]);
                    mesh.face_sizes.push(4);
                }
            }
        }
    }
    mesh
}

#[test]
fn limit_normals_are_those_of_fine_meshes() {
    for (scheme, triangles) in [(Scheme::CatmullClark, false), (Scheme::Loop, true)] {
        for closed in [true, false] {
            let most = if triangles { 6 } else { 4 };
            for n in if closed { 3..8 } else { 2..most } {
                for seed in 0..2 {
                    let mesh = fan(n, closed, triangles, seed);
                    let coarse = refined(&mesh, scheme, 1);
                    // Far finer about the vertex: faces are small and almost plane there.
                    let fine = refined(&mesh, scheme, 6);
                    assert!((coarse.positions[0] - fine.positions[0]).length() < 1e-5, "{scheme:?} {n}");
                    let t = Topology::new(fine.faces.clone(), fine.positions.len());
                    let p = |c: u32| fine.positions[t.vertex(c) as usize].as_dvec3();
                    let mean: DVec3 = t
                        .corners_at(0)
                        .iter()
                        .map(|c| {
                            let (a, b) = (p(t.next(*c)) - p(*c), p(t.previous(*c)) - p(*c));
                            a.cross(b).normalize() * a.angle_between(b)
                        })
                        .sum();
                    let first = coarse.faces.corners.iter().position(|v| *v == 0).unwrap();
                    let normal = coarse.normals.0[coarse.normals.1[first] as usize].as_dvec3();
                    let off = normal.angle_between(mean.normalize());
                    // Beside a boundary the ways along and across it shrink almost alike: the fine mesh converges slowly.
                    assert!(off < if closed { 1e-3 } else { 0.03 }, "{scheme:?}, closed {closed}, {n} faces: {off} rad");
                }
            }
        }
    }
}

#[test]
fn values_are_subdivided_with_their_seams() {
    // Without seams a channel is what the positions are.
    let mut mesh = ControlMesh { boundary: Boundary::EdgeAndCorner, ..grid(5, |i, j| noise(i * 7 + j)) };
    mesh.creases = vec![([6, 7], 2.5), ([7, 12], INFINITELY_SHARP), ([12, 17], 1.0)];
    mesh.sharp_vertices = vec![(18, 1.5)];
    let values = mesh.positions.iter().map(|p| p.extend(1.0)).collect();
    mesh.channels = vec![Channel { values, corners: mesh.corners.clone(), seams: Seams::Corners }];
    for level in 0..4 {
        let fine = refined(&mesh, Scheme::CatmullClark, level);
        let (values, corners) = &fine.channels[0];
        for (c, v) in corners.iter().zip(&fine.faces.corners) {
            assert!((values[*c as usize].truncate() - fine.positions[*v as usize]).length() < 1e-6);
        }
    }
    // A cube of six maps: each keeps its square, and vertices at the edges are as many as there are maps.
    let mut mesh = cube();
    let square = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
    let (corners, values) = indexed(&mesh.corners, |c| (square[c % 4] + Vec2::X * (c / 4) as f32 * 2.0).extend(0.0).extend(0.0));
    for seams in [Seams::Corners, Seams::AllLinear, Seams::Linear, Seams::Smooth] {
        mesh.channels = vec![Channel { values: values.clone(), corners: corners.clone(), seams }];
        let fine = refined(&mesh, Scheme::CatmullClark, 2);
        let m = fine.mesh(|f| f == 3, Channels { uvs: [Some(0), None], colors: None });
        let all = whole(&fine);
        assert_eq!((m.triangles.len(), all.positions.len(), m.uvs[0].len()), (32, 98, m.positions.len()));
        let around = m.uvs[0].iter().fold((Vec2::MAX, Vec2::MIN), |(low, high), uv| (low.min(*uv), high.max(*uv)));
        let whole_square = around.0.distance(Vec2::new(6.0, 0.0)) < 1e-6 && around.1.distance(Vec2::new(7.0, 1.0)) < 1e-6;
        assert_eq!(whole_square, seams != Seams::Smooth, "{seams:?} {around:?}");
        assert!(m.uvs[0].iter().any(|uv| uv.distance(Vec2::new(6.5, 0.5)) < 1e-6));
        let joined = fine.mesh(|_| true, Channels { uvs: [Some(0), None], colors: None });
        assert_eq!(joined.positions.len(), 6 * 25);
        assert!(is_closed(&joined));
    }
    // Uneven values on an even grid: linear between them, or smooth as far as the seams leave it.
    let mut mesh = grid(5, |_, _| 0.0);
    let squares: Vec<Vec4> = mesh.positions.iter().map(|p| Vec4::new(p.x * p.x, p.y, 0.0, 0.0)).collect();
    let at = |seams, place: Vec2, mesh: &mut ControlMesh| {
        mesh.channels = vec![Channel { values: squares.clone(), corners: mesh.corners.clone(), seams }];
        let m = refined(mesh, Scheme::CatmullClark, 2).mesh(|_| true, Channels { uvs: [Some(0), None], colors: None });
        let nearest = (0..m.positions.len()).min_by(|i, j| {
            let far = |i: &usize| m.positions[*i].distance(place.extend(0.0));
            far(i).total_cmp(&far(j))
        });
        m.uvs[0][nearest.unwrap()].x
    };
    // In the middle x² + ⅓ (variance of a cubic B-spline); on the boundary y = 0 the same curve, if that is smooth.
    for (seams, inside, edge) in
        [(Seams::AllLinear, 4.0, 4.0), (Seams::Linear, 4.0 + 1.0 / 3.0, 4.0), (Seams::Corners, 4.0 + 1.0 / 3.0, 4.0 + 1.0 / 3.0)]
    {
        let found = [Vec2::new(2.0, 2.0), Vec2::new(2.0, 0.0)].map(|p| at(seams, p, &mut mesh));
        assert!((found[0] - inside).abs() < 1e-5 && (found[1] - edge).abs() < 1e-5, "{seams:?} {found:?}");
    }
    // Four squares; two of them are one piece of the map, whose edge is a curve but where a third piece meets it.
    let mut mesh = grid(3, |_, _| 0.0);
    let x_of = |c: usize, mesh: &ControlMesh| mesh.positions[mesh.corners[c] as usize].x;
    for (pieces, expected) in [([0.0, 0.0, 1.0, 1.0], 4.0 / 3.0), ([0.0, 0.0, 1.0, 2.0], 1.0)] {
        let value = |c: usize| Vec4::new(x_of(c, &mesh) * x_of(c, &mesh), pieces[c / 4], 0.0, 0.0);
        let (corners, values) = indexed(&mesh.corners, value);
        mesh.channels = vec![Channel { values, corners, seams: Seams::Corners }];
        let fine = refined(&mesh, Scheme::CatmullClark, 2);
        let (values, corners) = &fine.channels[0];
        let c = fine.faces.corners.iter().position(|v| *v == 4).unwrap();
        assert!((values[corners[c] as usize].x - expected).abs() < 1e-6, "{pieces:?}");
    }
}

#[test]
fn meshes_that_make_no_sense_are_errors_or_come_through() {
    let broken = |change: &dyn Fn(&mut ControlMesh)| {
        let mut mesh = cube();
        change(&mut mesh);
        subdivide(&mesh, Scheme::CatmullClark, 1).err()
    };
    assert_eq!(broken(&|m| m.positions[3].y = f32::NAN), Some(SubdivisionError::NotFinite));
    assert_eq!(broken(&|m| m.corners[3] = 8), Some(SubdivisionError::OutOfRange));
    assert_eq!(broken(&|m| m.face_sizes[0] = u32::MAX), Some(SubdivisionError::OutOfRange));
    let channel = |corners: Vec<u32>| Channel { values: vec![Vec4::ZERO; 24], corners, seams: Seams::Corners };
    assert_eq!(broken(&|m| m.channels.push(channel(vec![0; 23]))), Some(SubdivisionError::OutOfRange));
    assert_eq!(broken(&|m| m.creases = vec![([0, 99], 3.0), ([0, 0], f32::NAN), ([0, 7], 1.0)]), None);
    assert_eq!(broken(&|m| m.sharp_vertices = vec![(99, 3.0), (1, f32::NAN)]), None);
    // Points that no face has may be anywhere.
    assert_eq!(broken(&|m| m.positions.push(Vec3::NAN)), None);
    assert_eq!(refined(&ControlMesh::default(), Scheme::Loop, 8).level, 8);
    // Levels: as many as are fine, and never beyond.
    assert_eq!(triangles_at(Scheme::CatmullClark, &[4; 6], 2), 192);
    assert!(triangles_at(Scheme::Loop, &[3; 1000], 31) > MOST_TRIANGLES);
    assert_eq!(subdivide_up_to(&cube(), Scheme::CatmullClark, 0, 47).err(), Some(SubdivisionError::TooLarge));
    for (scheme, most, level, triangles) in
        [(Scheme::CatmullClark, 1000, 3, 768), (Scheme::Loop, 767, 2, 192), (Scheme::Bilinear, 48, 1, 48)]
    {
        let reduced = subdivide_up_to(&cube(), scheme, 9, most).unwrap();
        assert_eq!((reduced.level, whole(&reduced).triangles.len()), (level, triangles), "{scheme:?}");
    }
    // Faces strewn over few vertices: repeated corners, edges with many faces, every direction.
    for seed in 0..60 {
        let number = |i: usize| ((noise(seed * 7919 + i) + 1.0) * 4.0) as u32 % 8;
        let face_sizes: Vec<u32> = (0..12).map(|i| number(1000 + i)).collect();
        let corners: Vec<u32> = (0..face_sizes.iter().sum::<u32>() as usize).map(number).collect();
        let creases = (0..6).map(|i| ([number(2000 + i), number(3000 + i)], noise(i) * 4.0)).collect();
        let mut mesh = ControlMesh { face_sizes, corners, creases, ..cube() };
        let (numbers, values) = indexed(&mesh.corners, |c| Vec4::splat(number(c + 5000) as f32));
        mesh.channels = vec![Channel { values, corners: numbers, seams: Seams::Corners }];
        for scheme in [Scheme::CatmullClark, Scheme::Loop, Scheme::Bilinear] {
            for level in 0..4 {
                let fine = refined(&mesh, scheme, level);
                let m = fine.mesh(|_| true, Channels { uvs: [Some(0), None], colors: Some(0) });
                assert!(m.all_finite() && m.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-4), "{seed} {scheme:?}");
                assert!(m.uvs[0].iter().all(|uv| uv.is_finite()) && !mesh_has_stray(&m));
            }
        }
    }
}

fn mesh_has_stray(mesh: &Mesh) -> bool {
    let n = mesh.positions.len();
    mesh.normals.len() != n || mesh.uvs[0].len() != n || mesh.colors.len() != n
}

#[test]
fn edges_with_three_faces_are_creases() {
    // Three squares at one edge, which stays straight; alone, two of them are smooth there.
    let positions =
        [0.0f32, 1.0].iter().flat_map(|y| [(0.0, 0.0), (1.0, 0.3), (-1.0, 0.3), (0.0, 1.0)].map(|(x, z)| Vec3::new(x, *y, z)));
    let mut mesh = ControlMesh {
        positions: positions.collect(),
        face_sizes: vec![4; 3],
        corners: vec![0, 1, 5, 4, 2, 0, 4, 6, 0, 4, 7, 3],
        ..ControlMesh::default()
    };
    let fin = refined(&mesh, Scheme::CatmullClark, 3);
    assert!(fin.positions.iter().any(|p| p.distance(Vec3::new(0.0, 0.5, 0.0)) < 1e-6));
    assert_eq!(fin.positions[0], Vec3::ZERO);
    mesh.face_sizes.pop();
    mesh.corners.truncate(8);
    let flat = refined(&mesh, Scheme::CatmullClark, 3);
    assert!(flat.positions.iter().all(|p| p.distance(Vec3::new(0.0, 0.5, 0.0)) > 0.03));
}
