//! The settings of a development: what they are called, what they may be, and why.

use serde::{Deserialize, Serialize};

/// What is done to a raw image. Every field has a default; the defaults make a picture fit to be looked at.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Recipe {
    /// Offsets of rows.
    pub row_noise: RowNoise,
    /// Pixels that are broken.
    pub defects: Defects,
    /// What is brighter than the sensor can tell.
    pub highlights: Highlights,
    /// What is white.
    pub white: White,
    /// What is made of a light field.
    pub light_field: LightField,
    /// How missing colours are filled in.
    pub demosaic: DemosaicStep,
    /// Less noise.
    pub noise: Noise,
    /// What the lens did, undone.
    pub lens: Lens,
    /// Brightness.
    pub exposure: Exposure,
    /// Contrast of large areas.
    pub local: Local,
    /// Tone curve.
    pub tone: Tone,
    /// Grading.
    pub grade: Grade,
    /// A look from a file.
    pub lut: LutStep,
    /// Sharpening.
    pub sharpen: Sharpen,
    /// Size of the picture.
    pub resize: Resize,
    /// What the numbers of the picture mean.
    pub output: Output,
}

macro_rules! section {
    ($(#[$about:meta])* $name:ident { $($(#[$doc:meta])* $field:ident: $type:ty = $default:expr,)* }) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name { $($(#[$doc])* pub $field: $type,)* }
        impl Default for $name {
            fn default() -> Self {
                $name { $($field: $default,)* }
            }
        }
    };
}

section! {
    /// Offsets of rows.
    RowNoise {
        /// Fraction of what a row lies off its neighbours that is taken away.
        amount: f64 = 0.0,
    }
}

section! {
    /// Pixels that are broken.
    Defects {
        /// Deviations of the noise by which a pixel must stand out of all its neighbours; 0 mends none.
        threshold: f64 = 0.0,
    }
}

section! {
    /// What is brighter than the sensor can tell.
    Highlights {
        /// The method.
        method: HighlightMethod = HighlightMethod::Recover,
    }
}

/// What is done about saturated channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum HighlightMethod {
    /// All channels end where the first saturates: blown highlights are white.
    Clip,
    /// Saturated channels are guessed from those that are not.
    Recover,
}

section! {
    /// What is white.
    White {
        /// `as-shot`, `auto`, `daylight`, `cloudy`, `shade`, `tungsten`, `fluorescent`, `flash`, an illuminant such as `D50`, or a colour
        /// temperature such as `5200 K`.
        balance: String = "as-shot".into(),
        /// Off the line of black bodies: greener below 0, more magenta above.
        tint: f64 = 0.0,
        /// A part of the picture that is grey: left, top, width, height as fractions of the picture. Wins over `balance`.
        patch: Option<[f64; 4]> = None,
    }
}

section! {
    /// What is made of the raw picture of a plenoptic camera; without any of these it is developed as it is, with the images behind all
    /// microlenses.
    LightField {
        /// What is sharp: `as-taken`, a distance such as `1.2 m`, `inf`, or `all`.
        focus: String = String::new(),
        /// f-number of a smaller part of the pupil; all of it without.
        aperture: Option<f64> = None,
        /// A view through one place of the pupil, to the right and down as seen from behind the camera; 1 is its edge.
        view: Option<[f64; 2]> = None,
    }
}

impl LightField {
    /// Whether anything is to be made of it.
    pub fn wanted(&self) -> bool {
        *self != LightField::default()
    }
}

section! {
    /// How missing colours are filled in.
    DemosaicStep {
        /// The method; patterns other than Bayer's take `linear` where it does not fit.
        method: Demosaic = Demosaic::Gbtf,
        /// Passes of a median over the colours of pixels where a channel changes strongly; 0 leaves what was guessed.
        false_color_passes: f64 = 3.0,
    }
}

/// Demosaic methods.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Demosaic {
    /// The mean of the nearest neighbours of a colour.
    Bilinear,
    /// 5 × 5 linear filters with correction by the gradient of the known colour.
    MalvarHeCutler,
    /// Directional colour differences weighted by their gradients.
    Gbtf,
    /// Ratio corrected.
    Rcd,
    /// Best linear filters, for any pattern.
    Linear,
    /// One pixel for each period of the pattern.
    Half,
}

