//! A photograph as a user asks for it: a shot file (TOML) or flags → checked → taken.
//!
//! [`ShotFile`] is what was written; [`Shot::prepare`] reads the scene, checks every number and fills in what was left open
//! ([`Shot::prepare_with`] takes scene, lens and body from memory instead);
//! [`Shot::meter`] lets the camera choose what it is to choose; [`Shot::expose`], [`Shot::read_out`] and [`Shot::develop`] are the
//! photograph. [`Shot::turn_to`] takes the next one of a sequence.

mod asked;
mod change;
mod error_parts;
pub mod file;
mod focusing;
mod framing;
mod inputs;
mod light_field;
mod memory;
mod readings;
mod resume;
mod scene_cache;
mod sequence;
mod sources;
mod staging;
mod surroundings;
mod time_limit;
mod timing;
mod vary;

use asked::Asked;
pub use error_parts::ErrorParts;
pub use file::{DiffractionChoice, FireflyChoice, ShotFile};
pub use inputs::Inputs;
pub use memory::Kept;
pub use scene_cache::SceneCache;
pub use sequence::{Sequence, Vary};
pub use sources::{is_scene_file, lens_beside, odd_size, read_body, read_environment, read_lens, read_scene};
pub use surroundings::daylight;
pub use vary::VARIABLES;

use crate::calibration::{self, Calibration, CalibrationError, Frame, PrincipalRay};
use crate::camera::{Camera, Film, PlacementError};
use crate::camera_motion::CameraMotion;
use crate::denoising::{BUILT_IN, Denoise, Filter};
use crate::expose::{
    self, Diffraction, ExposeError, Exposed, Exposure, Fireflies, Frames, Keep, Response, Settings, Sums, Watch,
};
use crate::flash::Flash;
use crate::metering::{self, Meter, Pattern};
use crate::program::{self, Chosen, Limits, Mode};
use crate::quantity::{Distance, FNumber, FocusTo, LengthMm, Seconds, Size, SpectralBands};
use crate::quick_look::{self, Optics};
use crate::row_store::PagedRows;
use crate::shutter::{Shutter, ShutterTimes};
use crate::stabiliser::{MovingState, Stabiliser};
use crate::stray::WithStray;
use crate::{lens_profile, recipe_file};
use diopter_develop::denoise::Denoised;
use diopter_develop::lut::Lut;
use diopter_develop::{Recipe, RecipeError, develop};
use diopter_image::focal_plane::{FocalPlaneSource, Truth};
use diopter_image::{ExposureFacts, FocalPlane, Picture, Raster, RawImage};
use diopter_lens::{Focus, Lens, LensError, Projection};
use diopter_light::cie;
use diopter_scene::bvh::Bounds;
use diopter_scene::light::Modulation;
use diopter_scene::studio::Studio;
use diopter_scene::{Scene, SceneError, builtin};
use diopter_sensor::format;
use diopter_sensor::{Reading, Sensor, SensorError, read_out};
use focusing::Focusing;
use glam::{Affine3A, Vec3};
use std::ops::RangeInclusive;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;
use timing::Timing;

