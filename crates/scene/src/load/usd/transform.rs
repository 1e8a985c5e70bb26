//! Transforms of prims: lists of operations, of which each may change over time. Source: OpenUSD, `UsdGeomXformable`, `UsdGeomXformOp`.

use super::stage::{Prim, Stage};
use crate::SceneError;
use crate::motion::Parts;
use glam::{DMat4, DQuat, DVec3};
use std::sync::Arc;

/// Largest turn between two keys, degrees: turns are followed on the great circle between them.
const LARGEST_STEP_DEG: f64 = 60.0;
/// Largest part of the way from one key to the next, and largest angle (rad) and part of the scale, by which shift, turn and scale that are interpolated apart may leave where the operations lead.
const MOST_STRAYING: f64 = 1e-3;
/// Times that an interval between two keys is halved for that.
const MOST_HALVINGS: u32 = 6;
/// Most keys between two samples, and of one prim.
const MOST_BETWEEN: usize = 64;
const MOST_KEYS: usize = 1 << 20;

/// One operation of a prim.
struct Operation {
    /// "translate", "rotateXYZ" ...
    kind: String,
    inverted: bool,
    value: Arc<[f64]>,
    samples: Option<Vec<(f64, Arc<[f64]>)>>,
}

/// A prim's place in its parent.
pub struct Xform {
    /// At the scene's first time.
    pub rest: DMat4,
    /// Counts from the world instead of the parent.
    pub resets: bool,
    /// Times (time codes) and places then, of what moves.
    pub keys: Option<Vec<(f64, Parts)>>,
    /// Whether a key has a shear that is left out.
    pub sheared: bool,
    /// Whether it has no place at a key: numbers beyond those of single precision.
    pub vanishes: bool,
}

/// The place of a prim in its parent. Fails where a value is damaged in its file.
pub fn of(stage: &Stage, prim: &Prim) -> Result<Xform, SceneError> {
    let mut xform = Xform { rest: DMat4::IDENTITY, resets: false, keys: None, sheared: false, vanishes: false };
    let order = match stage.value(prim, "xformOpOrder")? {
        Some(super::layer::Value::Texts(order)) => order,
        _ => return Ok(xform),
    };
    let mut operations = Vec::new();
    for name in order.iter().take(1024) {
        if &**name == "!resetXformStack!" {
            xform.resets = true;
            operations.clear();
            continue;
        }
        let (attribute, inverted) = match name.strip_prefix("!invert!") {
            Some(rest) => (rest, true),
            None => (&**name, false),
        };
        let Some(kind) = attribute.split(':').nth(1) else { continue };
        let Some(found) = stage.attribute(prim, attribute)? else { continue };
        let samples = stage.samples(&found)?;
        let Some(value) = stage.at_start(&found)?.and_then(|v| v.doubles()) else { continue };
        operations.push(Operation { kind: kind.to_owned(), inverted, value, samples });
    }
    xform.rest = all_at(&operations, None);
    if !xform.rest.is_finite() {
        xform.rest = DMat4::IDENTITY;
    }
    let times = key_times(&operations);
    if times.len() > 1 {
        let mut keys = Vec::with_capacity(times.len());
        for t in times {
            let place = all_at(&operations, Some(t));
            let (parts, sheared) = parts(place);
            xform.sheared |= sheared;
            xform.vanishes |= !place.as_mat4().is_finite();
            keys.push((t, parts));
        }
        xform.keys = Some(keys);
        xform.rest = all_at(&operations, Some(stage.start));
    }
    Ok(xform)
}

