//! `scene list` and `scene info`.

use super::print_json;
use crate::args::SceneVerb;
use diopter::scene::light::PunctualKind;
use diopter::scene::scene::Sight;
use diopter::scene::{Scene, builtin};
use diopter::shot::read_scene;
use std::fmt::Write as _;
use std::io::Write;

pub fn run(verb: &SceneVerb, json: bool) -> anyhow::Result<()> {
    match verb {
        SceneVerb::List => list(json),
        SceneVerb::Info { scene } => info(scene, json),
    }
}

fn list(json: bool) -> anyhow::Result<()> {
    if json {
        let all: Vec<_> = builtin::NAMES.iter().map(|(n, what)| serde_json::json!({ "name": n, "shows": what })).collect();
        return print_json(&serde_json::json!(all));
    }
    for (name, what) in builtin::NAMES {
        writeln!(std::io::stdout(), "{name:<12} {what}")?;
    }
    Ok(())
}

fn info(name: &str, json: bool) -> anyhow::Result<()> {
    let scene = Scene::build(read_scene(name)?).map_err(diopter::shot::ShotError::from)?;
    let d = scene.description();
    let b = scene.bounds();
    let kind = |wanted: fn(&PunctualKind) -> bool| d.punctual.iter().filter(|p| wanted(&p.kind)).count();
    let points = kind(|k| matches!(k, PunctualKind::Point { .. }));
    let spots = kind(|k| matches!(k, PunctualKind::Spot { .. }));
    let directional = kind(|k| matches!(k, PunctualKind::Directional { .. } | PunctualKind::Disc { .. }));
    let power: f64 =
        scene.lights().area.iter().map(|l| (l.luminance * l.area()) as f64 * std::f64::consts::PI).sum::<f64>() + 0.0;
    let environment = d.environment.as_ref().map(|e| e.mean_luminance());
    let (meshes, hierarchy) = scene.memory();
    if json {
        let cameras: Vec<_> = d
            .cameras
            .iter()
            .map(|c| {
                serde_json::json!({
                    "name": c.name, "position_m": c.world_from_camera.translation.to_array(), "vertical_fov_rad": c.vertical_fov(), "sight": sight(c),
                })
            })
            .collect();
        return print_json(&serde_json::json!({
            "name": d.name, "triangles": scene.triangle_count(), "meshes": d.meshes.len(), "objects": d.objects.len(),
            "materials": d.materials.iter().map(|m| &m.name).collect::<Vec<_>>(),
            "bounds_m": (!b.is_empty()).then(|| [b.min.to_array(), b.max.to_array()]),
            "lights": { "emissive_surfaces": scene.lights().area.len(), "emissive_lm": power, "points": points, "spots": spots,
                "directional": directional, "environment_mean_cd_m2": environment },
            "cameras": cameras, "animations": d.animations.iter().map(|a| &a.name).collect::<Vec<_>>(),
            "memory_bytes": { "meshes": meshes, "hierarchy": hierarchy }, "warnings": d.warnings,
        }));
    }
    let mut text = String::new();
    let mut line = |what: &str, value: String| writeln!(text, "{what:<12} {value}");
    line("scene", d.name.clone())?;
    line("geometry", format!("{} triangles in {} meshes, {} objects", scene.triangle_count(), d.meshes.len(), d.objects.len()))?;
    if !b.is_empty() {
        line("bounds", format!("{} to {} m", b.min, b.max))?;
    }
    let names: Vec<&str> = d.materials.iter().map(|m| m.name.as_str()).collect();
    line("materials", format!("{}: {}", names.len(), names.join(", ")))?;
    line(
        "lights",
        format!(
            "{} emissive surfaces ({power:.0} lm), {points} points, {spots} spots, {directional} directional",
            scene.lights().area.len()
        ),
    )?;
    line("environment", environment.map_or("none".into(), |l| format!("mean {l:.1} cd/m²")))?;
    for c in &d.cameras {
        line("camera", format!("\"{}\" at {} m, {}", c.name, glam_point(c), sight(c)))?;
    }
    for a in &d.animations {
        let end = a.channels.iter().flat_map(|c| c.times_s.last()).copied().fold(0.0, f32::max);
        line("animation", format!("\"{}\", {} channels, {end:.2} s", a.name, a.channels.len()))?;
    }
    line("memory", format!("{:.1} MB meshes, {:.1} MB hierarchy", meshes as f64 / 1e6, hierarchy as f64 / 1e6))?;
    for w in &d.warnings {
        line("warning", w.clone())?;
    }
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

fn glam_point(c: &diopter::scene::scene::Viewpoint) -> String {
    let [x, y, z] = c.world_from_camera.translation.to_array();
    format!("[{x:.3}, {y:.3}, {z:.3}]")
}

fn sight(c: &diopter::scene::scene::Viewpoint) -> String {
    match &c.sight {
        Sight::Perspective { vertical_fov } => format!("{:.1}° high", vertical_fov.to_degrees()),
        Sight::Orthographic { height } => format!("orthographic, {height} m high"),
        Sight::Panorama => "all around".into(),
        Sight::Table(lens) => format!("through {} focused at {} m", lens.file, lens.focus_m),
    }
}
