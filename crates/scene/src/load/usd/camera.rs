//! Cameras. Source: OpenUSD, `UsdGeomCamera`: focal length and apertures in tenths of a scene unit, looking along −z.

use super::layer::Value;
use super::stage::{Prim, Stage};
use super::world::{Place, World, affine};
use crate::SceneError;
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
    let shutter = [number("shutter:open", 0.0)?, number("shutter:close", 0.0)?];
    let exposed = number("exposure", 0.0)? != 0.0;
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
    let film = FilmHints { diagonal_mm: Some((width * mm).hypot(height * mm)), ..FilmHints::default() };
    let node = place.node.map(|_| world.node_at(place, prim.name()));
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

/// Columns and rows of a RenderSettings prim. `None` where there is none, or it is not 1 to 65535 a side and at most 100 million pixels. Fails where the value is damaged
/// in its file.
pub fn resolution(stage: &Stage, prim: &Prim) -> Result<Option<[usize; 2]>, SceneError> {
    let size = stage.value(prim, "resolution")?.and_then(|v| v.ints());
    Ok(size.and_then(|s| match s[..] {
        [w @ 1..=65_535, h @ 1..=65_535] if i64::from(w) * i64::from(h) <= 100_000_000 => Some([w as usize, h as usize]),
        _ => None,
    }))
}
