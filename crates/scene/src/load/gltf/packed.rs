//! What extensions pack more tightly, unpacked into plain glTF before anything else looks at it: buffer views (EXT_ and
//! KHR_meshopt_compression), primitives (KHR_draco_mesh_compression), integers as attributes (KHR_mesh_quantization), pictures
//! (EXT_texture_webp, KHR_texture_basisu). Decoders are those of the crates `draco-core`, `draco-gltf`, `basisu` and `image`.

use super::error;
use crate::SceneError;
use crate::load::picture::check_packed;
use crate::texture::Image;
use draco_gltf::meshopt::{MeshoptFilter, MeshoptMode, decode_buffer_view};
use serde_json::{Value, json};
use std::panic::{AssertUnwindSafe, catch_unwind};

const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
const DRACO: &str = "KHR_draco_mesh_compression";
const PICTURES: [&str; 2] = ["EXT_texture_webp", "KHR_texture_basisu"];

/// What this file takes care of.
pub(super) const EXTENSIONS: [&str; 6] = [MESHOPT[0], MESHOPT[1], DRACO, "KHR_mesh_quantization", PICTURES[0], PICTURES[1]];

/// Most that one part may become, bytes: more is a mistake or an attack.
const LARGEST: usize = 8 << 30;

/// Elements of a list of zeros that any file may announce.
const ALWAYS: usize = 1 << 16;

/// Most elements of an accessor without data of its own, which stands for zeros. It lies beside others of as many elements (the corners of one
/// mesh), which take a byte each at least.
pub(super) fn most_zeros(buffers: &[Vec<u8>]) -> usize {
    buffers.iter().map(Vec::len).sum::<usize>().max(ALWAYS)
}

struct Unpacker<'a> {
    name: &'a str,
    json: &'a mut Value,
    buffers: &'a mut Vec<Vec<u8>>,
}

/// Whether a buffer only stands in for data that is packed elsewhere.
pub(super) fn is_stand_in(buffer: &Value) -> bool {
    MESHOPT.iter().any(|m| buffer.pointer(&format!("/extensions/{m}")).is_some())
}

/// Whether a texture has its picture in an extension, listed as used by the file or not.
pub(super) fn has_pictures(json: &Value) -> bool {
    array(json, "textures").iter().any(|t| PICTURES.iter().any(|p| t.pointer(&format!("/extensions/{p}/source")).is_some()))
}

/// Unpacks everything; new buffers are added behind those there are.
pub(super) fn unpack(json: &mut Value, buffers: &mut Vec<Vec<u8>>, name: &str) -> Result<(), SceneError> {
    let mut unpacker = Unpacker { name, json, buffers };
    unpacker.pictures();
    unpacker.views()?;
    unpacker.primitives()?;
    unpacker.integers()
}

fn index(value: Option<&Value>) -> Option<usize> {
    value.and_then(Value::as_u64).and_then(|v| usize::try_from(v).ok())
}

