//! A lens profile for lensfun's database (XML): distortion and vignetting.
//!
//! `ptlens`: r_d = a r⁴ + b r³ + c r² + (1 − a − b − c) r, radii over half the shorter side. `pa`: light 1 + k1 r² + k2 r⁴ + k3 r⁶ of that in the middle, radii over half the diagonal. Source: lensfun
//! manual, "Lens calibration tutorial" and "XML format"; Panorama Tools.

use super::fit::Fit;
use super::{Calibration, CalibrationError, number, wrong};
use glam::DVec2;

/// Lensfun's crop factor counts from 36 × 24 mm.
const FULL_FRAME_DIAGONAL_MM: f64 = 43.266_615_305_567_875;
/// Distance that lensfun writes for infinity, m.
const FAR_M: f64 = 1000.0;

/// The text of the file. Fails without a size of the film, on a picture that sees 85° or more from the axis, and on a fall-off that is not finite.
pub fn write(c: &Calibration) -> Result<String, CalibrationError> {
    let [w, h] = c.film_mm;
    let diagonal = w.hypot(h);
    if !(diagonal > 0.0) {
        return Err(wrong("lensfun", "a camera without a size of film", "a lens before a body"));
    }
    let [a, b, third] = distortion(c)?;
    let focal = number(c.focal_length_mm);
    let mut text = format!(
        "<!DOCTYPE lensdatabase SYSTEM \"lensfun-database.dtd\">\n<lensdatabase version=\"2\">\n    <lens>\n        <maker>diopter</maker>\n        \
         <model>{}</model>\n        <mount>Generic</mount>\n        <cropfactor>{}</cropfactor>\n        <aspect-ratio>{}</aspect-ratio>\n        <calibration>\n            \
         <distortion model=\"ptlens\" focal=\"{focal}\" a=\"{}\" b=\"{}\" c=\"{}\"/>\n",
        escaped(&c.lens),
        number(FULL_FRAME_DIAGONAL_MM / diagonal),
        number(w.max(h) / w.min(h)),
        number(a),
        number(b),
        number(third),
    );
    if c.falloff.len() > 3 {
        let [k1, k2, k3] =
            vignetting(&c.falloff).ok_or_else(|| wrong("lensfun", "no light over the picture", "a lens that lights its film"))?;
        text.push_str(&format!(
            "            <vignetting model=\"pa\" focal=\"{focal}\" aperture=\"{}\" distance=\"{}\" k1=\"{}\" k2=\"{}\" k3=\"{}\"/>\n",
            number(c.f_number),
            number(c.focus_distance_m.unwrap_or(FAR_M)),
            number(k1),
            number(k2),
            number(k3),
        ));
    }
    text.push_str("        </calibration>\n    </lens>\n</lensdatabase>\n");
    Ok(text)
}

/// a, b, c of the model that is known: heights of angles by the model, over those of a picture without distortion.
fn distortion(c: &Calibration) -> Result<[f64; 3], CalibrationError> {
    let half_side = 0.5 * c.size[0].min(c.size[1]) as f64;
    let corner = 0.5 * DVec2::new(c.size[0] as f64, c.size[1] as f64).length();
    let focal = c.model.focal().x;
    let beyond = |largest: f64| {
        let seen = seen(c.fit.as_ref()).max(largest.to_degrees());
        match seen < 85.0 {
            true => {
                let found = format!("the model {}, which ends before the corner of the picture", c.model.kind().name());
                wrong("lensfun", found, "a model that reaches it: choose it by --model of `diopter lens calibrate`")
            }
            false => wrong(
                "lensfun",
                format!("a picture that sees {seen:.0}° from its axis"),
                "less than 85°: fisheyes have no ptlens model",
            ),
        }
    };
    const COUNT: usize = 100;
    let mut rows = Vec::with_capacity(COUNT);
    for i in 1..=COUNT {
        let radius = corner * i as f64 / COUNT as f64;
        // Along the diagonal of the pixels' axes both focal lengths count alike.
        let at = c.model.centre() + DVec2::X * radius;
        let direction = c.model.unproject(at).filter(|d| d.z > 0.087).ok_or_else(|| beyond(c.model.largest_angle()))?;
        let straight = focal * direction.truncate().length() / direction.z / half_side;
        rows.push((straight, radius / half_side));
    }
    // r_d = d ρ + c ρ² + b ρ³ + a ρ⁴ with ρ = f tan θ over half the side.
    let p = polynomial(&rows, [1, 2, 3, 4]).ok_or_else(|| beyond(c.model.largest_angle()))?;
    let at = |s: f64| s * (p[0] + s * (p[1] + s * (p[2] + s * p[3])));
    // The unit in which radius 1 stays: d s + c s² + b s³ + a s⁴ = 1, which keeps the height of the picture.
    let (mut low, mut high) = (0.0, 8.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if at(middle) < 1.0 { low = middle } else { high = middle }
    }
    let s = 0.5 * (low + high);
    Ok([p[3] * s.powi(4), p[2] * s.powi(3), p[1] * s * s])
}

