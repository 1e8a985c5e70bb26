//! Composition: layers stacked, referenced and chosen among become prims with all opinions on them, strongest first.
//!
//! Arcs are followed from strong to weak as "LIVRPS" has it: local, inherits, variants, references, payloads, specializes. Source: OpenUSD,
//! "Glossary" (LIVRPS strength ordering, list editing, value resolution) and `SdfPath`. We depart from it in three things: classes that are
//! inherited across a reference are not looked for in the referencing layers, specializes are as weak as their prim's other arcs and no weaker,
//! and relocates are not followed.

mod values;

pub use self::values::{Fingerprint, TimeSample};

use super::layer::{Folder, Key, Layer, Reference, TimeShift, Value, child_path, without_variants};
use super::package::{self, Package};
use super::{binary, error, text};
use crate::SceneError;
use crate::load::{Fetch, beginning};
use std::collections::HashMap;
use std::sync::Arc;

/// Most files of a scene.
const MOST_LAYERS: usize = 65_536;
/// Deepest that layers lie in layers, arcs lead to arcs, and prims lie within prims.
const DEEPEST: usize = 64;
/// Deepest that prims lie within prims.
const DEEPEST_PRIM: usize = 256;
/// Time codes in a second that are believed.
const PLAUSIBLE_RATES: std::ops::RangeInclusive<f64> = 1e-6..=1e6;
/// Most opinions on one prim, and on all.
const MOST_SITES: usize = 4096;
const MOST_SITES_IN_ALL: usize = 1 << 25;

/// Layers that are stacked, strongest first, and their times.
#[derive(Debug)]
struct Stack {
    layers: Vec<(usize, TimeShift)>,
}

/// How a site was come to: what its paths and times are in the scene's.
#[derive(Debug)]
struct Link {
    /// Prim that was referred to, and the prim of the scene that refers to it.
    from: String,
    to: String,
    /// Whether paths elsewhere in the same layers mean what they mean there.
    same_layers: bool,
    shift: TimeShift,
    /// The stack and the path that were referred to.
    target: (usize, String),
    outer: Option<Arc<Link>>,
}

impl Link {
    /// A path of the scene for a path of a layer, if there is one.
    fn scene_path(self: &Arc<Link>, path: &str) -> Option<String> {
        let path = without_variants(path);
        let mut link = self;
        loop {
            let rest = path.strip_prefix(link.from.trim_end_matches('/'));
            if let Some(rest) = rest.filter(|r| r.is_empty() || r.starts_with(['/', '.'])) {
                return Some(format!("{}{rest}", link.to.trim_end_matches('/')));
            }
            if !link.same_layers {
                return None;
            }
            link = link.outer.as_ref()?;
        }
    }

    /// Whether a target was come through already.
    fn passed(self: &Arc<Link>, stack: usize, path: &str) -> bool {
        std::iter::successors(Some(self), |l| l.outer.as_ref()).any(|l| l.target.0 == stack && l.target.1 == path)
    }
}

/// A place in a stack of layers that has opinions on a prim.
#[derive(Clone, Debug)]
struct Site {
    stack: usize,
    path: String,
    link: Arc<Link>,
    /// Whether an arc or a variant of the prim itself leads here, not of what is around it.
    is_direct: bool,
}

/// A prim of the scene.
#[derive(Debug)]
pub struct Prim {
    pub path: String,
    sites: Vec<Site>,
    /// Whether what is below it is the same as below others that refer to the same.
    is_instance: bool,
}

impl Prim {
    /// The sites whose opinions count below it. Of an instance those are what its own arcs lead to: overrides from around it are
    /// discarded. Source: OpenUSD, "Glossary" (Instanceable).
    fn sites_below(&self) -> impl DoubleEndedIterator<Item = &Site> {
        self.sites.iter().filter(|s| s.is_direct || !self.is_instance)
    }

    /// Its own name.
    pub fn name(&self) -> &str {
        self.path.rsplit('/').next().unwrap_or_default()
    }
}

