//! `expose`: a scene onto the focal plane.

use super::print_json;
use crate::args::Expose;
use crate::checkpoint;
use crate::commands::exposure_summary::{display, say_ambient};
use crate::memory::{self, Room};
use crate::output;
use crate::watch::{self, say, warn, watched};
use crate::{Stopped, UsageError};
use anyhow::anyhow;
use diopter::shot::{FireflyChoice, Sequence, Shot};
use std::time::Instant;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &Expose, json: bool) -> anyhow::Result<()> {
    let _held = watch::hold();
    let mut file = args.taking.shot_file()?;
    if Sequence::new(&mut file)?.count() > 1 {
        return Err(
            UsageError(anyhow!("the shot file asks for a sequence: expected one exposure; `shoot` takes sequences")).into()
        );
    }
    let output = output::prepare_exr(&args.output)?;
    let mut shot = Shot::prepare(&file, &mut warn)?;
    (shot.radiance, shot.rgb, shot.spectral) = (args.radiance, args.rgb, args.bands);
    if file.render.fireflies == Some(FireflyChoice::Reweight) && !shot.reweights() {
        warn("fireflies are kept: only all samples at once of an exposure in electrons can be re-weighted");
    }
    let room = memory::room(&mut shot, args.taking.max_memory)?;
    watched("focusing", |w| shot.focus(w, &mut warn))?;
    // The exposure itself tells what a meter would, where it does not depend on it.
    let meters_by_exposure = matches!(room, Room::Memory) && shot.can_meter_by_exposure();
    if meters_by_exposure {
        watched("preparing", |w| shot.prepare_to_meter_by_exposure(w, &mut warn))?;
    } else {
        watched("metering", |w| shot.meter(w, &mut warn))?;
        say_ambient(file.scene.ambient_ev, &shot.facts());
    }
    let started = Instant::now();
    let (path, facts, size, bands, seconds, stopped) = match room {
        Room::Memory => {
            let mut taken = checkpoint::expose(&shot, &args.taking, Some(&args.output), "exposing", args.taking.resume)?;
            if meters_by_exposure {
                watched("metering", |w| shot.meter_by(&mut taken.exposed.plane, w, &mut warn))?;
                say_ambient(file.scene.ambient_ev, &shot.facts());
            }
            let plane = &taken.exposed.plane;
            let seconds = started.elapsed().as_secs_f64();
            let path = output::write_plane(output, plane)?;
            let size = [plane.width(), plane.height()];
            (path, plane.facts.clone(), size, plane.bands.clone(), seconds, taken.finish())
        }
        Room::Disk(cache) => {
            say("the exposure is larger than memory: its sums are in a temporary file beside the output");
            if file.render.fireflies == Some(FireflyChoice::Reweight) {
                warn("fireflies are kept: what is larger than memory is not re-weighted");
            }
            if shot.diffracts() && !shot.radiance && shot.spectral.is_none() {
                warn("starbursts of lamps are noisy: in what is larger than memory their light is gathered like all other");
            }
            let (mut exposed, kept) = checkpoint::expose_rows(&shot, &args.taking, &args.output, "exposing", cache)?;
            let seconds = started.elapsed().as_secs_f64();
            let path = output::write_strips(output, &mut *exposed.plane)?;
            let plane = &exposed.plane;
            let facts = plane.facts().clone();
            let stopped = kept.finish(exposed.stopped, facts.samples);
            (path, facts, plane.size(), plane.bands().to_vec(), seconds, stopped)
        }
    };
    say(&display(&facts, size[0], size[1], seconds));
    say(&format!("wrote {}", path.display()));
    if json {
        let bands: Vec<&str> = bands.iter().map(|b| b.name.as_str()).collect();
        print_json(&serde_json::json!({
            "files": [path], "facts": facts, "size": size, "bands": bands, "expose_s": seconds, "stopped": stopped.is_some(),
        }))?;
    }
    stopped.map_or(Ok(()), |how| Err(Stopped(how).into()))
}
