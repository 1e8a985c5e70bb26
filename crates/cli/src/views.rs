//! What a light field holds besides a picture: its views, and depth.

use crate::output::{self, Kind, Output};
use anyhow::{Context, anyhow};
use diopter::develop::light_field::DepthMap;
use diopter::develop::lut::Lut;
use diopter::develop::{Developer, Recipe, RecipeError};
use diopter::image::{Encoding, Picture, PictureSource, Raster, RawImage, exr, png};
use diopter::light::color::RgbSpace;
use diopter::shot::ShotError;
use std::path::{Path, PathBuf};

/// A recipe that makes a picture of a light field, whatever was asked.
fn of_light_field(recipe: &Recipe) -> Recipe {
    let mut recipe = recipe.clone();
    if recipe.light_field.focus.is_empty() {
        recipe.light_field.focus = "as-taken".into();
    }
    recipe
}

/// Writes `view-ROW-COLUMN.png` of a grid over the pupil into a folder.
pub fn write_views(raw: &RawImage, recipe: &Recipe, lut: Option<&Lut>, folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut recipe = of_light_field(recipe);
    let [has_aperture, has_view] = [recipe.light_field.aperture.is_some(), recipe.light_field.view.is_some()];
    if has_aperture || has_view {
        let what = if has_aperture { "light_field.aperture" } else { "light_field.view" };
        return Err(
            crate::UsageError(anyhow!("{what} beside --views: expected one of the two: views are all over the pupil")).into()
        );
    }
    let field = |r: &Recipe| Developer::new(raw, r, None).map(|d| d.light_field().map_or(1, |f| f.views_across()));
    let across = field(&recipe).map_err(ShotError::from)?;
    std::fs::create_dir_all(folder).with_context(|| format!("{}: this folder cannot be made", folder.display()))?;
    let at = |i: usize| (2.0 * i as f64 + 1.0) / across as f64 - 1.0;
    let mut written = Vec::new();
    for (row, column) in (0..across * across).map(|i| (i / across, i % across)) {
        let place = [at(column), at(row)];
        if place[0].hypot(place[1]) > 1.0 - 0.5 / across as f64 {
            continue;
        }
        recipe.light_field.view = Some(place);
        let output = Output::prepare(&folder.join(format!("view-{row:02}-{column:02}.png")))?;
        let view = Developer::new(raw, &recipe, lut.cloned()).map_err(ShotError::from)?;
        written.push(output.commit(|to| Ok(png::write(&view, png::Depth::Eight, to)?))?);
    }
    Ok(written)
}

/// Refuses names that depth cannot be written to.
pub fn check_depth(path: &Path) -> anyhow::Result<()> {
    match output::kind(path)? {
        Kind::Exr | Kind::Png => Ok(()),
        _ => {
            Err(crate::UsageError(anyhow!("{}: depth is written as .exr (metres) or .png (near is light)", path.display()))
                .into())
        }
    }
}

/// Writes depth: an EXR with `Z` (m) and `confidence`, or a PNG of nearness. Fails on other names, on what is no light field, and where the file cannot be written.
pub fn write_depth(raw: &RawImage, recipe: &Recipe, path: &Path) -> anyhow::Result<PathBuf> {
    check_depth(path)?;
    let output = Output::prepare(path)?;
    let recipe = of_light_field(recipe);
    let developer = Developer::new(raw, &recipe, None).map_err(ShotError::from)?;
    let none =
        || RecipeError { place: "depth".into(), found: "no light field".into(), expected: "a plenoptic camera's file".into() };
    let map = developer.depth().ok_or_else(|| ShotError::from(none()))?;
    let size = [map.depth_m.width, map.depth_m.height];
    output.commit(|to| {
        match output::kind(path)? {
            Kind::Exr => {
                let planes = vec![("Z", map.depth_m.data.clone()), ("confidence", map.confidence.data.clone())];
                let facts = developer.facts().cloned().unwrap_or_default();
                exr::write_planes(size, planes, vec![], &facts, to)?;
            }
            _ => png::write(&nearness(&map), png::Depth::Sixteen, to)?,
        }
        Ok(())
    })
}

/// Reciprocal depth from black (the farthest) to white (the nearest), without the outermost percent.
fn nearness(map: &DepthMap) -> Picture {
    let near: Vec<f32> = map.depth_m.data.iter().map(|d| 1.0 / d).collect();
    let mut sorted = near.clone();
    sorted.sort_by(f32::total_cmp);
    let (low, high) = (sorted[sorted.len() / 100], sorted[sorted.len() - 1 - sorted.len() / 100]);
    let grey = |v: &f32| [((v - low) / (high - low).max(1e-9)).clamp(0.0, 1.0); 3];
    let data = near.iter().flat_map(grey).collect();
    let pixels = Raster { width: map.depth_m.width, height: map.depth_m.height, channels: 3, data };
    Picture { pixels, space: RgbSpace::Srgb, encoding: Encoding::Srgb, facts: None }
}