/// All layers, and the prims that were asked for.
pub struct Stage<'a> {
    fetch: Fetch<'a>,
    layers: Vec<Layer>,
    packages: Vec<Package>,
    /// Numbers of packages by the keys of their files, or why they cannot be had.
    package_of: HashMap<String, Result<usize, String>>,
    stacks: Vec<Stack>,
    by_file: HashMap<String, usize>,
    stack_of: HashMap<usize, usize>,
    prims: HashMap<String, Option<Arc<Prim>>>,
    sites: usize,
    /// Files that could not be had, and why.
    pub missing: Vec<String>,
    /// The time in the scene's time codes at which values hold that do not move.
    pub start: f64,
}

type Read<T> = Result<T, SceneError>;

impl<'a> Stage<'a> {
    /// Reads the layer that a scene begins with, and what it stacks.
    pub fn new(bytes: Vec<u8>, name: &str, fetch: Fetch<'a>) -> Read<Self> {
        let mut stage = Stage {
            fetch,
            layers: vec![],
            packages: vec![],
            package_of: HashMap::new(),
            stacks: vec![],
            by_file: HashMap::new(),
            stack_of: HashMap::new(),
            prims: HashMap::new(),
            sites: 0,
            missing: vec![],
            start: 0.0,
        };
        let layer = stage.add_layer(bytes.into(), name, Folder::default(), 0)?;
        let stack = stage.stack(layer)?;
        let link = Link {
            from: "/".into(),
            to: "/".into(),
            same_layers: true,
            shift: TimeShift::NONE,
            target: (stack, "/".into()),
            outer: None,
        };
        let sites = vec![Site { stack, path: "/".into(), link: Arc::new(link), is_direct: false }];
        stage.prims.insert("/".into(), Some(Arc::new(Prim { path: "/".into(), sites, is_instance: false })));
        stage.start = stage.root(Key::StartTimeCode)?.and_then(|v| v.number()).unwrap_or(0.0);
        Ok(stage)
    }

    /// Metadata of the first layer.
    pub fn root(&self, key: Key) -> Read<Option<Value>> {
        self.layers[self.stacks[0].layers[0].0].get("/", key)
    }

    fn add_layer(&mut self, bytes: Arc<[u8]>, name: &str, folder: Folder, depth: usize) -> Read<usize> {
        if self.layers.len() >= MOST_LAYERS || depth > DEEPEST {
            return Err(error(name, format!("more than {MOST_LAYERS} files, or packages {DEEPEST} deep"), "fewer"));
        }
        let layer = if bytes.starts_with(binary::MAGIC) {
            binary::read(bytes, name, folder)?
        } else if bytes.starts_with(text::MAGIC) {
            text::read(&bytes, name, folder)?
        } else if bytes.starts_with(package::MAGIC) {
            let package = package::read(bytes, name)?;
            let expected = "a package whose first file is a .usd, .usda or .usdc";
            let first = package.first.clone().ok_or_else(|| error(name, "an empty package", expected))?;
            if !first.to_lowercase().rsplit('.').next().is_some_and(|e| e.starts_with("usd")) {
                return Err(error(name, format!("\"{first}\" as its first file"), expected));
            }
            let inner: Arc<[u8]> = package.bytes[package.files[&first].clone()].into();
            self.packages.push(package);
            let folder = Folder { package: Some(self.packages.len() - 1), path: folder_of(&first) };
            return self.add_layer(inner, &format!("{name}[{first}]"), folder, depth + 1);
        } else {
            let expected = "a USD file: .usda (\"#usda\"), .usdc (\"PXR-USDC\") or .usdz (\"PK\")";
            return Err(error(name, beginning(&bytes), expected));
        };
        self.layers.push(layer);
        Ok(self.layers.len() - 1)
    }

