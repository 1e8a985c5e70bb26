//! `lut`: look-up tables.

use super::print_json;
use crate::UsageError;
use crate::args::LutVerb;
use crate::output::Output;
use crate::watch::{say, warn};
use anyhow::anyhow;
use diopter::develop::{Recipe, bake};
use diopter::recipe_file;
use diopter::shot::ShotError;
use std::io::Write;
use std::path::Path;

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
            if recipe.local.compression != 0.0 || recipe.local.detail != 1.0 || recipe.sharpen.amount != 0.0 {
                warn("a table holds what changes each colour by itself: local contrast and sharpening are left out");
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
