//! How wide the cone of a pixel is in the scene, by which pictures on surfaces are filtered ([`diopter_scene::radiance::RayCone`]).
//!
//! Rays of neighbouring pixels through one place of the pupil part by the angle between their chief rays. It is computed at some places of the film and
//! interpolated between; of the two directions the smaller counts, so that nothing is blurred where a lens stretches the picture. Limit: the width
//! of the pupil is left out, so what is far out of focus is not filtered more.

use crate::camera::Camera;
use diopter_light::Ray;
use diopter_scene::Scene;
use diopter_scene::radiance::RayCone;
use glam::DVec3;

/// Places a side of the film at which chief rays are traced.
const NODES: usize = 5;

/// Angles of pixels over the film.
pub(super) struct PixelCones {
    columns: f32,
    rows: f32,
    /// rad, `[row][column]`
    nodes: [[f32; NODES]; NODES],
}

impl PixelCones {
    /// Of a camera, where the scene has pictures that are filtered; `None` with a microlens array, behind which pixels do not see what is before them.
    pub(super) fn of(scene: &Scene, camera: &Camera) -> Option<PixelCones> {
        if !scene.filters_pictures() || camera.film.microlenses.is_some() {
            return None;
        }
        let [columns, rows] = [camera.film.columns, camera.film.rows].map(|n| n as f64);
        let place = |i: usize, pixels: f64| pixels * i as f64 / (NODES - 1) as f64;
        let angle = |i: usize, j: usize| angle_at(camera, [place(i, columns), place(j, rows)]);
        let found: [[Option<f32>; NODES]; NODES] = std::array::from_fn(|j| std::array::from_fn(|i| angle(i, j)));
        // Where the lens shows nothing: as where it is sharpest.
        let least = found.iter().flatten().flatten().copied().reduce(f32::min)?;
        let nodes = found.map(|row| row.map(|angle| angle.unwrap_or(least)));
        Some(PixelCones { columns: columns as f32, rows: rows as f32, nodes })
    }

    /// Angle of a pixel, rad.
    fn at(&self, column: usize, row: usize) -> f32 {
        let split = |at: usize, pixels: f32| {
            let x = (at as f32 + 0.5) / pixels * (NODES - 1) as f32;
            let i = (x as usize).min(NODES - 2);
            (i, x - i as f32)
        };
        let ((i, s), (j, t)) = (split(column, self.columns), split(row, self.rows));
        let along = |row: &[f32; NODES]| row[i] + (row[i + 1] - row[i]) * s;
        let (above, below) = (along(&self.nodes[j]), along(&self.nodes[j + 1]));
        above + (below - above) * t
    }

    /// The cone of a sample. A sample stands for the n-th part of the pixel among the n up to it, so that what filtering blurs vanishes with more
    /// samples, and a sample does not depend on how many are to come.
    #[inline]
    pub(super) fn cone(cones: Option<&Self>, [column, row]: [usize; 2], sample: u32, ray: Ray) -> RayCone {
        match cones {
            None => RayCone::thin(ray),
            Some(cones) => {
                let fraction = 1.0 / (sample as f32 + 1.0).sqrt();
                RayCone { ray, spread: cones.at(column, row) * fraction, fraction }
            }
        }
    }
}

/// The smaller of the angles to the next pixel across and down, rad; `None` where the lens lets none through.
fn angle_at(camera: &Camera, [column, row]: [f64; 2]) -> Option<f32> {
    let direction =
        |x: f64, y: f64| -> Option<DVec3> { Some(camera.lens.chief_ray(camera.film_point(x, y)).ok()?.direction.normalize()) };
    let here = direction(column, row)?;
    // Into the picture: outside it the lens may show nothing.
    let step = |at: f64, pixels: usize| if at > 0.5 * pixels as f64 { -1.0 } else { 1.0 };
    let across = direction(column + step(column, camera.film.columns), row)?;
    let down = direction(column, row + step(row, camera.film.rows))?;
    let angle = [across, down].map(|d| (d - here).length()).into_iter().fold(f64::INFINITY, f64::min);
    (angle.is_finite() && angle > 0.0).then_some(angle as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Film;
    use crate::camera_motion::CameraMotion;
    use diopter_lens::{Lens, Pinhole};
    use diopter_light::units::Millimeters;
    use diopter_scene::material::{Material, Scattering};
    use diopter_scene::shape::Quad;
    use diopter_scene::texture::{Color, Image, Texture};
    use diopter_scene::{Description, Object, Shape};
    use glam::{Affine3A, Vec3};
    use std::sync::Arc;

    fn scene(color: Color) -> Scene {
        let quad = Quad { corner: Vec3::ZERO, edges: [Vec3::X, Vec3::Y] };
        Scene::build(Description {
            materials: vec![Material::new("wall", Scattering::Diffuse(color))],
            objects: vec![Object::new("wall", Shape::Quad(quad), 0)],
            ..Default::default()
        })
        .unwrap()
    }

    #[test]
    fn pixels_of_a_pinhole_are_as_wide_as_its_geometry_says() {
        let camera = Camera {
            lens: Lens::Pinhole(Pinhole::new(Millimeters(50.0), 8.0).unwrap()),
            film: Film::new(36.0, 24.0, 360, 240),
            motion: CameraMotion::still(Affine3A::IDENTITY),
        };
        let texture = Texture::color(Arc::new(Image::new(2, 1, vec![[0; 4], [255; 4]])));
        let cones = PixelCones::of(&scene(Color::Textured { factor: Vec3::ONE, texture }), &camera).unwrap();
        for [column, row] in [[180, 120], [0, 0], [359, 239], [300, 40]] {
            // A pixel of p at the slope s from the axis, film at d: across the radius p / (d √(1 + s²)), along it 1 + s² times less. Of two
            // neighbours at right angles, the least angle lies between.
            let slope = glam::DVec2::new(column as f64 + 0.5 - 180.0, row as f64 + 0.5 - 120.0) * 0.1 / 50.0;
            let square = 1.0 + slope.length_squared();
            let (widest, least) = (0.1 / 50.0 / square.sqrt(), 0.1 / 50.0 / square);
            let found = f64::from(cones.at(column, row));
            // Five places a side stand for all: a per cent between them, as the cosine bends.
            assert!(found < widest * 1.01 && found > least * 0.99, "{column} {row}: {least} {found} {widest}");
        }
        let ray = Ray { origin: Vec3::ZERO, direction: Vec3::NEG_Z, time_s: 0.0 };
        let spread = |sample: u32| PixelCones::cone(Some(&cones), [180, 120], sample, ray).spread;
        assert!((spread(0) - 0.002).abs() < 1e-5 && (spread(15) - 0.0005).abs() < 1e-5);
        // Nothing to filter, nothing to compute.
        assert!(PixelCones::of(&scene(Color::rgb(0.5, 0.5, 0.5)), &camera).is_none());
        assert_eq!(PixelCones::cone(None, [0, 0], 3, ray).spread, 0.0);
    }
}
