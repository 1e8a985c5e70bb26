//! A photograph as a user asks for it: a shot file (TOML) or flags → checked → taken.
//!
//! [`ShotFile`] is what was written; [`Shot::prepare`] reads the scene, checks every number and fills in what was left open;
//! [`Shot::expose`], [`Shot::read_out`] and [`Shot::develop`] are the photograph.

use crate::camera::{Camera, Film, PlacementError, look_at};
use crate::expose::{ExposeError, Response, Settings, Watch, expose};
use crate::metering;
use crate::quantity::{Distance, FNumber, Iso, LengthMm, Seconds, Size};
use crate::shutter::Shutter;
use crate::{lens_profile, recipe_file};
use diopter_develop::lut::Lut;
use diopter_develop::{Recipe, RecipeError, denoise, develop};
use diopter_image::focal_plane::Truth;
use diopter_image::{ExposureFacts, FocalPlane, Picture, Raster, RawImage};
use diopter_lens::compound::{CompoundLens, Setting};
use diopter_lens::{Focus, Iris, Lens, LensError, Pinhole, Prescription, ThinLens, import};
use diopter_light::cie;
use diopter_light::random::SamplerKind;
use diopter_light::units::Millimeters;
use diopter_scene::bvh::Bounds;
use diopter_scene::light::Environment;
use diopter_scene::material::{Material, Scattering};
use diopter_scene::shape::Quad;
use diopter_scene::texture::Color;
use diopter_scene::{Description, Object, PathSettings, Scene, SceneError, Shape, builtin, load};
use diopter_sensor::format::{self, Format};
use diopter_sensor::{Reading, Sensor, SensorError, nearest, read_out};
use glam::{Affine3A, Mat3, Vec2, Vec3};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Most pixels a side of a picture.
pub const LARGEST_SIDE: usize = 65_535;
const DEFAULT_WIDTH: usize = 960;
const DEFAULT_SPP: u32 = 64;
const DEFAULT_ISO: f64 = 100.0;

/// What a shot file says; everything may be left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ShotFile {
    /// What is photographed.
    pub scene: SceneSection,
    /// With what, from where.
    pub camera: CameraSection,
    /// How much light.
    pub exposure: ExposureSection,
    /// What is sharp.
    pub focus: FocusSection,
    /// How it is computed.
    pub render: RenderSection,
    /// How the raw image becomes a picture.
    pub develop: Recipe,
    /// Where it goes.
    pub output: OutputSection,
}

/// `[scene]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SceneSection {
    /// An embedded scene's name, or a `.gltf` or `.glb` file (relative to the shot file).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// A lat-long `.hdr` or `.exr` around the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment: Option<PathBuf>,
    /// Turns the environment about the vertical, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment_rotation_deg: Option<f32>,
    /// Factor on the environment; 1 takes its numbers as cd/m².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment_scale: Option<f32>,
    /// Puts a large matte floor of this albedo (0 to 1, grey) under the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<f32>,
    /// Scales all light so that the scene as framed meters at this EV (ISO 100): for scenes without a true scale.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ambient_ev: Option<f64>,
}

/// `[camera]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraSection {
    /// An embedded body's name or a TOML file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub body: Option<String>,
    /// Serial number of the body: its fixed pattern is drawn from it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// A film format by name or as "36x24" mm, instead of the body's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// `thin`, `pinhole`, an embedded lens's name or a lens file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lens: Option<String>,
    /// Focal length; of a zoom, where it is set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_length: Option<LengthMm>,
    /// Blades of the iris; without, the lens's own, or round.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blades: Option<u32>,
    /// How round the blades are: 0 straight to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blade_curvature: Option<f32>,
    /// A picture (PNG or JPEG) as aperture: white lets light through.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aperture_image: Option<PathBuf>,
    /// Turns the iris, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blade_rotation_deg: Option<f32>,
    /// Where the camera stands, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub look_from: Option<[f32; 3]>,
    /// What it is aimed at, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub look_at: Option<[f32; 3]>,
    /// What is up in the picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub up: Option<[f32; 3]>,
    /// A camera of the scene file by name or number (the first is 0).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub viewpoint: Option<String>,
}

