//! Scenes: embedded, from files, or put together from arrays.

use crate::arrays::{slice, to_raster};
use crate::background;
use crate::errors::PythonError;
use diopter::light::Spectrum;
use diopter::light::spectrum::blackbody_with_luminance;
use diopter::scene::light::{Environment, Modulation, Punctual, PunctualKind};
use diopter::scene::material::{Conductor, Emission, EmissionColor, Interior, Material, Principled, Scattering, Transmission};
use diopter::scene::shape::{Mesh, Quad, Sphere};
use diopter::scene::texture::{Color, Image, Scalar, Texture};
use diopter::scene::{Description, Object, Shape, builtin};
use diopter::shot::{SceneCache, read_scene};
use glam::{Affine3A, Mat3, Mat3A, Vec2, Vec3, Vec3A};
use numpy::PyReadonlyArrayDyn;
use pyo3::prelude::*;
use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};

/// What a scene is made of, before it is built for an exposure.
#[pyclass(module = "diopter._diopter")]
pub struct Scene {
    /// Shared with exposures that are under way.
    pub description: Arc<Description>,
    /// As it was built for the last exposure.
    pub cache: Arc<Mutex<SceneCache>>,
}

/// Names of the embedded scenes.
#[pyfunction]
pub fn scene_names() -> Vec<&'static str> {
    builtin::NAMES.iter().map(|n| n.0).collect()
}

/// Refuses what is not a number in rows of an array.
fn all_finite(name: &str, values: &[f32], a_row: usize) -> PyResult<()> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(bad) => Err(PythonError::value(name, format!("{} in row {}", values[bad], bad / a_row), "finite numbers").into()),
    }
}

/// A point or direction of three finite numbers.
fn finite(name: &str, v: [f32; 3]) -> Result<Vec3, PythonError> {
    let v = Vec3::from_array(v);
    if v.is_finite() { Ok(v) } else { Err(PythonError::value(name, v.to_string(), "three finite numbers")) }
}

/// A light's colour: three numbers from 0 on.
fn light(name: &str, rgb: [f32; 3]) -> Result<Spectrum, PythonError> {
    match rgb.iter().all(|v| *v >= 0.0 && v.is_finite()) {
        true => Ok(Spectrum::light_from_rgb(Vec3::from_array(rgb))),
        false => Err(PythonError::value(name, format!("{rgb:?}"), "red, green and blue from 0 on")),
    }
}

fn direction(name: &str, v: [f32; 3]) -> Result<Vec3, PythonError> {
    finite(name, v)?.try_normalize().ok_or_else(|| PythonError::value(name, "0, 0, 0", "a direction of some length"))
}

impl Scene {
    fn of(description: Description) -> Scene {
        Scene { description: Arc::new(description), cache: Arc::default() }
    }

    fn edit(&mut self) -> &mut Description {
        Arc::make_mut(&mut self.description)
    }

    fn material_number(&self, material: u32) -> Result<u32, PythonError> {
        let count = self.description.materials.len();
        match (material as usize) < count {
            true => Ok(material),
            false => Err(PythonError::value("material", material.to_string(), format!("a number below {count}"))),
        }
    }

    fn add(&mut self, name: String, shape: Shape, material: u32) -> Result<(), PythonError> {
        let material = self.material_number(material)?;
        self.edit().objects.push(Object::new(name, shape, material));
        Ok(())
    }
}

#[pymethods]
impl Scene {
    #[new]
    fn new(name: String) -> Scene {
        Scene::of(Description { name, ..Description::default() })
    }

    #[staticmethod]
    #[pyo3(signature = (name, strict=false))]
    fn read(py: Python<'_>, name: PathBuf, strict: bool) -> PyResult<Scene> {
        let description =
            background::run(py, None, None, |_| read_scene(&name.to_string_lossy(), strict))?.map_err(PythonError::from)?;
        Ok(Scene::of(description))
    }

