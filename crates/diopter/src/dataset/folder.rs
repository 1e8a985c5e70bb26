//! Where the items of a data set are gathered: shards or folders, the table of all parameters, check sums and the card.
//!
//! Everything appears whole: it is written beside (in the folder `parts`) and renamed. An item that is done lies in `parts` until its shard is packed, so
//! that a run that was killed goes on where it was, and several processes can work on one folder. What is packed depends on the specification
//! alone; two processes that make the same item or shard write the same bytes.

use super::kind::Kind;
use super::sha256::{self, Hashing};
use super::{Dataset, Layout, parquet, tar};
use crate::expose::{ExposeError, ProgressReporter};
use crate::files;
use crate::shot::{SceneCache, ShotError};
use serde_json::{Map, Value, json};
use std::collections::{HashMap, HashSet};
use std::fs::{self, File, OpenOptions};
use std::hash::{BuildHasher, Hasher};
use std::io::{self, BufReader, BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// Folder of what is not packed yet.
pub(super) const PARTS: &str = "parts";
const CARD: &str = "card.json";
const SUMS: &str = "SHA256SUMS";
const VERSION: &str = env!("CARGO_PKG_VERSION");

/// A shard and its items.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shard {
    /// The part of the data set; "data" where there are none.
    pub split: String,
    /// Name of its file.
    pub name: String,
    /// Numbers of its items, in order.
    pub items: Vec<u64>,
}

/// What a finished data set is made of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Made {
    /// Files, relative to its folder.
    pub files: Vec<String>,
    /// How many items.
    pub items: u64,
}

/// A folder that a data set is made in.
#[derive(Debug)]
pub struct Folder {
    dataset: Arc<Dataset>,
    path: PathBuf,
    shards: Vec<Shard>,
    /// Files that the specification names, with their check sums when this folder was opened.
    inputs: Vec<Value>,
    /// Shards that were packed since.
    packed: Mutex<HashSet<String>>,
}

/// Whether a file is what is known of an item, a row of the table: no other one of an item is JSON by its whole ending.
fn tells_of_item(name: &str) -> bool {
    name.split_once('.').is_some_and(|(_, ending)| ending == "json")
}

/// What was read of the files of a shard.
#[derive(Default)]
struct ReadBack {
    rows: Vec<Map<String, Value>>,
    /// Check sums and names of files.
    sums: Vec<(String, String)>,
    told: Vec<Value>,
}

/// A file that a specification names, with its check sum; `None` of one that cannot be read.
fn input(set: &Dataset, name: &str) -> Option<Value> {
    let file = File::open(set.folder.join(name)).map(|f| Hashing::new(BufReader::with_capacity(1 << 20, f)));
    file.and_then(Hashing::finish).ok().map(|(sum, bytes)| json!({ "name": name, "bytes": bytes, "sha256": sum }))
}

fn failed(path: &Path, e: io::Error) -> ShotError {
    ShotError::Read { path: path.display().to_string(), reason: files::in_words(path, e).to_string() }
}

impl Folder {
    /// Whether no data set has been begun in a folder, or there is no such folder.
    pub fn is_new(path: &Path) -> bool {
        !path.join(CARD).exists()
    }

