//! `quick-look`: depth of field for a sharp picture with depth.

use super::{open, print_json};
use crate::UsageError;
use crate::args::QuickLook;
use crate::output;
use crate::watch::say;
use anyhow::{Context, anyhow};
use diopter::image::{Encoding, ImageError, Picture, exr};
use diopter::lens::Iris;
use diopter::light::color::RgbSpace;
use diopter::quantity::FNumber;
use diopter::quick_look::{Optics, film_width_of, of_plane, quick_look};
use diopter::sensor::format::{FORMATS, Format};
use diopter::shot::ShotError;
use std::time::Instant;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(args: &QuickLook, json: bool) -> anyhow::Result<()> {
    output::distinct([args.picture.as_path()], [args.output.as_path()])?;
    let wrong = |text: String| anyhow::Error::from(UsageError(anyhow!(text)));
    let output = output::prepare_exr(&args.output)?;
    let parsed = |text: &str| {
        Format::parse(text).ok_or_else(|| {
            let names: Vec<&str> = FORMATS.iter().map(|f| f.names[0]).collect();
            wrong(format!("format \"{text}\": expected one of {}, or width x height in mm such as 36x24", names.join(", ")))
        })
    };
    let asked = args.format.as_deref().map(parsed).transpose()?;
    let full_frame = parsed("full frame")?;
    let iris = match args.blades {
        None => Iris::Round,
        Some(n) => {
            let rotation = args.blade_rotation.unwrap_or(0.0).to_radians();
            Iris::blades(n, rotation, args.blade_curvature.unwrap_or(0.0)).map_err(ShotError::from)?
        }
    };
    let name = args.picture.display().to_string();
    let plane = match exr::read_focal_plane(open(&args.picture)?) {
        Ok(plane) => Some(plane),
        Err(ImageError::Missing { .. } | ImageError::Mismatch(_)) => None,
        Err(e) => return Err(e).with_context(|| name.clone()),
    };
    if plane.as_ref().is_some_and(|p| p.facts.light_field.is_some()) {
        return Err(wrong(format!("{name}: a light field: expected a picture without microlenses")));
    }
    let focal = match (args.focal_length, &plane) {
        (Some(f), _) => f.0,
        (None, Some(p)) => p.facts.focal_length_mm,
        (None, None) => return Err(wrong("a picture without facts: expected --focal-length, such as 50mm".into())),
    };
    if !FNumber::RANGE.contains(&args.aperture.0) {
        return Err(wrong(format!("aperture {}: expected {}", args.aperture, FNumber::EXPECTED)));
    }
    if !(focal > 0.0 && args.aperture.0 > 0.0 && 1000.0 * args.focus.0 > focal) {
        return Err(wrong(format!(
            "{focal} mm f/{} focused at {}: expected a focal length and an f-number above 0 and a focus beyond the focal length",
            args.aperture.0, args.focus
        )));
    }
    let own = plane.as_ref().filter(|_| asked.is_none()).and_then(film_width_of);
    let format = asked.unwrap_or(full_frame);
    let optics = |width: usize, height: usize| {
        // The picture fills the format's width or height, whichever its shape uses fully.
        let shape = width as f64 / height as f64;
        let fills = if shape > format.width_mm / format.height_mm { format.width_mm } else { format.height_mm * shape };
        Optics::thin(focal, args.aperture.0, args.focus.0, own.unwrap_or(fills), &iris)
    };
    let (begun, seconds);
    let path = match plane {
        Some(plane) => {
            begun = Instant::now();
            let blurred = of_plane(&plane, &optics(plane.width(), plane.height()));
            seconds = begun.elapsed().as_secs_f64();
            output::write_plane(output, &blurred)?
        }
        None => {
            let picture = exr::read_rgb(open(&args.picture)?).with_context(|| name.clone())?;
            let depth = exr::read_plane(open(&args.picture)?, "Z").with_context(|| name.clone())?;
            begun = Instant::now();
            let Some(pixels) = quick_look(&picture, &depth, &optics(picture.width, picture.height)) else {
                return Err(wrong(format!("{name}: {} depths for {} × {} pixels", depth.len(), picture.width, picture.height)));
            };
            seconds = begun.elapsed().as_secs_f64();
            let picture = Picture { pixels, space: RgbSpace::Srgb, encoding: Encoding::Linear, facts: None };
            output.commit(|to| Ok(exr::write_picture(&picture, exr::Precision::Float, to)?))?
        }
    };
    say(&format!("{seconds:.2} s\nwrote {}", path.display()));
    if json {
        print_json(&serde_json::json!({ "files": [path], "seconds": seconds }))?;
    }
    Ok(())
}
