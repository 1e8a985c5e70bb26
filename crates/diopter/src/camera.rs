//! A lens, a film and a place in the world.

use crate::camera_motion::CameraMotion;
use diopter_image::{LightFieldFacts, PupilShapes};
use diopter_lens::Lens;
use diopter_lens::microlens::MicrolensArray;
use glam::{Affine3A, DVec2, Mat3A, Vec3, Vec3A};

/// The film: how large, and into how many pixels the picture is cut.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Film {
    /// mm.
    pub width_mm: f64,
    /// mm.
    pub height_mm: f64,
    /// Pixels a row.
    pub columns: usize,
    /// Rows.
    pub rows: usize,
    /// Area that collects the light of a pixel, mm². A picture of fewer pixels than the sensor has keeps the sensor's pixel:
    /// it shows what single pixels of the real sensor, spread over the format, would have counted.
    pub pixel_area_mm2: f64,
    /// Distance between the two images that an optical low-pass filter makes along each axis, mm; 0 without one.
    pub low_pass_mm: f64,
    /// Width between the collecting areas of two pixels, across and down, mm.
    pub gap_mm: [f64; 2],
    /// Where the middle of the film lies, mm from the lens's axis, to the right and up as the picture shows it: 0 but for a piece of a
    /// larger film.
    pub center_mm: [f64; 2],
    /// A microlens array in the film's place: the sensor lies behind it, and what is said here of the film is said of the sensor.
    pub microlenses: Option<MicrolensArray>,
}

impl Film {
    /// A film whose pixels are as large as their fraction of the format. Without low-pass filter, gaps and microlenses; its middle is on the axis.
    pub fn new(width_mm: f64, height_mm: f64, columns: usize, rows: usize) -> Self {
        let pixel_area_mm2 = width_mm * height_mm / (columns * rows) as f64;
        Film {
            width_mm,
            height_mm,
            columns,
            rows,
            pixel_area_mm2,
            low_pass_mm: 0.0,
            gap_mm: [0.0; 2],
            center_mm: [0.0; 2],
            microlenses: None,
        }
    }

    /// A piece of the film, `[left, top, width, height]` as fractions of the picture, cut into its own cells.
    pub fn piece(&self, [left, top, width, height]: [f64; 4], columns: usize, rows: usize) -> Film {
        let (w, h) = (self.width_mm * width, self.height_mm * height);
        let middle = [left + 0.5 * width - 0.5, 0.5 - top - 0.5 * height];
        Film {
            center_mm: [self.center_mm[0] + middle[0] * self.width_mm, self.center_mm[1] + middle[1] * self.height_mm],
            ..Film::new(w, h, columns, rows)
        }
    }

    /// Farthest from the axis that it reaches, along each axis, mm.
    pub fn reach(&self) -> DVec2 {
        let [x, y] = self.center_mm;
        DVec2::new(x.abs() + 0.5 * self.width_mm, y.abs() + 0.5 * self.height_mm)
    }

    /// Whether light that would arrive at a film point (mm), were there no low-pass filter, is collected: not beyond the film, not in the gaps
    /// between pixels.
    #[inline]
    pub(crate) fn collects(&self, at: DVec2) -> bool {
        let at = at + DVec2::from_array(self.center_mm);
        if at.x.abs() > 0.5 * self.width_mm || at.y.abs() > 0.5 * self.height_mm {
            return false;
        }
        // How far from the middle of its pixel, in pixels.
        let open = |at: f64, length: f64, n: usize, gap: f64| {
            let place = (at / length + 0.5) * n as f64;
            gap == 0.0 || (place - place.floor() - 0.5).abs() <= 0.5 * (1.0 - gap * n as f64 / length)
        };
        open(at.x, self.width_mm, self.columns, self.gap_mm[0]) && open(at.y, self.height_mm, self.rows, self.gap_mm[1])
    }

    /// Area of a pixel on which light is collected before it is scaled to [`Film::pixel_area_mm2`], mm²: its cell without the gaps.
    pub(crate) fn collecting_area_mm2(&self) -> f64 {
        let side = |length: f64, n: usize, gap: f64| length / n as f64 - gap;
        side(self.width_mm, self.columns, self.gap_mm[0]) * side(self.height_mm, self.rows, self.gap_mm[1])
    }

    /// Where in a pixel (0 to 1 across and down) light is collected, by two even numbers: between the gaps.
    pub(crate) fn within_pixel(&self, [u, v]: [f32; 2]) -> [f64; 2] {
        let fraction = |gap: f64, length: f64, n: usize| 1.0 - gap * n as f64 / length;
        let place = |u: f32, fraction: f64| 0.5 + (f64::from(u) - 0.5) * fraction;
        [
            place(u, fraction(self.gap_mm[0], self.width_mm, self.columns)),
            place(v, fraction(self.gap_mm[1], self.height_mm, self.rows)),
        ]
    }