    /// Takes a folder for a data set, which is made if it is not there. Fails where something else lies in it: another data set, or the same by another
    /// version of diopter.
    pub fn open(dataset: Arc<Dataset>, path: &Path) -> Result<Folder, ShotError> {
        let inputs = dataset.named_files().iter().filter_map(|name| input(&dataset, name)).collect();
        let folder = Folder { shards: dataset.shards(), dataset, path: path.to_owned(), inputs, packed: Mutex::default() };
        let place = path.display().to_string();
        let entry = |found: String, expected: String| Err(ShotError::Entry { place: place.clone(), found, expected });
        let card = path.join(CARD);
        match fs::read_to_string(&card) {
            Ok(text) => {
                let told: Value = serde_json::from_str(&text)
                    .map_err(|e| failed(&card, io::Error::other(format!("no card of a data set: {e}"))))?;
                if told["specification_sha256"] != json!(sha256::of_bytes(folder.dataset.text.as_bytes())) {
                    let name = told["name"].as_str().unwrap_or_default();
                    return entry(
                        format!("the data set of another specification (\"{name}\")"),
                        "an empty folder, or the specification it was begun with: it stands in its card.json".into(),
                    );
                }
                if told["diopter"] != json!(VERSION) {
                    return entry(
                        format!("a data set of diopter {}", told["diopter"]),
                        format!("an empty folder: this is diopter {VERSION}"),
                    );
                }
                if let Some(name) = folder.changed_input(&told) {
                    return entry(
                        format!("items that were made with another \"{name}\" than the one that is there now"),
                        "the file as it was when the data set was begun, or an empty folder".into(),
                    );
                }
            }
            Err(e) if e.kind() == io::ErrorKind::NotFound => {
                fs::create_dir_all(path).map_err(|e| {
                    let reason = format!("the folder cannot be made: {}", files::without_number(&e.to_string()));
                    ShotError::Read { path: path.display().to_string(), reason }
                })?;
                let mut names = fs::read_dir(path).map_err(|e| failed(path, e))?.filter_map(|e| e.ok()).map(|e| e.file_name());
                match names.find(|n| n != PARTS) {
                    None => {}
                    // Another process has begun meanwhile.
                    Some(name) if name == CARD => return Folder::open(folder.dataset, path),
                    Some(name) => return entry(format!("\"{}\" and no card.json", name.display()), "an empty folder".into()),
                }
                folder.write_file(CARD, folder.card(None).as_bytes())?;
            }
            Err(e) => return Err(failed(&card, e)),
        }
        Ok(folder)
    }

    /// A file that the specification names and that is not what a card tells.
    fn changed_input(&self, card: &Value) -> Option<String> {
        let begun_with = card["inputs"].as_array()?;
        let of = |name: &Value| begun_with.iter().find(|input| input["name"] == *name);
        let changed = self.inputs.iter().find(|input| of(&input["name"]).is_some_and(|then| then != *input))?;
        changed["name"].as_str().map(str::to_owned)
    }

    /// Check sums of a finished data set, by file; empty before the end.
    fn known_sums(&self) -> HashMap<String, String> {
        let text = fs::read_to_string(self.path.join(SUMS)).unwrap_or_default();
        text.lines().filter_map(|line| line.split_once("  ")).map(|(sum, name)| (name.to_owned(), sum.to_owned())).collect()
    }

    fn part(&self, item: u64) -> PathBuf {
        self.path.join(PARTS).join(format!("{}.tar", self.dataset.key(item)))
    }

    /// Whether the packed files of an item are there.
    fn is_packed(&self, shard: &Shard, item: u64) -> bool {
        let in_shard = || self.path.join(&shard.name).is_file();
        let in_folder = || self.folder_has(shard, item);
        match self.dataset.layout {
            Layout::Shards => in_shard(),
            Layout::Folders => in_folder(),
            Layout::Both => in_shard() && in_folder(),
        }
    }

    /// Items of a shard that are to be made, those of one scene together.
    fn missing_of(&self, shard: &Shard, items: &Range<u64>) -> Vec<u64> {
        if self.dataset.layout == Layout::Shards && self.path.join(&shard.name).is_file() {
            return Vec::new();
        }
        let is_done = |item: u64| self.part(item).is_file() || self.is_packed(shard, item);
        let mut missing: Vec<u64> = shard.items.iter().copied().filter(|i| items.contains(i) && !is_done(*i)).collect();
        missing.sort_by_cached_key(|item| self.dataset.scene_of(*item));
        missing
    }

    /// Items that are to be made, shard by shard.
    pub fn missing(&self) -> Vec<u64> {
        let all = 0..self.dataset.items;
        self.shards.iter().flat_map(|s| self.missing_of(s, &all)).collect()
    }

    /// Whether nothing is left to do: all items are there, and what is written last.
    pub fn is_whole(&self) -> bool {
        self.missing().is_empty() && [SUMS, CARD].iter().all(|name| self.path.join(name).is_file())
    }

    /// Keeps an item that was made, by this process or another. `archive`: its files as [`Dataset::make_item`] gives them. Fails on a number beyond the last item, and
    /// where the file cannot be written.
    pub fn keep(&self, item: u64, archive: &[u8]) -> Result<(), ShotError> {
        self.dataset.check_item(item)?;
        self.write_as(&self.part(item), |to| to.write_all(archive))
    }