/// Most pixels a side of a picture.
pub const LARGEST_SIDE: usize = 65_535;
const DEFAULT_SPP: u32 = 64;
/// The same where nothing but denoised pictures is made: what a denoiser makes good of.
const DENOISED_SPP: u32 = 24;
const DEFAULT_ISO: f64 = 100.0;
const DEFAULT_SEED: u64 = 1;
const DEFAULT_SCENE: &str = "still-life";
const DEFAULT_BODY: &str = "canon-5d-mark-iv";

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
    /// A shot file that is no shot file: its grammar, a misspelt key, a value of another kind.
    #[error("{path}: {reason}")]
    Syntax {
        /// The file.
        path: String,
        /// What the parser says, with line and hint.
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
    /// An entry of a file that is made of shots, such as the specification of a data set.
    #[error("{place}: {found}; expected {expected}")]
    Entry {
        /// File and entry.
        place: String,
        /// What is there.
        found: String,
        /// What belongs there, and a hint.
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
    /// A calibration.
    #[error(transparent)]
    Calibration(#[from] CalibrationError),
    /// The exposure was stopped.
    #[error(transparent)]
    Expose(#[from] ExposeError),
    /// Autofocus found nothing, and a picture out of focus is not wanted.
    #[error("autofocus failed: {0} (without --require-focus the picture is taken all the same)")]
    Focus(crate::focus::Failure),
    /// The renderer's noise cannot be reduced as asked.
    #[error("{0}")]
    Denoise(String),
}

impl ShotError {
    /// Whether the user asked for something impossible (rather than something failing on the way).
    pub fn is_request(&self) -> bool {
        let failed = matches!(self, ShotError::Read { .. } | ShotError::Expose(_) | ShotError::Scene(_) | ShotError::Focus(_));
        !failed && !matches!(self, ShotError::Denoise(_))
    }
}

pub(crate) fn value(what: &'static str, found: impl ToString, expected: impl Into<String>) -> ShotError {
    ShotError::Value { what, found: found.to_string(), expected: expected.into() }
}

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
    /// By what; `None` where it is not, or not yet known ([`Shot::denoise_pictures`]).
    filter: Option<Filter>,
    /// What becomes of outliers when the samples end: kept, if nobody says. See [`Shot::reweights`].
    pub fireflies: FireflyChoice,
    /// Whether light is diffracted at the aperture. See [`Shot::diffracts`].
    pub diffraction: DiffractionChoice,
    /// Where it is: what lamps send far out is spread apart, without the noise of rare samples, for some memory. See [`Shot::makes_stars`].
    pub stars: bool,
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
    /// What the camera exposes less because of microlenses, EV.
    held_back_ev: f64,
    /// Whether the light of a scene without a scale has got one.
    light_settled: bool,
    /// Lamps, sky or ground of the scene were placed by where the camera stands.
    lit_for_camera: bool,
    /// What denoising will take by a trial, s; known after metering with a time limit.
    denoising_s: Option<f64>,
    timing: Timing,
    /// What moves against the shake of the camera.
    stabiliser: Option<Stabiliser>,
    facts: ExposureFacts,
}

/// How the exposure is found.
#[derive(Clone, Debug)]
struct Exposing {
    mode: Mode,
    pattern: Pattern,
    at: [f64; 2],
    compensation_ev: f64,
    nd_stops: f64,
    /// Automatic ISO: its limits.
    auto_iso: Option<[f64; 2]>,
    /// The limits of real dials hold.
    dials: bool,
    slowest_s: Option<f64>,
    step: Option<crate::stops::Step>,
}

/// Steps of an exposure at which a calibration says where what moves against shake stands.
const MOVING_STEPS: usize = 100;

impl Shot {
    /// Checks a request, reads its files and builds the scene. `warn` gets what was found odd.
    pub fn prepare(file: &ShotFile, warn: &mut dyn FnMut(&str)) -> Result<Shot, ShotError> {
        Shot::prepare_with(file, Inputs::default(), warn)
    }

    /// The same with scene, lens or body from memory instead of by the names that the shot file has for them. [`Shot::settle`] writes names
    /// only: a shot file cannot hold what was in memory.
    pub fn prepare_with(file: &ShotFile, inputs: Inputs, warn: &mut dyn FnMut(&str)) -> Result<Shot, ShotError> {
        Shot::prepare_cached(file, inputs, &mut SceneCache::new(), warn)
    }

    /// The same for one of many shots: a scene that the last shot has read or built is taken from `cache`.
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
        file.mean_true_stops();
        let mut asked = Asked::new(&file, &inputs, warn)?;
        let lut = recipe_file::lut(&file.develop)?;
        Timing::new(&file, &asked.sensor, None)?;

        let name = file.scene.file.clone().unwrap_or_else(|| DEFAULT_SCENE.into());
        staging::film(&file, &asked.sensor, None)?;
        let mut description = cache.description(&mut inputs, &name, &file.scene, warn)?;
        let view = staging::view(&file, &description)?;
        if let Some(hints) = view.map(|v| &v.film).filter(|_| file.camera.look_from.is_none())
            && staging::take_hints(&mut file, hints, warn)
        {
            asked.take_body(&file, &inputs)?;
        }
        let mut film = staging::film(&file, &asked.sensor, view)?;
        let calibrated = staging::calibrated(&mut file, &asked.sensor, view, &mut film)?;
        staging::take_angle_of_view(&mut file, &film)?;
        let file = file;
        let mut timing = Timing::new(&file, &asked.sensor, view)?;
        timing.way.clone_from(&inputs.way);
        let focusing = Focusing::new(&file, film.width_mm.hypot(film.height_mm), warn)?;
        timing.play(&mut description, &file.scene)?;
        staging::choose_materials(&mut description, &file.scene)?;
        staging::choose_classes(&mut description, &file.scene, warn)?;
        // Lamps and ground are put where they suit the camera: it is placed first.
        let framing = builtin::framing(&name);
        let mut stand = staging::stand(&file, &inputs, &description, timing.at_s, &asked.sensor, &film, framing)?;
        stand.calibrated = calibrated;
        let flash = timing.flash.is_some();
        let lit_for_camera = surroundings::follow_camera(&description, &file.scene, flash);
        let scene_name = description.name.clone();
        let fineness = staging::fineness(&file, &description, &film, &stand, warn)?;
        let mut scene = cache.scene(description, &file.scene, &timing, &stand, fineness, warn)?;
        scene.pose(timing.at_s, 0.0);
        if scene.bounds().is_empty() && scene.description().environment.is_none() {
            return Err(SceneError::Empty("it has no surface and no environment".into()).into());
        }

        let bounds = staging::subject_bounds(&scene, timing.at_s);
        timing.lay_path(&file, if bounds.is_empty() { Vec3::ZERO } else { bounds.center() })?;
        if file.camera.look_from.is_some() && !file.camera.path.is_empty() {
            warn("the camera is on a path: look_from is not used");
        }
        let camera = staging::camera(&file, &inputs, &scene, timing.at_s, &asked.sensor, film, &focusing, &stand, warn)?;
        timing.carrier = stand.carrier;
        if file.scene.light.is_none() && !flash && sources::is_model(&name) && staging::is_in_void(&scene, &camera) {
            warn(
                "the scene has light of its own in a black void, which the meter leaves out: --light studio lights it all, --light none says that it is meant",
            );
        }
        if scene.splat_count() > 0 && file.scene.ambient_ev.is_none() {
            warn(&format!(
                "a captured place has no unit of light: its white is taken for {} cd/m², that of a display (--ambient-ev EV says how bright it is)",
                diopter_scene::load::splats::WHITE
            ));
        }
        if let Some(fog) = &file.scene.fog {
            surroundings::put_fog(&mut scene, fog, camera.way.at(0.0).translation.into())?;
        }
        asked::check_camera(&file.render, &camera, warn)?;
        let stabiliser = staging::stabiliser(&file, &camera, &timing)?;
        let facts = asked.facts(scene_name, lens_facts(&camera, &asked.sensor, wants_profile(&file, inputs.draft)));
        let reading = asked.reading(&file);
        let Asked { settings, sensor, exposing, denoise, filter, .. } = asked;
        let placed = camera.way.at(0.0);
        let mut shot = Shot {
            scene,
            camera,
            sensor,
            shutter: file.exposure.shutter.map(|s| s.0),
            reading,
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
            stars: true,
            recipe: file.develop.clone(),
            lut,
            ambient_ev: file.scene.ambient_ev,
            begun,
            placed,
            file,
            draft: inputs.draft,
            exposing,
            focusing,
            held_back_ev: 0.0,
            light_settled: false,
            lit_for_camera,
            denoising_s: None,
            timing,
            stabiliser,
            facts,
        };
        shot.attach_flash();
        Ok(shot)
    }

    /// Takes over the scale of the light from another shot of the same scene, so that both see the same light whatever their frames are.
    pub fn take_light_of(&mut self, other: &Shot) {
        if other.light_settled || self.ambient_ev.is_none() {
            self.settings.light_scale = other.settings.light_scale;
            self.light_settled = true;
        }
    }

    /// Meters the scene and settles what was left open: light scale, exposure time, aperture, ISO. Then everything stands ready for
    /// the exposure. `warn` gets what the light or the shutter does not allow.
    pub fn meter(&mut self, watch: &Watch, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        if self.lens_cap {
            return self.set_by(None, warn);
        }
        self.settle_light(watch)?;
        let white = white_point(&self.reading.white)?;
        let meter = Meter {
            sensor: &self.sensor,
            reading: &self.reading,
            pattern: self.exposing.pattern,
            at: self.exposing.at,
            filter: (-self.exposing.nd_stops).exp2(),
        };
        let metered = meter.read(&self.scene, &self.camera, &self.settings, &white, watch)?;
        self.set_by(metered, warn)
    }

    /// Whether the camera chooses an aperture, a time or an ISO speed by its meter.
    pub fn chooses_exposure(&self) -> bool {
        self.exposing.mode != Mode::Manual || self.exposing.auto_iso.is_some()
    }

    /// The same as [`Shot::meter`], but where everything is set by hand the meter is not read: nothing depends on it but its fact, which is left out.
    pub fn meter_if_needed(&mut self, watch: &Watch, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        if self.chooses_exposure() {
            return self.meter(watch, warn);
        }
        self.settle_light(watch)?;
        self.set_by(None, warn)?;
        self.facts.metering = String::new();
        Ok(())
    }

    /// Chooses what the camera is to choose by a meter reading (EV at ISO 100; `None`: darkness), and makes everything ready for the exposure:
    /// [`Shot::meter`] by a reading at hand. With the cap on the lens the reading is not looked at.
    pub fn set_by(&mut self, metered: Option<f64>, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        if self.lens_cap {
            self.shutter.get_or_insert(1.0);
            return self.stand_ready(warn);
        }
        self.facts.metering = self.exposing.pattern.name().into();
        self.facts.metered_ev100 = metered;
        let e = self.exposing.clone();
        let chosen_by_camera = self.chooses_exposure();
        // Behind microlenses the light is gathered on a part of the pixels: they must not be blown, and are brightened when developed.
        self.held_back_ev = if chosen_by_camera { self.gathered_ev() } else { 0.0 };
        // Without any light any exposure will do.
        let ev100 = metered.unwrap_or(0.0) - e.compensation_ev + self.held_back_ev;
        if chosen_by_camera {
            let (limits, set) = (self.limits(), self.set());
            let chosen = program::choose(e.mode, ev100, set, &limits);
            if (chosen.aperture / set.aperture - 1.0).abs() > 1e-9 {
                self.open_to(chosen.aperture)?;
            }
            // A leaf shutter is worth more than its marked time to a small pupil.
            let pupil = self.pupil();
            let marked = match e.mode {
                Mode::AperturePriority | Mode::Program => self.shutter().marked_for(chosen.time_s, pupil),
                _ => chosen.time_s,
            };
            self.shutter = Some(marked);
            self.reading.iso = chosen.iso;
            let worth = self.shutter().effective_s(pupil);
            let off = ev100 - metering::ev100_of_setting(chosen.aperture, worth, chosen.iso);
            if metered.is_some() && off.abs() > 0.34 {
                warn(&format!(
                    "the light is {:.1} EV too {} for what the camera may choose in mode {}: the picture will be {}",
                    off.abs(),
                    if off > 0.0 { "bright" } else { "dark" },
                    e.mode.name(),
                    if off > 0.0 { "light" } else { "dark" }
                ));
            }
            let chosen_time = matches!(e.mode, Mode::AperturePriority | Mode::Program);
            if let Some(ev) = metered.filter(|_| chosen_time && marked > LONG_S) {
                let scene = &self.file.scene;
                // A picture around the scene is light enough, if its numbers are no cd/m².
                let relative = scene.environment.is_some() && scene.environment_scale.is_none() && scene.ambient_ev.is_none();
                let hint = match relative {
                    true => {
                        "the numbers of --environment count as cd/m²: if they are relative, give the file as --light, or say how bright it is by --ambient-ev 12"
                    }
                    false => {
                        "give the scene light (--light studio, --sun 30,120, --light FILE.hdr or --flash 40), open the lens, or take --iso auto"
                    }
                };
                warn(&format!(
                    "there is little light (EV {ev:.1}): mode {} takes {}, longer than cameras choose by themselves ({LONG_S} s); {hint}",
                    e.mode.name(),
                    long_time(marked)
                ));
            }
        }
        self.stand_ready(warn)?;
        self.keep_to_time_limit(warn);
        Ok(())
    }

    /// What is set by hand, apertures as T-stops.
    fn set(&self) -> Chosen {
        Chosen { aperture: self.facts.t_number, time_s: self.shutter.unwrap_or(1.0 / 125.0), iso: self.reading.iso }
    }

    fn limits(&self) -> Limits {
        let e = &self.exposing;
        let loss = self.facts.t_number / self.facts.f_number;
        let (widest, smallest) = (self.camera.lens.widest_f_number(), SMALLEST_STOP);
        let handheld_s = e.slowest_s.unwrap_or(1.0 / self.facts.focal_length_35mm_mm.max(1.0));
        Limits {
            aperture: [widest * loss, smallest.max(widest) * loss],
            time_s: if e.dials { DIAL_TIMES_S } else { [1e-7, 1e6] },
            iso: e.auto_iso.unwrap_or([self.reading.iso; 2]),
            handheld_s,
            step: e.step,
            t_per_f: loss,
        }
    }

    /// Sets the lens to another T-stop.
    fn open_to(&mut self, t_number: f64) -> Result<(), ShotError> {
        // By rounding a lens fully open could be asked for more than that.
        let widest = self.limits().aperture[0];
        self.camera.lens = self.camera.lens.stopped(self.f_number_of(t_number.max(widest)))?;
        self.know_the_lens();
        Ok(())
    }

    /// Writes into the facts what follows from how the lens is set.
    fn know_the_lens(&mut self) {
        let new = lens_facts(&self.camera, &self.sensor, wants_profile(&self.file, self.draft));
        let f = &mut self.facts;
        (f.f_number, f.t_number, f.lens_profile) = (new.f_number, new.t_number, new.lens_profile);
        (f.focus_distance_m, f.extension_mm, f.light_field) = (new.focus_distance_m, new.extension_mm, new.light_field);
    }

    /// How much brighter the images of the pupil behind microlenses are than the film would be, EV; 0 without.
    fn gathered_ev(&self) -> f64 {
        let fraction = self.camera.film.microlenses.map(|m| m.concentration(self.camera.lens.pupil_slope()));
        fraction.map_or(0.0, |s| s.log2().max(0.0))
    }

    /// Radius of the pupil, 1 when the lens is fully open.
    fn pupil(&self) -> f64 {
        (self.camera.lens.widest_f_number() / self.facts.f_number).min(1.0)
    }

    /// The shutter as it is set.
    pub fn shutter(&self) -> Shutter {
        Shutter { mechanism: self.timing.mechanism, exposure_s: self.shutter.unwrap_or(1.0) }
    }

    /// Where the camera is, and what moves in it, during an exposure of a length, s.
    fn way(&self, timing: &Timing, total_s: f64) -> Result<CameraMotion, ShotError> {
        let way = timing.camera_motion(&self.scene, self.placed, total_s);
        match &self.stabiliser {
            None => Ok(way),
            Some(stabiliser) => Ok(way.with_moving(Arc::new(timing.moving_part(stabiliser, &self.camera, total_s)?))),
        }
    }

    /// Poses the scene and the camera for the exposure, and sets the flash.
    fn stand_ready(&mut self, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        let shutter = self.shutter();
        let total = shutter.total_s();
        let at = self.timing.at_s;
        self.camera.way = self.way(&self.timing, total)?;
        if let Some(moving) = self.camera.way.moving().filter(|moving| moving.stopped()) {
            warn(&format!(
                "the stabiliser comes to its stop, {:.3} mm from the axis: the rest of the shake is in the picture",
                moving.farthest_mm()
            ));
        }
        self.settings.shutter_times = ShutterTimes::default();
        if let Some(flash) = &self.timing.flash
            && let Some((node, material)) = Flash::place_in(self.scene.description())
        {
            let (moment, all) = flash.moment(&shutter);
            self.timing.warn_of_sync(&shutter, moment, all, warn);
            self.settings.shutter_times.flash = Some(moment);
            // The flash is what it is, however the light of the scene is scaled.
            let energy = 1.0 / self.settings.light_scale;
            let pulse = Modulation::Pulse { start_s: moment.0, length_s: moment.1 - moment.0, energy };
            self.scene.modulate(material, pulse);
            self.scene.place_node(node, self.camera.way.at(moment.0));
        }
        self.scene.pose(at, total);
        self.timing.warn_of_end(&self.scene, total, warn);
        Timing::warn_of_coarse(&self.scene, warn);
        self.facts.at_s = at;
        self.facts.flash = self.timing.flash.is_some() && !self.lens_cap;
        self.facts.shutter = Some(shutter.facts([self.camera.film.columns, self.camera.film.rows], self.pupil()));
        Ok(())
    }

    /// Makes the shot ready for another moment (s) of the scene, with everything set as it is: a frame of a sequence, with noise of its
    /// own.
    pub fn turn_to(&mut self, at_s: f64, frame: u64, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        if frame > 0 {
            self.begun = Instant::now();
        }
        self.timing.at_s = at_s;
        let seed = self.file.render.seed.unwrap_or(DEFAULT_SEED);
        self.settings.seed = seed.wrapping_add(frame);
        self.reading.seed = seed.wrapping_add(frame);
        self.stand_ready(warn)?;
        self.follow(warn)
    }

    /// What an exposure series varies when nobody says: the aperture where the time is set by hand and kept, else the time.
    pub fn varies(&self) -> Vary {
        if self.exposing.mode == Mode::ShutterPriority { Vary::Aperture } else { Vary::Time }
    }

    /// Changes the exposure by so many EV. `warn` is told when the lens does not go so far.
    pub fn expose_by(&mut self, ev: f64, vary: Vary, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        match vary {
            Vary::Aperture => {
                let wanted = self.facts.t_number * (-0.5 * ev).exp2();
                let [widest, smallest] = self.limits().aperture;
                if !(widest * 0.999..=smallest * 1.001).contains(&wanted) {
                    warn(&format!(
                        "the lens does not go to f/{:.1}: this picture is exposed like another",
                        self.f_number_of(wanted)
                    ));
                }
                self.open_to(wanted.clamp(widest, smallest))
            }
            Vary::Time => {
                self.shutter = self.shutter.map(|t| t * ev.exp2());
                Ok(())
            }
        }
    }

    /// f-number of a T-stop of this lens.
    fn f_number_of(&self, t_number: f64) -> f64 {
        t_number * self.facts.f_number / self.facts.t_number
    }

    /// Writes what was settled into a shot file: it then takes this picture again, whatever the meter says.
    pub fn settle(&self, file: &mut ShotFile) {
        if file.sequence.bracket.is_some() {
            file.sequence.vary = Some(self.varies().name().into());
        }
        if matches!(file.focus.distance, Some(FocusTo::Auto | FocusTo::At(_))) {
            // Where it was found; what follows a thing goes on following it.
            let found = FocusTo::Extension(LengthMm(self.facts.extension_mm));
            file.focus = file::FocusSection { distance: Some(found), ..Default::default() };
        }
        let e = &mut file.exposure;
        e.shutter = self.shutter.map(Seconds);
        if e.aperture.is_some() || matches!(self.exposing.mode, Mode::ShutterPriority | Mode::Program) {
            e.aperture = Some(FNumber(self.facts.f_number));
        }
        e.iso = Some(crate::quantity::IsoChoice::Fixed(crate::quantity::Iso(self.reading.iso)));
        // All is set now; engraved numbers have become what they stand for.
        (e.mode, e.true_stops, e.iso_min, e.iso_max) = (Some(Mode::Manual.name().into()), None, None, None);
        self.write_defaults(file);
    }

    /// Writes into a shot file what nobody had asked for and was used, so that it holds whatever the defaults become. What follows from the
    /// scene alone (a view around a model without cameras) stays out: it is found again.
    fn write_defaults(&self, file: &mut ShotFile) {
        let scene_name =
            file.scene.file.get_or_insert_with(|| self.file.scene.file.clone().unwrap_or_else(|| DEFAULT_SCENE.into())).clone();
        file.scene.at.get_or_insert(Seconds(self.begun_s()));
        if self.scene.description().objects.iter().any(Studio::is_part) {
            file.scene.light.get_or_insert_with(|| "studio".into());
        }
        let c = &mut file.camera;
        c.body.get_or_insert_with(|| self.file.camera.body.clone().unwrap_or_else(|| DEFAULT_BODY.into()));
        c.serial.get_or_insert_with(|| self.reading.serial.clone());
        let placed = c.look_from.is_some() || c.look_at.is_some() || !c.path.is_empty();
        let first = self.scene.description().cameras.first();
        if let Some(framing) = builtin::framing(&scene_name).filter(|_| !placed && first.is_none() && c.up.is_none()) {
            c.look_from = Some(framing.look_from.to_array());
            c.look_at = Some(framing.look_at.to_array());
            file.focus.distance.get_or_insert(FocusTo::Distance(Distance(framing.focus_m)));
        } else if let Some(view) = first.filter(|_| !placed) {
            c.viewpoint.get_or_insert_with(|| if view.name.is_empty() { "0".into() } else { view.name.clone() });
        }
        // Ideal lenses; real ones are named by the shot or belong to the scene.
        let ideal = match &self.camera.lens {
            Lens::Thin(lens) => {
                let metres = match lens.focus {
                    Focus::Infinity => Some(f64::INFINITY),
                    Focus::Distance(mm) => metres_of(mm.0),
                    Focus::Extension(_) => None,
                };
                if let (None, Some(m)) = (&file.focus.distance, metres) {
                    file.focus.distance = Some(FocusTo::Distance(Distance(m)));
                }
                Some("thin")
            }
            Lens::Pinhole(hole) if hole.projection == Projection::Rectilinear => Some("pinhole"),
            _ => None,
        };
        if let Some(name) = ideal {
            c.lens.get_or_insert_with(|| name.into());
            c.focal_length.get_or_insert(LengthMm(self.facts.focal_length_mm));
            // The focal length now says it.
            c.fov_deg = None;
            file.exposure.aperture = Some(FNumber(self.facts.f_number));
        }
        if let Some(facts) = &self.facts.shutter {
            file.shutter.kind.get_or_insert_with(|| facts.kind.clone());
        }
        let e = &mut file.exposure;
        e.metering.get_or_insert_with(|| self.exposing.pattern.name().into());
        e.white.get_or_insert_with(|| self.reading.white.clone());
        e.temperature_c.get_or_insert(self.sensor.temperature_c);
        let r = &mut file.render;
        r.size.get_or_insert(Size { width: self.camera.film.columns, height: self.camera.film.rows });
        if r.time_limit.is_none() {
            r.spp.get_or_insert(self.settings.spp);
        }
        r.seed.get_or_insert(DEFAULT_SEED);
        r.sampler.get_or_insert_with(|| "sobol".into());
        r.max_depth.get_or_insert(self.settings.path.max_depth);
        r.integrator.get_or_insert_with(|| self.settings.integrator.name().into());
        if r.stray.is_none() && self.settings.stray.is_added() {
            r.stray = Some(self.settings.stray.name());
        }
        r.denoise.get_or_insert(self.denoise);
    }

    /// The box around what is photographed, without ground and studio that were put there for it.
    pub fn subject_bounds(&self) -> Bounds {
        staging::subject_bounds(&self.scene, self.timing.at_s)
    }

    /// The moment the first exposure of a sequence begins, s of scene time.
    pub fn begun_s(&self) -> f64 {
        self.file.scene.at.map_or(0.0, |s| s.0)
    }

    /// The moment the exposure begins, s of scene time.
    pub fn at_s(&self) -> f64 {
        self.timing.at_s
    }

    /// The calibration of the camera as it stands, with its places during this exposure; `picture`: the name of the picture's file. A model is fitted to a
    /// lens that is none itself.
    pub fn calibration(&self, picture: &str) -> Result<Calibration, CalibrationError> {
        let mut calibration = calibration::of_camera(&self.camera, None, PrincipalRay::CHIEF)?;
        (calibration.body, calibration.lens) = (self.facts.body.clone(), self.facts.lens.clone());
        calibration.frames = vec![self.calibration_frame(picture)];
        Ok(calibration)
    }

    /// Where the camera is during this exposure.
    pub fn calibration_frame(&self, picture: &str) -> Frame {
        let size = [self.camera.film.columns, self.camera.film.rows];
        let times = self.shutter().facts(size, self.pupil()).rows;
        let poses = calibration::pose::poses(&self.camera.way, &times, size);
        Frame { picture: picture.into(), at_s: self.timing.at_s, poses, moving: self.moving_states() }
    }

    /// Where what moves against the shake stands at equal steps of this exposure; empty where nothing does.
    pub fn moving_states(&self) -> Vec<MovingState> {
        let film = &self.camera.film;
        let (film_mm, size) = ([film.width_mm, film.height_mm], [film.columns, film.rows]);
        self.camera.way.moving().map_or(Vec::new(), |moving| moving.states(moving.moments(MOVING_STEPS), film_mm, size))
    }

    /// Facts as known so far.
    pub fn facts(&self) -> ExposureFacts {
        ExposureFacts { exposure_s: self.shutter.unwrap_or(0.0), iso: self.reading.iso, ..self.facts.clone() }
    }

    /// What the film records.
    fn response(&self) -> Response {
        match &self.spectral {
            Some(bands) => Response::spectral(bands),
            None if self.radiance => Response::linear_srgb(),
            None => Response::sensor(&self.sensor),
        }
    }

    /// Bands that the film records.
    pub fn bands(&self) -> usize {
        self.response().bands.len()
    }

    /// Whether fireflies are re-weighted: if that was asked for, the film counts electrons and all samples are taken at once (parts and what they merge
    /// to keep them).
    pub fn reweights(&self) -> bool {
        let electrons = !self.radiance && self.spectral.is_none();
        self.fireflies == FireflyChoice::Reweight && electrons && !self.lens_cap && self.settings.is_whole()
    }

    /// Whether light is diffracted at the aperture: if that was asked for, or where it shows. Not in a quick look, whose rays know no aperture.
    pub fn diffracts(&self) -> bool {
        self.diffracts_through(&self.camera.lens)
    }

    /// The same with another lens, or the same set otherwise.
    pub(crate) fn diffracts_through(&self, lens: &Lens) -> bool {
        let possible = !self.lens_cap && !self.file.render.quick && !matches!(lens, Lens::Pinhole(_));
        match self.diffraction {
            DiffractionChoice::Off => false,
            DiffractionChoice::On => possible,
            DiffractionChoice::Auto => possible && expose::diffraction_shows(lens, &self.camera.film),
        }
    }

    /// Whether what lamps send far out is spread apart: where there is diffraction and the film counts electrons, which say what a lamp is.
    pub fn makes_stars(&self) -> bool {
        self.stars && !self.radiance && self.spectral.is_none() && self.diffracts()
    }

    /// Bands that the sums of the exposure hold: those of the film, and more where fireflies are re-weighted, where lamps make stars and where direct
    /// light is recorded.
    pub fn summed_bands(&self) -> usize {
        expose::summed_bands(self.bands(), self.reweights(), self.makes_stars(), self.settings.records_direct())
    }

    /// Exposes the film. [`Shot::meter`] must have been called.
    pub fn expose(&self, watch: &Watch) -> Result<FocalPlane, ShotError> {
        Ok(self.expose_from(None, watch, None)?.plane)
    }

    /// Exposes the film, or goes on from where `start` stands. `keep` and being stopped: see [`Exposure::run`]. What was stopped is not denoised, nor what
    /// is denoised for pictures alone ([`Shot::for_pictures`]).
    pub fn expose_from(&self, start: Option<Sums>, watch: &Watch, keep: Option<Keep>) -> Result<Exposed, ShotError> {
        let facts = self.plane_facts();
        let response = self.response();
        if self.lens_cap {
            let plane = darkness(&self.camera.film, &response, &self.settings, facts);
            return Ok(Exposed { plane, stopped: false, stray: None });
        }
        let settings = self.light_settings(response.bands.len());
        // The shapes of the blur cost seconds through a real lens: only a quick look asks for them.
        let optics = if self.file.render.quick { Optics::of(&self.camera) } else { None };
        let sharp = optics.is_some().then(|| quick_look::sharp_camera(&self.camera));
        let exposure = Exposure {
            scene: &self.scene,
            camera: sharp.as_ref().unwrap_or(&self.camera),
            shutter: &self.shutter(),
            response: &response,
            settings: &settings,
            facts: &facts,
        };
        let Exposed { mut plane, stopped, .. } = exposure.run(watch, start, keep)?;
        // A quick look has no rays through the lens.
        if self.denoises_exposure()
            && !stopped
            && let Some(filter) = &self.filter
        {
            let features = self.features(exposure.camera);
            plane = filter.denoise(&plane, features.as_ref())?;
        }
        // After denoising, whose guides are sharp.
        if let Some(optics) = optics {
            plane = quick_look::of_plane(&plane, &optics);
        }
        // It has no noise that a filter should see, and glare is of what was denoised.
        let stray = match self.file.render.quick {
            true => None,
            false => exposure.stray_light(|seen| seen.add_rows(&plane.mean, 0)),
        };
        if let Some(stray) = &stray {
            stray.change(&mut plane, 0);
        }
        plane.facts.light_scale = self.settings.light_scale;
        Ok(Exposed { plane, stopped, stray })
    }

    /// Whether [`Shot::expose_rows`] can take this exposure: a quick look and Open Image Denoise work on the whole plane, and a lens cap needs no light.
    pub fn can_expose_rows(&self) -> bool {
        !self.lens_cap && !self.file.render.quick && self.denoise != Denoise::Oidn
    }

    /// Says that pictures to look at are developed from this shot, beside raw files or planes if `raw_too`: where nobody said otherwise
    /// ([`Denoise::Auto`]) they are denoised, by [`Shot::for_pictures`], and made of fewer samples. `warn` gets what is wrong with the filter.
    ///
    /// Light fields are left: behind microlenses neighbours see other parts of the scene. A quick look makes its blur from a sharp exposure, which is
    /// the one that is denoised, unless raw files are made of it.
    pub fn denoise_pictures(&mut self, raw_too: bool, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        let quick = self.file.render.quick;
        if self.denoise == Denoise::Auto && self.camera.film.microlenses.is_none() && !self.lens_cap && !(quick && raw_too) {
            self.filter = Filter::open(Denoise::Auto, self.file.render.oidn.as_deref(), warn)?;
            let render = &self.file.render;
            if self.filter.is_some()
                && !raw_too
                && render.spp.is_none()
                && render.samples.is_none()
                && render.time_limit.is_none()
            {
                self.settings = Settings { spp: DENOISED_SPP, samples: 0..DENOISED_SPP, ..self.settings.clone() };
            }
        }
        Ok(())
    }

    /// Whether the exposure itself is denoised, and with it all that is made of it.
    fn denoises_exposure(&self) -> bool {
        self.filter.is_some() && (self.denoise != Denoise::Auto || self.file.render.quick)
    }

    /// What the filter is guided by instead of the truth: what is behind smooth glass and in mirrors, which networks have learnt from.
    fn features(&self, camera: &Camera) -> Option<Truth> {
        let network = matches!(&self.filter, Some(Filter::Oidn(_)));
        network.then(|| expose::features(&self.scene, camera, &self.shutter()))
    }

    /// The exposure that pictures to look at are developed from, if it is another than `plane`: one without the renderer's noise. What was stopped is
    /// not denoised.
    pub fn for_pictures(&self, exposed: &Exposed) -> Result<Option<FocalPlane>, ShotError> {
        match &self.filter {
            Some(filter) if !self.denoises_exposure() && !exposed.stopped => {
                let Some(stray) = &exposed.stray else {
                    return Ok(Some(filter.denoise(&exposed.plane, self.features(&self.camera).as_ref())?));
                };
                // Ghosts have no noise, and edges that the guides do not know.
                let mut plane = exposed.plane.clone();
                stray.take_from(&mut plane.mean);
                let mut plane = filter.denoise(&plane, self.features(&self.camera).as_ref())?;
                stray.add_to(&mut plane.mean, 0);
                Ok(Some(plane))
            }
            _ => Ok(None),
        }
    }

    /// The same for planes that memory cannot hold, in about `memory` bytes beside what [`Shot::bytes_needed`] says: the sums lie in a temporary file in
    /// `folder`. [`Shot::can_expose_rows`] must hold.
    pub fn expose_rows(
        &self,
        start: Option<Sums<PagedRows>>,
        watch: &Watch,
        keep: Option<Keep<PagedRows>>,
        memory: usize,
        folder: &Path,
    ) -> Result<ExposedStrips<'_>, ShotError> {
        let (facts, response) = (self.plane_facts(), self.response());
        let settings = self.light_settings(response.bands.len());
        let shutter = self.shutter();
        let exposure = Exposure {
            scene: &self.scene,
            camera: &self.camera,
            shutter: &shutter,
            response: &response,
            settings: &settings,
            facts: &facts,
        };
        let mut exposed = exposure.run_paged(watch, start, keep, memory, folder)?;
        exposed.facts.light_scale = self.settings.light_scale;
        let stopped = exposed.stopped;
        let stray = exposure.stray_light(|seen| exposed.gather(seen));
        let rows = exposed.rows(&self.scene);
        let plane: Box<dyn FocalPlaneSource + '_> = match self.denoises_exposure() && !stopped {
            true => {
                let farthest = rows.farthest_log_depth();
                Box::new(Denoised::new(rows, farthest).named(BUILT_IN))
            }
            false => Box::new(rows),
        };
        let plane: Box<dyn FocalPlaneSource + '_> = match stray {
            Some(stray) => Box::new(WithStray::new(plane, stray)),
            None => plane,
        };
        Ok(ExposedStrips { plane, stopped })
    }

    /// Facts of a focal plane: the speed is the read-out's; what the camera was set to goes with the plane.
    fn plane_facts(&self) -> ExposureFacts {
        ExposureFacts { iso: 0.0, iso_set: self.reading.iso, ..self.facts() }
    }

    /// The frames before and after this exposure, where truth asks for them: of a film at its own rate, of a single picture as of a film of 24 frames a second.
    fn frames(&self) -> Option<Frames> {
        if !self.settings.truth_channels.iter().any(|c| c.needs_frames) {
            return None;
        }
        let (at_s, step_s) = (self.timing.at_s, 1.0 / self.file.sequence.fps.unwrap_or(sequence::FPS));
        let total = self.shutter().total_s();
        // A stabiliser that stood ready for this exposure does so for the others.
        let way = |at_s: f64| self.way(&self.timing.moved_to(at_s), total).ok();
        Some(Frames { at_s, step_s, next: way(at_s + step_s)?, previous: way(at_s - step_s)? })
    }

    /// Settings of the exposure itself. What a filter takes is one factor on all light: the plane's facts keep it apart from the scene's own scale.
    fn light_settings(&self, bands: usize) -> Settings {
        let mut settings = self.settings.clone();
        settings.rgb = self.rgb && self.radiance && self.spectral.is_none();
        settings.light_scale *= (-self.exposing.nd_stops).exp2();
        settings.time_limit_s = self.time_left_s(bands);
        settings.frames = self.frames().map(Arc::new);
        let white_e =
            self.sensor.at_iso(self.reading.iso).map_or(self.sensor.full_well_e, |step| self.sensor.saturation_e(&step));
        if self.reweights() {
            settings.fireflies = Fireflies::Reweight { white_e };
        }
        if self.diffracts() {
            settings.diffraction = Diffraction::On { white_e: self.makes_stars().then_some(white_e) };
        }
        settings
    }

    /// Reads the film out.
    pub fn read_out(&self, plane: &FocalPlane) -> Result<RawImage, ShotError> {
        let mut raw = read_out(plane, &self.sensor, &self.reading, &white_point(&self.reading.white)?)?;
        raw.header.facts.date.clone_from(&self.date);
        raw.header.baseline_ev += self.held_back_ev;
        if self.settings.half.is_some() {
            // Half of the light: developed as bright as whole pixels.
            raw.header.baseline_ev += 1.0;
            raw.header.facts.serial.clone_from(&self.facts.serial);
        }
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

/// Smallest aperture that the camera chooses by itself, as most lenses for 35 mm have it.
const SMALLEST_STOP: f64 = 22.0;
/// Times that a dial has, s.
const DIAL_TIMES_S: [f64; 2] = [1.0 / 8192.0, 32.0];
/// A time that the camera chooses is said to be long from here on, s: the longest that cameras for 35 mm time by themselves.
const LONG_S: f64 = 30.0;
/// Compensation and filters that are taken for meant.
const COMPENSATION_EV: RangeInclusive<f64> = -20.0..=20.0;
const FILTER_STOPS: RangeInclusive<f64> = 0.0..=40.0;

impl Exposing {
    fn new(file: &ShotFile, sensor: &Sensor) -> Result<Self, ShotError> {
        let e = &file.exposure;
        let mode = match e.mode.as_deref() {
            Some(name) => Mode::named(name).ok_or_else(|| value("mode", format!("\"{name}\""), "M, A (Av), S (Tv) or P"))?,
            None if e.shutter.is_some() => Mode::Manual,
            None => Mode::AperturePriority,
        };
        if e.shutter.is_none() && matches!(mode, Mode::Manual | Mode::ShutterPriority) && !e.lens_cap {
            return Err(value(
                "mode",
                mode.name(),
                "an exposure time beside it (--shutter 1/125): in this mode the camera does not choose it",
            ));
        }
        let pattern = match e.metering.as_deref() {
            // A place to look at means the spot.
            None if e.metering_at.is_some() => Pattern::Spot,
            None => Pattern::default(),
            Some(name) => Pattern::named(name).ok_or_else(|| {
                value("metering", format!("\"{name}\""), format!("one of {}", Pattern::NAMES.map(|n| n.0).join(", ")))
            })?,
        };
        let at = e.metering_at.unwrap_or([0.5; 2]);
        if !at.iter().all(|v| (0.0..=1.0).contains(v)) {
            return Err(value("metering_at", format!("{},{}", at[0], at[1]), "a place in the picture: 0 to 1 across and down"));
        }
        let compensation_ev = e.compensation.map_or(0.0, |c| c.0);
        if !COMPENSATION_EV.contains(&compensation_ev) {
            return Err(value("compensation", compensation_ev, "-20 to 20 EV"));
        }
        let nd_stops = e.nd.map_or(0.0, |n| n.0);
        if !FILTER_STOPS.contains(&nd_stops) {
            return Err(value("nd", nd_stops, "a filter of 0 to 40 stops, such as ND8 or \"3 stops\""));
        }
        let range = [
            sensor.iso.iter().map(|s| s.iso).fold(f64::INFINITY, f64::min),
            sensor.iso.iter().map(|s| s.iso).fold(0.0, f64::max),
        ];
        let auto_iso = match e.iso {
            Some(crate::quantity::IsoChoice::Auto) => {
                let highest = e.iso_max.map_or(range[1].min(DEFAULT_HIGHEST_ISO.max(range[0])), |i| i.0);
                let lowest = e.iso_min.map_or(range[0], |i| i.0);
                sensor.at_iso(lowest)?;
                sensor.at_iso(highest)?;
                if lowest > highest {
                    return Err(value("iso_max", highest, format!("at least the lowest speed, ISO {lowest}")));
                }
                Some([lowest, highest])
            }
            _ => None,
        };
        if auto_iso.is_none() && (e.iso_max.is_some() || e.iso_min.is_some()) {
            return Err(value(
                "iso_min or iso_max",
                e.iso_max.or(e.iso_min).map_or(String::new(), |i| i.to_string()),
                "--iso auto beside it",
            ));
        }
        let slowest_s = e.slowest.map(|s| s.0);
        if slowest_s.is_some_and(|s| !(s > 0.0 && s.is_finite())) {
            return Err(value("slowest", slowest_s.map_or(String::new(), |s| Seconds(s).to_string()), "a time above 0"));
        }
        let step = match e.dial.as_deref() {
            None => None,
            Some(name) => Some(
                crate::stops::Step::NAMES
                    .iter()
                    .find(|n| n.0 == name)
                    .map(|n| n.1)
                    .ok_or_else(|| value("dial", format!("\"{name}\""), "full, half or third"))?,
            ),
        };
        let dials = e.mode.is_some();
        Ok(Exposing { mode, pattern, at, compensation_ev, nd_stops, auto_iso, dials, slowest_s, step })
    }
}

/// Highest speed that automatic ISO goes to when nobody says: where grain begins to be disliked.
const DEFAULT_HIGHEST_ISO: f64 = 6400.0;

/// What is known of an exposure from its lens.
/// Whether the profile of the lens is computed: for files, which hold it, always; for a draft where the development corrects by it.
fn wants_profile(file: &ShotFile, draft: bool) -> bool {
    !draft || file.develop.lens != Default::default()
}

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
    let focal = camera.lens.focal_length().0;
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
            Lens::Compound(l) if camera.film.middle_mm != [0.0; 2] || l.is_tilted() || !with_profile => None,
            Lens::Compound(l) => lens_profile::profile(l, sensor, 0.5 * camera.film.width_mm.hypot(camera.film.height_mm)),
            _ => None,
        },
        light_field: camera.light_field_facts(),
        ..Default::default()
    }
}