/// All times at which an operation has a sample, and as many between as its turns need.
fn key_times(operations: &[Operation]) -> Vec<f64> {
    let mut times: Vec<f64> =
        operations.iter().filter_map(|o| o.samples.as_ref()).flatten().map(|s| s.0).filter(|t| t.is_finite()).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    times.truncate(MOST_KEYS);
    let mut all = Vec::with_capacity(times.len());
    for pair in times.windows(2) {
        let turn = operations.iter().filter(|o| o.kind.starts_with("rotate") && o.samples.is_some()).map(|o| {
            let (a, b) = (o.at(Some(pair[0])), o.at(Some(pair[1])));
            a.iter().zip(b.iter()).map(|(a, b)| (a - b).abs()).sum::<f64>()
        });
        let steps = (turn.fold(0.0, f64::max) / LARGEST_STEP_DEG).ceil().clamp(1.0, MOST_BETWEEN as f64);
        all.extend((0..steps as usize).map(|i| pair[0] + (pair[1] - pair[0]) * i as f64 / steps));
        if all.len() > MOST_KEYS {
            break;
        }
    }
    all.extend(times.last());
    // Matrices are not interpolated number by number, which would make things smaller on their way.
    let is_of_matrices = operations.iter().any(|o| o.kind == "transform" && o.samples.is_some());
    if is_of_matrices { all } else { refined(operations, &all) }
}

/// Keys between which what is interpolated apart follows the operations: a turn about a pivot, or before a shift, goes around an arc.
fn refined(operations: &[Operation], times: &[f64]) -> Vec<f64> {
    let at = |t: f64| parts(all_at(operations, Some(t))).0;
    let mut all = Vec::with_capacity(times.len());
    for pair in times.windows(2) {
        let [begins, quarter, middle, ends] = [0.0, 0.25, 0.5, 1.0].map(|f| at(pair[0] + (pair[1] - pair[0]) * f).translation);
        let moved = [quarter, middle, ends].iter().map(|p| p.distance(begins)).fold(0.0, f32::max);
        // Intervals to look at, the first on top.
        let mut open = vec![([pair[0], pair[1]], 0)];
        while let Some(([from, to], halved)) = open.pop() {
            if halved < MOST_HALVINGS && all.len() < MOST_KEYS && strays(at, [from, to], moved) {
                let middle = 0.5 * (from + to);
                open.extend([([middle, to], halved + 1), ([from, middle], halved + 1)]);
            } else {
                all.push(from);
            }
        }
    }
    all.extend(times.last());
    all
}

/// Whether places within an interval are elsewhere than what lies between those at its ends; `moved`: the way from key to key.
fn strays(at: impl Fn(f64) -> Parts, [from, to]: [f64; 2], moved: f32) -> bool {
    let [a, b] = [from, to].map(&at);
    let mut off = 0.0f32;
    for fraction in [0.25, 0.5, 0.75] {
        let exact = at(from + (to - from) * fraction);
        let f = fraction as f32;
        off = off.max(exact.translation.distance(a.translation.lerp(b.translation, f)));
        let turned = exact.rotation.angle_between(a.rotation.slerp(b.rotation, f));
        let scaled = (exact.scale - a.scale.lerp(b.scale, f)).abs().max_element();
        if f64::from(turned) > MOST_STRAYING || f64::from(scaled) > MOST_STRAYING * f64::from(exact.scale.abs().max_element()) {
            return true;
        }
    }
    f64::from(off) > MOST_STRAYING * f64::from(moved)
}

/// Scale, turn and shift of a place, and whether that leaves a shear out.
fn parts(place: DMat4) -> (Parts, bool) {
    let whole = place.as_mat4().is_finite() && place.determinant().abs() > 1e-30;
    if !whole {
        let at = place.w_axis.truncate();
        let translation = if at.as_vec3().is_finite() { at.as_vec3() } else { glam::Vec3::ZERO };
        return (Parts { translation, scale: glam::Vec3::ZERO, ..Parts::IDENTITY }, false);
    }
    let (scale, rotation, translation) = place.to_scale_rotation_translation();
    let again = DMat4::from_scale_rotation_translation(scale, rotation, translation);
    let largest = |m: DMat4| m.abs().to_cols_array().into_iter().fold(0.0, f64::max);
    let sheared = largest(again - place) > 1e-4 * largest(place);
    (Parts { scale: scale.as_vec3(), rotation: rotation.as_quat(), translation: translation.as_vec3() }, sheared)
}