    /// Makes the items of a range that are missing, without packing them. Stops with [`ExposeError::Cancelled`]; what is done stays. Fails where an item cannot be made
    /// or written.
    pub fn make_items(&self, items: Range<u64>, watch: &ProgressReporter, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        self.work(items, false, watch, warn)
    }

    /// Makes all that is missing, and finishes. Fails as [`Folder::make_items`] and [`Folder::finish`].
    pub fn make(&self, watch: &ProgressReporter, warn: &mut dyn FnMut(&str)) -> Result<Made, ShotError> {
        self.work(0..self.dataset.items, true, watch, warn)?;
        self.finish()
    }

    fn work(&self, items: Range<u64>, pack: bool, watch: &ProgressReporter, warn: &mut dyn FnMut(&str)) -> Result<(), ShotError> {
        let mut scenes = SceneCache::new();
        let (mut done, total) = (0.0, (items.end.saturating_sub(items.start)).max(1) as f64);
        for shard in &self.shards {
            let of_range = shard.items.iter().filter(|i| items.contains(i)).count() as f64;
            let missing = self.missing_of(shard, &items);
            done += of_range - missing.len() as f64;
            for item in missing {
                if watch.cancel.load(std::sync::atomic::Ordering::Relaxed) {
                    return Err(ExposeError::Cancelled.into());
                }
                let begun = done;
                let within =
                    ProgressReporter { cancel: watch.cancel, progress: &|part: f64| (watch.progress)((begun + part) / total) };
                let archive = self.dataset.make_item(item, &mut scenes, &within, warn)?;
                self.keep(item, &archive)?;
                done += 1.0;
                (watch.progress)(done / total);
            }
            if pack {
                self.pack(shard)?;
            }
        }
        Ok(())
    }

    /// Packs the items of a shard, if that is not done yet, by this process or meanwhile by another. Fails where one is missing or cut off (it is then
    /// removed, to be made again).
    fn pack(&self, shard: &Shard) -> Result<(), ShotError> {
        self.pack_now(shard).or_else(|e| match shard.items.iter().all(|i| self.is_packed(shard, *i)) {
            true => Ok(()),
            false => Err(e),
        })
    }

    fn pack_now(&self, shard: &Shard) -> Result<(), ShotError> {
        if shard.items.iter().all(|i| self.is_packed(shard, *i)) {
            return shard.items.iter().try_for_each(|i| self.remove(&self.part(*i)));
        }
        let target = self.path.join(&shard.name);
        let shards = self.dataset.layout != Layout::Folders;
        // Folders first: the shard then says that all is there.
        if self.dataset.layout != Layout::Shards {
            for item in shard.items.iter().filter(|i| !self.folder_has(shard, **i)) {
                let archive = self.read_part(*item)?;
                let (mut files, mut last) = (Vec::new(), None);
                self.each_file(*item, &archive, |name, bytes| match tells_of_item(name) {
                    true => last = Some((name.to_owned(), bytes.to_vec())),
                    false => files.push((name.to_owned(), bytes.to_vec())),
                })?;
                self.packed.lock().unwrap_or_else(|e| e.into_inner()).insert(format!("{}/{item}", shard.split));
                for (name, bytes) in files.into_iter().chain(last) {
                    self.write_as(&self.path.join(&shard.split).join(name), |to| to.write_all(&bytes))?;
                }
            }
        }
        if shards && !target.is_file() {
            // All are looked at before the first byte is written.
            for item in &shard.items {
                let archive = self.read_part(*item)?;
                self.each_file(*item, &archive, |_, _| ())?;
            }
            self.write_as(&target, |to| {
                for item in &shard.items {
                    to.write_all(tar::entries(&fs::read(self.part(*item))?))?;
                }
                to.write_all(&tar::end())
            })?;
            self.packed.lock().unwrap_or_else(|e| e.into_inner()).insert(shard.name.clone());
        }
        shard.items.iter().try_for_each(|i| self.remove(&self.part(*i)))
    }

    /// Whether all files of an item lie in the folder of its part.
    fn folder_has(&self, shard: &Shard, item: u64) -> bool {
        let (folder, key) = (self.path.join(&shard.split), self.dataset.key(item));
        self.dataset.endings().iter().all(|ending| folder.join(format!("{key}.{ending}")).is_file())
    }

