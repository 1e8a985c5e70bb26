//! Depth of field of a thin lens, in closed form.
//!
//! H = f² / (N c) + f; near = s (H − f) / (H + s − 2f); far = s (H − f) / (H − s), from the lens. Source: Ray 2002, "Applied
//! Photographic Optics", ch. 22; numbers of docs/validation.md.

/// Circle of confusion that is taken for sharp, as a fraction of the diagonal: 0.03 mm on 36 × 24 mm.
pub const CIRCLE_OF_DIAGONAL: f64 = 1.0 / 1442.0;

/// Hyperfocal distance, m, of a focal length (mm), f-number and circle of confusion (mm).
pub fn hyperfocal_m(focal_mm: f64, f_number: f64, circle_mm: f64) -> f64 {
    (focal_mm * focal_mm / (f_number * circle_mm) + focal_mm) / 1000.0
}

/// Nearest and farthest distance (m; the far one may be infinite) that look sharp when focused at `subject_m`, by a focal length (mm), f-number and circle of confusion
/// (mm).
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

    // Closed forms, evaluated in Python; see `tests/data/README.md`.
    const DEPTHS: &str = include_str!("../tests/data/dof_table.csv");
    const FIELDS: &str = include_str!("../tests/data/fov_table.csv");

    /// Rows of a table, header left out.
    fn rows(table: &str) -> Vec<Vec<String>> {
        table.lines().skip(1).map(|l| l.split(',').map(str::to_owned).collect()).collect()
    }

    #[test]
    fn tables_are_the_ones_that_were_checked() {
        let sum = |t: &str| t.bytes().fold(0xcbf2_9ce4_8422_2325u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
        assert_eq!((sum(DEPTHS), rows(DEPTHS).len()), (0xe8ae_d386_7e5c_05c8, 1134));
        assert_eq!((sum(FIELDS), rows(FIELDS).len()), (0xfad2_0b62_6361_1fbb, 96));
    }

    #[test]
    fn every_row_of_the_table_of_depths_is_met() {
        for row in rows(DEPTHS) {
            let v: Vec<f64> = row.iter().map(|t| if t == "inf" { f64::INFINITY } else { t.parse().unwrap() }).collect();
            let [c, f, n, s, h, near, far, dof, at_infinity] = v[..] else { panic!("{row:?}") };
            let (a, b) = limits_m(f, n, c, s / 1000.0);
            let close = |got_m: f64, mm: f64| {
                let got = 1000.0 * got_m;
                // Hyperfocal distances are written to 0.01 mm.
                got == mm || (got - mm).abs() < 6e-3 + 1e-6 * mm
            };
            assert!(close(hyperfocal_m(f, n, c), h) && close(a, near) && close(b, far) && close(b - a, dof), "{row:?}: {a} {b}");
            assert!((circle_mm(f, n, s / 1000.0, f64::INFINITY) - at_infinity).abs() < 1e-6, "{row:?}");
        }
    }

    #[test]
    fn every_row_of_the_table_of_fields_is_met() {
        use diopter_sensor::format::{equivalent_35mm, field_of_view};
        for row in rows(FIELDS) {
            let v: Vec<f64> = row[1..].iter().map(|t| t.parse().unwrap()).collect();
            let [w, h, f, horizontal, vertical, diagonal, crop, equivalent] = v[..] else { panic!("{row:?}") };
            for (side, angle) in [(w, horizontal), (h, vertical), (w.hypot(h), diagonal)] {
                assert!((field_of_view(side, f).to_degrees() - angle).abs() < 6e-4, "{row:?}");
            }
            assert!((equivalent_35mm(1.0, w.hypot(h)) - crop).abs() < 6e-4, "{row:?}");
            assert!((equivalent_35mm(f, w.hypot(h)) - equivalent).abs() < 6e-3 * equivalent.max(1.0), "{row:?}");
        }
    }

    #[test]
    fn rays_blur_a_point_as_the_formula_says() {
        use diopter_lens::{Focus, Iris, Lens, ThinLens};
        use diopter_light::units::Millimeters;
        use glam::DVec2;
        for f_number in [1.4, 22.0] {
            let lens = ThinLens::new(Millimeters(50.0), f_number, Iris::Round, Focus::Distance(Millimeters(3000.0))).unwrap();
            let lens = Lens::Thin(lens);
            for k in 0..20 {
                let distance = 0.4 * 1.5f64.powi(k);
                // Through every place of the pupil, the film point whose ray meets the axis there: two rays tell, X is linear in x.
                let mut widest = [0.0f64; 2];
                for i in 0..64 * 64 {
                    let u = [(i % 64) as f32 + 0.5, (i / 64) as f32 + 0.5].map(|v| v / 64.0);
                    let meets = |x: f64| {
                        let r = lens.ray(DVec2::new(x, 0.0), u).unwrap();
                        r.origin_mm.x - r.direction.x / r.direction.z * (1000.0 * distance)
                    };
                    let (a, b) = (meets(0.0), meets(1.0));
                    let x = -a / (b - a);
                    widest = [widest[0].min(x), widest[1].max(x)];
                }
                let (traced, expected) = (widest[1] - widest[0], circle_mm(50.0, f_number, 3.0, distance));
                assert!((traced / expected - 1.0).abs() < 0.02, "f/{f_number} {distance} m: {traced} {expected}");
            }
        }
    }

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
