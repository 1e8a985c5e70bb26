//! `stack`: a focus series into one picture that is sharp all over.

use super::{count_of_pictures, named_once, print_json, read_raw};
use crate::args::Stack;
use crate::output::{self, Kind, Output};
use crate::watch::{say, warn};
use crate::{UsageError, effect};
use anyhow::anyhow;
use diopter::develop::lut::Lut;
use diopter::develop::stack::{StackError, stack};
use diopter::develop::{Recipe, develop};
use diopter::image::{Picture, RawImage};
use diopter::metering::ev100_of_facts;
use diopter::shot::ShotError;
use std::path::PathBuf;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &Stack, json: bool) -> anyhow::Result<()> {
    output::distinct(args.raw.iter().map(|p| p.as_path()), args.output.iter().map(|p| p.as_path()))?;
    named_once(&args.raw)?;
    let outputs = prepare(&args.output)?;
    let kinds: Vec<Kind> = outputs.iter().map(|o| o.0).collect();
    effect::check(args.developing.typed(), &kinds)?;
    let mut recipe = Recipe::default();
    args.developing.apply(&mut recipe)?;
    let lut = diopter::recipe_file::lut(&recipe)?;
    let raws: Vec<RawImage> = args.raw.iter().map(|p| read_raw(p)).collect::<anyhow::Result<_>>()?;
    warn_of_exposures(&raws);
    let written = write(outputs, &raws, &[], &recipe, lut.as_ref())?;
    say(&count_of_pictures(raws.len()));
    written.iter().for_each(|p| say(&format!("wrote {}", p.display())));
    if json {
        print_json(&serde_json::json!({ "files": written, "pictures": raws.len() }))?;
    }
    Ok(())
}

/// Says where pictures of a series are differently bright: parts of the result would be.
fn warn_of_exposures(raws: &[RawImage]) {
    /// EV: lenses that breathe differ by less.
    const SAME: f64 = 0.5;
    let ev: Vec<f64> = raws.iter().map(|raw| ev100_of_facts(&raw.header.facts)).filter(|ev| ev.is_finite()).collect();
    let (least, most) = ev.iter().fold((f64::MAX, f64::MIN), |(a, b), ev| (a.min(*ev), b.max(*ev)));
    if most - least > SAME {
        warn(&format!(
            "the pictures are exposed up to {:.1} EV apart: what is taken of each is as bright as it is there; expected one exposure for all (mode M)",
            most - least
        ));
    }
}

/// Checks names and folders of stacked pictures. Fails on a DNG, on other endings, and where one cannot be written.
pub fn prepare(paths: &[PathBuf]) -> anyhow::Result<Vec<(Kind, Output)>> {
    if let Some(path) = paths.iter().find(|p| matches!(output::kind(p), Ok(Kind::Dng))) {
        return Err(UsageError(anyhow!("{}: a stacked picture is .jpg, .png, .tif or .exr", path.display())).into());
    }
    output::prepare_pictures(paths)
}

/// Develops a series, stacks and writes it; pictures to look at from `clean`, where there are any, the same without the renderer's noise.
pub fn write(
    outputs: Vec<(Kind, Output)>,
    raws: &[RawImage],
    clean: &[RawImage],
    recipe: &Recipe,
    lut: Option<&Lut>,
) -> anyhow::Result<Vec<PathBuf>> {
    // Film distance behind the lens: focal length and what the film is moved back.
    let any = if raws.is_empty() { clean } else { raws };
    if any.len() < 2 {
        return Err(UsageError(StackError::TooFew.into()).into());
    }
    let drawn = |r: &RawImage| {
        let f = &r.header.facts;
        let extension = match f.extension_mm {
            0.0 => f
                .focus_distance_m
                .filter(|s| *s > 0.0)
                .map_or(0.0, |s| f.focal_length_mm.powi(2) / (1000.0 * s - f.focal_length_mm)),
            e => e,
        };
        f.focal_length_mm + extension
    };
    // A real lens's own trace says how large it draws, also where groups move inside.
    let traced = |r: &RawImage| r.header.facts.lens_profile.as_ref().map(|p| f64::from(p.scale)).filter(|s| *s > 0.0);
    let relative = |r: &RawImage| match (traced(r), traced(&any[0])) {
        (Some(a), Some(b)) => a / b,
        _ => drawn(r) / drawn(&any[0]),
    };
    let scales: Vec<f64> = any.iter().map(relative).collect();
    let mut written = Vec::new();
    for (kind, output) in outputs {
        let raws = if kind.is_looked_at() && !clean.is_empty() { clean } else { any };
        let light = recipe.linear_light();
        let (recipe, lut) = if kind == Kind::Exr { (&light, None) } else { (recipe, lut.cloned()) };
        let pictures: Vec<Picture> =
            raws.iter().map(|r| develop(r, recipe, lut.clone())).collect::<Result<_, _>>().map_err(ShotError::from)?;
        let picture = stack(&pictures, &scales).map_err(|e| UsageError(e.into()))?;
        written.push(output::write_picture(kind, output, &picture)?);
    }
    Ok(written)
}
