//! `develop`: a raw image into a picture.

use super::{open, print_json};
use crate::args::Develop;
use crate::output;
use crate::watch::say;
use anyhow::Context;
use diopter::develop::Recipe;
use diopter::image::dng::{self, Storage};

pub fn run(args: &Develop, json: bool) -> anyhow::Result<()> {
    let mut recipe = Recipe::default();
    args.developing.apply(&mut recipe)?;
    let outputs = output::prepare_pictures(&args.output)?;
    let raw = dng::read(open(&args.raw)?).with_context(|| args.raw.display().to_string())?;
    let written = output::write_pictures(outputs, &raw, &recipe, Storage::Sixteen)?;
    for path in &written {
        say(&format!("wrote {}", path.display()));
    }
    if json {
        print_json(&serde_json::json!({ "files": written, "facts": raw.header.facts, "size": [raw.mosaic.width, raw.mosaic.height] }))?;
    }
    Ok(())
}
