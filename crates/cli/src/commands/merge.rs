//! `merge`: parts of an exposure into the whole, or an exposure series into one picture of more range.

use super::{PlaneFile, count_of_pictures, named_once, print_json, read_raw};
use crate::UsageError;
use crate::args::Merge;
use crate::output::{self, Format, Kind};
use crate::watch::say;
use anyhow::anyhow;
use diopter::develop::Recipe;
use diopter::hdr;
use diopter::image::RawImage;
use diopter::image::focal_plane::{FocalPlaneSource, Merged};

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &Merge, json: bool) -> anyhow::Result<()> {
    output::distinct(args.parts.iter().map(|p| p.as_path()), args.output.iter().map(|p| p.as_path()))?;
    // What comes on standard input is as the other files are.
    let streams = args.parts.iter().filter(|p| p.as_os_str() == "-").count();
    let raws = args.parts.iter().filter(|p| matches!(output::kind(p), Ok(Kind::Dng))).count();
    let raws = if raws > 0 { raws + streams } else { 0 };
    if raws == args.parts.len() {
        return series(args, json);
    }
    if raws > 0 {
        return Err(UsageError(anyhow!(
            "{raws} of {} files are raw files: expected focal planes or raw files, not both",
            args.parts.len()
        ))
        .into());
    }
    let [output] = args.output.as_slice() else {
        return Err(UsageError(anyhow!("{} outputs of focal planes: expected one, of all parts", args.output.len())).into());
    };
    let output = output::prepare_exr(output)?;
    let parts = args.parts.iter().map(|p| PlaneFile::open(p)).collect::<anyhow::Result<Vec<_>>>()?;
    let mut whole = Merged::new(parts).map_err(|e| UsageError(e.into()))?;
    let path = output::write_strips(output, &mut whole)?;
    let facts = whole.facts();
    let ranges = facts.ranges();
    let end = ranges[ranges.len() - 1][1];
    let missing = match ranges.len() > 1 {
        true => format!(" ({})", ranges.iter().map(|[first, end]| format!("{first}..{end}")).collect::<Vec<_>>().join(", ")),
        false => String::new(),
    };
    let parts = if whole.parts() == 1 { "1 part".to_owned() } else { format!("{} parts", whole.parts()) };
    say(&format!("{parts}, {} samples a pixel{missing}\nwrote {}", facts.samples, path.display()));
    if json {
        let samples = if ranges.len() > 1 { serde_json::json!(ranges) } else { serde_json::json!([facts.first_sample, end]) };
        print_json(&serde_json::json!({ "files": [path], "facts": facts, "samples": samples }))?;
    }
    Ok(())
}

fn series(args: &Merge, json: bool) -> anyhow::Result<()> {
    // A picture that counts twice would be taken for two whose noise differs.
    named_once(&args.parts)?;
    let outputs = output::prepare_pictures(&args.output)?;
    let raws: Vec<RawImage> = args.parts.iter().map(|p| read_raw(p)).collect::<anyhow::Result<_>>()?;
    let merged = hdr::merge(&raws).map_err(|e| UsageError(e.into()))?;
    let written = output::write_pictures(outputs, &merged, None, &Recipe::default(), None, Format::default())?;
    let range = hdr::extra_range_ev(&raws, &merged)
        .filter(|ev| *ev >= 0.05)
        .map_or(String::new(), |ev| format!(", {ev:.1} EV more range than one"));
    say(&format!("{}{range}", count_of_pictures(raws.len())));
    written.iter().for_each(|p| say(&format!("wrote {}", p.display())));
    if json {
        print_json(&serde_json::json!({ "files": written, "facts": merged.header.facts, "pictures": raws.len() }))?;
    }
    Ok(())
}
