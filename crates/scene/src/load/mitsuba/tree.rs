//! The elements of a scene: XML with its defaults put in and its includes in their places.

use crate::SceneError;
use crate::load::Fetch;
use diopter_light::names::nearest;
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Deepest that elements lie in elements, and files in files.
const DEEPEST: usize = 64;
/// Most elements of a scene.
const MOST: usize = 1 << 24;

/// An element.
#[derive(Debug)]
pub struct Node {
    pub tag: String,
    attributes: Vec<(String, String)>,
    pub children: Vec<Arc<Node>>,
    pub line: u32,
    pub file: Arc<str>,
    /// Whether anybody asked for it by its name, or for its plugin.
    is_read: AtomicBool,
}

/// Elements that are a value of the one they lie in.
const VALUES: [&str; 12] =
    ["float", "integer", "boolean", "string", "point", "vector", "rgb", "srgb", "spectrum", "blackbody", "transform", "texture"];
/// Elements that are objects, parts of a transform, or about the file. Source: Mitsuba 3 and 0.6, their XML parsers.
const OTHERS: [&str; 28] = [
    "scene",
    "shape",
    "bsdf",
    "emitter",
    "sensor",
    "film",
    "sampler",
    "rfilter",
    "integrator",
    "medium",
    "phase",
    "volume",
    "subsurface",
    "animation",
    "ref",
    "alias",
    "default",
    "include",
    "path",
    "translate",
    "rotate",
    "scale",
    "matrix",
    "lookat",
    "lookAt",
    "look_at",
    "color",
    "utility",
];
/// Values that no picture of a real camera depends on: where rays are cut off, how samples are drawn and texels kept, and the shutter, which is the camera's own.
const WITHOUT_EFFECT: [&str; 21] = [
    "rr_depth",
    "strict_normals",
    "samples_per_pass",
    "emitter_samples",
    "bsdf_samples",
    "near_clip",
    "far_clip",
    "shutter_open",
    "shutter_close",
    "sampling_weight",
    "sample_visible",
    "sample_emitters",
    "has_spectral_extinction",
    "mis_compensation",
    "max_anisotropy",
    "format",
    "accel",
    "cache",
    "diffuse_reflectance_sampling_rate",
    "specular_reflectance_sampling_rate",
    "clearcoat_sampling_rate",
];

impl Node {
    /// An attribute.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|a| a.0 == name).map(|a| a.1.as_str())
    }

    /// Its plugin, such as "diffuse".
    pub fn kind(&self) -> &str {
        self.set_read();
        self.get("type").unwrap_or_default()
    }

    /// The child of a name.
    pub fn child(&self, name: &str) -> Option<&Arc<Node>> {
        self.children.iter().find(|c| c.get("name") == Some(name)).inspect(|c| c.set_read())
    }

    /// Whether any element within it is such a one.
    pub fn has_any(&self, is_one: &dyn Fn(&Node) -> bool) -> bool {
        self.children.iter().any(|child| is_one(child) || child.has_any(is_one))
    }

    /// Notes that it was asked for.
    pub fn set_read(&self) {
        self.is_read.store(true, Relaxed);
    }

    /// Leaves out what lies in it, too: nobody is told of its values one by one.
    pub fn leave_out(&self) {
        for child in self.children.iter().filter(|c| VALUES.contains(&c.tag.as_str())) {
            child.set_read();
            child.leave_out();
        }
    }

    /// Values of it and of what lies in it that nobody asked for, of plugins that somebody asked for: a name and whose it is.
    pub fn unread(&self, found: &mut Vec<String>) {
        if self.is_read.load(Relaxed) && self.get("type").is_some() {
            let unread = |c: &&Arc<Node>| !c.is_read.load(Relaxed) && VALUES.contains(&c.tag.as_str());
            let names = self.children.iter().filter(unread).filter_map(|c| c.get("name"));
            let names = names.filter(|name| !WITHOUT_EFFECT.contains(name));
            found.extend(names.map(|name| format!("\"{name}\" of {} \"{}\"", self.tag, self.get("type").unwrap_or_default())));
        }
        self.children.iter().for_each(|c| c.unread(found));
    }

    /// Fails at the first element in it that Mitsuba's scenes do not have: what is misspelt would be left out.
    pub fn check_elements(&self) -> Result<(), SceneError> {
        for child in &self.children {
            if !VALUES.contains(&child.tag.as_str()) && !OTHERS.contains(&child.tag.as_str()) {
                let known = VALUES.iter().chain(&OTHERS).copied();
                let hint = nearest(&child.tag, known).map_or(String::new(), |name| format!(" (did you mean <{name}>?)"));
                return Err(wrong(
                    &child.file,
                    child.line,
                    format!("<{}>", child.tag),
                    &format!("an element of Mitsuba's scenes{hint}"),
                ));
            }
            child.check_elements()?;
        }
        Ok(())
    }

    /// Children with a tag.
    pub fn tagged<'a>(&'a self, tag: &'a str) -> impl Iterator<Item = &'a Arc<Node>> {
        self.children.iter().filter(move |c| c.tag == tag)
    }
}