/// A list in an object; empty where it is not there.
pub(super) fn array<'v>(json: &'v Value, key: &str) -> &'v [Value] {
    json.get(key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// Components and bytes of each for an accessor's types.
pub(super) fn layout(accessor: &Value) -> Option<(usize, usize)> {
    let components = match accessor.get("type")?.as_str()? {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" => 4,
        _ => return None,
    };
    let size = match accessor.get("componentType")?.as_u64()? {
        5120 | 5121 => 1,
        5122 | 5123 => 2,
        5125 | 5126 => 4,
        _ => return None,
    };
    Some((components, size))
}

impl Unpacker<'_> {
    fn push(&mut self, bytes: Vec<u8>) -> usize {
        let length = bytes.len();
        self.buffers.push(bytes);
        if let Some(all) = self.json.get_mut("buffers").and_then(Value::as_array_mut) {
            all.push(json!({ "byteLength": length }));
        }
        self.buffers.len() - 1
    }

    /// A new buffer with a view of all of it; the view's number.
    fn push_view(&mut self, bytes: Vec<u8>) -> Option<usize> {
        let length = bytes.len();
        let buffer = self.push(bytes);
        let views = self.json.get_mut("bufferViews").and_then(Value::as_array_mut)?;
        views.push(json!({ "buffer": buffer, "byteOffset": 0, "byteLength": length }));
        Some(views.len() - 1)
    }

    fn slice(&self, buffer: usize, offset: usize, length: usize) -> Option<&[u8]> {
        self.buffers.get(buffer)?.get(offset..offset.checked_add(length)?)
    }

    fn view(&self, view: usize) -> Option<&[u8]> {
        let v = array(self.json, "bufferViews").get(view)?;
        self.slice(index(v.get("buffer"))?, index(v.get("byteOffset")).unwrap_or(0), index(v.get("byteLength"))?)
    }

    /// Packed pictures take the place of what stands in for them.
    fn pictures(&mut self) {
        for texture in self.json.get_mut("textures").and_then(Value::as_array_mut).into_iter().flatten() {
            let packed = PICTURES.iter().find_map(|p| texture.pointer(&format!("/extensions/{p}/source")).cloned());
            if let (Some(source), Some(texture)) = (packed, texture.as_object_mut()) {
                texture.insert("source".into(), source);
            }
        }
    }

    fn views(&mut self) -> Result<(), SceneError> {
        for number in 0..array(self.json, "bufferViews").len() {
            let view = &array(self.json, "bufferViews")[number];
            let Some(packed) = MESHOPT.iter().find_map(|m| view.pointer(&format!("/extensions/{m}"))) else { continue };
            let place = format!("bufferView {number} (meshopt)");
            let wrong = |found: &str, expected: &str| error(self.name, &place, found, expected);
            let field = |key: &str| index(packed.get(key));
            let (Some(buffer), Some(length), Some(stride), Some(count)) =
                (field("buffer"), field("byteLength"), field("byteStride"), field("count"))
            else {
                return Err(wrong("a field is missing", "expected buffer, byteLength, byteStride, count and mode"));
            };
            let text = |key: &str, default: &'static str| packed.get(key).and_then(Value::as_str).unwrap_or(default).to_owned();
            let mode = MeshoptMode::from_name(&text("mode", ""))
                .map_err(|e| wrong(&e.to_string(), "expected ATTRIBUTES, TRIANGLES or INDICES"))?;
            let filter = MeshoptFilter::from_name(&text("filter", "NONE"))
                .map_err(|e| wrong(&e.to_string(), "expected NONE, OCTAHEDRAL, QUATERNION, EXPONENTIAL or COLOR"))?;
            let source = self
                .slice(buffer, field("byteOffset").unwrap_or(0), length)
                .ok_or_else(|| wrong("it reaches beyond its buffer", "expected bytes within the buffer"))?;
            // Each element takes at least a bit of header for 16 of each byte.
            let size = count.checked_mul(stride).filter(|s| *s <= LARGEST && *s / 4096 <= source.len());
            let size = size
                .ok_or_else(|| wrong(&format!("{count} elements of {stride} bytes"), "expected as many as the data can hold"))?;
            let mut out = vec![0u8; size];
            catch_unwind(AssertUnwindSafe(|| decode_buffer_view(&mut out, source, mode, filter, count, stride)))
                .map_err(|_| wrong("data that cannot be decoded", "expected a meshopt stream"))?
                .map_err(|e| wrong(&e.to_string(), "expected a meshopt stream"))?;
            let buffer = self.push(out);
            if let Some(view) = self.json.get_mut("bufferViews").and_then(|v| v.get_mut(number)).and_then(Value::as_object_mut) {
                view.insert("buffer".into(), json!(buffer));
                view.insert("byteOffset".into(), json!(0));
                view.insert("byteLength".into(), json!(size));
                view.remove("extensions");
            }
        }
        Ok(())
    }

    fn primitives(&mut self) -> Result<(), SceneError> {
        for m in 0..array(self.json, "meshes").len() {
            for p in 0..array(&array(self.json, "meshes")[m], "primitives").len() {
                self.primitive(m, p)?;
            }
        }
        Ok(())
    }

    fn primitive(&mut self, m: usize, p: usize) -> Result<(), SceneError> {
        let primitive = &array(&array(self.json, "meshes")[m], "primitives")[p];
        let Some(packed) = primitive.pointer(&format!("/extensions/{DRACO}")).cloned() else { return Ok(()) };
        let place = format!("mesh {m} primitive {p} (Draco)");
        let wrong = |found: &str, expected: &str| error(self.name, &place, found, expected);
        let bytes = index(packed.get("bufferView")).and_then(|v| self.view(v));
        let bytes = bytes.ok_or_else(|| wrong("its bufferView is not there", "expected bytes within a buffer"))?;
        // Codes of connectivity and of numbers may take far less than a bit: an explicit limit, beyond what is always read.
        let limits = draco_core::DecodeLimits::default();
        let of_length = |least: u64, most: u64| (bytes.len() as u64).saturating_mul(1024).clamp(least, most);
        let limits = limits
            .with_max_faces(of_length(1 << 20, limits.max_faces))
            .with_max_points(of_length(1 << 20, limits.max_points))
            .with_max_decoded_bytes(of_length(64 << 20, limits.max_decoded_bytes));
        let decoded = catch_unwind(|| {
            let mut mesh = draco_core::Mesh::new();
            let mut buffer = draco_core::DecoderBuffer::new(bytes).with_limits(limits);
            draco_core::MeshDecoder::new().decode(&mut buffer, &mut mesh).map(|()| mesh).map_err(|e| format!("{e:?}"))
        });
        let mesh = decoded
            .map_err(|_| wrong("data that cannot be decoded", "expected a Draco mesh"))?
            .map_err(|e| wrong(&e, "expected a Draco mesh"))?;
        let points = mesh.num_points();
        let corners: Vec<u8> = mesh.faces().iter().flat_map(|f| f.iter().flat_map(|c| c.0.to_le_bytes())).collect();
        let mut attributes = Vec::new();
        let of_primitive = primitive.get("attributes").cloned().unwrap_or_default();
        for (semantic, id) in packed.get("attributes").and_then(Value::as_object).into_iter().flatten() {
            let accessor = index(of_primitive.get(semantic));
            let known = accessor.and_then(|a| Some((a, layout(array(self.json, "accessors").get(a)?)?)));
            let Some((accessor, (components, _))) = known else {
                return Err(wrong(&format!("attribute {semantic} without accessor"), "expected one for each"));
            };
            let attribute = id.as_u64().and_then(|id| mesh.attribute_by_unique_id(id as u32));
            let attribute =
                attribute.ok_or_else(|| wrong(&format!("attribute {semantic} is not in the data"), "expected its number"))?;
            let values = catch_unwind(AssertUnwindSafe(|| attribute.read_f32s(points, components)))
                .map_err(|_| wrong(&format!("attribute {semantic} cannot be read"), "expected a value for each point"))?;
            if values.len() != points * components {
                return Err(wrong(
                    &format!("{} numbers of {semantic}", values.len()),
                    &format!("expected {}", points * components),
                ));
            }
            attributes.push((accessor, semantic.clone(), values));
        }
        let indices = index(primitive.get("indices"));
        for (accessor, semantic, values) in attributes {
            // Joints stay whole numbers, all else becomes single precision.
            let joints = semantic.starts_with("JOINTS");
            let bytes: Vec<u8> = match joints {
                true => values.iter().flat_map(|v| (*v as u16).to_le_bytes()).collect(),
                false => values.iter().flat_map(|v| v.to_le_bytes()).collect(),
            };
            // Values of normalised types were given as whole numbers.
            let scale = array(self.json, "accessors").get(accessor).and_then(scale_of).unwrap_or(1.0);
            let bytes = match scale == 1.0 || joints {
                true => bytes,
                false => values.iter().flat_map(|v| (v * scale).max(-1.0).to_le_bytes()).collect(),
            };
            self.settle(accessor, bytes, points, if joints { 5123 } else { 5126 });
        }
        let faces = corners.len() / 4;
        match indices {
            Some(accessor) => self.settle(accessor, corners, faces, 5125),
            None => {
                if let Some(view) = self.push_view(corners)
                    && let Some(accessors) = self.json.get_mut("accessors").and_then(Value::as_array_mut)
                {
                    accessors.push(json!({ "bufferView": view, "componentType": 5125, "count": faces, "type": "SCALAR" }));
                    let number = accessors.len() - 1;
                    self.json["meshes"][m]["primitives"][p]["indices"] = json!(number);
                }
            }
        }
        // Faces are triangles, whatever they were before.
        let primitive = &mut self.json["meshes"][m]["primitives"][p];
        primitive["mode"] = json!(4);
        if let Some(extensions) = primitive.get_mut("extensions").and_then(Value::as_object_mut) {
            extensions.remove(DRACO);
        }
        Ok(())
    }

    /// An accessor gets data of its own.
    fn settle(&mut self, accessor: usize, bytes: Vec<u8>, count: usize, component: u32) {
        let Some(view) = self.push_view(bytes) else { return };
        if let Some(a) = self.json.get_mut("accessors").and_then(|a| a.get_mut(accessor)).and_then(Value::as_object_mut) {
            a.insert("bufferView".into(), json!(view));
            a.insert("byteOffset".into(), json!(0));
            a.insert("componentType".into(), json!(component));
            a.insert("count".into(), json!(count));
            for gone in ["normalized", "sparse"] {
                a.remove(gone);
            }
        }
    }

    /// Attributes of integers become numbers of single precision.
    fn integers(&mut self) -> Result<(), SceneError> {
        let mut wanted = std::collections::BTreeSet::new();
        let mut positions = std::collections::BTreeSet::new();
        for mesh in array(self.json, "meshes") {
            for primitive in array(mesh, "primitives") {
                let sets = primitive.get("attributes").into_iter().chain(array(primitive, "targets"));
                for (semantic, accessor) in sets.filter_map(Value::as_object).flatten() {
                    let plain = semantic.starts_with("TEXCOORD");
                    if let Some(a) = index(Some(accessor))
                        && (plain || matches!(semantic.as_str(), "POSITION" | "NORMAL" | "TANGENT"))
                    {
                        // Texture coordinates of unsigned fractions are known to all readers.
                        let of = array(self.json, "accessors").get(a);
                        let fractions = of.is_some_and(|a| {
                            matches!(a.get("componentType").and_then(Value::as_u64), Some(5121 | 5123))
                                && a.get("normalized").and_then(Value::as_bool) == Some(true)
                        });
                        if !(plain && fractions) {
                            wanted.insert(a);
                        }
                        if semantic == "POSITION" {
                            positions.insert(a);
                        }
                    }
                }
            }
        }
        for node in array(self.json, "nodes") {
            let instances = node.pointer("/extensions/EXT_mesh_gpu_instancing/attributes").and_then(Value::as_object);
            wanted.extend(instances.into_iter().flatten().filter_map(|(_, a)| index(Some(a))));
        }
        for accessor in wanted {
            let Some(a) = array(self.json, "accessors").get(accessor) else { continue };
            let component = a.get("componentType").and_then(Value::as_u64);
            if !matches!(component, Some(5120..=5123)) {
                continue;
            }
            let place = format!("accessor {accessor}");
            let wrong = |found: &str, expected: &str| error(self.name, &place, found, expected);
            let (Some((components, size)), Some(count)) = (layout(a), index(a.get("count"))) else { continue };
            let scale = scale_of(a).unwrap_or(1.0);
            let stretch = |v: f32| if scale == 1.0 { v } else { (v * scale).max(-1.0) };
            let number = |b: &[u8]| match component {
                Some(5120) => f32::from(b[0] as i8),
                Some(5121) => f32::from(b[0]),
                Some(5122) => f32::from(i16::from_le_bytes([b[0], b[1]])),
                _ => f32::from(u16::from_le_bytes([b[0], b[1]])),
            };
            let whole = count.checked_mul(components).filter(|n| *n <= LARGEST / 4);
            let whole = whole.ok_or_else(|| wrong(&format!("{count} elements"), "expected as many as the file holds"))?;
            let mut out = Vec::new();
            match index(a.get("bufferView")) {
                None => {
                    let most = most_zeros(self.buffers);
                    if count > most {
                        return Err(wrong(&format!("{count} elements without data"), &format!("expected at most {most}")));
                    }
                    out = vec![0.0f32; whole];
                }
                Some(view) => {
                    let stride = array(self.json, "bufferViews").get(view).and_then(|v| index(v.get("byteStride")));
                    let stride = stride.unwrap_or(components * size);
                    let offset = index(a.get("byteOffset")).unwrap_or(0);
                    let bytes = self.view(view).and_then(|b| b.get(offset..));
                    let end =
                        count.checked_sub(1).and_then(|n| n.checked_mul(stride)).and_then(|n| n.checked_add(components * size));
                    let (Some(bytes), Some(end)) = (bytes, end) else {
                        return Err(wrong("it lies outside its buffer", "expected bytes within it"));
                    };
                    if end > bytes.len() || stride < components * size {
                        return Err(wrong(&format!("it needs {end} bytes"), &format!("expected at most {}", bytes.len())));
                    }
                    for i in 0..count {
                        out.extend((0..components).map(|c| stretch(number(&bytes[i * stride + c * size..]))));
                    }
                }
            }
            if let Some(sparse) = a.get("sparse") {
                self.sparse(sparse, &mut out, components, size, &wrong, |b| stretch(number(b)))?;
            }
            let bytes = out.iter().flat_map(|v| v.to_le_bytes()).collect();
            self.settle(accessor, bytes, count, 5126);
            if positions.contains(&accessor) && count > 0 {
                // The box that the specification asks for.
                let at = |c: usize, f: fn(f32, f32) -> f32| out.chunks_exact(3).map(|p| p[c]).reduce(f).unwrap_or(0.0);
                let a = &mut self.json["accessors"][accessor];
                a["min"] = json!([at(0, f32::min), at(1, f32::min), at(2, f32::min)]);
                a["max"] = json!([at(0, f32::max), at(1, f32::max), at(2, f32::max)]);
            }
        }
        Ok(())
    }

    fn sparse(
        &self,
        sparse: &Value,
        out: &mut [f32],
        components: usize,
        size: usize,
        wrong: &dyn Fn(&str, &str) -> SceneError,
        number: impl Fn(&[u8]) -> f32,
    ) -> Result<(), SceneError> {
        let part = |key: &str| {
            let p = sparse.get(key)?;
            Some((p, self.view(index(p.get("bufferView"))?)?.get(index(p.get("byteOffset")).unwrap_or(0)..)?))
        };
        let (Some(count), Some((of_index, places)), Some((_, values))) =
            (index(sparse.get("count")), part("indices"), part("values"))
        else {
            return Err(wrong("a sparse part that is not whole", "expected count, indices and values within their buffers"));
        };
        let width = match of_index.get("componentType").and_then(Value::as_u64) {
            Some(5121) => 1,
            Some(5123) => 2,
            _ => 4,
        };
        for k in 0..count {
            let place =
                places.get(k * width..(k + 1) * width).map(|b| b.iter().rev().fold(0usize, |n, b| n << 8 | usize::from(*b)));
            let value = values.get(k * components * size..(k + 1) * components * size);
            let to = place.and_then(|p| out.get_mut(p.checked_mul(components)?..(p + 1).checked_mul(components)?));
            let (Some(value), Some(to)) = (value, to) else {
                return Err(wrong(
                    &format!("sparse value {k} lies outside"),
                    "expected places below the count and bytes within the buffer",
                ));
            };
            to.iter_mut().enumerate().for_each(|(c, to)| *to = number(&value[c * size..]));
        }
        Ok(())
    }
}

