//! The shot file: a photograph as a user asks for it, in TOML.

use super::ShotError;
use super::sources::{is_lens_file, is_light_file};
use crate::denoising::Denoise;
use crate::files;
use crate::polarizer::Polarizer;
use crate::quantity::{Distance, Ev, FNumber, Filter, FocusTo, Hertz, Iso, IsoChoice, LengthMm, Moment, Seconds, Size, number};
use crate::recipe_file;
use crate::stops;
use diopter_develop::Recipe;
use diopter_scene::builtin;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// What a shot file says; everything may be left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ShotFile {
    /// What is photographed.
    pub scene: SceneSection,
    /// With what, from where.
    pub camera: CameraSection,
    /// When which part of the film is open.
    pub shutter: ShutterSection,
    /// How much light.
    pub exposure: ExposureSection,
    /// Light of the camera's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flash: Option<FlashSection>,
    /// What is sharp.
    pub focus: FocusSection,
    /// How it is computed.
    pub render: RenderSection,
    /// How the raw image becomes a picture.
    pub develop: Recipe,
    /// More than one picture.
    pub sequence: SequenceSection,
    /// Where it goes.
    pub output: OutputSection,
}

/// What is wrong with a text that is no shot file: files of other kinds are told by keys that shot files have not.
fn wrong_kind(text: &str, path: &str, parser: &str) -> String {
    let keys: toml::Table = toml::from_str(text).unwrap_or_default();
    let other = match (keys.contains_key("surfaces"), keys.contains_key("full_well_e") || keys.contains_key("pixels")) {
        (true, _) => Some(("lens", "--lens")),
        (_, true) => Some(("camera body", "--body")),
        _ => None,
    };
    match other {
        Some((kind, flag)) => {
            format!("this is the file of a {kind}; expected a shot file or a scene, and {flag} {path} beside it")
        }
        None => parser.trim_end().to_owned(),
    }
}

/// `[scene]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SceneSection {
    /// An embedded scene's name, or a `.gltf` or `.glb` file (relative to the shot file).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// Metres in a unit of length of the file: 0.001 for one in millimetres. Places in this shot file are metres all the same.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// Which of the sets of materials that the file offers.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub variant: Option<String>,
    /// A texture that cannot be read is an error; without, magenta stands in for it and a warning lists it.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub strict: bool,
    /// Surfaces that pictures of heights displace are split until no edge is longer than so many pixels of the picture, for the place where the camera stands first; without,
    /// as their files say (`edgelength` of pbrt), or by 1/512 of their size.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub displacement_edge_px: Option<f64>,
    /// A table of the classes of objects, a line each: `pattern, class` ([`diopter_scene::classes`]).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub classes: Option<PathBuf>,
    /// Numbers of bodies that overlap, by the name of their material: where they do, the one with the highest is there.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub priority: BTreeMap<String, i32>,
    /// What lights it: `studio` (soft boxes and a grey sweep), `sun` (with a clear sky), `overcast`, `none` (its own light alone), or a lat-long
    /// `.hdr`, `.exr` or `.pfm`, whose numbers are relative unless `environment_scale` is given: 10 000 lx on average. Without, the studio where it
    /// has no light of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<String>,
    /// A lat-long `.hdr` or `.exr` around the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment: Option<PathBuf>,
    /// Turns the environment about the vertical, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment_rotation_deg: Option<f32>,
    /// Factor on the environment; 1 takes its numbers as cd/m².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub environment_scale: Option<f32>,
    /// Sun and sky instead of an environment.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub daylight: Option<DaylightSection>,
    /// Fog around everything.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fog: Option<FogSection>,
    /// Puts a large matte floor of this albedo (0 to 1, grey) under the scene.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<f32>,
    /// Scales all light so that the scene as framed meters at this EV (ISO 100): for scenes without a true scale.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ambient_ev: Option<f64>,
    /// Moment at which the exposure begins, on the clock of the scene's animations; 0 without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub at: Option<Seconds>,
    /// Which animation runs: its name or number, `all` or `none`; the first without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub animation: Option<String>,
    /// After its last key: `clamp` (stand still) or `loop`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub animation_end: Option<String>,
    /// Nothing moves: all stands as it does at the moment `at`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frozen: Option<bool>,
    /// Lamps whose light changes with time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub flicker: Vec<FlickerSection>,
}