    /// Time codes in a second of a layer. Source: OpenUSD, `SdfLayer::GetTimeCodesPerSecond`.
    fn time_codes_per_second(&self, layer: usize) -> Read<f64> {
        for key in [Key::TimeCodesPerSecond, Key::FramesPerSecond] {
            let rate = self.layers[layer].get("/", key)?.and_then(|v| v.number());
            if let Some(rate) = rate.filter(|r| PLAUSIBLE_RATES.contains(r)) {
                return Ok(rate);
            }
        }
        Ok(24.0)
    }

    /// How many time codes of a layer are one of another.
    fn codes_in_one(&self, layer: usize, inner: usize) -> Read<f64> {
        Ok(self.time_codes_per_second(layer)? / self.time_codes_per_second(inner)?)
    }

    /// The bytes of a file that a layer names. Fails with the reason where it cannot be had, or is not in the package that it is looked for in.
    pub fn file(&mut self, layer: usize, asset: &str) -> Result<Vec<u8>, String> {
        let (package, path) = self.located(layer, asset)?;
        self.bytes(package, &path)
    }

    /// What tells files apart that layers name.
    pub fn file_key(&mut self, layer: usize, asset: &str) -> String {
        match self.located(layer, asset) {
            Ok((package, path)) => key_of(package, &path),
            Err(_) => format!("{layer}?{asset}"),
        }
    }

    /// Number of the package that a file is in, and its path there, or from the folder of the main file. "a.usdz[b/c.png]" is a file in a package. Fails
    /// where a package on the way cannot be had. Source: OpenUSD, `ArSplitPackageRelativePathOuter`.
    fn located(&mut self, layer: usize, asset: &str) -> Result<(Option<usize>, String), String> {
        let Folder { mut package, path: mut folder } = self.layers[layer].folder.clone();
        let mut rest = asset;
        while let Some((outer, inner)) = rest.strip_suffix(']').and_then(|r| r.split_once('[')).filter(|(o, _)| !o.is_empty()) {
            package = Some(self.package(package, joined(&folder, outer))?);
            (folder, rest) = (String::new(), inner);
        }
        Ok((package, joined(&folder, rest)))
    }

    /// Number of the package at a path, opened where it is met first.
    fn package(&mut self, within: Option<usize>, path: String) -> Result<usize, String> {
        let key = key_of(within, &path);
        if let Some(known) = self.package_of.get(&key) {
            return known.clone();
        }
        let name = self.name_of(within, &path);
        let read = self.bytes(within, &path).and_then(|bytes| match bytes.starts_with(package::MAGIC) {
            true => package::read(bytes.into(), &name).map_err(|e| e.to_string()),
            false => Err(format!("{name} is no package")),
        });
        let number = read.map(|package| {
            self.packages.push(package);
            self.packages.len() - 1
        });
        self.package_of.insert(key, number.clone());
        number
    }

    fn bytes(&self, package: Option<usize>, path: &str) -> Result<Vec<u8>, String> {
        let Some(package) = package.map(|p| &self.packages[p]) else { return (self.fetch)(path) };
        let range = package.files.get(path).ok_or_else(|| format!("it is not in {}", package.name))?;
        Ok(package.bytes[range.clone()].to_vec())
    }

    /// A file for messages.
    fn name_of(&self, package: Option<usize>, path: &str) -> String {
        package.map_or_else(|| path.to_owned(), |p| format!("{}[{path}]", self.packages[p].name))
    }

    /// The stack that begins with a file that a layer names; `None` where it cannot be had, which is noted.
    fn open(&mut self, layer: usize, asset: &str) -> Read<Option<usize>> {
        match self.open_layer(layer, asset)? {
            Some(layer) => self.stack(layer).map(Some),
            None => Ok(None),
        }
    }

