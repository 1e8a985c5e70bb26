//! Recipes and look-up tables from files.

use crate::files;
use crate::shot::error::ShotError;
use diopter_develop::lut::Lut;
use diopter_develop::{Recipe, RecipeError};
use std::path::Path;

/// Most bytes of a table that is read: the largest 3D table of the specification has some 600 MB as text.
const MOST_BYTES: u64 = 1 << 30;

fn told(path: &Path, reason: String) -> ShotError {
    ShotError::Read { path: path.display().to_string(), reason }
}

/// Reads a recipe; the path of its table is relative to it. Fails where it cannot be read, and on settings that are not known or out of range.
pub fn read(path: &Path) -> Result<Recipe, ShotError> {
    let text = files::read_text(path).map_err(|e| told(path, e.to_string()))?;
    let mut recipe = Recipe::from_toml(&text).map_err(|e| told(path, e.to_string()))?;
    place_lut(&mut recipe, path.parent().unwrap_or(Path::new("")));
    Ok(recipe)
}

/// Makes the path of a recipe's table relative to a folder.
pub fn place_lut(recipe: &mut Recipe, folder: &Path) {
    let file = Path::new(&recipe.lut.file);
    if !recipe.lut.file.is_empty() && file.is_relative() {
        recipe.lut.file = folder.join(file).display().to_string();
    }
}

/// The table that a recipe names, if it names one. Fails as [`read_lut`].
pub fn lut(recipe: &Recipe) -> Result<Option<Lut>, ShotError> {
    (!recipe.lut.file.is_empty()).then(|| read_lut(Path::new(&recipe.lut.file))).transpose()
}

/// Reads a `.cube` file. Fails where it cannot be read, on more than 1 GiB, and on what is no table.
pub fn read_lut(path: &Path) -> Result<Lut, ShotError> {
    // Streams have no size, and a bound of their own.
    let size = std::fs::metadata(path).map_or(0, |m| m.len());
    if size > MOST_BYTES {
        return Err(told(path, format!("{size} bytes: no .cube file is larger than {MOST_BYTES}")));
    }
    let bytes = files::read(path).map_err(|e| told(path, e.to_string()))?;
    Lut::parse(&String::from_utf8_lossy(&bytes)).map_err(|e| told(path, e.to_string()))
}

impl From<RecipeError> for ShotError {
    fn from(e: RecipeError) -> Self {
        ShotError::Recipe(e)
    }
}
