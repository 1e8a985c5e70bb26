//! Contact sheets: one shot with a setting varied along one or two axes.
//!
//! [`SheetFile`] is what was written (TOML); [`SheetFile::cells`] lists the shots it stands for. Who paints them says how they look.

use crate::files;
use crate::lesson::words;
use crate::shot::{ShotError, ShotFile, value};
use diopter_light::names::in_words;
use serde::Deserialize;
use std::path::Path;
use std::str::FromStr;

/// Most pictures of a sheet.
pub const MOST_CELLS: usize = 400;
/// Most axes.
const MOST_AXES: usize = 2;

/// What a sheet file says.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SheetFile {
    /// Above the pictures.
    pub title: Option<String>,
    /// Lines of text under the title.
    pub text: Vec<String>,
    /// Pictures beside each other, of one axis; as many as fit without.
    pub columns: Option<usize>,
    /// Longer side of the pictures on the sheet, px; larger ones are reduced. 480 without.
    pub cell: Option<usize>,
    /// Shows a part of each picture at 100 % below it: its middle, 0 to 1 across and down the picture.
    pub crop: Option<[f64; 2]>,
    /// Shows the histogram of each picture below it.
    pub histogram: bool,
    /// What is varied: the first across, the second down.
    pub vary: Vec<Axis>,
    /// Tables under the pictures.
    pub table: Vec<Table>,
    /// The shot.
    pub shot: ShotFile,
}

/// A setting that is varied, or several that change together.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Axis {
    /// Name of the setting, as [`ShotFile::with`] knows it, or a list of names.
    pub name: Names,
    /// Its values; of several settings, lists with a value of each.
    pub values: Vec<toml::Value>,
    /// What the captions say instead of the values.
    pub labels: Vec<String>,
}

/// What a command of the program prints: "calc depth-of-field --focal-length 50mm".
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Table {
    /// Above the table; without, the command.
    pub caption: Option<String>,
    /// The command, as it is typed after `diopter`; one of `calc`, which writes no file.
    pub command: String,
}

/// One name or several.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Names {
    /// One setting.
    One(String),
    /// Settings that change together.
    Several(Vec<String>),
}

impl Default for Names {
    fn default() -> Self {
        Names::Several(Vec::new())
    }
}

impl Names {
    pub(crate) fn list(&self) -> &[String] {
        match self {
            Names::One(name) => std::slice::from_ref(name),
            Names::Several(names) => names,
        }
    }
}

/// A picture of a sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct Cell {
    /// What changed: "iso 400".
    pub label: String,
    /// The shot.
    pub shot: ShotFile,
}

/// What is beside each other on a sheet: cells in rows, and how many are in each.
#[derive(Clone, Debug, PartialEq)]
pub struct Cells {
    /// Row by row.
    pub cells: Vec<Cell>,
    /// Of two axes, as many as the first has values; `None` leaves it to who paints.
    pub columns: Option<usize>,
}

/// A value as it is typed.
pub(crate) fn text_of(value: &toml::Value) -> String {
    match value {
        toml::Value::String(text) => text.clone(),
        toml::Value::Array(list) => list.iter().map(text_of).collect::<Vec<_>>().join(","),
        other => other.to_string(),
    }
}

impl Axis {
    /// Values of each of the settings, one list a step.
    fn steps(&self) -> Result<Vec<Vec<String>>, ShotError> {
        let names = self.name.list();
        let shown = || names.join(":");
        if names.is_empty() || names.iter().any(|n| n.trim().is_empty()) {
            return Err(value("vary", "no name", "the name of a setting, such as iso"));
        }
        if self.values.is_empty() {
            return Err(value("vary", format!("\"{}\" without values", shown()), "values, such as iso=100,200,400"));
        }
        if !self.labels.is_empty() && self.labels.len() != self.values.len() {
            let found = format!("{} labels of \"{}\"", self.labels.len(), shown());
            return Err(value("vary", found, format!("as many as values, {}", self.values.len())));
        }
        let step = |v: &toml::Value| {
            if names.len() == 1 {
                return Ok(vec![text_of(v)]);
            }
            match v.as_array() {
                Some(list) if list.len() == names.len() => Ok(list.iter().map(text_of).collect()),
                _ => {
                    let found = format!("\"{}\" for \"{}\"", text_of(v), shown());
                    Err(value("vary", found, format!("a value of each of the {} settings", names.len())))
                }
            }
        };
        self.values.iter().map(step).collect()
    }

