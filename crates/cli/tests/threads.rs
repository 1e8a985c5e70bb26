//! Many threads in fresh processes: tables of materials that are computed when they are first asked for, locks and the pool of threads must
//! never wait for each other, and the picture does not depend on how many threads there are.
//!
//! Each process has its tables still to compute: threads of one process would find them ready after the first picture.

#[path = "it/common/mod.rs"]
mod common;

use common::Folder;
use serde_json::{Value, json};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// A picture of 24 × 16 takes a second or two; what takes so long waits for itself.
const DEADLOCK_AFTER: Duration = Duration::from_secs(60);
/// Fresh processes a scene.
const PROCESSES: usize = 15;

/// Waits for a process, no longer than `limit`; `None` when it had to be killed.
fn wait(child: &mut Child, limit: Duration) -> Option<ExitStatus> {
    let started = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return Some(status);
        }
        if started.elapsed() > limit {
            child.kill().unwrap();
            child.wait().unwrap();
            return None;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Takes the picture of a scene into `picture.jpg` and `picture.exr`; `false` when it never ended.
fn shoot(folder: &Path, scene: &str, more: &[&str], threads: &str) -> bool {
    let messages = std::fs::File::create(folder.join("messages.txt")).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_diopter"))
        .args(["shoot", scene, "--threads", threads, "--size", "24x16", "--spp", "4"])
        .args(["-o", "picture.jpg", "-o", "picture.exr"])
        .args(more)
        .current_dir(folder)
        .env("SOURCE_DATE_EPOCH", "1790000000")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(messages)
        .spawn()
        .unwrap();
    let Some(status) = wait(&mut child, DEADLOCK_AFTER) else { return false };
    let told = || std::fs::read_to_string(folder.join("messages.txt")).unwrap_or_default();
    assert!(status.success(), "{scene} with {threads} threads: {status}: {}", told());
    true
}

/// The same bytes from fresh processes of 16 threads as from one thread.
fn many_threads_are_one(folder: &Folder, scene: &str, more: &[&str]) {
    assert!(shoot(&folder.0, scene, more, "1"), "{scene} never ends with one thread");
    let one = ["picture.jpg", "picture.exr"].map(|name| folder.read(name));
    let mut deadlocks = 0;
    for _ in 0..PROCESSES {
        if shoot(&folder.0, scene, more, "16") {
            let many = ["picture.jpg", "picture.exr"].map(|name| folder.read(name));
            assert!(one == many, "{scene}: 16 threads make another picture than one");
        } else {
            deadlocks += 1;
        }
    }
    assert_eq!(deadlocks, 0, "{scene}: processes of {PROCESSES} that never ended");
}

/// A ball of radius 1 as a glTF buffer: positions (which are the normals), texture coordinates, tangents, triangles; with the buffer views
/// and accessors that say so.
fn ball() -> (Vec<u8>, Value, Value) {
    const AROUND: usize = 24;
    const DOWN: usize = 12;
    let (mut positions, mut uvs, mut tangents, mut triangles) = (vec![], vec![], vec![], vec![]);
    for row in 0..=DOWN {
        for column in 0..=AROUND {
            let (u, v) = (column as f32 / AROUND as f32, row as f32 / DOWN as f32);
            let (theta, phi) = (std::f32::consts::PI * v, std::f32::consts::TAU * u);
            positions.extend([theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()]);
            uvs.extend([u, v]);
            tangents.extend([-phi.sin(), 0.0, phi.cos(), 1.0]);
            if row < DOWN && column < AROUND {
                let a = (row * (AROUND + 1) + column) as u16;
                let below = a + AROUND as u16 + 1;
                // At the poles one of the two has no area.
                if row > 0 {
                    triangles.extend([a, a + 1, below]);
                }
                if row + 1 < DOWN {
                    triangles.extend([a + 1, below + 1, below]);
                }
            }
        }
    }
    let count = positions.len() / 3;
    let faces = triangles.len();
    let mut bytes: Vec<u8> = vec![];
    let mut views = vec![];
    for list in [&positions, &uvs, &tangents] {
        views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": 4 * list.len()}));
        bytes.extend(list.iter().flat_map(|v: &f32| v.to_le_bytes()));
    }
    views.push(json!({"buffer": 0, "byteOffset": bytes.len(), "byteLength": 2 * faces}));
    bytes.extend(triangles.iter().flat_map(|v: &u16| v.to_le_bytes()));
    let accessors = json!([
        {"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": count, "min": [-1.0, -1.0, -1.0], "max": [1.0, 1.0, 1.0]},
        {"bufferView": 1, "componentType": 5126, "type": "VEC2", "count": count},
        {"bufferView": 2, "componentType": 5126, "type": "VEC4", "count": count},
        {"bufferView": 3, "componentType": 5123, "type": "SCALAR", "count": faces},
    ]);
    (bytes, json!(views), accessors)
}

fn material(name: &str, roughness: f32, metallic: f32, extensions: Value) -> Value {
    json!({
        "name": name, "extensions": extensions,
        "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.7, 0.6, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness},
    })
}

fn glass(name: &str, roughness: f32, ior: f32, priority: Option<i32>, more: &[(&str, Value)]) -> Value {
    let mut extensions = json!({
        "KHR_materials_transmission": {"transmissionFactor": 1.0},
        "KHR_materials_ior": {"ior": ior},
        "KHR_materials_volume": {"thicknessFactor": 1.0, "attenuationDistance": 2.0, "attenuationColor": [0.8, 0.9, 0.7]},
    });
    more.iter().for_each(|(key, value)| extensions[*key] = value.clone());
    let mut m = material(name, roughness, 0.0, extensions);
    if let Some(priority) = priority {
        m["extras"] = json!({"priority": priority});
    }
    m
}

/// Balls of everything glTF can say, above a white ball as ground, under a lamp.
fn gltf(folder: &Path) {
    let (bytes, views, accessors) = ball();
    std::fs::write(folder.join("ball.bin"), &bytes).unwrap();
    let brushed = json!({"anisotropyStrength": 0.8, "anisotropyRotation": 0.5});
    let film = json!({"iridescenceFactor": 1.0, "iridescenceIor": 1.4, "iridescenceThicknessMaximum": 420.0});
    let cloth = json!({"sheenColorFactor": [0.6, 0.3, 0.4], "sheenRoughnessFactor": 0.5});
    let coat = json!({"clearcoatFactor": 1.0, "clearcoatRoughnessFactor": 0.3});
    let mut materials = vec![
        material("ground", 0.9, 0.0, json!({})),
        glass("brushed glass", 0.4, 1.5, None, &[("KHR_materials_anisotropy", brushed.clone())]),
        glass("cup", 0.2, 1.5, Some(2), &[]),
        glass("water", 0.1, 1.33, Some(1), &[]),
        glass("ice", 0.5, 1.31, Some(3), &[]),
        glass("flint", 0.15, 1.7, None, &[("KHR_materials_dispersion", json!({"dispersion": 0.8}))]),
        material("cloth", 0.8, 0.0, json!({"KHR_materials_sheen": cloth})),
        material("lacquer", 0.5, 0.0, json!({"KHR_materials_clearcoat": coat})),
        material("oxide", 0.3, 1.0, json!({"KHR_materials_iridescence": film})),
        material("steel", 0.35, 1.0, json!({"KHR_materials_anisotropy": brushed})),
        material("frosted sheet", 0.3, 0.0, json!({"KHR_materials_transmission": {"transmissionFactor": 0.7}})),
    ];
    let lamp = materials.len();
    let mut shining = material("lamp", 1.0, 0.0, json!({"KHR_materials_emissive_strength": {"emissiveStrength": 3000.0}}));
    shining["emissiveFactor"] = json!([1.0, 0.9, 0.8]);
    materials.push(shining);
    let mesh = |material: usize| {
        json!({"primitives": [{
            "attributes": {"POSITION": 0, "NORMAL": 0, "TEXCOORD_0": 1, "TANGENT": 2}, "indices": 3, "material": material,
        }]})
    };
    let meshes: Vec<Value> = (0..materials.len()).map(mesh).collect();
    let node = |mesh: usize, place: [f32; 3], size: f32| json!({"mesh": mesh, "translation": place, "scale": [size, size, size]});
    let mut nodes = vec![
        json!({"camera": 0, "translation": [0.0, 0.8, 7.0]}),
        json!({"extensions": {"KHR_lights_punctual": {"light": 0}}, "translation": [-3.0, 5.0, 4.0]}),
        node(0, [0.0, -51.0, 0.0], 50.0),
        node(lamp, [2.0, 5.0, 2.0], 0.6),
        // One in the other, and two that overlap: which body counts is a matter of priorities.
        node(2, [-1.2, 0.0, 1.0], 0.8),
        node(3, [-1.2, 0.0, 1.0], 0.7),
        node(4, [-0.9, 0.2, 1.2], 0.4),
    ];
    for (i, mesh) in [1, 5, 6, 7, 8, 9, 10].into_iter().enumerate() {
        let (row, column) = (i / 4, i % 4);
        nodes.push(node(mesh, [column as f32 * 1.5 - 2.2, row as f32 * 1.4 - 0.2, -1.0 - row as f32], 0.65));
    }
    let scene = json!({
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": (0..nodes.len()).collect::<Vec<_>>()}], "nodes": nodes,
        "extensionsUsed": [
            "KHR_materials_transmission", "KHR_materials_ior", "KHR_materials_volume", "KHR_materials_anisotropy",
            "KHR_materials_dispersion", "KHR_materials_sheen", "KHR_materials_clearcoat", "KHR_materials_iridescence",
            "KHR_materials_emissive_strength", "KHR_lights_punctual",
        ],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 2000.0}]}},
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.01}}],
        "buffers": [{"byteLength": bytes.len(), "uri": "ball.bin"}], "bufferViews": views, "accessors": accessors,
        "meshes": meshes, "materials": materials,
    });
    std::fs::write(folder.join("everything.gltf"), scene.to_string()).unwrap();
}

