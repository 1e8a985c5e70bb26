use super::*;
use crate::bvh::{Bvh, Filter, Hit};
use diopter_light::random::{mix, to_unit};

fn random(seed: u32) -> Vec3 {
    Vec3::from_array(std::array::from_fn(|k| to_unit(mix(seed.wrapping_mul(3).wrapping_add(k as u32)))))
}

fn everything(_: u32, _: f32, _: f32) -> bool {
    true
}

/// The nearest hit on all segments, one by one.
fn closest(curves: &Curves, origin: Vec3, direction: Vec3) -> Option<(u32, CurveHit)> {
    let one = |i: u32| Some((i, curves.intersect(i, 0, (origin, direction), f32::INFINITY, false, &everything)?));
    (0..curves.segments.len() as u32).filter_map(one).min_by(|a, b| a.1.t.total_cmp(&b.1.t))
}

fn one(kind: CurveKind, basis: CurveBasis, points: &[Vec3], radii: [f32; 2]) -> Curves {
    let mut curves = Curves::new(kind, basis);
    curves.push(points, radii, &[Vec3::Z]);
    curves
}

#[test]
fn a_straight_curve_is_as_wide_as_it_says_and_ends_where_it_ends() {
    let points = [0.0, 1.0, 2.0, 3.0].map(|x| Vec3::new(x, 0.0, 5.0));
    let curves = one(CurveKind::Flat, CurveBasis::Bezier, &points, [0.1, 0.4]);
    let hit = |x: f32, y: f32| closest(&curves, Vec3::new(x, y, 0.0), Vec3::Z * 2.0).map(|h| h.1);
    for (x, y, met) in [
        (1.5, 0.0, true),
        (1.5, 0.249, true),
        (1.5, 0.251, false),
        (1.5, -0.249, true),
        (0.02, 0.11, false),
        (2.98, 0.39, true),
        (-0.01, 0.0, false),
        (3.01, 0.0, false),
    ] {
        assert_eq!(hit(x, y).is_some(), met, "{x} {y}");
    }
    // Distance in units of the direction, place along and across: (−z) × x = −y is where v grows.
    let h = hit(1.5, -0.125).unwrap();
    assert!((h.t - 2.5).abs() < 1e-5 && (h.u - 0.5).abs() < 1e-5 && (h.v - 0.75).abs() < 1e-4, "{h:?}");
    let (at, across) = (curves.at(0, h.u), curves.across(0, h.u, Vec3::X, Vec3::Z));
    let met = at.center + across * (at.radius * (2.0 * h.v - 1.0));
    assert!(met.abs_diff_eq(Vec3::new(1.5, -0.125, 5.0), 1e-4), "{met}");
}

#[test]
fn both_bases_and_their_subdivision_meet_what_dense_sampling_finds() {
    for basis in [CurveBasis::Bezier, CurveBasis::BSpline] {
        for seed in 0..40u32 {
            let points: Vec<Vec3> = (0..7).map(|i| random(seed * 50 + i)).collect();
            let curves = one(CurveKind::Flat, basis, &points, [0.02, 0.05]);
            let origin = random(seed + 7777) + Vec3::Z * 4.0;
            let aimed = curves.at(seed % curves.segments.len() as u32, to_unit(mix(seed))).center;
            let direction = (aimed + (random(seed + 9999) - 0.5) * 0.1 - origin).normalize();
            // How far the ray passes by each place of the centre line, over the radius there.
            let mut nearest = f32::INFINITY;
            for segment in 0..curves.segments.len() as u32 {
                for k in 0..=2000 {
                    let at = curves.at(segment, k as f32 / 2000.0);
                    let away = (at.center - origin).cross(direction).length();
                    nearest = nearest.min(away / at.radius);
                }
            }
            let met = closest(&curves, origin, direction).is_some();
            // The straight pieces lie within a tenth of a radius; ends are cut off flat, and at kinks a wedge is left out.
            assert!(met || nearest > 0.88 || ends(&curves, origin, direction) < 1.0, "{basis:?} {seed}: missed at {nearest}");
            assert!(!met || nearest < 1.12, "{basis:?} {seed}: met at {nearest}");
        }
    }
}

