//! `develop`: a raw image into a picture.

use super::{open, print_json};
use crate::AskedWrongly;
use crate::args::Develop;
use crate::output::{self, Kind};
use crate::watch::say;
use anyhow::{Context, anyhow};
use diopter::develop::Recipe;
use diopter::image::dng::{self, Storage};

pub fn run(args: &Develop, json: bool) -> anyhow::Result<()> {
    let mut recipe = Recipe::default();
    args.developing.apply(&mut recipe)?;
    for path in &args.output {
        if output::kind(path)? == Kind::Dng {
            return Err(AskedWrongly(anyhow!("{}: a developed picture is .jpg, .png or .exr", path.display())).into());
        }
    }
    output::distinct([args.raw.as_path()], args.output.iter().map(|p| p.as_path()))?;
    let outputs = output::prepare_pictures(&args.output)?;
    let raw = dng::read(open(&args.raw)?).with_context(|| args.raw.display().to_string())?;
    let written = output::write_pictures(outputs, &raw, &recipe, Storage::Sixteen)?;
    for path in &written {
        say(&format!("wrote {}", path.display()));
    }
    if json {
        print_json(
            &serde_json::json!({ "files": written, "facts": raw.header.facts, "size": [raw.mosaic.width, raw.mosaic.height] }),
        )?;
    }
    Ok(())
}