    fn read_part(&self, item: u64) -> Result<Vec<u8>, ShotError> {
        let part = self.part(item);
        fs::read(&part).map_err(|e| match e.kind() {
            io::ErrorKind::NotFound => ShotError::Entry {
                place: self.path.display().to_string(),
                found: format!("item {item} is missing"),
                expected: format!("all items: diopter dataset make makes what is missing ({} items)", self.missing().len()),
            },
            _ => failed(&part, e),
        })
    }

    /// Files of an item; one that is no archive is removed.
    fn each_file(&self, item: u64, archive: &[u8], mut each: impl FnMut(&str, &[u8])) -> Result<(), ShotError> {
        let read = tar::read(archive, |name, bytes| {
            each(name, bytes);
            Ok(())
        });
        read.map_err(|e| {
            let part = self.part(item);
            // Then it is made again; a file that cannot be removed is told the next time.
            let _ = fs::remove_file(&part);
            failed(&part, io::Error::other(format!("{e}; it was removed: diopter dataset make makes it again")))
        })
    }

    fn remove(&self, path: &Path) -> Result<(), ShotError> {
        match fs::remove_file(path) {
            Err(e) if e.kind() != io::ErrorKind::NotFound => Err(failed(path, e)),
            _ => Ok(()),
        }
    }

    /// Packs what is not packed, and writes the table, the check sums and the card. Fails where items are missing, and on files that are damaged: cut off, or of a finished data set with
    /// other bytes than its check sums tell (what this process packed anew counts as it is).
    pub fn finish(&self) -> Result<Made, ShotError> {
        self.shards.iter().try_for_each(|s| self.pack(s))?;
        let known = self.known_sums();
        let packed = self.packed.lock().unwrap_or_else(|e| e.into_inner()).clone();
        let mut table = parquet::Table::default();
        let mut sums = Vec::new();
        let mut told = Vec::new();
        let metadata = self.path.join("metadata.jsonl");
        // What is wrong with what was packed, told of itself.
        let mut fault = None;
        let written = self.write_as(&metadata, |to| {
            for shard in &self.shards {
                let read = self.read_back(shard, &known, &packed).map_err(|e| {
                    let reason = io::Error::other(e.to_string());
                    fault = Some(e);
                    reason
                })?;
                sums.extend(read.sums);
                told.extend(read.told);
                for row in read.rows {
                    serde_json::to_writer(&mut *to, &row)?;
                    to.write_all(b"\n")?;
                    table.add(row);
                }
            }
            Ok(())
        });
        if let Some(fault) = fault {
            return Err(fault);
        }
        written?;
        let parquet = table.write();
        self.write_file("metadata.parquet", &parquet)?;
        let sums: String = sums.iter().map(|(sum, name)| format!("{sum}  {name}\n")).collect();
        self.write_file(SUMS, sums.as_bytes())?;
        self.write_file("card.md", self.page().as_bytes())?;
        self.write_file(CARD, self.card(Some(told)).as_bytes())?;
        let parts = self.path.join(PARTS);
        // Only an empty folder goes: another process may still be writing there.
        match fs::remove_dir(&parts) {
            Err(e) if !matches!(e.kind(), io::ErrorKind::NotFound | io::ErrorKind::DirectoryNotEmpty) => {
                return Err(failed(&parts, e));
            }
            _ => {}
        }
        let mut files: Vec<String> = match self.dataset.layout {
            Layout::Folders => Vec::new(),
            _ => self.shards.iter().map(|s| s.name.clone()).collect(),
        };
        if self.dataset.layout != Layout::Shards {
            let mut splits: Vec<String> = self.shards.iter().map(|s| s.split.clone()).collect();
            splits.dedup();
            files.extend(splits);
        }
        files.extend(["metadata.jsonl", "metadata.parquet", SUMS, "card.md", CARD].map(str::to_owned));
        Ok(Made { files, items: self.dataset.items })
    }

