//! A development as a whole: its sections, each declared with its step, as a file and by names.

pub use crate::light_field::settings::LightField;
pub use crate::lut::{Interpolation, LutInput, LutStep};
pub use crate::setting::{Allowed, RecipeError, Setting};
pub use crate::steps::defects::Defects;
pub use crate::steps::demosaic::{Demosaic, DemosaicStep};
pub use crate::steps::encode::{Output, Space};
pub use crate::steps::exposure::Exposure;
pub use crate::steps::grade::Grade;
pub use crate::steps::highlights::{HighlightMethod, Highlights};
pub use crate::steps::lens::Lens;
pub use crate::steps::local::Local;
pub use crate::steps::noise::Noise;
pub use crate::steps::resize::Resize;
pub use crate::steps::row_noise::RowNoise;
pub use crate::steps::sharpen::Sharpen;
pub use crate::steps::tone::{Curve, Tone};
pub use crate::steps::white_balance::White;
use diopter_light::names::in_words;
use serde::{Deserialize, Serialize};
use std::sync::LazyLock;

macro_rules! recipe {
    ($(#[$about:meta])* { $($(#[$doc:meta])* $field:ident: $type:ty,)* }) => {
        $(#[$about])*
        #[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
        #[serde(default, deny_unknown_fields)]
        pub struct Recipe { $($(#[$doc])* pub $field: $type,)* }

        const SECTIONS: &[&[Setting]] = &[$(<$type>::SETTINGS,)*];
    };
}

recipe! {
    /// What is done to a raw image, step by step. Every field has a default; the defaults make a picture fit to be looked at.
    {
        /// Offsets of rows.
        row_noise: RowNoise,
        /// Pixels that are broken.
        defects: Defects,
        /// What is brighter than the sensor can tell.
        highlights: Highlights,
        /// What is white.
        white: White,
        /// What is made of a light field.
        light_field: LightField,
        /// How missing colours are filled in.
        demosaic: DemosaicStep,
        /// Less noise.
        noise: Noise,
        /// What the lens did, undone.
        lens: Lens,
        /// Brightness.
        exposure: Exposure,
        /// Contrast of large areas.
        local: Local,
        /// Tone curve.
        tone: Tone,
        /// Grading.
        grade: Grade,
        /// A look from a file.
        lut: LutStep,
        /// Sharpening.
        sharpen: Sharpen,
        /// Size of the picture.
        resize: Resize,
        /// What the numbers of the picture mean.
        output: Output,
    }
}

/// All settings, in the order of the steps.
pub static SETTINGS: LazyLock<Vec<Setting>> = LazyLock::new(|| SECTIONS.concat());

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
            found: in_words(e.message()),
            expected: "a recipe such as `diopter develop --settings` describes".into(),
        })?;
        recipe.check()?;
        Ok(recipe)
    }

    /// The recipe as a file.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_else(|e| unreachable!("a recipe is plain data: {e}"))
    }

    /// With one setting changed: a name such as `tone.curve` and its value as text. Fails on an unknown name, with the nearest
    /// one, on a value that the setting cannot have, and as [`Recipe::check`].
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

    /// Settings that change nothing beside others, each with the reason, for who typed them.
    pub fn without_effect(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if let (Some(white), false) = (self.tone.white, self.tone.curve.chooses_white()) {
            let curve = self.value("tone.curve");
            notes.push(format!(
                "tone.white = {white} changes nothing: {curve} has a white of its own; reinhard-extended and hable let one choose"
            ));
        }
        if let Some(edge) = self.resize.long_edge {
            let beside = [("width", self.resize.width), ("height", self.resize.height)];
            for (name, length) in beside.into_iter().filter_map(|(name, length)| Some((name, length?))) {
                notes.push(format!("resize.{name} = {length} changes nothing beside resize.long_edge = {edge}"));
            }
        }
        notes
    }

    /// Fails on a setting that is out of its range, on a white balance of no known name, and on a focus or view of a light field
    /// that cannot be.
    pub fn check(&self) -> Result<(), RecipeError> {
        crate::steps::white_balance::check(&self.white)?;
        crate::light_field::check(&self.light_field)?;
        let all = toml::Table::try_from(self).unwrap_or_default();
        for setting in SETTINGS.iter() {
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
        for setting in SETTINGS.iter() {
            if let Allowed::Names(names) = setting.allowed {
                for name in names {
                    let recipe = Recipe::default().with(setting.name, name).unwrap();
                    assert_eq!(recipe.value(setting.name), *name);
                }
            }
        }
    }

    #[test]
    fn settings_without_effect_are_told() {
        let told = |settings: &[(&str, &str)]| {
            let recipe = settings.iter().fold(Recipe::default(), |recipe, (name, value)| recipe.with(name, value).unwrap());
            recipe.without_effect().join("\n")
        };
        assert!(told(&[("tone.white", "4")]).starts_with("tone.white = 4 changes nothing: aces-fit has"));
        assert_eq!(told(&[("tone.white", "4"), ("tone.curve", "hable"), ("resize.width", "10")]), "");
        let both = told(&[("resize.height", "10"), ("resize.long_edge", "20")]);
        assert_eq!(both, "resize.height = 10 changes nothing beside resize.long_edge = 20");
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
