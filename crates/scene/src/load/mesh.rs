//! Meshes without a scene around them: OBJ with its materials, PLY, STL. They bring no light: the shot adds a
//! studio, a sky or a map.

use super::{DisplacedSurface, Fetch, displaced, finished, lossy, note_missing, ply, read_texture, splats, stand_in, unzipped};
use crate::SceneError;
use crate::material::{Bump, BumpUnit, Conductor, Coverage, Emission, Material, Principled, Scattering};
use crate::scene::{Description, MissingTexture, Object, Shape};
use crate::shape::Mesh;
use crate::texture::{Codes, Color, Graph, Image, Scalar, Texture};
use diopter_light::Spectrum;
use glam::{Affine2, Affine3A, Vec2, Vec3, Vec4};
use std::borrow::Cow;
use std::collections::HashMap;
use std::io::Cursor;
use std::sync::Arc;

/// What an OBJ file is expected to have.
const FACES: &str = "an OBJ file with faces (f ...)";

/// Reflectance of what says nothing of itself.
const GREY: f32 = 0.6;

fn error(place: String, found: impl Into<String>, expected: impl Into<String>) -> SceneError {
    SceneError::File { place, found: found.into(), expected: format!("expected {}", expected.into()) }
}

fn alone(name: &str, mesh: Mesh, warnings: Vec<String>) -> Description {
    let grey = if mesh.colors.is_empty() { Color::rgb(GREY, GREY, GREY) } else { Color::rgb(1.0, 1.0, 1.0) };
    Description {
        name: name.to_owned(),
        meshes: vec![mesh.into()],
        materials: vec![Material::new("grey", Scattering::Diffuse(grey))],
        objects: vec![Object::new(name, Shape::Mesh { mesh: 0, world_from_mesh: Affine3A::IDENTITY }, 0)],
        warnings,
        ..Default::default()
    }
}

/// Reads a PLY file, gzip or not: polygons, or Gaussian splats ([`splats`]). Fails where its header or data are damaged or cut short, it has no vertices or no faces, or,
/// of Gaussians, a property is missing or none is usable.
pub fn ply(bytes: Vec<u8>, name: &str) -> Result<Description, SceneError> {
    let bytes = unzipped(bytes).map_err(|e| error(name.into(), e, "a PLY file or a .gz of it"))?;
    if let Some(capture) = splats::ply(&bytes, name)? {
        return Ok(capture);
    }
    let read = ply::read(&bytes).map_err(|e| error(name.into(), e.found, e.expected))?;
    if read.mesh.triangles.is_empty() {
        let found = format!("no surface: {} vertices without a face", read.mesh.positions.len());
        return Err(error(name.into(), found, "an element \"face\" or \"tristrips\" (point clouds are not drawn)"));
    }
    Ok(alone(name, read.mesh, read.warning.map(|w| format!("{name}: {w}")).into_iter().collect()))
}

/// Reads an STL file, text or binary. Source: 3D Systems 1988, as M. Burns describes it in "Automated Fabrication", §6.5. Units of the file are taken for metres. Fails
/// where it is neither text nor as long as its count says, a vertex has not three numbers (with the line), or there is no whole facet.
pub fn stl(bytes: &[u8], name: &str) -> Result<Description, SceneError> {
    let count = bytes.get(80..84).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let mut corners: Vec<Vec3> = Vec::new();
    // A text may begin with "solid" and so may the 80 free bytes of a binary file: its length tells them apart.
    let binary = count.is_some_and(|n| n.checked_mul(50).and_then(|n| n.checked_add(84)) == Some(bytes.len()));
    if binary {
        for facet in bytes[84..].chunks_exact(50) {
            let number = |i: usize| f32::from_le_bytes([facet[i], facet[i + 1], facet[i + 2], facet[i + 3]]);
            corners.extend((0..3).map(|k| Vec3::from_array([0, 1, 2].map(|j| number(12 + 12 * k + 4 * j)))));
        }
    } else if bytes.trim_ascii_start().starts_with(b"solid") {
        for (i, line) in bytes.split(|c| *c == b'\n').enumerate() {
            let line = String::from_utf8_lossy(line);
            let mut words = line.split_ascii_whitespace();
            if words.next() == Some("vertex") {
                let numbers: Vec<f32> = words.map_while(|w| w.parse().ok()).collect();
                let [x, y, z] = numbers[..] else {
                    return Err(error(
                        format!("{name}: line {}", i + 1),
                        format!("\"{}\"", line.trim()),
                        "vertex and three numbers",
                    ));
                };
                corners.push(Vec3::new(x, y, z));
            }
        }
        if !corners.len().is_multiple_of(3) {
            return Err(error(name.into(), format!("{} corners", corners.len()), "three for each facet: the file is cut short"));
        }
    } else {
        let found = format!("{} bytes{}", bytes.len(), count.map_or(String::new(), |n| format!(" that announce {n} facets")));
        return Err(error(name.into(), found, "an STL file: text, or 84 bytes and 50 for each facet"));
    }
    if corners.is_empty() {
        return Err(error(name.into(), "no facets", "at least one"));
    }
    // Equal corners are one.
    let mut known: HashMap<[u32; 3], u32> = HashMap::new();
    let mut mesh = Mesh::default();
    let numbers: Vec<u32> = corners
        .iter()
        .map(|c| {
            *known.entry(c.to_array().map(f32::to_bits)).or_insert_with(|| {
                mesh.positions.push(*c);
                mesh.positions.len() as u32 - 1
            })
        })
        .collect();
    mesh.triangles = numbers.as_chunks::<3>().0.to_vec();
    Ok(alone(name, mesh, vec![]))
}

