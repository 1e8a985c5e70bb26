//! Depth of field of a thin lens, in closed form.
//!
//! H = f² / (N c) + f; near = s (H − f) / (H + s − 2f); far = s (H − f) / (H − s), from the lens. Source: Ray 2002, "Applied
//! Photographic Optics", ch. 22; numbers of docs/validation.md.

/// Circle of confusion that is taken for sharp, as a share of the diagonal: 0.03 mm on 36 × 24 mm.
pub const CIRCLE_OF_DIAGONAL: f64 = 1.0 / 1442.0;

/// Hyperfocal distance, m, of a focal length (mm), f-number and circle of confusion (mm).
pub fn hyperfocal_m(focal_mm: f64, f_number: f64, circle_mm: f64) -> f64 {
    (focal_mm * focal_mm / (f_number * circle_mm) + focal_mm) / 1000.0
}

/// Nearest and farthest distance (m; the far one may be infinite) that look sharp when focused at `subject_m`.
pub fn limits_m(focal_mm: f64, f_number: f64, circle_mm: f64, subject_m: f64) -> (f64, f64) {
    let (h, f, s) = (hyperfocal_m(focal_mm, f_number, circle_mm), focal_mm / 1000.0, subject_m);
    if s.is_infinite() {
        return (h - f, f64::INFINITY);
    }
    let near = s * (h - f) / (h + s - 2.0 * f);
    (near, if s >= h { f64::INFINITY } else { s * (h - f) / (h - s) })
}

/// Diameter (mm) of the blur that a point at `distance_m` makes when the lens is focused at `subject_m`:
/// C = A |z_s − z_i| / z_i with the aperture A = f / N, the film at z_s and the point's image at z_i; for real images only.
pub fn circle_mm(focal_mm: f64, f_number: f64, subject_m: f64, distance_m: f64) -> f64 {
    let image = |m: f64| if m.is_infinite() { focal_mm } else { focal_mm * 1000.0 * m / (1000.0 * m - focal_mm) };
    let (film, at) = (image(subject_m), image(distance_m));
    focal_mm / f_number * (film - at).abs() / at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_those_of_the_textbook() {
        // f, N, c, s, H, near, far: closed forms worked out independently.
        let rows = [
            (50.0, 2.0, 0.03, 3.0, 41.7167, 2.8016, 3.2286),
            (50.0, 2.8, 0.03, 3.0, 29.8119, 2.7295, 3.3301),
            (50.0, 8.0, 0.03, 3.0, 10.4667, 2.3379, 4.1853),
            (35.0, 8.0, 0.03, 5.0, 5.1392, 2.5346, 183.38),
            (85.0, 1.8, 0.03, 3.0, 133.8813, 2.9360, 3.0668),
            (24.0, 11.0, 0.03, 2.0, 1.7695, 0.9380, f64::INFINITY),
        ];
        for (f, n, c, s, h, near, far) in rows {
            assert!((hyperfocal_m(f, n, c) - h).abs() < 1e-4);
            let (a, b) = limits_m(f, n, c, s);
            assert!((a - near).abs() < 1e-4 && (b == far || (b / far - 1.0).abs() < 1e-4), "{f} {n}: {a} {b}");
        }
    }
}
