//! Transforms of prims: lists of operations, of which each may change over time. Source: OpenUSD, `UsdGeomXformable`, `UsdGeomXformOp`.

use super::stage::{Prim, Stage};
use crate::SceneError;
use crate::motion::Parts;
use glam::{DMat4, DQuat, DVec3};
use std::sync::Arc;

/// Largest turn between two keys, degrees: turns are followed on the great circle between them.
const LARGEST_STEP_DEG: f64 = 60.0;
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
}

/// The place of a prim in its parent. Fails where a value is damaged in its file.
pub fn of(stage: &Stage, prim: &Prim) -> Result<Xform, SceneError> {
    let mut xform = Xform { rest: DMat4::IDENTITY, resets: false, keys: None, sheared: false };
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
    all
}

/// Scale, turn and shift of a place, and whether that leaves a shear out.
fn parts(place: DMat4) -> (Parts, bool) {
    let whole = place.is_finite() && place.determinant().abs() > 1e-30;
    if !whole {
        let at = place.w_axis.truncate();
        let translation = if at.is_finite() { at.as_vec3() } else { glam::Vec3::ZERO };
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
    /// Its numbers at a time: linear between samples, of quaternions on the shorter way.
    fn at(&self, time: Option<f64>) -> Arc<[f64]> {
        let (Some(samples), Some(time)) = (&self.samples, time) else { return self.value.clone() };
        let next = samples.partition_point(|s| s.0 < time);
        let (Some(b), Some(a)) = (samples.get(next), next.checked_sub(1).and_then(|i| samples.get(i))) else {
            return samples[next.min(samples.len() - 1)].1.clone();
        };
        let t = (time - a.0) / (b.0 - a.0);
        let dot: f64 = a.1.iter().zip(b.1.iter()).map(|(a, b)| a * b).sum();
        let sign = if self.kind == "orient" && dot < 0.0 { -1.0 } else { 1.0 };
        a.1.iter().zip(b.1.iter()).map(|(a, b)| a + (sign * b - a) * t).collect()
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
    fn large_turns_get_keys_between() {
        let samples = vec![(0.0, Arc::from([0.0])), (10.0, Arc::from([360.0]))];
        let turn = Operation { kind: "rotateZ".into(), inverted: false, value: Arc::from([0.0]), samples: Some(samples) };
        let times = key_times(&[turn]);
        assert_eq!(times.len(), 7);
        let samples = vec![(0.0, Arc::from([0.0])), (1.0, Arc::from([1e300]))];
        let wild = Operation { kind: "rotateZ".into(), inverted: false, value: Arc::from([0.0]), samples: Some(samples) };
        assert!(key_times(&[wild]).len() <= MOST_BETWEEN + 1);
    }
}
