//! An item: one shot, from scene to files in memory.

use super::{Dataset, tar};
use crate::calibration::{Calibration, Format};
use crate::expose::{ExposeError, ProgressReporter, object_names};
use crate::npy;
use crate::raw_file;
use crate::shot::{ExposureUse, Inputs, SceneCache, Sequence, Shot, ShotError};
use crate::truth;
use diopter_develop::{Recipe, develop};
use diopter_image::channels::{CHANNELS, Channel, PixelType};
use diopter_image::dng::Storage;
use diopter_image::truth::Values;
use diopter_image::{FocalPlane, ImageError, Picture, RawImage, cryptomatte, exr, jpeg, png, tiff_file};
use diopter_sensor::{ColorSampling, ReadOut, Window};
use serde_json::{Map, Value, json};
use std::collections::BTreeSet;
use std::io::Cursor;
use std::path::PathBuf;

/// A file of an item.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum File {
    /// The raw file.
    Dng,
    /// Its numbers.
    Raw,
    /// The numbers it would have without noise of time, not rounded.
    Expected,
    Jpeg,
    Png,
    Tiff,
    /// Developed light without a tone curve.
    Exr,
    Mean,
    Variance,
    HalfDifference,
    /// The focal plane.
    Plane,
    /// The truth beside a raw file.
    Truth,
    /// The camera of the pictures, and where it stood.
    Calibration,
    Channel(&'static Channel),
}

/// What stands behind the number of an item.
const NAMES: [(&str, File); 13] = [
    ("dng", File::Dng),
    ("raw.npy", File::Raw),
    ("expected.npy", File::Expected),
    ("jpg", File::Jpeg),
    ("png", File::Png),
    ("tif", File::Tiff),
    ("exr", File::Exr),
    ("mean.npy", File::Mean),
    ("variance.npy", File::Variance),
    ("half-difference.npy", File::HalfDifference),
    ("plane.exr", File::Plane),
    ("truth.exr", File::Truth),
    ("calibration.json", File::Calibration),
];

/// What a file of an item holds, by what stands behind the number.
pub(super) fn about(ending: &str) -> String {
    let plain = match ending {
        "json" => "what was varied, facts of the exposure, where the camera stood",
        "dng" => "the raw file",
        "raw.npy" => "its numbers (DN), `uint16 [row][column]`",
        "expected.npy" => "the numbers it would have without noise of time, not rounded (DN), `float32 [row][column]`",
        "jpg" | "png" | "tif" => "the developed picture",
        "exr" => "developed light without a tone curve, linear",
        "mean.npy" => "mean electrons without sensor noise, `float32 [row][column][band]`",
        "variance.npy" => "Monte Carlo variance of the mean, e⁻², one degree of freedom a pixel, `float32 [row][column][band]`",
        "half-difference.npy" => {
            "half the difference of the two independent halves of the samples, e⁻, `float32 [row][column][band]`"
        }
        "plane.exr" => "the focal plane: mean, half difference, truth",
        "truth.exr" => "the truth of the raw file, pixel by pixel",
        "calibration.json" => "model and numbers of the camera of the picture (px), and its poses while the shutter is open",
        _ => "",
    };
    match File::named(ending) {
        Some(File::Channel(c)) => {
            let about = c.about.replace(
                "six ranks; the manifest is in the header",
                "six ranks of identifier and coverage; names stand in the `json`",
            );
            let unit = if c.unit.is_empty() { String::new() } else { format!(" ({})", c.unit) };
            let numbers = match c.numbers {
                PixelType::Float => "float32",
                PixelType::Whole => "uint32",
            };
            let parts = if c.parts() == 1 { "" } else { "[part]" };
            format!("{about}{unit}, `{numbers} [row][column]{parts}`")
        }
        _ => plain.to_owned(),
    }
}

/// JPEG quality: that of `diopter shoot`.
const JPEG_QUALITY: u8 = 92;

