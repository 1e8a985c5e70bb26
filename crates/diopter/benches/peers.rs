//! Renders a scene of the peers' drivers (`scene.json` and PLY files) and prints one JSON line, as they do.
//!
//! `cargo bench -p diopter --bench peers -- FOLDER SCENE SPP [--out X.npy] [--seed N] [--sampler sobol] [--integrator auto] [--rgb] [--roulette N] [--nk ETA K]`
//! Radiance is written as linear sRGB, h × w × 3 float32. Without arguments (as under a plain `cargo bench`) it says how it
//! is called and ends.

use diopter::image::{ExposureFacts, Raster};
use diopter::lens::{Focus, Iris, Lens, Pinhole, ThinLens};
use diopter::light::random::SamplerKind;
use diopter::light::units::Millimeters;
use diopter::light::{Spectrum, spectrum::Table};
use diopter::scene::light::Environment;
use diopter::scene::material::conductor::FacetBounces;
use diopter::scene::material::{Conductor, Material, Scattering};
use diopter::scene::shape::Mesh;
use diopter::scene::texture::Color;
use diopter::scene::{Description, Object, Scene, Shape};
use diopter::{
    Camera, CameraMotion, Film, Integrator, Response, Settings, Shutter, camera::look_at, expose, expose::ProgressReporter,
};
use glam::{Affine3A, Mat3, Vec3};
use serde_json::Value;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

fn main() {
    let args: Vec<String> = std::env::args().skip(1).filter(|a| a != "--bench").collect();
    if args.len() < 3 {
        println!(
            "peers: FOLDER SCENE SPP [--out X.npy] [--seed N] [--sampler NAME] [--integrator NAME] [--rgb] [--roulette N] [--threads N]"
        );
        return;
    }
    let option = |name: &str| args.iter().position(|a| a == name).map(|i| args[i + 1].clone());
    let folder = Path::new(&args[0]).join(&args[1]);
    let spp: u32 = args[2].parse().expect("SPP is a number");
    let seed = option("--seed").map_or(1, |s| s.parse().expect("a seed"));
    let threads: usize = option("--threads").map_or(2, |s| s.parse().expect("a number of threads"));
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().expect("first pool");
    let text = std::fs::read_to_string(folder.join("scene.json")).expect("scene.json is readable");
    let json: Value = serde_json::from_str(&text).expect("scene.json is JSON");

    let start = Instant::now();
    let mut description = describe(&json, &folder);
    if let Some(i) = args.iter().position(|a| a == "--nk") {
        use_constants(&mut description, Path::new(&args[i + 1]), Path::new(&args[i + 2]));
    }
    let loaded = start.elapsed().as_secs_f64();
    let before_build = peak_memory();
    let scene = Scene::build(description).expect("the scene builds");
    let built = start.elapsed().as_secs_f64();
    let after_build = peak_memory();
    let (meshes, hierarchy) = scene.memory();
    let camera = camera(&json["camera"], &json["res"]);

    let mut settings = Settings::new(spp);
    settings.seed = seed;
    settings.truth = false;
    settings.path.max_depth = json["depth"].as_u64().expect("depth") as u32;
    if let Some(r) = option("--roulette") {
        settings.path.roulette_depth = r.parse().expect("a depth");
    }
    settings.sampler = match option("--sampler").as_deref() {
        Some("independent") => SamplerKind::Independent,
        Some("jittered") => SamplerKind::Jittered,
        Some("grid") => SamplerKind::Grid,
        _ => SamplerKind::Sobol,
    };
    settings.rgb = args.iter().any(|a| a == "--rgb");
    if let Some(name) = option("--integrator") {
        settings.integrator = Integrator::by_name(&name).expect("the name of an integrator");
    }
    let shutter = Shutter::global(1.0);
    let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
    let (wall, cpu) = (Instant::now(), processor_seconds());
    let plane = expose(&scene, &camera, &shutter, &Response::linear_srgb(), &settings, &ExposureFacts::default(), &watch)
        .expect("nothing stops it");
    let (wall, cpu) = (wall.elapsed().as_secs_f64(), processor_seconds() - cpu);

    if let Some(out) = option("--out") {
        write_npy(Path::new(&out), &plane.mean);
    }
    let samples = (plane.width() * plane.height()) as f64 * spp as f64;
    let mean = |c: usize| plane.mean.channel(c).iter().map(|v| *v as f64).sum::<f64>() / (plane.width() * plane.height()) as f64;
    let triangles = scene.triangle_count();
    println!(
        "JSON {}",
        serde_json::json!({
            "renderer": "diopter", "scene": args[1], "spp": spp, "seed": seed, "threads": threads, "triangles": triangles,
            "load_s": loaded, "load_and_build_s": built, "render_s": wall, "render_cpu_s": cpu,
            "msamples_core_s": samples / cpu / 1e6, "mean_rgb": [mean(0), mean(1), mean(2)],
            "mesh_bytes_a_triangle": meshes as f64 / triangles as f64,
            "hierarchy_bytes_a_triangle": hierarchy as f64 / triangles as f64,
            "peak_build_bytes_a_triangle": (after_build.saturating_sub(before_build)) as f64 / triangles as f64,
        })
    );
}

fn numbers(v: &Value) -> Vec<f32> {
    v.as_array().expect("a list").iter().map(|x| x.as_f64().expect("a number") as f32).collect()
}

fn vec3(v: &Value) -> Vec3 {
    Vec3::from_slice(&numbers(v))
}

