//! The camera and its film.

use super::Fault;
use super::context::{Context, affine};
use super::params::Params;
use crate::scene::{CameraProjection, FilmHints, LensTable, Viewpoint};
use glam::{DMat4, DVec3};

/// Most pixels of a picture that nobody asked for on the command line.
const MOST_PIXELS: usize = 100_000_000;
/// Most pixels a side.
const LARGEST_SIDE: i64 = 65_535;

/// Pixels of a film, and those of them that are in the picture.
#[derive(Clone, Copy)]
pub struct Pixels {
    full: [i64; 2],
    /// Left, right (not any more), top, bottom (not any more).
    bounds: [i64; 4],
}

impl Pixels {
    /// Columns and rows of the picture.
    fn size(self) -> [i64; 2] {
        let [left, right, top, bottom] = self.bounds;
        [right - left, bottom - top]
    }

    /// How far the middle of the picture lies from that of the film, to the right and up, pixels.
    fn middle(self) -> [f64; 2] {
        let ([left, right, top, bottom], [w, h]) = (self.bounds, self.full);
        [0.5 * (left + right - w) as f64, 0.5 * (h - top - bottom) as f64]
    }

    /// All of a film but what its crop leaves out. Source: pbrt-v4, `FilmBaseParameters`: of `cropwindow` both ends are rounded up, in single precision. Fails where nothing is left.
    fn read(context: &mut Context, p: &Params, full: [i64; 2]) -> Result<Pixels, Fault> {
        let [w, h] = full;
        let wrong = |what: &str, found: &[f64]| {
            p.place.fault(format!("{what} {found:?}"), "left, right, top, bottom, with pixels between them")
        };
        let (what, found, bounds) = match (p.floats("cropwindow")?, p.integers("pixelbounds")?) {
            (Some(window), other) => {
                if other.is_some() {
                    context.warn(p.place, "the film has a cropwindow and pixelbounds: the former counts");
                }
                let [left, right, top, bottom] = window[..] else { return Err(wrong("cropwindow", window)) };
                let at = |part: f64, n: i64| (part.clamp(0.0, 1.0) as f32 * n as f32).ceil() as i64;
                let bounds = [at(left.min(right), w), at(left.max(right), w), at(top.min(bottom), h), at(top.max(bottom), h)];
                ("cropwindow", window, bounds)
            }
            (None, Some(bounds)) => {
                let [left, right, top, bottom] = bounds[..] else { return Err(wrong("pixelbounds", bounds)) };
                let at = |pixel: f64, n: i64| pixel.clamp(0.0, n as f64) as i64;
                ("pixelbounds", bounds, [at(left, w), at(right, w), at(top, h), at(bottom, h)])
            }
            (None, None) => return Ok(Pixels { full, bounds: [0, w, 0, h] }),
        };
        let pixels = Pixels { full, bounds };
        match pixels.size().iter().all(|n| *n > 0) {
            true => Ok(pixels),
            false => Err(wrong(what, found)),
        }
    }
}

/// The size of a `Film` in pixels, its diagonal in mm and what its sensor says, and which of its pixels are in the picture. Fails where its type is not known, a side is
/// below 1 or too large, the diagonal is not 0.1 to 2000 mm or its crop leaves no pixel.
pub fn film(context: &mut Context, p: &Params, kind: &str) -> Result<(FilmHints, Pixels), Fault> {
    if kind == "image" {
        context.warn(p.place, "film \"image\" is of pbrt-v3: its resolution is read");
    } else if !matches!(kind, "" | "rgb" | "gbuffer" | "spectral") {
        return Err(p.place.fault(format!("film \"{kind}\""), "rgb, gbuffer or spectral"));
    }
    let side = |name: &str, default: i64| {
        let n = p.integer(name, default)?;
        if (1..=LARGEST_SIDE).contains(&n) {
            Ok(n)
        } else {
            Err(p.place.fault(format!("{name} {n}"), format!("1 to {LARGEST_SIDE}")))
        }
    };
    let full = [side("xresolution", 1280)?, side("yresolution", 720)?];
    let pixels = Pixels::read(context, p, full)?;
    let size = pixels.size().map(|n| n as usize);
    let size = match size[0] * size[1] <= MOST_PIXELS {
        true => Some(size),
        false => {
            context.warn(
                p.place,
                format!("a film of {} x {} pixels: the picture has the usual size (give --size)", size[0], size[1]),
            );
            None
        }
    };
    let diagonal = p.float("diagonal", 35.0)?;
    if !(0.1..=2000.0).contains(&diagonal) {
        return Err(p.place.fault(format!("a film diagonal of {diagonal}"), "0.1 to 2000 mm"));
    }
    // What says nothing about a picture of a real camera.
    for name in ["filename", "savefp16", "maxcomponentvalue", "nbuckets", "lambdamin", "lambdamax", "coordinatesystem", "scale"] {
        p.get(name);
    }
    // Without a real sensor pbrt's film records light itself.
    let sensor = p.text("sensor")?.filter(|s| *s != "cie1931").map(str::to_owned);
    let iso = match p.get("iso") {
        Some(_) => Some(p.float("iso", 100.0)?).filter(|iso| *iso > 0.0 && iso.is_finite()),
        None => None,
    };
    context.say_unused(p);
    let length = |[w, h]: [i64; 2]| (w as f64).hypot(h as f64);
    let diagonal_mm = Some(diagonal * length(pixels.size()) / length(full));
    Ok((FilmHints { size, diagonal_mm, sensor, iso, ..FilmHints::default() }, pixels))
}