    /// How far (mm) the low-pass filter moved the light that arrives, by two even numbers: one of four spots.
    pub(crate) fn low_pass_shift(&self, [u, v]: [f32; 2]) -> DVec2 {
        let side = |u: f32| if u < 0.5 { -0.5 } else { 0.5 };
        DVec2::new(side(u), side(v)) * self.low_pass_mm
    }
}

/// A camera ready to be exposed.
#[derive(Clone, Debug)]
pub struct Camera {
    /// Collects the light.
    pub lens: Lens,
    /// Records it.
    pub film: Film,
    /// Where it is during the exposure; it looks along −Z with +Y up.
    pub motion: CameraMotion,
}

impl Camera {
    /// What must be known to decode what it takes, with a microlens array.
    pub fn light_field_facts(&self) -> Option<LightFieldFacts> {
        let (film, array) = (&self.film, self.film.microlenses?);
        // f² / extension − distance is the same for all distances.
        let object_offset_mm = match &self.lens {
            Lens::Compound(lens) => lens.focal_length().0.powi(2) / lens.extension_at(1e6) - 1e6,
            other => -other.focal_length().0,
        };
        Some(LightFieldFacts {
            arrangement: array.lattice.arrangement.name().into(),
            pitch_mm: array.lattice.pitch,
            origin_mm: array.lattice.origin.to_array(),
            focal_length_mm: array.focal_length,
            gap_mm: array.gap,
            pixel_mm: [film.width_mm / film.columns as f64, film.height_mm / film.rows as f64],
            exit_curvature_per_mm: self.lens.exit_curvature(),
            pupil_slope: self.lens.pupil_slope(),
            object_offset_mm,
            pupils: Some(self.pupil_shapes()),
        })
    }

    /// Shapes of the pupil over the film, as a picture shows them.
    fn pupil_shapes(&self) -> PupilShapes {
        /// Places across and down, and directions: cat's eyes are then known within about a hundredth of the pupil's radius.
        const COUNTS: [usize; 2] = [11, 9];
        const DIRECTIONS: usize = 24;
        // On the film the picture is upside down: its right is −x, down is +y.
        let on_film = |v: DVec2| DVec2::new(-v.x, v.y);
        let turn = std::f64::consts::TAU / DIRECTIONS as f64;
        let directions: Vec<DVec2> = (0..DIRECTIONS).map(|k| on_film(DVec2::from_angle(turn * k as f64))).collect();
        let size = DVec2::new(self.film.width_mm, self.film.height_mm);
        let shape = |at: DVec2| {
            let reaches = self.lens.pupil_extents(on_film(at), &directions).unwrap_or_default();
            reaches.into_iter().map(|r| (1e4 * r).round() / 1e4).collect()
        };
        let [columns, rows] = COUNTS.map(|n| (0..n).map(move |i| i as f64 / (n - 1) as f64 - 0.5));
        let extents = rows.flat_map(|y| columns.clone().map(move |x| DVec2::new(x, y))).map(|at| shape(at * size)).collect();
        PupilShapes { counts: COUNTS, extents }
    }
}

/// Why a camera cannot be placed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlacementError {
    /// Eye and target coincide.
    #[error("look-from and look-at are the same point {0}: move one of them")]
    NoDirection(Vec3),
    /// Up does not say how to turn.
    #[error("up {up} points along the direction of view {view}: choose an up across it, such as {hint}")]
    DegenerateUp {
        /// The up given.
        up: Vec3,
        /// Unit direction of view.
        view: Vec3,
        /// One that works.
        hint: Vec3,
    },
    /// Not a number.
    #[error("look-from, look-at and up must be finite numbers; found {0}")]
    NotFinite(Vec3),
    /// Too far away for single precision.
    #[error("look-from or look-at is {0:e} m away: expected up to {MOST_DISTANT_M:e} m")]
    TooFar(f32),
}

/// Farthest coordinate of a camera or of what it is aimed at, m: squares of longer distances are beyond single precision.
const MOST_DISTANT_M: f32 = 1e18;

/// Unit direction from a thing to a camera that takes it in a three-quarter view: 30° to the right of its front (+Z), 17.5° from above.
pub fn three_quarter_direction() -> Vec3 {
    let (azimuth, elevation) = (30f32.to_radians(), 17.5f32.to_radians());
    Vec3::new(azimuth.sin() * elevation.cos(), elevation.sin(), azimuth.cos() * elevation.cos())
}

