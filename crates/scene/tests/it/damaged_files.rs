//! Files of every reader, damaged by chance: an error or a scene that can be built, never a panic and never a hang.
//!
//! A fixed seed makes the same damage every time. Longer runs, also from files of one's own (folders named after the readers below):
//! `MUTATIONS=1000000 SEEDS=folder cargo test --release -p diopter-scene --test it damaged_files`. `fuzz/` has the same readers for `cargo fuzz`.

use diopter_scene::light::photometry::Web;
use diopter_scene::load::{gltf, mesh, mitsuba, nanovdb, obj, pbrt, read_measured, sheet, splats, usd};
use diopter_scene::{Description, Scene, SceneError};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::{Duration, Instant};

/// Damaged files of each reader where nothing else is said.
const MUTATIONS: usize = 300;
/// Longest that a small file may take, on a machine that does other things, too.
const LONGEST: Duration = Duration::from_secs(20);

/// Builds a scene. Large ones are slow to build, not different.
fn built(read: Result<Description, SceneError>) {
    let Ok(d) = read else { return };
    let triangles: usize = d.meshes.iter().map(|m| m.triangles.len()).sum();
    if triangles < 1 << 14 && d.objects.len() < 256 {
        let _ = Scene::build(d);
    }
}

fn read(reader: &str, bytes: &[u8]) {
    // Files that are referred to hold the same bytes, once: scenes of scenes of scenes are only large.
    let fetched = std::sync::atomic::AtomicUsize::new(0);
    let fetch = |_: &str| match fetched.fetch_add(1, std::sync::atomic::Ordering::Relaxed) {
        0..4 => Ok(bytes.to_vec()),
        _ => Err("no more files".into()),
    };
    match reader {
        "usd" => built(usd::load(bytes.to_vec(), "x.usd", &fetch)),
        "gltf" => built(gltf::load(bytes, "x.gltf", &fetch)),
        "pbrt" => built(pbrt::load(bytes, "x.pbrt", &fetch)),
        "mitsuba" => built(mitsuba::load(bytes, "x.xml", &fetch)),
        "obj" => built(obj::obj(bytes, "x.obj", &fetch)),
        "ply" => built(mesh::ply(bytes.to_vec(), "x.ply")),
        "stl" => built(mesh::stl(bytes, "x.stl")),
        "spz" => built(splats::spz(bytes.to_vec(), "x.spz")),
        "sheet" => built(sheet::load(bytes, "x.toml")),
        "measured" => drop(read_measured(bytes)),
        "nanovdb" => {
            if let Ok(file) = nanovdb::File::open(bytes) {
                let names: Vec<String> = file.names().take(4).map(str::to_owned).collect();
                names.iter().for_each(|name| drop(file.read(name)));
            }
        }
        "ies" => {
            if let Ok(web) = Web::read(bytes) {
                assert!(web.lumens().is_finite() && web.peak() > 0.0, "a lamp of {} lm", web.lumens());
            }
        }
        other => panic!("a reader {other}"),
    }
}

/// SplitMix64 (G. Steele et al. 2014).
struct Chance(u64);

impl Chance {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ self.0 >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n.max(1) as u64) as usize
    }
}

/// Numbers that readers of text may trip over.
const WORDS: [&[u8]; 14] = [
    b"0",
    b"-1",
    b"1e38",
    b"-1e-38",
    b"nan",
    b"inf",
    b"4294967295",
    b"2147483648",
    b"18446744073709551615",
    b"\"",
    b"[",
    b"]",
    b"{",
    b"<",
];