/// A file that is being read.
struct File {
    name: Arc<str>,
    /// Where its lines end.
    ends: Vec<usize>,
}

impl File {
    fn line(&self, node: &roxmltree::Node) -> u32 {
        self.ends.partition_point(|end| *end < node.range().start) as u32 + 1
    }
}

/// Gets a file by its name, or below one of the folders that the scene names. Fails with the reason of the plain name where none of them has it.
pub fn found(fetch: Fetch, folders: &[String], name: &str) -> Result<Vec<u8>, String> {
    let plain = fetch(name);
    let elsewhere = || folders.iter().find_map(|folder| fetch(&format!("{}/{name}", folder.trim_end_matches('/'))).ok());
    plain.or_else(|reason| elsewhere().ok_or(reason))
}

struct Reader<'a> {
    fetch: Fetch<'a>,
    /// Where files are looked for, too.
    folders: Vec<String>,
    defaults: HashMap<String, String>,
    count: usize,
}

fn wrong(file: &str, line: u32, found: impl Into<String>, expected: &str) -> SceneError {
    let place = if line == 0 { file.to_owned() } else { format!("{file}: line {line}") };
    SceneError::File { place, found: found.into(), expected: format!("expected {expected}") }
}

/// Reads the main file and what it includes; the folders in which its files are looked for, too. Fails with file and line where it is no XML, its root is no `scene`, an
/// include cannot be had or goes round, a `$name` has no default, or there are too many elements.
pub fn read(bytes: &[u8], name: &str, fetch: Fetch) -> Result<(Node, Vec<String>), SceneError> {
    let mut reader = Reader { fetch, folders: vec![], defaults: HashMap::new(), count: 0 };
    let mut all = reader.file(bytes, name, 0)?;
    let root = all.pop().filter(|_| all.is_empty());
    let root = root.and_then(Arc::into_inner).filter(|r| r.tag == "scene");
    Ok((root.ok_or_else(|| wrong(name, 0, "no scene", "<scene version=\"3.0.0\">"))?, reader.folders))
}

