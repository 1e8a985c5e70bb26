//! `lut`: look-up tables.

use super::print_json;
use crate::UsageError;
use crate::args::LutVerb;
use crate::output::Output;
use crate::watch::{say, warn};
use anyhow::anyhow;
use diopter::develop::{Recipe, SETTINGS, bake};
use diopter::recipe_file;
use diopter::shot::ShotError;
use std::io::Write;
use std::path::Path;

/// Settings of a recipe that differ from the usual ones and are not in a table.
fn left_out(recipe: &Recipe) -> Vec<&'static str> {
    let default = Recipe::default();
    let is_held = |name: &str| name == "exposure.ev" || ["tone.", "grade.", "lut."].iter().any(|part| name.starts_with(part));
    let differs = |name: &&str| !is_held(name) && recipe.value(name) != default.value(name);
    SETTINGS.iter().map(|setting| setting.name).filter(differs).collect()
}

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(verb: &LutVerb, json: bool) -> anyhow::Result<()> {
    match verb {
        LutVerb::Info { file } => {
            let lut = recipe_file::read_lut(file)?;
            let ([curves, cube], domain) = (lut.sizes(), lut.domain());
            if json {
                return print_json(
                    &serde_json::json!({ "title": lut.title, "size_1d": curves, "size_3d": cube, "domain": domain }),
                );
            }
            let mut out = std::io::stdout();
            writeln!(out, "title   {}", if lut.title.is_empty() { "none" } else { &lut.title })?;
            for (name, size) in [("curves", curves), ("cube", cube)] {
                match size {
                    Some(n) => writeln!(out, "{name:<7} {n} points{}", if name == "cube" { " a side" } else { "" })?,
                    None => writeln!(out, "{name:<7} none")?,
                }
            }
            writeln!(out, "domain  {:?} to {:?}", domain[0], domain[1])?;
            Ok(())
        }
        LutVerb::Bake { developing, size, input, output } => {
            if output.extension().is_none_or(|e| !e.eq_ignore_ascii_case("cube")) {
                return Err(UsageError(anyhow!("{}: expected a name that ends in .cube", output.display())).into());
            }
            let mut recipe = Recipe::default();
            developing.apply(&mut recipe)?;
            let input = recipe.with("lut.input", input).map_err(ShotError::from)?.lut.input;
            let left_out = left_out(&recipe);
            if !left_out.is_empty() {
                warn(&format!(
                    "a table holds what changes each colour by itself, and gives sRGB: without effect are {}",
                    left_out.join(", ")
                ));
            }
            let read = [&developing.lut, &developing.recipe].into_iter().flatten().map(|p| p.as_path());
            crate::output::distinct(
                read.chain(std::iter::once(Path::new(&recipe.lut.file)).filter(|p| !p.as_os_str().is_empty())),
                [output.as_path()],
            )?;
            let to = Output::prepare(output)?;
            let baked = bake(&recipe, recipe_file::lut(&recipe)?, usize::from(*size), input);
            let path = to.commit(|w| Ok(w.write_all(baked.lut.to_cube().as_bytes())?))?;
            say(&format!("off the steps by ΔE2000 {:.3} in the mean, {:.2} at most (20 000 colours)", baked.mean, baked.worst));
            say(&format!("wrote {}", path.display()));
            if json {
                print_json(&serde_json::json!({ "file": path, "mean_delta_e": baked.mean, "worst_delta_e": baked.worst }))?;
            }
            Ok(())
        }
    }
}