fn damaged(whole: &[u8], all: &[Vec<u8>], chance: &mut Chance) -> Vec<u8> {
    let mut b = whole.to_vec();
    for _ in 0..1 + chance.below(4) {
        let at = chance.below(b.len());
        let longest = 1 << chance.below(8);
        let length = chance.below(longest);
        let end = (at + length).min(b.len());
        match chance.below(10) {
            0 => b.truncate(at),
            1 => drop(b.drain(at..end)),
            2 => {
                let copy = b[at..end].to_vec();
                let to = chance.below(b.len());
                b.splice(to..to, copy);
            }
            3 => {
                let other = &all[chance.below(all.len())];
                let from = chance.below(other.len());
                let part = other[from..(from + length).min(other.len())].to_vec();
                b.splice(at..at, part);
            }
            4 => drop(b.splice(at..at, WORDS[chance.below(WORDS.len())].iter().copied())),
            5 => {
                // A number of text becomes another.
                let digits = b[at..].iter().position(u8::is_ascii_digit).map(|i| at + i);
                if let Some(first) = digits {
                    let last = b[first..].iter().position(|c| !c.is_ascii_digit()).map_or(b.len(), |i| first + i);
                    b.splice(first..last, WORDS[chance.below(9)].iter().copied());
                }
            }
            6 if b.len() >= 8 => {
                // A number of 32 or 64 bits, as large files have.
                let at = at.min(b.len() - 8);
                let value = [0, 1, u64::MAX, 1 << 31, 1 << 20, 0x7f80_0000, 0x7fc0_0000, 0x8000_0000_0000_0000][chance.below(8)];
                let width = if chance.below(2) == 0 { 4 } else { 8 };
                b[at..at + width].copy_from_slice(&value.to_le_bytes()[..width]);
            }
            7 | 8 if !b.is_empty() => b[at] ^= 1 << chance.below(8),
            _ if !b.is_empty() => b[at] = chance.next() as u8,
            _ => (),
        }
    }
    b
}

fn survives(reader: &str, own: &[&[u8]]) {
    let count = std::env::var("MUTATIONS").ok().and_then(|n| n.parse().ok()).unwrap_or(MUTATIONS);
    let mut seeds: Vec<Vec<u8>> = own.iter().map(|b| b.to_vec()).collect();
    if let Ok(folder) = std::env::var("SEEDS") {
        let files = std::fs::read_dir(std::path::Path::new(&folder).join(reader)).into_iter().flatten().flatten();
        let mut files: Vec<_> = files.map(|f| f.path()).collect();
        files.sort();
        seeds.extend(files.iter().filter_map(|f| std::fs::read(f).ok()));
    }
    for (i, seed) in seeds.iter().enumerate().filter(|(i, _)| *i < own.len()) {
        assert!(catch_unwind(AssertUnwindSafe(|| read(reader, seed))).is_ok(), "{reader}: file {i} as it is");
    }
    let mut chance = Chance(reader.bytes().map(u64::from).sum());
    for round in 0..count {
        let whole = &seeds[chance.below(seeds.len())];
        let bytes = damaged(whole, &seeds, &mut chance);
        let start = Instant::now();
        let fine = catch_unwind(AssertUnwindSafe(|| read(reader, &bytes))).is_ok();
        if !fine || start.elapsed() > LONGEST {
            let file = std::env::temp_dir().join(format!("damaged-{reader}-{round}"));
            std::fs::write(&file, &bytes).unwrap();
            let what = if fine { "too slow" } else { "a panic" };
            panic!("{reader}, round {round}: {what} ({:?}): {}", start.elapsed(), file.display());
        }
    }
}

#[test]
fn usd_files() {
    let own = [&include_bytes!("../../src/load/usd/tests/box.usda")[..], include_bytes!("../../src/load/usd/tests/box.usdc")];
    let skin = b"#usda 1.0\ndef SkelRoot \"R\" { rel skel:skeleton = </R/S>\nrel skel:animationSource = </R/A>\ndef Skeleton \"S\" { uniform token[] joints = [\"a\", \"a/b\"]\n\
        uniform matrix4d[] bindTransforms = [( (1,0,0,0), (0,1,0,0), (0,0,1,0), (0,0,0,1) ), ( (1,0,0,0), (0,1,0,0), (0,0,1,0), (1,0,0,1) )] }\n\
        def SkelAnimation \"A\" { uniform token[] joints = [\"a/b\"]\nquatf[] rotations.timeSamples = { 0: [(1,0,0,0)], 9: [(0.6,0,0,0.8)] }\nuniform token[] blendShapes = [\"u\"]\nfloat[] blendShapeWeights.timeSamples = { 0: [0], 5: [1] } }\n\
        def Mesh \"M\" { int[] faceVertexCounts = [4]\nint[] faceVertexIndices = [0, 1, 2, 3]\npoint3f[] points = [(0,0,0), (1,0,0), (1,1,0), (0,1,0)]\n\
        int[] primvars:skel:jointIndices = [0, 1, 1, 0] ( interpolation = \"vertex\" )\nfloat[] primvars:skel:jointWeights = [1, 1, 0.5, 1] ( interpolation = \"vertex\" )\n\
        uniform token[] skel:blendShapes = [\"u\"]\nrel skel:blendShapeTargets = <u>\ndef BlendShape \"u\" { uniform vector3f[] offsets = [(0,0,1)]\nuniform int[] pointIndices = [2] }\n\
        rel material:binding = </R/L> }\ndef Material \"L\" { token outputs:surface.connect = </R/L/P.outputs:surface>\ndef Shader \"P\" { token info:id = \"UsdPreviewSurface\"\nfloat inputs:displacement = 0.1 } } }";
    survives("usd", &[own[0], own[1], skin]);
}

