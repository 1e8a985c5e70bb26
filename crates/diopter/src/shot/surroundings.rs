//! What is around a scene: a studio, a picture of surroundings, sun and sky, fog.

use super::scene_setup::CameraPlacement;
use super::sections::{DaylightSection, FogSection, SceneSection};
use super::sources::is_light_file;
use super::{ShotError, read_environment, value};
use crate::quantity::Moment;
use diopter_scene::bvh::Bounds;
use diopter_scene::daylight::{Daylight, overcast, sun};
use diopter_scene::light::Environment;
use diopter_scene::material::{Emission, EmissionColor, Material};
use diopter_scene::medium::{Air, Medium};
use diopter_scene::studio::{self, Studio};
use diopter_scene::{Description, Scene};
use diopter_sensor::nearest;
use glam::{Vec2, Vec3};
use std::path::Path;

/// Luminance of the sky around a scene without any light that the camera stands in, cd/m².
const PLAIN_SKY: f32 = 2000.0;
/// Mean illuminance of a `light` that is a picture without a scale, over all ways a surface can face, lx: that of a bright overcast day, as of
/// [`overcast::ILLUMINANCE_LX`]. Pictures of light for rendering rarely say their unit; most have 1 for something white in them.
const PICTURE_LX: f32 = 10_000.0;
/// Elevation of the sun of `light = "sun"`, and how far it stands to the left of the camera, degrees: form and shadows as photographers like them.
const SUN_DEG: [f64; 2] = [40.0, 50.0];
/// Albedo of the ground under sun and sky by default, that of dry soil and grass.
const GROUND: f32 = 0.2;

/// Light that a shot asks for by `light`.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Light<'a> {
    Studio,
    Sun,
    Overcast,
    Own,
    File(&'a Path),
}

impl Light<'_> {
    const NAMES: [(&'static str, Light<'static>); 4] =
        [("studio", Light::Studio), ("sun", Light::Sun), ("overcast", Light::Overcast), ("none", Light::Own)];

    fn parse(text: &str) -> Result<Light<'_>, ShotError> {
        let named = Self::NAMES.iter().find(|n| n.0 == text.trim().to_lowercase()).map(|n| n.1);
        match named {
            Some(light) => Ok(light),
            None if is_light_file(text) => Ok(Light::File(Path::new(text))),
            None => {
                let expected = match nearest(text, Self::NAMES.iter().map(|n| n.0)) {
                    Some(near) => format!("a light (did you mean \"{near}\"?)"),
                    None => "studio, sun, overcast, none, or a .hdr, .exr or .pfm file".to_owned(),
                };
                Err(value("light", format!("\"{text}\""), expected))
            }
        }
    }
}

/// Checks what lights the scene before any file is read: names, and what contradicts or needs something beside it.
pub(super) fn check(section: &SceneSection) -> Result<(), ShotError> {
    let light = section.light.as_deref().map(Light::parse).transpose()?;
    if section.environment.is_none() && !matches!(light, Some(Light::File(_))) {
        let turned = section.environment_rotation_deg.map(|v| ("environment_rotation", format!("{v}°")));
        let scaled = section.environment_scale.map(|v| ("environment_scale", v.to_string()));
        if let Some((what, found)) = turned.or(scaled) {
            return Err(value(what, found, "a picture beside it that lights the scene: environment = FILE or light = FILE"));
        }
    }
    let (Some(text), Some(light)) = (section.light.as_deref(), light) else { return Ok(()) };
    if section.environment.is_some() {
        return Err(value("light", format!("\"{text}\" beside an environment"), "one of the two"));
    }
    let placed = |day: &DaylightSection| day.sun.is_some() || day.time.is_some() || day.place.is_some();
    match &section.daylight {
        Some(_) if light != Light::Sun => {
            Err(value("light", format!("\"{text}\" beside daylight"), "one of the two, or light = \"sun\""))
        }
        Some(day) if placed(day) => {
            Err(value("light", format!("\"{text}\" beside a sun, or a time and a place"), "one of the two"))
        }
        _ => Ok(()),
    }
}

/// Whether what [`put`] puts around a scene may depend on where the camera stands.
pub(super) fn follow_camera(scene: &Description, section: &SceneSection, flash: bool) -> bool {
    match section.light.as_deref().map(Light::parse) {
        Some(Ok(Light::Own | Light::File(_))) => false,
        Some(_) => true,
        // Without light of its own a scene gets a studio.
        None => scene.environment.is_none() && !has_lamps(scene) && !flash,
    }
}

