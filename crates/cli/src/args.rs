//! What can be typed: the one source of help, manual pages and completions. [`crate::help`] puts the flags of a photograph under headings.
//! The verbs of `lens` are beside what they do, in `commands/lens/`.

mod calc;
mod develop;
mod measure;
mod photograph;
pub mod values;

pub use calc::{
    CalcVerb, DaylightArgs, DepthOfField, Equivalent, Field, FormatArgs, PinholeArgs, ShutterArgs, StopArgs, ThinLensArgs,
};
pub use develop::{Develop, Developing, LutVerb, Merge, ReadOut, Stack};
pub use measure::{
    BodyVerb, Emva, LsfWindow, MeasureGlare, MeasureMtf, MeasureOecf, MeasureReport, MeasureRolling, MeasureThroughLens,
    MeasureVerb, MeasuredChannel, PictureEncoding,
};
pub use photograph::{Checkpoint, Expose, Raw, Shoot, Taking, TruthLayout, Viewfinder};
pub use values::{List, joined_focus};

use crate::commands::lens::LensVerb;
use clap::{Parser, Subcommand};
use diopter::denoising::Denoise;
use diopter::files;
use diopter::memory::Bytes;
use diopter::quantity::{Distance, FNumber, LengthMm, Seconds, Size};
use diopter::shot::ShotFile;
use diopter::shot::flag_values::{degrees_f32, pair};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use values::{items, threads};

/// Photographs of 3D scenes the way a real camera takes them.
#[derive(Parser, Debug)]
#[command(name = "diopter", version, propagate_version = true, args_override_self = true)]
pub struct Args {
    /// Print machine-readable results and errors on standard output.
    #[arg(long, global = true)]
    pub json: bool,
    /// Threads to use; all without. The result does not depend on it.
    #[arg(long, global = true, value_name = "N", value_parser = threads)]
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
    /// Film format: a name ("full frame", "APS-C", "4/3") or mm ("36x24"); without, that of the plane, and full frame of other pictures.
    #[arg(long, value_name = "NAME|MM")]
    pub format: Option<String>,
    /// Blades of the iris; round without.
    #[arg(long, value_name = "N")]
    pub blades: Option<u32>,
    /// How round the blades are: 0 straight to 1.
    #[arg(long, value_name = "X")]
    pub blade_curvature: Option<f32>,
    /// Turn the iris, degrees.
    #[arg(long, value_name = "DEG", value_parser = degrees_f32, allow_negative_numbers = true)]
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
    #[arg(long, value_name = "NAME|FILE", default_value = "davis346", help_heading = "Sensor")]
    pub sensor: String,
    /// How long events are taken, from --at on.
    #[arg(long, value_name = "TIME", default_value = "100 ms", help_heading = "Time")]
    pub duration: Seconds,
    /// From one moment of light that is computed to the next; nothing should move by more than about a pixel in it.
    #[arg(long, value_name = "TIME", default_value = "1 ms", help_heading = "Time")]
    pub step: Seconds,
    /// Halve a step, up to four times, in which the light of a pixel changes by more than this (natural logarithm).
    #[arg(long, value_name = "CHANGE", help_heading = "Time")]
    pub most_change: Option<f64>,
    /// Write the photocurrents that pixels were fed with, too (.npy: float32 [moment][row][column], e-/s).
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub keep_light: Option<PathBuf>,
    /// File to write: .npy (structured array), .csv or .raw (EVT 2.0).
    #[arg(short, long, value_name = "FILE", required = true, help_heading = "Output")]
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
    #[arg(long, value_name = "N", requires = "item", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
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
