//! A photograph as a user asks for it: a shot file (TOML) or flags → checked → taken.
//!
//! [`ShotFile`] is what was written; [`Shot::prepare`] reads the scene, checks every number and fills in what was left open
//! ([`Shot::prepare_with`] takes scene, lens and body from memory instead);
//! [`Shot::meter`] lets the camera choose what it is to choose; [`Shot::expose`], [`Shot::read_out`] and [`Shot::develop`] are the
//! photograph. [`Shot::advance_to`] takes the next one of a sequence.

mod asked;
mod change;
pub(crate) mod error;
mod error_parts;
mod exposing;
pub mod file;
pub mod flag_values;
mod focusing;
mod framing;
mod inputs;
mod light;
mod light_field;
mod memory;
mod readings;
mod resume;
mod scene_cache;
mod scene_setup;
pub mod sections;
mod sequence;
pub mod setting;
mod settle;
mod sources;
mod surroundings;
mod taking;
mod time_limit;
mod timing;
mod vary;

use asked::ShotRequest;
pub use error::ShotError;
pub(crate) use error::value;
pub use error_parts::ErrorParts;
pub use file::ShotFile;
pub use flag_values::MOST_SAMPLES;
pub use inputs::Inputs;
pub use memory::ExposureUse;
pub use scene_cache::SceneCache;
pub use sections::{DiffractionChoice, FireflyChoice};
pub use sequence::{Sequence, Vary};
pub use sources::{is_scene_file, lens_beside, odd_size, read_body, read_environment, read_lens, read_scene};
pub use surroundings::daylight;
pub(crate) use vary::is_of_scene;

use crate::calibration::{self, Calibration, CalibrationError, Frame, ModelKind, PrincipalRay};
use crate::camera::Camera;
use crate::denoising::{Denoise, Filter};
use crate::expose::Settings;
use crate::moving_part::MovingState;
use crate::quantity::SpectralBands;
use crate::stabiliser::Stabiliser;
use crate::{lens_profile, recipe_file};
use diopter_develop::lut::Lut;
use diopter_develop::{Geometry, Recipe};
use diopter_image::ExposureFacts;
use diopter_image::focal_plane::FocalPlaneSource;
use diopter_lens::{Lens, Projection};
use diopter_light::cie;
use diopter_scene::bvh::Bounds;
use diopter_scene::{Scene, SceneError, builtin};
use diopter_sensor::format;
use diopter_sensor::{ColorSampling, Reading, Sensor};
use exposing::Exposing;
use focusing::Focusing;
use glam::{Affine3A, Vec3};
use std::time::Instant;
use timing::Timing;

/// Most pixels a side of a picture.
pub const LARGEST_SIDE: usize = 65_535;
const DEFAULT_SPP: u32 = 64;
pub(crate) const DEFAULT_SEED: u64 = 1;
const DEFAULT_SCENE: &str = "still-life";
const DEFAULT_BODY: &str = "canon-5d-mark-iv";

/// An exposure that memory cannot hold, to be written strip by strip.
pub struct ExposedStrips<'a> {
    /// All samples that were taken.
    pub plane: Box<dyn FocalPlaneSource + 'a>,
    /// Whether it was stopped before the last sample that was asked for.
    pub stopped: bool,
}

