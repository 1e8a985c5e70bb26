//! `merge`: parts of an exposure into the whole.

use super::{print_json, read_plane};
use crate::args::Merge;
use crate::output;
use crate::watch::say;
use diopter::image::FocalPlane;

pub fn run(args: &Merge, json: bool) -> anyhow::Result<()> {
    output::distinct(args.parts.iter().map(|p| p.as_path()), [args.output.as_path()])?;
    let output = output::prepare_exr(&args.output)?;
    let parts = args.parts.iter().map(|p| read_plane(p)).collect::<anyhow::Result<Vec<_>>>()?;
    let whole = FocalPlane::merge(&parts).map_err(|e| crate::AskedWrongly(e.into()))?;
    let path = output::write_plane(output, &whole)?;
    let end = whole.facts.first_sample + whole.facts.samples;
    say(&format!("{} parts, {} samples a pixel\nwrote {}", parts.len(), whole.facts.samples, path.display()));
    if json {
        print_json(&serde_json::json!({ "files": [path], "facts": whole.facts, "samples": [whole.facts.first_sample, end] }))?;
    }
    Ok(())
}