    fn open_layer(&mut self, layer: usize, asset: &str) -> Read<Option<usize>> {
        let key = self.file_key(layer, asset);
        if let Some(known) = self.by_file.get(&key) {
            return Ok((*known != usize::MAX).then_some(*known));
        }
        let is_layer = |bytes: &[u8]| [binary::MAGIC, text::MAGIC, package::MAGIC].iter().any(|m| bytes.starts_with(m));
        let located = self.located(layer, asset);
        let file = located.and_then(|(package, path)| self.bytes(package, &path).map(|bytes| (bytes, package, path)));
        let read = match file {
            Ok((bytes, package, path)) if is_layer(&bytes) => {
                let (next, is_package) = (self.packages.len(), bytes.starts_with(package::MAGIC));
                let name = self.name_of(package, &path);
                let number = self.add_layer(bytes.into(), &name, Folder { package, path: folder_of(&path) }, 0)?;
                if is_package {
                    self.package_of.entry(key.clone()).or_insert(Ok(next));
                }
                Some(number)
            }
            // MaterialX documents and other formats that plugins of OpenUSD read.
            Ok(_) => {
                self.missing.push(format!("{asset} (it is no USD file)"));
                None
            }
            Err(reason) => {
                self.missing.push(format!("{asset} ({reason})"));
                None
            }
        };
        self.by_file.insert(key, read.unwrap_or(usize::MAX));
        Ok(read)
    }

    /// A layer and its sublayers.
    fn stack(&mut self, first: usize) -> Read<usize> {
        if let Some(known) = self.stack_of.get(&first) {
            return Ok(*known);
        }
        let mut layers = Vec::new();
        // Layers still to come, the strongest last, with those that they lie in.
        let mut open = vec![(first, TimeShift::NONE, vec![])];
        while let Some((layer, shift, outer)) = open.pop() {
            if outer.contains(&layer) || outer.len() > DEEPEST || layers.len() > MOST_LAYERS {
                let found = "a layer among its own sublayers";
                return Err(error(&self.layers[layer].name, found, "sublayers that do not include each other"));
            }
            layers.push((layer, shift));
            let Some(Value::Texts(names)) = self.layers[layer].get("/", Key::SubLayers)? else { continue };
            let offsets = self.layers[layer].get("/", Key::SubLayerOffsets)?.and_then(|o| o.doubles()).unwrap_or_default();
            let within: Vec<usize> = outer.iter().copied().chain([layer]).collect();
            for (i, name) in names.iter().enumerate().rev() {
                if let Some(inner) = self.open_layer(layer, name)? {
                    let own = match offsets.get(2 * i..2 * i + 2) {
                        Some([offset, scale]) => TimeShift { offset: *offset, scale: *scale },
                        _ => TimeShift::NONE,
                    };
                    let own = own.of_longer_codes(self.codes_in_one(layer, inner)?);
                    open.push((inner, own.within(shift), within.clone()));
                }
            }
        }
        self.stacks.push(Stack { layers });
        self.stack_of.insert(first, self.stacks.len() - 1);
        Ok(self.stacks.len() - 1)
    }

    /// The prim of a path of the scene, if anything is said of it.
    pub fn prim(&mut self, path: &str) -> Read<Option<Arc<Prim>>> {
        if let Some(known) = self.prims.get(path) {
            return Ok(known.clone());
        }
        if path.matches('/').count() > DEEPEST_PRIM {
            let found = format!("prims within prims, more than {DEEPEST_PRIM} deep");
            return Err(error(&self.layers[0].name, found, "fewer levels: does a prim refer to one that holds it?"));
        }
        let Some((parent, name)) = path.rsplit_once('/').filter(|(_, name)| !name.is_empty()) else { return Ok(None) };
        let made = match self.prim(if parent.is_empty() { "/" } else { parent })? {
            Some(parent) => self.composed(&parent, name)?,
            None => None,
        };
        self.prims.insert(path.to_owned(), made.clone());
        Ok(made)
    }

    /// The children of a prim, in the order of the weakest layer that names them.
    pub fn children(&mut self, prim: &Prim) -> Read<Vec<Arc<Prim>>> {
        let mut names: Vec<Arc<str>> = Vec::new();
        let mut known = std::collections::HashSet::new();
        for site in prim.sites_below().rev() {
            for (layer, _) in self.stacks[site.stack].layers.iter().rev() {
                if let Some(Value::Texts(list)) = self.layers[*layer].get(&site.path, Key::PrimChildren)? {
                    // In damaged files a name can be a path: of the prim itself, for one.
                    let names_child = |n: &str| !n.is_empty() && !n.contains(['/', '.', '{']);
                    names.extend(list.iter().filter(|n| names_child(n) && known.insert((*n).clone())).cloned());
                }
            }
        }
        let mut all = Vec::with_capacity(names.len());
        for name in names {
            all.extend(self.prim(&child_path(&prim.path, &name))?);
        }
        Ok(all)
    }