impl File {
    /// The file of a name, such as `dng` or `depth.npy`; `None` of one that is not known.
    pub fn named(name: &str) -> Option<File> {
        let channel = || Some(File::Channel(CHANNELS.iter().find(|c| Some(c.name) == name.strip_suffix(".npy"))?));
        NAMES.iter().find(|n| n.0 == name).map(|n| n.1).or_else(channel)
    }

    /// All that there are.
    pub fn names() -> Vec<String> {
        NAMES.iter().map(|n| n.0.to_owned()).chain(CHANNELS.iter().map(|c| format!("{}.npy", c.name))).collect()
    }

    /// Its name, which is the ending of the items' files.
    pub fn name(self) -> String {
        match self {
            File::Channel(channel) => format!("{}.npy", channel.name),
            other => NAMES.iter().find(|n| n.1 == other).map_or("", |n| n.0).to_owned(),
        }
    }

    /// Whether it goes with a mosaic, pixel for pixel.
    pub fn goes_with_a_mosaic(self) -> bool {
        matches!(self, File::Raw | File::Expected | File::Truth)
    }

    /// Whether it is made of a read-out.
    pub fn is_read_out(self) -> bool {
        matches!(self, File::Dng | File::Raw | File::Expected | File::Jpeg | File::Png | File::Tiff | File::Exr | File::Truth)
    }
}

/// Of files of an item the picture that other programs look at.
fn picture_of(files: &[File]) -> Option<File> {
    [File::Jpeg, File::Png, File::Tiff, File::Exr, File::Dng].into_iter().find(|f| files.contains(f))
}

/// Name of the picture of an item; without one that of the first file.
pub(crate) fn picture_name(files: &[File], key: &str) -> String {
    picture_of(files).or(files.first().copied()).map_or_else(|| key.to_owned(), |file| format!("{key}.{}", file.name()))
}

/// Whether the picture of an item is developed.
pub(crate) fn is_developed(files: &[File]) -> bool {
    picture_of(files).is_some_and(|picture| picture != File::Dng)
}

/// Says where a development moves what a picture shows, and channels beside it stay where the sensor sees them.
pub(crate) fn warn_of_geometry(shot: &Shot, files: &[File], warn: &mut dyn FnMut(&str)) {
    let Some(channel) = files.iter().find(|f| matches!(f, File::Channel(_))).filter(|_| is_developed(files)) else { return };
    let (geometry, film) = (shot.geometry(), &shot.camera.film);
    let how = match geometry.straight {
        Some(_) => "straightens the picture (lens.distortion)",
        None if geometry.size != [film.columns, film.rows] => "changes its size",
        None => return,
    };
    warn(&format!(
        "the development {how}: {} and other channels beside it stay as the sensor has them, pixel for pixel with raw files, not with the picture",
        channel.name()
    ));
}

/// What is done with the exposures of items.
pub(crate) fn memory_use(files: &[File]) -> ExposureUse {
    if files.contains(&File::Truth) { ExposureUse::Truth } else { ExposureUse::Plane }
}

/// The calibration for the picture of an item: as its development has it, or without one as the sensor takes it. Fails where no model comes near the lens.
pub(crate) fn calibration(shot: &Shot, files: &[File], key: &str) -> Result<Calibration, ShotError> {
    Ok(shot.calibration_of(&picture_name(files, key), is_developed(files), None)?)
}

/// The text of [`File::Calibration`]: without the map of what the fit leaves, which is large.
pub(crate) fn calibration_json(shot: &Shot, files: &[File], key: &str) -> Result<String, ShotError> {
    let mut calibration = calibration(shot, files, key)?;
    if let Some(fit) = &mut calibration.fit {
        fit.map.clear();
    }
    Ok(calibration.text(Format::Json)?)
}

/// The truth channels that are asked for, and those that are written.
pub(crate) fn truth_channels(asked: Option<&str>, files: &[File]) -> Option<String> {
    let asked = asked.map(str::trim).filter(|a| !a.is_empty());
    if asked == Some("all") {
        return Some("all".into());
    }
    let listed = |name: &str| asked.is_some_and(|a| a.split(',').any(|n| n.trim() == name));
    let more = files.iter().filter_map(|f| match f {
        File::Channel(c) if !c.is_always() && !listed(c.name) => Some(c.name),
        _ => None,
    });
    let all: Vec<&str> = asked.into_iter().chain(more).collect();
    (!all.is_empty()).then(|| all.join(","))
}