/// From the middle of a ball (`radius`, m) to where a camera sees all of it, in a three-quarter view from a little above, by the half of its smaller angle of
/// view, rad. A vector in m.
pub fn three_quarter_view(radius: f32, half_angle: f32) -> Vec3 {
    three_quarter_direction() * (radius / half_angle.sin() * 1.05)
}

/// Places a camera at `from`, looking at `at` (both m, in the world), with `up` upwards in the picture: world from camera, axes x right, y up, z backward.
/// Fails on coordinates that are not finite or beyond 1e18 m, where `at` is `from`, and where `up` is 0 or along the view.
pub fn look_at(from: Vec3, at: Vec3, up: Vec3) -> Result<Affine3A, PlacementError> {
    if let Some(bad) = [from, at, up].into_iter().find(|v| !v.is_finite()) {
        return Err(PlacementError::NotFinite(bad));
    }
    if let Some(far) = [from, at].map(|v| v.abs().max_element()).into_iter().find(|far| *far > MOST_DISTANT_M) {
        return Err(PlacementError::TooFar(far));
    }
    let view = (at - from).try_normalize().ok_or(PlacementError::NoDirection(from))?;
    let degenerate = || {
        let hint = if view.y.abs() < 0.9 { Vec3::Y } else { Vec3::Z };
        PlacementError::DegenerateUp { up, view, hint }
    };
    let right = view.cross(up.try_normalize().ok_or_else(degenerate)?);
    if right.length() < 1e-4 {
        return Err(degenerate());
    }
    let right = right.normalize();
    let true_up = right.cross(view);
    let axes = Mat3A::from_cols(right.into(), true_up.into(), (-view).into());
    Ok(Affine3A { matrix3: axes, translation: Vec3A::from(from) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_along_minus_z_with_x_to_the_right() {
        let m = look_at(Vec3::new(0.0, 0.0, 5.0), Vec3::ZERO, Vec3::Y).unwrap();
        assert!((m.matrix3 - Mat3A::IDENTITY).abs_diff_eq(Mat3A::ZERO, 1e-6));
        let m = look_at(Vec3::ZERO, Vec3::X, Vec3::Y).unwrap();
        assert!((m.transform_vector3(Vec3::NEG_Z) - Vec3::X).length() < 1e-6);
        assert!((m.transform_vector3(Vec3::X) - Vec3::Z).length() < 1e-6);
        // What is too far away is not said to be one point.
        let far = look_at(Vec3::new(0.0, 1e30, 0.0), Vec3::ZERO, Vec3::X).unwrap_err();
        assert!(far.to_string().contains("1e30 m away"), "{far}");
        assert_eq!(look_at(Vec3::X, Vec3::X, Vec3::Y), Err(PlacementError::NoDirection(Vec3::X)));
    }

    #[test]
    fn pixels_blur_as_their_sensor_says() {
        // The mean of cos(2π f x) over where light comes from is the contrast at f (cycles a pixel).
        let mut sensor = diopter_sensor::Sensor::named("canon-5d-mark-iv").unwrap();
        (sensor.low_pass_px, sensor.fill_factor) = (0.7, 0.6);
        let film = Film { low_pass_mm: 0.7e-2, gap_mm: [1e-2 * (1.0 - 0.6f64.sqrt()); 2], ..Film::new(1.0, 1.0, 100, 100) };
        for f in [0.1, 0.25, 0.5, 0.8] {
            let n = 2000;
            let contrast: f64 = (0..n)
                .map(|i| {
                    let u = (i as f32 + 0.5) / n as f32;
                    let x = film.within_pixel([u, u])[0] - 0.5 + film.low_pass_shift([(u * 1237.0).fract(), 0.0]).x * 100.0;
                    (2.0 * std::f64::consts::PI * f * x).cos() / n as f64
                })
                .sum();
            assert!((contrast.abs() - sensor.mtf(f)).abs() < 5e-3, "{f}: {contrast} {}", sensor.mtf(f));
        }
    }

    #[test]
    fn degenerate_up_is_an_error_with_a_hint() {
        let e = look_at(Vec3::ZERO, Vec3::Y, Vec3::Y).unwrap_err();
        assert!(e.to_string().contains("such as [0, 0, 1]"), "{e}");
        assert!(look_at(Vec3::ONE, Vec3::ONE, Vec3::Y).is_err());
        assert!(look_at(Vec3::ZERO, Vec3::X, Vec3::ZERO).is_err());
        assert!(look_at(Vec3::ZERO, Vec3::X * f32::NAN, Vec3::Y).is_err());
    }
}