    fn composed(&mut self, parent: &Prim, name: &str) -> Read<Option<Arc<Prim>>> {
        let path = child_path(&parent.path, name);
        let mut found = Composing { to: path, sites: vec![], chosen: HashMap::new() };
        for site in parent.sites_below() {
            let inner = Site { path: child_path(&site.path, name), is_direct: false, ..site.clone() };
            self.expand(inner, &mut found, 0)?;
        }
        self.sites += found.sites.len();
        if self.sites > MOST_SITES_IN_ALL {
            let expected = "fewer: do references repeat each other?";
            return Err(error(&found.to, format!("more than {MOST_SITES_IN_ALL} opinions in all"), expected));
        }
        if found.sites.is_empty() {
            return Ok(None);
        }
        let mut prim = Prim { path: found.to, sites: found.sites, is_instance: false };
        prim.is_instance = prim.sites.iter().any(|s| s.is_direct)
            && self.field(&prim, Key::Instanceable)?.and_then(|v| v.number()).is_some_and(|v| v != 0.0);
        Ok(Some(Arc::new(prim)))
    }

    /// Adds a site and all that its arcs lead to.
    fn expand(&mut self, site: Site, found: &mut Composing, depth: usize) -> Read<()> {
        let layers: Vec<(usize, TimeShift)> = self.stacks[site.stack]
            .layers
            .iter()
            .filter(|(l, _)| self.layers[*l].specs.contains_key(site.path.as_str()))
            .copied()
            .collect();
        if layers.is_empty() {
            return Ok(());
        }
        if depth > DEEPEST || found.sites.len() >= MOST_SITES {
            let expected = "fewer: does something refer to itself?";
            return Err(error(&found.to, format!("references to references, more than {DEEPEST} deep"), expected));
        }
        found.sites.push(Site { is_direct: depth > 0, ..site.clone() });
        let (mut inherits, mut specializes, mut sets) = (vec![], vec![], vec![]);
        let (mut references, mut payloads) = (vec![], vec![]);
        // Weakest first: each layer edits what is below.
        for (layer, shift) in layers.iter().rev() {
            let at = &self.layers[*layer];
            for (key, list) in
                [(Key::InheritPaths, &mut inherits), (Key::Specializes, &mut specializes), (Key::VariantSetNames, &mut sets)]
            {
                if let Some(Value::List(edits)) = at.get(&site.path, key)? {
                    edits.apply(list);
                }
            }
            for (key, list) in [(Key::References, &mut references), (Key::Payload, &mut payloads)] {
                if let Some(Value::References(edits)) = at.get(&site.path, key)? {
                    let here = |r: &Reference| Some((Reference { shift: r.shift.within(*shift), ..r.clone() }, *layer));
                    edits.map(here).apply(list);
                }
            }
        }
        for (layer, _) in &layers {
            if let Some(Value::Selections(all)) = self.layers[*layer].get(&site.path, Key::VariantSelection)? {
                for (set, variant) in all.iter() {
                    found.chosen.entry(set.clone()).or_insert_with(|| variant.clone());
                }
            }
        }
        for class in &inherits {
            self.follow_inside(&site, class, TimeShift::NONE, found, depth)?;
        }
        for set in &sets {
            if let Some(variant) = found.chosen.get(set).filter(|v| !v.is_empty()) {
                let path = format!("{}{{{set}={variant}}}", site.path);
                self.expand(Site { path, ..site.clone() }, found, depth + 1)?;
            }
        }
        for (reference, layer) in references.into_iter().chain(payloads) {
            self.follow(&site, &reference, layer, found, depth)?;
        }
        for class in &specializes {
            self.follow_inside(&site, class, TimeShift::NONE, found, depth)?;
        }
        Ok(())
    }