/// What whole numbers of a normalised type are multiplied by.
fn scale_of(accessor: &Value) -> Option<f32> {
    if accessor.get("normalized").and_then(Value::as_bool) != Some(true) {
        return None;
    }
    Some(match accessor.get("componentType")?.as_u64()? {
        5120 => 1.0 / 127.0,
        5121 => 1.0 / 255.0,
        5122 => 1.0 / 32_767.0,
        5123 => 1.0 / 65_535.0,
        _ => return None,
    })
}

/// A KTX 2 picture in one of the Basis Universal formats.
pub(super) fn read_ktx2(bytes: &[u8]) -> Result<Image, String> {
    let (width, height) = ktx2_size(bytes)?;
    check_packed([width as u32, height as u32], bytes.len())?;
    // What cannot be decoded is told with what it is: KTX 2 holds any format of a graphics card.
    let told = |e: String| format!("{}: {e}; Basis Universal (ETC1S, UASTC) can be read", ktx2_kind(bytes));
    let pixels = catch_unwind(|| {
        let basis = basisu::Transcoder::new(bytes).map_err(|e| format!("{e:?}"))?;
        basis.transcode(0, basisu::TargetFormat::Rgba32, basisu::DecodeFlags::NONE).map_err(|e| format!("{e:?}"))
    });
    let pixels = pixels.map_err(|_| told("data that cannot be decoded".to_owned()))?.map_err(told)?;
    if pixels.len() != width * height * 4 {
        return Err(told(format!("{} bytes for {width} × {height} pixels", pixels.len())));
    }
    Ok(Image::new(width, height, pixels.as_chunks::<4>().0.to_vec()).kept())
}

