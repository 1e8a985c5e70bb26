//! PLY: polygons as text or numbers, little- or big-endian.
//!
//! Source: G. Turk 1994, "The PLY polygon file format". Properties of any type and order; faces of any number of corners (concave ones where their vertices stand before them);
//! triangle strips as the models of the Stanford 3D Scanning Repository have them.

use super::polygon::triangulate;
use crate::shape::Mesh;
use glam::{Vec2, Vec3, Vec4};
use rayon::prelude::*;

/// What is wrong with a file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PlyError {
    /// What is there.
    pub found: String,
    /// What belongs there.
    pub expected: String,
}

/// A file that could be read.
#[derive(Debug)]
pub struct Read {
    /// Its triangles.
    pub mesh: Mesh,
    /// What was odd.
    pub warning: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Number {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Number {
    fn named(name: &str) -> Option<Number> {
        Some(match name {
            "char" | "int8" => Number::I8,
            "uchar" | "uint8" => Number::U8,
            "short" | "int16" => Number::I16,
            "ushort" | "uint16" => Number::U16,
            "int" | "int32" => Number::I32,
            "uint" | "uint32" => Number::U32,
            "float" | "float32" => Number::F32,
            "double" | "float64" => Number::F64,
            _ => return None,
        })
    }

    pub(super) fn size(self) -> usize {
        match self {
            Number::I8 | Number::U8 => 1,
            Number::I16 | Number::U16 => 2,
            Number::I32 | Number::U32 | Number::F32 => 4,
            Number::F64 => 8,
        }
    }

    /// Value of its bytes, turned to little-endian first where needed.
    #[inline]
    pub(super) fn of(self, bytes: &[u8], big: bool) -> f64 {
        macro_rules! get {
            ($type:ty, $n:literal) => {{
                let b: [u8; $n] = std::array::from_fn(|i| bytes[i]);
                (if big { <$type>::from_be_bytes(b) } else { <$type>::from_le_bytes(b) }) as f64
            }};
        }
        match self {
            Number::I8 => get!(i8, 1),
            Number::U8 => get!(u8, 1),
            Number::I16 => get!(i16, 2),
            Number::U16 => get!(u16, 2),
            Number::I32 => get!(i32, 4),
            Number::U32 => get!(u32, 4),
            Number::F32 => get!(f32, 4),
            Number::F64 => get!(f64, 8),
        }
    }
}

#[derive(Clone, Debug)]
pub(super) struct Property {
    pub name: String,
    pub kind: Number,
    /// Of a list: the type of its length.
    pub list: Option<Number>,
}

#[derive(Clone, Debug)]
pub(super) struct Element {
    pub name: String,
    pub count: usize,
    pub properties: Vec<Property>,
}

impl Element {
    /// Fails if there are more than what is left of a file can hold: at least a byte for each value.
    pub fn check_count(&self, body: &Body) -> Result<(), PlyError> {
        let least = self.properties.len().max(1);
        if self.count.checked_mul(least).is_none_or(|n| n > body.bytes.len().saturating_sub(body.at)) && self.count > 0 {
            return Err(wrong(format!("{} {}", self.count, self.name), "as many as the file holds: it is cut short"));
        }
        Ok(())
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Layout {
    Text,
    Little,
    Big,
}

pub(super) fn wrong(found: impl Into<String>, expected: impl Into<String>) -> PlyError {
    PlyError { found: found.into(), expected: expected.into() }
}

/// Reads a file of polygons. Fails where its header is wrong, it is cut short, a number is none, it has no vertices with x, y and z, or a corner is a vertex that is not
/// there.
pub fn read(bytes: &[u8]) -> Result<Read, PlyError> {
    let (layout, elements, start) = header(bytes)?;
    let mut body = Body { bytes: &bytes[start..], at: 0, layout };
    let mut mesh = Mesh::default();
    let mut skipped = 0usize;
    for element in &elements {
        element.check_count(&body)?;
        match element.name.as_str() {
            "vertex" => vertices(&mut body, element, &mut mesh)?,
            "face" => skipped += faces(&mut body, element, &mut mesh)?,
            "tristrips" => strips(&mut body, element, &mut mesh)?,
            _ => {
                for _ in 0..element.count {
                    for property in &element.properties {
                        body.skip(property)?;
                    }
                }
            }
        }
    }
    if mesh.positions.is_empty() {
        return Err(wrong("no vertices", "an element \"vertex\" with x, y and z"));
    }
    let count = mesh.positions.len();
    if let Some(t) = mesh.triangles.par_iter().find_any(|t| t.iter().any(|i| *i as usize >= count)) {
        let i = t.iter().max().unwrap_or(&0);
        return Err(wrong(format!("corner number {i}"), format!("less than {count}, the number of vertices")));
    }
    let mut warnings = Vec::new();
    if skipped > 0 {
        warnings.push(format!("{skipped} faces with fewer than three corners are left out"));
    }
    if mesh.triangles.is_empty() {
        warnings.push("it has no faces: nothing of it is seen".to_owned());
    }
    for (name, what) in
        [("red", "colours of faces"), ("texcoord", "texture coordinates of corners, and the picture that they are for,")]
    {
        if elements.iter().any(|e| e.name == "face" && e.properties.iter().any(|p| p.name == name)) {
            warnings.push(format!("{what} are left out"));
        }
    }
    let head = String::from_utf8_lossy(&bytes[..start]);
    if let Some(file) = head.lines().find_map(|line| line.trim().strip_prefix("comment TextureFile")) {
        warnings.push(format!("the picture \"{}\" is left out", file.trim()));
    }
    // Vertices may come in two parts that say different things.
    if mesh.drop_partial_lists() {
        warnings.push("what only some of the vertices have is left out".to_owned());
    }
    let warning = (!warnings.is_empty()).then(|| warnings.join("; "));
    Ok(Read { mesh, warning })
}

pub(super) fn header(bytes: &[u8]) -> Result<(Layout, Vec<Element>, usize), PlyError> {
    let mut at = 0;
    let mut line = || -> Result<Option<String>, PlyError> {
        let rest = &bytes[at.min(bytes.len())..];
        if rest.is_empty() {
            return Ok(None);
        }
        let end =
            rest.iter().take(65_536).position(|c| *c == b'\n').ok_or_else(|| wrong("a header without end", "end_header"))?;
        at += end + 1;
        let text = std::str::from_utf8(&rest[..end]).map_err(|_| wrong("bytes that are not text", "a PLY header"))?;
        Ok(Some(text.trim_end_matches('\r').trim().to_owned()))
    };
    if !bytes.starts_with(b"ply") || line()?.as_deref() != Some("ply") {
        return Err(wrong(super::beginning(bytes), "a PLY file, which begins with \"ply\""));
    }
    let (mut layout, mut elements): (Option<Layout>, Vec<Element>) = (None, vec![]);
    loop {
        let Some(text) = line()? else { return Err(wrong("a header without end", "end_header")) };
        let words: Vec<&str> = text.split_ascii_whitespace().collect();
        match words[..] {
            [] | ["comment" | "obj_info", ..] => (),
            ["format", name, _] => {
                layout = Some(match name {
                    "ascii" => Layout::Text,
                    "binary_little_endian" => Layout::Little,
                    "binary_big_endian" => Layout::Big,
                    other => return Err(wrong(format!("format {other}"), "ascii, binary_little_endian or binary_big_endian")),
                });
            }
            ["element", name, count] => {
                let count = count.parse().map_err(|_| wrong(format!("{count} elements"), "a number"))?;
                elements.push(Element { name: name.to_owned(), count, properties: vec![] });
            }
            ["property", ref rest @ ..] => {
                let element = elements.last_mut().ok_or_else(|| wrong("a property of nothing", "an element before it"))?;
                let kind = |name: &str| {
                    Number::named(name).ok_or_else(|| wrong(format!("type {name}"), "a type such as float or uchar"))
                };
                element.properties.push(match rest {
                    ["list", length, of, name] => {
                        Property { name: (*name).to_owned(), kind: kind(of)?, list: Some(kind(length)?) }
                    }
                    [of, name] => Property { name: (*name).to_owned(), kind: kind(of)?, list: None },
                    _ => return Err(wrong(format!("\"{text}\""), "a type and a name")),
                });
            }
            ["end_header"] => break,
            _ => return Err(wrong(format!("\"{text}\""), "a line of a PLY header")),
        }
    }
    let layout = layout.ok_or_else(|| wrong("no format", "a line such as \"format ascii 1.0\""))?;
    Ok((layout, elements, at))
}

pub(super) struct Body<'a> {
    pub bytes: &'a [u8],
    pub at: usize,
    pub layout: Layout,
}

impl Body<'_> {
    /// The next `n` bytes. Fails where fewer are left.
    pub fn take(&mut self, n: usize) -> Result<&[u8], PlyError> {
        let part = self
            .bytes
            .get(self.at..self.at.saturating_add(n))
            .ok_or_else(|| wrong("the end of the file", "more data: it is cut short"))?;
        self.at += n;
        Ok(part)
    }

    /// The next number, in the layout of the file; `kind` counts in binary ones. Fails at the end of the file, or where text is no number.
    pub fn number(&mut self, kind: Number) -> Result<f64, PlyError> {
        if self.layout != Layout::Text {
            let big = self.layout == Layout::Big;
            return Ok(kind.of(self.take(kind.size())?, big));
        }
        while self.bytes.get(self.at).is_some_and(u8::is_ascii_whitespace) {
            self.at += 1;
        }
        let from = self.at;
        while self.bytes.get(self.at).is_some_and(|c| !c.is_ascii_whitespace()) {
            self.at += 1;
        }
        let word = std::str::from_utf8(&self.bytes[from..self.at]).unwrap_or("?");
        if word.is_empty() {
            return Err(wrong("the end of the file", "more data: it is cut short"));
        }
        word.parse().map_err(|_| wrong(format!("\"{word}\""), "a number"))
    }

    fn length(&mut self, kind: Number) -> Result<usize, PlyError> {
        let n = self.number(kind)?;
        let left = self.bytes.len() - self.at.min(self.bytes.len());
        if n < 0.0 || n.fract() != 0.0 || n > left as f64 + 1.0 {
            return Err(wrong(format!("a list of {n}"), "as many numbers as the file holds"));
        }
        Ok(n as usize)
    }

    /// Passes over the value or list of a property. Fails where the file is cut short, or the length of a list is no whole number that fits into what is left.
    pub fn skip(&mut self, property: &Property) -> Result<(), PlyError> {
        let n = match property.list {
            Some(length) => self.length(length)?,
            None => 1,
        };
        (0..n).try_for_each(|_| self.number(property.kind).map(|_| ()))
    }
}

/// Where a property of a vertex goes.
#[derive(Clone, Copy)]
enum Target {
    Position(usize),
    Normal(usize),
    Uv(usize),
    /// And what it is divided by.
    Color(usize, f32),
    Nowhere,
}

/// Which part of a colour a property is, by the names that programs give it.
fn color_of(name: &str) -> Option<usize> {
    const NAMES: [[&str; 3]; 4] = [
        ["red", "r", "diffuse_red"],
        ["green", "g", "diffuse_green"],
        ["blue", "b", "diffuse_blue"],
        ["alpha", "a", "diffuse_alpha"],
    ];
    NAMES.iter().position(|names| names.contains(&name))
}

fn vertices(body: &mut Body, element: &Element, mesh: &mut Mesh) -> Result<(), PlyError> {
    let goes = |p: &Property| match p.name.as_str() {
        _ if p.list.is_some() => Target::Nowhere,
        "x" => Target::Position(0),
        "y" => Target::Position(1),
        "z" => Target::Position(2),
        "nx" => Target::Normal(0),
        "ny" => Target::Normal(1),
        "nz" => Target::Normal(2),
        "u" | "s" | "texture_u" | "texture_s" => Target::Uv(0),
        "v" | "t" | "texture_v" | "texture_t" => Target::Uv(1),
        name if let Some(i) = color_of(name) => {
            // Whole numbers of any type hold codes of 8 bits, but those of 16.
            let most = match p.kind {
                Number::F32 | Number::F64 => 1.0,
                Number::U16 => 65535.0,
                _ => 255.0,
            };
            Target::Color(i, most)
        }
        _ => Target::Nowhere,
    };
    let targets: Vec<Target> = element.properties.iter().map(goes).collect();
    let count_of = |f: fn(&Target) -> bool| targets.iter().filter(|w| f(w)).count();
    if count_of(|w| matches!(w, Target::Position(_))) != 3 {
        return Err(wrong("vertices without x, y and z", "these three"));
    }
    let normals = count_of(|w| matches!(w, Target::Normal(_))) == 3;
    let uvs = count_of(|w| matches!(w, Target::Uv(_))) == 2;
    let colors = count_of(|w| matches!(w, Target::Color(..))) >= 3;
    mesh.positions.reserve(element.count);
    let stride: usize = element.properties.iter().map(|p| p.kind.size()).sum();
    if body.layout != Layout::Text && element.properties.iter().all(|p| p.list.is_none()) && !(normals || uvs || colors) {
        // Places alone, each as long as the next: all at once.
        let big = body.layout == Layout::Big;
        let mut at = [(0, Number::F32); 3];
        let mut offset = 0;
        for (property, target) in element.properties.iter().zip(&targets) {
            if let Target::Position(i) = target {
                at[*i] = (offset, property.kind);
            }
            offset += property.kind.size();
        }
        let bytes = body.take(element.count.saturating_mul(stride))?;
        let place = |row: &[u8]| Vec3::from_array(at.map(|(offset, kind)| kind.of(&row[offset..], big) as f32));
        mesh.positions.par_extend(bytes.par_chunks_exact(stride).map(place));
        return Ok(());
    }
    for _ in 0..element.count {
        let (mut position, mut normal, mut uv, mut color) = (Vec3::ZERO, Vec3::ZERO, Vec2::ZERO, Vec4::ONE);
        for (property, target) in element.properties.iter().zip(&targets) {
            if property.list.is_some() {
                body.skip(property)?;
                continue;
            }
            let v = body.number(property.kind)? as f32;
            match target {
                Target::Position(i) => position[*i] = v,
                Target::Normal(i) => normal[*i] = v,
                Target::Uv(i) => uv[*i] = v,
                Target::Color(i, most) => color[*i] = v / most,
                Target::Nowhere => (),
            }
        }
        mesh.positions.push(position);
        if normals {
            mesh.normals.push(normal.normalize_or(Vec3::Z));
        }
        if uvs {
            mesh.uvs[0].push(uv);
        }
        if colors {
            let linear = |c: f32| diopter_light::color::srgb_decode(c);
            mesh.colors.push(Vec4::new(linear(color.x), linear(color.y), linear(color.z), color.w));
        }
    }
    Ok(())
}

/// Whether a property lists the corners of a face or strip.
fn is_corners(p: &Property) -> bool {
    p.list.is_some() && matches!(p.name.as_str(), "vertex_indices" | "vertex_index")
}

/// Number of a vertex.
fn corner(number: f64) -> Result<u32, PlyError> {
    if !(0.0..2_147_483_648.0).contains(&number) || number.fract() != 0.0 {
        return Err(wrong(format!("corner number {number}"), "0 to 2147483647"));
    }
    Ok(number as u32)
}

/// Reads triangle strips: each corner after the second makes a triangle with the two before it, of alternating winding; −1 begins a new strip.
/// Triangles that name a corner twice only join parts of a strip and are left out.
fn strips(body: &mut Body, element: &Element, mesh: &mut Mesh) -> Result<(), PlyError> {
    if !element.properties.iter().any(is_corners) && element.count > 0 {
        return Err(wrong("triangle strips without corners", "a list \"vertex_indices\""));
    }
    for _ in 0..element.count {
        for property in &element.properties {
            let Some(length) = property.list.filter(|_| is_corners(property)) else {
                body.skip(property)?;
                continue;
            };
            // −1 as an unsigned number of 32 bits is its largest.
            let restart = if property.kind == Number::U32 { f64::from(u32::MAX) } else { -1.0 };
            let mut last = [0u32; 2];
            let mut seen = 0usize;
            for _ in 0..body.length(length)? {
                let number = body.number(property.kind)?;
                if number == restart {
                    seen = 0;
                    continue;
                }
                let next = corner(number)?;
                let [a, b] = last;
                if seen >= 2 && a != b && b != next && a != next {
                    mesh.triangles.push(if seen.is_multiple_of(2) { [a, b, next] } else { [b, a, next] });
                }
                last = [b, next];
                seen += 1;
            }
        }
    }
    Ok(())
}

/// Reads polygons; how many had fewer than three corners.
fn faces(body: &mut Body, element: &Element, mesh: &mut Mesh) -> Result<usize, PlyError> {
    if !element.properties.iter().any(is_corners) && element.count > 0 {
        return Err(wrong("faces without corners", "a list \"vertex_indices\""));
    }
    let mut skipped = 0;
    mesh.triangles.reserve(element.count);
    if let ([Property { list: Some(Number::U8), kind, .. }], true) = (&element.properties[..], body.layout != Layout::Text)
        && matches!(kind, Number::I32 | Number::U32)
    {
        // Triangles alone, if they are: all at once.
        const STRIDE: usize = 13;
        let big = body.layout == Layout::Big;
        let all = body.bytes.get(body.at..body.at + element.count.saturating_mul(STRIDE).min(body.bytes.len()));
        if let Some(all) = all.filter(|a| a.len() == element.count * STRIDE && a.par_chunks_exact(STRIDE).all(|t| t[0] == 3)) {
            let index = |b: &[u8]| {
                let b = [b[0], b[1], b[2], b[3]];
                if big { u32::from_be_bytes(b) } else { u32::from_le_bytes(b) }
            };
            mesh.triangles.par_extend(all.par_chunks_exact(STRIDE).map(|t| [index(&t[1..]), index(&t[5..]), index(&t[9..])]));
            body.at += all.len();
            let beyond = |t: &&[u32; 3]| t.iter().any(|i| *i > i32::MAX as u32);
            if let Some(t) = mesh.triangles.par_iter().find_any(beyond) {
                return Err(wrong(format!("corner numbers {t:?}"), "0 to 2147483647"));
            }
            return Ok(0);
        }
    }
    let mut corners: Vec<u32> = Vec::with_capacity(4);
    for _ in 0..element.count {
        for property in &element.properties {
            let Some(length) = property.list.filter(|_| is_corners(property)) else {
                body.skip(property)?;
                continue;
            };
            let n = body.length(length)?;
            corners.clear();
            for _ in 0..n {
                corners.push(corner(body.number(property.kind)?)?);
            }
            skipped += usize::from(n < 3);
            // Where faces stand before their vertices their shape is not known.
            match corners.iter().all(|c| (*c as usize) < mesh.positions.len()) {
                true => triangulate(&corners, &mesh.positions, &mut mesh.triangles),
                false => mesh.triangles.extend((1..n.saturating_sub(1)).map(|k| [corners[0], corners[k], corners[k + 1]])),
            }
        }
    }
    Ok(skipped)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty float y\nproperty double z\n\
        property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n\
        0 0 0 255 0 0\n1 0 0 255 0 0\n1 1 0 255 0 0\n0 1 0 255 0 0\n4 0 1 2 3\n2 0 1\n";

    #[test]
    fn text_and_both_kinds_of_numbers_are_the_same_mesh() {
        let text = read(TEXT.as_bytes()).unwrap();
        assert_eq!(text.mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        assert!(text.warning.is_some() && text.mesh.colors[0] == Vec4::new(1.0, 0.0, 0.0, 1.0));
        for big in [false, true] {
            let head = TEXT.split("end_header\n").next().unwrap();
            let name = if big { "binary_big_endian" } else { "binary_little_endian" };
            let mut bytes = format!("{}end_header\n", head.replace("ascii", name)).into_bytes();
            let turned = |mut v: Vec<u8>| {
                if big {
                    v.reverse();
                }
                v
            };
            for [x, y] in [[0.0f32, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]] {
                for v in [x, y] {
                    bytes.extend(turned(v.to_le_bytes().to_vec()));
                }
                bytes.extend(0f64.to_le_bytes());
                bytes.extend([255, 0, 0]);
            }
            for face in [&[0i32, 1, 2, 3][..], &[0, 1]] {
                bytes.push(face.len() as u8);
                face.iter().for_each(|i| bytes.extend(turned(i.to_le_bytes().to_vec())));
            }
            let found = read(&bytes).unwrap();
            assert_eq!((found.mesh.positions, found.mesh.triangles), (text.mesh.positions.clone(), text.mesh.triangles.clone()));
            assert!(read(&bytes[..bytes.len() - 1]).is_err());
        }
    }

    #[test]
    fn triangle_strips_alternate_their_winding_and_begin_again() {
        let head = "element vertex 6\nproperty float x\nproperty float y\nproperty float z\nelement tristrips 1\n";
        // Two strips; the second has a triangle that names a corner twice, and the winding goes on past it.
        let corners: [i32; 11] = [0, 1, 2, 3, -1, 2, 3, 4, 4, 5, 0];
        let expected = [[0, 1, 2], [2, 1, 3], [2, 3, 4], [5, 4, 0]];
        let positions = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n1 2 0\n";
        let list: Vec<String> = corners.iter().map(i32::to_string).collect();
        let text = format!(
            "ply\nformat ascii 1.0\n{head}property list int int vertex_indices\nend_header\n{positions}{} {}\n",
            corners.len(),
            list.join(" ")
        );
        assert_eq!(read(text.as_bytes()).unwrap().mesh.triangles, expected);
        for kind in ["int", "uint"] {
            let mut bytes =
                format!("ply\nformat binary_little_endian 1.0\n{head}property list int {kind} vertex_indices\nend_header\n")
                    .into_bytes();
            positions.split_whitespace().for_each(|v| bytes.extend(v.parse::<f32>().unwrap().to_le_bytes()));
            bytes.extend((corners.len() as i32).to_le_bytes());
            corners.iter().for_each(|i| bytes.extend(i.to_le_bytes()));
            assert_eq!(read(&bytes).unwrap().mesh.triangles, expected, "{kind}");
            assert!(read(&bytes[..bytes.len() - 1]).is_err());
        }
        for (from, to, word) in [(" 5 0", " 5 9", "less than 6"), ("-1", "-2", "2147483647"), ("vertex_indices", "x", "strips")] {
            let e = read(text.replacen(from, to, 1).as_bytes()).unwrap_err();
            assert!(format!("{} {}", e.found, e.expected).contains(word), "{to}: {e:?}");
        }
    }

    #[test]
    fn wrong_files_say_what_is_wrong() {
        for (from, to, word) in [
            ("ply\n", "plx\n", "begins"),
            ("format ascii 1.0\n", "", "format"),
            ("element vertex 4", "element vertex 4000000000", "cut short"),
            ("float x", "float q", "x, y"),
            ("4 0 1 2 3", "4 0 1 2 9", "less than 4"),
            ("4 0 1 2 3", "4 0 1 2 -3", "2147483647"),
            ("1 1 0 255", "1 one 0 255", "a number"),
            ("end_header", "end", "a line"),
            ("vertex_indices", "corners", "vertex_indices"),
        ] {
            let text = TEXT.replacen(from, to, 1);
            let e = read(text.as_bytes()).unwrap_err();
            assert!(format!("{} {}", e.found, e.expected).contains(word), "{to}: {e:?}");
        }
    }
}
