//! `calc`: calculators.

mod exposure;
mod tone;

use crate::args::CalcVerb;

pub fn run(verb: &CalcVerb, json: bool) -> anyhow::Result<()> {
    match verb {
        CalcVerb::Tone { curve, colours, keep_grey } => tone::run(curve, colours, *keep_grey, json),
        CalcVerb::Equivalent(args) => exposure::equivalent(args, json),
        CalcVerb::Exposure { aperture, time, iso, true_stops } => exposure::value(*aperture, *time, *iso, *true_stops, json),
        CalcVerb::Program { widest, focal_length, iso, output } => exposure::program(*widest, *focal_length, *iso, output, json),
        CalcVerb::Stops { step } => exposure::stops(step, json),
    }
}
