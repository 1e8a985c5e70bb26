//! Flags of a photograph, shared by all verbs that take one, and those of `shoot`, `expose` and the viewfinder.

use super::values::{checkpoint, degrees, fraction, pair, point, range, shift, tilt, triple, zones};
use super::{Developing, shot_of};
use crate::memory::Bytes;
use diopter::denoising::Denoise;
use diopter::image::dng::Storage;
use diopter::quantity::{Distance, Ev, FNumber, Filter, FocusTo, Iso, IsoChoice, LengthMm, Moment, Seconds, Size, SpectralBands};
use diopter::sheet::Axis;
use diopter::shot::ShotFile;
use diopter::shot::file::{FlashSection, FlickerSection, Zones};
use std::path::PathBuf;

/// How the channels of a truth file are laid out.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum TruthLayout {
    /// All channels in one part.
    SinglePart,
    /// A part for each kind of truth: light, raw, depth, normal ...
    MultiPart,
}

impl TruthLayout {
    /// As the writer has it.
    pub fn layout(self) -> diopter::image::exr::TruthLayout {
        match self {
            TruthLayout::SinglePart => diopter::image::exr::TruthLayout::SinglePart,
            TruthLayout::MultiPart => diopter::image::exr::TruthLayout::MultiPart,
        }
    }
}

/// How the numbers of a DNG are stored.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum DngStorage {
    /// 16 bits each: every program can read it.
    #[value(name = "16")]
    Sixteen,
    /// As many bits as the converter has.
    Packed,
    /// Lossless JPEG.
    Lossless,
}

/// What a raw file is made with.
#[derive(clap::Args, Debug)]
pub struct Raw {
    /// Serial number of the body: its fixed pattern is drawn from it.
    #[arg(long, value_name = "TEXT")]
    pub serial: Option<String>,
    /// Temperature of the sensor, °C.
    #[arg(long, value_name = "C", allow_negative_numbers = true)]
    pub temperature: Option<f64>,
    /// How numbers are stored in a DNG.
    #[arg(long, value_name = "HOW", default_value = "16")]
    pub dng: DngStorage,
}

