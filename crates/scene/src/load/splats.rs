//! Captured places as Gaussian splats: `.ply` of 3D Gaussian Splatting and `.spz`.
//!
//! PLY, as Kerbl et al. 2023 write it and most programs read it: vertices with `x y z`, `f_dc_0..2` and `f_rest_*` (coefficients of spherical
//! harmonics, channel by channel, of degree 0 to 3), `opacity` (logit), `scale_0..2` (natural logarithm of the standard deviation; discs, with two,
//! Huang et al. 2024), `rot_0..3` (quaternion, real part first). Its axes are those of COLMAP and of computer vision: x right, y down, z forward; they
//! are turned by 180° about x, so that y points up.
//!
//! SPZ (Niantic, <https://github.com/nianticlabs/spz>), versions 2 and 3: the same in 8 to 24 bits a number, gzip. Its axes are ours.
//!
//! Captures have no unit of light: display white is taken for the luminance of the standard's reference display.

use super::ply::{Body, Element, Layout, Number, PlyError, header, wrong};
use crate::SceneError;
use crate::material::Material;
use crate::scene::{Description, Object, Shape};
use crate::shape::splats::{MOST_DEGREE, Splat, Splats};
use glam::{Affine3A, Mat3, Quat, Vec3};
use rayon::prelude::*;
use std::sync::Arc;

/// Luminance of display white, cd/m²: the reference display of IEC 61966-2-1.
pub const WHITE: f32 = 80.0;

/// A file that could be read.
#[derive(Debug)]
pub struct Capture {
    /// Its Gaussians, in the axes of the file.
    pub splats: Splats,
    /// How many were left out: not finite, without extent, or never as dense as counts.
    pub dropped: usize,
}

impl Capture {
    /// The scene of a capture that stands as `place` says.
    fn described(self, name: &str, place: Mat3) -> Result<Description, SceneError> {
        let Capture { mut splats, dropped } = self;
        let all = splats.len() + dropped;
        if splats.is_empty() {
            let found = match all {
                0 => "no Gaussians".to_owned(),
                _ => format!("no surface: none of its {all} Gaussians is finite and denser than 1/255"),
            };
            return Err(SceneError::File { place: name.into(), found, expected: "expected at least one".into() });
        }
        splats.order_in_space();
        let mut warnings = Vec::new();
        if dropped > 0 {
            warnings.push(format!(
                "{name}: {dropped} of {all} Gaussians are left out: not finite, without extent, or never denser than 1/255"
            ));
        }
        let shape = Shape::Splats { splats: 0, world_from_splats: Affine3A::from_mat3(place) };
        Ok(Description {
            name: name.to_owned(),
            splats: vec![Arc::new(splats)],
            materials: vec![Material::captured("captured", WHITE)],
            objects: vec![Object::new(name, shape, 0)],
            warnings,
            ..Default::default()
        })
    }
}

/// The scene of a PLY file of Gaussians; `None` of one that holds something else.
pub(super) fn ply(bytes: &[u8], name: &str) -> Result<Option<Description>, SceneError> {
    let read = read_ply(bytes).map_err(|e| SceneError::File {
        place: name.into(),
        found: e.found,
        expected: format!("expected {}", e.expected),
    })?;
    read.map(|capture| capture.described(name, Mat3::from_diagonal(Vec3::new(1.0, -1.0, -1.0)))).transpose()
}

/// Reads what an SPZ file holds.
pub(super) fn unpacked_spz(bytes: &[u8]) -> Result<Capture, PlyError> {
    let bytes = super::unzipped(bytes.to_vec()).map_err(|e| wrong(e, "an SPZ file, which is gzip"))?;
    read_spz(&bytes)
}