    #[getter]
    fn name(&self) -> String {
        self.description.name.clone()
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.description.warnings.clone()
    }

    #[getter]
    fn objects(&self) -> Vec<String> {
        self.description.objects.iter().map(|o| o.name.clone()).collect()
    }

    #[getter]
    fn cameras(&self) -> Vec<String> {
        self.description.cameras.iter().map(|v| v.name.clone()).collect()
    }

    #[getter]
    fn triangles(&self) -> usize {
        let of = |o: &Object| match o.shape {
            Shape::Mesh { mesh, .. } => self.description.meshes.get(mesh as usize).map_or(0, |m| m.triangles.len()),
            _ => 0,
        };
        self.description.objects.iter().map(of).sum()
    }

    /// Two corners of the box around all at the beginning, m; None of an empty scene.
    fn bounds(&self) -> Option<[[f32; 3]; 2]> {
        let bounds = self.description.bounds_at(0.0, |_| true);
        (!bounds.is_empty()).then(|| [bounds.min.to_array(), bounds.max.to_array()])
    }

    /// Adds a material, and returns its number. `numbers` by name: roughness, ior, metallic, transmission, clearcoat, two_sided, kelvin, luminance.
    #[pyo3(signature = (name, kind, color, texture=None, metal=None, emission=None, numbers=HashMap::new()))]
    fn add_material(
        &mut self,
        name: &str,
        kind: &str,
        color: [f32; 3],
        texture: Option<PyReadonlyArrayDyn<'_, f32>>,
        metal: Option<&str>,
        emission: Option<[f32; 3]>,
        numbers: HashMap<String, f32>,
    ) -> PyResult<u32> {
        let number = |key: &str, default: f32| numbers.get(key).copied().unwrap_or(default);
        let within = |key: &str, default: f32, low: f32, high: f32| {
            let v = number(key, default);
            match (low..=high).contains(&v) {
                true => Ok(v),
                false => Err(PythonError::value(key, v.to_string(), format!("{low} to {high}"))),
            }
        };
        if !color.iter().all(|v| (0.0..=1.0).contains(v)) {
            return Err(PythonError::value("color", format!("{color:?}"), "reflectances from 0 to 1, linear sRGB").into());
        }
        let base = match &texture {
            None => Color::rgb(color[0], color[1], color[2]),
            Some(texture) => {
                let picture = to_raster(texture, "texture", 3)?;
                if let Some(bad) = picture.data.iter().find(|v| !(0.0..=1.0).contains(*v)) {
                    let expected = "reflectances from 0 to 1, linear sRGB (codes of a picture are to be divided and decoded)";
                    return Err(PythonError::value("texture", bad.to_string(), expected).into());
                }
                let texels = picture.data.chunks_exact(3).map(|p| [p[0], p[1], p[2], 1.0]).collect();
                let image = Arc::new(Image::linear(picture.width, picture.height, texels));
                Color::Textured { factor: Vec3::from_array(color), texture: Texture::color(image) }
            }
        };
        let roughness = within("roughness", if kind == "principled" { 0.5 } else { 0.0 }, 0.0, 1.0)?;
        let ior = within("ior", 1.5, 0.1, 10.0)?;
        let mut material = match kind {
            "black" => Material::new(name, Scattering::Black),
            "diffuse" => Material::new(name, Scattering::Diffuse(base)),
            "conductor" => {
                let metal = metal.unwrap_or("aluminium");
                let conductor = Conductor::metal(metal, roughness * roughness).ok_or_else(|| {
                    PythonError::value("metal", format!("\"{metal}\""), format!("one of {}", Conductor::METALS.join(", ")))
                })?;
                Material::new(name, Scattering::Conductor(conductor))
            }
            "dielectric" => {
                let mut glass = Principled::glass(ior);
                (glass.base_color, glass.roughness) = (base, Scalar::Constant(roughness));
                let interior = Interior::Body { medium: None, priority: None };
                Material { interior, ..Material::new(name, Scattering::Principled(Box::new(glass))) }
            }
            "principled" => {
                let transmission = within("transmission", 0.0, 0.0, 1.0)?;
                let solid = transmission > 0.0;
                let mut principled = Principled::new(base, ior);
                principled.metallic = Scalar::Constant(within("metallic", 0.0, 0.0, 1.0)?);
                principled.roughness = Scalar::Constant(roughness);
                principled.transmission = Scalar::Constant(transmission);
                principled.kind = if solid { Transmission::Solid } else { Transmission::Thin };
                principled.clearcoat = Scalar::Constant(within("clearcoat", 0.0, 0.0, 1.0)?);
                let interior = if solid { Interior::Body { medium: None, priority: None } } else { Interior::Same };
                Material { interior, ..Material::new(name, Scattering::Principled(Box::new(principled))) }
            }
            other => {
                let expected = "black, diffuse, conductor, dielectric or principled";
                return Err(PythonError::value("material", format!("\"{other}\""), expected).into());
            }
        };
        let radiance = match (emission, numbers.get("kelvin")) {
            (Some(rgb), _) => Some(light("emission", rgb)?),
            (None, Some(kelvin)) => {
                if !(500.0..=50_000.0).contains(kelvin) {
                    return Err(PythonError::value("temperature", format!("{kelvin} K"), "500 to 50000 K").into());
                }
                Some(blackbody_with_luminance(*kelvin, within("luminance", 1000.0, 0.0, 1e12)?))
            }
            (None, None) => None,
        };
        material.emission = radiance.map(|radiance| Emission {
            radiance: EmissionColor::Constant(radiance),
            two_sided: number("two_sided", 0.0) != 0.0,
            is_light: true,
            modulation: Modulation::Steady,
        });
        let d = self.edit();
        d.materials.push(material);
        Ok(d.materials.len() as u32 - 1)
    }

