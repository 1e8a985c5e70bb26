//! The sections of the shot file, and the flags of a photograph: each key is declared once, with its type, its help and its flag.
//!
//! `section!` makes of a declaration a part of the shot file (serde) and, of all fields that are not `skip`, flags (clap) under a heading of the help. What is not said is absent: it is not
//! written, and flags win over files where they say something ([`Setting`]).
//!
//! Help shows values as flags write them ("90deg", "5mm", "0,1.5,-2"). In files and in Rust a key with a unit in its name (`fov_deg`, `shift_mm`) is a number in that unit, places are
//! three numbers in metres, ranges and pairs are lists; quantities (lengths, times, stops) are texts with their unit in both.

use super::flag_values::{
    degrees, degrees_f32, exposure_value, fraction, list, one_of, pair, point, range, samples_a_pixel, shift, tilt, triple,
};
use super::setting::{Section, Setting, Value, section, values};
use crate::denoising::Denoise;
use crate::focus::{Measure, Method, Priority};
use crate::polarizer::Polarizer;
use crate::quantity::{Distance, Ev, FNumber, Filter, FocusTo, Hertz, Iso, IsoChoice, LengthMm, Moment, Seconds, Size, number};
use diopter_sensor::ColorSampling;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::str::FromStr;

// What settings say besides sections.
values! {
    f32, f64, u32, u64, usize, String, PathBuf, [f32; 3], [f64; 2], [f64; 3], [u32; 2], [[f32; 3]; 2], ColorSampling, Denoise, DiffractionChoice, Distance, Ev, FNumber, Filter,
    FireflyChoice, FocusTo, Hertz, Iso, IsoChoice, LengthMm, Moment, Polarizer, Seconds, Size, Zones,
}

section! {
    "Scene":
    /// `[scene]`
    pub struct SceneSection {
        /// An embedded scene's name, or a `.gltf` or `.glb` file (relative to the shot file).
        #[arg(skip)]
        pub file: Option<String>,
        /// Metres in a unit of length of the scene file: 0.001 for millimetres, 0.01 for centimetres.
        ///
        /// Positions in the shot file stay in metres.
        #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
        pub scale: Option<f64>,
        /// Which of the sets of materials that a glTF file offers.
        #[arg(long, value_name = "NAME")]
        pub variant: Option<String>,
        /// Fail when a texture of the scene cannot be read, instead of showing magenta in its place.
        #[arg(long)]
        pub strict: bool,
        /// Split displaced surfaces until no edge is longer than so many pixels of the picture, instead of as their file says.
        #[arg(long, value_name = "PIXELS", allow_negative_numbers = true)]
        pub displacement_edge_px: Option<f64>,
        /// A table of the classes of objects for --truth-channels class and crypto-class: lines of "pattern, class", such as "chair*, chair".
        ///
        /// The first line whose pattern is the object's name counts; * stands for any text, "material:glass*, window" goes by the name of the material. Without it, the
        /// class is what glTF nodes say in extras (class, category or category_id).
        #[arg(long, value_name = "FILE")]
        pub classes: Option<PathBuf>,
        /// Priority of overlapping bodies, by material name: where bodies overlap, the highest priority wins (nested dielectrics).
        #[arg(skip)]
        pub priority: BTreeMap<String, i32>,
        /// What lights it: studio, sun, overcast, none (only its own light) or a lat-long .hdr, .exr or .pfm.
        ///
        /// studio: soft boxes of 1500 lx (key), 500 lx (fill) and 1000 lx (rim) and a grey sweep to stand on; what a scene without light of its own gets.
        /// sun: a clear day, the sun behind the camera to its left. overcast: a grey sky of 10 000 lx. Both put a ground under the scene.
        /// A file: its values are relative, and scaled to 10 000 lx on average; --environment takes them for cd/m². With environment_scale in a shot file its numbers are taken as they are.
        #[arg(long, value_name = "KIND|FILE")]
        pub light: Option<String>,
        /// Light from all around, in cd/m²: a lat-long .hdr, .exr or .pfm; as --light, its numbers are relative.
        #[arg(long, value_name = "FILE")]
        pub environment: Option<PathBuf>,
        /// Turn the environment about the vertical, degrees.
        #[arg(long = "environment-rotation", value_name = "DEG", value_parser = degrees_f32, allow_negative_numbers = true)]
        pub environment_rotation_deg: Option<f32>,
        /// Factor on the environment; 1 takes its numbers as cd/m².
        #[arg(skip)]
        pub environment_scale: Option<f32>,
        /// Sun and sky instead of an environment.
        #[command(flatten)]
        pub daylight: Option<DaylightSection>,
        /// Fog around everything.
        #[command(flatten)]
        pub fog: Option<FogSection>,
        /// Put a large matte floor of this albedo (0 to 1) under the scene.
        #[arg(long, value_name = "ALBEDO")]
        pub ground: Option<f32>,
        /// Scale all light so that the mean luminance of what the lens shows is that of this EV (ISO 100).
        ///
        /// A meter may read less: it sees dark corners and clipped highlights.
        #[arg(long, value_name = "EV", value_parser = exposure_value, allow_negative_numbers = true)]
        pub ambient_ev: Option<f64>,
        /// Moment the exposure begins, on the clock of the scene's animations: "1.25s".
        ///
        /// 0 without.
        #[arg(long, value_name = "TIME", allow_hyphen_values = true, help_heading = "Time")]
        pub at: Option<Seconds>,
        /// Which animation runs: its name or number, all or none; the first without.
        #[arg(long, value_name = "NAME", help_heading = "Time")]
        pub animation: Option<String>,
        /// After the last key frame: clamp (hold the last pose) or loop.
        #[arg(long, value_name = "HOW", help_heading = "Time")]
        pub animation_end: Option<String>,
        /// Nothing moves: all stands as it does at --at.
        #[arg(long, help_heading = "Time")]
        pub frozen: bool,
        /// Lamps flicker: "mains 50 Hz" or "mains 50 Hz 0.8" (depth), "pwm 240 Hz 0.3" (fraction of time on).
        #[arg(long, value_name = "HOW", help_heading = "Time")]
        pub flicker: Vec<FlickerSection>,
    }
}