/// Reads an SPZ file. Fails where it is no gzip, not of version 2 or 3, cut short, or none of its Gaussians is usable.
pub fn spz(bytes: Vec<u8>, name: &str) -> Result<Description, SceneError> {
    let error =
        |e: PlyError| SceneError::File { place: name.into(), found: e.found, expected: format!("expected {}", e.expected) };
    let bytes = super::unzipped(bytes).map_err(|e| error(wrong(e, "an SPZ file, which is gzip")))?;
    read_spz(&bytes).map_err(error)?.described(name, Mat3::IDENTITY)
}

/// Numbers of a Gaussian in the order of [`slot`].
type Row = [f32; 59];
/// Where in a [`Row`] the numbers begin that have no fixed count.
const REST: usize = 14;
/// Gaussians read by a thread at a time.
const CHUNK: usize = 16_384;

/// Where the number of a property goes in a [`Row`].
fn slot(name: &str) -> Option<usize> {
    let numbered = |prefix: &str, first: usize, count: usize| {
        let i: usize = name.strip_prefix(prefix)?.parse().ok()?;
        (i < count).then(|| first + i)
    };
    let fixed = ["x", "y", "z"].iter().position(|n| *n == name).or_else(|| (name == "opacity").then_some(6));
    fixed
        .or_else(|| numbered("f_dc_", 3, 3))
        .or_else(|| numbered("scale_", 7, 3))
        .or_else(|| numbered("rot_", 10, 4))
        .or_else(|| numbered("f_rest_", REST, 45))
}

/// What the rows of a file have.
#[derive(Clone, Copy, Debug)]
struct Form {
    degree: u32,
    /// Coefficients of a channel beyond the first.
    rest: usize,
    discs: bool,
}

impl Form {
    fn of(element: &Element) -> Result<Form, PlyError> {
        let has = |name: &str| element.properties.iter().any(|p| p.list.is_none() && p.name == name);
        if has("packed_position") {
            let expected =
                "Gaussians with x, y, z, scale_0 ... as 3D Gaussian Splatting writes them: export them uncompressed, or as .spz";
            return Err(wrong("Gaussians packed in chunks (packed_position)", expected));
        }
        let needed =
            ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "rot_0", "rot_1", "rot_2", "rot_3"];
        if let Some(missing) = needed.iter().find(|n| !has(n)) {
            return Err(wrong(format!("Gaussians without \"{missing}\""), format!("vertices with {}", needed.join(", "))));
        }
        let count = element.properties.iter().filter(|p| p.name.starts_with("f_rest_")).count();
        let whole = (0..count).all(|i| has(&format!("f_rest_{i}")));
        let degree = (0..=MOST_DEGREE).find(|l| 3 * ((l + 1) * (l + 1) - 1) as usize == count).filter(|_| whole);
        let degree = degree.ok_or_else(|| {
            let expected = "0, 9, 24 or 45 of them from f_rest_0 on: harmonics of degree 0 to 3";
            wrong(format!("{count} properties f_rest_*"), expected)
        })?;
        Ok(Form { degree, rest: count / 3, discs: !has("scale_2") })
    }

    /// Adds the Gaussian of a row; whether it is usable.
    fn push(&self, row: &Row, splats: &mut Splats) -> bool {
        let triple = |at: usize| Vec3::new(row[at], row[at + 1], row[at + 2]);
        let mut scale = triple(7).map(f32::exp);
        if self.discs {
            scale.z = 0.0;
        }
        let splat = Splat {
            center: triple(0),
            rotation: Quat::from_xyzw(row[11], row[12], row[13], row[10]),
            scale,
            opacity: 1.0 / (1.0 + (-row[6]).exp()),
        };
        let mut harmonics = [Vec3::ZERO; 16];
        harmonics[0] = triple(3);
        for (i, c) in harmonics[1..].iter_mut().take(self.rest).enumerate() {
            *c = Vec3::from_array([0, 1, 2].map(|channel: usize| row[REST + channel * self.rest + i]));
        }
        splats.push(&splat, &harmonics[..=self.rest])
    }
}

