//! The veiling glare index: ISO 9358, integral method.

use super::random::{Random, disk, even};
use super::{Balance, GlareTracer, Kind};
use crate::ray::TracedRay;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Rays of a part: whatever the number of threads, parts are added in their order.
const PART: usize = 256;

/// Light in the image of a black spot in an even surround, over that in the image of the surround.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VeilingGlare {
    /// By reflections.
    pub ghosts: f64,
    /// By scatter and walls.
    pub scatter: f64,
}

impl VeilingGlare {
    /// The index, 0 to 1 (usually told in percent).
    pub fn index(&self) -> f64 {
        self.ghosts + self.scatter
    }
}

/// The veiling glare index at a place of the film (mm from the axis): a black spot of angular radius `spot_deg` in a surround that is as bright wherever
/// `bright` says so of a unit direction towards it (lens space, z < 0; ISO 9358:1994, integral method: everywhere). Light is followed back from the
/// film, with `rays` rays over the rear glass. `None` where no light comes straight.
pub fn veiling_glare(
    tracer: &GlareTracer,
    at: DVec2,
    spot_deg: f64,
    rays: usize,
    bright: impl Fn(DVec3) -> bool + Sync,
) -> Option<VeilingGlare> {
    let system = tracer.system();
    let rear = system.surfaces.last()?;
    let spot = -super::spread::light_of(system, at.length())?;
    // Turned to the side of the film where the place is.
    let side = if at.length() > 0.0 { at / at.length() } else { DVec2::Y };
    let spot = DVec3::new(spot.y * side.x, spot.y * side.y, spot.z);
    let within = spot_deg.to_radians().cos();
    let origin = at.extend(system.film_z);
    let parts: Vec<[f64; 3]> = (0..rays.div_ceil(PART))
        .into_par_iter()
        .map(|part| {
            let mut sums = [0.0; 3];
            for i in part * PART..((part + 1) * PART).min(rays) {
                let p = disk(even(i)) * rear.semi_diameter;
                let sag = rear.profile.sag(0.0, rear.semi_diameter * (1.0 - 1e-9)).unwrap_or(0.0);
                let way = DVec3::new(p.x, p.y, rear.z + sag) - origin;
                let direction = way.normalize();
                // Irradiance per radiance: cosines at both ends over the square of the distance.
                let weight = direction.z * direction.z / way.length_squared();
                let ray = TracedRay { position: origin, direction };
                let mut random = Random::new(1 << 41, i as u64);
                tracer.follow_from_film(ray, &mut random, &mut Balance::default(), |kind, direction, power| {
                    let light = weight * power;
                    match kind {
                        Kind::Image => sums[0] += light,
                        // The spot is black.
                        _ if direction.dot(spot) > within || !bright(direction) => (),
                        Kind::Ghost => sums[1] += light,
                        Kind::Scatter => sums[2] += light,
                    }
                });
            }
            sums
        })
        .collect();
    let [image, ghosts, scatter] = parts.iter().fold([0.0; 3], |a, b| std::array::from_fn(|k| a[k] + b[k]));
    let all = image + ghosts + scatter;
    (image > 0.0).then(|| VeilingGlare { ghosts: ghosts / all, scatter: scatter / all })
}