section! {
    /// Less noise.
    Noise {
        /// Brightness noise taken away.
        luminance: f64 = 0.0,
        /// Colour noise taken away.
        color: f64 = 0.0,
    }
}

section! {
    /// What the lens did, undone.
    Lens {
        /// Straight lines straight.
        distortion: bool = false,
        /// Colours on top of each other.
        lateral_color: bool = false,
        /// Corners as bright as the middle.
        vignetting: bool = false,
    }
}

section! {
    /// Brightness.
    Exposure {
        /// Brightening.
        ev: f64 = 0.0,
    }
}

section! {
    /// Contrast of large areas.
    Local {
        /// Fraction of the contrast between large areas that is taken away.
        compression: f64 = 0.0,
        /// Factor of the contrast within areas.
        detail: f64 = 1.0,
        /// How large an area is, of the longer side of the picture.
        radius: f64 = 0.04,
    }
}

section! {
    /// Tone curve.
    Tone {
        /// The curve.
        curve: Curve = Curve::AcesFit,
        /// Whether light is scaled so that a grey of 18 % is shown as 18 %, whatever the curve.
        keep_grey: bool = true,
        /// Luminance shown as white by `reinhard-extended` and `hable`; `None`: what each was published with.
        white: Option<f64> = None,
    }
}

/// Tone curves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Curve {
    /// None: clipped at white.
    Linear,
    /// Reinhard et al. 2002, x / (1 + x), on each channel.
    Reinhard,
    /// Reinhard et al. 2002, eq. 4, with a white, on luminance.
    ReinhardExtended,
    /// Reinhard et al. 2002, L / (1 + L), on luminance.
    ReinhardLuminance,
    /// Hill's fit of the ACES 1.x reference rendering for sRGB displays.
    #[serde(alias = "aces")]
    AcesFit,
    /// ACES 1.3 reference rendering and sRGB output transform.
    #[serde(rename = "aces-1.3")]
    Aces13,
    /// ACES 2.0 output transform, Rec.709, 100 cd/m².
    #[serde(rename = "aces-2.0")]
    Aces20,
    /// AgX, Sobotka's original.
    Agx,
    /// AgX with the punchy look.
    AgxPunchy,
    /// Khronos PBR Neutral.
    Neutral,
    /// Hable's filmic curve (Uncharted 2).
    Hable,
    /// Hejl & Burgess-Dawson's filmic curve.
    Hejl,
}

section! {
    /// Grading, by the ASC CDL (version 1.2): (code · slope + offset) ^ power, then saturation about Rec.709 luma.
    Grade {
        /// Factor of each channel.
        slope: [f64; 3] = [1.0; 3],
        /// Added to each channel.
        offset: [f64; 3] = [0.0; 3],
        /// Power of each channel.
        power: [f64; 3] = [1.0; 3],
        /// Distance from grey.
        saturation: f64 = 1.0,
        /// Contrast about middle grey.
        contrast: f64 = 1.0,
    }
}

section! {
    /// A look from a file.
    LutStep {
        /// A `.cube` file; none when empty.
        file: String = String::new(),
        /// What the table expects.
        input: LutInput = LutInput::Srgb,
        /// How values between the points of a 3D table are found.
        interpolation: Interpolation = Interpolation::Tetrahedral,
        /// How much of the look.
        amount: f64 = 1.0,
    }
}

/// What a look-up table is fed with, and what it gives.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum LutInput {
    /// sRGB codes of the finished picture; the table gives sRGB codes.
    Srgb,
    /// Rec.709 linear light of the finished picture; the table gives the same.
    Linear,
    /// ACEScct codes (AP1) of the scene: the table is the whole look and gives sRGB codes; curve and grading are left out.
    Acescct,
    /// As `acescct`, but logarithmic codes of linear sRGB as [`crate::lut::log_code`] makes them: what `lut bake` is most exact with.
    Log,
}

/// Interpolation in a 3D table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Interpolation {
    /// Between the 4 corners of a tetrahedron: greys stay clean.
    Tetrahedral,
    /// Between the 8 corners of a cube.
    Trilinear,
}

section! {
    /// Sharpening of brightness.
    Sharpen {
        /// How much of the difference to the blurred picture is added.
        amount: f64 = 0.0,
        /// Deviation of the blur.
        radius: f64 = 0.8,
        /// Differences of codes smaller than this are taken for noise.
        threshold: f64 = 0.0,
    }
}