/// Puts parts together that were read by several threads.
fn joined(degree: u32, parts: Vec<(Splats, usize)>) -> Capture {
    let mut all = Capture { splats: Splats::new(degree), dropped: 0 };
    for (splats, dropped) in parts {
        all.splats.append(splats);
        all.dropped += dropped;
    }
    all
}

/// Reads a PLY file; `None` if its vertices are no Gaussians, or its header cannot be read: whoever expects polygons will say so.
fn read_ply(bytes: &[u8]) -> Result<Option<Capture>, PlyError> {
    let Ok((layout, elements, start)) = header(bytes) else { return Ok(None) };
    let is_gaussian = |e: &Element| {
        let has = |name: &str| e.properties.iter().any(|p| p.name == name);
        e.name == "vertex" && (has("f_dc_0") || has("packed_position") || has("opacity") && has("scale_0") && has("rot_0"))
    };
    let Some(place) = elements.iter().position(is_gaussian) else { return Ok(None) };
    let mut body = Body { bytes: &bytes[start..], at: 0, layout };
    for before in &elements[..place] {
        before.check_count(&body)?;
        (0..before.count).try_for_each(|_| before.properties.iter().try_for_each(|p| body.skip(p)))?;
    }
    let element = &elements[place];
    let form = Form::of(element)?;
    element.check_count(&body)?;
    let plain = layout != Layout::Text && element.properties.iter().all(|p| p.list.is_none());
    if plain {
        let big = layout == Layout::Big;
        let mut columns: Vec<(usize, Number, usize)> = Vec::new();
        let mut stride = 0;
        for property in &element.properties {
            columns.extend(slot(&property.name).map(|to| (stride, property.kind, to)));
            stride += property.kind.size();
        }
        let data = body.take(element.count.saturating_mul(stride))?;
        let part = |rows: &[u8]| {
            let (mut splats, mut dropped) = (Splats::new(form.degree), 0);
            for bytes in rows.chunks_exact(stride) {
                let mut row: Row = [0.0; 59];
                columns.iter().for_each(|(from, kind, to)| row[*to] = kind.of(&bytes[*from..], big) as f32);
                dropped += usize::from(!form.push(&row, &mut splats));
            }
            (splats, dropped)
        };
        return Ok(Some(joined(form.degree, data.par_chunks(stride * CHUNK).map(part).collect())));
    }
    let mut all = Capture { splats: Splats::new(form.degree), dropped: 0 };
    for _ in 0..element.count {
        let mut row: Row = [0.0; 59];
        for property in &element.properties {
            match slot(&property.name).filter(|_| property.list.is_none()) {
                Some(to) => row[to] = body.number(property.kind)? as f32,
                None => body.skip(property)?,
            }
        }
        all.dropped += usize::from(!form.push(&row, &mut all.splats));
    }
    Ok(Some(all))
}

/// "NGSP", little-endian.
const SPZ_MAGIC: u32 = 0x5053_474e;
const SPZ_HEADER: usize = 16;
/// Coefficients of degree 0 are stored as ½ + 0.15 c.
const SPZ_COLOR: f32 = 0.15;

