//! Whether items can be taken, before any is: shots that show it are prepared (scene, body, lens, every setting) and not exposed.

use super::item::{self, File};
use super::rule::numbers;
use super::{Dataset, Setting};
use crate::expose::{ExposeError, ProgressReporter};
use crate::sheet::text_of;
use crate::shot::{SceneCache, ShotError, is_of_scene};
use std::collections::{BTreeMap, BTreeSet, HashSet};

/// Items that are looked at for those to try.
const LOOKED_AT: u64 = 100_000;
/// Most items that are tried: a lens is traced for each.
const MOST_TRIED: usize = 1000;
/// Most values of a setting whose combinations with others are tried, too.
const MOST_PAIRED: usize = 64;

impl Dataset {
    /// Tries the items that show whether all can be taken, without exposing any: the first with each value that is listed, and with each two of them
    /// (scenes apart: they are slow to read), and those with the least and the largest of each number that is drawn. They are looked for among the first 100 000
    /// items, and 1000 are tried at most; answers with their number. A value in between may still be refused when its item is made, as autofocus or metering may.
    /// Fails as preparing a shot does, naming the item, and with [`ExposeError::Cancelled`].
    pub fn check_items(&self, watch: &ProgressReporter, warn: &mut dyn FnMut(&str)) -> Result<usize, ShotError> {
        let items = self.telling_items();
        let mut scenes = SceneCache::new();
        for (done, item) in items.iter().enumerate() {
            if watch.cancel.load(std::sync::atomic::Ordering::Relaxed) {
                return Err(ExposeError::Cancelled.into());
            }
            (watch.progress)(done as f64 / items.len() as f64);
            let mut tried = self.prepared(*item, &mut scenes, warn).map(|(shot, ..)| shot);
            if self.files.contains(&File::Calibration) {
                tried = tried.and_then(|shot| item::calibration(&shot, &self.files, "").map(|_| shot));
            }
            tried.map_err(|e| self.of_item(*item, e))?;
        }
        Ok(items.len())
    }

    /// Items to try, those of one scene after one another: the last scene is kept.
    fn telling_items(&self) -> Vec<u64> {
        let listed: HashSet<&String> = self.vary.iter().filter(|v| v.is_listed()).flat_map(|v| &v.names).collect();
        let mut counts: BTreeMap<String, HashSet<String>> = BTreeMap::new();
        let mut seen: HashSet<String> = HashSet::new();
        let mut ends: BTreeMap<(String, usize), [(f64, u64); 2]> = BTreeMap::new();
        let mut chosen = BTreeSet::from([0]);
        for item in 0..self.items.min(LOOKED_AT) {
            let settings = self.settings(item);
            let (of_lists, drawn): (Vec<&Setting>, Vec<&Setting>) = settings.iter().partition(|s| listed.contains(&s.0));
            let mut is_new = false;
            let mut paired: Vec<String> = Vec::new();
            for (name, value) in of_lists {
                let text = text_of(value);
                let values = counts.entry(name.clone()).or_default();
                let told = format!("{name} {text}");
                values.insert(text);
                is_new |= seen.insert(told.clone());
                if !is_of_scene(name) && values.len() <= MOST_PAIRED {
                    is_new |= paired.iter().fold(false, |new, other| seen.insert(format!("{other}, {told}")) | new);
                    paired.push(told);
                }
            }
            if is_new && chosen.len() < MOST_TRIED {
                chosen.insert(item);
            }
            for (name, value) in drawn {
                for (k, number) in numbers(value).into_iter().enumerate() {
                    let [least, largest] = ends.entry((name.clone(), k)).or_insert([(number, item); 2]);
                    if number < least.0 {
                        *least = (number, item);
                    }
                    if number > largest.0 {
                        *largest = (number, item);
                    }
                }
            }
        }
        chosen.extend(ends.values().flatten().map(|end| end.1));
        let mut all: Vec<u64> = chosen.into_iter().take(MOST_TRIED).collect();
        all.sort_by_cached_key(|item| (self.scene_of(*item), *item));
        all
    }

