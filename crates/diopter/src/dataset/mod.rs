//! Data sets: many shots that differ as a specification says, with what is true of each, as shards that training reads.
//!
//! [`Dataset`] is a checked specification ([`SpecFile`]). An item is a pure function of it and of a number ([`Dataset::make_item`]): who makes it, in which
//! order and with how many threads changes no bit. [`Folder`] is where items are gathered, and goes on where it was stopped; [`job`] describes the
//! work for render farms. Whoever schedules (a command, Ray, Dask, OpenJD) moves numbers of items to workers and archives back.

mod check;
mod draw;
mod folder;
pub(crate) mod item;
pub mod job;
mod kind;
mod parquet;
mod pose;
mod rule;
mod sha256;
mod spec;
mod tar;

pub use draw::Draw;
pub use folder::{Folder, Made, Shard};
pub use spec::{PoseSection, SpecFile, SplitSection, VarySection, WriteSection};

use crate::files;
use crate::quantity::Seconds;
use crate::sheet::text_of;
use crate::shot::{Sequence, ShotError, ShotFile, is_of_scene};
use diopter_light::names::{in_words, nearest};
use item::File;
use kind::Kind;
use rule::Vary;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A setting of an item and its value.
pub type Setting = (String, toml::Value);

/// Most items of a data set: they are counted in memory.
pub const MOST_ITEMS: u64 = 100_000_000;
/// Items of a shard by default.
const SHARD_ITEMS: u64 = 1000;
/// What the files of a data set without parts are called.
const WHOLE: &str = "data";
/// Seeds of items are whole numbers that JSON and spreadsheets keep.
const SEED_BITS: u32 = 48;

/// A checked specification.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// As it was written.
    text: String,
    /// What it is called in errors.
    place: String,
    /// What its paths are relative to.
    folder: PathBuf,
    file: SpecFile,
    vary: Vec<Vary>,
    items: u64,
    files: Vec<File>,
    layout: Layout,
    shard_items: u64,
    /// Names of the parts and how far each goes, from 0 to 1.
    splits: Vec<(String, f64)>,
    /// How the values of each setting are told.
    kinds: BTreeMap<String, Kind>,
}

/// How the files of items lie in a folder.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Layout {
    /// Tar archives of many items.
    Shards,
    /// One folder for each part.
    Folders,
    /// Both.
    Both,
}

impl Layout {
    const NAMES: [(&str, Layout); 3] = [("shards", Layout::Shards), ("folders", Layout::Folders), ("both", Layout::Both)];
}

/// A specification that is written in JSON, as TOML. Fails on what is no JSON object, and on `null`, which TOML does not have.
pub fn specification(json: &str) -> Result<String, ShotError> {
    let wrong = |found: String| ShotError::Entry {
        place: "specification".into(),
        found,
        expected: "tables, lists, text, numbers and truth values, as in a .toml".into(),
    };
    let table: toml::Table = serde_json::from_str(json).map_err(|e| wrong(e.to_string()))?;
    toml::to_string(&table).map_err(|e| wrong(e.to_string()))
}

impl Dataset {
    /// Reads a specification; paths in it are relative to it. Fails where the file cannot be read, and as [`Dataset::new`].
    pub fn read(path: &Path) -> Result<Dataset, ShotError> {
        let place = path.display().to_string();
        let text = files::read_text(path).map_err(|e| ShotError::Read { path: place.clone(), reason: e.to_string() })?;
        Dataset::new(&text, &place, path.parent().unwrap_or(Path::new("")))
    }

