//! pbrt's `nanovdb` medium: a density, and if there is one a temperature, from a NanoVDB file.

use super::Fault;
use super::context::Context;
use super::medium_fields::{black_body, filled};
use super::params::Params;
use crate::load::nanovdb;
use crate::medium::{Field, Medium, Scalars};

/// Name of the density where none is given, and of the temperature.
const DENSITY: &str = "density";
const TEMPERATURE: &str = "temperature";

/// Fills a medium with the grids of its `filename`; `scale`: a factor on its coefficients. Fails where the file or a grid that is named is missing or damaged, or the
/// grid has no volume.
pub fn make(context: &mut Context, p: &Params, bare: Medium, scale: f32) -> Result<Medium, Fault> {
    let name = p.text("filename")?.ok_or_else(|| p.place.fault("a nanovdb medium without filename", "\"string filename\""))?;
    let bytes = context.file(name, p.place)?;
    let told = |e: nanovdb::Broken| p.place.fault(format!("{name}: {}", e.found), e.expected);
    let file = nanovdb::File::open(&bytes).map_err(told)?;
    let grid = |wanted: &str| file.read(wanted).transpose().map_err(told);
    let wanted = p.text("gridname")?.unwrap_or(DENSITY);
    let density = grid(wanted)?.ok_or_else(|| {
        let all = file.names().collect::<Vec<_>>().join(", ");
        p.place.fault(format!("{name}: no grid \"{wanted}\""), format!("one of those in the file: {all}"))
    })?;
    let heat = p.text("temperaturename")?;
    let temperature = grid(heat.unwrap_or(TEMPERATURE))?;
    if let (Some(heat), None) = (heat, &temperature) {
        let all = file.names().collect::<Vec<_>>().join(", ");
        return Err(p.place.fault(format!("{name}: no grid \"{heat}\""), format!("one of those in the file: {all}")));
    }
    let negative = density.negative + temperature.as_ref().map_or(0, |t| t.negative);
    if negative > 0 {
        context.warn(p.place, format!("{name}: {negative} values below 0 were taken for 0"));
    }
    let glow = match temperature {
        Some(t) => Some(black_body(p, Scalars::Sparse(t.values))?),
        None => {
            // Said of a temperature that is not there.
            for name in ["Lescale", "temperatureoffset", "temperaturecutoff", "temperaturescale"] {
                p.get(name);
            }
            None
        }
    };
    let bounds = density.values.bounds();
    if !(bounds.size().min_element() > 0.0 && bounds.size().is_finite()) {
        return Err(p.place.fault(format!("{name}: grid \"{wanted}\" without a volume"), "a map that can be inverted"));
    }
    filled(context, p, bare, scale, bounds, Field::Density(Scalars::Sparse(density.values)), glow)
}
