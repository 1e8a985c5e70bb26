//! `calc tone`.

use crate::UsageError;
use crate::commands::print_json;
use anyhow::anyhow;
use diopter::develop::Recipe;
use diopter::develop::steps::tone::ToneCurve;
use diopter::light::color::RgbSpace;
use diopter::shot::ShotError;
use glam::Vec3;
use std::io::Write;

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(curve: &str, colours: &[String], keep_grey: bool, json: bool) -> anyhow::Result<()> {
    let mut recipe = Recipe::default().with("tone.curve", curve).map_err(ShotError::from)?;
    recipe.tone.keep_grey = keep_grey;
    let tone = ToneCurve::new(&recipe.tone, 1.0, RgbSpace::Srgb);
    let mut rows = Vec::new();
    for text in colours {
        let scene = colour(text)?;
        let light = tone.apply(scene).clamp(Vec3::ZERO, Vec3::ONE);
        let code = light.map(diopter::light::color::srgb_encode);
        rows.push((scene, light, code));
    }
    if json {
        let row = |(scene, light, code): &(Vec3, Vec3, Vec3)| serde_json::json!({ "scene": scene.to_array(), "light": light.to_array(), "code": code.to_array() });
        return print_json(&serde_json::json!({ "curve": curve, "colours": rows.iter().map(row).collect::<Vec<_>>() }));
    }
    let mut out = std::io::stdout();
    writeln!(out, "{:>30}   {:>26}   {:>26}", "scene, linear Rec.709", "display light", "sRGB code")?;
    for (scene, light, code) in rows {
        let three = |v: Vec3| format!("{:8.5} {:8.5} {:8.5}", v.x, v.y, v.z);
        writeln!(out, "{:>30}   {:>26}   {:>26}", three(scene), three(light), three(code))?;
    }
    Ok(())
}

/// A grey ("0.18") or a colour ("0.5,0.1,0.02").
fn colour(text: &str) -> anyhow::Result<Vec3> {
    let numbers: Option<Vec<f32>> = text.split(',').map(|n| n.trim().parse().ok().filter(|v: &f32| v.is_finite())).collect();
    match numbers.as_deref() {
        Some([v]) => Ok(Vec3::splat(*v)),
        Some([r, g, b]) => Ok(Vec3::new(*r, *g, *b)),
        _ => Err(UsageError(anyhow!("colour \"{text}\": expected one number or three such as 0.5,0.1,0.02")).into()),
    }
}
