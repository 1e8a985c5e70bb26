//! What can be chosen: scenes, lenses, bodies, dials, settings of the development; and drawings of lenses.

use crate::folders::Folders;
use crate::session::Live;
use diopter::develop::{Allowed, Recipe, SETTINGS};
use diopter::lens::analysis::Bench;
use diopter::lens::compound::{CompoundLens, Setting};
use diopter::lens::draw::{LayoutOptions, layout, thin_layout};
use diopter::lens::{Focus, Lens};
use diopter::light::cie;
use diopter::metering::Pattern;
use diopter::scene::builtin;
use diopter::sensor::Sensor;
use diopter::sensor::format::FORMATS;
use diopter::shot::ShotError;
use diopter::stops::{self, Mark, Step};
use serde_json::{Value, json};
use std::sync::{Arc, OnceLock};

/// Everything that pages choose from, but for files.
pub fn catalog(folders: &Folders) -> Value {
    static FIXED: OnceLock<Value> = OnceLock::new();
    let mut value = FIXED.get_or_init(fixed).clone();
    value["files"] = serde_json::to_value(folders.offered()).unwrap_or_default();
    value
}

fn fixed() -> Value {
    let lenses: Vec<Value> = diopter::lens::embedded_names()
        .filter_map(|name| Some((name, diopter::lens::embedded(name)?)))
        .map(|(name, p)| {
            let zoom = (p.zoom.len() > 1).then(|| [p.zoom[0], p.zoom[p.zoom.len() - 1]]);
            let source = p.patent.clone().unwrap_or_else(|| p.source.clone());
            json!({ "name": name, "title": p.name, "focal_mm": p.focal_length, "zoom_mm": zoom, "f_number": p.f_number, "source": source,
                "image_circle_mm": p.image_circle })
        })
        .collect();
    let bodies: Vec<Value> = Sensor::names()
        .filter_map(|name| Some((name, Sensor::named(name).ok()?)))
        .map(|(name, s)| json!({ "name": name, "title": s.name, "format_mm": s.format_mm, "pixels": s.pixels, "cfa": s.cfa.letters() }))
        .collect();
    let marks = |of: fn(Step) -> Vec<Mark>| {
        let step =
            |(name, step): &(&str, Step)| ((*name).to_owned(), json!(of(*step).iter().map(|m| m.nominal).collect::<Vec<_>>()));
        Value::Object(Step::NAMES.iter().map(step).collect())
    };
    let times =
        |step: Step| stops::times(step).iter().map(|m| json!([m.nominal, stops::time_name(m.nominal)])).collect::<Vec<_>>();
    let settings: Vec<Value> = SETTINGS
        .iter()
        .map(|s| {
            let allowed = match s.allowed {
                Allowed::Number(low, high) => json!({ "kind": "number", "low": low, "high": high }),
                Allowed::Numbers(n, low, high) => json!({ "kind": "numbers", "count": n, "low": low, "high": high }),
                Allowed::Bool => json!({ "kind": "bool" }),
                Allowed::Names(names) => json!({ "kind": "names", "names": names }),
                Allowed::Text => json!({ "kind": "text" }),
            };
            json!({ "name": s.name, "unit": s.unit, "why": s.why, "allowed": allowed, "default": default_of(s.name) })
        })
        .collect();
    let preset = |name: &&str| Recipe::preset(name).ok().and_then(|r| Some(((*name).to_owned(), serde_json::to_value(r).ok()?)));
    let presets: serde_json::Map<_, _> = Recipe::PRESETS.iter().filter_map(preset).collect();
    json!({
        "version": env!("CARGO_PKG_VERSION"),
        "scenes": builtin::NAMES.iter().map(|(name, about)| json!({ "name": name, "about": about })).collect::<Vec<_>>(),
        "lenses": lenses, "bodies": bodies,
        "formats": FORMATS.iter().map(|f| json!({ "name": f.names[0], "mm": [f.width_mm, f.height_mm] })).collect::<Vec<_>>(),
        "apertures": marks(stops::apertures), "speeds": marks(stops::speeds),
        "times": Step::NAMES.iter().map(|(name, step)| ((*name).to_owned(), json!(times(*step)))).collect::<serde_json::Map<_, _>>(),
        "metering": Pattern::NAMES.map(|n| n.0), "whites": cie::illuminant_names(), "settings": settings, "presets": presets,
    })
}