section! {
    "Scene":
    /// `[scene.daylight]`: `sun`, or `time` and `place`.
    pub struct DaylightSection {
        /// Sun and clear sky with the sun at this elevation and azimuth, degrees.
        ///
        /// The azimuth counts from north, -z, towards east, +x.
        #[arg(long, value_name = "ELEV,AZ", allow_hyphen_values = true, value_parser = pair)]
        pub sun: Option<[f64; 2]>,
        /// Sun and clear sky of a moment, with its zone (2026-06-21T12:00+02:00); needs a place.
        #[arg(long = "daylight", value_name = "TIME", conflicts_with = "sun")]
        pub time: Option<Moment>,
        /// Where on earth --daylight is: latitude and longitude, degrees, north and east positive.
        #[arg(long, value_name = "LAT,LON", allow_hyphen_values = true, value_parser = pair)]
        pub place: Option<[f64; 2]>,
        /// Haze of daylight: 1 pure air, 3 clear, 10 thick.
        ///
        /// 3 without.
        #[arg(long, value_name = "T")]
        pub turbidity: Option<f64>,
        /// Turns north, which is -z without, towards east (+x), degrees.
        #[arg(skip)]
        pub north_deg: Option<f64>,
        /// Albedo of the endless ground below the horizon; 0.2 without.
        #[arg(skip)]
        pub ground: Option<f64>,
    }
}

