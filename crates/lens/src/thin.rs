//! The ideal lenses: pinhole and thin lens.
//!
//! Source: Gauss's 1/f = 1/s + 1/s'; irradiance E = π L / (4 N²) on the axis (Abbe's sine condition), times cos⁴ of the chief ray beside it.

use crate::{Blocked, BlockedBy, Focus, Iris, LensError, LensRay, require};
use diopter_light::units::Millimeters;
use glam::{DQuat, DVec2, DVec3, Vec2};
use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

/// A hole at the origin. It has no size for rays; for light it has the area of its f-number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    /// Distance of the film, mm: what would be the focal length.
    pub film_distance: Millimeters,
    /// Film distance over diameter of the hole that would let in as much light.
    pub f_number: f64,
    /// Which way a film point looks.
    pub projection: Projection,
}

/// How a camera without a lens maps the world onto the film.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Projection {
    /// Straight lines stay straight: a hole.
    #[default]
    Rectilinear,
    /// Along parallel lines: what is far is as large as what is near.
    Orthographic {
        /// Size of things over the size of their pictures.
        reduction: f64,
    },
    /// All around: longitude across, latitude up, straight ahead in the middle (equirectangular).
    Panorama {
        /// Size of the film, mm.
        film_mm: [f64; 2],
    },
}

impl Pinhole {
    /// Fails unless the film lies 1 µm to 10 km behind the hole and the f-number is positive.
    pub fn new(film_distance: Millimeters, f_number: f64) -> Result<Self, LensError> {
        check(film_distance, f_number)?;
        Ok(Pinhole { film_distance, f_number, projection: Projection::Rectilinear })
    }

    pub(crate) fn ray(&self, film_mm: DVec2) -> LensRay {
        let d = self.film_distance.0;
        let area = PI * (0.5 * d / self.f_number).powi(2);
        let even = |origin_mm: DVec3, direction: DVec3| LensRay { origin_mm, direction, weight_sr: area / (d * d) };
        match self.projection {
            Projection::Rectilinear => {}
            // The picture on the film is upside down.
            Projection::Orthographic { reduction } => return even((-film_mm * reduction).extend(0.0), DVec3::NEG_Z),
            Projection::Panorama { film_mm: [width, height] } => {
                let (longitude, latitude) = (-film_mm.x / width * TAU, -film_mm.y / height * PI);
                let (sin, cos) = longitude.sin_cos();
                return even(DVec3::ZERO, DVec3::new(latitude.cos() * sin, latitude.sin(), -latitude.cos() * cos));
            }
        }
        let to_film = film_mm.extend(d);
        LensRay {
            origin_mm: DVec3::ZERO,
            direction: -to_film.normalize(),
            weight_sr: area * d * d / to_film.length_squared().powi(2),
        }
    }
}

/// A thin lens with its pupil in its own plane.
#[derive(Clone, Debug, PartialEq)]
pub struct ThinLens {
    /// Focal length, mm.
    pub focal_length: Millimeters,
    /// Focal length over pupil diameter.
    pub f_number: f64,
    /// Shape of the pupil.
    pub iris: Iris,
    /// Sharp plane.
    pub focus: Focus,
    /// How the lens is turned against the film about its middle, rad: forward (its axis downward in the scene), and to the right.
    pub tilt: [f64; 2],
}

/// A ray from the scene that a thin lens brings onto its film.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThinEntry {
    /// Film point, mm.
    pub film: DVec2,
    /// Where it passes the lens, mm.
    pub origin_mm: DVec3,
    /// Weight of a camera sample along it, sr, as [`LensRay::weight_sr`].
    pub weight_sr: f64,
    /// Density with which a camera sample draws it, of one a mm² of film, 1 / (mm² sr) of étendue dA cosθ dω on the side of the scene.
    pub density: f64,
}

/// Most that a lens is tilted, rad: view cameras reach 45°.
const MOST_TILT: f64 = PI / 3.0;