/// Default of a setting as JSON; null where it is not set.
fn default_of(name: &str) -> Value {
    let recipe = serde_json::to_value(Recipe::default()).unwrap_or_default();
    let (section, key) = name.split_once('.').unwrap_or((name, ""));
    recipe[section][key].clone()
}

/// Width of a drawing, points, and rays of each field.
const WIDTH: f64 = 560.0;
const RAYS: usize = 7;
/// Wavelength of the rays of drawings, nm: the d line.
const NM: f64 = 587.5618;

/// The lens of the latest frame in section with its iris and groups as they stand, and the rays to the middle and to a field angle (degrees); `None` of lenses
/// without a section.
pub fn drawing(live: &Live, field_deg: Option<f64>) -> Option<String> {
    let corner = 0.5 * live.film_mm[0].hypot(live.film_mm[1]);
    let fields = |focal: f64| match field_deg {
        Some(field) => vec![0.0, field],
        None => vec![0.0, (0.7 * corner / focal).atan().to_degrees(), (corner / focal).atan().to_degrees()],
    };
    match &live.lens {
        Lens::Compound(lens) => Some(section(lens, fields(lens.focal_length().0))),
        Lens::Thin(lens) => Some(thin_layout(lens, "", &fields(lens.focal_length.0), WIDTH).to_svg()),
        Lens::Pinhole(_) | Lens::Calibrated(_) => None,
    }
}

fn section(lens: &CompoundLens, fields_deg: Vec<f64>) -> String {
    let bench = Bench { system: lens.system(), object_distance: lens.focus_distance().map(|d| d.0) };
    layout(&bench, &LayoutOptions { title: String::new(), fields_deg, nm: NM, rays: RAYS, width: WIDTH }).to_svg()
}

/// An embedded lens in section, fully open at infinity. Fails on a name that is not embedded.
pub fn drawing_of(name: &str) -> Result<String, ShotError> {
    // Names only: files are the shot's matter, and checked there.
    let prescription = diopter::lens::embedded(name).ok_or_else(|| ShotError::Value {
        what: "lens".into(),
        found: format!("\"{name}\""),
        expected: "a name of `lens list`".into(),
    })?;
    let circle = prescription.image_circle.unwrap_or(43.2);
    let setting =
        Setting { focal_length: None, f_number: None, focus: Focus::Infinity, iris: None, film_mm: [0.8 * circle, 0.6 * circle] };
    let lens = CompoundLens::new(Arc::new(prescription), &setting).map_err(ShotError::from)?;
    let edge = (0.5 * circle / lens.focal_length().0).atan().to_degrees();
    Ok(section(&lens, vec![0.0, 0.7 * edge, edge]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_embedded_can_be_chosen() {
        let catalog = catalog(&Folders::default());
        let names = |key: &str| {
            catalog[key].as_array().unwrap().iter().map(|v| v["name"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
        };
        assert!(names("scenes").contains(&"still-life".to_owned()) && names("bodies").contains(&"canon-5d-mark-iv".to_owned()));
        assert_eq!(names("lenses").len(), diopter::lens::embedded_names().count());
        let zoom = &catalog["lenses"].as_array().unwrap().iter().find(|l| l["name"] == "kit-zoom-18-55mm").unwrap()["zoom_mm"];
        assert!(zoom[0].as_f64().unwrap() < zoom[1].as_f64().unwrap());
        // Every setting of the development, with its default where it has one.
        assert_eq!(catalog["settings"].as_array().unwrap().len(), SETTINGS.len());
        let curve = catalog["settings"].as_array().unwrap().iter().find(|s| s["name"] == "tone.curve").unwrap();
        assert_eq!((curve["allowed"]["kind"].as_str(), curve["default"].as_str()), (Some("names"), Some("aces-fit")));
        assert!(catalog["times"]["third"].as_array().unwrap().len() > 30);
    }

    #[test]
    fn lenses_are_drawn_by_name() {
        let svg = drawing_of("tessar-50mm-f2.8").unwrap();
        assert!(svg.starts_with("<svg") && svg.len() > 1000);
        assert!(drawing_of("planr").is_err() && drawing_of("/etc/passwd").is_err());
    }
}