/// Puts surroundings around a scene, and answers with the albedo of the floor that belongs under it, if one does. `flash`: whether the camera brings
/// light; `stand`: where it is.
pub(super) fn add(
    scene: &mut Description,
    section: &SceneSection,
    flash: bool,
    placement: &CameraPlacement,
    warn: &mut dyn FnMut(&str),
) -> Result<Option<f32>, ShotError> {
    check(section)?;
    let asked = section.light.as_deref().map(Light::parse).transpose()?;
    let picture = match asked {
        Some(Light::File(path)) => Some(path),
        _ => section.environment.as_deref(),
    };
    if let Some(path) = picture {
        if section.daylight.is_some() {
            return Err(value("daylight", "an environment and daylight", "one of the two"));
        }
        let (what, relative) = match asked {
            Some(Light::File(_)) => ("light", section.environment_scale.is_none()),
            _ => ("environment", false),
        };
        let (rotation, scale) = (section.environment_rotation_deg.unwrap_or(0.0), section.environment_scale.unwrap_or(1.0));
        if !(scale >= 0.0 && scale.is_finite() && rotation.is_finite()) {
            return Err(value(
                "environment_scale or environment_rotation_deg",
                format!("{scale}, {rotation}"),
                "finite numbers, the scale not negative",
            ));
        }
        let own = has_lamps(scene) || flash;
        let mut environment = read_environment(path, rotation, scale)?;
        let place = path.display();
        if environment.invalid_pixels() > 0 {
            let (invalid, all) = (environment.invalid_pixels(), environment.pixels());
            warn(&format!("{place}: {invalid} of {all} pixels are negative or not finite in a colour: 0 is taken there"));
        }
        if scale > 0.0 && environment.mean_luminance() == 0.0 {
            if !own {
                return Err(value(
                    what,
                    format!("{place}, black everywhere,"),
                    "a picture with light in it: the scene has no other",
                ));
            }
            warn(&format!("{place}: it is black everywhere and lights nothing"));
        } else if relative {
            // A surface sees π times the mean luminance of the half before it; over all ways it can face, of the whole.
            let factor = PICTURE_LX / (std::f32::consts::PI * environment.mean_luminance());
            if factor.is_finite() && factor > 0.0 {
                environment.scale_light(factor);
            }
            if section.ambient_ev.is_none() {
                warn(&format!(
                    "{place}: its values are relative, and scaled by {factor:.3e} to light the scene with {PICTURE_LX} lx on average, as an \
                     overcast day does (--environment FILE takes them for cd/m²; --ambient-ev EV, or environment_scale in a shot file, says how bright \
                     it is)"
                ));
            }
        }
        scene.environment = Some(environment);
    }
    let day = match asked {
        Some(Light::Sun) => {
            Some(DaylightSection { sun: Some(sun_for(placement)), ..section.daylight.clone().unwrap_or_default() })
        }
        _ => section.daylight.clone(),
    };
    if let Some(daylight_section) = day {
        // The endless ground is that under the scene, if nothing else is said.
        let ground = daylight_section.ground.or(section.ground.map(f64::from));
        let day = daylight(&DaylightSection { ground, ..daylight_section })?;
        let elevation = day.sun.elevation.to_degrees();
        if elevation < 0.0 {
            warn(&format!(
                "the sun is {:.1}° below the horizon: the sky is as bright as twilight is, but has the colours of sunset",
                -elevation
            ));
        }
        remove_sky(scene, "daylight", warn);
        day.add_to_scene(scene);
    }
    // A floor nobody asked for is not put where it would hide what stands above it from a camera below.
    let stands = !placement.bounds.is_empty() && placement.place.translation.y > placement.bounds.min.y;
    let ground = section.ground.or(stands.then_some(GROUND));
    let dark = scene.environment.is_none() && !has_lamps(scene) && !flash;
    match asked {
        Some(Light::Sun) => return Ok(ground),
        Some(Light::Overcast) => {
            remove_sky(scene, "the overcast sky", warn);
            scene.environment = Some(overcast::sky(overcast::ILLUMINANCE_LX, ground.unwrap_or(GROUND)));
            return Ok(ground);
        }
        Some(Light::Studio) => {
            if placement.bounds.is_empty() {
                return Err(value("light", "\"studio\" of a scene without a surface", "something that it can light"));
            }
            if placement.is_within() {
                warn("the camera is inside the scene, the studio lamps are outside: walls will block them");
            }
            remove_sky(scene, "the studio", warn);
            add_studio(scene, section, placement)?;
            return Ok(None);
        }
        Some(Light::Own) if dark => warn("the scene has no light of its own, and none was put there: the picture will be black"),
        None if dark && placement.bounds.is_empty() => {}
        None if dark && placement.is_within() => {
            warn(
                "the scene has no light, and the camera stands within it: an even white sky of 2000 cd/m² is put around it (for another give \
                 --light, --environment, --sun 40,135 or --daylight)",
            );
            scene.environment = Some(Environment::uniform(Vec3::splat(PLAIN_SKY)));
        }
        None if dark => {
            warn("the scene has no light of its own: a studio lights it (--light sun, overcast, FILE.hdr or none for another)");
            add_studio(scene, section, placement)?;
            return Ok(None);
        }
        _ => {}
    }
    Ok(section.ground)
}

