//! pbrt's and ISET's lens tables: a row a surface, from the object to the film: radius, gap, index, diameter (all mm).
//!
//! Source: pbrt-v4 file format, "realistic" camera; comments start with #, an ISET file has one line with the focal length. A
//! row of radius 0 is the stop; where its index is that of glass it is a plane surface of that glass. Indices are constants.

use super::{drop_dummies, stem, table_row};
use crate::prescription::{Prescription, PrescriptionError, Surface};
use crate::surface::Profile;

/// Reads such a table; `file` is its name in errors. Fails, naming line and surface, on rows that are not four numbers, and on
/// what [`Prescription::checked`] refuses.
pub fn read(text: &str, file: &str) -> Result<Prescription, PrescriptionError> {
    let mut surfaces: Vec<Surface> = vec![];
    let mut focal_length = None;
    let mut comments: Vec<&str> = vec![];
    for (number, line) in text.lines().enumerate() {
        let number = number + 1;
        let content = match line.split_once('#') {
            Some((before, comment)) => {
                comments.push(comment.trim());
                before
            }
            None => line,
        };
        let words: Vec<&str> = content.split_whitespace().collect();
        if words.is_empty() {
            continue;
        }
        let wrong = |what: String| PrescriptionError::at(file, number, what).surface(surfaces.len() + 1);
        let parse = |w: &&str| {
            w.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| wrong(format!("\"{w}\": expected a number")))
        };
        let row = words.iter().map(parse).collect::<Result<Vec<f64>, _>>()?;
        match row[..] {
            [focal] if surfaces.is_empty() && focal_length.is_none() && focal > 0.0 => focal_length = Some(focal),
            [radius, gap, index, diameter] => {
                let (glass, stop) = table_row(surfaces.last(), radius, index).map_err(|e| wrong(e.to_string()))?;
                let profile = if radius == 0.0 { Profile::Plane } else { Profile::Sphere(1.0 / radius) };
                let semi_diameter = Some(0.5 * diameter).filter(|d| *d != 0.0);
                surfaces.push(Surface { line: number, stop, semi_diameter, ..Surface::new(profile, gap, glass) });
            }
            _ => return Err(wrong(format!("{} numbers: expected radius, gap, index and diameter", row.len()))),
        }
    }
    if surfaces.is_empty() {
        return Err(PrescriptionError::at(file, 0, "no surfaces: expected rows of radius, gap, index and diameter"));
    }
    let mut p = Prescription::new(stem(file), surfaces);
    p.focal_length = focal_length;
    // The header names the patent; the last comment names the columns.
    let header: Vec<&str> =
        comments.into_iter().filter(|c| !c.is_empty() && !c.to_lowercase().starts_with("radius")).take(6).collect();
    p.source = header.join("; ");
    p.notes.push("indices are constants: the file gives no dispersion".into());
    drop_dummies(&mut p, &[]);
    p.checked(file)
}
