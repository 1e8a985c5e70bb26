//! Sun and clear sky by date and place, in absolute units.
//!
//! The sky: Hosek & Wilkie 2012, "An Analytic Model for Full Spectral Sky-Dome Radiance" (its RGB fit). The sun: a disc of 0.53° with the
//! spectral irradiance of Bird & Riordan 1986 ([`beam`]), where [`sun`] says. Both by the same haze. Below the horizon of the map is an
//! endless ground. The light of the sky is polarised ([`RayleighSky`]), which polarised pictures show. With the sun set, the sky keeps its last colours at the brightness that twilight has (Seidelmann 1992): blue hours are not
//! blue. There is no moon.

pub mod beam;
pub mod overcast;
pub mod sun;

use crate::light::environment::direction;
use crate::light::{Environment, Punctual, PunctualKind, RayleighSky};
use crate::scene::Description;
use diopter_image::Raster;
use diopter_light::color::SRGB_LUMINANCE;
use diopter_light::units::LUMINOUS_EFFICACY;
use glam::{Mat3, Vec2, Vec3};
use hw_skymodel::rgb::{Channel, SkyParams, SkyState};
use std::f32::consts::{FRAC_PI_2, TAU};

/// Where the sun is and through what it shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Daylight {
    /// The sun as it is seen.
    pub sun: sun::Place,
    /// Haze: 1 pure air, 2 very clear, 3 clear, 6 hazy, 10 thick.
    pub turbidity: f64,
    /// Albedo of the ground, 0 to 1.
    pub ground: f64,
    /// Turns north, which is −z, about the vertical towards east (+x), rad.
    pub north: f64,
}

/// Half of the angle under which the sun is seen at its mean distance, rad. Source: 696 000 km at 149.6 million km.
const SUN_HALF_ANGLE: f64 = 4.6524e-3;
/// Columns of the map of the sky.
const COLUMNS: usize = 1024;
/// Degree of polarisation of a clear sky at 90° from the sun: near 0.8 on clear days, less in haze, which is not followed here. Source: as of [`RayleighSky`].
const CLEAR_SKY_POLARIZATION: f32 = 0.8;
/// Elevation of the sun, degrees, below which the sky model is no longer followed.
const DUSK_DEG: f64 = 5.0;

impl Daylight {
    /// A clear day (turbidity 3) over a ground of albedo 0.2, north at −z.
    pub fn new(sun: sun::Place) -> Self {
        Daylight { sun, turbidity: 3.0, ground: 0.2, north: 0.0 }
    }

    /// Unit direction towards the sun, in the world.
    pub fn direction(&self) -> Vec3 {
        let (azimuth, elevation) = (self.sun.azimuth + self.north, self.sun.elevation);
        glam::DVec3::new(elevation.cos() * azimuth.sin(), elevation.sin(), -elevation.cos() * azimuth.cos()).as_vec3()
    }

    fn sky(&self) -> SkyState {
        let params = SkyParams {
            elevation: (self.sun.elevation as f32).clamp(0.0, FRAC_PI_2),
            turbidity: (self.turbidity as f32).clamp(1.0, 10.0),
            albedo: [self.ground.clamp(0.0, 1.0) as f32; 3],
        };
        SkyState::new(&params).expect("clamped to what the model allows")
    }

    /// Factor on the sky model: it knows no dusk and is too bright at sunset. From 5° to 0 the level is led over, evenly in stops, to that of
    /// published twilight.
    fn twilight(&self) -> f64 {
        let elevation = self.sun.elevation.to_degrees();
        if elevation >= DUSK_DEG {
            return 1.0;
        }
        let unscaled = self.model_illuminance();
        match elevation >= 0.0 {
            true => (global_illuminance(0.0) / unscaled).powf((DUSK_DEG - elevation) / DUSK_DEG),
            false => global_illuminance(elevation) / unscaled,
        }
    }

    /// Spectral irradiance of the sun on a plane that faces it, if it is up.
    fn beam(&self) -> Option<diopter_light::Spectrum> {
        (self.sun.elevation > -SUN_HALF_ANGLE)
            .then(|| beam::irradiance(self.sun.elevation.max(0.0), self.sun.distance_au, self.turbidity))
    }

