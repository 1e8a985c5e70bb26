//! `denoise`: the renderer's own noise taken out of a focal plane.

use super::{print_json, read_plane};
use crate::output;
use crate::watch::{say, warn};
use diopter::develop::denoise;
use std::path::Path;

pub fn run(input: &Path, output: &Path, json: bool) -> anyhow::Result<()> {
    output::distinct([input], [output])?;
    let to = output::prepare_exr(output)?;
    let plane = read_plane(input)?;
    if plane.facts.denoised {
        warn("this exposure has been denoised before");
    }
    let path = output::write_plane(to, &denoise(&plane))?;
    say(&format!("wrote {}", path.display()));
    if json {
        print_json(&serde_json::json!({ "files": [path], "size": [plane.width(), plane.height()] }))?;
    }
    Ok(())
}