/// What is photographed and how; shared by `shoot` and `expose`. Flags win over the shot file.
#[derive(clap::Args, Debug)]
pub struct Taking {
    /// Embedded scene, a scene file (.usd, .gltf, .glb, .pbrt, .xml (Mitsuba), .obj, .ply, .spz, .stl, .scene (by hand)), or a .toml shot file; - for a shot file on standard input.
    #[arg(value_name = "SCENE|SHOT.toml")]
    pub subject: Option<String>,
    /// Metres in a unit of length of the scene file: 0.001 for millimetres, 0.01 for centimetres.
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
    pub scale: Option<f64>,
    /// Which of the sets of materials that a glTF file offers.
    #[arg(long, value_name = "NAME")]
    pub variant: Option<String>,
    /// A table of the classes of objects for --truth-channels class and crypto-class: lines of "pattern, class", such as "chair*, chair".
    ///
    /// The first line whose pattern is the object's name counts; * stands for any text, "material:glass*, window" goes by the name of the material. Without it, the
    /// class is what glTF nodes say in extras (class, category or category_id).
    #[arg(long, value_name = "FILE")]
    pub classes: Option<PathBuf>,
    /// Fail when a texture of the scene cannot be read, instead of showing magenta in its place.
    #[arg(long)]
    pub strict: bool,
    /// Split displaced surfaces until no edge is longer than so many pixels of the picture, instead of as their file says.
    #[arg(long, value_name = "PIXELS", allow_negative_numbers = true)]
    pub displacement_edge_px: Option<f64>,
    /// What lights it: studio, sun, overcast, none (only its own light) or a lat-long .hdr, .exr or .pfm.
    ///
    /// studio: soft boxes of 1500 lx (key), 500 lx (fill) and 1000 lx (rim) and a grey sweep to stand on; what a scene without light of its own gets.
    /// sun: a clear day, the sun behind the camera to its left. overcast: a grey sky of 10 000 lx. Both put a ground under the scene.
    /// A file: its numbers are taken for relative, and scaled to 10 000 lx on average; --environment takes them for cd/m².
    #[arg(long, value_name = "KIND|FILE")]
    pub light: Option<String>,
    /// Light from all around, in cd/m²: a lat-long .hdr, .exr or .pfm; as --light, its numbers are relative.
    #[arg(long, value_name = "FILE")]
    pub environment: Option<PathBuf>,
    /// Turn the environment about the vertical, degrees.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub environment_rotation: Option<f32>,
    /// Sun and clear sky of a moment, with its zone (2026-06-21T12:00+02:00); needs --place.
    #[arg(long, value_name = "TIME", requires = "place", conflicts_with = "sun")]
    pub daylight: Option<Moment>,
    /// Where on earth --daylight is: latitude and longitude, degrees, north and east positive.
    #[arg(long, value_name = "LAT,LON", allow_hyphen_values = true, value_parser = pair, requires = "daylight")]
    pub place: Option<[f64; 2]>,
    /// Sun and clear sky with the sun at this elevation and azimuth, degrees.
    ///
    /// The azimuth counts from north, -z, towards east, +x.
    #[arg(long, value_name = "ELEV,AZ", allow_hyphen_values = true, value_parser = pair)]
    pub sun: Option<[f64; 2]>,
    /// Haze of daylight: 1 pure air, 3 clear, 10 thick.
    #[arg(long, value_name = "T")]
    pub turbidity: Option<f64>,
    /// Fog in which one sees this far; it ends so far around the scene and the camera where light comes from the sky.
    #[arg(long, value_name = "DISTANCE", allow_hyphen_values = true)]
    pub fog: Option<Distance>,
    /// Put a large matte floor of this albedo (0 to 1) under the scene.
    #[arg(long, value_name = "ALBEDO")]
    pub ground: Option<f32>,
    /// Scale all light so that the mean luminance of what the lens shows is that of this EV (ISO 100).
    ///
    /// A meter may read less: it sees dark corners and clipped highlights.
    #[arg(long, value_name = "EV", allow_negative_numbers = true)]
    pub ambient_ev: Option<f64>,
    /// Camera body: a name from `body list` or a TOML file.
    #[arg(long, value_name = "NAME|FILE")]
    pub body: Option<String>,
    /// Film format instead of the body's: a name ("full frame", "APS-C", "4/3") or mm ("36x24").
    #[arg(long, value_name = "NAME|MM")]
    pub format: Option<String>,
    /// Lens: thin, pinhole, panorama, name (`lens list`) or file (.toml, .dat, .zmx, .seq, .len, .json).
    ///
    /// Ideal fisheyes are fisheye-equidistant, fisheye-equisolid, fisheye-stereographic and fisheye-orthographic.
    /// "sheet.toml#17" is build 17 of a tolerance sheet (`lens tolerance`).
    #[arg(long, value_name = "NAME|FILE")]
    pub lens: Option<String>,
    /// Focal length: "50 mm"; of a zoom, where it is set.
    #[arg(long, value_name = "LENGTH")]
    pub focal_length: Option<LengthMm>,
    /// A zoom position that the lens's prescription prints, 1 the first.
    #[arg(long, value_name = "N", conflicts_with = "focal_length")]
    pub zoom_position: Option<usize>,
    /// See by a calibration instead of a lens: OpenCV (.yaml), COLMAP (cameras.txt), nerfstudio (transforms.json), Kalibr, our .json, an ST map or a ray table (.exr).
    ///
    /// Everything is sharp unless --aperture is given.
    #[arg(long, value_name = "FILE")]
    pub camera: Option<PathBuf>,
    /// Angle of view of an ideal lens from the left to the right edge, instead of its focal length: "90deg".
    #[arg(long, value_name = "ANGLE", value_parser = degrees, conflicts_with = "focal_length")]
    pub fov: Option<f64>,
    /// No perspective: the height that the picture shows, "2m".
    #[arg(long, value_name = "HEIGHT", conflicts_with_all = ["camera", "fov"])]
    pub orthographic: Option<Distance>,
    /// Move the lens against the film, to the right and up: "5mm", "0,8mm". The picture shows more of that side.
    #[arg(long, value_name = "X[,Y]", value_parser = shift, allow_hyphen_values = true)]
    pub shift: Option<[f64; 2]>,
    /// Turn the lens against the film, forward (down) and to the right: "8deg", "0,5deg". The view stays, the sharp plane turns. A traced lens turns about its
    /// rear principal point.
    #[arg(long, value_name = "X[,Y]", value_parser = tilt, allow_hyphen_values = true)]
    pub tilt: Option<[f64; 2]>,
    /// Blades of the iris; without, the lens's own, or round.
    #[arg(long, value_name = "N")]
    pub blades: Option<u32>,
    /// How round the blades are: 0 straight to 1.
    #[arg(long, value_name = "X")]
    pub blade_curvature: Option<f32>,
    /// A picture (PNG, JPEG) as aperture: white lets light through.
    #[arg(long, value_name = "FILE")]
    pub aperture_image: Option<PathBuf>,
    /// Turn the iris, degrees.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub blade_rotation: Option<f32>,
    /// A hood of this length before a real lens, as narrow as the picture allows: keeps light from beside off the front glass.
    ///
    /// It shows with --stray scatter. A lens sheet can have its own ([hood]).
    #[arg(long, value_name = "LENGTH")]
    pub hood: Option<LengthMm>,
    /// A plenoptic camera: a microlens array of this pitch before the sensor, such as 0.1mm.
    #[arg(long, value_name = "PITCH")]
    pub plenoptic: Option<LengthMm>,
    /// Focal length of the microlenses; without, the pitch times the f-number.
    #[arg(long, value_name = "LENGTH")]
    pub microlens_focal_length: Option<LengthMm>,
    /// From the microlenses to the sensor; their focal length without.
    #[arg(long, value_name = "LENGTH")]
    pub microlens_gap: Option<LengthMm>,
    /// How the microlenses are laid out: square or hexagonal.
    #[arg(long, value_name = "LAYOUT")]
    pub microlens_arrangement: Option<String>,
    /// Where the camera stands: "x,y,z" in m.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub look_from: Option<[f32; 3]>,
    /// What it is aimed at: "x,y,z" in m.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub look_at: Option<[f32; 3]>,
    /// What is up in the picture: "0,1,0".
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true)]
    pub up: Option<[f32; 3]>,
    /// A camera of the scene file, by name or number.
    #[arg(long, value_name = "NAME")]
    pub viewpoint: Option<String>,
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
    /// Neutral density filter: "ND8" (factor), "ND 0.9" (density), "3 stops".
    #[arg(long, value_name = "FILTER", allow_hyphen_values = true)]
    pub nd: Option<Filter>,
    /// Polarising filter before the lens: "linear:30deg" or "circular:30deg".
    ///
    /// The angle is that of its transmission axis: 0 horizontal, counter-clockwise as the photographer sees it. Ideal unless "linear:30deg,0.42,1000" gives the
    /// fraction of unpolarised light that it passes and its extinction ratio. Light is then followed with its polarisation (--polarized). The meter sees it.
    #[arg(long, value_name = "KIND:ANGLE", allow_hyphen_values = true)]
    pub polarizer: Option<diopter::Polarizer>,
    /// What the camera chooses clicks in full, half or third stops; without, it is exact.
    #[arg(long, value_name = "STEP")]
    pub dial: Option<String>,
    /// Engraved numbers stand for exact stops: f/5.6 for 5.657, 1/125 for 1/128.
    #[arg(long)]
    pub true_stops: bool,
    /// Shutter: global, leaf, focal-plane or rolling.
    #[arg(long, value_name = "KIND")]
    pub shutter_type: Option<String>,
    /// Which way curtains or rows run, as seen in the picture: down, up, right or left.
    #[arg(long, value_name = "WAY")]
    pub shutter_direction: Option<String>,
    /// Of a focal-plane shutter: time that a curtain takes across the picture.
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub travel: Option<Seconds>,
    /// Of a rolling shutter: time from one row of the picture to the next, "10.26us".
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub line_time: Option<Seconds>,
    /// Of a rolling shutter, instead: time for the whole picture.
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub readout: Option<Seconds>,
    /// Of a rolling shutter: rolling, or global (all rows begin at once).
    #[arg(long, value_name = "HOW")]
    pub reset: Option<String>,
    /// Of a leaf shutter: time its blades take to open, and again to close.
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub ramp: Option<Seconds>,
    /// Moment the exposure begins, on the clock of the scene's animations: "1.25s".
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub at: Option<Seconds>,
    /// Which animation runs: its name or number, all or none; the first without.
    #[arg(long, value_name = "NAME")]
    pub animation: Option<String>,
    /// After the last key: clamp (stand still) or loop.
    #[arg(long, value_name = "HOW")]
    pub animation_end: Option<String>,
    /// Nothing moves: all stands as it does at --at.
    #[arg(long)]
    pub frozen: bool,
    /// Unsteady hands: angular speed (rms), deg/s; 0.6 is a steady hand.
    #[arg(long, value_name = "DEG/S", allow_negative_numbers = true)]
    pub shake: Option<f64>,
    /// What moves against --shake while the shutter is open: lens (the group that its sheet names), sensor, or the surfaces of a group, such as 15-17.
    ///
    /// Rays are traced through the lens with its group where it stands at their moment. Corner frequencies of the servo (100 Hz) and of drift (0.05 Hz) and the travel are keys of
    /// [camera.stabiliser] in a shot file. Its way is in `-o calibration.json`. docs/rigs.md says what it answers.
    #[arg(long, alias = "stabilizer", value_name = "WHAT")]
    pub stabiliser: Option<String>,
    /// Lamps flicker: "mains 50 Hz" or "mains 50 Hz 0.8" (depth), "pwm 240 Hz 0.3" (fraction of time on).
    #[arg(long, value_name = "HOW")]
    pub flicker: Option<FlickerSection>,
    /// Fire a flash of this guide number (f-number × metres, ISO 100).
    #[arg(long, value_name = "GN", allow_negative_numbers = true)]
    pub flash: Option<f64>,
    /// Its power, a fraction of full: "1/4".
    #[arg(long, value_name = "FRACTION", value_parser = fraction)]
    pub flash_power: Option<f64>,
    /// Length of its pulse.
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub flash_pulse: Option<Seconds>,
    /// first or second curtain, or high-speed.
    #[arg(long, value_name = "WHEN")]
    pub flash_sync: Option<String>,
    /// Illuminant the camera takes for white: D65, D50, A, FL2 ...
    #[arg(long, value_name = "NAME")]
    pub white: Option<String>,
    /// Leave the cap on the lens: a dark frame.
    #[arg(long)]
    pub lens_cap: bool,
    /// What is sharp: "2.5m", "inf", "auto", "at 0.4,0.6", "on NAME", "hyperfocal".
    ///
    /// "at 0.4,0.6" is a place in the picture, "on NAME" an object of the scene (`scene info` lists them), which is followed. Without,
    /// what the camera is aimed at.
    #[arg(long, value_name = "WHAT", allow_hyphen_values = true)]
    pub focus: Option<FocusTo>,
    /// Where autofocus looks: one, nine, or boxes "x,y,width,height;..." (fractions of the picture).
    #[arg(long, value_name = "ZONES", value_parser = zones, allow_hyphen_values = true)]
    pub focus_zones: Option<Zones>,
    /// Which zone counts: closest (macro), farthest (background), median, front-median or back-median (of the nearer or farther half), centre or most.
    #[arg(long, value_name = "NAME")]
    pub focus_priority: Option<String>,
    /// hybrid (phase, then contrast), phase, contrast or exhaustive.
    #[arg(long, value_name = "NAME")]
    pub focus_method: Option<String>,
    /// What contrast is measured by: sml, tenengrad or variance.
    #[arg(long, value_name = "NAME")]
    pub focus_measure: Option<String>,
    /// The motor: "step,backlash,speed" in mm, mm, mm/s of the film.
    #[arg(long, value_name = "S,B,V", value_parser = triple, allow_hyphen_values = true)]
    pub focus_motor: Option<[f64; 3]>,
    /// Autofocus looks at all positions of the film, in mm behind its place for infinity: "from,to,step", such as 0,10,0.1 (--plot-focus shows the curve).
    #[arg(long, value_name = "FROM,TO,STEP", value_parser = triple, allow_hyphen_values = true)]
    pub focus_sweep: Option<[f64; 3]>,
    /// No picture when autofocus fails (exit code 1).
    #[arg(long)]
    pub require_focus: bool,
    /// Pixels of the picture: "1920x1280".
    #[arg(long, value_name = "WxH")]
    pub size: Option<Size>,
    /// Samples a pixel.
    #[arg(long, value_name = "N")]
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
    /// path: from the camera only. caustics: and photons from lamps over mirrors and through glass, and light from small lamps out of focus.
    /// bidirectional: and connections of camera paths with light paths from the lamps. auto: photons for small lamps where there is smooth glass or metal, light from
    /// small lamps out of focus, and connections where a trial shows that they pay.
    #[arg(long, value_name = "NAME")]
    pub integrator: Option<String>,
    /// Follow light with its polarisation.
    ///
    /// Reflections, refraction, metals, films and coats, and the clear sky; along paths from the camera (--integrator path). --polarizer and bodies that tell
    /// polarisation do so anyway.
    #[arg(long)]
    pub polarized: bool,
    /// Stray light: all, none, or some of ghosts, diffraction, scatter with commas between them.
    ///
    /// ghosts: light of lamps that pairs of surfaces, and the sensor, throw back and forth. scatter: veiling glare of surfaces, dust, barrel and edges. Both
    /// only in real lenses. diffraction: as --diffraction auto; where --stray leaves it out, there is none, unless --diffraction says otherwise. Without
    /// --stray: diffraction where it shows, no ghosts, no scatter. Meters and autofocus see no stray light.
    #[arg(long, value_name = "LIST")]
    pub stray: Option<String>,
    /// A quick look: blur made from one sharp exposure and its depth.
    ///
    /// No rays are traced through the lens.
    #[arg(long)]
    pub quick: bool,
    /// Reduce the renderer's own noise: auto, on, off, oidn or builtin.
    ///
    /// auto: in pictures to look at (JPEG, PNG, TIFF) of `shoot`; raw files (DNG), EXR and `expose` keep what was computed, also of the same shot. on: in
    /// all files, by Intel Open Image Denoise where it is found, else by the built-in filter. oidn, builtin: in all files, by this one. The sensor's own
    /// noise comes after it and stays.
    #[arg(long, value_name = "WHICH", num_args = 0..=1, default_missing_value = "on")]
    pub denoise: Option<Denoise>,
    /// Library of Intel Open Image Denoise, or its folder; without, DIOPTER_OIDN, the system's libraries and Python's package pyoidn are searched.
    #[arg(long, value_name = "FILE")]
    pub oidn: Option<PathBuf>,
    /// Outliers that remain when the samples end: count them less (reweight), or leave them as computed (keep).
    ///
    /// Without it, shoot re-weights where all files are pictures (JPEG, PNG, TIFF), and keeps where one is an exposure (DNG, EXR, --truth, ...); expose keeps.
    /// The fraction of the light that was taken away is told. Parts of the samples and exposures larger than memory keep.
    #[arg(long, value_name = "keep|reweight")]
    pub fireflies: Option<diopter::shot::FireflyChoice>,
    /// Truth channels that are recorded beside depth, normal, albedo and id: "position,flow" or "all".
    ///
    /// They go into focal planes (`expose`, --keep-plane) and --truth. Through the lens as it is, at each row's own time. docs/truth.md has the table of them:
    /// position, distance, uv, incidence, coc (circle of confusion), pupil (vignetting), motion, flow, backward-flow, transmitted (behind glass), coverage, crypto-object,
    /// crypto-material and crypto-class (Cryptomatte), class. The next frame is that of the film (--fps); of a single picture, 1/24 s later.
    #[arg(long, value_name = "LIST")]
    pub truth_channels: Option<String>,
    /// Diffraction at the aperture: auto, on or off.
    ///
    /// The picture of every point is spread by the Fraunhofer pattern of the aperture as it is (blades, picture, what rims leave of it), and lamps brighter than
    /// white make stars. auto: where the Airy disk of green light is no smaller than a pixel of the picture. Not through a pinhole, behind microlenses or in a
    /// quick look.
    #[arg(long, value_name = "auto|on|off")]
    pub diffraction: Option<diopter::shot::DiffractionChoice>,
    /// Take about so long in all: "10s".
    ///
    /// With focusing, metering and denoising, which is left out where it does not fit. Of a sequence, for each picture.
    #[arg(long, value_name = "TIME")]
    pub time_limit: Option<Seconds>,
    /// Take no more memory than this ("4GB"); without, than is free. `expose` puts what is left into a temporary file beside its output, where it needs
    /// 16 bytes a pixel and band; others refuse what is too large.
    #[arg(long, value_name = "SIZE")]
    pub max_memory: Option<Bytes>,
    /// How often a long exposure is saved beside its output (FILE.checkpoint), to go on after being stopped or killed; without, every 30 s
    /// of exposures above a minute.
    #[arg(long, value_name = "TIME|off", value_parser = checkpoint)]
    pub checkpoint: Option<Checkpoint>,
    /// Go on from this exposure's checkpoint, and fail if there is none; without, it goes on if there is one.
    #[arg(long)]
    pub resume: bool,
    /// Begin anew even if there is a checkpoint.
    #[arg(long, conflicts_with = "resume")]
    pub no_resume: bool,
}