impl Dataset {
    /// Makes an item: its files as a tar archive, by name, as they go into a shard. `scenes` keeps the scene for the next item; `warn` gets what was found
    /// odd.
    ///
    /// The archive is the same bytes wherever it is made, with the same version of diopter on the same kind of processor. Nothing of the clock, the machine or
    /// the folder is in it. Pictures are not denoised and outliers are kept, unless the specification says otherwise in `[shot.render]`; what denoises
    /// by `on` or `oidn` depends on the library that is found. Fails, naming the item, on a number beyond the last item, on values that the shot file does not take, where the shot cannot
    /// be taken or written, and with [`ExposeError::Cancelled`].
    pub fn make_item(
        &self,
        item: u64,
        scenes: &mut SceneCache,
        watch: &ProgressReporter,
        warn: &mut dyn FnMut(&str),
    ) -> Result<Vec<u8>, ShotError> {
        self.made(item, scenes, watch, warn).map_err(|e| self.of_item(item, e))
    }

    /// The shot of an item, ready to be focused; with the names that the specification has for scene and calibration.
    pub(super) fn prepared(
        &self,
        item: u64,
        scenes: &mut SceneCache,
        warn: &mut dyn FnMut(&str),
    ) -> Result<(Shot, Option<String>, Option<PathBuf>), ShotError> {
        let mut file = self.relative_shot(item)?;
        let (scene, calibration) = (file.scene.file.clone(), file.camera.calibration.clone());
        file.place_paths(self.folder());
        // A shutter angle becomes a time.
        Sequence::new(&mut file)?;
        if file.camera.color_sampling == Some(ColorSampling::Full)
            && let Some(mosaic) = self.files.iter().find(|f| f.goes_with_a_mosaic())
        {
            return Err(needs_a_mosaic(*mosaic));
        }
        Ok((Shot::prepare_cached(&file, Inputs::default(), scenes, warn)?, scene, calibration))
    }

    fn made(
        &self,
        item: u64,
        scenes: &mut SceneCache,
        watch: &ProgressReporter,
        warn: &mut dyn FnMut(&str),
    ) -> Result<Vec<u8>, ShotError> {
        let (mut shot, scene, calibration_file) = self.prepared(item, scenes, warn)?;
        shot.check_memory(memory_use(&self.files), None)?;
        warn_of_geometry(&shot, &self.files, warn);
        let quiet = ProgressReporter { cancel: watch.cancel, progress: &|_| () };
        shot.focus(&quiet, warn)?;
        shot.meter_if_needed(&quiet, warn)?;
        let key = self.key(item);
        // Before the exposure: it may fail.
        let calibration_json = match self.files.contains(&File::Calibration) {
            true => calibration_json(&shot, &self.files, &key)?,
            false => String::new(),
        };
        let exposed = shot.expose_from(None, watch, None)?;
        if exposed.stopped {
            return Err(ExposeError::Cancelled.into());
        }
        let mut plane = exposed.plane;
        if let Some(name) = scene {
            // By the name that the specification has for it, wherever that lies.
            plane.facts.scene = name;
        }
        if let Some(path) = calibration_file {
            plane.facts.lens = path.display().to_string();
        }
        let raw = if self.files.iter().any(|f| f.is_read_out()) { Some(shot.read_out(&plane)?) } else { None };
        let failed = |e: ImageError| ShotError::Read { path: format!("item {key}"), reason: e.to_string() };
        let mut files = vec![(format!("{key}.json"), self.told(item, &shot, &plane, raw.as_ref())?)];
        for file in &self.files {
            let made = Making { shot: &shot, plane: &plane, raw: raw.as_ref(), calibration_json: &calibration_json };
            files.push((format!("{key}.{}", file.name()), made.bytes(*file, &failed)?));
        }
        files.sort();
        let archive = tar::archive(files.iter().map(|(n, b)| (n.as_str(), b.as_slice())));
        archive.map_err(|e| failed(ImageError::Io(e)))
    }

