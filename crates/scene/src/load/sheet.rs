//! Small scenes written by hand (`.scene`): quads, spheres, boxes, lamps and materials in TOML, in metres, y up.
//!
//! ```toml
//! [camera]
//! look_from = [0, 1, 3.4]
//! look_at = [0, 1, 0]
//! fov = 39                                               # from top to bottom, degrees
//!
//! [material]
//! white = { color = 0.75 }
//! red = { color = [0.63, 0.06, 0.05], roughness = 0.3 }  # linear sRGB; with a roughness under a clear coat of index 1.5
//! gold = { metal = "gold", roughness = 0.1 }
//! glass = { glass = 1.52 }                               # a clear body of this index
//! lamp = { light = 3000, temperature = 2856 }            # cd/m², K
//!
//! [[quad]]
//! material = "white"
//! corner = [-1, 0, -1]
//! edges = [[0, 0, 2], [2, 0, 0]]
//!
//! [[sphere]]
//! material = "glass"
//! center = [0.4, 0.3, 0.3]
//! radius = 0.3
//!
//! [[box]]
//! material = "gold"
//! center = [-0.4, 0.5, -0.3]
//! size = [0.5, 1, 0.5]
//! turn = 20                                              # about the upright, degrees, anticlockwise from above
//!
//! [[point]]                                              # a lamp without extent
//! position = [0, 1.9, 0]
//! lumens = 800
//!
//! [sky]
//! luminance = 500                                        # cd/m², the same from everywhere
//! ```

use super::finished;
use crate::SceneError;
use crate::builtin::builder::{Builder, block};
use crate::light::Environment;
use crate::light::punctual::{Punctual, PunctualKind};
use crate::material::{Conductor, Emission, Material, Scattering};
use crate::scene::{CameraProjection, Description, FilmHints, Viewpoint};
use crate::texture::Color;
use diopter_light::Spectrum;
use diopter_light::spectrum::blackbody_with_luminance;
use diopter_light::units::shown;
use glam::{Affine3A, Mat3, Mat3A, Quat, Vec3};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::f32::consts::PI;

