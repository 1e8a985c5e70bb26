//! `denoise`: the renderer's own noise taken out of a focal plane.

use super::{PlaneFile, print_json};
use crate::UsageError;
use crate::output;
use crate::watch::{say, warn};
use anyhow::{Context, anyhow};
use diopter::denoising::{BUILT_IN, Denoise, Filter};
use diopter::develop::denoise::{self, Denoised};
use diopter::image::focal_plane::FocalPlaneSource;
use std::path::Path;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(input: &Path, output: &Path, by: Denoise, oidn: Option<&Path>, json: bool) -> anyhow::Result<()> {
    output::distinct([input], [output])?;
    let to = output::prepare_exr(output)?;
    let mut source = PlaneFile::open(input)?;
    if source.facts().denoised {
        warn("this exposure has been denoised before");
    }
    let Some(filter) = Filter::open(by, oidn, &mut warn)? else {
        return Err(UsageError(anyhow!("--by {by}: expected on, oidn or builtin")).into());
    };
    let size = source.size();
    let by_strips = denoise::rows_at_once(size[0], source.bands().len(), source.recorded().more_bytes()) < size[1];
    let (path, name) = match filter {
        // A network sees the whole picture; the library is asked for it by name where that takes much memory.
        filter @ Filter::Oidn(_) if !by_strips || by == Denoise::Oidn => {
            let plane = source.next_rows(size[1]).with_context(|| input.display().to_string())?;
            let denoised = filter.denoise(&plane, None)?;
            drop(plane);
            (output::write_plane(to, &denoised)?, filter.name())
        }
        _ => {
            // What is done strip by strip asks for the farthest depth of the whole first.
            let farthest = match by_strips {
                true => denoise::farthest_log_depth(&mut PlaneFile::open(input)?).with_context(|| input.display().to_string())?,
                false => None,
            };
            (output::write_strips(to, &mut Denoised::new(source, farthest).named(BUILT_IN))?, BUILT_IN.into())
        }
    };
    say(&format!("wrote {} ({name})", path.display()));
    if json {
        print_json(&serde_json::json!({ "files": [path], "size": size, "denoiser": name }))?;
    }
    Ok(())
}