    /// Checks a specification. `place`: what it is called in errors; `folder`: what its paths are relative to. Every value that is listed is tried;
    /// scenes, lenses and bodies are read when items are made, or by [`Dataset::check_items`]. Fails on keys, names and values that are not known or out of range, and without a number of items.
    pub fn new(text: &str, place: &str, folder: &Path) -> Result<Dataset, ShotError> {
        let file: SpecFile =
            toml::from_str(text).map_err(|e| ShotError::Syntax { path: place.to_owned(), reason: in_words(&e.to_string()) })?;
        let entry =
            |at: &str, found: String, expected: String| ShotError::Entry { place: format!("{place}: {at}"), found, expected };
        check_shot(&file.shot).map_err(|(at, found, expected)| entry(at, found, expected))?;
        let (mut vary, mut names, mut combinations) = (Vec::new(), Vec::new(), 1);
        for (k, section) in file.vary.iter().enumerate() {
            let rule = Vary::new(section, place, k + 1, &names, &mut combinations)?;
            names.extend(rule.settings());
            vary.push(rule);
        }
        for rule in &vary {
            for settings in rule.samples() {
                settings.iter().try_fold(file.shot.clone(), |shot, (name, value)| with(&shot, name, value, &rule.place))?;
            }
        }
        let grids = file.vary.iter().any(|v| v.grid.is_some());
        let items = file.items.or(grids.then_some(combinations));
        let items = items.ok_or_else(|| {
            entry("items", "no number".into(), "items = 1000, or a grid, whose combinations are counted".into())
        })?;
        if !(1..=MOST_ITEMS).contains(&items) {
            return Err(entry("items", items.to_string(), format!("1 to {MOST_ITEMS}")));
        }
        let asked = file.write.files.clone().unwrap_or_else(|| vec!["dng".into()]);
        let mut files = Vec::new();
        for name in &asked {
            let found = File::named(name).ok_or_else(|| {
                let known = File::names();
                let hint = nearest(name, known.iter().map(String::as_str))
                    .map_or(String::new(), |n| format!(" (did you mean \"{n}\"?)"));
                entry("[write] files", format!("\"{name}\""), format!("one of {}{hint}", known.join(", ")))
            })?;
            if files.contains(&found) {
                return Err(entry("[write] files", format!("\"{name}\" twice"), "each once".into()));
            }
            files.push(found);
        }
        let layout = match file.write.layout.as_deref() {
            None => Layout::Shards,
            Some(name) => Layout::NAMES
                .iter()
                .find(|l| l.0 == name)
                .map(|l| l.1)
                .ok_or_else(|| entry("[write] layout", format!("\"{name}\""), "shards, folders or both".into()))?,
        };
        let shard_items = file.write.shard_items.unwrap_or(SHARD_ITEMS);
        if shard_items == 0 {
            return Err(entry("[write] shard_items", "0".into(), "1 or more".into()));
        }
        let mut splits = Vec::new();
        if let Some(split) = &file.split {
            let mut sum = 0.0;
            for (name, fraction) in &split.fractions {
                let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
                if name.is_empty() || name.len() > 40 || !name.chars().all(plain) || name == folder::PARTS {
                    let expected = "a name of letters, digits, - and _, such as train".into();
                    return Err(entry("[split] fractions", format!("\"{name}\""), expected));
                }
                if !(*fraction > 0.0 && *fraction <= 1.0) {
                    return Err(entry(
                        "[split] fractions",
                        format!("{name} = {fraction}"),
                        "a fraction above 0, at most 1".into(),
                    ));
                }
                sum += fraction;
                splits.push((name.clone(), sum));
            }
            if (sum - 1.0).abs() > 1e-6 {
                let expected = "fractions that add up to 1, such as { train = 0.9, test = 0.1 }".into();
                return Err(entry("[split] fractions", format!("a sum of {sum}"), expected));
            }
            if let Some(by) = split.by.as_ref().filter(|by| !names.contains(by)) {
                let hint =
                    nearest(by, names.iter().map(String::as_str)).map_or(String::new(), |n| format!(" (did you mean \"{n}\"?)"));
                return Err(entry("[split] by", format!("\"{by}\""), format!("the name of a setting that is varied{hint}")));
            }
        }
        let kinds = kind::of_settings(&vary);
        let (text, place, folder) = (text.to_owned(), place.to_owned(), folder.to_owned());
        Ok(Dataset { kinds, text, place, folder, file, vary, items, files, layout, shard_items, splits })
    }