section! {
    /// Size of the picture; with none of the lengths it stays.
    Resize {
        /// Width.
        width: Option<u32> = None,
        /// Height.
        height: Option<u32> = None,
        /// The longer side.
        long_edge: Option<u32> = None,
    }
}

section! {
    /// What the numbers of the picture mean.
    Output {
        /// Primaries.
        space: Space = Space::Srgb,
        /// Transfer function.
        encoding: diopter_image::Encoding = diopter_image::Encoding::Srgb,
        /// Brightest light of an HDR picture, in diffuse whites.
        peak: f64 = 4.926,
    }
}

/// Primaries a picture can have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Space {
    /// sRGB, Rec.709.
    Srgb,
    /// Display P3.
    DisplayP3,
    /// Rec.2020.
    Rec2020,
}

/// What a setting may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Allowed {
    /// A number from the first to the second.
    Number(f64, f64),
    /// So many numbers, each from the first to the second.
    Numbers(usize, f64, f64),
    /// Yes or no.
    Bool,
    /// One of these names.
    Names(&'static [&'static str]),
    /// Text.
    Text,
}

/// What is to be known about a setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Section and name, as in a recipe file.
    pub name: &'static str,
    /// Unit; empty of bare numbers.
    pub unit: &'static str,
    /// What it may be.
    pub allowed: Allowed,
    /// What it does, and why its default is what it is.
    pub why: &'static str,
}

const CURVES: &[&str] = &[
    "linear",
    "reinhard",
    "reinhard-extended",
    "reinhard-luminance",
    "aces-fit",
    "aces-1.3",
    "aces-2.0",
    "agx",
    "agx-punchy",
    "neutral",
    "hable",
    "hejl",
];
const METHODS: &[&str] = &["gbtf", "rcd", "malvar-he-cutler", "bilinear", "linear", "half"];

const fn number(name: &'static str, unit: &'static str, low: f64, high: f64, why: &'static str) -> Setting {
    Setting { name, unit, allowed: Allowed::Number(low, high), why }
}

const fn other(name: &'static str, allowed: Allowed, why: &'static str) -> Setting {
    Setting { name, unit: "", allowed, why }
}