/// Least distance by which a ray passes one of the ends of the segments, where the curve may have a kink, over the radius there.
fn ends(curves: &Curves, origin: Vec3, direction: Vec3) -> f32 {
    let one = |segment, u| {
        let at = curves.at(segment, u);
        (at.center - origin).cross(direction).length() / at.radius
    };
    (0..curves.segments.len() as u32).map(|i| one(i, 0.0).min(one(i, 1.0))).fold(f32::INFINITY, f32::min)
}

#[test]
fn widths_change_evenly_in_both_bases() {
    let points: Vec<Vec3> = (0..10).map(random).collect();
    for basis in [CurveBasis::Bezier, CurveBasis::BSpline] {
        let curves = one(CurveKind::Flat, basis, &points, [1.0, 3.0]);
        let n = curves.segments.len();
        assert_eq!(n, if basis == CurveBasis::Bezier { 3 } else { 7 });
        for i in 0..n {
            for u in [0.0, 0.3, 1.0] {
                let expected = 1.0 + 2.0 * (i as f32 + u) / n as f32;
                assert!((curves.at(i as u32, u).radius - expected).abs() < 1e-5);
            }
        }
    }
}

#[test]
fn segments_of_a_spline_continue_each_other() {
    let points: Vec<Vec3> = (0..9).map(|i| random(100 + i)).collect();
    let curves = one(CurveKind::Flat, CurveBasis::BSpline, &points, [0.1, 0.1]);
    for i in 0..curves.segments.len() as u32 - 1 {
        let (a, b) = (curves.at(i, 1.0), curves.at(i + 1, 0.0));
        assert!(a.center.abs_diff_eq(b.center, 1e-6) && a.tangent.abs_diff_eq(b.tangent, 1e-4), "{a:?} {b:?}");
    }
}

#[test]
fn a_ribbon_is_as_wide_as_it_is_turned() {
    // Along x, turned by 60° about it: half as wide as seen from the front.
    let points = [0.0, 1.0, 2.0, 3.0].map(|x| Vec3::new(x, 0.0, 5.0));
    let mut curves = Curves::new(CurveKind::Ribbon, CurveBasis::Bezier);
    let (sin, cos) = 60f32.to_radians().sin_cos();
    curves.push(&points, [0.2, 0.2], &[Vec3::new(0.0, sin, cos); 2]);
    let hit = |y: f32| closest(&curves, Vec3::new(1.2, y, 0.0), Vec3::Z).map(|h| h.1);
    assert!(hit(0.099).is_some() && hit(0.101).is_none() && hit(-0.099).is_some() && hit(-0.101).is_none());
    // One side of it is nearer: tan 60° × 0.05.
    let (near, far) = (hit(0.05).unwrap(), hit(-0.05).unwrap());
    assert!(((near.t - far.t).abs() - 0.1 * 60f32.to_radians().tan()).abs() < 1e-4, "{near:?} {far:?}");
    // Its coordinate across stays with it, whichever side is seen.
    let behind = closest(&curves, Vec3::new(1.2, 0.05, 10.0), Vec3::NEG_Z).unwrap().1;
    assert!((behind.v - near.v).abs() < 1e-4 && (near.v - 0.5).abs() > 0.1);
    // A ray along a slope meets it where the surface is.
    let direction = Vec3::new(1.0, 0.1, 4.0);
    let origin = Vec3::new(0.2, 0.0, 1.0);
    let (segment, met) = closest(&curves, origin, direction).expect("it is there");
    let at = curves.at(segment, met.u);
    let there = at.center + curves.across(segment, met.u, at.tangent, direction) * (at.radius * (2.0 * met.v - 1.0));
    assert!(there.abs_diff_eq(origin + direction * met.t, 1e-4), "{there}");
}

struct All<'a> {
    curves: &'a Curves,
    levels: u32,
    origin: Vec3,
    direction: Vec3,
}

impl Filter for All<'_> {
    fn accept(&self, _: u32, _: f32, _: f32) -> bool {
        true
    }
    fn intersect_other(&self, id: u32, t_max: f32, any: bool) -> Option<Hit> {
        let ray = (self.origin, self.direction);
        let h = self.curves.intersect(id, self.levels, ray, t_max, any, &everything)?;
        Some(Hit { t: h.t, u: h.u, v: h.v, id, slot: 0, instance: 0 })
    }
}