/// A photograph ready to be taken.
pub struct Shot {
    /// The scene, built.
    pub scene: Scene,
    /// The camera, placed and focused.
    pub camera: Camera,
    /// The body's sensor.
    pub sensor: Sensor,
    /// Exposure time, s; known after metering.
    pub shutter: Option<f64>,
    /// How the sensor is read.
    pub reading: Reading,
    /// Which colours its pixels are read in.
    pub color_sampling: ColorSampling,
    /// When it is taken, as EXIF writes it; whoever owns a clock says so.
    pub date: Option<String>,
    /// No light reaches the film.
    pub lens_cap: bool,
    /// Sampling. A time limit counts from [`Shot::prepare`] on and holds for all of the photograph; of a sequence, for each picture.
    pub settings: Settings,
    /// Expose linear sRGB (cd/m²) of the light that arrives instead of the sensor's electrons.
    pub radiance: bool,
    /// Expose the mean spectral radiance of these bands instead.
    pub spectral: Option<SpectralBands>,
    /// Compute that of [`Shot::radiance`] with red, green and blue instead of wavelengths, as RGB renderers do.
    pub rgb: bool,
    /// Whether the renderer's own noise is reduced.
    denoise: Denoise,
    /// By what; `None` where it is not, or not yet known ([`Shot::prepare_pictures`]).
    filter: Option<Filter>,
    /// What becomes of outliers when the samples end: kept by default. See [`Shot::reweights`].
    pub fireflies: FireflyChoice,
    /// Whether light is diffracted at the aperture. See [`Shot::diffracts`].
    pub diffraction: DiffractionChoice,
    /// Where it is: what lamps send far out is spread apart, without the noise of rare samples, for some memory. See [`Shot::separates_starbursts`].
    pub starbursts: bool,
    /// Development.
    pub recipe: Recipe,
    /// The look-up table that the recipe names.
    pub lut: Option<Lut>,
    /// When this picture was begun.
    begun: Instant,
    /// Where the camera stands if nothing moves it.
    placed: Affine3A,
    /// What was asked.
    file: ShotFile,
    /// Whether the lens is set many times a second ([`Inputs::draft`]).
    draft: bool,
    /// Requested metered EV of the scene.
    ambient_ev: Option<f64>,
    exposing: Exposing,
    focusing: Focusing,
    /// By which pictures are brightened when they are developed, EV.
    baseline_ev: f64,
    /// The same of pictures of half of the photodiodes, which have half of the light, EV.
    half_ev: f64,
    /// T-number and time that the pictures of an exposure bracket are counted from, while one is taken.
    bracket_from: Option<(f64, Option<f64>)>,
    /// Whether the light of a scene without a scale has got one.
    light_settled: bool,
    /// Lamps, sky or ground of the scene were placed by where the camera stands.
    lights_follow_camera: bool,
    /// What denoising will take by a trial, s; known after metering with a time limit.
    denoising_s: Option<f64>,
    timing: Timing,
    /// What moves against the shake of the camera.
    stabiliser: Option<Stabiliser>,
    facts: ExposureFacts,
}

/// Steps of an exposure at which a calibration says where what moves against shake stands.
const MOVING_STEPS: usize = 100;

impl Shot {
    /// Checks a request, reads its files and builds the scene. `warn` gets what was found odd. Fails on a value out of its range or a name that is not known, on files
    /// that cannot be read, on an empty scene, and where the camera cannot be placed or focused as asked.
    pub fn prepare(file: &ShotFile, warn: &mut dyn FnMut(&str)) -> Result<Shot, ShotError> {
        Shot::prepare_with(file, Inputs::default(), warn)
    }

    /// The same with scene, lens or body from memory instead of by the names that the shot file has for them. [`Shot::write_resolved`] writes names
    /// only: a shot file cannot hold what was in memory. Fails as [`Shot::prepare`].
    pub fn prepare_with(file: &ShotFile, inputs: Inputs, warn: &mut dyn FnMut(&str)) -> Result<Shot, ShotError> {
        Shot::prepare_cached(file, inputs, &mut SceneCache::new(), warn)
    }