/// All settings, in the order of the steps.
pub const SETTINGS: &[Setting] = &[
    number(
        "row_noise.amount",
        "",
        0.0,
        1.0,
        "fraction of a row's offset from its neighbours that is taken away; off: it can take fine level lines for noise",
    ),
    number(
        "defects.threshold",
        "deviations",
        0.0,
        1000.0,
        "pixels that stand out of all their neighbours by more are mended; 0 is off: stars are such pixels too",
    ),
    other(
        "highlights.method",
        Allowed::Names(&["clip", "recover"]),
        "clip: white where the first channel saturates; recover: saturated channels are guessed from the others",
    ),
    other(
        "white.balance",
        Allowed::Text,
        "as-shot, auto, daylight, cloudy, shade, tungsten, fluorescent, flash, an illuminant (D50) or a temperature (5200 K)",
    ),
    number("white.tint", "1/3000 of uv", -150.0, 150.0, "off the line of black bodies: greener below 0, more magenta above"),
    Setting {
        name: "white.patch",
        unit: "fraction of the picture",
        allowed: Allowed::Numbers(4, 0.0, 1.0),
        why: "left, top, width, height of a part that is grey; wins over white.balance",
    },
    other(
        "light_field.focus",
        Allowed::Text,
        "of a plenoptic camera's file, what is sharp: as-taken, a distance (1.2 m), inf, or all; unset, the images behind the microlenses are shown as they are",
    ),
    number(
        "light_field.aperture",
        "f-number",
        0.1,
        1000.0,
        "a smaller part of the pupil: more depth of field; unset, all of it. The picture stays as bright",
    ),
    Setting {
        name: "light_field.view",
        unit: "radii of the pupil",
        allowed: Allowed::Numbers(2, -1.0, 1.0),
        why: "a view through one place of the pupil, to the right and down; instead of an aperture",
    },
    other(
        "demosaic.method",
        Allowed::Names(METHODS),
        "gbtf has the least error on charts; malvar-he-cutler and bilinear are faster; linear serves any pattern; half gives one pixel for each period of the pattern, with nothing guessed",
    ),
    number(
        "demosaic.false_color_passes",
        "passes",
        0.0,
        5.0,
        "the colours of pixels where a channel changes by more than a factor of 4 give way to the median around: a mosaic sees glints and hard edges in single colours. Whole numbers; 0 leaves what was guessed",
    ),
    number(
        "noise.luminance",
        "",
        0.0,
        1.0,
        "brightness noise taken away, by the noise profile of the file; off: noise is part of the truth",
    ),
    number("noise.color", "", 0.0, 1.0, "colour noise taken away"),
    other(
        "lens.distortion",
        Allowed::Bool,
        "straight lines straight, by the prescription, with the edges cropped that would be empty; off: the lens is what one wants to see",
    ),
    other("lens.lateral_color", Allowed::Bool, "colours on top of each other, by the prescription"),
    other("lens.vignetting", Allowed::Bool, "corners as bright as the middle, by the prescription"),
    number("exposure.ev", "EV", -10.0, 10.0, "brightening; at 0 what was metered as 18 % grey is shown so"),
    number("local.compression", "", 0.0, 1.0, "fraction of the contrast between large areas that is taken away"),
    number("local.detail", "", 0.0, 4.0, "factor of the contrast within areas"),
    number("local.radius", "of the longer side", 0.002, 0.25, "how large an area is"),
    other("tone.curve", Allowed::Names(CURVES), "from the light of the scene to that of a display"),
    other(
        "tone.keep_grey",
        Allowed::Bool,
        "scales the light so that 18 % grey is shown as 18 % with every curve; without, the curve is as published",
    ),
    number("tone.white", "", 0.5, 1000.0, "luminance shown as white by reinhard-extended (4) and hable (11.2)"),
    Setting {
        name: "grade.slope",
        unit: "",
        allowed: Allowed::Numbers(3, 0.0, 10.0),
        why: "factor of the codes of each channel (ASC CDL)",
    },
    Setting {
        name: "grade.offset",
        unit: "code",
        allowed: Allowed::Numbers(3, -1.0, 1.0),
        why: "added to each channel (ASC CDL)",
    },
    Setting { name: "grade.power", unit: "", allowed: Allowed::Numbers(3, 0.1, 10.0), why: "power of each channel (ASC CDL)" },
    number("grade.saturation", "", 0.0, 4.0, "distance from grey (ASC CDL)"),
    number("grade.contrast", "", 0.1, 4.0, "slope about the code of middle grey"),
    other("lut.file", Allowed::Text, "a .cube file, 1D or 3D"),
    other(
        "lut.input",
        Allowed::Names(&["srgb", "linear", "acescct", "log"]),
        "what the table expects: codes or light of the picture, or of the scene",
    ),
    other("lut.interpolation", Allowed::Names(&["tetrahedral", "trilinear"]), "between the points of a 3D table"),
    number("lut.amount", "", 0.0, 1.0, "how much of the look"),
    number("sharpen.amount", "", 0.0, 5.0, "how much of the difference to the blurred picture is added"),
    number("sharpen.radius", "px", 0.2, 20.0, "deviation of the blur"),
    number("sharpen.threshold", "code", 0.0, 1.0, "smaller differences are taken for noise"),
    number("resize.width", "px", 1.0, 65_535.0, "width; with the height alone it follows the shape"),
    number("resize.height", "px", 1.0, 65_535.0, "height"),
    number("resize.long_edge", "px", 1.0, 65_535.0, "the longer side"),
    other("output.space", Allowed::Names(&["srgb", "display-p3", "rec2020"]), "primaries; files carry a profile"),
    other(
        "output.encoding",
        Allowed::Names(&["srgb", "gamma-1.8", "gamma-2.2", "gamma-2.4", "linear", "pq", "hlg"]),
        "transfer function",
    ),
    number("output.peak", "diffuse whites", 1.0, 49.26, "brightest light of an HDR picture: 1000 of 203 cd/m²"),
];

/// A recipe that cannot be followed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{place}: {found}; expected {expected}")]
pub struct RecipeError {
    /// Name of the setting.
    pub place: String,
    /// What is there.
    pub found: String,
    /// What belongs there.
    pub expected: String,
}

