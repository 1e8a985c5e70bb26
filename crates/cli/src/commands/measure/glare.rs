//! `measure glare`: the veiling glare index of a picture and of a lens.

use super::{line, name_of, plane, print_json, region, sheet};
use crate::UsageError;
use crate::args::MeasureGlare;
use anyhow::anyhow;
use diopter::lens::compound::Setting;
use diopter::lens::draw::{Axis, Chart, Figure, Style};
use diopter::lens::ghosts::SENSOR_REFLECTANCE;
use diopter::lens::glare::{BINS_NM, FieldGlare, GlareSpread, GlareTracer, VeilingGlare, veiling_glare};
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
        let traced = of_lens(asked, name)?;
        text.push_str(&traced.text()?);
        value["lens"] = traced.value();
    }
    if json {
        return print_json(&value);
    }
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

/// What a lens is set to.
pub(super) struct LensGlare {
    pub(super) aperture: Option<f64>,
    /// Of a zoom, mm.
    pub(super) focal_length: Option<f64>,
    /// Width and height of the film, mm.
    pub(super) film: [f64; 2],
    /// The prescription's own without.
    pub(super) hood: Option<Hood>,
    pub(super) rays: usize,
}

/// Rays of a laboratory report.
pub(super) const REPORT_RAYS: usize = 20_000;

/// The glare of a lens, traced.
pub(super) struct Traced {
    name: String,
    f_number: f64,
    focal_mm: f64,
    everywhere: VeilingGlare,
    /// Of a surround that fills the frame alone.
    frame: VeilingGlare,
    spread: GlareSpread,
}

fn wrong(what: String) -> anyhow::Error {
    UsageError(anyhow!(what)).into()
}

fn of_lens(asked: &MeasureGlare, name: &str) -> anyhow::Result<Traced> {
    if asked.film.iter().any(|side| !(*side > 0.1 && *side < 1000.0)) {
        return Err(wrong(format!("--film {},{}: expected width and height in mm, such as 36,24", asked.film[0], asked.film[1])));
    }
    if !(16..=10_000_000).contains(&asked.rays) {
        return Err(wrong(format!("--rays {}: expected 16 to 10000000", asked.rays)));
    }
    let set = LensGlare {
        aperture: asked.aperture.map(|f| f.0),
        focal_length: asked.focal_length.map(|l| l.0),
        film: asked.film,
        hood: asked.hood.map(|l| Hood { length: l.0, diameter: None }),
        rays: asked.rays,
    };
    traced(&set, name)
}

/// Traces the glare of a lens.
pub(super) fn traced(asked: &LensGlare, name: &str) -> anyhow::Result<Traced> {
    let prescription = read_lens(name)?;
    let setting = |f_number| Setting {
        focal_length: asked.focal_length,
        f_number,
        focus: Focus::Infinity,
        iris: None,
        film_mm: asked.film,
    };
    let film = 0.5 * DVec2::from_array(asked.film);
    let own = prescription.hood;
    let hood = asked.hood.or(own);
    let bare = Arc::new(prescription);
    let lens = match hood {
        None => bare,
        Some(hood) => {
            hood.check().map_err(wrong)?;
            let open = CompoundLens::new(bare.clone(), &setting(None)).map_err(ShotError::from)?;
            Arc::new(bare.with_hood(&hood, open.system(), film))
        }
    };
    let lens = CompoundLens::new(lens, &setting(asked.aperture)).map_err(ShotError::from)?;
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
    let spread = GlareSpread::of(system, film.length(), SENSOR_REFLECTANCE, FIELDS, FIELD_RAYS).map_err(unfit)?;
    Ok(Traced { name: name.to_owned(), f_number: lens.f_number(), focal_mm: efl, everywhere, frame, spread })
}

impl Traced {
    /// Veiling glare index of a surround that is bright on all sides.
    pub(super) fn index(&self) -> f64 {
        self.everywhere.index()
    }