/// A `Camera` in the world, m. Fails where its type or a mapping is not known, an angle, aspect or length is out of range, or the file of its lens cannot be had.
pub fn viewpoint(
    context: &mut Context,
    p: &Params,
    kind: &str,
    camera_from_world: DMat4,
    (mut film, pixels): (FilmHints, Pixels),
) -> Result<Viewpoint, Fault> {
    let [w, h] = pixels.full.map(|n| n as f64);
    let shutter = ["shutteropen", "shutterclose"].map(|name| p.get(name).is_some());
    if shutter != [false; 2] && p.float("shutteropen", 0.0)? != p.float("shutterclose", 1.0)? {
        context.warn(p.place, "its shutter is not taken: --shutter says how long the exposure is");
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
    let shape = (window[1] - window[0]) / (window[3] - window[2]);
    if (shape * h / w - 1.0).abs() > 1e-3 {
        let found = format!("a screen of {shape:.3} : 1 on a film of {w} x {h} pixels, which pbrt stretches");
        context.warn(p.place, format!("{found}: pixels are square here, and the height of the screen is shown"));
    }
    // Height of the picture and where its middle lies, on the screen.
    let pixel = (window[3] - window[2]) / h;
    let height = pixel * pixels.size()[1] as f64;
    let middle = pixels.middle();
    // A lens of glass images the whole film, whatever the screen.
    let on_screen =
        if kind == "realistic" { [0.0; 2] } else { [window[0] + window[1], window[2] + window[3]].map(|sum| 0.5 * sum) };
    let shift = [0, 1].map(|k| (on_screen[k] + pixel * middle[k]) / height);
    if kind != "spherical" {
        film.shift = shift.map(|s| if s.abs() > 1e-6 { s } else { 0.0 });
    } else if pixels.size() != pixels.full {
        context.warn(p.place, "the film of a spherical camera is cropped: all around is shown");
    }
    let (lens_radius, focus) = (p.float("lensradius", 0.0)?, p.float("focaldistance", 1e6)?);
    if !((0.0..=1e3).contains(&lens_radius) && focus > 0.0 && focus.is_finite()) {
        return Err(p
            .place
            .fault(format!("lensradius {lens_radius}, focaldistance {focus}"), "a radius of at least 0 and a distance above 0"));
    }
    let world_from_camera = camera_from_world.inverse();
    let sight = match kind {
        "perspective" => {
            let fov = p.float("fov", 90.0)?;
            if !(0.001..180.0).contains(&fov) {
                return Err(p.place.fault(format!("fov {fov}"), "an angle from 0.001 to below 180 degrees"));
            }
            CameraProjection::Perspective { vertical_fov: (2.0 * ((0.5 * fov).to_radians().tan() * 0.5 * height).atan()) as f32 }
        }
        "orthographic" => {
            if lens_radius > 0.0 {
                context.warn(p.place, "an orthographic camera with a lens: everything is sharp");
            }
            CameraProjection::Orthographic { height: (height * world_from_camera.y_axis.truncate().length()) as f32 }
        }
        "spherical" => {
            if p.text("mapping")? != Some("equirectangular") {
                return Err(p
                    .place
                    .fault("a spherical camera in the equal-area mapping", "\"string mapping\" \"equirectangular\""));
            }
            context.warn(p.place, "straight ahead is in the middle of the picture and left is left, unlike in pbrt's");
            CameraProjection::Panorama
        }
        "realistic" => {
            let file =
                p.text("lensfile")?.ok_or_else(|| p.place.fault("a realistic camera without lensfile", "\"string lensfile\""))?;
            let (stop_mm, focus_m) = (p.float("aperturediameter", 1.0)?, p.float("focusdistance", 10.0)?);
            if !(stop_mm > 0.0 && stop_mm.is_finite() && focus_m > 0.0) {
                return Err(p.place.fault(
                    format!("aperturediameter {stop_mm}, focusdistance {focus_m}"),
                    "lengths above 0: mm and scene units",
                ));
            }
            if p.text("aperture")?.is_some() {
                context.warn(p.place, "the shape of the aperture is round: give --blades or --aperture-image");
            }
            CameraProjection::Table(LensTable { file: file.to_owned(), bytes: context.file(file, p.place)?, stop_mm, focus_m })
        }
        other => {
            return Err(p.place.fault(format!("camera \"{other}\""), "perspective, orthographic, spherical or realistic"));
        }
    };
    // It looks along +z; ours along −z.
    let world_from_camera = world_from_camera * DMat4::from_scale(DVec3::new(1.0, 1.0, -1.0));
    // Scale of a camera's space has no meaning for where it looks, but for its lens.
    let unit = |v: glam::DVec4| v.truncate().normalize_or_zero().extend(0.0);
    let m = world_from_camera;
    let [across, along] = [m.x_axis, m.z_axis].map(|axis| axis.truncate().length());
    let (lens_radius, focus) = (lens_radius * across, focus * along);
    let world_from_camera = DMat4::from_cols(unit(m.x_axis), unit(m.y_axis), unit(m.z_axis), m.w_axis);
    Ok(Viewpoint {
        name: "camera".into(),
        world_from_camera: affine(world_from_camera),
        lens: matches!(sight, CameraProjection::Perspective { .. }).then_some([lens_radius as f32, focus as f32]),
        sight,
        film,
        node: None,
    })
}
