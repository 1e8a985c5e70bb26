//! The mount: the only place where lens (mm, f64, +z towards the film) and world (m, f32) meet.
//!
//! The lens stands in the camera's frame with its plane (a real lens: the middle of its entrance pupil) at the camera's origin
//! and its +z along the camera's +Z: light goes that way. The picture on the film is upside down and mirrored, so a pixel right of the middle lies at −x.

use crate::camera::{Camera, Film};
use crate::camera_motion::CameraMotion;
use diopter_lens::{Blocked, Lens, LensRay};
use diopter_light::Ray;
use glam::{DVec2, DVec3, Vec3, Vec3A};

/// Metres a millimetre.
const M_PER_MM: f64 = 1e-3;

/// m² a mm².
pub const M2_PER_MM2: f64 = M_PER_MM * M_PER_MM;

/// The lens as it stands at a time of an exposure; `central`: with nothing moved.
pub(crate) fn lens_on<'a>(motion: &'a CameraMotion, central: &'a Lens, time_s: f64) -> &'a Lens {
    motion.moving().map_or(central, |moving| moving.lens(central, time_s))
}

/// How far from its place on the film a pixel collects light at a time of an exposure, mm in the axes of the lens.
pub(crate) fn film_shift_on(motion: &CameraMotion, time_s: f64) -> DVec2 {
    motion.moving().map_or(DVec2::ZERO, |moving| moving.film_shift(time_s))
}

impl Film {
    /// Film point (mm, lens axes) of a place in the picture, in pixels from its upper left corner.
    pub(crate) fn point(&self, column: f64, row: f64) -> DVec2 {
        let at =
            DVec2::new((0.5 - column / self.columns as f64) * self.width_mm, (row / self.rows as f64 - 0.5) * self.height_mm);
        at - DVec2::from_array(self.center_mm)
    }
}

impl Camera {
    /// Film point (mm, lens axes) of a place in the picture, in pixels from its upper left corner.
    pub(crate) fn film_point(&self, column: f64, row: f64) -> DVec2 {
        self.film.point(column, row)
    }

    /// Pixel (column, row) that a film point (mm) lies in; `None` outside the film.
    pub(crate) fn pixel_of(&self, film_mm: [f32; 2]) -> Option<(usize, usize)> {
        let film = &self.film;
        let [x, y] = [0, 1].map(|k| film_mm[k] as f64 + film.center_mm[k]);
        let column = (0.5 - x / film.width_mm) * film.columns as f64;
        let row = (0.5 + y / film.height_mm) * film.rows as f64;
        let inside = column >= 0.0 && row >= 0.0 && column < film.columns as f64 && row < film.rows as f64;
        inside.then_some((column as usize, row as usize))
    }

    /// Whether the lens lets pass at least a fraction of the rays from a grid over a pixel's area and the pupil.
    pub(crate) fn passing(&self, [column, row]: [f64; 2], fraction: f64) -> bool {
        const SIDE: usize = 4;
        let middle = |i: usize| (i % SIDE) as f64 / SIDE as f64 + 0.5 / SIDE as f64;
        let passed = (0..SIDE.pow(4)).filter(|i| {
            let [x, y, u, v] = [*i, i / SIDE, i / SIDE.pow(2), i / SIDE.pow(3)].map(middle);
            self.lens.ray(self.film_point(column + x, row + y), [u as f32, v as f32]).is_ok()
        });
        let needed = (fraction * SIDE.pow(4) as f64).ceil() as usize;
        passed.take(needed).count() == needed
    }

    /// World ray of what leaves a lens in single precision: mm from its pupil, unit direction.
    pub(crate) fn world_ray_of(&self, origin_mm: [f32; 3], direction: [f32; 3], time_s: f64) -> Ray {
        let place = self.motion.at(time_s);
        let origin = place.transform_point3(Vec3::from_array(origin_mm) * M_PER_MM as f32);
        let direction = place.transform_vector3(Vec3::from_array(direction)).normalize();
        Ray { origin, direction, time_s: time_s as f32 }
    }

