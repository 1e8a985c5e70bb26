//! Flags of what follows the exposure: read-out, development, merging.

use super::values::gamma;
use super::{Raw, TruthLayout};
use crate::effect::Typed;
use clap::Subcommand;
use diopter::quantity::{FNumber, Iso, Seconds};
use diopter::sensor::{AskedReading, ColorSampling};
use diopter::shot::flag_values::stops;
use std::num::NonZeroUsize;
use std::path::PathBuf;

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
    /// Illuminant the camera takes for white; what the camera was set to, or D65, without.
    #[arg(long, value_name = "NAME")]
    pub white: Option<String>,
    /// Seed of the sensor's noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Which colors each pixel is read in: that of its filter (mosaic), or red, green and blue (full), which gives a linear DNG. mosaic without.
    #[arg(long, value_name = "mosaic|full", conflicts_with = "truth")]
    pub color_sampling: Option<ColorSampling>,
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

impl ReadOut {
    /// What is asked of the reading.
    pub fn asked(&self) -> AskedReading {
        AskedReading {
            iso: self.iso.map(|iso| iso.0),
            serial: self.raw.serial.clone(),
            temperature_c: self.raw.temperature,
            white: self.white.clone(),
            color_sampling: self.color_sampling,
        }
    }
}

#[derive(clap::Args, Debug)]
pub struct Develop {
    /// Raw files (.dng); - for standard input.
    #[arg(required_unless_present_any = ["settings", "save_recipe"])]
    pub raw: Vec<PathBuf>,
    #[command(flatten)]
    pub developing: Developing,
    /// JPEG quality, 1 to 100; 92 without.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=100))]
    pub quality: Option<u8>,
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

#[derive(clap::Args, Debug)]
pub struct Merge {
    /// Focal planes (.exr), or raw files of an exposure series (.dng).
    #[arg(required = true)]
    pub parts: Vec<PathBuf>,
    /// Of focal planes: the plane to write (.exr). Of raw files: linear light (.exr), a raw file (.dng) or a picture; may be given several times.
    #[arg(short, long, value_name = "FILE", required = true)]
    pub output: Vec<PathBuf>,
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
    #[arg(long, value_name = "EV", value_parser = stops, allow_negative_numbers = true)]
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
    /// How codes relate to light: a power of 1/1.8, 1/2.2 or 1/2.4, or the sRGB curve. Files tell it: by a profile, sRGB in JPEG and PNG by their own words for it.
    #[arg(long, value_name = "1.8|2.2|2.4|srgb", value_parser = gamma)]
    pub gamma: Option<&'static str>,
}

impl Develop {
    /// Options of files, as they were typed.
    pub fn typed_of_files(&self) -> [Typed; 3] {
        let number = |n: Option<u8>| n.map(|n| n.to_string());
        [("--quality", number(self.quality)), ("--gain-map", self.gain_map.then(String::new)), ("--bits", number(self.bits))]
    }
}

impl Developing {
    /// Whether something of demosaicing is asked for, be it what is usual.
    pub fn asks_for_demosaicing(&self) -> bool {
        self.demosaic.is_some() || self.set.iter().any(|setting| setting.trim_start().starts_with("demosaic"))
    }

    /// What was typed of it.
    pub fn typed(&self) -> Vec<Typed> {
        let path = |path: &Option<PathBuf>| path.as_ref().map(|p| p.display().to_string());
        let mut typed = vec![
            ("--recipe", path(&self.recipe)),
            ("--preset", self.preset.clone()),
            ("--exposure-ev", self.exposure_ev.map(|ev| ev.to_string())),
            ("--tone", self.tone.clone()),
            ("--demosaic", self.demosaic.clone()),
            ("--lut", path(&self.lut)),
            ("--gamma", self.gamma.map(|curve| curve.trim_start_matches("gamma-").to_owned())),
        ];
        typed.extend(self.set.iter().map(|setting| ("--set", Some(setting.clone()))));
        typed
    }

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
        recipe.without_effect().iter().for_each(|note| crate::watch::warn(note));
        Ok(())
    }
}