#[test]
fn gltf_files() {
    let splat = |width: usize| (0..width).map(|i| format!("{}", i * 7)).collect::<Vec<_>>().join(",");
    let json = format!(
        r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":["KHR_gaussian_splatting"],"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0,"scale":[1,2,1]}}],
        "meshes":[{{"primitives":[{{"mode":0,"attributes":{{"POSITION":0,"KHR_gaussian_splatting:ROTATION":1,"KHR_gaussian_splatting:SCALE":0,"KHR_gaussian_splatting:OPACITY":2,
        "KHR_gaussian_splatting:SH_DEGREE_0_COEF_0":0}},"extensions":{{"KHR_gaussian_splatting":{{"kernel":"ellipse","colorSpace":"srgb_rec709_display"}}}}}}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":2,"type":"VEC3","min":[0,0,0],"max":[1,1,1]}},{{"bufferView":0,"componentType":5126,"count":2,"type":"VEC4"}},
        {{"bufferView":0,"componentType":5126,"count":2,"type":"SCALAR"}}],"bufferViews":[{{"buffer":0,"byteLength":48,"byteOffset":0}}],
        "buffers":[{{"byteLength":48,"uri":"data:application/octet-stream;base64,{}"}}],"extras":[{}]}}"#,
        "AACAPwAAAD8AAIA+".repeat(6),
        splat(4)
    );
    survives("gltf", &[json.as_bytes()]);
}

#[test]
fn splat_files() {
    let names = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2",
        "rot_3",
    ];
    let header: String = names.iter().map(|n| format!("property float {n}\n")).collect();
    let ply = |format: &str, body: Vec<u8>| {
        [format!("ply\nformat {format} 1.0\nelement vertex 2\n{header}end_header\n").into_bytes(), body].concat()
    };
    let numbers = || (0..28).map(|i| i as f32 * 0.25 - 3.0);
    let text = ply("ascii", numbers().map(|v| format!("{v} ")).collect::<String>().into_bytes());
    let binary = ply("binary_little_endian", numbers().flat_map(f32::to_le_bytes).collect());
    let polygons = b"ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nelement face 1\nproperty list uchar int vertex_indices\n\
        end_header\n0 0 0 1\n1 0 0 2\n1 1 0 3\n0 1 0 4\n4 0 1 2 3\n";
    // Once an overflow: a property whose number is as large as one can be.
    let far = String::from_utf8_lossy(&text).replace("scale_2", "scale_18446744073709551615").into_bytes();
    survives("ply", &[&text, &binary, polygons, &far]);
    let spz = |version: u32, degree: u8, harmonics: usize| {
        let n = 3;
        let mut b = [0x5053_474eu32.to_le_bytes(), version.to_le_bytes(), (n as u32).to_le_bytes(), [degree, 12, 0, 0]].concat();
        b.extend((0..n * (9 + 1 + 3 + 3 + if version == 2 { 3 } else { 4 } + harmonics)).map(|i| (i * 37) as u8));
        b
    };
    let all = [spz(2, 0, 0), spz(3, 0, 0), spz(2, 1, 9), spz(3, 3, 45)];
    survives("spz", &all.each_ref().map(Vec::as_slice));
}