fn describe(json: &Value, folder: &Path) -> Description {
    let mut d = Description { name: "peers".into(), ..Default::default() };
    let mut names = Vec::new();
    for (name, m) in json["materials"].as_object().expect("materials") {
        let scattering = match m["type"].as_str() {
            Some("diffuse") => {
                let c = vec3(&m["rgb"]);
                Scattering::Diffuse(Color::rgb(c.x, c.y, c.z))
            }
            _ => Scattering::Conductor(gold(m["alpha"].as_f64().expect("alpha") as f32)),
        };
        names.push(name.clone());
        d.materials.push(Material::new(name, scattering));
    }
    for o in json["objects"].as_array().expect("objects") {
        let material = match o.get("material") {
            Some(name) => names.iter().position(|n| n == name.as_str().expect("a name")).expect("known") as u32,
            None => {
                d.materials.push(Material::lamp("light", Spectrum::light_from_rgb(vec3(&o["emission"]))));
                d.materials.len() as u32 - 1
            }
        };
        let name = o["ply"].as_str().expect("a file");
        d.meshes.push(read_ply(&folder.join(name)).into());
        let shape = Shape::Mesh { mesh: d.meshes.len() as u32 - 1, world_from_mesh: Affine3A::IDENTITY };
        d.objects.push(Object::new(name, shape, material));
    }
    if let Some(hdr) = json["env"]["hdr"].as_str() {
        let map = diopter::scene::load::read_light(&std::fs::read(folder.join(hdr)).expect("readable")).expect("an HDR file");
        // The peers' worlds have z up.
        d.environment = Some(Environment::new(map, Mat3::from_rotation_x(std::f32::consts::FRAC_PI_2), 1.0));
    }
    d
}

/// Gives all metals the optical constants of two files of `nm value` lines: to compare with a peer on its own gold.
fn use_constants(d: &mut Description, eta: &Path, k: &Path) {
    let read = |path: &Path| {
        let text = std::fs::read_to_string(path).expect("readable");
        let pair = |l: &str| {
            let mut cells = l.split_whitespace().map(|c| c.parse::<f32>().ok());
            Some((cells.next()??, cells.next()??))
        };
        Spectrum::Table(Table::from_points(&text.lines().filter_map(pair).collect::<Vec<_>>()))
    };
    for material in &mut d.materials {
        if let Scattering::Conductor(c) = &mut material.scattering {
            (c.n, c.k) = (read(eta), read(k));
        }
    }
}

/// Gold without facet bounces, as in the peers.
fn gold(alpha: f32) -> Conductor {
    Conductor { bounces: FacetBounces::Lost, ..Conductor::metal("gold", alpha).expect("gold is known") }
}

/// Binary little-endian PLY of float vertices and triangle faces, as the peers' generator writes it.
fn read_ply(path: &Path) -> Mesh {
    let bytes = std::fs::read(path).expect("readable");
    let end = bytes.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
    let header = std::str::from_utf8(&bytes[..end]).expect("text");
    let count = |what: &str| -> usize {
        header.lines().find_map(|l| l.strip_prefix(what)).expect("a count").trim().parse().expect("a number")
    };
    let (vertices, faces) = (count("element vertex "), count("element face "));
    let float = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    let body = &bytes[end..];
    let positions = body[..vertices * 12].chunks_exact(12).map(|b| Vec3::new(float(b), float(&b[4..]), float(&b[8..]))).collect();
    let int = |b: &[u8]| u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    let triangles =
        body[vertices * 12..][..faces * 13].chunks_exact(13).map(|b| [int(&b[1..]), int(&b[5..]), int(&b[9..])]).collect();
    Mesh { positions, triangles, ..Default::default() }
}

fn camera(c: &Value, res: &Value) -> Camera {
    let number = |key: &str| c[key].as_f64().expect("a number");
    let (columns, rows) = (res[0].as_u64().expect("width") as usize, res[1].as_u64().expect("height") as usize);
    let width = number("sensor_w_mm");
    let (focal, stop, focus) = (number("focal_mm"), number("fstop"), number("focus_m"));
    // The peers' field of view is that of the focal length whatever the focus: choose the lens that images so.
    let lens = if stop == 0.0 {
        Lens::Pinhole(Pinhole::new(Millimeters(focal), 8.0).expect("a pinhole"))
    } else {
        let s = focus * 1000.0;
        let f = focal * s / (focal + s);
        let n = f / (focal / stop);
        Lens::Thin(ThinLens::new(Millimeters(f), n, Iris::Round, Focus::Distance(Millimeters(s))).expect("a lens"))
    };
    Camera {
        lens,
        film: Film::new(width, width * rows as f64 / columns as f64, columns, rows),
        motion: CameraMotion::still(look_at(vec3(&c["origin"]), vec3(&c["target"]), vec3(&c["up"])).expect("a place")),
    }
}

fn write_npy(path: &Path, image: &Raster<f32>) {
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}, {}, 3), }}", image.height, image.width);
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.bytes());
    bytes.extend(image.data.iter().flat_map(|v| v.to_le_bytes()));
    std::fs::write(path, bytes).expect("writable");
}

/// Peak resident memory of this process, bytes (Linux; 0 elsewhere).
fn peak_memory() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap_or("0 kB");
    line.trim().trim_end_matches(" kB").parse::<usize>().unwrap_or(0) * 1024
}

/// User and system time of this process, s (Linux; wall time elsewhere).
fn processor_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    // utime and stime, in ticks of 1/100 s.
    fields
        .get(11)
        .zip(fields.get(12))
        .map_or(0.0, |(u, s)| (u.parse::<f64>().unwrap_or(0.0) + s.parse::<f64>().unwrap_or(0.0)) / 100.0)
}