    /// What was written.
    pub fn file(&self) -> &SpecFile {
        &self.file
    }

    /// What was written, as text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// What its paths are relative to.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Its name; that of nobody is "dataset".
    pub fn name(&self) -> &str {
        self.file.name.as_deref().unwrap_or("dataset")
    }

    /// How many items it has.
    pub fn items(&self) -> u64 {
        self.items
    }

    /// How items lie in a folder.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// Name of an item: its number with as many digits as the last one has, six at least.
    pub fn key(&self, item: u64) -> String {
        let digits = (self.items - 1).to_string().len().max(6);
        format!("{item:0digits$}")
    }

    fn draws(&self, item: u64) -> Draw {
        Draw { seed: self.file.seed, item }
    }

    fn check_item(&self, item: u64) -> Result<(), ShotError> {
        match item < self.items {
            true => Ok(()),
            false => Err(ShotError::Entry {
                place: self.place.clone(),
                found: format!("item {item}"),
                expected: format!("0 to {}: the data set has {} items", self.items - 1, self.items),
            }),
        }
    }

    /// What differs in an item, in the order of the specification. Fails for numbers beyond the last item.
    pub fn parameters(&self, item: u64) -> Result<Vec<Setting>, ShotError> {
        self.check_item(item)?;
        Ok(self.settings(item))
    }

    fn settings(&self, item: u64) -> Vec<Setting> {
        let draw = self.draws(item);
        let mut all = Vec::new();
        for vary in &self.vary {
            if let Some(settings) = vary.draw(&draw, &all) {
                all.extend(settings);
            }
        }
        all
    }

    /// What tells the scenes of items apart.
    fn scene_of(&self, item: u64) -> String {
        let of_scene = self.settings(item).into_iter().filter(|(name, _)| is_of_scene(name));
        of_scene.map(|(name, value)| format!("{name} = {value}\n")).collect()
    }

    /// The shot of an item, with paths as they are written.
    fn relative_shot(&self, item: u64) -> Result<ShotFile, ShotError> {
        let mut shot = self.file.shot.clone();
        let settings = self.parameters(item)?;
        for (name, value) in &settings {
            shot = with(&shot, name, value, &format!("{}: item {item}", self.place))?;
        }
        if settings.iter().any(|s| matches!(s.0.as_str(), "look-from" | "camera.look_from")) {
            // What stood there would say it, too.
            (shot.camera.viewpoint, shot.camera.path) = (None, Vec::new());
        }
        say_one_frame(&mut shot);
        if !settings.iter().any(|s| matches!(s.0.as_str(), "seed" | "render.seed")) {
            shot.render.seed = Some(self.draws(item).bits("render.seed", 0) >> (64 - SEED_BITS));
        }
        shot.render.truth_channels = item::truth_channels(shot.render.truth_channels.as_deref(), &self.files);
        Ok(shot)
    }

    /// The shot of an item; its paths hold wherever the program runs, if the folder of the specification is absolute. Fails on values that the draws of the item make and the shot file does not take.
    pub fn shot(&self, item: u64) -> Result<ShotFile, ShotError> {
        let mut shot = self.relative_shot(item)?;
        shot.place_paths(&self.folder);
        Ok(shot)
    }

    /// Name of the split (train, validation, ...) that an item belongs to; `None` where the specification has none.
    pub fn split(&self, item: u64) -> Option<&str> {
        let (last, _) = self.splits.last()?;
        let draw = self.draws(item);
        let by = self.file.split.as_ref().and_then(|s| s.by.as_ref());
        let u = match by.and_then(|by| self.settings(item).into_iter().rev().find(|s| s.0 == *by)) {
            // The same for all items that have this value.
            Some((name, value)) => Draw { item: 0, ..draw }.uniform(&format!("split {name} = {}", text_of(&value)), 0),
            None => draw.uniform("split", 0),
        };
        Some(self.splits.iter().find(|s| u < s.1).map_or(last, |s| &s.0))
    }

