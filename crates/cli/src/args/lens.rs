//! Flags of `lens`.

use super::List;
use super::values::list;
use clap::Subcommand;
use diopter::quantity::{Distance, FNumber, LengthMm, Size};
use diopter::shot::flag_values::{degrees, pair, shift, tilt};
use std::path::PathBuf;

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
    /// Ghosts: every pair of surfaces, and of a surface and the sensor, whose reflections bring light of a distant source onto the film; focus, size,
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