impl Reader<'_> {
    /// The elements of a file: of one that is included those within its scene.
    fn file(&mut self, bytes: &[u8], name: &str, depth: usize) -> Result<Vec<Arc<Node>>, SceneError> {
        if depth > DEEPEST {
            return Err(wrong(
                name,
                0,
                format!("files that include each other, more than {DEEPEST} deep"),
                "files that do not include themselves",
            ));
        }
        let text = std::str::from_utf8(bytes).map_err(|_| wrong(name, 0, "bytes that are not UTF-8", "an XML file"))?;
        let options = roxmltree::ParsingOptions { allow_dtd: false, nodes_limit: MOST as u32, ..Default::default() };
        let document = roxmltree::Document::parse_with_options(text, options)
            .map_err(|e| wrong(name, e.pos().row, e.to_string(), "an XML file"))?;
        let root = document.root_element();
        if depth == 0 && root.tag_name().name() != "scene" {
            return Err(wrong(name, 1, format!("<{}>", root.tag_name().name()), "a scene of Mitsuba: <scene version=\"3.0.0\">"));
        }
        let ends = text.bytes().enumerate().filter(|(_, b)| *b == b'\n').map(|(i, _)| i).collect();
        let file = File { name: name.into(), ends };
        if depth > 0 && root.tag_name().name() == "scene" {
            return self.children(root, &file, depth);
        }
        Ok(vec![self.element(root, &file, depth)?])
    }

    fn children(&mut self, of: roxmltree::Node, file: &File, depth: usize) -> Result<Vec<Arc<Node>>, SceneError> {
        let mut all = Vec::new();
        for child in of.children().filter(roxmltree::Node::is_element) {
            let line = file.line(&child);
            match child.tag_name().name() {
                "default" => {
                    let (Some(key), Some(value)) = (child.attribute("name"), child.attribute("value")) else {
                        return Err(wrong(
                            &file.name,
                            line,
                            "a default without name or value",
                            "<default name=\"n\" value=\"v\"/>",
                        ));
                    };
                    self.defaults.entry(key.to_owned()).or_insert_with(|| value.to_owned());
                }
                "include" => {
                    let inner = child
                        .attribute("filename")
                        .ok_or_else(|| wrong(&file.name, line, "an include without filename", "a filename"))?;
                    let inner = self.substituted(inner, &file.name, line)?;
                    let bytes = found(self.fetch, &self.folders, &inner)
                        .map_err(|e| wrong(&file.name, line, format!("{inner}: {e}"), "a file that can be read"))?;
                    all.extend(self.file(&bytes, &inner, depth + 1)?);
                }
                "path" => {
                    let folder =
                        child.attribute("value").ok_or_else(|| wrong(&file.name, line, "a path without value", "a folder"))?;
                    self.folders.push(self.substituted(folder, &file.name, line)?);
                }
                _ => all.push(self.element(child, file, depth)?),
            }
        }
        Ok(all)
    }

    fn element(&mut self, of: roxmltree::Node, file: &File, depth: usize) -> Result<Arc<Node>, SceneError> {
        let line = file.line(&of);
        self.count += 1;
        if depth > DEEPEST || self.count > MOST {
            return Err(wrong(&file.name, line, format!("elements more than {DEEPEST} deep, or more than {MOST}"), "fewer"));
        }
        let mut attributes = Vec::new();
        for a in of.attributes() {
            let value = self.substituted(a.value(), &file.name, line)?;
            attributes.push((a.name().to_owned(), if a.name() == "name" { snake_case(&value) } else { value }));
        }
        if of.tag_name().name() == "spectrum"
            && let Some(at) = attributes.iter().position(|(name, _)| name == "filename")
        {
            attributes[at] = ("value".to_owned(), self.spectrum(&attributes[at].1, &file.name, line)?);
        }
        let children = self.children(of, file, depth + 1)?;
        let (tag, file, is_read) = (of.tag_name().name().to_owned(), file.name.clone(), AtomicBool::new(false));
        Ok(Arc::new(Node { tag, attributes, children, line, file, is_read }))
    }

    /// Values of a file of wavelengths (nm) and values, a line each, as an attribute has them.
    fn spectrum(&self, name: &str, file: &str, line: u32) -> Result<String, SceneError> {
        let bytes = found(self.fetch, &self.folders, name)
            .map_err(|e| wrong(file, line, format!("{name}: {e}"), "a file that can be read"))?;
        let text = String::from_utf8_lossy(&bytes);
        let lines = text.lines().map(|l| l.split('#').next().unwrap_or_default().trim()).filter(|l| !l.is_empty());
        let pair = |l: &str| {
            let words: Vec<f32> = l.split_whitespace().map(|w| w.parse().ok()).collect::<Option<_>>()?;
            let [nm, value] = words[..] else { return None };
            Some(format!("{nm}:{value}"))
        };
        let pairs: Option<Vec<String>> = lines.map(pair).collect();
        let pairs = pairs.filter(|p| !p.is_empty());
        Ok(pairs.ok_or_else(|| wrong(file, line, name, "lines of a wavelength, nm, and a value"))?.join(", "))
    }

    /// A text with the values of defaults in the places of $names, the longest that fits.
    fn substituted(&self, text: &str, file: &str, line: u32) -> Result<String, SceneError> {
        let mut out = String::new();
        let mut rest = text;
        while let Some((before, after)) = rest.split_once('$') {
            out.push_str(before);
            let known = self.defaults.iter().filter(|d| after.starts_with(d.0.as_str())).max_by_key(|d| d.0.len());
            let (name, value) =
                known.ok_or_else(|| wrong(file, line, format!("\"${after}\""), "a <default> of that name before it"))?;
            out.push_str(value);
            rest = &after[name.len()..];
        }
        out.push_str(rest);
        Ok(out)
    }
}

