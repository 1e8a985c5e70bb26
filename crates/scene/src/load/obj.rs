//! Wavefront OBJ: meshes with their materials (`mtl`). They bring no light but what glows: the shot adds a studio, a sky or a map.

mod mtl;
mod smoothing;

use super::mesh::{BYTE_ORDER_MARK, GREY, error};
use super::polygon::triangulate;
use super::{DisplacedSurface, Fetch, displaced, finished, lossy};
use crate::SceneError;
use crate::material::{Material, Scattering};
use crate::scene::{Description, Object, Shape};
use crate::shape::Mesh;
use crate::texture::{Color, Scalar};
use diopter_light::color::srgb_decode;
use glam::{Affine3A, Vec2, Vec3};
use mtl::{Library, Pictures};
use smoothing::{smooth, smoothing_groups};
use std::borrow::Cow;
use std::collections::BTreeSet;
use std::io::Cursor;
use std::sync::Arc;

/// What an OBJ file is expected to have.
const FACES: &str = "an OBJ file with faces (f ...)";

/// Reads an OBJ file with the materials that it names. Fails with the line that cannot be read, and where there are no faces; materials and pictures that are missing are
/// warnings.
pub fn obj(bytes: &[u8], name: &str, fetch: Fetch) -> Result<Description, SceneError> {
    let bytes = bytes.strip_prefix(BYTE_ORDER_MARK).unwrap_or(bytes);
    let bytes = &*plain_statements(bytes);
    let options = tobj::LoadOptions { triangulate: false, single_index: true, ignore_points: true, ignore_lines: true };
    let told =
        |(line, text, expected): (usize, String, &str)| error(format!("{name}: line {line}"), format!("\"{text}\""), expected);
    if let Some(bad) = Some(bytes).filter(|b| has_far_corners(b)).and_then(bad_line) {
        return Err(told(bad));
    }
    let mut d = Description { name: name.to_owned(), ..Default::default() };
    let mut library = Library::default();
    let read = std::cell::RefCell::new(|path: &std::path::Path| {
        Ok(library.add(&path.to_string_lossy().replace('\\', "/"), name, fetch, &mut d.warnings))
    });
    let (statements, asked) = material_names(bytes);
    let loaded = tobj::load_obj_buf(&mut Cursor::new(lossy(&statements)), &options, |p| (read.borrow_mut())(p));
    let (models, _) = loaded.map_err(|e| match bad_line(bytes).or_else(|| foreign_line(bytes)) {
        Some(bad) => told(bad),
        None => error(name.to_owned(), e.to_string(), "an OBJ file"),
    })?;
    library.warn_of_unknown(&asked, name, &mut d.warnings);
    let mut pictures = Pictures::new(fetch);
    let mut heights = Vec::new();
    for material in &library.materials {
        let (made, height) = material.make(&mut pictures);
        d.materials.push(made);
        heights.push(height);
    }
    d.missing_textures = pictures.missing;
    let grey = d.materials.len();
    d.materials.push(Material::new("grey", Scattering::Diffuse(Color::rgb(GREY, GREY, GREY))));
    let mut of_vertices = None;
    let mut displaced: Vec<(Mesh, usize, Scalar)> = Vec::new();
    let lacks_normals = models.iter().any(|model| model.mesh.normals.len() < model.mesh.positions.len());
    let smoothing = if lacks_normals { smoothing_groups(bytes) } else { Vec::new() };
    let mut faces = 0;
    for model in models {
        let m = model.mesh;
        if m.indices.is_empty() {
            continue;
        }
        let corners = if m.face_arities.is_empty() { vec![3; m.indices.len() / 3] } else { m.face_arities };
        let groups = smoothing.get(faces..faces + corners.len()).unwrap_or_default();
        faces += corners.len();
        let triples = |v: &[f32]| v.chunks_exact(3).map(Vec3::from_slice).collect::<Vec<_>>();
        // What stands for no colour is white beside others, and nothing alone.
        let colored = m.vertex_color.iter().any(|v| !v.is_nan());
        let linear = |c: f32| if c.is_nan() { 1.0 } else { srgb_decode(c) };
        let colors = m.vertex_color.as_chunks::<3>().0.iter().filter(|_| colored);
        let mut mesh = Mesh {
            positions: triples(&m.positions),
            normals: triples(&m.normals).into_iter().map(|n| n.normalize_or_zero()).collect(),
            uvs: [m.texcoords.chunks_exact(2).map(Vec2::from_slice).collect(), vec![]],
            // Codes of sRGB, as programs write them.
            colors: colors.map(|c| Vec3::from_array(c.map(linear)).extend(1.0)).collect(),
            triangles: vec![],
            tangents: vec![],
        };
        mesh.triangles = triangles(&m.indices, &corners, &mesh.positions);
        if mesh.drop_partial_lists() {
            d.warnings.push(format!("{name}: \"{}\": what only some of the corners have is left out", model.name));
        }
        if mesh.normals.is_empty() {
            smooth(&mut mesh, &m.indices, &corners, groups);
        }
        let material = match m.material_id.filter(|i| *i < grey) {
            Some(number) => number,
            None if mesh.colors.is_empty() => grey,
            // What has no colour but its own.
            None => *of_vertices.get_or_insert_with(|| {
                d.materials.push(Material::new("vertex colours", Scattering::Diffuse(Color::rgb(1.0, 1.0, 1.0))));
                d.materials.len() - 1
            }),
        } as u32;
        if let Some(height) = heights.get(material as usize).cloned().flatten() {
            displaced.push((std::mem::take(&mut mesh), d.meshes.len(), height));
        }
        d.meshes.push(mesh.into());
        let shape = Shape::Mesh { mesh: d.meshes.len() as u32 - 1, world_from_mesh: Affine3A::IDENTITY };
        d.objects.push(Object::new(model.name, shape, material));
    }
    if !displaced.is_empty() {
        displace(displaced, name, &mut d);
    }
    if d.objects.is_empty() {
        let foreign = foreign_line(bytes);
        return Err(foreign.map_or_else(|| error(name.into(), "no surface: it has no faces", FACES), told));
    }
    finished(d, name, FACES)
}