impl ThinLens {
    /// Fails unless the focal length is 1 µm to 10 km, the f-number positive and the focus lies beyond the focal length.
    pub fn new(focal_length: Millimeters, f_number: f64, iris: Iris, focus: Focus) -> Result<Self, LensError> {
        check(focal_length, f_number)?;
        if let Focus::Distance(Millimeters(s)) = focus {
            require(
                s > focal_length.0 && s.is_finite(),
                "focus distance",
                s,
                " mm",
                "more than the focal length: nearer planes have no image",
            )?;
        }
        if let Focus::Extension(Millimeters(e)) = focus {
            require(
                e.is_finite() && e > -0.5 * focal_length.0,
                "extension",
                e,
                " mm",
                "a length that leaves the film behind the lens",
            )?;
        }
        Ok(ThinLens { focal_length, f_number, iris, focus, tilt: [0.0; 2] })
    }

    /// The same lens turned about its middle, the film staying: the view stays, the sharp plane turns (Scheimpflug 1904). A focus distance counts along the
    /// camera's axis. Fails beyond 60°, and on planes that the lens, seen askew, has no image of.
    pub fn tilted(self, tilt: [f64; 2]) -> Result<Self, LensError> {
        check_tilt(tilt)?;
        let lens = ThinLens { tilt, ..self };
        if let Focus::Distance(Millimeters(s)) = lens.focus {
            let nearest = "more than the focal length over the cosine of the tilt: nearer planes have no image";
            require(s * lens.foreshortening() > lens.focal_length.0, "focus distance", s, " mm", nearest)?;
        }
        Ok(lens)
    }

    /// Whether it is turned.
    pub fn is_tilted(&self) -> bool {
        self.tilt != [0.0; 2]
    }

    /// Lens axes as they stand before the film.
    fn turn(&self) -> DQuat {
        turn(self.tilt)
    }

    /// A direction of the lens's own axes as it stands before the film.
    pub(crate) fn turned(&self, direction: DVec3) -> DVec3 {
        self.turn() * direction
    }

    /// Cosine between the lens's axis and the camera's.
    fn foreshortening(&self) -> f64 {
        self.tilt[0].cos() * self.tilt[1].cos()
    }

    /// Place of the film for infinity, mm: in the focal plane where the camera's axis meets it.
    pub fn film_at_infinity(&self) -> f64 {
        self.focal_length.0 / self.foreshortening()
    }

    /// Distance of the film, mm: 1 / (1/f − 1/s).
    pub fn film_distance(&self) -> Millimeters {
        // Along the camera's axis, depths along the lens's are shorter by the cosine: a lens of the focal length f / cos.
        let f = self.film_at_infinity();
        match self.focus {
            Focus::Infinity => Millimeters(f),
            Focus::Distance(Millimeters(s)) => Millimeters(f * s / (s - f)),
            Focus::Extension(Millimeters(e)) => Millimeters(f + e),
        }
    }

    /// Distance of the sharp plane; `None` for infinity or beyond.
    pub fn focus_distance(&self) -> Option<Millimeters> {
        let f = self.film_at_infinity();
        match self.focus {
            Focus::Infinity => None,
            Focus::Distance(s) => Some(s),
            Focus::Extension(Millimeters(e)) => (e > 0.0).then(|| Millimeters(f + f * f / e)),
        }
    }

    /// Radius of the pupil, mm.
    pub fn radius(&self) -> f64 {
        0.5 * self.focal_length.0 / self.f_number
    }

    /// From a film point in a direction; the weight counts for a unit of slope.
    pub(crate) fn ray_along(&self, film_mm: DVec2, slope: DVec2) -> Result<LensRay, Blocked> {
        let v = self.film_distance().0;
        let place = (film_mm + slope * v) / self.radius();
        let fraction = f64::from(self.iris.transmittance(place.x, place.y));
        if fraction <= 0.0 {
            return Err(Blocked { surface: 0, why: BlockedBy::Clipped });
        }
        let ray = self.ray(film_mm, place.as_vec2());
        let full = PI * self.radius().powi(2) * self.iris.relative_area() / (v * v);
        Ok(LensRay { weight_sr: ray.weight_sr * fraction / full, ..ray })
    }