/// `[exposure]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ExposureSection {
    /// f-number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub aperture: Option<FNumber>,
    /// Exposure time; metered without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shutter: Option<Seconds>,
    /// ISO speed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub iso: Option<Iso>,
    /// Illuminant the camera takes for white: D65, D50, A, FL2 ...
    #[serde(skip_serializing_if = "Option::is_none")]
    pub white: Option<String>,
    /// Temperature of the sensor, °C.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
    /// Leave the cap on the lens: a dark frame.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub lens_cap: bool,
}

/// `[focus]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FocusSection {
    /// Distance of the sharp plane from the lens; without, the point the camera is aimed at.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance: Option<Distance>,
}

/// `[render]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RenderSection {
    /// Pixels of the picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<Size>,
    /// Samples a pixel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spp: Option<u32>,
    /// First and one after the last sample of this run, of `spp` in all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub samples: Option<[u32; 2]>,
    /// Seed of light transport and noise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// `sobol`, `jittered`, `grid` or `independent`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sampler: Option<String>,
    /// Most scattering events of a path.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_depth: Option<u32>,
    /// Stop after about so long.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_limit: Option<Seconds>,
    /// Reduce the renderer's own noise; off without.
    pub denoise: Option<bool>,
}

/// `[output]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutputSection {
    /// Files to write; the ending says what.
    pub files: Vec<PathBuf>,
}

