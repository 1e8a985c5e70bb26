//! ISET's lens files: JSON with `surfaces`, each `radius`, `thickness`, `ior`, `semi_aperture` (mm), perhaps `conic`.
//!
//! Source: ISET/isetlens. `ior` 0 or 1 with radius 0 is the stop; another index with radius 0 is a plane surface.

use super::{Skipped, stem, table_row};
use crate::prescription::{Prescription, PrescriptionError, Surface};
use crate::surface::Profile;
use serde_json::Value;

/// Reads such a file; `file` is its name in errors. Fails on what is not JSON, on missing, unknown or odd keys of a surface, and
/// on what [`Prescription::checked`] refuses.
pub fn read(text: &str, file: &str) -> Result<Prescription, PrescriptionError> {
    let value: Value = serde_json::from_str(text).map_err(|e| PrescriptionError::at(file, e.line(), format!("not JSON: {e}")))?;
    let wrong = |what: &str| PrescriptionError::at(file, 0, what);
    let rows = value.get("surfaces").and_then(Value::as_array).ok_or_else(|| wrong("expected a list \"surfaces\""))?;
    let mut skipped = Skipped::default();
    for key in value.as_object().into_iter().flat_map(|o| o.keys()) {
        if !["surfaces", "name", "description", "type", "metadata", "units"].contains(&key.as_str()) {
            skipped.add(key);
        }
    }
    let mut surfaces: Vec<Surface> = vec![];
    for (i, row) in rows.iter().enumerate() {
        let wrong = |what: String| PrescriptionError::at(file, 0, what).surface(i + 1);
        let number = |key: &str| match row.get(key) {
            Some(v) => v.as_f64().map(Some).ok_or_else(|| wrong(format!("{key} {v}: expected a number"))),
            None => Ok(None),
        };
        let need = |key: &str| number(key)?.ok_or_else(|| wrong(format!("no \"{key}\"")));
        for key in row.as_object().ok_or_else(|| wrong(format!("{row}: expected an object")))?.keys() {
            if !["radius", "thickness", "ior", "semi_aperture", "conic", "label"].contains(&key.as_str()) {
                return Err(wrong(format!("\"{key}\": expected radius, thickness, ior, semi_aperture or conic")));
            }
        }
        let (radius, gap, index) = (need("radius")?, need("thickness")?, need("ior")?);
        let k = number("conic")?.unwrap_or(0.0);
        let (glass, stop) = table_row(surfaces.last(), radius, index).map_err(|e| wrong(e.to_string()))?;
        let profile = match radius {
            0.0 => Profile::Plane,
            r if k == 0.0 => Profile::Sphere(1.0 / r),
            r => Profile::Conic { c: 1.0 / r, k },
        };
        let semi_diameter = number("semi_aperture")?;
        surfaces.push(Surface { stop, semi_diameter, ..Surface::new(profile, gap, glass) });
    }
    // An array whose flat interfaces all count as stops has none of its own.
    if surfaces.iter().filter(|s| s.stop).count() > 1 {
        let first = surfaces.iter().position(|s| s.stop);
        let second = surfaces.iter().rposition(|s| s.stop).unwrap_or(0);
        let what = format!("a second stop: surface {} is one already", first.map_or(0, |f| f + 1));
        return Err(PrescriptionError::at(file, 0, what).surface(second + 1));
    }
    let clean = |s: &str| s.trim().trim_start_matches("Name:").trim().to_owned();
    let name = value.get("name").and_then(Value::as_str).map(clean).filter(|n| !n.is_empty());
    let mut p = Prescription::new(name.unwrap_or_else(|| stem(file)), surfaces);
    p.source = value.get("description").and_then(Value::as_str).unwrap_or("").trim().to_owned();
    p.notes.push("indices are constants: the file gives no dispersion".into());
    skipped.note(&mut p);
    p.checked(file)
}
