//! Flags of a photograph, shared by all verbs that take one, and those of `shoot`, `expose` and the viewfinder.

use super::values::checkpoint;
use super::{Developing, shot_of};
use crate::effect::Typed;
use clap::ValueEnum;
use diopter::image::dng::Storage;
use diopter::memory::Bytes;
use diopter::quantity::SpectralBands;
use diopter::sheet::Axis;
use diopter::shot::ShotFile;
use diopter::shot::flag_values::{celsius, pair};
use diopter::shot::sections::SequenceSection;
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
    #[arg(long, value_name = "C", value_parser = celsius, allow_negative_numbers = true)]
    pub temperature: Option<f64>,
    /// How numbers are stored in a DNG; 16 without.
    #[arg(long, value_name = "HOW")]
    pub dng: Option<DngStorage>,
}

/// What is photographed and how; shared by `shoot` and `expose`. Flags win over the shot file.
#[derive(clap::Args, Debug)]
pub struct Taking {
    /// Embedded scene, a scene file (.usd, .gltf, .glb, .pbrt, .xml (Mitsuba), .obj, .ply, .spz, .stl, .scene (by hand)), or a .toml shot file; - for a shot file on standard input.
    #[arg(value_name = "SCENE|SHOT.toml")]
    pub subject: Option<String>,
    /// All that the shot file has keys for.
    #[command(flatten)]
    pub said: ShotFile,
    /// Take no more memory than this ("4GB"); without, than is free. `expose` puts what is left into a temporary file beside its output, where it needs
    /// 16 bytes a pixel and band; others refuse what is too large.
    #[arg(long, value_name = "SIZE", help_heading = "Rendering")]
    pub max_memory: Option<Bytes>,
    /// How often a long exposure is saved beside its output (FILE.checkpoint), to go on after being stopped or killed; without, every 30 s
    /// of exposures above a minute.
    #[arg(long, value_name = "TIME|off", value_parser = checkpoint, help_heading = "Rendering")]
    pub checkpoint: Option<Checkpoint>,
    /// Go on from this exposure's checkpoint, and fail if there is none; without, it goes on if there is one. Of a series it keeps the pictures that are there; those that are to be joined only as .dng files.
    #[arg(long, help_heading = "Rendering")]
    pub resume: bool,
    /// Begin anew even if there is a checkpoint.
    #[arg(long, conflicts_with = "resume", help_heading = "Rendering")]
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
    #[command(flatten, next_help_heading = "Development")]
    pub developing: Developing,
    #[command(flatten, next_help_heading = "Sensor")]
    pub raw: Raw,
    /// Write the truth of each pixel (EXR): noise-free electrons, variances, clipping, depth, ids.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub truth: Option<PathBuf>,
    /// How the channels of --truth are laid out in the file.
    #[arg(long, value_enum, value_name = "LAYOUT", default_value = "single-part", requires = "truth", help_heading = "Output")]
    pub truth_layout: TruthLayout,
    /// Write the names of the Cryptomatte layers of --truth beside it, too: NAME.CryptoObject.json and so on.
    #[arg(long, requires = "truth", help_heading = "Output")]
    pub truth_sidecar: bool,
    /// Keep the focal plane too (EXR).
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub keep_plane: Option<PathBuf>,
    /// Series and films.
    #[command(flatten)]
    pub sequence: SequenceSection,
    /// Join the series: linear light (.exr), a raw file (.dng) or a picture; may be given several times.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub merge: Vec<PathBuf>,
    /// Join the focus series into one picture that is sharp all over; may be given several times.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub stack: Vec<PathBuf>,
    /// What autofocus saw, as a plot (.svg or .png).
    #[arg(long, value_name = "FILE", help_heading = "Focus")]
    pub plot_focus: Option<PathBuf>,
    /// Split pixels: each output is written twice, as the left and the right photodiode saw it (NAME-left, NAME-right).
    #[arg(long, help_heading = "Sensor")]
    pub dual_pixel: bool,
    /// Vary a setting of the shot: "iso=100,400,1600"; a second goes down the sheet.
    ///
    /// A flag's name without dashes, a setting of the development (tone.curve), or a key of the shot file. Settings that change together:
    /// "aperture:shutter=f/2:1/60,f/4:1/15". Values that have commas are separated by semicolons.
    #[arg(long, value_name = "NAME=A,B,C", requires = "sheet", help_heading = "Contact sheet")]
    pub vary: Vec<Axis>,
    /// Contact sheet of the varied shots: .png, .jpg, .html or .pdf; may be given several times.
    #[arg(long, value_name = "FILE", requires = "vary", conflicts_with_all = ["output", "truth", "keep_plane", "bracket", "merge", "focus_bracket", "stack", "plot_focus", "frames", "save_shot"], help_heading = "Contact sheet")]
    pub sheet: Vec<PathBuf>,
    /// Also show a part of each picture at 100 %: its middle, "x,y", 0 to 1 across and down the picture.
    #[arg(long, value_name = "X,Y", value_parser = pair, requires = "sheet", help_heading = "Contact sheet")]
    pub sheet_crop: Option<[f64; 2]>,
    /// Also show the histogram of each picture.
    #[arg(long, requires = "sheet", help_heading = "Contact sheet")]
    pub sheet_histogram: bool,
    /// Longer side of the pictures on the sheet, px; larger ones are reduced. 480 without.
    #[arg(long, value_name = "PX", requires = "sheet", help_heading = "Contact sheet")]
    pub sheet_cell: Option<usize>,
    /// Pictures beside each other on the sheet.
    #[arg(long, value_name = "N", requires = "sheet", help_heading = "Contact sheet")]
    pub sheet_columns: Option<usize>,
    /// Title of the sheet.
    #[arg(long, value_name = "TEXT", requires = "sheet", help_heading = "Contact sheet")]
    pub sheet_title: Option<String>,
    /// A table under the pictures: what a command of `calc` prints.
    ///
    /// Such as "calc stop --focal-length 50mm"; may be given several times.
    #[arg(long, value_name = "COMMAND", requires = "sheet", help_heading = "Contact sheet")]
    pub sheet_table: Vec<String>,
    /// Write what is being shot as a shot file.
    #[arg(long, value_name = "FILE", help_heading = "Output")]
    pub save_shot: Option<PathBuf>,
    /// File to write: .jpg, .png, .tif, .exr (linear) or .dng (raw); may be given several times.
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    pub output: Vec<PathBuf>,
}

