//! `read-out` of pictures of light: radiance or irradiance from other programs, or our own `expose --radiance`.

use super::body::body_of;
use super::{open, print_json, read_plane};
use crate::UsageError;
use crate::args::ReadOut;
use crate::output::{self, now};
use crate::watch::{say, warn};
use anyhow::{Context, anyhow};
use diopter::develop::Recipe;
use diopter::from_light::{Channels, Place, focal_plane, of_plane};
use diopter::image::exr::{self, FocalPlaneRows};
use diopter::image::focal_plane::BandUnit;
use diopter::image::{FocalPlane, ImageError, RawImage};
use diopter::sensor::{ReadOut as Reader, Sensor, read_out};
use diopter::shot::white_point;
use diopter::{raw_file, truth};
use std::path::PathBuf;

/// Whether the file is a picture of light: flags say so, or it is a plane in radiance.
pub fn is_asked(args: &ReadOut) -> bool {
    let own = || FocalPlaneRows::open(open(&args.plane).ok()?).ok();
    args.exposure.is_some()
        || args.t_stop.is_some()
        || args.irradiance
        || own().is_some_and(|rows| rows.bands().iter().all(|b| b.unit == BandUnit::Radiance))
}

/// The sensor and its electrons.
fn exposed(args: &ReadOut) -> anyhow::Result<(Sensor, FocalPlane)> {
    let place = || args.plane.display().to_string();
    let (exposure_s, t_number) = (args.exposure.map(|s| s.0), args.t_stop.map(|n| n.0));
    let wrong = |text: String| anyhow::Error::from(UsageError(anyhow!("{}: {text}", place())));
    // Ours tells what it is; light on the sensor it never is.
    let ours = FocalPlaneRows::open(open(&args.plane)?).is_ok();
    if ours {
        if args.irradiance {
            return Err(wrong("it was exposed by diopter, which writes radiance: expected no --irradiance".into()));
        }
        let plane = read_plane(&args.plane)?;
        let sensor = body_of(args, &plane.facts.body)?;
        say(
            "note: light of --radiance is that of the scene: its electrons show no vignetting, no fall-off towards the corners and no loss by near focus; those of `expose` without it do",
        );
        let electrons = of_plane(&plane, &sensor, exposure_s, t_number).map_err(anyhow::Error::from).with_context(place)?;
        return Ok((sensor, electrons));
    }
    let Some(exposure_s) = exposure_s else {
        return Err(wrong("how long it is exposed is not known: expected --exposure, such as --exposure 1/100s".into()));
    };
    let light_at = match (t_number, args.irradiance) {
        (Some(t_number), _) => Place::Scene { t_number },
        (None, true) => Place::Sensor,
        (None, false) => {
            let expected =
                "expected --t-stop (it is radiance, cd/m²; such as --t-stop f/4) or --irradiance (light on the sensor, lx)";
            return Err(wrong(format!("what its numbers are is not known: {expected}")));
        }
    };
    if args.body.is_none() {
        return Err(wrong("whose sensor it falls on is not known: expected --body".into()));
    }
    let sensor = body_of(args, "")?;
    let light = exr::read_rgb(open(&args.plane)?).with_context(place)?;
    let negative = light.data.chunks(light.channels.max(1)).filter(|pixel| pixel.iter().any(|v| *v < 0.0)).count();
    if negative > 0 {
        let all = light.width * light.height;
        warn(&format!("{}: {negative} of {all} pixels are negative in a colour: 0 is taken there", args.plane.display()));
    }
    let depth = match exr::read_plane(open(&args.plane)?, "Z") {
        Ok(depth) => Some(depth),
        Err(ImageError::Missing { .. }) => None,
        Err(e) => return Err(anyhow::Error::from(e).context(place())),
    };
    let electrons = focal_plane(&light, &Channels::LinearSrgb, light_at, depth.as_deref(), &sensor, exposure_s)
        .map_err(anyhow::Error::from)
        .with_context(place)?;
    Ok((sensor, electrons))
}

/// Reads it out into raw files of these names.
pub fn run(args: &ReadOut, names: &[PathBuf], json: bool) -> anyhow::Result<()> {
    // One proves that the others can be written; thousands are not opened at once.
    let mut ready = Some(output::prepare_dng(&names[0])?);
    let truth_file = args.truth.as_deref().map(output::prepare_exr).transpose()?;
    let (sensor, plane) = exposed(args)?;
    let asked = args.asked();
    let reading = |k: usize| asked.reading(&sensor, None, args.seed.wrapping_add(k as u64));
    let white = white_point(&reading(0).white)?;
    let date = now();
    let taken = |k: usize| -> anyhow::Result<RawImage> {
        let mut raw = read_out(&plane, &sensor, &reading(k), &white).map_err(|e| UsageError(e.into()))?;
        raw.header.facts.date = Some(date.clone());
        Ok(raw)
    };
    let first = taken(0)?;
    let mut written = Vec::new();
    for (k, name) in names.iter().enumerate() {
        let output = match ready.take() {
            Some(output) => output,
            None => output::prepare_dng(name)?,
        };
        let later = if k == 0 { None } else { Some(taken(k)?) };
        let raw = later.as_ref().unwrap_or(&first);
        written.push(output.commit(|to| Ok(raw_file::write_image(raw, args.raw.storage(), &Recipe::default(), to)?))?);
    }
    let header = &first.header;
    if let Some(output) = truth_file {
        let size = [plane.width(), plane.height()];
        let reader = Reader::new(&sensor, &reading(0), size, &plane.bands, plane.facts.exposure_s)?;
        let reader = reader.with_rows_of(&plane.facts);
        let layout = args.truth_layout.layout();
        written.extend(output::write_truth(output, plane.truth.recorded(), args.truth_sidecar, |recorded, to| {
            truth::write(&plane, &reader, &first, layout, recorded, to)
        })?);
    }
    say(&format!("{}   ISO {:.0}   {} s   seed {}", sensor.name, header.facts.iso, header.facts.exposure_s, args.seed));
    written.iter().for_each(|p| say(&format!("wrote {}", p.display())));
    if json {
        print_json(&serde_json::json!({
            "files": written, "facts": header.facts, "black_level": header.black_level, "white_level": header.white_level,
            "as_shot_neutral": header.as_shot_neutral, "noise_profile": header.noise, "cfa": header.cfa.letters(),
        }))?;
    }
    Ok(())
}