    /// All shards, with their items in order.
    pub fn shards(&self) -> Vec<Shard> {
        let mut shards: Vec<Shard> = Vec::new();
        let names: Vec<Option<&str>> = match self.splits.is_empty() {
            true => vec![None],
            false => self.splits.iter().map(|s| Some(s.0.as_str())).collect(),
        };
        let mut of: Vec<Vec<u64>> = vec![Vec::new(); names.len()];
        for item in 0..self.items {
            let split = self.split(item);
            let at = names.iter().position(|n| *n == split).expect("a split is one of those there are");
            of[at].push(item);
        }
        for (name, items) in names.iter().zip(of) {
            let chunks = items.chunks(usize::try_from(self.shard_items).unwrap_or(usize::MAX));
            for (k, items) in chunks.enumerate() {
                let stem = name.unwrap_or(WHOLE);
                shards.push(Shard { split: stem.to_owned(), name: format!("{stem}-{k:06}.tar"), items: items.to_vec() });
            }
        }
        shards
    }

    /// Files beside the specification that it names: scenes, surroundings, lenses ... What they refer to themselves (pictures of surfaces) is not among
    /// them. With their names as written.
    pub fn named_files(&self) -> Vec<String> {
        fn texts(value: &toml::Value, to: &mut Vec<String>) {
            match value {
                toml::Value::String(text) => to.push(text.clone()),
                toml::Value::Array(list) => list.iter().for_each(|v| texts(v, to)),
                toml::Value::Table(table) => table.values().for_each(|v| texts(v, to)),
                _ => {}
            }
        }
        let mut all = Vec::new();
        if let Ok(table) = self.text.parse::<toml::Table>() {
            texts(&toml::Value::Table(table), &mut all);
        }
        all.retain(|name| !name.is_empty() && self.folder.join(name).is_file());
        all.sort();
        all.dedup();
        all
    }
}

/// A shot with a setting changed; errors are said of `place`.
fn with(shot: &ShotFile, name: &str, value: &toml::Value, place: &str) -> Result<ShotFile, ShotError> {
    if matches!(name, "time-limit" | "render.time_limit") {
        return Err(ShotError::Entry { place: place.to_owned(), found: name.to_owned(), expected: NO_TIME_LIMIT.to_owned() });
    }
    shot.with(name, &text_of(value)).map_err(|e| {
        let parts = e.parts();
        match (parts.found, parts.expected) {
            (Some(found), Some(expected)) => {
                let what = parts.place.unwrap_or_default();
                ShotError::Entry { place: place.to_owned(), found: format!("{what} {found}"), expected }
            }
            _ => ShotError::Entry { place: place.to_owned(), found: e.to_string(), expected: format!("a value of {name}") },
        }
    })
}

const NO_TIME_LIMIT: &str =
    "no limit of time: the same specification would not give the same bytes; spp says how many samples are taken";

/// A rate of frames without their number is that of a film of one frame: it says when the next would be.
fn say_one_frame(shot: &mut ShotFile) {
    if shot.sequence.fps.is_some() && shot.sequence.frames.is_none() {
        shot.sequence.frames = Some(1);
    }
}