/// `[scene.daylight]`: `sun`, or `time` and `place`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DaylightSection {
    /// Elevation and azimuth (from north towards east) of the sun, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sun: Option<[f64; 2]>,
    /// A moment with its distance from universal time, such as 2026-06-21T12:00+02:00.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time: Option<Moment>,
    /// Latitude and longitude, north and east positive, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub place: Option<[f64; 2]>,
    /// Haze: 1 pure air, 2 very clear, 3 clear (without it), 6 hazy, 10 thick.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turbidity: Option<f64>,
    /// Turns north, which is -z without, towards east (+x), degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub north_deg: Option<f64>,
    /// Albedo of the endless ground below the horizon; 0.2 without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ground: Option<f64>,
}

/// `[scene.fog]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FogSection {
    /// How far one sees in it (a contrast of 2 %); 100 m without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub visibility: Option<Distance>,
    /// Fraction of light that a droplet scatters and does not absorb; 1 without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub albedo: Option<f32>,
    /// Mean cosine of the angle of scattering; 0.85 without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub asymmetry: Option<f32>,
    /// Two corners of the box that it fills, m; without, as far around all that is seen as one can see, or endless where no light comes from infinity.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub within: Option<[[f32; 3]; 2]>,
}

/// `[[scene.flicker]]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FlickerSection {
    /// Name of a material, an object or a light; all lamps without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lamp: Option<String>,
    /// `mains` (a sine of twice the frequency) or `pwm`.
    pub kind: String,
    /// Of the mains, or of the switching.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frequency: Option<Hertz>,
    /// Of mains: 0 steady to 1 dark once a period.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth: Option<f64>,
    /// Of PWM: fraction of the period that the lamp is on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub duty: Option<f64>,
    /// How far into its period the lamp is at scene time 0, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub phase_deg: Option<f64>,
}

/// "mains 50 Hz", "mains 50 Hz 0.8" (depth), "pwm 240 Hz 0.3" (fraction of time on), of all lamps.
impl FromStr for FlickerSection {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("\"{text}\" is not a flicker such as \"mains 50 Hz\", \"mains 50 Hz 0.8\" or \"pwm 240 Hz 0.3\"");
        let mut words: Vec<String> = text.split_whitespace().map(str::to_lowercase).collect();
        if words.is_empty() {
            return Err(wrong());
        }
        let kind = words.remove(0);
        // "50 Hz" or "50hz".
        if words.get(1).is_some_and(|w| w.ends_with("hz")) {
            let unit = words.remove(1);
            words[0].push_str(&unit);
        }
        let frequency = words.first().map(|f| f.parse::<Hertz>()).transpose().map_err(|_| wrong())?;
        let amount = words.get(1).map(|a| number(a).ok_or_else(wrong)).transpose()?;
        if words.len() > 2 || !matches!(kind.as_str(), "mains" | "pwm") {
            return Err(wrong());
        }
        let (depth, duty) = if kind == "pwm" { (None, amount) } else { (amount, None) };
        Ok(FlickerSection { kind, frequency, depth, duty, ..Default::default() })
    }
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
    /// `thin`, `pinhole`, `panorama`, an embedded lens's name or a lens file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lens: Option<String>,
    /// Focal length; of a zoom, where it is set.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_length: Option<LengthMm>,
    /// A zoom position that the lens's prescription prints, 1 the first; instead of `focal_length`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zoom_position: Option<usize>,
    /// A calibration that the camera sees by, instead of a lens: OpenCV, COLMAP, nerfstudio, Kalibr, our JSON, an ST map or a ray table.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<PathBuf>,
    /// Angle of view of an ideal lens from the left to the right edge, degrees; instead of `focal_length`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fov_deg: Option<f64>,
    /// No perspective: the height that the picture shows, m.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orthographic: Option<Distance>,
    /// The lens is moved against the film, to the right and up as seen from behind the camera, mm: the picture shows more of that side.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shift_mm: Option<[f64; 2]>,
    /// The lens is turned against the film about its middle (a traced one about its rear principal point): forward (down), and to the right, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tilt_deg: Option<[f64; 2]>,
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
    /// Length of a hood before a real lens, over what its sheet has.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hood: Option<LengthMm>,
    /// A microlens array before the sensor, over what the body has.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plenoptic: Option<PlenopticSection>,
    /// Each pixel is split in two photodiodes, which see the left and the right half of the pupil: one exposure gives two raw files.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub dual_pixel: bool,
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
    /// Unsteady hands: root mean square angular speed of pitch and yaw, deg/s (0.6 is a steady hand).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shake: Option<f64>,
    /// What moves against the shake.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stabiliser: Option<StabiliserSection>,
    /// Where the camera is at which time; instead of `look_from`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub path: Vec<PathStop>,
}

