//! Curves: `UsdGeomBasisCurves` into Bézier segments.
//!
//! Source: OpenUSD, `UsdGeomBasisCurves` (numbers of segments, of varying and vertex values; pinned ends by a point mirrored at the first one) and its
//! basis matrices, those of Bernstein, of uniform B-splines and of Catmull & Rom 1974. Curves without normals are round, with normals they are
//! ribbons. Widths are diameters.

use super::layer::{Key, Value};
use super::stage::{Prim, Stage};
use crate::SceneError;
use crate::shape::{CurveBasis, CurveKind, Curves};
use glam::{Vec3, Vec4, Vec4Swizzles};
use std::sync::Arc;

/// How control points make segments.
#[derive(Clone, Copy, PartialEq)]
enum Basis {
    Linear,
    Bezier,
    BSpline,
    CatmullRom,
}

/// What happens at the ends.
#[derive(Clone, Copy, PartialEq)]
enum Wrap {
    Open,
    Periodic,
    Pinned,
}

/// To what a number of the curves belongs.
#[derive(Clone, Copy, PartialEq)]
enum Per {
    All,
    Curve,
    /// An end of a segment.
    Varying,
    /// A control point.
    Vertex,
}

/// The curves of a prim, and what was left out of them. Fails where a value of it is damaged in its file; curves that do not fit their points are left out.
pub fn read(stage: &Stage, prim: &Prim) -> Result<(Curves, Vec<&'static str>), SceneError> {
    let floats = |name: &str| -> Result<Arc<[f32]>, SceneError> {
        Ok(stage.value(prim, name)?.and_then(|v| v.floats()).unwrap_or_else(|| Arc::new([])))
    };
    let token = |name: &str, default: &str| -> Result<String, SceneError> {
        Ok(stage.value(prim, name)?.as_ref().and_then(Value::text).map_or_else(|| default.to_owned(), |t| t.to_string()))
    };
    let mut left_out = Vec::new();
    let empty = Curves::new(CurveKind::Cylinder, CurveBasis::Bezier);
    let basis = match (&*token("type", "cubic")?, &*token("basis", "bezier")?) {
        ("linear", _) => Basis::Linear,
        ("cubic", "bezier") => Basis::Bezier,
        ("cubic", "bspline") => Basis::BSpline,
        ("cubic", "catmullRom") => Basis::CatmullRom,
        _ => return Ok((empty, vec!["curves of another basis than Bézier, B-spline or Catmull–Rom"])),
    };
    let wrap = match &*token("wrap", "nonperiodic")? {
        "periodic" => Wrap::Periodic,
        // The ends of other bases are control points anyway.
        "pinned" if matches!(basis, Basis::BSpline | Basis::CatmullRom) => Wrap::Pinned,
        _ => Wrap::Open,
    };
    let points = floats("points")?;
    let counts = stage.value(prim, "curveVertexCounts")?.and_then(|v| v.ints()).unwrap_or_else(|| Arc::new([]));
    let there = points.len() / 3;
    let counts: Vec<usize> = counts.iter().map(|n| usize::try_from(*n).unwrap_or(0)).collect();
    if counts.iter().try_fold(0usize, |sum, n| sum.checked_add(*n)).is_none_or(|sum| sum > there) {
        return Ok((empty, vec!["curves with fewer points than they name"]));
    }
    let ends: Vec<usize> = counts.iter().map(|n| varying(*n, basis, wrap)).collect();
    let sizes = [counts.len(), ends.iter().sum(), counts.iter().sum()];
    let mut per = |name: &str, width: usize| -> Result<(Arc<[f32]>, Option<Per>), SceneError> {
        let values = floats(name)?;
        if values.is_empty() {
            return Ok((values, None));
        }
        let said = stage.property_field(prim, name, Key::Interpolation)?;
        let said = match said.as_ref().and_then(Value::text).map(|t| t.to_string()).as_deref() {
            Some("constant") => Some(Per::All),
            Some("uniform") => Some(Per::Curve),
            Some("varying") => Some(Per::Varying),
            Some("vertex") => Some(Per::Vertex),
            _ => None,
        };
        let count = values.len() / width;
        let fits = |per: &Per| match per {
            Per::All => count >= 1,
            Per::Curve => count == sizes[0],
            Per::Varying => count == sizes[1],
            Per::Vertex => count == sizes[2],
        };
        // Without a word, or with a wrong one, the number of values tells.
        let told = [Per::Vertex, Per::Varying, Per::Curve].into_iter().find(fits).or((count == 1).then_some(Per::All));
        let per = said.filter(fits).or(told);
        if per.is_none() {
            left_out.push("numbers of curves that do not fit their points");
        }
        Ok((values, per))
    };
    let (mut widths, mut width_per) = per("primvars:widths", 1)?;
    if width_per.is_none() {
        (widths, width_per) = per("widths", 1)?;
    }
    let (mut normals, mut normal_per) = per("primvars:normals", 3)?;
    if normal_per.is_none() {
        (normals, normal_per) = per("normals", 3)?;
    }
    let kind = if normal_per.is_some() { CurveKind::Ribbon } else { CurveKind::Cylinder };
    let mut out = Curves::new(kind, CurveBasis::Bezier);
    let (mut point, mut end) = (0, 0);
    for (curve, (count, own_ends)) in counts.iter().zip(&ends).enumerate() {
        let width = |per: Per, i: usize| -> f32 {
            let at = match per {
                Per::All => 0,
                Per::Curve => curve,
                Per::Varying => end + i.min(own_ends.saturating_sub(1)),
                Per::Vertex => point + i,
            };
            0.5 * widths[at]
        };
        let at_vertex = |i: usize| match width_per {
            Some(Per::Varying) => 0.0,
            Some(per) => width(per, i),
            // UsdGeomCurves: 1 where nothing is said.
            None => 0.5,
        };
        let controls: Vec<Vec4> =
            (0..*count).map(|i| Vec3::from_slice(&points[3 * (point + i)..]).extend(at_vertex(i))).collect();
        let mut segments = segments(&controls, basis, wrap);
        if width_per == Some(Per::Varying) {
            let number = segments.len();
            for (s, cubic) in segments.iter_mut().enumerate() {
                let next = if wrap == Wrap::Periodic { (s + 1) % number } else { s + 1 };
                let [a, b] = [s, next].map(|i| width(Per::Varying, i));
                cubic.iter_mut().enumerate().for_each(|(k, p)| p.w = a + (b - a) * k as f32 / 3.0);
            }
        }
        if let Some(per) = normal_per {
            let normal = |at: usize| Vec3::from_slice(&normals[3 * at..]);
            let own: Vec<[Vec3; 2]> = match per {
                Per::All => vec![[normal(0); 2]; segments.len()],
                Per::Curve => vec![[normal(curve); 2]; segments.len()],
                Per::Varying => {
                    let last = own_ends.saturating_sub(1);
                    let number = segments.len();
                    let next = |s: usize| if wrap == Wrap::Periodic { (s + 1) % number } else { s + 1 };
                    (0..number).map(|s| [s, next(s)].map(|i| normal(end + i.min(last)))).collect()
                }
                Per::Vertex => {
                    let controls: Vec<Vec4> = (0..*count).map(|i| normal(point + i).extend(0.0)).collect();
                    self::segments(&controls, basis, wrap).iter().map(|c| [c[0].xyz(), c[3].xyz()]).collect()
                }
            };
            out.normals.extend(own.iter().map(|pair| pair.map(|n| n.normalize_or(Vec3::Z))));
        }
        for mut cubic in segments {
            // What continues the segment before shares its end; a spline of widths may swing below 0.
            cubic.iter_mut().for_each(|p| p.w = p.w.max(0.0));
            let shares = out.points.last() == Some(&cubic[0]) && !out.segments.is_empty();
            out.points.extend(&cubic[usize::from(shares)..]);
            out.segments.push((out.points.len() - 4) as u32);
        }
        point += count;
        end += own_ends;
    }
    out.drop_unusable_segments();
    Ok((out, left_out))
}

