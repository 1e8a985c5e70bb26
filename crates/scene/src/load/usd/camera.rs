//! Cameras. Source: OpenUSD, `UsdGeomCamera`: focal length and apertures in tenths of a scene unit, looking along −z.

use super::layer::Value;
use super::stage::{Prim, Stage};
use super::world::{Conform, Place, World, affine};
use crate::SceneError;
use crate::load::size_of_aspect;
use crate::scene::{CameraProjection, FilmHints, Viewpoint};
use glam::{Affine3A, DMat4};

/// Sides of a film that nobody doubts, mm.
const PLAUSIBLE_MM: std::ops::RangeInclusive<f64> = 1.0..=500.0;

/// Adds a camera. Fails where a value of it is damaged in its file; what is not finite or not positive has the default of UsdGeomCamera.
pub fn add(world: &mut World, prim: &Prim, place: &Place) -> Result<(), SceneError> {
    let stage = &world.stage;
    let number = |name: &str, default: f64| -> Result<f64, SceneError> {
        Ok(stage.value(prim, name)?.and_then(|v| v.number()).filter(|v| v.is_finite()).unwrap_or(default))
    };
    let positive =
        |name: &str, default: f64| Ok::<f64, SceneError>(Some(number(name, default)?).filter(|v| *v > 0.0).unwrap_or(default));
    let (width, height) = (positive("horizontalAperture", 20.955)?, positive("verticalAperture", 15.2908)?);
    let focal = positive("focalLength", 50.0)?;
    let (f_number, focus) = (number("fStop", 0.0)?, number("focusDistance", 0.0)?);
    let projection = stage.value(prim, "projection")?;
    let moves = ["focalLength", "focusDistance", "fStop"]
        .iter()
        .try_fold(false, |any, name| Ok::<_, SceneError>(any | stage.is_animated(prim, name)?))?;
    let says_aperture = ["horizontalAperture", "verticalAperture"]
        .iter()
        .try_fold(false, |any, name| Ok::<_, SceneError>(any | stage.value(prim, name)?.is_some()))?;
    let shutter = [number("shutter:open", 0.0)?, number("shutter:close", 0.0)?];
    let exposed = number("exposure", 0.0)? != 0.0;
    // The frame lies so far to the right of the axis and above it (`UsdGeomCamera`, GfCamera's window), in the unit of the apertures.
    let offset = [number("horizontalApertureOffset", 0.0)?, number("verticalApertureOffset", 0.0)?];
    // Many files mean millimetres whatever their unit is.
    let mm = world.unit_m * 100.0;
    let mm = if PLAUSIBLE_MM.contains(&(width * mm)) { mm } else { 1.0 };
    let sight = match projection.as_ref().and_then(Value::text).is_some_and(|p| &**p == "orthographic") {
        true => CameraProjection::Orthographic { height: (height * world.unit_m * 0.1) as f32 },
        false => CameraProjection::Perspective { vertical_fov: (2.0 * (height / (2.0 * focal)).atan()) as f32 },
    };
    // An f-stop of 0 says that everything is sharp.
    let lens = match (f_number > 0.0, focus > 0.0) {
        _ if !matches!(sight, CameraProjection::Perspective { .. }) => None,
        (true, true) => Some([(0.5 * focal * mm * 1e-3 / f_number) as f32, (focus * world.unit_m) as f32]),
        (true, false) => None,
        (false, _) => Some([0.0, 1.0]),
    };
    if moves {
        world.skip_unsupported("changes of focal length, focus and f-stop");
    }
    if shutter[0] != shutter[1] {
        world.skip_unsupported("shutters of cameras: --shutter says how long the exposure is");
    }
    if exposed {
        world.skip_unsupported("exposures of cameras");
    }
    let size = size_of_aspect(width / height).filter(|_| says_aperture);
    let shift = offset.map(|o| o / height);
    let film = FilmHints { size, diagonal_mm: Some((width * mm).hypot(height * mm)), shift, ..FilmHints::default() };
    let node = place.node.map(|_| world.node_at(place, prim.name()));
    world.apertures.push([width / focal, height / focal]);
    world.description.cameras.push(Viewpoint {
        name: prim.name().to_owned(),
        world_from_camera: unscaled(place.world),
        sight,
        lens,
        film,
        node,
    });
    Ok(())
}

/// A place without its scale.
fn unscaled(place: DMat4) -> Affine3A {
    let z = place.z_axis.truncate().try_normalize().unwrap_or(glam::DVec3::Z);
    let y = place.y_axis.truncate();
    let x = y.cross(z).try_normalize().unwrap_or_else(|| z.any_orthonormal_vector());
    let y = z.cross(x);
    affine(DMat4::from_cols(x.extend(0.0), y.extend(0.0), z.extend(0.0), place.w_axis))
}

/// Columns and rows of a RenderSettings prim, and how apertures are made to fit them. `None` where there is none, or it is not 1 to 65535 a side and at most
/// 100 million pixels. Fails where a value is damaged in its file.
pub fn resolution(stage: &Stage, prim: &Prim) -> Result<Option<([usize; 2], Conform)>, SceneError> {
    let size = stage.value(prim, "resolution")?.and_then(|v| v.ints());
    let conform =
        match stage.value(prim, "aspectRatioConformPolicy")?.as_ref().and_then(Value::text).map(|t| t.to_string()).as_deref() {
            Some("cropAperture") => Conform::Crop,
            Some("adjustApertureWidth") => Conform::Width,
            Some("adjustApertureHeight") => Conform::Height,
            Some("adjustPixelAspectRatio") => Conform::Pixels,
            _ => Conform::Expand,
        };
    Ok(size.and_then(|s| match s[..] {
        [w @ 1..=65_535, h @ 1..=65_535] if i64::from(w) * i64::from(h) <= 100_000_000 => {
            Some(([w as usize, h as usize], conform))
        }
        _ => None,
    }))
}

/// Gives all cameras the size of the picture, and apertures of its sides.
pub fn conform(world: &mut World) {
    let Some(([columns, rows], policy)) = world.size else { return };
    let of_picture = columns as f64 / rows as f64;
    let mut has_other_pixels = false;
    for (view, [width, height]) in world.description.cameras.iter_mut().zip(&world.apertures) {
        view.film.size = Some([columns, rows]);
        let is_wider = width / height > of_picture;
        let by_width = match policy {
            Conform::Expand => is_wider,
            Conform::Crop => !is_wider,
            Conform::Width => false,
            Conform::Height => true,
            Conform::Pixels => {
                has_other_pixels |= (width / height / of_picture - 1.0).abs() > 0.01;
                continue;
            }
        };
        let own = if by_width { [*width, width / of_picture] } else { [height * of_picture, *height] };
        match &mut view.sight {
            CameraProjection::Perspective { vertical_fov } => *vertical_fov = (2.0 * (0.5 * own[1]).atan()) as f32,
            CameraProjection::Orthographic { height: seen } => *seen *= (own[1] / height) as f32,
            _ => (),
        }
        view.film.shift = view.film.shift.map(|shift| shift * height / own[1]);
        if let Some(diagonal) = &mut view.film.diagonal_mm {
            *diagonal *= own[0].hypot(own[1]) / width.hypot(*height);
        }
    }
    if has_other_pixels {
        world.skip_unsupported("pixels that are no squares");
    }
}