/// A number of 32 bits of a KTX 2 header.
fn ktx2_word(bytes: &[u8], at: usize) -> Option<u32> {
    bytes.get(at..at + 4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]))
}

/// Name of a KTX 2 supercompression scheme. Source: Khronos KTX File Format Specification 2.0, §3.8.
fn ktx2_scheme(scheme: u32) -> String {
    match scheme {
        0 => "none".into(),
        1 => "BasisLZ".into(),
        2 => "Zstandard".into(),
        3 => "ZLIB".into(),
        other => format!("number {other}, which is unknown"),
    }
}

/// What a KTX 2 picture is: its format and supercompression. Numbers of formats are those of Vulkan's `VkFormat`.
fn ktx2_kind(bytes: &[u8]) -> String {
    let format = match ktx2_word(bytes, 12).unwrap_or_default() {
        0 => "Basis Universal or another format without a number".to_owned(),
        37 => "plain RGBA of 8 bits".to_owned(),
        43 => "plain sRGB of 8 bits".to_owned(),
        n @ 131..=146 => format!("BC blocks (VkFormat {n})"),
        n @ 147..=156 => format!("ETC2 or EAC blocks (VkFormat {n})"),
        n @ 157..=184 => format!("ASTC blocks (VkFormat {n})"),
        n => format!("VkFormat {n}"),
    };
    format!("a KTX 2 picture of {format}, supercompression {}", ktx2_scheme(ktx2_word(bytes, 44).unwrap_or_default()))
}