/// All operations together: the first one is the outermost.
fn all_at(operations: &[Operation], time: Option<f64>) -> DMat4 {
    operations.iter().fold(DMat4::IDENTITY, |m, o| m * o.matrix(time))
}

impl Operation {
    /// Its numbers at a time: linear between samples, of quaternions on the great circle between them, the shorter way.
    fn at(&self, time: Option<f64>) -> Arc<[f64]> {
        let (Some(samples), Some(time)) = (&self.samples, time) else { return self.value.clone() };
        let next = samples.partition_point(|s| s.0 < time);
        let (Some(b), Some(a)) = (samples.get(next), next.checked_sub(1).and_then(|i| samples.get(i))) else {
            return samples[next.min(samples.len() - 1)].1.clone();
        };
        let t = (time - a.0) / (b.0 - a.0);
        let quaternion = |v: &[f64]| Some(*v.first_chunk::<4>()?).map(|[w, x, y, z]| DQuat::from_xyzw(x, y, z, w)).and_then(unit);
        if self.kind == "orient"
            && let (Some(a), Some(b)) = (quaternion(&a.1), quaternion(&b.1))
        {
            let q = a.slerp(b, t);
            return [q.w, q.x, q.y, q.z].into();
        }
        a.1.iter().zip(b.1.iter()).map(|(a, b)| a + (b - a) * t).collect()
    }

    fn matrix(&self, time: Option<f64>) -> DMat4 {
        let v = self.at(time);
        let m = of_numbers(&self.kind, &v).unwrap_or(DMat4::IDENTITY);
        match self.inverted {
            true if m.determinant().abs() > 1e-300 => m.inverse(),
            _ => m,
        }
    }
}

fn of_numbers(kind: &str, v: &[f64]) -> Option<DMat4> {
    let x = *v.first()?;
    let three = || Some(DVec3::new(x, *v.get(1)?, *v.get(2)?));
    let turn = |axis: char, degrees: f64| match axis {
        'X' => DMat4::from_rotation_x(degrees.to_radians()),
        'Y' => DMat4::from_rotation_y(degrees.to_radians()),
        _ => DMat4::from_rotation_z(degrees.to_radians()),
    };
    Some(match kind {
        "translate" => DMat4::from_translation(three()?),
        "translateX" => DMat4::from_translation(DVec3::X * x),
        "translateY" => DMat4::from_translation(DVec3::Y * x),
        "translateZ" => DMat4::from_translation(DVec3::Z * x),
        "scale" => DMat4::from_scale(three()?),
        "scaleX" => DMat4::from_scale(DVec3::new(x, 1.0, 1.0)),
        "scaleY" => DMat4::from_scale(DVec3::new(1.0, x, 1.0)),
        "scaleZ" => DMat4::from_scale(DVec3::new(1.0, 1.0, x)),
        "rotateX" | "rotateY" | "rotateZ" => turn(kind.chars().last()?, x),
        // The axis that is named first is turned about first.
        "rotateXYZ" | "rotateXZY" | "rotateYXZ" | "rotateYZX" | "rotateZXY" | "rotateZYX" => {
            let angles = three()?;
            let axes = kind.strip_prefix("rotate")?.chars();
            axes.fold(DMat4::IDENTITY, |m, axis| turn(axis, angles[usize::from(axis as u8 - b'X')]) * m)
        }
        "orient" => {
            let [w, x, y, z] = *v.first_chunk::<4>()?;
            DMat4::from_quat(unit(DQuat::from_xyzw(x, y, z, w))?)
        }
        // Vectors are rows in USD: its rows are our columns.
        "transform" => DMat4::from_cols_array(v.first_chunk::<16>()?),
        _ => return None,
    })
}

