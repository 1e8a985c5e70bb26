//! Where a point of the world lies in the picture: the place whose chief ray, through the lens as it is, passes the point.
//!
//! Lenses answer the other way round, from a place on the film to a ray. Newton's method turns that around, with derivatives by differences; it needs a start
//! from which the lens sees in about the right direction.

use crate::camera::Camera;
use diopter_lens::{Lens, Projection};
use glam::{Affine3A, DMat3, DVec2, DVec3, Vec3};

/// What is looked for, in the space of the lens (mm).
#[derive(Clone, Copy, Debug)]
pub(crate) enum Target {
    /// A point.
    Point(DVec3),
    /// Something infinitely far away, by its unit direction.
    Direction(DVec3),
}

impl Target {
    /// A point of the world (m) as a camera at a place sees it.
    pub(crate) fn point(world: DVec3, world_from_camera: &Affine3A) -> Target {
        let (axes, place) = rigid(world_from_camera);
        Target::Point(axes.transpose() * (world - place) * 1e3)
    }

    /// A direction of the world as a camera at a place sees it.
    pub(crate) fn direction(world: Vec3, world_from_camera: &Affine3A) -> Target {
        Target::Direction((rigid(world_from_camera).0.transpose() * world.as_dvec3()).normalize())
    }

    /// Unit direction from a place.
    pub(crate) fn direction_from(self, origin: DVec3) -> DVec3 {
        match self {
            Target::Point(p) => (p - origin).normalize(),
            Target::Direction(d) => d,
        }
    }
}

impl Camera {
    /// Whether the lens has an axis along which depth counts; of panoramas, which look all around, depth is distance.
    pub(crate) fn has_axis(&self) -> bool {
        !matches!(&self.lens, Lens::Pinhole(p) if matches!(p.projection, Projection::Panorama { .. }))
    }

    /// Whether what is sharp at once is a plane across the axis; of others it is a sphere about the camera.
    pub(crate) fn focuses_on_planes(&self) -> bool {
        match &self.lens {
            Lens::Calibrated(lens) => lens.focuses_on_planes(),
            _ => self.has_axis(),
        }
    }
}

/// Axes and place of a camera.
fn rigid(place: &Affine3A) -> (DMat3, DVec3) {
    let axis = |v: glam::Vec3A| Vec3::from(v).as_dvec3();
    let m = &place.matrix3;
    (DMat3::from_cols(axis(m.x_axis), axis(m.y_axis), axis(m.z_axis)), axis(place.translation))
}

/// Pixels over which derivatives are taken: small beside distortion, large beside rounding.
const STEP: f64 = 0.5;
/// A place is found when it moves less than this, in pixels.
const CLOSE: f64 = 1e-4;
/// What is taken for found when steps no longer help: rays of tables of pupils have small kinks.
const CLOSE_ENOUGH: f64 = 0.02;
const MOST_STEPS: usize = 40;
const MOST_HALVINGS: usize = 10;

/// The place (pixels from the upper left corner of the picture) whose ray passes a target, from a place near it; `None` where the lens does not show it. `ray`:
/// origin (mm) and unit direction of a place's chief ray in the space of the lens, `None` where it lets nothing pass.
pub(crate) fn find(target: Target, start: DVec2, ray: impl Fn(DVec2) -> Option<(DVec3, DVec3)>) -> Option<DVec2> {
    // What misses the target, across the direction to it.
    let axis = target.direction_from(ray(start)?.0);
    let (across, up) = axis.any_orthonormal_pair();
    let miss = |at: DVec2| {
        let (origin, direction) = ray(at)?;
        let wanted = target.direction_from(origin);
        let off = direction - wanted;
        // Behind, what lies opposite would look the same.
        (direction.dot(wanted) > 0.0).then(|| DVec2::new(off.dot(across), off.dot(up)))
    };
    let slope = |at: DVec2, here: DVec2, step: DVec2| {
        miss(at + step).map(|there| (there - here) / STEP).or_else(|| miss(at - step).map(|there| (here - there) / STEP))
    };
    let (mut at, mut here) = (start, miss(start)?);
    for _ in 0..MOST_STEPS {
        let (dx, dy) = (slope(at, here, DVec2::X * STEP)?, slope(at, here, DVec2::Y * STEP)?);
        let det = dx.perp_dot(dy);
        let step = -DVec2::new(here.perp_dot(dy), dx.perp_dot(here)) / det;
        if !step.is_finite() {
            return None;
        }
        if step.length() < CLOSE {
            return Some(at + step);
        }
        // Not farther than it brings nearer.
        let nearer = (0..MOST_HALVINGS).find_map(|k| {
            let next = at + step * 0.5f64.powi(k as i32);
            let there = miss(next)?;
            (there.length() < here.length()).then_some((next, there))
        });
        match nearer {
            Some(nearer) => (at, here) = nearer,
            None => return (step.length() < CLOSE_ENOUGH).then_some(at),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A pinhole of 50 mm before pixels of 10 µm, 640 × 480, with barrel distortion of the tangent.
    fn ray(distortion: f64) -> impl Fn(DVec2) -> Option<(DVec3, DVec3)> {
        move |at| {
            let p = (at - DVec2::new(320.0, 240.0)) * 0.01 / 50.0;
            let p = p * (1.0 + distortion * p.length_squared());
            Some((DVec3::ZERO, DVec3::new(p.x, -p.y, -1.0).normalize()))
        }
    }

    #[test]
    fn places_of_rays_are_found_again() {
        for distortion in [0.0, 8.0, -8.0] {
            let ray = ray(distortion);
            for (start, at) in [([10.0, 20.0], [600.0, 470.0]), ([320.5, 240.5], [320.5, 240.5]), ([320.0, 240.0], [100.3, 33.8])]
            {
                let (start, at) = (DVec2::from_array(start), DVec2::from_array(at));
                let direction = ray(at).unwrap().1;
                for target in [Target::Point(direction * 3000.0), Target::Direction(direction)] {
                    let found = find(target, start, &ray).unwrap();
                    assert!((found - at).length() < 1e-4, "{distortion}: {found} {at}");
                }
            }
        }
    }

    #[test]
    fn what_lies_behind_is_not_found() {
        let behind = Target::Point(DVec3::new(0.0, 0.0, 1000.0));
        assert_eq!(find(behind, DVec2::new(320.0, 240.0), ray(0.0)), None);
    }

    #[test]
    fn targets_are_as_the_camera_sees_them() {
        let place = crate::camera::look_at(Vec3::new(1.0, 2.0, 3.0), Vec3::new(1.0, 2.0, 0.0), Vec3::Y).unwrap();
        let Target::Point(p) = Target::point(DVec3::new(1.5, 2.0, 1.0), &place) else { panic!("a point") };
        assert!((p - DVec3::new(500.0, 0.0, -2000.0)).length() < 1e-3, "{p}");
    }
}