    pub(super) fn text(&self) -> anyhow::Result<String> {
        let (mut text, everywhere) = (String::new(), &self.everywhere);
        writeln!(
            text,
            "{} at f/{:.2}, {:.1} mm, in the middle, at {:.0} nm",
            self.name, self.f_number, self.focal_mm, BINS_NM[1]
        )?;
        writeln!(
            text,
            "  veiling glare index {:.3} % (reflections {:.3} %, scatter and walls {:.3} %): a bright surround on all sides (ISO 9358)",
            100.0 * everywhere.index(),
            100.0 * everywhere.ghosts,
            100.0 * everywhere.scatter
        )?;
        writeln!(text, "  {:.3} % of a surround that fills the frame alone", 100.0 * self.frame.index())?;
        writeln!(
            text,
            "\n  glare of a point, over its image:\n  {:>9} {:>9} {:>9} {:>12} {:>9}",
            "angle", "height", "kept", "reflections", "scatter"
        )?;
        for field in &self.spread.fields {
            let [ghosts, scatter] = field.fractions(self.spread.reach_mm);
            writeln!(
                text,
                "  {:>8.2}° {:>6.2} mm {:>7.3} % {:>10.3} % {:>7.3} %",
                field.angle_deg,
                field.height_mm,
                100.0 * kept(field),
                100.0 * ghosts,
                100.0 * scatter
            )?;
        }
        Ok(text)
    }

    /// Scattered light over distance from the image, per mm²: from and to (mm) and value.
    fn rings(&self, field: &FieldGlare) -> Vec<[f64; 3]> {
        let radii: Vec<f64> = (0..24).map(|k| self.spread.reach_mm * 10f64.powf(-3.0 + k as f64 / 8.0)).collect();
        let image = DVec2::new(0.0, field.height_mm);
        let of = |r: &[f64]| {
            let light: f64 =
                field.arrivals.iter().filter(|a| (r[0]..r[1]).contains(&a.at.distance(image))).map(|a| a.fraction).sum();
            let area = std::f64::consts::PI * (r[1] * r[1] - r[0] * r[0]);
            [r[0], r[1], light / 3.0 / area]
        };
        radii.windows(2).map(of).collect()
    }

    pub(super) fn value(&self) -> Value {
        let field = |field: &FieldGlare| {
            let [ghosts, scatter] = field.fractions(self.spread.reach_mm);
            let rings: Vec<Value> =
                self.rings(field).iter().map(|[from, to, v]| json!({ "from_mm": from, "to_mm": to, "per_mm2": v })).collect();
            json!({ "angle_deg": field.angle_deg, "height_mm": field.height_mm, "kept": kept(field), "ghosts": ghosts,
                "scatter": scatter, "glare_spread": rings })
        };
        let fields: Vec<Value> = self.spread.fields.iter().map(field).collect();
        json!({ "name": self.name, "f_number": self.f_number, "focal_length_mm": self.focal_mm, "index": self.everywhere.index(),
            "ghosts": self.everywhere.ghosts, "scatter": self.everywhere.scatter, "index_of_frame": self.frame.index(), "fields": fields })
    }

    /// Scattered and reflected light around images of points.
    pub(super) fn figure(&self) -> Figure {
        let lines: Vec<_> = [0, self.spread.fields.len() - 1]
            .into_iter()
            .enumerate()
            .map(|(k, n)| {
                let field = &self.spread.fields[n];
                let points = self.rings(field).into_iter().filter(|r| r[2] > 0.0);
                let points = points.map(|[from, to, v]| (0.5 * (from.log10() + to.log10()), v.log10()));
                line(format!("{:.1} mm from the middle", field.height_mm), k, Style::Full, points)
            })
            .collect();
        let all: Vec<DVec2> = lines.iter().flat_map(|l| l.points.clone()).collect();
        sheet(&Chart {
            title: "glare spread function".into(),
            x: Axis::around("log distance from the image, mm", all.iter().map(|p| p.x), false),
            y: Axis::around("log fraction of the light a mm²", all.iter().map(|p| p.y), false),
            lines,
        })
    }

    /// How much of the light of points goes astray, over image height.
    pub(super) fn kept_figure(&self) -> Figure {
        let points = |part: usize| {
            let fields = self.spread.fields.iter();
            fields.map(|f| (f.height_mm, 100.0 * f.fractions(self.spread.reach_mm)[part])).collect::<Vec<_>>()
        };
        let lines = vec![line("reflections", 0, Style::Full, points(0)), line("scatter and walls", 1, Style::Full, points(1))];
        let all: Vec<DVec2> = lines.iter().flat_map(|l| l.points.clone()).collect();
        sheet(&Chart {
            title: "stray light of a point".into(),
            x: Axis::around("image height, mm", all.iter().map(|p| p.x), true),
            y: Axis::around("% of the image", all.iter().map(|p| p.y), true),
            lines,
        })
    }
}

/// Light that the lens keeps, mean over the wavelengths.
fn kept(field: &FieldGlare) -> f64 {
    field.kept.iter().sum::<f64>() / 3.0
}