    /// Through a turned lens. The film point F lies Z = −F·a behind the lens plane (a: unit axis towards the scene); its chief ray goes on straight, and its image is at
    /// −F f / (Z − f).
    fn tilted_ray(&self, film_mm: DVec2, pupil: Vec2) -> LensRay {
        let (f, radius, turn) = (self.focal_length.0, self.radius(), self.turn());
        let film = film_mm.extend(self.film_distance().0);
        let depth = -film.dot(turn * DVec3::NEG_Z);
        let origin = turn * (pupil.as_dvec2() * radius).extend(0.0);
        let behind = depth - f;
        let direction = match behind.abs() < 1e-12 * f {
            true => -film,
            // Beyond infinity rays would meet behind the lens.
            false => (-film * (f / behind) - origin) * behind.signum(),
        };
        // The pupil is foreshortened by the lens's own axis, the film by the camera's.
        let d2 = film.length_squared();
        let cosines = depth.max(0.0) * film.z / d2;
        let weight_sr = PI * radius * radius * self.iris.relative_area() * cosines / d2;
        LensRay { origin_mm: origin, direction: direction.normalize(), weight_sr }
    }

    /// Where a ray from the scene lands on the film, and what a camera sample along it would have counted: the other way round than [`crate::Lens::ray`].
    /// `origin_mm`: a point on it; `direction`: towards the scene. `None` where it does not come through.
    ///
    /// The lens bends by −1/f of the distance from its middle. Camera samples are even over film and opening, so the density of a ray is |dF/dω| over
    /// the area of the opening and over cosθ: t² / (A e cos⁴θ), with the film at t of the bent ray's (x, y, 1) in lens axes, and e its z along the
    /// camera's axis; upright v² / (A cos⁴θ).
    pub fn entry(&self, origin_mm: DVec3, direction: DVec3) -> Option<ThinEntry> {
        let turn = self.turn();
        let [o, d] = [origin_mm, -direction].map(|v| turn.conjugate() * v);
        if !(d.z > 0.0) {
            return None;
        }
        let at = (o - d * (o.z / d.z)).truncate();
        let (place, f) = (at / self.radius(), self.focal_length.0);
        let fraction = f64::from(self.iris.transmittance(place.x, place.y));
        let bent = turn * (d.truncate() / d.z - at / f).extend(1.0);
        let origin = turn * at.extend(0.0);
        let t = (self.film_distance().0 - origin.z) / bent.z;
        if !(fraction > 0.0 && bent.z > 0.0 && t > 0.0) {
            return None;
        }
        let film = (origin + bent * t).truncate();
        let area = PI * self.radius().powi(2) * self.iris.relative_area();
        let density = fraction * t * t / (area * bent.z * d.z.powi(4));
        Some(ThinEntry { film, origin_mm: origin, weight_sr: self.ray(film, place.as_vec2()).weight_sr, density })
    }

    pub(crate) fn ray(&self, film_mm: DVec2, pupil: Vec2) -> LensRay {
        if self.is_tilted() {
            return self.tilted_ray(film_mm, pupil);
        }
        let v = self.film_distance().0;
        let radius = self.radius();
        let origin = (pupil.as_dvec2() * radius).extend(0.0);
        let film = film_mm.extend(v);
        // All rays of a film point meet where its chief ray, which is not bent, meets the sharp plane.
        let direction = match self.focus {
            Focus::Infinity => -film.normalize(),
            Focus::Distance(Millimeters(s)) => (-film * (s / v) - origin).normalize(),
            Focus::Extension(Millimeters(0.0)) => -film.normalize(),
            // Beyond infinity they would meet behind the lens.
            Focus::Extension(Millimeters(e)) => ((-film * (self.focal_length.0 / e) - origin) * e.signum()).normalize(),
        };
        // cos⁴ of the chief ray for all of the pupil: an ideal lens keeps Abbe's sine condition, so that its irradiance is
        // π L / (4 N²) at any aperture, where a flat pupil of the same diameter would lose light (12 % at f/1.4).
        let d2 = film.length_squared();
        LensRay { origin_mm: origin, direction, weight_sr: PI * radius * radius * self.iris.relative_area() * v * v / (d2 * d2) }
    }
}