/// Why a photograph cannot be taken.
#[derive(Debug, thiserror::Error)]
pub enum ShotError {
    /// A file that cannot be read.
    #[error("{path}: {reason}")]
    Read {
        /// The file.
        path: String,
        /// What the system or the parser says.
        reason: String,
    },
    /// A value outside its range or a name nobody knows.
    #[error("{what} {found}: expected {expected}")]
    Value {
        /// Setting.
        what: &'static str,
        /// Its value.
        found: String,
        /// What is allowed, or a hint.
        expected: String,
    },
    /// The scene.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The body.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// The lens.
    #[error(transparent)]
    Lens(#[from] LensError),
    /// The camera's place.
    #[error(transparent)]
    Placement(#[from] PlacementError),
    /// The development.
    #[error(transparent)]
    Recipe(RecipeError),
    /// The exposure was stopped.
    #[error(transparent)]
    Expose(#[from] ExposeError),
}

impl ShotError {
    /// Whether the user asked for something impossible (rather than something failing on the way).
    pub fn is_request(&self) -> bool {
        !matches!(self, ShotError::Read { .. } | ShotError::Expose(_) | ShotError::Scene(_))
    }
}

fn value(what: &'static str, found: impl ToString, expected: impl Into<String>) -> ShotError {
    ShotError::Value { what, found: found.to_string(), expected: expected.into() }
}

/// A photograph ready to be taken.
pub struct Shot {
    /// The scene, built.
    pub scene: Scene,
    /// The camera, placed and focused.
    pub camera: Camera,
    /// The body's sensor.
    pub sensor: Sensor,
    /// Opening time; known after metering.
    pub shutter: Option<f64>,
    /// How the sensor is read.
    pub reading: Reading,
    /// When it is taken, as EXIF writes it; whoever owns a clock says so.
    pub date: Option<String>,
    /// No light reaches the film.
    pub lens_cap: bool,
    /// Sampling.
    pub settings: Settings,
    /// Reduce the renderer's own noise.
    pub denoise: bool,
    /// Development.
    pub recipe: Recipe,
    /// The look-up table that the recipe names.
    pub lut: Option<Lut>,
    /// Requested metered EV of the scene.
    ambient_ev: Option<f64>,
    facts: ExposureFacts,
}

impl ShotFile {
    /// Reads a shot file; paths in it are relative to it.
    pub fn read(path: &Path) -> Result<ShotFile, ShotError> {
        let place = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|e| ShotError::Read { path: place.clone(), reason: e.to_string() })?;
        let mut shot: ShotFile =
            toml::from_str(&text).map_err(|e| ShotError::Read { path: place, reason: e.to_string().trim_end().to_owned() })?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let relative = |p: &Path| if p.is_absolute() { p.to_owned() } else { folder.join(p) };
        if let Some(file) = &mut shot.scene.file
            && !builtin::is_embedded(file)
        {
            *file = relative(Path::new(file.as_str())).display().to_string();
        }
        if let Some(environment) = &mut shot.scene.environment {
            *environment = relative(environment);
        }
        if let Some(body) = &mut shot.camera.body
            && body.ends_with(".toml")
        {
            *body = relative(Path::new(body.as_str())).display().to_string();
        }
        if let Some(lens) = shot.camera.lens.as_mut().filter(|l| is_lens_file(l)) {
            *lens = relative(Path::new(lens.as_str())).display().to_string();
        }
        if let Some(picture) = &mut shot.camera.aperture_image {
            *picture = relative(picture);
        }
        recipe_file::place_lut(&mut shot.develop, folder);
        Ok(shot)
    }

    /// Makes the paths of scene, environment and body independent of where the shot file lies.
    pub fn make_paths_absolute(&mut self) {
        let whole = |p: &Path| std::path::absolute(p).unwrap_or_else(|_| p.to_owned());
        let text = |p: &str| whole(Path::new(p)).display().to_string();
        if let Some(file) = self.scene.file.as_mut().filter(|f| !builtin::is_embedded(f)) {
            *file = text(file);
        }
        if let Some(environment) = &mut self.scene.environment {
            *environment = whole(environment);
        }
        if let Some(body) = self.camera.body.as_mut().filter(|b| b.ends_with(".toml")) {
            *body = text(body);
        }
        if let Some(lens) = self.camera.lens.as_mut().filter(|l| is_lens_file(l)) {
            *lens = text(lens);
        }
        if let Some(picture) = &mut self.camera.aperture_image {
            *picture = whole(picture);
        }
        if !self.develop.lut.file.is_empty() {
            self.develop.lut.file = text(&self.develop.lut.file);
        }
    }

    /// The file's text.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("a shot file is plain data")
    }
}

/// Reads a scene by the name of an embedded one or from a file.
pub fn read_scene(name: &str) -> Result<Description, ShotError> {
    if let Some(description) = builtin::named(name) {
        return Ok(description);
    }
    let path = Path::new(name);
    let known: Vec<&str> = builtin::NAMES.iter().map(|n| n.0).collect();
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    if !path.exists() && ending.is_none() {
        let hint = match nearest(name, known.iter().copied()) {
            Some(near) => format!("a scene (did you mean \"{near}\"?)"),
            None => format!("an embedded scene ({}) or a .gltf or .glb file", known.join(", ")),
        };
        return Err(value("scene", format!("\"{name}\""), hint));
    }
    let bytes = read_file(path)?;
    match ending.as_deref() {
        Some("gltf" | "glb") => {
            let folder = path.parent().unwrap_or(Path::new("")).to_owned();
            let fetch = move |uri: &str| std::fs::read(folder.join(uri)).map_err(|e| e.to_string());
            Ok(load::gltf::load(&bytes, name, &fetch)?)
        }
        _ => Err(value("scene", format!("\"{name}\""), "a .gltf or .glb file (or a .toml shot file)")),
    }
}

/// ", text" or nothing.
fn with_comma(text: String) -> String {
    if text.is_empty() { text } else { format!(", {text}") }
}

fn distance_m(focus: Focus) -> Option<f64> {
    match focus {
        Focus::Infinity => None,
        Focus::Distance(mm) => Some(mm.0 / 1000.0),
    }
}

/// Whether a lens is given as a file and not by name.
fn is_lens_file(name: &str) -> bool {
    import::Format::of(name).is_some() && diopter_lens::embedded(name).is_none()
}

/// Reads a lens by the name of an embedded one or from a file.
pub fn read_lens(name: &str) -> Result<Prescription, ShotError> {
    if let Some(lens) = diopter_lens::embedded(name) {
        return Ok(lens);
    }
    let path = Path::new(name);
    match import::Format::of(name) {
        Some(format) => Ok(import::read(&read_file(path)?, format, name).map_err(LensError::from)?),
        _ => {
            let expected = match nearest(name, diopter_lens::embedded_names().chain(["thin", "pinhole"])) {
                Some(near) => format!("a lens (did you mean \"{near}\"?)"),
                None if path.exists() => format!("a lens file: {}", import::Format::ENDINGS),
                None => format!("thin, pinhole, a name of `lens list`, or a file: {}", import::Format::ENDINGS),
            };
            Err(value("lens", format!("\"{name}\""), expected))
        }
    }
}

/// The iris that a shot asks for instead of the lens's own.
fn iris(c: &CameraSection) -> Result<Option<Iris>, ShotError> {
    if let Some(path) = &c.aperture_image {
        let told = |reason: String| ShotError::Read { path: path.display().to_string(), reason };
        let picture = image::load_from_memory(&read_file(path)?).map_err(|e| told(e.to_string()))?.to_luma8();
        let values = picture.pixels().map(|p| p.0[0] as f32 / 255.0).collect();
        return Ok(Some(Iris::image(picture.width() as usize, picture.height() as usize, values)?));
    }
    let rotation = c.blade_rotation_deg.unwrap_or(0.0).to_radians();
    c.blades.map(|count| Ok(Iris::blades(count, rotation, c.blade_curvature.unwrap_or(0.0))?)).transpose()
}

/// Reads a body by name or from a TOML file.
pub fn read_body(name: &str) -> Result<Sensor, ShotError> {
    if !name.ends_with(".toml") {
        return Ok(Sensor::named(name)?);
    }
    let text = String::from_utf8(read_file(Path::new(name))?)
        .map_err(|_| ShotError::Read { path: name.into(), reason: "it is not text".into() })?;
    Ok(Sensor::parse(&text, name)?)
}

/// Reads a `.hdr` or `.exr` as an environment.
pub fn read_environment(path: &Path, rotation_deg: f32, scale: f32) -> Result<Environment, ShotError> {
    let bytes = read_file(path)?;
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    let told = |reason: String| ShotError::Read { path: path.display().to_string(), reason };
    let map = match ending.as_deref() {
        Some("hdr") => load::read_hdr(&bytes).map_err(|e| told(e.to_string()))?,
        Some("exr") => diopter_image::exr::read_rgb(std::io::Cursor::new(&bytes)).map_err(|e| told(e.to_string()))?,
        _ => return Err(value("environment", path.display(), "a .hdr or .exr file")),
    };
    if map.width == 0 || map.height == 0 {
        return Err(told("it has no pixels".into()));
    }
    Ok(Environment::new(map, Mat3::from_rotation_y(rotation_deg.to_radians()), scale))
}

fn read_file(path: &Path) -> Result<Vec<u8>, ShotError> {
    std::fs::read(path).map_err(|e| {
        let reason = match e.kind() {
            std::io::ErrorKind::NotFound => "there is no such file".into(),
            _ => e.to_string(),
        };
        ShotError::Read { path: path.display().to_string(), reason }
    })
}

impl Shot {
    /// Checks a request, reads its files and builds the scene. `warn` gets what was found odd.
    pub fn prepare(file: &ShotFile, warn: &mut dyn FnMut(&str)) -> Result<Shot, ShotError> {
        // Cheap checks before anything is read.
        let settings = settings(&file.render)?;
        let sensor = read_body(file.camera.body.as_deref().unwrap_or("canon-5d-mark-iv"))?;
        let iso = file.exposure.iso.map_or_else(|| sensor.nearest_iso(DEFAULT_ISO), |i| i.0);
        sensor.at_iso(iso)?;
        let white = file.exposure.white.clone().unwrap_or_else(|| "D65".into());
        if cie::illuminant(&white).is_none() {
            return Err(value("white", format!("\"{white}\""), format!("one of {}", cie::illuminant_names().join(", "))));
        }
        if let Some(Seconds(t)) = file.exposure.shutter
            && !(t > 0.0 && t.is_finite())
        {
            return Err(value("shutter", Seconds(t), "a time above 0"));
        }
        let celsius = file.exposure.temperature_c.unwrap_or(20.0);
        if !(-273.15..=200.0).contains(&celsius) {
            return Err(value("temperature", format!("{celsius} °C"), "-273 to 200 °C"));
        }
        if let Some(FNumber(n)) = file.exposure.aperture
            && !(n > 0.0)
        {
            return Err(value("aperture", FNumber(n), "a number above 0, such as f/2.8"));
        }
        file.develop.check()?;
        let lut = recipe_file::lut(&file.develop)?;
        if let Some(ev) = file.scene.ambient_ev
            && !(-30.0..=40.0).contains(&ev)
        {
            return Err(value("ambient_ev", ev, "-30 to 40"));
        }

        let name = file.scene.file.as_deref().unwrap_or("still-life");
        let mut description = read_scene(name)?;
        if let Some(path) = &file.scene.environment {
            let (rotation, scale) =
                (file.scene.environment_rotation_deg.unwrap_or(0.0), file.scene.environment_scale.unwrap_or(1.0));
            if !(scale >= 0.0 && scale.is_finite() && rotation.is_finite()) {
                return Err(value(
                    "environment_scale or environment_rotation_deg",
                    format!("{scale}, {rotation}"),
                    "finite numbers, the scale not negative",
                ));
            }
            description.environment = Some(read_environment(path, rotation, scale)?);
        }
        if let Some(albedo) = file.scene.ground {
            put_ground(&mut description, albedo)?;
        }
        let scene_name = description.name.clone();
        let dark = description.environment.is_none()
            && description.punctual.is_empty()
            && !description.materials.iter().any(|m| m.emission.is_some());
        if dark {
            warn("the scene has no light: an even white sky of 2000 cd/m² is put around it (give --environment for another)");
            description.environment = Some(Environment::uniform(Vec3::splat(2000.0)));
        }
        let framing = builtin::framing(name);
        let scene = Scene::build(description)?;
        scene.description().warnings.iter().for_each(|w| warn(w));
        if scene.bounds().is_empty() && scene.description().environment.is_none() {
            return Err(SceneError::Empty("it has no surface and no environment".into()).into());
        }

        let camera = camera(file, &scene, &sensor, framing.as_ref(), warn)?;
        let (lens_name, focus_distance_m) = match &camera.lens {
            Lens::Pinhole(_) => ("pinhole".to_owned(), None),
            Lens::Thin(l) => {
                let iris = with_comma(l.iris.describe());
                (format!("thin lens {:.4} mm{iris}", l.focal_length.0).replace(".0000", ""), distance_m(l.focus))
            }
            Lens::Compound(l) => {
                let name = format!("{}{}", l.prescription().name, with_comma(l.system().iris.shape.describe()));
                (name, distance_m(l.focus()))
            }
        };
        let focal = camera.lens.focal_length().0;
        let facts = ExposureFacts {
            software: concat!("diopter ", env!("CARGO_PKG_VERSION")).into(),
            scene: scene_name,
            body: sensor.name.clone(),
            lens: lens_name,
            focal_length_mm: focal,
            focal_length_35mm_mm: format::equivalent_35mm(focal, camera.film.width_mm.hypot(camera.film.height_mm)),
            f_number: camera.lens.f_number(),
            t_number: camera.lens.t_number(),
            focus_distance_m,
            lens_profile: match &camera.lens {
                Lens::Compound(l) => lens_profile::profile(l, &sensor, 0.5 * camera.film.width_mm.hypot(camera.film.height_mm)),
                _ => None,
            },
            light_scale: 1.0,
            ..Default::default()
        };
        Ok(Shot {
            scene,
            camera,
            sensor,
            shutter: file.exposure.shutter.map(|s| s.0),
            reading: Reading {
                iso,
                seed: settings.seed,
                serial: file.camera.serial.clone().unwrap_or_else(|| Reading::FIRST_SERIAL.into()),
                temperature_c: file.exposure.temperature_c,
                white,
            },
            date: None,
            lens_cap: file.exposure.lens_cap,
            settings,
            denoise: file.render.denoise.unwrap_or(false),
            recipe: file.develop.clone(),
            lut,
            ambient_ev: file.scene.ambient_ev,
            facts,
        })
    }

