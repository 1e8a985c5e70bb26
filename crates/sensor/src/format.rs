//! Image formats by name, and the geometry of angles of view.
//!
//! Sources of the sizes: makers' data sheets as collected by openMVG (MIT) and lensfun; inch formats are nominal.

/// A format: names, width and height in mm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Format {
    /// Names it goes by.
    pub names: &'static [&'static str],
    /// mm.
    pub width_mm: f64,
    /// mm.
    pub height_mm: f64,
}

const fn format(names: &'static [&'static str], width_mm: f64, height_mm: f64) -> Format {
    Format { names, width_mm, height_mm }
}

/// The formats that have names.
pub const FORMATS: &[Format] = &[
    format(&["8x10", "10x8"], 254.0, 203.2),
    format(&["5x7", "7x5"], 177.8, 127.0),
    format(&["4x5", "5x4"], 127.0, 101.6),
    format(&["6x17"], 168.0, 56.0),
    format(&["6x12"], 112.0, 56.0),
    format(&["6x9"], 84.0, 56.0),
    format(&["6x8"], 76.0, 56.0),
    format(&["6x7"], 69.5, 56.0),
    format(&["6x6"], 56.0, 56.0),
    format(&["645", "6x4.5"], 53.4, 40.0),
    format(&["medium format", "44x33"], 43.8, 32.9),
    format(&["full frame", "35mm", "ff", "36x24"], 36.0, 24.0),
    format(&["aps-h"], 27.9, 18.6),
    format(&["super 35"], 24.89, 18.66),
    format(&["aps-c", "aps-c nikon", "aps-c sony"], 23.6, 15.7),
    format(&["aps-c canon"], 22.3, 14.9),
    format(&["4/3", "four thirds", "micro four thirds"], 17.3, 13.0),
    format(&["1\"", "1 inch"], 13.2, 8.8),
    format(&["1/1.28\""], 9.99, 7.49),
    format(&["1/1.63\""], 8.38, 5.59),
    format(&["2/3\""], 8.8, 6.6),
    format(&["1/1.7\""], 7.6, 5.7),
    format(&["1/1.8\""], 7.18, 5.32),
    format(&["1/2.3\""], 6.17, 4.55),
    format(&["1/2.55\""], 5.64, 4.23),
    format(&["1/3.2\""], 4.54, 3.42),
];

impl Format {
    /// A format by name (any case; `"` may be left out).
    pub fn named(name: &str) -> Option<Format> {
        let clean = |s: &str| s.trim().trim_end_matches('"').to_lowercase();
        FORMATS.iter().find(|f| f.names.iter().any(|n| clean(n) == clean(name))).copied()
    }

    /// A format by name ("6x7": of roll film, in cm; "4x5": of sheets, in inches) or as width × height in mm: "36x24".
    pub fn parse(text: &str) -> Option<Format> {
        Format::named(text).or_else(|| {
            let (w, h) = text.trim().trim_end_matches("mm").split_once(['x', 'X', '×'])?;
            let side = |s: &str| s.trim().parse::<f64>().ok().filter(|v| *v > 0.0 && *v <= 1000.0);
            Some(format(&[], side(w)?, side(h)?))
        })
    }

    /// Diagonal, mm.
    pub fn diagonal_mm(&self) -> f64 {
        self.width_mm.hypot(self.height_mm)
    }
}

/// Diagonal of 36 × 24 mm, mm.
pub const FULL_FRAME_DIAGONAL_MM: f64 = 43.266_615_305_567_87;

/// Angle of view (rad) of a length on the film at a film distance (focal length at infinity), both in mm.
pub fn field_of_view(length_mm: f64, film_distance_mm: f64) -> f64 {
    2.0 * (length_mm / (2.0 * film_distance_mm)).atan()
}

/// Focal length (mm) that sees an angle (rad) over a length on the film (mm), at infinity.
pub fn focal_length_for(length_mm: f64, angle: f64) -> f64 {
    length_mm / (2.0 * (angle / 2.0).tan())
}

/// Focal length on 36 × 24 mm with the same diagonal angle of view.
pub fn equivalent_35mm(focal_length_mm: f64, diagonal_mm: f64) -> f64 {
    focal_length_mm * FULL_FRAME_DIAGONAL_MM / diagonal_mm
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_of_a_50_mm_lens_are_the_published_ones() {
        // Closed form; horizontal, vertical, diagonal in degrees, and crop factor.
        for (name, h, v, d, crop) in [
            ("full frame", 39.60, 26.99, 46.79, 1.000),
            ("APS-C", 26.56, 17.85, 31.65, 1.526),
            ("aps-c canon", 25.14, 16.95, 30.03, 1.613),
            ("4/3", 19.63, 14.81, 24.42, 1.999),
            ("1\"", 15.04, 10.06, 18.03, 2.727),
            ("Super 35", 27.95, 21.14, 34.56, 1.391),
            ("medium format", 47.31, 36.42, 57.43, 0.790),
        ] {
            let f = Format::named(name).unwrap();
            let degrees = [f.width_mm, f.height_mm, f.diagonal_mm()].map(|l| field_of_view(l, 50.0).to_degrees());
            for (got, expected) in degrees.iter().zip([h, v, d]) {
                assert!((got - expected).abs() < 0.006, "{name}: {got} {expected}");
            }
            assert!((equivalent_35mm(1.0, f.diagonal_mm()) - crop).abs() < 6e-4);
        }
        assert!((focal_length_for(36.0, field_of_view(36.0, 85.0)) - 85.0).abs() < 1e-9);
        assert_eq!(Format::named("1/2.3"), Format::named("1/2.3\""));
    }
}