    /// Illuminance on the level ground: from the sun, from the sky, lx.
    pub fn illuminance(&self) -> [f64; 2] {
        let sun = self.beam().map_or(0.0, |b| diopter_light::color::luminance(|nm| b.at(nm)));
        [sun * self.sun.elevation.sin().max(0.0), self.sky_illuminance()]
    }

    fn sky_illuminance(&self) -> f64 {
        self.model_illuminance() * self.twilight()
    }

    fn model_illuminance(&self) -> f64 {
        let (sky, sun) = (self.sky(), self.sky_direction());
        let n = 128;
        let mut sum = 0.0;
        for i in 0..n {
            for j in 0..2 * n {
                // Even in cos² θ: each direction counts as the ground sees it.
                let cos = ((i as f32 + 0.5) / n as f32).sqrt();
                let phi = TAU * (j as f32 + 0.5) / (2 * n) as f32;
                let sin = (1.0 - cos * cos).sqrt();
                let direction = Vec3::new(sin * phi.cos(), cos, sin * phi.sin());
                sum += f64::from(radiance(&sky, direction, sun).dot(SRGB_LUMINANCE));
            }
        }
        sum / (2 * n * n) as f64 * std::f64::consts::PI
    }

    /// The sun as the sky model may have it: not below the horizon.
    fn sky_direction(&self) -> Vec3 {
        Daylight { sun: sun::Place { elevation: self.sun.elevation.max(0.0), ..self.sun }, ..*self }.direction()
    }

    /// Puts sky, ground and sun around a scene, instead of the environment it has.
    pub fn add_to_scene(&self, scene: &mut Description) {
        let (sky, sun) = (self.sky(), self.sky_direction());
        let level = self.twilight() as f32;
        let ground = (self.illuminance().iter().sum::<f64>() * self.ground / std::f64::consts::PI) as f32;
        let mut map = Raster::new(COLUMNS, COLUMNS / 2, 3);
        for row in 0..COLUMNS / 2 {
            for column in 0..COLUMNS {
                let d = direction((Vec2::new(column as f32, row as f32) + 0.5) / Vec2::new(COLUMNS as f32, (COLUMNS / 2) as f32));
                let rgb = if d.y > 0.0 { radiance(&sky, d, sun) * level } else { Vec3::splat(ground) };
                map.pixel_mut(column, row).copy_from_slice(&rgb.to_array());
            }
        }
        let polarized = RayleighSky { sun, maximum: CLEAR_SKY_POLARIZATION };
        scene.environment = Some(Environment::new(map, Mat3::IDENTITY, 1.0).with_polarized_sky(polarized));
        if let Some(power) = self.beam() {
            let half_angle = (SUN_HALF_ANGLE / self.sun.distance_au) as f32;
            let kind = PunctualKind::Disc { direction: -self.direction(), half_angle };
            scene.punctual.push(Punctual::new("sun", power, kind));
        }
    }
}

/// Linear sRGB of the sky in a direction, cd/m².
fn radiance(sky: &SkyState, direction: Vec3, sun: Vec3) -> Vec3 {
    let (theta, gamma) = (direction.y.clamp(0.0, 1.0).acos(), direction.angle_between(sun));
    let rgb = Vec3::from_array([Channel::R, Channel::G, Channel::B].map(|c| sky.radiance(theta, gamma, c)));
    rgb.max(Vec3::ZERO) * LUMINOUS_EFFICACY as f32
}