    /// World ray of what leaves a lens at a time of the exposure.
    pub(crate) fn to_world(&self, ray: &LensRay, time_s: f64) -> Ray {
        let place = self.motion.at(time_s);
        let point = |mm: DVec3| (mm * M_PER_MM).as_vec3();
        let origin: Vec3 = place.transform_point3(point(ray.origin_mm));
        let direction = place.transform_vector3(ray.direction.as_vec3()).normalize();
        Ray { origin, direction, time_s: time_s as f32 }
    }

    /// World point of a place in the camera's frame (mm from its entrance pupil) at a time of the exposure.
    pub(crate) fn world_point(&self, mm: DVec3, time_s: f64) -> Vec3 {
        self.motion.at(time_s).transform_point3((mm * M_PER_MM).as_vec3())
    }

    /// The other way round.
    pub(crate) fn place_of(&self, world: Vec3, time_s: f64) -> DVec3 {
        self.motion.at(time_s).inverse().transform_point3(world).as_dvec3() / M_PER_MM
    }

    /// Unit direction in the camera's frame of a world direction at a time of the exposure.
    pub(crate) fn direction_of(&self, world: Vec3, time_s: f64) -> DVec3 {
        let turned = self.motion.at(time_s).matrix3.transpose() * Vec3A::from(world);
        Vec3::from(turned).as_dvec3().normalize()
    }

    /// The lens as it stands at a time of the exposure: its group may move against shake.
    pub(crate) fn lens_at(&self, time_s: f64) -> &Lens {
        lens_on(&self.motion, &self.lens, time_s)
    }

    /// World ray through the middle of the pupil.
    pub(crate) fn chief_ray(&self, film_mm: DVec2, time_s: f64) -> Result<Ray, Blocked> {
        let ray = self.lens_at(time_s).chief_ray(film_mm + film_shift_on(&self.motion, time_s))?;
        Ok(self.to_world(&ray, time_s))
    }

    /// Where the middle of the entrance pupil is at a time of the exposure, m: the place of the camera, from which its truth counts.
    pub(crate) fn place(&self, time_s: f64) -> Vec3 {
        self.motion.at(time_s).translation.into()
    }

    /// Part of a world vector along the camera's axis at a time of the exposure; of a direction, the cosine between both.
    pub(crate) fn cosine_to_axis(&self, direction: Vec3, time_s: f64) -> f32 {
        self.motion.at(time_s).matrix3.z_axis.dot((-direction).into())
    }

    /// Distance of a ray from the middle of the pupil, 1 at the rim of the fully open lens. Blades of a shutter are taken to lie in
    /// the plane of the entrance pupil, that is near the stop.
    pub(crate) fn pupil_radius(&self, origin_mm: DVec3, direction: DVec3) -> f64 {
        let rim = 0.5 * self.lens.focal_length().0 / self.lens.widest_f_number();
        match &self.lens {
            // Its pupil lies around the camera's place, whichever way it faces; without one all light passes the middle.
            Lens::Calibrated(lens) if lens.pupil().is_some() => origin_mm.length() / rim,
            Lens::Calibrated(_) => 0.0,
            lens if lens.is_tilted() => {
                let axis = lens.axis();
                (origin_mm - direction * (origin_mm.dot(axis) / direction.dot(axis))).length() / rim
            }
            _ => (origin_mm - direction * (origin_mm.z / direction.z)).truncate().length() / rim,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::camera::{Camera, Film, look_at};
    use crate::camera_motion::CameraMotion;
    use diopter_lens::{Lens, Pinhole};
    use diopter_light::units::Millimeters;
    use glam::Vec3;

    #[test]
    fn the_upper_left_pixel_sees_the_upper_left_of_the_world() {
        let camera = Camera {
            lens: Lens::Pinhole(Pinhole::new(Millimeters(50.0), 8.0).unwrap()),
            film: Film::new(36.0, 24.0, 360, 240),
            motion: CameraMotion::still(look_at(Vec3::new(0.0, 1.0, 3.0), Vec3::new(0.0, 1.0, 0.0), Vec3::Y).unwrap()),
        };
        let ray = camera.chief_ray(camera.film_point(0.0, 0.0), 0.0).unwrap();
        let at = ray.at(3.0 / -ray.direction.z);
        // Half the film over the film distance, times 3 m.
        assert!((at - Vec3::new(-3.0 * 0.36, 1.0 + 3.0 * 0.24, 0.0)).length() < 1e-5, "{at}");
    }
}
