//! What a glTF file says is held against what it holds, before anything is read by it.

use super::{SUPPORTED, error, packed, splats};
use crate::SceneError;
use crate::material_extensions::EXTENSIONS;

pub(super) fn label(name: Option<&str>) -> String {
    name.map_or_else(String::new, |n| format!(" \"{n}\""))
}

/// A `.glb` whose header promises more than is there is cut short: say so before anything else does.
pub(super) fn check_container(bytes: &[u8], name: &str) -> Result<(), SceneError> {
    if bytes.starts_with(b"glTF") {
        let length = bytes.get(8..12).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
        if length.is_none_or(|l| l > bytes.len()) {
            let expected = length.map_or("expected a header of 12 bytes".to_owned(), |l| format!("expected {l}"));
            return Err(error(name, "header", format!("the file has {} bytes and is cut short", bytes.len()), expected));
        }
        if let Some(length) = length.filter(|l| *l < 12) {
            return Err(error(
                name,
                "header",
                format!("a length of {length} bytes"),
                "expected 12 at least: the header itself has as many",
            ));
        }
    }
    Ok(())
}

/// A texture without a picture has it in an extension that is not known: that one is named.
pub(super) fn check_sources(json: &gltf::json::Root, name: &str) -> Result<(), SceneError> {
    for (i, texture) in json.textures.iter().enumerate() {
        if texture.source.value() >= json.images.len() {
            let found = match texture.source.value() as u32 {
                u32::MAX => {
                    "it has no picture that can be read (its picture is in an unknown extension, such as MSFT_texture_dds)".into()
                }
                n => format!("image {n} is not there"),
            };
            let expected =
                format!("expected a source below {}, or one in EXT_texture_webp or KHR_texture_basisu", json.images.len());
            return Err(error(name, &format!("texture {i}"), found, expected));
        }
    }
    Ok(())
}

/// What the reader takes for granted and its own validation does not check: attributes are of the types glTF allows,
/// images and cameras complete.
pub(super) fn check_attributes(json: &gltf::json::Root, name: &str) -> Result<(), SceneError> {
    use gltf::Semantic;
    use gltf::json::accessor::{ComponentType as C, Type as T};
    use gltf::json::validation::Checked::Valid;
    let check = |place: &str, index: usize, types: &[T], components: &[C]| {
        let Some(a) = json.accessors.get(index) else {
            let expected = format!("expected less than {}", json.accessors.len());
            return Err(error(name, place, format!("accessor {index} is out of range"), expected));
        };
        let type_ok = matches!(a.type_, Valid(t) if types.contains(&t));
        match type_ok && matches!(a.component_type, Valid(c) if components.contains(&c.0)) {
            true => Ok(()),
            false => Err(error(
                name,
                place,
                format!("accessor {index} is of another type"),
                format!("expected {types:?} of {components:?}"),
            )),
        }
    };
    for (m, mesh) in json.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            let place = format!("mesh {m} primitive {p}");
            for (semantic, index) in &primitive.attributes {
                let Valid(semantic) = semantic else { continue };
                let (types, components): (&[T], &[C]) = match semantic {
                    Semantic::Positions | Semantic::Normals => (&[T::Vec3], &[C::F32]),
                    Semantic::Tangents => (&[T::Vec4], &[C::F32]),
                    Semantic::TexCoords(_) => (&[T::Vec2], &[C::U8, C::U16, C::F32]),
                    Semantic::Colors(_) => (&[T::Vec3, T::Vec4], &[C::U8, C::U16, C::F32]),
                    Semantic::Joints(_) => (&[T::Vec4], &[C::U8, C::U16]),
                    Semantic::Weights(_) => (&[T::Vec4], &[C::U8, C::U16, C::F32]),
                    _ => continue,
                };
                check(&format!("{place} {semantic:?}"), index.value(), types, components)?;
            }
            for (t, target) in primitive.targets.iter().flatten().enumerate() {
                for index in [&target.positions, &target.normals, &target.tangents].into_iter().flatten() {
                    check(&format!("{place} target {t}"), index.value(), &[T::Vec3], &[C::F32])?;
                }
            }
            if let Some(indices) = &primitive.indices {
                check(&format!("{place} indices"), indices.value(), &[T::Scalar], &[C::U8, C::U16, C::U32])?;
            }
        }
    }
    for (s, skin) in json.skins.iter().enumerate() {
        if let Some(inverse) = &skin.inverse_bind_matrices {
            check(&format!("skin {s}"), inverse.value(), &[T::Mat4], &[C::F32])?;
        }
    }
    for (a, animation) in json.animations.iter().enumerate() {
        for sampler in &animation.samplers {
            let place = format!("animation {a}");
            check(&place, sampler.input.value(), &[T::Scalar], &[C::F32])?;
            check(&place, sampler.output.value(), &[T::Scalar, T::Vec3, T::Vec4], &[C::I8, C::U8, C::I16, C::U16, C::F32])?;
        }
        for (c, channel) in animation.channels.iter().enumerate() {
            let node = channel.target.node.value();
            if node >= json.nodes.len() {
                let expected = format!("expected less than {}", json.nodes.len());
                return Err(error(name, &format!("animation {a} channel {c}"), format!("node {node} is not there"), expected));
            }
            let Some(sampler) = animation.samplers.get(channel.sampler.value()) else { continue };
            let output = sampler.output.value();
            use gltf::animation::Property as P;
            let place = format!("animation {a}");
            match channel.target.path {
                Valid(P::Translation | P::Scale) => check(&place, output, &[T::Vec3], &[C::F32])?,
                Valid(P::Rotation) => check(&place, output, &[T::Vec4], &[C::I8, C::U8, C::I16, C::U16, C::F32])?,
                _ => check(&place, output, &[T::Scalar], &[C::I8, C::U8, C::I16, C::U16, C::F32])?,
            }
        }
    }
    for (i, image) in json.images.iter().enumerate() {
        if !(image.buffer_view.is_some() && image.mime_type.is_some() || image.buffer_view.is_none() && image.uri.is_some()) {
            return Err(error(
                name,
                &format!("image {i}"),
                "it has no source",
                "expected a uri, or a bufferView with a mimeType",
            ));
        }
    }
    for (i, camera) in json.cameras.iter().enumerate() {
        let present = match camera.type_ {
            Valid(gltf::json::camera::Type::Perspective) => camera.perspective.is_some(),
            Valid(gltf::json::camera::Type::Orthographic) => camera.orthographic.is_some(),
            _ => true,
        };
        if !present {
            return Err(error(name, &format!("camera {i}"), "its parameters are missing", "expected those of its type"));
        }
    }
    Ok(())
}

