//! What can be typed: the one source of help, manual pages and completions. [`crate::help`] puts the flags of a photograph under headings.

use crate::memory::Bytes;
use clap::{Parser, Subcommand};
use diopter::denoising::Denoise;
use diopter::files;
use diopter::image::dng::Storage;
use diopter::quantity::{Distance, Ev, FNumber, Filter, FocusTo, Iso, IsoChoice, LengthMm, Moment, Seconds, Size, SpectralBands};
use diopter::sheet::Axis;
use diopter::shot::ShotFile;
use diopter::shot::file::{FlashSection, FlickerSection, Zones};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Photographs of 3D scenes the way a real camera takes them.
#[derive(Parser, Debug)]
#[command(name = "diopter", version, propagate_version = true, args_override_self = true)]
pub struct Args {
    /// Print machine-readable results and errors on standard output.
    #[arg(long, global = true)]
    pub json: bool,
    /// Threads to use; all without. The result does not depend on it.
    #[arg(long, global = true, value_name = "N")]
    pub threads: Option<NonZeroUsize>,
    #[command(subcommand)]
    pub verb: Verb,
}

#[derive(Subcommand, Debug)]
pub enum Verb {
    /// Take a photograph: expose, read out, develop. Without arguments: the embedded still life into photo.jpg.
    Shoot(Box<Shoot>),
    /// Expose only: a scene onto the focal plane (EXR with mean, variance, depth, normals, albedo, ids).
    Expose(Box<Expose>),
    /// Read a focal plane out into raw files (DNG).
    ReadOut(ReadOut),
    /// Develop raw files (DNG) into pictures.
    Develop(Develop),
    /// Look-up tables for colour (.cube).
    Lut {
        #[command(subcommand)]
        verb: LutVerb,
    },
    /// Calculators.
    Calc {
        #[command(subcommand)]
        verb: CalcVerb,
    },
    /// Reduce the renderer's own noise in a focal plane, by its variance, normals, albedo and depth.
    Denoise {
        /// Focal plane (.exr).
        plane: PathBuf,
        /// Focal plane to write (.exr).
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        /// By what: on (Open Image Denoise where it is found, else the built-in filter), oidn or builtin.
        #[arg(long, value_name = "WHICH", default_value_t = Denoise::On)]
        by: Denoise,
        /// Library of Intel Open Image Denoise, or its folder; without, DIOPTER_OIDN, the system's libraries and Python's package pyoidn are searched.
        #[arg(long, value_name = "FILE")]
        oidn: Option<PathBuf>,
    },
    /// Join focal planes that hold different samples of the same picture, or the raw files of an exposure series.
    Merge(Merge),
    /// Depth of field for a sharp picture with depth: a focal plane, or any EXR with R, G, B and Z.
    QuickLook(QuickLook),
    /// Join a focus series into one picture that is sharp all over.
    Stack(Stack),
    /// A contact sheet: one shot with a setting varied, pictures side by side with what changed.
    Sheet(Sheet),
    /// Several cameras on one frame: pictures of all of them, the calibration of the whole rig and what an IMU on it feels; see docs/rigs.md.
    Rig(RigArgs),
    /// What an event sensor sees of a scene: changes of light, pixel by pixel, with microsecond stamps; see docs/events.md.
    Events(Box<EventsArgs>),
    /// Data sets: many shots that differ as a specification says, as shards for training; see docs/datasets.md.
    Dataset {
        #[command(subcommand)]
        verb: DatasetVerb,
    },
    /// Lessons on cameras: figures and tables with two lines of text each, and the commands that make them.
    Lesson(LessonArgs),
    /// Embedded scenes, and what is in a scene file.
    Scene {
        #[command(subcommand)]
        verb: SceneVerb,
    },
    /// Lenses: data, drawings, rays, aberrations.
    Lens {
        #[command(subcommand)]
        verb: LensVerb,
    },
    /// Camera bodies and their data sheets.
    Body {
        #[command(subcommand)]
        verb: BodyVerb,
    },
    /// Measure pictures as a laboratory does: resolution, noise, vignetting, distortion, colour.
    Measure {
        #[command(subcommand)]
        verb: MeasureVerb,
    },
    /// Hold the camera in your hands: a viewfinder with dials, in the browser of this machine.
    Viewfinder(Viewfinder),
    /// Why a place of a picture is soft, bright and noisy, and what would change it.
    Why(Why),
    /// Print a completion script for a shell.
    Completions {
        /// bash, zsh, fish, elvish or powershell.
        shell: clap_complete::Shell,
    },
    /// Print a manual page, or write those of all verbs.
    Man {
        /// A verb, such as "shoot" or "lens draw"; the program without.
        verb: Vec<String>,
        /// Write the pages of all verbs into this folder (made if it is not there): diopter.1, diopter-shoot.1 ...
        #[arg(short, long, value_name = "FOLDER", conflicts_with = "verb")]
        output: Option<PathBuf>,
    },
}

#[derive(Subcommand, Debug)]
pub enum SceneVerb {
    /// Names of the embedded scenes.
    List,
    /// What a scene holds: triangles, materials, lights, cameras, warnings.
    Info {
        /// Embedded scene, or a file: .usd, .gltf, .glb, .pbrt, .xml (Mitsuba), .obj, .ply, .spz, .stl, .scene (by hand).
        scene: String,
        /// Fail when a texture cannot be read, instead of showing magenta in its place.
        #[arg(long)]
        strict: bool,
    },
    /// Write a scene as glTF 2.0 for other programs.
    Convert {
        /// Embedded scene, or a file: .usd, .gltf, .glb, .pbrt, .xml (Mitsuba), .obj, .ply, .spz, .stl, .scene (by hand).
        scene: String,
        /// .glb, or .gltf with a .bin beside it.
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        /// Fail when a texture cannot be read, instead of writing magenta in its place.
        #[arg(long)]
        strict: bool,
    },
}