    /// The same for one of many shots: a scene that the last shot has read or built is taken from `cache`. Fails as [`Shot::prepare`].
    pub fn prepare_cached(
        file: &ShotFile,
        mut inputs: Inputs,
        cache: &mut SceneCache,
        warn: &mut dyn FnMut(&str),
    ) -> Result<Shot, ShotError> {
        let begun = Instant::now();
        // Cheap checks before anything is read.
        let mut file = file.clone();
        inputs.name_in(&mut file);
        file.apply_true_stops();
        let mut asked = ShotRequest::new(&file, &inputs, warn)?;
        let lut = recipe_file::lut(&file.develop)?;
        Timing::new(&file, &asked.sensor, None)?;

        let name = file.scene.file.clone().unwrap_or_else(|| DEFAULT_SCENE.into());
        scene_setup::film(&file, &asked.sensor, None)?;
        let mut description = cache.description(&mut inputs, &name, &file.scene, warn)?;
        let view = scene_setup::view(&file, &description)?;
        if let Some(hints) = view.map(|v| &v.film).filter(|_| file.camera.look_from.is_none())
            && scene_setup::apply_film_hints(&mut file, hints, warn)
        {
            asked.set_body(&file, &inputs)?;
        }
        let mut film = scene_setup::film(&file, &asked.sensor, view)?;
        let calibrated = scene_setup::calibrated(&mut file, &asked.sensor, view, &mut film)?;
        scene_setup::resolve_angle_of_view(&mut file, &film)?;
        let file = file;
        let mut timing = Timing::new(&file, &asked.sensor, view)?;
        timing.mounted.clone_from(&inputs.mounted);
        let focusing = Focusing::new(&file, film.width_mm.hypot(film.height_mm), warn)?;
        timing.play(&mut description, &file.scene)?;
        scene_setup::choose_materials(&mut description, &file.scene)?;
        scene_setup::choose_classes(&mut description, &file.scene, warn)?;
        // Lamps and ground are put where they suit the camera: it is placed first.
        let framing = builtin::framing(&name);
        let mut placement = scene_setup::placement(&file, &inputs, &description, timing.at_s, &asked.sensor, &film, framing)?;
        placement.calibrated = calibrated;
        let flash = timing.flash.is_some();
        let lights_follow_camera = surroundings::follow_camera(&description, &file.scene, flash);
        let scene_name = description.name.clone();
        let dicing_rate = scene_setup::dicing_rate(&file, &description, &film, &placement, warn)?;
        let mut scene = cache.scene(description, &file.scene, &timing, &placement, dicing_rate, warn)?;
        scene.pose(timing.at_s, 0.0);
        if scene.bounds().is_empty() && scene.description().environment.is_none() {
            return Err(SceneError::Empty("it has no surface and no environment".into()).into());
        }

        let bounds = scene_setup::subject_bounds(&scene, timing.at_s);
        timing.build_path(&file, if bounds.is_empty() { Vec3::ZERO } else { bounds.center() })?;
        if file.camera.look_from.is_some() && !file.camera.path.is_empty() {
            warn("the camera is on a path: look_from is not used");
        }
        let camera = scene_setup::camera(&file, &inputs, &scene, timing.at_s, &asked.sensor, film, &focusing, &placement, warn)?;
        timing.carrier = placement.carrier;
        if file.scene.light.is_none() && !flash && sources::is_model(&name) && scene_setup::is_in_void(&scene, &camera) {
            warn(
                "the scene has light of its own before a black background, which the meter leaves out: --light studio lights everything, --light none keeps it as it is",
            );
        }
        if scene.splat_count() > 0 && file.scene.ambient_ev.is_none() {
            warn(&format!(
                "a splat capture has no absolute luminance: its white is taken for {} cd/m², that of a display (--ambient-ev EV says how bright it is)",
                diopter_scene::load::splats::WHITE
            ));
        }
        if let Some(fog) = &file.scene.fog {
            surroundings::add_fog(&mut scene, fog, camera.motion.at(0.0).translation.into())?;
        }
        asked::check_camera(&file, &camera, warn)?;
        let stabiliser = scene_setup::stabiliser(&file, &camera, &timing)?;
        let facts = asked.facts(scene_name, lens_facts(&camera, &asked.sensor, wants_profile(&file, inputs.draft)));
        let reading = asked.reading(&file);
        let ShotRequest { settings, sensor, exposing, denoise, filter, .. } = asked;
        let placed = camera.motion.at(0.0);
        let mut shot = Shot {
            scene,
            camera,
            sensor,
            shutter: file.exposure.shutter.map(|s| s.0),
            reading,
            color_sampling: file.camera.color_sampling.unwrap_or_default(),
            date: None,
            lens_cap: file.exposure.lens_cap,
            settings,
            radiance: false,
            spectral: None,
            rgb: false,
            denoise,
            filter,
            fireflies: file.render.fireflies.unwrap_or_default(),
            diffraction: asked::diffraction(&file.render),
            starbursts: true,
            recipe: file.develop.clone(),
            lut,
            ambient_ev: file.scene.ambient_ev,
            begun,
            placed,
            file,
            draft: inputs.draft,
            exposing,
            focusing,
            baseline_ev: 0.0,
            bracket_from: None,
            half_ev: 0.0,
            light_settled: false,
            lights_follow_camera,
            denoising_s: None,
            timing,
            stabiliser,
            facts,
        };
        shot.attach_flash();
        Ok(shot)
    }