#[derive(clap::Args, Debug)]
pub struct Expose {
    #[command(flatten)]
    pub taking: Taking,
    /// Linear sRGB of the light that arrives, cd/m², instead of the sensor's electrons: what renderers write.
    #[arg(long, help_heading = "Sensor")]
    pub radiance: bool,
    /// With --radiance: compute with red, green and blue as RGB renderers do, instead of spectra, to compare with them.
    #[arg(long, requires = "radiance", conflicts_with = "bands", help_heading = "Sensor")]
    pub rgb: bool,
    /// Mean spectral radiance in narrow bands, W/(m² sr nm), instead of the sensor's electrons: "400..700/10nm" (hyperspectral).
    #[arg(long, value_name = "FROM..TO/STEP", conflicts_with = "radiance", help_heading = "Sensor")]
    pub bands: Option<SpectralBands>,
    /// Focal plane to write (.exr).
    #[arg(short, long, value_name = "FILE", help_heading = "Output")]
    pub output: PathBuf,
}

impl Raw {
    /// How numbers are stored.
    pub fn storage(&self) -> Storage {
        match self.dng {
            None | Some(DngStorage::Sixteen) => Storage::Sixteen,
            Some(DngStorage::Packed) => Storage::Packed,
            Some(DngStorage::Lossless) => Storage::Lossless,
        }
    }

    /// Options of files, as they were typed.
    pub fn typed_of_files(&self) -> [Typed; 1] {
        let name = |how: DngStorage| how.to_possible_value().map(|v| v.get_name().to_owned());
        [("--dng", self.dng.and_then(name))]
    }
}

impl Taking {
    /// The shot file that is meant: the one given, with the flags on top.
    pub fn shot_file(&self) -> Result<ShotFile, diopter::shot::ShotError> {
        let mut shot = shot_of(self.subject.as_deref())?;
        let mut said = self.said.clone();
        // Of a flag given twice the last wins.
        said.scene.flicker.drain(..said.scene.flicker.len().saturating_sub(1));
        shot.override_with(said);
        Ok(shot)
    }
}