/// Everything pbrt can say, in thin smoke under an even sky.
const PBRT: &str = r#"
Film "rgb" "integer xresolution" 24 "integer yresolution" 16
LookAt 0 1 -8  0 0.3 0  0 1 0
Camera "perspective" "float fov" 40
WorldBegin
LightSource "infinite" "rgb L" [ 0.4 0.5 0.7 ]
AttributeBegin
  Translate 2 5 -2
  AreaLightSource "diffuse" "blackbody L" 3000 "float scale" 20
  Shape "sphere" "float radius" 0.5
AttributeEnd
MakeNamedMedium "smoke" "string type" "homogeneous" "rgb sigma_a" [ 0.1 0.1 0.2 ] "rgb sigma_s" [ 0.6 0.5 0.4 ] "float g" 0.5
MakeNamedMaterial "red" "string type" "diffuse" "rgb reflectance" [ 0.7 0.1 0.1 ]
MakeNamedMaterial "plastic" "string type" "coateddiffuse" "rgb reflectance" [ 0.2 0.5 0.7 ] "float roughness" 0.2
AttributeBegin
  Material "diffuse" "rgb reflectance" [ 0.6 0.6 0.6 ]
  Shape "bilinearmesh" "point3 P" [ -9 -1 -9  9 -1 -9  -9 -1 9  9 -1 9 ]