#[test]
fn the_hierarchy_of_pieces_finds_what_all_segments_one_by_one_find() {
    let mut curves = Curves::new(CurveKind::Cylinder, CurveBasis::BSpline);
    for strand in 0..60u32 {
        let root = random(strand) * 2.0;
        let points: Vec<Vec3> = (0..8).map(|i| root + random(strand * 20 + i) * 0.3 + Vec3::Y * 0.2 * i as f32).collect();
        curves.push(&points, [0.02, 0.005], &[]);
    }
    let levels = curves.levels();
    assert_eq!(levels, MOST_LEVELS);
    let bvh = Bvh::build(&CurvePieces { curves: &curves, levels });
    let mut found = 0;
    for i in 0..300 {
        let origin = random(i ^ 0x5555) * 6.0 - 2.0;
        let direction = random(i ^ 0x333) * 2.0 - origin;
        let all = All { curves: &curves, levels, origin, direction };
        let (fast, plain) = (bvh.closest(origin, direction, f32::INFINITY, &all), closest(&curves, origin, direction));
        // Pieces are straightened on their own: what one passes by a hair's edge the other may meet.
        let edge = |h: &CurveHit| (h.v - 0.5).abs() > 0.43;
        match (fast, plain) {
            (Some(f), Some((segment, p))) if (f.t - p.t).abs() < 1e-3 => {
                found += 1;
                assert_eq!(f.id >> levels, segment);
                assert!(bvh.any(origin, direction, f32::INFINITY, &all));
            }
            (Some(f), p) => assert!((f.v - 0.5).abs() > 0.43 || p.is_some_and(|p| edge(&p.1)), "{f:?} {p:?}"),
            (None, Some((_, p))) => assert!(edge(&p), "{p:?}"),
            (None, None) => {}
        }
    }
    assert!(found > 40, "{found}");
}

#[test]
fn rays_that_leave_a_strand_do_not_meet_it_again() {
    let points = [0.0, 1.0, 2.0, 3.0].map(|x| Vec3::new(x * 0.01, 0.002 * x * x, 1.0));
    // As thick as hair, 40 µm.
    let curves = one(CurveKind::Flat, CurveBasis::Bezier, &points, [4e-5, 4e-5]);
    for i in 0..2000u32 {
        let side = (to_unit(mix(i)) - 0.5) * 7.8e-5;
        let (u, direction) = (0.1 + 0.8 * to_unit(mix(i + 9999)), Vec3::Z);
        let at = curves.at(0, u);
        let point = at.center + curves.across(0, u, at.tangent, direction) * side;
        let strand = Strand { center: at.center, radius: at.radius };
        let onward = diopter_light::sampling::sphere([to_unit(mix(i + 1)), to_unit(mix(i + 777_777))]);
        // Light that runs along a bent strand may meet it further on.
        if onward.dot(at.tangent).abs() > 0.9 {
            continue;
        }
        let start = strand.exit(point, at.tangent, onward);
        assert!((start - point).length() < 40.0 * at.radius);
        assert!(closest(&curves, start, onward).is_none(), "{i}: {onward}");
    }
}

#[test]
fn segments_that_cannot_be_met_are_dropped() {
    let line = [0.0, 1.0, 2.0, 3.0].map(|x| Vec3::X * x);
    let mut curves = one(CurveKind::Ribbon, CurveBasis::Bezier, &line, [0.1, 0.1]);
    curves.push(&[Vec3::ONE; 4], [0.1, 0.1], &[Vec3::X]);
    curves.push(&line, [0.0, 0.0], &[Vec3::X]);
    curves.push(&[Vec3::ZERO, Vec3::NAN, Vec3::X, Vec3::Y], [0.1, 0.1], &[Vec3::X]);
    assert_eq!(curves.drop_unusable_segments(), 3);
    assert_eq!((curves.segments.len(), curves.normals.len(), curves.drop_unusable_segments()), (1, 1, 0));
    assert_eq!(curves.normals[0], [Vec3::Z; 2]);
}