    /// Follows a reference to a file, or within the layers of a site.
    fn follow(&mut self, site: &Site, to: &Reference, layer: usize, found: &mut Composing, depth: usize) -> Read<()> {
        if to.asset.is_empty() {
            let path = match to.prim.is_empty() {
                true => self.default_prim(self.stacks[site.stack].layers[0].0)?,
                false => Some(to.prim.to_string()),
            };
            return path.map_or(Ok(()), |path| self.follow_inside(site, &path, to.shift, found, depth));
        }
        let Some(stack) = self.open(layer, &to.asset)? else { return Ok(()) };
        let path = match to.prim.is_empty() {
            true => self.default_prim(self.stacks[stack].layers[0].0)?,
            false => Some(to.prim.to_string()),
        };
        let Some(path) = path else {
            let missing = format!("{} (it has no default prim)", to.asset);
            if !self.missing.contains(&missing) {
                self.missing.push(missing);
            }
            return Ok(());
        };
        let shift = to.shift.of_longer_codes(self.codes_in_one(layer, self.stacks[stack].layers[0].0)?);
        self.enter(site, stack, path, shift, found, depth)
    }

    fn follow_inside(&mut self, site: &Site, path: &str, shift: TimeShift, found: &mut Composing, depth: usize) -> Read<()> {
        self.enter(site, site.stack, without_variants(path), shift, found, depth)
    }

    fn enter(
        &mut self,
        site: &Site,
        stack: usize,
        path: String,
        shift: TimeShift,
        found: &mut Composing,
        depth: usize,
    ) -> Read<()> {
        if site.link.passed(stack, &path) || stack == site.stack && without_variants(&site.path) == path {
            let name = &self.layers[self.stacks[stack].layers[0].0].name;
            let found = format!("{path} refers to itself, by way of {}", site.path);
            return Err(error(name, found, "references, payloads and inherits that do not go round"));
        }
        let link = Link {
            from: path.clone(),
            to: found.to.clone(),
            same_layers: stack == site.stack,
            shift: shift.within(site.link.shift),
            target: (stack, path.clone()),
            outer: Some(site.link.clone()),
        };
        self.expand(Site { stack, path, link: Arc::new(link), is_direct: true }, found, depth + 1)
    }

    fn default_prim(&self, layer: usize) -> Read<Option<String>> {
        let name = self.layers[layer].get("/", Key::DefaultPrim)?;
        Ok(name.as_ref().and_then(Value::text).map(|n| if n.starts_with('/') { n.to_string() } else { format!("/{n}") }))
    }
}

/// A prim that is being put together.
struct Composing {
    to: String,
    sites: Vec<Site>,
    /// Variants by the sets that they are chosen of.
    chosen: HashMap<Arc<str>, Arc<str>>,
}

/// What tells files apart: the package that they are in, and their paths.
fn key_of(package: Option<usize>, path: &str) -> String {
    format!("{}:{path}", package.map_or(String::new(), |p| p.to_string()))
}

/// The folder of a file: up to the last slash.
fn folder_of(path: &str) -> String {
    path.rfind(['/', '\\']).map_or(String::new(), |end| path[..=end].to_owned())
}

/// A path that counts from a folder, without "." and "..", as far as they can be taken out.
fn joined(folder: &str, path: &str) -> String {
    let path = path.replace('\\', "/");
    if path.starts_with('/') || path.get(1..3) == Some(":/") || path.contains("://") {
        return path;
    }
    let mut parts: Vec<&str> = Vec::new();
    let whole = format!("{folder}{path}");
    for part in whole.split('/') {
        match part {
            "." => (),
            "" if !parts.is_empty() => (),
            ".." if parts.last().is_some_and(|p| !matches!(*p, ".." | "")) => drop(parts.pop()),
            other => parts.push(other),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests;