/// What a shot of a data set cannot have: place, found, expected.
fn check_shot(shot: &ShotFile) -> Result<(), (&'static str, String, String)> {
    if let Some(limit) = shot.render.time_limit {
        return Err(("[shot.render] time_limit", Seconds(limit.0).to_string(), NO_TIME_LIMIT.into()));
    }
    if let Some(seed) = shot.render.seed {
        let expected = "no seed: each item has its own, which follows from the seed of the data set; or a [[vary]] of it";
        return Err(("[shot.render] seed", seed.to_string(), expected.into()));
    }
    if !shot.output.files.is_empty() {
        let expected = "none: [write] says what is written";
        return Err(("[shot.output] files", format!("{} names", shot.output.files.len()), expected.into()));
    }
    let mut single = shot.clone();
    say_one_frame(&mut single);
    let (found, expected) = match Sequence::new(&mut single) {
        Ok(sequence) if sequence.count() == 1 => return Ok(()),
        Ok(_) => ("more than one picture".into(), "single pictures: an item is one; what varies goes into [[vary]]".into()),
        Err(e) => {
            let parts = e.parts();
            let found = [parts.place, parts.found].into_iter().flatten().collect::<Vec<_>>().join(" ");
            (found, parts.expected.unwrap_or_else(|| e.to_string()))
        }
    };
    Err(("[shot.sequence]", found, expected))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dataset(text: &str) -> Result<Dataset, ShotError> {
        Dataset::new(text, "spec.toml", Path::new("here"))
    }

    const TWO_GRIDS: &str = "seed = 4\n[[vary]]\nname = \"iso\"\ngrid = [100, 400, 1600]\n[[vary]]\nname = \"aperture\"\ngrid = [\"f/2\", 4]\n\
                             [[vary]]\nname = \"compensation\"\nrange = [\"-1 EV\", \"1 EV\"]\n";

    #[test]
    fn grids_make_all_combinations_the_first_fastest() {
        let set = dataset(TWO_GRIDS).unwrap();
        assert_eq!(set.items(), 6);
        let of = |item| set.parameters(item).unwrap().iter().take(2).map(|s| text_of(&s.1)).collect::<Vec<_>>().join(" ");
        let all: Vec<String> = (0..6).map(of).collect();
        assert_eq!(all, ["100 f/2", "400 f/2", "1600 f/2", "100 4", "400 4", "1600 4"]);
        let shot = set.shot(5).unwrap();
        assert_eq!(
            (shot.exposure.iso.and_then(crate::quantity::IsoChoice::fixed), shot.exposure.aperture.unwrap().0),
            (Some(1600.0), 4.0)
        );
        assert!(shot.exposure.compensation.is_some_and(|c| c.0.abs() <= 1.0));
        assert!(set.parameters(6).unwrap_err().to_string().contains("0 to 5"));
    }

    #[test]
    fn items_depend_on_nothing_but_their_numbers() {
        let set = dataset(TWO_GRIDS).unwrap();
        let forward: Vec<_> = (0..6).map(|i| set.shot(i).unwrap()).collect();
        let mut backward: Vec<_> = (0..6).rev().map(|i| set.shot(i).unwrap()).collect();
        backward.reverse();
        assert!(forward == backward);
        let seeds: std::collections::HashSet<_> = forward.iter().map(|s| s.render.seed).collect();
        assert_eq!(seeds.len(), 6);
        // Another setting that varies changes none of the others; another seed changes all that is drawn.
        let more = dataset(&format!("{TWO_GRIDS}[[vary]]\nname = \"nd\"\nchoice = [\"ND8\", \"ND4\"]\n")).unwrap();
        assert_eq!(more.shot(2).unwrap().exposure.compensation, forward[2].exposure.compensation);
        let other = dataset(&TWO_GRIDS.replace("seed = 4", "seed = 5")).unwrap();
        assert_ne!(other.shot(2).unwrap().exposure.compensation, forward[2].exposure.compensation);
    }

    #[test]
    fn splits_have_their_fractions_and_keep_groups_together() {
        let text = "items = 4000\n[[vary]]\nname = \"scene\"\nchoice = [\"cornell\", \"still-life\", \"rolling-ball\"]\n\
                    [split]\nfractions = { train = 0.8, test = 0.2 }\n";
        let set = dataset(text).unwrap();
        let test = (0..4000).filter(|i| set.split(*i) == Some("test")).count();
        // √(4000 · 0.8 · 0.2) = 25; five of them are allowed.
        assert!(test.abs_diff(800) < 127, "{test}");
        let shards = set.shards();
        let names: Vec<&str> = shards.iter().map(|s| s.name.as_str()).collect();
        assert_eq!(names, ["test-000000.tar", "train-000000.tar", "train-000001.tar", "train-000002.tar", "train-000003.tar"]);
        let mut all: Vec<u64> = shards.iter().flat_map(|s| s.items.clone()).collect();
        all.sort_unstable();
        assert_eq!(all, (0..4000).collect::<Vec<_>>());
        let grouped = dataset(&format!("{text}by = \"scene\"\n")).unwrap();
        let mut of = std::collections::HashMap::new();
        for item in 0..300 {
            let scene = text_of(&grouped.parameters(item).unwrap()[0].1);
            assert_eq!(*of.entry(scene).or_insert(grouped.split(item)), grouped.split(item));
        }
    }

    #[test]
    fn paths_are_relative_to_the_specification() {
        let set = dataset("items = 1\n[[vary]]\nname = \"scene\"\nvalues = [\"room.glb\"]\n").unwrap();
        assert_eq!(set.shot(0).unwrap().scene.file.as_deref(), Some(&*Path::new("here").join("room.glb").display().to_string()));
        assert_eq!(set.key(0), "000000");
    }

    #[test]
    fn truth_that_is_written_is_asked_for() {
        let set = dataset("items = 1\n[write]\nfiles = [\"dng\", \"depth.npy\", \"flow.npy\"]\n").unwrap();
        assert_eq!(set.shot(0).unwrap().render.truth_channels.as_deref(), Some("flow"));
    }

    #[test]
    fn what_makes_no_data_set_is_told() {
        for (text, said) in [
            ("", "items: no number; expected items = 1000"),
            ("items = 0", "items: 0; expected 1 to"),
            ("items = 1\n[write]\nfiles = [\"dngg\"]", "did you mean \"dng\""),
            ("items = 1\n[write]\nfiles = [\"dng\", \"dng\"]", "twice"),
            ("items = 1\n[write]\nlayout = \"zip\"", "shards, folders or both"),
            ("items = 1\n[write]\nshard_items = 0", "1 or more"),
            ("items = 1\n[split]\nfractions = { train = 0.5 }", "add up to 1"),
            ("items = 1\n[split]\nfractions = { \"a/b\" = 1.0 }", "letters, digits"),
            ("items = 1\n[split]\nby = \"iso\"\nfractions = { a = 1.0 }", "a setting that is varied"),
            ("items = 1\n[shot.render]\ntime_limit = \"5 s\"", "no limit of time"),
            ("items = 1\n[shot.render]\nseed = 5", "each item has its own"),
            ("items = 1\n[shot.output]\nfiles = [\"a.jpg\"]", "[write] says"),
            ("items = 1\n[shot.sequence]\nbracket = 3", "single pictures"),
            ("items = 1\n[shot.sequence]\nfps = -5", "[shot.sequence]: fps -5; expected above 0 frames a second"),
            ("items = 1\n[[vary]]\nname = \"isso\"\nvalues = [100]", "did you mean \"iso\""),
            ("items = 1\n[[vary]]\nname = \"iso\"\nvalues = [100, \"fast\"]", "[[vary]] 1 (iso): iso \"fast\""),
            ("items = 1\n[[vary]]\nname = \"render.time_limit\"\nvalues = [\"1 s\"]", "no limit of time"),
            ("item = 1", "unknown field"),
        ] {
            let told = dataset(text).unwrap_err().to_string();
            assert!(told.starts_with("spec.toml: ") && told.contains(said), "{text}: {told}");
        }
    }
}