/// Segments of a curve of so many control points.
fn segment_count(points: usize, basis: Basis, wrap: Wrap) -> usize {
    match (basis, wrap) {
        (Basis::Linear, Wrap::Periodic) if points > 2 => points,
        (Basis::Linear, _) => points.saturating_sub(1),
        (Basis::Bezier, Wrap::Periodic) => points / 3,
        (Basis::Bezier, _) => points.saturating_sub(1) / 3,
        (_, Wrap::Periodic) if points > 2 => points,
        (_, Wrap::Pinned) => points.saturating_sub(1),
        _ => points.saturating_sub(3),
    }
}

/// Values at ends of segments that a curve has.
fn varying(points: usize, basis: Basis, wrap: Wrap) -> usize {
    match (segment_count(points, basis, wrap), wrap) {
        (0, _) => 0,
        (n, Wrap::Periodic) => n,
        (n, _) => n + 1,
    }
}

/// The Bézier segments of a curve.
fn segments(controls: &[Vec4], basis: Basis, wrap: Wrap) -> Vec<[Vec4; 4]> {
    let n = controls.len();
    let count = segment_count(n, basis, wrap);
    // The point before the first and behind the last, of pinned ends: mirrored at these.
    let at = |i: isize| -> Vec4 {
        match wrap {
            Wrap::Periodic => controls[i.rem_euclid(n as isize) as usize],
            _ if i < 0 => controls[0] * 2.0 - controls[1],
            _ if i as usize >= n => controls[n - 1] * 2.0 - controls[n - 2],
            _ => controls[i as usize],
        }
    };
    let first = if wrap == Wrap::Pinned { -1 } else { 0 };
    let one = |s: usize| {
        let start = match basis {
            Basis::Linear => s as isize,
            Basis::Bezier => 3 * s as isize,
            _ => s as isize + first,
        };
        let [a, b] = [at(start), at(start + 1)];
        if basis == Basis::Linear {
            return [a, a.lerp(b, 1.0 / 3.0), a.lerp(b, 2.0 / 3.0), b];
        }
        let [c, d] = [at(start + 2), at(start + 3)];
        match basis {
            Basis::Linear | Basis::Bezier => [a, b, c, d],
            Basis::BSpline => [(a + b * 4.0 + c) / 6.0, b.lerp(c, 1.0 / 3.0), b.lerp(c, 2.0 / 3.0), (b + c * 4.0 + d) / 6.0],
            Basis::CatmullRom => [b, b + (c - a) / 6.0, c - (d - b) / 6.0, c],
        }
    };
    (0..count).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    fn read(body: &str) -> (crate::Description, Curves) {
        let text = format!("#usda 1.0\n( metersPerUnit = 1\nupAxis = \"Y\" )\ndef BasisCurves \"Hair\" {{ {body} }}");
        let d = crate::load::usd::load(text.into(), "t.usda", &|_| Err("no files here".into())).unwrap_or_else(|e| panic!("{e}"));
        let crate::Shape::Curves { curves, .. } = d.objects[0].shape else { panic!("curves") };
        let set = (*d.curves[curves as usize]).clone();
        (d, set)
    }

    /// Four points with heights 0, 3, −3, 6 over x = 0 to 3.
    const POINTS: &str = "point3f[] points = [(0, 0, 0), (1, 3, 0), (2, -3, 0), (3, 6, 0)]\nint[] curveVertexCounts = [4]\n";

    #[test]
    fn every_basis_runs_where_its_matrix_says() {
        // Closed forms of the middle of the only (or the middle) segment, and of its ends.
        let y = [0.0f32, 3.0, -3.0, 6.0];
        let bezier = |t: f32| {
            (1.0 - t).powi(3) * y[0] + 3.0 * t * (1.0 - t).powi(2) * y[1] + 3.0 * t * t * (1.0 - t) * y[2] + t.powi(3) * y[3]
        };
        let bspline = |t: f32| {
            ((1.0 - t).powi(3) * y[0]
                + (3.0 * t.powi(3) - 6.0 * t * t + 4.0) * y[1]
                + (-3.0 * t.powi(3) + 3.0 * t * t + 3.0 * t + 1.0) * y[2]
                + t.powi(3) * y[3])
                / 6.0
        };
        let catmull_rom = |t: f32| {
            0.5 * ((-t.powi(3) + 2.0 * t * t - t) * y[0]
                + (3.0 * t.powi(3) - 5.0 * t * t + 2.0) * y[1]
                + (-3.0 * t.powi(3) + 4.0 * t * t + t) * y[2]
                + (t.powi(3) - t * t) * y[3])
        };
        type Height<'a> = &'a dyn Fn(f32) -> f32;
        let cases: [(&str, Height); 3] = [("bezier", &bezier), ("bspline", &bspline), ("catmullRom", &catmull_rom)];
        for (basis, height) in cases {
            let (d, set) = read(&format!(
                "{POINTS}uniform token basis = \"{basis}\"\nfloat[] widths = [0.2] ( interpolation = \"constant\" )"
            ));
            assert!(d.warnings.is_empty() && set.kind == CurveKind::Cylinder, "{:?}", d.warnings);
            assert_eq!(set.segments.len(), 1);
            for t in [0.0, 0.3, 0.5, 1.0] {
                let at = set.at(0, t);
                assert!((at.center.y - height(t)).abs() < 1e-5, "{basis} {t}: {} {}", at.center.y, height(t));
                assert!((at.radius - 0.1).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn ends_are_open_closed_or_pinned() {
        for (basis, wrap, count, first, last) in [
            ("bspline", "periodic", 4, Vec2::new(1.0, 1.5), Vec2::new(1.0, 1.5)),
            ("bspline", "pinned", 3, Vec2::ZERO, Vec2::new(3.0, 6.0)),
            ("catmullRom", "pinned", 3, Vec2::ZERO, Vec2::new(3.0, 6.0)),
            ("catmullRom", "periodic", 4, Vec2::new(1.0, 3.0), Vec2::new(1.0, 3.0)),
            ("bezier", "pinned", 1, Vec2::ZERO, Vec2::new(3.0, 6.0)),
        ] {
            let (_, set) = read(&format!("{POINTS}uniform token basis = \"{basis}\"\nuniform token wrap = \"{wrap}\""));
            assert_eq!(set.segments.len(), count, "{basis} {wrap}");
            let [a, b] = [set.at(0, 0.0), set.at(count as u32 - 1, 1.0)].map(|p| p.center.truncate());
            assert!((a - first).length() < 1e-5 && (b - last).length() < 1e-5, "{basis} {wrap}: {a} {b}");
            // Each begins where the one before ends.
            for s in 1..count as u32 {
                assert!((set.at(s, 0.0).center - set.at(s - 1, 1.0).center).length() < 1e-5);
            }
        }
        let (_, line) = read(&format!("{POINTS}uniform token type = \"linear\"\nuniform token wrap = \"periodic\""));
        assert_eq!(line.segments.len(), 4);
        assert!((line.at(1, 0.5).center - Vec3::new(1.5, 0.0, 0.0)).length() < 1e-5);
        assert!((line.at(3, 0.5).center - Vec3::new(1.5, 3.0, 0.0)).length() < 1e-5);
    }

    #[test]
    fn widths_and_normals_belong_to_what_they_say() {
        let two = "point3f[] points = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0)]\nint[] curveVertexCounts = [3, 2]\nuniform token type = \"linear\"\n";
        let radii = |widths: &str| {
            let (d, set) = read(&format!("{two}float[] widths = {widths}"));
            assert!(d.warnings.is_empty(), "{:?}", d.warnings);
            assert_eq!(set.segments.len(), 3);
            [(0, 0.0), (1, 1.0), (2, 0.0), (2, 1.0)].map(|(s, u)| (set.at(s, u).radius * 1e4).round() / 1e4)
        };
        assert_eq!(radii("[0.2, 0.4] ( interpolation = \"uniform\" )"), [0.1, 0.1, 0.2, 0.2]);
        assert_eq!(radii("[0.2, 0.4, 0.6, 0.8, 1] ( interpolation = \"varying\" )"), [0.1, 0.3, 0.4, 0.5]);
        assert_eq!(radii("[0.2, 0.4, 0.6, 0.8, 1] ( interpolation = \"vertex\" )"), [0.1, 0.3, 0.4, 0.5]);
        assert_eq!(radii("[0.2]"), [0.1; 4]);
        // As a primvar they come first.
        assert_eq!(radii("[9]\nfloat[] primvars:widths = [0.2] ( interpolation = \"constant\" )"), [0.1; 4]);
        let (_, ribbon) = read(&format!(
            "{two}float[] widths = [0.1]\nnormal3f[] normals = [(0, 0, 2), (0, 1, 0)] ( interpolation = \"uniform\" )"
        ));
        assert_eq!(ribbon.kind, CurveKind::Ribbon);
        assert_eq!(ribbon.normals, [[Vec3::Z; 2], [Vec3::Z; 2], [Vec3::Y; 2]]);
        // What does not fit is left out and said.
        let (d, set) = read(&format!("{two}float[] widths = [0.1, 0.2, 0.3]"));
        assert!(d.warnings.iter().any(|w| w.contains("do not fit")) && set.at(0, 0.0).radius == 0.5, "{:?}", d.warnings);
        // A whole scene of it can be built.
        crate::Scene::build(d).unwrap();
    }

    #[test]
    fn damaged_curves_never_panic() {
        let text = format!(
            "#usda 1.0\ndef BasisCurves \"Hair\" {{ {POINTS}uniform token basis = \"bspline\"\nuniform token wrap = \"pinned\"\n\
            float[] widths = [0.1, 0.2, 0.3, 0.4] ( interpolation = \"varying\" )\nnormal3f[] normals = [(0, 0, 1)] ( interpolation = \"constant\" ) }}"
        );
        for i in 10..text.len() {
            for change in *b"09-,\" (" {
                let mut bytes = text.clone().into_bytes();
                bytes[i] = change;
                let _ = crate::load::usd::load(bytes, "t.usda", &|_| Err("no files here".into())).map(crate::Scene::build);
            }
        }
    }
}