/// A quaternion of length 1, unless it has none.
fn unit(q: DQuat) -> Option<DQuat> {
    (q.length_squared() > 1e-30 && q.is_finite()).then(|| q.normalize())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn operations_are_those_of_row_vectors() {
        // The matrix of the same turns in OpenUSD's own words: row vectors times Rx Ry Rz.
        let m = of_numbers("rotateXYZ", &[90.0, 90.0, 0.0]).unwrap();
        // y → (X) z → (Y) x.
        assert!((m.transform_vector3(DVec3::Y) - DVec3::X).length() < 1e-12);
        let q = of_numbers("orient", &[0.5f64.sqrt(), 0.0, 0.0, 0.5f64.sqrt()]).unwrap();
        assert!((q.transform_vector3(DVec3::X) - DVec3::Y).length() < 1e-12);
        let mut rows = DMat4::IDENTITY.to_cols_array();
        rows[12..15].copy_from_slice(&[1.0, 2.0, 3.0]);
        assert_eq!(of_numbers("transform", &rows).unwrap().transform_point3(DVec3::ZERO), DVec3::new(1.0, 2.0, 3.0));
        assert!(of_numbers("orient", &[0.0; 4]).is_none() && of_numbers("scale", &[1.0]).is_none());
    }

    #[test]
    fn turns_about_a_pivot_and_before_a_shift_go_around() {
        let op = |kind: &str, samples: &[(f64, &[f64])]| Operation {
            kind: kind.into(),
            inverted: false,
            value: Arc::from(samples[0].1),
            samples: (samples.len() > 1).then(|| samples.iter().map(|(t, v)| (*t, Arc::from(*v))).collect()),
        };
        let quarter = 0.5f64.sqrt();
        let cases: [[Operation; 2]; 3] = [
            [op("rotateY", &[(0.0, &[0.0]), (10.0, &[360.0])]), op("translate", &[(0.0, &[0.0, 0.0, 8.0])])],
            [
                op("orient", &[(0.0, &[1.0, 0.0, 0.0, 0.0]), (10.0, &[0.0, 0.0, 1.0, 0.0])]),
                op("translate", &[(0.0, &[0.0, 0.0, 8.0])]),
            ],
            [
                op("orient", &[(0.0, &[1.0, 0.0, 0.0, 0.0]), (10.0, &[quarter, 0.0, quarter, 0.0])]),
                op("translate", &[(0.0, &[0.0, 0.0, 1.0]), (10.0, &[0.0, 0.0, 9.0])]),
            ],
        ];
        for operations in &cases {
            let times = key_times(operations);
            for pair in times.windows(2) {
                let [a, b] = [pair[0], pair[1]].map(|t| parts(all_at(operations, Some(t))).0.translation);
                for k in 1..8 {
                    let f = f64::from(k) / 8.0;
                    let exact = all_at(operations, Some(pair[0] + (pair[1] - pair[0]) * f)).w_axis.truncate().as_vec3();
                    assert!(exact.distance(a.lerp(b, f as f32)) < 0.017, "{f} of {pair:?}: {exact} {} keys", times.len());
                }
            }
            assert!(times.len() < 100, "{}", times.len());
        }
        // What turns alone needs no more than its arcs, what shifts none.
        assert_eq!(key_times(&[op("translate", &[(0.0, &[0.0; 3]), (10.0, &[1.0, 2.0, 3.0])])]).len(), 2);
        let wild = op("translate", &[(0.0, &[0.0; 3]), (10.0, &[1e39, 0.0, 0.0])]);
        assert!(parts(all_at(&[wild], Some(9.0))).0.translation.is_finite());
    }

    #[test]
    fn large_turns_get_keys_between() {
        let samples = vec![(0.0, Arc::from([0.0])), (10.0, Arc::from([360.0]))];
        let turn = Operation { kind: "rotateZ".into(), inverted: false, value: Arc::from([0.0]), samples: Some(samples) };
        let times = key_times(&[turn]);
        assert_eq!(times.len(), 7);
        let samples = vec![(0.0, Arc::from([0.0])), (1.0, Arc::from([1e300]))];
        let wild = Operation { kind: "rotateZ".into(), inverted: false, value: Arc::from([0.0]), samples: Some(samples) };
        assert!(key_times(&[wild]).len() <= (MOST_BETWEEN << MOST_HALVINGS) + 1);
    }
}