/// Triangles of faces by their numbers of corners.
fn triangles(indices: &[u32], corners: &[u32], positions: &[Vec3]) -> Vec<[u32; 3]> {
    if corners.iter().all(|count| *count == 3) {
        return indices.as_chunks::<3>().0.to_vec();
    }
    let (mut out, mut left) = (Vec::with_capacity(indices.len()), indices);
    for count in corners {
        let (face, rest) = left.split_at(*count as usize);
        triangulate(face, positions, &mut out);
        left = rest;
    }
    out
}

/// Displaces meshes by the heights of their materials and puts them where their numbers say; all together, so that they do not crack where they meet.
fn displace(mut displaced: Vec<(Mesh, usize, Scalar)>, name: &str, d: &mut Description) {
    let before =
        displaced.iter().map(|(mesh, number, height)| (*number as u32, Arc::new(mesh.clone()), Arc::new(height.clone())));
    d.displaced.push(DisplacedSurface { parts: before.collect(), alone: None });
    let mut parts: Vec<(&mut Mesh, &Scalar)> = displaced.iter_mut().map(|(mesh, _, height)| (mesh, &*height)).collect();
    let done = displaced::displace(&mut parts, displaced::MOST_IN_ALL);
    if done.stopped {
        let most = displaced::MOST_IN_ALL;
        d.warnings.push(format!(
            "{name}: displaced meshes are coarser than they should be: finer ones need more than {most} triangles"
        ));
    }
    if done.without_height > 0 {
        d.warnings.push(format!("{name}: displacement that is no number at {} points", done.without_height));
    }
    for (mesh, number, _) in displaced {
        d.meshes[number] = mesh.into();
    }
}

/// Whether faces count backwards or by numbers of 19 digits: the reader itself computes with such numbers before it looks whether they can be.
fn has_far_corners(bytes: &[u8]) -> bool {
    let mut faces = bytes.split(|c| *c == b'\n').map(<[u8]>::trim_ascii_start).filter(|line| line.starts_with(b"f"));
    faces.any(|line| line.contains(&b'-') || line.split(|c| !c.is_ascii_digit()).any(|run| run.len() >= 19))
}

/// The first line of an OBJ file that cannot be read: its number, what stands there, what belongs there. The reader itself tells no lines.
/// Source: Wavefront's OBJ specification (1995).
fn bad_line(bytes: &[u8]) -> Option<(usize, String, &'static str)> {
    let lines = || bytes.split(|c| *c == b'\n').map(String::from_utf8_lossy);
    let key_of = |line: &str| line.split_whitespace().next().unwrap_or_default().to_owned();
    // Vertices, texture coordinates and normals, which faces count from 1, or backwards from -1 among those before them.
    let count = |counts: &mut [i64; 3], line: &str| {
        let kind = ["v", "vt", "vn"].iter().position(|k| key_of(line) == *k);
        kind.into_iter().for_each(|k| counts[k] += 1);
    };
    let (mut all, mut before) = ([0i64; 3], [0i64; 3]);
    lines().for_each(|line| count(&mut all, &line));
    let is_corner = |word: &str, before: [i64; 3]| {
        let numbers = word.split('/').zip(all.into_iter().zip(before));
        word.split('/').count() <= 3
            && numbers.enumerate().all(|(i, (text, (all, before)))| match text.parse::<i64>() {
                Ok(number) => (1..=all).contains(&number) || (-before..0).contains(&number),
                // "1//3": without texture coordinates.
                Err(_) => text.is_empty() && i > 0,
            })
    };
    for (i, line) in lines().enumerate() {
        let mut words = line.split_whitespace();
        count(&mut before, &line);
        let numbers = |most: usize, words: std::str::SplitWhitespace| {
            words.clone().count() >= most && words.take(most).all(|w| w.parse::<f32>().is_ok())
        };
        let expected = match words.next().unwrap_or_default() {
            "v" | "vn" if !numbers(3, words.clone()) => "three numbers behind v and vn",
            "vt" if !numbers(1, words.clone()) => "numbers behind vt",
            "f" if !words.clone().all(|word| is_corner(word, before)) => {
                "corners of vertices that the file has behind f: 1, 1/1, 1//1 or 1/1/1"
            }
            _ => continue,
        };
        return Some((i + 1, line.trim().chars().take(80).collect(), expected));
    }
    None
}