/// `[camera.plenoptic]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlenopticSection {
    /// Distance of the microlenses.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pitch: Option<LengthMm>,
    /// Their focal length; without, the pitch times the f-number of the lens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focal_length: Option<LengthMm>,
    /// From the array to the sensor; the focal length without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gap: Option<LengthMm>,
    /// `square` or `hexagonal`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub arrangement: Option<String>,
}

/// `[camera.stabiliser]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StabiliserSection {
    /// `lens` (the group that its sheet names), `sensor`, or the first and last surface of a group, such as `15-17`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moves: Option<String>,
    /// Corner of the servo, Hz; 100 without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub servo: Option<Hertz>,
    /// Below it angles are taken for drift, Hz; 0.05 without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub drift: Option<Hertz>,
    /// How far it moves from the axis at most; as far as it must without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub travel: Option<LengthMm>,
}

/// `[[camera.path]]`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PathStop {
    /// Scene time.
    pub time: Seconds,
    /// Where the camera stands, m.
    pub look_from: [f32; 3],
    /// What it is aimed at, m; the shot's own without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub look_at: Option<[f32; 3]>,
    /// What is up in the picture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<[f32; 3]>,
}

/// `[shutter]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ShutterSection {
    /// `global`, `leaf`, `focal-plane` or `rolling`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kind: Option<String>,
    /// Of a focal-plane shutter: time that a curtain takes across the picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub travel: Option<Seconds>,
    /// Of a rolling shutter: time from one row (or column) of the picture to the next.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line_time: Option<Seconds>,
    /// Of a rolling shutter, instead: time for the whole picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub readout: Option<Seconds>,
    /// Of a rolling shutter: `rolling`, or `global` for a reset of all rows at once.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reset: Option<String>,
    /// Which way curtains or rows run, as seen in the picture: `down`, `up`, `right` or `left`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub direction: Option<String>,
    /// Of a leaf shutter: time its blades take to open, and again to close.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ramp: Option<Seconds>,
}

/// `[flash]`
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlashSection {
    /// Guide number: f-number × distance (m) of a right exposure at ISO 100 and full power.
    pub guide_number: f64,
    /// Fraction of full power, such as 0.25.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub power: Option<f64>,
    /// Length of the pulse.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulse: Option<Seconds>,
    /// `first` or `second` curtain, or `high-speed`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sync: Option<String>,
    /// Where it is from the lens along the camera's axes (right, up, back), m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub offset: Option<[f32; 3]>,
}

