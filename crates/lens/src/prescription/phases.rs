//! Polynomials over the plane in the TOML form: departures of freeform surfaces, and phases of diffractive ones.
//!
//! `departure = { radius = 10, xy = { x2 = 1e-3, x1y1 = 2e-4 }, fringe = [0, 0, 1e-3] }` in mm; `diffractive = { order = 1, blaze_nm = 550, levels = 8,
//! phase = { radius = 5, radial = [-120, 3.5] } }` in radians, or `diffractive = { order = -1, lines_per_mm = 300, rotation_deg = 90 }`. With u = x / radius,
//! v = y / radius: `radial` of u² + v², its square, ...; `xy` of powers of u and v; `noll` and `fringe` of Zernike polynomials from the first. Lines run
//! along x, and order 1 sends light towards +y; `rotation_deg` turns that from +y towards −x.

use super::Surface;
use super::numbers::{list, number};
use crate::diffractive::{Blaze, Diffractive};
use crate::polynomial::{Polynomial, Terms};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SheetPolynomial {
    radius: f64,
    #[serde(default)]
    radial: Vec<f64>,
    #[serde(default)]
    xy: BTreeMap<String, f64>,
    #[serde(default)]
    noll: Vec<f64>,
    #[serde(default)]
    fringe: Vec<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SheetDiffractive {
    #[serde(default = "first_order")]
    order: i32,
    phase: Option<SheetPolynomial>,
    lines_per_mm: Option<f64>,
    #[serde(default)]
    rotation_deg: f64,
    blaze_nm: Option<f64>,
    levels: Option<u32>,
}

fn first_order() -> i32 {
    1
}

/// The phase of a grating of lines along x.
pub(crate) fn grating(lines_per_mm: f64, rotation_deg: f64) -> Result<Polynomial, String> {
    if !(lines_per_mm.is_finite() && rotation_deg.is_finite() && lines_per_mm.abs() < 1e6) {
        return Err(format!("lines_per_mm {lines_per_mm}: expected a number of lines for each millimetre"));
    }
    let (sine, cosine) = rotation_deg.to_radians().sin_cos();
    let whole = TAU * lines_per_mm;
    // Quarter turns leave no rounding behind.
    let part = |v: f64| if v.abs() < 1e-15 { 0.0 } else { v * whole };
    let xy = [((1, 0), part(-sine)), ((0, 1), part(cosine))];
    Polynomial::new(1.0, Terms { xy: xy.into_iter().filter(|t| t.1 != 0.0).collect(), ..Terms::default() })
}

/// "x2y1", "x3", "y".
fn powers(key: &str) -> Option<(usize, usize)> {
    let (x, y) = match key.split_once('y') {
        None => (key.strip_prefix('x')?, None),
        Some(("", y)) => ("0", Some(y)),
        Some((x, y)) => (x.strip_prefix('x')?, Some(y)),
    };
    let power = |t: &str| if t.is_empty() { Some(1) } else { t.parse::<usize>().ok() };
    Some((power(x)?, y.map_or(Some(0), power)?))
}

/// The polynomial; `what` names it in errors.
pub(super) fn polynomial(p: SheetPolynomial, what: &str) -> Result<Polynomial, String> {
    let mut xy = BTreeMap::new();
    for (key, value) in &p.xy {
        let powers = powers(key).ok_or_else(|| format!("{what}: xy: \"{key}\": expected powers such as x2y1, x3 or y4"))?;
        if xy.insert(powers, *value).is_some() {
            return Err(format!("{what}: xy: \"{key}\" is given twice"));
        }
    }
    let terms = Terms { radial: p.radial, xy, noll: p.noll, fringe: p.fringe };
    Polynomial::new(p.radius, terms).map_err(|e| format!("{what}: {e}"))
}

pub(super) fn diffractive(d: SheetDiffractive) -> Result<Diffractive, String> {
    let wrong = |e: String| format!("diffractive: {e}");
    let phase = match (d.phase, d.lines_per_mm) {
        (Some(_), None) if d.rotation_deg != 0.0 => return Err(wrong("rotation_deg without lines_per_mm".into())),
        (Some(p), None) => polynomial(p, "diffractive: phase")?,
        (None, Some(lines)) => grating(lines, d.rotation_deg).map_err(wrong)?,
        _ => return Err(wrong("expected either phase = { radius = .., radial = [..] } or lines_per_mm".into())),
    };
    let blaze = match (d.blaze_nm, d.levels) {
        (None, Some(_)) => return Err(wrong("levels without blaze_nm".into())),
        (nm, levels) => nm.map(|nm| Blaze { nm, levels }),
    };
    Diffractive::new(d.order, phase, blaze).map_err(wrong)
}

fn polynomial_written(p: &Polynomial) -> String {
    let t = p.terms();
    let mut fields = vec![format!("radius = {}", number(p.norm_mm()))];
    if !t.radial.is_empty() {
        fields.push(format!("radial = {}", list(&t.radial)));
    }
    if !t.xy.is_empty() {
        let key = |(j, k): &(usize, usize)| match (j, k) {
            (j, 0) => format!("x{j}"),
            (0, k) => format!("y{k}"),
            (j, k) => format!("x{j}y{k}"),
        };
        let each: Vec<String> = t.xy.iter().map(|(powers, v)| format!("{} = {}", key(powers), number(*v))).collect();
        fields.push(format!("xy = {{ {} }}", each.join(", ")));
    }
    for (name, values) in [("noll", &t.noll), ("fringe", &t.fringe)] {
        if !values.is_empty() {
            fields.push(format!("{name} = {}", list(values)));
        }
    }
    format!("{{ {} }}", fields.join(", "))
}

/// The field that gives a departure back.
pub(super) fn departure_written(p: &Polynomial) -> String {
    format!("departure = {}", polynomial_written(p))
}

/// The field that gives a surface's phase back.
pub(super) fn diffractive_written(s: &Surface) -> Option<String> {
    let d = s.diffractive.as_ref()?;
    let mut fields = vec![format!("order = {}", d.order()), format!("phase = {}", polynomial_written(d.phase()))];
    if let Some(b) = d.blaze() {
        fields.push(format!("blaze_nm = {}", number(b.nm)));
        fields.extend(b.levels.map(|n| format!("levels = {n}")));
    }
    Some(format!("diffractive = {{ {} }}", fields.join(", ")))
}

#[cfg(test)]
mod tests {
    use super::super::read_toml;

    const LENS: &str = "name = \"x\"\nsurfaces = [\n\
        { radius = 50, conic = -1, gap = 4, glass = \"1.5\", semi_diameter = 5, departure = { radius = 6, radial = [0.01], xy = { x2 = 1e-3, x1y2 = -2e-4, y3 = 1e-4 }, noll = [0, 0, 0, 1e-3], fringe = [0, 1e-3] } },\n\
        { fresnel = true, radius = -60, asphere = { 4 = 1e-6 }, gap = 5, semi_diameter = 6 },\n\
        { stop = true, gap = 1, semi_diameter = 4, diffractive = { order = -1, lines_per_mm = 30, rotation_deg = 90 } },\n\
        { gap = 60, semi_diameter = 6, diffractive = { phase = { radius = 5, radial = [-20, 1.5] }, blaze_nm = 550, levels = 8 } },\n]\n";

    #[test]
    fn freeforms_facets_and_phases_come_back_from_toml_and_name_what_is_wrong() {
        let p = read_toml(LENS, "x.toml").unwrap();
        let back = read_toml(&p.to_toml(), "x.toml").unwrap();
        for (a, b) in p.surfaces.iter().zip(&back.surfaces) {
            assert_eq!((&a.profile, &a.diffractive), (&b.profile, &b.diffractive));
        }
        let grating = p.surfaces[2].diffractive.as_ref().unwrap();
        // A quarter turn from +y towards −x, 30 lines a millimetre.
        assert_eq!(grating.phase().at(0.01, 5.0).0, -std::f64::consts::TAU * 0.3);
        let wrong = |from: &str, to: &str| read_toml(&LENS.replace(from, to), "x.toml").unwrap_err().to_string();
        assert!(wrong("x1y2", "xx2").contains("x.toml:3: surface 1: departure: xy: \"xx2\""));
        assert!(wrong("radius = 6, radial", "radius = 0, radial").contains("departure: normalisation radius 0"));
        assert!(wrong("lines_per_mm = 30,", "").contains("expected either phase"));
        assert!(wrong("blaze_nm = 550,", "").contains("levels without blaze_nm"));
        assert!(wrong("levels = 8", "levels = 1").contains("1 levels"));
        assert!(wrong("fresnel = true, ", "fresnel = true, radius_x = 5, ").contains("fresnel"));
    }
}