    /// Adds a mesh; `transform`: rows of a 4 × 4 matrix, world from mesh.
    #[pyo3(signature = (name, vertices, faces, material, normals=None, uvs=None, transform=None))]
    fn add_mesh(
        &mut self,
        name: String,
        vertices: PyReadonlyArrayDyn<'_, f32>,
        faces: PyReadonlyArrayDyn<'_, u32>,
        material: u32,
        normals: Option<PyReadonlyArrayDyn<'_, f32>>,
        uvs: Option<PyReadonlyArrayDyn<'_, f32>>,
        transform: Option<[[f32; 4]; 4]>,
    ) -> PyResult<()> {
        let material = self.material_number(material)?;
        let (positions, shape) = slice(&vertices, "vertices", &[0, 3])?;
        let count = shape[0];
        all_finite("vertices", positions, 3)?;
        let (corners, _) = slice(&faces, "faces", &[0, 3])?;
        if let Some(bad) = corners.iter().position(|i| *i as usize >= count) {
            let expected = format!("numbers below {count}, the number of vertices");
            return Err(PythonError::value("faces", format!("{} in row {}", corners[bad], bad / 3), expected).into());
        }
        let vec3 = |data: &[f32]| data.chunks_exact(3).map(Vec3::from_slice).collect::<Vec<_>>();
        let mut mesh = Mesh {
            positions: vec3(positions),
            triangles: corners.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect(),
            ..Mesh::default()
        };
        if let Some(normals) = &normals {
            let given = slice(normals, "normals", &[count, 3])?.0;
            all_finite("normals", given, 3)?;
            mesh.normals = vec3(given).into_iter().map(Vec3::normalize_or_zero).collect();
        }
        if let Some(uvs) = &uvs {
            let given = slice(uvs, "uvs", &[count, 2])?.0;
            all_finite("uvs", given, 2)?;
            mesh.uvs[0] = given.chunks_exact(2).map(Vec2::from_slice).collect();
        }
        let world_from_mesh = match transform {
            None => Affine3A::IDENTITY,
            Some(rows) => {
                let column = |c: usize| Vec3A::new(rows[0][c], rows[1][c], rows[2][c]);
                let place = Affine3A { matrix3: Mat3A::from_cols(column(0), column(1), column(2)), translation: column(3) };
                if !place.is_finite() || place.matrix3.determinant() == 0.0 || rows[3] != [0.0, 0.0, 0.0, 1.0] {
                    let expected = "an affine 4 × 4 matrix that can be inverted, its last row 0, 0, 0, 1";
                    return Err(PythonError::value("transform", format!("{rows:?}"), expected).into());
                }
                place
            }
        };
        let d = self.edit();
        d.meshes.push(mesh.into());
        let shape = Shape::Mesh { mesh: d.meshes.len() as u32 - 1, world_from_mesh };
        d.objects.push(Object::new(name, shape, material));
        Ok(())
    }