/// All extensions that are read, wherever.
fn supported() -> impl Iterator<Item = &'static str> {
    let others = [SUPPORTED, &packed::EXTENSIONS, &splats::EXTENSIONS].into_iter().flatten().copied();
    EXTENSIONS.iter().map(|e| e.name).chain(others)
}

pub(super) fn is_supported(extension: &str) -> bool {
    supported().any(|e| e == extension)
}

pub(super) fn check_extensions(required: &[String], name: &str) -> Result<(), SceneError> {
    match required.iter().find(|e| !is_supported(e)) {
        Some(extension) => {
            let all = supported().collect::<Vec<_>>().join(", ");
            let hint = format!("supported are {all}; export the scene without it");
            Err(error(name, "extensionsRequired", format!("{extension} is not supported"), hint))
        }
        None => Ok(()),
    }
}

/// Every accessor must lie within its buffer: the readers trust it.
pub(super) fn check_accessors(document: &gltf::Document, buffers: &[Vec<u8>], name: &str) -> Result<(), SceneError> {
    let view_end = |view: &gltf::buffer::View, place: &str, end: usize| {
        let length = buffers.get(view.buffer().index()).map_or(0, Vec::len);
        let inside = end <= view.length() && view.offset().checked_add(view.length()).is_some_and(|e| e <= length);
        if inside {
            return Ok(());
        }
        let found = format!(
            "it reaches byte {} of buffer {}",
            view.offset().saturating_add(end.max(view.length())),
            view.buffer().index()
        );
        Err(error(name, place, found, format!("expected at most {length}")))
    };
    let most_zeros = packed::most_zeros(buffers);
    for view in document.views() {
        view_end(&view, &format!("bufferView {}", view.index()), 0)?;
    }
    for accessor in document.accessors() {
        let place = format!("accessor {}", accessor.index());
        let span = |stride: usize, count: usize, size: usize, offset: usize| {
            count
                .checked_sub(1)
                .and_then(|n| n.checked_mul(stride))
                .and_then(|s| s.checked_add(size))
                .and_then(|s| s.checked_add(offset))
        };
        if accessor.count() == 0 {
            return Err(error(name, &place, "it has no elements", "expected a count of 1 or more"));
        }
        if let Some(view) = accessor.view() {
            let stride = view.stride().unwrap_or(accessor.size());
            if stride < accessor.size() {
                let found = format!("a byteStride of {stride} for elements of {} bytes", accessor.size());
                return Err(error(name, &place, found, "expected a stride that holds an element"));
            }
            match span(stride, accessor.count(), accessor.size(), accessor.offset()) {
                Some(end) => view_end(&view, &place, end)?,
                None => {
                    return Err(error(
                        name,
                        &place,
                        format!("{} elements", accessor.count()),
                        "expected a size that fits the buffer",
                    ));
                }
            }
        } else if accessor.sparse().is_some() && accessor.count() > most_zeros {
            let found = format!("{} elements without data", accessor.count());
            return Err(error(name, &place, found, format!("expected at most {most_zeros}, as many as the file has bytes")));
        }
        if let Some(sparse) = accessor.sparse() {
            let (indices, values) = (sparse.indices(), sparse.values());
            let ends = [
                (
                    indices.view(),
                    span(indices.index_type().size(), sparse.count(), indices.index_type().size(), indices.offset()),
                ),
                (values.view(), span(accessor.size(), sparse.count(), accessor.size(), values.offset())),
            ];
            for (view, end) in ends {
                let end =
                    end.ok_or_else(|| error(name, &place, "its sparse part overflows", "expected a size that fits the buffer"))?;
                view_end(&view, &format!("{place} (sparse)"), end)?;
            }
        }
    }
    Ok(())
}