    /// Names of what the channels of the item show by numbers (of objects and classes) and identifiers (of Cryptomatte); null where none of them is written.
    fn names(&self, shot: &Shot, plane: &FocalPlane) -> Value {
        let recorded = plane.truth.recorded();
        let mut all = Map::new();
        let writes = |name: &str| self.files.iter().any(|f| matches!(f, File::Channel(c) if c.name == name));
        let objects = if writes("id") { object_names(shot.scene.description()) } else { Vec::new() };
        for (channel, key, names) in [("id", "objects", &objects), ("class", "classes", &*recorded.classes)] {
            if writes(channel) {
                let name = |number: u32| names.get((number as usize).checked_sub(1)?);
                let named = |number: u32| name(number).map(|name| json!({ "number": number, "name": name }));
                all.insert(key.into(), occurring(plane, channel).into_iter().filter_map(named).collect());
            }
        }
        for channel in ["crypto-object", "crypto-material", "crypto-class"].into_iter().filter(|name| writes(name)) {
            let there = occurring(plane, channel);
            let layer = CHANNELS.iter().find(|c| c.name == channel).map(|c| c.matte_layer());
            let names = recorded.manifests.iter().filter(|m| Some(m.layer.as_str()) == layer).flat_map(|m| &m.names);
            let hashes =
                names.map(|name| (name, cryptomatte::identifier(name).to_bits())).filter(|named| there.contains(&named.1));
            all.insert(
                channel.into(),
                hashes.map(|(name, hash)| json!({ "hash": format!("{hash:08x}"), "name": name })).collect(),
            );
        }
        if all.is_empty() { Value::Null } else { Value::Object(all) }
    }

    /// What is known of an item, as JSON.
    fn told(&self, item: u64, shot: &Shot, plane: &FocalPlane, raw: Option<&RawImage>) -> Result<Vec<u8>, ShotError> {
        let mut facts = raw.map_or(&plane.facts, |r| &r.header.facts).clone();
        // A table of the lens, which is in the raw file.
        facts.lens_profile = None;
        let pose = shot.calibration_frame("").middle().map(|p| p.world_from_camera);
        let pose = pose.map(|p| {
            let (m, t) = (p.matrix3, p.translation);
            [0, 1, 2].map(|r| [m.x_axis[r], m.y_axis[r], m.z_axis[r], t[r]])
        });
        let parameters = self.parameters_json(item)?;
        let told = json!({
            "key": parameters["key"],
            "item": item,
            "split": parameters["split"],
            "seed": plane.facts.seed,
            "size": [plane.width(), plane.height()],
            "parameters": parameters["parameters"],
            "facts": facts,
            "names": self.names(shot, plane),
            // Camera axes x right, y up, z backward; the middle of the exposure. Three rows of four.
            "world_from_camera": pose,
        });
        Ok(format!("{told:#}\n").into_bytes())
    }
}

/// Numbers of a channel of the truth that occur, each once.
fn occurring(plane: &FocalPlane, channel: &str) -> BTreeSet<u32> {
    match plane.truth.values(channel) {
        Some(Values::Whole(raster)) => raster.data.iter().copied().collect(),
        // Identifiers and coverages by turns.
        Some(Values::Float(raster)) => raster.data.iter().step_by(2).map(|v| v.to_bits()).collect(),
        None => BTreeSet::new(),
    }
}

fn needs_a_mosaic(file: File) -> ShotError {
    ShotError::Entry {
        place: "[write] files".into(),
        found: format!("{} of a shot with camera.color_sampling = \"full\"", file.name()),
        expected: "\"mosaic\", with which it goes pixel for pixel, or other files".into(),
    }
}