/// Whether bytes are a KTX 2 file.
pub(super) fn is_ktx2(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xab, b'K', b'T', b'X', b' ', b'2', b'0', 0xbb])
}

/// Width and height, if the sizes in the header agree with each other and with the file: decoders take them on trust.
fn ktx2_size(bytes: &[u8]) -> Result<(usize, usize), String> {
    let short = || format!("a KTX 2 picture of {} bytes whose header is cut short", bytes.len());
    let word = |at: usize| ktx2_word(bytes, at).ok_or_else(short);
    let long = |at: usize| Ok::<u64, String>(u64::from(word(at)?) | u64::from(word(at + 4)?) << 32);
    let (width, height) = (word(20)?, word(24)?);
    let (depth, layers, faces, levels, scheme) = (word(28)?, word(32)?, word(36)?, word(40)?.max(1), word(44)?);
    if scheme > 2 {
        return Err(format!(
            "a KTX 2 picture with supercompression {}; none, BasisLZ and Zstandard can be read",
            ktx2_scheme(scheme)
        ));
    }
    if depth != 0 || layers > 1 || faces != 1 {
        return Err(format!(
            "a KTX 2 volume, array or cube ({depth} deep, {layers} layers, {faces} faces); flat pictures can be read"
        ));
    }
    let fits = (1..=16_384).contains(&width) && (1..=16_384).contains(&height);
    if !fits || levels > 32 - width.max(height).leading_zeros() {
        return Err(format!("a KTX 2 picture of {width} × {height} pixels in {levels} levels; up to 16 384 a side can be read"));
    }
    for level in 0..levels {
        let at = 80 + 24 * level as usize;
        let (offset, length, unpacked) = (long(at)?, long(at + 8)?, long(at + 16)?);
        let blocks = u64::from((width >> level).max(1).div_ceil(4)) * u64::from((height >> level).max(1).div_ceil(4));
        // With Zstandard a level unpacks to blocks of 16 bytes (UASTC).
        if offset.checked_add(length).is_none_or(|end| end > bytes.len() as u64) || (scheme == 2 && unpacked != blocks * 16) {
            let sizes =
                format!("level {level} has {length} bytes from byte {offset}, {unpacked} unpacked, in a file of {}", bytes.len());
            return Err(format!("{}: {sizes}; it is cut short, or no Basis Universal", ktx2_kind(bytes)));
        }
    }
    Ok((width as usize, height as usize))
}