    /// Meters the scene and settles what was left open: light scale and exposure time.
    pub fn meter(&mut self, watch: &Watch) -> Result<(), ShotError> {
        if self.lens_cap {
            self.shutter.get_or_insert(1.0);
            return Ok(());
        }
        let luminance = metering::mean_luminance(&self.scene, &self.camera, &self.settings, watch)?;
        let metered = (luminance > 0.0 && luminance.is_finite()).then(|| metering::ev100_of_luminance(luminance));
        if let (Some(wanted), Some(found)) = (self.ambient_ev, metered) {
            self.settings.light_scale = (wanted - found).exp2();
        }
        self.facts.metered_ev100 = match (self.ambient_ev, metered) {
            (Some(wanted), Some(_)) => Some(wanted),
            _ => metered,
        };
        if self.shutter.is_none() {
            // Without any light any time will do.
            let ev = self.facts.metered_ev100.unwrap_or(0.0);
            self.shutter = Some(metering::shutter_for(ev, self.facts.t_number, self.reading.iso));
        }
        Ok(())
    }

    /// Facts as known so far.
    pub fn facts(&self) -> ExposureFacts {
        ExposureFacts { exposure_s: self.shutter.unwrap_or(0.0), iso: self.reading.iso, ..self.facts.clone() }
    }