/// The first line of what is no OBJ file at all: text without one of its statements, or other bytes. Source: Wavefront's OBJ specification (1995).
fn foreign_line(bytes: &[u8]) -> Option<(usize, String, &'static str)> {
    const STATEMENTS: [&str; 34] = [
        "v",
        "vt",
        "vn",
        "vp",
        "cstype",
        "deg",
        "bmat",
        "step",
        "p",
        "l",
        "f",
        "curv",
        "curv2",
        "surf",
        "parm",
        "trim",
        "hole",
        "scrv",
        "sp",
        "end",
        "con",
        "g",
        "s",
        "mg",
        "o",
        "bevel",
        "c_interp",
        "d_interp",
        "lod",
        "usemtl",
        "mtllib",
        "shadow_obj",
        "trace_obj",
        "call",
    ];
    let mut lines = bytes.split(|c| *c == b'\n').map(<[u8]>::trim_ascii).enumerate();
    let (i, line) = lines.find(|(_, line)| !line.is_empty() && !line.starts_with(b"#"))?;
    let word = line.split(u8::is_ascii_whitespace).next()?;
    let known = STATEMENTS.iter().any(|s| s.as_bytes() == word);
    (!known).then(|| {
        (i + 1, line[..line.len().min(40)].escape_ascii().to_string(), "an OBJ file, of lines such as v 0 0 1 and f 1 2 3")
    })
}

/// A file whose names of materials stand behind a space and behind the libraries that have them, as its reader expects them, and these names. Without one none is meant.
fn material_names(bytes: &[u8]) -> (Cow<'_, [u8]>, BTreeSet<String>) {
    const KEY: &[u8] = b"usemtl";
    const LIBRARY: &[u8] = b"mtllib";
    /// What no material is called.
    const NONE: &[u8] = b"(none)";
    let mut names = BTreeSet::new();
    let lines = || bytes.split_inclusive(|c| *c == b'\n');
    let is_library = |line: &&[u8]| line.trim_ascii_start().starts_with(LIBRARY);
    let first_name = lines().position(|line| line.trim_ascii_start().starts_with(KEY));
    let late = first_name.is_some_and(|first| lines().skip(first).any(|line| is_library(&line)));
    let mut out: Option<Vec<u8>> = None;
    if late {
        let libraries = lines().filter(is_library).flat_map(|line| [line.trim_ascii(), b"\n"]).flatten();
        out = Some(libraries.copied().collect());
    }
    let mut at = 0;
    for line in lines().filter(|line| !(late && is_library(line))) {
        let statement = line.trim_ascii();
        let name = statement.strip_prefix(KEY).filter(|rest| rest.first().is_none_or(u8::is_ascii_whitespace));
        if let Some(name) = name {
            let plain = name.first() == Some(&b' ') && line.starts_with(KEY);
            let name = name.trim_ascii();
            if !name.is_empty() {
                names.insert(String::from_utf8_lossy(name).into_owned());
            }
            if !plain && out.is_none() {
                out = Some(bytes[..at].to_vec());
            }
            if let Some(out) = &mut out {
                let parts: [&[u8]; 4] = [KEY, b" ", if name.is_empty() { NONE } else { name }, b"\n"];
                parts.iter().for_each(|part| out.extend_from_slice(part));
            }
        } else if let Some(out) = &mut out {
            out.extend_from_slice(line);
        }
        at += line.len();
    }
    (out.map_or(Cow::Borrowed(bytes), Cow::Owned), names)
}

