//! The mount: the only place where lens (mm, f64, +z towards the film) and world (m, f32) meet.
//!
//! The lens stands in the camera's frame with its plane (a real lens: the middle of its entrance pupil) at the camera's origin
//! and its +z along the camera's +Z: light goes that way. The picture on the film is upside down and mirrored, so a pixel right of the middle lies at −x.

use crate::camera::Camera;
use diopter_lens::{Blocked, LensRay};
use diopter_light::Ray;
use glam::{DVec2, DVec3, Vec3};

/// Metres a millimetre.
const M_PER_MM: f64 = 1e-3;

/// m² a mm².
pub const M2_PER_MM2: f64 = M_PER_MM * M_PER_MM;

impl Camera {
    /// Film point (mm, lens axes) of a place in the picture, in pixels from its upper left corner.
    pub(crate) fn film_point(&self, column: f64, row: f64) -> DVec2 {
        let film = &self.film;
        DVec2::new((0.5 - column / film.columns as f64) * film.width_mm, (row / film.rows as f64 - 0.5) * film.height_mm)
    }

    /// Pixel (column, row) that a film point (mm) lies in; `None` outside the film.
    pub(crate) fn pixel_of(&self, film_mm: [f32; 2]) -> Option<(usize, usize)> {
        let film = &self.film;
        let column = (0.5 - film_mm[0] as f64 / film.width_mm) * film.columns as f64;
        let row = (0.5 + film_mm[1] as f64 / film.height_mm) * film.rows as f64;
        let inside = column >= 0.0 && row >= 0.0 && column < film.columns as f64 && row < film.rows as f64;
        inside.then_some((column as usize, row as usize))
    }

    /// World ray of what leaves a lens in single precision: mm from its pupil, unit direction.
    pub(crate) fn world_ray_of(&self, origin_mm: [f32; 3], direction: [f32; 3], time_s: f32) -> Ray {
        let origin = self.world_from_camera.transform_point3(Vec3::from_array(origin_mm) * M_PER_MM as f32);
        let direction = self.world_from_camera.transform_vector3(Vec3::from_array(direction)).normalize();
        Ray { origin, direction, time_s }
    }

    fn to_world(&self, ray: LensRay, time_s: f32) -> (Ray, f64) {
        let point = |mm: DVec3| (mm * M_PER_MM).as_vec3();
        let origin: Vec3 = self.world_from_camera.transform_point3(point(ray.origin_mm));
        let direction = self.world_from_camera.transform_vector3(ray.direction.as_vec3()).normalize();
        (Ray { origin, direction, time_s }, ray.weight_sr)
    }

    /// World ray and weight (sr) for a film point and a place in the pupil.
    pub(crate) fn world_ray(&self, film_mm: DVec2, pupil: [f32; 2], time_s: f32) -> Result<(Ray, f64), Blocked> {
        Ok(self.to_world(self.lens.ray(film_mm, pupil)?, time_s))
    }

    /// World ray through the middle of the pupil.
    pub(crate) fn chief_ray(&self, film_mm: DVec2, time_s: f32) -> Result<Ray, Blocked> {
        Ok(self.to_world(self.lens.chief_ray(film_mm)?, time_s).0)
    }

    /// Cosine between a world direction and the camera's axis.
    pub(crate) fn cosine_to_axis(&self, direction: Vec3) -> f32 {
        self.world_from_camera.matrix3.z_axis.dot((-direction).into())
    }
}

#[cfg(test)]
mod tests {
    use crate::camera::{Camera, Film, look_at};
    use diopter_lens::{Lens, Pinhole};
    use diopter_light::units::Millimeters;
    use glam::Vec3;

    #[test]
    fn the_upper_left_pixel_sees_the_upper_left_of_the_world() {
        let camera = Camera {
            lens: Lens::Pinhole(Pinhole::new(Millimeters(50.0), 8.0).unwrap()),
            film: Film::new(36.0, 24.0, 360, 240),
            world_from_camera: look_at(Vec3::new(0.0, 1.0, 3.0), Vec3::new(0.0, 1.0, 0.0), Vec3::Y).unwrap(),
        };
        let ray = camera.chief_ray(camera.film_point(0.0, 0.0), 0.0).unwrap();
        let at = ray.at(3.0 / -ray.direction.z);
        // Half the film over the film distance, times 3 m.
        assert!((at - Vec3::new(-3.0 * 0.36, 1.0 + 3.0 * 0.24, 0.0)).length() < 1e-5, "{at}");
    }
}