/// Whether anything in a scene shines, beside its environment.
fn has_lamps(scene: &Description) -> bool {
    let lights = |emission: &Emission| scene.declares_lamps || lights_scene(emission);
    let shines = |material: &Material| material.emission.as_ref().is_some_and(lights) || material.holds_light();
    !scene.punctual.is_empty() || scene.materials.iter().any(shines)
}

/// Places along each side of a picture at which it is looked at, and the part of its brightest that it has on average where it lights a scene.
const PLACES: u32 = 64;
const LIT_PART: f32 = 0.1;

/// Whether a surface that shines may be what lights a scene: not by a picture that is black but for some spots (displays, windows of a ship).
fn lights_scene(emission: &Emission) -> bool {
    if !matches!(emission.radiance, EmissionColor::Textured { .. }) {
        return true;
    }
    let place = |k: u32| (k as f32 + 0.5) / PLACES as f32;
    let luminance = |i: u32| emission.luminance(&[Vec2::new(place(i % PLACES), place(i / PLACES)); 2]);
    let (sum, most) = (0..PLACES * PLACES).map(luminance).fold((0.0, 0.0f32), |(sum, most), l| (sum + l, most.max(l)));
    sum > LIT_PART * most * (PLACES * PLACES) as f32
}

/// Takes away what shines from infinity.
fn remove_sky(scene: &mut Description, what: &str, warn: &mut dyn FnMut(&str)) {
    let before = scene.punctual.len();
    scene.punctual.retain(|l| !l.is_infinite());
    if scene.environment.take().is_some() || scene.punctual.len() < before {
        warn(&format!("{what} takes the place of the scene's own environment and suns"));
    }
}

/// Puts a studio around a scene; its sweep has the albedo of the ground that is asked for.
fn add_studio(scene: &mut Description, section: &SceneSection, placement: &CameraPlacement) -> Result<(), ShotError> {
    let albedo = section.ground.unwrap_or(studio::ALBEDO);
    if !(0.0..=1.0).contains(&albedo) {
        return Err(value("ground", albedo, "an albedo from 0 to 1"));
    }
    studio(placement, albedo).add_to_scene(scene);
    Ok(())
}

fn studio(placement: &CameraPlacement, albedo: f32) -> Studio {
    let tan_half = [0, 1].map(|k| placement.tan_half[k] + placement.tan_middle[k].abs());
    let view = studio::View { world_from_camera: placement.place, tan_half };
    Studio { subject: placement.bounds, view, albedo }
}

/// Elevation and azimuth of a sun to the left behind the camera, degrees.
fn sun_for(placement: &CameraPlacement) -> [f64; 2] {
    let to = match placement.bounds.is_empty() {
        true => Vec3::from(placement.place.matrix3.z_axis),
        false => studio(placement, 0.0).facing(),
    };
    // From north, -z, towards east, +x: clockwise seen from above, as from the camera to its left.
    let azimuth = f64::from(to.x).atan2(f64::from(-to.z)).to_degrees() + SUN_DEG[1];
    [SUN_DEG[0], (azimuth + 180.0).rem_euclid(360.0) - 180.0]
}

/// Sun and sky as a shot asks for them. Fails unless the sun is given, or time and place, and on numbers out of range.
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
pub(super) fn add_fog(scene: &mut Scene, section: &FogSection, camera: Vec3) -> Result<(), ShotError> {
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

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_scene::light::modulation::Modulation;
    use diopter_scene::material::Scattering;
    use diopter_scene::texture::{Image, Texture};
    use std::sync::Arc;

    /// A scene of which a surface shines by a picture of 64 × 64 pixels, of which the first `lit` are white.
    fn shining(lit: usize) -> Description {
        let pixels = (0..64 * 64).map(|i| if i < lit { [255; 4] } else { [0, 0, 0, 255] }).collect();
        let texture = Texture::color(Arc::new(Image::new(64, 64, pixels)));
        let radiance = EmissionColor::Textured { factor: Vec3::splat(100.0), texture };
        let emission = Emission { radiance, two_sided: true, is_light: true, modulation: Modulation::Steady };
        let material = Material { emission: Some(emission), ..Material::new("display", Scattering::Black) };
        Description { materials: vec![material], ..Default::default() }
    }

    #[test]
    fn a_display_with_some_bright_spots_is_no_lamp() {
        assert!(!has_lamps(&shining(0)) && !has_lamps(&shining(64 * 4)));
        assert!(has_lamps(&shining(64 * 32)) && has_lamps(&shining(64 * 64)));
        // Unless the file says that it is one, as pbrt's, Mitsuba's and USD's do.
        assert!(has_lamps(&Description { declares_lamps: true, ..shining(64 * 4) }));
        let lamp = Material::lamp("lamp", diopter_light::Spectrum::Constant(1e-6));
        assert!(has_lamps(&Description { materials: vec![lamp], ..Default::default() }));
    }
}
