//! Where the points of a film look: what calibrations are fitted to.
//!
//! A real lens has no one centre that all rays pass: the entrance pupil moves with the angle. A focused camera is calibrated on what it is focused on, so the
//! direction of a pixel is that from the middle of the entrance pupil (where the camera stands) to the point in the plane in focus; focused at infinity, of the ray itself.

use crate::camera::Film;
use diopter_lens::Lens;
use diopter_lens::compound::REFERENCE_NM;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

/// Which ray stands for a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrincipalRay {
    /// The mean of all light that passes the pupil, where the picture of a point has its centroid, instead of the chief ray through the pupil's middle.
    pub centroid: bool,
    /// Its wavelength, nm.
    pub wavelength_nm: f64,
}

impl PrincipalRay {
    /// The chief ray of the wavelength at which lenses are set.
    pub const CHIEF: PrincipalRay = PrincipalRay { centroid: false, wavelength_nm: REFERENCE_NM };
    /// The mean of all light of that wavelength.
    pub const CENTROID: PrincipalRay = PrincipalRay { centroid: true, ..PrincipalRay::CHIEF };
}

impl Default for PrincipalRay {
    fn default() -> PrincipalRay {
        PrincipalRay::CHIEF
    }
}

/// Rays a side of the pupil for a centroid.
const ACROSS: usize = 16;
/// Rays that run along the plane in focus are met at most so many times its distance away.
const FARTHEST: f64 = 10.0;

/// Origin (mm, from the camera's place) and unit direction of the ray of a pixel in the axes of OpenCV; `None` where nothing is seen. The centre of the upper left pixel is
/// (0, 0).
pub fn ray(lens: &Lens, film: &Film, pixel: DVec2, which: PrincipalRay) -> Option<[DVec3; 2]> {
    let at = film.point(pixel.x + 0.5, pixel.y + 0.5);
    // From x right, y up, z backward to x right, y down, z forward.
    let turned = |v: DVec3| DVec3::new(v.x, -v.y, -v.z);
    let nm = which.wavelength_nm;
    if !which.centroid {
        let ray = match lens {
            Lens::Compound(lens) => lens.chief_ray_of(at, nm),
            _ => lens.chief_ray(at),
        };
        let ray = ray.ok()?;
        return Some([turned(ray.origin_mm), turned(ray.direction)]);
    }
    let distance = lens.focus_distance().map(|d| d.0);
    let (mut origin, mut towards, mut weight) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for i in 0..ACROSS * ACROSS {
        let u = [(i % ACROSS) as f32 + 0.5, (i / ACROSS) as f32 + 0.5].map(|v| v / ACROSS as f32);
        let ray = match lens {
            Lens::Compound(lens) => lens.ray(at, u, nm),
            _ => lens.ray(at, u),
        };
        let Ok(ray) = ray else { continue };
        let [o, d] = [turned(ray.origin_mm), turned(ray.direction)];
        origin += o * ray.weight_sr;
        towards += d * ray.weight_sr * distance.map_or(1.0, |s| along(s, o, d));
        weight += ray.weight_sr;
    }
    Some([origin / weight, towards.try_normalize()?]).filter(|[o, _]| o.is_finite())
}

/// How far along a ray the plane in focus is.
fn along(distance: f64, origin: DVec3, direction: DVec3) -> f64 {
    let t = (distance - origin.z) / direction.z;
    if direction.z > 0.0 { t.min(FARTHEST * distance) } else { FARTHEST * distance }
}

/// The unit direction from the camera's place to where a ray (origin, mm, and unit direction, axes of OpenCV) is in focus.
pub fn seen_from_camera(lens: &Lens, [origin, direction]: [DVec3; 2]) -> DVec3 {
    // A tilted lens is sharp in a plane askew, which may lie behind the camera for some of its rays.
    if let Lens::Compound(lens) = lens
        && lens.is_tilted()
    {
        let Some([point, normal]) = lens.plane_of_focus().map(|plane| plane.map(|v| DVec3::new(v.x, -v.y, -v.z))) else {
            return direction;
        };
        let farthest = FARTHEST * lens.focus_distance().map_or(f64::INFINITY, |d| d.0);
        let t = (point - origin).dot(normal) / direction.dot(normal);
        let t = if t > 0.0 { t.min(farthest) } else { farthest };
        return if t.is_finite() { (origin + direction * t).normalize() } else { direction };
    }
    match lens.focus_distance() {
        None => direction,
        Some(d) => (origin + direction * along(d.0, origin, direction)).normalize(),
    }
}

/// A pixel and the direction it sees.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observation {
    /// Place in the picture.
    pub pixel: DVec2,
    /// Unit direction.
    pub direction: DVec3,
}

/// Directions over a grid of the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Observed {
    /// Pixels of the picture.
    pub size: [usize; 2],
    /// Places across and down.
    pub grid: [usize; 2],
    /// Row by row; `None` where the lens blocks all light.
    pub points: Vec<Option<Observation>>,
}

/// Places across the picture at which a lens is asked; down as many as its shape wants.
pub const GRID: usize = 33;

/// Asks a lens over a grid that ends in the centres of the outermost pixels. [`GRID`] places across.
pub fn observe(lens: &Lens, film: &Film, which: PrincipalRay) -> Observed {
    let size = [film.columns, film.rows];
    let down = ((GRID - 1) as f64 * film.height_mm / film.width_mm).round().clamp(8.0, 96.0) as usize + 1;
    let grid = [GRID, down];
    let points = (0..GRID * down)
        .into_par_iter()
        .map(|i| {
            let fraction = |k: usize, n: usize| k as f64 / (n - 1) as f64;
            let [x, y] = [fraction(i % GRID, GRID), fraction(i / GRID, down)];
            let pixel = DVec2::new(x * (size[0] - 1) as f64, y * (size[1] - 1) as f64);
            let seen = ray(lens, film, pixel, which)?;
            Some(Observation { pixel, direction: seen_from_camera(lens, seen) })
        })
        .collect();
    Observed { size, grid, points }
}

/// Heights at which light is looked at.
const HEIGHTS: usize = 33;

/// Light along a diagonal of the film, of that in its middle: at equal steps from the middle to the corner, the mean over the pupil. Empty if the middle is dark.
pub fn falloff(lens: &Lens, film: &Film) -> Vec<f64> {
    let light = |at: DVec2| {
        let u = |i: usize| [(i % ACROSS) as f32 + 0.5, (i / ACROSS) as f32 + 0.5].map(|v| v / ACROSS as f32);
        (0..ACROSS * ACROSS).filter_map(|i| lens.ray(at, u(i)).ok()).map(|r| r.weight_sr).sum::<f64>()
    };
    let corner = film.point(film.columns as f64, 0.0) - film.point(0.5 * film.columns as f64, 0.5 * film.rows as f64);
    let middle = film.point(0.5 * film.columns as f64, 0.5 * film.rows as f64);
    let all: Vec<f64> = (0..HEIGHTS).map(|i| light(middle + corner * (i as f64 / (HEIGHTS - 1) as f64))).collect();
    match all[0] > 0.0 {
        true => all.iter().map(|v| v / all[0]).collect(),
        false => Vec::new(),
    }
}
