//! Flags of `measure` and `body`.

use super::values::{corners, list, rectangle};
use super::{Developing, List};
use clap::Subcommand;
use diopter::quantity::{FNumber, Iso, LengthMm, Seconds, Size};
use diopter::shot::flag_values::{celsius, pair, samples_a_pixel, wavelength};
use std::path::PathBuf;

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
        /// Transfer function of the picture's codes: auto is that of its colour profile, sRGB without one; an .exr is linear.
        #[arg(long, value_name = "NAME", default_value = "auto")]
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
    #[arg(long, value_name = "N", value_parser = samples_a_pixel)]
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
    /// Transfer function of the codes of a .png, .tif or .jpg: auto is that of its colour profile, sRGB without one.
    #[arg(long, value_name = "NAME", default_value = "auto")]
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
    #[arg(long, value_name = "N", default_value_t = 64, value_parser = samples_a_pixel)]
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
    /// Transfer function of the codes of a .png, .tif or .jpg: auto is that of its colour profile, sRGB without one; linear shows the codes themselves.
    #[arg(long, value_name = "NAME", default_value = "auto")]
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
    /// Transfer function of the codes of a .png, .tif or .jpg: auto is that of its colour profile, sRGB without one.
    #[arg(long, value_name = "NAME", default_value = "auto")]
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
    /// Transfer function of the codes of a .png, .tif or .jpg: auto is that of its colour profile, sRGB without one.
    #[arg(long, value_name = "NAME", default_value = "auto")]
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
    Auto,
    Srgb,
    #[value(name = "gamma-1.8")]
    Gamma18,
    #[value(name = "gamma-2.2")]
    Gamma22,
    #[value(name = "gamma-2.4")]
    Gamma24,
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
    #[arg(long, value_name = "NM", value_parser = wavelength)]
    pub wavelength: Option<f64>,
    /// Exposure time.
    #[arg(long, value_name = "TIME", default_value = "10ms")]
    pub shutter: Seconds,
    /// Temperature of the sensor, °C.
    #[arg(long, value_name = "C", value_parser = celsius, allow_negative_numbers = true)]
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