/// A name as Mitsuba 3 writes it: `to_world` of `toWorld`, `int_ior` of `intIOR`, which are the names of Mitsuba 0.x.
fn snake_case(name: &str) -> String {
    let mut out = String::with_capacity(name.len() + 2);
    let (mut was_lower, mut in_word) = (false, false);
    for c in name.chars() {
        in_word = c.is_ascii_uppercase() && (was_lower || in_word);
        if in_word && was_lower {
            out.push('_');
        }
        out.push(if in_word { c.to_ascii_lowercase() } else { c });
        was_lower = c.is_ascii_lowercase();
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_old_files_become_those_of_new_ones() {
        let names = [("toWorld", "to_world"), ("intIOR", "int_ior"), ("alphaU", "alpha_u"), ("flipTexCoords", "flip_tex_coords")];
        for (old, new) in names.into_iter().chain([("to_world", "to_world"), ("sigma_t", "sigma_t"), ("K", "K"), ("", "")]) {
            assert_eq!(snake_case(old), new);
        }
    }

    #[test]
    fn defaults_and_includes_are_put_in() {
        let fetch = |name: &str| match name {
            "sub/b.xml" => Ok(b"<scene version='3'><shape type='$kind'/></scene>".to_vec()),
            "round.xml" => Ok(b"<scene><include filename='round.xml'/></scene>".to_vec()),
            _ => Err("there is no such file".to_owned()),
        };
        let text = "<scene version='3'><default name='k' value='x'/><default name='kind' value='sphere'/><default name='kind' value='y'/>\n\
            <path value='sub'/><include filename='b.xml'/><a b='$k-$kind'/></scene>";
        let (root, folders) = read(text.as_bytes(), "a.xml", &fetch).unwrap();
        assert_eq!(folders, ["sub"]);
        assert_eq!((root.children[0].kind(), root.children[1].get("b")), ("sphere", Some("x-sphere")));
        assert_eq!(root.children[1].line, 2);
        for (text, word) in [
            ("<scene><a b='$q'/></scene>", "\"$q\""),
            ("<scene><include filename='round.xml'/></scene>", "include each other"),
            ("<scene><include filename='gone.xml'/></scene>", "no such file"),
            ("<scene><a></scene>", "XML"),
            ("<COLLADA/>", "a scene of Mitsuba"),
            ("<!DOCTYPE x [<!ENTITY a 'b'>]><scene/>", "XML"),
        ] {
            let e = read(text.as_bytes(), "a.xml", &fetch).unwrap_err().to_string();
            assert!(e.contains(word), "{text}: {e}");
        }
        let deep = format!("<scene>{}{}</scene>", "<a>".repeat(100), "</a>".repeat(100));
        assert!(read(deep.as_bytes(), "a.xml", &fetch).unwrap_err().to_string().contains("deep"));
    }
}