    /// The box around what is photographed, without ground and studio that were put there for it.
    pub fn subject_bounds(&self) -> Bounds {
        scene_setup::subject_bounds(&self.scene, self.timing.at_s)
    }

    /// The moment the first exposure of a sequence begins, s of scene time.
    pub fn begun_s(&self) -> f64 {
        self.file.scene.at.map_or(0.0, |s| s.0)
    }

    /// The moment the exposure begins, s of scene time.
    pub fn at_s(&self) -> f64 {
        self.timing.at_s
    }

    /// The calibration of the camera as it stands, for what its sensor takes, with its places during this exposure; `picture`: the name of the picture's file. A suitable
    /// model is fitted to a lens that is none itself. Fails where no model comes near the lens.
    pub fn calibration(&self, picture: &str) -> Result<Calibration, CalibrationError> {
        self.calibration_of(picture, false, None)
    }

    /// The same of what is taken, or of the developed picture (`is_developed`), which may be smaller, and straight where the lens is not; with a model of a kind, where one is asked for.
    pub fn calibration_of(
        &self,
        picture: &str,
        is_developed: bool,
        kind: Option<ModelKind>,
    ) -> Result<Calibration, CalibrationError> {
        let taken = calibration::of_camera(&self.camera, kind, PrincipalRay::CHIEF)?;
        let mut calibration = if is_developed { taken.developed(&self.geometry()) } else { taken };
        (calibration.body, calibration.lens) = (self.facts.body.clone(), self.facts.lens.clone());
        calibration.frames = vec![self.calibration_frame(picture)];
        Ok(calibration)
    }

    /// Where the development puts what the sensor takes.
    pub fn geometry(&self) -> Geometry {
        let film = &self.camera.film;
        Geometry::of(&self.sensor.cfa, [film.columns, film.rows], &self.recipe, self.facts.lens_profile.as_ref())
    }

    /// Refuses corrections of the lens in a development where nothing is known of what it does. Fails before the exposure as the development would behind it.
    pub fn check_development(&self) -> Result<(), ShotError> {
        if self.recipe.lens != Default::default() && self.facts.lens_profile.is_none() {
            return Err(ShotError::Recipe(diopter_develop::unknown_lens()));
        }
        Ok(())
    }

    /// Where the camera is during this exposure.
    pub fn calibration_frame(&self, picture: &str) -> Frame {
        let size = [self.camera.film.columns, self.camera.film.rows];
        let times = self.shutter().facts(size, self.pupil()).rows;
        let poses = calibration::pose::poses(&self.camera.motion, &times, size);
        Frame { picture: picture.into(), at_s: self.timing.at_s, camera: None, poses, moving: self.moving_states() }
    }