#[test]
fn pbrt_and_mitsuba_files() {
    let hair = b"LookAt 0 0 5 0 0 0 0 1 0\nCamera \"perspective\" \"float fov\" 40\nWorldBegin\nMakeNamedMedium \"u\" \"string type\" \"uniformgrid\" \"float density\" [1 2 3 4 5 6 7 8] \"integer nx\" 2 \"integer ny\" 2 \"integer nz\" 2\n\
        LightSource \"infinite\" \"rgb L\" [1 1 1]\nAttributeBegin\nMaterial \"hair\" \"float eumelanin\" 1.3 \"float beta_m\" .3\nShape \"curve\" \"point3 P\" [0 0 0 1 0 0 1 1 0 2 1 0] \"string type\" \"cylinder\" \"float width0\" .1\n\
        Shape \"curve\" \"string basis\" \"bspline\" \"integer degree\" 3 \"point3 P\" [0 0 0 1 0 0 1 1 0 2 1 0 3 3 3] \"string type\" \"ribbon\" \"normal N\" [0 0 1 0 0 1 0 0 1]\nAttributeEnd\n\
        Texture \"t\" \"float\" \"fbm\" \"integer octaves\" 3\nMaterial \"coateddiffuse\" \"texture displacement\" \"t\"\nShape \"trianglemesh\" \"point3 P\" [0 0 0 1 0 0 1 1 0] \"integer indices\" [0 1 2]\n\
        Shape \"loopsubdiv\" \"integer levels\" 1 \"point3 P\" [0 0 0 1 0 0 1 1 0 0 0 1] \"integer indices\" [0 1 2 0 3 1 1 3 2 2 3 0]\n";
    // Once a panic: sums of such coordinates are not finite.
    let far = String::from_utf8_lossy(hair).replace("1 0 0 1 1 0 2 1 0 3 3 3", "1 0 0 1e38 1 0 2 1 0 3 3 3").into_bytes();
    survives("pbrt", &[hair, &far]);
    let xml = b"<scene version=\"3.0.0\"><default name=\"w\" value=\"8\"/><sensor type=\"perspective\"><float name=\"fov\" value=\"40\"/><transform name=\"to_world\"><lookat origin=\"0,0,5\" target=\"0,0,0\" up=\"0,1,0\"/></transform>\
        <film type=\"hdrfilm\"><integer name=\"width\" value=\"$w\"/></film></sensor><bsdf type=\"roughplastic\" id=\"b\"><rgb name=\"diffuse_reflectance\" value=\".1,.2,.3\"/></bsdf>\
        <medium type=\"homogeneous\" id=\"m\"><rgb name=\"sigma_t\" value=\"1,1,1\"/></medium><shape type=\"sphere\"><ref id=\"b\"/><emitter type=\"area\"><spectrum name=\"radiance\" value=\"400:1,700:2\"/></emitter></shape>\
        <shape type=\"cube\"><bsdf type=\"dielectric\"/><ref name=\"interior\" id=\"m\"/><transform name=\"to_world\"><rotate x=\"1\" angle=\"30\"/></transform></shape></scene>";
    survives("mitsuba", &[xml]);
}

#[test]
fn meshes_and_sheets() {
    survives("obj", &[b"mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\nusemtl a\nf 1/1/1 2/1/1 3/1/1\nnewmtl a\nKd .5 .5 .5\nNs 10\nPr .3\ndisp -mm 0 1 x.png\nKe 1 1 1\nd .5\nillum 7\n"]);
    survives(
        "stl",
        &[b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0\nendloop\nendfacet\nendsolid\n"],
    );
    survives("sheet", &[b"[camera]\nat = [0, 0, 3]\n[material.a]\ncolor = [0.5, 0.5, 0.5]\n[[sphere]]\nmaterial = \"a\"\ncenter = [0, 0, 0]\nradius = 1\n[sky]\nlight = 10\n"]);
}

#[test]
fn tables_and_grids() {
    survives("ies", &[b"IESNA:LM-63-2002\n[TEST] x\nTILT=NONE\n1 1000 1 3 2 1 2 0 0 0\n1 1 50\n0 45 90\n0 90\n100 80 0\n90 70 0\n", b"IESNA91\nTILT=INCLUDE\n1\n3\n0 45 90\n1 .9 .8\n1 -1 1 5 1 1 2 .1 .1 .1 1 1 50\n0 22.5 45 67.5 90\n0\n100 90 80 40 0\n"]);
    survives("nanovdb", &[include_bytes!("../packed/blosc.nvdb"), include_bytes!("../packed/zip.nvdb")]);
    // The head of a table of measurements with two fields.
    let mut tensor = b"tensor_file\0\x01\x00\x02\x00\x00\x00".to_vec();
    for (name, at) in [("phi_i", 100u64), ("theta_i", 108)] {
        tensor.extend((name.len() as u16).to_le_bytes());
        tensor.extend(name.bytes());
        tensor.extend(1u16.to_le_bytes());
        tensor.push(10);
        tensor.extend(at.to_le_bytes());
        tensor.extend(2u64.to_le_bytes());
    }
    tensor.resize(128, 0x3f);
    survives("measured", &[&tensor, &[90u32, 90, 180].map(u32::to_le_bytes).concat()]);
}