/// What files are made of.
pub(crate) struct Making<'a> {
    pub shot: &'a Shot,
    pub plane: &'a FocalPlane,
    pub raw: Option<&'a RawImage>,
    /// The text of [`File::Calibration`], where it is among the files.
    pub calibration_json: &'a str,
}

impl Making<'_> {
    /// The bytes of a file of the item. Fails on a channel that the exposure does not record, where development fails, and (told by `failed`) on a picture that the
    /// format cannot hold, and without a raw image where the file is made of one.
    pub fn bytes(&self, file: File, failed: &impl Fn(ImageError) -> ShotError) -> Result<Vec<u8>, ShotError> {
        let plane = self.plane;
        let floats = |r: &diopter_image::Raster<f32>| npy::array(&r.data, [r.width, r.height, r.channels]);
        let raw = || {
            self.raw.ok_or_else(|| ShotError::Entry {
                place: "[write] files".into(),
                found: "an exposure that is not read out".into(),
                expected: "a raw image for this file".into(),
            })
        };
        type Write<'a> = dyn Fn(&mut Cursor<Vec<u8>>) -> Result<(), ImageError> + 'a;
        let written = |write: &Write| {
            let mut to = Cursor::new(Vec::new());
            write(&mut to).map_err(failed)?;
            let mut bytes = to.into_inner();
            if matches!(file, File::Exr | File::Plane | File::Truth) {
                exr::sort_attributes(&mut bytes).map_err(failed)?;
            }
            Ok(bytes)
        };
        let picture = || -> Result<Picture, ShotError> { self.shot.develop(raw()?) };
        if file.goes_with_a_mosaic() && self.shot.color_sampling == ColorSampling::Full {
            return Err(needs_a_mosaic(file));
        }
        match file {
            File::Dng => {
                let raw = raw()?;
                written(&|to| raw_file::write_image(raw, Storage::Lossless, &Recipe::default(), to))
            }
            File::Raw => {
                let r = &raw()?.mosaic;
                Ok(npy::array(&r.data, [r.width, r.height, r.channels]))
            }
            File::Expected => {
                let (reader, mean) = (self.reader()?, Window { first: 0, data: &plane.mean.data });
                let dn: Vec<f32> = (0..plane.height()).flat_map(|row| reader.expected(&mean, row)).map(|e| e.dn).collect();
                Ok(npy::array(&dn, [plane.width(), plane.height(), 1]))
            }
            File::Jpeg => picture().and_then(|p| written(&|to| jpeg::write(&p, JPEG_QUALITY, to))),
            File::Png => picture().and_then(|p| written(&|to| png::write(&p, png::Depth::Eight, to))),
            File::Tiff => picture().and_then(|p| written(&|to| tiff_file::write(&p, to))),
            File::Exr => {
                let light = develop(raw()?, &self.shot.recipe.linear_light(), None)?;
                written(&|to| exr::write_picture(&light, exr::Precision::Half, to))
            }
            File::Mean => Ok(floats(&plane.mean)),
            File::Variance => Ok(floats(&plane.variance())),
            File::HalfDifference => Ok(floats(&plane.half_difference)),
            File::Plane => written(&|to| exr::write_focal_plane(plane, to)),
            File::Truth => {
                let (reader, raw) = (self.reader()?, raw()?);
                written(&|to| truth::write(plane, &reader, raw, exr::TruthLayout::SinglePart, plane.truth.recorded(), to))
            }
            File::Calibration => Ok(self.calibration_json.into()),
            File::Channel(channel) => match plane.truth.values(channel.name) {
                Some(Values::Float(raster)) => Ok(floats(raster)),
                Some(Values::Whole(r)) => Ok(npy::array(&r.data, [r.width, r.height, r.channels])),
                None => Err(ShotError::Entry {
                    place: "[write] files".into(),
                    found: format!("{}.npy", channel.name),
                    expected: "a channel that this exposure records".into(),
                }),
            },
        }
    }

    fn reader(&self) -> Result<ReadOut<'_>, ShotError> {
        let (shot, plane) = (self.shot, self.plane);
        let size = [plane.width(), plane.height()];
        let reader = ReadOut::new(&shot.sensor, &shot.reading, size, &plane.bands, plane.facts.exposure_s)?;
        Ok(reader.with_rows_of(&plane.facts))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;
    use std::path::Path;
    use std::sync::atomic::AtomicBool;

    fn make(set: &Dataset, item: u64, scenes: &mut SceneCache) -> Vec<u8> {
        let cancel = AtomicBool::new(false);
        set.make_item(item, scenes, &ProgressReporter { cancel: &cancel, progress: &|_| () }, &mut |_| ()).unwrap()
    }

    const SPEC: &str = "seed = 2\n[shot]\nscene.file = \"cornell\"\nexposure.shutter = \"1/30\"\nrender = { size = \"24x16\", spp = 2 }\n\
        [[vary]]\nname = \"iso\"\ngrid = [100, 1600]\n[[vary]]\nname = \"scene\"\ngrid = [\"cornell\", \"rolling-ball\"]\n\
        [write]\nfiles = [\"dng\", \"raw.npy\", \"expected.npy\", \"png\", \"mean.npy\", \"variance.npy\", \"depth.npy\", \"coverage.npy\", \"id.npy\", \"truth.exr\", \"plane.exr\", \"exr\", \"calibration.json\"]\n";

    #[test]
    fn items_are_the_same_bytes_in_any_order_and_with_any_scene_before() {
        let set = Dataset::new(SPEC, "spec.toml", Path::new("")).unwrap();
        let mut scenes = SceneCache::new();
        let forward: Vec<_> = (0..4).map(|i| make(&set, i, &mut scenes)).collect();
        for item in [3, 0, 2] {
            assert!(make(&set, item, &mut SceneCache::new()) == forward[item as usize], "{item}");
        }
        assert!(forward[0] != forward[1] && forward[0] != forward[2]);
    }

    #[test]
    fn an_item_has_the_files_that_were_asked_for() {
        let set = Dataset::new(SPEC, "spec.toml", Path::new("")).unwrap();
        let mut files = BTreeMap::new();
        let archive = make(&set, 1, &mut SceneCache::new());
        tar::read(&archive[..], |name, bytes| {
            files.insert(name.to_owned(), bytes.to_vec());
            Ok(())
        })
        .unwrap();
        let names: Vec<&str> = files.keys().map(String::as_str).collect();
        let endings = "calibration.json coverage.npy depth.npy dng expected.npy exr id.npy json mean.npy plane.exr png raw.npy truth.exr variance.npy";
        assert_eq!(names, endings.split(' ').map(|e| format!("000001.{e}")).collect::<Vec<_>>());
        let raw = diopter_image::dng::read(Cursor::new(files["000001.dng"].clone())).unwrap();
        let numbers: Vec<u8> = raw.mosaic.data.iter().flat_map(|v| v.to_le_bytes()).collect();
        assert!(files["000001.raw.npy"].ends_with(&numbers));
        // 24 × 16 pixels of three bands, 4 bytes each.
        assert_eq!(files["000001.mean.npy"].len(), 128 + 24 * 16 * 3 * 4);
        let told: serde_json::Value = serde_json::from_slice(&files["000001.json"]).unwrap();
        assert_eq!((&told["parameters"]["iso"], &told["facts"]["iso"]), (&json!(1600), &json!(1600.0)));
        assert_eq!((&told["facts"]["scene"], &told["split"]), (&json!("cornell"), &json!(null)));
        let camera: serde_json::Value = serde_json::from_slice(&files["000001.calibration.json"]).unwrap();
        assert_eq!(camera["frames"][0]["file"], json!("000001.png"));
        let ids = told["names"]["objects"].as_array().unwrap();
        assert!(
            !ids.is_empty() && ids.iter().all(|named| named["number"].as_u64() > Some(0) && named["name"].is_string()),
            "{ids:?}"
        );
        assert!(told["facts"]["date"].is_null() && told["world_from_camera"][2][3].is_number());
    }
}