/// `[sequence]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SequenceSection {
    /// Pictures of an exposure series.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bracket: Option<u32>,
    /// From one to the next of them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<Ev>,
    /// Pictures of a focus series, from what is focused on farther and farther.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focus_bracket: Option<u32>,
    /// From one of them to the next, in depths of focus (2 × f-number × circle of confusion at the film); negative goes nearer. 1 without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub focus_step: Option<f64>,
    /// What differs in the series: `time` or `aperture`; without, the aperture in mode S and else the time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub vary: Option<String>,
    /// Frames of a film.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<u32>,
    /// Frames a second.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fps: Option<f64>,
    /// Exposure time of a frame as part of its duration: 180 is half of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shutter_angle_deg: Option<f64>,
    /// Exposures (2 or 3), the longest first, that a rolling sensor reads interleaved row by row: staggered or digital-overlap HDR.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub staggered: Option<u32>,
    /// How many times as long each of them is as the next; 16 without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub staggered_ratio: Option<f64>,
    /// Least time between the reading of a row and the reset for its next exposure; none without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub staggered_gap: Option<Seconds>,
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
    /// ISO speed, or `auto`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub iso: Option<IsoChoice>,
    /// Lowest speed of automatic ISO; the body's without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub iso_min: Option<Iso>,
    /// Highest speed of automatic ISO; 6400 without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub iso_max: Option<Iso>,
    /// The slowest time that automatic ISO keeps to and the program turns at; one over the focal length without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub slowest: Option<Seconds>,
    /// `M`, `A`, `S` or `P`; without, M when a time is given and A when not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mode: Option<String>,
    /// `average`, `centre-weighted`, `spot`, `matrix` or `highlight`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metering: Option<String>,
    /// Middle of the spot, 0 to 1 across and down the picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub metering_at: Option<[f64; 2]>,
    /// More (+) or less (−) light than the meter asks for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub compensation: Option<Ev>,
    /// Neutral density filter before the lens.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nd: Option<Filter>,
    /// Polarising filter before the lens: `linear:30deg`, `circular:30deg`; after it the fraction of unpolarised light that it passes and its extinction ratio.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub polarizer: Option<Polarizer>,
    /// What the camera chooses clicks in `full`, `half` or `third` stops; without, it is exact.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dial: Option<String>,
    /// Engraved numbers stand for exact stops: f/5.6 for 5.657, 1/125 for 1/128.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub true_stops: Option<bool>,
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
    /// What is sharp: a distance from the lens, `auto`, `at 0.4,0.6`, `on NAME`, `hyperfocal` or `extension 1.2mm` (of the film from
    /// infinity); without, the point the camera is aimed at.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance: Option<FocusTo>,
    /// Where autofocus looks: `one`, `nine` or a list of `[x, y, width, height]`, fractions of the picture.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub zones: Option<Zones>,
    /// Which zone counts: `closest` (`macro`), `farthest` (`background`), `median`, `front-median`, `back-median`, `centre` or `most`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub priority: Option<String>,
    /// `hybrid` (phase, then contrast), `phase`, `contrast` or `exhaustive`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
    /// What contrast is measured by: `sml`, `tenengrad` or `variance`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub measure: Option<String>,
    /// The motor: step (mm), backlash (mm), speed (mm/s) of the film; ideal without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub motor: Option<[f64; 3]>,
    /// Looks at all positions of the film from one to another in steps, mm behind its place for infinity: the curve of contrast.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sweep: Option<[f64; 3]>,
    /// No picture when autofocus fails.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub require: bool,
}

/// Zones of autofocus.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Zones {
    /// `one` or `nine`.
    Named(String),
    /// `[x, y, width, height]` each, fractions of the picture.
    Boxes(Vec<[f64; 4]>),
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
    /// Light is followed with its polarisation, as a polariser or a polarisation sensor asks for anyway.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub polarized: bool,
    /// `path`, `caustics`, `bidirectional` or `auto`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub integrator: Option<String>,
    /// Stray light in the lens: `all`, `none`, or some of `ghosts`, `diffraction`, `scatter` with commas between them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stray: Option<String>,
    /// Stop after about so long.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_limit: Option<Seconds>,
    /// Blur made from one sharp exposure and its depth instead of rays through the lens: a quick look.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub quick: bool,
    /// Reduce the renderer's own noise: `auto` (in developed pictures only, what holds without), `on`, `off`, `oidn` or `builtin`; true and false mean on
    /// and off.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub denoise: Option<Denoise>,
    /// File or folder of Open Image Denoise, where it is not found by itself.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub oidn: Option<PathBuf>,
    /// What becomes of outliers when the samples end: `keep` or `reweight`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fireflies: Option<FireflyChoice>,
    /// Truth channels beyond depth, normal, albedo and id, with commas between them; `all`: every one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth_channels: Option<String>,
    /// Diffraction at the aperture: `auto` (where it shows in the picture), `on` or `off`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diffraction: Option<DiffractionChoice>,
}