    /// The shot at a step.
    fn at(&self, shot: &ShotFile, step: &[String]) -> Result<ShotFile, ShotError> {
        self.name.list().iter().zip(step).try_fold(shot.clone(), |shot, (name, text)| shot.with(name, text))
    }

    fn label(&self, k: usize, step: &[String]) -> String {
        let told = || self.name.list().iter().zip(step).map(|(n, v)| format!("{n} {v}")).collect::<Vec<_>>().join(", ");
        self.labels.get(k).cloned().unwrap_or_else(told)
    }
}

impl FromStr for Axis {
    type Err = String;

    /// "iso=100,200", or "aperture:shutter=f/2:1/60,f/4:1/15" of settings that change together; semicolons between values that have commas.
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("\"{text}\" is not a setting with its values, such as iso=100,200,400");
        let (names, values) = text.split_once('=').ok_or_else(wrong)?;
        let names: Vec<String> = names.split(':').map(|n| n.trim().to_owned()).collect();
        let separator = if values.contains(';') { ';' } else { ',' };
        // A semicolon at the end makes one value of what has commas.
        let values: Vec<&str> = values.trim().trim_end_matches(';').split(separator).map(str::trim).collect();
        if names.iter().any(String::is_empty) || values.iter().any(|v| v.is_empty()) {
            return Err(wrong());
        }
        let text = |v: &str| toml::Value::String(v.trim().to_owned());
        let value = |v: &&str| match names.len() {
            1 => text(v),
            _ => toml::Value::Array(v.split(':').map(text).collect()),
        };
        let values = values.iter().map(value).collect();
        let name = if names.len() == 1 { Names::One(names[0].clone()) } else { Names::Several(names) };
        Ok(Axis { name, values, labels: Vec::new() })
    }
}

impl SheetFile {
    /// Reads a sheet file. Paths in it stay as they are written: [`SheetFile::cells`] takes the folder. Fails where the file cannot be read, and on entries that are not
    /// known or of another kind.
    pub fn read(path: &Path) -> Result<SheetFile, ShotError> {
        let place = path.display().to_string();
        let text = files::read_text(path).map_err(|e| ShotError::Read { path: place.clone(), reason: e.to_string() })?;
        toml::from_str(&text).map_err(|e| ShotError::Syntax { path: place, reason: in_words(&e.to_string()) })
    }

    /// Fails where a table is not one of `calc`, or would write a file.
    fn check_tables(&self) -> Result<(), ShotError> {
        for table in &self.table {
            let words = words(&table.command);
            let writes = |w: &String| w == "-o" || w.starts_with("--output") || (w.starts_with("-o") && !w.starts_with("--"));
            if words.first().is_none_or(|w| w != "calc") || words.iter().any(writes) {
                let expected = "what `calc` prints, without -o, such as \"calc stop --focal-length 50mm\"";
                return Err(value("table", format!("\"{}\"", table.command), expected));
            }
        }
        Ok(())
    }