AttributeEnd
AttributeBegin
  Translate -3 0 0
  Material "dielectric" "spectrum eta" "glass-F11" "float uroughness" 0.4 "float vroughness" 0.1
  Shape "sphere" "float radius" 0.8
AttributeEnd
AttributeBegin
  Translate -1.2 0 0
  Material "coatedconductor" "float interface.roughness" 0.2 "float conductor.roughness" 0.1
  Shape "sphere" "float radius" 0.8
AttributeEnd
AttributeBegin
  Translate 0.6 0 0
  NamedMaterial "plastic"
  Shape "sphere" "float radius" 0.8
AttributeEnd
AttributeBegin
  Translate 2.4 0 0
  Material "conductor" "spectrum eta" "metal-Au-eta" "spectrum k" "metal-Au-k" "float uroughness" 0.3 "float vroughness" 0.05
  Shape "sphere" "float radius" 0.8
AttributeEnd
AttributeBegin
  Translate -2 1.6 1
  Material "mix" "string materials" [ "red" "plastic" ] "float amount" 0.5
  Shape "sphere" "float radius" 0.6
AttributeEnd
AttributeBegin
  Translate 0 1.6 1
  Material "diffusetransmission" "rgb reflectance" [ 0.3 0.3 0.3 ] "rgb transmittance" [ 0.4 0.5 0.3 ]
  Shape "sphere" "float radius" 0.6
AttributeEnd
AttributeBegin
  Translate 2 1.6 1
  Material "thindielectric" "float eta" 1.5
  Shape "sphere" "float radius" 0.6
AttributeEnd
AttributeBegin
  Translate 0 0 -2.5
  Material "interface"
  MediumInterface "smoke" ""
  Shape "sphere" "float radius" 0.7
AttributeEnd
AttributeBegin
  Translate 1.5 -0.4 -2
  Material "dielectric" "float eta" 1.5 "float roughness" 0.3
  MediumInterface "smoke" ""
  Shape "sphere" "float radius" 0.5
AttributeEnd
"#;

#[test]
fn sixteen_threads_in_fresh_processes_end_with_the_picture_of_one() {
    let folder = Folder::new("threads");
    gltf(&folder.0);
    many_threads_are_one(&folder, "everything.gltf", &["--fog", "40m"]);
    std::fs::write(folder.0.join("everything.pbrt"), PBRT).unwrap();
    many_threads_are_one(&folder, "everything.pbrt", &[]);
}