/// Reads what is in the gzip of an SPZ file: a header and then positions, alphas, colours, scales, rotations and harmonics, each of all Gaussians.
/// Source: the description and the reader of <https://github.com/nianticlabs/spz>.
fn read_spz(bytes: &[u8]) -> Result<Capture, PlyError> {
    let word = |at: usize| bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]));
    let expected = "an SPZ file of version 2 or 3";
    if word(0) != Some(SPZ_MAGIC) || bytes.len() < SPZ_HEADER {
        return Err(wrong(format!("{} bytes that do not begin with NGSP", bytes.len()), expected));
    }
    let version = word(4).unwrap_or(0);
    let rotation_bytes = match version {
        2 => 3,
        3 => 4,
        other => return Err(wrong(format!("version {other}"), format!("{expected}; others can be converted to .ply"))),
    };
    let (count, degree, fraction_bits) = (word(8).unwrap_or(0) as usize, u32::from(bytes[12]), i32::from(bytes[13]));
    if degree > MOST_DEGREE {
        return Err(wrong(format!("harmonics of degree {degree}"), "0 to 3"));
    }
    if fraction_bits > 24 {
        return Err(wrong(format!("{fraction_bits} bits of fraction"), "at most 24, as many as positions have"));
    }
    let rest = ((degree + 1) * (degree + 1) - 1) as usize;
    let mut left = &bytes[SPZ_HEADER..];
    let mut section = |size: usize| {
        let bytes = count.checked_mul(size).filter(|n| *n <= left.len());
        let bytes = bytes.ok_or_else(|| wrong(format!("{count} Gaussians"), "as many as the file holds: it is cut short"))?;
        let (own, others) = left.split_at(bytes);
        left = others;
        Ok(own)
    };
    let (positions, alphas, colors) = (section(9)?, section(1)?, section(3)?);
    let (scales, rotations, harmonics) = (section(3)?, section(rotation_bytes)?, section(3 * rest)?);
    let unit = (-fraction_bits as f32).exp2();
    let bytes3 = |all: &[u8], i: usize| Vec3::new(all[3 * i].into(), all[3 * i + 1].into(), all[3 * i + 2].into());
    let one = |i: usize, splats: &mut Splats| {
        let at = |k: usize| {
            let b = &positions[9 * i + 3 * k..][..3];
            // The sign is that of the upper byte.
            (i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8) as f32 * unit
        };
        let mut all = [Vec3::ZERO; 16];
        all[0] = (bytes3(colors, i) / 255.0 - 0.5) / SPZ_COLOR;
        for (k, c) in all[1..=rest].iter_mut().enumerate() {
            *c = (bytes3(harmonics, i * rest + k) - 128.0) / 128.0;
        }
        let splat = Splat {
            center: Vec3::new(at(0), at(1), at(2)),
            rotation: spz_rotation(&rotations[rotation_bytes * i..][..rotation_bytes]),
            scale: (bytes3(scales, i) / 16.0 - 10.0).map(f32::exp),
            opacity: f32::from(alphas[i]) / 255.0,
        };
        splats.push(&splat, &all[..=rest])
    };
    let part = |k: usize| {
        let (mut splats, mut dropped) = (Splats::new(degree), 0);
        for i in k * CHUNK..((k + 1) * CHUNK).min(count) {
            dropped += usize::from(!one(i, &mut splats));
        }
        (splats, dropped)
    };
    Ok(joined(degree, (0..count.div_ceil(CHUNK)).into_par_iter().map(part).collect()))
}

