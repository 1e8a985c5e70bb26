//! Flags of `calc`.

use clap::Subcommand;
use diopter::quantity::{Distance, FNumber, Iso, IsoChoice, LengthMm, Moment, Seconds};
use diopter::shot::flag_values::{pair, wavelength};
use std::path::PathBuf;

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
    #[arg(long)]
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
    #[arg(long, value_name = "NM", default_value = "550", value_parser = wavelength, allow_negative_numbers = true)]
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