/// The statements of a file as its reader expects them: each on one line, keys of libraries followed by a space, without polylines, which it would fill, and without comments behind numbers; texture coordinates of two
/// numbers; vertices without weights and opacities, of which all have colours or none (what has none has numbers that are none). As many lines as before, but for those that go on after a backslash.
pub(super) fn plain_statements(bytes: &[u8]) -> Cow<'_, [u8]> {
    let whole = joined_lines(bytes);
    let words_of =
        |text: &[u8]| text.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).take_while(|w| w[0] != b'#').count();
    let vertices =
        || whole.split(|c| *c == b'\n').map(<[u8]>::trim_ascii_start).filter(|line| matches!(line, [b'v', b' ' | b'\t', ..]));
    // Key, place and colour.
    let colored = vertices().any(|line| words_of(line) >= 7);
    let statement = |line: &[u8]| -> Option<Vec<u8>> {
        let text = line.trim_ascii_start();
        let key = text.split(u8::is_ascii_whitespace).next().unwrap_or_default();
        let end: &[u8] = if line.ends_with(b"\n") { b"\n" } else { b"" };
        match key {
            b"l" => Some(end.to_vec()),
            b"mtllib" if text.get(key.len()) == Some(&b'\t') => Some([b"mtllib ", text[key.len()..].trim_ascii(), end].concat()),
            b"v" | b"vt" | b"vn" | b"f" => {
                // "1.#IND", which is no number, is no comment.
                let comment = (0..text.len()).find(|at| text[*at] == b'#' && text[at.saturating_sub(1)] != b'.');
                let plain = comment.map_or(text, |at| &text[..at]).trim_ascii_end();
                let count = words_of(plain);
                let first = |n: usize| {
                    plain.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).take(n).collect::<Vec<_>>().join(&b' ')
                };
                let changed = match (key, count) {
                    (b"vt", 2) => Some([plain, b" 0"].concat()),
                    (b"v", 8..) => Some(first(7)),
                    (b"v", 5 | 6) if !colored => Some(first(4)),
                    (b"v", 4..=6) if colored => Some([&*first(4), b" nan nan nan"].concat()),
                    _ => comment.map(|_| plain.to_vec()),
                };
                changed.map(|statement| [&*statement, end].concat())
            }
            _ => None,
        }
    };
    // Most lines: places of three numbers, faces and normals.
    let is_plain = |line: &[u8]| match line {
        [b'f', ..] | [b'v', b'n', ..] => !line.contains(&b'#'),
        [b'v', b' ', ..] if !colored => !line.contains(&b'#') && words_of(line) == 4,
        _ => false,
    };
    let needs_change = whole.split_inclusive(|c| *c == b'\n').any(|line| !is_plain(line) && statement(line).is_some());
    if !needs_change {
        return whole;
    }
    let mut out = Vec::with_capacity(whole.len());
    for line in whole.split_inclusive(|c| *c == b'\n') {
        match statement(line) {
            Some(plain) => out.extend_from_slice(&plain),
            None => out.extend_from_slice(line),
        }
    }
    Cow::Owned(out)
}

