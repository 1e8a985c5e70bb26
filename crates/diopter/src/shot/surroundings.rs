//! What is around a scene: a picture of surroundings, sun and sky, fog.

use super::file::{DaylightSection, FogSection, SceneSection};
use super::{ShotError, read_environment, value};
use crate::quantity::Moment;
use diopter_scene::bvh::Bounds;
use diopter_scene::daylight::{Daylight, sun};
use diopter_scene::light::Environment;
use diopter_scene::medium::{Air, Medium};
use diopter_scene::{Description, Scene};
use glam::Vec3;

/// Luminance of the sky that a scene without any light gets, cd/m².
const PLAIN_SKY: f32 = 2000.0;

/// Puts surroundings around a scene. `flash`: whether the camera brings light.
pub(super) fn put(
    scene: &mut Description,
    section: &SceneSection,
    flash: bool,
    warn: &mut dyn FnMut(&str),
) -> Result<(), ShotError> {
    if let Some(path) = &section.environment {
        if section.daylight.is_some() {
            return Err(value("daylight", "an environment and daylight", "one of the two"));
        }
        let (rotation, scale) = (section.environment_rotation_deg.unwrap_or(0.0), section.environment_scale.unwrap_or(1.0));
        if !(scale >= 0.0 && scale.is_finite() && rotation.is_finite()) {
            return Err(value(
                "environment_scale or environment_rotation_deg",
                format!("{scale}, {rotation}"),
                "finite numbers, the scale not negative",
            ));
        }
        scene.environment = Some(read_environment(path, rotation, scale)?);
    }
    if let Some(daylight_section) = &section.daylight {
        // The endless ground is that under the scene, if nothing else is said.
        let ground = daylight_section.ground.or(section.ground.map(f64::from));
        let day = daylight(&DaylightSection { ground, ..daylight_section.clone() })?;
        let elevation = day.sun.elevation.to_degrees();
        if elevation < 0.0 {
            warn(&format!(
                "the sun is {:.1}° below the horizon: the sky is as bright as twilight is, but has the colours of sunset",
                -elevation
            ));
        }
        let before = scene.punctual.len();
        scene.punctual.retain(|l| !l.is_infinite());
        if scene.environment.is_some() || scene.punctual.len() < before {
            warn("daylight takes the place of the scene's own environment and suns");
        }
        day.put_into(scene);
    }
    let dark = scene.environment.is_none()
        && scene.punctual.is_empty()
        && !scene.materials.iter().any(|m| m.emission.is_some())
        && !flash;
    if dark {
        warn(
            "the scene has no light: an even white sky of 2000 cd/m² is put around it (for another give --environment, --sun 40,135 or --daylight)",
        );
        scene.environment = Some(Environment::uniform(Vec3::splat(PLAIN_SKY)));
    }
    Ok(())
}

/// Sun and sky as a shot asks for them.
pub fn daylight(section: &DaylightSection) -> Result<Daylight, ShotError> {
    let within = |what, v: Option<f64>, default: f64, range: std::ops::RangeInclusive<f64>| {
        let v = v.unwrap_or(default);
        let expected = format!("{} to {}", range.start(), range.end());
        if range.contains(&v) { Ok(v) } else { Err(value(what, v, expected)) }
    };
    let sun = match (section.sun, section.time, section.place) {
        (Some([elevation, azimuth]), None, None) => {
            let elevation = within("sun (elevation)", Some(elevation), 0.0, -90.0..=90.0)?;
            let azimuth = within("sun (azimuth)", Some(azimuth), 0.0, -360.0..=360.0)?;
            sun::Place { elevation: elevation.to_radians(), azimuth: azimuth.to_radians(), distance_au: 1.0 }
        }
        (None, Some(Moment(days)), Some([latitude, longitude])) => {
            let latitude = within("place (latitude)", Some(latitude), 0.0, -90.0..=90.0)?;
            let longitude = within("place (longitude)", Some(longitude), 0.0, -360.0..=360.0)?;
            sun::place(days, latitude.to_radians(), longitude.to_radians())
        }
        (None, None, None) => return Err(value("daylight", "neither sun nor time", "sun, or time and place")),
        (None, Some(_), None) => {
            return Err(value("daylight", "a time without place", "the place too: latitude and longitude, such as 48.2,16.4"));
        }
        (None, None, Some(_)) => {
            return Err(value("daylight", "a place without time", "the time too, such as 2026-06-21T12:00+02:00"));
        }
        (Some(_), ..) => return Err(value("daylight", "sun beside time or place", "sun, or time and place")),
    };
    Ok(Daylight {
        turbidity: within("turbidity", section.turbidity, 3.0, 1.0..=10.0)?,
        ground: within("ground (of daylight)", section.ground, 0.2, 0.0..=1.0)?,
        north: within("north_deg", section.north_deg, 0.0, -360.0..=360.0)?.to_radians(),
        ..Daylight::new(sun)
    })
}

/// Fills the air around a scene.
///
/// Without a box, fog ends as far around the scene and the camera as one can see in it where light comes from infinity (else none would arrive), and
/// nowhere where not.
pub(super) fn put_fog(scene: &mut Scene, section: &FogSection, camera: Vec3) -> Result<(), ShotError> {
    let visibility = section.visibility.map_or(100.0, |v| v.0);
    if !(1e-3..=1e7).contains(&visibility) {
        return Err(value("visibility", visibility, "0.001 to 10 000 000 m"));
    }
    let albedo = section.albedo.unwrap_or(1.0);
    let asymmetry = section.asymmetry.unwrap_or(0.85);
    if !((0.0..=1.0).contains(&albedo) && (-0.999..=0.999).contains(&asymmetry)) {
        return Err(value(
            "fog",
            format!("albedo {albedo}, asymmetry {asymmetry}"),
            "an albedo from 0 to 1, an asymmetry above -1 and below 1",
        ));
    }
    let bounds = match section.within {
        Some([a, b]) => {
            let (min, max) = (Vec3::from_array(a).min(Vec3::from_array(b)), Vec3::from_array(a).max(Vec3::from_array(b)));
            if !(min.is_finite() && max.is_finite() && (max - min).min_element() > 0.0) {
                return Err(value("within", format!("{a:?} to {b:?}"), "two corners of a box, m"));
            }
            Some(Bounds { min, max })
        }
        None => {
            let lights = scene.lights();
            let far = lights.environment.is_some() || lights.punctual.iter().any(|l| l.is_infinite());
            let seen = scene.bounds().union(Bounds { min: camera, max: camera });
            far.then_some(Bounds { min: seen.min - visibility as f32, max: seen.max + visibility as f32 })
        }
    };
    scene.fill_air(Some(Air { medium: Medium::fog(visibility as f32, albedo, asymmetry), bounds }));
    Ok(())
}