impl Recipe {
    /// Names of the presets.
    pub const PRESETS: [&'static str; 5] = ["default", "plain", "camera", "soft", "film"];

    /// A named set of settings. Fails with the names there are.
    pub fn preset(name: &str) -> Result<Recipe, RecipeError> {
        let text = match name {
            "default" => "",
            "plain" => include_str!("presets/plain.toml"),
            "camera" => include_str!("presets/camera.toml"),
            "soft" => include_str!("presets/soft.toml"),
            "film" => include_str!("presets/film.toml"),
            _ => {
                return Err(RecipeError {
                    place: "preset".into(),
                    found: format!("\"{name}\""),
                    expected: format!("one of {}", Self::PRESETS.join(", ")),
                });
            }
        };
        Recipe::from_toml(text)
    }

    /// Reads a recipe file. Fails with line, what was found and what was expected.
    pub fn from_toml(text: &str) -> Result<Recipe, RecipeError> {
        let recipe: Recipe = toml::from_str(text).map_err(|e| RecipeError {
            place: match e.span() {
                Some(span) => format!("line {}", text[..span.start.min(text.len())].matches('\n').count() + 1),
                None => "recipe".into(),
            },
            found: e.message().to_owned(),
            expected: "a recipe such as `diopter develop --settings` describes".into(),
        })?;
        recipe.check()?;
        Ok(recipe)
    }

    /// The recipe as a file.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_else(|e| unreachable!("a recipe is plain data: {e}"))
    }

    /// With one setting changed: a name such as `tone.curve` and its value as text.
    pub fn with(&self, name: &str, value: &str) -> Result<Recipe, RecipeError> {
        let Some(setting) = SETTINGS.iter().find(|s| s.name == name) else {
            let known = SETTINGS.iter().map(|s| s.name);
            let near = diopter_light::names::nearest(name, known).map_or(String::new(), |n| format!(" (did you mean \"{n}\"?)"));
            return Err(RecipeError {
                place: name.to_owned(),
                found: "there is no such setting".into(),
                expected: format!("a name from `diopter develop --settings`{near}"),
            });
        };
        let wrong =
            || RecipeError { place: name.to_owned(), found: format!("\"{value}\""), expected: setting.allowed.to_string() };
        let parsed = match setting.allowed {
            Allowed::Text | Allowed::Names(_) => toml::Value::String(value.to_owned()),
            Allowed::Number(..) => toml::Value::Float(value.trim().parse().map_err(|_| wrong())?),
            Allowed::Bool => toml::Value::Boolean(match value.trim() {
                "true" | "yes" | "on" | "1" => true,
                "false" | "no" | "off" | "0" => false,
                _ => return Err(wrong()),
            }),
            Allowed::Numbers(n, ..) => {
                let numbers: Result<Vec<f64>, _> =
                    value.trim_matches(['[', ']', ' ']).split(',').map(|v| v.trim().parse()).collect();
                let numbers = numbers.map_err(|_| wrong())?;
                let numbers = if numbers.len() == 1 { vec![numbers[0]; n] } else { numbers };
                if numbers.len() != n {
                    return Err(wrong());
                }
                toml::Value::Array(numbers.into_iter().map(toml::Value::Float).collect())
            }
        };
        let (section, key) = name.split_once('.').unwrap_or((name, ""));
        let mut all = toml::Table::try_from(self).unwrap_or_else(|e| unreachable!("a recipe is plain data: {e}"));
        let whole = matches!(key, "width" | "height" | "long_edge");
        let parsed = match parsed {
            toml::Value::Float(v) if whole && v.fract() == 0.0 && v.abs() < 1e9 => toml::Value::Integer(v as i64),
            other => other,
        };
        if let Some(toml::Value::Table(table)) = all.get_mut(section) {
            table.insert(key.to_owned(), parsed);
        }
        let recipe: Recipe = all.try_into().map_err(|_| wrong())?;
        recipe.check()?;
        Ok(recipe)
    }

    /// The value of a setting as text; empty where it is not set.
    pub fn value(&self, name: &str) -> String {
        let all = toml::Table::try_from(self).unwrap_or_default();
        let (section, key) = name.split_once('.').unwrap_or((name, ""));
        match all.get(section).and_then(|t| t.get(key)) {
            None => String::new(),
            Some(toml::Value::String(text)) => text.clone(),
            Some(other) => other.to_string(),
        }
    }

    /// The same picture as light instead of codes: no curve, nothing graded, nothing clipped.
    pub fn linear_light(&self) -> Recipe {
        let tone = Tone { curve: Curve::Linear, ..Tone::default() };
        let output = Output { encoding: diopter_image::Encoding::Linear, ..self.output.clone() };
        Recipe { tone, output, grade: Grade::default(), lut: LutStep::default(), sharpen: Sharpen::default(), ..self.clone() }
    }