    fn add_sphere(&mut self, name: String, center: [f32; 3], radius: f32, material: u32) -> PyResult<()> {
        let center = finite("center", center)?;
        if !(radius > 0.0 && radius.is_finite()) {
            return Err(PythonError::value("radius", radius.to_string(), "a length above 0, m").into());
        }
        Ok(self.add(name, Shape::Sphere(Sphere { center, radius }), material)?)
    }

    fn add_quad(&mut self, name: String, corner: [f32; 3], edges: [[f32; 3]; 2], material: u32) -> PyResult<()> {
        let quad = Quad { corner: finite("corner", corner)?, edges: [finite("edge", edges[0])?, finite("edge", edges[1])?] };
        if !(quad.area() > 0.0) {
            return Err(PythonError::value("edges", format!("{edges:?}"), "two edges that span an area").into());
        }
        Ok(self.add(name, Shape::Quad(quad), material)?)
    }

    /// Adds a light in a point, cd of each colour.
    fn add_point(&mut self, name: &str, position: [f32; 3], intensity: [f32; 3]) -> PyResult<()> {
        let kind = PunctualKind::Point { position: finite("position", position)? };
        let light = Punctual::new(name, light("intensity", intensity)?, kind);
        self.edit().punctual.push(light);
        Ok(())
    }

    /// Adds a disc at infinity (or parallel light, of an angle of 0), lx of each colour on a surface that faces it.
    fn add_sun(&mut self, name: &str, towards: [f32; 3], illuminance: [f32; 3], diameter_deg: f32) -> PyResult<()> {
        let direction = -direction("towards", towards)?;
        let kind = match diameter_deg {
            0.0 => PunctualKind::Directional { direction },
            d if d > 0.0 && d <= 90.0 => PunctualKind::Disc { direction, half_angle: 0.5 * d.to_radians() },
            d => return Err(PythonError::value("diameter_deg", d.to_string(), "0 to 90 degrees").into()),
        };
        let light = Punctual::new(name, light("illuminance", illuminance)?, kind);
        self.edit().punctual.push(light);
        Ok(())
    }

    /// Surroundings: a lat-long map of linear sRGB in cd/m².
    fn set_environment(&mut self, map: PyReadonlyArrayDyn<'_, f32>, rotation_deg: f32, scale: f32) -> PyResult<()> {
        let map = to_raster(&map, "environment", 3)?;
        if let Some(bad) = map.data.iter().find(|v| !(**v >= 0.0 && v.is_finite())) {
            return Err(PythonError::value("environment", bad.to_string(), "finite radiance of at least 0").into());
        }
        if !(scale >= 0.0 && scale.is_finite() && rotation_deg.is_finite()) {
            let found = format!("scale {scale}, rotation {rotation_deg}°");
            return Err(PythonError::value("environment", found, "finite numbers, the scale not negative").into());
        }
        let place = Mat3::from_rotation_y(rotation_deg.to_radians());
        self.edit().environment = Some(Environment::new(map, place, scale));
        Ok(())
    }
}