    /// What lies in the folder of a shard: rows of the table, check sums and what the card tells of it. `known`: check sums of before; `packed`: what need not agree
    /// with them. Fails on files that cannot be read, that are cut off or not what they were.
    fn read_back(&self, shard: &Shard, known: &HashMap<String, String>, packed: &HashSet<String>) -> Result<ReadBack, ShotError> {
        let damaged = |name: &str, how: String| ShotError::Entry {
            place: self.path.join(name).display().to_string(),
            found: how,
            expected: "the file as it was made: without it the same command makes its items again".into(),
        };
        let same = |name: &str, sum: &str, is_new: bool| match known.get(name).filter(|then| !is_new && *then != sum) {
            Some(_) => Err(damaged(name, format!("other bytes than {SUMS} tells"))),
            None => Ok(()),
        };
        let mut read = ReadBack::default();
        let rows = &mut read.rows;
        // Without archives, the folder that holds the item.
        let shard_name = if self.dataset.layout == Layout::Folders { &shard.split } else { &shard.name };
        let mut row = |bytes: &[u8]| -> io::Result<()> {
            let value: Value = serde_json::from_slice(bytes)?;
            rows.push(flat(&value, &shard.split, shard_name));
            Ok(())
        };
        if self.dataset.layout != Layout::Folders {
            let archive = self.path.join(&shard.name);
            let file = BufReader::with_capacity(1 << 20, File::open(&archive).map_err(|e| failed(&archive, e))?);
            let mut hashing = Hashing::new(file);
            let each = |name: &str, bytes: &[u8]| {
                if tells_of_item(name) { row(bytes) } else { Ok(()) }
            };
            tar::read(&mut hashing, each).map_err(|e| damaged(&shard.name, e.to_string()))?;
            let (sum, bytes) = hashing.finish().map_err(|e| failed(&archive, e))?;
            same(&shard.name, &sum, packed.contains(&shard.name))?;
            read.told.push(json!({ "name": shard.name, "items": shard.items.len(), "bytes": bytes, "sha256": sum }));
            read.sums.push((sum, shard.name.clone()));
        }
        if self.dataset.layout != Layout::Shards {
            for item in &shard.items {
                let is_new = packed.contains(&format!("{}/{item}", shard.split));
                for ending in self.dataset.endings() {
                    let name = format!("{}/{}.{ending}", shard.split, self.dataset.key(*item));
                    let path = self.path.join(&name);
                    let bytes = fs::read(&path).map_err(|e| failed(&path, e))?;
                    let sum = sha256::of_bytes(&bytes);
                    same(&name, &sum, is_new)?;
                    if ending == "json" && self.dataset.layout == Layout::Folders {
                        row(&bytes).map_err(|e| damaged(&name, e.to_string()))?;
                    }
                    read.sums.push((sum, name));
                }
            }
        }
        Ok(read)
    }

    /// The card for programs; before the end without what was made.
    fn card(&self, shards: Option<Vec<Value>>) -> String {
        let set = &self.dataset;
        let mut splits = Map::new();
        for shard in &self.shards {
            let items = splits.get(&shard.split).and_then(Value::as_u64).unwrap_or(0) + shard.items.len() as u64;
            splits.insert(shard.split.clone(), json!(items));
        }
        let card = json!({
            "name": set.name(),
            "description": set.file.description,
            "diopter": VERSION,
            "seed": set.file.seed,
            "items": set.items,
            "splits": splits,
            "files": set.endings(),
            "complete": shards.is_some(),
            "shards": shards,
            "inputs": self.inputs,
            "specification": set.text,
            "specification_sha256": sha256::of_bytes(set.text.as_bytes()),
        });
        format!("{card:#}\n")
    }

