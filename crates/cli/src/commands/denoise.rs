//! `denoise`: the renderer's own noise taken out of a focal plane.

use super::{PlaneFile, print_json};
use crate::output;
use crate::watch::{say, warn};
use anyhow::Context;
use diopter::develop::denoise::{self, Denoised};
use diopter::image::focal_plane::FocalPlaneSource;
use std::path::Path;

pub fn run(input: &Path, output: &Path, json: bool) -> anyhow::Result<()> {
    output::distinct([input], [output])?;
    let to = output::prepare_exr(output)?;
    let source = PlaneFile::open(input)?;
    if source.facts().denoised {
        warn("this exposure has been denoised before");
    }
    let size = source.size();
    // What is done strip by strip asks for the farthest depth of the whole first.
    let farthest = match denoise::rows_at_once(size[0], source.bands().len()) < size[1] {
        true => denoise::farthest_log_depth(&mut PlaneFile::open(input)?).with_context(|| input.display().to_string())?,
        false => None,
    };
    let path = output::write_strips(to, &mut Denoised::new(source, farthest))?;
    say(&format!("wrote {}", path.display()));
    if json {
        print_json(&serde_json::json!({ "files": [path], "size": size }))?;
    }
    Ok(())
}