#[cfg(test)]
mod tests {
    use super::*;

    const KTX: &[u8] = include_bytes!("../../../tests/packed/etc1s_rgb.ktx2");

    #[test]
    fn pictures_that_cannot_be_read_are_told_with_what_they_are() {
        assert!(is_ktx2(KTX) && read_ktx2(KTX).is_ok());
        let with = |at: usize, value: u32| {
            let mut bytes = KTX.to_vec();
            bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
            read_ktx2(&bytes).unwrap_err()
        };
        for (at, value, word) in [
            (44, 3, "ZLIB"),
            (44, 77, "number 77, which is unknown"),
            (28, 4, "4 deep"),
            (36, 6, "6 faces"),
            (20, 0, "0 × 48 pixels"),
            (80, 1 << 30, "cut short"),
        ] {
            let e = with(at, value);
            assert!(e.contains("KTX 2") && e.contains(word), "{e}");
        }
        assert!(read_ktx2(&KTX[..60]).unwrap_err().contains("cut short"));
        // What the level holds is not what its header says: the format is named.
        let mut plain = KTX.to_vec();
        plain[12..16].copy_from_slice(&37u32.to_le_bytes());
        plain[44..48].copy_from_slice(&2u32.to_le_bytes());
        assert!(read_ktx2(&plain).unwrap_err().contains("plain RGBA of 8 bits"));
    }