    /// The card for people: Markdown, with the head that Hugging Face's hub reads.
    fn page(&self) -> String {
        let set = &self.dataset;
        let mut splits: Vec<(&str, usize)> = Vec::new();
        for shard in &self.shards {
            match splits.last_mut().filter(|s| s.0 == shard.split) {
                Some((_, items)) => *items += shard.items.len(),
                None => splits.push((&shard.split, shard.items.len())),
            }
        }
        let quoted = |text: &str| json!(text).to_string();
        let mut page = format!("---\npretty_name: {}\n", quoted(set.name()));
        if set.layout != Layout::Folders {
            page.push_str("configs:\n- config_name: default\n  data_files:\n");
            for (name, _) in &splits {
                page.push_str(&format!("  - split: {}\n    path: {}\n", quoted(name), quoted(&format!("{name}-??????.tar"))));
            }
        }
        page.push_str(&format!("---\n\n# {}\n\n", set.name()));
        if let Some(text) = &set.file.description {
            page.push_str(&format!("{}\n\n", text.trim_end()));
        }
        page.push_str(&format!("{} items, made by diopter {VERSION} with the seed {}.\n\n", set.items, set.file.seed));
        page.push_str("| part | items |\n|---|---|\n");
        splits.iter().for_each(|(name, items)| page.push_str(&format!("| {name} | {items} |\n")));
        page.push_str("\n| file of an item | what it holds |\n|---|---|\n");
        for ending in set.endings() {
            page.push_str(&format!("| `{ending}` | {} |\n", super::item::about(&ending)));
        }
        page.push_str(
            "\nParameters of all items: `metadata.parquet`, `metadata.jsonl`. Check sums: `sha256sum -c SHA256SUMS`.\n\n",
        );
        page.push_str(&format!(
            "## Specification\n\nThe same specification makes the same bytes:\n\n````toml\n{}\n````\n",
            set.text.trim_end()
        ));
        page
    }

    fn write_file(&self, name: &str, bytes: &[u8]) -> Result<(), ShotError> {
        self.write_as(&self.path.join(name), |to| to.write_all(bytes))
    }

    /// Writes a file beside, under a name of its own, and renames it.
    fn write_as(&self, path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> Result<(), ShotError> {
        let parts = self.path.join(PARTS);
        // No two processes, also on two machines, have one name.
        let random = std::collections::hash_map::RandomState::new().build_hasher().finish();
        let beside = parts.join(format!(".{random:016x}.part"));
        let done = || -> io::Result<()> {
            fs::create_dir_all(&parts)?;
            if let Some(folder) = path.parent() {
                fs::create_dir_all(folder)?;
            }
            let mut to = BufWriter::new(OpenOptions::new().write(true).create_new(true).open(&beside)?);
            write(&mut to)?;
            to.flush()?;
            drop(to);
            fs::rename(&beside, path)
        };
        done().map_err(|e| {
            // What cannot be removed is removed with the folder of the parts.
            let _ = fs::remove_file(&beside);
            failed(path, e)
        })
    }
}

/// A row of the table: what is known of an item, without lists of lists and what is nested deeper.
fn flat(told: &Value, split: &str, shard: &str) -> Map<String, Value> {
    let mut row = Map::new();
    for name in ["key", "item", "seed"] {
        row.insert(name.into(), told[name].clone());
    }
    row.insert("split".into(), json!(split));
    row.insert("shard".into(), json!(shard));
    for (name, at) in [("width", 0), ("height", 1)] {
        row.insert(name.into(), told["size"][at].clone());
    }
    for (prefix, section) in [("parameters.", "parameters"), ("facts.", "facts")] {
        for (name, value) in told[section].as_object().into_iter().flatten() {
            let plain = match value {
                Value::Object(_) => continue,
                // Places: `[x, y, z]`.
                Value::Array(list) => {
                    for (k, v) in list.iter().enumerate().filter(|(_, v)| !v.is_array() && !v.is_object()) {
                        row.insert(format!("{prefix}{name}.{k}"), v.clone());
                    }
                    continue;
                }
                plain => plain.clone(),
            };
            row.insert(format!("{prefix}{name}"), plain);
        }
    }
    row
}

impl Dataset {
    /// What stands behind the numbers of items, in order.
    pub fn endings(&self) -> Vec<String> {
        let mut all: Vec<String> = self.files.iter().map(|f| f.name()).chain(["json".into()]).collect();
        all.sort();
        all
    }

