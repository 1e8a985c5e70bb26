//! Layers: files that stack sublayers, found from each other, and the times of each. What they say of prims together is in [`composition`].

mod composition;
mod values;

pub use self::composition::Prim;
pub use self::values::{Fingerprint, TimeSample};

use super::layer::{Folder, Key, Layer, TimeShift, Value};
use super::package::{self, Package};
use super::{binary, error, text};
use crate::SceneError;
use crate::load::{Fetch, beginning};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

/// Most files of a scene.
const MOST_LAYERS: usize = 65_536;
/// Deepest that layers lie in layers.
const DEEPEST: usize = 64;
/// Time codes in a second that are believed.
const PLAUSIBLE_RATES: std::ops::RangeInclusive<f64> = 1e-6..=1e6;

/// Layers that are stacked, strongest first, and their times.
#[derive(Debug)]
struct Stack {
    layers: Vec<(usize, TimeShift)>,
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
    /// Prims of paths in stacks; the scene's own is the first.
    prims: HashMap<(usize, String), Option<Arc<Prim>>>,
    /// Those that are being put together.
    composing: HashSet<(usize, String)>,
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
            composing: HashSet::new(),
            sites: 0,
            missing: vec![],
            start: 0.0,
        };
        let layer = stage.add_layer(bytes.into(), name, Folder::default(), 0)?;
        stage.stack(layer)?;
        stage.start = stage.root(Key::StartTimeCode)?.and_then(|v| v.number()).unwrap_or(0.0);
        Ok(stage)
    }

    /// Metadata of the first layer.
    pub fn root(&self, key: Key) -> Read<Option<Value>> {
        self.layers[self.stacks[0].layers[0].0].get("/", key)
    }

    /// Whether a field is anywhere in the layers.
    pub fn uses(&self, key: Key) -> bool {
        self.layers.iter().any(|layer| layer.uses(key))
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