/// K
const DAYLIGHT: f32 = 6500.0;
/// K, of points that do not say theirs: an incandescent lamp.
const INCANDESCENT: f32 = 2856.0;
const TEMPERATURES: std::ops::RangeInclusive<f32> = 500.0..=40_000.0;
/// Largest number of a file.
const MOST: f32 = 1e9;
/// Most light, cd/m² or lm: the sun has 1.6e9 cd/m², flashes and arcs more.
const MOST_LIGHT: f32 = 1e13;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sheet {
    camera: Option<Camera>,
    #[serde(default)]
    material: BTreeMap<String, Look>,
    #[serde(default)]
    quad: Vec<QuadItem>,
    #[serde(default)]
    sphere: Vec<SphereItem>,
    #[serde(default, rename = "box")]
    boxes: Vec<BoxItem>,
    #[serde(default)]
    point: Vec<PointItem>,
    sky: Option<Sky>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Camera {
    look_from: [f32; 3],
    look_at: [f32; 3],
    up: Option<[f32; 3]>,
    fov: Option<f32>,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(untagged)]
enum Reflectance {
    Grey(f32),
    Rgb([f32; 3]),
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Look {
    color: Option<Reflectance>,
    metal: Option<String>,
    glass: Option<f32>,
    roughness: Option<f32>,
    light: Option<f32>,
    temperature: Option<f32>,
    two_sided: Option<bool>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct QuadItem {
    name: Option<String>,
    material: String,
    corner: [f32; 3],
    edges: [[f32; 3]; 2],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SphereItem {
    name: Option<String>,
    material: String,
    center: [f32; 3],
    radius: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BoxItem {
    name: Option<String>,
    material: String,
    center: [f32; 3],
    size: [f32; 3],
    turn: Option<f32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PointItem {
    name: Option<String>,
    position: [f32; 3],
    lumens: f32,
    temperature: Option<f32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sky {
    luminance: f32,
    temperature: Option<f32>,
}

/// Says where in the file something is wrong.
struct Place<'a>(&'a str);

impl Place<'_> {
    fn wrong(&self, what: &str, found: impl std::fmt::Display, expected: &str) -> SceneError {
        SceneError::File {
            place: format!("{}: {what}", self.0),
            found: found.to_string(),
            expected: format!("expected {expected}"),
        }
    }

    fn vector(&self, what: &str, v: [f32; 3]) -> Result<Vec3, SceneError> {
        match v.iter().all(|c| c.abs() <= MOST) {
            true => Ok(Vec3::from_array(v)),
            false => Err(self.wrong(what, format!("{v:?}"), "three numbers, in metres")),
        }
    }

    fn number(&self, what: &str, v: f32, range: std::ops::RangeInclusive<f32>, expected: &str) -> Result<f32, SceneError> {
        if range.contains(&v) { Ok(v) } else { Err(self.wrong(what, shown(v.into()), expected)) }
    }

    /// A black body of a luminance (cd/m²), or intensity (cd).
    fn light(&self, what: &str, amount: f32, kelvin: f32) -> Result<Spectrum, SceneError> {
        self.number(what, amount, 0.0..=MOST_LIGHT, "an amount of light from 0 to 1e13")?;
        self.number(&format!("{what}, temperature"), kelvin, TEMPERATURES, "a colour temperature from 500 to 40000 K")?;
        Ok(blackbody_with_luminance(kelvin, amount))
    }

    /// Puts a material into a scene: its number.
    fn material(&self, b: &mut Builder, name: &str, look: &Look) -> Result<u32, SceneError> {
        let what = format!("material \"{name}\"");
        let kinds = [look.color.is_some(), look.metal.is_some(), look.glass.is_some()];
        if kinds.iter().filter(|k| **k).count() > 1 {
            return Err(self.wrong(
                &what,
                "more than one of color, metal and glass",
                "one of them (light may stand beside each)",
            ));
        }
        if kinds == [false; 3] && look.light.is_none() {
            return Err(self.wrong(&what, "nothing that it is made of", "color, metal, glass or light"));
        }
        let roughness = match look.roughness {
            Some(r) => Some(self.number(&format!("{what}, roughness"), r, 0.0..=1.0, "a roughness from 0 to 1")?),
            None => None,
        };
        let number = match (&look.color, &look.metal, look.glass) {
            (Some(color), ..) => {
                let rgb = match *color {
                    Reflectance::Grey(grey) => [grey; 3],
                    Reflectance::Rgb(rgb) => rgb,
                };
                for c in rgb {
                    self.number(&format!("{what}, color"), c, 0.0..=1.0, "reflectances from 0 to 1 (linear sRGB)")?;
                }
                match roughness {
                    Some(roughness) => b.glossy(name, Color::rgb(rgb[0], rgb[1], rgb[2]), roughness, 0.0),
                    None => b.matte(name, rgb),
                }
            }
            (_, Some(metal), _) => {
                let alpha = roughness.unwrap_or(0.0).powi(2);
                let conductor = Conductor::metal(metal, alpha).ok_or_else(|| {
                    self.wrong(&format!("{what}, metal"), format!("\"{metal}\""), &Conductor::METALS.join(", "))
                })?;
                b.material(Material::new(name, Scattering::Conductor(conductor)))
            }
            (_, _, Some(index)) => {
                if roughness.is_some() {
                    return Err(self.wrong(
                        &what,
                        "glass with a roughness",
                        "smooth glass; rough glass is read from glTF and pbrt",
                    ));
                }
                let index = self.number(&format!("{what}, glass"), index, 1.0..=4.0, "an index of refraction from 1 to 4")?;
                b.material(Material::glass(name, index, None))
            }
            _ if roughness.is_some() => return Err(self.wrong(&what, "roughness without color or metal", "one of them")),
            _ => b.material(Material::new(name, Scattering::Black)),
        };
        match look.light {
            Some(light) => {
                let radiance = self.light(&format!("{what}, light"), light, look.temperature.unwrap_or(INCANDESCENT))?;
                let emission = Emission::one_sided(radiance);
                b.0.materials[number as usize].emission =
                    Some(Emission { two_sided: look.two_sided.unwrap_or(false), ..emission });
            }
            None if look.temperature.is_some() || look.two_sided.is_some() => {
                return Err(self.wrong(&what, "temperature or two_sided without light", "light = cd/m²"));
            }
            None => {}
        }
        Ok(number)
    }
}

/// Reads a scene sheet. `name` is for messages. Fails with the line of what is no TOML or no key of a sheet, and with the table and key of a number out of range or a
/// material that is not there, and without any surface.
pub fn load(bytes: &[u8], name: &str) -> Result<Description, SceneError> {
    let place = Place(name);
    let text = std::str::from_utf8(bytes)
        .map_err(|e| place.wrong("text", format!("no UTF-8 at byte {}", e.valid_up_to()), "a TOML file"))?;
    let sheet: Sheet = toml::from_str(text).map_err(|e| {
        let line = e.span().map_or(1, |s| text[..s.start.min(text.len())].lines().count().max(1));
        place.wrong(
            &format!("line {line}"),
            e.message(),
            "a scene sheet: [camera], [material], [[quad]], [[sphere]], [[box]], [[point]], [sky]",
        )
    })?;
    let mut b = Builder(Description { name: name.into(), ..Default::default() });
    let mut numbers = BTreeMap::new();
    for (material, look) in &sheet.material {
        let number = place.material(&mut b, material, look)?;
        numbers.insert(material.as_str(), number);
    }
    let made_of = |what: &str, material: &str| {
        numbers.get(material).copied().ok_or_else(|| {
            let known: Vec<&str> = numbers.keys().copied().collect();
            let expected = if known.is_empty() {
                "a [material] table that has it".to_owned()
            } else {
                format!("one of {}", known.join(", "))
            };
            place.wrong(&format!("{what}, material"), format!("\"{material}\""), &expected)
        })
    };
    for (k, quad) in sheet.quad.iter().enumerate() {
        let what = format!("quad {}", k + 1);
        let material = made_of(&what, &quad.material)?;
        let corner = place.vector(&format!("{what}, corner"), quad.corner)?;
        let edges =
            [place.vector(&format!("{what}, edges"), quad.edges[0])?, place.vector(&format!("{what}, edges"), quad.edges[1])?];
        if edges[0].cross(edges[1]).length() <= 1e-6 * edges[0].length() * edges[1].length() {
            return Err(place.wrong(&format!("{what}, edges"), format!("{:?}", quad.edges), "two edges that span an area"));
        }
        b.quad(quad.name.as_deref().unwrap_or(&quad.material), corner, edges, material);
    }
    for (k, sphere) in sheet.sphere.iter().enumerate() {
        let what = format!("sphere {}", k + 1);
        let material = made_of(&what, &sphere.material)?;
        let center = place.vector(&format!("{what}, center"), sphere.center)?;
        let radius = place.number(&format!("{what}, radius"), sphere.radius, 1e-9..=MOST, "a radius from 1e-9 to 1e9 m")?;
        b.sphere(sphere.name.as_deref().unwrap_or(&sphere.material), center, radius, material);
    }
    for (k, block_of) in sheet.boxes.iter().enumerate() {
        let what = format!("box {}", k + 1);
        let material = made_of(&what, &block_of.material)?;
        let center = place.vector(&format!("{what}, center"), block_of.center)?;
        let size = place.vector(&format!("{what}, size"), block_of.size)?;
        if !(size.min_element() > 0.0) {
            return Err(place.wrong(&format!("{what}, size"), format!("{:?}", block_of.size), "three lengths above 0, m"));
        }
        let turn = place.number(&format!("{what}, turn"), block_of.turn.unwrap_or(0.0), -1e6..=1e6, "an angle in degrees")?;
        let mesh = b.mesh(block(-0.5 * size, 0.5 * size));
        let name = block_of.name.as_deref().unwrap_or(&block_of.material);
        b.place(name, mesh, material, center, Quat::from_rotation_y(turn.to_radians()));
    }
    for (k, point) in sheet.point.iter().enumerate() {
        let what = format!("point {}", k + 1);
        let position = place.vector(&format!("{what}, position"), point.position)?;
        let intensity =
            place.light(&format!("{what}, lumens"), point.lumens / (4.0 * PI), point.temperature.unwrap_or(INCANDESCENT))?;
        let name = point.name.clone().unwrap_or_else(|| what.clone());
        b.0.punctual.push(Punctual::new(&name, intensity, PunctualKind::Point { position }));
    }
    if let Some(sky) = &sheet.sky {
        let light = place.light("sky, luminance", sky.luminance, sky.temperature.unwrap_or(DAYLIGHT))?;
        b.0.environment = Some(Environment::even(light));
    }
    if let Some(camera) = &sheet.camera {
        b.0.cameras.push(viewpoint(&place, camera)?);
    }
    finished(b.0, name, "a [[quad]], [[sphere]] or [[box]]")
}

fn viewpoint(place: &Place, camera: &Camera) -> Result<Viewpoint, SceneError> {
    let from = place.vector("camera, look_from", camera.look_from)?;
    let at = place.vector("camera, look_at", camera.look_at)?;
    let up = place.vector("camera, up", camera.up.unwrap_or([0.0, 1.0, 0.0]))?;
    let back = (from - at)
        .try_normalize()
        .ok_or_else(|| place.wrong("camera", "look_from and look_at in the same place", "two places"))?;
    let right =
        up.cross(back).try_normalize().filter(|_| up.cross(back).length() > 1e-6 * up.length()).ok_or_else(|| {
            place.wrong("camera, up", format!("{:?}", up.to_array()), "a direction that is not that of the view")
        })?;
    let fov = place.number("camera, fov", camera.fov.unwrap_or(27.0), 0.1..=170.0, "degrees from top to bottom, 0.1 to 170")?;
    Ok(Viewpoint {
        name: "camera".into(),
        world_from_camera: Affine3A {
            matrix3: Mat3A::from(Mat3::from_cols(right, back.cross(right), back)),
            translation: from.into(),
        },
        sight: CameraProjection::Perspective { vertical_fov: fov.to_radians() },
        lens: None,
        film: FilmHints::default(),
        node: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Shape;
    use diopter_light::color::luminance;

    /// A Cornell box in twenty lines.
    const BOX: &str = include_str!("cornell.scene");

    fn told(text: &str) -> String {
        load(text.as_bytes(), "x.scene").unwrap_err().to_string()
    }

    #[test]
    fn twenty_lines_are_a_cornell_box() {
        let lines = BOX.lines().filter(|l| !l.trim().is_empty() && !l.starts_with('#')).count();
        assert!(lines <= 20, "{lines}");
        let d = load(BOX.as_bytes(), "cornell.scene").unwrap();
        assert_eq!((d.objects.len(), d.cameras.len(), d.meshes.len()), (8, 1, 1));
        // Every face of the room looks inwards: seen from its middle, normals point at it.
        let middle = Vec3::new(0.0, 1.0, 0.0);
        for o in &d.objects {
            if let Shape::Quad(q) = &o.shape {
                let normal = q.edges[0].cross(q.edges[1]);
                assert!(normal.dot(middle - q.corner) > 0.0, "{}", o.name);
            }
        }
        let lamp = d.materials.iter().find_map(|m| m.emission.as_ref()).unwrap();
        let crate::material::EmissionColor::Constant(spectrum) = &lamp.radiance else { panic!("constant") };
        assert!((luminance(|nm| spectrum.at(nm)) - 3000.0).abs() < 3.0);
        // A block that is turned stays as large.
        let Shape::Mesh { world_from_mesh, .. } =
            &d.objects.iter().find(|o| matches!(o.shape, Shape::Mesh { .. })).unwrap().shape
        else {
            unreachable!()
        };
        assert!((world_from_mesh.matrix3.determinant() - 1.0).abs() < 1e-5);
    }

    #[test]
    fn points_have_their_lumens_and_skies_their_luminance() {
        let d = load(
            b"[material]\nw = { color = 0.5 }\n[[sphere]]\nmaterial = 'w'\ncenter = [0, 0, 0]\nradius = 1\n[[point]]\nposition = [0, 3, 0]\nlumens = 800\n[sky]\nluminance = 500",
            "x.scene",
        )
        .unwrap();
        let Spectrum::Table(intensity) = &d.punctual[0].power else { panic!("a table") };
        assert!((luminance(|nm| intensity.at(nm)) - 800.0 / (4.0 * std::f64::consts::PI)).abs() < 0.1);
        let sky = d.environment.as_ref().unwrap().mean_luminance();
        assert!((sky - 500.0).abs() < 2.0, "{sky}");
    }

    #[test]
    fn what_is_wrong_is_named_with_its_place() {
        let start = "[material]\nw = { color = 0.5 }\n";
        for (text, wanted) in [
            ("[[sphere]]\nmaterial = 'w'\n".to_owned(), "line "),
            (format!("{start}[[sphere]]\nmaterial = 'v'\ncenter = [0,0,0]\nradius = 1"), "one of w"),
            (format!("{start}[[sphere]]\nmaterial = 'w'\ncenter = [0,0,0]\nradius = -1"), "sphere 1, radius"),
            (format!("{start}[[sphere]]\nmaterial = 'w'\ncenter = [0,0,nan]\nradius = 1"), "sphere 1, center"),
            (format!("{start}[[quad]]\nmaterial = 'w'\ncorner = [0,0,0]\nedges = [[1,0,0],[2,0,0]]"), "span an area"),
            (format!("{start}[[box]]\nmaterial = 'w'\ncenter = [0,0,0]\nsize = [1,0,1]"), "box 1, size"),
            (format!("{start}[[ball]]\nradius = 1"), "unknown field `ball`"),
            ("[material]\nw = { color = 1.5 }".to_owned(), "color"),
            ("[material]\nw = { }".to_owned(), "nothing that it is made of"),
            ("[material]\nw = { metal = 'tin' }".to_owned(), "silver, gold"),
            ("[material]\nw = { glass = 1.5, color = 1 }".to_owned(), "more than one"),
            ("[material]\nw = { color = 1, temperature = 3000 }".to_owned(), "without light"),
            ("[material]\nw = { light = 1, roughness = 0.2 }".to_owned(), "roughness without"),
            (format!("{start}[camera]\nlook_from = [0,0,0]\nlook_at = [0,0,0]"), "same place"),
            (start.to_owned(), "no surface"),
            ("a = [".to_owned(), "line 1"),
        ] {
            let found = told(&text);
            assert!(found.contains(wanted) && found.contains("x.scene"), "{wanted}: {found}");
        }
        assert!(load(&[0xff, 0xfe], "x.scene").unwrap_err().to_string().contains("UTF-8"));
    }
}
