//! What is written of a data set: a file in TOML. `docs/datasets.md` explains it; [`super::Dataset`] checks it.

use crate::sheet::Names;
use crate::shot::ShotFile;
use serde::Deserialize;
use std::collections::BTreeMap;

/// What a specification says.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SpecFile {
    /// Name of the data set, for its card.
    pub name: Option<String>,
    /// What it is, in words, for its card.
    pub description: Option<String>,
    /// How many items; without, one for each combination of the grids.
    pub items: Option<u64>,
    /// What everything random follows from.
    pub seed: u64,
    /// The shot, as in a shot file.
    pub shot: ShotFile,
    /// What varies from item to item.
    pub vary: Vec<VarySection>,
    /// What is written of an item.
    pub write: WriteSection,
    /// Parts of the data set.
    pub split: Option<SplitSection>,
}

/// `[[vary]]`: a setting (or several that change together) and one rule for its values.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct VarySection {
    /// Name of a setting, as [`ShotFile::with`] knows it, or a list of names.
    pub name: Names,
    /// Rule: one after another, from the beginning again.
    pub values: Option<Vec<toml::Value>>,
    /// Rule: all combinations with the other grids, the first grid varying fastest.
    pub grid: Option<Vec<toml::Value>>,
    /// Rule: one of these by chance.
    pub choice: Option<Vec<toml::Value>>,
    /// Of `choice`: how often each, in proportion.
    pub weights: Option<Vec<f64>>,
    /// Rule: evenly distributed between two values. Beside `normal`: only what lies between.
    pub range: Option<Vec<toml::Value>>,
    /// Of `range`: `linear` (without it) or `log`.
    pub scale: Option<String>,
    /// Rule: normally distributed, with mean and standard deviation.
    pub normal: Option<Vec<toml::Value>>,
    /// Of `range` and `normal`: rounded to multiples of this, in the unit of the values.
    pub step: Option<f64>,
    /// Rule: where the camera stands. No name beside it.
    pub pose: Option<PoseSection>,
    /// Only where settings that are varied further up have these values: a value, a list of them, or `{ min, max }` for numbers.
    pub when: BTreeMap<String, toml::Value>,
}

/// `pose = { ... }`: the camera on a sphere around something, or on a path.
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoseSection {
    /// What the camera looks at, m.
    pub look_at: [f64; 3],
    /// Around it: nearest and farthest distance, m.
    pub distance: Option<[f64; 2]>,
    /// Lowest and highest elevation above the horizontal, degrees; 0 to 90 without.
    pub elevation_deg: Option<[f64; 2]>,
    /// From where to where about the vertical, degrees: 0 in front (+z), 90 on the right (+x). All around without.
    pub azimuth_deg: Option<[f64; 2]>,
    /// So many places, spread evenly, one after another; without, places are random.
    pub places: Option<u64>,
    /// Instead of a sphere: corners of a path, m.
    pub path: Option<Vec<[f64; 3]>>,
    /// The camera is aimed at a random point of the ball of this radius (m) about `look_at`.
    pub aim_within: Option<f64>,
}

/// `[write]`
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct WriteSection {
    /// Files of an item, by what stands behind its number: `dng`, `jpg`, `mean.npy`, `depth.npy` ...; `dng` without. `json` is always written.
    pub files: Option<Vec<String>>,
    /// `shards` (without it), `folders` or `both`.
    pub layout: Option<String>,
    /// Items of a shard at most; 1000 without.
    pub shard_items: Option<u64>,
}

/// `[split]`
#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SplitSection {
    /// Names and fractions, which add up to 1: `{ train = 0.9, test = 0.1 }`.
    pub fractions: BTreeMap<String, f64>,
    /// Items with the same value of this varied setting stay together.
    pub by: Option<String>,
}