    /// Whether all numbers are in their ranges.
    pub fn check(&self) -> Result<(), RecipeError> {
        crate::steps::white_balance::check(&self.white)?;
        crate::light_field::check(&self.light_field)?;
        let all = toml::Table::try_from(self).unwrap_or_default();
        for setting in SETTINGS {
            let (section, key) = setting.name.split_once('.').unwrap_or((setting.name, ""));
            let Some(value) = all.get(section).and_then(|t| t.get(key)) else { continue };
            let within = |v: &toml::Value, low: f64, high: f64| {
                let v = v.as_float().or(v.as_integer().map(|i| i as f64));
                v.is_some_and(|v| (low..=high).contains(&v))
            };
            let fine = match setting.allowed {
                Allowed::Number(low, high) => within(value, low, high),
                Allowed::Numbers(n, low, high) => {
                    value.as_array().is_some_and(|a| a.len() == n && a.iter().all(|v| within(v, low, high)))
                }
                _ => true,
            };
            if !fine {
                return Err(RecipeError {
                    place: setting.name.to_owned(),
                    found: value.to_string(),
                    expected: setting.allowed.to_string(),
                });
            }
        }
        Ok(())
    }
}

impl std::fmt::Display for Allowed {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        match self {
            Allowed::Number(low, high) => write!(f, "{low} to {high}"),
            Allowed::Numbers(n, low, high) => write!(f, "{n} numbers, each {low} to {high}"),
            Allowed::Bool => write!(f, "true or false"),
            Allowed::Names(names) => write!(f, "one of {}", names.join(", ")),
            Allowed::Text => write!(f, "text"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_is_described_and_every_description_has_its_setting() {
        // Settings that are not set have no value in the file: give them one.
        let mut recipe = Recipe::default();
        recipe.white.patch = Some([0.0, 0.0, 0.1, 0.1]);
        recipe.tone.white = Some(4.0);
        recipe.light_field = LightField { aperture: Some(4.0), view: Some([0.0; 2]), ..Default::default() };
        recipe.resize = Resize { width: Some(10), height: Some(10), long_edge: Some(10) };
        let all = toml::Table::try_from(&recipe).unwrap();
        let mut names: Vec<String> = Vec::new();
        for (section, table) in &all {
            names.extend(table.as_table().unwrap().keys().map(|k| format!("{section}.{k}")));
        }
        names.sort();
        let mut described: Vec<&str> = SETTINGS.iter().map(|s| s.name).collect();
        described.sort();
        assert_eq!(names, described);
    }

    #[test]
    fn names_in_descriptions_are_those_that_are_read() {
        for setting in SETTINGS {
            if let Allowed::Names(names) = setting.allowed {
                for name in names {
                    let recipe = Recipe::default().with(setting.name, name).unwrap();
                    assert_eq!(recipe.value(setting.name), *name);
                }
            }
        }
    }

    #[test]
    fn wrong_values_say_what_was_expected() {
        let r = Recipe::default();
        for (name, value, part) in [
            ("tone.curve", "acess", "aces-fit"),
            ("tone.curv", "aces-fit", "did you mean \"tone.curve\""),
            ("exposure.ev", "11", "-10 to 10"),
            ("exposure.ev", "bright", "-10 to 10"),
            ("exposure.ev", "NaN", "-10 to 10"),
            ("grade.slope", "1,2", "3 numbers"),
            ("lens.distortion", "perhaps", "true or false"),
            ("resize.width", "0", "1 to 65535"),
            ("resize.width", "1.5", "1 to 65535"),
        ] {
            let e = r.with(name, value).unwrap_err().to_string();
            assert!(e.contains(part) && e.contains(name), "{e}");
        }
        let e = Recipe::from_toml("[tone]\n\ncurve = \"x\"\n").unwrap_err().to_string();
        assert!(e.starts_with("line 3"), "{e}");
    }

    #[test]
    fn presets_and_files_come_back() {
        for name in Recipe::PRESETS {
            let recipe = Recipe::preset(name).unwrap();
            assert_eq!(Recipe::from_toml(&recipe.to_toml()).unwrap(), recipe);
        }
        assert!(Recipe::preset("nice").is_err());
    }
}