/// Fails on a lens that would be turned by more than [`MOST_TILT`] (rad) either way.
pub(crate) fn check_tilt(tilt: [f64; 2]) -> Result<(), LensError> {
    let largest = tilt[0].abs().max(tilt[1].abs());
    require(largest <= MOST_TILT, "tilt", largest.to_degrees(), "°", "60° or less each way")
}

/// Axes of a lens that is turned forward and to the right (rad), as they stand before the film.
pub(crate) fn turn(tilt: [f64; 2]) -> DQuat {
    DQuat::from_rotation_y(-tilt[1]) * DQuat::from_rotation_x(-tilt[0])
}

/// Focal lengths, mm: from about the wavelength of light to far beyond the longest telescopes (ELT: 743 m).
const FOCAL_LENGTHS_MM: RangeInclusive<f64> = 1e-3..=1e7;

fn check(focal_length: Millimeters, f_number: f64) -> Result<(), LensError> {
    let expected = "0.001 mm to 10 km: a shorter one is about the wavelength of light, and no telescope is longer";
    require(FOCAL_LENGTHS_MM.contains(&focal_length.0), "focal length", focal_length.0, " mm", expected)?;
    require(f_number > 0.0 && f_number.is_finite(), "f-number", f_number, "", "a positive number such as f/2.8")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Lens;

    fn thin(f: f64, n: f64, s: f64) -> ThinLens {
        ThinLens::new(Millimeters(f), n, Iris::Round, Focus::Distance(Millimeters(s))).unwrap()
    }

    #[test]
    fn projections_look_where_they_should() {
        let hole = Pinhole::new(Millimeters(50.0), 8.0).unwrap();
        let panorama = Pinhole { projection: Projection::Panorama { film_mm: [36.0, 18.0] }, ..hole };
        let near = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-12, "{a} {b}");
        near(panorama.ray(DVec2::ZERO).direction, DVec3::NEG_Z);
        // On the film right is left.
        near(panorama.ray(DVec2::new(-9.0, 0.0)).direction, DVec3::X);
        near(panorama.ray(DVec2::new(9.0, 0.0)).direction, DVec3::NEG_X);
        near(panorama.ray(DVec2::new(3.0, -9.0)).direction, DVec3::Y);
        let parallel = Pinhole { projection: Projection::Orthographic { reduction: 100.0 }, ..hole }.ray(DVec2::new(-2.0, 1.0));
        near(parallel.origin_mm, DVec3::new(200.0, -100.0, 0.0));
        near(parallel.direction, DVec3::NEG_Z);
        // As much light everywhere as the hole has in the middle.
        assert!((parallel.weight_sr / hole.ray(DVec2::ZERO).weight_sr - 1.0).abs() < 1e-12);
    }

    #[test]
    fn conjugates_have_their_textbook_values() {
        for (f, s, image) in [(50.0, 1000.0, 52.6316), (50.0, 3000.0, 50.8475), (50.0, 500.0, 55.5556), (100.0, 1000.0, 111.1111)]
        {
            assert!((thin(f, 2.0, s).film_distance().0 - image).abs() < 1e-4);
        }
    }

    #[test]
    fn all_rays_of_a_film_point_meet_in_the_sharp_plane() {
        let lens = thin(50.0, 1.4, 2000.0);
        let film = DVec2::new(7.0, -3.0);
        let at_plane = |u| {
            let r = Lens::Thin(lens.clone()).ray(film, u).unwrap();
            r.origin_mm + r.direction * ((-2000.0 - r.origin_mm.z) / r.direction.z)
        };
        let expected = DVec3::new(-7.0, 3.0, 0.0) * (2000.0 / lens.film_distance().0) - DVec3::Z * 2000.0;
        for u in [[0.1, 0.2], [0.9, 0.4], [0.5, 0.99]] {
            assert!((at_plane(u) - expected).length() < 1e-9, "{} {expected}", at_plane(u));
        }
    }

    #[test]
    fn irradiance_is_pi_over_four_n_squared_with_cosine_to_the_fourth() {
        // Mean weight over the pupil; on axis π/(4N²(1+m)²).
        let mean = |lens: &ThinLens, film: DVec2| {
            let n = 64;
            let each = |i: usize| [(i % n) as f32 + 0.5, (i / n) as f32 + 0.5].map(|x| x / n as f32);
            (0..n * n).map(|i| lens.ray(film, lens.iris.sample(each(i))).weight_sr).sum::<f64>() / (n * n) as f64
        };
        let lens = thin(50.0, 8.0, 5000.0);
        let m = lens.film_distance().0 / 5000.0;
        let exact = PI / (4.0 * 64.0 * (1.0 + m).powi(2));
        assert!((mean(&lens, DVec2::ZERO) / exact - 1.0).abs() < 0.01);
        let angle: f64 = 0.4;
        let film = DVec2::X * lens.film_distance().0 * angle.tan();
        let ratio = mean(&lens, film) / mean(&lens, DVec2::ZERO);
        assert!((ratio / angle.cos().powi(4) - 1.0).abs() < 0.01, "{ratio}");
        // Equal f-numbers, other focal length: the same; half the area: half.
        assert!((mean(&thin(200.0, 8.0, 2e7), DVec2::ZERO) / mean(&thin(50.0, 8.0, 2e7), DVec2::ZERO) - 1.0).abs() < 1e-3);
        for n in [1.0, 1.4, 8.0] {
            let half = mean(&thin(50.0, n * 2f64.sqrt(), 5000.0), DVec2::ZERO) / mean(&thin(50.0, n, 5000.0), DVec2::ZERO);
            assert!((half - 0.5).abs() < 1e-9, "{half}");
        }
    }

    #[test]
    fn rays_from_the_scene_land_where_camera_samples_draw_them() {
        let upright = thin(50.0, 2.0, 1500.0);
        let blades = Iris::blades(5, 0.2, 0.0).unwrap();
        let far = ThinLens::new(Millimeters(35.0), 1.4, blades, Focus::Infinity).unwrap();
        let beyond = ThinLens { focus: Focus::Extension(Millimeters(-0.4)), ..upright.clone() };
        let tilted = thin(90.0, 4.0, 3000.0).tilted([0.12, -0.2]).unwrap();
        for lens in [upright, far, beyond, tilted] {
            for (film, u) in
                [(DVec2::ZERO, [0.2, 0.7]), (DVec2::new(9.0, -6.0), [0.6, 0.1]), (DVec2::new(-15.0, 11.0), [0.9, 0.4])]
            {
                let ray = Lens::Thin(lens.clone()).ray(film, u).unwrap();
                // From any point of the ray.
                let back = lens.entry(ray.origin_mm + ray.direction * 700.0, ray.direction).unwrap();
                assert!(
                    (back.film - film).length() < 1e-6 && (back.origin_mm - ray.origin_mm).length() < 1e-9,
                    "{back:?} {film}"
                );
                assert!((back.weight_sr / ray.weight_sr - 1.0).abs() < 1e-6);
                // Film area a solid angle, by differences, at the same place of the lens: the plane of the opening sees it under the lens's own angle.
                let (x, y) = ray.direction.any_orthonormal_pair();
                let through = |step: DVec3| {
                    let d = (ray.direction + step * 1e-5).normalize();
                    lens.entry(ray.origin_mm, d).unwrap().film
                };
                let (dx, dy) = (through(x) - through(-x), through(y) - through(-y));
                let per_sr = dx.perp_dot(dy).abs() / 4e-10;
                let cos = (lens.turn() * DVec3::NEG_Z).dot(ray.direction);
                let expected = per_sr / (PI * lens.radius().powi(2) * cos);
                assert!((back.density / expected - 1.0).abs() < 1e-4, "{} {expected}", back.density);
            }
        }
    }

    /// Where rays of a film point through a tilted lens meet.
    fn image(lens: &ThinLens, film: DVec2) -> DVec3 {
        let [a, b] = [Vec2::new(0.9, 0.1), Vec2::new(-0.6, -0.7)].map(|p| lens.ray(film, p));
        // Both in one plane: the place along the first that is nearest to the second.
        let (d, e, w) = (a.direction, b.direction, a.origin_mm - b.origin_mm);
        let (de, dw, ew) = (d.dot(e), d.dot(w), e.dot(w));
        let t = (de * ew - dw) / (1.0 - de * de);
        let at = a.origin_mm + d * t;
        assert!((at - b.origin_mm).cross(e).length() < 1e-6 * at.length(), "{film}: rays do not meet");
        at
    }

    #[test]
    fn a_tilted_lens_keeps_scheimpflugs_and_the_hinge_rule() {
        for tilt in [[0.14, 0.0], [-0.3, 0.0], [0.0, 0.2], [0.1, -0.15]] {
            let s = 3000.0;
            let lens = thin(90.0, 4.0, s).tilted(tilt).unwrap();
            let v = lens.film_distance().0;
            let axis = lens.turn() * DVec3::NEG_Z;
            // The sharp plane, by three film points: it meets the camera's axis at the focus distance.
            let [p, q, r] = [DVec2::ZERO, DVec2::new(9.0, 2.0), DVec2::new(-3.0, 11.0)].map(|film| image(&lens, film));
            assert!((p - DVec3::new(0.0, 0.0, -s)).length() < 1e-6 * s, "{p}");
            let normal = (q - p).cross(r - p).normalize();
            let off = |x: DVec3| (x - p).dot(normal).abs();
            let fourth = image(&lens, DVec2::new(-14.0, -8.0));
            assert!(off(fourth) < 1e-6 * fourth.length());
            // Lines in which planes meet: a point and its direction.
            let along = axis.cross(DVec3::Z).normalize();
            let across = along.cross(DVec3::Z);
            // Film plane z = v and lens plane a·x = 0 (Scheimpflug); front focal plane a·x = f and z = 0 (hinge; Merklinger 1992).
            let scheimpflug = DVec3::Z * v - across * (axis.z * v / axis.dot(across));
            let hinge = across * (90.0 / axis.dot(across));
            for line in [scheimpflug, hinge] {
                assert!(off(line) < 1e-6 * s && off(line + along * 50.0) < 1e-6 * s, "{tilt:?}: {}", off(line));
            }
            // The view stays: chief rays go straight.
            let chief = lens.ray(DVec2::new(5.0, -4.0), Vec2::ZERO).direction;
            assert!((chief + DVec2::new(5.0, -4.0).extend(v).normalize()).length() < 1e-12);
        }
        // The limit of no tilt is the lens as it was, light included.
        let (plain, nearly) = (thin(90.0, 4.0, 3000.0), thin(90.0, 4.0, 3000.0).tilted([1e-9, 0.0]).unwrap());
        let film = DVec2::new(10.0, -7.0);
        let (a, b) = (plain.ray(film, Vec2::new(0.3, 0.8)), nearly.ray(film, Vec2::new(0.3, 0.8)));
        assert!((a.direction - b.direction).length() < 1e-8 && (a.weight_sr / b.weight_sr - 1.0).abs() < 1e-8);
        assert!(thin(90.0, 4.0, 3000.0).tilted([1.2, 0.0]).is_err() && thin(90.0, 4.0, 91.0).tilted([0.5, 0.0]).is_err());
        // Refocused and stopped down it stays tilted.
        let lens = Lens::Thin(thin(90.0, 4.0, 3000.0).tilted([0.1, 0.0]).unwrap());
        for changed in [lens.refocused(Focus::Infinity).unwrap(), lens.stopped(8.0).unwrap(), lens.with_extension(1.0).unwrap()] {
            assert!(matches!(changed, Lens::Thin(l) if l.tilt == [0.1, 0.0]));
        }
        // A distance and its extension are the same place of the film.
        let back = lens.refocused(Focus::Extension(lens.extension())).unwrap();
        assert!((back.focus_distance().unwrap().0 / 3000.0 - 1.0).abs() < 1e-9);
    }

    #[test]
    fn impossible_lenses_are_refused() {
        let new = |f, n, s| ThinLens::new(Millimeters(f), n, Iris::Round, Focus::Distance(Millimeters(s)));
        assert!(new(50.0, 0.0, 1000.0).unwrap_err().to_string().contains("f-number 0: expected a positive"));
        assert!(new(0.0, 2.0, 1000.0).is_err() && new(50.0, 2.0, 50.0).is_err() && new(50.0, f64::NAN, 90.0).is_err());
    }
}