    #[test]
    fn textures_larger_than_their_file_can_be_are_refused() {
        let mut bytes = vec![0xab, b'K', b'T', b'X', b' ', b'2', b'0', 0xbb, 13, 10, 26, 10];
        // Format, type size, width, height, depth, layers, faces, levels, no supercompression; then tables, and one level.
        [0u32, 1, 16_384, 16_384, 0, 0, 1, 1, 0].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.resize(80, 0);
        [104u64, 16, 0].iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        bytes.resize(120, 0);
        assert!(is_ktx2(&bytes));
        let e = read_ktx2(&bytes).unwrap_err();
        assert!(e.contains("announced"), "{e}");
    }

    #[test]
    fn parts_larger_than_their_data_can_become_are_refused() {
        // Meshopt: four thousand million elements from 16 bytes.
        let mut json = json!({ "buffers": [{ "byteLength": 16 }], "bufferViews": [{ "buffer": 0, "byteLength": 4, "extensions": {
            "EXT_meshopt_compression": { "buffer": 0, "byteLength": 16, "byteStride": 16, "count": 4_000_000_000u64, "mode": "ATTRIBUTES" } } }] });
        let e = unpack(&mut json, &mut vec![vec![0xa0; 16]], "a.gltf").unwrap_err().to_string();
        assert!(e.contains("as many as the data can hold"), "{e}");
        // Draco 2.2, a mesh of sequential connectivity: a thousand million faces and points as numbers of seven bits a byte.
        let varint: [u8; 5] = [0x80, 0x94, 0xeb, 0xdc, 0x03];
        let bytes = [b"DRACO".as_slice(), &[2, 2, 1, 0, 0, 0], &varint, &varint, &[0; 16]].concat();
        let mut json = json!({ "buffers": [{ "byteLength": bytes.len() }], "bufferViews": [{ "buffer": 0, "byteLength": bytes.len() }],
            "meshes": [{ "primitives": [{ "extensions": { "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": {} } } }] }] });
        let e = unpack(&mut json, &mut vec![bytes], "a.gltf").unwrap_err().to_string();
        assert!(e.contains("mesh 0 primitive 0 (Draco)"), "{e}");
    }
}