    /// What differs in an item, as JSON: `key`, `item`, `split` and `parameters` (null where a condition does not hold). Fails on a number beyond the last item.
    pub fn parameters_json(&self, item: u64) -> Result<Value, ShotError> {
        let names = self.vary.iter().flat_map(|v| v.settings()).map(|name| (name, Value::Null));
        let settings = self.parameters(item)?;
        let told = |name: &String, value| self.kinds.get(name).copied().unwrap_or(Kind::Number).json(value);
        let parameters: Map<_, _> = names.chain(settings.iter().map(|(name, value)| (name.clone(), told(name, value)))).collect();
        Ok(json!({ "key": self.key(item), "item": item, "split": self.split(item), "parameters": parameters }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;
    use std::sync::atomic::AtomicBool;

    const SPEC: &str = "name = \"six\"\nseed = 2\nitems = 6\n[shot]\nscene.file = \"cornell\"\nexposure.shutter = \"1/30\"\n\
        render = { size = \"12x8\", spp = 1 }\n[[vary]]\nname = \"iso\"\nrange = [100, 6400]\nscale = \"log\"\nstep = 1\n\
        [write]\nfiles = [\"raw.npy\", \"depth.npy\"]\nshard_items = 2\n[split]\nfractions = { train = 0.6, test = 0.4 }\n";

    fn set(text: &str) -> Arc<Dataset> {
        Arc::new(Dataset::new(text, "spec.toml", Path::new("")).unwrap())
    }

    /// All files of a folder by their names.
    fn files_of(folder: &Path) -> BTreeMap<String, Vec<u8>> {
        let mut all = BTreeMap::new();
        for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
            let name = entry.file_name().into_string().unwrap();
            if entry.file_type().unwrap().is_dir() {
                all.extend(files_of(&entry.path()).into_iter().map(|(n, b)| (format!("{name}/{n}"), b)));
            } else {
                all.insert(name, fs::read(entry.path()).unwrap());
            }
        }
        all
    }

    fn make(folder: &Folder) -> Result<Made, ShotError> {
        folder.make(&ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () }, &mut |_| ())
    }

    #[test]
    fn a_data_set_goes_on_where_it_was_stopped_and_has_the_same_bytes() {
        let room = tempfile::tempdir().unwrap();
        let at = |name: &str| room.path().join(name);
        let whole = Folder::open(set(SPEC), &at("a")).unwrap();
        assert_eq!(whole.missing().len(), 6);
        let made = make(&whole).unwrap();
        assert!(made.files.contains(&"metadata.parquet".to_owned()) && whole.missing().is_empty());
        let expected = files_of(&at("a"));
        assert!(!expected.keys().any(|n| n.starts_with(PARTS)));
        // Stopped in the middle, then made in another order by two who share the folder; one part is lost, one is cut off.
        let cancel = AtomicBool::new(false);
        let stop = |done: f64| {
            if done >= 0.5 {
                cancel.store(true, std::sync::atomic::Ordering::Relaxed)
            }
        };
        let first = Folder::open(set(SPEC), &at("b")).unwrap();
        let e = first.make(&ProgressReporter { cancel: &cancel, progress: &stop }, &mut |_| ()).unwrap_err();
        assert!(matches!(e, ShotError::Expose(ExposeError::Cancelled)), "{e}");
        let left = first.missing();
        assert!(!left.is_empty() && left.len() < 6, "{left:?}");
        let second = Folder::open(set(SPEC), &at("b")).unwrap();
        for item in left.iter().rev() {
            let watch = ProgressReporter { cancel: &AtomicBool::new(false), progress: &|_| () };
            second.make_items(*item..item + 1, &watch, &mut |_| ()).unwrap();
        }
        assert!(first.missing().is_empty());
        fs::remove_file(first.part(left[0])).unwrap();
        assert!(second.finish().unwrap_err().to_string().contains(&format!("item {} is missing", left[0])));
        if let Some(other) = left.get(1) {
            let part = first.part(*other);
            let bytes = fs::read(&part).unwrap();
            fs::write(&part, &bytes[..bytes.len() / 2]).unwrap();
            assert!(make(&second).unwrap_err().to_string().contains("it was removed"));
        }
        make(&second).unwrap();
        assert!(files_of(&at("b")) == expected, "{:?}", files_of(&at("b")).keys());
        // Done twice is done once.
        make(&second).unwrap();
        assert!(files_of(&at("b")) == expected);
    }

    #[test]
    fn shards_table_card_and_check_sums_tell_of_all_items() {
        let room = tempfile::tempdir().unwrap();
        let folder = room.path().join("both");
        let text = SPEC.replace("shard_items", "layout = \"both\"\nshard_items");
        make(&Folder::open(set(&text), &folder).unwrap()).unwrap();
        let all = files_of(&folder);
        let mut inside = BTreeMap::new();
        for (name, bytes) in all.iter().filter(|f| f.0.ends_with(".tar")) {
            let split = name.split('-').next().unwrap();
            tar::read(&bytes[..], |n, b| {
                inside.insert(format!("{split}/{n}"), b.to_vec());
                Ok(())
            })
            .unwrap();
        }
        let beside: BTreeMap<_, _> = all.iter().filter(|f| f.0.contains('/')).map(|(n, b)| (n.clone(), b.clone())).collect();
        assert!(inside == beside && inside.len() == 18, "{:?}", inside.keys());
        for line in String::from_utf8(all["SHA256SUMS"].clone()).unwrap().lines() {
            let (sum, name) = line.split_once("  ").unwrap();
            assert_eq!(sha256::of_bytes(&all[name]), sum, "{name}");
        }
        let card: Value = serde_json::from_slice(&all[CARD]).unwrap();
        assert_eq!((&card["complete"], &card["specification"], &card["items"]), (&json!(true), &json!(text), &json!(6)));
        let rows: Vec<Value> =
            String::from_utf8(all["metadata.jsonl"].clone()).unwrap().lines().map(|l| serde_json::from_str(l).unwrap()).collect();
        assert_eq!(rows.len(), 6);
        assert!(rows.iter().all(|r| r["parameters.iso"].as_f64() == r["facts.iso"].as_f64() && r["facts.f_number"].is_number()));
        assert!(String::from_utf8(all["card.md"].clone()).unwrap().contains("path: \"train-??????.tar\""));
        assert!(all["metadata.parquet"].starts_with(b"PAR1"));
    }

    #[test]
    fn what_is_damaged_or_was_made_with_other_files_is_told() {
        let room = tempfile::tempdir().unwrap();
        let at = |name: &str| room.path().join(name);
        let text = SPEC.replace("shard_items", "layout = \"both\"\nshard_items");
        fs::write(at("classes.txt"), "*, thing\n").unwrap();
        let text = text.replace("scene.file = \"cornell\"", "scene = { file = \"cornell\", classes = \"classes.txt\" }");
        let set = || Arc::new(Dataset::new(&text, "spec.toml", room.path()).unwrap());
        let open = || Folder::open(set(), &at("set"));
        make(&open().unwrap()).unwrap();
        let whole = files_of(&at("set"));
        let told = || make(&open().unwrap()).unwrap_err().to_string();
        for (name, bytes) in whole.iter().filter(|f| f.0.starts_with("train-000000") || f.0.ends_with("raw.npy")).take(2) {
            let mut other = bytes.clone();
            let last = other.len() - 1;
            other[last / 2] ^= 1;
            for (damaged, how) in [(&other[..], "other bytes than SHA256SUMS"), (&bytes[..last / 2], "")] {
                fs::write(at("set").join(name), damaged).unwrap();
                let told = told();
                assert!(told.contains(name.as_str()) && told.contains(how), "{name}: {told}");
                assert!(fs::read(at("set").join("SHA256SUMS")).unwrap() == whole["SHA256SUMS"]);
            }
            // Without the file its items are made again.
            fs::remove_file(at("set").join(name)).unwrap();
            make(&open().unwrap()).unwrap();
            assert!(files_of(&at("set")) == whole, "{name}");
        }
        fs::write(at("classes.txt"), "*, other\n").unwrap();
        let told = open().unwrap_err().to_string();
        assert!(told.contains("\"classes.txt\"") && told.contains("an empty folder"), "{told}");
    }

    #[test]
    fn folders_of_something_else_are_refused() {
        let room = tempfile::tempdir().unwrap();
        let folder = room.path().join("taken");
        Folder::open(set(SPEC), &folder).unwrap();
        let told = Folder::open(set(&SPEC.replace("seed = 2", "seed = 3")), &folder).unwrap_err().to_string();
        assert!(told.contains("another specification (\"six\"); expected an empty folder"), "{told}");
        let other = room.path().join("other");
        fs::create_dir_all(&other).unwrap();
        fs::write(other.join("thesis.txt"), "mine").unwrap();
        assert!(Folder::open(set(SPEC), &other).unwrap_err().to_string().contains("thesis.txt"));
    }
}
