//! `read-out`: a focal plane into a raw image.

use super::{print_json, read_plane};
use crate::args::ReadOut;
use crate::output;
use crate::watch::say;
use anyhow::Context;
use diopter::image::exr;
use diopter::sensor::{Sensor, read_out};
use diopter::shot::{read_body, white_point};

pub fn run(args: &ReadOut, json: bool) -> anyhow::Result<()> {
    let output = output::prepare_exr(&args.output)?;
    let white = white_point(&args.white)?;
    let plane = read_plane(&args.plane)?;
    let sensor = match &args.body {
        Some(name) => read_body(name)?,
        None => {
            let body = &plane.facts.body;
            let named = Sensor::names().filter_map(|n| Sensor::named(n).ok()).find(|s| s.name == *body);
            named.with_context(|| {
                format!(
                    "{}: it was exposed with \"{body}\", which is not embedded; give its file with --body",
                    args.plane.display()
                )
            })?
        }
    };
    let raw = read_out(&plane, &sensor, args.iso.0, args.seed, &white).map_err(|e| crate::AskedWrongly(e.into()))?;
    let path = output.commit(|to| Ok(exr::write_raw(&raw, to)?))?;
    say(&format!("{}   ISO {:.0}   seed {}\nwrote {}", sensor.name, args.iso.0, args.seed, path.display()));
    if json {
        let n = raw.mosaic.data.len() as f64;
        let mean = raw.mosaic.data.iter().map(|d| *d as f64).sum::<f64>() / n;
        let saturated = raw.mosaic.data.iter().filter(|d| **d as f64 >= raw.white_level).count() as f64 / n;
        print_json(&serde_json::json!({
            "files": [path], "facts": raw.facts, "black_level": raw.black_level, "white_level": raw.white_level,
            "mean_dn": mean, "saturated": saturated, "as_shot_neutral": raw.as_shot_neutral,
        }))?;
    }
    Ok(())
}
