//! `calc`: calculators.

mod daylight;
mod exposure;
mod focus;
mod formats;
mod pinhole;
mod shutter;
mod stop;
mod thin_lens;
mod tone;

use crate::args::CalcVerb;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(verb: &CalcVerb, json: bool) -> anyhow::Result<()> {
    match verb {
        CalcVerb::Tone { curve, colours, keep_grey } => tone::run(curve, colours, *keep_grey, json),
        CalcVerb::Equivalent(args) => exposure::equivalent(args, json),
        CalcVerb::Exposure { aperture, time, iso, true_stops } => exposure::value(*aperture, *time, *iso, *true_stops, json),
        CalcVerb::Program { widest, focal_length, iso, output } => exposure::program(*widest, *focal_length, *iso, output, json),
        CalcVerb::Dof(args) => focus::depth(args, json),
        CalcVerb::Hyperfocal { focal_length, aperture, format, circle } => {
            focus::hyperfocal(*focal_length, *aperture, format, *circle, json)
        }
        CalcVerb::Fov(args) => focus::field(args, json),
        CalcVerb::EquivalentFormat(args) => focus::equivalent(args, json),
        CalcVerb::Daylight(args) => daylight::run(args, json),
        CalcVerb::Stops { step } => exposure::stops(step, json),
        CalcVerb::ThinLens(args) => thin_lens::run(args, json),
        CalcVerb::Stop(args) => stop::run(args, json),
        CalcVerb::Shutter(args) => shutter::run(args, json),
        CalcVerb::Pinhole(args) => pinhole::run(args, json),
        CalcVerb::Formats { names } => formats::run(names, json),
    }
}