/// A unit quaternion: in three bytes x, y and z, with w not negative; in four the index of the largest component in the upper two bits and of the
/// others, from the last to the first upward, magnitudes of nine bits below a sign.
fn spz_rotation(bytes: &[u8]) -> Quat {
    if let [x, y, z] = bytes[..] {
        let v = Vec3::new(x.into(), y.into(), z.into()) / 127.5 - 1.0;
        return Quat::from_vec4(v.extend((1.0 - v.length_squared()).max(0.0).sqrt())).normalize();
    }
    let mut packed = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
    let largest = (packed >> 30) as usize;
    let mut q = [0.0f32; 4];
    for i in (0..4).rev().filter(|i| *i != largest) {
        let magnitude = (packed & 511) as f32 / 511.0 * std::f32::consts::FRAC_1_SQRT_2;
        q[i] = if packed >> 9 & 1 == 1 { -magnitude } else { magnitude };
        packed >>= 10;
    }
    q[largest] = (1.0 - q.iter().map(|c| c * c).sum::<f32>()).max(0.0).sqrt();
    Quat::from_array(q).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scene;
    use diopter_light::Ray;
    use std::io::Write;

    const NAMES: [&str; 17] = [
        "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0",
        "rot_1", "rot_2", "rot_3",
    ];

    /// A file with harmonics of a degree; `change` may spoil its header.
    fn file(format: &str, degree: usize, rows: &[Vec<f32>], change: impl Fn(String) -> String) -> Vec<u8> {
        let rest = 3 * ((degree + 1).pow(2) - 1);
        let mut names: Vec<String> = NAMES[..9].iter().map(|n| (*n).into()).collect();
        names.extend((0..rest).map(|i| format!("f_rest_{i}")));
        names.extend(NAMES[9..].iter().map(|n| (*n).to_string()));
        let properties: String = names.iter().map(|n| format!("property float {n}\n")).collect();
        let head = format!("ply\nformat {format} 1.0\nelement vertex {}\n{properties}end_header\n", rows.len());
        let mut bytes = change(head).into_bytes();
        for row in rows {
            assert_eq!(row.len(), names.len());
            match format {
                "ascii" => bytes.extend(row.iter().map(|v| format!("{v:e} ")).collect::<String>().into_bytes()),
                "binary_big_endian" => row.iter().for_each(|v| bytes.extend(v.to_be_bytes())),
                _ => row.iter().for_each(|v| bytes.extend(v.to_le_bytes())),
            }
        }
        bytes
    }

    /// A Gaussian at (1, 2, 3) with an opacity of one half, 0.1 × 0.2 × 0.3 m, whose `f_rest_i` is (i + 1) / 100.
    fn row(degree: usize) -> Vec<f32> {
        let rest = 3 * ((degree + 1).pow(2) - 1);
        let mut row = vec![1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.5, -0.25, 0.125];
        row.extend((0..rest).map(|i| (i + 1) as f32 / 100.0));
        row.push(0.0);
        row.extend([0.1f32, 0.2, 0.3].map(f32::ln));
        row.extend([2.0, 0.0, 0.0, 0.0]);
        row
    }

    fn read(bytes: Vec<u8>) -> Result<Description, String> {
        crate::load::mesh::ply(bytes, "a.ply").map_err(|e| e.to_string())
    }

    #[test]
    fn numbers_of_all_layouts_and_degrees_are_read() {
        for degree in 0..=3 {
            for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
                let d = read(file(format, degree, &[row(degree), row(degree)], |h| h)).unwrap();
                assert!(d.warnings.is_empty() && d.splats[0].len() == 2 && d.has_surface());
                let splats = &d.splats[0];
                assert_eq!(splats.coefficients(), (degree + 1).pow(2));
                // Channels come one after the other: of the second coefficient, −y, they are n apart.
                let n = splats.coefficients() - 1;
                let expected = |channel: usize| {
                    let mut value = 0.5 + 0.282_094_8 * [0.5, -0.25, 0.125][channel];
                    if degree > 0 {
                        // Along +y, of degree 1 only the first counts.
                        value -= 0.488_602_5 * (channel * n + 1) as f32 / 100.0;
                    }
                    diopter_light::color::srgb_decode(value)
                };
                if degree <= 1 {
                    let color = splats.color(1, Vec3::Y);
                    let expected = Vec3::from_array([0, 1, 2].map(expected));
                    assert!((color - expected).abs().max_element() < 1e-3, "{degree} {format}: {color} {expected}");
                }
                // One standard deviation beside its middle, along its first axis.
                let hit = splats.intersect(0, Vec3::new(1.1, 2.0, 0.0), Vec3::Z, 9.0).unwrap();
                assert!((hit.t - 3.0).abs() < 1e-5 && (hit.alpha - 0.5 * (-0.5f32).exp()).abs() < 1e-5, "{hit:?}");
            }
        }
    }

    #[test]
    fn a_capture_stands_upright_and_is_seen() {
        let scene = Scene::build(read(file("binary_little_endian", 0, &[row(0)], |h| h)).unwrap()).unwrap();
        assert_eq!((scene.splat_count(), scene.lights().area.len()), (1, 0));
        // y and z change their signs.
        let ray = |i: u32| Ray { origin: Vec3::new(1.0, -2.0, i as f32 * 0.01), direction: Vec3::NEG_Z, time_s: 0.0 };
        let seen: Vec<_> = (0..400).filter_map(|i| scene.intersect(&ray(i), f32::INFINITY)).collect();
        // Half of 400, within three standard errors.
        assert!((170..=230).contains(&seen.len()), "{}", seen.len());
        assert!(seen.iter().all(|s| s.point.abs_diff_eq(Vec3::new(1.0, -2.0, -3.0), 1e-4)));
    }

    #[test]
    fn discs_and_unusable_gaussians() {
        let without_third = |h: String| h.replace("property float scale_2\n", "");
        let mut disc = row(0);
        disc.remove(12);
        let mut bytes = without_third(String::from_utf8(file("ascii", 0, &[row(0)], |h| h)[..].to_vec()).unwrap()).into_bytes();
        let start = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
        bytes.truncate(start);
        bytes.extend(disc.iter().map(|v| format!("{v:e} ")).collect::<String>().into_bytes());
        let d = read(bytes).unwrap();
        assert_eq!(d.splats[0].normal(0), Vec3::Z);
        // One is not finite, one never dense enough.
        let (mut bad, mut thin) = (row(0), row(0));
        (bad[0], thin[9]) = (f32::NAN, -9.0);
        let d = read(file("binary_little_endian", 0, &[bad.clone(), row(0), thin], |h| h)).unwrap();
        assert!(d.splats[0].len() == 1 && d.warnings.len() == 1 && d.warnings[0].contains("2 of 3"), "{:?}", d.warnings);
        let e = read(file("binary_little_endian", 0, &[bad], |h| h)).unwrap_err();
        assert!(e.contains("a.ply: no surface"), "{e}");
    }

    #[test]
    fn wrong_files_say_what_is_wrong() {
        for (from, to, word) in [
            ("element vertex 1", "element vertex 2", "cut short"),
            ("element vertex 1", "element vertex 99999999999999", "cut short"),
            ("element vertex 1", "element vertex 0", "no Gaussians"),
            ("float rot_3", "float rot_x", "without \"rot_3\""),
            ("float f_rest_8", "float f_rest_9", "f_rest_"),
            ("float f_rest_8", "float other", "8 properties f_rest_*"),
            ("float x\n", "float packed_position\n", "export them uncompressed"),
        ] {
            let e = read(file("binary_little_endian", 1, &[row(1)], |h| h.replacen(from, to, 1))).unwrap_err();
            assert!(e.starts_with("a.ply: ") && e.contains(word), "{to}: {e}");
        }
        let whole = file("binary_little_endian", 1, &[row(1)], |h| h);
        assert!(read(whole[..whole.len() - 1].to_vec()).unwrap_err().contains("cut short"));
    }

    /// What is in the gzip: one Gaussian of degree 1 at (1, −2, −0.5).
    fn packed(version: u32, rotation: &[u8]) -> Vec<u8> {
        let mut bytes: Vec<u8> = [SPZ_MAGIC, version, 1].iter().flat_map(|v| v.to_le_bytes()).collect();
        bytes.extend([1, 12, 0, 0]);
        for v in [1.0f32, -2.0, -0.5] {
            bytes.extend_from_slice(&((v * 4096.0) as i32).to_le_bytes()[..3]);
        }
        bytes.extend([204, 255, 128, 0]);
        // e^-2, e^-1 and e^-3 m.
        bytes.extend([128, 144, 112]);
        bytes.extend(rotation);
        bytes.extend([128, 128, 128, 192, 128, 64, 128, 128, 128]);
        bytes
    }

    fn zipped(bytes: &[u8]) -> Vec<u8> {
        let mut zip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        zip.write_all(bytes).unwrap();
        zip.finish().unwrap()
    }

    #[test]
    fn packed_files_of_both_versions_are_the_same_capture() {
        // A quarter turn about z, (0, 0, √½, √½): the last of the two largest is left out, the others are 0, 0 and the largest magnitude.
        let smallest_three = 3u32 << 30 | 511;
        for (version, rotation) in [(2, vec![128, 128, 218]), (3, smallest_three.to_le_bytes().to_vec())] {
            let d = spz(zipped(&packed(version, &rotation)), "a.spz").unwrap();
            let splats = &d.splats[0];
            // Turned, its longest axis (its y) lies along −x, e^-1 m; bytes of a rotation are off by up to a degree.
            let origin = Vec3::new(1.0 + (-1f32).exp(), -2.0, 4.0);
            let hit = splats.intersect(0, origin, Vec3::NEG_Z, 9.0).unwrap();
            assert!((hit.t - 4.5).abs() < 0.01 && (hit.alpha - 0.8 * (-0.5f32).exp()).abs() < 0.01, "{version}: {hit:?}");
            // Degree 0: (c / 255 − ½) / 0.15; degree 1: red and blue of z are ±½.
            let display = |code: f32, z: f32| 0.5 + 0.282_094_8 * (code / 255.0 - 0.5) / 0.15 + 0.488_602_5 * z;
            let expected = Vec3::new(display(255.0, 0.5), display(128.0, 0.0), display(0.0, -0.5));
            let expected = expected.max(Vec3::ZERO).map(diopter_light::color::srgb_decode);
            let color = splats.color(0, Vec3::Z);
            assert!((color - expected).abs().max_element() < 5e-3, "{color} {expected}");
            let Shape::Splats { world_from_splats, .. } = d.objects[0].shape else { panic!("splats") };
            assert_eq!(world_from_splats, Affine3A::IDENTITY);
        }
    }

    #[test]
    fn every_rotation_of_four_bytes_is_a_rotation_and_known_ones_are_right() {
        // 30° about (1, 2, 2) / 3: w is the largest; x, y, z = sin 15° · (1, 2, 2) / 3.
        let s = 15f32.to_radians().sin();
        let code = |v: f32| (v * std::f32::consts::SQRT_2 * 511.0).round() as u32;
        let packed = 3u32 << 30 | code(s / 3.0) << 20 | code(s * 2.0 / 3.0) << 10 | code(s * 2.0 / 3.0);
        let q = spz_rotation(&packed.to_le_bytes());
        let expected = Quat::from_axis_angle(Vec3::new(1.0, 2.0, 2.0) / 3.0, 30f32.to_radians());
        assert!(q.dot(expected) > 0.99999, "{q} {expected}");
        for i in 0..1000u32 {
            let q = spz_rotation(&diopter_light::random::mix(i).to_le_bytes());
            assert!((q.length() - 1.0).abs() < 1e-5, "{q}");
        }
    }

    #[test]
    fn wrong_packed_files_say_what_is_wrong() {
        let good = packed(3, &[0; 4]);
        let with = |at: usize, byte: u8| {
            let mut bytes = good.clone();
            bytes[at] = byte;
            bytes
        };
        for (bytes, word) in [
            (with(0, 1), "NGSP"),
            (vec![], "NGSP"),
            (with(4, 1), "version 1"),
            (with(4, 4), "converted to .ply"),
            (with(12, 4), "degree 4"),
            (with(13, 60), "60 bits"),
            (with(8, 2), "cut short"),
            (with(11, 255), "cut short"),
            (with(8, 0), "no Gaussians"),
            (good[..good.len() - 1].to_vec(), "cut short"),
        ] {
            let e = spz(zipped(&bytes), "a.spz").unwrap_err().to_string();
            assert!(e.starts_with("a.spz: ") && e.contains(word), "{word}: {e}");
        }
    }
}