/// Reads an OBJ file with the materials that it names. Fails with the line that cannot be read, and where there are no faces; materials and pictures that are missing are
/// warnings.
pub fn obj(bytes: &[u8], name: &str, fetch: Fetch) -> Result<Description, SceneError> {
    let bytes = &*joined_lines(bytes);
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ignore_points: true, ignore_lines: true };
    let told =
        |(line, text, expected): (usize, String, &str)| error(format!("{name}: line {line}"), format!("\"{text}\""), expected);
    if let Some(bad) = Some(bytes).filter(|b| has_far_corners(b)).and_then(bad_line) {
        return Err(told(bad));
    }
    let mut warnings = Vec::new();
    let mut missing = Vec::new();
    let read = |path: &std::path::Path| {
        let file = path.to_string_lossy().replace('\\', "/");
        let read = |bytes: Vec<u8>| tobj::load_mtl_buf(&mut Cursor::new(whole_colors(&lossy(&bytes)))).map_err(|e| e.to_string());
        Ok(fetch(&file).and_then(read).unwrap_or_else(|e| {
            missing.push(format!("{name}: material file {file}: {e}: its materials are grey"));
            Default::default()
        }))
    };
    let read = std::cell::RefCell::new(read);
    let loaded = tobj::load_obj_buf(&mut Cursor::new(lossy(bytes)), &options, |p| (read.borrow_mut())(p));
    let (models, materials) = loaded.map_err(|e| match bad_line(bytes).or_else(|| foreign_line(bytes)) {
        Some(bad) => told(bad),
        None => error(name.to_owned(), e.to_string(), "an OBJ file"),
    })?;
    warnings.append(&mut missing);
    let materials = match materials {
        Ok(m) => m,
        Err(e) => {
            warnings.push(format!("{name}: its materials cannot be read ({e}): they are grey"));
            vec![]
        }
    };
    let mut d = Description { name: name.to_owned(), warnings, ..Default::default() };
    let mut images: HashMap<String, Option<Arc<Image>>> = HashMap::new();
    let mut heights = Vec::new();
    for m in &materials {
        let (made, height) = material(m, fetch, &mut images, &mut d.missing_textures);
        d.materials.push(made);
        heights.push(height);
    }
    d.materials.push(Material::new("grey", Scattering::Diffuse(Color::rgb(GREY, GREY, GREY))));
    let mut displaced: Vec<(Mesh, usize, Scalar)> = Vec::new();
    for model in models {
        let m = model.mesh;
        if m.indices.is_empty() {
            continue;
        }
        let triples = |v: &[f32]| v.chunks_exact(3).map(Vec3::from_slice).collect::<Vec<_>>();
        let mut mesh = Mesh {
            positions: triples(&m.positions),
            normals: triples(&m.normals).into_iter().map(|n| n.normalize_or(Vec3::Z)).collect(),
            uvs: [m.texcoords.chunks_exact(2).map(Vec2::from_slice).collect(), vec![]],
            colors: triples(&m.vertex_color).into_iter().map(|c| Vec4::from((c, 1.0))).collect(),
            triangles: m.indices.as_chunks::<3>().0.to_vec(),
            tangents: vec![],
        };
        if mesh.drop_partial_lists() {
            d.warnings.push(format!("{name}: \"{}\": what only some of the corners have is left out", model.name));
        }
        let material = m.material_id.filter(|i| *i < materials.len()).unwrap_or(materials.len()) as u32;
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

/// Lines that go on after a backslash, as one line each.
fn joined_lines(bytes: &[u8]) -> Cow<'_, [u8]> {
    let goes_on = |at: usize| bytes[at] == b'\\' && matches!(bytes[at + 1..], [b'\n', ..] | [b'\r', b'\n', ..]);
    if !(0..bytes.len()).any(goes_on) {
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

/// A .mtl file whose colours all have three numbers: of one number all three are meant, others are left out.
fn whole_colors(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(bytes.len());
    for line in bytes.split_inclusive(|c| *c == b'\n') {
        let text = String::from_utf8_lossy(line);
        let mut words = text.split_whitespace();
        let Some(key) = words.next().filter(|k| matches!(*k, "Ka" | "Kd" | "Ks" | "Ke" | "Tf")) else {
            out.extend_from_slice(line);
            continue;
        };
        let numbers: Vec<f32> = words.map_while(|w| w.parse().ok()).collect();
        match numbers[..] {
            [_, _, _, ..] => out.extend_from_slice(line),
            [v] => out.extend_from_slice(format!("{key} {v} {v} {v}\n").as_bytes()),
            _ => (),
        }
    }
    out
}

/// Height from black to white of a picture of bumps of strength 1, as a fraction of the picture's side: the specification says no unit. Tuned by
/// eye so that features of ten texels of a picture of a thousand rise by 45°.
const BUMP_EXTENT: f32 = 0.01;

/// The number of an option before the name of a picture.
fn option_number(file: &str, option: &str) -> Option<f32> {
    let mut words = file.split_ascii_whitespace().skip_while(|w| *w != option);
    words.nth(1)?.parse().ok().filter(|v: &f32| v.is_finite())
}

/// The numbers of an option before the name of a picture.
fn option_numbers(file: &str, option: &str) -> Vec<f32> {
    let words = file.split_ascii_whitespace().skip_while(|w| *w != option).skip(1);
    words.map_while(|w| w.parse().ok().filter(|v: &f32| v.is_finite())).collect()
}

/// A material of a .mtl file, and the heights that displace what is made of it (in the file's unit). Source: Wavefront's MTL specification (1995) and
/// its physically based extension (Pr, Pm, Ke).
fn material(
    m: &tobj::Material,
    fetch: Fetch,
    images: &mut HashMap<String, Option<Arc<Image>>>,
    missing: &mut Vec<MissingTexture>,
) -> (Material, Option<Scalar>) {
    let mut image = |file: &str| {
        images
            .entry(file.to_owned())
            .or_insert_with(|| {
                // Options such as "-s 1 1 1" come before the name.
                let path = file.split_ascii_whitespace().last().unwrap_or(file).replace('\\', "/");
                match fetch(&path).and_then(|b| read_texture(&b)) {
                    Ok(image) => Some(Arc::new(image)),
                    Err(e) => {
                        note_missing(missing, &path, e);
                        None
                    }
                }
            })
            .clone()
    };
    // Rows of pictures count from below.
    let texture = |image: Arc<Image>, codes: Codes| Texture {
        codes,
        image_from_uv: Affine2::from_scale_angle_translation(Vec2::new(1.0, -1.0), 0.0, Vec2::Y),
        ..Texture::color(image)
    };
    let number = |key: &str| m.unknown_param.get(key).and_then(|v| v.split_ascii_whitespace().next()?.parse::<f32>().ok());
    let diffuse = Vec3::from_array(m.diffuse.unwrap_or([GREY; 3])).clamp(Vec3::ZERO, Vec3::ONE);
    let color = match m.diffuse_texture.as_deref().map(|file| image(file).ok_or_else(stand_in)) {
        // Kd multiplies its picture; many files leave it at 0 and mean the picture.
        Some(Ok(i)) => {
            Color::Textured { factor: if diffuse == Vec3::ZERO { Vec3::ONE } else { diffuse }, texture: texture(i, Codes::Srgb) }
        }
        // Whatever Kd is, what stands in for the picture is seen.
        Some(Err(i)) => Color::Textured { factor: Vec3::ONE, texture: texture(i, Codes::Srgb) },
        None => Color::rgb(diffuse.x, diffuse.y, diffuse.z),
    };
    let specular = Vec3::from_array(m.specular.unwrap_or([0.0; 3])).clamp(Vec3::ZERO, Vec3::ONE);
    // Blinn's exponent as a GGX width. Source: Walter et al. 2007: α² = 2 / (n + 2).
    let roughness =
        number("Pr").unwrap_or_else(|| m.shininess.map_or(1.0, |n| (2.0 / (n.max(0.0) + 2.0)).powf(0.25))).clamp(0.0, 1.0);
    let ior = m.optical_density.filter(|n| (1.0..=4.0).contains(n)).unwrap_or(1.5);
    let opacity = m.dissolve.unwrap_or(1.0).clamp(0.0, 1.0);
    let glass = matches!(m.illumination_model, Some(4 | 6 | 7 | 9)) && opacity < 1.0;
    let mirror = m.illumination_model == Some(3) && diffuse == Vec3::ZERO && specular != Vec3::ZERO;
    let scattering = if glass {
        Scattering::Principled(Box::new(Principled::glass(ior.max(1.01))))
    } else if mirror {
        let k = |i: usize| 2.0 * specular[i].min(0.9999).sqrt() / (1.0 - specular[i].min(0.9999)).sqrt();
        let rgb = Vec3::new(k(0), k(1), k(2));
        let points = [(460.0, rgb.z), (545.0, rgb.y), (610.0, rgb.x)];
        Scattering::Conductor(Conductor {
            across: None,
            n: Spectrum::Constant(1.0),
            k: Spectrum::TableOfRgb { table: diopter_light::spectrum::Table::from_points(&points), rgb },
            alpha: Scalar::Constant(roughness * roughness),
            bounces: crate::material::conductor::FacetBounces::Compensated,
        })
    } else if specular != Vec3::ZERO || m.unknown_param.contains_key("Pr") || m.unknown_param.contains_key("Pm") {
        let metallic = Scalar::Constant(number("Pm").unwrap_or(0.0).clamp(0.0, 1.0));
        let rough = Scalar::Constant(roughness);
        Scattering::Principled(Box::new(Principled { roughness: rough, metallic, ..Principled::new(color, ior.max(1.01)) }))
    } else {
        Scattering::Diffuse(color)
    };
    let mut made = Material::new(&m.name, scattering);
    if let Some(glow) = m.emissive.map(Vec3::from_array).filter(|k| *k != Vec3::ZERO) {
        // In cd/m², as an emissive factor of glTF.
        made.emission =
            Some(Emission { two_sided: false, ..Emission::one_sided(Spectrum::light_from_rgb(glow.max(Vec3::ZERO))) });
    }
    if !glass {
        made.coverage = match m.dissolve_texture.as_deref().and_then(&mut image) {
            Some(i) => Coverage::Blend(Scalar::Textured { factor: opacity, texture: texture(i, Codes::Linear), channel: 0 }),
            None if opacity < 1.0 => Coverage::Blend(Scalar::Constant(opacity)),
            None => Coverage::Full,
        };
    }
    // "norm" is a map of normals; "map_Bump" and "bump" are heights by the specification, but many programs write normals there, too: a picture
    // without colours is one of heights.
    let (normals, bumps) = (m.unknown_param.get("norm"), m.normal_texture.as_deref());
    if let Some(i) = normals.map(String::as_str).and_then(&mut image) {
        made.normal_map = Some((texture(i, Codes::Linear), 1.0));
    } else if let (Some(i), Some(file)) = (bumps.and_then(&mut image), bumps) {
        let strength = option_number(file, "-bm").unwrap_or(1.0);
        match i.is_grey() {
            false => made.normal_map = Some((texture(i, Codes::Linear), strength)),
            true => {
                let height = Scalar::Textured { factor: strength, texture: texture(i, Codes::Linear), channel: 0 };
                made.bump = Some(Box::new(Bump { height, unit: BumpUnit::Extent(BUMP_EXTENT) }));
            }
        }
    }
    let file = ["disp", "map_disp", "map_Disp"].into_iter().find_map(|key| m.unknown_param.get(key));
    let picture = file.and_then(|file| Some((file, image(file)?)));
    let height = picture.map(|(file, picture)| {
        // "-mm base gain": base + gain · picture.
        let shift = option_numbers(file, "-mm");
        let (base, gain) = (shift.first().copied().unwrap_or(0.0), shift.get(1).copied().unwrap_or(1.0));
        let texture = texture(picture, Codes::Linear);
        if base == 0.0 {
            return Scalar::Textured { factor: gain, texture, channel: 0 };
        }
        let red = Some([Vec3::X, Vec3::ZERO]);
        let picture = Graph::Image { texture, scale: 1.0, invert: false, as_number: red, mapping: None };
        let [from, to] = [base, base + gain].map(|v| Arc::new(Graph::Constant(Vec3::splat(v))));
        Scalar::Graph(Arc::new(Graph::Mix(from, to, Arc::new(picture))))
    });
    (made, height)
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn what_only_some_corners_have_is_left_out() {
        let gone = |_: &str| Err("not there".to_owned());
        if let Ok(d) = obj(b"v 0 0 0\nv 1 0 0\nv 1 1 0 0.5 0.5 0.5\nf 1 2 3\nv 1 1 0 0 0\nf 1 2 1\nf -2 0 06 1\n", "a.obj", &gone)
        {
            crate::Scene::build(d).unwrap();
        }
        let twice = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nproperty float nx\n\
            property float ny\nproperty float nz\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
            property list uchar int vertex_indices\nend_header\n0 0 0 0 0 1\n1 0 0 0 0 1\n0 1 0 0 0 1\n5 5 5\n3 0 1 2\n";
        let d = ply(twice.as_bytes().to_vec(), "a.ply").unwrap();
        assert!(d.warnings[0].contains("only some"), "{:?}", d.warnings);
        crate::Scene::build(d).unwrap();
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

    #[test]
    fn a_mesh_without_a_surface_is_an_error_that_names_the_file() {
        let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
        let corners = "0 0 0\n1 0 0\n0 1 0\n";
        let faces = "property list uchar int vertex_indices\nend_header\n";
        for text in [
            format!("{head}end_header\n{corners}"),
            format!("{head}element face 0\n{faces}{corners}"),
            format!("{head}element face 1\n{faces}{corners}2 0 1\n"),
            format!("{head}element tristrips 1\n{faces}{corners}2 0 1\n"),
        ] {
            let e = ply(text.clone().into_bytes(), "a.ply").unwrap_err().to_string();
            assert!(e.starts_with("a.ply: ") && e.contains("no surface") && e.contains("3 vertices"), "{text}: {e}");
        }
        let whole = ply(format!("{head}element face 1\n{faces}{corners}3 0 1 2\n").into_bytes(), "a.ply").unwrap();
        assert_eq!(whole.meshes[0].triangles, [[0, 1, 2]]);
        let none = |_: &str| Err("there is no such file".to_owned());
        let e = obj(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2\n", "a.obj", &none).unwrap_err().to_string();
        assert!(e.starts_with("a.obj: ") && e.contains("no surface"), "{e}");
        for (bytes, found) in
            [(&b"# a note\ngarbage here\n"[..], "line 2: \"garbage here\";"), (b"\xff\0\n", "line 1: \"\\xff\\x00\";")]
        {
            let e = obj(bytes, "a.obj", &none).unwrap_err().to_string();
            assert!(e.starts_with(&format!("a.obj: {found}")) && e.contains("expected an OBJ file"), "{e}");
        }
        let e = ply(b"garbage\n".to_vec(), "a.ply").unwrap_err().to_string();
        assert!(e.starts_with("a.ply: it begins with \"garbage\"; expected a PLY file"), "{e}");
    }

    #[test]
    fn both_kinds_of_stl_are_the_same_mesh() {
        let text = "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
            facet normal 0 0 1\nouter loop\nvertex 1 0 0\nvertex 1 1 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n";
        let from_text = stl(text.as_bytes(), "a.stl").unwrap();
        let mut bytes = b"solid, but binary".to_vec();
        bytes.resize(80, 0);
        bytes.extend(2u32.to_le_bytes());
        for t in [[[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]]] {
            bytes.extend([0u8; 12]);
            t.iter().flatten().for_each(|v| bytes.extend(v.to_le_bytes()));
            bytes.extend([0u8; 2]);
        }
        let from_numbers = stl(&bytes, "b.stl").unwrap();
        assert_eq!(from_text.meshes[0].positions, from_numbers.meshes[0].positions);
        assert_eq!((from_text.meshes[0].positions.len(), &from_text.meshes[0].triangles), (4, &from_numbers.meshes[0].triangles));
        for (bad, word) in [
            (&bytes[..100], "no facets"),
            (&bytes[1..], "announce"),
            (b"solid x\nvertex 1 2\n", "three numbers"),
            (b"solid x\n", "no facets"),
        ] {
            let e = stl(bad, "c.stl").unwrap_err().to_string();
            assert!(e.contains(word), "{e}");
        }
    }
}
