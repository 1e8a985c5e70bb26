//! `scene list`, `scene info` and `scene convert`.

use super::{print_json, shown};
use crate::UsageError;
use crate::args::SceneVerb;
use crate::output::{Output, distinct};
use crate::watch::warn;
use anyhow::anyhow;
use diopter::camera::{look_at, three_quarter_view};
use diopter::scene::light::PunctualKind;
use diopter::scene::scene::{CameraProjection, Viewpoint};
use diopter::scene::{Description, Scene, Shape, builtin};
use diopter::shot::{odd_size, read_scene};
use std::collections::HashMap;
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Runs the command, prints what it found, and writes the files that were asked for. Fails with what the user is told.
pub fn run(verb: &SceneVerb, json: bool) -> anyhow::Result<()> {
    match verb {
        SceneVerb::List => list(json),
        SceneVerb::Info { scene, strict } => info(scene, *strict, json),
        SceneVerb::Convert { scene, output, strict } => convert(scene, output, *strict, json),
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

fn info(name: &str, strict: bool, json: bool) -> anyhow::Result<()> {
    let scene = Scene::build(read_scene(name, strict)?).map_err(diopter::shot::ShotError::from)?;
    let d = scene.description();
    let b = scene.bounds();
    let lights = lights(&scene);
    let environment = d.environment.as_ref().map(|e| e.mean_luminance());
    let (meshes, hierarchy) = scene.memory();
    let in_place: usize = d.objects.iter().map(|o| triangles(&scene, o)).sum();
    // Around a room the three-quarter view would stand behind its wall: embedded scenes know better.
    let view = builtin::framing(name).map(|f| [f.look_from, f.look_at]).or_else(|| suggested(b));
    let names_of_objects = names(d);
    if json {
        let cameras: Vec<_> = d
            .cameras
            .iter()
            .map(|c| {
                serde_json::json!({
                    "name": c.name, "position_m": c.world_from_camera.translation.to_array(), "vertical_fov_rad": c.vertical_fov(),
                    "sight": sight(c), "size": c.film.size, "shift": c.film.shift,
                })
            })
            .collect();
        let lights: Vec<_> = lights
            .iter()
            .map(|l| serde_json::json!({ "name": l.name, "kind": l.kind, "count": l.count, "amount": l.amount, "unit": l.unit }))
            .collect();
        return print_json(&serde_json::json!({
            "name": d.name, "triangles": scene.triangle_count(), "triangles_in_place": in_place,
            "curve_segments": scene.segment_count(), "splats": scene.splat_count(),
            "meshes": d.meshes.len(), "objects": d.objects.len(),
            "object_names": names_of_objects.iter().map(|n| n.0).collect::<Vec<_>>(),
            "materials": d.materials.iter().map(|m| &m.name).collect::<Vec<_>>(),
            "variants": d.variants.iter().map(|v| &v.name).collect::<Vec<_>>(),
            "bounds_m": (!b.is_empty()).then(|| [b.min.to_array(), b.max.to_array()]),
            "lights": lights, "environment_mean_cd_m2": environment, "max_depth": d.max_depth,
            "cameras": cameras, "animations": d.animations.iter().map(|a| &a.name).collect::<Vec<_>>(),
            "suggested": view.map(|[from, at]| serde_json::json!({ "look_from": from.to_array(), "look_at": at.to_array() })),
            "memory_bytes": { "meshes": meshes, "hierarchy": hierarchy }, "warnings": d.warnings,
        }));
    }
    let mut text = String::new();
    let mut line = |what: &str, value: String| writeln!(text, "{what:<12} {value}");
    line("scene", d.name.clone())?;
    let copies = if in_place == scene.triangle_count() { String::new() } else { format!(" ({in_place} with all copies)") };
    line(
        "geometry",
        format!("{} triangles in {} meshes, {} objects{copies}", scene.triangle_count(), d.meshes.len(), d.objects.len()),
    )?;
    if scene.segment_count() > 0 {
        line("curves", format!("{} segments in {} sets", scene.segment_count(), d.curves.len()))?;
    }
    if scene.splat_count() > 0 {
        line("splats", format!("{} Gaussians in {} sets", scene.splat_count(), d.splats.len()))?;
    }
    if !b.is_empty() {
        line("bounds", format!("{} to {} m", b.min, b.max))?;
    }
    let names: Vec<&str> = d.materials.iter().map(|m| m.name.as_str()).collect();
    line("materials", format!("{}: {}", names.len(), names.join(", ")))?;
    if !names_of_objects.is_empty() {
        let more = names_of_objects.len().saturating_sub(MOST_NAMES);
        let mut listed: Vec<String> = names_of_objects
            .iter()
            .take(MOST_NAMES)
            .map(|(name, count)| if *count > 1 { format!("{name} ({count})") } else { (*name).to_owned() })
            .collect();
        if more > 0 {
            listed.push(format!("and {more} more (--json lists all)"));
        }
        line("objects", listed.join(", "))?;
    }
    if !d.variants.is_empty() {
        let names: Vec<&str> = d.variants.iter().map(|v| v.name.as_str()).collect();
        line("variants", names.join(", "))?;
    }
    if lights.is_empty() && environment.is_none() {
        line("lights", "none: shoot puts a studio around it (--light, --environment, --daylight or --sun for another)".into())?;
    }
    for l in lights.iter().take(MOST_LIGHTS) {
        let count = if l.count > 1 { format!(" ({} surfaces)", l.count) } else { String::new() };
        line("light", format!("\"{}\", {}{count}, {} {}", l.name, l.kind, shown(l.amount), l.unit))?;
    }
    if lights.len() > MOST_LIGHTS {
        line("", format!("and {} more lights", lights.len() - MOST_LIGHTS))?;
    }
    line("environment", environment.map_or("none".into(), |l| format!("mean {} cd/m²", shown(f64::from(l)))))?;
    if let Some(air) = &d.air {
        let name = if air.medium.name.is_empty() { "a medium" } else { &air.medium.name };
        line("air", format!("filled with {name}"))?;
    }
    for c in &d.cameras {
        let size = c.film.size.map_or(String::new(), |[w, h]| format!(", {w}x{h}"));
        line("camera", format!("\"{}\" at {} m, {}{size}", c.name, glam_point(c), sight(c)))?;
    }
    if let Some([from, at]) = view.filter(|_| d.cameras.is_empty()) {
        let text = |v: glam::Vec3| format!("{},{},{}", shown(v.x.into()), shown(v.y.into()), shown(v.z.into()));
        line("suggested", format!("--look-from {} --look-at {}", text(from), text(at)))?;
    }
    for a in &d.animations {
        let end = a.channels.iter().flat_map(|c| c.times_s.last()).copied().fold(0.0, f32::max);
        line("animation", format!("\"{}\", {} channels, {end:.2} s", a.name, a.channels.len()))?;
    }
    if let Some(depth) = d.max_depth {
        line("max depth", format!("{depth}: what the file asks for; give --max-depth for another than ours"))?;
    }
    line("memory", format!("{:.1} MB meshes, {:.1} MB hierarchy", meshes as f64 / 1e6, hierarchy as f64 / 1e6))?;
    for w in d.warnings.iter().chain(&odd_size(name, d)) {
        line("warning", w.clone())?;
    }
    write!(std::io::stdout(), "{text}")?;
    Ok(())
}

/// Most lights that are listed one by one.
const MOST_LIGHTS: usize = 20;

/// Most names of objects that are listed.
const MOST_NAMES: usize = 40;

/// Names that `--focus on` takes, in the order of the file, and how many objects have each: of objects, then of other nodes.
fn names(d: &Description) -> Vec<(&str, usize)> {
    let mut found: Vec<(&str, usize)> = Vec::new();
    let mut place: HashMap<&str, usize> = HashMap::new();
    let objects = d.objects.iter().map(|o| (o.name.as_str(), 1));
    let nodes = d.nodes.iter().map(|n| (n.name.as_str(), 0));
    for (name, count) in objects.chain(nodes).filter(|n| !n.0.is_empty()) {
        let at = *place.entry(name).or_insert(found.len());
        if at == found.len() {
            found.push((name, 0));
        }
        found[at].1 += count;
    }
    found
}

/// What shines, and how much.
struct Shining {
    name: String,
    kind: &'static str,
    count: usize,
    amount: f64,
    unit: &'static str,
}

fn lights(scene: &Scene) -> Vec<Shining> {
    let d = scene.description();
    // Lamps by material: flux of Lambert's emitters is π L A.
    let mut by_material: std::collections::BTreeMap<u32, (usize, f64)> = Default::default();
    for light in &scene.lights().area {
        let sides = if light.two_sided { 2.0 } else { 1.0 };
        let entry = by_material.entry(light.material).or_default();
        entry.0 += 1;
        entry.1 += f64::from(light.luminance * light.area()) * std::f64::consts::PI * sides;
    }
    let areas = by_material.into_iter().map(|(material, (count, lumens))| Shining {
        name: d.materials[material as usize].name.clone(),
        kind: "area",
        count,
        amount: lumens,
        unit: "lm",
    });
    let punctual = d.punctual.iter().map(|p| {
        let (kind, unit) = match p.kind {
            PunctualKind::Point { .. } if p.pattern.is_some() => ("picture", "cd"),
            PunctualKind::Point { .. } => ("point", "cd"),
            PunctualKind::Spot { .. } => ("spot", "cd"),
            PunctualKind::Directional { .. } => ("directional", "lx"),
            PunctualKind::Disc { .. } => ("sun", "lx"),
        };
        Shining { name: p.name.clone(), kind, count: 1, amount: f64::from(p.illuminance()), unit }
    });
    areas.chain(punctual).collect()
}

fn triangles(scene: &Scene, object: &diopter::scene::Object) -> usize {
    match object.shape {
        Shape::Mesh { mesh, .. } => scene.description().meshes[mesh as usize].triangles.len(),
        _ => 0,
    }
}

/// A three-quarter view of all of it with a 50 mm lens on 36 × 24 mm: from where, at what.
fn suggested(b: diopter::scene::bvh::Bounds) -> Option<[glam::Vec3; 2]> {
    if b.is_empty() {
        return None;
    }
    let radius = (0.5 * b.size().length()).max(1e-3);
    Some([b.center() + three_quarter_view(radius, (12.0f32 / 50.0).atan()), b.center()])
}

fn convert(name: &str, output: &Path, strict: bool, json: bool) -> anyhow::Result<()> {
    let mut description = read_scene(name, strict)?;
    if let Some(f) = builtin::framing(name).filter(|_| description.cameras.is_empty()) {
        // Embedded scenes have a view, not a camera.
        let place = look_at(f.look_from, f.look_at, glam::Vec3::Y).map_err(diopter::shot::ShotError::from)?;
        let vertical_fov = 2.0 * (12.0 / f.focal_length_mm as f32).atan();
        description.cameras.push(Viewpoint {
            name: "view".into(),
            world_from_camera: place,
            sight: CameraProjection::Perspective { vertical_fov },
            lens: None,
            film: Default::default(),
            node: None,
        });
    }
    let warnings = description.warnings.clone();
    let written = diopter::scene::save::gltf(&description);
    let ending = output.extension().map(|e| e.to_string_lossy().to_lowercase());
    let files: Vec<(PathBuf, Vec<u8>)> = match ending.as_deref() {
        Some("glb") => vec![(output.to_owned(), written.container())],
        Some("gltf") => {
            let binary = output.with_extension("bin");
            let beside = binary.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
            vec![(output.to_owned(), written.text(&beside).into_bytes()), (binary, written.binary.clone())]
        }
        _ => return Err(UsageError(anyhow!("output {}: expected a name that ends in .glb or .gltf", output.display())).into()),
    };
    let source = Path::new(name);
    let mut read = vec![source.to_owned()];
    if source.extension().is_some_and(|e| e.eq_ignore_ascii_case("gltf")) {
        // Buffers beside it may be its own.
        let beside = std::fs::read_dir(source.with_file_name(".")).into_iter().flatten().flatten().map(|e| e.path());
        read.extend(beside.filter(|p| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("bin"))));
    }
    distinct(read.iter().map(PathBuf::as_path), files.iter().map(|f| f.0.as_path()))?;
    let prepared = files.iter().map(|(path, _)| Output::prepare(path)).collect::<Result<Vec<_>, _>>()?;
    for w in warnings.iter().chain(&written.warnings) {
        warn(w);
    }
    for (output, (_, bytes)) in prepared.into_iter().zip(&files) {
        output.commit(|to| Ok(to.write_all(bytes)?))?;
    }
    let names: Vec<String> = files.iter().map(|f| f.0.display().to_string()).collect();
    if json {
        return print_json(&serde_json::json!({ "files": names, "warnings": written.warnings }));
    }
    writeln!(std::io::stdout(), "wrote {}", names.join(" and "))?;
    Ok(())
}

fn glam_point(c: &diopter::scene::scene::Viewpoint) -> String {
    let [x, y, z] = c.world_from_camera.translation.to_array();
    format!("[{x:.3}, {y:.3}, {z:.3}]")
}

fn sight(c: &diopter::scene::scene::Viewpoint) -> String {
    let sees = match &c.sight {
        CameraProjection::Perspective { vertical_fov } => format!("{:.1}° high", vertical_fov.to_degrees()),
        CameraProjection::Orthographic { height } => format!("orthographic, {height} m high"),
        CameraProjection::Panorama => "all around".into(),
        CameraProjection::Table(lens) => format!("through {} focused at {} m", lens.file, lens.focus_m),
    };
    match c.film.shift {
        [0.0, 0.0] => sees,
        [x, y] => format!("{sees}, shifted by {x:.3} and {y:.3} heights to the right and up"),
    }
}