    /// The shots of the sheet; their paths are relative to `folder`, where there is one. Fails on settings that are not known or named twice, on values out of range, on
    /// more than two axes, and on a table that is none of `calc`.
    pub fn cells(&self, folder: Option<&Path>) -> Result<Cells, ShotError> {
        if !(1..=MOST_AXES).contains(&self.vary.len()) {
            return Err(value("vary", format!("{} settings", self.vary.len()), "one or two, such as iso=100,200,400"));
        }
        if self.columns == Some(0) {
            return Err(value("columns", 0, "1 or more"));
        }
        if self.cell.is_some_and(|c| !(16..=4096).contains(&c)) {
            return Err(value("cell", self.cell.unwrap_or(0), "16 to 4096 px"));
        }
        if let Some(crop) = self.crop.filter(|c| !c.iter().all(|v| (0.0..=1.0).contains(v))) {
            return Err(value(
                "crop",
                format!("{},{}", crop[0], crop[1]),
                "two numbers from 0 to 1, across and down the picture",
            ));
        }
        self.check_tables()?;
        let names: Vec<&String> = self.vary.iter().flat_map(|a| a.name.list()).collect();
        if let Some(twice) = names.iter().enumerate().find(|(k, n)| names[..*k].contains(n)) {
            return Err(value("vary", format!("\"{}\" twice", twice.1), "different settings"));
        }
        let across = self.vary[0].steps()?;
        let down = self.vary.get(1).map(Axis::steps).transpose()?.unwrap_or_else(|| vec![Vec::new()]);
        if across.len() * down.len() > MOST_CELLS {
            return Err(value("vary", format!("{} pictures", across.len() * down.len()), format!("at most {MOST_CELLS}")));
        }
        let mut cells = Vec::new();
        for (j, below) in down.iter().enumerate() {
            for (i, step) in across.iter().enumerate() {
                let mut shot = self.vary[0].at(&self.shot, step)?;
                let mut label = self.vary[0].label(i, step);
                if let Some(axis) = self.vary.get(1) {
                    shot = axis.at(&shot, below)?;
                    label = format!("{label}, {}", axis.label(j, below));
                }
                if let Some(folder) = folder {
                    shot.place_paths(folder);
                }
                cells.push(Cell { label, shot });
            }
        }
        let columns = if self.vary.len() > 1 { Some(across.len()) } else { self.columns };
        Ok(Cells { cells, columns })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::quantity::{FNumber, IsoChoice, Seconds};

    #[test]
    fn two_axes_make_rows_and_columns() {
        let text = "title = \"t\"\n[[vary]]\nname = \"iso\"\nvalues = [100, \"ISO 400\", 1600]\n\
                    [[vary]]\nname = \"aperture\"\nvalues = [\"f/2\", 4]\nlabels = [\"wide\", \"narrow\"]\n[shot.exposure]\nshutter = \"1/60\"\n";
        let sheet: SheetFile = toml::from_str(text).unwrap();
        let Cells { cells, columns } = sheet.cells(None).unwrap();
        assert_eq!((cells.len(), columns), (6, Some(3)));
        assert_eq!((cells[0].label.as_str(), cells[5].label.as_str()), ("iso 100, wide", "iso 1600, narrow"));
        let e = &cells[4].shot.exposure;
        assert_eq!(
            (e.iso.and_then(IsoChoice::fixed), e.aperture, e.shutter),
            (Some(400.0), Some(FNumber(4.0)), Some(Seconds(1.0 / 60.0)))
        );
    }

    #[test]
    fn axes_are_read_from_one_line() {
        let axis: Axis = "aperture:shutter=f/2:1/60, f/4:1/15".parse().unwrap();
        let sheet = SheetFile { vary: vec![axis], ..Default::default() };
        let cells = sheet.cells(None).unwrap().cells;
        let e = &cells[1].shot.exposure;
        assert_eq!((e.aperture, e.shutter), (Some(FNumber(4.0)), Some(Seconds(1.0 / 15.0))));
        assert_eq!(cells[1].label, "aperture f/4, shutter 1/15");
        // Values with commas.
        let sheet = SheetFile { vary: vec!["look-from=0,1,2;0,1,3".parse().unwrap()], ..Default::default() };
        assert_eq!(sheet.cells(None).unwrap().cells[1].shot.camera.look_from, Some([0.0, 1.0, 3.0]));
        let one: Axis = "focus=at 0.4,0.6;".parse().unwrap();
        assert_eq!(one.values, [toml::Value::String("at 0.4,0.6".into())]);
        for wrong in ["iso", "iso=", "=1,2", "iso=1,,2"] {
            assert!(wrong.parse::<Axis>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn what_makes_no_sheet_is_told() {
        let told = |axes: &[&str]| {
            let vary = axes.iter().map(|a| a.parse().unwrap()).collect();
            SheetFile { vary, ..Default::default() }.cells(None).unwrap_err().to_string()
        };
        assert!(told(&[]).contains("one or two"));
        assert!(told(&["iso=1,2", "iso=3"]).contains("twice"));
        assert!(told(&["aperture:shutter=f/2:1/60,f/4"]).contains("each of the 2"));
        let many = format!("seed={}", (0..500).map(|k| k.to_string()).collect::<Vec<_>>().join(","));
        assert!(told(&[&many]).contains("at most 400"));
        assert!(told(&["isso=100"]).contains("did you mean \"iso\""));
    }

    #[test]
    fn paths_are_relative_to_the_sheet() {
        let mut sheet = SheetFile { vary: vec!["lens=thin,a.zmx".parse().unwrap()], ..Default::default() };
        sheet.shot.scene.file = Some("room.glb".into());
        let cells = sheet.cells(Some(Path::new("to"))).unwrap().cells;
        assert_eq!(cells[0].shot.camera.lens.as_deref(), Some("thin"));
        assert_eq!(cells[1].shot.camera.lens.as_deref(), Some(&*Path::new("to").join("a.zmx").display().to_string()));
        assert_eq!(cells[0].shot.scene.file.as_deref(), Some(&*Path::new("to").join("room.glb").display().to_string()));
    }
}
