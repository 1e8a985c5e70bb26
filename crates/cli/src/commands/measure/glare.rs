//! `measure glare`: the veiling glare index of a picture and of a lens.

use super::{name_of, plane, print_json, region};
use crate::AskedWrongly;
use crate::args::MeasureGlare;
use anyhow::anyhow;
use diopter::lens::compound::Setting;
use diopter::lens::ghosts::SENSOR_REFLECTANCE;
use diopter::lens::glare::{BINS_NM, GlareSpread, GlareTracer, veiling_glare};
use diopter::lens::prescription::Hood;
use diopter::lens::{CompoundLens, Focus};
use diopter::measure::glare;
use diopter::shot::{ShotError, read_lens};
use glam::{DVec2, DVec3};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::io::Write;
use std::sync::Arc;

/// Angular radius of the black spot, degrees: a spot of 5 cm at 1 m, as of the scene glare-spot.
const SPOT_DEG: f64 = 1.43;
/// Fields of the glare spread function, and rays for each and each wavelength.
const FIELDS: usize = 5;
const FIELD_RAYS: usize = 600;

pub(super) fn run(asked: &MeasureGlare, json: bool) -> anyhow::Result<()> {
    let (mut text, mut value) = (String::new(), json!({}));
    if let Some(file) = &asked.file {
        let (_, plane, channel) = plane(file, asked.channel, asked.encoding)?;
        let found = glare::measure(&plane, asked.region.map(region))?;
        writeln!(
            text,
            "{}: {} ({})\n  veiling glare index {:.3} % ± {:.3} %",
            name_of(file),
            found.spot,
            channel.name(),
            100.0 * found.index,
            100.0 * found.error
        )?;
        value["picture"] = json!(found);
    }
    if let Some(name) = &asked.lens {
        value["lens"] = of_lens(asked, name, &mut text)?;
    }
    if json {
        return print_json(&value);
    }
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

fn of_lens(asked: &MeasureGlare, name: &str, text: &mut String) -> anyhow::Result<Value> {
    let wrong = |what: String| anyhow::Error::from(AskedWrongly(anyhow!(what)));
    if asked.film.iter().any(|side| !(*side > 0.1 && *side < 1000.0)) {
        return Err(wrong(format!("--film {},{}: expected width and height in mm, such as 36,24", asked.film[0], asked.film[1])));
    }
    if !(16..=10_000_000).contains(&asked.rays) {
        return Err(wrong(format!("--rays {}: expected 16 to 10000000", asked.rays)));
    }
    let prescription = read_lens(name)?;
    let setting = |f_number| Setting {
        focal_length: asked.focal_length.map(|l| l.0),
        f_number,
        focus: Focus::Infinity,
        iris: None,
        film_mm: asked.film,
    };
    let film = 0.5 * DVec2::from_array(asked.film);
    let own = prescription.hood;
    let hood = asked.hood.map(|l| Hood { length: l.0, diameter: None }).or(own);
    let bare = Arc::new(prescription);
    let lens = match hood {
        None => bare,
        Some(hood) => {
            hood.check().map_err(wrong)?;
            let open = CompoundLens::new(bare.clone(), &setting(None)).map_err(ShotError::from)?;
            Arc::new(bare.with_hood(&hood, open.system(), film))
        }
    };
    let lens = CompoundLens::new(lens, &setting(asked.aperture.map(|f| f.0))).map_err(ShotError::from)?;
    let system = lens.system();
    let unfit = |e: diopter::lens::glare::Unfit| wrong(format!("{name}: {e}; expected a lens whose glare can be traced"));
    let tracers = BINS_NM.map(|nm| GlareTracer::new(system, nm, film, SENSOR_REFLECTANCE));
    let [_, green, _] = &tracers;
    let tracer = green.as_ref().map_err(|e| unfit(*e))?;
    let no_light = || wrong(format!("{name}: no light comes to the middle of the film"));
    let everywhere = veiling_glare(tracer, DVec2::ZERO, SPOT_DEG, asked.rays, |_| true).ok_or_else(no_light)?;
    // The part of the surround that the picture shows: what a photograph of a chart no larger than the frame has.
    let efl = lens.focal_length().0;
    let in_frame = |d: DVec3| (d.x / d.z * efl).abs() < film.x && (d.y / d.z * efl).abs() < film.y;
    let frame = veiling_glare(tracer, DVec2::ZERO, SPOT_DEG, asked.rays, in_frame).ok_or_else(no_light)?;
    writeln!(text, "{name} at f/{:.2}, {:.1} mm, in the middle, at {:.0} nm", lens.f_number(), efl, BINS_NM[1])?;
    writeln!(
        text,
        "  veiling glare index {:.3} % (reflections {:.3} %, scatter and walls {:.3} %): a bright surround on all sides (ISO 9358)",
        100.0 * everywhere.index(),
        100.0 * everywhere.ghosts,
        100.0 * everywhere.scatter
    )?;
    writeln!(text, "  {:.3} % of a surround that fills the frame alone", 100.0 * frame.index())?;
    let spread = GlareSpread::of(system, film.length(), SENSOR_REFLECTANCE, FIELDS, FIELD_RAYS).map_err(unfit)?;
    writeln!(
        text,
        "\n  glare of a point, over its image:\n  {:>9} {:>9} {:>9} {:>12} {:>9}",
        "angle", "height", "kept", "reflections", "scatter"
    )?;
    let mut fields = vec![];
    for field in &spread.fields {
        let [ghosts, scatter] = field.fractions(spread.reach_mm);
        let kept = field.kept.iter().sum::<f64>() / 3.0;
        writeln!(
            text,
            "  {:>8.2}° {:>6.2} mm {:>7.3} % {:>10.3} % {:>7.3} %",
            field.angle_deg,
            field.height_mm,
            100.0 * kept,
            100.0 * ghosts,
            100.0 * scatter
        )?;
        // Scattered light over distance from the image, per mm².
        let radii: Vec<f64> = (0..24).map(|k| spread.reach_mm * 10f64.powf(-3.0 + k as f64 / 8.0)).collect();
        let image = DVec2::new(0.0, field.height_mm);
        let rings: Vec<Value> = radii
            .windows(2)
            .map(|r| {
                let light: f64 =
                    field.arrivals.iter().filter(|a| (r[0]..r[1]).contains(&a.at.distance(image))).map(|a| a.fraction).sum();
                let area = std::f64::consts::PI * (r[1] * r[1] - r[0] * r[0]);
                json!({ "from_mm": r[0], "to_mm": r[1], "per_mm2": light / 3.0 / area })
            })
            .collect();
        fields.push(json!({ "angle_deg": field.angle_deg, "height_mm": field.height_mm, "kept": kept, "ghosts": ghosts, "scatter": scatter, "glare_spread": rings }));
    }
    Ok(
        json!({ "name": name, "f_number": lens.f_number(), "focal_length_mm": efl, "index": everywhere.index(), "ghosts": everywhere.ghosts,
        "scatter": everywhere.scatter, "index_of_frame": frame.index(), "fields": fields }),
    )
}