/// Lines that go on after a backslash, as one line each.
pub(super) fn joined_lines(bytes: &[u8]) -> Cow<'_, [u8]> {
    let goes_on = |at: usize| bytes[at] == b'\\' && matches!(bytes[at + 1..], [b'\n', ..] | [b'\r', b'\n', ..]);
    if !bytes.contains(&b'\\') || !(0..bytes.len()).any(goes_on) {
        return Cow::Borrowed(bytes);
    }
    let mut out = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        if goes_on(at) {
            out.push(b' ');
            at += if bytes[at + 1] == b'\r' { 3 } else { 2 };
        } else {
            out.push(bytes[at]);
            at += 1;
        }
    }
    Cow::Owned(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::material::BumpUnit;
    use std::collections::HashMap;

    #[test]
    fn colours_of_some_vertices_weights_and_single_coordinates_are_read() {
        let gone = |_: &str| Err("not there".to_owned());
        let read = |text: &str| obj(text.as_bytes(), "a.obj", &gone).unwrap_or_else(|e| panic!("{text}: {e}"));
        let plain = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
        let colored = "v 0 0 1 1 0 0\nv 1 0 1 1 0 0\nv 0 1 1 0 1 0 0.5\n";
        for text in
            [format!("o a\n{plain}f 1 2 3\no b\n{colored}f 4 5 6\n"), format!("o b\n{colored}f 1 2 3\no a\n{plain}f 4 5 6\n")]
        {
            let d = read(&text);
            let colors = |name: &str| {
                let object = d.objects.iter().find(|o| o.name == name).unwrap();
                let Shape::Mesh { mesh, .. } = object.shape else { panic!("a mesh") };
                (d.meshes[mesh as usize].colors.clone(), d.materials[object.material as usize].name.clone())
            };
            assert_eq!(colors("a"), (vec![], "grey".into()));
            assert_eq!(colors("b").0.iter().map(|c| c.truncate()).collect::<Vec<_>>(), [Vec3::X, Vec3::X, Vec3::Y]);
        }
        // In one mesh what has none is white.
        let d = read("v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0 1 0 0\nf 1 2 3\n");
        assert!(d.meshes[0].colors.contains(&Vec3::ONE.extend(1.0)) && d.meshes[0].colors.contains(&Vec3::X.extend(1.0)));
        let d = read("v 0 0 0 2\nv 1 0 0 2\nv 0 1 0 2 # weights\nvt 0\nvt 1\nf 1/1 2/2 3/2\n");
        assert!(d.meshes[0].colors.is_empty());
        assert_eq!(d.meshes[0].uvs[0].iter().map(|uv| uv.y).fold(0.0, f32::max), 0.0);
        // What Windows writes for what is no number is no comment.
        let bad = obj(b"v 1 1 1.#IND\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "a.obj", &gone).unwrap_err().to_string();
        assert!(bad.contains("line 1"), "{bad}");
    }

    #[test]
    fn a_half_of_specular_light_is_the_reflectance_of_glass() {
        let gloss = |ks: &str| {
            let fetch = |_: &str| Ok(format!("newmtl m\nKd 0.2 0.2 0.2\nKs {ks}\nNi 1.5\n").into_bytes());
            let d = obj(b"mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "a.obj", &fetch).unwrap();
            let Scattering::Principled(p) = &d.materials[0].scattering else { panic!("a gloss") };
            let f0 = ((p.ior - 1.0) / (p.ior + 1.0)).powi(2);
            p.specular_color.constant_rgb().unwrap() * f0
        };
        for (ks, expected) in [
            ("0.5 0.5 0.5", Vec3::splat(0.04)),
            ("1 1 1", Vec3::splat(0.08)),
            ("0.1 0.1 0.1", Vec3::splat(0.008)),
            ("1 0.5 0.25", Vec3::new(0.08, 0.04, 0.02)),
        ] {
            assert!((gloss(ks) - expected).length() < 1e-4, "{ks}: {}", gloss(ks));
        }
    }

    #[test]
    fn libraries_may_stand_behind_names_and_have_pictures_beside_them() {
        let mut png = Vec::new();
        image::RgbImage::from_pixel(1, 1, image::Rgb([255, 0, 0]))
            .write_to(&mut Cursor::new(&mut png), image::ImageFormat::Png)
            .unwrap();
        let fetch = |name: &str| match name {
            "sub/a.mtl" => Ok(b"newmtl m\nKd 1 1 1\nmap_Kd red.png\nTf 0.5 1 1\nKdd 3\nPc 0\n".to_vec()),
            "sub/red.png" => Ok(png.clone()),
            _ => Err("there is no such file".to_owned()),
        };
        let text = "usemtl m\nmtllib sub/a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        let d = obj(text.as_bytes(), "a.obj", &fetch).unwrap();
        assert!(d.missing_textures.is_empty(), "{:?}", d.missing_textures);
        assert_eq!(d.materials[d.objects[0].material as usize].name, "m");
        assert!(d.warnings.iter().any(|w| w.ends_with("sub/a.mtl: Kdd, Tf: statements that are not read")), "{:?}", d.warnings);
    }

    #[test]
    fn lines_are_no_faces_and_comments_stand_behind_numbers() {
        let text = "mtllib\ta.mtl # materials\nv 0 0 0 # first\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1#x\nusemtl red\nf 1/1 2/2 3/2#y\nl 1 2 3 4\nl 1 2 3\n";
        let asked = std::sync::Mutex::new(Vec::new());
        let d = obj(text.as_bytes(), "t.obj", &|name| {
            asked.lock().unwrap().push(name.to_owned());
            Ok(b"newmtl red\nKd 1 0 0\n".to_vec())
        });
        let d = d.unwrap();
        let asked = asked.into_inner().unwrap();
        assert!(!asked.is_empty() && asked.iter().all(|name| name.starts_with("a.mtl")));
        assert_eq!((d.objects.len(), d.meshes[0].triangles.len(), d.meshes[0].uvs[0].len()), (1, 1, 3));
        assert_eq!(d.materials[d.objects[0].material as usize].name, "red");
        let lines = "v 0 0 0\nv 1 0 0\nv 1 1 0\nl 1 2 3\n";
        assert!(obj(lines.as_bytes(), "t.obj", &|_| Err("no".into())).unwrap_err().to_string().contains("no faces"));
    }

    #[test]
    fn corners_beyond_the_file_are_errors_with_their_line() {
        let obj_of = |face: &str| {
            let text = format!("v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\n{face}\nv 5 5 5\nvt 1 1\n");
            obj(text.as_bytes(), "t.obj", &|_| Err("no".into()))
        };
        for bad in [
            "f 1/1/1 2/1/-11 3/1/1",
            "f 1/1/1 2/-2/1 3/1/1",
            "f 1/9223372036854775807/1 2/1/1 3/1/1",
            "f 1/1/9223372036854775807 2/1/1 3/1/1",
            "f -9223372036854775808 -1 -2",
            " f -4 -1 -2",
        ] {
            let e = obj_of(bad).unwrap_err().to_string();
            assert!(e.contains("t.obj: line 6") && e.contains("corners of vertices"), "{bad}: {e}");
        }
        assert_eq!(obj_of("f -3/-1/-1 -2/-1/-1 -1/-1/-1").unwrap().meshes[0].positions[2], Vec3::new(1.0, 1.0, 0.0));
        for continued in ["f 1/1/1 \\\n 2/1/1 3/1/1", "f 1/1/1 2/1/1 \\\r\n3/1/1 \\\r\n"] {
            assert_eq!(obj_of(continued).unwrap().meshes[0].triangles.len(), 1, "{continued}");
        }
    }

    #[test]
    fn a_material_file_that_cannot_be_read_is_a_warning() {
        let text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl red\nf 1 2 3\n";
        let d = obj(text.as_bytes(), "t.obj", &|_| Ok(b"newmtl \nKd 1 0 0\n".to_vec())).unwrap();
        assert!(d.meshes[0].triangles.len() == 1 && d.warnings.iter().any(|w| w.contains("m.mtl")), "{:?}", d.warnings);
    }

    #[test]
    fn displaced_meshes_of_several_materials_are_one_surface() {
        // Black on the left, white on the right.
        let mut png = Vec::new();
        let ramp = image::GrayImage::from_fn(64, 2, |x, _| image::Luma([(x * 255 / 63) as u8]));
        ramp.write_to(&mut Cursor::new(&mut png), image::ImageFormat::Png).unwrap();
        let mtl = "newmtl a\ndisp -mm -0.1 0.5 ramp.png\nnewmtl b\nmap_disp ramp.png\nnewmtl c\n";
        let fetch = |name: &str| match name {
            "m.mtl" => Ok(mtl.as_bytes().to_vec()),
            "ramp.png" => Ok(png.clone()),
            other => Err(format!("no {other}")),
        };
        let obj = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 2 0 0\nv 2 1 0\nv 2 5 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 1\n\
            usemtl a\nf 1/1/1 2/2/1 3/3/1 4/4/1\nusemtl b\nf 2/1/1 5/2/1 6/3/1 3/4/1\nusemtl c\nf 3 6 7\n";
        let d = obj_of(obj, &fetch);
        assert!(d.warnings.is_empty() && d.meshes.len() == 3, "{:?}", d.warnings);
        assert_eq!((d.meshes[2].triangles.len(), d.meshes[2].normals.len()), (1, 0));
        let height = |x: f32| (x * 64.0 - 0.5) / 63.0;
        for (mesh, first, base, gain) in [(0, 0.0, -0.1, 0.5), (1, 1.0, 0.0, 1.0)] {
            let mesh = &d.meshes[mesh];
            assert!(mesh.triangles.len() > 20_000, "{}", mesh.triangles.len());
            for p in mesh.positions.iter().filter(|p| (0.1..0.9).contains(&(p.x - first))) {
                assert!((p.z - base - gain * height(p.x - first)).abs() < 0.005, "{p}");
            }
        }
        // Where they meet, both are at the mean of their heights there.
        let seam = |mesh: &Mesh| {
            let mut all: Vec<[u32; 3]> =
                mesh.positions.iter().filter(|p| p.x == 1.0).map(|p| p.to_array().map(f32::to_bits)).collect();
            all.sort_unstable();
            all
        };
        assert!(seam(&d.meshes[0]).len() > 100 && seam(&d.meshes[0]) == seam(&d.meshes[1]));
    }

    fn obj_of(text: &str, fetch: Fetch) -> Description {
        obj(text.as_bytes(), "t.obj", fetch).unwrap()
    }

    #[test]
    fn comments_and_names_in_other_encodings_are_no_error() {
        let bytes = b"# \xca\xa8\xd7\xd3\no \xca\xa8\nmtllib \xca\xa8.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
        let d = obj(bytes, "lion.obj", &|_| Err("there is no such file".into())).unwrap();
        assert_eq!((d.meshes[0].triangles.len(), d.warnings.len()), (1, 1), "{:?}", d.warnings);
        // Its material is found by the same name.
        let named = [&bytes[..bytes.len() - 8], b"usemtl \xca\xa8\nf 1 2 3\n"].concat();
        let mtl = |_: &str| Ok(b"# \xd7\xd3\nnewmtl \xca\xa8\nKd 0.1 0.2 0.3\n".to_vec());
        let d = obj(&named, "lion.obj", &mtl).unwrap();
        assert_eq!((d.materials.len(), d.objects[0].material, d.warnings.len()), (2, 0, 0), "{:?}", d.warnings);
        // Lines are still told by their numbers.
        let bad = [&bytes[..], b"v 1 x 2\n"].concat();
        let e = obj(&bad, "lion.obj", &|_| Err("no".into())).unwrap_err().to_string();
        assert!(e.contains("line 8"), "{e}");
    }

    #[test]
    fn obj_errors_name_their_line() {
        let gone = |_: &str| Err("not there".to_owned());
        let head = "v 0 0 0\nv 1 0 0\n# a note\nv 0 1 0\n";
        for (last, expected) in [("v 1 x 0\nf 1 2 3", "three numbers"), ("f 1 2 9", "corners"), ("f 1 2 three", "corners")] {
            let e = obj(format!("{head}{last}\n").as_bytes(), "a.obj", &gone).unwrap_err().to_string();
            let what = last.lines().next().unwrap();
            assert!(e.starts_with(&format!("a.obj: line 5: \"{what}\"")) && e.contains(expected), "{e}");
        }
        assert_eq!(bad_line(b"v 0 0 0\nvt 0\nvn 0 0 1\nf 1 1/1 1//1 1/1/1 -1\n"), None);
    }

    #[test]
    fn grey_pictures_of_bumps_are_heights_and_coloured_ones_normals() {
        let png = |rgb: [u8; 3]| {
            let mut bytes = Vec::new();
            let picture = image::RgbImage::from_pixel(2, 2, image::Rgb(rgb));
            picture.write_to(&mut Cursor::new(&mut bytes), image::ImageFormat::Png).unwrap();
            bytes
        };
        let (grey, blue) = (png([90, 92, 89]), png([128, 128, 255]));
        let mtl =
            "newmtl a\nmap_Bump -bm 0.3 grey.png\nnewmtl b\nbump -bm 0.5 blue.png\nnewmtl c\nmap_bump grey.png\nnorm blue.png\n";
        let files: HashMap<&str, &[u8]> = HashMap::from([("a.mtl", mtl.as_bytes()), ("grey.png", &grey), ("blue.png", &blue)]);
        let fetch = |name: &str| files.get(name).map(|b| b.to_vec()).ok_or_else(|| "there is no such file".to_owned());
        let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nusemtl a\nf 1 2 3\nusemtl b\nf 1 2 3\nusemtl c\nf 1 2 3\n";
        let d = obj(text.as_bytes(), "a.obj", &fetch).unwrap();
        let of = |i: usize| &d.materials[d.objects[i].material as usize];
        let bump = of(0).bump.as_ref().expect("heights");
        assert!(matches!(bump.height, Scalar::Textured { factor: 0.3, .. }) && matches!(bump.unit, BumpUnit::Extent(_)));
        assert!(of(0).normal_map.is_none());
        assert!(of(1).bump.is_none() && of(1).normal_map.as_ref().is_some_and(|m| m.1 == 0.5));
        assert!(of(2).bump.is_none() && of(2).normal_map.as_ref().is_some_and(|m| m.1 == 1.0));
    }

    #[test]
    fn objects_have_their_materials() {
        let files: HashMap<&str, &[u8]> = HashMap::from([(
            "a.mtl",
            &b"newmtl red\nKd 0.8 0.1 0.1\nKs 0 0\nKa 1\nmap_Bump none.png\nnewmtl glass\nillum 7\nd 0.2\nNi 1.6\nnewmtl lamp\nKe 5 5 5\nmap_Kd gone.png\n"[..],
        )]);
        let fetch = |name: &str| files.get(name).map(|b| b.to_vec()).ok_or_else(|| "there is no such file".to_owned());
        let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nusemtl red\nf 1 2 3 4\nusemtl glass\nf 1 2 3\nusemtl lamp\nf -1 -2 -3\n";
        let d = obj(text.as_bytes(), "a.obj", &fetch).unwrap();
        let of = |i: usize| &d.materials[d.objects[i].material as usize];
        assert_eq!(d.objects.len(), 3);
        assert_eq!(d.meshes[0].triangles.len(), 2);
        assert!(matches!(&of(0).scattering, Scattering::Diffuse(Color::Constant { rgb, .. }) if rgb.x == 0.8));
        assert!(matches!(&of(1).scattering, Scattering::Principled(p) if p.ior == 1.6));
        assert!(of(2).emission.is_some());
        let listed =
            |w: &&String| w.contains("gone.png (there is no such file)") && w.contains("none.png") && w.contains("magenta");
        assert_eq!(d.warnings.iter().filter(listed).count(), 1, "{:?}", d.warnings);
        assert_eq!(d.missing_textures.len(), 2);
        // What stands in for a picture is seen; without its bumps the red one is as it was.
        let Scattering::Diffuse(Color::Textured { factor, texture }) = &of(2).scattering else { panic!("a picture") };
        let shown = *factor * texture.at(&[Vec2::splat(0.3); 2]).truncate();
        assert!((shown - crate::load::STAND_IN).length() < 1e-5, "{shown}");
        assert!(of(0).normal_map.is_none());
        // Without its materials it is grey, and says so.
        let alone = obj(text.as_bytes(), "a.obj", &|_: &str| Err("there is no such file".into())).unwrap();
        assert!(!alone.objects.is_empty() && alone.warnings.iter().any(|w| w.contains("a.mtl")), "{:?}", alone.warnings);
        assert!(obj(b"v 0 0 0\nf 1 2 x\n", "a.obj", &fetch).is_err() && obj(b"", "a.obj", &fetch).is_err());
    }

    fn quad(text: &str, mtl: &str) -> Description {
        let mut png = Vec::new();
        image::RgbImage::from_pixel(2, 2, image::Rgb([255, 0, 0]))
            .write_to(&mut Cursor::new(&mut png), image::ImageFormat::Png)
            .unwrap();
        let fetch = |name: &str| match name {
            "a.mtl" => Ok(mtl.as_bytes().to_vec()),
            "b.mtl" => Ok(b"newmtl green\nKd 0 1 0\n".to_vec()),
            "my red.png" => Ok(png.clone()),
            other => Err(format!("no {other}")),
        };
        obj_of(&format!("\u{feff}v 0 0 0\nv 1 0 0\nv 1 1 0\n{text}"), &fetch)
    }

    fn material(d: &Description, object: usize) -> &Material {
        &d.materials[d.objects[object].material as usize]
    }

    #[test]
    fn libraries_names_and_colours_are_read_as_programs_write_them() {
        let two =
            "mtllib a.mtl b.mtl\nusemtl\tred one\nf 1 2 3\nusemtl green\nf 1 2 3\nusemtl\nf 1 2 3\nusemtl nobody\nf 1 2 3\n";
        let d = quad(two, "\u{feff}newmtl red one\nKd 1 0 0\n");
        let names: Vec<&str> = (0..3).map(|i| material(&d, i).name.as_str()).collect();
        assert_eq!(names, ["red one", "green", "grey"]);
        assert!(d.warnings.len() == 1 && d.warnings[0].contains("nobody"), "{:?}", d.warnings);
        // Vertices with colours of their own and no material show them.
        let d = obj_of("v 0 0 0 0.5 0 1\nv 1 0 0 0.5 0 1\nv 1 1 0 0.5 0 1\nf 1 2 3\n", &|_| Err("no".into()));
        let Scattering::Diffuse(Color::Constant { rgb, .. }) = &material(&d, 0).scattering else { panic!("a colour") };
        let colors = &d.meshes[0].colors;
        assert!(*rgb == Vec3::ONE && (colors[0].truncate() - Vec3::new(0.214, 0.0, 1.0)).length() < 1e-3, "{rgb} {}", colors[0]);
    }

    #[test]
    fn concave_faces_keep_their_notch() {
        let d =
            obj_of("v 0 0 0\nv 2 0 0\nv 2 2 0\nv 1 0.5 0\nv 0 2 0\nv 3 0 0\nv 4 0 0\nv 3 1 0\nf 1 2 3 4 5\nf 6 7 8\n", &|_| {
                Err("no".into())
            });
        let mesh = &d.meshes[0];
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            0.5 * (b - a).cross(c - a).z
        };
        assert_eq!(mesh.triangles.len(), 4);
        // Four less the notch, and half.
        let (all, positive) = mesh.triangles.iter().map(area).fold((0.0, true), |(sum, p), a| (sum + a, p && a > 0.0));
        assert!((all - (4.0 - 1.5 + 0.5)).abs() < 1e-6 && positive, "{all}");
    }

    #[test]
    fn one_odd_line_of_a_material_leaves_the_others() {
        let mtl = "newmtl a\nNs abc\nKd 0.2 0.3 0.4\nmap_Kd\nillum\nd\n";
        let d = quad("mtllib a.mtl\nusemtl a\nf 1 2 3\n", mtl);
        assert!(matches!(&material(&d, 0).scattering, Scattering::Diffuse(Color::Constant { rgb, .. }) if rgb.y == 0.3));
        assert!(d.warnings.iter().any(|w| w.contains("a.mtl: line 2") && w.contains("Ns abc")), "{:?}", d.warnings);
    }

    #[test]
    fn pictures_have_names_with_spaces_and_options() {
        let mtl = "newmtl a\nmap_Kd -s 2 4 1 -o 0.5 0 0 -clamp on my red.png\nTr 0.75\nnewmtl b\nmap_Ke my red.png\nKd 0 0 0\nmap_Pr -imfchan g my red.png\n";
        let d = quad("mtllib a.mtl\nusemtl a\nf 1 2 3\nusemtl b\nf 1 2 3\n", mtl);
        assert!(d.warnings.is_empty(), "{:?}", d.warnings);
        let Scattering::Diffuse(Color::Textured { factor, texture }) = &material(&d, 0).scattering else { panic!("a picture") };
        assert_eq!((*factor, texture.wrap), (Vec3::ONE, [crate::texture::Wrap::Clamp; 2]));
        let at = texture.image_from_uv.transform_point2(Vec2::new(0.1, 0.1));
        assert!((at - Vec2::new(0.7, 0.6)).length() < 1e-6, "{at}");
        assert!(matches!(material(&d, 0).coverage, crate::material::Coverage::Blend(Scalar::Constant(o)) if o == 0.25));
        let glow = material(&d, 1).emission.as_ref().expect("a glow");
        assert!(matches!(&glow.radiance, crate::material::EmissionColor::Textured { factor, .. } if *factor == Vec3::ONE));
        let Scattering::Principled(p) = &material(&d, 1).scattering else { panic!("rough by a picture") };
        assert!(matches!(p.roughness, Scalar::Textured { channel: 1, .. }));
    }
}