section! {
    "Scene":
    /// `[scene.fog]`
    pub struct FogSection {
        /// Fog in which one sees this far; it ends so far around the scene and the camera where light comes from the sky.
        ///
        /// A contrast of 2 % is left there. 100 m where a shot file says only other things of the fog.
        #[arg(long = "fog", value_name = "DISTANCE", allow_hyphen_values = true)]
        pub visibility: Option<Distance>,
        /// Fraction of light that a droplet scatters and does not absorb; 1 without.
        #[arg(skip)]
        pub albedo: Option<f32>,
        /// Mean cosine of the angle of scattering; 0.85 without.
        #[arg(skip)]
        pub asymmetry: Option<f32>,
        /// Two corners of the box that it fills, m; without, as far around all that is seen as one can see, or endless where no light comes from infinity.
        #[arg(skip)]
        pub within: Option<[[f32; 3]; 2]>,
    }
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

section! {
    "Camera":
    /// `[camera]`
    pub struct CameraSection {
        /// Camera body: a name from `body list` or a TOML file.
        #[arg(long, value_name = "NAME|FILE")]
        pub body: Option<String>,
        /// Serial number of the body: its fixed pattern is drawn from it.
        #[arg(skip)]
        pub serial: Option<String>,
        /// Film format instead of the body's: a name ("full frame", "APS-C", "4/3") or mm ("36x24").
        #[arg(long, value_name = "NAME|MM")]
        pub format: Option<String>,
        /// Lens: thin, pinhole, panorama, name (`lens list`) or file (.toml, .dat, .zmx, .seq, .len, .json).
        ///
        /// Ideal fisheyes are fisheye-equidistant, fisheye-equisolid, fisheye-stereographic and fisheye-orthographic.
        /// "sheet.toml#17" is build 17 of a tolerance sheet (`lens tolerance`).
        #[arg(long, value_name = "NAME|FILE", help_heading = "Lens")]
        pub lens: Option<String>,
        /// Focal length: "50 mm"; of a zoom, where it is set.
        #[arg(long, value_name = "LENGTH", help_heading = "Lens")]
        pub focal_length: Option<LengthMm>,
        /// A zoom position that the lens's prescription prints, 1 the first.
        #[arg(long, value_name = "N", conflicts_with = "focal_length", help_heading = "Lens")]
        pub zoom_position: Option<usize>,
        /// See by a calibration instead of a lens: OpenCV (.yaml), COLMAP (cameras.txt), nerfstudio (transforms.json), Kalibr, our .json, an ST map or a ray table (.exr).
        ///
        /// Everything is sharp unless --aperture is given.
        #[arg(long = "camera", value_name = "FILE", help_heading = "Lens")]
        pub calibration: Option<PathBuf>,
        /// Angle of view of an ideal lens from the left to the right edge, instead of its focal length: "90deg".
        #[arg(long = "fov", value_name = "ANGLE", value_parser = degrees, conflicts_with = "focal_length", help_heading = "Lens")]
        pub fov_deg: Option<f64>,
        /// No perspective: the height that the picture shows, "2m".
        #[arg(long, value_name = "HEIGHT", conflicts_with_all = ["calibration", "fov_deg"], help_heading = "Lens")]
        pub orthographic: Option<Distance>,
        /// Move the lens against the film, to the right and up: "5mm", "0,8mm". The picture shows more of that side.
        ///
        /// As seen from behind the camera, mm.
        #[arg(long = "shift", value_name = "X[,Y]", value_parser = shift, allow_hyphen_values = true, help_heading = "Lens")]
        pub shift_mm: Option<[f64; 2]>,
        /// Turn the lens against the film, forward (down) and to the right: "8deg", "0,5deg". The view stays, the sharp plane turns. A traced lens turns about its
        /// rear principal point.
        #[arg(long = "tilt", value_name = "X[,Y]", value_parser = tilt, allow_hyphen_values = true, help_heading = "Lens")]
        pub tilt_deg: Option<[f64; 2]>,
        /// Blades of the iris; without, the lens's own, or round.
        #[arg(long, value_name = "N", help_heading = "Lens")]
        pub blades: Option<u32>,
        /// How round the blades are, those of --blades or of the lens: 0 straight to 1.
        #[arg(long, value_name = "X", help_heading = "Lens")]
        pub blade_curvature: Option<f32>,
        /// A picture (PNG, JPEG) as aperture: white lets light through.
        #[arg(long, value_name = "FILE", help_heading = "Lens")]
        pub aperture_image: Option<PathBuf>,
        /// Turn the blades, those of --blades or of the lens, degrees.
        #[arg(long = "blade-rotation", value_name = "DEG", value_parser = degrees_f32, allow_negative_numbers = true, help_heading = "Lens")]
        pub blade_rotation_deg: Option<f32>,
        /// A hood of this length before a real lens, as narrow as the picture allows: shades the front element from light beside the picture.
        ///
        /// It shows with --stray scatter. A lens sheet can have its own (`hood`).
        #[arg(long, value_name = "LENGTH", help_heading = "Lens")]
        pub hood: Option<LengthMm>,
        /// Each pixel is split in two photodiodes, which see the left and the right half of the pupil: one exposure gives two raw files.
        #[arg(skip)]
        pub dual_pixel: bool,
        /// Which colours each pixel is read in: that of its filter (mosaic), or red, green and blue (full).
        ///
        /// full: as three chips, stacked photodiodes or pixel shift read them; nothing is demosaiced, and a DNG is linear. Without it, `shoot` reads in full color where all files are pictures (JPEG, PNG,
        /// TIFF) that have two of the sensor's photosites or more to a pixel each way, as a camera makes small pictures of many photosites, and no method of demosaicing is asked for. The
        /// noise of a pixel is that of one photosite of each color.
        #[arg(long, value_name = "mosaic|full", help_heading = "Sensor")]
        pub color_sampling: Option<ColorSampling>,
        /// Where the camera stands: "x,y,z" in m.
        #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
        pub look_from: Option<[f32; 3]>,
        /// What it is aimed at: "x,y,z" in m.
        #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
        pub look_at: Option<[f32; 3]>,
        /// Up vector of the picture: "0,1,0".
        #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
        pub up: Option<[f32; 3]>,
        /// A camera of the scene file, by name or number.
        ///
        /// The first is 0.
        #[arg(long, value_name = "NAME")]
        pub viewpoint: Option<String>,
        /// Camera shake: rms angular velocity, deg/s; 0.6 is a steady hand.
        #[arg(long, value_name = "DEG/S", allow_negative_numbers = true)]
        pub shake: Option<f64>,
        /// What moves against the shake.
        #[command(flatten)]
        pub stabiliser: Option<StabiliserSection>,
        /// Where the camera is at which time; instead of `look_from`.
        #[arg(skip)]
        pub path: Vec<PathStop>,
        /// A microlens array before the sensor, over what the body has.
        #[command(flatten)]
        pub plenoptic: Option<PlenopticSection>,
    }
}

section! {
    "Lens":
    /// `[camera.plenoptic]`
    pub struct PlenopticSection {
        /// A plenoptic camera: a microlens array of this pitch before the sensor, such as 0.1mm.
        #[arg(long = "plenoptic", value_name = "PITCH")]
        pub pitch: Option<LengthMm>,
        /// Focal length of the microlenses; without, the pitch times the f-number.
        #[arg(id = "camera.plenoptic.focal_length", long = "microlens-focal-length", value_name = "LENGTH")]
        pub focal_length: Option<LengthMm>,
        /// From the microlenses to the sensor; their focal length without.
        #[arg(long = "microlens-gap", value_name = "LENGTH")]
        pub gap: Option<LengthMm>,
        /// How the microlenses are laid out: square or hexagonal.
        #[arg(long = "microlens-arrangement", value_name = "LAYOUT")]
        pub arrangement: Option<String>,
    }
}

section! {
    "Camera":
    /// `[camera.stabiliser]`
    pub struct StabiliserSection {
        /// What moves against --shake while the shutter is open: lens (the group that its sheet names), sensor, or the surfaces of a group, such as 15-17.
        ///
        /// Rays are traced through the lens with its group where it stands at their moment. Corner frequencies of the servo (100 Hz) and of drift (0.05 Hz) and the travel are keys of
        /// [camera.stabiliser] in a shot file. Its motion is in `-o calibration.json`. docs/rigs.md says what it answers.
        #[arg(long = "stabiliser", alias = "stabilizer", value_name = "WHAT")]
        pub moves: Option<String>,
        /// Corner of the servo, Hz; 100 without.
        #[arg(skip)]
        pub servo: Option<Hertz>,
        /// Corner frequency below which drift is removed, Hz; 0.05 without.
        #[arg(skip)]
        pub drift: Option<Hertz>,
        /// How far it moves from the axis at most; as far as it must without.
        #[arg(skip)]
        pub travel: Option<LengthMm>,
    }
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
    /// Up vector of the picture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub up: Option<[f32; 3]>,
}

section! {
    "Time":
    /// `[shutter]`
    pub struct ShutterSection {
        /// Shutter: global, leaf, focal-plane or rolling.
        #[arg(long = "shutter-type", value_name = "KIND")]
        pub kind: Option<String>,
        /// Of a focal-plane shutter: time that a curtain takes across the picture.
        #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
        pub travel: Option<Seconds>,
        /// Of a rolling shutter: time from one row of the picture to the next, "10.26us".
        ///
        /// Or from one column to the next, by --shutter-direction.
        #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
        pub line_time: Option<Seconds>,
        /// Of a rolling shutter, instead: time for the whole picture.
        #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
        pub readout: Option<Seconds>,
        /// Of a rolling shutter: rolling, or global (all rows begin at once).
        #[arg(long, value_name = "HOW")]
        pub reset: Option<String>,
        /// Which way curtains or rows run, as seen in the picture: down, up, right or left.
        #[arg(long = "shutter-direction", value_name = "WAY")]
        pub direction: Option<String>,
        /// Of a leaf shutter: time its blades take to open, and again to close.
        #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
        pub ramp: Option<Seconds>,
    }
}

section! {
    "Exposure":
    /// `[flash]`
    pub struct FlashSection {
        /// Fire a flash of this guide number (f-number × metres, ISO 100).
        ///
        /// At full power. A flash without it is refused.
        #[arg(long = "flash", value_name = "GN", allow_negative_numbers = true)]
        pub guide_number: Option<f64>,
        /// Its power, a fraction of full: "1/4".
        #[arg(long = "flash-power", value_name = "FRACTION", value_parser = fraction)]
        pub power: Option<f64>,
        /// Length of its pulse.
        #[arg(long = "flash-pulse", value_name = "TIME", allow_hyphen_values = true)]
        pub pulse: Option<Seconds>,
        /// first or second curtain, or high-speed.
        #[arg(long = "flash-sync", value_name = "WHEN")]
        pub sync: Option<String>,
        /// Where it is from the lens along the camera's axes (right, up, back), m.
        #[arg(skip)]
        pub offset: Option<[f32; 3]>,
    }
}

section! {
    "Exposure":
    /// `[sequence]`
    pub struct SequenceSection {
        /// An exposure series of so many pictures: files are numbered.
        #[arg(long, value_name = "N")]
        pub bracket: Option<u32>,
        /// From one picture of the series to the next: "1ev".
        #[arg(long, value_name = "EV", allow_hyphen_values = true)]
        pub step: Option<Ev>,
        /// A focus series of so many pictures, from what is focused on farther and farther: files are numbered.
        #[arg(long, value_name = "N", help_heading = "Focus")]
        pub focus_bracket: Option<u32>,
        /// From one of them to the next, in depths of focus; negative goes nearer.
        ///
        /// A depth of focus is 2 x f-number x circle of confusion, at the film. 1 without.
        #[arg(long, value_name = "X", allow_negative_numbers = true, help_heading = "Focus")]
        pub focus_step: Option<f64>,
        /// What differs in the series: `time` or `aperture`; without, the aperture in mode S and else the time.
        #[arg(skip)]
        pub vary: Option<String>,
        /// Frames of a film: files are numbered.
        #[arg(long, value_name = "N", help_heading = "Time")]
        pub frames: Option<u32>,
        /// Frames a second; 24 without.
        #[arg(long, value_name = "N", allow_negative_numbers = true, help_heading = "Time")]
        pub fps: Option<f64>,
        /// Exposure time of a frame as part of its duration, degrees: 180 is half of it.
        #[arg(long = "shutter-angle", value_name = "DEG", value_parser = degrees, allow_negative_numbers = true, help_heading = "Time")]
        pub shutter_angle_deg: Option<f64>,
        /// Exposures (2 or 3), the longest first, that a rolling sensor reads interleaved row by row (staggered, digital-overlap HDR): files are numbered.
        ///
        /// Each has its own exposure time, start and row times. Needs a rolling shutter (--readout, --line-time); a line takes as many times as long as there are
        /// exposures.
        #[arg(long, value_name = "N")]
        pub staggered: Option<u32>,
        /// How many times as long each of them is as the next; 16 without.
        #[arg(long, value_name = "RATIO", requires = "staggered", allow_negative_numbers = true)]
        pub staggered_ratio: Option<f64>,
        /// Least time between the reading of a row and the reset for its next exposure: "50us".
        ///
        /// None without.
        #[arg(long, value_name = "TIME", requires = "staggered")]
        pub staggered_gap: Option<Seconds>,
    }
}

section! {
    "Exposure":
    /// `[exposure]`
    pub struct ExposureSection {
        /// f-number: "f/2.8".
        #[arg(long, value_name = "F")]
        pub aperture: Option<FNumber>,
        /// Exposure time: "1/125"; metered without.
        #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
        pub shutter: Option<Seconds>,
        /// ISO speed, or auto.
        #[arg(long, value_name = "ISO|auto", allow_hyphen_values = true)]
        pub iso: Option<IsoChoice>,
        /// Lowest speed of --iso auto; the body's lowest without.
        #[arg(long, value_name = "ISO", allow_hyphen_values = true)]
        pub iso_min: Option<Iso>,
        /// Highest speed of --iso auto; 6400 without.
        #[arg(long, value_name = "ISO", allow_hyphen_values = true)]
        pub iso_max: Option<Iso>,
        /// The slowest time --iso auto keeps to and the program turns at; one over the focal length without.
        #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
        pub slowest: Option<Seconds>,
        /// M (manual), A (aperture priority), S (shutter priority) or P (program).
        ///
        /// Without, M if a time is given and A if not.
        #[arg(long, value_name = "M|A|S|P")]
        pub mode: Option<String>,
        /// average, centre-weighted, spot, matrix or highlight.
        #[arg(long, value_name = "PATTERN")]
        pub metering: Option<String>,
        /// Middle of the spot: "x,y", 0 to 1 across and down the picture.
        #[arg(long, value_name = "X,Y", value_parser = pair, allow_hyphen_values = true)]
        pub metering_at: Option<[f64; 2]>,
        /// More (+) or less light than the meter asks for: "+1", "-1/3 EV".
        #[arg(long, value_name = "EV", allow_hyphen_values = true)]
        pub compensation: Option<Ev>,
        /// Brighten pictures by so much when they are developed, and expose by as much less, to keep highlights: "1 EV" (DNG: BaselineExposure).
        ///
        /// What is set by hand is exposed as it is set. Without: behind microlenses what images of the pupil are brighter than the film would be, else 0.
        #[arg(long, value_name = "EV", allow_negative_numbers = true)]
        pub baseline: Option<Ev>,
        /// Neutral density filter: "ND8" (factor), "ND 0.9" (density), "3 stops".
        #[arg(long, value_name = "FILTER", allow_hyphen_values = true)]
        pub nd: Option<Filter>,
        /// Polarising filter before the lens: "linear:30deg" or "circular:30deg".
        ///
        /// The angle is that of its transmission axis: 0 horizontal, counter-clockwise as the photographer sees it. Ideal unless "linear:30deg,0.42,1000" gives the
        /// fraction of unpolarised light that it passes and its extinction ratio. Light is then followed with its polarisation (--polarized). The meter sees it.
        #[arg(long, value_name = "KIND:ANGLE", allow_hyphen_values = true)]
        pub polarizer: Option<Polarizer>,
        /// What the camera chooses clicks in full, half or third stops; without, it is exact.
        #[arg(long, value_name = "STEP")]
        pub dial: Option<String>,
        /// Engraved numbers stand for exact stops: f/5.6 for 5.657, 1/125 for 1/128.
        #[arg(long)]
        pub true_stops: bool,
        /// Illuminant the camera takes for white: D65, D50, A, FL2 ...
        #[arg(long, value_name = "NAME", help_heading = "Sensor")]
        pub white: Option<String>,
        /// Temperature of the sensor, °C.
        #[arg(skip)]
        pub temperature_c: Option<f64>,
        /// Leave the cap on the lens: a dark frame.
        #[arg(long)]
        pub lens_cap: bool,
    }
}

section! {
    "Focus":
    /// `[focus]`
    pub struct FocusSection {
        /// What is sharp: "2.5m", "inf", "auto", "at 0.4,0.6", "on NAME", "hyperfocal".
        ///
        /// "at 0.4,0.6" is a place in the picture, "on NAME" an object of the scene (`scene info` lists them), which is followed. Without,
        /// what the camera is aimed at. "extension 1.2mm" is a place of the film, from that for infinity.
        #[arg(long = "focus", value_name = "WHAT", allow_hyphen_values = true)]
        pub distance: Option<FocusTo>,
        /// Where autofocus looks: one, nine, or boxes "x,y,width,height;..." (fractions of the picture).
        #[arg(long = "focus-zones", value_name = "ZONES", allow_hyphen_values = true)]
        pub zones: Option<Zones>,
        /// Which zone counts, by a name of [`Priority`].
        #[arg(long = "focus-priority", value_name = "NAME", help = one_of("Which zone counts where they disagree", &Priority::NAMES))]
        pub priority: Option<String>,
        /// How autofocus searches, by a name of [`Method`].
        #[arg(long = "focus-method", value_name = "NAME", help = one_of("How autofocus searches", &Method::NAMES))]
        pub method: Option<String>,
        /// What contrast is measured by, by a name of [`Measure`].
        #[arg(long = "focus-measure", value_name = "NAME", help = one_of("What contrast is measured by", &Measure::NAMES))]
        pub measure: Option<String>,
        /// The motor: "step,backlash,speed" in mm, mm, mm/s of the film.
        ///
        /// Ideal without.
        #[arg(long = "focus-motor", value_name = "S,B,V", value_parser = triple, allow_hyphen_values = true)]
        pub motor: Option<[f64; 3]>,
        /// Autofocus looks at all positions of the film, in mm behind its place for infinity: "from,to,step", such as 0,10,0.1 (--plot-focus shows the curve).
        #[arg(long = "focus-sweep", value_name = "FROM,TO,STEP", value_parser = triple, allow_hyphen_values = true)]
        pub sweep: Option<[f64; 3]>,
        /// No picture when autofocus fails (exit code 1).
        #[arg(long = "require-focus")]
        pub require: bool,
    }
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

/// "one", "nine" or "x,y,width,height;...".
impl FromStr for Zones {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if !text.contains(',') {
            return Ok(Zones::Named(text.trim().to_owned()));
        }
        let zone = |part: &str| list(part)?.try_into().map_err(|_| format!("\"{part}\" is not a zone \"x,y,width,height\""));
        Ok(Zones::Boxes(text.split(';').filter(|p| !p.trim().is_empty()).map(zone).collect::<Result<_, String>>()?))
    }
}

section! {
    "Rendering":
    /// `[render]`
    pub struct RenderSection {
        /// Pixels of the picture: "1920x1280".
        #[arg(long, value_name = "WxH")]
        pub size: Option<Size>,
        /// Samples a pixel.
        #[arg(long, value_name = "N", value_parser = samples_a_pixel)]
        pub spp: Option<u32>,
        /// Only samples A to B (B not included) of --spp: parts can be merged later.
        #[arg(long, value_name = "A..B", value_parser = range)]
        pub samples: Option<[u32; 2]>,
        /// Seed of light transport and noise.
        #[arg(long, value_name = "N")]
        pub seed: Option<u64>,
        /// sobol, jittered, grid or independent.
        #[arg(long, value_name = "NAME")]
        pub sampler: Option<String>,
        /// Most scattering events of a path.
        #[arg(long, value_name = "N")]
        pub max_depth: Option<u32>,
        /// Follow light with its polarisation.
        ///
        /// Reflections, refraction, metals, films and coats, and the clear sky; along paths from the camera (--integrator path). --polarizer and bodies that tell
        /// polarisation do so anyway.
        #[arg(long)]
        pub polarized: bool,
        /// path: from the camera only. path-reuse: and light that the paths of one pixel found is reused by others. caustics: and photons from lamps over mirrors and through
        /// glass, and light from small lamps out of focus. bidirectional: and connections of camera paths with light paths from the lamps. auto: photons for small lamps where
        /// there is smooth glass or metal, light from small lamps out of focus, and path reuse or connections where a trial shows that they pay.
        #[arg(long, value_name = "NAME")]
        pub integrator: Option<String>,
        /// Stray light: all, none, or some of ghosts, diffraction, scatter with commas between them.
        ///
        /// ghosts: light of lamps that is reflected twice between surfaces, or between the sensor and a surface. scatter: veiling glare of surfaces, dust, barrel and edges. Both
        /// only in real lenses. diffraction: as --diffraction auto; where --stray leaves it out, there is none, unless --diffraction says otherwise. Without
        /// --stray: diffraction where it shows, no ghosts, no scatter. Meters and autofocus see no stray light.
        #[arg(long, value_name = "LIST")]
        pub stray: Option<String>,
        /// Time limit, about: "10s".
        ///
        /// With focusing, metering and denoising, which is left out where it does not fit. Of a sequence, for each picture.
        #[arg(long, value_name = "TIME")]
        pub time_limit: Option<Seconds>,
        /// Quick look: depth of field from one sharp exposure and its depth map (approximate).
        ///
        /// No rays are traced through the lens.
        #[arg(long)]
        pub quick: bool,
        /// Reduce the renderer's own noise: auto, on, off, oidn or builtin.
        ///
        /// auto: in pictures to look at (JPEG, PNG, TIFF) of `shoot`; raw files (DNG), EXR and `expose` keep what was computed, also of the same shot. on: in
        /// all files, by Intel Open Image Denoise where it is found, else by the built-in filter. oidn, builtin: in all files, by this one. The sensor's own
        /// noise comes after it and stays. true and false in a shot file mean on and off.
        #[arg(long, value_name = "WHICH", num_args = 0..=1, default_missing_value = "on")]
        pub denoise: Option<Denoise>,
        /// Library of Intel Open Image Denoise, or its folder; without, DIOPTER_OIDN, the system's libraries and Python's package pyoidn are searched.
        #[arg(long, value_name = "FILE")]
        pub oidn: Option<PathBuf>,
        /// Fireflies: keep them, or re-weight samples that those around do not support (reweight).
        ///
        /// Without it, shoot re-weights where all files are pictures (JPEG, PNG, TIFF), and keeps where one is an exposure (DNG, EXR, --truth, ...); expose keeps.
        /// The fraction of the light that was taken away is told. Parts of the samples and exposures larger than memory keep.
        #[arg(long, value_name = "keep|reweight")]
        pub fireflies: Option<FireflyChoice>,
        /// Truth channels that are recorded beside depth, normal, albedo and id: "position,flow" or "all".
        ///
        /// They go into focal planes (`expose`, --keep-plane) and --truth. Through the lens as it is, at each row's own time. docs/truth.md has the table of them, and a name
        /// that is none of them is answered with the list. The next frame is that of the film (--fps); of a single picture, 1/24 s later.
        #[arg(long, value_name = "LIST", help_heading = "Output")]
        pub truth_channels: Option<String>,
        /// Diffraction at the aperture: auto, on or off.
        ///
        /// The picture of every point is spread by the Fraunhofer pattern of the aperture as it is (blades, picture, what rims leave of it), and lamps brighter than
        /// white make stars. auto: where the Airy disk of green light is no smaller than a pixel of the picture. Not through a pinhole, behind microlenses or in a
        /// quick look.
        #[arg(long, value_name = "auto|on|off")]
        pub diffraction: Option<DiffractionChoice>,
    }
}

/// Whether light is diffracted at the aperture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
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
#[non_exhaustive]
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
