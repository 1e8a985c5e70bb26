//! What readers of parts ask of the scene in the making: files, objects by reference, what is left out, and what has been described so far.

use super::tree::Node;
use super::values::Shade;
use super::wrong;
use crate::SceneError;
use crate::load::{Fetch, measured_or_stand_in, note_missing, read_texture};
use crate::material::Scattering;
use crate::scene::Description;
use crate::texture::Image;
use glam::{Affine3A, DMat4};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// Deepest that references lead to references.
pub(super) const DEEPEST: usize = 24;

/// A scene in the making, as readers of its parts see it.
pub(super) struct Context<'a> {
    pub name: String,
    pub fetch: Fetch<'a>,
    /// Objects by their identifiers.
    ids: HashMap<String, Arc<Node>>,
    /// An element whose identifier another one has.
    pub twice: Option<Arc<Node>>,
    pub description: Description,
    pictures: HashMap<String, Option<Arc<Image>>>,
    measured: HashMap<String, Scattering>,
    pub left_out: BTreeMap<String, usize>,
    /// Whether the file says in what medium its sensor is.
    pub has_sensor_in_medium: bool,
}

type Read<T> = Result<T, SceneError>;

/// Gathers elements by their identifiers; the first whose identifier is taken goes to `twice`.
fn gather(node: &Arc<Node>, ids: &mut HashMap<String, Arc<Node>>, twice: &mut Option<Arc<Node>>) {
    if let Some(id) = node.get("id").filter(|_| !matches!(node.tag.as_str(), "ref" | "alias"))
        && ids.insert(id.to_owned(), node.clone()).is_some()
    {
        twice.get_or_insert_with(|| node.clone());
    }
    node.children.iter().for_each(|c| gather(c, ids, twice));
}

/// Adds the second names of elements. Source: Mitsuba 3, `<alias id="..." as="..."/>`.
fn gather_aliases(node: &Arc<Node>, ids: &mut HashMap<String, Arc<Node>>) {
    if let (Some(named), Some(alias)) = (node.get("id").filter(|_| node.tag == "alias"), node.get("as"))
        && let Some(named) = ids.get(named).cloned()
    {
        ids.insert(alias.to_owned(), named);
    }
    node.children.iter().for_each(|c| gather_aliases(c, ids));
}

impl<'a> Context<'a> {
    /// For the file `name`, nothing read yet.
    pub fn new(name: &str, fetch: Fetch<'a>, root: &Node) -> Self {
        let (mut ids, mut twice) = (HashMap::new(), None);
        root.children.iter().for_each(|c| gather(c, &mut ids, &mut twice));
        root.children.iter().for_each(|c| gather_aliases(c, &mut ids));
        Context {
            name: name.to_owned(),
            fetch,
            ids,
            twice,
            description: Description { name: name.to_owned(), ..Default::default() },
            pictures: HashMap::new(),
            measured: HashMap::new(),
            left_out: BTreeMap::new(),
            has_sensor_in_medium: false,
        }
    }

    /// Counts something that is left out.
    pub fn skip_unsupported(&mut self, what: impl Into<String>) {
        *self.left_out.entry(what.into()).or_default() += 1;
    }

    /// The element that a reference stands for; others stand for themselves.
    pub fn resolved(&self, node: &Arc<Node>) -> Read<Arc<Node>> {
        if node.tag != "ref" {
            return Ok(node.clone());
        }
        let id = node.get("id").unwrap_or_default();
        self.ids.get(id).cloned().ok_or_else(|| {
            let near = diopter_light::names::nearest(id, self.ids.keys().map(String::as_str));
            let hint =
                near.map_or("an object with that id".to_owned(), |n| format!("an object with that id (did you mean \"{n}\"?)"));
            wrong(node, format!("\"{id}\""), hint)
        })
    }

    /// The nested object of a tag, given there or by reference.
    pub fn nested(&self, node: &Node, tag: &str, name: Option<&str>) -> Read<Option<Arc<Node>>> {
        for child in &node.children {
            if name.is_some() && child.get("name") != name {
                continue;
            }
            let there = self.resolved_if(child, tag)?;
            if there.is_some() {
                child.set_read();
                return Ok(there);
            }
        }
        Ok(None)
    }

    /// What a child stands for, if it has a tag.
    pub fn resolved_if(&self, child: &Arc<Node>, tag: &str) -> Read<Option<Arc<Node>>> {
        let there = if child.tag == "ref" || child.tag == tag { Some(self.resolved(child)?) } else { None };
        Ok(there.filter(|n| n.tag == tag))
    }

    /// A colour or spectrum by name, given there or by reference; `None` where there is none. Fails on textures.
    pub fn shade(&self, node: &Node, name: &str) -> Read<Option<Shade>> {
        let Some(child) = node.child(name).map(|child| self.resolved(child)).transpose()? else { return Ok(None) };
        match Shade::of(&child)? {
            Some(shade) => Ok(Some(shade)),
            None => Err(wrong(&child, format!("a {} as \"{name}\"", child.tag), "a colour or a spectrum")),
        }
    }

    /// A picture of a surface; none where it is missing, which is noted.
    pub fn picture(&mut self, file: &str) -> Option<Arc<Image>> {
        if let Some(known) = self.pictures.get(file) {
            return known.clone();
        }
        let read = (self.fetch)(file).and_then(|bytes| read_texture(&bytes));
        let image = read.map(Arc::new).map_err(|reason| note_missing(&mut self.description.missing_textures, file, reason)).ok();
        self.pictures.insert(file.to_owned(), image.clone());
        image
    }

    /// A measured material; where its file cannot be read that is noted, and something stands in for it.
    pub fn measured(&mut self, file: &str) -> Scattering {
        if let Some(known) = self.measured.get(file) {
            return known.clone();
        }
        let made = measured_or_stand_in(&mut self.description.missing_textures, file, (self.fetch)(file));
        self.measured.insert(file.to_owned(), made.clone());
        made
    }
}

/// A matrix of single precision.
pub(super) fn affine(m: DMat4) -> Affine3A {
    Affine3A::from_mat4(m.as_mat4())
}