    /// Exposes the film. [`Shot::meter`] must have been called.
    pub fn expose(&self, watch: &Watch) -> Result<FocalPlane, ShotError> {
        let shutter = Shutter { open_s: 0.0, exposure_s: self.shutter.unwrap_or(1.0) };
        let facts = ExposureFacts { iso: 0.0, ..self.facts() };
        if self.lens_cap {
            return Ok(darkness(&self.camera.film, &Response::sensor(&self.sensor), &self.settings, facts));
        }
        let response = Response::sensor(&self.sensor);
        let plane = expose(&self.scene, &self.camera, &shutter, &response, &self.settings, &facts, watch)?;
        Ok(if self.denoise { denoise(&plane) } else { plane })
    }

    /// Reads the film out.
    pub fn read_out(&self, plane: &FocalPlane) -> Result<RawImage, ShotError> {
        let mut raw = read_out(plane, &self.sensor, &self.reading, &white_point(&self.reading.white)?)?;
        raw.header.facts.date.clone_from(&self.date);
        Ok(raw)
    }

    /// Develops a raw image by the shot's recipe.
    pub fn develop(&self, raw: &RawImage) -> Result<Picture, ShotError> {
        Ok(develop(raw, &self.recipe, self.lut.clone())?)
    }
}

/// The exposure of a film that no light reaches.
fn darkness(film: &Film, response: &Response, settings: &Settings, facts: ExposureFacts) -> FocalPlane {
    let (width, height, bands) = (film.columns, film.rows, response.bands.len());
    FocalPlane {
        bands: response.bands.clone(),
        mean: Raster::new(width, height, bands),
        half_difference: Raster::new(width, height, bands),
        truth: Truth::empty(width, height),
        facts: ExposureFacts { seed: settings.seed, samples: 1, light_scale: 1.0, ..facts },
    }
}

/// An illuminant by name, as the camera's white.
pub fn white_point(name: &str) -> Result<diopter_light::spectrum::Table, ShotError> {
    cie::illuminant(name)
        .ok_or_else(|| value("white", format!("\"{name}\""), format!("one of {}", cie::illuminant_names().join(", "))))
}

/// The box around one object.
fn object_bounds(d: &Description, object: &Object) -> Bounds {
    match object.shape {
        Shape::Mesh { mesh, world_from_mesh } => {
            let positions = d.meshes.get(mesh as usize).map_or(&[][..], |m| &m.positions);
            Bounds::around(positions.iter().map(|p| world_from_mesh.transform_point3(*p)).filter(|p| p.is_finite()))
        }
        Shape::Sphere(s) => Bounds { min: s.center - s.radius, max: s.center + s.radius },
        Shape::Quad(q) => Bounds::around([Vec2::ZERO, Vec2::X, Vec2::Y, Vec2::ONE].map(|p| q.point(p))),
    }
}

/// Adds a floor just below the lowest point of the meshes.
fn put_ground(d: &mut Description, albedo: f32) -> Result<(), ShotError> {
    if !(0.0..=1.0).contains(&albedo) {
        return Err(value("ground", albedo, "an albedo from 0 to 1"));
    }
    let bounds = d.objects.iter().fold(Bounds::EMPTY, |b, o| b.union(object_bounds(d, o)));
    if bounds.is_empty() {
        return Err(value("ground", albedo, "a scene with something to stand on it"));
    }
    let size = bounds.size().max_element().max(1e-3);
    let reach = 200.0 * size;
    let corner = bounds.center().with_y(bounds.min.y - 1e-4 * size) + Vec3::new(-0.5, 0.0, 0.5) * reach;
    d.materials.push(Material::new("ground", Scattering::Diffuse(Color::rgb(albedo, albedo, albedo))));
    let shape = Shape::Quad(Quad { corner, edges: [Vec3::X * reach, Vec3::NEG_Z * reach] });
    d.objects.push(Object::new("ground", shape, d.materials.len() as u32 - 1));
    Ok(())
}

fn settings(r: &RenderSection) -> Result<Settings, ShotError> {
    let spp = r.spp.unwrap_or(DEFAULT_SPP);
    if spp == 0 || spp > 1 << 24 {
        return Err(value("spp", spp, "1 to 16777216 samples a pixel"));
    }
    let samples = r.samples.map_or(0..spp, |[a, b]| a..b);
    if samples.is_empty() || samples.end > spp {
        return Err(value(
            "samples",
            format!("{}..{}", samples.start, samples.end),
            format!("a range A..B with A < B <= spp ({spp})"),
        ));
    }
    let sampler = match r.sampler.as_deref() {
        None | Some("sobol") => SamplerKind::Sobol,
        Some("jittered") => SamplerKind::Jittered,
        Some("grid") => SamplerKind::Grid,
        Some("independent") => SamplerKind::Independent,
        Some(other) => return Err(value("sampler", format!("\"{other}\""), "sobol, jittered, grid or independent")),
    };
    let limit = r.time_limit.map(|s| s.0);
    if limit.is_some_and(|l| !(l > 0.0)) {
        return Err(value("time-limit", r.time_limit.map_or(String::new(), |l| l.to_string()), "a time above 0"));
    }
    // A time limit alone means: as many samples as fit.
    let spp = if limit.is_some() && r.spp.is_none() { 1 << 16 } else { spp };
    let samples = if r.samples.is_some() { samples } else { 0..spp };
    let default = PathSettings::default();
    Ok(Settings {
        samples,
        sampler,
        seed: r.seed.unwrap_or(1),
        path: PathSettings { max_depth: r.max_depth.unwrap_or(default.max_depth), ..default },
        time_limit_s: limit,
        ..Settings::new(spp)
    })
}

/// The box around everything but a floor that was put under it.
fn subject_bounds(scene: &Scene) -> Bounds {
    let d = scene.description();
    let last = d.objects.last().filter(|o| o.name == "ground" && matches!(o.shape, Shape::Quad(_)));
    match last {
        None => scene.bounds(),
        Some(_) => d.objects[..d.objects.len() - 1].iter().fold(Bounds::EMPTY, |b, o| b.union(object_bounds(d, o))),
    }
}

fn film(file: &ShotFile, sensor: &Sensor) -> Result<Film, ShotError> {
    let [mut width_mm, mut height_mm] = sensor.format_mm;
    if let Some(name) = &file.camera.format {
        let named = Format::named(name).or_else(|| {
            let (w, h) = name.trim_end_matches("mm").split_once('x')?;
            let side = |s: &str| s.trim().parse::<f64>().ok().filter(|v| *v > 0.0 && *v <= 1000.0);
            Some(Format { names: &[], width_mm: side(w)?, height_mm: side(h)? })
        });
        let Some(f) = named else {
            let names: Vec<&str> = format::FORMATS.iter().map(|f| f.names[0]).collect();
            let expected = match nearest(name, names.iter().copied()) {
                Some(near) => format!("a format (did you mean \"{near}\"?)"),
                None => format!("one of {}, or width x height in mm such as 36x24", names.join(", ")),
            };
            return Err(value("format", format!("\"{name}\""), expected));
        };
        (width_mm, height_mm) = (f.width_mm, f.height_mm);
    }
    let size = file.render.size.unwrap_or_else(|| Size {
        width: DEFAULT_WIDTH,
        height: (DEFAULT_WIDTH as f64 * height_mm / width_mm).round().max(1.0) as usize,
    });
    if size.width == 0 || size.height == 0 || size.width > LARGEST_SIDE || size.height > LARGEST_SIDE {
        return Err(value("size", size, format!("1 to {LARGEST_SIDE} pixels a side")));
    }
    // The picture keeps the format's width or height, whichever its shape uses fully.
    let shape = size.width as f64 / size.height as f64;
    let (w, h) = if shape > width_mm / height_mm { (width_mm, width_mm / shape) } else { (height_mm * shape, height_mm) };
    let [px, py] = sensor.pitch_mm();
    let gap = 1.0 - sensor.fill_factor.sqrt();
    Ok(Film {
        width_mm: w,
        height_mm: h,
        columns: size.width,
        rows: size.height,
        pixel_area_mm2: px * py,
        low_pass_mm: sensor.low_pass_px * px,
        gap_mm: [gap * px, gap * py],
    })
}

fn camera(
    file: &ShotFile,
    scene: &Scene,
    sensor: &Sensor,
    framing: Option<&builtin::Framing>,
    warn: &mut dyn FnMut(&str),
) -> Result<Camera, ShotError> {
    let film = film(file, sensor)?;
    let c = &file.camera;
    let views = &scene.description().cameras;
    let view = match &c.viewpoint {
        Some(wanted) => {
            let found = views.iter().find(|v| v.name == *wanted).or_else(|| views.get(wanted.parse::<usize>().ok()?));
            let names: Vec<&str> = views.iter().map(|v| v.name.as_str()).collect();
            Some(found.ok_or_else(|| {
                value(
                    "viewpoint",
                    format!("\"{wanted}\""),
                    match names.is_empty() {
                        true => "the scene file has no cameras: use look_from and look_at".to_owned(),
                        false => format!("one of {} or its number", names.join(", ")),
                    },
                )
            })?)
        }
        None => views.first(),
    };
    if view.is_some_and(|v| v.vertical_fov.is_none()) {
        warn("the scene's camera is orthographic; its place is used with a perspective lens");
    }
    let from_fov = |fov: f32| format::focal_length_for(film.height_mm, fov as f64);
    let focal_mm = match (c.focal_length, view.and_then(|v| v.vertical_fov), framing) {
        (Some(f), ..) => f.0,
        (None, Some(fov), _) if c.look_from.is_none() => from_fov(fov),
        (None, _, Some(framing)) => framing.focal_length_mm,
        _ => 50.0,
    };

    // Where the camera stands, and how far along its axis the subject is.
    let bounds = subject_bounds(scene);
    let (center, radius) = match bounds.is_empty() {
        true => (Vec3::ZERO, 1.0),
        false => (bounds.center(), (0.5 * bounds.size().length()).max(1e-3)),
    };
    let up = c.up.map_or(Vec3::Y, Vec3::from_array);
    let (place, subject_m) = if c.look_from.is_some() || c.look_at.is_some() || (view.is_none() && framing.is_none()) {
        let at = c.look_at.map_or(center, Vec3::from_array);
        let from = c.look_from.map_or_else(
            || {
                // A three-quarter view from a little above, far enough for all of it.
                let half = (0.5 * film.width_mm.min(film.height_mm) / focal_mm).atan() as f32;
                at + Vec3::new(0.45, 0.25, 1.0).normalize() * (radius / half.sin() * 1.05)
            },
            Vec3::from_array,
        );
        (look_at(from, at, up)?, (at - from).length() as f64)
    } else if let Some(framing) = framing {
        (look_at(framing.look_from, framing.look_at, Vec3::Y)?, framing.focus_m)
    } else {
        let place = view.map_or(Affine3A::IDENTITY, |v| v.world_from_camera);
        let ahead = (center - Vec3::from(place.translation)).dot(place.transform_vector3(Vec3::NEG_Z));
        (place, ahead.max(0.1 * radius) as f64)
    };
    if !place.is_finite() {
        return Err(value("viewpoint", "the scene's camera", "a place that is finite"));
    }

    let f_number = file.exposure.aperture.map_or(framing.map_or(5.6, |f| f.f_number), |a| a.0);
    let focus = match file.focus.distance.map_or(subject_m, |d| d.0) {
        d if d.is_infinite() => Focus::Infinity,
        d => Focus::Distance(Millimeters(d * 1000.0)),
    };
    let lens = match c.lens.as_deref() {
        Some("pinhole") => Lens::Pinhole(Pinhole::new(Millimeters(focal_mm), f_number)?),
        None | Some("thin") => Lens::Thin(ThinLens::new(Millimeters(focal_mm), f_number, iris(c)?.unwrap_or_default(), focus)?),
        Some(name) => {
            let prescription = read_lens(name)?;
            prescription.notes.iter().for_each(|n| warn(&format!("{name}: {n}")));
            let circle = prescription.image_circle;
            let mut setting = Setting {
                focal_length: c.focal_length.map(|f| f.0),
                f_number: Some(f_number),
                focus,
                iris: iris(c)?,
                film_mm: [film.width_mm, film.height_mm],
            };
            let prescription = std::sync::Arc::new(prescription);
            let mut lens = CompoundLens::new(prescription.clone(), &setting);
            if file.exposure.aperture.is_none() && lens.is_err() {
                // Nobody asked for this aperture: as wide as the lens goes.
                setting.f_number = None;
                lens = CompoundLens::new(prescription, &setting);
            }
            let lens = lens?;
            if let Some(asked) = file.exposure.aperture.filter(|a| lens.f_number() > a.0 * 1.005) {
                warn(&format!("{name}: fully open it is f/{:.2}, which is what f/{} stands for", lens.f_number(), asked.0));
            }
            let diagonal = film.width_mm.hypot(film.height_mm);
            if let Some(circle) = circle.filter(|c| diagonal > 1.05 * c) {
                warn(&format!("{name} was made for pictures of {circle} mm across: the film ({diagonal:.1} mm) is larger"));
            }
            Lens::Compound(Box::new(lens))
        }
    };
    Ok(Camera { lens, film, world_from_camera: place })
}