/// Whether light is diffracted at the aperture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DiffractionChoice {
    /// Where the Airy disk is no smaller than a pixel of the picture ([`crate::expose::diffraction_shows`]).
    #[default]
    Auto,
    /// Always.
    On,
    /// Rays only.
    Off,
}

impl std::str::FromStr for DiffractionChoice {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "auto" => Ok(DiffractionChoice::Auto),
            "on" => Ok(DiffractionChoice::On),
            "off" => Ok(DiffractionChoice::Off),
            _ => Err(format!("\"{text}\" is none of auto, on and off")),
        }
    }
}

/// What becomes of outliers when the samples end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FireflyChoice {
    /// Every sample counts as it is.
    #[default]
    Keep,
    /// Samples that those around do not support count less.
    Reweight,
}

impl std::str::FromStr for FireflyChoice {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "keep" => Ok(FireflyChoice::Keep),
            "reweight" => Ok(FireflyChoice::Reweight),
            _ => Err(format!("\"{text}\" is neither keep nor reweight")),
        }
    }
}

/// `[output]`
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutputSection {
    /// Files to write; the ending says what.
    pub files: Vec<PathBuf>,
}

impl ShotFile {
    /// Reads a shot file; paths in it are relative to it.
    pub fn read(path: &Path) -> Result<ShotFile, ShotError> {
        let place = path.display().to_string();
        let text = files::read_text(path).map_err(|e| ShotError::Read { path: place.clone(), reason: e.to_string() })?;
        let mut shot: ShotFile = toml::from_str(&text)
            .map_err(|e| ShotError::Syntax { reason: wrong_kind(&text, &place, &e.to_string()), path: place })?;
        shot.place_paths(path.parent().unwrap_or(Path::new("")));
        Ok(shot)
    }

    /// Makes the paths of a shot that was written in a folder independent of it.
    pub fn place_paths(&mut self, folder: &Path) {
        let shot = self;
        let relative = |p: &Path| if p.is_absolute() { p.to_owned() } else { folder.join(p) };
        if let Some(file) = &mut shot.scene.file
            && !builtin::is_embedded(file)
        {
            *file = relative(Path::new(file.as_str())).display().to_string();
        }
        if let Some(environment) = &mut shot.scene.environment {
            *environment = relative(environment);
        }
        if let Some(light) = shot.scene.light.as_mut().filter(|l| is_light_file(l)) {
            *light = relative(Path::new(light.as_str())).display().to_string();
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
        if let Some(library) = &mut shot.render.oidn {
            *library = relative(library);
        }
        if let Some(calibration) = &mut shot.camera.calibration {
            *calibration = relative(calibration);
        }
        if let Some(classes) = &mut shot.scene.classes {
            *classes = relative(classes);
        }
        recipe_file::place_lut(&mut shot.develop, folder);
    }

    /// Puts what engraved numbers stand for in their place, if that was asked for.
    pub(super) fn mean_true_stops(&mut self) {
        let e = &mut self.exposure;
        if e.true_stops != Some(true) {
            return;
        }
        let dial = e.dial.as_deref().and_then(|d| stops::Step::NAMES.iter().find(|n| n.0 == d)).map(|n| n.1);
        e.aperture = e.aperture.map(|a| FNumber(stops::true_aperture(a.0, dial)));
        for time in [&mut e.shutter, &mut e.slowest] {
            *time = time.map(|s| Seconds(stops::true_time(s.0, dial)));
        }
        for iso in [&mut e.iso_min, &mut e.iso_max] {
            *iso = iso.map(|i| Iso(stops::true_speed(i.0, dial)));
        }
        e.iso = e.iso.map(|i| match i {
            IsoChoice::Fixed(iso) => IsoChoice::Fixed(Iso(stops::true_speed(iso.0, dial))),
            auto => auto,
        });
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
        if let Some(light) = self.scene.light.as_mut().filter(|l| is_light_file(l)) {
            *light = text(light);
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
        if let Some(library) = &mut self.render.oidn {
            *library = whole(library);
        }
        if let Some(calibration) = &mut self.camera.calibration {
            *calibration = whole(calibration);
        }
        if let Some(classes) = &mut self.scene.classes {
            *classes = whole(classes);
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
