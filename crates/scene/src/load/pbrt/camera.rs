//! The camera and its film.

use super::Fault;
use super::params::Params;
use super::world::{World, affine};
use crate::scene::Viewpoint;
use glam::{DMat4, DVec3};

/// What is taken over from a film.
pub struct Film {
    /// Columns and rows, if they are to be taken over.
    pub size: Option<[usize; 2]>,
}

/// Most pixels of a picture that nobody asked for on the command line.
const MOST_PIXELS: usize = 100_000_000;
/// Most pixels a side.
const LARGEST_SIDE: i64 = 65_535;

pub fn film(world: &mut World, p: &Params, kind: &str) -> Result<Film, Fault> {
    if !matches!(kind, "" | "rgb" | "gbuffer" | "spectral") {
        return Err(p.place.fault(format!("film \"{kind}\""), "rgb, gbuffer or spectral"));
    }
    let side = |name: &str, default: i64| {
        let n = p.integer(name, default)?;
        if (1..=LARGEST_SIDE).contains(&n) {
            Ok(n as usize)
        } else {
            Err(p.place.fault(format!("{name} {n}"), format!("1 to {LARGEST_SIDE}")))
        }
    };
    let size = [side("xresolution", 1280)?, side("yresolution", 720)?];
    let size = match size[0] * size[1] <= MOST_PIXELS {
        true => Some(size),
        false => {
            world.warn(
                p.place,
                format!("a film of {} x {} pixels: the picture has the usual size (give --size)", size[0], size[1]),
            );
            None
        }
    };
    let whole = |name: &str| p.get(name).is_none();
    if !whole("cropwindow") || !whole("pixelbounds") {
        world.warn(p.place, "the film is cropped: all of it is shown");
    }
    if p.get("sensor").is_some() || p.get("iso").is_some() {
        world.warn(p.place, "sensor and iso of the film are not used: give --body and --iso");
    }
    Ok(Film { size })
}

pub fn viewpoint(p: &Params, kind: &str, camera_from_world: DMat4, film: &Film) -> Result<Viewpoint, Fault> {
    let [w, h] = film.size.unwrap_or([3, 2]).map(|n| n as f64);
    for name in ["shutteropen", "shutterclose"] {
        p.get(name);
    }
    let aspect = p.float("frameaspectratio", w / h)?;
    if !(1e-3..=1e3).contains(&aspect) {
        return Err(p.place.fault(format!("frameaspectratio {aspect}"), "0.001 to 1000"));
    }
    // Half height of the screen at a distance of 1 for a tangent of 1.
    let window = match p.floats("screenwindow")? {
        None if aspect > 1.0 => [-aspect, aspect, -1.0, 1.0],
        None => [-1.0, 1.0, -1.0 / aspect, 1.0 / aspect],
        Some([a, b, c, d]) if a < b && c < d => [*a, *b, *c, *d],
        Some(other) => return Err(p.place.fault(format!("screenwindow {other:?}"), "left, right, bottom, top")),
    };
    let off_axis =
        (window[0] + window[1]).abs() > 1e-6 * window[1].abs() || (window[2] + window[3]).abs() > 1e-6 * window[3].abs();
    if off_axis {
        return Err(p.place.fault("a screenwindow that is not centred", "one about 0: a camera's film lies behind its lens"));
    }
    let (lens_radius, focus) = (p.float("lensradius", 0.0)?, p.float("focaldistance", 1e6)?);
    if !((0.0..=1e3).contains(&lens_radius) && focus > 0.0 && focus.is_finite()) {
        return Err(p
            .place
            .fault(format!("lensradius {lens_radius}, focaldistance {focus}"), "a radius of at least 0 and a distance above 0"));
    }
    let vertical_fov = match kind {
        "perspective" => {
            let fov = p.float("fov", 90.0)?;
            if !(0.001..180.0).contains(&fov) {
                return Err(p.place.fault(format!("fov {fov}"), "an angle from 0.001 to below 180 degrees"));
            }
            Some((2.0 * ((0.5 * fov).to_radians().tan() * window[3]).atan()) as f32)
        }
        "orthographic" => None,
        other => {
            return Err(p
                .place
                .fault(format!("camera \"{other}\""), "perspective (or orthographic): others are not supported yet"));
        }
    };
    // It looks along +z; ours along −z.
    let world_from_camera = camera_from_world.inverse() * DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0));
    // Scale of a camera's space has no meaning for where it looks.
    let unit = |v: glam::DVec4| v.truncate().normalize_or_zero().extend(0.0);
    let m = world_from_camera;
    let world_from_camera = DMat4::from_cols(unit(m.x_axis), unit(m.y_axis), unit(m.z_axis), m.w_axis);
    Ok(Viewpoint {
        name: "camera".into(),
        world_from_camera: affine(world_from_camera),
        vertical_fov,
        node: None,
        size: film.size,
        lens: Some([lens_radius as f32, focus as f32]),
    })
}