#[derive(Subcommand, Debug)]
pub enum LensVerb {
    /// Names of the embedded lenses.
    List,
    /// First-order data, Seidel sums, glasses, sources; -o draws the lens.
    Info(Bench),
    /// The lens in section, with rays; of "thin" the ideal lens.
    Draw(Bench),
    /// One ray, surface by surface.
    Trace {
        #[command(flatten)]
        bench: Bench,
        /// Place in the pupil, -1 to 1 across it: "x,y".
        #[arg(long, value_name = "X,Y", value_parser = pair, default_value = "0,0", allow_hyphen_values = true)]
        pupil: [f64; 2],
    },
    /// Spot diagrams.
    Spot {
        #[command(flatten)]
        bench: Bench,
        /// Rays across the pupil.
        #[arg(long, value_name = "N", default_value_t = 40)]
        rays: usize,
        /// Through focus: planes behind the film, mm: "-0.1,0,0.1".
        #[arg(long, value_name = "LIST", value_parser = list, allow_hyphen_values = true)]
        defocus: Option<List>,
    },
    /// The image of a point: diffraction or geometric, Strehl ratio, encircled energy, line and edge spread; -o also writes .exr.
    Psf {
        #[command(flatten)]
        bench: Bench,
        /// Planes behind the film, mm: "-0.1,0,0.1".
        #[arg(long, value_name = "LIST", value_parser = list, allow_hyphen_values = true)]
        defocus: Option<List>,
        /// Size of a pixel, µm; half of what diffraction needs, without.
        #[arg(long, value_name = "UM")]
        pixel: Option<f64>,
        /// Pixels across the images that are written; as many as the light needs, without.
        #[arg(long, value_name = "N")]
        pixels: Option<usize>,
        /// From the rays alone, without diffraction.
        #[arg(long)]
        geometric: bool,
    },
    /// Wavefront: peak to valley, root mean square, Zernike coefficients; -o also writes maps as .exr.
    Wavefront {
        #[command(flatten)]
        bench: Bench,
        /// Order of the Zernike terms.
        #[arg(long, value_name = "ORDER", default_value = "noll")]
        zernikes: ZernikeOrder,
        /// How many of them.
        #[arg(long, value_name = "N", default_value_t = 37)]
        terms: usize,
        /// Rays across the pupil.
        #[arg(long, value_name = "N", default_value_t = 64)]
        rays: usize,
    },
    /// Ray fans and wavefront.
    Fan(Bench),
    /// Contrast: over frequency, field or focus.
    Mtf {
        #[command(flatten)]
        bench: Bench,
        /// frequency, field or focus.
        #[arg(long, value_name = "WHAT", default_value = "frequency")]
        over: MtfOver,
        /// Spatial frequencies, cycles/mm: "10,30"; for --over frequency the last is the highest.
        #[arg(long, value_name = "LIST", value_parser = list)]
        frequency: Option<List>,
        /// From the spot alone, without diffraction.
        #[arg(long)]
        geometric: bool,
    },
    /// Distortion and field curvature.
    Distortion(Bench),
    /// Relative illumination, vignetting, and the pupils as the field sees them.
    Vignetting(Bench),
    /// Axial and lateral colour.
    Color(Bench),
    /// One page about the lens, for paper: drawing, first and third order, contrast, spots, fans, distortion, illumination, glasses, and, asked for,
    /// what tolerances do to it and a photograph; -o FILE.html or FILE.pdf.
    Report(LensReport),
    /// Reflectance of the surfaces over wavelength and angle, layers, and what the lens lets through; -o also writes .csv and .json.
    Coating {
        /// A name from `lens list`, or a file (.toml, .dat, .zmx, .seq, .len, .json).
        lens: String,
        /// Only this surface, 1 the first; without, all that are between different media.
        #[arg(long, value_name = "N")]
        surface: Option<usize>,
        /// Instead of the lens's own coating: none, MgF2, multi, perfect, single, V, broadband, modern, year.
        #[arg(long, value_name = "NAME")]
        coating: Option<String>,
        /// Angles of incidence in the thinner medium, degrees: "0,30,45".
        #[arg(long, value_name = "LIST", value_parser = list, default_value = "0,30,45,60")]
        angle: List,
        /// Chart (.svg, .png) or figures (.csv, .json) to write; may be given several times.
        #[arg(short, long, value_name = "FILE")]
        output: Vec<PathBuf>,
    },
    /// Ghosts: every pair of surfaces, and of a surface and the sensor, that throw light of a distant source onto the film; focus, size,
    /// place, irradiance; -o also writes .json.
    Ghosts {
        #[command(flatten)]
        bench: Bench,
        /// Angle of the source to the axis, upwards in the scene: "10deg".
        #[arg(long, value_name = "ANGLE", value_parser = degrees, default_value = "10deg", allow_hyphen_values = true)]
        source: f64,
        /// Instead of the lens's own coating: none, MgF2, multi, perfect, single, V, broadband, modern, year.
        #[arg(long, value_name = "NAME")]
        coating: Option<String>,
        /// Fraction of the light that the sensor reflects.
        #[arg(long, value_name = "FRACTION", default_value_t = 0.04)]
        sensor_reflectance: f64,
        /// So many ghosts of four reflections beside, those that are strongest to first order.
        #[arg(long, value_name = "N", default_value_t = 0)]
        fours: usize,
        /// Distance between the pixels of a sensor whose microlenses are a grating ("5.4um"): its orders are listed, too, as "sensor(1,0)".
        #[arg(long, value_name = "LENGTH")]
        pixel_pitch: Option<LengthMm>,
        /// Rays across the part of the front whose light makes a ghost.
        #[arg(long, value_name = "N", default_value_t = 48)]
        rays: usize,
        /// Ghosts to list, the strongest first; 0 for all.
        #[arg(long, value_name = "N", default_value_t = 25)]
        top: usize,
    },
    /// Camera models that say what the lens does, fitted to traced rays, for OpenCV, COLMAP, nerfstudio, Kalibr, lensfun; ST maps, ray tables.
    Calibrate(Calibrate),
    /// What the lens will be when it is built: sensitivities, Monte Carlo, yield against limits.
    Tolerance(Tolerance),
    /// One build of a tolerance sheet as a lens file, for `shoot --lens` and all other verbs.
    Build(Build),
    /// A better lens: variables and wishes from a merit file, damped least squares, a global search.
    Optimise(Optimise),
    /// Match a real lens: scale, f-number, decentre ... fitted to distortion, vignetting, MTF or a calibration.
    Fit(FitLens),
    /// Any lens file as TOML, Zemax or CODE V file.
    Convert {
        /// Lens file (.dat, .zmx, .seq, .len, .json, .toml) or the name of an embedded lens.
        lens: String,
        /// File to write: .toml, .zmx (Zemax) or .seq (CODE V), at infinity and the first zoom position; TOML on standard output without.
        #[arg(short, long, value_name = "FILE")]
        output: Option<PathBuf>,
    },
}