    /// An error with the item that it is of, and what differs in it.
    pub(super) fn of_item(&self, item: u64, e: ShotError) -> ShotError {
        let differs: Vec<String> = self.settings(item).iter().map(|s| format!("{} {}", s.0, text_of(&s.1))).collect();
        let differs = if differs.is_empty() { String::new() } else { format!(" ({})", differs.join(", ")) };
        e.of_shot(format!("{}: item {}{differs}", self.place, self.key(item)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;
    use std::sync::atomic::AtomicBool;

    fn tried(text: &str) -> Result<usize, ShotError> {
        let set = Dataset::new(text, "spec.toml", Path::new("")).unwrap_or_else(|e| panic!("{text}: {e}"));
        let cancel = AtomicBool::new(false);
        set.check_items(&ProgressReporter { cancel: &cancel, progress: &|_| () }, &mut |_| ())
    }

    const SHOT: &str = "[shot]\nscene.file = \"flat-field\"\nrender = { size = \"24x16\", spp = 1 }\n";

    #[test]
    fn items_that_cannot_be_taken_are_named_before_any_is() {
        let vary = |name: &str, rule: &str| format!("items = 40\n{SHOT}[[vary]]\nname = \"{name}\"\n{rule}\n");
        let lists = |iso: &str, body: &str| {
            format!("{SHOT}[[vary]]\nname = \"iso\"\ngrid = {iso}\n[[vary]]\nname = \"body\"\ngrid = {body}\n")
        };
        for (text, told) in [
            (vary("iso", "values = [100, 3]"), "spec.toml: item 000001 (iso 3): ISO 3: expected 100 to"),
            (
                vary("scene", "values = [\"cornell\", \"none.glb\"]"),
                "item 000001 (scene none.glb): none.glb: there is no such file",
            ),
            (vary("lens", "values = [\"thin\", \"double-gauss-51mm\"]"), "did you mean \"double-gauss-50mm\"?"),
            (vary("body", "choice = [\"ideal\", \"nikon-d851\"]"), "did you mean \"nikon-d850\"?"),
            (vary("focal-length", "values = [\"50 mm\", \"0 mm\"]"), "focal length 0 mm"),
            (vary("fps", "values = [30, -1]"), "item 000001 (fps -1): fps -1: expected above 0"),
            // Some of what is drawn is beyond what the body has: the largest is tried.
            (vary("iso", "range = [100, 1000000]"), "expected 100 to 6400 on"),
            // Each goes with the other's first value, but not both with their last.
            (
                lists("[100, 650]", "[\"ideal\", \"imx249\"]"),
                "item 000002 (iso 100, body imx249): ISO 100: expected 650, the only speed of",
            ),
            (
                format!("items = 2\n{SHOT}camera.lens = \"panorama\"\n[write]\nfiles = [\"calibration.json\"]\n"),
                "item 000000: calibration: a panorama",
            ),
            (format!("items = 2\n{}", SHOT.replace("24x16", "0x16")), "spec.toml: item 000000: size 0x16: expected 1 to"),
        ] {
            let error = tried(&text).expect_err(&text);
            assert!(error.to_string().contains(told), "{text}: {error}");
        }
        // A file that is not there is no fault of the request; parts say where and what.
        let lost = tried(&vary("scene", "values = [\"none.glb\"]")).unwrap_err();
        assert!(!lost.is_request());
        let parts = tried(&vary("iso", "values = [3]")).unwrap_err().parts();
        assert_eq!((parts.place.as_deref(), parts.found.as_deref()), (Some("spec.toml: item 000000 (iso 3): ISO"), Some("3")));
    }

    #[test]
    fn few_items_are_tried() {
        // Two of a list, each first seen at once; the least and the largest of what is drawn.
        let drawn = "[[vary]]\nname = \"compensation\"\nrange = [\"-1 EV\", \"1 EV\"]\n";
        let listed = "[[vary]]\nname = \"iso\"\nvalues = [100, 400]\n";
        let n = tried(&format!("items = 3000\n{SHOT}{listed}{drawn}")).unwrap();
        assert!((3..=4).contains(&n), "{n}");
        assert_eq!(tried(&format!("items = 3000\n{SHOT}")).unwrap(), 1);
    }
}
