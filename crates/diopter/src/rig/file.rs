//! The rig file: several cameras on one frame, in TOML.

use crate::quantity::{Distance, Hertz, Seconds};
use serde::Deserialize;

/// What a rig file says.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RigFile {
    /// Where the rig is.
    #[serde(default)]
    pub rig: PathSection,
    /// When pictures are taken.
    #[serde(default)]
    pub frames: FramesSection,
    /// What is written.
    #[serde(default)]
    pub write: WriteSection,
    /// A shot: what all cameras have in common.
    #[serde(default)]
    pub shot: toml::Table,
    /// The cameras, the first of which others are placed by in some formats.
    #[serde(default)]
    pub camera: Vec<CameraSection>,
    /// An inertial measurement unit.
    pub imu: Option<ImuSection>,
}

/// `[rig]`
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PathSection {
    /// Where it stands, m.
    pub look_from: Option<[f64; 3]>,
    /// What it is aimed at, m.
    pub look_at: Option<[f64; 3]>,
    /// What is up for it; +Y without.
    pub up: Option<[f64; 3]>,
    /// Where it is when, instead of `look_from`.
    pub path: Vec<KeySection>,
    /// Unsteady hands: root mean square angular speed of pitch and yaw about the rig's own place, deg/s.
    pub shake: Option<f64>,
    /// What the shake follows from; 1 without.
    pub shake_seed: Option<u64>,
    /// `rest` (it starts and stops with no speed, and stands before and after) or `free`.
    pub ends: Option<String>,
}

/// `[[rig.path]]`
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeySection {
    /// Scene time.
    pub time: Seconds,
    /// Where it is, m.
    pub look_from: [f64; 3],
    /// What it is aimed at, m; that of `[rig]` without.
    pub look_at: Option<[f64; 3]>,
    /// What is up for it; that of `[rig]` without.
    pub up: Option<[f64; 3]>,
}

/// `[frames]`
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FramesSection {
    /// Pictures of each camera; one without.
    pub count: Option<u32>,
    /// Pictures a second; 24 without.
    pub fps: Option<f64>,
    /// Scene time of the first; 0 without.
    pub first: Option<Seconds>,
    /// All cameras take the meter reading of the first one.
    pub common_metering: bool,
}

/// `[write]`
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WriteSection {
    /// Kinds of files of each picture, as data sets have them: `jpg`, `dng`, `truth.exr`, `depth.npy` ...; `jpg` without.
    pub files: Option<Vec<String>>,
    /// Kinds of calibration; all without.
    pub calibration: Option<Vec<String>>,
}

/// `[[camera]]`
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraSection {
    /// Name of the camera and of its folder.
    pub name: String,
    /// Where it is on the rig (right, up, back), m.
    #[serde(default)]
    pub position: [f64; 3],
    /// How it is turned on the rig: to the left (about y), then up (about x), then anticlockwise as seen from behind (about z), degrees.
    #[serde(default)]
    pub turn_deg: [f64; 3],
    /// A stereo pair, NAME-left and NAME-right: their distance, half of it to each side along the camera's own x axis.
    pub baseline: Option<Distance>,
    /// How long after the time of a frame its exposure begins (before, if negative).
    pub trigger_offset: Option<Seconds>,
    /// What it has for itself: a shot, over the common one.
    #[serde(default)]
    pub shot: toml::Table,
}

/// `[imu]`
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ImuSection {
    /// Samples a second.
    pub rate: Hertz,
    /// Where it is on the rig (right, up, back), m.
    #[serde(default)]
    pub position: [f64; 3],
    /// How it is turned on the rig, as cameras are, degrees.
    #[serde(default)]
    pub turn_deg: [f64; 3],
    /// First and last moment, scene time; from the first frame to the end of the last without.
    pub span: Option<[Seconds; 2]>,
    /// Acceleration of free fall in the world, m/s²; [0, -9.80665, 0] without.
    pub gravity: Option<[f64; 3]>,
    /// White noise of the gyroscope, rad/s/√Hz.
    #[serde(default)]
    pub gyro_noise_density: f64,
    /// Random walk of its bias, rad/s²/√Hz.
    #[serde(default)]
    pub gyro_random_walk: f64,
    /// Standard deviation of its bias at the start, rad/s.
    #[serde(default)]
    pub gyro_turn_on_bias: f64,
    /// White noise of the accelerometer, m/s²/√Hz.
    #[serde(default)]
    pub accel_noise_density: f64,
    /// Random walk of its bias, m/s³/√Hz.
    #[serde(default)]
    pub accel_random_walk: f64,
    /// Standard deviation of its bias at the start, m/s².
    #[serde(default)]
    pub accel_turn_on_bias: f64,
    /// Seed of the noise; 1 without.
    pub seed: Option<u64>,
}