#[derive(clap::Args, Debug)]
pub struct Tolerance {
    /// Tolerance sheet (.toml).
    pub sheet: PathBuf,
    /// The lens, instead of the one the sheet names: a name from `lens list`, or a file.
    #[arg(long, value_name = "NAME|FILE")]
    pub lens: Option<String>,
    /// Builds that are drawn and measured.
    #[arg(short = 'n', long, value_name = "N", default_value_t = 1000)]
    pub builds: usize,
    /// Seed of the builds, instead of the sheet's.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Report (.html), all builds (.csv), everything (.json) or histograms (.svg, .png); may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct Optimise {
    /// Merit file (.toml): variables, operands, fields.
    pub merit: PathBuf,
    /// The lens to start from, instead of the one the merit file names: a name from `lens list`, or a file.
    #[arg(long, value_name = "NAME|FILE")]
    pub lens: Option<String>,
    /// Search the whole range of the variables first, by so many generations of differential evolution.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub global: usize,
    /// Most steps of the damped least squares.
    #[arg(long, value_name = "N", default_value_t = 500)]
    pub iterations: usize,
    /// Seed of the global search, instead of the file's.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Lens file to write (.toml).
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct FitLens {
    /// File of measurements (.toml): [distortion], [vignetting], [mtf], [calibration]; [[variable]]: what is free.
    pub measured: PathBuf,
    /// The prescription to start from, instead of the one the file names: a name from `lens list`, or a file.
    #[arg(long, value_name = "NAME|FILE")]
    pub lens: Option<String>,
    /// Most steps of the damped least squares from each start.
    #[arg(long, value_name = "N", default_value_t = 100)]
    pub iterations: usize,
    /// Lens file to write (.toml); what is no part of it (f-number, film) is printed as flags of `shoot`.
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct Build {
    /// Tolerance sheet (.toml).
    pub sheet: PathBuf,
    /// The lens, instead of the one the sheet names: a name from `lens list`, or a file.
    #[arg(long, value_name = "NAME|FILE")]
    pub lens: Option<String>,
    /// Which build: the same number is the same lens.
    #[arg(long, value_name = "N")]
    pub number: u64,
    /// Seed of the builds, instead of the sheet's.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Lens file to write (.toml); standard output without.
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

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

/// What MTF is plotted over.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum MtfOver {
    /// Spatial frequency.
    Frequency,
    /// Field angle.
    Field,
    /// Defocus.
    Focus,
}

/// Order and normalisation of Zernike terms.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum ZernikeOrder {
    /// Noll's: every term has the root mean square 1.
    Noll,
    /// Fringe: every term is 1 at the edge.
    Fringe,
}

/// A lens and how it is set on the bench.
#[derive(clap::Args, Debug)]
pub struct Bench {
    /// A name from `lens list`, or a file (.toml, .dat, .zmx, .seq, .len, .json).
    pub lens: String,
    /// Where a zoom is set: "35 mm".
    #[arg(long, value_name = "LENGTH")]
    pub focal_length: Option<LengthMm>,
    /// A zoom position that the prescription prints, 1 the first.
    #[arg(long, value_name = "N", conflicts_with = "focal_length")]
    pub zoom_position: Option<usize>,
    /// f-number; as the file says, or fully open, without.
    #[arg(long, value_name = "F")]
    pub aperture: Option<FNumber>,
    /// Focused at this distance from the entrance pupil ("2.5m", "inf"), the film in the plane of the smallest spot; without, the
    /// film stands where the prescription puts it, and between the printed positions of a zoom in that plane.
    #[arg(long, value_name = "DISTANCE")]
    pub focus: Option<Distance>,
    /// Field angles, degrees: "0,10,14".
    #[arg(long, value_name = "LIST", value_parser = list, allow_hyphen_values = true)]
    pub field: Option<List>,
    /// Wavelengths, nm: "486,588,656".
    #[arg(long, value_name = "LIST", value_parser = list)]
    pub wavelength: Option<List>,
    /// Drawing or plot to write: .svg or .png; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

/// A page about a lens.
#[derive(clap::Args, Debug)]
pub struct LensReport {
    #[command(flatten)]
    pub bench: Bench,
    /// Tolerance sheet (.toml): the page says what builds of the lens are like.
    #[arg(long, value_name = "SHEET")]
    pub tolerances: Option<PathBuf>,
    /// Builds for that.
    #[arg(short = 'n', long, value_name = "N", default_value_t = 200, requires = "tolerances")]
    pub builds: usize,
    /// A photograph through the lens on the page: a name from `scene list`, such as the chart slanted-edges, or a file.
    #[arg(long, value_name = "SCENE")]
    pub photograph: Option<String>,
}

/// A lens before a sensor, to be described for other programs.
#[derive(clap::Args, Debug)]
pub struct Calibrate {
    /// A name from `lens list`, or a file (.toml, .dat, .zmx, .seq, .len, .json).
    pub lens: String,
    /// Pixels of the picture.
    #[arg(long, value_name = "WxH", default_value = "6000x4000")]
    pub size: Size,
    /// Camera body: its film; a name from `body list` or a TOML file. The usual one without.
    #[arg(long, value_name = "NAME|FILE")]
    pub body: Option<String>,
    /// Film instead of the body's: a name ("full frame", "APS-C", "4/3") or mm ("36x24").
    #[arg(long, value_name = "NAME|MM")]
    pub film: Option<String>,
    /// Where a zoom is set: "35 mm".
    #[arg(long, value_name = "LENGTH")]
    pub focal_length: Option<LengthMm>,
    /// A zoom position that the prescription prints, 1 the first.
    #[arg(long, value_name = "N", conflicts_with = "focal_length")]
    pub zoom_position: Option<usize>,
    /// f-number; fully open without.
    #[arg(long, value_name = "F")]
    pub aperture: Option<FNumber>,
    /// Distance from the entrance pupil that is in focus: "2.5m"; infinity without.
    #[arg(long, value_name = "DISTANCE")]
    pub focus: Option<Distance>,
    /// Move the lens against the film, to the right and up: "5mm", "0,8mm".
    #[arg(long, value_name = "X[,Y]", value_parser = shift, allow_hyphen_values = true)]
    pub shift: Option<[f64; 2]>,
    /// Turn the lens against the film about its rear principal point, forward and to the right: "8deg", "0,5deg".
    #[arg(long, value_name = "X[,Y]", value_parser = tilt, allow_hyphen_values = true)]
    pub tilt: Option<[f64; 2]>,
    /// Camera model, or several ("opencv5,opencv-fisheye"; the first is written), or all.
    ///
    /// pinhole, simple-radial, radial, opencv4, opencv5, opencv8, opencv12, opencv14, opencv-fisheye, thin-prism-fisheye, f-theta, double-sphere,
    /// division. Without, opencv5 for pictures within 60° of the axis and opencv-fisheye for wider ones.
    #[arg(long, value_name = "NAMES")]
    pub model: Option<String>,
    /// Fit the mean direction of all light through the pupil instead of the chief ray.
    #[arg(long)]
    pub centroid: bool,
    /// Wavelength of the ray, nm; 587.6 without. A lens with lateral colour has another calibration for each colour.
    #[arg(long, value_name = "NM")]
    pub wavelength: Option<f64>,
    /// Format of the files, where their names do not say it: json, opencv, colmap, nerfstudio, kalibr, lensfun, st-map, st-map-undistort, ray-table.
    #[arg(long, value_name = "NAME")]
    pub format: Option<String>,
    /// File to write; may be given several times.
    ///
    /// .json (everything), .yaml (OpenCV, ROS), cameras.txt (COLMAP), transforms.json (nerfstudio), camchain.yaml (Kalibr), .xml (lensfun), distort.exr and undistort.exr
    /// (ST maps), rays.exr (a ray for each pixel).
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

/// Numbers separated by commas.
#[derive(Clone, Debug, PartialEq)]
pub struct List(pub Vec<f64>);

#[derive(Subcommand, Debug)]
pub enum MeasureVerb {
    /// Resolution from slanted edges (e-SFR, ISO 12233): MTF50, MTF10, contrast over frequency.
    Mtf(Box<MeasureMtf>),
    /// Photon transfer from pairs of raw files of flat fields: gain, dark noise, dynamic range.
    Noise {
        /// Raw files (.dng), two of each exposure: A1 B1 A2 B2 ...
        #[arg(required = true, num_args = 2..)]
        files: Vec<PathBuf>,
        /// Part of the mosaic: "x,y,width,height", pixels; the middle half without.
        #[arg(long, value_name = "X,Y,W,H", value_parser = rectangle)]
        region: Option<[usize; 4]>,
        /// The body whose data sheet stands beside: a name from `body list` or a TOML file; the embedded one that the files name without.
        #[arg(long, value_name = "NAME|FILE")]
        body: Option<String>,
        /// Plot to write: .svg or .png; may be given several times.
        #[arg(short, long, value_name = "FILE")]
        output: Vec<PathBuf>,
    },
    /// Dynamic range of a body at its ISO speeds, by EMVA 1288.
    DynamicRange {
        /// Embedded body or TOML file.
        body: String,
        /// Settings: "100,200"; all of the sheet without.
        #[arg(long, value_name = "LIST", value_parser = list)]
        iso: Option<List>,
        /// Plot to write: .svg or .png; may be given several times.
        #[arg(short, long, value_name = "FILE")]
        output: Vec<PathBuf>,
    },
    /// A lab report of a body and a lens on one page: resolution beside its prediction, raw and developed, distortion, vignetting, veiling glare, noise,
    /// dynamic range, tone response, rolling shutter, colour.
    Report(MeasureReport),
    /// Veiling glare index (ISO 9358, integral method): of a photograph with a black spot, and of a lens by its prescription.
    Glare(MeasureGlare),
    /// Relative illumination over the image height, from a flat field.
    Vignetting(MeasureThroughLens),
    /// Distortion, from a grid of dots parallel to the film.
    Distortion(MeasureThroughLens),
    /// Read-out time and direction of a rolling shutter, from a picture of a flickering lamp's light or of moving bars.
    Rolling(MeasureRolling),
    /// Tone response, noise and dynamic range from a step wedge (OECF, ISO 14524 and 15739).
    Oecf(MeasureOecf),
    /// Colour differences of the 24 ColorChecker patches in a developed picture.
    Color {
        /// Picture: .png, .tif, .jpg or .exr, in sRGB primaries.
        file: PathBuf,
        /// Outer corners of the patches, pixels: upper left (dark skin), upper right, lower right, lower left; where "color-chart" has them without.
        #[arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", value_parser = corners, allow_hyphen_values = true)]
        corners: Option<[[f64; 2]; 4]>,
        /// What lights the chart: D65, D50, A, FL2 ...
        #[arg(long, value_name = "NAME", default_value = "D65")]
        light: String,
        /// Transfer function of the picture's codes; an .exr is linear.
        #[arg(long, value_name = "NAME", default_value = "srgb")]
        encoding: PictureEncoding,
        /// Plot to write: .svg or .png; may be given several times.
        #[arg(short, long, value_name = "FILE")]
        output: Vec<PathBuf>,
    },
}

#[derive(clap::Args, Debug)]
pub struct MeasureMtf {
    /// Picture: raw (.dng), focal plane or other .exr, .png, .tif, .jpg; or a scene, photographed with --lens and --body: slanted-edges, or a file
    /// (.scene, .gltf, .glb, .pbrt ...); or a shot file (.toml), photographed as it says.
    #[arg(value_name = "FILE|SCENE|SHOT")]
    pub file: PathBuf,
    /// The edge at this place: "x,y", pixels.
    #[arg(long, value_name = "X,Y", value_parser = pair, conflicts_with = "region")]
    pub at: Option<[f64; 2]>,
    /// The edge in this part: "x,y,width,height", pixels. Without it and --at: all that are found.
    #[arg(long, value_name = "X,Y,W,H", value_parser = rectangle)]
    pub region: Option<[usize; 4]>,
    /// What is measured; of raw files green, of others luminance, without. Raw channels are not demosaiced.
    #[arg(long, value_name = "NAME")]
    pub channel: Option<MeasuredChannel>,
    /// Distance of pixels, µm: frequencies in cycles/mm, too.
    #[arg(long, value_name = "UM")]
    pub pitch: Option<f64>,
    /// Order of the polynomial that the edge is fitted by: 1 straight, 2 and more for bent ones.
    #[arg(long, value_name = "N", default_value_t = 2)]
    pub order: usize,
    /// Window of the line spread function.
    #[arg(long, value_name = "NAME", default_value = "tukey")]
    pub window: LsfWindow,
    /// Half of the window's width, pixels; as wide as the region allows without. Narrower windows see less noise, and less of halos.
    #[arg(long, value_name = "PX")]
    pub reach: Option<f64>,
    /// Compare with what this lens and --body should give: lens MTF, pixel aperture, low-pass filter, crosstalk, motion.
    ///
    /// Aperture, focus and focal length are those that the file names; the chart is taken to lie where the lens is focused. For raw files (.dng), focal
    /// planes of ours, and pictures that were developed from a raw file (--raw). Without it lens and body are those of the shot.
    #[arg(long, value_name = "NAME|FILE", requires = "body")]
    pub lens: Option<String>,
    /// The body of --lens: a name from `body list` or a TOML file. Its pixels also say what a millimetre is.
    #[arg(long, value_name = "NAME|FILE", requires = "lens", conflicts_with = "pitch")]
    pub body: Option<String>,
    /// f-number of the photograph of a scene.
    #[arg(long, value_name = "F")]
    pub aperture: Option<FNumber>,
    /// Focal length of a zoom, for the photograph of a scene: "35 mm".
    #[arg(long, value_name = "LENGTH")]
    pub focal_length: Option<LengthMm>,
    /// Pixels of the photograph of a scene.
    #[arg(long, value_name = "WxH")]
    pub size: Option<Size>,
    /// Samples a pixel of the photograph of a scene; 64 without, or those of the shot file.
    #[arg(long, value_name = "N")]
    pub spp: Option<u32>,
    /// Measure the developed picture of a scene, a shot or a raw file, and predict what each step of the development does to the edge.
    #[arg(long)]
    pub developed: bool,
    /// The raw file (.dng) that a picture was developed from, by the recipe of its shot, or as the flags of `develop` say here: its edges are predicted.
    #[arg(long, value_name = "FILE")]
    pub raw: Option<PathBuf>,
    /// Shot file of a raw file: how camera and subject moved, the lens as it was focused, the recipe. The one beside it (PHOTO.toml) without.
    #[arg(long, value_name = "FILE")]
    pub shot: Option<PathBuf>,
    #[command(flatten)]
    pub developing: Developing,
    /// What lights the chart, for --lens: D65, D50, A ...
    #[arg(long, value_name = "NAME", default_value = "D65")]
    pub light: String,
    /// How far the image of the chart travels during the exposure, pixels to the right and down: the blur of its motion is predicted, too.
    ///
    /// At constant speed while the shutter is open, as on a rail, or a camera that turns. Shot files say it themselves: this wins over what they say.
    #[arg(long, value_name = "X,Y", value_parser = pair, allow_hyphen_values = true)]
    pub motion: Option<[f64; 2]>,
    /// Transfer function of the codes of a .png, .tif or .jpg.
    #[arg(long, value_name = "NAME", default_value = "srgb")]
    pub encoding: PictureEncoding,
    /// Plot to write: .svg or .png; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct MeasureReport {
    /// Embedded body or TOML file.
    pub body: String,
    /// A name from `lens list`, or a file (.toml, .dat, .zmx, .seq, .len, .json).
    pub lens: String,
    /// f-number; f/8 without (or as far as the lens opens).
    #[arg(long, value_name = "F")]
    pub aperture: Option<FNumber>,
    /// Focal length of a zoom: "35 mm".
    #[arg(long, value_name = "LENGTH")]
    pub focal_length: Option<LengthMm>,
    /// Pixels of the photographs.
    #[arg(long, value_name = "WxH")]
    pub size: Option<Size>,
    /// Samples a pixel of the photographs.
    #[arg(long, value_name = "N", default_value_t = 64)]
    pub spp: u32,
    /// Time in which the body's electronic shutter reads the picture: "20ms"; that of a common sensor (50.8 ms) without.
    #[arg(long, value_name = "TIME")]
    pub readout: Option<Seconds>,
    /// Page to write (.html or .pdf), with everything in it.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

/// A picture of a chart, and the lens it was taken through.
#[derive(clap::Args, Debug)]
pub struct MeasureThroughLens {
    #[command(flatten)]
    pub chart: MeasureChart,
    /// Compare with what this lens should give: a name of `lens list`, or a file. The picture must say how it was taken: a raw file or a focal plane.
    #[arg(long, value_name = "NAME|FILE")]
    pub lens: Option<String>,
}

/// A picture with the marks of a rolling shutter.
#[derive(clap::Args, Debug)]
pub struct MeasureRolling {
    #[command(flatten)]
    pub chart: MeasureChart,
    /// Frequency of the light of a lamp that lights an even field, Hz; on mains of 50 Hz it is 100 Hz.
    #[arg(long, value_name = "HZ", required_unless_present = "speed")]
    pub flicker: Option<f64>,
    /// Speed of bright bars before a dark ground over the picture, to the right and downwards, pixels a second: "2400,0".
    #[arg(long, value_name = "X,Y", value_parser = pair, conflicts_with = "flicker", allow_hyphen_values = true)]
    pub speed: Option<[f64; 2]>,
}

#[derive(clap::Args, Debug)]
pub struct MeasureOecf {
    /// Pictures of the chart, as of the scene step-wedge: raw (.dng), focal plane or other .exr, .png, .tif, .jpg. Several of the same exposure tell temporal noise apart.
    #[arg(required = true)]
    pub files: Vec<PathBuf>,
    /// Outer corners of the fields, pixels: upper left, upper right, lower right, lower left; where "step-wedge" has them without.
    #[arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", value_parser = corners, allow_hyphen_values = true)]
    pub corners: Option<[[f64; 2]; 4]>,
    /// Columns and rows of the fields of another chart.
    #[arg(long, value_name = "COLUMNSxROWS", default_value = "5x4")]
    pub grid: Size,
    /// Densities of its fields, log₁₀, row by row: "0,0.3,0.6"; 0 to 4.75 by 0.25 without.
    #[arg(long, value_name = "LIST", value_parser = list, allow_hyphen_values = true)]
    pub densities: Option<List>,
    /// Picture of an even field by the same lens at the same aperture, as of the scene flat-field: its fall-off is counted as density.
    #[arg(long, value_name = "FILE")]
    pub flat: Option<PathBuf>,
    /// What is measured; all channels of raw files, luminance of others, without.
    #[arg(long, value_name = "NAME")]
    pub channel: Option<MeasuredChannel>,
    /// Transfer function of the codes of a .png, .tif or .jpg; linear shows the codes themselves.
    #[arg(long, value_name = "NAME", default_value = "srgb")]
    pub encoding: PictureEncoding,
    /// Plot to write: .svg or .png; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct MeasureGlare {
    /// Picture of a black spot on a bright field, as of the scene glare-spot: raw (.dng), focal plane or other .exr, .png, .tif, .jpg.
    #[arg(required_unless_present = "lens")]
    pub file: Option<PathBuf>,
    /// The black part of the spot: "x,y,width,height", pixels; found in the middle without.
    #[arg(long, value_name = "X,Y,W,H", value_parser = rectangle, requires = "file")]
    pub region: Option<[usize; 4]>,
    /// What is measured; of raw files green, of others luminance, without.
    #[arg(long, value_name = "NAME", requires = "file")]
    pub channel: Option<MeasuredChannel>,
    /// Transfer function of the codes of a .png, .tif or .jpg.
    #[arg(long, value_name = "NAME", default_value = "srgb")]
    pub encoding: PictureEncoding,
    /// The index of this lens, and its glare spread function: a name from `lens list`, or a file.
    #[arg(long, value_name = "NAME|FILE")]
    pub lens: Option<String>,
    /// f-number; fully open without.
    #[arg(long, value_name = "F", requires = "lens")]
    pub aperture: Option<FNumber>,
    /// Focal length of a zoom: "35 mm".
    #[arg(long, value_name = "LENGTH", requires = "lens")]
    pub focal_length: Option<LengthMm>,
    /// A hood of this length, instead of the sheet's own.
    #[arg(long, value_name = "LENGTH", requires = "lens")]
    pub hood: Option<LengthMm>,
    /// Width and height of the film, mm.
    #[arg(long, value_name = "W,H", value_parser = pair, default_value = "36,24")]
    pub film: [f64; 2],
    /// Rays from each place of the film.
    #[arg(long, value_name = "N", default_value_t = 20_000)]
    pub rays: usize,
}

/// A picture of a chart.
#[derive(clap::Args, Debug)]
pub struct MeasureChart {
    /// Picture: raw (.dng), focal plane or other .exr, .png, .tif, .jpg.
    pub file: PathBuf,
    /// What is measured; of raw files green, of others luminance, without.
    #[arg(long, value_name = "NAME")]
    pub channel: Option<MeasuredChannel>,
    /// Transfer function of the codes of a .png, .tif or .jpg.
    #[arg(long, value_name = "NAME", default_value = "srgb")]
    pub encoding: PictureEncoding,
    /// Plot to write: .svg or .png; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

/// Which numbers of a picture are measured.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeasuredChannel {
    #[value(alias = "raw-red")]
    Red,
    #[value(alias = "raw-green")]
    Green,
    #[value(alias = "raw-blue")]
    Blue,
    /// Pixels without a filter, or of a monochrome sensor.
    #[value(alias = "raw-clear")]
    Clear,
    Luminance,
}

/// Windows of line spread functions.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum LsfWindow {
    /// Flat in the middle half.
    Tukey,
    /// A Tukey window without a flat part.
    Hann,
    Hamming,
}

/// Transfer functions of pictures.
#[derive(clap::ValueEnum, Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureEncoding {
    Srgb,
    #[value(name = "gamma-2.2")]
    Gamma22,
    Linear,
    Pq,
    Hlg,
}

#[derive(Subcommand, Debug)]
pub enum BodyVerb {
    /// Names of the embedded bodies.
    List,
    /// The data sheet of a body, with the source of every number.
    Info {
        /// Embedded body or TOML file.
        body: String,
    },
    /// Measure a body by EMVA 1288: flat fields and darks, beside what its data sheet says.
    Emva(Emva),
    /// Measure the ISO speeds of a body by ISO 12232: saturation, standard output, noise.
    Iso {
        /// Embedded body or TOML file.
        body: String,
        /// Settings: "100,200"; all of the sheet without.
        #[arg(long, value_name = "LIST", value_parser = list)]
        iso: Option<List>,
    },
}

#[derive(clap::Args, Debug)]
pub struct Emva {
    /// Embedded body or TOML file.
    pub body: String,
    /// ISO speed; the lowest without.
    #[arg(long, value_name = "ISO", allow_hyphen_values = true)]
    pub iso: Option<Iso>,
    /// Colour that is measured: R, G, B, W or Y; the one that sees most, without.
    #[arg(long, value_name = "NAME")]
    pub channel: Option<String>,
    /// Wavelength of the light, nm; where the channel sees most, without.
    #[arg(long, value_name = "NM")]
    pub wavelength: Option<f64>,
    /// Exposure time.
    #[arg(long, value_name = "TIME", default_value = "10ms")]
    pub shutter: Seconds,
    /// Temperature of the sensor, °C.
    #[arg(long, value_name = "C", allow_negative_numbers = true)]
    pub temperature: Option<f64>,
    /// Serial number: which fixed pattern.
    #[arg(long, value_name = "TEXT")]
    pub serial: Option<String>,
    /// Pixels of the pictures.
    #[arg(long, value_name = "WxH", default_value = "512x512")]
    pub size: Size,
    /// Pictures in the stacks for the fixed pattern.
    #[arg(long, value_name = "N", default_value_t = 64)]
    pub stack: usize,
    /// Seed of the noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Keep every picture as 16-bit PNG in a new folder, with the description that other EMVA 1288 programs read.
    #[arg(long, value_name = "FOLDER")]
    pub export: Option<PathBuf>,
    /// Photon transfer and signal-to-noise plots: .svg or .png; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
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

#[derive(clap::Args, Debug)]
pub struct ReadOut {
    /// Focal plane (.exr), or a picture of light from elsewhere: R, G, B (and depth as Z).
    pub plane: PathBuf,
    /// Of a picture of light: how long it is exposed; of our own --radiance, its time without.
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    pub exposure: Option<Seconds>,
    /// Of a picture of radiance (cd/m²): the T-stop of the lens; of our own --radiance, its lens without.
    #[arg(long, value_name = "N", conflicts_with = "irradiance")]
    pub t_stop: Option<FNumber>,
    /// The picture is the light on the sensor, lx.
    #[arg(long)]
    pub irradiance: bool,
    /// Camera body; the one it was exposed with, without.
    #[arg(long, value_name = "NAME|FILE")]
    pub body: Option<String>,
    /// ISO speed; what the camera was set to, or 100, without.
    #[arg(long, value_name = "ISO", allow_hyphen_values = true)]
    pub iso: Option<Iso>,
    /// Illuminant the camera takes for white.
    #[arg(long, value_name = "NAME", default_value = "D65")]
    pub white: String,
    /// Seed of the sensor's noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    #[command(flatten)]
    pub raw: Raw,
    /// Read out so many times, each with a seed of its own: files are numbered.
    #[arg(long, value_name = "N", default_value = "1")]
    pub shots: NonZeroUsize,
    /// Write the truth of each pixel (EXR): noise-free electrons, variances, clipping, depth, ids.
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// How the channels of --truth are laid out in the file.
    #[arg(long, value_enum, value_name = "LAYOUT", default_value = "single-part", requires = "truth")]
    pub truth_layout: TruthLayout,
    /// Write the names of the Cryptomatte layers of --truth beside it, too: NAME.CryptoObject.json and so on.
    #[arg(long, requires = "truth")]
    pub truth_sidecar: bool,
    /// Raw file to write (.dng).
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

#[derive(clap::Args, Debug)]
pub struct Develop {
    /// Raw files (.dng); - for standard input.
    #[arg(required_unless_present_any = ["settings", "save_recipe"])]
    pub raw: Vec<PathBuf>,
    #[command(flatten)]
    pub developing: Developing,
    /// JPEG quality, 1 to 100.
    #[arg(long, value_name = "N", default_value_t = crate::output::JPEG_QUALITY, value_parser = clap::value_parser!(u8).range(1..=100))]
    pub quality: u8,
    /// Write JPEGs with a gain map (Ultra HDR): brighter on displays that can, up to output.peak.
    #[arg(long)]
    pub gain_map: bool,
    /// Bits a channel of PNG, 8 or 16; 8 without, but 16 of PQ and HLG, whose steps would show.
    #[arg(long, value_name = "N")]
    pub bits: Option<u8>,
    /// Of a plenoptic camera's file: what is sharp: 1.2m, inf, as-taken, or all.
    #[arg(long, value_name = "DISTANCE", allow_hyphen_values = true)]
    pub refocus: Option<String>,
    /// Of a plenoptic camera's file: write the views through a grid of places in the pupil into this folder (made if it is not there).
    #[arg(long, value_name = "FOLDER")]
    pub views: Option<PathBuf>,
    /// Of a plenoptic camera's file: write depth, found by how the views differ: .exr (metres, with confidence) or .png (near is light).
    #[arg(long, value_name = "FILE")]
    pub depth: Option<PathBuf>,
    /// Write the picture after every step, with its histogram, and a sheet of all, into this folder (made if it is not there).
    #[arg(long, value_name = "FOLDER")]
    pub steps: Option<PathBuf>,
    /// Print all settings with unit, range, value and reason.
    #[arg(long)]
    pub settings: bool,
    /// Write what the pictures are developed by as a recipe file (.toml).
    #[arg(long, value_name = "FILE")]
    pub save_recipe: Option<PathBuf>,
    /// Picture to write: .jpg, .png, .tif (16 bits) or .exr (linear light); may be given several times. With several raw files
    /// the name holds {}, which stands for the name of each without its ending: "out/{}.jpg".
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

/// Look-up tables.
#[derive(Subcommand, Debug)]
pub enum LutVerb {
    /// What a .cube file holds.
    Info {
        /// The file.
        file: PathBuf,
    },
    /// Make one 3D table of exposure, tone curve, grading and table of a recipe; prints how far it lies off the steps.
    Bake {
        #[command(flatten)]
        developing: Developing,
        /// Points a side.
        #[arg(long, value_name = "N", default_value_t = 33, value_parser = clap::value_parser!(u16).range(2..=129))]
        size: u16,
        /// What the table is to be fed with: log (most exact, for lut.input = "log"), acescct, srgb or linear.
        #[arg(long, value_name = "NAME", default_value = "log")]
        input: String,
        /// Table to write (.cube).
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
    },
}

/// Calculators.
#[derive(clap::Args, Debug)]
pub struct DaylightArgs {
    /// A moment with its zone, such as 2026-06-21T12:00+02:00.
    #[arg(long, value_name = "TIME", requires = "place", conflicts_with = "sun", required_unless_present = "sun")]
    pub time: Option<Moment>,
    /// Latitude and longitude, degrees, north and east positive.
    #[arg(long, value_name = "LAT,LON", allow_hyphen_values = true, value_parser = pair, requires = "time")]
    pub place: Option<[f64; 2]>,
    /// Instead: elevation and azimuth of the sun, degrees.
    #[arg(long, value_name = "ELEV,AZ", allow_hyphen_values = true, value_parser = pair)]
    pub sun: Option<[f64; 2]>,
    /// Haze: 1 pure air, 3 clear, 10 thick.
    #[arg(long, value_name = "T")]
    pub turbidity: Option<f64>,
    /// The 24 hours from the moment on.
    #[arg(long, requires = "time")]
    pub hours: bool,
}

#[derive(Subcommand, Debug)]
pub enum CalcVerb {
    /// Where the sun is, and the illuminance of level ground by sun and clear sky.
    Daylight(DaylightArgs),
    /// Tone curves: light of a display and codes of linear Rec.709 colours.
    Tone {
        /// linear, reinhard, aces-1.3, agx ...
        curve: String,
        /// Colours: one number for a grey or "r,g,b"; several may follow each other.
        #[arg(required = true, value_name = "COLOUR", allow_negative_numbers = true)]
        colours: Vec<String>,
        /// Scale light so that 18 % grey is shown as 18 %, as `develop` does.
        #[arg(long)]
        keep_grey: bool,
    },
    /// Settings that let in as much light: the row of full stops, with what each does to depth of field, motion and noise.
    Equivalent(Equivalent),
    /// Exposure value of a setting, and the light it is right for.
    Exposure {
        /// f-number: "f/8".
        aperture: FNumber,
        /// Exposure time: "1/125".
        time: Seconds,
        /// ISO speed.
        #[arg(long, value_name = "ISO", default_value = "100")]
        iso: Iso,
        /// Engraved numbers stand for exact stops.
        #[arg(long)]
        true_stops: bool,
    },
    /// What mode P chooses over the light: a table, or a plot with -o.
    Program {
        /// Widest aperture of the lens.
        #[arg(long, value_name = "F", default_value = "f/1.4")]
        widest: FNumber,
        /// Focal length on 36 × 24 mm.
        #[arg(long, value_name = "LENGTH", default_value = "50mm")]
        focal_length: LengthMm,
        /// ISO speed, or auto (100 to 6400).
        #[arg(long, value_name = "ISO|auto", default_value = "100")]
        iso: IsoChoice,
        /// Plot to write: .svg or .png; may be given several times.
        #[arg(short, long, value_name = "FILE")]
        output: Vec<PathBuf>,
    },
    /// Depth of field: near and far limits at a distance, or a table over distances; a plot of the blur with -o.
    Dof(DepthOfField),
    /// Hyperfocal distance: of one aperture, or over the full stops.
    Hyperfocal {
        /// Focal length.
        focal_length: LengthMm,
        /// f-number; the full stops without.
        aperture: Option<FNumber>,
        /// Film format: a name ("full frame", "APS-C", "4/3") or mm ("36x24").
        #[arg(long, value_name = "NAME|MM", default_value = "full frame")]
        format: String,
        /// Circle of confusion that is taken for sharp; the diagonal / 1442 without (0.030 mm on 36 × 24 mm).
        #[arg(long, value_name = "LENGTH")]
        circle: Option<LengthMm>,
    },
    /// Angles of view, crop factor and equivalent focal length.
    Fov(Field),
    /// Focal length, aperture and speed that give the same picture on another format.
    EquivalentFormat(FormatArgs),
    /// Engraved f-numbers, times and ISO speeds and what they stand for.
    Stops {
        /// full, half or third.
        #[arg(default_value = "third")]
        step: String,
    },
    /// Thin lens: from two of focal length, object distance, image distance and magnification, the others.
    ///
    /// The focal length alone gives a table over object distances; with -o it draws the image with its rays, or the image distance over the object distance.
    ThinLens(ThinLensArgs),
    /// f-number, focal length and aperture diameter: from two of them, the third; from the focal length alone, the full stops.
    Stop(StopArgs),
    /// The diameter at which a pinhole is sharpest, between the blur of its size and that of diffraction.
    Pinhole(PinholeArgs),
    /// When which part of the picture is open: the shutter in slow motion.
    Shutter(ShutterArgs),
    /// Film formats: width, height, area, diagonal, crop factor.
    Formats {
        /// Only these: names ("full frame", "APS-C", "4/3") or mm ("36x24").
        #[arg(value_name = "NAME|MM")]
        names: Vec<String>,
    },
}

#[derive(clap::Args, Debug)]
pub struct ShutterArgs {
    /// Marked exposure time: "1/500".
    pub time: Seconds,
    /// global, leaf, focal-plane or rolling.
    #[arg(long, value_name = "KIND", default_value = "focal-plane")]
    pub shutter_type: String,
    /// Time that a curtain takes across the picture, or a rolling shutter to read it, or blades to open.
    #[arg(long, value_name = "TIME")]
    pub travel: Option<Seconds>,
    /// Which way curtains or rows run, as seen in the picture: down, up, right or left.
    #[arg(long, value_name = "WAY", default_value = "down")]
    pub shutter_direction: String,
    /// Drawing to write: .svg or .png; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct PinholeArgs {
    /// Distance of the film behind the hole: "50mm".
    #[arg(value_name = "LENGTH")]
    pub distance: LengthMm,
    /// Distance of the object before it: "2.5m", "inf".
    #[arg(long, value_name = "DISTANCE", default_value = "inf")]
    pub object: Distance,
    /// Wavelength, nm.
    #[arg(long, value_name = "NM", default_value_t = 550.0)]
    pub wavelength: f64,
    /// Plot of the resolution over the diameter to write: .svg or .png; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct ThinLensArgs {
    /// Focal length f; negative of a diverging lens.
    #[arg(long, value_name = "LENGTH")]
    pub focal_length: Option<LengthMm>,
    /// Distance z_o of the object before the lens: "2.5m", "inf".
    #[arg(long, value_name = "DISTANCE")]
    pub object: Option<Distance>,
    /// Distance z_i of the image behind the lens: "52mm", "inf"; negative of a virtual image.
    #[arg(long, value_name = "DISTANCE")]
    pub image: Option<Distance>,
    /// Magnification m: image height over object height, negative upside down (what a film catches): -0.5 is half as large.
    #[arg(long, value_name = "M", allow_negative_numbers = true)]
    pub magnification: Option<f64>,
    /// f-number: tells the circle of confusion of another distance, too.
    #[arg(long, value_name = "F")]
    pub aperture: Option<FNumber>,
    /// The other distance.
    #[arg(long, value_name = "DISTANCE", default_value = "inf", requires = "aperture")]
    pub distance: Distance,
    /// Drawing or plot to write: .svg or .png; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct StopArgs {
    /// f-number N.
    #[arg(long, value_name = "F")]
    pub aperture: Option<FNumber>,
    /// Focal length f.
    #[arg(long, value_name = "LENGTH")]
    pub focal_length: Option<LengthMm>,
    /// Diameter D of the aperture (of the entrance pupil).
    #[arg(long, value_name = "LENGTH")]
    pub diameter: Option<LengthMm>,
    /// Drawing of the openings to write: .svg or .png; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct DepthOfField {
    /// Focal length: "50 mm"; of a zoom, where it is set.
    #[arg(long, value_name = "LENGTH")]
    pub focal_length: Option<LengthMm>,
    /// f-number; without, that of --lens fully open, or f/2.8.
    #[arg(long, value_name = "F")]
    pub aperture: Option<FNumber>,
    /// Distance in focus; a table over distances without.
    #[arg(long, value_name = "DISTANCE")]
    pub focus: Option<Distance>,
    /// Film format: a name ("full frame", "APS-C", "4/3") or mm ("36x24").
    #[arg(long, value_name = "NAME|MM", default_value = "full frame")]
    pub format: String,
    /// Circle of confusion that is taken for sharp; the diagonal / 1442 without (0.030 mm on 36 × 24 mm).
    #[arg(long, value_name = "LENGTH")]
    pub circle: Option<LengthMm>,
    /// A real lens: the traced answer beside the closed form.
    #[arg(long, value_name = "NAME|FILE")]
    pub lens: Option<String>,
    /// Plot to write: .svg or .png; may be given several times.
    #[arg(short, long, value_name = "FILE")]
    pub output: Vec<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct Field {
    /// Focal length; of a zoom, where it is set.
    pub focal_length: Option<LengthMm>,
    /// Film format: a name ("full frame", "APS-C", "4/3") or mm ("36x24").
    #[arg(long, value_name = "NAME|MM", default_value = "full frame")]
    pub format: String,
    /// A real lens: the traced angles beside the closed form.
    #[arg(long, value_name = "NAME|FILE")]
    pub lens: Option<String>,
    /// Size of what is seen at this distance too.
    #[arg(long, value_name = "DISTANCE")]
    pub distance: Option<Distance>,
}

#[derive(clap::Args, Debug)]
pub struct FormatArgs {
    /// Focal length on the first format.
    pub focal_length: LengthMm,
    /// f-number there.
    pub aperture: FNumber,
    /// The first format: a name ("full frame", "APS-C", "4/3") or mm ("36x24").
    #[arg(long, value_name = "NAME|MM", default_value = "full frame")]
    pub from: String,
    /// The other.
    #[arg(long, value_name = "NAME|MM")]
    pub to: String,
    /// ISO speed on the first.
    #[arg(long, value_name = "ISO", default_value = "100")]
    pub iso: Iso,
    /// Distance in focus.
    #[arg(long, value_name = "DISTANCE", default_value = "3m")]
    pub focus: Distance,
}

#[derive(clap::Args, Debug)]
pub struct Equivalent {
    /// f-number: "f/4".
    pub aperture: FNumber,
    /// Exposure time: "1/60".
    pub time: Seconds,
    /// ISO speed.
    #[arg(long, value_name = "ISO", default_value = "100")]
    pub iso: Iso,
    /// Body whose noise is told.
    #[arg(long, value_name = "NAME|FILE", default_value = "canon-5d-mark-iv")]
    pub body: String,
    /// Focal length.
    #[arg(long, value_name = "LENGTH", default_value = "50mm")]
    pub focal_length: LengthMm,
    /// Distance of the subject.
    #[arg(long, value_name = "DISTANCE", default_value = "3m")]
    pub focus: Distance,
    /// Speed of the subject across the picture, m/s: 1.4 is a walk.
    #[arg(long, value_name = "M/S", default_value_t = 1.4)]
    pub speed: f64,
}

#[derive(clap::Args, Debug)]
pub struct Merge {
    /// Focal planes (.exr), or raw files of an exposure series (.dng).
    #[arg(required = true)]
    pub parts: Vec<PathBuf>,
    /// Of focal planes: the plane to write (.exr). Of raw files: linear light (.exr), a raw file (.dng) or a picture.
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

#[derive(clap::Args, Debug)]
pub struct QuickLook {
    /// A focal plane (from `expose --lens pinhole`), or an EXR with channels R, G, B and Z (depth along the axis, m).
    pub picture: PathBuf,
    /// Focal length; the one the plane was exposed with, without.
    #[arg(long, value_name = "LENGTH")]
    pub focal_length: Option<LengthMm>,
    /// f-number.
    #[arg(long, value_name = "F", default_value = "f/2.8")]
    pub aperture: FNumber,
    /// Distance of the sharp plane: "2.5m" or "inf".
    #[arg(long, value_name = "DISTANCE", default_value = "inf")]
    pub focus: Distance,
    /// Film format: a name ("full frame", "APS-C", "4/3") or mm ("36x24").
    #[arg(long, value_name = "NAME|MM", default_value = "full frame")]
    pub format: String,
    /// Blades of the iris; round without.
    #[arg(long, value_name = "N")]
    pub blades: Option<u32>,
    /// How round the blades are: 0 straight to 1.
    #[arg(long, value_name = "X")]
    pub blade_curvature: Option<f32>,
    /// Turn the iris, degrees.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub blade_rotation: Option<f32>,
    /// File to write: of a focal plane, another (.exr); of another picture .exr (linear light).
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

#[derive(clap::Args, Debug)]
pub struct LessonArgs {
    /// A lesson, "all", or "list" for their names.
    pub name: String,
    /// Folder to write into (made if it is not there): a page NAME.md and its figures; of all, also index.md. Or one file, .pdf.
    #[arg(short, long, value_name = "FOLDER|FILE.pdf")]
    pub output: Option<PathBuf>,
    /// Pixels of the photographs, instead of those that the lessons say.
    #[arg(long, value_name = "WxH")]
    pub size: Option<Size>,
}

#[derive(clap::Args, Debug)]
pub struct Sheet {
    /// What is varied, and the shot (.toml): [[vary]] with name and values, [shot] as in a shot file.
    pub sheet: PathBuf,
    /// Pixels of the pictures, instead of the shot's.
    #[arg(long, value_name = "WxH")]
    pub size: Option<Size>,
    /// Samples a pixel, instead of the shot's.
    #[arg(long, value_name = "N")]
    pub spp: Option<u32>,
    /// Take no more memory than this ("4GB"); without, than is free.
    #[arg(long, value_name = "SIZE")]
    pub max_memory: Option<Bytes>,
    /// Sheet to write: .png, .jpg, .html (one file with all pictures) or .pdf; may be given several times.
    #[arg(short, long, value_name = "FILE", required = true)]
    pub output: Vec<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct RigArgs {
    /// The rig: cameras, way, frames, IMU (.toml).
    #[arg(value_name = "RIG.toml")]
    pub rig: PathBuf,
    /// Folder for all files: a new or empty one.
    #[arg(short, long, value_name = "FOLDER")]
    pub output: PathBuf,
}

#[derive(clap::Args, Debug)]
pub struct EventsArgs {
    #[command(flatten)]
    pub taking: Taking,
    /// Event sensor: dvs128, davis346, ideal-events, or a TOML file.
    #[arg(long, value_name = "NAME|FILE", default_value = "davis346")]
    pub sensor: String,
    /// How long events are taken, from --at on.
    #[arg(long, value_name = "TIME", default_value = "100 ms")]
    pub duration: Seconds,
    /// From one moment of light that is computed to the next; nothing should move by more than about a pixel in it.
    #[arg(long, value_name = "TIME", default_value = "1 ms")]
    pub step: Seconds,
    /// Halve a step, up to four times, in which the light of a pixel changes by more than this (natural logarithm).
    #[arg(long, value_name = "CHANGE")]
    pub most_change: Option<f64>,
    /// Write the photocurrents that pixels were fed with, too (.npy: float32 [moment][row][column], e-/s).
    #[arg(long, value_name = "FILE")]
    pub keep_light: Option<PathBuf>,
    /// File to write: .npy (structured array), .csv or .raw (EVT 2.0).
    #[arg(short, long, value_name = "FILE", required = true)]
    pub output: Vec<PathBuf>,
}

#[derive(Subcommand, Debug)]
pub enum DatasetVerb {
    /// Make a data set, or go on with one that was stopped; pack what is made.
    Make {
        /// What varies and what is written (.toml).
        spec: PathBuf,
        /// Folder of the data set: a new or empty one, or one that was begun with the same specification.
        #[arg(short, long, value_name = "FOLDER")]
        output: PathBuf,
    },
    /// Make single items and leave them in the folder to be packed by `make`: what one worker does. Several may work on one folder.
    Item {
        /// What varies and what is written (.toml).
        spec: PathBuf,
        #[command(flatten)]
        which: WhichItems,
        /// Folder of the data set.
        #[arg(short, long, value_name = "FOLDER")]
        output: PathBuf,
    },
    /// Check a specification, and list what differs in its items.
    Info {
        /// What varies and what is written (.toml).
        spec: PathBuf,
        /// First and one after the last item that are listed; the first ten without.
        #[arg(long, value_name = "A..B", value_parser = items)]
        items: Option<[u64; 2]>,
    },
    /// Write the job of a render farm that makes the data set: a template of Open Job Description (`openjd run job.yaml`).
    Job {
        /// What varies and what is written (.toml).
        spec: PathBuf,
        /// Template to write (.yaml).
        #[arg(short, long, value_name = "FILE")]
        output: PathBuf,
        /// Folder of the data set, as the job's default; without, one with the name of the specification beside the template.
        #[arg(long, value_name = "FOLDER")]
        folder: Option<PathBuf>,
        /// Items of a task: some minutes of work are well scheduled.
        #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u64).range(1..))]
        items_per_task: u64,
        /// Processor cores that a task asks for, and threads that it takes.
        #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
        cores: Option<u32>,
        /// Memory that a task asks for ("4GB").
        #[arg(long, value_name = "SIZE")]
        memory: Option<Bytes>,
        /// Time after which a task has failed ("30 min").
        #[arg(long, value_name = "TIME")]
        timeout: Option<Seconds>,
    },
}

/// Which items are made.
#[derive(clap::Args, Debug)]
pub struct WhichItems {
    /// An item by its number, from 0; with --count the first of several.
    #[arg(long, value_name = "N", required_unless_present = "items")]
    pub item: Option<u64>,
    /// How many from --item on; those beyond the last item are left out.
    #[arg(long, value_name = "N", requires = "item", default_value_t = 1)]
    pub count: u64,
    /// First and one after the last item.
    #[arg(long, value_name = "A..B", conflicts_with = "item", value_parser = items)]
    pub items: Option<[u64; 2]>,
}

#[derive(clap::Args, Debug)]
pub struct Why {
    /// A shot file (.toml), a raw file taken here (.dng) with its shot file beside it, or a scene as `shoot` takes it without flags.
    #[arg(value_name = "SHOT.toml|PHOTO.dng|SCENE")]
    pub subject: PathBuf,
    /// The place: "x,y", 0 to 1 across and down the picture; without, where autofocus settled, else the middle.
    #[arg(long, value_name = "X,Y", value_parser = pair, allow_hyphen_values = true)]
    pub at: Option<[f64; 2]>,
    /// The shot file of a raw file (`shoot --save-shot`); without, the one of its name that ends in .toml.
    #[arg(long, value_name = "FILE")]
    pub shot: Option<PathBuf>,
    /// Page to write (.html or .pdf): the picture with the place marked, and all tables.
    #[arg(short, long, value_name = "FILE")]
    pub output: Option<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct Stack {
    /// Raw files of the series (.dng).
    #[arg(required = true)]
    pub raw: Vec<PathBuf>,
    #[command(flatten)]
    pub developing: Developing,
    /// Picture to write: .jpg, .png, .tif or .exr (linear light).
    #[arg(short, long, value_name = "FILE", required = true)]
    pub output: Vec<PathBuf>,
}

/// Words of `--focus` that take another: "--focus at 0.4,0.6" is "--focus 'at 0.4,0.6'".
pub fn joined_focus(args: impl Iterator<Item = std::ffi::OsString>) -> Vec<std::ffi::OsString> {
    let mut joined: Vec<std::ffi::OsString> = Vec::new();
    for arg in args {
        let waits = |word: &std::ffi::OsString| ["at", "on", "extension"].iter().any(|w| word == w);
        match joined.as_slice() {
            [.., flag, word] if flag == "--focus" && waits(word) => {
                let last = joined.last_mut().expect("it was just matched");
                last.push(" ");
                last.push(arg);
            }
            _ => joined.push(arg),
        }
    }
    joined
}

/// Settings of the development. A recipe or preset first, then the others on top.
#[derive(clap::Args, Debug)]
pub struct Developing {
    /// A recipe file (.toml).
    #[arg(long, value_name = "FILE", conflicts_with = "preset")]
    pub recipe: Option<PathBuf>,
    /// A named recipe: default, plain, camera, soft or film.
    #[arg(long, value_name = "NAME")]
    pub preset: Option<String>,
    /// One setting, as in a recipe: "tone.curve=reinhard"; may be given several times. `develop --settings` lists them.
    #[arg(long, value_name = "NAME=VALUE")]
    pub set: Vec<String>,
    /// Brighten by stops.
    #[arg(long, value_name = "EV", allow_negative_numbers = true)]
    pub exposure_ev: Option<f32>,
    /// Tone curve: aces-fit, agx, neutral, reinhard, linear ...
    #[arg(long, value_name = "NAME")]
    pub tone: Option<String>,
    /// Demosaic: gbtf, rcd, malvar-he-cutler, bilinear, linear or half.
    #[arg(long, value_name = "NAME")]
    pub demosaic: Option<String>,
    /// A look from a .cube file.
    #[arg(long, value_name = "FILE")]
    pub lut: Option<PathBuf>,
    /// How codes relate to light: a power of 1/1.8, 1/2.2 or 1/2.4, or the sRGB curve. Files carry a profile that says so.
    #[arg(long, value_name = "1.8|2.2|2.4|srgb", value_parser = gamma)]
    pub gamma: Option<&'static str>,
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

/// "x,y,z".
fn point(text: &str) -> Result<[f32; 3], String> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers.and_then(|n| n.try_into().ok()).ok_or_else(|| format!("\"{text}\" is not three numbers such as 0,1.5,-2"))
}

/// "x,y".
fn pair(text: &str) -> Result<[f64; 2], String> {
    list(text)?.0.try_into().map_err(|_| format!("\"{text}\" is not two numbers such as 0,0.7"))
}

/// "90", "90deg" or "90°".
fn degrees(text: &str) -> Result<f64, String> {
    let bare = text.trim();
    let bare = bare.strip_suffix("deg").or_else(|| bare.strip_suffix('°')).unwrap_or(bare).trim();
    bare.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| format!("\"{text}\" is not an angle such as 90deg"))
}

/// "8deg" or "0,5deg".
fn tilt(text: &str) -> Result<[f64; 2], String> {
    let (x, y) = text.split_once(',').unwrap_or((text, "0"));
    Ok([degrees(x)?, degrees(y)?])
}

/// "5mm", "5mm,-3mm" or "0,8mm".
fn shift(text: &str) -> Result<[f64; 2], String> {
    let length = |part: &str| match part.trim() {
        "0" | "" => Some(0.0),
        part => part
            .strip_prefix('-')
            .map_or_else(|| part.parse::<LengthMm>().ok().map(|l| l.0), |p| p.parse::<LengthMm>().ok().map(|l| -l.0)),
    };
    let (x, y) = text.split_once(',').unwrap_or((text, "0"));
    length(x).zip(length(y)).map(|(x, y)| [x, y]).ok_or_else(|| format!("\"{text}\" is not a shift such as 5mm or 0,8mm"))
}

/// Three numbers.
fn triple(text: &str) -> Result<[f64; 3], String> {
    list(text)?.0.try_into().map_err(|_| format!("\"{text}\" is not three numbers such as 0.01,0.04,20"))
}

/// Zones of autofocus.
fn zones(text: &str) -> Result<Zones, String> {
    if !text.contains(',') {
        return Ok(Zones::Named(text.trim().to_owned()));
    }
    let zone = |part: &str| list(part)?.0.try_into().map_err(|_| format!("\"{part}\" is not a zone \"x,y,width,height\""));
    Ok(Zones::Boxes(text.split(';').filter(|p| !p.trim().is_empty()).map(zone).collect::<Result<_, String>>()?))
}

/// "a,b,c".
fn list(text: &str) -> Result<List, String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
    let numbers = numbers.filter(|n| !n.is_empty() && n.len() <= 100);
    numbers.map(List).ok_or_else(|| format!("\"{text}\" is not a list of numbers such as 0,10,14"))
}

/// A part of a picture.
fn rectangle(text: &str) -> Result<[usize; 4], String> {
    let wrong = || format!("\"{text}\" is not four whole numbers x,y,width,height such as 300,200,64,64");
    let numbers: Option<Vec<usize>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers.and_then(|n| n.try_into().ok()).ok_or_else(wrong)
}

/// Four corners.
fn corners(text: &str) -> Result<[[f64; 2]; 4], String> {
    let [a, b, c, d, e, f, g, h] =
        list(text)?.0.try_into().map_err(|_| format!("\"{text}\" is not eight numbers: x,y of the four corners"))?;
    Ok([[a, b], [c, d], [e, f], [g, h]])
}

/// A fraction: "0.25" or "1/4".
fn fraction(text: &str) -> Result<f64, String> {
    diopter::quantity::number(text).ok_or_else(|| format!("\"{text}\" is not a fraction such as 0.25 or 1/4"))
}

/// "30s" or "off".
fn checkpoint(text: &str) -> Result<Checkpoint, String> {
    match text.parse::<Seconds>() {
        _ if text.trim() == "off" => Ok(Checkpoint::Off),
        Ok(Seconds(s)) if s > 0.0 => Ok(Checkpoint::Every(s)),
        _ => Err(format!("\"{text}\" is neither a time above 0, such as 30s, nor off")),
    }
}

/// A display's gamma, as the recipe names its encoding.
fn gamma(text: &str) -> Result<&'static str, String> {
    match text.trim() {
        "1.8" => Ok("gamma-1.8"),
        "2.2" => Ok("gamma-2.2"),
        "2.4" => Ok("gamma-2.4"),
        "srgb" | "sRGB" => Ok("srgb"),
        _ => Err(format!("\"{text}\" is not a gamma: 1.8, 2.2, 2.4 or srgb")),
    }
}

/// "A..B".
/// Numbers of items: "0..200".
fn items(text: &str) -> Result<[u64; 2], String> {
    let ends = text.split_once("..").and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    ends.filter(|[a, b]| a < b).ok_or_else(|| format!("\"{text}\" is not a range of items such as 0..200"))
}

fn range(text: &str) -> Result<[u32; 2], String> {
    let ends = text.split_once("..").and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    ends.ok_or_else(|| format!("\"{text}\" is not a range such as 0..64"))
}

/// The shot file of what is photographed: a shot file, or one with a scene alone.
pub fn shot_of(subject: Option<&str>) -> Result<ShotFile, diopter::shot::ShotError> {
    let Some(subject) = subject else { return Ok(ShotFile::default()) };
    if subject.ends_with(".toml") || subject == files::STANDARD_INPUT {
        return ShotFile::read(Path::new(subject));
    }
    let mut shot = ShotFile::default();
    shot.scene.file = Some(subject.to_owned());
    Ok(shot)
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

impl Developing {
    /// Puts recipe, preset and flags on top of a recipe.
    pub fn apply(&self, recipe: &mut diopter::develop::Recipe) -> Result<(), diopter::shot::ShotError> {
        use diopter::develop::{Recipe, RecipeError};
        if let Some(file) = &self.recipe {
            *recipe = diopter::recipe_file::read(file)?;
        }
        if let Some(name) = &self.preset {
            *recipe = Recipe::preset(name)?;
        }
        for setting in &self.set {
            let (name, value) = setting.split_once('=').ok_or_else(|| RecipeError {
                place: "--set".into(),
                found: format!("\"{setting}\""),
                expected: "a name and a value, such as tone.curve=reinhard".into(),
            })?;
            *recipe = recipe.with(name.trim(), value.trim())?;
        }
        let ev = self.exposure_ev.map(|ev| ev.to_string());
        let lut = self.lut.as_ref().map(|p| p.display().to_string());
        let encoding = self.gamma.map(str::to_owned);
        for (name, value) in [
            ("exposure.ev", &ev),
            ("tone.curve", &self.tone),
            ("demosaic.method", &self.demosaic),
            ("lut.file", &lut),
            ("output.encoding", &encoding),
        ] {
            if let Some(value) = value {
                *recipe = recipe.with(name, value)?;
            }
        }
        recipe.check()?;
        Ok(())
    }
}