/// When checkpoints are written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Checkpoint {
    /// Never.
    Off,
    /// From one to the next, s.
    Every(f64),
}

#[derive(clap::Args, Debug)]
pub struct Viewfinder {
    /// Embedded scene, a scene file (.usd, .gltf, .glb, .pbrt, .xml (Mitsuba), .obj, .ply, .spz, .stl, .scene (by hand)), or a .toml shot file; the still life without.
    #[arg(value_name = "SCENE|SHOT.toml")]
    pub subject: Option<String>,
    /// Folder with scenes, pictures of light, lenses and tables that the page may open; may be given several times. Without, only what is embedded.
    #[arg(long, value_name = "FOLDER")]
    pub folder: Vec<PathBuf>,
    /// Port on 127.0.0.1; 0 for a free one.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub port: u16,
    /// Open the page in the browser, too; without, only its address is printed.
    #[arg(long)]
    pub open: bool,
}

#[derive(clap::Args, Debug)]
pub struct Shoot {
    #[command(flatten)]
    pub taking: Taking,
    #[command(flatten)]
    pub developing: Developing,
    #[command(flatten)]
    pub raw: Raw,
    /// Write the truth of each pixel (EXR): noise-free electrons, variances, clipping, depth, ids.
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// How the channels of --truth are laid out in the file.
    #[arg(long, value_enum, value_name = "LAYOUT", default_value = "single-part", requires = "truth")]
    pub truth_layout: TruthLayout,
    /// Write the names of the Cryptomatte layers of --truth beside it, too: NAME.CryptoObject.json and so on.
    #[arg(long, requires = "truth")]
    pub truth_sidecar: bool,
    /// Keep the focal plane too (EXR).
    #[arg(long, value_name = "FILE")]
    pub keep_plane: Option<PathBuf>,
    /// An exposure series of so many pictures: files are numbered.
    #[arg(long, value_name = "N")]
    pub bracket: Option<u32>,
    /// From one picture of the series to the next: "1ev".
    #[arg(long, value_name = "EV", allow_hyphen_values = true)]
    pub step: Option<Ev>,
    /// Join the series: linear light (.exr), a raw file (.dng) or a picture.
    #[arg(long, value_name = "FILE")]
    pub merge: Option<PathBuf>,
    /// A focus series of so many pictures, from what is focused on farther and farther: files are numbered.
    #[arg(long, value_name = "N")]
    pub focus_bracket: Option<u32>,
    /// From one of them to the next, in depths of focus; negative goes nearer.
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub focus_step: Option<f64>,
    /// Join the focus series into one picture that is sharp all over.
    #[arg(long, value_name = "FILE")]
    pub stack: Option<PathBuf>,
    /// What autofocus saw, as a plot (.svg or .png).
    #[arg(long, value_name = "FILE")]
    pub plot_focus: Option<PathBuf>,
    /// Frames of a film: files are numbered.
    #[arg(long, value_name = "N")]
    pub frames: Option<u32>,
    /// Frames a second; 24 without.
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub fps: Option<f64>,
    /// Exposure time of a frame as part of its duration, degrees: 180 is half of it.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub shutter_angle: Option<f64>,
    /// Exposures (2 or 3), the longest first, that a rolling sensor reads interleaved row by row (staggered, digital-overlap HDR): files are numbered.
    ///
    /// Each has its own exposure time, start and row times. Needs a rolling shutter (--readout, --line-time); a line takes as many times as long as there are
    /// exposures.
    #[arg(long, value_name = "N")]
    pub staggered: Option<u32>,
    /// How many times as long each of them is as the next; 16 without.
    #[arg(long, value_name = "X", requires = "staggered", allow_negative_numbers = true)]
    pub staggered_ratio: Option<f64>,
    /// Least time between the reading of a row and the reset for its next exposure: "50us".
    #[arg(long, value_name = "TIME", requires = "staggered")]
    pub staggered_gap: Option<Seconds>,
    /// Split pixels: each output is written twice, as the left and the right photodiode saw it (NAME-left, NAME-right).
    #[arg(long)]
    pub dual_pixel: bool,
    /// Vary a setting of the shot: "iso=100,400,1600"; a second goes down the sheet.
    ///
    /// A flag's name without dashes, a setting of the development (tone.curve), or a key of the shot file. Settings that change together:
    /// "aperture:shutter=f/2:1/60,f/4:1/15". Values that have commas are separated by semicolons.
    #[arg(long, value_name = "NAME=A,B,C", requires = "sheet")]
    pub vary: Vec<Axis>,
    /// Contact sheet of the varied shots: .png, .jpg, .html or .pdf; may be given several times.
    #[arg(long, value_name = "FILE", requires = "vary", conflicts_with_all = ["output", "truth", "keep_plane", "bracket", "merge", "focus_bracket", "stack", "plot_focus", "frames", "save_shot"])]
    pub sheet: Vec<PathBuf>,
    /// Also show a part of each picture at 100 %: its middle, "x,y", 0 to 1 across and down the picture.
    #[arg(long, value_name = "X,Y", value_parser = pair, requires = "sheet")]
    pub sheet_crop: Option<[f64; 2]>,
    /// Also show the histogram of each picture.
    #[arg(long, requires = "sheet")]
    pub sheet_histogram: bool,
    /// Longer side of the pictures on the sheet, px; larger ones are reduced. 480 without.
    #[arg(long, value_name = "PX", requires = "sheet")]
    pub sheet_cell: Option<usize>,
    /// Pictures beside each other on the sheet.
    #[arg(long, value_name = "N", requires = "sheet")]
    pub sheet_columns: Option<usize>,
    /// Title of the sheet.
    #[arg(long, value_name = "TEXT", requires = "sheet")]
    pub sheet_title: Option<String>,
    /// A table under the pictures: what a command of `calc` prints.
    ///
    /// Such as "calc stop --focal-length 50mm"; may be given several times.
    #[arg(long, value_name = "COMMAND", requires = "sheet")]
    pub sheet_table: Vec<String>,
    /// Write what is being shot as a shot file.
    #[arg(long, value_name = "FILE")]
    pub save_shot: Option<PathBuf>,
    /// File to write: .jpg, .png, .tif, .exr (linear) or .dng (raw); may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct Expose {
    #[command(flatten)]
    pub taking: Taking,
    /// Linear sRGB of the light that arrives, cd/m², instead of the sensor's electrons: what renderers write.
    #[arg(long)]
    pub radiance: bool,
    /// With --radiance: compute with red, green and blue as RGB renderers do, instead of spectra, to compare with them.
    #[arg(long, requires = "radiance", conflicts_with = "bands")]
    pub rgb: bool,
    /// Mean spectral radiance in narrow bands, W/(m² sr nm), instead of the sensor's electrons: "400..700/10nm" (hyperspectral).
    #[arg(long, value_name = "FROM..TO/STEP", conflicts_with = "radiance")]
    pub bands: Option<SpectralBands>,
    /// Focal plane to write (.exr).
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

impl Raw {
    /// How numbers are stored.
    pub fn storage(&self) -> Storage {
        match self.dng {
            DngStorage::Sixteen => Storage::Sixteen,
            DngStorage::Packed => Storage::Packed,
            DngStorage::Lossless => Storage::Lossless,
        }
    }
}

impl Taking {
    /// The shot file that is meant: the one given, with the flags on top.
    pub fn shot_file(&self) -> Result<ShotFile, diopter::shot::ShotError> {
        let mut shot = shot_of(self.subject.as_deref())?;
        fn over<T: Clone>(to: &mut Option<T>, from: &Option<T>) {
            if from.is_some() {
                to.clone_from(from);
            }
        }
        let (scene, camera, exposure, render) = (&mut shot.scene, &mut shot.camera, &mut shot.exposure, &mut shot.render);
        over(&mut scene.scale, &self.scale);
        over(&mut scene.variant, &self.variant);
        scene.strict |= self.strict;
        over(&mut scene.displacement_edge_px, &self.displacement_edge_px);
        over(&mut scene.classes, &self.classes);
        over(&mut scene.light, &self.light);
        over(&mut scene.environment, &self.environment);
        over(&mut scene.environment_rotation_deg, &self.environment_rotation);
        if self.daylight.is_some() || self.sun.is_some() {
            let day = scene.daylight.get_or_insert_default();
            (day.time, day.place, day.sun) = (self.daylight, self.place, self.sun);
        }
        if self.turbidity.is_some() {
            scene.daylight.get_or_insert_default().turbidity = self.turbidity;
        }
        if self.fog.is_some() {
            scene.fog.get_or_insert_default().visibility = self.fog;
        }
        over(&mut scene.ground, &self.ground);
        over(&mut scene.ambient_ev, &self.ambient_ev);
        over(&mut camera.body, &self.body);
        over(&mut camera.format, &self.format);
        // A lens or a calibration given here takes the place of the other from a file.
        if self.lens.is_some() || self.camera.is_some() {
            (camera.lens, camera.calibration) = (self.lens.clone(), self.camera.clone());
        }
        if self.fov.is_some() {
            (camera.fov_deg, camera.focal_length) = (self.fov, None);
        }
        over(&mut camera.orthographic, &self.orthographic);
        over(&mut camera.shift_mm, &self.shift);
        over(&mut camera.tilt_deg, &self.tilt);
        // One says where the zoom is set: the other, from a file, no longer counts.
        if self.focal_length.is_some() || self.zoom_position.is_some() {
            (camera.focal_length, camera.zoom_position) = (self.focal_length, self.zoom_position);
            camera.fov_deg = None;
        }
        over(&mut camera.blades, &self.blades);
        over(&mut camera.blade_rotation_deg, &self.blade_rotation);
        over(&mut camera.blade_curvature, &self.blade_curvature);
        over(&mut camera.aperture_image, &self.aperture_image);
        over(&mut camera.hood, &self.hood);
        let lenses = (&self.plenoptic, &self.microlens_focal_length, &self.microlens_gap, &self.microlens_arrangement);
        if !matches!(lenses, (None, None, None, None)) {
            let array = camera.plenoptic.get_or_insert_default();
            over(&mut array.pitch, lenses.0);
            over(&mut array.focal_length, lenses.1);
            over(&mut array.gap, lenses.2);
            over(&mut array.arrangement, lenses.3);
        }
        over(&mut camera.look_from, &self.look_from);
        over(&mut camera.look_at, &self.look_at);
        over(&mut camera.up, &self.up);
        over(&mut camera.viewpoint, &self.viewpoint);
        over(&mut exposure.aperture, &self.aperture);
        over(&mut exposure.shutter, &self.shutter);
        over(&mut exposure.iso, &self.iso);
        over(&mut exposure.white, &self.white);
        exposure.lens_cap |= self.lens_cap;
        over(&mut exposure.iso_min, &self.iso_min);
        over(&mut exposure.iso_max, &self.iso_max);
        over(&mut exposure.slowest, &self.slowest);
        over(&mut exposure.mode, &self.mode);
        over(&mut exposure.metering, &self.metering);
        over(&mut exposure.metering_at, &self.metering_at);
        over(&mut exposure.compensation, &self.compensation);
        over(&mut exposure.nd, &self.nd);
        over(&mut exposure.polarizer, &self.polarizer);
        over(&mut exposure.dial, &self.dial);
        over(&mut exposure.true_stops, &self.true_stops.then_some(true));
        over(&mut scene.at, &self.at);
        over(&mut scene.animation, &self.animation);
        over(&mut scene.animation_end, &self.animation_end);
        over(&mut scene.frozen, &self.frozen.then_some(true));
        if let Some(flicker) = &self.flicker {
            scene.flicker = vec![flicker.clone()];
        }
        over(&mut camera.shake, &self.shake);
        if self.stabiliser.is_some() {
            camera.stabiliser.get_or_insert_default().moves.clone_from(&self.stabiliser);
        }
        let shutter = &mut shot.shutter;
        if self.shutter_type.as_ref().is_some_and(|k| shutter.kind.as_ref() != Some(k)) {
            // Times of another kind of shutter do not go with this one.
            *shutter = Default::default();
        }
        over(&mut shutter.kind, &self.shutter_type);
        over(&mut shutter.direction, &self.shutter_direction);
        over(&mut shutter.travel, &self.travel);
        over(&mut shutter.line_time, &self.line_time);
        over(&mut shutter.readout, &self.readout);
        over(&mut shutter.reset, &self.reset);
        over(&mut shutter.ramp, &self.ramp);
        if let Some(guide_number) = self.flash {
            let (power, pulse, sync, offset) = (None, None, None, None);
            shot.flash = Some(match shot.flash.take() {
                Some(flash) => FlashSection { guide_number, ..flash },
                None => FlashSection { guide_number, power, pulse, sync, offset },
            });
        }
        if shot.flash.is_none() && (self.flash_power.is_some() || self.flash_pulse.is_some() || self.flash_sync.is_some()) {
            return Err(diopter::shot::ShotError::Value {
                what: "flash",
                found: "is not fired".into(),
                expected: "--flash GN beside its power, pulse or sync".into(),
            });
        }
        if let Some(flash) = &mut shot.flash {
            over(&mut flash.power, &self.flash_power);
            over(&mut flash.pulse, &self.flash_pulse);
            over(&mut flash.sync, &self.flash_sync);
        }
        over(&mut shot.focus.distance, &self.focus);
        over(&mut shot.focus.zones, &self.focus_zones);
        over(&mut shot.focus.priority, &self.focus_priority);
        over(&mut shot.focus.method, &self.focus_method);
        over(&mut shot.focus.measure, &self.focus_measure);
        over(&mut shot.focus.motor, &self.focus_motor);
        over(&mut shot.focus.sweep, &self.focus_sweep);
        shot.focus.require |= self.require_focus;
        over(&mut render.size, &self.size);
        over(&mut render.spp, &self.spp);
        over(&mut render.samples, &self.samples);
        over(&mut render.seed, &self.seed);
        over(&mut render.sampler, &self.sampler);
        over(&mut render.max_depth, &self.max_depth);
        over(&mut render.integrator, &self.integrator);
        render.polarized |= self.polarized;
        over(&mut render.stray, &self.stray);
        over(&mut render.time_limit, &self.time_limit);
        over(&mut render.denoise, &self.denoise);
        over(&mut render.fireflies, &self.fireflies);
        over(&mut render.truth_channels, &self.truth_channels);
        over(&mut render.diffraction, &self.diffraction);
        over(&mut render.oidn, &self.oidn);
        render.quick |= self.quick;
        Ok(shot)
    }
}