fn seen(fit: Option<&Fit>) -> f64 {
    fit.map_or(90.0, |f| f.seen_angle.to_degrees())
}

/// k1, k2, k3.
fn vignetting(falloff: &[f64]) -> Option<[f64; 3]> {
    let last = (falloff.len() - 1) as f64;
    let rows: Vec<(f64, f64)> = falloff.iter().enumerate().skip(1).map(|(i, v)| (i as f64 / last, v - 1.0)).collect();
    polynomial(&rows, [2, 4, 6])
}

/// Coefficients of powers of x that come nearest to y, by least squares with Gram and Schmidt's orthogonal columns.
fn polynomial<const N: usize>(rows: &[(f64, f64)], powers: [i32; N]) -> Option<[f64; N]> {
    let mut basis: Vec<(Vec<f64>, [f64; N])> = Vec::with_capacity(N);
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let y: Vec<f64> = rows.iter().map(|r| r.1).collect();
    let mut solution = [0.0; N];
    for (k, power) in powers.iter().enumerate() {
        let mut column: Vec<f64> = rows.iter().map(|r| r.0.powi(*power)).collect();
        let mut own = [0.0; N];
        own[k] = 1.0;
        // Twice, for digits.
        for _ in 0..2 {
            for (other, mix) in &basis {
                let by = dot(&column, other);
                column.iter_mut().zip(other).for_each(|(c, o)| *c -= by * o);
                own.iter_mut().zip(mix).for_each(|(c, o)| *c -= by * o);
            }
        }
        let length = dot(&column, &column).sqrt();
        if !(length > 1e-12 && length.is_finite()) {
            return None;
        }
        column.iter_mut().for_each(|c| *c /= length);
        own.iter_mut().for_each(|c| *c /= length);
        let by = dot(&column, &y);
        solution.iter_mut().zip(own).for_each(|(s, o)| *s += by * o);
        basis.push((column, own));
    }
    solution.iter().all(|v| v.is_finite()).then_some(solution)
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::super::tests::sample;
    use super::*;
    use crate::calibration::{CameraModel, ModelKind};

    #[test]
    fn ptlens_says_the_model_where_it_is_one() {
        // Third order of a radial model of small distortion: r_d ≈ ρ + k1 ρ³ s² with s half the side over f.
        let mut c = sample(ModelKind::SimpleRadial);
        c.model = CameraModel::new(ModelKind::SimpleRadial, DVec2::splat(800.0), DVec2::new(479.5, 319.5), vec![-0.02]).unwrap();
        let [a, b, third] = distortion(&c).unwrap();
        let ptlens = |r: f64| r * (1.0 - a - b - third + r * (third + r * (b + r * a)));
        // Straight lines: undistorted radii must be in proportion to tangents.
        let tangent = |r_d: f64| {
            let d = c.model.unproject(DVec2::new(479.5 + 320.0 * r_d, 319.5)).unwrap();
            d.x / d.z
        };
        let undistorted = |r_d: f64| {
            let (mut low, mut high) = (0.0, 3.0);
            for _ in 0..60 {
                let middle = 0.5 * (low + high);
                if ptlens(middle) < r_d { low = middle } else { high = middle }
            }
            low
        };
        let scale = undistorted(0.5) / tangent(0.5);
        for r in [0.2, 0.9, 1.3, 1.7] {
            // The fit of four powers to three: 1e-5 of the half side is 0.003 px here.
            assert!((undistorted(r) - scale * tangent(r)).abs() < 2e-5, "{r}");
        }
        assert!((ptlens(1.0) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn vignetting_is_the_polynomial_of_the_table() {
        let table: Vec<f64> =
            (0..33).map(|i| f64::from(i) / 32.0).map(|r| 1.0 - 0.4 * r * r + 0.1 * r.powi(4) - 0.05 * r.powi(6)).collect();
        let k = vignetting(&table).unwrap();
        assert!((k[0] + 0.4).abs() < 1e-10 && (k[1] - 0.1).abs() < 1e-10 && (k[2] + 0.05).abs() < 1e-10, "{k:?}");
        let text = write(&Calibration { falloff: table, ..sample(ModelKind::OpenCv4) }).unwrap();
        assert!(
            text.contains("lens &quot;A&quot;") && text.contains("model=\"pa\"") && text.contains("cropfactor>1.0"),
            "{text}"
        );
    }
}