    /// Where what moves against the shake stands at equal steps of this exposure; empty where nothing does.
    pub fn moving_states(&self) -> Vec<MovingState> {
        let film = &self.camera.film;
        let (film_mm, size) = ([film.width_mm, film.height_mm], [film.columns, film.rows]);
        self.camera.motion.moving().map_or(Vec::new(), |moving| moving.states(moving.moments(MOVING_STEPS), film_mm, size))
    }
}

/// An illuminant by name (`D65`, `A` ...), as the camera's white. Fails on a name that is not known.
pub fn white_point(name: &str) -> Result<diopter_light::spectrum::Table, ShotError> {
    cie::illuminant(name)
        .ok_or_else(|| value("white", format!("\"{name}\""), format!("one of {}", cie::illuminant_names().join(", "))))
}

/// A long time as one says it: "45 s", "10397 s (2.9 h)".
fn long_time(s: f64) -> String {
    match s {
        s if s < 120.0 => format!("{s:.0} s"),
        s if s < 7200.0 => format!("{s:.0} s ({:.0} min)", s / 60.0),
        s if s < 172_800.0 => format!("{s:.0} s ({:.1} h)", s / 3600.0),
        s => format!("{s:.0} s ({:.1} days)", s / 86_400.0),
    }
}

/// The distance in metres that is just this one in millimetres when it is multiplied by 1000.
fn metres_of(mm: f64) -> Option<f64> {
    let m = mm / 1000.0;
    [m, m.next_up(), m.next_down()].into_iter().find(|m| m * 1000.0 == mm)
}

/// ", text" or nothing.
fn with_comma(text: String) -> String {
    if text.is_empty() { text } else { format!(", {text}") }
}

/// Whether the profile of the lens is computed: for files, which hold it, always; for a draft where the development corrects by it.
fn wants_profile(file: &ShotFile, draft: bool) -> bool {
    !draft || file.develop.lens != Default::default()
}

/// What is known of an exposure from its lens.
fn lens_facts(camera: &Camera, sensor: &Sensor, with_profile: bool) -> ExposureFacts {
    let lens_name = match &camera.lens {
        Lens::Pinhole(hole) => match hole.projection {
            Projection::Rectilinear => "pinhole".to_owned(),
            Projection::Orthographic { .. } => "orthographic".to_owned(),
            Projection::Panorama { .. } => "panorama".to_owned(),
        },
        Lens::Thin(l) => {
            let iris = with_comma(l.iris.describe());
            format!("thin lens {:.4} mm{iris}", l.focal_length.0).replace(".0000", "")
        }
        Lens::Compound(l) => {
            format!("{}{}", l.prescription().name, with_comma(l.system().iris.shape.describe()))
        }
        Lens::Calibrated(l) => l.name.clone(),
    };
    let focal = match &camera.lens {
        // What has no centre of projection, or sees all around, has no focal length that could tell a field of view.
        Lens::Pinhole(hole) if hole.projection != Projection::Rectilinear => 0.0,
        lens => lens.focal_length().0,
    };
    ExposureFacts {
        lens: lens_name,
        focal_length_mm: focal,
        focal_length_35mm_mm: format::equivalent_35mm(focal, camera.film.width_mm.hypot(camera.film.height_mm)),
        f_number: camera.lens.f_number(),
        t_number: camera.lens.t_number(),
        focus_distance_m: camera.lens.focus_distance().map(|d| d.0 / 1000.0),
        extension_mm: camera.lens.extension().0,
        lens_range: match &camera.lens {
            Lens::Compound(l) => Some(l.range()),
            _ => None,
        },
        lens_profile: match &camera.lens {
            // The corrections of the development are centred on the picture.
            Lens::Compound(l) if camera.film.center_mm != [0.0; 2] || l.is_tilted() || !with_profile => None,
            Lens::Compound(l) => lens_profile::profile(l, sensor, 0.5 * camera.film.width_mm.hypot(camera.film.height_mm)),
            _ => None,
        },
        light_field: camera.light_field_facts(),
        ..Default::default()
    }
}