/// Illuminance of the level ground by sun and sky for an elevation of the sun in degrees, lx; from −18° down that of a night without moon.
///
/// Source: P. K. Seidelmann (ed.), Explanatory Supplement to the Astronomical Almanac, 1992, p. 491 (P. M. Janiczek, J. A. DeYoung 1987).
pub fn global_illuminance(elevation_deg: f64) -> f64 {
    const PARTS: [(f64, [f64; 4]); 6] = [
        (20.0, [3.74, 3.97, -4.07, 1.47]),
        (5.0, [3.05, 13.28, -45.98, 64.33]),
        (-0.8, [2.88, 22.26, -207.64, 1034.30]),
        (-5.0, [2.88, 21.81, -258.11, -858.36]),
        (-12.0, [2.70, 12.17, -431.69, -1899.83]),
        (-18.0, [13.84, 262.72, 1447.42, 2797.93]),
    ];
    let h = elevation_deg.clamp(-18.0, 90.0);
    let (_, l) = PARTS.iter().find(|p| h >= p.0).unwrap_or(&PARTS[5]);
    let x = h / 90.0;
    10f64.powf(l[0] + x * (l[1] + x * (l[2] + x * l[3])))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn day(elevation: f64, turbidity: f64) -> Daylight {
        let sun = sun::Place { elevation: elevation.to_radians(), azimuth: 2.0, distance_au: 1.0 };
        Daylight { turbidity, ..Daylight::new(sun) }
    }

    /// IES recommended practice for daylight availability, J. IES 13(4), 1984: clear sky, sun and sky on the level ground, lx.
    fn ies(elevation: f64) -> [f64; 2] {
        let s = elevation.to_radians().sin();
        [127_500.0 * (-0.21 / s).exp() * s, 800.0 + 15_500.0 * s.sqrt()]
    }

    #[test]
    fn a_clear_day_is_as_bright_as_published_from_morning_to_noon() {
        for elevation in [20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 89.0] {
            let [sun, sky] = day(elevation, 3.0).illuminance();
            let [beam, diffuse] = ies(elevation);
            let both = (sun + sky) / (beam + diffuse);
            assert!((both - 1.0).abs() < 0.15, "{elevation}: {sun:.0} + {sky:.0}, published {beam:.0} + {diffuse:.0}");
            // Published skies differ from each other by as much.
            assert!((sky / diffuse - 1.0).abs() < 0.3, "{elevation}: {sky:.0}, published {diffuse:.0}");
            let level = (sun + sky) / global_illuminance(elevation);
            assert!((level - 1.0).abs() < 0.15, "{elevation}: {level}");
        }
    }

    #[test]
    fn published_parts_join_and_dusk_falls() {
        for joint in [20.0, 5.0, -0.8, -5.0, -12.0] {
            let (above, below) = (global_illuminance(joint + 1e-9), global_illuminance(joint - 1e-9));
            assert!((above / below).log10().abs() < 0.006, "{joint}: {above} {below}");
        }
        let levels = [5.0, 0.0, -3.0, -6.0, -12.0, -18.0, -40.0].map(|h| day(h, 3.0).illuminance().iter().sum::<f64>());
        assert!(levels.windows(2).all(|w| w[1] <= w[0] * 1.0001), "{levels:?}");
        assert!((levels[3] / 3.41 - 1.0).abs() < 0.02 && (levels[1] / 759.0 - 1.0).abs() < 0.1 && levels[5] < 2e-3, "{levels:?}");
    }

    #[test]
    fn the_scene_gets_what_is_claimed() {
        let day = day(40.0, 3.0);
        let mut scene = Description::default();
        day.add_to_scene(&mut scene);
        let environment = scene.environment.unwrap();
        // Mean over the directions, below the horizon that of the ground.
        let [sun, sky] = day.illuminance();
        let n = 200;
        let upper: f64 = (0..n)
            .flat_map(|i| (0..2 * n).map(move |j| (i, j)))
            .map(|(i, j)| {
                let (cos, phi) = (((i as f32 + 0.5) / n as f32).sqrt(), TAU * (j as f32 + 0.5) / (2 * n) as f32);
                let sin = (1.0 - cos * cos).sqrt();
                f64::from(environment.rgb(Vec3::new(sin * phi.cos(), cos, sin * phi.sin())).dot(SRGB_LUMINANCE))
            })
            .sum::<f64>()
            / (2 * n * n) as f64;
        assert!((upper * std::f64::consts::PI / sky - 1.0).abs() < 0.01, "{upper} {sky}");
        let below = environment.rgb(Vec3::new(0.3, -0.5, 0.1)).y as f64;
        assert!((below - 0.2 * (sun + sky) / std::f64::consts::PI).abs() < 0.01 * below);
        // Blue above, away from the sun.
        let away = environment.rgb(Vec3::new(-day.direction().x, 0.8, -day.direction().z).normalize());
        assert!(away.z > 1.3 * away.x, "{away}");
        // Azimuth 2 rad is past east, towards south: +x, +z.
        assert!(day.direction().x > 0.0 && day.direction().z > 0.0);
    }
}
